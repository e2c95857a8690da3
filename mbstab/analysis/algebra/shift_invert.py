"""A few eigenvalues of a large sparse quadratic problem Q(s) z = 0, Q(s) = Q₀ + s Q₁ + s² Q₂, nearest to a shift.

With z_a, the components in the nonzero columns of Q₁ or Q₂, and w = s z_a, one factorization of Q(σ) gives the operator

    Q(σ) x = −(Q₂ (w + σ z_a) + Q₁ z_a),    (z_a, w) ↦ (x_a, z_a + σ x_a),    s = σ + 1/μ.

Its range satisfies the rows without s, so the infinite eigenvalues of constraints appear as μ = 0 only, and two
applications to the start vector purge their components (Nour-Omid, Parlett, Ericsson, Jensen 1987, Math. Comp. 48;
Meerbergen, Spence 1997, Math. Comp. 66).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np

from mbstab.analysis.algebra.arrays import Complex, Index
from mbstab.analysis.algebra.tolerances import TOLERANCES
from mbstab.errors import NumericalError

SEED = 11
"""Seed of start vectors: the same call returns the same result."""


Operator = Callable[[Any], Any]


class SingularShift(NumericalError):
    """A shift is an eigenvalue."""


class SparseQuadratic:
    """Q(s) with its three matrices on one sparsity pattern.

    Parameters
    ----------
    matrices : three sparse arrays, shape (n, n)
        Q₀, Q₁, Q₂.
    """

    def __init__(self, *matrices: Any) -> None:
        from scipy import sparse

        parts = [sparse.coo_array(x) for x in matrices]
        self.size = n = parts[0].shape[0]
        keys, place = np.unique(
            np.concatenate([x.col.astype(np.int64) * n + x.row for x in parts]), return_inverse=True
        )
        ends = np.cumsum([0, *(x.nnz for x in parts)])
        self.data = [
            np.bincount(place[a:b], weights=x.data, minlength=len(keys))
            for a, b, x in zip(ends, ends[1:], parts, strict=False)
        ]
        self.rows: Index = (keys % n).astype(np.intp)
        self.columns: Index = (keys // n).astype(np.intp)
        self._starts = np.searchsorted(keys, np.arange(n + 1, dtype=np.int64) * n)

    def at(self, s: complex, slope: bool = False) -> Any:
        """Return Q(s), or Q'(s), as a sparse matrix; real for a real s."""
        from scipy import sparse

        if not np.imag(s):
            s = np.real(s)
        entries = (
            self.data[1] + 2.0 * s * self.data[2] if slope else self.data[0] + s * (self.data[1] + s * self.data[2])
        )
        return sparse.csc_array((entries, self.rows, self._starts), shape=(self.size, self.size))

    def factors(self, s: complex) -> Any:
        """Return the LU factors of Q(s); None if it is singular or not finite."""
        from scipy.sparse.linalg import splu

        matrix = self.at(s)
        if not np.all(np.isfinite(matrix.data)):
            return None
        try:
            lu = splu(matrix)
        except RuntimeError:
            return None
        return lu if np.all(np.isfinite(lu.solve(np.ones(self.size, dtype=lu.U.dtype)))) else None

    @cached_property
    def wide(self) -> list[Any]:
        """The entries in the longest floating-point type of the machine."""
        return [x.astype(np.longdouble) for x in self.data]

    @cached_property
    def active(self) -> Index:
        """The columns that contain s."""
        found: Index = np.unique(self.columns[(self.data[1] != 0.0) | (self.data[2] != 0.0)])
        return found

    def product(self, s: complex, Y: Complex, X: Complex, lost: SparseQuadratic | None = None) -> Complex:
        """Return Yᴴ Q(s) X, summed with more digits where the machine has them.

        Parameters
        ----------
        Y, X : ndarray of complex, shape (size, k)
        lost : SparseQuadratic, optional
            The rounding errors of the sums in the entries.
        """
        total = np.zeros((Y.shape[1], X.shape[1]), dtype=np.clongdouble)
        z = np.clongdouble(s)
        for part in (self, *([lost] if lost is not None else [])):
            d = part.wide
            entries = d[0] + z * (d[1] + z * d[2])
            left = np.conj(Y[part.rows]).astype(np.clongdouble) * entries[:, None]
            for j in range(X.shape[1]):
                total[:, j] += np.sum(left * X[part.columns, j, None], axis=0)
        return total.astype(complex)

    def operator(self, lu: Any, sigma: complex) -> tuple[Operator, Operator]:
        """Return the maps (z_a, w) ↦ x and (z_a, w) ↦ (x_a, z_a + σ x_a) from factors at σ; also for columns."""
        a, active = len(self.active), self.active
        Q1, Q2 = self._slopes

        def full(y: Any) -> Any:
            z, w = y[:a], y[a:]
            return lu.solve(np.ascontiguousarray(-(Q2 @ (w + sigma * z) + Q1 @ z)))

        def once(y: Any) -> Any:
            x = full(y)[active]
            return np.concatenate([x, y[:a] + sigma * x])

        return full, once

    @cached_property
    def _slopes(self) -> tuple[Any, Any]:
        Q1, Q2 = (self.part(k)[:, self.active] for k in (1, 2))
        return Q1, Q2

    def nearest(self, shift: complex, count: int, most: int) -> tuple[Complex, Complex]:
        """Return the eigenvalues nearest to a shift, nearest first, and their vectors as columns.

        For a real shift only those with Im ≥ 0 have vectors; the columns of the others are zero.

        Parameters
        ----------
        shift : complex
            Must not be an eigenvalue (1/s).
        count : int
        most : int
            Number of finite eigenvalues.

        Raises
        ------
        SingularShift
            If the shift is an eigenvalue.
        NumericalError
            If the iteration does not converge.
        """
        lu = self.factors(shift)
        if lu is None:
            raise SingularShift(
                f"the shift {shift:.6g} 1/s is an eigenvalue, or too close to one\nhint: give another one"
            )
        sigma = shift if np.imag(shift) else float(np.real(shift))
        full, once = self.operator(lu, sigma)
        a = len(self.active)
        dtype = complex if isinstance(sigma, complex) else float
        if 2 * a <= max(TOLERANCES.dense_operator, 3 * count):
            mu, Y = (x.astype(complex) for x in np.linalg.eig(once(np.eye(2 * a, dtype=dtype))))
            order = np.argsort(-np.abs(mu))[: min(count, most)]
            order = order[np.abs(mu[order]) > TOLERANCES.finite_operator_value * np.max(np.abs(mu), initial=0.0)]
        else:
            mu, Y = _largest_values(once, 2 * a, min(count, most), dtype)
            order = np.argsort(-np.abs(mu))
        mu, Y = mu[order], Y[:, order]
        values = sigma + 1.0 / mu
        X = np.zeros((self.size, len(mu)), dtype=complex)
        upper = np.flatnonzero((values.imag >= 0.0) | isinstance(sigma, complex))
        for k in upper:
            X[:, k] = self._refined(lu, sigma, full, Y[:, k])
        return values, X

    def _refined(self, lu: Any, sigma: complex, full: Operator, y: Complex) -> Complex:
        """Return the refined vector of an eigenvalue with its multipliers: large eigenvalues cost it no digits."""
        a, (Q1, Q2), matrix = len(self.active), self._slopes, self.at(sigma)
        right = -(Q2 @ (y[a:] + sigma * y[:a]) + Q1 @ y[:a])
        found = _complex(full, y)
        for _ in range(TOLERANCES.vector_corrections):
            found = found + _complex(lu.solve, right - matrix @ found)
        return found

    def part(self, k: int) -> Any:
        """Return the matrix of the k-th power of s."""
        from scipy import sparse

        return sparse.csc_array((self.data[k], self.rows, self._starts), shape=(self.size, self.size))

    def complete(self, shift: float, most: int) -> tuple[Complex, Complex] | None:
        """Return all eigenvalues, and their vectors as columns, those with Im < 0 zero; None if that takes long.

        Their errors are those of a dense matrix of the size of the shift: slow ones are better found by `nearest`.

        Parameters
        ----------
        shift : float
            Of the size of the largest eigenvalue (1/s).
        most : int
            Number of finite eigenvalues.
        """
        a = len(self.active)
        lu = self.factors(shift) if 2 * a <= TOLERANCES.dense_spectrum else None
        if lu is None:
            return None
        full, once = self.operator(lu, shift)
        mu, Y = (x.astype(complex) for x in np.linalg.eig(once(np.eye(2 * a))))
        order = np.argsort(-np.abs(mu))[:most]
        if len(order) < most or not np.all(mu[order]):
            return None
        values, X = shift + 1.0 / mu[order], np.zeros((self.size, len(order)), dtype=complex)
        for k in np.flatnonzero(values.imag >= 0.0):
            X[:, k] = _complex(full, Y[:, order[k]])
        return values, X


