"""Eigenvalues at the points of a sweep and between them, joined into branches."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np

from mbstab.analysis.algebra.arrays import Complex, Flags, Index
from mbstab.analysis.algebra.matching import assigned
from mbstab.analysis.reference.paths import Path as Solutions
from mbstab.analysis.sweep.batched_spectra import Evaluator
from mbstab.analysis.sweep.blocks import Block
from mbstab.analysis.sweep.shapes import Shapes, Told, told
from mbstab.analysis.sweep.spectra import NO_EIGENVALUE, WORD, Spectra, pinned, settled, unplaced
from mbstab.analysis.sweep.tolerances import TOLERANCES
from mbstab.analysis.sweep.tracking import doubtful, follow, has_twins, together, uncertain
from mbstab.analysis.verdict.rule import OPEN, UNDECIDED, Sides
from mbstab.compiler.system import Array
from mbstab.model.schema import after_number
from mbstab.model.words import STABLE, STABLE_UP_TO
from mbstab.records import dataclass


@dataclass(frozen=True)
class _Piece:
    """A part of an interval between two points of the sweep, with the eigenvalues at its ends.

    Attributes
    ----------
    guesses : tuple of float
        Values of the parameter at which eigenvalues may meet.
    crowded : bool
        Whether eigenvalues that cannot be told apart may change stability.
    """

    interval: int
    a: float
    b: float
    before: Complex
    after: Complex
    guesses: tuple[float, ...] = ()
    crowded: bool = True


class Branches:
    """Eigenvalues at the points of a sweep and between them, joined into branches.

    Parameters
    ----------
    evaluator : Evaluator
    parameter : str
    x : ndarray, shape (points,)
    raw : Block
        The eigenvalues there.
    most : int, optional
        Maximum number of intermediate points.
    locates : float, optional
        Eigenvalues that come near to each other far from the axis, too, are told apart in intervals down to this part
        of the parameter. With `TOLERANCES.meeting_interval` it is told where they meet.
    """

    def __init__(
        self,
        evaluator: Evaluator,
        parameter: str,
        x: Array,
        raw: Block,
        most: int | None = None,
        locates: float = math.inf,
    ) -> None:
        self.evaluator, self.parameter, self.x, self.raw = evaluator, parameter, x, raw
        self.most, self.locates = TOLERANCES.branch_points if most is None else most, locates
        self.values = raw.values
        self.shapes: dict[float, Shapes | None] = {}
        self.linked = 0
        self.meetings: list[tuple[float, str]] = []
        self.looked: dict[float, Spectra] = {}
        self.between: list[float] = []
        self.good = ~np.any(np.isnan(raw.values), axis=1)
        self.unplaced = unplaced(raw.sides, raw.words, raw.problems)
        self.counts = settled(raw.sides, raw.words, self.unplaced)
        self.counts[~self.good] = -1
        self.spent, self.calls, self.size = 0, 0, 0.0
        self.stopped: tuple[int, int] | None = None
        self.near_axis = False
        self.width = max(float(np.max(np.abs(x), initial=0.0)), 1e-300)
        path = evaluator.path
        self.crossings = (
            []
            if not isinstance(path, Solutions)
            else [
                value
                for value in path.crossings
                if all(abs(value - end) > TOLERANCES.meeting_rounding * self.width for end, _ in path.ends)
            ]
        )

    @property
    def _locates(self) -> bool:
        """Whether eigenvalues are told apart far from the axis, too."""
        return self.locates < math.inf

    @property
    def _tells(self) -> bool:
        """Whether it is told where eigenvalues meet."""
        return self.locates <= TOLERANCES.meeting_interval

    @property
    def budget(self) -> int:
        """Maximum number of intermediate points."""
        return min(self.most, TOLERANCES.branch_eigenvalues // max(int(self.values.shape[1]), 1))

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about where the search ended early."""
        if self.stopped is None:
            return ()
        far = "no change of stability (they are far from the imaginary axis)"
        missing = (
            " and critical values may be missing"
            if self.near_axis
            else f" and values where they meet may be missing, {far}"
            if self._tells
            else f", {far}"
        )
        return (
            f"the refinement between points ended after {self.spent + self.linked} of them{self._where()}: branches "
            f"may be mistaken for each other{missing}; more points, a smaller range or --log help",
        )

    def _where(self) -> str:
        """Return between which points the search ended, in words."""
        assert self.stopped is not None
        parameter = self.evaluator.model.parameters[self.parameter]
        unit = after_number(parameter.unit)
        low, high = (float(self.x[np.clip(k, 0, len(self.x) - 1)]) / parameter.factor for k in self.stopped)
        return f", between {self.parameter} = {low:.6g} and {high:.6g}{unit}"

    def _stop(self, value: float, near_axis: bool = True) -> None:
        """Record that the search ended at a value, and whether eigenvalues may reach the imaginary axis there."""
        self.near_axis |= near_axis
        k = int(np.searchsorted(self.x, value))
        known = self.stopped or (k - 1, k)
        self.stopped = min(known[0], k - 1), max(known[1], k)

    def at(self, points: Array) -> Complex:
        """Return the eigenvalues at further points, and store them; nan where there are none, or beyond the budget."""
        found = self._spectra(points)
        self.between += [float(p) for p, v in zip(points, found.values, strict=True) if not np.any(np.isnan(v))]
        return found.values

    def _spectra(self, points: Array, exact: bool = False, needed: bool = False) -> Spectra:
        """Return the eigenvalues at further points; nan where there are none, or beyond the budget unless `needed`."""
        self.calls += 1 + TOLERANCES.branch_looks_of_judgement * len(points) * exact
        if not needed and (self.spent + len(points) > self.budget or self.calls > TOLERANCES.branch_looks):
            for p in points[[0, -1]].tolist():
                self._stop(p)
            return self._nothing(points)
        self.spent += len(points)
        found = self.evaluator.near({self.parameter: points}, self.values.shape[1], exact)
        self.calls += TOLERANCES.branch_looks_alone * self.evaluator.alone
        self.size = max(self.size, float(np.max(found.sizes, initial=0.0)))
        found = replace(found, values=pinned(found.values, found.sides, found.sizes, self.unplaced))
        for n, p in enumerate(points.tolist()):
            self.looked[p] = found.at(n)
        return found

    def _nothing(self, points: Array) -> Spectra:
        """Return spectra of points of which nothing is known."""
        shape = len(points), self.values.shape[1]
        empty = Spectra(
            np.full(shape, NO_EIGENVALUE), np.full(shape, OPEN, dtype=np.int8),
            np.full(len(points), WORD[UNDECIDED], dtype=np.int8), np.zeros(len(points), dtype=bool),
            {}, 0, np.zeros(len(points)), np.zeros((len(points), 0)),
        )  # fmt: skip
        for n, p in enumerate(points.tolist()):
            self.looked.setdefault(p, empty.at(n))
        return empty

    def sides(self, branches: Complex, rows: Index) -> Sides:
        """Return the sides of eigenvalues in the columns of branches at some points."""
        # Columns of branches are those of the block in another order.
        order = np.argmin(np.abs(self.values[rows][:, None, :] - branches[rows][:, :, None]), axis=2)
        return np.take_along_axis(self.raw.sides[rows], order, axis=1)

    def look(self, points: Array, exact: bool = False) -> None:
        """Store the results at further points, beyond the budget too."""
        self._spectra(points, exact, needed=True)

    def _counted(self, points: Array, needed: bool = False) -> Index:
        """Return the numbers of unstable eigenvalues at intermediate points, each judged as `mbstab eig` does."""
        found = self._spectra(points, exact=True, needed=needed)
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
        # Elsewhere the order of the eigenvalues does not change.
        clear = self.raw.clear & ~doubtful(self.raw.clear, self.x)
        for k, link in sorted(self._links(good[:-1] & good[1:] & ~clear).items()):
            branches[start : k + 1] = values[start : k + 1, current]
            current, start = link[current], k + 1
        branches[start:] = values[start:, current]
        return branches

    def _links(self, unclear: Flags) -> dict[int, Index]:
        """Return the links of the eigenvalues in intervals where these are not clear from both ends."""
        x, values = self.x, self.values
        # Where some meet at a point, both intervals beside it are one: their links show only beyond it.
        twins = has_twins(values)
        meet = 1 + np.flatnonzero(unclear[:-1] & unclear[1:] & twins[1:-1] & ~twins[:-2] & ~twins[2:])
        single = np.flatnonzero(unclear & ~np.isin(np.arange(len(unclear)), [*(meet - 1), *meet]))
        ends = [(int(k), int(k) + 1) for k in single] + [(int(k) - 1, int(k) + 1) for k in meet]
        links = self._refined([_Piece(a, float(x[a]), float(x[b]), values[a], values[b]) for a, b in ends])
        for k in meet.tolist():
            here = assigned(np.abs(values[k - 1][:, None] - values[k][None, :]))
            links[k] = links[k - 1][np.argsort(here)]
            links[k - 1] = here
        return links

    def _refined(self, pieces: list[_Piece]) -> dict[int, Index]:
        """Divide intervals until eigenvalues can be followed through each part; return their links."""
        done: dict[int, list[tuple[_Piece, Index | None]]] = {piece.interval: [] for piece in pieces}
        inner = np.linspace(0.0, 1.0, TOLERANCES.branch_split + 1)[1:-1]
        multiple = {
            piece.interval: bool(has_twins(piece.before[None])[0] and has_twins(piece.after[None])[0])
            for piece in pieces
        }
        pieces = self._untold(pieces, done, multiple)
        while pieces:
            pieces, left = self._affordable(pieces)
            for piece in left:
                done[piece.interval].append((piece, None))
            if not pieces:
                break
            cuts = [
                np.array(piece.guesses) if piece.guesses else piece.a + inner * (piece.b - piece.a) for piece in pieces
            ]
            open_: list[_Piece] = []
            for piece, at, spectra in zip(pieces, cuts, self._between(pieces, cuts), strict=True):
                if (
                    np.any(np.isnan(spectra))
                    or piece.b - piece.a <= TOLERANCES.crossing_interval * self.width
                    or self._hidden(piece)
                    or (_equal(piece.before, *spectra, piece.after) and not multiple[piece.interval])
                ):
                    done[piece.interval].append((piece, None))
                    continue
                ends = np.array([piece.a, *at.tolist(), piece.b])
                values = np.array([piece.before, *spectra, piece.after])
                # Equal eigenvalues at an intermediate point are a meeting, unless they are equal from end to end.
                twins = np.full(len(at) + 1, multiple[piece.interval])
                links, clear = follow(values[:-1], values[1:], twins)
                clear &= ~doubtful(clear, ends)
                if not clear.all():
                    link, certain = together(values, np.diff(ends))
                    links = np.where((certain & ~clear)[:, None], link, links)
                    clear |= certain
                for n, (a, b) in enumerate(pairwise(ends.tolist())):
                    part = _Piece(piece.interval, a, b, values[n], values[n + 1])
                    if clear[n]:
                        done[part.interval].append((part, links[n]))
                    else:
                        open_.append(part)
            pieces = self._untold(open_, done, multiple)
        return {k: self._joined(sorted(parts, key=lambda item: item[0].a)) for k, parts in done.items()}

    def _between(self, pieces: list[_Piece], cuts: list[Array]) -> Iterator[Complex]:
        """Yield the eigenvalues at the points that divide each piece; nan where there are none."""
        alone = [at for piece, at in zip(pieces, cuts, strict=True) if not piece.crowded]
        self._learn(np.concatenate(alone) if alone else np.zeros(0))
        found: dict[float, Complex] = {p: x.values for p, x in self.shapes.items() if x is not None}
        judged = [
            at
            for piece, at in zip(pieces, cuts, strict=True)
            if piece.crowded or any(p not in found for p in at.tolist())
        ]
        if judged:
            at = np.unique(np.concatenate(judged))
            found |= dict(zip(at.tolist(), self.at(at), strict=True))
        for at in cuts:
            yield np.array([found[p] for p in at.tolist()])

    def _learn(self, points: Array) -> None:
        """Compute the eigenvectors at points where they are not known."""
        new = np.array(sorted({p for p in points.tolist() if p not in self.shapes}))
        if self.unplaced or not len(new):
            return
        self.shapes |= dict.fromkeys(new.tolist())
        self.linked += len(new)
        found = self.evaluator.shapes({self.parameter: new}, self.values.shape[1])
        self.shapes |= {float(new[i]): shape for i, shape in found.items()}

    def _untold(
        self, pieces: list[_Piece], done: dict[int, list[tuple[_Piece, Index | None]]], multiple: dict[int, bool]
    ) -> list[_Piece]:
        """Return the pieces that must be divided further; the others are done, with their links.

        Far from the axis eigenvectors tell which eigenvalue continues which, and what is left open changes no verdict.
        """
        self._learn(np.array([end for piece in pieces for end in (piece.a, piece.b)]))
        room, left = self._room(), list[_Piece]()
        for piece in pieces:
            ends = self.shapes.get(piece.a), self.shapes.get(piece.b)
            found = told(piece.before, piece.after, *ends)
            leaves = found is not None and any(x.collides for x in found.approaches)
            crowded = _near_axis(piece) and (leaves or not self._held(piece.interval))
            touches = found is not None and found.touches and not multiple[piece.interval]
            untold = not self._tells and not (self._is_wide(piece) if self._locates else all(ends))
            if found is None and not crowded and (room < TOLERANCES.branch_split or untold):
                done[piece.interval].append((piece, _straight(piece)))
                if room < TOLERANCES.branch_split:
                    self._stop(0.5 * (piece.a + piece.b), near_axis=False)
            elif found is not None and self._is_settled(piece, found, crowded, touches):
                done[piece.interval].append((piece, found.link))
                self._record(piece, found)
            else:
                guesses = _around(piece, found) if self._locates and found is not None and not touches else ()
                left.append(replace(piece, crowded=crowded, guesses=guesses))
                room -= TOLERANCES.branch_split * (not crowded)
        return left

    def _is_settled(self, piece: _Piece, found: Told, crowded: bool, touches: bool) -> bool:
        """Return whether what eigenvectors tell about a piece is enough: its links, or where eigenvalues meet in it."""
        if self._tells:
            return not touches and not (found.approaches and self._is_wide(piece))
        # Those that are not coupled pass each other on straight lines.
        bent = touches or any(x.coupled for x in found.approaches)
        return not (crowded and (found.coupled or touches)) and not (bent and self._is_wide(piece))

    def _is_wide(self, piece: _Piece) -> bool:
        """Return whether eigenvalues that come near to each other are told apart in a part of a piece."""
        return piece.b - piece.a > self.locates * self.width

    def _record(self, piece: _Piece, found: Told) -> None:
        """Record where eigenvalues meet in a piece, unless they only come near to each other."""
        for x in found.approaches if self._tells else ():
            if x.collides or not x.coupled:
                value = piece.a + x.t * (piece.b - piece.a)
                self.meetings.append((value, "collide" if x.collides else "cross"))

    def _room(self) -> int:
        """Return the number of points that may still be computed only to tell eigenvalues apart."""
        r = int(self.values.shape[1])
        most = max(TOLERANCES.branch_points_each * len(self.x), TOLERANCES.branch_eigenvalues_least // max(r, 1))
        return most * (TOLERANCES.branch_locating if self._locates else 1) - self.linked

    def _held(self, k: int) -> bool:
        """Return whether disturbances stay small at both ends of an interval without damping: by the energy."""
        return bool(np.isin(self.raw.words[k : k + 2], [WORD[STABLE], WORD[STABLE_UP_TO]]).all())

    def _affordable(self, pieces: list[_Piece]) -> tuple[list[_Piece], list[_Piece]]:
        """Return the pieces to divide further, and those that are too many because rounding crosses everywhere."""
        room = (self.budget - self.spent) // (TOLERANCES.branch_split - 1)
        number: dict[int, int] = {}
        for piece in pieces:
            number[piece.interval] = number.get(piece.interval, 0) + 1
        chosen = set()
        for interval in sorted(number, key=lambda k: number[k]):
            room -= number[interval]
            if number[interval] > TOLERANCES.branch_parts_crowded or room < 0:
                for piece in pieces:
                    if number[piece.interval] >= number[interval]:
                        self._stop(0.5 * (piece.a + piece.b), not _off_axis(piece))
                break
            chosen.add(interval)
        return [x for x in pieces if x.interval in chosen], [x for x in pieces if x.interval not in chosen]

    def _hidden(self, piece: _Piece) -> bool:
        """Return whether eigenvalues meet with unexplained zeros, so that rounding hides their links."""
        if not self.unplaced:
            return False
        small = (np.sort(np.abs(x))[min(self.unplaced, len(x) - 1)] for x in (piece.before, piece.after))
        # With the pair that passes them they are a multiple zero, which rounding moves by a root of its size.
        moved = max(TOLERANCES.unexplained_zero, float(np.finfo(float).eps) ** (1.0 / (self.unplaced + 2)))
        return bool(max(small) <= 10.0 * moved * self.size)

    def _joined(self, parts: list[tuple[_Piece, Index | None]]) -> Index:
        """Return the links of the eigenvalues through the parts of an interval."""
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
        """Return the links of eigenvalues that meet: crossing ones continue straight."""
        a, b = middle[0][0].a, middle[-1][0].b
        before, after = middle[0][0].before, middle[-1][0].after
        far_before, reach_left = _reach(left[::-1], before, -1)
        far_after, reach_right = _reach(right, after, 1)
        # Straight: judged from as far as the eigenvalues can be followed on both sides.
        step = (b + reach_right) - (a - reach_left)
        slope = (before - far_before) / reach_left if reach_left else 0.0 * before
        back = (far_after - after) / reach_right if reach_right else 0.0 * after
        ahead, behind = far_before + slope * step, far_after - back * step
        cost = np.abs(ahead[:, None] - far_after[None, :]) + np.abs(far_before[:, None] - behind[None, :])
        link = assigned(cost)
        # Only here: those that are equal everywhere do not meet.
        ends = [x for piece, _ in middle for x in (piece.before, piece.after)]
        outer = [(left or middle)[0][0].before, (right or middle)[-1][0].after]
        rounded = _equal(*ends) and not np.all(has_twins(np.array(outer)))
        for i, j in _close_pairs(before, after, link):
            g_before, g_after = (far_before[i] - far_before[j]) ** 2, (far_after[link[i]] - far_after[link[j]]) ** 2
            if not right and b < self.x[-1]:
                # They meet at a point of the sweep: their links show only beyond it.
                beyond = self.at(np.array([min(b + reach_left, float(self.x[-1]))]))[0]
                one, other = np.argsort(np.abs(beyond - 0.5 * (after[link[i]] + after[link[j]])))[:2]
                g_after = (beyond[one] - beyond[other]) ** 2
            collides = (g_before * np.conj(g_after)).real < 0.0
            # Equal where the range begins or ends: what happens beyond is not known.
            size = TOLERANCES.twin_distance**2 * float(np.max(np.abs(before))) ** 2
            open_end = (a == self.x[0] and abs(g_before) <= size) or (b == self.x[-1] and abs(g_after) <= size)
            found = (b - a <= TOLERANCES.meeting_interval * self.width or rounded) and not open_end
            if found and (left or a == self.x[0]):  # else it is the end of the previous interval, and reported there
                self.meetings.append((0.5 * (a + b), "collide" if collides else "cross"))
            if collides:
                # The direction is lost: the one that was ahead stays ahead.
                first, second = sorted((i, j), key=lambda k: (-far_before[k].real, -far_before[k].imag))
                one, other = sorted((link[i], link[j]), key=lambda k: (-far_after[k].real, -far_after[k].imag))
                link[first], link[second] = one, other
        return link


def _equal(*spectra: Complex) -> bool:
    """Return whether in all spectra some eigenvalues are equal up to rounding.

    Those near zero are left out: where a pair passes it, rounding moves them by the root of its size.
    """
    values = np.array(spectra)
    size = np.max(np.abs(values), axis=1, initial=0.0, keepdims=True)
    apart = np.where(np.abs(values) <= TOLERANCES.unexplained_zero * size, 1.0 + np.arange(values.shape[1]), 0.0)
    return bool(np.all(has_twins(values + 10.0 * size * apart, TOLERANCES.twin_rounding)))


def _straight(piece: _Piece) -> Index:
    """Return the links with the least sum of squares: those on a line keep their order."""
    return assigned(np.abs(piece.before[:, None] - piece.after[None, :]) ** 2)


def _near_axis(piece: _Piece) -> bool:
    """Return whether eigenvalues that move far beside their distance to the others may reach the imaginary axis."""
    link = _straight(piece)
    after = piece.after[link]
    moved = np.abs(after - piece.before)
    distance = np.minimum(np.abs(piece.before.real), np.abs(after.real))
    reach = (moved > TOLERANCES.tracking_step * distance) | (np.sign(piece.before.real) != np.sign(after.real))
    return bool(np.any(reach & uncertain(piece.before, piece.after, link)))


def _around(piece: _Piece, found: Told) -> tuple[float, ...]:
    """Return points beside those at which eigenvalues seem to meet; none where that is at an end of the piece."""
    t = np.array([x.t + side for x in found.approaches for side in (-TOLERANCES.meeting_part, TOLERANCES.meeting_part)])
    if not np.all((t > 0.0) & (t < 1.0)):
        return ()
    # The same meeting, seen from several eigenvalues, is found once.
    t = np.sort(t)
    apart = np.diff(t, prepend=-np.inf) > 0.5 * TOLERANCES.meeting_part
    return tuple((piece.a + t[apart] * (piece.b - piece.a)).tolist())


def _off_axis(piece: _Piece) -> bool:
    """Return whether eigenvalues move little beside their distance to the imaginary axis, or to the others."""
    moved = np.abs(piece.before[:, None] - piece.after[None, :])
    link = assigned(moved)
    after = piece.after[link]
    gap = [np.abs(x[:, None] - x[None, :]) + np.diag(np.full(len(x), np.inf)) for x in (piece.before, after)]
    apart = np.min(np.minimum(*gap), axis=1, initial=np.inf)
    distance = np.minimum(np.abs(piece.before.real), np.abs(after.real))
    return bool(np.all(np.abs(after - piece.before) <= TOLERANCES.tracking_step * np.maximum(apart, distance)))


def _reach(parts: list[tuple[_Piece, Index | None]], start: Complex, side: int) -> tuple[Complex, float]:
    """Follow eigenvalues away from a meeting; return them at the end, in the order of `start`, and the distance."""
    current, reach = np.arange(len(start)), 0.0
    where = start
    for piece, link in parts:
        if link is None or reach > TOLERANCES.direction_difference * (abs(piece.a) + abs(piece.b)):
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
    """Return pairs of eigenvalues that meet between two spectra: much nearer to each other than to all others."""
    r = len(before)
    gaps = np.abs(before[:, None] - before[None, :]) + np.abs(after[link][:, None] - after[link][None, :])
    gaps += np.diag(np.full(r, np.inf))
    size = float(np.max(np.abs(before)))
    return [
        (i, int(j))
        for i, j in enumerate(np.argmin(gaps, axis=1))
        if i < j and gaps[i, j] < 1e-4 * size and int(np.argmin(gaps[j])) == i
    ]
