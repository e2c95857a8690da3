"""Files, streams, signals and processes as they should not be: a message each, and nothing lost."""

import os
import shlex
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from children import child, command_line, ended, until
from click.testing import CliRunner

import mbstab
from mbstab.cli import main
from mbstab.errors import ModelFileError
from mbstab.model.library import models_folder

PENDULUM = (models_folder() / "pendulum.yaml").read_text(encoding="utf-8")
PART = "bodies: {rod: {type: planar, mass: 1, shape: {type: rod, length: 1}}}\n"
WITH_PART = "mbstab: 1\ngravity: [0, -9.81]\ninclude: [{file: part.yaml, prefix: a_}]\n"
WITH_TABLE = "mbstab: 1\ntables: {f: {file: part.csv}}\nbodies: {p: {type: point, mass: 1}}\n"
TABLE = "x,y\n0,0\n1,1\n"


def run(*arguments, **options):
    return CliRunner().invoke(main, [str(x) for x in arguments], **options)


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "p.yaml").write_text(PENDULUM)
    return tmp_path


# --- files that are read are never written ----------------------------------------------------------------------------

COMMANDS = {
    "check": "--format table", "eig": "--format json", "energy": "--format json", "equilibrium": "--format json",
    "linearize": "--format json", "simulate": "--to 1 --format json", "test": "--format json",
    "compare": "--format json", "response": "--format json", "sweep": "--param m --from 1 --to 2 --format json",
    "design": "--vary m=1..2 --goal decay --format json",
}  # fmt: skip


@pytest.mark.parametrize("wrong", ["nonsense: 1\n", "bodies: [\n", "parameters: {m: 1}\nforces: {f: {type: spring}}\n"])
@pytest.mark.parametrize("command", COMMANDS)
def test_an_answer_never_replaces_a_part_of_a_wrong_model(command, wrong, here):
    for text, name, content in ((WITH_PART, "part.yaml", PART), (WITH_TABLE, "part.csv", TABLE)):
        (here / name).write_text(content)
        (here / "wrong.yaml").write_text(text + wrong)
        files = ["wrong.yaml", "p.yaml"] if command in ("eig", "test") else ["wrong.yaml"]
        result = run(command, *files, *shlex.split(COMMANDS[command]), "-o", name)
        assert result.exit_code == 2
        assert (here / name).read_text() == content


def test_several_models_do_not_replace_what_one_of_them_reads(here):
    (here / "part.csv").write_text("x,y\n0,0\nwrong\n")
    (here / "wrong.yaml").write_text(WITH_TABLE)
    result = run("eig", "p.yaml", "wrong.yaml", "-o", "part.csv")
    assert result.exit_code == 2
    assert "--output would overwrite part.csv, which is read" in result.stderr
    assert (here / "part.csv").read_text() == "x,y\n0,0\nwrong\n"


def test_a_part_that_another_count_reads_is_kept_apart(here):
    text = "mbstab: 1\ncounts: {N: 1}\ninclude: [{file: part<N>.yaml}]\n"
    (here / "m.yaml").write_text(text.replace("part<N>.yaml", '"part<N>.yaml"'))
    for n in (1, 2):
        (here / f"part{n}.yaml").write_text(PART)
    result = run("check", "m.yaml", "--set", "N=2", "--format", "json", "-o", "part2.yaml")
    assert "would overwrite part2.yaml" in result.stderr
    assert (here / "part2.yaml").read_text() == PART


# --- names and kinds of files -----------------------------------------------------------------------------------------


def test_a_file_that_is_write_protected_is_not_replaced(here):
    out = here / "a.csv"
    out.write_text("mine")
    out.chmod(0o444)
    result = run("eig", "p.yaml", "-o", out)
    assert (result.exit_code, out.read_text()) == (2, "mine")
    assert "it is write-protected" in result.stderr


@pytest.mark.parametrize("output", ["loop.csv", "n" * 300 + ".csv", "p.yaml/a.csv"])
def test_a_place_where_nothing_can_be_written_is_named(output, here):
    (here / "loop.csv").symlink_to("loop.csv")
    result = run("eig", "p.yaml", "-o", output)
    assert result.exit_code == 2
    assert "cannot be written" in result.stderr


def test_the_longest_name_that_the_system_takes_is_written(here):
    name = "n" * 251 + ".csv"
    assert run("eig", "p.yaml", "-o", name).exit_code == 0
    assert sorted(x.name for x in here.iterdir()) == sorted([name, "p.yaml"])


