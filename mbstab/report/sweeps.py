"""Sweeps and stability charts as text: where stability changes, and the verdicts in between."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from decimal import Decimal
from itertools import groupby
from typing import TYPE_CHECKING, TypeVar

from mbstab.analysis.verdict.rule import UNDECIDED, UNSTABLE, WORDS
from mbstab.errors import counted
from mbstab.model.schema import Model
from mbstab.report.export import unit_factors
from mbstab.report.sensitivity import critical_text
from mbstab.report.styles import Style, document
from mbstab.report.tables import decimals, number, table, wrap_lines
from mbstab.report.verdicts import with_verdict, word_style

if TYPE_CHECKING:
    from mbstab.analysis.sweep.chart import Chart
    from mbstab.analysis.sweep.critical import Critical
    from mbstab.analysis.sweep.ranges import Range
    from mbstab.analysis.sweep.sweep import Sweep
    from mbstab.compiler.system import Array

T = TypeVar("T")

NUMBER = re.compile(r"[-+]?\d+(\.\d+)?(e[-+]?\d+)?")
"""A number in a message."""

ON_EDGE = 1e-9
"""Points of boundaries are on an edge of a chart if they are nearer than this part of the range."""

SHOWN = 13
"""Digits of a proven critical value, which `decimals` shows with a few more: its row has room for them."""


def sweep_text(result: Sweep, model: Model, sensitivity: bool = False) -> str:
    """Return the summary of ``mbstab sweep``: where stability changes, and the verdicts in between."""
    ((unit, factor),) = unit_factors(model, result.parameter)
    lines: list[str] = []
    label = f"{result.parameter} ({unit})" if unit else result.parameter
    first, last = (number(float(result.values[k]) / factor, 6) for k in (0, -1))
    count = result.branches.shape[1]
    lines.append(f"{label} from {first} to {last}, {len(result.values)} points")
    numbers: dict[str, list[str]] = {}
    for b, name in enumerate(result.names, 1):
        numbers.setdefault(name, []).append(str(b))
    named = "; ".join(f"{', '.join(own)} {name}" for name, own in numbers.items() if name)
    branches = counted(count, "branch", "branches") + (f" ({named})" if named else "")
    lines += wrap_lines(f"{branches}, {counted(result.neutral, 'neutral eigenvalue')} besides")
    if result.start is not None:
        lines.append(f"equilibria followed from {result.parameter} = {number(result.start / factor)}")
    if result.moved:
        lines += wrap_lines(f"not from the file's own value, or nearest to it: {result.moved}")
    lines += ["", *_path(result, label, factor)]
    for n, path in enumerate(result.beyond, 2):
        assert path.start is not None
        turns = [c.value for earlier in (result, *result.beyond[: n - 2]) for c in earlier.critical if c.kind == "fold"]
        place = "beyond the turn" if path.start in turns else "from the branch point"
        place += f" at {result.parameter} = {number(_rounded(path.start, result) / factor, 6)}"
        lines += ["", f"path {n}, {place}, {counted(len(path.values), 'point')}", "", *_path(path, label, factor)]
    if result.orders:
        lines += ["", *_crossings(result, label, factor)]
    return document([document(lines), critical_text(result, model)] if sensitivity else lines)


def _crossings(result: Sweep, label: str, factor: float) -> list[str]:
    """Return the crossings of frequencies with orders of the parameter."""
    orders = ", ".join(f"{k:g}" for k in result.orders)
    if not result.crossings:
        places = counted(len(result.values), "point")
        return [f"no frequency crosses the orders {orders}, as far as {places} show"]
    rows = [
        [f"{c.value / factor:.12g}", f"{c.order:g}", f"{c.frequency:.12g}", _branch(result, c.branch), c.whirl or "-",
         c.motions[0][0] if c.motions else "-"]
        for c in result.crossings
    ]  # fmt: skip
    heads = [f"crossing at\n{label}", "order", "frequency\n(rad/s)", "branch", "whirl", "moves most"]
    return [table(heads, rows, left=(3, 4, 5))]


def _path(result: Sweep, label: str, factor: float) -> list[str]:
    """Return the events along one path of a sweep."""
    alike = len({*result.words.tolist()}) == 1 and len(result.words) and result.words[0] != WORDS.index(UNDECIDED)
    lines: list[str] = ["no change of stability was found at these points or between them", ""] if alike else []
    if result.critical:
        rows = [
            [
                *_place(c, result, factor),
                c.kind + _signs(c) + (", branch point" if c.branching and c.kind != "branch point" else ""),
                number(c.frequency, 6) if c.frequency else "-",
                ", ".join(_branch(result, b) for b in c.branches) or "-",
                " → ".join(
                    str(n) if n >= 0 else "?" if c.kind == "unresolved" else "none"
                    for n in _in_order(result, c.unstable)
                ),
            ]
            for c in _in_order(result, result.critical)
        ]
        certified = result.critical[0].enclosed is not None
        heads = [f"critical\n{label}", *(["proven\nto"] if certified else []), "what happens", "frequency\n(rad/s)"]
        lines = [table([*heads, "branch", "unstable\neigenvalues"], rows, left=(2, 4) if certified else (1, 3))]
        lines += _proofs(result, factor)
    if any(c.signatures for c in result.critical):
        lines += ["signs of a collision: energies of the two modes that meet (Krein signatures)", ""]
    lines += _ranges(result, factor)
    if result.meetings:
        shown = [
            f"{number(_rounded(value, result) / factor, 6)} ({f'{pairs} pairs ' if pairs > 1 else ''}{what})"
            for (value, what), pairs in _in_order(result, [*Counter(result.meetings).items()])
        ]
        said = ", ".join(shown[:12]) + (" …" if len(shown) > 12 else "")
        lines += ["", *wrap_lines(f"branches meet at {label}: {said}")]
    if result.problems:
        lines += ["", f"{counted(len(result.problems), 'point')} without an answer:"]
        for text in _refused(result, factor):
            lines += wrap_lines(text, "  ", "    ")
    return lines


def _in_order(result: Sweep, ascending: Sequence[T]) -> Sequence[T]:
    """Return what ascends with the parameter in the order in which its values were asked for."""
    falls = len(result.values) > 1 and result.values[0] > result.values[-1]
    return ascending[::-1] if falls else ascending


def _branch(result: Sweep, b: int) -> str:
    """Return what a branch is called: its number, and its name."""
    name = result.names[b] if result.names else ""
    return f"{b + 1} {name}" if name else str(b + 1)


def _place(c: Critical, result: Sweep, factor: float) -> list[str]:
    """Return a critical value, and where it was to be proven its radius."""
    value = number(_rounded(c.value, result) / factor, 13, c.error / factor)
    if c.enclosed is None:
        return [value]
    if c.enclosed.value is None:
        return [value, "-"]
    shown = decimals(c.enclosed.value, SHOWN)
    return [str(Decimal(shown["midpoint"])), f"± {shown['radius']}"]


def _proofs(result: Sweep, factor: float) -> list[str]:
    """Return what the proofs of critical values rest on, and why there is none."""
    groups: dict[str, list[str]] = {}
    for c in result.critical:
        if c.enclosed is not None and (c.enclosed.conditions or c.enclosed.reason):
            text = f"not proven: {c.enclosed.reason}"
            if c.enclosed.value is not None:
                text = f"proven, provided that {'; that '.join(c.enclosed.conditions)}"
            groups.setdefault(text, []).append(number(_rounded(c.value, result) / factor, 6))
    lines = []
    for text, values in groups.items():
        lines += wrap_lines(f"{', '.join(values)} {text}", "  ", "    ")
    return [*lines, ""] if lines else []


def _refused(result: Sweep, factor: float) -> list[str]:
    """Return the values without an answer, grouped by reason; reasons that differ in numbers only are the same."""
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
    """Return the parameter values of points, neighbours as a range."""
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
    """Return a value of the parameter, 0 if it is rounding error compared with the others."""
    places = [*result.values[:1], *result.values[-1:], *(c.value for c in result.critical), result.start or 0.0]
    return value if abs(value) > 1e-11 * max(abs(x) for x in places) else 0.0


def _ranges(result: Sweep, factor: float) -> list[str]:
    """Return the verdicts between the critical values, one line for each range of the same word."""
    lines: list[str] = []
    runs = _in_order(result, result.ranges)
    for run in runs:
        low, high = (_rounded(x, result) / factor for x in (run.low, run.high))
        word, many = WORDS[run.word], f" ({', '.join(map(str, run.counts))})"
        first, last = (number(x, 6) for x in _in_order(result, (low, high)))
        place = f"{first} to {last}" if high > low else f"at {first}"
        more = many if word == UNSTABLE and any(run.counts) else _located(result, run)
        lines.append(with_verdict(f"  {place}: ", word, more))
    if any(run.high > run.low for run in runs):
        points = counted(len(result.values) - len(result.problems), "point")
        lines += wrap_lines(f"(as {points} show: what is narrower than their distance may be missed)")
    if set(result.words.tolist()) == {WORDS.index(UNDECIDED)} and not result.problems:
        lines += ["", *_open_hint({result.parameter: (result.values, factor)})]
    return lines


def _open_hint(along: Mapping[str, tuple[Array, float]]) -> list[str]:
    """Return how to learn why no point is decided; given the values (SI) of each parameter and its unit."""
    middle = (f"--set {name}={number(float(x[len(x) // 2]) / unit, 6)}" for name, (x, unit) in along.items())
    return wrap_lines(f"hint: mbstab eig with {' '.join(middle)} says what is open there", hyphens=False)


def _located(result: Sweep, run: Range) -> str:
    """Return where eigenvalues lie in an undecided range, in words."""
    inside = (result.values >= run.low) & (result.values <= run.high) & (result.words == WORDS.index(UNDECIDED))
    if WORDS[run.word] != UNDECIDED or not len(found := result.located[inside]):
        return ""
    least, most = found.min(axis=0).tolist(), found.max(axis=0).tolist()
    numbers = [f"{low} to {high}" if high > low else str(low) for low, high in zip(least, most, strict=True)]
    words = "right", "left", "on the axis", "of unknown side"
    parts = [f"{n} {word}" for n, word in zip(numbers, words, strict=True) if n != "0" or word == "right"]
    return f" ({', '.join(parts)})"


def chart_text(result: Chart, model: Model) -> str:
    """Return the summary of a stability chart."""
    lines: list[str] = []
    labels = unit_factors(model, *result.parameters)
    for name, (unit, factor), along in zip(result.parameters, labels, (result.x, result.y), strict=True):
        first, last = number(float(along[0]) / factor), number(float(along[-1]) / factor)
        lines.append(f"{name}{f' ({unit})' if unit else ''} from {first} to {last}, {len(along)} values")
    if result.start is not None:
        begin = (
            f"{name} = {number(value / factor)}"
            for name, value, (_, factor) in zip(result.parameters, result.start, labels, strict=True)
        )
        lines.append(f"equilibria followed from {', '.join(begin)}")
    import numpy as np

    rows: list[list[str]] = []
    styles: list[Style | None] = []
    unanswered = np.zeros(result.unstable.size, dtype=bool)
    unanswered[list(result.problems)] = True
    words, counts = result.words.ravel(), result.unstable.ravel()
    for k, word in enumerate(WORDS):
        here = (words == k) & ~unanswered
        for n in sorted({int(n) for n in counts[here]}):
            share = float(np.mean(here & (counts == n)))
            rows.append([f"{word} ({n})" if word == UNSTABLE else word, f"{share:.1%}"])
            styles.append(word_style(word))
    if unanswered.any():
        rows.append(["no answer", f"{float(unanswered.mean()):.1%}"])
    lines += ["", table(["region", "part of the points"], rows, (0,), styles)]
    lines.append(f"{counted(len(result.boundaries), 'boundary curve')}")
    for text in _edges(result, labels):
        lines += wrap_lines(text)
    if set(words[~unanswered].tolist()) == {WORDS.index(UNDECIDED)}:
        (one, other), (x, y) = result.parameters, (result.x, result.y)
        lines += _open_hint({one: (x, labels[0][1]), other: (y, labels[1][1])})
    return document(lines)


def _edges(result: Chart, labels: Sequence[tuple[str, float]]) -> list[str]:
    """Say where a boundary runs along an edge: stability jumps there, as with damping that begins at zero.

    On the lines of the grid across the edge the number of unstable eigenvalues then changes at its very end, on
    neighbouring ones. A region that only reaches the edge ends between such lines.
    """
    found = []
    lines = {*result.detail.x.tolist()}, {*result.detail.y.tolist()}
    for d, along in enumerate((result.x, result.y)):
        name, other, factor = result.parameters[d], result.parameters[1 - d], labels[1 - d][1]
        for end in along[[0, -1]].tolist():
            for curve in result.boundaries:
                near = abs(curve[:, d] - end) <= ON_EDGE * (along[-1] - along[0])
                for at_end, group in groupby(range(len(near)), key=near.tolist().__getitem__):
                    run = list(group)
                    if not at_end or sum(y in lines[1 - d] for y in curve[run, 1 - d].tolist()) < 2:
                        continue
                    low, high = (number(float(f(curve[run, 1 - d])) / factor, 3) for f in (min, max))
                    place = f"{name} = {number(end / labels[d][1])} from about {other} = {low} to {high}"
                    found.append(f"jump: a boundary runs along {place}: stability exactly there is not that beside it")
    return found
