"""A few eigenvalues of large equations, each with an error bound.

Approximate vectors x and y of shift-invert iterations give, with the whole problem Q(s) and not a reduced one,

    s₁ = s + d,   yᴴQ(s)x + d yᴴQ'(s)x + d² yᴴMx = 0

whose error is the product of those of x and y (Lancaster 1961, Numer. Math. 3; Schwetlick, Schreiber 2012, Linear
Algebra Appl. 436). The remaining error is bounded by the errors of the entries, and by the residuals of both vectors:

    first  = 4ε |y|ᵀ δQ(|s|) |x| / |yᴴQ'x|,     second = 2 |Q(s)ᴴy|ᵀ |z| / |yᴴQ'x|,

the first with the curvature yᴴMx / |yᴴQ'x| where errors of the entries may carry s onto its mirror image. In the
second, z is the part of x that belongs to all other eigenvalues, whether they were found or not: the solution of

    [Q(s)  Q'x; yᴴQ'  0] [z; w] = [Q(s)x; 0].

Values whose vectors cannot be separated are treated together, with bases of their subspaces in place of x and y.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from mbstab.analysis.algebra.arrays import Complex, Flags, Index
from mbstab.analysis.algebra.matching import together
from mbstab.analysis.algebra.shift_invert import SingularShift
from mbstab.analysis.algebra.tolerances import EPS
from mbstab.analysis.algebra.tolerances import TOLERANCES as ALGEBRA
from mbstab.analysis.linear.sparse_equations import SparseEquations
from mbstab.analysis.linear.tolerances import TOLERANCES as LINEAR
from mbstab.analysis.spectrum.tolerances import TOLERANCES
from mbstab.compiler.system import Array
from mbstab.records import dataclass

COLUMNS = ("values", "bounds", "condition", "backward_error", "vectors")
"""What `Few` has for each eigenvalue."""


@dataclass(frozen=True)
class Few:
    """Eigenvalues with bounds.

    Attributes
    ----------
    values : ndarray of complex, shape (k,)
        With Im ≥ 0; those with Im > 0 stand for a pair (1/s).
    bounds : ndarray, shape (k,)
        Radius of a disc about each (1/s); inf: nothing is known.
    condition, backward_error : ndarray, shape (k,)
        The bound relative to the eigenvalue in roundings, and the residual relative to the sizes of terms.
    vectors : ndarray of complex, shape (n_q, k)
        Δq in scaled coordinates.
    reach : float (1/s)
        Radius about the shift within which two searches found no others.
    """

    values: Complex
    bounds: Array
    condition: Array
    backward_error: Array
    vectors: Complex
    reach: float

    def joined(self, other: Few) -> Few:
        """Return these and others."""
        pairs = {name: (getattr(self, name), getattr(other, name)) for name in COLUMNS}
        both: dict[str, Any] = {name: np.concatenate(pair, axis=-1) for name, pair in pairs.items()}
        return replace(self, **both)

    def only(self, chosen: Index | Flags) -> Few:
        """Return some of them."""
        return replace(self, **{name: getattr(self, name)[..., chosen] for name in COLUMNS})


def few(equations: SparseEquations, shift: complex, count: int, symmetric: bool) -> Few:
    """Return the eigenvalues nearest to a number; a pair counts as one.

    Parameters
    ----------
    shift : complex
        With Im ≥ 0 (1/s).
    count : int
    symmetric : bool
        Whether M, R and K are symmetric by structure and there are no rows on speeds alone.

    Raises
    ------
    NumericalError
        If the iteration does not converge.
    """
    return _bounded(equations, *_found(equations, shift, count), shift, symmetric)


def far_right(equations: SparseEquations, count: int, symmetric: bool, known: float) -> list[Few] | None:
    """Return those with the largest real parts of all eigenvalues beyond a radius; None if all of them take long.

    All are computed from shifts of several sizes, and from each those of about its size are taken: of others a dense
    matrix knows too few digits.
    """
    shift, upper, found = TOLERANCES.beyond_all * equations.fastest, np.inf, list[Few]()
    while upper > known:
        every = equations.problem.complete(shift, equations.n_left)
        if every is None:
            return None
        values, vectors = _upper(*every, 0j)
        band = np.flatnonzero((np.abs(values) <= 2.0 * upper) & (np.abs(values) >= 0.5 * TOLERANCES.scale_step * shift))
        chosen = band[np.argsort(-values[band].real, kind="stable")][: count + TOLERANCES.eigenvalues_more]
        found.append(_closer(equations, values[chosen], vectors[:, chosen], symmetric))
        upper = shift = TOLERANCES.scale_step * shift
    return found


def _closer(equations: SparseEquations, values: Complex, vectors: Complex, symmetric: bool) -> Few:
    """Return eigenvalues of which some digits are known, with bounds."""
    for group in _groups(values):
        closer = _iterated(equations, complex(np.mean(values[group])), vectors[:, group], "N")
        if np.all(np.isfinite(closer)):
            vectors[:, group] = closer
    return _bounded(equations, values, vectors, np.inf, 0j, symmetric)


def _bounded(
    equations: SparseEquations, values: Complex, vectors: Complex, reach: float, shift: complex, symmetric: bool
) -> Few:
    """Return corrected eigenvalues with bounds, the nearest to a number first."""
    pairs: list[tuple[complex, Array, Complex]] = []
    for group in _groups(values):
        pairs += _corrected(equations, values[group], vectors[:, group], symmetric)
    # Beside very slow eigenvalues very fast ones are lost, and infinite ones appear. A defective one has no correction.
    pairs = [
        p
        for p in pairs
        if np.any(p[2])
        and np.isfinite(p[0])
        and not p[1][3]
        >= max(TOLERANCES.correction_of_eigenvalue * abs(p[0]), TOLERANCES.correction_beyond_rounding * p[1][0])
    ]
    first, second = (np.array([p[1][k] for p in pairs]) for k in (0, 1))
    s = np.array([_real_if_alone(p[0], p[1][0], p[2]) for p in pairs])
    with np.errstate(all="ignore"):
        bounds = np.where(np.isfinite(first + second), first + second, np.inf)
        condition = bounds / (EPS * np.abs(s))
    backward = np.array([p[1][2] for p in pairs])
    X = np.stack([p[2] for p in pairs], axis=1) if pairs else np.zeros((equations.n_q, 0), dtype=complex)
    order = np.argsort(np.abs(s - shift), kind="stable")
    return _once(Few(s, bounds, condition, backward, X, reach).only(order))


def _real_if_alone(s: complex, bound: float, x: Complex) -> complex:
    """Return an eigenvalue without its imaginary part if that is rounding: its conjugate has the same vector."""
    alone = abs(s.imag) <= bound and abs(np.dot(x, x)) > TOLERANCES.equal_vectors_cosine * np.linalg.norm(x) ** 2
    return complex(s.real) if alone else s


def _once(found: Few) -> Few:
    """Return values without duplicates: those in the same disc with the same vector."""
    kept: list[int] = []
    for i, (s, radius) in enumerate(zip(found.values, found.bounds, strict=True)):
        x = found.vectors[:, i] / np.linalg.norm(found.vectors[:, i])
        for k, j in enumerate(kept):
            near = abs(found.values[j] - s) <= max(min(found.bounds[j], radius), TOLERANCES.values_together * abs(s))
            if near and abs(np.vdot(x, found.vectors[:, j])) > TOLERANCES.equal_vectors_cosine * np.linalg.norm(
                found.vectors[:, j]
            ):
                kept[k] = i if radius < found.bounds[j] else j
                break
        else:
            kept.append(i)
    return found.only(np.array(kept, dtype=np.intp))


def _found(equations: SparseEquations, shift: complex, count: int) -> tuple[Complex, Complex, float]:
    """Return the values nearest to a number that two searches find, with Im ≥ 0, and their reach."""
    problem, most = equations.problem, equations.n_left
    if not most:
        return np.zeros(0, dtype=complex), np.zeros((problem.size, 0), dtype=complex), np.inf
    wanted = min(most, TOLERANCES.eigenvalues_more + (count if shift.imag else 2 * count))
    start = shift
    while True:
        start, values, vectors = _searched(equations, start, wanted)
        radius = float(np.max(np.abs(values - start)))
        if len(values) >= most:
            return *_upper(values, vectors, shift), np.inf
        # Another shift must give the same values, or something was missed.
        beside = start + TOLERANCES.second_search_start * radius
        others, their_vectors = problem.nearest(beside, wanted, most)
        missed = _unmatched(others, values)
        values = np.concatenate([values, others[missed]])
        vectors = np.hstack([vectors, their_vectors[:, missed]])
        both = min(radius, float(np.max(np.abs(others - beside))) - TOLERANCES.second_search_start * radius)
        reach = max(0.0, both * (1.0 - TOLERANCES.values_together) - abs(start - shift))
        found, columns = _upper(values, vectors, shift)
        if np.sum(np.abs(found - shift) < reach) >= count or wanted == most:
            return found, columns, reach
        wanted = min(most, wanted + wanted // 2)


def _searched(equations: SparseEquations, start: complex, wanted: int) -> tuple[complex, Complex, Complex]:
    """Return the shift of a search, moved off an eigenvalue if necessary, and its values and vectors."""
    aside = TOLERANCES.search_start_aside * equations.rate
    for _ in range(TOLERANCES.search_starts):
        try:
            values, vectors = equations.problem.nearest(start, wanted, equations.n_left)
        except SingularShift:
            start, aside = start + aside, 10.0 * aside
            continue
        distance = np.abs(values - start)
        if len(values) == 1 < min(wanted, equations.n_left):
            # The shift is an eigenvalue but for rounding, and the others are lost beside it.
            start, aside = start + aside, 10.0 * aside
            continue
        if len(values) == 1 or np.min(distance) >= TOLERANCES.search_start_nearest * np.max(distance):
            break
        aside = TOLERANCES.search_start_aside * float(np.max(distance))
        start = start + aside
    else:
        values, vectors = equations.problem.nearest(start, wanted, equations.n_left)
    return start, values, vectors


def _unmatched(others: Complex, values: Complex) -> list[int]:
    """Return which of some values have no partner of their own among others."""
    free = np.ones(len(values), dtype=bool)
    found = []
    for k, s in enumerate(others):
        distance = np.where(free, np.abs(values - s), np.inf)
        j = int(np.argmin(distance))
        if distance[j] <= TOLERANCES.values_together * abs(s):
            free[j] = False
        else:
            found.append(k)
    return found


def _upper(values: Complex, vectors: Complex, shift: complex) -> tuple[Complex, Complex]:
    """Return one of each conjugate pair, the nearest first; what has no partner, by rounding, is above the axis."""
    real = np.abs(values.imag) <= TOLERANCES.real_value * np.abs(values)
    values = np.where(real, values.real, values)
    above = real | (values.imag > 0.0)
    below = np.flatnonzero(~above & np.any(vectors, axis=0))
    lonely = below[_unmatched(values[below].conj(), values[above])]
    values[lonely], vectors[:, lonely] = values[lonely].conj(), vectors[:, lonely].conj()
    upper = np.union1d(np.flatnonzero(above), lonely)
    order = upper[np.argsort(np.abs(values[upper] - shift), kind="stable")]
    return values[order], vectors[:, order]


def _groups(values: Complex) -> list[Array]:
    """Return the numbers of values that are treated together."""
    near = np.abs(values[:, None] - values) <= TOLERANCES.values_together * np.abs(values)
    return [np.array(group) for group in together(near | near.T)]


def _corrected(
    equations: SparseEquations, values: Complex, vectors: Complex, symmetric: bool
) -> list[tuple[complex, Array, Complex]]:
    """Return for values that are treated together what `_projected` does; again where the correction is large."""
    found = _projected(equations, values, vectors, symmetric)
    there = np.array([x[0] for x in found])
    if not found[0][1][3] > TOLERANCES.correction_again * np.max(np.abs(there)) or not np.all(np.isfinite(there)):
        return found
    with np.errstate(all="ignore"):  # where the correction led nowhere, the equations may have no value
        again = _iterated(equations, complex(np.mean(there)), vectors, "N")
        closer = _projected(equations, there, again, symmetric) if np.all(np.isfinite(again)) else found
    return closer if closer[0][1][3] < found[0][1][3] else found


def _projected(
    equations: SparseEquations, values: Complex, vectors: Complex, symmetric: bool
) -> list[tuple[complex, Array, Complex]]:
    """Return for values that are treated together the corrected values, their measures, and Δq.

    The measures are the first and the second bound, the residual relative to the sizes of terms, and the correction.
    """
    problem, n, s0 = equations.problem, equations.n_q, complex(np.mean(values))
    X = _orthonormal(vectors, n)
    Y = X.conj() if symmetric else _iterated(equations, s0, _beside(X), "H")
    slope = Y.conj().T @ (problem.at(s0, slope=True) @ X)
    with np.errstate(all="ignore"):
        inverse = _inverse(slope)
        missing = problem.product(s0, Y, X, equations.remainder)
        bent = problem.part(2) @ X
        curved = Y.conj().T @ bent
        step = _solvent(inverse @ missing, inverse @ curved)
        left_step = _solvent((missing @ inverse).T, (curved @ inverse).T).T
        if len(values) == 1:
            corrected, turn = np.array([s0 + step[0, 0]]), np.eye(1, dtype=complex)
        elif np.all(np.isfinite(step)):
            steps, turn = np.linalg.eig(step)
            corrected = s0 + steps
        else:
            corrected, turn = values, np.eye(len(values), dtype=complex)
        # A large correction changes the slope.
        there = _inverse(slope + 2.0 * curved @ step)
        strength = float(np.linalg.norm(there, 2)) if np.all(np.isfinite(there)) else np.inf
        sizes = equations.known_to.at(abs(s0))
        first = ALGEBRA.entry_rounding * strength * float(np.linalg.norm(np.abs(Y).T @ (sizes @ np.abs(X))))
        moved = [Y.conj().T @ sum(s0**k * (Q.part(k) @ X) for k in range(3)) for Q in equations.moved]
        first += (
            TOLERANCES.drawn_rounding_factor * strength * max((float(np.linalg.norm(x)) for x in moved), default=0.0)
        )
        first = _farthest(first, float(np.linalg.norm(there @ curved)))
        right, left = problem.at(s0) @ X, problem.at(s0).conj().T @ Y
        # The part of the residuals that the correction removes is no error.
        right = right + (problem.at(s0, slope=True) @ X) @ step + bent @ step @ step
        back = left_step.conj().T
        left = left + (problem.at(s0, slope=True).conj().T @ Y) @ back + (problem.part(2).conj().T @ Y) @ back @ back
        off = _off(equations, complex(np.mean(corrected)), X, Y, right)
        second = 2.0 * strength * float(np.linalg.norm(np.abs(left).T @ np.abs(off)))
        backward = float(np.linalg.norm(right) / np.linalg.norm(sizes @ np.abs(X)))
        numbers = np.array([first, second, backward, np.linalg.norm(step)])
    shapes = X[:n] @ turn if np.all(np.isfinite(step)) else vectors[:n]
    corrected = np.where(np.abs(corrected.imag) <= TOLERANCES.real_value * np.abs(corrected), corrected.real, corrected)
    return [(complex(s), numbers, shapes[:, k]) for k, s in enumerate(corrected)]


def _off(equations: SparseEquations, s: complex, X: Complex, Y: Complex, right: Complex) -> Complex:
    """Return the parts of vectors that belong to other eigenvalues, from the residuals; inf if they are large."""
    from scipy.sparse import block_array
    from scipy.sparse.linalg import splu

    problem, n = equations.problem, equations.n_q
    unknown = np.full_like(X, np.inf)
    if not np.isfinite(s):
        return unknown
    slope = problem.at(s, slope=True)
    border, rows = slope @ X, Y.conj().T @ slope
    sizes = np.linalg.norm(border, axis=0), np.linalg.norm(rows, axis=1)
    if not all(np.all(np.isfinite(x) & (x > 0.0)) for x in sizes):
        return unknown
    try:
        lu = splu(block_array([[problem.at(s), border / sizes[0]], [rows / sizes[1][:, None], None]], format="csc"))
    except RuntimeError:
        return unknown
    found = lu.solve(np.vstack([right, np.zeros((len(rows), right.shape[1]))]))[: len(X)]
    small = np.linalg.norm(found[:n]) <= TOLERANCES.vector_error * np.linalg.norm(X[:n])
    return np.asarray(found, dtype=complex) if small else unknown


def _solvent(first: Complex, second: Complex) -> Complex:
    """Return the small solution D of D + first + second D² = 0, shape (k, k): a step to eigenvalues of Q(s) itself.

    Both D² second and second D² have the same eigenvalues, so the order matters for the vectors alone.
    """
    step = -first
    for _ in range(TOLERANCES.steps_of_correction):
        step = -first - second @ step @ step
    return step


def _inverse(matrix: Complex) -> Complex:
    """Return the inverse of a matrix, or nan where it is singular."""
    try:
        return np.asarray(np.linalg.inv(matrix), dtype=complex)
    except np.linalg.LinAlgError:
        return np.full_like(matrix, np.nan)


def _farthest(step: float, bend: float) -> float:
    """Return how far the root d = 0 of d + bend d² = e may move where abs(e) is at most a step to first order.

    Beyond the step at which it meets the other root, both are covered: the square of the eigenvalue is known, not
    its sign.
    """
    if not np.isfinite(bend):
        return np.inf
    if (turn := 4.0 * bend * step) <= 1.0:
        return float(2.0 * step / (1.0 + np.sqrt(1.0 - turn)))
    return float((1.0 + np.sqrt(1.0 + turn)) / (2.0 * bend))


def _iterated(equations: SparseEquations, s: complex, start: Complex, of: str) -> Complex:
    """Return a basis of the right ("N") or left ("H") vectors of an eigenvalue, by inverse iteration."""
    problem = equations.problem
    shift = s * (1.0 + LINEAR.vector_shift) + LINEAR.vector_shift**2 * equations.rate * (1.0 + 1.0j)
    lu = problem.factors(shift)
    if lu is None:
        return np.full_like(start, np.nan)
    slope, matrix = problem.at(s, slope=True), problem.at(complex(shift))
    if of == "H":
        slope, matrix = slope.conj().T, matrix.conj().T
    found: Complex = start
    for _ in range(TOLERANCES.vector_steps):
        right = np.ascontiguousarray(slope @ found)
        found = np.asarray(lu.solve(right, of), dtype=complex)
        found = _orthonormal(found + lu.solve(np.ascontiguousarray(right - matrix @ found), of), equations.n_q)
    return found


def _beside(X: Complex) -> Complex:
    """Return vectors near given ones that are orthogonal to none."""
    result: Complex = (X.conj() + np.random.default_rng(13).normal(size=X.shape) / X.shape[0] ** 0.5).astype(complex)
    return result


def _orthonormal(vectors: Complex, n: int) -> Complex:
    """Return combinations of vectors whose first n entries are orthonormal: multipliers may be much larger."""
    R = np.linalg.qr(vectors[:n], mode="r")
    with np.errstate(all="ignore"):
        try:
            result: Complex = vectors @ np.linalg.inv(R)
        except np.linalg.LinAlgError:
            return np.full_like(vectors, np.nan)
    return result
