"""Linearized equations as data: JSON, CSV, NumPy, MATLAB and LaTeX."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from mbstab.model.schema import Model
from mbstab.report.export import Rows

if TYPE_CHECKING:
    from mbstab.analysis.linear.linearize import Linearization
    from mbstab.analysis.response.state_space import ControlModel

Named = tuple[Any, Sequence[str], Sequence[str]]


def equation_forms(linear: Linearization) -> dict[str, dict[str, Named]]:
    """Return the matrices of the linearized equations with the names of their rows and columns, by form."""
    q = list(linear.names)
    rows = _rows(linear)
    holonomic, nonholonomic = rows[: linear.n_h], rows[linear.n_h :]
    M, R, K = linear.composite()
    both = [*q, *(f"ν {row}" for row in rows)]
    return {
        "equations": {
            "M": (linear.M, q, q),
            "R": (linear.R, q, q),
            "K": (linear.K, q, q),
            "C_q": (linear.J[: linear.n_h], holonomic, q),
            "D_u": (linear.J[linear.n_h :], nonholonomic, q),
            "D_q": (linear.D_q, nonholonomic, q),
        },
        "composite": {
            "M_composite": (M, both, both),
            "R_composite": (R, both, both),
            "K_composite": (K, both, both),
        },
    }


def forms(control: ControlModel) -> dict[str, dict[str, Named]]:
    """Return every matrix with the names of its rows and columns, by form; no two have the same name."""
    linear, descriptor, known = control.linear, control.descriptor, control.coordinates
    equations = [*linear.names, *(f"d/dt {x}" for x in linear.names), *_rows(linear)]
    equations += descriptor.variables[len(equations) :]
    return {
        **equation_forms(linear),
        "pencil": {
            "A_descriptor": (descriptor.A, equations, descriptor.variables),
            "E_descriptor": (descriptor.E, equations, descriptor.variables),
            "B_descriptor": (descriptor.B, equations, control.inputs),
            "C_descriptor": (descriptor.C, control.outputs, descriptor.variables),
            "D_descriptor": (descriptor.D, control.outputs, control.signals),
        },
        "state-space": {
            "A": (control.A, control.states, control.states),
            "B": (control.B, control.states, control.signals),
            "C": (control.C, control.outputs, control.states),
            "D": (control.D, control.outputs, control.signals),
            "to_coordinates": (control.to_coordinates, known, control.states),
            "to_rates": (control.to_rates, [f"rate({x})" for x in known], control.states),
        },
    }


def _rows(linear: Linearization) -> list[str]:
    return [f"{row.name}: {row.label}" for row in linear.rows]


def linearize_data(control: ControlModel, model: Model) -> dict[str, Any]:
    """Return the JSON object of ``mbstab linearize``.

    Keys: ``model``, ``title``, ``coordinates``, ``rows``, ``reference`` (``q``, ``u``, ``a``,
    ``multipliers``, ``time``), ``frame`` (the motion of the axes in which the equations are
    constant, in words; empty: the coordinates of the file), ``frozen``, ``variation``, ``states``, ``inputs`` and
    ``outputs`` (``name``, ``unit``), ``signals`` (columns of B and D: ``name``, ``input``, ``derivative``),
    ``determined`` (the rows of ``to_coordinates``) and for each form its matrices, row by row.
    """
    linear, motion = control.linear, control.linear.motion
    signals = [
        {"name": name, "input": control.inputs[i], "derivative": k}
        for name, (i, k) in zip(control.signals, control.orders, strict=True)
    ]
    return {
        "coordinates": linear.names,
        "rows": [{"name": row.name, "label": row.label, "unit": row.unit} for row in linear.rows],
        "frame": str(linear.generator) if linear.generator is not None and linear.generator.turns else "",
        "frozen": linear.frozen,
        "reference": {"q": motion.q, "u": motion.u, "a": motion.a, "multipliers": motion.nu, "time": motion.time},
        "variation": linear.variation,
        "states": _named(control.states, control.state_units),
        "inputs": _named(control.inputs, control.input_units),
        "outputs": _named(control.outputs, control.output_units),
        "signals": signals,
        "determined": control.coordinates,
        **{form: {key: m for key, (m, _, _) in group.items()} for form, group in forms(control).items()},
    }


def _named(names: Sequence[str], units: Sequence[str]) -> list[dict[str, str]]:
    return [{"name": name, "unit": unit} for name, unit in zip(names, units, strict=True)]


def linearize_rows(control: ControlModel, model: Model) -> Rows:
    """Return all nonzero entries of all matrices, one entry per line."""
    rows = [
        [form, name, i + 1, j + 1, row, column, float(matrix[i][j])]
        for form, group in forms(control).items()
        for name, (matrix, names, columns) in group.items()
        for i, row in enumerate(names)
        for j, column in enumerate(columns)
        if matrix[i][j] != 0.0
    ]
    return ["form", "matrix", "row", "column", "row name", "column name", "value"], rows


def linearize_arrays(control: ControlModel, model: Model) -> dict[str, Any]:
    """Return all matrices and the names of what they belong to, for npz and mat files; A, B, C, D are of the states."""
    import numpy as np

    arrays = {name: np.asarray(m) for group in forms(control).values() for name, (m, _, _) in group.items()}
    linear, motion = control.linear, control.linear.motion
    arrays |= {"q": motion.q, "u": motion.u, "a": motion.a, "multipliers": motion.nu}
    arrays["rows"] = np.array(_rows(linear), dtype=str)
    names = {
        "coordinates": linear.names,
        "determined": control.coordinates,
        "states": control.states,
        "state_units": control.state_units,
        "signals": control.signals,
        "inputs": control.inputs,
        "input_units": control.input_units,
        "outputs": control.outputs,
        "output_units": control.output_units,
    }
    return arrays | {key: np.array(values, dtype=str) for key, values in names.items()}


def linearize_latex(control: ControlModel, model: Model) -> str:
    """Return A, B, C and D as LaTeX equations with numbers, and the vectors of states, signals and outputs."""
    found = forms(control)["state-space"]
    lines = []
    for letter, names in (("x", control.states), ("w", control.signals), ("z", control.outputs)):
        body = r" \\ ".join(rf"\text{{{_escaped(name)}}}" for name in names)
        lines += _equation(letter, body and rf"\begin{{bmatrix}} {body} \end{{bmatrix}}")
    for letter in "ABCD":
        matrix = found[letter][0]
        rows = [" & ".join(_number(x) for x in row) for row in matrix]
        body = " \\\\\n".join(rows) if matrix.size else ""
        lines += _equation(letter, body and "\\begin{bmatrix}\n" + body + "\n\\end{bmatrix}")
    return "\n".join(lines) + "\n"


def _equation(letter: str, body: str) -> list[str]:
    return [r"\begin{equation}", rf"\mathbf{{{letter}}} = {body}", r"\end{equation}"] if body else []


def _escaped(text: str) -> str:
    return re.sub(r"([_#%&$])", r"\\\1", text)


def _number(x: float) -> str:
    mantissa, _, exponent = f"{x:.6g}".partition("e")
    return rf"{mantissa} \cdot 10^{{{int(exponent)}}}" if exponent else mantissa
