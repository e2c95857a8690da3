"""Stability charts: verdicts over two parameters, and the curves where the number of unstable eigenvalues changes.

All points of a grid are computed together, and `mbstab.analysis.sweep.boundaries` traces the curves
between them. Where a file asks for equilibria, they are computed over both
parameters at once if they are smooth; otherwise they are followed row by row
(`mbstab.analysis.reference.sheets`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from mbstab.analysis.algebra.arrays import Index, others
from mbstab.analysis.reference.continuation import beginnings
from mbstab.analysis.reference.guesses import idle
from mbstab.analysis.reference.paths import Path, Sheet, Surface, meet
from mbstab.analysis.reference.sheets import follow_all, joined_rows
from mbstab.analysis.sweep.batched_spectra import Evaluator
from mbstab.analysis.sweep.blocks import Block, Progress, home_of, merged, patterns_at, tasks, undecided
from mbstab.analysis.sweep.boundaries import Edge, Grid, changing, counts, traced, untold
from mbstab.analysis.sweep.jobs import run, stored
from mbstab.analysis.sweep.settings import HERE, SweepSettings
from mbstab.analysis.sweep.spectra import WORD, unstable_counts
from mbstab.analysis.sweep.spectra import unplaced as unplaced_of
from mbstab.analysis.verdict.rule import UNDECIDED, WORDS
from mbstab.compiler.system import Array
from mbstab.errors import UsageError, counted
from mbstab.model.schema import Model, after_number
from mbstab.records import Answer, dataclass


@dataclass(frozen=True)
class Chart(Answer):
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
    divisions : list of ndarray, shape (k, 2)
        Curves between divergence and flutter where equally many eigenvalues are unstable on both sides.
    detail : Grid
        The same numbers with more lines where boundaries bend or meet, for a picture.
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
    divisions: list[Array]
    detail: Grid
    problems: dict[int, str]
    words: npt.NDArray[np.int8]
    start: tuple[float, float] | None = None
    warnings: tuple[str, ...] = ()

    @property
    def verdicts(self) -> list[list[str]]:
        """The verdict at each point, row by row, one of `mbstab.analysis.verdict.rule.WORDS`."""
        return [[WORDS[word] for word in row] for row in self.words]

    @property
    def verdicts_of_detail(self) -> npt.NDArray[np.str_]:
        """What is said at each point of `detail` where no eigenvalue is unstable: the verdict at the point next to it.

        Where that has another number, it is the verdict of the most points without an unstable eigenvalue.
        """
        rows, columns = (
            np.argmin(np.abs(along - fine[:, None]), axis=1)
            for along, fine in ((self.y, self.detail.y), (self.x, self.detail.x))
        )
        said = self.words[self.unstable == 0].tolist()
        most = max(set(said), key=said.count, default=WORD[UNDECIDED])
        next_ = np.ix_(rows, columns)
        return np.array(WORDS)[np.where(self.unstable[next_] == 0, self.words[next_], most)]


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
        Two parameters and their values (SI), ascending or descending.
    progress, settings
        As in `mbstab.analysis.sweep.sweep.sweep`.

    Raises
    ------
    UsageError
        If there are not two parameters, or their values are not in order.
    """
    if len(values) != 2 or any(name in model.settings for name in values):
        raise UsageError("a chart has two parameters, which are not set at the same time")
    for name, along in values.items():
        steps = np.diff(along)
        if not (np.all(steps > 0.0) or np.all(steps < 0.0)):
            raise UsageError(f"the values of {name} must ascend or descend")
    (one, x), (other, y) = ((name, np.sort(along)) for name, along in values.items())
    points = {one: np.tile(x, len(y)), other: np.repeat(y, len(x))}
    sheet = follow_all(model, (one, other), x, y) if model.reference.find is not None else None
    place = np.flatnonzero(sheet.covers(points)) if isinstance(sheet, Sheet) else np.arange(len(x) * len(y))
    chosen = {name: along[place] for name, along in points.items()}
    all_tasks = tasks(model, chosen, sheet, followed=False)
    with stored(all_tasks, settings) as store:
        blocks = run(all_tasks, store, settings, progress)
        found = _charted(model, (one, other), (x, y), (points, place), sheet, blocks)
    if sheet is None:
        return replace(found, warnings=idle(model, (one, other), None))
    first, second = (beginnings(model, name, along[0], along[-1])[0] for name, along in ((one, x), (other, y)))
    begin = sheet.start if isinstance(sheet, Sheet) else (first, second)
    warnings = idle(model, (one, other), dict(zip((one, other), begin, strict=True)))
    return replace(found, start=begin, warnings=(*found.warnings, *warnings))


