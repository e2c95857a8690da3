"""Numbers with many digits and proven error bounds: real balls as an arithmetic for expressions and kernels.

A ball is a midpoint with a radius; every operation returns a ball that contains all results
(Johansson 2017, Arb: efficient arbitrary-precision midpoint-radius interval arithmetic, IEEE
Trans. Computers 66). Literals are exact decimals, multiples of π stay multiples of π under
sine and cosine, and results of decimals without roots or angles stay fractions
(`Exact`): a structural zero of a scene is a zero without radius. Numbers with many digits are the midpoints.
"""

from __future__ import annotations

import contextlib
import copyreg
import math
import numbers
from collections.abc import Callable, Iterator
from decimal import Decimal, localcontext
from fractions import Fraction
from functools import cache
from typing import Any

from mbstab.model.arithmetic import KINK, MAX_DIGITS, Arithmetic
from mbstab.model.functions import NATIVE

Ball = Any
"""``flint.arb`` or `Exact`; python-flint ships no types."""

GUARD_DIGITS = 15
"""Digits in addition to the requested ones."""

DIGITS_OF_ROUNDED = 48
"""A decimal with so many digits stands for a number that has more."""

WIDTH_OF_INTERVAL = 1e-12
"""Balls wider than this, relative to their midpoint, are intervals, not numbers with a rounding error."""


def _as_integers(x: Any) -> tuple[Callable[..., Any], tuple[Any, ...]]:
    """Return a finite ball as mantissa and exponent of its midpoint and of its radius, which may grow by rounding."""
    return _ball_again, tuple(int(number) for part in (x.mid(), x.rad()) for number in part.man_exp())


def _ball_again(middle: int, power: int, radius: int, power_of_radius: int) -> Any:
    from flint import arb

    copyreg.pickle(arb, _as_integers)
    return arb((middle, power), (radius, power_of_radius))


@contextlib.contextmanager
def bits(number: int) -> Iterator[None]:
    """Compute with this number of bits inside the context."""
    from flint import ctx

    before, ctx.prec = ctx.prec, number
    try:
        yield
    finally:
        ctx.prec = before


def digits(number: int) -> contextlib.AbstractContextManager[None]:
    """Compute with this number of decimal digits, and a few more, inside the context."""
    return bits(round((number + GUARD_DIGITS + 1) * math.log2(10)))


def digits_in_use() -> int:
    """Return the number of decimal digits in use."""
    from flint import ctx

    return int(ctx.dps) - GUARD_DIGITS


class Exact:
    """A fraction that behaves like a ball without radius; combined with another ball it gives a ball.

    Attributes
    ----------
    v : ``flint.fmpq``
    """

    __slots__ = ("v",)

    def __init__(self, v: Any) -> None:
        self.v = v

    def _with(self, other: Any, exact: Callable[[Any, Any], Any], balls: Callable[[Any, Any], Any]) -> Any:
        if isinstance(other, Exact):
            return Exact(exact(self.v, other.v))
        if isinstance(other, (int, float)):
            return Exact(exact(self.v, ball(other).v))
        return balls(real(self), other) if hasattr(other, "rad") else NotImplemented

    def __add__(self, other: Any) -> Any:
        return self._with(other, lambda a, b: a + b, lambda a, b: a + b)

    __radd__ = __add__

    def __sub__(self, other: Any) -> Any:
        return self._with(other, lambda a, b: a - b, lambda a, b: a - b)

    def __rsub__(self, other: Any) -> Any:
        return self._with(other, lambda a, b: b - a, lambda a, b: b - a)

    def __mul__(self, other: Any) -> Any:
        if isinstance(other, _turns_type()):
            return other * self
        if not self.v and hasattr(other, "rad") and other.is_finite():
            return self
        return self._with(other, lambda a, b: a * b, lambda a, b: a * b)

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Any:
        return self._with(other, lambda a, b: a / b, lambda a, b: a / b)

    def __rtruediv__(self, other: Any) -> Any:
        return self._with(other, lambda a, b: b / a, lambda a, b: b / a)

    def __pow__(self, n: int) -> Any:
        return Exact(self.v**n)

    def __neg__(self) -> Any:
        return Exact(-self.v)

    def __abs__(self) -> Any:
        return Exact(abs(self.v))

    def __bool__(self) -> bool:
        return bool(self.v)

    def __float__(self) -> float:
        return float(real(self))

    def __hash__(self) -> int:
        return hash(self.v)

    def __eq__(self, other: Any) -> Any:
        return self.v == ball(other).v if _short(other) else real(self) == other

    def __lt__(self, other: Any) -> Any:
        return self.v < ball(other).v if _short(other) else real(self) < other

    def __le__(self, other: Any) -> Any:
        return self.v <= ball(other).v if _short(other) else real(self) <= other

    def __gt__(self, other: Any) -> Any:
        return self.v > ball(other).v if _short(other) else real(self) > other

    def __ge__(self, other: Any) -> Any:
        return self.v >= ball(other).v if _short(other) else real(self) >= other

    def is_zero(self) -> bool:
        """Whether it is zero."""
        return not self.v

    def is_finite(self) -> bool:
        """Return True."""
        return True

    def mid(self) -> Any:
        """Return a nearby number as a ball without radius."""
        return real(self).mid()

    def rad(self) -> Any:
        """Return 0."""
        return real(ball(0))

    def contains(self, other: Any) -> bool:
        """Whether it is another number."""
        return bool(self == other)

    def abs_upper(self) -> Any:
        """Return an upper bound of the absolute value as a ball without radius."""
        return real(self).abs_upper()

    def union(self, other: Any) -> Any:
        """Return a ball that contains both numbers and all in between."""
        return real(self).union(real(other))

    def str(self, *arguments: Any, **settings: Any) -> Any:
        """Return it as decimals."""
        return real(self).str(*arguments, **settings)


