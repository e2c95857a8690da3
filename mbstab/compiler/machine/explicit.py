"""Explicit integrators in machine code: many steps at once."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mbstab.compiler.machine import tables as at
from mbstab.compiler.machine.constraints import WHOLE, covering, follower, passed, settle, watched
from mbstab.compiler.machine.linear import accelerate, factor, slope
from mbstab.compiler.machine.native import called, compiled, copy, fill, floats
from mbstab.compiler.machine.tables import Floats, Machine, March

SAFETY, LEAST_FACTOR, LARGEST_FACTOR = 0.9, 0.2, 10.0
"""Of a step to the next one, as in SciPy's integrators."""


class Tableau(NamedTuple):
    """An explicit Runge-Kutta method with s stages, then the end of the step, and more for its dense output.

    The dense output is y + h Σ_j g_j(x) Σ_i W_ji K_i at the part x of the step, with g = x, x(1-x), x²(1-x), … if
    `nested`, and x, x², x³, … otherwise.
    """

    A: Floats
    C: Floats
    E: Floats  # one row, or two: of order 5 and 3, as in DOP853
    W: Floats
    stages: int
    nested: int
    exponent: float
    quadrature: Floats  # of the power: nodes in -1 … 1, weights


@compiled
def stages(m: Machine, s: March, tableau: Tableau, h: float, start: int, stop: int, y: Floats) -> bool:
    """Find the slopes at stages of a step."""
    begun = floats(m, at.Y)
    for i in range(start, stop):
        fill(y, 0.0)
        for j in range(i):
            if tableau.A[i, j] != 0.0:
                for c in range(len(y)):
                    y[c] += tableau.A[i, j] * s.k[j, c]
        for c in range(len(y)):
            y[c] = begun[c] + h * y[c]
        s.counts[at.EVALUATIONS] += 1
        if not slope(m, s.t[at.TIME] + tableau.C[i] * h, y, s.k[i]):
            return False
    return True


@compiled
def error_of(m: Machine, s: March, tableau: Tableau, h: float, y: Floats) -> float:
    """Return the error of a step relative to the tolerances, as SciPy estimates it."""
    begun = floats(m, at.Y)
    first, second = 0.0, 0.0
    for c in range(len(y)):
        scale = s.absolute[c] + s.relative * max(abs(begun[c]), abs(y[c]))
        one, other = 0.0, 0.0
        for i in range(tableau.E.shape[1]):
            one += tableau.E[0, i] * s.k[i, c]
            if len(tableau.E) == 2:
                other += tableau.E[1, i] * s.k[i, c]
        first += (one / scale) ** 2
        second += (other / scale) ** 2
    if first == 0.0 and second == 0.0:
        return 0.0
    if len(tableau.E) == 1:
        return h * math.sqrt(first / len(y))
    return h * first / math.sqrt((first + 0.01 * second) * len(y))


@compiled
def inside(m: Machine, s: March, tableau: Tableau, h: float, x: float, z: Floats) -> bool:
    """Set z to the state at a part of a step; False if the further stages that it needs are not found."""
    if not s.t[at.EXTENDED]:
        if not stages(m, s, tableau, h, tableau.stages + 1, len(tableau.C), z):
            return False
        s.t[at.EXTENDED] = 1.0
    copy(z, floats(m, at.Y))
    g = x
    for j in range(len(tableau.W)):
        for i in range(tableau.W.shape[1]):
            weight = float(h * g * tableau.W[j, i])
            if weight != 0.0:
                for c in range(len(z)):
                    z[c] += weight * s.k[i, c]
        g *= (1.0 - x if j % 2 == 0 else x) if tableau.nested else x
    return True


