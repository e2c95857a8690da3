"""Arrays of balls beside arrays of doubles, with one set of operations: products with the sizes of their terms.

A size is a power of two, the exponent of the largest term, so that no small term is lost below the range of doubles.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from fractions import Fraction
from functools import cache, cached_property
from typing import Any

import numpy as np

from mbstab.analysis.algebra.arrays import Flags
from mbstab.analysis.algebra.tolerances import TOLERANCES
from mbstab.compiler.system import Array
from mbstab.model.arithmetic import FLOAT, Arithmetic

NONE = -np.inf
"""The power of zero."""


class Doubles:
    """Arrays of doubles, many states along the first axes."""

    exact = False

    @property
    def f(self) -> Arithmetic:
        """The arithmetic of kernels."""
        return FLOAT

    def zeros(self, shape: tuple[int, ...]) -> Array:
        """Return an array of zeros."""
        return np.zeros(shape)

    def of(self, x: Array) -> Array:
        """Return an array of doubles in these numbers."""
        return x

    def settled(self, x: Array) -> Array:
        """Return numbers near x from which to go on."""
        return x

    def powers(self, x: Array) -> Array:
        """Return the exponents of the sizes of the entries."""
        size = np.abs(x)
        return np.asarray(np.log2(size, out=np.full(size.shape, NONE), where=size != 0.0))

    def sized(self, x: Array) -> tuple[Array, Array]:
        """Return numbers with the exponents of their sizes; of balls these are not needed, and -inf."""
        return x, self.powers(x)

    def multiplied(self, A: Array, B: Array) -> Array:
        """Return a product of matrices."""
        return np.asarray(A @ B)

    def solved(self, A: Array, B: Array) -> Array:
        """Return A⁻¹ B."""
        return np.asarray(np.linalg.solve(A, B))

    def prepared(self, A: Array) -> Any:
        """Return a matrix in the form in which products are computed."""
        return A


class Balls(Doubles):
    """Arrays of balls, one state at a time."""

    exact = True

    @cached_property
    def f(self) -> Arithmetic:  # noqa: D102
        from mbstab.model.balls import ball_arithmetic

        arb, _ = _types()
        known, kept = ball_arithmetic(), dict[int, tuple[Any, tuple[Any, Any]]]()
        sines = known.sin, known.cos

        def function(which: int) -> Callable[[Any], Any]:
            def one(x: Any) -> Any:
                if x.__class__ is not arb:
                    return sines[which](x)
                # All elements of a body ask for those of the same angles.
                found = kept.get(id(x))
                if found is None or found[0] is not x:
                    if len(kept) > TOLERANCES.sines_kept:
                        kept.clear()
                    found = kept[id(x)] = x, x.sin_cos()
                return found[1][which]

            return one

        functions = {name: x for name, x in vars(known).items() if callable(x) and name != "number"}
        functions |= {"sin": function(0), "cos": function(1)}
        return Arithmetic(known.name, known.number, known.constants, functions)

    def zeros(self, shape: tuple[int, ...]) -> Array:  # noqa: D102
        return np.full(shape, 0, dtype=object)

    def of(self, x: Array) -> Array:  # noqa: D102
        return np.asarray(np.frompyfunc(_types()[0], 1, 1)(np.asarray(x, dtype=float)))

    def within(self, x: Array, error: Array) -> Array:
        """Return the balls about doubles with given errors."""
        return np.asarray(np.frompyfunc(_types()[0], 2, 1)(x, error))

    def settled(self, x: Array) -> Array:  # noqa: D102
        return np.asarray(np.frompyfunc(lambda y: y if y.__class__ is int else as_ball(y).mid(), 1, 1)(x))

    def powers(self, x: Array) -> Array:  # noqa: D102
        size = middle(x)
        # What is beyond the range of doubles has no size.
        return super().powers(np.where(np.isfinite(size), size, 0.0))

    def sized(self, x: Array) -> tuple[Array, Array]:  # noqa: D102
        return x, np.full(x.shape, NONE)

    def multiplied(self, A: Array, B: Array) -> Array:  # noqa: D102
        return _array(_matrix(A) * _matrix(B))

    def solved(self, A: Array, B: Array) -> Array:  # noqa: D102
        return _array(_matrix(A).solve(_matrix(B)))

    def shortest(self, J: Array, sizes: Array, left: Array) -> Array:
        """Return the shortest x, in given sizes, with J x = left."""
        rows = _matrix(J * sizes)
        columns = rows.transpose()
        return _array(columns * (rows * columns).solve(_matrix(left))) * sizes[:, None]

    def prepared(self, A: Array) -> Any:  # noqa: D102
        return _matrix(A)


@cache
def _types() -> tuple[Any, Any]:
    """Return the types of balls and of matrices of them."""
    from flint import arb, arb_mat

    return arb, arb_mat


def _matrix(A: Any) -> Any:
    arb, arb_mat = _types()
    if A.__class__ is arb_mat:
        return A
    plain = (arb, int, float)
    return arb_mat(*A.shape, [x if x.__class__ in plain else as_ball(x) for x in A.ravel().tolist()])


def _array(A: Any) -> Array:
    found = np.empty(A.nrows() * A.ncols(), dtype=object)
    found[:] = A.entries()
    return found.reshape(A.nrows(), A.ncols())


DOUBLES, BALLS = Doubles(), Balls()


@contextlib.contextmanager
def many_bits(bits: int = TOLERANCES.bits_of_identities) -> Iterator[None]:
    """Compute with the bits of identities, or with others, inside the context."""
    from flint import ctx

    before, ctx.prec = ctx.prec, bits
    try:
        yield
    finally:
        ctx.prec = before


def as_ball(x: Any) -> Any:
    """Return a number as ``flint.arb``."""
    arb, _ = _types()
    return x if x.__class__ is arb else arb(x.v) if hasattr(x, "v") else arb(x)


def in_ball(x: Any) -> Any:
    """Return a fraction or a float as ``flint.arb``; integers stay."""
    if x.__class__ is int:
        return x
    from flint import arb, fmpq

    return arb(fmpq(x.numerator, x.denominator)) if isinstance(x, Fraction) else arb(x)


def plain_ball(x: Any) -> Any:
    """Return a number as ``flint.arb``, and as an integer where it is a small one."""
    value = as_ball(x)
    return int(value.unique_fmpz()) if value.is_exact() and value.is_integer() and abs(value) < 2 else value


def middle(x: Array) -> Array:
    """Return the midpoints as doubles."""
    return x if x.dtype == float else np.asarray(np.frompyfunc(float, 1, 1)(x), dtype=float)


def filled(x: Array) -> list[int]:
    """Return the places of a vector at which it is not exactly zero."""
    found: list[int] = np.flatnonzero(~np.asarray(x == 0, dtype=bool)).tolist()
    return found


def largest_terms(A: Array, B: Array) -> Array:
    """Return the exponents of the largest terms of the entries of a product, from those of the factors."""
    return np.asarray(np.max(A[..., :, :, None] + B[..., None, :, :], axis=-2, initial=NONE))


def excludes_zero(x: Array) -> Flags:
    """Return which entries cannot be zero, or have no value."""

    def one(y: Any) -> bool:
        if y.__class__ is int:
            return bool(y != 0)
        y = as_ball(y)
        return not (y.is_finite() and y.contains(0))

    return np.asarray(np.frompyfunc(one, 1, 1)(x), dtype=bool)


def widened(x: Array, radius: Array | float) -> Array:
    """Return balls with radii that are larger by some doubles."""
    return np.asarray(np.frompyfunc(lambda y, r: y + _types()[0](0, r) if r else y, 2, 1)(x, radius))


def kept_combinations(rows: Array) -> Array:
    """Return the combinations of columns that may vanish in all rows, shape (columns, number), in balls.

    Columns are eliminated one by one, with the entry left of which the most digits are known as pivot. Combinations of
    which too few digits are known are left out.

    Parameters
    ----------
    rows : ndarray of balls, shape (rows, columns)
    """
    d = rows.shape[1]
    found, left, rows = np.eye(d, dtype=int).astype(object), list(range(d)), rows.copy()
    known = _digits(rows)
    most = np.max(known, axis=1, initial=NONE)
    while left and len(rows):
        i = int(np.argmax(most))
        pivot = int(np.argmax(known[i]))
        if known[i, pivot] == NONE:
            break
        left.remove(pivot)
        changed = known[:, pivot] > NONE
        known[:, pivot] = NONE
        on, own = filled(rows[:, pivot]), filled(found[:, pivot])
        for k in (k for k in left if known[i, k] > NONE):
            factor = as_ball(rows[i, k]) / rows[i, pivot]
            rows[on, k] = rows[on, k] - factor * rows[on, pivot]
            found[own, k] = found[own, k] - factor * found[own, pivot]
            rows[i, k] = 0
            before, known[:, k] = known[:, k].copy(), known[:, k]
            known[on, k] = _digits(rows[on, k])
            changed |= known[:, k] != before
        most[changed] = np.max(known[changed], axis=1, initial=NONE)
    return found[:, [k for k in left if resolved(found[:, k])]]


def radii(x: Array) -> Array:
    """Return the radii of balls."""
    return np.asarray(np.frompyfunc(lambda y: 0 if y.__class__ is int else as_ball(y).rad(), 1, 1)(x))


def resolved(x: Array) -> bool:
    """Return whether the entries of a vector of balls are known, relative to the largest, as combinations must be."""
    return bool(
        np.all(BALLS.powers(radii(x)) <= np.max(BALLS.powers(x), initial=NONE) - TOLERANCES.bits_of_combinations)
    )


def _digits(x: Array) -> Array:
    """Return how many bits of entries are known, of those that may be zero none (-inf)."""

    def one(y: Any) -> float:
        most = TOLERANCES.bits_of_identities
        return float(most if y.__class__ is int else min(as_ball(y).rel_accuracy_bits(), most))

    return np.where(excludes_zero(x), np.asarray(np.frompyfunc(one, 1, 1)(x), dtype=float), NONE)


def not_negative(R: Array) -> bool:
    """Return whether Σ R_ij u_i u_j ≥ 0 for all u, shape (n, n): by elimination, each row in its own unit."""
    S, units, left = R + R.T, np.diagonal(BALLS.powers(R)), list(range(len(R)))

    def relative(i: int) -> float:
        value = float(S[i, i])
        return float(np.log2(value)) - float(units[i]) if value > 0.0 else NONE

    while left:
        k = max(left, key=relative)
        if not S[k, k] > 0:
            # All that is left must be zero, off the diagonal, too.
            return not np.any(excludes_zero(S[np.ix_(left, left)]))
        left.remove(k)
        for i in left:
            S[i, left] = S[i, left] - S[i, k] / S[k, k] * S[k, left]
    return True
