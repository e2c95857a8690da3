"""Newton's method for equilibria and steady motions at many points of a sweep at once.

Steps are those of the normal equations: directions that nothing depends on stay where they are.
Neighbours have nearly the same derivative, so where the start is near, that of a few of them
serves for all (chord method); points at which it does not converge fast take their own.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from mbstab.analysis.algebra.arrays import Flags, Index
from mbstab.analysis.reference.equations import Balance, State
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
    at, last = balance.state(balance.completed(q), c), np.inf
    for _ in range(TOLERANCES.steps_at_many_points):
        step = _step(balance, at)
        good &= _length(balance, step) < TOLERANCES.reach_at_many_points
        step[~good] = 0.0
        at = balance.state(*balance.moved(at, step))
        longest = float(np.max(_length(balance, step), initial=0.0))
        # Small steps end where they do not become smaller: then they are rounding.
        if not longest > TOLERANCES.newton_step_at_many_points and (
            longest <= TOLERANCES.chord_step_settled or longest >= TOLERANCES.chord_contraction * last
        ):
            break
        last = longest
    return at, good & (np.max(np.abs(at.residual), axis=1) <= TOLERANCES.residual)


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
    derivative: tuple[Array, Array] | None = None
    for _ in range(TOLERANCES.steps_at_many_points):
        if derivative is None:
            derivative, before = _normal(balance.jacobian(at)), math.inf
        step = _solved(derivative, at.residual)
        if (
            not np.max(_length(balance, step[..., : balance.moving] / balance.distances(at.q)))
            <= TOLERANCES.newton_reach
        ):
            return None
        longest = float(np.max(_length(balance, step)))
        at = balance.state(*balance.moved(at, step))
        # Steps with the same derivative become smaller by the same factor each time.
        left = longest * min(longest / before if before < math.inf else longest, 1.0)
        if left <= last * last and np.max(np.abs(at.residual)) <= max(TOLERANCES.residual, last * last):
            return at
        if longest > TOLERANCES.chord_contraction * min(before, TOLERANCES.newton_reach):
            derivative = None
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
    inverses = np.linalg.solve(*_normal(here.jacobian(here.state(q[sample], c[sample]))))
    groups = _nearest(q / balance.sizes, sample)
    at, last = balance.state(q, c), np.full(len(q), TOLERANCES.reach_at_many_points / TOLERANCES.chord_contraction)
    for _ in range(TOLERANCES.steps_at_many_points):
        step = np.empty((len(q), inverses.shape[1]))
        for inverse, group in zip(inverses, groups, strict=True):
            step[group] = -at.residual[group] @ inverse.T
        length = _length(balance, step)
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


def _step(balance: Balance, at: State) -> Array:
    """Return the step of Newton's method at each point, scaled."""
    return _solved(_normal(balance.jacobian(at)), at.residual)


def _solved(derivative: tuple[Array, Array], residual: Array) -> Array:
    square, transposed = derivative
    step: Array = -np.linalg.solve(square, transposed @ residual[..., None]).astype(float)[..., 0]
    return step


def _normal(G: Array) -> tuple[Array, Array]:
    """Return GᵀG, regularized, and Gᵀ."""
    transposed = np.swapaxes(G, -1, -2)
    square = transposed @ G
    size = np.trace(square, axis1=-2, axis2=-1)[..., None, None]
    return square + TOLERANCES.normal_equations_ridge * size * np.eye(G.shape[-1]), transposed


def _length(balance: Balance, step: Array) -> Array:
    """Return the largest change of a coordinate or a rate in a step, shape (…)."""
    result: Array = np.max(np.abs(step[..., : balance.moving]), axis=-1, initial=0.0)
    return result
