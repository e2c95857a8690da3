"""Motions without mass: what forces make of them, as rows of the linearized equations.

Let the columns of N₀ span the motions that the constraints allow and that carry no mass, M N₀ = 0. Along them the
linearized equations have no accelerations: N₀ᵀ(R Δu + K Δq) = 0. With R₀ = N₀ᵀ R N₀, G with Gᵀ R₀ = 0 and F with
[F, G] regular, they are rows like those of constraints,

    Gᵀ N₀ᵀ K Δq = 0                           (algebraic: holonomic rows),
    Fᵀ N₀ᵀ R Δu + Fᵀ N₀ᵀ K Δq = 0             (of first order: rows on speeds),

provided that Gᵀ N₀ᵀ R = 0 and that Gᵀ N₀ᵀ K N₀ is regular on the null space of R₀. Then these rows have rank k on the
k columns of N₀, so that their multipliers vanish, and what they leave carries mass: the equations with these rows,
taken as constraints, have exactly the finite eigenvalues of the equations without them, and the infinite ones are
deflated with those of the constraints. Each algebraic direction takes away two of the eigenvalues that a mass would
give it, each direction of first order one.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from mbstab.analysis.algebra.arrays import Flags, Index, norms, others
from mbstab.analysis.algebra.rank import Rank, rank_of
from mbstab.analysis.algebra.stacks import reduced, transposed, under
from mbstab.analysis.algebra.subspaces import Subspaces, coordinate_scale, subspaces
from mbstab.analysis.algebra.tolerances import TOLERANCES as ALGEBRA
from mbstab.analysis.linear.tolerances import TOLERANCES
from mbstab.analysis.reference.coefficients import Matrices
from mbstab.analysis.reference.motion import Motion
from mbstab.analysis.reference.tolerances import TOLERANCES as REFERENCE
from mbstab.compiler.system import Array, Row, System
from mbstab.errors import ConstraintError, MassError
from mbstab.model.schema import is_length, is_state
from mbstab.records import dataclass

HINT = "give it a mass or an inertia, or hold it by a joint, a spring or a damper"


@dataclass(frozen=True)
class Massless:
    """Directions without mass, and the equations with their rows.

    Attributes
    ----------
    algebraic, first_order : ndarray, shape (k, n_q)
        Directions (m, rad) as rows: those that forces determine at every instant, and those with damping.
    exact : bool
        Whether the directions are single coordinates.
    n_h, n_n : int
        Numbers of holonomic and nonholonomic rows of the constraints alone.
    rows : tuple of Row
        All rows: the holonomic ones, the algebraic ones, the nonholonomic ones, those of first order.
    spaces : Subspaces
        What all rows allow.
    accuracy : float
        Accuracy of directions that are computed, relative to their length.
    warnings : tuple of str
        Directions that any mass, however small, would let run away.
    """

    algebraic: Array
    first_order: Array
    exact: bool
    n_h: int
    n_n: int
    rows: tuple[Row, ...]
    spaces: Subspaces
    accuracy: float
    warnings: tuple[str, ...] = ()

    def extended(self, m: Matrices, sizes: bool = False) -> Matrices:
        """Return the matrices with the rows of the directions, for numbers of any type.

        With `sizes` the matrices hold sizes or errors of entries, and so does the result.
        """
        algebraic, first = (np.abs(x) if sizes else x for x in (self.algebraic, self.first_order))
        return _extended(m, self.n_h, algebraic, first)

    def at_points(self, M: Array, R: Array, spaces: Subspaces) -> tuple[Massless, Array, Flags]:
        """Return these directions at points of a sweep, moved into the motions that carry no mass there.

        Parameters
        ----------
        M, R : ndarray, shape (points, n_q, n_q)
            In scaled coordinates.
        spaces : Subspaces
            What the constraints allow.

        Returns
        -------
        massless : Massless
        basis : ndarray, shape (points, n_q, k)
            The motions without mass.
        good : ndarray of bool, shape (points,)
            Where there are as many of them as here, and nothing damps those that are algebraic.
        """
        units, allowed = np.vstack([self.algebraic, self.first_order]) / spaces.scale[..., None, :], spaces.allowed
        basis = transposed(units) / norms(transposed(units), -2, keepdims=True)
        if self.exact:
            # The same coordinates carry no mass, and no constraint holds them.
            outside = basis - allowed @ (transposed(allowed) @ basis)
            good: Flags = np.max(np.abs(outside), axis=(-2, -1)) <= ALGEBRA.singular_value_zero
            good = good & ~np.any(M @ basis, axis=(-2, -1))
            moved = transposed(basis)
        else:
            values, vectors = np.linalg.eigh(reduced(M, allowed))
            least = np.maximum(REFERENCE.massless * values[:, -1], REFERENCE.rounding_of_mass)
            heavy = values > least[:, None]
            good = np.sum(~heavy, axis=1) == basis.shape[-1]
            good &= np.min(values, axis=1, initial=np.inf, where=heavy) > ALGEBRA.rank_gap * least
            own = allowed @ vectors[:, :, : basis.shape[-1]]
            moved, basis = transposed(basis) @ own @ transposed(own), own
        algebraic, first = moved[:, : len(self.algebraic)], moved[:, len(self.algebraic) :]
        algebraic = algebraic - algebraic @ R @ basis @ np.linalg.pinv(first @ R @ basis) @ first
        sizes = np.abs(algebraic) @ np.abs(R)
        damped = np.abs(algebraic @ R) > TOLERANCES.balance_zero * np.max(sizes, initial=0.0)
        scale = spaces.scale[..., None, :]
        result = replace(self, algebraic=algebraic * scale, first_order=first * scale)
        return result, basis, good & ~np.any(damped, axis=(-2, -1))

    def with_roundings(self, errors: Matrices, sizes: Matrices) -> Matrices:
        """Return the errors of all rows with those of directions that are computed, for sizes of M, R, K, J and D_q."""
        scale, n = self.spaces.scale, self.n_h + len(self.algebraic)
        J, D_q = errors.J.copy(), errors.D_q.copy()
        for directions, into, A in (
            (self.algebraic, J[self.n_h : n], sizes.K),
            (self.first_order, J[n + self.n_n :], sizes.R),
            (self.first_order, D_q[self.n_n :], sizes.K),
        ):
            lengths = np.linalg.norm(directions / scale, axis=1)[:, None]
            into += self.accuracy * lengths * (scale @ A)
        return errors._replace(J=J, D_q=D_q)

    def padded(self, nu: Array) -> Array:
        """Return multipliers, or slopes by them along the last axis, for all rows: those of the directions are zero."""
        zeros = (np.zeros((*nu.shape[:-1], len(x))) for x in (self.algebraic, self.first_order))
        return np.concatenate([nu[..., : self.n_h], next(zeros), nu[..., self.n_h :], next(zeros)], axis=-1)

    def with_signals(self, rows: Array, f: Array) -> Array:
        """Return what inputs add to all rows, from what they add to those of the constraints and to the forces."""
        parts = rows[: self.n_h], self.algebraic @ f, rows[self.n_h :], self.first_order @ f
        return np.concatenate(parts)

    def right_inverse(self, J: Array, of_constraints: Array, directions: Array) -> Array:
        """Return X with J X = 1 for all rows J, where only motions without mass answer the rows of the directions.

        Parameters
        ----------
        J : ndarray, shape (n_c, n_q)
        of_constraints : ndarray, shape (n_q, n_h + n_n)
            A right inverse of the rows of the constraints.
        directions : ndarray, shape (n_q, k)
            The motions without mass that the constraints allow, in the coordinates of J.
        """
        own, rest = self.own, others(len(J), self.own)
        X = np.zeros(J.T.shape)
        X[:, rest], X[:, own] = of_constraints, np.linalg.solve((J[own] @ directions).T, directions.T).T
        X[:, rest] -= X[:, own] @ (J[own] @ of_constraints)
        return X

    @property
    def own(self) -> Index:
        """Numbers of the rows of the directions."""
        n = self.n_h + len(self.algebraic)
        return np.array([*range(self.n_h, n), *range(n + self.n_n, len(self.rows))], dtype=np.intp)

    @property
    def names(self) -> tuple[str, ...]:
        """What the rows of the directions are, in words."""
        kinds = ["algebraic"] * len(self.algebraic) + ["of first order"] * len(self.first_order)
        told = zip([self.rows[i] for i in self.own], kinds, strict=True)
        return tuple(f"{row.name}: {row.label}, {kind}" for row, kind in told)


def _extended(m: Matrices, n_h: int, algebraic: Array, first: Array) -> Matrices:
    J = under(m.J[..., :n_h, :], _times(algebraic, m.K), m.J[..., n_h:, :], _times(first, m.R))
    return m._replace(J=J, D_q=under(m.D_q, _times(first, m.K)))


def _times(directions: Array, A: Any) -> Any:
    """Return the products of rows with a matrix; in a single one zeros do not count, whatever its numbers are."""
    if directions.ndim > 2:
        return directions @ A
    rows = []
    for d in directions:
        terms = [A[i] if d[i] == 1.0 else d[i] * A[i] for i in np.flatnonzero(d)]
        rows.append(sum(terms[1:], terms[0]))
    return np.array(rows, dtype=A.dtype).reshape(-1, A.shape[1])


def massless(system: System, motion: Motion, matrices: Matrices, terms: Matrices, steady: bool) -> Massless:
    """Return the directions without mass of a reference, which has some, and their rows.

    Parameters
    ----------
    matrices, terms : Matrices
        Coefficients in the co-moving frame, and the sizes of the terms of which they are sums.
    steady : bool
        Whether a symmetry maps the reference to the motion at later times.

    Raises
    ------
    MassError
        If nothing determines one of them, or not yet in a way that is known here; names body and coordinate.
    ConstraintError
        If a rank decision has no gap.
    """
    return _Decision(system, motion, matrices, terms).found(steady)


class _Decision:
    """Which of the directions without mass are algebraic, and which of first order."""

    def __init__(self, system: System, motion: Motion, matrices: Matrices, terms: Matrices) -> None:
        assert motion.massless is not None
        self.system, self.motion, self.matrices, self.terms = system, motion, matrices, terms
        scale, N = motion.spaces.scale, motion.spaces.N
        alone = [
            i
            for i in np.flatnonzero(motion.massless.any(axis=1))
            if not np.any(matrices.M[i]) and not np.any(matrices.J[:, i])
        ]
        self.exact = len(alone) == motion.massless.shape[1]
        # In scaled coordinates, as rows.
        self.basis = np.eye(system.n_q)[alone] if self.exact else motion.massless.T
        R, K = (x * scale * scale[:, None] for x in (matrices.R, matrices.K))
        self.R, self.forces = self.basis @ R @ N, np.vstack([R, K])
        self.R_0, self.K_0 = self.basis @ R @ self.basis.T, self.basis @ K @ self.basis.T
        R_size, K_size = (x * scale * scale[:, None] for x in (terms.R, terms.K))
        self.force_sizes = np.vstack([R_size, K_size])
        self.sizes = tuple(np.linalg.norm(np.abs(self.basis) @ x @ np.abs(N), axis=1) for x in (R_size, K_size))

    def found(self, steady: bool) -> Massless:
        """Return the directions with their rows."""
        self._refuse_motion(steady)
        first, algebraic, loose = self._by_damping()
        self._check_determined(algebraic, loose)
        system, motion, m, n_h = self.system, self.motion, self.matrices, self.system.n_h
        a, f = (self._in_coordinates(x) for x in (algebraic, first))
        all_ = _extended(m, n_h, a, f)
        rows = (*system.rows[:n_h], *map(self._row, a), *system.rows[n_h:], *map(self._row, f))
        sizes = _extended(self.terms, n_h, np.abs(a), np.abs(f)).J
        # What is rounding of a sum must not scale a coordinate.
        J = np.where(np.abs(all_.J) > TOLERANCES.row_rounding * sizes, all_.J, 0.0)
        scale = coordinate_scale(m.M, motion.sizes, J, n_h)
        spaces = subspaces(m.M, all_.J, n_h + len(a), rows, motion.sizes, scale)
        values = np.linalg.eigvalsh(spaces.allowed.T @ (m.M * scale * scale[:, None]) @ spaces.allowed)
        if len(values) and not values[0] > REFERENCE.massless * values[-1]:
            self._refuse(self.basis[0], "forces do not determine it, to the digits of double precision", HINT)
        exact = self.exact and all(np.count_nonzero(x) == 1 for x in (*a, *f))
        accuracy, warnings = TOLERANCES.direction_rounding / self.least, tuple(self._running_away(len(first), loose))
        return Massless(a, f, exact, n_h, system.n_n, rows, spaces, accuracy, warnings)

    def _running_away(self, damped: int, loose: Array) -> Iterator[str]:
        """Yield warnings about directions in which forces push instead of hold.

        With a mass ε → 0 there would be eigenvalues −r/ε of the damping, and ±√(−k/ε) of the stiffness that it leaves.
        """
        stiffness = loose.T @ self.K_0 @ loose
        for what, A, basis, count in (
            ("damping", self.R_0, self.basis, damped),
            ("stiffness", stiffness, loose.T @ self.basis, len(stiffness)),
        ):
            values, vectors = np.linalg.eig(A)
            for i in np.argsort(-np.abs(values), kind="stable")[:count].tolist():
                across = abs(values[i].imag) > TOLERANCES.pushing_part * abs(values[i])
                if values[i].real < 0.0 or (across and what == "stiffness"):
                    names = ", ".join(self._involved(np.abs(vectors[:, i] @ basis)))
                    yield (
                        f"{names}: no mass, and forces that push away instead of holding (the {what} there is not "
                        "positive); the answer is for no mass at all: with any, however small, this would run away"
                    )

    def _refuse_motion(self, steady: bool) -> None:
        """Refuse what is not known yet: functions of time, and references along which its balance changes."""
        system, motion, hint = self.system, self.motion, HINT.partition(",")[0]
        if system.scene.timed:
            self._refuse(self.basis[0], "under functions of time its motion is not determined yet", hint)
        if motion.at_rest or steady:
            return
        state = np.concatenate([motion.a, motion.u]) / np.tile(motion.spaces.scale, 2)
        slopes, sizes = (np.hstack(np.vsplit(x, 2)) for x in (self.forces, self.force_sizes))
        for direction in self.basis:
            size = TOLERANCES.balance_zero * (np.abs(direction) @ sizes @ np.abs(state))
            if not abs(direction @ slopes @ state) <= size:
                what = "the forces on it change along the reference, so that its motion is not determined yet"
                self._refuse(direction, what, hint)

    def _by_damping(self) -> tuple[Array, Array, Array]:
        """Return F and G as rows of combinations of the basis, and the motions that no damping sees, as columns.

        F are single elements of the basis, the most independent ones; each row of G is one of the others, with what
        undoes its damping. Elements that differ much in size are not mixed.
        """
        from scipy.linalg import qr

        unit, n = _unit(self.R_0, self.sizes[0]), len(self.R_0)
        damping = self._rank(unit, "damping", self.basis)
        self.least = min(damping.smallest_kept, 1.0)
        order = qr(unit.T, mode="r", pivoting=True)[1]
        first, others = np.sort(order[: damping.rank]), np.sort(order[damping.rank :])
        combinations = np.eye(n)[others]
        if damping.rank:
            # By elimination, which keeps the digits of weak dampers beside strong ones.
            columns = qr(unit[first], mode="r", pivoting=True)[1][: damping.rank]
            undone = np.linalg.solve(self.R_0[np.ix_(first, columns)].T, self.R_0[np.ix_(others, columns)].T).T
            lengths = np.linalg.norm(self.R_0, axis=1)
            known = TOLERANCES.balance_zero * lengths[others][:, None] / lengths[first]
            combinations[:, first] = np.where(np.abs(undone) > known, -undone, 0.0)
        for c in combinations:
            if np.linalg.norm(c @ self.R) > TOLERANCES.balance_zero * (np.abs(c) @ self.sizes[0]):
                what = "a force on it depends on speeds of other bodies, and nothing damps its own motion"
                self._refuse(c @ self.basis, f"{what}: such motions are not determined yet", HINT)
        return np.eye(n)[first], combinations, damping.null

    def _check_determined(self, algebraic: Array, loose: Array) -> None:
        """Refuse algebraic directions that forces do not determine."""
        stiffness = _unit(algebraic @ self.K_0, np.abs(algebraic) @ self.sizes[1]) @ loose
        found = self._rank(stiffness, "stiffness", algebraic @ self.basis)
        if found.rank == len(algebraic):
            return
        direction = loose @ found.null[:, 0] @ self.basis
        size = TOLERANCES.balance_zero * (self.force_sizes @ np.abs(direction))
        what = "its own stiffness vanishes, so that forces do not determine it"
        if np.all(np.abs(self.forces @ direction) <= size):
            what = "no force depends on it: nothing determines it"
        self._refuse(direction, what, HINT)

    def _in_coordinates(self, combinations: Array) -> Array:
        """Return directions (m, rad); those along one coordinate have the component 1 there."""
        scaled = combinations @ self.basis
        # What is rounding of a direction is no part of it: beside nothing else it would scale a coordinate.
        known = TOLERANCES.direction_rounding * np.linalg.norm(scaled, axis=1, keepdims=True)
        found = np.where(np.abs(scaled) > known, scaled, 0.0) * self.motion.spaces.scale
        if len(found):
            found /= np.max(np.abs(found), axis=1)[:, None]
        return found

    def _row(self, direction: Array) -> Row:
        """Return what stands for the balance along a direction in messages."""
        name = self.system.names[int(np.argmax(np.abs(direction) / self.motion.sizes))]
        body = name.partition(".")[0]
        unit = "N" if is_length(name) else "N*m"
        return Row("directions", body, f"balance along {name}", unit, self._location(body))

    def _location(self, body: str) -> Any:
        bodies = self.system.scene.bodies
        return next((b.location for b in bodies if b.name == body), bodies[0].location)

    def _refuse(self, direction: Array, what: str, hint: str) -> None:
        """Refuse a motion without mass, by body, coordinates and place in the file."""
        involved = self._involved(direction)
        body = involved[0].partition(".")[0]
        message = f"the motion of {', '.join(involved)} carries no mass, and {what}"
        problem = self.system.scene.model.document.problem
        raise MassError(str(problem(self._location(body), f"bodies.{body}", message, hint)))

    def _involved(self, direction: Array) -> list[str]:
        """Return the coordinates of bodies that change most along a direction."""
        size = np.abs(direction) * self.motion.spaces.scale / self.motion.sizes
        names = self.system.names
        # States may go along with a body; they never have a mass.
        size[[is_state(name) for name in names]] = 0.0
        return [names[i] for i in np.argsort(-size, kind="stable") if size[i] > 0.3 * size.max()][:4]

    def _rank(self, A: Array, what: str, directions: Array) -> Rank:
        """Return the rank of rows of unit length, which belong to directions; refuse it without a gap."""
        found = rank_of(A)
        if found.smallest_kept >= ALGEBRA.singular_value_kept and found.gap >= ALGEBRA.rank_gap:
            return found
        size = np.abs(found.doubtful @ directions)
        names = [self.system.names[i] for i in np.argsort(-size, kind="stable")[:4] if size[i] > 0.1 * size.max()]
        raise ConstraintError(
            f"the rank of the {what} of motions without mass cannot be decided ({', '.join(names)}): the singular "
            f"values {found.smallest_kept:.1e} and {found.largest_dropped:.1e} next to the decision should differ by a "
            f"factor {ALGEBRA.rank_gap:g}, the first above {ALGEBRA.singular_value_kept:g}\n"
            "hint: springs or dampers in series are too far apart in size; leave out what is as good as rigid or absent"
        )


def _unit(A: Array, sizes: Array) -> Array:
    """Return a matrix with rows of unit length, and zeros where they are rounding of terms of given sizes."""
    lengths = np.linalg.norm(A, axis=1)
    counts = lengths > TOLERANCES.balance_zero * sizes
    result: Array = np.where(counts, 1.0 / np.where(counts, lengths, 1.0), 0.0)[:, None] * A
    return result
