"""Long sweeps in blocks of points: computed by this process, by several, or by a cluster, and kept on disk.

Finished blocks are written to a directory, each completely or not at all;
an interrupted sweep reads them when it is resumed.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import json
import os
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from mbstab.analysis.sweep.blocks import ARRAYS, Block, Progress, Task, compute
from mbstab.analysis.sweep.settings import HERE, SweepSettings
from mbstab.analysis.sweep.tolerances import TOLERANCES
from mbstab.errors import NumericalError, OutputError, UsageError, counted

LABEL, LOCK = "sweep.json", "lock"
"""Files that name the sweep of a directory of blocks, and the process at work in it."""


class Store:
    """Finished blocks in a directory.

    Parameters
    ----------
    directory : Path
    key : str
        Identifies the sweep; blocks of another sweep are refused.
    resume : bool
        Whether existing blocks are used.

    Raises
    ------
    UsageError
        If the directory contains another sweep, or blocks although `resume` is not set, or is in use.
    """

    def __init__(self, directory: Path, key: str, resume: bool) -> None:
        self.directory = directory
        label = directory / LABEL
        if directory.exists() and not directory.is_dir():
            raise UsageError(
                f"{directory} is a file: the parts of this sweep go to a directory of that name\n"
                "hint: rename it, or name another file with --output"
            )
        if directory.exists():
            own = (LABEL, LOCK)
            if not label.exists() and any(x.name not in own and x.name[:6] != ".part." for x in directory.iterdir()):
                raise UsageError(f"{directory} exists and belongs to no sweep\nhint: name another file with --output")
        elif resume:
            raise UsageError(
                f"there is nothing to resume: {directory} does not exist\n"
                "hint: a sweep that is complete leaves none; leave out --resume to begin"
            )
        with _written(directory):
            directory.mkdir(parents=True, exist_ok=True)
            self._lock = _locked(directory / LOCK)
        try:
            known = _read_label(label)
            if known is not None and known != key:
                raise UsageError(
                    f"{directory} holds parts of another sweep, or of another version of the program\n"
                    "hint: remove it, or name another file with --output"
                )
            if not resume and known is not None:
                raise UsageError(
                    f"{directory} holds parts of this sweep\nhint: go on with --resume, or remove the directory"
                )
            with _written(directory):
                self._write(label, json.dumps({"key": key}).encode())
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Release the directory for other processes."""
        if self._lock is not None:
            name = self.directory / LOCK
            with contextlib.suppress(OSError):
                if name.stat().st_ino == os.fstat(self._lock).st_ino:
                    name.unlink()
            os.close(self._lock)
            self._lock = None

    def _write(self, goal: Path, content: bytes) -> None:
        handle, temporary = tempfile.mkstemp(dir=self.directory, prefix=".part.")
        try:
            with os.fdopen(handle, "wb") as stream:
                stream.write(content)
                stream.flush()
                os.fsync(stream.fileno())
            os.replace(temporary, goal)
        except BaseException:
            os.unlink(temporary)
            raise

    def save(self, number: int, block: Block) -> None:
        """Write a block, completely or not at all.

        Raises
        ------
        OutputError
            If it cannot be written.
        """
        from io import BytesIO

        out = BytesIO()
        arrays: dict[str, Any] = {name: getattr(block, name) for name in ARRAYS}
        np.savez(out, neutral=block.neutral, problems=np.array(json.dumps(block.problems)), **arrays)
        with _written(self.directory):
            self._write(self._name(number), out.getvalue())

    def load(self, number: int) -> Block | None:
        """Return a finished block, or None if there is none."""
        name = self._name(number)
        if not name.exists():
            return None
        try:
            return self._read(name)
        except (ValueError, EOFError, KeyError, OSError, BadZipFile):
            return None  # damaged: it is computed again

    @staticmethod
    def _read(name: Path) -> Block:
        with np.load(name) as data:
            problems = {int(i): text for i, text in json.loads(str(data["problems"])).items()}
            arrays = {name: data[name] for name in ARRAYS}
            return Block(problems=problems, neutral=int(data["neutral"]), **arrays)

    def _name(self, number: int) -> Path:
        return self.directory / f"block-{number:06}.npz"

    def remove(self) -> None:
        """Remove the directory once the answer is written."""
        discard(self.directory)
        self.close()


