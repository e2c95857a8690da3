"""Panels over the parameter of a sweep, with critical values and unstable ranges."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.transforms import ScaledTranslation

from mbstab.analysis.sweep.critical import Critical
from mbstab.report.picture_sizes import FONT, scaled
from mbstab.report.pictures.curves import BEYOND_INK, THICK, THIN, Mask
from mbstab.report.pictures.drawing import (
    CRITICAL_STYLE,
    UNSTABLE_SHADE,
    no_answer_patch,
    panel_width,
    text_width,
    titled_figure,
)
from mbstab.report.pictures.scales import parameter_range, set_parameter_axis
from mbstab.report.pictures.sweep_curves import SweepCurves

HEIGHTS = ((4.4,), (2.7, 2.3), (2.0, 2.0, 2.0), (1.7,) * 4, (1.5,) * 5)
"""Of panels, by their number (inches on a page)."""

ROWS = 5
"""Rows of labels of critical values above a picture; values that do not fit have no label."""

Placed = tuple[list[Critical], str, float, int]
"""Critical values that share a label, the label, its place as a fraction of the width, and its row."""


def panels_over_parameter(
    curves: SweepCurves, title: str, names: Sequence[str], shaded: bool = True, spaced: bool = False
) -> tuple[Figure, list[Axes], int]:
    """Return a figure, its panels over the parameter, and the number of critical values that have no label.

    Unless `shaded` is false, unstable ranges of the first path are. If `spaced` is true, the axis of the parameter is
    logarithmic where its label says so.
    """
    label = curves.label if spaced else replace(curves.label, logarithmic=False)
    labels = _placed(curves, *parameter_range(curves.points), label.logarithmic)
    rows = 1 + max((row for *_, row in labels), default=-1)
    figure, panels = titled_figure(title, HEIGHTS[len(names) - 1], above=0.17 * rows)
    for axes, name in zip(panels, names, strict=True):
        axes.set_ylabel(name)
        set_parameter_axis(axes, "x", label, curves.points)
        for a, b, state in curves.ranges():
            if state < 0:
                axes.axvspan(a, b, facecolor="none", edgecolor="0.6", hatch="////", linewidth=0, zorder=0)
            elif shaded:
                axes.axvspan(a, b, color=UNSTABLE_SHADE, linewidth=0, zorder=0)
        for group in curves.marked:
            axes.axvline(group[0].value, color="k", linewidth=1.0, linestyle=CRITICAL_STYLE, zorder=1.5)
    panels[-1].set_xlabel(curves.label.text)
    for axes in panels[:-1]:
        axes.tick_params(which="both", labelbottom=False)
    _write_labels(figure, panels[0], labels)
    if not curves.real.shape[1] or np.all(np.isnan(curves.real)):
        panels[0].text(0.5, 0.5, "no eigenvalues to show", transform=panels[0].transAxes, ha="center")
    return figure, panels, len(curves.marked) - len(labels)


def _placed(curves: SweepCurves, lo: float, hi: float, logarithmic: bool) -> list[Placed]:
    """Return the labels of critical values that fit above the picture."""
    wide = scaled(72.0 * panel_width())
    ends = [-math.inf] * ROWS
    measure = math.log if logarithmic else float
    places: list[Placed] = []
    for group in curves.marked:
        kinds = list(dict.fromkeys(c.kind for c in group))
        text = f"{curves.show(group[0].value)} {', '.join(kinds)}" + (f" ({len(group)}×)" if len(group) > 1 else "")
        half = 0.5 * text_width(text, scaled(FONT - 0.5))
        along = (measure(group[0].value) - measure(lo)) / (measure(hi) - measure(lo)) * wide
        at = min(max(along, half - scaled(30.0)), wide - half + scaled(10.0))
        row = next((k for k in range(ROWS) if ends[k] + scaled(8.0) < at - half), None)
        if row is not None:
            ends[row] = at + half
            places.append((group, text, at / wide, row))
    return places


def _write_labels(figure: Figure, axes: Axes, labels: Sequence[Placed]) -> None:
    """Write the labels of critical values above the upper panel; those of higher rows point to their lines."""
    pointer: dict[str, Any] = {"arrowstyle": "-", "linewidth": 0.5, "color": "0.5", "shrinkA": 0, "shrinkB": 0}
    for group, text, at, row in labels:
        up = ScaledTranslation(0.0, scaled(3.0 + 12.2 * row) / 72.0, figure.dpi_scale_trans)
        axes.annotate(
            text, (group[0].value, 1.0), (at, 1.0), xycoords=axes.get_xaxis_transform(),
            textcoords=axes.transAxes + up, ha="center", va="bottom", fontsize=scaled(FONT - 0.5),
            annotation_clip=False, arrowprops=pointer if row else None,
        )  # fmt: skip


def _every(path: SweepCurves) -> Mask:
    return np.ones_like(path.growing)


def branch_entries(curves: SweepCurves) -> list[Artist]:
    """Return the legend entries of branches with names."""
    return [Line2D([], [], color=ink, linewidth=THIN, label=name) for name, ink in curves.named.items()]


def legend_entries(
    curves: SweepCurves, seen: Callable[[SweepCurves], Mask] = _every, unlabelled: int | None = None
) -> list[Artist]:
    """Return the legend entries of the paths of eigenvalues, and of the panels over the parameter if there are any.

    Parameters
    ----------
    curves : SweepCurves
    seen : callable, optional
        Returns which eigenvalues of a path the picture shows, shape (n, r); all if it is missing.
    unlabelled : int, optional
        In panels over the parameter, the number of critical values without a label.
    """
    handles: list[Artist] = []
    if any(np.any(path.growing & seen(path)) for path in (curves, *curves.others)):
        handles.append(Line2D([], [], color="k", linewidth=THICK, label="unstable eigenvalue"))
    if unlabelled is not None and curves.marked:
        text = "critical value" + (f" ({unlabelled} without label)" if unlabelled else "")
        handles.append(Line2D([], [], color="k", linewidth=1.0, linestyle=CRITICAL_STYLE, label=text))
    if curves.others:
        handles.append(Line2D([], [], color=BEYOND_INK, linewidth=THIN, label="further paths"))
    if unlabelled is not None and np.any(curves.unstable > 0):
        handles.append(Patch(facecolor=UNSTABLE_SHADE, edgecolor="0.6", linewidth=0.6, label="unstable range"))
    for low, high in (unsure for path in (curves, *curves.others) for unsure in path.unsure):
        text = f"{curves.label.name} from {curves.show(low)} to {curves.show(high)}: branches uncertain"
        handles.append(Line2D([], [], linestyle="", marker="$?$", color="k", markersize=7.0, label=text))
    if unlabelled is not None and np.any(curves.unanswered):
        handles.append(no_answer_patch(curves.gap))
    return handles
