"""What the model reader accepts, what it refuses, and where it says the fault is."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from mbstab.errors import MbstabError, ModelFileError, Problem, UsageError
from mbstab.mechanics.elements import ELEMENTS, KINDS
from mbstab.model.arithmetic import FLOAT
from mbstab.model.parameters import bound, evaluate_parameters, given_value
from mbstab.model.reader import read_model, read_model_text
from mbstab.model.scene import Scene
from mbstab.model.schema import Model
from mbstab.model.values import evaluate
from mbstab.model.words import WORDS
from mbstab.model.yamlfile import MAX_BYTES, MAX_NESTING, MAX_PROBLEMS

pytestmark = pytest.mark.table

SCENES = Path(__file__).parent / "scenes"
RICH = {
    2: (SCENES / "everything_planar.yaml").read_text(encoding="utf-8"),
    3: (SCENES / "everything_spatial.yaml").read_text(encoding="utf-8"),
}
"""Scenes with every kind of entry and every key of each."""


def read(text: str | bytes) -> Scene:
    return evaluate(read_model_text(text, "model.yaml"))


def problems_of(text: str | bytes) -> list[Problem]:
    with pytest.raises(ModelFileError, match=r"model\.yaml") as caught:
        read(text)
    return caught.value.problems


@pytest.fixture(scope="module", params=[2, 3], ids=["planar", "spatial"])
def scene(request: pytest.FixtureRequest) -> Scene:
    return read(RICH[request.param])


# --- good files -----------------------------------------------------------------------------------------------------


def test_every_kind_and_every_key_of_it_is_read(scene: Scene) -> None:
    model = scene.model
    entries = {"bodies": model.bodies, **model.entries}
    for section, kinds in KINDS.items():
        for (name, dimension), kind in kinds.items():
            # Inputs: tests/test_control.py; controllers and motors: tests/test_controllers.py. Curves, which need a
            # file beside the model: tests/test_rotor_bearing.py.
            if dimension == scene.dimension and section != "inputs" and kind.part is None:
                used = [entry for entry in entries[section].values() if entry.kind is kind]
                keys = {x.name for x in kind.fields if dimension in x.dimensions and not x.columns}
                given = {key for entry in used for key in entry.places}
                assert used, f"no {section} of type {name}"
                # Of keys that exclude each other one is used here, the other by another drive.
                assert keys - given <= {key for group in kind.one_of for key in group}


def test_every_entry_gives_elements_with_as_many_finite_numbers_as_they_take(scene: Scene) -> None:
    frame = "planar" if scene.dimension == 2 else "spatial"
    built = 0
    for item in scene.items:
        for use in item.kind.build(item):
            kind = "coordinate" if use.element.startswith("coordinate") else frame
            element = ELEMENTS[f"{kind}_{use.element}"]
            assert len(use.parameters) == sum(size or scene.dimension for _, size in element.parameters)
            assert len(use.laws) == element.signals
            assert all(math.isfinite(x) for x in use.parameters)
            built += 1
    assert built > len(KINDS["joints"])


def test_units_of_parameters_are_converted_to_si() -> None:
    parameters = read(RICH[2]).parameters
    assert parameters["m"] == 0.5
    assert parameters["L"] == 0.25
    assert parameters["speed"] == pytest.approx(math.pi, rel=1e-15)


def test_parameters_may_be_expressions_of_parameters_that_come_later() -> None:
    parameters = read("mbstab: 1\nparameters: {a: 2*b, b: c + 1, c: 3}\nbodies: {p: {type: point, mass: a}}").parameters
    assert parameters == {"c": 3.0, "b": 4.0, "a": 8.0}


def test_a_long_chain_of_parameters_is_put_in_order() -> None:
    chain = ", ".join(f"p{i}: p{i + 1} + 1" for i in range(5_000))
    parameters = read(
        f"mbstab: 1\nparameters: {{{chain}, p5000: 0}}\nbodies: {{p: {{type: point, mass: p0}}}}"
    ).parameters
    assert parameters["p0"] == 5_000
    assert next(iter(parameters)) == "p5000"


def test_planar_numbers_are_those_of_a_hand_calculation() -> None:
    scene = read(RICH[2])
    rod, disk, plate, hoop, frame, bead = scene.bodies
    assert scene.gravity == (0.0, -9.81)
    assert (rod.mass, rod.center, rod.inertia) == (0.5, (0.125, 0.0), pytest.approx((0.5 * 0.25**2 / 12,), rel=1e-15))
    assert disk.inertia == (0.5 * 1.0 * 0.25**2,)
    assert plate.inertia == pytest.approx((5 / 12,), rel=1e-15)
    assert hoop.inertia == (4.0,)
    assert bead.coordinates == ("x", "y")
    # rod 4/12 + 1*(2/3)**2, disk 1/2 + 1*(1/3)**2, sphere 2/5 + 1*(1/3)**2
    assert frame.mass == 3.0
    assert frame.center == pytest.approx((0, 1 / 3), rel=1e-15)
    assert frame.inertia == pytest.approx((1 / 3 + 4 / 9 + 1 / 2 + 1 / 9 + 2 / 5 + 1 / 9,), rel=1e-15)
    assert scene.time == 2.0
    assert scene.coordinates == {
        "rod.x": 0.25,
        "rod.theta": pytest.approx(math.pi / 6, rel=1e-15),
        "tyre_slip": 0.0,
    }
    assert scene.rates == {"rod.theta": pytest.approx(math.pi, rel=1e-15)}
    assert scene.guess == {"disk.x": -0.25}


def test_functions_of_time_carry_their_derivatives() -> None:
    drive = next(item for item in read(RICH[2]).items if item.entry.path == "drives.x")
    jet = drive.law("position").at(0.0)
    assert (jet.value, jet.rate, jet.second) == pytest.approx((0.0, 0.25 * math.pi, 0.0), abs=1e-15)


def test_inertia_may_be_moments_a_matrix_or_a_mapping() -> None:
    bodies = {body.name: body for body in read(RICH[3]).bodies}
    assert bodies["list"].inertia == (1.0, 2.0, 2.5, 0.0, 0.0, 0.0)
    assert bodies["matrix"].inertia == (3.0, 3.0, 4.0, 0.1, 0.0, 0.2)
    assert bodies["mapping"].inertia == (3.0, 3.0, 4.0, 0.0, 0.0, 0.2)


def test_shapes_have_the_moments_of_the_textbook() -> None:
    bodies = {body.name: body for body in read(RICH[3]).bodies}
    assert bodies["shape"].inertia == pytest.approx((12, 8, 8, 0, 0, 0), rel=1e-15)
    assert bodies["shape"].center == (0.0, 0.0, 1.0)
    assert bodies["box"].inertia == pytest.approx((13, 10, 5, 0, 0, 0), rel=1e-15)
    assert bodies["hoop"].inertia == (2.0, 2.0, 4.0, 0.0, 0.0, 0.0)
    assert bodies["disk"].inertia == pytest.approx((3.25 / 12, 3.25 / 12, 0.5, 0, 0, 0), rel=1e-15)


def test_parts_combine_by_the_parallel_axis_theorem() -> None:
    body = next(body for body in read(RICH[3]).bodies if body.name == "parts")
    # About the centre (2/3, 2/3, 0) the rod lies at (1/3, -2/3, 0), the sphere at (-2/3, 4/3, 0).
    assert body.mass == 3.0
    assert body.center == pytest.approx((2 / 3, 2 / 3, 0), rel=1e-15)
    xx = 2 * 4 / 9 + 0.1 + 16 / 9
    yy = 1.5 + 2 / 9 + 0.1 + 4 / 9
    zz = 1.5 + 2 * 5 / 9 + 0.1 + 20 / 9
    assert body.inertia == pytest.approx((xx, yy, zz, 12 / 9, 0, 0), rel=1e-14)


def test_axes_are_a_rotation_before_the_euler_angles() -> None:
    def turn(axis: int, angle: float) -> np.ndarray:
        matrix, (j, k) = np.eye(3), ((axis + 1) % 3, (axis + 2) % 3)
        matrix[j, j] = matrix[k, k] = math.cos(angle)
        matrix[k, j], matrix[j, k] = math.sin(angle), -math.sin(angle)
        return matrix

    text = "mbstab: 1\nbodies: {b: {type: spatial, mass: 1, inertia: [1, 1, 1], axes: [0.1, -0.2, 30*deg]}}"
    expected = turn(0, 0.1) @ turn(1, -0.2) @ turn(2, math.pi / 6)
    np.testing.assert_allclose(np.reshape(read(text).bodies[0].base, (3, 3)), expected, rtol=1e-14, atol=1e-16)
    quarter = next(body for body in read(RICH[3]).bodies if body.name == "mapping")
    np.testing.assert_allclose(quarter.base, (1, 0, 0, 0, 0, -1, 0, 1, 0), rtol=0, atol=1e-16)


def test_named_points_and_directions_are_resolved_in_their_body() -> None:
    revolute = next(item for item in read(RICH[3]).items if item.entry.path == "joints.revolute")
    first, second = revolute.markers("between")
    assert (first.body, first.point) == (0, (0.0, 0.0, 2.0))
    assert (second.body, second.point) == (-1, (1.0, 2.0, 3.0))
    one, two = revolute.triads("axis", "zero")
    assert one.v1 == pytest.approx((math.sqrt(0.5), math.sqrt(0.5), 0), rel=1e-15)
    assert two.v1 == pytest.approx((0, 0.6, 0.8), rel=1e-15)
    assert one.v2 == pytest.approx((0, 0, 1), rel=1e-15)
    slide = next(item for item in read(RICH[2]).items if item.entry.path == "joints.slide")
    assert [triad.v1 for triad in slide.triads("axis", "zero")] == [(0.0, 1.0), pytest.approx((0.6, 0.8), rel=1e-15)]


def test_what_a_file_says_beside_the_scene_is_kept() -> None:
    model = read_model_text(RICH[2])
    assert model.title == "Everything a planar scene may contain"
    assert model.parameters["m"].description == "a mass"
    assert model.order == ("joints", "contacts", "drives", "forces", "constraints", "states")
    assert model.sweep["L"].points == 5
    (expectation,) = model.expect
    assert expectation.tolerance == 1e-6
    assert expectation.neutral == 1
    assert expectation.verdict == "unstable"
    assert expectation.critical is not None
    assert expectation.critical.above == "marginally stable"
    assert expectation.eigenvalues is not None
    assert [(x.real.text, x.imag.text) for x in expectation.eigenvalues] == [("-1", "sqrt(g)"), ("2", "0")]


@pytest.mark.parametrize("word", WORDS)
def test_every_verdict_may_be_expected(word: str) -> None:
    critical = f"{{parameter: a, value: 1, below: {word}, above: unstable}}"
    text = "mbstab: 1\nparameters: {a: 1}\nbodies: {b: {type: planar_point, mass: a}}\n"
    text += f"expect: [{{verdict: {word}, critical: {critical}}}]"
    (expectation,) = read_model_text(text).expect
    assert expectation.critical is not None
    assert (expectation.verdict, expectation.critical.below) == (word, word)


def test_a_sweep_evaluates_all_its_points_at_once() -> None:
    model = read_model_text(RICH[3])
    R = np.array([1.0, 2.0, 4.0])
    many = evaluate(model, {"R": R})
    ones = [evaluate(model, {"R": float(r)}) for r in R]
    for k in (3, 5):
        for moment, *expected in zip(many.bodies[k].inertia, *(one.bodies[k].inertia for one in ones), strict=True):
            np.testing.assert_allclose(np.broadcast_to(moment, 3), expected, rtol=1e-15)


def test_a_sweep_reaches_the_functions_of_time() -> None:
    drive = "drives: {d: {type: coordinate, coordinate: p.x, position: v*t - t*v/3 + v}}\nreference: {time: 3}"
    model = read_model_text(f"mbstab: 1\nparameters: {{v: 2}}\nbodies: {{p: {{type: point, mass: 1}}}}\n{drive}")
    jet = evaluate(model, {"v": np.array([3.0, 6.0])}).items[0].law("position").at(3.0)
    np.testing.assert_allclose(jet.value, [9.0, 18.0], rtol=1e-15)
    np.testing.assert_allclose(jet.rate, [2.0, 4.0], rtol=1e-15)


def test_a_sweep_that_leaves_the_allowed_range_is_refused_with_the_value_that_does() -> None:
    model = read_model_text("mbstab: 1\nparameters: {m: 1}\nbodies: {p: {type: point, mass: m}}", "model.yaml")
    with pytest.raises(ModelFileError, match=r"model.yaml:3:33: bodies\.p\.mass: mass must not be negative, got -2 kg"):
        evaluate(model, {"m": np.array([1.0, -2.0, -3.0])})
    with pytest.raises(ModelFileError, match="mass must not be negative, got -2 kg"):
        evaluate(model, {"m": np.float64(-2.0)})
    with pytest.raises(ModelFileError, match="the value of 'm' is not finite"):
        evaluate(model, {"m": np.array([1.0, np.inf])})


def test_a_model_can_be_evaluated_again_after_a_failure() -> None:
    model = read_model_text("mbstab: 1\nparameters: {m: 1}\nbodies: {p: {type: point, mass: m}}")
    for _ in range(2):
        with pytest.raises(ModelFileError, match="mass must not be negative") as caught:
            evaluate(model, {"m": -1.0})
        assert len(caught.value.problems) == 1
        assert evaluate(model).bodies[0].mass == 1.0


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("010", 10.0),
        ("1e-3", 1e-3),
        ("1.0e3", 1000.0),
        (".5", 0.5),
        ("'2'", 2.0),
        ("+3", 3.0),
        ("1_0", None),
        ("0x10", None),
        ("~", None),
        ("1:30", None),
    ],
)
def test_numbers_mean_what_they_look_like(text: str, value: float | None) -> None:
    file = f"mbstab: 1\nbodies: {{p: {{type: point, mass: {text}}}}}"
    if value is None:
        assert "unexpected" in problems_of(file)[0].message
    else:
        assert read(file).bodies[0].mass == value


@pytest.mark.parametrize("word", ["yes", "no", "on", "true", "null"])
def test_no_word_is_turned_into_something_else(word: str) -> None:
    (problem,) = problems_of(f"mbstab: 1\nbodies: {{p: {{type: point, mass: {word}}}}}")
    assert str(problem.location) == "model.yaml:2:33"
    assert problem.message == f"unknown parameter {word!r}"


@pytest.mark.parametrize(
    "text",
    [
        "\ufeff" + "mbstab: 1\nbodies: {p: {type: point, mass: 1}}",
        b"\xef\xbb\xbf" + b"mbstab: 1\nbodies: {p: {type: point, mass: 1}}",
        "mbstab: 1\r\nbodies: {p: {type: point, mass: 1}}\r\n",
        "mbstab: 1\rbodies: {p: {type: point, mass: 1}}\r",
        "mbstab: 1 # 5\u202fkg, 3\u00a0m\nbodies: {p: {type: point, mass: 1}}",
        "---\nmbstab: 1\nbodies: {p: {type: point, mass: 1}}\n...\n",
        "mbstab: 1\njoints:\nparameters:\nreference:\nexpect:\nbodies: {p: {type: point, mass: 1}}",
    ],
    ids=["BOM in text", "BOM in bytes", "CR LF", "CR", "spaces of typography", "marked document", "empty sections"],
)
def test_harmless_variants_of_a_file_are_accepted(text: str | bytes) -> None:
    assert read(text).bodies[0].mass == 1.0


# --- bad files ------------------------------------------------------------------------------------------------------

ONE = "mbstab: 1\nbodies: {p: {type: point, mass: 1}}\n"
FLAT = """mbstab: 1
parameters: {L: {value: 1, unit: m}, a: 2}
bodies:
  b: {type: planar, mass: 1, inertia: 1, points: {P: [1, 0]}, directions: {u: [1, 1]}}
  c: {type: planar, mass: 1, inertia: 1}
