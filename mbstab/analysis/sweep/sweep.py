"""Sweeps of a parameter: eigenvalue branches, verdicts, and the values at which stability changes.

Every point is judged by the rule of `mbstab.analysis.linear.verdict`, as `mbstab eig` does
(`mbstab.analysis.sweep.batched_spectra`); a point that cannot be placed is undecided and counts for no side.
Branches are followed by continuity: between neighbouring points no eigenvalue may move by
more than a part of its distance to the others; intervals in which one does are divided until
that holds, or until two eigenvalues cross or collide, within a budget of points. Stability changes
are located by functions that are smooth there: the product of the eigenvalues where one passes
zero, the real part of a simple pair where it passes the axis, and, where the spectrum is symmetric
to the imaginary axis, the discriminant of λ², which passes zero where two pairs collide (real parts
grow from there like a root; Seyranian and Mailybaev 2003, chapter 4). A value that is found counts
if the verdicts on both sides of it confirm the change.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import islice, pairwise
from pathlib import Path

import numpy as np
import numpy.typing as npt

from mbstab.analysis.algebra.arrays import Complex, Flags, Index
from mbstab.analysis.algebra.matching import assigned
from mbstab.analysis.algebra.roots import root
from mbstab.analysis.linear.verdict import UNDECIDED, WORDS
from mbstab.analysis.reference.continuation import AGAIN, BRANCHES, HIDDEN, LONG, TURNS
from mbstab.analysis.reference.continuation import Path as Solutions
from mbstab.analysis.reference.continuation import follow as follow_path
from mbstab.analysis.sweep.batched_spectra import Evaluator, Spectra
from mbstab.analysis.sweep.batched_verdict import (
    HARDLY,
    OPEN,
    WORD,
    Sides,
    pinned,
    settled,
    signs,
    unplaced,
    unstable_counts,
)
from mbstab.analysis.sweep.jobs import Block, Progress, merged, run, stored, tasks
from mbstab.analysis.sweep.tracking import NO_EIGENVALUE, TWIN, discriminant, follow, has_twins, product, turning
from mbstab.compiler.system import Array
from mbstab.errors import MbstabError, NumericalError, UsageError
from mbstab.model.schema import Model, after_number

RESOLUTION = 1e-12
"""Eigenvalues that are not told apart in an interval of this relative width cross or collide in it."""

NARROW = 1e-6
"""Where eigenvalues meet is known if the interval is narrower than this part of the parameter."""

NOISE = 1e-7
"""So near to a meeting, relative to the parameter, rounding may show a pair on the wrong side."""

SPLIT = 8
"""Parts into which an interval is divided in which eigenvalues cannot be followed."""

SIDE = 1e-3
"""So far from a collision, relative to the parameter, the modes that meet are told apart."""

ZERO = 1e-6
"""A test function is zero where it is this small beside its values at the ends of the interval."""

APART, WIDE = 100.0, 0.1
"""Spectra are compared by products of eigenvalues if their sizes are within this factor, or the parameter is."""

BESIDE = 0.1
"""The number of unstable eigenvalues changes where it is looked at this part of the way to the ends of the interval."""

FINER, DEPTH = 32, 6
"""Parts into which an interval is divided in which a test function jumps, and how often."""

MARGIN = 2
"""So many points on either side are looked at with an interval in which stability may change."""

FEWEST = 24
"""Sweeps with fewer points are looked at between them as well."""

WIDELY = 100.0
"""Ends of an interval whose ratio is larger are divided evenly by ratio."""

BUDGET, ENTRIES = 100_000, 4_000_000
"""So many points in between are looked at at most, and so many eigenvalues of them are kept."""

CALLS, CAREFUL = 5_000, 8
"""Points in between are looked at so many times at most; to judge one as `mbstab eig` does counts as so many."""

OUTSIDE, ON_END = 1e-4, 1e-9
"""So far beyond a range, relative to the parameter, is seen what happens at its end, and so near it happens there."""

CROWDED = 150
"""An interval with more parts in which eigenvalues cannot be followed is not divided further: rounding moves them."""

POTENTIAL = 1e-8
"""Forces have a potential if K is symmetric and R antisymmetric to this."""

FAR = 1e-6
"""Where eigenvalues meet, their directions are taken over this part of the parameter's value."""


@dataclass(frozen=True)
class Critical:
    """A parameter value at which stability changes.

    Attributes
    ----------
    value : float
        In SI.
    kind : str
        ``divergence`` (an eigenvalue passes zero), ``flutter`` (a pair passes the imaginary
        axis), ``collision`` (two pairs meet on the imaginary axis), ``branch
        point`` (other equilibria branch off; stability need not change), ``fold`` (the path of
        equilibria turns back), ``loss of equilibrium`` (it ends), ``unresolved``.
    branches : tuple of int
        The branches that are involved.
    frequency : float (rad/s)
        Of the motion at the boundary; 0 for a divergence.
    unstable : tuple of int
        Number of unstable eigenvalues below and above; −1 where there are none to count.
    signatures : tuple of int or None
        Of a collision: the signs of the energies of the two modes that meet (Krein
        signatures); only modes of opposite sign can leave the axis.
    branching : bool
        Whether another path of equilibria crosses there.
    verdicts : tuple of str
        The verdicts next to it, below and above; empty where there is none.
    """

    value: float
    kind: str
    branches: tuple[int, ...]
    frequency: float
    unstable: tuple[int, int]
    signatures: tuple[int, int] | None = None
    branching: bool = False
    verdicts: tuple[str, str] = ("", "")


