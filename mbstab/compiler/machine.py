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
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from typing import Any, NamedTuple, TypeVar
from zlib import crc32

import numba
import numpy as np
import numpy.typing as npt
from numba.core import event, types
from numba.extending import intrinsic
from numba.np.arrayobj import populate_array

from mbstab.compiler.trace import OPERATIONS
from mbstab.model.functions import NATIVE, TABLE

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]
F = TypeVar("F", bound=Callable[..., object])

DELTA = 1e-10
"""What is added to the diagonal; the scaled masses are about 1."""

REFINED, CONTRACTION, REFINEMENTS = 1e-13, 0.1, 8
"""A solution is finished when its next change will be below this part of it; each is at most that part of the last."""

SAFETY, LEAST_FACTOR, LARGEST_FACTOR = 0.9, 0.2, 10.0
"""Of a step to the next one, as in SciPy's integrators."""

_nodes, _weights = np.polynomial.legendre.leggauss(4)
NODES, WEIGHTS = tuple((0.5 * (_nodes + 1.0)).tolist()), tuple((0.5 * _weights).tolist())
"""Gauss quadrature of the power over a step; its own weights, at stages of lower order, are ten times worse."""

TIME, FOLLOWING, TAKEN, WORK, PEAK, DRIFT, LEAST = range(7)
"""Places in `March.t`: the time, the next step (0: to be chosen), the last one (s), work, the largest kinetic energy
(J), the largest residual, the square of the least singular value at the start."""

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
    "signum": "0.0 if x == 0.0 else math.copysign(1.0, x)",
    "abs_slope": "math.copysign(1.0, x)",
    "held": "min(max(x, 0.0), 1.0)",
    "inside": "0.0 if 0.0 <= x <= 1.0 else math.nan",
}
"""What each of `OPERATIONS` does to x, or to x and y."""

FREQUENT = ("*", "+", "-", "/", "negative", "sin", "cos", "sqrt")
"""Operations with a loop of their own."""

REFUSED = {"/": "y == 0.0", "abs_slope": "x == 0.0"}
"""Where an operation has no value, besides those that are not finite."""

VERSION = f"{crc32(repr([(name, TEXTS[name], REFUSED.get(name)) for name in OPERATIONS]).encode()):08x}"
"""Of the operations: what Numba has kept of another one is not read."""


INTEGERS = (
    "run_operation",  # of each run of equal operations
    "run_start",  # its first operation; of one more than there are runs
    "first",  # register of each operand
    "second",
    "ends",  # runs for the accelerations, and for the residuals as well
    "entry_register",  # entries of the lower triangle of the matrix
    "entry_row",
    "entry_column",
    "entry_target",  # place in `lower`, -1 on the diagonal
    "right_register",  # of b, by place
    "column_start",  # columns of L
    "lower_row",
    "update_start",  # first of the targets of each column
    "update_target",  # places in `lower`
    "place",  # of the coordinates
    "row_place",  # of all rows; -1 where they are left out
    "jacobian_row",
    "jacobian_column",
    "jacobian_register",
    "mass_row",
    "mass_column",
    "mass_register",
    "residual_register",  # E, then V
    "angle",  # coordinates near whose ±pi/2 the chart ends
    "pinned",
)
"""Tables of integers of a machine; places are those in the order of elimination, registers come with a sign."""

FLOATS = (
    "w",  # registers: q, u, t, constants, results
    "entry_factor",
    "entry_value",
    "right_factor",
    "shift",  # of the diagonal, by place
    "lower",
    "diagonal",  # inverse of D
    "b",
    "x",
    "dx",
    "scale",  # of coordinates and rows
    "row_scale",
    "jacobian_sign",
    "mass_sign",
    "residual_sign",
    "sizes",
    "least_cosine",
    "left",  # of the least singular value, by place of rows
    "right",  # by place
    "reach",
    "best",
)
"""Tables of floats. What has no comment is working memory, or belongs to the table of integers of that name."""

