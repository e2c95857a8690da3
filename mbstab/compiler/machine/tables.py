"""A scene as arrays: tables of integers and of floats, each with a number: where the machine says where it begins."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

DELTA = 1e-10
"""What is added to the diagonal; the scaled masses are about 1."""

MASS, STIFFNESS, DAMPING, HOLONOMIC, HOLONOMIC_FORCE, NONHOLONOMIC, NONHOLONOMIC_FORCE = range(7)
HOLONOMIC_RATE, NONHOLONOMIC_RATE, KINDS = range(7, 10)
"""Kinds of parts: M, K, R, C, Cᵀ, D, Dᵀ, and V_q of holonomic and of nonholonomic rows; how many there are."""

(
    RUN_OPERATION,  # of each run of equal operations
    RUN_START,  # its first operation; of one more than there are runs
    FIRST,  # register of each operand
    SECOND,
    ENDS,  # runs for the accelerations, for the residuals as well, and for derivatives as well
    ENTRY_REGISTER,  # entries of the lower triangle of the matrix
    ENTRY_ROW,
    ENTRY_COLUMN,
    ENTRY_TARGET,  # place in `lower`, -1 on the diagonal
    RIGHT_REGISTER,  # of b, by place
    COLUMN_START,  # columns of L
    LOWER_ROW,
    UPDATE_START,  # first of the targets of each column
    UPDATE_TARGET,  # places in `lower`
    PLACE,  # of the coordinates
    ROW_PLACE,  # of all rows; -1 where they are left out
    JACOBIAN_ROW,
    JACOBIAN_COLUMN,
    JACOBIAN_REGISTER,
    MASS_ROW,
    MASS_COLUMN,
    MASS_REGISTER,
    RESIDUAL_REGISTER,  # E, then V
    NEWTON_KIND,  # of the parts of a Newton matrix, such as `MASS`
    NEWTON_REGISTER,
    NEWTON_ROW,  # places
    NEWTON_COLUMN,
    NEWTON_TARGET,  # place in a factored matrix: the diagonal, columns below it, rows beside it
    ANGLE,  # coordinates near whose ±pi/2 the chart ends
    PINNED,
    INTEGERS,
) = range(31)
"""Tables of integers of a machine, and how many they are; places are those in the order of elimination, registers come
with a sign."""

(
    W,  # registers: q, u, t, base rotations, a and ν of derivatives, constants, results
    ENTRY_FACTOR,
    ENTRY_VALUE,
    RIGHT_FACTOR,
    SHIFT,  # of the diagonal, by place
    LOWER,
    DIAGONAL,  # inverse of D
    B,
    X,
    DX,
    SCALE,  # of coordinates and rows
    ROW_SCALE,
    JACOBIAN_SIGN,
    MASS_SIGN,
    RESIDUAL_SIGN,
    NEWTON_FACTOR,
    NEWTON_VALUE,
    SIZES,
    LEAST_COSINE,
    LEFT,  # of the least singular value, by place of rows
    RIGHT,  # by place
    REACH,
    BEST,
    Y,  # q and u at the start of a step
    BEFORE,  # at the start of the step before
    TRIAL,  # at its end
    INSIDE,
    RATES,
    OTHER,
    A,  # of implicit methods: accelerations at the start of a step
    NU,
    NEXT_A,  # at its end
    NEXT_NU,
    KNOWN,  # of q and u at its end
    JERK,
    DRIFT,
    PAST,
    AHEAD,
    CHANGE,
    NEWTON_C,  # coefficients of kinds
    NEWTON_B,  # by place
    NEWTON_LU,
    STAGE_Y,  # of Radau IIA, for each stage: q and u
    STAGE_A,
    STAGE_NU,
    STAGE_PULL,  # h G η
    STAGE_B,  # what is left of the equations, by place
    STAGE_E,  # of rows in position
    STEP_A,  # the last changes
    STEP_PULL,
    LAST_A,  # of the step before
    LAST_NU,
    GRAM,  # the factors of C Cᵀ
    REAL_E,  # parts of the real eigenvalue, by place
    REAL_G,
    COMPLEX_C,  # of the complex one: twice as many floats
    COMPLEX_B,
    COMPLEX_E,
    COMPLEX_G,
    COMPLEX_LU,
    FLOATS,
) = range(INTEGERS + 1, 92)
"""Tables of floats, and the number after them. What has no comment is working memory, or belongs to the table of
integers of that name."""


TIME, FOLLOWING, TAKEN, WORK, PEAK, RESIDUAL, LEAST, EXTENDED, LENGTH, PLACES = range(10)
"""Places in `March.t`: the time, the next step (0: to be chosen), the last one (s), work, the largest kinetic energy
(J), the largest residual, the square of the least singular value at the start, whether an explicit method has found
the stages of its dense output, the step before of an implicit one (s; 0: none); how many they are."""

STEPS, REJECTED, EVALUATIONS, COVERED = range(4)
"""Places in `March.counts`; the last is of times of output that are done."""

DONE, MORE, CHART, LOOK = range(4)
"""Why `march` returns: the end, so many steps, an angle near its singularity, something that it leaves to others."""


class Machine(NamedTuple):
    """A scene as arrays; N = n_q + number of rows kept.

    All tables stand in two arrays, as a call takes time for each array. The first integers say where tables begin: at
    the number of each, and behind the last of either kind where it ends.
    """

    integers: Integers
    floats: Floats
    coordinates: int
    rows: int
    holonomic: int
    base: int  # register of the first result
    given: int  # register of the first acceleration
    power_register: int  # of forces without a potential; -1: nothing does work
    power_sign: float
    driven: int
    slowest: float
    projections: int  # and when they are finished, as in `mbstab.analysis.simulate.constrained`
    projected: float
    accepted: float


def machine(tables: Mapping[int, npt.ArrayLike], **numbers: float) -> Machine:
    """Return the machine that has these tables and numbers."""
    integers = [np.asarray(tables[k], dtype=np.int64).ravel() for k in range(INTEGERS)]
    floats = [np.asarray(tables[k], dtype=np.float64).ravel() for k in range(INTEGERS + 1, FLOATS)]
    starts = [*np.cumsum([FLOATS + 1, *map(len, integers)]), *np.cumsum([0, *map(len, floats)])]
    return Machine(np.concatenate([np.array(starts), *integers]), np.concatenate(floats), **numbers)  # type: ignore[arg-type]


def table(m: Machine, number: int) -> Floats:
    """Return a table of floats, which may be changed."""
    start, stop = m.integers[number : number + 2]
    return m.floats[start:stop]


class March(NamedTuple):
    """The state of a march, which `march` changes in place; more of it stands in the tables of the machine."""

    k: Floats  # slopes at all stages of an explicit method
    t: Floats
    counts: Integers
    absolute: Floats  # tolerances
    relative: float
    longest: float
    end: float
    near: float  # part of the square of the least singular value at the start, below which somebody has to look
    times: Floats
    found: Floats  # q, u, work at times of output


class Implicit(NamedTuple):
    """Numbers of an implicit method, as in `mbstab.analysis.simulate.steppers.implicit`."""

    tol: float
    rate: float
    fixed: bool
    iterations: int
    goal: float
    stalled: float
    kink: float
    collapsed: float
    begin: float  # where the march starts (s)
    quadrature: Floats  # of the power: nodes in -1 … 1, weights
    power: float  # one over the order of the estimate plus one
    consistent: bool  # accelerations at the end of a step are those of the state
