"""Real and imaginary parts of eigenvalues over a parameter."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from mbstab.analysis.sweep.sweep import Sweep
from mbstab.compiler.system import Array
from mbstab.report.pictures.branch_labels import number_branches, number_entries
from mbstab.report.pictures.curves import BEYOND_INK, INK, THIN, draw_branch
from mbstab.report.pictures.drawing import draw_legend, house_style
from mbstab.report.pictures.over_parameter import branch_entries, legend_entries, panels_over_parameter
from mbstab.report.pictures.point_labels import PointLabels, label_entries
from mbstab.report.pictures.scales import Axis, set_real_scale, upward_range
from mbstab.report.pictures.sweep_curves import TINY, SweepCurves


def _real(curves: SweepCurves) -> Array:
    return curves.real


def _imag(curves: SweepCurves) -> Array:
    return curves.imag


def _draw(axes: Axes, curves: SweepCurves, part: Callable[[SweepCurves], Array], dashed: bool) -> None:
    """Draw a part of all branches, those of the other paths in grey below."""
    for path in (*curves.others, curves):
        inks = curves.ink if path is curves else [BEYOND_INK] * path.real.shape[1]
        for column, ink, growing in zip(part(path).T, inks, path.growing.T, strict=True):
            draw_branch(axes, path.x, column, ink, growing, dashed)


def stability_map(result: Sweep, label: Axis | str, title: str) -> Figure:
    """Return real parts (solid) and imaginary parts (dashed) of all branches over the parameter.

    The lower panel shows the positive imaginary parts of conjugate pairs; a panel with nothing but zeros is left out
    with a word. Critical values are
    vertical lines, unstable ranges are shaded, eigenvalues to the right of the axis are thick.
    """
    label = Axis.read(label)
    with house_style():
        curves = SweepCurves(result, label)
        still, real = (
            bool(np.nanmax(np.abs(curves.all(part)), initial=0.0) <= TINY * curves.size) for part in (_real, _imag)
        )
        shown = [name for name, empty in (("real", still and not real), ("imaginary", real)) if not empty]
        names = [{"real": "real part (1/s)", "imaginary": "imaginary part (rad/s)"}[name] for name in shown]
        figure, panels, unlabelled = panels_over_parameter(curves, title, names)
        by_name = dict(zip(shown, panels, strict=True))
        handles: list[Artist] = []
        numbers: list[PointLabels] = []
        x = curves.x[:, None]
        if upper := by_name.get("real"):
            upper.axhline(0.0, color="0.0", linewidth=0.8)
            _draw(upper, curves, _real, False)
            set_real_scale(upper, "y", curves.all(_real), curves.size)
            numbers.append(number_branches(upper, result, curves, x, curves.real))
            handles.append(Line2D([], [], color="k", linewidth=THIN, label="real part"))
        if lower := by_name.get("imaginary"):
            _draw(lower, curves, SweepCurves.upper_half, True)
            # Once for all real eigenvalues: overlapping dashes would look like a solid line.
            level = np.where(np.any(np.abs(curves.imag) <= TINY * curves.size, axis=1), 0.0, np.nan)
            draw_branch(lower, curves.x, level, INK[0], np.zeros(len(level), dtype=bool), True)
            heights = curves.all(SweepCurves.upper_half)
            lower.set_ylim(upward_range(np.append(heights.ravel(), level), curves.size))
            numbers.append(number_branches(lower, result, curves, x, curves.upper_half()))
            handles.append(Line2D([], [], color="k", linewidth=THIN, linestyle="--", label="imaginary part (≥ 0)"))
        for name in {"real", "imaginary"} - by_name.keys():
            handles.append(Line2D([], [], linestyle="", label=f"all {name} parts are 0"))
        left_out = label_entries([label for labels in numbers for label in labels.left_out()])
        handles += branch_entries(curves) + number_entries(any(labels.wanted for labels in numbers)) + left_out
        draw_legend(figure, handles + legend_entries(curves, unlabelled=unlabelled))
        for labels in numbers:
            labels.draw()
        return figure
