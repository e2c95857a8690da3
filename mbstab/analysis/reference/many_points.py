"""Newton's method for equilibria and steady motions at many points of a sweep at once.

Steps have minimum norm: directions that nothing depends on stay where they are.
Neighbours have nearly the same derivative, so where the start is near, that of a few of them
serves for all (chord method); points at which it does not converge fast take their own.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from mbstab.analysis.algebra.arrays import Flags, Index
from mbstab.analysis.reference.equations import Balance, LinearBalance, State
from mbstab.analysis.reference.tolerances import TOLERANCES
from mbstab.compiler.system import Array


def newton(balance: Balance, q: Array, c: Array) -> tuple[State, Flags]:
    """Return the solutions near starts, and where steps led to one.

    Parameters
    ----------
    balance : Balance
        With parameters of shape (points,).
    q : ndarray, shape (points, n_q)
    c : ndarray, shape (points, size of the family)
    """
    good: Flags = np.ones(len(q), dtype=bool)
    at, last, moving = balance.state(balance.completed(q), c), np.inf, good
    inverses: Array | None = None
    for _ in range(TOLERANCES.steps_at_many_points):
        # Short steps need no derivative of their own.
        inverses = _inverses(balance, at, moving, inverses)
        # Alone, what rounding moves far is computed with more digits.
        good &= np.max(np.abs(inverses), axis=(-2, -1), initial=0.0) <= TOLERANCES.sharpened_from
        step = _moved(inverses, at.residual)
        length = _length(step)
        good &= length < TOLERANCES.reach_at_many_points
        step[~good] = 0.0
        at = balance.state(*balance.moved(at, step))
        moving = good & (length > TOLERANCES.newton_step_at_many_points)
        longest = float(np.max(length, initial=0.0, where=good))
        # Small steps end where they do not become smaller: then they are rounding.
        if not np.any(moving) and (
            longest <= TOLERANCES.chord_step_settled or longest >= TOLERANCES.chord_contraction * last
        ):
            break
        last = longest
    return at, good & ~moving & (np.max(np.abs(at.residual), axis=1) <= TOLERANCES.residual)


def all_solved(balance: Balance, q: Array, c: Array, last: float) -> State | None:
    """Return the solutions near starts that may be far; None if there is one to which steps do not lead.

    Parameters
    ----------
    balance : Balance
        Of many points, or of one.
    last : float
        Size of the last step of Newton's method: what it leaves is its square.
    """
    at, before = balance.state(balance.completed(q), c), math.inf
    inverse: Array | None = None
    for _ in range(TOLERANCES.steps_at_many_points):
        if inverse is None:
            inverse, before = _inverses(balance, at), math.inf
        step = _moved(inverse, at.residual)
        if not np.max(_length(step / balance.distances(at.q))) <= TOLERANCES.newton_reach:
            return None
        longest = float(np.max(_length(step)))
        at = balance.state(*balance.moved(at, step))
        # Steps with the same derivative become smaller by the same factor each time.
        left = longest * min(longest / before if before < math.inf else longest, 1.0)
        if left <= last * last and np.max(np.abs(at.residual)) <= max(TOLERANCES.residual, last * last):
            return at
        if longest > TOLERANCES.chord_contraction * min(before, TOLERANCES.newton_reach):
            inverse = None
        before = longest
    return None


def polished(balance: Balance, some: Callable[[Index], Balance], q: Array, c: Array) -> tuple[State, Flags]:
    """Return the same for starts that are near the solutions.

    Parameters
    ----------
    some : callable
        Returns the equations of some of the points, by their numbers.
    """
    stride = TOLERANCES.points_of_a_derivative
    if len(q) < 2 * stride:
        return newton(balance, q, c)
    q = balance.completed(q)
    sample = np.arange(stride // 2, len(q), stride)
    here = some(sample)
    inverses = _inverses(here, here.state(q[sample], c[sample]))
    groups = _nearest(q / balance.sizes, sample)
    at, last = balance.state(q, c), np.full(len(q), TOLERANCES.reach_at_many_points / TOLERANCES.chord_contraction)
    for _ in range(TOLERANCES.steps_at_many_points):
        step = np.empty((len(q), inverses.shape[1]))
        for inverse, group in zip(inverses, groups, strict=True):
            step[group] = _moved(inverse, at.residual[group])
        length = _length(step)
        settled = length <= TOLERANCES.chord_step_settled
        if np.all(settled):
            return at, np.max(np.abs(at.residual), axis=1) <= TOLERANCES.residual
        if not np.all(settled | (length <= TOLERANCES.chord_contraction * last)):
            break
        last = length
        at = balance.state(*balance.moved(at, step))
    return newton(balance, q, c)


def _nearest(places: Array, sample: Index) -> list[Index]:
    """Return the numbers of the points that are nearest to each of a sample."""
    squares = np.sum(places * places, axis=1)
    distances = squares[sample] - 2.0 * places @ places[sample].T
    nearest = np.argmin(distances, axis=1)
    return [np.flatnonzero(nearest == k) for k in range(len(sample))]


def _inverses(balance: Balance, at: State, chosen: Flags | None = None, before: Array | None = None) -> Array:
    """Return what makes steps of coordinates and rates of residuals, shape (…, moving, m); nan where there is none.

    At points that are not chosen, those before.
    """
    G = balance.jacobian(at) if chosen is None or np.any(chosen) else np.zeros((0, 0))
    found = np.full((*G.shape[:-2], balance.moving, G.shape[-2]), np.nan) if before is None else before
    for k in np.ndindex(at.q.shape[:-1]):
        if chosen is None or chosen[k]:
            known = np.all(np.isfinite(G[k]))
            found[k] = LinearBalance(G[k], balance.system.n_q, balance.moving).inverse if known else np.nan
    return found


def _moved(inverse: Array, residual: Array) -> Array:
    """Return the scaled steps of coordinates and rates that take residuals away."""
    step: Array = -(inverse @ residual[..., None]).astype(float)[..., 0]
    return step


def _length(step: Array) -> Array:
    """Return the largest change of a coordinate or a rate in a step, shape (…)."""
    result: Array = np.max(np.abs(step), axis=-1, initial=0.0)
    return result
