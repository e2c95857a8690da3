"""Names of modes: found by eigenvalue or shape, followed to where they are asked for, through crossings and veering."""

import csv
import io
import json

import numpy as np
import pytest
from avoided_crossings import swaps
from sampling import sample

import mbstab
from mbstab.analysis.sweep import named_branches
from mbstab.cli import main
from mbstab.errors import ModelFileError
from mbstab.model.fields.answers import complex_number

BICYCLE = "whipple_bicycle.yaml"

TWO = """\
mbstab: 1
parameters: {{k: {{value: 1, unit: N/m}}, c: {{value: {coupling}, unit: N/m}}}}
bodies: {{one: {{type: planar_point, mass: 1}}, two: {{type: planar_point, mass: 1}}}}
constraints: {{a: {{holonomic: one.y}}, b: {{holonomic: two.y}}}}
forces:
  own: {{type: expression, on: {{one.x: -k*one.x - c*(one.x - two.x), two.x: -2*two.x - c*(two.x - one.x)}}}}
reference: {{coordinates: {{one: {{x: 0, y: 0}}, two: {{x: 0, y: 0}}}}}}
modes:
{modes}
"""

OSCILLATOR = """\
mbstab: 1
parameters: {c: {value: 3, unit: N*s/m}}
bodies: {b: {type: planar_point, mass: 1}}
constraints: {line: {holonomic: b.y}}
forces: {own: {type: expression, on: {b.x: -2*b.x - c*rate(b.x)}}}
reference: {coordinates: {b: {x: 0, y: 0}}}
modes: {slow: {near: -1}, fast: {near: -2}}
"""

OFTEN = """\
mbstab: 1
parameters: {k: {value: 1}}
bodies: {one: {type: planar_point, mass: 1}, two: {type: planar_point, mass: 1}}
constraints: {a: {holonomic: one.y}, b: {holonomic: two.y}}
forces:
  own: {type: expression, on: {one.x: -(3 + 2*cos(k))*one.x, two.x: -3*two.x}}
reference: {coordinates: {one: {x: 0, y: 0}, two: {x: 0, y: 0}}}
modes: {own: {shape: {one.x: 1}}}
"""


def named(result):
    """Return the upper eigenvalues by the names of their modes."""
    return {e.name: e.value for e in result.eigenvalues if e.name and e.value.imag >= 0.0}


def two(coupling, modes):
    return mbstab.loads(TWO.format(coupling=coupling, modes=modes))


def test_a_mode_that_was_not_computed_is_not_said_to_be_missing():
    whole = mbstab.loads(TWO.format(coupling=0, modes="  stiff: {shape: {two.x: 1}}"))
    assert "stiff" in named(whole.eig())
    assert any("no mode of the 2 eigenvalues that were computed" in x for x in whole.modes(1).warnings)


@pytest.mark.long
def test_names_are_not_guessed_where_modes_cross_too_often():
    scene = mbstab.loads(OFTEN)
    assert named(scene.eig(k=2)).keys() == {"own"}
    result = scene.eig(k=1e9)
    assert not named(result)
    assert any("'own'" in x and "cannot be told apart" in x for x in result.warnings)


# --- found ----------------------------------------------------------------------------------------------------------


def test_names_are_found_by_their_eigenvalues():
    found = named(mbstab.load(BICYCLE).eig(v=5))
    assert found["weave"] == pytest.approx(-0.7753418821958419 + 4.4648677137882251j)
    assert found["capsize"] == pytest.approx(-0.3228664290040871)
    assert found["castering"] == pytest.approx(-14.0783896927982472)


@pytest.mark.parametrize(
    ("v", "weave", "capsize", "castering"),
    [(2, 2.6823451751274538 + 1.6806629659067578j, -3.0715864564151425, -8.6738798483173716),
     (9, -3.2167540225249075 + 9.6937735153178220j, 0.1579018403091730, -22.4378855904085906)],
)  # fmt: skip
def test_names_are_followed_to_other_speeds(v, weave, capsize, castering):
    found = named(mbstab.load(BICYCLE).eig(v=v))
    assert found == {
        "weave": pytest.approx(weave), "capsize": pytest.approx(capsize), "castering": pytest.approx(castering)
    }  # fmt: skip


