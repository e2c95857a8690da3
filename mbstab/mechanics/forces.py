"""Springs, dampers, forces and torques. Weight belongs to the bodies."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from mbstab.mechanics.catalogue import Effort, Element, ElementUse, Field, Item, Kind, Load, Look
from mbstab.mechanics.drives import MOTION, TRAVEL, TURN, joint_motion
from mbstab.mechanics.joints import joint_angle_functions, joint_displacement, motion_parameters
from mbstab.mechanics.vectors import plain_zero

# --- elements -------------------------------------------------------------------------------------------------------


def _spring_and_damper(frames: Any, p: Any, extension: Any) -> Load:
    speed = sum(frame.rate(extension) for frame in frames)
    return Load(p.stiffness[0] * extension**2 / 2, p.damping[0] * speed**2 / 2)


def _spring(frames: Any, p: Any, s: Any) -> Load:
    import sympy

    first, second = frames
    gap = first.position(p.first) - second.position(p.second)
    return _spring_and_damper(frames, p, sympy.sqrt(gap.dot(gap)) - p.rest[0])


def _ideal_spring(frames: Any, p: Any, s: Any) -> Load:
    # Without free length and damping the force is smooth where the ends meet.
    first, second = frames
    gap = first.position(p.first) - second.position(p.second)
    return Load(p.stiffness[0] * gap.dot(gap) / 2)


def _bearing(frames: Any, p: Any, s: Any) -> Load:
    # The speed is that in the axes of the second body: turning with it dissipates nothing.
    first, second = frames
    gap = first.position(p.first) - second.position(p.second)
    turn = second.angular_velocity()
    carried = turn.cross(gap) if second.dimension == 3 else turn[0] * _quarter_turn(gap)
    speed = first.velocity(p.first) - second.velocity(p.second) - carried
    return Load(p.stiffness[0] * gap.dot(gap) / 2, p.damping[0] * speed.dot(speed) / 2)


def _quarter_turn(v: Any) -> Any:
    import sympy

    return sympy.Matrix([-v[1], v[0]])


def _angle(frames: Any, p: Any, offset: Any) -> Any:
    """Return joint angle minus offset: in space within half a turn, in the plane the difference of the coordinates."""
    import sympy

    first, second = frames
    if first.dimension == 2:
        return first.q[2] - second.q[2] - offset
    cosine, sine = joint_angle_functions(first, second, p)
    c, s = sympy.cos(offset), sympy.sin(offset)
    return sympy.atan2(sine * c - cosine * s, cosine * c + sine * s)


def _angle_spring(frames: Any, p: Any, s: Any) -> Load:
    return _spring_and_damper(frames, p, _angle(frames, p, p.rest[0]))


def _displacement_spring(frames: Any, p: Any, s: Any) -> Load:
    return _spring_and_damper(frames, p, joint_displacement(frames[0], frames[1], p) - p.rest[0])


def _angle_effort(frames: Any, p: Any, s: Any) -> Load:
    import sympy

    speed = sum(frame.rate(_angle(frames, p, 0)) for frame in frames)
    return Load(power=((sympy.Matrix([s[0]]), sympy.Matrix([speed])),))


def _displacement_effort(frames: Any, p: Any, s: Any) -> Load:
    import sympy

    speed = sum(frame.rate(joint_displacement(frames[0], frames[1], p)) for frame in frames)
    return Load(power=((sympy.Matrix([s[0]]), sympy.Matrix([speed])),))


def _ground_force(frames: Any, p: Any, s: Any) -> Load:
    import sympy

    return Load(power=((sympy.Matrix(s), frames[0].velocity(p.point)),))


def _body_force(frames: Any, p: Any, s: Any) -> Load:
    import sympy

    return Load(power=((frames[0].direction(sympy.Matrix(s)), frames[0].velocity(p.point)),))


def _ground_torque(frames: Any, p: Any, s: Any) -> Load:
    import sympy

    return Load(power=((sympy.Matrix(s), frames[0].angular_velocity()),))


def _body_torque(frames: Any, p: Any, s: Any) -> Load:
    import sympy

    return Load(power=((sympy.Matrix(s), frames[0].local_angular_velocity()),))


_BOTH = ("planar", "spatial")
_SPRING = (("stiffness", 1), ("rest", 1), ("damping", 1))

ELEMENTS = (
    Element(
        "spring",
        "force",
        _BOTH,
        2,
        (("first", 0), ("second", 0), *_SPRING),
        _spring,
        hint="its ends coincide, and the line between them has no direction, which length: and damping: need; "
        "with length 0 write type: bearing and leave out length:, it acts the same in all directions with the "
        "same stiffness: and damping:; else keep the ends apart in reference:",
    ),
    Element("ideal_spring", "force", _BOTH, 2, (("first", 0), ("second", 0), ("stiffness", 1)), _ideal_spring),
    Element(
        "bearing",
        "force",
        _BOTH,
        2,
        (("first", 0), ("second", 0), ("stiffness", 1), ("damping", 1)),
        _bearing,
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


def _spring_look(item: Item) -> Look:
    return Look("spring", item.markers("between"))


def _force(item: Item) -> Iterable[ElementUse]:
    point = item.marker("at")
    yield ElementUse(f"{item.choice('frame')}_force", (point.body,), point.point, item.laws("vector"))


def _torque(item: Item) -> Iterable[ElementUse]:
    # A torque about the normal of the plane is the same in both frames.
    frame = item.choice("frame") if item.dimension == 3 else "ground"
    laws = item.laws("vector") if item.dimension == 3 else (item.law("value"),)
    yield ElementUse(f"{frame}_torque", (item.body("body"),), (), laws)


_STIFFNESS = Field("stiffness", "number", "stiffness", "N/m", default="0", sign="nonnegative")
_DAMPING = Field("damping", "number", "viscous damping", "N*s/m", default="0", sign="nonnegative")
_ENDS = Field("between", "markers", "its two ends, written body.point, body or ground", required=True)
_JOINT = Field("joint", "joint", "name of the joint", required=True)
_FRAME = Field(
    "frame",
    "choice",
    "axes of the components: fixed, or turning with the body (follower)",
    default="ground",
    choices=("ground", "body"),
)

KINDS: dict[tuple[str, int], Kind] = {
    (kind.name, dimension): kind
    for kind in (
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
            effort=_bearing_effort,
            look=_spring_look,
        ),
        Kind(
            "joint_spring",
            "spring and damper on the angle or the travel of a joint",
            (2, 3),
            (
                _JOINT,
                MOTION,
                Field("stiffness", "number", "stiffness in N/m or N*m/rad", "", default="0", sign="nonnegative"),
                Field(
                    "rest",
                    "number",
                    "travel or angle without force; in space angles are taken within half a turn of it",
                    "",
                    default="0",
                ),
                Field(
                    "damping", "number", "viscous damping in N*s/m or N*m*s/rad", "", default="0", sign="nonnegative"
                ),
            ),
            _joint_spring,
            effort=_joint_spring_effort,
        ),
        Kind(
            "actuator",
            "force or torque along a joint, on the first body against the second",
            (2, 3),
            (
                _JOINT,
                MOTION,
                Field("effort", "law", "force in N or torque in N*m; may depend on the time t", "", required=True),
            ),
            _actuator,
            effort=_actuator_effort,
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
    for dimension in kind.dimensions
}
