"""Numbers with proven error bounds: real balls as an arithmetic for kernels, linear algebra and polynomials.

A ball is a midpoint with a radius; every operation returns a ball that contains all results
(Johansson 2017, Arb: efficient arbitrary-precision midpoint-radius interval arithmetic, IEEE
Trans. Computers 66). Literals are exact decimals, multiples of π stay multiples of π under
sine and cosine, and results of decimals without roots or angles stay fractions
(`Exact`): a structural zero of a scene is a zero without radius.

Matrices are lists of rows of balls and fractions. Elimination divides by pivots chosen in double precision and
never adds a multiple with factor zero, so that it preserves structural zeros.
"""

from __future__ import annotations

import contextlib
import copyreg
import math
import numbers
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from decimal import Decimal
from fractions import Fraction
from functools import cache
from typing import Any

from mbstab.analysis.algebra.tolerances import TOLERANCES
from mbstab.compiler.system import System
from mbstab.errors import MbstabError, UsageError
from mbstab.model.arithmetic import KINK, MAX_DIGITS, Arithmetic
from mbstab.model.expressions import ExpressionError
from mbstab.model.functions import NATIVE
from mbstab.model.jets import Jet
from mbstab.model.parameters import of_file
from mbstab.model.schema import Model
from mbstab.model.units import UNITS
from mbstab.model.values import evaluate

Ball = Any
"""``flint.arb`` or `Exact`; python-flint ships no types."""

Matrix = list[list[Ball]]


class NotProvable(MbstabError):
    """Something could not be enclosed, or its sign not proven, with the digits in use; the message is the reason."""


class Hopeless(NotProvable):
    """Something cannot be proven with any number of digits."""


def _as_integers(x: Any) -> tuple[Callable[..., Any], tuple[Any, ...]]:
    """Return a finite ball as mantissa and exponent of its midpoint and of its radius, which may grow by rounding."""
    return _ball_again, tuple(int(number) for part in (x.mid(), x.rad()) for number in part.man_exp())


def _ball_again(middle: int, power: int, radius: int, power_of_radius: int) -> Any:
    from flint import arb

    copyreg.pickle(arb, _as_integers)
    return arb((middle, power), (radius, power_of_radius))


@contextlib.contextmanager
def digits(number: int) -> Iterator[None]:
    """Compute with this number of decimal digits, and a few more, inside the context."""
    from flint import ctx

    before = ctx.prec
    ctx.dps = number + TOLERANCES.ball_digits_beyond
    try:
        yield
    finally:
        ctx.prec = before


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

    return arb(x.v) if isinstance(x, Exact) else x if isinstance(x, arb) else real(ball(x))


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
    if not value or len(text) < TOLERANCES.digits_of_rounded or "/" in text:
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
    from flint import arb, fmpq

    copyreg.pickle(arb, _as_integers)  # balls go to other processes
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


# --- parameters -----------------------------------------------------------------------------------------------------


_UNIT = re.compile(r"([*/]?)\s*([A-Za-z]+|1)\s*(?:(?:\^|\*\*)\s*(-?[0-9]+))?\s*")


def exact_factor(unit: str) -> Ball:
    """Return the factor from a unit to SI: a decimal, or a decimal times a multiple of π."""
    value, turns = Fraction(1), 0
    for over, name, power in _UNIT.findall(unit.strip()):
        exponent = int(power or 1) * (-1 if over == "/" else 1)
        of_pi = {"deg": Fraction(1, 180), "rpm": Fraction(1, 30)}.get(name)
        # Factors are written as short decimals: 0.001 means 1/1000.
        value *= (Fraction(str(UNITS[name][0])) if of_pi is None else of_pi) ** exponent
        turns += 0 if of_pi is None else exponent
    if not turns:
        return ball(value)
    pi = _turns_type()(value if turns == 1 else Fraction(1))
    return pi if turns == 1 else ball(value) * pi**turns


def ends(model: Model, name: str) -> list[Ball]:
    """Return the value (SI) that a call gives a parameter, or both ends of its interval.

    Raises
    ------
    UsageError
        If the first end is not below the last.
    """
    f, given, found = ball_arithmetic(), model.parameters[name].given, []
    assert given is not None
    try:
        for expression, unit in given.ends:
            if unit is None:
                found.append(expression.evaluate(parameters(of_file(model), {}), f))
            else:
                found.append(expression.evaluate({}, f) * exact_factor(unit))
    except ExpressionError as error:
        raise UsageError(f"{name}={given.setting}: {error.message}") from None
    if len(found) == 2 and not found[0] < found[1]:
        raise UsageError(f"{name}={given.setting}: the first end of an interval must be below the last")
    return found


def parameters(model: Model, overrides: Mapping[str, Ball]) -> dict[str, Ball]:
    """Return the value of every parameter in SI as balls, with some of them replaced."""
    f = ball_arithmetic()
    values: dict[str, Ball] = {}
    for name, parameter in model.parameters.items():
        if name in overrides:
            values[name] = overrides[name]
        elif parameter.given is not None:
            (values[name],) = ends(model, name)
        else:
            values[name] = parameter.expression.evaluate(values, f) * exact_factor(parameter.unit)
        if not values[name].is_finite():
            raise NotProvable(f"the parameter {name} has no finite enclosure")
    return values


def ball_system(model: Model, overrides: Mapping[str, Ball]) -> System:
    """Return the equations of motion of a model in balls.

    Raises
    ------
    ModelFileError
        If a number is not proven to have the required sign.
    """
    system = System(evaluate(model, parameters(model, overrides), ball_arithmetic()))
    # Kernels must not get floats: their quotients would be rounded.
    system._elements = [
        replace(
            element,
            parameters=tuple(ball(x) for x in element.parameters),
            laws=tuple(_BallLaw(law) for law in element.laws),
        )
        for element in system._elements
    ]
    return system


class _BallLaw:
    """A given function of time whose value and derivatives are balls."""

    def __init__(self, law: Any) -> None:
        self.law = law

    def at(self, time: Any) -> Jet:
        jet = self.law.at(ball(time))
        return Jet(ball(jet.value), ball(jet.rate), ball(jet.second))


# --- vectors and matrices -------------------------------------------------------------------------------------------


def zero_inside(x: Ball) -> bool:
    """Return whether a ball contains zero."""
    return bool(x.contains(0))


def at_part(x: Ball, part: Fraction) -> Ball:
    """Return the fraction at a relative position in a wide ball, and narrow balls unchanged."""
    if float(x.rad()) <= TOLERANCES.ball_width_interval * abs(float(x.mid())):
        return x
    ends = []
    for end in (x.lower(), x.upper()):
        mantissa, exponent = (int(number) for number in end.mid().man_exp())
        ends.append(Fraction(mantissa) * Fraction(2) ** exponent)
    return ball(ends[0] + (ends[1] - ends[0]) * part)


def half_digits() -> Ball:
    """Return the relative size of a number that is small by half of the digits in use."""
    from flint import arb, ctx

    return arb(2) ** (-(ctx.prec // 2))


# --- polynomials ----------------------------------------------------------------------------------------------------
