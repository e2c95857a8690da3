"""Matrices with any leading axes: none at one point, one for the points of a sweep, of length 1 where all agree."""

from __future__ import annotations

from typing import Any

import numpy as np

from mbstab.analysis.algebra.arrays import norms
from mbstab.compiler.system import Array


def some(x: Array, index: Any, dims: int) -> Array:
    """Return the part of an array for some points; `dims` is its number of axes if it varies with the points."""
    if dims and x.ndim < dims:
        return x
    return x if len(x) == 1 else x[index]


def transposed(x: Any) -> Array:
    """Return the transposes of matrices, and of a single one of any kind."""
    result: Array = x.T if x.ndim == 2 else np.swapaxes(x, -1, -2)
    return result


def times(matrix: Any, vectors: Array) -> Array:
    """Return the products of matrices with vectors, shape (…, n); one matrix, of any kind, serves all vectors."""
    if matrix.ndim == 2:
        return np.asarray((matrix @ vectors.T).T)
    return np.asarray((matrix @ vectors[..., None])[..., 0])


def _wide(parts: tuple[Array, ...], own: int) -> list[Array]:
    """Return arrays with the leading axes of all of them; `own` is how many others they have."""
    lead = np.broadcast_shapes(*(x.shape[: x.ndim - own] for x in parts))
    return [np.broadcast_to(x, (*lead, *x.shape[x.ndim - own :])) for x in parts]


def beside(*parts: Array) -> Array:
    """Return matrices side by side."""
    result: Array = np.concatenate(_wide(parts, 2), axis=-1)
    return result


def under(*parts: Array) -> Array:
    """Return matrices one below the other."""
    result: Array = np.concatenate(_wide(parts, 2), axis=-2)
    return result


def stacked(vectors: list[Array]) -> Array:
    """Return vectors, shape (…, n), as columns, shape (…, n, number)."""
    result: Array = np.stack(_wide(tuple(vectors), 1), axis=-1)
    return result


def unit(columns: Array) -> Array:
    """Return columns of length 1; those that are zero stay zero."""
    result: Array = columns / norms(columns, -2, keepdims=True)
    return result


def complement(columns: Array) -> Array:
    """Return orthonormal bases of the orthogonal complements of independent columns."""
    n, k = columns.shape[-2:]
    if not k:
        return np.broadcast_to(np.eye(n), (*columns.shape[:-2], n, n))
    return np.asarray(np.linalg.qr(columns, mode="complete")[0][..., k:])


def reduced(matrix: Array, basis: Array) -> Array:
    """Return matrices restricted to a basis."""
    result: Array = transposed(basis) @ matrix @ basis
    return result


def frobenius(x: Array) -> Array:
    """Return the Frobenius norms of matrices."""
    size = np.max(np.abs(x), axis=(-2, -1), keepdims=True, initial=0.0)  # squares may be beyond the range of doubles
    norm = np.linalg.norm(x / np.where(size, size, 1.0), axis=(-2, -1))
    return np.asarray(norm * size[..., 0, 0])
