"""Moving pictures of mechanisms: bodies by their outlines, joints, springs, ground, and the paths of points.

The view is along parallel lines, so that lengths across it are true. Grey tells bodies apart, the paths of points have
the inks and dashes of all pictures. Limits are fixed over the motion.
"""

from __future__ import annotations

import contextlib
import itertools
import math
import os
import shutil
import struct
import subprocess
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.path import Path as Outlined
from matplotlib.transforms import ScaledTranslation
from PIL import GifImagePlugin, Image, ImageChops

from mbstab.analysis.simulate.mode_shape import Swing
from mbstab.analysis.simulate.simulate import Simulation
from mbstab.compiler.system import Array
from mbstab.errors import OutputError, UsageError
from mbstab.mechanics.catalogue import GROUND, Marker
from mbstab.report.files import whole_file
from mbstab.report.pictures.curves import INK
from mbstab.report.pictures.drawing import FONT, WIDTH, draw_legend, house_style
from mbstab.report.pictures.motion_plots import DASHES
from mbstab.report.pictures.scales import with_minus_sign
from mbstab.report.sketch import Outline, Plane, Sketch
from mbstab.report.solids import Solid, hull

FORMATS = (".gif", ".mp4")
"""What `write` writes, by suffix."""

FPS = 25.0
"""Frames in a second, if not given."""

FASTEST_GIF = 50.0
"""Frames in a second of a GIF: viewers slow down faster ones."""

SLOWEST = 0.01
"""Frames in a second: a GIF cannot show one for longer than 10 min."""

FINE = 5
"""Instants of the path of a point for each frame."""

MOST_FRAMES = 20_000
"""More are taken for a mistake."""

VIEW = (20.0, -60.0)
"""Elevation and azimuth in space (deg)."""

SWING = 2.0
"""How long a period of a mode takes in a picture, whatever it is (s)."""

DPI = 100
FILLS = ("0.93", "0.80", "0.67", "0.86", "0.73")
"""Greys of bodies, in turn."""

TALLEST, FLATTEST = 6.4, 2.2
"""Height of the picture without its margins (inches)."""

FRAGMENTS = 40
"""Lines in space are hidden in pieces not longer than this part of the mechanism."""

TOUCHING = 2e-3
"""What lies deeper behind a body than this part of the mechanism is hidden by it."""

SUPPORT = Outlined([(0.0, 0.0), (-0.6, -1.0), (0.6, -1.0), (0.0, 0.0)])
WINDINGS = 6
"""Of a spring."""


@dataclass(frozen=True)
class Frames:
    """Where the bodies are in each frame.

    Attributes
    ----------
    fps : float
        Frames in a second.
    captions : list of str
        What stands in the corner.
    positions, rotations : ndarray, shape (n, n_b, 3) and (n, n_b, 3, 3)
        Reference points (m), and from body axes to ground axes.
    trail : (ndarray, ndarray)
        The same with `FINE` instants for a frame, for the paths of points; the first is that of the first frame.
    """

    fps: float
    captions: list[str]
    positions: Array
    rotations: Array
    trail: tuple[Array, Array]


# --- motions as frames ----------------------------------------------------------------------------------------------


def frame_count(duration: float, fps: float, speed: float) -> int:
    """Return the number of frames of a motion (s).

    Raises
    ------
    UsageError
        If there are too many.
    """
    frames = duration / speed * fps + 1e-9
    if not frames < MOST_FRAMES:
        raise UsageError(
            f"an animation of {duration:g} s has {frames:.6g} frames, more than {MOST_FRAMES}\n"
            "hint: shorten it with --to, or make it faster with --speed 10"
        )
    return math.floor(frames) + 1


def motion_frames(sim: Simulation, fps: float = FPS, speed: float = 1.0) -> Frames:
    """Return a simulation at evenly spaced times; between times of output it is interpolated.

    Parameters
    ----------
    fps : float
        Frames in a second.
    speed : float
        Seconds of the motion in a second.
    """
    first, last = float(sim.times[0]), float(sim.times[-1])
    count = frame_count(last - first, fps, speed)
    fine = np.minimum(first + np.arange(FINE * (count - 1) + 1) * (speed / fps / FINE), last)
    times, trail = fine[::FINE], _interpolated(sim, fine)
    digits = max(0, math.ceil(-math.log10(speed / fps) - 1e-9))
    captions = [with_minus_sign(f"t = {t:.{digits}f} s") for t in times]
    if speed != 1.0:
        how = f"{speed:g}× as fast" if speed > 1.0 else f"{1.0 / speed:g}× slower"
        captions = [f"{text}, {how}" for text in captions]
    return Frames(fps, captions, trail[0][::FINE], trail[1][::FINE], trail)


