"""Matrices of balls: products that keep structural zeros, elimination with pivots that are proven to be nonzero."""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from typing import Any

import numpy as np

from mbstab.analysis.algebra.balls import Matrix, NotProvable
from mbstab.analysis.algebra.deflation import Dense
from mbstab.analysis.algebra.tolerances import TOLERANCES
from mbstab.model.balls import Ball, ball, real, zero_inside


def matrix(x: Any) -> Matrix:
    """Return a vector or a matrix as an array of balls.

    Raises
    ------
    NotProvable
        If an entry has no finite enclosure.
    """
    found = np.asarray(np.frompyfunc(ball, 1, 1)(np.asarray(x, dtype=object)), dtype=object)
    if not all(y.is_finite() for y in found.flat):
        raise NotProvable("the equations of motion have no finite enclosure")
    return found


def zeros(*shape: int) -> Matrix:
    """Return an array of exact zeros."""
    return np.full(shape, ball(0), dtype=object)


def times(*factors: Matrix) -> Any:
    """Return a product of matrices and vectors; exact zeros are skipped."""
    return reduce(_product, factors)


def _product(A: Matrix, B: Matrix) -> Any:
    rows = B if B.ndim > 1 else B[:, None]
    filled = [[(j, x) for j, x in enumerate(row) if not x.is_zero()] for row in rows.tolist()]
    result = [[ball(0)] * rows.shape[1] for _ in range(len(A) if A.ndim > 1 else 1)]
    for own, row in zip(result, A.tolist() if A.ndim > 1 else [A.tolist()], strict=True):
        for k, x in enumerate(row):
            if not x.is_zero():
                for j, y in filled[k]:
                    own[j] = own[j] + x * y
    return np.array(result, dtype=object).reshape(A.shape[:-1] + B.shape[1:])[()]


class _Balls(Dense):
    """Arrays of balls."""

    def times(self, *factors: Matrix) -> Matrix:
        return times(*factors)  # type: ignore[no-any-return]


BALLS = _Balls()


def eliminate(
    A: Matrix, rank: int, columns: int, row_scale: Sequence[float] | None = None, scale: Sequence[float] | None = None
) -> tuple[list[tuple[int, int]], Matrix]:
    """Return the pivots (row, column) and the matrix whose pivot columns are unit vectors (Gauss-Jordan).

    Parameters
    ----------
    A : Matrix
    rank : int
        Number of pivots.
    columns : int
        Number of leading columns in which pivots are chosen; the others are only transformed.
    row_scale, scale : sequence of float
        Scales by which entries are compared.

    Raises
    ------
    NotProvable
        If there are fewer pivots that are proven to be nonzero.
    """
    T, m = A.tolist(), len(A)
    r, c = row_scale or [1.0] * m, scale or [1.0] * columns
    rows, free = set(range(m)), set(range(columns))
    pivots: list[tuple[int, int]] = []
    for _ in range(rank):
        entries = [
            (abs(float(T[i][j].mid())) * r[i] * c[j], i, j) for i in rows for j in free if not zero_inside(T[i][j])
        ]
        if not entries:
            raise NotProvable(f"a rank of {rank} is not proven: no further pivot is enclosed away from zero")
        largest = max(entries)[0]
        in_row = {i: sum(not T[i][j].is_zero() for j in free) for i in rows}
        in_column = {j: sum(not T[i][j].is_zero() for i in rows) for j in free}
        _, _, i, j = min(
            ((in_row[i] - 1) * (in_column[j] - 1), -size, i, j)
            for size, i, j in entries
            if size >= TOLERANCES.sparse_pivot * largest
        )
        rows.remove(i)
        free.remove(j)
        pivots.append((i, j))
        pivot = T[i][j]
        T[i] = [x if x.is_zero() else x / pivot for x in T[i]]
        T[i][j] = ball(1)
        filled = [(k, x) for k, x in enumerate(T[i]) if not x.is_zero()]
        for other in range(m):
            factor = T[other][j]
            if other != i and not factor.is_zero():
                row = T[other]
                for k, x in filled:
                    row[k] = row[k] - factor * x
                row[j] = ball(0)
    return pivots, np.array(T, dtype=object).reshape(A.shape)


def null_space(pivots: Sequence[tuple[int, int]], T: Matrix, columns: int) -> tuple[list[int], Matrix]:
    """Return the free columns of an eliminated matrix, and the basis of its null space that is the identity there."""
    bound = {j for _, j in pivots}
    free = [j for j in range(columns) if j not in bound]
    N = zeros(columns, len(free))
    for k, j in enumerate(free):
        N[j, k] = ball(1)
        for i, column in pivots:
            N[column, k] = -T[i, j]
    return free, N


def solve(A: Matrix, B: Matrix) -> Matrix:
    """Return A⁻¹ B; proves that A is regular or raises `NotProvable`."""
    n = len(A)
    pivots, T = eliminate(np.hstack([A, B]), n, n)
    result = zeros(*B.shape)
    for i, j in pivots:
        result[j] = T[i, n:]
    return result


def determinant(A: Matrix) -> Ball:
    """Return the determinant."""
    from flint import arb_mat

    return arb_mat([list(map(real, row)) for row in A]).det()


def positive(A: Matrix, semi: bool = False) -> bool:
    """Return whether a symmetric matrix is proven positive definite; `semi`: semidefinite, with exact zero pivots."""
    T = A.copy()
    for k, row in enumerate(T):
        if semi and row[k].is_zero():
            if not all(x.is_zero() for x in row[k:]):
                return False
            continue
        if not row[k] > 0:
            return False
        for other in T[k + 1 :]:
            if not other[k].is_zero():
                other[:] = other - other[k] / row[k] * row
    return True
