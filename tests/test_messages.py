"""What a model or a call does wrong is told with its place, its unit, its reason, and what to write instead."""

import itertools
import math
import re

import pytest
from click.testing import CliRunner

import mbstab
from mbstab.cli import main
from mbstab.cli.main import OTHERWISE
from mbstab.errors import MbstabError, ModelFileError
from mbstab.mechanics import controllers
from mbstab.model.reader import read_model_text
from mbstab.model.values import evaluate

pytestmark = pytest.mark.table

POINT = "mbstab: 1\nparameters: {T: {value: 0.1, unit: s}, v: {value: 2, unit: m/s}, L: {value: 1, unit: m}}\n"
POINT += "bodies: {p: {type: planar, mass: 1, inertia: 1}}\n"
SPRING = POINT + "forces: {f: {type: expression, on: {p.x: -100*p.x}}}\n"


def refusal(text: str) -> str:
    with pytest.raises(MbstabError) as error:
        mbstab.loads(text, "m.yaml").eig()
    return str(error.value)


@pytest.mark.parametrize(
    ("section", "place"),
    [
        ("states: {s: {rate: (p.x - s)/(T - T)}}", "m.yaml:5:"),
        ("constraints: {c: {holonomic: p.x/(L - L) - p.y}}", "m.yaml:5:"),
        ("forces:\n  f: {type: expression, on: {p.x: -p.x, p.y: p.y/(p.x - p.x)}}", "m.yaml:6:"),
        ("forces:\n  f:\n    type: tyre\n    at: p\n    cornering_stiffness: 1/(p.x - p.x)", "m.yaml:9:"),
    ],
)  # fmt: skip
def test_divisors_that_are_zero_whatever_the_motion_are_told_at_their_place(section, place):
    said = refusal(f"{POINT}# line 4\n{section}\n")
    assert said.startswith(place)
    assert "division by zero" in said
    assert "hint: a divisor is 0" in said


@pytest.mark.parametrize(
    ("constraint", "told"),
    [
        ("nonholonomic: rate(p.x) - v", "the residual is -2 m/s"),
        ("nonholonomic: vx(p)/L - 3*v/L", "the residual is -6 1/s"),
        ("holonomic: p.x - L", "the residual is -1 m\n"),
        ("nonholonomic: 3*rate(p.x) - 6", "the residual is -6 in the unit of the expression"),
    ],
)
def test_residuals_of_written_constraints_have_the_unit_that_the_file_decides(constraint, told):
    at_rest = "reference: {coordinates: {p: {x: 0, y: 0, theta: 0}}, rates: {p: {x: 0, y: 0, theta: 0}}}\n"
    assert told in refusal(f"{POINT}constraints: {{c: {{{constraint}}}}}\n{at_rest}")


@pytest.mark.parametrize(
    ("force", "kink"),
    [("abs(p.x)", True), ("p.y*abs(p.x - p.y) + abs(p.y)", True), ("log(p.x)", False), ("1/p.x", False),
     ("sqrt(p.x)", False), ("exp(1e3 + p.x)", False)],
)  # fmt: skip
def test_only_kinks_are_told_how_they_are_smoothed(force, kink):
    said = refusal(f"{POINT}forces: {{f: {{type: expression, on: {{p.x: -p.x - {force}}}}}}}\n")
    assert ("sqrt(x**2 + w**2)" in said) == kink
    assert "hint: " in said


@pytest.mark.parametrize("field", ["mass: rate(p.x)", "mass: p.x", "mass: vx(p)"])
def test_fields_without_motion_say_where_motion_may_stand(field):
    said = refusal(POINT.replace("mass: 1", field))
    name = field.removeprefix("mass: ").replace("rate(p.x)", "p.x")
    assert f"on: {{{name}: …}}" in said


def test_a_text_without_any_section_is_one_problem():
    said = refusal("root:*:1:::\ndaemon:*:2:::\nbin: 3\n")
    assert said.count("m.yaml") == 1
    assert "daemon" not in said
    assert "comma" not in said


def test_a_text_that_is_given_as_a_file_name_is_not_repeated():
    with pytest.raises(MbstabError, match=r"mbstab\.loads") as error:
        mbstab.load(POINT)
    assert "bodies" not in str(error.value)


def test_check_lists_tables_and_definitions_that_nothing_uses():
    more = "tables: {lift: {x: [0, 1], y: [0, 2]}, drag: {x: [0, 1], y: [0, 2]}}\n"
    more += "definitions: {pull: 2*twice, twice: 'spline(1, lift)*p.x', spare: other + 1, other: 'linear(1, drag)'}\n"
    text = SPRING.replace("-100*p.x", "-pull") + more + "outputs: {x: p.x + twice}\n"
    unused = [x.removesuffix(" is not used") for x in mbstab.loads(text).check().unneeded if x.endswith("is not used")]
    assert unused == [f"parameter {x!r}" for x in "TvL"] + ["table 'drag'", "definition 'spare'", "definition 'other'"]


def command(tmp_path, text: str, *arguments: str):
    path = tmp_path / "m.yaml"
    path.write_text(text, encoding="utf-8")
    return CliRunner().invoke(main, [arguments[0], str(path), *arguments[1:]])


def test_a_sweep_over_a_count_says_how_a_count_is_given(tmp_path):
    found = command(tmp_path, SPRING + "counts: {N: 3}\n", "sweep", "--param", "N", "--from", "1", "--to", "3")
    assert found.exit_code == 2
    assert "N is a count" in found.output
    assert "use --set N=…" in found.output