def _interpolated(sim: Simulation, times: Array) -> tuple[Array, Array]:
    """Return places by cubic polynomials, orientations by even turns."""
    place, turn = _padded(sim.positions, sim.rotations)
    if len(sim.times) == 1:
        return np.repeat(place, len(times), axis=0), np.repeat(turn, len(times), axis=0)
    k = np.clip(np.searchsorted(sim.times, times, side="right") - 1, 0, len(sim.times) - 2)
    step = (sim.times[k + 1] - sim.times[k])[:, None, None]
    s = (times - sim.times[k])[:, None, None] / step
    v = np.zeros_like(place)
    v[..., : sim.velocities.shape[-1]] = sim.velocities
    found = (
        (1.0 + 2.0 * s) * (1.0 - s) ** 2 * place[k]
        + s * (1.0 - s) ** 2 * step * v[k]
        + s**2 * (3.0 - 2.0 * s) * place[k + 1]
        + s**2 * (s - 1.0) * step * v[k + 1]
    )
    relative = np.swapaxes(turn[k], -1, -2) @ turn[k + 1]
    return found, turn[k] @ _part_of_turn(relative, s[..., 0])


def _part_of_turn(rotation: Array, part: Array) -> Array:
    """Return rotations, shape (…, 3, 3), by a part of their angles, shape (…)."""
    skew = 0.5 * (rotation - np.swapaxes(rotation, -1, -2))
    sine = np.sqrt(skew[..., 2, 1] ** 2 + skew[..., 0, 2] ** 2 + skew[..., 1, 0] ** 2)
    angle = np.arctan2(sine, 0.5 * (np.trace(rotation, axis1=-2, axis2=-1) - 1.0))
    cross = skew / np.where(sine > 1e-12, sine, 1.0)[..., None, None]
    a = (part * angle)[..., None, None]
    result: Array = np.eye(3) + np.sin(a) * cross + (1.0 - np.cos(a)) * cross @ cross
    return result


def _padded(positions: Array, rotations: Array) -> tuple[Array, Array]:
    """Return places and orientations with three components."""
    d = positions.shape[-1]
    place = np.zeros((*positions.shape[:-1], 3))
    turn = np.broadcast_to(np.eye(3), (*rotations.shape[:-2], 3, 3)).copy()
    place[..., :d], turn[..., :d, :d] = positions, rotations
    return place, turn


def swing_frames(swing: Swing, number: int, fps: float = FPS) -> Frames:
    """Return one period of a mode, whose repetition swings on."""
    value = swing.value
    imaginary = f" ± {abs(value.imag):.4g}i" if value.imag else ""
    text = with_minus_sign(f"mode {number}: {value.real:.4g}{imaginary} 1/s")
    said = "growth and decay not shown" if value.real else "exaggerated"
    place, turn = _padded(swing.positions, swing.rotations)
    trail = np.repeat(place, FINE, axis=0), np.repeat(turn, FINE, axis=0)
    return Frames(fps, [f"{text}, {said}"] * len(swing.q), place, turn, trail)


# --- the stage ------------------------------------------------------------------------------------------------------


