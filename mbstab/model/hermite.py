"""Functions given by points: cubics or lines between the points of a table, in any number system.

A table is a flat sequence of numbers, x, y and slope of each point, by ascending x.
"""

from __future__ import annotations

import itertools
from bisect import bisect_right
from collections.abc import Callable, Sequence
from decimal import Context, Decimal, localcontext
from fractions import Fraction
from typing import Any

EXACT_POINTS = 100
"""Points up to which the slopes of a spline are fractions."""

DIGITS = 60
"""Digits of the slopes of longer splines."""

EDGE = 10**12
"""An argument beyond an end by less than 1/EDGE of the range of a table is rounded, and counts as the end."""


class OutsideTable(ValueError):
    """A table was left at `x`; `points` is the table, `name` what it is called, if that is known."""

    def __init__(self, x: float, points: tuple[Any, ...], name: str = "") -> None:
        called = f" {name!r}" if name else ""
        super().__init__(f"{x:.9g} is outside the table{called}, which goes from {points[0]:g} to {points[-3]:g}")
        self.x, self.points, self.name = x, points, name


def _piece(order: int, s: Any, start: Sequence[Any], end: Sequence[Any]) -> Any:
    """Return a derivative of the cubic between two points at the distance s from the first."""
    (x0, y0, d0), (x1, y1, d1) = start, end
    h = x1 - x0
    chord = (y1 - y0) / h
    second, third = (3 * chord - 2 * d0 - d1) / h, (d0 + d1 - 2 * chord) / (h * h)
    match order:
        case 0:
            return y0 + s * (d0 + s * (second + s * third))
        case 1:
            return d0 + s * (2 * second + 3 * s * third)
        case 2:
            return 2 * second + 6 * s * third
        case _:
            return 6 * third


def _line(order: int, s: Any, start: Sequence[Any], end: Sequence[Any]) -> Any:
    """Return the line between two points at the distance s from the first, or its slope."""
    chord = (end[1] - start[1]) / (end[0] - start[0])
    return start[1] + s * chord if order == 0 else chord


def hermite(order: int, lines: bool = False) -> Callable[..., Any]:
    """Return the formula of a derivative of a table: the sum of its pieces, of which one counts."""
    piece = _line if lines else _piece

    def formula(f: Any, x: Any, *points: Any) -> Any:
        # Quotients of Python integers would be floats, whatever the number system is.
        known = [f.number(str(point)) if isinstance(point, int) else point for point in points]
        rows = [known[i : i + 3] for i in range(0, len(known), 3)]
        first, last = rows[0][0], rows[-1][0]
        total = f.inside(((x - first) / (last - first) * (EDGE - 2) + 1) / EDGE)
        side = f.abs_slope if lines and order else f.signum  # where lines meet there is no slope
        sides = [side(x - row[0]) for row in rows[1:-1]]
        for i, (start, end) in enumerate(itertools.pairwise(rows)):
            part = piece(order, x - start[0], start, end)
            if len(rows) > 2:
                left = 1 if i == 0 else sides[i - 1]
                right = -1 if i == len(sides) else sides[i]
                part = part * (left - right) / 2
            total = total + part
        return total

    return formula


def float_hermite(order: int, lines: bool = False) -> Callable[..., float]:
    """Return a derivative of a table for floats."""
    piece = _line if lines else _piece

    def function(x: float, *points: float) -> float:
        at = points[::3]
        edge = (at[-1] - at[0]) / EDGE
        if not at[0] - edge <= x <= at[-1] + edge:
            raise OutsideTable(x, points)
        i = max(bisect_right(at, x, 0, len(at) - 1) - 1, 0)
        if lines and order and any(abs(x - inner) <= edge for inner in at[1:-1]):
            raise ValueError(f"two lines of the table meet at {x:.9g}, there is no slope")
        found = piece(order, x - at[i], points[3 * i : 3 * i + 3], points[3 * i + 3 : 3 * i + 6])
        if order >= 2 and i and x == at[i]:
            found = (found + _piece(order, x - at[i - 1], points[3 * i - 3 : 3 * i], points[3 * i : 3 * i + 3])) / 2
        return float(found)

    return function


def monotone_slopes(x: Sequence[Fraction], y: Sequence[Fraction]) -> list[Fraction]:
    """Return slopes with which the cubics between points neither overshoot nor turn back (Fritsch, Butland 1984)."""
    h, chords = _chords(x, y)
    if len(x) == 2:
        return [chords[0]] * 2
    found = [_end_slope(h[0], h[1], chords[0], chords[1])]
    for i in range(1, len(h)):
        left, right = chords[i - 1], chords[i]
        weights = 2 * h[i] + h[i - 1], h[i] + 2 * h[i - 1]
        flat = left * right <= 0
        found.append(Fraction(0) if flat else sum(weights) / (weights[0] / left + weights[1] / right))
    return [*found, _end_slope(h[-1], h[-2], chords[-1], chords[-2])]


def _chords(x: Sequence[Any], y: Sequence[Any]) -> tuple[list[Any], list[Any]]:
    """Return the lengths between points, and the slopes of the lines there."""
    h = [b - a for a, b in itertools.pairwise(x)]
    return h, [(b - a) / step for a, b, step in zip(y[:-1], y[1:], h, strict=True)]


def _end_slope(h: Fraction, beyond: Fraction, chord: Fraction, next_chord: Fraction) -> Fraction:
    slope = ((2 * h + beyond) * chord - h * next_chord) / (h + beyond)
    if slope * chord <= 0:
        return Fraction(0)
    if chord * next_chord < 0 and abs(slope) > 3 * abs(chord):
        return 3 * chord
    return slope


def spline_slopes(x: Sequence[Fraction], y: Sequence[Fraction]) -> list[Fraction]:
    """Return slopes with which the second derivative is continuous, and zero at both ends.

    They are exact up to `EXACT_POINTS` points; of more they would be fractions of thousands of digits.
    """
    if len(x) <= EXACT_POINTS:
        return _spline_slopes(x, y)
    with localcontext(Context(prec=DIGITS + 20)):
        rounded = [[Decimal(v.numerator) / v.denominator for v in values] for values in (x, y)]
        return [Fraction(d) for d in _spline_slopes(*rounded)]


def _spline_slopes(x: Sequence[Any], y: Sequence[Any]) -> list[Any]:
    h, chords = _chords(x, y)
    rows = [(0 * h[0], 2, 1, 3 * chords[0])]
    for i in range(1, len(h)):
        rows.append((h[i], 2 * (h[i - 1] + h[i]), h[i - 1], 3 * (h[i] * chords[i - 1] + h[i - 1] * chords[i])))
    rows.append((1, 2, 0 * h[0], 3 * chords[-1]))
    factors: list[tuple[Any, Any]] = [(0 * h[0], 0 * h[0])]
    for below, diagonal, above, right in rows:
        pivot = diagonal - below * factors[-1][0]
        factors.append((above / pivot, (right - below * factors[-1][1]) / pivot))
    found = [0 * h[0]]
    for factor, right in reversed(factors[1:]):
        found.append(right - factor * found[-1])
    return [+d for d in reversed(found[1:])]


def no_slopes(x: Sequence[Fraction], y: Sequence[Fraction]) -> list[Fraction]:
    """Return zeros: lines between points need no slopes."""
    return [Fraction(0)] * len(x)
