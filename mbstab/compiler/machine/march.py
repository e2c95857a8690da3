"""The state of a march: many steps at once."""

from __future__ import annotations

from typing import NamedTuple

from mbstab.compiler.machine.tables import Floats, Integers

TIME, FOLLOWING, TAKEN, WORK, PEAK, DRIFT, LEAST, RATE = range(8)
"""Places in `March.t`: the time, the next step (0: to be chosen), the last one (s), work, the largest kinetic energy
(J), the largest residual, the square of the least singular value at the start, the power (W)."""

STEPS, REJECTED, EVALUATIONS, COVERED = range(4)
"""Places in `March.counts`; the last is of times of output that are done."""

DONE, MORE, CHART, LOOK = range(4)
"""Why `march` returns: the end, so many steps, an angle near its singularity, something that it leaves to others."""


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
