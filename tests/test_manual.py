"""The manual: all its blocks run, all that the program knows is found in it, and it fits a terminal of 80 columns."""

import ast
import re
import tomllib
from pathlib import Path

import click
import pytest
import yaml
from blocks import blocks, read, run, sessions
from click.testing import CliRunner

from mbstab.analysis.linear.methods import METHODS
from mbstab.analysis.proof.critical_values import LOCATED
from mbstab.analysis.sweep.critical_slopes import WITHOUT
from mbstab.analysis.verdict.rule import Disc
from mbstab.analysis.verdict.wording import unplaced
from mbstab.cli import main
from mbstab.cli.handbook.lookup import found_places, places
from mbstab.cli.handbook.pages import FOLDER, TOPICS, WRITTEN, page
from mbstab.cli.main import COMMANDS
from mbstab.errors import UsageError
from mbstab.mechanics.elements import KINDS
from mbstab.model.functions import FUNCTIONS
from mbstab.model.keys import EXPLAINED, SECTIONS
from mbstab.model.library import installed_models
from mbstab.model.words import WORDS

ROOT = Path(__file__).parents[1]
PAGES = {topic: page(topic, main) for topic in TOPICS}


def said(*words):
    return CliRunner().invoke(main, ["manual", *words])


@pytest.mark.table
@pytest.mark.parametrize("topic", WRITTEN)
def test_the_blocks_of_a_page_run_in_their_order(topic, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for kind, text in blocks(PAGES[topic]):
        if kind == "console":
            for line, printed in sessions(text):
                if "--animate" not in line:  # below
                    run(line, printed)
        elif kind == "yaml":
            found = read(text, tmp_path)
            assert found is None or found.verdict
        else:
            assert kind in ("text", "pycon"), "blocks that are run, and listings; pycon is run by doctest"


def test_what_a_simulation_writes_is_there(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (line,) = re.findall(r"^\$ (mbstab simulate .*)$", PAGES["how-to"], flags=re.M)
    run(line)
    names = {"swing.csv", "swing-rod.theta.png", "swing-energy.png", "swing.gif"}
    assert {path.name for path in tmp_path.iterdir() if path.stat().st_size} == names


def test_each_lesson_has_a_model_with_its_solution():
    lessons = PAGES["teaching"].split("\n## Lesson ")[1:]
    assert len(lessons) == 5
    assert all("\nexpect:\n" in lesson and "\n$ mbstab test " in lesson for lesson in lessons)


def test_the_cheat_sheet_has_every_section_and_command():
    listed = {
        word
        for row in re.findall(r"^\| (`.*?) \|", PAGES["cheat-sheet"], flags=re.M)
        for word in re.findall(r"`(\w+)`", row)
    }
    assert {*SECTIONS, *COMMANDS} <= listed


def test_the_tutorial_and_the_how_to_are_commands_to_type():
    for topic in ("tutorial", "cheat-sheet", "how-to", "verdicts"):
        assert sum(len(sessions(text)) for kind, text in blocks(PAGES[topic]) if kind == "console") > 5


def test_every_page_is_a_topic_and_listed():
    assert {path.stem for path in FOLDER.glob("*.md")} == set(WRITTEN)
    listed = said().stdout
    for topic, text in PAGES.items():
        assert re.search(rf"^  {topic} +{re.escape(text.splitlines()[0][2:])}$", listed, flags=re.M)


@pytest.mark.table
@pytest.mark.parametrize("topic", TOPICS)
def test_a_page_is_plain_text_of_80_columns_when_piped(topic):
    answer = said(topic)
    assert answer.exit_code == 0
    assert "\x1b" not in answer.stdout
    text = re.sub(r"^\$ .*$|^```(yaml|pycon)\n.*?^```$", "", answer.stdout, flags=re.M | re.S)  # typed as they stand
    assert [line for line in text.splitlines() if len(line) > 80 and " " in line.strip()] == []


def test_a_long_page_begins_with_an_index():
    for topic, text in PAGES.items():
        heads = [head.replace("`", "") for head in re.findall(r"^## (.*)$", text, flags=re.M)]
        index = re.findall(r"^# .*\n\n(On this page: (?:.+\n)+)", said(topic).stdout)
        expected = [" ".join(["On this page:", " · ".join(heads)]).split()] * (len(heads) > 12)
        assert [one.split() for one in index] == expected
    assert "On this page" not in said("--search", "page").stdout


def test_pages_are_set_with_colours_on_a_terminal(monkeypatch):
    from mbstab.cli.handbook.terminal import rendered

    monkeypatch.setenv("COLUMNS", "200")
    for topic in ("verdicts", "digits"):
        text = rendered(PAGES[topic])
        assert "\x1b[" in text
        plain = re.sub(r"\x1b\[[\d;]*m", "", text)
        assert max(map(len, plain.splitlines())) <= 80
        assert "| --- |" not in plain


def options(command):
    return [option for parameter in command.params if isinstance(parameter, click.Option) for option in parameter.opts]


def choices(command):
    return [
        x for parameter in command.params if isinstance(parameter.type, click.Choice) for x in parameter.type.choices
    ]


def every_word():
    """Yield what a search must find, with the beginning of a line of its answer."""
    for name in COMMANDS:
        command = main.get_command(None, name)
        for inner in command.commands.values() if isinstance(command, click.Group) else [command]:
            path = f"mbstab {name}" + (f" {inner.name}" if inner is not command else "")
            yield path, f"commands: {path}"
            for option in options(inner):
                yield f"{path} {option}", f"commands: {path}"
            for choice in choices(inner):
                yield f"{path} {choice}", f"commands: {path}"
    for name in SECTIONS:
        yield name, ""
    for fields in EXPLAINED.values():
        yield from ((field.name, "") for field in fields)
    for section, kinds in KINDS.items():
        for (name, _), kind in kinds.items():
            yield f"{section} {name}", f"keys: {section}"
            yield from ((f"{section} {field.name}", f"keys: {section}") for field in kind.fields)
    yield from ((name, "keys: ") for name in FUNCTIONS)
    yield from ((word, "verdicts: ") for word in WORDS)
    yield from ((kind, "theory: Critical values") for kind in (*LOCATED, *WITHOUT))
    yield from ((name, "how-to: ") for name in METHODS)


def test_every_command_option_key_and_verdict_is_found():
    every = [place for topic, text in PAGES.items() for place in places(topic, text)]
    missing = []
    for words, place in {*every_word()}:
        lines = [f"{found.topic}: {found.heading.replace('`', '')}" for found in found_places(every, words)]
        if not any(line.startswith(place) for line in lines):
            missing.append((words, place, lines))
    assert missing == []


ENGINEERS = {
    "control": (
        "anti-windup, bandwidth, controllability, crossover frequency, feedforward, gain scheduling, lead filter, "
        "LQG, LQR, MIMO, notch, observability, overshoot, PD control, sensor, PID tuning, pole "
        "placement, pole-zero map, rise time, root locus, settling time, stability "
        "margin, time constant, logarithmic decrement"
    ),
    "robots, rotors and vehicles": (
        "balancing, base excitation, Denavit, earthquake, flexible joint, harmonic drive, inverse dynamics, inverse "
        "kinematics, Jeffcott rotor, noise, oil whip, payload, resonance, SCARA, trajectory, understeer, suspension, "
        "rotating damping, journal bearing, overhung, quarter car, end effector, torsional vibration, flywheel, "
        "self-aligning torque, stability threshold, satellite, Segway, uneven road, "
        "caravan, hitch, jackknife, two-track, single-track, wheelbase, track width, toe angle, steering angle, "
        "anti-roll bar, series elastic, computed torque, gravity compensation, derailment, misalignment"
    ),
    "mechanics": (
        "backlash, Baumgarte, centre of gravity, center of mass, circulatory, Coriolis, Coulomb, eigenfrequency, "
        "finite element, gimbal lock, Grübler, hysteresis, impact, Kelvin-Voigt, Lagrange multiplier, Maxwell "
        "element, modal analysis, natural frequency, Newton-Euler, operating point, products of inertia, "
        "quaternion, nutation, precession, small oscillations, angular momentum, inertia tensor, Lagrangian, pulley, "
        "singularity, rolling without slipping, brake squeal, Rayleigh damping, stick-slip, Stribeck, virtual work"
    ),
    "nonlinear dynamics": (
        "chaos, hunting, Hurwitz, limit cycle, Lyapunov exponent, Mathieu, parametric resonance, phase portrait, "
        "Poincaré, poincare map, Routh, snaking"
    ),
    "numerical work": "CAD, Jupyter, Monte Carlo, notebook, optimization, Simulink, FMU, exercise, bug report",
}
"""What engineers type, by the heading of the glossary under which it is explained."""


@pytest.mark.parametrize(("field", "words"), [(f, word) for f, text in ENGINEERS.items() for word in text.split(", ")])
def test_the_words_of_engineers_are_explained_first(field, words):
    every = [place for topic, text in PAGES.items() for place in places(topic, text)]
    explained = [place for place in found_places(every, words) if place.explains(words.split())]
    assert f"From {field}" in {place.heading for place in explained}


@pytest.mark.parametrize(
    "words",
    ["riccati", "observer", "saturation", "dead time", "pade", "Padé", "sampling", "delay", "Hopf", "Nyquist", "Bode",
     "gyroscopic", "buckling", "Floquet", "transfer function", "Kalman filter", "singular values", "gears", "cite"],
)  # fmt: skip
def test_other_words_are_found(words):
    assert said("--search", *words.split()).exit_code == 0


def test_a_search_shows_what_explains_the_words_first():
    assert said("--search", "krein", "signature").stdout.startswith("glossary: ")
    first = said("--search", "--rightmost").stdout.splitlines()
    assert first[0] == "commands: mbstab eig"
    assert "largest real" in " ".join(first[1:4])
    assert all(len(line) <= 80 for line in said("--search", "eigenvalues").stdout.splitlines())
    assert "between" in said("--search", "torque between two bodies").stdout  # no piece holds all these words
    assert re.search(r"^  LQR, .*: not offered: ", said("--search", "pole", "placement").stdout, flags=re.M)
    assert re.search(r"^and \d+ more places: add a word$", said("--search", "eigenvalues").stdout, flags=re.M)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["tutorail"], "there is no topic 'tutorail'\nhint: did you mean 'tutorial'?"),
        (["zzz"], "hint: mbstab manual lists the topics; mbstab manual --search zzz looks inside"),
        (["--search", "eigenvalus"], "the manual has nothing about 'eigenvalus'\nhint: did you mean 'eigenvalues'?"),
        (["--search", "actuator", "saturation"], "hint: search for 'actuator' or 'saturation' alone"),
        (["--search", " "], "--search needs a word"),
        (["limits", "theory"], "one TOPIC at a time, not 'limits theory'\nhint: --search looks for words"),
    ],
)
def test_what_is_not_there_is_refused_with_a_hint(words, message):
    answer = said(*words)
    assert answer.exit_code == 2
    assert message in answer.stderr


