"""Stability over two parameters."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from mbstab.compiler.system import Array
from mbstab.report.pictures.curves import Mask, thinned
from mbstab.report.pictures.drawing import draw_legend, house_style, no_answer_patch, titled_figure
from mbstab.report.pictures.scales import Axis, parameter_range

REGIONS = ("1.0", "0.82", "0.64", "0.46", "0.28")
"""Grey of a region by its number of unstable eigenvalues; the last is for 4 or more."""


def chart(
    x: Array,
    y: Array,
    unstable: npt.NDArray[np.integer[Any]],
    boundaries: Sequence[Array],
    labels: tuple[Axis | str, Axis | str],
    title: str,
    missing: str = "no answer",
) -> Figure:
    """Return a stability chart of two parameters.

    Parameters
    ----------
    x, y : ndarray
        Values of the parameters (SI), ascending or descending.
    unstable : ndarray of int, shape (len(y), len(x))
        Number of unstable eigenvalues; −1 where the verdict is open, or there is no answer.
    boundaries : sequence of ndarray, shape (k, 2)
        Points of curves (SI); a row of nan breaks a curve.
    labels : tuple of Axis or str
    title : str
    missing : str
        Text of the legend for points without a number.
    """
    across, up = (Axis.read(label) for label in labels)
    with house_style():
        figure, (axes,) = titled_figure(title, heights=(4.8,))
        x, y = x / across.factor, y / up.factor
        last = len(REGIONS) - 1
        shown = np.ma.masked_less(np.minimum(unstable, last), 0)
        norm = BoundaryNorm(np.arange(-0.5, last + 1), last + 1)
        cells = axes.pcolormesh(_edges(x), _edges(y), shown, cmap=ListedColormap(REGIONS), norm=norm, rasterized=True)
        cells.set_zorder(0)
        _hatch(axes, _edges(x), _edges(y), unstable < 0)
        for curve in boundaries:
            points = np.asarray(curve, dtype=float).reshape(-1, 2) / (across.factor, up.factor)
            # Dark on a lighter, wider line: the curve is visible on every grey.
            for width, colour in ((2.8, "w"), (1.4, "k")):
                axes.plot(*thinned(points[:, 0], points[:, 1]), color=colour, linewidth=width, zorder=2)
        axes.set_xlabel(across.text)
        axes.set_ylabel(up.text)
        axes.set_xlim(*parameter_range(x))
        axes.set_ylim(*parameter_range(y))
        handles: list[Artist] = []
        for count in sorted({int(k) for k in np.unique(np.minimum(unstable, last)) if k >= 0}):
            text = f"{count} or more unstable" if count == last else f"{count} unstable" if count else "stable"
            handles.append(Patch(facecolor=REGIONS[count], edgecolor="0.3", linewidth=0.6, label=text))
        if np.any(unstable < 0):
            handles.append(no_answer_patch(missing))
        if len(boundaries):
            handles.append(Line2D([], [], color="k", linewidth=1.4, label="stability boundary"))
        draw_legend(figure, handles)
        return figure


def _edges(values: Array) -> Array:
    """Return the edges of cells around values."""
    if len(values) < 2:
        half = 0.5 * (abs(float(values[0])) or 1.0)
        return np.array([values[0] - half, values[0] + half])
    middle = 0.5 * (values[1:] + values[:-1])
    return np.concatenate([[2.0 * values[0] - middle[0]], middle, [2.0 * values[-1] - middle[-1]]])


def _hatch(axes: Axes, x: Array, y: Array, where: Mask) -> None:
    """Hatch cells; neighbours in a row are one rectangle."""
    rectangles = []
    for k, row in enumerate(where):
        change = np.flatnonzero(np.diff(np.concatenate([[0], row.astype(np.intp), [0]])))
        for a, b in change.reshape(-1, 2):
            rectangles.append([(x[a], y[k]), (x[b], y[k]), (x[b], y[k + 1]), (x[a], y[k + 1])])
    if rectangles:
        axes.add_collection(
            PolyCollection(rectangles, facecolors="w", edgecolors="0.5", hatch="////", linewidths=0.0, zorder=0.5),
            autolim=False,
        )
