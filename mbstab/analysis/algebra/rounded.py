"""Numbers with error bounds."""

from __future__ import annotations

import math
from fractions import Fraction
from functools import cache, lru_cache
from typing import Any

from mbstab.analysis.algebra.tolerances import EPS
from mbstab.model.arithmetic import CONSTANTS, FLOAT, KINK, Arithmetic, as_float
from mbstab.model.functions import TABLE
from mbstab.records import dataclass

UNIT = 0.5 * EPS
"""Rounding of one operation, relative to its result."""

FUNCTION = 2.0 * EPS
"""Rounding of sines and the like."""

WHOLE = 1 << 53
"""Whole numbers below it are exact."""

PLAIN = (float, int)
"""Numbers that are exact, and what is done with them alone is taken as exact, too."""


class Rounded:
    """A float `v` that differs from the true number by no more than `e`; plain 0 and 1 add no rounding."""

    __slots__ = ("e", "v")

    def __init__(self, v: float, e: float = 0.0) -> None:
        self.v, self.e = v, e

    def __add__(self, other: Any) -> Rounded:
        if other.__class__ is Rounded:
            v, e = self.v + other.v, self.e + other.e
            return Rounded(v, e + UNIT * abs(v) if e else _of_sum(self.v, other.v, v))
        if not isinstance(other, PLAIN):
            return NotImplemented
        if not other:
            return self
        v, e = self.v + other, self.e
        return Rounded(v, e + UNIT * abs(v) if e else _of_sum(self.v, other, v))

    __radd__ = __add__

    def __sub__(self, other: Any) -> Rounded:
        if other.__class__ is Rounded:
            v, e = self.v - other.v, self.e + other.e
            return Rounded(v, e + UNIT * abs(v) if e else _of_sum(self.v, -other.v, v))
        if not isinstance(other, PLAIN):
            return NotImplemented
        if not other:
            return self
        v, e = self.v - other, self.e
        return Rounded(v, e + UNIT * abs(v) if e else _of_sum(self.v, -other, v))

    def __rsub__(self, other: Any) -> Rounded:
        if not isinstance(other, PLAIN):
            return NotImplemented
        v, e = other - self.v, self.e
        return Rounded(v, (e + UNIT * abs(v) if e else _of_sum(other, -self.v, v)) if other else e)

    def __mul__(self, other: Any) -> Any:
        if other.__class__ is Rounded:
            a, b, d, e = self.v, other.v, self.e, other.e
            v = a * b
            return Rounded(v, abs(a) * e + (abs(b) + e) * d + UNIT * abs(v) if d or e else _of_product(a, b, v))
        if not isinstance(other, PLAIN):
            return NotImplemented
        if not other:
            return 0.0
        if other == 1.0:
            return self
        v, e = self.v * other, self.e
        return Rounded(v, e * abs(other) + UNIT * abs(v) if e else _of_product(self.v, other, v))

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Rounded:
        if other.__class__ is not Rounded and not isinstance(other, PLAIN):
            return NotImplemented
        return _quotient(self.v, self.e, *value_and_error(other))

    def __rtruediv__(self, other: Any) -> Rounded:
        return _quotient(*value_and_error(other), self.v, self.e)

    def __pow__(self, exponent: Any) -> Rounded:
        return _power(self, exponent)

    def __neg__(self) -> Rounded:
        return Rounded(-self.v, self.e)

    def __pos__(self) -> Rounded:
        return self

    def __abs__(self) -> Rounded:
        return Rounded(abs(self.v), self.e)

    def __float__(self) -> float:
        return float(self.v)

    def __bool__(self) -> bool:
        return bool(self.v)

    def __eq__(self, other: object) -> bool:
        return bool(self.v == _value(other))

    def __hash__(self) -> int:
        return hash(self.v)

    def __lt__(self, other: Any) -> bool:
        return bool(self.v < _value(other))

    def __le__(self, other: Any) -> bool:
        return bool(self.v <= _value(other))

    def __gt__(self, other: Any) -> bool:
        return bool(self.v > _value(other))

    def __ge__(self, other: Any) -> bool:
        return bool(self.v >= _value(other))

    def __repr__(self) -> str:
        return f"{self.v!r} ± {self.e:.1e}"


def _value(x: Any) -> Any:
    return x.v if x.__class__ is Rounded else x


def value_and_error(x: Any) -> tuple[float, float]:
    """Return a number and its error bound; a plain number is exact."""
    return (x.v, x.e) if x.__class__ is Rounded else (x, 0.0)


def _of_sum(a: float, b: float, v: float) -> float:
    """Return the rounding of the sum v of exact numbers, none where it is exact (Dekker 1971, Numer. Math. 18)."""
    return 0.0 if (v - a == b if abs(a) >= abs(b) else v - b == a) else UNIT * abs(v)


def _of_product(a: float, b: float, v: float) -> float:
    """Return the rounding of the product v of exact numbers, none of whole ones."""
    return 0.0 if abs(v) < WHOLE and a == int(a) and b == int(b) else UNIT * abs(v)


