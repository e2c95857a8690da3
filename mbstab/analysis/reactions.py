"""What joints, contacts and drives transmit: forces in N and torques in N·m at the joint, not multipliers.

Rows with Jacobian J and multipliers ν act on the coordinates with −Jᵀν. On the three Euler
angles of a body that is Gᵀτ, with the torque τ about its reference point.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from mbstab.analysis.motion import Motion
from mbstab.analysis.rotation import orientation, rate_matrix
from mbstab.compiler.system import Array, System
from mbstab.mechanics.catalogue import GROUND, Marker
from mbstab.model.values import ItemValues


@dataclass(frozen=True)
class Reaction:
    """What an entry does to a body.

    Attributes
    ----------
    owner : str
        Such as ``joint 'pivot'``.
    body : str
        The body acted on: the first of the joint that is not the ground.
    point : ndarray, shape (2,) or (3,), or None
        Where, in ground axes (m); None: at the point of contact.
    force : ndarray, shape (2,) or (3,)
        In ground axes (N).
    torque : ndarray, shape (1,) or (3,)
        About the point, in ground axes (N·m); empty where a point of contact or a point mass takes none.
    """

    owner: str
    body: str
    point: Array | None
    force: Array
    torque: Array


def reactions(system: System, motion: Motion) -> list[Reaction]:
    """Return the reactions of every entry that has constraint rows, in the order of the file."""
    found: list[Reaction] = []
    for item in system.scene.items:
        rows = [i for i, row in enumerate(system.rows) if (row.section, row.name) == (item.entry.section, item.name)]
        if rows:
            load = -(motion.dynamics.J[rows].T @ motion.nu[rows])
            found += _reactions(system, motion, item, load)
    return found


def _reactions(system: System, motion: Motion, item: ItemValues, load: Array) -> list[Reaction]:
    owner = f"{item.entry.section.removesuffix('s')} {item.name!r}"
    markers = _markers(item)
    if not markers:
        # Rows of coordinates act at the reference points of the bodies they name.
        origin = (0.0,) * system.scene.dimension
        markers = [Marker(b, origin) for b, part in enumerate(system.body_slices) if np.any(load[part])][:1]
    touching = item.entry.section == "contacts" and item.given("center")
    return [_wrench(system, motion, owner, marker, load, touching) for marker in markers if marker.body != GROUND][:1]


def _markers(item: ItemValues) -> list[Marker]:
    """Return the points of a body at which an entry acts."""
    for field in item.kind.fields:
        if not item.given(field.name):
            continue
        if field.shape == "markers":
            return list(item.markers(field.name))
        if field.shape == "marker":
            return [item.marker(field.name)]
        if field.shape == "joint":
            return _markers(item.joint(field.name))
    return []


def _wrench(system: System, motion: Motion, owner: str, marker: Marker, load: Array, touching: bool) -> Reaction:
    body, part, d = system.scene.bodies[marker.body], system.body_slices[marker.body], system.scene.dimension
    place, angles = slice(part.start, part.start + d), slice(part.start + d, part.stop)
    force = load[place]
    arm: Any = np.zeros(d)
    torque: Any = load[angles]
    if body.orientation and d == 3:
        arm = orientation(body, motion.q[angles]) @ np.array(marker.point, dtype=float)
        (x, y, z), (f, g, h) = arm.tolist(), force.tolist()
        moment = np.array([y * h - z * g, z * f - x * h, x * g - y * f])
        torque = np.linalg.solve(rate_matrix(body, motion.q[angles]).T, torque) - moment
    elif body.orientation:
        (c, s), (x, y) = (np.cos(motion.q[angles][0]), np.sin(motion.q[angles][0])), marker.point
        arm = np.array([c * x - s * y, s * x + c * y], dtype=float)
        torque = torque - (arm[0] * force[1] - arm[1] * force[0])
    if touching:
        return Reaction(owner, body.name, None, force, np.zeros(0))
    return Reaction(owner, body.name, motion.q[place] + arm, force, torque)
