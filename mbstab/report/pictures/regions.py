"""Regions of a chart between the points of its grid: cells are cut where boundaries cross their edges."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from mbstab.compiler.system import Array

Labels = npt.NDArray[np.integer]
Point = tuple[float, float]
Polygon = list[Point]


def regions(x: Array, y: Array, labels: Labels, boundaries: Sequence[Array]) -> dict[int, list[Polygon]]:
    """Return the polygons that fill the region of each label.

    An edge of the grid between two labels is cut where a boundary crosses it, or else in the middle. Cuts of a
    cell are joined as `mbstab.analysis.sweep.boundaries` joins them to boundaries.

    Parameters
    ----------
    x, y : ndarray, ascending or descending, at least two values
    labels : ndarray of int, shape (len(y), len(x))
    boundaries : sequence of ndarray, shape (k, 2)
    """
    across, up = 0.5 * (x[1:] + x[:-1]) * np.ones((len(y), 1)), 0.5 * (y[1:] + y[:-1])[:, None] * np.ones(len(x))
    for curve in (_crossing(curve, x, y) for curve in boundaries):
        _cut(across, x, y, labels, curve)
        _cut(up.T, y, x, labels.T, curve[:, ::-1])
    corners = [labels[:-1, :-1], labels[:-1, 1:], labels[1:, 1:], labels[1:, :-1]]
    mixed = np.any([corner != corners[0] for corner in corners], axis=0)
    found: dict[int, list[Polygon]] = {int(label): [] for label in np.unique(labels)}
    for i, row in enumerate(corners[0]):
        # Neighbours in a row are one rectangle.
        state = np.where(mixed[i], np.min(labels) - 1, row)
        ends = [0, *(np.flatnonzero(np.diff(state)) + 1).tolist(), len(row)]
        for a, b in pairwise(ends):
            if not mixed[i, a]:
                found[int(row[a])].append([(x[a], y[i]), (x[b], y[i]), (x[b], y[i + 1]), (x[a], y[i + 1])])
    for i, j in np.argwhere(mixed).tolist():
        cell = [(x[j], y[i]), (x[j + 1], y[i]), (x[j + 1], y[i + 1]), (x[j], y[i + 1])]
        cuts = [(across[i, j], y[i]), (x[j + 1], up[i, j + 1]), (across[i + 1, j], y[i + 1]), (x[j], up[i, j])]
        for label, polygon in _divided(cell, cuts, [int(corner[i, j]) for corner in corners]):
            found[label].append(polygon)
    return found


def _crossing(curve: Array, x: Array, y: Array) -> Array:
    """Return a boundary with points where it crosses lines of the grid between its own, such as folds in each row."""
    found = [curve[:1]]
    for p, q in pairwise(curve):
        between = []
        for axis, lines in enumerate((x, y)):
            for line in lines[(lines - p[axis]) * (lines - q[axis]) < 0.0].tolist():
                part = (line - p[axis]) / (q[axis] - p[axis])
                point = p + part * (q - p)
                point[axis] = line
                between.append((part, point))
        found += [point[None] for _, point in sorted(between, key=lambda item: item[0])]
        found.append(q[None])
    return np.concatenate(found)


def _cut(across: Array, x: Array, y: Array, labels: Labels, curve: Array) -> None:
    """Set where a curve crosses the edges of the grid along x that lie between two labels."""
    order = np.sign(x[-1] - x[0])
    for px, py in curve.tolist():
        for i in np.flatnonzero(y == py).tolist():
            k = int(np.searchsorted(order * x, order * px))
            for j in (k - 1, k):  # at a corner, the edge between two labels
                if 0 <= j < len(x) - 1 and labels[i, j] != labels[i, j + 1] and sorted((x[j], px, x[j + 1]))[1] == px:
                    across[i, j] = px


def _divided(cell: Polygon, cuts: Polygon, labels: list[int]) -> list[tuple[int, Polygon]]:
    """Return the parts of a cell with their labels: corners in turn, and the cut of each edge behind its corner."""
    places = [k for k in range(4) if labels[k] != labels[(k + 1) % 4]]
    parts = []
    for a, b in pairwise([*places, places[0] + 4]):
        inside = [cell[k % 4] for k in range(a + 1, b + 1)]
        parts.append((labels[b % 4], [cuts[a], *inside, cuts[b % 4]]))
    if len(places) == 3:
        # Three regions meet in the cut nearest to the others.
        points = np.array([cuts[k] for k in places])
        hub = cuts[places[int(np.argmin([np.sum((points - point) ** 2) for point in points]))]]
        return [(label, part if hub in part else [*part, hub]) for label, part in parts]
    if len(places) == 4:
        # The second and the fourth corner are cut off; the first and the third share what lies between.
        low, high = ((0.5 * (cuts[a][0] + cuts[b][0]), 0.5 * (cuts[a][1] + cuts[b][1])) for a, b in ((0, 1), (2, 3)))
        parts[1][1].extend([high, low])
        parts[3][1].extend([low, high])
    return parts
