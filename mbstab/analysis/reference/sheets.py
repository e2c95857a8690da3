"""Equilibria and steady motions over two parameters: all at once if they are smooth, otherwise row by row.

A path over the second parameter leads to the rows, which are paths over the first one. That path may end where rows go
on at other columns: these are reached from the rows beside them. At every column where a row has a solution and the
one beside it has none, Newton's method tells whether there may be one; a path across, over the second parameter,
tells whether it is of the same family. Such paths also tell, at columns that are asked for, which solutions lie
between two rows.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace

import numpy as np

from mbstab.analysis.algebra.arrays import Flags, Index
from mbstab.analysis.algebra.failures import FAILURES
from mbstab.analysis.reference.continuation import beginnings, follow, follow_row
from mbstab.analysis.reference.curve_points import Point
from mbstab.analysis.reference.equilibrium import Problem
from mbstab.analysis.reference.many_points import newton
from mbstab.analysis.reference.paths import Path, Sheet, Surface, meet
from mbstab.analysis.reference.smooth import SmoothSolutions
from mbstab.analysis.reference.tolerances import TOLERANCES
from mbstab.compiler.system import Array, System
from mbstab.errors import MbstabError
from mbstab.model.parameters import bound, settings_in_si
from mbstab.model.schema import Model
from mbstab.model.values import evaluate


def follow_all(model: Model, parameters: tuple[str, str], x: Array, y: Array) -> Sheet | Surface:
    """Return the solutions over two parameters, all at once if they are smooth.

    Otherwise as paths over the first one, started from a path over the second one. That path is at the value of the
    first one that is nearest to the file's own or, where there is no solution, at an end or in the middle. Rows to
    which it does not lead are reached from those beside them.

    Raises
    ------
    MbstabError
        If there is no solution to start from.
    """
    one, other = parameters
    if surface := _surface(model, {one: x, other: y}):
        return surface
    edge, begin = _edge(model, parameters, x, y)
    rows = _Rows(model, parameters, x, y)
    for j in np.flatnonzero(edge.covers({other: y})).tolist():
        q, c = edge.predicted({other: y[j : j + 1]})
        rows.add(j, begin, (q[0], c[0]))
    rows.spread()
    paths = tuple(tuple(sorted(row, key=lambda path: float(path.values[0]))) for row in rows.paths)
    return Sheet(model.parameters[other], y, paths, edge, (begin, edge.start), x)


def joined_rows(model: Model, parameters: tuple[str, str], sheet: Sheet, places: Iterable[tuple[int, int]]) -> Sheet:
    """Return a sheet with paths from rows to the next ones, at places given by the numbers of rows and columns."""
    across = dict[tuple[int, int], Path | None]()
    for j, k in places:
        value, ends = float(sheet.columns[k]), (float(sheet.values[j]), float(sheet.values[j + 1]))
        near, goal = (sheet.predicted({parameters[0]: sheet.columns[[k]], parameters[1]: np.array([y])}) for y in ends)
        across[j, k] = _across(model, parameters, value, ends, (near[0][0], near[1][0]), (goal[0][0], goal[1][0]))
    return replace(sheet, across=across)


def _across(
    model: Model,
    parameters: tuple[str, str],
    value: float,
    ends: tuple[float, float],
    near: tuple[Array, Array],
    goal: tuple[Array, Array] | None = None,
) -> Path | None:
    """Return the path from a solution of a row to a row beside it, at a value of the first parameter.

    None where it does not lead there, or not to the solution that is its goal.
    """
    one, other = parameters
    with contextlib.suppress(MbstabError):
        at = bound(model, settings_in_si({one: value}))
        path = follow(at, other, min(ends), max(ends), ends[0], near, further=False, wanted=1)
        there = {other: np.array(ends[1:])}
        if path.covers(there)[0]:
            if goal is None:
                return path
            sizes = Problem(System(evaluate(at, {other: ends[1]})), massless=True).finder.sizes
            missed = np.abs(path.predicted(there)[0][0] - goal[0]) / sizes
            return path if np.max(missed, initial=0.0) <= TOLERANCES.path_prediction_error else None
    return None


def _surface(model: Model, axes: Mapping[str, Array]) -> Surface | None:
    """Return the solutions over two parameters around the one nearest to the file's values, if they are smooth."""
    start = {name: beginnings(model, name, float(x[0]), float(x[-1]))[0] for name, x in axes.items()}
    try:
        problem = Problem(System(evaluate(model, start)), massless=True)
        _, search, at, _ = problem.solved(problem.start)
    except MbstabError:
        return None
    ranges = {name: (float(x[0]), float(x[-1])) for name, x in axes.items()}
    wanted = math.prod(map(len, axes.values()))
    return SmoothSolutions(model, search.balance, ranges, start, at.q, at.c).surface(wanted)


def _edge(model: Model, parameters: tuple[str, str], x: Array, y: Array) -> tuple[Path, float]:
    """Return the solutions over the second parameter, and at which value of the first one."""
    one, other = parameters
    failure: MbstabError | None = None
    for value in beginnings(model, one, float(x[0]), float(x[-1])):
        try:
            at = bound(model, settings_in_si({one: value}))
            return follow(at, other, float(y[0]), float(y[-1]), further=False), value
        except MbstabError as error:
            failure = failure or error
    assert failure is not None
    raise failure


