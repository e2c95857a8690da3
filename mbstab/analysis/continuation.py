"""Equilibria and steady motions over a parameter: followed from one value to the next.

From a solution at one value the next one is predicted by a straight line and corrected by
Newton's method; steps are halved until the correction is small, so the path stays on its
branch. Where no step leads further, the solution is lost: at a fold, or because the scene
itself has no motion there.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mbstab.analysis.equilibrium import Problem
from mbstab.compiler.system import Array, System
from mbstab.errors import MbstabError
from mbstab.model.arithmetic import FLOAT
from mbstab.model.schema import Model
from mbstab.model.values import evaluate, evaluate_parameters

FIRST = 1.0 / 16.0
"""First step, as a part of the range."""

LEAST = 1e-12
"""A solution is lost if no step of this part of the range leads further."""

TRUSTED = 0.05
"""A prediction may be wrong by this part of the size of the scene, or by this angle (rad)."""


@dataclass(frozen=True)
class Path:
    """Solutions over a parameter.

    Attributes
    ----------
    values : ndarray, shape (k,)
        Of the parameter (SI), ascending.
    q : ndarray, shape (k, n_q)
    c : ndarray, shape (k, size of the family)
        Rates of the steady motion.
    lost : tuple of (float, str)
        Values beyond which no solution was found, and why.
    low, high : float
        The range that was asked for.
    start : float
        Where the first solution was found.
    """

    values: Array
    q: Array
    c: Array
    lost: tuple[tuple[float, str], ...]
    low: float
    high: float
    start: float

    def predicted(self, values: Array) -> tuple[Array, Array]:
        """Return starting values at parameter values, shapes (points, n_q) and (points, size)."""
        q, c = (
            np.stack([np.interp(values, self.values, column) for column in x.T], axis=1)
            if x.shape[1]
            else np.zeros((len(values), 0))
            for x in (self.q, self.c)
        )
        return q, c

    def nearest(self, value: float) -> tuple[Array, Array]:
        """Return starting values at one parameter value."""
        q, c = self.predicted(np.array([value]))
        return q[0], c[0]


def follow(
    model: Model, parameter: str, settings: Mapping[str, float], low: float, high: float, first_at: float | None = None
) -> Path:
    """Return the solutions over a range of a parameter, followed from one value both ways.

    From `first_at`, or else the lowest value; where there is none, from the other end, the file's
    own value, or the middle.

    Raises
    ------
    MbstabError
        If there is no solution to start from.
    """
    nominal = float(evaluate_parameters(model, dict(settings), FLOAT)[parameter])
    starts = [low if first_at is None else first_at, low, high]
    starts += [nominal] if low <= nominal <= high else []
    starts.append(0.5 * (low + high))
    failure: MbstabError | None = None
    for start in starts:
        try:
            first = _solution(model, {**settings, parameter: start}, None)
            break
        except MbstabError as error:
            failure = failure or error
    else:
        assert failure is not None
        raise failure
    found, lost = {start: first}, []
    for end in (low, high):
        reason = _follow(model, parameter, settings, start, end, high - low, found)
        if reason is not None:
            lost.append(reason)
    values = np.array(sorted(found))
    q, c = (np.array([found[float(p)][k] for p in values]) for k in (0, 1))
    return Path(values, q, c, tuple(lost), low, high, start)


def _follow(
    model: Model,
    parameter: str,
    settings: Mapping[str, float],
    start: float,
    end: float,
    width: float,
    found: dict[float, tuple[Array, Array, Array]],
) -> tuple[float, str] | None:
    """Add solutions from a start towards an end of the range; return where and why they stop, if they do."""
    at, step = start, FIRST * (end - start)
    before: float | None = None
    while at != end:
        goal = end if abs(end - at) <= abs(step) else at + step
        q, c, sizes = found[at]
        if before is not None:
            weight = (goal - at) / (at - before)
            q, c = q + weight * (q - found[before][0]), c + weight * (c - found[before][1])
        try:
            solution = _solution(model, {**settings, parameter: goal}, (q, c))
            error = float(np.max(np.abs((solution[0] - q) / sizes), initial=0.0))
        except (MbstabError, ArithmeticError, np.linalg.LinAlgError):
            solution, error = None, np.inf
        if solution is None or error > TRUSTED:
            step *= 0.5
            if abs(step) < LEAST * width:
                return at, "it ends there" if solution is None else "it turns back"
            continue
        found[goal] = solution
        before, at = at, goal
        if error < 0.3 * TRUSTED:
            step *= 1.6
    return None


def _solution(
    model: Model, settings: Mapping[str, float], near: tuple[Array, Array] | None
) -> tuple[Array, Array, Array]:
    """Return q and c of the solution near a prediction, or that of the file's own guess, and the sizes."""
    problem = Problem(System(evaluate(model, dict(settings))))
    if near is None:
        _, search, at, _ = problem.solved(problem.start)
    else:
        _, search, at, _ = problem.solved(*near)
    return at.q, at.c, search.sizes
