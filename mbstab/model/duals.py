"""Numbers that carry first derivatives: a value, and its slope by one variable or by many.

The slope may be a number, or an array over variables, such as the parameters of a model. The value may be of any
number system; `Dual` numbers of `Dual` numbers are second derivatives.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache, reduce
from operator import add
from typing import Any

from mbstab.model.arithmetic import Arithmetic
from mbstab.model.functions import TABLE


class Dual:
    """A value with its slope; all other numbers are constants.

    Two numbers are equal only if their slopes are; so one is zero only if it stays zero. Less and greater are those
    of the values.
    """

    __slots__ = ("slope", "value")

    def __init__(self, value: Any, slope: Any = 0) -> None:
        self.value, self.slope = value, slope

    @staticmethod
    def of(x: Any) -> Dual:
        """Return `x` as a dual number; a plain number is a constant."""
        return x if isinstance(x, Dual) else Dual(x)

    def __add__(self, other: Any) -> Any:
        if other.__class__ is not Dual:
            if _wider(other):
                return NotImplemented
            return Dual(self.value + other, self.slope)
        return Dual(self.value + other.value, self.slope + other.slope)

    __radd__ = __add__

    def __neg__(self) -> Dual:
        return Dual(-self.value, -self.slope)

    def __pos__(self) -> Dual:
        return self

    def __sub__(self, other: Any) -> Any:
        if other.__class__ is not Dual:
            if _wider(other):
                return NotImplemented
            return Dual(self.value - other, self.slope)
        return Dual(self.value - other.value, self.slope - other.slope)

    def __rsub__(self, other: Any) -> Dual:
        return Dual(other - self.value, -self.slope)

    def __mul__(self, other: Any) -> Any:
        if other.__class__ is not Dual:
            if _wider(other):
                return NotImplemented
            return Dual(self.value * other, self.slope * other)
        return Dual(self.value * other.value, self.slope * other.value + self.value * other.slope)

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Any:
        if other.__class__ is not Dual:
            if _wider(other):
                return NotImplemented
            return Dual(self.value / other, self.slope / other)
        value = self.value / other.value
        return Dual(value, (self.slope - value * other.slope) / other.value)

    def __rtruediv__(self, other: Any) -> Dual:
        value = other / self.value
        return Dual(value, -(value * self.slope) / self.value)

    def __pow__(self, exponent: int) -> Dual:
        value = self.value**exponent
        return Dual(value, exponent * self.value ** (exponent - 1) * self.slope if exponent else 0 * self.slope)

    def __abs__(self) -> Dual:
        return -self if self.value < 0 else self

    def __float__(self) -> float:
        return float(self.value)

    def __bool__(self) -> bool:
        return bool(self.value) or moves(self)

    def __eq__(self, other: object) -> bool:
        return not self - other

    def __hash__(self) -> int:
        return hash(self.value)

    def __lt__(self, other: Any) -> Any:
        return self.value < _value(other)

    def __le__(self, other: Any) -> Any:
        return self.value <= _value(other)

    def __gt__(self, other: Any) -> Any:
        return self.value > _value(other)

    def __ge__(self, other: Any) -> Any:
        return self.value >= _value(other)


def _wider(x: Any) -> bool:
    """Whether a number, such as a jet, has numbers of this type as parts: it then does the operation."""
    return getattr(x, "__array_ufunc__", 0) is None


def _value(x: Any) -> Any:
    return x.value if x.__class__ is Dual else x


def moves(x: Any) -> bool:
    """Whether a number changes with any of the variables."""
    if x.__class__ is not Dual:
        return False
    zero = x.slope == 0
    return not (zero.all() if hasattr(zero, "all") else zero)


@lru_cache(maxsize=8)
def dual_arithmetic(f: Arithmetic) -> Arithmetic:
    """Return the arithmetic of dual numbers over the number system `f`.

    Functions raise what those of `f` raise; besides `ValueError` or `ArithmeticError` where an argument that changes
    with a variable lies at a point without a derivative, such as a kink.
    """

    def dual(name: str) -> Callable[..., Any]:
        plain, slopes = getattr(f, name), TABLE[name].slopes

        def function(*arguments: Any) -> Any:
            if not any(x.__class__ is Dual for x in arguments):
                return plain(*arguments)
            values = [_value(x) for x in arguments]
            value = plain(*values)
            try:
                known = slopes(f, value, *values)
            except (ArithmeticError, ValueError):
                # A constant may lie where the function has no derivative, such as sqrt(0).
                if any(map(moves, arguments)):
                    raise
                return Dual(value)
            parts = zip(known, arguments, strict=True)
            return Dual(value, reduce(add, [s * x.slope for s, x in parts if x.__class__ is Dual]))

        return function

    def power(base: Any, exponent: Any) -> Any:
        if not moves(base) and not moves(exponent):
            return f.power(_value(base), _value(exponent))
        if moves(exponent):
            return functions["exp"](exponent * functions["log"](base))
        x, n = base.value, _value(exponent)
        # x**(n-1) has no value at x = 0 for n < 1 even where the factor n is zero.
        return Dual(f.power(x, n), base.slope * (0 * x if n == 0 else n * f.power(x, n - 1)))

    functions: dict[str, Any] = {name: dual(name) for name in TABLE}
    return Arithmetic(f"dual of {f.name}", f.number, f.constants, {**functions, "power": power})
