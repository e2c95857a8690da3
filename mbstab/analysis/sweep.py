"""Sweeps of a parameter: eigenvalue branches, and the values at which stability changes.

Branches are followed by continuity: between neighbouring points no eigenvalue may move by
more than a part of its distance to the others; intervals in which one does are divided until
that holds, or until two eigenvalues cross or collide. Stability changes are located by
functions that are smooth there: the product of the eigenvalues where one passes zero, the
real part of a simple pair where it passes the axis, and, where the spectrum is symmetric to
the imaginary axis, the discriminant of λ², which passes zero where two pairs collide (real
parts grow from there like a root; Seyranian and Mailybaev 2003, chapter 4).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import islice, pairwise
from pathlib import Path

import numpy as np
import numpy.typing as npt

from mbstab.analysis.batch import Evaluator
from mbstab.analysis.blocks import Block, Progress, Store, key_of, run, tasks
from mbstab.analysis.continuation import AGAIN, BRANCHES, TURNS
from mbstab.analysis.continuation import Path as Solutions
from mbstab.analysis.continuation import follow as follow_path
from mbstab.analysis.numerics import assigned, root
from mbstab.analysis.spectrum import (
    NO_EIGENVALUE,
    STABLE,
    SYMMETRIC,
    Complex,
    Index,
    discriminant,
    follow,
    has_twins,
    product,
    signs,
    symmetric,
    turning,
    unstable_counts,
)
from mbstab.compiler.system import Array
from mbstab.errors import MbstabError, NumericalError, UsageError
from mbstab.model.schema import Model

RESOLUTION = 1e-12
"""Eigenvalues that are not told apart in an interval of this relative width cross or collide in it."""

NOISE = 1e-7
"""So near to a meeting, relative to the parameter, rounding may show a pair on the wrong side."""

SPLIT = 8
"""Parts into which an interval is divided in which eigenvalues cannot be followed."""

SIDE = 1e-3
"""So far from a collision, relative to the parameter, the modes that meet are told apart."""

AT_END = 1e-8
"""A test function is zero at a point if it is this small beside its value at the next one."""

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
        Number of unstable eigenvalues below and above.
    signatures : tuple of int or None
        Of a collision: the signs of the energies of the two modes that meet (Krein
        signatures); only modes of opposite sign can leave the axis.
    branching : bool
        Whether another path of equilibria crosses there.
    """

    value: float
    kind: str
    branches: tuple[int, ...]
    frequency: float
    unstable: tuple[int, int]
    signatures: tuple[int, int] | None = None
    branching: bool = False


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
        Number of unstable eigenvalues; −1 where there are none to count.
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

    @property
    def unanswered(self) -> list[int]:
        """Numbers of the points that have no eigenvalues on any path."""
        elsewhere = {
            float(x) for path in self.beyond for x, n in zip(path.values, path.unstable, strict=True) if n >= 0
        }
        return [int(i) for i in np.flatnonzero(self.unstable < 0) if float(self.values[i]) not in elsewhere]


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
        Where finished blocks of points are kept; removed in the end.
    resume : bool
        Whether to go on with the blocks that are there.
    jobs, cluster
        Number of processes, or the address of a Dask scheduler.

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
    store = Store(directory, key_of(all_tasks), resume) if directory is not None else None
    blocks = iter(run(all_tasks, store, jobs, cluster, progress))
    found = [
        _at(x, _answer(model, parameter, settings, more, path, merged(list(islice(blocks, len(group))))))
        for x, more, path, group in zip(grids, closer, paths, groups, strict=True)
    ]
    if store is not None:
        store.remove()
    return replace(_ordered(found[0], order), beyond=tuple(_ordered(result, order) for result in found[1:]))


def _answer(
    model: Model, parameter: str, settings: Mapping[str, float], x: Array, path: Solutions | None, raw: Block
) -> Sweep:
    """Return the branches and critical values along one path of solutions."""
    tracker = _Tracker(Evaluator(model, settings, path), parameter, x, raw)
    branches = tracker.branches()
    critical = tracker.critical(branches)
    if path is not None:
        others = [value for value in tracker.crossings if not tracker.known(value, critical)]
        critical = [replace(c, branching=any(tracker.known(x, [c]) for x in tracker.crossings)) for c in critical]
        critical += [tracker.branch_point(value, branches) for value in others]
        # The fold from which a further path starts is said with the path that leads to it.
        critical += [tracker.ended(value, reason) for value, reason in path.ends if value != path.start]
    critical.sort(key=lambda c: c.value)
    return Sweep(
        parameter, x, branches, raw.unstable, raw.neutral, tuple(critical), tuple(sorted(set(tracker.meetings))),
        raw.problems, None if path is None else path.start, "" if path is None else path.moved,
    )  # fmt: skip


