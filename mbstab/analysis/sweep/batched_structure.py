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

from mbstab.analysis.algebra.arrays import Flags, norms
from mbstab.analysis.algebra.rounded import value_and_error
from mbstab.analysis.algebra.stacks import beside, complement, frobenius, reduced, transposed, under, unit
from mbstab.analysis.algebra.tolerances import EPS
from mbstab.analysis.algebra.tolerances import TOLERANCES as ALGEBRA
from mbstab.analysis.reference.fields import Symmetry
from mbstab.analysis.reference.rounded_scene import rounded_system
from mbstab.analysis.reference.steady import Generator
from mbstab.analysis.sweep.points import Points, seen_from
from mbstab.analysis.sweep.tolerances import TOLERANCES
from mbstab.analysis.verdict.directions import (
    Ranks,
    at_given_momenta,
    energy_form,
    misfit,
    not_driven,
    own_speed,
    rests,
    span,
    speeds_along,
    vanishing,
    with_mirrored,
)
from mbstab.analysis.verdict.drag import Drag
from mbstab.analysis.verdict.facts import Grounds
from mbstab.analysis.verdict.minimum import decays, frame_rates, restricted
from mbstab.analysis.verdict.neutral import Choice
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
    B : ndarray, shape (points, n, r)
        Orthonormal basis of the rest.
    good : ndarray of bool, shape (points,)
        Where ranks are those of the pattern, and the directions are invariant under S.
    error : ndarray, shape (points,)
        Norm of the rounding error of A (1/s).
    """

    A: Array
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
        self.choice: Choice = separated.choice
        self.mirrored, self.rough = grounds.mirrored, grounds.rough
        self.symmetries = tuple(structure.invariance.symmetries)
        self.boosts = tuple(structure.invariance.boosts)
        self.kept, self.d, self.k = len(grounds.plain.L), separated.T.shape[1], len(separated.L)
        self.moving = bool(np.any(grounds.motion.u))
        # That forces sum to the rate of a function that no symmetry changes may hold for these numbers alone.
        chance = len(self.choice.momenta) > len(structure.invariance.momenta)
        self.vanishing = VERDICT.roundings_of_directions * EPS if chance else VERDICT.independent_direction
        # A shift that rotates with the frame is not a zero.
        block = separated.T.T @ grounds.S @ separated.T
        self.chain = 0 if any(separated.frequencies()) else chain(block, float(np.linalg.norm(grounds.S)))

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
        S, n, choice = points.S, points.S.shape[-1], self.choice
        ranks = Ranks(choice.ranks, len(S))
        if not self.d + self.k:
            return Separation(S, np.eye(n)[None], ranks.good, points.error)
        T, L = self._directions(points, ranks)
        B, left = complement(beside(T, transposed(L))), misfit(S, T, L)
        allowed = np.maximum(TOLERANCES.direction_closure * points.size, 100.0 * points.error)
        ranks.require(left <= allowed)
        if self.chain:
            # A large span contains almost everything: its eigenvalues must really be the zeros they are taken for.
            block = reduced(S, T) / np.maximum(points.size, 1e-300)[:, None, None]
            rest = frobenius(np.linalg.matrix_power(block, self.chain)) * points.size
            ranks.require(rest <= self.chain * allowed)
        return Separation(reduced(S, B), B, ranks.good, points.error + left)

    def _directions(self, points: Points, ranks: Ranks) -> tuple[Array, Array]:
        """Return orthonormal neutral directions, and differentials of conserved functions that vanish on them."""
        choice = self.choice
        columns = [points.of_symmetries(self.symmetries), points.of_boosts(self.boosts)]
        if choice.rests and (found := rests(points, ranks, points.error)) is not None:
            columns.append(found)
        T = span(*columns, ranks=ranks, name="directions")
        L = self._functions(points, T, ranks)
        if choice.moving:
            moved, _, along = speeds_along(points, choice.moving, self.grounds.system.following, T, ranks)
            if choice.alone:
                moved = moved @ own_speed(along, points.u / points.scale)
            T = span(T, moved, ranks=ranks, name="directions with speeds")
        if choice.family and (wide := with_mirrored(points, self.symmetries, choice.family, ranks)) is not None:
            T, L = wide[0], vanishing(L, wide[0], ranks, "functions beside a family")
        return T, L

    def _functions(self, points: Points, T: Array, ranks: Ranks) -> Array:
        """Return orthonormal differentials of conserved functions that vanish on the directions."""
        if not self.kept:
            return np.zeros((1, 0, points.S.shape[-1]))
        rows = self._momenta(points, self.choice.momenta, ranks)
        if self.choice.energy:
            rows = under(rows, points.differentials(points.u[..., None], points.a[..., None]))
        return vanishing(rows / norms(rows)[..., None], T, ranks, "functions", self.vanishing)

    def _momenta(self, points: Points, momenta: tuple[Symmetry, ...], ranks: Ranks) -> Array:
        """Return the differentials of conserved momenta as rows, shape (points, number, n)."""
        if not any(item.parts for item in momenta):
            return points.of_momenta(momenta)
        # The combinations of symmetries that are conserved change from point to point.
        parts = [part for item in momenta for _, part in (item.parts or ((1.0, item),))]
        fields = [x for x in self.symmetries if any(x.of is part.of for part in parts)]
        ranks.require(np.array(all(any(x.of is part.of for x in fields) for part in parts)))
        rows = points.of_momenta(fields)
        rows = rows / norms(rows)[..., None]
        count = len(momenta)
        left, s, _ = np.linalg.svd(rows @ points.S)
        full = np.zeros((len(s), len(fields)))
        full[:, : s.shape[-1]] = s
        limit = np.maximum(TOLERANCES.direction_closure * points.size, 100.0 * points.error)
        ranks.require(full[:, -count] <= limit)
        if count < len(fields):
            ranks.require(full[:, -count - 1] > ALGEBRA.rank_gap * limit)
        return transposed(left[..., len(fields) - count :]) @ rows

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
        stiffness, size = reduced(points.K, points.free), reduced(np.abs(points.K), np.abs(points.free))
        limit = VERDICT.roundings_of_variation * EPS * points.spread[:, None, None]
        good: Flags = np.all(np.abs(stiffness - transposed(stiffness)) <= 2.0 * limit * size, axis=(1, 2))
        damping, size = reduced(points.R, points.free), reduced(np.abs(points.R), np.abs(points.free))
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
        K, terms = points.K, np.maximum(points.spread[:, None, None] * np.abs(points.K), points.terms)
        if self.grounds.idle_frame:
            _, K, added = points.on_ground()
            terms = terms + points.spread[:, None, None] * added
        error, _, ratio = points.data
        known = terms + error / (VERDICT.roundings_of_variation * EPS)
        mass = np.maximum(points.spread, ratio)[:, None, None] * np.abs(points.M)
        size = energy_form(mass, known, np.abs(points.N), np.abs(points.rates))
        shape = np.broadcast_shapes(size.shape, points.S.shape)
        return np.broadcast_to(points.second_variation(K), shape), VERDICT.roundings_of_variation * EPS * size

    def inertia(self, points: Points) -> Array:
        """Return the numbers of positive, negative and doubtful directions of the second variation, shape (points, 3).

        Modulo the symmetries, at the given momenta; as `mbstab.analysis.verdict.minimum`.
        """
        ranks = Ranks(self.grounds.second_variation.ranks, len(points.S))
        W = self._basis(points, ranks)
        found = np.array(restricted(*self.energy(points), W))
        if len(self.grounds.linear.D_q):
            ranks.require(points.across <= VERDICT.force_across_rows)
        found[~ranks.good] = 0, 0, W.shape[-1]
        return found

    def with_a_multiple(self, points: Points, A: Array) -> Flags:
        """Return where the energy has a minimum in another frame in which the motion is at rest too.

        As in `mbstab.analysis.verdict.minimum`: a multiple of the momentum of a turn that does not move the reference.
        A are the matrices left to judge.
        """
        found = np.zeros(len(points.S), dtype=bool)
        rates = frame_rates(A)
        for step in self.idle:
            for rate in rates.T:
                left = np.flatnonzero(~found)
                if not len(left):
                    break
                counts = self.inertia(seen_from(points.at(left), step, rate[left]))
                found[left] = counts[:, 0] == counts.sum(axis=1)
        return found

    @cached_property
    def idle(self) -> tuple[Generator, ...]:
        """Rotations about the axis of its frame that do not change a motion."""
        return tuple(self.grounds.second_variation.idle_turns()) if self.moving else ()

    def regular(self, points: Points, B: Array) -> Flags:
        """Return where the symmetry of the spectrum of the pattern is certain: a conserved form is regular."""
        if not self.grounds.structure.work.conserved or not len(self.grounds.linear.D_q):
            return np.ones(len(points.S), dtype=bool)
        result: Flags = (restricted(*self.energy(points), B)[:, 2] == 0) & (points.across <= VERDICT.force_across_rows)
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

    def _basis(self, points: Points, ranks: Ranks) -> Array:
        """Return disturbances at the given momenta, modulo symmetries, as orthonormal columns."""
        columns = points.of_symmetries(self.symmetries)
        if self.moving:
            momenta = tuple(self.grounds.structure.invariance.momenta)
            ranks.require(np.array(momenta == self.choice.momenta or not any(x.parts for x in momenta)))
            return at_given_momenta(columns, self._momenta(points, momenta, ranks), ranks)
        still = points.still(columns)
        if self.grounds.second_variation.following.size:
            followers = points.followers(self.grounds.system.following)
            kept = not_driven(followers, unit(columns), self.grounds.second_variation.constant, ranks)
            ranks.require(_decaying(points, followers, complement(kept)))
            still = beside(still, followers)
        return at_given_momenta(still, np.zeros((1, 0, points.S.shape[-1])), ranks)


def chain(block: Array, size: float) -> int:
    """Return the power at which a nilpotent matrix vanishes; 0 where rounding hides it."""
    power = np.eye(len(block))
    for index in range(1, len(block) + 1):
        power = power @ (block / (size or 1.0))
        if np.linalg.norm(power) <= TOLERANCES.direction_closure:
            return index
    return 0


def _decaying(points: Points, columns: Array, left: Array) -> Flags:
    """Return where disturbances of states that only follow, (points, n, states), decay but for some of their parts."""
    inverse, S = np.linalg.pinv(columns), points.S
    spread = np.maximum(points.spread, points.data[2])
    errors = VERDICT.roundings_of_variation * EPS * spread * frobenius(np.abs(inverse) @ np.abs(S) @ np.abs(columns))
    return np.array([decays(*x) for x in zip(reduced(inverse @ S @ columns, left), errors.tolist(), strict=True)])


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
