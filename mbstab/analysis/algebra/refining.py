"""What refines an answer in double precision: arrays of other numbers, corrected with an inverse in double precision.

`mbstab.analysis.algebra.digits.MANY_DIGITS` adds digits, `mbstab.analysis.algebra.slopes.Slopes` derivatives.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from mbstab.compiler.system import Array

Matrix = npt.NDArray[Any]
"""An array of objects: numbers with many digits, or with slopes."""


class Stalled(Exception):
    """Refinement stalled before the end; `reached` is the size of the last step."""

    def __init__(self, reached: float) -> None:
        self.reached = reached


class Refining:
    """Arrays of numbers that can be refined; also an `mbstab.analysis.algebra.deflation.Algebra`."""

    zero: Any

    def exact(self, x: Any) -> Matrix:
        """Return an array of such numbers; floats keep their value."""
        raise NotImplementedError

    def values(self, x: Matrix) -> Matrix:
        """Return an array without slopes."""
        return x

    def zeros(self, *shape: int) -> Matrix:
        """Return an array of zeros."""
        raise NotImplementedError

    def largest(self, x: Any) -> Any:
        """Return the largest absolute value of the entries, 0 if there are none."""
        raise NotImplementedError

    def sqrt(self, x: Any) -> Any:
        """Return a square root."""
        raise NotImplementedError

    def times(self, *factors: Any) -> Matrix:
        """Return a matrix product, with zeros where an inner dimension is 0."""
        raise NotImplementedError

    def applied(self, operator: Matrix, x: Matrix) -> Matrix:
        """Return operator @ x to double precision, relative to the size of x."""
        raise NotImplementedError

    def polished(self, start: Matrix, correction: Callable[[Matrix], Matrix], floor: float = 0.0) -> Matrix:
        """Return start plus corrections, repeated until they are rounding.

        Parameters
        ----------
        start : ndarray of objects
        correction : callable
            Returns the next correction of an approximation.
        floor : float
            Scale of the numbers where they vanish.

        Raises
        ------
        Stalled
            If the corrections stop shrinking while they are larger than rounding.
        """
        raise NotImplementedError

    def plus(self, *terms: Matrix) -> Matrix:
        """Return a sum of matrices."""
        return self.exact(sum(terms[1:], terms[0]))

    def transposed(self, A: Matrix) -> Matrix:
        """Return Aᵀ."""
        return A.T

    def solved(self, A: Matrix, B: Matrix, inverse: Array) -> Matrix:
        """Return X with A X = B from an approximate (pseudo-)inverse of A."""
        start = self.zeros(*inverse.shape[:1], *np.shape(B)[1:])
        return self.polished(start, lambda X: self.applied(inverse, B - self.times(A, X)))

    def null_space(self, A: Matrix, start: Array, inverse: Array) -> Matrix:
        """Return a basis of the null space from a basis and a pseudo-inverse in double precision.

        Raises
        ------
        Stalled
            If A has a larger rank than in double precision.
        """
        return self.polished(self.exact(start), lambda N: -self.applied(inverse, self.times(A, N)), 1.0)
