"""The view of a motion: its direction, the positions of bodies and points in it, and the limits of the picture.

It is a parallel projection, so that lengths normal to it are true. The limits stay fixed during the motion.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from mbstab.compiler.system import Array
from mbstab.errors import UsageError
from mbstab.mechanics.catalogue import GROUND, Marker
from mbstab.report.animation.frames import FINE, Frames
from mbstab.report.animation.outlines import Outline
from mbstab.report.animation.sketch import Plane, Sketch
from mbstab.report.animation.solids import Solid

VIEW = (20.0, -60.0)
"""Elevation and azimuth in space (deg)."""


class View:
    """A motion in a view.

    Parameters
    ----------
    sketch : Sketch
    frames : Frames
    direction : (float, float), optional
        Elevation and azimuth of the viewing direction (deg), about the upward direction; in the plane from z.
    traces : sequence of str
        Points whose paths are drawn, such as ``rod.tip``.
    follow : str
        Body or point that stays in place while the ground moves along.

    Attributes
    ----------
    across : ndarray, shape (3, 3)
        Directions to the right, upwards, and towards the viewer, as rows.
    traced : dict
        Paths of points by name, with `FINE` points for a frame.
    shift : ndarray, shape (n, 3)
        Shift of the view in each frame (m).
    low, high : ndarray, shape (2,)
        Limits of the picture (m).
    width : float
        Width of the mechanism itself (m).
    boxes : ndarray, shape (k, 2, n, 2)
        Lower left and upper right corner of the box around each body, marker or path in each frame (m).

    Raises
    ------
    UsageError
        If a point is unknown, or a planar scene is to be seen from somewhere else.
    """

    low: Array
    high: Array
    width: float

    def __init__(
        self,
        sketch: Sketch,
        frames: Frames,
        direction: tuple[float, float] | None = None,
        traces: Sequence[str] = (),
        follow: str = "",
    ) -> None:
        if direction is not None and sketch.dimension == 2:
            raise UsageError("--view is for scenes in space, this one is planar")
        self.sketch, self.frames = sketch, frames
        self.across = _directions(sketch, direction or VIEW)
        self.traced = {name: self._trail(sketch.marker(name, "--trace")) for name in traces}
        self.shift = np.zeros((len(frames.captions), 3))
        if follow:
            self.shift = self.path(sketch.marker(follow, "--follow"))
            self.shift = self.shift - self.shift[0]
            if sketch.weighted:
                self.shift -= np.outer(self.shift @ sketch.up, sketch.up)
        self.follows = bool(follow)
        self._limit()

    def flat(self, points: Array) -> Array:
        """Return points, shape (…, 3), projected to the view, shape (…, 2)."""
        return points @ self.across[:2].T

    def path(self, marker: Marker, shifted: bool = False) -> Array:
        """Return the position of a marker in every frame, shape (n, 3), in the shifted view or on the ground."""
        point = np.array([*marker.point, 0.0], dtype=float)[:3]
        n = len(self.frames.captions)
        if marker.body == GROUND:
            path = np.broadcast_to(point, (n, 3))
        else:
            path = self.frames.positions[:, marker.body] + self.frames.rotations[:, marker.body] @ point
        return path - self.shift if shifted else path

    def _trail(self, marker: Marker) -> Array:
        """Return the path of a marker, with `FINE` points for a frame."""
        point = np.array([*marker.point, 0.0], dtype=float)[:3]
        positions, rotations = self.frames.trail
        return np.asarray(positions[:, marker.body] + rotations[:, marker.body] @ point)

    def outline(self, number: int, frame: int) -> Outline:
        """Return the outline of a piece of the sketch at its position in a frame, in ground axes (m)."""
        piece = self.sketch.pieces[number]
        center = self.frames.positions[frame, piece.body] - self.shift[frame]
        return piece.outline.placed(self.frames.rotations[frame, piece.body], center)

    def solid(self, number: int, solid: Solid, frame: int) -> Solid:
        """Return the solid of a piece of the sketch at its position in a frame."""
        body = self.sketch.pieces[number].body
        center = self.frames.positions[frame, body] - self.shift[frame]
        return solid.placed(self.frames.rotations[frame, body], center, self.across)

    def sunk(self) -> tuple[str, float]:
        """Return the body that is deepest below a line or plane on which something rolls, and its depth (m)."""
        found = [("", 0.0)]
        for piece in self.sketch.pieces:
            points = np.concatenate([*piece.outline.strokes, piece.outline.skin])
            turned = np.einsum("nij,kj->nki", self.frames.rotations[:, piece.body], points)
            places = self.frames.positions[:, piece.body][:, None] + turned
            name = self.sketch.bodies[piece.body]
            found += [(name, -float(np.min((places - p.origin) @ p.normal))) for p in self.sketch.planes]
        return max(found, key=lambda item: item[1])

    def fit(self, wide: float, tall: float) -> None:
        """Widen the limits so that lengths are equal along both axes of a picture of that size."""
        scale = max((self.high - self.low)[0] / wide, (self.high - self.low)[1] / tall)
        middle, half = 0.5 * (self.low + self.high), 0.5 * scale * np.array([wide, tall])
        self.low, self.high = middle - half, middle + half

    def missing(self, marks: Sequence[tuple[Array, Array]]) -> float:
        """Return how much lower (m) marks, given by their corners, must be so that no body ever meets one."""
        found = 0.0
        low, high = self.boxes[:, 0], self.boxes[:, 1]
        for corner, other in marks:
            met = np.all((low < other) & (high > corner), axis=-1)
            found = max(found, float(np.max(other[1] - low[..., 1], where=met, initial=0.0)))
        return found

    def _limit(self) -> None:
        """Set the limits of the view, and the width of the mechanism itself."""
        clouds = []
        for piece in self.sketch.pieces:
            points = np.concatenate([*piece.outline.strokes, piece.outline.skin])
            turned = self.frames.rotations[:, piece.body] @ points.T  # (n, 3, k)
            place = (self.frames.positions[:, piece.body] - self.shift)[:, :, None] + turned
            clouds.append(np.einsum("ri,nik->nkr", self.across[:2], place))
        markers = [Marker(b, (0.0, 0.0, 0.0)) for b in self.sketch.masses]
        markers += [m for link in self.sketch.links for m in (link.first, link.second)]
        markers += [pin.place for pin in self.sketch.pins]
        clouds += [(self.path(m, True) @ self.across[:2].T)[:, None] for m in markers]
        if not self.follows:
            clouds += [path[::FINE][: len(self.shift), None] @ self.across[:2].T for path in self.traced.values()]
        self.boxes = np.array([[f(cloud, axis=1) for f in (np.min, np.max)] for cloud in clouds if cloud.shape[1]])
        cloud = np.concatenate(clouds, axis=1)
        self.low, self.high = cloud.min(axis=(0, 1)), cloud.max(axis=(0, 1))
        self.width = float(np.max(cloud[0].max(axis=0) - cloud[0].min(axis=0))) or 1.0
        if self.sketch.dimension == 3:
            for plane in self.sketch.planes:
                one, other, low, high = self.patch(plane)
                ends = [plane.origin + x * one + y * other for x in (low[0], high[0]) for y in (low[1], high[1])]
                seen = np.array(ends) @ self.across[:2].T
                self.low, self.high = np.minimum(self.low, seen.min(axis=0)), np.maximum(self.high, seen.max(axis=0))
        margin = 0.07 * max(float((self.high - self.low).max()), 1e-300) + 0.02 * self.width
        self.low, self.high = self.low - margin, self.high + margin

    def patch(self, plane: Plane) -> tuple[Array, Array, Array, Array]:
        """Return two directions of a plane, and the limits of the coordinates along them of what is above it."""
        first = np.cross(plane.normal, np.eye(3)[int(np.argmin(np.abs(plane.normal)))])
        first /= np.linalg.norm(first)
        directions = np.array([first, np.cross(plane.normal, first)])
        places = (self.frames.positions - self.shift[:, None] - plane.origin) @ directions.T
        low, high = places.min(axis=(0, 1)), places.max(axis=(0, 1))
        room = 0.15 * float(np.max(high - low)) + 0.3 * self.width
        return (*directions, low - room, high + room)

    @property
    def spread(self) -> float:
        """Ratio of the width of the picture to that of the mechanism."""
        return float(np.max(self.high - self.low)) / self.width

    # --- the figure -------------------------------------------------------------------------------------------------


def _directions(sketch: Sketch, view: tuple[float, float]) -> Array:
    """Return the directions to the right, upwards, and towards the viewer, as rows."""
    if sketch.dimension == 2:
        return np.eye(3)
    elevation, azimuth = np.radians(view)
    axis = int(np.argmax(np.abs(sketch.up)))
    first = np.roll(np.eye(3), axis + 1, axis=0).T[0]
    first = first - (first @ sketch.up) * sketch.up
    first /= np.linalg.norm(first)
    second = np.cross(sketch.up, first)
    outwards = math.cos(azimuth) * first + math.sin(azimuth) * second
    right = np.cross(sketch.up, outwards)
    towards = math.cos(elevation) * outwards + math.sin(elevation) * sketch.up
    return np.array([right, np.cross(towards, right), towards])
