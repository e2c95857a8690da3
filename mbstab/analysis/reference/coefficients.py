"""Coefficients of the linearized equations, in the co-moving frame."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from mbstab.analysis.algebra.deflation import deflated_matrix, in_frame
from mbstab.analysis.algebra.rank import rank_of
from mbstab.analysis.algebra.sparse import congruent, is_sparse, scaled
from mbstab.analysis.algebra.stacks import times, transposed
from mbstab.analysis.algebra.subspaces import Subspaces
from mbstab.analysis.reference.motion import Motion
from mbstab.analysis.reference.steady import Generator
from mbstab.compiler.system import Array, System


class Matrices(NamedTuple):
    """Coefficients of the linearized equations."""

    M: Any
    R: Any
    K: Any
    J: Any
    D_q: Any


def matrices_in(system: System, motion: Motion, generator: Generator | None) -> Matrices:
    """Return the coefficients in the co-moving frame of a generator, or in the coordinates of the file.

    Over the points of a sweep the motion, and so all matrices, have an axis for these.
    """
    K, R, D_q = system.linearize(motion.q, motion.u, motion.a, motion.nu, motion.time)
    M, J = motion.dynamics.M, motion.dynamics.J
    if generator is not None and generator.turns:
        Xi, Xi_2 = generator.frame(motion.q)
        R, K, D_q = in_frame(M, R, K, J[..., system.n_h :, :], D_q, Xi, Xi_2)
    return Matrices(M, R, K, J, D_q)


def multiplier_sizes(system: System, motion: Motion) -> Array:
    """Return the sizes of the terms of which the multipliers are sums, shape (…, n_c).

    Their rounding errors are relative to these: they contain the rounding of all the forces that they balance, and of
    the coordinates of these.
    """
    loads = system.terms(motion.q, motion.u, motion.a, motion.nu, motion.time)
    balanced = loads["F"] + times(loads["M"], np.abs(motion.a)) + times(transposed(loads["J"]), np.abs(motion.nu))
    balanced = balanced + loads["K"] @ motion.sizes + times(loads["R"], np.abs(motion.u))
    return np.abs(motion.nu) + motion.balancing_sizes(balanced)


def deflated(spaces: Subspaces, matrices: Matrices) -> tuple[Array, Array]:
    """Return the matrix of ẏ = A y in the bases N and Z, and the mass matrix of the speeds."""
    if is_sparse(matrices.M) and not matrices.D_q.shape[0]:
        return _without_rows_on_speeds(spaces, matrices)
    n_h = matrices.J.shape[0] - matrices.D_q.shape[0]
    D_u, D_q = (x * spaces.scale * spaces.row_scale[n_h:, None] for x in (matrices.J[n_h:], matrices.D_q))
    P = -rank_of(D_u @ spaces.N).pseudo_inverse @ (D_q @ spaces.N)
    weights = spaces.scale * spaces.scale[:, None]
    M, R, K = (x * weights for x in (matrices.M, matrices.R, matrices.K))
    return deflated_matrix(M, R, K, spaces.N, spaces.Z, P)


def _without_rows_on_speeds(spaces: Subspaces, matrices: Matrices) -> tuple[Array, Array]:
    """Return the same for sparse matrices without rows on speeds, so that Z = 1 and P = 0."""
    M, R, K = (congruent(scaled(x, spaces.scale, spaces.scale), spaces.N) for x in (matrices.M, matrices.R, matrices.K))
    n = len(M)
    A = np.zeros((2 * n, 2 * n))
    A[:n, n:] = np.eye(n)
    A[n:, :n] = -np.linalg.solve(M, K)
    if np.any(R):
        A[n:, n:] = -np.linalg.solve(M, R)
    return A, M
