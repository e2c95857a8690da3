"""Names of modes, carried from where the file defines them to where they are asked for.

A name belongs to the branch of an eigenvalue (`mbstab.analysis.spectrum.mode_names` finds it at the values of the file
and of ``at:``). From there parameters are changed one after the other, and branches are followed as in a sweep, through
crossings and past each other. A pair that meets on the real axis gives its name to both real eigenvalues; a pair that
arises from two branches has the names of both.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from mbstab.analysis.algebra.arrays import Complex
from mbstab.analysis.algebra.matching import assigned
from mbstab.analysis.linear.linearize import linearize
from mbstab.analysis.reference.requested import reference_motion
from mbstab.analysis.spectrum.eigenvalues import answer
from mbstab.analysis.spectrum.mode_names import Found, find_modes
from mbstab.analysis.spectrum.results import EigenResult
from mbstab.analysis.sweep.tolerances import TOLERANCES
from mbstab.compiler.system import Array, System
from mbstab.errors import MbstabError, ModelFileError, NumericalError
from mbstab.model.arithmetic import FLOAT
from mbstab.model.parameters import bound, evaluate_parameters, of_file, settings_in_si
from mbstab.model.schema import Model, ModeName
from mbstab.model.values import evaluate
from mbstab.records import dataclass

if TYPE_CHECKING:
    from mbstab.analysis.sweep.batched_equations import Pattern
    from mbstab.analysis.sweep.sweep import Sweep

UNNAMED = "unnamed"
"""The part of a pair that arises from a branch without a name."""


@dataclass(frozen=True)
class _Line:
    """Where eigenvalues have been followed along one parameter.

    Attributes
    ----------
    x : ndarray, shape (points,)
        Values of the parameter (SI), ascending.
    values : ndarray of complex, shape (points, r)
        The eigenvalues there, in continuous columns, with …
    names : list of str
        … these names.
    patterns : list of Pattern
        Of points between.
    """

    x: Array
    values: Complex
    names: list[str]
    patterns: list[Pattern]

    def with_points(self, x: Array, values: Complex) -> _Line:
        """Return a line with further points, in the same columns."""
        every, first = np.unique(np.concatenate([self.x, x]), return_index=True)
        return _Line(every, np.concatenate([self.values, values])[first], self.names, self.patterns)


class Lines:
    """What has been followed from where a file defines modes, for one model and any values of its parameters."""

    def __init__(self) -> None:
        self.starts: dict[tuple[str, ...], tuple[Complex, Found]] = {}
        self.lines: dict[tuple[object, ...], _Line] = {}

    def keep(self, key: tuple[object, ...], line: _Line) -> None:
        """Keep a line; the oldest one goes where there are many."""
        self.lines.pop(key, None)
        while len(self.lines) >= TOLERANCES.lines_kept:
            self.lines.pop(next(iter(self.lines)))
        self.lines[key] = line


def with_names(model: Model, result: EigenResult, lines: Lines) -> EigenResult:
    """Return eigenvalues with the names of their modes; what is ambiguous or not found is a warning.

    Parameters
    ----------
    model : Model
    result : EigenResult
        At the values of the model.
    lines : Lines
        What earlier calls have followed, to which this one adds.
    """
    if not model.modes or result.period is not None:
        return result
    values = _values(result)
    carried, notes = _carried(model, values, lines, result)
    names = iter(paired(carried, values))
    listed = [replace(e, name="" if math.isnan(e.error_bound) else next(names)) for e in result.eigenvalues]
    return replace(result, eigenvalues=listed, warnings=(*result.warnings, *notes))


def with_branch_names(model: Model, result: Sweep) -> Sweep:
    """Return a sweep with the names of its branches; what is ambiguous or not found is a warning."""
    known = np.flatnonzero(~np.any(np.isnan(result.branches), axis=1))
    if not model.modes or not len(known) or not result.branches.shape[1]:
        return result
    # The point nearest to where the first mode is defined.
    start = evaluate_parameters(_start(model, model.modes[0]), {}, FLOAT)[result.parameter]
    k = int(known[np.argmin(np.abs(result.values[known] - start))])
    here = bound(model, settings_in_si({result.parameter: float(result.values[k])}))
    names, notes = _carried(here, result.branches[k], Lines())
    return replace(result, names=tuple(names), warnings=(*result.warnings, *notes))


def _values(result: EigenResult) -> Complex:
    return np.array([e.value for e in result.eigenvalues if not math.isnan(e.error_bound)], dtype=complex)


def _carried(
    model: Model, values: Complex, lines: Lines, known: EigenResult | None = None
) -> tuple[list[str], list[str]]:
    """Return the name of each of the eigenvalues at the values of a model, and what is to be said about them.

    ``known`` is the answer there, if there is one: it serves where modes are defined at the same values.
    """
    groups: dict[tuple[tuple[str, str], ...], list[ModeName]] = {}
    for mode in model.modes:
        groups.setdefault(tuple((name, x.text) for name, x in mode.at.items()), []).append(mode)
    names, notes = [list[str]() for _ in values], list[str]()
    for modes in groups.values():
        try:
            found, more = _followed(model, modes, values, lines, known)
        except ModelFileError:
            raise
        except MbstabError as error:
            listed = ", ".join(repr(mode.name) for mode in modes)
            notes.append(f"the modes {listed} are not found: {str(error).splitlines()[0]}")
            continue
        notes += more
        for own, name in zip(names, found, strict=True):
            own += [name] if name else []
    return [" + ".join(own) for own in names], notes


def _start(model: Model, mode: ModeName) -> Model:
    """Return the model where a mode is defined."""
    return bound(of_file(model), {name: x.text for name, x in mode.at.items()})


def _followed(
    model: Model, modes: Sequence[ModeName], values: Complex, lines: Lines, known: EigenResult | None
) -> tuple[list[str], list[str]]:
    """Return the names of eigenvalues at the values of a model, for modes that are defined at one point.

    Raises
    ------
    MbstabError
        If the eigenvalues cannot be followed from there.
    """
    start = _start(model, modes[0])
    first, last = (evaluate_parameters(x, {}, FLOAT) for x in (start, model))
    changed = [name for name in {**start.settings, **model.settings} if first[name] != last[name]]
    group = tuple(mode.name for mode in modes)
    if group in lines.starts and (changed or known is None):
        now, found = lines.starts[group]
    else:
        system = System(evaluate(start))
        result = answer(system) if changed or known is None else known
        found = find_modes(lambda: linearize(system, reference_motion(system, massless=True)), result, modes)
        now = _values(result)
        if result is not known:  # which may have a few eigenvalues only
            lines.starts[group] = now, found
    names = [_named(found.values, value) for value in now]
    here = {name: first[name] for name in changed}
    fixed = {name: last[name] for name in {**start.settings, **model.settings} if name not in changed}
    for name in changed:
        others = {key: x for key, x in (fixed | here).items() if key != name}
        key = (group, name, *sorted(others.items()))
        line = lines.lines.get(key) or _Line(np.array([first[name]]), now[None], names, [])
        line = _extended(line, model, name, others, last[name], values if name == changed[-1] else None)
        lines.keep(key, line)
        now, names, here[name] = line.values[np.searchsorted(line.x, last[name])], line.names, last[name]
    return _matched(names, now, values), list(found.notes)


def _extended(
    line: _Line, model: Model, parameter: str, others: Mapping[str, float], goal: float, values: Complex | None
) -> _Line:
    """Return a line with a value of the parameter, followed from the nearest one unless its eigenvalues are beside it.

    Raises
    ------
    NumericalError
        If they cannot be told apart all the way.
    """
    from mbstab.analysis.sweep.tracking import follow

    k = int(np.argmin(np.abs(line.x - goal)))
    near, before = float(line.x[k]), line.values[k]
    if near == goal:
        return line
    if values is not None and abs(goal - near) * (TOLERANCES.points_followed - 1) <= np.ptp(line.x):
        _require_same(before, values)
        link, clear = follow(before[None], values[None])
        if clear[0]:
            return line.with_points(np.array([goal]), values[link])
    there = bound(of_file(model), settings_in_si(dict(others)))
    path = _branches(there, parameter, (near, goal), len(before), line.patterns)
    _require_same(before, path[0])
    columns = assigned(np.abs(before[:, None] - path[0][None, :]))
    return line.with_points(np.linspace(near, goal, len(path)), path[:, columns])


def _branches(model: Model, parameter: str, ends: tuple[float, float], count: int, patterns: list[Pattern]) -> Complex:
    """Return the eigenvalues at points from one value of a parameter to another, in continuous columns.

    New patterns are added to those that are tried first.

    Raises
    ------
    NumericalError
        If they cannot be told apart all the way.
    """
    from mbstab.analysis.reference.continuation import follow as follow_path
    from mbstab.analysis.sweep.batched_spectra import Evaluator
    from mbstab.analysis.sweep.blocks import followed
    from mbstab.analysis.sweep.branches import Branches

    (first, last), (low, high) = ends, sorted(ends)
    path = None if model.reference.find is None else follow_path(model, parameter, low, high, first)
    evaluator = Evaluator(model, path, patterns)
    x = np.linspace(low, high, TOLERANCES.points_followed)
    raw = followed(evaluator.near({parameter: x}, count))
    patterns[:] = evaluator.patterns
    # Where most points have nothing in common, or no neighbours have, as many in between would take minutes.
    if evaluator.alone <= len(x) // 2 and np.any(raw.clear):
        branches = Branches(evaluator, parameter, x, raw, TOLERANCES.points_between_names, TOLERANCES.meeting_interval)
        found = branches.branches()
        if branches.stopped is None:
            return found if first < last else found[::-1]
    raise NumericalError(
        f"their eigenvalues cannot be told apart all the way from {parameter} = {first:.6g} to {last:.6g} in SI "
        "units; define them nearer, with at:"
    )


def _named(found: Mapping[str, complex], value: complex) -> str:
    """Return the name of an eigenvalue, or of its conjugate."""
    return next((name for name, known in found.items() if value in (known, known.conjugate())), "")


def _matched(names: list[str], before: Complex, after: Complex) -> list[str]:
    """Return the names of eigenvalues that are those before, in another order.

    Raises
    ------
    NumericalError
        If there are more of them, or fewer, or none.
    """
    _require_same(before, after)
    order = assigned(np.abs(after[:, None] - before[None, :]))
    return [names[k] for k in order]


def _require_same(before: Complex, after: Complex) -> None:
    """Refuse spectra of which one has more eigenvalues than the other, or none."""
    if len(before) != len(after) or np.any(np.isnan(before)) or np.any(np.isnan(after)):
        raise NumericalError("the eigenvalues cannot be followed from where the file defines the modes")


def paired(names: Sequence[str], values: Complex) -> list[str]:
    """Return the names of eigenvalues, those of a pair together."""
    found = []
    for name, value in zip(names, values.tolist(), strict=True):
        other = names[int(np.argmin(np.abs(values - value.conjugate())))] if value.imag else name
        both = sorted({name, other}, key=lambda x: (not x, x))
        found.append(" + ".join(x or UNNAMED for x in both) if any(both) and len(both) > 1 else name)
    return found
