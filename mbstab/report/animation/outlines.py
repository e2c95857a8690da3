"""Outlines of shapes in three dimensions, in their own frames, and windings of springs."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable
from dataclasses import field, replace

import numpy as np

from mbstab.compiler.system import Array
from mbstab.mechanics.catalogue import Form
from mbstab.records import dataclass
from mbstab.report.animation.solids import hull

WINDINGS = 6
"""Windings of a spring."""

ROUND = 49
"""Points of a circle, the first and the last the same."""

MARKED = ROUND // 6
"""Point of a circle to which a radius is drawn, which shows rotation: off the axes of a body, along which its other
lines often lie."""

FINE = 145
"""Points of a circle to which others are offset."""

THIN, THICK, BLADE = 1.0, 2.6, 5.0
"""Width (points) of the edges of bodies, of rods and lines between joints, of knife edges."""


@dataclass(frozen=True)
class Outline:
    """The outline of an object in its own frame, with the axis of symmetry along z.

    Attributes
    ----------
    strokes : tuple of ndarray, shape (k, 3)
        Lines (m).
    skin : ndarray, shape (k, 3)
        Points whose convex hull is filled; empty for objects without interior.
    normals : tuple of ndarray, shape (k, 3)
        For each stroke the outward normals of its faces: it is visible if one of them faces the viewer.
    width : float
        Width of the lines (points).
    spine : ndarray, shape (k, 3)
        The closed line in the middle of a ring, which is not convex; empty for others.
    tube : float
        Radius of the ring about its spine (m).
    """

    strokes: tuple[Array, ...]
    skin: Array = field(default_factory=lambda: np.zeros((0, 3)))
    normals: tuple[Array, ...] = ()
    width: float = THIN
    spine: Array = field(default_factory=lambda: np.zeros((0, 3)))
    tube: float = 0.0

    def placed(self, axes: Array, center: Array) -> Outline:
        """Return the outline in another frame; the columns of `axes`, shape (3, 3), are its axes there."""
        return replace(
            self,
            strokes=tuple(x @ axes.T + center for x in self.strokes),
            skin=self.skin @ axes.T + center,
            spine=self.spine @ axes.T + center,
            normals=tuple(x @ axes.T for x in self.normals),
        )

    def seen(self, towards: Array) -> list[Array]:
        """Return the strokes on the side that faces a direction; all of them if the outline has no normals."""
        if not self.normals:
            return list(self.strokes)
        return [x for x, n in zip(self.strokes, self.normals, strict=True) if np.any(n @ towards > 0.0)]

    def rims(self, across: Array) -> list[Array]:
        """Return the closed lines around the interior as seen, shape (k, 2): of a ring the outer one and its hole's.

        Parameters
        ----------
        across : ndarray, shape (3, 3)
            Directions to the right, upwards, and towards the viewer, as rows.
        """
        if len(self.skin):
            return [hull(self.skin @ across[:2].T)]
        return _ring_rims(self.spine @ across[:2].T, self.tube) if self.tube else []


def _ring_rims(spine: Array, tube: float) -> list[Array]:
    """Return what is seen of a tube about a closed line in the plane that is convex: its offsets on both sides."""
    outer = hull((spine[:, None] + _circle(tube)[:, :2]).reshape(-1, 2))
    along = np.roll(spine[:-1], -1, axis=0) - np.roll(spine[:-1], 1, axis=0)
    across = np.column_stack([-along[:, 1], along[:, 0]]) / np.maximum(np.linalg.norm(along, axis=1), 1e-300)[:, None]
    middle = spine[:-1].mean(axis=0)
    across *= np.where(np.sum(across * (middle - spine[:-1]), axis=1) > 0.0, 1.0, -1.0)[:, None]
    inner = spine[:-1] + tube * across
    # Where the tube overlaps itself, offsets lie inside of it.
    free = np.min(np.linalg.norm(inner[:, None] - spine[None], axis=2), axis=1) > 0.99 * tube
    hole = inner[free]
    if len(hole) < 3:
        return [outer]
    hole = np.vstack([hole, hole[:1]])
    # It runs around the other way, so that it is not filled.
    area = np.sum(hole[:-1, 0] * hole[1:, 1] - hole[1:, 0] * hole[:-1, 1])
    return [outer, hole[::-1] if area > 0.0 else hole]


def _circle(radius: float, height: float = 0.0, points: int = ROUND) -> Array:
    angle = np.linspace(0.0, 2.0 * math.pi, points)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.full(points, height)])


def line(*points: Iterable[float]) -> Array:
    """Return points as a line, shape (k, 3)."""
    return np.array([tuple(p) for p in points], dtype=float)


def _rod(length: float) -> Outline:
    return Outline((line((0.0, 0.0, -0.5 * length), (0.0, 0.0, 0.5 * length)),), width=THICK)


def _cylinder(radius: float, length: float) -> Outline:
    heights = (-0.5 * length, 0.5 * length) if length else (0.0,)
    ends = [_circle(radius, height) for height in heights]
    spokes = [line((0.0, 0.0, height), end[MARKED]) for height, end in zip(heights, ends, strict=True)]
    # A thin disk shows both faces at once.
    faces = [line((0.0, 0.0, -1.0)), line((0.0, 0.0, 1.0))] if length else [line((0.0, 0.0, -1.0), (0.0, 0.0, 1.0))]
    # From the side lines along the mantle show rotation: of three, one is always well in front.
    sides = (MARKED, MARKED + ROUND // 3, MARKED + 2 * (ROUND // 3)) if length else ()
    along = [line(*(end[k] for end in ends)) for k in sides]
    outwards = [line((*_circle(1.0)[k, :2], 0.0)) for k in sides]
    return Outline((*ends, *spokes, *along), np.concatenate(ends), (*faces, *faces, *outwards))


def _cone(radius: float, length: float) -> Outline:
    base, tip = _circle(radius, -0.25 * length), np.array([0.0, 0.0, 0.75 * length])
    # A radius of the base and a line on the mantle show rotation.
    x, y = _circle(length)[MARKED, :2]
    down, out = line((0.0, 0.0, -1.0)), line((x, y, radius))
    strokes = (base, line((0.0, 0.0, -0.25 * length), base[MARKED]), line(base[MARKED], tip))
    return Outline(strokes, np.vstack([base, tip]), (down, down, out))


def _hoop(radius: float) -> Outline:
    circle = _circle(radius)
    return Outline((circle, line((0.0, 0.0, 0.0), circle[MARKED])))


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
    spine = _circle(radius, points=FINE)
    return Outline(tuple(x for x, _ in arcs), normals=tuple(n for _, n in arcs), spine=spine, tube=tube)


_OUTLINES: dict[str, Callable[..., Outline]] = {
    "rod": _rod,
    "cylinder": _cylinder,
    "cone": _cone,
    "hoop": _hoop,
    "box": _box,
    "ellipsoid": _ellipsoid,
    "torus": _torus,
}


def outline_of(form: Form) -> Outline:
    """Return the outline of a form."""
    return _OUTLINES[form.name](*(float(x) for x in form.lengths))


def windings(ends: Array, width: float, view: Array, dimension: int) -> Array:
    """Return a spring between two points: a zigzag in the plane, else a helix.

    Parameters
    ----------
    ends : ndarray, shape (2, 3)
    width : float
        Half of its width (m).
    view : ndarray, shape (3, 3)
        Directions to the right, upwards, and towards the viewer.
    dimension : int

    Returns
    -------
    ndarray, shape (k, 3)
    """
    along = ends[1] - ends[0]
    length = float(np.linalg.norm(along)) or 1e-300
    across = np.cross(view[2], along)
    if np.linalg.norm(across) < 1e-6 * length:  # seen along its axis
        across = np.cross(view[0], along)
    across *= width / (float(np.linalg.norm(across)) or 1e-300)
    if dimension == 2:
        parts = np.linspace(0.2, 0.8, 2 * WINDINGS + 1)
        sides = np.array([0.0, *([1.0, -1.0] * WINDINGS)[:-1], 0.0])[:, None] * across
    else:
        turns = np.linspace(0.0, WINDINGS, 16 * WINDINGS + 1)
        parts = 0.2 + 0.6 * turns / WINDINGS
        angle = 2.0 * math.pi * turns[:, None]
        wide = np.minimum(2.0 * np.minimum(turns, WINDINGS - turns), 1.0)[:, None]
        sides = wide * (np.sin(angle) * across + np.cos(angle) * np.cross(across, along) / length)
    inner = ends[0] + parts[:, None] * along + sides
    return np.vstack([ends[0], inner, ends[1]])
