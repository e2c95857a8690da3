"""The fixed parts of a moving picture: the ground, a scale bar, and the ground axes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.transforms import ScaledTranslation

from mbstab.compiler.system import Array
from mbstab.report.animation.sketch import Plane
from mbstab.report.animation.view import View
from mbstab.report.picture_sizes import FONT, scaled

LONG, RIGHT, LIFT = 0.25, 0.97, 8.0
"""The scale bar: its largest length and its right end as parts of the width, and its height (points)."""

AXIS = 0.06
"""Length of the ground axes as a part of the size of the picture."""


def ground_lines(plane: Plane, view: View, shift: Array) -> list[Array]:
    """Return the lines of a plane, or of a line with hatches, in a shifted view."""
    return (_hatched_line if view.sketch.dimension == 2 else _grid)(plane, view, shift)


def _hatched_line(plane: Plane, view: View, shift: Array) -> list[Array]:
    """Return a line with hatches below it, which are fixed to the ground."""
    normal = plane.normal
    origin = plane.origin - shift
    span = float(np.max(view.high - view.low))
    step = _nice(span / 12.0)
    along = np.array([-normal[1], normal[0], 0.0])
    ends = [(np.array(p) - origin[:2]) @ along[:2] for p in _corners(view)]
    first = math.floor((min(ends) + plane.origin @ along - origin @ along) / step) - 1
    offset = (origin - plane.origin) @ along
    marks = offset + step * np.arange(first - 1, first + int((max(ends) - min(ends)) / step) + 4)
    base = origin - (origin @ along) * along + (plane.origin @ along) * along
    lines = [np.array([base + marks[0] * along, base + marks[-1] * along])]
    down = -0.35 * step * (normal + along)
    lines += [np.array([base + m * along, base + m * along + down]) for m in marks]
    return [line[:, :2] for line in lines]


def _grid(plane: Plane, view: View, shift: Array) -> list[Array]:
    """Return a grid below the bodies, whose lines are fixed to the ground."""
    origin, across = plane.origin, view.across
    one, other, low, high = view.patch(plane)
    step = _nice(float(np.max(high - low)) / 12.0)
    move = np.array([shift @ one, shift @ other])
    low, high = np.floor((low + move) / step) * step - move, np.ceil((high + move) / step) * step - move
    lines = []
    for way, along, a, b in ((one, other, 0, 1), (other, one, 1, 0)):
        for x in np.arange(low[a], high[a] + 0.5 * step, step):
            lines.append(np.array([origin + x * way + y * along for y in (low[b], high[b])]) @ across[:2].T)
    return lines


def _corners(view: View) -> list[tuple[float, float]]:
    return [(float(x), float(y)) for x in (view.low[0], view.high[0]) for y in (view.low[1], view.high[1])]


def _nice(length: float) -> float:
    """Return 1, 2 or 5 times a power of ten, not above a length."""
    power = 10.0 ** math.floor(math.log10(length))
    return next(x * power for x in (5.0, 2.0, 1.0) if x * power <= length * (1.0 + 1e-9))


def corner_marks(view: View, tall: float) -> list[tuple[Array, Array]]:
    """Return the lower left and upper right corners (m) of the scale bar and of the ground axes.

    Parameters
    ----------
    view : View
    tall : float
        Height of the axes (inches).
    """
    span = view.high - view.low
    bar = RIGHT * span[0] - _nice(LONG * span[0]), (LIFT + 3.0 + 1.3 * scaled(FONT)) / 72.0 / tall * span[1]
    marks = [(view.low + np.array([bar[0], 0.0]), view.low + np.array([RIGHT * span[0], bar[1]]))]
    if view.sketch.dimension == 3:
        marks.append((view.low, view.low + 3.0 * AXIS * float(np.max(span))))
    return marks


def draw_scale_bar(axes: Axes, low: Array, high: Array) -> None:
    """Draw a bar with its length into the lower right corner."""
    length = _nice(LONG * (high - low)[0])
    part = length / float((high - low)[0])
    bar: dict[str, Any] = {"xycoords": "axes fraction", "textcoords": "offset points"}
    figure = axes.get_figure()
    assert figure is not None
    shift = axes.transAxes + ScaledTranslation(0.0, LIFT / 72.0, figure.dpi_scale_trans)
    axes.add_line(Line2D([RIGHT - part, RIGHT], [0.0, 0.0], transform=shift, color="k", linewidth=2.0))
    axes.annotate(f"{length:g} m", (RIGHT - 0.5 * part, 0.0), (0, LIFT + 3.0), **bar, ha="center", va="bottom")


def draw_ground_axes(axes: Axes, low: Array, high: Array, across: Array) -> None:
    """Draw the directions of the ground axes into the lower left corner."""
    size = AXIS * float(np.max(high - low))
    start = low + 1.5 * size
    arrow = {"arrowstyle": "-|>", "linewidth": 0.9, "color": "0.25", "shrinkA": 0, "shrinkB": 0}
    for name, direction in zip("xyz", np.eye(3), strict=True):
        way = across[:2] @ direction
        x, y = (start + size * way).tolist()
        axes.annotate("", (x, y), (float(start[0]), float(start[1])), arrowprops=arrow)
        # An axis that points to the viewer has no arrow: its name is written at the origin.
        x, y = (start + 1.25 * size * way + (0.0 if np.hypot(*way) > 0.3 else 0.25 * size)).tolist()
        axes.text(x, y, name, ha="center", va="center")
