"""Labels of points and of curves, placed where they hide neither each other nor the curves."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import field, replace

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from mbstab.analysis.algebra.arrays import Index
from mbstab.compiler.system import Array
from mbstab.records import dataclass
from mbstab.report.picture_sizes import FONT, scaled
from mbstab.report.pictures.curves import THIN, Mask
from mbstab.report.pictures.drawing import text_width

Box = tuple[float, float, float, float]
"""Left, lower, right and upper edge (points)."""

LABELS = 60
"""Largest number of points that are labelled."""

HIDDEN, FAR, ASTRAY, COVERED, CROSSED, OVERLAP, OUTSIDE = 5.0, 0.25, 60.0, 200.0, 300.0, 1000.0, 2000.0
"""Cost of a piece of a curve that is hidden, of a point of distance, of standing beside the marker of another point, of
covering one, of a pointer across a label or another pointer, of hitting a label, of leaving the frame."""

BESIDE = 1.5
"""A label belongs to the marker of another point if that is nearer than this many times the distance of its own."""

LATER = 0.25
"""What a label does to a later one, which is less important, counts as this part."""

POINTED = 30.0
"""Cost of a line from the label of a curve to it."""

NEARER = 0.5
"""A label belongs to another curve if that is nearer by this (points)."""

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

NEIGHBOURS, SHARED = 7.0, 3
"""Points nearer to each other than this (points on a page) share a label, so many at most."""

ROUNDS = 4
"""Labels are placed again, with all others in their places, in so many rounds at most."""


@dataclass(frozen=True)
class Label:
    """A text, and the points of the data at one of which it may stand.

    Attributes
    ----------
    text : str
    places : ndarray, shape (k, 2)
    dislike : ndarray, shape (k,)
        Cost of each place.
    marked : bool
        Whether there is a marker, from which the text stays farther away.
    ink : str
    shared : bool
        Whether it names several markers.
    """

    text: str
    places: Array
    dislike: Array
    marked: bool
    ink: str
    shared: bool = False


@dataclass(frozen=True)
class _Choices:
    """The boxes in which a label may stand (typographical points).

    Attributes
    ----------
    boxes : ndarray, shape (n, 4)
        As `Box`.
    feet : ndarray, shape (n, 2)
        The point to which each belongs.
    places : ndarray of int, shape (n,)
        Its number in the label.
    pointed : ndarray of bool, shape (n,)
        Whether a line leads there.
    cost : ndarray, shape (n,)
        Without other labels.
    """

    boxes: Array
    feet: Array
    places: Index
    pointed: Mask
    cost: Array

    @property
    def middles(self) -> Array:
        """The middles of the boxes, shape (n, 2)."""
        return 0.5 * (self.boxes[:, :2] + self.boxes[:, 2:])


@dataclass
class PointLabels:
    """Labels of points, placed where they hide neither each other nor curves. Set the limits of the axes first.

    Attributes
    ----------
    axes : Axes
    wanted : list of Label
    """

    axes: Axes
    wanted: list[Label] = field(default_factory=list)

    def add(self, x: float, y: float, text: str, marked: bool = True, ink: str = "k") -> None:
        """Request a label at a point; it stays farther from a point that is marked."""
        self.wanted.append(Label(text, np.array([[x, y]]), np.zeros(1), marked, ink))

    def add_along(self, places: Array, dislike: Array, text: str, ink: str = "k") -> None:
        """Request a label at one of the points of a curve, shape (k, 2), each with a cost."""
        self.wanted.append(Label(text, places, dislike, False, ink))

    def left_out(self) -> list[Label]:
        """Give up the labels that have no room, and return them."""
        self._share()
        choices, chosen = self._placed()
        kept = list(range(len(chosen)))

        def in_the_way(n: int) -> bool:
            others = [choices[m] for m in kept]
            cost = _dynamic(others, [chosen[m] for m in kept], kept.index(n))[chosen[n]]
            return bool(cost >= CROSSED or choices[n].cost[chosen[n]] >= OUTSIDE)

        for n in range(len(chosen) - 1, -1, -1):  # the last ones first
            if in_the_way(n):
                kept.remove(n)
        found = [label for n, label in enumerate(self.wanted) if n not in kept]
        self.wanted = [self.wanted[n] for n in kept]
        return found

    def draw(self) -> None:
        """Place the labels."""
        self._share()
        choices, chosen = self._placed()
        for label, own, k in zip(self.wanted, choices, chosen, strict=True):
            shift = own.middles[k] - own.feet[k]
            self.axes.annotate(
                label.text, tuple(label.places[own.places[k]].tolist()), tuple(shift.tolist()),
                textcoords="offset points", ha="center", va="center", zorder=6, color=label.ink,
                bbox={"boxstyle": "square,pad=0.1", "facecolor": "w", "alpha": 0.8, "linewidth": 0},
                arrowprops={"arrowstyle": "-", "linewidth": 0.5, "color": "0.3"} if own.pointed[k] else None,
            )  # fmt: skip

    def _points(self, places: Array) -> Array:
        """Return points of the data in the picture (typographical points)."""
        found: Array = np.asarray(self.axes.transData.transform(places)) * (72.0 / self.axes.figure.dpi)
        return found

    def _share(self) -> None:
        """Give markers that cover each other one label."""
        if any(label.shared for label in self.wanted):
            return
        kept: list[Label] = []
        groups: list[list[str]] = []
        for label in self.wanted:
            at = self._points(label.places[:1])[0]
            near = (
                k for k, other in enumerate(kept)
                if label.marked and other.marked and len(groups[k]) < SHARED
                and math.dist(at, self._points(other.places[:1])[0]) < scaled(NEIGHBOURS)
            )  # fmt: skip
            k = next(near, None)
            if k is None:
                kept.append(label)
                groups.append([label.text])
            else:
                groups[k] += [label.text] * (label.text not in groups[k])
                kept[k] = replace(kept[k], shared=True, ink=label.ink if label.ink == kept[k].ink else "k")
        self.wanted = [replace(label, text=_joined(texts)) for label, texts in zip(kept, groups, strict=True)]

    def _others(self, label: Label, own: Array) -> Array:
        """Return the places of the markers that a label does not name (typographical points)."""
        places = _markers(self.axes)
        found: Array = places[np.hypot(*(places - own).T) > (scaled(NEIGHBOURS) if label.shared else 1.0)]
        return found

    def _placed(self) -> tuple[list[_Choices], list[int]]:
        """Return the boxes of all labels, and which of them are taken."""
        choices = [self._choices(label, crowd) for crowd in [self._crowd()] for label in self.wanted]
        chosen: list[int] = []
        for n in range(len(choices)):
            chosen.append(int(np.argmin(_dynamic(choices, [*chosen, 0], n) + choices[n].cost)))
        for _ in range(ROUNDS):
            before = list(chosen)
            for n in range(len(choices)):
                chosen[n] = int(np.argmin(_dynamic(choices, chosen, n, LATER) + choices[n].cost))
            if chosen == before:
                break
        return choices, chosen

    def _crowd(self) -> _Crowd:
        scale = 72.0 / self.axes.figure.dpi
        left, low, right, high = (scale * v for v in self.axes.get_window_extent().extents)
        return _Crowd.of(drawn_points(self.axes), (left, low, right, high))

    def _choices(self, label: Label, crowd: _Crowd) -> _Choices:
        """Return the boxes in which a label may stand, beside each of its points, and their costs."""
        size = text_width(label.text, scaled(FONT)) + 2.0, scaled(FONT) + 3.0
        reach = (7.0, 18.0, 32.0, 50.0, 75.0, 100.0) if label.marked else (2.0, 5.0, 9.0, 18.0, 30.0, 50.0)
        feet = self._points(label.places)
        ways = np.array([np.divide(way, math.hypot(*way)) for way in DIRECTIONS])
        far = np.array([scaled(x) for x in reach])
        left, low, right, high = crowd.frame
        # Beside every point, at every distance, in every direction; shifted sideways into the frame.
        middle = feet[:, None, None] + far[:, None, None] * ways + 0.5 * np.sign(ways) * size
        middle[..., 0] = np.clip(middle[..., 0], left + 0.5 * size[0], max(right - 0.5 * size[0], left))
        middles = middle.reshape(-1, 2)
        places = np.repeat(np.arange(len(feet)), len(far) * len(ways))
        distance = np.tile(np.repeat(far, len(ways)), len(feet))
        if not label.marked:  # it may interrupt its curve
            middles, places = np.concatenate([middles, feet]), np.concatenate([places, np.arange(len(feet))])
            distance = np.concatenate([distance, np.zeros(len(feet))])
        boxes = np.concatenate([middles - np.multiply(0.5, size), middles + np.multiply(0.5, size)], axis=1)
        outside = (boxes[:, 0] < left) | (boxes[:, 2] > right) | (boxes[:, 1] < low) | (boxes[:, 3] > high)
        cost = HIDDEN * crowd.inside(boxes) + FAR * distance + OUTSIDE * outside + label.dislike[places]
        for other in self.wanted:
            if other.marked:
                ((x, y),) = self._points(other.places[:1]).tolist()
                cost = cost + COVERED * _meet(boxes, np.array((x - 4.0, y - 4.0, x + 4.0, y + 4.0)))
        apart = _distance(boxes, feet[places])
        pointed = apart > scaled(12.0)
        if label.marked:
            cost = cost + ASTRAY * _astray(boxes, apart, self._others(label, feet[0])) * ~pointed
        else:
            nearer = boxes + (apart[:, None] - NEARER) * np.array([-1.0, -1.0, 1.0, 1.0])
            cost = cost + np.where(pointed, POINTED, ASTRAY * ((apart > 0.0) & (crowd.inside(nearer) > 0.0)))
        return _Choices(boxes, feet[places], places, pointed, cost)


@dataclass(frozen=True)
class _Crowd:
    """The points of curves in a panel, counted in boxes.

    Attributes
    ----------
    frame : Box
    sums : ndarray, shape (columns + 1, rows + 1)
        Points to the left of and below the corners of squares of one typographical point.
    """

    frame: Box
    sums: Array

    @classmethod
    def of(cls, points: Array, extent: Box) -> _Crowd:
        """Count points in a panel."""
        left, low, right, high = extent
        edges = [np.arange(a, b + 1.0) for a, b in ((left, right), (low, high))]
        counts, _, _ = np.histogram2d(points[:, 0], points[:, 1], bins=edges)
        sums = np.pad(np.cumsum(np.cumsum(counts, axis=0), axis=1), ((1, 0), (1, 0)))
        return cls((left + 1.0, low + 1.0, right - 1.0, high - 1.0), sums)

    def inside(self, boxes: Array) -> Array:
        """Return how many points are in each box, shape (n, 4)."""
        origin = np.array(self.frame[:2]) - 1.0
        low, high = (
            np.clip(np.rint(corner - origin).astype(int), 0, np.array(self.sums.shape) - 1)
            for corner in (boxes[:, :2], boxes[:, 2:])
        )
        s = self.sums
        found: Array = s[*high.T] - s[low[:, 0], high[:, 1]] - s[high[:, 0], low[:, 1]] + s[*low.T]
        return found


def _joined(texts: Sequence[str]) -> str:
    """Return texts as one, with the words that they begin and end with once.

    >>> _joined(["u = 5.9 m/s", "u = 10.7 m/s"]), _joined(["2.5", "3"])
    ('u = 5.9, 10.7 m/s', '2.5, 3')
    """
    words = [text.split() for text in texts]
    if len(texts) == 1 or len({len(x) for x in words}) > 1:
        return ", ".join(texts)
    alike = [len(set(column)) == 1 for column in zip(*words, strict=True)]
    first, last = alike.index(False), len(alike) - alike[::-1].index(False)
    middle = ", ".join(" ".join(x[first:last]) for x in words)
    return " ".join([*words[0][:first], middle, *words[0][last:]])


def _dynamic(choices: Sequence[_Choices], chosen: Sequence[int], n: int, later: float = 1.0) -> Array:
    """Return the cost of each box of a label for what it does to the labels that are placed, and they to it.

    What it does to later ones counts as a part.
    """
    own = choices[n]
    cost = np.zeros(len(own.boxes))
    wider = own.boxes + np.array([-1.0, 0.0, 1.0, 0.0]) * scaled(GAP)
    middles = own.middles
    for m, k in ((m, chosen[m]) for m in range(len(chosen)) if m != n):
        other, weight = choices[m], later if m > n else 1.0
        box, foot, middle = other.boxes[k], other.feet[k], other.middles[k]
        cost += weight * OVERLAP * _meet(wider, box)
        crossed = own.pointed & _enters(own.feet, middles, box[None])
        if other.pointed[k]:
            crossed = crossed | _enters(foot[None], middle[None], own.boxes)
            same = np.hypot(*(own.feet - foot).T) < 1.0
            crossed = crossed | (own.pointed & ~same & _cross(own.feet, middles, foot, middle))
        cost += weight * CROSSED * crossed
    return cost


def _meet(boxes: Array, other: Array) -> Mask:
    """Return which boxes, shape (n, 4), overlap another one."""
    found: Mask = np.all((boxes[:, :2] < other[2:]) & (other[:2] < boxes[:, 2:]), axis=1)
    return found


def _enters(start: Array, end: Array, boxes: Array) -> Mask:
    """Return which lines from start to end, shape (n, 2) or (1, 2), pass through boxes, shape (n, 4) or (1, 4)."""
    way = np.where(end == start, 1e-12, end - start)
    one, two = (boxes[:, :2] - start) / way, (boxes[:, 2:] - start) / way
    enter, leave = np.max(np.minimum(one, two), axis=1), np.min(np.maximum(one, two), axis=1)
    found: Mask = (enter < leave) & (leave > 0.0) & (enter < 1.0)
    return found


def _cross(start: Array, end: Array, a: Array, b: Array) -> Mask:
    """Return which lines from start to end, shape (n, 2), cross the one from a to b, shape (2,)."""

    def side(p: Array, q: Array, r: Array) -> Array:
        u, v = q - p, r - p
        found: Array = u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]
        return found

    found: Mask = (side(start, end, a) * side(start, end, b) < 0.0) & (side(a, b, start) * side(a, b, end) < 0.0)
    return found


def _markers(axes: Axes) -> Array:
    """Return the places of markers (points)."""
    scale = 72.0 / axes.figure.dpi
    lines = [line for line in axes.get_lines() if line.get_linestyle() == "None" and line.get_zorder() > BACKGROUND]
    found = [scale * x.get_transform().transform(np.asarray(x.get_xydata(), dtype=float)) for x in lines]
    return np.concatenate([*found, np.zeros((0, 2))])


def _astray(boxes: Array, apart: Array, others: Array) -> Mask:
    """Return which boxes of a label, by their distance from its point, seem to belong to another marker."""
    nearest = np.full(len(boxes), np.inf)
    for place in others:
        nearest = np.minimum(nearest, _distance(boxes, place[None]))
    found: Mask = nearest < BESIDE * apart
    return found


def _distance(boxes: Array, points: Array) -> Array:
    """Return the distances of points, shape (n, 2) or (1, 2), from boxes, shape (n, 4)."""
    beside = np.maximum(boxes[:, :2] - points, points - boxes[:, 2:])
    found: Array = np.hypot(*np.maximum(beside, 0.0).T)
    return found


def label_entries(labels: Sequence[Label]) -> list[Artist]:
    """Return legend entries for labels that have no room: their texts, of curves with their colours."""
    return [
        Line2D([], [], color=label.ink, linestyle="none" if label.marked else "-", linewidth=THIN, label=label.text)
        for label in labels
    ]


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


def meet(one: Box, other: Box) -> bool:
    """Return whether two boxes overlap."""
    return one[0] < other[2] and other[0] < one[2] and one[1] < other[3] and other[1] < one[3]
