"""Drives: a coordinate, the motion of a joint or of a point given as a function of time.

A given position is a holonomic row, a given rate a nonholonomic one.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Literal

from mbstab.mechanics.catalogue import Effort, Element, ElementUse, Field, Item, Kind
from mbstab.mechanics.joints import joint_angle_functions, joint_displacement, motion_parameters

# --- elements -------------------------------------------------------------------------------------------------------


def _coordinate_position(frames: Any, p: Any, s: Any) -> Any:
    return [frames[0].q[0] - s[0]]


def _coordinate_velocity(frames: Any, p: Any, s: Any) -> Any:
    return [frames[0].u[0] - s[0]]


def _angle_position(frames: Any, p: Any, s: Any) -> Any:
    first, second = frames
    if first.dimension == 2:
        return [first.q[2] - second.q[2] - s[0]]
    # sin(angle − s): smooth over any number of turns.
    cosine, sine = joint_angle_functions(first, second, p)
    return [sine * first.f.cos(s[0]) - cosine * first.f.sin(s[0])]


def _angle_velocity(frames: Any, p: Any, s: Any) -> Any:
    first, second = frames
    if first.dimension == 2:
        return [first.u[2] - second.u[2] - s[0]]
    return [second.direction(p.second_v1).dot(first.angular_velocity() - second.angular_velocity()) - s[0]]


def _displacement_position(frames: Any, p: Any, s: Any) -> Any:
    return [joint_displacement(frames[0], frames[1], p) - s[0]]


def _displacement_velocity(frames: Any, p: Any, s: Any) -> Any:
    return [frames[0].rate(joint_displacement(frames[0], frames[1], p)) - s[0]]


def _point_position(frames: Any, p: Any, s: Any) -> Any:
    return [p.direction.dot(frames[0].position(p.point)) - s[0]]


def _point_velocity(frames: Any, p: Any, s: Any) -> Any:
    return [p.direction.dot(frames[0].velocity(p.point)) - s[0]]


_BOTH = ("planar", "spatial")
TURN = (("first_v2", 3), ("second_v2", 3), ("second_v3", 3))
TRAVEL = (("first", 0), ("second", 0), ("second_v1", 0))
_POINT = (("point", 0), ("direction", 0))


def _pair(
    name: str, frames: tuple[str, ...], slots: int, parameters: Any, position: Any, velocity: Any, unit: str
) -> tuple[Element, ...]:
    return (
        Element(f"{name}_position", "holonomic", frames, slots, parameters[0], position, 1, (unit,)),
        Element(f"{name}_velocity", "nonholonomic", frames, slots, parameters[1], velocity, 1, (f"{unit}/s",)),
    )


ELEMENTS = (
    *_pair("coordinate", ("coordinate",), 1, ((), ()), _coordinate_position, _coordinate_velocity, "unit"),
    *_pair("angle", ("planar",), 2, ((), ()), _angle_position, _angle_velocity, "rad"),
    *_pair("angle", ("spatial",), 2, (TURN, (("second_v1", 3),)), _angle_position, _angle_velocity, "rad"),
    *_pair("displacement", _BOTH, 2, (TRAVEL, TRAVEL), _displacement_position, _displacement_velocity, "m"),
    *_pair("point", _BOTH, 1, (_POINT, _POINT), _point_position, _point_velocity, "m"),
)

# --- kinds ----------------------------------------------------------------------------------------------------------

POSITION = Field("position", "law", "given position as a function of the time t (holonomic)", units=("rad", "m"))
VELOCITY = Field("velocity", "law", "given rate as a function of the time t (nonholonomic)", units=("rad/s", "m/s"))
MOTION = Field("motion", "motion", "which motion of the joint, if it has both", choices=("angle", "displacement"))


def _law(item: Item) -> tuple[str, tuple[Any, ...]]:
    name = "position" if item.given("position") else "velocity"
    return name, (item.law(name),)


def _coordinate(item: Item) -> Iterable[ElementUse]:
    name, laws = _law(item)
    yield ElementUse(f"coordinate_{name}", (item.coordinate("coordinate"),), (), laws, (name,))


def joint_motion(item: Item) -> tuple[Item, Literal["angle", "displacement"]]:
    """Return the joint an item acts on and the motion of it: ``angle`` or ``displacement``."""
    joint = item.joint("joint")
    motion = item.choice("motion") if item.given("motion") else joint.kind.motions[0]
    return joint, "angle" if motion == "angle" else "displacement"


def _joint(item: Item) -> Iterable[ElementUse]:
    name, laws = _law(item)
    joint, motion = joint_motion(item)
    first, second = joint.markers("between")
    parameters = motion_parameters(joint, motion)
    if motion == "angle" and name == "velocity" and item.dimension == 3:
        parameters = joint.triads("axis", "zero")[1].v1
    yield ElementUse(f"{motion}_{name}", (first.body, second.body), parameters, laws, (f"{motion} {name}",))


def _point(item: Item) -> Iterable[ElementUse]:
    name, laws = _law(item)
    point = item.marker("at")
    parameters = (*point.point, *item.direction("direction"))
    yield ElementUse(f"point_{name}", (point.body,), parameters, laws, (name,))


def _coordinate_effort(item: Item) -> Effort:
    return Effort("coordinate", item, driven=True)


def _joint_effort(item: Item) -> Effort:
    joint, motion = joint_motion(item)
    return Effort(motion, joint, law=item.law("position") if item.given("position") else None, driven=True)


def _point_effort(item: Item) -> Effort:
    return Effort("point", item, driven=True)


_LAW = (POSITION, VELOCITY)
_ONE = (("position", "velocity"),)

KINDS: tuple[Kind, ...] = (
    Kind(
        "coordinate",
        "prescribes one coordinate of a body",
        (2, 3),
        (Field("coordinate", "coordinate", "the coordinate, written body.psi", required=True), *_LAW),
        _coordinate,
        one_of=_ONE,
        effort=_coordinate_effort,
    ),
    Kind(
        "joint",
        "prescribes the angle or the travel of a joint",
        (2, 3),
        (Field("joint", "joint", "name of the joint", required=True), MOTION, *_LAW),
        _joint,
        one_of=_ONE,
        effort=_joint_effort,
    ),
    Kind(
        "point",
        "prescribes the place of a point along a fixed direction",
        (2, 3),
        (
            Field("at", "marker", "the point: body or body.point", required=True),
            Field("direction", "ground direction", "the direction, in ground axes", required=True),
            *(field.along("displacement") for field in _LAW),
        ),
        _point,
        one_of=_ONE,
        effort=_point_effort,
    ),
)
