"""What moves each eigenvalue most: bars for its change with one percent of each parameter."""

from __future__ import annotations

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from mbstab.analysis.spectrum.sensitivity import Derivatives, Sensitivities
from mbstab.errors import counted
from mbstab.report.modes import value_text
from mbstab.report.picture_sizes import FONT, scaled
from mbstab.report.pictures.drawing import draw_legend, house_style, longest, titled_figure
from mbstab.report.pictures.scales import with_minus_sign

PANELS, BARS, FEW = 6, 8, 4
"""The largest number of eigenvalues that are drawn, those that decay least, and of parameters for each; `FEW` at least,
and then as many eigenvalues as fit."""

EDGE, BAR, GAP = 0.08, 0.22, 0.48
"""Room at the edges of a panel, for a parameter, and between panels, where eigenvalues have their names (inches on a
page)."""

BESIDE = 1.45
"""Room for title and legend (inches on a page)."""

NAME = 13
"""Characters of a parameter that fit beside a panel."""


def sensitivity_bars(found: Sensitivities, title: str) -> Figure:
    """Return a panel for each eigenvalue with derivatives: bars for the real and the imaginary part of its change.

    Parameters that are zero have no percent and no bar; neither have those that do not move the eigenvalue.
    """
    panels: list[tuple[Derivatives, list[int]]] = []
    for item in found.derivatives:
        order = [k for k in found.order(item) if abs(item.slopes[k]) > item.errors[k] and found.values[k]]
        if order:
            panels.append((item, order))
    drawn = _fitting(panels[:PANELS])
    eigenvalues = len(panels) - len(drawn)
    parameters = sum(len(order) for _, order in panels[: len(drawn)]) - sum(len(order) for _, order in drawn)
    panels = drawn
    with house_style():
        heights = [2.0 * EDGE + BAR * len(order) for _, order in panels] or [1.0]
        figure, axes = titled_figure(title, heights, above=0.2, gap=GAP, stretched=False)
        for panel, (item, order) in zip(axes, panels, strict=False):
            e = found.eigenvalue(item)
            change = 0.01 * item.slopes[order] * found.values[order]
            rows = np.arange(len(order))
            pair = e.value.imag != 0.0
            panel.barh(rows - 0.19 * pair, change.real, 0.36 if pair else 0.5, color="0.15", zorder=3)
            if pair:
                panel.barh(rows + 0.19, change.imag, 0.36, facecolor="w", edgecolor="0.15", hatch="/////", zorder=3)
            names = [found.parameters[k] for k in order]
            panel.set_yticks(rows, [x if len(x) <= NAME else f"{x[: NAME - 1]}…" for x in names], parse_math=False)
            panel.set_ylim(len(order) - 0.5 + EDGE / BAR, -0.5 - EDGE / BAR)
            reach = 1.08 * max(np.max(np.abs(change.real)), np.max(np.abs(change.imag)))
            panel.set_xlim(-reach, reach)
            panel.locator_params(axis="x", nbins=5)
            panel.axvline(0.0, color="k", linewidth=0.8, zorder=4)
            panel.grid(axis="x", color="0.85", linewidth=0.6)
            panel.tick_params(axis="y", length=0)
            text = f"{e.name}{': ' if e.name else ''}{with_minus_sign(value_text(e))} 1/s"
            panel.set_title(text, loc="left", fontsize=scaled(FONT), pad=scaled(3.0), parse_math=False)
        if not panels:
            axes[0].text(0.5, 0.5, "no eigenvalue has derivatives", transform=axes[0].transAxes, ha="center")
            axes[0].set_yticks([])
        axes[-1].set_xlabel("change of the eigenvalue with one percent more of a parameter (1/s)")
        handles: list[Artist] = [
            Patch(facecolor="0.15", label="real part: damping"),
            Patch(facecolor="w", edgecolor="0.15", hatch="/////", label="imaginary part: frequency"),
        ]
        left_out = [counted(eigenvalues, "eigenvalue")] * (eigenvalues > 0)
        left_out += [f"{counted(parameters, 'bar')} of less effect"] * (parameters > 0)
        if left_out:
            handles.append(Line2D([], [], linestyle="none", label=f"not drawn: {', '.join(left_out)}"))
        draw_legend(figure, handles)
        return figure


def _fitting(panels: list[tuple[Derivatives, list[int]]]) -> list[tuple[Derivatives, list[int]]]:
    """Return the first eigenvalues with the first of their parameters, as many as fit a page."""

    def high(count: int, bars: int) -> float:
        return sum(GAP + 2.0 * EDGE + BAR * min(len(order), bars) for _, order in panels[:count])

    room = longest() - BESIDE + GAP
    shapes = [(len(panels), bars) for bars in range(BARS, FEW, -1)] + [(n, FEW) for n in range(len(panels), 1, -1)]
    count, bars = next((shape for shape in shapes if high(*shape) <= room), (1, FEW))
    return [(item, order[:bars]) for item, order in panels[:count]]
