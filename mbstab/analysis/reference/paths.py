"""Paths of equilibria over a parameter, sheets of them over two, and surfaces where they are smooth."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import field
from enum import StrEnum
from functools import cached_property

import numpy as np

from mbstab.analysis.algebra.arrays import Flags, Index
from mbstab.analysis.reference.tolerances import TOLERANCES
from mbstab.compiler.system import Array
from mbstab.model.schema import Parameter, after_number
from mbstab.records import dataclass

Values = Mapping[str, Array]
"""Parameters that vary, arrays of shape (points,)."""


class PathEnd(StrEnum):
    """Why a path of equilibria is known no further, in the words that follow the place."""

    NONE = "it ends there"
    EQUATIONS = "the equations end there"
    AWAY = "positions or states grow beyond all bounds there"
    TURNS = "it turns back"
    BRANCHES = "it turns back where others branch off"
    AGAIN = f"it turns back after {TOLERANCES.folds_of_path} folds and is not followed further"
    LONG = "it is not followed further: the equations were evaluated too often; a smaller range may lead on"
    UNSURE = "it is not followed further: another path is so near there that the two cannot be told apart"
    HIDDEN = "it is not followed further: positions grow so fast there that a turn cannot be told from rounding"


@dataclass(frozen=True)
class Surface:
    """Solutions over ranges of parameters, as polynomials.

    Attributes
    ----------
    ranges : dict
        The lowest and the highest value of each parameter (SI).
    coefficients : ndarray, shape (k, …, n_q + size of the family)
        Of products of Chebyshev polynomials, an axis for each parameter.
    n_q : int
    """

    ranges: dict[str, tuple[float, float]]
    coefficients: Array
    n_q: int

    def covers(self, values: Values) -> Flags:
        """Return which points lie within the ranges, shape (points,)."""
        parts = [(values[name] >= low) & (values[name] <= high) for name, (low, high) in self.ranges.items()]
        inside: Flags = np.logical_and.reduce(parts)
        return inside

    def missing(self, values: Values, i: int) -> str:
        """Say why there is no solution at a point."""
        outside = [name for name, (low, high) in self.ranges.items() if not low <= float(values[name][i]) <= high]
        return f"no solution is known here: {', '.join(outside)} is beyond the range"

    def predicted(self, values: Values) -> tuple[Array, Array]:
        """Return starting values at points, shapes (points, n_q) and (points, size)."""
        from numpy.polynomial.chebyshev import chebvander

        products = np.ones((len(next(iter(values.values()))), 1))
        for (name, (low, high)), count in zip(self.ranges.items(), self.coefficients.shape, strict=False):
            place = np.clip((2.0 * values[name] - low - high) / ((high - low) or 1.0), -1.0, 1.0)
            products = (products[:, :, None] * chebvander(place, count - 1)[:, None, :]).reshape(len(place), -1)
        found = products @ self.coefficients.reshape(products.shape[1], -1)
        return found[:, : self.n_q], found[:, self.n_q :]


@dataclass(frozen=True)
class Path:
    """Solutions over a parameter, one for each value.

    Attributes
    ----------
    parameter : Parameter
    values : ndarray, shape (k,)
        Values of the parameter (SI), ascending.
    q : ndarray, shape (k, n_q)
    c : ndarray, shape (k, size of the family)
        Rates of the steady motion.
    ends : tuple of (float, PathEnd)
        Values at which the path ends within the range, and why.
    crossings : tuple of float
        Values at which another path crosses.
    start : float
        The value from which it was followed: where the first solution was found, or a fold.
    moved : str
        Why it was not followed from the value requested, or nearest to the file's own one.
    beyond : tuple of Path
        Paths to which it leads through folds: first from its upper end, then from its lower end. Then those that cross
        it or branch off, and what these lead to.
    surface : Surface or None
        The solutions at all values in between, if they are smooth.
    growing : dict
        Names of the coordinates that grow beyond all bounds, by the end at which they do.
    refused : dict
        Why the equations have no value beyond an end, by the end.
    """

    parameter: Parameter
    values: Array
    q: Array
    c: Array
    ends: tuple[tuple[float, PathEnd], ...]
    crossings: tuple[float, ...]
    start: float
    moved: str = ""
    beyond: tuple[Path, ...] = ()
    surface: Surface | None = None
    growing: Mapping[float, tuple[str, ...]] = field(default_factory=dict)
    refused: Mapping[float, str] = field(default_factory=dict)

    def covers(self, values: Values) -> Flags:
        """Return which points lie on the path, shape (points,)."""
        x = values[self.parameter.name]
        lower, upper = float(self.values[0]), float(self.values[-1])
        room = TOLERANCES.equal_solutions * (upper - lower)
        # The fold itself is left out: there an eigenvalue is zero.
        low, high = room * self.ended(0), room * self.ended(-1)
        inside: Flags = (x >= lower + low) & (x <= upper - high)
        return inside

    def ended(self, side: int) -> bool:
        """Whether it ends within the range, below (0) or above (−1)."""
        room = TOLERANCES.equal_solutions * float(self.values[-1] - self.values[0])
        return any(abs(value - float(self.values[side])) <= room for value, _ in self.ends)

    def next_to_ends(self) -> Array:
        """Return values within the path, next to where it ends within the range."""
        lower, upper = float(self.values[0]), float(self.values[-1])
        room = TOLERANCES.turn_neighbourhood * (upper - lower)
        return np.array([end + step for side, end, step in ((0, lower, room), (-1, upper, -room)) if self.ended(side)])

    def missing(self, values: Values, i: int) -> str:
        """Say why there is no solution at a point."""
        value = float(values[self.parameter.name][i])
        end, reason = min(self.ends, key=lambda item: abs(item[0] - value), default=(value, "it does not lead there"))
        unit, names = after_number(self.parameter.unit), self.growing.get(end, ())
        at = f"{self.parameter.name} = {end / self.parameter.factor:.12g}{unit}"
        if end in self.refused:
            return f"the equations end at {at} on this path: {self.refused[end]}"
        if 0 < len(names) <= TOLERANCES.pole_names:
            reason = f"{' and '.join(names)} {'grows' if len(names) == 1 else 'grow'} beyond all bounds there"
        return f"no solution {'at' if value == end else 'beyond'} {at} on this path: {reason}"

    @cached_property
    def _interpolants(self) -> tuple[Array, Callable[[Array], Array], Callable[[Array], Array]]:
        """The arc length of the path at its solutions, and the parameter and (q, c) as functions of it.

        Near a fold, solutions change as the square root of the parameter; over the arc length all are smooth.
        """
        from scipy.interpolate import PchipInterpolator

        solutions = np.hstack([self.q, self.c])
        both = np.column_stack([self.values, solutions])
        ranges = np.ptp(both, axis=0)
        steps = np.linalg.norm(np.diff(both, axis=0) / np.where(ranges > 0.0, ranges, 1.0), axis=1)
        lengths = np.concatenate([[0.0], np.cumsum(steps)])
        return lengths, PchipInterpolator(lengths, self.values), PchipInterpolator(lengths, solutions)

    def predicted(self, values: Values) -> tuple[Array, Array]:
        """Return starting values at points, shapes (points, n_q) and (points, size)."""
        if self.surface is not None:
            return self.surface.predicted(values)
        x = values[self.parameter.name]
        if len(self.values) < 2:
            return np.repeat(self.q, len(x), axis=0), np.repeat(self.c, len(x), axis=0)
        lengths, value, solution = self._interpolants
        k = np.clip(np.searchsorted(self.values, x, side="right") - 1, 0, len(self.values) - 2)
        low, high = lengths[k], lengths[k + 1]
        for _ in range(TOLERANCES.parameter_halvings):
            middle = 0.5 * (low + high)
            above = value(middle) > x
            low, high = np.where(above, low, middle), np.where(above, middle, high)
        found: Array = solution(0.5 * (low + high))
        q, c = found[:, : self.q.shape[1]], found[:, self.q.shape[1] :]
        return q, c


def meet(one: Path, other: Path) -> bool:
    """Return whether two paths lie over a common part of their parameter."""
    return bool(max(one.values[0], other.values[0]) <= min(one.values[-1], other.values[-1]))


@dataclass(frozen=True)
class Sheet:
    """Solutions over two parameters: paths over the first one at values of the second one.

    Attributes
    ----------
    parameter : Parameter
        The second parameter.
    values : ndarray, shape (k,)
        Its values (SI), ascending.
    paths : tuple of tuple of Path
        Those at each value, over ascending parts of the first parameter that do not meet; none where no solution is
        known.
    edge : Path
        The path over the second parameter from which the others start.
    start : tuple of float
        The values of both parameters (SI) from which all were followed.
    columns : ndarray
        Values of the first parameter (SI), ascending.
    across : dict
        At some of them paths over the second parameter, from a row to the next one, by the numbers of row and column;
        None where none leads there. Between rows, solutions are known beside such columns.
    """

    parameter: Parameter
    values: Array
    paths: tuple[tuple[Path, ...], ...]
    edge: Path
    start: tuple[float, float]
    columns: Array = field(default_factory=lambda: np.zeros(0))
    across: Mapping[tuple[int, int], Path | None] = field(default_factory=dict)

    def _rows(self, values: Values) -> tuple[Index, Index, Array]:
        """Return the rows below and above some points, and the part of the way from the one to the other."""
        y = values[self.parameter.name]
        above = np.clip(np.searchsorted(self.values, y), 0, len(self.values) - 1)
        below = np.where(self.values[above] == y, above, np.maximum(above - 1, 0))
        low, high = self.values[below], self.values[above]
        return below, above, (y - low) / np.where(high > low, high - low, 1.0)

    def _beside(self, x: float, row: int) -> int | None:
        """Return the number of the nearest column at which a path leads from a row to the next one."""
        right = int(np.searchsorted(self.columns, x))
        sides = [k for k in (right - 1, right) if (row, k) in self.across]
        sides = [right] if right in sides and self.columns[right] == x else sides
        if any(self.across[row, k] is None for k in sides):
            return None
        return min(sides, key=lambda k: abs(float(self.columns[k]) - x), default=None)

    def _places(self, values: Values, below: Index, above: Index) -> list[tuple[int, int | None]]:
        """Return the rows below points between rows, and the columns beside them; other points have none."""
        x = next(along for name, along in values.items() if name != self.parameter.name)
        rows = zip(below.tolist(), above.tolist(), x.tolist(), strict=True)
        return [(i, None if i == j else self._beside(at, i)) for i, j, at in rows]

    def _paths(self, values: Values, row: Index) -> Iterator[tuple[Path, Index]]:
        """Yield paths of rows with the numbers of the points on them."""
        for j in np.unique(row):
            here = np.flatnonzero(row == j)
            for path in self.paths[j]:
                on = here[path.covers(_chosen(values, here))]
                if len(on):
                    yield path, on

    def covers(self, values: Values) -> Flags:
        """Return which points lie on a path that leads there, or between two that are joined, shape (points,)."""
        below, above, _ = self._rows(values)
        beside = [k is not None for _, k in self._places(values, below, above)]
        result: Flags = np.array(beside, dtype=bool) | (below == above)
        for row in (below, above):
            on_path = np.zeros(len(row), dtype=bool)
            for _, on in self._paths(values, row):
                on_path[on] = True
            result &= on_path
        return result

    def missing(self, values: Values, i: int) -> str:
        """Say why there is no solution at a point."""
        paths = self.paths[int(np.searchsorted(self.values, values[self.parameter.name][i]))]
        if not paths:
            return f"{self.edge.missing(values, i)}; nor is one reached from the rows beside"
        value = float(values[paths[0].parameter.name][i])
        return min(paths, key=lambda path: float(np.min(np.abs(path.values - value)))).missing(values, i)

    def predicted(self, values: Values) -> tuple[Array, Array]:
        """Return starting values at points that are covered."""
        below, above, part = self._rows(values)
        q, c = self._interpolated(values, below, above, part)
        places = self._places(values, below, above)
        for place in sorted({(i, k) for i, k in places if k is not None}):
            # What is between the rows differs from a straight line as it does at the column beside.
            on = np.array([n for n, x in enumerate(places) if x == place])
            at = {name: x if name == self.parameter.name else np.full(len(on), self.columns[place[1]])
                  for name, x in _chosen(values, on).items()}  # fmt: skip
            path = self.across[place]
            assert path is not None
            straight = self._interpolated(at, below[on], above[on], part[on])
            for found, own, line in zip((q, c), path.predicted(at), straight, strict=True):
                found[on] += own - line
        return q, c

    def _interpolated(self, values: Values, below: Index, above: Index, part: Array) -> tuple[Array, Array]:
        """Return the solutions of rows, between them on straight lines from the one to the other."""
        q, c = np.zeros((len(part), self.edge.q.shape[1])), np.zeros((len(part), self.edge.c.shape[1]))
        for row, weight in ((below, 1.0 - part), (above, part)):
            for path, on in self._paths(values, row):
                own = weight[on, None]
                for found, x in zip((q, c), path.predicted(_chosen(values, on)), strict=True):
                    found[on] += own * x
        return q, c


def _chosen(values: Values, index: Index) -> Values:
    return {name: x[index] for name, x in values.items()}
