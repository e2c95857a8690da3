"""The number systems in which expressions and kernels are evaluated.

An arithmetic is a namespace of functions (``sin``, ``sqrt``, ``atan2``, …). Kernels and
user expressions take it as an argument, so one text serves Python floats, NumPy
arrays, symbols and any other number type that has these functions.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Any

FUNCTIONS: dict[str, tuple[int, str]] = {
    "sin": (1, "sine"),
    "cos": (1, "cosine"),
    "tan": (1, "tangent"),
    "asin": (1, "inverse sine"),
    "acos": (1, "inverse cosine"),
    "atan": (1, "inverse tangent"),
    "atan2": (2, "angle of the point (second, first argument)"),
    "sinh": (1, "hyperbolic sine"),
    "cosh": (1, "hyperbolic cosine"),
    "tanh": (1, "hyperbolic tangent"),
    "exp": (1, "exponential"),
    "log": (1, "natural logarithm"),
    "sqrt": (1, "square root"),
    "abs": (1, "absolute value"),
    "smooth_start": (1, "0 before 0, 3 x**2 - 2 x**3 between 0 and 1, 1 after 1"),
}
"""Functions an expression may call: number of arguments and meaning."""

CONSTANTS: dict[str, float] = {"pi": math.pi, "deg": math.pi / 180.0}
"""Names an expression may use without declaring them; ``30*deg`` is an angle of 30 degrees."""

MAX_DIGITS = 10_000
"""Digits of the largest exact power; `float` overflows long before."""


class Arithmetic:
    """A number system: ``number`` reads a literal, ``power`` raises, the rest are functions.

    Parameters
    ----------
    name : str
        For messages.
    number : callable
        Turns the text of a literal (``"0.5"``) into a number.
    constants : dict
        Values of `CONSTANTS` in this number system.
    functions : dict
        One callable for each of `FUNCTIONS`, and for ``power``, ``sign`` (−1, 0 or 1)
        and ``abs_slope``, the derivative of ``abs``, which does not exist at 0.
    """

    def __init__(
        self,
        name: str,
        number: Callable[[str], Any],
        constants: dict[str, Any],
        functions: dict[str, Callable[..., Any]],
    ) -> None:
        self.name = name
        self.number = number
        self.constants = constants
        for key, function in functions.items():
            setattr(self, key, function)

    def __getattr__(self, name: str) -> Callable[..., Any]:
        raise AttributeError(f"{self.name} arithmetic has no function {name!r}")


def _smooth_start(x: float) -> float:
    return 0.0 if x <= 0.0 else 1.0 if x >= 1.0 else x * x * (3.0 - 2.0 * x)


def _sign(x: float) -> float:
    return float(x > 0.0) - float(x < 0.0)


def _abs_slope(x: float) -> float:
    if x == 0.0:
        raise ValueError("abs has no derivative at 0")
    return math.copysign(1.0, x)


FLOAT = Arithmetic(
    "float",
    float,
    dict(CONSTANTS),
    {name: getattr(math, name) for name in FUNCTIONS if hasattr(math, name)}
    | {"abs": abs, "sign": _sign, "abs_slope": _abs_slope, "power": math.pow, "smooth_start": _smooth_start},
)
"""Python floats."""


@functools.cache
def array_arithmetic() -> Arithmetic:
    """Return the arithmetic of NumPy arrays: the same formulas on all elements at once."""
    import numpy as np

    special = {"asin": "arcsin", "acos": "arccos", "atan": "arctan", "atan2": "arctan2"}

    def smooth_start(x: Any) -> Any:
        x = np.clip(x, 0.0, 1.0)
        return x * x * (3.0 - 2.0 * x)

    functions = {name: getattr(np, special.get(name, name)) for name in FUNCTIONS if name != "smooth_start"}

    def abs_slope(x: Any) -> Any:
        return np.where(np.equal(x, 0.0), np.nan, np.sign(x))

    functions |= {"sign": np.sign, "abs_slope": abs_slope, "power": np.power, "smooth_start": smooth_start}
    return Arithmetic("array", float, dict(CONSTANTS), functions)


def symbol_arithmetic() -> Arithmetic:
    """Return the arithmetic of SymPy expressions; literals become exact rationals."""
    import sympy

    def smooth_start(x: Any) -> Any:
        return sympy.Piecewise((0, x <= 0), (x**2 * (3 - 2 * x), x < 1), (1, True))

    def power(base: Any, exponent: Any) -> Any:
        base, exponent = sympy.sympify(base), sympy.sympify(exponent)
        if base.is_Rational and exponent.is_Rational:
            bits = max(int(base.p).bit_length(), int(base.q).bit_length())
            if base not in (0, 1, -1) and 0.3 * bits * abs(exponent) > MAX_DIGITS:
                raise OverflowError(f"a power of more than {MAX_DIGITS} digits")
        return base**exponent

    functions = {name: getattr(sympy, name) for name in FUNCTIONS if name not in ("abs", "smooth_start")}
    return Arithmetic(
        "symbol",
        sympy.Rational,
        {"pi": sympy.pi, "deg": sympy.pi / 180},
        functions
        | {"abs": sympy.Abs, "sign": sympy.sign, "abs_slope": sympy.sign, "power": power, "smooth_start": smooth_start},
    )


def mpmath_arithmetic() -> Arithmetic:
    """Return the arithmetic of mpmath numbers, at the precision set in ``mpmath.mp``."""
    from mpmath import mp

    def real(function: Callable[..., Any]) -> Callable[..., Any]:
        def checked(*arguments: Any) -> Any:
            value = function(*arguments)
            if isinstance(value, mp.mpc):
                raise ValueError("math domain error")
            return value

        return checked

    def power(base: Any, exponent: Any) -> Any:
        if base != 0 and abs(exponent * mp.log(abs(base))) > MAX_DIGITS:
            raise OverflowError("the power is out of range")
        return mp.power(base, exponent)

    def abs_slope(x: Any) -> Any:
        if x == 0:
            raise ValueError("abs has no derivative at 0")
        return mp.sign(x)

    functions = {name: real(getattr(mp, name)) for name in FUNCTIONS if hasattr(mp, name)}
    return Arithmetic(
        "mpmath",
        mp.mpf,
        {"pi": mp.pi, "deg": mp.degree},  # digits come when they are used
        functions
        | {"abs": mp.fabs, "sign": mp.sign, "abs_slope": abs_slope, "power": real(power)}
        | {"smooth_start": lambda x: mp.mpf(0) if x <= 0 else mp.mpf(1) if x >= 1 else x * x * (3 - 2 * x)},
    )
