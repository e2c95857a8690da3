"""Linear algebra with any number of digits, starting from double precision.

Matrices are NumPy arrays of mpmath numbers. Solutions in double precision are refined: the
residual is evaluated with all digits and its correction in double precision, so that each step
gains about twelve digits and needs no elimination. Null spaces of square matrices come from
elimination with complete pivoting, eigenvalues from invariant subspaces of clusters (Newton's
method on S X = X B, Xᴴ₀ X = I; Demmel 1987, Computing 38), which need not be simple.

The digits are those of ``mpmath.mp``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from mpmath import mp

from mbstab.analysis.algebra.arrays import Complex
from mbstab.analysis.algebra.refining import Matrix, Refining, Stalled
from mbstab.analysis.algebra.tolerances import TOLERANCES
from mbstab.compiler.system import Array
from mbstab.errors import NumericalError
from mbstab.records import dataclass

if TYPE_CHECKING:
    import numpy.typing as npt


def exact(x: Any) -> Matrix:
    """Return an array of mpmath numbers; floats keep their value."""
    result: Matrix = np.asarray(x, dtype=object) + mp.zero
    return result


def zeros(*shape: int) -> Matrix:
    """Return an array of mpmath zeros."""
    return np.full(shape, mp.zero, dtype=object)


def largest(x: Any) -> Any:
    """Return the largest absolute value of the entries, 0 if there are none."""
    return max((abs(value) for value in np.asarray(x, dtype=object).flat), default=mp.zero)


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
    if not size or not operator.size:
        return zeros(*operator.shape[:1], *x.shape[1:])
    plain = (x / size).astype(complex if operator.dtype.kind == "c" else float)
    result: Matrix = (operator @ plain).astype(object) * size
    return result


def polished(start: Matrix, correction: Callable[[Matrix], Matrix], floor: float = 0.0) -> Matrix:
    """Return start plus corrections until they are rounding; see `mbstab.analysis.algebra.refining.Refining`."""
    x, before, slow = start, mp.inf, 0
    for _ in range(30 + mp.dps):
        step = correction(x)
        x = x + step
        moved, size = largest(step), max(mp.mpf(floor), largest(x))
        if moved <= mp.mpf(10) ** (2 - mp.dps) * size:
            return x
        if moved > before / 3:
            if moved <= mp.mpf(10) ** (-TOLERANCES.polished_digits * mp.dps) * size:
                return x
            slow += 1
            if slow > 2 or not mp.isfinite(moved):
                raise Stalled(float(moved / size))
        before = min(moved, before)
    raise Stalled(float(before / size))


class _ManyDigits(Refining):
    """Arrays of mpmath numbers."""

    zero = mp.zero
    exact = staticmethod(exact)
    zeros = staticmethod(zeros)
    largest = staticmethod(largest)
    times = staticmethod(product)
    applied = staticmethod(applied)
    polished = staticmethod(polished)
    sqrt = staticmethod(mp.sqrt)


MANY_DIGITS = _ManyDigits()


def misfits(A: Matrix, rank: int) -> Any:
    """Return the largest remaining entry after `rank` steps of elimination with complete pivoting."""
    rows, (m, n) = [list(row) for row in A], A.shape
    for k in range(min(rank, m, n)):
        pivot, i, j = max((abs(rows[i][j]), i, j) for i in range(k, m) for j in range(k, n))
        if not pivot:
            return mp.zero
        rows[k], rows[i] = rows[i], rows[k]
        for row in rows:
            row[k], row[j] = row[j], row[k]
        for row in rows[k + 1 :]:
            factor = row[k] / rows[k][k]
            row[k:] = [x - factor * y for x, y in zip(row[k:], rows[k][k:], strict=True)]
    return max((abs(x) for row in rows[rank:] for x in row[rank:]), default=mp.zero)


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
    n = len(A)
    rows, order = [list(row) for row in A], list(range(n))
    kept, dropped, rank = mp.inf, mp.zero, n
    least = size * mp.mpf(10) ** (-TOLERANCES.pivot_digits_lost * mp.dps)
    for k in range(n):
        pivot, i, j = max((abs(rows[i][j]), i, j) for i in range(k, n) for j in range(k, n))
        if pivot <= least:
            dropped, rank = pivot / size if size else mp.zero, k
            break
        kept = pivot / size
        rows[k], rows[i] = rows[i], rows[k]
        if j != k:
            order[k], order[j] = order[j], order[k]
            for row in rows:
                row[k], row[j] = row[j], row[k]
        top = rows[k]
        for row in rows[k + 1 :]:
            if row[k]:
                factor = row[k] / top[k]
                row[k + 1 :] = [x - factor * y for x, y in zip(row[k + 1 :], top[k + 1 :], strict=True)]
                row[k] = mp.zero
    basis = zeros(n, n - rank)
    for column in range(n - rank):
        x = [mp.zero] * rank
        for i in reversed(range(rank)):
            known = rows[i][rank + column] + mp.fsum(rows[i][j] * x[j] for j in range(i + 1, rank))
            x[i] = -known / rows[i][i]
        basis[order[:rank], column] = x
        basis[order[rank + column], column] = mp.one
    return Kernel(basis, order[rank:], order[:rank], kept, dropped)


@dataclass(frozen=True)
class Deflation:
    """A matrix without its neutral eigenvalues.

    Attributes
    ----------
    S : ndarray of mpf
        The matrix that is left.
    steps : tuple of int
        Number of zeros with a vector, with a second one in their chain, …
    pairs : tuple of int
        Number of pairs ±iω for each of the frequencies.
    kept, dropped : mpf
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
        return bool(self.dropped == 0 or self.kept > self.dropped * mp.mpf(10) ** (TOLERANCES.pivot_gap * mp.dps))


