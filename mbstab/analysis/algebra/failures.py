"""Arithmetic failures as errors that a user can act on."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable
from typing import ParamSpec, TypeVar

import numpy as np

from mbstab.errors import MbstabError, NumericalError
from mbstab.model.numbers import is_extreme

FAILURES = (MbstabError, ArithmeticError, ValueError, np.linalg.LinAlgError)
"""Errors of equations that have no value at a trial."""

P = ParamSpec("P")
T = TypeVar("T")


def guarded(
    function: Callable[P, T], numbers: Callable[P, Iterable[str]] = lambda *args, **kwargs: ()
) -> Callable[P, T]:
    """Return a function whose overflows, divisions by zero and similar failures raise a `NumericalError`.

    `numbers` returns what may be the cause, from the same arguments: numbers of extreme size, in words.
    """

    @functools.wraps(function)
    def inner(*args: P.args, **kwargs: P.kwargs) -> T:
        try:
            with np.errstate(over="raise", divide="raise", invalid="raise", under="ignore"):
                return function(*args, **kwargs)
        except (ArithmeticError, np.linalg.LinAlgError) as error:
            found = [f"{name}={value}" for name, value in kwargs.items() if is_extreme(value)]
            found += numbers(*args, **kwargs)
            where = f"at {' and '.join(found)}, or numbers" if found else "for numbers"
            raise NumericalError(
                f"the computation left the range of double precision ({error})\n"
                f"hint: look {where} of extreme size in the file, or measure length, mass and time in other units"
            ) from error
        except MemoryError as error:
            raise NumericalError(
                f"there is not enough memory ({str(error) or 'no allocation was possible'})\n"
                "hint: matrices of a scene with n coordinates take about 640 n^2 bytes; ask about a part of the scene"
            ) from error

    return inner
