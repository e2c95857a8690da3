"""Implicit methods for the differential-algebraic equations themselves, with exact derivatives.

Generalized-α (Chung and Hulbert 1993) on the index-3 equations as in Arnold and Brüls (2007),
Multibody Syst. Dyn. 18: with the spectral radius ρ at infinity

    α_m = (2ρ − 1)/(ρ + 1),  α_f = ρ/(ρ + 1),  γ = 1/2 + α_f − α_m,  β = (γ + 1/2)²/4,
    q₁ = q + h u + h²((1/2 − β) w + β w₁),   u₁ = u + h((1 − γ) w + γ w₁),
    (1 − α_m) w₁ + α_m w = (1 − α_f) a₁ + α_f a,

where a₁, ν₁ satisfy M a₁ + F0 + Jᵀν₁ = 0 and C(q₁, t₁) = 0, D(q₁, u₁, t₁) = 0. Order 2. As w belongs to the time
t + (α_m − α_f) h, it starts there, and is moved when the step changes: otherwise the order is lost temporarily.
With variable steps, speeds are projected onto their constraints, and accelerations made consistent, after every step.

Radau IIA with three stages (Hairer and Wanner 1996, section IV.8), order 5 and stiffly accurate,
on the stabilized index-2 form of Gear, Gupta and Leimkuhler (1985),

    q̇ = u + G η,   M u̇ = −F0 − Jᵀν,   C(q, t) = 0,   V(q, u, t) = 0,

in which positions and speeds both satisfy their constraints and η vanishes. G spans the directions of C_qᵀ in the
metric of the masses, at the start of each step.

Both solve with Newton's method; the matrix is made of M, J and the derivatives K, R, V_q of the linearization.
"""

from __future__ import annotations

import math
from contextlib import suppress
from typing import Any

import numpy as np

from mbstab.analysis.algebra.augmented import augmented_matrix
from mbstab.analysis.simulate.constrained import Constrained
from mbstab.analysis.simulate.steppers.interface import HINT, Options
from mbstab.analysis.simulate.tolerances import TOLERANCES
from mbstab.compiler.machine import formulas
from mbstab.compiler.machine.formulas import ALPHA_F, ALPHA_M, RADAU_A, RADAU_C, RADAU_E, RADAU_GAMMA
from mbstab.compiler.system import Array
from mbstab.errors import MbstabError, NumericalError

DIVERGES = "Newton's method does not converge"


def first_step(options: Options, left: float) -> float:
    """Return the step to begin with (s) where a time is left (s)."""
    guess = 0.3 * max(options.tol, 1e-13) ** options.method.exponent / options.rate
    return options.step or options.first or min(guess, 0.1 * left)


def newton_goal(options: Options) -> float:
    """Return the correction that ends Newton's method, in sizes of the scene."""
    if options.step is not None:
        return TOLERANCES.newton_correction_rounding
    return max(TOLERANCES.newton_correction * options.tol, TOLERANCES.newton_correction_rounding)


