"""Shapes of modes as a picture: the extremes of each mode over the reference."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon

from mbstab.analysis.simulate.mode_shape import Swing
from mbstab.analysis.spectrum.results import Eigenvalue
from mbstab.compiler.system import Array, System
from mbstab.errors import UsageError
from mbstab.mechanics.catalogue import Marker
from mbstab.report.animation.backdrop import ground_lines
from mbstab.report.animation.frames import still_frames
from mbstab.report.animation.sketch import Sketch
from mbstab.report.animation.view import View
from mbstab.report.modes import motions_text, value_text
from mbstab.report.picture_sizes import FONT, scaled
from mbstab.report.pictures.curves import INK
from mbstab.report.pictures.drawing import (
    draw_legend,
    draw_title,
    house_style,
    longest,
    picture_height,
    picture_width,
    text_width,
    title_lines,
)

LINE, HEAD, BELOW, SIDE, GAP = 0.25, 0.5, 0.45, 0.25, 0.3
"""Room for a line of the title, heading of a panel, legend, beside and between panels (inches on a page)."""

FLATTEST, TALLEST = 1.2, 3.6
"""Limits of the height of a panel (inches on a page)."""

NARROW = 5.0
"""Panels of narrower pictures are in one column (inches on a page)."""

TOLD = 2
"""Motions of a mode that are named above its picture, if they fit."""

STYLES = (("0.78", 1.0), (INK[1], 0.7), (INK[0], 1.3))
"""Ink and width of the reference and of both extremes."""


def mode_stills(system: System, modes: Mapping[int, Eigenvalue], swings: Sequence[Swing], title: str) -> Figure:
    """Return the extremes of modes, exaggerated, in a panel each, all from the same side and of the same scale.

    Parameters
    ----------
    system : System
    modes : mapping of int to Eigenvalue
        By their numbers.
    swings : sequence of Swing
        Of the same modes, at four instants.

    Raises
    ------
    UsageError
        If there are no modes with a shape.
    """
    if not modes:
        raise UsageError("--plot modes: no mode has a shape in which a body moves")
    frames = still_frames(swings)
    view = View(Sketch.of(system), frames)
    with house_style():
        ratio = (view.high - view.low)[1] / (view.high - view.low)[0]
        lines = title_lines(title)[:3]
        above = 0.05 + LINE * len(lines)
        heads = [_heading(number, mode) for number, mode in modes.items()]
        columns, wide, tall = _panel(len(modes), ratio, above, max(text_width(head, FONT - 0.5) for head in heads))
        rows = -(-len(modes) // columns)
        width, total = picture_width(), above + rows * (tall + HEAD) + BELOW
        figure = Figure(figsize=(scaled(width), scaled(total)))
        draw_title(figure, lines)
        view.fit(wide, tall)
        for n, mode in enumerate(modes.values()):
            row, column = divmod(n, columns)
            # The panels of the last row stand in the middle.
            missing = rows * columns - len(modes) if row == rows - 1 else 0
            left, low = SIDE + (column + 0.5 * missing) * (wide + GAP), total - above - (row + 1) * (tall + HEAD)
            axes = figure.add_axes((left / width, low / total, wide / width, tall / total))
            _draw(axes, view, (0, 2 * n + 2, 2 * n + 1))
            motions = (motions_text(mode.motions[:told]) for told in range(TOLD, 0, -1))
            fitting = next((text for text in motions if text_width(text, FONT - 0.5) < 80.0 * (wide + GAP)), "")
            axes.set_title(f"{heads[n]}\n{fitting}", fontsize=scaled(FONT - 0.5), pad=3.0)
        texts = ("reference", "other extreme", "extreme, exaggerated")
        handles = [
            Line2D([], [], color=ink, linewidth=1.4 * width, label=text)
            for (ink, width), text in zip(STYLES, texts, strict=True)
        ]
        draw_legend(figure, [handles[0], *handles[:0:-1]], 0.12)
        return figure


def _heading(number: int, mode: Eigenvalue) -> str:
    """Return number, name and eigenvalue of a mode."""
    name = f"{mode.name}, " if mode.name else ""
    return f"{number}: {name}{value_text(mode)} 1/s".replace("-", "\N{MINUS SIGN}")


def _panel(count: int, ratio: float, above: float, head: float) -> tuple[int, float, float]:
    """Return the number of columns of so many panels, and the width and height of one (inches on a page).

    In a size with a height, and where panels would be higher than a page, it is the number for which what has a height
    `ratio` times its width is largest. Headings, `head` points wide, fit their panels.
    """

    def width(columns: int) -> float:
        return (picture_width() - 2.0 * SIDE - GAP * (columns - 1)) / columns

    def height(columns: int) -> float:
        below = BELOW if picture_height() else 1.3 * BELOW  # a legend of two lines
        return (longest() - above - below) / -(-count // columns) - HEAD

    def needed(columns: int) -> float:
        return float(np.clip(width(columns) * ratio, FLATTEST, TALLEST))

    columns = 1 if picture_width() < NARROW else 2
    if not picture_height() and needed(columns) <= height(columns):
        return columns, width(columns), needed(columns)
    fitting = [n for n in range(1, count + 1) if n == 1 or head < 80.0 * (width(n) + GAP)]
    best = max(fitting, key=lambda columns: min(ratio * width(columns), height(columns)))
    return best, width(best), max(height(best) if picture_height() else min(height(best), needed(best)), 0.1)


def _draw(axes: Axes, view: View, frames: Sequence[int]) -> None:
    """Draw the bodies, rods, springs and point masses of some frames over each other."""
    axes.set_xlim(view.low[0], view.high[0])
    axes.set_ylim(view.low[1], view.high[1])
    axes.set_aspect("equal")
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set_color("0.8")
    sketch = view.sketch
    for plane in sketch.planes:
        lines = ground_lines(plane, view, np.zeros(3))
        axes.add_collection(LineCollection(lines, colors="0.85", linewidths=0.6, zorder=1), autolim=False)
    for layer, (frame, (ink, width)) in enumerate(zip(frames, STYLES, strict=True), 2):

        def draw(line: Array, wide: float, ink: str = ink, layer: int = layer) -> None:
            axes.plot(*view.flat(line).T, color=ink, linewidth=wide, zorder=layer, solid_capstyle="round")

        for number in range(len(sketch.pieces)):
            outline = view.outline(number, frame)
            for corners in outline.rims(view.across):
                axes.add_patch(Polygon(corners, fill=False, edgecolor=ink, linewidth=width, zorder=layer))
            for stroke in outline.seen(view.across[2]):
                draw(stroke, 0.7 * width * outline.width)
        for link in sketch.links:
            ends = np.array([view.path(link.first)[frame], view.path(link.second)[frame]])
            draw(ends, (0.6 if link.spring else 1.5) * width)
        pins = [pin.place for pin in sketch.pins]
        for markers, size in ((pins, 3.0), ([Marker(b, (0.0, 0.0, 0.0)) for b in sketch.masses], 6.5)):
            places = np.array([view.path(m)[frame] for m in markers]).reshape(len(markers), 3)
            axes.plot(*view.flat(places).T, "o", color=ink, markersize=size, zorder=layer)
