"""Methods that follow a motion, behind one interface, each with its order.

A method is a `Method` in the table `METHODS`: a function that starts a `Stepper` at a state. The next
method is one more entry. Every stepper takes one step at a time and gives dense output over it;
`mbstab.analysis.follow` does the rest: output, change of charts, watch on the rank, work.

Projection: accelerations from the constrained equations at every evaluation (index 1), an
integrator for ordinary differential equations, and after every step positions and speeds moved
onto the constraints (Eich 1993; Hairer and Wanner 1996, section VII.2, where it is shown that
the order of the integrator is kept). The integrators are those of SciPy: DOP853 of order 8, RK45 of
order 5 (Dormand and Prince), Radau IIA of order 5 and the backward differentiation formulas of
orders 1 to 5 with exact derivatives. The methods `alpha` and `radau` stand in
`mbstab.analysis.implicit`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from mbstab.analysis.constrained import Constrained
from mbstab.compiler.system import Array, Dynamics
from mbstab.errors import MbstabError, NumericalError

RELATIVE = 3e-14
"""Relative part of the tolerance of explicit integrators: rounding. The tolerance counts in sizes of the scene."""

HINT = (
    "hint: look for a jump or a kink in a given function of time or a force, for a singular configuration, or for "
    "motions that are much faster than what is asked for (--method radau)"
)


@dataclass(frozen=True)
class Options:
    """What a stepper is asked for.

    Attributes
    ----------
    tol : float
        Local error of a step, relative to the sizes in the scene and to their rates.
    step : float or None
        Fixed step (s); None: chosen by the tolerance.
    first : float or None
        Step to begin with (s).
    rate : float (1/s)
        What a fast change of a coordinate of size 1 is.
    longest : float (s)
        Longest step; given functions of time may rest for a while and then start.
    solver : str
        Integrator of the projection method.
    compiled : bool
        Let `mbstab.analysis.marching` take the steps.
    """

    tol: float
    step: float | None
    first: float | None
    rate: float
    longest: float = math.inf
    solver: str = ""
    compiled: bool = False

    def tolerances(self, sizes: Array) -> Array:
        """Return the errors of a step that are allowed in q and u, shape (2 n_q,)."""
        # With a fixed step the tolerance is out of the way, and the largest step is the step.
        tol = self.tol if self.step is None else 1e6
        return tol * np.concatenate([sizes, sizes * self.rate])


class Stepper(Protocol):
    """A method at work.

    Attributes
    ----------
    t : float (s)
    q, u : ndarray, shape (n_q,)
        The state reached; it satisfies the constraints to the accuracy of the method.
    rejected : int
        Steps that were taken back.
    taken : float
        The last step (s).
    state : Dynamics
        Matrices at the state reached.
    """

    t: float
    q: Array
    u: Array
    rejected: int
    taken: float
    state: Dynamics

    def advance(self) -> None:
        """Take one step, or raise a `NumericalError`."""

    def at(self, t: float) -> tuple[Array, Array]:
        """Return q and u at a time within the last step."""


Start = Callable[[Constrained, float, Array, Array, float, Options], Stepper]


@dataclass(frozen=True)
class Method:
    """One way to follow a motion.

    Attributes
    ----------
    start : callable
        ``start(equations, t, q, u, end, options)`` returns a `Stepper`.
    order : int
        Of the global error in the step.
    power : float
        The global error is proportional to this power of the tolerance of a step: order / (order of the
        error estimate + 1).
    fixed : bool
        Whether steps of fixed size can be asked for.
    compiled : bool
        Whether `mbstab.analysis.marching` can take the steps.
    """

    start: Start
    order: int
    power: float
    fixed: bool = True
    compiled: bool = False


class Projected:
    """An integrator of SciPy for the index-1 equations, with a projection after every step."""

    def __init__(
        self, equations: Constrained, t: float, q: Array, u: Array, end: float, options: Options, implicit: bool
    ) -> None:
        import scipy.integrate

        self.equations, self.n = equations, equations.n
        self.t, self.q, self.u = t, q, u
        self.rejected, self.taken = 0, 0.0
        self._dense: Any = None
        settings: dict[str, Any] = {
            "rtol": max(options.tol, 1e-13) if implicit else RELATIVE,
            "atol": options.tolerances(equations.sizes),
            "first_step": options.step or options.first,
            "max_step": options.step or options.longest,
        }
        if settings["first_step"] is not None:
            settings["first_step"] = min(settings["first_step"], end - t)
        if implicit:
            settings["jac"] = self._jacobian
        self._multistep = options.solver == "BDF"
        make = getattr(scipy.integrate, options.solver)
        self._solver = make(self._slope, t, np.concatenate([q, u]), end, **settings)

    def _slope(self, t: float, y: Array) -> Array:
        q, u = y[: self.n], y[self.n :]
        try:
            a = self.equations.acceleration(t, q, u)
        except (MbstabError, ArithmeticError, np.linalg.LinAlgError):
            # Too far out: the integrator takes a shorter step.
            return np.full(len(y), np.nan)
        return np.concatenate([u, a])

    def _jacobian(self, t: float, y: Array) -> Array:
        n = self.n
        by_q, by_u = self.equations.jacobian(t, y[:n], y[n:])
        return np.block([[np.zeros((n, n)), np.eye(n)], [by_q, by_u]])

    def advance(self) -> None:
        """Take one step and go back onto the constraints."""
        solver = self._solver
        message = solver.step()
        if solver.status == "failed":
            trouble = self.equations.trouble
            raise NumericalError(
                f"the step size has collapsed at t = {solver.t:.9g} s: {(message or '').rstrip('.').lower()}"
                + (f"\n{trouble}" if trouble else f"\n{HINT}")
            )
        self.taken, self.t = solver.t - solver.t_old, float(solver.t)
        reached = solver.y
        q, u, state = self.equations.project(self.t, reached[: self.n], reached[self.n :])
        self.q, self.u, self.state = q, u, state
        if not (np.array_equal(q, reached[: self.n]) and np.array_equal(u, reached[self.n :])):
            moved = np.concatenate([q, u])
            if self._multistep:  # its past is moved along
                solver.D[0] += moved - solver.y
            solver.y = moved
            if not self._multistep:
                a, _ = self.equations.solve(state, -state.F0, state.B)
                solver.f = np.concatenate([u, a])
        self._dense = None

    def at(self, t: float) -> tuple[Array, Array]:
        """Return q and u at a time within the last step, from the integrator's own interpolation."""
        if self._dense is None:
            self._dense = self._solver.dense_output()
        y = self._dense(t)
        return y[: self.n], y[self.n :]


