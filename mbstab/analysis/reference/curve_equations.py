"""The equations of a curve of solutions over a parameter, and solutions near others: the steps of a continuation."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence

import numpy as np

from mbstab.analysis.algebra.arrays import least_squares
from mbstab.analysis.algebra.failures import FAILURES
from mbstab.analysis.algebra.rank import rank_of
from mbstab.analysis.reference.curve_points import Point, nearest_turn
from mbstab.analysis.reference.equations import LinearBalance
from mbstab.analysis.reference.equilibrium import Problem
from mbstab.analysis.reference.tolerances import TOLERANCES
from mbstab.compiler.system import Array, System
from mbstab.errors import MbstabError, NumericalError
from mbstab.model.schema import Model
from mbstab.model.values import evaluate

Solved = tuple[Array, Array, float, Array]
"""Coordinates, rates and the parameter of a solution, and the derivative of the equations there."""


class CurveEquations:
    """The equations of the solutions around one of them.

    The unknowns are [q; c; p] without what is given, scaled by the size of the scene, its speed and
    the range.

    Attributes
    ----------
    work : list of int
        How many times the equations may still be evaluated; shared with the curves that branch off.
    usual : float
        Least singular value of the equations where they are regular.
    folds, branchings, crossed : list of Point
        What has been found so far.
    """

    def __init__(
        self,
        model: Model,
        parameter: str,
        ends: tuple[float, float],
        start: float,
        near: tuple[Array, Array] | None,
    ) -> None:
        self.model, self.parameter = model, parameter
        self.width = (ends[1] - ends[0]) or 1.0
        self.problem = Problem(System(evaluate(model, {parameter: start})), massless=True)
        system = self.problem.system
        self.work = [max(TOLERANCES.path_evaluations, TOLERANCES.path_evaluated_numbers // (system.n_q + system.n_c))]
        self.low, self.high = (self._last_valid(start, end) for end in ends)
        _, search, at, _ = self.problem.solved(*((self.problem.start,) if near is None else near))
        self.balance = search.balance
        _, G = self._equations(at.q, at.c, start)
        # Beside rows of constraints, of size 1, slopes of forces that vanish are large in units of these forces.
        self.slope = max(1.0, float(np.max(np.abs(G[: system.n_q, : self.balance.moving]), initial=0.0)))
        A = self._along_rows(G)
        s = np.linalg.svd(A, compute_uv=False)
        self.rank = int(np.sum(s > TOLERANCES.path_singular_value * max(float(s[0]), 1e-300))) if len(s) else 0
        # The minimum-norm change with the parameter: it has no component along symmetries.
        by_p = np.append(least_squares(A[:, :-1], -A[:, -1], rcond=TOLERANCES.path_singular_value), 1.0)
        self.first = self._point(at.q, at.c, start, G, by_p, None)
        self.usual = self.first.least  # of a curve that branches off, too, which begins where equations are singular
        self.folds, self.branchings, self.crossed = list[Point](), list[Point](), list[Point]()

    def _last_valid(self, start: float, end: float) -> float:
        """Return the value nearest to an end of the range up to which the model is valid."""

        def valid(value: float) -> bool:
            try:
                evaluate(self.model, {self.parameter: value})
            except MbstabError:
                return False
            return True

        if valid(end):
            return end
        good, bad = start, end
        while good != 0.5 * (good + bad) != bad:
            middle = 0.5 * (good + bad)
            good, bad = (middle, bad) if valid(middle) else (good, middle)
        return good

    def _equations(self, q: Array, c: Array, p: float) -> tuple[Array, Array]:
        """Return the residuals, and their derivative by the scaled unknowns and the multipliers."""
        return next(self._at_points(q[None], c[None], np.array([p])))

    def _at_points(self, q: Array, c: Array, p: Array) -> Iterator[tuple[Array, Array]]:
        """Yield the same for many points, as long as the equations are finite at all of them."""
        step = TOLERANCES.parameter_difference * self.width
        # Central, or at an end of the range or of the solutions one-sided with two points: of second order everywhere.
        inward = np.where(p > self.high - step, -step, step)[:, None] * [1.0, 2.0]
        central = ((self.low + step <= p) & (p <= self.high - step))[:, None]
        size = (q.shape[1] + self.problem.system.n_c) ** 2
        count = max(1, TOLERANCES.entries_at_curve_points // (3 * size))
        for start in range(0, len(p), count):
            part, found = slice(start, start + count), list[tuple[Array, Array]]()
            for sides in (np.where(central, [step, -step], inward), inward, -inward):
                with contextlib.suppress(*FAILURES):
                    found = self._differences(q[part], c[part], p[part], sides[part])
                    break
            if not found:
                raise NumericalError("the equations are not finite")
            yield from found

    def _differences(self, q: Array, c: Array, p: Array, sides: Array) -> list[tuple[Array, Array]]:
        """Return residuals and derivatives at points; those by the parameter from two steps to the sides of each."""
        self.work[0] -= len(p)
        around = np.concatenate([p[:, None], p[:, None] + sides], axis=1)
        system = System(evaluate(self.model, {self.parameter: around.ravel()}))
        balance = self.balance.over(system)
        at = balance.state(balance.completed(np.repeat(q, 3, axis=0)), np.repeat(c, 3, axis=0))
        if not np.all(np.isfinite(at.residual)):
            raise NumericalError("the equations are not finite")
        G, moving, found = balance.jacobian(at)[::3], balance.moving, []
        residuals = at.residual.reshape(len(p), 3, -1)
        for own, derivative, values in zip(around, G, residuals, strict=True):
            (one, two), changes = own[1:] - own[0], values[1:] - values[0]
            by_p = (changes[0] * two / one - changes[1] * one / two) / (two - one) * self.width
            found.append((values[0], np.column_stack([derivative[:, :moving], by_p, derivative[:, moving:]])))
        return found

    def _along_rows(self, G: Array) -> Array:
        """Return the derivative by coordinates, rates and the parameter of what multipliers cannot balance."""
        n = self.problem.system.n_q
        A, forces = np.hsplit(np.vstack([G[:n] / self.slope, G[n:]]), [self.balance.moving + 1])
        if not forces.size:
            return A
        left = rank_of(forces.T / max(float(np.max(np.abs(forces))), 1e-300)).null
        # With the rows themselves: a basis would differ at every solution, and with it the signs of determinants.
        along: Array = left @ (left.T @ A)
        return along

    def _step(self, residual: Array, G: Array, hold: Array) -> Array:
        """Return the change of coordinates, rates and the parameter that takes residuals away, across a direction."""
        across, moving = np.zeros(G.shape[1]), len(hold)
        across[:moving] = hold
        linear = LinearBalance(np.vstack([G, across]), self.problem.system.n_q, moving)
        return linear.step(np.append(residual, 0.0))[:moving]

    def _stepped(self, q: Array, c: Array, p: float, step: Array) -> tuple[Array, Array, float]:
        q, c = self.balance.shifted(q, c, step[:-1])
        return q, c, p + float(step[-1]) * self.width

    def _point(self, q: Array, c: Array, p: float, G: Array, along: Array, before: Point | None) -> Point:
        """Return a solution with the tangent nearest to a direction, aligned with a solution next to it."""
        A = self._along_rows(G)
        left, s, right = np.linalg.svd(A)
        left, right = left[:, self.rank :], right[self.rank :].T
        tangent = right @ (right.T @ along)
        length = float(np.linalg.norm(tangent))
        if not length:
            raise NumericalError("the equations do not say in which direction the solution goes on")
        tangent /= length
        if before is not None:
            left, right = left @ nearest_turn(left.T @ before.left), right @ nearest_turn(right.T @ before.right)
        bordered = np.block([[A, left], [right.T, np.zeros((right.shape[1], left.shape[1]))]])
        sign = float(np.linalg.slogdet(bordered)[0])
        return Point(q, c, p, tangent, left, right, bordered, sign, float(s[self.rank - 1]) if self.rank else 0.0)

    def _corrected(self, start: Point, ahead: Array, hold: Array) -> tuple[Point, float] | None:
        """Return the solution near a step, perpendicular to `hold`, and how far the step missed it."""
        (found,) = self._solved_near([start], [ahead], [hold])
        if found is None:
            return None
        solved, missed = found
        try:
            return self._point(*solved, start.tangent, start), missed
        except FAILURES:
            return None

    def _all_corrected(
        self, starts: Sequence[Point], ahead: Sequence[Array], hold: Sequence[Array]
    ) -> list[Solved | None]:
        """Return the solutions near many steps, perpendicular to `hold`."""
        return [None if found is None else found[0] for found in self._solved_near(starts, ahead, hold)]

    def _solved_near(
        self, starts: Sequence[Point], ahead: Sequence[Array], hold: Sequence[Array]
    ) -> list[tuple[Solved, float] | None]:
        """Return the solutions near many steps, all found at once, and how far the steps missed them."""
        none: list[tuple[Solved, float] | None] = [None] * len(starts)
        first = [self._stepped(x.q, x.c, x.p, step) for x, step in zip(starts, ahead, strict=True)]
        q, c, p = (np.array([x[k] for x in first]) for k in range(3))
        missed, good = np.zeros((len(starts), len(hold[0]))), np.ones(len(starts), dtype=bool)
        try:
            with np.errstate(all="ignore"):
                for _ in range(TOLERANCES.path_newton_steps):
                    steps, residuals = np.zeros_like(missed), np.zeros(len(starts))
                    for k, (residual, G) in enumerate(self._at_points(q, c, p)):
                        if good[k]:
                            steps[k] = self._step(residual, G, hold[k])
                            residuals[k] = np.max(np.abs(residual), initial=0.0)
                    good &= np.max(np.abs(missed + steps), axis=1) < 1.0
                    steps[~good] = 0.0
                    q, c = self.balance.shifted(q, c, steps[:, :-1])
                    p, missed, longest = p + steps[:, -1] * self.width, missed + steps, np.max(np.abs(steps), axis=1)
                    # Where another path crosses, steps become half as long at best.
                    slow = (residuals < TOLERANCES.path_residual_rounding) & (longest < TOLERANCES.path_step_rounding)
                    if np.all(slow | (longest < TOLERANCES.path_last_newton_step)):
                        break
                last = list(self._at_points(q, c, p))
        except FAILURES:
            return none
        settled = slow | (longest < TOLERANCES.path_last_newton_step)
        for k in np.flatnonzero(good & settled).tolist():
            if np.max(np.abs(last[k][0]), initial=0.0) <= TOLERANCES.residual:
                none[k] = (q[k], c[k], float(p[k]), last[k][1]), float(np.max(np.abs(missed[k])))
        return none

    def _between(self, one: Point, other: Point) -> Array:
        """Return the scaled difference of two solutions."""
        q = (other.q - one.q) / self.balance.sizes
        return np.concatenate([q, (other.c - one.c) / self.balance.speed, [(other.p - one.p) / self.width]])

    def _open(self, difference: Array) -> Array:
        """Return a difference of solutions without the entries that are given."""
        n = len(self.balance.sizes)
        wanted = [*self.balance.open, *(n + k for k in self.balance.free), n + self.balance.family.size]
        return difference[np.array(wanted, dtype=np.intp)]
