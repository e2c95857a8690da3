"""Integrators of SciPy for ordinary differential equations, with projections onto the constraints.

Accelerations come from the constrained equations at every evaluation (index 1), and after every step positions and
speeds are projected onto the constraints (Eich 1993; Hairer and Wanner 1996, section VII.2, who show that the
order of the integrator is preserved).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from mbstab.analysis.simulate.constrained import Constrained
from mbstab.analysis.simulate.steppers.interface import HINT, Options
from mbstab.analysis.simulate.tolerances import TOLERANCES
from mbstab.compiler.system import Array
from mbstab.errors import MbstabError, NumericalError


class Projected:
    """An integrator of SciPy for the index-1 equations, with a projection after every step."""

    def __init__(self, equations: Constrained, t: float, q: Array, u: Array, end: float, options: Options) -> None:
        import scipy.integrate

        implicit = math.isinf(options.method.boundary)
        self.equations, self.n = equations, equations.n
        self.t, self.q, self.u = t, q, u
        self.rejected, self.taken = 0, 0.0
        self._dense: Any = None
        settings: dict[str, Any] = {
            "rtol": max(options.tol, 1e-13) if implicit else TOLERANCES.step_tolerance_relative,
            "atol": options.tolerances(equations.sizes),
            "first_step": options.step or options.first,
            "max_step": options.step or options.longest,
        }
        if settings["first_step"] is not None:
            settings["first_step"] = min(settings["first_step"], end - t)
        if implicit:
            settings["jac"] = self._jacobian
        self._multistep = options.method.solver == "BDF"
        make = getattr(scipy.integrate, options.method.solver)
        self._solver = make(self._slope, t, np.concatenate([q, u]), end, **settings)

    def _slope(self, t: float, y: Array) -> Array:
        q, u, trouble = y[: self.n], y[self.n :], self.equations.trouble
        try:
            a = self.equations.acceleration(t, q, u)
        except (MbstabError, ArithmeticError, np.linalg.LinAlgError):
            if not np.isfinite(y).all():  # caused by an earlier stage
                self.equations.trouble = trouble
            # Too far off: the integrator takes a shorter step.
            return np.full(len(y), np.nan)
        return np.concatenate([u, a])

    def _jacobian(self, t: float, y: Array) -> Array:
        return self.equations.jacobian(t, y[: self.n], y[self.n :])

    def advance(self) -> None:
        """Take one step and project the state onto the constraints."""
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
            if self._multistep:  # its history is moved too
                solver.D[0] += moved - solver.y
            solver.y = moved
            if not self._multistep:
                a, _ = self.equations.solve(state, -state.F0, state.B)
                solver.f = np.concatenate([u, a])
        self._dense = None

    def at(self, t: Any) -> tuple[Array, Array]:
        """Return q and u, shape (…, n_q), at times within the last step, from the integrator's own interpolation."""
        if self._dense is None:
            self._dense = self._solver.dense_output()
        y = self._dense(t).T
        return y[..., : self.n], y[..., self.n :]