def _at(x: Array, result: Sweep) -> Sweep:
    """Return a sweep at some of its points."""
    kept = np.flatnonzero(np.isin(result.values, x))
    problems = {n: result.problems[int(i)] for n, i in enumerate(kept) if int(i) in result.problems}
    return replace(result, values=x, branches=result.branches[kept], unstable=result.unstable[kept], problems=problems)


def _ordered(result: Sweep, order: slice) -> Sweep:
    """Return a sweep over ascending values in the order that was asked for."""
    last = len(result.values) - 1
    problems = {last - i if order.step else i: text for i, text in result.problems.items()}
    return replace(
        result,
        values=result.values[order],
        branches=result.branches[order],
        unstable=result.unstable[order],
        problems=dict(sorted(problems.items())),
    )


def merged(blocks: list[Block]) -> Block:
    """Return consecutive blocks as one, with as many neutral eigenvalues as where there are fewest."""
    sizes: dict[int, int] = {}
    answered = [block for block in blocks if np.any(block.unstable >= 0)]
    for block in answered:
        total = block.values.shape[1] + block.neutral
        sizes[total] = sizes.get(total, 0) + len(block.values)
    total = max(sizes, key=lambda key: sizes[key]) if sizes else 0
    neutral = min((x.neutral for x in answered if x.values.shape[1] + x.neutral == total), default=0)
    count = total - neutral
    values = np.full((sum(len(block.values) for block in blocks), count), NO_EIGENVALUE)
    clear, unstable, passes, turns, known = [], [], [], [], []
    problems: dict[int, str] = {}
    start = 0
    for block in blocks:
        points = len(block.values)
        here = block.values.shape[1] + block.neutral
        fits = here == total and bool(np.any(block.unstable >= 0))
        problems |= {start + i: text for i, text in block.problems.items()}
        if not fits:
            text = f"{here} finite eigenvalues exist here, elsewhere {total}"
            problems |= {start + i: problems.get(start + i, text) for i in range(points)}
        if fits:
            # Zeros of a symmetry that is not there elsewhere.
            further = count - block.values.shape[1]
            values[start : start + points] = np.pad(block.values, ((0, 0), (0, further)))
        if start:
            link, is_clear = follow(values[start - 1 : start], values[start : start + 1])
            clear.append(is_clear)
            if fits and is_clear[0] and count > 1 and np.any(link[0] != np.arange(count)):
                values[start : start + points] = values[start : start + points, link[0]]
        clear.append(block.clear if fits else np.zeros(points - 1, dtype=bool))
        unstable.append(block.unstable if fits else np.full(points, -1))
        passes.append(block.passes)
        turns.append(block.turns)
        known.append(block.known)
        start += points
    return Block(
        values,
        np.concatenate(clear),
        problems,
        neutral,
        np.concatenate(unstable),
        np.concatenate(passes),
        np.concatenate(turns),
        np.concatenate(known),
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


class _Tracker:
    """Follows eigenvalues between the points of a sweep.

    Attributes
    ----------
    meetings : list of (float, str)
        Where two branches ``cross`` or ``collide``.
    between : list of (float, ndarray)
        Spectra at points in between, where they were needed.
    roundings : dict
        By points in between, to what their spectra are known.
    """

    def __init__(self, evaluator: Evaluator, parameter: str, x: Array, raw: Block) -> None:
        self.evaluator, self.parameter, self.x, self.raw = evaluator, parameter, x, raw
        self.values = raw.values
        evaluator.learn({parameter: x})
        self.meetings: list[tuple[float, str]] = []
        self.between: list[tuple[float, Complex]] = []
        self.roundings: dict[float, Array] = {}
        self.width = max(float(np.max(np.abs(x), initial=0.0)), 1e-300)
        path = evaluator.path
        self.crossings = (
            []
            if not isinstance(path, Solutions)
            else [
                value for value in path.crossings if all(abs(value - end) > NOISE * self.width for end, _ in path.ends)
            ]
        )

    def at(self, points: Array) -> Complex:
        """Return the eigenvalues at further points, and keep them."""
        found = self._spectra(points)
        self.between += [(float(p), v) for p, v in zip(points, found, strict=True) if not np.any(np.isnan(v))]
        return found

    def _spectra(self, points: Array) -> Complex:
        """Return the eigenvalues at further points."""
        found = self.evaluator.near({self.parameter: points}, self.values.shape[1])
        self.roundings |= zip(map(float, points), found.known, strict=True)
        return found.values

    def _known(self, points: Array) -> Array:
        """Return to what the spectra at points, those of the sweep or others, are known."""
        own = np.searchsorted(self.x, points)
        rows = [
            self.roundings[p] if p in self.roundings else self.raw.known[k]
            for p, k in zip(map(float, points), own, strict=True)
        ]
        return np.array(rows)

    def _counts(self, points: Array, spectra: Complex) -> npt.NDArray[np.intp]:
        """Return the number of unstable eigenvalues of the spectra at some points."""
        return unstable_counts(spectra, self._known(points))

    def branches(self) -> Complex:
        """Return the eigenvalues in columns that are continuous over the points."""
        values = self.values
        good = self.raw.unstable >= 0
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
            cuts = np.array([piece.a + inner * (piece.b - piece.a) for piece in pieces])
            found = self.at(cuts.ravel()).reshape(*cuts.shape, -1)
            parts: list[_Piece] = []
            for piece, at, spectra in zip(pieces, cuts, found, strict=True):
                if np.any(np.isnan(spectra)) or piece.b - piece.a <= RESOLUTION * self.width:
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
            if left or a == self.x[0]:  # else it is the end of the interval before, and said there
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
        self._look_between(branches)
        found: list[Critical] = []
        for first, last in self._suspects(branches):
            found += self._changes(*self._closer(first, last), branches)
        return found

    def _changes(self, x: Array, spectra: Complex, branches: Complex, depth: int = 0) -> list[Critical]:
        """Return where stability changes between points that are close to each other."""
        found: list[Critical] = []
        doubtful: list[tuple[int, int]] = []
        for a, b, kind, test in (*self._passing(x, spectra), *self._meeting(x, spectra)):
            critical = self._located(x[a], x[b], spectra[a], spectra[b], kind, test, branches)
            if critical is not None:
                found.append(critical)
            elif (a, b) not in doubtful:
                doubtful.append((a, b))
        for a, b in doubtful:
            crossings = [value for value in self.crossings if x[a] < value < x[b]]
            if crossings:  # next to other equilibria those of the path are hard to tell
                found += [self.branch_point(value, branches) for value in crossings if not self.known(value, found)]
                continue
            # Branches are mistaken for each other there: more points tell them apart.
            more = _spaced(float(x[a]), float(x[b]))
            between = self.at(more[1:-1])
            if depth == DEPTH or np.any(np.isnan(between)):
                counts = self._counts(x[[a, b]], spectra[[a, b]])
                sides = int(counts[0]), int(counts[1])
                found.append(Critical(0.5 * (x[a] + x[b]), "unresolved", (), 0.0, sides))
                continue
            closer = self._linked(np.concatenate([spectra[a : a + 1], between, spectra[b : b + 1]]))
            found += self._changes(more, closer, branches, depth + 1)
        return found

    def _suspects(self, branches: Complex) -> list[tuple[int, int]]:
        """Return ranges of points, without gaps, in which stability may change."""
        good = self.raw.unstable >= 0
        changes = self.raw.unstable[1:] != self.raw.unstable[:-1]
        watched = np.flatnonzero(self.raw.passes[:-1] | ~self.raw.clear)
        with np.errstate(invalid="ignore"):
            known = self.raw.known
            before, after = (signs(branches[k], known[k]) for k in (watched, watched + 1))
            changes[watched] |= np.any(before * after < 0.0, axis=1)
        changes[np.searchsorted(self.x, [p for p, _ in self.between]) - 1] = True
        changes &= good[:-1] & good[1:]
        ranges: list[tuple[int, int]] = []
        for k in np.flatnonzero(changes):
            # A point or two more: a branch may lie on the axis at the end of an interval.
            first, last = int(k), int(k) + 1
            while first > 0 and good[first - 1] and first > k - MARGIN:
                first -= 1
            while last < len(good) - 1 and good[last + 1] and last < k + 1 + MARGIN:
                last += 1
            if ranges and first <= ranges[-1][1]:
                ranges[-1] = ranges[-1][0], last
            else:
                ranges.append((first, last))
        return ranges

    def _closer(self, first: int, last: int) -> tuple[Array, Complex]:
        """Return the points of a range, those in between included, and their spectra in continuous columns."""
        inside = [(p, v) for p, v in self.between if self.x[first] < p < self.x[last]]
        x = np.concatenate([self.x[first : last + 1], [p for p, _ in inside]])
        spectra = np.concatenate([self.values[first : last + 1], *(v[None] for _, v in inside)])
        x, order = np.unique(x, return_index=True)
        return x, self._linked(spectra[order])

    def known(self, value: float, critical: list[Critical]) -> bool:
        """Whether a value is among critical ones."""
        return any(abs(c.value - value) < NOISE * self.width for c in critical)

    def branch_point(self, value: float, branches: Complex) -> Critical:
        """Return a place at which another path of equilibria crosses."""
        sides = self._sides(value)
        beside = self.at(np.array([value + FAR * self.width]))[0]
        if sides[0] == sides[1] or min(sides) < 0 or np.any(np.isnan(beside)):
            return Critical(value, "branch point", (), 0.0, sides, branching=True)
        return replace(self._described(value, "divergence", beside, sides, branches), branching=True)

    def ended(self, value: float, reason: str) -> Critical:
        """Return the end of a path of equilibria as a critical value."""
        kind = {TURNS: "fold", BRANCHES: "branch point", AGAIN: "unresolved"}.get(reason, "loss of equilibrium")
        return Critical(value, kind, (), 0.0, self._sides(value))

    def _sides(self, value: float) -> tuple[int, int]:
        """Return the number of unstable eigenvalues below and above a place on the path; −1 where it does not lead."""
        path = self.evaluator.path
        assert isinstance(path, Solutions)
        found = []
        for end, sign in ((float(path.values[0]), -1.0), (float(path.values[-1]), 1.0)):
            room = sign * (end - value)
            if room <= NOISE * self.width:
                found.append(-1)
                continue
            at = value + sign * min(FAR * self.width, 0.5 * room)
            here = np.array([at])
            count = int(self._counts(here, self.at(here))[0])
            if count < 0:
                known = np.flatnonzero((self.raw.unstable >= 0) & (sign * (self.x - value) > 0.0))
                nearest = known[np.argsort(np.abs(self.x[known] - value))][:1]
                count = int(self.raw.unstable[nearest[0]]) if len(nearest) else -1
            found.append(count)
        return found[0], found[1]

    def _linked(self, spectra: Complex) -> Complex:
        """Return spectra in columns that are continuous, where eigenvalues do not meet."""
        links, clear = follow(spectra[:-1], spectra[1:])
        current = np.arange(spectra.shape[1])
        order = [current]
        for k, link in enumerate(links):
            if not clear[k]:
                link = assigned(np.abs(spectra[k][:, None] - spectra[k + 1][None, :]))
            current = link[current]
            order.append(current)
        return np.take_along_axis(spectra, np.array(order), axis=1)

    def _passing(self, x: Array, spectra: Complex) -> Iterator[Bracket]:
        """Yield brackets in which a branch passes the imaginary axis, and the function that is zero there."""
        size, known = np.max(np.abs(spectra), axis=1), self._known(x)
        sign, both = signs(spectra, known), symmetric(spectra, known)
        for i in range(spectra.shape[1]):
            sure = np.flatnonzero(sign[:, i])
            for a, b in pairwise(sure):
                if sign[a, i] == sign[b, i] or (both[a] and both[b]):
                    continue
                before, after = complex(spectra[a, i]), complex(spectra[b, i])
                passing = _RealPart(0.5 * (before + after))
                if before.imag == 0.0 and after.imag == 0.0:
                    # The product of all is smoother than the eigenvalue that passes, and may not change its sign.
                    single = product(spectra[a], float(size[a])) * product(spectra[b], float(size[b])) < 0.0
                    yield int(a), int(b), "divergence", product if single else passing
                elif before.imag >= 0.0 and after.imag >= 0.0:
                    yield int(a), int(b), "flutter", passing

    def _meeting(self, x: Array, spectra: Complex) -> Iterator[Bracket]:
        """Yield brackets in which a spectrum that is symmetric to the axis loses or gains stability."""
        known = self._known(x)
        counts, both = unstable_counts(spectra, known), symmetric(spectra, known)
        changes = [int(k) for k in np.flatnonzero(counts[1:] != counts[:-1])]
        while changes:
            # Next to a meeting rounding decides on which side of the axis a point lies.
            a = changes.pop(0)
            b = a + 1
            near = NOISE * max(abs(x[a]), abs(x[b]), x[-1] - x[0])
            while changes and x[changes[0]] - x[b] < near:
                b = changes.pop(0) + 1
            while a > 0 and x[b] - x[a] < near:
                a -= 1
            while b < len(x) - 1 and x[b] - x[a] < 2.0 * near:
                b += 1
            if counts[a] == counts[b] or not (both[a] and both[b]):
                continue
            if x[b] - x[a] > WIDE * max(abs(x[a]), abs(x[b])) and _far_apart(spectra[a], spectra[b]):
                yield a, b, "collision", _no_zero
                continue
            tests = (("divergence", product), ("collision", discriminant))
            size = float(np.max(np.abs(spectra[[a, b]])))
            passed = [
                (kind, test)
                for kind, test in tests
                if _vanishes_between(test(spectra[a], size), test(spectra[b], size))
            ]
            yield (a, b, *(passed[0] if passed else ("unresolved", None)))

    def _look_between(self, branches: Complex) -> None:
        """Look at real parts that come close to the axis and turn back between points: they may have crossed it."""
        clear = self.raw.clear
        watched = np.flatnonzero(self.raw.turns[1:-1] | ~clear[:-1] | ~clear[1:]) + 1
        now = branches.real[watched]
        with np.errstate(invalid="ignore"):
            turns = turning(branches[watched - 1], branches[watched], branches[watched + 1])
        if not turns.any():
            return
        size = np.nanmax(np.abs(branches), initial=1e-300)
        turns &= np.abs(now) > STABLE * size
        for k in np.flatnonzero(np.any(turns, axis=1)):
            a, b = float(self.x[watched[k] - 1]), float(self.x[watched[k] + 1])
            for _ in range(6):
                points = np.linspace(a, b, 9)[1:-1]
                found = self.at(points)
                if np.any(np.isnan(found)):
                    break
                highest = np.max(np.where(np.abs(found.real) > STABLE * size, found.real, -np.inf), axis=1)
                best = int(np.argmax(highest)) if now[k][np.argmin(np.abs(now[k]))] < 0 else int(np.argmin(highest))
                a, b = (float(points[max(best - 1, 0)]), float(points[min(best + 1, len(points) - 1)]))

    def _located(
        self,
        a: float,
        b: float,
        before: Complex,
        after: Complex,
        kind: str,
        test: Test | None,
        branches: Complex,
    ) -> Critical | None:
        """Return the stability change in a bracket; None if there is none."""

        def spectrum(p: float) -> Complex:
            found: Complex = self._spectra(np.array([p]))[0]
            return found

        counts = self._counts(np.array([a, b]), np.array([before, after]))
        sides = int(counts[0]), int(counts[1])
        value, size = 0.5 * (a + b), float(np.max(np.abs([before, after])))
        if test is not None:
            ends = test(before, size), test(after, size)
            if math.isnan(ends[0]):
                return None
            if ends[0] * ends[1] < 0.0:
                try:
                    value = root(lambda p: test(spectrum(p), size), a, b)
                except NumericalError:
                    return None
                # A test that jumps has no zero.
                if not abs(test(spectrum(value), size)) <= ZERO * max(abs(ends[0]), abs(ends[1])):
                    return None
                step = BESIDE * min(value - a, b - value)
                sides_of = np.array([value - step, value + step])
                beside = self._counts(sides_of, self._spectra(sides_of))
                if step > NOISE * self.width and not np.array_equal(beside, counts):
                    return None
            else:  # the range begins or ends at the critical value
                value = a if abs(ends[0]) < abs(ends[1]) else b
                nearby = np.array([value + SIDE * (a + b - 2.0 * value)])
                inside = self._counts(nearby, self._spectra(nearby))[0]
                if inside != counts[int(value == a)]:
                    return None
        there = spectrum(value)
        # Others may pass the axis at the same value.
        which = test.number(there) if isinstance(test, _RealPart) else None
        found = self._described(value, kind, there, sides, branches, which)
        if kind == "collision":
            stable = a if counts[0] < counts[1] else b
            found = replace(found, signatures=self._signatures(value, stable, found.frequency))
        return found

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
        if np.max(np.abs(K - K.T)) > SYMMETRIC * np.max(np.abs(K)) or np.max(np.abs(R + R.T)) > SYMMETRIC * (
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


def _vanishes_between(one: float, other: float) -> bool:
    """Whether a function with these values at two neighbouring points is zero between them, or at one of them."""
    least, largest = sorted((abs(one), abs(other)))
    return one * other < 0.0 or least < AT_END * largest


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


def _no_zero(spectrum: Complex, size: float) -> float:
    """Say that an interval is too wide for a test."""
    return math.nan


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