joints: {r: {type: revolute, between: [b, ground]}, s: {type: prismatic, between: [c, ground], axis: x}}
"""
DEEP = """mbstab: 1
bodies:
  b: {type: spatial, mass: 1, inertia: [1, 1, 1], points: {P: [1, 0, 0]}, directions: {u: [1, 1, 0]}}
  c: {type: spatial, mass: 1, inertia: [1, 1, 1]}
"""


def mass(text: str) -> str:
    return f"mbstab: 1\nparameters: {{L: {{value: 1, unit: m}}, a: 2}}\nbodies: {{p: {{type: point, mass: {text}}}}}"


def planar(text: str) -> str:
    return f"mbstab: 1\nbodies:\n  b: {{type: planar, {text}}}"


def spatial(text: str) -> str:
    return f"mbstab: 1\nbodies:\n  b: {{type: spatial, mass: 1, {text}}}"


# The mark » stands before the character that the message must point at; it is no part of the file.
BAD: dict[str, tuple[str, str]] = {
    # text and YAML
    "empty file": ("»", "the file is empty"),
    "only comments": ("»# nothing\n# here\n", "the file is empty"),
    "only a document mark": ("---\n»", "a model file holds keys and values"),
    "list at the top": ("# a list\n»- 1\n- 2", "a model file holds keys and values"),
    "word at the top": ("»hello", "a model file holds keys and values"),
    "two documents": (ONE + "»---\n" + ONE, "a second document starts here"),
    "NUL": ("mbstab: »\0001", r"invisible character U\+0000"),
    "bell": (ONE + "title: a»\a b", r"invisible character U\+0007"),
    "form feed": (ONE + "»\f", r"invisible character U\+000C"),
    "next line": (ONE + "title: a»\x85b", r"invisible character U\+0085"),
    "line separator": (ONE + "# »\u2028mass: 3", r"invisible character U\+2028"),
    "zero-width space": (ONE + "title: »\u200b", r"invisible character U\+200B"),
    "text that runs right to left": (ONE + "title: »\u202e", r"invisible character U\+202E"),
    "byte order mark in the middle": (ONE + "»\ufeff", r"invisible character U\+FEFF"),
    "half a surrogate pair": (ONE + "title: »\ud800", r"invisible character U\+D800"),
    "repeated key": (ONE + "title: a\n»title: b", "the key 'title' is repeated; it first stands in line 3"),
    "repeated name": ("mbstab: 1\nbodies:\n  p: {type: point, mass: 1}\n  »p: {}", "the key 'p' is repeated"),
    "anchor": (ONE + "title: »&a hello", r"anchors \(&name\) are not allowed"),
    "alias": (ONE + "title: »*a", r"aliases \(\*name\) are not allowed"),
    "product that looks like an alias": (mass("»*L"), r"aliases \(\*name\) are not allowed"),
    "tag": (ONE + "title: »!!python/object/apply:os.system [ls]", "tags .*os.system.* are not allowed"),
    "tag on a mapping": ("mbstab: 1\nbodies: »!!map {}", "tags .* are not allowed"),
    "merge key": (ONE + "»<<: {title: a}", r"merge keys \(<<\) are not allowed"),
    "list as key": (ONE + "»[a, b]: 1", "a key must be a word"),
    "tab as indentation": (
        ONE + "parameters:\n»\ta: 1",
        "the line is indented with a tab\n(.*\n)*hint: .*YAML forbids tabs",
    ),
    "bracket not closed": (ONE + "gravity: [0, 1\n»", "not valid YAML: .*expected ',' or ']'"),
    "colon in a value": (ONE + "title: a»: b", "not valid YAML: mapping values are not allowed"),
    "nested too deep": (ONE + "title: " + "[" * (MAX_NESTING - 1) + "»[", f"nested at most {MAX_NESTING} deep"),
    "nested 100 000 deep": ("[" * MAX_NESTING + "»" + "[" * 100_000, f"nested at most {MAX_NESTING} deep"),
    "mappings nested 100 000 deep": (
        "{a: " * MAX_NESTING + "»" + "{a: " * 100_000,
        f"nested at most {MAX_NESTING} deep",
    ),
    # keys and sections
    "version missing": ("»bodies: {p: {type: point, mass: 1}}", "the key 'mbstab' is missing"),
    "other version": ("mbstab: »2\nbodies: {p: {type: point, mass: 1}}", "this program reads version 1"),
    "version not written": ("mbstab:»\nbodies: {p: {type: point, mass: 1}}", "this program reads version 1"),
    "bodies missing": ("»mbstab: 1", "the key 'bodies' is missing"),
    "no bodies": ("mbstab: 1\nbodies: »{}", "a model needs at least one body"),
    "bodies not written": ("mbstab: 1\nbodies:»", "expected keys with values"),
    "bodies as list": ("mbstab: 1\nbodies: »[1]", "expected keys with values"),
    "unknown section": (ONE + "»jonts: {}", "unknown key 'jonts'\n.*\n.*\nhint: did you mean 'joints'?"),
    "unknown key": ("mbstab: 1\nbodies: {p: {type: point, »masss: 1, mass: 1}}", "hint: did you mean 'mass'?"),
    "unknown type": (
        "mbstab: 1\nbodies: {p: {type: »pont, mass: 1}}",
        "unknown type 'pont'\n(.*\n)*.*did you mean 'point'?",
    ),
    "type of the other scene": (FLAT + "contacts: {w: {type: »wheel}}", "'wheel' does not exist in a planar scene"),
    "type missing": ("mbstab: 1\nbodies: {p: »{mass: 1}}", "the key 'type' is missing"),
    "type not written": ("mbstab: 1\nbodies:\n  p:\n    type:»\n    mass: 1", "expected a type"),
    "body not written": ("mbstab: 1\nbodies:\n  p:»\n", "expected keys with values"),
    "body as word": ("mbstab: 1\nbodies:\n  p: »point", "expected keys with values"),
    "joint not written": (FLAT + "contacts:\n  j:»\n", "expected keys with values"),
    "body called ground": ("mbstab: 1\nbodies: {»ground: {type: point, mass: 1}}", "the name 'ground' is taken"),
    "name with a blank": (
        "mbstab: 1\nbodies: {»my body: {type: point, mass: 1}}",
        "'my body' is not a valid name for a body",
    ),
    "name that starts with a digit": (ONE + "parameters: {»2a: 1}", "'2a' is not a valid name for a parameter"),
    "parameter called like the time": (ONE + "parameters: {»t: 1}", "the name 't' is taken"),
    "parameter called like a function": (ONE + "parameters: {»sin: 1}", "the name 'sin' is taken"),
    "point called like an axis": (planar("mass: 1, inertia: 1, points: {»x: [1, 0]}"), "the name 'x' is taken"),
    "title as list": (ONE + "title: »[a]", "expected text"),
    "planar and spatial": (
        "mbstab: 1\nbodies: »{a: {type: planar_point, mass: 1}, b: {type: point, mass: 1}}",
        "cannot be mixed",
    ),
    # numbers
    "mass missing": ("mbstab: 1\nbodies: {p: »{type: point}}", "the key 'mass' is missing"),
    "mass not written": (
        "mbstab: 1\nbodies:\n  p:\n    type: point\n    mass:»\n",
        r"expected a number or an expression \(kg\)",
    ),
    "mass empty in quotes": (mass("'»'"), "the expression is empty"),
    "mass as list": (mass("»[1, 2]"), r"expected a number or an expression \(kg\)"),
    "mass as mapping": (mass("»{value: 1}"), r"expected a number or an expression \(kg\)"),
    "negative mass": (mass("»-1"), r"bodies.p.mass: mass must not be negative, got -1 kg"),
    "nan as in YAML": (mass("».nan"), "'.nan' is not a number\n(.*\n)*hint: values must be finite"),
    "nan": (mass("»nan"), "'nan' is not a number"),
    "infinity as in YAML": (mass("»-.inf"), "'-.inf' is not a number"),
    "infinity": (mass("»inf"), "'inf' is not a number"),
    "infinity in capitals": (mass("»Infinity"), "'Infinity' is not a number"),
    "number out of range": (mass("»1e999"), r"a number may be at most 1e\+300"),
    "expression out of range": (mass("»1e300*1e300"), "finite"),
    "parameter out of range": (ONE + "parameters: {a: »1e200*1e200}", "parameters.a: .*finite"),
    "division by zero": (mass("»1/(a - 2)"), "has no value here"),
    "root of a negative number": (ONE + "parameters: {a: »sqrt(-1)}", "has no value here"),
    "word for a number": (mass("»yes"), "unknown parameter 'yes'"),
    "unit beside a number": (
        mass("2 »deg"),
        r"'2 deg': numbers in expressions are in SI .*\n(.*\n)*hint: write 2\*deg",
    ),
    "power with a caret": (mass("a»^2"), "unexpected character .* in an expression\n(.*\n)*hint: powers are written"),
    # expressions
    "unknown parameter": (
        ONE + "parameters: {length: 1, b: 2*»lenght}",
        "unknown parameter 'lenght'\n(.*\n)*.*mean 'length'",
    ),
    "parameter that needs itself": (ONE + "parameters: {a: »a}", "in a circle: a → a"),
    "circle of parameters": (ONE + "parameters: {a: »b, b: c + 1, c: a}", "in a circle: a → b → c → a"),
    "parameter not written": (ONE + "parameters:\n  a:»\n", "expected a number or an expression"),
    "parameter as list": (ONE + "parameters: {a: »[1]}", "expected a number or an expression"),
    "parameter without value": (ONE + "parameters: {a: »{unit: m}}", "the key 'value' is missing"),
    "parameter with unknown key": (ONE + "parameters: {a: {value: 1, »units: m}}", "did you mean 'unit'"),
    "call of something": (mass("__import__(»'os')"), "unexpected character"),
    "call inside quotes": (mass('"»__import__(1)"'), "unknown function '__import__'"),
    "method of a number": (mass("(1)».real"), "unexpected"),
    "attribute of a name": (mass("»a.__class__"), "cannot be used here|unexpected"),
    "index": (mass('"a»[0]"'), "unexpected character '\\['"),
    "lambda": (mass('"lambda»: 1"'), "unexpected character ':'"),
    "comparison": (mass('"1 »< 2"'), "unexpected character '<'"),
    "tower of powers": (mass("»9**9**9"), "has no value here"),
    "huge exponent": (mass("2**»1000"), "an exponent may be at most 100"),
    "10 000 parentheses": (
        mass("»" + "(" * 10_000 + "1" + ")" * 10_000),
        "an expression may have at most 5000 characters",
    ),
    "2 000 parentheses": (mass("(" * 60 + "»" + "(" * 1_940 + "1" + ")" * 2_000), "nested at most 60 deep"),
    "2 000 signs": (mass('"' + "-" * 60 + "»" + "-" * 1_940 + '1"'), "nested at most 60 deep"),
    "parenthesis not closed": (mass("(a + 1»"), r"expected '\)', found the end"),
    "operator without operand": (mass("a +»"), "expected a number"),
    "missing argument": (mass("»atan2(1)"), "takes 2 arguments, got 1"),
    "time in a mass": (mass("1 + »t"), "the time t cannot be used here"),
    "coordinate in a mass": (mass("»p.x"), "coordinates such as 'p.x' cannot be used here"),
    "rate in a mass": (mass("»rate(p.x)"), r"rate\(...\) cannot be used here"),
    "speed in a mass": (mass("»vx(p)"), r"speeds such as 'vx\(p\)' cannot be used here"),
    "expression over two lines": (mass("»a +\n  b"), "unknown parameter 'b'"),
    # units
    "unknown unit": (ONE + "parameters: {a: {value: 1, unit: kg*»metre}}", "unknown unit 'metre'"),
    "unit that is none": (ONE + "parameters: {a: {value: 1, unit: kg*»*}}", "is not a unit"),
    "unit not written": (ONE + "parameters:\n  a:\n    value: 1\n    unit:»\n", "expected a unit"),
    "length for a mass": (mass("»L"), "'L' has the unit m, expected kg"),
    "sum of unlike things": (
        ONE + "parameters: {L: {value: 1, unit: m}, m: {value: 1, unit: kg}, b: L »+ m}",
        "cannot be added",
    ),
    "expression in millimetres": (ONE + "parameters: {a: 1, b: {value: »2*a, unit: mm}}", "cannot have the unit mm"),
    "derived unit that does not fit": (
        ONE + "parameters: {L: {value: 1, unit: m}, b: {value: »L**2, unit: m}}",
        r"'L\*\*2' has the unit m\^2, expected m",
    ),
    "gravity with the wrong unit": (
        mass("1") + "\ngravity: [0, 0, »L]",
        r"gravity\[2\]: 'L' has the unit m, expected m/s\^2",
    ),
    "reference with the wrong unit": (
        FLAT + "reference: {coordinates: {b: {theta: »L}}}",
        "reference.coordinates.b.theta: 'L' has the unit m, expected rad",
    ),
    # vectors
    "vector too short": (ONE + "gravity: »[0, 1]", r"expected 3 numbers \(m/s\^2\), got 2"),
    "vector too long": (FLAT + "gravity: »[0, 0, 1]", r"expected 2 numbers \(m/s\^2\), got 3"),
    "number for a vector": (ONE + "gravity: »9.81", r"expected a list of 3 numbers \(m/s\^2\)"),
    "mapping for a vector": (ONE + "gravity: »{z: 1}", r"expected a list of 3 numbers \(m/s\^2\)"),
    "axis of the other scene": (FLAT + "gravity: »-z", "expected a list of 2 numbers"),
    "list inside a vector": (ONE + "gravity: [0, 0, »[1]]", r"gravity\[2\]: expected a number"),
    "vector out of range": (ONE + "gravity: [0, 0, »1e200*1e200]", "finite"),
    "point out of range": (
        planar("mass: 1, inertia: 1, points: {P: [0, »1e200*1e200]}"),
        r"bodies.b.points.P\[1\]: .*finite",
    ),
    "points as list": (planar("mass: 1, inertia: 1, points: »[1, 2]"), "expected keys with values"),
    "zero direction": (
        planar("mass: 1, inertia: 1, directions: {u: »[0, 0]}"),
        "a direction must have a length, this one has 0",
    ),
    "axes of two angles": (spatial("inertia: [1, 1, 1], axes: »[1, 2]"), "expected three angles"),
    "unknown key of the ground": (ONE + "ground: {»point: {}}", "did you mean 'points'"),
    # inertia
    "no inertia": ("mbstab: 1\nbodies:\n  b: »{type: planar, mass: 1}", "the body has no inertia"),
    "negative inertia in the plane": (
        planar("mass: 1, inertia: »-1"),
        r"inertia must not be negative, got -1 kg\*m\^2",
    ),
    "negative-definite inertia": (
        spatial("inertia: »[-1, -1, -1]"),
        "must be positive: its principal moments are -1, -1, -1",
    ),
    "indefinite inertia": (spatial("inertia: »{xx: 1, yy: 1, zz: 1, xy: 2}"), "must be positive: .* -1, 1, 3"),
    "triangle inequality": (spatial("inertia: »[1, 1, 3]"), "impossible inertia: its principal moments are 1, 1, 3"),
    "matrix that is not symmetric": (
        spatial("inertia: [[1, 0.1, 0], [»0.2, 1, 0], [0, 0, 1]]"),
        r"bodies.b.inertia\[1\]\[0\]: the inertia is not symmetric: '0.1' and '0.2' must be the same",
    ),
    "ragged matrix": (spatial("inertia: »[[1, 0, 0], [0, 1], [0, 0, 1]]"), "expected three principal moments"),
    "two moments": (spatial("inertia: »[1, 2]"), "expected three principal moments"),
    "number for a tensor": (spatial("inertia: »1"), "expected three principal moments"),
    "moment missing": (spatial("inertia: »{xx: 1, yy: 1}"), "the key 'zz' is missing"),
    "unknown moment": (spatial("inertia: {xx: 1, yy: 1, zz: 1, »yx: 0}"), "unknown key 'yx'"),
    "matrix for a number": (planar("mass: 1, inertia: »[1, 1, 1]"), r"expected a number or an expression \(kg\*m\^2\)"),
    "inertia that overflows": (spatial("shape: »{type: sphere, radius: 1e200}"), "mass and inertia are not finite"),
    "inertia and shape": (
        planar("mass: 1, inertia: 1, shape: »{type: rod, length: 1}"),
        "'inertia' and 'shape' cannot both",
    ),
    "mass and parts": (planar("mass: »1, parts: [{type: rod, length: 1, mass: 1}]"), "'mass' and 'parts' cannot both"),
    "drawing with a mass": (
        planar("mass: 1, inertia: 1, drawing: [{type: rod, length: 1, »mass: 1}]"),
        "unknown key 'mass'",
    ),
    "drawing without length": (planar("mass: 1, inertia: 1, drawing: [»{type: rod}]"), "the key 'length' is missing"),
    "drawing that is no list": (planar("mass: 1, inertia: 1, drawing: »{type: rod}"), "expected a list of shapes"),
    "drawing of negative size": (
        planar("mass: 1, inertia: 1, drawing: [{type: rod, length: »-1}]"),
        "length must be positive, got -1 m",
    ),
    "unknown direction": (
        planar("mass: 1, inertia: 1, drawing: [{type: cone, radius: 1, length: 1, along: »up}]"),
        "along",
    ),
    "unknown shape": (planar("mass: 1, shape: {type: »sper}"), "unknown shape 'sper'"),
    "shape without type": (planar("mass: 1, shape: »{length: 1}"), "the key 'type' is missing"),
    "shape not written": (
        "mbstab: 1\nbodies:\n  b:\n    type: planar\n    mass: 1\n    shape:»\n",
        "expected keys with values",
    ),
    "shape as word": (planar("mass: 1, shape: »rod"), "expected keys with values"),
    "length missing": (planar("mass: 1, shape: »{type: rod}"), "the key 'length' is missing"),
    "key of another shape": (planar("mass: 1, shape: {type: rod, length: 1, »radius: 1}"), "unknown key 'radius'"),
    "negative length": (planar("mass: 1, shape: {type: rod, length: »-1}"), "length must be positive, got -1 m"),
    "negative thickness": (
        planar("mass: 1, shape: {type: disk, radius: 1, thickness: »-1}"),
        "thickness must not be negative, got -1 m",
    ),
    "unknown axis of a shape": (planar("mass: 1, shape: {type: rod, length: 1, along: »u}"), "unknown choice 'u'"),
    "parts as mapping": (planar("parts: »{type: rod}"), "expected a list of shapes"),
    "no parts": (planar("parts: »[]"), "expected a list of shapes"),
    "part without mass": (planar("parts: [»{type: rod, length: 1}]"), r"parts\[0\]: the key 'mass' is missing"),
    "part without weight": (
        planar("parts: [{type: rod, length: 1, mass: »0}]"),
        r"parts\[0\].mass: mass must be positive",
    ),
    "parts that cancel": (
        planar("parts: [{type: rod, length: 1, mass: 1}, {type: rod, length: 1, mass: »-1}]"),
        r"parts\[1\].mass: mass must be positive, got -1 kg",
    ),
    "part as number": (planar("parts: [»1]"), r"parts\[0\]: expected keys with values"),
    # joints
    "joint with an unknown body": (FLAT + "contacts: {d: {type: disk, center: »d, radius: 1}}", "there is no body 'd'"),
    "joint with an unknown point": (
        FLAT + "forces: {f: {type: spring, between: [»b.p, ground]}}",
        "the body 'b' has no point 'p'\n(.*\n)*hint: did you mean 'P'|its points: P",
    ),
    "point of a body without points": (FLAT + "forces: {f: {type: spring, between: [»c.P, b]}}", "its points: none"),
    "joint with one point": (DEEP + "joints: {j: {type: spherical, between: »[b]}}", "expected a list of two points"),
    "joint with a word for points": (
        DEEP + "joints: {j: {type: spherical, between: »b}}",
        "expected a list of two points",
    ),
    "joint without points": (DEEP + "joints: {j: »{type: spherical}}", "the key 'between' is missing"),
    "body joined to itself": (
        DEEP + "joints: {j: {type: spherical, between: »[b, b.P]}}",
        "both points belong to the body 'b'",
    ),
    "ground joined to ground": (
        DEEP + "joints: {j: {type: spherical, between: »[ground, ground]}}",
        "both points belong to the ground",
    ),
    "spring on one body": (
        DEEP + "forces: {f: {type: spring, between: »[b, b.P]}}",
        "both points belong to the body 'b'",
    ),
    "point as mapping without body": (
        DEEP + "joints: {j: {type: spherical, between: [b, »{point: 0}]}}",
        "the key 'body' is missing",
    ),
    "point as list": (
        DEEP + "joints: {j: {type: spherical, between: [b, »[1, 0, 0]]}}",
        "expected a point such as body.point",
    ),
    "axis missing": (DEEP + "joints: {j: »{type: revolute, between: [b, c]}}", "the key 'axis' is missing"),
    "axis not written": (
        DEEP + "joints:\n  j:\n    type: revolute\n    between: [b, c]\n    axis:»\n",
        "expected a direction",
    ),
    "axis unknown": (
        DEEP + "joints: {j: {type: revolute, between: [c, b], axis: »u}}",
        "the body 'c' has no direction 'u'",
    ),
    "zero axis": (
        DEEP + "joints: {j: {type: revolute, between: [b, c], axis: »[0, 0, 0]}}",
        "a direction must have a length",
    ),
    "axis too long": (
        DEEP + "joints: {j: {type: revolute, between: [b, c], axis: »[1e200, 0, 0]}}",
        "a direction must have a length",
    ),
    "zero direction along the axis": (
        DEEP + "joints: {j: {type: revolute, between: [b, c], axis: x, zero: »[-2, 0, 0]}}",
        "zero must not be along the axis",
    ),
    "axis as mapping": (
        DEEP + "joints: {j: {type: revolute, between: [b, c], axis: »{x: 1}}}",
        "expected a list of 3 numbers",
    ),
    "lead of a screw": (
        DEEP + "joints: {j: {type: screw, between: [b, c], axis: x, lead: »0}}",
        "lead must not be zero, got 0 m",
    ),
    "distance of nothing": (
        DEEP + "joints: {j: {type: distance, between: [b, c], length: »0}}",
        "length must be positive",
    ),
    # contacts, drives, forces, constraints
    "contact of the ground": (
        FLAT + "contacts: {d: {type: disk, center: »ground, radius: 1}}",
        "expected a point of a body",
    ),
    "unknown motion": (
        FLAT + "contacts: {d: {type: disk, center: b, radius: 1, motion: »roling}}",
        "unknown choice 'roling'\n(.*\n)*hint: did you mean 'rolling'",
    ),
    "normal of length zero": (
        FLAT + "contacts: {d: {type: disk, center: b, radius: 1, normal: »0}}",
        "must have a length",
    ),
    "drive without law": (
        FLAT + "drives: {d: »{type: joint, joint: r}}",
        "give one of 'position' and 'velocity', none given",
    ),
    "drive with two laws": (
        FLAT + "drives: {d: »{type: joint, joint: r, position: 1, velocity: 1}}",
        "give one of 'position' and 'velocity', both given",
    ),
    "drive of a joint without angle": (
        FLAT + "drives: {d: {type: joint, joint: s, motion: »angle, position: t}}",
        "a prismatic joint has no angle, only displacement",
    ),
    "drive of a joint without motion": (
        DEEP + "joints: {j: {type: spherical, between: [b, c]}}\ndrives: {d: {type: joint, joint: »j, position: t}}",
        "a spherical joint has no single angle or travel",
    ),
    "drive of an unknown joint": (FLAT + "drives: {d: {type: joint, joint: »q, position: t}}", "there is no joint 'q'"),
    "drive of an unknown coordinate": (
        FLAT + "drives: {d: {type: coordinate, coordinate: »b.thta, position: t}}",
        "there is no coordinate 'b.thta'\n(.*\n)*hint: did you mean 'b.theta'",
    ),
    "drive without value at the reference": (
        FLAT + "drives: {d: {type: joint, joint: r, position: »1/t}}",
        "has no value here",
    ),
    "law out of range": (FLAT + "drives: {d: {type: joint, joint: r, position: »1e200*1e200*t}}", "finite"),
    "torque on an unknown body": (FLAT + "forces: {f: {type: torque, body: »d, value: 1}}", "there is no body 'd'"),
    "torque of the other scene": (
        FLAT + "forces: {f: {type: torque, body: b, value: 1, »vector: [1, 0, 0]}}",
        "unknown key 'vector'",
    ),
    "negative stiffness": (
        FLAT + "forces: {f: {type: spring, between: [b, c], stiffness: »-1}}",
        "stiffness must not be negative, got -1 N/m",
    ),
    "force on an unknown coordinate": (
        FLAT + "forces: {f: {type: expression, on: {»b.z: 1}}}",
        "there is no coordinate 'b.z'",
    ),
    "force of an unknown coordinate": (
        FLAT + "forces: {f: {type: expression, on: {b.x: -»b.z}}}",
        "unknown coordinate 'b.z'",
    ),
    "force of the rate of a parameter": (
        FLAT + "forces: {f: {type: expression, on: {b.x: »rate(a)}}}",
        "unknown coordinate 'a'",
    ),
    "force as word": (
        FLAT + "forces: {f: {type: expression, on: »b.x}}",
        "expected coordinates with generalized forces",
    ),
    "constraint without coordinate": (FLAT + "constraints: {k: {holonomic: »a - t}}", "contains no coordinate"),
    "constraint with rates": (
        FLAT + "constraints: {k: {holonomic: »rate(b.x)}}",
        "a holonomic constraint contains no rates",
    ),
    "nonholonomic without rates": (FLAT + "constraints: {k: {nonholonomic: »b.x}}", "contains no rate of a coordinate"),
    "constraint of both kinds": (FLAT + "constraints: {k: »{holonomic: b.x, nonholonomic: rate(b.x)}}", "give one of"),
    "constraint as expression": (FLAT + "constraints: {k: »b.x - 1}", "expected {holonomic: expression}"),
    "unknown kind of constraint": (FLAT + "constraints: {k: {holonomic: b.x, »scleronomic: b.x}}", "unknown key"),
    # reference, sweep, expect
    "reference of an unknown body": (FLAT + "reference: {coordinates: {»d: {x: 1}}}", "there is no body 'd'"),
    "reference of an unknown coordinate": (FLAT + "reference: {rates: {b: {»thta: 1}}}", "did you mean 'theta'"),
    "reference with an unknown key": (FLAT + "reference: {»speeds: {}}", "unknown key 'speeds'"),
    "reference out of range": (FLAT + "reference: {coordinates: {b: {x: »1e200*1e200}}}", "finite"),
    "reference as list": (FLAT + "reference: »[1]", "expected keys with values"),
    "coordinates of a body as number": (FLAT + "reference: {coordinates: {b: »1}}", "expected keys with values"),
    "coordinate as list": (
        FLAT + "reference: {coordinates: {b: {x: »[1]}}}",
        r"expected a number or an expression \(m\)",
    ),
    "sweep of an unknown parameter": (FLAT + "sweep: {»l: {from: 1, to: 2}}", "there is no parameter 'l'"),
    "sweep without end": (FLAT + "sweep: {a: »{from: 1}}", "the key 'to' is missing"),
    "sweep as list": (FLAT + "sweep: {a: »[1, 2]}", "expected {from: …, to: …, points: …}"),
    "sweep of half points": (FLAT + "sweep: {a: {from: 1, to: 2, points: »2.5}}", "expected a whole number between 2"),
    "sweep of one point": (FLAT + "sweep: {a: {from: 1, to: 2, points: »1}}", "expected a whole number between 2"),
    "expect as mapping": (FLAT + "expect: »{verdict: unstable}", "expected a list"),
    "expect of an unknown parameter": (FLAT + "expect: [{at: {»A: 1}}]", "there is no parameter 'A'"),
    "expected word": (FLAT + "expect: [»unstable]", "expected keys with values"),
    "expected verdict": (
        FLAT + "expect: [{verdict: »unstabel}]",
        "unknown choice 'unstabel'\n(.*\n)*.*mean 'unstable'",
    ),
    "expected verdict of a phrase": (
        FLAT + "expect: [{verdict: »stable up to symetry}]",
        "unknown choice 'stable up to symetry'\n(.*\n)*.*mean 'stable up to symmetry'",
    ),
    "expected verdict of --require": (
        FLAT + "expect: [{verdict: »marginal}]",
        "unknown choice 'marginal'\n(.*\n)*.*mean 'marginally stable'",
    ),
    "expected eigenvalue as number": (FLAT + "expect: [{eigenvalues: [»1]}]", "expected {real: …, imag: …}"),
    "expected eigenvalues as mapping": (FLAT + "expect: [{eigenvalues: »{real: 1}}]", "expected a list"),
    "expected eigenvalue of something": (FLAT + "expect: [{eigenvalues: [{real: »c}]}]", "unknown parameter 'c'"),
    "tolerance above one": (FLAT + "expect: [{tolerance: »2}]", "expected a number between 0 and 1"),
    "tolerance in parentheses": (FLAT + "expect: [{tolerance: »(-1)}]", "expected a number between 0 and 1"),
    "negative count": (FLAT + "expect: [{neutral: »-1}]", "expected a whole number between 0"),
    "critical without verdicts": (
        FLAT + "expect: [{critical: »{parameter: a, value: 1, below: unstable}}]",
        "'above' is missing",
    ),
    "critical value of nothing": (
        FLAT + "expect: [{critical: {parameter: »q, value: 1, below: unstable, above: unstable}}]",
        "there is no parameter 'q'",
    ),
    "after letters that are no ASCII": (
        ONE + "title: Größe µ\nparameters: {a: {description: Größe, value: »1/0}}",
        "no value here",
    ),
}


def without_mark(text: str) -> tuple[str, str]:
    """Return a text without its mark, and line:column of the mark."""
    before, after = text.split("»")
    lines = before.split("\n")
    return before + after, f"{len(lines)}:{len(lines[-1]) + 1}"


@pytest.mark.parametrize("case", BAD)
def test_a_bad_file_is_refused_with_one_problem_at_the_place_of_the_fault(case: str) -> None:
    marked, message = BAD[case]
    text, place = without_mark(marked)
    with pytest.raises(ModelFileError, match=message) as caught:
        read(text)
    (problem,) = caught.value.problems
    assert str(problem.location) == f"model.yaml:{place}"
    head, *shown = str(problem).split("\n")
    assert head.startswith(f"model.yaml:{place}: ")
    assert "\n" not in problem.message
    source = text.split("\n")[problem.location.line - 1]
    if source:
        number, line, caret = str(problem.location.line), shown[0], shown[1]
        assert caret.endswith("^")
        at = caret.index("^") - len(f" {number} | ")
        window = line.removeprefix(f" {number} | ")
        assert len(window) <= 100
        assert at <= len(window)
        if problem.location.column <= len(source) and source[problem.location.column - 1].isprintable():
            assert window[at] == source[problem.location.column - 1]


def test_a_problem_is_shown_with_line_caret_and_hint() -> None:
    (problem,) = problems_of("mbstab: 1\nbodies:\n  p:\n    type: point\n    masss: 1.5\n    mass: 1\n")
    assert str(problem).split("\n") == [
        "model.yaml:5:5: bodies.p: unknown key 'masss'",
        " 5 |     masss: 1.5",
        "   |     ^",
        "hint: did you mean 'mass'?",
    ]


def test_all_problems_of_a_file_are_reported_in_order() -> None:
    text = """mbstab: 3