@pytest.mark.parametrize("second", [(), ("--param", "T", "--from", "1", "--to", "2", "--points", "2")])
def test_a_sweep_says_why_its_first_point_has_no_answer(tmp_path, second):
    text = SPRING.replace("mass: 1", "mass: m").replace("parameters: {", "parameters: {m: {value: 1, unit: t}, ")
    ends = ("--from=-1", "--to", "1", "--points", "3", "-o", str(tmp_path / "x.json"), "--plot", "none")
    found = command(tmp_path, text, "sweep", "--param", "m", *ends[:5], *second, *ends[5:])
    assert found.exit_code == 1
    assert "the first one, at m = -1 t" in found.output
    assert "mass must not be negative, got -1000 kg" in found.output


def test_names_for_a_disturbance_include_the_states(tmp_path):
    text = SPRING + "states: {lag: {rate: (p.x - lag)/T}}\n"
    found = command(tmp_path, text, "simulate", "--to", "1", "--perturb", "foo=1")
    assert "coordinates: p.x, p.y, p.theta; states: lag" in found.output


@pytest.mark.parametrize(
    ("right", "wrong", "told"),
    [
        ("value: 0.1", "value: '0,1'", "decimals have a point: 0.5 for 0,5"),
        ("mass: 1", "mass: '(0,5 + 1)'", "decimals have a point: 0.5 for 0,5"),
        ("value: 0.1, unit: s", "value: 2020-01-01", "2020-01-01 looks like a date"),
        ("unit: s", "unit: tons", "hint: write t\n"),
        ("value: 0.1", "value: -0.1, sign: positive", "hint: the file says sign: positive"),
    ],
)
def test_values_that_are_meant_otherwise_are_told_how_they_are_written(right, wrong, told):
    assert told in refusal(POINT.replace(right, wrong)) + "\n"


def test_differences_that_look_like_dates_stay_what_they_are():
    for text in ("'2020-01-01'", "2020 - 01 - 01", "2020-1-1"):
        assert mbstab.loads(POINT.replace("value: 0.1", f"value: {text}")).parameters()["T"] == 2018


@pytest.mark.parametrize(
    ("entry", "told"),
    [
        ("forces: {t: {type: tyre, at: lorry.A1, cornering_stiffness: 1}}", "hint: bodies: p"),
        ("joints: {r: {type: revolute, between: [p, ground]}}\n"
         "forces: {t: {type: joint_spring, joint: zzz, stiffness: 1}}", "hint: joints: r"),
    ],
)  # fmt: skip
def test_unknown_names_are_told_with_those_there_are(entry, told):
    assert told in refusal(f"{POINT}{entry}\n")


def test_unknown_words_in_a_setting_say_what_a_setting_is():
    with pytest.raises(MbstabError, match="hint: give a number, or an expression of numbers and parameters"):
        mbstab.loads(SPRING).eig(v="abc")


def test_modes_that_are_not_found_are_told_with_their_line():
    (warning, *_) = mbstab.loads(SPRING + "modes: {sway: {near: 500i}}\n", "m.yaml").eig().warnings
    assert warning.startswith("m.yaml:5:")
    assert "mode 'sway' is not found" in warning


PAIR = """\
mbstab: 1
parameters: {v: {value: 2, unit: m/s}}
bodies: {p: {type: planar, mass: 1, inertia: 1}, q: {type: planar, mass: 1, inertia: 1, points: {h: [1, 0]}}}
joints: {r: {type: revolute, between: [p, q.h]}}
forces: {t: {type: tyre, at: q, cornering_stiffness: 100}}
reference: {coordinates: {p: {x: 0, y: 0, theta: 0}, q: {theta: 0}}, rates: {p: {x: v, theta: 0}, q: {theta: 0}}}
"""


def test_a_search_without_find_starts_from_rates_that_the_constraints_determine():
    (found,) = mbstab.loads(PAIR).equilibria()
    assert str(found.steady) == "translation with (2, 0, 0) m/s"


def test_a_search_without_find_that_has_no_value_says_what_find_is_for():
    turning = PAIR.replace("theta: 0}}}", "theta: 1}}}").replace("x: v, theta: 0", "x: v, theta: 1")
    with pytest.raises(MbstabError, match="find: steady looks for a motion"):
        mbstab.loads(turning).equilibria()


@pytest.mark.parametrize(
    ("word", "told"),
    [("campbell", "--plot campbell"), ("chart", "two --param"), ("bode", "response"), ("eigs", "did you mean 'eig'?")],
)
def test_words_that_are_no_commands_lead_to_those_that_answer(word, told):
    found = CliRunner().invoke(main, [word, "pendulum.yaml"])
    assert found.exit_code == 2
    assert told in found.output


def test_options_in_hints_on_commands_exist():
    for hint in OTHERWISE.values():
        _, command, *words = hint.split()
        known = {x for option in main.get_command(None, command).params for x in option.opts}
        assert {x for x in words if x.startswith("--")} <= known, hint


def test_models_alone_lists_them():
    alone, listed = (CliRunner().invoke(main, ["models", *more]) for more in ([], ["list"]))
    assert alone.exit_code == 0
    assert alone.output == listed.output
    assert "pendulum.yaml" in alone.output


def test_schema_takes_a_type_without_its_section():
    alone, whole = (CliRunner().invoke(main, ["schema", x]).output for x in ("rotor_bearing", "forces.rotor_bearing"))
    assert alone == whole
    assert "kxx" in whole


def test_an_interrupted_sweep_without_a_finished_block_leaves_nothing(tmp_path, monkeypatch):
    def stopped(*arguments, **options):
        raise KeyboardInterrupt

    monkeypatch.setattr("mbstab.analysis.sweep.jobs.compute", stopped)
    ends = ("--from", "1", "--to", "2", "--points", "5", "-o", str(tmp_path / "x.csv"))
    found = command(tmp_path, SPRING, "sweep", "--param", "T", *ends)
    assert "interrupted: no block of points was finished, and nothing is kept" in found.output
    assert [x.name for x in tmp_path.iterdir()] == ["m.yaml"]