def test_a_working_directory_that_is_gone_gives_a_message(here):
    (here / "gone").mkdir()
    command = f"cd gone && rmdir ../gone && {shlex.join(command_line('eig', here / 'p.yaml', '-o', 'a.csv'))}"
    found = subprocess.run(command, shell=True, capture_output=True, text=True, cwd=here)
    assert found.returncode == 2
    assert "a.csv: cannot be written" in found.stderr
    assert "Traceback" not in found.stderr


def test_a_file_beside_a_model_is_a_file_in_its_folder(here):
    os.mkfifo(here / "part.csv")
    (here / "m.yaml").write_text(WITH_TABLE)
    with pytest.raises(ModelFileError, match=r"part\.csv: is not a file"):
        mbstab.load(here / "m.yaml")
    (here / "part.csv").unlink()
    (here / "part.csv").symlink_to("/etc/hostname")
    with pytest.raises(ModelFileError, match=r"part\.csv: is a link to a file outside the folder"):
        mbstab.load(here / "m.yaml")
    (here / "part.csv").unlink()
    (here / "part.csv").symlink_to("part.csv")
    with pytest.raises(ModelFileError, match=r"part\.csv: cannot be read"):
        mbstab.load(here / "m.yaml")
    (here / "part.csv").unlink()
    (here / "real.csv").write_text(TABLE)
    (here / "part.csv").symlink_to("real.csv")
    (here / "elsewhere").mkdir()
    (here / "elsewhere" / "m.yaml").symlink_to(here / "m.yaml")
    (here / "elsewhere" / "part.csv").symlink_to(here / "real.csv")
    for place in (here, here / "elsewhere"):
        assert mbstab.load(place / "m.yaml").model.tables["f"].file == "part.csv"


def test_a_model_whose_name_begins_with_a_hyphen_is_told_apart_from_an_option(here, monkeypatch):
    (here / "-x.yaml").write_text(PENDULUM)
    monkeypatch.setattr(sys, "argv", ["mbstab", "eig", "-x.yaml"])
    result = run("eig", "-x.yaml")
    assert (result.exit_code, "hint: the file of that name is ./-x.yaml" in result.stderr) == (2, True)
    assert run("eig", "./-x.yaml").exit_code == 0


def test_models_with_one_name_have_no_common_page(here):
    pytest.importorskip("markdown_it")
    for folder in ("a", "b"):
        (here / folder).mkdir()
        (here / folder / "m.yaml").write_text(PENDULUM)
    result = run("manual", "--html", "site", "a/m.yaml", "b/m.yaml")
    assert result.exit_code == 2
    assert "a/m.yaml and b/m.yaml would have the same page" in result.stderr
    assert not (here / "site").exists()


# --- texts that are long, or no numbers -------------------------------------------------------------------------------


def seconds(call):
    started = time.process_time()
    call()
    return time.process_time() - started


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (f"tables: {{f: {{x: [0, {'1' * 200_000}x], y: [0, 1]}}}}\n", "at most 100 characters, this one has 200001"),
        (
            f'repeat: [{{for: {{i: [1, 60000]}}, parameters: {{"p<i>": "<i>{"+1" * 4000}"}}}}]\n',
            "the file has more than 20000000 characters",
        ),
        ("counts: {N: 1or 2}\n", "'1or 2' is not a whole number"),
        ("counts: {N: 0o17}\n", "'0o17' is not a whole number"),
        (f"counts: {{N: {'a' * 100_000}!}}\n", "is not a whole number"),
        (f'parameters: {{a: "1 m{" " * 100_000}x"}}\n', "a"),
    ],
    ids=["table", "repeat", "1or 2", "0o17", "long index", "blanks"],
)
@pytest.mark.filterwarnings("error")
def test_what_is_too_long_or_no_number_is_refused_at_once(text, said):
    def read():
        with pytest.raises(ModelFileError, match=said):
            mbstab.loads(f"mbstab: 1\n{text}bodies: {{p: {{type: point, mass: 1}}}}\n")

    assert seconds(read) < 2.0


def test_a_part_with_a_need_and_a_name_of_its_own_that_are_one_is_refused(here):
    (here / "part.yaml").write_text("needs: {r: a body}\nparameters: {r: 0.5}\n")
    (here / "m.yaml").write_text(
        "mbstab: 1\nbodies: {base: {type: point, mass: 1}}\n"
        "include: [{file: part.yaml, prefix: left_, with: {r: base}}]\n"
    )
    with pytest.raises(ModelFileError, match=r"part\.yaml:1:9: needs: the part has 'r' itself"):
        mbstab.load(here / "m.yaml")