titel: a
parameters:
  a: {value: b, unit: kg}
  c: {value: 1, unti: m}
  d: e
  e: d
bodies:
  one: {type: planar, inertia: 1}
  two: {type: palnar}
  three: {type: planar, mass: [1], inertia: q}
joints:
  j: {type: revolute, between: [one, for]}
  k: {type: revolute, between: [two, ground.A]}
reference:
  coordinates:
    one: {x: 1, z: 1}
    two: {x: 1}
drives:
  d: {type: coordinate, coordinate: two.x, position: 0}
"""
    expected = [
        (1, 9, "version 1"),
        (2, 1, "titel"),
        (4, 14, "unknown parameter 'b'"),
        (5, 17, "unti"),
        (6, 6, "d → e → d"),
        (9, 8, "'mass' is missing"),
        (10, 15, "palnar"),
        (11, 31, "expected a number"),
        (11, 45, "unknown parameter 'q'"),
        (13, 38, "no body 'for'"),
        (14, 38, "the ground has no point 'A'"),
        (17, 17, "unknown key 'z'"),
    ]
    with pytest.raises(ModelFileError, match=r"(?s)version 1.*titel.*unti.*unknown key 'z'") as caught:
        read(text)
    problems = caught.value.problems
    assert [(p.location.line, p.location.column) for p in problems] == [(line, column) for line, column, _ in expected]
    for problem, (_, _, words) in zip(problems, expected, strict=True):
        assert words in problem.message


def test_all_numbers_out_of_range_are_reported_in_order() -> None:
    problems = problems_of("""mbstab: 1
