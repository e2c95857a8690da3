"""Stability of a periodic motion by its Floquet multipliers.

Disturbances are multiplied by μ in a period T, like exp(s t) with the exponents
s = log(μ)/T. Multipliers that symmetries and conserved functions explain are separated first, by the same
structure as for constant coefficients (`mbstab.analysis.verdict.neutral`), which here must hold at all times:
directions of symmetries, which Φ maps to each other, among them the shift in time (u, a) where
nothing depends on time; and differentials of momenta and of the energy, which Φ does not
change. The other multipliers are judged by the rule of `mbstab.analysis.verdict.rule`.

Where all forces have potentials at every instant and all rows are holonomic, Φ is symplectic:
with μ, 1/μ̄ is a multiplier too (Yakubovich and Starzhinskii 1975, chapter III).
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property

import numpy as np

from mbstab.analysis.algebra.arrays import Complex, norms
from mbstab.analysis.algebra.stacks import beside, complement
from mbstab.analysis.bounds.discs import Disc
from mbstab.analysis.linear.linearize import linearize
from mbstab.analysis.reference.element_comparison import State
from mbstab.analysis.reference.fields import Symmetry
from mbstab.analysis.reference.motion import Motion, motion_at
from mbstab.analysis.reference.symmetries import Invariance
from mbstab.analysis.spectrum.floquet import Monodromy, monodromy
from mbstab.analysis.spectrum.results import Counts, EigenResult, Eigenvalue
from mbstab.analysis.spectrum.tolerances import TOLERANCES
from mbstab.analysis.verdict.constancy import affine_drives, period_doubt, time_uses
from mbstab.analysis.verdict.directions import Ranks, misfit, span, vanishing
from mbstab.analysis.verdict.facts import Grounds
from mbstab.analysis.verdict.multipliers import enclosed, placed
from mbstab.analysis.verdict.neutral import Separated, chains_of, unseparated
from mbstab.analysis.verdict.rule import UNDECIDED, UNSTABLE, Facts, Minimum, Verdict, judge
from mbstab.analysis.verdict.rule import Disc as Exponent
from mbstab.analysis.verdict.smoothness import kinks
from mbstab.analysis.verdict.spectrum import Neutral
from mbstab.analysis.verdict.tolerances import TOLERANCES as VERDICT
from mbstab.analysis.verdict.wording import show
from mbstab.analysis.verdict.work import Work
from mbstab.compiler.system import Array, System
from mbstab.model.schema import is_angle
from mbstab.records import dataclass

INSTANTS = (0.0, 0.2360679775, 0.5278640450, 0.8196601125)
"""Fractions of the period at which structure must hold where something depends on time."""


def periodic_answer(
    system: System, motion: Motion, period: float, progress: Callable[[float], object] | None = None
) -> EigenResult:
    """Return the Floquet exponents (1/s) and multipliers of a periodic motion, with bounds and a verdict.

    Parameters
    ----------
    period : float (s)
    progress : callable, optional
        Called with the fraction of the work that is done, from 0 to 1.

    Raises
    ------
    MbstabError
        As `mbstab.analysis.spectrum.floquet.monodromy`.
    """
    flow = monodromy(system, motion, period, progress)
    cycle, warnings = Cycle(system, motion, flow), motion.warnings
    if (times := cycle.periods) > 1:
        stated, period = period, times * period
        told = (
            f"the motion repeats after {times} times the stated period of {stated:.6g} s, when angles are whole turns"
        )
        warnings = (*warnings, f"{told}: that is its period")
        cycle = Cycle(system, motion, flow := monodromy(system, motion, period, progress))
    separated = cycle.separated
    size = max(1.0, float(np.linalg.norm(flow.Phi, 2))) if len(flow.Phi) else 1.0
    error = flow.error + TOLERANCES.mismatch_factor * flow.mismatch * size
    values, discs = enclosed(separated.B.T @ flow.Phi @ separated.B, error)
    exponents = placed(discs, period, cycle.mirrored)
    neutral = cycle.multipliers()
    facts = Facts(
        expected=motion.spaces.n_f,
        found=len(values) + len(neutral),
        discs=tuple(exponents),
        neutral=separated.neutral,
        time=cycle.time,
        kink=cycle.kink(1),
        rough=cycle.kink(2),
        minimum=cycle.minimum,
        multipliers=True,
    )
    judged = _worded(judge(facts), discs, exponents)
    found = _listed(values, discs, exponents, error, period)
    found += [Eigenvalue(cmath.log(x) / period, "neutral", math.nan, math.nan, math.nan, multiplier=x) for x in neutral]
    spaces = motion.spaces
    counts = Counts(
        system.n_q, system.n_h, system.n_n, spaces.C.rank, spaces.W.rank, spaces.n_f, len(found), len(neutral), 0, 0,
        states=len(system.states[0]),
    )  # fmt: skip
    return EigenResult(
        found, judged, counts, "floquet", (*warnings, *judged.warnings), period=period,
        neutral_directions=separated.neutral.names,
    )  # fmt: skip


def _listed(
    values: Complex, discs: list[Disc], exponents: list[Exponent], error: float, period: float
) -> list[Eigenvalue]:
    """Return the multipliers with their exponents and bounds, those that grow fastest first."""
    found = []
    for disc, exponent in zip(discs, exponents, strict=True):
        for i in disc.members:
            mu = complex(values[i])
            s = cmath.log(mu or 1e-300) / period if mu == mu else mu
            off = disc.radius + abs(mu - disc.centre)
            bound = -math.log1p(-off / abs(mu)) / period if abs(mu) > off else math.inf
            form = "focus" if s.imag else "node"
            kinds = {"left": f"stable {form}", "right": f"unstable {form}", "axis": "center"}
            kind = kinds.get(exponent.side, "undecided")
            found.append(Eigenvalue(s, kind, bound, off / error if error else math.nan, error, multiplier=mu))
    return sorted(found, key=lambda e: (-round(e.value.real, 12), abs(e.value.imag), -e.value.imag))


def _worded(judged: Verdict, discs: list[Disc], exponents: list[Exponent]) -> Verdict:
    """Return a verdict worded for periodic motions."""
    growing = [(e.centre.real, d, e) for d, e in zip(discs, exponents, strict=True) if e.side == "right"]
    if judged.word == UNSTABLE and growing:
        _, disc, exponent = max(growing, key=lambda x: x[0])
        what = f"multiplier {show(disc.centre)}, exponent known to {exponent.radius:.1e} 1/s"
        reason = f"disturbances grow by the factor {abs(disc.centre):.6g} in a period ({what})"
        return replace(judged, reasons=(reason,))
    if judged.word == UNDECIDED:
        return replace(judged, reasons=tuple(x.replace("eigenvalue", "exponent") for x in judged.reasons))
    return judged


@dataclass(frozen=True)
class _Conserved:
    """A conserved function: the name of what its value distinguishes, and its differential."""

    name: str
    dq: Array
    du: Array


class Cycle:
    """The structure of a periodic motion; each part is computed at first use.

    Parameters
    ----------
    system : System
    motion : Motion
        The motion at the start of the period.
    flow : Monodromy
    """

    def __init__(self, system: System, motion: Motion, flow: Monodromy) -> None:
        self.system, self.motion, self.flow = system, motion, flow
        self.constant = not time_uses(system)
        self.moving = bool(np.max(np.abs(flow.path[:, 1] * flow.period / motion.sizes)) > TOLERANCES.rest_in_period)

    @cached_property
    def invariances(self) -> list[Invariance]:
        """The structure at the start, and at other instants where something depends on time."""
        found = [Invariance(self.system, self.motion)]
        for part in INSTANTS[1:] if not self.constant else ():
            i = int(np.argmin(np.abs(self.flow.times - self.motion.time - part * self.flow.period)))
            q, u = self.flow.path[i]
            found.append(Invariance(self.system, motion_at(self.system, q, u, float(self.flow.times[i]))))
        return found

    # --- time and smoothness ----------------------------------------------------------------------------------------

    @cached_property
    def time(self) -> str:
        """Why the equations are not known to repeat after the period; empty: they do."""
        elsewhere = self._elsewhere()
        broken = [use.path for use in affine_drives(self.system)] if elsewhere else []
        return period_doubt(self.system, self.flow.period, broken) or elsewhere

    @property
    def periods(self) -> int:
        """The number of periods after which all angles have made whole turns, 1 if that is not needed or not found."""
        if not self._elsewhere():
            return 1
        angles = np.array([is_angle(name) for name in self.system.names])
        for number in range(2, TOLERANCES.periods_to_whole_turns + 1):
            advance = number * self.flow.advance
            left = advance - np.where(angles, 2.0 * math.pi * np.round(advance / (2.0 * math.pi)), 0.0)
            if np.all(np.abs(left) <= number * TOLERANCES.periodicity * self.motion.sizes):
                return number
        return 1

    def _elsewhere(self) -> str:
        """Say where the motion is after the period, unless that is the same by a symmetry."""
        names, sizes = self.system.names, self.motion.sizes
        angles = np.array([is_angle(name) for name in names])
        turns = np.where(angles, 2.0 * math.pi * np.round(self.flow.advance / (2.0 * math.pi)), 0.0)
        off = self.flow.advance - turns
        advance = turns + np.where(np.abs(off) > TOLERANCES.periodicity * sizes, off, 0.0)
        if not np.any(advance) or all(self._carried(invariance, advance) for invariance in self.invariances):
            return ""
        worst = int(np.argmax(np.abs(advance / sizes)))
        there = f"{names[worst]} by {advance[worst]:.6g} {self.system.units[worst]}"
        return f"after the period the motion is elsewhere ({there}), and what acts there is not known to be the same"

    def _carried(self, invariance: Invariance, advance: Array) -> bool:
        """Return whether all elements and rows are the same some periods later, after a shift in each period."""
        one = np.eye(len(advance))
        if not invariance.states:
            return False
        for number in TOLERANCES.periods_later:
            for element in invariance.elements:
                for state in invariance.states:
                    there = State(state.q + number * advance, state.u, state.a)
                    if not invariance.same(element, state, there, one, exact=False):
                        return False
            for state in invariance.on_rows:
                if not invariance.keeps_rows(state, state.q + number * advance, number * self.flow.period):
                    return False
        return True

    def kink(self, order: int) -> str:
        """Return why the equations are not known to have `order` continuous derivatives along the motion."""
        q, u = np.moveaxis(self.flow.path, 1, 0)
        return kinks(self.system, q, u, self.flow.times, order, along=True)

    # --- structure of the multipliers -------------------------------------------------------------------------------

    @cached_property
    def potentials(self) -> bool:
        """Whether all forces have potentials at every instant."""
        works = [Work(invariance, None) for invariance in self.invariances]
        return not any(found for work in works for kind, found in work.kinds.items() if kind != "potential")

    @cached_property
    def mirrored(self) -> str:
        """What makes the multipliers symmetric about the unit circle, in words; empty: nothing."""
        if self.system.n_n or not self.potentials:
            return ""
        return "the energy is conserved" if self.constant else "all forces have potentials at every instant"

    @cached_property
    def symmetries(self) -> list[Symmetry]:
        """Symmetries at all times."""
        first, *others = self.invariances
        return [item for item in first.symmetries if all(x.carries(item.of) for x in others)]

    @cached_property
    def boosts(self) -> list[Symmetry]:
        """Shifts among the symmetries that may also be added to the speeds, at all times."""
        first, *others = self.invariances
        kept = {id(item.of) for item in self.symmetries}
        return [
            item
            for item in first.boosts
            if id(item.of) in kept
            and all(any(np.array_equal(item.direction, x.direction) for x in other.boosts) for other in others)
        ]

    def minimum(self) -> Minimum | None:
        """Return the result of the energy criterion for a motion at rest, which has every period."""
        if not self.constant or self.moving:
            return None
        grounds = Grounds(linearize(self.system, self.motion))
        return None if grounds.time or not grounds.resisted else grounds.minimum()

    def _conserved(self) -> list[_Conserved]:
        """Return the functions that are constant along every motion, with their differentials at the start."""
        system, motion = self.system, self.motion
        if any(not x.conserves(item.of) for item in self.boosts for x in self.invariances):
            return []
        zero, rows = np.zeros(system.n_q), np.zeros(system.n_c)
        # ∂(M w)/∂q for w = u, and the momenta M u.
        bent = system.linearize(motion.q, zero, motion.u, rows, motion.time)[0]
        bent = bent - system.linearize(motion.q, zero, zero, rows, motion.time)[0]
        M = motion.dynamics.M
        p = M @ motion.u
        found = []
        for item in self.symmetries:
            if all(x.conserves(item.of) for x in self.invariances):
                dq = item.direction @ bent + p @ item.of.slope(motion.q)
                found.append(_Conserved(f"speed of {item.name}", dq, item.direction @ M))
        if self.constant and self.moving and Work(self.invariances[0], None).conserved_at_rest:
            forces = system.dynamics(motion.q, zero, motion.time).F0
            found.append(_Conserved("energy", 0.5 * motion.u @ bent + forces, p))
        return found

    @cached_property
    def separated(self) -> Separated:
        """Φ − 1 with its neutral directions."""
        flow, motion = self.flow, self.motion
        n = len(flow.Phi)
        names, zero = [item.name for item in self.symmetries], np.zeros(self.system.n_q)
        moved = [np.concatenate([item.direction, item.rate]) for item in self.symmetries]
        moved += [np.concatenate([zero, item.direction]) for item in self.boosts]
        family = [f"speed along {item.name.removeprefix('translation along ')}" for item in self.boosts]
        columns = flow.to_components @ np.array(moved).reshape(len(moved), 2 * len(zero)).T
        T = span(columns)
        if self.constant and self.moving and n:
            # A later state of the same motion.
            wider = span(columns, flow.to_components @ np.concatenate([motion.u, motion.a])[:, None])
            names += ["the motion itself"] if wider.shape[1] > T.shape[1] else []
            T = wider
        L, kept = self._differentials(T)
        change = flow.Phi - np.eye(n)
        found = Separated(change, T, L, complement(beside(T, L.T)), Neutral())
        count = T.shape[1] + len(L)
        # Rounding errors do not drive anything.
        steady = np.where(np.abs(change) > TOLERANCES.mismatch_factor * flow.error, change, 0.0)
        neutral = Neutral(
            tuple(names),
            (*family, *kept),
            count,
            chains_of(replace(found, S=steady)),
            "numerical" if count else "structural",
        )
        size = max(1.0, float(np.linalg.norm(flow.Phi, 2))) if n else 1.0
        allowed = (VERDICT.direction_closure + TOLERANCES.mismatch_factor * flow.mismatch) * size
        fits = misfit(change, T, L) <= allowed + TOLERANCES.mismatch_factor * flow.error
        return replace(found, neutral=neutral) if fits else unseparated(change)

    def _differentials(self, T: Array) -> tuple[Array, list[str]]:
        """Return independent differentials that vanish on T, as orthonormal rows, and what their values distinguish."""
        flow, candidates = self.flow, self._conserved()
        n = len(T)
        rows = np.array([x.dq @ flow.to_coordinates + x.du @ flow.to_rates for x in candidates]).reshape(
            len(candidates), n
        )
        rows = rows / norms(rows)[:, None]
        L, names = vanishing(rows, T, Ranks(), "functions"), list[str]()
        for differential in L:
            shares = [(-abs(row @ differential), x.name) for row, x in zip(rows, candidates, strict=True)]
            names.append(min(x for x in shares if x[1] not in names)[1])
        return L, names

    def multipliers(self) -> list[complex]:
        """Return the multipliers of the neutral directions: 1, or on the unit circle where a turn is incomplete."""
        found = self.separated
        values = np.linalg.eigvals(found.T.T @ found.S @ found.T) + 1.0 if found.T.shape[1] else np.zeros(0)
        turned = [
            complex(x / abs(x)) if abs(x - 1.0) > TOLERANCES.multiplier_turned else 1.0 + 0j for x in values.tolist()
        ]
        return turned + [1.0 + 0j] * (found.neutral.count - len(turned))
