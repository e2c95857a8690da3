"""The number of negative squares of a symmetric sparse form on the null space of constraints, without eigenvalues.

With N a basis of the null space of J, which has c independent rows, NᵀKN has c fewer negative eigenvalues than
[[K, Jᵀ], [J, 0]] (Chabrillac and Crouzeix 1984, Linear Algebra Appl. 63; Gould 1985, Math. Prog. 32). Those are
counted by an LDLᵀ factorization (Sylvester's law of inertia), which must not pivot off the diagonal:

    A = [[K + ρ JᵀJ, Jᵀ], [J, 0]]

has the same inertia for any ρ, and no zeros on the diagonal of K. Coordinates and rows are scaled so that all rows of
[[K, Jᵀ], [J, 0]] have about unit length (Ruiz 2001, RAL-TR-2001-034): the congruence leaves the inertia alone, and
errors of the entries count relative to what they are added to. Each row is matched with a coordinate, so that the
product of the entries is largest (Duff and Pralet 2005, SIAM J. Matrix Anal. Appl. 27); rotations that diagonalize the
2×2 tiles [[a, j], [j, 0]] of the pairs leave B = TᵀAT without zeros on its diagonal. The factors that are found are
exactly those of B + E; the count is that of B if |E| is less than the smallest singular value of B, with a margin.
"""

from __future__ import annotations

import math
from copy import copy
from typing import Any

import numpy as np

from mbstab.analysis.algebra.sparse import bordered, scaled
from mbstab.analysis.algebra.tolerances import EPS, TOLERANCES
from mbstab.compiler.system import Array


