"""The search for an equilibrium or a steady motion: Newton steps, and what is tried where they fail."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from mbstab.analysis.algebra.arrays import least_squares
from mbstab.analysis.algebra.failures import FAILURES
from mbstab.analysis.algebra.tolerances import EPS
from mbstab.analysis.reference.equations import Balance, LinearBalance, State
from mbstab.analysis.reference.imbalance import force_change
from mbstab.analysis.reference.motion import Finder
from mbstab.analysis.reference.refusals import inertias_too_far_apart
from mbstab.analysis.reference.tolerances import TOLERANCES
from mbstab.compiler.system import Array
from mbstab.errors import NumericalError


class Stalled(Exception):
    """A strategy stalled at this state without a solution."""

    def __init__(self, state: State | None) -> None:
        self.state = state


class Search:
    """Newton's method from one start.

    Attributes
    ----------
    iterations : int
        Steps so far, until the residuals were small.
    best : State or None
        The state nearest to balance so far.
    magnified : float
        By how much residuals at the solution are magnified in coordinates and rates.
    """

    def __init__(self, balance: Balance, finder: Finder, start: Array) -> None:
        self.balance, self.finder = balance, finder
        self.system, self.sizes = balance.system, balance.sizes
        balance.use(balance.independent_rows(start))
        self.iterations = 0
        self.best: State | None = None
        self.magnified = 0.0

    def state(self, q: Array, c: Array) -> State:
        """Return a trial state.

        Raises
        ------
        MbstabError, ArithmeticError, ValueError
            If the equations have no value there.
        """
        self.finder.check_chart(q, np.zeros(len(q), dtype=bool))
        found = self.balance.state(q, c)
        if not np.all(np.isfinite(found.residual)):
            raise NumericalError("the equations are not finite")
        return found

    def tried(self, at: State, step: Array) -> State | None:
        """Return the state after a scaled step, or None where the equations have no value."""
        try:
            return self.state(*self.balance.moved(at, step))
        except FAILURES:
            return None

    # --- strategies -------------------------------------------------------------------------------------------------

    def newton(self, at: State) -> State:
        """Return the solution that damped steps lead to."""
        damping, reach, longest, before = 0.0, TOLERANCES.newton_reach, 0.0, math.inf
        if self.best is None:
            self.best = at
        sizes: list[float] = []
        for _ in range(TOLERANCES.newton_steps_onto_constraints):
            # The number of steps that polish a solution depends on the machine, so they are not counted.
            self.iterations += at.size > TOLERANCES.newton_residual_polished
            sizes.append(at.size)
            if (
                len(sizes) > TOLERANCES.newton_steps_to_halve
                and at.size > TOLERANCES.newton_residual_polished
                and at.size > 0.5 * sizes[-1 - TOLERANCES.newton_steps_to_halve]
            ):
                break
            before = longest or math.inf
            G, moving = self.balance.jacobian(at), self.balance.moving
            accepted = None
            while accepted is None:
                linear = None if damping or not np.all(np.isfinite(G)) else LinearBalance(G, self.system.n_q, moving)
                step = newton_step(G, at.residual, moving, damping) if linear is None else linear.step(at.residual)
                longest = float(np.max(np.abs(step[:moving]), initial=0.0))
                bounded = _bounded(step, moving, reach)
                trial = self.tried(at, bounded)
                if trial is not None and trial.size < at.size * (1.0 - 1e-6 * reach / max(longest, reach)):
                    accepted = trial
                    if at.size < TOLERANCES.newton_residual_polished:
                        accepted = self._further(at, step, longest / before, trial)
                    elif bounded is not step:
                        # Balance may be far away: as long as forces are linear, the step may be long.
                        change = G @ bounded
                        off = float(np.linalg.norm(trial.residual - at.residual - change))
                        trusted = TOLERANCES.newton_trusted_nonlinearity * float(np.linalg.norm(change))
                        reach = max(
                            TOLERANCES.newton_reach,
                            reach * min(TOLERANCES.newton_reach_growth, trusted / max(off, 1e-300)),
                        )
                    damping = 0.0 if damping < 1e-6 else damping * 0.1
                elif at.size < TOLERANCES.newton_residual_polished and longest <= TOLERANCES.newton_step_settled:
                    return self._solution(at)
                elif (
                    trial is not None and linear is not None and bounded is step and linear.nearer(step, trial.residual)
                ):
                    accepted = trial
                else:
                    damping = max(4.0 * damping, 1e-4)
                    if damping > 1e8:
                        raise Stalled(at)
            at = accepted
            if self.best is None or at.size < self.best.size:
                self.best = at
        if at.size < TOLERANCES.newton_residual_polished and longest <= TOLERANCES.newton_step_settled:
            return self._solution(at)
        raise Stalled(at)

    def _solution(self, at: State) -> State:
        """Return a state whose residuals do not fall any more, if they are rounding.

        Beside a fold without a solution they have a small minimum, from which a whole step leads far away: residuals
        grow with the square of the step there, and rounding does not.

        Raises
        ------
        Stalled
            If they are not.
        """
        step = self.balance.equations(at).step(at.residual)
        whole, quarter = (self.tried(at, part * step) for part in (1.0, 0.25))
        far = float(np.max(np.abs(step[: self.balance.moving]), initial=0.0)) > TOLERANCES.newton_step_settled
        if far or whole is None or quarter is None:
            raise Stalled(at)
        if whole.size > max(TOLERANCES.rounding_varies * max(at.size, EPS), 8.0 * quarter.size):
            raise Stalled(at)
        return at

    def along_valley(self, at: State) -> State:
        """Return the solution that steps along the floor of a valley with stiff and curved walls lead to.

        Along a step of any length walls that curve away push back more than the forces along the floor, so that
        residuals grow. After each step the stiff forces alone are balanced again, as constraints are in the method of
        the generalized reduced gradient (Abadie and Carpentier 1969, in Fletcher, Optimization).
        """
        at = self._on_floor(at)
        for _ in range(TOLERANCES.newton_steps_onto_constraints):
            self.iterations += 1
            step = self.balance.equations(at).step(at.residual)
            longest = float(np.max(np.abs(step[: self.balance.moving]), initial=0.0))
            if at.size < TOLERANCES.newton_residual_polished and longest <= TOLERANCES.newton_step_settled:
                return self._solution(at)
            part = min(1.0, TOLERANCES.newton_reach / max(longest, 1e-300))
            trial = None
            while trial is None or trial.size > at.size * (1.0 - TOLERANCES.valley_descent * part):
                if part < TOLERANCES.valley_shortest:
                    raise Stalled(at)
                beyond = self.tried(at, part * step)
                trial, part = beyond and self._on_floor(beyond), 0.5 * part
            at = trial
        raise Stalled(at)

    def _on_floor(self, at: State) -> State:
        """Return the state near another at which the stiff forces balance, as far as steps lead there."""
        for _ in range(TOLERANCES.steps_to_floor):
            step = self.balance.equations(at).stiff_step(at.residual)
            trial = None if step is None else self.tried(at, step)
            if trial is None or not trial.size < at.size:
                break
            at = trial
        return at

    def settled(self, at: State) -> State:
        """Return a solution to rounding: steps are taken until they no longer become shorter.

        Where a stiffness is large, residuals are rounding before the position is.
        """
        best, shortest = at, math.inf
        for _ in range(TOLERANCES.newton_steps_onto_constraints):
            equations = self.balance.equations(at)
            step = equations.step(at.residual)
            self.magnified = float(np.max(np.abs(equations.inverse), initial=0.0))
            longest = float(np.max(np.abs(step[: self.balance.moving]), initial=0.0))
            falling, left = at is not best and at.size < 0.5 * best.size, longest / shortest
            if not left < (TOLERANCES.slowest_settling if falling else 0.5):
                return at if at.size < best.size else best
            best, shortest = at, longest
            trial = self.tried(at, step) if longest > TOLERANCES.coordinate_rounding else None
            if trial is None:
                break
            at = self._further(at, step, left, trial) if falling else trial
        return best

    def softened(self, at: State) -> State:
        """Return a state nearer to balance, by steps along motions that `newton` takes for undetermined.

        Near a multiple solution forces hardly change along a motion, but what they change by is no rounding if they
        fall as the steps promise.
        """
        shortest = math.inf
        for _ in range(TOLERANCES.newton_steps_onto_constraints):
            step = self.balance.equations(at, np.finfo(float).tiny).step(at.residual)
            longest = float(np.max(np.abs(step[: self.balance.moving]), initial=0.0))
            trial = self.tried(at, step) if 0.0 < longest < min(shortest, TOLERANCES.newton_step_settled) else None
            if trial is None or not trial.size < 0.5 * at.size:
                break
            at, shortest = self._further(at, step, longest / shortest, trial), longest
        return at

    def _further(self, at: State, step: Array, left: float, trial: State) -> State:
        """Return the state after a step or after several at once, if residuals are much smaller there.

        To an m-fold solution each step leaves the part 1 - 1/m of the way: m steps at once lead there (Schröder 1870,
        Math. Ann. 2).

        Parameters
        ----------
        left : float
            The length of the step over that of the one before.
        trial : State
            That after the step.
        """
        steps = round(1.0 / (1.0 - left)) if left < TOLERANCES.slowest_settling else 1
        beyond = self.tried(at, steps * step) if steps > 1 else None
        return trial if beyond is None or beyond.size > 0.1 * trial.size else beyond

    def relaxed(self, at: State) -> State:
        """Return the solution at which a heavily damped motion comes to rest."""
        open_, moving = self.balance.open, self.balance.moving
        inertia = np.diag(at.M) * self.sizes**2 / self.balance.energy
        inertia = np.maximum(inertia, 1e-6 * np.max(inertia))
        G = self.balance.jacobian(at)
        n = len(open_)
        pace = float(np.max(inertia)) / max(float(np.max(np.abs(G[: self.system.n_q, :n]))), 1e-300)
        near = TOLERANCES.relaxed_residual
        for _ in range(TOLERANCES.relaxation_steps):
            self.iterations += 1
            G = self.balance.jacobian(at)
            G[open_, np.arange(n)] += inertia[open_] / pace
            trial = self.tried(at, _bounded(newton_step(G, at.residual, moving, 0.0), moving, TOLERANCES.newton_reach))
            if trial is None or trial.size > 10.0 * at.size:
                pace *= 0.25
                if pace < 1e-12:
                    break
                continue
            pace = min(pace * min(3.0, at.size / max(trial.size, 1e-300) * 1.3), 1e12)
            at = trial
            if at.size < near:
                try:
                    return self.newton(at)
                except Stalled:
                    near = 0.1 * at.size
        raise Stalled(at)

    def spun_up(self, q: Array, c: Array) -> State:
        """Return the solution reached from rest by raising the given rates."""
        self.balance.ramp, reached, stride = 0.0, 0.0, 0.25
        try:
            at = self.started(q, c)
            for _ in range(TOLERANCES.spin_up_steps):
                self.balance.ramp = min(1.0, reached + stride)
                try:
                    at = self.newton(self.state(at.q, at.c))
                    reached, stride = self.balance.ramp, 1.5 * stride
                except Stalled:
                    stride *= 0.4
                if reached == 1.0:
                    return at
        finally:
            self.balance.ramp = 1.0
        raise Stalled(self.best)

    def started(self, q: Array, c: Array) -> State:
        """Return the solution from a start by the first strategy that finds one."""
        at = self.state(q, c)
        try:
            return self.newton(at)
        except Stalled:
            return self.relaxed(at)

    def solve(self, q: Array, c: Array, allowed: tuple[str, ...]) -> tuple[State, str]:
        """Return a solution and the strategy that led to it.

        Raises
        ------
        Stalled
            If none does.
        """
        self._measure(q, c)
        strategies: list[tuple[str, Callable[[], State]]] = [
            ("Newton", lambda: self.newton(self.state(q, c))),
            ("relaxation", lambda: self.relaxed(self.state(q, c))),
            ("valley", lambda: self.along_valley(self.state(q, c))),
        ]
        if self.balance.known:
            strategies.append(("spin-up", lambda: self.spun_up(q, c)))
        for name, strategy in strategies:
            if name not in allowed:
                continue
            try:
                return self.settled(strategy()), name
            except Stalled:
                pass
            except FAILURES:
                continue
            if name == "Newton" and inertias_too_far_apart(self.system, self.state(q, c).dynamics.M, self.sizes):
                break  # the others follow a motion, of which these inertias leave no digits
        raise Stalled(self.best)

    def _rate_of_states(self, q: Array) -> float:
        """Return how fast first-order states change where everything is off by its size (1/s)."""
        (states, rows), still = self.system.states, np.zeros_like(q)
        if not len(states):
            return 0.0
        _, _, D_q = self.system.linearize(q, still, still, np.zeros(self.system.n_c))
        lengths = np.abs(self.system.dynamics(q, still).J[rows]) @ self.sizes
        rates = np.abs(D_q[rows - self.system.n_h]) @ self.sizes / lengths
        return float(np.max(rates, where=np.isfinite(rates), initial=0.0))

    def _measure(self, q: Array, c: Array) -> None:
        """Set the scales of energy and speed by which residuals are judged."""
        scene = self.system.scene
        gravity = float(np.linalg.norm([float(x) for x in scene.gravity]))
        lengths = self.sizes[self.finder.is_length]
        energy = max(float(body.mass) for body in scene.bodies) * gravity * float(np.max(lengths, initial=0.0))
        full = self.balance.coefficients(c)
        u = self.balance.family.generator(full).field(q)
        speed = max(float(np.max(np.abs(u / self.sizes))), float(np.max(np.abs(full), initial=0.0)))
        speed = speed or self._rate_of_states(q) or 1.0
        a = self.balance.family.generator(full).acceleration(q)
        # Forces, not their slopes, which may have any size near a singular point.
        energy = max(energy, float(np.max(self.system.loads(q, u, a) * self.sizes, initial=0.0)))
        # At an equilibrium whose forces vanish one by one, a small move shows how large they are.
        at = q, u, a, np.zeros(self.system.n_c)
        energy = max(
            energy, TOLERANCES.move_scaling_forces * float(force_change(self.system, at, self.sizes, self.sizes))
        )
        self.balance.measured_by(energy or 1.0, speed, q, u, a)
        self.sizes = self.balance.sizes


def newton_step(G: Array, residual: Array, moving: int, damping: float) -> Array:
    """Return the step of minimum norm, damped in coordinates and rates, not in multipliers; nan if there is none."""
    if damping:
        extra: Array = np.zeros((moving, G.shape[1]))
        extra[:, :moving] = math.sqrt(damping) * np.eye(moving)
        G, residual = np.vstack([G, extra]), np.concatenate([residual, np.zeros(moving)])
    if not (np.all(np.isfinite(G)) and np.all(np.isfinite(residual))):
        return np.full(G.shape[1], np.nan)  # LAPACK would print a message
    return np.asarray(least_squares(G, -residual, rcond=TOLERANCES.newton_left_out), dtype=np.float64)


def _bounded(step: Array, moving: int, reach: float) -> Array:
    """Return a step, shortened where it would move a coordinate or rate further than `reach`."""
    longest = float(np.max(np.abs(step[:moving]), initial=0.0))
    return step * (reach / longest) if longest > reach else step
