"""Neutral directions and energy at many points of a sweep at once.

Symmetries, conserved functions and the work of the forces are
structure: one point computed in full (`mbstab.analysis.verdict.facts`) gives it for its neighbours. Where
the directions lie, and the second variation of the energy, change from point to point and
are formed here for all of them, in the same coordinates as in `mbstab.analysis.verdict.neutral`. Arrays have
a first axis for the points, of length 1 where all points agree.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from mbstab.analysis.algebra.arrays import Flags
from mbstab.analysis.algebra.rounded import value_and_error
from mbstab.analysis.algebra.tolerances import EPS
from mbstab.analysis.algebra.tolerances import TOLERANCES as ALGEBRA
from mbstab.analysis.reference.fields import Symmetry
from mbstab.analysis.reference.rounded_scene import rounded_system
from mbstab.analysis.reference.steady import Generator
from mbstab.analysis.sweep.points import Points, disturbance, seen_from
from mbstab.analysis.sweep.stacks import (
    beside,
    chain,
    complement,
    decaying,
    orthonormal,
    reduced,
    restricted,
    stacked,
    transposed,
    under,
    unit,
)
from mbstab.analysis.sweep.tolerances import TOLERANCES
from mbstab.analysis.verdict.drag import Drag
from mbstab.analysis.verdict.facts import Grounds
from mbstab.analysis.verdict.followers import led, left_behind
from mbstab.analysis.verdict.minimum import frame_rates
from mbstab.analysis.verdict.spectrum import Neutral
from mbstab.analysis.verdict.tolerances import TOLERANCES as VERDICT
from mbstab.compiler.system import Array, System
from mbstab.records import dataclass


@dataclass(frozen=True)
class Separation:
    """S and its structure, as `mbstab.analysis.verdict.neutral.Separated`.

    Attributes
    ----------
    A : ndarray, shape (points, r, r)
        The matrix left to judge.
    T : ndarray, shape (points, n, d)
        Orthonormal directions of symmetries and families.
    B : ndarray, shape (points, n, r)
        Orthonormal basis of the rest.
    good : ndarray of bool, shape (points,)
        Where ranks are those of the pattern, and the directions are invariant under S.
    error : ndarray, shape (points,)
        Norm of the rounding error of A (1/s).
    """

    A: Array
    T: Array
    B: Array
    good: Flags
    error: Array


class Known:
    """What a point that is computed in full tells about the structure of its neighbours.

    Parameters
    ----------
    grounds : Grounds
        The facts about that point.
    """

    def __init__(self, grounds: Grounds) -> None:
        structure, separated = grounds.structure, grounds.separated
        self.grounds = grounds
        self.neutral: Neutral = separated.neutral
        self.mirrored, self.rough = grounds.mirrored, grounds.rough
        self.symmetries = tuple(structure.invariance.symmetries)
        self.boosts = tuple(structure.invariance.boosts)
        plain = grounds.plain
        self.speeds = plain.speeds
        self.directions, self.kept = plain.T.shape[1] - self.speeds, len(plain.L)
        self.d, self.k = separated.T.shape[1], len(separated.L)
        self.of_symmetries = structure.symmetric(len(grounds.S)).shape[1]
        self.moving = bool(np.any(grounds.motion.u))
        n_eta = len(grounds.S) - structure.space.n_xi
        self.rests = n_eta < structure.space.n_xi and "position at rest" in plain.neutral.family
        self.momenta = tuple(x for x in structure.invariance.integrals if structure.commutes(x)) if self.kept else ()
        # That forces sum to the rate of a function that no symmetry changes may hold for these numbers alone.
        chance = len(self.momenta) > len(structure.invariance.momenta)
        self.vanishing = VERDICT.roundings_of_directions * EPS if chance else VERDICT.independent_direction
        self.speed = bool(self.kept and self.moving and structure.work.conserved_at_rest)
        motion = grounds.motion
        parts = [(x.direction, x.rate) for x in self.momenta] + ([(motion.u, motion.a)] if self.speed else [])
        rows = [structure.differential(*part) for part in parts]
        along = [row @ plain.T[:, : self.directions] / (np.linalg.norm(row) or 1.0) for row in rows]
        # A shift that rotates with the frame is not a zero.
        block = separated.T.T @ grounds.S @ separated.T
        self.chain = 0 if any(separated.frequencies()) else chain(block, float(np.linalg.norm(grounds.S)))
        self.tied = (
            int(np.linalg.matrix_rank(np.array(along), tol=VERDICT.independent_direction))
            if along and self.directions
            else 0
        )

    @property
    def names(self) -> tuple[object, ...]:
        """What must be the same at all points of a pattern."""
        work = self.grounds.structure.work
        return (
            self.neutral.symmetries, self.neutral.family, self.mirrored, self.d, self.k,
            tuple(x.name for x in self.boosts), work.conserved, work.decreases, bool(self.rough),
        )  # fmt: skip

    def holds_for(self, other: Known) -> bool:
        """Return whether another point has all of this structure, and possibly more."""
        own, theirs = self.grounds.structure.work, other.grounds.structure.work
        names = [
            {x.name for x in known.symmetries} | {f"boost {x.name}" for x in known.boosts} for known in (self, other)
        ]
        return (
            names[0] <= names[1]
            and (bool(self.rough) or not other.rough)
            and (not self.mirrored or bool(other.mirrored))
            and (not own.conserved or theirs.conserved)
            and (not own.decreases or theirs.decreases)
            and self.kept <= other.kept
        )

    @cached_property
    def at_rest(self) -> bool:
        """Whether the eigenvalues are those of a stiffness alone, as far as this does not vary with the points."""
        linear, work = self.grounds.linear, self.grounds.structure.work
        return not self.moving and work.conserved and not len(linear.D_q)

    @cached_property
    def minimum(self) -> bool:
        """Whether the energy may decide."""
        return self.grounds.second_variation.applies

    @cached_property
    def in_place(self) -> bool:
        """Whether a minimum of the energy is unrestricted: no symmetry and no momentum is left out."""
        return not self.symmetries if self.moving else not self.neutral.count

    # --- directions -------------------------------------------------------------------------------------------------

    def separated(self, points: Points) -> Separation:
        """Return the matrices left to judge at many points."""
        S, n = points.S, points.S.shape[-1]
        good = np.ones(len(S), dtype=bool)
        if not self.d + self.k:
            return Separation(S, np.zeros((1, n, 0)), np.eye(n)[None], good, points.error)
        symmetries = self._columns(points, self.symmetries)
        T = self._directions(points, symmetries, good)
        L = self._functions(points, T, good)
        if self.speeds:
            T = self._moving(points, T, good)
        if self.d > self.directions + self.speeds:
            T, L = self._widened(points, symmetries, L, good)
        basis = beside(T, transposed(L))
        B = np.linalg.qr(basis, mode="complete")[0][..., basis.shape[-1] :]
        ST, LS = S @ T, L @ S
        left = np.linalg.norm(ST - T @ (transposed(T) @ ST), axis=(1, 2)) + np.linalg.norm(
            LS - (LS @ T) @ transposed(T), axis=(1, 2)
        )
        allowed = np.maximum(TOLERANCES.direction_closure * points.size, 100.0 * points.error)
        good = good & (left <= allowed)
        if self.chain:
            # A large span contains almost everything: its eigenvalues must really be the zeros they are taken for.
            block = transposed(T) @ ST / np.maximum(points.size, 1e-300)[:, None, None]
            powers = np.linalg.matrix_power(block, self.chain)
            rest = np.linalg.norm(powers, axis=(1, 2)) * points.size
            good = good & (rest <= self.chain * allowed)
        return Separation(transposed(B) @ S @ B, T, B, good, points.error + left)

    def _columns(
        self, points: Points, items: tuple[Symmetry, ...], boost: bool = False, lengths: Array | None = None
    ) -> Array:
        """Return disturbances in the coordinates of S, shape (points, n, number), divided by lengths: unit columns."""
        if not items:
            return np.zeros((1, points.S.shape[-1], 0))
        parts = [disturbance(item, points) for item in items]
        direction, rate = (stacked([part[k] for part in parts]) for k in (0, 1))
        if boost:
            direction, rate = 0.0 * direction, direction
        direction, rate = (x / points.scale[:, :, None] for x in (direction, rate))
        if points.slope is not None:
            rate = rate - points.slope @ direction
        xi = transposed(points.N) @ direction
        eta = transposed(points.Z) @ (transposed(points.N) @ rate - points.P @ xi)
        columns = under(xi, eta / points.gamma[:, None, None])
        return unit(columns) if lengths is None else columns / lengths

    def _directions(self, points: Points, symmetries: Array, good: Flags) -> Array:
        """Return orthonormal directions of symmetries, boosts and rests."""
        columns = beside(symmetries, self._columns(points, self.boosts, boost=True))
        n = points.n_xi
        if self.rests:
            lower = points.S[:, n:, :n]
            n_eta = lower.shape[-2]
            if n_eta:
                _, s, right = np.linalg.svd(lower)
                least = VERDICT.rest_manifold_rank * np.linalg.norm(points.S[:, n:], axis=(1, 2))
                good &= s[:, -1] > np.maximum(least, points.error)
                null = transposed(right[:, n_eta:])
            else:
                null = np.eye(n)[None]
            columns = beside(columns, under(null, np.zeros((1, n_eta, null.shape[-1]))))
        return orthonormal(columns, self.directions, good)

    def _moving(self, points: Points, T: Array, good: Flags) -> Array:
        """Return the directions with speeds at which a scene may move as steadily, as `Structure._moving`."""
        items = [x for x in self.symmetries if self.grounds.structure.commutes(x)]
        directions = stacked([disturbance(item, points)[0] for item in items]) / points.scale[:, :, None]
        states = self.grounds.system.following
        speeds, across = led(unit(directions), points.N @ points.Z, states)
        eta = transposed(points.Z) @ (transposed(points.N) @ speeds)
        columns = under(np.zeros((1, points.n_xi, eta.shape[-1])), eta)
        if states:
            gamma, lengths = points.gamma[:, None, None], np.linalg.norm(directions, axis=1, keepdims=True)
            along = gamma * self._columns(points, tuple(items), lengths=lengths)
            columns, lacking = left_behind(points.S, points.followers(states), columns, along)
            across = under(across, lacking / gamma)
        _, s, right = np.linalg.svd(across)
        full = np.zeros((len(s), len(items)))
        full[:, : s.shape[-1]] = s
        free = int(np.sum(full[0] <= VERDICT.independent_direction))
        good &= np.sum(full <= VERDICT.independent_direction, axis=1) == free
        found = columns @ transposed(right[:, right.shape[1] - free :])
        left = found - T @ (transposed(T) @ found)
        own, s, _ = np.linalg.svd(left, full_matrices=False)
        good &= np.sum(s > VERDICT.independent_direction, axis=1) == self.speeds
        return beside(T, own[..., : self.speeds])

    def _functions(self, points: Points, T: Array, good: Flags) -> Array:
        """Return orthonormal differentials of conserved functions that vanish on the directions."""
        n = points.S.shape[-1]
        if not self.kept:
            return np.zeros((1, 0, n))
        rows = self._conserved(points, self.momenta, good)
        if self.speed:
            rows = under(rows, self._differentials(points, [(points.u, points.a)]))
        rows = transposed(unit(transposed(rows)))
        return self._vanishing(rows, T, self.kept, self.tied, good)

    def _conserved(self, points: Points, momenta: tuple[Symmetry, ...], good: Flags) -> Array:
        """Return the differentials of conserved momenta as rows, shape (points, number, n)."""
        mixed = any(item.parts for item in momenta)
        if not momenta or not mixed:
            parts = [disturbance(item, points) for item in momenta]
            return self._differentials(points, parts) if parts else np.zeros((1, 0, points.S.shape[-1]))
        # The combinations of symmetries that are conserved change from point to point.
        fields: list[Symmetry] = []
        for item in momenta:
            parts_of = [part for _, part in item.parts] or [item]
            known = [x for part in parts_of for x in self.symmetries if x.of is part.of]
            good &= len(known) == len(parts_of)
            fields += [x for x in known if x not in fields]
        rows = transposed(unit(transposed(self._differentials(points, [disturbance(item, points) for item in fields]))))
        count = len(momenta)
        left, s, _ = np.linalg.svd(rows @ points.S)
        full = np.zeros((len(s), len(fields)))
        full[:, : s.shape[-1]] = s
        limit = np.maximum(TOLERANCES.direction_closure * points.size, 100.0 * points.error)
        good &= full[:, -count] <= limit
        if count < len(fields):
            good &= full[:, -count - 1] > ALGEBRA.rank_gap * limit
        return transposed(left[..., len(fields) - count :]) @ rows

    def _differentials(self, points: Points, parts: list[tuple[Array, Array]]) -> Array:
        """Return differentials of momenta as rows, shape (points, number, n)."""
        direction, rate = (stacked([part[k] for part in parts]) for k in (0, 1))
        direction, rate = (transposed(x / points.scale[:, :, None]) for x in (direction, rate))
        carried = rate if points.slope is None else rate - direction @ transposed(points.slope)
        speeds = direction @ points.M @ points.N
        positions = direction @ points.R @ points.N - carried @ points.M @ points.N + speeds @ points.P
        return beside(positions, points.gamma[:, None, None] * (speeds @ points.Z))

    def _vanishing(self, rows: Array, T: Array, count: int, rank: int, good: Flags) -> Array:
        """Return `count` orthonormal combinations of rows that vanish on T, where rows T has the given rank."""
        if T.shape[-1]:
            _, s, right = np.linalg.svd(transposed(rows @ T))
            if rank:
                good &= s[:, rank - 1] > VERDICT.independent_direction
            if rank < s.shape[-1]:
                good &= s[:, rank] <= self.vanishing
            rows = right[:, rank:] @ rows
        return transposed(orthonormal(transposed(rows), count, good))

    def _widened(self, points: Points, symmetries: Array, L: Array, good: Flags) -> tuple[Array, Array]:
        """Return directions and functions with the family of a reversor, as `Reversor.widened`."""
        own = orthonormal(symmetries, self.of_symmetries, good)
        Q = np.linalg.qr(own, mode="complete")[0][..., own.shape[-1] :]
        size = self.d - self.of_symmetries
        _, s, right = np.linalg.svd(transposed(Q) @ points.S @ Q)
        good &= s[:, -size] <= VERDICT.mirrored_singular_value * s[:, 0]
        if size < s.shape[-1]:
            good &= (s[:, -size - 1] >= ALGEBRA.rank_gap * np.maximum(s[:, -size], 1e-300)) & (
                s[:, -size - 1] > VERDICT.mirrored_singular_value * s[:, 0]
            )
        T = orthonormal(beside(own, Q @ transposed(right[:, -size:])), self.d, good)
        return T, self._vanishing(L, T, self.k, self.kept - self.k, good) if L.shape[1] else L

    # --- the energy -------------------------------------------------------------------------------------------------

    @cached_property
    def numbers(self) -> list[tuple[float, float]]:
        """The numbers at the point and their error bounds, as `coefficients`."""
        return [value_and_error(x) for x in coefficients(rounded_system(self.grounds.linear.system))]

    def same_signs(self, numbers: list[Any]) -> Flags:
        """Return where all `coefficients` have the signs that they have at the point, as far as rounding shows them."""
        result: Flags = np.ones(1, dtype=bool)
        if len(numbers) != len(self.numbers):  # a number that is zero leaves an element out
            return ~result
        for x, (own, error) in zip(numbers, self.numbers, strict=True):
            sign = _sign(own, error)
            if isinstance(x, np.ndarray):
                result = result & (np.where(np.abs(x) <= error, 0.0, np.sign(x)) == sign)
            elif _sign(x, error) != sign:
                result = result & False
        return result

    def keeps_energy(self, points: Points) -> Flags:
        """Return where the matrices are those of forces that conserve or dissipate energy, as the pattern requires.

        The stiffness is then symmetric, and the symmetric part of the matrix of speeds zero or positive semidefinite;
        where there are forces across rows on speeds, neither needs to hold.
        """
        work = self.grounds.structure.work
        if not (work.conserved or work.decreases or work.decreases_beside_states):
            return np.ones(len(points.S), dtype=bool)
        resisting: Flags = np.ones(len(points.S), dtype=bool)
        drag = Drag(points.system, points.q, self.grounds.motion.time)
        for path in work.resisting:
            resisting &= drag.resists(path)
        return resisting & self._keeps_energy(points)

    def _keeps_energy(self, points: Points) -> Flags:
        """Return the same for the terms that are linear."""
        work = self.grounds.structure.work
        if not (work.conserved or work.decreases) or self.grounds.system.n_n:
            return np.ones(len(points.S), dtype=bool)
        stiffness, size = reduced(points.K, points.allowed), reduced(np.abs(points.K), np.abs(points.allowed))
        limit = VERDICT.roundings_of_variation * EPS * points.spread[:, None, None]
        good: Flags = np.all(np.abs(stiffness - transposed(stiffness)) <= 2.0 * limit * size, axis=(1, 2))
        damping, size = reduced(points.R, points.allowed), reduced(np.abs(points.R), np.abs(points.allowed))
        damping, size = damping + transposed(damping), limit * (size + transposed(size))
        if work.conserved:
            conserved: Flags = good & np.all(np.abs(damping) <= size, axis=(1, 2))
            return conserved
        if not damping.shape[-1]:
            return good
        diagonal = np.diagonal(np.maximum(damping, size), axis1=1, axis2=2)
        each = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
        units = each[:, :, None] * each[:, None, :]
        taken = np.linalg.eigvalsh(damping * units)[:, 0] >= -np.linalg.norm(size * units, axis=(1, 2))
        kept: Flags = good & taken
        return kept

    def energy(self, points: Points) -> tuple[Array, Array]:
        """Return the second variation of the energy in the coordinates of S, and the bounds of its rounding errors."""
        n = points.n_xi
        rates = beside(points.P, points.gamma[:, None, None] * points.Z)
        H = transposed(rates) @ (transposed(points.N) @ points.M @ points.N) @ rates
        K, terms = points.K, np.maximum(points.spread[:, None, None] * np.abs(points.K), points.terms)
        if self.grounds.idle_frame:
            K, added = points.stiffness_on_ground()
            terms = terms + points.spread[:, None, None] * added
        stiffness = transposed(points.N) @ K @ points.N
        N, moved = np.abs(points.N), np.abs(rates)
        size = transposed(moved) @ (transposed(N) @ np.abs(points.M) @ N) @ moved
        error, _, ratio = points.data
        known = transposed(N) @ (terms + error / (VERDICT.roundings_of_variation * EPS)) @ N
        size = np.maximum(points.spread, ratio)[:, None, None] * size
        shape = points.S.shape
        H, size = (np.broadcast_to(x, np.broadcast_shapes(x.shape, shape)).copy() for x in (H, size))
        H[:, :n, :n] += 0.5 * (stiffness + transposed(stiffness))
        size[:, :n, :n] += 0.5 * (known + transposed(known))
        return H, VERDICT.roundings_of_variation * EPS * size

    def inertia(self, points: Points) -> Array:
        """Return the numbers of positive, negative and doubtful directions of the second variation, shape (points, 3).

        Modulo the symmetries, at the given momenta; as `mbstab.analysis.verdict.minimum`.
        """
        good = np.ones(len(points.S), dtype=bool)
        found = restricted(self.energy(points), W := self._basis(points, good))
        if len(self.grounds.linear.D_q):
            good &= points.across <= VERDICT.force_across_rows
        found[~good] = 0, 0, W.shape[-1]
        return found

    def with_a_multiple(self, points: Points) -> Flags:
        """Return where the energy has a minimum in another frame in which the motion is at rest too.

        As in `mbstab.analysis.verdict.minimum`: a multiple of the momentum of a turn that does not move the reference.
        """
        found = np.zeros(len(points.S), dtype=bool)
        rates = frame_rates(points.S)
        for step in self.idle if self.moving else ():
            for rate in rates.T:
                left = np.flatnonzero(~found)
                if not len(left):
                    break
                counts = self.inertia(seen_from(points.at(left), step, rate[left]))
                found[left] = counts[:, 0] == counts.sum(axis=1)
        return found

    @cached_property
    def idle(self) -> tuple[Generator, ...]:
        """Rotations about the axis of its frame that do not change the motion."""
        own = self.grounds.linear.generator
        steps: list[Generator] = self.grounds.second_variation.idle_turns()
        if own is not None and own.turns:
            steps = [
                x
                for x in steps
                if np.linalg.norm(own.axis - x.axis) <= 1e-9 and np.linalg.norm(own.point - x.point) <= 1e-9
            ]
        return tuple(steps)

    def regular(self, points: Points, B: Array) -> Flags:
        """Return where the symmetry of the spectrum of the pattern is certain: a conserved form is regular."""
        if not self.grounds.structure.work.conserved or not len(self.grounds.linear.D_q):
            return np.ones(len(points.S), dtype=bool)
        result: Flags = (restricted(self.energy(points), B)[:, 2] == 0) & (points.across <= VERDICT.force_across_rows)
        return result

    def stiffness(self, points: Points, r: int) -> Array | None:
        """Return the inertia of the stiffness at rest if the r eigenvalues are ±√ of its eigenvalues, as `inertia`."""
        if not self.at_rest or np.any(points.R):
            return None
        found = self.inertia(points)
        speeds = points.S.shape[-1] - points.n_xi
        if not len(found) or 2 * (int(found[0].sum()) - speeds) != r:
            return None
        return found

    def _basis(self, points: Points, good: Flags) -> Array:
        """Return disturbances at the given momenta, modulo symmetries, as orthonormal columns."""
        n = points.S.shape[-1]
        reference = self.grounds.second_variation
        if not self.moving:
            columns = np.array(self._columns(points, self.symmetries))
            columns[:, points.n_xi :] = 0.0
            if reference.following.size:
                followers = points.followers(self.grounds.system.following)
                decaying(points.S, followers, np.maximum(points.spread, points.data[2]), good)
                columns = beside(columns, followers)
            return complement(orthonormal(columns, n - reference.basis.shape[1], good))
        momenta = tuple(self.grounds.structure.invariance.momenta)
        kernel = np.eye(n)[None]
        if momenta:
            good &= momenta == self.momenta or not any(x.parts for x in momenta)
            rows = self._conserved(points, momenta, good)
            kernel = complement(orthonormal(transposed(rows), len(momenta), good))
        if not self.symmetries:
            return kernel
        columns = self._columns(points, self.symmetries)
        inside = transposed(kernel) @ columns
        along = kernel.shape[-1] - reference.basis.shape[1]
        _, _, right = np.linalg.svd(columns - kernel @ inside)
        return kernel @ complement(orthonormal(inside @ transposed(right[:, right.shape[1] - along :]), along, good))


def _sign(x: float, error: float) -> int:
    """Return the sign of a number with an error bound; 0 where it is not known."""
    return 0 if abs(x) <= error else int(x > 0) - int(x < 0)


def coefficients(system: System) -> list[Any]:
    """Return the numbers of all elements and the coefficients in written expressions.

    A force that is zero at one point and not at another has no trace in linear equations where it is of higher order,
    and one that changes its sign drives instead of damping: structure is carried only between equal signs.

    Returns
    -------
    list of numbers; of ndarray, shape (points,), where they may vary
    """
    scene = system.scene
    written = [expression for item in scene.items for expression in item.entry.equations.values()]
    written += [law.expression for _, law in system.given_functions()]
    numbers = list(system.numbers())
    for expression in written:
        numbers += expression.coefficients(scene.parameters, scene.arithmetic)
    return numbers


# --- matrices of many points ------------------------------------------------------------------------------------------
