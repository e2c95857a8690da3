"""Every command block of the README is run; its commands, models and links exist."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import click
import make_pictures
import pytest
from blocks import blocks, run, sessions

import mbstab
from mbstab.cli import main
from mbstab.cli.handbook.pages import WRITTEN
from mbstab.cli.main import COMMANDS
from mbstab.model.library import installed_models

README = Path(__file__).parent.parent / "README.md"
TEXT = README.read_text(encoding="utf-8")
SHELL = [body.strip() for kind, body in blocks(TEXT) if kind == "sh"]
CONSOLE = [session for kind, body in blocks(TEXT) if kind == "console" for session in sessions(body)]
SMALL = 150_000
"""Bytes of a picture at most."""


def test_two_commands_do_all_set_up():
    assert len(SHELL) == 2
    assert SHELL[0].startswith("python -m pip install . && mbstab eig ")
    assert SHELL[1] == "python -m pip install '.[test]' && python -m pytest -n auto --dist worksteal"


def test_the_first_command_installs_and_answers(tmp_path):
    # The installing half is what .ci/run and this very environment have done.
    command = SHELL[0].partition("&&")[2].strip()
    environment = {**os.environ, "PYTHONPATH": str(Path(mbstab.__file__).parent.parent)}
    words = [sys.executable, "-m", *shlex.split(command)]
    answer = subprocess.run(words, capture_output=True, text=True, cwd=tmp_path, env=environment)
    assert answer.returncode == 0
    assert "Verdict: stable" in answer.stdout
    assert "pendulum.yaml" in answer.stderr


@pytest.mark.table
@pytest.mark.parametrize(("line", "printed"), CONSOLE, ids=[line for line, _ in CONSOLE])
def test_a_console_block_shows_what_the_command_prints(line, printed):
    assert printed
    run(line, printed)


INLINE = [" ".join(text.split()) for text in re.findall(r"`(mbstab [a-z]+ \w+\.yaml [^`]*)`", TEXT)]


@pytest.mark.table
@pytest.mark.parametrize("command", INLINE)
def test_a_command_within_the_text_runs(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run(command)


def test_what_is_claimed_of_the_commands_in_the_text_is_so():
    bicycle = mbstab.load("whipple_bicycle.yaml").eig(v=5)
    assert bicycle.verdict == "asymptotically stable up to symmetry"
    assert bicycle.modulo.family == ("speed",)
    assert sum("whipple_bicycle" in command for command in INLINE) == 1
    governor = mbstab.load("governor_paper.yaml")
    for number, frozen in (("12.762", True), ("12.182", False)):
        assert f"{max(e.value.imag for e in governor.eig(frozen=frozen).eigenvalues):.3f}" == number
        assert number in TEXT
    assert f"{len(installed_models())} examples" in TEXT


def test_the_model_in_the_readme_is_right():
    (text,) = [body for kind, body in blocks(TEXT) if kind == "yaml"]
    assert len(text.splitlines()) <= 20
    own = mbstab.loads(text).eig()
    shipped = mbstab.load("pendulum.yaml").eig()
    assert [e.kind for e in own.eigenvalues] == ["center", "center"]
    assert mbstab.loads(text).motion().q == pytest.approx(mbstab.load("pendulum.yaml").motion().q, abs=1e-15)
    assert abs(own.eigenvalues[0].value - shipped.eigenvalues[0].value) < 1e-13 * abs(own.eigenvalues[0].value)


def test_every_command_is_in_the_readme_and_has_help():
    for name in COMMANDS:
        command = main.get_command(None, name)
        assert re.search(rf"`(mbstab )?{name}`", TEXT)
        assert command.help
        undocumented = [p.name for p in command.params if isinstance(p, click.Option) and not p.help]
        assert undocumented == []


def test_links_and_pictures_exist_and_pictures_are_small():
    links = re.findall(r"\]\(([^)]+)\)", TEXT)
    assert links
    pictures = re.findall(r'<img\s+src="([^"]+)"', TEXT)
    assert {Path(picture).name for picture in pictures} == make_pictures.PICTURES.keys()
    for target in (*links, *pictures):
        assert (README.parent / target).is_file(), target
    assert max((README.parent / picture).stat().st_size for picture in pictures) < SMALL


@pytest.mark.long
def test_the_pictures_are_made_by_their_commands(tmp_path):
    make_pictures.make(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == make_pictures.PICTURES.keys()


def test_every_page_of_the_manual_is_linked():
    assert {Path(link).stem for link in re.findall(r"\]\((mbstab/manual/[^)]+\.md)\)", TEXT)} == {*WRITTEN}


def test_the_readme_is_short():
    assert len(TEXT.splitlines()) < 120