@pytest.mark.parametrize(
    "text",
    [
        "mbstab: 1\nbodies:\n\ta: {type: planar_point, mass: 1}\n",
        "mbstab: 1\nbodies:\n  a:\n    type: point\n\tmass: 1\n",
    ],
)
def test_tabs_are_named(text):
    with pytest.raises(ModelFileError, match=r"the line is indented with a tab[^\0]*YAML forbids tabs"):
        mbstab.loads(text)


# --- what is meant by what newcomers write ----------------------------------------------------------------------------


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
    "a coordinate of a point": (
        "stiffness: k}",
        "stiffness: k}\n  f: {type: pid, joint: pin, of: rod.end.y, P: 1}",
        "did you mean 'y(rod.end)'?",
    ),
    "a coordinate of a misspelt point": (
        "stiffness: k}",
        "stiffness: k}\n  f: {type: pid, joint: pin, of: rod.ent.y, P: 1}",
        "did you mean 'y(rod.end)'?",
    ),
    "a speed of a point": (
        "stiffness: k}",
        "stiffness: k}\n  f: {type: pid, joint: pin, of: rod.end.vy, P: 1}",
        "did you mean 'vy(rod.end)'?",
    ),
    "an output of a point of the ground": (
        "reference:",
        "ground: {points: {mark: [0, 1]}}\noutputs: {o: rod.y - ground.mark.y}\nreference:",
        "did you mean 'y(ground.mark)'?",
    ),
    "a force along a coordinate of a point": (
        "stiffness: k}",
        "stiffness: k}\n  f: {type: expression, on: {rod.end.y: 1}}",
        "did you mean 'y(rod.end)'?",
    ),
    "a place of another body in a vector": (
        "stiffness: k}",
        "stiffness: k}\n  f: {type: force, at: rod, vector: [vx(rods.end), 0]}",
        "there is no body 'rods'; did you mean 'rod'?; a force written type: expression, on: {vx(…): …} takes them",
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
        ("v=5kmh", "v=FIRST..LAST; one value: mbstab eig --set v=5kmh"),
        ("v=5..", "v=FIRST..LAST"),
        ("v=..", "v=FIRST..LAST"),
        ("v=", "v=FIRST..LAST"),
    ],
)
def test_what_is_no_range_behind_the_name_of_a_parameter_is_told(given, said):
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


@pytest.mark.few(4)
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
    found = [x for x in model.check().warnings if "turns" in x]
    assert [x.split("\n")[0] for x in found] == ([told] if told else [])
    assert all("hint: degrees are written" in x for x in found)


def test_every_command_tells_angles_of_many_turns():
    text = MODEL.replace("  sp:", "  f: {type: joint_spring, joint: pin, stiffness: 1, rest: 60}\n  sp:")
    model = mbstab.loads(text.replace("  coordinates:", "  find: equilibrium\n  guess:"))
    for answer in (model.eig(), model.sweep("k", [1.0, 2.0])):
        assert sum("rest: 60 rad are 9.55 turns" in x for x in answer.warnings) == 1


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
        ("outputs: {o: rod.x - k}", "17:20: outputs.o"),
        ("outputs: {o: k*(rod.theta - k)}", "17:27: outputs.o"),
        ("outputs: {o: rod.x - 1*rod.theta, s: k - 2*rod.x, p: rod.x + rod.y, r: angle(pin) + rod.theta}", ""),
    ],
)
def test_terms_of_unlike_units_are_told(added, place):
    warnings = [text for text in mbstab.loads(MODEL + added, "m.yaml").motion().warnings if "length" in text]
    if place:
        assert warnings[0].startswith(f"m.yaml:{place}: the terms of a sum have the units ")
    assert len(warnings) == bool(place)


def test_a_number_of_extreme_size_is_named_where_the_computation_fails():
    with pytest.raises(MbstabError, match=r"1e200 in gravity\[1\] \(m.yaml:7:14\)"):
        mbstab.loads(MODEL.replace("[0, -9.81]", "[0, -1e200]"), "m.yaml").eig()


def test_stiffnesses_of_all_sizes_are_answered():
    """Squares of the entries of matrices are beyond the range of doubles."""
    text = MODEL.replace("unit: N*m/rad", "unit: N*m/rad}\n  b: {value: 1e250").replace("stiffness: k", "stiffness: b")
    scene = mbstab.loads(text)
    slow, fast = (max(scene.eig(b=b).values().imag) for b in (1e250, 1e300))
    assert fast == pytest.approx(1e25 * slow, rel=1e-12)


def test_a_folder_is_no_model_and_hides_no_example(tmp_path, monkeypatch):
    (tmp_path / "pendulum").mkdir()
    (tmp_path / "pendulum" / "mine.yaml").write_text(MODEL, encoding="utf-8")
    with pytest.raises(MbstabError, match=r"is a folder\nhint: name a model file in it: mine.yaml"):
        mbstab.load(tmp_path / "pendulum")
    monkeypatch.chdir(tmp_path)
    assert mbstab.load("pendulum").eig().verdict == "stable"


def test_rates_of_states_are_no_constraints_of_a_check():
    report = mbstab.loads(MODEL + "states: {z: {rate: rod.theta - z}}").check()
    assert (report.states, report.n_nonholonomic) == (1, 1)
    assert [name for name, *_ in report.constraints] == ["pin"]
    assert "nonholonomic rows   0, rank 0" in str(report)