def deflated(S: Matrix, frequencies: Sequence[Any] = ()) -> Deflation:
    """Return a matrix without its zero eigenvalues and without the pairs ±iω at given nonzero frequencies."""
    size, steps, pairs = largest(S), [], []
    kept, dropped = mp.inf, mp.zero
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
    """An eigenvalue; `chained` if it may be multiple with fewer vectors than its multiplicity."""

    value: Any
    chained: bool


def eigenvalues(S: Matrix) -> list[Value]:
    """Return the eigenvalues of a real matrix.

    Raises
    ------
    NumericalError
        If no method converges.
    """
    if not len(S):
        return []
    for distance in TOLERANCES.cluster_widths:
        try:
            found = _polished_eigenvalues(S, distance)
        except (Stalled, np.linalg.LinAlgError):
            continue
        if _complete(S, found):
            return found
    return _by_iteration(S)


def _complete(S: Matrix, found: list[Value]) -> bool:
    """Return whether the sums of eigenvalues and of their squares fit the matrix: none is missing or duplicated."""
    size = largest(S) * len(S)
    sums = [mp.fsum(S[i, i] for i in range(len(S))), mp.fsum((S * S.T).flat)]
    sums = [total - mp.fsum(e.value**k for e in found) for k, total in enumerate(sums, 1)]
    allowed = mp.mpf(10) ** (-0.5 * mp.dps)
    return len(found) == len(S) and bool(abs(sums[0]) <= allowed * size and abs(sums[1]) <= allowed * size**2)


def _polished_eigenvalues(S: Matrix, distance: float) -> list[Value]:
    size = largest(S)
    plain = (S / size).astype(float) if size else S.astype(float)
    values, vectors = np.linalg.eig(plain)
    near = np.abs(values[:, None] - values[None, :]) <= distance * max(1.0, float(np.linalg.norm(plain, 2)))
    found: list[Value] = []
    for members in _components(near):
        mean = complex(np.mean(values[members]))
        closed = any(np.any(values[members] == values[i].conjugate()) for i in members)
        if not closed and mean.imag < 0.0:
            continue  # its complex conjugate is computed
        if len(members) == 1:
            start = vectors[:, members] / np.linalg.norm(vectors[:, members])
        else:
            start = _invariant(plain, values[members], distance)
        block = _block(S / size if size else S, plain, start)
        part = [Value(e.value * size, e.chained) for e in _of_block(block)]
        found += part
        if not closed:
            found += [Value(mp.conj(e.value), e.chained) for e in part]
    return found


