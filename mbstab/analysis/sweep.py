"""Sweeps of a parameter: eigenvalue branches, and the values at which stability changes.

Branches are followed by continuity: between neighbouring points no eigenvalue may move by
more than a part of its distance to the others; intervals in which one does are halved until
that holds, or until two eigenvalues cross or collide. Stability changes are located by
functions that are smooth there: the product of the eigenvalues where one passes zero, the
real part of a simple pair where it passes the axis, and, where the spectrum is symmetric to
the imaginary axis, the discriminant of λ², which passes zero where two pairs collide (real
parts grow from there like a root; Seyranian and Mailybaev 2003, chapter 4).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from mbstab.analysis.batch import Evaluator
from mbstab.compiler.system import Array
from mbstab.errors import UsageError
from mbstab.model.schema import Model

Complex = npt.NDArray[np.complex128]
Index = npt.NDArray[np.intp]
Flags = npt.NDArray[np.bool_]

EPS = float(np.finfo(float).eps)

STRIDE = 0.35
"""Between neighbouring points an eigenvalue moves by less than this part of its distance to the others."""

RESOLUTION = 1e-12
"""Eigenvalues that are not told apart in an interval of this relative width cross or collide in it."""

TWIN = 1e-9
"""Eigenvalues closer than this part of the largest are equal, if they are so at both ends of an interval."""

NOISE = 1e-7
"""So near to a meeting, relative to the parameter, rounding may show a pair on the wrong side."""

FAR = 1e-6
"""Where eigenvalues meet, their directions are taken over this part of the parameter's value."""

SYMMETRIC = 1e-8
"""Odd power sums of a spectrum that is symmetric to the imaginary axis vanish to this."""

STABLE = 1e-10
"""Real parts below this part of the largest eigenvalue are rounding; of λ² in a symmetric spectrum."""


@dataclass(frozen=True)
class Critical:
    """A parameter value at which stability changes.

    Attributes
    ----------
    value : float
        In SI.
    kind : str
        ``divergence`` (an eigenvalue passes zero), ``flutter`` (a pair passes the imaginary
        axis), ``collision`` (two pairs meet on the imaginary axis), ``unresolved``.
    branches : tuple of int
        The branches that are involved.
    frequency : float (rad/s)
        Of the motion at the boundary; 0 for a divergence.
    unstable : tuple of int
        Number of unstable eigenvalues below and above.
    """

    value: float
    kind: str
    branches: tuple[int, ...]
    frequency: float
    unstable: tuple[int, int]


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
    """

    parameter: str
    values: Array
    branches: Complex
    unstable: npt.NDArray[np.intp]
    neutral: int
    critical: tuple[Critical, ...]
    meetings: tuple[tuple[float, str], ...]
    problems: dict[int, str]


def sweep(
    model: Model,
    parameter: str,
    values: Array,
    settings: Mapping[str, float] | None = None,
    progress: Callable[[float], object] = lambda done: None,
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

    Raises
    ------
    UsageError
        If the parameter is among the settings, or its values are not in order.
    """
    settings = dict(settings or {})
    if parameter in settings:
        raise UsageError(f"{parameter} is swept and set at the same time")
    steps = np.diff(values)
    if not (np.all(steps > 0.0) or np.all(steps < 0.0)):
        raise UsageError(f"the values of {parameter} must ascend or descend")
    order = slice(None, None, -1) if len(values) > 1 and values[0] > values[-1] else slice(None)
    evaluator = Evaluator(model, settings)
    raw = evaluator.spectra({parameter: values[order]}, progress)
    tracker = _Tracker(evaluator, parameter, values[order], raw.values)
    branches = tracker.branches()
    critical = tuple(tracker.critical(branches))
    problems = {len(values) - 1 - i if order.step else i: text for i, text in raw.problems.items()}
    branches = branches[order]
    return Sweep(
        parameter, values, branches, unstable_counts(branches), raw.neutral, critical, tuple(sorted(tracker.meetings)),
        dict(sorted(problems.items())),
    )  # fmt: skip


