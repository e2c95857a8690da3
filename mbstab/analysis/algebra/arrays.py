"""Types of arrays, norms of vectors, and pseudo-random numbers."""

from __future__ import annotations

import math
import random
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

Complex = np.ndarray[tuple[Any, ...], np.dtype[np.complex128]]
Index = np.ndarray[tuple[Any, ...], np.dtype[np.intp]]
Flags = np.ndarray[tuple[Any, ...], np.dtype[np.bool_]]


def norms(vectors: npt.NDArray[np.float64], axis: int = -1, keepdims: bool = False) -> npt.NDArray[np.float64]:
    """Return the norms of vectors along an axis as divisors: 1 for zero vectors."""
    found = np.linalg.norm(vectors, axis=axis, keepdims=keepdims)
    return np.where(found > 0.0, found, 1.0)


def least_squares(matrix: Any, right: Any, rcond: float | None = None) -> Any:
    """Return the shortest x with the least |matrix x − right|; singular values below rcond times the largest are zero.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the matrix is not finite; LAPACK would print a message of its own.
    """
    if not np.all(np.isfinite(matrix)):
        raise np.linalg.LinAlgError("the matrix of a least-squares problem is not finite")
    return np.linalg.lstsq(matrix, right, rcond=rcond)[0]


def others(count: int, chosen: Any) -> Index:
    """Return the numbers below a count that are not among the chosen ones.

    `numpy.setdiff1d` would import `numpy.ma`, which takes as long as answering a small model.
    """
    left: Flags = np.ones(count, dtype=bool)
    left[np.asarray(chosen, dtype=np.intp)] = False
    return np.flatnonzero(left)


def at_block(rows: Any, columns: Any) -> Any:
    """Return the index of a block of a matrix."""
    return np.ix_(rows, columns)


class RandomNumbers:
    """Reproducible pseudo-random numbers; importing `numpy.random` takes as long as answering a small model."""

    def __init__(self, seed: int) -> None:
        self._source = random.Random(seed)

    def uniform(self, low: float, high: float, *shape: int) -> npt.NDArray[np.float64]:
        """Return an array of numbers between two limits."""
        numbers = [self._source.uniform(low, high) for _ in range(math.prod(shape))]
        return np.array(numbers).reshape(shape)
