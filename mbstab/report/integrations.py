"""Cost and error of integrators, as text and as data."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from mbstab.model.schema import Model
from mbstab.report.export import Rows, attributes
from mbstab.report.styles import document
from mbstab.report.tables import fill_lines, number, table

if TYPE_CHECKING:
    from mbstab.analysis.compare.integrators import Integration, Integrations


def integrations_text(result: Integrations, model: Model) -> str:
    """Return the answer of ``mbstab compare --simulate`` as text."""
    lines: list[str] = []
    heads = ["integrator", "tolerance\nper step", "global\nerror", "time\n(ms)", "steps", "evalua-\ntions"]
    heads += ["energy", "constraints"]
    lines.append(table(heads, [_row(x) for x in result.runs], left=(0,)))
    failures = {
        (x.name, x.failure): x for x in reversed(result.runs) if x.failure and not x.failure.startswith("not tried")
    }
    for (name, failure), x in reversed(failures.items()):
        lines += fill_lines(f"{name} with {x.tol:g}: {failure}")
    if any("given up after" in failure for _, failure in failures):
        lines += fill_lines("--force gives them more time")
    disturbed = ", ".join(f"{name} = {value}" for name, value in result.disturbance.items())
    lines += fill_lines(
        f"motion from {number(result.start, 9)} to {number(result.end, 9)} s"
        + (f", disturbed by {disturbed}" if disturbed else "")
    )
    lines += fill_lines(
        f"error: the largest of positions, orientations and speeds at any output time, as in mbstab simulate; against "
        f"{result.reference}, whose error is estimated at {result.known:.0e}"
    )
    lines += fill_lines(
        "energy: largest imbalance, relative to the exchanged energy; constraints: largest residual after a step; "
        "time: of one run with this tolerance, without control of the global error"
    )
    if result.chosen is not None:
        x = result.chosen
        lines += ["", *fill_lines(
            f"Chosen for {result.tolerance:g}: {x.name} with {x.tol:g}, {1e3 * x.seconds:.3g} ms, error {x.error:.1e}"
        )]  # fmt: skip
    return document(lines)


def _row(x: Integration) -> list[str]:
    if x.failure:
        return [x.name, f"{x.tol:g}", "-", *["-"] * 5]
    return [
        x.name, f"{x.tol:g}", f"{x.error:.1e}", number(1e3 * x.seconds, 3), str(x.steps), str(x.evaluations),
        f"{x.energy:.0e}", f"{x.constraints:.0e}",
    ]  # fmt: skip


def integrations_data(result: Integrations, model: Model) -> dict[str, Any]:
    """Return the JSON object of ``mbstab compare --simulate``.

    Keys: ``model``, ``title``, ``start`` and ``end`` (s), ``disturbance``, ``reference`` (an integrator), ``known``
    (the estimate of its global error), ``tolerance``, ``chosen`` (``method``, ``solver``, ``tol``) and ``runs``. Of
    each run: ``method``, ``solver``, ``tol`` (per step), ``error``, ``seconds``, ``evaluations``, ``steps``,
    ``rejected``, ``energy`` and ``constraints`` (relative drift), ``failure``; null if the run did not reach the end.
    """
    chosen = result.chosen
    return {
        **attributes(result, "start end disturbance reference known tolerance"),
        "chosen": None if chosen is None else attributes(chosen, "method solver tol"),
        "runs": [{head: value for head, value in zip(HEADS, _values(x), strict=True)} for x in result.runs],
    }


HEADS = (
    "method", "solver", "tol", "error", "seconds", "evaluations", "steps", "rejected", "energy", "constraints",
    "failure",
)  # fmt: skip


def _values(x: Integration) -> list[Any]:
    found = [getattr(x, head) for head in HEADS]
    return [None if isinstance(value, float) and math.isnan(value) else value for value in found]


def integrations_rows(result: Integrations, model: Model) -> Rows:
    """Return one line for each integrator and tolerance."""
    return list(HEADS), [["" if value is None else value for value in _values(x)] for x in result.runs]
