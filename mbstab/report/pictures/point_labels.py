"""Labels of points, placed where they hide neither each other nor the curves."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import field

import numpy as np
from matplotlib.axes import Axes

from mbstab.compiler.system import Array
from mbstab.records import dataclass
from mbstab.report.picture_sizes import FONT, scaled
from mbstab.report.pictures.drawing import text_width

Box = tuple[float, float, float, float]
"""Left, lower, right and upper edge (points)."""

LABELS = 60
"""Largest number of points that are labelled."""

HIDDEN, FAR, CROSSED, ASTRAY, OVERLAP, OUTSIDE = 5.0, 0.25, 40.0, 60.0, 200.0, 600.0
"""Cost of a piece of a curve that is hidden, of a point of distance, of a pointer across a label, of standing
beside the marker of another point, of hitting a label, of leaving the frame."""

BESIDE = 1.5
"""A label belongs to the marker of another point if that is nearer than this many times the distance of its own."""

GAP = 3.0
"""Room beside a label (points on a page)."""

DIRECTIONS = (
    (1, 1), (-1, 1), (1, -1), (-1, -1), (1, 0), (-1, 0), (0, 1), (0, -1),
    (2, 1), (-2, 1), (2, -1), (-2, -1), (1, 2), (-1, 2), (1, -2), (-1, -2),
)  # fmt: skip
"""Sides of a point on which its label may stand, the best first."""

BACKGROUND = 1.0
"""Lines up to this layer may be hidden."""

PIECE = 3.0
"""Length of a piece of a curve (points)."""


@dataclass
class PointLabels:
    """Labels of points, placed where they hide neither each other nor curves. Set the limits of the axes first.

    Attributes
    ----------
    axes : Axes
    wanted : list of (x, y, text, marked, ink)
    """

    axes: Axes
    wanted: list[tuple[float, float, str, bool, str]] = field(default_factory=list)

    def add(self, x: float, y: float, text: str, marked: bool = True, ink: str = "k") -> None:
        """Request a label at a point; it stays farther from a point that is marked."""
        self.wanted.append((x, y, text, marked, ink))

    def draw(self) -> None:
        """Place the labels."""
        if not self.wanted:
            return
        scale = 72.0 / self.axes.figure.dpi
        extent = self.axes.get_window_extent()
        x0, y0, x1, y1 = (scale * v for v in (extent.x0, extent.y0, extent.x1, extent.y1))
        frame = x0 + 1.0, y0 + 1.0, x1 - 1.0, y1 - 1.0
        busy = drawn_points(self.axes)
        points = scale * self.axes.transData.transform([(x, y) for x, y, *_ in self.wanted])
        marks = [(px - 4.0, py - 4.0, px + 4.0, py + 4.0) for px, py in points]
        others = _markers(self.axes)
        labels: list[Box] = []
        for (x, y, text, marked, ink), (px, py) in zip(self.wanted, points, strict=True):
            size = text_width(text, scaled(FONT)) + 2.0, scaled(FONT) + 3.0
            distances = (7.0, 18.0, 32.0, 50.0, 75.0, 100.0) if marked else (2.0, 5.0, 9.0, 18.0, 30.0, 50.0)
            boxes = _places(px, py, size, [scaled(far) for far in distances], frame)
            costs = [
                _cost(box, far, busy, [*marks, *labels], frame)
                + CROSSED * _crossed(_pointer(box, px, py), labels)
                + ASTRAY * (marked and _astray(box, px, py, others))
                for box, far in boxes
            ]
            place, _ = boxes[int(np.argmin(costs))]
            pointer = _pointer(place, px, py)
            busy = np.concatenate([busy, pointer])
            labels.append((place[0] - scaled(GAP), place[1], place[2] + scaled(GAP), place[3]))
            shift = (0.5 * (place[0] + place[2]) - px, 0.5 * (place[1] + place[3]) - py)
            self.axes.annotate(
                text, (x, y), shift, textcoords="offset points", ha="center", va="center", zorder=6, color=ink,
                bbox={"boxstyle": "square,pad=0.1", "facecolor": "w", "alpha": 0.8, "linewidth": 0},
                arrowprops={"arrowstyle": "-", "linewidth": 0.5, "color": "0.3"} if len(pointer) else None,
            )  # fmt: skip


def _markers(axes: Axes) -> Array:
    """Return the places of markers (points)."""
    scale = 72.0 / axes.figure.dpi
    lines = [line for line in axes.get_lines() if line.get_linestyle() == "None" and line.get_zorder() > BACKGROUND]
    found = [scale * x.get_transform().transform(np.asarray(x.get_xydata(), dtype=float)) for x in lines]
    return np.concatenate([*found, np.zeros((0, 2))])


def _astray(box: Box, x: float, y: float, others: Array) -> bool:
    """Return whether a label without a pointer seems to belong to the marker of another point than its own."""
    places = others[np.hypot(*(others - (x, y)).T) > 1.0]
    if len(_pointer(box, x, y)) or not len(places):
        return False
    return bool(np.min(_distance(box, *places.T)) < BESIDE * float(_distance(box, np.array(x), np.array(y))))


def _distance(box: Box, x: Array, y: Array) -> Array:
    """Return the distances of points from a box."""
    sideways, upwards = np.maximum(box[0] - x, x - box[2]), np.maximum(box[1] - y, y - box[3])
    found: Array = np.hypot(np.maximum(sideways, 0.0), np.maximum(upwards, 0.0))
    return found


def drawn_points(axes: Axes) -> Array:
    """Return points (typographical ones) along all curves of the axes, at both edges of thick ones, and of markers."""
    scale, found = 72.0 / axes.figure.dpi, []
    for line in axes.get_lines():
        xy = scale * line.get_transform().transform(np.asarray(line.get_xydata(), dtype=float))
        xy = xy[np.isfinite(xy).all(axis=1)]
        if line.get_zorder() <= BACKGROUND or not len(xy):
            continue
        if line.get_linestyle() == "None":  # markers
            found += [xy + shift for shift in (0.0, *np.eye(2) * PIECE, *np.eye(2) * -PIECE)] * 2
            continue
        along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(xy, axis=0).T))])
        even = np.linspace(0.0, along[-1], min(int(along[-1] / PIECE) + 2, 5000))
        points = np.column_stack([np.interp(even, along, part) for part in xy.T])
        half = 0.5 * line.get_linewidth()
        found += (
            [points + shift for shift in (np.array([0.0, half]), np.array([0.0, -half]))] if half > 1.0 else [points]
        )
    return np.concatenate(found) if found else np.zeros((0, 2))


def _places(
    x: float, y: float, size: tuple[float, float], distances: Sequence[float], frame: Box
) -> list[tuple[Box, float]]:
    """Return the possible boxes (points) of a label beside a point, each with its distance from the point.

    They are shifted sideways into the frame.
    """
    w, h = size
    left, right = frame[0] + 0.5 * w, frame[2] - 0.5 * w
    found = []
    for far in distances:
        for ux, uy in DIRECTIONS:
            step = far / math.hypot(ux, uy)
            cx = min(max(x + ux * step + 0.5 * w * np.sign(ux), left), right)
            cy = y + uy * step + 0.5 * h * np.sign(uy)
            found.append(((cx - 0.5 * w, cy - 0.5 * h, cx + 0.5 * w, cy + 0.5 * h), far))
    return found


def _cost(box: Box, far: float, busy: Array, taken: Sequence[Box], frame: Sequence[float]) -> float:
    """Return the cost of a box that hides curves or other labels, leaves the frame, or is far from its point."""
    hidden = np.count_nonzero(((busy > box[:2]) & (busy < box[2:])).all(axis=1))
    overlaps = sum(meet(box, other) for other in taken)
    left, low, right, high = frame
    outside = box[0] < left or box[2] > right or box[1] < low or box[3] > high
    return HIDDEN * hidden + FAR * far + OVERLAP * overlaps + OUTSIDE * outside


def _pointer(box: Box, x: float, y: float) -> Array:
    """Return points along the line from a label to its point, none where it is beside it."""
    middle = 0.5 * (box[0] + box[2]), 0.5 * (box[1] + box[3])
    if _distance(box, np.array(x), np.array(y)) <= scaled(12.0):
        return np.zeros((0, 2))
    return np.linspace((x, y), middle, 2 + int(math.hypot(middle[0] - x, middle[1] - y) / PIECE))


def _crossed(points: Array, boxes: Sequence[Box]) -> int:
    """Return how many boxes a line of points crosses."""
    return sum(bool(((points > box[:2]) & (points < box[2:])).all(axis=1).any()) for box in boxes)


def meet(one: Box, other: Box) -> bool:
    """Return whether two boxes overlap."""
    return one[0] < other[2] and other[0] < one[2] and one[1] < other[3] and other[1] < one[3]
