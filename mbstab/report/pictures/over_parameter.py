"""Panels over the parameter of a sweep, with critical values and unstable ranges."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.textpath import TextPath
from matplotlib.transforms import ScaledTranslation

from mbstab.analysis.sweep.critical import Critical
from mbstab.report.picture_sizes import FONT, scaled
from mbstab.report.pictures.curves import BEYOND_INK, THICK, THIN, Mask
from mbstab.report.pictures.drawing import (
    CRITICAL_STYLE,
    UNSTABLE_SHADE,
    no_answer_patch,
    panel_width,
    titled_figure,
    unstable_patch,
)
from mbstab.report.pictures.scales import parameter_range, set_parameter_axis
from mbstab.report.pictures.sweep_curves import SweepCurves

HEIGHTS = ((4.4,), (2.7, 2.3), (2.0, 2.0, 2.0), (1.7,) * 4, (1.5,) * 5)
"""Of panels, by their number (inches on a page)."""

ROWS = 5
"""Rows of labels of critical values above a picture; values that do not fit have no label."""

Placed = tuple[list[Critical], str, float, int, float]
"""Critical values that share a label, the label, its place as a fraction of the width, its row, and the part of the
label above the line."""

CROSSED, ASIDE, LOST = 100.0, 0.5, 1e4
"""Cost of a pointer that crosses a label, of a label beside its line, and of one without room; a row costs 1."""

KEPT = 60
"""Arrangements of the labels so far that are followed."""

Arrangement = tuple[float, tuple[tuple[float, float, float, int], ...]]
"""Cost, and of each label the line (points), its left and right end, and its row; row -1 is none."""


def panels_over_parameter(
    curves: SweepCurves, title: str, names: Sequence[str], shaded: bool = True
) -> tuple[Figure, list[Axes], int]:
    """Return a figure, its panels over the parameter, and the number of critical values that have no label.

    Unless `shaded` is false, unstable ranges of the first path are.
    """
    labels = _placed(curves, *parameter_range(curves.points))
    rows = 1 + max((row for *_, row, _ in labels), default=-1)
    figure, panels = titled_figure(title, HEIGHTS[len(names) - 1], above=0.17 * rows)
    for axes, name in zip(panels, names, strict=True):
        axes.set_ylabel(name)
        set_parameter_axis(axes, "x", curves.label, curves.points)
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


def _placed(curves: SweepCurves, lo: float, hi: float) -> list[Placed]:
    """Return the labels of critical values that fit above the picture, placed so that pointers do not cross them."""
    wide = scaled(72.0 * panel_width())
    measure = math.log if curves.label.logarithmic else float
    texts: list[str] = []
    arrangements: list[Arrangement] = [(0.0, ())]
    for group in curves.marked:
        kinds = list(dict.fromkeys(c.kind for c in group))
        texts.append(
            f"{curves.show(group[0].value)} {', '.join(kinds)}" + (f" ({len(group)}×)" if len(group) > 1 else "")
        )
        line = (measure(group[0].value) - measure(lo)) / (measure(hi) - measure(lo)) * wide
        width = float(TextPath((0.0, 0.0), texts[-1], size=scaled(FONT - 0.5)).get_extents().width)
        longer = (next_ for one in arrangements for next_ in _with_label(one, line, width, wide))
        arrangements = sorted(longer, key=lambda one: one[0])[:KEPT]
    return [
        (group, text, 0.5 * (left + right) / wide, row, min(max((line - left) / (right - left), 0.0), 1.0))
        for group, text, (line, left, right, row) in zip(curves.marked, texts, arrangements[0][1], strict=True)
        if row >= 0
    ]


def _with_label(before: Arrangement, line: float, width: float, wide: float) -> Iterator[Arrangement]:
    """Yield the arrangements with one label more: above its line, or beginning or ending there, or left out."""
    cost, placed = before
    yield cost + LOST, (*placed, (line, line, line, -1))
    low, high = -scaled(30.0), wide + scaled(10.0)
    for shift in (-0.5, 0.0, -1.0):
        left = min(max(line + shift * width, low), high - width)
        aside = cost + ASIDE * (shift != -0.5)
        for row in range(ROWS):
            if all(other != row or end + scaled(8.0) < left for _, _, end, other in placed):
                crossed = sum(
                    (row > other >= 0 and start - 2.0 < line < end + 2.0)
                    or (other > row and left - 2.0 < pointer < left + width + 2.0)
                    for pointer, start, end, other in placed
                )
                yield aside + row + CROSSED * crossed, (*placed, (line, left, left + width, row))


def _write_labels(figure: Figure, axes: Axes, labels: Sequence[Placed]) -> None:
    """Write the labels of critical values above the upper panel; those of higher rows point to their lines."""
    style: dict[str, Any] = {"arrowstyle": "-", "linewidth": 0.5, "color": "0.5", "shrinkA": 0, "shrinkB": 0}
    for group, text, at, row, part in labels:
        up = ScaledTranslation(0.0, scaled(3.0 + 12.2 * row) / 72.0, figure.dpi_scale_trans)
        axes.annotate(
            text, (group[0].value, 1.0), (at, 1.0), xycoords=axes.get_xaxis_transform(),
            textcoords=axes.transAxes + up, ha="center", va="bottom", fontsize=scaled(FONT - 0.5),
            annotation_clip=False, arrowprops={**style, "relpos": (part, 0.0)} if row else None,
        )  # fmt: skip


def _every(path: SweepCurves) -> Mask:
    return np.ones_like(path.growing)


def branch_entries(curves: SweepCurves) -> list[Artist]:
    """Return the legend entries of branches with names: their colours, as styles of lines say something else."""
    return [
        Line2D([], [], linestyle="", marker="o", markersize=6.5, color=ink, label=name)
        for name, ink in curves.named.items()
    ]


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
        handles.append(unstable_patch())
    for low, high in (unsure for path in (curves, *curves.others) for unsure in path.unsure):
        text = f"{curves.label.name} from {curves.show(low)} to {curves.show(high)}: branches uncertain"
        handles.append(Line2D([], [], linestyle="", marker="$?$", color="k", markersize=7.0, label=text))
    if unlabelled is not None and np.any(curves.unanswered):
        handles.append(no_answer_patch(curves.gap))
    return handles
