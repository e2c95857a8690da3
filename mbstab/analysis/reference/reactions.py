"""What joints, contacts, drives and mounts transmit: forces in N and torques in N·m at the joint, not multipliers.

Rows with Jacobian J and multipliers ν act on the coordinates with −Jᵀν. On the three Euler
angles of a body that is Gᵀτ, with the torque τ about its reference point.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from mbstab.analysis.reference.rotation import orientation, rate_matrix
from mbstab.compiler.system import Array, System
from mbstab.mechanics.catalogue import GROUND, Marker
from mbstab.model.scene import ItemValues
from mbstab.records import dataclass


@dataclass(frozen=True)
class Reaction:
    """What an entry does to a body.

    Attributes
    ----------
    owner : str
        Such as ``joint 'pivot'``.
    body : str
        The body acted on: the first of the joint that is not the ground; of drive trains each, and the ground.
    point : ndarray, shape (…, 2) or (…, 3), or None
        Point of action, in ground axes (m); None: the point of contact.
    force : ndarray, shape (…, 2) or (…, 3)
        In ground axes (N).
    torque : ndarray, shape (…, 1) or (…, 3)
        About the point, in ground axes (N·m); empty where a point of contact or a point mass takes none.
    """

    owner: str
    body: str
    point: Array | None
    force: Array
    torque: Array


def reactions(system: System, q: Array, u: Array, J: Array, nu: Array) -> list[Reaction]:
    """Return what every entry transmits that has constraint rows or says that it transmits, in the order of the file.

    Parameters
    ----------
    q, u : ndarray, shape (…, n_q)
        Leading axes run over states, here and in the result.
    J : ndarray, shape (…, n_c, n_q)
    nu : ndarray, shape (…, n_c)
    """
    found: list[Reaction] = []
    transmitting = {item.entry.path for item in system.scene.items if item.kind.transmits}
    parts = {path: part for path, part in system.parts() if path in transmitting} if transmitting else {}
    for item in system.scene.items:
        rows = [i for i, row in enumerate(system.rows) if (row.section, row.name) == (item.entry.section, item.name)]
        if rows and item.entry.section != "states":
            load = -(nu[..., None, rows] @ J[..., rows, :])[..., 0, :]
            found += _reactions(system, q, item, load)
        elif item.entry.path in parts:
            # What is the same in all states comes once.
            found += _reactions(system, q, item, np.broadcast_to(-parts[item.entry.path].dynamics(q, u).F0, q.shape))
    return found


def components(found: Iterable[Reaction]) -> dict[tuple[str, str, str], Array]:
    """Return the components of reactions by owner, body acted on and component such as ``force x``."""
    loads: dict[tuple[str, str, str], Array] = {}
    for r in found:
        turning = "xyz" if r.torque.shape[-1] == 3 else "z"
        for what, letters, vector in (("force", "xyz", r.force), ("torque", turning, r.torque)):
            loads |= {(r.owner, r.body, f"{what} {x}"): v for x, v in zip(letters, vector.T, strict=False)}
    return loads


def _reactions(system: System, q: Array, item: ItemValues, load: Array) -> list[Reaction]:
    owner = item.entry.called
    markers = item.points_acted_on()
    if not markers:
        # Rows that name coordinates act at the reference points of their bodies.
        origin = (0.0,) * system.scene.dimension
        markers = [Marker(b, origin) for b, part in enumerate(system.body_slices) if np.any(load[..., part])][:1]
    touching = item.entry.section == "contacts" and item.given("center")
    places = {marker.body: marker for marker in reversed(markers)}
    ground = places.pop(GROUND, None)
    moving = [marker for marker in markers if places.get(marker.body) is marker]
    if len(markers) < 3:
        return [_wrench(system, q, owner, marker, load, touching) for marker in moving][:1]
    # What acts through several joints does something else to each body.
    found = [_wrench(system, q, owner, marker, load, touching) for marker in moving]
    return found if ground is None else [*found, _on_ground(owner, ground, found)]


def _on_ground(owner: str, marker: Marker, others: list[Reaction]) -> Reaction:
    """Return what is left for the ground: all forces of an entry are in balance."""
    point = np.array(marker.point, dtype=float)
    force: Any = -sum(x.force for x in others)
    torque: Any = -sum(x.torque + _moment(x.point - point, x.force) for x in others if x.point is not None)
    return Reaction(owner, "ground", np.broadcast_to(point, force.shape), force, torque)


def _moment(arm: Array, force: Array) -> Array:
    """Return arm × force, in one component in the plane."""
    if arm.shape[-1] == 3:
        return np.cross(arm, force)
    return np.asarray(arm[..., :1] * force[..., 1:] - arm[..., 1:] * force[..., :1])


def _wrench(system: System, q: Array, owner: str, marker: Marker, load: Array, touching: bool) -> Reaction:
    body, part, d = system.scene.bodies[marker.body], system.body_slices[marker.body], system.scene.dimension
    place, angles = slice(part.start, part.start + d), slice(part.start + d, part.stop)
    force = load[..., place]
    arm: Any = np.zeros(d)
    torque: Any = load[..., angles]
    if body.orientation and d == 3:
        arm = orientation(body, q[..., angles]) @ np.array(marker.point, dtype=float)
        rates = rate_matrix(body, q[..., angles])
        torque = np.linalg.solve(np.swapaxes(rates, -1, -2), torque[..., None])[..., 0] - _moment(arm, force)
    elif body.orientation:
        turn = q[..., angles.start]
        (c, s), (x, y) = (np.cos(turn), np.sin(turn)), (float(x) for x in marker.point)
        arm = np.stack([c * x - s * y, s * x + c * y], axis=-1)
        torque = torque - _moment(arm, force)
    if touching:
        return Reaction(owner, body.name, None, force, np.zeros(0))
    return Reaction(owner, body.name, q[..., place] + arm, force, torque)