# --- what a file most likely means ------------------------------------------------------------------------------------


HEAD = "mbstab: 1\ntitle: x\n"
ROD = "bodies: {rod: {type: planar, mass: 1, inertia: 1}}\n"
HELD = ROD + "joints: {pivot: {type: revolute, between: [rod, ground]}}\n"
CONTROLLED = HELD + "forces: {c: {type: state_feedback, joint: pivot, gains: {angle(GIVEN): 20}LAG}}\n"
ROTOR = (
    "bodies: {disk: {type: spatial, mass: 1, inertia: INERTIA}}\n"
    "forces: {b: {type: bushing, between: [disk, ground], stiffness: [1e4, 1e4, 1e4], damping: [1, 1, 1]}}\n"
    "reference: {find: steady, steady: {axis: z, rate: 0}, rates: {disk: {psi: 100}}}\n"
)

CORNERING = (
    "bodies: {car: {type: planar, mass: 1000, inertia: 1000}}\n"
    "forces:\n"
    "  a: {type: tyre, at: car, cornering_stiffness: 1e4}\n"
    "reference: {rates: {car: {x: 10}}}\n"
)

CASES = {
    "bodies:\n  rod: {type: planar}\n   b: {type: planar}\n": ("5:4", "indented by 3 blanks"),
    "bodies: {rod: {type: planar mass: 1}}\n": ("3:", "lacks a comma"),
    ROD + "springs:\n  s: {type: spring}\n": ("4:1", "in the section 'forces', of type joint_spring, spring"),
    ROD + "dampers:\n  s: {}\n": ("4:1", "dampers stand in the section 'forces'"),
    ROD + "Motors:\n  s: {}\n": ("4:1", "in the section 'forces', of type motor"),
    ROD + "gears:\n  s: {}\n": ("4:1", "in the section 'joints', of type gear"),
    "bodies: {d: {type: spatial, mass: 1, shape: {type: disk, radius: 1, axis: z}}}\n": ("3:", "did you mean 'along'?"),
    "source: a: b\n" + ROD: ("3:10", "in quotes"),
    "bodies:\n  rod: {type: planar, mass: 1, inertia: 1}\n  pivot: {type: revolute, between: [rod, ground]}\n": (
        "5:17", "'revolute' is a type of joints: is the line 'joints:' missing or indented?"
    ),
    CONTROLLED.replace("GIVEN", "pivt").replace("LAG", ""): ("5:", "did you mean 'pivot'?"),
    CONTROLLED.replace("GIVEN", "pivot").replace("LAG", ", lag: 0"): ("5:", "leave it out: without it"),
    "parameters: {T: 5 ms}\n" + ROD: ("3:17", "write {value: 5, unit: ms}"),
    HELD + "forces: {c: {type: pid, joint: pivto, of: angle(pivot), P: 1}}\n": ("5:", "did you mean 'pivot'?"),
    HELD + "forces: {c: {type: pid, joint: pivot, of: rod.phi, P: 1}}\n": ("5:", "rod has the coordinates x, y, theta"),
    HELD + "forces: {c: {type: joint_spring, joint: pivot, stifness: 1}}\n": ("5:", "did you mean 'stiffness'?"),
    HELD + "forces: {c: {type: transfer_function, joint: pivot, signal: angle(pivot), numerator: 0.5, "
    "denominator: [1, 2]}}\n": ("5:", "for example [1, 0.5]"),
    HELD + "forces: {c: {type: state_space, joint: pivot, signal: angle(pivot), A: -20, B: [1], C: [1]}}\n": (
        "5:", "for example [[0, 1], [-2, -3]]"
    ),
    HELD + "forces: {c: {type: expression, on: {angle(pivot): -effort(c)}}}\n": ("5:", "the state NAME_effort"),
    HELD + "states: {u: {rate: acceleration(rod.theta)}}\n": ("5:", "take rate(w)"),
    ROD + "constraints: {c: {nonholonomic: rate(rod.x) = 1}}\n": ("4:", "what is zero: left - (right)"),
    HELD + "forces: {c: {type: pid, joint: pivot, of: angle(pivot), target: 1, P: 3, I: 1}}\n"
    "reference: {find: equilibrium, coordinates: {rod: {theta: 0}}}\n": ("6:", "they settle where the rate is zero"),
    CONTROLLED.replace("angle(GIVEN): 20", "pivot: 20").replace("LAG", ""): ("5:", "'pivot' is a joint: angle(pivot)"),
    CONTROLLED.replace("angle(GIVEN): 20", "rod: 20").replace("LAG", ""): (
        "5:", "'rod' is a body: it has the coordinates rod.x"
    ),
    CONTROLLED.replace("GIVEN", "pivot").replace("LAG", "").replace("20", "20,5"): ("5:", "write 0.5 for 0,5"),
    ROD + "expect: [{source: a book}]\n": ("4:10", "mbstab schema expect shows the keys"),
    ROD + "constraints: {c: {holonomic: rod.y**2}}\n": ("4:", "without a power"),
    ROD + "constraints: {c: {holonomic: (rod.x - 1)**4}}\nreference: {guess: {rod: {x: 1.3}}}\n": (
        "4:", "without a power"
    ),
    ROD + "constraints: {c: {holonomic: rod.x**2 + rod.y**2}}\nreference: {coordinates: {rod: {x: 0, y: 0}}}\n": (
        "4:", "one constraint for each"
    ),
    CORNERING.replace("x: 10", "theta: 10"): ("5:", "at rest or turning on the spot"),
    HELD + "states: {z: {rate: y - z}}\n": ("5:", "coordinates are written with their body, such as rod.y"),
    HELD + "states: {z: {rate: -z, initial: 3}}\n": ("5:", "stands under initial: coordinates:"),
    HELD + "tables: {T: {x: [0, 1], y: [0, 1]}}\nstates: {z: {rate: \"table(T, rod.x)\"}}\n": (
        "6:", "the table comes last: table(x, T)"
    ),
    HELD + "forces: {c: {type: pid, joint: pivot, of: angle(pivot), P: 3, setpoint: 1}}\n": ("5:", "mean 'target'?"),
    HELD + "forces: {c: {type: bearing, between: [rod, ground], stiffness: 1, kxx: 1}}\n": (
        "5:", "kxx is a key of the type rotor_bearing"
    ),
    CORNERING.replace("1e4", "-1e4"): ("5:", "the other sign have it negative"),
    CORNERING.replace("1e4", "1e4, camber_stiffness: 10"): (
        "5:", "a tyre has camber_stiffness in spatial scenes only, and this one is planar"
    ),
    ROTOR.replace("INERTIA", "[0.01, 0.012, 0.02]"): ("5:", "only with equal moments of inertia xx and yy"),
}  # fmt: skip


