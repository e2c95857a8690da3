"""Common parts of all pictures: style, title, legend, and writing to a file.

Pictures can be read in grey too: curves differ in line style and width, regions in lightness, points in
their marker. Results are in SI units, pictures in declared units.
"""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import chain
from pathlib import Path
from textwrap import wrap

import matplotlib as mpl
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.transforms import ScaledTranslation

from mbstab.report.files import whole_file
from mbstab.report.picture_sizes import FONT, LONGEST, SIZES, scaled, size

FORMATS = ("png", "svg", "pdf")
"""Formats of `save`, by suffix."""

UNSTABLE_SHADE = "0.9"
"""Grey of unstable ranges."""

CRITICAL_STYLE = (0, (7, 2, 1.5, 2))
"""Dashes of lines that mark a limit: critical values, a tolerance."""

EXACT = 1e-17
"""Errors below this are random in double precision, and are drawn here."""

LEFT, RIGHT, BELOW = 0.85, 0.25, 0.5
"""Margins for numbers and labels (inches on a page)."""

FLATTER = 0.8
"""Panels half as wide as those of a page are 1/2 to this power as high."""


def save(figure: Figure, path: str | os.PathLike[str]) -> None:
    """Write a picture, completely or not at all; the same picture gives the same file.

    Parameters
    ----------
    figure : Figure
    path : path
        The suffix selects the format: ``.png``, ``.svg`` or ``.pdf``.

    Raises
    ------
    ValueError
        If the suffix is another one.
    OSError
        If the file cannot be written.
    """
    goal = Path(path).resolve()
    kind = goal.suffix[1:].lower()
    if kind not in FORMATS:
        raise ValueError(f"{path}: pictures end with {', '.join('.' + name for name in FORMATS)}")
    # None removes the entry, so that the file contains neither the date nor the library.
    metadata: dict[str, dict[str, None]] = {
        "png": {"Software": None},
        "svg": {"Date": None, "Creator": None},
        "pdf": {"Creator": None, "Producer": None, "CreationDate": None},
    }
    with whole_file(goal) as stream, house_style(), warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph ")  # a title in a script the font lacks
        figure.savefig(stream, format=kind, dpi=size().dpi if kind == "png" else 300, metadata=metadata[kind])


@contextmanager
def house_style() -> Iterator[None]:
    """Draw with the defaults of matplotlib, whatever the user's matplotlibrc says, and the settings of this module."""
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(
            {
                "font.size": scaled(FONT),
                "axes.labelsize": scaled(FONT + 0.5),
                "legend.fontsize": scaled(FONT - 0.5),
                "axes.formatter.limits": (-4, 5),
                "axes.formatter.useoffset": False,
                "axes.formatter.use_mathtext": True,
                "hatch.linewidth": 0.5,
                "pdf.fonttype": 42,
                "svg.fonttype": "path",
                "svg.hashsalt": "mbstab",
            }
        )
        yield


def titled_figure(
    title: str, heights: Sequence[float], above: float = 0.0, gap: float = 0.12, stretched: bool = True
) -> tuple[Figure, list[Axes]]:
    """Return a figure with panels below each other, room above them, and its title.

    `draw_legend` sets the room below the panels.

    Parameters
    ----------
    title : str
    heights : sequence of float
        Of the panels (inches on a page).
    above, gap : float
        Room above them and between them (inches on a page).
    stretched : bool
        Whether panels are lower where they are narrower. In a size with a height they fill it in any case.
    """
    wide = size().width
    lines = title_lines(title)[:3]
    top = scaled(0.25 + 0.2 * len(lines) + above)
    gaps = scaled(gap) * (len(heights) - 1)
    if size().height:
        part = (size().height - top - gaps - scaled(2.0 * BELOW)) / sum(heights)
    else:
        part = scaled((panel_width() / (SIZES["page"].width - LEFT - RIGHT)) ** FLATTER if stretched else 1.0)
    total = size().height or top + part * sum(heights) + gaps + scaled(BELOW)
    figure = Figure(figsize=(wide, total))
    panels, at = [], total - top
    for height in heights:
        at -= part * height
        panels.append(
            figure.add_axes((scaled(LEFT) / wide, at / total, scaled(panel_width()) / wide, part * height / total))
        )
        at -= scaled(gap)
    draw_title(figure, lines)
    return figure, panels


def picture_width() -> float:
    """Return the width of a picture (inches on a page)."""
    return size().width / scaled(1.0)


def picture_height() -> float:
    """Return the height of a picture (inches on a page), 0 if it is what the content needs."""
    return size().height / scaled(1.0)


def longest() -> float:
    """Return the largest height of a picture with many panels (inches on a page)."""
    return (size().height or LONGEST) / scaled(1.0)


def panel_width() -> float:
    """Return the width of a panel (inches on a page)."""
    return picture_width() - LEFT - RIGHT