@contextlib.contextmanager
def stored(all_tasks: list[Task], settings: SweepSettings) -> Iterator[Store | None]:
    """Keep blocks in a directory, if one is given, while a sweep is computed; afterwards only with `settings.keep`.

    Raises
    ------
    UsageError
        As `Store`.
    """
    if settings.directory is None:
        yield None
        return
    store = Store(settings.directory, key_of(all_tasks), settings.resume)
    try:
        yield store
        if not settings.keep:
            store.remove()
    finally:
        store.close()


def discard(directory: Path) -> None:
    """Remove the parts of a sweep whose answer is written."""
    with _written(directory):
        for pattern in ("block-*.npz", ".part.*", LABEL, LOCK):
            for path in directory.glob(pattern):
                path.unlink(missing_ok=True)
        if directory.is_dir() and not any(directory.iterdir()):
            directory.rmdir()


def _locked(name: Path) -> int | None:
    """Return the handle of a file that this process alone has locked; the lock ends with the process.

    Raises
    ------
    UsageError
        If another process has.
    """
    if sys.platform == "win32":
        return None
    import fcntl

    while True:
        handle = os.open(name, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            owner = os.read(handle, 20).decode(errors="replace").strip()
            os.close(handle)
            raise UsageError(
                f"{name.parent} is in use by another sweep (process {owner or 'unknown'})\n"
                "hint: wait until it ends, or name another file with --output"
            ) from None
        # The previous owner may have removed it in the meantime.
        with contextlib.suppress(FileNotFoundError):
            if os.fstat(handle).st_ino == name.stat().st_ino:
                break
        os.close(handle)
    try:
        os.ftruncate(handle, 0)
        os.write(handle, str(os.getpid()).encode())
    except OSError:
        os.close(handle)
        raise
    return handle


class _written:
    """Turns write failures into errors that a user can act on."""

    def __init__(self, place: Path) -> None:
        self.place = place

    def __enter__(self) -> None:
        pass

    def __exit__(self, _: Any, error: BaseException | None, __: Any) -> None:
        if isinstance(error, OSError):
            raise OutputError(
                f"{self.place}: cannot be written: {error.strerror}\nhint: blocks that are there are kept; "
                "make room and go on with --resume"
            ) from None


def _read_label(label: Path) -> str | None:
    try:
        return str(json.loads(label.read_text(encoding="utf-8"))["key"])
    except (OSError, ValueError, KeyError, TypeError):
        return None


def key_of(all_tasks: list[Task]) -> str:
    """Return a text that is unique to a sweep and a version of the program."""
    digest = hashlib.sha256(_program().encode())
    for task in all_tasks:
        digest.update(repr((task.text, sorted(task.beside.items()), sorted(task.settings.items()))).encode())
        for name, x in sorted(task.values.items()):
            digest.update(name.encode() + x.tobytes())
    return digest.hexdigest()


@functools.cache
def _program() -> str:
    """Return a fingerprint of this program: all of its sources."""
    digest, home = hashlib.sha256(), Path(__file__).resolve().parents[2]
    for path in sorted(home.rglob("*")):
        if path.is_file() and "__pycache__" not in path.parts:
            digest.update(str(path.relative_to(home)).encode() + path.read_bytes())
    return digest.hexdigest()


def run(
    all_tasks: list[Task],
    store: Store | None = None,
    settings: SweepSettings = HERE,
    progress: Progress = lambda _: None,
) -> list[Block]:
    """Return the blocks of all tasks.

    Parameters
    ----------
    all_tasks : list of Task
    store : Store, optional
        Where finished blocks are kept and searched.
    settings : SweepSettings, optional
        Where the blocks are computed.
    progress : callable, optional
        Called with the fraction of the work that is done, from 0 to 1.
    """
    blocks: dict[int, Block] = {}
    for number in range(len(all_tasks)):
        known = store.load(number) if store is not None else None
        if known is not None:
            blocks[number] = known
    missing = [number for number in range(len(all_tasks)) if number not in blocks]

    def part(done: float) -> None:
        progress((len(blocks) + done) / len(all_tasks))

    if settings.cluster:
        source = _on_cluster(all_tasks, missing, settings.cluster)
    elif settings.jobs > 1 and len(missing) > 1:
        source = _in_processes(all_tasks, missing, settings.jobs, part)
    else:
        source = ((number, compute(all_tasks[number], part)) for number in missing)
    try:
        for number, block in source:
            if store is not None:
                store.save(number, block)
            blocks[number] = block
            part(0.0)
    except UsageError:
        if store is not None and not blocks:
            store.remove()
        raise
    return [blocks[number] for number in range(len(all_tasks))]


def _cause_of_death() -> str:
    """Return what may end worker processes: they import the main script again, and cannot where it is no file."""
    script = getattr(sys.modules["__main__"], "__file__", None)
    if script is not None and not Path(script).exists():
        return f"workers import the script again, and {script} is no file: save it as one; otherwise "
    return "too little memory for so many jobs? "


def _end_with_parent() -> None:
    """Let this process end when the one that has started it does, however that ends."""
    from multiprocessing import connection, parent_process
    from threading import Thread

    parent = parent_process()
    assert parent is not None
    sentinel = parent.sentinel

    def wait_for_end() -> None:
        connection.wait([sentinel])
        os._exit(1)

    Thread(target=wait_for_end, daemon=True).start()


def _in_processes(
    all_tasks: list[Task], missing: list[int], jobs: int, progress: Progress
) -> Iterator[tuple[int, Block]]:
    """Yield blocks as processes, including this one, finish them; blocks of dead processes are given to others."""
    import multiprocessing

    waiting, tries = list(missing), 0
    while waiting:
        left, running = list(waiting), dict[Future[Block], int]()
        workers = max(min(jobs, len(left)) - 1, 1)
        with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), _end_with_parent) as pool:
            try:
                while left or running:
                    own = left.pop() if left else None
                    while left and len(running) < TOLERANCES.blocks_ahead * workers:
                        running[pool.submit(compute, all_tasks[left[0]])] = left[0]
                        del left[0]
                    if own is not None:
                        block = compute(all_tasks[own], progress)
                        waiting.remove(own)
                        yield own, block
                    done, _ = wait(running, None if own is None else 0.0, FIRST_COMPLETED)
                    for future in done:
                        number = running.pop(future)
                        block = future.result()
                        waiting.remove(number)
                        yield number, block
            except BrokenProcessPool:
                tries += 1
                if tries > TOLERANCES.block_retries:
                    raise NumericalError(
                        f"{counted(tries, 'worker process', 'worker processes')} died; "
                        f"{counted(len(waiting), 'block')} missing\n"
                        f"hint: {_cause_of_death()}finished blocks are kept with --output, go on with --resume and "
                        "fewer --jobs"
                    ) from None
            except BaseException:
                pool.shutdown(wait=False, cancel_futures=True)
                raise


def _on_cluster(all_tasks: list[Task], missing: list[int], address: str) -> Iterator[tuple[int, Block]]:
    """Yield blocks as the workers of a Dask cluster finish them; those of dead workers are given to others."""
    try:
        from distributed import Client, KilledWorker, as_completed
    except ImportError:
        raise UsageError("--cluster needs Dask\nhint: python -m pip install 'mbstab[cluster]'") from None
    try:
        client = Client(address, timeout=20)
    except (OSError, ValueError) as error:
        raise UsageError(f"--cluster {address}: no scheduler answers ({error})") from None
    with client:
        futures = {
            client.submit(compute, all_tasks[i], pure=False, retries=TOLERANCES.block_retries): i for i in missing
        }
        try:
            for future in as_completed(list(futures)):
                yield futures[future], future.result()
        except (OSError, CancelledError, KilledWorker) as error:
            raise NumericalError(
                f"--cluster {address}: the cluster was lost ({type(error).__name__})\n"
                "hint: finished blocks are kept with --output, go on with --resume"
            ) from None
