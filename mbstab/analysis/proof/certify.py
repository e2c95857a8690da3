"""Eigenvalues with proven radii, and verdicts that are theorems.

The kernels run on balls (`mbstab.model.balls`), the constraints are eliminated by pivots that
are proven to be nonzero, and the resulting ẏ = S y contains the linearized equations
for all values of the parameters in their balls. Then

1.  S is taken modulo the directions of symmetries and families of motions, and restricted to given
    values of conserved functions: their eigenvalues are zero, or ±iΩ of a turning frame. They are
    those that double precision has found, verified as identities (`mbstab.analysis.proof.identities`);
2.  S is split along its exact zeros into blocks that do not feed back into each other (strongly
    connected components). The eigenvalues of a block are the roots of its characteristic polynomial; zeros
    that remain are unexplained;
3.  if the states of a block fall into two groups such that each group drives only the other, then
    S = [[0, A], [B, 0]] and the roots are ±√σ for the eigenvalues σ of A B, and zeros: the spectrum
    is symmetric, and a σ that is real, negative and simple gives a pair *on* the imaginary
    axis. The same holds where the energy is conserved and there are no rows on speeds, and where
    equations about a rest are reversible in time: the polynomial is even;
4.  roots are enclosed in discs (Smith 1970) where the parameters are numbers; where they are
    intervals, Routh's array tells on which side of the axis they are;
5.  where the energy never increases, its second variation is tested for a strict minimum.

The verdict follows from these facts by the rule of `mbstab.analysis.verdict.rule`
(`mbstab.analysis.proof.proven_facts` collects the facts).

Equilibria and steady motions are enclosed by the operator of Krawczyk (1969, Computing 4; Rump
2010, Acta Numerica 19, section 13), which proves that there is exactly one near the
solution in double precision. Over an interval one of them is followed (`mbstab.analysis.proof.intervals`).
What is not proven is part of the statement: "proven …, provided that …".
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import field, replace

from mbstab.analysis.algebra.balls import Hopeless, NotProvable, ends
from mbstab.analysis.proof.characteristic import Enclosure, Proof
from mbstab.analysis.proof.intervals import OPEN, Part, Walk, common, in_words
from mbstab.analysis.proof.proven_facts import best
from mbstab.analysis.proof.tolerances import TOLERANCES
from mbstab.analysis.spectrum.eigenvalues import if_symmetric
from mbstab.analysis.verdict.rule import ASYMPTOTIC, MARGINAL, NONLINEAR, UNDECIDED, UNSTABLE, IfSymmetric, Verdict
from mbstab.analysis.verdict.spectrum import Modulo, Spectrum
from mbstab.errors import UsageError, counted
from mbstab.model import balls
from mbstab.model.balls import Ball, ball
from mbstab.model.schema import Model
from mbstab.model.units import exact_factor
from mbstab.records import Answer, dataclass


@dataclass(frozen=True)
class Certificate(Answer):
    """A proven verdict, or why there is none.

    Attributes
    ----------
    verdict : str
        A word of `WORDS` other than ``undecided``, or ``not provable``.
    statement : str
        What is proven, in a sentence.
    eigenvalues : list of Enclosure
        Empty over an interval.
    conditions : tuple of str
        What is not proven and must hold for the verdict to be true, as clauses of a sentence.
    assumed : tuple of str
        The same in full, and what was taken over from double precision.
    reasons : tuple of str
        Why there is no verdict.
    digits : int
        Decimal digits of the computation.
    parameter : str
        Which parameter is an interval; empty: none.
    unit : str
        Declared unit of that parameter.
    factor : float
        Factor from that unit to SI.
    parts : tuple of Part
        Parts of the interval, in ascending order (SI).
    followed : str
        Over an interval, the equilibrium that is judged, if the file does not determine it.
    notes : tuple of str
        What the verdict rests on besides eigenvalues, and what the linearized equations leave open.
    judged : Verdict or None
        The verdict of the common rule; None: it was not reached, or the answer is for an interval.
    modulo : Modulo
        Symmetries and families of motions up to which the verdict holds.
    """

    verdict: str
    statement: str
    eigenvalues: list[Enclosure]
    assumed: tuple[str, ...]
    reasons: tuple[str, ...]
    digits: int
    parameter: str = ""
    parts: tuple[Part, ...] = ()
    conditions: tuple[str, ...] = ()
    followed: str = ""
    notes: tuple[str, ...] = ()
    judged: Verdict | None = None
    modulo: Modulo = field(default_factory=Modulo)
    unit: str = ""
    factor: float = 1.0

    @property
    def in_place(self) -> bool | None:
        """Whether disturbed motions stay near the reference itself; None: not claimed."""
        return self.judged.in_place if self.judged is not None else None

    @property
    def evidence(self) -> str:
        """The weakest fact that the verdict rests on: ``structural``, ``enclosed`` or ``numerical``."""
        return "numerical" if self.judged is None or self.conditions else self.judged.evidence

    @property
    def spectrum(self) -> Spectrum | None:
        """Where the eigenvalues lie; None where the common rule was not reached, and for an interval."""
        return self.judged.spectrum if self.judged is not None else None

    @property
    def warnings(self) -> tuple[str, ...]:
        """What may destroy the proven stability."""
        return self.judged.warnings if self.judged is not None else ()

    @property
    def if_symmetric(self) -> IfSymmetric | None:
        """The verdict, not proven, of a scene within the digits of the file that has more symmetries."""
        return self.judged.if_symmetric if self.judged is not None else None

    @property
    def status(self) -> str:
        """Return ``proven``, ``conditional`` (a verdict that rests on `conditions`) or ``not provable``."""
        return "not provable" if self.verdict == "not provable" else "conditional" if self.conditions else "proven"

    @property
    def decided(self) -> bool:
        """Whether there is a verdict, proven or under conditions."""
        return self.status != "not provable"

    @property
    def proven(self) -> bool:
        """Whether there is a verdict that rests on nothing but the model file."""
        return self.status == "proven"


def certify(model: Model, digits: int = 50, progress: Callable[[float], object] = lambda done: None) -> Certificate:
    """Return enclosures of all eigenvalues and a verdict that is proven, or why there is none.

    Parameters
    ----------
    model : Model
        One of its parameters may be given as an interval (`mbstab.model.parameters.bound`).
    digits : int
        Decimal digits; twice and four times as many are tried where a verdict is open.
    progress : callable
        Called with the fraction of the interval that is decided, from 0 to 1.

    Raises
    ------
    UsageError
        If more than one parameter is an interval.
    MbstabError
        As `mbstab.analysis.reference.requested.reference_motion`.
    """
    if not 10 <= digits <= 10_000:
        raise UsageError(f"--precision {digits}: give a number from 10 to 10000")
    wide = [name for name, x in model.parameters.items() if x.given is not None and len(x.given.ends) == 2]
    if len(wide) > 1:
        raise UsageError(
            f"{' and '.join(wide)} are intervals\nhint: one parameter may be an interval, the others numbers"
        )
    result = None
    for more in TOLERANCES.digit_factors:
        with balls.digits(more * digits):
            if wide:
                return _over(model, wide[0], digits, progress)
            result, hope = _at(model, more * digits)
        if not hope:
            break
    assert result is not None
    return result


def _refused(error: NotProvable, digits: int) -> Certificate:
    reason = str(error)
    return Certificate(OPEN, f"not provable with {digits} digits: {reason}", [], (), (reason,), digits)


def _at(model: Model, digits: int) -> tuple[Certificate, bool]:
    """Return what is proven at one point, and whether more digits may prove more."""
    try:
        proof = Proof(model, {})
        case = best(proof)
        found = sorted(
            case.enclosures,
            key=lambda e: (e.kind in NEUTRAL, -float(e.real.mid()), abs(float(e.imag.mid())), -float(e.imag.mid())),
        )
    except NotProvable as error:
        return _refused(error, digits), not isinstance(error, Hopeless)
    judged = replace(case.verdict, if_symmetric=if_symmetric(proof.identities.grounds))
    conditions = (*proof.conditions, *case.conditions)
    assumed = (*proof.assumed, *case.conditions)
    if judged.word == UNDECIDED:
        reasons = tuple(dict.fromkeys(judged.reasons))
        if named := list(dict.fromkeys(e.why for e in found if e.kind == "open" and e.why)):
            reasons += (f"nothing explains: {', '.join(named)}",)
        statement = f"not provable with {digits} digits: {reasons[0]}"
        hope = any(e.wide for e in found if e.kind == "open")
        return Certificate(OPEN, statement, found, assumed, reasons, digits, judged=judged), hope
    statement = f"proven {in_words(judged.word, judged.modulo)}{_provided(conditions)}: {_counted(found)}"
    notes = judged.reasons if judged.word not in (UNSTABLE, ASYMPTOTIC) else ()
    return Certificate(
        judged.word, statement, found, assumed, (), digits, conditions=conditions, notes=notes, judged=judged,
        modulo=judged.modulo,
    ), False  # fmt: skip


def _provided(conditions: Sequence[str]) -> str:
    """Return the conditions of a verdict as the end of a sentence."""
    return f", provided that {'; that '.join(conditions)}" if conditions else ""


def _counted(found: list[Enclosure]) -> str:
    """Return in words how many eigenvalues are where."""
    counts = {kind: sum(e.count for e in found if e.kind == kind) for kind in KINDS}
    beside = any(counts[kind] for kind in ("left", "right"))
    words = {**KINDS, "imaginary": "exactly on it" if beside else "exactly on the imaginary axis"}
    parts = [f"{counted(counts[kind], 'eigenvalue')} {words[kind]}" for kind in words if counts[kind]]
    return ", ".join(parts)


KINDS = {
    "right": "to the right of the imaginary axis",
    "left": "to the left of the imaginary axis",
    "imaginary": "exactly on the imaginary axis",
    "zero": "exactly zero by symmetry",
    "carried": "on the axis by symmetry",
    "open": "not distinguishable from the axis",
}
"""Kinds of eigenvalues in words."""

NEUTRAL = ("zero", "carried")
"""Kinds of eigenvalues that symmetries and families of motions explain."""


# --- intervals of a parameter ---------------------------------------------------------------------------------------


def _over(model: Model, name: str, digits: int, progress: Callable[[float], object]) -> Certificate:
    """Return what is proven for all values of a parameter in an interval, by bisection."""
    first, last = ends(model, name)
    low, high = balls.fraction_beyond(first, False), balls.fraction_beyond(last, True)
    walk = Walk(model, name, (low, high), progress)
    verdicts = {part.verdict for part in walk.parts}
    words = {part.words for part in walk.parts}
    factor = exact_factor(model.parameters[name].unit, balls.ball_arithmetic())
    unit = model.parameters[name].unit
    text = f"{name} in [{_decimal(ball(low) / factor)}, {_decimal(ball(high) / factor)}] {unit}".rstrip()
    followed = ""
    if walk.start is not None:
        what = {None: "position", "equilibrium": "equilibrium"}.get(model.reference.find, "steady motion")
        start = f"{_decimal(ball(walk.start) / factor)} {unit}".rstrip()
        followed = f"the {what} that the file leads to at {name} = {start}, followed from there"
    assumed = tuple(walk.assumed)
    parts = tuple(walk.parts)
    notes = (f"where the verdict is marginally stable, {NONLINEAR}",) if MARGINAL in verdicts else ()
    if (agreed := common(parts)) is not None:
        word, modulo = agreed
        least = "at least " if len(words) > 1 else ""
        statement = f"proven {least}{in_words(word, modulo)} for every {text}{_provided(walk.conditions)}"
        statement += f" ({followed})" if followed else ""
        return Certificate(
            word, statement, [], assumed, (), digits, name, parts, tuple(walk.conditions), followed, notes,
            modulo=modulo, unit=unit, factor=float(factor),
        )  # fmt: skip
    why = []
    if len(words - {OPEN}) > 1:
        why.append(f"the verdict is not the same for every {text}")
    elif len(words) > 1:
        why.append(f"a part of {text} is open")
    for part in parts:
        if part.verdict == OPEN:
            first, last = (_decimal(ball(x) / factor, 12) for x in (part.low, part.high))
            width = _decimal(ball(part.high - part.low) / factor, 2)
            why.append(f"open in [{first}, {last}]{' ' if unit else ''}{unit}, width {width}: {part.reason}")
    statement = f"not provable with {digits} digits: {why[0]}"
    if verdicts != {OPEN} and walk.conditions:
        statement += f"; the verdicts of the other parts hold{_provided(walk.conditions)[1:]}"
    return Certificate(
        OPEN, statement, [], assumed, tuple(why), digits, name, parts, tuple(walk.conditions), followed, notes,
        unit=unit, factor=float(factor),
    )  # fmt: skip


def _decimal(x: Ball, places: int = 6) -> str:
    return f"{float(x):.{places}g}"