def title_lines(title: str) -> list[str]:
    """Return the lines of a title that fit the width, as equally long as its words allow."""
    longest = int(picture_width() * 72.0 / (0.55 * (FONT + 2.0)))
    number = len(wrap(title, longest, break_on_hyphens=False))
    tried = (
        wrap(title, width, break_on_hyphens=False) for width in range(max(1, len(title) // max(number, 1)), longest + 1)
    )
    return next((lines for lines in tried if len(lines) == number), [])


def draw_title(figure: Figure, lines: Sequence[str]) -> None:
    """Write a title along the upper edge."""
    edge = figure.transFigure + ScaledTranslation(0.0, -scaled(0.1), figure.dpi_scale_trans)
    big = scaled(FONT + 2.0)
    figure.text(0.5, 1.0, "\n".join(lines), ha="center", va="top", fontsize=big, parse_math=False, transform=edge)


def draw_legend(figure: Figure, handles: Sequence[Artist], below: float = BELOW) -> None:
    """Draw a legend below the panels, set the room there, and fit the labels of axes to the panels.

    Lines and markers get the strength of the size. Between legend and panels there is the room ``below`` (inches on a
    page). What is placed by points, such as
    `PointLabels`, comes afterwards: in a size with a height, panels change.
    """
    high = add_legend(figure, handles)
    drawn = [*(axes.get_lines() for axes in figure.axes), *(legend.get_lines() for legend in figure.legends)]
    for line in chain.from_iterable(drawn):
        line.set_linewidth(scaled(line.get_linewidth()))
        line.set_markersize(scaled(line.get_markersize()))
    lines = max(_wrap_label(axes) for axes in figure.axes)
    _set_below(figure, scaled(below + 0.17 * (lines - 1)) + high)
    for axes in figure.axes:
        _fit_upright_label(axes)
    _set_left(figure)


def _fit_upright_label(axes: Axes) -> None:
    """Divide the label of the vertical axis into two lines if it is longer than the panel, or write it smaller."""
    long = 1.1 * 72.0 * axes.get_window_extent().height / axes.figure.dpi
    text, largest = axes.get_ylabel(), scaled(FONT + 0.5)
    lines = [text]
    if text_width(text, 0.85 * largest) > long:
        halves = (wrap(text, width, break_long_words=False) for width in range(len(text) // 2, len(text) + 1))
        lines = next(lines for lines in halves if len(lines) <= 2)
    axes.set_ylabel("\n".join(lines), fontsize=min(largest, *(long / text_width(line or " ", 1.0) for line in lines)))


def _set_left(figure: Figure) -> None:
    """Move the left edges of panels to the right if their numbers and labels would be cut off."""
    boxes = [axes.yaxis.get_tightbbox() for axes in figure.axes]
    missing = scaled(0.04) - min((box.x0 / figure.dpi for box in boxes if box is not None), default=math.inf)
    if missing > 0.0:
        part = missing / figure.get_figwidth()
        for axes in figure.axes:
            place = axes.get_position(original=True)
            axes.set_position((place.x0 + part, place.y0, place.width - part, place.height))


def _wrap_label(axes: Axes) -> int:
    """Divide the label of the horizontal axis into lines that fit; return their number."""
    wide = 72.0 * axes.get_window_extent().width / axes.figure.dpi + scaled(40.0)
    lines = wrap(axes.get_xlabel(), int(wide / text_width(" ", scaled(FONT + 0.5)))) or [""]
    axes.set_xlabel("\n".join(lines))
    return len(lines)


def add_legend(figure: Figure, handles: Sequence[Artist]) -> float:
    """Add a legend at the lower edge, in as many columns as fit; return its height (inches)."""
    for columns in range(min(len(handles), 3 if len(handles) <= 6 else 4), 0, -1):
        legend = figure.legend(
            handles=handles,
            loc="lower center",
            ncols=columns,
            frameon=False,
            handlelength=2.7,
            columnspacing=1.3,
            borderaxespad=0.3,
        )
        box = legend.get_window_extent()
        if box.width < 0.98 * figure.bbox.width or columns == 1:
            return float(box.height / figure.dpi)
        legend.remove()
    return 0.0


def _set_below(figure: Figure, room: float) -> None:
    """Set the room below the lowest panel (inches); panels keep their sizes, unless the picture has a height."""
    before = figure.get_figheight()
    places = [axes.get_position(original=True) for axes in figure.axes]
    low, high = (before * f(getattr(p, y) for p in places) for f, y in ((min, "y0"), (max, "y1")))
    total = before if size().height else before + room - low
    part = (total - before + high - room) / (high - low)
    for axes, place in zip(figure.axes, places, strict=True):
        bottom, top = (room + part * (before * y - low) for y in (place.y0, place.y1))
        axes.set_position((place.x0, bottom / total, place.width, (top - bottom) / total))
    figure.set_figheight(total)


def legend_marker(marker: str, size: float, text: str, ink: str = "k") -> Line2D:
    """Return the legend entry of a marker."""
    return Line2D([], [], color=ink, linestyle="", marker=marker, markersize=size, markerfacecolor="w", label=text)


def unstable_patch() -> Patch:
    """Return the legend entry of unstable ranges."""
    return Patch(facecolor=UNSTABLE_SHADE, edgecolor="0.6", linewidth=0.6, label="unstable range")


def no_answer_patch(text: str = "no answer") -> Patch:
    """Return the legend entry of a hatched part."""
    return Patch(facecolor="w", edgecolor="0.6", hatch="//////", linewidth=0.6, label=text)


def text_width(text: str, points: float) -> float:
    """Return the approximate width of a text (points)."""
    return 0.6 * points * len(text)
