"""The values of a parameter at which stability changes: searched between points, located, verified, described."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise, repeat

import numpy as np

from mbstab.analysis.algebra.arrays import Complex, Index
from mbstab.analysis.algebra.matching import assigned
from mbstab.analysis.algebra.roots import Search
from mbstab.analysis.algebra.tolerances import EPS
from mbstab.analysis.reference.paths import Path as Solutions
from mbstab.analysis.reference.paths import PathEnd
from mbstab.analysis.sweep.brackets import Bracket, RealPart, Stretch, Test, far_apart, needed, spaced
from mbstab.analysis.sweep.branches import Branches
from mbstab.analysis.sweep.critical import Critical, kind_of
from mbstab.analysis.sweep.spectra import NO_EIGENVALUE, settled, signs, touching
from mbstab.analysis.sweep.tolerances import TOLERANCES
from mbstab.analysis.sweep.tracking import discriminant, follow, product, symmetric_product, turning
from mbstab.analysis.verdict.rule import OPEN, RIGHT, WORDS, Sides
from mbstab.compiler.system import Array
from mbstab.errors import MbstabError


def _link_of(spectra: Complex, branches: Complex) -> Index:
    """Return where the eigenvalues of one spectrum are in the next one, by columns in which they are continuous."""
    (before, after), (column, next_) = ([np.lexsort((x.imag, x.real)) for x in part] for part in (spectra, branches))
    to_column, place = np.empty_like(before), np.empty_like(before)
    to_column[before], place[next_] = column, after
    return place[to_column]


class CriticalValues(Branches):
    """Critical values of a sweep, found by following eigenvalues between its points.

    Attributes
    ----------
    meetings : list of (float, str)
        Where two branches ``cross`` or ``collide``.
    looked : dict
        Results at intermediate points …
    between : list of float
        … and those of these points that count as points of the sweep.
    unplaced : int
        Number of eigenvalues that are undecided everywhere: unexplained zeros.
    """

    # --- stability changes ------------------------------------------------------------------------------------------

    def critical(self, branches: Complex) -> list[Critical]:
        """Return where stability changes."""
        if len(self.x) < 2 or not self.values.shape[1]:
            return []
        self.roots: dict[tuple[float, float, Test], tuple[float, float] | None] = {}
        self._look_inside()
        self._look_between(branches)
        found: list[Critical] = []
        parts = [self._closer(first, last, branches) for first, last in self._suspects(branches)]
        brackets = [(part, bracket) for part in parts for bracket in (*self._passing(part), *self._meeting(part))]
        self._search(brackets)
        for part in parts:
            found += self._changes(part, branches)
        # Branches that pass the axis at the same value are found one by one, and described alike.
        different: list[Critical] = []
        ends = self._at_ends(branches)
        for c in [*(x for x in found if x.kind != "unresolved" or not self.known(x.value, ends)), *ends]:
            if not any(
                self.known(c.value, [other]) and replace(c, value=other.value, error=other.error) == other
                for other in different
            ):
                different.append(c)
        return different

    def _at_ends(self, branches: Complex) -> list[Critical]:
        """Return where stability changes exactly at an end of the range, as the spectra just beyond it show."""
        found: list[Critical] = []
        for end, inner in ((0, 1), (-1, -2)):
            if not (self.good[end] and self.good[inner]) or self.counts[inner] in (-1, self.counts[end]):
                continue
            # The eigenvalues there tell it, unless nonlinear terms do.
            if self.counts[end] >= 0 and not np.any(self.raw.sides[end] == OPEN):
                continue
            value = float(self.x[end])
            step = min(TOLERANCES.beyond_range * self.width, abs(float(self.x[inner]) - value))
            beyond = value + float(np.copysign(step, value - self.x[inner]))
            inside = value - (beyond - value)
            if np.any(np.isnan(self._spectra(np.array([inside, beyond])).values)):
                continue
            part = self._stretch(np.sort(np.array([inside, value, beyond])))
            changes = self._changes(part, branches)
            found += [
                replace(c, value=value)
                for c in changes
                if c.kind != "unresolved" and abs(c.value - value) <= TOLERANCES.at_end_of_range * self.width
            ]
        return found

    def _changes(self, part: Stretch, branches: Complex, depth: int = 0) -> list[Critical]:
        """Return where stability changes between points that are close to each other."""
        found: list[Critical] = []
        doubtful: list[tuple[int, int]] = []
        x = part.x
        for bracket in (*self._passing(part), *self._meeting(part)):
            critical = self._located(part, bracket, branches)
            if critical is not None:
                found.append(critical)
                continue
            if bracket.points not in doubtful:
                doubtful.append(bracket.points)
        for a, b in self._unexplained(part, found, doubtful):
            bracket = Bracket(*self._beyond_zeros(part, a, b), "divergence", self._product)
            critical = self._located(part, bracket, branches)
            if critical is None:
                doubtful.append((a, b))
            else:
                found.append(critical)
        for a, b in doubtful:
            if self._explained(part, found, a, b):
                continue
            crossings = [value for value in self.crossings if x[a] < value < x[b]]
            if crossings:  # near other equilibria those of the path are hard to identify
                found += [self.branch_point(value, branches) for value in crossings if not self.known(value, found)]
                continue
            settled = a + np.flatnonzero(part.counts[a : b + 1] >= 0)
            changing = [pair for pair in pairwise(settled.tolist()) if np.ptp(part.counts[list(pair)])]
            at_points = [self._beginning(part, pair, branches) for pair in changing]
            if at_points and all(at_points):
                found += [critical for group in at_points for critical in group]
                continue
            # Branches are confused there: more points separate them.
            more = spaced(float(x[a]), float(x[b]))
            between = self.at(more[1:-1]) if depth < TOLERANCES.jump_depth else np.full((1, 1), NO_EIGENVALUE)
            if np.any(np.isnan(between)):
                inside: list[Critical] = []
            else:
                inside = self._changes(self._stretch(more), branches, depth + 1)
            found += inside
        # The ends of what was doubtful may be undecided, although the points beside them are not.
        for a, b in self._unexplained(part, found, []):
            found += self._halved(part, a, b, branches)
        return found

    @staticmethod
    def _explained(part: Stretch, found: list[Critical], a: int, b: int) -> bool:
        """Return whether the changes found between two points account for their numbers of unstable eigenvalues.

        Then an eigenvalue that could not be located, such as one that passes through infinity, changes at these values.
        """
        inside = sorted({(c.value, *c.unstable) for c in found if part.x[a] <= c.value <= part.x[b]})
        counts = [int(part.counts[a]), *(count for _, *both in inside for count in both), int(part.counts[b])]
        return bool(inside) and counts[::2] == counts[1::2]

    def _halved(self, part: Stretch, a: int, b: int, branches: Complex) -> list[Critical]:
        """Return where the number of unstable eigenvalues changes, halving the interval.

        What passes there shows between two points so near to each other that only it moves from one side to the other.
        """
        counts = int(part.counts[a]), int(part.counts[b])
        low, high, open_ = float(part.x[a]), float(part.x[b]), False
        for width in (TOLERANCES.meeting_rounding, TOLERANCES.crossing_interval):
            while high - low > width * self.width and not open_:
                middle = 0.5 * (low + high)
                count = int(self._counted(np.array([middle]), needed=True)[0])
                open_ = count not in counts
                if not open_:
                    low, high = (middle, high) if count == counts[0] else (low, middle)
            near = self._stretch(np.array([low, high]))
            brackets = (*self._passing(near), *self._meeting(near))
            found = [c for bracket in brackets if (c := self._located(near, bracket, branches)) is not None]
            if found:
                return found
        place = self._pole(low, high)
        if place is not None:
            return [Critical(place[0], "infinity", (), 0.0, counts, error=place[1])]
        return self.changed(low, high, counts, branches)

    def changed(self, low: float, high: float, counts: tuple[int, int], branches: Complex) -> list[Critical]:
        """Return what happens between two values on either side of a change, as those that move tell.

        Next to the change an eigenvalue that grows is nearer to the real axis than to the imaginary one where it passes
        zero, and otherwise nearer to the imaginary one.
        """
        own = self.x[(self.x >= low) & (self.x <= high)]
        value = float(own[0]) if len(own) else 0.5 * (low + high)
        error = max(value - low, high - value)
        pair, end = self._stretch(np.array([low, high])), int(counts[1] > counts[0])
        moving = np.flatnonzero((pair.sides[0] == RIGHT) != (pair.sides[1] == RIGHT))
        growing, there = pair.values[end, moving], pair.values[0]
        if not len(moving):
            return [Critical(value, "unresolved", (), 0.0, counts, error=error)]
        numbers = self._columns_at(low, there, branches)
        if np.any(np.abs(growing.imag) <= np.abs(growing.real)):
            return [Critical(value, "divergence", tuple(sorted(numbers[moving].tolist())), 0.0, counts, error=error)]
        kind = "collision" if pair.mirrored.all() else "flutter"
        pairs = moving[growing.imag > 0.0].tolist() if kind == "flutter" else [None]
        found = (self._described(value, kind, pair.values[1 - end], counts, branches, i) for i in pairs)
        return [replace(c, error=error) for c in found]

    def _pole(self, low: float, high: float) -> tuple[float, float] | None:
        """Return where between two values a single eigenvalue is infinite, and an error; None if none is.

        The reciprocal of the product of all is zero there, and smooth. Far away a polynomial misses it by its own
        error, nearby eigenvalues are rounding: the distance at which the guess changes least is the best one.
        """
        each, count = TOLERANCES.pole_points, TOLERANCES.pole_distances
        reach = max(TOLERANCES.pole_reach * (high - low), TOLERANCES.meeting_rounding * self.width)
        steps = min(reach, low - float(self.x[0]), float(self.x[-1]) - high) * 0.5 ** np.arange(count)
        spectra = self._spectra(np.concatenate([low - steps, high + steps]), needed=True).values
        known = ~np.any(np.isnan(spectra), axis=1)
        size, guesses = float(np.max(np.abs(spectra[known]), initial=0.0)), list[tuple[float, float]]()
        for k in range(count - each + 1):
            chosen = np.r_[k : k + each, count + k + each - 1 : count + k - 1 : -1]
            x = np.concatenate([low - steps, high + steps])[chosen]
            products = [self._product(spectrum, size) for spectrum in spectra[chosen[known[chosen]]]]
            # Beside what is nearly infinite slow ones are zero.
            y = np.array([1.0 / product for product in products if product])
            if len(y) == len(x) and y[0] * y[-1] < 0.0 and np.all(np.diff(y) * np.sign(y[-1]) > 0.0):
                value, error = Search(x, y, each - 1, each).guess()
                guesses += [(error, value)] if low <= value <= high and error <= high - low else []
        return min(guesses)[::-1] if guesses else None

    def _beginning(self, part: Stretch, places: tuple[int, int], branches: Complex) -> list[Critical]:
        """Return a change exactly at a point where the spectrum is symmetric, as where damping begins at zero."""
        mirrored, counts, x = (of[list(places)].tolist() for of in (part.mirrored, part.counts, part.x))
        if mirrored[0] == mirrored[1]:
            return []
        end = int(mirrored[1])
        beside = float(x[end] + np.copysign(TOLERANCES.crossing_interval * self.width, x[1 - end] - x[end]))
        if int(self._counted(np.array([beside]), needed=True)[0]) != counts[1 - end]:
            return []
        low, high = sorted((x[end], beside))
        return self.changed(low, high, (counts[0], counts[1]), branches)

    def _unexplained(
        self, part: Stretch, found: list[Critical], doubtful: list[tuple[int, int]]
    ) -> list[tuple[int, int]]:
        """Return pairs of points between which the number of unstable eigenvalues changes without a value found."""
        x, missing = part.x, []
        # A point may lie on the critical value itself.
        near = TOLERANCES.meeting_rounding * self.width
        for a, b in pairwise(np.flatnonzero(part.counts >= 0).tolist()):
            said = any(x[a] - near <= critical.value <= x[b] + near for critical in found)
            asked = any(first < b and a < last for first, last in doubtful)
            if part.counts[a] != part.counts[b] and not said and not asked:
                missing.append((a, b))
        return missing

    def _beyond_zeros(self, part: Stretch, a: int, b: int) -> tuple[int, int]:
        """Return points with the same numbers of unstable eigenvalues, at which no more are on the axis than elsewhere.

        Where one passes zero beside another zero, branches may be exchanged, but their product changes its sign.
        """
        on_axis = np.sum(signs(part.sides) == 0, axis=1) > self.unplaced
        i, j = a, b
        while i > 0 and on_axis[i] and part.counts[i - 1] in (part.counts[a], -1):
            i -= 1
        while j < len(on_axis) - 1 and on_axis[j] and part.counts[j + 1] in (part.counts[b], -1):
            j += 1
        return (i, j) if part.counts[i] == part.counts[a] and part.counts[j] == part.counts[b] else (a, b)

    def _suspects(self, branches: Complex) -> list[tuple[int, int]]:
        """Return ranges of points, without gaps, in which stability may change."""
        good = self.good
        changes = np.zeros(len(good) - 1, dtype=bool)
        settled = np.flatnonzero(self.counts >= 0)
        for k in np.flatnonzero(np.diff(self.counts[settled])).tolist():
            changes[settled[k] : settled[k + 1]] = True
        # Branches may pass in both directions between two points; how they are linked is known in the end.
        passing = np.any(branches[:-1].real * branches[1:].real < 0.0, axis=1)
        watched = np.flatnonzero(self.raw.passes[:-1] | ~self.raw.clear | passing)
        rows = np.unique(np.concatenate([watched, watched + 1]))
        sign = signs(self.sides(branches, rows))
        before, after = (sign[np.searchsorted(rows, k)] for k in (watched, watched + 1))
        changes[watched] |= np.any(before * after < 0, axis=1)
        changes[np.searchsorted(self.x, self.between) - 1] = True
        changes &= good[:-1] & good[1:]
        ranges: list[tuple[int, int]] = []
        for k in np.flatnonzero(changes).tolist():
            # One or two points more: a branch may lie on the axis at the end of an interval.
            first, last = k, k + 1
            while first > 0 and good[first - 1] and first > k - TOLERANCES.points_beside:
                first -= 1
            while last < len(good) - 1 and good[last + 1] and last < k + 1 + TOLERANCES.points_beside:
                last += 1
            if ranges and first <= ranges[-1][1]:
                ranges[-1] = ranges[-1][0], last
            else:
                ranges.append((first, last))
        return ranges

    def _closer(self, first: int, last: int, branches: Complex) -> Stretch:
        """Return the points of a range, including intermediate ones, in continuous columns."""
        inside = [p for p in self.between if self.x[first] < p < self.x[last]]
        x = np.unique(np.concatenate([self.x[first : last + 1], inside]))
        return self._stretch(x, branches)

    def _stretch(self, x: Array, branches: Complex | None = None) -> Stretch:
        """Return points in continuous columns: two of the sweep as branches, if they are given."""
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
                values[n], sides[n], mirrored[n], words[n] = looked.values, looked.sides, looked.mirrored, looked.words
        places = np.where((own < len(self.x)) & (self.x[np.minimum(own, len(self.x) - 1)] == x), own, -1)
        order = self._linked(values, places, branches)
        counts = settled(sides, words, self.unplaced)
        values, sides = (np.take_along_axis(part, order, axis=1) for part in (values, sides))
        return Stretch(x, values, sides, mirrored, counts)

    def known(self, value: float, critical: list[Critical]) -> bool:
        """Return whether a value is among the critical ones."""
        return any(abs(c.value - value) < TOLERANCES.meeting_rounding * self.width for c in critical)

    def branch_point(self, value: float, branches: Complex) -> Critical:
        """Return a place at which another path of equilibria crosses."""
        sides, words = self._beside(value)
        beside = self.at(np.array([value + TOLERANCES.direction_difference * self.width]))[0]
        if sides[0] == sides[1] or min(sides) < 0 or np.any(np.isnan(beside)):
            return Critical(value, "branch point", (), 0.0, sides, branching=True, verdicts=words)
        return replace(self._described(value, "divergence", beside, sides, branches), branching=True, verdicts=words)

    def ended(self, value: float, reason: PathEnd) -> Critical:
        """Return the end of a path of equilibria as a critical value."""
        sides, words = self._beside(value)
        return Critical(value, kind_of(reason), (), 0.0, sides, verdicts=words)

    def _beside(self, value: float) -> tuple[tuple[int, int], tuple[str, str]]:
        """Return the number of unstable eigenvalues and the verdict below and above a place on the path.

        −1 and an empty text where the path does not exist.
        """
        path = self.evaluator.path
        assert isinstance(path, Solutions)
        counts, words = [], []
        for end, sign in ((float(path.values[0]), -1.0), (float(path.values[-1]), 1.0)):
            room = sign * (end - value)
            count, word = -1, ""
            if room > TOLERANCES.meeting_rounding * self.width:
                at = value + sign * min(TOLERANCES.direction_difference * self.width, 0.5 * room)
                count, word = int(self._counted(np.array([at]))[0]), WORDS[int(self.looked[at].words)]
                known = np.flatnonzero((self.counts >= 0) & (sign * (self.x - value) > 0.0))
                if count < 0 and len(known):
                    nearest = known[np.argmin(np.abs(self.x[known] - value))]
                    count, word = int(self.counts[nearest]), WORDS[self.raw.words[nearest]]
            counts.append(count)
            words.append(word)
        return (counts[0], counts[1]), (words[0], words[1])

    def _linked(self, spectra: Complex, places: Index, branches: Complex | None) -> Index:
        """Return the orders in which spectra are in continuous columns, where eigenvalues do not meet.

        `places` are the numbers of the points of the sweep, -1 for others. Branches know more than the distances of
        eigenvalues, which exchange those that pass each other; they count where more of them pass the axis.
        """
        links, clear = follow(spectra[:-1], spectra[1:])
        current = np.arange(spectra.shape[1])
        order = [current]
        for k, link in enumerate(links):
            if not clear[k]:
                link = assigned(np.abs(spectra[k][:, None] - spectra[k + 1][None, :]))
            if branches is not None and min(places[k], places[k + 1]) >= 0:
                known = _link_of(spectra[k : k + 2], branches[places[k : k + 2]])
                link = max(link, known, key=lambda x: np.sum(spectra[k].real * spectra[k + 1].real[x] < 0.0))
            current = link[current]
            order.append(current)
        return np.array(order)

    def _passing(self, part: Stretch) -> Iterator[Bracket]:
        """Yield brackets in which a branch passes the imaginary axis, and the function that is zero there."""
        spectra, sign = part.values, signs(part.sides)
        size = np.max(np.abs(spectra), axis=1)
        for i in range(spectra.shape[1]):
            sure = np.flatnonzero(sign[:, i])
            for left, right in pairwise(sure.tolist()):
                if sign[left, i] == sign[right, i] or (part.mirrored[left] and part.mirrored[right]):
                    continue
                a, b = self._apart(part.x, sure, sign[:, i], left, right)
                before, after = complex(spectra[a, i]), complex(spectra[b, i])
                passing = RealPart(float(part.x[a]), before, float(part.x[b]), after)
                # The product of all is smoother than the passing eigenvalue, but it need not change its sign.
                single = self._product(spectra[a], float(size[a])) * self._product(spectra[b], float(size[b])) < 0.0
                # Of two that are equal, rounding makes a pair.
                real = [abs(x.imag) <= TOLERANCES.twin_rounding * float(size[k]) for x, k in ((before, a), (after, b))]
                if all(real) or (single and any(real)):
                    # A pair may meet near the axis, and one of the two pass it.
                    yield Bracket(a, b, "divergence", self._product if single else passing, int(sign[b, i]))
                elif before.imag >= 0.0 and after.imag >= 0.0:
                    yield Bracket(a, b, "flutter", passing, int(sign[b, i]))

    def _meeting(self, part: Stretch) -> Iterator[Bracket]:
        """Yield brackets in which a spectrum that is symmetric about the axis loses or gains stability."""
        x, counts = part.x, part.counts
        settled = np.flatnonzero(counts >= 0)
        tests = (("divergence", self._symmetric_product), ("collision", self._discriminant))
        for left, right in pairwise(settled.tolist()):
            if counts[left] == counts[right]:
                continue
            a, b = self._apart(x, settled, counts, left, right)
            if not (part.mirrored[a] and part.mirrored[b]):
                continue
            before, after = part.values[a], part.values[b]
            if x[b] - x[a] > TOLERANCES.interval_width * max(abs(x[a]), abs(x[b])) and far_apart(before, after):
                yield Bracket(a, b, "collision", None)
                continue
            size = float(np.max(np.abs([before, after])))
            passed = [(kind, test) for kind, test in tests if test(before, size) * test(after, size) < 0.0]
            yield Bracket(a, b, *(passed[0] if passed else ("collision", None)))

    def _apart(self, x: Array, known: Index, states: Index | Sides, a: int, b: int) -> tuple[int, int]:
        """Return points on both sides of a change, far enough apart that rounding does not hide it.

        They are among the known ones, and their states those of the points a and b next to the change.
        """
        near = TOLERANCES.meeting_rounding * max(abs(float(x[a])), abs(float(x[b])), float(x[-1] - x[0]))
        i, j = int(np.searchsorted(known, a)), int(np.searchsorted(known, b))
        while i > 0 and x[known[j]] - x[known[i]] < near and states[known[i - 1]] == states[a]:
            i -= 1
        while j < len(known) - 1 and x[known[j]] - x[known[i]] < 2.0 * near and states[known[j + 1]] == states[b]:
            j += 1
        return int(known[i]), int(known[j])

    def _product(self, spectrum: Complex, size: float, x: float = 0.0) -> float:
        """Return the product of the eigenvalues apart from unexplained zeros."""
        return product(spectrum, size, self.unplaced)

    def _symmetric_product(self, spectrum: Complex, size: float, x: float = 0.0) -> float:
        """Return the product of the eigenvalues of a symmetric spectrum apart from zeros."""
        return symmetric_product(spectrum, size, self.unplaced)

    def _discriminant(self, spectrum: Complex, size: float, x: float = 0.0) -> float:
        """Return the discriminant of λ² apart from zeros."""
        return discriminant(spectrum, self.unplaced)

    def _look_inside(self) -> None:
        """Add points between those of a coarse sweep: both ends may look alike although the middle differs.

        Paths of equilibria are followed with steps of their own.
        """
        coarse = len(self.x) <= TOLERANCES.points_fewest and self.evaluator.path is None
        each = -(-TOLERANCES.points_fewest // (len(self.x) - 1)) if coarse else 0
        new = list[Array]()
        for a, b in pairwise(self.x.tolist()) if each else ():
            parts = np.linspace(a, b, each + 2)[1:-1]
            if 0.0 < TOLERANCES.interval_ratio * min(abs(a), abs(b)) < max(abs(a), abs(b)) and a * b > 0.0:
                parts = np.sign(a) * np.geomspace(abs(a), abs(b), each + 2)[1:-1]
            new.append(parts)
        if new:
            self.at(np.concatenate(new))

    def _look_between(self, branches: Complex) -> None:
        """Examine real parts that approach the axis and turn back between points: they may have crossed it."""
        clear = self.raw.clear
        watched = np.flatnonzero(self.raw.turns[1:-1] | ~clear[:-1] | ~clear[1:]) + 1
        with np.errstate(invalid="ignore"):
            turns = turning(branches[watched - 1], branches[watched], branches[watched + 1])
        sides = [self.sides(branches, rows) for rows in (watched - 1, watched, watched + 1)]
        # What is on the axis at the point itself is most likely beyond it on one side of the point.
        touches = touching(*sides)
        sign = np.where(turns, signs(sides[1]), touches) * (branches[watched].imag >= 0.0)
        for n, i in np.argwhere(sign).tolist():
            self._look_around(int(watched[n]), complex(branches[watched[n], i]), -int(sign[n, i]))

    def _look_around(self, k: int, value: complex, toward: int) -> None:
        """Examine the real part of an eigenvalue of a point until it is seen to cross the axis beside it, or not to.

        The sign of what is beyond the axis is given.
        """
        a, middle, b = self.x[k - 1 : k + 2].tolist()
        for _ in range(TOLERANCES.turning_rounds):
            points = np.linspace(a, b, TOLERANCES.turning_points)
            points[1 + np.argmin(np.abs(points[1:-1] - middle))] = middle
            new = points[~np.isin(points, self.x) & ~np.isin(points, self.between)]
            if len(new) and np.any(np.isnan(self.at(new))):
                return
            part = self._stretch(points)
            i = int(np.argmin(np.abs(part.values[np.searchsorted(points, middle)] - value)))
            real = part.values[:, i].real
            best = int(np.argmax(toward * real))
            if np.any(signs(part.sides)[:, i] == toward) or best in (0, len(points) - 1):
                return
            if not turning(*part.values[best - 1 : best + 2, i, None, None])[0, 0] and real[best]:
                return
            a, middle, b = points[best - 1 : best + 2].tolist()
            value = complex(part.values[best, i])

    def _located(self, part: Stretch, bracket: Bracket, branches: Complex) -> Critical | None:
        """Return the stability change in a bracket; None unless both sides confirm it.

        Where the number of unstable eigenvalues differs at its ends, whatever the search for branches has spent.
        """
        i, j, kind, test = *bracket.points, bracket.kind, bracket.test
        if test is None:
            return None
        a, b = float(part.x[i]), float(part.x[j])
        self._search([(part, bracket)])
        place = self.roots[a, b, test]
        if place is None:
            return None
        value, error = place
        there = self.looked[value].values
        counts, words = self._verified(part, i, j, value, needed(part, i, j))
        # A passing pair changes the number by two, and others that pass nearby hide what passes the other way.
        change = counts[1] - counts[0]
        if min(counts) < 0 or not change or (kind == "flutter" and change % 2) or change * bracket.toward < 0:
            return None
        # Others may pass the axis at the same value.
        which = test.number(there, value) if isinstance(test, RealPart) else None
        # Where real eigenvalues pass through infinity, a pair that stays may be nearest to the line between the ends.
        if kind == "divergence" and which is not None and there[which].imag != 0.0:
            ends = part.values[[i, j]]
            if np.any(np.take_along_axis(ends, np.argmin(np.abs(ends - there[which]), axis=1)[:, None], axis=1).imag):
                return None
        # Where one is infinite the product of all changes its sign, too, and beside it slow ones are zero.
        far = np.max(np.abs(there)) > TOLERANCES.spectrum_ratio * np.max(np.abs(part.values[[i, j]]))
        if kind == "divergence" and far and (which is None or not there[which]):
            return None
        found = replace(self._described(value, kind, there, counts, branches, which), verdicts=words, error=error)
        # A point of the sweep within the error is as likely as any other value, and simpler.
        own = self.x[np.abs(self.x - value) <= error]
        found = replace(found, value=float(own[np.argmin(np.abs(own - value))])) if len(own) else found
        if kind == "collision":
            stable = a if counts[0] < counts[1] else b
            found = replace(found, signatures=self._signatures(value, stable, found.frequency))
        return found

    def _search(self, brackets: list[tuple[Stretch, Bracket]]) -> None:
        """Find the roots of test functions in brackets, all together; None where there is none, or a jump."""
        open_: list[tuple[Search, Test, float, bool]] = []
        limits: dict[tuple[float, float, Test], tuple[Search, float, float]] = {}
        for part, bracket in brackets:
            i, j, test = *bracket.points, bracket.test
            if test is None or (key := (float(part.x[i]), float(part.x[j]), test)) in self.roots:
                continue
            size = float(np.max(np.abs(part.values[[i, j]])))
            y = np.array([test(spectrum, size, x) for spectrum, x in zip(part.values, part.x.tolist(), strict=True)])
            self.roots[key] = None
            if y[i] * y[j] < 0.0:
                search = Search(part.x, y, i, j, EPS * max(map(abs, key[:2])))
                limit = TOLERANCES.test_function_zero * float(np.prod(np.sqrt(np.abs(y[[i, j]]))))
                # Near the axis the real part of a pair is rounding; a slow real eigenvalue keeps its digits.
                limits[key] = search, limit, (bracket.kind == "flutter") * TOLERANCES.roundings_of_matrix * EPS
                open_.append((search, test, size, needed(part, i, j)))
        while open_ := [x for x in open_ if not x[0].done]:
            # Points that no pattern fits cost as much each.
            beside = 1 if self.evaluator.alone else TOLERANCES.search_beside
            for sure in {x[-1] for x in open_}:
                some = [x for x in open_ if x[-1] is sure]
                places = [search.points(beside) for search, *_ in some]
                spectra = self._spectra(np.concatenate(places), needed=sure).values
                for (search, test, size, _), x in zip(some, places, strict=True):
                    found, spectra = spectra[: len(x)], spectra[len(x) :]
                    search.learn(x, np.array([test(*pair) for pair in zip(found, repeat(size), x.tolist())]))
        for key, (search, limit, noise) in limits.items():
            # A test function that jumps has no zero.
            if not search.failed and search.residual <= limit:
                # Nearer to zero than the rounding of the range: zero.
                zero = key[0] < 0.0 < key[1] and abs(search.best) <= EPS * self.width
                value, doubt = 0.0 if zero else search.best, search.doubt(noise)
                self.roots[key] = value, doubt if doubt > TOLERANCES.crossing_interval * self.width else 0.0
                if value not in self.looked:
                    self.look(np.array([value]))

    def _verified(
        self, part: Stretch, i: int, j: int, value: float, needed: bool
    ) -> tuple[tuple[int, int], tuple[str, str]]:
        """Return the numbers of unstable eigenvalues and the verdicts on both sides of a value, (−1, −1) if in doubt.

        Both sides are judged as `mbstab eig` does, halfway to the next root or else farther away. Where no root is in
        between, they must agree with the ends of the bracket if these are known.
        """
        ends, known = part.x[[i, j]], part.counts[[i, j]]
        tries, step = [(ends, known)], TOLERANCES.change_beside * float(np.min(np.abs(ends - value)))
        rounding = TOLERANCES.meeting_rounding * self.width
        if step > rounding:
            tries.insert(0, (np.array([value - step, value + step]), known))
        roots = np.array([place[0] for place in self.roots.values() if place is not None])
        roots = roots[(roots > ends[0]) & (roots < ends[1]) & (np.abs(roots - value) > rounding)]
        if len(roots):
            sides = np.max(roots[roots < value], initial=ends[0]), np.min(roots[roots > value], initial=ends[1])
            near = np.array(sides)
            other = near != ends
            tries.insert(0, (np.where(other, 0.5 * (value + near), tries[0][0]), np.where(other, -1, known)))
        for places, known in tries:
            found = self._counted(places, needed)
            if np.any((found >= 0) & (known >= 0) & (found != known)):
                break
            if np.all(found >= 0):
                below, above = (WORDS[int(self.looked[p].words)] for p in places.tolist())
                return (int(found[0]), int(found[1])), (below, above)
        return (-1, -1), ("", "")

    def _signatures(self, value: float, stable: float, frequency: float) -> tuple[int, int] | None:
        """Return the signs of the energies ω² x̄ᵀM x + x̄ᵀK x of the modes that meet, where they are apart.

        There are such energies where the equations are those of a Hamiltonian system: K symmetric and R
        antisymmetric on the motions that the rows allow, and no row on speeds that changes along them.
        """
        near = value + float(
            np.clip(stable - value, -TOLERANCES.collision_side * self.width, TOLERANCES.collision_side * self.width)
        )
        try:
            values, shapes, linear = self.evaluator.modes({self.parameter: near})
        except MbstabError:
            return None
        if np.max(np.abs(linear.D_q), initial=0.0) > TOLERANCES.potential_misfit * frequency * np.max(
            np.abs(linear.J[linear.n_h :]), initial=0.0
        ):
            return None
        spaces = linear.motion.spaces
        N = spaces.scale[:, None] * spaces.allowed
        K, R = N.T @ linear.K @ N, N.T @ linear.R @ N
        if np.max(np.abs(K - K.T)) > TOLERANCES.potential_misfit * np.max(np.abs(K)) or np.max(
            np.abs(R + R.T)
        ) > TOLERANCES.potential_misfit * (np.max(np.abs(R)) + 1e-300):
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
        k = int(np.clip(np.searchsorted(self.x, value), 0, len(self.x) - 1))
        if kind == "divergence":
            # As many as pass there together, beside eigenvalues around: all may be zero there.
            size, around = np.abs(spectrum), np.nan_to_num(np.abs(branches[max(k - 1, 0) : k + 2]))
            zeros = int(np.sum(size <= TOLERANCES.unexplained_zero * max(np.max(size), np.max(around))))
            passing = max(1, min(zeros, abs(unstable[1] - unstable[0])))
            frequency, involved = 0.0, np.argsort(size, kind="stable")[:passing].tolist()
        elif kind == "collision":
            gaps = np.abs(spectrum[:, None] - spectrum[None, :]) + np.diag(np.full(len(spectrum), np.inf))
            i, j = divmod(int(np.argmin(gaps)), len(spectrum))
            frequency, involved = float(abs(0.5 * (spectrum[i] + spectrum[j]).imag)), [i, j]
        else:
            involved = [int(np.argmin(np.abs(spectrum.real))) if which is None else which]
            frequency = float(abs(spectrum[involved[0]].imag))
        links = self._columns_at(value, spectrum, branches)
        numbers = sorted(int(links[i]) for i in involved)
        if kind == "divergence" and self.unplaced:  # which of several zeros passes shows beside the value
            growing = self.sides(branches, np.clip([k - 1, k], 0, None)) == RIGHT
            changed = np.flatnonzero(growing[0] != growing[1]).tolist()
            numbers = changed if len(changed) == passing else numbers
        return Critical(value, kind, tuple(numbers), frequency, unstable)

    def _columns_at(self, value: float, spectrum: Complex, branches: Complex) -> Index:
        """Return the branches on which the eigenvalues at a value lie.

        They are followed from a neighbouring point of the sweep through all points that are known in between.
        """
        known = {p: found.values for p, found in self.looked.items() if not np.any(np.isnan(found.values))}
        good, ways = np.flatnonzero(self.good), list[tuple[int, Index]]()
        k = int(np.searchsorted(self.x[good], value))
        for end in good[max(k - 1, 0) : k + 1].tolist():
            start = float(self.x[end])
            inside = sorted((p for p in known if min(start, value) < p < max(start, value)), reverse=start > value)
            spectra = np.array([branches[end], *(known[p] for p in inside), spectrum])
            unclear = int(np.sum(~follow(spectra[:-1], spectra[1:])[1]))
            ways.append((unclear, np.argsort(self._linked(spectra, np.full(len(spectra), -1), None)[-1])))
        return min(ways, key=lambda way: way[0])[1]