def _short(x: Any) -> bool:
    """Return whether a fraction is short enough for `Exact`."""
    return isinstance(x, (Exact, int)) or (isinstance(x, float) and math.isfinite(x))


def ball(x: Any) -> Ball:
    """Return a number as a fraction if it is one, and balls unchanged."""
    from flint import fmpq

    if isinstance(x, Exact) or hasattr(x, "rad"):
        return x
    value = Fraction(x)
    return Exact(fmpq(value.numerator, value.denominator))


def real(x: Any) -> Any:
    """Return a number as ``flint.arb``."""
    from flint import arb

    if isinstance(x, arb):
        return x
    return arb(x.v) if isinstance(x, Exact) else arb(x) if isinstance(x, float) else real(ball(x))


def plane(x: Any, y: Any = None) -> Any:
    """Return x, or x + iy, as ``flint.acb``."""
    from flint import acb

    return acb(x) if y is None else acb(x, y)


def tidied(x: Any) -> Ball:
    """Return a ball, or a fraction if it has no radius and is short."""
    short = None if isinstance(x, (Exact, _turns_type())) else _rational(x)
    return x if short is None else ball(short)


def between(low: Ball, high: Ball) -> Ball:
    """Return a ball that contains two others and all in between; it ends at zero exactly if they do."""
    from flint import arb

    whole = real(low).union(real(high))
    for end, other in ((low, high), (high, low)):
        if _rational(end) == 0:
            # Radii are rounded up: with the radius as midpoint, the ball ends at zero exactly.
            radius = whole.rad()
            middle = arb(0, radius).rad()
            return arb(middle if other > 0 else -middle, radius)
    return whole


@cache
def _turns_type() -> Any:
    """Return the type of exact multiples of π, balls that sine and cosine recognize."""
    from flint import arb, fmpq

    class Turns(arb):
        """part·π with a fraction `part`."""

        part: Fraction

        def __new__(cls, part: Fraction) -> Any:
            result = super().__new__(cls)
            result.part = part
            return result

        def __init__(self, part: Fraction) -> None:
            super().__init__(arb.pi() * fmpq(part.numerator, part.denominator))

        def __mul__(self, other: Any) -> Any:
            if _composed(other):
                return NotImplemented
            factor = _rational(other)
            return arb(self) * real(other) if factor is None else Turns(self.part * factor)

        __rmul__ = __mul__

        def __truediv__(self, other: Any) -> Any:
            if isinstance(other, Turns):
                return arb(self) / arb(other) if other.part == 0 else ball(self.part / other.part)
            if _composed(other):
                return NotImplemented
            divisor = _rational(other)
            return arb(self) / real(other) if not divisor else Turns(self.part / divisor)

        def __rtruediv__(self, other: Any) -> Any:
            return real(other) / arb(self)

        def __add__(self, other: Any) -> Any:
            if isinstance(other, Turns):
                return Turns(self.part + other.part)
            if _composed(other):
                return NotImplemented
            return self if _rational(other) == 0 else arb(self) + real(other)

        __radd__ = __add__

        def __neg__(self) -> Any:
            return Turns(-self.part)

        def __sub__(self, other: Any) -> Any:
            return self + -other

        def __rsub__(self, other: Any) -> Any:
            return other + -self

    return Turns


