"""Which rows of a large sparse matrix are independent, with the gap of the decision."""

from __future__ import annotations

from typing import Any

import numpy as np

from mbstab.analysis.algebra.sparse_rank import last_rows, smallest_singular_values
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
    values, combinations = smallest_singular_values(J)
    null = values <= TOLERANCES.singular_value_zero
    left_null = combinations[:, null]
    dropped = float(np.max(values[null], initial=0.0))
    above = np.flatnonzero(~null)
    first = above[int(np.argmin(values[above]))] if len(above) else 0
    kept, doubtful = (float(values[first]), combinations[:, first]) if len(above) else (np.inf, np.zeros(rows))
    independent = np.setdiff1d(np.arange(rows), [last for last, _ in last_rows(left_null)])
    return Independent(independent, kept, dropped, left_null, doubtful)
