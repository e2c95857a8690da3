"""Branches of a sweep with enough points for a smooth curve, with square roots where eigenvalues meet."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from mbstab.analysis.algebra.arrays import Complex
from mbstab.analysis.sweep.sweep import Sweep
from mbstab.compiler.system import Array
from mbstab.report.pictures.curves import Mask

STEPS = (-0.8, -0.6, -0.4, -0.2, -0.07, -0.015, 0.0, 0.015, 0.07, 0.2, 0.4, 0.6, 0.8)
"""Points beside a place where eigenvalues meet, as fractions of the way to the computed ones."""

PARTS = 8
"""Pieces into which a curve is divided between two computed points."""

ENOUGH = 2000
"""Curves of more points are not divided."""

SAME = 1e-3
"""Places closer than this part of the distance of computed points are one."""

Curves = tuple[Array, Complex, Mask]
"""The parameter, shape (n,), ascending, branches and whether they are unstable, shape (n, r)."""


def dense(curves: Curves, result: Sweep, folds: Sequence[float]) -> Curves:
    """Return branches with more points.

    Parameters
    ----------
    curves : Curves
        In SI units.
    result : Sweep
        Knows where eigenvalues meet.
    folds : sequence of float
        Where any path of equilibria turns: an eigenvalue of a path that ends there is zero.
    """
    if result.detail is None:
        curves = _meeting(curves, result)
    for fold in folds:
        curves = _ended(curves, fold)
    return _divided(*curves)


def _meeting(curves: Curves, result: Sweep) -> Curves:
    """Return branches with more points where eigenvalues cross the axis or collide, as a square root does."""
    x, branches, growing = curves
    places = _places(x, branches, result)
    growing = growing.copy()
    rows: list[tuple[float, Complex, Mask]] = []
    for number, (at, (a, b, most)) in enumerate(places.items()):
        alone = all(not x[a] < other < x[b] for k, other in enumerate(places) if k != number)
        through = _through_zero(branches[a], branches[b]) if most == 1 else np.zeros(branches.shape[1], dtype=bool)
        pairs = [pair for pair in _meeting_pairs(x, branches, (a, b), at, most) if not through[list(pair)].any()]
        before, after = branches[a], branches[b]
        grown = growing[a], growing[a] | growing[b], growing[b]
        if b == a + 2:  # it is a computed point
            growing[a + 1] |= grown[1]
        for step in STEPS if alone and (pairs or through.any()) else (0.0,):
            if step == 0.0 and b == a + 2:
                continue
            p = at + step * (at - x[a] if step < 0.0 else x[b] - at)
            row = before + (p - x[a]) / (x[b] - x[a]) * (after - before)
            row[through] = (before if step < 0.0 else after)[through] * np.sqrt(abs(step))
            for i, j in pairs:
                middle = 0.5 * (row[i] + row[j])
                apart = before[i] - before[j] if step < 0.0 else after[i] - after[j]
                row[i], row[j] = (middle + sign * apart * np.sqrt(abs(step)) for sign in (0.5, -0.5))
            rows.append((p, row, grown[1 + int(np.sign(step))]))
    return _with_rows((x, branches, growing), rows)


def _through_zero(before: Complex, after: Complex) -> Mask:
    """Return which branches leave the real axis at zero for the imaginary one, or the other way, as a square root does.

    On one side a branch may be zero: where more than two meet there, which continues which is open.
    """
    tiny = 1e-9 * float(np.max(np.abs([before, after]), initial=0.0))
    # By side and axis: whether a value lies on it.
    on = np.array([[np.abs(values.imag) <= tiny, np.abs(values.real) <= tiny] for values in (before, after)])
    zero = on.all(axis=1)
    turned = np.where(zero.any(axis=0), ~zero.all(axis=0), ~(on[0] & on[1]).any(axis=0))
    found: Mask = on.any(axis=1).all(axis=0) & turned & _opposed(before) & _opposed(after)
    return found


def _opposed(values: Complex) -> Mask:
    """Return which values have their opposite beside them, as in a spectrum symmetric to both axes, or are zero."""
    tiny = 1e-9 * float(np.max(np.abs(values), initial=0.0))
    found: Mask = np.min(np.abs(values[:, None] + values[None, :]), axis=1) <= tiny
    return found


def _places(x: Array, branches: Complex, result: Sweep) -> dict[float, tuple[int, int, int]]:
    """Return where eigenvalues may meet, each with the computed points beside it and the pairs that may collide."""
    # A divergence may be the collision of a pair at zero.
    wanted = [(c.value, {"divergence": len(c.branches), "collision": 2}.get(c.kind, 0)) for c in result.critical]
    wanted += Counter(at for at, how in result.meetings if how == "collide").items()
    found: dict[float, tuple[int, int, int]] = {}
    for at, most in sorted(wanted):
        k = int(np.searchsorted(x, at))
        if not 0 < k < len(x):
            continue
        near = SAME * (x[k] - x[k - 1])
        a, b = int(np.searchsorted(x, at - near)) - 1, int(np.searchsorted(x, at + near, side="right"))
        if a < 0 or b >= len(x) or np.any(np.isnan(branches[a : b + 1])):
            continue
        twin = next((other for other in found if abs(other - at) < near), at)
        found[twin] = a, b, max(most, found[twin][2] if twin in found else 0)
    return found


def _meeting_pairs(x: Array, branches: Complex, ends: tuple[int, int], at: float, most: int) -> list[tuple[int, int]]:
    """Return the pairs of branches that collide between two points: the square of their difference crosses zero."""
    a, b = ends
    part = (at - x[a]) / (x[b] - x[a])
    found = []
    r = branches.shape[1]
    for i in range(r):
        for j in range(i + 1, r):
            one, other = ((branches[m, i] - branches[m, j]) ** 2 for m in (a, b))
            size = abs(one) + abs(other)
            rest = abs(one + part * (other - one))
            if (one * other.conjugate()).real < 0.0 and rest < 0.1 * size:
                found.append((rest / size, i, j))
    pairs: list[tuple[int, int]] = []
    for _, i, j in sorted(found):
        if len(pairs) < most and not any({i, j} & set(pair) for pair in pairs):
            pairs.append((i, j))
    return pairs


def _ended(curves: Curves, fold: float) -> Curves:
    """Return branches up to a fold at which the path ends, if it does: an eigenvalue goes to zero as a root."""
    x, branches, growing = curves
    known = np.flatnonzero(~np.isnan(branches).any(axis=1))
    rows: list[tuple[float, Complex, Mask]] = []
    for last, inner in ((known[0], known[1]), (known[-1], known[-2])) if len(known) > 2 else ():
        step = x[last] - x[inner]
        if not 0.0 < (fold - x[last]) / step < 2.0:
            continue
        slope = (branches[last] - branches[inner]) / step
        # With damping the square of an eigenvalue is linear in the parameter there, without it the fourth power.
        powers = np.array([2.0, 4.0])[:, None]
        there, before = branches[last] ** powers, branches[inner] ** powers
        left = np.abs(there + (there - before) / step * (fold - x[last])) / np.maximum(np.abs(there), 1e-300)
        law = np.where(left[0] < left[1], 2.0, 4.0)
        falls = (left.min(axis=0) < 0.3) & (np.abs(there) < np.abs(before)).all(axis=0)
        for part in (0.3, 0.6, 0.8, 0.93, 0.985, 1.0):
            p = x[last] + part * (fold - x[last])
            row = np.where(falls, branches[last] * (1.0 - part) ** (1.0 / law), branches[last] + slope * (p - x[last]))
            rows.append((p, row, growing[last]))
    return _with_rows(curves, rows)


def _with_rows(curves: Curves, rows: Sequence[tuple[float, Complex, Mask]]) -> Curves:
    """Return curves with more rows, in order."""
    if not rows:
        return curves
    x, branches, growing = curves
    x = np.append(x, [p for p, _, _ in rows])
    order = np.argsort(x, kind="stable")
    branches = np.vstack([branches, *(row for _, row, _ in rows)])[order]
    return x[order], branches, np.vstack([growing, *(grown for _, _, grown in rows)])[order]


def _divided(x: Array, branches: Complex, growing: Mask) -> Curves:
    """Return curves that are smooth at their points and have no extrema between them.

    Squares of imaginary parts are smooth where those themselves begin as a square root does.
    """
    if not 2 < len(x) < ENOUGH:
        return x, branches, growing
    steps = np.diff(x)[:, None]
    squared = branches.real + 1j * branches.imag * np.abs(branches.imag)
    chord = np.diff(squared, axis=0) / steps
    slope = slopes(steps, chord.real) + 1j * slopes(steps, chord.imag)
    new = [(x[:1], branches[:1], growing[:1])]
    inner = np.arange(1, PARTS + 1)[:, None] / PARTS
    for k, (at, end) in enumerate(pairwise(x.tolist())):
        t = inner if not np.isnan(branches[k : k + 2]).any() else inner[-1:]
        h = end - at
        curve = squared[k] + t * h * (
            slope[k]
            + t * (3.0 * chord[k] - 2.0 * slope[k] - slope[k + 1] + t * (slope[k] + slope[k + 1] - 2.0 * chord[k]))
        )
        curve.imag = np.sign(curve.imag) * np.sqrt(np.abs(curve.imag))
        curve[-1] = branches[k + 1]
        grown = np.broadcast_to(growing[k] & growing[k + 1], curve.shape).copy()
        grown[-1] = growing[k + 1]
        new.append((at + h * t[:, 0], curve, grown))
    xs, curves, grown_all = zip(*new, strict=True)
    return np.concatenate(xs), np.concatenate(curves), np.concatenate(grown_all)


def slopes(steps: Array, chord: Array) -> Array:
    """Return the slope of a curve at its points: of parabolas through three, but not steeper than its chords allow.

    Parameters
    ----------
    steps : ndarray, shape (n - 1, 1)
        Distances of points.
    chord : ndarray, shape (n - 1, r)
        Slopes between points, nan where one is missing.
    """
    first, second = chord[:-1], chord[1:]
    one, other = steps[:-1], steps[1:]
    middle = (first * other + second * one) / (one + other)
    # Where the curve turns the slope is small; where it is level on one side it stays so.
    steepest = np.minimum(np.abs(first), np.abs(second)) * np.where(first * second > 0.0, 3.0, 1.0)
    middle = np.clip(middle, -steepest, steepest)
    middle = np.where(np.isnan(middle), np.where(np.isnan(first), second, first), middle)
    edges = [
        np.clip(1.5 * a - 0.5 * b, -3.0 * np.abs(a), 3.0 * np.abs(a))
        for a, b in ((chord[0], middle[0]), (chord[-1], middle[-1]))
    ]
    edges = [np.where(edge * a > 0.0, edge, 0.0) for edge, a in zip(edges, (chord[0], chord[-1]), strict=True)]
    return np.vstack([edges[0], middle, edges[1]])
