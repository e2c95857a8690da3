"""Motions that the constraints allow: scaling, ranks with gaps, and orthonormal bases.

Coordinates are scaled by the square roots of the masses they carry and constraint rows to
unit length, so that a rank decision does not depend on units. A light body between heavy ones
carries their inertia: scaled by its own mass it would dominate the rows on both its sides, which
would seem to depend on each other. Where coordinates in such rows are light, the scale that
separates the rows better is taken. In the end each coordinate has the scale of the inertia that it carries in allowed
motions, if that is much larger than its own, but of no more than the largest one: N, Z and P would have small entries
for light coordinates, known to the rounding of the large ones, which stiffness and the rows D_q multiply. Where the
frame of a motion mixes coordinates of which one carries inertia and another does not, it is the other way round:
`mbstab.analysis.linear.linearize` compares both. With
J = [C_q; D_u],

    C_q N = 0,   W = D_u N,   W_q = D_q N,   W Z = 0,   P = −W⁺ W_q,

a small motion is Δq = N ξ with ξ̇ = P ξ + Z η, and there are n_f = dim ξ + dim η finite
eigenvalues.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from mbstab.analysis.algebra.arrays import Flags, Index, least_squares
from mbstab.analysis.algebra.rank import Rank, last_rows, rank_of
from mbstab.analysis.algebra.sparse import dense, is_sparse, row_norms, scaled
from mbstab.analysis.algebra.stacks import beside, frobenius, transposed
from mbstab.analysis.algebra.tolerances import TOLERANCES
from mbstab.compiler.system import Array, Row
from mbstab.errors import ConstraintError
from mbstab.records import dataclass

if TYPE_CHECKING:
    from mbstab.analysis.algebra.sparse_rank import SparseRank


@dataclass(frozen=True)
class Redundancy:
    """A constraint row that other rows imply."""

    row: Row
    repeats: tuple[Row, ...]

    def __str__(self) -> str:
        if not self.repeats:
            return f"{self.row} restricts nothing here"
        others = ", ".join(dict.fromkeys(row.owner for row in self.repeats))
        return f"{self.row} repeats what {others} already impose{'s' if ',' not in others else ''}"


@dataclass(frozen=True)
class Subspaces:
    """Scaled bases of the motions the constraints allow; over the points of a sweep all arrays have an axis for these.

    Attributes
    ----------
    scale : ndarray, shape (…, n_q)
        q = scale · scaled q.
    row_scale : ndarray, shape (…, n_c)
        Factors that give the scaled rows unit length.
    C, W : Rank
        Rank decisions about scaled C_q and scaled D_u N.
    plain : Subspaces or None
        The same in the scale of the coordinates' own inertias, where this is that of carried ones; None: that is no
        other one, or hides the ranks.
    """

    scale: Array
    row_scale: Array
    C: Rank | SparseRank
    W: Rank
    plain: Subspaces | None = None

    @property
    def N(self) -> Array:
        """Null-space basis of the scaled C_q, shape (…, n_q, n_q − rank C_q)."""
        return self.C.null

    @property
    def Z(self) -> Array:
        """Null-space basis of W, in the coordinates of N."""
        return self.W.null

    @property
    def allowed(self) -> Array:
        """Basis of the speeds that all rows allow, N Z, shape (…, n_q, dim η)."""
        return self.N @ self.Z if self.W.left_null.size or self.W.rank else self.N

    def projected(self, x: Array) -> Array:
        """Return the part of a vector that all rows allow."""
        if not isinstance(self.C, Rank) and not len(self.W.left_null):
            return self.C.rows.allowed(x)
        result: Array = self.allowed @ (self.allowed.T @ x)
        return result

    def inverse(self, J: Any) -> Any:
        """Return the pseudo-inverse of the scaled rows, all together, shape (…, n_q, n_c)."""
        if is_sparse(J):
            return self.C.pseudo_inverse
        if J.ndim > 2 and not self.C.left_null.size + self.W.left_null.size:  # of independent rows, in parts
            of_C, along = self.C.pseudo_inverse, self.N @ self.W.pseudo_inverse
            return beside(of_C - along @ (J[..., self.C.rank :, :] @ of_C), along)
        return np.linalg.pinv(J, rcond=TOLERANCES.singular_value_zero) if J.size else transposed(J)

    @property
    def n_f(self) -> int:
        """Number of finite eigenvalues."""
        return 2 * (len(self.scale) - self.C.rank) - self.W.rank


def coordinate_scale(M: Any, sizes: Array, J: Any, n_h: int, states: int | None = None) -> Array:
    """Return 1/√M_ii; for a coordinate without mass a value that follows from the others and the sizes.

    It is that of the lightest one to which the first n_h rows tie the coordinate, at once or by others without mass.
    For the last coordinates, as many as `states` says (None: for all), it is large enough that the other rows, which
    determine them from the others, are not dominated by these.
    """
    diagonal = M.diagonal()
    heavy = diagonal > 0.0
    scale = sizes.copy()
    scale[heavy] = 1.0 / np.sqrt(diagonal[heavy])
    if heavy.any() and not heavy.all():
        scale[~heavy] *= _lightest(J[:n_h], scale / sizes, heavy)
        speeds = J[n_h:]
        if speeds.shape[0]:
            rows = abs(dense(speeds))
            others = np.sqrt(((rows * scale)[:, heavy] ** 2).sum(axis=1))
            first = 0 if states is None else len(scale) - states
            for i in first + np.flatnonzero(~heavy[first:]):
                held = rows[:, i] > 0.0
                scale[i] = max(scale[i], np.max(others[held] / rows[held, i], initial=0.0))
    return scale


def _lightest(J: Any, scale: Array, heavy: Flags) -> Array:
    """Return for each coordinate without mass the largest scale to which rows tie it; a middle one if to none."""
    rows, columns = J.nonzero()
    tied, largest = np.where(heavy, scale, 0.0), np.zeros(J.shape[0])
    while True:
        np.maximum.at(largest, rows, tied[columns])
        found = tied.copy()
        np.maximum.at(found, columns, largest[rows])
        found[heavy] = scale[heavy]
        if np.array_equal(found, tied):
            result: Array = np.where(tied > 0.0, tied, np.sort(scale[heavy])[heavy.sum() // 2])[~heavy]
            return result
        tied = found


def subspaces(M: Any, J: Any, n_h: int, rows: Sequence[Row], sizes: Array, scale: Array | None = None) -> Subspaces:
    """Return the motions that the constraints allow.

    Parameters
    ----------
    M : matrix, shape (n_q, n_q)
    J : matrix, shape (n_c, n_q)
        [C_q; D_u], arrays or sparse; element (i, j) is the derivative of row i with respect to speed j.
    n_h : int
        Number of holonomic rows.
    rows : sequence of Row
        For messages.
    sizes : ndarray, shape (n_q,)
        Characteristic size of each coordinate.
    scale : ndarray, shape (n_q,), optional
        Scale of the coordinates; that of `coordinate_scale` for the rows on speeds if not given.

    Raises
    ------
    ConstraintError
        If a rank decision has no gap.
    """
    if scale is None:
        scale = coordinate_scale(M, sizes, J, n_h, sum(row.section == "states" for row in rows))
    found = other = decided(J, n_h, scale)
    most = sizes * np.min(scale / sizes) / np.sqrt(TOLERANCES.light_mass)
    # Behind the light coordinates of some rows there may be those of others: all of them together may be what it takes.
    while len(light := _light(J, n_h, other, most)):
        carrying = other.scale.copy()
        carrying[light] = most[light]
        other = decided(J, n_h, carrying)
        if (other.C.rank + other.W.rank, _least(other)) > (found.C.rank + found.W.rank, 2.0 * _least(found)):
            found = other
    if isinstance(found.C, Rank):
        carrying = _carrying(M, J[:n_h], found, sizes)
        if carrying is not found.scale:
            plain, found = found, decided(J, n_h, carrying)
            same = (plain.C.rank, plain.W.rank) == (found.C.rank, found.W.rank)
            found = replace(found, plain=plain if same and _has_gap(plain.C) and _has_gap(plain.W) else None)
    require_gap(found.C, rows[:n_h])
    require_gap(found.W, rows[n_h:])
    return found


def decided(J: Any, n_h: int, scale: Array, like: Subspaces | None = None) -> Subspaces:
    """Return the motions that the constraints allow, with coordinates of this scale, whether there is a gap or not.

    Over the points of a sweep the ranks are expected to be those `like` there are at another point.
    """
    row_scale = 1.0 / row_norms(scaled(J, scale))
    unit = scaled(J, scale, row_scale)
    ranks = (None, None) if like is None else (like.C.rank, like.W.rank)
    if J.shape[-2] and ranks == (n_h, J.shape[-2] - n_h):
        return Subspaces(scale, row_scale, *_independent(unit, n_h))
    C = _sparse_rank(unit[:n_h]) if is_sparse(J) else rank_of(unit[..., :n_h, :], rank=ranks[0])
    none = np.zeros((*J.shape[:-2], 0, J.shape[-1] - C.rank))
    W = rank_of(unit[..., n_h:, :] @ C.null if n_h < J.shape[-2] else none, rank=ranks[1])
    return Subspaces(scale, row_scale, C, W)


def _independent(J: Array, n_h: int) -> tuple[Rank, Rank]:
    """Return the ranks of stacks of rows, shape (points, n_c, n_q), that are all independent, from Jᵀ = Q R.

    The norm of an inverse bounds the least singular value; where it does not tell enough, that itself is computed.
    """
    n_c, n = J.shape[-2:]
    Q, R = np.linalg.qr(transposed(J), mode="complete")
    regular = np.all(np.diagonal(R, axis1=-2, axis2=-1), axis=-1)
    inverse, kept = np.linalg.inv(np.where(regular[:, None, None], R[:, :n_c], np.eye(n_c))), list[Array]()
    for part in (slice(n_h), slice(n_h, n_c)):
        least = np.where(regular, 1.0 / np.maximum(frobenius(inverse[:, part, part]), 1e-300), 0.0)
        vague = np.flatnonzero(regular & (least < math.sqrt(TOLERANCES.light_mass)))
        least[vague] = np.min(np.linalg.svd(R[vague, part, part], compute_uv=False), axis=-1, initial=np.inf)
        kept.append(least)
    across = np.zeros((len(J), n - n_h, n_c - n_h))
    across[:, : n_c - n_h] = transposed(inverse[:, n_h:, n_h:])
    of_C = Q[..., :n_h] @ transposed(inverse[:, :n_h, :n_h])
    none, allowed = np.zeros((len(J), 0, 0)), np.eye(n - n_h)[None, :, n_c - n_h :]
    ends = (0.0, Q[..., n_h:], none, none, of_C), (0.0, allowed, none, none, across)
    return Rank(n_h, kept[0], *ends[0]), Rank(n_c - n_h, kept[1], *ends[1])


def _carrying(M: Array, C_q: Array, spaces: Subspaces, sizes: Array) -> Array:
    """Return the scale of coordinates that carry much more inertia than their own: 1/√m with the carried one m.

    A force along a coordinate accelerates it by 1/m: the entries of the diagonal of A (AᵀMA)⁻¹ Aᵀ, A = N Z.
    A coordinate that is held has the scale of the lightest one to which rows tie it.
    """
    scale, allowed = spaces.scale, spaces.allowed
    try:
        half = np.linalg.cholesky(allowed.T @ (M * scale * scale[:, None]) @ allowed)
    except np.linalg.LinAlgError:
        return scale  # motions without mass
    least = sizes * np.min(scale / sizes)
    carried: Array = np.maximum(scale * np.linalg.norm(np.linalg.solve(half, allowed.T), axis=0), least)
    moving = np.linalg.norm(spaces.N, axis=1) > TOLERANCES.row_weight_dependent
    if not np.any(scale[moving] > TOLERANCES.light_beside_carried * carried[moving]):
        return scale
    if not moving.all():
        carried[~moving] = np.maximum(sizes[~moving] * _lightest(C_q, carried / sizes, moving), least[~moving])
    return np.where(scale > TOLERANCES.light_beside_carried * carried, carried, scale)


def _least(spaces: Subspaces) -> float:
    """Return the smallest singular value that counts as one."""
    return float(min(spaces.C.smallest_kept, spaces.W.smallest_kept))


def _light(J: Any, n_h: int, spaces: Subspaces, most: Array) -> Index:
    """Return the coordinates of larger scale than `most` in rows that depend on each other, or nearly do."""
    if not np.any(spaces.scale > most):
        return np.zeros(0, dtype=np.intp)
    weights = np.zeros(J.shape[0])
    for rank, part in ((spaces.C, slice(n_h)), (spaces.W, slice(n_h, None))):
        vague = rank.smallest_kept < np.sqrt(TOLERANCES.light_mass)
        combinations = [rank.left_null, rank.doubtful[:, None]] if vague else [rank.left_null]
        weights[part] = np.max(np.abs(np.hstack(combinations)), axis=1, initial=0.0)
    involved = abs(J[np.flatnonzero(weights > TOLERANCES.row_weight_dependent)])
    found: Index = np.flatnonzero((np.asarray(involved.sum(axis=0)).ravel() > 0.0) & (spaces.scale > most))
    return found


def _sparse_rank(rows: Any) -> SparseRank:
    from mbstab.analysis.algebra.sparse_rank import sparse_rank

    return sparse_rank(rows)


def along_coordinates(spaces: Subspaces) -> tuple[Subspaces, Array]:
    """Return the same subspaces in bases along coordinates as far as possible, and the basis of the states in them.

    Sums in these bases have no terms that cancel because directions were mixed: motions of different coordinates stay
    apart. Of ẏ = S y in the bases of `spaces`, the matrix in the new ones is Vᵀ S V with the returned V.
    """
    if not isinstance(spaces.C, Rank):
        return spaces, np.eye(spaces.N.shape[1] + spaces.Z.shape[1])
    N, Q = aligned(spaces.N)
    Z, Q_z = aligned(Q.T @ spaces.Z)
    V = np.zeros((len(Q) + len(Q_z), len(Q) + len(Q_z)))
    V[: len(Q), : len(Q)], V[len(Q) :, len(Q) :] = Q, Q_z
    C = replace(spaces.C, null=N)
    W = replace(spaces.W, null=Z, pseudo_inverse=Q.T @ spaces.W.pseudo_inverse)
    return replace(spaces, C=C, W=W), V


def aligned(basis: Array) -> tuple[Array, Array]:
    """Return an orthonormal basis times a rotation, triangular in the rows that are largest, and the rotation.

    QR with column pivoting of its transpose. The squares of what is left of all rows add up to the number of rows still
    to be chosen, so that no digits of the largest one are lost.
    """
    count = basis.shape[1]
    chosen, left, known = list[int](), np.sum(basis * basis, axis=1), np.zeros((count, count))
    for i in range(count):
        chosen.append(int(np.argmax(left)))
        row = basis[chosen[-1]]
        row = row - known[:i].T @ (known[:i] @ row)
        known[i] = row / np.linalg.norm(row)
        left = left - (basis @ known[i]) ** 2
        left[chosen] = -1.0
    turn = np.linalg.qr(basis[chosen].T)[0]
    found = basis @ turn
    return np.where(np.abs(found) > TOLERANCES.aligned_rounding, found, 0.0), turn


def _has_gap(rank: Rank | SparseRank) -> bool:
    """Return whether a rank decision is certain."""
    return bool(rank.smallest_kept >= TOLERANCES.singular_value_kept and rank.gap >= TOLERANCES.rank_gap)


def require_gap(rank: Rank | SparseRank, rows: Sequence[Row]) -> None:
    """Refuse a rank decision without a gap.

    Raises
    ------
    ConstraintError
        Names the rows that nearly depend on each other.
    """
    if _has_gap(rank):
        return
    combination = np.abs(rank.doubtful)
    involved = [str(rows[i]) for i in np.argsort(-combination)[:4] if combination[i] > 0.1]
    raise ConstraintError(
        f"the rank of the constraints cannot be decided: the singular values {rank.smallest_kept:.1e} and "
        f"{rank.largest_dropped:.1e} next to the decision should differ by a factor {TOLERANCES.rank_gap:g}, the first "
        f"above {TOLERANCES.singular_value_kept:g}\n"
        f"the rows that nearly depend on each other: {'; '.join(involved)}\n"
        "hint: the mechanism is close to a singular configuration, or its geometry does not quite fit; move the "
        "reference, correct the geometry, or remove one of these rows"
    )


def repetitions(rank: Rank | SparseRank, rows: Sequence[Row]) -> list[Redundancy]:
    """Return the rows of a decision about sparse ones that earlier rows imply, with these."""
    found = [
        (last, np.flatnonzero(np.abs(x) > TOLERANCES.row_weight_dependent)) for last, x in last_rows(rank.left_null)
    ]
    return [Redundancy(rows[last], tuple(rows[k] for k in used.tolist() if k != last)) for last, used in found]


def redundancies(J: Any, spaces: Subspaces, n_h: int, rows: Sequence[Row]) -> list[Redundancy]:
    """Return the rows that earlier rows imply, with these rows."""
    count = len(spaces.row_scale) - spaces.C.rank - spaces.W.rank
    if count == 0:
        return []
    if is_sparse(J):
        return repetitions(spaces.C, rows)
    unit = scaled(J, spaces.scale, spaces.row_scale)
    found: list[Redundancy] = []
    basis = np.zeros((0, unit.shape[1]))
    kept: list[int] = []
    for i, row in enumerate(unit):
        rest = row - basis.T @ (basis @ row)
        rest = rest - basis.T @ (basis @ rest)
        length = np.linalg.norm(rest)
        # Much coarser than the rank decision, which has shown that a dependence exists.
        if length > 1e-7:
            basis = np.vstack([basis, rest / length])
            kept.append(i)
            continue
        weights = least_squares(unit[kept].T, row, rcond=None) if kept else np.zeros(0)
        found.append(Redundancy(rows[i], tuple(rows[k] for k, w in zip(kept, weights, strict=True) if abs(w) > 1e-7)))
    return found


def fewest(null: Array, groups: Sequence[str]) -> list[int]:
    """Return coordinates, as few as possible, whose values determine all others.

    Parameters
    ----------
    null : ndarray, shape (n, k)
        Basis of the motions that are left.
    groups : sequence of str
        What each coordinate belongs to: those of the first one that moves are chosen, and of these the one that moves
        most, the last of those that move alike (angles follow positions).
    """
    left, found = null.copy(), list[int]()
    for group in dict.fromkeys(groups):
        own = [i for i, name in enumerate(groups) if name == group]
        while left.size:
            lengths = np.linalg.norm(left[own], axis=1)
            k = own[int(np.flatnonzero(lengths >= (1.0 - TOLERANCES.moving_part) * np.max(lengths))[-1])]
            if np.max(lengths) <= TOLERANCES.moving_part * np.linalg.norm(null, axis=1).max():
                break
            found.append(k)
            along = left[k] / np.linalg.norm(left[k])
            left -= np.outer(left @ along, along)
    return found
