"""Eigenvalues and verdicts at many points, as arrays."""

from __future__ import annotations

from collections.abc import Container, Iterable
from dataclasses import replace
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from mbstab.analysis.algebra.arrays import Complex, Flags, Index
from mbstab.analysis.sweep.tolerances import TOLERANCES
from mbstab.analysis.verdict.rule import OPEN, RIGHT, UNDECIDED, UNSTABLE, WORDS, Sides
from mbstab.compiler.system import Array
from mbstab.records import dataclass

WORD = {word: number for number, word in enumerate(WORDS)}
"""Numbers of the words of verdicts."""

NO_EIGENVALUE = complex("nan+nanj")


@dataclass(frozen=True)
class Spectra:
    """Eigenvalues over the points of a sweep, and their verdicts.

    Attributes
    ----------
    values : ndarray of complex, shape (points, r)
        Eigenvalues that are not neutral (1/s), in no order; nan where there are none.
    sides : ndarray of int8, shape (points, r)
        Side of the imaginary axis, as in `mbstab.analysis.verdict.rule`.
    words : ndarray of int8, shape (points,)
        Numbers of the verdicts among `mbstab.analysis.verdict.rule.WORDS`.
    mirrored : ndarray of bool, shape (points,)
        Whether the spectrum is symmetric about the imaginary axis by structure.
    problems : dict
        By the number of a point, why it has no eigenvalues, or none that decide about stability.
    neutral : int
        Additional number of neutral eigenvalues.
    sizes : ndarray, shape (points,)
        Norms of the matrices (1/s).
    motion : ndarray, shape (points, 2 n_q)
        Coordinates and rates of solved references, nan where there are none; (points, 0) if the file gives them.
    """

    values: Complex
    sides: Sides
    words: npt.NDArray[np.int8]
    mirrored: Flags
    problems: dict[int, str]
    neutral: int
    sizes: Array
    motion: Array

    def at(self, index: Any) -> Self:
        """Return some of the points, or one without an axis for points."""
        arrays: dict[str, Any] = {name: x[index] for name, x in vars(self).items() if isinstance(x, np.ndarray)}
        return replace(self, **arrays)

    def fitted(self, total: int, neutral: int) -> Self:
        """Return the same with given numbers of all and of neutral eigenvalues; problems where there are not as many.

        Zeros of a symmetry that does not exist elsewhere are added, and eigenvalues that are zero elsewhere left out.
        """
        points, own = self.values.shape
        here, count = own + self.neutral, total - neutral
        if here != total or len(self.problems) == points:
            text = f"{here} finite {'eigenvalue exists' if here == 1 else 'eigenvalues exist'} here, elsewhere {total}"
            return replace(
                self, values=np.full((points, count), NO_EIGENVALUE),
                sides=np.full((points, count), OPEN, dtype=np.int8), words=np.full_like(self.words, WORD[UNDECIDED]),
                problems={i: self.problems.get(i, text) for i in range(points)}, neutral=neutral,
                motion=np.full_like(self.motion, np.nan),
            )  # fmt: skip
        if own == count:
            return self
        values, sides = (np.pad(x, ((0, 0), (0, max(count - own, 0)))) for x in (self.values, self.sides))
        order = np.argsort(-np.abs(values), axis=1, kind="stable")[:, :count]
        arrays: dict[str, Any] = {"values": values, "sides": sides}
        arrays = {name: np.take_along_axis(x, order, axis=1) for name, x in arrays.items()}
        return replace(self, neutral=neutral, **arrays)

    @property
    def unstable(self) -> Index:
        """Number of unstable eigenvalues of each point; −1 where the verdict is open."""
        return unstable_counts(self.sides, self.words)


def usual(parts: Iterable[Spectra]) -> tuple[int, int]:
    """Return the most frequent numbers of all and of neutral eigenvalues of points."""
    counts: dict[tuple[int, int], int] = {}
    for part in parts:
        if len(part.problems) < len(part.values):
            key = part.values.shape[1] + part.neutral, part.neutral
            counts[key] = counts.get(key, 0) + len(part.values)
    return max(counts, key=lambda key: counts[key]) if counts else (0, 0)


def signs(sides: Sides) -> Sides:
    """Return 1 and −1 for eigenvalues right and left of the axis, 0 for all others."""
    return np.where(sides == OPEN, np.int8(0), sides)


def touching(before: Sides, now: Sides, after: Sides) -> Sides:
    """Return 1 or −1 for eigenvalues that come from that side of the axis to it, or near it, and do not pass it.

    They are at a point between two others, one of which may have them near the axis, too.
    """
    from_, to = signs(before), signs(after)
    return np.where((signs(now) == 0) & (from_ * to >= 0), np.sign(from_ + to), np.int8(0))


def unstable_counts(sides: Sides, words: npt.NDArray[np.int8]) -> Index:
    """Return the numbers of unstable eigenvalues of points, by the sides of all; −1 where the verdict is open."""
    counts = np.where(words == WORD[UNSTABLE], np.sum(sides == RIGHT, axis=1), 0)
    return np.where(words == WORD[UNDECIDED], -1, counts)


def unplaced(sides: Sides, words: npt.NDArray[np.int8], problems: Container[int]) -> int:
    """Return the number of eigenvalues that are undecided at all of many points: unexplained zeros.

    A single point at which fewer are is special: terms of the equations vanish there. Where a family of motions
    explains them at some points, and the motion is unstable at others, only the latter count: no family is searched
    there.
    """
    asked = np.array([i not in problems for i in range(len(words))], dtype=bool)
    if np.any((words != WORD[UNSTABLE]) & (words != WORD[UNDECIDED])):
        asked &= words == WORD[UNSTABLE]
    if not asked.any():
        return 0
    number = np.sum(sides == OPEN, axis=1)[asked]
    if len(number) > 3:
        beside = np.stack([np.roll(number, 1), np.roll(number, -1)])
        beside[0, 0], beside[1, -1] = number[2], number[-3]
        number = np.maximum(number, np.min(beside, axis=0))
    return int(np.min(number))


def settled(sides: Sides, words: npt.NDArray[np.int8], number: int) -> Index:
    """Return the numbers of unstable eigenvalues; −1 where more than `number` of them are undecided."""
    decided = (words != WORD[UNDECIDED]) & (words != WORD[UNSTABLE])
    found = decided | (np.sum(sides == OPEN, axis=1) <= number)
    return np.where(found, np.sum(sides == RIGHT, axis=1), -1)


def pinned(values: Complex, sides: Sides, sizes: Array, number: int) -> Complex:
    """Return spectra, shape (points, r), with `number` unexplained zeros set to zero: their values are noise.

    Where more may be zero, nothing tells which of them are; their sum is known much better than each of them.
    """
    if not number:
        return values
    tiny = (sides == OPEN) & (np.abs(values) <= TOLERANCES.unexplained_zero * sizes[:, None])
    return np.where(tiny & (np.sum(tiny, axis=1, keepdims=True) <= number), 0.0, values)
