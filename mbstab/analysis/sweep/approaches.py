"""Where frequencies come near to an order of the parameter between the points of a sweep: Im λ next to k |Ω|.

A frequency crosses the line where the gap Im λ - k |Ω| changes its sign between two points. It may also reach it twice
between two points, or only come near: such a dip is looked for where the gap is smallest among neighbouring points and
not large beside its change there. Eigenvalues are computed between the points of all such places at once, each assigned
to its branch, and places get narrower from round to round.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mbstab.analysis.algebra.arrays import Complex, Index
from mbstab.analysis.algebra.matching import assigned
from mbstab.analysis.sweep.batched_spectra import Evaluator
from mbstab.analysis.sweep.tolerances import TOLERANCES
from mbstab.compiler.system import Array
from mbstab.records import dataclass


@dataclass(frozen=True)
class Approach:
    """A short interval in which a branch comes nearest to a line, or crosses it.

    Attributes
    ----------
    branch : int
        Of a pair, that with Im λ > 0.
    x : ndarray, shape (k,)
        Values of the parameter, ascending: two about a crossing; three about a dip, unless it is at an end.
    values : ndarray of complex, shape (k,)
        The eigenvalue there.
    crosses : bool
    told : bool
        Whether the points of the sweep show the crossing by themselves.
    """

    branch: int
    x: Array
    values: Complex
    crosses: bool
    told: bool


def approaches(evaluator: Evaluator, parameter: str, x: Array, branches: Complex, order: float) -> list[Approach]:
    """Return where branches cross a line, and the dips beside it.

    Parameters
    ----------
    evaluator : Evaluator
    parameter : str
    x : ndarray, shape (points,)
        Its values at the points (SI), ascending …
    branches : ndarray of complex, shape (points, r)
        … and the eigenvalues there.
    order : float
        The line is Im λ = order |x|.
    """

    def gaps(at: Array, values: Complex) -> Array:
        return np.asarray(values.imag - order * np.abs(at))

    seen = [*_crossings(x, branches, order)]
    alone = [a for a in seen if _is_alone(x, branches, a)]
    found = [a for a in seen if not any(a is b for b in alone)]
    found += (a for j, s in enumerate(branches.T) for a in _dips(j, x, s, order))
    inside = np.linspace(0.0, 1.0, TOLERANCES.points_of_approach + 2)[1:-1]
    for n in range(TOLERANCES.rounds_of_approach):
        # Crossings are located by secants once their branches are alone.
        near = [a for a in found if n < TOLERANCES.rounds_of_crossing or not a.crosses]
        new = {b + t * (c - b) for a in near for b, c in zip(a.x, a.x[1:], strict=False) for t in inside}
        at = np.array(sorted(new))
        if not len(at):
            break
        spectra = evaluator.eigenvalues({parameter: at}, branches.shape[1])
        parts = [a for a in found if n >= TOLERANCES.rounds_of_crossing and a.crosses]
        for a in near:
            chosen = at[(at > a.x[0]) & (at < a.x[-1])]
            index = np.searchsorted(at, chosen)
            own = [_assigned(x, branches, y, row, a) for y, row in zip(chosen, spectra[index], strict=True)]
            rank = np.argsort(places := np.concatenate([a.x, chosen]), kind="stable")
            places, values = places[rank], np.concatenate([a.values, own])[rank]
            places, kept = np.unique(places, return_index=True)
            values = values[kept]
            passed = _changes(gaps(places, values))
            parts += [
                Approach(a.branch, places[k : k + 2], values[k : k + 2], True, a.told and len(passed) == 1)
                for k in passed
            ]
            if not len(passed) and a.crosses:
                parts.append(a)  # there is nothing in between
            elif not len(passed):
                parts += _dips(a.branch, places, values, order)
        found = parts
    return alone + found


def _changes(gap: Array) -> Index:
    """Return the points after which a gap has another sign."""
    with np.errstate(invalid="ignore"):
        passed = (gap[:-1] * gap[1:] < 0.0) | ((gap[:-1] == 0.0) & (gap[1:] != 0.0) & ~np.isnan(gap[1:]))
    return np.flatnonzero(passed)


def _crossings(x: Array, branches: Complex, order: float) -> Iterator[Approach]:
    """Yield the intervals in which a gap changes its sign; an overdamped motion has the frequency 0."""
    line = order * np.abs(x)
    for j, s in enumerate(branches.T):
        for i in _changes(s.imag - line).tolist():
            if min(s.imag[i], s.imag[i + 1]) >= 0.0 and (
                s.imag[i] > line[i] or s.imag[i + 1] > line[i + 1] or s.imag[i] == line[i] > 0.0
            ):
                yield Approach(j, x[i : i + 2], s[i : i + 2], True, True)


def _is_alone(x: Array, branches: Complex, a: Approach) -> bool:
    """Return whether the distances of a branch to all others change little in an interval, so that none meets it."""
    i = int(np.searchsorted(x, a.x[0]))
    before, after = (np.delete(s - s[a.branch], a.branch) for s in branches[i : i + 2])
    nearest = np.minimum(np.abs(before), np.abs(after))
    return bool(np.all(np.abs(after - before) <= TOLERANCES.tracking_step * nearest))


def _dips(branch: int, x: Array, s: Complex, order: float) -> Iterator[Approach]:
    """Yield a point and its neighbours where a gap is smallest among them, and not large beside its change."""
    gap = s.imag - order * np.abs(x)
    for i in np.flatnonzero(s.imag > 0.0).tolist():
        beside = [k for k in (i - 1, i + 1) if 0 <= k < len(x) and s.imag[k] > 0.0 and gap[k] * gap[i] > 0.0]
        changes = [abs(gap[k]) - abs(gap[i]) for k in beside]
        if changes and min(changes) >= 0.0 and abs(gap[i]) <= TOLERANCES.reach_of_dip * max(changes):
            part = sorted([i, *beside])
            yield Approach(branch, x[part], s[part], False, False)


def _assigned(x: Array, branches: Complex, at: float, spectrum: Complex, a: Approach) -> complex:
    """Return the eigenvalue of a branch at a value between points, nan without one.

    It is looked for on a straight line between those that are known; the other branches take theirs.
    """
    i = int(np.clip(np.searchsorted(x, at) - 1, 0, len(x) - 2))
    expected = branches[i] + (at - x[i]) / (x[i + 1] - x[i]) * (branches[i + 1] - branches[i])
    expected[a.branch] = np.interp(at, a.x, a.values.real) + 1j * np.interp(at, a.x, a.values.imag)
    cost = np.abs(expected[:, None] - spectrum)
    return complex(spectrum[assigned(cost)[a.branch]]) if np.all(np.isfinite(cost)) else complex(np.nan, np.nan)
