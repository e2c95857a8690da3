"""Bode and Nyquist diagrams, and what follows a step or an impulse."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MultipleLocator

from mbstab.analysis.algebra.arrays import Complex
from mbstab.analysis.response.response import Response
from mbstab.analysis.response.transfer import Channel
from mbstab.analysis.sweep.unbalance import UnbalanceResponse
from mbstab.compiler.system import Array
from mbstab.records import dataclass
from mbstab.report.picture_sizes import FONT, scaled
from mbstab.report.pictures.curves import INK
from mbstab.report.pictures.drawing import UNSTABLE_SHADE, draw_legend, house_style, titled_figure, unstable_patch
from mbstab.report.pictures.point_labels import PointLabels
from mbstab.report.pictures.scales import Axis, number_text, typeset, with_minus_sign
from mbstab.report.responses import decibels, phase, unit

STYLES = ("-", "--", "-.", ":")
MARKS = 7.0
"""Marks of phases are so near to each other that they divide the axis into at most so many parts …"""

STEPS = (1.0, 2.0, 5.0, 10.0, 15.0, 30.0, 45.0, 90.0, 180.0)
"""… of these sizes (degrees), or of whole turns, or of decimal parts of a degree."""

CONSTANT = 1e-6
"""Phases that differ by less (degrees) are constant."""

FAR = 4.0
"""Nyquist diagrams show the critical point if it is within so many times the size of the curves …"""

NEAR = 12.0
"""… and no more than so many times its distance from 0 if it is shown."""

PEAK = 60.0
"""Resonances that are higher than printed gains by less than this are drawn to their tops (dB)."""

PERIOD, MOST = 16.0, 4000
"""Points of a period of the fastest oscillation, and of all outputs over time."""

ON_AXIS, STILL, NEAR_POLE, POLES = 1e-9, 1e-6, 1e-4, 4
"""Real parts of poles on the imaginary axis are below this part of their modulus, poles at 0 below this part of the
largest, values are large within this part of the frequency of a pole, and as many poles are named."""

GROWN = 1e3
"""Responses over time are drawn until what grows fastest has grown by this factor."""

RING = np.tan(np.linspace(-1.5, 1.5, 81))
"""Frequencies around a resonance, from the middle in half widths: equal steps along its circle."""


BENT, ADDED = 2e-3, 300
"""Curves over the spin get more points where they leave their chord by this part of a panel, so many at most."""

MARGIN: dict[str, Any] = {"linewidth": 1.8, "linestyle": (0, (1.0, 1.0)), "markersize": 4.5, "markerfacecolor": "w"}
"""How margins are drawn."""

WIDE = 2.2
"""Width of a panel in heights."""


def _style(k: int) -> dict[str, Any]:
    """Return how the curve of a channel is drawn."""
    return {"color": INK[k % len(INK)], "linestyle": STYLES[k % len(STYLES)], "linewidth": 1.3 + 0.3 * (k // 4)}


def _entry(channel: Channel, kind: str, style: dict[str, Any]) -> Line2D:
    """Return the legend entry of a channel."""
    own = typeset(unit(channel, kind))
    return Line2D([], [], label=f"{channel.source} → {channel.goal}" + (f" ({own})" if own else ""), **style)


def response_picture(result: Response, title: str) -> Figure:
    """Return the gains and phases of all channels over frequency, or the outputs over time."""
    with house_style():
        return _bode(result, title) if result.kind == "frequency" else _over_time(result, title)


def _bode(result: Response, title: str) -> Figure:
    """Return gains and phases, with more frequencies around resonances; those without damping leave the panel."""
    figure, (upper, lower) = titled_figure(title, heights=(2.6, 2.0))
    handles = []
    x, every = _everywhere(result)
    printed = [decibels(values[np.isfinite(values) & (values != 0.0)]) for values in result.values]
    low, high = (f(np.concatenate(printed), initial=0.0 if not any(map(len, printed)) else s * math.inf)
                 for f, s in ((np.min, 1), (np.max, -1)))  # fmt: skip
    for k, (channel, values) in enumerate(zip(result.channels, every, strict=True)):
        style = _style(k)
        handles.append(_entry(channel, result.kind, style))
        gain = decibels(values)
        high = max(high, float(np.max(gain[gain < high + PEAK], initial=high)))
        upper.semilogx(x, gain, **style)
        lower.semilogx(x, phase(values), **style)
    marks = _margins_in(result, x, every)
    low, high = min([low, *(0.0 for m in marks if m.of_gain)]), max([high, *(0.0 for m in marks if m.of_gain)])
    upper.set_ylim(low - 0.05 * (high - low) - 1.0, high + 0.05 * (high - low) + 1.0)
    for axes in (upper, lower):
        _mark(axes, [m for m in marks if m.of_gain == (axes is upper)])
    _finish(upper, lower, "frequency (rad/s)")
    upper.set_ylabel("gain (dB)")
    for axes in (upper, lower):
        axes.set_xlim(result.x[0], result.x[-1])
    if marks:
        handles.append(Line2D([], [], label="gain and phase margins", marker="o", **{**MARGIN, "color": "k"}))
    draw_legend(figure, handles)
    for axes in (upper, lower):
        _label(axes, [m for m in marks if m.of_gain == (axes is upper)])
    return figure


@dataclass(frozen=True)
class _Margin:
    """A margin in a Bode diagram: a step at a frequency from a curve to 0 dB, or to an odd multiple of 180 degrees."""

    of_gain: bool
    frequency: float
    start: float
    end: float
    ink: str


def _margins_in(result: Response, x: Array, curves: Sequence[Any]) -> list[_Margin]:
    """Return the margins at the frequencies of a picture, those of each channel in its ink."""
    found = []
    for k, (own, values) in enumerate(zip(result.margins, curves, strict=False)):
        ink, angle = INK[k % len(INK)], phase(values)
        known = np.isfinite(angle)
        if own.doubt or not known.any():
            continue
        for g in own.gain:
            found.append(_Margin(True, g.frequency, -float(decibels(g.factor)), 0.0, ink))
        for p in own.phase:
            # The margin is known exactly, the turns of the curve from its points.
            rough = float(np.interp(math.log(p.frequency), np.log(x[known]), angle[known])) - p.phase
            end = 360.0 * round((rough - 180.0) / 360.0) + 180.0
            found.append(_Margin(False, p.frequency, end + p.phase, end, ink))
    return [m for m in found if result.x[0] <= m.frequency <= result.x[-1]]


def _mark(axes: Axes, marks: Sequence[_Margin]) -> None:
    """Draw the margins of a panel, and the level to which they count."""
    for level in {m.end for m in marks}:
        axes.axhline(level, color="0.35", linewidth=0.8, zorder=1.6)
    for m in marks:
        axes.plot(
            [m.frequency] * 2, [m.start, m.end], marker="o", markevery=[0], zorder=4, **{**MARGIN, "color": m.ink}
        )


def _label(axes: Axes, marks: Sequence[_Margin]) -> None:
    """Write the sizes of the margins of a panel."""
    labels = PointLabels(axes)
    for m in marks:
        size, unit_ = (m.end - m.start, " dB") if m.of_gain else (m.start - m.end, "°")
        labels.add(m.frequency, 0.5 * (m.start + m.end), with_minus_sign(f"{size:.3g}") + unit_)
    labels.draw()


def _over_time(result: Response, title: str) -> Figure:
    """Return outputs over time, with points enough for the fastest oscillation: those of a unit in a panel."""
    of = [unit(channel, result.kind) for channel in result.channels]
    units = list(dict.fromkeys(of))
    heights = [3.4] if len(units) == 1 else [max(5.4 / len(units), 1.5)] * len(units)
    figure, panels = titled_figure(title, heights, gap=0.3)
    handles = []
    fastest = float(np.max(result.poles.imag, initial=0.0))
    count = min(math.ceil(PERIOD * fastest * (result.x[-1] - result.x[0]) / (2.0 * math.pi)), MOST)
    last, told = _seen_until(result)
    x = np.linspace(result.x[0], last, max(count, len(result.x)))
    for k, channel in enumerate(result.channels):
        handles.append(_entry(channel, result.kind, _style(k)))
        panels[units.index(of[k])].plot(x, channel.step(x, result.kind == "impulse"), **_style(k))
    for own, axes in zip(units, panels, strict=True):
        shown = typeset(own)
        goals = list(dict.fromkeys(c.goal for c, other in zip(result.channels, of, strict=True) if other == own))
        name = f"{goals[0]} " if len(goals) == 1 else ""
        axes.set_ylabel(f"{name}after a unit {result.kind}" + (f" ({shown})" if shown else ""))
        axes.set_xlim(x[0], x[-1])
        axes.tick_params(labelbottom=axes is panels[-1])
        axes.grid(color="0.85", linewidth=0.6)
    panels[-1].set_xlabel(f"time (s){told}")
    draw_legend(figure, handles)
    return figure


def _seen_until(result: Response) -> tuple[float, str]:
    """Return the last time that is drawn, and what is said about it: what grows would soon hide its beginning."""
    first, last = float(result.x[0]), float(result.x[-1])
    growing = (channel for channel, text in zip(result.channels, result.growth, strict=True) if text)
    rates = [float(np.max(np.linalg.eigvals(channel.A).real, initial=0.0)) for channel in growing]
    until = math.log(GROWN) / max(rates) if max(rates, default=0.0) > 0.0 else math.inf
    if not first < until < last:
        return last, ""
    return until, f"; the responses grow without bound, and are drawn up to {until:.3g} s"


def _finish(upper: Axes, lower: Axes, across: str) -> None:
    """Finish panels of amplitudes and phases, which are in degrees."""
    upper.tick_params(labelbottom=False)
    lower.set_ylabel("phase (°)")
    low, high = lower.dataLim.intervaly
    if high - low < CONSTANT:
        lower.set_ylim(low - 90.0, high + 90.0)
    low, high = lower.get_ylim()
    if (least := (high - low) / MARKS) > 0.5 * STEPS[0]:
        turns = 360.0 * math.ceil(least / 360.0)
        lower.yaxis.set_major_locator(MultipleLocator(next((step for step in STEPS if step >= least), turns)))
    lower.set_xlabel(across)
    for axes in (upper, lower):
        axes.grid(color="0.85", linewidth=0.6)


def unbalance_picture(result: UnbalanceResponse, title: str, spin: Axis) -> Figure:
    """Return the amplitudes and phases of all outputs over the spin.

    Speeds at which the motion without unbalance is unstable are shaded.
    """
    shared = typeset(result.units[0] or "1") if len(set(result.units)) == 1 else ""
    speeds = result.speeds / spin.factor
    known, curves = _smooth(result)
    with house_style():
        figure, panels = titled_figure(title, heights=(2.6, 2.0))
        handles = list[Artist]()
        for k, (name, own, peak) in enumerate(zip(result.outputs, result.units, result.peaks, strict=True)):
            # Peaks belong to the curve; beyond all bounds, the curve has a gap there.
            tops = sorted(((p.speed, p.value) for p in (peak, *result.further[k])), key=lambda top: top[0])
            at = np.searchsorted(known, [speed for speed, _ in tops])
            x = np.insert(known, at, [speed for speed, _ in tops]) / spin.factor
            values = np.insert(curves[k], at, [value for _, value in tops])
            style = _style(k)
            handles.append(Line2D([], [], label=name + (f" ({typeset(own)})" if own and not shared else ""), **style))
            panels[0].semilogy(x, np.abs(values), **style)
            panels[1].plot(x, phase(values), **style)
        for axes in panels:
            axes.set_xlim(*sorted((speeds[0], speeds[-1])))
            across = axes.get_xaxis_transform()
            axes.fill_between(
                speeds, 0.0, 1.0, where=result.unstable, step="mid", transform=across, color=UNSTABLE_SHADE,
                linewidth=0, zorder=0,
            )  # fmt: skip
        if np.any(result.unstable):
            handles.append(unstable_patch())
        _finish(panels[0], panels[1], spin.text)
        panels[0].set_ylabel(f"amplitude {'per unbalance ' * result.relative}({shared or 'each in its own unit'})")
        draw_legend(figure, handles)
        return figure


def _smooth(result: UnbalanceResponse) -> tuple[Array, Complex]:
    """Return speeds in ascending order (rad/s) and values of the outputs, with more of them where curves bend."""
    order = np.argsort(result.speeds)
    x, values = result.speeds[order], result.values[:, order]
    if result.between is None or len(x) < 2:
        return x, values
    tops = (p.speed for group in (result.peaks, *result.further) for p in group if p.bounded)
    more = sorted({*tops} - {*x.tolist()})
    limit = len(x) + ADDED
    while True:
        if more:
            at, added = np.searchsorted(x, more), result.between(np.array(more))
            x, values = np.insert(x, at, more), np.insert(values, at, added, axis=1)
        bent = _bent(x, values)
        worst = np.sort(np.argsort(-bent)[: min(limit - len(x), len(x) // 4 + 1)])
        more = [0.5 * float(x[k] + x[k + 1]) for k in worst if bent[k] > BENT]
        if not more or len(x) >= limit:
            return x, values


def _bent(x: Array, values: Complex) -> Array:
    """Return how far curves bend away from their chords between neighbouring speeds (parts of a panel)."""
    along = WIDE * (x - x[0]) / np.ptp(x)
    far = np.zeros(len(x) - 1)
    for z in values:
        size = np.log(np.maximum(np.abs(z), 1e-300))
        for height in (size, np.radians(phase(z))):
            seen = np.isfinite(height)
            whole = np.ptp(height[seen]) or 1.0
            way = np.diff(along + 1j * np.where(seen, height, 0.0) / whole)
            way[~(seen[1:] & seen[:-1])] = 0.0  # beside a value beyond all bounds
            turn = np.abs(np.angle(way[1:] * np.conj(way[:-1])))
            each = np.maximum(np.append(turn, 0.0), np.insert(turn, 0, 0.0))
            far = np.maximum(far, np.abs(way) * np.minimum(each, 1.0) / 8.0)
    return far


def nyquist(result: Response, title: str) -> Figure:
    """Return the frequency responses in the complex plane, for positive and, thin, for negative frequencies."""
    with house_style():
        figure, (axes,) = titled_figure(title, heights=(5.2,))
        handles = []
        _, curves = _everywhere(result)
        for k, (channel, values) in enumerate(zip(result.channels, curves, strict=True)):
            style = _style(k)
            handles.append(_entry(channel, result.kind, style))
            axes.plot(values.real, values.imag, **style, zorder=3)
            axes.plot(values.real, -values.imag, **{**style, "linewidth": 0.6}, zorder=2)
        side, critical = _extent(curves)
        _set_plane(axes, curves, side, critical)
        for k, values in enumerate(curves):
            _arrow(axes, values, INK[k % len(INK)], side)
        if critical:
            turn = np.exp(1j * np.linspace(0.0, 2.0 * np.pi, 201))
            axes.plot(turn.real, turn.imag, color="0.6", linewidth=0.7, linestyle=(0, (1.5, 2.0)), zorder=1)
            axes.plot(-1.0, 0.0, "P", color="k", markersize=7, markerfacecolor="w", zorder=5)
            handles.append(
                Line2D(
                    [],
                    [],
                    linestyle="",
                    marker="P",
                    color="k",
                    markerfacecolor="w",
                    label="critical point \N{MINUS SIGN}1",
                )
            )
        handles.append(Line2D([], [], color="0.3", linewidth=0.6, label="negative frequencies"))
        if text := _closing(result):
            handles.append(Line2D([], [], linestyle="none", label=text))
        draw_legend(figure, handles)
        return figure


def _closing(result: Response) -> str:
    """Return the legend's text on poles on the imaginary axis, which the contour passes on their right side.

    There curves close at infinity, clockwise, by half a turn for each pole.
    """
    assert result.exact is not None
    sizes = np.abs(result.poles)
    known = result.poles[(np.abs(result.poles.real) <= ON_AXIS * sizes) & (result.poles.imag > 0.0)]
    heights = np.unique([float(f"{w:.9g}") for w in known.imag.tolist()])
    away = np.array([0.1, 0.001])
    # Each seen from two distances; what grows on the way, by more than its errors, has the pole.
    pairs = {w: w * (1.0 + away * NEAR_POLE) for w in heights.tolist()}
    still = sizes <= STILL * np.max(sizes, initial=0.0)
    if np.any(still):
        pairs = {0.0: min([result.x[0], *sizes[~still].tolist()]) * away, **pairs}
    numbers = [result.exact.number(channel) for channel in result.channels]
    found = []
    for w, pair in pairs.items():
        values, errors = (np.array([np.abs(x[n]) for n in numbers]) for x in result.exact.over(pair))
        if np.any((values[:, 1] > 10.0 * values[:, 0]) & np.all(errors < 0.1 * values, axis=1)):
            found.append(w)
    if not found:
        return ""
    at = ", ".join(number_text(w, found[-1], 4) for w in found[:POLES]) + ", …" * (len(found) > POLES)
    return f"poles on the imaginary axis,\nat {at} rad/s: curves\nclose there clockwise at infinity"


def _everywhere(result: Response) -> tuple[Array, list[Any]]:
    """Return the frequencies of a response (rad/s), and more of them around resonances, with the values of channels."""
    assert result.exact is not None
    rings = [abs(p.imag) + max(abs(p.real), 1e-6 * abs(p)) * RING for p in result.poles.tolist()]
    x: Array = np.unique(np.concatenate([result.x, *rings]))
    inside: Array = x[(x >= result.x[0]) & (x <= result.x[-1])]
    values, _ = result.exact.over(inside)
    return inside, [values[result.exact.number(channel)] for channel in result.channels]


def _extent(curves: list[Any]) -> tuple[float, bool]:
    """Return how far from 0 the plane is shown, and whether the critical point is."""
    size = max((float(np.max(np.abs(z[np.isfinite(z)]), initial=0.0)) for z in curves), default=0.0) or 1.0
    critical = size * FAR >= 1.0
    return (min(max(1.08 * size, 1.3), NEAR) if critical else 1.08 * size), critical


def _set_plane(axes: Axes, curves: list[Any], side: float, critical: bool) -> None:
    """Set the limits and the labels of the plane, with equal scales."""
    z = np.concatenate([*curves, np.array([0j] + [-1.0 + 0j] * critical)])
    z = z[np.isfinite(z)]
    real = np.clip(z.real, -side, side)
    low, high = float(real.min()), float(real.max())
    up = float(np.max(np.clip(np.abs(z.imag), 0.0, side), initial=0.0))
    extra = 0.07 * max(high - low, 2.0 * up)
    axes.set_xlim(low - extra, high + extra)
    axes.set_ylim(-up - extra, up + extra)
    axes.set_aspect("equal", adjustable="datalim")
    axes.axhline(0.0, color="0.6", linewidth=0.6, zorder=1)
    axes.axvline(0.0, color="0.6", linewidth=0.6, zorder=1)
    axes.set_xlabel("real part")
    axes.set_ylabel("imaginary part")


def _arrow(axes: Axes, values: Any, color: str, side: float) -> None:
    """Mark the direction of rising frequency in the middle of what is seen of a curve."""
    seen = np.flatnonzero(np.isfinite(values) & (np.abs(values) <= side))
    if len(seen) < 3:
        return
    length = np.cumsum(np.abs(np.diff(values[seen])))
    k = int(np.clip(np.searchsorted(length, 0.5 * length[-1]), 0, len(seen) - 2))
    start, end = values[seen[k]], values[seen[k + 1]]
    if start == end:
        return
    way = (end - start) / abs(end - start) * 1e-3 * side
    axes.annotate(
        "", (end.real, end.imag), (end.real - way.real, end.imag - way.imag), zorder=4,
        arrowprops={"arrowstyle": "-|>", "color": color, "mutation_scale": scaled(1.6 * FONT), "linewidth": 0},
    )  # fmt: skip
