"""Frequencies over a parameter, with excitation lines."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from mbstab.analysis.sweep.sweep import Sweep
from mbstab.compiler.system import Array
from mbstab.errors import UsageError, counted
from mbstab.report.pictures.branch_labels import add_branches
from mbstab.report.pictures.curves import BEYOND_INK, INK, THIN, Mask, draw_branch
from mbstab.report.pictures.drawing import draw_legend, house_style, legend_marker
from mbstab.report.pictures.over_parameter import legend_entries, panels_over_parameter
from mbstab.report.pictures.point_labels import LABELS, Label, PointLabels, label_entries
from mbstab.report.pictures.scales import Axis, decade, number_text, set_logarithmic, upward_range
from mbstab.report.pictures.sweep_curves import TINY, SweepCurves

SQUEEZED = 10.0
"""The axis is logarithmic if the highest frequency is so many times the highest of another branch."""

WHIRL_INK = {"forward": "#1f5fa8", "backward": "#b03a2e", "mixed": "#6a3d9a"}
"""Colours of the parts of branches with a sense of whirl, and of the markers of crossings."""

WHIRL_TEXT = {**{word: f"{word} whirl" for word in WHIRL_INK}, "": "no whirl"}
"""What the legend says about branches."""


def campbell(result: Sweep, label: Axis | str, title: str, highest: float = math.inf) -> Figure:
    """Return the frequencies of all branches over the parameter, with lines of its orders and their crossings.

    Parameters
    ----------
    result : Sweep
    label : Axis or str
        The parameter; as text with its declared unit, such as ``omega (rpm)``.
    title : str
    highest : float
        End of the axis of frequencies (Hz); if it is not given, all are shown.

    Raises
    ------
    UsageError
        If no eigenvalue oscillates, or none up to that frequency.
    """
    label = Axis.read(label)
    with house_style():
        curves = SweepCurves(result, label)
        heights = curves.all(SweepCurves.upper_half)
        if not np.any(heights > 0.0) and not np.all(np.isnan(curves.real)):
            raise UsageError(
                f"--plot campbell: no eigenvalue oscillates between {label.at(curves.show(curves.points[0]))} and "
                f"{curves.show(curves.points[-1])}\nhint: --plot map shows the real parts"
            )
        if math.isfinite(highest) and not np.any((heights > 0.0) & (heights <= 2.0 * math.pi * highest)):
            lowest = float(np.min(heights[heights > 0.0], initial=math.inf)) / (2.0 * math.pi)
            raise UsageError(f"--max-frequency {highest:g}: the lowest frequency is {lowest:.6g} Hz")
        if any(result.whirls):
            curves.ink = [WHIRL_INK.get(word, INK[0]) for word in result.whirls]
        figure, (axes,), unlabelled = panels_over_parameter(curves, title, (_head(result),))
        for other in curves.others:
            for column, growing in zip(other.upper_half().T, other.growing.T, strict=True):
                draw_branch(axes, other.x, column / (2.0 * math.pi), BEYOND_INK, growing)
        frequency = curves.upper_half() / (2.0 * math.pi)
        frequency[:, np.nanmin(frequency, axis=0, initial=math.inf) > highest] = np.nan
        for j in range(frequency.shape[1]):
            for shown, ink in _parts(result, curves, j):
                draw_branch(axes, curves.x, np.where(shown, frequency[:, j], np.nan), ink, curves.growing[:, j])
        if math.isfinite(highest):
            axes.set_ylim(0.0, highest)
        else:
            _set_scale(axes, heights / (2.0 * math.pi), curves.size / (2.0 * math.pi))
        handles = _branch_entries(result, frequency)
        labels = PointLabels(axes)
        add_branches(labels, result, curves, (curves.x[:, None], frequency), "branch ")
        unwritten = 0
        if result.orders:
            entries, unwritten = _draw_orders(labels, result, curves)
            handles += entries
        handles += _without_room(labels.left_out(), unwritten)
        draw_legend(figure, handles + legend_entries(curves, _oscillates, unlabelled))
        labels.draw()
        return figure


def _branch_entries(result: Sweep, frequency: Array) -> list[Artist]:
    """Return the legend entries of branches: by their whirl, where some have one."""
    texts = {"": (INK[0], "frequency of a branch")}
    drawn = {""}
    if any(result.whirls):
        texts = {word: (WHIRL_INK.get(word, INK[0]), text) for word, text in WHIRL_TEXT.items()}
        drawn = {part[2] for j in np.flatnonzero(np.any(frequency > 0.0, axis=0)) for part in result.senses[j]}
    return [
        Line2D([], [], color=ink, linewidth=THIN, label=text) for word, (ink, text) in texts.items() if word in drawn
    ]


def _parts(result: Sweep, curves: SweepCurves, branch: int) -> list[tuple[Mask, str]]:
    """Return the parts of a branch with their colours: those of one sense of whirl, which meet where it changes."""
    if not any(result.whirls):
        return [(np.ones(len(curves.x), dtype=bool), curves.ink[branch])]
    found = []
    for low, high, word in result.senses[branch]:
        first, last = np.searchsorted(curves.x, np.array([low, high]) / curves.label.factor)
        shown = np.zeros(len(curves.x), dtype=bool)
        shown[max(0, first - 1) : last + 1] = True
        found.append((shown, WHIRL_INK.get(word, INK[0])))
    return found


def _head(result: Sweep) -> str:
    """Return the label of the axis, which says so if an observer at rest sees other frequencies."""
    return f"frequency{' in the turning frame' if result.turning else ''} (Hz)"


def _oscillates(path: SweepCurves) -> Mask:
    return path.upper_half() > 0.0


def _set_scale(axes: Axes, frequency: Array, largest: float) -> None:
    """Set the axis of frequencies: logarithmic if branches would be compressed at its lower end."""
    highest = np.max(np.nan_to_num(frequency), axis=0, initial=0.0)
    top = float(np.max(highest, initial=0.0))
    low = float(np.min(highest[highest > TINY * largest], initial=top))
    if low * SQUEEZED < top:
        set_logarithmic(axes, "y", decade(low, top), 0.0, top)
        axes.set_ylim(bottom=0.0)  # no frequency is negative
    else:
        axes.set_ylim(upward_range(frequency, largest))


ROOM = 0.4
"""Part of the panel that each crossing with a number has (square inches); those of orders near 1 come first."""

STANDS, DISLIKED = 9, 60.0
"""Places at which an order may have its name, and the cost of one so many lengths of the line from the best."""

_LINE: dict[str, Any] = {"color": "0.25", "linewidth": 1.1}
MARKERS = {
    "forward": ("^", "crossing, forward whirl"),
    "backward": ("v", "crossing, backward whirl"),
    "mixed": ("D", "crossing, mixed whirl"),
}
"""Marker of crossings by whirl, and its text."""


def _without_room(labels: Sequence[Label], crossings: int) -> list[Artist]:
    """Return the legend entries of branches whose labels have no room, and the number of crossings without value."""
    crossings += sum(1 + label.text.count(",") for label in labels if label.marked)
    handles = label_entries([label for label in labels if not label.marked])
    if crossings:
        text = f"{counted(crossings, 'crossing')} without {'its' if crossings == 1 else 'their'} value"
        handles.append(Line2D([], [], linestyle="none", label=text))
    return handles


def _draw_orders(labels: PointLabels, result: Sweep, curves: SweepCurves) -> tuple[list[Artist], int]:
    """Draw the lines of orders and their crossings; return the legend entries, and how many have no value."""
    axes, label, style = labels.axes, curves.label, _LINE
    dots: Any = (0, (1.5, 1.8))
    x = (np.geomspace if label.logarithmic else np.linspace)(*axes.get_xlim(), 2001)  # bent by a logarithmic axis
    for order in result.orders:
        line = order * np.abs(x) * label.factor / (2.0 * math.pi)
        axes.plot(x, line, linestyle=dots, zorder=2, **style)
        _name_excitation(labels, x, line, f"{order:g}×")
    handles: list[Artist] = [Line2D([], [], linestyle=dots, label=f"orders of {label.name}", **style)]
    shown: dict[str, Artist] = {}
    written: set[tuple[str, str]] = set()
    extent, dpi = axes.get_window_extent(), axes.figure.dpi
    most, left_out = len(labels.wanted) + int(extent.width * extent.height / (ROOM * dpi**2)), 0
    for c in sorted(result.crossings, key=lambda c: (abs(math.log(c.order)), c.value)):
        marker, text = MARKERS.get(c.whirl, ("o", "crossing"))
        at = c.value / label.factor, c.frequency / (2.0 * math.pi)
        if at[1] > axes.get_ylim()[1]:
            continue
        ink = WHIRL_INK.get(c.whirl, "k")
        axes.plot(*at, marker, color=ink, markersize=6.5, markerfacecolor="w", zorder=5)
        shown.setdefault(text, legend_marker(marker, 6.5, text, ink))
        number = f"{number_text(at[0], curves.span, 4)}"
        # Branches that coincide cross a line together.
        here = number, number_text(at[1], curves.size / (2.0 * math.pi), 4)
        if here in written:
            continue
        if len(labels.wanted) < min(LABELS, most):
            labels.add(*at, number)
            written.add(here)
        else:
            left_out += 1
    return [*handles, *shown.values()], left_out


def _name_excitation(labels: PointLabels, x: Array, line: Array, text: str) -> None:
    """Write the name of an excitation line where it leaves the picture, on the right or on the left."""
    inside = np.flatnonzero((line <= labels.axes.get_ylim()[1]) & ((x > 0.0) | (x[-1] <= 0.0)))
    if len(inside):
        parts = np.linspace(0.95, 0.55, STANDS)
        at = inside[((parts if x[-1] > 0.0 else 1.0 - parts) * (len(inside) - 1)).astype(int)]
        labels.add_along(np.column_stack([x[at], line[at]]), DISLIKED * (0.95 - parts), text)
