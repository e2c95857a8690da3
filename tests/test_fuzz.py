"""Whatever is written in a model file, the answer is a scene or an error that says where the fault is.

Files are mutated, lose a part, or have one parameter moved. The mutated ones are the same in every run;
``MBSTAB_FUZZ_EXAMPLES=20000`` makes the search longer.
"""

from __future__ import annotations

import dataclasses
import functools
import math
import os
import random
import re
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from documents import documents
from every_pair import contradiction, everything, of_parameter
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from sampling import sample

import mbstab
from mbstab.errors import MbstabError, ModelFileError
from mbstab.model.reader import read_model_text
from mbstab.model.scene import Scene
from mbstab.model.values import evaluate

ROOT = Path(__file__).parents[1]
TEXTS = [p.read_text(encoding="utf-8") for d in ("models", "tests/scenes") for p in sorted((ROOT / d).glob("*.yaml"))]
LINES = sorted({line for text in TEXTS for line in text.splitlines()})
WORDS = sorted({word for text in TEXTS for word in re.findall(r"[\w.*/+()-]+", text)})
NUMBERS = [
    *("0", "-0", "-1", "1", "2.5", "010", "1e-3", "1e200", "1e-200", "5e-324", "1e308*10", "1e999", "1/0"),
    *("0**-1", "(-1)**0.5", "log(0)", "sqrt(-1)", "tan(pi/2)", "9**9**9", "atan2(0,0)", "2*3", "-pi", "30*deg"),
]
VALUES = [
    *("", "~", "null", "yes", "''", ".nan", "inf", "[]", "{}", "[[]]", "[0, 0]", "[0, 0, 0]", "[1, 2]"),
    *("[1, 2, 3]", "[x, y]", "[z, z]", "[ground, ground]", "[rod, disk]", "[list, box]", "[[1, 0], x]"),
    *("{a: b}", "{x: 1}", "ground", "x", "-y", "z", "t", "2*t", "L", "m", "2*g*L", "abs", "rate(t)"),
    *("rate(rod.x)", "rod.x", "list.psi", "ground.A", "a.b.c", "mm", "kg*m^2", "m^-2", "angle", "displacement"),
    *("rolling", "revolute", "spherical", "planar", "point", "__import__('os')", "x.__class__", "²", "٣", "é"),
]
JUNK = [
    *("-", "- ", ":", ": ", "?", "? ", "&a", "*a", "!!int", "<<", "---", "...", "|", ">", "#", "%", "@", "`", '"', "'"),
    *("\t", "\r", "\n", "\0", "\ufeff", "\x85", "\u2028", "\ud800", "\U0001f600", "[", "]", "{", "}", ","),
]

Draw = Callable[[st.SearchStrategy], Any]


def at_line(draw: Draw, text: str, change: Callable[[list[str], int], None]) -> str:
    lines = text.split("\n")
    change(lines, draw(st.integers(0, len(lines) - 1)))
    return "\n".join(lines)


def delete_line(draw: Draw, text: str) -> str:
    return at_line(draw, text, lambda lines, i: lines.pop(i))


def repeat_line(draw: Draw, text: str) -> str:
    return at_line(draw, text, lambda lines, i: lines.insert(i, lines[i]))


def replace_line(draw: Draw, text: str) -> str:
    return at_line(draw, text, lambda lines, i: lines.__setitem__(i, draw(st.sampled_from(LINES))))


def move_line(draw: Draw, text: str) -> str:
    return at_line(draw, text, lambda lines, i: lines.insert(draw(st.integers(0, len(lines) - 1)), lines.pop(i)))


def indent_line(draw: Draw, text: str) -> str:
    def change(lines: list[str], i: int) -> None:
        lines[i] = " " * draw(st.integers(0, 8)) + lines[i].lstrip()

    return at_line(draw, text, change)


def replace(draw: Draw, text: str, pattern: str, new: st.SearchStrategy[str]) -> str:
    found = list(re.finditer(pattern, text))
    if not found:
        return text
    match = draw(st.sampled_from(found))
    return text[: match.start()] + draw(new) + text[match.end() :]


def replace_number(draw: Draw, text: str) -> str:
    return replace(draw, text, r"(?<=[ \[])-?\d[\d.]*(?=[,\]}\n])", st.sampled_from(NUMBERS))


def replace_value(draw: Draw, text: str) -> str:
    new = st.sampled_from(VALUES) | st.sampled_from(WORDS)
    return replace(draw, text, r"(?<=: )([^\s{}\[\],]+|\[[^\[\]]*\]|\{[^{}]*\})(?=[,}\n])", new)


