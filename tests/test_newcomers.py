"""What newcomers write by mistake is told with what they meant."""

import pytest
from click.testing import CliRunner

import mbstab
from mbstab.cli import main
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
    "a degree sign": ("theta: 0", "theta: 90°", "write 90*deg"),
    "a unit behind a number": ("theta: 0", "theta: 3000rpm", "{value: 3000, unit: rpm}"),
    "degrees without their unit": ("theta: 0", "theta: 90", "90 rad are 14.3 turns, and degrees are written 90*deg"),
    "a list": ("value: 1,", "value: [1, 2],", "a single number stands without brackets"),
    "a digit first": ("rod: {type", "1rod: {type", "begin with a letter"),
    "gravity of a spatial scene": ("[0, -9.81]", "[0, -9.81, 0]", "the scene is planar: its vectors have x and y"),
    "friction of a joint": ("[rod.top, ground]", "[rod.top, ground], friction: 0.1", "is the damping of a spring"),
    "friction as a force": ("stiffness: k}", "stiffness: k}\n  f: {type: friction, joint: pin}", "is the damping of a"),
    "a unit of SI": ("inertia: 0.1", "inertia: 0.1 kg*m^2", "'0.1 kg*m^2': numbers in expressions are in SI units"),
    "a unit without need": ("inertia: 0.1", "inertia: 0.1 kg*m^2", "hint: write 0.1"),
    "a unit in a value": ("value: 1, unit: kg", "value: 1 t, unit: kg", "write {value: 1, unit: t}"),
    "a unit that touches": ("m: {value: 1, unit: kg}", "m: 5kmh", "write {value: 5, unit: km/h}"),
    "a unit as a factor": ("theta: 0", "theta: 5*km/h", "km/h is a unit: numbers in expressions are in SI units"),
    "a unit with a sign": ("unit: N*m/rad", "unit: N·m/rad", "products are written *"),
    "a unit with a power": ("unit: N*m/rad", "unit: kg*m²", "powers are written ^2"),
    "a unit of another name": ("unit: kg", "unit: lbs", "a pound is 0.45359237 kg"),
    "digits in groups": ("theta: 0", "theta: 1_000", "digits of a number stand together: 1000"),
    "digits apart": ("theta: 0", "theta: 1 000", "digits of a number stand together: 1000"),
    "a comma in a vector": ("[0, -9.81]", "[0, -9,81]", "decimals have a point: -9.81 for -9,81"),
    "commas in a vector": ("[0, L/2]", "[0,5, 1,2]", "decimals have a point: 0.5 for 0,5"),
    "a comma in a table": ("title: Pendulum", "tables: {T: {x: [0,5, 1], y: [0, 1]}}", "have a point: 0.5 for 0,5"),
    "a comma in a controller": (
        "stiffness: k}",
        "stiffness: k}\n  f: {type: state_space, joint: pin, signal: angle(pin), A: [[0,5]], B: [1], C: [1]}",
        "it has 1 row, and one of them 2 numbers",
    ),
    "three numbers": ("[0, -9.81]", "[1,2,3]", "the scene is planar: its vectors have x and y"),
    "a function without its argument": ("theta: 0", "theta: cos", "cos is a function: cos(…)"),
    "a short word": ("theta: 0", "theta: in", "declare it: parameters: {in: {value: …, unit: …}}"),
    "one letter": ("theta: 0", "theta: i", "declare it: parameters: {i: {value: …, unit: …}}"),
    "a logarithm": ("theta: 0", "theta: ln(2)", "the natural logarithm is written log(x)"),
    "a derivative": (
        "stiffness: k}",
        "stiffness: k}\n  f: {type: expression, on: {rod.x: -der(rod.x)}}",
        "rate(body.x)",
    ),
    "an unknown joint": (
        "stiffness: k}",
        "stiffness: k}\n  f: {type: pid, joint: pin, of: angle(a9), P: 1}",
        "joints: pin",
    ),
    "an unknown body": (
        "stiffness: k}",
        "stiffness: k}\n  f: {type: pid, joint: pin, of: y(a9.end), P: 1}",
        "bodies: rod, ground",
    ),
    "an unknown point": (
        "stiffness: k}",
        "stiffness: k}\n  f: {type: pid, joint: pin, of: y(rod.a9), P: 1}",
        "its points: top, end",
    ),
    "an unknown coordinate": (
        "stiffness: k}",
        "stiffness: k}\n  f: {type: pid, joint: pin, of: a9.q, P: 1}",
        "coordinates: rod.x, rod.y",
    ),
    "a part as text": ("title: Pendulum", "include: part.yaml", "include: [{file: part.yaml, prefix: left_}]"),
    "a repetition as a number": ("title: Pendulum", "repeat: 3", "repeat: [{for: {i: [1, 10]}, bodies: {…}}]"),
    "a list of values": (
        "title: Pendulum",
        "repeat: [{for: {i: [1, 2, 3]}}]",
        "for: {i: [1, 10]} with the first and the last value",
    ),
    "an index outside of a repetition": ("mass: m", "mass: m<i>", "an index of repeat:"),
    "an index without brackets": (
        "title: Pendulum",
        "repeat: [{for: {j: [1, 1]}, parameters: {p<j>: j}}]",
        "angle brackets: <j>",
    ),
    "a count without brackets": ("title: Pendulum\n", "counts: {N: 3}\ndefinitions: {d: 2*N}\n", "angle brackets: <N>"),
    "a spring without stiffness": (", stiffness: k", "", "give at least one of 'stiffness' and 'damping'"),
    "a bearing without coefficients": (
        "stiffness: k}",
        "stiffness: k}\n  f: {type: rotor_bearing, between: [rod, ground]}",
        "give at least one of 'curves', 'kxx'",
    ),
    "a controller without gains": (
        "stiffness: k}",
        "stiffness: k}\n  f: {type: pid, joint: pin, of: angle(pin)}",
        "give at least one of 'P', 'I' and 'D'",
    ),
    "another unit": ("unit: N*m/rad", "unit: N/m", "'k' has the unit N/m, expected N*m/rad"),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_told_with_what_is_meant(name):
    right, wrong, told = MISTAKES[name]
    assert mbstab.loads(MODEL).eig().verdict == "stable"
    with pytest.raises(MbstabError) as error:
        mbstab.loads(MODEL.replace(right, wrong, 1)).eig()
    assert told in str(error.value)


