"""Orientation of bodies in numbers: rotations, Euler angles and their rates.

With A = B Ax(φ) Ay(θ) Az(ψ) the angular velocity in ground axes is ω = G(φ, θ) [φ̇, θ̇, ψ̇]; it does not contain ψ.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np

from mbstab.compiler.system import Array
from mbstab.model.arithmetic import FLOAT, array_arithmetic
from mbstab.model.charts import euler_matrix
from mbstab.model.duals import dual_arithmetic
from mbstab.model.jets import Jet, jet_arithmetic
from mbstab.model.scene import BodyValues

UP = np.array([0.0, 0.0, 1.0])
"""Axis of rotations in the plane."""


def cross_matrix(axis: Array) -> Array:
    """Return the matrix of the cross product with an axis, shape (3, 3)."""
    return np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])


def rotation_matrix(axis: Array, angle: float) -> Array:
    """Return the rotation about a unit axis by an angle (rad)."""
    cross = cross_matrix(axis)
    result: Array = np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * cross @ cross
    return result


def base_rotation(body: BodyValues) -> Array:
    """Return B, shape (3, 3); nobody must change it."""
    if all(x.__class__ is float for x in body.base):
        return _of_floats(body.base)
    # Numbers with more digits keep them.
    kind = float if all(isinstance(x, (int, float)) for x in body.base) else object
    return np.array(body.base, dtype=kind).reshape(3, 3)


@lru_cache(maxsize=256)
def _of_floats(base: tuple[float, ...]) -> Array:
    result = np.array(base).reshape(3, 3)
    result.flags.writeable = False
    return result


def _functions(angles: Array) -> Any:
    """Return cos, sin and tan for single angles, for the points of a sweep, or for refined numbers or balls."""
    if angles.dtype == object:
        from mbstab.model.balls import ball_arithmetic

        if any(isinstance(x, Jet) for x in angles.flat):
            return jet_arithmetic(_functions(np.array([Jet.of(x).value for x in angles.flat], dtype=object)))
        if any(hasattr(x, "rad") for x in angles.flat):
            return ball_arithmetic()
        return dual_arithmetic(FLOAT)
    return math if angles.ndim == 1 else np


def _numbers(x: Array) -> list[Any]:
    """Return the last axis as a list: of Python floats for a single point, which are several times faster."""
    return x.tolist() if x.ndim == 1 else [x[..., k] for k in range(x.shape[-1])]


def _array(rows: list[list[Any]], angles: Array) -> Array:
    """Return an array of rows of numbers, with leading axes where the numbers are those of several points."""
    if angles.ndim == 1:
        return np.array(rows)
    found = np.empty((*angles.shape[:-1], len(rows), len(rows[0])), dtype=angles.dtype)
    for i, row in enumerate(rows):
        for j, x in enumerate(row):
            found[..., i, j] = x
    return found


def orientation(body: BodyValues, angles: Array) -> Array:
    """Return A, shape (…, 3, 3), for angles of shape (…, 3)."""
    f = FLOAT if angles.ndim == 1 else array_arithmetic()
    entries = euler_matrix(tuple(_numbers(angles)), f)
    result: Array = base_rotation(body) @ _array([list(entries[i : i + 3]) for i in (0, 3, 6)], angles)
    return result


def euler_angles(body: BodyValues, rotation: Array, near: Array) -> Array:
    """Return the angles of a rotation; of all equivalent ones those closest to `near`."""
    inner = (base_rotation(body).T @ rotation).tolist()
    theta = math.asin(max(-1.0, min(1.0, inner[0][2])))
    phi, psi = math.atan2(-inner[1][2], inner[2][2]), math.atan2(-inner[0][1], inner[0][0])
    if math.cos(near[1]) < 0.0:
        phi, theta, psi = phi + math.pi, math.pi - theta, psi + math.pi
    angles = np.array([phi, theta, psi])
    result: Array = angles + 2.0 * math.pi * np.round((near - angles) / (2.0 * math.pi))
    return result


def rate_matrix(body: BodyValues, angles: Array) -> Array:
    """Return G, shape (…, 3, 3), the matrix from Euler rates to the angular velocity in ground axes."""
    f = _functions(angles)
    (c1, s1), (c2, s2) = ((f.cos(x), f.sin(x)) for x in _numbers(angles)[:2])
    result: Array = base_rotation(body) @ _array([[1.0, 0.0, s2], [0.0, c1, -s1 * c2], [0.0, s1, c1 * c2]], angles)
    return result


def turning_rates(body: BodyValues, angles: Array, axis: Array) -> tuple[Array, Array, Array]:
    """Return the Euler rates of a body under a rotation of the ground about an axis at 1 rad/s.

    Parameters
    ----------
    angles : ndarray, shape (…, 3)
        Leading axes run over the points of a sweep.

    Returns
    -------
    X : ndarray, shape (…, 3)
        Euler rates, G⁻¹ axis.
    slope : ndarray, shape (…, 3, 3)
        ∂X/∂(angles).
    growth : ndarray, shape (…, 3, 3)
        Derivative of the slope along X.
    """
    w1, w2, w3 = (base_rotation(body).T @ axis).tolist()
    f = _functions(angles)
    phi, theta, _ = _numbers(angles)
    c1, s1, t2, sec = f.cos(phi), f.sin(phi), f.tan(theta), 1.0 / f.cos(theta)
    x, y = c1 * w2 + s1 * w3, c1 * w3 - s1 * w2
    p, s = w1 - t2 * y, sec * y
    # Along X: ẋ = y φ̇, ẏ = −x φ̇, d(tan θ)/dt = θ̇/cos²θ, d(1/cos θ)/dt = θ̇ tan θ/cos θ.
    x_t, y_t, t_t, sec_t = y * p, -x * p, sec * sec * x, sec * t2 * x
    slope = [[t2 * x, -sec * sec * y, 0.0], [y, 0.0, 0.0], [-sec * x, sec * t2 * y, 0.0]]
    growth = [
        [t_t * x + t2 * x_t, -2.0 * sec * sec_t * y - sec * sec * y_t, 0.0],
        [y_t, 0.0, 0.0],
        [-sec_t * x - sec * x_t, (sec_t * t2 + sec * t_t) * y + sec * t2 * y_t, 0.0],
    ]
    return _array([[p, x, s]], angles)[..., 0, :], _array(slope, angles), _array(growth, angles)


def rate_drift(body: BodyValues, angles: Array, rates: Array) -> Array:
    """Return Ġ times the Euler rates, shape (…, 3): the angular acceleration at zero Euler accelerations."""
    f = _functions(angles)
    (c1, s1), (c2, s2) = ((f.cos(x), f.sin(x)) for x in _numbers(angles)[:2])
    p, t, s = _numbers(rates)
    drift = _array(
        [[t * s * c2, -p * t * s1 - p * s * c1 * c2 + t * s * s1 * s2, p * t * c1 - p * s * s1 * c2 - t * s * c1 * s2]],
        angles,
    )[..., 0, :]
    result: Array = drift @ base_rotation(body).T
    return result


def lever(body: BodyValues, angles: Array) -> tuple[Array, Array]:
    """Return the vector from the reference point of a body to its centre of mass (m), and its derivative.

    Parameters
    ----------
    angles : ndarray, shape (0,) for a point mass, (1,) for a planar body, (3,) for a body in space

    Returns
    -------
    arm : ndarray, shape (3,)
    slope : ndarray, shape (3, number of angles)
        Derivative by the angles.
    """
    center = np.zeros(3)
    center[: len(body.center)] = [float(x) for x in body.center]
    if len(angles) == 3:
        arm = orientation(body, angles) @ center
        return arm, -cross_matrix(arm) @ rate_matrix(body, angles)
    if len(angles) == 1:
        arm = rotation_matrix(UP, float(angles[0])) @ center
        return arm, np.cross(UP, arm)[:, None]
    return np.zeros(3), np.zeros((3, 0))


def lever_acceleration(body: BodyValues, angles: Array, rates: Array, accelerations: Array) -> Array:
    """Return the acceleration of the centre of mass of a body relative to its reference point, shape (3,) (m/s²)."""
    arm, slope = lever(body, angles)
    spin = rates[0] * UP if len(angles) == 1 else rate_matrix(body, angles) @ rates
    result: Array = slope @ accelerations + np.cross(spin, np.cross(spin, arm))
    return result + np.cross(rate_drift(body, angles, rates), arm) if len(angles) == 3 else result