bodies:
  a: {type: spatial, mass: -1, inertia: [1, 1, 3]}
  b: {type: spatial, mass: 1, shape: {type: sphere, radius: 0}}
joints:
  j: {type: revolute, between: [a, b], axis: [0, 0, 0], zero: x}
forces:
  f: {type: spring, between: [a, b], stiffness: -1, damping: -2}
reference: {time: 1/0}
""")
    places = [(3, 28), (3, 41), (4, 61), (6, 46), (8, 49), (8, 62), (9, 19)]
    assert [(p.location.line, p.location.column) for p in problems] == places


def test_all_parameters_without_a_value_are_reported() -> None:
    problems = problems_of(ONE + "parameters: {a: 1/0, b: log(0), c: a}")
    assert [(p.location.column, p.path) for p in problems] == [(17, "parameters.a"), (25, "parameters.b")]


def test_an_entry_that_cannot_be_read_is_no_second_problem_where_it_is_used() -> None:
    text = FLAT.replace("type: revolute", "type: revolut").replace("c: {type: planar", "c: {type: planer")
    text += """drives:
  d: {type: joint, joint: r, position: t}
  e: {type: coordinate, coordinate: c.x, position: 0}
forces:
  f: {type: torque, body: c, value: 1}
  g: {type: expression, on: {b.x: c.x + rate(c.y), c.theta: 1}}
  h: {type: spring, between: [c.P, b], stiffness: 1}
