"""Stability charts: the number of unstable eigenvalues over two parameters, and the curves where it changes.

All points of a grid are computed together. On every edge between two neighbours that differ
the change is located by bisection, all edges at once, and the points found are joined through
the cells of the grid to curves. Where a file asks for equilibria they are followed over the
first parameter, from those along the least of its values.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from mbstab.analysis.batch import Evaluator
from mbstab.analysis.blocks import Progress, Store, Task, key_of, run, tasks
from mbstab.analysis.continuation import Sheet, follow_all
from mbstab.analysis.spectrum import unstable_counts
from mbstab.compiler.system import Array
from mbstab.errors import UsageError
from mbstab.model.schema import Model

BISECTIONS = 40
"""Halvings of an edge: to 1e-12 of it."""

Edge = tuple[int, int, int]


@dataclass(frozen=True)
class Chart:
    """Stability over two parameters.

    Attributes
    ----------
    parameters : tuple of str
        First the one along x, then the one along y.
    x, y : ndarray
        Their values (SI), ascending.
    unstable : ndarray of int, shape (len(y), len(x))
        Number of unstable eigenvalues; −1 where there is no answer.
    boundaries : list of ndarray, shape (k, 2)
        Curves on which it changes, or on which the equilibria that are followed end.
    problems : dict
        By the number of a point, row by row, why it has no answer.
    """

    parameters: tuple[str, str]
    x: Array
    y: Array
    unstable: npt.NDArray[np.intp]
    boundaries: list[Array]
    problems: dict[int, str]


def chart(
    model: Model,
    values: Mapping[str, Array],
    settings: Mapping[str, float] | None = None,
    progress: Progress = lambda done: None,
    directory: Path | None = None,
    resume: bool = False,
    jobs: int = 1,
    cluster: str = "",
) -> Chart:
    """Return the stability chart of a model over two parameters.

    Parameters
    ----------
    values : mapping
        Two parameters and their values (SI), ascending.
    settings, progress, directory, resume, jobs, cluster
        As in `mbstab.analysis.sweep.sweep`.

    Raises
    ------
    UsageError
        If there are not two parameters, or their values do not ascend.
    """
    settings = dict(settings or {})
    if len(values) != 2 or any(name in settings for name in values):
        raise UsageError("a chart has two parameters, which are not set at the same time")
    (one, x), (other, y) = values.items()
    for name, along in values.items():
        if not np.all(np.diff(along) > 0.0):
            raise UsageError(f"the values of {name} must ascend in a chart")
    points = {one: np.tile(x, len(y)), other: np.repeat(y, len(x))}
    sheet = follow_all(model, (one, other), settings, x, y) if model.reference.find is not None else None
    all_tasks = tasks(model, settings, points) if sheet is None else _rows(model, settings, sheet, one, x)
    store = Store(directory, key_of(all_tasks), resume) if directory is not None else None
    blocks = run(all_tasks, store, jobs, cluster, progress)
    unstable, problems = np.full(len(y) * len(x), -1), {}
    place, start = np.arange(len(unstable)), 0
    evaluator = Evaluator(model, settings, sheet)
    if sheet is not None:
        place = np.flatnonzero(np.repeat([path is not None for path in sheet.paths], len(x)))
        problems = {int(i): sheet.missing(points, int(i)) for i in np.setdiff1d(np.arange(len(unstable)), place)}
    for block in blocks:
        part = place[start : start + len(block.unstable)]
        unstable[part] = block.unstable
        problems |= {int(part[i]): text for i, text in block.problems.items()}
        start += len(part)
    grid = unstable.reshape(len(y), len(x))
    evaluator.learn(points)
    count = max((block.values.shape[1] for block in blocks), default=0)
    boundaries = _boundaries(evaluator, (one, other), x, y, grid, count)
    if sheet is not None:
        boundaries += _ends(sheet)
    if store is not None:
        store.remove()
    return Chart((one, other), x, y, grid, boundaries, dict(sorted(problems.items())))


def _rows(model: Model, settings: Mapping[str, float], sheet: Sheet, parameter: str, x: Array) -> list[Task]:
    """Return the tasks of the paths of a sheet."""
    found = []
    for value, path in zip(sheet.values, sheet.paths, strict=True):
        if path is not None:
            found += tasks(model, {**settings, sheet.parameter.name: float(value)}, {parameter: x}, path)
    return found


def _ends(sheet: Sheet) -> list[Array]:
    """Return the curves on which equilibria end: the folds of neighbouring paths, below and above."""
    curves: list[Array] = []
    for side in (0, -1):
        points: list[tuple[float, float]] = []
        for value, path in zip([*sheet.values, math.nan], [*sheet.paths, None], strict=True):
            end = float(path.values[side]) if path is not None else math.nan
            if path is not None and path.ended(side):
                points.append((end, float(value)))
            elif points:
                curves += [np.array(points)] if len(points) > 1 else []
                points = []
    return curves


def _boundaries(
    evaluator: Evaluator, names: tuple[str, str], x: Array, y: Array, unstable: npt.NDArray[np.intp], count: int
) -> list[Array]:
    """Return the curves on which the number of unstable eigenvalues changes."""
    edges: list[Edge] = []
    sides = [(unstable[:, :-1], unstable[:, 1:]), (unstable[:-1], unstable[1:])]
    if evaluator.path is not None:
        del sides[1]  # between paths that differ nothing is followed
    for axis, (left, right) in enumerate(sides):
        rows, columns = np.nonzero((left != right) & (left >= 0) & (right >= 0))
        edges += [(axis, int(i), int(j)) for i, j in zip(rows, columns, strict=True)]
    if not edges:
        return []
    axis, rows, columns = np.array(edges).T
    a = np.stack([x[columns], y[rows]], axis=1)
    b = np.stack([x[columns + (axis == 0)], y[rows + (axis == 1)]], axis=1)
    first = unstable[rows, columns]
    low, high = np.zeros(len(edges)), np.ones(len(edges))
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        at = a + middle[:, None] * (b - a)
        found = evaluator.near({names[0]: at[:, 0], names[1]: at[:, 1]}, count)
        same = unstable_counts(found.values, found.known) == first
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    points = a + (0.5 * (low + high))[:, None] * (b - a)
    return _joined(dict(zip(edges, points, strict=True)), *unstable.shape)


def _joined(points: dict[Edge, Array], n_y: int, n_x: int) -> list[Array]:
    """Return curves through points on the edges of a grid: those of one cell are neighbours."""
    neighbours: dict[Edge, list[Edge]] = {edge: [] for edge in points}
    for i in range(n_y - 1):
        for j in range(n_x - 1):
            around = [e for e in ((0, i, j), (1, i, j + 1), (0, i + 1, j), (1, i, j)) if e in points]
            pairs = [around[:2], around[2:]] if len(around) == 4 else [around] if len(around) == 2 else []
            if len(around) == 3:
                # Three regions meet: every point is joined to the one nearest to the others.
                middle = min(around, key=lambda e: sum(float(np.sum((points[e] - points[o]) ** 2)) for o in around))
                pairs = [[middle, e] for e in around if e != middle]
            for one, other in pairs:
                neighbours[one].append(other)
                neighbours[other].append(one)
    curves, seen = [], set()
    for start in sorted(points, key=lambda e: len(neighbours[e])):
        if start in seen:
            continue
        curve = [start]
        seen.add(start)
        while True:
            following = [e for e in neighbours[curve[-1]] if e not in seen]
            if not following:
                break
            curve.append(following[0])
            seen.add(following[0])
        if len(curve) > 2 and curve[0] in neighbours[curve[-1]]:
            curve.append(curve[0])
        curves.append(np.array([points[e] for e in curve]))
    return curves
