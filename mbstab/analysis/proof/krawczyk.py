"""Zeros of equations that are proven to exist: the operator of Krawczyk."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np

from mbstab.analysis.algebra import ball_matrices
from mbstab.analysis.algebra.balls import Matrix, NotProvable
from mbstab.analysis.proof.tolerances import TOLERANCES
from mbstab.errors import MbstabError
from mbstab.model import balls
from mbstab.model.balls import ball


def independent_rows(A: Any, rank: int) -> list[int]:
    """Return the numbers of rows that are independent of each other, as many as asked for (pivoted Gram-Schmidt)."""
    rest = np.array(A, dtype=float)
    chosen: list[int] = []
    for _ in range(rank):
        sizes = np.linalg.norm(rest, axis=1)
        sizes[chosen] = -1.0
        k = int(np.argmax(sizes))
        chosen.append(k)
        unit = rest[k] / sizes[k]
        for _ in range(2):
            rest = rest - np.outer(rest @ unit, unit)
    return sorted(chosen)


def krawczyk_boxes(
    residual: Callable[[Matrix], Matrix], jacobian: Callable[[Matrix], Matrix], start: Matrix, what: str
) -> tuple[Matrix, Matrix]:
    """Return balls that contain a zero of as many equations as unknowns, and wider ones that contain no other.

    With an approximate inverse Y and x near the zero, x − Y f(x) + (1 − Y f'(X))(X − x) inside X
    proves it (Krawczyk 1969). A zero at short fractions is returned without radius.

    Raises
    ------
    NotProvable
        If the operator does not contract.
    """
    from flint import arb, ctx

    Y, x = _newton(residual, jacobian, start, what)
    size = [max(abs(float(y)), 1e-30) for y in map(balls.real, start)]
    base = ball_matrices.times(Y, residual(x))
    tiny = arb(2) ** (-ctx.prec)
    reach = [balls.real((2 * abs(z).abs_upper() + tiny * ball(s)).abs_upper()) for z, s in zip(base, size, strict=True)]
    for _ in range(12):
        offset = np.array([arb(0, r) for r in reach], dtype=object)
        X = x + offset
        try:
            product = ball_matrices.times(Y, jacobian(X))
        except (NotProvable, MbstabError):
            break
        moved = ball_matrices.times(np.eye(len(x), dtype=int) - product, offset) - base
        if all(arb(0, r).contains_interior(balls.real(z)) for z, r in zip(moved, reach, strict=True)):
            exact = _as_fractions(residual, x + moved)
            return x + moved if exact is None else exact, X
        reach = [2 * max(balls.real(abs(z)).abs_upper(), r, key=float) for z, r in zip(moved, reach, strict=True)]
    raise NotProvable(f"{what} is not proven to exist: the operator of Krawczyk does not contract")


def _as_fractions(residual: Callable[[Matrix], Matrix], found: Matrix) -> Matrix | None:
    """Return the one zero in some balls as short fractions, if it is one."""
    from flint import fmpq

    fractions = []
    for x in map(balls.real, found):
        mantissa, exponent = (int(part) for part in x.mid().man_exp())
        nearest = (Fraction(mantissa) * Fraction(2) ** exponent).limit_denominator(TOLERANCES.fraction_denominator)
        if not x.contains(fmpq(nearest.numerator, nearest.denominator)):
            return None
        fractions.append(ball(nearest))
    exact = np.array(fractions, dtype=object)
    return exact if all(y.is_zero() for y in residual(exact)) else None


def _newton(
    residual: Callable[[Matrix], Matrix], jacobian: Callable[[Matrix], Matrix], start: Matrix, what: str
) -> tuple[Matrix, Matrix]:
    """Return an approximate inverse of the derivative, and a point near the zero."""
    x = _middle(start)
    Y = _inverse(jacobian(x))
    if Y is None:
        raise NotProvable(f"{what} is not proven to exist: the equations are singular there")
    last, stalled = np.inf, 0
    for _ in range(60):
        step = ball_matrices.times(Y, residual(x))
        x = _middle(x - step)
        change = max(float(abs(z).mid()) for z in step)
        stalled += change > 0.5 * last
        if change == 0.0 or stalled > 1:
            break
        if change > TOLERANCES.fast_convergence * last:
            better = _inverse(jacobian(x))
            Y = Y if better is None else better
        last = change
    return Y, x


def _inverse(jacobian: Matrix) -> Matrix | None:
    """Return an approximate inverse, None of a matrix that is singular in double precision."""
    slope = jacobian.astype(float)
    rows = np.max(np.abs(slope), axis=1)
    with np.errstate(all="ignore"):
        try:
            inverse = np.linalg.inv(slope / rows[:, None]) / rows
        except np.linalg.LinAlgError:
            return None
    return ball_matrices.matrix(inverse.tolist()) if np.all(np.isfinite(inverse)) else None


def _middle(x: Matrix) -> Matrix:
    """Return the midpoints of balls."""
    return np.array([balls.real(y).mid() for y in x], dtype=object)