class ConstrainedForms:
    """Symmetric forms on the null space of J.

    Parameters
    ----------
    J : sparse array, shape (c, n)
        Independent rows of about unit length.
    error : sparse array, shape (c, n), optional
        Bounds of the errors of their entries, if they may be larger than the rounding of one term.
    """

    def __init__(self, J: Any, error: Any = None) -> None:
        self.J = J.tocsr()
        self.c, self.n = J.shape
        self.error = TOLERANCES.entry_rounding * abs(self.J) if error is None else error.tocsr()
        self._partner = _matched(self.J)

    def known_to(self, error: Any) -> ConstrainedForms:
        """Return the same with other bounds of the errors of the rows."""
        found = copy(self)
        found.error = error.tocsr()
        return found

    def negatives(self, K: Any, error: Any) -> int | None:
        """Return the number of negative squares of a form, or None if its uncertainty may change the number.

        Parameters
        ----------
        K : sparse array, shape (n, n)
            A symmetric form.
        error : sparse array, shape (n, n)
            Bounds of the errors of its entries.
        """
        if self.c >= self.n:
            return 0
        K = K.tocsr()
        if not np.any(K.data) or not np.all(np.isfinite(error.data)) or not np.all(np.isfinite(self.error.data)):
            return None
        columns, rows = _equilibrated(K, self.J)
        K, error = (scaled(x.tocsr(), columns, columns) for x in (K, error))
        J, of_rows = (scaled(x, columns, rows) for x in (self.J, self.error))
        found = None
        # Pivots that cancel with one weight do not with another.
        for weight in TOLERANCES.weights_of_rows if self._partner is not None else ():
            found = self._sparse(K, error, J, of_rows, weight)
            if found is not None or not self.c:
                break
        if found is None and self.n <= TOLERANCES.dense_null_space:
            found = self._dense(K.toarray(), error, J.toarray(), of_rows)
        return found

    def _sparse(self, K: Any, error: Any, J: Any, of_rows: Any, weight: float) -> int | None:
        from scipy.sparse.linalg import splu

        B = K
        if self.c:
            A = bordered(K + weight * (J.T @ J), J).tocsr()
            mixed = abs(J).T @ of_rows
            error = bordered(error + weight * (mixed + mixed.T), of_rows)
            T = self._rotations(A.diagonal(), J)
            B, error = T.T @ A @ T, abs(T).T @ error @ abs(T)
        B = 0.5 * (B + B.T)
        try:
            options = {"SymmetricMode": True}
            lu = splu(B.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
        except RuntimeError:  # exactly singular
            return None
        if not np.array_equal(lu.perm_r, lu.perm_c):
            return None
        pivots = lu.U.diagonal()
        order = np.argsort(lu.perm_c)
        missed = _norm_at_most(lu.L @ lu.U - B.tocsr()[order][:, order])
        rounding = 10.0 * EPS * _norm_at_most(B)
        least = 1.0 / _largest(lu.solve, len(pivots))
        if not missed + rounding + _norm_at_most(error) <= TOLERANCES.inertia_error * least:
            return None
        return int(np.sum(pivots < 0.0)) - int(self.c)

    def _rotations(self, diagonal: Array, J: Any) -> Any:
        """Return T, which diagonalizes the block of each row and its partner."""
        from scipy import sparse

        assert self._partner is not None
        rows, size = np.arange(self.c), self.n + self.c
        entries = np.asarray(J[rows, self._partner]).ravel()
        angle = 0.5 * np.arctan2(2.0 * entries, diagonal[self._partner])
        cosine, sine = np.ones(size), np.sin(angle)
        cosine[self._partner] = cosine[self.n :] = np.cos(angle)
        i = np.concatenate([np.arange(size), self._partner, self.n + rows])
        j = np.concatenate([np.arange(size), self.n + rows, self._partner])
        return sparse.csr_array((np.concatenate([cosine, -sine, sine]), (i, j)), shape=(size, size))

    def _dense(self, K: Array, error: Any, J: Array, of_rows: Any) -> int | None:
        """Return the count by the eigenvalues of the reduced form."""
        _, s, right = np.linalg.svd(J)
        N = right[self.c :].T
        values = np.linalg.eigvalsh(N.T @ K @ N)
        # Errors of the rows turn their null space.
        turned = (_norm_at_most(of_rows) + 10.0 * EPS) / float(np.min(s, initial=1.0))
        unsure = _norm_at_most(error) + (10.0 * EPS * self.n**0.5 + 2.0 * turned) * float(np.linalg.norm(K, 2))
        if not float(np.min(np.abs(values))) * TOLERANCES.inertia_error > unsure:
            return None
        return int(np.sum(values < 0.0))


def _equilibrated(K: Any, J: Any) -> tuple[Array, Array]:
    """Return factors, powers of two, of coordinates and rows that leave the rows of [[K, Jᵀ], [J, 0]] of one size."""
    K, J = abs(K), abs(J)
    columns, rows = np.ones(J.shape[1]), np.ones(J.shape[0])
    for _ in range(TOLERANCES.balancing_rounds):
        form, constraints = scaled(K, columns, columns), scaled(J, columns, rows)
        of_columns, of_rows = _largest_entries(form), _largest_entries(constraints)
        np.maximum.at(of_columns, constraints.indices, constraints.data)
        columns, rows = (
            x / np.sqrt(np.where(size > 0.0, size, 1.0)) for x, size in ((columns, of_columns), (rows, of_rows))
        )
    return np.exp2(np.round(np.log2(columns))), np.exp2(np.round(np.log2(rows)))


def _largest_entries(A: Any) -> Array:
    """Return the largest entry of each row of a nonnegative matrix."""
    found = np.zeros(A.shape[0])
    np.maximum.at(found, np.repeat(np.arange(len(found)), np.diff(A.indptr)), A.data)
    return found


def _norm_at_most(A: Any) -> float:
    """Return a bound of the spectral norm of a sparse matrix."""
    sizes = abs(A)
    sums = (float(np.max(np.asarray(sizes.sum(axis=k)).ravel(), initial=0.0)) for k in (0, 1))
    return min(float(np.linalg.norm(sizes.data)), math.sqrt(math.prod(sums)))


def _matched(J: Any) -> Any:
    """Return the coordinate of each row, so that the product of the entries is largest; None if there is none."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import min_weight_full_bipartite_matching

    J = J.copy()
    J.eliminate_zeros()
    if not J.shape[0]:
        return np.zeros(0, dtype=np.intp)
    # A weight of zero would not be an entry.
    weights = csr_array((1.0 - np.log(np.minimum(np.abs(J.data), 1.0)), J.indices, J.indptr), shape=J.shape)
    try:
        return min_weight_full_bipartite_matching(weights)[1]
    except ValueError:
        return None


def _largest(solve: Any, n: int) -> float:
    """Return the norm of a symmetric inverse, by inverse iteration."""
    X = np.linalg.qr(np.random.default_rng(5).normal(size=(n, min(TOLERANCES.inertia_vectors, n))))[0]
    found = 0.0
    for _ in range(TOLERANCES.inertia_iterations):
        X, R = np.linalg.qr(solve(X))
        found = max(found, float(np.linalg.norm(R, 2)))
        if not np.isfinite(found):
            return float("inf")
    return found
