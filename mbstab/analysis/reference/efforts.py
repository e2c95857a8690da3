"""Motions of joints, and the forces and torques of all entries that act along one motion."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from mbstab.analysis.reference.attitude import Attitudes
from mbstab.compiler.measured import values
from mbstab.compiler.system import Array, System
from mbstab.mechanics.catalogue import GROUND, Effort, Item, Marker
from mbstab.model.arithmetic import array_arithmetic
from mbstab.model.expressions import Expression
from mbstab.model.measures import unit_of_effort
from mbstab.model.scene import ItemValues, Scene
from mbstab.records import dataclass


@dataclass(frozen=True)
class Acted:
    """What an entry does along a motion.

    Attributes
    ----------
    owner : str
        Such as ``force 'spring'``.
    along : str
        The relative motion it acts on, such as ``angle of 'shoulder'``.
    unit : str
        ``N`` or ``N*m``.
    values : ndarray, shape (…)
        Positive in the direction of the motion: pushes the ends of a spring apart, turns or moves the first body of a
        joint against the second.
    """

    owner: str
    along: str
    unit: str
    values: Array


@dataclass(frozen=True)
class Placement:
    """Where the points of a scene are, and how they move.

    Attributes
    ----------
    q, u : ndarray, shape (…, n_q)
        In the chart of `system`; leading axes run over states.
    """

    attitudes: Attitudes
    system: System
    q: Array
    u: Array

    @cached_property
    def turns(self) -> Array:
        """From body axes to ground axes, shape (…, n_b, d, d)."""
        return self.attitudes.orientations(self.system, self.q)

    @cached_property
    def spins(self) -> Array:
        """Angular velocities, shape (…, n_b, 3) (rad/s)."""
        return self.attitudes.spins(self.system, self.q, self.u)

    def motion(self, kind: str, item: Item, near: float = 0.0) -> Array:
        """Return the ``distance``, ``angle`` or ``displacement`` of the points of an entry, shape (…) (m, rad).

        In space angles are those within half a turn of `near` (rad).
        """
        # What does not move is the same in all states.
        return np.array(np.broadcast_to(self._motion(kind, item, near), self.q.shape[:-1]))

    def rate(self, kind: str, item: Item) -> Array:
        """Return the rate of such a motion, shape (…) (m/s, rad/s)."""
        return np.array(np.broadcast_to(self._rate(kind, item), self.q.shape[:-1]))

    def _motion(self, kind: str, item: Item, near: float) -> Any:
        first, second = item.markers("between")
        if kind == "angle" and self.system.scene.dimension == 2:
            return self._angle(self.q, first) - self._angle(self.q, second)
        if kind == "angle":
            one, two = item.triads("axis", "zero")
            zero = self._direction(first, one.v2)
            cosine, sine = (np.sum(zero * self._direction(second, v), axis=-1) for v in (two.v2, two.v3))
            c, s = np.cos(near), np.sin(near)
            return near + np.arctan2(sine * c - cosine * s, cosine * c + sine * s)
        gap = self.place(first) - self.place(second)
        if kind == "distance":
            return np.linalg.norm(gap, axis=-1)
        return np.sum(self._direction(second, item.triads("axis", "zero")[1].v1) * gap, axis=-1)

    def _rate(self, kind: str, item: Item) -> Any:
        first, second = item.markers("between")
        if kind == "angle" and self.system.scene.dimension == 2:
            return self._angle(self.u, first) - self._angle(self.u, second)
        if kind == "angle":
            spin = self._spin(first) - self._spin(second)
            return np.sum(self._direction(second, item.triads("axis", "zero")[1].v1) * spin, axis=-1)
        gap, speed = self.place(first) - self.place(second), self._velocity(first) - self._velocity(second)
        if kind == "distance":
            size = np.linalg.norm(gap, axis=-1)
            along = gap / np.where(size > 0.0, size, 1.0)[..., None]
            # Where the ends meet, the distance grows at the speed at which they part.
            return np.where(size > 0.0, np.sum(along * speed, axis=-1), np.linalg.norm(speed, axis=-1))
        axis = self._direction(second, item.triads("axis", "zero")[1].v1)
        return np.sum(axis * speed + _across(self._spin(second), axis) * gap, axis=-1)

    def value(self, expression: Expression, times: Any) -> Any:
        """Return an expression of parameters, coordinates, measures, rates and the time, shape (…)."""
        found = {**self.system.scene.parameters, **self._names, "t": times}
        rates = {name: found[f"rate({name})"] for name in expression.rates()}
        return expression.evaluate(found, array_arithmetic(), rates)

    @cached_property
    def _names(self) -> dict[str, Any]:
        """Coordinates and measures by name, and under ``rate(…)`` their rates."""
        found = values(self.system.scene, self.system.names, self.q, self.u)
        for i, name in enumerate(self.system.names):
            found[name], found[f"rate({name})"] = self.q[..., i], self.u[..., i]
        return found

    def _angle(self, x: Array, marker: Marker) -> Any:
        """Return the angle of a planar body in coordinates, or its rate in speeds."""
        if marker.body == GROUND or not self.system.scene.bodies[marker.body].orientation:
            return np.zeros(x.shape[:-1])
        return x[..., self.system.body_slices[marker.body].start + 2]

    def _direction(self, marker: Marker, vector: Any) -> Array:
        fixed = np.array(vector[: self.system.scene.dimension], dtype=float)
        return fixed if marker.body == GROUND else np.asarray(self.turns[..., marker.body, :, :] @ fixed)

    def place(self, marker: Marker) -> Array:
        """Return where a point of a body or of the ground is (m), shape (…, dimension)."""
        point = self._direction(marker, marker.point)
        return point if marker.body == GROUND else self._own(self.q, marker) + point

    def _velocity(self, marker: Marker) -> Array:
        if marker.body == GROUND:
            return np.zeros(self.system.scene.dimension)
        return self._own(self.u, marker) + _across(self._spin(marker), self._direction(marker, marker.point))

    def _spin(self, marker: Marker) -> Array:
        return np.zeros(3) if marker.body == GROUND else np.asarray(self.spins[..., marker.body, :])

    def _own(self, x: Array, marker: Marker) -> Array:
        start = self.system.body_slices[marker.body].start
        return np.asarray(x[..., start : start + self.system.scene.dimension])


def _across(spin: Array, arm: Array) -> Array:
    """Return spin × arm, in as many components as the arm has."""
    if arm.shape[-1] == 3:
        return np.cross(spin, arm)
    return np.asarray(spin[..., 2:] * np.stack([-arm[..., 1], arm[..., 0]], axis=-1))


MOTION_UNITS = {"angle": "rad", "displacement": "m"}
"""Of the motions of joints."""


def moving_joints(scene: Scene) -> list[tuple[str, ItemValues]]:
    """Return the joints that can move, once for each of their motions, in the order of the file."""
    joints = (item for item in scene.items if item.entry.section == "joints")
    return [(motion, item) for item in joints for motion in item.kind.motions]


def motion_name(motion: str, joint: str) -> str:
    """Return what a motion of a joint is called, such as ``angle(pivot)``."""
    return f"{motion}({joint})"


def unwound(angles: Array, rates: Array, times: Array) -> Array:
    """Return angles at successive times, shape (n_t,), unwrapped according to their rates (rad)."""
    steps = 0.5 * (rates[1:] + rates[:-1]) * np.diff(times)
    turns = np.round((steps - np.diff(angles)) / (2.0 * np.pi))
    return angles + 2.0 * np.pi * np.concatenate([[0.0], np.cumsum(turns)])


def efforts(at: Placement, nu: Array, times: Any) -> list[Acted]:
    """Return the efforts of all entries that act along one motion, in the order of the file.

    Parameters
    ----------
    nu : ndarray, shape (…, n_c)
        Multipliers.
    times : number or ndarray, shape (…)
        Of the states (s).
    """
    found = []
    for item in at.system.scene.items:
        if not item.entry.has_effort:
            continue
        if item.kind.effort is None:
            assert item.entry.load is not None
            along, expression = item.entry.load
            size, where = at.value(expression, times), in_words(along)
        else:
            effort = item.kind.effort(item)
            size = _of_row(at, item, effort, nu, times) if effort.driven else _of_law(at, effort, times)
            where = _along(item.entry.values, effort)
        unit = unit_of_effort(at.system.scene.model, item.entry)
        found.append(Acted(item.entry.called, where, unit, np.array(np.broadcast_to(size, at.q.shape[:-1]))))
    return found


def in_words(measure: str) -> str:
    """Return a motion in words: ``angle of 'pivot'`` of ``angle(pivot)``; a coordinate as it is."""
    kind, _, name = measure.removesuffix(")").partition("(")
    return f"{kind} of {name!r}" if kind in MOTION_UNITS else measure


def _along(given: Mapping[str, Any], effort: Effort) -> str:
    """Return a motion in words."""
    if effort.motion == "coordinate":
        return str(given["coordinate"])
    if effort.motion == "point":
        return f"place of {given['at'].body!r}"
    if effort.motion == "distance":
        return "distance of its ends"
    return in_words(motion_name(effort.motion, effort.of.name))


def _of_law(at: Placement, effort: Effort, times: Any) -> Any:
    """Return the effort of a spring, a damper or an actuator."""
    if effort.law is not None:
        return replace(effort.law, arithmetic=array_arithmetic()).at(times).value
    rest = float(effort.rest)
    stretch = at.motion(effort.motion, effort.of, rest) - rest
    return -float(effort.stiffness) * stretch - float(effort.damping) * at.rate(effort.motion, effort.of)


def _of_row(at: Placement, item: ItemValues, effort: Effort, nu: Array, times: Any) -> Any:
    """Return the effort of a drive, from the multiplier of its row."""
    own = (item.entry.section, item.name)
    row = next(i for i, row in enumerate(at.system.rows) if (row.section, row.name) == own)
    if effort.motion != "angle" or effort.law is None or at.system.scene.dimension == 2:
        return -nu[..., row]
    # The residual of the row is the sine of the error of the angle.
    given = replace(effort.law, arithmetic=array_arithmetic()).at(times).value
    return -nu[..., row] * np.cos(at.motion("angle", effort.of) - given)
