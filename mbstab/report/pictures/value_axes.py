"""Axes of values over time: a common part that is written once, powers of ten, and rounding that is not magnified."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, NullFormatter

from mbstab.compiler.system import Array
from mbstab.report.pictures.drawing import EXACT
from mbstab.report.pictures.scales import with_minus_sign

FLAT = 1e-11
"""Values that vary by less than this fraction of their size vary by rounding, and are drawn as constant."""

NARROW = 1e-3
"""If values vary by less than this fraction of their size, their common part is written once, at the axis."""


def set_decades(axes: Axes, values: Array) -> None:
    """Show whole decades of positive values; those below `EXACT` are drawn there."""
    values = np.maximum(values[values > 0.0], EXACT)
    if not len(values):
        axes.text(0.5, 0.5, "all are exactly zero", transform=axes.transAxes, ha="center")
        axes.set_yticks([])
        return
    low, high = math.floor(math.log10(np.min(values)) + 1e-9), math.ceil(math.log10(np.max(values)) - 1e-9)
    axes.set_yscale("log")
    axes.set_ylim(0.8 * 10.0**low, 1.25 * 10.0 ** max(high, low + 1))
    axes.yaxis.set_minor_formatter(NullFormatter())


def common_part(values: Array) -> float:
    """Return the common part of values that differ little: their mean with as few digits as possible; else 0."""
    low, high = _range(values)
    size = max(abs(low), abs(high))
    if not FLAT * size < high - low < NARROW * size:
        return 0.0
    return float(f"{0.5 * (low + high):.{math.ceil(math.log10(size / (high - low))) + 1}g}")


def _range(values: Array) -> tuple[float, float]:
    finite = values[np.isfinite(values)]
    return (float(finite.min()), float(finite.max())) if finite.size else (0.0, 0.0)


def set_room(axes: Axes, which: str, values: Array, whole: float = 0.0) -> int:
    """Set the range of an axis; return the power of ten of its numbers.

    Rounding errors are not magnified, neither those of the values nor those of `whole`, of which they are a part or
    from which they differ.
    """
    low, high = _range(values)
    size = max(abs(low), abs(high))
    flat = high - low <= FLAT * max(size, abs(whole))
    if flat and size <= FLAT * abs(whole):
        size = abs(whole)
    margin = 0.1 * size or 1.0 if flat else 0.06 * (high - low)
    (axes.set_xlim if which == "x" else axes.set_ylim)(low - margin, high + margin)
    if not size or 5e-3 < size < 1e5:
        return 0
    power = max(3 * math.floor(math.log10(size) / 3.0), -300)
    axis = axes.xaxis if which == "x" else axes.yaxis
    axis.set_major_formatter(
        FuncFormatter(lambda value, _: with_minus_sign(f"{round(value / 10.0**power, 6) + 0.0:g}"))
    )
    return power