class _Rows:
    """The paths of a sheet, row by row.

    Attributes
    ----------
    paths : list of list of Path
        Of each row, over parts of the first parameter that do not meet.
    """

    def __init__(self, model: Model, parameters: tuple[str, str], x: Array, y: Array) -> None:
        self.model, self.parameters, self.x, self.y = model, parameters, x, y
        self.paths: list[list[Path]] = [[] for _ in y]
        self.leads: list[list[list[Point]]] = [[] for _ in y]
        self.tried: dict[int, Flags] = {side: np.zeros((len(y), len(x)), dtype=bool) for side in (-1, 1)}
        """Columns at which a row was left for the one below (−1) or above."""

    def add(self, j: int, start: float, near: tuple[Array, Array]) -> None:
        """Add the path through a solution of a row, unless the row has others over the same part or there is none."""
        one, other = self.parameters
        with contextlib.suppress(MbstabError):
            at = bound(self.model, settings_in_si({other: float(self.y[j])}))
            leads = [x for i in (j - 1, j + 1) if 0 <= i < len(self.y) for x in self.leads[i]]
            beside = next((x for x in leads if x[0].p <= start <= x[-1].p), ())
            path, lead = follow_row(at, one, (float(self.x[0]), float(self.x[-1])), start, near, beside)
            if not any(meet(path, known) for known in self.paths[j]):
                self.paths[j].append(path)
                self.leads[j] += [lead] if lead else []

    def spread(self) -> None:
        """Reach more of the rows from those beside them, as long as some are found."""
        while pairs := list(self._untried()):
            rows, goals, columns = (np.concatenate(part) for part in zip(*pairs, strict=True))
            near = self._solvable(rows, goals, columns)
            for i, j, places in pairs:
                there = places[near[(rows == i[0]) & (goals == j[0])]]
                if not len(there) and not self.paths[j[0]]:
                    there = places  # rows that lie far apart: only the path across can tell
                for group in np.split(there, np.flatnonzero(np.diff(there) > 1) + 1):
                    self._reach(int(i[0]), int(j[0]), group)

    def _untried(self) -> Iterator[tuple[Index, Index, Index]]:
        """Yield a row, one beside it and columns at which only the first one has a solution, each as many times."""
        covered = np.array([self._covered(j) for j in range(len(self.y))])
        for side, tried in self.tried.items():
            for i in range(max(0, -side), len(self.y) - max(0, side)):
                columns = np.flatnonzero(covered[i] & ~covered[i + side] & ~tried[i])
                tried[i, columns] = True
                if len(columns):
                    yield np.full(len(columns), i), np.full(len(columns), i + side), columns

    def _covered(self, j: int) -> Flags:
        """Return at which columns a row has a solution."""
        values = {self.parameters[0]: self.x}
        none = np.zeros(len(self.x), dtype=bool)
        result: Flags = np.logical_or.reduce([none, *(path.covers(values) for path in self.paths[j])])
        return result

    def _solvable(self, rows: Index, goals: Index, columns: Index) -> Flags:
        """Return at which columns Newton's method leads from the solution of a row to one of another row."""
        starts = [self._solution(i, float(self.x[k])) for i, k in zip(rows.tolist(), columns.tolist(), strict=True)]
        q, c = (np.array(part) for part in zip(*starts, strict=True))
        one, other = self.parameters
        here = {one: float(self.x[columns[0]]), other: float(self.y[rows[0]])}
        try:
            balance = Problem(System(evaluate(self.model, here)), massless=True).solved(q[0], c[0])[1].balance
        except MbstabError:
            return np.zeros(len(rows), dtype=bool)

        def solvable(part: Index) -> Flags:
            try:
                near, ends = (q[part], c[part]), (self.y[rows[part]], self.y[goals[part]])
                # Before an edge, where a path turns back, a solution moves as a root of the distance.
                for done in (0.5, 0.75, 1.0):
                    y = ends[0] + done * (ends[1] - ends[0])
                    at = System(evaluate(self.model, {one: self.x[columns[part]], other: y}))
                    with np.errstate(all="ignore"):
                        found, good = newton(balance.over(at), *near)
                    kept = good[:, None]
                    near = np.where(kept, found.q, near[0]), np.where(kept, found.c, near[1])
                return good
            except FAILURES:  # some of them are out of range
                if len(part) == 1:
                    return np.zeros(1, dtype=bool)
                return np.concatenate([solvable(half) for half in np.array_split(part, 2)])

        return solvable(np.arange(len(rows)))

    def _solution(self, j: int, value: float) -> tuple[Array, Array]:
        """Return the solution of a row that covers a value of the first parameter."""
        at = {self.parameters[0]: np.array([value])}
        q, c = next(path for path in self.paths[j] if path.covers(at)[0]).predicted(at)
        return q[0], c[0]

    def _reach(self, i: int, j: int, columns: Index) -> None:
        """Reach a row from one beside it at one of some neighbouring columns."""
        for part in TOLERANCES.columns_across:
            if not len(columns) or np.any(self._covered(j)[columns]):
                return
            value, ends = float(self.x[columns[int(part * len(columns))]]), (float(self.y[i]), float(self.y[j]))
            if path := _across(self.model, self.parameters, value, ends, self._solution(i, value)):
                q, c = path.predicted({self.parameters[1]: self.y[j : j + 1]})
                self.add(j, value, (q[0], c[0]))
