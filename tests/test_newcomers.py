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


@pytest.mark.parametrize(
    ("force", "told"),
    [
        ("{type: joint_spring, joint: pin, stiffness: 1, rest: 60}", "force 'f', rest: 60 rad are 9.55 turns"),
        ("{type: pid, joint: pin, of: angle(pin), target: -60, P: 1}", "force 'f', target: 60 rad are 9.55 turns"),
        ("{type: pid, joint: pin, of: rod.theta - 60, P: 1}", "force 'f', of: 60 rad are 9.55 turns"),
        ("{type: state_feedback, joint: pin, gains: {angle(pin) - 30: 1}}", "force 'f', gains: 30 rad are 4.77 turns"),
        ("{type: pid, joint: pin, of: angle(pin), target: 60*deg, P: 1}", ""),
        ("{type: pid, joint: pin, of: angle(pin), target: 10*pi, P: 1}", ""),
        ("{type: pid, joint: pin, of: rate(angle(pin)), target: 60, P: 0.01}", ""),
        ("{type: pid, joint: pin, of: y(rod.end), target: 60, P: 0.01}", ""),
    ],
)
def test_angles_of_many_turns_as_bare_numbers_are_told_as_degrees(force, told):
    text = MODEL.replace("  sp:", f"  f: {force}\n  sp:").replace("  coordinates:", "  find: equilibrium\n  guess:")
    model = mbstab.loads(text)
    for warnings in (model.check().warnings, model.eig().warnings, model.sweep("k", [1.0, 2.0]).warnings):
        found = [x for x in warnings if "turns" in x]
        assert [x.split("\n")[0] for x in found] == ([told] if told else [])
        assert all("hint: degrees are written" in x for x in found)


def test_drives_of_angles_are_told_as_degrees_and_drives_of_lengths_are_not():
    driven = MODEL.replace("reference:", "drives: {d: {type: joint, joint: pin, position: 90}}\nreference:")
    driven = driven.replace("{theta: 0}", "{}")
    (found,) = mbstab.loads(driven).check().warnings
    assert found.startswith("drive 'd', position: 90 rad are 14.3 turns\nhint: degrees are written 90*deg")
    along = driven.replace(
        "type: revolute, between: [rod.top, ground]", "type: prismatic, between: [rod, ground], axis: x"
    )
    assert mbstab.loads(along.replace("k: {value: 2, unit: N*m/rad}", "k: 2")).check().warnings == []