@pytest.mark.parametrize("text", CASES)
def test_what_is_wrong_is_told_with_what_mends_it(text):
    place, hint = CASES[text]
    with pytest.raises(MbstabError) as error:
        mbstab.loads(HEAD + text).eig()
    told = str(error.value)
    assert f":{place}" in told
    assert hint in told
    assert told.count("hint:") == 1  # nothing that follows from it is told beside it


def test_a_round_rotor_spins():
    answer = mbstab.loads(HEAD + ROTOR.replace("INERTIA", "[0.01, 0.01, 0.02]")).eig()
    assert len(answer.eigenvalues) == 12


@pytest.mark.parametrize("given", ["rod.theta=10 deg", "rod.theta=10*deg", "rod.theta=10000*deg/1000"])
def test_disturbances_take_units(given):
    answer = CliRunner().invoke(main, ["simulate", "pendulum.yaml", "--perturb", given, "--to", "0.1", "--once"])
    assert answer.exit_code == 0, answer.stderr
    assert "0.034729636" in answer.stdout  # 0.2 m * sin(10 deg)


@pytest.mark.parametrize(("given", "hint"), [("rod.theta=1 kg", "in rad"), ("rate(rod.theta)=1 deg", "in rad/s")])
def test_units_of_disturbances_must_fit(given, hint):
    answer = CliRunner().invoke(main, ["simulate", "pendulum.yaml", "--perturb", given])
    assert answer.exit_code == 2
    assert f"hint: give it {hint}" in answer.stderr


def test_where_branches_meet_is_told_with_parameter_and_unit():
    answer = CliRunner().invoke(main, ["sweep", "ziegler_column.yaml", "--param", "P", "--plot", "none", "--meetings"])
    assert "branches meet at P (N): " in answer.stdout


@pytest.mark.parametrize(("coordinate", "held"), [("rod.x", True), ("rod.theta", False)])
def test_a_controller_of_a_coordinate_that_constraints_hold_is_told(coordinate, held):
    text = HEAD + HELD + f"forces: {{c: {{type: pid, coordinate: {coordinate}, of: rod.theta, P: 3, D: 1}}}}\n"
    found = mbstab.loads(text + "reference: {coordinates: {rod: {theta: 0}}}\n").eig()
    assert (f"forces.c acts on {coordinate}, which the constraints hold" in " ".join(found.warnings)) == held


SPUN = """mbstab: 1
bodies: {{rotor: {{type: spatial, mass: 9, inertia: {inertia}, points: {{A: {end}}}}}}}
ground: {{points: {{A: {end}}}}}
forces: {{A: {{type: rotor_bearing, between: [rotor.A, ground.A], axis: {axis}, zero: {zero}, kxx: 3e5, kyy: 2e5}}}}
constraints: {{thrust: {{holonomic: rotor.{axis}}}}}
reference:
  coordinates: {{rotor: {{x: 0, y: 0, z: 0, phi: 0, theta: 0, psi: 0}}}}
  rates: {{rotor: {{{angle}: 300}}}}
"""


@pytest.mark.parametrize(
    ("inertia", "axis", "angle", "said"),
    [
        ("[1, 2, 2]", "x", "phi", "turn its axes by axes: [0, 90*deg, 0] in bodies.rotor"),
        ("[2, 1, 2]", "y", "theta", "turn its axes by axes: [-90*deg, 0, 0] in bodies.rotor"),
        ("[2, 2.1, 1]", "z", "psi", "only with equal moments of inertia xx and yy"),
        ("[2, 2, 1]", "z", "psi", ""),
    ],
)
def test_a_spin_that_is_not_steady_is_told_with_the_remedy(inertia, axis, angle, said):
    end, zero = {"x": ("[0.3, 0, 0]", "y"), "y": ("[0, 0.3, 0]", "z"), "z": ("[0, 0, 0.3]", "x")}[axis]
    text = SPUN.format(inertia=inertia, axis=axis, angle=angle, end=end, zero=zero)
    reasons = " ".join(mbstab.loads(text).eig().reasons)
    assert said in reasons
    assert ("frozen-time" in reasons) == bool(said)


@pytest.mark.parametrize(
    ("model", "right", "wrong", "said"),
    [
        (
            "rolling_torus",
            "z: rho",
            "z: R",
            "the height of its lowest point (upright, its centre is at the height radius + tube) is -0.05 m",
        ),
        ("rattleback", "z: c - h,", "z: c - h + 0.01,", "the height of its lowest point is 0.01 m"),
    ],
)
def test_a_contact_at_the_wrong_height_is_told_which_height_it_has(model, right, wrong, said):
    text = CliRunner().invoke(main, ["models", "show", model]).stdout
    assert right in text
    with pytest.raises(MbstabError) as error:
        mbstab.loads(text.replace(right, wrong)).eig()
    assert said in str(error.value)