REPORTS = ROOT / "mbstab" / "report"


def heads_of(name):
    """Yield the heads of the tables of an answer, without units."""
    for node in ast.walk(ast.parse((REPORTS / f"{name}.py").read_text(encoding="utf-8"))):
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "table":
            lists = node.args[:1]
        else:
            lists = [node.value] if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "heads" else []
        for x in (x for one in lists if isinstance(one, ast.List) for x in one.elts if isinstance(x, ast.Constant)):
            yield " ".join(re.sub(r"\(.*", "", x.value).split())


def test_every_column_and_every_word_of_the_output_is_explained():
    from mbstab.report.pictures.spectrum import MARKERS

    names = ("eigenvalues", "sweeps", "simulation", "responses", "designs", "modes", "verification")
    heads = {head for name in names for head in heads_of(name) if head}
    assert {"doubles or halves in s", "unstable eigenvalues", "error of gain", "best found"} < heads
    text = PAGES["reading-the-output"].replace("\n", " ")
    assert {head for head in heads if head not in text} == set()
    assert {word for word in (*LOCATED, *WITHOUT, *MARKERS, *BLANK) if word not in text} == set()


BLANK = ("stable node", "unstable focus", "saddle", "center", "½", "2×", "unknown", "no answer", "jump: ")


def test_the_reasons_that_are_explained_are_those_of_the_program():
    words = []
    for path in (ROOT / "mbstab" / "analysis").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            parts = node.values if isinstance(node, ast.JoinedStr) else [node]
            words.append(
                "".join(str(getattr(part, "value", "")) if isinstance(part, ast.Constant) else "…" for part in parts)
            )
    discs = (Disc(c, r, n, "open") for c in (0j, 1j) for r in (0.0, 1e-3, float("inf")) for n in (1, 2))
    known = "\n".join([*words, *map(unplaced, discs)])
    told = re.findall(r"^\| (.+?) \|", PAGES["why-undecided"], flags=re.M)
    pieces = {piece.strip(" ,:;()") for row in told for piece in re.split("…|; ", row)} - {
        "reason",
        "message",
        "verdict",
        "",
    }
    assert len(pieces) > 50
    assert {piece for piece in pieces if piece not in known} <= {*WORDS, "up to symmetry"}


