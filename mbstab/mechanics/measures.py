"""What expressions may measure on a mechanism: angles and travels of joints, places and speeds of points, turn rates.

One text serves every number system: numbers, arrays, terms of a kernel. A measure is written like a call,
``angle(pivot)`` or ``vy(car.front_axle)``; forces may act along it. What is transmitted has no formula: outputs alone
measure it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, Literal

from mbstab.mechanics.catalogue import FRAMES, Element, Role
from mbstab.mechanics.frames import Frame
from mbstab.records import dataclass

Argument = Literal["joint", "point", "body", "point.axis", "name.axis", "name"]


Formula = Callable[[Sequence[Frame], Sequence[Any]], Any]
"""Returns a measure from the frames of its bodies and its numbers."""


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
    numbers : (int, int)
        How many numbers the formula takes in the plane and in space.
    root : bool
        Whether the formula gives half the square of the measure, which has derivatives where the measure is zero.
    """

    arguments: tuple[Argument, ...]
    doc: str
    unit: str
    formula: Formula | None = None
    speed: bool = False
    dimensions: tuple[int, ...] = (2, 3)
    numbers: tuple[int, int] = (0, 0)
    root: bool = False

    def elements(self, name: str) -> Iterable[Element]:
        """Return the elements whose only row is the formula, by which expressions are derived."""
        for dimension in self.dimensions:
            frame, count = FRAMES[dimension], self.numbers[dimension - 2]
            role: Role = "nonholonomic" if self.speed else "holonomic"
            parameters = (("numbers", count),) if count else ()
            slots = 2 if self.arguments == ("joint",) else len(self.arguments)
            yield Element(f"measure_{name}", role, (frame,), slots, parameters, self._row, units=("1",), measured=True)

    def _row(self, frames: Sequence[Frame], p: Any, s: Any) -> list[Any]:
        assert self.formula is not None
        return [self.formula(frames, getattr(p, "numbers", ()))]


def _angle(frames: Sequence[Frame], p: Sequence[Any]) -> Any:
    """Return an angle: in space from directions and the half turns from which it counts (`mbstab.model.turned`)."""
    first, second = frames
    if first.dimension == 2:
        one, two = (frame.q[2] if len(frame.q) > 2 else 0.0 for frame in frames)
        return one - two
    zero = first.direction(p[:3])
    return p[9] + first.f.atan2(zero.dot(second.direction(p[6:9])), zero.dot(second.direction(p[3:6])))


def _displacement(frames: Sequence[Frame], p: Sequence[Any]) -> Any:
    first, second = frames
    d = first.dimension
    return second.direction(p[2 * d :]).dot(first.position(p[:d]) - second.position(p[d : 2 * d]))


def _place(axis: int) -> Formula:
    return lambda frames, p: frames[0].position(p)[axis]


def _half_square_of_distance(frames: Sequence[Frame], p: Sequence[Any]) -> Any:
    first, second = frames
    d = first.dimension
    gap = first.position(p[:d]) - second.position(p[d:])
    return gap.dot(gap) / 2


def _speed(axis: int) -> Formula:
    return lambda frames, p: frames[0].axes[axis].dot(frames[0].velocity(p))


def _turn(axis: int) -> Formula:
    return lambda frames, p: frames[0].local_angular_velocity()[axis]


_PLACES = {
    name: Measure(
        ("point",), f"place of a point along {name}", "m", _place(i), dimensions=(2, 3)[i // 2 :], numbers=(2, 3)
    )
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
        numbers=(2, 3),
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
    "angle": Measure(
        ("joint",),
        "angle of a joint; in space it counts from the turn of the reference",
        "rad",
        _angle,
        numbers=(0, 10),
    ),
    "displacement": Measure(("joint",), "travel of a joint", "m", _displacement, numbers=(6, 9)),
    "distance": Measure(
        ("point", "point"), "distance of two points", "m", _half_square_of_distance, numbers=(4, 6), root=True
    ),
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

ELEMENTS = tuple(x for name, kind in MEASURES.items() if kind.formula for x in kind.elements(name))


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
