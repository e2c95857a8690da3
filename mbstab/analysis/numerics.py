"""Failures of arithmetic as errors a user can act on."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import ParamSpec, TypeVar

import numpy as np
import numpy.typing as npt

from mbstab.errors import MbstabError, NumericalError

FAILURES = (MbstabError, ArithmeticError, ValueError, np.linalg.LinAlgError)
"""What a trial of equations may end in where they have no value."""

P = ParamSpec("P")
T = TypeVar("T")


def guarded(function: Callable[P, T]) -> Callable[P, T]:
    """Return a function whose overflows, divisions by zero and other failures of arithmetic are a `NumericalError`."""

    @functools.wraps(function)
    def inner(*args: P.args, **kwargs: P.kwargs) -> T:
        try:
            with np.errstate(over="raise", divide="raise", invalid="raise", under="ignore"):
                return function(*args, **kwargs)
        except (ArithmeticError, np.linalg.LinAlgError) as error:
            found = [f"{name}={value}" for name, value in kwargs.items() if _is_extreme(value)]
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


def _is_extreme(value: object) -> bool:
    """Whether an argument is a number whose powers leave the range of double precision."""
    try:
        size = abs(float(value))  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        return False
    return size > 1e60 or 0.0 < size < 1e-60


def norms(vectors: npt.NDArray[np.float64], axis: int = -1, keepdims: bool = False) -> npt.NDArray[np.float64]:
    """Return the lengths of vectors along an axis, to be divided by: 1 for those that are zero."""
    found = np.linalg.norm(vectors, axis=axis, keepdims=keepdims)
    return np.where(found > 0.0, found, 1.0)


def assigned(cost: npt.NDArray[np.float64]) -> npt.NDArray[np.intp]:
    """Return for each row of a square matrix the column it is paired with, so that the sum is least.

    Shortest augmenting paths (Jonker and Volgenant 1987, Computing 38). For the few eigenvalues of
    a mechanism this is done long before SciPy's routine for the same would be imported.
    """
    n = len(cost)
    u, v = np.zeros(n), np.zeros(n + 1)
    row_of = np.full(n + 1, -1)  # the last column is where paths start
    for row in range(n):
        row_of[n], j = row, n
        least, before = np.full(n, np.inf), np.full(n, n)
        seen = np.zeros(n + 1, dtype=bool)
        while row_of[j] >= 0:
            seen[j] = True
            i = int(row_of[j])
            reduced = cost[i] - u[i] - v[:n]
            better = ~seen[:n] & (reduced < least)
            least[better], before[better] = reduced[better], j
            following = int(np.argmin(np.where(seen[:n], np.inf, least)))
            delta = float(least[following])
            u[row_of[np.flatnonzero(seen)]] += delta
            v[seen] -= delta
            least[~seen[:n]] -= delta
            j = following
        while j != n:
            row_of[j] = row_of[before[j]]
            j = int(before[j])
    columns = np.empty(n, dtype=np.intp)
    columns[row_of[:n]] = np.arange(n)
    return columns


def root(f: Callable[[float], float], a: float, b: float) -> float:
    """Return where a function with values of opposite sign at a and b is zero, to the last digits.

    Inverse quadratic interpolation where that is safe, bisection otherwise (Chandrupatla 1997,
    Adv. Eng. Software 28).

    Raises
    ------
    NumericalError
        If the function has no value in between.
    """
    a, b = float(a), float(b)
    fa, fb = f(a), f(b)
    for x, fx in ((a, fa), (b, fb)):
        if fx == 0.0:
            return x
    c, fc, t = a, fa, 0.5
    for _ in range(200):
        x = a + t * (b - a)
        fx = f(x)
        if not math.isfinite(fx):
            raise NumericalError(f"a function whose zero is looked for has no value at {x:.17g}")
        if (fx > 0.0) == (fa > 0.0):
            c, fc = a, fa
        else:
            c, fc, b, fb = b, fb, a, fa
        a, fa = x, fx
        best, f_best = (a, fa) if abs(fa) < abs(fb) else (b, fb)
        width = 2.0 * float(np.finfo(float).eps) * abs(best)
        if f_best == 0.0 or abs(b - a) <= 2.0 * width or 0.5 * width > abs(b - a):
            return best
        least = width / abs(b - a)
        xi, phi = (a - b) / (c - b), (fa - fb) / (fc - fb)
        t = 0.5
        if phi * phi < xi and (1.0 - phi) ** 2 < 1.0 - xi:
            t = fa / (fb - fa) * fc / (fb - fc) + (c - a) / (b - a) * fa / (fc - fa) * fb / (fc - fb)
        t = min(1.0 - least, max(least, t))
    return best
