"""The check of a model as text: coordinates, constraints, degrees of freedom."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from mbstab.errors import counted
from mbstab.model.schema import Model
from mbstab.report.styles import document
from mbstab.report.tables import number, table, wrap_lines

if TYPE_CHECKING:
    from mbstab.analysis.compare.check import CheckReport


def check_text(report: CheckReport, model: Model) -> str:
    """Return the answer of ``mbstab check`` as text."""
    lines: list[str] = []
    kind = "planar" if report.dimension == 2 else "spatial"
    states = report.states  # each has a row of its own
    coordinates = sum(len(own) for _, own, _ in report.bodies)
    counts = [counted(len(report.bodies), "body", "bodies"), counted(coordinates, "coordinate")]
    counts += [counted(report.states, "first-order state")] if report.states else []
    counts += [] if any(report.gravity) else ["no gravity"]
    lines += [
        f"{kind} scene, {', '.join(counts)}",
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
        f"nonholonomic rows   {report.n_nonholonomic - states}, rank {report.rank_nonholonomic - states}"
        f"{_gap(report.gaps[1])}",
        f"degrees of freedom  {report.degrees_of_freedom}",
        f"finite eigenvalues  {report.n_f}",
        f"reference           {'at rest' if report.at_rest else 'in motion'}",
        f"largest residuals   {report.position_residual:.1e} in position, {report.velocity_residual:.1e} in velocity "
        "(SI units)",
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
                lines += wrap_lines(item, "  ", "    ")
    return document(lines)


def _gap(gap: float) -> str:
    return "" if math.isinf(gap) else f" (gap {gap:.0e})"


def check_data(report: CheckReport, model: Model) -> dict[str, Any]:
    """Return the JSON object of ``mbstab check``: the fields of `CheckReport`, bodies and constraints as objects."""
    data = {**asdict(report), "degrees_of_freedom": report.degrees_of_freedom}
    data["bodies"] = [{"name": n, "coordinates": c, "mass": m} for n, c, m in report.bodies]
    data["constraints"] = [
        {"name": n, "type": k, "holonomic": h, "nonholonomic": nh} for n, k, h, nh in report.constraints
    ]
    return data
