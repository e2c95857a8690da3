"""Numbers that carry their first two time derivatives.

A drive prescribes a law f(t); its velocity and acceleration rows need f' and f''.
Evaluating the law with the time ``Jet(t, 1, 0)`` gives all three, exactly to round-off,
in any number system.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from mbstab.model.arithmetic import Arithmetic


@dataclass(frozen=True)
class Jet:
    """A value with its first and second time derivative."""

    # An array times a jet is one jet of arrays, not an array of jets.
    __array_ufunc__ = None

    value: Any
    rate: Any = 0
    second: Any = 0

    @staticmethod
    def of(x: Any) -> Jet:
        """Return `x` as a jet; a plain number is a constant."""
        return x if isinstance(x, Jet) else Jet(x)

    @property
    def constant(self) -> bool:
        """Whether both derivatives are zero."""
        return _is_zero(self.rate) and _is_zero(self.second)

    def chain(self, value: Any, first: Any, second: Any) -> Jet:
        """Return g(self) from g, g' and g'' at this value."""
        return Jet(value, first * self.rate, first * self.second + second * self.rate * self.rate)

    def __add__(self, other: Any) -> Jet:
        other = Jet.of(other)
        return Jet(self.value + other.value, self.rate + other.rate, self.second + other.second)

    __radd__ = __add__

    def __neg__(self) -> Jet:
        return Jet(-self.value, -self.rate, -self.second)

    def __sub__(self, other: Any) -> Jet:
        return self + -Jet.of(other)

    def __rsub__(self, other: Any) -> Jet:
        return Jet.of(other) + -self

    def __mul__(self, other: Any) -> Jet:
        other = Jet.of(other)
        return Jet(
            self.value * other.value,
            self.rate * other.value + self.value * other.rate,
            self.second * other.value + 2 * self.rate * other.rate + self.value * other.second,
        )

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Jet:
        other = Jet.of(other)
        value = self.value / other.value
        rate = (self.rate - value * other.rate) / other.value
        return Jet(value, rate, (self.second - 2 * rate * other.rate - value * other.second) / other.value)

    def __rtruediv__(self, other: Any) -> Jet:
        return Jet.of(other) / self


def jet_arithmetic(f: Arithmetic) -> Arithmetic:
    """Return the arithmetic of jets over the number system `f`."""

    def lift(name: str, derivatives: Any) -> Any:
        def function(x: Any) -> Jet:
            x = Jet.of(x)
            # A constant may lie where the function has no derivative, such as sqrt(0).
            return Jet(getattr(f, name)(x.value)) if x.constant else x.chain(*derivatives(f, x.value))

        return function

    def power(x: Any, n: Any) -> Jet:
        base, exponent = Jet.of(x), Jet.of(n)
        if exponent.constant:
            return _constant_power(f, base, exponent.value)
        result: Jet = functions["exp"](exponent * functions["log"](base))
        return result

    functions: dict[str, Any] = {name: lift(name, derivatives) for name, derivatives in DERIVATIVES.items()}
    functions |= {"atan2": lambda y, x: _atan2(f, Jet.of(y), Jet.of(x)), "power": power}
    return Arithmetic(f"jet of {f.name}", f.number, f.constants, functions)


def _constant_power(f: Any, base: Jet, n: Any) -> Jet:
    x = base.value
    value = f.power(x, n)
    if base.constant:
        return Jet(value)
    # x**(n-1) has no value at x = 0 for n < 1 even where the factor n is zero.
    first = 0 * value if _is_zero(n) else n * f.power(x, n - 1)
    second = 0 * value if _is_zero(n) or _is_zero(n - 1) else n * (n - 1) * f.power(x, n - 2)
    return base.chain(value, first, second)


def _atan2(f: Any, y: Jet, x: Jet) -> Jet:
    square = x.value * x.value + y.value * y.value
    rate = (x.value * y.rate - y.value * x.rate) / square
    growth = 2 * (x.value * x.rate + y.value * y.rate)
    second = (x.value * y.second - y.value * x.second - rate * growth) / square
    return Jet(f.atan2(y.value, x.value), rate, second)


# --- value, first and second derivative of each function --------------------------------------------------------------


def _smooth_start(f: Any, x: Any) -> tuple[Any, Any, Any]:
    inside = (f.sign(x) - f.sign(x - 1)) / 2
    return f.smooth_start(x), 6 * inside * x * (1 - x), inside * (6 - 12 * x)


def _tan(f: Any, x: Any) -> tuple[Any, Any, Any]:
    tangent = f.tan(x)
    return tangent, 1 + tangent * tangent, 2 * tangent * (1 + tangent * tangent)


def _tanh(f: Any, x: Any) -> tuple[Any, Any, Any]:
    tangent = f.tanh(x)
    return tangent, 1 - tangent * tangent, -2 * tangent * (1 - tangent * tangent)


def _asin(f: Any, x: Any) -> tuple[Any, Any, Any]:
    root = f.sqrt(1 - x * x)
    return f.asin(x), 1 / root, x / (root * (1 - x * x))


def _acos(f: Any, x: Any) -> tuple[Any, Any, Any]:
    root = f.sqrt(1 - x * x)
    return f.acos(x), -1 / root, -x / (root * (1 - x * x))


def _atan(f: Any, x: Any) -> tuple[Any, Any, Any]:
    return f.atan(x), 1 / (1 + x * x), -2 * x / (1 + x * x) ** 2


def _sqrt(f: Any, x: Any) -> tuple[Any, Any, Any]:
    root = f.sqrt(x)
    return root, 1 / (2 * root), -1 / (4 * x * root)


def _abs(f: Any, x: Any) -> tuple[Any, Any, Any]:
    slope = f.abs_slope(x)
    return f.abs(x), slope, 0 * slope


DERIVATIVES: dict[str, Any] = {
    "sin": lambda f, x: (f.sin(x), f.cos(x), -f.sin(x)),
    "cos": lambda f, x: (f.cos(x), -f.sin(x), -f.cos(x)),
    "tan": _tan,
    "asin": _asin,
    "acos": _acos,
    "atan": _atan,
    "sinh": lambda f, x: (f.sinh(x), f.cosh(x), f.sinh(x)),
    "cosh": lambda f, x: (f.cosh(x), f.sinh(x), f.cosh(x)),
    "tanh": _tanh,
    "exp": lambda f, x: (f.exp(x),) * 3,
    "log": lambda f, x: (f.log(x), 1 / x, -1 / (x * x)),
    "sqrt": _sqrt,
    "abs": _abs,
    "sign": lambda f, x: (f.sign(x), 0 * x, 0 * x),
    "abs_slope": lambda f, x: (f.abs_slope(x), 0 * x, 0 * x),
    "smooth_start": _smooth_start,
}
"""From a number system and a value to the function and its derivatives there."""


def _is_zero(x: Any) -> bool:
    zero = x == 0
    return bool(zero.all()) if hasattr(zero, "all") else bool(zero)
