"""Implicit methods in machine code: step control, convergence, output and work, as those of the interpreted ones.

A method gives a function ``attempt(m, s, p, h)``, which finds the state at the end of a step and returns its error
relative to the tolerance, nan where it fails.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from mbstab.compiler.machine import formulas
from mbstab.compiler.machine import tables as at
from mbstab.compiler.machine.constraints import covering, passed
from mbstab.compiler.machine.interpreter import evaluate
from mbstab.compiler.machine.linear import accelerate, factor
from mbstab.compiler.machine.native import compiled, copy, floats, integers
from mbstab.compiler.machine.tables import Floats, Implicit, Machine, March

Attempt = Callable[[Machine, March, Implicit, float], float]


tried, shortened = compiled(formulas.tried), compiled(formulas.shortened)
lengthened, newton = compiled(formulas.lengthened), compiled(formulas.newton)
quintic = compiled(formulas.quintic)


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
def inside(m: Machine, s: March, p: Implicit, h: float, x: float, z: Floats) -> bool:
    """Set z to the quintic through positions, speeds and accelerations at both ends of a step, at a part of it."""
    begun, y, n = floats(m, at.Y), floats(m, at.TRIAL), m.coordinates
    a, next_a = floats(m, at.A), floats(m, at.NEXT_A)
    for i in range(n):
        z[i], z[n + i] = quintic(x, h, begun[i], begun[n + i], a[i], y[i], y[n + i], next_a[i])
    return True


cover = covering(inside)


@compiled
def arrived(m: Machine, s: March, p: Implicit, t: float) -> bool:
    """Look at the end of a step; False if it is to be left."""
    s.counts[at.EVALUATIONS] += 1
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
        t, size, failures = s.t[at.TIME], s.t[at.FOLLOWING], 0
        while True:
            h, last = tried(size, s.end - t, s.longest, p.fixed)
            error = attempt(m, s, p, h)
            if p.fixed or error <= 1.0:
                break
            s.counts[at.REJECTED] += 1
            failures += 1
            size = shortened(h, error, p.power)
            if size < p.collapsed * max(s.end - p.begin, abs(t)) or failures > 60:
                return math.nan, h, size
        if not p.fixed:
            size = lengthened(size, h, error, p.power, failures, last)
        return (math.nan if math.isnan(error) else s.end if last else t + h), h, size

    return controlled


@compiled
def moved(m: Machine) -> None:
    """Take accelerations and multipliers at the end of a step to the start of the next one."""
    copy(floats(m, at.A), floats(m, at.NEXT_A))
    copy(floats(m, at.NU), floats(m, at.NEXT_NU))
