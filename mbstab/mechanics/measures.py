"""What expressions may measure on a mechanism: angles and travels of joints, places and speeds of points, turn rates.

One text serves every number system: numbers, arrays, terms of a kernel. A measure is written like a call,
``angle(pivot)`` or ``vy(car.front_axle)``; forces may act along it. What is transmitted has no formula: outputs alone
measure it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Literal

from mbstab.records import dataclass

Argument = Literal["joint", "point", "body", "point.axis", "name.axis", "name"]


class Pose:
    """Where a body is, and how it is turned: coordinates and base rotation in any number system.

    Parameters
    ----------
    f : arithmetic
        Has ``sin``, ``cos``, ``sqrt`` and ``atan2``.
    dimension : int
    q : sequence of numbers
        Its coordinates: of a point only those of its place; none for the ground.
    base : sequence of 9 numbers
        The constant rotation before the angles, row by row (space only).
    """

    def __init__(self, f: Any, dimension: int, q: Sequence[Any], base: Sequence[Any]) -> None:
        self.f, self.dimension, self.q, self.base = f, dimension, q, base

    @property
    def origin(self) -> list[Any]:
        """The place of its reference point."""
        return list(self.q[: self.dimension]) or [0.0] * self.dimension

    def direction(self, v: Sequence[Any]) -> list[Any]:
        """Return a vector given in its axes in those of the ground."""
        f, angles = self.f, self.q[self.dimension :]
        v = list(v)
        if not angles:
            return v
        if self.dimension == 2:
            c, s = f.cos(angles[0]), f.sin(angles[0])
            return [c * v[0] - s * v[1], s * v[0] + c * v[1]]
        for axis in (2, 1, 0):
            c, s = f.cos(angles[axis]), f.sin(angles[axis])
            j, k = (axis + 1) % 3, (axis + 2) % 3
            v[j], v[k] = c * v[j] - s * v[k], s * v[j] + c * v[k]
        return [dot(self.base[3 * i : 3 * i + 3], v) for i in range(3)]

    def position(self, point: Sequence[Any]) -> list[Any]:
        """Return the place of one of its points."""
        return [x + y for x, y in zip(self.origin, self.direction(point), strict=True)]

    def axes(self) -> list[list[Any]]:
        """Return its axes in those of the ground."""
        return [self.direction([float(i == j) for i in range(self.dimension)]) for j in range(self.dimension)]


def dot(a: Sequence[Any], b: Sequence[Any]) -> Any:
    """Return the scalar product of two vectors."""
    products = [x * y for x, y in zip(a, b, strict=True)]
    return sum(products[1:], products[0])


Rate = Callable[[Any], Any]
"""Returns the time derivative of something that was computed from the coordinates."""
Formula = Callable[[Sequence[Pose], Sequence[Any], Rate], Any]
"""Returns a measure from the poses of its bodies and its numbers."""


@dataclass(frozen=True)
class Measure:
    """One kind of measure.

    Attributes
    ----------
    arguments : tuple of str
        ``joint``, ``point`` (body or body.point, also of the ground) or ``body``; in outputs ``point.axis`` and, of
        what transmits, ``name.axis`` or ``name``.
    doc, unit : str
    formula : callable or None
        None: it stands in outputs only.
    speed : bool
        Whether it is made of speeds, and has no rate.
    dimensions : tuple of int
    """

    arguments: tuple[Argument, ...]
    doc: str
    unit: str
    formula: Formula | None = None
    speed: bool = False
    dimensions: tuple[int, ...] = (2, 3)


def _angle(poses: Sequence[Pose], p: Sequence[Any], rate: Rate) -> Any:
    """Return an angle: in space from directions and the half turns from which it counts (`mbstab.model.turned`)."""
    first, second = poses
    if first.dimension == 2:
        one, two = (pose.q[2] if len(pose.q) > 2 else 0.0 for pose in poses)
        return one - two
    zero = first.direction(p[:3])
    return p[9] + first.f.atan2(dot(zero, second.direction(p[6:9])), dot(zero, second.direction(p[3:6])))


def _displacement(poses: Sequence[Pose], p: Sequence[Any], rate: Rate) -> Any:
    first, second = poses
    d = first.dimension
    gap = [x - y for x, y in zip(first.position(p[:d]), second.position(p[d : 2 * d]), strict=True)]
    return dot(second.direction(p[2 * d :]), gap)


def _place(axis: int) -> Formula:
    return lambda poses, p, rate: poses[0].position(p)[axis]


def _distance(poses: Sequence[Pose], p: Sequence[Any], rate: Rate) -> Any:
    first, second = poses
    d = first.dimension
    gap = [x - y for x, y in zip(first.position(p[:d]), second.position(p[d:]), strict=True)]
    return first.f.sqrt(dot(gap, gap))


def _speed(axis: int) -> Formula:
    def along(poses: Sequence[Pose], p: Sequence[Any], rate: Rate) -> Any:
        return dot(poses[0].axes()[axis], [rate(x) for x in poses[0].position(p)])

    return along


def _turn(axis: int) -> Formula:
    def about(poses: Sequence[Pose], p: Sequence[Any], rate: Rate) -> Any:
        axes = poses[0].axes()
        # ω × e_j has the component ω along e_k.
        return dot([rate(x) for x in axes[(axis + 1) % 3]], axes[(axis + 2) % 3])

    return about


_PLACES = {
    name: Measure(("point",), f"place of a point along {name}", "m", _place(i), dimensions=(2, 3)[i // 2 :])
    for i, name in enumerate("xyz")
}
_SPEEDS = {
    f"v{name}": Measure(
        ("point",),
        f"speed of a point along the axis {name} of its body",
        "m/s",
        _speed(i),
        speed=True,
        dimensions=(2, 3)[i // 2 :],
    )
    for i, name in enumerate("xyz")
}
_TURNS = {
    f"w{name}": Measure(
        ("body",), f"turn rate of a body about its own axis {name}", "rad/s", _turn(i), speed=True, dimensions=(3,)
    )
    for i, name in enumerate("xyz")
}

MEASURES: dict[str, Measure] = {
    "angle": Measure(("joint",), "angle of a joint; in space it counts from the turn of the reference", "rad", _angle),
    "displacement": Measure(("joint",), "travel of a joint", "m", _displacement),
    "distance": Measure(("point", "point"), "distance of two points", "m", _distance),
    **_PLACES,
    **_SPEEDS,
    **_TURNS,
    "place": Measure(("point.axis",), "in outputs: place of a point along an axis, x(point) for place(point.x)", "m"),
    "force": Measure(
        ("name.axis",), "in outputs: force that a joint, contact, drive or mount transmits to its first body", "N"
    ),
    "torque": Measure(("name.axis",), "in outputs: torque that it transmits", "N*m"),
    "effort": Measure(
        ("name",), "in outputs: force or torque of a spring, damper, actuator, controller, motor or drive", "N or N*m"
    ),
}
"""Every kind of measure by its name in expressions."""


def is_measure(name: str) -> bool:
    """Whether a name in an expression is a measure, such as ``angle(pivot)``."""
    return name.endswith(")")


def parts(name: str) -> tuple[str, list[str]]:
    """Return the kind of a measure and its arguments.

    >>> parts("distance(a.tip, ground)")
    ('distance', ['a.tip', 'ground'])
    """
    kind, _, rest = name.partition("(")
    return kind, rest.removesuffix(")").split(", ")


def is_speed(name: str) -> bool:
    """Whether a name in an expression is a measure made of speeds, such as ``vx(rod.tip)``, which has no integral."""
    return is_measure(name) and MEASURES[parts(name)[0]].speed
