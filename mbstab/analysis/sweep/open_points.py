"""Points of a sweep that are open after all are judged at once: kinds of them, and what explains their zeros."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mbstab.analysis.algebra.arrays import Index
from mbstab.analysis.sweep.batched_structure import Known
from mbstab.analysis.sweep.batched_verdict import Judged
from mbstab.analysis.sweep.spectra import WORD
from mbstab.analysis.sweep.tolerances import TOLERANCES
from mbstab.analysis.verdict.rule import AXIS, LEFT, OPEN, RIGHT, UNDECIDED
from mbstab.records import dataclass


@dataclass(frozen=True)
class Part:
    """Points that were computed together, or one that was computed in full."""

    index: Index
    found: Judged
    known: Known
    alone: bool = False

    @property
    def total(self) -> int:
        """Number of finite eigenvalues."""
        return int(self.found.values.shape[1]) + self.known.neutral.count


@dataclass(frozen=True)
class Kind:
    """Points of a pattern with the same verdict and the same numbers of eigenvalues on each side.

    Attributes
    ----------
    known : int
        Identifies the pattern.
    word : int
        Number of the verdict.
    right, left, axis, open : int
        Numbers of eigenvalues on the sides of the imaginary axis.
    """

    known: int
    word: int
    right: int
    left: int
    axis: int
    open: int

    def with_zeros(self, parts: Sequence[Part], members: Sequence[int]) -> list[int]:
        """Return the points, ascending, that are undecided because as many zeros as are open have no explanation."""
        if self.word != WORD[UNDECIDED] or not self.open:
            return []
        asked = set(members)
        return sorted(
            i
            for part in parts
            if not part.alone and id(part.known) == self.known
            for i in part.index[part.found.zeros == self.open].tolist()
            if i in asked
        )


def kinds_of_open_points(parts: Sequence[Part]) -> dict[Kind, list[int]]:
    """Return points with open eigenvalues or verdicts, kind by kind; those farthest from the axis first."""
    kinds: dict[Kind, list[tuple[float, int]]] = {}
    for part in parts:
        unplaced = np.any(part.found.sides == OPEN, axis=1)
        open_ = np.flatnonzero(unplaced | (part.found.words == WORD[UNDECIDED]))
        if part.alone or not len(open_):
            continue
        values, sides = part.found.values[open_], part.found.sides[open_]
        counts = np.stack([np.sum(sides == x, axis=1) for x in (RIGHT, LEFT, AXIS, OPEN)], axis=1)
        distance = np.min(np.where(sides == OPEN, np.abs(values.real), np.inf), axis=1, initial=np.inf)
        words = part.found.words[open_].tolist()
        columns = counts.tolist(), words, distance.tolist(), part.index[open_].tolist()
        for key, word, far, i in zip(*columns, strict=True):
            kinds.setdefault(Kind(id(part.known), word, *key), []).append((-far, i))
    return {kind: [i for _, i in sorted(members)] for kind, members in kinds.items()}


def nearly_meeting(parts: Sequence[Part]) -> list[int]:
    """Return points of paths of equilibria with an eigenvalue that has a side although it is nearly zero."""
    found: list[int] = []
    for part in parts:
        size = np.abs(part.found.values)
        slow = np.any(
            (size <= TOLERANCES.neutral_elsewhere * part.found.sizes[:, None]) & (part.found.sides != OPEN), axis=1
        )
        found += [] if part.alone else part.index[slow].tolist()
    return found


def settle(parts: Sequence[Part], points: Sequence[int], word: int) -> None:
    """Set the verdict of points, except those that were computed in full."""
    for part in parts:
        if not part.alone:
            part.found.words[np.isin(part.index, points)] = word


def spread(points: Sequence[int], number: int) -> list[int]:
    """Return so many of some points, from the first to the last one; all if there are fewer."""
    chosen = np.linspace(0, len(points) - 1, number).round().astype(int).tolist() if points else []
    return [points[k] for k in dict.fromkeys(chosen)]
