"""Bodies that tumble: Euler angles whose constant base rotation is replaced near their singularity.

The angles of a spatial body, A = B Ax(φ) Ay(θ) Az(ψ), are singular where cos θ = 0. Nothing
in the equations of motion depends on the base rotation B, so near it the motion continues with
another B′, whose angles give the same A and whose rates give the same ω. The first axis of B′ is that of the present
rotation, about which φ may turn any number of times, unless it lies along the last body axis, about
which ψ may. The user sees the angles of the file.

Where an expression, a constraint or a drive names an angle of a body, its angles have a
meaning: such a body keeps its chart, and a motion that needs another one is refused.

Angles of joints in expressions are known within half a turn of where they count (`mbstab.model.turned`). Like the base
rotations, these half turns are replaced by those next to the motion, so that angles go on over any number of turns.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from mbstab.analysis.reference.rotation import UP, euler_angles, orientation, rate_drift, rate_matrix
from mbstab.analysis.reference.tolerances import TOLERANCES
from mbstab.compiler.measured import recounted
from mbstab.compiler.system import Array, System
from mbstab.errors import NumericalError
from mbstab.model.charts import named_by
from mbstab.model.scene import BodyValues, Scene
from mbstab.model.turned import counts_turns
from mbstab.records import dataclass


@dataclass(frozen=True)
class Attitudes:
    """Which bodies of a scene turn in space, and which of them must keep their angles.

    Attributes
    ----------
    file : System
        The scene with the base rotations of the file.
    parts : tuple of (int, slice)
        Body number and its three angles, for every body with Euler angles.
    pinned : dict
        By body number, what names its angles, such as ``drive 'spin'``.
    counted : bool
        Whether an expression counts the turns of a joint in space.
    """

    file: System
    parts: tuple[tuple[int, slice], ...]
    pinned: dict[int, str]
    counted: bool

    @classmethod
    def of(cls, system: System) -> Attitudes:
        """Find the bodies of a scene that turn in space."""
        scene = system.scene
        parts = tuple(
            (i, slice(part.start + 3, part.stop))
            for i, (body, part) in enumerate(zip(scene.bodies, system.body_slices, strict=True))
            if scene.dimension == 3 and body.orientation
        )
        owner = {system.names[k]: i for i, part in parts for k in range(part.start, part.stop)}
        pinned: dict[int, str] = {}
        for name, what in named_by(item.entry for item in scene.items).items() if owner else ():
            if name in owner:
                pinned.setdefault(owner[name], what)
        counted = scene.dimension == 3 and any(
            x.kind == "angle" and counts_turns(name, scene.written) for name, x in scene.measures.items()
        )
        return cls(system, parts, pinned, counted)

    def needs_change(self, system: System, before: Array, q: Array) -> bool:
        """Return whether a body needs another chart, or an angle another half turn from which it counts.

        Raises
        ------
        NumericalError
            If a body that must keep its angles needs one.
        """
        change = self.counted and bool(recounted(system.scene, system.names, q, TOLERANCES.turned_from_count))
        for i, part in self.parts:
            cosine = math.cos(q[part.start + 1])
            if i not in self.pinned:
                change = change or abs(cosine) < TOLERANCES.euler_cosine_chart_left
            elif abs(cosine) < TOLERANCES.euler_cosine_pinned or cosine * math.cos(before[part.start + 1]) < 0.0:
                name = system.scene.bodies[i].name
                raise NumericalError(
                    f"theta of {name!r} comes to ±pi/2, where its Euler angles are singular (|cos theta| = "
                    f"{abs(cosine):.1e} after a step), and {self.pinned[i]} names one of them, so that they cannot be "
                    f"replaced by others\nhint: give {name!r} another base rotation with axes: [phi, theta, psi], or "
                    "drive a joint instead of the coordinate"
                )
        return change

    def changed(self, system: System, q: Array, u: Array) -> tuple[System, Array, Array]:
        """Return the scene with other base rotations, and the same state in its angles."""
        bodies, q, u = list(system.scene.bodies), q.copy(), u.copy()
        for i, part in self.parts:
            if i in self.pinned or abs(math.cos(q[part.start + 1])) >= TOLERANCES.euler_cosine_chart_left:
                continue
            body = bodies[i]
            A, spin = orientation(body, q[part]), rate_matrix(body, q[part]) @ u[part]
            bodies[i] = replace(body, base=tuple(_base(A, spin).ravel().tolist()))
            q[part] = euler_angles(bodies[i], A, np.zeros(3))
            u[part] = np.linalg.solve(rate_matrix(bodies[i], q[part]), spin)
        scene = replace(system.scene, bodies=tuple(bodies))
        if self.counted:
            again = recounted(scene, system.names, q, TOLERANCES.turned_from_count)
            scene = replace(scene, measures={**scene.measures, **again})
        if scene.bodies != self.file.scene.bodies:
            return System(scene), q, u
        # Motions to and fro come back to the same half turns.
        known: dict[Any, System] = self.file.remember(
            "counted", None, lambda: {self._counts(self.file.scene): self.file}
        )
        key = self._counts(scene)
        if key not in known:
            if len(known) == TOLERANCES.counts_kept:
                known.clear()
            known[key] = System(scene)
        return known[key], q, u

    @staticmethod
    def _counts(scene: Scene) -> tuple[Any, ...]:
        """Return from where the angles in space count."""
        return tuple(x.numbers[-1] for x in scene.measures.values() if x.kind == "angle" and len(x.numbers))

    def orientations(self, system: System, q: Array) -> Array:
        """Return the orientation of every body, shape (…, n_b, d, d); the identity for point masses.

        Here and below q and u have the shape (…, n_q); leading axes run over states.
        """
        scene = system.scene
        found = np.tile(np.eye(scene.dimension), (*q.shape[:-1], len(scene.bodies), 1, 1))
        if scene.dimension == 3:
            for i, part in self.parts:
                found[..., i, :, :] = orientation(scene.bodies[i], q[..., part])
        else:
            for i, (body, own) in enumerate(zip(scene.bodies, system.body_slices, strict=True)):
                if body.orientation:
                    c, s = np.cos(q[..., own.start + 2]), np.sin(q[..., own.start + 2])
                    found[..., i, 0, 0], found[..., i, 0, 1] = c, -s
                    found[..., i, 1, 0], found[..., i, 1, 1] = s, c
        return found

    def turning(self, system: System, q: Array, body: int) -> tuple[slice, Array]:
        """Return where the angles of a body stand, and G from their rates to its angular velocity in ground axes.

        Returns
        -------
        angles : slice
        G : ndarray, shape (…, 3, number of angles)
            In the plane it turns about z.
        """
        own = system.body_slices[body]
        angles = slice(own.start + system.scene.dimension, own.stop)
        if system.scene.dimension == 3:
            return angles, rate_matrix(system.scene.bodies[body], q[..., angles])
        return angles, UP[:, None]

    def spins(self, system: System, q: Array, u: Array) -> Array:
        """Return the angular velocity of every body in ground axes, shape (…, n_b, 3) (rad/s)."""
        found = np.zeros((*q.shape[:-1], len(system.scene.bodies), 3))
        for i, body in enumerate(system.scene.bodies):
            if body.orientation:
                angles, G = self.turning(system, q, i)
                found[..., i, :] = _times(G, u[..., angles])
        return found

    def coordinates_in_file(self, system: System, q: Array, near: Array) -> Array:
        """Return coordinates in the angles of the file; of all equivalent ones those nearest to `near` (n_q,)."""
        if system is self.file:
            return q
        q = q.copy()
        for i, part in self.parts:
            body, own = system.scene.bodies[i], self.file.scene.bodies[i]
            if body.base != own.base:
                q[part] = _nearest(own, orientation(body, q[part]), near[part])
        return q

    def in_file(self, system: System, q: Array, u: Array, a: Array, shown: Array) -> tuple[Array, Array, Array]:
        """Return a state in the angles of the file, in which its coordinates are `shown`; shapes (…, n_q)."""
        if system is self.file:
            return q, u, a
        q, u, a = q.copy(), u.copy(), a.copy()
        for i, part in ((i, (..., part)) for i, part in self.parts):
            body, own = system.scene.bodies[i], self.file.scene.bodies[i]
            if body.base == own.base:
                continue
            G = rate_matrix(body, q[part])
            spin = _times(G, u[part])
            turning = _times(G, a[part]) + rate_drift(body, q[part], u[part])
            q[part] = shown[part]
            # Exactly at the singularity the rates do not exist; those of least norm are as good as any.
            back: Any = np.linalg.pinv(rate_matrix(own, q[part]), rcond=1e-14)
            u[part] = _times(back, spin)
            a[part] = _times(back, turning - rate_drift(own, q[part], u[part]))
        return q, u, a


def _times(matrix: Array, vector: Array) -> Array:
    """Return products of matrices (…, 3, k) and vectors (…, k)."""
    return np.asarray((matrix @ vector[..., None])[..., 0])


def _base(A: Array, spin: Array) -> Array:
    """Return the base rotation whose first axis is that of the rotation, or perpendicular to the last body axis."""
    last = A[:, 2]
    rate = float(np.linalg.norm(spin))
    first = spin / rate if rate > 0.0 else A[:, 0]
    if abs(first @ last) > 0.7:
        first = A[:, 0]
    second = np.cross(last, first)
    second /= np.linalg.norm(second)
    return np.stack([first, second, np.cross(first, second)], axis=1)


def _nearest(body: BodyValues, A: Array, near: Array) -> Array:
    """Return the angles of a rotation closest to given ones, on either side of θ = ±π/2."""
    both = [euler_angles(body, A, near), euler_angles(body, A, np.array([near[0], math.pi - near[1], near[2]]))]
    turn = 2.0 * math.pi
    both = [x + turn * np.round((near - x) / turn) for x in both]
    return min(both, key=lambda x: float(np.max(np.abs(x - near))))
