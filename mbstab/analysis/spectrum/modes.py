"""A few eigenvalues of a scene of any size, and a verdict about all of them.

Those nearest to a number, or the rightmost that are found along the imaginary axis, come from shift-invert iterations
with bounds (`mbstab.analysis.spectrum.few`). The number right of the axis is counted separately
(`mbstab.analysis.spectrum.census`), so that the verdict, by the rule of `mbstab.analysis.verdict.rule`, does not
depend on the eigenvalues found. Without the count the answer is partial, and says so.

A scene given at rest is treated with sparse matrices from the file to the answer; others are linearized as for all
eigenvalues, at the same cost in memory. Where some motions carry no mass all eigenvalues are computed.
"""

from __future__ import annotations

import math
import numbers
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from mbstab.analysis.algebra.budget import Cost
from mbstab.analysis.algebra.rank import rank_of
from mbstab.analysis.algebra.sparse import dense
from mbstab.analysis.linear.linearize import Linearization, linearize
from mbstab.analysis.linear.sparse_equations import SparseEquations
from mbstab.analysis.reference.motion import Motion
from mbstab.analysis.reference.requested import reference_motion
from mbstab.analysis.reference.resting import Rest, at_rest
from mbstab.analysis.spectrum.census import Resting, census, resting
from mbstab.analysis.spectrum.eigenvalues import eigenvalues, inexact, mode_shapes, participation, with_saddles
from mbstab.analysis.spectrum.few import Few, far_right, few
from mbstab.analysis.spectrum.named_motions import Telling, mirrored
from mbstab.analysis.spectrum.results import Counts, EigenResult, Eigenvalue
from mbstab.analysis.spectrum.states_alone import states_alone
from mbstab.analysis.spectrum.tolerances import TOLERANCES
from mbstab.analysis.verdict.constancy import time_doubt
from mbstab.analysis.verdict.facts import Grounds
from mbstab.analysis.verdict.rule import Census, Disc, Facts, Minimum, Side, judge, side
from mbstab.analysis.verdict.smoothness import kinks
from mbstab.compiler.system import Array, System
from mbstab.errors import NumericalError, UsageError
from mbstab.model.schema import is_state
from mbstab.records import dataclass

METHOD = "shift-invert"


@dataclass(frozen=True)
class _Subject:
    """The equations that are judged, with sparse or dense matrices."""

    system: System
    motion: Motion | Rest
    equations: SparseEquations
    resting: Resting | None
    time: str
    kink: Callable[..., str]
    frame: str = ""


def modes(system: System, count: int, near: complex, rightmost: bool, force: bool = False) -> EigenResult:
    """Return a few eigenvalues with bounds, and a verdict about all.

    Parameters
    ----------
    system : System
    count : int
        Number of eigenvalues; a conjugate pair counts as one.
    near : complex (1/s)
        The eigenvalues nearest to it are computed.
    rightmost : bool
        Compute those with the largest real parts instead.
    force : bool
        Use dense matrices of any size for references not given at rest.

    Raises
    ------
    UsageError
        If there are fewer eigenvalues, arguments make no sense, or the motion is periodic.
    MbstabError
        As `mbstab.analysis.reference.requested.reference_motion`.
    """
    if not isinstance(near, numbers.Complex) or not np.isfinite(complex(near)):
        raise UsageError(f"near={near!r}: give a complex number (1/s), such as -1+5j")
    if rightmost and near:
        raise UsageError("near and rightmost exclude each other\nhint: leave out one of them")
    if system.scene.period is not None:
        message = "a periodic motion has multipliers, and all of them are computed"
        raise UsageError(f"{message}\nhint: ask without a number of modes")
    subject = _subject(system, force)
    equations = subject if isinstance(subject, Linearization) else subject.equations
    if count > equations.n_f:
        raise UsageError(
            f"{count} modes are asked for, there are {equations.n_f} finite eigenvalues\n"
            f"hint: give a number up to {equations.n_f}"
        )
    if isinstance(subject, Linearization):
        return _of_all(eigenvalues(subject), count, near, rightmost)
    equations = subject.equations
    if not equations.n_left:
        return _result(subject, few(equations, 0j, 0, False), census(equations, subject.resting), ())
    symmetric = subject.resting is not None and subject.resting.symmetric
    number = census(equations, subject.resting)
    if rightmost:
        found, warnings = _rightmost(equations, count, symmetric, number)
    else:
        found, warnings = few(equations, complex(near.real, abs(near.imag)), count, symmetric), ()
        found = found.only(np.arange(min(count, len(found.values))))
    both = int(np.sum(np.where(found.values.imag > 0.0, 2, 1)))
    if len(found.values) < count and both < equations.n_left:
        warnings += (
            f"{len(found.values)} of {count} modes were found: others are lost beside much faster or slower ones",
        )
    return _result(subject, found, number, warnings)


