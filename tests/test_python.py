"""The interface in Python: a method for what each command answers, and results that print as the commands do."""

import doctest
import importlib
import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import mbstab
from mbstab.analysis.algebra import threads
from mbstab.analysis.spectrum.eigenvalues import answer
from mbstab.api import mechanism
from mbstab.cli import main
from mbstab.cli.main import COMMANDS
from mbstab.errors import MbstabError
from mbstab.model.library import starts_folder

PAGE = (Path(mbstab.__file__).parent / "manual" / "python.md").read_text(encoding="utf-8")
LOOP = """\
mbstab: 1
title: A mass with a motor
parameters: {k: {value: 9, unit: N/m}, T: {value: 5, unit: ms}, m: {value: 1000, unit: g}}
bodies: {p: {type: planar, mass: m, inertia: 1}}
forces: {f: {type: expression, on: {p.x: -k*p.x - u}}}
states: {u: {rate: (2*rate(p.x) - u)/T}}
inputs: {push: {type: force, at: p, direction: [1, 0]}}
outputs: {x: p.x, v: rate(p.x)}
"""


def test_the_page_names_methods_that_exist_for_all_commands_that_answer():
    rows = [line.split("|")[1:3] for line in PAGE.splitlines() if line.startswith("| `")]
    commands = [x for left, _ in rows for x in re.findall(r"`(\w+)`", left)]
    assert sorted(commands) == sorted(set(COMMANDS) - {"manual", "models", "new", "schema"})
    methods = [x for _, right in rows for x in re.findall(r"`(\w+)`", right)]
    assert [x for x in methods if not callable(getattr(mbstab.Mechanism, x, None))] == []


# What has other arguments in Python; the text of the command is that of the printed result.
QUESTIONS = {
    ("eig",): lambda m: m.eig(),
    ("eig", "--precision", "20"): lambda m: m.eig_precise(20),
    ("eig", "--verify"): lambda m: m.verify(),
    ("eig", "--sensitivity"): lambda m: m.sensitivities(),
    ("check",): lambda m: m.check(),
    ("equilibrium",): lambda m: m.equilibria()[0],
    ("energy",): lambda m: m.energies(),
    ("linearize",): lambda m: m.state_space().linear,
    ("linearize", "--form", "state-space"): lambda m: m.state_space(),
    ("response",): lambda m: m.response(),
    ("response", "--input", "push", "--measured", "v", "--step", "2"): lambda m: m.response(["push"], ["v"], step=2.0),
    ("sweep", "--param", "T", "--from", "1", "--to", "9", "--points", "5", "--plot", "none"):
        lambda m: m.sweep("T", np.linspace(1.0, 9.0, 5)),
    ("sweep", "--param", "T", "--param", "k", "--from", "1,2", "--to", "9,4", "--points", "3,3", "--plot", "none"):
        lambda m: m.chart({"T": np.linspace(1.0, 9.0, 3), "k": np.linspace(2.0, 4.0, 3)}),
    ("design", "--vary", "k=1..20", "--goal", "decay"): lambda m: m.design({"k": (1.0, 20.0)}, "decay"),
}  # fmt: skip


@pytest.mark.few(2)
@pytest.mark.parametrize("arguments", QUESTIONS, ids=" ".join)
def test_printed_results_are_the_text_of_the_command(arguments, tmp_path):
    path = tmp_path / "m.yaml"
    path.write_text(LOOP, encoding="utf-8")
    command = CliRunner().invoke(main, [arguments[0], str(path), *arguments[1:]])
    found = QUESTIONS[arguments](mbstab.load(path))
    timeless = [re.sub(r"[\d.]+ s\b", "", text).split() for text in (str(found), command.stdout)]
    assert timeless[0] == timeless[1]


class Notebook(list):
    """What IPython gives to results: a list of the texts that it shows."""

    text = list.append


def test_a_notebook_shows_what_the_command_prints():
    model = mbstab.loads(LOOP)
    for found in (model.eig(), model.modes(1), *model.equilibria()):
        shown = Notebook()
        found._repr_pretty_(shown, False)
        assert shown == [str(found)]
        assert shown[0].startswith("A mass with a motor\n\n")


