"""Frequencies over a parameter, with excitation lines."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.artist import Artist
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


def campbell(result: Sweep, label: Axis | str, title: str, excitations: Sequence[float] = (1.0,)) -> Figure:
    """Return the frequencies of all branches over the parameter.

    Parameters
    ----------
    result : Sweep
    label : Axis or str
        The parameter; as text with its declared unit, such as ``omega (rpm)``.
    title : str
    excitations : sequence of float
        Multiples n of the parameter whose lines n·|parameter|/2π are drawn if it is an
        angular velocity; crossings with branches are marked.
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
        if label.turns and excitations:
            labels = PointLabels(axes)
            crossings = []
            for n in excitations:
                line = abs(n) * np.abs(curves.x) * label.factor / (2.0 * math.pi)
                axes.plot(*decimated(curves.x, line), color="0.25", linewidth=1.1, linestyle=(0, (1.5, 1.8)), zorder=2)
                _name_excitation(labels, curves.x, line, f"{n:g}×")
                crossings += _crossings(curves.x, frequency, line)
            crossings.sort()
            for x, y in crossings[:LABELS]:
                labels.add(x, y, f"{label.name} = {number_text(x, curves.span, 4)}")
            if crossings:
                axes.plot(*zip(*crossings, strict=True), "o", color="k", markersize=6, markerfacecolor="w", zorder=5)
            labels.draw()
            text = f"n× {label.name}"
            handles.append(Line2D([], [], color="0.25", linewidth=1.1, linestyle=(0, (1.5, 1.8)), label=text))
            if crossings:
                handles.append(legend_marker("o", 6.0, "crossing"))
        draw_legend(figure, handles + legend_entries(curves, frequency > 0.0, unlabelled))
        return figure


def _crossings(x: Array, frequency: Array, line: Array) -> list[tuple[float, float]]:
    """Return the crossings of branches with an excitation line, each once; not those where both are zero."""
    found: list[tuple[float, float]] = []
    top = float(np.nanmax(frequency)) if frequency.size and not np.all(np.isnan(frequency)) else 0.0
    span = float(np.ptp(x)) if len(x) else 0.0
    with np.errstate(invalid="ignore"):
        gap = frequency - line[:, None]
        passed = (gap[:-1] * gap[1:] < 0.0) | ((gap[:-1] == 0.0) & (gap[1:] != 0.0))
    for i, j in zip(*np.nonzero(passed), strict=True):
        part = float(gap[i, j] / (gap[i, j] - gap[i + 1, j]))
        at = (float(x[i] + part * (x[i + 1] - x[i])), float(line[i] + part * (line[i + 1] - line[i])))
        new = all(abs(at[0] - a) > 1e-4 * span or abs(at[1] - b) > 1e-4 * top for a, b in found)
        if at[1] > 1e-6 * top and new:
            found.append(at)
    return found


def _name_excitation(labels: PointLabels, x: Array, line: Array, text: str) -> None:
    """Write the name of an excitation line where it leaves the picture, on the right or on the left."""
    inside = np.flatnonzero((line <= labels.axes.get_ylim()[1]) & ((x > 0.0) | (x[-1] <= 0.0)))
    if len(inside):
        k = inside[int(0.95 * (len(inside) - 1))] if x[-1] > 0.0 else inside[len(inside) // 20]
        labels.add(float(x[k]), float(line[k]), text, marked=False)
