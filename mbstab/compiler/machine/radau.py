"""The method Radau IIA of `mbstab.analysis.simulate.steppers.implicit` in machine code.

The eigenvalues λ of the coefficients A, one real and two complex conjugate, part the linear equations of the three
stages (Hairer and Wanner 1996, section IV.8). With x = h λ, the change of η as λ η', and y = a + G η' with that of a,
each is

    (M + x R + x² K) y + Jᵀ ν − (M + x R) G η' = r₁,   C y = r₂,   (D + x V_q) y − D G η' = r₃,
    C G η' = x V_q y − r₃ + r₂,

where the last line is the difference of the rows in velocity and in position. There the term of y is small: η' is found
without it, then y and ν from the first line, then η' anew. Iterations take away what is left.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from mbstab.compiler.machine import formulas
from mbstab.compiler.machine import tables as at
from mbstab.compiler.machine.constraints import follower, watched
from mbstab.compiler.machine.formulas import CONVERGED, DIVERGES, GOES_ON
from mbstab.compiler.machine.formulas import RADAU_A as A
from mbstab.compiler.machine.formulas import RADAU_C as C
from mbstab.compiler.machine.formulas import RADAU_E as E
from mbstab.compiler.machine.implicit import arrived, consistent, cover, moved, newton, step_control
from mbstab.compiler.machine.interpreter import evaluate
from mbstab.compiler.machine.native import called, compiled, complexes, copy, fill, floats, integers
from mbstab.compiler.machine.newton import decompose, differentiate, imbalance, solved, times, violation
from mbstab.compiler.machine.tables import Floats, Implicit, Machine, March

STAGES = 3

_values, _left = np.linalg.eig(A)
_right = np.linalg.inv(_left)
_real, _pair = int(np.argmin(np.abs(_values.imag))), int(np.argmax(_values.imag))
ONE, OTHER = float(_values[_real].real), complex(_values[_pair])
LEFT, RIGHT = _left[:, _real].real.copy(), _right[_real].real.copy()
LEFT_PAIR, RIGHT_PAIR = _left[:, _pair].copy(), _right[_pair].copy()
"""The real eigenvalue and one of the complex pair; their eigenvectors and their rows of the inverse."""

weight = compiled(formulas.weight)


@compiled
def prepare(m: Machine, p: Implicit, t: float, y: Floats, a: Floats, nu: Floats) -> bool:
    """Keep the derivatives at the start of a step, and factor C Cᵀ."""
    c = floats(m, at.NEWTON_C)
    if not differentiate(m, t, y, a, nu, p.kink, floats(m, at.OTHER)):
        return False
    fill(c, 0.0)
    c[at.HOLONOMIC], c[at.HOLONOMIC_FORCE] = 1.0, 1.0
    decompose(m, 1.0, c, floats(m, at.GRAM))
    return True


@compiled
def begin(m: Machine, s: March, p: Implicit) -> bool:
    """Start at the state of a march."""
    y, a, nu = floats(m, at.Y), floats(m, at.A), floats(m, at.NU)
    s.counts[at.EVALUATIONS] += 2
    s.t[at.LENGTH] = 0.0
    return consistent(m, s.t[at.TIME], y, a, nu) and watched(m, s) and prepare(m, p, s.t[at.TIME], y, a, nu)


@compiled
def weigh(c: Any, x: Any) -> None:
    """Set the coefficients of the matrix of y and ν for x = h λ."""
    fill(c, 1.0)
    c[at.STIFFNESS], c[at.DAMPING] = x * x, x
    c[at.HOLONOMIC_RATE], c[at.NONHOLONOMIC_RATE] = 0.0, x


@compiled
def predict(m: Machine, s: March, h: float) -> None:
    """Extrapolate accelerations and multipliers of the stages from the last step."""
    stage_a, stage_nu = floats(m, at.STAGE_A), floats(m, at.STAGE_NU)
    last_a, last_nu = floats(m, at.LAST_A), floats(m, at.LAST_NU)
    a, nu, n, rows = floats(m, at.A), floats(m, at.NU), m.coordinates, m.rows
    length = s.t[at.LENGTH]
    for i in range(STAGES):
        if length == 0.0:
            copy(stage_a[i * n : i * n + n], a)
            copy(stage_nu[i * rows : i * rows + rows], nu)
            continue
        for k in range(n):
            stage_a[i * n + k] = 0.0
        for k in range(rows):
            stage_nu[i * rows + k] = 0.0
        for j in range(STAGES):
            part = weight(C, i, j, h, length)
            for k in range(n):
                stage_a[i * n + k] += part * last_a[j * n + k]
            for k in range(rows):
                stage_nu[i * rows + k] += part * last_nu[j * rows + k]


@compiled
def unfold(m: Machine, h: float) -> None:
    """Find speeds and positions of the stages."""
    begun, y, n = floats(m, at.Y), floats(m, at.STAGE_Y), m.coordinates
    a, pull = floats(m, at.STAGE_A), floats(m, at.STAGE_PULL)
    for k in range(n):
        for i in range(STAGES):
            speed = begun[n + k]
            for j in range(STAGES):
                speed += h * A[i, j] * a[j * n + k]
            y[2 * n * i + n + k] = speed
        for i in range(STAGES):
            position = begun[k]
            for j in range(STAGES):
                position += h * A[i, j] * (y[2 * n * j + n + k] + pull[j * n + k])
            y[2 * n * i + k] = position


@compiled
def look(m: Machine, s: March, h: float) -> bool:
    """Find what the stages leave of the equations, of rows in velocity and of rows in position."""
    row_place, n, rows = integers(m, at.ROW_PLACE), m.coordinates, m.rows
    y, a, nu = floats(m, at.STAGE_Y), floats(m, at.STAGE_A), floats(m, at.STAGE_NU)
    all_b, all_e = floats(m, at.STAGE_B), floats(m, at.STAGE_E)
    size = len(all_b) // STAGES
    for i in range(STAGES):
        b, e = all_b[i * size : i * size + size], all_e[i * size : i * size + size]
        s.counts[at.EVALUATIONS] += 1
        if not evaluate(m, s.t[at.TIME] + C[i] * h, y[2 * n * i : 2 * n * i + 2 * n], 1):
            return False
        imbalance(m, a[i * n : i * n + n], nu[i * rows : i * rows + rows], b)
        for k in range(rows):
            if row_place[k] >= 0:
                b[row_place[k]] = violation(m, k, 1) / h
                if k < m.holonomic:
                    e[row_place[k]] = violation(m, k, 0) / (h * h)
    return True


@compiled
def part(m: Machine, eigenvalue: Any, x: Any, c: Any, lu: Any, b: Any, e: Any, g: Any) -> None:
    """Solve the part of an eigenvalue: b becomes the changes of a and ν, g that of G η; b, e: what is left."""
    gram = floats(m, at.GRAM)
    place, row_place = integers(m, at.PLACE), integers(m, at.ROW_PLACE)
    fill(g, 0.0)
    for i in range(m.rows):
        k = row_place[i]
        if k >= 0:
            b[k] /= eigenvalue
            if i < m.holonomic:
                position = e[k] / (eigenvalue * eigenvalue)
                e[k] = position - b[k]
                b[k], g[k] = position, e[k]
    solved(m, gram, g)
    fill(c, 0.0)
    c[at.MASS], c[at.DAMPING], c[at.NONHOLONOMIC] = 1.0, x, 1.0
    times(m, c, g, b)
    solved(m, lu, b)
    fill(g, 0.0)
    for i in range(m.holonomic):
        if row_place[i] >= 0:
            g[row_place[i]] = e[row_place[i]]
    fill(c, 0.0)
    c[at.HOLONOMIC_RATE] = x
    times(m, c, b, g)
    solved(m, gram, g)
    for i in range(m.coordinates):
        b[place[i]] -= g[place[i]]
        g[place[i]] *= eigenvalue


@compiled
def gather(weights: Any, x: Floats, y: Any) -> None:
    """Set y to the part of an eigenvalue in what is given by stages."""
    for k in range(len(y)):
        y[k] = 0.0
        for i in range(STAGES):
            y[k] += weights[i] * x[i * len(y) + k]


@compiled
def spread(m: Machine, h: float) -> None:
    """Change accelerations, multipliers and corrections of the stages."""
    n, rows = m.coordinates, m.rows
    place, row_place = integers(m, at.PLACE), integers(m, at.ROW_PLACE)
    scale, row_scale = floats(m, at.SCALE), floats(m, at.ROW_SCALE)
    real_b, real_g = floats(m, at.NEWTON_B), floats(m, at.REAL_G)
    complex_b, complex_g = complexes(m, at.COMPLEX_B), complexes(m, at.COMPLEX_G)
    a, nu, pull = floats(m, at.STAGE_A), floats(m, at.STAGE_NU), floats(m, at.STAGE_PULL)
    step_a, step_pull = floats(m, at.STEP_A), floats(m, at.STEP_PULL)
    for i in range(STAGES):
        real, weight = LEFT[i], 2.0 * LEFT_PAIR[i]
        for k in range(n):
            step_a[i * n + k] = scale[k] * (real * real_b[place[k]] + (weight * complex_b[place[k]]).real)
            step_pull[i * n + k] = h * scale[k] * (real * real_g[place[k]] + (weight * complex_g[place[k]]).real)
            a[i * n + k] += step_a[i * n + k]
            pull[i * n + k] += step_pull[i * n + k]
        for k in range(rows):
            if row_place[k] >= 0:
                change = real * real_b[row_place[k]] + (weight * complex_b[row_place[k]]).real
                nu[i * rows + k] += row_scale[k] * change


@compiled
def changed(m: Machine, p: Implicit, h: float) -> float:
    """Return the size of the last changes of positions and speeds of the stages."""
    n, sizes, size = m.coordinates, floats(m, at.SIZES), 0.0
    step_a, step_pull = floats(m, at.STEP_A), floats(m, at.STEP_PULL)
    for k in range(n):
        a0, a1, a2 = step_a[k], step_a[n + k], step_a[2 * n + k]
        du = (
            h * (A[0, 0] * a0 + A[0, 1] * a1 + A[0, 2] * a2),
            h * (A[1, 0] * a0 + A[1, 1] * a1 + A[1, 2] * a2),
            h * (A[2, 0] * a0 + A[2, 1] * a1 + A[2, 2] * a2),
        )
        for i in range(STAGES):
            dq = 0.0
            for j in range(STAGES):
                dq += h * A[i, j] * (du[j] + step_pull[j * n + k])
            one = max(abs(dq), abs(du[i]) / p.rate) / sizes[k]
            if not one <= size:
                size = one
    return size


@compiled
def iterate(m: Machine, s: March, p: Implicit, h: float) -> bool:
    """Find the stages of a step by Newton's method."""
    c, lu = floats(m, at.NEWTON_C), floats(m, at.NEWTON_LU)
    complex_c, complex_lu = complexes(m, at.COMPLEX_C), complexes(m, at.COMPLEX_LU)
    b, e, g = floats(m, at.NEWTON_B), floats(m, at.REAL_E), floats(m, at.REAL_G)
    complex_b, complex_e, complex_g = complexes(m, at.COMPLEX_B), complexes(m, at.COMPLEX_E), complexes(m, at.COMPLEX_G)
    all_b, all_e = floats(m, at.STAGE_B), floats(m, at.STAGE_E)
    weigh(c, h * ONE)
    decompose(m, 0.0, c, lu)
    weigh(complex_c, h * OTHER)
    decompose(m, 0.0, complex_c, complex_lu)
    predict(m, s, h)
    fill(floats(m, at.STAGE_PULL), 0.0)
    found, before, k = GOES_ON, math.inf, 0
    while found == GOES_ON and k < p.iterations:
        unfold(m, h)
        if look(m, s, h):
            gather(RIGHT, all_b, b)
            gather(RIGHT, all_e, e)
            gather(RIGHT_PAIR, all_b, complex_b)
            gather(RIGHT_PAIR, all_e, complex_e)
            part(m, ONE, h * ONE, c, lu, b, e, g)
            part(m, OTHER, h * OTHER, complex_c, complex_lu, complex_b, complex_e, complex_g)
            spread(m, h)
            size = changed(m, p, h)
            found = newton(size, before, h, p.rate, p.goal, p.stalled)
            before = size
        else:
            found = DIVERGES
        k += 1
    return found == CONVERGED


