"""Blocks of points of a sweep: the data from which each is computed, and how they are joined.

A block is computed from its task alone, so its result does not depend on where and in which
order it is computed.
"""

from __future__ import annotations

import functools
import pickle
from collections.abc import Callable, Mapping
from dataclasses import field, replace

import numpy as np

from mbstab.analysis.algebra.arrays import Complex, Flags, Index
from mbstab.analysis.reference.paths import Path as Solutions
from mbstab.analysis.reference.paths import Sheet, Surface
from mbstab.analysis.sweep.batched_equations import Pattern
from mbstab.analysis.sweep.batched_spectra import Evaluator
from mbstab.analysis.sweep.spectra import WORD, Spectra, pinned, signs, touching, unplaced, usual
from mbstab.analysis.sweep.tolerances import TOLERANCES
from mbstab.analysis.sweep.tracking import continuous, follow, turning
from mbstab.analysis.verdict.rule import UNDECIDED, Sides
from mbstab.compiler.system import Array
from mbstab.model.parameters import bound
from mbstab.model.reader import read_model_text
from mbstab.model.schema import LeftOut, Model
from mbstab.records import dataclass

Progress = Callable[[float], object]

Followed = Solutions | Sheet | Surface


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
    solutions : Path, Sheet, Surface or None
        Equilibria over the parameters, if the file asks to find them.
    followed : bool
        Whether eigenvalues are followed from point to point.
    home : dict
        The point of the whole sweep whose pattern is tried first.
    share : float
        The fraction of all points of the sweep that these are.
    beside : dict
        Texts of other files that the model names.
    left_out : tuple of LeftOut
        Rows that are no constraints.
    """

    text: str
    name: str
    settings: dict[str, int | float | str]
    values: dict[str, Array]
    solutions: Followed | None
    followed: bool = True
    home: dict[str, float] = field(default_factory=dict)
    share: float = 1.0
    beside: dict[str, str] = field(default_factory=dict)
    left_out: tuple[LeftOut, ...] = ()


@dataclass(frozen=True)
class Block(Spectra):
    """Spectra of consecutive points.

    Attributes
    ----------
    clear : ndarray of bool, shape (points − 1,)
        Where the columns of values are continuous to the next point, and the links are certain.
    passes : ndarray of bool, shape (points,)
        Whether a real part may change its sign before the next point …
    turns : ndarray of bool, shape (points,)
        … or come close to zero and turn back at this one.
    """

    clear: Flags
    passes: Flags
    turns: Flags


Source = tuple[str, str, tuple[tuple[str, str], ...], tuple[LeftOut, ...]]
"""Text and name of a model, the files beside it, and the rows that are no constraints."""

ARRAYS = ("values", "clear", "sides", "words", "mirrored", "passes", "turns", "sizes", "motion")
"""The arrays of a block."""


def compute(task: Task, progress: Progress = lambda done: None) -> Block:
    """Return the block of a task."""
    model = bound(_read(task.text, task.name, tuple(task.beside.items()), task.left_out), task.settings)
    evaluator = Evaluator(model, task.solutions, patterns_at(model, task.solutions, task.home))
    found = evaluator.spectra(task.values, progress, task.share)
    number = unplaced(found.sides, found.words, found.problems)
    whole = replace(found, values=pinned(found.values, found.sides, found.sizes, number))
    if task.followed:
        return followed(whole)
    unknown = np.zeros(len(whole.values), dtype=bool)
    return Block(**vars(whole), clear=unknown[1:], passes=unknown, turns=unknown)


def followed(found: Spectra) -> Block:
    """Return spectra as a block, with columns that are continuous where links are certain."""
    links, clear = follow(found.values[:-1], found.values[1:])
    order = continuous(links, clear)
    values: Complex = np.take_along_axis(found.values, order, axis=1)
    sides: Sides = np.take_along_axis(found.sides, order, axis=1)
    passes, turns = _watched(values, sides)
    return Block(**vars(replace(found, values=values, sides=sides)), clear=clear, passes=passes, turns=turns)


def home_of(values: Mapping[str, Array]) -> dict[str, float]:
    """Return the point whose pattern is tried first at all points of a sweep; nothing where there is only one."""
    points = len(next(iter(values.values())))
    if points < 2:
        return {}
    # Special values often stand in the middle or at an end.
    return {name: float(x[int(TOLERANCES.place_of_home * points)]) for name, x in values.items()}


def patterns_at(model: Model, solutions: Followed | None, home: Mapping[str, float]) -> tuple[Pattern, ...]:
    """Return the pattern of a point, worked out once by each process; none if it has a problem."""
    if not home:
        return ()
    text = "\n".join(model.document.lines)
    plain = replace(solutions, beyond=()) if isinstance(solutions, Solutions) else solutions
    settings, place = tuple(model.settings.items()), tuple(home.items())
    # Apart from the rest, as bytes depend on which strings of all are one object.
    source = text, model.name, tuple(model.document.beside.items()), model.left_out
    return _known_patterns(source, settings, pickle.dumps(plain), place)


@functools.lru_cache(maxsize=8)
def _known_patterns(
    source: Source,
    settings: tuple[tuple[str, int | float | str], ...],
    solutions: bytes,
    home: tuple[tuple[str, float], ...],
) -> tuple[Pattern, ...]:
    evaluator = Evaluator(bound(_read(*source), dict(settings)), pickle.loads(solutions))
    return evaluator.patterns_at(dict(home))


@functools.lru_cache(maxsize=4)
def _read(text: str, name: str, beside: tuple[tuple[str, str], ...], left_out: tuple[LeftOut, ...]) -> Model:
    """Return the model of a text, read once by each process."""
    return replace(read_model_text(text, name, dict(beside)), left_out=left_out)


def _watched(values: Complex, sides: Sides) -> tuple[Flags, Flags]:
    """Return where real parts may pass zero, and where they may touch it; ends count as touching."""
    passes, turns = np.ones(len(values), dtype=bool), np.ones(len(values), dtype=bool)
    with np.errstate(invalid="ignore"):
        sign = signs(sides)
        passes[:-1] = np.any(sign[1:] * sign[:-1] < 0, axis=1)
        near = turning(values[:-2], values[1:-1], values[2:]) & (sign[1:-1] != 0)
        turns[1:-1] = np.any(near | (touching(sides[:-2], sides[1:-1], sides[2:]) != 0), axis=1)
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
    solutions: Followed | None = None,
    followed: bool = True,
) -> list[Task]:
    """Return the tasks of a sweep over points given by arrays of the same shape (points,)."""
    points, size = len(next(iter(values.values()))), block_size(len(model.coordinates()))
    text = "\n".join(model.document.lines)
    home = home_of(values)
    return [
        Task(
            text,
            model.name,
            model.settings,
            {name: x[start : start + size] for name, x in values.items()},
            replace(solutions, beyond=()) if isinstance(solutions, Solutions) else solutions,
            followed,
            home,
            min(size, points - start) / points,
            model.document.beside,
            model.left_out,
        )
        for start in range(0, points, size)
    ]


def merged(blocks: list[Block]) -> Block:
    """Return consecutive blocks as one, with the most frequent number of neutral eigenvalues."""
    total, neutral = usual(blocks)
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


def undecided(raw: Block) -> Index:
    """Return the numbers of points that are undecided; zeros that are neutral elsewhere are not among the values."""
    open_ = raw.words == WORD[UNDECIDED]
    open_[list(raw.problems)] = False
    return np.flatnonzero(open_)


def _fitted(block: Block, total: int, neutral: int) -> Block:
    """Return a block with given numbers of all and of neutral eigenvalues, in other columns if need be."""
    found = block.fitted(total, neutral)
    return found if found is block else replace(found, clear=np.zeros_like(block.clear))
