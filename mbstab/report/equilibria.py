"""Equilibria and steady motions as text: state, reactions, efforts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from mbstab.errors import counted
from mbstab.model.measures import unit_of_output
from mbstab.model.schema import Model
from mbstab.report.export import Rows, attributes
from mbstab.report.styles import document
from mbstab.report.tables import number, table, wrap_lines

if TYPE_CHECKING:
    from mbstab.analysis.reference.equilibrium import Equilibrium


def equilibrium_text(found: Sequence[Equilibrium], model: Model) -> str:
    """Return the answer of ``mbstab equilibrium`` as text."""
    lines = []
    if len(found) > 1:
        lines += [f"{len(found)} distinct solutions", ""]
    for place, item in enumerate(found, 1):
        kind = "Equilibrium" if str(item.steady) == "rest" else f"Steady motion ({item.steady})"
        lines += wrap_lines(kind + (f" {place} of {len(found)}" if len(found) > 1 else ""))
        lines += [
            text
            for text in (
                _state_table(item, model),
                _reaction_table(item),
                _effort_table(item),
                _output_table(item, model),
            )
            if text
        ]
        lines += wrap_lines(
            f"found by {item.strategy} in {counted(item.iterations, 'step')}; largest imbalance {item.residual:.1e} of "
            f"what balances ({item.unbalanced[0]:.1e} N, {item.unbalanced[1]:.1e} N*m)"
        )
        apart = f", apart from {', '.join(item.symmetries)}" if item.symmetries else ""
        text = f"isolated{apart}" if item.isolated else f"not isolated to first order: {'; '.join(item.open)}{apart}"
        lines += [*wrap_lines(text, "", "  "), ""]
        if item.timed:
            lines.insert(-1, f"at t = {item.motion.time:g} s: forces or drives depend on time")
        if item.motion.redundant:
            lines.insert(-1, "constraints are redundant: only sums of reactions are determined")
    return document(lines)


def _state_table(item: Equilibrium, model: Model) -> str:
    moving, fastest = bool(item.motion.u.any()), float(abs(item.motion.u).max())
    rows = []
    for name, q, u in zip(model.coordinates(), item.motion.q, item.motion.u, strict=True):
        unit = "" if (own := model.unit_of(name)) == "1" else own
        rate = u if abs(u) > 1e-14 * fastest else 0.0
        rows.append([name, number(q, 10), unit, *([number(rate, 6), model.unit_of(name, 1)] if moving else [])])
    heads = ["coordinate", "value", "", *(["rate", ""] if moving else [])]
    return table(heads, rows, left=(0, 2, 4))


def _reaction_table(item: Equilibrium) -> str:
    if not item.reactions:
        return ""
    largest, rows = _largest_load(item), []
    for r in item.reactions:
        # A component that is rounding error compared with the largest load is shown as zero.
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


def _output_table(item: Equilibrium, model: Model) -> str:
    rows = [[name, number(x, 10), unit_of_output(model, model.outputs[name])] for name, x in item.outputs.items()]
    return table(["output", "value", ""], rows, left=(0, 2)) if rows else ""


def equilibrium_data(found: Sequence[Equilibrium], model: Model) -> dict[str, Any]:
    """Return the JSON object of ``mbstab equilibrium``.

    Keys: ``model``, ``title``, ``equilibria`` (``coordinates`` in m and rad and ``rates`` by
    name, ``steady`` in words, ``reactions``, ``efforts``, ``outputs`` by name, ``residual``, ``unbalanced_force`` in N,
    ``unbalanced_torque`` in N·m, ``iterations``, ``strategy``, ``isolated``, ``open``, ``time`` in s,
    ``depends_on_time``,
    ``symmetries``, ``redundant``, ``warnings``). A reaction has ``of``, ``on`` (a body),
    ``point`` (m; null: the point of contact), ``force`` (N) and ``torque`` (N·m), in ground axes. An effort, of a
    spring, damper, actuator or drive, has ``of``, ``along`` (the motion), ``value`` (positive in the direction of
    that motion) and ``unit``.
    """
    names = model.coordinates()
    return {
        "equilibria": [
            {
                "coordinates": dict(zip(names, item.motion.q.tolist(), strict=True)),
                "rates": dict(zip(names, item.motion.u.tolist(), strict=True)),
                "steady": str(item.steady),
                "reactions": [
                    {"of": r.owner, "on": r.body, "point": r.point, "force": r.force, "torque": r.torque}
                    for r in item.reactions
                ],
                "efforts": [
                    {"of": e.owner, "along": e.along, "value": float(e.values), "unit": e.unit} for e in item.efforts
                ],
                "outputs": item.outputs,
                "residual": item.residual,
                "unbalanced_force": item.unbalanced[0],
                "unbalanced_torque": item.unbalanced[1],
                **attributes(item, "iterations strategy isolated open"),
                "time": item.motion.time,
                "depends_on_time": item.timed,
                "symmetries": item.symmetries,
                "redundant": [str(x) for x in item.motion.redundant],
                "warnings": item.motion.warnings,
            }
            for item in found
        ],
    }


def equilibrium_rows(found: Sequence[Equilibrium], model: Model) -> Rows:
    """Return coordinates, reactions, efforts and outputs of all solutions, one number per line."""
    rows: list[list[Any]] = []
    for k, item in enumerate(found, 1):
        for name, q, u in zip(model.coordinates(), item.motion.q, item.motion.u, strict=True):
            rows.append([k, "coordinate", name, float(q), model.unit_of(name)])
            rows.append([k, "rate", name, float(u), model.unit_of(name, 1)])
        for r in item.reactions:
            axes = "xyz" if len(r.torque) != 1 else "z"
            for what, letters, vector, unit in (("force", "xyz", r.force, "N"), ("torque", axes, r.torque, "N*m")):
                for letter, x in zip(letters, vector, strict=False):
                    rows.append([k, f"{what} {letter}", f"{r.owner} on {r.body}", float(x), unit])
        rows += [[k, "effort", e.owner, float(e.values), e.unit] for e in item.efforts]
        rows += [[k, "output", name, x, unit_of_output(model, model.outputs[name])] for name, x in item.outputs.items()]
    return ["solution", "quantity", "of", "value", "unit"], rows