@compiled
def error_of(m: Machine, p: Implicit, h: float) -> float:
    """Return the difference from an embedded formula of order 3, damped where stiff, relative to the tolerance."""
    n, place, begun, y, a = (
        m.coordinates,
        integers(m, at.PLACE),
        floats(m, at.Y),
        floats(m, at.STAGE_Y),
        floats(m, at.A),
    )
    scale, sizes, c = floats(m, at.SCALE), floats(m, at.SIZES), floats(m, at.NEWTON_C)
    b, in_q, in_u = floats(m, at.NEWTON_B), floats(m, at.REAL_G), floats(m, at.REAL_E)
    gamma, size = ONE, 0.0
    fill(b, 0.0)
    fill(in_q, 0.0)
    fill(in_u, 0.0)
    for k in range(n):
        q, u = gamma * h * begun[n + k], gamma * h * a[k]
        for i in range(STAGES):
            q += gamma * E[i] * (y[2 * n * i + k] - begun[k])
            u += gamma * E[i] * (y[2 * n * i + n + k] - begun[n + k])
        in_q[place[k]], in_u[place[k]] = q / scale[k], u / scale[k]
    fill(c, 0.0)
    c[at.MASS] = 1.0
    times(m, c, in_u, b)
    c[at.MASS], c[at.STIFFNESS] = 0.0, -gamma * h
    times(m, c, in_q, b)
    solved(m, floats(m, at.NEWTON_LU), b)
    for k in range(n):
        du = b[place[k]]
        one = scale[k] / sizes[k] * max(abs(in_q[place[k]] + gamma * h * du), abs(du) / p.rate)
        if not one <= size:
            size = one
    return size / p.tol


@compiled
def attempt(m: Machine, s: March, p: Implicit, h: float) -> float:
    """Make a step; return its error relative to the tolerance, nan where it fails."""
    n, error = m.coordinates, math.nan
    if iterate(m, s, p, h):
        unfold(m, h)
        copy(floats(m, at.TRIAL), floats(m, at.STAGE_Y)[4 * n :])
        error = 0.0 if p.fixed else error_of(m, p, h)
    return error


@compiled
def accept(m: Machine, s: March, p: Implicit, t: float, h: float) -> bool:
    """Keep what the next step needs."""
    copy(floats(m, at.LAST_A), floats(m, at.STAGE_A))
    copy(floats(m, at.LAST_NU), floats(m, at.STAGE_NU))
    s.t[at.LENGTH] = h
    s.counts[at.EVALUATIONS] += 1
    moved(m)
    return prepare(m, p, t, floats(m, at.TRIAL), floats(m, at.A), floats(m, at.NU))


follow = follower(begin, step_control(attempt), arrived, cover, accept)


@called
def march(m: Machine, p: Implicit, s: March, most: int, fresh: bool) -> int:
    """Take steps of the method Radau IIA; return why it ended."""
    return follow(m, s, p, most, fresh)