class _Implicit:
    """Common parts of implicit methods: step control, Newton's convergence test, and quintic interpolation."""

    def __init__(self, equations: Constrained, t: float, q: Array, u: Array, end: float, options: Options) -> None:
        self.equations, self.end, self.options = equations, end, options
        self.t, self.q, self.u = t, q, u
        self.rejected, self.taken = 0, 0.0
        self.begin = t
        a, nu, self.state = equations.accelerations(t, q, u)
        self.a, self.nu = a, nu
        self.h = first_step(options, end - t)
        self._before: Any = None

    def _attempt(self, h: float) -> tuple[Array, Array, float]:
        """Return q and u at t + h, and the error estimate in units of the tolerance."""
        raise NotImplementedError

    def _accepted(self, h: float) -> None:
        """Store the quantities of the new state."""

    def advance(self) -> None:
        fixed = self.options.step is not None
        power, failures = self.options.method.exponent, 0
        while True:
            h, last = formulas.tried(self.h, self.end - self.t, self.options.longest, fixed)
            try:
                q, u, error = self._attempt(h)
                trouble = ""
            except (MbstabError, ArithmeticError, np.linalg.LinAlgError, ValueError) as problem:
                error, trouble = math.inf, str(problem)
            if fixed and trouble:
                raise NumericalError(
                    f"the step of {h:.3g} s fails at t = {self.t:.9g} s: {trouble}\n"
                    "hint: take a shorter one with --step"
                )
            if fixed or error <= 1.0:
                break
            self.rejected += 1
            failures += 1
            self.h = formulas.shortened(h, error, power)
            if self.h < TOLERANCES.step_collapsed * max(self.end - self.begin, abs(self.t)) or failures > 60:
                raise NumericalError(
                    f"the step size has collapsed at t = {self.t:.9g} s: {self.h:.1e} s"
                    + (f"\n{trouble}" if trouble else f"\n{HINT}")
                )
        before = (self.t, self.q, self.u, self.a)
        self.t, self.q, self.u = (self.end if last else self.t + h), q, u
        self._accepted(h)
        self.taken, self._before = h, before
        if not fixed:
            self.h = formulas.lengthened(self.h, h, error, power, failures, last)

    def at(self, t: Any) -> tuple[Array, Array]:
        """Return the quintic polynomial through positions, speeds and accelerations at both ends, and its slope."""
        t0, q0, u0, a0 = self._before
        h = self.t - t0
        return formulas.quintic(np.asarray((t - t0) / h)[..., None], h, q0, u0, a0, self.q, self.u, self.a)

    def _size(self, dq: Array, du: Array) -> float:
        """Return the size of changes of positions and speeds, in sizes of the scene."""
        sizes = self.equations.sizes
        moved = np.max(np.abs(dq / sizes), initial=0.0)
        return float(max(moved, np.max(np.abs(du / sizes), initial=0.0) / self.options.rate))

    def _finished(self, size: float, before: float, h: float) -> bool:
        """Whether Newton's method has converged with a correction of this size, after one of size `before`.

        Raises
        ------
        NumericalError
            If corrections grow.
        """
        found = formulas.newton(
            size, before, h, self.options.rate, newton_goal(self.options), TOLERANCES.newton_correction_stalled
        )
        if found == formulas.DIVERGES:
            raise NumericalError(DIVERGES)
        return found == formulas.CONVERGED


