"""Accelerations and multipliers from forces: M a + Jᵀ ν = force, J a = −gap, in scaled coordinates and rows.

The matrix [[M, Jᵀ], [J, 0]] is the augmented one (Benzi, Golub, and Liesen 2005, Acta Numerica 14). Where ranks have
been decided, it is solved through the null space of the rows, which may be redundant; where the rows are independent,
by factors of the matrix itself.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

import numpy as np

from mbstab.analysis.algebra.arrays import least_squares
from mbstab.analysis.algebra.sparse import bordered, difference
from mbstab.compiler.system import Array
from mbstab.records import dataclass


@dataclass(frozen=True)
class Augmented:
    """An augmented matrix whose rows may be redundant.

    Attributes
    ----------
    M, J : matrix, shapes (n_q, n_q) and (n_c, n_q)
        Arrays or sparse.
    inverse : matrix or LinearOperator, shape (n_q, n_c)
        The pseudo-inverse of J.
    mobility : matrix or LinearOperator, shape (n_q, n_q)
        Gives the accelerations that the rows allow from forces.
    """

    M: Any
    J: Any
    inverse: Any
    mobility: Any

    def solve(self, force: Any, gap: Any, times: Callable[[Any, Any], Any] = operator.matmul) -> tuple[Any, Any]:
        """Return a and the minimum-norm ν, vectors or columns.

        Parameters
        ----------
        force : ndarray, shape (n_q, …)
        gap : ndarray, shape (n_c, …)
        times : callable
            The product of a matrix with what is solved for, where these are no floats.
        """
        a = -times(self.inverse, gap)
        a = a + times(self.mobility, force - times(self.M, a))
        return a, times(self.inverse.T, force - times(self.M, a))

    def refined(self, force: Array, gap: Array, rounds: int) -> tuple[Array, Array]:
        """Return the same after rounds of iterative refinement."""
        a, nu = np.zeros(len(force)), np.zeros(len(gap))
        for _ in range(rounds):
            da, dnu = self.solve(difference(force, (self.M, a), (self.J.T, nu)), gap + self.J @ a)
            a, nu = a + da, nu + dnu
        return a, nu

    def multipliers(self, force: Array, rounds: int) -> Array:
        """Return the minimum-norm ν for which Jᵀ ν is next to a force, after rounds of refinement."""
        nu = np.zeros(self.inverse.shape[1])
        for _ in range(rounds):
            nu = nu + self.inverse.T @ difference(force, (self.J.T, nu))
        return nu


def of_rank(M: Array, J: Array, rank: int) -> tuple[Augmented, float]:
    """Return the augmented matrix of rows of a given rank, and their least singular value that does not vanish."""
    inverse, allowed, least = np.zeros(J.T.shape), np.eye(len(M)), np.inf
    if rank:
        left, s, right = np.linalg.svd(J)
        inverse, allowed, least = (right[:rank].T / s[:rank]) @ left[:, :rank].T, right[rank:].T, float(s[rank - 1])
    return Augmented(M, J, inverse, mobility(allowed.T @ M @ allowed, allowed)), least


def augmented_matrix(M: Array, J: Array) -> Array:
    """Return [[M, Jᵀ], [J, 0]], for arrays with any leading axes."""
    n, c = M.shape[-1], J.shape[-2]
    A = np.zeros((*J.shape[:-2], n + c, n + c))
    A[..., :n, :n], A[..., :n, n:], A[..., n:, :n] = M, np.swapaxes(J, -1, -2), J
    return A


def mobility(inertia: Array, allowed: Array, massless: Array | None = None) -> Array:
    """Return the matrix that gives the allowed accelerations from forces.

    Parameters
    ----------
    inertia : ndarray, shape (k, k)
        The mass matrix in the basis.
    allowed : ndarray, shape (n_q, k)
        Orthonormal basis of what the rows allow.
    massless : ndarray, shape (n_q, m), optional
        Orthonormal allowed motions that carry no mass: they are not accelerated, as no force may act there.
    """
    if massless is None:
        return np.asarray(allowed @ np.linalg.solve(inertia, allowed.T))
    inner = allowed.T @ massless
    whole = allowed @ np.linalg.solve(inertia + inner @ inner.T, allowed.T)
    return np.asarray(whole - massless @ massless.T)


def sparse_mobility(M: Any, J: Any) -> Any:
    """Return the same for sparse matrices with independent rows, a linear operator."""
    from scipy.sparse.linalg import LinearOperator, splu

    factors, n = splu(bordered(M, J)), M.shape[0]

    def accelerated(force: Array) -> Array:
        return np.asarray(factors.solve(np.concatenate([force, np.zeros((J.shape[0], *force.shape[1:]))]))[:n])

    return LinearOperator(M.shape, dtype=float, matvec=accelerated, matmat=accelerated)


def least_multipliers(J: Array, force: Array, singular: float = 1e-12) -> Array:
    """Return the least-squares solution ν of Jᵀ ν = force, shapes (…, n_c, n_q) and (…, n_q).

    Over the points of a sweep the normal equations are solved and corrected twice: independent rows of unit length
    are well conditioned, and this is several times faster. Rows of zeros, which take no force, have none.
    """
    if not J.shape[-2]:
        return np.zeros((*force.shape[:-1], 0))
    if J.ndim == 2:
        return np.asarray(least_squares(J.T, force, rcond=singular), dtype=np.float64)
    idle = ~np.any(J, axis=-1)
    inverse = np.linalg.inv(J @ np.swapaxes(J, -1, -2) + idle[..., None] * np.eye(J.shape[-2]))
    x: Array = np.zeros((*np.broadcast_shapes(J.shape[:-2], force.shape[:-1]), J.shape[-2]))
    for _ in range(3):
        missing = force - (np.swapaxes(J, -1, -2) @ x[..., None])[..., 0]
        x = x + (inverse @ (J @ missing[..., None]))[..., 0]
    return x