@pytest.mark.parametrize("given", ["1e-9*rod.x + rod.y**2", "rod.y - exp(rod.x/0.001) + 1", "rod.y**2 - 1e-8"])
def test_a_small_derivative_that_does_not_vanish_is_no_square(given):
    found = mbstab.loads(
        f"{HEAD}{ROD}constraints: {{c: {{holonomic: {given}}}}}\nreference: {{guess: {{rod: {{y: 0.5}}}}}}\n"
    )
    assert found.eig().counts.expected == 4


@pytest.mark.parametrize(("first", "last", "told"), [("5", "8", True), ("0", "8", False)])
def test_a_sweep_that_is_undecided_everywhere_says_what_tells_more(first, last, told):
    arguments = ["sweep", "rolling_disk.yaml", "--param", "omega", "--from", first, "--to", last, "--points", "5"]
    answer = CliRunner().invoke(main, [*arguments, "--plot", "none"])
    assert answer.exit_code == 0, answer.stderr
    assert ("hint: mbstab eig with --set omega=6.5 says what is open there" in answer.stdout) == told
    arguments += ["--param", "m", "--from", "1", "--to", "2", "--points", "3"]
    answer = CliRunner().invoke(main, [*arguments, "--plot", "none"])
    assert answer.exit_code == 0, answer.stderr
    hint = " ".join(answer.stdout.split())
    assert ("mbstab eig with --set omega=6.5 --set m=1.5 says what is open there" in hint) == told


FALLING = """
mbstab: 1
gravity: [0, -9.81]
bodies:
  disk: {type: planar, mass: 1, inertia: 1}
forces:
  f: {type: expression, on: {disk.x: -200*disk.x, disk.y: -100*disk.y - 500*disk.y**2}}
reference:
  rates: {disk: {theta: 1e4}}
"""


@pytest.mark.parametrize("force", ["-100*disk.y - 500*disk.y**2", "-100*disk.y"])
def test_a_spin_about_a_place_where_forces_do_not_balance_is_told_with_the_acceleration(force):
    # With the soft spring the disk falls out of its reach, although it is stiff where the reference is.
    answer = mbstab.loads(FALLING.replace("-100*disk.y - 500*disk.y**2", force)).eig()
    assert answer.verdict == "undecided"
    (reason,) = answer.reasons
    assert "forces do not balance (disk.y accelerates with -9.81 m/s^2)" in reason
    assert "find: steady" in reason


@pytest.mark.parametrize(
    ("forces", "word"),
    [("{}", "stable up to symmetry"), ("{f: {type: expression, on: {b.z: -100*b.z}}}", "undecided")],
)
def test_a_spin_in_free_fall_is_steady_but_for_the_fall(forces, word):
    # Nothing depends on place or speed of the fall: its disturbances are those without gravity.
    body = "bodies: {b: {type: spatial, mass: 1, inertia: [1, 1, 2]}}\nreference: {rates: {b: {psi: 3}}}\n"
    assert mbstab.loads(f"mbstab: 1\ngravity: [0, 0, -9.81]\n{body}forces: {forces}\n").eig().verdict == word


SAGGING = """
mbstab: 1
parameters: {Omega: 50}
gravity: [0, -9.81, 0]
ground: {points: {A: [0, 0, -0.2], B: [0, 0, 0.6]}}
bodies:
  one: {type: spatial, mass: 2, inertia: [0.02, 0.02, 0.03], points: {L: [0, 0, -0.2], R: [0, 0, 0.2]}}
  two: {type: spatial, mass: 1, inertia: [0.01, 0.01, 0.015], points: {L: [0, 0, -0.2], R: [0, 0, 0.2]}}
forces:
  b1: {type: bushing, between: [one.L, ground.A], stiffness: [2e4, 2e4, 1e5]}
  b2: {type: bushing, between: [two.R, ground.B], stiffness: [2e4, 2e4, 1e5]}
  shaft:
    type: bushing
    between: [one.R, two.L]
    stiffness: [1e6, 1e6, 1e5]
    torsional_stiffness: [3000, 3000, 500]
    torsional_damping: [1, 1, 0.1]
reference:
  find: steady
  steady: {axis: z, rate: 0}
  rates: {one: {psi: Omega}, two: {psi: Omega}}
  guess: {two: {z: 0.4}}
"""


@pytest.mark.parametrize("damping", [1, 50])
def test_a_sagging_rotor_with_inner_damping_is_told_to_need_a_drive(damping):
    model = SAGGING.replace("torsional_damping: [1, 1,", f"torsional_damping: [{damping}, {damping},")
    with pytest.raises(MbstabError) as error:
        mbstab.loads(model).eig()
    told = re.search(r"forces.shaft takes (\S+) W from the motion", str(error.value))
    assert "hold the speed by a drive" in str(error.value)
    drive = "drives:\n  spin: {type: coordinate, coordinate: one.psi, velocity: Omega}\nreference:"
    q = mbstab.loads(model.replace("reference:", drive)).motion().q
    # The bend of the shaft turns on the spot: its damper sees the rate of the bend in the turning shaft.
    taken = damping * 50.0**2 * ((q[3] - q[9]) ** 2 + (q[4] - q[10]) ** 2)
    assert math.isclose(float(told[1]), taken, rel_tol=0.01)


# --- constraints that contradict each other: every command says the same ----------------------------------------------


