"""Eigenpairs refined to the accuracy of the entries of the matrices, whatever their sizes.

The eigenvalues of the deflated matrix contain the rounding of its largest entries. Newton's method
on the composite problem Q(s) x = (s²M̄ + sR̄ + K̄) x = 0, its linear systems equilibrated,

    [Q  Q'x; w* 0] [Δx; Δs] = −[Q x; 0],

makes each as accurate as the residual in double precision allows (iterative refinement: Skeel 1980,
Math. Comp. 35): the error no longer depends on units, on large mass ratios, or on how the
equations were reduced, but on the cancellation in the single entries,

    |Δs| ≤ |y|ᵀ (|s|² δM + |s| δR + δK) |x| / |y* Q'(s) x|.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from mbstab.analysis.algebra.arrays import Complex
from mbstab.analysis.algebra.tolerances import EPS, TOLERANCES
from mbstab.compiler.system import Array
from mbstab.records import dataclass


@dataclass(frozen=True)
class Quadratic:
    """The composite problem without redundant rows, and the sizes of the terms of its entries.

    Attributes
    ----------
    M, R, K : matrix, shape (n, n)
        Arrays, or sparse ones of SciPy where they are large.
    terms : tuple of matrix
        Sizes of the terms of M, R and K.
    """

    M: Any
    R: Any
    K: Any
    terms: tuple[Any, ...]

    @classmethod
    def of(cls, M: Array, R: Array, K: Array, terms: tuple[Array, ...]) -> Quadratic:
        """Return a problem with dense or sparse matrices, depending on its size."""
        if len(M) < TOLERANCES.sparse_from_size:
            return cls(M, R, K, terms)
        from scipy.sparse import csc_array

        return cls(csc_array(M), csc_array(R), csc_array(K), tuple(csc_array(x) for x in terms))

    def at(self, s: complex) -> Any:
        """Return s²M + sR + K."""
        return (s * s) * self.M + s * self.R + self.K

    def slope(self, s: complex) -> Any:
        """Return 2sM + R."""
        return 2.0 * s * self.M + self.R

    def spread(self, s: complex, x: Complex, y: Complex) -> float:
        """Return the bound of the error of y* Q(s) x from the rounding of the entries."""
        size, left, right = abs(s), np.abs(y), np.abs(x)
        parts = [float(left @ (term @ right)) for term in self.terms]
        return TOLERANCES.roundings_of_entry * EPS * (size * size * parts[0] + size * parts[1] + parts[2])


def refined(problem: Quadratic, s: complex, x: Complex, y: Complex) -> tuple[complex, float, Complex] | None:
    """Return eigenvalue, error bound and right vector from first approximations; None if they do not converge.

    Parameters
    ----------
    problem : Quadratic
    s : complex
    x, y : ndarray, shape (n,)
        The entries of the multipliers may be 0.
    """
    with np.errstate(all="ignore"):
        bound, step = np.inf, np.inf
        for _ in range(TOLERANCES.newton_steps_eigenpair):
            change = _step(problem, s, x, y)
            if change is None:
                return None
            x, y, ds = change
            slope = complex(y.conj() @ (problem.slope(s) @ x))
            bound = problem.spread(s, x, y) / abs(slope)
            s += ds
            if not np.isfinite(abs(s)) or not np.isfinite(bound):
                return None
            if abs(ds) <= 0.1 * bound or abs(ds) <= EPS * abs(s):
                return s, bound + EPS * abs(s), x
            if abs(ds) > 2.0 * step:
                return None
            step = abs(ds)
        return (s, bound + step, x) if step <= bound else None


def _step(problem: Quadratic, s: complex, x: Complex, y: Complex) -> tuple[Complex, Complex, complex] | None:
    """Return corrected vectors and the correction of the eigenvalue, or None."""
    Q, D = problem.at(s), problem.slope(s)
    # The conjugate transpose of the same matrix corrects the left vector.
    right, left = (-np.append(residual, 0.0) for residual in (Q @ x, Q.conj().T @ y))
    try:
        first, second = (_solved if isinstance(Q, np.ndarray) else _solved_sparse)(Q, D @ x, y.conj() @ D, right, left)
    except (np.linalg.LinAlgError, RuntimeError):
        return None
    if not (np.isfinite(first).all() and np.isfinite(second).all()):
        return None
    return x + first[:-1], y + second[:-1], complex(first[-1])


def _solved(Q: Complex, column: Complex, row: Complex, right: Complex, left: Complex) -> tuple[Complex, Complex]:
    """Return T⁻¹ right and T⁻* left with T = [Q, column; row, 0]."""
    T = np.block([[Q, column[:, None]], [row, np.zeros((1, 1))]])
    rows, columns = equilibration(np.abs(T), *np.ones((2, len(T))))
    T = T * rows[:, None] * columns
    return columns * np.linalg.solve(T, rows * right), rows * np.linalg.solve(T.conj().T, columns * left)


def _solved_sparse(Q: Any, column: Complex, row: Complex, right: Complex, left: Complex) -> tuple[Complex, Complex]:
    """Return the same for a sparse Q."""
    from scipy.sparse import coo_array
    from scipy.sparse.linalg import splu

    Q, n = Q.tocoo(), len(column)
    i = np.concatenate([Q.coords[0], np.arange(n), np.full(n, n)])
    j = np.concatenate([Q.coords[1], np.full(n, n), np.arange(n)])
    entries = np.concatenate([Q.data, column, row])
    rows, columns = equilibration(coo_array((np.abs(entries), (i, j))), *np.ones((2, n + 1)))
    lu = splu(coo_array((entries * rows[i] * columns[j], (i, j))).tocsc())
    return columns * lu.solve(rows * right), rows * lu.solve(columns * left, "H")


def equilibration(sizes: Any, rows: Array, columns: Array) -> tuple[Array, Array]:
    """Return factors of rows and columns, powers of 2, that bring the largest entry of each near 1; from given ones.

    Parameters
    ----------
    sizes : matrix, shape (m, n)
        Absolute values, as an array or sparse.
    rows, columns : ndarray, shapes (m,) and (n,)
        Are changed.
    """
    for _ in range(TOLERANCES.balancing_rounds):
        for axis, factors in ((1, rows), (0, columns)):
            largest: Any = (sizes * rows[:, None] * columns).max(axis=axis)
            largest = largest if isinstance(largest, np.ndarray) else largest.toarray().ravel()
            factors *= np.exp2(-np.round(0.5 * np.log2(np.where(largest > 0.0, largest, 1.0))))
    return rows, columns
