"""The equations of equilibria and steady motions, and their exact derivatives, at one point or all points of a sweep.

The unknowns are the coordinates q, the rates c of a generator X(q; c) that are not given, and the
multipliers ν. With u = X and a = DX X,

    M a + F0 + Jᵀν = 0,   C(q, t) = 0,   V(q, X, t) = 0,   X_i = given rates;

at rest V = 0 is needed for first-order states only.

The derivative of the first row by q is the stiffness matrix of the co-moving frame,
K + R Ξ + M Ξ₂. Rows and unknowns are scaled by the size of the scene, its energy and its speed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from mbstab.analysis.algebra.arrays import Index, norms, others
from mbstab.analysis.algebra.augmented import least_multipliers
from mbstab.analysis.algebra.deflation import in_frame
from mbstab.analysis.algebra.rank import rank_of
from mbstab.analysis.algebra.subspaces import aligned
from mbstab.analysis.reference.steady import Family, Generator, declared_family
from mbstab.analysis.reference.tolerances import TOLERANCES
from mbstab.compiler.system import Array, Dynamics, System
from mbstab.model.schema import is_length
from mbstab.records import dataclass

if TYPE_CHECKING:
    import numpy.typing as npt


@dataclass(frozen=True)
class State:
    """A trial: unknowns, residuals and what is needed for a step; leading axes run over the points of a sweep."""

    q: Array
    c: Array
    nu: Array
    residual: Array
    steady: Generator
    u: Array
    a: Array
    dynamics: Dynamics
    M: Array
    J: Array

    @property
    def size(self) -> float:
        """Norm of the residuals."""
        return float(np.linalg.norm(self.residual))


class LinearBalance:
    """The linear equations of a small change of the motion: the rows, and the forces along what these allow.

    Multipliers come last. Taken together with the forces, rows that nearly repeat others would be lost in the
    rounding of large multipliers, and soft motions beside stiff ones.

    Parameters
    ----------
    G : ndarray, shape (m, n)
        The derivative of the residuals, scaled.
    n_q : int
        Number of forces, the first rows.
    moving : int
        Number of unknowns but multipliers, the first columns.
    least : float
        Motions count as undetermined if rows and forces change by less along them.
    """

    def __init__(self, G: Array, n_q: int, moving: int, least: float = TOLERANCES.newton_left_out) -> None:
        self.least, self.forces = least, G[:n_q, :moving]
        self.rows = rank_of(G[n_q:, :moving], least)
        self.allowed = aligned(self.rows.null)[0]
        self.lengths = norms(G[:n_q, moving:].T)
        self.carried = rank_of(G[:n_q, moving:].T / self.lengths[:, None])
        self.free = aligned(self.carried.null)[0]

    @cached_property
    def _decided(self) -> tuple[Array, Array, Array, Array]:
        """Return the inverse of the forces along what is allowed, and what they leave open on either side."""
        inner = self.free.T @ self.forces @ self.allowed
        terms = np.abs(self.free.T) @ np.abs(self.forces) @ np.abs(self.allowed)
        rows = np.maximum(np.max(terms, axis=1, initial=0.0), 1.0)
        scaled = rank_of(inner / rows[:, None], self.least)
        return scaled.pseudo_inverse / rows, scaled.null, scaled.left_null, rows

    @property
    def loose(self) -> Array:
        """Orthonormal changes of coordinates and rates that keep the balance, as columns."""
        found: Array = self.allowed @ self._decided[1]
        return found

    @property
    def unmoved(self) -> Array:
        """Combinations of forces that no change brings into balance, as columns."""
        _, _, left, rows = self._decided
        mixed = self.free @ (left / rows[:, None])
        found: Array = mixed / np.maximum(np.linalg.norm(mixed, axis=0), 1e-300)
        return found

    @cached_property
    def inverse(self) -> Array:
        """The change of minimum norm that takes residuals away is minus this times them, shape (moving, m)."""
        along = self.allowed @ self._decided[0] @ self.free.T
        return np.hstack([along, self.rows.pseudo_inverse - along @ self.forces @ self.rows.pseudo_inverse])

    @property
    def inverse_of_all(self) -> Array:
        """The same for the multipliers as well, shape (n, m)."""
        return -np.stack([self.step(row) for row in np.eye(self.inverse.shape[1])], axis=1)

    def step(self, residual: Array) -> Array:
        """Return the change of all unknowns that takes residuals away, as far as one does; nan if there is none."""
        n = len(self.forces)
        first = -self.rows.pseudo_inverse @ residual[n:]
        along = self.free.T @ (residual[:n] + self.forces @ first)
        moved = first - self.allowed @ (self._decided[0] @ along)
        nu = -self.carried.pseudo_inverse.T @ (residual[:n] + self.forces @ moved)
        return np.concatenate([moved, nu / self.lengths])

    def stiff_step(self, residual: Array) -> Array | None:
        """Return the part of a step along which forces change much more than along the rest; None if there is none.

        The two parts are divided where the singular values of the forces along what is allowed have their widest gap.
        """
        n = len(self.forces)
        left, s, right = np.linalg.svd(self.free.T @ self.forces @ self.allowed)
        if len(s) < 2 or s[0] == 0.0:
            return None
        drops = s[:-1] / np.maximum(s[1:], np.finfo(float).tiny)
        k = int(np.argmax(drops)) + 1
        if drops[k - 1] < TOLERANCES.valley_gap:
            return None
        first = -self.rows.pseudo_inverse @ residual[n:]
        along = self.free.T @ (residual[:n] + self.forces @ first)
        moved = first - self.allowed @ (right[:k].T @ (left[:, :k].T @ along / s[:k]))
        return np.concatenate([moved, np.zeros(len(self.lengths))])

    def nearer(self, step: Array, residual: Array) -> bool:
        """Return whether a step led nearer to a solution: the residual after it asks for one of half its length.

        Unlike the sizes of residuals that does not depend on how equations are combined (the natural monotonicity test;
        Deuflhard 2004, Newton Methods for Nonlinear Problems, section 3.3). Near singular configurations, where
        multipliers are large, residuals may grow on the way to a solution.
        """
        moving = self.forces.shape[1]
        lengths = [float(np.max(np.abs(x[:moving]), initial=0.0)) for x in (step, self.step(residual))]
        return lengths[1] <= 0.5 * lengths[0]


class Balance:
    """The equations of a scene and a family of motions.

    Attributes
    ----------
    sizes : ndarray, shape (n_q,)
        Characteristic size of each coordinate.
    open : ndarray of int
        Coordinates that may change.
    free : list of int
        Coefficients that are not given.
    rows : ndarray of int
        Constraint rows that are used: of redundant ones one is enough.
    energy, speed : float
        Scales by which residuals are judged.
    row_speeds : ndarray, shape (n_c,)
        The same for the speed of each row.
    ramp : float
        Fraction of the given rates: 1 except during spin-up.
    acting : ndarray, shape (n_q,)
        1 for forces that must balance, 0 for those that something else takes.
    """

    def __init__(
        self,
        system: System,
        sizes: Array,
        family: Family,
        known: Mapping[int, Any],
        held: npt.NDArray[np.bool_],
        rows: Index | None = None,
    ) -> None:
        self.system, self.sizes, self.family, self.known = system, sizes, family, dict(known)
        self.open = np.flatnonzero(~held)
        self.free = [k for k in range(family.size) if k not in self.known]
        self.energy = self.speed = self.ramp = 1.0
        self.row_speeds, self.acting = np.ones(system.n_c), np.ones(system.n_q)
        rates = system.scene.rates if family.size else {}
        self.given = np.array([i for i, name in enumerate(system.names) if name in rates], dtype=np.intp)
        values = [np.asarray(rates[system.names[i]], dtype=float) for i in self.given]
        self.rates = np.stack(np.broadcast_arrays(*values), axis=-1) if values else np.zeros(0)
        self.use(np.arange(system.n_c) if rows is None else rows)

    def over(self, system: System) -> Balance:
        """Return the same equations with other values of parameters, such as arrays of them."""
        family, known = declared_family(system)
        held = np.ones(system.n_q, dtype=bool)
        held[self.open] = False
        result = Balance(system, self.sizes, replace(family, columns=self.family.columns), known, held, self.rows)
        result.energy, result.speed, result.row_speeds = self.energy, self.speed, self.row_speeds
        return result

    def measured_by(self, energy: float, speed: float, q: Array, u: Array, a: Array) -> None:
        """Set the scales by which residuals are judged; those of first-order states from their couplings at a motion.

        A state is in any unit, and its rate may be as fast as any lag: their sizes make 1 the largest entry of each
        row and each column of a state.
        """
        self.energy, self.speed, self.row_speeds = energy, speed, np.full(self.system.n_c, speed)
        states, rows = self.system.states
        if not len(states):
            return
        K, _, D_q = self.system.linearize(q, u, a, np.zeros(self.system.n_c))
        J = self.system.dynamics(q, u).J
        forces, D_q = np.abs(K[:, states]), np.abs(D_q[rows - self.system.n_h])
        sizes = self.sizes.copy()
        for _ in range(TOLERANCES.balancing_steps):
            rates = _largest(D_q * sizes, 1, 1.0)
            parts = np.vstack([forces * (sizes / energy)[:, None], D_q[:, states] / rates[:, None]])
            sizes[states] = 1.0 / _largest(parts, 0, 1.0 / sizes[states])
        self.sizes = sizes
        self.row_speeds[rows] = _largest(D_q * sizes, 1, speed) / self.lengths(J[rows])

    def completed(self, q: Array) -> Array:
        """Return coordinates with the given ones put in."""
        q = q.copy()
        for i in others(self.system.n_q, self.open):
            q[..., i] = self.system.scene.coordinates.get(self.system.names[i], q[..., i])
        return q

    def use(self, rows: Index) -> None:
        """Use only these constraint rows."""
        self.rows = rows
        self.n_h = int(np.sum(rows < self.system.n_h))

    def independent_rows(self, q: Array) -> Index:
        """Return rows that are independent at an assembled start: redundant ones would contradict them away from it."""
        system = self.system
        state = system.bodily.dynamics(q, np.zeros(system.n_q))
        J = state.J * self.sizes
        lengths = self.lengths(state.J)
        if np.max(np.abs(state.E[: system.n_h] / lengths[: system.n_h]), initial=0.0) > TOLERANCES.residual:
            return np.arange(system.n_c)
        # Each first-order state has a row of its own.
        bodily = others(system.n_c, system.states[1])
        left, s, _ = np.linalg.svd(J[bodily] / lengths[bodily, None])
        dependences = left[:, int(np.sum(s > TOLERANCES.row_independent_part)) :]
        kept = np.ones(len(bodily), dtype=bool)
        for _ in range(dependences.shape[1]):
            # Without the row of largest weight in a dependence, the others are as independent as can be.
            weights = np.where(kept, np.linalg.norm(dependences, axis=1), 0.0)
            row = int(np.argmax(weights))
            kept[row] = False
            direction = dependences[row] / weights[row]
            dependences = dependences - np.outer(dependences @ direction, direction)
        return np.sort(np.concatenate([bodily[kept], system.states[1]]))

    def coefficients(self, c: Array) -> Array:
        """Return the coefficients with the given ones put in."""
        full = c.copy()
        for k, value in self.known.items():
            full[..., k] = self.ramp * value
        return full

    def state(self, q: Array, c: Array) -> State:
        """Return a trial state with the multipliers that balance it best.

        Parameters
        ----------
        q : ndarray, shape (…, n_q)
        c : ndarray, shape (…, size of the family)

        Raises
        ------
        MbstabError, ArithmeticError, ValueError
            If the equations of a single point have no value there.
        """
        system, n_h = self.system, self.n_h
        full = self.coefficients(c)
        steady = self.family.generator(full)
        u, a = steady.field(q), steady.acceleration(q)
        dynamics = system.dynamics(q, u)
        M, J = dynamics.M, dynamics.J[..., self.rows, :]
        E, V = dynamics.E[..., self.rows], dynamics.V[..., self.rows]
        weights = self.acting * self.sizes
        force = ((M @ a[..., None])[..., 0] + dynamics.F0) * weights / self.energy
        lengths = self.lengths(J)
        if self.ramp < 1.0:
            # The given rates of drives are scaled by the ramp.
            V = V - (1.0 - self.ramp) * system.bodily.dynamics(q, 0.0 * u).V[..., self.rows]
        rows = self._pushing(J) * weights / lengths[..., None]
        nu = -least_multipliers(rows, force)
        parts = [force + (np.swapaxes(rows, -1, -2) @ nu[..., None])[..., 0], E[..., :n_h] / lengths[..., :n_h]]
        if self.with_speeds:
            parts += [
                V / (lengths * self.row_speeds[self.rows]),
                (u[..., self.given] - self.ramp * self.rates) / (self.sizes[self.given] * self.speed),
            ]
        all_nu = np.zeros((*nu.shape[:-1], system.n_c))
        all_nu[..., self.rows] = nu * self.energy / lengths
        return State(q, full, all_nu, joined(parts, 1), steady, u, a, dynamics, M, J)

    def _pushing(self, J: Array) -> Array:
        """Return the rows as they act on the coordinates: those of first-order states take no force."""
        states = np.isin(self.rows, self.system.states[1])
        return np.where(states[:, None], 0.0, J) if states.any() else J

    def unconstrained(self, J: Array) -> Array:
        """Return the forces that no row carries, scaled: orthonormal columns."""
        rows = self._pushing(J) * self.acting * self.sizes
        return rank_of(rows / np.maximum(norms(rows), 1e-300)[:, None]).null

    def lengths(self, J: Array) -> Array:
        """Return the lengths of rows in units of the characteristic sizes; 1 for rows of zeros."""
        return norms(J * self.sizes)

    @property
    def with_speeds(self) -> bool:
        """Whether the rows of the speeds say something: on a motion, and where states must come to rest."""
        return bool(self.family.size or self.system.scene.model.states)

    @property
    def moving(self) -> int:
        """Number of unknowns before the multipliers."""
        return len(self.open) + len(self.free)

    def distances(self, q: Array) -> Array:
        """Return how far from the axis of a motion each unknown but multipliers is, scaled, at least 1, (…, moving).

        Equations there change over lengths of that size: on a wide turn a place may change by more than the scene.
        """
        far = np.ones((*q.shape[:-1], self.moving))
        if self.family.size:
            far[..., : len(self.open)] = np.where(
                [is_length(self.system.names[i]) for i in self.open],
                np.maximum(np.abs(q[..., self.open]) / self.sizes[self.open], 1.0),
                1.0,
            )
        return far

    def jacobian(self, at: State) -> Array:
        """Return the derivative of the residuals by [Δq; Δc; Δν], scaled."""
        system, n_h = self.system, self.n_h
        K, R, _ = system.linearize(at.q, at.u, at.a, at.nu)
        M, J = at.M, at.J
        lengths = self.lengths(J)
        Xi, Xi_2 = at.steady.frame(at.q)
        units = [self.family.units()[k] for k in self.free]
        none = np.zeros((*at.q.shape, 0))
        X = np.stack([unit.field(at.q) for unit in units], axis=-1) if units else none
        # a = DX X is quadratic in the rates.
        A = np.concatenate([Xi @ X, *[unit.frame(at.q)[0] @ at.u[..., None] for unit in units]], axis=-1)
        A = A[..., : len(units)] + A[..., len(units) :]
        weights, columns = (self.acting * self.sizes / self.energy)[:, None], self.sizes[self.open]
        c, n_c = len(units), J.shape[-2]
        V_q = system.linearize_rows(at.q, at.u, at.a)[0][..., self.rows, :] if self.with_speeds else 0.0 * J
        _, stiffness, turned = in_frame(M, R, K, J, V_q, Xi, Xi_2)
        blocks = [
            joined(
                [
                    stiffness[..., self.open] * columns * weights,
                    (R @ X + M @ A) * self.speed * weights,
                    np.swapaxes(self._pushing(J) * (self.energy / lengths)[..., None], -1, -2) * weights,
                ],
                2,
            ),
            joined(
                [
                    J[..., :n_h, self.open] * columns / lengths[..., :n_h, None],
                    np.zeros((n_h, c)),
                    np.zeros((n_h, n_c)),
                ],
                2,
            ),
        ]
        if self.with_speeds:
            rows = (lengths * self.row_speeds[self.rows])[..., None]
            blocks.append(
                joined([turned[..., self.open] * columns / rows, J @ X * self.speed / rows, np.zeros((n_c, n_c))], 2)
            )
            rows = (self.sizes[self.given] * self.speed)[:, None]
            follow = Xi[..., self.given[:, None], self.open] * columns / rows
            count = len(self.given)
            blocks.append(joined([follow, X[..., self.given, :] * self.speed / rows, np.zeros((count, n_c))], 2))
        return joined(blocks, 2, axis=-2)

    def equations(self, at: State, least: float = TOLERANCES.newton_left_out) -> LinearBalance:
        """Return the linear equations of a small change."""
        return LinearBalance(self.jacobian(at), self.system.n_q, self.moving, least)

    def moved(self, at: State, step: Array) -> tuple[Array, Array]:
        """Return coordinates and coefficients after a scaled step."""
        return self.shifted(at.q, at.c, step)

    def shifted(self, q: Array, c: Array, step: Array) -> tuple[Array, Array]:
        """Return given coordinates and coefficients after a scaled step."""
        q, c = q.copy(), c.copy()
        q[..., self.open] += step[..., : len(self.open)] * self.sizes[self.open]
        c[..., self.free] += step[..., len(self.open) : self.moving] * self.speed
        return q, c


def _largest(A: Array, axis: int, otherwise: Array | float) -> Array:
    """Return the largest entries along an axis, another number where there is none or it has no value."""
    found = np.max(A, axis=axis, initial=0.0)
    return np.where(np.isfinite(found) & (found > 0.0), found, otherwise)


def joined(parts: list[Array], core: int, axis: int = -1) -> Array:
    """Return arrays joined along an axis; axes before the last `core` ones broadcast."""
    front = np.broadcast_shapes(*(x.shape[: x.ndim - core] for x in parts))
    return np.concatenate([np.broadcast_to(x, (*front, *x.shape[x.ndim - core :])) for x in parts], axis=axis)
