"""The verdict on the stability of a motion, from facts about it.

Every command collects the strongest facts that it can, and `judge` turns them into a
verdict; there is no second rule. With A the matrix of the disturbances, T the directions of
verified symmetries and families of steady motions, and A_⊥ the quotient of A by T:

1.  unstable: a disc that contains at least one eigenvalue lies right of the imaginary axis
    (Lyapunov 1892);
2.  asymptotically stable: all eigenvalues lie left of it (Lyapunov 1892);
3.  asymptotically stable up to symmetry: those of A_⊥ lie left of it (Lyapunov 1892, Malkin 1952; Fenichel
    1971; Krupa 1990); only stable up to symmetry at rest where momenta of rotations that do not commute are
    conserved: small momenta stay small (Carr 1981), and bodies with them may tumble;
4.  stable, possibly up to symmetry: a function that never increases has a strict minimum, modulo
    the symmetries and at the given momenta (Lagrange, Dirichlet, Routh; Simo, Lewis, Marsden
    1991; Ortega, Ratiu 1999);
5.  stable up to symmetry: the motion is reversible and A_⊥ has a single pair on the axis (Devaney
    1976; Sevryuk 1986);
    or all decays but motions that the symmetries of the reference leave alone, and the energy of these has a strict
    minimum (Pliss 1964; Carr 1981; Vanderbauwhede 1989);
6.  marginally stable: no eigenvalue of A_⊥ lies right of the axis, and each that does not lie left
    of it is simple and held on it by a structure of the equations;
7.  zeros of A_⊥, the others left: the first nonlinear coefficient of a single one decides (Lyapunov 1892;
    Carr 1981); a chain of three grows where the equations are linear;
8.  undecided: everything else.

Where only a few eigenvalues are computed, rules 1, 2 and 4 still apply if the number of those right of the axis is
known (`Census`).

What is not known is never taken as harmless: an eigenvalue that is not located, a count that
differs, or a kink or time dependence that is not understood leaves the answer undecided.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Literal, get_args

import numpy as np

from mbstab.analysis.algebra.arrays import Complex, Flags
from mbstab.analysis.verdict.spectrum import Evidence, Modulo, Neutral, Spectrum
from mbstab.analysis.verdict.wording import REST, drifting, phrases, power, show, strict, unplaced
from mbstab.compiler.system import Array
from mbstab.errors import amount, counted
from mbstab.model.words import ASYMPTOTIC as ASYMPTOTIC
from mbstab.model.words import ASYMPTOTIC_UP_TO as ASYMPTOTIC_UP_TO
from mbstab.model.words import MARGINAL as MARGINAL
from mbstab.model.words import REQUIRED as REQUIRED
from mbstab.model.words import STABLE as STABLE
from mbstab.model.words import STABLE_UP_TO as STABLE_UP_TO
from mbstab.model.words import STRENGTH as STRENGTH
from mbstab.model.words import UNDECIDED as UNDECIDED
from mbstab.model.words import UNSTABLE as UNSTABLE
from mbstab.model.words import WORDS as WORDS
from mbstab.records import Answer, dataclass

Side = Literal["left", "right", "axis", "open"]
Sides = np.ndarray[tuple[Any, ...], np.dtype[np.int8]]

RIGHT, LEFT, AXIS, OPEN = 1, -1, 0, 2
"""Sides of the imaginary axis: right and left of it, held on it by a structure, undecided."""

NAMES: dict[int, Side] = {RIGHT: "right", LEFT: "left", AXIS: "axis", OPEN: "open"}

Zeros = Literal["", "neutral", "critical"]
Extremum = Literal["minimum", "maximum", "with a multiple"]

LINEAR = "up to symmetries the equations are linear and no solution of theirs grows: motions nearby stay near"
DRIFTS = "; only this offset may drift "
NONLINEAR = "whether disturbances stay small in the long run depends on nonlinear terms"


@dataclass(frozen=True)
class Disc:
    """A disc of the complex plane that contains `count` eigenvalues of A_⊥.

    Attributes
    ----------
    centre : complex (1/s)
    radius : float (1/s)
        inf or nan where nothing is known.
    count : int
    side : str
        ``left`` or ``right`` of the imaginary axis, held on the ``axis`` by a structure, or ``open``.
    why : str
        The structure that holds it on the axis.
    """

    centre: complex
    radius: float
    count: int
    side: Side
    why: str = ""

    @property
    def holds_zero(self) -> bool:
        """Whether zero is not excluded."""
        return not abs(self.centre) > self.radius


@dataclass(frozen=True)
class Minimum:
    """A function that never increases along motions, and its extremum at the reference.

    Attributes
    ----------
    name : str
        Its name: ``the energy``, ``the energy in the frame of the motion``.
    definite : bool
        Whether it has a strict minimum (or maximum), modulo symmetries and at the given momenta.
    in_place : bool
        Whether the extremum is unrestricted: no symmetry and no momentum is left out.
    kind : str
        ``minimum``, ``maximum``, or ``with a multiple`` of the angular momentum a minimum. Damping destroys the
        stability of the last two.
    evidence : str
    linear : bool
        Whether the equations are linear.
    """

    name: str
    definite: bool
    in_place: bool
    kind: Extremum = "minimum"
    evidence: Evidence = "numerical"
    linear: bool = False


@dataclass(frozen=True)
class Critical:
    """The verdict of the first nonlinear coefficient about a single zero eigenvalue.

    Attributes
    ----------
    verdict : str
        `UNSTABLE`, `ASYMPTOTIC` (`ASYMPTOTIC_UP_TO` beside neutral directions), or `STABLE` by the form of the energy.
    reason : str
    evidence : str
    family : str
        The quantity that distinguishes the members of a family that was followed; empty: there is none.
    drift : int
        Power of t with which disturbances along neutral directions and the critical one grow; 0: they do not grow.
    """

    verdict: str
    reason: str
    evidence: Evidence = "numerical"
    family: str = ""
    drift: int = 0


@dataclass(frozen=True)
class Census:
    """Numbers of eigenvalues by location, counted without computing them.

    Attributes
    ----------
    right : int or None
        Number of eigenvalues right of the imaginary axis; None: not counted.
    least : int
        Lower bound of this number.
    zeros : int
        Number of zeros that were separated: squares of the stiffness or eigenvalues.
    left : bool
        Whether all eigenvalues lie left of the axis.
    how : str
        How they are counted, in words; or why they are not.
    proven : bool
        Whether the count is exact for all matrices within rounding; else it rests on estimates.
    """

    right: int | None
    least: int = 0
    zeros: int = 0
    left: bool = False
    how: str = ""
    proven: bool = True


@dataclass(frozen=True)
class Facts:
    """What is known about a motion.

    Attributes
    ----------
    expected, found : int
        Numbers of finite eigenvalues that exist and that were found (including those of `neutral`).
    discs : tuple of Disc
        Discs of the eigenvalues of A_⊥.
    neutral : Neutral
    time : str
        Why the coefficients are not known to be constant, or periodic with the stated period; empty: they are.
    kink : str
        Why the equations are not known to have a linearization at the reference; empty: they have.
    rough : str
        Why they are not known to be smooth; empty: they are. Otherwise only eigenvalues may decide, …
    resisted : bool
        … or the energy, where only drag is not smooth.
    doubts : tuple of str
        Other doubts, which prevent every verdict but instability.
    minimum : callable
        Returns a `Minimum`, or None; called only where eigenvalues do not decide.
    reversible : callable
        Returns in words why the motion is reversible with −1 as a simple eigenvalue of the
        reversor (rule 5), or an empty text.
    growth : callable
        Returns why disturbances grow like a power of t, or an empty text. Called where zeros alone are left.
    critical : callable
        Takes the number of eigenvalues at zero and whether all others decay; returns a
        `Critical`, or None. Called where zeros alone are left.
    family : callable
        Takes the number of unexplained zero eigenvalues; returns the `Neutral` in which
        a family that was followed explains them, or None.
    fixed : callable
        Takes the number of eigenvalues left of the axis; returns why motions stay near that symmetries of the reference
        leave alone, where all others decay, or an empty text.
    zeros : callable
        Returns the number of eigenvalues that are zero exactly, explained ones included; −1: not known.
    warnings : tuple of str
    frequencies : callable
        Returns warnings about stability that nonlinear resonance or damping may destroy.
    multipliers : bool
        Whether the eigenvalues are Floquet exponents.
    census : Census or None
        Where only a few eigenvalues are computed: the count of all; None: all are computed.
    """

    expected: int
    found: int
    discs: tuple[Disc, ...]
    neutral: Neutral = Neutral()
    time: str = ""
    kink: str = ""
    rough: str = ""
    resisted: bool = False
    doubts: tuple[str, ...] = ()
    minimum: Callable[[], Minimum | None] = lambda: None
    reversible: Callable[[], str] = lambda: ""
    growth: Callable[[], str] = lambda: ""
    critical: Callable[[int, bool], Critical | None] = lambda count, others: None
    family: Callable[[int], Neutral | None] = lambda count: None
    zeros: Callable[[], int] = lambda: -1
    fixed: Callable[[int], str] = lambda left: ""
    warnings: tuple[str, ...] = ()
    frequencies: Callable[[], tuple[str, ...]] = tuple
    multipliers: bool = False
    census: Census | None = None

    def energy(self) -> Minimum | None:
        """Return a strict extremum of a function that never increases, if there is one and it decides."""
        minimum = None if self.rough and not self.resisted else self.minimum()
        return minimum if minimum is not None and minimum.definite else None


@dataclass(frozen=True)
class IfSymmetric:
    """The verdict of a scene with more symmetries, whose decimals differ from the file by less than their last digits.

    Attributes
    ----------
    about : tuple of str
        The further symmetries.
    verdict : str
    """

    about: tuple[str, ...]
    verdict: str

    def __str__(self) -> str:
        """Return it as a sentence."""
        return f"symmetric within the digits of the file: {', '.join(self.about)}; if exact: {self.verdict}"


@dataclass(frozen=True)
class Verdict:
    """The verdict on the stability of a motion.

    Attributes
    ----------
    word : str
        One of `WORDS`.
    reasons : tuple of str
        Its grounds, in sentences.
    symmetries, family : tuple of str
        Those up to which it holds.
    in_place : bool or None
        Whether disturbed motions also stay near the reference itself, not only near its family; None: not claimed.
    evidence : str
        The weakest fact it rests on: ``structural``, ``enclosed`` or ``numerical``.
    warnings : tuple of str
    zeros : str
        What eigenvalues that cannot be told from zero are: ``neutral``, explained by a family of motions, or
        ``critical``, zeros that nonlinear terms judge; empty: they are not known to be zero.
    spectrum : Spectrum or None
        Where the eigenvalues lie; None where there is no linearization, or nothing to judge.
    if_symmetric : IfSymmetric or None
        The verdict of a scene within the digits of the file that has more symmetries; nothing else rests on it.
    """

    word: str
    reasons: tuple[str, ...]
    symmetries: tuple[str, ...] = ()
    family: tuple[str, ...] = ()
    in_place: bool | None = None
    evidence: Evidence = "numerical"
    warnings: tuple[str, ...] = ()
    zeros: Zeros = ""
    spectrum: Spectrum | None = None
    if_symmetric: IfSymmetric | None = None

    @property
    def modulo(self) -> Modulo:
        """Symmetries and families up to which it holds."""
        return Modulo(self.symmetries, self.family)


class Judged(Answer):
    """An answer with a verdict, `judged`."""

    judged: Verdict

    @property
    def verdict(self) -> str:
        """The word of the verdict, one of `mbstab.analysis.verdict.rule.WORDS`."""
        return self.judged.word

    @property
    def reasons(self) -> tuple[str, ...]:
        """What the verdict rests on, in sentences."""
        return self.judged.reasons

    @property
    def modulo(self) -> Modulo:
        """Symmetries and families of motions up to which the verdict holds."""
        return self.judged.modulo

    @property
    def spectrum(self) -> Spectrum | None:
        """Where the eigenvalues lie, whatever the verdict; None where there is no linearization."""
        return self.judged.spectrum

    @property
    def if_symmetric(self) -> IfSymmetric | None:
        """The verdict of a scene within the digits of the file that has more symmetries; None: there is none."""
        return self.judged.if_symmetric

    @property
    def in_place(self) -> bool | None:
        """Whether disturbed motions stay near the reference itself; None: not claimed."""
        return self.judged.in_place

    @property
    def evidence(self) -> str:
        """The weakest fact that the verdict rests on: ``structural``, ``enclosed`` or ``numerical``."""
        return self.judged.evidence


def side(real: float, radius: float) -> Side:
    """Return on which side of the imaginary axis a disc lies; what is not known lies on none."""
    return "right" if real > radius else "left" if real < -radius else "open"


def place(centres: Sequence[complex], radii: Sequence[float], counts: Sequence[int], mirrored: str) -> tuple[Disc, ...]:
    """Return the discs with the side of the axis on which they lie.

    Parameters
    ----------
    centres, radii, counts : sequences of the same length
        Disjoint discs.
    mirrored : str
        In words, what makes the spectrum symmetric to the imaginary axis; empty: nothing does.
        Then a disc is held on the axis if it contains one eigenvalue and no other disc overlaps its
        mirror image: the image of the eigenvalue is one as well, so it can only be itself.
    """
    found = sides(np.array(centres, dtype=complex), np.array(radii, dtype=float), bool(mirrored), np.array(counts) == 1)
    named = ((NAMES[x], mirrored if x == AXIS else "") for x in found.tolist())
    return tuple(
        Disc(complex(centre), float(radius), count, where, why)
        for centre, radius, count, (where, why) in zip(centres, radii, counts, named, strict=True)
    )


def sides(centres: Complex, radii: Array, mirrored: bool, single: Flags | bool = True) -> Sides:
    """Return the sides of discs, shape (…, r), as `place`, in numbers; `single` says which contain one eigenvalue."""
    found = np.where(centres.real > radii, RIGHT, np.where(centres.real < -radii, LEFT, OPEN)).astype(np.int8)
    where = np.nonzero(single & (found == OPEN) & (np.abs(centres) > radii)) if mirrored else ((),)
    if len(where[0]):
        others, reach = centres[where[:-1]], radii[where[:-1]]
        apart = np.abs(others + centres[where][:, None].conj()) > reach + radii[where][:, None]
        apart[np.arange(len(apart)), where[-1]] = True
        found[where] = np.where(apart.all(axis=1), AXIS, OPEN)
    return found


def judge(facts: Facts) -> Verdict:
    """Return the strongest verdict that the facts allow, with the linear statement."""
    verdict = _verdict(facts)
    if verdict.spectrum is not None or facts.kink or not facts.expected:
        return verdict
    return replace(verdict, spectrum=_spectrum(facts, verdict))


def _spectrum(facts: Facts, verdict: Verdict) -> Spectrum:
    """Return where the eigenvalues lie."""
    if facts.census is not None:
        right = facts.census.right
        return Spectrum(right, None, None, None if right is None else 0, instant=bool(facts.time))
    number = {side: sum(d.count for d in facts.discs if d.side == side) for side in get_args(Side)}
    near_zero = sum(d.count for d in facts.discs if d.side == "open" and d.holds_zero)
    neutral, explained, zeros = facts.neutral, facts.neutral.count, 0
    names, chains = neutral.names, neutral.chains
    if verdict.zeros == "neutral":
        explained, names, chains = explained + near_zero, verdict.modulo.names, None
    elif near_zero and (verdict.word != UNSTABLE or verdict.zeros):
        exactly = sum(d.count for d in facts.discs if d.side == "open" and d.centre == d.radius == 0.0)
        zeros = exactly or min(max(facts.zeros() - explained, 0), near_zero)
    rest = number["open"] - zeros - (near_zero if verdict.zeros == "neutral" else 0)
    bounded = verdict.word in REQUIRED["marginal"]
    return Spectrum(
        number["right"], number["left"], number["axis"],
        max(facts.expected - facts.found, 0) + (0 if bounded else rest), rest if bounded else 0,
        zeros, explained, chains, names, facts.multipliers, bool(facts.time),
    )  # fmt: skip


def _verdict(facts: Facts) -> Verdict:
    """Return the strongest verdict that the facts allow."""
    undecided = _obstacle(facts)
    if undecided:
        return Verdict(UNDECIDED, undecided, warnings=facts.warnings)
    growing = [d for d in facts.discs if d.side == "right"]
    if growing:
        return Verdict(UNSTABLE, (_growth(max(growing, key=lambda d: d.centre.real), facts),), warnings=facts.warnings)
    if facts.census is not None:
        return _counted(facts, facts.census)
    doubts = _doubts(facts)
    if doubts:
        return Verdict(UNDECIDED, doubts, warnings=facts.warnings)
    neutral = facts.neutral
    left = sum(d.count for d in facts.discs)
    decays = left and all(d.side == "left" for d in facts.discs)
    if decays and not (facts.rough and neutral.count):
        return _decaying(facts)
    # The energy gives a stronger verdict where it bounds the speeds of a scene at rest.
    if (left or neutral.slow) and (minimum := facts.energy()) is not None:
        return _by_energy(facts, minimum)
    if facts.rough:
        return Verdict(UNDECIDED, (facts.rough,), warnings=facts.warnings)
    if not left:
        drifts = _drifting(neutral, True)
        return _up_to(facts, STABLE_UP_TO, f"every motion nearby is of the same kind: {_differ(neutral)}{drifts}")
    on_axis = [d for d in facts.discs if d.side == "axis"]
    rest = [d for d in facts.discs if d.side == "open"]
    warnings = facts.warnings + facts.frequencies()
    if not rest:
        if len(on_axis) == len(facts.discs) == 2 and neutral.count and (why := facts.reversible()):
            return _up_to(facts, STABLE_UP_TO, f"{why}, so motions nearby repeat themselves, {_except(neutral)}")
        if neutral.linear and all(d.count == 1 for d in on_axis):
            return _up_to(facts, STABLE_UP_TO, f"{LINEAR}, {_except(neutral)}")
        number = sum(d.count for d in on_axis)
        where = "of absolute value 1" if facts.multipliers else "on the imaginary axis"
        kind = "multipliers are" if facts.multipliers else "eigenvalues lie"
        reasons = [f"{number} {kind} {where}, held there because {on_axis[0].why}, and none beyond it: {NONLINEAR}"]
        if neutral.checked:
            reasons.append(f"as far as checked: {neutral.checked}")
        return Verdict(MARGINAL, tuple(reasons), neutral.symmetries, neutral.family, None, neutral.evidence, warnings)
    zeros = sum(d.count for d in rest)
    left_of_it = sum(d.count for d in facts.discs if d.side == "left")
    if not any(d.holds_zero for d in rest) and (why := facts.fixed(left_of_it)):
        return _up_to(facts, STABLE_UP_TO, f"{why}: small disturbances stay small, {_except(neutral)}")
    if any(d.holds_zero for d in rest) and (grows := facts.growth()):
        return Verdict(UNSTABLE, (grows,), warnings=facts.warnings, zeros="critical")
    if all(d.holds_zero for d in rest) and (critical := facts.critical(zeros, not on_axis)) is not None:
        return _critical(facts, critical)
    if all(d.holds_zero for d in rest) and (wider := facts.family(zeros)) is not None:
        left_over = tuple(d for d in facts.discs if d not in rest)
        return replace(judge(replace(facts, discs=left_over, neutral=wider, minimum=lambda: None)), zeros="neutral")
    return Verdict(UNDECIDED, tuple(unplaced(d) for d in rest if d.centre.imag >= 0.0), warnings=facts.warnings)


def _counted(facts: Facts, census: Census) -> Verdict:
    """Return the verdict where a few eigenvalues were computed, none of which grows, and the others counted."""
    few = f"{facts.found} of {facts.expected} eigenvalues were looked for and found"
    if census.least:
        exactly = "" if census.right is not None else ", at least"
        verb = "lies" if census.least == 1 else "lie"
        reason = (
            f"{counted(census.least, 'eigenvalue')}{exactly} {verb} right of the imaginary axis, counted {census.how}"
        )
        return Verdict(UNSTABLE, (reason,), warnings=facts.warnings)
    if census.right is None:
        reason = f"{few}, none of them grows; the others were not looked for, and they are not counted: {census.how}"
        return Verdict(UNDECIDED, (reason, *facts.doubts), warnings=facts.warnings)
    none = f"no eigenvalue lies right of the imaginary axis, counted {census.how}"
    if facts.doubts:
        return Verdict(UNDECIDED, (*facts.doubts, none), warnings=facts.warnings)
    if census.left:
        found = _decaying(facts)
        return replace(found, reasons=(*found.reasons, f"counted {census.how}; {few}"))
    if (minimum := facts.energy()) is not None:
        found = _by_energy(facts, minimum)
        return replace(found, reasons=(*found.reasons, none))
    if facts.rough:
        return Verdict(UNDECIDED, (facts.rough, none), warnings=facts.warnings)
    zeros = f", and {counted(census.zeros, 'zero')} of the stiffness" if census.zeros else ""
    reason = f"{none}, but {few}, and what lies on it was not judged{zeros}"
    return Verdict(UNDECIDED, (reason,), warnings=facts.warnings)


def _obstacle(facts: Facts) -> tuple[str, ...]:
    """Return what prevents any verdict, even instability."""
    if facts.time:
        return (facts.time,)
    if facts.kink:
        return (facts.kink,)
    if not facts.expected:
        return ("constraints and drives leave no degree of freedom, so there is no stability question",)
    return ()


def _doubts(facts: Facts) -> tuple[str, ...]:
    """Return what prevents every verdict but instability."""
    doubts = facts.doubts
    if facts.found != facts.expected:
        doubts = (f"{facts.expected} finite eigenvalues exist, {facts.found} were found", *doubts)
    judged = sum(d.count for d in facts.discs) + facts.neutral.count
    if judged != facts.found:
        doubts = (*doubts, f"{facts.found} eigenvalues were found, {judged} of them are judged")
    return doubts


def _growth(worst: Disc, facts: Facts) -> str:
    value = show(worst.centre)
    if worst.count > 1:
        return f"{worst.count} eigenvalues within {amount(worst.radius)} 1/s of {value} 1/s grow"
    pair = bool(worst.centre.imag)
    what, verb = ("eigenvalues", "grow") if pair else ("eigenvalue", "grows")
    return f"the {what} {value} 1/s {verb} (error bound {amount(worst.radius)})"


def _decaying(facts: Facts) -> Verdict:
    neutral = facts.neutral
    if not neutral.count:
        what = (
            "all multipliers lie inside the unit circle"
            if facts.multipliers
            else ("all eigenvalues lie to the left of the imaginary axis")
        )
        return Verdict(ASYMPTOTIC, (f"all disturbances decay: {what}",), in_place=True, warnings=facts.warnings)
    if neutral.tumbling:
        why = "all that momenta do not hold decays, but a body with a small momentum may tumble for ever"
        return _up_to(facts, STABLE_UP_TO, f"{why}: small disturbances stay small, {_except(neutral)}")
    return _up_to(facts, ASYMPTOTIC_UP_TO, f"all disturbances decay, {_except(neutral, True)}")


def _by_energy(facts: Facts, minimum: Minimum) -> Verdict:
    neutral = facts.neutral
    neutral = replace(neutral, family=tuple(x for x in neutral.family if x not in neutral.slow))
    facts = replace(facts, neutral=neutral)
    warnings = facts.warnings + (facts.frequencies() if minimum.kind != "minimum" else ())
    evidence = weakest(neutral.evidence, minimum.evidence)
    if minimum.in_place and not neutral.count:
        reason = f"{minimum.name} {strict(minimum.kind)} and cannot leave it: small disturbances stay small"
        return Verdict(STABLE, (reason,), in_place=True, evidence=evidence, warnings=warnings)
    zeros = [d for d in facts.discs if d.side == "open" and d.holds_zero]
    wider = facts.family(sum(d.count for d in zeros)) if zeros else None
    if wider is not None:
        facts = replace(facts, neutral=wider, discs=tuple(d for d in facts.discs if d not in zeros))
    decays = minimum.linear or (facts.census is None and all(d.side == "left" for d in facts.discs))
    exception = _except(facts.neutral, decays)
    reason = f"{minimum.name} {strict(minimum.kind)}: small disturbances stay small, {exception}"
    evidence = weakest(facts.neutral.evidence, minimum.evidence)
    verdict = replace(_up_to(facts, STABLE_UP_TO, reason), evidence=evidence, warnings=warnings)
    return verdict if wider is None else replace(verdict, spectrum=_spectrum(facts, verdict), zeros="neutral")


def _critical(facts: Facts, critical: Critical) -> Verdict:
    neutral = facts.neutral
    reason = critical.reason
    family = (*neutral.family, *([critical.family] if critical.family else []))
    up_to = critical.verdict in (ASYMPTOTIC_UP_TO, STABLE_UP_TO)
    if up_to:
        drift = _drifting(neutral, critical.verdict == ASYMPTOTIC_UP_TO)
        if critical.drift:
            # A decay like a root of t may sum without bound.
            slowly = f"{DRIFTS}more slowly than {power(critical.drift)}, {REST}"
            drift = drifting(critical.drift) if critical.family else slowly
        reason += f", {_different(neutral, drift)}" if neutral.names else drift
    staying = critical.verdict == ASYMPTOTIC_UP_TO and bool(critical.family) and not critical.drift
    in_place = critical.verdict in (ASYMPTOTIC, STABLE) or staying
    return Verdict(
        critical.verdict, (reason,), neutral.symmetries if up_to else (), family if up_to else (),
        True if in_place else None, critical.evidence, facts.warnings,
        zeros="neutral" if critical.family else "critical",
    )  # fmt: skip


def _up_to(facts: Facts, word: str, reason: str) -> Verdict:
    """Return a verdict that holds up to the neutral directions."""
    neutral = facts.neutral
    reasons = [reason, *([f"as far as checked: {neutral.checked}"] if neutral.checked else [])]
    known = bool(neutral.drift) or not (neutral.symmetries and neutral.family)
    in_place = neutral.drift == 0 if known and word == ASYMPTOTIC_UP_TO else None
    return Verdict(word, tuple(reasons), neutral.symmetries, neutral.family, in_place, neutral.evidence, facts.warnings)


def _differ(neutral: Neutral) -> str:
    return f"it differs in {phrases(neutral.names)} only" if neutral.names else "nothing is left to judge"


def _except(neutral: Neutral, decays: bool = False) -> str:
    """Return what disturbances may change permanently, and how that drifts, in words."""
    return _different(neutral, _drifting(neutral, decays)) if neutral.names else "at the given momenta"


def _different(neutral: Neutral, drift: str) -> str:
    slightly = "" if drift.startswith(DRIFTS) else "slightly "
    return f"except that {phrases(neutral.names)} may end up {slightly}different{drift}"


def _drifting(neutral: Neutral, decays: bool) -> str:
    """Return how changes along neutral directions drift, in words; `decays` says whether all others decay.

    What decays exponentially moves a motion along symmetries by a finite distance. Other motions of a family may go on
    along them, however slowly (x' = y^2, y' = 0), and so may oscillations (x' = y z': twice the area that y and z
    enclose in each period), at speeds that stay small: no faster than t. Those of linear equations go to and fro.
    """
    if neutral.drift or not neutral.symmetries or (decays and not neutral.family):
        return drifting(neutral.drift)
    return f"{DRIFTS}at most like {power(1)}, {REST}"


def weakest(*evidence: Evidence) -> Evidence:
    """Return the weakest of several kinds of evidence."""
    order: tuple[Evidence, ...] = ("numerical", "enclosed", "structural")
    return min(evidence, key=order.index)
