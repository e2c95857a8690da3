"""One compiled program that follows the motion of any scene: an interpreter, a sparse factorization and the steps.

Nothing here is written for a scene: its equations come as numbers (`mbstab.compiler.trace.Code`), and the order of
elimination as lists of places. So Numba, the extra ``fast``, compiles this module once, and keeps the result beside
it. Every function works on the arrays of a `Machine`; those of a `Tableau` are the integrator.

The equations [[M, Jᵀ], [J, 0]] [x; ν] = b, in coordinates scaled by the masses they carry, are factored as L D Lᵀ in
an order that never changes, coordinates before the rows in which they occur. Little numbers on the diagonal (±`DELTA`)
make that safe whatever vanishes on the way (Vanderbei 1995, SIAM J. Optim. 5, on quasidefinite matrices), and
iterative refinement with the true matrix takes away what they change.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any, NamedTuple, TypeVar
from zlib import crc32

import numba
import numpy as np
import numpy.typing as npt
from numba.core import event

from mbstab.compiler.trace import OPERATIONS
from mbstab.model.functions import NATIVE, TABLE

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]
F = TypeVar("F", bound=Callable[..., object])

DELTA = 1e-10
"""What is added to the diagonal; the scaled masses are about 1."""

REFINED, CONTRACTION, REFINEMENTS = 1e-13, 0.1, 8
"""A solution is finished when its last change is below this part of it; each is at most that part of the one before."""

SAFETY, LEAST_FACTOR, LARGEST_FACTOR = 0.9, 0.2, 10.0
"""Of a step to the next one, as in SciPy's integrators."""

_nodes, _weights = np.polynomial.legendre.leggauss(4)
NODES, WEIGHTS = tuple((0.5 * (_nodes + 1.0)).tolist()), tuple((0.5 * _weights).tolist())
"""Gauss quadrature of the power over a step; its own weights, at stages of lower order, are ten times worse."""

TIME, FOLLOWING, TAKEN, WORK, PEAK, DRIFT, LEAST = range(7)
"""Places in `March.t`: the time, the next step, the last one (s), work, the largest kinetic energy (J), the largest
residual, the square of the least singular value at the start."""

STEPS, REJECTED, EVALUATIONS, COVERED = range(4)
"""Places in `March.counts`; the last is of times of output that are done."""

DONE, MORE, CHART, LOOK = range(4)
"""Why `march` returns: the end, so many steps, an angle near its singularity, something that it leaves to others."""

TEXTS = {name: f"math.{name}(x{', y' * (TABLE[name].arguments - 1)})" for name in NATIVE if hasattr(math, name)} | {
    "+": "x + y",
    "-": "x - y",
    "*": "x * y",
    "/": "x / y",
    "negative": "-x",
    "power": "math.pow(x, y)",
    "abs": "abs(x)",
    "sign": "0.0 if x == 0.0 else math.copysign(1.0, x)",
    "abs_slope": "math.copysign(1.0, x)",
    "held": "min(max(x, 0.0), 1.0)",
}
"""What each of `OPERATIONS` does to x, or to x and y."""

REFUSED = {"/": "y == 0.0", "abs_slope": "x == 0.0"}
"""Where an operation has no value, besides those that are not finite."""

VERSION = f"{crc32(repr([(name, TEXTS[name], REFUSED.get(name)) for name in OPERATIONS]).encode()):08x}"
"""Of the operations: what Numba has kept of another one is not read."""


