"""Implicit methods in machine code: step control, convergence, output and work, as those of the interpreted ones.

What belongs to a method is given as three functions: ``begin(m, s, p)`` at the start of a march, ``attempt(m, s, p,
h)``, which finds the state at the end and returns the error of a step relative to the tolerance, nan where it fails,
and ``accept(m, s, p, t, h)``. The last and the first return False where they fail.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from mbstab.compiler.machine import tables as at
from mbstab.compiler.machine.constraints import WHOLE, chart_ends, passed, settle
from mbstab.compiler.machine.interpreter import evaluate
from mbstab.compiler.machine.linear import accelerate, factor, power, slope
from mbstab.compiler.machine.march import (
    CHART,
    COVERED,
    DONE,
    EVALUATIONS,
    FOLLOWING,
    LOOK,
    MORE,
    REJECTED,
    STEPS,
    TAKEN,
    TIME,
    WORK,
    Implicit,
    March,
)
from mbstab.compiler.machine.native import compiled, copy, floats, integers
from mbstab.compiler.machine.tables import Floats, Machine

GOES_ON, CONVERGED, DIVERGES = range(3)

Begin = Callable[[Machine, March, Implicit], bool]
Attempt = Callable[[Machine, March, Implicit, float], float]
Accept = Callable[[Machine, March, Implicit, float, float], bool]


@compiled
def finished(p: Implicit, size: float, before: float, h: float) -> int:
    """Whether Newton's method has converged with a correction of this size, after one of size `before`."""
    longer = max(1.0, 1.0 / (h * p.rate))
    if size <= p.goal or (before < math.inf and size > 0.3 * before and size <= p.stalled * longer):
        return CONVERGED
    return GOES_ON if size < 2.0 * before else DIVERGES


@compiled
def size_of(m: Machine, p: Implicit, dq: Floats, du: Floats, by_q: float, by_u: float) -> float:
    """Return the size of changes of positions and speeds, times factors, in sizes of the scene."""
    sizes, size = floats(m, at.SIZES), 0.0
    for i in range(m.coordinates):
        one = max(abs(by_q * dq[i]), abs(by_u * du[i]) / p.rate) / sizes[i]
        if not one <= size:
            size = one
    return size


@compiled
def consistent(m: Machine, t: float, y: Floats, a: Floats, nu: Floats) -> bool:
    """Find the accelerations and multipliers of a state; its matrix is factored then."""
    if not evaluate(m, t, y, 1):
        return False
    factor(m)
    return balanced(m, a, nu)


@compiled
def balanced(m: Machine, a: Floats, nu: Floats) -> bool:
    """Find the accelerations and multipliers of the state of the registers, whose matrix is factored."""
    dy = floats(m, at.RATES)
    if not accelerate(m, dy):
        return False
    row_place = integers(m, at.ROW_PLACE)
    x = floats(m, at.X)
    row_scale = floats(m, at.ROW_SCALE)
    copy(a, dy[m.coordinates :])
    for i in range(m.rows):
        nu[i] = x[row_place[i]] * row_scale[i] if row_place[i] >= 0 else 0.0
    return True


@compiled
def interpolated(m: Machine, h: float, x: float, z: Floats) -> None:
    """Set z to the quintic through positions, speeds and accelerations at both ends of a step, at a part of it."""
    begun, y, n = floats(m, at.Y), floats(m, at.TRIAL), m.coordinates
    a, next_a = floats(m, at.A), floats(m, at.NEXT_A)
    for i in range(n):
        u = begun[n + i]
        rest = y[i] - begun[i] - h * u - 0.5 * h * h * a[i]
        slope = h * (y[n + i] - u) - h * h * a[i]
        bend = h * h * (next_a[i] - a[i])
        c3 = 10.0 * rest - 4.0 * slope + 0.5 * bend
        c4 = -15.0 * rest + 7.0 * slope - bend
        c5 = 6.0 * rest - 3.0 * slope + 0.5 * bend
        z[i] = begun[i] + x * (h * u + x * (0.5 * h * h * a[i] + x * (c3 + x * (c4 + x * c5))))
        z[n + i] = u + x * (h * a[i] + x * (3.0 * c3 + x * (4.0 * c4 + x * 5.0 * c5)) / h)


