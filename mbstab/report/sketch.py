"""What a mechanism looks like: outlines of bodies in their own frames, lines between joints, pins, springs, ground.

All is in three dimensions; planar scenes lie in z = 0. The next kind of shape to draw is one entry in `OUTLINES`,
the next kind of contact one in `CONTACTS`.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mbstab.compiler.system import Array, System
from mbstab.errors import UsageError, suggestion
from mbstab.mechanics.catalogue import GROUND, Marker
from mbstab.mechanics.vectors import triad
from mbstab.model.arithmetic import FLOAT
from mbstab.model.scene import ItemValues
from mbstab.model.schema import Components, Entry, ShapeValue

ROUND = 49
"""Points of a circle, the first and the last the same."""

CROSS = 0.1
"""Half length of the axes by which a body without shape is drawn, as a part of the size of the scene."""

THIN, THICK, BLADE = 1.0, 2.6, 5.0
"""Width (points) of the edges of bodies, of rods and lines between joints, of knife edges."""


@dataclass(frozen=True)
class Outline:
    """How something looks in its own frame, the axis of symmetry along z.

    Attributes
    ----------
    strokes : tuple of ndarray, shape (k, 3)
        Lines (m).
    skin : ndarray, shape (k, 3)
        Points whose convex hull is filled; empty for what has no inside.
    normals : tuple of ndarray, shape (k, 3)
        For each stroke the outward normals of the faces it belongs to: it is seen if one of them shows.
    """

    strokes: tuple[Array, ...]
    skin: Array = field(default_factory=lambda: np.zeros((0, 3)))
    normals: tuple[Array, ...] = ()

    def placed(self, axes: Array, center: Array) -> Outline:
        """Return it in another frame; the columns of `axes`, shape (3, 3), are its axes there."""
        return Outline(
            tuple(x @ axes.T + center for x in self.strokes),
            self.skin @ axes.T + center,
            tuple(x @ axes.T for x in self.normals),
        )

    def seen(self, towards: Array) -> list[Array]:
        """Return the strokes on the side of a direction, all of them if nothing hides."""
        if not self.normals:
            return list(self.strokes)
        return [x for x, n in zip(self.strokes, self.normals, strict=True) if np.any(n @ towards > 0.0)]


@dataclass(frozen=True)
class Piece:
    """An outline fixed in a body, in the frame of the body, and the width of its lines (points)."""

    body: int
    outline: Outline
    width: float = THIN


@dataclass(frozen=True)
class Link:
    """A line between points of two bodies, straight or as a ``spring``."""

    first: Marker
    second: Marker
    spring: bool


@dataclass(frozen=True)
class Pin:
    """Where a joint is: a point of a body, the form of its marker, and whether it holds to the ground."""

    place: Marker
    form: str
    grounded: bool


@dataclass(frozen=True)
class Plane:
    """A line or plane on which something rolls: unit normal and a point, shape (3,)."""

    normal: Array
    origin: Array


# --- shapes ---------------------------------------------------------------------------------------------------------


def _circle(radius: float, height: float = 0.0) -> Array:
    angle = np.linspace(0.0, 2.0 * math.pi, ROUND)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.full(ROUND, height)])


def _line(*points: Iterable[float]) -> Array:
    return np.array([tuple(p) for p in points], dtype=float)


def _rod(length: float) -> Outline:
    return Outline((_line((0.0, 0.0, -0.5 * length), (0.0, 0.0, 0.5 * length)),))


def _cylinder(radius: float, length: float) -> Outline:
    heights = (-0.5 * length, 0.5 * length) if length else (0.0,)
    ends = [_circle(radius, height) for height in heights]
    marks = [_line((0.0, 0.0, height), end[0]) for height, end in zip(heights, ends, strict=True)]
    # That it turns is seen by a radius. A thin disk shows both faces at once.
    faces = [_line((0.0, 0.0, -1.0)), _line((0.0, 0.0, 1.0))] if length else [_line((0.0, 0.0, -1.0), (0.0, 0.0, 1.0))]
    return Outline((*ends, *marks), np.concatenate(ends), (*faces, *faces))


def _hoop(radius: float) -> Outline:
    return Outline((_circle(radius), _line((0.85 * radius, 0.0, 0.0), (radius, 0.0, 0.0))))


def _box(x: float, y: float, z: float) -> Outline:
    corners = np.array(list(itertools.product((-0.5, 0.5), repeat=3)))
    edges, faces = [], []
    for pair in itertools.combinations(corners, 2):
        ends = np.array(pair)
        if np.count_nonzero(ends[0] != ends[1]) == 1:
            edges.append(ends * (x, y, z))
            faces.append(2.0 * np.diag(ends.mean(axis=0))[ends[0] == ends[1]])
    return Outline(tuple(edges), corners * (x, y, z), tuple(faces))


def _ellipsoid(a: float, b: float, c: float) -> Outline:
    size = np.array([a, b, c])
    circles = [np.roll(_circle(1.0), k, axis=1) for k in range(3)]
    arcs = [circle[k : k + 5] for circle in circles for k in range(0, ROUND - 1, 4)]
    heights = np.linspace(-1.0, 1.0, 25)[1:-1]
    skin = [np.roll(_circle(math.sqrt(1.0 - h * h), h), k, axis=1)[::2] for h in heights for k in (0, 1)]
    return Outline(
        tuple(x * size for x in arcs), np.concatenate([*skin, *circles]) * size, tuple(x[2:3] / size for x in arcs)
    )


def _torus(radius: float, tube: float) -> Outline:
    # Each circle with its outward normals: around the hole, and around the tube.
    angle = np.linspace(0.0, 2.0 * math.pi, ROUND)
    around = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(ROUND)])
    up = np.tile([0.0, 0.0, 1.0], (ROUND, 1))
    normals = (math.cos(a) * around + math.sin(a) * up for a in np.linspace(0.0, 2.0 * math.pi, 8, endpoint=False))
    circles = [(radius * around + tube * normal, normal) for normal in normals]
    for turned in np.linspace(0.0, 2.0 * math.pi, 16, endpoint=False):
        out = np.array([math.cos(turned), math.sin(turned), 0.0])
        normal = np.outer(np.cos(angle), out) + np.outer(np.sin(angle), (0.0, 0.0, 1.0))
        circles.append((radius * out + tube * normal, normal))
    arcs = [(x[k : k + 5], n[k + 2 : k + 3]) for x, n in circles for k in range(0, ROUND - 1, 4)]
    return Outline(tuple(x for x, _ in arcs), normals=tuple(n for _, n in arcs))


OUTLINES: dict[str, Callable[..., Outline]] = {
    "rod": _rod,
    "cylinder": _cylinder,
    "disk": _cylinder,
    "hoop": _hoop,
    "box": _box,
    "sphere": lambda radius: _ellipsoid(radius, radius, radius),
    "ellipsoid": _ellipsoid,
    "torus": _torus,
}
"""From the name of a shape to its outline, by its lengths (m): those of model files, and what contacts add."""


def _wheel(item: ItemValues) -> Outline:
    radius, tube = float(item.number("radius")), float(item.number("tube")) if item.dimension == 3 else 0.0
    outline = OUTLINES["torus"](radius, tube) if tube else OUTLINES["disk"](radius, 0.0)
    axes = np.eye(3)
    if item.dimension == 3:
        v = triad(item.direction("axle"), None, math.sqrt)
        axes = np.column_stack([v.v2, v.v3, v.v1])
    return outline.placed(axes, _spatial(item.marker("center").point))


def _stone(item: ItemValues) -> Outline:
    center = _spatial(item.marker("center").point)
    return OUTLINES["ellipsoid"](*(float(item.number(x)) for x in "abc")).placed(np.eye(3), center)


def _blade(item: ItemValues) -> Outline:
    at, along = _spatial(item.marker("at").point), _spatial(item.direction("along"))
    return Outline((_line(at - along, at + along),))


CONTACTS: dict[str, tuple[Callable[[ItemValues], Outline], str, bool]] = {
    "disk": (_wheel, "center", False),
    "wheel": (_wheel, "center", False),
    "ellipsoid": (_stone, "center", False),
    "knife_edge": (_blade, "at", True),
}
"""From the type of a contact to its outline, to the field that names the body, and whether it is a direction only."""

PINS = {
    "revolute": "o",
    "spherical": "o",
    "universal": "o",
    "fixed": "",
    "distance": "o",
    "planar": "s",
    "prismatic": "s",
    "cylindrical": "s",
    "screw": "s",
    "point_on_line": "s",
    "point_on_plane": "s",
}
"""Markers of joints: round where points are held together, square where they slide."""


# --- scenes ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Sketch:
    """What is drawn of a scene.

    Attributes
    ----------
    dimension : int
    bodies : tuple of str
    pieces, links, pins, planes : list
    masses : list of int
        Bodies that are points.
    centers : list of Marker
        Centres of mass of bodies that are drawn by lines.
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
        """Return what is drawn of a scene with numbers."""
        scene = system.scene
        pieces, links, pins, planes = [], [], [], []
        held: dict[int, list[Array]] = {b: [] for b in range(len(scene.bodies))}
        shaped: set[int] = set()
        size = _size(system)
        for item in scene.items:
            markers = item.points()
            for marker in markers:
                if marker.body != GROUND:
                    held[marker.body].append(_spatial(marker.point))
            section, kind = item.entry.section, item.kind.name
            if section == "joints" and PINS.get(kind):
                grounded = any(m.body == GROUND for m in markers)
                for marker in markers if kind == "distance" else [_moving(markers)]:
                    pins.append(Pin(marker, PINS[kind], marker.body == GROUND if kind == "distance" else grounded))
            if kind in ("distance", "spring", "bearing"):
                links.append(Link(markers[0], markers[1], kind != "distance"))
            if section == "contacts":
                draw, where, direction = CONTACTS[kind]
                body = item.marker(where).body
                outline = draw(item)
                if direction:
                    middle = _spatial(item.marker(where).point)
                    outline = Outline(tuple(middle + CROSS * size * (x - middle) for x in outline.strokes))
                else:
                    shaped.add(body)
                    planes.append(Plane(_spatial(item.direction("normal")), _spatial(item.vector("origin"))))
                pieces.append(Piece(body, outline, BLADE if direction else THIN))
        masses, centers = [], []
        for b, (body_values, entry) in enumerate(zip(scene.bodies, scene.model.bodies.values(), strict=True)):
            if not body_values.orientation:
                masses.append(b)
                continue
            own = _shapes(system, entry, _spatial(body_values.center))
            places = held[b] + [_spatial(_numbers(system, p)) for p in entry.values.get("points", {}).values()]
            pieces += [Piece(b, outline, THICK if name == "rod" else THIN) for name, outline in own]
            skeleton = _skeleton(_distinct(places), _spatial(body_values.center), [x for _, x in own])
            pieces += [Piece(b, Outline((x,)), THICK) for x in skeleton]
            if own or b in shaped:
                continue
            # That a body turns about a line is seen by its axes only.
            if len(_distinct(places)) > 1 or (skeleton and scene.dimension == 2):
                centers.append(Marker(b, tuple(body_values.center)))
            else:
                pieces.append(Piece(b, _axes(scene.dimension, CROSS * size, _spatial(body_values.center))))
        gravity = _spatial(scene.gravity)
        weighted = bool(np.any(gravity))
        up = -gravity / np.linalg.norm(gravity) if weighted else np.eye(3)[scene.dimension - 1]
        names = tuple(body.name for body in scene.bodies)
        return cls(
            scene.dimension, names, pieces, links, pins, _distinct_planes(planes), masses, centers, up, weighted,
            _points(system),
        )  # fmt: skip

    def marker(self, name: str, option: str) -> Marker:
        """Return the point of that name.

        Raises
        ------
        UsageError
            If there is none.
        """
        if name not in self.points:
            hint = suggestion(name, self.points) or "points: " + ", ".join(list(self.points)[:12])
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


