"""The search: steps to the best points of linear inequalities within trust regions; the best point so far is kept.

In every step the inequalities of the eigenvalues at the present point are solved as linear programs within regions of
many sizes (sequential linear programming; Fletcher and Sainz de la Maza 1989, Math. Program. 43), alone, together with
those of former steps, on the smooth sides of meetings, and where eigenvalues cross. The goal itself is computed at all
these points at once, and the best of them is taken if it is better than the present one. So no model has to be trusted:
before a point is called an optimum, points that are spread over regions of all sizes, from all ranges on, are tried.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from mbstab.analysis.design.goals import Goal, Variant
from mbstab.analysis.design.rows import Rows
from mbstab.analysis.design.tolerances import TOLERANCES
from mbstab.compiler.system import Array
from mbstab.records import dataclass

OPTIMUM, SLOW, ENOUGH, STEPS, STOPPED, BLIND = (
    "no step to any distance is better, nor are points spread over all ranges: an optimum as far as was tried",
    "two steps in a row gained next to nothing: near a local optimum",
    "the value asked for is reached",
    "the steps are used up: a better point may exist nearby",
    "interrupted: a better point may exist nearby",
    "the eigenvalues that limit it have no derivatives there: they meet, or cannot be told apart",
)
"""Why the search ended."""


@dataclass(frozen=True)
class Found:
    """The best point.

    Attributes
    ----------
    x : ndarray, shape (n,)
        In the unit cube.
    value : float
        Of the goal.
    steps : int
        Number of steps.
    ended : str
        Why there are no more.
    """

    x: Array
    value: float
    steps: int
    ended: str


def search(
    goal: Goal, start: Array, steps: int, least: float | None, progress: Callable[[float], object] = lambda done: None
) -> Found:
    """Return the best point that is found from a start; if it is interrupted (Ctrl-C), the best so far."""
    best = Found(start, float(goal.values(start[None])[0]), 0, STEPS)
    cuts: list[Rows] = []
    reach, before, small = 1.0, start, 0
    try:
        for number in range(1, steps + 1):
            if least is not None and best.value >= least:
                return replace(best, ended=ENOUGH)
            plain, variants = goal.model(best.x)
            cuts = [*cuts[-TOLERANCES.cuts :], plain]
            seen = len(plain.b) > 0
            found = (
                _better(goal, best, before, reach, cuts, variants) if seen and small < TOLERANCES.small_gains else None
            )
            if found is None:
                found = _best(goal, best, _scattered(goal, best.x))
                if found is None:
                    return replace(best, ended=SLOW if small else OPTIMUM if seen else BLIND)
                # What has been learnt belongs to another place.
                cuts, small = [], 0
            # A region somewhat larger than the step that was best is the largest one next time.
            x, value = found
            reach = min(1.0, TOLERANCES.reach_ratio**2 * float(np.max(np.abs(x - best.x))))
            small = small + 1 if value - best.value <= TOLERANCES.gain_enough * abs(value) else 0
            before, best = best.x, Found(x, value, number, STEPS)
            progress(number / steps)
    except KeyboardInterrupt:
        return replace(best, ended=STOPPED)
    return replace(best, ended=ENOUGH if least is not None and best.value >= least else STEPS)


def _better(
    goal: Goal, best: Found, before: Array, reach: float, cuts: list[Rows], variants: list[Variant]
) -> tuple[Array, float] | None:
    """Return a better point and its value, None if there is none at any distance that is tried."""
    while reach > TOLERANCES.reach_least:
        found = _best(goal, best, _trials(goal, best.x, before, reach, cuts, variants))
        if found is not None:
            return found
        reach /= TOLERANCES.reach_ratio**TOLERANCES.reaches
    return None


def _best(goal: Goal, best: Found, trials: Array) -> tuple[Array, float] | None:
    """Return the best of some points and its value, None if none is better than the best so far."""
    values = goal.values(trials) if len(trials) else np.array([-np.inf])
    most = float(np.max(values))
    if not most - best.value > TOLERANCES.gain * abs(most) + goal.rounding:
        return None
    # The nearest of those that are equally good.
    alike = np.flatnonzero(values >= most - TOLERANCES.alike * abs(most))
    k = int(alike[np.argmin(np.max(np.abs(trials[alike] - best.x), axis=1))])
    return trials[k], float(values[k])


def _scattered(goal: Goal, x: Array) -> Array:
    """Return points that are spread over all ranges, and over ever smaller regions about a point, shape (points, n)."""
    found, reach = [_spread(goal.scattered, len(x))], 1.0
    while (reach := reach / TOLERANCES.reach_ratio) > TOLERANCES.reach_least:
        found.append(np.clip(x + reach * (2.0 * _spread(TOLERANCES.scattered_near, len(x)) - 1.0), 0.0, 1.0))
    return np.vstack(found)


def _spread(count: int, n: int) -> Array:
    """Return points that fill the unit cube evenly, shape (count, n): multiples of powers of g, gⁿ⁺¹ = g + 1, modulo 1.

    Roberts 2018, The unreasonable effectiveness of quasirandom sequences; in one dimension, of the golden section.
    """
    g = 2.0
    for _ in range(TOLERANCES.rounds_of_root):
        g = (1.0 + g) ** (1.0 / (n + 1))
    return np.asarray((0.5 + np.outer(np.arange(count), g ** -np.arange(1.0, n + 1.0))) % 1.0)


def _trials(goal: Goal, x: Array, before: Array, reach: float, cuts: list[Rows], variants: list[Variant]) -> Array:
    """Return the points that are tried next, shape (points, n)."""
    together = Rows.joined(cuts)
    found = [np.clip(x + part * (x - before), 0.0, 1.0) for part in (1.0, 3.0)] if np.any(x != before) else []
    for k in range(TOLERANCES.reaches):
        within = reach / TOLERANCES.reach_ratio**k
        points = [rows.best(x, within, goal.limits) for rows in (cuts[-1], *([together] if len(cuts) > 1 else []))]
        found += [point for point in (*points, *(variant(within) for variant in variants)) if point is not None]
    others = [point for point in found if np.max(np.abs(point - x)) > TOLERANCES.reach_least * within]
    return np.unique(np.array(others).reshape(len(others), len(x)), axis=0)
