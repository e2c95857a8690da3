"""How much forces may be out of balance, rates of states off zero, and accelerations contradictory, by rounding."""

from __future__ import annotations

from typing import Any

import numpy as np

from mbstab.analysis.algebra.arrays import Flags
from mbstab.analysis.algebra.failures import FAILURES
from mbstab.analysis.algebra.rounded import UNIT
from mbstab.analysis.algebra.sparse import dense, is_sparse, largest
from mbstab.analysis.algebra.stacks import times
from mbstab.analysis.algebra.subspaces import Subspaces
from mbstab.analysis.reference.rounded_scene import errors_of, rounded_system, with_errors
from mbstab.analysis.reference.tolerances import TOLERANCES
from mbstab.compiler.system import Array, System
from mbstab.errors import ConstraintError


def state_rounding(system: System, q: Array, u: Array, time: float | None = None) -> Array:
    """Return the rates of first-order states that are rounding of the terms in their equations, shape (…, n_c).

    Zero for the other rows. At a single point a rate that is more than that is looked at once more: it may be a small
    difference of numbers inside an expression.
    """
    columns, rows = system.states
    found = np.zeros((*q.shape[:-1], system.n_c))
    if len(rows):
        V_q = dense(system.linearize_rows(q, u, 0.0 * u, time)[0])[..., rows, :]
        state = system.dynamics(q, u, time)
        J = np.array(dense(state.J)[..., rows, :])
        J[..., np.arange(len(rows)), columns] = 0.0
        terms = np.abs(V_q) @ np.abs(q)[..., None] + np.abs(J) @ np.abs(u)[..., None]
        found[..., rows] = TOLERANCES.coordinate_rounding * terms[..., 0]
        if q.ndim == 1 and np.any(np.maximum(np.abs(state.V[rows]), np.abs(u[columns])) > found[rows]):
            found[rows] = np.maximum(found[rows], rate_rounding(system, q, u, time)[rows])
    return found


def rate_rounding(system: System, q: Array, u: Array, time: float | None = None) -> Array:
    """Return the errors of the rates of the rows, with the decimals of the file and all that is made of them, (n_c,).

    Zero where the equations have no value with such numbers.
    """
    state = _rough(system, q, u, time)
    return np.zeros(system.n_c) if state is None else errors_of(state.V)


def force_rounding(system: System, at: tuple[Array, Array, Array, Array], time: float | None = None) -> Array:
    """Return the errors of the unbalanced forces at q, u, a and ν, as `rate_rounding` does for rates, shape (n_q,).

    Zero where they have no bound.
    """
    q, u, a, nu = at
    if (state := _rough(system, q, u, time)) is None:
        return np.zeros(system.n_q)
    with np.errstate(invalid="ignore"):
        found = errors_of(state.F0) + errors_of(state.M) @ np.abs(a) + errors_of(state.J).T @ np.abs(nu)
    return np.where(np.isfinite(found), found, 0.0)


def _rough(system: System, q: Array, u: Array, time: float | None) -> Any:
    """Return the equations at rounded coordinates and speeds, in numbers with errors; None where they have no value."""
    places, speeds = (with_errors(x, UNIT * np.abs(x)) for x in (q, u))
    try:
        return rounded_system(system).dynamics(places, speeds, time)
    except FAILURES:
        return None


def carrying(system: System, motion_at: tuple[Array, Array], time: float | None, sizes: Array) -> Array:
    """Return how much the rates of the rows change over the size of the scene, shape (…, n_c).

    A turntable carries what rests on it: the slip there is a difference of speeds of this size, and rounds with it.
    """
    q, u = motion_at
    return np.asarray(abs(system.linearize_rows(q, u, 0.0 * u, time)[0]) @ sizes)


def require_compatible(
    system: System,
    at: tuple[Array, Array, float],
    sizes: Array,
    spaces: Subspaces,
    J: Any,
    inverse: Any,
    bias: Array,
) -> None:
    """Refuse redundant rows that contradict each other in the accelerations.

    Parameters
    ----------
    at : tuple
        q, u and the time.
    sizes : ndarray, shape (n_q,)
    spaces : Subspaces
    J, inverse : matrix, shapes (n_c, n_q) and (n_q, n_c)
        The scaled rows and their pseudo-inverse.
    bias : ndarray, shape (n_c,)
        Scaled acceleration residuals of the rows at rest; J a = −bias.

    Raises
    ------
    ConstraintError
        Names the row that contradicts the others most.
    """
    residual = bias - J @ (inverse @ bias)
    most = float(np.max(np.abs(bias), initial=0.0))
    if np.max(np.abs(residual), initial=0.0) <= TOLERANCES.contradiction * most:
        return
    if not is_sparse(J):
        # Where curvatures of paths cancel, all of the bias is rounding, which tells nothing.
        found = rounding_of_accelerations(system, at, sizes, np.abs(inverse @ bias) * spaces.scale)
        apart = np.abs(residual) > np.abs(np.eye(len(J)) - J @ inverse) @ (found * spaces.row_scale)
        if not np.any(apart):
            return
        residual = np.where(apart, residual, 0.0)
    worst = int(np.argmax(np.abs(residual)))
    row = system.rows[worst]
    raise ConstraintError(
        f"{row.location}: {row} contradicts other constraints: no accelerations satisfy all of them "
        f"(residual {residual[worst]:.3g} of {most:.3g})"
    )


