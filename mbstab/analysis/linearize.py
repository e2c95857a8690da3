"""Linearization of the index-3 equations about a reference motion, and its exact deflation.

    M Δa + R Δu + K Δq + Jᵀ Δν = 0,   C_q Δq = 0,   D_u Δu + D_q Δq = 0

(Pappalardo, Lettieri, Guida 2020, Eqs. (57)-(67)). The deflated system ẏ = S y has exactly
the finite eigenvalues: with N, Z, P of `mbstab.analysis.subspaces` and y = [ξ; η],

    ξ̇ = P ξ + Z η,   M_z η̇ = −Zᵀ[(M_r P² + R_r P + K_r) ξ + (M_r P + R_r) Z η].
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mbstab.analysis.motion import ROUNDING, Motion, motion_at, unbalance
from mbstab.analysis.names import names_in
from mbstab.analysis.subspaces import Subspaces, rank_of
from mbstab.compiler.system import Array, Row, System
from mbstab.errors import MbstabError
from mbstab.model.schema import is_length

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
    variation = _variation(system, motion, matrices)
    return Linearization(*matrices, system.n_h, tuple(system.names), tuple(system.rows), motion, variation)


class _Matrices(NamedTuple):
    """Coefficients of the linearized equations."""

    M: Array
    R: Array
    K: Array
    J: Array
    D_q: Array


def _matrices(system: System, motion: Motion) -> _Matrices:
    K, R, D_q = system.linearize(motion.q, motion.u, motion.a, motion.nu, motion.time)
    return _Matrices(motion.dynamics.M, R, K, motion.dynamics.J, D_q)


def _variation(system: System, motion: Motion, matrices: _Matrices) -> float:
    """Return the largest relative change of the coefficients a little later on the motion."""
    worst = 0.0
    try:
        for later in [*_moved(system, motion), *_continued(system, motion, matrices)]:
            worst = max(worst, _change(system, motion, matrices, _matrices(system, later), later.time - motion.time))
    except MbstabError:
        return np.inf
    return worst


def _moved(system: System, motion: Motion) -> Iterator[Motion]:
    """Yield the motion some way along its speeds: after a turn that shows, and after a shift that shows."""
    u, a = motion.u, motion.a
    if np.max(np.abs((motion.dynamics.M @ a) * motion.spaces.scale)) <= unbalance(system, motion):
        a = 0.0 * a  # steady: rounding must not add up
    angular = np.array([not is_length(name) for name in system.names])
    for kind in (angular, ~angular):
        rate = float(np.max(np.abs(u / motion.sizes)[kind], initial=0.0))
        if rate > 0.0:
            time = 0.3 / rate
            yield motion_at(system, motion.q + time * u + 0.5 * time * time * a, u + time * a, motion.time + time)


def _continued(system: System, motion: Motion, matrices: _Matrices) -> Iterator[Motion]:
    """Yield where given functions of time carry the motion, by a step of the midpoint rule."""
    if not any("t" in names_in(item.entry.values) for item in system.scene.items):
        return
    scale = motion.spaces.scale
    R, K = (float(np.max(np.abs(x * scale * scale[:, None]), initial=0.0)) for x in (matrices.R, matrices.K))
    # Given functions can be fast or slow; what the scene would do by itself says what matters.
    step, last = 3.0 / (max(R, math.sqrt(K)) or 1.0), motion
    for time in (0.5 * step, step):
        last = motion_at(system, motion.q + time * last.u, motion.u + time * last.a, motion.time + time)
        yield last


def _change(system: System, motion: Motion, now: _Matrices, then: _Matrices, time: float) -> float:
    """Return the largest relative change of the deflated system, apart from rounding."""
    spaces, scale = motion.spaces, motion.spaces.scale
    J = then.J * scale * spaces.row_scale[:, None]
    C, D = J[: system.n_h], J[system.n_h :]
    # The same motions must be allowed.
    turned = float(max(np.max(np.abs(x), initial=0.0) for x in (C @ spaces.N, D @ spaces.N @ spaces.Z)))
    if turned > ROUNDING:
        return turned
    n = spaces.N.shape[1]
    A, B = (_deflated(spaces, matrices)[0] for matrices in (now, then))
    # What rounding may be, beside the entries themselves: inertia over the time, and the forces that balance.
    forces = float(np.max(np.abs(motion.dynamics.F0 * scale)) / np.min(motion.sizes / scale))
    worst = 0.0
    for block, natural in (
        (np.s_[:n, :n], 1.0 / time),
        (np.s_[n:, :n], 1.0 / time**2 + forces),
        (np.s_[n:, n:], 1.0 / time),
    ):
        difference = float(np.max(np.abs(B[block] - A[block]), initial=0.0))
        if difference > ROUNDING * natural:
            worst = max(worst, difference / float(np.max(np.maximum(np.abs(A[block]), np.abs(B[block])))))
    return worst


def _deflated(spaces: Subspaces, matrices: _Matrices) -> tuple[Array, Array]:
    """Return the matrix of ẏ = A y in the bases N and Z, and the mass matrix of the speeds."""
    scale, N, Z = spaces.scale, spaces.N, spaces.Z
    weights = scale * scale[:, None]
    M_r, R_r, K_r = (N.T @ (x * weights) @ N for x in (matrices.M, matrices.R, matrices.K))
    n_h = len(matrices.J) - len(matrices.D_q)
    D_u, D_q = (x * scale * spaces.row_scale[n_h:, None] @ N for x in (matrices.J[n_h:], matrices.D_q))
    P = -rank_of(D_u).pseudo_inverse @ D_q
    M_z = Z.T @ M_r @ Z
    inertia = M_r @ P + R_r
    right = np.hstack([Z.T @ (inertia @ P + K_r), Z.T @ inertia @ Z])
    # Z is orthonormal in mass-scaled coordinates: M_z is as well conditioned as the scene allows.
    lower = -np.linalg.solve(M_z, right) if M_z.size else np.zeros((0, N.shape[1]))
    return np.vstack([np.hstack([P, Z]), lower]), M_z


def state_space(linear: Linearization) -> StateSpace:
    """Return the deflated system; all its eigenvalues are finite, and they are all finite eigenvalues."""
    spaces = linear.motion.spaces
    scale, N, Z = spaces.scale, spaces.N, spaces.Z
    n_xi = N.shape[1]
    A, M_z = _deflated(spaces, _Matrices(linear.M, linear.R, linear.K, linear.J, linear.D_q))
    to_coordinates = scale[:, None] * np.hstack([N, np.zeros((len(scale), Z.shape[1]))])
    to_rates = scale[:, None] * (N @ A[:n_xi])
    return StateSpace(A, to_coordinates, to_rates, n_xi, M_z)
