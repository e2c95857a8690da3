"""Linear algebra on stacks of matrices and vectors, one for each point of a sweep."""

from __future__ import annotations

from typing import Any

import numpy as np

from mbstab.analysis.algebra.arrays import Flags, norms
from mbstab.analysis.algebra.tolerances import EPS
from mbstab.analysis.sweep.tolerances import TOLERANCES
from mbstab.analysis.verdict.minimum import decays
from mbstab.analysis.verdict.tolerances import TOLERANCES as VERDICT
from mbstab.compiler.system import Array


def some(x: Array, index: Any, dims: int) -> Array:
    """Return the part of an array for some points; `dims` is its number of axes if it varies with the points."""
    if dims and x.ndim < dims:
        return x
    return x if len(x) == 1 else x[index]


def restricted(energy: tuple[Array, Array], W: Array) -> Array:
    """Return the inertia of a form, given with its error bounds, on the span of columns."""
    size = np.abs(W)
    return inertia(transposed(W) @ energy[0] @ W, transposed(size) @ energy[1] @ size)


def inertia(H: Array, known: Array) -> Array:
    """Return numbers of positive, negative and doubtful directions of symmetric matrices, shape (points, 3).

    Parameters
    ----------
    H : ndarray, shape (points, m, m)
    known : ndarray, shape (points, m, m)
        Bound of the rounding error of each entry.
    """
    m = H.shape[-1]
    if not m:
        return np.zeros((len(H), 3), dtype=int)
    # Scaled by the diagonal, so that large stiffness does not hide soft directions (Demmel and Veselić 1992). Entries
    # that may be zero are left small, so that they hide nothing either.
    own, open_ = np.abs(np.diagonal(H, axis1=1, axis2=2)), np.diagonal(known, axis1=1, axis2=2)
    diagonal = np.where(own > 10.0 * open_, own, np.max(np.maximum(own, open_), axis=1, keepdims=True))
    scale = 1.0 / np.sqrt(np.maximum(diagonal, 1e-300))
    both = scale[:, :, None] * scale[:, None, :]
    values = np.linalg.eigvalsh(0.5 * (H + transposed(H)) * both)
    least = np.linalg.norm(known * both, axis=(1, 2))[:, None] + m * EPS * np.max(np.abs(values), axis=1)[:, None]
    positive, negative = np.sum(values > least, axis=1), np.sum(values < -least, axis=1)
    return np.stack([positive, negative, m - positive - negative], axis=1)


def chain(block: Array, size: float) -> int:
    """Return the power at which a nilpotent matrix vanishes; 0 where rounding hides it."""
    power = np.eye(len(block))
    for index in range(1, len(block) + 1):
        power = power @ (block / (size or 1.0))
        if np.linalg.norm(power) <= TOLERANCES.direction_closure:
            return index
    return 0


def transposed(x: Any) -> Array:
    """Return the transposes of a stack of matrices."""
    result: Array = np.swapaxes(x, -1, -2)
    return result


def _wide(*parts: Array) -> list[Array]:
    points = max(len(x) for x in parts)
    return [np.broadcast_to(x, (points, *x.shape[1:])) for x in parts]


def beside(*parts: Array) -> Array:
    """Return matrices side by side."""
    result: Array = np.concatenate(_wide(*parts), axis=-1)
    return result


def under(*parts: Array) -> Array:
    """Return matrices one below the other."""
    result: Array = np.concatenate(_wide(*parts), axis=-2)
    return result


def stacked(vectors: list[Array]) -> Array:
    """Return vectors (points, n) as columns (points, n, number)."""
    result: Array = np.stack(_wide(*vectors), axis=-1)
    return result


def unit(columns: Array) -> Array:
    """Return columns of length 1; those that are zero stay zero."""
    result: Array = columns / norms(columns, -2, keepdims=True)
    return result


def orthonormal(columns: Array, rank: int, good: Flags) -> Array:
    """Return orthonormal bases of spans of unit columns; clear `good` where the rank is different."""
    if not rank:
        return columns[..., :0]
    if columns.shape[-1] == rank:
        Q, R = np.linalg.qr(columns)
        good &= np.min(np.abs(np.diagonal(R, axis1=-2, axis2=-1)), axis=-1) > VERDICT.independent_direction
        return Q
    left, s, _ = np.linalg.svd(columns, full_matrices=columns.shape[-1] < rank)
    good &= np.sum(s > VERDICT.independent_direction, axis=-1) == rank
    return left[..., :rank]


def complement(basis: Array) -> Array:
    """Return orthonormal bases of the orthogonal complements of orthonormal columns."""
    if not basis.shape[-1]:
        return np.eye(basis.shape[-2])[None]
    return np.linalg.qr(basis, mode="complete")[0][..., basis.shape[-1] :]


def reduced(matrix: Array, basis: Array) -> Array:
    """Return matrices restricted to a basis."""
    result: Array = transposed(basis) @ matrix @ basis
    return result


def decaying(S: Array, columns: Array, spread: Array, good: Flags) -> None:
    """Clear `good` where disturbances of states that only follow do not decay by themselves.

    Parameters
    ----------
    S : ndarray, shape (points, n, n)
    columns : ndarray, shape (points, n, states)
    spread : ndarray, shape (points,)
        Ratio of the terms of S to their sums.
    """
    inverse = np.linalg.pinv(columns)
    size = np.linalg.norm(np.abs(inverse) @ np.abs(S) @ np.abs(columns), axis=(1, 2))
    errors = VERDICT.roundings_of_variation * EPS * spread * size
    good &= np.array([decays(*x) for x in zip(inverse @ S @ columns, errors.tolist(), strict=True)])
