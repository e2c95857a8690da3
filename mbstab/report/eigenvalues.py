"""Eigenvalues as text: tables of eigenvalues or multipliers, verdict, and counts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import groupby
from typing import TYPE_CHECKING

from mbstab.analysis.linear.methods import DEFAULT
from mbstab.analysis.verdict.wording import show
from mbstab.errors import counted
from mbstab.model.schema import Model
from mbstab.report import table_width
from mbstab.report.modes import UNKNOWN, modes_table, shapes_text, value_text
from mbstab.report.styles import Style, Text, document, joined
from mbstab.report.tables import number, table, wrap_lines
from mbstab.report.verdicts import grounds_lines, verdict_badge

if TYPE_CHECKING:
    from mbstab.analysis.spectrum.precise import PreciseResult
    from mbstab.analysis.spectrum.results import EigenResult, Eigenvalue

ZERO = 1e-3
"""An eigenvalue that may be zero is printed as 0 if its error bound is below this fraction of the largest one."""


def eigen_text(result: EigenResult, model: Model, shapes: bool = False) -> Text:
    """Return the answer of ``mbstab eig`` as text, with all shapes of modes if these are asked for.

    The verdict comes first, then the eigenvalues, then what the verdict rests on.
    """
    lines: list[str] = [verdict_badge(result.verdict), ""]
    shown = _pairs(result)
    fill = _multipliers if result.period is not None else _eigenvalues
    lines.append(fill(result, shown) if shown else "no finite eigenvalues: the motion is fully prescribed\n")
    lines += [*grounds_lines(result.judged), ""]
    bodies = list(dict.fromkeys(name for e, _ in shown for name in e.participation))
    told = [e for e, _ in shown if e.motions]
    several = len(bodies) > 1 and any(len(e.motions) > 1 for e in told)
    if not shapes and (several or any(e.whirl for e in told)):
        lines += wrap_lines("Motion of each mode, relative to the largest and to the size of the scene:")
        lines.append(modes_table(told))
    if len(bodies) > 1:
        lines.append("Share of the kinetic energy of each mode:")
        lines.append(_participation(shown, bodies))
    lines += _without_shape(shown)
    if shapes:
        lines.append(shapes_text(result))
    return document([*lines, *_counts(result)])


SETTLED = ("center", "critical")

STYLES: dict[str, Style] = {"neutral": "faint", "undecided": "open"}


def _row_style(kind: str, grows: bool) -> Style | None:
    """Return the style of the row of an eigenvalue of a kind, whose real part is positive or not."""
    if kind in STYLES:
        return STYLES[kind]
    return "grows" if grows and kind not in SETTLED else None


def precise_text(result: PreciseResult, model: Model) -> Text:
    """Return the answer of ``mbstab eig --precision`` as text: real and imaginary parts on lines of their own."""
    lines: list[str] = [verdict_badge(result.verdict), ""]
    rows: list[list[str]] = []
    styles: list[Style | None] = []
    for e in result.eigenvalues:
        if e.imag.startswith("-"):
            continue
        last = [e.bound, e.kind]
        if e.imag == "0":
            rows.append([e.real, *last])
        elif e.real == "0":
            rows.append([f"± {e.imag}i", *last])
        else:
            rows += [[e.real, "", ""], [f"± {e.imag}i", *last]]
        styles += [_row_style(e.kind, e.value.real > 0)] * (len(rows) - len(styles))
    rows += [[f"± {shift}i", "-", "neutral"] for shift in result.shifts]
    if result.zeros:
        rows.append(["0", "-", f"neutral, {result.zeros}×"])
    styles += [STYLES["neutral"]] * (len(rows) - len(styles))
    heads = ["eigenvalue\n(1/s)", "error\nbound", "type"]
    lines.append(table(heads, rows, left=(2,), styles=styles) if rows else "no eigenvalues\n")
    lines += [*grounds_lines(result.judged), "", *_counts(result)]
    lines += wrap_lines(
        f"{result.digits} digits, computed with {result.working_digits} in {result.seconds:.1f} s; smallest pivot that "
        f"counts {result.kept}, largest that counts as zero {result.dropped}, relative to the matrix"
    )
    return document(lines)


def _eigenvalues(result: EigenResult, shown: Sequence[tuple[Eigenvalue, int]]) -> Text:
    rows = []
    largest = max((abs(e.value) for e, _ in shown), default=0.0)
    for e, multiplicity in shown:
        if e.kind == "critical":
            rows.append(["0", "-", "-", "-", "-", f"critical, {multiplicity}×"])
        elif e.kind == "neutral":
            value = f"0 ± {abs(e.value.imag):.10g}i" if _goes_round(result, e) else _neutral_value(result)
            rows.append([value, "-", "-", "-", "-", f"neutral, {multiplicity}×"])
        elif e.kind == "undecided" and abs(e.value) <= e.error_bound < ZERO * largest:
            # An eigenvalue that cannot be told from zero has no correct digits.
            both = ", 2×" if e.value.imag else ""
            rows.append(["0", "-", "-", "-", f"{e.error_bound:.0e}", f"undecided{both}"])
        else:
            rows.append(_eigenvalue_row(e))
    heads = ["eigenvalue\n(1/s)", "freq.\n(Hz)", "damping\nratio", "doubles or\nhalves in s", "error\nbound", "type"]
    named = [f"{e.name} {value_text(e)}" for e, _ in shown if e.name]
    text = table(heads, rows, left=(5,), styles=[_row_style(e.kind, e.value.real > 0.0) for e, _ in shown])
    return joined([text, *(f"{line}\n" for line in wrap_lines(f"named: {', '.join(named)}"))], "") if named else text


def _eigenvalue_row(e: Eigenvalue) -> list[str]:
    if e.error_bound == math.inf:
        return [UNKNOWN, "-", "-", "-", "inf", e.kind]
    value, bound = show(e.significant, 10, e.error_bound), e.error_bound
    # If its side of the axis is undecided, it is also undecided whether it grows.
    side = e.kind != "undecided" or e.error_bound < abs(e.value.real)
    damping = 0.0 if e.kind == "center" else e.damping_ratio if side else math.nan
    time = _time(e) if side else "-"
    frequency, ratio = (
        number(e.frequency, 4, bound / (2.0 * math.pi)),
        number(damping, 4, bound / (abs(e.value) or 1.0)),
    )
    return [value, frequency, ratio, time, f"{bound:.0e}", e.kind]


def _multipliers(result: EigenResult, shown: Sequence[tuple[Eigenvalue, int]]) -> Text:
    """Return the table of a periodic motion."""
    rows = []
    for e, multiplicity in shown:
        assert e.multiplier is not None
        if e.kind == "neutral":
            rows.append(["1", "1", "0", "-", "-", f"neutral, {multiplicity}×"])
            continue
        assert result.period is not None
        bound = e.error_bound
        off = abs(e.multiplier) * bound * result.period
        growth = "0" if e.kind == "center" else number(e.value.real, 8, bound)
        size = "1" if e.kind == "center" else number(abs(e.multiplier), 8, off)
        frequency = number(e.frequency, 4, bound / (2.0 * math.pi))
        rows.append([show(e.multiplier, bound=off), size, growth, frequency, f"{bound:.0e}", e.kind])
    heads = ["multiplier", "size", "growth\n(1/s)", "freq.\n(Hz)", "error\nbound", "type"]
    return table(heads, rows, left=(5,), styles=[_row_style(e.kind, e.value.real > 0.0) for e, _ in shown])


def _neutral_value(result: EigenResult) -> str:
    spread = _spread(result)
    return f"0 to {spread:.0e}" if result.method != DEFAULT and spread else "0"


def _spread(result: EigenResult) -> float:
    zeros = [abs(e.value) for e in result.eigenvalues if e.kind == "neutral" and not _goes_round(result, e)]
    return max(zeros, default=0.0)


def _pairs(result: EigenResult) -> list[tuple[Eigenvalue, int]]:
    """Return one of each conjugate pair, and the critical and the neutral ones as one entry each with their number."""
    found = result.eigenvalues
    shown: list[tuple[Eigenvalue, int]] = [(e, 1) for e in found if not e.exact and e.value.imag >= 0.0]
    critical = [e for e in found if e.kind == "critical"]
    neutral = [e for e in found if e.kind == "neutral"]
    turning = [e for e in neutral if _goes_round(result, e)]
    zeros = [e for e in neutral if e not in turning]
    return shown + [(group[0], len(group)) for group in (critical, turning, zeros) if group]


def _goes_round(result: EigenResult, e: Eigenvalue) -> bool:
    """Return whether a neutral eigenvalue belongs to a shift seen from a rotating frame; QZ scatters it slightly."""
    return any(abs(e.value.imag) > 0.5 * frequency for frequency in result.shifts)


def _time(e: Eigenvalue) -> str:
    time = e.time_to_double
    if math.isinf(time):
        return "-"
    return f"{'2×' if time > 0 else '½'} {number(abs(time), 4, abs(time * e.error_bound / e.value.real))}"


def _participation(shown: Sequence[tuple[Eigenvalue, int]], bodies: Sequence[str]) -> str:
    rows = []
    for e, _ in shown:
        if not e.participation:
            continue
        order = sorted(bodies, key=lambda name: -e.participation.get(name, 0.0))
        strong = [f"{name} {e.participation[name]:.1%}" for name in order if e.participation.get(name, 0.0) >= 0.0005]
        rows.append([value_text(e), _fitting(strong, table_width() - 28) or "no mass moves"])
    return table(["eigenvalue (1/s)", "bodies"], rows, left=(1,))


def _without_shape(shown: Sequence[tuple[Eigenvalue, int]]) -> list[str]:
    """Return which eigenvalues share the shapes of others, from which they are not told apart."""
    lines = []
    for value, group in groupby((e for e, _ in shown if e.vector is None and e.together > 1), key=value_text):
        members = list(group)
        none = (
            "has no mode shape of its own" if len(members) == 1 else f"{len(members)}× have no mode shapes of their own"
        )
        text = f"{value} {none}: {members[0].together} eigenvalues are not told apart there, and share those listed"
        lines += [*wrap_lines(text), ""]
    return lines


def _fitting(words: Sequence[str], width: int) -> str:
    """Return as many words as fit, and the number of the others."""
    for count in range(len(words), 0, -1):
        text = ", ".join(words[:count]) + (f", {len(words) - count} more" if count < len(words) else "")
        if len(text) <= width or count == 1:
            return text
    return ""


def _counts(result: EigenResult | PreciseResult) -> list[str]:
    c = result.counts
    states = c.states
    rows = f"{counted(c.n_q - states, 'coordinate')}, "
    rows += f"{counted(states, 'first-order state')}, " if states else ""
    rows += f"{counted(c.n_holonomic, 'holonomic row')} (rank {c.rank_holonomic}), "
    # Each state has a row of its own.
    rows += f"{counted(c.n_nonholonomic - states, 'nonholonomic row')} (rank {c.rank_nonholonomic - states})"
    critical = f", {c.critical} critical" if c.critical else ""
    found = f"{c.expected} expected, {c.found} found, {c.neutral} of them neutral{critical}; method {result.method}"
    rows = "\n".join(wrap_lines(rows, "", "  "))
    lines = [rows, *wrap_lines(f"finite eigenvalues: {found}", "", "  ")]
    if c.massless:
        lines += wrap_lines(f"without mass: {'; '.join(c.massless)}", "", "  ")
    if c.counted:
        number = "not counted" if c.unstable_proven is None else str(c.unstable_proven)
        lines = [rows, f"finite eigenvalues: {c.expected}, of which {c.found} were looked for; method {result.method}"]
        lines += wrap_lines(f"right of the imaginary axis: {number}, {c.counted}")
    if result.period is not None:
        lines.append(f"period {result.period:.6g} s; frequencies count up to whole multiples of its inverse")
    if result.frame:
        lines += wrap_lines(f"in the frame of the steady motion: {result.frame}", "", "  ")
    if result.shifts:
        lines.append("neutral pairs are shifts and tilts that rotate with the motion")
    if c.infinite or c.undefined:
        lines.append(f"the method also returned {c.infinite} infinite eigenvalues and {c.undefined} pairs 0/0")
    if c.undefined:
        lines.append(
            "0/0: the last rows and columns of both matrices of Eq. (70) are zero, one pair for\n"
            "each constraint row; the pencil is singular for every s, and only because these\n"
            "zeros are exact can QZ still compute the other eigenvalues"
        )
    if c.extra:
        where = "0, or in the rotating frame ±i times its rate" if result.frame else "0"
        text = (
            f"the method also returned {counted(c.extra, 'eigenvalue')} of constraint drift, two for each "
            f"independent holonomic row and one for each nonholonomic row; their exact values are {where}, the "
            f"largest error is {c.extra_error:.0e} 1/s"
        )
        lines += wrap_lines(text)
    return lines
