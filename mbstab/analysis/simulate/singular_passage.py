"""A motion through a singular configuration, along its smooth continuation.

Where constraints lose rank at an instant, accelerations and multipliers are the solution of a singular system, and
a step that ends or has a stage there has no order. But the positions of a motion that continues smoothly are smooth.
So the singular configuration is crossed in one step, from a state before it to one beyond it, where nothing
is singular: accelerations are a polynomial of degree 19 in time, and at the 20 Gauss nodes, none of which is
at the singular instant, they equal those of the constrained equations at the positions and speeds that
follow by integration, projected onto the constraints. These collocation equations are solved by Picard
iteration (Hairer, Nørsett, Wanner 1993, section II.7), which converges because the interval is short
compared with the motion. The decay of the coefficients of the polynomial gives the error.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.polynomial import legendre

from mbstab.analysis.simulate.constrained import Constrained, Watch
from mbstab.analysis.simulate.tolerances import TOLERANCES
from mbstab.compiler.system import Array, Dynamics
from mbstab.errors import MbstabError

NODES = 20
"""An even number, so that no node lies in the middle."""

POINTS, WEIGHTS = legendre.leggauss(NODES)


class Passage:
    """A step across a singular configuration, as a `Stepper` that has taken it.

    Attributes
    ----------
    start, t : float
        First and last time (s).
    q, u : ndarray, shape (n_q,)
        The state at the end.
    taken : float (s)
    rejected : int
    state : Dynamics
        Matrices at the end.
    singular : float
        Time at which the constraints lose rank (s); nan if they do not.
    owners : str
        The rows that depend on each other there.
    """

    rejected = 0

    def __init__(self, equations: Constrained, start: float, end: float, coefficients: tuple[Array, Array, Array]):
        self.equations = equations
        self.start, self.t, self.taken = start, end, end - start
        self._q, self._u, self._a = coefficients
        self.singular, self.owners = math.nan, ""
        self.q, self.u, self.state = equations.project(end, *self.at(end))

    def advance(self) -> None:
        """Do nothing: the step is already taken."""

    def _x(self, t: Any) -> Any:
        return 2.0 * (t - self.start) / self.taken - 1.0

    def at(self, t: Any) -> tuple[Array, Array]:
        """Return q and u, shape (…, n_q), at times within the step."""
        x = self._x(t)
        return legendre.legval(x, self._q).T, legendre.legval(x, self._u).T

    def acceleration(self, t: Any) -> Array:
        """Return the accelerations, shape (…, n_q), at times within the step."""
        return np.asarray(legendre.legval(self._x(t), self._a).T)

    def work(self, times: Array, power: Any) -> tuple[Array, float]:
        """Return the work since the start at times within the step, and in all of it (J).

        ``power(t, q, u, a)`` is evaluated at the nodes, for all at once.
        """
        nodes = self.start + 0.5 * self.taken * (1.0 + POINTS)
        series = _integral(
            _fitted(power(nodes, *self.at(nodes), self.acceleration(nodes))), np.zeros(()), 0.5 * self.taken
        )
        return np.asarray(legendre.legval(self._x(times), series)), float(legendre.legval(1.0, series))

    def locate(self, watch: Watch) -> bool:
        """Find when the constraints lose rank; return whether the smallest singular value changes its sign.

        Parameters
        ----------
        watch : Watch
            The least singular value at the start.
        """
        from scipy.optimize import minimize_scalar

        equations = self.equations
        if not equations.signed(watch, self.state) < 0.0:
            return False
        found = minimize_scalar(
            lambda t: equations.smallness(self._state(t)),
            bounds=(self.start + 0.3 * self.taken, self.t - 0.3 * self.taken),
            method="bounded",
            options={"xatol": 1e-12 * self.taken},
        )
        self.singular = float(found.x)
        self.owners = equations.owners(watch.left)
        return bool(found.fun < 1e-2 * TOLERANCES.passage_node_singular_value)

    def _state(self, t: float) -> Dynamics:
        return self.equations.evaluate(t, *self.at(t))


def predicted(equations: Constrained, t: float, q: Array, u: Array, watch: Watch, horizon: float) -> float:
    """Return the approximate time at which the smallest singular value vanishes at constant accelerations, or nan.

    Parameters
    ----------
    t, q, u
        The state now; `watch` is its least singular value.
    horizon : float (s)
        Length of the prediction.
    """
    from scipy.optimize import brentq

    a = equations.accelerations(t, q, u)[0]

    def value(later: float) -> float:
        return equations.signed(watch, equations.evaluate(t + later, q + later * (u + 0.5 * later * a), u + later * a))

    before = 0.0
    for later in np.linspace(0.0, horizon, TOLERANCES.passage_times_ahead + 1)[1:].tolist():
        if value(later) < 0.0:
            return t + float(brentq(value, before, later, xtol=1e-6 * horizon))
        before = later
    return math.nan


def passage(
    equations: Constrained, watch: Watch, start: float, singular: float, last: float, q: Array, u: Array, allowed: float
) -> Passage | None:
    """Return the step from a state to equally far beyond a singular configuration, or None if no motion is found.

    Parameters
    ----------
    watch : Watch
        The least singular value at the state.
    start, singular, last : float (s)
        The present time, the approximate time of the singular configuration, and the end of the simulation.
    q, u : ndarray, shape (n_q,)
        A state that satisfies the constraints, away from the singular configuration.
    allowed : float
        Allowed error, in sizes of the scene and in the rates that count as fast.
    """
    try:
        for _ in range(TOLERANCES.passage_centerings):
            end = min(2.0 * singular - start, last)
            if not start < singular < end:
                return None
            found = _collocated(equations, watch, start, end, q, u, allowed)
            if not isinstance(found, float):
                return found
            singular = found
    except (MbstabError, ArithmeticError, np.linalg.LinAlgError):
        pass
    return None


def _collocated(
    equations: Constrained, watch: Watch, start: float, end: float, q: Array, u: Array, allowed: float
) -> Passage | float | None:
    """Return the step, or None if it does not converge, or the time of the singular configuration if a node is near."""
    half, sizes = 0.5 * (end - start), equations.sizes
    times = start + half * (1.0 + POINTS)
    a = np.tile(equations.accelerations(start, q, u)[0], (NODES, 1))
    at = np.full((2, *a.shape), np.inf)
    before = math.inf
    for _ in range(TOLERANCES.passage_iterations):
        speeds = _integral(_fitted(a), u, half)
        places = _integral(speeds, q, half)
        ways = zip(times.tolist(), legendre.legval(POINTS, places).T, legendre.legval(POINTS, speeds).T, strict=True)
        states = [equations.nearer(*way) for way in ways]
        last, at = at, np.array([[x[k] for x in states] for k in (0, 1)])
        a = np.array([equations.solve(state)[0] for *_, state in states])
        moved = np.max(np.abs(at - last) / sizes, axis=(1, 2))
        change = float(max(moved[0], moved[1] * half))
        if (
            change < TOLERANCES.passage_correction_placed <= before
            or change <= TOLERANCES.passage_correction_rounding
            or change > 0.5 * before
        ):
            values = np.array([math.copysign(equations.smallness(x), equations.signed(watch, x)) for *_, x in states])
            k = int(np.argmax(values < 0.0))
            if k == 0 or np.any(values[k:] > 0.0):
                return None
            # It is nearly linear near its zero.
            zero = float(times[k - 1] + (times[k] - times[k - 1]) * values[k - 1] / (values[k - 1] - values[k]))
            if abs(zero - start - half) > TOLERANCES.passage_off_center * half:
                return zero
            # Normal to the constraints, speeds have the rounding of positions divided twice by the singular value.
            clear = float(np.min(np.abs(values)))
            noise = min(TOLERANCES.passage_correction_rounding / clear**2, TOLERANCES.passage_correction_stalled)
            if change <= TOLERANCES.passage_correction_rounding or (
                clear >= TOLERANCES.passage_node_singular_value and change <= noise
            ):
                break
        if before < math.inf and not change < 2.0 * before:
            return None
        before = change
    else:
        return None
    speeds = _fitted(at[1])
    tail = float(np.max(np.abs(speeds[-2:]) / sizes)) * half
    if not tail <= max(TOLERANCES.passage_tail * allowed, noise):
        return None
    return Passage(equations, start, end, (_integral(speeds, q, half), speeds, _fitted(a)))


def _fitted(values: Array) -> Array:
    """Return the coefficients, shape (NODES, …), of the polynomial with these values at the nodes."""
    basis = legendre.legvander(POINTS, NODES - 1) * WEIGHTS[:, None] * (np.arange(NODES) + 0.5)
    return np.asarray(np.tensordot(basis.T, values, 1))


def _integral(slopes: Array, first: Array, half: float) -> Array:
    """Return the coefficients of the integral that begins with `first`."""
    found = half * legendre.legint(slopes, lbnd=-1)
    found[0] += first
    return np.asarray(found)
