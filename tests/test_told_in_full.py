"""What a model or a call does wrong is told with its place, its unit and its reason."""

import pytest
from click.testing import CliRunner

import mbstab
from mbstab.cli import main
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