def _quotient(a: float, d: float, b: float, e: float) -> Rounded:
    v = a / b
    left = abs(b) - e
    return Rounded(v, (d + abs(v) * e) / left + UNIT * abs(v) if left > 0.0 else math.inf)


def _power(x: Any, n: Any) -> Rounded:
    (a, d), (p, e) = map(float, value_and_error(x)), map(float, value_and_error(n))
    v = math.pow(a, p)
    if not a and p > e:
        # Between 0 and the power of the largest base.
        return Rounded(v, max(d ** (p - e), d ** (p + e)))
    whole = a.is_integer() and p.is_integer() and p > 0.0 and abs(v) < WHOLE and not d and not e
    error = FUNCTION * abs(v) if p not in (1.0, 0.0) and not whole else 0.0
    if d and p:
        # By the mean value theorem, with the largest slope.
        ends = [abs(y) ** (p - 1.0) for y in (abs(a) - d, abs(a) + d) if y > 0.0 or p >= 1.0]
        error += abs(p) * d * max(ends) if len(ends) == 2 else math.inf
    if e:
        error += e * abs(v * math.log(abs(a))) * (1.0 + e) if a else math.inf
    return Rounded(v, error)


def _function(name: str) -> Any:
    """Return a function of one number from the function of floats and the bound of its slope."""
    plain, entry = getattr(FLOAT, name), TABLE[name]
    assert entry.steepest is not None
    steepest = entry.steepest

    def slope(x: float) -> float:
        try:
            return abs(float(entry.slopes(FLOAT, plain(x), x)[0]))
        except (ArithmeticError, ValueError):
            return math.inf

    def function(x: Any) -> Any:
        a, d = value_and_error(x)
        v = plain(a)
        if not a and not d:
            return v
        # By the mean value theorem.
        return Rounded(v, (steepest(slope, a, d) * d if d else 0.0) + FUNCTION * abs(v))

    return function


def _sqrt(x: Any) -> Rounded:
    a, d = value_and_error(x)
    v = math.sqrt(a)
    if not d:
        return Rounded(v, UNIT * v)
    error = d / (v + math.sqrt(a - d)) if a > d else math.sqrt(a + d)
    return Rounded(v, error + UNIT * v)


def _atan2(y: Any, x: Any) -> Rounded:
    (b, e), (a, d) = value_and_error(y), value_and_error(x)
    v = math.atan2(b, a)
    left = math.hypot(a, b) - math.hypot(d, e)
    # By the mean value theorem, with the slopes x/r² and y/r².
    slopes = ((abs(a) + d) * e + (abs(b) + e) * d) / left**2 if left > 0.0 else math.inf
    return Rounded(v, (slopes if d or e else 0.0) + FUNCTION * abs(v))


def _signum(x: Any) -> float:
    a, _ = value_and_error(x)
    return float(a > 0.0) - float(a < 0.0)


def _abs_slope(x: Any) -> float:
    a, _ = value_and_error(x)
    if a == 0.0:
        raise ValueError(KINK)
    return math.copysign(1.0, a)


def _signed(x: Any, y: Any) -> Rounded:
    (a, d), (b, e) = value_and_error(x), value_and_error(y)
    # Where the sign is not known, it is that of b or the other one.
    return Rounded(a * _abs_slope(b), d + (2.0 * abs(a) if abs(b) <= e else 0.0)) if a or b else Rounded(0.0, d)


def _held(x: Any) -> Any:
    a, _ = value_and_error(x)
    return 0.0 if a <= 0.0 else 1.0 if a >= 1.0 else x


def _inside(x: Any) -> float:
    return FLOAT.inside(value_and_error(x)[0])  # type: ignore[no-any-return]


@lru_cache(maxsize=4096)
def _number(text: str) -> Any:
    v = as_float(text)
    exact = Fraction(text) == Fraction(v)
    # Of plain numbers no operation is counted: 341/100 would be exact.
    return v if exact and v in (0.0, 1.0) else Rounded(v, 0.0 if exact else UNIT * abs(v))


@cache
def rounded_arithmetic() -> Arithmetic:
    """Return the arithmetic of numbers with error bounds."""
    functions: dict[str, Any] = {name: _function(name) for name, entry in TABLE.items() if entry.steepest is not None}
    functions |= {
        "atan2": _atan2,
        "sqrt": _sqrt,
        "abs": abs,
        "signum": _signum,
        "abs_slope": _abs_slope,
        "signed": _signed,
        "held": _held,
        "inside": _inside,
        "power": _power,
    }
    constants = {name: Rounded(x, UNIT * x) for name, x in CONSTANTS.items()}
    return Arithmetic("rounded", _number, constants, functions)


@dataclass(frozen=True)
class WithErrors:
    """A vector or a matrix with error bounds of its entries."""

    values: Any
    errors: Any

    def __getitem__(self, index: Any) -> WithErrors:
        return WithErrors(self.values[index], self.errors[index])
