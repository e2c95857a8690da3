"""Values of parameters from outside: which are taken, in which unit, and what is said of the others."""

import decimal
import fractions
import pathlib
import re

import numpy as np
import pytest
from click.testing import CliRunner

import mbstab
from mbstab.cli import main
from mbstab.errors import ModelFileError, NumericalError, UsageError

TEXT = """
mbstab: 1
parameters:
  m: {value: 1, unit: kg, sign: positive}
  l: {value: 200, unit: mm, sign: positive}
  c: {value: 0, unit: N*s/m, sign: nonnegative}
  a: {value: 30, unit: deg, sign: nonzero}
  b: {value: 3, unit: m}
  bare: 2
bodies:
  p: {type: planar_point, mass: m}
forces:
  s: {type: spring, between: [p, ground], stiffness: 10, length: l}
reference:
  coordinates: {p: {x: l, y: 0}}
"""
MODEL = mbstab.loads(TEXT, "scene.yaml")
QUESTIONS = {
    "eig": lambda **p: MODEL.eig(**p),
    "certify": lambda **p: MODEL.certify(**p),
    "eig_precise": lambda **p: MODEL.eig_precise(**p),
    "check": lambda **p: MODEL.check(**p),
    "parameters": lambda **p: MODEL.parameters(**p),
    "compare": lambda **p: MODEL.compare(**p),
    "sweep": lambda **p: MODEL.sweep("b", np.array([1.0, 2.0]), **p),
}
FIFTH = [
    200, 200.0, "200", "200 mm", "200mm", "20 cm", "0.2 m", "1/5 m", "b/15", np.float64(200), np.float32(200),
    np.int32(200), np.array(200.0), fractions.Fraction(200), fractions.Fraction(400, 2), decimal.Decimal("200"),
]  # fmt: skip


@pytest.mark.parametrize("value", FIFTH, ids=repr)
def test_one_number_in_any_form_is_taken(value):
    assert MODEL.parameters(l=value)["l"] == pytest.approx(0.2, rel=1e-15)
    assert MODEL.certify(l=value).verdict == MODEL.certify().verdict


@pytest.mark.parametrize(
    "value", [None, [1, 2], (), {}, True, np.True_, 1j, b"1", object(), np.zeros(2), np.zeros((1, 1))]
)
@pytest.mark.parametrize("ask", QUESTIONS.values(), ids=QUESTIONS)
def test_what_is_no_number_is_refused_everywhere(ask, value):
    with pytest.raises(UsageError, match=r"^m=.*: a parameter is one number\nhint: "):
        ask(m=value)


@pytest.mark.parametrize("value", ["", " ", "nan", float("nan"), float("inf"), np.float64("nan"), "1e999", 10**400])
@pytest.mark.parametrize("ask", QUESTIONS.values(), ids=QUESTIONS)
def test_what_has_no_finite_value_is_refused_everywhere(ask, value):
    with pytest.raises(UsageError, match=r"^m"):
        ask(m=value)


@pytest.mark.parametrize("ask", QUESTIONS.values(), ids=QUESTIONS)
def test_names_that_are_nearly_right_are_suggested(ask):
    model = mbstab.load("top.yaml")
    with pytest.raises(UsageError, match="did you mean 'omega'"):
        model.eig(omgea=1.0)
    with pytest.raises(UsageError, match=r"no parameter 'q'\nhint: parameters: m, l, c, a, b, bare"):
        ask(q=1.0)


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("m", "2 m", r"m=2 m: m is not a unit of m, which is declared in kg\nhint: give it in kg"),
        ("l", "2 foo", "l=2 foo: unknown unit 'foo'"),
        ("l", "0x10", "l=0x10: numbers are decimal"),
        ("bare", "2 kg", "bare has no unit in the file\nhint: give the number alone"),
        ("l", "2 pi", r"unexpected 'pi' in an expression\nhint: write \*pi"),
        ("l", "2 b", r"unexpected 'b' in an expression\nhint: write \*b"),
    ],
)
def test_units_that_do_not_fit_are_named(name, text, said):
    with pytest.raises(UsageError, match=said):
        MODEL.eig(**{name: text})


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"l": -1}, "l must be positive, got -1 mm"),
        ({"l": "-2 m"}, "l must be positive, got -2000 mm"),
        ({"l": 0}, "l must be positive, got 0 mm"),
        ({"c": -1e-300}, r"c must not be negative, got -1e-300 N\*s/m"),
        ({"a": 0}, "a must not be zero, got 0 deg"),
    ],
)
@pytest.mark.parametrize("ask", QUESTIONS.values(), ids=QUESTIONS)
def test_signs_of_parameters_hold_wherever_the_value_comes_from(ask, settings, said):
    try:
        found = ask(**settings)
        status = getattr(found, "statement", "") + " ".join(getattr(found, "problems", {}).values())
    except ModelFileError as error:
        status = str(error)
    (name,) = settings
    assert f"scene.yaml:{4 + ['m', 'l', 'c', 'a'].index(name)}:" in status
    assert re.search(said, status)


def test_signs_of_parameters_hold_at_each_point_of_a_sweep_and_in_the_file():
    swept = MODEL.sweep("l", [-100, 0, 100, 200])
    assert list(swept.problems) == [0, 1]
    with pytest.raises(ModelFileError, match=r"5:\d+: parameters\.l: l must be positive, got -200 mm"):
        mbstab.loads(TEXT.replace("value: 200", "value: -200")).eig()
    with pytest.raises(ModelFileError, match="unknown choice 'posit'"):
        mbstab.loads(TEXT.replace("sign: positive", "sign: posit"))
    assert MODEL.eig(b=-5).eigenvalues  # without a sign every value is allowed


