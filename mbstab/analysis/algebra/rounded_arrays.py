"""Arrays of numbers with error bounds, for all elements of a large scene at once."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import Any

import numpy as np

from mbstab.analysis.algebra.rounded import FUNCTION, UNIT, Rounded, WithErrors, rounded_arithmetic, value_and_error
from mbstab.compiler.grouped import Form, Numbers, Pattern
from mbstab.compiler.system import Array
from mbstab.model.arithmetic import Arithmetic
from mbstab.model.functions import TABLE


class RoundedArray:
    """Floats `v` that differ from the true numbers by no more than `e`, each as `Rounded`."""

    __slots__ = ("e", "v")
    __array_ufunc__ = None

    def __init__(self, v: Array, e: Array) -> None:
        self.v, self.e = v, e

    @classmethod
    def of(cls, values: Any) -> RoundedArray:
        """Return numbers, with errors or exact, as an array."""
        pairs = np.array([value_and_error(x) for x in values], dtype=float).reshape(-1, 2)
        return cls(pairs[:, 0], pairs[:, 1])

    def __getitem__(self, index: Any) -> RoundedArray:
        return RoundedArray(self.v[index], self.e[index])

    def __iter__(self) -> Iterator[RoundedArray]:
        return (RoundedArray(v, e) for v, e in zip(self.v, self.e, strict=True))

    def tolist(self) -> list[Any]:
        """Return numbers; exact ones as plain floats."""
        return [Rounded(v, e) if e else v for v, e in zip(self.v.tolist(), self.e.tolist(), strict=True)]

    def __add__(self, other: Any) -> RoundedArray:
        if other.__class__ is float and not other:
            return self
        b, e = _parts(other)
        v = self.v + b
        return RoundedArray(v, self.e + e + UNIT * np.abs(v))

    __radd__ = __add__

    def __sub__(self, other: Any) -> RoundedArray:
        if other.__class__ is float and not other:
            return self
        b, e = _parts(other)
        v = self.v - b
        return RoundedArray(v, self.e + e + UNIT * np.abs(v))

    def __rsub__(self, other: Any) -> RoundedArray:
        if other.__class__ is float and not other:
            return -self
        difference = self - other
        return RoundedArray(-difference.v, difference.e)

    def __mul__(self, other: Any) -> Any:
        if other.__class__ is float and other in (0.0, 1.0):
            return self if other else 0.0
        b, e = _parts(other)
        v = self.v * b
        return RoundedArray(v, np.abs(self.v) * e + (np.abs(b) + e) * self.e + UNIT * np.abs(v))

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> RoundedArray:
        return _quotient(self.v, self.e, *_parts(other))

    def __rtruediv__(self, other: Any) -> RoundedArray:
        return _quotient(*_parts(other), self.v, self.e)

    def __pow__(self, exponent: Any) -> RoundedArray:
        result: RoundedArray = _each("power")(self, exponent)
        return result

    def __neg__(self) -> RoundedArray:
        return RoundedArray(-self.v, self.e)

    def __abs__(self) -> RoundedArray:
        return RoundedArray(np.abs(self.v), self.e)


def _parts(x: Any) -> tuple[Any, Any]:
    return (x.v, x.e) if isinstance(x, RoundedArray) else value_and_error(x)


def _quotient(a: Any, d: Any, b: Any, e: Any) -> RoundedArray:
    v = a / b
    left = np.abs(b) - e
    error = np.where(left > 0.0, (d + np.abs(v) * e) / left + UNIT * np.abs(v), np.inf)
    return RoundedArray(v, error)


def _each(name: str) -> Any:
    """Return a function of arrays from the function of single numbers."""
    one = getattr(rounded_arithmetic(), name)

    def function(*arguments: Any) -> Any:
        lengths = [len(x.v) for x in arguments if isinstance(x, RoundedArray)]
        if not lengths:
            return one(*arguments)
        rows = [x.tolist() if isinstance(x, RoundedArray) else [x] * lengths[0] for x in arguments]
        return RoundedArray.of(map(one, *rows))

    return function


def _wave(function: Any, slope: Any, one: Any) -> Any:
    """Return the sine or the cosine, whose slope is at most 1 and changes no faster than its argument."""

    def wave(x: Any) -> Any:
        if not isinstance(x, RoundedArray):
            return one(x)
        v, d = function(x.v), x.e
        error = np.minimum(1.0, np.abs(slope(x.v)) + d) * d + FUNCTION * np.abs(v)
        return RoundedArray(v, np.where((x.v == 0.0) & (d == 0.0), 0.0, error))

    return wave


@cache
def _arithmetic() -> Arithmetic:
    plain = rounded_arithmetic()
    names = ["power", "signed", *(name for name, entry in TABLE.items() if entry.formula is None)]
    functions = {name: _each(name) for name in names}
    functions |= {"sin": _wave(np.sin, np.cos, plain.sin), "cos": _wave(np.cos, np.sin, plain.cos)}
    return Arithmetic("rounded", plain.number, plain.constants, functions)


class RoundedNumbers(Numbers):
    """Numbers with errors in large scenes."""

    def state(self, x: Any) -> Any:
        """Return a vector with one fixed coordinate appended."""
        return RoundedArray.of([*x, 0.0])

    def together(self, values: tuple[Any, ...]) -> Any:
        """Return the same number of all elements, or all of them."""
        first = value_and_error(values[0])
        return values[0] if all(value_and_error(x) == first for x in values) else RoundedArray.of(values)

    def arithmetic(self, arguments: list[Any]) -> Arithmetic:
        """Return the number system in which elements are evaluated."""
        return _arithmetic()

    def stacked(self, found: Any, count: int) -> Array:
        """Return values and errors, shape (2, outputs, elements)."""
        result = np.empty((2, len(found), count))
        for i, value in enumerate(found):
            result[0, i], result[1, i] = _parts(value)
        return result

    def filled(self, pattern: Pattern, layers: list[Array], form: Form) -> WithErrors:
        """Return a vector or a matrix with its error bounds, including those of summing its terms."""
        v, e = layers
        summed = pattern.filled(UNIT * np.abs(v), form, weighted=True)
        return WithErrors(pattern.filled(v, form), pattern.filled(e, form) + summed)