def _largest_values(once: Any, size: int, count: int, dtype: Any) -> tuple[Complex, Complex]:
    """Return the largest eigenvalues of an operator and their vectors, in subspaces as large as it takes."""
    from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigs

    start = once(once(np.random.default_rng(SEED).normal(size=size).astype(dtype)))
    operator = LinearOperator((size, size), matvec=once, dtype=dtype)
    found = 0
    for wider in TOLERANCES.subspaces:
        width = min(size, wider * max(2 * count + 10, 20))
        try:
            values, vectors = eigs(operator, count, v0=start, ncv=width, tol=0.0, maxiter=TOLERANCES.restarts)
            return values.astype(complex), vectors.astype(complex)
        except ArpackNoConvergence as error:
            found = max(found, len(error.eigenvalues))
        if size <= TOLERANCES.dense_spectrum:
            values, vectors = (x.astype(complex) for x in np.linalg.eig(once(np.eye(size, dtype=dtype))))
            order = np.argsort(-np.abs(values))[:count]
            return values[order], vectors[:, order]
    raise NumericalError(
        f"{found} of {count} eigenvalues were found before the iteration was given up\n"
        "hint: ask for fewer, or near another number"
    )


def _complex(function: Any, y: Complex) -> Complex:
    """Return the value of a linear function at a complex vector, also if it takes only real ones."""
    try:
        return np.asarray(function(y), dtype=complex)
    except TypeError:  # real factors take real right-hand sides only
        return np.asarray(function(y.real) + 1j * function(y.imag))