@compiled
def cover(m: Machine, s: March, p: Implicit, t: float, h: float) -> bool:
    """Find the work of a step to t and the states at the times of output within; False where there are none."""
    n, z, begin = m.coordinates, floats(m, at.INSIDE), s.t[TIME]
    nodes, weights = p.quadrature[0], p.quadrature[1]
    start, work, done = begin, 0.0, s.counts[COVERED]
    while True:
        inside = done < len(s.times) and s.times[done] <= t
        stop = s.times[done] if inside else t
        if m.power_register >= 0 and stop > start:
            half = 0.5 * (stop - start)
            for i in range(len(nodes)):
                middle = start + half * (1.0 + nodes[i])
                interpolated(m, h, (middle - begin) / h, z)
                s.counts[EVALUATIONS] += 1
                if not slope(m, middle, z, floats(m, at.OTHER)):
                    return False
                work += half * weights[i] * power(m, z)
        if not inside:
            break
        if stop == t:
            copy(z, floats(m, at.TRIAL))
        else:
            interpolated(m, h, (stop - begin) / h, z)
        if not settle(m, stop, z, s.counts, WHOLE) <= m.accepted:
            return False
        copy(s.found[done, : 2 * n], z)
        s.found[done, 2 * n] = s.t[WORK] + work
        start = stop
        done += 1
    s.counts[COVERED] = done
    s.t[WORK] += work
    return True


@compiled
def arrived(m: Machine, s: March, p: Implicit, t: float) -> bool:
    """Look at the end of a step; False if it is to be left."""
    s.counts[EVALUATIONS] += 1
    if not evaluate(m, t, floats(m, at.TRIAL), 1):
        return False
    factor(m)
    if p.consistent and not balanced(m, floats(m, at.NEXT_A), floats(m, at.NEXT_NU)):
        return False
    return passed(m, s)


def step_control(attempt: Attempt) -> Callable[[Machine, March, Implicit], tuple[float, float, float]]:
    """Return the function that makes a step of a method."""

    @compiled
    def controlled(m: Machine, s: March, p: Implicit) -> tuple[float, float, float]:
        """Make a step whose error is within the tolerance; return its end, nan if none, it, and the next one."""
        t, size, failures = s.t[TIME], s.t[FOLLOWING], 0
        while True:
            left = s.end - t
            h = min(size, left)
            if not p.fixed:
                h = min(h, s.longest)
                if h < left < 1.5 * h:
                    h = 0.5 * left
            last = left - h <= 1e-9 * h
            if last:
                h = left
            error = attempt(m, s, p, h)
            if p.fixed or error <= 1.0:
                break
            s.counts[REJECTED] += 1
            failures += 1
            size = h * (max(0.2, 0.85 * error**-p.power) if math.isfinite(error) else 0.25)
            if size < p.collapsed * max(s.end - p.begin, abs(t)) or failures > 60:
                return math.nan, h, size
        if not p.fixed:
            factor = min(4.0, 0.85 * max(error, 1e-10) ** -p.power)
            if failures > 0:
                factor = min(factor, 1.0)
            if not 1.0 <= factor <= 1.3 and not last:
                size = h * factor
        return (math.nan if math.isnan(error) else s.end if last else t + h), h, size

    return controlled


def follower(begin: Begin, attempt: Attempt, accept: Accept) -> Callable[[Machine, March, Implicit, int, bool], int]:
    """Return the function that takes the steps of a method."""
    controlled = step_control(attempt)

    @compiled
    def follow(m: Machine, s: March, p: Implicit, most: int, fresh: bool) -> int:
        """Take steps, at first those of a `fresh` start; return why it ended.

        A step that somebody has to look at is not taken.
        """
        y, before = floats(m, at.Y), floats(m, at.BEFORE)
        if fresh and not begin(m, s, p):
            return LOOK
        for _ in range(most):
            t, h, following = controlled(m, s, p)
            if math.isnan(t) or not arrived(m, s, p, t) or not cover(m, s, p, t, h) or not accept(m, s, p, t, h):
                return LOOK
            s.counts[STEPS] += 1
            copy(before, y)
            copy(y, floats(m, at.TRIAL))
            copy(floats(m, at.A), floats(m, at.NEXT_A))
            copy(floats(m, at.NU), floats(m, at.NEXT_NU))
            s.t[TIME], s.t[FOLLOWING], s.t[TAKEN] = t, following, h
            if chart_ends(m, before, y):
                return CHART
            if t >= s.end:
                return DONE
        return MORE

    return follow
