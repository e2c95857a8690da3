"""Derivatives of a refined answer by many variables: `mbstab.model.duals.Dual` numbers in arrays.

Newton's method on these numbers, with a Jacobian in double precision, leaves the values as they are and makes the
slopes those of the implicit function: each step divides their error by the accuracy of the Jacobian.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import reduce
from typing import Any

import numpy as np

from mbstab.analysis.algebra.refining import Matrix, Refining, Stalled
from mbstab.analysis.algebra.tolerances import EPS, TOLERANCES
from mbstab.compiler.system import Array
from mbstab.model.arithmetic import FLOAT
from mbstab.model.duals import Dual, dual_arithmetic

Parts = tuple[Array, Array]


class Slopes(Refining):
    """Arrays of floats and of numbers with slopes.

    Parameters
    ----------
    sizes : ndarray, shape (variables,)
        Sizes of the variables: slopes count relative to the values that they change by so much of a variable.
    """

    zero = 0.0

    def __init__(self, sizes: Array) -> None:
        self.count, self.sizes = len(sizes), sizes

    def parts(self, x: Any) -> Parts:
        """Return the values of an array, shape (…), and their slopes, shape (count, …)."""
        x = np.asarray(x)
        if x.dtype != object:
            return x, np.broadcast_to(0.0, (self.count, *x.shape))
        flat = x.ravel().tolist()
        slopes = np.zeros((self.count, len(flat)))
        for i, entry in enumerate(flat):
            if entry.__class__ is Dual:
                slopes[:, i] = entry.slope
        values = np.array([float(entry) for entry in flat], dtype=float)
        return values.reshape(x.shape), slopes.reshape(self.count, *x.shape)

    def joined(self, values: Array, slopes: Array) -> Matrix:
        """Return an array from its parts."""
        values = np.asarray(values)
        slopes = np.broadcast_to(slopes, (self.count, *values.shape)).reshape(self.count, -1)
        found: Matrix = values.ravel().astype(object)
        for i in np.flatnonzero(slopes.any(axis=0)).tolist():
            found[i] = Dual(found[i], slopes[:, i].copy())
        return found.reshape(values.shape)

    def exact(self, x: Any) -> Matrix:
        """Return an array of objects; floats have no slope."""
        return np.array(x, dtype=object)

    def values(self, x: Matrix) -> Matrix:
        """Return an array without slopes."""
        return self.parts(x)[0]

    def zeros(self, *shape: int) -> Matrix:
        """Return an array of zeros."""
        return np.full(shape, 0.0, dtype=object)

    def largest(self, x: Any) -> Any:
        """Return the largest absolute value of the entries, 0 if there are none."""
        return max((abs(float(value)) for value in np.asarray(x, dtype=object).flat), default=0.0)

    def sqrt(self, x: Any) -> Any:
        """Return a square root."""
        return dual_arithmetic(FLOAT).sqrt(x)

    def times(self, *factors: Any) -> Matrix:
        """Return a matrix product, at the cost of some products of floats."""
        return self.joined(*reduce(_product, map(self.parts, factors)))

    def applied(self, operator: Matrix, x: Matrix) -> Matrix:
        """Return operator @ x."""
        return self.times(operator, x)

    def polished(self, start: Matrix, correction: Callable[[Matrix], Matrix], floor: float = 0.0) -> Matrix:
        """Return start plus corrections, repeated until values and slopes change by rounding only; see `Refining`."""
        x, before = start, 1.0
        for number in range(TOLERANCES.slope_steps):
            step = correction(x)
            x = x + step
            moved = self._size(step) / (max(self._size(x), floor) or 1.0)
            # Another step would be smaller by the same factor. The slopes follow the values, a step later.
            if number and moved * (moved / before) <= EPS:
                return x
            if number > 1 and moved > before / 3.0:
                if moved <= TOLERANCES.slope_rounding:
                    return x
                break
            before = max(moved, EPS)
        raise Stalled(moved)

    def _size(self, x: Matrix) -> float:
        """Return the largest value, or change by the size of a variable, in an array."""
        values, slopes = self.parts(x)
        changes = np.abs(slopes.reshape(self.count, -1)) * self.sizes[:, None]
        return float(max(np.max(np.abs(values), initial=0.0), np.max(changes, initial=0.0)))


def _product(one: Parts, other: Parts) -> Parts:
    """Return the product of matrices with its slopes, at the cost of some products of floats."""
    (a, da), (b, db) = one, other
    slopes = np.zeros((len(da), *(a @ b).shape))
    if da.any():
        slopes = slopes + da @ b
    if db.any():
        # A vector with slopes is a row for each variable.
        slopes = slopes + (a @ db if b.ndim > 1 else (db @ a.T if a.ndim > 1 else db @ a))
    return a @ b, slopes