(
    RUN_OPERATION,
    RUN_START,
    FIRST,
    SECOND,
    ENDS,
    ENTRY_REGISTER,
    ENTRY_ROW,
    ENTRY_COLUMN,
    ENTRY_TARGET,
    RIGHT_REGISTER,
    COLUMN_START,
    LOWER_ROW,
    UPDATE_START,
    UPDATE_TARGET,
    PLACE,
    ROW_PLACE,
    JACOBIAN_ROW,
    JACOBIAN_COLUMN,
    JACOBIAN_REGISTER,
    MASS_ROW,
    MASS_COLUMN,
    MASS_REGISTER,
    RESIDUAL_REGISTER,
    ANGLE,
    PINNED,
) = range(len(INTEGERS))
(
    W,
    ENTRY_FACTOR,
    ENTRY_VALUE,
    RIGHT_FACTOR,
    SHIFT,
    LOWER,
    DIAGONAL,
    B,
    X,
    DX,
    SCALE,
    ROW_SCALE,
    JACOBIAN_SIGN,
    MASS_SIGN,
    RESIDUAL_SIGN,
    SIZES,
    LEAST_COSINE,
    LEFT,
    RIGHT,
    REACH,
    BEST,
) = range(len(FLOATS))


ALL_INTEGERS = len(INTEGERS) + 1
"""Where the places of the tables of floats begin."""


class Machine(NamedTuple):
    """A scene as arrays; N = n_q + number of rows kept.

    All tables stand in two arrays, as a call takes time for each array. The first integers say where tables begin and
    end: those of integers, then those of floats.
    """

    integers: Integers
    floats: Floats
    coordinates: int
    rows: int
    holonomic: int
    base: int  # register of the first result
    power_register: int  # of forces without a potential; -1: nothing does work
    power_sign: float
    driven: int
    slowest: float
    projections: int  # and when they are finished, as in `mbstab.analysis.simulate.constrained`
    projected: float
    accepted: float


def machine(tables: Mapping[str, npt.ArrayLike], **numbers: float) -> Machine:
    """Return the machine that has these tables and numbers."""
    integers = [np.asarray(tables[name], dtype=np.int64).ravel() for name in INTEGERS]
    floats = [np.asarray(tables[name], dtype=np.float64).ravel() for name in FLOATS]
    head = len(INTEGERS) + len(FLOATS) + 2
    starts = [*np.cumsum([head, *map(len, integers)]), *np.cumsum([0, *map(len, floats)])]
    return Machine(np.concatenate([np.array(starts), *integers]), np.concatenate(floats), **numbers)  # type: ignore[arg-type]


def table(m: Machine, name: str) -> Floats:
    """Return a table of floats, which may be changed."""
    start, stop = m.integers[ALL_INTEGERS + FLOATS.index(name) :][:2]
    return m.floats[start:stop]


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
    first: int  # first stage whose slope is not known at the start of a step
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


MADE: set[Callable[..., object]] = set()
"""Functions of this module that Numba compiles by themselves."""


def compiled(function: F) -> F:
    """Return a function in machine code, for others in machine code: what calls them takes their code along.

    It makes no arrays. Without Numba's counting of references (`_nrt`) calls with as many arrays as here take a third
    of the time. Python must not call it.
    """
    MADE.add(function)
    options = {"error_model": "numpy", "nogil": True, "_nrt": False}
    result: F = numba.njit(no_cpython_wrapper=True, no_cfunc_wrapper=True, **options)(function)
    return result


def called(function: F) -> F:
    """Return a function in machine code that Python calls; Numba keeps it beside the file in which it stands."""
    MADE.add(function)
    function.__qualname__ += f"_{VERSION}"
    result: F = numba.njit(cache=True, no_cfunc_wrapper=True, error_model="numpy", nogil=True, _nrt=False)(function)
    return result