class Machine(NamedTuple):
    """A scene as arrays; N = n_q + number of rows kept, places are those in the order of elimination.

    Registers come as a number and a sign. What has no comment is working memory.
    """

    operations: Integers
    first: Integers
    second: Integers
    ends: Integers  # operations for the accelerations, and for the residuals as well
    w: Floats  # registers: q, u, t, constants, results
    base: int  # register of the first result
    entry_register: Integers  # entries of the lower triangle of the matrix
    entry_factor: Floats
    entry_row: Integers
    entry_column: Integers
    entry_target: Integers  # place in `lower`, -1 on the diagonal
    entry_value: Floats
    right_register: Integers  # of b, by place
    right_factor: Floats
    shift: Floats  # of the diagonal, by place
    column_start: Integers  # columns of L
    lower_row: Integers
    lower: Floats
    diagonal: Floats
    update_start: Integers  # first of the targets of each column
    update_target: Integers  # places in `lower`
    b: Floats
    x: Floats
    dx: Floats
    place: Integers  # of the coordinates
    row_place: Integers  # of all rows; -1 where they are left out
    scale: Floats
    row_scale: Floats
    holonomic: int
    jacobian_row: Integers
    jacobian_column: Integers
    jacobian_register: Integers
    jacobian_sign: Floats
    mass_row: Integers
    mass_column: Integers
    mass_register: Integers
    mass_sign: Floats
    residual_register: Integers  # E, then V
    residual_sign: Floats
    power_register: int  # of forces without a potential; -1: nothing does work
    power_sign: float
    driven: int
    sizes: Floats
    slowest: float
    projections: int  # and when they are finished, as in `mbstab.analysis.simulate.constrained`
    projected: float
    accepted: float
    angle: Integers  # coordinates near whose ±pi/2 the chart ends
    least_cosine: Floats
    pinned: Integers
    left: Floats  # of the least singular value, by place of rows
    right: Floats  # by place
    reach: Floats
    best: Floats


class Tableau(NamedTuple):
    """An explicit Runge-Kutta method with s stages, and more for its dense output.

    The dense output is y + h Σ_j g_j(x) Σ_i W_ji K_i at the part x of the step, with g = x, x(1-x), x²(1-x), … if
    `nested`, and x, x², x³, … otherwise.
    """

    A: Floats
    B: Floats
    C: Floats
    E: Floats  # one row, or two: of order 5 and 3, as in DOP853
    W: Floats
    stages: int
    nested: int
    exponent: float


class March(NamedTuple):
    """The state of a march, which `march` changes in place."""

    y: Floats  # q, u
    before: Floats  # at the step before
    k: Floats  # slopes at all stages
    power: Floats  # at all stages
    t: Floats
    counts: Integers
    absolute: Floats  # tolerances
    relative: float
    longest: float
    end: float
    near: float  # part of the square of the least singular value at the start, below which somebody has to look
    times: Floats
    found: Floats  # q, u, work at times of output
    trial: Floats
    inside: Floats
    rates: Floats
    other: Floats


def compiled(function: F) -> F:
    """Return a function in machine code.

    It makes no arrays. Without Numba's counting of references (`_nrt`) calls with as many arrays as here take a third
    of the time.
    """
    function.__qualname__ += f"_{VERSION}"
    result: F = numba.njit(cache=True, error_model="numpy", nogil=True, _nrt=False)(function)
    return result


class _Teller(event.Listener):  # type: ignore[misc]  # Numba has no types
    """Tells once that something is being compiled, and not read from where it is kept."""

    def __init__(self, tell: Callable[[], object]) -> None:
        self._tell: Callable[[], object] | None = tell

    def on_start(self, event: event.Event) -> None:
        """Tell at the first time."""
        if self._tell is not None:
            self._tell()
            self._tell = None

    def on_end(self, event: event.Event) -> None:
        """Do nothing."""


def telling(tell: Callable[[], object]) -> AbstractContextManager[object]:
    """Return a context in which a function is called when Numba begins to compile."""
    context: AbstractContextManager[object] = event.install_listener("numba:compile", _Teller(tell))
    return context


@compiled
def fill(x: Floats, value: float) -> None:
    """Set all of x; for short arrays several times as fast as a slice."""
    for i in range(len(x)):
        x[i] = value


@compiled
def copy(x: Floats, y: Floats) -> None:
    """Set x to y."""
    for i in range(len(x)):
        x[i] = y[i]