reference: {coordinates: {c: {x: 1}}}
"""
    assert [p.message for p in problems_of(text)] == ["unknown type 'planer'", "unknown type 'revolut'"]


def test_a_file_with_endless_problems_is_given_up() -> None:
    text = ONE + "".join(f"key{i}: 1\n" for i in range(10_000))
    problems = problems_of(text)
    assert len(problems) == MAX_PROBLEMS + 1
    assert problems[-1].message == f"stopped after {MAX_PROBLEMS} problems"
    assert problems[0].message == "unknown key 'key0'"


def test_a_long_line_is_shown_around_the_fault() -> None:
    filler = ", ".join(f"p{i}: {i}" for i in range(1_000))
    (problem,) = problems_of(ONE + f"parameters: {{{filler}, bad: 2*nothing}}")
    assert problem.location.column > 5_000
    _, line, caret, *_ = str(problem).split("\n")
    assert line[caret.index("^") :].startswith("nothing")
    assert len(line) < 120


@pytest.mark.parametrize(
    ("data", "place", "byte"),
    [
        (b"mbstab: 1\ntitle: M\xfcller\n", "2:9", "0xFC"),
        ("title: a\n".encode("utf-16"), "1:1", "0xFF"),
        ("# µ\n# Größe ".encode() + b"\xff", "2:9", "0xFF"),
        (b"\xed\xa0\x80", "1:1", "0xED"),
    ],
    ids=["Latin-1", "UTF-16", "after good letters", "surrogate"],
)
def test_bytes_that_are_no_utf8_are_refused_at_their_place(data: bytes, place: str, byte: str) -> None:
    (problem,) = problems_of(data)
    assert str(problem.location) == f"model.yaml:{place}"
    assert problem.message == f"the file is not UTF-8 text: byte {byte}"


# --- files on disk --------------------------------------------------------------------------------------------------


def test_a_file_is_read_from_disk_under_its_name(tmp_path: Path) -> None:
    path = tmp_path / "my model.yaml"
    path.write_text(ONE.replace("1}", "-1}"), encoding="utf-8")
    model = read_model(path)
    assert model.name == str(path)
    with pytest.raises(ModelFileError, match=r"my model\.yaml:2:33: bodies\.p\.mass: mass must not be negative"):
        evaluate(model)


def test_a_file_of_100_megabytes_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "large.yaml"
    with path.open("wb") as stream:
        stream.truncate(100_000_000)
    with pytest.raises(UsageError, match=r"large\.yaml: a model file may have at most 1,000,000 bytes"):
        read_model(path)


def test_a_file_of_exactly_the_limit_is_read(tmp_path: Path) -> None:
    path = tmp_path / "limit.yaml"
    path.write_text(ONE + "#" * (MAX_BYTES - len(ONE)), encoding="utf-8")
    assert evaluate(read_model(path)).bodies[0].mass == 1.0


def test_no_more_than_the_limit_is_read_of_an_endless_file() -> None:
    with pytest.raises(UsageError, match="at most 1,000,000 bytes"):
        read_model(Path("/dev/zero"))


def test_a_file_that_cannot_be_read_is_said_with_the_reason(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(UsageError, match=r"missing\.yaml: cannot be read: No such file or directory"):
        read_model(tmp_path / "missing.yaml")
    with pytest.raises(UsageError, match="cannot be read: Is a directory"):
        read_model(tmp_path)

    def refuse(*_: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "open", refuse)
    with pytest.raises(UsageError, match=r"secret\.yaml: cannot be read: Permission denied"):
        read_model(tmp_path / "secret.yaml")


# --- parameter values from outside ----------------------------------------------------------------------------------


@pytest.fixture
def swept() -> Model:
    return read_model_text(
        "mbstab: 1\nparameters: {length: {value: 200, unit: mm}, twice: 2*length, n: 3}\n"
        "bodies: {p: {type: point, mass: n}}",
        "model.yaml",
    )


@pytest.mark.parametrize(
    ("setting", "value"),
    [("50", 0.05), (50, 0.05), (50.0, 0.05), ("-50", -0.05), ("1e3", 1.0), ("n*twice", 1.2), ("2*pi", 2 * math.pi)],
)
def test_a_plain_number_counts_in_the_declared_unit_and_an_expression_in_si(
    swept: Model, setting: str | float, value: float
) -> None:
    assert given_value(bound(swept, {"length": setting}), "length", FLOAT) == pytest.approx(value, rel=1e-15)


def test_an_override_reaches_the_parameters_that_depend_on_it(swept: Model) -> None:
    found = bound(swept, {"length": "100"})
    assert evaluate_parameters(found, {}, FLOAT)["twice"] == 0.2
    assert evaluate(found).parameters == {"length": 0.1, "twice": 0.2, "n": 3.0}


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (
            {"lenght": "1"},
            r"model.yaml has no parameter 'lenght'\nhint: did you mean 'length'\? parameters: length, twice, n$",
        ),
        ({"zzz": "1"}, "no parameter 'zzz'\nhint: parameters: length, twice, n"),
        ({"n": "nan"}, "n=nan: 'nan' is not a number\nhint: values must be finite"),
        ({"n": "-inf"}, "n=-inf: '-inf' is not a number"),
        ({"n": "1e999"}, r"n=1e999: a number may be at most 1e\+300"),
        ({"n": math.nan}, "n=nan: the value is not finite"),
        ({"n": math.inf}, "n=inf: the value is not finite"),
        ({"n": np.array([1.0, 2.0])}, r"a parameter is one number\nhint: .*several values are for a sweep"),
        ({"n": "1e300*1e300"}, "the value is not finite"),
        ({"n": "1/0"}, "n=1/0: the expression has no value here"),
        ({"n": ""}, "n=: the expression is empty"),
        ({"n": "lenght"}, "unknown parameter 'lenght'\nhint: did you mean 'length'?"),
        ({"n": "2*t"}, "unknown parameter 't'"),
        ({"n": "rate(length)"}, r"rate\(...\) cannot be used here"),
        ({"n": "__import__('os')"}, "unexpected character|unknown function"),
        ({"n": "200 mm"}, "n=200 mm: the parameter n has no unit in the file\nhint: give the number alone"),
        ({"length": "2 kg"}, "length=2 kg: kg is not a unit of length, which is declared in mm"),
        ({"length": "2 e"}, "unknown unit 'e'"),
    ],
)
def test_an_override_that_is_no_value_is_refused(swept: Model, settings: dict[str, str], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        bound(swept, settings)


def test_an_unknown_parameter_is_not_ignored_by_evaluate(swept: Model) -> None:
    with pytest.raises(UsageError, match="no parameter 'lenght'"):
        evaluate(swept, {"lenght": 1.0})


def test_every_error_of_a_file_is_an_error_of_the_user() -> None:
    assert issubclass(ModelFileError, MbstabError)
    assert ModelFileError([]).exit_code == UsageError("").exit_code == 2


# --- what is looked for, and what is expected of it -----------------------------------------------------------------

SEARCH = """\
mbstab: 1
parameters: {Omega: 3, T: 2}
bodies:
  a: {type: spatial, mass: 1, inertia: [1, 1, 1]}
