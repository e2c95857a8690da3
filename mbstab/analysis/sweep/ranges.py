"""Ranges of the parameter with one verdict: what is said of the points of a sweep, and of what lies between them.

The verdict of an open interval is that of its inner points. A point at which the spectrum is special, as where an
eigenvalue is zero, speaks for itself only. So an interval takes the verdict of an end only if the point on the other
side of that end says the same; everything else is asked inside.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from mbstab.analysis.algebra.arrays import Complex
from mbstab.analysis.reference.paths import Path
from mbstab.analysis.sweep.critical import Critical
from mbstab.analysis.sweep.critical_values import CriticalValues
from mbstab.analysis.sweep.spectra import WORD, unstable_counts
from mbstab.analysis.sweep.tolerances import TOLERANCES
from mbstab.analysis.verdict.rule import UNDECIDED, UNSTABLE
from mbstab.compiler.system import Array
from mbstab.records import dataclass


@dataclass(frozen=True)
class Range:
    """A range of the parameter with one verdict, or a point of which something else is said than of what is beside it.

    Attributes
    ----------
    low, high : float
        In SI. Of the ends themselves nothing is said unless they are equal.
    word : int
        Number of the verdict among `mbstab.analysis.verdict.rule.WORDS`.
    counts : tuple of int
        Numbers of unstable eigenvalues in it, ascending; −1 where the verdict is open.
    """

    low: float
    high: float
    word: int
    counts: tuple[int, ...]

    @property
    def unstable(self) -> bool | None:
        """Whether the motion is unstable; None where that is open."""
        return None if self.word == WORD[UNDECIDED] else self.word == WORD[UNSTABLE]

    def like(self, other: Range) -> bool:
        """Return whether both say the same, also whether it is eigenvalues that make a motion unstable."""
        return self.word == other.word and (0 in self.counts) == (0 in other.counts)


@dataclass(frozen=True)
class _Place:
    """A value of the parameter with what is said there; nothing where there is no point, or it has no answer.

    At a critical value or an end of a path, which is marked, ranges end.
    """

    value: float
    said: Range | None = None
    marked: bool = False

    def continues(self, other: _Place) -> bool:
        """Return whether the next place says the same, so that neither is special."""
        if self.marked or other.marked or self.said is None or other.said is None:
            return False
        return self.said.like(other.said)


class Ranges:
    """What is said of the points of a sweep along one path, and of what lies between them.

    Parameters
    ----------
    tracker : CriticalValues
    words : ndarray of int8, shape (points,)
        Numbers of the verdicts at the points.
    """

    def __init__(self, tracker: CriticalValues, words: npt.NDArray[np.int8]) -> None:
        self.tracker, self.near = tracker, TOLERANCES.at_end_of_range * tracker.width
        self.zeros = bool(np.any(words != tracker.raw.words))
        counts = unstable_counts(tracker.raw.sides, words)
        said = (Range(*x) for x in _columns(tracker.x, words, counts))
        lost = ~tracker.good
        lost[list(tracker.raw.problems)] = True
        self.points = [
            _Place(x, None if gone else at) for x, at, gone in zip(tracker.x.tolist(), said, lost.tolist(), strict=True)
        ]
        self.inner: dict[tuple[float, float], list[Range]] = {}

    def told(self, critical: Sequence[Critical]) -> tuple[Range, ...]:
        """Return the ranges between critical values, ascending, each as long as possible."""
        places = self._places(critical)
        found, open_ = list[Range](), False
        for k, here in enumerate(places):
            for said in (here.said, self._between(places, k)):
                if said is None:
                    # Nothing is said of the place of a critical value between points.
                    open_ = open_ and said is here.said and here.marked
                elif open_ and found and not here.marked and found[-1].like(said):
                    counts = sorted({*found[-1].counts, *said.counts})
                    found[-1] = Range(found[-1].low, said.high, said.word, tuple(counts))
                else:
                    found.append(said)
                open_ = said is not None and not (here.marked and said is here.said)
        return tuple(found)

    def untold(self, critical: Sequence[Critical], branches: Complex) -> list[Critical]:
        """Return changes between stable and unstable that are no critical values so far."""
        places, found = self._places(critical), list[Critical]()
        last: Range | None = None
        self._ask(places)
        for k, here in enumerate(places):
            if here.marked or here.said is None:
                last = None
            own = [here.said] if here.said is not None and not here.marked and self._is_usual(places, k) else []
            for said in (*own, *self._inside(places, k)):
                if said.unstable is None:
                    continue
                if last is not None and last.unstable != said.unstable:
                    found += self._change(last, said, branches)
                last = said
        return found

    def _change(self, one: Range, other: Range, branches: Complex) -> list[Critical]:
        """Return the change between two points, of which one is unstable, dividing the interval."""
        width = np.inf
        while TOLERANCES.meeting_rounding * self.tracker.width < other.low - one.low < width:
            width = other.low - one.low
            inside = self._said(one.low + np.array(TOLERANCES.parts_asked) * width)
            decided = [one, *(x for x in inside if x is not None and x.unstable is not None), other]
            one, other = next((x, y) for x, y in pairwise(decided) if x.unstable != y.unstable)
        counts = max(one.counts[0], 0), max(other.counts[0], 0)
        return self.tracker.changed(one.low, other.low, counts, branches)

    def _places(self, critical: Sequence[Critical]) -> list[_Place]:
        """Return points and critical values, ascending; a critical value on a point is one place."""
        marks, path = {c.value for c in critical}, self.tracker.evaluator.path
        x = self.tracker.x
        if isinstance(path, Path) and len(x) and not x[0] <= path.start <= x[-1]:
            marks.add(path.start)
        places, apart = list(self.points), list[float]()
        for mark in marks:
            near = np.flatnonzero(np.abs(x - mark) <= self.near).tolist()
            for k in near:
                places[k] = _Place(places[k].value, places[k].said, True)
            apart += [] if near else [mark]
        return sorted([*places, *(_Place(mark, marked=True) for mark in apart)], key=lambda place: place.value)

    @staticmethod
    def _is_usual(places: Sequence[_Place], k: int) -> bool:
        """Return whether the point before or after a point says the same."""
        return any(0 <= j < len(places) and places[k].continues(places[j]) for j in (k - 1, k + 1))

    def _by_ends(self, places: Sequence[_Place], k: int) -> Range | None:
        """Return what the ends of the interval after a place say of it; None where that is open."""
        a, b = places[k : k + 2]
        if a.continues(b) or (b.marked and self._is_usual(places, k)):
            return a.said
        return b.said if a.marked and self._is_usual(places, k + 1) else None

    def _is_lost(self, places: Sequence[_Place], k: int) -> bool:
        """Return whether nothing can be said of the interval after a place."""
        if k + 1 == len(places) or places[k + 1].value - places[k].value <= self.near:
            return True
        return any(place.said is None and not place.marked for place in places[k : k + 2])

    def _ask(self, places: Sequence[_Place]) -> None:
        """Look inside the intervals whose ends do not tell their verdict."""
        ends = [(a.value, b.value) for a, b in pairwise(places)]
        asked = [k for k in range(len(ends)) if not self._is_lost(places, k) and self._by_ends(places, k) is None]
        asked = [k for k in asked if ends[k] not in self.inner][: TOLERANCES.intervals_asked]
        if not asked:
            return
        parts = TOLERANCES.parts_asked
        said = self._said(np.array([ends[k][0] + t * (ends[k][1] - ends[k][0]) for k in asked for t in parts]))
        for n, k in enumerate(asked):
            own = said[n * len(parts) : (n + 1) * len(parts)]
            self.inner[ends[k]] = [x for x in own if x is not None] if None not in own else []

    def _inside(self, places: Sequence[_Place], k: int) -> list[Range]:
        """Return what is said inside the interval after a place; nothing where its ends tell it."""
        return [] if k + 1 == len(places) else self.inner.get((places[k].value, places[k + 1].value), [])

    def _between(self, places: Sequence[_Place], k: int) -> Range | None:
        """Return what is said of the interval after a place; None where that is open."""
        if self._is_lost(places, k):
            return None
        said = self._by_ends(places, k)
        if said is None:
            inside = self._inside(places, k)
            said = inside[0] if inside and all(x.like(inside[0]) for x in inside) else None
        return said and Range(places[k].value, places[k + 1].value, said.word, said.counts)

    def _said(self, points: Array) -> list[Range | None]:
        """Return what is said of further points, as `mbstab eig` says it; None where there is no answer."""
        tracker = self.tracker
        tracker.look(points, exact=True)
        found = [tracker.looked[p] for p in points.tolist()]
        values, sides = np.array([x.values for x in found]), np.array([x.sides for x in found])
        words = np.array([int(x.words) for x in found], dtype=np.int8)
        lost = np.any(np.isnan(values), axis=1)
        open_ = np.flatnonzero((words == WORD[UNDECIDED]) & ~lost) if self.zeros else np.arange(0)
        if len(open_):
            at = {tracker.parameter: points[open_]}
            words[open_] = tracker.evaluator.at_zeros(at, values[open_], sides[open_])
        columns = _columns(points, words, unstable_counts(sides, words))
        return [None if gone else Range(*x) for x, gone in zip(columns, lost.tolist(), strict=True)]


def _columns(
    points: Array, words: npt.NDArray[np.int8], counts: npt.NDArray[np.intp]
) -> list[tuple[float, float, int, tuple[int, ...]]]:
    """Return what a `Range` has for each of some points."""
    rows = zip(points.tolist(), words.tolist(), counts.tolist(), strict=True)
    return [(p, p, word, (count,)) for p, word, count in rows]