def rounding_of_accelerations(system: System, at: tuple[Array, Array, float], sizes: Array, a: Array) -> Array:
    """Return how far J a + B may be off by rounding, also by that of coordinates and speeds, shape (n_c,).

    It includes that of the decimals of the file: what 0.1 + 0.2 - 0.3 leaves in floats contradicts nothing, as the
    numbers that the file gives do not. A contradiction of these numbers is larger, if floats can tell it at all.
    """
    q, u, time = at
    fastest = float(np.max(np.abs(u / sizes), initial=0.0))
    places = TOLERANCES.coordinate_rounding * np.maximum(np.abs(q), sizes)
    speeds = TOLERANCES.coordinate_rounding * fastest * sizes
    state = rounded_system(system).dynamics(with_errors(q, places), with_errors(u, speeds), time)
    result: Array = errors_of(state.B) + errors_of(state.J) @ a
    return result


def balanced_at(
    system: System,
    at: tuple[Array, Array, Array, Array],
    left: Array,
    force: Array,
    sizes: Array,
    scale: Array,
    time: float | None,
) -> Flags:
    """Return whether scaled forces that should vanish do so, at q, u, a and ν, shape (…).

    They may be a small part of the forces that balance. Where springs and inertia balance by
    themselves, they may have at least the effect of rounded coordinates and speeds, and of the rounding of the forces
    that the speeds would take to turn.
    """
    scene, most = system.scene, np.max(np.abs(left), axis=-1, initial=0.0)
    gravity = np.linalg.norm(np.stack(np.broadcast_arrays(*scene.gravity)).astype(float), axis=0)
    heaviest = np.sqrt(np.max(np.stack(np.broadcast_arrays(*(x.mass for x in scene.bodies))).astype(float), axis=0))
    allowed = TOLERANCES.unbalance * np.maximum(np.max(np.abs(force * scale), axis=-1), heaviest * gravity)
    if np.all(most <= allowed):
        return np.asarray(most <= allowed)
    allowed = allowed + TOLERANCES.coordinate_rounding * force_change(system, at, sizes, scale, time)
    fastest = np.max(np.abs(at[1] / sizes), axis=-1, keepdims=True, initial=0.0)
    if np.all(most <= allowed) or not np.any(fastest):
        return np.asarray(most <= allowed)
    turning = times(abs(system.dynamics(at[0], at[1], time).M), np.abs(at[1])) * fastest * scale
    return np.asarray(most <= allowed + TOLERANCES.coordinate_rounding * np.max(turning, axis=-1))


def force_change(
    system: System, at: tuple[Array, Array, Array, Array], sizes: Array, scale: Array, time: float | None = 0.0
) -> Array:
    """Return how much scaled forces change over the size of the scene, by their slope at q, u, a and ν, shape (…).

    Where the slope changes within the rounding of coordinates, the larger one counts if there is one as large further
    away: near a multiple zero of a force, not near a pole.
    """
    q, u, a, nu = at
    K, R, _ = system.linearize(q, u, a, nu, time)
    beside, _, _ = system.linearize(q + TOLERANCES.coordinate_rounding * sizes, u, a, nu, time)
    slope, irregular = abs(K), np.asarray(largest(beside - K) > 0.01 * largest(K))
    if np.any(irregular):
        further, _, _ = system.linearize(q + TOLERANCES.move_scaling_forces * sizes, u, a, nu, time)
        larger = np.maximum(dense(slope), dense(abs(beside)))
        larger = np.where(np.isfinite(larger), np.fmin(larger, dense(abs(further))), 0.0)
        slope = np.where(irregular[..., None, None], larger, dense(slope))
    return np.asarray(np.max((slope @ sizes + times(abs(R), np.abs(u))) * scale, axis=-1))