def _charted(
    model: Model,
    names: tuple[str, str],
    axes: tuple[Array, Array],
    asked: tuple[Mapping[str, Array], Index],
    sheet: Sheet | Surface | None,
    blocks: list[Block],
) -> Chart:
    """Return the chart of the blocks of its points, of which `asked` says which are computed."""
    (x, y), (points, place) = axes, asked
    chosen = {name: along[place] for name, along in points.items()}
    evaluator = Evaluator(model, sheet, patterns_at(model, sheet, home_of(chosen)))
    problems = evaluator.missing(points, others(len(x) * len(y), place))
    shape = len(y), len(x)
    unstable = np.full(shape, -1)
    grid = Grid(x, y, np.full(shape, -1), np.full(shape, -2), np.zeros(shape, dtype=int))
    words = np.full(shape, WORD[UNDECIDED], dtype=np.int8)
    count = unplaced = 0
    if blocks:
        whole = merged(blocks)
        count, unplaced = whole.values.shape[1], unplaced_of(whole.sides, whole.words, whole.problems)
        open_ = undecided(whole)
        at = {name: values[place[open_]] for name, values in points.items()}
        judged_words = whole.words.copy()
        judged_words[open_] = evaluator.at_zeros(at, whole.values[open_], whole.sides[open_])
        words.flat[place] = judged_words
        for goal, numbers in zip((grid.unstable, grid.settled, grid.oscillating), counts(whole, unplaced), strict=True):
            goal.flat[place] = numbers
        problems |= {int(place[i]): text for i, text in whole.problems.items()}
        grid.settled.flat[list(problems)] = -2
        # Between the points exact zeros decide nothing: boundaries are followed without them.
        unstable.flat[place] = unstable_counts(whole.sides, judged_words)
    if isinstance(sheet, Sheet):
        between_rows = [(i, j) for axis, i, j in changing(grid) if axis]
        evaluator.path = joined_rows(model, names, sheet, between_rows)
    detail, boundaries, divisions = traced(evaluator, names, grid, count, unplaced)
    if isinstance(sheet, Sheet):
        boundaries += _ends(sheet)
    warnings = _untold(model, names, grid, untold(evaluator, names, grid))
    answer = names, x, y, unstable, grid.oscillating, boundaries, divisions, detail
    return Chart(*answer, dict(sorted(problems.items())), words, warnings=warnings)


def _untold(model: Model, names: tuple[str, str], grid: Grid, edges: Sequence[Edge]) -> tuple[str, ...]:
    """Say that no boundary is drawn between some neighbours although their numbers differ."""
    if not edges:
        return ()
    axis, i, j = edges[0]
    ends = ((grid.x[j], grid.y[i]), (grid.x[j + (axis == 0)], grid.y[i + (axis == 1)]))
    points = [[f"{name} = {_in_unit(model, name, x)}" for name, x in zip(names, end, strict=True)] for end in ends]
    first, second = (", ".join(point) for point in points)
    pairs = counted(len(edges), "pair") + " of neighbouring points"
    return (
        f"no boundary is drawn between {pairs} with different numbers of unstable eigenvalues, the first at {first} "
        f"and {second}: no path of equilibria joins them\n"
        f"hint: mbstab sweep --param {names[axis]} from one of them on shows how its equilibrium goes on",
    )


def _in_unit(model: Model, name: str, value: float) -> str:
    """Return a value of a parameter in its unit."""
    parameter = model.parameters[name]
    return f"{value / parameter.factor:.6g}{after_number(parameter.unit)}"


def _ends(sheet: Sheet) -> list[Array]:
    """Return the curves on which equilibria end: the folds of neighbouring paths, below and above.

    Where one path stands beside several, the end belongs to the outermost of them.
    """
    curves: list[list[tuple[float, float]]] = []
    for side, step in ((0, 1), (-1, -1)):
        before: list[tuple[Path, list[tuple[float, float]]]] = []
        for value, paths in zip([*sheet.values, math.nan], [*sheet.paths, ()], strict=True):
            row, taken = [], set()
            for path in paths[::step]:
                k = next((k for k, (other, _) in enumerate(before) if meet(other, path)), -1)
                known = [] if k in taken or k < 0 else before[k][1]
                taken.add(k)
                if path.ended(side):
                    row.append((path, [*known, (float(path.values[side]), float(value))]))
                else:
                    curves.append(known)
                    row.append((path, []))
            curves += [points for k, (_, points) in enumerate(before) if k not in taken]
            before = row
    return [np.array(points) for points in curves if len(points) > 1]
