"""What newcomers write by mistake is told with what they meant."""

import pytest

import mbstab
from mbstab.errors import MbstabError

MODEL = """\
mbstab: 1
title: Pendulum
parameters:
  m: {value: 1, unit: kg}
  L: {value: 0.5, unit: m, description: length of the rod}
  k: {value: 2, unit: N*m/rad}
gravity: [0, -9.81]
bodies:
  rod: {type: planar, mass: m, inertia: 0.1, points: {top: [0, L/2], end: [0, -L/2]}}
joints:
  pin: {type: revolute, between: [rod.top, ground]}
forces:
  sp: {type: joint_spring, joint: pin, stiffness: k}
reference:
  coordinates:
    rod: {theta: 0}
"""

MISTAKES = {
    "a decimal comma": ("value: 0.5", "value: 0,5", "write 0.5 for 0,5"),
    "a text with a comma": ("length of the rod", "long, thin", "quotes around a text with a comma"),
    "no colon": ("title: Pendulum", "title Pendulum", "a colon is missing above"),
    "a degree sign": ("theta: 0", "theta: 90°", "degrees are written 90*deg"),
    "a unit behind a number": ("theta: 0", "theta: 3000rpm", "{value: 3000, unit: rpm}"),
    "degrees without their unit": ("theta: 0", "theta: 90", "90 rad are 14.3 turns, and degrees are written 90*deg"),
    "a list": ("value: 1,", "value: [1, 2],", "a single number stands without brackets"),
    "a digit first": ("rod: {type", "1rod: {type", "begin with a letter"),
    "another unit": ("unit: N*m/rad", "unit: N/m", "'k' has the unit N/m, expected N*m/rad"),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_told_with_what_is_meant(name):
    right, wrong, told = MISTAKES[name]
    assert mbstab.loads(MODEL).eig().verdict == "stable"
    with pytest.raises(MbstabError) as error:
        mbstab.loads(MODEL.replace(right, wrong, 1)).eig()
    assert told in str(error.value)


def test_joints_that_contradict_each_other_are_not_blamed_on_a_guess():
    pins = "pin: {type: revolute, between: [rod.top, ground]}"
    both = f"{pins}\n  other: {{type: revolute, between: [rod.top, {{body: ground, point: [0.3, 0]}}]}}"
    with pytest.raises(MbstabError, match="may contradict each other or not reach"):
        mbstab.loads(MODEL.replace(pins, both)).eig()