class Stage:
    """A picture whose bodies can be moved from frame to frame.

    Parameters
    ----------
    sketch : Sketch
    frames : Frames
    title : str
    view : (float, float), optional
        Elevation and azimuth of the direction one looks from (deg), about the upward direction; in the plane from z.
    traces : sequence of str
        Points whose paths are drawn, such as ``rod.tip``.
    follow : str
        Body or point that stays in place while the ground moves along.

    Raises
    ------
    UsageError
        If a point is unknown, or a planar scene is to be seen from somewhere else.
    """

    def __init__(
        self,
        sketch: Sketch,
        frames: Frames,
        title: str = "",
        view: tuple[float, float] | None = None,
        traces: Sequence[str] = (),
        follow: str = "",
    ) -> None:
        if view is not None and sketch.dimension == 2:
            raise UsageError("--view is for scenes in space, this one is planar")
        self.sketch, self.frames = sketch, frames
        self.across = _view(sketch, view or VIEW)
        self.traced = {name: self._trail(sketch.marker(name, "--trace")) for name in traces}
        self.shift = np.zeros((len(frames.captions), 3))
        if follow:
            self.shift = self._path(sketch.marker(follow, "--follow"))
            self.shift = self.shift - self.shift[0]
            if sketch.weighted:
                self.shift -= np.outer(self.shift @ sketch.up, sketch.up)
        self.follows = bool(follow)
        self._extent()
        # Planar bodies lie in one plane: none is behind another.
        skins = [k for k, piece in enumerate(sketch.pieces) if sketch.dimension == 3 and len(piece.outline.skin)]
        self.solids = {k: Solid.of(sketch.pieces[k].outline.skin) for k in skins}
        with house_style():
            self._build(title)

    # --- geometry ---------------------------------------------------------------------------------------------------

    def _path(self, marker: Marker, shifted: bool = False) -> Array:
        """Return the place of a marker in every frame, shape (n, 3)."""
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
        """Return the outline of a piece of the sketch where it is in a frame, in ground axes (m)."""
        piece = self.sketch.pieces[number]
        center = self.frames.positions[frame, piece.body] - self.shift[frame]
        return piece.outline.placed(self.frames.rotations[frame, piece.body], center)

    def _extent(self) -> None:
        """Set the limits of the view, and how wide the mechanism itself is."""
        clouds = []
        for piece in self.sketch.pieces:
            points = np.concatenate([*piece.outline.strokes, piece.outline.skin])
            turned = self.frames.rotations[:, piece.body] @ points.T  # (n, 3, k)
            place = (self.frames.positions[:, piece.body] - self.shift)[:, :, None] + turned
            clouds.append(np.einsum("ri,nik->nkr", self.across[:2], place))
        markers = [Marker(b, (0.0, 0.0, 0.0)) for b in self.sketch.masses]
        markers += [m for link in self.sketch.links for m in (link.first, link.second)]
        markers += [pin.place for pin in self.sketch.pins]
        clouds += [(self._path(m, True) @ self.across[:2].T)[:, None] for m in markers]
        if not self.follows:
            clouds += [path[::FINE][: len(self.shift), None] @ self.across[:2].T for path in self.traced.values()]
        cloud = np.concatenate(clouds, axis=1)
        self.low, self.high = cloud.min(axis=(0, 1)), cloud.max(axis=(0, 1))
        self.width = float(np.max(cloud[0].max(axis=0) - cloud[0].min(axis=0))) or 1.0
        if self.sketch.dimension == 3:
            for plane in self.sketch.planes:
                one, other, low, high = self.patch(plane)
                ends = [plane.origin + x * one + y * other for x in (low[0], high[0]) for y in (low[1], high[1])]
                seen = np.array(ends) @ self.across[:2].T
                self.low, self.high = np.minimum(self.low, seen.min(axis=0)), np.maximum(self.high, seen.max(axis=0))

    def patch(self, plane: Plane) -> tuple[Array, Array, Array, Array]:
        """Return two directions of a plane, and the least and largest coordinates along them of what is above it."""
        first = np.cross(plane.normal, np.eye(3)[int(np.argmin(np.abs(plane.normal)))])
        first /= np.linalg.norm(first)
        directions = np.array([first, np.cross(plane.normal, first)])
        places = (self.frames.positions - self.shift[:, None] - plane.origin) @ directions.T
        low, high = places.min(axis=(0, 1)), places.max(axis=(0, 1))
        room = 0.15 * float(np.max(high - low)) + 0.5 * self.width
        return (*directions, low - room, high + room)

    @property
    def spread(self) -> float:
        """How many times as wide as the mechanism the picture is."""
        return float(np.max(self.high - self.low)) / self.width

    # --- the figure -------------------------------------------------------------------------------------------------

    def _build(self, title: str) -> None:
        ticks = self.sketch.dimension == 2 and not self.follows
        span = self.high - self.low
        margin = 0.07 * max(float(span.max()), 1e-300) + 0.02 * self.width
        low, high = self.low - margin, self.high + margin
        left, right = (0.85, 0.25) if ticks else (0.25, 0.25)
        above, below = (0.42 if title else 0.15), (0.55 if ticks else 0.15) + (0.3 if self.traced else 0.0)
        wide = WIDTH - left - right
        tall = min(max(wide * (high - low)[1] / (high - low)[0], FLATTEST), TALLEST)
        tall = (round((tall + above + below) * DPI / 2.0) * 2) / DPI - above - below
        # Equal lengths along both axes: what is left over is room.
        scale = max((high - low)[0] / wide, (high - low)[1] / tall)
        middle, half = 0.5 * (low + high), 0.5 * scale * np.array([wide, tall])
        self.low, self.high = middle - half, middle + half
        total = tall + above + below
        self.figure = Figure(figsize=(WIDTH, total), dpi=DPI)
        self.canvas: Any = FigureCanvasAgg(self.figure)
        self.axes = self.figure.add_axes((left / WIDTH, below / total, wide / WIDTH, tall / total))
        self.axes.set_xlim(self.low[0], self.high[0])
        self.axes.set_ylim(self.low[1], self.high[1])
        self.axes.set_aspect("equal")
        if title:
            shown = title if len(title) <= 80 else title[:79] + "…"
            self.figure.text(0.5, 1.0 - 0.1 / total, shown, ha="center", va="top", fontsize=FONT + 2, parse_math=False)
        if ticks:
            self.axes.set_xlabel("x (m)")
            self.axes.set_ylabel("y (m)")
        else:
            self.axes.set_xticks([])
            self.axes.set_yticks([])
            _scale_bar(self.axes, self.low, self.high)
        if self.sketch.dimension == 3:
            _triad(self.axes, self.low, self.high, self.across)
        self._moving_artists()
        if self.traced:
            handles = [Line2D([], [], **_path_style(k), label=f"path of {name}") for k, name in enumerate(self.traced)]
            draw_legend(self.figure, handles)

    def _moving_artists(self) -> None:
        axes = self.axes
        self.ground = LineCollection(
            [], colors="0.82" if self.sketch.dimension == 3 else "0.4", linewidths=0.7, zorder=1
        )
        self.bodies = PolyCollection([], closed=False, zorder=3)
        self.edges = LineCollection([], colors="k", zorder=3.4)
        self.links = LineCollection([], colors="k", zorder=3.5)
        for collection in (self.ground, self.bodies, self.edges, self.links):
            axes.add_collection(collection, autolim=False)
        # In the plane paths lie below the bodies; in space they are hidden where they are behind one.
        layer = 2.0 if self.sketch.dimension == 2 else 4.0
        self.paths = [axes.plot([], [], **_path_style(k), zorder=layer)[0] for k in range(len(self.traced))]
        plain: dict[str, Any] = {"linestyle": "", "color": "k", "zorder": 5}
        grounded = [pin for pin in self.sketch.pins if pin.grounded]
        support = {**plain, "color": "0.35", "markerfacecolor": "0.75"}
        self.markers: list[tuple[Line2D, list[Marker]]] = []
        self.behind: list[Line2D] = []
        for markers, style in (
            ([pin.place for pin in grounded], {**support, "marker": SUPPORT, "markersize": 13}),
            ([pin.place for pin in self.sketch.pins if pin.form == "o"], {**plain, "marker": "o", "markersize": 5}),
            ([pin.place for pin in self.sketch.pins if pin.form == "s"], {**plain, "marker": "s", "markersize": 4.5}),
            ([Marker(b, (0.0, 0.0, 0.0)) for b in self.sketch.masses], {**plain, "marker": "o", "markersize": 10}),
            (self.sketch.centers, {**plain, "marker": ".", "markersize": 7, "zorder": 4.4}),
        ):
            if style["marker"] in ("o", "s") and style["markersize"] < 10:
                style = {**style, "markerfacecolor": "w"}
            else:
                style = {**style, "zorder": 4.5}
            if markers:
                self.markers.append((axes.plot([], [], **style)[0], markers))
                # Behind a body they are not lost, but empty.
                empty = {"markerfacecolor": "none", "markeredgecolor": "0.3", "markeredgewidth": 0.7}
                self.behind.append(axes.plot([], [], **style | empty)[0])
        self.caption = axes.text(
            0.015, 0.98, "", transform=axes.transAxes, ha="left", va="top", fontsize=FONT + 1, zorder=7,
            bbox={"boxstyle": "square,pad=0.2", "facecolor": "w", "alpha": 0.85, "linewidth": 0},
        )  # fmt: skip
        lines = [*(line for line, _ in self.markers), *self.behind]
        artists = [self.ground, self.bodies, self.edges, self.links, *self.paths, *lines]
        self.artists = sorted([*artists, self.caption], key=lambda artist: artist.get_zorder())
        for artist in self.artists:
            artist.set_animated(True)
        self.marked = [(line, [self._path(m, True) for m in markers]) for line, markers in self.markers]
        self.ends = [(link, self._path(link.first, True), self._path(link.second, True)) for link in self.sketch.links]

    # --- frames -----------------------------------------------------------------------------------------------------

    def show(self, frame: int) -> None:
        """Move everything to where it is in a frame."""
        placed = [self.outline(number, frame) for number in range(len(self.sketch.pieces))]
        solids = {k: self._solid(k, solid, frame) for k, solid in self.solids.items()}
        fills: list[tuple[Array, str, str, float]] = []
        edges: list[tuple[Array, float]] = []
        for k in self._order(solids) if solids else range(len(placed)):
            if len(placed[k].skin):
                fill = FILLS[self.sketch.pieces[k].body % len(FILLS)]
                fills.append((hull(placed[k].skin @ self.across[:2].T), fill, "none" if solids else "k", 1.1))
            if not solids:
                width = self.sketch.pieces[k].width
                fills += [(x @ self.across[:2].T, "none", "k", width) for x in placed[k].seen(self.across[2])]
        if solids:
            for k, piece in enumerate(self.sketch.pieces):
                # A body without inside is drawn over what it is fixed to.
                others = [
                    x for j, x in solids.items() if j != k and (k in solids or self.sketch.pieces[j].body != piece.body)
                ]
                if k in solids:
                    edges += [(x, 1.1) for x in self._visible(solids[k].rim, others)]
                for stroke in placed[k].seen(self.across[2]):
                    edges += [(x, piece.width) for x in self._visible(stroke, others)]
        links: list[tuple[Array, float]] = []
        everything = list(solids.values())
        for link, first, second in self.ends:
            ends = np.array([first[frame], second[frame]])
            shape = _windings(ends, 0.035 * self.width, self.across, self.sketch.dimension) if link.spring else ends
            links += [(x, 1.0 if link.spring else 2.2) for x in self._visible(shape, everything)]
        self.bodies.set_verts([shown[0] for shown in fills], closed=False)
        self.bodies.set_facecolor([shown[1] for shown in fills])
        self.bodies.set_edgecolor([shown[2] for shown in fills])
        self.bodies.set_linewidth([shown[3] for shown in fills])
        for lines, pieces in ((self.edges, edges), (self.links, links)):
            lines.set_segments([x for x, _ in pieces])
            lines.set_linewidth([width for _, width in pieces])
        for (line, paths), empty in zip(self.marked, self.behind, strict=True):
            places = np.array([path[frame] for path in paths])
            covered = self._hidden(places, everything, inside=False)
            line.set_data(*(places[~covered] @ self.across[:2].T).T)
            empty.set_data(*(places[covered] @ self.across[:2].T).T)
        for line, trail in zip(self.paths, self.traced.values(), strict=True):
            gone = trail[: FINE * frame + 1] - self.shift[frame]
            covered = self._hidden(gone, everything, inside=False)  # the point itself may be inside of its body
            line.set_data(*np.where(covered, np.nan, self.across[:2] @ gone.T))
        if frame == 0 or self.follows:
            planes = (_ground(p, self, self.shift[frame]) for p in self.sketch.planes)
            self.ground.set_segments([line for lines in planes for line in lines])
        self.caption.set_text(self.frames.captions[frame])

    def _solid(self, number: int, solid: Solid, frame: int) -> Solid:
        """Return the solid of a piece where it is in a frame."""
        body = self.sketch.pieces[number].body
        return solid.placed(
            self.frames.rotations[frame, body], self.frames.positions[frame, body] - self.shift[frame], self.across
        )

    def _order(self, solids: dict[int, Solid]) -> list[int]:
        """Return solids such that the ones that cover others come after them."""
        left = dict(sorted(solids.items(), key=lambda item: float((item[1].rim @ self.across[2]).mean())))
        covers = {(a, b) for a in left for b in left if a != b and left[a].covers(left[b], self.across[2])}
        found = []
        while left:
            free = (a for a in left if not any((a, b) in covers for b in left))
            found.append(next(free, next(iter(left))))  # what cover each other in a ring have no order
            del left[found[-1]]
        return found

    def _hidden(self, points: Array, solids: list[Solid], inside: bool = True) -> npt.NDArray[np.bool_]:
        """Return which of points, shape (k, 3), are behind solids, or `inside` of them."""
        covered, deep = np.zeros(len(points), dtype=bool), TOUCHING * self.width
        for solid in solids:
            first, last = solid.through(points, self.across[2])
            # Before it the ray runs free, or it runs through what is thick.
            passes = (last > first) & ((first > deep) | (last - np.maximum(first, 0.0) > deep))
            covered |= passes & (inside | (first > -deep))
        return covered

    def _visible(self, line: Array, solids: list[Solid]) -> list[Array]:
        """Return the parts of a line, shape (k, 3), that no solid hides, as they are seen, each of shape (m, 2)."""
        if not solids:
            return [line @ self.across[:2].T]
        steps = np.linalg.norm(np.diff(line, axis=0), axis=1)
        counts = np.maximum(np.ceil(steps * FRAGMENTS / self.width), 1).astype(int)
        parts = [a + (b - a) * np.arange(n)[:, None] / n for a, b, n in zip(line[:-1], line[1:], counts, strict=True)]
        fine = np.concatenate([*parts, line[-1:]])
        covered = self._hidden(0.5 * (fine[1:] + fine[:-1]), solids)
        seen = fine @ self.across[:2].T
        changes = np.flatnonzero(np.diff(covered)) + 1
        bounds = [0, *changes.tolist(), len(covered)]
        return [seen[a : b + 1] for a, b in itertools.pairwise(bounds) if not covered[a]]

    def images(self) -> Iterator[Image.Image]:
        """Yield the frames as RGB images."""
        with house_style():
            self.canvas.draw()
            background = self.canvas.copy_from_bbox(self.figure.bbox)
            for frame in range(len(self.frames.captions)):
                self.show(frame)
                self.canvas.restore_region(background)
                for artist in self.artists:
                    self.axes.draw_artist(artist)
                yield Image.frombuffer("RGBA", self.canvas.get_width_height(), self.canvas.buffer_rgba()).convert("RGB")


