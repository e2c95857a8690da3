"""Matrices of balls: lists of rows, elimination with pivots that are proven to be nonzero."""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from typing import Any

from mbstab.analysis.algebra.balls import Matrix, NotProvable
from mbstab.analysis.algebra.tolerances import TOLERANCES
from mbstab.model.balls import Ball, ball, real, zero_inside


def matrix(rows: Any) -> Matrix:
    """Return an array as rows of balls.

    Raises
    ------
    NotProvable
        If an entry has no finite enclosure.
    """
    found = [[ball(x) for x in row] for row in rows]
    if not all(x.is_finite() for row in found for x in row):
        raise NotProvable("the equations of motion have no finite enclosure")
    return found


def vector(entries: Any) -> list[Ball]:
    """Return an array as balls; raises as `matrix`."""
    return matrix([entries])[0]


def zeros(rows: int, columns: int) -> Matrix:
    """Return a matrix of exact zeros."""
    return [[ball(0)] * columns for _ in range(rows)]


def transposed(A: Matrix, columns: int | None = None) -> Matrix:
    """Return Aᵀ; `columns` is the number of columns of A where it has no rows."""
    return [list(column) for column in zip(*A, strict=True)] if A else [[] for _ in range(columns or 0)]


def times(A: Matrix, B: Matrix) -> Matrix:
    """Return A B."""
    width = len(B[0]) if B else 0
    sparse = [[(j, x) for j, x in enumerate(row) if not x.is_zero()] for row in B]
    result = zeros(len(A), width)
    for i, row in enumerate(A):
        for k, x in enumerate(row):
            if not x.is_zero():
                for j, y in sparse[k]:
                    result[i][j] = result[i][j] + x * y
    return result


def apply(A: Matrix, x: Sequence[Ball]) -> list[Ball]:
    """Return A x."""
    return [row[0] for row in times(A, [[value] for value in x])] if x else [ball(0)] * len(A)


def plus(*matrices: Matrix) -> Matrix:
    """Return the sum of matrices."""
    return [
        [sum(entries[1:], entries[0]) for entries in zip(*rows, strict=True)] for rows in zip(*matrices, strict=True)
    ]


class _Balls:
    """Matrices of balls as `mbstab.analysis.algebra.deflation.Algebra`."""

    def times(self, *factors: Matrix) -> Matrix:
        return reduce(times, factors)

    def plus(self, *terms: Matrix) -> Matrix:
        return plus(*terms)

    def transposed(self, A: Matrix) -> Matrix:
        return transposed(A)


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
    T = [row[:] for row in A]
    m = len(T)
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
    return pivots, T


def null_space(pivots: Sequence[tuple[int, int]], T: Matrix, columns: int) -> tuple[list[int], Matrix]:
    """Return the free columns of an eliminated matrix, and the basis of its null space that is the identity there."""
    bound = {j for _, j in pivots}
    free = [j for j in range(columns) if j not in bound]
    N = zeros(columns, len(free))
    for k, j in enumerate(free):
        N[j][k] = ball(1)
        for i, column in pivots:
            N[column][k] = -T[i][j]
    return free, N


def solve(A: Matrix, B: Matrix) -> Matrix:
    """Return A⁻¹ B; proves that A is regular or raises `NotProvable`."""
    n = len(A)
    pivots, T = eliminate([a + b for a, b in zip(A, B, strict=True)], n, n)
    result: Matrix = [[] for _ in range(n)]
    for i, j in pivots:
        result[j] = T[i][n:]
    return result


def determinant(A: Matrix) -> Ball:
    """Return the determinant."""
    from flint import arb_mat

    return arb_mat([[real(x) for x in row] for row in A]).det()


def positive(A: Matrix) -> bool:
    """Return whether a symmetric matrix is proven positive definite: all pivots of its elimination are positive."""
    T = [row[:] for row in A]
    for k, row in enumerate(T):
        if not row[k] > 0:
            return False
        for i in range(k + 1, len(T)):
            if not T[i][k].is_zero():
                factor = T[i][k] / row[k]
                T[i] = [x - factor * y for x, y in zip(T[i], row, strict=True)]
    return True