@pytest.mark.parametrize("value", [None, 3, "", b"pendulum.yaml", []])
def test_what_is_no_path_is_refused(value):
    with pytest.raises(UsageError, match="is not a file\nhint: "):
        mbstab.load(value)


def test_paths_and_bytes_are_read(tmp_path):
    path = tmp_path / "a.yaml"
    path.write_text(TEXT, encoding="utf-8")
    assert mbstab.load(pathlib.Path(path)).model == mbstab.load(str(path)).model
    assert mbstab.loads(TEXT.encode()).parameters() == MODEL.parameters()
    with pytest.raises(ModelFileError, match="the file is empty"):
        mbstab.loads(b"")
    for text in (None, 3, path):
        with pytest.raises(UsageError, match="is no text of a model"):
            mbstab.loads(text)


WRONG = {
    "method": lambda: MODEL.eig(method=None),
    "methods": lambda: MODEL.eig(method=["nullspace"]),
    "digits": lambda: MODEL.eig_precise(digits="50"),
    "half digits": lambda: MODEL.certify(digits=50.5),
    "no digits": lambda: MODEL.compare(digits=None),
    "starts": lambda: MODEL.equilibria(starts=-1),
    "mode": lambda: MODEL.swing("first"),
    "integrator": lambda: MODEL.simulate(1.0, method=None),
    "last time": lambda: MODEL.simulate("soon"),
    "disturbance": lambda: MODEL.simulate(1.0, perturb={"p.x": None}),
    "no values": lambda: MODEL.sweep("l", None),
    "one value": lambda: MODEL.sweep("l", 3.0),
    "no name": lambda: MODEL.sweep(None, [1.0, 2.0]),
    "axes": lambda: MODEL.chart({"l": [1.0, 2.0], "m": "abc"}),
}


@pytest.mark.parametrize("call", WRONG.values(), ids=WRONG)
def test_wrong_arguments_are_errors_of_the_user(call):
    with pytest.raises(UsageError):
        call()


def test_extreme_values_are_named():
    with pytest.raises(NumericalError, match="hint: look at l=1e-200, or numbers of extreme size"):
        mbstab.load("four_bar.yaml").eig(l="1e-200")


@pytest.mark.parametrize(("key", "needed"), [("rate", "axis: z"), ("speed", "direction: x")])
def test_what_a_steady_motion_lacks_is_said(key, needed):
    text = TEXT.replace("reference:\n", f"reference:\n  steady: {{{key}: 1}}\n")
    with pytest.raises(ModelFileError, match=f"{key} needs .*[^\0]*hint: add {needed}"):
        mbstab.loads(text)


def test_a_unit_may_stand_on_the_command_line():
    found = CliRunner().invoke(main, ["eig", "pendulum.yaml", "--set", "L=200 mm", "--set", "m=2 kg"])
    assert found.exit_code == 0
    assert "6.065269986" in found.output


# --- settings are bound once ------------------------------------------------------------------------------------------


def test_a_mechanism_at_parameter_values_answers_like_one_that_is_given_them_each_time():
    there = MODEL.at(l="20 cm", m="2*b")
    assert there.parameters() == MODEL.parameters(l="20 cm", m="2*b") == {**MODEL.parameters(), "m": 6.0}
    assert there.eig().eigenvalues == MODEL.eig(l=200, m=6).eigenvalues
    assert there.at(m=1).parameters() == MODEL.parameters()
    assert MODEL.at() is MODEL


def test_all_digits_of_what_is_bound_count():
    # In double precision 1 + 1e-20 is 1; the frequency is sqrt(10/m).
    found = MODEL.at(m="1.00000000000000000001").eig_precise(30)
    assert found.eigenvalues[0].imag.startswith("3.16227766016837933198")
    assert found.eigenvalues[0].imag != MODEL.eig_precise(30).eigenvalues[0].imag


@pytest.mark.parametrize("ask", [v for k, v in QUESTIONS.items() if k != "certify"])
def test_an_interval_is_refused_by_all_but_certificates(ask):
    with pytest.raises(UsageError, match="this is an interval\nhint: intervals need mbstab eig --certify"):
        ask(m="[1, 2]")
    with pytest.raises(UsageError, match="an interval is written"):
        ask(m="[1, 2")
    assert MODEL.certify(m="[1, 2]").parameter == "m"


@pytest.mark.parametrize(
    ("ask", "said"),
    [
        (lambda: MODEL.simulate(1.0, pionts=3), "no setting or parameter 'pionts'\nhint: did you mean 'points'"),
        (lambda: MODEL.sweep("b", [1.0, 2.0], job=2), "'job'\nhint: did you mean 'jobs'"),
        (lambda: MODEL.chart({"b": [1.0, 2.0], "m": [1.0, 2.0]}, resum=True), "'resum'\nhint: did you mean 'resume'"),
        (lambda: MODEL.simulate(1.0, bar=3), "no parameter 'bar'\nhint: did you mean 'bare'"),
    ],
)
def test_keywords_that_are_nearly_settings_are_suggested(ask, said):
    with pytest.raises(UsageError, match=said):
        ask()


def test_all_that_is_wrong_with_settings_is_said_at_once():
    with pytest.raises(UsageError) as caught:
        MODEL.simulate("soon", solver="BDF", tol=2.0, points=1, step=-1.0, compiled=True)
    for said in ("the last time", "no compiled steps", "the tolerance", "the step must", "two output times"):
        assert said in str(caught.value)
    with pytest.raises(UsageError, match=r"leave out one of them\n--resume goes with --output"):
        MODEL.sweep("b", [1.0, 2.0], jobs=2, cluster="tcp://127.0.0.1:1", resume=True)