class _Teller(event.Listener):  # type: ignore[misc]  # Numba has no types
    """Tells how many of the functions of this module are compiled, if they are not read from where they are kept."""

    def __init__(self, tell: Callable[[float], object]) -> None:
        self._tell, self._left = tell, {*MADE}
        self._all, self._begun = len(MADE), False

    def on_start(self, event: event.Event) -> None:
        """Tell at the first time."""
        if not self._begun and event.data["dispatcher"].py_func in self._left:
            self._begun = True
            self._tell(0.0)

    def on_end(self, event: event.Event) -> None:
        """Tell what part is done."""
        if self._begun and (function := event.data["dispatcher"].py_func) in self._left:
            self._left.remove(function)
            self._tell(1.0 - len(self._left) / self._all)


def telling(tell: Callable[[float], object]) -> AbstractContextManager[object]:
    """Return a context in which a function is called with the part that is compiled, if that has to be done."""
    context: AbstractContextManager[object] = event.install_listener("numba:compile", _Teller(tell))
    return context


def _view(kind: Any, place: int, first: int) -> Callable[..., Any]:
    """Return a function that is given a machine and the number of a table, and returns the table as it stands there.

    Nothing is called or counted, which is why arrays may be returned. A slice means the same, but Numba takes ten
    times as long to compile it.

    Parameters
    ----------
    kind : type of Numba
        Of the numbers.
    place : int
        Of the array in a machine.
    first : int
        Where the places of these tables begin.
    """
    array = types.Array(kind, 1, "C")

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        m, name = arguments
        make = context.make_array
        places = make(types.Array(types.int64, 1, "C"))(context, builder, builder.extract_value(m, 0)).data
        whole = make(array)(context, builder, builder.extract_value(m, place))
        at = builder.add(name, name.type(first))
        start, stop = (builder.load(builder.gep(places, [builder.add(at, name.type(k))])) for k in range(2))
        view = make(array)(context, builder)
        data, shape, strides = builder.gep(whole.data, [start]), [builder.sub(stop, start)], [whole.itemsize]
        populate_array(view, data, shape, strides, whole.itemsize, meminfo=None)
        return view._getvalue()

    return lambda context, m, name: (array(m, types.int64), code)


integers = intrinsic(_view(types.int64, 0, 0))
"""Returns a table of integers of a machine."""

floats = intrinsic(_view(types.float64, 1, ALL_INTEGERS))
"""Returns a table of floats of a machine."""


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

    def body(name: str, indent: str) -> list[str]:
        lines = [f"if {REFUSED[name]}:", "    return False"] if name in REFUSED else []
        return [indent + line for line in (*lines, f"z = {TEXTS[name]}")]

    loop = ["            for i in range(begin[r], begin[r + 1]):"]
    loop += ["                x, y = w[first[i]], w[second[i]]"]
    result = ["                if not math.isfinite(z):", "                    return False"]
    result += ["                w[base + i] = z"]
    lines = ["def interpret(m, start, stop):", "    w, base = floats(m, W), m.base"]
    lines += ["    operations, begin = integers(m, RUN_OPERATION), integers(m, RUN_START)"]
    lines += ["    first, second = integers(m, FIRST), integers(m, SECOND)"]
    lines += ["    for r in range(start, stop):", "        operation = operations[r]"]
    for k, name in enumerate(FREQUENT):
        lines += [f"        {'elif' if k else 'if'} operation == {OPERATIONS.index(name)}:", *loop]
        lines += [*body(name, " " * 16), *result]
    lines += ["        else:", *loop]
    for k, name in enumerate(x for x in OPERATIONS if x not in FREQUENT):
        lines += [f"                {'elif' if k else 'if'} operation == {OPERATIONS.index(name)}:"]
        lines += body(name, " " * 20)
    lines += ["                else:", "                    return False", *result, "    return True"]
    names = {"__name__": __name__, "math": math, "floats": floats, "integers": integers, "W": W, "FIRST": FIRST}
    names |= {"SECOND": SECOND, "RUN_OPERATION": RUN_OPERATION, "RUN_START": RUN_START}
    # As if it stood here: Numba keeps machine code beside the file of a function.
    exec(compile("\n".join(lines), __file__, "exec"), names)
    function: Any = names["interpret"]
    function.__doc__ = "Do runs of operations; False where a number does not exist or is not finite."
    return function  # type: ignore[no-any-return]


