"""The linearized equations of a large scene: sparse, in scaled coordinates, without redundant rows.

    Q(s) z = 0,   Q(s) = [[s²M + sR + K, Jᵀ], [[C_q; sD_u + D_q], 0]],   z = [Δq; Δν]

has the finite eigenvalues of the linearized equations; constraints and multipliers are not eliminated.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np

from mbstab.analysis.algebra.inertia import ConstrainedForms
from mbstab.analysis.algebra.shift_invert import SparseQuadratic
from mbstab.analysis.algebra.sparse import scaled
from mbstab.analysis.algebra.sparse_rank import rank_decisions
from mbstab.analysis.algebra.tolerances import EPS
from mbstab.analysis.algebra.tolerances import TOLERANCES as ALGEBRA
from mbstab.analysis.linear.linearize import Linearization
from mbstab.analysis.linear.roundings import roundings
from mbstab.analysis.reference.coefficients import Matrices
from mbstab.analysis.reference.resting import Rest
from mbstab.compiler.system import Array
from mbstab.model.schema import is_length
from mbstab.records import dataclass

LONGEST = 8.0 * float(np.finfo(np.longdouble).eps)
"""Sums vanish to this, relative to the sizes of their terms."""


@dataclass(frozen=True)
class SparseEquations:
    """The linearized equations with sparse matrices.

    Attributes
    ----------
    matrices : Matrices
        M, R, K, J and D_q in scaled coordinates and rows of about unit length, all of them independent.
    terms : Matrices
        Sizes of the terms whose sums are their entries.
    sizes : Matrices
        The same, at least so large that no entry is wrong by more than the rounding of one term of this size.
    lost : Matrices or None
        Rounding errors of these sums.
    displaced : tuple of Matrices
        Changes of all entries together, by the possible rounding of coordinates and multipliers.
    forms : ConstrainedForms
        Forms on the null space of the rows.
    scale : ndarray, shape (n_q,)
        q = scale · scaled q.
    n_h, n_f : int
        Numbers of independent holonomic rows and of finite eigenvalues.
    names : sequence of str
        Coordinates in the order of q.
    """

    matrices: Matrices
    terms: Matrices
    sizes: Matrices
    lost: Matrices | None
    displaced: tuple[Matrices, ...]
    forms: ConstrainedForms
    scale: Array
    n_h: int
    n_f: int
    names: Sequence[str]

    @classmethod
    def of_rest(cls, rest: Rest) -> SparseEquations:
        """Return the equations of a large scene at rest."""
        system, still = rest.system, np.zeros_like(rest.q)
        at = rest.q, still, still, rest.nu, rest.time
        K, R, D_q = system.linearize(*at)
        terms = system.terms(*at)
        lost = system.lost(*at)
        groups = _directions(system.names)
        found = Matrices(rest.dynamics.M, R, K, rest.dynamics.J, D_q)
        kept, nonholonomic = rest.kept, rest.kept[rest.rank_holonomic :] - system.n_h

        def chosen(m: Matrices) -> Matrices:
            columns, rows = rest.scale, rest.row_scale
            M, R, K = (scaled(x, columns, columns) for x in (m.M, m.R, m.K))
            D_q = scaled(m.D_q, columns, rows[system.n_h :])[nonholonomic]
            return Matrices(M, R, K, scaled(m.J, columns, rows)[kept], D_q)

        displaced, spread = tuple(chosen(x) for x in rest.displaced), chosen(_spread(_named(terms), groups))
        sizes = _covering(spread, chosen(rest.errors))
        return cls(
            chosen(found), spread, sizes, chosen(_named(lost)), displaced, rest.forms.known_to(_known(sizes.J)),
            rest.scale, rest.rank_holonomic, rest.n_f, system.names,
        )  # fmt: skip

    @classmethod
    def of_linearization(cls, linear: Linearization) -> SparseEquations:
        """Return the equations of any motion, from dense matrices."""
        from scipy.sparse import csr_array

        spaces, n_h = linear.spaces, linear.n_h
        columns, rows = spaces.scale, spaces.row_scale
        J = linear.J * columns * rows[:, None]
        decisions = rank_decisions(csr_array(J), n_h)
        (C, _), (last, both) = decisions[0], decisions[-1]
        kept = both[last.kept]

        def chosen(m: Matrices) -> Matrices:
            weights = columns * columns[:, None]
            D_q = m.D_q * columns * rows[n_h:, None]
            parts = (m.M * weights, m.R * weights, m.K * weights, (m.J * columns * rows[:, None])[kept])
            return Matrices(*(csr_array(x) for x in (*parts, D_q[kept[C.rank :] - n_h])))

        plain = Matrices(linear.M, linear.R, linear.K, linear.J, linear.D_q)
        known, found = roundings(linear), chosen(plain)
        errors = [sum(parts) for parts in zip(*(map(np.abs, x) for x in (known.errors, *known.displaced)), strict=True)]
        terms = Matrices(*map(abs, found))
        sizes = _covering(terms, chosen(Matrices(*errors)))
        forms = ConstrainedForms(found.J, _known(sizes.J))
        return cls(found, terms, sizes, None, (), forms, columns, C.rank, linear.n_f, linear.names)

    @cached_property
    def problem(self) -> SparseQuadratic:
        """Q(s) without the zero eigenvalues of neutral shifts.

        For each shift z a row zᵀ and a column Q(s)z/s², or Q(s)z/s where R z or D_u z is not zero, are added:
        nonzero eigenvalues do not change.
        """
        return self._composite(self.matrices, self.neutral)

    @cached_property
    def known_to(self) -> SparseQuadratic:
        """Q(|s|) of the sizes of terms."""
        return self._composite(self.sizes, [np.abs(z) for z in self.neutral])

    @cached_property
    def moved(self) -> list[SparseQuadratic]:
        """Changes of Q(s) by the possible rounding of coordinates and multipliers."""
        return [self._composite(x, [0.0 * z for z in self.neutral]) for x in self.displaced]

    @cached_property
    def unsure(self) -> Any:
        """Bounds of the errors of the entries of K, a sparse matrix."""
        moved: Any = 0.0 * self.sizes.K
        for x in self.displaced:
            moved = moved.maximum(abs(x.K))
        return _known(self.sizes.K) + moved

    @cached_property
    def remainder(self) -> SparseQuadratic | None:
        """Q(s) of the rounding errors of the sums."""
        return None if self.lost is None else self._composite(self.lost, [0.0 * z for z in self.neutral])

    @cached_property
    def neutral(self) -> list[Array]:
        """Shifts along which nothing changes, in scaled coordinates: of everything along an axis, of single ones.

        The rounding errors of the sums are included, so that only exact zeros vanish.
        """
        m, lost, sizes = self.matrices, self.lost, self.terms
        blind = np.ones(self.n_q, dtype=bool)
        for x in (m.K, m.J[: self.n_h], m.D_q):
            blind &= np.asarray(abs(x).sum(axis=0)).ravel() == 0.0
        found = [np.eye(1, self.n_q, int(k))[0] for k in np.flatnonzero(blind)]
        for axis in "xyz":
            along = np.array([name.endswith(f".{axis}") for name in self.names])
            if not np.any(along & ~blind):
                continue
            z = np.where(along, 1.0 / self.scale, 0.0)
            parts = [
                (m.K, lost and lost.K, sizes.K),
                (m.J[: self.n_h], lost and lost.J[: self.n_h], sizes.J[: self.n_h]),
                (m.D_q, lost and lost.D_q, sizes.D_q),
            ]
            if all(_vanishes(*part, z) for part in parts):
                found.append(z)
        return found

    @cached_property
    def zeros(self) -> int:
        """Number of zero eigenvalues of neutral shifts: two for each, one where a force or row depends on the speed."""
        return sum(1 if seen else 2 for seen in self._damped)

    @property
    def n_left(self) -> int:
        """Number of finite eigenvalues of `problem`."""
        return self.n_f - self.zeros

    @cached_property
    def _damped(self) -> list[bool]:
        m, lost, sizes, n_h = self.matrices, self.lost, self.terms, self.n_h
        parts = [(m.R, lost and lost.R, sizes.R), (m.J[n_h:], lost and lost.J[n_h:], sizes.J[n_h:])]
        return [not all(_vanishes(*part, z) for part in parts) for z in self.neutral]

    def _composite(self, m: Matrices, shifts: list[Array]) -> SparseQuadratic:
        from scipy.sparse import block_array, coo_array, vstack

        n_h, (c, n) = self.n_h, m.J.shape
        C, D_u = m.J[:n_h], m.J[n_h:]
        Z = np.array(shifts).reshape(len(shifts), n).T
        seen = np.array(self._damped, dtype=bool)
        # Columns of the powers of s, and those of the rows below.
        borders = [m.M @ (Z * ~seen) + m.R @ (Z * seen), m.M @ (Z * seen), 0.0 * Z]
        speeds = [np.vstack([np.zeros((n_h, len(shifts))), x @ (Z * seen)]) for x in (D_u, 0.0 * D_u, 0.0 * D_u)]
        none, rows = coo_array((c, n)), coo_array(Z.T)
        lower = (vstack([C, m.D_q]), vstack([0.0 * C, D_u]), none)
        parts = []
        for k, (upper, right, beside, below) in enumerate(zip((m.K, m.R, m.M), borders, speeds, lower, strict=True)):
            J = m.J if not k else none
            blocks = [
                [upper, J.T, coo_array(right)],
                [below, coo_array((c, c)), coo_array(beside)],
                [rows if not k else 0.0 * rows, None, None],
            ]
            part = block_array(blocks, format="coo")
            part.resize((n + c + len(shifts),) * 2)
            parts.append(part)
        return SparseQuadratic(*parts)

    @cached_property
    def rate(self) -> float:
        """A typical rate of single forces (1/s)."""
        R, K = (float(abs(x).max()) for x in (self.matrices.R, self.matrices.K))
        return max(R, K**0.5) or 1.0

    @cached_property
    def fastest(self) -> float:
        """The size of the largest eigenvalue, to a hundredth or so (1/s)."""
        from scipy.sparse import block_array
        from scipy.sparse.linalg import LinearOperator, eigs, splu

        m, n = self.matrices, self.n_q
        lu = splu(block_array([[m.M, m.J.T], [m.J, None]] if m.J.shape[0] else [[m.M]], format="csc"))

        def once(y: Any) -> Any:
            # Accelerations that all rows allow: drift off the rows does not grow.
            lower = np.zeros((m.J.shape[0], *y.shape[1:]))
            lower[self.n_h :] = -(m.D_q @ y[n:])
            a = lu.solve(np.concatenate([-(m.K @ y[:n] + m.R @ y[n:]), lower]))[:n]
            return np.concatenate([y[n:], a])

        if 2 * n <= ALGEBRA.dense_operator:
            return float(np.max(np.abs(np.linalg.eigvals(once(np.eye(2 * n)))))) or self.rate
        start = once(once(np.random.default_rng(19).normal(size=2 * n)))
        operator = LinearOperator((2 * n, 2 * n), matvec=once, dtype=float)
        found = eigs(operator, 1, v0=start, tol=1e-2, return_eigenvectors=False)
        return float(np.abs(found[0])) or self.rate

    @property
    def n_q(self) -> int:
        """Number of coordinates."""
        return int(self.matrices.J.shape[1])


def _named(terms: dict[str, Any]) -> Matrices:
    return Matrices(terms["M"], terms["R"], terms["K"], terms["J"], terms["D"])


def _covering(terms: Matrices, errors: Matrices) -> Matrices:
    """Return sizes of terms, and where errors are larger than the rounding of one, sizes that cover these."""
    return Matrices(*(x.maximum((1.0 / ALGEBRA.entry_rounding) * e) for x, e in zip(terms, errors, strict=True)))


def _known(sizes: Any) -> Any:
    """Return bounds of the errors of entries from the sizes of their terms."""
    return ALGEBRA.entry_rounding * sizes


def _directions(names: Sequence[str]) -> Any:
    """Return which coordinates are directions of the same body with the same unit, as a matrix of zeros and ones."""
    from scipy.sparse import csr_array

    kinds = [(name.partition(".")[0], is_length(name)) for name in names]
    known: dict[Any, int] = {}
    numbers = [known.setdefault(kind, len(known)) for kind in kinds]
    return csr_array((np.ones(len(kinds)), (np.arange(len(kinds)), numbers)))


def _spread(m: Matrices, groups: Any) -> Matrices:
    """Return sizes of terms that are equal for all directions of a body, as rotated axes mix them."""
    M, R, K = (groups @ _largest(x, groups.indices, groups.indices) @ groups.T for x in (m.M, m.R, m.K))
    J, D_q = (_largest(x, np.arange(x.shape[0]), groups.indices) @ groups.T for x in (m.J, m.D_q))
    return Matrices(M, R, K, J, D_q)


def _largest(matrix: Any, rows: Any, columns: Any) -> Any:
    """Return the largest entries of blocks of a matrix; `rows` and `columns` are the numbers of the blocks."""
    from scipy.sparse import coo_array, csr_array

    entries = coo_array(matrix)
    shape = (int(np.max(rows, initial=-1)) + 1, int(np.max(columns, initial=-1)) + 1)
    keys, place = np.unique(rows[entries.row].astype(np.int64) * shape[1] + columns[entries.col], return_inverse=True)
    found = np.zeros(len(keys))
    np.maximum.at(found, place, np.abs(entries.data))
    return csr_array((found, (keys // max(shape[1], 1), keys % max(shape[1], 1))), shape=shape)


def _vanishes(matrix: Any, lost: Any, sizes: Any, z: Array) -> bool:
    """Return whether a direction is in the null space of a matrix, in the longest floating-point type.

    Where its components are powers of two all products are exact, and so are their sums: a weak spring beside strong
    ones, of which a sum keeps no digit but in what it lost, breaks a symmetry.
    """
    wide = z.astype(np.longdouble)
    image = matrix.astype(np.longdouble) @ wide
    if lost is not None:
        image = image + lost.astype(np.longdouble) @ wide
    if not np.all(np.abs(image) <= LONGEST * (sizes @ np.abs(z))):
        return False
    if lost is None or np.any(np.frexp(z[z != 0.0])[0] != 0.5):
        return True
    parts = [scaled(x.tocsr(), z) for x in (matrix, lost)]
    rounding = EPS * (abs(lost) @ np.abs(z))
    rows = np.flatnonzero(sum(np.diff(x.indptr) for x in parts)).tolist()
    return all(
        abs(math.fsum(v for x in parts for v in x.data[x.indptr[i] : x.indptr[i + 1]].tolist())) <= rounding[i]
        for i in rows
    )