def _size(system: System) -> float:
    """Return the largest length of the scene (m), 1 m without any."""
    return max(system.scene.lengths, default=0.0) or 1.0


def _moving(markers: list[Marker]) -> Marker:
    """Return the marker at which a joint is drawn."""
    return next(m for m in markers if m.body != GROUND)


def _shapes(system: System, entry: Entry, center: Array) -> list[tuple[str, Outline]]:
    """Return the outlines of the shapes of a body."""

    def outline(shape: ShapeValue, at: Array) -> tuple[str, Outline]:
        lengths = {k: float(x.evaluate(system.scene.parameters, FLOAT)) for k, x in shape.lengths.items()}
        axes = np.eye(3)
        if shape.kind.axis is not None:
            along = shape.kind.axis if shape.along is None else shape.along
            axes = np.roll(np.eye(3), along + 1, axis=0)  # its x, y, z are the following ones of the body, and `along`
        made = OUTLINES[shape.kind.name](*(lengths[f.name] for f in shape.kind.fields))
        return shape.kind.name, made.placed(axes, at)

    if "parts" in entry.values:
        return [outline(p.shape, _spatial(_numbers(system, p.place))) for p in entry.values["parts"]]
    return [outline(entry.values["shape"], center)] if "shape" in entry.values else []


