"""Linearized equations as text: sizes and matrices."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from mbstab.errors import counted
from mbstab.model.schema import Model, is_state
from mbstab.report import table_width
from mbstab.report.styles import document, joined
from mbstab.report.tables import table, wrap_lines

if TYPE_CHECKING:
    from mbstab.analysis.linear.linearize import Linearization
    from mbstab.analysis.response.state_space import ControlModel

LARGE = 12
"""Matrices with more rows or columns are shown only on request."""


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
    start, room = 0, table_width() - max(map(len, rows))
    while start < len(columns):
        stop, used = start + 1, widths[start]
        while stop < len(columns) and used + widths[stop] <= room:
            used += widths[stop]
            stop += 1
        body = [[row, *values[start:stop]] for row, values in zip(rows, cells, strict=True)]
        text = joined([text, table(["", *columns[start:stop]], body, left=(0,))], "")
        start = stop
    return text


def linearize_text(answer: Linearization | ControlModel, model: Model, form: str = "", full: bool = False) -> str:
    """Return the answer of ``mbstab linearize`` as text; large matrices only if `full` is set.

    Pencil and state space need a control model. Without a form it is the equations, or the state space of a control
    model.
    """
    from mbstab.analysis.linear.linearize import Linearization
    from mbstab.report.linear_data import equation_forms, forms

    if isinstance(answer, Linearization):
        lines, known, form = _linear_summary(answer), equation_forms(answer), form or "equations"
    else:
        lines, known, form = _linear_summary(answer.linear), forms(answer), form or "state-space"
        lines += _signals(answer) if form == "state-space" else []
    matrices = known[form]
    hidden = {} if full else {name: m for name, m in matrices.items() if max(len(m[1]), len(m[2])) > LARGE}
    lines += [matrix_text(name, *m) for name, m in matrices.items() if name not in hidden]
    if hidden:
        rows = [
            [name, f"{len(m[1])} × {len(m[2])}", str(int((m[0] != 0.0).sum())), f"{abs(m[0]).max(initial=0.0):.6g}"]
            for name, m in hidden.items()
        ]
        lines.append(table(["matrix", "size", "not zero", "largest"], rows, left=(0,)))
        lines += wrap_lines(f"matrices with more than {LARGE} rows or columns: --full shows them")
    return document(lines)


def _linear_summary(linear: Linearization) -> list[str]:
    """Return the sizes of the linearized equations, and the frame in which they are constant."""
    states = sum(map(is_state, linear.names))
    n_n = len(linear.J) - linear.n_h - states
    parts = [
        counted(len(linear.M) - states, "coordinate"),
        *([counted(states, "first-order state") + " with a row each"] if states else []),
        counted(linear.n_h, "holonomic row"), counted(n_n, "nonholonomic row"),
        f"{counted(linear.n_f, 'state')} after deflation",
    ]  # fmt: skip
    text = ", ".join(parts)
    lines = wrap_lines(text)
    if linear.generator is not None and linear.generator.turns:
        lines += wrap_lines(f"in the frame of the steady motion: {linear.generator}", "", "  ")
    return [*lines, ""]


def _signals(control: ControlModel) -> list[str]:
    """Return states, inputs and outputs with their units."""
    lines = []
    for what, names, units in (
        ("states x", control.states, control.state_units),
        ("inputs w", control.inputs, control.input_units),
        ("outputs z", control.outputs, control.output_units),
    ):
        shown = [
            name + (f" ({unit})" if unit not in ("", "1") else "") for name, unit in zip(names, units, strict=True)
        ]
        text = f"{what}: {', '.join(shown) or 'none'}"
        lines += wrap_lines(text, "", "  ", hyphens=False)
    return [*lines, ""]
