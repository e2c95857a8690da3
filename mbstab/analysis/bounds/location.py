"""Location of the eigenvalues: discs of the complex plane that contain them, single ones and clusters alike.

Eigenvalues that symmetries and conserved functions explain are separated first (`mbstab.analysis.verdict.neutral`): T
spans directions with S T ⊂ T, the rows of L are differentials with L S = 0, and the matrix left to
judge is A = Bᵀ S B on {y ⟂ T, L y = 0}. With approximate eigenvectors V = B W, dual rows Y and
A W ≈ W C, C block diagonal, one block for each cluster, every column is lifted to a motion with
positions x, speeds ẋ, accelerations ẍ and multipliers ν, every row to forces y and to the weights
λ, μ of the rows of the constraints. In these bases

    F = y (M ẍ + R ẋ + K x + Jᵀ ν) + λ C x + μ (D_u ẋ + D_q x)

is the error of C, to first order, and the same expression with sizes instead of numbers and
with the errors of M, R, K, J and D_q (`mbstab.analysis.linear.roundings`) bounds the effect of errors in the data.
The unreduced equations give both entry by entry: neither digits lost in
the reduction, nor units, nor large mass ratios matter. C and W are corrected by F until
the coupling of the blocks is negligible; with an error E of the remaining size, the matrix is C + E,
and s is not an eigenvalue if, for the block I and all others R,

    ρ(|(s − C_I)⁻¹| (E_II + E_IR X)) < 1,   X ≥ |(s − C_R)⁻¹| (E_RI + E_RR X),

which is evaluated on circles (Gershgorin's discs for blocks: Feingold and Varga 1962, Pacific J.
Math. 12). By continuity the disc inside contains as many eigenvalues as the block. Blocks are joined where
there is no such circle. Finally, single eigenvalues that suffer from the rounding of T and L, or of much
larger ones, are refined (`mbstab.analysis.algebra.refinement`); the result counts if it lies in the disc.
"""

from __future__ import annotations

import numpy as np

from mbstab.analysis.algebra.arrays import Complex
from mbstab.analysis.algebra.tolerances import EPS
from mbstab.analysis.bounds.backward_errors import BackwardErrors
from mbstab.analysis.bounds.clusters import Clusters
from mbstab.analysis.bounds.discs import Disc, Group, Placed, relative
from mbstab.analysis.bounds.eigenpairs import eigenpairs
from mbstab.analysis.bounds.grouping import covering, dependent, partners
from mbstab.analysis.bounds.tolerances import TOLERANCES
from mbstab.analysis.linear.linearize import Linearization, StateSpace
from mbstab.analysis.linear.tolerances import TOLERANCES as LINEAR
from mbstab.compiler.system import Array

UNLIKE = 1e150
"""Distance of a missing value."""


def enclosures(
    linear: Linearization, space: StateSpace, gamma: float, S: Array, T: Array, L: Array, fitted: float = 0.0
) -> Placed:
    """Return discs that contain the eigenvalues other than those of T and L.

    Parameters
    ----------
    linear : Linearization
    space : StateSpace
    gamma : float
        A typical rate (1/s), the unit of the speeds of S.
    S : ndarray, shape (n, n)
        The balanced matrix.
    T : ndarray, shape (n, d)
        Orthonormal, with S T ⊂ T by structure.
    L : ndarray, shape (k, n)
        Orthonormal rows with L S = 0 by structure and L T = 0.
    fitted : float
        How far T was moved to fit the rounding of S.
    """
    if linear.system.sparse:
        from mbstab.analysis.bounds.sparse_bounds import sparse_enclosures

        return sparse_enclosures(linear, space, gamma, S, T, L)
    with np.errstate(all="ignore"):
        return _Eigenvectors(linear, space, gamma, S, T, L, fitted).found().placed()


def enclosures_of(
    linear: Linearization,
    space: StateSpace,
    gamma: float,
    S: Array,
    T: Array,
    L: Array,
    values: Complex,
    vectors: Complex,
    fitted: float = 0.0,
) -> Placed:
    """Return bounds of eigenvalues of another method, from their distance to the discs, and the discs.

    Parameters
    ----------
    values : ndarray of complex, shape (r,)
        All finite eigenvalues that it has found, including those of T and L.
    vectors : ndarray of complex, shape (n_q or more, r)
        The first n_q components of a column are Δq (m, rad).
    """
    with np.errstate(all="ignore"):
        judge = _Eigenvectors(linear, space, gamma, S, T, L, fitted)
        return _of_others(judge, np.asarray(values, dtype=complex), vectors)