@compiled
def first_step(m: Machine, s: March, tableau: Tableau) -> float:
    """Return the step to begin with, as SciPy chooses it (Hairer, Norsett and Wanner 1993, section II.4)."""
    y, inside, rates = floats(m, at.Y), floats(m, at.INSIDE), floats(m, at.RATES)
    n, most = len(y), min(s.longest, s.end - s.t[at.TIME])
    place, rate = 0.0, 0.0
    for c in range(n):
        scale = s.absolute[c] + s.relative * abs(y[c])
        place += (y[c] / scale) ** 2
        rate += (s.k[0, c] / scale) ** 2
    place, rate = math.sqrt(place / n), math.sqrt(rate / n)
    h = min(1e-6 if place < 1e-5 or rate < 1e-5 else 0.01 * place / rate, most)
    for c in range(n):
        inside[c] = y[c] + h * s.k[0, c]
    s.counts[at.EVALUATIONS] += 1
    if not slope(m, s.t[at.TIME] + h, inside, rates):
        return float(h)
    bend = 0.0
    for c in range(n):
        bend += ((rates[c] - s.k[0, c]) / (s.absolute[c] + s.relative * abs(y[c]))) ** 2
    bend = math.sqrt(bend / n) / h
    longer = max(1e-6, h * 1e-3)
    if rate > 1e-15 or bend > 1e-15:
        longer = (0.01 / max(rate, bend)) ** -tableau.exponent
    return float(min(100.0 * h, longer, most))


@compiled
def begin(m: Machine, s: March, tableau: Tableau) -> bool:
    """Start at the state of a march; False if nothing can be done there."""
    y = floats(m, at.Y)
    s.counts[at.EVALUATIONS] += 1
    if not slope(m, s.t[at.TIME], y, s.k[0]):
        return False
    if s.t[at.FOLLOWING] == 0.0:
        s.t[at.FOLLOWING] = first_step(m, s, tableau)
        if not slope(m, s.t[at.TIME], y, s.k[0]):
            return False
    return watched(m, s)


@compiled
def advance(m: Machine, s: March, tableau: Tableau) -> tuple[float, float, float]:
    """Make a step whose error is within the tolerances; return its end, nan if none, it, and the next one."""
    y = floats(m, at.TRIAL)
    t, rejected, s.t[at.EXTENDED] = s.t[at.TIME], False, 0.0
    least = 10.0 * (np.nextafter(t, np.inf) - t)
    h = min(max(s.t[at.FOLLOWING], least), s.longest)
    while True:
        if h < least:
            return math.nan, h, h
        following = min(t + h, s.end)
        h = following - t
        # The last stage is the end of the step.
        found = stages(m, s, tableau, h, 1, tableau.stages + 1, y)
        error = error_of(m, s, tableau, h, y) if found else math.nan
        if error < 1.0:
            break
        ratio = SAFETY * error**tableau.exponent
        h *= ratio if ratio > LEAST_FACTOR else LEAST_FACTOR  # also where there is none
        rejected = True
        s.counts[at.REJECTED] += 1
    ratio = min(LARGEST_FACTOR, SAFETY * error**tableau.exponent) if error > 0.0 else LARGEST_FACTOR
    if rejected:
        ratio = min(1.0, ratio)
    return following, h, h * ratio


@compiled
def arrived(m: Machine, s: March, tableau: Tableau, t: float) -> bool:
    """Move the end of a step onto the constraints, find its rates, and look at it; False if it is to be left."""
    y = floats(m, at.TRIAL)
    if not settle(m, t, y, s.counts, WHOLE) <= m.accepted:
        return False
    factor(m)
    if not accelerate(m, floats(m, at.RATES)):
        return False
    return passed(m, s)


@compiled
def keep(m: Machine, s: March, tableau: Tableau, t: float, h: float) -> bool:
    """Keep the rates at the end of a step."""
    n, y, dy = m.coordinates, floats(m, at.TRIAL), floats(m, at.RATES)
    for i in range(n):
        s.k[0, i], s.k[0, n + i] = y[n + i], dy[n + i]
    return True


follow = follower(begin, advance, arrived, covering(inside), keep)


@called
def march(m: Machine, tableau: Tableau, s: March, most: int, fresh: bool) -> int:
    """Take steps of an explicit method; return why it ended."""
    return follow(m, s, tableau, most, fresh)
