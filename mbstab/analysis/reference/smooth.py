"""Solutions over a whole range of parameters at once, where they depend on them smoothly: as polynomials.

From one solution those at the Chebyshev points of the range are reached together, in steps along
straight lines. They lie on one smooth branch if the coefficients of the polynomials through them
decay (Trefethen 2013, Approximation Theory and Approximation Practice, chapters 7 and 8), and no
other branch crosses or joins it if the determinant of independent equations keeps its sign.
Where this is not so, paths are followed (`mbstab.analysis.reference.continuation`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping

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
        The values of the parameters at that solution: ends of the ranges.
    q, c : ndarray, shape (n_q,) and (size of the family,)
    """

    def __init__(
        self, model: Model, balance: Balance, ranges: Ranges, start: Mapping[str, float], q: Array, c: Array
    ) -> None:
        self.model, self.balance, self.ranges, self.start, self.q, self.c = model, balance, ranges, start, q, c

    def surface(self) -> Surface | None:
        """Return them as polynomials over the ranges; None where they are not known to be smooth."""
        dimensions, surface = len(self.ranges), None
        counts, before = [TOLERANCES.smooth_points_first[dimensions - 1]] * dimensions, np.full(dimensions, np.inf)
        while True:
            values = self._points(counts)
            at = self._marched(values) if surface is None else self._solved(values, 1.0, *surface.predicted(values))
            if at is None:
                return None
            coefficients = _coefficients(np.concatenate([at.q, at.c], axis=1), counts)
            surface = Surface(dict(self.ranges), coefficients, len(self.q))
            left = _remainders(coefficients / np.append(self.balance.sizes, np.full(at.c.shape[1], self.balance.speed)))
            more = left > TOLERANCES.smooth_remainder_enough
            counts = [2 * count - 1 if x else count for count, x in zip(counts, more, strict=True)]
            if not more.any() or math.prod(counts) > TOLERANCES.smooth_points_most:
                break
            if np.any(more & (left > TOLERANCES.smooth_decay * before)):
                break  # rounding, or no decay
            before = np.where(more, left, np.inf)
        return surface if np.all(left <= TOLERANCES.smooth_remainder) and self._regular(at, values) else None

    def _points(self, counts: list[int]) -> dict[str, Array]:
        """Return the Chebyshev points of the ranges, so many along each parameter."""
        axes = np.meshgrid(*map(chebpts2, counts), indexing="ij")
        return {
            name: np.clip(0.5 * (low + high) + 0.5 * (high - low) * x.ravel(), low, high)
            for x, (name, (low, high)) in zip(axes, self.ranges.items(), strict=True)
        }

    def _marched(self, values: Mapping[str, Array]) -> State | None:
        """Return the solutions at points, reached in steps; None where these do not lead to all of them."""
        points = len(next(iter(values.values())))
        sizes = np.append(self.balance.sizes, np.full(len(self.c), self.balance.speed))
        found = [(0.0, np.tile(np.append(self.q, self.c), (points, 1)))]
        step = TOLERANCES.smooth_first_step
        while True:
            step = min(step, 1.0 - found[-1][0])
            part = 1.0 if (last := found[-1][0] + step >= 1.0) else found[-1][0] + step
            start = _extrapolated(found, part)
            at = self._solved(values, part, start[:, : len(self.q)], start[:, len(self.q) :], last)
            if at is not None and last:
                return at
            if at is None:
                step *= 0.5
                if step < TOLERANCES.smooth_least_step:
                    return None
                continue
            found = [*found[1 - TOLERANCES.smooth_steps_behind :], (part, np.concatenate([at.q, at.c], axis=1))]
            if np.max(np.abs(found[-1][1] - start) / sizes) <= TOLERANCES.smooth_near_start:
                step *= 2.0

    def _solved(
        self, values: Mapping[str, Array], part: float, q: Array, c: Array, polished: bool = True
    ) -> State | None:
        """Return the solutions a part of the way to points; None where there is not one for each."""
        last = TOLERANCES.newton_step_at_many_points if polished else TOLERANCES.newton_step_on_the_way
        try:
            with np.errstate(all="ignore"):
                return all_solved(self._balance(values, part), q, c, last)
        except FAILURES:
            return None

    def _balance(self, values: Mapping[str, Array], part: float = 1.0) -> Balance:
        """Return the equations at points, or a part of the way to them."""
        there = {name: x + (1.0 - part) * (self.start[name] - x) for name, x in values.items()}
        return self.balance.over(System(evaluate(self.model, there)))

    def _regular(self, at: State, values: Mapping[str, Array]) -> bool:
        """Whether the determinant of equations that are independent at the first solution keeps its sign."""
        with np.errstate(all="ignore"):
            G = self._balance(values).jacobian(at)
        first = int(np.argmin(sum(np.abs(x - self.start[name]) for name, x in values.items())))
        columns = _independent(G[first])
        rows = _independent(G[first][:, columns].T)
        signs, sizes = np.linalg.slogdet(G[:, rows[:, None], columns])
        if not (np.all(np.isfinite(sizes)) and (np.all(signs > 0.0) or np.all(signs < 0.0))):
            return False
        counts = [len(np.unique(x)) for x in values.values()]
        coefficients = _coefficients(np.exp(sizes - np.max(sizes))[:, None], counts)
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


def _remainders(coefficients: Array) -> Array:
    """Return the largest of the last two coefficients along each parameter."""
    return np.array([np.max(np.abs(np.moveaxis(coefficients, k, 0)[-2:])) for k in range(coefficients.ndim - 1)])
