"""Eigenpairs made as exact as the entries of the matrices are, whatever their sizes.

The eigenvalues of the deflated matrix bear the rounding of its largest entries. Newton's method
on the composite problem Q(s) x = (s²M̄ + sR̄ + K̄) x = 0, its linear systems equilibrated,

    [Q  Q'x; w* 0] [Δx; Δs] = −[Q x; 0],

makes of each what the residual in double precision allows (iterative refinement: Skeel 1980,
Math. Comp. 35): the error no longer depends on units, on masses in great ratios, or on how the
equations were reduced, but on how much of the single entries cancels,

    |Δs| ≤ |y|ᵀ (|s|² δM + |s| δR + δK) |x| / |y* Q'(s) x|.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mbstab.compiler.system import Array

Complex = npt.NDArray[np.complex128]

ROUNDINGS = 4.0
"""An entry is known to so many roundings of the largest term beside it."""

STEPS = 6
"""Newton steps at most; most eigenpairs need two."""

BALANCING = 4
"""Rounds in which rows and columns of a linear system are scaled to equal size."""

DENSE = 200
"""Larger systems than this are factorized as sparse ones."""

EPS = float(np.finfo(float).eps)


@dataclass(frozen=True)
class Quadratic:
    """The composite problem without rows that others imply, and the size of what its entries are summed from.

    Attributes
    ----------
    M, R, K : ndarray, shape (n, n)
    terms : tuple of ndarray
        Sizes of the terms of M, R and K.
    """

    M: Array
    R: Array
    K: Array
    terms: tuple[Array, Array, Array]

    def at(self, s: complex) -> Complex:
        """Return s²M + sR + K."""
        result: Complex = (s * s) * self.M + s * self.R + self.K
        return result

    def slope(self, s: complex) -> Complex:
        """Return 2sM + R."""
        result: Complex = 2.0 * s * self.M + self.R
        return result

    def spread(self, s: complex, x: Complex, y: Complex) -> float:
        """Return what the rounding of the entries makes of y* Q(s) x."""
        size, left, right = abs(s), np.abs(y), np.abs(x)
        parts = [float(left @ (term @ right)) for term in self.terms]
        return ROUNDINGS * EPS * (size * size * parts[0] + size * parts[1] + parts[2])


def refined(problem: Quadratic, s: complex, x: Complex, y: Complex) -> tuple[complex, float, Complex, Complex] | None:
    """Return eigenvalue, error bound, right and left vector from first approximations; None if they do not converge.

    Parameters
    ----------
    problem : Quadratic
    s : complex
    x, y : ndarray, shape (n,)
        Where they have no value for multipliers yet, 0 will do.
    """
    with np.errstate(all="ignore"):
        bound, step = np.inf, np.inf
        for _ in range(STEPS):
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
                return s, bound + EPS * abs(s), x, y
            if abs(ds) > 2.0 * step:
                return None
            step = abs(ds)
        return (s, bound + step, x, y) if step <= bound else None


def _step(problem: Quadratic, s: complex, x: Complex, y: Complex) -> tuple[Complex, Complex, complex] | None:
    """Return corrected vectors and the correction of the eigenvalue, or None."""
    Q, D = problem.at(s), problem.slope(s)
    n = len(Q)
    T = np.zeros((n + 1, n + 1), dtype=complex)
    T[:n, :n] = Q
    T[:n, n], T[n, :n] = D @ x, y.conj() @ D
    rows, columns = equilibration(T)
    # The same matrix, turned over, corrects the left vector.
    right, left = (-np.append(residual, 0.0) for residual in (Q @ x, Q.conj().T @ y))
    try:
        first, second = _solved(T * rows[:, None] * columns, rows * right, columns * left)
    except (np.linalg.LinAlgError, RuntimeError):
        return None
    first, second = columns * first, rows * second
    if not (np.isfinite(first).all() and np.isfinite(second).all()):
        return None
    return x + first[:n], y + second[:n], complex(first[n])


def equilibration(T: Complex | Array) -> tuple[Array, Array]:
    """Return factors of rows and columns that make the largest entries of all of them about 1, powers of 2."""
    size = np.abs(T)
    rows, columns = np.ones(len(T)), np.ones(len(T))
    for _ in range(BALANCING):
        for axis, factors in ((1, rows), (0, columns)):
            largest = np.max(size * rows[:, None] * columns, axis=axis)
            factors /= np.exp2(np.round(0.5 * np.log2(np.where(largest > 0.0, largest, 1.0))))
    return rows, columns


def _solved(T: Complex, right: Complex, left: Complex) -> tuple[Complex, Complex]:
    """Return T⁻¹ right and T⁻* left."""
    if len(T) <= DENSE:
        return np.linalg.solve(T, right), np.linalg.solve(T.conj().T, left)
    from scipy.sparse import csc_array
    from scipy.sparse.linalg import splu

    lu = splu(csc_array(T))
    return lu.solve(right), lu.solve(left, "H")