def _components(near: npt.NDArray[np.bool_]) -> list[list[int]]:
    """Return the connected components of a graph."""
    left, found = set(range(len(near))), []
    while left:
        stack, members = [left.pop()], []
        while stack:
            i = stack.pop()
            members.append(i)
            joined = {j for j in left if near[i, j]}
            left -= joined
            stack.extend(joined)
        found.append(sorted(members))
    return found


def _invariant(plain: Array, values: Complex, distance: float) -> Complex:
    """Return an orthonormal basis of the invariant subspace of a cluster of eigenvalues."""
    from scipy.linalg import schur

    def inside(x: complex) -> bool:
        return bool(np.min(np.abs(values - x)) <= 0.5 * distance)

    _, vectors, count = schur(plain.astype(complex), output="complex", sort=inside)
    if count != len(values):
        raise Stalled(float("inf"))
    result: Complex = vectors[:, :count]
    return result


def _block(S: Matrix, plain: Array, start: Complex) -> Matrix:
    """Return B with S X = X B for the invariant subspace near `start`; complex numbers where it is not real."""
    n, k = start.shape
    real = k == 1 and not np.any(start.imag)
    B_0 = start.conj().T @ plain @ start
    one = np.eye(k)
    matrix = np.zeros((n * k + k * k, n * k + k * k), dtype=complex)
    matrix[: n * k, : n * k] = np.kron(one, plain) - np.kron(B_0.T, np.eye(n))
    matrix[: n * k, n * k :] = -np.kron(one, start)
    matrix[n * k :, : n * k] = np.kron(one, start.conj().T)
    inverse = np.linalg.inv(matrix)
    if real:
        inverse = inverse.real

    def correction(unknown: Matrix) -> Matrix:
        X, B = (x.reshape(k, -1).T for x in (unknown[: n * k], unknown[n * k :]))
        residual = X @ B - S @ X
        # The normalization holds at the start, and every step keeps it to double precision.
        return applied(inverse, np.concatenate([residual.T.ravel(), zeros(k * k)]))

    unknown = np.concatenate([start.T.ravel(), B_0.T.ravel()])
    unknown = polished(exact(unknown.real if real else unknown), correction, 1.0)
    return unknown[n * k :].reshape(k, k).T


def _of_block(B: Matrix) -> list[Value]:
    """Return the eigenvalues of a block, marked where vectors are missing."""
    k = len(B)
    if k == 1:
        return [Value(mp.mpc(B[0, 0]), False)]
    return _with_chains(B, _iterated(B))


def _iterated(B: Matrix) -> list[Any]:
    try:
        return [mp.mpc(x) for x in mp.eig(mp.matrix(B.tolist()), left=False, right=False)]
    except (RuntimeError, ZeroDivisionError) as error:
        raise NumericalError(f"the eigenvalues do not converge with {mp.dps} digits ({error})") from None


def _by_iteration(S: Matrix) -> list[Value]:
    """Return all eigenvalues by the QR iteration in multiprecision: slow, but without a start."""
    if len(S) == 1:
        return [Value(mp.mpc(S[0, 0]), False)]
    return _with_chains(S, _iterated(S))


def _with_chains(B: Matrix, values: list[Any]) -> list[Value]:
    """Mark eigenvalues that are equal to the digits in use and have fewer vectors than their number."""
    n, size = len(B), largest(B)
    # A chain of length m leaves only one digit in m.
    equal = size * mp.mpf(10) ** (-0.8 * mp.dps / max(n if n < 6 else 6, 1))
    near = np.array([[abs(x - y) <= equal for y in values] for x in values], dtype=bool).reshape(n, n)
    found: list[Value] = []
    for members in _components(near):
        chained = False
        if len(members) > 1:
            mean = mp.fsum(values[i] for i in members) / len(members)
            chained = len(kernel(B - mean * exact(np.eye(n)), size).free) < len(members)
        found += [Value(values[i], chained) for i in members]
    return found
