"""Failures of arithmetic as errors a user can act on."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import ParamSpec, TypeVar

import numpy as np

from mbstab.errors import NumericalError

P = ParamSpec("P")
T = TypeVar("T")


def guarded(function: Callable[P, T]) -> Callable[P, T]:
    """Return a function whose overflows, divisions by zero and failed factorizations are a `NumericalError`."""

    @functools.wraps(function)
    def inner(*args: P.args, **kwargs: P.kwargs) -> T:
        try:
            with np.errstate(over="raise", divide="raise", invalid="raise", under="ignore"):
                return function(*args, **kwargs)
        except (ArithmeticError, np.linalg.LinAlgError) as error:
            raise NumericalError(
                f"the computation left the range of double precision ({error})\n"
                "hint: look for numbers of extreme size in the file, or measure length, mass and time in other units"
            ) from error

    return inner
