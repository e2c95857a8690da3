"""Springs, dampers, forces and torques. Weight belongs to the bodies."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

from mbstab.mechanics.catalogue import Effort, Element, ElementUse, Field, Item, Kind, Load, Look, Part, Sign
from mbstab.mechanics.drives import MOTION, TRAVEL, TURN, joint_motion
from mbstab.mechanics.frames import Column
from mbstab.mechanics.joints import joint_angle_functions, joint_displacement, motion_parameters
from mbstab.mechanics.vectors import plain_zero, turned

# --- elements -------------------------------------------------------------------------------------------------------


def _spring_and_damper(frames: Any, p: Any, extension: Any) -> Load:
    speed = frames[0].rate(extension)
    return Load(p.stiffness[0] * extension**2 / 2, p.damping[0] * speed**2 / 2)


def _spring(frames: Any, p: Any, s: Any) -> Load:
    first, second = frames
    gap = first.position(p.first) - second.position(p.second)
    return _spring_and_damper(frames, p, first.f.sqrt(gap.dot(gap)) - p.rest[0])


def _ideal_spring(frames: Any, p: Any, s: Any) -> Load:
    # Without free length and damping the force is smooth where the ends meet.
    first, second = frames
    gap = first.position(p.first) - second.position(p.second)
    return Load(p.stiffness[0] * gap.dot(gap) / 2)


def gap_and_speed(frames: Any, p: Any) -> tuple[Any, Any]:
    """Return the gap between two points and its rate in the axes of the second body, both in ground components."""
    first, second = frames
    gap = first.position(p.first) - second.position(p.second)
    turn = second.angular_velocity()
    carried = turn.cross(gap) if second.dimension == 3 else turn[0] * Column(turned(gap))
    return gap, first.velocity(p.first) - second.velocity(p.second) - carried


def _bearing(frames: Any, p: Any, s: Any) -> Load:
    # The speed is that in the axes of the second body: turning with it dissipates nothing.
    gap, speed = gap_and_speed(frames, p)
    return Load(p.stiffness[0] * gap.dot(gap) / 2, p.damping[0] * speed.dot(speed) / 2)


def _mount(p: Any, moved: Any, speeds: Any) -> Load:
    """Return what a mount does along its axes: stiffness, damping and a preload, each by itself."""
    stored = sum(k * x**2 / 2 - f * x for k, f, x in zip(p.stiffness, p.preload, moved, strict=True))
    return Load(stored, sum(c * v**2 / 2 for c, v in zip(p.damping, speeds, strict=True)))


def _mount_force(frames: Any, p: Any, s: Any) -> Load:
    gap, speed = gap_and_speed(frames, p)
    second = frames[1]
    spatial = second.dimension == 3
    axes = [second.direction(v) for v in (p.second_v1, p.second_v2, p.second_v3)] if spatial else second.axes
    return _mount(p, [axis.dot(gap) for axis in axes], [axis.dot(speed) for axis in axes])


def _mount_torque(frames: Any, p: Any, s: Any) -> Load:
    first, second = frames
    spin = first.angular_velocity() - second.angular_velocity()
    if first.dimension == 2:
        return _mount(p, [first.q[2] - second.q[2]], spin)
    own = [first.direction(v) for v in (p.first_v1, p.first_v2, p.first_v3)]
    axes = [second.direction(v) for v in (p.second_v1, p.second_v2, p.second_v3)]
    # A turn by the angle α about the unit vector n has the components 2 sin(α/2) n, which grow up to half a turn.
    half = first.f.sqrt(1 + sum(axis.dot(v) for axis, v in zip(axes, own, strict=True)))
    across = [axes[i - 1].dot(own[i - 2]) - axes[i - 2].dot(own[i - 1]) for i in range(3)]
    return _mount(p, [x / half for x in across], [axis.dot(spin) for axis in axes])


def _angle(frames: Any, p: Any, offset: Any) -> Any:
    """Return joint angle minus offset: in space within half a turn, in the plane the difference of the coordinates."""
    first, second = frames
    f = first.f
    if first.dimension == 2:
        return first.q[2] - second.q[2] - offset
    cosine, sine = joint_angle_functions(first, second, p)
    if offset == 0:
        return f.atan2(sine, cosine)
    c, s = f.cos(offset), f.sin(offset)
    return f.atan2(sine * c - cosine * s, cosine * c + sine * s)


def _angle_spring(frames: Any, p: Any, s: Any) -> Load:
    return _spring_and_damper(frames, p, _angle(frames, p, p.rest[0]))


def _displacement_spring(frames: Any, p: Any, s: Any) -> Load:
    return _spring_and_damper(frames, p, joint_displacement(frames[0], frames[1], p) - p.rest[0])


def _angle_effort(frames: Any, p: Any, s: Any) -> Load:
    return Load(power=(((s[0],), (frames[0].rate(_angle(frames, p, 0)),)),))


def _displacement_effort(frames: Any, p: Any, s: Any) -> Load:
    return Load(power=(((s[0],), (frames[0].rate(joint_displacement(frames[0], frames[1], p)),)),))


def _ground_force(frames: Any, p: Any, s: Any) -> Load:
    return Load(power=((s, frames[0].velocity(p.point)),))


def _body_force(frames: Any, p: Any, s: Any) -> Load:
    return Load(power=((frames[0].direction(s), frames[0].velocity(p.point)),))


def _ground_torque(frames: Any, p: Any, s: Any) -> Load:
    return Load(power=((s, frames[0].angular_velocity()),))


def _body_torque(frames: Any, p: Any, s: Any) -> Load:
    return Load(power=((s, frames[0].local_angular_velocity()),))


_BOTH = ("planar", "spatial")
_SPRING = (("stiffness", 1), ("rest", 1), ("damping", 1))
_ENDPOINTS = (("first", 0), ("second", 0))
_OWN_AXES = tuple((f"first_v{i}", 3) for i in (1, 2, 3))
_AXES = tuple((f"second_v{i}", 3) for i in (1, 2, 3))
_MOUNT = (("stiffness", 0), ("damping", 0), ("preload", 0))

ELEMENTS = (
    Element(
        "spring",
        "force",
        _BOTH,
        2,
        (*_ENDPOINTS, *_SPRING),
        _spring,
        hint="its ends coincide, and the line between them has no direction, which length: and damping: need; "
        "with length 0 write type: bearing and leave out length:, it acts the same in all directions with the "
        "same stiffness: and damping:; else keep the ends apart in reference:",
    ),
    Element("ideal_spring", "force", _BOTH, 2, (*_ENDPOINTS, ("stiffness", 1)), _ideal_spring),
    Element("bearing", "force", _BOTH, 2, (*_ENDPOINTS, ("stiffness", 1), ("damping", 1)), _bearing),
    Element("mount_force", "force", ("planar",), 2, (*_ENDPOINTS, *_MOUNT), _mount_force),
    Element("mount_force", "force", ("spatial",), 2, (*_ENDPOINTS, *_AXES, *_MOUNT), _mount_force),
    Element("mount_torque", "force", ("planar",), 2, tuple((name, 1) for name, _ in _MOUNT), _mount_torque),
    Element(
        "mount_torque",
        "force",
        ("spatial",),
        2,
        (*_OWN_AXES, *_AXES, *_MOUNT),
        _mount_torque,
        hint="one body is turned by half a turn against the other; a bushing turns by less",
    ),
    Element("angle_spring", "force", ("planar",), 2, _SPRING, _angle_spring),
    Element("angle_spring", "force", ("spatial",), 2, (*TURN, *_SPRING), _angle_spring),
    Element("displacement_spring", "force", _BOTH, 2, (*TRAVEL, *_SPRING), _displacement_spring),
    Element("angle_effort", "force", ("planar",), 2, (), _angle_effort, 1),
    Element("angle_effort", "force", ("spatial",), 2, TURN, _angle_effort, 1),
    Element("displacement_effort", "force", _BOTH, 2, TRAVEL, _displacement_effort, 1),
    Element("ground_force", "force", ("planar",), 1, (("point", 2),), _ground_force, 2),
    Element("ground_force", "force", ("spatial",), 1, (("point", 3),), _ground_force, 3),
    Element("body_force", "force", ("planar",), 1, (("point", 2),), _body_force, 2),
    Element("body_force", "force", ("spatial",), 1, (("point", 3),), _body_force, 3),
    Element("ground_torque", "force", ("planar",), 1, (), _ground_torque, 1),
    Element("ground_torque", "force", ("spatial",), 1, (), _ground_torque, 3),
    Element("body_torque", "force", ("spatial",), 1, (), _body_torque, 3),
)

# --- kinds ----------------------------------------------------------------------------------------------------------


def _spring_elements(item: Item) -> Iterable[ElementUse]:
    first, second = item.markers("between")
    ends = (*first.point, *second.point, item.number("stiffness"))
    if all(plain_zero(item.number(name)) for name in ("length", "damping")):
        yield ElementUse("ideal_spring", (first.body, second.body), ends)
        return
    numbers = (*ends, item.number("length"), item.number("damping"))
    yield ElementUse("spring", (first.body, second.body), numbers)


def _bearing_element(item: Item) -> Iterable[ElementUse]:
    first, second = item.markers("between")
    numbers = (*first.point, *second.point, item.number("stiffness"), item.number("damping"))
    yield ElementUse("bearing", (first.body, second.body), numbers)


def _bushing(item: Item) -> Iterable[ElementUse]:
    first, second = item.markers("between")
    slots = (first.body, second.body)
    own: tuple[Any, ...] = ()
    axes: tuple[Any, ...] = ()
    if item.dimension == 3:
        own, axes = ((*x.v1, *x.v2, *x.v3) for x in item.triads("axis", "zero"))
    along = (*item.vector("stiffness"), *item.vector("damping"), *item.vector("preload"))
    yield ElementUse("mount_force", slots, (*first.point, *second.point, *axes, *along))
    about = [item.value(name) for name in ("torsional_stiffness", "torsional_damping", "torsional_preload")]
    turning = tuple(x for part in about for x in part) if item.dimension == 3 else tuple(about)
    if not all(plain_zero(x) for x in turning):
        yield ElementUse("mount_torque", slots, (*own, *axes, *turning))


def _joint_spring(item: Item) -> Iterable[ElementUse]:
    joint, motion = joint_motion(item)
    first, second = joint.markers("between")
    numbers = (*motion_parameters(joint, motion), item.number("stiffness"), item.number("rest"), item.number("damping"))
    yield ElementUse(f"{motion}_spring", (first.body, second.body), numbers)


def _actuator(item: Item) -> Iterable[ElementUse]:
    joint, motion = joint_motion(item)
    first, second = joint.markers("between")
    yield ElementUse(
        f"{motion}_effort", (first.body, second.body), motion_parameters(joint, motion), (item.law("effort"),)
    )


def _spring_effort(item: Item) -> Effort:
    return Effort("distance", item, item.number("stiffness"), item.number("length"), item.number("damping"))


def _bearing_effort(item: Item) -> Effort:
    # The damping force across the line between the ends does not count here.
    return Effort("distance", item, item.number("stiffness"), 0.0, item.number("damping"))


def _joint_spring_effort(item: Item) -> Effort:
    joint, motion = joint_motion(item)
    return Effort(motion, joint, item.number("stiffness"), item.number("rest"), item.number("damping"))


def _actuator_effort(item: Item) -> Effort:
    joint, motion = joint_motion(item)
    return Effort(motion, joint, law=item.law("effort"))


def _spring_look(item: Item) -> tuple[Look, ...]:
    return (Look("spring", item.markers("between")),)


def _force(item: Item) -> Iterable[ElementUse]:
    point = item.marker("at")
    yield ElementUse(f"{item.choice('frame')}_force", (point.body,), point.point, item.laws("vector"))


def _torque(item: Item) -> Iterable[ElementUse]:
    # A torque about the normal of the plane is the same in both frames.
    frame = item.choice("frame") if item.dimension == 3 else "ground"
    laws = item.laws("vector") if item.dimension == 3 else (item.law("value"),)
    yield ElementUse(f"{frame}_torque", (item.body("body"),), (), laws)


ANY_SIGN = "a force that pushes away or feeds in energy has the type expression: on: {body.x: 2000*rate(body.x)}"
"""What to write instead of a negative stiffness or damping."""
_STIFFNESS = Field("stiffness", "number", "stiffness", "N/m", default="0", sign="nonnegative", instead=ANY_SIGN)
_DAMPING = Field("damping", "number", "viscous damping", "N*s/m", default="0", sign="nonnegative", instead=ANY_SIGN)
_ENDS = Field("between", "markers", "its two ends, written body.point, body or ground", required=True)
_TURNS: tuple[tuple[str, str, str, Sign], ...] = (
    ("torsional_stiffness", "of turns about each axis", "N*m/rad", "nonnegative"),
    ("torsional_damping", "of turns about each axis", "N*m*s/rad", "nonnegative"),
    ("torsional_preload", "torque on the first body where it is not turned", "N*m", "any"),
)
_AXES_OF_MOUNT = "in the frame of each body: x, -y, a named direction or a vector; a list of two if they differ"
_MOUNT_AXES = (
    Field("axis", "directions", f"first of the three axes, {_AXES_OF_MOUNT}", default="x", dimensions=(3,)),
    Field("zero", "zero directions", f"second of the three axes, {_AXES_OF_MOUNT}", default="y", dimensions=(3,)),
)
_EACH = "one number for each axis: axis, zero and the one across both; in the plane x and y of the second body"
_JOINT = Field("joint", "joint", "name of the joint", required=True)
_FRAME = Field(
    "frame",
    "choice",
    "axes of the components: fixed, or turning with the body (follower)",
    default="ground",
    choices=("ground", "body"),
)

_EFFORT = "force in N or torque in N*m; may depend on the time t, on states, coordinates and measures"

KINDS: tuple[Kind, ...] = (
    Kind(
        "spring",
        "spring and damper along the line between two points; damping needs a distance between them, "
        "else use a bearing",
        (2, 3),
        (
            _ENDS,
            _STIFFNESS,
            Field("length", "number", "length without force", "m", default="0", sign="nonnegative"),
            _DAMPING,
        ),
        _spring_elements,
        some_of=("stiffness", "damping"),
        effort=_spring_effort,
        look=_spring_look,
    ),
    Kind(
        "bearing",
        "spring and damper between two points that may coincide, the same in all directions: the force on the "
        "first is -stiffness*gap - damping*(rate of the gap in the axes of the second body)",
        (2, 3),
        (_ENDS, _STIFFNESS, _DAMPING),
        _bearing_element,
        some_of=("stiffness", "damping"),
        effort=_bearing_effort,
        look=_spring_look,
    ),
    *(
        Kind(
            "bushing",
            "elastic mount: springs and dampers along and about three axes of the second body, with a preload; "
            + (
                "the turn is the difference of the angles",
                "a turn by the angle a about the unit vector n counts as 2*sin(a/2)*n, less than half a turn",
            )[dimension - 2],
            (dimension,),
            (
                _ENDS,
                *(field for field in _MOUNT_AXES if dimension in field.dimensions),
                replace(_STIFFNESS, shape="vector", doc=_EACH),
                replace(_DAMPING, shape="vector", doc=_EACH),
                Field("preload", "vector", "force on the first body where the ends meet", "N", default="0"),
                *(
                    Field(name, shape, doc, unit, default="0", sign=sign, instead=ANY_SIGN)
                    for name, doc, unit, sign in _TURNS
                ),
            ),
            _bushing,
            some_of=("stiffness", "damping", "preload", *(name for name, *_ in _TURNS)),
            transmits=True,
            look=_spring_look,
        )
        for dimension, shape in ((2, "number"), (3, "vector"))
    ),
    Kind(
        "joint_spring",
        "spring and damper on the angle or the travel of a joint",
        (2, 3),
        (
            _JOINT,
            MOTION,
            Field(
                "stiffness",
                "number",
                "stiffness in N/m or N*m/rad",
                "",
                default="0",
                sign="nonnegative",
                units=("N*m/rad", "N/m"),
                instead=ANY_SIGN,
            ),
            Field(
                "rest",
                "number",
                "travel or angle without force; in space angles are taken within half a turn of it",
                "",
                default="0",
                units=("rad", "m"),
            ),
            Field(
                "damping",
                "number",
                "viscous damping in N*s/m or N*m*s/rad",
                "",
                default="0",
                sign="nonnegative",
                units=("N*m*s/rad", "N*s/m"),
                instead=ANY_SIGN,
            ),
        ),
        _joint_spring,
        some_of=("stiffness", "damping"),
        effort=_joint_spring_effort,
    ),
    Kind(
        "actuator",
        "force or torque along a joint, on the first body against the second",
        (2, 3),
        (_JOINT, MOTION, Field("effort", "law", _EFFORT, "", required=True, units=("N*m", "N"))),
        _actuator,
        effort=_actuator_effort,
        following=Kind(
            "actuator",
            "the same with an effort that depends on the motion or on states",
            (2, 3),
            (
                _JOINT,
                MOTION,
                Field("effort", "signal", _EFFORT, "", required=True, units=("N*m", "N")),
                Field("on", "loads", "the effort along the motion of the joint", made=True),
            ),
            lambda item: (),
            written="force",
            part=lambda along, name, given: Part({}, given["effort"]),
        ),
    ),
    Kind(
        "force",
        "force at a point of a body; with frame: body it follows the body",
        (2, 3),
        (
            Field("at", "marker", "the point: body or body.point", required=True),
            Field("vector", "law vector", "components; may depend on the time t", "N", required=True),
            _FRAME,
        ),
        _force,
    ),
    Kind(
        "expression",
        "generalized forces written as expressions of coordinates, rates and time",
        (2, 3),
        (Field("on", "loads", "generalized force by coordinate: {body.x: expression}", "", required=True),),
        lambda item: (),
        written="force",
    ),
    Kind(
        "potential",
        "forces with a written potential energy V: -∂V/∂q",
        (2, 3),
        (Field("energy", "energy", "V, an expression of coordinates and measures of places", "J", required=True),),
        lambda item: (),
        written="potential",
    ),
    Kind(
        "dissipation",
        "forces with a written dissipation function D: -∂D/∂u",
        (2, 3),
        (Field("function", "dissipation", "D, half the power of linear dampers", "W", required=True),),
        lambda item: (),
        written="dissipation",
    ),
    Kind(
        "torque",
        "torque on a body",
        (2,),
        (
            Field("body", "body", "the body", required=True),
            Field("value", "law", "counter-clockwise; may depend on the time t", "N*m", required=True),
        ),
        _torque,
    ),
    Kind(
        "torque",
        "torque on a body; with frame: body it follows the body",
        (3,),
        (
            Field("body", "body", "the body", required=True),
            Field("vector", "law vector", "components; may depend on the time t", "N*m", required=True),
            _FRAME,
        ),
        _torque,
    ),
)
