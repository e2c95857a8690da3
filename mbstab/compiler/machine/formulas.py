"""Coefficients, step control and formulas of implicit methods, of floats or arrays of them.

The steps of `mbstab.analysis.simulate.steppers.implicit` call them as they are, those in machine code as Numba compiles
them.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

RHO = 0.8
"""Spectral radius at infinity of the generalized-α method: 1 keeps all frequencies, 0 damps the highest at once."""

ALPHA_M, ALPHA_F = (2.0 * RHO - 1.0) / (RHO + 1.0), RHO / (RHO + 1.0)
GAMMA = 0.5 + ALPHA_F - ALPHA_M
BETA = 0.25 * (GAMMA + 0.5) ** 2
ALPHA_ERROR = abs(BETA + 0.5 * (ALPHA_M - ALPHA_F) - 1.0 / 6.0)
"""Of h² times the change of the accelerations: the error of positions."""

ROOT = math.sqrt(6.0)
RADAU_C = np.array([(4.0 - ROOT) / 10.0, (4.0 + ROOT) / 10.0, 1.0])
RADAU_A = np.array(
    [
        [(88.0 - 7.0 * ROOT) / 360.0, (296.0 - 169.0 * ROOT) / 1800.0, (-2.0 + 3.0 * ROOT) / 225.0],
        [(296.0 + 169.0 * ROOT) / 1800.0, (88.0 + 7.0 * ROOT) / 360.0, (-2.0 - 3.0 * ROOT) / 225.0],
        [(16.0 - ROOT) / 36.0, (16.0 + ROOT) / 36.0, 1.0 / 9.0],
    ]
)
RADAU_E = np.array([-13.0 - 7.0 * ROOT, -13.0 + 7.0 * ROOT, -1.0]) / 3.0
RADAU_GAMMA = 1.0 / (3.0 + 3.0 ** (2.0 / 3.0) - 3.0 ** (1.0 / 3.0))
"""Inverse of the real eigenvalue of the inverse of the coefficients: the weight of the slope at the start of a step."""

GOES_ON, CONVERGED, DIVERGES = range(3)
"""What Newton's method does."""


def tried(size: float, left: float, longest: float, fixed: bool) -> tuple[float, bool]:
    """Return the step to try (s) where the next one has a size and some time is left, and whether it is the last."""
    h = min(size, left)
    if not fixed:
        h = min(h, longest)
        if h < left < 1.5 * h:
            h = 0.5 * left
    last = left - h <= 1e-9 * h
    return left if last else h, last


def shortened(h: float, error: float, power: float) -> float:
    """Return the step after one whose error, relative to the tolerance, is too large or not finite."""
    return h * (max(0.2, 0.85 * error**-power) if math.isfinite(error) else 0.25)


def lengthened(size: float, h: float, error: float, power: float, failures: int, last: bool) -> float:
    """Return the size of the next step after one of h (s), tried after some failures, whose error is small enough."""
    factor = min(4.0, 0.85 * max(error, 1e-10) ** -power)
    if failures > 0:
        factor = min(factor, 1.0)
    return size if 1.0 <= factor <= 1.3 or last else h * factor


def newton(size: float, before: float, h: float, rate: float, goal: float, stalled: float) -> int:
    """Return what Newton's method does with a correction of a size after another.

    It has converged where the correction is at its goal, or stops shrinking below `stalled`: rounding of positions
    moves speeds, relative to the rate that counts as fast, by as much over the step.
    """
    longer = max(1.0, 1.0 / (h * rate))
    if size <= goal or (before < math.inf and size > 0.3 * before and size <= stalled * longer):
        return CONVERGED
    return GOES_ON if size < 2.0 * before else DIVERGES


def quintic(x: Any, h: float, q: Any, u: Any, a: Any, next_q: Any, next_u: Any, next_a: Any) -> tuple[Any, Any]:
    """Return the polynomial through positions, speeds and accelerations at both ends of a step, at a part of it.

    With its slope.
    """
    rest = next_q - q - h * u - 0.5 * h * h * a
    slope = h * (next_u - u) - h * h * a
    bend = h * h * (next_a - a)
    c3 = 10.0 * rest - 4.0 * slope + 0.5 * bend
    c4 = -15.0 * rest + 7.0 * slope - bend
    c5 = 6.0 * rest - 3.0 * slope + 0.5 * bend
    return (
        q + x * (h * u + x * (0.5 * h * h * a + x * (c3 + x * (c4 + x * c5)))),
        u + x * (h * a + x * (3.0 * c3 + x * (4.0 * c4 + x * 5.0 * c5)) / h),
    )


def alpha_known(h: float, q: Any, u: Any, a: Any, drift: Any) -> tuple[Any, Any, Any]:
    """Return w, q and u at the end of a step of the generalized-α method, without what its accelerations add.

    `drift` is (w − a)/h at its start.
    """
    w = a + h * drift
    known = (ALPHA_F * a - ALPHA_M * w) / (1.0 - ALPHA_M)
    return (
        known,
        q + h * u + h * h * ((0.5 - BETA) * w + BETA * known),
        u + h * ((1.0 - GAMMA) * w + GAMMA * known),
    )


def alpha_factors(h: float) -> tuple[float, float, float]:
    """Return by what w, q and u at the end of a step change with its accelerations."""
    c = (1.0 - ALPHA_F) / (1.0 - ALPHA_M)
    return c, h * h * BETA * c, h * GAMMA * c


def weight(nodes: Any, i: int, j: int, h: float, length: float) -> float:
    """Return the weight of stage j of a step of some length in the prediction of stage i of the one after it."""
    found = 1.0
    for k in range(len(nodes)):
        if k != j:
            found *= (1.0 + nodes[i] * h / length - nodes[k]) / (nodes[j] - nodes[k])
    return float(found)
