"""A sweep as curves: branches in declared units, with the points where they meet, critical values, and ranges."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from mbstab.analysis.algebra.arrays import Complex
from mbstab.analysis.sweep.critical import Critical
from mbstab.analysis.sweep.sweep import Sweep
from mbstab.compiler.system import Array
from mbstab.report.pictures.curves import Mask, branch_ink
from mbstab.report.pictures.dense_curves import dense
from mbstab.report.pictures.scales import Axis, number_text

TINY = 1e-10
"""Imaginary parts below this fraction of the largest eigenvalue are drawn as zero."""


class SweepCurves:
    """A sweep in declared units, ready to be drawn.

    Attributes
    ----------
    points, unstable : ndarray, shape (points,)
        Parameter, ascending, and number of unstable eigenvalues.
    x : ndarray, shape (n,)
        Parameter with more points where eigenvalues meet or cross the imaginary axis; ascending unless `turned` is
        false.
    real, imag : ndarray, shape (n, r)
    growing : ndarray of bool, shape (n, r)
        Which eigenvalues are the unstable ones.
    size : float
        Largest eigenvalue.
    span : float
        Range of the parameter.
    ink : list of str
        A colour for each branch; those that are conjugate to each other longest share theirs.
    named : dict
        Names of branches with their colours.
    critical : list of list of Critical
        Critical values grouped if they agree in six digits; values in the declared unit.
    marked : list of list of Critical
        The same, including those of the other paths.
    unanswered : ndarray of bool, shape (points,)
        Where there is no verdict.
    gap : str
        Text of the legend for these points.
    judged : list of (float, float, int)
        Ranges with one verdict, ascending: stable (0), unstable (1) or undecided (−1).
    unsure : list of (float, float)
        The ends of a range in which branches may be mistaken for each other.
    others : list of SweepCurves
        The paths beyond the turns of the first one, and those that branch off.
    """

    def __init__(self, result: Sweep, label: Axis, turned: bool = True, folds: Sequence[float] = ()) -> None:
        self.label = label
        x, branches, self.unstable = np.asarray(result.values, dtype=float), result.branches, result.unstable
        # A nan with an imaginary part of 0 would be drawn as 0.
        branches = np.where(np.isnan(branches), complex(math.nan, math.nan), branches)
        down = len(x) > 1 and x[0] > x[-1]
        if down:
            x, branches, self.unstable = x[::-1], branches[::-1], self.unstable[::-1]
        self.points = x / label.factor
        self.span = float(np.ptp(self.points)) if len(x) > 1 else abs(float(self.points[0])) if len(x) else 1.0
        finite = np.abs(branches[~np.isnan(branches)])
        self.size = float(np.max(finite, initial=0.0)) or 1.0
        self.ink = _inks(branches)
        self.named = {name: ink for name, ink in zip(result.names, self.ink, strict=False) if name}
        turns = [c.value for path in (result, *result.beyond) for c in path.critical if c.kind == "fold"]
        folds = folds or list(
            dict.fromkeys([*turns, *(path.start for path in result.beyond if path.start is not None)])
        )
        growing = _growing(branches, self.unstable)
        self.unsure: list[tuple[float, float]] = []
        if result.detail is not None:
            fine = result.detail
            own = np.searchsorted(fine.values, x)
            grown = fine.growing.copy()
            grown[own] = growing
            x, branches, growing = fine.values, fine.branches, grown
            self.unsure = [(low / label.factor, high / label.factor) for low, high in fine.unsure]
        x, branches, self.growing = dense((x, branches, growing), result, folds)
        if down and not turned:
            x, branches, self.growing = x[::-1], branches[::-1], self.growing[::-1]
        self.x, self.real, self.imag = x / label.factor, branches.real, branches.imag
        self.critical = self._grouped(result)
        self.others = [SweepCurves(path, label, turned, folds) for path in result.beyond]
        self.size = max([self.size, *(other.size for other in self.others)])
        unanswered, undecided = _without_verdict(result)
        self.gap = unanswered_text(bool(unanswered.any()), bool(undecided.any()))
        self.unanswered = (unanswered | undecided)[:: -1 if down else 1]
        self.judged = [
            (x.low / label.factor, x.high / label.factor, -1 if x.unstable is None else int(x.unstable))
            for x in result.ranges
        ]
        self.marked = sorted(
            [*self.critical, *(group for other in self.others for group in other.critical)],
            key=lambda group: group[0].value,
        )

    def _grouped(self, result: Sweep) -> list[list[Critical]]:
        """Return the critical values in the declared unit; those that agree in six digits are together."""
        groups: list[list[Critical]] = []
        for c in sorted(result.critical, key=lambda c: c.value):
            item = replace(c, value=c.value / self.label.factor)
            if groups and self.show(groups[-1][0].value) == self.show(item.value):
                groups[-1].append(item)
            else:
                groups.append([item])
        return groups

    def all(self, part: Callable[[SweepCurves], Array]) -> Array:
        """Return an array of this path and of the others, stacked vertically."""
        found = [part(curves) for curves in (self, *self.others)]
        width = max(x.shape[1] for x in found)
        return np.concatenate([np.pad(x, ((0, 0), (0, width - x.shape[1])), constant_values=np.nan) for x in found])

    def show(self, value: float) -> str:
        """Return a value of the parameter with six digits."""
        return number_text(value, self.span, 6)

    def upper_half(self) -> Array:
        """Return the positive imaginary parts, and 0 next to them, where a frequency starts or ends; nan elsewhere."""
        tiny = TINY * self.size
        above, zero = self.imag > tiny, np.abs(self.imag) <= tiny
        beside = np.zeros_like(above)
        beside[1:] |= above[:-1]
        beside[:-1] |= above[1:]
        return np.where(above | (zero & beside), self.imag, np.nan)

    def paired(self) -> Complex:
        """Return the eigenvalues on the real axis and above it, nan elsewhere; those below are their mirror images."""
        tiny = TINY * self.size
        upper: Complex = self.real + 1j * np.maximum(self.imag, 0.0)
        upper[~(self.imag >= -tiny)] = complex(math.nan, math.nan)
        return upper

    def ranges(self) -> Iterator[tuple[float, float, int]]:
        """Yield ranges of the parameter that are unstable (1) or have no answer (−1), each as long as possible."""
        x = self.points.tolist()
        if len(x) < 2:
            return
        edges, found = [x[0], *(end for piece in self.judged for end in piece[:2]), x[-1]], list(self.judged)
        # A point without an answer on any path leaves open what lies around it, up to what is judged.
        turns = np.flatnonzero(np.diff(self.unanswered, prepend=False, append=False)).tolist()
        for first, last in zip(turns[::2], turns[1::2], strict=True):
            a, b = x[max(first - 1, 0)], x[min(last, len(x) - 1)]
            found += [(max(a, low), min(b, high), -1) for low, high in zip(edges[::2], edges[1::2], strict=True)]
        joined: list[tuple[float, float, int]] = []
        for low, high, state in sorted(piece for piece in found if piece[1] - piece[0] > 1e-9 * self.span):
            if joined and joined[-1][2] == state and low - joined[-1][1] <= 1e-9 * self.span:
                low = joined.pop()[0]
            joined.append((low, high, state))
        yield from (piece for piece in joined if piece[2])


def unanswered_text(unanswered: bool, undecided: bool) -> str:
    """Return the text of the legend for points without a verdict."""
    return " or ".join(["undecided"] * undecided + ["no answer"] * (unanswered or not undecided))


def _without_verdict(result: Sweep) -> tuple[Mask, Mask]:
    """Return which points of a sweep have no answer, and which an open verdict."""
    unanswered = np.zeros(len(result.values), dtype=bool)
    unanswered[result.unanswered] = True
    # An undecided point on a critical value leaves nothing open next to it.
    places = np.array([c.value for c in result.critical])
    width = float(np.max(np.abs(result.values), initial=0.0))
    at = np.any(np.abs(result.values[:, None] - places) <= 1e-9 * width, axis=1)
    return unanswered, (result.unstable < 0) & ~np.any(np.isnan(result.branches), axis=1) & ~at


def _growing(branches: Complex, unstable: npt.NDArray[np.intp]) -> Mask:
    """Return which eigenvalues are unstable: as many as were counted, those farthest to the right."""
    rank = np.argsort(np.argsort(-branches.real, axis=1, kind="stable"), axis=1, kind="stable")
    found: Mask = (rank < unstable[:, None]) & (branches.real > 0.0)
    return found


def _inks(branches: Complex) -> list[str]:
    """Return colours of branches, in pairs: the same for those that are conjugate to each other at most points."""
    r = branches.shape[1]
    some = branches[:: max(1, len(branches) // 500)]
    size = np.max(np.abs(some), axis=1, initial=0.0)
    pairs: list[tuple[int, int, int]] = []
    for i in range(r):
        for j in range(i):
            apart = np.abs(some[:, i] - np.conj(some[:, j]))
            points = np.sum((apart <= 1e-9 * size) & (np.abs(some[:, i].imag) > 1e-6 * size))
            pairs += [(-int(points), j, i)] * bool(points)
    partner: dict[int, int] = {}
    for _, j, i in sorted(pairs):
        if j not in partner and i not in partner:
            partner[i], partner[j] = j, j
    group = [partner.get(i, i) for i in range(r)]
    order = list(dict.fromkeys(group))
    return [branch_ink(order.index(g)) for g in group]