class GeneralizedAlpha(_Implicit):
    """Generalized-α on the index-3 equations, order 2."""

    def __init__(self, equations: Constrained, t: float, q: Array, u: Array, end: float, options: Options) -> None:
        super().__init__(equations, t, q, u, end, options)
        self.ahead = ALPHA_M - ALPHA_F
        self._jerk = self._rate_of_acceleration()
        self._drift = self.ahead * self._jerk  # (w − a)/h
        self._past: tuple[float, Array] | None = None

    def _rate_of_acceleration(self) -> Array:
        """Return the rate of the accelerations at the start from those just before and after it, where there are any.

        It only predicts: at the edge of the domain of a force the step itself tells what is wrong.
        """
        found = []
        for x in (1e-4 / self.options.rate, -1e-4 / self.options.rate):
            with suppress(MbstabError, ArithmeticError, np.linalg.LinAlgError, ValueError):
                q, u = self.q + x * self.u + 0.5 * x * x * self.a, self.u + x * self.a
                found.append((self.equations.accelerations(self.t + x, q, u)[0] - self.a) / x)
        return sum(found, np.zeros(self.equations.n)) / max(len(found), 1)

    def _attempt(self, h: float) -> tuple[Array, Array, float]:
        equations, t = self.equations, self.t + h
        n, n_h, scale, rows = equations.n, equations.n_h, equations.scale, equations.row_scale
        P_h, P = equations.combinations
        c, to_q, to_u = formulas.alpha_factors(h)
        known, q0, u0 = formulas.alpha_known(h, self.q, self.u, self.a, self._drift)
        a, nu = self.a + h * self._jerk, self.nu
        lines: Any = None
        before = math.inf
        r_h = P_h.shape[1]
        for _ in range(TOLERANCES.newton_steps_implicit[self.options.step is not None]):
            q, u = q0 + to_q * a, u0 + to_u * a
            state = equations.evaluate(t, q, u)
            if lines is None:
                K, R, V_q, *_ = equations.derivatives(t, q, u, a, nu)
                J = P.T @ (state.J * scale * rows[:, None])
                A = augmented_matrix((state.M + to_u * R + to_q * K) * scale * scale[:, None], J)
                A[n + r_h :, :n] += (to_q / to_u) * (P.T @ (V_q * scale * rows[:, None]))[r_h:]
                lines = _factored(A)
            balance = (state.M @ a + state.F0 + state.J.T @ nu) * scale
            position = P_h.T @ (state.E[:n_h] * rows[:n_h]) / to_q
            velocity = P[n_h:, r_h:].T @ (state.V[n_h:] * rows[n_h:]) / to_u
            step = lines(-np.concatenate([balance, position, velocity]))
            da = step[:n] * scale
            a, nu = a + da, nu + (P @ step[n:]) * rows
            size = self._size(to_q * da, to_u * da)
            if self._finished(size, before, h):
                break
            before = size
        else:
            raise NumericalError(DIVERGES)
        q, u, w = q0 + to_q * a, u0 + to_u * a, known + c * a
        if self.options.step is None:
            # Variable steps would turn the error of speeds normal to the constraints into jumps of accelerations.
            u, _, state = equations.onto_velocities(t, q, u)
            exact, nu = equations.solve(state)
            w, a = w + exact - a, exact
        self._next = (a, nu, w)
        return q, u, self._error(h, a)

    def _error(self, h: float, a: Array) -> float:
        if self.options.step is not None:
            return 0.0
        change = a - self.a
        in_q = formulas.ALPHA_ERROR * h * h * change
        earlier = h * self._jerk if self._past is None else change * 0.0 + h / self._past[0] * self._past[1]
        in_u = h / 12.0 * (change - earlier)
        return self._size(in_q, in_u) / self.options.tol

    def _accepted(self, h: float) -> None:
        a, nu, w = self._next
        self._past = (h, a - self.a)
        self._jerk = (a - self.a) / h
        self.a, self.nu = a, nu
        self._drift = (w - a) / h
        self.state = self.equations.evaluate(self.t, self.q, self.u)


