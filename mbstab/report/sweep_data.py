"""Sweeps and stability charts as data: JSON, CSV and NumPy."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Any

from mbstab.model.schema import Model
from mbstab.model.words import UNDECIDED
from mbstab.report.export import Rows, in_unit, polar, unit_factors
from mbstab.report.sensitivity import critical_data, critical_rows
from mbstab.report.tables import decimals

if TYPE_CHECKING:
    from mbstab.analysis.sweep.chart import Chart
    from mbstab.analysis.sweep.critical import Enclosed
    from mbstab.analysis.sweep.sweep import Sweep


def sweep_data(result: Sweep, model: Model, sensitivity: bool = False) -> dict[str, Any]:
    """Return the JSON object of ``mbstab sweep``.

    Keys: ``model``, ``title``, ``parameter``, ``unit``, ``values`` (in that unit), ``branches``
    (lists with an eigenvalue for each value: ``real`` and ``imag`` in 1/s, null where there is
    none), ``unstable`` (their number for each value, null where the verdict is open), ``verdicts``
    (one for each value), ``spectrum`` (for each value numbers of eigenvalues that are not neutral: ``right`` and
    ``left`` of the imaginary axis, held on the ``axis`` by a structure, ``open``: of unknown side; null where there
    is no answer), ``neutral``, ``critical`` (``value``, ``error``: rounding hides
    where it is within this distance, 0: it is known to its last digits; ``kind``, ``branch``: numbers counting from 1,
    ``frequency`` in rad/s, ``krein_signatures`` of a collision, ``branching``, ``unstable_below``,
    ``unstable_above``, ``verdict_below``, ``verdict_above``, null where there is none, and ``enclosure``, see below),
    ``meetings`` (if asked for: ``value``, ``kind``, ``pairs``: how many of branches do so), ``problems`` (``point``
    counting from 0, ``reason``),
    ``warnings``, ``names`` (of the branches, null for those without), ``start`` (from where equilibria were followed,
    null if they are given), ``orders``, ``crossings`` (of frequencies with these: ``value``, ``order``,
    ``frequency`` in rad/s, ``branch`` from 1, ``name``, ``whirl``, ``motions``), ``whirls`` (of the branches:
    ``forward``, ``backward``, ``mixed``, ``changing``, null where nothing whirls; null as a whole without orders) and
    ``senses`` (of each branch its ranges of one sense: ``from``, ``to``, ``whirl``; null without orders),
    ``reference`` (where the file asks to find it, lists of its coordinates in m and rad by name, and of its rates as
    ``rate(…)``; else empty), ``outputs`` (the outputs of the file there, lists by name) and ``beyond``: for each path
    beyond a fold or branch point, an object with the same keys from ``values`` on.

    An ``enclosure`` is null unless proofs are asked for: ``midpoint`` and ``radius`` as decimal texts, in the unit of
    the parameter (null where nothing is proven), ``conditions`` (what is not proven and must hold), ``reason`` (why
    nothing is proven).
    """
    ((unit, factor),) = unit_factors(model, result.parameter)
    paths = _path_data(result, factor) | {"beyond": [_path_data(path, factor) for path in result.beyond]}
    return {"parameter": result.parameter, "unit": unit} | paths | (critical_data(result, model) if sensitivity else {})


def _path_data(result: Sweep, factor: float) -> dict[str, Any]:
    return {
        "values": in_unit(result.values, factor).tolist(),
        "branches": [{"real": column.real, "imag": column.imag} for column in result.branches.T],
        "unstable": [int(n) if n >= 0 else None for n in result.unstable],
        "verdicts": result.verdicts,
        "spectrum": result.spectra,
        "neutral": result.neutral,
        "critical": [
            {
                "value": c.value / factor,
                "error": c.error / factor,
                "kind": c.kind,
                "branch": [b + 1 for b in c.branches],
                "frequency": c.frequency,
                "krein_signatures": c.signatures,
                "branching": c.branching,
                "unstable_below": c.unstable[0] if c.unstable[0] >= 0 else None,
                "unstable_above": c.unstable[1] if c.unstable[1] >= 0 else None,
                "verdict_below": c.verdicts[0] or None,
                "verdict_above": c.verdicts[1] or None,
                "enclosure": None if c.enclosed is None else _enclosure(c.enclosed),
            }
            for c in result.critical
        ],
        "meetings": [
            {"value": value / factor, "kind": kind, "pairs": pairs}
            for (value, kind), pairs in Counter(result.meetings).items()
        ],
        "problems": [{"point": i, "reason": reason} for i, reason in result.problems.items()],
        "warnings": list(result.warnings),
        "names": [name or None for name in result.names] or [None] * result.branches.shape[1],
        "start": None if result.start is None else result.start / factor,
        "orders": list(result.orders),
        "crossings": [
            {
                "value": c.value / factor,
                "order": c.order,
                "frequency": c.frequency,
                "branch": c.branch + 1,
                "name": c.name or None,
                "whirl": c.whirl or None,
                "motions": [{"name": name, **polar(x)} for name, x in c.motions],
            }
            for c in result.crossings
        ],
        "whirls": [word or None for word in result.whirls] if result.orders else None,
        "senses": [
            [{"from": low / factor, "to": high / factor, "whirl": word or None} for low, high, word in parts]
            for parts in result.senses
        ]
        if result.orders
        else None,
        "reference": result.reference,
        "outputs": result.outputs,
    }


def _enclosure(enclosed: Enclosed) -> dict[str, Any]:
    known = enclosed.value is not None
    ball = decimals(enclosed.value, enclosed.digits + 1) if known else {"midpoint": None, "radius": None}
    return {**ball, "conditions": enclosed.conditions, "reason": enclosed.reason}


def sweep_rows(result: Sweep, model: Model, sensitivity: bool = False) -> Rows:
    """Return one line per value: the value, the number of unstable eigenvalues, the verdict, the branches, the path.

    The heads of branches with names contain these. Coordinates and rates of a reference that is found follow the
    branches, and then the outputs of the file there. Paths count from 1; those beyond folds and branch points come
    after the first. The last column says why there is no answer, ``undecided`` where the verdict is open, and ``ok``
    otherwise. Where proofs are requested, a line for each critical value follows those of its path; its last column
    begins with ``critical`` and says what is proven.
    """
    if sensitivity:
        return critical_rows(result, model)
    ((unit, factor),) = unit_factors(model, result.parameter)
    paths = (result, *result.beyond)
    count = max(path.branches.shape[1] for path in paths)
    names = [f" ({name})" if name else "" for name in result.names] + [""] * count
    parts = [f"{part} {b + 1}{names[b]} (1/s)" for b in range(count) for part in ("real", "imag")]
    units = {name: unit for path in paths for name, unit in path.units.items()}
    followed = list(units)
    heads = [
        _headed(result.parameter, unit),
        "unstable",
        "verdict",
        *parts,
        *(f"{x} ({units[x]})" if units[x] else x for x in followed),
        "path",
        "status",
    ]
    rows: list[list[Any]] = []
    for number, path in enumerate(paths, 1):
        missing = [float("nan")] * (2 * (count - path.branches.shape[1]))
        columns = zip(in_unit(path.values, factor), path.unstable, path.verdicts, path.branches, strict=True)
        # A path on which a rate is zero everywhere does not list it.
        solved = [path.found.get(name, 0.0 * path.values).tolist() for name in followed]
        for i, (x, n, verdict, row) in enumerate(columns):
            numbers = [float(part) for s in row for part in (s.real, s.imag)]
            at = [column[i] for column in solved]
            status = path.problems.get(i, UNDECIDED if verdict == UNDECIDED else "ok").splitlines()[0]
            rows.append([float(x), int(n) if n >= 0 else "", verdict, *numbers, *missing, *at, number, status])
        for c in path.critical:
            if c.enclosed is not None:
                given = _enclosure(c.enclosed)
                ball = "not proven" if given["midpoint"] is None else f"{given['midpoint']} ± {given['radius']}"
                status = "; ".join(
                    [f"critical: {c.kind}", ball, *given["conditions"], *filter(None, [given["reason"]])]
                )
                rows.append([c.value / factor, "", "", *[float("nan")] * (2 * count + len(followed)), number, status])
    return heads, rows


def _headed(name: str, unit: str) -> str:
    """Return the head of a column of a parameter."""
    return f"{name} ({unit})" if unit not in ("", "1") else name


def sweep_arrays(result: Sweep, model: Model) -> dict[str, Any]:
    """Return the arrays of a sweep for npz files; all paths one after the other, numbered in ``path`` from 1."""
    import numpy as np

    ((_, factor),) = unit_factors(model, result.parameter)
    paths = (result, *result.beyond)
    count = max(path.branches.shape[1] for path in paths)
    solved = {name: [x.reference.get(name, 0.0 * x.values) for x in paths] for path in paths for name in path.reference}
    wide = [np.pad(x.branches, ((0, 0), (0, count - x.branches.shape[1])), constant_values=np.nan) for x in paths]
    return {
        "parameter": np.array(result.parameter),
        "values": in_unit(np.concatenate([path.values for path in paths]), factor),
        "branches": np.concatenate(wide),
        "unstable": np.concatenate([path.unstable for path in paths]),
        "verdicts": np.array([word for path in paths for word in path.verdicts]),
        "names": np.array(result.names or [""] * count),
        "path": np.repeat(np.arange(len(paths)) + 1, [len(path.values) for path in paths]),
        "reference_names": np.array([*solved], dtype=str),
        "reference": np.array([np.concatenate(columns) for columns in solved.values()]).T,
        "output_names": np.array([*result.outputs], dtype=str),
        "outputs": np.array([np.concatenate([x.outputs[name] for x in paths]) for name in result.outputs]).T,
        "critical": np.array([c.value / factor for path in paths for c in path.critical]),
        "critical_kind": np.array([c.kind for path in paths for c in path.critical]),
    }


def chart_data(result: Chart, model: Model) -> dict[str, Any]:
    """Return the JSON object of a stability chart.

    Keys: ``model``, ``title``, ``parameters``, ``units``, ``values`` (two lists, in these units),
    ``unstable`` (for each value of the second parameter a list over the first; null where the verdict
    is open), ``verdicts`` (in the same way), ``boundaries`` and ``divisions`` (lists of points), ``problems``,
    ``warnings``, ``start`` (the two values from which equilibria were followed, null if they are given).
    """
    labels = unit_factors(model, *result.parameters)
    begin = None if result.start is None else [x / factor for x, (_, factor) in zip(result.start, labels, strict=True)]
    return {
        "parameters": result.parameters,
        "units": [unit for unit, _ in labels],
        "values": [in_unit(x, factor).tolist() for x, (_, factor) in zip((result.x, result.y), labels, strict=True)],
        "unstable": [[int(n) if n >= 0 else None for n in row] for row in result.unstable],
        "verdicts": result.verdicts,
        "boundaries": [curve / [factor for _, factor in labels] for curve in result.boundaries],
        "divisions": [curve / [factor for _, factor in labels] for curve in result.divisions],
        "problems": [{"point": i, "reason": reason} for i, reason in result.problems.items()],
        "warnings": result.warnings,
        "start": begin,
    }


def chart_rows(result: Chart, model: Model) -> Rows:
    """Return one line for each point of a chart."""
    verdicts, labels = result.verdicts, unit_factors(model, *result.parameters)
    x, y = (in_unit(along, factor) for along, (_, factor) in zip((result.x, result.y), labels, strict=True))
    rows = [
        [float(a), float(b), int(result.unstable[i, j]) if result.unstable[i, j] >= 0 else "", verdicts[i][j]]
        for i, b in enumerate(y)
        for j, a in enumerate(x)
    ]
    heads = [_headed(name, unit) for name, (unit, _) in zip(result.parameters, labels, strict=True)]
    return [*heads, "unstable", "verdict"], rows


def chart_arrays(result: Chart, model: Model) -> dict[str, Any]:
    """Return the arrays of a chart for npz files; boundary curves are separated by rows of nan."""
    import numpy as np

    factors = [factor for _, factor in unit_factors(model, *result.parameters)]
    curves = [part for curve in result.boundaries for part in (curve / factors, np.full((1, 2), np.nan))]
    return {
        "parameters": np.array(result.parameters),
        "x": in_unit(result.x, factors[0]),
        "y": in_unit(result.y, factors[1]),
        "unstable": result.unstable,
        "verdicts": np.array(result.verdicts),
        "boundaries": np.concatenate(curves) if curves else np.zeros((0, 2)),
    }
