"""Newton matrices of implicit methods, made of M, J and the derivatives K, R and V_q of the linearization.

With coefficients of the method, real or complex,

    [[c_M M + c_K K + c_R R, c_C Cᵀ, c_D Dᵀ], [c_C' C + …, 0, 0], [c_D' D + c_V V_q, 0, 0]],

in scaled coordinates and rows, are factored as L U in the order of elimination of the accelerations, and with the same
little numbers on the diagonal. Nothing is refined: iterations take away what these change.
"""

from __future__ import annotations

from typing import Any

from mbstab.compiler.machine import tables as at
from mbstab.compiler.machine.interpreter import evaluate
from mbstab.compiler.machine.native import compiled, copy, fill, floats, integers
from mbstab.compiler.machine.tables import Floats, Machine


@compiled
def freeze(m: Machine) -> None:
    """Keep the parts of Newton matrices at the state of the registers."""
    register = integers(m, at.NEWTON_REGISTER)
    factor = floats(m, at.NEWTON_FACTOR)
    value = floats(m, at.NEWTON_VALUE)
    w = floats(m, at.W)
    for e in range(len(register)):
        value[e] = w[register[e]] * factor[e]


@compiled
def differentiate(m: Machine, t: float, y: Floats, a: Floats, nu: Floats, kink: float, moved: Floats) -> bool:
    """Keep the parts of Newton matrices at a state with these accelerations and multipliers; its residuals are found.

    At a kink in the speeds, those next to it, as `Constrained.derivatives` does: `kink` is how far to move.
    """
    w, n = floats(m, at.W), m.coordinates
    copy(w[m.given : m.given + n], a)
    copy(w[m.given + n : m.given + n + m.rows], nu)
    if evaluate(m, t, y, 2):
        freeze(m)
        return True
    sizes = floats(m, at.SIZES)
    fast = m.slowest
    for i in range(n):
        fast = max(fast, abs(y[n + i]) / sizes[i])
    copy(moved, y)
    for i in range(n):
        moved[n + i] += kink * fast * sizes[i]
    if not evaluate(m, t, moved, 2):
        return False
    freeze(m)
    return evaluate(m, t, y, 1)


@compiled
def decompose(m: Machine, unit: float, c: Any, lu: Any) -> None:
    """Factor the matrix with these coefficients, and with multiples of the unit matrix on coordinates."""
    start = integers(m, at.COLUMN_START)
    row = integers(m, at.LOWER_ROW)
    update_start = integers(m, at.UPDATE_START)
    update_target = integers(m, at.UPDATE_TARGET)
    kind = integers(m, at.NEWTON_KIND)
    target = integers(m, at.NEWTON_TARGET)
    value = floats(m, at.NEWTON_VALUE)
    shift = floats(m, at.SHIFT)
    n = len(shift)
    upper = n + len(row)
    fill(lu, 0.0)
    for k in range(n):
        lu[k] = shift[k] + (unit if shift[k] > 0.0 else 0.0)
    for e in range(len(kind)):
        lu[target[e]] += c[kind[e]] * value[e]
    for k in range(n):
        inverse, update = 1.0 / lu[k], update_start[k]
        lu[k] = inverse
        for i in range(start[k], start[k + 1]):
            left, above = lu[n + i] * inverse, lu[upper + i]
            lu[row[i]] -= left * above
            for j in range(i + 1, start[k + 1]):
                place = update_target[update]
                lu[n + place] -= lu[n + j] * inverse * above
                lu[upper + place] -= left * lu[upper + j]
                update += 1
            lu[n + i] = left


@compiled
def solved(m: Machine, lu: Any, x: Any) -> None:
    """Replace x, by place, by what a factored matrix makes of it."""
    start = integers(m, at.COLUMN_START)
    row = integers(m, at.LOWER_ROW)
    n = len(x)
    upper = n + len(row)
    for k in range(n):
        for i in range(start[k], start[k + 1]):
            x[row[i]] -= lu[n + i] * x[k]
    for k in range(n - 1, -1, -1):
        total = x[k]
        for i in range(start[k], start[k + 1]):
            total -= lu[upper + i] * x[row[i]]
        x[k] = total * lu[k]


@compiled
def times(m: Machine, c: Any, x: Any, y: Any) -> None:
    """Add the product of x and the matrix with these coefficients to y, both by place."""
    kind = integers(m, at.NEWTON_KIND)
    row = integers(m, at.NEWTON_ROW)
    column = integers(m, at.NEWTON_COLUMN)
    value = floats(m, at.NEWTON_VALUE)
    for e in range(len(kind)):
        y[row[e]] += c[kind[e]] * value[e] * x[column[e]]


@compiled
def imbalance(m: Machine, a: Floats, nu: Floats, b: Floats) -> None:
    """Set b to minus M a + F0 + Jᵀ ν, scaled and by place, at the state of the registers; rows are left as they are."""
    place = integers(m, at.PLACE)
    right_register = integers(m, at.RIGHT_REGISTER)
    mass_row = integers(m, at.MASS_ROW)
    mass_column = integers(m, at.MASS_COLUMN)
    mass_register = integers(m, at.MASS_REGISTER)
    jacobian_row = integers(m, at.JACOBIAN_ROW)
    jacobian_column = integers(m, at.JACOBIAN_COLUMN)
    jacobian_register = integers(m, at.JACOBIAN_REGISTER)
    right_factor = floats(m, at.RIGHT_FACTOR)
    mass_sign = floats(m, at.MASS_SIGN)
    jacobian_sign = floats(m, at.JACOBIAN_SIGN)
    scale = floats(m, at.SCALE)
    w = floats(m, at.W)
    for i in range(m.coordinates):
        b[place[i]] = w[right_register[place[i]]] * right_factor[place[i]]
    for e in range(len(mass_row)):
        i = mass_row[e]
        b[place[i]] -= scale[i] * mass_sign[e] * w[mass_register[e]] * a[mass_column[e]]
    for e in range(len(jacobian_row)):
        i = jacobian_column[e]
        b[place[i]] -= scale[i] * jacobian_sign[e] * w[jacobian_register[e]] * nu[jacobian_row[e]]


@compiled
def violation(m: Machine, row: int, velocity: int) -> float:
    """Return minus the scaled residual of a row at the state of the registers, in position or in velocity."""
    k = row + velocity * m.rows
    register = integers(m, at.RESIDUAL_REGISTER)
    sign = floats(m, at.RESIDUAL_SIGN)
    return -float(sign[k] * floats(m, at.W)[register[k]] * floats(m, at.ROW_SCALE)[row])