@dataclass(frozen=True)
class Sweep:
    """Eigenvalue branches over a parameter.

    Attributes
    ----------
    parameter : str
    values : ndarray, shape (points,)
        Of the parameter (SI), ascending or descending as asked for.
    branches : ndarray of complex, shape (points, r)
        Eigenvalues that are not neutral (1/s), one column for each branch; nan where there are none.
    unstable : ndarray of int, shape (points,)
        Number of unstable eigenvalues; −1 where the verdict is open, or there is no answer.
    neutral : int
        Number of neutral eigenvalues besides.
    critical : tuple of Critical
        In the order of the parameter.
    meetings : tuple of (float, str)
        Values at which two branches ``cross`` or ``collide``.
    problems : dict
        By the number of a point, why it has no eigenvalues.
    start : float or None
        The value from which equilibria were followed, where a file asks to find them.
    moved : str
        Why they were not followed from the first value.
    beyond : tuple of Sweep
        Along the paths to which the equilibria lead through folds: each from one fold to the next
        or to an end of the range, at those of the values that lie between.
    words : ndarray of int8, shape (points,)
        Numbers of the verdicts among `mbstab.analysis.linear.verdict.WORDS`; `verdicts` has them in words.
    warnings : tuple of str
        Where the search for critical values ended early.
    """

    parameter: str
    values: Array
    branches: Complex
    unstable: npt.NDArray[np.intp]
    neutral: int
    critical: tuple[Critical, ...]
    meetings: tuple[tuple[float, str], ...]
    problems: dict[int, str]
    start: float | None = None
    moved: str = ""
    beyond: tuple[Sweep, ...] = ()
    words: npt.NDArray[np.int8] = field(default_factory=lambda: np.zeros(0, dtype=np.int8))
    warnings: tuple[str, ...] = ()

    @property
    def verdicts(self) -> list[str]:
        """The verdict at each value, one of `mbstab.analysis.linear.verdict.WORDS`."""
        return [WORDS[word] for word in self.words]

    @property
    def unanswered(self) -> list[int]:
        """Numbers of the points that have no eigenvalues on any path."""
        answered = {float(x) for path in self.beyond for x in path.values[~path._lost()]}
        return [int(i) for i in np.flatnonzero(self._lost()) if float(self.values[i]) not in answered]

    def _lost(self) -> Flags:
        """Return which values have no answer on this path."""
        lost: Flags = np.any(np.isnan(self.branches), axis=1)
        lost[list(self.problems)] = True
        return lost


def sweep(
    model: Model,
    parameter: str,
    values: Array,
    settings: Mapping[str, float] | None = None,
    progress: Progress = lambda done: None,
    directory: Path | None = None,
    resume: bool = False,
    jobs: int = 1,
    cluster: str = "",
    keep: bool = False,
) -> Sweep:
    """Return the eigenvalue branches of a model over a parameter, and where stability changes.

    Parameters
    ----------
    model : Model
    parameter : str
    values : ndarray, shape (points,)
        Of the parameter (SI), ascending or descending.
    settings : mapping, optional
        Other parameters (SI).
    progress : callable, optional
        Is called with the part of the work that is done, from 0 to 1.
    directory : Path, optional
        Where finished blocks of points are kept; removed in the end …
    resume : bool
        Whether to go on with the blocks that are there.
    jobs, cluster
        Number of processes, or the address of a Dask scheduler.
    keep : bool
        … unless they are needed until the answer is written (`mbstab.analysis.sweep.jobs.discard`).

    Raises
    ------
    UsageError
        If the parameter is among the settings, or its values are not in order.
    MbstabError
        If no equilibrium is found to start from, where the file asks to find them.
    """
    settings = dict(settings or {})
    if parameter in settings:
        raise UsageError(f"{parameter} is swept and set at the same time")
    steps = np.diff(values)
    if not (np.all(steps > 0.0) or np.all(steps < 0.0)):
        raise UsageError(f"the values of {parameter} must ascend or descend")
    order = slice(None, None, -1) if len(values) > 1 and values[0] > values[-1] else slice(None)
    x = values[order]
    paths: list[Solutions | None] = [None]
    if model.reference.find is not None:
        main = follow_path(model, parameter, settings, float(x[0]), float(x[-1]), float(values[0]))
        paths = [main, *main.beyond]
    grids = [x, *(x[path.covers({parameter: x})] for path in paths[1:] if path is not None)]
    # What happens between the last point and a turn is seen from a point next to the turn.
    closer = [x if path is None else np.union1d(x, path.next_to_ends()) for x, path in zip(grids, paths, strict=True)]
    groups = [tasks(model, settings, {parameter: x}, path) for x, path in zip(closer, paths, strict=True)]
    all_tasks = [task for group in groups for task in group]
    with stored(directory, all_tasks, resume, keep) as store:
        blocks = iter(run(all_tasks, store, jobs, cluster, progress))
        found = [
            _at(x, _answer(model, parameter, settings, more, path, merged(list(islice(blocks, len(group))))))
            for x, more, path, group in zip(grids, closer, paths, groups, strict=True)
        ]
    return replace(_ordered(found[0], order), beyond=tuple(_ordered(result, order) for result in found[1:]))


def _answer(
    model: Model, parameter: str, settings: Mapping[str, float], x: Array, path: Solutions | None, raw: Block
) -> Sweep:
    """Return the branches and critical values along one path of solutions."""
    evaluator = Evaluator(model, settings, path)
    tracker = _Tracker(evaluator, parameter, x, raw)
    branches = tracker.branches()
    critical = tracker.critical(branches)
    # Zeros that nonlinear terms decide say nothing about where stability changes.
    words, open_ = raw.words.copy(), _undecided(raw)
    if len(open_):
        words[open_] = evaluator.at_zeros({parameter: x[open_]}, raw.values[open_], raw.sides[open_])
    if path is not None:
        others = [value for value in tracker.crossings if not tracker.known(value, critical)]
        critical = [replace(c, branching=any(tracker.known(x, [c]) for x in tracker.crossings)) for c in critical]
        critical += [tracker.branch_point(value, branches) for value in others]
        # The fold from which a further path starts is said with the path that leads to it.
        critical += [tracker.ended(value, reason) for value, reason in path.ends if value != path.start]
    critical.sort(key=lambda c: c.value)
    return Sweep(
        parameter, x, branches, unstable_counts(raw.sides, words), raw.neutral, tuple(critical),
        tuple(sorted(set(tracker.meetings))), raw.problems, None if path is None else path.start,
        "" if path is None else path.moved, (), words,
        tracker.warnings,
    )  # fmt: skip