reference:
"""


def test_a_search_for_a_steady_motion_is_read_with_unit_vectors() -> None:
    steady = "{axis: [0, 3, 4], rate: 2*Omega, point: [1, 2, 3], direction: -x, speed: Omega/2}"
    scene = read(SEARCH + f"  find: steady\n  steady: {steady}\n")
    assert scene.model.reference.find == "steady"
    assert scene.steady is not None
    np.testing.assert_allclose(scene.steady.axis, [0.0, 0.6, 0.8], atol=1e-16)
    assert (scene.steady.rate, scene.steady.speed) == (6.0, 1.5)
    np.testing.assert_allclose(scene.steady.point, [1.0, 2.0, 3.0])
    np.testing.assert_allclose(scene.steady.direction, [-1.0, 0.0, 0.0])
    open_ = read(SEARCH + "  find: steady\n  steady: {axis: z}\n").steady
    assert open_ is not None
    assert (open_.rate, open_.speed, open_.direction) == (None, None, None)


def test_what_is_not_looked_for_is_none() -> None:
    reference = read(SEARCH + "  time: 1\n").model.reference
    assert (reference.find, reference.steady, reference.period) == (None, None, None)
    assert read(SEARCH + "  period: 2*T\n").period == 4.0
    assert read(SEARCH + "  find: equilibrium\n").model.reference.find == "equilibrium"


@pytest.mark.parametrize(
    ("lines", "place", "message"),
    [
        ("  find: rest\n", (6, 9), "'rest'"),
        ("  find: [steady]\n", (6, 9), "reference.find"),
        ("  steady: z\n", (6, 11), "reference.steady"),
        ("  steady: {axis: z, rte: 3}\n", (6, 21), "unknown key 'rte'"),
        ("  steady: {axis: z, rate: Omgea}\n", (6, 27), "unknown parameter 'Omgea'"),
        ("  steady: {axis: [1, 0], rate: 2}\n", (6, 18), "reference.steady.axis"),
        ("  steady: {axis: q, rate: 2}\n", (6, 18), "reference.steady.axis"),
        ("  period: T - 2\n", (6, 11), "the period must be positive"),
        ("  period: t\n", (6, 11), "the time t cannot be used here"),
        ("expect:\n  - frozen: maybe\n", (7, 13), "'maybe'"),
        ("expect:\n  - redundant: -1\n", (7, 16), "expect[0].redundant"),
        ("expect:\n  - redundant: 1.5\n", (7, 16), "expect[0].redundant"),
        ("expect:\n  - coordinates: {b: {x: 1}}\n", (7, 19), "there is no body 'b'"),
        ("expect:\n  - coordinates: {a: {r: 1}}\n", (7, 23), "unknown key 'r'"),
        ("expect:\n  - coordinates: {a: {x: L}}\n", (7, 26), "unknown parameter 'L'"),
    ],
)
def test_mistakes_in_searches_and_expectations_are_placed(lines: str, place: tuple[int, int], message: str) -> None:
    head = SEARCH.replace("reference:\n", "reference: {}\n") if lines.startswith("expect") else SEARCH
    (problem,) = problems_of(head + lines)
    assert (problem.location.line, problem.location.column) == place
    assert message in str(problem)


def test_expectations_of_motions_are_read() -> None:
    text = (
        SEARCH
        + "  time: 0\nexpect:\n  - {frozen: true, redundant: 2, coordinates: {a: {x: Omega, psi: 1}}}\n"
        + "  - {neutral: 2}\n"
    )
    first, second = read(text).model.expect
    assert (first.frozen, first.redundant, sorted(first.coordinates)) == (True, 2, ["a.psi", "a.x"])
    assert (second.frozen, second.redundant, second.coordinates) == (False, None, {})
