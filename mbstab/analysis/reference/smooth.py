"""Solutions over a whole range of parameters at once, where they depend on them smoothly: as polynomials.

From one solution the nearest corner of the range is reached, and from there those at the Chebyshev points one after
the other, each extrapolated from the last ones on a line of points. They lie on one smooth branch if the coefficients
of the polynomials through them decay (Trefethen 2013, Approximation Theory and Approximation Practice,
chapters 7 and 8), and no other branch crosses or joins it if the determinant of independent equations
keeps its sign. Where this is not so, paths are followed (`mbstab.analysis.reference.continuation`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.polynomial.chebyshev import chebpts2, chebvander

from mbstab.analysis.algebra.arrays import Index
from mbstab.analysis.algebra.failures import FAILURES
from mbstab.analysis.reference.equations import Balance, State
from mbstab.analysis.reference.many_points import all_solved
from mbstab.analysis.reference.paths import Surface
from mbstab.analysis.reference.tolerances import TOLERANCES
from mbstab.compiler.system import Array, System
from mbstab.model.schema import Model
from mbstab.model.values import evaluate

Ranges = Mapping[str, tuple[float, float]]


class SmoothSolutions:
    """The solutions around one of them.

    Parameters
    ----------
    model : Model
    balance : Balance
        The equations of a solution.
    ranges : mapping
        The lowest and the highest value of each parameter (SI).
    start : mapping
        The values of the parameters at that solution.
    q, c : ndarray, shape (n_q,) and (size of the family,)
    """

    def __init__(
        self, model: Model, balance: Balance, ranges: Ranges, start: Mapping[str, float], q: Array, c: Array
    ) -> None:
        self.model, self.balance, self.ranges, self.start, self.q, self.c = model, balance, ranges, start, q, c

    def surface(self, wanted: float = math.inf) -> Surface | None:
        """Return them as polynomials over the ranges; None where they are not known to be smooth.

        Parameters
        ----------
        wanted : float
            Number of solutions that start from the polynomials. For fewer of them than there are points on the next
            finer grid, polynomials are not made more exact than it takes to know that the solutions are smooth.
        """
        dimensions, surface = len(self.ranges), None
        counts, before = [TOLERANCES.smooth_points_first[dimensions - 1]] * dimensions, np.full(dimensions, np.inf)
        while True:
            values = self._points(counts)
            start = self._marched(counts, values) if surface is None else surface.predicted(values)
            at = None if start is None else self._solved(values, *start)
            if at is None:
                return None
            coefficients = _coefficients(np.concatenate([at.q, at.c], axis=1), counts)
            surface = Surface(dict(self.ranges), coefficients, len(self.q))
            scaled = coefficients / np.append(self.balance.sizes, np.full(at.c.shape[1], self.balance.speed))
            left = _remainders(scaled)
            more = left > TOLERANCES.smooth_remainder_enough
            counts = _grown(
                counts, [_factor(np.max(np.abs(scaled)), x) if y else 1 for x, y in zip(left, more, strict=True)]
            )
            if not more.any() or math.prod(counts) > TOLERANCES.smooth_points_most:
                break
            if np.all(left <= TOLERANCES.smooth_remainder) and math.prod(counts) > wanted:
                break
            if np.any(more & (left > TOLERANCES.smooth_decay * before)):
                break  # rounding, or no decay
            before = np.where(more, left, np.inf)
        known = np.all(left <= TOLERANCES.smooth_remainder) and self._passed(surface) and self._regular(at, values)
        return surface if known else None

    def _points(self, counts: list[int]) -> dict[str, Array]:
        """Return the Chebyshev points of the ranges, so many along each parameter."""
        axes = np.meshgrid(*map(chebpts2, counts), indexing="ij")
        return {
            name: np.clip(0.5 * (low + high) + 0.5 * (high - low) * x.ravel(), low, high)
            for x, (name, (low, high)) in zip(axes, self.ranges.items(), strict=True)
        }

    def _marched(self, counts: list[int], values: Mapping[str, Array]) -> tuple[Array, Array] | None:
        """Return coordinates and rates at points near the solutions there; None where steps do not lead to all."""
        places = np.stack([values[name] for name in self.ranges], axis=-1).reshape(*counts, -1)
        start, first = np.array([self.start[name] for name in self.ranges]), np.append(self.q, self.c)
        # In each direction those next to the start come first.
        ends = np.abs(places[(0,) * len(counts)] - start), np.abs(places[(-1,) * len(counts)] - start)
        back = tuple(np.flatnonzero(ends[0] > ends[1]).tolist())
        places, found = np.flip(places, back), np.empty((*counts, len(self.q) + len(self.c)))
        for index in np.ndindex(*counts):
            axis = max((k for k, i in enumerate(index) if i), default=None)
            line = [] if axis is None else [(*index[:axis], i, *index[axis + 1 :]) for i in range(index[axis])]
            known = [(places[x], found[x]) for x in line] or [(start, first)]
            solution = first if np.all(places[index] == start) else self._next(known, places[index])
            if solution is None:
                return None
            found[index] = solution
        flat = np.flip(found, back).reshape(-1, found.shape[-1])
        return flat[:, : len(self.q)], flat[:, len(self.q) :]

    def _next(self, known: list[tuple[Array, Array]], target: Array) -> Array | None:
        """Return the solution at a target, from those before it on a line; None where steps do not lead there."""
        first, ranges = known[0][0], np.array([high - low for low, high in self.ranges.values()])
        place = target
        while True:
            behind = known[-TOLERANCES.smooth_steps_behind :]
            parts = [float(np.linalg.norm((x - first) / ranges)) for x in (*(x for x, _ in behind), place)]
            start = _extrapolated(list(zip(parts[:-1], [x for _, x in behind], strict=True)), parts[-1])
            values = dict(zip(self.ranges, place.tolist(), strict=True))
            at = self._solved(values, start[: len(self.q)], start[len(self.q) :], TOLERANCES.newton_step_on_the_way)
            if at is None:
                if parts[-1] - parts[-2] < TOLERANCES.smooth_least_step:
                    return None
                place = 0.5 * (known[-1][0] + place)
                continue
            known = [*known, (place, np.concatenate([at.q, at.c]))]
            if place is target:
                return known[-1][1]
            place = target

    def _solved(
        self,
        values: Mapping[str, Any],
        q: Array,
        c: Array,
        last: float = TOLERANCES.newton_step_at_many_points,
    ) -> State | None:
        """Return the solutions at points, or at one; None where there is not one for each."""
        try:
            with np.errstate(all="ignore"):
                return all_solved(self._balance(values), q, c, last)
        except FAILURES:
            return None

    def _balance(self, values: Mapping[str, Any]) -> Balance:
        """Return the equations at points, or at one."""
        return self.balance.over(System(evaluate(self.model, values)))

    def _passed(self, surface: Surface) -> bool:
        """Whether the polynomials lead through the first solution."""
        q, c = surface.predicted({name: np.array([x]) for name, x in self.start.items()})
        missed = *((q[0] - self.q) / self.balance.sizes), *((c[0] - self.c) / self.balance.speed)
        return max(map(abs, missed), default=0.0) <= TOLERANCES.path_prediction_error

    def _regular(self, at: State, values: Mapping[str, Array]) -> bool:
        """Whether the determinant of equations that are independent at an end keeps the sign of the first solution."""
        with np.errstate(all="ignore"):
            first = self.balance.jacobian(self.balance.state(self.balance.completed(self.q), self.c))
            G = np.concatenate([first[None], self._balance(values).jacobian(at)])
        columns, end = max(((_independent(x), x) for x in (G[1], G[-1])), key=lambda found: len(found[0]))
        rows = _independent(end[:, columns].T)
        signs, sizes = np.linalg.slogdet(G[:, rows[:, None], columns])
        if not (np.all(np.isfinite(sizes)) and (np.all(signs > 0.0) or np.all(signs < 0.0))):
            return False
        counts = [len(np.unique(x)) for x in values.values()]
        coefficients = _coefficients(np.exp(sizes[1:] - np.max(sizes[1:]))[:, None], counts)
        for k, count in enumerate(counts):
            fine = chebvander(np.linspace(-1.0, 1.0, TOLERANCES.smooth_determinant_points), count - 1)
            coefficients = np.moveaxis(np.tensordot(fine, coefficients, axes=(1, k)), 0, k)
        return bool(np.all(coefficients > 0.0))


def _extrapolated(found: list[tuple[float, Array]], part: float) -> Array:
    """Return the value at a part of the way of the polynomial through values at other parts."""
    weights = [math.prod((part - y) / (x - y) for y, _ in found if y != x) for x, _ in found]
    return np.asarray(np.tensordot(weights, [x for _, x in found], axes=1), dtype=np.float64)


def _independent(matrix: Array) -> Index:
    """Return columns on which the others depend."""
    from scipy.linalg import qr

    R, order = qr(matrix, mode="r", pivoting=True)
    diagonal = np.abs(np.diagonal(R))
    chosen: Index = order[: int(np.sum(diagonal > TOLERANCES.path_singular_value * diagonal[0]))]
    return chosen


def _coefficients(found: Array, counts: list[int]) -> Array:
    """Return the Chebyshev coefficients of polynomials through values at the points, an axis for each parameter."""
    found = found.reshape(*counts, -1)
    for k, count in enumerate(counts):
        inverse = np.linalg.inv(chebvander(chebpts2(count), count - 1))
        found = np.moveaxis(np.tensordot(inverse, found, axes=(1, k)), 0, k)
    return found


def _factor(largest: float, last: float) -> int:
    """Return how many times as many points are enough if coefficients go on decaying as they do: two, four or eight."""
    decay = math.log(largest / max(last, 1e-300)) if largest > last else 0.0
    wanted = -math.log(TOLERANCES.smooth_remainder_enough) / max(decay, 1.0)
    return 2 if wanted <= 2.0 else 4 if wanted <= 4.0 else 8


def _grown(counts: list[int], factors: list[int]) -> list[int]:
    """Return so many times as many points along each parameter, twice as many where these are too many."""
    for most in (8, 4, 2):
        grown = [min(factor, most) * (count - 1) + 1 for count, factor in zip(counts, factors, strict=True)]
        if math.prod(grown) <= TOLERANCES.smooth_points_most:
            break
    return grown


def _remainders(coefficients: Array) -> Array:
    """Return the largest of the last two coefficients along each parameter."""
    return np.array([np.max(np.abs(np.moveaxis(coefficients, k, 0)[-2:])) for k in range(coefficients.ndim - 1)])