def replace_word(draw: Draw, text: str) -> str:
    return replace(draw, text, r"[\w.*/+()-]+", st.sampled_from(WORDS))


def insert_characters(draw: Draw, text: str) -> str:
    at = draw(st.integers(0, len(text)))
    return text[:at] + draw(st.text(min_size=1, max_size=4) | st.sampled_from(JUNK)) + text[at:]


def delete_characters(draw: Draw, text: str) -> str:
    at = draw(st.integers(0, len(text)))
    return text[:at] + text[at + draw(st.integers(1, 20)) :]


def cut_off(draw: Draw, text: str) -> str:
    return text[: draw(st.integers(0, len(text)))]


TEXTUAL = [replace_word, delete_line, repeat_line, replace_line, move_line, indent_line]
SPOILING = [insert_characters, delete_characters, cut_off]
# Half of the files differ in numbers only, so that most of them get as far as the numbers.
POOLS = [[replace_number], [replace_number], [replace_value, *TEXTUAL], [replace_value, *TEXTUAL, *SPOILING]]


@st.composite
def mutated_files(draw: Draw) -> str:
    text = draw(st.sampled_from(TEXTS))
    pool = draw(st.sampled_from(POOLS))
    for mutate in draw(st.lists(st.sampled_from(pool), min_size=1, max_size=3)):
        text = mutate(draw, text)
    return text


def require_clean(scene: Scene) -> None:
    """Every number of the scene is finite, also those of its elements."""
    numbers = [*scene.gravity, scene.time, *scene.parameters.values(), *scene.coordinates.values(), *scene.lengths]
    for body in scene.bodies:
        assert body.mass >= 0
        numbers += [body.mass, *body.inertia, *body.center, *body.base]
    for item in scene.items:
        for use in item.kind.build(item):
            numbers += use.parameters
    assert all(math.isfinite(x) for x in numbers)


def require_placed(error: MbstabError, text: str) -> None:
    """Every problem stands at a place that exists, and its line is shown."""
    assert isinstance(error, ModelFileError)
    lines = re.split(r"\r\n|\r|\n", text.removeprefix("\ufeff"))
    assert error.problems
    assert error.problems == sorted(error.problems, key=lambda problem: problem.location.order)
    for problem in error.problems:
        place = problem.location
        assert problem.message
        assert 1 <= place.line <= len(lines)
        assert 1 <= place.column <= len(lines[place.line - 1]) + 1
        assert problem.source == lines[place.line - 1]
        assert str(dataclasses.replace(problem, hint="")) in str(error)
        assert problem.hint in str(error)


@pytest.mark.parametrize("examples", sample([60, int(os.environ.get("MBSTAB_FUZZ_EXAMPLES", "300"))], 2))
def test_a_mutated_file_gives_a_scene_or_an_error_of_the_user_within_a_second(examples: int) -> None:
    drawn = settings(
        max_examples=examples,
        derandomize=True,
        deadline=None,
        database=None,
        suppress_health_check=list(HealthCheck),
    )
    drawn(given(mutated_files())(require_an_answer))()


def require_an_answer(text: str) -> None:
    started = time.process_time()
    problem = None
    try:
        scene = evaluate(read_model_text(text))
    except MbstabError as error:
        problem = error
    assert time.process_time() - started < 1.0
    if problem is None:
        require_clean(scene)
    else:
        require_placed(problem, text)


FILES = {
    "m.yaml": """\
mbstab: 1
gravity: [0, -9.81]
counts: {N: 3, M: N - 1}
parameters: {k: 9, r: {value: 0.5, unit: m}}
tables: {f: {file: data.csv, x: x, y: force}, g: {x: [0, 1, 2], y: [0, <N>, 1]}}
bodies: {base: {type: planar, mass: 1, inertia: 1, points: {A: [0, r]}}}
joints: {pin: {type: revolute, between: [base.A, ground]}}
repeat:
  - for: {i: [1, N], j: [1, <M>]}
    bodies: {"b<i>_<j>": {type: planar_point, mass: <i> + 0.1*<j>}}
    forces: {"f<i>_<j>": {type: expression, on: {"b<i>_<j>.x": "-k*b<i>_<j>.x", "b<i>_<j>.y": "-k*(b<i>_<j>.y + <i>)"}}}
include:
  - {file: part.yaml, prefix: left_, with: {body: base, m: 2*k, N: 2}}
  - {file: part.yaml, prefix: right_, with: {body: base}}
reference: {find: equilibrium, guess: {base: {y: -0.5}}}
""",
    "part.yaml": """\
needs: {body: a body}
counts: {N: 1}
parameters: {m: {value: 1, unit: kg, sign: positive}, c: {value: 0.25, unit: N*m*s/rad}}
tables: {h: {file: data.csv}}
bodies: {rod: {type: planar, mass: m, shape: {type: rod, length: 1}, points: {O: [-1/2, 0]}}}
joints: {pin: {type: revolute, between: [rod.O, body]}}
repeat: [{for: {i: [1, N]}, forces: {"t<i>": {type: joint_spring, joint: pin, damping: c*<i>}}}]
reference: {guess: {rod: {x: 0.5}}}
""",
    "data.csv": "x,force,other\n# comment\n0,0,1\n0.5,2,1\n1.5,2.5,0\n",
}
"""A file with repetitions, parts, counts, needs and tables in a file beside it."""


