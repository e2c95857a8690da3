"""The error of a run, from its differences to earlier runs with larger tolerances per step.

In theory errors are proportional to a power of the tolerance per step; those of single runs scatter about that. So a
part of the power is counted on while a tolerance is reduced a little, and all of it only for what it is reduced
further. Where the differences to two earlier runs shrink with a smaller power, that one counts: these runs may not yet
show the motion, or it amplifies their errors. Without differences to two earlier runs, one of them nearby, the
difference itself is told.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from mbstab.analysis.simulate.tolerances import TOLERANCES


class Estimate(NamedTuple):
    """The error of a run: the one that is told, and what it will be if errors shrink as in theory."""

    error: float
    likely: float


def estimated(found: list[tuple[float, float]], power: float) -> Estimate:
    """Return the error of a run, the largest estimate from its differences to earlier ones.

    A difference as large as the motion does not shrink with any power yet: it says nothing beside smaller ones, and
    alone that nothing is known.

    Parameters
    ----------
    found : list of (float, float)
        For each earlier run: the tolerance of the run over that of the earlier one, and their difference.
    power : float
        `Method.power`.
    """
    near = [(ratio, off) for ratio, off in found if off < TOLERANCES.difference_of_motions]
    if not near:
        worst = max(off for _, off in found)
        return Estimate(worst, worst)
    likely = max(_left(off, shrunk(ratio, power), power) for ratio, off in near)
    # Two runs may agree by chance, and far away more than the power changes.
    sure = len(near) > 1 and found[-1][0] >= (1.0 - 1e-9) * TOLERANCES.clear_reduction
    order = _order(found) if sure else 0.0
    if order >= TOLERANCES.order_counted_on * power:
        return Estimate(likely, likely)
    return Estimate(max(_left(off, ratio**order, power) for ratio, off in near), likely)


def shrunk(ratio: float, power: float) -> float:
    """Return the part of an error that is left where the tolerance per step is reduced by a ratio."""
    clear = TOLERANCES.clear_reduction
    return float(max(ratio, clear) ** (TOLERANCES.order_counted_on * power) * min(ratio / clear, 1.0) ** power)


def reduction(part: float, power: float) -> float:
    """Return the ratio by which the tolerance per step has to be reduced so that this part of the error is left."""
    clear, counted = TOLERANCES.clear_reduction, TOLERANCES.order_counted_on * power
    left = part / clear**counted
    return float(part ** (1.0 / counted) if left >= 1.0 else clear * left ** (1.0 / power))


def _left(off: float, part: float, power: float) -> float:
    """Return the error of the better of two runs from their difference, of which a part is its own."""
    part = min(part, TOLERANCES.step_tolerance_ratio ** (TOLERANCES.order_counted_on * power))
    return off * part / (1.0 - part)


def _order(found: list[tuple[float, float]]) -> float:
    """Return the power of the tolerance to which the differences to two earlier runs are proportional."""
    if len(found) < 2:
        return math.inf
    (one, far), (other, close) = found
    if not (min(far, close) > 0.0 and one < TOLERANCES.step_tolerance_ratio * other):
        return math.inf
    return math.log(far / close) / math.log(other / one)
