"""A scene as arrays: tables of integers and of floats, each with a number."""

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

INTEGERS = (
    "run_operation",  # of each run of equal operations
    "run_start",  # its first operation; of one more than there are runs
    "first",  # register of each operand
    "second",
    "ends",  # runs for the accelerations, for the residuals as well, and for derivatives as well
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
    "newton_kind",  # of the parts of a Newton matrix, such as `MASS`
    "newton_register",
    "newton_row",  # places
    "newton_column",
    "newton_target",  # place in a factored matrix: the diagonal, columns below it, rows beside it
    "angle",  # coordinates near whose ±pi/2 the chart ends
    "pinned",
)
"""Tables of integers of a machine; places are those in the order of elimination, registers come with a sign."""

FLOATS = (
    "w",  # registers: q, u, t, base rotations, a and ν of derivatives, constants, results
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
    "newton_factor",
    "newton_value",
    "sizes",
    "least_cosine",
    "left",  # of the least singular value, by place of rows
    "right",  # by place
    "reach",
    "best",
    "y",  # q and u at the start of a step
    "before",  # at the start of the step before
    "trial",  # at its end
    "inside",
    "rates",
    "other",
    "a",  # of implicit methods: accelerations at the start of a step
    "nu",
    "next_a",  # at its end
    "next_nu",
    "known",  # of q and u at its end
    "jerk",
    "drift",
    "past",
    "ahead",
    "change",
    "newton_c",  # coefficients of kinds
    "newton_b",  # by place
    "newton_lu",
    "stage_y",  # of Radau IIA, for each stage: q and u
    "stage_a",
    "stage_nu",
    "stage_pull",  # h G η
    "stage_b",  # what is left of the equations, by place
    "stage_e",  # of rows in position
    "step_a",  # the last changes
    "step_pull",
    "last_a",  # of the step before
    "last_nu",
    "gram",  # the factors of C Cᵀ
    "real_e",  # parts of the real eigenvalue, by place
    "real_g",
    "complex_c",  # of the complex one: twice as many floats
    "complex_b",
    "complex_e",
    "complex_g",
    "complex_lu",
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
    NEWTON_KIND,
    NEWTON_REGISTER,
    NEWTON_ROW,
    NEWTON_COLUMN,
    NEWTON_TARGET,
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
    NEWTON_FACTOR,
    NEWTON_VALUE,
    SIZES,
    LEAST_COSINE,
    LEFT,
    RIGHT,
    REACH,
    BEST,
    Y,
    BEFORE,
    TRIAL,
    INSIDE,
    RATES,
    OTHER,
    A,
    NU,
    NEXT_A,
    NEXT_NU,
    KNOWN,
    JERK,
    DRIFT,
    PAST,
    AHEAD,
    CHANGE,
    NEWTON_C,
    NEWTON_B,
    NEWTON_LU,
    STAGE_Y,
    STAGE_A,
    STAGE_NU,
    STAGE_PULL,
    STAGE_B,
    STAGE_E,
    STEP_A,
    STEP_PULL,
    LAST_A,
    LAST_NU,
    GRAM,
    REAL_E,
    REAL_G,
    COMPLEX_C,
    COMPLEX_B,
    COMPLEX_E,
    COMPLEX_G,
    COMPLEX_LU,
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
    given: int  # register of the first acceleration
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
