"""Branches with the points between those of a sweep, dense enough for a picture.

The search for branches and critical values leaves points between those that are asked for: where eigenvalues meet, and
at critical values. Where the curves bend, a few more are computed.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from mbstab.analysis.algebra.arrays import Complex, Flags, Index
from mbstab.analysis.algebra.matching import together
from mbstab.analysis.sweep.branches import Branches
from mbstab.analysis.sweep.tolerances import TOLERANCES
from mbstab.analysis.sweep.tracking import certain_links
from mbstab.analysis.verdict.rule import RIGHT, Sides
from mbstab.compiler.system import Array
from mbstab.records import dataclass


@dataclass(frozen=True)
class Detail:
    """Branches at the points of a sweep and between them.

    Attributes
    ----------
    values : ndarray, shape (n,)
        Of the parameter (SI), ascending.
    branches : ndarray of complex, shape (n, r)
        In the columns of the sweep (1/s); nan where there is no answer, and where what continues a branch is open.
    growing : ndarray of bool, shape (n, r)
        Which eigenvalues are on the right of the axis.
    unsure : tuple of (float, float)
        The ends of a range in which the search ended early.
    """

    values: Array
    branches: Complex
    growing: Flags
    unsure: tuple[tuple[float, float], ...] = ()


def detailed(tracker: Branches, branches: Complex) -> Detail | None:
    """Return the branches of a sweep with the points between; None if the sweep itself has points enough.

    Parameters
    ----------
    tracker : Branches
        With the points at which it looked.
    branches : ndarray of complex, shape (points, r)
        Columns that are continuous over the points.
    """
    x = tracker.x
    if not 2 <= len(x) <= TOLERANCES.detail_enough or not branches.shape[1] or not tracker.good.any():
        return None
    unsure: tuple[tuple[float, float], ...] = ()
    if tracker.stopped is not None:
        low, high = np.clip(tracker.stopped, 0, len(x) - 1).tolist()
        unsure = ((float(x[low]), float(x[high])),)
    room = TOLERANCES.detail_points if len(x) < TOLERANCES.detail_coarse and not unsure else 0
    room = min(room, TOLERANCES.detail_eigenvalues // branches.shape[1])
    found = _joined(tracker, branches)
    batch = TOLERANCES.detail_first
    while room > 0:
        more = np.unique([*_open(found[0], found[1]), *_bent(found[0], found[1])][: min(room, batch)])
        if not len(more):
            break
        tracker.look(more)
        found = _joined(tracker, branches)
        if tracker.evaluator.alone:
            break
        room, batch = room - len(more), TOLERANCES.detail_points
    values, curves, growing = found
    return Detail(*_broken(values, curves, growing), unsure)


def _joined(tracker: Branches, branches: Complex) -> tuple[Array, Complex, Flags]:
    """Return all points with their eigenvalues in the columns of the branches."""
    own = tracker.x
    near = TOLERANCES.detail_apart * float(np.ptp(own))
    looked = np.array([p for p, at in tracker.looked.items() if not np.any(np.isnan(at.values))])
    inside = looked[(looked > own[0]) & (looked < own[-1])] if len(looked) else looked
    x = np.unique(np.concatenate([own, inside]))
    kept, last = [], -np.inf
    is_own = np.isin(x, own)
    after = own[np.minimum(np.searchsorted(own, x, side="right"), len(own) - 1)]
    for p, mine, following in zip(x.tolist(), is_own.tolist(), after.tolist(), strict=True):
        if mine or (p - last >= near and following - p >= near):
            kept.append(p)
            last = p
    x = np.array(kept)
    place = np.searchsorted(own, x)
    rows = np.flatnonzero(own[np.minimum(place, len(own) - 1)] == x)
    values = np.empty((len(x), branches.shape[1]), dtype=complex)
    sides: Sides = np.empty(values.shape, dtype=np.int8)
    values[rows], sides[rows] = branches, tracker.sides(branches, np.arange(len(own)))
    for i in np.setdiff1d(np.arange(len(x)), rows).tolist():
        at = tracker.looked[float(x[i])]
        values[i], sides[i] = at.values, at.sides
    order = np.tile(np.arange(values.shape[1]), (len(x), 1))
    links, _ = certain_links(x, values)
    for a, b in pairwise(rows.tolist()):
        if b > a + 1:
            order[a : b + 1] = _between(values[a : b + 1], links[a:b])
    take = np.take_along_axis
    return x, take(values, order, axis=1), take(sides, order, axis=1) == RIGHT


def _between(values: Complex, links: Index) -> Index:
    """Return the orders of spectra between two points whose orders are known: followed from both, joined where best.

    Those that exchange their places are joined where they are next to each other, whatever the others do.
    """
    if np.any(np.isnan(values[[0, -1]])):
        return np.tile(np.arange(values.shape[1]), (len(values), 1))
    forward, backward = [np.arange(values.shape[1])], [np.arange(values.shape[1])]
    for link in links:
        forward.append(link[forward[-1]])
    for link in links[::-1]:
        backward.append(np.argsort(link)[backward[-1]])
    ahead, back = np.array(forward), np.array(backward[::-1])
    one, other = (np.take_along_axis(values, order, axis=1) for order in (ahead, back))
    jump, places = np.abs(one[:-1] - other[1:]), np.argsort(back[-1])[ahead[-1]]
    moves = places[:, None] == np.arange(len(places))
    for group in together(moves | moves.T):
        best = int(np.argmin(np.sum(jump[:, group], axis=1)))
        ahead[best + 1 :, group] = back[best + 1 :, group]
    return ahead


def _scale(branches: Complex) -> Array:
    """Return the extent of each branch, but no less than a part of that of the largest."""
    with np.errstate(invalid="ignore"):
        known = branches[~np.isnan(branches).any(axis=1)]
    extent = np.maximum(np.ptp(known.real, axis=0), np.ptp(known.imag, axis=0))
    scale: Array = np.maximum(extent, TOLERANCES.detail_smallest * max(float(np.max(np.abs(known))), 1e-300))
    return scale


def _bent(x: Array, branches: Complex) -> Array:
    """Return the middles of intervals beside points that are far from the chord of their neighbours, worst first."""
    if len(x) < 3:
        return np.zeros(0)
    part = ((x[1:-1] - x[:-2]) / (x[2:] - x[:-2]))[:, None]
    chord = branches[:-2] + part * (branches[2:] - branches[:-2])
    off = np.nan_to_num(np.max(np.abs(branches[1:-1] - chord) / _scale(branches), axis=1))
    need = np.zeros(len(x) - 1)
    need[:-1] = off
    need[1:] = np.maximum(need[1:], off)
    # A narrow interval beside a wide one needs no more points.
    steps = np.diff(x)
    need[steps < TOLERANCES.detail_narrow * (x[-1] - x[0])] = 0.0
    need[np.isnan(branches[:-1]).any(axis=1) | np.isnan(branches[1:]).any(axis=1)] = 0.0
    worst = np.argsort(-need, kind="stable")[: np.count_nonzero(need > TOLERANCES.detail_bend)]
    middles: Array = 0.5 * (x[worst] + x[worst + 1])
    return middles


def _jumps(x: Array, branches: Complex) -> Flags:
    """Return where branches would jump from one eigenvalue to another, shape (n − 1, r)."""
    links, clear = certain_links(x, branches)
    going_on = clear[:, None] & (links == np.arange(branches.shape[1]))
    far: Flags = ~going_on & (np.abs(np.diff(branches, axis=0)) > TOLERANCES.detail_jump * _scale(branches))
    return far


def _open(x: Array, branches: Complex) -> Array:
    """Return the middles of intervals in which what continues a branch is open, if they are wide enough to divide."""
    wide = np.diff(x) > TOLERANCES.detail_meeting * (x[-1] - x[0])
    middles: Array = (0.5 * (x[:-1] + x[1:]))[_jumps(x, branches).any(axis=1) & wide]
    return middles


def _broken(x: Array, branches: Complex, growing: Flags) -> tuple[Array, Complex, Flags]:
    """Return branches with a gap where they would jump from one eigenvalue to another."""
    far = _jumps(x, branches)
    steps = np.flatnonzero(far.any(axis=1))
    if not len(steps):
        return x, branches, growing
    middle = 0.5 * (branches[steps] + branches[steps + 1])
    middle[far[steps]] = complex(np.nan, np.nan)
    at = 0.5 * (x[steps] + x[steps + 1])
    order = np.argsort(np.concatenate([x, at]), kind="stable")
    return (
        np.concatenate([x, at])[order],
        np.concatenate([branches, middle])[order],
        np.concatenate([growing, growing[steps] & growing[steps + 1]])[order],
    )
