"""Stability over two parameters."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from mbstab.compiler.system import Array
from mbstab.report.picture_sizes import FONT, scaled
from mbstab.report.pictures.curves import thinned
from mbstab.report.pictures.drawing import draw_legend, house_style, no_answer_patch, text_width, titled_figure
from mbstab.report.pictures.regions import Labels, Polygon, regions
from mbstab.report.pictures.scales import Axis, set_parameter_axis

REGIONS = ("1.0", "0.84", "0.68", "0.52", "0.36")
"""Grey of a region by its number of unstable eigenvalues, the last for 4 or more; a black line is seen on each."""


BETWEEN: Any = (0, (4.0, 2.0))
"""Dashes of the line between divergence and flutter."""

GRAIN = 3.0
"""Side of the squares in which room for a text is looked for (points)."""

MOST = 12
"""Largest number of texts inside regions."""

Words = npt.NDArray[np.str_]

WORDS = ("divergence", "flutter", "divergence\nand flutter")
"""Loss of stability by real, complex, or both kinds of eigenvalues."""


def chart(
    x: Array,
    y: Array,
    unstable: Labels,
    oscillating: Labels,
    verdicts: Words,
    boundaries: Sequence[Array],
    labels: tuple[Axis | str, Axis | str],
    title: str,
    missing: str = "no answer",
    divisions: Sequence[Array] = (),
) -> Figure:
    """Return a stability chart of two parameters.

    Parameters
    ----------
    x, y : ndarray
        Values of the parameters (SI), ascending or descending.
    unstable, oscillating : ndarray of int, shape (len(y), len(x))
        Number of unstable eigenvalues, −1 where the verdict is open or there is no answer; how many are complex.
    verdicts : ndarray of str, shape (len(y), len(x))
        What is said where no eigenvalue is unstable.
    boundaries : sequence of ndarray, shape (k, 2)
        Points of curves (SI); a row of nan breaks a curve.
    labels : tuple of Axis or str
    title : str
    missing : str
        Text of the legend for points without a number.
    divisions : sequence of ndarray, shape (k, 2)
        Curves (SI) on which eigenvalues begin to oscillate, with equally many unstable ones on both sides.
    """
    across, up = (Axis.read(label) for label in labels)
    factors = across.factor, up.factor
    count = np.clip(unstable, -1, len(REGIONS) - 1)
    kind = np.where(oscillating == 0, 0, np.where(oscillating == unstable, 1, 2))
    with house_style():
        figure, (axes,) = titled_figure(title, heights=(4.8,))
        axes.set_xlabel(across.text)
        axes.set_ylabel(up.text)
        set_parameter_axis(axes, "x", across, x / across.factor)
        set_parameter_axis(axes, "y", up, y / up.factor)
        if min(len(x), len(y)) > 1:
            _fill(axes, regions(x, y, count, boundaries), factors)
        lines = _draw_curves(axes, boundaries, divisions, factors)
        handles: list[Artist] = []
        for number in sorted({int(k) for k in np.unique(count) if k >= 0}):
            more = " or more" if number == len(REGIONS) - 1 else ""
            words = [WORDS[k].replace("\n", " ") for k in np.unique(kind[count == number])]
            said = ", ".join(np.unique(verdicts[count == 0]).tolist())
            text = f"{number}{more} unstable: {', '.join(words)}" if number else said
            text += "" if _seen(axes, x / across.factor, y / up.factor, count == number) else " (hidden by a line)"
            handles.append(Patch(facecolor=REGIONS[number], edgecolor="0.3", linewidth=0.6, label=text))
        if np.any(count < 0):
            handles.append(no_answer_patch(missing))
        draw_legend(figure, handles + lines)
        texts = np.where(count > 0, np.array(WORDS)[kind], verdicts)
        _write_kinds(axes, x / across.factor, y / up.factor, count, texts)
        return figure


def _draw_curves(
    axes: Axes, boundaries: Sequence[Array], divisions: Sequence[Array], factors: tuple[float, float]
) -> list[Artist]:
    """Draw the curves between regions; return their entries of the legend."""
    handles: list[Artist] = []
    for curve in boundaries:
        line = thinned(*(np.asarray(curve, dtype=float).reshape(-1, 2) / factors).T)
        # Not cut off: on the frame, where damping begins at zero, a line would be lost.
        axes.plot(*line, color="k", linewidth=1.4, zorder=2.0, clip_on=False)
    for curve in divisions:
        line = thinned(*(curve / factors).T)
        axes.plot(*line, color="k", linewidth=1.0, linestyle=BETWEEN, zorder=1.8)
    if len(boundaries):
        handles.append(Line2D([], [], color="k", linewidth=1.4, label="stability boundary"))
    if len(divisions):
        text = "between divergence and flutter"
        handles.append(Line2D([], [], color="k", linewidth=1.0, linestyle=BETWEEN, label=text))
    return handles


def _fill(axes: Axes, polygons: dict[int, list[Polygon]], factors: tuple[float, float]) -> None:
    """Fill regions by the number of unstable eigenvalues; those without an answer are hatched."""
    for number, parts in polygons.items():
        style: dict[str, Any] = {"facecolors": "w", "edgecolors": "0.5", "hatch": "////", "linewidths": 0.0}
        if number >= 0:
            # Without smoothed edges: between neighbours these would be seen.
            style = {"facecolors": REGIONS[number], "linewidths": 0.0, "antialiaseds": False, "rasterized": True}
        scaled_parts = [np.array(part) / factors for part in parts]
        axes.add_collection(PolyCollection(scaled_parts, zorder=0.5 if number < 0 else 0, **style), autolim=False)


def _write_kinds(axes: Axes, x: Array, y: Array, count: Labels, texts: Words) -> None:
    """Write into each region that has room what is stable there, or how stability is lost."""
    from scipy import ndimage

    told, at = np.unique(texts, return_inverse=True)
    shown = _squares(axes, x, y, np.where(count >= 0, len(told) * count + at.reshape(count.shape), count))
    rows, columns = shown.shape
    places: list[tuple[float, float, float, str, int]] = []
    for label in (label for label in np.unique(shown).tolist() if label >= 0):
        number, text = label // len(told), str(told[label % len(told)])
        lines = text.split("\n")
        size = scaled(FONT)
        need = [1.3 * size * len(lines), max(text_width(line, size) for line in lines)]
        parts, found = ndimage.label(shown == label)
        for part in range(1, found + 1):
            inside = np.pad(parts == part, 1)
            fits = ndimage.minimum_filter(inside, [int(n / GRAIN) + 3 for n in need], mode="constant")[1:-1, 1:-1]
            if fits.any():
                depth = np.where(fits, ndimage.distance_transform_edt(inside)[1:-1, 1:-1], 0.0)
                i, j = np.unravel_index(int(np.argmax(depth)), depth.shape)
                places.append((-float(depth[i, j]), (j + 0.5) / columns, (i + 0.5) / rows, text, number))
    for _, u, v, text, number in sorted(places)[:MOST]:
        ink = "k" if float(REGIONS[number]) > 0.5 else "w"
        axes.text(u, v, text, transform=axes.transAxes, ha="center", va="center", color=ink, zorder=3, style="italic")


def _squares(axes: Axes, x: Array, y: Array, values: Any) -> Any:
    """Return values at the points of a grid as those of squares of the panel."""
    box = axes.get_window_extent()
    wide, tall = (72.0 / axes.figure.dpi * side for side in (box.width, box.height))
    columns = _nearest(x, _spaced(axes.get_xlim(), int(wide / GRAIN), axes.get_xscale() == "log"))
    rows = _nearest(y, _spaced(axes.get_ylim(), int(tall / GRAIN), axes.get_yscale() == "log"))
    return values[np.ix_(rows, columns)]


def _spaced(ends: tuple[float, float], count: int, logarithmic: bool) -> Array:
    """Return points along an axis."""
    return np.geomspace(*ends, count) if logarithmic else np.linspace(*ends, count)


def _seen(axes: Axes, x: Array, y: Array, region: npt.NDArray[np.bool_]) -> bool:
    """Return whether a region is somewhere wider than the lines along its boundary."""
    from scipy import ndimage

    inside = np.pad(_squares(axes, x, y, region), 1, mode="edge")
    return bool(ndimage.minimum_filter(inside, 3, mode="constant")[1:-1, 1:-1].any())


def _nearest(values: Array, points: Array) -> npt.NDArray[np.intp]:
    """Return the number of the value nearest to each point."""
    found: npt.NDArray[np.intp] = np.argmin(np.abs(values[:, None] - points), axis=0)
    return found