interpret = compiled(_interpreter())


@compiled
def evaluate(m: Machine, t: float, y: Floats, group: int) -> bool:
    """Set the registers to those of a state q, u: for the accelerations (group 0), or for everything (1)."""
    ends = integers(m, ENDS)
    w = floats(m, W)
    copy(w[: len(y)], y)
    w[len(y)] = t
    return interpret(m, 0, ends[group])


# --- linear equations -----------------------------------------------------------------------------------------------


@compiled
def factor(m: Machine) -> None:
    """Factor the matrix at the state of the registers."""
    start = integers(m, COLUMN_START)
    entry_row = integers(m, ENTRY_ROW)
    entry_register = integers(m, ENTRY_REGISTER)
    entry_target = integers(m, ENTRY_TARGET)
    update_start = integers(m, UPDATE_START)
    row = integers(m, LOWER_ROW)
    update_target = integers(m, UPDATE_TARGET)
    lower = floats(m, LOWER)
    diagonal = floats(m, DIAGONAL)
    shift = floats(m, SHIFT)
    w = floats(m, W)
    entry_factor = floats(m, ENTRY_FACTOR)
    entry_value = floats(m, ENTRY_VALUE)
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
    start = integers(m, COLUMN_START)
    rows = integers(m, LOWER_ROW)
    lower = floats(m, LOWER)
    diagonal = floats(m, DIAGONAL)
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
    entry_row = integers(m, ENTRY_ROW)
    entry_column = integers(m, ENTRY_COLUMN)
    x = floats(m, X)
    b = floats(m, B)
    dx = floats(m, DX)
    entry_value = floats(m, ENTRY_VALUE)
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
    right_register = integers(m, RIGHT_REGISTER)
    place = integers(m, PLACE)
    b = floats(m, B)
    w = floats(m, W)
    right_factor = floats(m, RIGHT_FACTOR)
    x = floats(m, X)
    scale = floats(m, SCALE)
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
    jacobian_row = integers(m, JACOBIAN_ROW)
    row_place = integers(m, ROW_PLACE)
    jacobian_register = integers(m, JACOBIAN_REGISTER)
    jacobian_column = integers(m, JACOBIAN_COLUMN)
    w = floats(m, W)
    x = floats(m, X)
    row_scale = floats(m, ROW_SCALE)
    jacobian_sign = floats(m, JACOBIAN_SIGN)
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


# --- constraints ----------------------------------------------------------------------------------------------------


@compiled
def residual(m: Machine, y: Floats) -> tuple[float, float]:
    """Return the largest residuals in position and in velocity, as `Constrained.residuals` does."""
    jacobian_row = integers(m, JACOBIAN_ROW)
    jacobian_register = integers(m, JACOBIAN_REGISTER)
    jacobian_column = integers(m, JACOBIAN_COLUMN)
    residual_register = integers(m, RESIDUAL_REGISTER)
    reach = floats(m, REACH)
    w = floats(m, W)
    sizes = floats(m, SIZES)
    rows = m.rows
    fill(reach, 1e-300)
    for e in range(len(jacobian_row)):
        reach[jacobian_row[e]] += abs(w[jacobian_register[e]]) * sizes[jacobian_column[e]]
    n, fast = m.coordinates, m.slowest
    for i in range(n):
        fast = max(fast, abs(y[n + i]) / sizes[i])
    position, velocity = 0.0, 0.0
    for i in range(rows):
        if i < m.holonomic:
            position = max(position, abs(w[residual_register[i]]) / reach[i])
        velocity = max(velocity, abs(w[residual_register[rows + i]]) / (reach[i] * fast))
    return position, velocity


