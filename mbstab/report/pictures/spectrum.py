"""Eigenvalues in the complex plane, with their bounds and lines of equal damping and frequency; multipliers."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle

from mbstab.analysis.algebra.arrays import Complex
from mbstab.analysis.spectrum.results import EigenResult, Eigenvalue
from mbstab.compiler.system import Array
from mbstab.report.picture_sizes import FONT, scaled
from mbstab.report.pictures.curves import INK
from mbstab.report.pictures.drawing import UNSTABLE_SHADE, draw_legend, house_style, text_width, titled_figure
from mbstab.report.pictures.point_labels import LABELS, PIECE, PointLabels, drawn_points, meet
from mbstab.report.pictures.scales import SQUEEZED, axis_range, decade, number_text, set_logarithmic, set_real_scale
from mbstab.report.pictures.sweep_curves import TINY

DAMPING = (0.05, 0.1, 0.2, 0.4, 0.7)
"""Damping ratios whose lines are drawn."""

FAINT: dict[str, Any] = {"color": "0.72", "linewidth": 0.7, "linestyle": (0, (1.5, 2.0)), "zorder": 1}
"""Style of the lines of equal damping and frequency."""

FLAT = 5.0
"""Real parts are drawn logarithmically if the largest is this many times the decade of the imaginary parts."""

RAY = "damping ratio "
"""Mark of the lines of equal damping ratio, before the ratio."""

APART = 5.0
"""Room between the ratios and other texts (points)."""

OSCILLATES = 0.1
"""Part of the modulus above which an imaginary part matters to the scale."""

UNLIKE = 0.2
"""Real parts differ if they do so by this fraction."""

MARKERS = {
    "decays": ("o", INK[0], INK[0]),
    "grows": ("s", INK[1], INK[1]),
    "on the axis": ("D", "w", INK[0]),
    "undecided": ("o", "w", INK[0]),
    "critical": ("P", INK[1], INK[1]),
    "neutral": ("x", INK[0], INK[0]),
}
"""Marker, face and edge by what an eigenvalue says."""


def spectrum(result: EigenResult, title: str) -> Figure:
    """Return the eigenvalues, or for a periodic motion the multipliers, in the complex plane.

    Discs that contain the eigenvalues are drawn where they are large enough to be seen.
    """
    with house_style():
        figure, (axes,) = titled_figure(title, heights=(5.0,), above=0.18)
        listed = [e for e in result.eigenvalues if not e.exact]
        if result.period is None:
            values = np.array([e.value for e in result.eigenvalues], dtype=complex)
            handles = _plane(axes, values, [e for e in listed if e.value.imag])
        else:
            values = np.array([e.multiplier or 0j for e in result.eigenvalues], dtype=complex)
            handles = _circle(axes, values)
        for said, (marker, face, edge) in MARKERS.items():
            own = [i for i, e in enumerate(result.eigenvalues) if _said(e, result.period is not None) == said]
            if own:
                style: dict[str, Any] = {
                    "linestyle": "",
                    "markerfacecolor": face,
                    "markeredgecolor": edge,
                    "markersize": 6.5,
                }
                axes.plot(values[own].real, values[own].imag, marker, **style, zorder=5)
                text = f"{said}, {len(own)}×" if said in ("neutral", "critical") else said
                text = text.replace("axis", "axis" if result.period is None else "circle")
                handles.append(Line2D([], [], marker=marker, **style, label=text))
        for e, value in zip(result.eigenvalues, values.tolist(), strict=True):
            if math.isfinite(e.error_bound):
                axes.add_patch(Circle((value.real, value.imag), e.error_bound, fill=False, edgecolor="0.3", zorder=4))
        if any(0.004 * np.ptp(axes.get_ylim()) < e.error_bound < math.inf for e in listed):
            handles.append(Line2D([], [], linestyle="", marker="o", color="0.3", markerfacecolor="none", markersize=9.0,
                                  label="contains the eigenvalue"))  # fmt: skip
        labels = PointLabels(axes)
        for e, value in zip(result.eigenvalues, values.tolist(), strict=True):
            if e.name and value.imag >= 0.0 and len(labels.wanted) < LABELS:
                labels.add(value.real, value.imag, e.name)
        draw_legend(figure, handles)
        labels.draw()
        name_damping(axes)
        return figure


def _said(e: Eigenvalue, periodic: bool) -> str:
    """Return what an eigenvalue says, a key of `MARKERS`."""
    if e.exact or e.kind == "undecided":
        return e.kind
    if e.kind == "center":
        return "on the axis"
    side = abs(e.multiplier or 0j) - 1.0 if periodic else e.value.real
    return "grows" if side > 0.0 else "decays"


def _plane(axes: Axes, values: Complex, pairs: list[Eigenvalue]) -> list[Artist]:
    """Draw axes of the plane, and lines of equal damping and frequency if there are pairs."""
    axes.set_xlabel("real part (1/s)")
    axes.set_ylabel("imaginary part (rad/s)")
    size = float(np.max(np.abs(values), initial=0.0)) or 1.0
    _set_scales(axes, values, size)
    axes.axvspan(0.0, axes.get_xlim()[1], color=UNSTABLE_SHADE, linewidth=0, zorder=0)
    axes.axvline(0.0, color="0.5", linewidth=1.4, zorder=1.5)
    axes.axhline(0.0, color="0.6", linewidth=0.6, zorder=1)
    for at, text in ((0.01, "stable side"), (0.99, "unstable side")):
        axes.text(at, 1.015, text, transform=axes.transAxes, ha="left" if at < 0.5 else "right", va="bottom",
                  style="italic")  # fmt: skip
    return equal_damping(axes) if pairs else []


def equal_damping(axes: Axes) -> list[Artist]:
    """Draw lines of equal damping ratio and frequency; return the legend entries. `name_damping` writes the ratios."""
    reach = 2.0 * math.hypot(axes.get_ylim()[1], axes.get_xlim()[0])
    out = np.concatenate([[0.0], np.geomspace(1e-9 * reach, reach, 600)])
    for ratio in DAMPING:
        x, y = -ratio * out, math.sqrt(1.0 - ratio**2) * out
        for sign in (-1.0, 1.0):
            axes.plot(x, sign * y, **FAINT, scalex=False, scaley=False, gid=f"{RAY}{ratio:g}")
    # Close to the axes too, where logarithmic scales magnify.
    beside = np.geomspace(1e-9, 0.25 * math.pi, 120)
    angles = 0.5 * math.pi + np.concatenate([[0.0], beside, 0.5 * math.pi - beside[::-1], [0.5 * math.pi]])
    angles = np.concatenate([angles, 2.0 * math.pi - angles[::-1]])
    for radius in (tick for tick in axes.get_yticks() if 0.0 < tick < reach):
        axes.plot(radius * np.cos(angles), radius * np.sin(angles), **FAINT, scalex=False, scaley=False)
    return [Line2D([], [], **{k: v for k, v in FAINT.items() if k != "zorder"}, label="equal damping ratio, modulus")]


def name_damping(axes: Axes) -> None:
    """Write the damping ratios on their lines, where they hide neither curves nor other texts; below, if there is room.

    Call it when the picture has its size and its other texts.
    """
    scale = 72.0 / axes.figure.dpi
    busy = drawn_points(axes)
    boxes = [text.get_window_extent() for text in axes.texts]
    taken = [(scale * box.x0, scale * box.y0, scale * box.x1, scale * box.y1) for box in boxes]
    named: set[str] = set()
    rays = [(str(line.get_gid())[len(RAY) :], line) for line in axes.get_lines() if str(line.get_gid()).startswith(RAY)]
    for text, line in sorted(rays, key=lambda ray: -float(ray[0])):  # of each ratio the lower one is first
        if text in named:
            continue
        wide, tall = 0.5 * text_width(text, scaled(FONT - 2.0)) + 2.0, 0.5 * scaled(FONT - 2.0) + 2.0
        for x, y in _along(axes, line).tolist():
            box = (x - wide, y - tall, x + wide, y + tall)
            near = (box[0] - APART, box[1] - APART, box[2] + APART, box[3] + APART)
            if ((busy > box[:2]) & (busy < box[2:])).all(axis=1).any() or any(meet(near, other) for other in taken):
                continue
            u, v = axes.transAxes.inverted().transform((x / scale, y / scale)).tolist()
            axes.text(u, v, text, transform=axes.transAxes, fontsize=scaled(FONT - 2.0), color="0.4",
                      ha="center", va="center", zorder=2,
                      bbox={"boxstyle": "square,pad=0.1", "facecolor": "w", "linewidth": 0})  # fmt: skip
            taken.append(box)
            named.add(text)
            break


def _along(axes: Axes, line: Line2D) -> Array:
    """Return places (typographical points) on the outer part of a line from 0 in the panel, from its end inwards."""
    points = axes.transData.transform(line.get_xydata())
    part = axes.transAxes.inverted().transform(points)
    points = points[((part > (0.06, 0.035)) & (part < 0.965)).all(axis=1)] * (72.0 / axes.figure.dpi)
    if len(points) < 2:
        return np.zeros((0, 2))
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    even = np.arange(way[-1], 0.4 * way[-1], -PIECE)
    return np.column_stack([np.interp(even, way, values) for values in points.T])


def _set_scales(axes: Axes, values: Complex, size: float) -> None:
    """Set the axes of the plane; one is logarithmic if eigenvalues would otherwise hide each other."""
    parts = values[values.imag >= 0.0].view(float)
    seen: Complex = np.where(np.abs(parts) > TINY * size, parts, 0.0).view(complex)
    above = seen.imag[seen.imag > OSCILLATES * np.abs(seen)]
    high, low = float(np.max(above, initial=0.0)), float(np.min(above, initial=math.inf))
    if high > SQUEEZED * low:
        set_logarithmic(axes, "y", decade(low, high), -high, high)
    else:
        axes.set_ylim(axis_range(values.imag, size))
    threshold = 10.0 * decade(high, high) if high else math.inf  # the pairs are in the linear range
    if size < FLAT * threshold:
        threshold = _hidden(seen)
    if threshold:
        set_logarithmic(axes, "x", threshold, float(np.min(values.real)), float(np.max(values.real)))
    else:
        set_real_scale(axes, "x", values.real[None, :], size)


def _hidden(seen: Complex) -> float:
    """Return the decade of real parts that differ but would hide each other on linear axes; 0 if there are none."""
    real = np.abs(seen.real)
    wide, tall = float(np.max(real, initial=0.0)), float(np.max(seen.imag, initial=0.0))
    larger = np.maximum.outer(real, real)
    apart = np.abs(np.subtract.outer(seen.real, seen.real))
    level = np.abs(np.subtract.outer(seen.imag, seen.imag)) * SQUEEZED <= tall
    found = larger[level & (apart * SQUEEZED < wide) & (apart > UNLIKE * larger)]
    return decade(float(np.min(found)), wide) if found.size else 0.0


def _circle(axes: Axes, values: Complex) -> list[Artist]:
    """Draw the unit circle of multipliers."""
    axes.set_xlabel("real part of the multiplier")
    axes.set_ylabel("imaginary part of the multiplier")
    axes.add_patch(Circle((0.0, 0.0), 1.0, facecolor="none", edgecolor="0.5", linewidth=1.4, zorder=1.5))
    reach = 1.15 * max(1.0, float(np.max(np.abs(values), initial=0.0)))
    axes.set_xlim(-reach, reach)
    axes.set_ylim(-reach, reach)
    axes.set_aspect("equal")
    far = number_text(float(np.max(np.abs(values), initial=0.0)), 1.0, 6)
    return [Line2D([], [], color="0.5", linewidth=1.4, label=f"unit circle; largest modulus {far}")]