def _composed(x: Any) -> bool:
    """Return whether a number carries derivatives or the like, and computes with plain numbers itself."""
    return not (isinstance(x, (numbers.Number, Exact)) or hasattr(x, "rad"))


def _rational(x: Any) -> Fraction | None:
    """Return a number as a fraction if it is exactly a short one."""
    if isinstance(x, _turns_type()):
        return None
    if isinstance(x, (int, float)):
        return Fraction(x)
    if isinstance(x, Exact):
        return fraction(x)
    if hasattr(x, "is_exact") and x.is_exact() and x.is_finite():
        mantissa, exponent = (int(part) for part in x.man_exp())
        if abs(exponent) < 64 and mantissa.bit_length() < 64:
            return Fraction(mantissa) * Fraction(2) ** exponent
    return None


def fraction(x: Ball) -> Fraction | None:
    """Return a number as a fraction if it is exactly one."""
    return Fraction(int(x.v.p), int(x.v.q)) if isinstance(x, Exact) else None


def fraction_beyond(x: Ball, up: bool) -> Fraction:
    """Return a number as a fraction, rounded outwards if it is none: up, or down."""
    exact = fraction(x)
    if exact is not None:
        return exact
    end = real(x).upper() if up else real(x).lower()
    mantissa, exponent = (int(part) for part in end.mid().man_exp())
    slack = Fraction(1, 10**30)
    return Fraction(mantissa) * Fraction(2) ** exponent + (slack if up else -slack)


def _finite(x: Any) -> Any:
    if not x.is_finite():
        raise ValueError("no finite enclosure")
    return tidied(x)


def decimal(text: str) -> Ball:
    """Return a decimal exactly; one with many more digits than a double has may be off by half a unit of its last."""
    value = Fraction(text)
    if value and len(text) > MAX_DIGITS:
        raise OverflowError("too many digits")
    if not value or len(text) < DIGITS_OF_ROUNDED or "/" in text:
        return ball(value)
    from flint import arb

    _, _, exponent = Decimal(text).as_tuple()
    assert isinstance(exponent, int)
    return real(ball(value)) + arb(0, 0.5 * 10.0**exponent)


