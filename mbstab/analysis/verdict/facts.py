"""The facts about a motion that do not depend on how its eigenvalues are computed.

Time and smoothness come from the expressions of the file, neutral directions, energy and
reversibility from the elements. All commands share them, so that their verdicts can differ in
strength only, never in substance.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from mbstab.analysis.algebra.arrays import RandomNumbers, least_squares, norms
from mbstab.analysis.algebra.sparse import scaled
from mbstab.analysis.linear.linearize import Linearization, StateSpace, state_space
from mbstab.analysis.reference.coefficients import matrices_in
from mbstab.analysis.reference.element_comparison import OnRows
from mbstab.analysis.reference.motion import balanced as forces_balance
from mbstab.analysis.reference.rounded_scene import without_chance_zeros
from mbstab.analysis.reference.steady import Generator, spun
from mbstab.analysis.reference.symmetries import Invariance
from mbstab.analysis.reference.tolerances import TOLERANCES as REFERENCE
from mbstab.analysis.verdict.directions import Deflated
from mbstab.analysis.verdict.many_digits import ManyDigits
from mbstab.analysis.verdict.minimum import SecondVariation
from mbstab.analysis.verdict.neutral import Separated, Structure, may_turn
from mbstab.analysis.verdict.rule import Critical, Disc, Facts, Minimum
from mbstab.analysis.verdict.spectrum import Neutral
from mbstab.analysis.verdict.tolerances import TOLERANCES
from mbstab.analysis.verdict.written import with_state, with_time
from mbstab.compiler.system import Array
from mbstab.errors import percent
from mbstab.model.arithmetic import as_float
from mbstab.model.expressions import Number
from mbstab.model.units import per_second

if TYPE_CHECKING:
    from mbstab.analysis.bounds.discs import Placed
    from mbstab.analysis.verdict.reversor import Reversor

ADVICE = (
    "if it follows a symmetry, declare it with reference.steady; if it is periodic, give reference.period; "
    "or describe the motion so that it stands still"
)
BALANCED = (
    "where forces balance, find: equilibrium finds a rest, and find: steady a steady motion, beside spins with "
    "steady: {axis: z, rate: 0}; "
)


def warnings_of(linear: Linearization) -> tuple[str, ...]:
    """Return the warnings of a motion, and one if its equations are not known to stay what they are now."""
    doubt = "" if linear.frozen else Grounds(linear).time
    return (*linear.motion.warnings, *([f"the linear model is that of an instant: {doubt}"] if doubt else []))


class Grounds:
    """The facts on which verdicts about a linearization rest; each part is computed at first use.

    Parameters
    ----------
    linear : Linearization
    digits : ManyDigits, optional
        The same motion with many digits; without it no verdict rests on an eigenvalue that is zero exactly.
    """

    def __init__(self, linear: Linearization, digits: ManyDigits | None = None) -> None:
        self.linear, self.digits = linear, digits
        self.system, self.motion = linear.system, linear.motion

    @cached_property
    def space(self) -> StateSpace:
        """The deflated system."""
        return state_space(self.linear)

    @cached_property
    def _elementwise(self) -> Invariance:
        """The symmetries of the scene that each of its elements has."""
        return Invariance(self.system, self.motion)

    @cached_property
    def gamma(self) -> float:
        """A typical rate of the deflated system (1/s), the unit of speeds."""
        # In a critical state only rounding may be left of it.
        return max(self.space.rate, TOLERANCES.slowest_typical_rate * self._elementwise.rate)

    @cached_property
    def at(self) -> Deflated:
        """The deflated system in balanced coordinates."""
        return Deflated.of(self.linear, self.space, self.gamma)

    @property
    def S(self) -> Array:
        """The balanced matrix of the deflated system."""
        return self.at.S

    def may_turn(self, closeness: float = 0.0) -> bool:
        """Return whether some direction may be that of a symmetry, where the equations are known so well."""
        return bool(self.S.size) and may_turn(self.S, self.linear.generator, self._elementwise.rate, closeness)

    @cached_property
    def _found(self) -> tuple[Structure, Separated]:
        """The structure, with what holds on all rows only, or for sums of forces, where zeros are left without it."""
        if not self.may_turn():
            self._elementwise.isolated = True
        structure = Structure(self.linear, self.space, self.at, self._elementwise)
        separated, system = structure.separated(), self.system
        large = system.sparse or system.n_q > REFERENCE.searched_together
        if large or not separated.A.size or self.linear.massless is not None:
            return structure, separated
        limit = TOLERANCES.family_singular_value * max(float(np.linalg.norm(self.S, 2)), self._elementwise.rate)
        if float(np.linalg.svd(separated.A, compute_uv=False)[-1]) > limit:
            return structure, separated
        wider = Invariance(system, self.motion, self._elementwise)
        if len(wider.symmetries) <= len(self._elementwise.symmetries):
            return structure, separated
        structure = Structure(self.linear, self.space, self.at, wider, structure.work)
        return structure, structure.separated()

    @property
    def invariance(self) -> Invariance:
        """The symmetries of the scene."""
        return self.structure.invariance

    @property
    def structure(self) -> Structure:
        """The neutral directions and the work of the forces."""
        return self._found[0]

    @property
    def plain(self) -> Separated:
        """The balanced matrix with the directions that symmetries and conserved functions of the scene separate."""
        return self._found[1]

    @cached_property
    def separated(self) -> Separated:
        """The balanced matrix with its neutral directions, including those of a reversor."""
        found = self.plain
        if self.reversor is None:
            return found
        return self.reversor.widened(self.structure, found)

    def enclosures(self) -> Placed:
        """Return discs that contain the eigenvalues other than those of the neutral directions."""
        from mbstab.analysis.bounds.location import enclosures

        found = self.separated
        return enclosures(self.linear, self.space, self.gamma, self.S, found.T, found.L, found.fitted)

    @cached_property
    def idle_frame(self) -> bool:
        """Whether the frame turns although nothing moves: the energy is then that of the frame of the ground."""
        linear, scene = self.linear, self.system.scene
        turns = linear.generator is not None and linear.generator.turns_in_place(self.motion.q)
        return turns and linear.massless is None and not scene.timed

    @cached_property
    def second_variation(self) -> SecondVariation:
        """The energy near the reference, in the frame of the ground where nothing moves."""
        if not self.idle_frame:
            return self._co_moving
        matrices = matrices_in(self.system, self.motion, None)
        ground = Grounds(replace(self.linear, **matrices._asdict(), generator=None))
        return SecondVariation(ground.structure, ground.plain)

    @cached_property
    def _co_moving(self) -> SecondVariation:
        """The energy in the frame of the eigenvalues."""
        return SecondVariation(self.structure, self.plain)

    @cached_property
    def lost(self) -> str:
        """A number of the file that is so small that products with it may underflow, in words; empty: there is none."""
        scene = self.system.scene
        numbers = {name: float(value) for name, value in scene.parameters.items()}
        written = (node for expression in scene.written for node in expression.walk())
        numbers |= {node.text: as_float(node.text) for node in written if isinstance(node, Number)}
        small = [name for name, value in numbers.items() if 0.0 < abs(value) < TOLERANCES.number_lost]
        if not small:
            return ""
        return f"{small[0]} is {numbers[small[0]]:g}: products with a number so small are lost in double precision"

    # --- time and smoothness ----------------------------------------------------------------------------------------

    @cached_property
    def time(self) -> str:
        """Why the coefficients are not known to be constant; empty: they are."""
        linear = self.linear
        if linear.frozen or not linear.constant:
            return self._frozen()
        driven = False
        if with_time(self.system):
            from mbstab.analysis.verdict.constancy import affine_drives, time_doubt

            if doubt := time_doubt(self.system):
                return doubt
            driven = bool(affine_drives(self.system))
        if not np.any(self.motion.u) and not driven:
            return ""
        # The same motion may follow several symmetries; one that holds for all elements is enough.
        first = linear.generator or _standing(self.linear)
        followed = list[tuple[Generator, str | bool]]()
        for g in (first, *(g for g in self.motion.generators if g is not first)):
            if not self._accelerating(g):
                broken = next(iter(self.invariance.broken(g)), "") if driven else not self.invariance.steady(g)
                if not broken:
                    return ""
                followed.append((g, broken))
        if not followed:
            unbalanced = f"the reference is no steady motion: forces do not balance{self._accelerating(first)}"
            return f"{unbalanced}; {self._advice(first)}"
        if driven:
            return f"the motion is not known to be steady: {followed[0][1]} changes along it"
        if drift := self._drifting():
            return drift
        return (
            "the motion is not known to be steady: no symmetry of the scene leads from the motion now to that later "
            f"({followed[0][0]}); {ADVICE}"
        )

    def _drifting(self) -> str:
        """Say which state changes most, if nothing else moves."""
        u, states = self.motion.u, self.system.states[0]
        if np.any(np.delete(u, states)):
            return ""
        i = states[np.argmax(np.abs(u[states] / self.motion.sizes[states]))]
        rate = f"{u[i]:.4g} {per_second(self.system.units[i], 1)}"
        return (
            f"the reference is not at rest: the state {self.linear.names[i]} changes by {rate}; give it under "
            "coordinates, or solve for it with find: equilibrium"
        )

    def _frozen(self) -> str:
        linear = self.linear
        change = linear.variation
        size = f"by {percent(change)}" if math.isfinite(change) else "without bound"
        # A change that looks like none is printed with its limit.
        least = (
            f" (below {percent(REFERENCE.variation_along_motion)} they would count as constant)"
            if change < REFERENCE.variation_told
            else ""
        )
        if linear.frozen:
            along = f", and change {size} along the motion{least}" if not linear.constant else ""
            return f"frozen-time (asked for): not a stability verdict; the coefficients are those of an instant{along}"
        standing = _standing(linear)
        advice = "; ".join(x for x in (spun(self.system, self.motion.u), self._advice(standing)) if x)
        return (
            f"frozen-time: not a stability verdict; the coefficients of the linearized equations change {size} along "
            f"the motion{least}{self._broken()}{self._accelerating(standing)}; {advice}"
        )

    def _broken(self) -> str:
        """Name the entries that keep the motion from being steady: the fewest of those that it could be."""
        found = [x for g in self.motion.generators if (x := self.invariance.broken(g)) != ["the motion"]]
        names = min(found, key=len, default=[])
        if not names:
            return ""
        more = f" and {len(names) - 3} more" if len(names) > 4 else ""
        listed = ", ".join(names[: 3 if more else 4]) + more
        return f", where {listed} {'is' if len(names) == 1 else 'are'} not the same all along it"

    def _accelerating(self, generator: Generator) -> str:
        """Name the coordinate that leaves a steady motion most: forces out of balance are the usual reason.

        A fall along a shift to whose place and speed nothing is sensitive leaves disturbances as they are about a
        steady motion.
        """
        motion = self.motion
        scale, excess = motion.spaces.scale, motion.a - generator.acceleration(motion.q)

        def balances() -> bool:
            return not np.any(excess) or forces_balance(self.system, motion, (motion.dynamics.M @ excess) * scale)

        if balances():
            return ""
        if falling := [item.direction / scale for item in self.invariance.boosts]:
            Y = np.array(falling).T
            excess = excess - scale * (Y @ least_squares(Y, excess / scale, rcond=TOLERANCES.independent_direction))
            if balances():
                return ""
        worst = int(np.argmax(np.abs(excess / scale)))
        name = self.linear.names[worst]
        return f" ({name} accelerates with {excess[worst]:.4g} {per_second(self.system.units[worst], 2)})"

    def _advice(self, generator: Generator) -> str:
        """Return what may be meant instead of a motion that is not steady."""
        return BALANCED * bool(self._accelerating(generator)) + ADVICE

    def kink(self, order: int, resisting: frozenset[str] = frozenset()) -> str:
        """Return why the equations are not known to have `order` derivatives at the reference; empty: they have.

        With `resisting`, those of these forces are only what they are at rest.
        """
        if any(with_state(self.system)):
            from mbstab.analysis.verdict.smoothness import kinks

            motion = self.motion
            if found := kinks(self.system, motion.q, motion.u, motion.time, order, resisting=resisting):
                return found
        return self.singular

    @cached_property
    def rough(self) -> str:
        """Why the equations are not known to be smooth at the reference; empty: they are."""
        return self.kink(2)

    @cached_property
    def resisted(self) -> bool:
        """Whether they are smooth but for drag: then the energy may decide."""
        return not self.rough or not self.kink(2, self.structure.work.resisting)

    @cached_property
    def singular(self) -> str:
        """Why the rank of the constraints may be different near the reference; empty: it is the same.

        Independent rows remain so. Others may be redundant everywhere, or only at the
        reference; then the linearized equations are not those of the motions nearby.
        """
        spaces, system = self.motion.spaces, self.system
        n_c = system.n_c - system.n_h
        if (spaces.C.rank == system.n_h and spaces.W.rank == n_c) or not spaces.N.shape[1]:
            return ""
        sizes, rng = self.motion.sizes, RandomNumbers(3)
        for _ in range(TOLERANCES.rank_states):
            step = spaces.scale * (spaces.N @ rng.uniform(-1.0, 1.0, spaces.N.shape[1]))
            state = self._beside(step / float(np.max(np.abs(step) / sizes)))
            if state is None:
                return "the constraints leave other positions next to the reference than to first order"
            J = system.dynamics(state.q, state.u, self.motion.time).J
            if system.sparse:
                from mbstab.analysis.algebra.sparse_rank import sparse_rank, with_unit_rows

                ranks = sparse_rank(with_unit_rows(scaled(J, sizes)), TOLERANCES.row_singular_value).rank, 0
            else:
                ranks = _ranks(J * sizes, system.n_h)
            if ranks != (spaces.C.rank, spaces.W.rank):
                return (
                    f"the constraints have rank {spaces.C.rank + spaces.W.rank} at the reference and {sum(ranks)} next "
                    "to it: the linearized equations are not those of the motions nearby"
                )
        return ""

    def _beside(self, step: Array) -> OnRows | None:
        """Return a state in a direction that the rows allow to first order; short links are followed less far.

        How far is up to the independent rows alone: closer by, redundant ones that only touch look the same.
        """
        for distance in TOLERANCES.rank_state_distances:
            start = self.motion.q + distance * step
            near = self.invariance.onto_rows(start, self.motion.u, TOLERANCES.rank_state_misfit)
            if near is not None and float(np.max(np.abs(near.q - start) / self.motion.sizes)) <= 0.3 * distance:
                return self.invariance.onto_rows(start, self.motion.u)
        return None

    # --- structure of the spectrum ----------------------------------------------------------------------------------

    @cached_property
    def mirrored(self) -> str:
        """What makes the spectrum symmetric about the imaginary axis, in words; empty: nothing."""
        work = self.structure.work
        if work.conserved and (not self.linear.D_q.shape[0] or self._regular_energy()):
            return "the energy is conserved"
        if not np.any(self.motion.u) and work.reversible:
            return "the equations are the same backwards in time"
        if self.reversor is not None:
            return "the motion backwards in time is its mirror image"
        return ""

    def _regular_energy(self) -> bool:
        """Whether the second variation of a conserved energy is a regular form on the directions left to judge."""
        energy, B = self._co_moving, self.separated.B
        return energy.applies and B.shape[1] > 0 and not energy.on(B)[2]

    @cached_property
    def reversor(self) -> Reversor | None:
        """A reflection that, combined with time reversal, maps the motion to itself."""
        work = self.structure.work
        at_rest = not np.any(self.motion.u)
        known = (at_rest and work.reversible) or (work.conserved and not self.linear.D_q.shape[0])
        if known or work.dissipates or self.system.sparse or self.linear.massless is not None:
            return None  # not searched in large scenes
        from mbstab.analysis.verdict.reversor import reversor

        return reversor(self.structure)

    def minimum(self) -> Minimum | None:
        """Return the result of the energy criterion, or None."""
        return self.second_variation.minimum()

    def reversible(self) -> str:
        """Return why motions nearby are periodic, where a reversor has −1 as a simple eigenvalue."""
        if self.reversor is None or not self.reversor.simple:
            return ""
        return "the motion backwards in time is its mirror image, and it has a single frequency"

    def critical(self, count: int, others_decay: bool) -> Critical | None:
        """Return the verdict of the first nonlinear coefficient about a zero eigenvalue."""
        separated = self.separated
        if self.system.sparse or self.linear.massless is not None or self.digits is None:
            return None
        from mbstab.analysis.verdict.critical import critical_zero

        return critical_zero(self.structure, separated, count, others_decay, self.digits)

    def growth(self) -> str:
        """Return why disturbances grow like a power of t, where zeros form a chain; empty: not known."""
        if self.system.sparse or self.linear.massless is not None or self.digits is None:
            return ""
        from mbstab.analysis.verdict.growth import growing_zeros

        return growing_zeros(self.structure, self.digits)

    def fixed(self, left: int) -> str:
        """Return why motions that symmetries of the reference leave alone stay near, where all others decay."""
        if self.system.sparse:
            return ""
        from mbstab.analysis.verdict.fixed import fixed_motions

        return fixed_motions(self.structure, self.separated, left)

    def family(self, count: int) -> Neutral | None:
        """Return the neutral directions with a family of motions that was followed, unless many digits refute it."""
        if self.system.sparse or self.linear.massless is not None:
            return None
        from mbstab.analysis.verdict.families import family

        found = family(self.structure, self.separated, count)
        if found is None:
            return None
        if self.digits is None:  # a force that is zero by rounding alone makes no family
            return found if without_chance_zeros(self.system) is self.system else None
        return None if 0 <= self.digits.zeros(self.separated.frequencies()).number < found.count else found

    def zeros(self) -> int:
        """Return how many eigenvalues are zero to many digits; -1 if it is not known, as of large scenes."""
        return (
            -1 if self.digits is None or self.system.sparse else self.digits.zeros(self.separated.frequencies()).number
        )

    def facts(self, discs: Sequence[Disc], found: int, doubts: tuple[str, ...] = ()) -> Facts:
        """Return the facts with the eigenvalues left to judge, from any computation.

        Parameters
        ----------
        discs : sequence of Disc
        found : int
            Number of eigenvalues, including those of the neutral directions.
        """
        separated = self.separated
        # A disc that is entirely left or right of the axis is so whatever else is lost.
        lost = self.lost if separated.neutral.count or any(d.side in ("axis", "open") for d in discs) else ""
        doubts = (*doubts, *([lost] if lost else []))
        return Facts(
            expected=self.linear.n_f,
            found=found,
            discs=tuple(discs),
            neutral=separated.neutral,
            time=self.time,
            kink=self.kink(1),
            rough=self.rough,
            resisted=self.resisted,
            doubts=doubts,
            minimum=self.minimum,
            reversible=self.reversible,
            growth=self.growth,
            critical=self.critical,
            family=self.family,
            zeros=self.zeros,
            fixed=self.fixed,
            warnings=() if self.linear.massless is None else self.linear.massless.warnings,
            frequencies=self.second_variation.warnings,
        )


def _standing(linear: Linearization) -> Generator:
    """Return the steady motion with the speeds of the reference, in a frame that does not rotate."""
    zero = np.zeros(3)
    return Generator(linear.system, np.array([0.0, 0.0, 1.0]), zero, 0.0, zero, linear.motion.u)


def _ranks(J: Array, n_h: int) -> tuple[int, int]:
    """Return the rank of the holonomic rows, and of the others on the null space of those."""
    J = J / norms(J)[:, None]
    _, s, right = np.linalg.svd(J[:n_h])
    rank = int(np.sum(s > TOLERANCES.row_singular_value))
    left = J[n_h:] @ right[rank:].T
    return rank, int(np.sum(np.linalg.svd(left, compute_uv=False) > TOLERANCES.row_singular_value)) if left.size else 0
