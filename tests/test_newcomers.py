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
    "gravity of a spatial scene": ("[0, -9.81]", "[0, -9.81, 0]", "the scene is planar: its vectors have x and y"),
    "friction of a joint": ("[rod.top, ground]", "[rod.top, ground], friction: 0.1", "is the damping of a spring"),
    "friction as a force": ("stiffness: k}", "stiffness: k}\n  f: {type: friction, joint: pin}", "is the damping of a"),
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


def test_degrees_without_their_unit_in_a_guess_are_told():
    free = MODEL.replace("forces:\n  sp: {type: joint_spring, joint: pin, stiffness: k}\n", "")
    found = free.replace("coordinates:\n    rod: {theta: 0}", "find: equilibrium\n  guess: {rod: {theta: 30}}")
    (warning,) = mbstab.loads(found).eig().warnings
    assert warning.startswith("reference.guess.rod.theta: 30 rad are 4.77 turns")
    assert "30*deg" in warning
    assert not mbstab.loads(found.replace("30}", "30*deg}")).eig().warnings


@pytest.mark.parametrize(
    ("added", "place"),
    [
        ("constraints: {c: {nonholonomic: rate(rod.x) + rate(rod.theta)}}", "17:45: constraints.c.nonholonomic"),
        ("outputs: {o: rod.x - rod.theta}", "17:20: outputs.o"),
        ("states: {z: {unit: m, rate: angle(pin) - z - vx(rod.end)}}", "17:40: states.z.rate"),
        ("outputs: {o: rod.x - 1*rod.theta, p: rod.x + rod.y, q: rod.x*rod.theta, r: angle(pin) + rod.theta}", ""),
    ],
)
def test_a_length_and_an_angle_that_are_added_are_told(added, place):
    warnings = [text for text in mbstab.loads(MODEL + added, "m.yaml").motion().warnings if "length" in text]
    if place:
        assert warnings[0].startswith(f"m.yaml:{place}: units of the terms differ by a length")
    assert len(warnings) == bool(place)


@pytest.mark.parametrize(
    ("right", "wrong", "told"),
    [
        ("[0, -9.81]", "[0, -1e200]", r"1e200 in gravity\[1\] \(m.yaml:7:14\)"),
        ("unit: N*m/rad", "unit: N*m/rad}\n  b: {value: 1e250", r"1e250 in parameters.b"),
    ],
)
def test_a_number_of_extreme_size_is_named_where_the_computation_fails(right, wrong, told):
    text = MODEL.replace(right, wrong).replace("stiffness: k", "stiffness: b" if "b:" in wrong else "stiffness: k")
    with pytest.raises(MbstabError, match=told):
        mbstab.loads(text.replace("b}", "b*1}"), "m.yaml").eig()


def test_a_folder_is_no_model_and_hides_no_example(tmp_path, monkeypatch):
    (tmp_path / "pendulum").mkdir()
    (tmp_path / "pendulum" / "mine.yaml").write_text(MODEL)
    with pytest.raises(MbstabError, match=r"is a folder\nhint: name a model file in it: mine.yaml"):
        mbstab.load(tmp_path / "pendulum")
    monkeypatch.chdir(tmp_path)
    assert mbstab.load("pendulum").eig().verdict == "stable"


def test_rates_of_states_are_no_constraints_of_a_check():
    report = mbstab.loads(MODEL + "states: {z: {rate: rod.theta - z}}").check()
    assert (report.states, report.n_nonholonomic) == (1, 1)
    assert [name for name, *_ in report.constraints] == ["pin"]
    assert "nonholonomic rows   0, rank 0" in str(report)
