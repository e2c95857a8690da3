"""Which rows of a large sparse matrix are independent, with the gap of the decision.

    H = [[I, Jᵀ], [J, −δ²]]

is regular whatever the rank of J is (Björck 1996, *Numerical Methods for Least Squares Problems*): with the
right-hand side [0; Y] its lower part is −(JJᵀ + δ²)⁻¹ Y, so block inverse iteration finds the combinations of rows that
are smallest. Their singular values come from JᵀY, where no digits are lost, not from those of the inverse.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from mbstab.analysis.algebra.tolerances import TOLERANCES
from mbstab.compiler.system import Array
from mbstab.records import dataclass


@dataclass(frozen=True)
class Independent:
    """A rank decision about rows of unit length.

    Attributes
    ----------
    kept : ndarray of int
        Numbers of rows that are independent and span the others.
    smallest_kept, largest_dropped : float
        Singular values on both sides of the decision (inf and 0 where there is none).
    left_null : ndarray, shape (rows, rows − rank)
        Orthonormal combinations of rows that vanish.
    doubtful : ndarray, shape (rows,)
        The combination that is smallest without vanishing.
    """

    kept: Any
    smallest_kept: float
    largest_dropped: float
    left_null: Array
    doubtful: Array

    @property
    def rank(self) -> int:
        """Number of independent rows."""
        return len(self.kept)

    @property
    def gap(self) -> float:
        """Ratio of the singular values on both sides of the decision."""
        return self.smallest_kept / self.largest_dropped if self.largest_dropped > 0.0 else np.inf

    @property
    def dropped(self) -> Any:
        """Numbers of the other rows."""
        return np.setdiff1d(np.arange(len(self.doubtful)), self.kept)


def independent_rows(J: Any) -> Independent:
    """Return which rows are independent.

    Parameters
    ----------
    J : sparse array, shape (rows, columns)
        Rows of unit length, or zero.
    """
    rows = J.shape[0]
    if not rows:
        return Independent(np.zeros(0, dtype=np.intp), np.inf, 0.0, np.zeros((0, 0)), np.zeros(0))
    values, combinations = _smallest(J)
    null = values <= TOLERANCES.singular_value_zero
    left_null = combinations[:, null]
    dropped = float(np.max(values[null], initial=0.0))
    above = np.flatnonzero(~null)
    first = above[int(np.argmin(values[above]))] if len(above) else 0
    kept, doubtful = (float(values[first]), combinations[:, first]) if len(above) else (np.inf, np.zeros(rows))
    return Independent(_independent(left_null), kept, dropped, left_null, doubtful)


def _smallest(J: Any) -> tuple[Array, Array]:
    """Return the smallest singular values, one of them at least above the threshold, and their left vectors."""
    from scipy import sparse
    from scipy.sparse.linalg import splu

    rows, columns = J.shape
    H = sparse.block_array(
        [[sparse.eye_array(columns), J.T], [J, -(TOLERANCES.row_shift**2) * sparse.eye_array(rows)]], format="csc"
    )
    lu = splu(H)
    rng, size = np.random.default_rng(3), TOLERANCES.row_combinations
    while True:
        size = min(size, rows)
        Y = np.linalg.qr(rng.normal(size=(rows, size)))[0]
        for _ in range(TOLERANCES.row_iterations):
            Y = np.linalg.qr(lu.solve(np.vstack([np.zeros((columns, size)), Y]))[columns:])[0]
        _, values, right = np.linalg.svd(J.T @ Y, full_matrices=False)
        if len(values) < size:  # more combinations than columns
            right, values = np.linalg.svd(J.T @ Y)[2], np.concatenate([values, np.zeros(size - len(values))])
        if size == rows or values[0] > TOLERANCES.singular_value_zero:
            return values, Y @ right.T
        size *= 2


def _independent(left_null: Array) -> Any:
    """Return the rows that are left when the last one is left out of each combination that vanishes."""
    rest, dropped = left_null.T.copy(), list[int]()
    for i in range(rest.shape[1] - 1, -1, -1):
        k = len(dropped)
        if k == len(rest):
            break
        best = k + int(np.argmax(np.abs(rest[k:, i])))
        if abs(rest[best, i]) > TOLERANCES.row_weight_dependent:
            rest[[k, best]] = rest[[best, k]]
            rest[k + 1 :] -= np.outer(rest[k + 1 :, i] / rest[k, i], rest[k])
            dropped.append(i)
    return np.setdiff1d(np.arange(left_null.shape[0]), dropped)