def _path_style(number: int) -> dict[str, Any]:
    return {"color": INK[(number + 1) % len(INK)], "linestyle": DASHES[number % len(DASHES)], "linewidth": 1.3}


def _view(sketch: Sketch, view: tuple[float, float]) -> Array:
    """Return the directions to the right, upwards, and towards the one who looks, as rows."""
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


def _windings(ends: Array, width: float, view: Array, dimension: int) -> Array:
    """Return a spring between two points in space, shape (k, 3): a zigzag in the plane, else a helix."""
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
        angle, wide = (
            2.0 * math.pi * turns[:, None],
            np.minimum(2.0 * np.minimum(turns, WINDINGS - turns), 1.0)[:, None],
        )
        sides = wide * (np.sin(angle) * across + np.cos(angle) * np.cross(across, along) / length)
    inner = ends[0] + parts[:, None] * along + sides
    return np.vstack([ends[0], inner, ends[1]])


def _ground(plane: Plane, stage: Stage, shift: Array) -> list[Array]:
    """Return the lines of a plane, or of a line with hatches, as they are seen after a shift of the view."""
    normal, across = plane.normal, stage.across
    origin = plane.origin - shift
    span = float(np.max(stage.high - stage.low))
    step = _nice(span / 12.0)
    if stage.sketch.dimension == 2:
        along = np.array([-normal[1], normal[0], 0.0])
        ends = [(np.array(p) - origin[:2]) @ along[:2] for p in _corners(stage)]
        first = math.floor((min(ends) + plane.origin @ along - origin @ along) / step) - 1
        offset = (origin - plane.origin) @ along
        marks = offset + step * np.arange(first - 1, first + int((max(ends) - min(ends)) / step) + 4)
        base = origin - (origin @ along) * along + (plane.origin @ along) * along
        lines = [np.array([base + marks[0] * along, base + marks[-1] * along])]
        down = -0.35 * step * (normal + along)
        lines += [np.array([base + m * along, base + m * along + down]) for m in marks]
        return [line[:, :2] for line in lines]
    # A grid below the bodies, its lines fixed to the ground.
    origin = plane.origin
    one, other, low, high = stage.patch(plane)
    step = _nice(float(np.max(high - low)) / 12.0)
    move = np.array([shift @ one, shift @ other])
    low, high = np.floor((low + move) / step) * step - move, np.ceil((high + move) / step) * step - move
    lines = []
    for way, along, a, b in ((one, other, 0, 1), (other, one, 1, 0)):
        for x in np.arange(low[a], high[a] + 0.5 * step, step):
            lines.append(np.array([origin + x * way + y * along for y in (low[b], high[b])]) @ across[:2].T)
    return lines


