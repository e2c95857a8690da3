"""Joints as tables of primitive constraints on two markers.

A marker is a point and a triad (v1, v2, v3) fixed in a body; v1 is the axis of the
joint. A new joint type that combines these primitives is one entry in `KINDS`; the rows
of Pappalardo, Lettieri, Guida (2020), Eqs. (145)-(150), are the ones listed there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from mbstab.mechanics.catalogue import Element, ElementUse, Field, Item, Kind, Look
from mbstab.records import dataclass

# --- elements: the primitives ---------------------------------------------------------------------------------------


def _coincident(frames: Any, p: Any, s: Any) -> Any:
    first, second = frames
    return list(first.position(p.first) - second.position(p.second))


def _in_plane(frames: Any, p: Any, s: Any) -> Any:
    first, second = frames
    return [first.direction(p.normal).dot(first.position(p.first) - second.position(p.second))]


def _perpendicular(frames: Any, p: Any, s: Any) -> Any:
    first, second = frames
    return [first.direction(p.first).dot(second.direction(p.second))]


def _aligned(frames: Any, p: Any, s: Any) -> Any:
    first, second = frames
    return [first.q[2] - second.q[2] + p.angle[0]]


def _distance(frames: Any, p: Any, s: Any) -> Any:
    # (d² − l²)/2l has the unit of a length and no square root of the coordinates.
    first, second = frames
    gap = first.position(p.first) - second.position(p.second)
    return [(gap.dot(gap) - p.length[0] ** 2) / (2 * p.length[0])]


def _screw(frames: Any, p: Any, s: Any) -> Any:
    # The sine keeps the row smooth over any number of turns; near the solution it is the angle itself.
    first, second = frames
    f, turn = first.f, 2 * first.f.constants["pi"]
    lift = turn / p.lead[0] * joint_displacement(first, second, p)
    cosine, sine = joint_angle_functions(first, second, p)
    return [p.lead[0] / turn * (sine * f.cos(lift) - cosine * f.sin(lift))]


def _equal_turns(frames: Any, p: Any, s: Any) -> Any:
    # 2 n·v1 tan(φ/2) of the turn by φ about n from the first triad to the second: no part of it is about the shaft.
    # v2·w3 − v3·w2 alone would vanish for every half turn, too.
    first, second = frames
    v1, v2, v3 = (first.direction(v) for v in (p.first_v1, p.first_v2, p.first_v3))
    w1, w2, w3 = (second.direction(w) for w in (p.second_v1, p.second_v2, p.second_v3))
    return [2 * (v3.dot(w2) - v2.dot(w3)) / (1 + v1.dot(w1) + v2.dot(w2) + v3.dot(w3))]


def joint_angle_functions(first: Any, second: Any, p: Any) -> tuple[Any, Any]:
    """Return cosine and sine of the turn of the first body relative to the second about the joint axis."""
    zero = first.direction(p.first_v2)
    return zero.dot(second.direction(p.second_v2)), zero.dot(second.direction(p.second_v3))


def joint_displacement(first: Any, second: Any, p: Any) -> Any:
    """Return the travel of the first body relative to the second along the axis of the second."""
    return second.direction(p.second_v1).dot(first.position(p.first) - second.position(p.second))


_BOTH = ("planar", "spatial")
_TRIADS = tuple((f"{side}_v{i}", 3) for side in ("first", "second") for i in (1, 2, 3))
_POINTS = (("first", 0), ("second", 0))

ELEMENTS = (
    Element("coincident", "holonomic", _BOTH, 2, _POINTS, _coincident, units=("m",)),
    Element("in_plane", "holonomic", _BOTH, 2, (*_POINTS, ("normal", 0)), _in_plane, units=("m",)),
    Element("perpendicular", "holonomic", ("spatial",), 2, _POINTS, _perpendicular, units=("1",)),
    Element("aligned", "holonomic", ("planar",), 2, (("angle", 1),), _aligned, units=("rad",)),
    Element(
        "distance",
        "holonomic",
        _BOTH,
        2,
        (*_POINTS, ("length", 1)),
        _distance,
        units=("m",),
        residual="(d² − l²) / 2l, with the distance d and the length l,",
    ),
    Element(
        "screw",
        "holonomic",
        ("spatial",),
        2,
        (*_POINTS, ("first_v2", 0), ("second_v1", 0), ("second_v2", 0), ("second_v3", 0), ("lead", 1)),
        _screw,
        units=("m",),
    ),
    Element(
        "equal_turns",
        "holonomic",
        ("spatial",),
        2,
        _TRIADS,
        _equal_turns,
        units=("rad",),
        hint="one shaft is turned by half a turn against the other, about itself or by bending; a constant_velocity "
        "joint bends by less, and the zero: directions of its shafts point the same way where it is straight",
    ),
)

# --- kinds: the table of joints -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Primitive:
    """One primitive constraint of a joint: the element and the triad vectors it takes from each marker."""

    element: str
    first: str = ""
    second: str = ""


_AT = "a point of each body, written body.point, body or ground"
BETWEEN = Field(
    "between",
    "markers",
    f"the two points joined: {_AT}; angles and travel are those of the first relative to the second",
    required=True,
)
AXIS = Field(
    "axis",
    "directions",
    "joint axis in the frame of each body: x, -y, a named direction or a vector; a list of two if they differ",
    required=True,
)
ZERO = Field(
    "zero",
    "zero directions",
    "direction from which the joint angle counts, in the frame of each body; if not given, y for a joint axis along x, "
    "z for y, x for z; for an oblique one as for the nearest of these, which may change with a parameter",
    dimensions=(3,),
)


def _build(*primitives: Primitive) -> Any:
    def build(item: Item) -> Iterable[ElementUse]:
        first, second = item.markers("between")
        triads = item.triads("axis", "zero") if any(p.first or p.second for p in primitives) else None
        for primitive in primitives:
            parameters: tuple[Any, ...]
            label = primitive.element.replace("_", " ")
            match primitive.element:
                case "coincident":
                    parameters = (*first.point, *second.point)
                case "distance":
                    parameters = (*first.point, *second.point, item.number("length"))
                case "in_plane":
                    assert triads is not None
                    parameters = (*first.point, *second.point, *getattr(triads[0], primitive.first))
                    label = f"{label} {primitive.first}"
                case "aligned":
                    parameters = (_angle_between(item),)
                case "equal_turns":
                    axes = (v for triad in item.triads("axis", "zero") for v in (triad.v1, triad.v2, triad.v3))
                    parameters = tuple(x for v in axes for x in v)
                case "screw":
                    parameters = (*motion_parameters(item, "angle and displacement"), item.number("lead"))
                case _:
                    assert triads is not None
                    parameters = (*getattr(triads[0], primitive.first), *getattr(triads[1], primitive.second))
                    label = f"{label} {primitive.first}-{primitive.second}"
            yield ElementUse(primitive.element, (first.body, second.body), parameters, labels=(label,))

    return build


def _angle_between(item: Item) -> Any:
    """Return the angle of the second body minus that of the first when their axes are parallel."""
    if not item.given("axis"):
        return 0.0
    (a, b), (c, d) = (t.v1 for t in item.triads("axis", "zero"))
    return item.functions.atan2(b * c - a * d, a * c + b * d)


def motion_parameters(item: Item, motion: str) -> tuple[Any, ...]:
    """Return the parameters from which the angle or the displacement of a joint is computed."""
    first, second = item.markers("between")
    if item.dimension == 2:
        if motion == "angle":
            return ()
        return (*first.point, *second.point, *item.triads("axis", "zero")[1].v1)
    one, two = item.triads("axis", "zero")
    if motion == "angle":
        return (*one.v2, *two.v2, *two.v3)
    if motion == "displacement":
        return (*first.point, *second.point, *two.v1)
    return (*first.point, *second.point, *one.v2, *two.v1, *two.v2, *two.v3)


_COINCIDENT = Primitive("coincident")
_PARALLEL = (Primitive("perpendicular", "v2", "v1"), Primitive("perpendicular", "v3", "v1"))
_ON_LINE = (Primitive("in_plane", "v2"), Primitive("in_plane", "v3"))
_NO_TURN = Primitive("perpendicular", "v2", "v3")


def _joint(
    name: str,
    doc: str,
    *primitives: Primitive,
    dimensions: tuple[int, ...] = (3,),
    fields: tuple[Field, ...] = (AXIS, ZERO),
    motions: tuple[str, ...] = (),
    look: Callable[[Item], tuple[Look, ...]] | None = None,
) -> Kind:
    return Kind(name, doc, dimensions, (BETWEEN, *fields), _build(*primitives), motions, look=look)


def _pin(item: Item) -> tuple[Look, ...]:
    return (Look("pin", item.markers("between")),)


def _slider(item: Item) -> tuple[Look, ...]:
    return (Look("slider", item.markers("between")),)


def _rod(item: Item) -> tuple[Look, ...]:
    return (Look("rod", item.markers("between")),)


_FREE_AXIS = Field(AXIS.name, AXIS.shape, "direction held parallel, in the frame of each body", default="x")

KINDS: tuple[Kind, ...] = (
    _joint("revolute", "turns about an axis", _COINCIDENT, *_PARALLEL, motions=("angle",), look=_pin),
    _joint("revolute", "turns about a point", _COINCIDENT, dimensions=(2,), fields=(), motions=("angle",), look=_pin),
    _joint(
        "prismatic", "slides along an axis", *_ON_LINE, *_PARALLEL, _NO_TURN, motions=("displacement",), look=_slider
    ),
    _joint(
        "prismatic",
        "slides along an axis",
        Primitive("in_plane", "v2"),
        Primitive("aligned"),
        dimensions=(2,),
        fields=(AXIS,),
        motions=("displacement",),
        look=_slider,
    ),
    _joint(
        "cylindrical",
        "turns about and slides along an axis",
        *_ON_LINE,
        *_PARALLEL,
        motions=("angle", "displacement"),
        look=_slider,
    ),
    _joint(
        "universal",
        "Hooke's joint: the axes of the two bodies meet at a right angle",
        _COINCIDENT,
        Primitive("perpendicular", "v1", "v1"),
        look=_pin,
    ),
    _joint(
        "constant_velocity",
        "homokinetic joint: the shafts along the axes of the two bodies turn equally at any bend between them",
        _COINCIDENT,
        Primitive("equal_turns"),
        look=_pin,
    ),
    _joint("spherical", "turns in every direction about a point", _COINCIDENT, dimensions=(2, 3), fields=(), look=_pin),
    _joint(
        "planar",
        "slides and turns in the plane across the axis",
        Primitive("in_plane", "v1"),
        Primitive("perpendicular", "v1", "v2"),
        Primitive("perpendicular", "v1", "v3"),
        motions=("angle",),
        look=_slider,
    ),
    _joint(
        "fixed",
        "holds the bodies together; their axes coincide",
        _COINCIDENT,
        *_PARALLEL,
        _NO_TURN,
        fields=(Field(AXIS.name, AXIS.shape, AXIS.doc, default="z"), ZERO),
    ),
    _joint(
        "fixed", "holds the bodies together", _COINCIDENT, Primitive("aligned"), dimensions=(2,), fields=(_FREE_AXIS,)
    ),
    _joint(
        "point_on_line",
        "a point of the second body slides along an axis of the first, turning freely",
        *_ON_LINE,
        look=_slider,
    ),
    _joint(
        "point_on_line",
        "a point of the second body slides along an axis of the first, turning freely",
        Primitive("in_plane", "v2"),
        dimensions=(2,),
        fields=(AXIS,),
        look=_slider,
    ),
    _joint(
        "point_on_plane",
        "a point of the second body stays in the plane across an axis of the first, turning freely",
        Primitive("in_plane", "v1"),
        fields=(AXIS,),
        look=_slider,
    ),
    _joint(
        "distance",
        "massless rod: keeps two points at a distance",
        Primitive("distance"),
        dimensions=(2, 3),
        fields=(Field("length", "number", "the distance", "m", required=True, sign="positive"),),
        look=_rod,
    ),
    _joint(
        "screw",
        "turns about an axis and advances by the lead in each turn",
        *_ON_LINE,
        *_PARALLEL,
        Primitive("screw"),
        fields=(
            AXIS,
            ZERO,
            Field(
                "lead",
                "number",
                "advance in one turn, negative for a left-hand thread",
                "m",
                required=True,
                sign="nonzero",
            ),
        ),
        motions=("angle", "displacement"),
        look=_slider,
    ),
)
