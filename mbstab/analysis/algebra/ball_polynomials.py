"""Polynomials with balls as coefficients: characteristic polynomials and the location of their roots."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np

from mbstab.analysis.algebra.ball_matrices import determinant
from mbstab.analysis.algebra.balls import Matrix
from mbstab.analysis.algebra.matching import together
from mbstab.analysis.algebra.tolerances import TOLERANCES
from mbstab.model.balls import Ball, Exact, ball, real, zero_inside


def characteristic(A: Matrix) -> list[Ball]:
    """Return the coefficients of det(x − A), the constant first."""
    from flint import arb_mat, fmpq_mat

    n = len(A)
    if all(isinstance(x, Exact) for x in A.flat):
        exact = fmpq_mat([[x.v for x in row] for row in A]).charpoly()
        return [Exact(exact[i]) for i in range(n + 1)]
    if n <= TOLERANCES.determinant_summed_size:
        sums = [ball(0)] * (n + 1)
        for size in range(n + 1):
            for chosen in itertools.combinations(range(n), size):
                sums[size] = sums[size] + _expanded(A[np.ix_(chosen, chosen)].tolist())
        return [sums[n - i] * (-1) ** (n - i) for i in range(n + 1)]
    p = arb_mat([[real(x) for x in row] for row in A]).charpoly()
    return [p[i] for i in range(n + 1)]


def _expanded(A: list[list[Ball]]) -> Ball:
    """Return a determinant as the sum of its nonzero products."""
    if not A:
        return ball(1)
    k = min(range(len(A)), key=lambda i: sum(not x.is_zero() for x in A[i]))
    total = ball(0)
    for j, x in enumerate(A[k]):
        if not x.is_zero():
            minor = [row[:j] + row[j + 1 :] for i, row in enumerate(A) if i != k]
            total = total + (-1) ** (k + j) * x * _expanded(minor)
    return total


def product(*factors: Sequence[Ball]) -> list[Ball]:
    """Return the coefficients of a product of polynomials."""
    whole = [ball(1)]
    for p in factors:
        before, whole = whole, [ball(0)] * (len(whole) + len(p) - 1)
        for i, x in enumerate(before):
            for j, y in enumerate(p):
                if not x.is_zero() and not y.is_zero():
                    whole[i + j] = whole[i + j] + x * y
    return whole


def value(p: Sequence[Any], z: Any) -> Any:
    """Return p(z) by Horner's rule."""
    result = p[-1]
    for coefficient in reversed(p[:-1]):
        result = result * z + coefficient
    return result


def routh(p: Sequence[Ball]) -> list[Ball] | None:
    """Return the first column of Routh's array, or None if an entry that is not the last cannot be told from zero.

    p has as many roots to the right of the imaginary axis as this column changes its sign, and
    none on it if no entry is zero (Gantmacher 1959, chapter XV).
    """
    n = len(p) - 1
    row, following = list(p[n::-2]), list(p[n - 1 :: -2]) if n else []
    column = [row[0]]
    while following:
        if zero_inside(following[0]):
            return None
        column.append(following[0])
        factor = row[0] / following[0]
        rest = [
            row[k + 1] - factor * following[k + 1] if k + 1 < len(following) else row[k + 1]
            for k in range(len(row) - 1)
        ]
        row, following = following, rest
    return column


def right_roots(p: Sequence[Ball]) -> int | None:
    """Return how many roots of p are right of the imaginary axis, with none on it; None if that is not decided."""
    column = routh(p)
    if column is None or any(zero_inside(x) for x in column):
        return None
    return sum(bool(a > 0) != bool(b > 0) for a, b in itertools.pairwise(column))


def all_negative_and_simple(p: Sequence[Ball]) -> bool | None:
    """Return whether all roots of p are real, negative and distinct; None if that is not decided.

    By the Hermite-Biehler theorem this holds if p(s²) + s p'(s²) has all roots in the left half-plane:
    its even and odd parts then have real negative roots that interlace. If this is proven to be false,
    the regular array also shows that p has no multiple root and no root 0.
    """
    mixed: list[Ball] = []
    for k, coefficient in enumerate(p):
        mixed += [coefficient, (k + 1) * p[k + 1]] if k + 1 < len(p) else [coefficient]
    count = right_roots(mixed)
    return None if count is None else count == 0