SCENE = "mbstab: 1\ngravity: GRAVITY\n"
PINS = """\
ground: {points: {A: [0, 0], B: [0.8, 0]}}
bodies: {rod: {type: planar, mass: 1, inertia: 0.1, points: {A: [0, 0], B: [0.5, 0]}}}
joints:
  left: {type: revolute, between: [rod.A, ground.A]}
  right: {type: revolute, between: [rod.B, ground.B]}
"""
WELDS = """\
ground: {points: {P: [0.3, 0.4]}}
bodies: {plate: {type: planar, mass: 1, inertia: 0.1}}
joints:
  left: {type: fixed, between: [plate, ground]}
  right: {type: fixed, between: [plate, ground.P]}
"""
BALLS = """\
ground: {points: {A: [0, 0, 0], B: [0, 0, 0.7]}}
bodies: {rod: {type: spatial, mass: 1, inertia: [0.1, 0.1, 0.1], points: {A: [0, 0, 0], B: [0, 0, 0.5]}}}
joints:
  left: {type: spherical, between: [rod.A, ground.A]}
  right: {type: spherical, between: [rod.B, ground.B]}
"""
SPIN = "bodies: {d: {type: planar, mass: 1, inertia: 0.1}}\njoints:\n  pin: {type: revolute, between: [d, ground]}\n"
DRIVE = "  {}: {{type: coordinate, coordinate: d.theta, position: {}}}\n"
DRIVES = SPIN + "drives:\n" + DRIVE.format("left", 0.25) + DRIVE.format("right", 1)
CONTRADICTORY = {
    "pins": (PINS, "joint", "[0, -9.81]", "0.3 m"),
    "pins without gravity": (PINS, "joint", "[0, 0]", "0.3 m"),
    "welds": (WELDS, "joint", "[0, -9.81]", "0.5 m"),
    "balls": (BALLS, "joint", "[0, 0, -9.81]", "0.2 m"),
    "angles": (DRIVES, "drive", "[0, -9.81]", "0.75 rad"),
}


@pytest.mark.parametrize("name", CONTRADICTORY)
def test_the_gap_and_both_entries_are_told_alike_by_every_command(name, tmp_path):
    text, kind, gravity, gap = CONTRADICTORY[name]
    path = tmp_path / "open.yaml"
    path.write_text(SCENE.replace("GRAVITY", gravity) + text, encoding="utf-8")
    told = set()
    for command in (["check"], ["eig"], ["equilibrium"], ["linearize"], ["simulate", "--to", "0.1"]):
        result = CliRunner().invoke(main, [command[0], str(path), *command[1:]])
        assert (result.exit_code, result.stdout) == (2, "")
        told.add(result.stderr)
    assert len(told) == 1
    for one, other in (("left", "right"), ("right", "left")):
        said = rf"satisfy {kind} '{one}': where {kind} '{other}' is satisfied, the gap is {gap}\n"
        assert len(re.findall(said, told.copy().pop())) == 1


def test_the_one_entry_that_contradicts_the_others_is_told():
    """A gap is told for the entry without which the others close; independent contradictions do not hide each other."""
    third = "  again: {type: fixed, between: [plate, ground.P]}\n"
    with pytest.raises(ModelFileError) as caught:
        mbstab.loads("mbstab: 1\n" + WELDS + third).eig()
    gaps = {p.path: "the gap is" in p.message for p in caught.value.problems}
    assert gaps == {"joints.left": True, "joints.right": False, "joints.again": False}
    assert "where joint 'right', joint 'again' are satisfied, the gap is 0.5 m" in str(caught.value)

    both = PINS + "  near: {type: revolute, between: [bar.A, ground.A]}\n"
    both += "  far: {type: revolute, between: [bar.B, ground.B]}\n"
    bar = "bar: {type: planar, mass: 1, inertia: 0.1, points: {A: [0, 0], B: [0.2, 0]}}"
    both = both.replace("bodies: {", f"bodies: {{{bar}, ")
    with pytest.raises(ModelFileError) as caught:
        mbstab.loads("mbstab: 1\n" + both).eig()
    assert "where joint 'right' is satisfied, the gap is 0.3 m" in str(caught.value)
    assert "where joint 'near' is satisfied, the gap is 0.6 m" in str(caught.value)


# --- whatever stands at a key of a controller, the answer is a model or an error at its place -------------------------


AXLE = (
    "mbstab: 1\n"
    "bodies: {rod: {type: planar, mass: 1, inertia: 1}}\n"
    "joints: {axle: {type: revolute, between: [rod, ground]}}\n"
)
GOOD = {
    "pid": {
        "joint": "axle", "of": "angle(axle)", "target": "0", "P": "1", "I": "1", "D": "1", "filter": "1", "lag": "1"
    },
    "state_feedback": {"joint": "axle", "gains": "{angle(axle): 1}", "lag": "1"},
    "transfer_function": {
        "joint": "axle", "signal": "angle(axle)", "numerator": "[1]", "denominator": "[1, 2]", "lag": "1"
    },
    "state_space": {
        "joint": "axle", "signal": "angle(axle)", "A": "[[-1]]", "B": "[1]", "C": "[1]", "D": "1", "lag": "1"
    },
    "motor": {
        "joint": "axle", "voltage": "0", "resistance": "1", "inductance": "1", "constant": "1", "ratio": "1"
    },
}  # fmt: skip
"""Of each kind, all keys; those that contain others stand for the forms of their contents, too."""

