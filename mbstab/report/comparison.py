"""The comparison of eigenvalue methods as text: errors, times, failures, and the choice."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from mbstab.errors import counted
from mbstab.model.schema import Model
from mbstab.report import table_width
from mbstab.report.export import Rows
from mbstab.report.styles import document
from mbstab.report.tables import eigenvalue, fill_lines, number, table
from mbstab.report.verdicts import with_verdict

if TYPE_CHECKING:
    from mbstab.analysis.compare.methods import Comparison, Outcome


def compare_text(result: Comparison, model: Model) -> str:
    """Return the answer of ``mbstab compare`` as text."""
    truth, outcomes = result.truth, result.outcomes
    lines: list[str] = []
    heads = ["", "method", "largest\nerror", "method\nalone", "claimed\nbound", "time\n(ms)", "memory\n(kB)", "lost"]
    lines.append(
        table([*heads, "invented"], [_outcome_row(n, x, truth.digits) for n, x in enumerate(outcomes, 1)], left=(1,))
    )
    lines += fill_lines(
        f"errors: relative to the modulus of each eigenvalue, against {truth.digits} digits, which took "
        f"{truth.seconds:.2g} s"
    )
    if len(result.rounding) and not _unknown(result):
        lines += fill_lines(
            f"rounding of parameters and matrices to double moves eigenvalues by up to "
            f"{_size(max(result.rounding), truth.digits)}; "
            "method alone: error against the exact eigenvalues of these matrices"
        )
    elif len(result.rounding):
        lines += fill_lines("method alone: not known, as rounding makes redundant constraints contradict each other")
    lines += fill_lines(
        "time: from the reference motion to eigenvalues and vectors (the motion and checks before that: "
        f"{1e3 * result.seconds:.3g} ms); with more digits, of everything"
    )
    if truth.eigenvalues:
        lines += ["", *_error_tables(result)]
    lines += _failures(outcomes) + _remarks(outcomes)
    if truth.neutral:
        lines.append(f"{counted(truth.neutral, 'neutral eigenvalue')} besides")
    lines.append(with_verdict(f"Verdict with {truth.digits} digits: ", truth.verdict))
    different = [f"{n} {x.method} ({x.verdict})" for n, x in enumerate(outcomes, 1) if _differs(x, result)]
    if different:
        lines += fill_lines(f"another verdict by {', '.join(different)}")
    if result.chosen is not None:
        lines += ["", *fill_lines(_choice(result))]
    return document(lines)


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


ROUNDING = "rounding of data"


def _error_tables(result: Comparison) -> list[str]:
    """Return the error of each method in each eigenvalue, with as many eigenvalues side by side as fit."""
    shown = [i for i, e in enumerate(result.truth.eigenvalues) if e.value.imag >= 0]
    names, digits = [x.method for x in result.outcomes], result.truth.digits
    blocks: list[list[int]] = []
    room = 0
    for i in shown:
        wide = max(map(len, _head(result, i).splitlines())) + 2
        if wide > room:
            blocks.append([])
            room = table_width() - 4 - max(map(len, [ROUNDING, *names]))
        blocks[-1].append(i)
        room -= wide
    texts: list[str] = []
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
    """Return why methods have no answer; a common reason is printed once."""
    texts: dict[str, list[str]] = {}
    for n, x in enumerate(outcomes, 1):
        if x.failure:
            text = x.failure.splitlines()[0].removeprefix(f"--method {x.method} ")
            texts.setdefault(text, []).append(str(n))
    return [
        line for text, numbers in texts.items() for line in fill_lines(f"no answer by {', '.join(numbers)}: {text}")
    ]


def _remarks(outcomes: Sequence[Outcome]) -> list[str]:
    """Return what else methods returned; the same results share a line."""
    texts: dict[str, list[str]] = {}
    for n, x in enumerate(outcomes, 1):
        parts = [x.besides] if x.besides else []
        parts += [f"drift off by {x.drift:.0e} 1/s"] if x.drift else []
        parts += [f"zeros off by {x.zeros:.0e} 1/s"] if x.zeros else []
        parts += ["an error above its bound"] if x.exceeded else []
        if parts:
            texts.setdefault(", ".join(parts), []).append(str(n))
    found = [line for text, numbers in texts.items() for line in fill_lines(f"{', '.join(numbers)}: {text}")]
    return [*(["besides:"] if found else []), *(f"  {line}" for line in found)]


def _unknown(result: Comparison) -> bool:
    """Return whether the effect of rounding of the data is unknown."""
    return any(math.isnan(x) for x in result.rounding)


def _differs(x: Outcome, result: Comparison) -> bool:
    return not x.failure and x.verdict != result.truth.verdict


def _size(x: float, digits: int = 0) -> str:
    """Return the size of an error; below the digits of the reference result only a bound is given."""
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


def compare_data(result: Comparison, model: Model) -> dict[str, Any]:
    """Return the JSON object of ``mbstab compare``.

    Keys: ``model``, ``title``, ``digits``, ``truth`` (``real`` and ``imag`` of each eigenvalue as
    decimal text, 1/s), ``neutral``, ``verdict``, ``rounding`` (change by the rounding of the data to
    double precision alone, of each eigenvalue), ``seconds`` (reference motion and linearized
    equations with their checks), ``methods`` (see below), ``tolerance`` and ``chosen`` (a method).

    Of each method: ``method``, ``values`` (``real``, ``imag``; 1/s), ``errors``, ``own_errors``
    (from the eigenvalues of the rounded data) and ``bounds``, one for each of ``truth`` and
    relative to its modulus; ``error``, ``own_error``, ``bound`` (the largest ones), ``exceeded``
    (an error is larger than its bound), ``lost``, ``invented``, ``zeros`` and ``drift`` (1/s: largest
    error of a neutral eigenvalue and of one of constraint drift), ``besides``,
    ``verdict``, ``seconds``, ``memory`` (bytes), ``failure`` (why there is no answer). Null stands
    for missing values: ``error`` is null if an eigenvalue is lost or invented.
    """
    return {
        "digits": result.truth.digits,
        "truth": [{"real": e.real, "imag": e.imag} for e in result.truth.eigenvalues],
        "neutral": result.truth.neutral,
        "verdict": result.truth.verdict,
        "rounding": result.rounding,
        "seconds": result.seconds,
        "methods": [_outcome(x) for x in result.outcomes],
        "tolerance": result.tolerance,
        "chosen": None if result.chosen is None else result.chosen.method,
    }


def _outcome(x: Outcome) -> dict[str, Any]:
    values = [{"real": s.real, "imag": s.imag} for s in x.values]
    largest = {"error": x.error, "own_error": x.own_error, "bound": x.bound, "exceeded": x.exceeded}
    if x.failure:
        counts: dict[str, Any] = dict.fromkeys(("lost", "invented", "zeros", "drift", "besides", "verdict"))
    else:
        counts = {key: getattr(x, key) for key in ("lost", "invented", "zeros", "drift", "besides", "verdict")}
    cost = {"seconds": x.seconds, "memory": x.memory or None, "failure": x.failure or None}
    errors = {"errors": x.errors, "own_errors": x.own_errors, "bounds": x.bounds}
    return {"method": x.method, "values": values} | errors | largest | counts | cost


def compare_rows(result: Comparison, model: Model) -> Rows:
    """Return one line for each method and true eigenvalue."""
    heads = [
        "method", "true real (1/s)", "true imag (1/s)", "real (1/s)", "imag (1/s)", "relative error",
        "own relative error", "claimed bound", "seconds", "bytes", "failure",
    ]  # fmt: skip
    rows: list[list[Any]] = []
    for x in result.outcomes:
        failure = x.failure.partition("\n")[0]
        columns = (result.truth.eigenvalues, x.values, x.errors, x.own_errors, x.bounds)
        for e, s, *numbers in zip(*columns, strict=True):
            found = [float(y) for y in (s.real, s.imag, *numbers)]
            rows.append([x.method, e.real, e.imag, *found, x.seconds, x.memory or "", failure])
    return heads, rows