@cache
def ball_arithmetic(number: Callable[[str], Ball] = decimal) -> Arithmetic:
    """Return the arithmetic of real balls, at the precision in use, in which literals are what a function says.

    A function raises ValueError where it has no finite enclosure: outside its domain, or where a
    ball contains a kink.
    """
    from flint import acb, arb, fmpq

    # Balls go to other processes.
    copyreg.pickle(arb, _as_integers)
    copyreg.pickle(acb, lambda z: (acb, (z.real, z.imag)))
    Turns = _turns_type()

    def plain(name: str) -> Callable[[Any], Any]:
        return lambda x: _finite(getattr(real(x), name)())

    def sqrt(x: Any) -> Any:
        x = tidied(ball(x))
        if isinstance(x, Exact) and x.v >= 0:
            roots = [math.isqrt(int(part)) for part in (x.v.p, x.v.q)]
            if roots[0] ** 2 == int(x.v.p) and roots[1] ** 2 == int(x.v.q):
                return ball(Fraction(roots[0], roots[1]))
        return _finite(real(x).sqrt())

    def of_turns(name: str) -> Callable[[Any], Any]:
        exact = getattr(arb, f"{name}_pi_fmpq")

        def function(x: Any) -> Any:
            if isinstance(x, Turns):
                return _finite(exact(fmpq(x.part.numerator, x.part.denominator)))
            return _finite(getattr(real(x), name)())

        return function

    sin, cos = of_turns("sin"), of_turns("cos")

    def sign(x: Any) -> Any:
        x = ball(x)
        if x > 0:
            return ball(1)
        if x < 0:
            return ball(-1)
        if x.is_zero():
            return ball(0)
        raise ValueError("a sign is open")

    def abs_slope(x: Any) -> Any:
        if ball(x).is_zero():
            raise ValueError(KINK)
        return sign(x)

    def held(x: Any) -> Any:
        x = ball(x)
        if x <= 0:
            return ball(0)
        if x >= 1:
            return ball(1)
        if x >= 0 and x <= 1:
            return x
        raise ValueError("it reaches over an end of a piece")

    def inside(x: Any) -> Any:
        x = ball(x)
        if x >= 0 and x <= 1:
            return ball(0)
        raise ValueError("it may lie outside of a table")

    def power(base: Any, exponent: Any) -> Any:
        whole = _rational(exponent)
        if whole is not None and whole.denominator == 1:
            return _finite(ball(base) ** int(whole))
        return _finite(real(base) ** real(exponent))

    functions: dict[str, Callable[..., Any]] = {name: plain(name) for name in NATIVE if hasattr(arb, name)}
    functions |= {
        "sin": sin,
        "cos": cos,
        "sqrt": sqrt,
        "tan": lambda x: _finite(sin(x) / cos(x)),
        "atan2": lambda y, x: _finite(arb.atan2(real(y), real(x))),
        "abs": lambda x: abs(ball(x)),
        "signum": sign,
        "abs_slope": abs_slope,
        "held": held,
        "inside": inside,
        "power": power,
    }
    return Arithmetic("ball", number, _Constants(), functions)


class _Constants(dict[str, Any]):
    """π and one degree, with the digits in use at the time of access."""

    _PARTS = {"pi": Fraction(1), "deg": Fraction(1, 180)}  # noqa: RUF012

    def __getitem__(self, name: str) -> Any:
        return _turns_type()(self._PARTS[name])


@cache
def digit_arithmetic() -> Arithmetic:
    """Return the arithmetic of numbers with many digits: functions of the midpoints of balls, which decide pieces."""
    from flint import arb

    exact = ball_arithmetic()

    def of_middle(function: Callable[..., Any]) -> Callable[..., Any]:
        return lambda *x: function(*(y.mid() if y.__class__ is arb else y for y in x))

    functions = {name: of_middle(x) for name, x in vars(exact).items() if callable(x) and name != "number"}
    return Arithmetic("digits", exact.number, exact.constants, functions)


def zero_inside(x: Ball) -> bool:
    """Return whether a ball contains zero."""
    return bool(x.contains(0))


def is_wide(x: Ball) -> bool:
    """Return whether a ball is an interval, not a number with a rounding error."""
    return float(x.rad()) > WIDTH_OF_INTERVAL * abs(float(x.mid()))


def at_part(x: Ball, part: Fraction) -> Ball:
    """Return the fraction at a relative position in a wide ball, and narrow balls unchanged."""
    if not is_wide(x):
        return x
    ends = []
    for end in (x.lower(), x.upper()):
        mantissa, exponent = (int(number) for number in end.mid().man_exp())
        ends.append(Fraction(mantissa) * Fraction(2) ** exponent)
    return ball(ends[0] + (ends[1] - ends[0]) * part)


def small(part: float) -> Ball:
    """Return the relative size of a number that is small by a fraction of the digits in use."""
    from flint import arb, ctx

    return arb(2) ** -round(part * ctx.prec)


def decimals(x: Any, number: int) -> str:
    """Return a number with its significant digits, without an exponent where that is short enough."""
    if not real(x).is_finite():
        return str(float(x))
    mantissa, exponent = (int(part) for part in real(x).mid().man_exp())
    with localcontext(prec=2 * number + GUARD_DIGITS):
        exactly = Decimal(mantissa) * Decimal(2) ** exponent
        text = f"{exactly:.{number - 1}e}"
    return f"{Decimal(text):f}" if Decimal(text).adjusted() in range(-5, number) else text
