"""Names and numbers of branches, written where their curves are far from others."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from mbstab.analysis.sweep.sweep import Sweep
from mbstab.compiler.system import Array
from mbstab.report.pictures.curves import Mask
from mbstab.report.pictures.point_labels import LABELS, PointLabels
from mbstab.report.pictures.sweep_curves import SweepCurves

CLOSE, FREE = 0.01, 0.08
"""Parts of the panel: branches closer than this coincide, those farther apart than this do not hide a label."""

MOST, STANDS = 100, 25
"""Points of a curve whose distances to others are found, and those at which its label may stand."""

CROWDED = 40.0
"""Cost of a label where a curve meets another one; see the costs of `mbstab.report.pictures.point_labels`."""


def number_branches(axes: Axes, result: Sweep, curves: SweepCurves, x: Array, y: Array) -> PointLabels:
    """Return labels with the numbers of branches without names; a single pair needs none."""
    labels = PointLabels(axes)
    add_branches(labels, result, curves, (x, y))
    return labels


def add_branches(
    labels: PointLabels, result: Sweep, curves: SweepCurves, points: tuple[Array, Array], word: str | None = None
) -> None:
    """Add labels of branches where they are far from others; those that coincide share one.

    Parameters
    ----------
    labels : PointLabels
    result : Sweep
    curves : SweepCurves
    points : (ndarray, ndarray), shape (n, 1) or (n, r), and (n, r)
        The curves; nan where they are hidden.
    word : str, optional
        Stands before numbers, and names are written too; otherwise only branches without names get their numbers, if
        there are more than those of a pair.
    """
    if word is None and len(set(curves.ink)) < 2 and len(curves.ink) < 3:
        return
    shown, x, y, places, hidden = _seen(labels.axes, *points)
    order = np.linspace(0.0, 1.0, len(places))
    named: set[int] = set()
    for n in range(len(shown)):
        apart = np.hypot(*np.moveaxis(places - places[:, n : n + 1], 2, 0))
        known = ~np.isnan(apart)
        close = known.any(axis=0) & ~np.any(known & (apart >= CLOSE), axis=0)
        alike = close & np.all(hidden == hidden[:, n : n + 1], axis=0)
        # A conjugate one is shown on the real axis only, where it often lies on its twin.
        covered = np.any(close & ~alike & np.all(hidden <= hidden[:, n : n + 1], axis=0))
        if n in named or covered or len(labels.wanted) >= LABELS:
            continue
        same = np.flatnonzero(alike)
        named |= set(same.tolist())
        text = _text(result, [shown[m] for m in same], word)
        if text:
            room = _room(places, n, alike) + CLOSE * order  # of equal ones the last
            free = np.flatnonzero(~np.isnan(room))
            free = free[:: max(1, len(free) // STANDS)]
            along = np.column_stack([x[free, n], y[free, n]])
            labels.add_along(along, CROWDED * (1.0 - room[free] / FREE), text, curves.ink[shown[n]])


def _text(result: Sweep, numbers: Sequence[int], word: str | None) -> str:
    """Return the text of branches that coincide."""
    names = [result.names[j] if result.names else "" for j in numbers]
    named = [name for name in names if name and word is not None]
    unnamed = _runs([j + 1 for j, name in zip(numbers, names, strict=True) if not name])
    return (word if word and unnamed else "") + ", ".join([*unnamed, *named])


def _runs(numbers: Sequence[int]) -> list[str]:
    """Return numbers as texts, three or more that follow each other as one, such as ``4–7``."""
    runs: list[list[int]] = []
    for number in sorted(numbers):
        if runs and runs[-1][-1] == number - 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    return [x for run in runs for x in ([f"{run[0]}–{run[-1]}"] if len(run) > 2 else map(str, run))]


def _seen(axes: Axes, x: Array, y: Array) -> tuple[list[int], Array, Array, Array, Mask]:
    """Return the branches in a panel, some points of each, these as parts of the panel, and which are hidden.

    Parts of the panel are nan outside of it.
    """
    fraction = axes.transData + axes.transAxes.inverted()
    x, y = np.broadcast_arrays(x, y)
    some = np.flatnonzero(~np.isnan(y).all(axis=1))
    ends = fraction.transform(np.column_stack([x[some].ravel(), y[some].ravel()])).reshape(len(some), x.shape[1], 2)
    inside = np.all((ends >= 0.0) & (ends <= 1.0), axis=2)
    rows = np.flatnonzero(inside.any(axis=1))
    rows = rows[:: max(1, len(rows) // MOST)]
    shown = np.flatnonzero(inside[rows].any(axis=0))
    part = np.ix_(rows, shown)
    places = np.where(inside[part][:, :, None], ends[part], np.nan)
    own = np.ix_(some[rows], shown)
    return shown.tolist(), x[own], y[own], places, np.isnan(y[own])


def _room(places: Array, n: int, same: Mask) -> Array:
    """Return the distance of each point of a branch to the others and to the frame, or `FREE` if that is less."""
    others = places[:, ~same].reshape(-1, 2)
    others = others[~np.isnan(others[:, 0])]
    here = places[:, n]
    room: Array = np.minimum.reduce([*here.T, *(1.0 - here.T), 0.0 * here[:, 0] + FREE])
    if len(others):
        apart = np.hypot(here[:, :1] - others[:, 0], here[:, 1:] - others[:, 1])
        room = np.minimum(room, np.min(apart, axis=1))
    return room


def number_entries(numbered: bool) -> list[Artist]:
    """Return the legend entry of the numbers of branches, if there are any."""
    text = "number of a branch"
    entry = Line2D([], [], linestyle="", marker="$1$", color="k", markersize=5.5, markeredgewidth=0.2, label=text)
    return [entry] * numbered