# --- properties of spectra ------------------------------------------------------------------------------------------


def symmetric(values: Complex) -> npt.NDArray[np.bool_]:
    """Return whether spectra, shape (…, r), are symmetric to the imaginary axis: odd power sums vanish."""
    r = values.shape[-1]
    size = np.max(np.abs(values), axis=-1, initial=1e-300)
    scaled = values / size[..., None]
    result = np.full(values.shape[:-1], r % 2 == 0)
    power = scaled
    for _ in range((r + 1) // 2):
        result &= np.abs(np.sum(power, axis=-1)) < SYMMETRIC * r
        power = power * scaled * scaled
    return result


def unstable_counts(values: Complex) -> npt.NDArray[np.intp]:
    """Return the number of unstable eigenvalues of spectra, shape (…, r); −1 where there are none."""
    size = np.max(np.abs(values), axis=-1, initial=0.0)[..., None]
    plain = values.real > STABLE * size
    square = values * values
    # On the axis λ² is real and negative; where pairs have just met, real parts are roots of small numbers.
    off = (np.abs(square.imag) > STABLE * size**2) | (square.real > STABLE * size**2)
    reversible = off & (values.real > 0.0)
    counts: Index = np.where(symmetric(values), np.sum(reversible, axis=-1), np.sum(plain, axis=-1))
    counts[np.any(np.isnan(values), axis=-1)] = -1
    return counts


def _squares(values: Complex) -> Complex:
    """Return λ² of a symmetric spectrum, each once."""
    square = np.sort_complex(values * values)
    left = list(square)
    found = []
    while left:
        first = left.pop(0)
        twin = min(range(len(left)), key=lambda k: abs(left[k] - first))
        found.append(0.5 * (first + left.pop(twin)))
    return np.array(found, dtype=complex)


def _product(values: Complex) -> float:
    """Return the product of the eigenvalues, scaled; real."""
    size = float(np.max(np.abs(values)))
    return float(np.prod(values / size).real)


def _discriminant(values: Complex) -> float:
    """Return the scaled discriminant of λ²; real."""
    mu = _squares(values)
    size = float(np.max(np.abs(mu)))
    differences = [(a - b) / size for i, a in enumerate(mu) for b in mu[i + 1 :]]
    return float(np.prod(np.array(differences) ** 2).real)


# --- branches -------------------------------------------------------------------------------------------------------


Bracket = tuple[int, int, str, Callable[[Complex], float] | None]
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
    """

    def __init__(self, evaluator: Evaluator, parameter: str, x: Array, values: Complex) -> None:
        self.evaluator, self.parameter, self.x, self.values = evaluator, parameter, x, values
        self.meetings: list[tuple[float, str]] = []
        self.between: list[tuple[float, Complex]] = []
        self.width = max(float(np.max(np.abs(x), initial=0.0)), 1e-300)

    def at(self, points: Array) -> Complex:
        """Return the eigenvalues at further points, and keep them."""
        found = self.evaluator.near({self.parameter: points}, self.values.shape[1])
        self.between += [(float(p), v) for p, v in zip(points, found, strict=True) if not np.any(np.isnan(v))]
        return found

    def branches(self) -> Complex:
        """Return the eigenvalues in columns that are continuous over the points."""
        values = self.values
        good = ~np.any(np.isnan(values), axis=1)
        count = values.shape[1]
        if count == 0 or not good.any():
            return values
        identity = np.arange(count)
        follow, clear = _follow(values[:-1], values[1:])
        linked = good[:-1] & good[1:]
        for k, link in self._refined(np.flatnonzero(linked & ~clear)).items():
            follow[k] = link
        order = np.broadcast_to(identity, values.shape).copy()
        first = int(np.flatnonzero(good)[0])
        current, start = np.lexsort((-values[first].imag, -values[first].real)), first
        # Between changes the order of the eigenvalues stays what it is.
        changes = np.flatnonzero(~linked | np.any(follow != identity, axis=1))
        for k in changes[changes >= first]:
            order[start : k + 1] = current
            if linked[k]:
                current = follow[k][current]
            start = k + 1
        order[start:] = current
        return np.take_along_axis(values, order, axis=1)

    def _refined(self, intervals: Index) -> dict[int, Index]:
        """Halve intervals until eigenvalues can be followed through each part; return what becomes what."""
        pieces = [
            _Piece(int(k), float(self.x[k]), float(self.x[k + 1]), self.values[k], self.values[k + 1])
            for k in intervals
        ]
        done: dict[int, list[tuple[_Piece, Index | None]]] = {int(k): [] for k in intervals}
        while pieces:
            middles = np.array([0.5 * (piece.a + piece.b) for piece in pieces])
            halves = []
            for piece, m, found in zip(pieces, middles, self.at(middles), strict=True):
                if np.any(np.isnan(found)) or piece.b - piece.a <= RESOLUTION * self.width:
                    done[piece.interval].append((piece, None))
                    continue
                halves.append(_Piece(piece.interval, piece.a, float(m), piece.before, found))
                halves.append(_Piece(piece.interval, float(m), piece.b, found, piece.after))
            if not halves:
                break
            links, clear = _follow(np.array([h.before for h in halves]), np.array([h.after for h in halves]))
            pieces = []
            for half, link, is_clear in zip(halves, links, clear, strict=True):
                if is_clear:
                    done[half.interval].append((half, link))
                else:
                    pieces.append(half)
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
        from scipy.optimize import linear_sum_assignment

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
        _, link = linear_sum_assignment(cost)
        link = np.asarray(link, dtype=np.intp)
        for i, j in _close_pairs(before, after, link):
            g_before, g_after = (far_before[i] - far_before[j]) ** 2, (far_after[link[i]] - far_after[link[j]]) ** 2
            collides = (g_before * np.conj(g_after)).real < 0.0
            self.meetings.append((0.5 * (a + b), "collide" if collides else "cross"))
            if collides:
                # Direction is lost: the one that was ahead stays ahead.
                first, second = sorted((i, j), key=lambda k: (-far_before[k].real, -far_before[k].imag))
                one, other = sorted((link[i], link[j]), key=lambda k: (-far_after[k].real, -far_after[k].imag))
                link[first], link[second] = one, other
        return link

    # --- stability changes ------------------------------------------------------------------------------------------

    def critical(self, branches: Complex) -> list[Critical]:
        """Return where stability changes, in ascending order."""
        self._look_between(branches)
        points = {float(p): v for p, v in zip(self.x, self.values, strict=True) if not np.any(np.isnan(v))}
        points |= dict(self.between)
        x = np.array(sorted(points))
        if len(x) < 2 or not self.values.shape[1]:
            return []
        spectra = self._linked(np.array([points[float(p)] for p in x]))
        gaps = [0.5 * (self.x[k] + self.x[k + 1]) for k in self._broken()]
        brackets = [*self._passing(x, spectra), *self._meeting(x, spectra)]
        found = [
            self._located(x[a], x[b], spectra[a], spectra[b], kind, test, branches)
            for a, b, kind, test in brackets
            if not any(x[a] < gap < x[b] for gap in gaps)
        ]
        return sorted(found, key=lambda c: c.value)

    def _linked(self, spectra: Complex) -> Complex:
        """Return spectra in columns that are continuous, where eigenvalues do not meet."""
        from scipy.optimize import linear_sum_assignment

        links, clear = _follow(spectra[:-1], spectra[1:])
        current = np.arange(spectra.shape[1])
        order = [current]
        for k, link in enumerate(links):
            if not clear[k]:
                link = linear_sum_assignment(np.abs(spectra[k][:, None] - spectra[k + 1][None, :]))[1]
            current = link[current]
            order.append(current)
        return np.take_along_axis(spectra, np.array(order), axis=1)

    def _passing(self, x: Array, spectra: Complex) -> Iterator[Bracket]:
        """Yield brackets in which a branch passes the imaginary axis, and the function that is zero there."""
        size = np.max(np.abs(spectra), axis=1, keepdims=True)
        sign = np.where(np.abs(spectra.real) > STABLE * size, np.sign(spectra.real), 0.0)
        both = symmetric(spectra)
        for i in range(spectra.shape[1]):
            sure = np.flatnonzero(sign[:, i])
            for a, b in pairwise(sure):
                if sign[a, i] == sign[b, i] or (both[a] and both[b]):
                    continue
                before, after = complex(spectra[a, i]), complex(spectra[b, i])
                if before.imag == 0.0 and after.imag == 0.0:
                    # The product of all is smoother than the eigenvalue that passes, and may not change its sign.
                    single = _product(spectra[a]) * _product(spectra[b]) < 0.0
                    yield int(a), int(b), "divergence", _product if single else _real_part(before, after)
                elif before.imag >= 0.0 and after.imag >= 0.0:
                    yield int(a), int(b), "flutter", _real_part(before, after)

    def _meeting(self, x: Array, spectra: Complex) -> Iterator[Bracket]:
        """Yield brackets in which a spectrum that is symmetric to the axis loses or gains stability."""
        counts, both = unstable_counts(spectra), symmetric(spectra)
        changes = [int(k) for k in np.flatnonzero(counts[1:] != counts[:-1])]
        while changes:
            # Next to a meeting rounding decides on which side of the axis a point lies.
            a = changes.pop(0)
            b = a + 1
            while changes and x[changes[0]] - x[b] < NOISE * self.width:
                b = changes.pop(0) + 1
            while a > 0 and x[b] - x[a] < NOISE * self.width:
                a -= 1
            while b < len(x) - 1 and x[b] - x[a] < 2.0 * NOISE * self.width:
                b += 1
            if counts[a] == counts[b] or not (both[a] and both[b]):
                continue
            tests = (("divergence", _product), ("collision", _discriminant))
            passed = [(kind, test) for kind, test in tests if test(spectra[a]) * test(spectra[b]) < 0.0]
            yield (a, b, *(passed[0] if passed else ("unresolved", None)))

    def _broken(self) -> Index:
        """Return the intervals with an end that has no eigenvalues."""
        bad = np.any(np.isnan(self.values), axis=1)
        return np.flatnonzero(bad[1:] | bad[:-1])

    def _look_between(self, branches: Complex) -> None:
        """Look at real parts that come close to the axis and turn back between points: they may have crossed it."""
        real = branches.real
        if len(real) < 3:
            return
        with np.errstate(invalid="ignore"):
            before, now, after = real[:-2], real[1:-1], real[2:]
            rising, falling = now - before, now - after
            top = (rising * falling > 0.0) & (np.sign(now) == -np.sign(rising)) & (now != 0.0)
            near = np.abs(now) < 2.0 * np.maximum(np.abs(rising), np.abs(falling))
        size = np.nanmax(np.abs(branches), initial=1e-300)
        near &= np.abs(now) > STABLE * size
        for k in np.unique(np.nonzero(top & near)[0]):
            a, b = float(self.x[k]), float(self.x[k + 2])
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
        test: Callable[[Complex], float] | None,
        branches: Complex,
    ) -> Critical:
        """Return the stability change in a bracket."""
        from scipy.optimize import brentq

        def spectrum(p: float) -> Complex:
            found: Complex = self.evaluator.near({self.parameter: np.array([p])}, self.values.shape[1])[0]
            return found

        value = 0.5 * (a + b)
        if test is not None:
            value = float(brentq(lambda p: test(spectrum(p)), a, b, xtol=1e-300, rtol=4.0 * EPS))
        counts = unstable_counts(np.array([before, after]))
        return self._described(value, kind, spectrum(value), (int(counts[0]), int(counts[1])), branches)

    def _described(
        self, value: float, kind: str, spectrum: Complex, unstable: tuple[int, int], branches: Complex
    ) -> Critical:
        """Return a critical value with the branches that are involved and their frequency."""
        if kind == "divergence":
            frequency, involved = 0.0, [int(np.argmin(np.abs(spectrum)))]
        elif kind == "collision":
            gaps = np.abs(spectrum[:, None] - spectrum[None, :]) + np.diag(np.full(len(spectrum), np.inf))
            i, j = divmod(int(np.argmin(gaps)), len(spectrum))
            frequency, involved = float(abs(0.5 * (spectrum[i] + spectrum[j]).imag)), [i, j]
        else:
            involved = [int(np.argmin(np.abs(spectrum.real)))]
            frequency = float(abs(spectrum[involved[0]].imag))
        k = int(np.clip(np.searchsorted(self.x, value), 0, len(self.x) - 1))
        row = branches[k] if not np.any(np.isnan(branches[k])) else branches[max(k - 1, 0)]
        numbers = sorted({int(np.argmin(np.abs(row - spectrum[i]))) for i in involved})
        return Critical(value, kind, tuple(numbers), frequency, unstable)


def _real_part(one: complex, other: complex) -> Callable[[Complex], float]:
    """Return the real part of the eigenvalue that lies between two as a function of a spectrum."""
    middle = 0.5 * (one + other)

    def test(spectrum: Complex) -> float:
        return float(spectrum[int(np.argmin(np.abs(spectrum - middle)))].real)

    return test


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


FOLLOWED = 20_000
"""Intervals that are compared together."""


def _follow(before: Complex, after: Complex) -> tuple[Index, Flags]:
    """Return for spectra, shape (m, r), which eigenvalue each becomes, and whether that is beyond doubt."""
    m, r = before.shape
    link, clear = np.zeros((m, r), dtype=np.intp), np.ones(m, dtype=bool)
    if r < 2:
        return link, clear
    for start in range(0, m, FOLLOWED):
        part = slice(start, start + FOLLOWED)
        link[part], clear[part] = _followed(before[part], after[part])
    return link, clear


def _followed(before: Complex, after: Complex) -> tuple[Index, Flags]:
    r = before.shape[1]
    moved = np.abs(before[:, :, None] - after[:, None, :])
    link = np.argmin(moved, axis=2)
    distance = np.take_along_axis(moved, link[:, :, None], axis=2)[:, :, 0]
    unique = np.all(np.sort(link, axis=1) == np.arange(r), axis=1)
    size = np.max(np.abs(before), axis=1)[:, None]
    gaps = []
    for values in (before, np.take_along_axis(after, link, axis=1)):
        gap = np.abs(values[:, :, None] - values[:, None, :])
        gap[:, np.arange(r), np.arange(r)] = np.inf
        gaps.append(gap)
    # Eigenvalues that are the same on both sides are one multiple eigenvalue.
    same = (gaps[0] < TWIN * size[:, :, None]) & (gaps[1] < TWIN * size[:, :, None])
    gap = np.min(np.where(same, np.inf, np.minimum(*gaps)), axis=2)
    clear = np.all(distance <= STRIDE * gap, axis=1) & (unique | np.any(same, axis=(1, 2)))
    if np.any(same & clear[:, None, None]):
        _untwin(link, moved, clear & ~unique)
    return link, clear


def _untwin(link: Index, moved: Array, doubtful: Flags) -> None:
    """Give each of equal eigenvalues a successor of its own."""
    from scipy.optimize import linear_sum_assignment

    for k in np.flatnonzero(doubtful):
        link[k] = linear_sum_assignment(moved[k])[1]
