"""How much forces may be out of balance, and rates of states off zero, by rounding."""

from __future__ import annotations

import math

import numpy as np

from mbstab.analysis.algebra.sparse import dense, largest
from mbstab.analysis.reference.tolerances import TOLERANCES
from mbstab.compiler.system import Array, System


def state_rounding(system: System, q: Array, u: Array, time: float | None = None) -> Array:
    """Return the rates of first-order states that are rounding of the terms in their equations, shape (…, n_c).

    Zero for the other rows.
    """
    columns, rows = system.states
    found = np.zeros((*q.shape[:-1], system.n_c))
    if len(rows):
        V_q = dense(system.linearize_rows(q, u, 0.0 * u, time)[0])[..., rows, :]
        J = np.array(dense(system.dynamics(q, u, time).J)[..., rows, :])
        J[..., np.arange(len(rows)), columns] = 0.0
        terms = np.abs(V_q) @ np.abs(q)[..., None] + np.abs(J) @ np.abs(u)[..., None]
        found[..., rows] = TOLERANCES.coordinate_rounding * terms[..., 0]
    return found


def carrying(system: System, motion_at: tuple[Array, Array], time: float | None, sizes: Array) -> Array:
    """Return how much the rates of the rows change over the size of the scene, shape (…, n_c).

    A turntable carries what rests on it: the slip there is a difference of speeds of this size, and rounds with it.
    """
    q, u = motion_at
    result: Array = abs(system.linearize_rows(q, u, 0.0 * u, time)[0]) @ sizes
    return result


def balanced_at(
    system: System,
    at: tuple[Array, Array, Array, Array],
    left: Array,
    force: Array,
    sizes: Array,
    scale: Array,
    time: float,
) -> bool:
    """Return whether scaled forces that should vanish do so, at q, u, a and ν.

    They may be a small part of the forces that balance. Where springs and inertia balance by
    themselves, they may have at least the effect of rounded coordinates and speeds.
    """
    scene, most = system.scene, float(np.max(np.abs(left), initial=0.0))
    gravity = float(np.linalg.norm(scene.gravity))
    weights = [math.sqrt(float(body.mass)) * gravity for body in scene.bodies]
    allowed = TOLERANCES.unbalance * max(float(np.max(np.abs(force * scale))), *weights)
    if most <= allowed:
        return True
    return most <= allowed + TOLERANCES.coordinate_rounding * force_change(system, at, sizes, scale, time)


def force_change(
    system: System, at: tuple[Array, Array, Array, Array], sizes: Array, scale: Array, time: float = 0.0
) -> float:
    """Return how much scaled forces change over the size of the scene, by their slope at q, u, a and ν.

    Near a singular point of a force its slope does not tell this: 0 is returned.
    """
    q, u, a, nu = at
    K, R, _ = system.linearize(q, u, a, nu, time)
    beside, _, _ = system.linearize(q + TOLERANCES.coordinate_rounding * sizes, u, a, nu, time)
    if largest(beside - K) > 0.01 * largest(K):
        return 0.0
    return float(np.max((abs(K) @ sizes + abs(R) @ np.abs(u)) * scale))