def _subject(system: System, force: bool) -> _Subject | Linearization:
    """Return the equations that are judged; those of motions without mass as they are."""
    rest = at_rest(system)
    if rest is None:
        if not force:
            Cost.of("motion", system.n_q, system.n_c).require()
        linear = linearize(system, reference_motion(system, massless=True))
        return _of_motion(linear) if linear.massless is None else linear
    structure = resting(system, rest.q, rest.time, len(rest.kept) - rest.rank_holonomic)
    return _Subject(
        system, rest, SparseEquations.of_rest(rest), structure, time_doubt(system),
        lambda order, *but: kinks(system, rest.q, 0.0 * rest.q, rest.time, order, False, *but),
    )  # fmt: skip


def _of_all(found: EigenResult, count: int, near: complex, rightmost: bool) -> EigenResult:
    """Return some of all eigenvalues, and the verdict about all."""
    upper = [e for e in found.eigenvalues if not e.exact and e.value.imag >= 0.0]
    upper.sort(key=lambda e: -e.value.real if rightmost else abs(e.value - complex(near.real, abs(near.imag))))
    kept = [e.value for e in upper[:count]]
    listed = [e for e in found.eigenvalues if e.exact or complex(e.value.real, abs(e.value.imag)) in kept]
    decided = all(e.kind != "undecided" for e in found.eigenvalues)
    right = sum(e.value.real > e.error_bound for e in found.eigenvalues) if decided else None
    counts = replace(found.counts, unstable_proven=right, counted="all eigenvalues were computed")
    return replace(found, eigenvalues=listed, counts=counts)


def _of_motion(linear: Linearization) -> _Subject:
    grounds, motion = Grounds(linear), linear.motion
    turning = linear.generator is not None and linear.generator.turns
    still = motion.at_rest and not turning and not np.any(motion.a)
    structure = resting(linear.system, motion.q, motion.time, motion.spaces.W.rank) if still else None
    equations, frame = SparseEquations.of_linearization(linear), str(linear.generator) if turning else ""
    return _Subject(linear.system, motion, equations, structure, grounds.time, grounds.kink, frame)


def _rightmost(equations: SparseEquations, count: int, symmetric: bool, number: Census) -> tuple[Few, tuple[str, ...]]:
    """Return the eigenvalues farthest to the right of all, or of those in discs along the axis, and warnings."""
    slowest = few(equations, 0j, count, symmetric)
    if not slowest.reach > 0.0 or slowest.reach > equations.fastest * (1.0 + 1e-2):
        parts, covered = [slowest], slowest.reach
    elif (others := far_right(equations, count, symmetric, slowest.reach)) is not None:
        # Slow ones have more digits where they were looked for.
        parts, covered = [slowest, *others], np.inf
    else:
        parts, covered = _along_axis(equations, slowest, count, symmetric)
    found = _union(parts)
    order = np.argsort(-found.values.real, kind="stable")[:count]
    warnings: tuple[str, ...] = ()
    if covered < equations.fastest:
        warnings = (f"the rightmost eigenvalues were looked for up to {covered:.6g} rad/s only",)
    growing = int(np.sum(np.where(found.values.imag > 0.0, 2, 1)[found.values.real > found.bounds]))
    if covered < np.inf and (number.right is None or number.right > growing):
        warnings += ("these are the rightmost of those near the imaginary axis; others may lie far to the right of it",)
    return found.only(order), warnings


def _along_axis(equations: SparseEquations, first: Few, count: int, symmetric: bool) -> tuple[list[Few], float]:
    """Return eigenvalues in discs along the imaginary axis, and up to where they cover it (rad/s)."""
    shift, parts, covered = 0j, [first], first.reach
    for _ in range(TOLERANCES.axis_shifts):
        shift = complex(0.0, shift.imag + TOLERANCES.axis_disc_overlap * parts[-1].reach)
        try:
            parts.append(few(equations, shift, count, symmetric))
        except NumericalError:
            # Far from all eigenvalues they are at equal distances, and none is found before the others.
            break
        covered = max(covered, shift.imag + parts[-1].reach)
        if not parts[-1].reach > 0.0 or covered > equations.fastest * (1.0 + 1e-2):
            break
    return parts, covered


