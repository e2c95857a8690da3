"""Verdicts at many points of a sweep at once: sides of eigenvalues, and the result of `judge` for each class of points.

Each eigenvalue has a bound of its own. The matrix left to judge, A, is known to ε in the norm: Gershgorin's discs of
Y A W, with vectors W and Y = W⁻¹, contain its eigenvalues. Where there is a stiffness alone, the signs of its scaled
eigenvalues count those that grow, however stiff the scene is. Points that are then still open are judged one by one by
the code of `mbstab eig`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from mbstab.analysis.algebra.arrays import Complex, Index
from mbstab.analysis.algebra.tolerances import EPS
from mbstab.analysis.algebra.tolerances import TOLERANCES as ALGEBRA
from mbstab.analysis.bounds.eigenpairs import eigenpairs
from mbstab.analysis.sweep.batched_structure import Known, Separation
from mbstab.analysis.sweep.points import Points
from mbstab.analysis.sweep.spectra import WORD, Spectra
from mbstab.analysis.sweep.tolerances import TOLERANCES
from mbstab.analysis.verdict.rule import (
    AXIS,
    LEFT,
    NAMES,
    OPEN,
    RIGHT,
    UNDECIDED,
    Disc,
    Extremum,
    Facts,
    Minimum,
    Sides,
    judge,
)
from mbstab.analysis.verdict.rule import sides as sides_of
from mbstab.analysis.verdict.tolerances import TOLERANCES as VERDICT
from mbstab.compiler.system import Array
from mbstab.records import dataclass

MINIMUM, MAXIMUM, MULTIPLE = 1, -1, 2
"""Extremum of the energy: a minimum, a maximum, a minimum with a multiple of a momentum added."""
EXTREMA: dict[int, Extremum] = {MINIMUM: "minimum", MAXIMUM: "maximum", MULTIPLE: "with a multiple"}

NOT_COUNTED = -1
"""Stands for the number of zeros where it was not asked for, or no gap tells it."""


@dataclass(frozen=True)
class Judged(Spectra):
    """Spectra of points of a pattern.

    Attributes
    ----------
    zeros : ndarray of int, shape (points,)
        Number of singular values of the matrices left to judge that are zero; `NOT_COUNTED` where the verdict is known.
    """

    zeros: Index


def judged(known: Known, points: Points, separation: Separation) -> Judged:
    """Return eigenvalues, their sides and verdicts of points of a pattern."""
    A, error = separation.A, separation.error
    size, r = A.shape[0], A.shape[-1]
    about: dict[str, Any] = {
        "mirrored": np.full(size, bool(known.mirrored)), "problems": {}, "neutral": known.neutral.count,
        "sizes": points.size, "motion": np.hstack([points.q, points.u]), "zeros": np.full(size, NOT_COUNTED),
    }  # fmt: skip
    if not r:
        empty = np.zeros((size, 0))
        words_ = _words(known, np.zeros((size, 5), dtype=int))
        return Judged(empty.astype(complex), empty.astype(np.int8), words_, **about)
    least = np.broadcast_to(error, (size,)) + r * EPS * np.linalg.norm(A, axis=(1, 2))
    minima = np.zeros(size, dtype=int)
    counts = known.stiffness(points, r)
    if counts is not None:
        values = eigenvalues(A)
        sides, minima = _by_stiffness(values, counts)
    else:
        mirrored = bool(known.mirrored)
        values, sides = placed(A, least, mirrored)
        if mirrored:
            sides[~known.regular(points, separation.B)[:, None] & (sides == AXIS)] = OPEN
        if known.minimum:
            asked = np.flatnonzero(~np.any(sides == RIGHT, axis=1) & ~np.all(sides == LEFT, axis=1))
            if len(asked):
                some = len(asked) < size
                minima[asked] = _minima(known, *((points.at(asked), A[asked]) if some else (points, A)))
                if known.grounds.structure.work.conserved:
                    sides[minima != 0] = AXIS
    words_ = words(known, sides, minima)
    asked = np.flatnonzero(words_ == WORD[UNDECIDED])
    about["zeros"][asked] = _zeros(A[asked])
    return Judged(values, sides, words_, **about)


def _zeros(A: Array) -> Index:
    """Return the numbers of singular values of matrices that are zero, as where a family of motions is searched."""
    s = np.linalg.svd(A, compute_uv=False)
    limit = VERDICT.family_singular_value * s[:, 0]
    count: Index = np.sum(s <= limit[:, None], axis=1)
    least = np.min(s, axis=1, where=s > limit[:, None], initial=np.inf)
    return np.where(least >= ALGEBRA.rank_gap * limit, count, NOT_COUNTED)


def words(known: Known, sides: Sides, minima: Index) -> npt.NDArray[np.int8]:
    """Return the verdicts of points: one call of `judge` for each class of them.

    Parameters
    ----------
    minima : ndarray of int, shape (points,)
        `MINIMUM`, `MAXIMUM`, or `MULTIPLE` where the energy has such an extremum; else 0.
    """
    classes = np.stack([*(np.sum(sides == x, axis=1) for x in (RIGHT, LEFT, AXIS, OPEN)), minima], axis=1)
    return _words(known, classes)


def _words(known: Known, classes: Index) -> npt.NDArray[np.int8]:
    bases = np.max(classes, axis=0) + 2
    key = np.ravel_multi_index(tuple((classes + 1).T), tuple(bases + 1))
    _, first, which = np.unique(key, return_index=True, return_inverse=True)
    kinds = classes[first]
    found = [WORD[judge(_facts(known, kind[:4].tolist(), int(kind[4]))).word] for kind in kinds]
    return np.array(found, dtype=np.int8)[which.reshape(-1)]


def _facts(known: Known, counts: list[int], minimum: int) -> Facts:
    """Return the facts of a class of points, by the number of eigenvalues on each side."""
    discs = [
        Disc(0j, float("inf") if side == OPEN else 0.0, 1, NAMES[side], known.mirrored if side == AXIS else "")
        for side, count in zip((RIGHT, LEFT, AXIS, OPEN), counts, strict=True)
        for _ in range(count)
    ]
    total = len(discs) + known.neutral.count
    energy: Callable[[], Minimum | None] = lambda: None  # noqa: E731
    if minimum:
        whole = known.in_place and minimum != MULTIPLE
        energy = lambda: Minimum("the energy", True, whole, EXTREMA[minimum])  # noqa: E731
    return Facts(
        total,
        total,
        tuple(discs),
        known.neutral,
        rough=known.rough,
        resisted=known.grounds.resisted,
        minimum=energy,
        reversible=known.grounds.reversible,
    )


# --- eigenvalues ------------------------------------------------------------------------------------------------------


def eigenvalues(A: Array) -> Complex:
    """Return the eigenvalues of matrices, shape (points, r, r); slow ones beside fast ones from the inverse."""
    return eigenpairs(A, TOLERANCES.slow_eigenvalue, False, TOLERANCES.inverse_departure)[0]


def placed(A: Array, error: Array, mirrored: bool) -> tuple[Complex, Sides]:
    """Return eigenvalues, and their sides by discs of Y A V, with a basis V of eigenvectors and Y = V⁻¹.

    Vectors of several eigenvalues near zero are nearly parallel: a basis of their span
    replaces them.

    Parameters
    ----------
    A : ndarray, shape (points, r, r)
    error : ndarray, shape (points,)
        Norm of the rounding error of A (1/s).
    mirrored : bool
        Whether the spectrum is symmetric about the imaginary axis by structure.
    """
    values, W = eigenpairs(A, TOLERANCES.slow_eigenvalue, True, TOLERANCES.inverse_departure)
    sides = np.full(A.shape[:2], OPEN, dtype=np.int8)
    _place(A, values, W, error, mirrored, sides, np.arange(len(A)))
    small = np.abs(values) <= TOLERANCES.unexplained_zero * np.linalg.norm(A, axis=(1, 2))[:, None]
    number = np.sum(small, axis=1)
    doubtful = np.any((sides == OPEN) & ~small, axis=1)
    for k in np.unique(number[doubtful & (number > 1) & (number < A.shape[-1])]).tolist():
        index = np.flatnonzero(doubtful & (number == k))
        order = np.argsort(small[index], axis=1, kind="stable")
        values[index] = np.take_along_axis(values[index], order, axis=1)
        V = _beside_zeros(A[index], np.take_along_axis(W[index], order[:, None, :], axis=2), error[index], k)
        _place(A, values, V, error, mirrored, sides, index)
    return values, sides


def _place(A: Array, values: Complex, V: Complex, error: Array, mirrored: bool, sides: Sides, index: Index) -> None:
    """Set the sides of eigenvalues of some points by discs of Y A V; V is for these points, the rest for all."""
    r = A.shape[-1]
    Y = _inverse(V)
    with np.errstate(all="ignore"):
        good = np.linalg.norm(Y, axis=(1, 2)) < TOLERANCES.parallel_vectors
    Y, V, index = Y[good], V[good], index[good]
    if not len(index):
        return
    A, error = A[index], error[index]
    F = Y @ (A @ V)
    each = np.arange(r)
    centres = F[:, each, each].copy()
    F[:, each, each] = 0.0
    lengths = np.linalg.norm(Y, axis=2), np.linalg.norm(V, axis=1)
    sums = np.sum(lengths[1], axis=1)
    # Products of Y, A and V have some roundings of their sizes as errors, which ε includes.
    radii = np.sum(np.abs(F), axis=2) + 2.0 * error[:, None] * lengths[0] * sums[:, None]
    # Conjugate pairs stay conjugate.
    real = values[index].imag == 0.0
    centres = np.where(real, centres.real, centres)
    gaps = np.abs(centres[:, :, None] - centres[:, None, :])
    gaps[:, each, each] = np.inf
    found = sides_of(centres, TOLERANCES.bounds_from_axis * radii, mirrored)
    # Where discs overlap, their eigenvalues have a side only if all discs lie on the same side.
    meet = gaps <= radii[:, :, None] + radii[:, None, :]
    found[(found == AXIS) & np.any(meet, axis=2)] = OPEN
    while np.any(lost := (found != OPEN) & np.any(meet & (found[:, None, :] != found[:, :, None]), axis=2)):
        found[lost] = OPEN
    # It corrects slow eigenvalues beside fast ones; the others are already as accurate. Of those whose discs meet, the
    # sum is known much better than each of them.
    size = np.abs(values[index])
    slow = size < TOLERANCES.slow_eigenvalue * np.max(size, axis=1, keepdims=True)
    slow &= ~np.any(meet, axis=2)
    values[index], sides[index] = np.where(slow, centres, values[index]), found


def _beside_zeros(A: Array, W: Complex, error: Array, k: int) -> Complex:
    """Return bases: eigenvectors, and a basis of the span of those of the last k eigenvalues.

    Eigenvectors that are not parallel divide A into their own block and the block C of the k. In
    coordinates in which C is triangular, each one is scaled so that the coupling within
    the block and the rounding of A are of the same size.
    """
    m = A.shape[-1] - k
    Q = np.linalg.qr(W[..., :m], mode="complete")[0]
    whole = np.conj(np.swapaxes(Q, 1, 2)) @ A @ Q
    own, coupling, C = whole[:, :m, :m], whole[:, :m, m:], whole[:, m:, m:]
    # own X − X C = −coupling, column by column of X.
    blocks = np.einsum("pij,kl->pkilj", own, np.eye(k)) - np.einsum("plk,ij->pkilj", C, np.eye(m))
    right = -np.swapaxes(coupling, 1, 2).reshape(len(A), m * k, 1)
    try:
        X = np.linalg.solve(blocks.reshape(len(A), m * k, m * k), right)
    except np.linalg.LinAlgError:
        return W
    X = np.swapaxes(X.reshape(len(A), k, m), 1, 2)
    span = Q[..., :m] @ X + Q[..., m:]
    span = span @ np.linalg.qr(np.linalg.eig(C)[1])[0]
    size = np.linalg.norm(C, axis=(1, 2)) + 1e-300
    units = np.minimum((error / size) ** (1.0 / k), 1.0)[:, None] ** np.arange(k)
    return np.concatenate([W[..., :m], span * units[:, None, :]], axis=2)


def _inverse(W: Complex) -> Complex:
    """Return inverses of matrices, inf where there is none."""
    try:
        return np.asarray(np.linalg.inv(W), dtype=complex)
    except np.linalg.LinAlgError:
        regular = np.linalg.svd(W, compute_uv=False)[:, -1] > EPS
        found = np.full(W.shape, np.inf, dtype=complex)
        found[regular] = np.linalg.inv(W[regular])
        return found


# --- a stiffness alone ------------------------------------------------------------------------------------------------


def _by_stiffness(values: Complex, counts: Array) -> tuple[Sides, Index]:
    """Return sides by the number of negative eigenvalues of the stiffness, and where it is definite."""
    size, r = values.shape
    negative, doubtful = counts[:, 1], counts[:, 2]
    order = np.argsort(np.argsort(-values.real, axis=1, kind="stable"), axis=1, kind="stable")
    sides = np.full((size, r), AXIS, dtype=np.int8)
    sides[order < negative[:, None]] = RIGHT
    sides[order >= r - negative[:, None]] = LEFT
    # Values that contradict the count have no correct digits.
    wrong = np.any((sides == RIGHT) & (values.real <= np.abs(values.imag)), axis=1)
    sides[(doubtful > 0) | wrong] = OPEN
    return sides, np.where((negative == 0) & (doubtful == 0), MINIMUM, 0)


def _minima(known: Known, points: Points, A: Array) -> Index:
    """Return where the energy has a minimum or a maximum, 0 elsewhere."""
    counts = known.inertia(points)
    m = counts.sum(axis=1)
    definite = np.where(counts[:, 0] == m, MINIMUM, 0)
    if known.grounds.structure.work.conserved:
        definite = np.where((counts[:, 1] == m) & (m > 0), MAXIMUM, definite)
        rest = np.flatnonzero(definite == 0)
        if known.idle and len(rest):
            definite[rest] = np.where(known.with_a_multiple(points.at(rest), A[rest]), MULTIPLE, 0)
    result: Index = definite
    return result
