"""How much cancels in the sums of which the linearized equations consist, sampled at some points of a sweep."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from mbstab.analysis.algebra.arrays import Index
from mbstab.analysis.sweep.data_errors import DataErrors, EntryErrors, data_errors
from mbstab.analysis.sweep.tolerances import TOLERANCES
from mbstab.compiler.system import Array
from mbstab.errors import MbstabError
from mbstab.records import dataclass


@dataclass(frozen=True)
class Cancellation:
    """How much larger the terms of the matrices are than their sums, known at some of the points: the samples.

    Attributes
    ----------
    ratio : ndarray, shape (samples,)
        Of norms.
    stiffness : ndarray, shape (samples, n_q, n_q)
        Terms of each entry of K by the norm of K: what cancels in one entry may be small beside another.
    right : ndarray of int, shape (points,)
        Number of the first sample that is not left of each point.
    data : DataErrors
        What cancels in the numbers of the file themselves, as errors that are left of it.
    """

    ratio: Array
    stiffness: Array
    right: Index
    data: DataErrors

    def at(self, part: Any) -> Cancellation:
        """Return that of some of the points."""
        return Cancellation(self.ratio, self.stiffness, self.right[part], self.data.at(part))

    def larger(self) -> tuple[Array, Array]:
        """Return for each point the ratio and the terms of the stiffness: the larger ones of its two samples."""
        if len(self.ratio) == 1:
            return self.ratio, self.stiffness
        left = self.right - 1
        return (
            np.maximum(self.ratio[left], self.ratio[self.right]),
            np.maximum(self.stiffness[left], self.stiffness[self.right]),
        )

    def largest(self, other: Cancellation | None) -> Cancellation:
        """Return one sample with the largest values of all samples, here and elsewhere."""
        both = (self,) if other is None else (self, other)
        ratio = np.max([np.max(x.ratio) for x in both])
        stiffness = np.max([np.max(x.stiffness, axis=0) for x in both], axis=0)
        data = self.data.largest(None if other is None else other.data)
        return Cancellation(np.array([ratio]), stiffness[None], np.zeros(1, dtype=int), data)


def sampled(
    terms: Callable[[Index], tuple[Array, Array]], points: int, errors: Callable[[int], EntryErrors | None]
) -> Cancellation | None:
    """Return how much cancels at points, by those of them that have a scene; None if none of the samples has.

    Parameters
    ----------
    terms : callable
        Returns the ratios and the terms of the stiffness of points, given by their numbers.
    points : int
    errors : callable
        Returns the error bounds of a point, given by its number, or None.
    """
    some = np.unique(np.linspace(0, points - 1, TOLERANCES.points_with_terms).round().astype(int))
    found, data = list(_sampled(terms, some)), data_errors(errors, points)
    if not found or data is None:
        return None
    samples, ratio, stiffness = (np.concatenate(x) for x in zip(*found, strict=True))
    right = np.clip(np.searchsorted(samples, np.arange(points)), min(1, len(samples) - 1), len(samples) - 1)
    return Cancellation(ratio, stiffness, right, data)


def _sampled(terms: Callable[[Index], tuple[Array, Array]], some: Index) -> Iterator[tuple[Index, Array, Array]]:
    try:
        yield some, *terms(some)
    except (MbstabError, ArithmeticError, np.linalg.LinAlgError):
        if len(some) > 1:
            half = len(some) // 2
            yield from _sampled(terms, some[:half])
            yield from _sampled(terms, some[half:])
