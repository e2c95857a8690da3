"""Linearization of the index-3 equations about a reference motion, and its exact deflation.

    M Δa + R Δu + K Δq + Jᵀ Δν = 0,   C_q Δq = 0,   D_u Δu + D_q Δq = 0

(Pappalardo, Lettieri, Guida 2020, Eqs. (57)-(67)). The deflated system ẏ = S y has exactly
the finite eigenvalues: with N, Z, P of `mbstab.analysis.subspaces` and y = [ξ; η],

    ξ̇ = P ξ + Z η,   M_z η̇ = −Zᵀ[(M_r P² + R_r P + K_r) ξ + (M_r P + R_r) Z η].
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbstab.analysis.motion import Motion, motion_at
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
    variation = 0.0 if motion.at_rest else _variation(system, motion, matrices)
    M, R, K, J, D_q = matrices
    return Linearization(M, R, K, J, D_q, system.n_h, tuple(system.names), tuple(system.rows), motion, variation)


def _matrices(system: System, motion: Motion) -> tuple[Array, Array, Array, Array, Array]:
    K, R, D_q = system.linearize(motion.q, motion.u, motion.a, motion.nu, motion.time)
    return motion.dynamics.M, R, K, motion.dynamics.J, D_q


def _variation(system: System, motion: Motion, matrices: tuple[Array, ...]) -> float:
    """Return the largest relative change of the coefficients a little later on the motion.

    The motion is continued with its speeds and accelerations over two steps that are
    small against the fastest turn; what changes by more than the neglected third order
    is not constant.
    """
    scale = motion.spaces.scale
    fastest = float(np.max(np.abs(motion.u / scale))) * float(np.min(scale))
    turning = max((abs(u) for n, u in zip(system.names, motion.u, strict=True) if n[-2:] not in (".x", ".y", ".z")), default=0.0)
    step = 0.3 / max(turning, fastest, 1e-300)
    worst = 0.0
    for time in (step, 0.37 * step):
        q = motion.q + motion.u * time + 0.5 * motion.a * time * time
        u = motion.u + motion.a * time
        try:
            later = _matrices(system, motion_at(system, q, u, motion.time + time))
        except MbstabError:
            return np.inf
        worst = max(worst, *(_change(now, then, scale) for now, then in zip(matrices, later, strict=True)))
    return worst


def _change(now: Array, then: Array, scale: Array) -> float:
    weights = scale * (scale[:, None] if now.shape[0] == len(scale) else 1.0)
    size = float(np.max(np.abs(now * weights), initial=0.0))
    difference = float(np.max(np.abs((then - now) * weights), initial=0.0))
    return difference / size if size else difference


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
