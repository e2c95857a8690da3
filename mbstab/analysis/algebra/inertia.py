"""The number of negative squares of a symmetric sparse form on the null space of constraints, without eigenvalues.

With N a basis of the null space of J, which has c independent rows, NᵀKN has c fewer negative eigenvalues than
[[K, Jᵀ], [J, 0]] (Chabrillac and Crouzeix 1984, Linear Algebra Appl. 63; Gould 1985, Math. Prog. 32). Those are
counted by an LDLᵀ factorization (Sylvester's law of inertia), which must not pivot off the diagonal:

    A = [[K/κ + ρ JᵀJ, Jᵀ], [J, 0]],   κ = max |K|

has the same inertia for any ρ, and no zeros on the diagonal of K. Each row is matched with a coordinate, so that the
product of the entries is largest (Duff and Pralet 2005, SIAM J. Matrix Anal. Appl. 27); rotations that diagonalize the
2×2 tiles [[a, j], [j, 0]] of the pairs leave B = TᵀAT without zeros on its diagonal. The factors that are found are
exactly those of B + E; the count is that of B if |E| is less than the smallest singular value of B, with a margin.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from mbstab.analysis.algebra.sparse import bordered
from mbstab.analysis.algebra.tolerances import EPS, TOLERANCES
from mbstab.compiler.system import Array


class ConstrainedForms:
    """Symmetric forms on the null space of J.

    Parameters
    ----------
    J : sparse array, shape (c, n)
        Independent rows of unit length.
    """

    def __init__(self, J: Any) -> None:
        self.J = J.tocsr()
        self.c, self.n = J.shape
        self._partner = _matched(self.J)
        self._squares = (self.J.T @ self.J).tocsr()

    def negatives(self, K: Any, unsure: float) -> int | None:
        """Return the number of negative squares of a form, or None if its uncertainty may change the number.

        Parameters
        ----------
        K : sparse array, shape (n, n)
            A symmetric form.
        unsure : float
            Frobenius norm of its possible error.
        """
        if self.c >= self.n:
            return 0
        largest = float(np.max(np.abs(K.data), initial=0.0))
        if not largest:
            return None
        unsure = unsure / largest + 4.0 * TOLERANCES.entry_rounding * self.c**0.5
        found = None
        # Pivots that cancel with one weight do not with another.
        for weight in TOLERANCES.weights_of_rows if self._partner is not None else ():
            found = self._sparse(K / largest, unsure, weight)
            if found is not None or not self.c:
                break
        if found is None and self.n <= TOLERANCES.dense_null_space:
            found = self._dense((K / largest).toarray(), unsure)
        return found

    def _sparse(self, K: Any, unsure: float, weight: float) -> int | None:
        from scipy.sparse.linalg import splu

        B = K
        if self.c:
            A = bordered(K + weight * self._squares, self.J).tocsr()
            T = self._rotations(A.diagonal())
            B = T.T @ A @ T
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
        missed = float(np.linalg.norm((lu.L @ lu.U - B.tocsr()[order][:, order]).data))
        rounding = 10.0 * EPS * float(np.linalg.norm(B.data))
        least = 1.0 / _largest(lu.solve, len(pivots))
        if not missed + rounding + unsure <= TOLERANCES.inertia_error * least:
            return None
        return int(np.sum(pivots < 0.0)) - int(self.c)

    def _rotations(self, diagonal: Array) -> Any:
        """Return T, which diagonalizes the block of each row and its partner."""
        from scipy import sparse

        assert self._partner is not None
        rows, size = np.arange(self.c), self.n + self.c
        entries = np.asarray(self.J[rows, self._partner]).ravel()
        angle = 0.5 * np.arctan2(2.0 * entries, diagonal[self._partner])
        cosine, sine = np.ones(size), np.sin(angle)
        cosine[self._partner] = cosine[self.n :] = np.cos(angle)
        i = np.concatenate([np.arange(size), self._partner, self.n + rows])
        j = np.concatenate([np.arange(size), self.n + rows, self._partner])
        return sparse.csr_array((np.concatenate([cosine, -sine, sine]), (i, j)), shape=(size, size))

    def _dense(self, K: Array, unsure: float) -> int | None:
        """Return the count by the eigenvalues of the reduced form."""
        N = np.linalg.svd(self.J.toarray())[2][self.c :].T
        values = np.linalg.eigvalsh(N.T @ K @ N)
        if not float(np.min(np.abs(values))) * TOLERANCES.inertia_error > unsure + 10.0 * EPS * self.n:
            return None
        return int(np.sum(values < 0.0))


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
