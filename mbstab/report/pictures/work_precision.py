"""Error against time of eigenvalue methods and of integrators."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from mbstab.analysis.linear.methods import METHODS
from mbstab.report.picture_sizes import FONT, scaled
from mbstab.report.pictures.drawing import (
    CRITICAL_STYLE,
    EXACT,
    draw_legend,
    house_style,
    legend_marker,
    titled_figure,
)
from mbstab.report.pictures.point_labels import PointLabels

if TYPE_CHECKING:
    from mbstab.analysis.compare.integrators import Integrations
    from mbstab.analysis.compare.methods import Comparison, Outcome


def work_precision(result: Comparison, title: str) -> Figure:
    """Return error against time, one numbered point for each method or number of digits, with the bound it claimed."""
    with house_style():
        figure, (axes,) = titled_figure(title, heights=(4.4,))
        axes.set_xscale("log")
        axes.set_yscale("log")
        points: dict[int, tuple[float, float]] = {}
        smaller = False
        for n, x in enumerate(result.outcomes, 1):
            if not math.isfinite(x.error):
                continue
            floor = _floor(x, result.tolerance)
            time, error, below = 1e3 * x.seconds, max(x.error, floor), x.error < floor
            points[n], smaller = (time, error), smaller or below
            if math.isfinite(x.bound) and x.bound > error:
                axes.plot([time, time], [error, x.bound], color="0.6", linewidth=1.0, zorder=2)
                axes.plot(time, x.bound, "_", color="0.6", markersize=8, zorder=2)
            face = "k" if x is result.chosen else "w"
            axes.plot(time, error, "v" if below else "o", color="k", markersize=6, markerfacecolor=face, zorder=4)
        handles: list[Artist] = [
            legend_marker("o", 6.0, "largest error"),
            Line2D([], [], color="0.6", label="up to the claimed bound"),
        ]
        if smaller:
            handles.append(legend_marker("v", 6.0, "smaller than drawn"))
        if result.chosen is not None:
            handles.append(Line2D([], [], color="k", linestyle="", marker="o", markersize=6, label="chosen"))
        if result.tolerance is not None:
            axes.axhline(result.tolerance, color="k", linewidth=1.0, linestyle=CRITICAL_STYLE, zorder=1)
            handles.append(Line2D([], [], color="k", linewidth=1.0, linestyle=CRITICAL_STYLE, label="tolerance"))
        rounding = float(np.max(result.rounding, initial=0.0))
        if rounding > EXACT:
            axes.axhline(rounding, color="0.4", linewidth=1.0, linestyle=":", zorder=1)
            handles.append(Line2D([], [], color="0.4", linewidth=1.0, linestyle=":", label="rounding of the data"))
        axes.set_xlabel("time (ms); of digits from the file, of the others from the reference motion")
        axes.set_ylabel("largest relative error of an eigenvalue")
        draw_legend(figure, handles)
        _decades(axes, list(points.values()), len(result.outcomes))
        labels = PointLabels(axes)
        for n, (time, error) in points.items():
            labels.add(time, error, str(n))
        labels.draw()
        lines = [f"{n}  {x.method}{_missing(x, result.tolerance)}" for n, x in enumerate(result.outcomes, 1)]
        # No method is both fast and accurate: the lower left corner is free.
        axes.text(
            0.02,
            0.03,
            "\n".join(lines),
            transform=axes.transAxes,
            ha="left",
            va="bottom",
            fontsize=scaled(FONT),
            zorder=6,
        )
        return figure


def integrator_precision(result: Integrations, title: str) -> Figure:
    """Return global error against time, one line for each integrator, a point for each tolerance."""
    looks = (("o", "-"), ("s", "-"), ("^", "--"), ("v", "--"), ("D", ":"), ("P", ":"))
    with house_style():
        figure, (axes,) = titled_figure(title, heights=(4.4,))
        axes.set_xscale("log")
        axes.set_yscale("log")
        handles: list[Artist] = []
        names = list(dict.fromkeys(x.name for x in result.runs))
        for name, (marker, style) in zip(names, looks, strict=False):
            points = [(1e3 * x.seconds, max(x.error, EXACT)) for x in result.runs if x.name == name and not x.failure]
            look: dict[str, Any] = {"color": "k", "linewidth": 1.0, "linestyle": style, "marker": marker}
            look |= {"markersize": 6, "markerfacecolor": "w"}
            if points:
                axes.plot(*zip(*points, strict=True), **look)
                handles.append(Line2D([], [], label=name, **look))
        if result.chosen is not None:
            chosen: dict[str, Any] = {"color": "k", "linestyle": "", "marker": "o", "markersize": 3}
            axes.plot(1e3 * result.chosen.seconds, max(result.chosen.error, EXACT), **chosen, zorder=5)
            handles.append(Line2D([], [], **chosen, label="chosen"))
        if result.tolerance is not None:
            axes.axhline(result.tolerance, color="k", linewidth=1.0, linestyle=CRITICAL_STYLE, zorder=1)
            handles.append(Line2D([], [], color="k", linewidth=1.0, linestyle=CRITICAL_STYLE, label="tolerance"))
        if result.known > EXACT:
            axes.axhline(result.known, color="0.4", linewidth=1.0, linestyle=":", zorder=1)
            handles.append(Line2D([], [], color="0.4", linewidth=1.0, linestyle=":", label="reference (estimate)"))
        axes.set_xlabel("time of a run (ms)")
        axes.set_ylabel(f"global error until t = {result.end:g} s")
        draw_legend(figure, handles)
        return figure


def _floor(x: Outcome, tolerance: float | None) -> float:
    """Return the error at which smaller ones are drawn: many digits would squeeze the others to a line."""
    if x.method in METHODS or tolerance is None or tolerance > EXACT:
        return EXACT
    return float(max(10.0 ** -(1 + int(x.method.split()[0])), 1e-300))


def _missing(x: Outcome, tolerance: float | None) -> str:
    if x.failure:
        return ": no answer"
    if x.method not in METHODS and x.error < _floor(x, tolerance):
        return f": {x.error:.0e}".replace("-", "\N{MINUS SIGN}")
    parts = [f"{count} {what}" for count, what in ((x.lost, "lost"), (x.invented, "invented")) if count]
    return f": {', '.join(parts)}" if parts else ""


def _decades(axes: Axes, points: Sequence[tuple[float, float]], entries: int) -> None:
    """Set logarithmic limits that leave room for labels beside the points and for a list in the lower left corner."""
    if not points:
        return
    times = [time for time, _ in points]
    lower, upper = float(axes.dataLim.y0), float(axes.dataLim.y1)
    span = max(math.log10(max(times) / min(times)), 1.0)
    axes.set_xlim(min(times) * 10.0 ** (-0.12 * span), max(times) * 10.0 ** (0.12 * span))
    lowest_there = min(error for time, error in points if time < min(times) * 10.0 ** (0.5 * span))
    high = 72.0 * axes.get_window_extent().height / axes.figure.dpi
    part = min(1.3 * scaled(FONT) * (entries + 1.5) / high, 0.8)  # of the height, for the list
    top = math.log10(upper) + 1.0
    bottom = min(math.log10(lower) - 1.0, (math.log10(lowest_there) - part * top) / (1.0 - part))
    axes.set_ylim(10.0 ** max(bottom, -306.0), 10.0**top)
