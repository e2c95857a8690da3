"""Derivatives of eigenvalues and of critical values by parameters: text, JSON and CSV."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from mbstab.errors import counted
from mbstab.model.schema import Model, after_number
from mbstab.report.eigenvalue_data import eigen_data
from mbstab.report.eigenvalues import eigen_text
from mbstab.report.export import Rows
from mbstab.report.modes import value_text
from mbstab.report.styles import Text, document, joined
from mbstab.report.tables import number, table, wrap_lines

if TYPE_CHECKING:
    from mbstab.analysis.spectrum.sensitivity import Derivatives, Sensitivities
    from mbstab.analysis.sweep.critical import Critical, CriticalSlopes
    from mbstab.analysis.sweep.sweep import Sweep


def sensitivity_text(found: Sensitivities, model: Model) -> Text:
    """Return the eigenvalues, and a table for each: what moves it most, first."""
    lines = ["Derivatives by the parameters, and the change for one percent more of each:", ""]
    for item in found.derivatives:
        e = found.eigenvalue(item)
        lines.append(f"{e.name}{': ' if e.name else ''}{value_text(e)} 1/s")
        if item.missing:
            lines += [*wrap_lines(f"no derivatives: {item.missing}", "  "), ""]
            continue
        rows = [row for _, row in _rows(found, item, model)]
        if rows:
            heads = ["parameter", "unit", "dλ/dp (1/s per unit)", "per percent (1/s)", "error"]
            lines.append(table(heads, rows, left=(0, 1)))
            if still := len(found.order(item)) - len(rows):
                lines[-1] = joined([lines[-1], f"{counted(still, 'other parameter')}: 0 within the error\n"], "")
        else:
            lines += ["  no parameter moves it", ""]
    for name, reason in found.missing.items():
        lines += wrap_lines(f"{name}: no derivatives: {reason}", "", "  ")
    return document([eigen_text(found.result, model), *lines])


def _rows(found: Sensitivities, item: Derivatives, model: Model) -> Iterator[tuple[int, list[str]]]:
    """Yield the parameters that move an eigenvalue, and the cells of the table."""
    real = not found.eigenvalue(item).value.imag
    for k in found.order(item):
        name = found.parameters[k]
        parameter = model.parameters[name]
        slope, change = item.slopes[k] * parameter.factor, item.slopes[k] * 0.01 * found.values[k]
        if abs(slope) <= item.errors[k] * parameter.factor:
            continue
        error = item.errors[k] * parameter.factor
        per_percent = _complex(change, real, 4, abs(0.01 * item.errors[k] * found.values[k]))
        cells = [_complex(slope, real, 8, error), per_percent if found.values[k] else "-"]
        yield k, [name, parameter.unit or "1", *cells, f"{error:.0e}"]


def _complex(x: complex, real: bool, digits: int, error: float) -> str:
    """Return a complex number; parts that are no more than their error are 0."""
    if real:
        return number(x.real, digits, error)
    imag = number(x.imag, digits, error)
    return f"{number(x.real, digits, error)} {'-' if imag.startswith('-') else '+'} {imag.removeprefix('-')}i"


def sensitivity_data(found: Sensitivities, model: Model) -> dict[str, Any]:
    """Return the JSON object of ``mbstab eig --sensitivity``: that of ``mbstab eig``, and an object ``sensitivity``.

    Keys of the latter: ``eigenvalues`` (``real`` and ``imag`` in 1/s, ``missing``: why there are no derivatives, and
    ``derivatives`` by the names of the parameters, what moves the eigenvalue most first), ``missing`` (why there
    are none by some parameters). A derivative has ``real``, ``imag`` and ``error`` in 1/s per declared unit of the
    parameter, ``unit``, and ``percent_real`` and ``percent_imag``, the change in 1/s for one percent more of the
    parameter, null if that is zero.
    """
    return eigen_data(found.result, model) | {
        "sensitivity": {
            "eigenvalues": [
                {
                    "real": found.eigenvalue(item).value.real,
                    "imag": found.eigenvalue(item).value.imag,
                    "missing": item.missing,
                    "derivatives": {} if item.missing else dict(_entries(found, item, model)),
                }
                for item in found.derivatives
            ],
            "missing": found.missing,
        }
    }


def _entries(found: Sensitivities, item: Derivatives, model: Model) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the parameters by which an eigenvalue has derivatives, and these."""
    for k in found.order(item):
        parameter = model.parameters[found.parameters[k]]
        slope, value = complex(item.slopes[k]) * parameter.factor, float(found.values[k])
        percent = complex(item.slopes[k]) * 0.01 * value if value else complex(np.nan, np.nan)
        yield (
            parameter.name,
            {
                "real": slope.real,
                "imag": slope.imag,
                "error": float(item.errors[k]) * parameter.factor,
                "unit": parameter.unit,
                "percent_real": percent.real,
                "percent_imag": percent.imag,
            },
        )


