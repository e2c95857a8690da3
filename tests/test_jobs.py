"""Sweeps in blocks: the same bits however they are computed, interruptions, dying workers, full disks."""

import contextlib
import errno
import multiprocessing
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pytest
from children import child, command_line, until
from click.testing import CliRunner
from sampling import sample

import mbstab
from mbstab.analysis.sweep import blocks, jobs
from mbstab.analysis.sweep.tolerances import TOLERANCES as SWEEP_TOLERANCES
from mbstab.cli import main
from mbstab.errors import NumericalError, OutputError, UsageError

X = np.linspace(0.0, 10.0, 251)  # speeds of the bicycle
A = np.linspace(0.1, 0.9, 251)  # lengths of the shimmying wheel, whose sweep is several times as fast


@pytest.fixture
def small(monkeypatch):
    """Blocks of 42 points: six of them."""
    monkeypatch.setattr("mbstab.analysis.sweep.tolerances.Tolerances.block_points", 42)


@pytest.fixture(scope="module")
def bicycle():
    return mbstab.load("whipple_bicycle.yaml")


@pytest.fixture(scope="module")
def reference(bicycle):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("mbstab.analysis.sweep.tolerances.Tolerances.block_points", 42)
        return bicycle.sweep("v", X)


@pytest.fixture
def whole(reference, small):
    return reference


@pytest.fixture(scope="module")
def wheel():
    return mbstab.load("shimmy.yaml")


@pytest.fixture
def whole_wheel(wheel, small):
    return wheel.sweep("a", A)


def assert_same(one, other):
    assert one.values.tobytes() == other.values.tobytes()
    assert one.branches.tobytes() == other.branches.tobytes()
    assert np.array_equal(one.unstable, other.unstable)
    assert np.array_equal(one.words, other.words)
    assert (one.neutral, one.critical, one.meetings, one.problems) == (
        other.neutral, other.critical, other.meetings, other.problems
    )  # fmt: skip


class Interrupting:
    """Progress that presses Ctrl-C after some blocks."""

    def __init__(self, directory, after):
        self.directory, self.after = directory, after

    def __call__(self, done):
        if len(finished(self.directory)) >= self.after:
            raise KeyboardInterrupt


def finished(directory):
    return sorted(directory.glob("block-*.npz"))


# --- the same bits --------------------------------------------------------------------------------------------------


def test_blocks_say_the_same_as_one_piece(bicycle, whole, monkeypatch):
    monkeypatch.setattr("mbstab.analysis.sweep.tolerances.Tolerances.block_points", 25_000)
    one = bicycle.sweep("v", X)
    assert np.array_equal(one.unstable, whole.unstable)
    assert one.neutral == whole.neutral
    assert np.max(np.abs(one.branches - whole.branches) / np.abs(one.branches).max(axis=1)[:, None]) < 1e-9
    for a, b in zip(one.critical, whole.critical, strict=True):
        assert a.kind == b.kind
        assert abs(a.value - b.value) < 1e-11 * a.value


def test_blocks_of_large_scenes_have_fewer_points():
    # Some seconds of work each: no more is lost when a sweep is killed.
    links = range(20)
    text = "mbstab: 1\nparameters: {m: 1}\nbodies:\n" + "".join(
        f"  b{i}: {{type: planar, mass: m, inertia: 1}}\n" for i in links
    )
    small, large = mbstab.load("top.yaml").model, mbstab.loads(text).model
    x = np.linspace(1.0, 2.0, 9_000)
    assert [len(task.values["omega"]) for task in blocks.tasks(small, {"omega": x})] == [9_000]
    parts = [task.values["m"] for task in blocks.tasks(large, {"m": x})]
    assert len(parts) == 3
    assert np.array_equal(np.concatenate(parts), x)
    assert blocks.block_size(6) == SWEEP_TOLERANCES.block_points
    assert blocks.block_size(10_000) == SWEEP_TOLERANCES.block_points_least


