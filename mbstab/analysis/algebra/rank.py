"""Rank decisions with null spaces and pseudo-inverses."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from mbstab.analysis.algebra.stacks import transposed
from mbstab.analysis.algebra.tolerances import TOLERANCES
from mbstab.compiler.system import Array
from mbstab.records import dataclass


@dataclass(frozen=True)
class Rank:
    """A rank decision about a matrix, or about stacks of matrices of the same rank.

    Attributes
    ----------
    rank : int
    smallest_kept, largest_dropped : float, or ndarray, shape (…)
        Singular values on both sides of the decision (0 and inf where there is none).
    null : ndarray
        Orthonormal basis of the null space, as columns.
    left_null : ndarray
        Orthonormal combinations of rows that vanish, as columns.
    doubtful : ndarray
        The combination of rows that is smallest without vanishing.
    pseudo_inverse : ndarray or LinearOperator
    """

    rank: int
    smallest_kept: Any
    largest_dropped: Any
    null: Array
    left_null: Array
    doubtful: Array
    pseudo_inverse: Any

    @property
    def gap(self) -> float:
        """Ratio of the singular values on both sides of the decision."""
        return float(self.smallest_kept / self.largest_dropped) if self.largest_dropped > 0.0 else np.inf


def rank_of(matrix: Array, tolerance: float = TOLERANCES.singular_value_zero, rank: int | None = None) -> Rank:
    """Return rank, null spaces and pseudo-inverse of a matrix with rows of unit length, or of a part of its columns.

    Parameters
    ----------
    matrix : ndarray, shape (…, m, n)
    tolerance : float
        Smaller singular values are zero.
    rank : int, optional
        The rank that is expected of stacks of matrices: the singular values beside it tell which of them have it.
    """
    rows, columns = matrix.shape[-2:]
    if rows == 0 or columns == 0:
        one = (1,) * (matrix.ndim - 2)
        empty = np.eye(columns), np.eye(rows), np.zeros(rows), np.zeros((columns, rows))
        return Rank(0, np.inf, 0.0, *(x.reshape(*one, *x.shape) for x in empty))
    left, s, right = np.linalg.svd(matrix)
    if rank is None:
        rank = int(np.sum(s > tolerance))
    kept = s[..., rank - 1] if rank else np.inf
    dropped = s[..., rank] if rank < s.shape[-1] else 0.0
    inverse = (transposed(right[..., :rank, :]) / s[..., None, :rank]) @ transposed(left[..., :rank])
    doubtful = left[..., rank - 1] if rank else np.zeros(rows)
    return Rank(rank, kept, dropped, transposed(right[..., rank:, :]), left[..., rank:], doubtful, inverse)


def inverse_of_part(rows: Array) -> Array:
    """Return the pseudo-inverse of a part of the columns of rows that have unit length, or of stacks of such rows.

    What is small in the part against the whole rows counts as zero, even where nothing in the part is larger: rows
    that only rounding lets depend on some unknowns do not determine them.

    Parameters
    ----------
    rows : ndarray, shape (..., m, n)

    Returns
    -------
    ndarray, shape (..., n, m)
    """
    left, s, right = np.linalg.svd(rows, full_matrices=False)
    kept = s > TOLERANCES.singular_value_zero
    inverse = kept / np.where(kept, s, 1.0)
    result: Array = (np.swapaxes(right, -1, -2) * inverse[..., None, :]) @ np.swapaxes(left, -1, -2)
    return result


def last_rows(dependent: Array, least: float = TOLERANCES.row_weight_dependent) -> Iterator[tuple[int, Array]]:
    """Yield the rows that earlier rows imply, each with its combination, from combinations of rows that vanish.

    Parameters
    ----------
    dependent : ndarray, shape (c, d)
        Independent columns.
    least : float
        Smaller weights are rounding.
    """
    rest = dependent.T.copy()
    found: list[tuple[int, Array]] = []
    for i in range(rest.shape[1] - 1, -1, -1):
        if len(found) == len(rest):
            break
        k = len(found)
        best = k + int(np.argmax(np.abs(rest[k:, i])))
        if abs(rest[best, i]) <= least:
            continue
        rest[[k, best]] = rest[[best, k]]
        rest[k] /= -rest[k, i]
        others = np.arange(len(rest)) != k
        rest[others] += np.outer(rest[others, i], rest[k])
        found.append((i, rest[k]))
    yield from reversed(found)