def _undecided(raw: Block) -> Index:
    """Return the numbers of points that open eigenvalues leave undecided."""
    open_ = np.any(raw.sides == OPEN, axis=1) & (raw.words == WORD[UNDECIDED])
    open_[list(raw.problems)] = False
    return np.flatnonzero(open_)


def _at(x: Array, result: Sweep) -> Sweep:
    """Return a sweep at some of its points."""
    kept = np.flatnonzero(np.isin(result.values, x))
    problems = {n: result.problems[int(i)] for n, i in enumerate(kept) if int(i) in result.problems}
    return replace(
        result, values=x, branches=result.branches[kept], unstable=result.unstable[kept], words=result.words[kept],
        problems=problems,
    )  # fmt: skip


def _ordered(result: Sweep, order: slice) -> Sweep:
    """Return a sweep over ascending values in the order that was asked for."""
    last = len(result.values) - 1
    problems = {last - i if order.step else i: text for i, text in result.problems.items()}
    return replace(
        result,
        values=result.values[order],
        branches=result.branches[order],
        unstable=result.unstable[order],
        words=result.words[order],
        problems=dict(sorted(problems.items())),
    )


# --- branches -------------------------------------------------------------------------------------------------------


Test = Callable[[Complex, float], float]
"""A function of a spectrum and a typical size of its eigenvalues."""

Bracket = tuple[int, int, str, Test | None]
"""Numbers of two points, what happens between them, and a function of the spectrum that is zero there."""


@dataclass(frozen=True)
class _Piece:
    """A part of an interval between two points of the sweep, with the eigenvalues at its ends."""

    interval: int
    a: float
    b: float
    before: Complex
    after: Complex


@dataclass(frozen=True)
class _Looked:
    """What was found at a point in between: eigenvalues, their sides, whether the spectrum is symmetric, a verdict."""

    values: Complex
    sides: Sides
    mirrored: bool
    word: int


@dataclass(frozen=True)
class _Stretch:
    """Points that are close to each other, in continuous columns.

    Attributes
    ----------
    x : ndarray, shape (m,)
    values : ndarray of complex, shape (m, r)
    sides : ndarray of int8, shape (m, r)
    mirrored : ndarray of bool, shape (m,)
    counts : ndarray of int, shape (m,)
        Number of unstable eigenvalues; −1 where more are unplaced than elsewhere.
    """

    x: Array
    values: Complex
    sides: Sides
    mirrored: Flags
    counts: Index


