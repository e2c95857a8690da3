"""The unreduced equations of a large scene: residuals of approximate eigenvectors, and their improvement.

With motions x, forces y and the multipliers ν, μ that belong to them, a two-sided Rayleigh quotient

    s − y* Q(s) x / y* Q'(s) x,    Q(s) = [s²M + sR + K, Jᵀ; J, 0],    x = [Δq; Δν]

makes eigenvalues of the reduced matrix as accurate as the entries of the equations: errors of x and y enter as their
product only (Lancaster 1961; Schwetlick and Schreiber 2012, Linear Algebra Appl. 436).

Where M, R and K are symmetric, Q is so, and left vectors are the conjugates of right ones.

Without damping the unknown is the square: λ = s² in Q = [λM + K, Jᵀ; J, 0], which is symmetric and linear in λ. Its
eigenvalues are real and its vectors orthogonal, also where s = 0 is a double eigenvalue with one vector.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from mbstab.analysis.algebra.arrays import Complex
from mbstab.analysis.algebra.sparse import bordered, in_parts, largest, product, scaled
from mbstab.analysis.algebra.sparse_rank import SparseRank
from mbstab.analysis.algebra.tolerances import EPS
from mbstab.analysis.linear.linearize import Linearization
from mbstab.analysis.linear.roundings import roundings
from mbstab.analysis.linear.tolerances import TOLERANCES
from mbstab.analysis.reference.coefficients import Matrices
from mbstab.compiler.system import Array
from mbstab.records import dataclass


@dataclass
class Pairs:
    """Approximate eigenvectors with their corrections and residuals, column by column.

    Attributes
    ----------
    s : ndarray of complex, shape (k,)
        Eigenvalues, corrected by the quotient.
    step : ndarray
        Size of the correction.
    slope : ndarray of complex
        y* Q'(s) x.
    first : ndarray
        Effect of data errors, to first order (1/s).
    right, left : ndarray
        Sizes of the residuals Q x and Q* y, including the effect of data errors.
    backward : ndarray
        Residual relative to the matrices.
    """

    s: Complex
    step: Array
    slope: Complex
    first: Array
    right: Array
    left: Array
    backward: Array


class Residuals(NamedTuple):
    """Residuals of the equations with approximate eigenvectors, and their errors from the data.

    Attributes
    ----------
    nu, mu : ndarray
        Multipliers of both sides.
    off, gap : ndarray
        Residuals of Q x, in forces and rows; `back` and `drift` those of Q* y.
    open, rows : ndarray
        Effect of data errors on these; `shut` and `columns` for the other side.
    slope : ndarray
        Q'(s) x.
    """

    nu: Any
    mu: Any
    off: Any
    gap: Any
    back: Any
    drift: Any
    open: Array
    rows: Array
    shut: Array
    columns: Array
    slope: Any


class SparsePencil:
    """M, R, K and J of a linearization without rows on speeds, in scaled coordinates, with their error bounds.

    Parameters
    ----------
    linear : Linearization

    Attributes
    ----------
    symmetric : bool
        Whether M, R and K are symmetric, up to errors of which `errors` takes account.
    squares : bool
        Whether `s` stands for the square of a rate everywhere; see `undamped`.
    """

    def __init__(self, linear: Linearization) -> None:
        self.linear, self.squares = linear, False
        spaces = linear.spaces
        self.scale, self.rows = spaces.scale, spaces.row_scale
        self.M, self.R, self.K, self.J, _ = self._scaled(Matrices(linear.M, linear.R, linear.K, linear.J, linear.D_q))
        self._odd = [0.5 * (x - x.T) for x in (self.R, self.K)]
        self.symmetric = all(
            largest(odd) <= 0.5 * TOLERANCES.symmetric_part * largest(x)
            for odd, x in zip(self._odd, (self.R, self.K), strict=True)
        )
        if self.symmetric:
            self.R, self.K = self.R - self._odd[0], self.K - self._odd[1]
        assert isinstance(spaces.C, SparseRank)
        self.inverse, self.kept = spaces.C.pseudo_inverse, spaces.C.kept
        self.norms = [_norm_bound(x) for x in (self.M, self.R, self.K, self.J)]

    def _scaled(self, matrices: Matrices) -> Matrices:
        M, R, K = (scaled(x, self.scale, self.scale) for x in matrices[:3])
        return Matrices(M, R, K, scaled(matrices.J, self.scale, self.rows), matrices.D_q)

    @cached_property
    def errors(self) -> Matrices:
        """Error bounds of M, R, K and J, and of the summation of products with them."""
        found, n = self._scaled(roundings(self.linear).errors), sum(self.J.shape)
        summed = (TOLERANCES.roundings_of_sum + 0.5 * math.log2(n)) * EPS
        own = (self.M, self.R, self.K, self.J)
        M, R, K, J = (x + summed * abs(y) for x, y in zip(found[:4], own, strict=True))
        if self.symmetric:
            M, R, K = (x.maximum(x.T) for x in (M, R, K))
            R, K = R + abs(self._odd[0]), K + abs(self._odd[1])
        return Matrices(M, R, K, J, found.D_q)

    @cached_property
    def displaced(self) -> list[Matrices]:
        """Changes of the matrices by rounding errors of coordinates that are held weakly."""
        return [self._scaled(change) for change in roundings(self.linear).displaced]

    @property
    def undamped(self) -> bool:
        """Whether no force depends on speeds and K is symmetric."""
        return self.symmetric and not largest(self.R)

    # --- products ---------------------------------------------------------------------------------------------------

    def force(self, s: Complex, x: Any, parts: Any = None, transposed: bool = False) -> Any:
        """Return (s²M + sR + K) x, column by column, or with the transposed matrices."""
        M, R, K = (self.M, self.R, self.K) if parts is None else parts
        if transposed:
            M, R, K = M.T, R.T, K.T
        if self.squares:
            return s * product(M, x) + product(K, x)
        return s * s * product(M, x) + s * product(R, x) + product(K, x)

    def slope(self, s: Complex, x: Any, transposed: bool = False) -> Any:
        """Return the derivative of that by s, (2sM + R) x."""
        M, R = (self.M.T, self.R.T) if transposed else (self.M, self.R)
        return product(M, x) if self.squares else 2.0 * s * product(M, x) + product(R, x)

    def multipliers(self, force: Any) -> Any:
        """Return the least-squares solution ν of Jᵀ ν = −force."""
        return -in_parts(lambda b: self.inverse.rmatmat(b), force)

    def residuals(self, s: Complex, x: Any, y: Any) -> Residuals:
        """Return the residuals of the equations with approximate eigenvectors, column by column.

        Of symmetric equations y must be the conjugate of x.
        """
        nu, off, gap, open_, rows = self._side(s, x, False)
        if self.symmetric:
            mu, back, drift, shut, columns = nu.conj(), off.conj(), gap.conj(), open_, rows
        else:
            mu, back, drift, shut, columns = self._side(s.conj(), y, True)
        return Residuals(nu, mu, off, gap, back, drift, open_, rows, shut, columns, self.slope(s, x))

    def _side(self, s: Complex, x: Any, transposed: bool) -> tuple[Any, Any, Any, Array, Array]:
        """Return multipliers, residuals of forces and rows, and their bounds from the errors of the data."""
        pull = self.force(s, x, transposed=transposed)
        nu = self.multipliers(pull)
        J, e, size, size_nu = self.J, self.errors, np.abs(x), np.abs(nu)
        open_ = self.force(np.abs(s), size, e[:3], transposed) + e.J.T @ size_nu
        return nu, pull + product(J.T, nu), product(J, x), open_, e.J @ size

    def pairs(self, s: Complex, x: Any, y: Any) -> Pairs:
        """Return corrected eigenvalues with the residuals of their vectors."""
        x, y = x / _lengths(x), y / _lengths(y)
        r = self.residuals(s, x, y)
        slope = np.sum(y.conj() * r.slope, axis=0)
        step = (np.sum(y.conj() * r.off, axis=0) + np.sum(r.mu.conj() * r.gap, axis=0)) / slope
        first = np.sum(np.abs(y) * r.open, axis=0) + np.sum(np.abs(r.mu) * r.rows, axis=0)
        for change in self.displaced:
            moved = np.sum(y.conj() * self.force(s, x, change[:3]), axis=0)
            moved += np.sum(y.conj() * product(change.J.T, r.nu), axis=0)
            first += np.abs(moved + np.sum(r.mu.conj() * product(change.J, x), axis=0))
        right = _lengths(r.off, r.open) + self.across(s, _lengths(r.gap, r.rows))
        left = _lengths(r.back, r.shut) + self.across(s, _lengths(r.drift, r.columns))
        weight = self._weight(s) + self.norms[3] * _lengths(r.nu)
        return Pairs(s - step, np.abs(step), slope, first / np.abs(slope), right, left, _lengths(r.off) / weight)

    def _weight(self, s: Complex) -> Array:
        M, R, K, _ = self.norms
        size = np.abs(s)
        result: Array = (size * M if self.squares else size**2 * M + size * R) + K
        return result

    def across(self, s: Complex, gap: Array) -> Array:
        """Return a bound of the force that is needed to close a gap in the rows."""
        least = self.linear.spaces.C.smallest_kept
        return self._weight(s) * gap / min(least, 1.0)

    # --- better vectors ---------------------------------------------------------------------------------------------

    def better(self, s: Any, x: Any, y: Any) -> tuple[Any, Any] | None:
        """Return columns after one step of inverse iteration on both sides, or None."""
        from scipy.sparse.linalg import splu

        n, J = len(self.scale), self.J[self.kept]
        t = s * (1.0 + TOLERANCES.vector_shift)
        forces = t * self.M + self.K if self.squares else t * t * self.M + t * self.R + self.K
        H = bordered(forces, J).astype(x.dtype)
        none = np.zeros((J.shape[0], 1), dtype=x.dtype)
        try:
            lu = splu(H)
            right = lu.solve(np.concatenate([self.slope(s, x), none]))[:n]
            if self.symmetric:
                return (right, right.conj()) if np.isfinite(right).all() else None
            left = lu.solve(np.concatenate([self.slope(s.conjugate(), y, transposed=True), none]), "H")[:n]
        except RuntimeError:
            return None
        return (right, left) if np.isfinite(right).all() and np.isfinite(left).all() else None


@dataclass
class Block:
    """The equations on a subspace: near s it has the eigenvalues of s + D, up to `error`.

    Attributes
    ----------
    s : complex
    D : ndarray of complex, shape (k, k)
    inverse : ndarray of complex
        (Y* Q'(s) X)⁻¹.
    data, bent : ndarray
        Effect of data errors on Y* Q X, and terms of second order in D.
    right, left : float
        Sizes of the remaining residuals, including the effect of data errors.
    """

    s: Any
    D: Any
    inverse: Any
    data: Array
    bent: Array
    right: float
    left: float

    def error(self, total: float) -> Array:
        """Return error bounds of the entries of D, with Σ κ_k/|s − s_k| over all others."""
        size = float(np.linalg.norm(self.D, 2)) ** 2
        result: Array = np.abs(self.inverse) @ (self.data + self.right * self.left * total + size * self.bent)
        return result


def blocks_of(pencil: SparsePencil, centres: list[Any], right: list[Any], left: list[Any]) -> list[Block]:
    """Return the equations on several subspaces, given by bases of right and of left vectors."""
    widths = [X.shape[1] for X in right]
    s, X, Y = np.repeat(np.array(centres), widths), np.hstack(right), np.hstack(left)
    r = pencil.residuals(s, X, Y)
    mass = product(pencil.M, X) * (not pencil.squares)  # half of Q''
    other = pencil.slope(s.conj(), Y, transposed=True)
    changes = [
        (pencil.force(s, X, change[:3]) + product(change.J.T, r.nu), product(change.J, X))
        for change in pencil.displaced
    ]
    found, start = [], 0
    for centre, width in zip(centres, widths, strict=True):
        at = np.s_[:, start : start + width]
        start += width
        Y_t, mu_t = Y[at].conj().T, r.mu[at].conj().T
        G = Y_t @ r.slope[at]
        try:
            inverse = np.linalg.inv(G)
        except np.linalg.LinAlgError:
            inverse = np.full(G.shape, np.nan + 0j)
        D = -inverse @ (Y_t @ r.off[at] + mu_t @ r.gap[at])
        data = np.abs(Y_t) @ r.open[at] + np.abs(mu_t) @ r.rows[at]
        data = data + sum(np.abs(Y_t @ force[at] + mu_t @ gap[at]) for force, gap in changes)
        # The part of the residuals in the block is not an error.
        sizes = [
            _norm(r.off[at] + r.slope[at] @ D, r.open[at]),
            _norm(r.back[at] + other[at] @ (G @ D @ inverse).conj().T, r.shut[at]),
        ]
        gaps = np.array([_norm(r.gap[at], r.rows[at]), _norm(r.drift[at], r.columns[at])])
        right_over, left_over = (np.array(sizes) + pencil.across(np.array([centre]), gaps)).tolist()
        found.append(Block(centre, D, inverse, data, np.abs(Y_t @ mass[at]), right_over, left_over))
    return found


def _norm_bound(A: Any) -> float:
    """Return √(‖A‖₁ ‖A‖_∞) of a matrix in compressed rows, which its 2-norm does not exceed."""
    sizes = np.abs(A.data)
    columns = np.bincount(A.indices, sizes, minlength=1)
    rows = np.bincount(np.repeat(np.arange(A.shape[0]), np.diff(A.indptr)), sizes, minlength=1)
    return math.sqrt(float(columns.max()) * float(rows.max()))


def _norm(*parts: Any) -> float:
    """Return the sum of the norms of matrices."""
    return float(sum(np.linalg.norm(x) for x in parts))


def _lengths(*parts: Any) -> Array:
    """Return the sums of the lengths of columns."""
    total = np.zeros(parts[0].shape[1])
    for x in parts:
        # The parts of complex columns side by side: `numpy.linalg.norm` makes several copies of them.
        real = np.ascontiguousarray(x).view(float)
        squares = np.einsum("ij,ij->j", real, real)
        total += np.sqrt(squares.reshape(x.shape[1], 2 if np.iscomplexobj(x) else 1).sum(axis=1))
    return total
