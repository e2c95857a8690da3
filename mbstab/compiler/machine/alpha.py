"""The generalized-α method of `mbstab.analysis.simulate.steppers.implicit` in machine code."""

from __future__ import annotations

import math

from mbstab.compiler.machine import formulas
from mbstab.compiler.machine import tables as at
from mbstab.compiler.machine.constraints import SPEEDS, follower, settle, watched
from mbstab.compiler.machine.formulas import ALPHA_ERROR, ALPHA_F, ALPHA_M, CONVERGED, DIVERGES, GOES_ON
from mbstab.compiler.machine.implicit import arrived, balanced, consistent, cover, moved, newton, size_of, step_control
from mbstab.compiler.machine.interpreter import evaluate
from mbstab.compiler.machine.linear import factor
from mbstab.compiler.machine.native import called, compiled, copy, fill, floats, integers
from mbstab.compiler.machine.newton import decompose, differentiate, imbalance, solved, violation
from mbstab.compiler.machine.tables import Floats, Implicit, Machine, March

alpha_known, alpha_factors = compiled(formulas.alpha_known), compiled(formulas.alpha_factors)


@compiled
def begin(m: Machine, s: March, p: Implicit) -> bool:
    """Start at the state of a march: its accelerations, and their rate from those nearby."""
    t, n, begun, y = s.t[at.TIME], m.coordinates, floats(m, at.Y), floats(m, at.TRIAL)
    a, nu, next_a, next_nu = floats(m, at.A), floats(m, at.NU), floats(m, at.NEXT_A), floats(m, at.NEXT_NU)
    jerk, drift, x = floats(m, at.JERK), floats(m, at.DRIFT), 1e-4 / p.rate
    s.counts[at.EVALUATIONS] += 3
    if not consistent(m, t, begun, a, nu):
        return False
    for k in range(2):
        part = x if k == 0 else -x
        for i in range(n):
            y[i] = begun[i] + part * begun[n + i] + 0.5 * part * part * a[i]
            y[n + i] = begun[n + i] + part * a[i]
        if not consistent(m, t + part, y, next_a, next_nu):
            return False
        for i in range(n):
            jerk[i] = next_a[i] if k == 0 else (jerk[i] - next_a[i]) / (2.0 * x)
    for i in range(n):
        drift[i] = (ALPHA_M - ALPHA_F) * jerk[i]  # (w − a)/h
    s.t[at.LENGTH] = 0.0
    return consistent(m, t, begun, a, nu) and watched(m, s)


@compiled
def arrive(m: Machine, to_q: float, to_u: float) -> None:
    """Set the state at the end of a step to what its accelerations make of it."""
    n, y, known, next_a = m.coordinates, floats(m, at.TRIAL), floats(m, at.KNOWN), floats(m, at.NEXT_A)
    for i in range(n):
        y[i], y[n + i] = known[i] + to_q * next_a[i], known[n + i] + to_u * next_a[i]


@compiled
def correct(m: Machine, da: Floats, to_q: float, to_u: float) -> None:
    """Change accelerations and multipliers at the end of a step by what its factored Newton matrix makes of it."""
    place, row_place = integers(m, at.PLACE), integers(m, at.ROW_PLACE)
    scale, row_scale = floats(m, at.SCALE), floats(m, at.ROW_SCALE)
    b, next_a, next_nu = floats(m, at.NEWTON_B), floats(m, at.NEXT_A), floats(m, at.NEXT_NU)
    imbalance(m, next_a, next_nu, b)
    for i in range(m.rows):
        if row_place[i] >= 0:
            b[row_place[i]] = violation(m, i, 0) / to_q if i < m.holonomic else violation(m, i, 1) / to_u
    solved(m, floats(m, at.NEWTON_LU), b)
    for i in range(m.coordinates):
        da[i] = b[place[i]] * scale[i]
        next_a[i] += da[i]
    for i in range(m.rows):
        if row_place[i] >= 0:
            next_nu[i] += b[row_place[i]] * row_scale[i]


