"""The state of a march: many steps at once."""

from __future__ import annotations

from typing import NamedTuple

from mbstab.compiler.machine.tables import Floats, Integers

TIME, FOLLOWING, TAKEN, WORK, PEAK, DRIFT, LEAST, RATE, LENGTH, PLACES = range(10)
"""Places in `March.t`: the time, the next step (0: to be chosen), the last one (s), work, the largest kinetic energy
(J), the largest residual, the square of the least singular value at the start, the power (W), the step before
of an implicit method (s; 0: none); how many they are."""

STEPS, REJECTED, EVALUATIONS, COVERED = range(4)
"""Places in `March.counts`; the last is of times of output that are done."""

DONE, MORE, CHART, LOOK = range(4)
"""Why `march` returns: the end, so many steps, an angle near its singularity, something that it leaves to others."""


class March(NamedTuple):
    """The state of a march, which `march` changes in place; more of it stands in the tables of the machine."""

    k: Floats  # slopes at all stages of an explicit method
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
    coefficients: Floats  # of stages
    alpha_m: float
    alpha_f: float
    gamma: float
    beta: float