def _corners(stage: Stage) -> list[tuple[float, float]]:
    return [(float(x), float(y)) for x in (stage.low[0], stage.high[0]) for y in (stage.low[1], stage.high[1])]


def _nice(length: float) -> float:
    """Return 1, 2 or 5 times a power of ten, not above a length."""
    power = 10.0 ** math.floor(math.log10(length))
    return next(x * power for x in (5.0, 2.0, 1.0) if x * power <= length * (1.0 + 1e-9))


def _scale_bar(axes: Axes, low: Array, high: Array) -> None:
    """Draw a bar with its length into the lower right corner."""
    length = _nice(0.25 * (high - low)[0])
    right, part = 0.97, length / float((high - low)[0])
    bar: dict[str, Any] = {"xycoords": "axes fraction", "textcoords": "offset points"}
    figure = axes.get_figure()
    assert figure is not None
    shift = axes.transAxes + ScaledTranslation(0.0, 8.0 / 72.0, figure.dpi_scale_trans)
    axes.add_line(Line2D([right - part, right], [0.0, 0.0], transform=shift, color="k", linewidth=2.0))
    axes.annotate(f"{length:g} m", (right - 0.5 * part, 0.0), (0, 11), **bar, ha="center", va="bottom")


def _triad(axes: Axes, low: Array, high: Array, across: Array) -> None:
    """Draw the directions of the ground axes into the lower left corner."""
    size = 0.06 * float(np.max(high - low))
    start = low + 1.5 * size
    arrow = {"arrowstyle": "-|>", "linewidth": 0.9, "color": "0.25", "shrinkA": 0, "shrinkB": 0}
    for name, direction in zip("xyz", np.eye(3), strict=True):
        way = across[:2] @ direction
        x, y = (start + size * way).tolist()
        axes.annotate("", (x, y), (float(start[0]), float(start[1])), arrowprops=arrow)
        # An axis that points to the one who looks has no arrow beside which its name could stand.
        x, y = (start + 1.25 * size * way + (0.0 if np.hypot(*way) > 0.3 else 0.25 * size)).tolist()
        axes.text(x, y, name, ha="center", va="center")