@compiled
def correct(m: Machine, y: Floats, speeds: int) -> bool:
    """Change coordinates, or speeds, by the least that makes their rows vanish, in the metric of M.

    The rows that are not meant are left as they are.
    """
    row_place = integers(m, ROW_PLACE)
    place = integers(m, PLACE)
    residual_register = integers(m, RESIDUAL_REGISTER)
    b = floats(m, B)
    residual_sign = floats(m, RESIDUAL_SIGN)
    w = floats(m, W)
    row_scale = floats(m, ROW_SCALE)
    x = floats(m, X)
    scale = floats(m, SCALE)
    rows, offset, start = m.holonomic, 0, 0
    if speeds:
        rows, offset, start = m.rows, m.coordinates, m.rows
    factor(m)
    fill(b, 0.0)
    for i in range(rows):
        if row_place[i] >= 0:
            b[row_place[i]] = -residual_sign[start + i] * w[residual_register[start + i]] * row_scale[i]
    if not solve(m):
        return False
    for i in range(m.coordinates):
        y[offset + i] += x[place[i]] * scale[i]
    return True


@compiled
def settle(m: Machine, t: float, y: Floats, counts: Integers) -> float:
    """Move a state onto the constraints; return the residual that is left, and the registers at that state."""
    best = floats(m, BEST)
    least = math.inf
    for _ in range(m.projections):
        counts[EVALUATIONS] += 1
        if not evaluate(m, t, y, 1):
            return math.inf
        position, velocity = residual(m, y)
        size = max(position, velocity)
        if size >= 0.5 * least:  # rounding is reached
            if size > least:
                copy(y, best)
                evaluate(m, t, y, 1)
            return min(size, least)
        copy(best, y)
        least = size
        if size <= m.projected:
            return size
        for speeds in range(0 if position > m.projected else 1, 2):
            if not correct(m, y, speeds):
                return math.inf
            if speeds == 0:
                counts[EVALUATIONS] += 1
                if not evaluate(m, t, y, 1):
                    return math.inf
    return least


@compiled
def watch(m: Machine) -> tuple[bool, float]:
    """Whether the least singular value of the rows changed its sign, and its square; take its vectors along.

    One step of inverse iteration with the factors of the present state, in the metric of M.
    """
    jacobian_row = integers(m, JACOBIAN_ROW)
    row_place = integers(m, ROW_PLACE)
    jacobian_column = integers(m, JACOBIAN_COLUMN)
    jacobian_register = integers(m, JACOBIAN_REGISTER)
    place = integers(m, PLACE)
    jacobian_sign = floats(m, JACOBIAN_SIGN)
    w = floats(m, W)
    row_scale = floats(m, ROW_SCALE)
    left = floats(m, LEFT)
    scale = floats(m, SCALE)
    right = floats(m, RIGHT)
    b = floats(m, B)
    shift = floats(m, SHIFT)
    x = floats(m, X)
    seen = 0.0
    for e in range(len(jacobian_row)):
        row = row_place[jacobian_row[e]]
        if row >= 0:
            column = jacobian_column[e]
            entry = jacobian_sign[e] * w[jacobian_register[e]] * row_scale[jacobian_row[e]]
            seen += left[row] * entry * scale[column] * right[place[column]]
    copy(b, left)
    if not solve(m):
        return True, 0.0
    size = 0.0
    for i in range(len(left)):
        if shift[i] < 0.0:
            size += x[i] * x[i]
    size = math.sqrt(size)
    if size == 0.0:
        return False, math.inf
    for i in range(len(left)):
        if shift[i] < 0.0:
            left[i] = -x[i] / size
            right[i] = 0.0
        else:
            right[i] = x[i]
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
    if not stages(m, tableau, s, h, tableau.first, last, y):
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
    angle = integers(m, ANGLE)
    pinned = integers(m, PINNED)
    least_cosine = floats(m, LEAST_COSINE)
    for i in range(len(angle)):
        cosine = math.cos(y[angle[i]])
        if abs(cosine) < least_cosine[i]:
            return True
        if pinned[i] and cosine * math.cos(before[angle[i]]) < 0.0:
            return True
    return False


