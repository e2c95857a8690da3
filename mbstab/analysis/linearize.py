"""Linearization of the index-3 equations about a reference motion, and its exact deflation.

    M Δa + R Δu + K Δq + Jᵀ Δν = 0,   C_q Δq = 0,   D_u Δu + D_q Δq = 0

(Pappalardo, Lettieri, Guida 2020, Eqs. (57)-(67)). The deflated system ẏ = S y has exactly
the finite eigenvalues: with N, Z, P of `mbstab.analysis.subspaces` and y = [ξ; η],

    ξ̇ = P ξ + Z η,   M_z η̇ = −Zᵀ[(M_r P² + R_r P + K_r) ξ + (M_r P + R_r) Z η].
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbstab.analysis.motion import ROUNDING, Motion, motion_at
from mbstab.analysis.names import names_in
from mbstab.compiler.system import Array, Row, System
from mbstab.errors import MbstabError

GUARD_TOLERANCE = 1e-8
"""Coefficients that change less than this along the motion, relative to their size, count as constant."""


@dataclass(frozen=True)
class Linearization:
    """Matrices of the linearized equations.

    Attributes
    ----------
    M, R, K : ndarray, shape (n_q, n_q)
        ∂F/∂a, ∂F/∂u, ∂F/∂q; K contains the multiplier terms ∂(Jᵀν)/∂q.
    J : ndarray, shape (n_c, n_q)
        [C_q; D_u].
    D_q : ndarray, shape (n_n, n_q)
    n_h : int
        Number of holonomic rows.
    names : tuple of str
        Coordinates in the order of q.
    rows : tuple of Row
    motion : Motion
    variation : float
        Relative change of the coefficients along the motion; 0 for a reference at rest.
    """

    M: Array
    R: Array
    K: Array
    J: Array
    D_q: Array
    n_h: int
    names: tuple[str, ...]
    rows: tuple[Row, ...]
    motion: Motion
    variation: float

    @property
    def constant(self) -> bool:
        """Whether the coefficients stay what they are along the motion."""
        return self.variation <= GUARD_TOLERANCE

    @property
    def n_f(self) -> int:
        """Number of finite eigenvalues, 2(n_q − rank C_q) − rank(D_u N)."""
        return self.motion.spaces.n_f

    def composite(self) -> tuple[Array, Array, Array]:
        """Return M̄, R̄, K̄ of Eqs. (62)-(67), for [Δq; Δν]."""
        n, c = len(self.M), len(self.J)
        M, R, K = (np.zeros((n + c, n + c)) for _ in range(3))
        M[:n, :n], R[:n, :n], K[:n, :n] = self.M, self.R, self.K
        R[n + self.n_h :, :n] = self.J[self.n_h :]
        K[:n, n:] = self.J.T
        K[n : n + self.n_h, :n] = self.J[: self.n_h]
        K[n + self.n_h :, :n] = self.D_q
        return M, R, K

    def pencil(self) -> tuple[Array, Array]:
        """Return A, E of the regular index-3 pencil A y = s E y with y = [Δq; Δν; Δu], size 2 n_q + n_c."""
        n, c = len(self.M), len(self.J)
        A, E = np.zeros((2 * n + c, 2 * n + c)), np.zeros((2 * n + c, 2 * n + c))
        q, nu, u = slice(0, n), slice(n, n + c), slice(n + c, 2 * n + c)
        E[:n, q] = np.eye(n)
        A[:n, u] = np.eye(n)
        E[n : 2 * n, u] = self.M
        A[n : 2 * n, q], A[n : 2 * n, nu], A[n : 2 * n, u] = -self.K, -self.J.T, -self.R
        A[2 * n : 2 * n + self.n_h, q] = self.J[: self.n_h]
        A[2 * n + self.n_h :, q] = self.D_q
        A[2 * n + self.n_h :, u] = self.J[self.n_h :]
        return A, E

    def paper_pencil(self) -> tuple[Array, Array]:
        """Return V̄, Ū of Eq. (70); singular whenever there are constraints."""
        M, R, K = self.composite()
        zero = np.zeros_like(M)
        return np.block([[-K, zero], [zero, M]]), np.block([[R, M], [M, zero]])


@dataclass(frozen=True)
class StateSpace:
    """The deflated system ẏ = A y with the maps back to coordinates.

    Attributes
    ----------
    A : ndarray, shape (n_f, n_f)
    to_coordinates, to_rates : ndarray, shape (n_q, n_f)
        Δq = to_coordinates @ y, Δu = to_rates @ y.
    n_xi : int
        The first n_xi components of y are positions, the others speeds.
    M_z : ndarray
        Mass matrix of the speeds.
    """

    A: Array
    to_coordinates: Array
    to_rates: Array
    n_xi: int
    M_z: Array


def linearize(system: System, motion: Motion) -> Linearization:
    """Return the linearized equations about a reference motion, and how constant they are along it."""
    matrices = _matrices(system, motion)
    M, R, K, J, D_q = matrices
    return Linearization(
        M,
        R,
        K,
        J,
        D_q,
        system.n_h,
        tuple(system.names),
        tuple(system.rows),
        motion,
        _variation(system, motion, matrices),
    )


def _matrices(system: System, motion: Motion) -> tuple[Array, Array, Array, Array, Array]:
    K, R, D_q = system.linearize(motion.q, motion.u, motion.a, motion.nu, motion.time)
    return motion.dynamics.M, R, K, motion.dynamics.J, D_q


def _variation(system: System, motion: Motion, matrices: tuple[Array, ...]) -> float:
    """Return the largest relative change of the coefficients a little later on the motion."""
    worst = 0.0
    for step in _steps(system, motion, matrices):
        try:
            for later in _continued(system, motion, step):
                worst = max(worst, _change(motion, matrices, _matrices(system, later), step))
        except MbstabError:
            return np.inf
    return worst


def _steps(system: System, motion: Motion, matrices: tuple[Array, ...]) -> list[float]:
    """Return times after which a change would show: small against each rate at which something may change."""
    angular = np.array([name.rpartition(".")[2] not in ("x", "y", "z") for name in system.names])
    rates = [float(np.max(np.abs(motion.u[angular]), initial=0.0))]
    rates.append(float(np.max(np.abs(motion.u[~angular]), initial=0.0)) / motion.length)
    steps = [0.3 / rate for rate in rates if rate > 0.0]
    if any("t" in names_in(item.entry.values) for item in system.scene.items):
        # A given function of time can be fast or slow; what the scene would do by itself says what matters.
        scale = motion.spaces.scale
        _, R, K = (float(np.max(np.abs(x * scale * scale[:, None]), initial=0.0)) for x in matrices[:3])
        rate = max(R, np.sqrt(K)) or 1.0
        steps += [0.3 / rate, 10.0 / rate]
    return steps


def _continued(system: System, motion: Motion, step: float) -> list[Motion]:
    """Return the motion at half a step and a step, each found twice (Runge-Kutta)."""
    stages = [motion]
    for part in (0.5, 0.5, 1.0):
        time, last = part * step, stages[-1]
        stages.append(motion_at(system, motion.q + time * last.u, motion.u + time * last.a, motion.time + time))
    u, a = (sum(w * getattr(stage, x) for w, stage in zip((1, 2, 2, 1), stages, strict=True)) / 6.0 for x in ("u", "a"))
    stages.append(motion_at(system, motion.q + step * u, motion.u + step * a, motion.time + step))
    return stages[1:]


def _change(motion: Motion, now: tuple[Array, ...], then: tuple[Array, ...], step: float) -> float:
    """Return the largest relative change of M, R, K, J, D_q, apart from rounding."""
    scale, rows = motion.spaces.scale, motion.spaces.row_scale
    square, lines = scale * scale[:, None], rows[:, None] * scale
    worst = 0.0
    for x, y, weights, power in zip(
        now, then, (square, square, square, lines, lines[len(lines) - len(now[-1]) :]), (0, 1, 2, 0, 1), strict=True
    ):
        size = float(max(np.max(np.abs(x * weights), initial=0.0), np.max(np.abs(y * weights), initial=0.0)))
        difference = float(np.max(np.abs((y - x) * weights), initial=0.0))
        # In scaled coordinates and rows M and J have the size 1.
        if difference > ROUNDING * step**-power:
            worst = max(worst, difference / size)
    return worst


def state_space(linear: Linearization) -> StateSpace:
    """Return the deflated system; all its eigenvalues are finite, and they are all finite eigenvalues."""
    spaces = linear.motion.spaces
    scale = spaces.scale
    N, Z = spaces.N, spaces.Z
    weights = scale * scale[:, None]
    M_r, R_r, K_r = (N.T @ (x * weights) @ N for x in (linear.M, linear.R, linear.K))
    D_q = linear.D_q * scale * spaces.row_scale[linear.n_h :, None]
    P = -spaces.W.pseudo_inverse @ (D_q @ N)
    M_z = Z.T @ M_r @ Z
    inertia = M_r @ P + R_r
    right = np.hstack([Z.T @ (inertia @ P + K_r), Z.T @ inertia @ Z])
    # Z is orthonormal in mass-scaled coordinates: M_z is as well conditioned as the scene allows.
    lower = -np.linalg.solve(M_z, right) if M_z.size else np.zeros((0, N.shape[1]))
    A = np.vstack([np.hstack([P, Z]), lower])
    n_xi = N.shape[1]
    to_coordinates = scale[:, None] * np.hstack([N, np.zeros((len(scale), Z.shape[1]))])
    to_rates = scale[:, None] * (N @ np.hstack([P, Z]))
    return StateSpace(A, to_coordinates, to_rates, n_xi, M_z)
