"""The picture in which bodies, joints, springs and paths of points move from frame to frame.

Greys distinguish bodies; the paths of points have the inks and dashes of all pictures.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from textwrap import wrap
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.path import Path as Outlined
from PIL import Image

from mbstab.compiler.system import Array
from mbstab.mechanics.catalogue import Marker
from mbstab.report.animation.backdrop import corner_marks, draw_ground_axes, draw_scale_bar, ground_lines
from mbstab.report.animation.frames import FINE, Frames
from mbstab.report.animation.outlines import Outline, windings
from mbstab.report.animation.sketch import Sketch
from mbstab.report.animation.solids import Solid, hidden, in_order
from mbstab.report.animation.view import View
from mbstab.report.picture_sizes import FONT, SIZES, scaled, size
from mbstab.report.pictures.curves import INK
from mbstab.report.pictures.drawing import add_legend, draw_title, house_style, text_width, title_lines
from mbstab.report.pictures.motion_plots import DASHES

DPI = 100
"""Pixels of an inch of a page; other sizes have as many pixels in all."""

FILLS = ("0.93", "0.80", "0.67", "0.86", "0.73")
"""Greys of bodies, in turn."""

WIDTH, TALLEST, FLATTEST = 7.2, 6.4, 2.2
"""Width of the picture, and limits of its height without margins (inches on a page)."""

ROUNDS = 4
"""Room below bodies makes these smaller, so that they need less: it is found in at most so many rounds."""

WIDEST, SLENDER = 0.035, 0.3
"""Limits of half the width of a spring: as a fraction of the width of the mechanism, and of its length."""

FRAGMENTS = 40
"""Pieces into which a line as long as the mechanism is cut to find its hidden parts."""

TOUCHING = 2e-3
"""A point is hidden if it lies behind a body by more than this fraction of the size of the mechanism."""

SUPPORT = Outlined([(0.0, 0.0), (-0.6, -1.0), (0.6, -1.0), (0.0, 0.0)])
"""Marker of a joint to the ground."""


class Stage:
    """A picture whose bodies can be moved from frame to frame.

    Parameters
    ----------
    sketch : Sketch
    frames : Frames
    title : str
    view : (float, float), optional
        The viewing direction; see `View`, also for `traces` and `follow`.
    traces : sequence of str
    follow : str

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
        self.view = View(sketch, frames, view, traces, follow)
        # Planar bodies lie in one plane: none hides another.
        skins = [k for k, piece in enumerate(sketch.pieces) if sketch.dimension == 3 and len(piece.outline.skin)]
        self.solids = {k: Solid.of(sketch.pieces[k].outline.skin) for k in skins}
        with house_style():
            self._add_axes(title)
            self._add_surfaces()
            self._add_markers()
        lines = [*(line for line, _ in self.marked), *self.behind]
        artists = [self.ground, self.bodies, self.edges, self.links, *self.paths, *lines, self.caption]
        self.artists = sorted(artists, key=lambda artist: artist.get_zorder())
        for artist in self.artists:
            artist.set_animated(True)

    def _add_axes(self, title: str) -> None:
        """Create the figure with its axes, title, scale and legend."""
        view = self.view
        planar = view.sketch.dimension == 2
        ticks = planar and not view.follows
        part = size().width / SIZES["page"].width
        width, dpi = WIDTH * part, DPI / part
        left, right = (scaled(room) for room in ((0.85, 0.25) if ticks else (0.25, 0.25)))
        lines = title_lines(title)[:2]
        above, below = (scaled(room) for room in (0.25 + 0.17 * len(lines) if title else 0.15, 0.55 if ticks else 0.15))
        below += scaled(0.3) if view.traced else 0.0
        wide = width - left - right
        self.letters = int(72.0 * wide / text_width(" ", scaled(FONT + 1)))
        above += scaled(0.18) * max(len(wrap(caption, self.letters)) for caption in view.frames.captions)
        tall = self._fit(wide, above + below, dpi, marked=not ticks)
        total = tall + above + below
        self.figure = Figure(figsize=(width, total), dpi=dpi)
        self.canvas: Any = FigureCanvasAgg(self.figure)
        self.axes = self.figure.add_axes((left / width, below / total, wide / width, tall / total))
        self.axes.set_xlim(view.low[0], view.high[0])
        self.axes.set_ylim(view.low[1], view.high[1])
        self.axes.set_aspect("equal")
        if title:
            draw_title(self.figure, lines)
        if ticks:
            self.axes.set_xlabel("x (m)")
            self.axes.set_ylabel("y (m)")
        else:
            self.axes.set_xticks([])
            self.axes.set_yticks([])
            draw_scale_bar(self.axes, view.low, view.high)
        if not planar:
            draw_ground_axes(self.axes, view.low, view.high, view.across)
        if view.traced:
            handles = [Line2D([], [], **_path_style(k), label=f"path of {name}") for k, name in enumerate(view.traced)]
            add_legend(self.figure, handles)

    def _fit(self, wide: float, around: float, dpi: float, marked: bool) -> float:
        """Fit the view to a width; return the height of the axes (inches), with room below for marks of the corners."""
        view, part = self.view, size().width / SIZES["page"].width
        low, high = view.low, view.high
        for _ in range(ROUNDS):
            ratio = float((high - low)[1] / (high - low)[0])
            tall = min(max(wide * ratio, FLATTEST * part), TALLEST * part)
            if size().height:
                tall = WIDTH * part * size().height / size().width - around
            tall = (round((tall + around) * dpi / 2.0) * 2) / dpi - around
            view.low, view.high = low, high
            view.fit(wide, tall)
            missing = view.missing(corner_marks(view, tall)) if marked else 0.0
            if missing <= 0.0:
                break
            low = low - np.array([0.0, missing])
        return tall

    def _add_surfaces(self) -> None:
        """Add the objects with lines and faces (ground, bodies, links, paths) and the caption."""
        planar = self.view.sketch.dimension == 2
        self.ground = LineCollection([], colors="0.4" if planar else "0.82", linewidths=0.7, zorder=1)
        self.bodies = PolyCollection([], closed=False, zorder=3)
        self.edges = LineCollection([], colors="k", zorder=3.4)
        self.links = LineCollection([], colors="k", zorder=3.5)
        for collection in (self.ground, self.bodies, self.edges, self.links):
            self.axes.add_collection(collection, autolim=False)
        # In the plane paths lie below the bodies; in space they are hidden behind bodies.
        layer = 2.0 if planar else 4.0
        styles = [_path_style(k) for k in range(len(self.view.traced))]
        self.paths = [self.axes.plot([], [], **style, zorder=layer)[0] for style in styles]
        self.caption = self.axes.text(
            0.0, 1.01, "", transform=self.axes.transAxes, ha="left", va="bottom", fontsize=scaled(FONT + 1), zorder=7,
        )  # fmt: skip

    def _add_markers(self) -> None:
        """Add the markers of supports, joints, point masses and centres of mass, each kind visible and hidden."""
        sketch, path = self.view.sketch, self.view.path
        joint: dict[str, Any] = {"color": "k", "markerfacecolor": "w", "zorder": 5}
        support = {"color": "0.35", "markerfacecolor": "0.75", "marker": SUPPORT, "markersize": 13, "zorder": 4.5}
        # Behind a body they are drawn empty.
        empty = {"markerfacecolor": "none", "markeredgecolor": "0.3", "markeredgewidth": 0.7}
        self.marked: list[tuple[Line2D, list[Array]]] = []
        self.behind: list[Line2D] = []
        for markers, style in (
            ([pin.place for pin in sketch.pins if pin.grounded], support),
            ([pin.place for pin in sketch.pins if not pin.slides], {**joint, "marker": "o", "markersize": 5}),
            ([pin.place for pin in sketch.pins if pin.slides], {**joint, "marker": "s", "markersize": 4.5}),
            (
                [Marker(b, (0.0, 0.0, 0.0)) for b in sketch.masses],
                {"color": "k", "marker": "o", "markersize": 10, "zorder": 4.5},
            ),
            (sketch.centers, {"color": "k", "marker": ".", "markersize": 7, "zorder": 4.5}),
        ):
            if markers:
                line, behind = (self.axes.plot([], [], linestyle="", **x)[0] for x in (style, {**style, **empty}))
                self.marked.append((line, [path(m, True) for m in markers]))
                self.behind.append(behind)
        self.ends = [(link.spring, path(link.first, True), path(link.second, True)) for link in sketch.links]

    def show(self, frame: int) -> None:
        """Move everything to its position in a frame."""
        view = self.view
        placed = [view.outline(number, frame) for number in range(len(view.sketch.pieces))]
        solids = {k: view.solid(k, solid, frame) for k, solid in self.solids.items()}
        everything = list(solids.values())
        self._show_faces(placed, solids)
        _set_lines(self.edges, self._edges(placed, solids))
        links: list[tuple[Array, float]] = []
        for spring, first, second in self.ends:
            ends = np.array([first[frame], second[frame]])
            # A short one is narrow, one between points that coincide is not seen.
            width = min(WIDEST * view.width, SLENDER * float(np.linalg.norm(ends[1] - ends[0])))
            shape = windings(ends, width, view.across, view.sketch.dimension) if spring else ends
            links += [(x, 1.0 if spring else 2.2) for x in self._visible(shape, everything)]
        _set_lines(self.links, links)
        for (line, paths), empty in zip(self.marked, self.behind, strict=True):
            places = np.array([path[frame] for path in paths])
            covered = self._covered(places, everything)
            line.set_data(*view.flat(places[~covered]).T)
            empty.set_data(*view.flat(places[covered]).T)
        for line, trail in zip(self.paths, view.traced.values(), strict=True):
            gone = trail[: FINE * frame + 1] - view.shift[frame]
            line.set_data(*np.where(self._covered(gone, everything), np.nan, view.flat(gone).T))
        if frame == 0 or view.follows:
            planes = (ground_lines(p, view, view.shift[frame]) for p in view.sketch.planes)
            self.ground.set_segments([line for lines in planes for line in lines])
        self.caption.set_text("\n".join(wrap(view.frames.captions[frame], self.letters)))

    def _show_faces(self, placed: Sequence[Outline], solids: dict[int, Solid]) -> None:
        """Fill the bodies, in space from the farthest on; in the plane with their lines."""
        view = self.view
        fills: list[tuple[Array, str, str, float]] = []
        rings = [k for k, outline in enumerate(placed) if outline.tube]
        for k in [*in_order(solids, view.across[2]), *rings] if solids else range(len(placed)):
            rims = placed[k].rims(view.across)
            if rims:
                fill = FILLS[view.sketch.pieces[k].body % len(FILLS)]
                # One line leads around, into the hole, and back.
                fills.append((np.concatenate([*rims, rims[0][-1:]]), fill, "none", 0.0))
            if rims and k not in solids:
                fills += [(rim, "none", "k", 1.1) for rim in rims]
            if not solids:
                fills += [(view.flat(x), "none", "k", placed[k].width) for x in placed[k].seen(view.across[2])]
        self.bodies.set_verts([shown[0] for shown in fills], closed=False)
        self.bodies.set_facecolor([shown[1] for shown in fills])
        self.bodies.set_edgecolor([shown[2] for shown in fills])
        self.bodies.set_linewidth([shown[3] for shown in fills])

    def _edges(self, placed: Sequence[Outline], solids: dict[int, Solid]) -> list[tuple[Array, float]]:
        """Return the visible lines of bodies in space, and their widths."""
        edges: list[tuple[Array, float]] = []
        pieces = self.view.sketch.pieces
        for k, outline in enumerate(placed) if solids else ():
            # A body without interior is drawn over the body it is fixed to.
            others = [x for j, x in solids.items() if j != k and (k in solids or pieces[j].body != pieces[k].body)]
            if k in solids:
                edges += [(x, 1.1) for x in self._visible(solids[k].rim, others)]
            for stroke in outline.seen(self.view.across[2]):
                edges += [(x, outline.width) for x in self._visible(stroke, others)]
        return edges

    def _covered(self, points: Array, solids: Sequence[Solid]) -> Any:
        """Return which points are behind solids; one inside a solid, such as a joint, is visible."""
        return hidden(points, solids, self.view.across[2], TOUCHING * self.view.width, inside=False)

    def _visible(self, line: Array, solids: Sequence[Solid]) -> list[Array]:
        """Return the visible parts of a line, shape (k, 3), in the view, each of shape (m, 2)."""
        view = self.view
        if not solids:
            return [view.flat(line)]
        steps = np.linalg.norm(np.diff(line, axis=0), axis=1)
        counts = np.maximum(np.ceil(steps * FRAGMENTS / view.width), 1).astype(int)
        parts = [a + (b - a) * np.arange(n)[:, None] / n for a, b, n in zip(line[:-1], line[1:], counts, strict=True)]
        fine = np.concatenate([*parts, line[-1:]])
        covered = hidden(0.5 * (fine[1:] + fine[:-1]), solids, view.across[2], TOUCHING * view.width)
        seen = view.flat(fine)
        changes = np.flatnonzero(np.diff(covered)) + 1
        bounds = [0, *changes.tolist(), len(covered)]
        return [seen[a : b + 1] for a, b in itertools.pairwise(bounds) if not covered[a]]

    def images(self) -> Iterator[Image.Image]:
        """Yield the frames as RGB images."""
        with house_style():
            self.canvas.draw()
            background = self.canvas.copy_from_bbox(self.figure.bbox)
            for frame in range(len(self.view.frames.captions)):
                self.show(frame)
                self.canvas.restore_region(background)
                for artist in self.artists:
                    self.axes.draw_artist(artist)
                yield Image.frombuffer("RGBA", self.canvas.get_width_height(), self.canvas.buffer_rgba()).convert("RGB")


def _path_style(number: int) -> dict[str, Any]:
    return {"color": INK[(number + 1) % len(INK)], "linestyle": DASHES[number % len(DASHES)], "linewidth": 1.3}


def _set_lines(collection: LineCollection, lines: Sequence[tuple[Array, float]]) -> None:
    collection.set_segments([x for x, _ in lines])
    collection.set_linewidth([width for _, width in lines])
