"""The linearized equations at many points of a sweep at once, by broadcasting in kernels and linear algebra.

One point is computed in full: its ranks, the frame of its motion and its symmetries are the
pattern. Every other point must have the same pattern, which is checked. Arrays have a first axis
for the points, of length 1 where all points agree.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import field, replace

import numpy as np

from mbstab.analysis.algebra.arrays import Flags, Index, norms
from mbstab.analysis.algebra.deflation import balanced, deflated_matrix, in_frame, time_scale
from mbstab.analysis.algebra.rank import inverse_of_part
from mbstab.analysis.algebra.stacks import frobenius, transposed
from mbstab.analysis.algebra.subspaces import Subspaces
from mbstab.analysis.algebra.tolerances import EPS
from mbstab.analysis.algebra.tolerances import TOLERANCES as ALGEBRA
from mbstab.analysis.linear.linearize import Linearization
from mbstab.analysis.reference.equations import Balance
from mbstab.analysis.reference.imbalance import carrying, state_rounding
from mbstab.analysis.reference.many_points import polished
from mbstab.analysis.reference.steady import Family, Generator, spins_freely
from mbstab.analysis.reference.tolerances import TOLERANCES as REFERENCE
from mbstab.analysis.sweep.batched_massless import Light
from mbstab.analysis.sweep.batched_structure import Known
from mbstab.analysis.sweep.cancellation import Cancellation
from mbstab.analysis.sweep.data_errors import EntryErrors
from mbstab.analysis.sweep.points import Points
from mbstab.analysis.sweep.tolerances import TOLERANCES
from mbstab.compiler.system import Array, Dynamics, System
from mbstab.records import dataclass


@dataclass(frozen=True)
class Pattern:
    """What a point that is computed in full tells about its neighbours.

    Attributes
    ----------
    linear : Linearization
    known : Known
        Structure of the point.
    family : Family or None
        Steady motions in rotating frames.
    sizes : ndarray, shape (n_q,)
    balance : Balance or None
        The equations of the motion, if it was solved for.
    errors : dict
        How much the rounding of the file changes the equations, by the values of the parameters that vary.
    """

    linear: Linearization
    known: Known
    family: Family | None
    sizes: Array
    balance: Balance | None
    errors: dict[tuple[float, ...], EntryErrors | None] = field(default_factory=dict, compare=False, repr=False)


class Equations:
    """The equations of points of a pattern, evaluated together.

    Parameters
    ----------
    pattern : Pattern
    system : System
        A system with parameters of shape (points,).
    points : int
    start : tuple of ndarray, optional
        Predicted coordinates and rates, if equilibria are followed, and …
    some : callable, optional
        … a function that returns the system of some of the points, by their numbers, and …
    alone : callable, optional
        … one that returns coordinates and rates of a point that is solved by itself, or None.
    """

    def __init__(
        self,
        pattern: Pattern,
        system: System,
        points: int,
        start: tuple[Array, Array] | None = None,
        some: Callable[[Index], System] | None = None,
        alone: Callable[[int], tuple[Array, Array] | None] = lambda i: None,
    ) -> None:
        self.pattern, self.system, self.points, self.start = pattern, system, points, start
        self.some, self.alone = some, alone
        self.good: Flags = np.ones(points, dtype=bool)
        self.light = None if pattern.linear.massless is None else Light(pattern.linear, pattern.linear.massless)
        if pattern.family is not None:
            self.good &= spins_freely(system, pattern.family.columns)

    def linearized(self, cancellation: Cancellation) -> tuple[Flags, Points]:
        """Return which points fit the pattern, and their linearized equations."""
        pattern, system = self.pattern, self.system
        q, steady, u, dynamics = self._motion()
        self._require_rows(dynamics, q, u)
        # A pattern at rest does not apply to motions, nor the reverse.
        self.good &= np.any(u, axis=1) != pattern.linear.motion.at_rest
        M, J, scale, row_scale = self._scaled(dynamics)
        bases = self._subspaces(J, system.n_h, pattern.linear.motion.spaces)
        allowed, Z, inverse, _ = bases
        a = steady.acceleration(q) if steady is not None else np.zeros_like(q)
        K, R, D_q, balance = self._coefficients(q, u, a, steady, dynamics, (J, inverse), scale, row_scale)
        if self.start is None:  # solutions balance to rounding, of which little may be left in their sums
            T = allowed @ Z
            self.good &= np.max(np.abs(transposed(T) @ balance[0][..., None]), axis=(-1, -2), initial=0.0) <= balance[1]
        if self.light is not None:
            without_mass, alike = self.light.found(M, allowed @ Z)
            J, D_q, regular = self.light.extended(without_mass, R, K, J, D_q)
            self.good &= alike & regular
            bases = self._subspaces(J, pattern.linear.n_h, pattern.linear.spaces)
        N, Z, inverse, W_inverse = bases
        P = -(W_inverse @ (D_q @ N))
        A, M_z = deflated_matrix(M, R, K, N, Z, P)
        gamma = time_scale(A, N.shape[-1])
        S = self._finite(balanced(A, N.shape[-1], gamma))
        if self.light is not None:
            self.good &= self.light.carried(M_z)
        (ratio, terms), data = cancellation.terms.larger(), _scaled_errors(cancellation, scale)
        spread = ratio * (1.0 if self.light is None else self.light.cancelling)
        error = self._error((M, R, K, D_q), P, M_z, gamma, inverse, W_inverse, S, data) * spread
        deflated = q, steady, scale, M, R, K, N, Z, P, S, gamma
        terms = terms * frobenius(K)[:, None, None]
        return self.good, Points(*deflated, system, u, a, data, allowed, error, balance[2], spread, terms)

    def _finite(self, S: Array) -> Array:
        """Return S of each point, with zeros where it is not finite."""
        finite = np.all(np.isfinite(S), axis=(1, 2))
        self.good &= finite
        S = S if finite.all() else np.where(finite[:, None, None], S, 0.0)
        return np.broadcast_to(S, (self.points, *S.shape[1:]))

    def _error(
        self,
        matrices: tuple[Array, ...],
        P: Array,
        M_z: Array,
        gamma: Array,
        inverse: Array,
        W_inverse: Array,
        S: Array,
        data: tuple[Array, Array, Array],
    ) -> Array:
        """Return the norm of the rounding error of S: of sums as large as the matrices, of the bases, of the data."""
        M, R, K, D_q = (frobenius(x) for x in matrices)
        lost = frobenius(np.asarray(np.linalg.inv(M_z), dtype=float)) if M_z.size else np.zeros(1)
        rate = frobenius(P)
        forces = K / gamma + R * (1.0 + rate / gamma) + M * rate * (1.0 + rate / gamma) + frobenius(S)
        rows = frobenius(W_inverse) * (D_q + rate) if D_q.any() else np.zeros(1)
        bases = 1.0 + frobenius(inverse) / math.sqrt(max(inverse.shape[-1], 1))
        evaluated = TOLERANCES.roundings_of_matrix * EPS * bases * (lost * forces + rows + frobenius(S))
        given = (
            lost * (frobenius(data[0]) / gamma + frobenius(data[1]) * (1.0 + rate / gamma))
            + (data[2] - 1.0) * evaluated
        )
        # Bounds of the data need no margin: with most of it, the larger one of both stands for the sum.
        result: Array = np.maximum(evaluated, given / (TOLERANCES.part_of_margin * TOLERANCES.bounds_from_axis))
        return result

    def cancellation(self) -> tuple[Array, Array]:
        """Return the ratio and the terms of the stiffness of `Cancellation`, for all of these points."""
        system = self.system
        q, steady, u, dynamics = self._motion()
        _, J, scale, row_scale = self._scaled(dynamics)
        a = steady.acceleration(q) if steady is not None else np.zeros_like(q)
        inverse = np.linalg.pinv(J, rcond=ALGEBRA.singular_value_zero) if system.n_c else np.zeros((1, system.n_q, 0))
        forces = _times(dynamics.M, a) + dynamics.F0
        nu = np.abs(_times(transposed(inverse), forces * scale)) * row_scale
        loads = system.terms(q, u, a, nu)
        balanced = loads["F"] + _times(loads["M"], np.abs(a)) + _times(transposed(loads["J"]), nu)
        balanced = balanced + loads["K"] @ self.pattern.sizes + _times(loads["R"], np.abs(u))
        K, R, _ = system.linearize(q, u, a, _times(-transposed(inverse), forces * scale) * row_scale)
        larger = nu + _times(np.abs(transposed(inverse)), balanced * scale) * row_scale
        terms = system.terms(q, u, a, larger)
        pairs = ((terms["K"], K), (terms["R"], R))
        both = scale[:, None, :] * scale[:, :, None]
        sizes = [(frobenius(one * both), frobenius(other * both)) for one, other in pairs]
        gamma = np.sqrt(sizes[0][1]) + sizes[1][1]
        whole = sizes[0][1] + sizes[1][1] * gamma + frobenius(dynamics.M * both) * gamma**2
        found: Array = np.broadcast_to((sizes[0][0] + sizes[1][0] * gamma) / np.maximum(whole, 1e-300), (self.points,))
        entries = np.broadcast_to(terms["K"] * both, (self.points, *both.shape[1:]))
        parts = entries / np.maximum(sizes[0][1], 1e-300)[:, None, None]
        return np.maximum(np.nan_to_num(found, nan=1.0, posinf=1e6), 1.0), np.nan_to_num(parts, nan=0.0, posinf=1e300)

    def _motion(self) -> tuple[Array, Generator | None, Array, Dynamics]:
        """Return the coordinates, the steady motion, the speeds and the equations of motion there."""
        if self.start is not None:
            return self._balanced(*self.start)
        q = self._coordinates()
        steady, u = self._speeds(q)
        return q, steady, u, self.system.dynamics(q, u)

    # --- the reference ----------------------------------------------------------------------------------------------

    def _given(self, values: Mapping[str, object], default: Array) -> Array:
        columns = [
            np.broadcast_to(np.asarray(values.get(name, default[i]), dtype=float), (self.points,))
            for i, name in enumerate(self.system.names)
        ]
        return np.stack(columns, axis=1)

    def _coordinates(self) -> Array:
        scene, motion = self.system.scene, self.pattern.linear.motion
        q = self._given(scene.coordinates, motion.q)
        missing = np.array([name not in scene.coordinates for name in self.system.names])
        return self._assembled(q, missing) if missing.any() and self.system.n_h else q

    def _assembled(self, q: Array, missing: Flags) -> Array:
        """Solve C = 0 for the missing coordinates, from those of the pattern."""
        sizes, n_h = self.pattern.sizes[missing], self.system.n_h
        for _ in range(REFERENCE.newton_steps_onto_constraints):
            dynamics = self.system.closing.dynamics(q, 0.0 * q)
            J = dynamics.J[:, :n_h, missing] * sizes
            lengths = norms(dynamics.J[:, :n_h] * self.pattern.sizes)
            weighted = J / lengths[..., None], (dynamics.E[:, :n_h] / lengths)[..., None]
            step = -(inverse_of_part(weighted[0]) @ weighted[1])[..., 0]
            q = q.copy()
            q[:, missing] += step * sizes
            if not np.max(np.abs(step)) > 1e-15:
                break
        return q

    def _balanced(self, q: Array, c: Array) -> tuple[Array, Generator | None, Array, Dynamics]:
        """Return equilibria or steady motions near predicted ones, by Newton's method."""
        balance, some = self.pattern.balance, self.some
        assert balance is not None
        assert some is not None
        every = balance.over(self.system)
        at, good = polished(every, lambda index: balance.over(some(index)), q, c)
        # Where rounding is magnified, each takes more digits.
        found = {i: x for i in np.flatnonzero(~good).tolist() if (x := self.alone(i)) is not None}
        if found:
            q, c, index = at.q.copy(), at.c.copy(), list(found)
            q[index], c[index] = (np.array(x) for x in zip(*found.values(), strict=True))
            at, good[index] = every.state(q, c), True
        self.good &= good
        return at.q, (at.steady if self.pattern.family is not None else None), at.u, at.dynamics

    def _speeds(self, q: Array) -> tuple[Generator | None, Array]:
        """Return the generator of the motion in a rotating frame, if there is one, and the speeds."""
        system, scene = self.system, self.system.scene
        u = self._given(scene.rates, np.zeros(system.n_q))
        missing = np.array([name not in scene.rates for name in system.names])
        family = self.pattern.family
        if family is not None:
            return self._turning(q, u, missing, family)
        if missing.any() and system.n_c and not self._at_rest():
            sizes, states, bodily = self.pattern.sizes, system.states[0], missing.copy()
            bodily[states] = False
            for _ in range(2):
                dynamics = system.bodily.dynamics(q, u)
                J = dynamics.J * sizes
                lengths = norms(J)[..., None]
                step = inverse_of_part(J[..., bodily] / lengths) @ (dynamics.V[..., None] / lengths)
                u = u.copy()
                u[:, bodily] -= step[..., 0] * sizes[bodily]
            if missing[states].any():
                u = system.with_state_rates(q, u)
            fast = np.max(np.abs(u / sizes), axis=1, keepdims=True)
            u[(np.abs(u / sizes) < 1e-14 * fast) & missing] = 0.0
        return None, u

    def _at_rest(self) -> bool:
        return self.pattern.linear.motion.at_rest and not any(np.any(x) for x in self.system.scene.rates.values())

    def _turning(self, q: Array, u: Array, missing: Flags, family: Family) -> tuple[Generator, Array]:
        """Return the generator whose speeds satisfy the rows and the given rates."""
        system, sizes = self.system, self.pattern.sizes
        own = replace(family, system=system)
        basis = own.basis(q)
        zero = system.dynamics(q, 0.0 * q)
        lengths = norms(zero.J * sizes)
        given = ~missing
        rows = np.concatenate([zero.J @ basis / lengths[..., None], (basis / sizes[:, None])[:, given]], axis=1)
        known = self._declared()
        right = np.concatenate(
            [np.broadcast_to(-zero.V / lengths, (self.points, system.n_c)), (u / sizes)[:, given]], axis=1
        )
        free = [k for k in range(own.size) if k not in known]
        c = np.zeros((self.points, own.size))
        for k, value in known.items():
            c[:, k] = value
        right = right - (rows @ c[..., None])[..., 0]
        c[:, free] = (inverse_of_part(rows[..., free]) @ right[..., None])[..., 0]
        generator = own.generator(c)
        speeds = generator.field(q)
        fast = np.max(np.abs(speeds / sizes), axis=1)
        self.good &= np.max(np.abs((speeds - u) / sizes)[:, given], axis=1, initial=0.0) <= REFERENCE.residual * fast
        return generator, speeds

    def _declared(self) -> dict[int, Array | float]:
        """Return the coefficients of a declared steady motion."""
        steady = self.system.scene.steady
        if steady is None or steady.rate is None:
            return {}
        known: dict[int, Array | float] = {0: steady.rate}
        return known

    def _require_rows(self, dynamics: Dynamics, q: Array, u: Array) -> None:
        """Accept points that satisfy all rows as well as rounding allows, as for a single point."""
        sizes, n_h = self.pattern.sizes, self.system.n_h
        allowed = REFERENCE.residual * np.abs(dynamics.J) @ sizes + 1e-300
        fast = np.max(np.abs(u / sizes), axis=1, initial=0.0)[:, None]
        self.good &= np.all(np.abs(dynamics.E[:, :n_h]) <= allowed[:, :n_h], axis=1)
        allowed = allowed * fast + 1e-300
        if self.system.n_c and np.any(np.abs(dynamics.V) > allowed):
            rounding = REFERENCE.coordinate_rounding * carrying(self.system, (q, u), None, sizes)
            allowed = allowed + rounding + state_rounding(self.system, q, u)
        self.good &= np.all(np.abs(dynamics.V) <= allowed, axis=1)

    # --- subspaces --------------------------------------------------------------------------------------------------

    def _scaled(self, dynamics: Dynamics) -> tuple[Array, Array, Array, Array]:
        diagonal = np.diagonal(dynamics.M, axis1=-2, axis2=-1)
        known = self.pattern.linear.spaces.scale
        scale = np.where(diagonal > 0.0, 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0)), known)
        J = dynamics.J * scale[:, None, :]
        lengths = np.linalg.norm(J, axis=-1)
        row_scale = np.where(lengths > 0.0, 1.0 / np.where(lengths > 0.0, lengths, 1.0), 1.0)
        return dynamics.M * scale[:, None, :] * scale[:, :, None], J * row_scale[..., None], scale, row_scale

    def _subspaces(self, J: Array, n_h: int, spaces: Subspaces) -> tuple[Array, Array, Array, Array]:
        """Return N, Z, J⁺ and (D_u N)⁺ of rows, n_h of them holonomic, with the ranks of the pattern at every point."""
        n_c = J.shape[-2]
        if n_c and (spaces.C.rank, spaces.W.rank) == (n_h, n_c - n_h):
            return self._independent(J, n_h)
        N = self._null(J[:, :n_h], spaces.C.rank)
        across = J[:, n_h:] @ N
        inverse, W_inverse = (np.linalg.pinv(x, rcond=ALGEBRA.singular_value_zero) for x in (J, across))
        return N, self._null(across, spaces.W.rank), np.asarray(inverse), np.asarray(W_inverse)

    def _independent(self, J: Array, n_h: int) -> tuple[Array, Array, Array, Array]:
        """Return the same where all rows are independent: from Jᵀ = Q R, with J⁺ = Q R⁻ᵀ.

        Points at which light bodies make the rows depend on each other are not good: alone they keep their digits.
        """
        n_c, n_q = J.shape[-2:]
        Q, R = np.linalg.qr(transposed(J), mode="complete")
        diagonal = np.abs(np.diagonal(R, axis1=-2, axis2=-1))
        regular, least = np.min(diagonal, axis=-1) > 0.0, math.sqrt(ALGEBRA.light_mass)
        self.good &= regular
        R_inverse = np.linalg.inv(np.where(regular[:, None, None], R[:, :n_c], np.eye(n_c)))
        for rows in (slice(0, n_h), slice(n_h, n_c)):
            # The norm of the inverse bounds the least singular value; where it does not tell, that itself does.
            doubtful = np.flatnonzero(frobenius(R_inverse[:, rows, rows]) * least > 1.0)
            if len(doubtful):
                kept = np.ones(len(J), dtype=bool)
                s = np.linalg.svd(R[doubtful, rows, rows], compute_uv=False)
                kept[doubtful] = s[:, -1] >= least
                self.good &= kept
        W_inverse = np.zeros((len(J), n_q - n_h, n_c - n_h))
        W_inverse[:, : n_c - n_h] = transposed(R_inverse[:, n_h:, n_h:])
        return Q[..., n_h:], np.eye(n_q - n_h)[None, :, n_c - n_h :], Q[..., :n_c] @ transposed(R_inverse), W_inverse

    def _null(self, matrix: Array, rank: int) -> Array:
        """Return the null space, checking the rank at every point."""
        rows, columns = matrix.shape[-2:]
        if rows == 0 or columns == 0:
            return np.eye(columns)[None]
        _, s, right = np.linalg.svd(matrix)
        if rank:
            self.good &= s[:, rank - 1] >= ALGEBRA.singular_value_kept
        if rank < s.shape[-1]:
            self.good &= s[:, rank] <= ALGEBRA.singular_value_zero
        return transposed(right[:, rank:])

    # --- coefficients -----------------------------------------------------------------------------------------------

    def _coefficients(
        self,
        q: Array,
        u: Array,
        a: Array,
        steady: Generator | None,
        dynamics: Dynamics,
        rows: tuple[Array, Array],
        scale: Array,
        row_scale: Array,
    ) -> tuple[Array, Array, Array, tuple[Array, Array, Array]]:
        """Return K, R, D_q in scaled coordinates, and the imbalance of the forces and its limit, from J and J⁺.

        The third entry of the forces is the force across rows on speeds, relative to all forces.
        """
        system, n_h, (J, inverse) = self.system, self.system.n_h, rows
        force = (_times(dynamics.M, a) + dynamics.F0) * scale
        nu, balance, across = np.zeros((1, system.n_c)), force, np.zeros(1)
        if system.n_c:
            nu = -_times(transposed(inverse), force)
            balance = force + _times(transposed(J), nu)
            largest = np.maximum(np.max(np.abs(force), axis=-1), 1e-300)
            across = np.max(np.abs(_times(transposed(J[:, n_h:]), nu[:, n_h:])), axis=-1) / largest
        K, R, D_q = system.linearize(q, u, a, nu * row_scale)
        sizes, scene = self.pattern.sizes, system.scene
        gravity = math.sqrt(sum(float(np.max(np.abs(x))) ** 2 for x in scene.gravity))
        weights = max(math.sqrt(float(np.max(body.mass))) for body in scene.bodies) * gravity
        changes = (np.abs(K) @ sizes + _times(np.abs(R), np.abs(u))) * scale
        largest = np.maximum(np.max(np.abs(dynamics.F0 * scale), axis=-1), weights)
        allowed = REFERENCE.unbalance * largest + REFERENCE.coordinate_rounding * np.max(changes, axis=-1)
        if steady is not None:
            R, K, D_q = in_frame(dynamics.M, R, K, dynamics.J[:, n_h:], D_q, *steady.frame(q))
        both = scale[:, None, :] * scale[:, :, None]
        D_q = D_q * scale[:, None, :] * row_scale[:, n_h:, None]
        return K * both, R * both, D_q, (balance, allowed, across)


def _scaled_errors(cancellation: Cancellation, scale: Array) -> tuple[Array, Array, Array]:
    """Return the errors of the data, of K and R in scaled coordinates."""
    K, R, ratio = cancellation.data.larger()
    both = scale[:, None, :] * scale[:, :, None]
    return K * both, R * both, ratio


def _times(matrix: Array, vector: Array) -> Array:
    result: Array = (matrix @ vector[..., None])[..., 0]
    return result
