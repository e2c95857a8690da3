"""Long sweeps in blocks of points: computed by this process, by several, or by a cluster, and kept on disk.

A block is computed from its task alone, so its result does not depend on where and in which
order it is computed. Finished blocks are written to a directory, each completely or not at all;
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
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
import numpy.typing as npt

import mbstab
from mbstab.analysis.algebra.arrays import Complex, Flags
from mbstab.analysis.linear.verdict import UNDECIDED
from mbstab.analysis.reference.paths import Path as Solutions
from mbstab.analysis.sweep.batched_spectra import Evaluator
from mbstab.analysis.sweep.batched_verdict import OPEN, WORD, Sides, pinned, signs, unplaced, unstable_counts
from mbstab.analysis.sweep.settings import HERE, SweepSettings
from mbstab.analysis.sweep.tolerances import TOLERANCES
from mbstab.analysis.sweep.tracking import NO_EIGENVALUE, continuous, follow, turning
from mbstab.compiler.system import Array
from mbstab.errors import NumericalError, OutputError, UsageError
from mbstab.model.parameters import bound
from mbstab.model.reader import read_model_text
from mbstab.model.schema import Model
from mbstab.records import dataclass

LABEL, LOCK = "sweep.json", "lock"
"""Files that name the sweep of a directory of blocks, and the process at work in it."""

Progress = Callable[[float], object]


@dataclass(frozen=True)
class Task:
    """The data from which a block is computed.

    Attributes
    ----------
    text, name : str
        The text of the model file, and its name in messages.
    settings : dict
        Values of other parameters (`Model.settings`).
    values : dict
        Parameters that vary, arrays of shape (points,).
    solutions : Path or None
        Equilibria over the parameter, if the file asks to find them.
    followed : bool
        Whether eigenvalues are followed from point to point.
    """

    text: str
    name: str
    settings: dict[str, int | float | str]
    values: dict[str, Array]
    solutions: Solutions | None
    followed: bool = True


@dataclass(frozen=True)
class Block:
    """Spectra of consecutive points.

    Attributes
    ----------
    values : ndarray of complex, shape (points, r)
        In columns that are continuous …
    clear : ndarray of bool, shape (points − 1,)
        … to the next point, where the links are certain.
    problems : dict
        By the number of a point within the block.
    neutral : int
    sides : ndarray of int8, shape (points, r)
        Side of the imaginary axis of each eigenvalue, as in `mbstab.analysis.sweep.batched_verdict`.
    words : ndarray of int8, shape (points,)
        Numbers of the verdicts.
    mirrored : ndarray of bool, shape (points,)
        Whether the spectrum is symmetric about the imaginary axis by structure.
    passes : ndarray of bool, shape (points,)
        Whether a real part may change its sign before the next point …
    turns : ndarray of bool, shape (points,)
        … or come close to zero and turn back at this one.
    """

    values: Complex
    clear: Flags
    problems: dict[int, str]
    neutral: int
    sides: Sides
    words: npt.NDArray[np.int8]
    mirrored: Flags
    passes: Flags
    turns: Flags

    @property
    def unstable(self) -> npt.NDArray[np.intp]:
        """Number of unstable eigenvalues of each point; −1 where the verdict is open."""
        return unstable_counts(self.sides, self.words)


ARRAYS = ("values", "clear", "sides", "words", "mirrored", "passes", "turns")
"""The arrays of a block."""


def compute(task: Task, progress: Progress = lambda done: None) -> Block:
    """Return the block of a task."""
    evaluator = Evaluator(bound(read_model_text(task.text, task.name), task.settings), task.solutions)
    found = evaluator.spectra(task.values, progress)
    number = unplaced(found.sides, found.words, found.problems)
    whole = pinned(found.values, found.sides, found.sizes, number)
    if not task.followed:
        unknown = np.zeros(len(whole), dtype=bool)
        return Block(
            whole,
            unknown[1:],
            found.problems,
            found.neutral,
            found.sides,
            found.words,
            found.mirrored,
            unknown,
            unknown,
        )
    links, clear = follow(whole[:-1], whole[1:])
    order = continuous(links, clear)
    values: Complex = np.take_along_axis(whole, order, axis=1)
    sides: Sides = np.take_along_axis(found.sides, order, axis=1)
    watched = _watched(values, sides)
    return Block(values, clear, found.problems, found.neutral, sides, found.words, found.mirrored, *watched)


def _watched(values: Complex, sides: Sides) -> tuple[Flags, Flags]:
    """Return where real parts may pass zero, and where they may touch it; ends count as touching."""
    passes, turns = np.ones(len(values), dtype=bool), np.ones(len(values), dtype=bool)
    with np.errstate(invalid="ignore"):
        sign = signs(sides)
        passes[:-1] = np.any(sign[1:] * sign[:-1] < 0, axis=1)
        turns[1:-1] = np.any(turning(values[:-2], values[1:-1], values[2:]) & (sign[1:-1] != 0), axis=1)
    return passes, turns


def block_size(n_q: int) -> int:
    """Return the number of points per block for a scene with `n_q` coordinates.

    Work is estimated, not timed: the last bits of a result depend on the block, and must be the same in every run.
    """
    return min(
        TOLERANCES.block_points,
        max(TOLERANCES.block_points_least, int(TOLERANCES.block_time / (TOLERANCES.point_time * max(n_q, 1) ** 2))),
    )


def tasks(
    model: Model,
    values: Mapping[str, Array],
    solutions: Solutions | None = None,
    followed: bool = True,
) -> list[Task]:
    """Return the tasks of a sweep over points given by arrays of the same shape (points,)."""
    points, size = len(next(iter(values.values()))), block_size(len(model.coordinates()))
    text = "\n".join(model.document.lines)
    return [
        Task(
            text,
            model.name,
            model.settings,
            {name: x[start : start + size] for name, x in values.items()},
            solutions and replace(solutions, beyond=()),
            followed,
        )
        for start in range(0, points, size)
    ]


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
        digest.update(repr((task.text, sorted(task.settings.items()))).encode())
        for name, x in sorted(task.values.items()):
            digest.update(name.encode() + x.tobytes())
    return digest.hexdigest()


@functools.cache
def _program() -> str:
    """Return a fingerprint of this program: all of its sources."""
    digest, home = hashlib.sha256(), Path(mbstab.__file__).parent
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


def merged(blocks: list[Block]) -> Block:
    """Return consecutive blocks as one, with the most frequent number of neutral eigenvalues."""
    sizes: dict[tuple[int, int], int] = {}
    for block in blocks:
        if len(block.problems) < len(block.values):
            key = block.values.shape[1] + block.neutral, block.neutral
            sizes[key] = sizes.get(key, 0) + len(block.values)
    total, neutral = max(sizes, key=lambda key: sizes[key]) if sizes else (0, 0)
    fitted = [_fitted(block, total, neutral) for block in blocks]
    clear: list[Flags] = []
    problems: dict[int, str] = {}
    start = 0
    for n, block in enumerate(fitted):
        if n:
            link, is_clear = follow(fitted[n - 1].values[-1:], block.values[:1])
            clear.append(is_clear)
            if is_clear[0] and block.values.shape[1] > 1:
                fitted[n] = replace(block, values=block.values[:, link[0]], sides=block.sides[:, link[0]])
        clear.append(block.clear)
        problems |= {start + i: text for i, text in block.problems.items()}
        start += len(block.values)
    arrays = {name: np.concatenate([getattr(block, name) for block in fitted]) for name in ARRAYS if name != "clear"}
    return Block(clear=np.concatenate(clear), problems=problems, neutral=neutral, **arrays)


def _fitted(block: Block, total: int, neutral: int) -> Block:
    """Return a block with given numbers of all and of neutral eigenvalues."""
    points, here = len(block.values), block.values.shape[1] + block.neutral
    count, own = total - neutral, block.values.shape[1]
    if here != total or len(block.problems) == points:
        text = f"{here} finite eigenvalues exist here, elsewhere {total}"
        return replace(
            block, values=np.full((points, count), NO_EIGENVALUE), sides=np.full((points, count), OPEN, dtype=np.int8),
            words=np.full(points, WORD[UNDECIDED], dtype=np.int8), clear=np.zeros(points - 1, dtype=bool),
            problems={i: block.problems.get(i, text) for i in range(points)}, neutral=neutral,
        )  # fmt: skip
    if own == count:
        return block
    # Zeros of a symmetry that does not exist elsewhere, or eigenvalues that are zero elsewhere.
    width = max(count - own, 0)
    values = np.pad(block.values, ((0, 0), (0, width)))
    sides = np.pad(block.sides, ((0, 0), (0, width)))
    order = np.argsort(-np.abs(values), axis=1, kind="stable")[:, :count] if own > count else np.arange(count)[None]
    order = np.broadcast_to(order, (points, count))
    values, sides = np.take_along_axis(values, order, axis=1), np.take_along_axis(sides, order, axis=1)
    return replace(block, values=values, sides=sides, clear=np.zeros(points - 1, dtype=bool), neutral=neutral)


def _in_processes(
    all_tasks: list[Task], missing: list[int], jobs: int, progress: Progress
) -> Iterator[tuple[int, Block]]:
    """Yield blocks as processes, including this one, finish them; blocks of dead processes are given to others."""
    import multiprocessing

    waiting, tries = list(missing), 0
    while waiting:
        left, running = list(waiting), dict[Future[Block], int]()
        workers = max(min(jobs, len(left)) - 1, 1)
        with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn")) as pool:
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
                        f"a worker process died {tries} times; {len(waiting)} blocks are missing\n"
                        "hint: too little memory for so many jobs? finished blocks are kept with --output, go on "
                        "with --resume and fewer --jobs"
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
