"""Frequencies over a parameter, with excitation lines."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from mbstab.analysis.sweep.sweep import Sweep
from mbstab.compiler.system import Array
from mbstab.report.pictures.curves import BEYOND_INK, THIN, decimated, draw_branch
from mbstab.report.pictures.drawing import draw_legend, house_style, legend_marker
from mbstab.report.pictures.over_parameter import legend_entries, panels_over_parameter
from mbstab.report.pictures.point_labels import LABELS, PointLabels
from mbstab.report.pictures.scales import Axis, number_text, upward_range
from mbstab.report.pictures.sweep_curves import SweepCurves


def campbell(result: Sweep, label: Axis | str, title: str) -> Figure:
    """Return the frequencies of all branches over the parameter, with lines of its orders and their crossings.

    Parameters
    ----------
    result : Sweep
    label : Axis or str
        The parameter; as text with its declared unit, such as ``omega (rpm)``.
    title : str
    """
    label = Axis.read(label)
    with house_style():
        curves = SweepCurves(result, label)
        figure, (axes,), unlabelled = panels_over_parameter(curves, title, ("frequency (Hz)",))
        for other in curves.others:
            for column, growing in zip(other.upper_half().T, other.growing.T, strict=True):
                draw_branch(axes, other.x, column / (2.0 * math.pi), BEYOND_INK, growing)
        frequency = curves.upper_half() / (2.0 * math.pi)
        for j in range(frequency.shape[1]):
            draw_branch(axes, curves.x, frequency[:, j], curves.ink[j], curves.growing[:, j])
        axes.set_ylim(upward_range(curves.all(SweepCurves.upper_half) / (2.0 * math.pi), curves.size / (2.0 * math.pi)))
        handles: list[Artist] = [Line2D([], [], color="k", linewidth=THIN, label="frequency of a mode")]
        if result.orders:
            handles += _draw_orders(axes, result, curves)
        draw_legend(figure, handles + legend_entries(curves, frequency > 0.0, unlabelled))
        return figure


_LINE: dict[str, Any] = {"color": "0.25", "linewidth": 1.1}
MARKERS = {"forward": ("^", "crossing, forward whirl"), "backward": ("v", "crossing, backward whirl")}
"""Marker of crossings by whirl, and its text."""


def _draw_orders(axes: Axes, result: Sweep, curves: SweepCurves) -> list[Artist]:
    """Draw the lines of orders and their crossings; return the legend entries."""
    label, labels, style = curves.label, PointLabels(axes), _LINE
    dots: Any = (0, (1.5, 1.8))
    for order in result.orders:
        line = order * np.abs(curves.x) * label.factor / (2.0 * math.pi)
        axes.plot(*decimated(curves.x, line), linestyle=dots, zorder=2, **style)
        _name_excitation(labels, curves.x, line, f"{order:g}×")
    handles: list[Artist] = [Line2D([], [], linestyle=dots, label=f"orders of {label.name}", **style)]
    shown: dict[str, Artist] = {}
    for c in result.crossings:
        marker, text = MARKERS.get(c.whirl, ("o", "crossing"))
        at = c.value / label.factor, c.frequency / (2.0 * math.pi)
        axes.plot(*at, marker, color="k", markersize=6.5, markerfacecolor="w", zorder=5)
        shown.setdefault(text, legend_marker(marker, 6.5, text))
        if len(labels.wanted) < LABELS:
            labels.add(*at, f"{number_text(at[0], curves.span, 4)}")
    labels.draw()
    return handles + list(shown.values())


def _name_excitation(labels: PointLabels, x: Array, line: Array, text: str) -> None:
    """Write the name of an excitation line where it leaves the picture, on the right or on the left."""
    inside = np.flatnonzero((line <= labels.axes.get_ylim()[1]) & ((x > 0.0) | (x[-1] <= 0.0)))
    if len(inside):
        k = inside[int(0.95 * (len(inside) - 1))] if x[-1] > 0.0 else inside[len(inside) // 20]
        labels.add(float(x[k]), float(line[k]), text, marked=False)
