"""Common parts of all pictures: style, title, legend, and writing to a file.

Pictures can be read in grey too: curves differ in line style and width, regions in lightness, points in
their marker. Results are in SI units, pictures in declared units.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
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

FORMATS = ("png", "svg", "pdf")
"""Formats of `save`, by suffix."""

UNSTABLE_SHADE = "0.9"
"""Grey of unstable ranges."""

CRITICAL_STYLE = (0, (7, 2, 1.5, 2))
"""Dashes of lines that mark a limit: critical values, a tolerance."""

FONT = 9.0
"""Size of text (points)."""

EXACT = 1e-17
"""Errors below this are random in double precision, and are drawn here."""

WIDTH, LEFT, RIGHT = 7.2, 0.85, 0.25
"""Width of a picture and of its margins (inches)."""

BELOW = 0.5
"""Room below the panels for numbers and a label (inches)."""


def save(figure: Figure, path: str | os.PathLike[str]) -> None:
    """Write a picture, completely or not at all; the same picture gives the same file.

    Parameters
    ----------
    figure : Figure
    path : path
        The suffix selects the format: ``.png`` (150 dpi), ``.svg`` or ``.pdf``.

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
        figure.savefig(stream, format=kind, dpi=150 if kind == "png" else 300, metadata=metadata[kind])


@contextmanager
def house_style() -> Iterator[None]:
    """Draw with the defaults of matplotlib, whatever the user's matplotlibrc says, and the settings of this module."""
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(
            {
                "font.size": FONT,
                "axes.labelsize": FONT + 0.5,
                "axes.formatter.limits": (-4, 5),
                "axes.formatter.useoffset": False,
                "hatch.linewidth": 0.5,
                "pdf.fonttype": 42,
                "svg.fonttype": "path",
                "svg.hashsalt": "mbstab",
            }
        )
        yield


def titled_figure(
    title: str, heights: Sequence[float], above: float = 0.0, gap: float = 0.12
) -> tuple[Figure, list[Axes]]:
    """Return a figure with panels (heights and gap in inches) below each other, room above them, and its title.

    `draw_legend` sets the room below the panels.
    """
    lines = wrap(title, 80)[:3]
    top = 0.15 + 0.2 * len(lines) + above + 0.1
    total = top + sum(heights) + gap * (len(heights) - 1) + BELOW
    figure = Figure(figsize=(WIDTH, total))
    panels, at = [], total - top
    for height in heights:
        at -= height
        panels.append(figure.add_axes((LEFT / WIDTH, at / total, (WIDTH - LEFT - RIGHT) / WIDTH, height / total)))
        at -= gap
    draw_title(figure, lines)
    return figure, panels


def draw_title(figure: Figure, lines: Sequence[str]) -> None:
    """Write a title along the upper edge."""
    edge = figure.transFigure + ScaledTranslation(0.0, -0.1, figure.dpi_scale_trans)
    figure.text(
        0.5, 1.0, "\n".join(lines), ha="center", va="top", fontsize=FONT + 2.0, parse_math=False, transform=edge
    )


def draw_legend(figure: Figure, handles: Sequence[Artist]) -> None:
    """Draw a legend below the panels, and set the room there."""
    _set_below(figure, BELOW + add_legend(figure, handles))


def add_legend(figure: Figure, handles: Sequence[Artist]) -> float:
    """Add a legend at the lower edge, in as many columns as fit; return its height (inches)."""
    for columns in range(min(len(handles), 3 if len(handles) <= 6 else 4), 0, -1):
        legend = figure.legend(
            handles=handles,
            loc="lower center",
            ncols=columns,
            frameon=False,
            handlelength=3.2,
            columnspacing=1.5,
            borderaxespad=0.3,
        )
        box = legend.get_window_extent()
        if box.width < 0.98 * figure.bbox.width or columns == 1:
            return float(box.height / figure.dpi)
        legend.remove()
    return 0.0


def _set_below(figure: Figure, room: float) -> None:
    """Set the room below the lowest panel (inches); panels keep their sizes."""
    before = figure.get_figheight()
    places = [axes.get_position(original=True) for axes in figure.axes]
    more = room - before * min(place.y0 for place in places)
    total = before + more
    for axes, place in zip(figure.axes, places, strict=True):
        low, high = (before * y + more for y in (place.y0, place.y1))
        axes.set_position((place.x0, low / total, place.width, (high - low) / total))
    figure.set_figheight(total)


def legend_marker(marker: str, size: float, text: str) -> Line2D:
    """Return the legend entry of a marker."""
    return Line2D([], [], color="k", linestyle="", marker=marker, markersize=size, markerfacecolor="w", label=text)


def no_answer_patch(text: str = "no answer") -> Patch:
    """Return the legend entry of a hatched part."""
    return Patch(facecolor="w", edgecolor="0.6", hatch="//////", linewidth=0.6, label=text)


def text_width(text: str, size: float) -> float:
    """Return the approximate width of a text (points)."""
    return 0.6 * size * len(text)
