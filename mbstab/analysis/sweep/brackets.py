"""Brackets of stability changes: points on both sides, and functions of the spectrum that are zero in between."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mbstab.analysis.algebra.arrays import Complex, Flags, Index
from mbstab.analysis.sweep.tolerances import TOLERANCES
from mbstab.analysis.verdict.rule import Sides
from mbstab.compiler.system import Array
from mbstab.records import dataclass

Test = Callable[[Complex, float, float], float]
"""A function of a spectrum, a typical size of its eigenvalues, and the value of the parameter."""


@dataclass(frozen=True)
class Bracket:
    """Two points between which stability may change.

    Attributes
    ----------
    i, j : int
        Numbers of the points.
    kind : str
        What happens between them …
    test : callable or None
        … and a function of the spectrum that is zero there.
    toward : int
        1 where an eigenvalue passes to the right of the axis, −1 to the left, 0 where that is not known.
    """

    i: int
    j: int
    kind: str
    test: Test | None
    toward: int = 0

    @property
    def points(self) -> tuple[int, int]:
        """Return the numbers of both points."""
        return self.i, self.j


@dataclass(frozen=True)
class Stretch:
    """Points that are close to each other, in continuous columns.

    Attributes
    ----------
    x : ndarray, shape (m,)
    values : ndarray of complex, shape (m, r)
    sides : ndarray of int8, shape (m, r)
    mirrored : ndarray of bool, shape (m,)
    counts : ndarray of int, shape (m,)
        Number of unstable eigenvalues; −1 where more are undecided than elsewhere.
    """

    x: Array
    values: Complex
    sides: Sides
    mirrored: Flags
    counts: Index


@dataclass(frozen=True)
class RealPart:
    """The real part of the eigenvalue nearest to the line from one that is known at a point to that at another."""

    low: float
    before: complex
    high: float
    after: complex

    def number(self, spectrum: Complex, x: float) -> int:
        """Return the number of that eigenvalue at a value of the parameter."""
        place = self.before + (x - self.low) / (self.high - self.low) * (self.after - self.before)
        return int(np.argmin(np.abs(spectrum - place)))

    def __call__(self, spectrum: Complex, size: float, x: float) -> float:
        """Return its real part in units of a size."""
        return float(spectrum[self.number(spectrum, x)].real) / size


def needed(part: Stretch, i: int, j: int) -> bool:
    """Return whether the numbers of unstable eigenvalues at two points tell that stability changes in between."""
    return bool(part.counts[i] != part.counts[j] and min(part.counts[[i, j]]) >= 0)


def spaced(a: float, b: float) -> Array:
    """Return points from a to b: evenly spaced, and denser towards an end that is zero relative to the other."""
    parts = np.linspace(0.0, 1.0, TOLERANCES.jump_parts + 1)
    if min(abs(a), abs(b)) < max(abs(a), abs(b)) / TOLERANCES.jump_parts:
        near = np.geomspace(1e-12, 1.0 / TOLERANCES.jump_parts, TOLERANCES.jump_parts)
        parts = np.union1d(parts, near if abs(a) < abs(b) else 1.0 - near)
    return np.asarray(np.append(a + parts[:-1] * (b - a), b))


def far_apart(one: Complex, other: Complex) -> bool:
    """Return whether the sizes of spectra differ so much that products of their eigenvalues cannot be compared."""
    sizes = sorted((float(np.max(np.abs(one))), float(np.max(np.abs(other)))))
    return sizes[1] > TOLERANCES.spectrum_ratio * sizes[0]
