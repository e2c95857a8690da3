"""How much cancels in the sums of which the linearized equations consist, sampled at some points of a sweep."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from mbstab.analysis.algebra.arrays import Index
from mbstab.analysis.sweep.data_errors import EntryErrors, Samples, data_errors
from mbstab.analysis.sweep.tolerances import TOLERANCES
from mbstab.compiler.system import Array
from mbstab.errors import MbstabError
from mbstab.records import dataclass


@dataclass(frozen=True)
class Cancellation:
    """How much cancels in the equations of points.

    Attributes
    ----------
    terms : Samples
        How much larger the terms of the matrices are than their sums: the ratio of norms, and the terms of each entry
        of K by the norm of K, as what cancels in one entry may be small beside another.
    data : Samples
        What cancels in the numbers of the file themselves, as `EntryErrors` that are left of it.
    """

    terms: Samples
    data: Samples

    def at(self, part: Any) -> Cancellation:
        """Return that of some of the points."""
        return Cancellation(self.terms.at(part), self.data.at(part))

    def largest(self, other: Cancellation | None) -> Cancellation:
        """Return one sample with the largest values of all samples, here and elsewhere."""
        terms, data = (None, None) if other is None else (other.terms, other.data)
        return Cancellation(self.terms.largest(terms), self.data.largest(data))


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
    numbers, *parts = (np.concatenate(x) for x in zip(*found, strict=True))
    return Cancellation(Samples.of(numbers, parts, points), data)


def _sampled(terms: Callable[[Index], tuple[Array, Array]], some: Index) -> Iterator[tuple[Index, Array, Array]]:
    try:
        yield some, *terms(some)
    except (MbstabError, ArithmeticError, np.linalg.LinAlgError):
        if len(some) > 1:
            half = len(some) // 2
            yield from _sampled(terms, some[:half])
            yield from _sampled(terms, some[half:])
