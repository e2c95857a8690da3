"""Eigenvalues with any number of digits: the same kernels and the same deflation on balls of Arb.

Parameters are the decimals of the file and the command line. Double precision tells where the
reference motion is, which rows are independent and in which frame the motion is at rest;
every number is then refined until its residual vanishes to the working digits, which also
verifies the ranks: a null space that cannot be refined does not exist. Everything is done twice,
with different working digits. The difference is the error bound, and if it affects the
requested digits, both are repeated with more: an eigenvalue in a chain of length m
keeps only one digit in m.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from decimal import Decimal
from typing import Any

import numpy as np

from mbstab.analysis.algebra import digits as more
from mbstab.analysis.algebra.balls import ball_system
from mbstab.analysis.algebra.digits import exact, largest
from mbstab.analysis.algebra.matching import assigned
from mbstab.analysis.algebra.refining import Stalled
from mbstab.analysis.algebra.tolerances import TOLERANCES as ALGEBRA
from mbstab.analysis.linear.linearize import Linearization, state_space
from mbstab.analysis.linear.methods import DEFAULT
from mbstab.analysis.spectrum.eigenvalues import if_symmetric, kind_in, with_saddles
from mbstab.analysis.spectrum.precise_motion import Start, another_rank, rank_misfit, reference_point
from mbstab.analysis.spectrum.refined_matrix import deflated, state_matrix
from mbstab.analysis.spectrum.results import Counts, EigenResult
from mbstab.analysis.spectrum.tolerances import TOLERANCES
from mbstab.analysis.verdict.facts import Grounds
from mbstab.analysis.verdict.many_digits import UNKNOWN, ManyDigits, Zeros
from mbstab.analysis.verdict.rule import STRENGTH, UNDECIDED, Disc, Judged, Verdict, judge, place
from mbstab.analysis.verdict.wording import show
from mbstab.errors import MbstabError, NumericalError, UsageError, amount
from mbstab.model import balls
from mbstab.model.schema import Model
from mbstab.records import dataclass


@dataclass(frozen=True)
class PreciseEigenvalue:
    """One finite eigenvalue that is not neutral.

    Attributes
    ----------
    value : ``flint.acb`` (1/s)
        The value with the working digits.
    kind : str
        As in `mbstab.analysis.spectrum.results.Eigenvalue`.
    error_bound : ``flint.arb`` (1/s)
        Its change between computations with different numbers of digits.
    real, imag : str
        Decimals, every digit correct; ``0`` for a part smaller than the error bound.
    bound : str
        The error bound as text.
    """

    value: Any
    kind: str
    error_bound: Any
    real: str
    imag: str
    bound: str


@dataclass(frozen=True)
class PreciseResult(Judged):
    """Eigenvalues with many digits.

    Attributes
    ----------
    eigenvalues : list of PreciseEigenvalue
        Sorted by decreasing real part, without the neutral ones but with unexplained zeros.
    neutral : int
        Number of neutral eigenvalues: zeros and pairs ±iω that symmetries, families of motions or a minimum of the
        energy explain.
    shifts : tuple of str
        ω of neutral pairs ±iω (rad/s).
    judged : Verdict
        As in `mbstab.analysis.spectrum.results.EigenResult`.
    counts : Counts
    kept, dropped : str
        The smallest nonzero pivot and the largest that counted as zero, relative to their matrix.
    digits, working_digits : int
        Correct digits, and digits of the arithmetic.
    seconds : float
    warnings : tuple of str
    frame : str
        The frame in which the equations are constant, in words; empty: the coordinates of the file.
    frozen : bool
        Whether these are frozen-time eigenvalues, which say nothing about stability.
    plain : EigenResult
        The answer in double precision.
    """

    eigenvalues: list[PreciseEigenvalue]
    neutral: int
    shifts: tuple[str, ...]
    judged: Verdict
    counts: Counts
    kept: str
    dropped: str
    digits: int
    working_digits: int
    seconds: float
    warnings: tuple[str, ...]
    frame: str
    frozen: bool
    plain: EigenResult

    @property
    def neutral_directions(self) -> tuple[str, ...]:
        """What the neutral eigenvalues belong to, in words, whatever the verdict."""
        return self.modulo.names or self.plain.neutral_directions

    @property
    def zeros(self) -> int:
        """Number of neutral eigenvalues that are zero."""
        return self.neutral - 2 * len(self.shifts)

    @property
    def method(self) -> str:
        """Return the method of deflation."""
        return DEFAULT

    @property
    def period(self) -> float | None:
        """Return None: periodic motions are refused."""
        return None

    def values(self) -> list[Any]:
        """Return the eigenvalues that are not neutral, including unexplained zeros, as ``flint.acb`` (1/s)."""
        return [e.value for e in self.eigenvalues]


def precise_eigenvalues(
    model: Model,
    digits: int = 50,
    frozen: bool = False,
    progress: Callable[[float], object] = lambda done: None,
    zeros: ManyDigits | None = None,
) -> PreciseResult:
    """Return the eigenvalues of a model with a given number of correct digits.

    Parameters
    ----------
    model : Model
    digits : int
    frozen : bool
        As in `mbstab.analysis.spectrum.eigenvalues.answer`.
    progress : callable
        Called with the fraction of the work that is done, from 0 to 1.
    zeros : ManyDigits, optional
        As `digits` of `mbstab.analysis.spectrum.eigenvalues.eigenvalues`.

    Raises
    ------
    UsageError
        If the number of digits is out of range, or the file describes a periodic motion.
    ConstraintError
        If the rank of the constraints with these digits differs from that in double precision.
    NumericalError
        If the digits cannot be reached.
    MbstabError
        As `mbstab.analysis.reference.requested.reference_motion`.
    """
    least, most = TOLERANCES.digits_least, TOLERANCES.digits_most
    if not least <= digits <= most:
        raise UsageError(f"precision {digits}: from {least} to {most} digits are possible")
    began = time.perf_counter()
    start = Start(model, frozen)
    progress(0.1)
    work, turns = digits + TOLERANCES.digits_beyond, start.grounds.separated.frequencies()
    for number in range(TOLERANCES.precision_rounds):
        rough, fine = (_spectrum(start, turns, n) for n in (work, work + TOLERANCES.digits_beyond))
        with balls.digits(work + 2 * TOLERANCES.digits_beyond):
            bounds = _bounds(rough, fine, work)
            lacking, chained = _lacking(fine, bounds, digits)
            decided = _decided(rough, fine)
            if lacking <= 0 and decided:
                progress(1.0)
                start.grounds.digits = zeros
                return _result(start, fine, bounds, digits, began)
        if not decided:
            work = max(work + digits, _until_shown(fine.deflation))
        else:
            work = _enough(work, digits, lacking, chained)
        progress(0.1 + 0.8 * (number + 1) / TOLERANCES.precision_rounds)
        if work > 20 * (digits + 2 * TOLERANCES.digits_beyond):
            break
    raise NumericalError(
        f"{digits} digits are not reached with {fine.work} working digits: {_worst(fine, bounds)}\n"
        "hint: the eigenvalues depend on the data so strongly that their decimals in the file do not fix them"
    )


def _decided(rough: _Spectrum, fine: _Spectrum) -> bool:
    """Return whether zeros are decided: the same ones with more digits, and smaller accordingly."""
    one, other = rough.deflation, fine.deflation
    shrunk = one.dropped == 0 or other.dropped <= one.dropped * 10.0 ** (-TOLERANCES.digits_beyond / 2)
    return other.decided and other.sizes == one.sizes and bool(shrunk)


def _until_shown(deflation: more.Deflation) -> int:
    """Return the number of working digits with which the dropped pivots would be kept."""
    return (
        int(_digits_of(1 / deflation.dropped) / ALGEBRA.pivot_digits_lost) + TOLERANCES.digits_beyond
        if deflation.dropped > 0
        else 0
    )


def _enough(work: int, digits: int, lacking: int, chained: bool) -> int:
    """Return the number of working digits to try next where some are missing."""
    if not chained:
        return work + lacking + 3
    # A chain of length m leaves one digit in m.
    reached = max(digits + TOLERANCES.digits_of_bound - lacking, work / 8)
    return int(work * (digits + TOLERANCES.digits_of_bound + TOLERANCES.digits_beyond / 2) / reached)


def exact_zeros(model: Model, turns: Sequence[complex], digits: int = 320) -> Zeros:
    """Return the eigenvalues of a model that are zero to many digits; `UNKNOWN` if they cannot be known.

    Their number includes those that symmetries and families of motions explain, and pairs ±iω that rotate with the
    motion.

    Parameters
    ----------
    model, digits
        As in `precise_eigenvalues`.
    turns : sequence of complex (1/s)
        ±iω of these pairs in double precision.
    """
    try:
        start = Start(model, False)
        found = _spectrum(start, turns, digits + TOLERANCES.digits_beyond)
        doubtful = found.deflation.dropped > balls.real(10) ** -digits
        if doubtful and not _decided(found, _spectrum(start, turns, found.work + TOLERANCES.digits_beyond)):
            return UNKNOWN
        return _zeros(found, digits)
    except MbstabError:
        return UNKNOWN


# --- one computation ------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Spectrum:
    """Eigenvalues with some number of working digits.

    `frequencies` are those of neutral pairs, `rough_frequencies` the same in double precision.
    """

    work: int
    values: list[more.Value]
    deflation: more.Deflation
    frequencies: list[Any]
    rough_frequencies: list[float]
    n_f: int
    size: Any
    excess: tuple[Any, str]


def _spectrum(start: Start, turns: Sequence[complex], work: int) -> _Spectrum:
    """Return the eigenvalues of a model computed with `work` digits."""
    try:
        return _polished_spectrum(start, turns, work)
    except Stalled as stalled:
        raise NumericalError(
            f"the motion is not sharpened to {work} digits: steps stop shrinking at {amount(stalled.reached)}\n"
            "hint: fewer digits, or numbers of less extreme size in the file"
        ) from None


def _polished_spectrum(start: Start, turns: Sequence[complex], work: int) -> _Spectrum:
    """Return the eigenvalues of a model computed with `work` digits; raises `Stalled` if refinement ends earlier."""
    with balls.digits(work):
        system = ball_system(start.model, {}, balls.digit_arithmetic())
        point = reference_point(start, system, more.MANY_DIGITS)
        try:
            S = state_matrix(start, system, point, more.MANY_DIGITS, start.linear.spaces)
        except Stalled as stalled:
            spaces, J = start.motion.spaces, exact(point.state.J)
            misfit = rank_misfit(start.motion, J * spaces.scale * spaces.row_scale[:, None], system.n_h)
            raise another_rank(start.motion, misfit or stalled.reached) from None
        rough = sorted({s.imag for s in turns if s.imag > 0.0})
        frequencies = [_nearest(point.rates, x) for x in rough]
        deflation = more.deflated(S, frequencies)
        values = more.eigenvalues(deflation.S)
        return _Spectrum(work, values, deflation, frequencies, rough, len(S), largest(S), point.excess)


def _nearest(rates: Sequence[Any], rough: float) -> Any:
    return min(rates, key=lambda x: abs(x - rough))


def rounded_eigenvalues(linear: Linearization, digits: int) -> list[Any] | None:
    """Return the exact eigenvalues of the matrices in double precision, as ``flint.acb``.

    Structural zeros are not kept at zero: rounding moves them. None if rounding destroys the rank
    of redundant constraints, or if the eigenvalues cannot be computed.
    """
    with balls.digits(digits):
        matrices = (exact(linear.M), exact(linear.R), exact(linear.K))
        gamma = state_space(linear).rate
        try:
            S = deflated(linear.spaces, gamma, matrices, exact(linear.J), exact(linear.D_q), more.MANY_DIGITS)
            return [e.value for e in more.eigenvalues(S)]
        except (Stalled, NumericalError):
            return None


# --- how many digits are right --------------------------------------------------------------------------------------


def _bounds(rough: _Spectrum, fine: _Spectrum, work: int) -> list[Any]:
    """Return the differences of the eigenvalues of `fine` and `rough`; a floor where they agree by chance."""
    n = len(fine.values)
    if len(rough.values) != n or n == 0:
        return [balls.real(math.inf)] * n
    floor = fine.size * balls.real(10) ** -work
    distance = [[abs(x.value - y.value) for y in rough.values] for x in fine.values]
    columns = assigned(np.array(distance, dtype=float))
    return [max(distance[i][columns[i]], floor, x.radius) for i, x in enumerate(fine.values)]


def _lacking(fine: _Spectrum, bounds: list[Any], digits: int) -> tuple[int, bool]:
    """Return the largest number of missing digits, and whether chains are the reason."""
    worst, chained = 0, False
    for e, bound in zip(fine.values, bounds, strict=True):
        if not bound.is_finite():
            return digits, e.chained
        parts = [abs(x) for x in (e.value.real, e.value.imag)]
        # A part below the bound is shown as 0, which must not happen to both parts.
        for size in (x if x > bound else abs(e.value).mid() for x in parts):
            digits_right = _digits_of(size / bound) if size > 0 else -digits
            lack = math.ceil(digits + TOLERANCES.digits_of_bound - digits_right)
            if lack > worst:
                worst, chained = lack, e.chained
    return worst, chained


def _worst(fine: _Spectrum, bounds: list[Any]) -> str:
    k = max(range(len(bounds)), key=lambda i: bounds[i])
    return f"{show(complex(fine.values[k].value))} 1/s changes by {balls.decimals(bounds[k], 2)}"


# --- the answer -----------------------------------------------------------------------------------------------------


def _result(start: Start, fine: _Spectrum, bounds: list[Any], digits: int, began: float) -> PreciseResult:
    grounds, deflation, spaces = start.grounds, fine.deflation, start.motion.spaces
    zeros, pairs, discs, members = _placed(start, fine, bounds, digits)
    number = len(fine.values) + sum(deflation.steps) + 2 * sum(deflation.pairs)
    neutral = zeros + 2 * sum(pairs)
    doubts: tuple[str, ...] = ()
    if neutral < grounds.separated.neutral.count:
        doubts = (
            f"with these digits {neutral} eigenvalues are those of symmetries and families of motions, which have "
            f"{grounds.separated.neutral.count}: the reference may be written with too few digits",
        )
    verdict = replace(judge(grounds.facts(discs, number, doubts)), if_symmetric=if_symmetric(grounds))
    found = _listed(fine, bounds, digits, discs, members, verdict, grounds)
    # Zeros along which a minimum of the energy is flat are neutral, too.
    neutral += sum(e.kind == "neutral" for e in found)
    found = [e for e in found if e.kind != "neutral"]
    counts = Counts(
        start.system.n_q, start.system.n_h, start.system.n_n, spaces.C.rank, spaces.W.rank, fine.n_f, number, neutral,
        0, 0, massless=start.plain.counts.massless, critical=sum(e.kind == "critical" for e in found),
        states=start.plain.counts.states,
    )  # fmt: skip
    warnings = [*start.motion.warnings, *verdict.warnings, *_differences(start, found, counts, verdict.word)]
    excess, where = fine.excess
    if excess > balls.real(10) ** (-digits - TOLERANCES.digits_of_bound):
        warnings.append(
            f"the reference as it is written satisfies {where} to {balls.decimals(excess, 2)} only: later digits of "
            "the eigenvalues belong to these decimals"
        )
    if start.loose:
        names = ", ".join(start.loose)
        warnings.append(
            f"nothing determines {names}: the reference is the one of double precision there, with its 16 digits"
        )
    linear = start.linear
    turns = linear.generator is not None and linear.generator.turns
    shifts = tuple(balls.decimals(x, digits) for x, n in zip(fine.frequencies, pairs, strict=True) for _ in range(n))
    return PreciseResult(
        found, neutral, shifts, verdict, counts, balls.decimals(deflation.kept, 2),
        balls.decimals(deflation.dropped, 2), digits, fine.work, time.perf_counter() - began, tuple(warnings),
        str(linear.generator) if turns else "",
        not linear.constant or linear.frozen, start.plain,
    )  # fmt: skip


def _zeros(fine: _Spectrum, digits: int) -> Zeros:
    """Return the zero eigenvalues, with the pairs that rotate with the motion; `UNKNOWN` if they are not known."""
    deflation = fine.deflation
    known = deflation.decided and fine.excess[0] <= balls.real(10) ** (-digits - TOLERANCES.digits_of_bound)
    return Zeros(sum(deflation.steps) + 2 * sum(deflation.pairs), len(deflation.steps)) if known else UNKNOWN


def _rounded_reference(start: Start, fine: _Spectrum, digits: int) -> bool:
    """Return whether the reference is known to fewer digits than requested."""
    searched = start.balance is not None and bool(start.loose)
    return searched or bool(fine.excess[0] > balls.real(10) ** (-digits - TOLERANCES.digits_of_bound))


def _placed(
    start: Start, fine: _Spectrum, bounds: list[Any], digits: int
) -> tuple[int, list[int], list[Disc], list[list[int]]]:
    """Return neutral zeros and pairs, and the discs of all other eigenvalues with the values in each.

    Of the zeros and of the pairs that rotate with the motion, those are neutral that symmetries and
    families explain; the others are judged.
    """
    deflation, plain = fine.deflation, start.plain
    frequencies = start.grounds.separated.frequencies()
    turning = [sum(s.imag == x for s in frequencies) for x in fine.rough_frequencies]
    zeros = min(sum(deflation.steps), start.grounds.separated.neutral.count - 2 * sum(turning))
    pairs = [min(n, known) for n, known in zip(deflation.pairs, turning, strict=True)]
    known_to = bounds
    if _rounded_reference(start, fine, digits):
        # The distance to the eigenvalues of the intended motion is known in double precision only.
        others = [(e.value, e.error_bound) for e in plain.eigenvalues if e.kind != "neutral"]
        known_to = [
            bound + min((abs(e.value - s) + known for s, known in others), default=math.inf)
            for e, bound in zip(fine.values, bounds, strict=True)
        ]
    members, centres, radii = _clusters([e.value for e in fine.values], known_to)
    counts = [len(x) for x in members]
    size = fine.size * max(deflation.dropped, balls.real(10) ** -fine.work).root(max(len(deflation.steps), 1))
    left = [(balls.plane(0), sum(deflation.steps) - zeros)]
    for x, n, known in zip(fine.frequencies, deflation.pairs, pairs, strict=True):
        left += [(balls.plane(0, sign * x), n - known) for sign in (1, -1)]
    for centre, count in left:
        if count:
            centres.append(centre)
            radii.append(size)
            counts.append(count)
            members.append([])
    discs = place(centres, radii, counts, start.grounds.mirrored)
    return zeros, pairs, list(discs), members


def _clusters(values: list[Any], bounds: list[Any]) -> tuple[list[list[int]], list[Any], list[Any]]:
    """Return groups of eigenvalues that cannot be separated, with disjoint discs: centres and radii."""
    groups = [[i] for i in range(len(values))]

    def disc(members: list[int]) -> tuple[Any, Any, Any]:
        centre = sum(values[i] for i in members) / len(members)
        spread = max(abs(values[i] - centre) for i in members)
        bound = max(bounds[i] for i in members)
        # An eigenvalue that cannot be separated from its conjugate is real.
        centre = balls.plane(centre.real, centre.imag if abs(centre.imag) > spread + bound else 0)
        return centre, spread + bound, spread + TOLERANCES.separate_bounds * bound

    while True:
        discs = [disc(members) for members in groups]
        met = next(
            (
                (i, j)
                for i, (one, _, reach) in enumerate(discs)
                for j, (other, _, further) in enumerate(discs[:i])
                if not abs(one - other) > reach + further
            ),
            None,
        )
        if met is None:
            return groups, [centre for centre, _, _ in discs], [radius for _, radius, _ in discs]
        groups[met[1]] += groups.pop(met[0])


def _digits_of(x: Any) -> float:
    """Return log₁₀ of a number beyond the range of doubles, too."""
    return float(balls.real(x).log()) / math.log(10.0)


def _listed(
    fine: _Spectrum,
    bounds: list[Any],
    digits: int,
    discs: list[Disc],
    members: list[list[int]],
    verdict: Verdict,
    grounds: Grounds,
) -> list[PreciseEigenvalue]:
    """Return the eigenvalues with their kinds, sorted."""
    found = []
    for disc, inside in zip(discs, members, strict=True):
        centre = balls.plane(disc.centre)
        values = [(fine.values[i].value, bounds[i]) for i in inside] or [(centre, balls.real(disc.radius))] * disc.count
        for value, bound in values:
            real, imag = (x if abs(x) > bound else balls.real(0) for x in (value.real, value.imag))
            kind = kind_in(0j if imag == 0 else 1j, disc, verdict, grounds)
            one, other = ("0" if x == 0 else balls.decimals(x, digits) for x in (real, imag))
            found.append(PreciseEigenvalue(balls.plane(real, imag), kind, bound, one, other, balls.decimals(bound, 2)))
    # Pairs stay together: their real parts differ by less than their bounds.
    found.sort(key=lambda e: (-_rounded(e.value.real, digits), _rounded(abs(e.value.imag), digits), -e.value.imag))
    return with_saddles(found)


def _rounded(x: Any, digits: int) -> Any:
    return Decimal(balls.decimals(x, digits - 2))


def _differences(start: Start, found: list[PreciseEigenvalue], counts: Counts, verdict: str) -> list[str]:
    """Return the differences from the result in double precision, in words."""
    plain = start.plain
    texts = []
    if plain.verdict != UNDECIDED and plain.counts.neutral != counts.neutral:
        texts.append(
            f"{counts.neutral} eigenvalues are neutral with these digits, {plain.counts.neutral} in double precision"
        )
    if plain.verdict not in STRENGTH[verdict]:
        texts.append(f"the verdict in double precision is {plain.verdict!r}")
    judged = [e for e in plain.eigenvalues if e.kind != "neutral"]
    if len(judged) == len(found) and found:
        distance = np.array([[abs(e.value - complex(x.value)) for x in found] for e in judged])
        columns = assigned(distance)
        off = [e for i, e in enumerate(judged) if distance[i, columns[i]] > 2.0 * e.error_bound]
        texts += [
            f"double precision has {show(e.value)} 1/s, off by more than its error bound {amount(e.error_bound)}"
            for e in off
            if e.value.imag >= 0.0
        ]
    return texts
