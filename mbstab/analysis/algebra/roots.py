"""Roots of functions of one variable."""

from __future__ import annotations

import math
from collections.abc import Callable

from mbstab.analysis.algebra.tolerances import EPS
from mbstab.errors import NumericalError


def root(f: Callable[[float], float], a: float, b: float) -> float:
    """Return the root of a function between a and b, where its signs differ, to the last digits.

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
        width = 2.0 * EPS * abs(best)
        if f_best == 0.0 or abs(b - a) <= 2.0 * width or 0.5 * width > abs(b - a):
            return best
        least = width / abs(b - a)
        xi, phi = (a - b) / (c - b), (fa - fb) / (fc - fb)
        t = 0.5
        if phi * phi < xi and (1.0 - phi) ** 2 < 1.0 - xi:
            t = fa / (fb - fa) * fc / (fb - fc) + (c - a) / (b - a) * fa / (fc - fa) * fb / (fc - fb)
        t = min(1.0 - least, max(least, t))
    return best