# --- files ----------------------------------------------------------------------------------------------------------


def check(path: Path, fps: float) -> None:
    """Refuse a file that cannot be written, before anything is computed.

    Raises
    ------
    UsageError
        If the suffix is none of `FORMATS`, frames are too slow, or too fast for a GIF, or ffmpeg is missing for an MP4.
    """
    if path.suffix.lower() not in FORMATS:
        raise UsageError(f"{path}: animations end with {' or '.join(FORMATS)}")
    if fps < SLOWEST:
        raise UsageError(f"{path}: an animation has {SLOWEST:g} frames in a second at least, not {fps:g}")
    if path.suffix.lower() == ".gif" and fps > FASTEST_GIF:
        raise UsageError(f"{path}: a GIF has {FASTEST_GIF:g} frames in a second at most, not {fps:g}")
    if path.suffix.lower() == ".mp4" and shutil.which("ffmpeg") is None:
        raise UsageError(f"{path}: MP4 files need the program ffmpeg, which is not found\nhint: name a .gif file")


def write(stage: Stage, path: str | os.PathLike[str], progress: Callable[[float], object] = lambda done: None) -> None:
    """Write all frames; the file appears whole or not at all.

    Parameters
    ----------
    path : path
        The suffix says how: ``.gif``, which repeats, or ``.mp4``, by ffmpeg.
    progress : callable
        Is called with the part of the frames that is written, from 0 to 1.

    Raises
    ------
    UsageError
        As in `check`.
    OutputError
        If ffmpeg fails.
    OSError
        If the file cannot be written.
    """
    path = Path(path)
    check(path, stage.frames.fps)
    count = len(stage.frames.captions)

    def images() -> Iterator[Image.Image]:
        for number, image in enumerate(stage.images(), 1):
            yield image
            progress(number / count)

    with whole_file(path) as stream:
        (_write_gif if path.suffix.lower() == ".gif" else _write_mp4)(stream, images(), stage.frames.fps)