def test_a_pair_that_splits_gives_its_name_to_both():
    found = [e for e in mbstab.load(BICYCLE).eig(v=0.3).eigenvalues if e.vector is not None]
    assert [e.name for e in found] == ["weave", "weave", "capsize", "castering"]
    assert all(e.value.imag == 0.0 for e in found)


def test_a_pair_from_two_branches_has_both_names():
    model = mbstab.loads(OSCILLATOR)
    assert named(model.eig()) == {"slow": pytest.approx(-1.0), "fast": pytest.approx(-2.0)}
    assert {e.name for e in model.eig(c=1).eigenvalues} == {"fast + slow"}
    half = mbstab.loads(OSCILLATOR.replace("slow: {near: -1}, ", ""))
    assert {e.name for e in half.eig(c=1).eigenvalues} == {"fast + unnamed"}


def test_names_are_found_by_shapes():
    model = two(0.1, "  first: {shape: {one.x: 1}}\n  second: {shape: {two.x: 1 ∠ 90}}")
    found = named(model.eig())
    assert found["first"].imag < found["second"].imag


@pytest.mark.parametrize(
    ("name", "shape", "values"),
    [("governor.yaml", "{angle(right_pivot): 1}", {}), ("bricard.yaml", "{angle(hinge_0): 0.3}", {}),
     ("top.yaml", "{top.phi: 1, top.theta: 1 ∠ -90}", {"omega": 12}),
     ("chaplygin_sleigh.yaml", "{sleigh.y: 1}", {})],
)  # fmt: skip
def test_shapes_are_found_in_turning_frames_with_redundant_and_nonholonomic_rows(name, shape, values):
    text = mbstab.load(name).model.document.lines
    model = mbstab.loads("\n".join([*text, f"modes: {{own: {{shape: {shape}}}}}"]))
    result = model.eig(**values)
    assert len(named(result)) == 1


def test_each_name_belongs_to_one_mode_and_ambiguity_is_said():
    model = two(0, "  one: {near: 1i}\n  other: {near: 1.01i}")
    result = model.eig()
    assert len(named(result)) == 2
    model = two(0, "  one: {shape: {one.x: 1, two.x: 1}}")
    result = model.eig()
    assert len(named(result)) == 1
    assert any("mode 'one' is ambiguous" in text for text in result.warnings)


def test_a_mode_that_is_not_there_is_said():
    result = two(0, "  far: {near: -30+2i}").eig()
    assert named(result) == {}
    assert any("mode 'far' is not found: no mode is near -30 ± 2i" in text for text in result.warnings)


# --- followed -------------------------------------------------------------------------------------------------------


def test_names_pass_through_crossings():
    """Without coupling the first frequency passes the second."""
    model = two(0, "  first: {near: 1i}\n  second: {near: 1.4i}")
    for k in (1, 4, 9):
        found = named(model.eig(k=k))
        assert (found["first"].imag, found["second"].imag) == pytest.approx((k**0.5, 2**0.5))
    result = model.sweep("k", np.linspace(0.5, 4, 8))
    at = {name: abs(result.branches[-1, b].imag) for b, name in enumerate(result.names)}
    assert at == {"first": pytest.approx(2.0), "second": pytest.approx(2**0.5)}


def test_names_stay_on_their_branches_where_these_veer():
    """With coupling, frequencies avoid each other, and the lower one remains the lower one."""
    model = two(1e-3, "  low: {near: 1i}\n  high: {near: 1.4i}")
    for k in (1, 1.9999, 2.0001, 4):
        found = named(model.eig(k=k))
        assert found["low"].imag < found["high"].imag
    result = model.sweep("k", np.linspace(0.5, 4, 6))
    at = {name: abs(result.branches[-1, b].imag) for b, name in enumerate(result.names)}
    assert at["low"] < at["high"]


