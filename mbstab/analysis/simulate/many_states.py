"""Many states at once: their projection onto the constraints, their accelerations, multipliers and residuals.

Kernels and solutions run over arrays, with a leading axis for the states. Where that fails at some state, each is
looked at by itself, which says what is wrong and when.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from mbstab.analysis.algebra.augmented import augmented_matrix
from mbstab.analysis.simulate.constrained import Constrained
from mbstab.analysis.simulate.tolerances import TOLERANCES
from mbstab.compiler.system import Array, Dynamics, System
from mbstab.errors import MbstabError

FAILURES = (MbstabError, ArithmeticError, ValueError, np.linalg.LinAlgError)


class Found(NamedTuple):
    """What belongs to states on the constraints.

    Attributes
    ----------
    a : ndarray, shape (n_t, n_q)
    nu : ndarray, shape (n_t, n_c)
        Multipliers, of least norm where rows are redundant.
    J : ndarray, shape (n_t, n_c, n_q)
    kinetic : ndarray, shape (n_t,) (J)
    residuals : ndarray, shape (n_t, 2)
        As of `Constrained.residuals`.
    """

    a: Array
    nu: Array
    J: Array
    kinetic: Array
    residuals: Array


def chunks(system: System, count: int) -> Iterator[slice]:
    """Yield the parts of a number of states that are processed together."""
    size = 1 + TOLERANCES.matrix_numbers_together // (1 + (system.n_c + system.n_q) ** 2)
    size = min(TOLERANCES.states_together, size)
    for start in range(0, count, size):
        yield slice(start, start + size)


def found_at(equations: Constrained, times: Array, q: Array, u: Array, a: Array | None = None) -> Found:
    """Return what belongs to states, shapes (n_t,) and (n_t, n_q), with given accelerations where rows leave them open.

    Raises
    ------
    MbstabError
        If a force or a given function of time has no value at a state.
    """
    if a is None and len(times) >= TOLERANCES.states_singly:
        try:
            with np.errstate(all="ignore"):
                found = _together(equations, times, q, u)
            if all(np.isfinite(x).all() for x in found):
                return found
        except FAILURES:
            pass
    singly = [
        _singly(equations, *state) for state in zip(times, q, u, [None] * len(times) if a is None else a, strict=True)
    ]
    return Found(*(np.array(x) for x in zip(*singly, strict=True)))


def _together(equations: Constrained, times: Array, q: Array, u: Array) -> Found:
    n, e = equations.n, equations
    state = e.arrays.dynamics(q, u, times)
    J = np.broadcast_to(state.J, (len(q), e.n_c, n))
    rows, bias = J * e.rows, np.broadcast_to(-state.B * e.row_scale, (len(q), e.n_c))[..., None]
    P = None if e.full else e.combined(rows)
    if P is not None:
        rows, bias = _in_combinations(P, rows), _in_combinations(P, bias)
    force = np.broadcast_to(-state.F0 * e.scale, q.shape)[..., None]
    x = np.linalg.solve(augmented_matrix(state.M * e.weights, rows), np.concatenate([force, bias], axis=-2))
    nu = (x[:, n:] if P is None else P @ x[:, n:])[..., 0] * e.row_scale
    kinetic = 0.5 * (u[:, None, :] @ state.M @ u[:, :, None])[:, 0, 0]
    return Found(x[:, :n, 0] * e.scale, e.least(nu, J), J, kinetic, np.stack(_residuals(e, state, u), axis=-1))


def _singly(equations: Constrained, t: float, q: Array, u: Array, a: Array | None) -> tuple[Array, ...]:
    if a is None:
        if not equations.full:
            equations.refresh(equations.evaluate(t, q, u))
        a, nu, state = equations.accelerations(t, q, u)
        nu = equations.least(nu, state.J)
    else:
        state = equations.evaluate(t, q, u)
        nu = equations.multipliers(state, a)
    kinetic, residuals = 0.5 * u @ state.M @ u, equations.residuals(state, equations.fastest(u))
    return a, nu, state.J, kinetic, np.array(residuals)


def settled(equations: Constrained, times: Array, q: Array, u: Array) -> Iterator[tuple[Array, Array, Array]]:
    """Yield times and states near the constraints after the projection of `Constrained.project`, in parts.

    Raises
    ------
    NumericalError
        If a state cannot satisfy them; the states before have been yielded.
    """
    for part in chunks(equations.system, len(times)):
        state = times[part], q[part], u[part]
        if equations.n_c == 0:
            yield state
            continue
        try:
            with np.errstate(all="ignore"):
                found = _projected(equations, *state)
        except FAILURES:
            found = None
        if found is not None:
            yield state[0], *found
            continue
        for t, x, v in zip(*state, strict=True):
            if not equations.full:
                equations.refresh(equations.evaluate(t, x, v))
            x, v, _ = equations.project(t, x, v)
            yield np.array([t]), x[None], v[None]


def _projected(e: Constrained, times: Array, q: Array, u: Array) -> tuple[Array, Array] | None:
    """Return the nearest coordinates and speeds that satisfy the constraints, or None if there are none for a state."""
    best, least = (q, u), np.full(len(q), np.inf)
    for _ in range(TOLERANCES.projection_steps):
        state = e.arrays.dynamics(q, u, times)
        position, velocity = _residuals(e, state, u)
        size = np.maximum(position, velocity)
        better, going = (size < least)[:, None], size < 0.5 * least
        best, least = (np.where(better, q, best[0]), np.where(better, u, best[1])), np.fmin(size, least)
        if not np.any(going & (size > TOLERANCES.projection_residual)):
            break
        if np.any(position > TOLERANCES.projection_residual):
            q = q + _least_changes(e, state, state.E[..., : e.n_h], len(q))
            state = e.arrays.dynamics(q, u, times)
        u = u + _least_changes(e, state, state.V, len(q))
    return best if np.max(least) <= TOLERANCES.projection_residual_failed else None


def _least_changes(e: Constrained, state: Dynamics, residual: Array, count: int) -> Array:
    """Return the least Δ in the metric of M with J Δ = −residual for as many rows, shape (count, n_q)."""
    rows, J = residual.shape[-1], np.broadcast_to(state.J * e.rows, (count, e.n_c, e.n))
    P = None if e.full else e.combined(J)
    J, goal = J[..., :rows, :], np.broadcast_to(-residual * e.row_scale[:rows], (count, rows))[..., None]
    if P is not None:
        P = P[..., :rows, : e.rank_h if rows == e.n_h else e.rank]
        J, goal = _in_combinations(P, J), _in_combinations(P, goal)
    A = augmented_matrix(state.M * e.weights, J)
    if rows == e.n_h:
        # As in `Constrained`: they have no mass, only their rates follow the others.
        A[..., e.massless, e.massless] = 1.0
    b = np.concatenate([np.zeros((count, e.n, 1)), goal], axis=-2)
    return np.asarray(np.linalg.solve(A, b)[..., : e.n, 0] * e.scale)


def _in_combinations(P: Array, x: Array) -> Array:
    return np.asarray(np.swapaxes(P, -1, -2) @ x)


def _residuals(e: Constrained, state: Dynamics, u: Array) -> tuple[Array, Array]:
    fast = np.max(np.abs(u / e.sizes), axis=-1, initial=0.0)[:, None]
    position, velocity = e.relative(state, np.maximum(fast, e.slowest))
    return np.broadcast_to(position, len(u)), np.broadcast_to(velocity, len(u))