def test_two_processes_give_the_same_bits(bicycle, whole):
    assert_same(whole, bicycle.sweep("v", X, jobs=2))


@pytest.mark.long
def test_equilibria_are_followed_the_same_in_two_processes(small):
    model, x = mbstab.load("bead_on_hoop.yaml"), np.linspace(0.0, 8.0, 101)
    assert_same(model.sweep("Omega", x), model.sweep("Omega", x, jobs=2))


@pytest.mark.parametrize("after", sample([4, 1, 6], 3))
def test_an_interrupted_sweep_goes_on_where_it_was(bicycle, whole, tmp_path, after):
    place = tmp_path / "v.parts"
    with pytest.raises(KeyboardInterrupt):
        bicycle.sweep("v", X, Interrupting(place, after), directory=place)
    kept = {path: path.stat().st_mtime_ns for path in finished(place)}
    assert len(kept) == after
    assert (place / "sweep.json").exists()
    computed = []
    compute = jobs.compute
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(jobs, "compute", lambda task, progress: computed.append(task) or compute(task, progress))
        result = bicycle.sweep("v", X, directory=place, resume=True)
    assert len(computed) == 6 - after
    assert_same(whole, result)
    assert not place.exists()


def test_a_sweep_that_was_begun_by_one_process_is_ended_by_two(wheel, whole_wheel, tmp_path):
    place = tmp_path / "a.parts"
    with pytest.raises(KeyboardInterrupt):
        wheel.sweep("a", A, Interrupting(place, 2), directory=place)
    assert_same(whole_wheel, wheel.sweep("a", A, directory=place, resume=True, jobs=2))
    assert not place.exists()


def test_a_directory_is_not_there_afterwards(wheel, whole_wheel, tmp_path):
    assert_same(whole_wheel, wheel.sweep("a", A, directory=tmp_path / "deep" / "a.parts"))
    assert list((tmp_path / "deep").iterdir()) == []


@pytest.mark.long
def test_a_descending_sweep_and_a_chart_are_resumed(wheel, small, tmp_path):
    place = tmp_path / "v.parts"
    with pytest.raises(KeyboardInterrupt):
        wheel.sweep("a", A[::-1].copy(), Interrupting(place, 3), directory=place)
    result = wheel.sweep("a", A[::-1].copy(), directory=place, resume=True)
    assert_same(wheel.sweep("a", A[::-1].copy()), result)
    disk = mbstab.load("rolling_disk.yaml")
    grid = {"omega": np.linspace(0.0, 8.0, 15), "R": np.linspace(0.1, 0.6, 7)}
    with pytest.raises(KeyboardInterrupt):
        disk.chart(grid, Interrupting(place, 2), directory=place)
    assert len(finished(place)) == 2
    one, other, two = disk.chart(grid), disk.chart(grid, directory=place, resume=True), disk.chart(grid, jobs=2)
    for found in (other, two):
        assert np.array_equal(found.unstable, one.unstable)
        assert [c.tobytes() for c in found.boundaries] == [c.tobytes() for c in one.boundaries]
    assert not place.exists()


def test_problems_keep_their_points_through_blocks(small, tmp_path):
    text = (
        "mbstab: 1\nparameters: {m: 1}\nbodies:\n  a: {type: planar_point, mass: m}\n"
        "constraints:\n  rail: {holonomic: a.y}\nforces:\n  spring: {type: expression, on: {a.x: -a.x}}\n"
        "reference:\n  coordinates:\n    a: {x: 0, y: 0}\n"
    )
    x = np.linspace(-1.0, 2.0, 190)
    place = tmp_path / "m.parts"
    with pytest.raises(KeyboardInterrupt):
        mbstab.loads(text).sweep("m", x, Interrupting(place, 2), directory=place)
    for result in (mbstab.loads(text).sweep("m", x, directory=place, resume=True), mbstab.loads(text).sweep("m", x)):
        assert set(result.problems) == set(np.flatnonzero(x <= 0.0))
        good = x > 0.0
        assert np.allclose(np.sort(result.branches.imag[good], axis=1)[:, 1], 1 / np.sqrt(x[good]), rtol=1e-12)


