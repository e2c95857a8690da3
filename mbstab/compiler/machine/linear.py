"""The linear equations of a state, and what follows from their solution: accelerations, power, slopes.

The equations [[M, Jᵀ], [J, 0]] [x; ν] = b, in coordinates scaled by the masses they carry, are factored as L D Lᵀ in
an order that never changes, coordinates before the rows in which they occur. Little numbers on the diagonal, ± `DELTA`
of the tables, make that safe whatever vanishes on the way (Vanderbei 1995, SIAM J. Optim. 5, on quasidefinite
matrices), and iterative refinement with the true matrix takes away what they change.
"""

from __future__ import annotations

import math

from mbstab.compiler.machine import tables as at
from mbstab.compiler.machine.interpreter import evaluate
from mbstab.compiler.machine.native import compiled, copy, fill, floats, integers
from mbstab.compiler.machine.tables import Floats, Machine

REFINED, CONTRACTION, REFINEMENTS = 1e-13, 0.1, 8
"""A solution is finished when its next change will be below this part of it; each is at most that part of the last."""


@compiled
def factor(m: Machine) -> None:
    """Factor the matrix at the state of the registers."""
    start = integers(m, at.COLUMN_START)
    entry_row = integers(m, at.ENTRY_ROW)
    entry_register = integers(m, at.ENTRY_REGISTER)
    entry_target = integers(m, at.ENTRY_TARGET)
    update_start = integers(m, at.UPDATE_START)
    row = integers(m, at.LOWER_ROW)
    update_target = integers(m, at.UPDATE_TARGET)
    lower = floats(m, at.LOWER)
    diagonal = floats(m, at.DIAGONAL)
    shift = floats(m, at.SHIFT)
    w = floats(m, at.W)
    entry_factor = floats(m, at.ENTRY_FACTOR)
    entry_value = floats(m, at.ENTRY_VALUE)
    fill(lower, 0.0)
    copy(diagonal, shift)
    for e in range(len(entry_row)):
        value = w[entry_register[e]] * entry_factor[e]
        entry_value[e] = value
        if entry_target[e] < 0:
            diagonal[entry_row[e]] += value
        else:
            lower[entry_target[e]] += value
    for k in range(len(diagonal)):
        inverse, update = 1.0 / diagonal[k], update_start[k]
        diagonal[k] = inverse
        for i in range(start[k], start[k + 1]):
            part = lower[i] * inverse
            diagonal[row[i]] -= part * lower[i]
            for j in range(i + 1, start[k + 1]):
                lower[update_target[update]] -= part * lower[j]
                update += 1
            lower[i] = part


@compiled
def substitute(m: Machine, x: Floats) -> None:
    """Replace x by what the factors make of it."""
    start = integers(m, at.COLUMN_START)
    rows = integers(m, at.LOWER_ROW)
    lower = floats(m, at.LOWER)
    diagonal = floats(m, at.DIAGONAL)
    for k in range(len(x)):
        for i in range(start[k], start[k + 1]):
            x[rows[i]] -= lower[i] * x[k]
    for k in range(len(x) - 1, -1, -1):
        total = x[k] * diagonal[k]
        for i in range(start[k], start[k + 1]):
            total -= lower[i] * x[rows[i]]
        x[k] = total


@compiled
def solve(m: Machine) -> bool:
    """Find x with A x = b to rounding; False if the matrix is singular or nearly so."""
    entry_row = integers(m, at.ENTRY_ROW)
    entry_column = integers(m, at.ENTRY_COLUMN)
    x = floats(m, at.X)
    b = floats(m, at.B)
    dx = floats(m, at.DX)
    entry_value = floats(m, at.ENTRY_VALUE)
    copy(x, b)
    substitute(m, x)
    last = 0.0
    for i in range(len(x)):
        last = max(last, abs(x[i]))
    for k in range(REFINEMENTS):
        copy(dx, b)
        for e in range(len(entry_row)):
            i, j, value = entry_row[e], entry_column[e], entry_value[e]
            dx[i] -= value * x[j]
            if i != j:
                dx[j] -= value * x[i]
        substitute(m, dx)
        change, size = 0.0, 0.0
        for i in range(len(x)):
            x[i] += dx[i]
            change = max(change, abs(dx[i]))
            size = max(size, abs(x[i]))
        if not math.isfinite(size):
            return False
        # The next change would be to this one as this one is to the last.
        if change <= REFINED * size or change * change <= REFINED * size * last:
            return True
        if k > 0 and change > CONTRACTION * last:
            return False
        last = change
    return False


@compiled
def accelerate(m: Machine, dy: Floats) -> bool:
    """Set the second half of dy to the accelerations at the state of the registers, whose matrix is factored."""
    right_register = integers(m, at.RIGHT_REGISTER)
    place = integers(m, at.PLACE)
    b = floats(m, at.B)
    w = floats(m, at.W)
    right_factor = floats(m, at.RIGHT_FACTOR)
    x = floats(m, at.X)
    scale = floats(m, at.SCALE)
    for i in range(len(b)):
        b[i] = w[right_register[i]] * right_factor[i]
    if not solve(m):
        return False
    n = m.coordinates
    for i in range(n):
        dy[n + i] = x[place[i]] * scale[i]
    return True


@compiled
def power(m: Machine, y: Floats) -> float:
    """Return the power of all that has no potential (W), after `accelerate`."""
    jacobian_row = integers(m, at.JACOBIAN_ROW)
    row_place = integers(m, at.ROW_PLACE)
    jacobian_register = integers(m, at.JACOBIAN_REGISTER)
    jacobian_column = integers(m, at.JACOBIAN_COLUMN)
    w = floats(m, at.W)
    x = floats(m, at.X)
    row_scale = floats(m, at.ROW_SCALE)
    jacobian_sign = floats(m, at.JACOBIAN_SIGN)
    n = m.coordinates
    if m.power_register < 0:
        return 0.0
    total = float(m.power_sign * w[m.power_register])
    if m.driven:
        for e in range(len(jacobian_row)):
            row = jacobian_row[e]
            if row_place[row] >= 0:
                nu = x[row_place[row]] * row_scale[row]
                total -= nu * jacobian_sign[e] * w[jacobian_register[e]] * y[n + jacobian_column[e]]
    return total


@compiled
def slope(m: Machine, t: float, y: Floats, dy: Floats) -> bool:
    """Find the rates of q and u."""
    if not evaluate(m, t, y, 0):
        return False
    factor(m)
    n = m.coordinates
    for i in range(n):
        dy[i] = y[n + i]
    return accelerate(m, dy)


@compiled
def kinetic(m: Machine) -> float:
    """Return the kinetic energy (J) at the state of the registers."""
    mass_row = integers(m, at.MASS_ROW)
    mass_register = integers(m, at.MASS_REGISTER)
    mass_column = integers(m, at.MASS_COLUMN)
    mass_sign = floats(m, at.MASS_SIGN)
    w = floats(m, at.W)
    n, total = m.coordinates, 0.0
    for e in range(len(mass_row)):
        total += mass_sign[e] * w[mass_register[e]] * w[n + mass_row[e]] * w[n + mass_column[e]]
    return 0.5 * total