def _union(parts: list[Few]) -> Few:
    """Return the union of several searches, each eigenvalue once."""
    first, *others = parts
    for other in others:
        distance = np.abs(other.values[:, None] - first.values)
        new = np.all(distance > np.maximum(1e-7 * np.abs(other.values), other.bounds)[:, None], axis=1)
        first = first.joined(other.only(new))
    return first


def _result(subject: _Subject, found: Few, number: Census, warnings: tuple[str, ...]) -> EigenResult:
    """Return eigenvalues with their types, and the verdict."""
    system, motion, equations, at_rest_ = subject.system, subject.motion, subject.equations, subject.resting
    conservative = at_rest_ is not None and at_rest_.conservative
    discs = [_disc(complex(s), float(r), conservative) for s, r in zip(found.values, found.bounds, strict=True)]
    both = [Disc(d.centre.conjugate(), d.radius, 1, d.side, d.why) for d in discs if d.centre.imag]
    neutral = equations.zeros
    total = len(discs) + len(both) + neutral
    facts = Facts(
        expected=equations.n_f, found=total, discs=(*discs, *both), time=subject.time, kink=subject.kink(1),
        rough=subject.kink(2), resisted=at_rest_ is not None and not subject.kink(2, at_rest_.resisting),
        minimum=lambda: _minimum(at_rest_, number),
        census=number,
    )  # fmt: skip
    verdict = judge(facts)
    listed: list[Eigenvalue] = []
    x = states_alone(equations, system.states[0], found.values, found.bounds, found.vectors)
    shares = participation(equations.matrices.M, equations.names, x)
    vectors = mode_shapes(equations.scale[:, None] * x, motion.sizes)
    telling = Telling.of(system, motion.q, motion.sizes, lambda: _allowed(equations))
    motions = telling.told(vectors)
    for i, (disc, share, vector) in enumerate(zip(discs, shares, vectors, strict=True)):
        e = Eigenvalue(
            disc.centre, _kind(disc), disc.radius, float(found.condition[i]), float(found.backward_error[i]),
            share, vector=vector, motions=motions[i],
        )  # fmt: skip
        listed.append(e)
        if disc.centre.imag:
            other = None if vector is None else vector.conj()
            listed.append(replace(e, value=disc.centre.conjugate(), vector=other, motions=mirrored(motions[i])))
    listed = with_saddles(listed)
    listed += [Eigenvalue(0j, "neutral", math.nan, math.nan, math.nan) for _ in range(neutral)]
    listed.sort(key=lambda e: (e.exact, -round(e.value.real, 12), abs(e.value.imag), -e.value.imag))
    counts = Counts(
        equations.n_q, system.n_h, system.n_n, equations.n_h, equations.matrices.J.shape[0] - equations.n_h,
        equations.n_f, total, neutral, 0, 0, unstable_proven=number.right, counted=number.how,
        states=sum(map(is_state, equations.names)),
    )  # fmt: skip
    return EigenResult(
        listed, verdict, counts, METHOD, (*motion.warnings, *inexact(listed, ""), *warnings, *verdict.warnings),
        subject.frame, coordinates=tuple(equations.names), units=system.units,
    )  # fmt: skip


def _allowed(equations: SparseEquations) -> Array:
    """Return a basis of the small motions that the holonomic rows allow."""
    return equations.scale[:, None] * rank_of(dense(equations.matrices.J[: equations.n_h])).null


def _disc(s: complex, radius: float, conservative: bool) -> Disc:
    """Return the disc of an eigenvalue with the side of the imaginary axis on which it lies."""
    if conservative and abs(s) > radius:
        # Squares are real: an eigenvalue is on one of both axes.
        if abs(s.imag) > radius:
            return Disc(complex(0.0, s.imag), radius, 1, "axis", "the energy is conserved")
        s = complex(s.real, 0.0)
    where: Side = side(s.real, radius)
    return Disc(s + 0.0, radius, 1, where)


def _kind(disc: Disc) -> str:
    if disc.side == "axis":
        return "center"
    if disc.side == "open":
        return "undecided"
    return ("un" if disc.side == "right" else "") + f"stable {'focus' if disc.centre.imag else 'node'}"


def _minimum(structure: Resting | None, number: Census) -> Minimum | None:
    """Return the result of the energy criterion: positive stiffness on all motions that the constraints allow."""
    if structure is None or not structure.stored or structure.why_not or not number.proven:
        return None
    return Minimum("the energy", number.right == 0 and not number.zeros, in_place=True)
