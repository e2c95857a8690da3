"""What a model or a call does wrong is told with its place, its unit and its reason."""

import pytest
from click.testing import CliRunner

import mbstab
from mbstab.cli import main
from mbstab.cli.main import OTHERWISE
from mbstab.errors import MbstabError

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


def test_rounding_of_the_map_from_states_is_no_entry_of_the_state_space():
    """Torque and its rate are states here in the place of a speed, and the map from them is badly conditioned."""
    text = """\
mbstab: 1
bodies: {a: {type: planar, mass: 1, inertia: 0.03}, b: {type: planar, mass: 1, inertia: 0.03}}
joints:
  one: {type: revolute, between: [a, ground]}
  two: {type: revolute, between: [b, ground]}
forces:
  shaft: {type: expression, on: {a.theta: "-300*(a.theta - b.theta) - c", b.theta: 300*(a.theta - b.theta)}}
states: {c: {rate: (4e4*rate(a.theta) - c)/0.002 + 1e3*b.theta}}
outputs: {one: a.theta, two: rate(b.theta), three: c}
"""
    model = mbstab.loads(text).state_space(["a.theta", "b.theta", "c", "rate(b.theta)", "rate(c)"])
    for matrix in (model.A, model.C, model.to_coordinates, model.to_rates):
        rows = abs(matrix)[abs(matrix).max(axis=1) > 0]
        assert ((rows == 0.0) | (rows > 1e-12 * rows.max(axis=1, keepdims=True))).all()
    assert (model.C != 0.0).sum() == 3
