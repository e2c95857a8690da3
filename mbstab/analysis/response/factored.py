"""A transfer function on the imaginary axis by its zeros and poles: where its gain is 1, where it is real, its largest.

With zeros z and poles p, G(s) = c Π(s − z)/Π(s − p), so that the derivatives by ω of

    log G(iω) = log c + Σ log(iω − z) − Σ log(iω − p)

are bounded over an interval by the distances of its middle to them. Intervals on which a condition cannot hold are
dropped, those on which the function is monotone have one solution or none, others are halved: no crossing is missed
(Moore, Kearfott, Cloud, Introduction to Interval Analysis, 2009, chapter 8). Zeros and poles count with the radii of
their discs.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from mbstab.analysis.algebra.arrays import Complex
from mbstab.analysis.algebra.tolerances import EPS
from mbstab.analysis.response.tolerances import TOLERANCES
from mbstab.analysis.response.zeros import Zeros
from mbstab.compiler.system import Array

Exact = Callable[[Array], tuple[Complex, Array]]
"""Returns G(iω) and its error bounds at frequencies (rad/s)."""


class Undecided(Exception):
    """Why crossings or the largest gain are not known."""


class Bounds(NamedTuple):
    """A function over intervals: at their middles, with its error there, and its bounds; the same of its derivative."""

    middle: Array
    error: Array
    low: Array
    high: Array
    least_slope: Array
    largest_slope: Array


Function = Callable[[Array, Array], Bounds]
"""`Factored.gain` or `Factored.argument`."""


class Factored:
    """G(iω) by its zeros and poles.

    Parameters
    ----------
    zeros : Zeros
        Of the transfer function; they must be decided.
    exact : callable
        Returns G(iω) and its error bounds at frequencies (rad/s).

    Raises
    ------
    Undecided
        If G is known nowhere, or differs from what its zeros and poles make of it.
    """

    def __init__(self, zeros: Zeros, exact: Exact) -> None:
        self.exact = exact
        self.roots = np.concatenate([zeros.values, zeros.poles])
        self.errors = np.concatenate([zeros.errors, zeros.pole_errors])
        self.signs = np.concatenate([np.ones(len(zeros.values)), -np.ones(len(zeros.poles))])
        # What may be zero is taken for it, and zeros of which it may be the real part: the gain beside them is 0.
        self.roots = np.where(np.abs(self.roots) <= self.errors, 0.0, self.roots)
        narrow = (np.abs(self.roots.real) <= self.errors) & (self.errors <= TOLERANCES.undamped * np.abs(self.roots))
        undamped = np.concatenate([narrow[: len(zeros.values)], zeros.undamped])
        self.roots[undamped] = 1j * self.roots[undamped].imag
        self.turning_errors = np.where(undamped, 0.0, self.errors)
        self._turning = (self.roots.real != 0.0) | (self.turning_errors > 0.0)
        self.sizes = np.abs(self.roots[self.roots != 0.0])
        self.order = int(np.sum(self.signs[self.roots == 0.0]))
        self.fall = -int(np.sum(self.signs))
        self.log_c, self.sign_c, self.error_c = 0.0, 1.0, 0.0
        self._calibrate()
        self.log_0 = self.log_c + float(np.sum(self.signs[self.roots != 0.0] * np.log(self.sizes)))

    def _calibrate(self) -> None:
        """Take log c from where G is known best."""
        samples = self.samples()
        values, errors = self.exact(samples)
        with np.errstate(all="ignore"):
            own = self.gain(samples, 0.0 * samples)
            total = errors / np.abs(values) + own.error
        total = np.where(np.isfinite(total), total, np.inf)
        best = int(np.argmin(total))
        if not total[best] < TOLERANCES.calibration:
            raise Undecided("the response is known at no frequency")
        log_c = np.log(np.abs(values)) - own.middle
        turn = np.angle(values[best]) - self.argument(samples[[best]], np.zeros(1)).middle[0]
        self.sign_c = 1.0 if np.cos(turn) > 0.0 else -1.0
        self.log_c, self.error_c = float(log_c[best]), float(total[best])
        clear = total < TOLERANCES.calibration
        off = np.abs(log_c - self.log_c)[clear]
        if np.any(off > TOLERANCES.factored_off + total[clear] + self.error_c) or abs(np.sin(turn)) > 0.1:
            raise Undecided("the response is not the one of its zeros and poles, as they are known")

    def samples(self) -> Array:
        """Return frequencies beside the sizes of zeros and poles (rad/s)."""
        sizes = self.sizes if len(self.sizes) else np.ones(1)
        return np.unique(np.concatenate([0.7 * sizes, 1.1 * sizes, [0.1 * np.min(sizes), 10.0 * np.max(sizes)]]))

    def _apart(self, middle: Array, half: Array) -> tuple[Complex, Array, Array]:
        """Return iω − r for each interval and root, and the least and largest distances, with errors."""
        away = 1j * middle[:, None] - self.roots
        size, around = np.abs(away), half[:, None] + self.errors
        return away, np.maximum(size - around, 0.0), size + around

    def _slopes(
        self, away: Complex, near: Array, half: Array, errors: Array, bends: Array
    ) -> tuple[Complex, Array, Array]:
        """Return the derivative of log G at the middles, its error, and a bound of the second derivative.

        Parameters
        ----------
        errors : ndarray, shape (roots,)
        bends : ndarray of bool, shape (roots,)
            The roots that have a part in the second derivative.
        """
        slope = 1j * np.sum(self.signs / away, axis=1)
        error = np.sum(errors / (near * (near + half[:, None])), axis=1)
        return slope, error, np.sum(near[:, bends] ** -2.0, axis=1)

    def gain(self, middle: Array, half: Array) -> Bounds:
        """Return log |G(iω)| over intervals about frequencies (rad/s)."""
        with np.errstate(all="ignore"):
            away, near, far = self._apart(middle, half)
            slope, off, second = self._slopes(away, near, half, self.errors, np.full(len(self.roots), True))
            at = self.log_c + np.sum(self.signs * np.log(np.abs(away)), axis=1)
            error = self.error_c + np.sum(self.errors / near, axis=1) + self._rounding(away)
            up, down = np.where(self.signs > 0, far, near), np.where(self.signs > 0, near, far)
            low = self.log_c - self.error_c + np.sum(self.signs * np.log(down), axis=1)
            high = self.log_c + self.error_c + np.sum(self.signs * np.log(up), axis=1)
            return _bounds(at, error, slope.real, off, second, half, low, high)

    def argument(self, middle: Array, half: Array) -> Bounds:
        """Return the argument of G(iω) over intervals about frequencies (rad/s); it jumps only at undamped roots.

        These have no other part in its changes, wherever on the axis they lie.
        """
        with np.errstate(all="ignore"):
            away, near, _ = self._apart(middle, half)
            slope, off, second = self._slopes(away, near, half, self.turning_errors, self._turning)
            off[np.any(near == 0.0, axis=1)] = np.inf
            # Of −r + iω with ω rising the argument is continuous if it counts from the side of r.
            angles = np.where(self.roots.real <= 0.0, np.angle(away), np.pi - np.angle(-away.conj()))
            at = np.sum(self.signs * angles, axis=1) + (0.0 if self.sign_c > 0.0 else np.pi)
            error = np.sum(self.turning_errors / near, axis=1) + EPS * len(self.roots) * 4.0
            error[np.any(near == 0.0, axis=1)] = np.inf
            none = np.full(len(middle), np.inf)
            return _bounds(at, error, slope.imag, off, second, half, -none, none)

    def _rounding(self, away: Complex) -> Array:
        return np.asarray(4.0 * EPS * np.sum(1.0 + np.abs(np.log(np.abs(away))), axis=1))

    def expansion(self, far: bool) -> tuple[float, list[tuple[float, float]]]:
        """Return the argument at x = ω = 0, or x = 1/ω = 0, and its coefficients of x and x³ with their errors."""
        roots, signs, errors = (x[self.roots != 0.0] for x in (self.roots, self.signs, self.errors))
        total = 0.0 if self.sign_c > 0.0 else np.pi
        if far:
            total -= 0.5 * np.pi * self.fall
        else:
            # Pairs have no part: their angles are opposite.
            growing = (roots.real > 0.0) & (roots.imag == 0.0)
            total += 0.5 * np.pi * self.order + float(np.sum(signs * np.where(growing, np.pi, 0.0)))
            errors, roots, signs = errors / np.abs(roots) ** 2, 1.0 / roots, -signs
        first = float(np.sum(signs * roots.real)), float(np.sum(errors))
        third = -float(np.sum(signs * (roots**3).real)) / 3.0, float(np.sum(errors * np.abs(roots) ** 2))
        return total, [first, third]

    def static(self) -> tuple[float, float]:
        """Return G(0) and its error, where there is neither a zero nor a pole."""
        size = float(np.exp(self.log_0)) * float(np.cos(self.expansion(False)[0]))
        off = self.error_c + float(np.sum(self.errors / np.abs(self.roots)))
        return size, off * abs(size)

    def direct(self) -> tuple[float, float]:
        """Return G(∞) and its error, where there are as many zeros as poles."""
        size = float(np.exp(self.log_c)) * float(np.cos(self.expansion(True)[0]))
        return size, self.error_c * abs(size)

    def span(self, turning: bool) -> tuple[float, float]:
        """Return frequencies between which all crossings lie, of -180° by the argument or of the gain 1."""
        small, large = (float(f(self.sizes)) if len(self.sizes) else 1.0 for f in (np.min, np.max))
        low, high = TOLERANCES.end_of_response * small, large / TOLERANCES.end_of_response
        if turning:
            return self._turned(low, high)
        count = max(1.0, float(len(self.roots)))
        for at, slope, is_high in ((self.log_0, float(self.order), False), (self.log_c, -float(self.fall), True)):
            if slope:
                there = float(np.exp(np.clip(-at / slope, -600.0, 600.0)))
                low, high = (low, max(high, 1e3 * there)) if is_high else (min(low, 1e-3 * there), high)
            elif abs(at) > 4.0 * self.error_c:
                # There 1 ± n (ω/r)² must not reach the level.
                reach = float(np.sqrt(min(abs(at), 1.0) / (4.0 * count)))
                low, high = (low, max(high, large / reach)) if is_high else (min(low, small * reach), high)
        return low, high

    def _turned(self, low: float, high: float) -> tuple[float, float]:
        """Return the ends beyond which an argument that tends to -180° keeps to one side of it."""
        for far in (False, True):
            total, (first, third) = self.expansion(far)
            if abs(np.cos(0.5 * total)) > 1e-6 or not len(self.sizes):
                continue
            sizes = self.sizes if far else 1.0 / self.sizes
            # As far as the next coefficient does not matter; nearer to the end errors would hide the side.
            if abs(first[0]) > 2.0 * first[1]:
                end = float(np.sqrt(abs(first[0]) / (4.0 * np.sum(sizes**3))))
            else:
                # What the first coefficient may be counts only where the gain is next to nothing, or without limit.
                end = float(np.sqrt(abs(third[0]) / (4.0 * np.sum(sizes**5))))
                if not (abs(third[0]) > 2.0 * third[1] and abs(third[0]) * end**2 > 4.0 * first[1]):
                    where = "high" if far else "low"
                    raise Undecided(f"how the phase comes to 180° at {where} frequencies is beyond the errors")
            low, high = (low, 1.0 / end) if far else (end, high)
        return low, high

    def crossings(self, of: Function, what: str) -> list[float]:
        """Return the frequencies (rad/s) at which the gain passes 1, or the argument -180°.

        Parameters
        ----------
        of : callable
            `gain` or `argument`.
        what : str
            For messages.

        Raises
        ------
        Undecided
            If the level is touched, or passed within the errors.
        """
        turning = of == self.argument
        left, right = self._intervals(turning)
        found: list[float] = []
        for _ in range(TOLERANCES.halvings):
            middle, half = 0.5 * (left + right), 0.5 * (right - left) * (1.0 + 4.0 * EPS)
            x = of(middle, half)
            level = _level(x.middle, turning)
            met = ~((x.low - level) * (x.high - level) > 0.0) | ((x.high - x.low >= 2.0 * np.pi) & turning)
            steady = (x.least_slope > 0.0) | (x.largest_slope < 0.0)
            steady &= (x.high - x.low < np.pi) | (not turning)
            for k in np.flatnonzero(met & steady):
                found += self._passed(of, float(left[k]), float(right[k]), float(level[k]), what)
            narrow = met & ~steady & (half <= TOLERANCES.narrowest * middle)
            # On a zero or an eigenvalue without damping the argument jumps; the gain there is not -1 times anything.
            for k in np.flatnonzero(narrow & (np.isfinite(x.low) | (not turning))):
                raise Undecided(f"{what} cannot be distinguished from its limit at {middle[k]:.6g} rad/s")
            split = met & ~steady & ~narrow
            if not np.any(split):
                return sorted(set(found))  # two intervals may share a crossing at their common end
            left, right = _halved(left, middle, right, split, what)
        between = f"between {left[0]:.6g} and {right[-1]:.6g} rad/s"
        raise Undecided(f"{what} cannot be distinguished from its limit {between}")

    def _intervals(self, turning: bool) -> tuple[Array, Array]:
        low, high = self.span(turning)
        edges = np.geomspace(low, high, max(2, int(np.ceil(np.log2(high / low))) + 1))
        return edges[:-1], edges[1:]

    def _passed(self, of: Function, left: float, right: float, level: float, what: str) -> list[float]:
        """Return where a function that is monotone between two frequencies passes a level, if it does."""

        def side(omega: float) -> int:
            x = of(np.array([omega]), np.zeros(1))
            value, error = float(x.middle[0]) - level, float(x.error[0])
            return 0 if abs(value) <= error else 1 if value > 0.0 else -1

        sides = side(left), side(right)
        if sides[0] * sides[1] > 0:
            return []
        for end, own in zip((left, right), sides, strict=True):
            if own == 0:
                # At the end of the interval: it is passed if the function has other signs on both sides.
                for part in TOLERANCES.beside_crossing:
                    around = side(end * (1.0 - part)), side(end * (1.0 + part))
                    if around[0] * around[1] < 0:
                        return [end]
                raise Undecided(f"{what} touches its limit at {end:.6g} rad/s")
        while left < (middle := 0.5 * (left + right)) < right:
            value = float(of(np.array([middle]), np.zeros(1)).middle[0]) - level
            left, right = (middle, right) if value * sides[0] > 0.0 else (left, middle)
        return [left]

    def off_at(self, omega: float, crossed: Function, other: Function) -> float:
        """Return how far a function is off at a crossing of another one, whose frequency has an error."""
        x, y = (of(np.array([omega]), np.zeros(1)) for of in (crossed, other))
        steep = min(abs(float(x.least_slope[0])), abs(float(x.largest_slope[0])))
        away = float(x.error[0]) / steep if steep > 0.0 else np.inf
        return (away + EPS * omega) * max(abs(float(y.least_slope[0])), abs(float(y.largest_slope[0])))

    def largest(self) -> tuple[float, float, float]:
        """Return the largest gain of a response without undamped poles, where it is, and its relative error."""
        ends = [(np.exp(self.log_0), 0.0)] if self.order == 0 else []
        ends += [(np.exp(self.log_c), np.inf)] if self.fall == 0 else []
        value, at = max(ends, default=(0.0, 0.0))
        left, right = self._intervals(False)
        best = np.log(value) if value > 0.0 else -np.inf
        while len(left):
            middle, half = 0.5 * (left + right), 0.5 * (right - left) * (1.0 + 4.0 * EPS)
            x = self.gain(middle, half)
            top = int(np.argmax(x.middle))
            if x.middle[top] > best + 8.0 * EPS:
                best, at = float(x.middle[top]), float(middle[top])
            above = np.where(np.isfinite(x.error), x.high, np.inf) - np.where(np.isfinite(x.error), x.error, 0.0)
            keep = (above > best + TOLERANCES.gain_found) & ~(x.least_slope > 0.0) & ~(x.largest_slope < 0.0)
            keep &= half > TOLERANCES.narrowest * middle
            left, right = _halved(left, middle, right, keep, "the gain")
        return self._summit(at, best)

    def _summit(self, at: float, best: float) -> tuple[float, float, float]:
        """Return the largest gain near a frequency, its place improved by Newton's method, and its relative error."""
        if not 0.0 < at < np.inf:
            return float(np.exp(best)), at, self.static()[1] / float(np.exp(best)) if at == 0.0 else self.error_c
        for _ in range(TOLERANCES.newton_steps_crossing):
            away = 1j * at - self.roots
            slope, bend = np.sum(self.signs * 1j / away).real, np.sum(self.signs / away**2).real
            if not bend < 0.0 or not abs(slope / bend) < 1e-3 * at:
                break
            at -= slope / bend
        x = self.gain(np.array([at]), np.zeros(1))
        return float(np.exp(max(best, x.middle[0]))), at, float(x.error[0])


def _level(values: Any, turning: bool) -> Any:
    """Return the levels next to values: 0, or odd multiples of π."""
    return np.pi * (2.0 * np.round((values - np.pi) / (2.0 * np.pi)) + 1.0) if turning else 0.0 * values


def _halved(left: Array, middle: Array, right: Array, which: Any, what: str) -> tuple[Array, Array]:
    """Return both halves of some intervals."""
    if np.sum(which) > TOLERANCES.most_intervals:
        raise Undecided(f"{what} is nearly the same at too many frequencies")
    return np.concatenate([left[which], middle[which]]), np.concatenate([middle[which], right[which]])


def _bounds(
    at: Array, error: Array, slope: Array, off: Array, second: Array, half: Array, low: Array, high: Array
) -> Bounds:
    """Return the bounds of a function by its Taylor series, where they are better than those given."""
    reach = np.abs(slope) * half + 0.5 * second * half**2 + error
    reach = np.where(np.isfinite(reach), reach, np.inf)
    steep = off + second * half
    steep = np.where(np.isfinite(steep), steep, np.inf)
    return Bounds(
        at, error, np.fmax(low, at - reach), np.fmin(high, at + reach), slope - steep, slope + steep
    )  # fmt: skip