def test_every_example_is_told():
    listed = set(re.findall(r"^\| `(\w+)\.yaml` \|", PAGES["examples"], flags=re.M))
    assert listed == {path.stem for path in installed_models()}


def test_every_method_is_told_with_what_it_does():
    text = " ".join(PAGES["how-to"].split())
    for name, method in METHODS.items():
        assert f"`{name}` ({method.description})" in text


def test_every_topic_that_is_told_of_exists():
    files = [path for end in ("py", "md", "yaml") for path in Path(FOLDER).parent.rglob(f"*.{end}")]
    told = set()
    for path in files:
        text = re.sub(r'"\s*\n\s*f?"', "", path.read_text(encoding="utf-8"))
        told |= {(name, path.name) for name in re.findall(r"mbstab manual\s+([a-z][\w-]*)", text)}
    assert len(told) > 10
    assert {place for place in told if place[0] not in {*TOPICS, "lists"}} == set()  # it lists the topics


def test_links_between_pages_and_models_exist():
    for topic, text in PAGES.items():
        for target in re.findall(r"\]\(([^)#]+)\)", text):
            assert target.startswith("https://") or (Path(FOLDER) / target).exists(), f"{topic} links to {target}"


CHANGES = re.split(r"^## ", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), flags=re.M)


@pytest.mark.parametrize("version", CHANGES[1:], ids=[text.partition("\n")[0] for text in CHANGES[1:]])
def test_the_changes_of_a_version_are_a_page_by_command(version):
    assert len(version.splitlines()) <= 40
    kinds, entries = re.findall(r"^### (\w+)$", version, flags=re.M), re.findall(r"^- (.+)$", version, flags=re.M)
    assert kinds == [kind for kind in ("Added", "Changed", "Fixed") if kind in kinds]
    first = {word for entry in entries for word in re.findall(r"^`([a-z]+)", entry)}
    assert len(first) >= 5
    assert first <= {*COMMANDS}