@compiled
def kinetic(m: Machine) -> float:
    """Return the kinetic energy (J) at the state of the registers."""
    mass_row = integers(m, MASS_ROW)
    mass_register = integers(m, MASS_REGISTER)
    mass_column = integers(m, MASS_COLUMN)
    mass_sign = floats(m, MASS_SIGN)
    w = floats(m, W)
    n, total = m.coordinates, 0.0
    for e in range(len(mass_row)):
        total += mass_sign[e] * w[mass_register[e]] * w[n + mass_row[e]] * w[n + mass_column[e]]
    return 0.5 * total


@compiled
def first_step(m: Machine, tableau: Tableau, s: March) -> float:
    """Return the step to begin with, as SciPy chooses it (Hairer, Norsett and Wanner 1993, section II.4)."""
    n, most = len(s.y), min(s.longest, s.end - s.t[TIME])
    place, rate = 0.0, 0.0
    for c in range(n):
        scale = s.absolute[c] + s.relative * abs(s.y[c])
        place += (s.y[c] / scale) ** 2
        rate += (s.k[0, c] / scale) ** 2
    place, rate = math.sqrt(place / n), math.sqrt(rate / n)
    h = min(1e-6 if place < 1e-5 or rate < 1e-5 else 0.01 * place / rate, most)
    for c in range(n):
        s.inside[c] = s.y[c] + h * s.k[0, c]
    s.counts[EVALUATIONS] += 1
    if not slope(m, s.t[TIME] + h, s.inside, s.rates):
        return float(h)
    bend = 0.0
    for c in range(n):
        bend += ((s.rates[c] - s.k[0, c]) / (s.absolute[c] + s.relative * abs(s.y[c]))) ** 2
    bend = math.sqrt(bend / n) / h
    longer = max(1e-6, h * 1e-3)
    if rate > 1e-15 or bend > 1e-15:
        longer = (0.01 / max(rate, bend)) ** -tableau.exponent
    return float(min(100.0 * h, longer, most))


@compiled
def begin(m: Machine, tableau: Tableau, s: March) -> bool:
    """Start at the state of a march; False if nothing can be done there."""
    s.counts[EVALUATIONS] += 1
    if not slope(m, s.t[TIME], s.y, s.k[0]):
        return False
    s.power[0] = power(m, s.y)
    if s.t[FOLLOWING] == 0.0:
        s.t[FOLLOWING] = first_step(m, tableau, s)
        if not slope(m, s.t[TIME], s.y, s.k[0]):
            return False
    if m.rows == 0:
        return True
    for _ in range(3):
        watch(m)
    _, value = watch(m)
    if s.t[LEAST] == 0.0:
        s.t[LEAST] = value
    return not value <= s.near * s.t[LEAST]


@called
def march(m: Machine, tableau: Tableau, s: March, most: int, fresh: bool) -> int:
    """Take steps, at first those of a `fresh` start; return why it ended.

    A step that somebody has to look at is not taken.
    """
    if fresh and not begin(m, tableau, s):
        return LOOK
    n = m.coordinates
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
        if m.rows > 0:
            flipped, value = watch(m)
            if flipped or value <= s.near * s.t[LEAST]:
                return LOOK
        s.t[PEAK] = max(s.t[PEAK], kinetic(m))
        s.t[DRIFT] = max(s.t[DRIFT], left_over)
        done, extended, work, missed = s.counts[COVERED], False, 0.0, 0.0
        if m.power_register >= 0:
            if not stages(m, tableau, s, h, tableau.stages + 1, len(tableau.C), z):
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
                if not extended and not stages(m, tableau, s, h, tableau.stages + 1, len(tableau.C), z):
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