@compiled
def iterate(m: Machine, s: March, p: Implicit, h: float, to_q: float, to_u: float) -> bool:
    """Find accelerations and multipliers at the end of a step by Newton's method."""
    t, y, da, before = s.t[at.TIME] + h, floats(m, at.TRIAL), floats(m, at.CHANGE), math.inf
    c, lu, found, k = floats(m, at.NEWTON_C), floats(m, at.NEWTON_LU), GOES_ON, 0
    fill(c, 1.0)
    c[at.STIFFNESS], c[at.DAMPING] = to_q, to_u
    c[at.HOLONOMIC_RATE], c[at.NONHOLONOMIC_RATE] = 0.0, to_q / to_u
    while found == GOES_ON and k < p.iterations:
        arrive(m, to_q, to_u)
        s.counts[at.EVALUATIONS] += 1
        known = True
        if k == 0:
            s.counts[at.EVALUATIONS] += 1
            known = differentiate(m, t, y, floats(m, at.NEXT_A), floats(m, at.NEXT_NU), p.kink, floats(m, at.OTHER))
            decompose(m, 0.0, c, lu)
        else:
            known = evaluate(m, t, y, 1)
        if known:
            correct(m, da, to_q, to_u)
            size = size_of(m, p, da, da, to_q, to_u)
            found = newton(size, before, h, p.rate, p.goal, p.stalled)
            before = size
        else:
            found = DIVERGES
        k += 1
    return found == CONVERGED


@compiled
def attempt(m: Machine, s: March, p: Implicit, h: float) -> float:
    """Make a step; return its error relative to the tolerance, nan where it fails."""
    n, begun, known, a, next_a = (
        m.coordinates,
        floats(m, at.Y),
        floats(m, at.KNOWN),
        floats(m, at.A),
        floats(m, at.NEXT_A),
    )
    jerk, drift, ahead, da = floats(m, at.JERK), floats(m, at.DRIFT), floats(m, at.AHEAD), floats(m, at.CHANGE)
    past = floats(m, at.PAST)
    c, to_q, to_u = alpha_factors(h)
    for i in range(n):
        ahead[i], known[i], known[n + i] = alpha_known(h, begun[i], begun[n + i], a[i], drift[i])
        next_a[i] = a[i] + h * jerk[i]
    copy(floats(m, at.NEXT_NU), floats(m, at.NU))
    error = math.nan
    if iterate(m, s, p, h, to_q, to_u):
        arrive(m, to_q, to_u)
        for i in range(n):
            ahead[i] += c * next_a[i]
        if p.fixed:
            error = 0.0
        else:
            copy(da, next_a)
            if straightened(m, s, h):
                # w follows the accelerations, whose change gives the error.
                for i in range(n):
                    ahead[i] += next_a[i] - da[i]
                    da[i] = next_a[i] - a[i]
                in_q = ALPHA_ERROR * h * h
                error = size_of(m, p, da, da, in_q, 0.0)
                for i in range(n):
                    da[i] -= h * jerk[i] if s.t[at.LENGTH] == 0.0 else h / s.t[at.LENGTH] * past[i]
                error = max(error, size_of(m, p, da, da, 0.0, h / 12.0)) / p.tol
    return error


@compiled
def straightened(m: Machine, s: March, h: float) -> bool:
    """Move the speeds at the end of a step onto the constraints, and make the accelerations consistent.

    Variable steps would turn the error of speeds normal to the constraints into jumps of accelerations.
    """
    if not settle(m, s.t[at.TIME] + h, floats(m, at.TRIAL), s.counts, SPEEDS) < math.inf:
        return False
    factor(m)
    return balanced(m, floats(m, at.NEXT_A), floats(m, at.NEXT_NU))


@compiled
def accept(m: Machine, s: March, p: Implicit, t: float, h: float) -> bool:
    """Keep what the next step needs."""
    a, next_a, past = floats(m, at.A), floats(m, at.NEXT_A), floats(m, at.PAST)
    jerk, drift, ahead = floats(m, at.JERK), floats(m, at.DRIFT), floats(m, at.AHEAD)
    for i in range(m.coordinates):
        past[i] = next_a[i] - a[i]
        jerk[i] = past[i] / h
        drift[i] = (ahead[i] - next_a[i]) / h
    s.t[at.LENGTH] = h
    moved(m)
    return True


follow = follower(begin, step_control(attempt), arrived, cover, accept)


@called
def march(m: Machine, p: Implicit, s: March, most: int, fresh: bool) -> int:
    """Take steps of the generalized-α method; return why it ended."""
    return follow(m, s, p, most, fresh)
