"""Every command block of the README is run; its commands, models and keys exist."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

import mbstab
from mbstab.analysis.linear.methods import METHODS
from mbstab.cli import main
from mbstab.cli.main import COMMANDS
from mbstab.model.library import installed_models

README = Path(__file__).parent.parent / "README.md"
TEXT = README.read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```(\w+)\n(.*?)^```$", TEXT, flags=re.M | re.S)
SHELL = [body.strip() for kind, body in BLOCKS if kind == "sh"]
NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e[-+]\d+)?(?![\w.])")
CONSOLE = [body for kind, body in BLOCKS if kind == "console"]


def test_two_commands_do_all_set_up():
    assert len(SHELL) == 2
    assert SHELL[0].startswith("python -m pip install . && mbstab eig ")
    assert SHELL[1] == "python -m pip install '.[test]' && python -m pytest -n auto --dist worksteal"


def test_the_first_command_installs_and_answers(tmp_path):
    # The installing half is what .ci/run and this very environment have done.
    command = SHELL[0].partition("&&")[2].strip()
    environment = {**os.environ, "PYTHONPATH": str(Path(mbstab.__file__).parent.parent)}
    words = [sys.executable, "-m", *shlex.split(command)]
    run = subprocess.run(words, capture_output=True, text=True, cwd=tmp_path, env=environment)
    assert run.returncode == 0
    assert "Verdict: stable" in run.stdout
    assert "pendulum.yaml" in run.stderr


@pytest.mark.parametrize("block", CONSOLE, ids=[block.splitlines()[0] for block in CONSOLE])
def test_a_console_block_shows_what_the_command_prints(block):
    first, _, expected = block.partition("\n")
    assert first.startswith("$ mbstab ")
    result = CliRunner().invoke(main, shlex.split(first)[2:])
    assert result.exit_code == 0
    assert NUMBER.sub("#", result.stdout) == NUMBER.sub("#", expected)
    for found, printed in zip(NUMBER.findall(result.stdout), NUMBER.findall(expected), strict=True):
        # Error bounds and residuals are round-off: their size is the machine's.
        assert float(found) == pytest.approx(float(printed), rel=1e-8, abs=1e-10)


INLINE = [" ".join(text.split()) for text in re.findall(r"`(mbstab [a-z]+ \w+\.yaml [^`]*)`", TEXT)]


@pytest.mark.parametrize("command", INLINE)
def test_a_command_within_the_text_runs(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(main, shlex.split(command)[1:])
    assert result.exit_code == 0
    for line in result.stderr.splitlines():
        if line.startswith("wrote "):
            assert (tmp_path / line.removeprefix("wrote ")).stat().st_size > 0
    if "simulate" in command:
        names = {"swing.csv", "swing-rod.theta.png", "swing-energy.png", "swing.gif"}
        assert {path.name for path in tmp_path.iterdir()} == names


def test_there_is_a_simulation_in_the_text():
    assert any(command.startswith("mbstab simulate ") for command in INLINE)


def test_the_model_in_the_readme_is_right(tmp_path):
    (text,) = [body for kind, body in BLOCKS if kind == "yaml"]
    assert len(text.splitlines()) <= 20
    own = mbstab.loads(text).eig()
    shipped = mbstab.load("pendulum.yaml").eig()
    assert [e.kind for e in own.eigenvalues] == ["center", "center"]
    assert mbstab.loads(text).motion().q == pytest.approx(mbstab.load("pendulum.yaml").motion().q, abs=1e-15)
    assert abs(own.eigenvalues[0].value - shipped.eigenvalues[0].value) < 1e-13 * abs(own.eigenvalues[0].value)


def test_every_command_is_in_the_readme_and_has_help():
    for name in COMMANDS:
        command = main.get_command(None, name)
        assert f"`mbstab {name}" in TEXT
        assert command.help
        undocumented = [p.name for p in command.params if isinstance(p, click.Option) and not p.help]
        assert undocumented == []


def test_every_method_is_in_the_readme_with_what_it_does():
    for name, method in METHODS.items():
        assert f"`{name}` ({method.description})" in TEXT


def test_every_example_is_in_the_readme():
    listed = set(re.findall(r"^\| `(\w+)\.yaml` \|", TEXT, flags=re.M))
    assert listed == {path.stem for path in installed_models()}


def test_the_readme_is_short():
    assert len(TEXT.splitlines()) < 400
