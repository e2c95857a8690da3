"""Points of a path of equilibria, and runs of them in one direction."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import field

import numpy as np

from mbstab.analysis.algebra.failures import FAILURES
from mbstab.analysis.reference.paths import PathEnd
from mbstab.analysis.reference.tolerances import TOLERANCES
from mbstab.compiler.system import Array
from mbstab.errors import MbstabError, in_one_line
from mbstab.records import dataclass


@dataclass(frozen=True)
class Point:
    """A solution, and how the equations change around it.

    Attributes
    ----------
    q, c : ndarray
    p : float
    tangent : ndarray
        Of the path in scaled unknowns, of length 1.
    left, right : ndarray
        Bases of the left and right null spaces of the equations, aligned from point to point.
    bordered : ndarray
        The derivative of the equations, bordered by them.
    sign : float
        Sign of its determinant.
    least : float
        Smallest singular value apart from those null spaces.
    """

    q: Array
    c: Array
    p: float
    tangent: Array
    left: Array
    right: Array
    bordered: Array
    sign: float
    least: float

    @property
    def rise(self) -> float:
        """The derivative of the parameter by the arc length."""
        return float(self.tangent[-1])

    @property
    def size(self) -> float:
        """The size of the derivative of the equations."""
        return float(np.linalg.norm(self.bordered))

    def turns_to(self, other: Point) -> bool:
        """Return whether the equations may be singular on the way to another solution.

        An eigenvalue of B⁻¹ B' is negative where B + t (B' − B) is singular for a t in 0 … 1; two that change together
        leave the sign of the determinant. Those near 1 are not computed.
        """
        if self.sign != other.sign:
            return True
        change = other.bordered - self.bordered
        if not self.least or np.linalg.norm(change) < min(self.least, 1.0):
            return False
        values = np.linalg.eigvals(np.linalg.solve(self.bordered, other.bordered))
        return bool(np.any(values.real < 0.0))


@dataclass
class Run:
    """Points of a path between two folds, where and why it ends within the range, and where others cross.

    `refused` says why the equations have no value beyond an end. `lead` are the points to which steps led, with the
    fold at its end, but without those that close in on it.
    """

    points: list[Point]
    ends: list[tuple[float, PathEnd]] = field(default_factory=list)
    crossings: list[float] = field(default_factory=list)
    refused: dict[float, str] = field(default_factory=dict)
    lead: list[Point] = field(default_factory=list)


def joined(down: Run, up: Run) -> Run:
    """Return two runs from the same place, or from both sides of a place, as one."""
    first = 1 if down.points[0].p == up.points[0].p else 0
    return Run(
        [*down.points[: first - 1 if first else None : -1], *up.points],
        [*down.ends, *up.ends],
        [*down.crossings, *up.crossings],
        {**down.refused, **up.refused},
    )


def pole_ahead(sizes: Sequence[float], values: Array, end: float, width: float) -> tuple[float, float] | None:
    """Return the value before an end of the range at which positions of these sizes become infinite, and its error.

    There the parameter is a smooth function of 1/size; the difference of two extrapolations to 0 is the error.
    """
    if len(sizes) < TOLERANCES.pole_points or sizes[-1] < TOLERANCES.pole_size or not np.all(np.diff(sizes) > 0.0):
        return None
    near = 1.0 / np.array(sizes)
    pole, other = (_at_zero(near[k:], values[k:]) for k in (0, 1))
    error = abs(pole - other) + TOLERANCES.pole_resolution * width
    ahead = np.copysign(1.0, end - values[-1])
    if not error < TOLERANCES.pole_error * width or ahead * (pole - values[-1]) <= 0.0 or ahead * (end - pole) < -error:
        return None
    return pole, error


def rounded(value: float, error: float, factor: float) -> float:
    """Return a value, rounded in its unit, of so many SI units, to the digits that are known."""
    return float(round(value / factor, -math.ceil(math.log10(abs(2.0 * error / factor)))) * factor) + 0.0  # no −0


def without_value(function: Callable[[float], Array], at: Iterable[float]) -> str:
    """Return why a function has no value at any of several places, in one line; nothing if it has one."""
    said = ""
    for x in at:
        try:
            with np.errstate(all="ignore"):
                value = function(x)
        except FAILURES as error:
            said = in_one_line(error) if isinstance(error, MbstabError) else str(error)
        else:
            if np.all(np.isfinite(value)):
                return ""
            said = "they are not finite"
    return said


def _at_zero(x: Array, y: Array) -> float:
    """Return the value at zero of the polynomial through points."""
    weights = [float(np.prod([other / (other - own) for other in np.delete(x, k)])) for k, own in enumerate(x)]
    return float(np.dot(weights, y))


def nearest_turn(x: Array) -> Array:
    """Return the orthogonal matrix nearest to a square one."""
    left, _, right = np.linalg.svd(x)
    result: Array = left @ right
    return result
