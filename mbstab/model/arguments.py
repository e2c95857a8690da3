"""Arguments of questions asked in Python, checked."""

from __future__ import annotations

import numbers

import numpy as np
import numpy.typing as npt

from mbstab.errors import UsageError


def whole(name: str, value: object, least: int = 0) -> int:
    """Return an argument that is a whole number."""
    if not isinstance(value, numbers.Integral) or isinstance(value, bool) or value < least:
        raise UsageError(f"{name}={value!r}: give a whole number, {least} or more")
    return int(value)


def series(name: object, values: object) -> npt.NDArray[np.float64]:
    """Return the values of a swept parameter as an array, shape (points,)."""
    if not isinstance(name, str):
        raise UsageError(f"{name!r} is not a parameter\nhint: give its name as a text")
    try:
        found = np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        found = np.zeros(())
    if found.ndim != 1 or not np.all(np.isfinite(found)):
        raise UsageError(f"{name}: a sweep takes a list of finite numbers\nhint: such as numpy.linspace(1, 2, 11)")
    return found