def test_the_versions_of_the_changelog_have_their_numbers():
    versions = [head.partition("]")[0].removeprefix("[") for head in CHANGES[1:]]
    heads = re.findall(r"^## (.*?): ", PAGES["changed-numbers"], flags=re.M)
    newest = next(x for x in versions if x != "Unreleased")
    assert set(heads) == {*versions} - {"Unreleased"} | ({f"After {newest}"} if "Unreleased" in versions else set())


def test_the_version_is_the_same_wherever_it_stands():
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    heads = re.findall(r"^## \[(.*?)\]", (ROOT / "CHANGELOG.md").read_text(), flags=re.M)
    assert next(x for x in heads if x != "Unreleased") == version
    assert yaml.safe_load((ROOT / "mbstab" / "CITATION.cff").read_text())["version"] == version
    assert f"version = {{{version}}}" in said("citing").stdout


@pytest.mark.parametrize(
    ("query", "word"),
    [
        ("rolling disc", "rolling disk"),
        ("sub-critical", "subcritical"),
        ("modeshape", "mode-shape"),
        ("tire", "tyre"),
        ("color", "colour"),
        ("centre", "center"),
        ("center of mass", "centre of mass"),
        ("Centered", "centred"),
        ("linearise", "linearize"),
        ("traveling", "travelling"),
        ("dashpot", "damper"),
        ("gears", "gear"),
        ("nonlinear", "non-linear"),
    ],
)
def test_a_search_finds_the_other_spelling(query, word):
    text = f"# Wheels\n\nThis says nothing.\n\nA {word} moves.\n"
    every = [*places("x", text), *places("glossary", PAGES["glossary"])]
    assert any(word in place.text for place in found_places(every, query))


def test_a_search_does_not_find_other_words():
    every = list(places("x", "This is for one wheel of an entire car, which is at rest."))
    for query in ("four", "tyre", "centre", "tire", "heel", "ar"):
        with pytest.raises(UsageError):
            found_places(every, query)