def test_an_unknown_index_is_one_problem():
    text = MODEL + "counts: {N: 3}\nrepeat: [{for: {i: [1, N]}, parameters: {p<j>: 1}}]\n"
    with pytest.raises(MbstabError) as error:
        mbstab.loads(text)
    assert str(error.value).count("<text>:") == 1
    assert "there is no count or index 'j'" in str(error.value)
    assert "counts and indices: N, i" in str(error.value)


@pytest.mark.parametrize("number", ["11", "1e3", "-3", "1/3", "2*pi"])
def test_a_number_without_a_unit_is_no_unit(number):
    plain = MODEL.replace("k: {value: 2, unit: N*m/rad}", f"k: {number}").replace("stiffness: k", "stiffness: abs(k)")
    assert mbstab.loads(plain).eig().verdict == "stable"


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("v=5kmh", "--param v --from … --to …; one value: mbstab eig --set v=5kmh"),
        ("v=5..10", "--param v --from 5 --to 10"),
    ],
)
def test_a_range_behind_the_name_of_a_parameter_is_told_apart(given, said):
    answer = CliRunner().invoke(main, ["sweep", "whipple_bicycle.yaml", "--param", given])
    assert answer.exit_code == 2
    assert answer.stderr.endswith(f"hint: {said}\n")


def test_a_decimal_comma_in_a_range_is_told():
    answer = CliRunner().invoke(main, ["sweep", "whipple_bicycle.yaml", "--param", "v", "--from", "1,5", "--to", "6"])
    assert answer.exit_code == 2
    assert "--from is given 2 times for 1 parameter" in answer.stderr
    assert "decimals have a point" in answer.stderr


def test_a_range_to_vary_is_no_value():
    answer = CliRunner().invoke(main, ["design", "pendulum.yaml", "--vary", "L", "--goal", "decay"])
    assert answer.exit_code == 2
    assert answer.stderr.endswith("--vary L: write NAME=RANGE, such as --vary L=0.9..1.1\n")


@pytest.mark.parametrize(
    ("given", "said"),
    [("v=5kmh", "write km/h"), ("v=5°", "write 5*deg"), ("v=1_000", "1000"), ("v=1,5", "decimals have a point")],
)
def test_a_setting_that_is_no_number_is_told_with_what_is_meant(given, said):
    answer = CliRunner().invoke(main, ["eig", "whipple_bicycle.yaml", "--set", given])
    assert answer.exit_code == 2
    assert said in answer.stderr.split("hint: ")[1]


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
