"""Roots of functions of one variable."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from mbstab.analysis.algebra.tolerances import EPS, TOLERANCES

Array = npt.NDArray[np.float64]


class Search:
    """The search for a root of a function whose values at several points cost little more than one value.

    Inverse interpolation by a polynomial through the values around the root, with points closely beside its guess that
    enclose the root; where a guess was of no use, points that divide the interval evenly.

    Parameters
    ----------
    x : ndarray, shape (points,)
        Ascending …
    y : ndarray, shape (points,)
        … with the values of the function there.
    a : int
        Number of the point before the change of sign …
    b : int
        … and of the one after it.
    least : float
        Width of an interval that is narrow enough, whatever the size of the root.
    """

    def __init__(self, x: Array, y: Array, a: int, b: int, least: float = 0.0) -> None:
        inside = np.r_[: a + 1, b : len(x)]
        self.x, self.y, self.left = np.asarray(x, dtype=float)[inside], np.asarray(y, dtype=float)[inside], a
        self.least, self.guessed, self.failed = least, True, False

    @property
    def _ends(self) -> tuple[float, float]:
        return float(self.x[self.left]), float(self.x[self.left + 1])

    @property
    def _best(self) -> int:
        return self.left + int(np.argmin(np.abs(self.y[self.left : self.left + 2])))

    @property
    def best(self) -> float:
        """The point next to the root."""
        return float(self.x[self._best])

    @property
    def residual(self) -> float:
        """The largest size of the function at the points that enclose the root; 0 if it is zero at one of them."""
        sizes = np.abs(self.y[self.left : self.left + 2])
        return float(np.max(sizes) if np.all(sizes) else 0.0)

    def doubt(self, noise: float) -> float:
        """Return how far from the best point the function is seen to be no larger than a noise."""
        loud, best = np.flatnonzero(np.abs(self.y) > noise), self._best
        if best in loud:
            return 0.0
        below, above = loud[loud < best], loud[loud > best]
        ends = int(below[-1]) + 1 if len(below) else 0, int(above[0]) - 1 if len(above) else -1
        return float(np.max(np.abs(self.x[list(ends)] - self.best)))

    @property
    def done(self) -> bool:
        """Whether the root is known to the last digits, or the function has no value in between."""
        a, b = self._ends
        return (
            self.failed
            or 0.0 in self.y[self.left : self.left + 2]
            or b - a <= max(4.0 * EPS * abs(self.best), self.least)
        )

    def points(self, beside: int) -> Array:
        """Return the points to look at next: a guess and so many on each side of it, and zero, a special value."""
        a, b = self._ends
        even = np.linspace(a, b, 2 * beside + 3)[1:-1]
        chosen = even
        if self.guessed:
            guess, error = self.guess()
            reach = 0.5 * max(min(guess - a, b - guess), 0.0) / TOLERANCES.search_spread ** (beside - 1)
            steps = max(
                min(2.0 * error, reach), 2.0 * EPS * abs(guess), 0.5 * self.least
            ) * TOLERANCES.search_spread ** np.arange(beside)
            chosen = np.concatenate([guess - steps, [guess], guess + steps])
        found = np.unique(np.append(chosen, 0.0))
        inside: Array = found[(found > a) & (found < b)]
        return inside if len(inside) else even

    def guess(self) -> tuple[float, float]:
        """Return where the polynomial through values on both sides is zero, and how much the last of them changes."""
        first, last = self.left, self.left + 1
        up = np.sign(self.y[last] - self.y[first])
        while first > max(self.left - 2, 0) and up * (self.y[first] - self.y[first - 1]) > 0.0:
            first -= 1
        while last < min(self.left + 3, len(self.y) - 1) and up * (self.y[last + 1] - self.y[last]) > 0.0:
            last += 1
        nearest = first + np.argsort(np.abs(self.y[first : last + 1]), kind="stable")
        y, row = self.y[nearest], self.x[nearest].copy()
        guesses = [row[0]]
        for k in range(1, len(row)):
            row = row[:-1] + (row[1:] - row[:-1]) * (y[: len(y) - k] / (y[: len(y) - k] - y[k:]))
            guesses.append(row[0])
        return float(guesses[-1]), float(abs(guesses[-1] - guesses[-2]))

    def learn(self, x: Array, y: Array) -> None:
        """Take in the values at points that were asked for."""
        if not np.all(np.isfinite(y)):
            self.failed = True
            return
        a, b = self._ends
        sign, left = np.sign(self.y[self.left]), self.left + 1
        self.x, self.y = np.insert(self.x, left, x), np.insert(self.y, left, y)
        between = np.sign(self.y[left : left + len(x) + 1])
        self.left += int(np.flatnonzero(between != sign)[0])
        low, high = self._ends
        self.guessed = not self.guessed or (high - low) * TOLERANCES.search_useful <= b - a
