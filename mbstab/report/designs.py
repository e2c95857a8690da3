"""Designs as text, JSON and model files."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from mbstab.errors import NumericalError, counted
from mbstab.model.arithmetic import FLOAT
from mbstab.model.parameters import evaluate_parameters
from mbstab.model.reader import read_model_text
from mbstab.model.schema import Model, after_number
from mbstab.report.styles import document
from mbstab.report.tables import eigenvalue, number, table, wrap_lines

if TYPE_CHECKING:
    from mbstab.analysis.design.design import Design
    from mbstab.analysis.design.goals import Active
    from mbstab.analysis.proof.certify import Certificate

GOALS = {"decay": "decay rate of the slowest disturbance", "damping": "smallest damping ratio"}

SHOWN = 1e-12
"""A goal smaller than this fraction of the eigenvalues is rounding, and shown as zero."""


def design_text(found: Design, model: Model, proofs: Sequence[Certificate] = ()) -> str:
    """Return the answer of ``mbstab design`` as text.

    Parameters
    ----------
    proofs : sequence of Certificate
        What is proven about the result: over an interval, or at the values at which it is checked.
    """
    task = found.task
    lines = [*wrap_lines(_goal(found, model)), ""]
    rows = []
    for name, value in found.values.items():
        parameter = model.parameters[name]
        shown = [x / parameter.factor for x in (found.before[name], value, *task.vary[name])]
        where = f"at the {found.bounds[name]}" if name in found.bounds else ""
        rows.append([name, parameter.unit or "1", *(number(x, 8) for x in shown), where])
    heads = ["parameter", "unit", "before", "best found", "first", "last", ""]
    lines += [table(heads, rows, left=(0, 1, 6)), *_gain(found, model), ""]
    if found.active:
        lines.append("limited by")
        lines += [f"  {_active(x, model)}" for x in found.active]
    lines += wrap_lines("; ".join([counted(found.steps, "step"), *filter(None, [found.ended])]))
    lines += [*wrap_lines(f"checked {_at(found.worst, model)}: {found.result.verdict}", "", "  ")]
    for text in _statements(proofs, found, model):
        lines += wrap_lines(f"proof {text}", "", "  ")
    lines += ["", "again: " + " ".join(f"--set {name}={text}" for name, text in _settings(found, model).items())]
    return document(lines)


def _settings(found: Design, model: Model) -> dict[str, str]:
    """Return all parameters that are to be set, as texts in their declared units."""
    from mbstab.analysis.design.design import settings

    values = evaluate_parameters(model, {}, FLOAT)
    return settings(model, {name: values[name] for name in model.settings} | found.values)


def _goal(found: Design, model: Model) -> str:
    task = found.task
    if task.goal == "range":
        own = model.parameters[task.parameter]
        first, last = (number(x / own.factor) for x in task.window)
        return f"goal: widest stable range of {own.name} between {first} and {last}{after_number(own.unit)}"
    box = [_interval(name, ends, model) for name, ends in task.over.items()]
    worst = f", the worst for {' and '.join(box)}" if box else ""
    return f"goal: {GOALS[task.goal]} as large as possible{worst}"


def _interval(name: str, ends: tuple[float, float], model: Model) -> str:
    own = model.parameters[name]
    first, last = (number(x / own.factor, 8) for x in ends)
    return f"{name} from {first} to {last}{after_number(own.unit)}"


def _gain(found: Design, model: Model) -> list[str]:
    """Return what was gained."""
    task = found.task
    if task.goal != "range":
        unit = " 1/s" if task.goal == "decay" else ""
        size = max((abs(x.value) for x in found.active), default=0.0) if task.goal == "decay" else 1.0
        first, best = (0.0 if abs(x) <= SHOWN * size else x for x in (found.first, found.best))
        lines = [f"{GOALS[task.goal]}: {number(first, 8)}{unit} before, {number(best, 8)}{unit} now"]
        if task.over:
            lines.append(f"(as {found.checked} places show: what is narrower than their distance may be missed)")
        if not found.decays:
            lines.append("no motion was found about which all disturbances decay")
    else:
        own, lines = model.parameters[task.parameter], []
        for when, ends, size in (
            ("before", found.interval_before, found.first),
            ("now", found.interval, found.best),
        ):
            text = "no stable value was found"
            if ends is not None:
                text = f"{_interval(own.name, ends, model)}, {number(size / own.factor, 8)} wide"
            lines.append(f"stable {when}: {text}")
        lines.append(f"(as {found.checked} values show: what is narrower than their distance may be missed)")
    if task.limits.least is not None:
        lines.append(f"at least {task.limits.least:g} was asked for: {'' if found.reached else 'not '}reached")
    return [part for line in lines for part in wrap_lines(line, "", "  ")]


def _active(x: Active, model: Model) -> str:
    meets = ", which nearly meets another one" if x.meets else ""
    return f"{eigenvalue(x.value)} 1/s{' ' + _at(x.place, model) if x.place else ''}{meets}"


def _at(place: Mapping[str, float], model: Model) -> str:
    shown = []
    for name, value in place.items():
        own = model.parameters[name]
        shown.append(f"{name} = {number(value / own.factor, 8)}{after_number(own.unit)}")
    return f"at {', '.join(shown)}" if shown else "at these values"


def _statements(proofs: Sequence[Certificate], found: Design, model: Model) -> list[str]:
    """Return what proofs say, and where."""
    where = ["over an interval" if proof.parameter else _at(found.worst, model) for proof in proofs]
    return [f"{place}: {proof.statement}" for place, proof in zip(where, proofs, strict=True)]


def design_data(found: Design, model: Model, proofs: Sequence[Certificate] = ()) -> dict[str, Any]:
    """Return the JSON object of ``mbstab design``.

    Keys: ``model``, ``title``, ``goal``, ``parameter`` (of a range, else null), ``parameters`` (by name: ``unit``,
    ``before``, ``value``, ``from``, ``to``, ``bound``: ``first``, ``last`` or null), ``before`` and ``best`` (the goal:
    1/s, a ratio, or a width in the unit of the parameter; null where there is none), ``range_before`` and ``range``
    (ends in that unit, or null), ``reached``, ``active`` (``real`` and ``imag`` in 1/s, ``at``: values of parameters,
    ``meets``), ``checked_at``, ``verdict``, ``proofs`` (what they say), ``steps``, ``ended``, ``set``
    (settings that repeat it).
    """
    task, factors = found.task, {name: x.factor for name, x in model.parameters.items()}
    own = factors[task.parameter] if task.parameter else 1.0

    def ends(interval: tuple[float, float] | None) -> list[float] | None:
        return None if interval is None else [x / own for x in interval]

    def place(values: Mapping[str, float]) -> dict[str, float]:
        return {name: value / factors[name] for name, value in values.items()}

    return {
        "goal": task.goal,
        "parameter": task.parameter or None,
        "parameters": {
            name: {
                "unit": model.parameters[name].unit,
                "before": found.before[name] / factors[name],
                "value": value / factors[name],
                "from": task.vary[name][0] / factors[name],
                "to": task.vary[name][1] / factors[name],
                "bound": found.bounds.get(name),
            }
            for name, value in found.values.items()
        },
        "before": found.first / own if math.isfinite(found.first) else None,
        "best": found.best / own if math.isfinite(found.best) else None,
        "range_before": ends(found.interval_before),
        "range": ends(found.interval),
        "reached": found.reached,
        "active": [
            {"real": x.value.real, "imag": x.value.imag, "at": place(x.place), "meets": x.meets} for x in found.active
        ],
        "checked_at": place(found.worst),
        "verdict": found.result.verdict,
        "proofs": _statements(proofs, found, model),
        "steps": found.steps,
        "ended": found.ended,
        "set": _settings(found, model),
    }


def design_file(found: Design, model: Model) -> str:
    """Return the text of the model file with the values that are found."""
    return with_values(model, _settings(found, model))


def with_values(model: Model, given: Mapping[str, str]) -> str:
    """Return the text of a model file in which parameters have other values, in their declared units.

    Raises
    ------
    NumericalError
        If the file does not have them afterwards: it is written in an unusual way.
    """
    lines = list(model.document.lines)
    places = {name: (x.expression.location, x.expression.text) for name, x in model.parameters.items() if name in given}
    # From the end: columns before a change remain.
    for name, (location, text) in sorted(places.items(), key=lambda item: item[1][0].order, reverse=True):
        line, at = lines[location.line - 1], location.column - 1
        quote = line[at] if line[at : at + 1] in ("'", '"') else ""
        written = f"{quote}{text}{quote}"
        if line[at : at + len(written)] == written:
            lines[location.line - 1] = line[:at] + given[name] + line[at + len(written) :]
    changed = "\n".join(lines).rstrip("\n") + "\n"
    values = evaluate_parameters(read_model_text(changed, model.name), {}, FLOAT)
    for name, text in given.items():
        wanted = float(text) * model.parameters[name].factor
        if not math.isclose(float(values[name]), wanted, rel_tol=1e-14):
            raise NumericalError(
                f"{model.name}: the new value of {name} cannot be written\nhint: use --set {name}={text}"
            )
    return changed
