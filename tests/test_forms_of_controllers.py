"""Whatever stands at a key of a controller, the answer is a model or an error at its place, never a traceback."""

import itertools

import pytest
from click.testing import CliRunner

import mbstab
from mbstab.cli import main
from mbstab.errors import ModelFileError
from mbstab.mechanics import controllers
from mbstab.model.reader import read_model_text
from mbstab.model.values import evaluate

HEAD = (
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
    return HEAD + f"forces: {{u: {{type: {kind}, {entry}}}}}\n"


def test_all_kinds_and_keys_are_asked():
    assert {name for name, _ in controllers.KINDS} == set(GOOD)
    for (name, _), kind in controllers.KINDS.items():
        keys = {field.name for field in kind.fields if not field.made} - {"motion", "coordinate"}
        assert keys == set(GOOD[name])
        mbstab.loads(written(name))


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
        (tmp_path / f"{name}.yaml").write_text(written("pid") + f"title: {name}\n")
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