def _distinct(places: list[Array]) -> list[Array]:
    found: list[Array] = []
    size = max((float(np.max(np.abs(p))) for p in places), default=0.0)
    for p in places:
        if all(np.max(np.abs(p - other)) > 1e-9 * size for other in found):
            found.append(p)
    return found


def _distinct_planes(planes: list[Plane]) -> list[Plane]:
    found: list[Plane] = []
    for p in planes:
        same = (x for x in found if np.allclose(x.normal, p.normal) and abs((x.origin - p.origin) @ p.normal) < 1e-12)
        if next(same, None) is None:
            found.append(p)
    return found


def _skeleton(places: list[Array], center: Array, shapes: list[Outline]) -> list[Array]:
    """Return the lines between the points of a body: from its centre of mass to those outside of its shape."""
    if shapes:
        cloud = np.concatenate([x for shape in shapes for x in (*shape.strokes, shape.skin)])
        low, high = cloud.min(axis=0), cloud.max(axis=0)
        slack = 1e-6 * float(np.max(high - low, initial=0.0))
        return [_line(center, p) for p in places if np.any(p < low - slack) or np.any(p > high + slack)]
    nodes = _distinct([*places, center])
    if len(nodes) == 2:
        return [_line(*nodes)]
    if len(nodes) == 3:
        # The centre of mass on the line between two points needs no lines of its own.
        return [_line(*nodes, nodes[0])]
    return [_line(center, p) for p in places if np.any(p != center)]


def _axes(dimension: int, size: float, center: Array) -> Outline:
    """Return a cross along the axes of a body, its x axis with a head."""
    lines = [_line(center - size * e, center + size * e) for e in np.eye(3)[:dimension]]
    x, y = np.eye(3)[:2]
    head = center + size * x
    return Outline((*lines, _line(head - 0.3 * size * (x - 0.6 * y), head, head - 0.3 * size * (x + 0.6 * y))))