def _palette() -> Image.Image:
    """Return greys, and the inks on their way to white and to black."""
    colours = [(round(255 * k / 31),) * 3 for k in range(32)]  # not finer than Pillow tells apart
    for ink in INK[1:]:
        rgb = np.array([int(ink[i : i + 2], 16) for i in (1, 3, 5)])
        colours += [tuple(np.round(rgb + (255 - rgb) * k / 23).astype(int).tolist()) for k in range(23)]
        colours += [tuple(np.round(rgb * k / 12).astype(int).tolist()) for k in range(12)]
    image = Image.new("P", (1, 1))
    image.putpalette([x for colour in colours for x in colour])
    return image


def _write_gif(stream: BinaryIO, images: Iterator[Image.Image], fps: float) -> None:
    """Write frames one after the other, of each what changes; delays in 1/100 s add up to the right duration."""
    palette = _palette()
    before: Image.Image | None = None
    pending: tuple[Image.Image, tuple[int, int]] | None = None
    due = shown = 0

    def put(ticks: int) -> None:
        assert pending is not None
        for data in GifImagePlugin.getdata(pending[0], pending[1], duration=10 * ticks):
            stream.write(data)

    for number, image in enumerate(images, 1):
        indexed = image.quantize(palette=palette, dither=Image.Dither.NONE)
        if before is None:
            table = bytes(palette.getpalette() or [])[:768].ljust(768, b"\0")
            stream.write(b"GIF89a" + struct.pack("<HHBBB", *indexed.size, 0xF7, 0, 0) + table)
            stream.write(b"!\xff\x0bNETSCAPE2.0\x03\x01\0\0\0")
            box: tuple[int, int, int, int] | None = (0, 0, *indexed.size)
        else:
            box = ImageChops.difference(indexed.convert("L"), before.convert("L")).getbbox() or (0, 0, 1, 1)
        if pending is not None:
            put(due - shown)
            shown = due
        assert box is not None
        pending, before, due = (indexed.crop(box), box[:2]), indexed, round(100.0 * number / fps)
    if pending is not None:
        put(due - shown)
    stream.write(b";")


