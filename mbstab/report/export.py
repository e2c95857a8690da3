"""Results as data: JSON, CSV, NumPy and MATLAB files."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from io import BytesIO, StringIO
from typing import TYPE_CHECKING, Any

from mbstab.model.measures import unit_of_output
from mbstab.model.schema import Model
from mbstab.model.words import UNDECIDED
from mbstab.report.tables import decimals

if TYPE_CHECKING:
    from mbstab.analysis.compare.check import CheckReport
    from mbstab.analysis.compare.methods import Comparison, Outcome
    from mbstab.analysis.reference.equilibrium import Equilibrium
    from mbstab.analysis.sweep.chart import Chart
    from mbstab.analysis.sweep.critical import Enclosed
    from mbstab.analysis.sweep.sweep import Sweep


def to_json(data: Any) -> str:
    """Return one JSON object; numbers with all digits, null for numbers that are not finite."""
    import json

    return json.dumps(_plain(data), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def _plain(x: Any) -> Any:
    if isinstance(x, dict):
        return {str(key): _plain(value) for key, value in x.items()}
    if isinstance(x, (list, tuple)):
        return [_plain(value) for value in x]
    if hasattr(x, "tolist"):
        return _plain(x.tolist())
    if isinstance(x, float) and not math.isfinite(x):
        return None
    return x


def polar(vector: Any) -> dict[str, Any]:
    """Return magnitude and phase (rad) of complex numbers."""
    import numpy as np

    return {"magnitude": np.abs(vector), "phase": np.angle(vector)}


def to_csv(heads: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    """Return comma-separated values with a head line; numbers with all digits."""
    import csv

    out = StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(heads)
    for row in rows:
        writer.writerow(["" if isinstance(x, float) and math.isnan(x) else x for x in row])
    return out.getvalue()


def in_unit(values: Any, factor: float) -> Any:
    """Return SI values in a unit: to 15 digits where these differ by rounding only, so that 500 rpm stays 500."""
    import numpy as np

    exact = np.asarray(values, dtype=float) / factor
    if factor == 1.0:
        return exact
    short = np.array([float(f"{x:.15g}") for x in exact.ravel()]).reshape(exact.shape)
    return np.where(np.abs(short * factor - values) <= 2.0 * np.spacing(np.abs(values)), short, exact)


def parameters_data(model: Model, values: Mapping[str, float]) -> dict[str, Any]:
    """Return parameters as part of a JSON object: ``value`` in its ``unit``, and ``si`` for each."""
    given = {name: model.parameters[name] for name in values}
    return {
        name: {"value": float(in_unit(values[name], p.factor)), "unit": p.unit, "si": values[name]}
        for name, p in given.items()
    }


def check_data(report: CheckReport, model: str, title: str) -> dict[str, Any]:
    """Return the JSON object of ``mbstab check``: the fields of `CheckReport`, bodies and constraints as objects."""
    data = {"model": model, "title": title, **asdict(report), "degrees_of_freedom": report.degrees_of_freedom}
    data["bodies"] = [{"name": n, "coordinates": c, "mass": m} for n, c, m in report.bodies]
    data["constraints"] = [
        {"name": n, "type": k, "holonomic": h, "nonholonomic": nh} for n, k, h, nh in report.constraints
    ]
    return data


# --- matrices -------------------------------------------------------------------------------------------------------

FORMS = ("equations", "composite", "pencil", "state-space")


def equilibrium_data(found: Sequence[Equilibrium], names: Sequence[str], model: str, title: str) -> dict[str, Any]:
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
    return {
        "model": model,
        "title": title,
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
                "iterations": item.iterations,
                "strategy": item.strategy,
                "isolated": item.isolated,
                "open": item.open,
                "time": item.motion.time,
                "depends_on_time": item.timed,
                "symmetries": item.symmetries,
                "redundant": [str(x) for x in item.motion.redundant],
                "warnings": item.motion.warnings,
            }
            for item in found
        ],
    }


def equilibrium_csv(found: Sequence[Equilibrium], model: Model) -> str:
    """Return coordinates, reactions, efforts and outputs of all solutions as CSV, one number per line."""
    rows: list[list[Any]] = []
    for number, item in enumerate(found, 1):
        for name, q, u in zip(model.coordinates(), item.motion.q, item.motion.u, strict=True):
            rows.append([number, "coordinate", name, float(q), model.unit_of(name)])
            rows.append([number, "rate", name, float(u), model.unit_of(name, 1)])
        for r in item.reactions:
            axes = "xyz" if len(r.torque) != 1 else "z"
            for what, letters, vector, unit in (("force", "xyz", r.force, "N"), ("torque", axes, r.torque, "N*m")):
                for letter, x in zip(letters, vector, strict=False):
                    rows.append([number, f"{what} {letter}", f"{r.owner} on {r.body}", float(x), unit])
        rows += [[number, "effort", e.owner, float(e.values), e.unit] for e in item.efforts]
        rows += [
            [number, "output", name, x, unit_of_output(model, model.outputs[name])] for name, x in item.outputs.items()
        ]
    return to_csv(["solution", "quantity", "of", "value", "unit"], rows)


def sweep_data(result: Sweep, unit: str, factor: float, model: str, title: str) -> dict[str, Any]:
    """Return the JSON object of ``mbstab sweep``.

    Keys: ``model``, ``title``, ``parameter``, ``unit``, ``values`` (in that unit), ``branches``
    (lists with an eigenvalue for each value: ``real`` and ``imag`` in 1/s, null where there is
    none), ``unstable`` (their number for each value, null where the verdict is open), ``verdicts``
    (one for each value), ``spectrum`` (for each value numbers of eigenvalues that are not neutral: ``right`` and
    ``left`` of the imaginary axis, held on the ``axis`` by a structure, ``open``: of unknown side; null where there
    is no answer), ``neutral``, ``critical`` (``value``, ``kind``, ``branch``: numbers counting from 1,
    ``frequency`` in rad/s, ``krein_signatures`` of a collision, ``branching``, ``unstable_below``,
    ``unstable_above``, ``verdict_below``, ``verdict_above``, null where there is none, and ``enclosure``, see below),
    ``meetings`` (if asked for: ``value``, ``kind``, ``pairs``: how many of branches do so), ``problems`` (``point``
    counting from 0, ``reason``),
    ``warnings``, ``names`` (of the branches, null for those without), ``start`` (from where equilibria were followed,
    null if they are given), ``orders``, ``crossings`` (of frequencies with these: ``value``, ``order``,
    ``frequency`` in rad/s, ``branch`` from 1, ``name``, ``whirl``, ``motions``), ``whirls`` (of the branches:
    ``forward``, ``backward``, ``mixed``, ``changing``, null where nothing whirls; null as a whole without orders),
    ``reference`` (where the file asks to find it, lists of its coordinates in m and rad by name, and of its rates as
    ``rate(…)``; else empty), ``outputs`` (the outputs of the file there, lists by name) and ``beyond``: for each path
    beyond a fold or branch point, an object with the same keys from ``values`` on.

    An ``enclosure`` is null unless proofs are asked for: ``midpoint`` and ``radius`` as decimal texts, in the unit of
    the parameter (null where nothing is proven), ``conditions`` (what is not proven and must hold), ``reason`` (why
    nothing is proven).
    """
    head = {"model": model, "title": title, "parameter": result.parameter, "unit": unit}
    return head | _path_data(result, factor) | {"beyond": [_path_data(path, factor) for path in result.beyond]}


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
        "reference": result.reference,
        "outputs": result.outputs,
    }


def _enclosure(enclosed: Enclosed) -> dict[str, Any]:
    known = enclosed.value is not None
    ball = decimals(enclosed.value, enclosed.digits + 1) if known else {"midpoint": None, "radius": None}
    return {**ball, "conditions": enclosed.conditions, "reason": enclosed.reason}


def sweep_csv(result: Sweep, unit: str, factor: float) -> str:
    """Return one line per value: the value, the number of unstable eigenvalues, the verdict, the branches, the path.

    The heads of branches with names contain these. Coordinates and rates of a reference that is found follow the
    branches, and then the outputs of the file there. Paths count from 1; those beyond folds and branch points come
    after the first. The last column says why there is no answer, ``undecided`` where the verdict is open, and ``ok``
    otherwise. Where proofs are requested, a line for each critical value follows those of its path; its last column
    begins with ``critical`` and says what is proven.
    """
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
    return to_csv(heads, rows)


def _headed(name: str, unit: str) -> str:
    """Return the head of a column of a parameter."""
    return f"{name} ({unit})" if unit not in ("", "1") else name


def sweep_arrays(result: Sweep, factor: float) -> dict[str, Any]:
    """Return the arrays of a sweep for npz files; all paths one after the other, numbered in ``path`` from 1."""
    import numpy as np

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


def compare_data(result: Comparison, model: str, title: str) -> dict[str, Any]:
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
        "model": model,
        "title": title,
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


def compare_csv(result: Comparison) -> str:
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
    return to_csv(heads, rows)


def chart_data(result: Chart, labels: Sequence[tuple[str, float]], model: str, title: str) -> dict[str, Any]:
    """Return the JSON object of a stability chart.

    Keys: ``model``, ``title``, ``parameters``, ``units``, ``values`` (two lists, in these units),
    ``unstable`` (for each value of the second parameter a list over the first; null where the verdict
    is open), ``verdicts`` (in the same way), ``boundaries`` and ``divisions`` (lists of points), ``problems``,
    ``warnings``, ``start`` (the two values from which equilibria were followed, null if they are given).
    """
    begin = None if result.start is None else [x / factor for x, (_, factor) in zip(result.start, labels, strict=True)]
    return {
        "model": model,
        "title": title,
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


def chart_csv(result: Chart, labels: Sequence[tuple[str, float]]) -> str:
    """Return one line for each point of a chart."""
    verdicts = result.verdicts
    x, y = (in_unit(along, factor) for along, (_, factor) in zip((result.x, result.y), labels, strict=True))
    rows = [
        [float(a), float(b), int(result.unstable[i, j]) if result.unstable[i, j] >= 0 else "", verdicts[i][j]]
        for i, b in enumerate(y)
        for j, a in enumerate(x)
    ]
    heads = [_headed(name, unit) for name, (unit, _) in zip(result.parameters, labels, strict=True)]
    return to_csv([*heads, "unstable", "verdict"], rows)


def chart_arrays(result: Chart, labels: Sequence[tuple[str, float]]) -> dict[str, Any]:
    """Return the arrays of a chart for npz files; boundary curves are separated by rows of nan."""
    import numpy as np

    factors = [factor for _, factor in labels]
    curves = [part for curve in result.boundaries for part in (curve / factors, np.full((1, 2), np.nan))]
    return {
        "parameters": np.array(result.parameters),
        "x": in_unit(result.x, factors[0]),
        "y": in_unit(result.y, factors[1]),
        "unstable": result.unstable,
        "verdicts": np.array(result.verdicts),
        "boundaries": np.concatenate(curves) if curves else np.zeros((0, 2)),
    }


def npz_bytes(arrays: dict[str, Any]) -> bytes:
    """Return a NumPy archive."""
    import numpy as np

    out = BytesIO()
    np.savez(out, **arrays)
    return out.getvalue()


def mat_bytes(arrays: dict[str, Any]) -> bytes:
    """Return a MATLAB file (version 5); texts become cell arrays."""
    import numpy as np
    from scipy.io import savemat

    out = BytesIO()
    savemat(out, {key: x.astype(object) if x.dtype.kind == "U" else np.asarray(x) for key, x in arrays.items()})
    return out.getvalue()