def sensitivity_rows(found: Sensitivities, model: Model) -> Rows:
    """Return the heads and the lines of a CSV file: one line for each eigenvalue and parameter."""
    heads = ["real", "imag", "parameter", "unit", "derivative_real", "derivative_imag", "error", "percent_real"]
    rows = []
    for item in found.derivatives:
        s = found.eigenvalue(item).value
        for name, x in _entries(found, item, model) if not item.missing else ():
            cells = [x[key] for key in ("unit", "real", "imag", "error", "percent_real", "percent_imag")]
            rows.append([s.real, s.imag, name, *cells])
    return [*heads, "percent_imag"], rows


def critical_text(result: Sweep, model: Model) -> str:
    """Return a table for each critical value of a sweep: what moves it most, first."""
    own = model.parameters[result.parameter]
    lines = ["Derivatives of critical values, and their change by 1 % of each parameter:", ""]
    for c, slopes in _critical(result):
        lines.append(f"{own.name} = {number(c.value / own.factor, 10)}{after_number(own.unit)}, {c.kind}")
        if slopes.missing:
            lines += [*wrap_lines(f"no derivatives: {slopes.missing}", "  "), ""]
            continue
        entries = dict(_critical_entries(slopes, model, own.factor))
        rows = [
            [name, x["unit"] or "1", *(number(x[key], 8) for key in ("derivative", "percent")), f"{x['error']:.0e}"]
            for name, x in entries.items()
            if abs(x["derivative"]) > x["error"]
        ]
        heads = ["parameter", "unit", f"d{own.name}/dp", "per percent", "error"]
        lines += [table(heads, rows, left=(0, 1))] if rows else ["  no parameter moves it", ""]
        for name, reason in slopes.reasons.items():
            lines += wrap_lines(f"{name}: no derivative: {reason}", "", "  ")
    if len(lines) == 2:
        lines.append("there is no critical value")
    return document(lines)


def critical_data(result: Sweep, model: Model) -> dict[str, Any]:
    """Return the key ``sensitivity`` of the JSON object of ``mbstab sweep --sensitivity``.

    A list of objects, one for each critical value of all paths, in their order: ``value`` in the unit of the swept
    parameter, ``kind``, ``missing`` (why there are no derivatives), ``reasons`` (why there are none by some of the
    parameters), and ``derivatives`` by the names of the parameters, what moves the critical value most first. A
    derivative has ``derivative`` and ``error`` in the declared units of both parameters, ``unit`` of the other one,
    and ``percent``, the change of the critical value for one percent more of it, null if that is zero.
    """
    factor = model.parameters[result.parameter].factor
    return {
        "sensitivity": [
            {
                "value": c.value / factor,
                "kind": c.kind,
                "missing": slopes.missing,
                "reasons": slopes.reasons,
                "derivatives": dict(_critical_entries(slopes, model, factor)),
            }
            for c, slopes in _critical(result)
        ]
    }


def critical_rows(result: Sweep, model: Model) -> Rows:
    """Return the heads and the lines of a CSV file: one line for each critical value and parameter."""
    factor = model.parameters[result.parameter].factor
    keys = ["unit", "derivative", "error", "percent"]
    rows = [
        [c.value / factor, c.kind, name, *(x[key] for key in keys)]
        for c, slopes in _critical(result)
        for name, x in _critical_entries(slopes, model, factor)
    ]
    return [result.parameter, "kind", "parameter", *keys], rows


def _critical(result: Sweep) -> Iterator[tuple[Critical, CriticalSlopes]]:
    """Yield the critical values of all paths with their derivatives."""
    for path in (result, *result.beyond):
        yield from ((c, c.slopes) for c in path.critical if c.slopes is not None)


def _critical_entries(slopes: CriticalSlopes, model: Model, factor: float) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the parameters by which a critical value has derivatives, and these."""
    for k in slopes.order:
        parameter = model.parameters[slopes.names[k]]
        slope, value, unit = float(slopes.slopes[k]) / factor, float(slopes.values[k]), parameter.factor
        yield (
            parameter.name,
            {
                "derivative": slope * unit,
                "error": float(slopes.errors[k]) / factor * unit,
                "unit": parameter.unit,
                "percent": 0.01 * slope * value if value else np.nan,
            },
        )