def _interpreter() -> Callable[[Machine, int, int], bool]:
    """Return the function that runs operations, each of which it knows by its number."""
    lines = [
        "def interpret(m, start, stop):",
        "    w = m.w",
        "    for i in range(start, stop):",
        "        x, y, operation = w[m.first[i]], w[m.second[i]], m.operations[i]",
    ]
    for number, name in enumerate(OPERATIONS):
        lines.append(f"        {'elif' if number else 'if'} operation == {number}:")
        if name in REFUSED:
            lines += [f"            if {REFUSED[name]}:", "                return False"]
        lines.append(f"            z = {TEXTS[name]}")
    lines += [
        "        else:",
        "            return False",
        "        if not math.isfinite(z):",
        "            return False",
        "        w[m.base + i] = z",
        "    return True",
    ]
    names = {"__name__": __name__, "math": math}
    # As if it stood here: Numba keeps machine code beside the file of a function.
    exec(compile("\n".join(lines), __file__, "exec"), names)
    function: Any = names["interpret"]
    function.__doc__ = "Run a part of the program; False where a number does not exist or is not finite."
    return function  # type: ignore[no-any-return]


interpret = compiled(_interpreter())


@compiled
def evaluate(m: Machine, t: float, y: Floats, group: int) -> bool:
    """Set the registers to those of a state q, u: for the accelerations (group 0), or for everything (1)."""
    copy(m.w[: len(y)], y)
    m.w[len(y)] = t
    return interpret(m, 0, m.ends[group])


# --- linear equations -----------------------------------------------------------------------------------------------


@compiled
def factor(m: Machine) -> None:
    """Factor the matrix at the state of the registers."""
    lower, diagonal, start = m.lower, m.diagonal, m.column_start
    fill(lower, 0.0)
    copy(diagonal, m.shift)
    for e in range(len(m.entry_row)):
        value = m.w[m.entry_register[e]] * m.entry_factor[e]
        m.entry_value[e] = value
        if m.entry_target[e] < 0:
            diagonal[m.entry_row[e]] += value
        else:
            lower[m.entry_target[e]] += value
    for k in range(len(diagonal)):
        pivot, update = diagonal[k], m.update_start[k]
        for i in range(start[k], start[k + 1]):
            part = lower[i] / pivot
            diagonal[m.lower_row[i]] -= part * lower[i]
            for j in range(i + 1, start[k + 1]):
                lower[m.update_target[update]] -= part * lower[j]
                update += 1
        for i in range(start[k], start[k + 1]):
            lower[i] /= pivot


@compiled
def substitute(m: Machine, x: Floats) -> None:
    """Replace x by what the factors make of it."""
    lower, start, rows = m.lower, m.column_start, m.lower_row
    for k in range(len(x)):
        for i in range(start[k], start[k + 1]):
            x[rows[i]] -= lower[i] * x[k]
    for k in range(len(x) - 1, -1, -1):
        total = x[k] / m.diagonal[k]
        for i in range(start[k], start[k + 1]):
            total -= lower[i] * x[rows[i]]
        x[k] = total


@compiled
def solve(m: Machine) -> bool:
    """Find x with A x = b to rounding; False if the matrix is singular or nearly so."""
    copy(m.x, m.b)
    substitute(m, m.x)
    last = math.inf
    for _ in range(REFINEMENTS):
        copy(m.dx, m.b)
        for e in range(len(m.entry_row)):
            i, j, value = m.entry_row[e], m.entry_column[e], m.entry_value[e]
            m.dx[i] -= value * m.x[j]
            if i != j:
                m.dx[j] -= value * m.x[i]
        substitute(m, m.dx)
        change, size = 0.0, 0.0
        for i in range(len(m.x)):
            m.x[i] += m.dx[i]
            change = max(change, abs(m.dx[i]))
            size = max(size, abs(m.x[i]))
        if not math.isfinite(size):
            return False
        if change <= REFINED * size:
            return True
        if change > CONTRACTION * last:
            return False
        last = change
    return False


@compiled
def accelerate(m: Machine, dy: Floats) -> bool:
    """Set the second half of dy to the accelerations at the state of the registers, whose matrix is factored."""
    for i in range(len(m.b)):
        m.b[i] = m.w[m.right_register[i]] * m.right_factor[i]
    if not solve(m):
        return False
    n = len(m.place)
    for i in range(n):
        dy[n + i] = m.x[m.place[i]] * m.scale[i]
    return True


