"""Numbers that carry their first two time derivatives.

A drive prescribes a law f(t); its velocity and acceleration rows need f' and f''.
Evaluating the law with the time ``Jet(t, 1, 0)`` gives all three, exactly to round-off,
in any number system.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache, reduce
from operator import add
from typing import Any

from mbstab.model.arithmetic import Arithmetic
from mbstab.model.duals import Dual, dual_arithmetic
from mbstab.model.functions import TABLE
from mbstab.records import dataclass


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


@lru_cache(maxsize=8)
def jet_arithmetic(f: Arithmetic) -> Arithmetic:
    """Return the arithmetic of jets over the number system `f`."""

    def jet(name: str) -> Callable[..., Jet]:
        plain, slopes = getattr(f, name), TABLE[name].slopes

        def function(*arguments: Any) -> Jet:
            jets = [Jet.of(x) for x in arguments]
            values = [x.value for x in jets]
            value = plain(*values)
            # A constant may lie where the function has no derivative, such as sqrt(0).
            moving = [i for i, x in enumerate(jets) if not x.constant]
            if not moving:
                return Jet(value)
            known = slopes(f, value, *values)
            rate = reduce(add, [known[i] * jets[i].rate for i in moving])
            # The rates of the slopes make the second derivative.
            changing = slopes(duals, Dual(value, rate), *[Dual(x.value, x.rate) for x in jets])
            parts = [changing[i].value * jets[i].second + changing[i].slope * jets[i].rate for i in moving]
            return Jet(value, rate, reduce(add, parts))

        return function

    def power(x: Any, n: Any) -> Jet:
        base, exponent = Jet.of(x), Jet.of(n)
        if exponent.constant:
            x, n = base.value, exponent.value
            value = f.power(x, n)
            if base.constant:
                return Jet(value)
            # x**(n-1) has no value at x = 0 for n < 1 even where the factor n is zero.
            first = 0 * value if _is_zero(n) else n * f.power(x, n - 1)
            second = 0 * value if _is_zero(n) or _is_zero(n - 1) else n * (n - 1) * f.power(x, n - 2)
            return Jet(value, first * base.rate, first * base.second + second * base.rate * base.rate)
        result: Jet = functions["exp"](exponent * functions["log"](base))
        return result

    duals = dual_arithmetic(f)
    functions: dict[str, Any] = {name: jet(name) for name in TABLE}
    return Arithmetic(f"jet of {f.name}", f.number, f.constants, {**functions, "power": power})


def _is_zero(x: Any) -> bool:
    zero = x == 0
    return bool(zero.all()) if hasattr(zero, "all") else bool(zero)
