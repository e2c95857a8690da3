"""Stability charts: verdicts over two parameters, and the curves where the number of unstable eigenvalues changes.

All points of a grid are computed together. On every edge between two neighbours that differ
the change is located by bisection, all edges at once, and the points found are joined through
the cells of the grid to curves. Where a file asks for equilibria, they are computed over both
parameters at once if they are smooth; otherwise they are followed over the first parameter, starting
from those at its lowest value.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from mbstab.analysis.algebra.arrays import others
from mbstab.analysis.reference.continuation import follow_all
from mbstab.analysis.reference.guesses import idle
from mbstab.analysis.reference.paths import Sheet, Surface
from mbstab.analysis.sweep.batched_spectra import Evaluator, Spectra
from mbstab.analysis.sweep.batched_verdict import RIGHT, WORD, settled
from mbstab.analysis.sweep.batched_verdict import unplaced as unplaced_of
from mbstab.analysis.sweep.blocks import Block, Progress, Task, home_of, merged, patterns_at, tasks
from mbstab.analysis.sweep.jobs import run, stored
from mbstab.analysis.sweep.settings import HERE, SweepSettings
from mbstab.analysis.sweep.tolerances import TOLERANCES
from mbstab.analysis.sweep.tracking import discriminant, product
from mbstab.analysis.verdict.rule import UNDECIDED, WORDS
from mbstab.compiler.system import Array
from mbstab.errors import UsageError
from mbstab.model.parameters import bound, settings_in_si
from mbstab.model.schema import Model
from mbstab.records import dataclass

Edge = tuple[int, int, int]


@dataclass(frozen=True)
class Chart:
    """Stability over two parameters.

    Attributes
    ----------
    parameters : tuple of str
        The one along x, then the one along y.
    x, y : ndarray
        Their values (SI), ascending.
    unstable : ndarray of int, shape (len(y), len(x))
        Number of unstable eigenvalues; −1 where the verdict is open, or there is no answer.
    oscillating : ndarray of int, shape (len(y), len(x))
        How many of them are complex: all where a motion is lost by flutter, none where by divergence.
    boundaries : list of ndarray, shape (k, 2)
        Curves on which the number changes, or on which the equilibria that are followed end.
    problems : dict
        By the number of a point, row by row, why it has no answer.
    words : ndarray of int8, shape (len(y), len(x))
        Numbers of the verdicts among `mbstab.analysis.verdict.rule.WORDS`; `verdicts` has them in words.
    start : tuple of float or None
        The values of both parameters from which equilibria were followed, if a file asks to find them.
    warnings : tuple of str
    """

    parameters: tuple[str, str]
    x: Array
    y: Array
    unstable: npt.NDArray[np.intp]
    oscillating: npt.NDArray[np.intp]
    boundaries: list[Array]
    problems: dict[int, str]
    words: npt.NDArray[np.int8]
    start: tuple[float, float] | None = None
    warnings: tuple[str, ...] = ()

    @property
    def verdicts(self) -> list[list[str]]:
        """The verdict at each point, row by row, one of `mbstab.analysis.verdict.rule.WORDS`."""
        return [[WORDS[word] for word in row] for row in self.words]


def chart(
    model: Model,
    values: Mapping[str, Array],
    progress: Progress = lambda done: None,
    settings: SweepSettings = HERE,
) -> Chart:
    """Return the stability chart of a model over two parameters.

    Parameters
    ----------
    values : mapping
        Two parameters and their values (SI), ascending.
    progress, settings
        As in `mbstab.analysis.sweep.sweep.sweep`.

    Raises
    ------
    UsageError
        If there are not two parameters, or their values do not ascend.
    """
    if len(values) != 2 or any(name in model.settings for name in values):
        raise UsageError("a chart has two parameters, which are not set at the same time")
    (one, x), (other, y) = values.items()
    for name, along in values.items():
        if not np.all(np.diff(along) > 0.0):
            raise UsageError(f"the values of {name} must ascend in a chart")
    points = {one: np.tile(x, len(y)), other: np.repeat(y, len(x))}
    sheet = follow_all(model, (one, other), x, y) if model.reference.find is not None else None
    all_tasks = _rows(model, sheet, one, x) if isinstance(sheet, Sheet) else tasks(model, points, sheet, followed=False)
    with stored(all_tasks, settings) as store:
        blocks = run(all_tasks, store, settings, progress)
        found = _charted(model, (one, other), (x, y), points, sheet, blocks)
    if sheet is None:
        return found
    begin = sheet.start if isinstance(sheet, Sheet) else (float(x[0]), float(y[0]))
    return replace(found, start=begin, warnings=idle(model, dict(zip((one, other), begin, strict=True))))


def _charted(
    model: Model,
    names: tuple[str, str],
    axes: tuple[Array, Array],
    points: Mapping[str, Array],
    sheet: Sheet | Surface | None,
    blocks: list[Block],
) -> Chart:
    """Return the chart of the blocks of its points."""
    (one, other), (x, y) = names, axes
    place, problems = np.arange(len(x) * len(y)), {}
    known = None if isinstance(sheet, Sheet) else patterns_at(model, sheet, home_of(points))
    evaluator = Evaluator(model, sheet, known or ())
    if isinstance(sheet, Sheet):
        place = np.flatnonzero(np.repeat([path is not None for path in sheet.paths], len(x)))
        problems = {int(i): sheet.missing(points, int(i)) for i in others(len(x) * len(y), place)}
    shape = len(y), len(x)
    unstable, growing, oscillating = np.full(shape, -1), np.full(shape, -1), np.zeros(shape, dtype=int)
    words = np.full(shape, WORD[UNDECIDED], dtype=np.int8)
    count = unplaced = 0
    if blocks:
        whole = merged(blocks)
        count, unplaced = whole.values.shape[1], unplaced_of(whole.sides, whole.words, whole.problems)
        unstable.flat[place], words.flat[place] = whole.unstable, whole.words
        complex_right = np.sum((whole.sides == RIGHT) & (whole.values.imag != 0.0), axis=1)
        oscillating.flat[place] = np.minimum(complex_right, np.maximum(whole.unstable, 0))
        growing.flat[place] = settled(whole.sides, whole.words, unplaced)
        problems |= {int(place[i]): text for i, text in whole.problems.items()}
        growing.flat[list(problems)] = -1
    evaluator.learn(points)
    boundaries = _boundaries(evaluator, (one, other), x, y, growing, count, unplaced)
    if isinstance(sheet, Sheet):
        boundaries += _ends(sheet)
    return Chart((one, other), x, y, unstable, oscillating, boundaries, dict(sorted(problems.items())), words)


def _rows(model: Model, sheet: Sheet, parameter: str, x: Array) -> list[Task]:
    """Return the tasks of the paths of a sheet."""
    found = []
    for value, path in zip(sheet.values, sheet.paths, strict=True):
        if path is not None:
            at = bound(model, settings_in_si({sheet.parameter.name: float(value)}))
            found += tasks(at, {parameter: x}, path, False)
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
    evaluator: Evaluator,
    names: tuple[str, str],
    x: Array,
    y: Array,
    unstable: npt.NDArray[np.intp],
    count: int,
    unplaced: int,
) -> list[Array]:
    """Return the curves on which the number of unstable eigenvalues changes."""
    edges: list[Edge] = []
    sides = [(unstable[:, :-1], unstable[:, 1:]), (unstable[:-1], unstable[1:])]
    if isinstance(evaluator.path, Sheet):
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
    kind = _signatures(evaluator.near({names[0]: a[:, 0], names[1]: a[:, 1]}, count), unplaced)
    for _ in range(TOLERANCES.edge_halvings):
        middle = 0.5 * (low + high)
        at = a + middle[:, None] * (b - a)
        found = evaluator.near({names[0]: at[:, 0], names[1]: at[:, 1]}, count)
        counts = settled(found.sides, found.words, unplaced)
        # Near the boundary, where bounds do not decide, the functions that vanish on it do.
        hidden = np.flatnonzero(counts < 0)
        same = counts == first
        same[hidden] = np.all(_signatures(found, unplaced, hidden) == kind[hidden], axis=1)
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    points = a + (0.5 * (low + high))[:, None] * (b - a)
    return _joined(dict(zip(edges, points, strict=True)), *unstable.shape)


def _signatures(found: Spectra, unplaced: int, index: npt.NDArray[np.intp] | None = None) -> npt.NDArray[np.intp]:
    """Return two numbers for each of some points, at least one of which changes at a boundary.

    The number of eigenvalues with computed real parts right of the axis; where the spectrum is symmetric about
    it, the signs of the product of the eigenvalues and of the discriminant of λ², apart from unexplained zeros.
    """
    index = np.arange(len(found.values)) if index is None else index
    result = np.stack([np.sum(found.values[index].real > 0.0, axis=1), np.zeros(len(index), dtype=int)], axis=1)
    for n, i in enumerate(index.tolist()):
        values = found.values[i]
        if found.mirrored[i] and not np.any(np.isnan(values)):
            size = float(np.max(np.abs(values), initial=1e-300))
            others = values[np.argsort(np.abs(values), kind="stable")[unplaced:]]
            result[n] = np.sign(product(values, size, unplaced)), np.sign(discriminant(others, size))
    return result


def _joined(points: dict[Edge, Array], n_y: int, n_x: int) -> list[Array]:
    """Return curves through points on the edges of a grid: those of one cell are neighbours."""
    neighbours: dict[Edge, list[Edge]] = {edge: [] for edge in points}
    for i in range(n_y - 1):
        for j in range(n_x - 1):
            around = [e for e in ((0, i, j), (1, i, j + 1), (0, i + 1, j), (1, i, j)) if e in points]
            pairs = [around[:2], around[2:]] if len(around) == 4 else [around] if len(around) == 2 else []
            if len(around) == 3:
                # Three regions meet: every point is joined to the one nearest to all others.
                middle = min(around, key=lambda e: sum(float(np.sum((points[e] - points[o]) ** 2)) for o in around))
                pairs = [[middle, e] for e in around if e != middle]
            for one, other in pairs:
                neighbours[one].append(other)
                neighbours[other].append(one)
    curves = []
    left = {frozenset((one, other)) for one, others in neighbours.items() for other in others}
    for start in sorted(points, key=lambda e: len(neighbours[e])):
        curve = [start]
        while following := [e for e in neighbours[curve[-1]] if frozenset((curve[-1], e)) in left]:
            left.remove(frozenset((curve[-1], following[0])))
            curve.append(following[0])
        if len(curve) > 1 or not neighbours[start]:
            curves.append(np.array([points[e] for e in curve]))
    return curves
