"""The linearized equations in a moving frame, with constraints eliminated, in any arithmetic.

Written once, over a small set of operations: `DENSE` for floats with any leading axes (the points
of a sweep), `mbstab.analysis.algebra.digits.MANY_DIGITS` for many digits,
`mbstab.analysis.algebra.ball_matrices.BALLS` for proofs.
"""

from __future__ import annotations

from functools import reduce
from typing import Any, Protocol

import numpy as np

from mbstab.analysis.algebra.stacks import frobenius
from mbstab.compiler.system import Array


class Algebra(Protocol):
    """The matrix operations that the elimination needs, for any type of numbers."""

    def times(self, *factors: Any) -> Any:
        """Return a product of matrices."""

    def plus(self, *terms: Any) -> Any:
        """Return a sum of matrices."""

    def transposed(self, A: Any) -> Any:
        """Return Aᵀ."""


class Dense:
    """NumPy arrays of floats."""

    def times(self, *factors: Array) -> Array:  # noqa: D102
        return reduce(np.matmul, factors)

    def plus(self, *terms: Array) -> Array:  # noqa: D102
        return reduce(np.add, terms)

    def transposed(self, A: Array) -> Array:  # noqa: D102
        return np.swapaxes(A, -1, -2)


DENSE = Dense()


def in_frame(
    M: Any, R: Any, K: Any, D_u: Any, D_q: Any, slope: Any, second: Any, algebra: Algebra = DENSE
) -> tuple[Any, Any, Any]:
    """Return R, K and D_q in a frame that follows a symmetry.

    With Δq = T z, Ṫ = Ξ T and T̈ = Ξ₂ T: R + 2MΞ, K + RΞ + MΞ₂, D_q + D_u Ξ
    (`mbstab.analysis.reference.steady`).

    Parameters
    ----------
    M, R, K : matrix, shape (…, n_q, n_q)
    D_u, D_q : matrix, shape (…, n_n, n_q)
    slope, second : matrix, shape (…, n_q, n_q)
        Ξ and Ξ₂.
    """
    carried = algebra.times(M, slope)
    return (
        algebra.plus(R, carried, carried),
        algebra.plus(K, algebra.times(R, slope), algebra.times(M, second)),
        algebra.plus(D_q, algebra.times(D_u, slope)),
    )


def restricted(M: Any, R: Any, K: Any, N: Any, algebra: Algebra = DENSE) -> tuple[Any, Any, Any]:
    """Return NᵀMN, NᵀRN and NᵀKN."""
    N_t = algebra.transposed(N)
    M_r, R_r, K_r = (algebra.times(N_t, x, N) for x in (M, R, K))
    return M_r, R_r, K_r


def on_speeds(M_r: Any, R_r: Any, K_r: Any, Z: Any, P: Any, algebra: Algebra = DENSE) -> tuple[Any, Any, Any]:
    """Return M_z, K_z and R_z of M_z η̇ = −K_z ξ − R_z η, where ξ̇ = P ξ + Z η."""
    Z_t = algebra.transposed(Z)
    inertia = algebra.plus(algebra.times(M_r, P), R_r)
    K_z = algebra.times(Z_t, algebra.plus(algebra.times(inertia, P), K_r))
    return algebra.times(Z_t, M_r, Z), K_z, algebra.times(Z_t, inertia, Z)


def deflated_matrix(M: Array, R: Array, K: Array, N: Array, Z: Array, P: Array) -> tuple[Array, Array]:
    """Return the matrix of ẏ = A y in the bases N and Z, and the mass matrix of the speeds.

    Parameters
    ----------
    M, R, K : ndarray, shape (…, n_q, n_q)
        In scaled coordinates; leading axes run over the points of a sweep, and broadcast.
    N : ndarray, shape (…, n_q, n_xi)
    Z : ndarray, shape (…, n_xi, n_eta)
    P : ndarray, shape (…, n_xi, n_xi)
    """
    # Z is orthonormal in mass-scaled coordinates, so M_z is as well conditioned as the scene allows.
    M_z, *lower = on_speeds(*restricted(M, R, K, N), Z, P)
    n, points = N.shape[-1], np.broadcast_shapes(*(x.shape[:-2] for x in (*lower, P, Z)))
    A = np.empty((*points, n + Z.shape[-1], n + Z.shape[-1]))
    A[..., :n, :n], A[..., :n, n:] = P, Z
    if M_z.size:
        # One matrix for all points is inverted once.
        inverse = np.linalg.inv(M_z) if M_z.ndim > 2 and len(M_z) == 1 else None
        for block, x in ((np.s_[..., n:, :n], lower[0]), (np.s_[..., n:, n:], lower[1])):
            A[block] = -np.linalg.solve(M_z, x) if inverse is None else -inverse @ x
    return A, M_z


def time_scale(A: Array, n: int) -> Array:
    """Return typical rates of deflated systems (1/s), shape (…), of whose components the first n are positions."""
    sizes = [np.sqrt(frobenius(A[..., n:, :n])), frobenius(A[..., n:, n:]), frobenius(A[..., :n, :n])]
    largest: Array = np.max(sizes, axis=0)
    return np.where(largest > 0.0, largest, 1.0)


def balanced(A: Array, n: int, gamma: Array | float) -> Array:
    """Return the matrices with speeds in units of γ, so that their blocks are of similar size."""
    weights = np.ones(A.shape[:-1])
    weights[..., n:] = np.asarray(gamma)[..., None]
    result: Array = A * weights[..., None, :]
    result /= weights[..., :, None]
    return result
