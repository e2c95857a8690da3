"""The linearized equations at many points of a sweep at once, by broadcasting in kernels and linear algebra.

One point is computed in full: its ranks, the frame of its motion and its symmetries are the
pattern. Every other point must have the same pattern, which is checked. Arrays have a first axis
for the points, of length 1 where all points agree.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import field, replace
from functools import cached_property

import numpy as np

from mbstab.analysis.algebra.arrays import Flags, Index, norms, others
from mbstab.analysis.algebra.augmented import Augmented
from mbstab.analysis.algebra.deflation import balanced, deflated_matrix, time_scale
from mbstab.analysis.algebra.rank import inverse_of_part
from mbstab.analysis.algebra.sparse import scaled
from mbstab.analysis.algebra.stacks import frobenius, times, transposed
from mbstab.analysis.algebra.subspaces import Subspaces, decided
from mbstab.analysis.algebra.tolerances import EPS
from mbstab.analysis.algebra.tolerances import TOLERANCES as ALGEBRA
from mbstab.analysis.linear.linearize import Linearization, entries_of
from mbstab.analysis.reference.coefficients import matrices_in, multiplier_sizes
from mbstab.analysis.reference.equations import Balance
from mbstab.analysis.reference.imbalance import balanced_at, carrying, state_rounding
from mbstab.analysis.reference.many_points import polished
from mbstab.analysis.reference.motion import Motion
from mbstab.analysis.reference.speeds import on_rows
from mbstab.analysis.reference.steady import Family, Generator, spins_freely
from mbstab.analysis.reference.tolerances import TOLERANCES as REFERENCE
from mbstab.analysis.sweep.batched_structure import Known
from mbstab.analysis.sweep.data_errors import EntryErrors, Samples
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
    balance : Balance or None
        The equations of the motion, if it was solved for.
    errors : dict
        How much the rounding of the file changes the equations, by the values of the parameters that vary.
    """

    linear: Linearization
    known: Known
    family: Family | None
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
        self.sizes = pattern.linear.motion.sizes
        if pattern.family is not None:
            self.good &= spins_freely(system, pattern.family.columns)

    def linearized(self, errors: Samples, terms: Samples) -> tuple[Flags, Points]:
        """Return which points fit the pattern, and their linearized equations.

        Parameters
        ----------
        errors : Samples
            What the rounding of the file changes in them, as `EntryErrors`.
        terms : Samples
            What `terms` returns of some of them.
        """
        (motion, steady), linear, system = self.motion, self.pattern.linear, self.system
        spaces, scale, light = motion.spaces, motion.spaces.scale, linear.massless
        self._require_rows(motion)
        self._require_ranks(spaces)
        # A pattern at rest does not apply to motions, nor the reverse.
        self.good &= np.any(motion.u, axis=1) != linear.motion.at_rest
        forces, across = self._balanced_forces(motion), np.zeros(1)
        if system.n_n:
            J, nu = motion.dynamics.J[:, system.n_h :], motion.nu[:, system.n_h :]
            most = np.maximum(np.max(np.abs(forces), axis=-1), 1e-300)
            across = np.max(np.abs(times(transposed(J), nu) * scale), axis=-1) / most
        free, inverse, m = spaces.allowed, motion.augmented.inverse, matrices_in(system, motion, steady)
        if light is not None:
            M, R = (scaled(x, scale, scale) for x in m[:2])
            moved, basis, alike = light.at_points(M, R, spaces)
            m = moved.extended(m)
            spaces = decided(m.J, linear.n_h, scale, linear.spaces)
            self._require_ranks(spaces)
            J = scaled(m.J, scale, spaces.row_scale)
            kept = np.linalg.svd(J[:, light.own] @ basis, compute_uv=False)[:, -1] >= ALGEBRA.singular_value_kept
            self.good &= alike & kept
            inverse = spaces.inverse(J)
        M, R, K = (scaled(x, scale, scale) for x in m[:3])
        N, Z, D_q = spaces.N, spaces.Z, scaled(m.D_q, scale, spaces.row_scale[:, linear.n_h :])
        P = -(spaces.W.pseudo_inverse @ (D_q @ N))
        A, M_z = deflated_matrix(M, R, K, N, Z, P)
        gamma = time_scale(A, N.shape[-1])
        S = self._finite(balanced(A, N.shape[-1], gamma))
        if light is not None and M_z.size:
            inertias = np.linalg.eigvalsh(M_z)
            self.good &= inertias[:, 0] > REFERENCE.massless * inertias[:, -1]
        of_K, of_R, rest = errors.larger()
        data = scaled(of_K, scale, scale), scaled(of_R, scale, scale), rest
        spread, parts = terms.larger()
        spread, parts = spread * self._cancelling, parts * frobenius(K)[:, None, None]
        error = self._error((M, R, K, D_q), P, M_z, gamma, inverse, spaces.W.pseudo_inverse, S, data) * spread
        deflated = motion.q, steady, scale, M, R, K, N, Z, P, S, gamma
        return self.good, Points(*deflated, system, motion.u, motion.a, data, free, error, across, spread, parts)

    @property
    def _cancelling(self) -> float:
        """Ratio of the terms of the rows of balance to their sums at the pattern, with the rounding of directions."""
        linear = self.pattern.linear
        if (light := linear.massless) is None:
            return 1.0
        terms, rows = (x[light.own] * light.spaces.scale for x in (linear.entries.J, linear.J))
        cancelling = float(np.max(np.linalg.norm(terms, axis=1) / np.linalg.norm(rows, axis=1)))
        return cancelling * (1.0 if light.exact else max(1.0, light.accuracy / EPS))

    @cached_property
    def motion(self) -> tuple[Motion, Generator | None]:
        """The motions, and the steady ones that they follow in a rotating frame."""
        known = self.pattern.linear.motion
        q, steady, u, dynamics = self._state()
        a = steady.acceleration(q) if steady is not None else np.zeros_like(q)
        own, here = (np.diagonal(x, axis1=-2, axis2=-1) for x in (known.dynamics.M, dynamics.M))
        heavy = (own > 0.0) & (here > 0.0)
        scale = self.pattern.linear.spaces.scale * np.sqrt(np.where(heavy, own, 1.0) / np.where(heavy, here, 1.0))
        spaces = decided(dynamics.J, self.system.n_h, scale, known.spaces)
        M, J = scaled(dynamics.M, scale, scale), scaled(dynamics.J, scale, spaces.row_scale)
        augmented, time = Augmented(M, J, spaces.inverse(J), None), self.system.scene.time
        found = replace(known, q=q, u=u, a=a, time=time, dynamics=dynamics, spaces=spaces, augmented=augmented)
        return replace(found, nu=found.balancing(dynamics.F0 + times(dynamics.M, a))), steady

    def _balanced_forces(self, motion: Motion) -> Array:
        """Return the scaled forces that the rows balance; where rows are all, solutions must balance to rounding.

        Of those of a path of equilibria little may be left of the digits of their sums.
        """
        dynamics, scale = motion.dynamics, motion.spaces.scale
        forces = dynamics.F0 + times(dynamics.M, motion.a)
        if self.start is None:
            left = (forces + times(transposed(dynamics.J), motion.nu)) * scale
            at = motion.q, motion.u, motion.a, motion.nu
            left = times(transposed(motion.spaces.allowed), left)
            self.good &= balanced_at(self.system, at, left, dynamics.F0, motion.sizes, scale, motion.time)
        return np.asarray(forces * scale)

    def _require_ranks(self, spaces: Subspaces) -> None:
        """Accept points at which rows have the ranks of the pattern.

        Points at which light bodies make the rows depend on each other are not good: alone they keep their digits.
        """
        for rank in (spaces.C, spaces.W):
            self.good &= np.asarray(rank.smallest_kept >= math.sqrt(ALGEBRA.light_mass))
            self.good &= np.asarray(rank.largest_dropped <= ALGEBRA.singular_value_zero)

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

    def terms(self) -> tuple[Array, Array]:
        """Return how much larger the terms of the matrices of each point are than their sums.

        The ratio of norms, shape (points,), and the terms of each entry of K by the norm of K, (points, n_q, n_q), as
        what cancels in one entry may be small beside another.
        """
        (motion, steady), system = self.motion, self.system
        found = entries_of(system, motion, steady, multiplier_sizes(system, motion))
        parts = found.K, found.R, *matrices_in(system, motion, steady)[:3]
        of_K, of_R, M, R, K = (scaled(x, motion.spaces.scale, motion.spaces.scale) for x in parts)
        M, R, K = (frobenius(x) for x in (M, R, K))
        gamma = np.sqrt(K) + R
        ratio = (frobenius(of_K) + frobenius(of_R) * gamma) / np.maximum(K + R * gamma + M * gamma**2, 1e-300)
        ratio = np.maximum(np.nan_to_num(ratio, nan=1.0, posinf=1e6), 1.0)
        of_K = np.nan_to_num(of_K / np.maximum(K, 1e-300)[:, None, None], nan=0.0, posinf=1e300)
        return np.broadcast_to(ratio, (self.points,)), np.broadcast_to(of_K, (self.points, *of_K.shape[1:]))

    def _state(self) -> tuple[Array, Generator | None, Array, Dynamics]:
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
        n_h, q = self.system.n_h, q.copy()
        for _ in range(REFERENCE.newton_steps_onto_constraints):
            dynamics = self.system.closing.dynamics(q, 0.0 * q)
            J = dynamics.J[:, :n_h] * self.sizes
            lengths = norms(J)
            step = -times(inverse_of_part(J[..., missing] / lengths[..., None]), dynamics.E[:, :n_h] / lengths)
            q[:, missing] += step * self.sizes[missing]
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
        family, sizes, given = self.pattern.family, self.sizes, np.flatnonzero(~missing)
        if family is None:
            still = self.pattern.linear.motion.at_rest and not any(np.any(x) for x in scene.rates.values())
            if missing.any() and system.n_c and not still:
                basis = np.diag(sizes)[:, others(len(missing), [*given, *system.states[0]])]
                u = u + times(basis, on_rows(system.bodily, q, u, basis, sizes, (given[:0], u[:, :0]))[0])
                u = system.with_state_rates(q, u) if np.any(missing[system.states[0]]) else u
                fast = np.max(np.abs(u / sizes), axis=1, keepdims=True)
                u[(np.abs(u / sizes) < 1e-14 * fast) & missing] = 0.0
            return None, u
        family, c = replace(family, system=system), np.zeros((self.points, family.size))
        free, basis = np.arange(family.size), family.basis(q)
        if scene.steady is not None and scene.steady.rate is not None:
            c[:, 0], free = scene.steady.rate, free[1:]
        c[:, free] = on_rows(system, q, times(basis, c), basis[..., free], sizes, (given, u[:, given]))[0]
        generator = family.generator(c)
        speeds = generator.field(q)
        fast = np.max(np.abs(speeds / sizes), axis=1)
        off = np.max(np.abs((speeds - u) / sizes)[:, given], axis=1, initial=0.0)
        self.good &= off <= REFERENCE.residual * fast
        return generator, speeds

    def _require_rows(self, motion: Motion) -> None:
        """Accept points that satisfy all rows as well as rounding allows, as for a single point."""
        dynamics, q, u, sizes, n_h = motion.dynamics, motion.q, motion.u, motion.sizes, self.system.n_h
        allowed = REFERENCE.residual * np.abs(dynamics.J) @ sizes + 1e-300
        fast = np.max(np.abs(u / sizes), axis=1, initial=0.0)[:, None]
        self.good &= np.all(np.abs(dynamics.E[:, :n_h]) <= allowed[:, :n_h], axis=1)
        allowed = allowed * fast + 1e-300
        if self.system.n_c and np.any(np.abs(dynamics.V) > allowed):
            rounding = REFERENCE.coordinate_rounding * carrying(self.system, (q, u), None, sizes)
            allowed = allowed + rounding + state_rounding(self.system, q, u)
        self.good &= np.all(np.abs(dynamics.V) <= allowed, axis=1)