class RadauIIA(_Implicit):
    """Radau IIA with three stages on the stabilized index-2 form, order 5."""

    def __init__(self, equations: Constrained, t: float, q: Array, u: Array, end: float, options: Options) -> None:
        super().__init__(equations, t, q, u, end, options)
        self._prepare()
        self._stages: tuple[float, Array, Array] | None = None

    def _prepare(self) -> None:
        """Form the scaled derivatives at the start of a step."""
        equations = self.equations
        scale, rows = equations.scale, equations.row_scale[:, None]
        P_h, P = equations.combinations
        K, R, V_q, *_ = equations.derivatives(self.t, self.q, self.u, self.a, self.nu)
        weights = scale * scale[:, None]
        self._M, self._R, self._K = self.state.M * weights, R * weights, K * weights
        J = self.state.J * scale * rows
        self._C, self._J, self._V_q = P_h.T @ J[: equations.n_h], P.T @ J, P.T @ (V_q * scale * rows)
        self._P_h, self._P = P_h, P

    def _matrix(self, h: float) -> Any:
        A, A2, one = RADAU_A, RADAU_A @ RADAU_A, np.eye(3)
        C, J, V_q, G = self._C, self._J, self._V_q, self._C.T
        r, r_h = len(J), len(C)
        top = np.kron(one, self._M) + h * np.kron(A, self._R) + h * h * np.kron(A2, self._K)
        return _factored(
            np.block(
                [
                    [top, np.kron(one, J.T), h * h * np.kron(A, self._K @ G)],
                    [np.kron(A2, C), np.zeros((3 * r_h, 3 * r)), np.kron(A, C @ G)],
                    [np.kron(A, J) + h * np.kron(A2, V_q), np.zeros((3 * r, 3 * r)), h * np.kron(A, V_q @ G)],
                ]
            )
        )

    def _attempt(self, h: float) -> tuple[Array, Array, float]:
        equations, t, n = self.equations, self.t, self.equations.n
        scale, rows, n_h = equations.scale, equations.row_scale, equations.n_h
        r, r_h = len(self._J), len(self._C)
        G = self._C.T * scale[:, None]
        lines = self._matrix(h)
        a, nu = self._predicted(h)
        eta = np.zeros((3, r_h))
        before = math.inf
        for _ in range(TOLERANCES.newton_steps_implicit[self.options.step is not None]):
            speeds, positions = self._unfolded(h, a, h * eta @ G.T)
            balance, place, speed = np.empty((3, n)), np.empty((3, r_h)), np.empty((3, r))
            for i in range(3):
                state = equations.evaluate(t + RADAU_C[i] * h, positions[i], speeds[i])
                balance[i] = (state.M @ a[i] + state.F0 + state.J.T @ nu[i]) * scale
                place[i] = self._P_h.T @ (state.E[:n_h] * rows[:n_h]) / (h * h)
                speed[i] = self._P.T @ (state.V * rows) / h
            step = lines(-np.concatenate([balance.ravel(), place.ravel(), speed.ravel()]))
            da = step[: 3 * n].reshape(3, n) * scale
            dnu = step[3 * n : 3 * (n + r)].reshape(3, r)
            deta = step[3 * (n + r) :].reshape(3, r_h)
            a, nu, eta = a + da, nu + (dnu @ self._P.T) * rows, eta + deta
            du = h * RADAU_A @ da
            dq = h * RADAU_A @ (du + h * deta @ G.T)
            size = self._size(dq, du)
            if self._finished(size, before, h):
                break
            before = size
        else:
            raise NumericalError(DIVERGES)
        speeds, positions = self._unfolded(h, a, h * eta @ G.T)
        self._next = (h, a, nu)
        return positions[2], speeds[2], self._error(h, positions, speeds)

    def _unfolded(self, h: float, a: Array, corrections: Array) -> tuple[Array, Array]:
        """Return speeds and positions of the stages, each of shape (3, n_q)."""
        speeds = self.u + h * RADAU_A @ a
        return speeds, self.q + h * RADAU_A @ (speeds + corrections)

    def _predicted(self, h: float) -> tuple[Array, Array]:
        """Return accelerations and multipliers of the stages, extrapolated from the last step."""
        if self._stages is None:
            return np.tile(self.a, (3, 1)), np.tile(self.nu, (3, 1))
        length, a, nu = self._stages
        weights = np.array([[formulas.weight(RADAU_C, i, j, h, length) for j in range(3)] for i in range(3)])
        return weights @ a, weights @ nu

    def _error(self, h: float, positions: Array, speeds: Array) -> float:
        """Return the difference from an embedded formula of order 3, damped where stiff (section IV.8)."""
        if self.options.step is not None:
            return 0.0
        g, scale, n = RADAU_GAMMA * h, self.equations.scale, self.equations.n
        in_q = (g * self.u + RADAU_GAMMA * RADAU_E @ (positions - self.q)) / scale
        in_u = (g * self.a + RADAU_GAMMA * RADAU_E @ (speeds - self.u)) / scale
        J = self._J
        A = augmented_matrix(self._M + g * self._R + g * g * self._K, J)
        du = np.linalg.solve(A, np.concatenate([self._M @ in_u - g * self._K @ in_q, np.zeros(len(J))]))[:n]
        return self._size((in_q + g * du) * scale, du * scale) / self.options.tol

    def _accepted(self, h: float) -> None:
        length, a, nu = self._next
        self._stages = (length, a, nu)
        self.a, self.nu, self.state = self.equations.accelerations(self.t, self.q, self.u)
        self._prepare()


def _factored(matrix: Array) -> Any:
    """Return a function that solves with a matrix."""
    from scipy.linalg import lu_factor, lu_solve

    factors = lu_factor(matrix, check_finite=True)
    return lambda right: lu_solve(factors, right, check_finite=False)