def first_step(equations: Constrained, t: float, q: Array, u: Array, end: float, options: Options) -> float:
    """Return the step (s) with which an explicit integrator of SciPy begins."""
    return float(Projected(equations, t, q, u, end, options, implicit=False)._solver.h_abs)


def explicit(equations: Constrained, t: float, q: Array, u: Array, end: float, options: Options) -> Stepper:
    """Start an explicit integrator of SciPy with projection."""
    return Projected(equations, t, q, u, end, options, implicit=False)


def implicit(equations: Constrained, t: float, q: Array, u: Array, end: float, options: Options) -> Stepper:
    """Start an implicit integrator of SciPy with projection."""
    return Projected(equations, t, q, u, end, options, implicit=True)


def _alpha(equations: Constrained, t: float, q: Array, u: Array, end: float, options: Options) -> Stepper:
    from mbstab.analysis.implicit import GeneralizedAlpha

    return GeneralizedAlpha(equations, t, q, u, end, options)


def _radau(equations: Constrained, t: float, q: Array, u: Array, end: float, options: Options) -> Stepper:
    from mbstab.analysis.implicit import RadauIIA

    return RadauIIA(equations, t, q, u, end, options)


METHODS: dict[str, dict[str, Method]] = {
    "projection": {
        "DOP853": Method(explicit, 8, 1.0, compiled=True),
        "RK45": Method(explicit, 5, 1.0, compiled=True),
        "Radau": Method(implicit, 5, 1.25, fixed=False),
        "BDF": Method(implicit, 5, 0.8, fixed=False),
    },
    "alpha": {"": Method(_alpha, 2, 2.0 / 3.0)},
    "radau": {"": Method(_radau, 5, 1.25)},
}
"""Methods by name, and the solvers of each; the first is the default."""