@compiled
def power(m: Machine, y: Floats) -> float:
    """Return the power of all that has no potential (W), after `accelerate`."""
    n = len(m.place)
    if m.power_register < 0:
        return 0.0
    total = float(m.power_sign * m.w[m.power_register])
    if m.driven:
        for e in range(len(m.jacobian_row)):
            row = m.jacobian_row[e]
            if m.row_place[row] >= 0:
                nu = m.x[m.row_place[row]] * m.row_scale[row]
                total -= nu * m.jacobian_sign[e] * m.w[m.jacobian_register[e]] * y[n + m.jacobian_column[e]]
    return total


@compiled
def slope(m: Machine, t: float, y: Floats, dy: Floats) -> bool:
    """Find the rates of q and u."""
    if not evaluate(m, t, y, 0):
        return False
    factor(m)
    n = len(m.place)
    for i in range(n):
        dy[i] = y[n + i]
    return accelerate(m, dy)


# --- constraints ----------------------------------------------------------------------------------------------------


@compiled
def residual(m: Machine, y: Floats) -> tuple[float, float]:
    """Return the largest residuals in position and in velocity, as `Constrained.residuals` does."""
    rows = len(m.row_place)
    fill(m.reach, 1e-300)
    for e in range(len(m.jacobian_row)):
        m.reach[m.jacobian_row[e]] += abs(m.w[m.jacobian_register[e]]) * m.sizes[m.jacobian_column[e]]
    n, fast = len(m.place), m.slowest
    for i in range(n):
        fast = max(fast, abs(y[n + i]) / m.sizes[i])
    position, velocity = 0.0, 0.0
    for i in range(rows):
        if i < m.holonomic:
            position = max(position, abs(m.w[m.residual_register[i]]) / m.reach[i])
        velocity = max(velocity, abs(m.w[m.residual_register[rows + i]]) / (m.reach[i] * fast))
    return position, velocity


@compiled
def correct(m: Machine, y: Floats, speeds: bool) -> bool:
    """Change coordinates, or speeds, by the least that makes their rows vanish, in the metric of M.

    The rows that are not meant are left as they are.
    """
    rows, offset, start = m.holonomic, 0, 0
    if speeds:
        rows, offset, start = len(m.row_place), len(m.place), len(m.row_place)
    factor(m)
    fill(m.b, 0.0)
    for i in range(rows):
        if m.row_place[i] >= 0:
            m.b[m.row_place[i]] = -m.residual_sign[start + i] * m.w[m.residual_register[start + i]] * m.row_scale[i]
    if not solve(m):
        return False
    for i in range(len(m.place)):
        y[offset + i] += m.x[m.place[i]] * m.scale[i]
    return True


@compiled
def settle(m: Machine, t: float, y: Floats, counts: Integers) -> float:
    """Move a state onto the constraints; return the residual that is left, and the registers at that state."""
    least = math.inf
    for _ in range(m.projections):
        counts[EVALUATIONS] += 1
        if not evaluate(m, t, y, 1):
            return math.inf
        position, velocity = residual(m, y)
        size = max(position, velocity)
        if size >= 0.5 * least:  # rounding is reached
            if size > least:
                copy(y, m.best)
                evaluate(m, t, y, 1)
            return min(size, least)
        copy(m.best, y)
        least = size
        if size <= m.projected:
            return size
        if position > m.projected:
            counts[EVALUATIONS] += 1
            if not (correct(m, y, False) and evaluate(m, t, y, 1)):
                return math.inf
        if not correct(m, y, True):
            return math.inf
    return least


