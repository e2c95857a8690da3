"""The drawing of a mechanism: outlines of bodies in their own frames, lines between joints, pins, springs, ground.

All is in three dimensions; planar scenes lie in z = 0. The `Look` of an entry of a model defines its drawing.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np

from mbstab.compiler.system import Array, System
from mbstab.errors import UsageError, alternatives
from mbstab.mechanics.catalogue import GROUND, Look, Marker
from mbstab.mechanics.vectors import triad
from mbstab.model.arithmetic import FLOAT
from mbstab.model.schema import Components, Entry, ShapeValue
from mbstab.records import dataclass
from mbstab.report.animation.outlines import BLADE, THICK, Outline, line, outline_of

CROSS = 0.1
"""Half length of the axes of a body drawn without shape, as a fraction of the size of the scene."""


@dataclass(frozen=True)
class Piece:
    """An outline fixed in a body, in the frame of the body."""

    body: int
    outline: Outline


@dataclass(frozen=True)
class Link:
    """A line between points of two bodies, straight or as a ``spring``."""

    first: Marker
    second: Marker
    spring: bool


@dataclass(frozen=True)
class Pin:
    """The place of a joint: a point of a body, whether its bodies slide there, whether one of them is the ground."""

    place: Marker
    slides: bool
    grounded: bool


@dataclass(frozen=True)
class Plane:
    """A line or plane on which something rolls: unit normal and a point, shape (3,)."""

    normal: Array
    origin: Array

    def same(self, other: Plane) -> bool:
        """Whether another one has the same points."""
        height = abs(float((other.origin - self.origin) @ self.normal))
        return np.allclose(other.normal, self.normal) and height < 1e-12


@dataclass(frozen=True)
class Sketch:
    """The drawing of a scene.

    Attributes
    ----------
    dimension : int
    bodies : tuple of str
    pieces, links, pins, planes : list
    masses : list of int
        Bodies that are points.
    centers : list of Marker
        Centres of mass of bodies that are drawn as lines.
    up : ndarray, shape (3,)
        Against gravity; z in space, y in the plane without it.
    weighted : bool
        Whether there is gravity.
    points : dict
        Markers by name, such as ``rod``, ``rod.tip``.
    """

    dimension: int
    bodies: tuple[str, ...]
    pieces: list[Piece]
    links: list[Link]
    pins: list[Pin]
    planes: list[Plane]
    masses: list[int]
    centers: list[Marker]
    up: Array
    weighted: bool
    points: dict[str, Marker]

    @classmethod
    def of(cls, system: System) -> Sketch:
        """Return the drawing of a scene with numerical values."""
        scene = system.scene
        gravity = _spatial(scene.gravity)
        weighted = bool(np.any(gravity))
        up = -gravity / np.linalg.norm(gravity) if weighted else np.eye(3)[scene.dimension - 1]
        names = tuple(body.name for body in scene.bodies)
        sketch = cls(scene.dimension, names, [], [], [], [], [], [], up, weighted, _points(system))
        size = max(scene.lengths, default=0.0) or 1.0
        looks = [look for item in scene.items if item.kind.look is not None for look in item.kind.look(item)]
        for look in looks:
            if look.sign != "blade":
                sketch._add(look, size)
        shaped = {look.points[0].body for look in looks if look.form is not None}
        held: dict[int, list[Array]] = {b: [] for b in range(len(scene.bodies))}
        for marker in (m for item in scene.items for m in item.points() if m.body != GROUND):
            held[marker.body].append(_spatial(marker.point))
        for b, entry in enumerate(scene.model.bodies.values()):
            if scene.bodies[b].orientation:
                sketch._add_body(system, b, entry, held[b], b in shaped, size)
            else:
                sketch.masses.append(b)
        for look in looks:
            if look.sign == "blade":  # over the bodies, which would hide it in the plane
                sketch._add(look, size)
        return sketch

    def _add(self, look: Look, size: float) -> None:
        """Add an entry of a scene of that size (m)."""
        match look.sign:
            case "pin" | "slider":
                grounded = any(m.body == GROUND for m in look.points)
                place = next(m for m in look.points if m.body != GROUND)
                self.pins.append(Pin(place, look.sign == "slider", grounded))
            case "rod":
                self.pins.extend(Pin(m, False, m.body == GROUND) for m in look.points)
                self.links.append(Link(look.points[0], look.points[1], False))
            case "line" | "spring":
                self.links.append(Link(look.points[0], look.points[1], look.sign == "spring"))
            case "blade":
                middle, half = _spatial(look.points[0].point), CROSS * size * _spatial(look.axis)
                blade = Outline((line(middle - half, middle + half),), width=BLADE)
                self.pieces.append(Piece(look.points[0].body, blade))
            case "body":
                self.pieces.append(Piece(look.points[0].body, _placed_form(look)))
        if look.surface is not None:
            plane = Plane(*(_spatial(v) for v in look.surface))
            if not any(plane.same(other) for other in self.planes):
                self.planes.append(plane)

    def _add_body(self, system: System, b: int, entry: Entry, places: list[Array], shaped: bool, size: float) -> None:
        """Add a body: its shapes, and lines to the points where something acts on it; its axes if it has neither.

        Parameters
        ----------
        system : System
        b : int
            Number of the body.
        entry : Entry
        places : list of ndarray
            Points of the body that joints, contacts and forces name (m).
        shaped : bool
            Whether a contact has already drawn it.
        size : float
            Size of the scene (m).
        """
        center = _spatial(system.scene.bodies[b].center)
        places = [*places, *(_spatial(_numbers(system, p)) for p in entry.values.get("points", {}).values())]
        own = _shapes(system, entry, center)
        skeleton = _skeleton(_distinct(places), center, own)
        self.pieces.extend(Piece(b, outline) for outline in own)
        self.pieces.extend(Piece(b, Outline((x,), width=THICK)) for x in skeleton)
        if own or shaped:
            return
        # Only its axes show the rotation of a body about a line.
        if len(_distinct(places)) > 1 or (skeleton and self.dimension == 2):
            self.centers.append(Marker(b, tuple(system.scene.bodies[b].center)))
        else:
            self.pieces.append(Piece(b, _axes(self.dimension, CROSS * size, center)))

    def marker(self, name: str, option: str) -> Marker:
        """Return the point of that name.

        Raises
        ------
        UsageError
            If there is none.
        """
        if name not in self.points:
            hint = alternatives(name, self.points, "points")
            raise UsageError(f"{option} {name}: there is no such point of a body\nhint: {hint}")
        return self.points[name]


def _spatial(vector: Iterable[Any]) -> Array:
    """Return a vector with three components."""
    return np.array([*(float(x) for x in vector), 0.0], dtype=float)[:3]


def _numbers(system: System, components: Components) -> list[float]:
    return [float(x.evaluate(system.scene.parameters, FLOAT)) for x in components.values]


def _points(system: System) -> dict[str, Marker]:
    found: dict[str, Marker] = {}
    for b, (name, entry) in enumerate(system.scene.model.bodies.items()):
        found[name] = Marker(b, (0.0,) * system.scene.dimension)
        for point, components in entry.values.get("points", {}).items():
            found[f"{name}.{point}"] = Marker(b, tuple(_numbers(system, components)))
    return found


def _placed_form(look: Look) -> Outline:
    """Return the outline of a form in the frame of its body."""
    assert look.form is not None
    axes = np.eye(3)
    if look.axis:
        v = triad(look.axis, None, math.sqrt)
        axes = np.column_stack([v.v2, v.v3, v.v1])
    return outline_of(look.form).placed(axes, _spatial(look.points[0].point))


def _shapes(system: System, entry: Entry, center: Array) -> list[Outline]:
    """Return the outlines of the shapes of a body."""

    def outline(shape: ShapeValue, at: Array) -> Outline:
        lengths = {k: float(x.evaluate(system.scene.parameters, FLOAT)) for k, x in shape.lengths.items()}
        axes = np.eye(3)
        if shape.kind.axis is not None:
            along = shape.kind.axis if shape.along is None else shape.along
            axes = np.roll(np.eye(3), along + 1, axis=0)  # its x, y, z are the following ones of the body, and `along`
            axes = axes * (1.0, -1.0, -1.0) if shape.reversed else axes
        return outline_of(shape.kind.form(*(lengths[f.name] for f in shape.kind.fields))).placed(axes, at)

    for key in ("drawing", "parts"):
        if key in entry.values:
            return [outline(p.shape, _spatial(_numbers(system, p.place))) for p in entry.values[key]]
    return [outline(entry.values["shape"], center)] if "shape" in entry.values else []


def _distinct(places: list[Array]) -> list[Array]:
    found: list[Array] = []
    size = max((float(np.max(np.abs(p))) for p in places), default=0.0)
    for p in places:
        if all(np.max(np.abs(p - other)) > 1e-9 * size for other in found):
            found.append(p)
    return found


def _skeleton(places: list[Array], center: Array, shapes: list[Outline]) -> list[Array]:
    """Return the lines between the points of a body: from its centre of mass to those outside of its shape."""
    if shapes:
        cloud = np.concatenate([x for shape in shapes for x in (*shape.strokes, shape.skin)])
        low, high = cloud.min(axis=0), cloud.max(axis=0)
        slack = 1e-6 * float(np.max(high - low, initial=0.0))
        return [line(center, p) for p in places if np.any(p < low - slack) or np.any(p > high + slack)]
    nodes = _distinct([*places, center])
    if len(nodes) == 2:
        return [line(*nodes)]
    if len(nodes) == 3:
        # A centre of mass on the line between two points needs no lines of its own.
        return [line(*nodes, nodes[0])]
    return [line(center, p) for p in places if np.any(p != center)]


def _axes(dimension: int, size: float, center: Array) -> Outline:
    """Return a cross along the axes of a body, its x axis with an arrow head."""
    lines = [line(center - size * e, center + size * e) for e in np.eye(3)[:dimension]]
    x, y = np.eye(3)[:2]
    head = center + size * x
    return Outline((*lines, line(head - 0.3 * size * (x - 0.6 * y), head, head - 0.3 * size * (x + 0.6 * y))))