def test_the_text_of_a_mechanism_is_short():
    model = mbstab.loads(LOOP)
    assert repr(model) == "<Mechanism 'A mass with a motor'; bodies: p; parameters: k = 9 N/m, T = 5 ms, m = 1000 g>"
    assert "T = 7" in repr(model.at(T=7))
    assert len(repr(mbstab.load("andrews_squeezer.yaml"))) < 1000


@pytest.mark.parametrize(("values", "si"), [([5, 6], False), (["5 ms", "6"], False), ([0.005, 0.006], True)])
def test_swept_values_count_as_keywords_do_in_the_declared_unit(values, si):
    model = mbstab.loads(LOOP)
    swept = model.sweep("T", values, si=si).branches[1]
    alone = np.array([e.value for e in model.eig(T=6).eigenvalues if not e.exact])
    assert np.sort_complex(alone) == pytest.approx(np.sort_complex(swept), rel=1e-9)


@pytest.mark.parametrize(
    ("keywords", "told"),
    [
        ({"step": 1.0, "impulse": 1.0}, "exclude each other"),
        ({"step": -1.0}, "give a positive time"),
        ({"step": 1.0, "ends": (1.0, 2.0)}, "are frequencies"),
        ({"inputs": ["pull"]}, "pull"),
        ({"points": 1}, "points=1"),
    ],
)
def test_responses_refuse_arguments_that_contradict_each_other(keywords, told):
    with pytest.raises(MbstabError, match=told):
        mbstab.loads(LOOP).response(**keywords)


def test_a_rotor_answers_to_an_unbalance_as_the_command_says():
    path = str(starts_folder() / "rotor.yaml")
    arguments = ["--unbalance", "disk", "--speed", "omega", "--from", "120", "--to", "180", "--points", "3"]
    command = CliRunner().invoke(main, ["response", path, *arguments])
    model = mbstab.load(path)
    found = model.unbalance("disk", "omega", [120, 150, 180])
    assert str(found).split() == command.stdout.split()


# --- examples in docstrings -------------------------------------------------------------------------------------------


SHOWN = [path for path in Path(mbstab.__file__).parent.rglob("*.py") if ">>> " in path.read_text(encoding="utf-8")]


@pytest.mark.table
@pytest.mark.parametrize("path", SHOWN, ids=lambda path: path.stem)
def test_examples_in_docstrings_print_what_they_show(path):
    name = ".".join(path.relative_to(Path(mbstab.__file__).parents[1]).with_suffix("").parts)
    found = doctest.testmod(importlib.import_module(name.removesuffix(".__init__")))
    assert found.attempted
    assert not found.failed


def test_a_sweep_without_values_takes_the_block_of_the_file():
    model = mbstab.loads(LOOP + "sweep: {T: {from: 1, to: 9, points: 3}}\n")
    assert model.sweep("T").values.tolist() == pytest.approx([0.001, 0.005, 0.009])
    with pytest.raises(MbstabError, match="has no sweep: block for k\nhint: give its values"):
        model.sweep("k")


def test_a_name_alone_is_one_input_or_output():
    model = mbstab.loads(LOOP)
    one, listed = model.response("push", "v", points=3), model.response(["push"], ["v"], points=3)
    assert str(one) == str(listed)


def test_questions_take_one_thread_and_leave_the_setting_as_it_was(monkeypatch):
    settings = threads._settings()
    if not settings:
        pytest.skip("NumPy has another library than OpenBLAS here")
    (get, change), model, inside = settings[0], mbstab.load("pendulum.yaml"), []
    before = get()
    monkeypatch.setattr(mechanism, "answer", lambda *given: inside.append(get()) or answer(*given))
    try:
        change(2)
        assert model.eig().verdict == "stable"
        assert inside == [1]
        assert get() == 2
        with pytest.raises(MbstabError):
            model.eig(L=-1)
        # Of two questions in threads that overlap the last one sets it.
        first, second = threads.one_thread(), threads.one_thread()
        first.__enter__()
        second.__enter__()
        first.__exit__(None, None, None)
        assert get() == 1
        second.__exit__(None, None, None)
        assert get() == 2
    finally:
        change(before)
