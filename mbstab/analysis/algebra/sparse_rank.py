"""Rank, null space and pseudo-inverse of the constraint rows of a large scene, by one sparse LU factorization.

With rows J of unit length, H = [1 Jᵀ; J −δ²] serves for all of it. With a small δ, block inverse iteration finds the
smallest singular values: the lower block of H⁻¹[0; Y] is −(J Jᵀ + δ²)⁻¹ Y. With δ = 0 and without redundant rows,
H [x; y] = [b; 0] gives the projection x of b onto the null space, and the least-squares multipliers y of the rest
(Björck 1996, Numerical Methods for Least Squares Problems); H [x; y] = [0; b] gives the minimum-norm x with J x = b.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from mbstab.analysis.algebra.arrays import Index, others
from mbstab.analysis.algebra.inertia import ConstrainedForms
from mbstab.analysis.algebra.rank import last_rows
from mbstab.analysis.algebra.sparse import bordered, identity, row_norms, scaled
from mbstab.analysis.algebra.tolerances import TOLERANCES
from mbstab.compiler.system import Array
from mbstab.records import dataclass


class Rows:
    """Independent rows of about unit length, factored.

    Parameters
    ----------
    J : sparse array, shape (c, n)
    shift : float
        δ; then the rows need not be independent.
    """

    def __init__(self, J: Any, shift: float = 0.0) -> None:
        from scipy.sparse.linalg import splu

        self.J, (self.c, self.n) = J, J.shape
        self._lu = splu(bordered(identity(self.n), J, -(shift**2))) if self.n + self.c else None

    def solve(self, top: Array, bottom: Array) -> tuple[Array, Array]:
        """Return x, y of H [x; y] = [top; bottom], vectors or columns."""
        if self._lu is None:
            return top, bottom
        found = self._lu.solve(np.concatenate([top, bottom]))
        return found[: self.n], found[self.n :]

    def split(self, b: Array) -> tuple[Array, Array]:
        """Return the projection x of b onto the null space of J, and y with b = x + Jᵀ y."""
        return self.solve(b, np.zeros((self.c, *b.shape[1:])))

    def allowed(self, b: Array) -> Array:
        """Return the projection of b onto the null space of J."""
        return self.split(b)[0]

    def multipliers(self, b: Array) -> Array:
        """Return the y that minimizes |b − Jᵀ y|."""
        return self.split(b)[1]

    def shortest(self, b: Array) -> Array:
        """Return the minimum-norm x with J x = b."""
        return self.solve(np.zeros((self.n, *b.shape[1:])), b)[0]


@dataclass(frozen=True)
class SparseRank:
    """A rank decision about sparse rows; as `mbstab.analysis.algebra.rank.Rank`, with bases that are made when asked.

    Attributes
    ----------
    J : sparse array, shape (c, n)
        The rows.
    kept : ndarray of int
        Numbers of rows that are independent and span the others.
    smallest_kept, largest_dropped : float
        Singular values on both sides of the decision (inf and 0 where there is none).
    left_null : ndarray, shape (c, c − rank)
        Orthonormal combinations of rows that vanish.
    doubtful : ndarray, shape (c,)
        The combination of rows that is smallest without vanishing.
    """

    J: Any
    kept: Index
    smallest_kept: float
    largest_dropped: float
    left_null: Array
    doubtful: Array

    @property
    def rank(self) -> int:
        """Number of independent rows."""
        return len(self.kept)

    @property
    def dropped(self) -> Index:
        """Numbers of the other rows."""
        return others(self.J.shape[0], self.kept)

    @property
    def gap(self) -> float:
        """Ratio of the singular values on both sides of the decision."""
        return self.smallest_kept / self.largest_dropped if self.largest_dropped > 0.0 else np.inf

    @cached_property
    def rows(self) -> Rows:
        """The independent rows, factored."""
        return Rows(self.J[self.kept])

    @cached_property
    def forms(self) -> ConstrainedForms:
        """Symmetric forms on the null space, counted without it."""
        return ConstrainedForms(self.J[self.kept])

    @cached_property
    def null(self) -> Array:
        """Orthonormal basis of the null space, as columns."""
        return _null_space(self.rows, self.rows.n - self.rank)

    @cached_property
    def pseudo_inverse(self) -> Any:
        """The pseudo-inverse, a linear operator."""
        from scipy.sparse.linalg import LinearOperator

        c, dependent = self.J.shape[0], self.left_null

        def inverse(b: Array) -> Array:
            b = np.asarray(b, dtype=float)
            return self.rows.shortest((b - dependent @ (dependent.T @ b))[self.kept])

        def transposed(b: Array) -> Array:
            b = np.asarray(b, dtype=float)
            y = np.zeros((c, *b.shape[1:]))
            y[self.kept] = self.rows.multipliers(b)
            return np.asarray(y - dependent @ (dependent.T @ y))

        functions = {"matvec": inverse, "matmat": inverse, "rmatvec": transposed, "rmatmat": transposed}
        return LinearOperator(self.J.shape[::-1], dtype=float, **functions)


def sparse_rank(J: Any, tolerance: float = TOLERANCES.singular_value_zero) -> SparseRank:
    """Return which sparse rows of unit length, or zero, are independent."""
    c = J.shape[0]
    s, left = smallest_singular_values(J, tolerance) if c else (np.zeros(0), np.zeros((0, 0)))
    null = s <= tolerance
    dependent, above = left[:, null], np.flatnonzero(~null)
    kept = others(c, [last for last, _ in last_rows(dependent)])
    least, doubtful = np.inf, np.zeros(c)
    if len(above):
        first = above[int(np.argmin(s[above]))]
        least, doubtful = float(s[first]), left[:, first]
    return SparseRank(J, kept, least, float(np.max(s[null], initial=0.0)), dependent, doubtful)


def rank_decisions(J: Any, n_h: int) -> list[tuple[SparseRank, Index]]:
    """Return the decision about the first rows, and about the independent ones of them with the others, if any.

    Each with the numbers of its rows: those that the last one keeps are independent and span all.
    """
    C = sparse_rank(J[:n_h])
    found: list[tuple[SparseRank, Index]] = [(C, np.arange(n_h))]
    if n_h < J.shape[0]:
        both = np.concatenate([C.kept, np.arange(n_h, J.shape[0])]).astype(np.intp)
        found.append((sparse_rank(J[both]), both))
    return found


def smallest_singular_values(
    J: Any, tolerance: float = TOLERANCES.singular_value_zero, most: int | None = None
) -> tuple[Array, Array]:
    """Return the smallest singular values of rows, at least one of them nonzero, and their left vectors."""
    c = J.shape[0]
    factored, count = Rows(J, TOLERANCES.row_shift), min(TOLERANCES.singular_values_at_once, c)
    rng = np.random.default_rng(5)
    while True:
        Y = np.linalg.qr(rng.standard_normal((c, count)))[0]
        for _ in range(TOLERANCES.rank_iterations):
            Y = np.linalg.qr(factored.solve(np.zeros((factored.n, count)), Y)[1])[0]
        # From the rows themselves: 1/(σ² + δ²) loses half of the digits.
        _, s, turn = np.linalg.svd(J.T @ Y, full_matrices=False)
        if len(s) < count:  # more combinations than columns
            turn, s = np.linalg.svd(J.T @ Y)[2], np.concatenate([s, np.zeros(count - len(s))])
        if count == c or s[0] > tolerance or (most is not None and s[0] <= tolerance and count > most):
            return s, Y @ turn.T
        count = min(2 * count, c)


def _null_space(rows: Rows, count: int) -> Array:
    """Return an orthonormal basis of the null space of rows."""
    X = np.random.default_rng(7).standard_normal((rows.n, count))
    parts = [slice(start, start + TOLERANCES.columns_at_once) for start in range(0, count, TOLERANCES.columns_at_once)]
    for part in parts:
        X[:, part] = rows.allowed(X[:, part])
    X = np.linalg.qr(X)[0]
    # Orthonormalization magnifies the rounding errors outside the null space.
    for part in parts:
        X[:, part] -= rows.shortest(rows.J @ X[:, part])
    return X


def with_unit_rows(A: Any) -> Any:
    """Return a sparse matrix with its rows scaled to unit length."""
    return scaled(A, np.ones(A.shape[1]), 1.0 / row_norms(A))


def sparse_null_space(A: Any, most: int) -> Array | None:
    """Return an orthonormal basis of the null space of a sparse matrix; None if its dimension is too large.

    Parameters
    ----------
    A : sparse array, shape (m, n)
        Its entries are of about unit size.
    most : int
        Largest dimension.
    """
    n = A.shape[1]
    columns = A.T.tocsr()
    lengths = np.sqrt(np.asarray((columns * columns).sum(axis=1)).ravel())
    seen = np.flatnonzero(lengths > TOLERANCES.direction_unseen)
    free = others(n, seen)
    if len(free) > most:
        return None
    found = np.zeros((n, len(free)))
    found[free, np.arange(len(free))] = 1.0
    if not len(seen):
        return found
    s, left = smallest_singular_values(columns[seen], TOLERANCES.direction_unseen, most)
    null = s <= TOLERANCES.direction_unseen
    if len(free) + int(np.sum(null)) > most:
        return None
    further = np.zeros((n, int(np.sum(null))))
    further[seen] = left[:, null]
    return np.hstack([found, further])