@pytest.mark.parametrize("seed", [15, *sample(range(200), every=40)])
def test_names_pass_random_avoided_crossings(seed):
    """Against left and right eigenvectors that are followed with very small steps."""
    assert swaps(seed)[0] == 0


@pytest.mark.parametrize("points", [2, 3, 6, 20])
def test_frequencies_that_pass_each_other_in_the_middle_of_an_interval_do_not_swap(points):
    """At both of its ends each is where the other was."""
    model = mbstab.loads(
        TWO.format(coupling=0, modes="  up: {near: 1i}\n  down: {near: 2i}").replace("-2*two.x", "(k - 5)*two.x")
    )
    result = model.sweep("k", np.linspace(1, 4, points))
    at = {name: abs(result.branches[-1, b].imag) for b, name in enumerate(result.names)}
    assert at == {"up": pytest.approx(2.0), "down": pytest.approx(1.0)}


def test_branches_of_a_sweep_have_names():
    result = mbstab.load(BICYCLE).sweep("v", np.linspace(0, 10, 11))
    assert sorted(result.names) == ["capsize", "castering", "weave", "weave"]
    for b, name in enumerate(result.names):
        value = result.branches[5, b]
        expected = {"capsize": -0.3228664290, "castering": -14.0783896928, "weave": -0.7753418822}[name]
        assert value.real == pytest.approx(expected, abs=1e-9)


def test_a_sweep_descends_with_the_same_names():
    result = mbstab.load(BICYCLE).sweep("v", np.linspace(9, 1, 9))
    assert result.branches[-1][result.names.index("castering")] == pytest.approx(-7.1100801463744077)


# --- printed --------------------------------------------------------------------------------------------------------


def printed(capsys, *arguments):
    with pytest.raises(SystemExit) as stop:
        main(list(arguments))
    assert not stop.value.code
    return capsys.readouterr().out


def test_names_are_printed(capsys):
    text = printed(capsys, "eig", BICYCLE)
    assert "named: capsize -0.322866, weave -0.775342 ± 4.46487i, castering -14.0784" in text
    data = json.loads(printed(capsys, "eig", BICYCLE, "--format", "json"))
    assert [e["name"] for e in data["eigenvalues"]][:4] == ["capsize", "weave", "weave", "castering"]
    rows = list(csv.DictReader(io.StringIO(printed(capsys, "eig", BICYCLE, "--format", "csv"))))
    assert [row["mode"] for row in rows][:4] == ["capsize", "weave", "weave", "castering"]
    assert rows[0]["magnitude of rear_wheel.y (m; largest coordinate 1)"] == "1.0"


def test_names_of_branches_are_printed(capsys):
    arguments = "sweep", BICYCLE, "--param", "v", "--points", "11", "--plot", "none"
    text = printed(capsys, *arguments)
    assert "4 branches (1, 2 weave; 3 capsize; 4 castering), 6 neutral eigenvalues besides" in text
    assert "3 capsize        0 → 1" in text
    data = json.loads(printed(capsys, *arguments, "--format", "json"))
    assert data["names"] == ["weave", "weave", "capsize", "castering"]
    heads = printed(capsys, *arguments, "--format", "csv").splitlines()[0]
    assert "real 4 (castering) (1/s),imag 4 (castering) (1/s)" in heads


def test_a_picture_names_branches():
    from mbstab.report.pictures.stability_map import stability_map

    result = mbstab.load(BICYCLE).sweep("v", np.linspace(0, 10, 11))
    (legend,) = stability_map(result, "v (m/s)", "").legends
    assert {"weave", "capsize", "castering"} <= {text.get_text() for text in legend.get_texts()}


