"""Kinds of arrays, and lengths of vectors."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

Complex = npt.NDArray[np.complex128]
Index = npt.NDArray[np.intp]
Flags = npt.NDArray[np.bool_]


def norms(vectors: npt.NDArray[np.float64], axis: int = -1, keepdims: bool = False) -> npt.NDArray[np.float64]:
    """Return the lengths of vectors along an axis, to be divided by: 1 for those that are zero."""
    found = np.linalg.norm(vectors, axis=axis, keepdims=keepdims)
    return np.where(found > 0.0, found, 1.0)


def at_block(rows: Any, columns: Any) -> Any:
    """Return the index of a block of a matrix."""
    return np.ix_(rows, columns)
