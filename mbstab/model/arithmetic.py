"""The number systems in which expressions and kernels are evaluated.

An arithmetic is a namespace of functions (``sin``, ``sqrt``, ``atan2``, …). Kernels and
user expressions take it as an argument, so one text serves Python floats, NumPy
arrays, symbols and any other number type that has these functions.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from fractions import Fraction
from functools import partial
from typing import Any

from mbstab.model.functions import NATIVE, TABLE
from mbstab.model.hermite import float_hermite

CONSTANTS: dict[str, float] = {"pi": math.pi, "deg": math.pi / 180.0}
"""Names an expression may use without declaring them; ``30*deg`` is an angle of 30 degrees."""


def as_float(text: str | float) -> float:
    """Return the float next to a literal; the slopes of tables are fractions."""
    try:
        return float(text)
    except ValueError:
        return float(Fraction(text))


MAX_DIGITS = 10_000
"""Digits of the largest exact power; `float` overflows long before."""


class Arithmetic:
    """A number system: ``number`` reads a literal, ``power`` raises, the rest are functions.

    Parameters
    ----------
    name : str
        For messages.
    number : callable
        Turns the text of a literal (``"0.5"``), or of a fraction (``"1/3"``), into a number.
    constants : dict
        Values of `CONSTANTS` in this number system.
    functions : dict
        A callable for ``power``, and one for each function of `mbstab.model.functions.TABLE` without a formula; the
        others are computed by their formula where they are not given.
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
        known = {key: partial(entry.formula, self) for key, entry in TABLE.items() if entry.formula is not None}
        for key, function in (known | functions).items():
            setattr(self, key, function)

    def __getattr__(self, name: str) -> Callable[..., Any]:
        raise AttributeError(f"{self.name} arithmetic has no function {name!r}")


def _signum(x: float) -> float:
    return float(x > 0.0) - float(x < 0.0)


KINK = "abs has no derivative at 0"
"""What the error at a kink says."""


def _abs_slope(x: float) -> float:
    if x == 0.0:
        raise ValueError(KINK)
    return math.copysign(1.0, x)


def _held(x: float) -> float:
    return min(max(x, 0.0), 1.0)


def _inside(x: float) -> float:
    if not 0.0 <= x <= 1.0:
        raise ValueError("outside of a table")
    return 0.0


FLOAT = Arithmetic(
    "float",
    as_float,
    dict(CONSTANTS),
    {name: getattr(math, name) for name in NATIVE if hasattr(math, name)}
    | {"abs": abs, "signum": _signum, "abs_slope": _abs_slope, "held": _held, "inside": _inside, "power": math.pow}
    | {"table": float_hermite(0), "spline": float_hermite(0)}
    | {f"hermite{order}": float_hermite(order) for order in (1, 2, 3)}
    | {"linear": float_hermite(0, lines=True), "linear1": float_hermite(1, lines=True)},
)
"""Python floats."""


@functools.cache
def array_arithmetic() -> Arithmetic:
    """Return the arithmetic of NumPy arrays: the same formulas on all elements at once."""
    import numpy as np

    def abs_slope(x: Any) -> Any:
        return np.where(np.equal(x, 0.0), np.nan, np.sign(x))

    functions = {name: getattr(np, name) for name in NATIVE if hasattr(np, name)}
    functions |= {"signum": np.sign, "abs_slope": abs_slope, "held": lambda x: np.clip(x, 0.0, 1.0), "power": np.power}
    functions["inside"] = lambda x: np.where((x >= 0.0) & (x <= 1.0), 0.0, np.nan)
    return Arithmetic("array", as_float, dict(CONSTANTS), functions)


def symbol_arithmetic() -> Arithmetic:
    """Return the arithmetic of SymPy expressions; literals become exact rationals."""
    import sympy

    def held(x: Any) -> Any:
        return sympy.Piecewise((0, x <= 0), (x, x < 1), (1, True))

    def folded(formula: Callable[..., Any]) -> Callable[..., Any]:
        # Pieces outside, as they are written by hand.
        return lambda *arguments: sympy.piecewise_fold(sympy.sympify(formula(f, *arguments)))

    def power(base: Any, exponent: Any) -> Any:
        base, exponent = sympy.sympify(base), sympy.sympify(exponent)
        if base.is_Rational and exponent.is_Rational:
            bits = max(int(base.p).bit_length(), int(base.q).bit_length())
            if base not in (0, 1, -1) and 0.3 * bits * abs(exponent) > MAX_DIGITS:
                raise OverflowError(f"a power of more than {MAX_DIGITS} digits")
        return base**exponent

    functions = {name: getattr(sympy, name) for name in NATIVE if hasattr(sympy, name)}
    functions |= {"abs": sympy.Abs, "signum": sympy.sign, "abs_slope": sympy.sign, "held": held, "power": power}
    functions["inside"] = lambda x: sympy.Piecewise((0, (x >= 0) & (x <= 1)), (sympy.nan, True))
    functions["signed"] = lambda x, y: x * sympy.sign(y)
    formulas = {name: entry.formula for name, entry in TABLE.items() if entry.formula and name not in functions}
    functions |= {name: folded(formula) for name, formula in formulas.items()}
    f = Arithmetic("symbol", sympy.Rational, {"pi": sympy.pi, "deg": sympy.pi / 180}, functions)
    return f
