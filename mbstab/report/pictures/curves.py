"""Curves with as few points as a picture can show."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.colors import to_hex, to_rgb

from mbstab.compiler.system import Array

Mask = npt.NDArray[np.bool_]

INK = ("#000000", "#b03a2e", "#4f94d4")
"""Colours of curves, in turn; they differ in grey as well (0, 0.35, 0.54)."""

BRANCH_INK = (*INK, "#2e7d32", "#e08a1e", "#6a3d9a", "#8b5a2b", "#d6569f")
"""Colours of the first families of branches; numbers or names beside the curves tell them apart in grey."""

WHITE = (0.0, 0.35, 0.6)
"""Part of white in the colours of each turn, if there are more families."""

BEYOND_INK = "0.62"
"""Grey of the paths beyond the turns of the first one."""

THIN, THICK = 1.5, 3.2
"""Width (points) of curves of stable and unstable eigenvalues."""

BINS = 1500
"""Columns of the grid to which a curve is thinned: more than a page can show."""


def branch_ink(number: int) -> str:
    """Return the colour of a family of branches."""
    turn, place = divmod(number, len(BRANCH_INK))
    part = WHITE[turn % len(WHITE)]
    red, green, blue = ((1.0 - part) * x + part for x in to_rgb(BRANCH_INK[place]))
    return to_hex((red, green, blue))


def draw_branch(axes: Axes, x: Array, y: Array, ink: str, thick: Mask, dashed: bool = False) -> None:
    """Draw a branch: nan breaks it, and its unstable parts are thick."""
    along = partial(decimated, logarithmic=axes.get_xscale() == "log")
    fewer = along if np.all(np.diff(x) >= 0.0) and np.any(x > x[:1]) else thinned
    inner = thick.copy()
    inner[1:] &= thick[:-1]
    inner[:-1] &= thick[1:]
    for hidden, width in ((inner, THIN), (~thick, THICK)):
        shown = np.where(hidden, np.nan, y)
        if not np.isfinite(shown).any():
            continue
        # Matplotlib counts dashes in line widths; these are equally long in points.
        dashes: Any = (0, (5.8 / width, 2.4 / width)) if dashed else "-"
        axes.plot(
            *fewer(x, shown), color=ink, linewidth=width, linestyle=dashes, zorder=3,
            solid_capstyle="butt", dash_capstyle="butt",
        )  # fmt: skip
    finite = np.isfinite(x) & np.isfinite(y)
    beside = np.zeros_like(finite)
    beside[1:] |= finite[:-1]
    beside[:-1] |= finite[1:]
    alone = finite & ~beside
    if alone.any():
        axes.plot(*fewer(x[alone], y[alone]), ".", color=ink, markersize=4, zorder=3)


def decimated(x: Array, y: Array, logarithmic: bool = False) -> tuple[Array, Array]:
    """Return the points of a curve over ascending x, without nan, that a picture can show.

    In every column of a linear or logarithmic axis the first, last, highest and lowest points are kept, and a nan.
    """
    n = len(x)
    if n <= 5 * BINS:
        return x, y
    place = np.log(x) if logarithmic else x
    column = np.minimum(((place - place[0]) * (BINS / (place[-1] - place[0]))).astype(np.intp), BINS - 1)
    starts = np.flatnonzero(np.diff(column, prepend=-1))
    finite = np.isfinite(y)
    position = np.arange(n)
    kept = [
        np.minimum.reduceat(np.where(finite, position, n), starts),
        np.maximum.reduceat(np.where(finite, position, -1), starts),
        np.minimum.reduceat(np.where(finite, n, position), starts),
    ]
    count = np.diff(np.append(starts, n))
    for values in (np.where(finite, y, np.inf), np.where(finite, -y, np.inf)):
        lowest = np.repeat(np.minimum.reduceat(values, starts), count)
        kept.append(np.minimum.reduceat(np.where(finite & (values == lowest), position, n), starts))
    index = np.unique(np.concatenate(kept))
    index = index[(index >= 0) & (index < n)]
    return x[index], y[index]


def thinned(x: Array, y: Array) -> tuple[Array, Array]:
    """Return the points of a curve in the plane, without those that a picture cannot tell from their neighbours."""
    if len(x) <= 5 * BINS:
        return x, y
    finite = np.isfinite(x) & np.isfinite(y)
    if not finite.any():
        return x[:1], y[:1]
    cells = []
    for values in (x, y):
        low, high = float(np.min(values[finite])), float(np.max(values[finite]))
        cells.append(np.where(finite, (values - low) * (BINS / max(high - low, 1e-300)), np.nan))
    z = cells[0] + 1j * cells[1]
    grid = np.where(finite, np.floor(cells[0]) * 2.0 * BINS + np.floor(cells[1]), -1.0)
    moved = np.diff(grid) != 0.0
    # The last point in a cell is kept too: at a turn or before a gap it is an end.
    kept = np.flatnonzero(np.concatenate([[True], moved]) | np.concatenate([moved, [True]]))
    for _ in range(8):
        # Among every second point, those on the line between their neighbours are dropped.
        before, middle, after = z[kept[:-2:2]], z[kept[1:-1:2]], z[kept[2::2]]
        way = after - before
        part = (middle - before) * np.conj(way)
        length = np.abs(way)
        needless = (np.abs(part.imag) < 0.1 * length) & (part.real > 0.0) & (part.real < length**2)
        kept = np.delete(kept, 1 + 2 * np.flatnonzero(needless))
    return x[kept], y[kept]