class _Eigenvectors(BackwardErrors):
    """Eigenvectors of A, lifted to the unreduced equations, with their residuals there."""

    def found(self) -> Clusters:
        """Return the eigenvalues in groups that can be separated; nothing is known of them where that fails."""
        n = len(self.A)
        if not n:
            none = np.zeros((0, 0), dtype=complex)
            return Clusters(self, none, none, [], [])
        try:
            return self._found()
        except (np.linalg.LinAlgError, ArithmeticError):
            return self._unknown(n)

    def _unknown(self, n: int) -> Clusters:
        unknown = np.full((n, n), np.nan + 0j)
        return Clusters(self, unknown, unknown, [[i] for i in range(n)], list(range(n)))

    def _found(self) -> Clusters:
        values, W = (x[0] for x in eigenpairs(self.A[None], TOLERANCES.slow_eigenvalue))
        partner = partners(values)
        found = self._joined(W, np.diag(values), [[i] for i in range(len(values))], partner)
        if found.clear():
            return found
        groups = dependent(values, partner, lambda g: self.weighted(W[:, g], float(np.max(np.abs(values[g])))))
        if len(groups) < len(values):
            # Nearly parallel vectors are taken from their subspace, where they are easier to tell apart.
            start = Clusters(self, W, np.diag(values), groups, partner).split()
            found = min(found, self._joined(*start), key=lambda x: x.spread())
        if len(found.groups) < len(values):
            # Groups that were not separable may be so in the basis of their subspace.
            start = found.split()
            if len(start[2]) > len(found.groups):
                found = min(found, self._joined(*start), key=lambda x: x.spread())
        return found

    def _joined(self, W: Complex, C: Complex, groups: list[Group], partner: list[int]) -> Clusters:
        """Return the eigenvalues in larger groups, until these can be separated."""
        try:
            return self._told(W, C, groups, partner)
        except (np.linalg.LinAlgError, ArithmeticError):
            return self._unknown(len(W))

    def _told(self, W: Complex, C: Complex, groups: list[Group], partner: list[int]) -> Clusters:
        rates = np.zeros(len(W))
        for _ in range(TOLERANCES.joining_rounds):
            found = Clusters(self, W, C, groups, partner, rates)
            joined = found.joined()
            if joined is None:
                break
            groups, rates = joined, found.rates(joined)
        else:
            found.radii = np.full(len(found.groups), np.inf)
            return found
        if len(groups) < len(W):
            # The basis of a cluster is best with speeds in units of its radius.
            other = Clusters(self, W, C, groups, partner, np.nan_to_num(found.radii, posinf=0.0)[found.of])
            if other.joined() is None:
                found = min(found, other, key=lambda x: x.spread())
        return found


# --- eigenvalues of other methods -----------------------------------------------------------------------------------


def _of_others(judge: _Eigenvectors, values: Complex, vectors: Complex) -> Placed:
    """Return bounds for values of another method: their distances from the default ones plus the bounds of these."""
    from mbstab.analysis.algebra.matching import assigned

    found = judge.found()
    own = found.placed()
    T = judge.T
    inner = judge.inner
    zeros = np.linalg.eigvals(inner).astype(complex) if T.shape[1] else np.zeros(0, dtype=complex)
    rounding = LINEAR.roundings_of_sum * EPS * float(np.linalg.norm(inner))
    known = np.concatenate([own.values, zeros, np.zeros(judge.outside.shape[1], dtype=complex)])
    count, size = len(values), max(len(values), len(known))
    distance = np.full((size, size), UNLIKE)
    distance[:count, : len(known)] = np.nan_to_num(np.abs(values[:, None] - known), nan=UNLIKE, posinf=UNLIKE)
    columns = assigned(distance)[:count].tolist() if size else []
    x = vectors[: len(judge.N)] / judge.linear.spaces.scale[:, None]
    pairs = judge.pairs(values, x)
    bounds, neutral = np.full(count, np.inf), []
    for i, j in enumerate(columns):
        if j >= len(known) or not np.isfinite(values[i]):
            continue
        off = float(abs(values[i] - known[j]))
        if j >= len(own.values):
            # A value nearer to another eigenvalue means that this one was lost.
            if off <= float(np.min(np.abs(own.values - values[i]), initial=np.inf)):
                neutral.append(i)
                bounds[i] = off + rounding + EPS * abs(values[i])
        elif off <= own.bounds[j] + TOLERANCES.other_method_distance * found.misfit(j, complex(values[i]), pairs, i):
            bounds[i] = (off + float(own.bounds[j])) * (1.0 + 4.0 * EPS)
    discs = covering([Disc(complex(values[i]), float(bounds[i]), (i,)) for i in range(count) if i not in neutral])
    condition = relative(bounds / EPS, values)
    return Placed(values + 0.0, discs, bounds, condition, judge.backward(values, pairs), x, tuple(neutral))