def _write_mp4(stream: BinaryIO, images: Iterator[Image.Image], fps: float) -> None:
    """Give frames to ffmpeg, which writes to the place of the stream."""
    first = next(images)
    source = [
        "-f",
        "rawvideo",
        "-pix_fmt",
        "rgb24",
        "-s",
        f"{first.width}x{first.height}",
        "-r",
        f"{fps:.12g}",
        "-i",
        "-",
    ]
    command = ["ffmpeg", "-y", "-loglevel", "error", *source, "-an", "-pix_fmt", "yuv420p", "-f", "mp4", stream.name]
    # In a session of its own it does not get the Ctrl-C of the terminal, which ends it here.
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True) as process:
        assert process.stdin is not None
        assert process.stderr is not None
        try:
            for image in itertools.chain([first], images):
                process.stdin.write(image.tobytes())
        except BrokenPipeError:
            pass  # it says why
        except BaseException:
            process.kill()
            raise
        finally:
            with contextlib.suppress(BrokenPipeError):
                process.stdin.close()
        said = process.stderr.read()
    if process.returncode:
        raise OutputError(_failed(said))


def _failed(said: bytes) -> str:
    lines = said.decode("utf-8", "replace").strip().splitlines()
    return f"ffmpeg could not write the animation{': ' + lines[-1] if lines else ''}"


def still(stage: Stage, frame: int) -> bytes:
    """Return one frame as PNG."""
    for number, image in enumerate(stage.images()):
        if number == frame:
            stream = BytesIO()
            image.save(stream, format="PNG")
            return stream.getvalue()
    raise IndexError(frame)
