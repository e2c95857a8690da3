"""Real and imaginary parts of eigenvalues over a parameter."""

from __future__ import annotations

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from mbstab.analysis.sweep.sweep import Sweep
from mbstab.report.pictures.curves import BEYOND_INK, INK, THIN, draw_branch
from mbstab.report.pictures.drawing import draw_legend, house_style
from mbstab.report.pictures.over_parameter import branch_entries, legend_entries, panels_over_parameter
from mbstab.report.pictures.scales import Axis, set_real_scale, upward_range
from mbstab.report.pictures.sweep_curves import TINY, SweepCurves


def stability_map(result: Sweep, label: Axis | str, title: str) -> Figure:
    """Return real parts (solid) and imaginary parts (dashed) of all branches over the parameter.

    The lower panel shows the positive imaginary parts of conjugate pairs. Critical values are
    vertical lines, unstable ranges are shaded, eigenvalues to the right of the axis are thick.
    """
    label = Axis.read(label)
    with house_style():
        curves = SweepCurves(result, label)
        names = ("real part (1/s)", "imaginary part (rad/s)")
        figure, (upper, lower), unlabelled = panels_over_parameter(curves, title, names)
        upper.axhline(0.0, color="0.0", linewidth=0.8)
        for other in curves.others:
            for axes, part, dashed in ((upper, other.real, False), (lower, other.upper_half(), True)):
                for j in range(part.shape[1]):
                    draw_branch(axes, other.x, part[:, j], BEYOND_INK, other.growing[:, j], dashed)
        above = curves.upper_half()
        for axes, part, dashed in ((upper, curves.real, False), (lower, above, True)):
            for j in range(part.shape[1]):
                draw_branch(axes, curves.x, part[:, j], curves.ink[j], curves.growing[:, j], dashed)
        # Once for all real eigenvalues: overlapping dashes would look like a solid line.
        level = np.where(np.any(np.abs(curves.imag) <= TINY * curves.size, axis=1), 0.0, np.nan)
        draw_branch(lower, curves.x, level, INK[0], np.zeros(len(level), dtype=bool), True)
        set_real_scale(upper, "y", curves.all(lambda part: part.real), curves.size)
        heights = curves.all(SweepCurves.upper_half)
        lower.set_ylim(upward_range(np.append(heights.ravel(), level), curves.size))
        handles: list[Artist] = [
            Line2D([], [], color="k", linewidth=THIN, label="real part"),
            Line2D([], [], color="k", linewidth=THIN, linestyle="--", label="imaginary part (≥ 0)"),
        ]
        draw_legend(figure, handles + branch_entries(curves) + legend_entries(curves, unlabelled=unlabelled))
        return figure
