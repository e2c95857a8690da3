"""Linear algebra with any number of digits, starting from double precision.

Numbers are the midpoints of balls (`mbstab.model.balls.digit_arithmetic`), matrices NumPy arrays of them. Solutions in
double precision are refined: the residual is evaluated with all digits and its correction in double precision, so that
each step gains about twelve digits and needs no elimination. Null spaces of square matrices come from
elimination with complete pivoting, eigenvalues from Arb, which encloses them unless they belong to a chain; then they
are the roots of the characteristic polynomial.

The digits are those of `mbstab.model.balls.digits`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from mbstab.analysis.algebra.ball_polynomials import root_discs
from mbstab.analysis.algebra.refining import Matrix, Refining, Stalled
from mbstab.analysis.algebra.tolerances import TOLERANCES
from mbstab.model.balls import real, small
from mbstab.records import dataclass


def _middle(x: Any) -> Any:
    return real(x).mid()


def exact(x: Any) -> Matrix:
    """Return an array of numbers with many digits; floats keep their value."""
    return np.asarray(np.frompyfunc(_middle, 1, 1)(np.asarray(x, dtype=object)), dtype=object)


def zeros(*shape: int) -> Matrix:
    """Return an array of zeros."""
    return np.full(shape, real(0), dtype=object)


def largest(x: Any) -> Any:
    """Return the largest absolute value of the entries, 0 if there are none."""
    return max((abs(value) for value in np.asarray(x, dtype=object).flat), default=real(0))


def product(*factors: Any) -> Matrix:
    """Return a matrix product, with zeros where an inner dimension is 0."""
    result = factors[0]
    for factor in factors[1:]:
        shape = (*result.shape[:-1], *factor.shape[1:])
        result = result @ factor if result.shape[-1] and all(shape) else zeros(*shape)
    return exact(result)


def applied(operator: Matrix, x: Matrix) -> Matrix:
    """Return operator @ x to double precision, whatever the size of x."""
    size = largest(x)
    if size == 0 or not operator.size:
        return zeros(*operator.shape[:1], *x.shape[1:])
    return exact((operator @ (x / size).astype(float)).astype(object) * size)


def polished(start: Matrix, correction: Callable[[Matrix], Matrix], floor: float = 0.0) -> Matrix:
    """Return start plus corrections until they are rounding; see `mbstab.analysis.algebra.refining.Refining`."""
    from flint import ctx

    x, before, slow, rounding = start, math.inf, 0, 100 * small(1.0)
    for _ in range(30 + ctx.prec // 3):
        step = exact(correction(x))
        x = exact(x + step)
        moved, size = largest(step), max(real(floor), largest(x))
        if moved <= rounding * size:
            return x
        if not moved <= before / 3:
            if moved <= small(TOLERANCES.polished_digits) * size:
                return x
            slow += 1
            if slow > 2 or not moved.is_finite():
                raise Stalled(float(moved / size))
        before = min(moved, before)
    raise Stalled(float(before / size))


class _ManyDigits(Refining):
    """Arrays of numbers with many digits."""

    exact = staticmethod(exact)
    zeros = staticmethod(zeros)
    largest = staticmethod(largest)
    times = staticmethod(product)
    applied = staticmethod(applied)
    polished = staticmethod(polished)

    @property
    def zero(self) -> Any:
        """Return 0."""
        return real(0)

    def sqrt(self, x: Any) -> Any:
        """Return a square root."""
        return _middle(real(x).sqrt())


MANY_DIGITS = _ManyDigits()


def _eliminated(A: Matrix, rank: int, least: Any) -> tuple[Matrix, list[int], list[Any], Any]:
    """Return A after elimination with complete pivoting, the order of its columns, the pivots and the next one.

    It ends after `rank` steps, and where the next pivot is not larger than `least`.
    """
    T, order, pivots = A.copy(), list(range(A.shape[1])), list[Any]()
    while True:
        k, left = len(pivots), real(0)
        rest = np.abs(T[k:, k:])
        if rest.size:
            i, j = (k + int(x) for x in np.unravel_index(np.argmax(rest), rest.shape))
            left = rest[i - k, j - k]
        if k == rank or not left > least:
            return T, order, pivots, left
        pivots.append(left)
        T[[k, i]] = T[[i, k]]
        T[:, [k, j]] = T[:, [j, k]]
        order[k], order[j] = order[j], order[k]
        T[k + 1 :, k:] = exact(T[k + 1 :, k:] - np.outer(T[k + 1 :, k] / T[k, k], T[k, k:]))


def misfits(A: Matrix, rank: int) -> Any:
    """Return the largest remaining entry after `rank` steps of elimination with complete pivoting."""
    return _eliminated(A, rank, 0)[3]


# --- zero eigenvalues -----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Kernel:
    """The null space of a square matrix: basis V with V[free] = 1, and the pivots on both sides of the decision.

    `kept` and `dropped` are relative to the largest entry; inf and 0 where there is none.
    """

    basis: Matrix
    free: list[int]
    pivots: list[int]
    kept: Any
    dropped: Any


def kernel(A: Matrix, size: Any) -> Kernel:
    """Return the null space by elimination with complete pivoting; pivots far below `size` are zero."""
    T, order, pivots, left = _eliminated(A, len(A), size * small(TOLERANCES.pivot_digits_lost))
    rank = len(pivots)
    x, basis = zeros(rank, len(A) - rank), zeros(len(A), len(A) - rank)
    for i in reversed(range(rank)):
        x[i] = exact(-(T[i, rank:] + product(T[i : i + 1, i + 1 : rank], x[i + 1 :])[0]) / T[i, i])
    basis[order] = np.vstack([x, exact(np.eye(len(A) - rank))])
    kept = pivots[-1] / size if pivots else math.inf
    return Kernel(basis, order[rank:], order[:rank], kept, left / size if left > 0 else left)


@dataclass(frozen=True)
class Deflation:
    """A matrix without its neutral eigenvalues.

    Attributes
    ----------
    S : ndarray of objects
        The matrix that is left.
    steps : tuple of int
        Number of zeros with a vector, with a second one in their chain, …
    pairs : tuple of int
        Number of pairs ±iω for each of the frequencies.
    kept, dropped : number
        Smallest pivot kept and largest dropped in all decisions, relative to the matrix.
    """

    S: Matrix
    steps: tuple[int, ...]
    pairs: tuple[int, ...]
    kept: Any
    dropped: Any

    @property
    def sizes(self) -> tuple[int, tuple[int, ...], tuple[int, ...]]:
        """Number of eigenvalues left, and numbers of those removed."""
        return len(self.S), self.steps, self.pairs

    @property
    def decided(self) -> bool:
        """Whether there is a gap between zero and nonzero pivots."""
        return bool(self.dropped == 0 or self.kept > self.dropped / small(TOLERANCES.pivot_gap))


def deflated(S: Matrix, frequencies: Sequence[Any] = ()) -> Deflation:
    """Return a matrix without its zero eigenvalues and without the pairs ±iω at given nonzero frequencies."""
    size, steps, pairs = largest(S), [], []
    kept, dropped = math.inf, real(0)
    while len(S):
        null = kernel(S, size)
        kept, dropped = min(kept, null.kept), max(dropped, null.dropped)
        if not null.free:
            break
        steps.append(len(null.free))
        S = _rest(S, null)
    for frequency in frequencies:
        pairs.append(0)
        while len(S):
            null = kernel(product(S, S) + frequency**2 * exact(np.eye(len(S))), size**2 + frequency**2)
            if not null.free or len(null.free) % 2:
                break
            kept, dropped = min(kept, null.kept), max(dropped, null.dropped)
            pairs[-1] += len(null.free) // 2
            S = _rest(S, null)
    return Deflation(S, tuple(steps), tuple(pairs), kept, dropped)


def _rest(S: Matrix, null: Kernel) -> Matrix:
    """Return S on the quotient by an invariant subspace."""
    p, f = null.pivots, null.free
    return exact(S[np.ix_(p, p)] - product(null.basis[p], S[np.ix_(f, p)]))


# --- other eigenvalues ----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Value:
    """An eigenvalue of a matrix, or the mean of several that cannot be told from each other.

    Attributes
    ----------
    value : ``flint.acb``
    radius : number
        Radius of a disc about it in which it lies.
    chained : bool
        Whether it may be multiple with fewer vectors than its multiplicity.
    """

    value: Any
    radius: Any
    chained: bool


def eigenvalues(S: Matrix) -> list[Value]:
    """Return the eigenvalues of a real matrix."""
    from flint import acb, acb_mat, arb_mat

    if not len(S):
        return []
    A = arb_mat(S.tolist())
    try:
        found = acb_mat(A).eig(multiple=True)
    except ValueError:
        discs = root_discs(A.charpoly().coeffs())
        return [Value(z, r, count > 1) for z, r, count in discs for _ in range(count)]
    parts = [(x.real, x.imag) for x in found]
    return [Value(acb(x.mid(), y.mid()), max(x.rad(), y.rad()), False) for x, y in parts]
