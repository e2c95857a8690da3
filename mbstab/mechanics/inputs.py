"""Inputs of the linearized equations: signals that are zero at the reference motion."""

from __future__ import annotations

from collections.abc import Iterable

from mbstab.mechanics.catalogue import ElementUse, Field, Item, Kind
from mbstab.mechanics.drives import MOTION, joint_motion
from mbstab.mechanics.joints import motion_parameters

_DIRECTION = Field("direction", "ground direction", "its direction, in the axes that frame says", required=True)
_FRAME = Field(
    "frame", "choice", "axes of the direction: ground, or turning with the body", default="ground",
    choices=("ground", "body"),
)  # fmt: skip
_BODY = Field("body", "body", "the body", required=True)


def _force(item: Item) -> Iterable[ElementUse]:
    point = item.marker("at")
    yield ElementUse(f"{item.choice('frame')}_force", (point.body,), point.point, item.direction("direction"))


def _torque(item: Item) -> Iterable[ElementUse]:
    if item.dimension == 2:
        yield ElementUse("ground_torque", (item.body("body"),), (), (1.0,))
    else:
        yield ElementUse(f"{item.choice('frame')}_torque", (item.body("body"),), (), item.direction("direction"))


def _joint(item: Item) -> Iterable[ElementUse]:
    joint, motion = joint_motion(item)
    first, second = joint.markers("between")
    yield ElementUse(f"{motion}_effort", (first.body, second.body), motion_parameters(joint, motion), (1.0,))


KINDS: tuple[Kind, ...] = (
    Kind(
        "force",
        "a force at a point of a body (N)",
        (2, 3),
        (Field("at", "marker", "the point: body or body.point", required=True), _DIRECTION, _FRAME),
        _force,
    ),
    Kind("torque", "a torque on a body, counter-clockwise (N*m)", (2,), (_BODY,), _torque),
    Kind("torque", "a torque on a body (N*m)", (3,), (_BODY, _DIRECTION, _FRAME), _torque),
    Kind(
        "joint",
        "a torque (N*m) or a force (N) along a joint, on the first body against the second",
        (2, 3),
        (Field("joint", "joint", "name of the joint", required=True), MOTION),
        _joint,
    ),
    Kind(
        "drive",
        "is added to the function of time of a drive",
        (2, 3),
        (Field("drive", "drive", "name of the drive", required=True),),
        lambda item: (),
    ),
    Kind(
        "parameter",
        "is added to a parameter, which then changes with time",
        (2, 3),
        (Field("parameter", "parameter", "name of the parameter", required=True),),
        lambda item: (),
    ),
)
"""What ``inputs:`` may contain; `build` gives the elements of a signal of size 1, with numbers in the place of laws."""