class _Tracker:
    """Follows eigenvalues between the points of a sweep.

    Attributes
    ----------
    meetings : list of (float, str)
        Where two branches ``cross`` or ``collide``.
    looked : dict
        By points in between, what was found there …
    between : list of float
        … and those of them that count as points of the sweep.
    unplaced : int
        Number of eigenvalues that are nowhere placed: zeros that nothing explains.
    """

    def __init__(self, evaluator: Evaluator, parameter: str, x: Array, raw: Block) -> None:
        self.evaluator, self.parameter, self.x, self.raw = evaluator, parameter, x, raw
        self.values = raw.values
        evaluator.learn({parameter: x})
        self.meetings: list[tuple[float, str]] = []
        self.looked: dict[float, _Looked] = {}
        self.between: list[float] = []
        self.good = ~np.any(np.isnan(raw.values), axis=1)
        self.unplaced = unplaced(raw.sides, raw.words, raw.problems)
        self.counts = settled(raw.sides, raw.words, self.unplaced)
        self.counts[~self.good] = -1
        self.spent, self.calls, self.size = 0, 0, 0.0
        self.stopped: tuple[int, int] | None = None
        self.width = max(float(np.max(np.abs(x), initial=0.0)), 1e-300)
        path = evaluator.path
        self.crossings = (
            []
            if not isinstance(path, Solutions)
            else [
                value for value in path.crossings if all(abs(value - end) > NOISE * self.width for end, _ in path.ends)
            ]
        )

    @property
    def budget(self) -> int:
        """Number of points in between that may be looked at."""
        return min(BUDGET, ENTRIES // max(int(self.values.shape[1]), 1))

    @property
    def warnings(self) -> tuple[str, ...]:
        """Say where the search ended early."""
        if self.stopped is None:
            return ()
        return (
            f"the refinement between points ended after {self.spent} of them{self._where()}: branches may be mistaken "
            "for each other and critical values may be missing; more points, a smaller range or --log help",
        )

    def _where(self) -> str:
        """Say between which points the search ended."""
        assert self.stopped is not None
        parameter = self.evaluator.model.parameters[self.parameter]
        unit = after_number(parameter.unit)
        low, high = (float(self.x[np.clip(k, 0, len(self.x) - 1)]) / parameter.factor for k in self.stopped)
        return f", between {self.parameter} = {low:.6g} and {high:.6g}{unit}"

    def _stop(self, value: float) -> None:
        """Note that the search ended at a value."""
        k = int(np.searchsorted(self.x, value))
        known = self.stopped or (k - 1, k)
        self.stopped = min(known[0], k - 1), max(known[1], k)

    def at(self, points: Array) -> Complex:
        """Return the eigenvalues at further points, and keep them; nan where there are none, or too many were asked."""
        found = self._spectra(points)
        self.between += [float(p) for p, v in zip(points, found.values, strict=True) if not np.any(np.isnan(v))]
        return found.values

    def _spectra(self, points: Array, exact: bool = False) -> Spectra:
        """Return the eigenvalues at further points; nan where there are none, or too many were asked for."""
        self.calls += 1 + CAREFUL * len(points) * exact
        if self.spent + len(points) > self.budget or self.calls > CALLS:
            for p in points[[0, -1]].tolist():
                self._stop(p)
            return self._nothing(points)
        self.spent += len(points)
        found = self.evaluator.near({self.parameter: points}, self.values.shape[1], exact)
        self.size = max(self.size, float(np.max(found.sizes, initial=0.0)))
        found = replace(found, values=pinned(found.values, found.sides, found.sizes, self.unplaced))
        for n, p in enumerate(points.tolist()):
            self.looked[p] = _Looked(found.values[n], found.sides[n], bool(found.mirrored[n]), int(found.words[n]))
        return found

    def _nothing(self, points: Array) -> Spectra:
        """Return that nothing is known of points."""
        shape = len(points), self.values.shape[1]
        empty = Spectra(
            np.full(shape, NO_EIGENVALUE), np.full(shape, OPEN, dtype=np.int8),
            np.full(len(points), WORD[UNDECIDED], dtype=np.int8), np.zeros(len(points), dtype=bool),
            {}, 0, np.zeros(len(points)),
        )  # fmt: skip
        for n, p in enumerate(points.tolist()):
            self.looked.setdefault(p, _Looked(empty.values[n], empty.sides[n], False, WORD[UNDECIDED]))
        return empty

    def _counted(self, points: Array) -> Index:
        """Return the numbers of unstable eigenvalues at points between, each judged as `mbstab eig` does."""
        found = self._spectra(points, exact=True)
        counts = settled(found.sides, found.words, self.unplaced)
        counts[np.any(np.isnan(found.values), axis=1)] = -1
        return counts

    def branches(self) -> Complex:
        """Return the eigenvalues in columns that are continuous over the points."""
        values, good = self.values, self.good
        if values.shape[1] == 0 or not good.any():
            return values
        first, start = int(np.flatnonzero(good)[0]), 0
        current = np.lexsort((-values[first].imag, -values[first].real))
        branches = np.empty_like(values)
        # Elsewhere the order of the eigenvalues stays what it is.
        for k, link in sorted(self._refined(np.flatnonzero(good[:-1] & good[1:] & ~self.raw.clear)).items()):
            branches[start : k + 1] = values[start : k + 1, current]
            current, start = link[current], k + 1
        branches[start:] = values[start:, current]
        return branches

    def _refined(self, intervals: Index) -> dict[int, Index]:
        """Divide intervals until eigenvalues can be followed through each part; return what becomes what."""
        pieces = [
            _Piece(int(k), float(self.x[k]), float(self.x[k + 1]), self.values[k], self.values[k + 1])
            for k in intervals
        ]
        done: dict[int, list[tuple[_Piece, Index | None]]] = {int(k): [] for k in intervals}
        inner = np.linspace(0.0, 1.0, SPLIT + 1)[1:-1]
        equal = has_twins(self.values[intervals]) & has_twins(self.values[intervals + 1])
        multiple = dict(zip(intervals.tolist(), equal.tolist(), strict=True))
        while pieces:
            pieces, left = self._affordable(pieces)
            for piece in left:
                done[piece.interval].append((piece, None))
            if not pieces:
                break
            cuts = np.array([piece.a + inner * (piece.b - piece.a) for piece in pieces])
            found = self.at(cuts.ravel()).reshape(*cuts.shape, -1)
            parts: list[_Piece] = []
            for piece, at, spectra in zip(pieces, cuts, found, strict=True):
                if np.any(np.isnan(spectra)) or piece.b - piece.a <= RESOLUTION * self.width or self._hidden(piece):
                    done[piece.interval].append((piece, None))
                    continue
                ends = [piece.a, *(float(x) for x in at), piece.b]
                between = [piece.before, *spectra, piece.after]
                parts += [
                    _Piece(piece.interval, a, b, before, after)
                    for (a, b), (before, after) in zip(pairwise(ends), pairwise(between), strict=True)
                ]
            if not parts:
                break
            # Equal at a point in between is a meeting, unless it is so from end to end.
            twins = np.array([multiple[x.interval] for x in parts])
            links, clear = follow(np.array([x.before for x in parts]), np.array([x.after for x in parts]), twins)
            pieces = []
            for part, link, is_clear in zip(parts, links, clear, strict=True):
                if is_clear:
                    done[part.interval].append((part, link))
                else:
                    pieces.append(part)
        return {k: self._joined(sorted(parts, key=lambda item: item[0].a)) for k, parts in done.items()}

    def _affordable(self, pieces: list[_Piece]) -> tuple[list[_Piece], list[_Piece]]:
        """Return the pieces that may be divided further, and those that are too many: rounding crosses everywhere."""
        room = (self.budget - self.spent) // (SPLIT - 1)
        number: dict[int, int] = {}
        for piece in pieces:
            number[piece.interval] = number.get(piece.interval, 0) + 1
        chosen = set()
        for interval in sorted(number, key=lambda k: number[k]):
            room -= number[interval]
            if number[interval] > CROWDED or room < 0:
                for piece in pieces:
                    if number[piece.interval] >= number[interval]:
                        self._stop(0.5 * (piece.a + piece.b))
                break
            chosen.add(interval)
        return [x for x in pieces if x.interval in chosen], [x for x in pieces if x.interval not in chosen]

    def _hidden(self, piece: _Piece) -> bool:
        """Whether eigenvalues meet with zeros that nothing explains: how is hidden by rounding."""
        if not self.unplaced:
            return False
        small = (np.sort(np.abs(x))[min(self.unplaced, len(x) - 1)] for x in (piece.before, piece.after))
        return bool(max(small) <= 10.0 * HARDLY * self.size)

    def _joined(self, parts: list[tuple[_Piece, Index | None]]) -> Index:
        """Return what becomes of the eigenvalues through the parts of an interval."""
        current = np.arange(self.values.shape[1])
        n = 0
        while n < len(parts):
            link = parts[n][1]
            if link is None:
                last = n
                while last + 1 < len(parts) and parts[last + 1][1] is None:
                    last += 1
                link = self._through(parts[:n], parts[n : last + 1], parts[last + 1 :])
                n = last
            current = link[current]
            n += 1
        return current

    def _through(
        self,
        left: list[tuple[_Piece, Index | None]],
        middle: list[tuple[_Piece, Index | None]],
        right: list[tuple[_Piece, Index | None]],
    ) -> Index:
        """Return what becomes of eigenvalues that meet: those that cross go straight on."""
        a, b = middle[0][0].a, middle[-1][0].b
        before, after = middle[0][0].before, middle[-1][0].after
        far_before, reach_left = _reach(left[::-1], before, -1)
        far_after, reach_right = _reach(right, after, 1)
        # Straight on: from as far as the eigenvalues can be followed, as seen from both sides.
        step = (b + reach_right) - (a - reach_left)
        slope = (before - far_before) / reach_left if reach_left else 0.0 * before
        back = (far_after - after) / reach_right if reach_right else 0.0 * after
        ahead, behind = far_before + slope * step, far_after - back * step
        cost = np.abs(ahead[:, None] - far_after[None, :]) + np.abs(far_before[:, None] - behind[None, :])
        link = assigned(cost)
        for i, j in _close_pairs(before, after, link):
            g_before, g_after = (far_before[i] - far_before[j]) ** 2, (far_after[link[i]] - far_after[link[j]]) ** 2
            if not right and b < self.x[-1]:
                # They meet at a point of the sweep: what becomes of them is seen beyond it only.
                beyond = self.at(np.array([min(b + reach_left, float(self.x[-1]))]))[0]
                one, other = np.argsort(np.abs(beyond - 0.5 * (after[link[i]] + after[link[j]])))[:2]
                g_after = (beyond[one] - beyond[other]) ** 2
            collides = (g_before * np.conj(g_after)).real < 0.0
            # Equal where the range begins or ends: what they do there is not seen.
            size = TWIN**2 * float(np.max(np.abs(before))) ** 2
            open_end = (a == self.x[0] and abs(g_before) <= size) or (b == self.x[-1] and abs(g_after) <= size)
            found = b - a <= NARROW * self.width and not open_end
            if found and (left or a == self.x[0]):  # else it is the end of the interval before, and said there
                self.meetings.append((0.5 * (a + b), "collide" if collides else "cross"))
            if collides:
                # Direction is lost: the one that was ahead stays ahead.
                first, second = sorted((i, j), key=lambda k: (-far_before[k].real, -far_before[k].imag))
                one, other = sorted((link[i], link[j]), key=lambda k: (-far_after[k].real, -far_after[k].imag))
                link[first], link[second] = one, other
        return link

    # --- stability changes ------------------------------------------------------------------------------------------

    def critical(self, branches: Complex) -> list[Critical]:
        """Return where stability changes."""
        if len(self.x) < 2 or not self.values.shape[1]:
            return []
        self._look_inside()
        self._look_between(branches)
        found: list[Critical] = []
        for first, last in self._suspects(branches):
            found += self._changes(self._closer(first, last), branches)
        return found + self._at_ends(branches)

    def _at_ends(self, branches: Complex) -> list[Critical]:
        """Return where stability changes exactly at an end of the range: what is beyond it tells."""
        found: list[Critical] = []
        for end, inner in ((0, 1), (-1, -2)):
            if not self.good[end] or self.counts[end] >= 0 or not self.good[inner] or self.counts[inner] < 0:
                continue
            value = float(self.x[end])
            step = min(OUTSIDE * self.width, abs(float(self.x[inner]) - value))
            beyond = value + float(np.copysign(step, value - self.x[inner]))
            inside = value - (beyond - value)
            if np.any(np.isnan(self._spectra(np.array([inside, beyond])).values)):
                continue
            part = self._stretch(np.sort(np.array([inside, value, beyond])))
            changes = self._changes(part, branches)
            found += [
                replace(c, value=value)
                for c in changes
                if c.kind != "unresolved" and abs(c.value - value) <= ON_END * self.width
            ]
        return found

    def _changes(self, part: _Stretch, branches: Complex, depth: int = 0) -> list[Critical]:
        """Return where stability changes between points that are close to each other."""
        found: list[Critical] = []
        doubtful: list[tuple[int, int]] = []
        x = part.x
        for bracket in (*self._passing(part), *self._meeting(part)):
            critical = self._located(part, bracket, branches)
            if critical is not None:
                found.append(critical)
            elif bracket[:2] not in doubtful:
                doubtful.append(bracket[:2])
        doubtful += self._unexplained(part, found, doubtful)
        for a, b in doubtful:
            crossings = [value for value in self.crossings if x[a] < value < x[b]]
            if crossings:  # next to other equilibria those of the path are hard to tell
                found += [self.branch_point(value, branches) for value in crossings if not self.known(value, found)]
                continue
            # Branches are mistaken for each other there: more points tell them apart.
            more = _spaced(float(x[a]), float(x[b]))
            between = self.at(more[1:-1]) if depth < DEPTH else np.full((1, 1), NO_EIGENVALUE)
            if np.any(np.isnan(between)):
                inside: list[Critical] = []
            else:
                inside = self._changes(self._stretch(more, (part, a), (part, b)), branches, depth + 1)
            sides = int(part.counts[a]), int(part.counts[b])
            if not inside and min(sides) >= 0 and sides[0] != sides[1]:
                inside = [Critical(0.5 * (x[a] + x[b]), "unresolved", (), 0.0, sides)]
            found += inside
        return found

    def _unexplained(
        self, part: _Stretch, found: list[Critical], doubtful: list[tuple[int, int]]
    ) -> list[tuple[int, int]]:
        """Return pairs of points between which the number of unstable eigenvalues changes, and nothing says where."""
        x, missing = part.x, []
        for a, b in pairwise(np.flatnonzero(part.counts >= 0).tolist()):
            said = any(x[a] <= critical.value <= x[b] for critical in found)
            asked = any(first < b and a < last for first, last in doubtful)
            if part.counts[a] != part.counts[b] and not said and not asked:
                missing.append((a, b))
        return missing

    def _suspects(self, branches: Complex) -> list[tuple[int, int]]:
        """Return ranges of points, without gaps, in which stability may change."""
        good = self.good
        changes = np.zeros(len(good) - 1, dtype=bool)
        settled = np.flatnonzero(self.counts >= 0)
        for k in np.flatnonzero(np.diff(self.counts[settled])).tolist():
            changes[settled[k] : settled[k + 1]] = True
        watched = np.flatnonzero(self.raw.passes[:-1] | ~self.raw.clear)
        rows = np.unique(np.concatenate([watched, watched + 1]))
        sign = signs(self._sides(branches, rows))
        before, after = (sign[np.searchsorted(rows, k)] for k in (watched, watched + 1))
        changes[watched] |= np.any(before * after < 0, axis=1)
        changes[np.searchsorted(self.x, self.between) - 1] = True
        changes &= good[:-1] & good[1:]
        ranges: list[tuple[int, int]] = []
        for k in np.flatnonzero(changes).tolist():
            # A point or two more: a branch may lie on the axis at the end of an interval.
            first, last = k, k + 1
            while first > 0 and good[first - 1] and first > k - MARGIN:
                first -= 1
            while last < len(good) - 1 and good[last + 1] and last < k + 1 + MARGIN:
                last += 1
            if ranges and first <= ranges[-1][1]:
                ranges[-1] = ranges[-1][0], last
            else:
                ranges.append((first, last))
        return ranges

    def _sides(self, branches: Complex, rows: Index) -> Sides:
        """Return the sides of eigenvalues in the columns of branches at some points."""
        # Columns of branches are those of the block in another order.
        order = np.argmin(np.abs(self.values[rows][:, None, :] - branches[rows][:, :, None]), axis=2)
        return np.take_along_axis(self.raw.sides[rows], order, axis=1)

    def _closer(self, first: int, last: int) -> _Stretch:
        """Return the points of a range, those in between included, in continuous columns."""
        inside = [p for p in self.between if self.x[first] < p < self.x[last]]
        x = np.unique(np.concatenate([self.x[first : last + 1], inside]))
        return self._stretch(x)

    def _stretch(self, x: Array, *ends: tuple[_Stretch, int]) -> _Stretch:
        """Return points of the sweep, and such as were looked at, in continuous columns.

        Parameters
        ----------
        ends : tuple of (_Stretch, int), optional
            Where the first and the last of them are known already.
        """
        own = np.searchsorted(self.x, x)
        values, sides = (
            np.empty((len(x), self.values.shape[1]), dtype=complex),
            np.empty((len(x), self.values.shape[1]), dtype=np.int8),
        )
        mirrored, words = np.empty(len(x), dtype=bool), np.empty(len(x), dtype=np.int8)
        for n, (p, k) in enumerate(zip(x.tolist(), own.tolist(), strict=True)):
            if k < len(self.x) and self.x[k] == p:
                values[n], sides[n] = self.values[k], self.raw.sides[k]
                mirrored[n], words[n] = self.raw.mirrored[k], self.raw.words[k]
            else:
                looked = self.looked[p]
                values[n], sides[n], mirrored[n], words[n] = looked.values, looked.sides, looked.mirrored, looked.word
        order = self._linked(values)
        counts = settled(sides, words, self.unplaced)
        values, sides = (np.take_along_axis(part, order, axis=1) for part in (values, sides))
        return _Stretch(x, values, sides, mirrored, counts)

    def known(self, value: float, critical: list[Critical]) -> bool:
        """Whether a value is among critical ones."""
        return any(abs(c.value - value) < NOISE * self.width for c in critical)

    def branch_point(self, value: float, branches: Complex) -> Critical:
        """Return a place at which another path of equilibria crosses."""
        sides, words = self._beside(value)
        beside = self.at(np.array([value + FAR * self.width]))[0]
        if sides[0] == sides[1] or min(sides) < 0 or np.any(np.isnan(beside)):
            return Critical(value, "branch point", (), 0.0, sides, branching=True, verdicts=words)
        return replace(self._described(value, "divergence", beside, sides, branches), branching=True, verdicts=words)

    def ended(self, value: float, reason: str) -> Critical:
        """Return the end of a path of equilibria as a critical value."""
        kinds = {TURNS: "fold", BRANCHES: "branch point", **dict.fromkeys((AGAIN, LONG, HIDDEN), "unresolved")}
        kind = kinds.get(reason, "loss of equilibrium")
        sides, words = self._beside(value)
        return Critical(value, kind, (), 0.0, sides, verdicts=words)

    def _beside(self, value: float) -> tuple[tuple[int, int], tuple[str, str]]:
        """Return the number of unstable eigenvalues and the verdict below and above a place on the path.

        −1 and an empty text where it does not lead.
        """
        path = self.evaluator.path
        assert isinstance(path, Solutions)
        counts, words = [], []
        for end, sign in ((float(path.values[0]), -1.0), (float(path.values[-1]), 1.0)):
            room = sign * (end - value)
            count, word = -1, ""
            if room > NOISE * self.width:
                at = value + sign * min(FAR * self.width, 0.5 * room)
                count, word = int(self._counted(np.array([at]))[0]), WORDS[self.looked[at].word]
                known = np.flatnonzero((self.counts >= 0) & (sign * (self.x - value) > 0.0))
                if count < 0 and len(known):
                    nearest = known[np.argmin(np.abs(self.x[known] - value))]
                    count, word = int(self.counts[nearest]), WORDS[self.raw.words[nearest]]
            counts.append(count)
            words.append(word)
        return (counts[0], counts[1]), (words[0], words[1])

    def _linked(self, spectra: Complex) -> Index:
        """Return the orders in which spectra are in continuous columns, where eigenvalues do not meet."""
        links, clear = follow(spectra[:-1], spectra[1:])
        current = np.arange(spectra.shape[1])
        order = [current]
        for k, link in enumerate(links):
            if not clear[k]:
                link = assigned(np.abs(spectra[k][:, None] - spectra[k + 1][None, :]))
            current = link[current]
            order.append(current)
        return np.array(order)

    def _passing(self, part: _Stretch) -> Iterator[Bracket]:
        """Yield brackets in which a branch passes the imaginary axis, and the function that is zero there."""
        spectra, sign = part.values, signs(part.sides)
        size = np.max(np.abs(spectra), axis=1)
        for i in range(spectra.shape[1]):
            sure = np.flatnonzero(sign[:, i])
            for a, b in pairwise(sure):
                if sign[a, i] == sign[b, i] or (part.mirrored[a] and part.mirrored[b]):
                    continue
                before, after = complex(spectra[a, i]), complex(spectra[b, i])
                passing = _RealPart(0.5 * (before + after))
                # The product of all is smoother than the eigenvalue that passes, and may not change its sign.
                single = self._product(spectra[a], float(size[a])) * self._product(spectra[b], float(size[b])) < 0.0
                real = before.imag == 0.0 and after.imag == 0.0
                if real or (single and 0.0 in (before.imag, after.imag)):
                    # A pair may meet next to the axis, and one of the two pass it.
                    yield int(a), int(b), "divergence", self._product if single else passing
                elif before.imag >= 0.0 and after.imag >= 0.0:
                    yield int(a), int(b), "flutter", passing

    def _meeting(self, part: _Stretch) -> Iterator[Bracket]:
        """Yield brackets in which a spectrum that is symmetric to the axis loses or gains stability."""
        x, counts = part.x, part.counts
        settled = np.flatnonzero(counts >= 0)
        tests = (("divergence", self._product), ("collision", self._discriminant))
        for left, right in pairwise(settled.tolist()):
            if counts[left] == counts[right]:
                continue
            a, b = self._apart(part, settled, left, right)
            if not (part.mirrored[a] and part.mirrored[b]):
                continue
            before, after = part.values[a], part.values[b]
            if x[b] - x[a] > WIDE * max(abs(x[a]), abs(x[b])) and _far_apart(before, after):
                yield a, b, "collision", None
                continue
            size = float(np.max(np.abs([before, after])))
            passed = [(kind, test) for kind, test in tests if test(before, size) * test(after, size) < 0.0]
            yield (a, b, *(passed[0] if passed else ("collision", None)))

    def _apart(self, part: _Stretch, settled: Index, a: int, b: int) -> tuple[int, int]:
        """Return settled points on both sides of a change that are not so close that rounding hides it."""
        x, counts = part.x, part.counts
        near = NOISE * max(abs(float(x[a])), abs(float(x[b])), float(x[-1] - x[0]))
        i, j = int(np.searchsorted(settled, a)), int(np.searchsorted(settled, b))
        while i > 0 and x[settled[j]] - x[settled[i]] < near and counts[settled[i - 1]] == counts[a]:
            i -= 1
        while (
            j < len(settled) - 1 and x[settled[j]] - x[settled[i]] < 2.0 * near and counts[settled[j + 1]] == counts[b]
        ):
            j += 1
        return int(settled[i]), int(settled[j])

    def _product(self, spectrum: Complex, size: float) -> float:
        """Return the product of the eigenvalues apart from zeros that nothing explains."""
        return product(spectrum, size, self.unplaced)

    def _discriminant(self, spectrum: Complex, size: float) -> float:
        """Return the discriminant of λ² apart from zeros that nothing explains."""
        return discriminant(spectrum[np.argsort(np.abs(spectrum), kind="stable")[self.unplaced :]], size)

    def _look_inside(self) -> None:
        """Look between the points of a coarse sweep: at both ends all may be alike, and not in the middle.

        Paths of equilibria are followed by steps of their own.
        """
        coarse = len(self.x) <= FEWEST and self.evaluator.path is None
        each = -(-FEWEST // (len(self.x) - 1)) if coarse else 0
        for a, b in pairwise(self.x.tolist()) if each else ():
            parts = np.linspace(a, b, each + 2)[1:-1]
            if 0.0 < WIDELY * min(abs(a), abs(b)) < max(abs(a), abs(b)) and a * b > 0.0:
                parts = np.sign(a) * np.geomspace(abs(a), abs(b), each + 2)[1:-1]
            self.at(parts)

    def _look_between(self, branches: Complex) -> None:
        """Look at real parts that come close to the axis and turn back between points: they may have crossed it."""
        clear = self.raw.clear
        watched = np.flatnonzero(self.raw.turns[1:-1] | ~clear[:-1] | ~clear[1:]) + 1
        now = branches.real[watched]
        with np.errstate(invalid="ignore"):
            turns = turning(branches[watched - 1], branches[watched], branches[watched + 1])
        if not turns.any():
            return
        turns &= signs(self._sides(branches, watched)) != 0
        for k in np.flatnonzero(np.any(turns, axis=1)):
            a, b = float(self.x[watched[k] - 1]), float(self.x[watched[k] + 1])
            for _ in range(6):
                points = np.linspace(a, b, 9)[1:-1]
                found = self.at(points)
                if np.any(np.isnan(found)):
                    break
                sides = np.array([self.looked[p].sides for p in points.tolist()])
                highest = np.max(np.where(signs(sides) != 0, found.real, -np.inf), axis=1)
                best = int(np.argmax(highest)) if now[k][np.argmin(np.abs(now[k]))] < 0 else int(np.argmin(highest))
                a, b = (float(points[max(best - 1, 0)]), float(points[min(best + 1, len(points) - 1)]))

    def _located(self, part: _Stretch, bracket: Bracket, branches: Complex) -> Critical | None:
        """Return the stability change in a bracket; None if there is none that both sides confirm."""
        i, j, kind, test = bracket
        a, b, before, after = float(part.x[i]), float(part.x[j]), part.values[i], part.values[j]
        if test is None:
            return None

        def spectrum(p: float) -> Complex:
            found: Complex = self._spectra(np.array([p])).values[0]
            return found

        size = float(np.max(np.abs([before, after])))
        ends = test(before, size), test(after, size)
        if not ends[0] * ends[1] < 0.0:
            return None
        try:
            value = root(lambda p: test(spectrum(p), size), a, b)
        except NumericalError:
            return None
        # A test that jumps has no zero.
        if not abs(test(spectrum(value), size)) <= ZERO * max(abs(ends[0]), abs(ends[1])):
            return None
        counts, words = self._verified(part, i, j, value)
        # A pair that passes changes the number by two.
        if min(counts) < 0 or counts[0] == counts[1] or (kind == "flutter" and (counts[1] - counts[0]) % 2):
            return None
        there = spectrum(value)
        # Others may pass the axis at the same value.
        which = test.number(there) if isinstance(test, _RealPart) else None
        found = replace(self._described(value, kind, there, counts, branches, which), verdicts=words)
        if kind == "collision":
            stable = a if counts[0] < counts[1] else b
            found = replace(found, signatures=self._signatures(value, stable, found.frequency))
        return found

    def _verified(self, part: _Stretch, i: int, j: int, value: float) -> tuple[tuple[int, int], tuple[str, str]]:
        """Return the numbers of unstable eigenvalues and the verdicts on both sides of a value, (−1, −1) if in doubt.

        Both sides are judged as `mbstab eig` does, and must agree with the ends of the bracket where these are known.
        """
        a, b = float(part.x[i]), float(part.x[j])
        step = BESIDE * min(value - a, b - value)
        for places in ((value - step, value + step), (a, b)):
            if step <= NOISE * self.width and places[0] != a:
                continue
            found = self._counted(np.array(places))
            ends = part.counts[[i, j]]
            if np.any((found >= 0) & (ends >= 0) & (found != ends)):
                break
            if np.all(found >= 0):
                below, above = (WORDS[self.looked[p].word] for p in places)
                return (int(found[0]), int(found[1])), (below, above)
        return (-1, -1), ("", "")

    def _signatures(self, value: float, stable: float, frequency: float) -> tuple[int, int] | None:
        """Return the signs of the energies ω² x̄ᵀM x + x̄ᵀK x of the modes that meet, where they are apart.

        There are such energies where forces have a potential: K symmetric and R antisymmetric.
        """
        near = value + float(np.clip(stable - value, -SIDE * self.width, SIDE * self.width))
        try:
            values, shapes, linear = self.evaluator.modes({self.parameter: near})
        except MbstabError:
            return None
        spaces = linear.motion.spaces
        N = spaces.scale[:, None] * spaces.N
        K, R = N.T @ linear.K @ N, N.T @ linear.R @ N
        if np.max(np.abs(K - K.T)) > POTENTIAL * np.max(np.abs(K)) or np.max(np.abs(R + R.T)) > POTENTIAL * (
            np.max(np.abs(R)) + 1e-300
        ):
            return None
        order = np.argsort(np.abs(values - 1j * frequency))[:2]
        energies = [
            (abs(values[i]) ** 2 * (x.conj() @ linear.M @ x) + x.conj() @ linear.K @ x).real
            for i, x in ((i, shapes[:, i]) for i in order)
        ]
        return int(np.sign(energies[0])), int(np.sign(energies[1]))

    def _described(
        self,
        value: float,
        kind: str,
        spectrum: Complex,
        unstable: tuple[int, int],
        branches: Complex,
        which: int | None = None,
    ) -> Critical:
        """Return a critical value with the branches that are involved and their frequency."""
        if kind == "divergence":
            frequency, involved = 0.0, [int(np.argmin(np.abs(spectrum)))]
        elif kind == "collision":
            gaps = np.abs(spectrum[:, None] - spectrum[None, :]) + np.diag(np.full(len(spectrum), np.inf))
            i, j = divmod(int(np.argmin(gaps)), len(spectrum))
            frequency, involved = float(abs(0.5 * (spectrum[i] + spectrum[j]).imag)), [i, j]
        else:
            involved = [int(np.argmin(np.abs(spectrum.real))) if which is None else which]
            frequency = float(abs(spectrum[involved[0]].imag))
        k = int(np.clip(np.searchsorted(self.x, value), 0, len(self.x) - 1))
        row = branches[k] if not np.any(np.isnan(branches[k])) else branches[max(k - 1, 0)]
        links = assigned(np.abs(spectrum[:, None] - row[None, :]))
        return Critical(value, kind, tuple(sorted(int(links[i]) for i in involved)), frequency, unstable)


def _spaced(a: float, b: float) -> Array:
    """Return points from a to b: evenly spaced, and ever closer towards an end that is zero beside the other."""
    parts = np.linspace(0.0, 1.0, FINER + 1)
    if min(abs(a), abs(b)) < max(abs(a), abs(b)) / FINER:
        near = np.geomspace(1e-12, 1.0 / FINER, FINER)
        parts = np.union1d(parts, near if abs(a) < abs(b) else 1.0 - near)
    return np.asarray(np.append(a + parts[:-1] * (b - a), b))


def _far_apart(one: Complex, other: Complex) -> bool:
    """Whether spectra are so different in size that products of their eigenvalues cannot be compared."""
    sizes = sorted((float(np.max(np.abs(one))), float(np.max(np.abs(other)))))
    return sizes[1] > APART * sizes[0]


@dataclass(frozen=True)
class _RealPart:
    """The real part of the eigenvalue nearest to a place, as a function of a spectrum."""

    place: complex

    def number(self, spectrum: Complex) -> int:
        """Return which eigenvalue it is."""
        return int(np.argmin(np.abs(spectrum - self.place)))

    def __call__(self, spectrum: Complex, size: float) -> float:
        return float(spectrum[self.number(spectrum)].real) / size


def _reach(parts: list[tuple[_Piece, Index | None]], start: Complex, side: int) -> tuple[Complex, float]:
    """Follow eigenvalues away from a meeting; return them there, in the order of `start`, and how far it is."""
    current, reach = np.arange(len(start)), 0.0
    where = start
    for piece, link in parts:
        if link is None or reach > FAR * (abs(piece.a) + abs(piece.b)):
            break
        if side > 0:
            current = link[current]
            where = piece.after[current]
        else:
            current = np.argsort(link)[current]
            where = piece.before[current]
        reach += piece.b - piece.a
    return where, reach


def _close_pairs(before: Complex, after: Complex, link: Index) -> list[tuple[int, int]]:
    """Return pairs of eigenvalues that meet between two spectra: nearer to each other than to all others by far."""
    r = len(before)
    gaps = np.abs(before[:, None] - before[None, :]) + np.abs(after[link][:, None] - after[link][None, :])
    gaps += np.diag(np.full(r, np.inf))
    size = float(np.max(np.abs(before)))
    return [
        (i, int(j))
        for i, j in enumerate(np.argmin(gaps, axis=1))
        if i < j and gaps[i, j] < 1e-4 * size and int(np.argmin(gaps[j])) == i
    ]