@st.composite
def mutated_sets(draw: Draw) -> dict[str, str]:
    files = dict(FILES)
    for mutate in draw(st.lists(st.sampled_from([replace_number, replace_value, *TEXTUAL, *SPOILING]), max_size=3)):
        name = draw(st.sampled_from(sorted(files)))
        files[name] = mutate(draw, files[name])
    return files


@pytest.mark.few(1)
@pytest.mark.parametrize("examples", sample([40, int(os.environ.get("MBSTAB_FUZZ_EXAMPLES", "200"))], 1))
def test_mutated_parts_give_a_scene_or_an_error_at_a_place_in_one_of_the_files(examples: int) -> None:
    drawn = settings(
        max_examples=examples,
        derandomize=True,
        deadline=None,
        database=None,
        suppress_health_check=list(HealthCheck),
    )
    drawn(given(mutated_sets())(require_an_answer_of_files))()


def require_an_answer_of_files(files: dict[str, str]) -> None:
    started = time.process_time()
    beside = {name: text for name, text in files.items() if name != "m.yaml"}
    problems = []
    try:
        require_clean(evaluate(read_model_text(files["m.yaml"], "m.yaml", beside)))
    except ModelFileError as error:
        problems = error.problems
    for problem in problems:
        lines = re.split(r"\r\n|\r|\n", files[problem.location.file].removeprefix("\ufeff"))
        assert 1 <= problem.location.line <= len(lines) + 1
    assert time.process_time() - started < 2.0


def test_the_texts_that_are_mutated_are_good() -> None:
    require_an_answer_of_files(FILES)
    assert "left_rod" in read_model_text(FILES["m.yaml"], "m.yaml", FILES).bodies
    for text in TEXTS:
        require_clean(evaluate(read_model_text(text)))


# --- shipped models from which one part is left out -------------------------------------------------------------------


SECTIONS = ("joints", "constraints", "contacts", "forces", "drives", "controllers", "motors", "states", "reference")

ONCE_WRONG = ("motorcycle", "joints", "front_axle")
"""A massless wheel that slides in a moving reference, tied to the state of its tyre."""


def parts():
    """Return model, section and name of everything that may be left out."""
    return [(model, s, name) for model, data in documents().items() for s in SECTIONS for name in data.get(s, {})]


@pytest.mark.parametrize(
    ("model", "section", "name"), sample([ONCE_WRONG, *(part for part in parts() if part != ONCE_WRONG)], 8)
)
def test_a_model_without_one_of_its_parts_is_answered_or_refused(model, section, name):
    data = {key: dict(value) if key == section else value for key, value in documents()[model].items()}
    del data[section][name]
    data.pop("expect", None)
    text = yaml.safe_dump(data, sort_keys=False)
    try:
        mbstab.loads(text).eig()
    except MbstabError as error:
        assert str(error)  # noqa: PT017 (an answer is as good)


# --- sweeps of any model over any parameter end in an answer or a message, and agree with `eig` -----------------------


SEED, PAIRS = 3, 12


@functools.cache
def drawn():
    """Return some models with one of their parameters each, and those whose inertia a steady motion knows."""
    pairs = [(path, name) for path, names in everything().items() for name in names]
    steady = [(path, name) for path, name in pairs if (path.stem, name) in (("bead_on_hoop", "R"), ("governor", "m_c"))]
    return [*random.Random(SEED).sample(pairs, PAIRS), *steady]


@pytest.mark.few(1)
@pytest.mark.parametrize("number", sample(range(PAIRS + 2), 8))
def test_a_sweep_of_any_model_agrees_with_eig_or_says_why_it_ends(number):
    path, name = drawn()[number]
    answers = list(of_parameter(path, name))
    assert [answer.fault for answer in answers if answer.traceback or answer.code not in (0, 1, 2, 3)] == []
    assert contradiction(answers[:2], answers[2]) == ""
