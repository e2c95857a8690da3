"""Bode diagrams, and what follows a step or an impulse."""

from __future__ import annotations

from typing import Any

from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MultipleLocator

from mbstab.analysis.linear.response import Response
from mbstab.report.pictures.drawing import draw_legend, house_style, titled_figure
from mbstab.report.responses import decibels, phase, unit

STYLES = ("-", "--", "-.", ":")
TURN = 45.0
"""Smallest step of the marks of phases (degrees)."""


def response_picture(result: Response, title: str) -> Figure:
    """Return the gains and phases of all channels over frequency, or the outputs over time."""
    bode = result.kind == "frequency"
    with house_style():
        figure, panels = titled_figure(title, heights=(2.6, 2.0) if bode else (3.4,))
        handles, spread = [], 0.0
        for k, (channel, values) in enumerate(zip(result.channels, result.values, strict=True)):
            style: dict[str, Any] = {
                "color": f"C{k}",
                "linestyle": STYLES[k % len(STYLES)],
                "linewidth": 1.3 + 0.3 * (k // 4),
            }
            own = unit(channel)
            text = f"{channel.source} → {channel.goal}" + (f" ({own})" if own else "")
            handles.append(Line2D([], [], label=text, **style))
            if bode:
                angle = phase(values)
                spread = max(spread, float(angle.max() - angle.min()))
                panels[0].semilogx(result.x, decibels(values), **style)
                panels[1].semilogx(result.x, angle, **style)
            else:
                panels[0].plot(result.x, values, **style)
        for axes in panels:
            axes.set_xlim(result.x[0], result.x[-1])
            axes.grid(color="0.85", linewidth=0.6)
        if bode:
            panels[0].set_ylabel("gain (dB)")
            panels[0].tick_params(labelbottom=False)
            panels[1].set_ylabel("phase (°)")
            panels[1].yaxis.set_major_locator(MultipleLocator(TURN * (2 if spread > 200.0 else 1)))
            panels[1].set_xlabel("frequency (rad/s)")
        else:
            panels[0].set_ylabel(f"output after a unit {result.kind}")
            panels[0].set_xlabel("time (s)")
        draw_legend(figure, handles, 2)
        return figure