FORMS = (
    *("", "null", "~", "''", "0", "-1", "2.5", "yes", "word", "'two words'", "1 +", "()", ")", "1, 2", ".nan", "inf"),
    *("[]", "[[]]", "[1]", "[1, 2]", "[[1], [2]]", "[[1, 2]]", "[[1, 2], [3, 4]]", "[[[1]]]", "[{a: 1}]", "[null]"),
    *("{}", "{value: 800, unit: N*m/rad}", "{angle(axle): 1}", "{angle(axle): [1]}", "{angle(axle): {a: 1}}"),
    *("{angle(axle): null}", "{'': 1}", "{[1]: 2}", "angle(axle)", "rate(angle(axle))", "u_effort", "u_1", "t"),
)


def written(kind, **keys):
    entry = ", ".join(f"{key}: {text}" for key, text in {**GOOD[kind], **keys}.items())
    return AXLE + f"forces: {{u: {{type: {kind}, {entry}}}}}\n"


def test_all_kinds_and_keys_are_asked():
    assert {kind.name for kind in controllers.KINDS} == set(GOOD)
    for kind in controllers.KINDS:
        keys = {field.name for field in kind.fields if not field.made} - {"motion", "coordinate"}
        assert keys == set(GOOD[kind.name])
        mbstab.loads(written(kind.name))


@pytest.mark.parametrize("kind", GOOD)
def test_any_form_of_any_key_gives_a_model_or_an_error_at_its_place(kind):
    problems = []
    for key, form in itertools.product(("motion", "coordinate", *GOOD[kind]), FORMS):
        try:
            evaluate(read_model_text(written(kind, **{key: form})))
        except ModelFileError as error:
            problems += error.problems
    assert len(problems) > len(FORMS)
    assert all(x.location.line == 4 and x.message for x in problems)


@pytest.mark.parametrize(
    ("kind", "keys", "place", "hint"),
    [
        ("state_space", {"B": "[[1]]"}, "B", "write [1]"),
        ("state_space", {"A": "[[-1, 0], [0, -2]]", "B": "[[0], [3]]", "C": "[1, 1]"}, "B", "write [0, 3]"),
        ("state_space", {"A": "[[-1, 0], [0, -2]]", "B": "[0, 3]", "C": "[[1, k]]"}, "C", "write [1, k]"),
        ("transfer_function", {"numerator": "[[1, 2]]"}, "numerator", "write [1, 2]"),
        ("pid", {"P": "{value: 800, unit: N*m/rad}"}, "P", "units stand under parameters"),
        ("pid", {"target": "{value: 30, unit: deg}"}, "target", "units stand under parameters"),
        ("state_feedback", {"gains": "{angle(axle): {value: 1}}"}, "gains.angle(axle)", "units stand under parameters"),
        ("motor", {"constant": "[1]"}, "constant", "without brackets"),
    ],
)
def test_a_value_of_another_form_is_told_once_with_what_to_write(kind, keys, place, hint):
    with pytest.raises(ModelFileError) as caught:
        mbstab.loads(written(kind, **keys))
    (problem,) = caught.value.problems
    assert problem.path == f"forces.u.{place}"
    assert hint in problem.hint


def test_a_fault_at_one_file_leaves_the_others_their_answers(tmp_path, monkeypatch):
    for name in ("first", "second", "third"):
        (tmp_path / f"{name}.yaml").write_text(written("pid") + f"title: {name}\n", encoding="utf-8")
    whole = mbstab.Mechanism.eig

    def eig(mechanism, *arguments, **options):
        if mechanism.model.title == "second":
            raise TypeError("unhashable")
        return whole(mechanism, *arguments, **options)

    monkeypatch.setattr(mbstab.Mechanism, "eig", eig)
    monkeypatch.chdir(tmp_path)
    names = [f"{name}.yaml" for name in ("first", "second", "third")]
    found = CliRunner().invoke(main, ["eig", *names])
    assert found.exit_code == 1
    assert found.stdout.count("Verdict") == 2
    assert "second.yaml: a fault of mbstab" in found.stderr
    assert "TypeError: unhashable" in found.stderr
    assert isinstance(CliRunner().invoke(main, ["eig", "second.yaml"]).exception, TypeError)


RESTING = ["0.3", "c", "2*c - sin(c)", "named"]
"""Signals in which nothing moves; `named` is a definition."""


def with_signal(kind, key, signal):
    model = written(kind, **{key: signal}).replace(
        "forces:", "parameters: {c: 0.2}\ndefinitions: {named: 3*c}\nforces:"
    )
    return read_model_text(model)


@pytest.mark.parametrize("signal", RESTING)
@pytest.mark.parametrize(("kind", "key", "form"), [("pid", "of", "X"), ("state_feedback", "gains", "{X: 1}")])
def test_a_controller_that_reacts_to_nothing_is_told_at_its_key(kind, key, form, signal):
    with pytest.raises(ModelFileError) as caught:
        with_signal(kind, key, form.replace("X", signal))
    (problem,) = caught.value.problems
    assert problem.message == f"nothing in {signal!r} moves"
    assert problem.path.startswith(f"forces.u.{key}")
    assert "body.x" in problem.hint
    assert problem.source[problem.location.column - 1 :].startswith(signal)


@pytest.mark.parametrize(
    "signal", ["angle(axle) - c", "rate(angle(axle))", "rod.x", "named - rod.y", "c - t", "u_effort"]
)
def test_a_controller_that_reacts_to_what_moves_is_read(signal):
    with_signal("pid", "of", signal)
    with_signal("state_feedback", "gains", f"{{{signal}: 1}}")


def test_a_rate_has_no_rate_of_its_own_in_a_controller():
    text = written("pid", of="rate(angle(axle))").replace(", filter: 1", "")
    with pytest.raises(ModelFileError, match="give filter, a time constant") as caught:
        read_model_text(text)
    (problem,) = caught.value.problems
    assert problem.source[problem.location.column - 1 :].startswith("rate(angle(axle))")