@compiled
def watch(m: Machine) -> tuple[bool, float]:
    """Whether the least singular value of the rows changed its sign, and its square; take its vectors along.

    One step of inverse iteration with the factors of the present state, in the metric of M.
    """
    seen = 0.0
    for e in range(len(m.jacobian_row)):
        row = m.row_place[m.jacobian_row[e]]
        if row >= 0:
            column = m.jacobian_column[e]
            entry = m.jacobian_sign[e] * m.w[m.jacobian_register[e]] * m.row_scale[m.jacobian_row[e]]
            seen += m.left[row] * entry * m.scale[column] * m.right[m.place[column]]
    copy(m.b, m.left)
    if not solve(m):
        return True, 0.0
    size = 0.0
    for i in range(len(m.left)):
        if m.shift[i] < 0.0:
            size += m.x[i] * m.x[i]
    size = math.sqrt(size)
    if size == 0.0:
        return False, math.inf
    for i in range(len(m.left)):
        if m.shift[i] < 0.0:
            m.left[i] = -m.x[i] / size
            m.right[i] = 0.0
        else:
            m.right[i] = m.x[i]
    return seen < 0.0, 1.0 / size


# --- steps ----------------------------------------------------------------------------------------------------------


@compiled
def stages(m: Machine, tableau: Tableau, s: March, h: float, start: int, stop: int, y: Floats) -> bool:
    """Find the slopes at stages of a step."""
    for i in range(start, stop):
        fill(y, 0.0)
        for j in range(i):
            if tableau.A[i, j] != 0.0:
                for c in range(len(y)):
                    y[c] += tableau.A[i, j] * s.k[j, c]
        for c in range(len(y)):
            y[c] = s.y[c] + h * y[c]
        s.counts[EVALUATIONS] += 1
        if not slope(m, s.t[TIME] + tableau.C[i] * h, y, s.k[i]):
            return False
        s.power[i] = power(m, y)
    return True


@compiled
def error_of(tableau: Tableau, s: March, h: float, y: Floats) -> float:
    """Return the error of a step relative to the tolerances, as SciPy estimates it."""
    first, second = 0.0, 0.0
    for c in range(len(y)):
        scale = s.absolute[c] + s.relative * max(abs(s.y[c]), abs(y[c]))
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
def attempt(m: Machine, tableau: Tableau, s: March, h: float, y: Floats) -> float:
    """Make a step to y; return its error relative to the tolerances."""
    last = tableau.stages
    if not stages(m, tableau, s, h, 1, last, y):
        return math.nan
    fill(y, 0.0)
    for i in range(last):
        if tableau.B[i] != 0.0:
            for c in range(len(y)):
                y[c] += tableau.B[i] * s.k[i, c]
    for c in range(len(y)):
        y[c] = s.y[c] + h * y[c]
    s.counts[EVALUATIONS] += 1
    if not slope(m, s.t[TIME] + h, y, s.k[last]):
        return math.nan
    s.power[last] = power(m, y)
    return error_of(tableau, s, h, y)


@compiled
def interpolate(tableau: Tableau, s: March, h: float, x: float, y: Floats) -> float:
    """Set y to the state at a part of the step, and return the work until there."""
    n_k = tableau.W.shape[1]
    copy(y, s.y)
    work, g = 0.0, x
    for j in range(len(tableau.W)):
        for i in range(n_k):
            weight = float(h * g * tableau.W[j, i])
            if weight != 0.0:
                for c in range(len(y)):
                    y[c] += weight * s.k[i, c]
                work += weight * s.power[i]
        g *= (1.0 - x if j % 2 == 0 else x) if tableau.nested else x
    return work


@compiled
def chart_ends(m: Machine, before: Floats, y: Floats) -> bool:
    """Whether an angle has come to where Euler angles are replaced, or, of a body that keeps its own, are singular."""
    for i in range(len(m.angle)):
        cosine = math.cos(y[m.angle[i]])
        if abs(cosine) < m.least_cosine[i]:
            return True
        if m.pinned[i] and cosine * math.cos(before[m.angle[i]]) < 0.0:
            return True
    return False


@compiled
def kinetic(m: Machine) -> float:
    """Return the kinetic energy (J) at the state of the registers."""
    n, total = len(m.place), 0.0
    for e in range(len(m.mass_row)):
        total += m.mass_sign[e] * m.w[m.mass_register[e]] * m.w[n + m.mass_row[e]] * m.w[n + m.mass_column[e]]
    return 0.5 * total