# --- killed ---------------------------------------------------------------------------------------------------------


COMMAND = """\
import sys
from mbstab.analysis.sweep.tolerances import Tolerances
from mbstab.cli import main
Tolerances.block_points = 300
main(sys.argv[1:])
"""


SWEEP = ("sweep", "whipple_bicycle.yaml", "--param", "v", "--plot", "none")


def command(*arguments):
    return [sys.executable, "-c", COMMAND, *SWEEP, *arguments]


def swept(*arguments):
    """Run the same command in this process."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("mbstab.analysis.sweep.tolerances.Tolerances.block_points", 300)
        return CliRunner().invoke(main, [*SWEEP, *arguments])


def test_a_killed_command_is_resumed_and_loses_a_block_at_most(tmp_path):
    out, reference = tmp_path / "v.npz", tmp_path / "reference.npz"
    arguments = ("--points", "2401", "--output")
    parts = out.with_name("v.npz.parts")
    with child(command(*arguments, str(out)), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        until(lambda: len(finished(parts)) >= 4, process)
        assert process.poll() is None
    kept = finished(parts)
    # A block is written whole or not at all, and none but the one in flight is missing.
    assert len(kept) >= 4
    assert not out.exists()
    assert [path.name for path in kept] == [f"block-{i:06}.npz" for i in range(len(kept))]
    for path in kept:
        with np.load(path) as data:
            assert data["values"].shape == (300, 4)
    times = {path.name: path.stat().st_mtime_ns for path in kept}
    refused = swept(*arguments, str(out))
    assert refused.exit_code == 2
    assert "--resume" in refused.stderr
    assert {path.name: path.stat().st_mtime_ns for path in finished(parts)} == times
    resumed = swept(*arguments, str(out), "--resume")
    assert resumed.exit_code == 0, resumed.stderr
    assert not parts.exists()
    assert swept(*arguments, str(reference)).exit_code == 0
    with np.load(out) as one, np.load(reference) as other:
        assert set(one) == set(other)
        assert all(one[key].tobytes() == other[key].tobytes() for key in one)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["reference.npz", "v.npz"]


class Killing:
    """Progress that kills a worker process when a block is done."""

    def __init__(self, times):
        self.times = times

    def __call__(self, done):
        workers = multiprocessing.active_children()
        if self.times and workers and done < 0.7:
            self.times -= 1
            os.kill(workers[0].pid, signal.SIGKILL)


def test_blocks_of_a_worker_that_dies_are_computed_again(wheel, whole_wheel, tmp_path):
    killing = Killing(1)
    assert_same(whole_wheel, wheel.sweep("a", A, killing, directory=tmp_path / "a.parts", jobs=2))
    assert killing.times == 0


def test_blocks_are_given_up_after_so_many_dead_workers(wheel, whole_wheel, tmp_path, monkeypatch):
    monkeypatch.setattr("mbstab.analysis.sweep.tolerances.Tolerances.block_retries", 0)
    place = tmp_path / "a.parts"
    with pytest.raises(NumericalError, match=r"1 worker process died(?s:.)*--resume"):
        wheel.sweep("a", A, Killing(1), directory=place, jobs=2)
    assert 1 <= len(finished(place)) < 6
    assert_same(whole_wheel, wheel.sweep("a", A, directory=place, resume=True))
    assert multiprocessing.active_children() == []


# --- places ---------------------------------------------------------------------------------------------------------


def test_a_full_disk(wheel, whole_wheel, tmp_path, monkeypatch):
    place, replace, left = tmp_path / "a.parts", os.replace, [4]

    def full(*arguments):
        left[0] -= 1
        if left[0] < 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        replace(*arguments)

    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", full)
        with pytest.raises(OutputError, match=r"No space left(?s:.)*--resume"):
            wheel.sweep("a", A, directory=place)
    # The label and three blocks; nothing half written is left.
    assert sorted(path.name for path in place.iterdir()) == [*(f"block-{i:06}.npz" for i in range(3)), "sweep.json"]
    assert_same(whole_wheel, wheel.sweep("a", A, directory=place, resume=True))


def test_a_full_disk_while_a_block_is_written(bicycle, small, tmp_path, monkeypatch):
    def full(handle):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OutputError, match="No space left"):
        bicycle.sweep("v", X, directory=tmp_path / "v.parts")
    assert list((tmp_path / "v.parts").iterdir()) == []


@pytest.mark.long
def test_a_disk_that_is_full_at_any_moment(small, tmp_path, monkeypatch):
    out, reference = tmp_path / "v.csv", tmp_path / "reference.csv"
    pictures, command = tmp_path / "v.svg", ["sweep", "pendulum.yaml", "--param", "L", "--points", "101"]
    command += ["--plot", "map", "--pictures", str(pictures)]
    assert CliRunner().invoke(main, [*command, "-o", str(reference)]).exit_code == 0
    written = sorted(path.name for path in tmp_path.iterdir())
    calls = [(tempfile, "mkstemp"), (os, "fsync"), (os, "replace"), (os, "write")]
    whole = [getattr(module, name) for module, name in calls]
    left = [0]

    def failing(call):
        def write(*arguments, **options):
            left[0] -= 1
            if left[0] == 0:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            return call(*arguments, **options)

        return write

    for (module, name), call in zip(calls, whole, strict=True):
        monkeypatch.setattr(module, name, failing(call))
    for moment in range(1, 100):
        left[0] = moment
        result = CliRunner().invoke(main, [*command, "-o", str(out)])
        full, left[0] = left[0] <= 0, 0
        if not full:
            break
        assert result.exit_code == 1, result.output
        assert isinstance(result.exception, SystemExit)
        assert "No space left" in result.stderr
        resume = ["--resume"] if (tmp_path / "v.csv.parts").exists() else []
        again = CliRunner().invoke(main, [*command, "-o", str(out), *resume])
        assert again.exit_code == 0, again.stderr
        assert out.read_bytes() == reference.read_bytes()
        out.unlink()
        assert sorted(path.name for path in tmp_path.iterdir()) == written
    assert 10 < moment < 99


def test_a_place_that_is_a_file(bicycle, small, tmp_path):
    (tmp_path / "file").write_text("", encoding="utf-8")
    with pytest.raises(OutputError):
        bicycle.sweep("v", X, directory=tmp_path / "file" / "v.parts")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_place_that_may_not_be_written(bicycle, small, tmp_path):
    tmp_path.chmod(0o500)
    try:
        with pytest.raises(OutputError, match="Permission denied"):
            bicycle.sweep("v", X, directory=tmp_path / "v.parts")
    finally:
        tmp_path.chmod(0o700)


def test_a_place_on_a_file_system_without_files():
    result = CliRunner().invoke(main, ["sweep", "top.yaml", "--param", "omega", "--output", "/proc/none/top.csv"])
    assert result.exit_code in (1, 2)
    assert "cannot be written" in result.stderr


def test_parts_of_another_sweep_are_refused(bicycle, small, tmp_path):
    place = tmp_path / "v.parts"
    with pytest.raises(KeyboardInterrupt):
        bicycle.sweep("v", X, Interrupting(place, 2), directory=place)
    others = [
        (bicycle, "v", X[:-1], {}),
        (bicycle, "v", X + 1e-13, {}),
        (bicycle, "v", X, {"w": 1.03}),
        (bicycle, "c", X / 100, {}),
        (mbstab.load("rolling_torus.yaml"), "v", X, {}),
    ]
    for model, parameter, values, settings in others:
        for resume in (True, False):
            with pytest.raises(UsageError, match="another sweep"):
                model.sweep(parameter, values, directory=place, resume=resume, **settings)
    with pytest.raises(UsageError, match="parts of this sweep"):
        bicycle.sweep("v", X, directory=place)
    assert len(finished(place)) == 2
    bicycle.sweep("v", X, directory=place, resume=True)


def test_nothing_to_resume(bicycle, tmp_path):
    with pytest.raises(UsageError, match="nothing to resume"):
        bicycle.sweep("v", X, directory=tmp_path / "v.parts", resume=True)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("resume", [False, True])
def test_a_directory_with_files_of_somebody_else_is_left_alone(bicycle, small, tmp_path, resume):
    place = tmp_path / "v.parts"
    place.mkdir()
    (place / "mine.txt").write_text("mine", encoding="utf-8")
    with contextlib.suppress(UsageError):
        bicycle.sweep("v", X[:80], directory=place, resume=resume)
    assert (place / "mine.txt").read_text(encoding="utf-8") == "mine"


@pytest.mark.few(1)
@pytest.mark.parametrize("content", [b"", b"PK", b"no archive at all"])
def test_a_damaged_block_is_computed_again(wheel, whole_wheel, tmp_path, content):
    place = tmp_path / "a.parts"
    with pytest.raises(KeyboardInterrupt):
        wheel.sweep("a", A, Interrupting(place, 3), directory=place)
    finished(place)[1].write_bytes(content)
    assert_same(whole_wheel, wheel.sweep("a", A, directory=place, resume=True))


# --- cluster --------------------------------------------------------------------------------------------------------


def test_a_cluster_needs_dask(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    result = CliRunner().invoke(
        main, ["sweep", "top.yaml", "--param", "omega", "--plot", "none", "--cluster", "tcp://127.0.0.1:1"]
    )
    assert result.exit_code == 2
    assert "--cluster needs Dask" in result.stderr
    assert "pip install" in result.stderr


@pytest.mark.few(1)
def test_a_cluster_gives_the_same_bits_though_a_worker_dies(wheel, whole_wheel):
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        pid = next(iter(cluster.workers.values())).pid
        killed = []

        def kill(done):
            if not killed and done > 0.2:
                killed.append(pid)
                os.kill(pid, signal.SIGKILL)

        result = wheel.sweep("a", A, kill, cluster=cluster.scheduler_address)
    assert killed
    assert_same(whole_wheel, result)


# --- who else is there ----------------------------------------------------------------------------------------------


def test_a_directory_in_use_is_refused_and_a_lock_that_is_left_is_not(wheel, whole_wheel, tmp_path):
    place = tmp_path / "a.parts"
    refused = []

    class Second(Interrupting):
        def __call__(self, done):
            for resume in (True, False):
                with pytest.raises(UsageError, match=f"in use by another sweep .process {os.getpid()}"):
                    wheel.sweep("a", A, directory=place, resume=resume)
                refused.append(resume)
            super().__call__(done)

    with pytest.raises(KeyboardInterrupt):
        wheel.sweep("a", A, Second(place, 2), directory=place)
    assert refused
    assert not (place / "lock").exists()
    (place / "lock").write_text("1", encoding="utf-8")  # of a process that died
    assert_same(whole_wheel, wheel.sweep("a", A, directory=place, resume=True))
    assert not place.exists()


def test_blocks_of_another_version_are_refused(wheel, whole_wheel, tmp_path, monkeypatch):
    place = tmp_path / "a.parts"
    with pytest.raises(KeyboardInterrupt):
        wheel.sweep("a", A, Interrupting(place, 2), directory=place)
    with monkeypatch.context() as patch:
        patch.setattr(jobs, "_program", lambda: "other sources")
        with pytest.raises(UsageError, match="another version of the program"):
            wheel.sweep("a", A, directory=place, resume=True)
    assert_same(whole_wheel, wheel.sweep("a", A, directory=place, resume=True))


def test_every_source_belongs_to_the_version(tmp_path, monkeypatch):
    home = tmp_path / "mbstab"
    shutil.copytree(Path(mbstab.__file__).parent, home, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(jobs, "__file__", str(home / "analysis" / "sweep" / "jobs.py"))
    before = jobs._program.__wrapped__()
    for name in ("compiler/system.py", "model/reader.py", "analysis/algebra/balls.py"):
        (home / name).write_text("", encoding="utf-8")
        after = jobs._program.__wrapped__()
        assert after != before
        before = after


@pytest.mark.few(1)
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=str)
def test_a_sweep_by_several_processes_ends_quietly(tmp_path, number):
    out = tmp_path / "v.csv"
    values = ("--param", "a", "--from", "0.1", "--to", "0.9", "--points", "2000000", "--jobs", "2")
    command = command_line("sweep", "shimmy.yaml", *values, "-o", out)
    with child(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        until(lambda: any((tmp_path / "v.csv.parts").glob("block-*")), process)
        process.send_signal(number)
        shown, said = process.communicate(timeout=60)
    assert (process.returncode, shown) == (128 + number, "")
    assert "--resume" in said
    assert "Warning" not in said
    assert "Traceback" not in said


def test_a_file_in_the_place_of_the_parts(bicycle, small, tmp_path):
    (tmp_path / "v.parts").write_text("mine", encoding="utf-8")
    for resume in (True, False):
        with pytest.raises(UsageError, match="is a file"):
            bicycle.sweep("v", X, directory=tmp_path / "v.parts", resume=resume)
    assert (tmp_path / "v.parts").read_text(encoding="utf-8") == "mine"


def test_blocks_are_kept_until_the_answer_is_written(tmp_path, monkeypatch):
    out = tmp_path / "v.csv"
    arguments = ["sweep", "whipple_bicycle.yaml", "--param", "v", "--points", "60", "--plot", "none"]
    replace = os.replace

    def full(source, goal):
        if os.fspath(goal) == str(out):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        replace(source, goal)

    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", full)
        result = CliRunner().invoke(main, [*arguments, "--output", str(out)])
    assert result.exit_code != 0
    assert "No space left" in result.stderr
    assert "go on with --resume" in result.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["v.csv.parts"]
    result = CliRunner().invoke(main, [*arguments, "--output", str(out), "--resume"])
    assert result.exit_code == 0, result.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["v.csv"]
    result = CliRunner().invoke(main, [*arguments, "--output", str(out), "--resume"])
    assert result.exit_code == 2
    assert "nothing to resume" in result.stderr


@pytest.mark.long
@pytest.mark.parametrize("kills", [3, 12])
def test_commands_killed_at_random_moments_end_in_the_same_bytes(kills, tmp_path):
    rng = random.Random(kills)
    arguments = ("--points", "3001", "--output")
    reference, out = tmp_path / "reference.csv", tmp_path / "v.csv"
    assert swept(*arguments, str(reference)).exit_code == 0
    parts = out.with_name("v.csv.parts")
    killed = 0
    for _ in range(kills):
        again = ["--resume"] if parts.is_dir() else []
        with child(command(*arguments, str(out), *again), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE) as process:
            try:
                _, text = process.communicate(timeout=rng.uniform(0.3, 2.0))
            except subprocess.TimeoutExpired:
                process.kill()
                process.communicate()
                killed += 1
            else:
                assert process.returncode == 0, text
                break
    # One that is killed after it has written the answer is started once more, and killed again.
    if not out.exists() or parts.is_dir():
        again = ["--resume"] if parts.is_dir() else []
        assert swept(*arguments, str(out), *again).exit_code == 0
    assert killed
    assert out.read_bytes() == reference.read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["reference.csv", "v.csv"]
