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
    """Return a figure with panels (heights and gap in inches) below each other, room above them, and its title."""
    lines = wrap(title, 80)[:3]
    top = 0.15 + 0.2 * len(lines) + above + 0.1
    bottom = 1.05
    total = top + sum(heights) + gap * (len(heights) - 1) + bottom
    figure = Figure(figsize=(WIDTH, total))
    panels, at = [], total - top
    for height in heights:
        at -= height
        panels.append(figure.add_axes((LEFT / WIDTH, at / total, (WIDTH - LEFT - RIGHT) / WIDTH, height / total)))
        at -= gap
    figure.text(0.5, 1.0 - 0.1 / total, "\n".join(lines), ha="center", va="top", fontsize=FONT + 2.0, parse_math=False)
    return figure, panels


def draw_legend(figure: Figure, handles: Sequence[Artist], columns: int = 0) -> None:
    """Draw a legend below the panels, with so many columns; 0: as many as short texts need."""
    columns = columns or (3 if len(handles) <= 6 else 4)
    figure.legend(
        handles=handles,
        loc="lower center",
        ncols=columns,
        frameon=False,
        handlelength=3.2,
        columnspacing=1.5,
        borderaxespad=0.3,
    )


def legend_marker(marker: str, size: float, text: str) -> Line2D:
    """Return the legend entry of a marker."""
    return Line2D([], [], color="k", linestyle="", marker=marker, markersize=size, markerfacecolor="w", label=text)


def no_answer_patch(text: str = "no answer") -> Patch:
    """Return the legend entry of a hatched part."""
    return Patch(facecolor="w", edgecolor="0.6", hatch="//////", linewidth=0.6, label=text)


def text_width(text: str, size: float) -> float:
    """Return the approximate width of a text (points)."""
    return 0.6 * size * len(text)