PINNED = """\
mbstab: 1
gravity: [0, -9.81]
bodies:
  rod: {type: planar, mass: 1, inertia: 0.1, points: {O: [-0.5, 0]}}
  pin: {type: planar_point, mass: 1}
joints:
  pivot: {type: revolute, between: [rod.O, ground]}
  held: {type: revolute, between: [pin, {body: ground, point: [1, 0]}]}
inputs: {push: {type: torque, body: rod}}
outputs: {still: angle(held), turn: angle(pivot)}
reference: {coordinates: {rod: {theta: -pi/2}, pin: {x: 1, y: 0}}}
"""


def test_the_angle_of_a_point_that_is_held_does_not_change():
    model = mbstab.loads(PINNED)
    C = model.state_space().C
    assert np.max(np.abs(C[0])) == 0.0
    assert np.max(np.abs(C[1])) > 0.1
    run = model.simulate(0.1, points=3, perturb={"rod.theta": 0.1})
    assert len(run.times) == 3


def test_a_driven_scene_with_a_period_has_nothing_to_judge():
    text = (
        "mbstab: 1\nbodies: {rod: {type: planar, mass: 1, inertia: 1, points: {O: [-1, 0]}}}\n"
        "joints: {p: {type: revolute, between: [rod.O, ground]}}\n"
        'drives: {s: {type: joint, joint: p, position: "0.1*sin(t)"}}\n'
        "reference: {coordinates: {rod: {theta: 0}}, period: 2*pi}\n"
    )
    (reason,) = mbstab.loads(text).eig().reasons
    assert "leave no degree of freedom" in reason


# --- pictures, parts, streams, signals --------------------------------------------------------------------------------


def test_a_dollar_in_a_description_begins_no_formula(here):
    text = PENDULUM.replace("description: half length", r"description: 'length $\unknown$'")
    assert text != PENDULUM
    (here / "p.yaml").write_text(text)
    result = run("sweep", "p.yaml", "--param", "L", "--from", "0.1", "--to", "0.2", "--points", "3", "--plot", "map")
    assert result.exit_code == 0, result.output


def test_parts_are_gone_once_the_answer_is_written_whatever_fails_afterwards(here, monkeypatch):
    def broken(*_):
        raise RuntimeError

    monkeypatch.setattr("mbstab.report.pictures.stability_map.stability_map", broken)
    sweep = ("sweep", "p.yaml", "--param", "L", "--from", "0.1", "--to", "0.2", "--points", "3", "-o", "a.csv")
    assert isinstance(run(*sweep, "--plot", "map").exception, RuntimeError)
    assert sorted(x.name for x in here.iterdir()) == ["a.csv", "p.yaml"]
    assert run(*sweep, "--plot", "none").exit_code == 0


@pytest.mark.parametrize("streams", ["2>&-", "2>/dev/full", "2>&- <&-"])
def test_an_answer_does_not_depend_on_where_messages_go(streams, here):
    command = f"{shlex.join(command_line('eig', 'pendulum', '-o', '-'))} {streams}"
    found = subprocess.run(command, shell=True, stdout=subprocess.PIPE, text=True, cwd=here)
    assert found.returncode == 0
    assert "0 ± 6.06526998" in found.stdout


def test_a_model_from_a_closed_stdin_is_refused(here):
    command = f"{shlex.join(command_line('eig', '-'))} <&-"
    found = subprocess.run(command, shell=True, capture_output=True, text=True, cwd=here)
    assert found.returncode == 2
    assert "stdin cannot be read: it is closed" in found.stderr


def test_the_end_of_the_terminal_ends_a_command_in_order(here):
    options = ("--param", "L", "--from", "0.1", "--to", "0.2", "--points", "1000000", "--plot", "none", "-o", "a.csv")
    with child(command_line("sweep", "p.yaml", *options), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE) as process:
        until(lambda: any((here / "a.csv.parts").glob("block-*")), process, 60.0)
        process.send_signal(signal.SIGHUP)
        said = process.communicate()[1]
    assert process.returncode == 128 + signal.SIGHUP
    assert "go on with --resume" in said


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs processes")
def test_a_worker_ends_with_the_process_that_has_started_it(here):
    code = (
        "import multiprocessing, os, sys, time\n"
        "from mbstab.analysis.sweep.jobs import _end_with_parent\n"
        "def work():\n    _end_with_parent()\n    print(os.getpid(), flush=True)\n    time.sleep(60)\n"
        "if __name__ == '__main__':\n"
        "    multiprocessing.get_context('spawn').Process(target=work).start()\n    time.sleep(60)\n"
    )
    (here / "parent.py").write_text(code)
    with child([sys.executable, "parent.py"], stdout=subprocess.PIPE, cwd=here) as process:
        worker = int(process.stdout.readline())
        process.kill()
        assert ended(worker, 20.0)
