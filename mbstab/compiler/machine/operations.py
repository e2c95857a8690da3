"""The operations of the interpreter, as texts."""

from __future__ import annotations

import math

from mbstab.model.functions import NATIVE, TABLE

TEXTS = {name: f"math.{name}(x{', y' * (TABLE[name].arguments - 1)})" for name in NATIVE if hasattr(math, name)} | {
    "+": "x + y",
    "-": "x - y",
    "*": "x * y",
    "/": "x / y",
    "negative": "-x",
    "power": "math.pow(x, y)",
    "abs": "abs(x)",
    "signum": "0.0 if x == 0.0 else math.copysign(1.0, x)",
    "abs_slope": "math.copysign(1.0, x)",
    "held": "min(max(x, 0.0), 1.0)",
    "inside": "0.0 if 0.0 <= x <= 1.0 else math.nan",
}
"""What each of `OPERATIONS` does to x, or to x and y."""

FREQUENT = ("*", "+", "-", "/", "negative", "sin", "cos", "sqrt")
"""Operations with a loop of their own."""

REFUSED = {"/": "y == 0.0", "abs_slope": "x == 0.0"}
"""Where an operation has no value, besides those that are not finite."""
