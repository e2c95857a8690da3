"""Constraints of a state in machine code: residuals, projection, rank, where a chart of Euler angles ends; marches."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from mbstab.compiler.machine import tables as at
from mbstab.compiler.machine.interpreter import evaluate
from mbstab.compiler.machine.linear import factor, kinetic, power, slope, solve
from mbstab.compiler.machine.native import compiled, copy, fill, floats, integers
from mbstab.compiler.machine.tables import Floats, Integers, Machine, March

WHOLE, SPEEDS = np.int64(0), np.int64(1)
"""What `settle` moves. Of a literal integer Numba would make two functions."""


@compiled
def residual(m: Machine, y: Floats) -> tuple[float, float]:
    """Return the largest residuals in position and in velocity, as `Constrained.residuals` does."""
    jacobian_row = integers(m, at.JACOBIAN_ROW)
    jacobian_register = integers(m, at.JACOBIAN_REGISTER)
    jacobian_column = integers(m, at.JACOBIAN_COLUMN)
    residual_register = integers(m, at.RESIDUAL_REGISTER)
    reach = floats(m, at.REACH)
    w = floats(m, at.W)
    sizes = floats(m, at.SIZES)
    rows = m.rows
    fill(reach, 1e-300)
    for e in range(len(jacobian_row)):
        reach[jacobian_row[e]] += abs(w[jacobian_register[e]]) * sizes[jacobian_column[e]]
    n, fast = m.coordinates, m.slowest
    for i in range(n):
        fast = max(fast, abs(y[n + i]) / sizes[i])
    position, velocity = 0.0, 0.0
    for i in range(rows):
        if i < m.holonomic:
            position = max(position, abs(w[residual_register[i]]) / reach[i])
        velocity = max(velocity, abs(w[residual_register[rows + i]]) / (reach[i] * fast))
    return position, velocity


@compiled
def correct(m: Machine, y: Floats, speeds: int) -> bool:
    """Change coordinates, or speeds, by the least that makes their rows vanish, in the metric of M.

    The rows that are not meant are left as they are.
    """
    row_place = integers(m, at.ROW_PLACE)
    place = integers(m, at.PLACE)
    residual_register = integers(m, at.RESIDUAL_REGISTER)
    b = floats(m, at.B)
    residual_sign = floats(m, at.RESIDUAL_SIGN)
    w = floats(m, at.W)
    row_scale = floats(m, at.ROW_SCALE)
    x = floats(m, at.X)
    scale = floats(m, at.SCALE)
    rows, offset, start = m.holonomic, 0, 0
    if speeds:
        rows, offset, start = m.rows, m.coordinates, m.rows
    factor(m)
    fill(b, 0.0)
    for i in range(rows):
        if row_place[i] >= 0:
            b[row_place[i]] = -residual_sign[start + i] * w[residual_register[start + i]] * row_scale[i]
    if not solve(m):
        return False
    for i in range(m.coordinates):
        y[offset + i] += x[place[i]] * scale[i]
    return True


@compiled
def settle(m: Machine, t: float, y: Floats, counts: Integers, first: np.int64) -> float:
    """Move a state onto the constraints; return the residual that is left, and the registers at that state.

    With `first` = `SPEEDS` only its speeds.
    """
    best = floats(m, at.BEST)
    least = math.inf
    for _ in range(m.projections):
        counts[at.EVALUATIONS] += 1
        if not evaluate(m, t, y, 1):
            return math.inf
        position, velocity = residual(m, y)
        size = velocity if first else max(position, velocity)
        if size >= 0.5 * least:  # rounding is reached
            if size > least:
                copy(y, best)
                evaluate(m, t, y, 1)
            return min(size, least)
        copy(best, y)
        least = size
        if size <= m.projected:
            return size
        for speeds in range(first if position > m.projected else 1, 2):
            if not correct(m, y, speeds):
                return math.inf
            if speeds == 0:
                counts[at.EVALUATIONS] += 1
                if not evaluate(m, t, y, 1):
                    return math.inf
    return least


@compiled
def watch(m: Machine) -> tuple[bool, float]:
    """Whether the least singular value of the rows changed its sign, and its square; take its vectors along.

    One step of inverse iteration with the factors of the present state, in the metric of M.
    """
    jacobian_row = integers(m, at.JACOBIAN_ROW)
    row_place = integers(m, at.ROW_PLACE)
    jacobian_column = integers(m, at.JACOBIAN_COLUMN)
    jacobian_register = integers(m, at.JACOBIAN_REGISTER)
    place = integers(m, at.PLACE)
    jacobian_sign = floats(m, at.JACOBIAN_SIGN)
    w = floats(m, at.W)
    row_scale = floats(m, at.ROW_SCALE)
    left = floats(m, at.LEFT)
    scale = floats(m, at.SCALE)
    right = floats(m, at.RIGHT)
    b = floats(m, at.B)
    shift = floats(m, at.SHIFT)
    x = floats(m, at.X)
    seen = 0.0
    for e in range(len(jacobian_row)):
        row = row_place[jacobian_row[e]]
        if row >= 0:
            column = jacobian_column[e]
            entry = jacobian_sign[e] * w[jacobian_register[e]] * row_scale[jacobian_row[e]]
            seen += left[row] * entry * scale[column] * right[place[column]]
    copy(b, left)
    if not solve(m):
        return True, 0.0
    size = 0.0
    for i in range(len(left)):
        if shift[i] < 0.0:
            size += x[i] * x[i]
    size = math.sqrt(size)
    if size == 0.0:
        return False, math.inf
    for i in range(len(left)):
        if shift[i] < 0.0:
            left[i] = -x[i] / size
            right[i] = 0.0
        else:
            right[i] = x[i]
    return seen < 0.0, 1.0 / size


@compiled
def chart_ends(m: Machine, before: Floats, y: Floats) -> bool:
    """Whether an angle has come to where Euler angles are replaced, or, of a body that keeps its own, are singular."""
    angle = integers(m, at.ANGLE)
    pinned = integers(m, at.PINNED)
    least_cosine = floats(m, at.LEAST_COSINE)
    for i in range(len(angle)):
        cosine = math.cos(y[angle[i]])
        if abs(cosine) < least_cosine[i]:
            return True
        if pinned[i] and cosine * math.cos(before[angle[i]]) < 0.0:
            return True
    return False


@compiled
def watched(m: Machine, s: March) -> bool:
    """Look at the rank at the start of a march, where the matrix is factored; False if nothing can be done there."""
    if m.rows == 0:
        return True
    for _ in range(3):
        watch(m)
    _, value = watch(m)
    if s.t[at.LEAST] == 0.0:
        s.t[at.LEAST] = value
    return not value <= s.near * s.t[at.LEAST]


@compiled
def passed(m: Machine, s: March) -> bool:
    """Look at the residuals, the energy and the rank after a step; False if somebody has to look at it.

    The matrix is factored at the state of the registers.
    """
    left_over = max(*residual(m, floats(m, at.TRIAL)))
    if m.rows > 0:
        flipped, value = watch(m)
        if flipped or value <= s.near * s.t[at.LEAST]:
            return False
    s.t[at.PEAK] = max(s.t[at.PEAK], kinetic(m))
    s.t[at.RESIDUAL] = max(s.t[at.RESIDUAL], left_over)
    return True


def covering(
    inside: Callable[[Machine, March, Any, float, float, Floats], bool],
) -> Callable[[Machine, March, Any, float, float], bool]:
    """Return the function that finds the output of a step, given that which finds the state at a part of a step."""

    @compiled
    def cover(m: Machine, s: March, p: Any, t: float, h: float) -> bool:
        """Find the work of a step to t and the states at the times of output within; False where there are none."""
        n, z, begin = m.coordinates, floats(m, at.INSIDE), s.t[at.TIME]
        nodes, weights = p.quadrature[0], p.quadrature[1]
        start, work, done = begin, 0.0, s.counts[at.COVERED]
        while True:
            within = done < len(s.times) and s.times[done] <= t
            stop = s.times[done] if within else t
            if m.power_register >= 0 and stop > start:
                half = 0.5 * (stop - start)
                for i in range(len(nodes)):
                    middle = start + half * (1.0 + nodes[i])
                    if not inside(m, s, p, h, (middle - begin) / h, z):
                        return False
                    s.counts[at.EVALUATIONS] += 1
                    if not slope(m, middle, z, floats(m, at.OTHER)):
                        return False
                    work += half * weights[i] * power(m, z)
            if not within:
                break
            if stop == t:
                copy(z, floats(m, at.TRIAL))
            elif not inside(m, s, p, h, (stop - begin) / h, z):
                return False
            if not settle(m, stop, z, s.counts, WHOLE) <= m.accepted:
                return False
            copy(s.found[done, : 2 * n], z)
            s.found[done, 2 * n] = s.t[at.WORK] + work
            start = stop
            done += 1
        s.counts[at.COVERED] = done
        s.t[at.WORK] += work
        return True

    return cover


def follower(
    begin: Callable[[Machine, March, Any], bool],
    advance: Callable[[Machine, March, Any], tuple[float, float, float]],
    arrived: Callable[[Machine, March, Any, float], bool],
    cover: Callable[[Machine, March, Any, float, float], bool],
    keep: Callable[[Machine, March, Any, float, float], bool],
) -> Callable[[Machine, March, Any, int, bool], int]:
    """Return the function that takes the steps of a method, which is given as functions that may say False.

    Parameters
    ----------
    begin
        Starts a march.
    advance
        Takes a step to `tables.TRIAL`; returns its end, nan if there is none, it, and the next one (s).
    arrived, cover, keep
        Look at the end of a step, find its output, and keep what the next one needs.
    """

    @compiled
    def follow(m: Machine, s: March, p: Any, most: int, fresh: bool) -> int:
        """Take steps, at first those of a `fresh` start; return why it ended.

        A step that somebody has to look at is not taken.
        """
        y, before = floats(m, at.Y), floats(m, at.BEFORE)
        if fresh and not begin(m, s, p):
            return at.LOOK
        for _ in range(most):
            t, h, following = advance(m, s, p)
            if math.isnan(t) or not arrived(m, s, p, t) or not cover(m, s, p, t, h) or not keep(m, s, p, t, h):
                return at.LOOK
            s.counts[at.STEPS] += 1
            copy(before, y)
            copy(y, floats(m, at.TRIAL))
            s.t[at.TIME], s.t[at.FOLLOWING], s.t[at.TAKEN] = t, following, h
            if chart_ends(m, before, y):
                return at.CHART
            if t >= s.end:
                return at.DONE
        return at.MORE

    return follow