def resultant(p: Sequence[Ball], q: Sequence[Ball]) -> Ball:
    """Return the determinant of Sylvester's matrix of two polynomials: zero where they have a common root."""
    n, m = len(p) - 1, len(q) - 1
    rows = [[ball(0)] * k + list(reversed(p)) + [ball(0)] * (m - 1 - k) for k in range(m)]
    rows += [[ball(0)] * k + list(reversed(q)) + [ball(0)] * (n - 1 - k) for k in range(n)]
    return determinant(np.array(rows, dtype=object))


def root_discs(p: Sequence[Ball]) -> list[tuple[Any, Ball, int]]:
    """Return discs (centre, radius, number of roots) that together contain all roots of p; p is monic.

    The discs |z − z_k| ≤ n |p(z_k)/Π(z_k − z_j)| about approximations contain all roots, and a
    group of discs disjoint from the others contains as many roots as discs (Smith 1970, J. ACM 17). A real
    centre of a single disc implies a real root.
    """
    from flint import acb, arb

    n = len(p) - 1
    p = [real(x) for x in p]
    middle = [acb(x.mid()) for x in p]
    points = _approximations(middle)
    radii = []
    for k, z in enumerate(points):
        spread = acb(1)
        for j, other in enumerate(points):
            if j != k:
                spread = spread * (z - other)
        size = n * abs(value([acb(x) for x in p], z) / spread)
        radii.append(size if size.is_finite() else arb("+inf"))
    discs = list(zip(points, radii, strict=True))
    near = [[not abs(z - y) > r + t for y, t in discs] for z, r in discs]
    found = []
    for group in together(near):
        if len(group) == 1:
            found.append((points[group[0]], radii[group[0]].abs_upper(), 1))
            continue
        centre = sum((points[k] for k in group), acb(0)) / len(group)
        centre = _middle(centre)
        reach = [(abs(points[k] - centre) + radii[k]).abs_upper() for k in group]
        found.append((centre, max(reach, key=float), len(group)))
    return found


def _middle(z: Any) -> Any:
    """Return the midpoint of a complex ball."""
    from flint import acb

    return acb(z.real.mid(), z.imag.mid())


def _approximations(p: list[Any]) -> list[Any]:
    """Return approximate roots, all distinct, to the digits in use (Aberth's iteration)."""
    from flint import acb, ctx

    n = len(p) - 1
    with np.errstate(all="ignore"):
        rough = np.roots([complex(x) for x in reversed(p)]) if n else np.zeros(0)
    missing = n - len(rough)
    rough = np.concatenate([rough, 1e-3 * np.exp(2j * np.pi * (np.arange(missing) + 0.3) / max(missing, 1))])
    # Points on the real line never leave it: a close pair beside it is not found from there.
    points = [acb(float(x.real), float(x.imag)) * acb(1, 1e-9 * (k + 1)) for k, x in enumerate(rough)]
    slope = [k * x for k, x in enumerate(p)][1:]
    tiny = 2.0 ** (-ctx.prec)
    # A step to a double root gains one bit.
    for _ in range(60 + ctx.prec):
        largest = 0.0
        for k, z in enumerate(points):
            at, by = value(p, z), value(slope, z)
            others = [other for j, other in enumerate(points) if j != k]
            if any(z == other for other in others):
                # As far as digits tell double roots apart.
                z = z + acb(0, (1 + abs(z)) * 2.0 ** (-ctx.prec // 2))
            elif at == 0 or not by.is_finite():
                continue
            else:
                near = sum((1 / (z - other) for other in others), acb(0))
                step = at / _middle(by - at * near)
                largest = max(largest, float(abs(step).mid()) / max(float(abs(z).mid()), 1e-300))
                z = z - step if step.is_finite() else z * (1 + acb(0, 1e-6)) + 1e-12
            points[k] = _middle(z)
        if largest < tiny * 1e6:
            break
    small = 2.0 ** (-0.7 * ctx.prec)
    return [acb(z.real) if abs(float(z.imag)) <= small * abs(float(z.real)) else z for z in points]
