"""How much the rounding of the numbers of a file changes the linearized equations of a sweep, at some of its points.

Terms that cancel inside one written number, such as a + b - c, leave their rounding, which no evaluation of the
equations shows. It is propagated at the ends of a sweep (`mbstab.analysis.linear.roundings`), and between them where
it differs much. What is open for it is judged point by point, each with its own bounds.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from mbstab.analysis.algebra.arrays import Index
from mbstab.analysis.algebra.tolerances import EPS
from mbstab.analysis.linear.linearize import Linearization
from mbstab.analysis.linear.roundings import roundings
from mbstab.analysis.sweep.tolerances import TOLERANCES
from mbstab.compiler.system import Array
from mbstab.records import dataclass


@dataclass(frozen=True)
class Samples:
    """Bounds that are known at some of the points of a sweep: the samples.

    Attributes
    ----------
    right : ndarray of int, shape (points,)
        Number of the first sample that is not left of each point.
    parts : tuple of ndarray, shape (samples, …)
    """

    right: Index
    parts: tuple[Array, ...]

    @classmethod
    def of(cls, numbers: Any, parts: Iterable[Array], points: int) -> Samples:
        """Return samples at points given by their ascending numbers."""
        last = len(numbers) - 1
        return cls(np.clip(np.searchsorted(numbers, np.arange(points)), min(1, last), last), tuple(parts))

    def at(self, part: Any) -> Samples:
        """Return those of some of the points."""
        return Samples(self.right[part], self.parts)

    def larger(self) -> tuple[Array, ...]:
        """Return for each point the larger ones of its two samples, shape (1, …) where there is one sample."""
        if len(self.parts[0]) == 1:
            return self.parts
        return tuple(np.maximum(x[self.right - 1], x[self.right]) for x in self.parts)

    def largest(self, other: Samples | None) -> Samples:
        """Return one sample with the largest values of all samples, here and elsewhere."""
        both = (self,) if other is None else (self, other)
        parts = zip(*(x.parts for x in both), strict=True)
        return Samples(np.zeros(1, dtype=int), tuple(np.max(np.concatenate(x), axis=0)[None] for x in parts))


class EntryErrors(NamedTuple):
    """Error bounds of the linearized equations at one point.

    Attributes
    ----------
    stiffness, damping : ndarray, shape (n_q, n_q)
        Of the entries of K and R, in coordinates of the file.
    ratio : ndarray, shape ()
        Of M and the rows, relative to the rounding of their norms that is taken into account anyway; at least 1.
    """

    stiffness: Array
    damping: Array
    ratio: Array

    @property
    def size(self) -> float:
        """A size to compare those of two points by."""
        return float(np.linalg.norm(self.stiffness) + np.linalg.norm(self.damping))


def data_errors(errors: Callable[[int], EntryErrors | None], points: int) -> Samples | None:
    """Return `EntryErrors` of points of a sweep, from some of them; None if none of these has any.

    Parameters
    ----------
    errors : callable
        Returns the bounds of a point, given by its number, or None.
    points : int
    """
    known: dict[int, EntryErrors | None] = {}
    tried = np.unique(np.linspace(0, points - 1, TOLERANCES.points_tried_for_errors).round().astype(int)).tolist()
    for order in (tried, tried[::-1]):  # the first and the last that has any
        for i in order:
            if i not in known:
                known[i] = errors(i)
            if known[i] is not None:
                break
    while len(known) < TOLERANCES.points_with_errors and (between := _between(known)) is not None:
        known[between] = errors(between)
    samples = {i: found for i, found in sorted(known.items()) if found is not None}
    if not samples:
        return None
    return Samples.of(list(samples), (np.array(x) for x in zip(*samples.values(), strict=True)), points)


def _between(known: Mapping[int, EntryErrors | None]) -> int | None:
    """Return a point between two samples whose bounds differ most, if they differ much; None if there is none."""
    sizes = [(i, errors.size) for i, errors in sorted(known.items()) if errors is not None]
    gaps = [
        (max(a, b) / max(min(a, b), 1e-300), (i + j) // 2)
        for (i, a), (j, b) in pairwise(sizes)
        if (i + j) // 2 not in known
    ]
    largest, middle = max(gaps, default=(0.0, 0))
    return middle if largest > TOLERANCES.errors_alike else None


def entry_errors(linear: Linearization) -> EntryErrors:
    """Return the error bounds of linearized equations; those of the rows are added to the matrices."""
    with np.errstate(all="ignore"):
        known = roundings(linear)
    spaces, n_h = linear.spaces, linear.n_h
    both, rows = spaces.scale * spaces.scale[:, None], spaces.scale * spaces.row_scale[:, None]
    J, D_q = known.errors.J * rows, known.errors.D_q * rows[n_h:]
    M, R, K = (
        _beside_rows(x * both, error * both, spaces.C.pseudo_inverse, J[:n_h])
        for x, error in zip(linear.matrices[:3], known.errors[:3], strict=True)
    )
    allowed = spaces.N @ spaces.N.T
    for changes in known.displaced:
        R, K = (x + np.abs(allowed @ (change * both) @ allowed) for x, change in ((R, changes.R), (K, changes.K)))
    pairs = (M, linear.M * both), (J[n_h:], linear.J[n_h:] * rows[n_h:]), (D_q, linear.D_q * rows[n_h:])
    ratios = [float(np.linalg.norm(error) / np.linalg.norm(x)) for error, x in pairs if np.any(x)]
    ratio = np.array(max([1.0, *(x / (TOLERANCES.roundings_of_matrix * EPS) for x in ratios)]))
    return EntryErrors(
        *(
            np.nan_to_num(x, nan=TOLERANCES.unknown_error, posinf=TOLERANCES.unknown_error)
            for x in (K / both, R / both, ratio)
        )
    )


def _beside_rows(x: Array, error: Array, inverse: Array, rows: Array) -> Array:
    """Return the error of a matrix on the allowed motions, which errors of rows change by −J⁺ δJ, to first order."""
    return error + np.abs(x @ inverse) @ rows + (np.abs(x.T @ inverse) @ rows).T