@compiled
def begin(m: Machine, s: March) -> bool:
    """Start at the state of a march; False if nothing can be done there."""
    if not slope(m, s.t[TIME], s.y, s.k[0]):
        return False
    s.power[0] = power(m, s.y)
    if len(m.row_place) == 0:
        return True
    for _ in range(3):
        watch(m)
    _, value = watch(m)
    if s.t[LEAST] == 0.0:
        s.t[LEAST] = value
    return not value <= s.near * s.t[LEAST]


@compiled
def march(m: Machine, tableau: Tableau, s: March, most: int) -> int:
    """Take steps; return why it ended. A step that somebody has to look at is not taken."""
    n, dense = len(m.place), tableau.stages + 1
    y, z, dy = s.trial, s.inside, s.rates
    for _ in range(most):
        t = s.t[TIME]
        least = 10.0 * (np.nextafter(t, np.inf) - t)
        h = min(max(s.t[FOLLOWING], least), s.longest)
        rejected = False
        while True:
            if h < least:
                return LOOK
            following = min(t + h, s.end)
            h = following - t
            error = attempt(m, tableau, s, h, y)
            if error < 1.0:
                break
            ratio = SAFETY * error**tableau.exponent
            h *= ratio if ratio > LEAST_FACTOR else LEAST_FACTOR  # also where there is none
            rejected = True
            s.counts[REJECTED] += 1
        ratio = min(LARGEST_FACTOR, SAFETY * error**tableau.exponent) if error > 0.0 else LARGEST_FACTOR
        if rejected:
            ratio = min(1.0, ratio)
        if not settle(m, following, y, s.counts) <= m.accepted:
            return LOOK
        left_over = max(*residual(m, y))
        factor(m)
        if not accelerate(m, dy):
            return LOOK
        rate = power(m, y)
        if len(m.row_place) > 0:
            flipped, value = watch(m)
            if flipped or value <= s.near * s.t[LEAST]:
                return LOOK
        s.t[PEAK] = max(s.t[PEAK], kinetic(m))
        s.t[DRIFT] = max(s.t[DRIFT], left_over)
        done, extended, work, missed = s.counts[COVERED], False, 0.0, 0.0
        if m.power_register >= 0:
            if not stages(m, tableau, s, h, dense, len(tableau.C), z):
                return LOOK
            extended = True
            for i in range(len(NODES)):
                interpolate(tableau, s, h, NODES[i], z)
                s.counts[EVALUATIONS] += 1
                if not slope(m, t + h * NODES[i], z, s.other):
                    return LOOK
                work += h * WEIGHTS[i] * power(m, z)
            missed = work - interpolate(tableau, s, h, 1.0, z)
        while done < len(s.times) and s.times[done] <= following:
            if s.times[done] == following:
                copy(s.found[done, : 2 * n], y)
                s.found[done, 2 * n] = s.t[WORK] + work
            else:
                if not extended and not stages(m, tableau, s, h, dense, len(tableau.C), z):
                    return LOOK
                extended = True
                part = (s.times[done] - t) / h
                s.found[done, 2 * n] = s.t[WORK] + interpolate(tableau, s, h, part, z) + part * missed
                if not settle(m, s.times[done], z, s.counts) <= m.accepted:
                    return LOOK
                copy(s.found[done, : 2 * n], z)
            done += 1
        s.counts[COVERED] = done
        s.t[WORK] += work
        s.counts[STEPS] += 1
        copy(s.before, s.y)
        copy(s.y, y)
        for i in range(n):
            s.k[0, i], s.k[0, n + i] = y[n + i], dy[n + i]
        s.power[0] = rate
        s.t[TIME], s.t[FOLLOWING], s.t[TAKEN] = following, h * ratio, h
        if chart_ends(m, s.before, s.y):
            return CHART
        if following >= s.end:
            return DONE
    return MORE