# --- bad input ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "column", "message"),
    [
        ("{a: {near: 3, at: {w: 2}}}", 27, "there is no parameter 'w'"),
        ("{a: {shape: {rod.q: 1}}}", 21, "there is no coordinate 'rod.q'"),
        ("{a: {shape: {rod.theta: 0}}}", 20, "nothing moves in this shape"),
        ("{a: {near: 1}, a: {near: 2}}", 23, "the key 'a' is repeated"),
        ("{a: {shape: {angle(pivt): 1}}}", 21, "there is no joint 'pivt'"),
        ("{a: {shape: {displacement(pivot): 1}}}", 21, "the joint 'pivot' has no motion 'displacement'"),
        ("{a: {near: 3x}}", 19, "'3x' is not a number"),
        ("{a: {near: inf}}", 19, "'inf' is not a number"),
        ("{a: {}}", 12, "give either near or shape"),
        ("{a: {near: 1, shape: {rod.theta: 1}}}", 12, "give either near or shape"),
        ("{a b: {near: 1}}", 9, "not a valid name"),
        ("{a: {shape: {rod.x: 1, rod.theta: 3}}}", 9, "the constraints do not allow this shape"),
    ],
)
def test_mistakes_are_told_with_their_place(text, column, message):
    lines = [*mbstab.load("pendulum.yaml").model.document.lines, f"modes: {text}"]
    with pytest.raises(ModelFileError) as error:
        mbstab.loads("\n".join(lines)).eig()
    (problem, *_) = error.value.problems
    assert (problem.location.line, problem.location.column) == (len(lines), column)
    assert message in str(problem)


def test_complex_numbers_are_read():
    assert complex_number("-0.3+4.4i") == complex_number("-0.3 + 4.4j") == -0.3 + 4.4j
    assert complex_number("2 ∠ 90°") == pytest.approx(2j)
    assert complex_number("0.5∠\N{MINUS SIGN}30") == pytest.approx(0.5 * np.exp(-1j * np.pi / 6))
    assert complex_number("nan") is complex_number("1 ∠ x") is None


def test_names_are_not_carried_where_points_have_nothing_in_common(monkeypatch):
    def refuse(*arguments):
        raise AssertionError("points between points are as far apart")

    monkeypatch.setattr("mbstab.analysis.sweep.branches.Branches", refuse)
    result = mbstab.load("motorcycle.yaml").eig(tilt=1e200)
    assert not any(e.name for e in result.eigenvalues)
    assert any("cannot be told apart all the way from tilt = 0.4715 to 1e+200" in x for x in result.warnings)


def test_a_neutral_mode_with_a_shape_is_listed_as_zero():
    result = mbstab.load("cart_pendulum.yaml").eig()
    assert any(e.kind == "neutral" and e.motions for e in result.eigenvalues)
    assert all(e.significant == 0.0 for e in result.eigenvalues if e.kind == "neutral")
    undecided = mbstab.loads(
        "mbstab: 1\nbodies: {p: {type: planar_point, mass: 1}}\nconstraints: {rail: {holonomic: p.y}}\n"
        "forces: {s: {type: expression, on: {p.x: -7*p.x + rate(p.x)**3}}}\n"
        "reference: {coordinates: {p: {x: 0, y: 0}}}\n"
    ).eig()
    assert undecided.verdict == "undecided"
    assert "the eigenvalue 0 ± 2.64575i 1/s" in undecided.reasons[0]


def test_names_that_were_followed_are_kept(monkeypatch):
    """Further values are reached from the nearest one, and the way there is not gone twice."""
    ways, whole = [], named_branches._branches
    monkeypatch.setattr(named_branches, "_branches", lambda *given: ways.append(given[2]) or whole(*given))
    kept = mbstab.load(BICYCLE)
    for v, way in ((7.0, (5.0, 7.0)), (7.0, None), (6.99, None), (0.5, (5.0, 0.5)), (9.0, (7.0, 9.0)), (5.0, None)):
        ways.clear()
        result = kept.eig(v=v)
        assert ways == ([way] if way else [])
        fresh = mbstab.load(BICYCLE).eig(v=v)
        assert [e.name for e in result.eigenvalues] == [e.name for e in fresh.eigenvalues]
