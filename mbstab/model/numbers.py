"""Checks of numbers in any number system: whether they are finite and have the required sign."""

from __future__ import annotations

import math
from typing import Any

from mbstab.mechanics.catalogue import Number, Sign
from mbstab.model.expressions import ExpressionError


def require_finite(value: Number) -> Number:
    """Return a number.

    Raises
    ------
    ExpressionError
        If it is not finite.
    """
    if not is_finite(value):
        raise ExpressionError("the value is not finite")
    return value


def is_finite(value: Number) -> bool:
    """Whether a number, or each of an array, is finite; symbols always are."""
    if isinstance(value, float):
        return math.isfinite(value)
    if hasattr(value, "rad"):
        return bool(value.is_finite())
    if hasattr(value, "shape"):
        import numpy as np

        return bool(np.all(np.isfinite(value)))
    return True


def broken_sign(value: Number, sign: Sign, most: float | None = None) -> tuple[str, float] | None:
    """Return the rule that a value breaks, such as ``be positive``, and the value; None if it has the sign.

    Parameters
    ----------
    value : number
    sign : str
    most : float, optional
        The largest value that is allowed; it counts if the value has the sign.
    """
    broken = _broken(value, sign)
    if broken is None and most is not None:
        broken = _failing(value, value <= most + _blur(value), f"be at most {most:g}")
    return broken


def _broken(value: Number, sign: Sign) -> tuple[str, float] | None:
    match sign:
        case "positive":
            good, rule = value > 0, "be positive"
        case "nonnegative":
            good, rule = value >= -_blur(value), "not be negative"
        case "nonzero":
            good, rule = value != 0, "not be zero"
        case _:
            return None
    return _failing(value, good, rule)


def _failing(value: Number, good: Any, rule: str) -> tuple[str, float] | None:
    if all_of(good):
        return None
    shown = value[~good].flat[0] if getattr(value, "shape", ()) else value
    return rule, nominal(shown.lower() if hasattr(shown, "lower") else shown)


def _blur(value: Number) -> Number:
    """Return how much the rounded radius of a wide ball adds to it, so that the ends of an interval count as points."""
    return value.rad() * 2.0**-20 if hasattr(value, "rad") else 0


def all_of(condition: Any) -> bool:
    """Whether a condition holds, at all points if it is one of an array."""
    return bool(condition.all()) if hasattr(condition, "all") else bool(condition)


def nominal(x: Number) -> float:
    """Return a number as a float, the first one of an array."""
    return float(x.flat[0]) if hasattr(x, "flat") else float(x)


def is_extreme(value: object) -> bool:
    """Return whether something is a number whose powers leave the range of double precision."""
    try:
        size = abs(float(value))  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        return False
    return size > 1e60 or 0.0 < size < 1e-60
