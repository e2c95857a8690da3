"""Results as text: plain tables of the width their numbers need, never cut."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from io import StringIO
from itertools import pairwise
from textwrap import wrap
from typing import TYPE_CHECKING, Any

from mbstab.analysis.linear.methods import DEFAULT
from mbstab.analysis.linear.verdict import UNDECIDED, UNSTABLE, WORDS, Verdict, show
from mbstab.errors import counted
from mbstab.model.schema import unit_of
from mbstab.report import WIDTH

if TYPE_CHECKING:
    from mbstab.analysis.compare.check import CheckReport
    from mbstab.analysis.compare.methods import Comparison, Outcome
    from mbstab.analysis.linear.linearize import Linearization, StateSpace
    from mbstab.analysis.linear.precise import PreciseResult
    from mbstab.analysis.linear.results import EigenResult, Eigenvalue
    from mbstab.analysis.reference.equilibrium import Equilibrium
    from mbstab.analysis.sweep.chart import Chart
    from mbstab.analysis.sweep.sweep import Critical, Sweep
    from mbstab.compiler.system import Array


GAP = 2
"""Blanks between columns."""

LARGE = 12
"""Matrices with more rows or columns are shown only if all is asked for."""

NUMBER = re.compile(r"[-+]?\d+(\.\d+)?(e[-+]?\d+)?")
"""A number in a message."""

ZERO = 1e-3
"""An eigenvalue that may be zero is printed as zero if that is known to this part of the largest one."""


def table(heads: Sequence[str], rows: Sequence[Sequence[str]], left: Sequence[int] = ()) -> str:
    """Return an aligned table; columns in `left` are flush left, the others flush right.

    Columns that have no room in `WIDTH` follow below, with the first column again; texts that have none are wrapped.
    """
    first = max(map(_width, (heads[0], *(row[0] for row in rows))))
    room = max(WIDTH - first - GAP, WIDTH // 2)
    texts = [i for i in left if i]
    rows = [["\n".join(wrap(x, room)) if i in texts else x for i, x in enumerate(row)] for row in rows]
    widths = [max(map(_width, column)) for column in zip(heads, *rows, strict=True)]
    text = ""
    for block in _blocks(widths):
        cells = [[row[i] for i in block] for row in rows]
        flush = [n for n, i in enumerate(block) if i in left]
        text += ("\n" if text else "") + _aligned([heads[i] for i in block], cells, flush)
    return text


def _width(cell: str) -> int:
    return max(map(len, cell.split("\n")))


def _blocks(widths: Sequence[int]) -> list[list[int]]:
    """Return the columns that are side by side, the first one in each block."""
    blocks, used = [[0]], widths[0]
    for i, width in enumerate(widths[1:], 1):
        if used + GAP + width > WIDTH and len(blocks[-1]) > 1:
            blocks.append([0])
            used = widths[0]
        blocks[-1].append(i)
        used += GAP + width
    return blocks


def _aligned(heads: Sequence[str], rows: Sequence[Sequence[str]], left: Sequence[int]) -> str:
    """Return a table with its columns side by side."""
    from rich import box
    from rich.console import Console
    from rich.measure import Measurement
    from rich.table import Table
    from rich.text import Text

    grid = Table(box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False, padding=(0, 1, 0, 0))
    for i, head in enumerate(heads):
        grid.add_column(Text(head), justify="left" if i in left else "right", vertical="bottom")
    for row in rows:
        grid.add_row(*[Text(cell) for cell in row])
    # Measured on a very wide console: a number that does not fit is never cut.
    wide = Console(width=10_000)
    width = Measurement.get(wide, wide.options, grid).maximum
    out = StringIO()
    Console(file=out, width=width, color_system=None, force_terminal=False).print(grid)
    return "\n".join(line.rstrip() for line in out.getvalue().splitlines()) + "\n"


def number(x: float, digits: int = 6) -> str:
    """Return a number with the given significant digits, a dash where there is none."""
    return "-" if math.isnan(x) else "inf" if x == math.inf else f"{x + 0.0:.{digits}g}"


def eigenvalue(s: complex) -> str:
    """Return an eigenvalue with ten significant digits; a pair as ±."""
    if s.imag == 0.0:
        return f"{s.real:.10g}"
    # A real part that is round-off of the imaginary one is not shown with ten digits.
    real = f"{s.real:.10g}" if abs(s.real) > 1e-10 * abs(s) or not s.real else f"{s.real:.1e}"
    return f"{real} ± {abs(s.imag):.10g}i"


def eigen_text(result: EigenResult, title: str) -> str:
    """Return the answer of ``mbstab eig`` as text."""
    lines = [title, ""] if title else []
    shown = _pairs(result)
    fill = _multipliers if result.period is not None else _eigenvalues
    lines.append(fill(result, shown) if shown else "no finite eigenvalues: the motion is fully prescribed\n")
    bodies = list(dict.fromkeys(name for e, _ in shown for name in e.participation))
    if len(bodies) > 1:
        lines.append("Share of the kinetic energy of each mode:")
        lines.append(_participation(shown, bodies))
    lines += [*verdict_lines(result.judged), "", *_counts(result)]
    return "\n".join(lines) + "\n"


def verdict_lines(judged: Verdict) -> list[str]:
    """Return a verdict and what it rests on, in sentences."""
    lines = [f"Verdict: {judged.word}"]
    for reason in judged.reasons:
        lines += wrap(reason, width=WIDTH, initial_indent="  ", subsequent_indent="  ")
    return lines


def precise_text(result: PreciseResult, title: str) -> str:
    """Return the answer of ``mbstab eig --precision`` as text: real and imaginary parts on lines of their own."""
    lines = [title, ""] if title else []
    rows = []
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
    rows += [[f"± {shift}i", "-", "neutral"] for shift in result.shifts]
    if result.zeros:
        rows.append(["0", "-", f"neutral, {result.zeros}×"])
    lines.append(table(["eigenvalue\n(1/s)", "error\nbound", "type"], rows, left=(2,)) if rows else "no eigenvalues\n")
    lines += [*verdict_lines(result.judged), "", *_counts(result)]
    lines += wrap(
        f"{result.digits} digits, computed with {result.working_digits} in {result.seconds:.1f} s; smallest pivot that "
        f"counts {result.kept}, largest that counts as zero {result.dropped}, relative to the matrix",
        width=WIDTH,
    )
    return "\n".join(lines) + "\n"


def _eigenvalues(result: EigenResult, shown: Sequence[tuple[Eigenvalue, int]]) -> str:
    rows = []
    largest = max((abs(e.value) for e, _ in shown), default=0.0)
    for e, multiplicity in shown:
        if e.kind == "neutral":
            value = f"0 ± {abs(e.value.imag):.10g}i" if _goes_round(result, e) else _neutral_value(result)
            rows.append([value, "-", "-", "-", "-", f"neutral, {multiplicity}×"])
        elif e.kind == "undecided" and abs(e.value) <= e.error_bound < ZERO * largest:
            # What is not told from zero has no digits worth printing.
            both = ", 2×" if e.value.imag else ""
            rows.append(["0", "-", "-", "-", f"{e.error_bound:.0e}", f"undecided{both}"])
        else:
            rows.append(_eigenvalue_row(e))
    heads = ["eigenvalue\n(1/s)", "freq.\n(Hz)", "damping\nratio", "doubles or\nhalves in s", "error\nbound", "type"]
    return table(heads, rows, left=(5,))


def _eigenvalue_row(e: Eigenvalue) -> list[str]:
    value = "0 ± " + f"{abs(e.value.imag):.10g}i" if e.kind == "center" else eigenvalue(e.value)
    # On which side of the axis it lies may be open, and with that whether it grows.
    side = e.kind != "undecided" or e.error_bound < abs(e.value.real)
    damping = 0.0 if e.kind == "center" else e.damping_ratio if side else math.nan
    time = _time(e) if side else "-"
    return [value, number(e.frequency, 4), number(damping, 4), time, f"{e.error_bound:.0e}", e.kind]


def _multipliers(result: EigenResult, shown: Sequence[tuple[Eigenvalue, int]]) -> str:
    """Return the table of a periodic motion."""
    rows = []
    for e, multiplicity in shown:
        assert e.multiplier is not None
        if e.kind == "neutral":
            rows.append(["1", "1", "0", "-", "-", f"neutral, {multiplicity}×"])
            continue
        growth = "0" if e.kind == "center" else number(e.value.real, 8)
        size = "1" if e.kind == "center" else number(abs(e.multiplier), 8)
        rows.append([show(e.multiplier), size, growth, number(e.frequency, 4), f"{e.error_bound:.0e}", e.kind])
    heads = ["multiplier", "size", "growth\n(1/s)", "freq.\n(Hz)", "error\nbound", "type"]
    return table(heads, rows, left=(5,))


def _neutral_value(result: EigenResult) -> str:
    spread = _spread(result)
    return f"0 to {spread:.0e}" if result.method != DEFAULT and spread else "0"


def _spread(result: EigenResult) -> float:
    zeros = [abs(e.value) for e in result.eigenvalues if e.kind == "neutral" and not _goes_round(result, e)]
    return max(zeros, default=0.0)


def _pairs(result: EigenResult) -> list[tuple[Eigenvalue, int]]:
    """Return one of each conjugate pair, and the neutral ones as one entry with their number."""
    found = result.eigenvalues
    shown: list[tuple[Eigenvalue, int]] = [(e, 1) for e in found if e.kind != "neutral" and e.value.imag >= 0.0]
    neutral = [e for e in found if e.kind == "neutral"]
    turning = [e for e in neutral if _goes_round(result, e)]
    zeros = [e for e in neutral if e not in turning]
    return shown + [(group[0], len(group)) for group in (turning, zeros) if group]


def _goes_round(result: EigenResult, e: Eigenvalue) -> bool:
    """Whether a neutral eigenvalue belongs to a shift seen from a turning frame; QZ scatters it a little."""
    return any(abs(e.value.imag) > 0.5 * frequency for frequency in result.shifts)


def _time(e: Eigenvalue) -> str:
    time = e.time_to_double
    if math.isinf(time):
        return "-"
    return f"{'2×' if time > 0 else '½'} {number(abs(time), 4)}"


def _participation(shown: Sequence[tuple[Eigenvalue, int]], bodies: Sequence[str]) -> str:
    rows = []
    for e, _ in shown:
        if e.kind == "neutral":
            continue
        order = sorted(bodies, key=lambda name: -e.participation.get(name, 0.0))
        strong = [f"{name} {e.participation[name]:.1%}" for name in order if e.participation.get(name, 0.0) >= 0.0005]
        value = "0 ± " + f"{abs(e.value.imag):.6g}i" if e.kind == "center" else show(e.value)
        rows.append([value, _fitting(strong, WIDTH - 28)])
    return table(["eigenvalue (1/s)", "bodies"], rows, left=(1,))


def _fitting(words: Sequence[str], width: int) -> str:
    """Return as many words as fit, and how many more there are."""
    for count in range(len(words), 0, -1):
        text = ", ".join(words[:count]) + (f", {len(words) - count} more" if count < len(words) else "")
        if len(text) <= width or count == 1:
            return text
    return ""


def _counts(result: EigenResult | PreciseResult) -> list[str]:
    c = result.counts
    rows = f"{counted(c.n_q, 'coordinate')}, {counted(c.n_holonomic, 'holonomic row')} (rank {c.rank_holonomic})"
    rows += f", {counted(c.n_nonholonomic, 'nonholonomic row')} (rank {c.rank_nonholonomic})"
    lines = [
        rows,
        f"finite eigenvalues: {c.expected} expected, {c.found} found, {c.neutral} of them neutral; "
        f"method {result.method}",
    ]
    if result.period is not None:
        lines.append(f"period {result.period:.6g} s; frequencies count up to whole multiples of its inverse")
    if result.frame:
        lines += wrap(f"in the frame of the steady motion: {result.frame}", width=WIDTH, subsequent_indent="  ")
    if result.shifts:
        lines.append("neutral pairs are shifts and tilts that go round with the motion")
    if c.infinite or c.undefined:
        lines.append(f"besides, the method returned {c.infinite} infinite eigenvalues and {c.undefined} pairs 0/0")
    if c.undefined:
        lines.append(
            "0/0: the last rows and columns of both matrices of Eq. (70) are zero, one pair for\n"
            "each constraint row; the pencil is singular for every s, and only because these\n"
            "zeros are exact can QZ still compute the other eigenvalues"
        )
    if c.extra:
        where = "0, or in the turning frame ±i times its rate" if result.frame else "0"
        text = (
            f"besides, the method returned {counted(c.extra, 'eigenvalue')} of constraint drift, two for each "
            f"independent holonomic row and one for each nonholonomic row; exactly they are {where}, the worst came "
            f"out {c.extra_error:.0e} 1/s away"
        )
        lines += wrap(text, width=WIDTH)
    if c.neutral and (names := (*result.modulo.symmetries, *result.modulo.family)):
        shown = _fitting(names, 3 * WIDTH)
        lines += wrap(f"neutral eigenvalues belong to: {shown}", width=WIDTH, subsequent_indent="  ")
    return lines


def equilibrium_text(found: Sequence[Equilibrium], names: Sequence[str], title: str) -> str:
    """Return the answer of ``mbstab equilibrium`` as text."""
    lines = [title, ""] if title else []
    if len(found) > 1:
        lines += [f"{len(found)} distinct solutions", ""]
    for number, item in enumerate(found, 1):
        kind = "Equilibrium" if str(item.steady) == "rest" else f"Steady motion ({item.steady})"
        lines += wrap(kind + (f" {number} of {len(found)}" if len(found) > 1 else ""), width=WIDTH)
        lines += [text for text in (_state_table(item, names), _reaction_table(item), _effort_table(item)) if text]
        lines += wrap(
            f"found by {item.strategy} in {counted(item.iterations, 'step')}; largest imbalance {item.residual:.1e} of "
            f"what balances ({item.unbalanced[0]:.1e} N, {item.unbalanced[1]:.1e} N*m)",
            width=WIDTH,
        )
        apart = f", apart from {', '.join(item.symmetries)}" if item.symmetries else ""
        text = f"isolated{apart}" if item.isolated else f"not isolated: {'; '.join(item.open)}{apart}"
        lines += [*wrap(text, width=WIDTH, subsequent_indent="  "), ""]
        if item.timed:
            lines.insert(-1, f"at t = {item.motion.time:g} s: forces or drives depend on the time")
        if item.motion.redundant:
            lines.insert(-1, "constraints are redundant: of the reactions only their sums are determined")
    return "\n".join(lines).rstrip("\n") + "\n"


def _state_table(item: Equilibrium, names: Sequence[str]) -> str:
    moving, fastest = bool(item.motion.u.any()), float(abs(item.motion.u).max())
    rows = []
    for name, q, u in zip(names, item.motion.q, item.motion.u, strict=True):
        unit = unit_of(name)
        rate = u if abs(u) > 1e-14 * fastest else 0.0
        rows.append([name, number(q, 10), unit, *([number(rate, 6), f"{unit}/s"] if moving else [])])
    heads = ["coordinate", "value", "", *(["rate", ""] if moving else [])]
    return table(heads, rows, left=(0, 2, 4))


def _reaction_table(item: Equilibrium) -> str:
    if not item.reactions:
        return ""
    largest, rows = _largest_load(item), []
    for r in item.reactions:
        # What is rounding beside the largest load is zero to a reader.
        force, torque = (
            ", ".join(number(x if abs(x) > 1e-12 * largest else 0.0, 5) for x in v) if len(v) else "-"
            for v in (r.force, r.torque)
        )
        rows.append([r.owner, r.body, force, torque])
    axes = ", ".join("xyz"[: len(item.reactions[0].force)])
    return table(["reaction of", "on", f"force {axes} (N)", "torque (N*m)"], rows, left=(0, 1))


def _largest_load(item: Equilibrium) -> float:
    """Return the largest component of a reaction or effort, N and N·m alike."""
    reactions = (float(abs(x)) for r in item.reactions for x in (*r.force, *r.torque))
    return max((*reactions, *(float(abs(e.values)) for e in item.efforts)), default=0.0)


def _effort_table(item: Equilibrium) -> str:
    least = 1e-12 * _largest_load(item)
    values = (float(e.values) if abs(e.values) > least else 0.0 for e in item.efforts)
    rows = [[e.owner, e.along, number(x, 5), e.unit] for e, x in zip(item.efforts, values, strict=True)]
    return table(["effort of", "along", "value", ""], rows, left=(0, 1, 3)) if rows else ""


def sweep_text(result: Sweep, unit: str, factor: float, title: str) -> str:
    """Return the summary of ``mbstab sweep``: where stability changes, and how it is in between."""
    lines = [title, ""] if title else []
    label = f"{result.parameter} ({unit})" if unit else result.parameter
    first, last = (number(float(result.values[k]) / factor, 6) for k in (0, -1))
    count = result.branches.shape[1]
    lines.append(f"{label} from {first} to {last}, {len(result.values)} points")
    lines.append(f"{counted(count, 'branch', 'branches')}, {counted(result.neutral, 'neutral eigenvalue')} besides")
    if result.start is not None:
        lines.append(f"equilibria followed from {result.parameter} = {number(result.start / factor)}")
    if result.moved:
        lines += wrap(f"not from the first value: {result.moved}", width=WIDTH)
    lines += ["", *_path(result, label, factor)]
    for n, path in enumerate(result.beyond, 2):
        assert path.start is not None
        turn = f"{result.parameter} = {number(path.start / factor, 6)}"
        lines += [
            "",
            f"path {n}, beyond the turn at {turn}, {counted(len(path.values), 'point')}",
            "",
            *_path(path, label, factor),
        ]
    return "\n".join(lines).rstrip("\n") + "\n"


def _path(result: Sweep, label: str, factor: float) -> list[str]:
    """Return what happens along one path of a sweep."""
    alike = len({*result.words.tolist()}) == 1 and len(result.words) and result.words[0] != WORDS.index(UNDECIDED)
    lines = ["stability does not change in this range", ""] if alike else []
    if result.critical:
        rows = [
            [
                f"{_rounded(c.value, result) / factor:.13g}",
                c.kind + _signs(c) + (", branch point" if c.branching and c.kind != "branch point" else ""),
                number(c.frequency, 6) if c.frequency else "-",
                ", ".join(str(b + 1) for b in c.branches) or "-",
                " → ".join("none" if n < 0 else str(n) for n in c.unstable),
            ]
            for c in result.critical
        ]
        heads = [f"critical\n{label}", "what happens", "frequency\n(rad/s)", "branch", "unstable\neigenvalues"]
        lines = [table(heads, rows, left=(1, 3))]
    if any(c.signatures for c in result.critical):
        lines += ["signs of a collision: energies of the two modes that meet (Krein signatures)", ""]
    lines += _ranges(result, factor)
    if result.meetings:
        shown = [f"{what} at {number(_rounded(value, result) / factor, 6)}" for value, what in result.meetings]
        lines += ["", *wrap("branches " + ", ".join(shown[:12]) + (" …" if len(shown) > 12 else ""), width=WIDTH)]
    if result.problems:
        lines += ["", f"{counted(len(result.problems), 'point')} without an answer:"]
        for text in _refused(result, factor):
            lines += wrap(text, width=WIDTH, initial_indent="  ", subsequent_indent="    ")
    return lines


def _refused(result: Sweep, factor: float) -> list[str]:
    """Return the values without an answer, those with the same reason together; reasons differ by more than numbers."""
    groups: dict[str, list[int]] = {}
    for i, text in sorted(result.problems.items()):
        groups.setdefault(NUMBER.sub("#", text.splitlines()[0]), []).append(i)
    found = []
    for points in groups.values():
        texts = list(dict.fromkeys(result.problems[i].splitlines()[0] for i in points))
        alike = " (alike at the others)" if len(texts) > 1 else ""
        found.append(f"{_places(points, result, factor)}: {texts[0]}{alike}")
    return found


def _places(points: list[int], result: Sweep, factor: float) -> str:
    """Return values of the parameter by the numbers of points, neighbours as a range."""
    runs: list[list[int]] = []
    for i in points:
        if runs and i == runs[-1][-1] + 1:
            runs[-1].append(i)
        else:
            runs.append([i])
    shown = []
    for run in runs:
        first, last = (number(float(result.values[i]) / factor, 6) for i in (run[0], run[-1]))
        shown.append(f"at {first}" if len(run) == 1 else f"at {len(run)} values from {first} to {last}")
    return ", ".join(shown)


def _signs(c: Critical) -> str:
    return "" if c.signatures is None else " (" + "".join("+" if x > 0 else "-" for x in c.signatures) + ")"


def _rounded(value: float, result: Sweep) -> float:
    """Return a value of the parameter, 0 if it is rounding beside the others."""
    places = [*result.values[:1], *result.values[-1:], *(c.value for c in result.critical), result.start or 0.0]
    return value if abs(value) > 1e-11 * max(abs(x) for x in places) else 0.0


def _ranges(result: Sweep, factor: float) -> list[str]:
    """Return the verdicts between the critical values, one line for each range of the same word."""
    order = result.values.argsort()
    x, words, counts = result.values[order], result.words[order], result.unstable[order]
    missing = {len(x) - 1 - i if len(x) > 1 and order[0] else i for i in result.problems}
    critical = sorted(result.critical, key=lambda c: c.value)
    width = max([abs(float(p)) for p in x] + [abs(c.value) for c in critical], default=0.0)
    begin = [] if result.start is None else [result.start]
    edges = [min([*x, *begin], default=0.0), *(c.value for c in critical), max([*x, *begin], default=0.0)]
    # What lies on a critical value belongs to neither side.
    at = {i for i, p in enumerate(x) if any(abs(p - c.value) <= 1e-9 * width for c in critical)}
    runs: list[_Run] = []
    for n, (a, b) in enumerate(pairwise(edges)):
        inside = [i for i, p in enumerate(x) if a <= p <= b and i not in at and not (n and p == a)]
        found = _runs(inside, a, b, x, words, counts, missing)
        if not inside and b > a and critical:
            near = [c.verdicts[k] for c, k in ((critical[n - 1], 1),) if n] + [
                c.verdicts[0] for c in critical[n : n + 1]
            ]
            known = [word for word in near if word]
            growing = critical[n].unstable[0] if n < len(critical) else critical[n - 1].unstable[1]
            if known and all(word == known[0] for word in known):
                found = [_Run(a, b, known[0], {growing})]
        runs += found
    runs += [_Run(float(x[i]), float(x[i]), WORDS[int(words[i])], {int(counts[i])}) for i in at - missing]
    runs.sort(key=lambda run: run.low + run.high)
    lines = []
    for run in runs:
        ends = (edges[0], edges[-1])
        low, high = ((x if x in ends else _rounded(x, result)) / factor for x in (run.low, run.high))
        many = f" ({', '.join(map(str, sorted(run.counts)))})" if run.word == UNSTABLE and any(run.counts) else ""
        place = f"{number(low, 6)} to {number(high, 6)}" if high > low else f"at {number(low, 6)}"
        lines.append(f"  {place}: {run.word}{many}")
    return lines


@dataclass
class _Run:
    """A range of the same verdict, with the numbers of unstable eigenvalues in it."""

    low: float
    high: float
    word: str
    counts: set[int]


def _runs(inside: list[int], a: float, b: float, x: Array, words: Any, counts: Any, missing: set[int]) -> list[_Run]:
    """Return the ranges of points between two critical values or ends, up to these where nothing is missing."""
    runs: list[_Run] = []
    whole = True
    for i in inside:
        value, word = float(x[i]), WORDS[int(words[i])]
        if i in missing:
            whole = False
            continue
        # Unstable without an eigenvalue right of the axis: a multiple one on it, at this value alone.
        same = bool(runs) and runs[-1].word == word and (0 in runs[-1].counts) == (counts[i] == 0)
        if same and whole:
            runs[-1].high = value
            runs[-1].counts.add(int(counts[i]))
        else:
            runs.append(_Run(a if whole and not runs else value, value, word, {int(counts[i])}))
        whole = True
    if runs and whole:
        runs[-1].high = b
    return runs


def chart_text(result: Chart, labels: Sequence[tuple[str, float]], title: str) -> str:
    """Return the summary of a stability chart."""
    lines = [title, ""] if title else []
    for name, (unit, factor), along in zip(result.parameters, labels, (result.x, result.y), strict=True):
        first, last = number(float(along[0]) / factor), number(float(along[-1]) / factor)
        lines.append(f"{name}{f' ({unit})' if unit else ''} from {first} to {last}, {len(along)} values")
    import numpy as np

    rows = []
    unanswered = np.zeros(result.unstable.size, dtype=bool)
    unanswered[list(result.problems)] = True
    words, counts = result.words.ravel(), result.unstable.ravel()
    for k, word in enumerate(WORDS):
        here = (words == k) & ~unanswered
        for n in sorted({int(n) for n in counts[here]}):
            share = float(np.mean(here & (counts == n)))
            rows.append([f"{word} ({n})" if word == UNSTABLE else word, f"{share:.1%}"])
    if unanswered.any():
        rows.append(["no answer", f"{float(unanswered.mean()):.1%}"])
    lines += ["", table(["region", "part of the points"], rows, left=(0,))]
    lines.append(f"{counted(len(result.boundaries), 'boundary curve')}")
    return "\n".join(lines) + "\n"


def compare_text(result: Comparison, title: str) -> str:
    """Return the answer of ``mbstab compare`` as text."""
    truth, outcomes = result.truth, result.outcomes
    lines = [title, ""] if title else []
    heads = ["", "method", "largest\nerror", "method\nalone", "claimed\nbound", "time\n(ms)", "memory\n(kB)", "lost"]
    lines.append(
        table([*heads, "invented"], [_outcome_row(n, x, truth.digits) for n, x in enumerate(outcomes, 1)], left=(1,))
    )
    lines += _filled(
        f"errors: relative to the modulus of each eigenvalue, against {truth.digits} digits, which took "
        f"{truth.seconds:.2g} s"
    )
    if len(result.rounding) and not _unknown(result):
        lines += _filled(
            f"rounding of parameters and matrices to double moves eigenvalues by up to "
            f"{_size(max(result.rounding), truth.digits)}; "
            "method alone: error against the exact eigenvalues of these matrices"
        )
    elif len(result.rounding):
        lines += _filled("method alone: not known, as rounding makes redundant constraints contradict each other")
    lines += _filled(
        "time: from the reference motion to eigenvalues and vectors (the motion and checks before that: "
        f"{1e3 * result.seconds:.3g} ms); of digits all of it"
    )
    if truth.eigenvalues:
        lines += ["", *_error_tables(result)]
    lines += _failures(outcomes) + _remarks(outcomes)
    if truth.neutral:
        lines.append(f"{counted(truth.neutral, 'neutral eigenvalue')} besides")
    lines.append(f"Verdict with {truth.digits} digits: {truth.verdict}")
    different = [f"{n} {x.method} ({x.verdict})" for n, x in enumerate(outcomes, 1) if _differs(x, result)]
    if different:
        lines += _filled(f"another verdict by {', '.join(different)}")
    if result.chosen is not None:
        lines += ["", *_filled(_choice(result))]
    return "\n".join(lines).rstrip("\n") + "\n"


def _outcome_row(n: int, x: Outcome, digits: int) -> list[str]:
    if x.failure:
        return [str(n), x.method, "no answer", *["-"] * 6]
    memory = number(x.memory / 1e3, 3) if x.memory < 1e6 else f"{x.memory / 1e3:.0f}"
    time = number(1e3 * x.seconds, 3) if x.seconds < 1.0 else f"{1e3 * x.seconds:.0f}"
    largest = max((e for e in x.errors if not math.isnan(e)), default=math.nan)
    own = max((e for e in x.own_errors if not math.isnan(e)), default=math.nan)
    bound = x.bound if any(not math.isnan(b) for b in x.bounds) else math.nan
    return [
        str(n),
        x.method,
        _size(largest, digits),
        _size(own, digits),
        _size(bound),
        time,
        memory,
        str(x.lost),
        str(x.invented),
    ]


def _filled(text: str) -> list[str]:
    return wrap(text, width=WIDTH, subsequent_indent="  ", break_on_hyphens=False)


ROUNDING = "rounding of data"


def _error_tables(result: Comparison) -> list[str]:
    """Return the error of each method in each eigenvalue, as many eigenvalues beside each other as fit."""
    shown = [i for i, e in enumerate(result.truth.eigenvalues) if e.value.imag >= 0]
    names, digits = [x.method for x in result.outcomes], result.truth.digits
    blocks: list[list[int]] = []
    room = 0
    for i in shown:
        width = max(map(len, _head(result, i).splitlines())) + 2
        if width > room:
            blocks.append([])
            room = WIDTH - 4 - max(map(len, [ROUNDING, *names]))
        blocks[-1].append(i)
        room -= width
    texts = []
    for block in blocks:
        rows = [
            [str(n), x.method, *(_size(float(x.errors[i]), digits) for i in block)]
            for n, x in enumerate(result.outcomes, 1)
        ]
        if not _unknown(result):
            rows.append(["", ROUNDING, *(_size(float(result.rounding[i]), digits) for i in block)])
        heads = ["", "error in the\neigenvalue (1/s)", *(_head(result, i) for i in block)]
        texts.append(table(heads, rows, left=(1,)))
    return texts


def _head(result: Comparison, i: int) -> str:
    """Return an eigenvalue on two lines, with ten digits."""
    text = eigenvalue(complex(result.truth.eigenvalues[i].value))
    return text.replace(" ± ", "\n± ")


def _failures(outcomes: Sequence[Outcome]) -> list[str]:
    """Return why methods have no answer, the same of several once."""
    texts: dict[str, list[str]] = {}
    for n, x in enumerate(outcomes, 1):
        if x.failure:
            text = x.failure.splitlines()[0].removeprefix(f"--method {x.method} ")
            texts.setdefault(text, []).append(str(n))
    return [line for text, numbers in texts.items() for line in _filled(f"no answer by {', '.join(numbers)}: {text}")]


def _remarks(outcomes: Sequence[Outcome]) -> list[str]:
    """Return what methods returned besides, the same of several in one line."""
    texts: dict[str, list[str]] = {}
    for n, x in enumerate(outcomes, 1):
        parts = [x.besides] if x.besides else []
        parts += [f"drift off by {x.drift:.0e} 1/s"] if x.drift else []
        parts += [f"zeros off by {x.zeros:.0e} 1/s"] if x.zeros else []
        parts += ["an error above its bound"] if x.exceeded else []
        if parts:
            texts.setdefault(", ".join(parts), []).append(str(n))
    found = [line for text, numbers in texts.items() for line in _filled(f"{', '.join(numbers)}: {text}")]
    return [*(["besides:"] if found else []), *(f"  {line}" for line in found)]


def _unknown(result: Comparison) -> bool:
    """Whether it is not known what rounding of the data does."""
    return any(math.isnan(x) for x in result.rounding)


def _differs(x: Outcome, result: Comparison) -> bool:
    return not x.failure and x.verdict != result.truth.verdict


def _size(x: float, digits: int = 0) -> str:
    """Return the size of an error; nothing is said about one below the digits of the truth."""
    if math.isnan(x):
        return "-"
    return f"<1e-{digits}" if digits and (x == 0.0 or x < 10.0**-digits) else f"{x:.0e}"


def _choice(result: Comparison) -> str:
    chosen, tolerance = result.chosen, result.tolerance
    assert chosen is not None
    faster = result.faster()
    error = _size(chosen.error, result.truth.digits)
    text = f"{chosen.method} keeps {tolerance:g}: error {error} in {1e3 * chosen.seconds:.3g} ms"
    missed = ", ".join(f"{x.method} ({_size(x.error) if math.isfinite(x.error) else 'wrong'})" for x in faster)
    return f"{text}; faster ones do not: {missed}" if faster else f"{text}, and none is faster"


def check_text(report: CheckReport, title: str) -> str:
    """Return the answer of ``mbstab check`` as text."""
    lines = [title, ""] if title else []
    kind = "planar" if report.dimension == 2 else "spatial"
    lines += [
        f"{kind} scene, {counted(len(report.bodies), 'body', 'bodies')}, {counted(report.n_q, 'coordinate')}",
        table(
            ["body", "coordinates", "mass (kg)"],
            [[n, ", ".join(c), number(m)] for n, c, m in report.bodies],
            left=(0, 1),
        ),
    ]
    if report.constraints:
        rows = [[name, kind, str(h), str(n)] for name, kind, h, n in report.constraints]
        lines.append(table(["constraint", "type", "holonomic\nrows", "nonholonomic\nrows"], rows, left=(0, 1)))
    lines += [
        f"holonomic rows      {report.n_holonomic}, rank {report.rank_holonomic}{_gap(report.gaps[0])}",
        f"nonholonomic rows   {report.n_nonholonomic}, rank {report.rank_nonholonomic}{_gap(report.gaps[1])}",
        f"degrees of freedom  {report.degrees_of_freedom}",
        f"finite eigenvalues  {report.n_f}",
        f"reference           {'at rest' if report.at_rest else 'in motion'}",
        f"largest residuals   {report.position_residual:.1e} in position, {report.velocity_residual:.1e} in velocity",
    ]
    for head, items in (
        ("solved by the program", [", ".join(report.solved)] if report.solved else []),
        ("redundant constraints", report.redundant),
        ("ignorable coordinates and symmetries", report.symmetries),
        ("not needed", report.unneeded),
    ):
        if items:
            lines += ["", f"{head}:"]
            for item in items:
                lines += wrap(item, width=WIDTH, initial_indent="  ", subsequent_indent="    ")
    return "\n".join(lines) + "\n"


def _gap(gap: float) -> str:
    return "" if math.isinf(gap) else f" (gap {gap:.0e})"


def matrix_text(name: str, matrix: Any, rows: Sequence[str], columns: Sequence[str]) -> str:
    """Return a matrix with the names of its rows and columns, in blocks of columns that fit the terminal.

    Entries below the round-off of the largest one are dots, like zeros.
    """
    text = f"{name}  ({len(rows)} × {len(columns)})\n"
    if not rows or not columns:
        return text
    smallest = 1e-15 * max(abs(x) for values in matrix for x in values)
    cells = [[f"{x:.6g}" if abs(x) > smallest else "." for x in values] for values in matrix]
    widths = [max(len(head), *(len(row[j]) for row in cells)) + 2 for j, head in enumerate(columns)]
    start, room = 0, WIDTH - max(map(len, rows))
    while start < len(columns):
        stop, used = start + 1, widths[start]
        while stop < len(columns) and used + widths[stop] <= room:
            used += widths[stop]
            stop += 1
        body = [[row, *values[start:stop]] for row, values in zip(rows, cells, strict=True)]
        text += table(["", *columns[start:stop]], body, left=(0,))
        start = stop
    return text


def linearize_text(linear: Linearization, space: StateSpace, form: str, title: str, full: bool = False) -> str:
    """Return the answer of ``mbstab linearize`` as text; large matrices are shown if all is asked for."""
    from mbstab.report.export import forms

    lines = [title, ""] if title else []
    lines += _linear_summary(linear, space)
    matrices = forms(linear, space)[form]
    hidden = {} if full else {name: m for name, m in matrices.items() if max(len(m[1]), len(m[2])) > LARGE}
    lines += [matrix_text(name, *m) for name, m in matrices.items() if name not in hidden]
    if hidden:
        rows = [
            [name, f"{len(m[1])} × {len(m[2])}", str(int((m[0] != 0.0).sum())), f"{abs(m[0]).max(initial=0.0):.6g}"]
            for name, m in hidden.items()
        ]
        lines.append(table(["matrix", "size", "not zero", "largest"], rows, left=(0,)))
        lines += wrap(f"matrices with more than {LARGE} rows or columns: --full shows them", width=WIDTH)
    return "\n".join(lines).rstrip("\n") + "\n"


def _linear_summary(linear: Linearization, space: StateSpace) -> list[str]:
    """Return the sizes of the linearized equations, and in which frame they stand still."""
    n_n = len(linear.J) - linear.n_h
    rows = f"{counted(linear.n_h, 'holonomic row')}, {counted(n_n, 'nonholonomic row')}"
    text = f"{counted(len(linear.M), 'coordinate')}, {rows}, {counted(len(space.A), 'state')} after deflation"
    lines = wrap(text, width=WIDTH)
    if linear.generator is not None and linear.generator.turns:
        lines += wrap(f"in the frame of the steady motion: {linear.generator}", width=WIDTH, subsequent_indent="  ")
    return [*lines, ""]
