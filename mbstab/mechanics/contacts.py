"""Contacts with a line or plane: rolling wheels, skates, knife edges, ellipsoids.

The line or plane stays where it is. Its material may move along it, with a given velocity V of its point o and, in
space, a given rate Ω about its normal: at the contact point p it has the velocity V + Ω n × (p − o), and slip counts
against that.

The wheel is a circle of radius R thickened by a tube of radius r (r = 0: a knife edge).
With axle a and plane normal n the contact point lies at
−R (n − (n·a) a)/|n − (n·a) a| − r n from the centre.

The ellipsoid has its semi-axes D = diag(a, b, c) along the axes of its body. With the
normal n in body components the contact point lies at −D² n/h from the centre, at the
height h = |D n| below it. As n is a unit vector, h² = ρ² + n·(D² − ρ²) n for any ρ; with
the shortest semi-axis nothing cancels, and the height of a ball is constant to the
last digit; otherwise round-off would act as a stiffness and could make the ball unstable.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from mbstab.mechanics.catalogue import Element, ElementUse, Field, Form, Item, Kind, Look, Vector
from mbstab.mechanics.frames import Column, dot
from mbstab.mechanics.vectors import representative, triad, turned

# --- elements -------------------------------------------------------------------------------------------------------


def _disk_height(frames: Any, p: Any, s: Any) -> Any:
    return [p.normal.dot(frames[0].position(p.center)) - p.level[0]]


def _disk_slip(frames: Any, p: Any, s: Any) -> Any:
    # Material velocity along the line at the contact: v + ω × (−R n), along t = −n turned.
    velocity = frames[0].velocity(p.center)
    carried = p.normal[1] * s[0] - p.normal[0] * s[1] if s else 0
    return [p.normal[1] * velocity[0] - p.normal[0] * velocity[1] + p.radius[0] * frames[0].u[2] - carried]


def _between_rollers(frames: Any, p: Any) -> tuple[Any, Any]:
    """Return the distance of two centres and the direction from the second to the first."""
    gap = frames[0].position(p.first) - frames[1].position(p.second)
    apart = frames[0].f.sqrt(gap.dot(gap))
    return apart, gap / apart


def _roller_distance(frames: Any, p: Any, s: Any) -> Any:
    apart, _ = _between_rollers(frames, p)
    return [apart - p.radii[0] - p.radii[1]]


def _roller_slip(frames: Any, p: Any, s: Any) -> Any:
    # Material velocities at the contact, −r₁ n from the first centre and r₂ n from the second, along n turned.
    _, n = _between_rollers(frames, p)
    velocity = frames[0].velocity(p.first) - frames[1].velocity(p.second)
    return [n[0] * velocity[1] - n[1] * velocity[0] - p.radii[0] * frames[0].u[2] - p.radii[1] * frames[1].u[2]]


def wheel_at_contact(frame: Any, p: Any) -> tuple[Any, Any, Any]:
    """Return the vector from the centre to the contact, and the unit directions along and across the track."""
    axle = frame.direction(p.axle)
    heading = axle.cross(p.normal)
    tilt = frame.f.sqrt(heading.dot(heading))
    down = p.normal - p.normal.dot(axle) * axle
    return -p.radius[0] * down / tilt - p.tube[0] * p.normal, heading / tilt, p.normal.cross(heading) / tilt


def _wheel_height(frames: Any, p: Any, s: Any) -> Any:
    arm, _, _ = wheel_at_contact(frames[0], p)
    return [p.normal.dot(frames[0].position(p.center) + arm) - p.level[0]]


def _wheel_slip(frames: Any, p: Any, s: Any, sideways: bool) -> Any:
    arm, along, across = wheel_at_contact(frames[0], p)
    velocity = frames[0].velocity(p.center) + frames[0].angular_velocity().cross(arm)
    direction = across if sideways else along
    return [direction.dot(velocity) - _carried(p, s, direction, frames[0].position(p.center) + arm)]


def _carried(p: Any, s: Any, direction: Any, contact: Any) -> Any:
    """Return the velocity of a moving plane at the contact, along a direction of it; 0 for one at rest."""
    if not s:
        return 0
    return direction.dot(s[:3]) + s[3] * direction.cross(p.normal).dot(contact - p.origin)


def _in_body(frame: Any, vector: Any) -> Any:
    return Column(vector.dot(axis) for axis in frame.axes)


def _ellipsoid(frame: Any, p: Any) -> tuple[Any, Any, Any]:
    """Return normal, contact from the centre (both in the body frame), and height of the centre above the contact."""
    normal, ball = _in_body(frame, p.normal), p.ball[0]
    excess = [(size - ball) * (size + ball) for size in p.semi_axes]
    height = frame.f.sqrt(ball**2 * p.normal.dot(p.normal) + sum(e * x**2 for e, x in zip(excess, normal, strict=True)))
    arm = Column(-(size**2) * x / height for size, x in zip(p.semi_axes, normal, strict=True))
    return normal, arm, height


def _ellipsoid_height(frames: Any, p: Any, s: Any) -> Any:
    normal, _, height = _ellipsoid(frames[0], p)
    return [p.normal.dot(frames[0].origin()) + normal.dot(p.center) - height - p.level[0]]


def _ellipsoid_slip(frames: Any, p: Any, s: Any) -> Any:
    # v + ω × r at the contact along a direction of the plane, the turn in body components.
    (frame,) = frames
    _, arm, _ = _ellipsoid(frame, p)
    turn = frame.local_angular_velocity().cross(p.center + arm)
    slip = p.along.dot(frame.velocity(None)) + _in_body(frame, p.along).dot(turn)
    return [slip - _carried(p, s, p.along, frame.position(p.center + arm))]


def _knife_edge_planar(frames: Any, p: Any, s: Any) -> Any:
    return [frames[0].direction(p.across).dot(frames[0].velocity(p.point))]


def _knife_edge_spatial(frames: Any, p: Any, s: Any) -> Any:
    return [p.normal.cross(frames[0].direction(p.along)).dot(frames[0].velocity(p.point))]


_ROLLERS = (("first", 2), ("second", 2), ("radii", 2))
_DISK = (("center", 2), ("normal", 2), ("radius", 1))
_WHEEL = (("center", 3), ("axle", 3), ("radius", 1), ("tube", 1), ("normal", 3))
_ELLIPSOID = (("center", 3), ("semi_axes", 3), ("ball", 1), ("normal", 3))


def _slips(name: str, parameters: Any, define: Any) -> tuple[Element, Element]:
    """Return the slip on a plane at rest, and on a moving one."""
    return (
        Element(name, "nonholonomic", ("spatial",), 1, parameters, define, units=("m/s",)),
        Element(f"carried_{name}", "nonholonomic", ("spatial",), 1, (*parameters, ("origin", 3)), define, 4, ("m/s",)),
    )


ELEMENTS = (
    Element(
        "disk_height",
        "holonomic",
        ("planar",),
        1,
        (("center", 2), ("normal", 2), ("level", 1)),
        _disk_height,
        units=("m",),
        residual="the height of its lowest point",
    ),
    Element("disk_slip", "nonholonomic", ("planar",), 1, _DISK, _disk_slip, units=("m/s",)),
    Element("carried_disk_slip", "nonholonomic", ("planar",), 1, _DISK, _disk_slip, 2, ("m/s",)),
    Element("roller_distance", "holonomic", ("planar",), 2, _ROLLERS, _roller_distance, units=("m",)),
    Element("roller_slip", "nonholonomic", ("planar",), 2, _ROLLERS, _roller_slip, units=("m/s",)),
    Element(
        "wheel_height",
        "holonomic",
        ("spatial",),
        1,
        (*_WHEEL, ("level", 1)),
        _wheel_height,
        units=("m",),
        residual="the height of its lowest point (upright, its centre is at the height radius + tube)",
    ),
    *_slips("wheel_slip_along", _WHEEL, lambda f, p, s: _wheel_slip(f, p, s, False)),
    *_slips("wheel_slip_across", _WHEEL, lambda f, p, s: _wheel_slip(f, p, s, True)),
    Element(
        "ellipsoid_height",
        "holonomic",
        ("spatial",),
        1,
        (*_ELLIPSOID, ("level", 1)),
        _ellipsoid_height,
        units=("m",),
        residual="the height of its lowest point",
    ),
    *_slips("ellipsoid_slip", (*_ELLIPSOID, ("along", 3)), _ellipsoid_slip),
    Element(
        "knife_edge", "nonholonomic", ("planar",), 1, (("point", 2), ("across", 2)), _knife_edge_planar, units=("m/s",)
    ),
    Element(
        "knife_edge",
        "nonholonomic",
        ("spatial",),
        1,
        (("point", 3), ("along", 3), ("normal", 3)),
        _knife_edge_spatial,
        units=("m/s",),
    ),
)

# --- kinds ----------------------------------------------------------------------------------------------------------

SURFACE = ("surface_velocity", "surface_rate")
"""Fields of the motion of a surface."""

_ROWS = {
    "rolling": ("wheel_slip_along", "wheel_slip_across"),
    "skate": ("wheel_slip_across",),
    "sideways": ("wheel_slip_along",),
    "frictionless": (),
}
SLIPPING = ("sideways", "frictionless")
"""Motions of a wheel that may slip across its track."""


def _slip(
    item: Item, element: str, body: int, numbers: Vector, label: str, origin: Vector = ()
) -> Iterable[ElementUse]:
    """Yield a row of slip, against the moving plane if it is one; `origin` is the point about which it turns."""
    velocity, rate = SURFACE
    laws = (*item.laws(velocity), *((item.law(rate),) if item.dimension == 3 else ()))
    if all(law.zero for law in laws):
        yield ElementUse(element, (body,), numbers, labels=(label,))
    else:
        yield ElementUse(f"carried_{element}", (body,), (*numbers, *origin), laws, (label,))


def _disk(item: Item) -> Iterable[ElementUse]:
    center, radius = item.marker("center"), item.number("radius")
    normal = item.direction("normal")
    level = radius + dot(normal, item.vector("origin"))
    yield ElementUse("disk_height", (center.body,), (*center.point, *normal, level), labels=("height",))
    if item.choice("motion") == "rolling":
        yield from _slip(item, "disk_slip", center.body, (*center.point, *normal, radius), "slip")


def _rollers(item: Item) -> Iterable[ElementUse]:
    (first, second), (own, other) = item.markers("between"), item.value("radii")
    slots = (first.body, second.body)
    numbers = (*first.point, *second.point, -own if item.value("internal") else own, other)
    yield ElementUse("roller_distance", slots, numbers, labels=("distance",))
    if item.choice("motion") == "rolling":
        yield ElementUse("roller_slip", slots, numbers, labels=("slip",))


def _rollers_look(item: Item) -> tuple[Look, ...]:
    pairs = zip(item.markers("between"), item.value("radii"), strict=True)
    return tuple(Look("body", (marker,), (), Form("cylinder", (radius, 0.0))) for marker, radius in pairs)


def _wheel_elements(item: Item) -> Iterable[ElementUse]:
    center, normal = item.marker("center"), item.direction("normal")
    numbers = (*center.point, *item.direction("axle"), item.number("radius"), item.number("tube"), *normal)
    level = dot(normal, item.vector("origin"))
    yield ElementUse("wheel_height", (center.body,), (*numbers, level), labels=("height",))
    for element in _ROWS[item.choice("motion")]:
        label = element.replace("wheel_", "").replace("_", " ")
        yield from _slip(item, element, center.body, numbers, label, item.vector("origin"))


def _ellipsoid_elements(item: Item) -> Iterable[ElementUse]:
    center, normal = item.marker("center"), item.direction("normal")
    semi_axes = [item.number(name) for name in "abc"]
    numbers = (*center.point, *semi_axes, min(semi_axes, key=representative), *normal)
    level = dot(normal, item.vector("origin"))
    yield ElementUse("ellipsoid_height", (center.body,), (*numbers, level), labels=("height",))
    if item.choice("motion") == "rolling":
        plane = triad(normal, None, item.functions.sqrt)
        for label, along in (("slip v2", plane.v2), ("slip v3", plane.v3)):
            yield from _slip(item, "ellipsoid_slip", center.body, (*numbers, *along), label, item.vector("origin"))


def _knife_edge_elements(item: Item) -> Iterable[ElementUse]:
    point, along = item.marker("at"), item.direction("along")
    heading = (turned(along),) if item.dimension == 2 else (along, item.direction("normal"))
    numbers = tuple(x for vector in (point.point, *heading) for x in vector)
    yield ElementUse("knife_edge", (point.body,), numbers, labels=("sideways",))


def _disk_look(item: Item) -> tuple[Look, ...]:
    form = Form("cylinder", (item.number("radius"), 0.0))
    return (Look("body", (item.marker("center"),), (), form, _surface(item)),)


def _wheel_look(item: Item) -> tuple[Look, ...]:
    radius, tube = item.number("radius"), item.number("tube")
    form = Form("torus", (radius, tube)) if tube else Form("cylinder", (radius, 0.0))
    return (Look("body", (item.marker("center"),), item.direction("axle"), form, _surface(item)),)


def _ellipsoid_look(item: Item) -> tuple[Look, ...]:
    form = Form("ellipsoid", tuple(item.number(name) for name in "abc"))
    return (Look("body", (item.marker("center"),), (), form, _surface(item)),)


def _blade_look(item: Item) -> tuple[Look, ...]:
    return (Look("blade", (item.marker("at"),), item.direction("along")),)


def _surface(item: Item) -> tuple[Vector, Vector]:
    """Return the unit normal and a point of the line or plane of a contact."""
    return item.direction("normal"), item.vector("origin")


_ORIGIN = Field("origin", "vector", "a point of the line or plane", "m", default="0")
_MOVING = (
    Field(
        SURFACE[0],
        "law vector",
        "velocity with which the material of the line or plane moves along it at its origin (belt, treadmill), in the "
        "axes of the ground; what it has across counts for nothing",
        "m/s",
        default="0",
    ),
    Field(
        SURFACE[1],
        "law",
        "rate at which the material of the plane turns about its normal through its origin (turntable)",
        "rad/s",
        default="0",
        dimensions=(3,),
    ),
)
_CENTER = Field("center", "marker", "centre of the wheel: body or body.point", required=True)
_RADIUS = Field("radius", "number", "radius of the wheel", "m", required=True, sign="positive")
_MOTION = Field(
    "motion", "choice", "rolling, or sliding without friction", default="rolling", choices=("rolling", "frictionless")
)

KINDS: tuple[Kind, ...] = (
    Kind(
        "disk",
        "disk on a straight line, at rest or a moving belt",
        (2,),
        (
            _CENTER,
            _RADIUS,
            Field("normal", "ground direction", "normal of the line, towards the disk", default="y"),
            _ORIGIN,
            _MOTION,
            _MOVING[0],
        ),
        _disk,
        look=_disk_look,
    ),
    Kind(
        "rollers",
        "two disks that roll on each other, also on the ground or inside of a ring (roller rig, cam follower)",
        (2,),
        (
            Field("between", "markers", "centres of both disks", required=True),
            Field("radii", "radii", "radii of both disks", "m", required=True, sign="positive"),
            Field("internal", "flag", "whether the first rolls inside of the second, a ring", default="false"),
            _MOTION,
        ),
        _rollers,
        look=_rollers_look,
    ),
    Kind(
        "wheel",
        "wheel with a knife edge or a round tread on a plane, at rest or moving (treadmill, turntable)",
        (3,),
        (
            _CENTER,
            Field("axle", "direction", "axis of the wheel in the frame of its body", required=True),
            Field(
                "radius",
                "number",
                "radius of the circle in the middle of the tread",
                "m",
                required=True,
                sign="positive",
            ),
            Field(
                "tube",
                "number",
                "radius of the round tread; 0 is a knife edge. The centre of an upright wheel is at the height "
                "radius + tube above the plane, and it rolls with this radius",
                "m",
                default="0",
                sign="nonnegative",
            ),
            Field("normal", "ground direction", "normal of the plane, towards the wheel", default="z"),
            _ORIGIN,
            Field(
                "motion",
                "choice",
                "rolling: no slip; skate: slips along its track only; "
                "sideways: slips across it only; frictionless: slips freely",
                default="rolling",
                choices=tuple(_ROWS),
            ),
            *_MOVING,
        ),
        _wheel_elements,
        look=_wheel_look,
    ),
    Kind(
        "ellipsoid",
        "ellipsoid or ball on a plane, at rest or moving, its semi-axes along the axes of its body (rattleback)",
        (3,),
        (
            Field("center", "marker", "centre of the ellipsoid: body or body.point", required=True),
            *(
                Field(name, "number", f"semi-axis along {axis} of the body", "m", required=True, sign="positive")
                for name, axis in zip("abc", "xyz", strict=True)
            ),
            Field("normal", "ground direction", "normal of the plane, towards the ellipsoid", default="z"),
            _ORIGIN,
            _MOTION,
            *_MOVING,
        ),
        _ellipsoid_elements,
        look=_ellipsoid_look,
    ),
    Kind(
        "knife_edge",
        "a point that moves only along a direction of its body (sleigh, skate, towed wheel)",
        (2, 3),
        (
            Field("at", "marker", "the point: body or body.point", required=True),
            Field("along", "direction", "direction of the blade in the frame of the body", required=True),
            Field("normal", "ground direction", "normal of the plane of motion", default="z", dimensions=(3,)),
        ),
        _knife_edge_elements,
        look=_blade_look,
    ),
)
