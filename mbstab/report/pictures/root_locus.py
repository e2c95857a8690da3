"""Paths of eigenvalues in the complex plane."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from mbstab.analysis.sweep.sweep import Sweep
from mbstab.report.pictures.branch_labels import number_branches, number_entries
from mbstab.report.pictures.curves import BEYOND_INK, draw_branch
from mbstab.report.pictures.drawing import UNSTABLE_SHADE, draw_legend, house_style, legend_marker, titled_figure
from mbstab.report.pictures.over_parameter import branch_entries, legend_entries
from mbstab.report.pictures.point_labels import LABELS, PointLabels, label_entries
from mbstab.report.pictures.scales import Axis, axis_range, set_real_scale
from mbstab.report.pictures.spectrum import equal_damping, name_damping
from mbstab.report.pictures.sweep_curves import SweepCurves


def root_locus(result: Sweep, label: Axis | str, title: str) -> Figure:
    """Return the paths of the eigenvalues in the complex plane, with their starts, ends and critical points."""
    label = Axis.read(label)
    with house_style():
        curves = SweepCurves(result, label, turned=False)
        figure, (axes,) = titled_figure(title, heights=(5.0,), above=0.18)
        axes.set_xlabel("real part (1/s)")
        axes.set_ylabel("imaginary part (rad/s)")
        heights = [sign * c.frequency for group in curves.marked for c in group for sign in (1.0, -1.0)]
        bound = axis_range(np.append(curves.all(lambda part: part.imag), heights), curves.size)
        axes.set_ylim(bound)
        set_real_scale(axes, "x", curves.all(lambda part: part.real), curves.size)
        axes.axvspan(0.0, axes.get_xlim()[1], color=UNSTABLE_SHADE, linewidth=0, zorder=0)
        axes.axvline(0.0, color="0.5", linewidth=1.4, zorder=1.5)
        axes.axhline(0.0, color="0.6", linewidth=0.6, zorder=1)
        for path in (*curves.others, curves):
            inks = curves.ink if path is curves else [BEYOND_INK] * path.real.shape[1]
            for column, ink, growing in zip(path.paired().T, inks, path.growing.T, strict=True):
                for sign in (1.0, -1.0) if np.any(column.imag > 0.0) else (1.0,):
                    draw_branch(axes, column.real, sign * column.imag, ink, growing)
        for x, text in ((0.01, "stable side"), (0.99, "unstable side")):
            if axes.get_xlim()[0] < 0.0 or x > 0.5:
                side = "left" if x < 0.5 else "right"
                axes.text(x, 1.015, text, transform=axes.transAxes, ha=side, va="bottom", style="italic")
        handles = _draw_ends(axes, curves)
        oscillating = bool(np.nanmax(np.abs(curves.imag), initial=0.0) > 0.0)
        lines = equal_damping(axes) if oscillating and axes.get_xlim()[0] < 0.0 else []
        shown = curves.paired()
        numbers = number_branches(axes, result, curves, shown.real, shown.imag)
        labels = _draw_critical_points(axes, curves)
        if curves.marked:
            handles.append(legend_marker("D", 7.0, "critical value"))
        handles += branch_entries(curves) + number_entries(bool(numbers.wanted))
        labels.wanted += numbers.wanted
        handles += label_entries(labels.left_out())
        draw_legend(figure, handles + legend_entries(curves) + lines)
        labels.draw()
        name_damping(axes)
        return figure


def _draw_ends(axes: Axes, curves: SweepCurves) -> list[Artist]:
    """Mark the eigenvalues at the first and the last value of the parameter; return the legend entries."""
    known = np.flatnonzero(np.isfinite(curves.real).all(axis=1) & (curves.real.shape[1] > 0))
    ends = [(known[0], "x", 6.5, "k"), (known[-1], "s", 5.0, "k")] if len(known) else []
    handles: list[Artist] = []
    for row, marker, size, face in ends:
        style: dict[str, Any] = {"linestyle": "", "color": "k", "markersize": size, "markerfacecolor": face}
        axes.plot(curves.real[row], curves.imag[row], marker=marker, **style, zorder=5.5)
        text = curves.label.at(curves.show(curves.x[row]))
        handles.append(Line2D([], [], marker=marker, **style, label=text))
    return handles


def _draw_critical_points(axes: Axes, curves: SweepCurves) -> PointLabels:
    """Mark where eigenvalues reach the imaginary axis at critical values; return labels of the upper ones."""
    labels = PointLabels(axes)
    for group in curves.marked[:LABELS]:
        for height in sorted({c.frequency for c in group}):
            points = [height, -height] if height > 0.0 else [0.0]
            axes.plot([0.0] * len(points), points, "D", color="k", markersize=7, markerfacecolor="w", zorder=5)
            labels.add(0.0, height, curves.label.at(curves.show(group[0].value)))
    return labels
