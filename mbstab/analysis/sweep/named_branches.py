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
from mbstab.analysis.spectrum.mode_names import find_modes
from mbstab.analysis.spectrum.results import EigenResult
from mbstab.analysis.sweep.tolerances import TOLERANCES
from mbstab.compiler.system import System
from mbstab.errors import MbstabError, ModelFileError, NumericalError
from mbstab.model.arithmetic import FLOAT
from mbstab.model.parameters import bound, evaluate_parameters, of_file, settings_in_si
from mbstab.model.schema import Model, ModeName
from mbstab.model.values import evaluate

if TYPE_CHECKING:
    from mbstab.analysis.sweep.sweep import Sweep

UNNAMED = "unnamed"
"""The part of a pair that arises from a branch without a name."""


def with_names(model: Model, result: EigenResult) -> EigenResult:
    """Return eigenvalues with the names of their modes; what is ambiguous or not found is a warning."""
    if not model.modes or result.period is not None:
        return result
    values = _values(result)
    carried, notes = _carried(model, values, result)
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
    names, notes = _carried(here, result.branches[k])
    return replace(result, names=tuple(names), warnings=(*result.warnings, *notes))


def _values(result: EigenResult) -> Complex:
    return np.array([e.value for e in result.eigenvalues if not math.isnan(e.error_bound)], dtype=complex)


def _carried(model: Model, values: Complex, known: EigenResult | None = None) -> tuple[list[str], list[str]]:
    """Return the name of each of the eigenvalues at the values of a model, and what is to be said about them.

    ``known`` is the answer there, if there is one: it serves where modes are defined at the same values.
    """
    groups: dict[tuple[tuple[str, str], ...], list[ModeName]] = {}
    for mode in model.modes:
        groups.setdefault(tuple((name, x.text) for name, x in mode.at.items()), []).append(mode)
    names, notes = [list[str]() for _ in values], list[str]()
    for modes in groups.values():
        try:
            found, more = _followed(model, modes, values, known)
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
    model: Model, modes: Sequence[ModeName], values: Complex, known: EigenResult | None
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
    system = System(evaluate(start))
    result = answer(system) if changed or known is None else known
    found = find_modes(lambda: linearize(system, reference_motion(system, massless=True)), result, modes)
    now = _values(result)
    names = [_named(found.values, value) for value in now]
    here = {name: first[name] for name in changed}
    fixed = {name: last[name] for name in {**start.settings, **model.settings} if name not in changed}
    for name in changed:
        others = {key: x for key, x in (fixed | here).items() if key != name}
        path = _branches(bound(of_file(model), settings_in_si(others)), name, first[name], last[name], len(now))
        names = _matched(names, now, path[0])
        now, here[name] = path[-1], last[name]
    return _matched(names, now, values), list(found.notes)


def _branches(model: Model, parameter: str, first: float, last: float, count: int) -> Complex:
    """Return the eigenvalues at points from one value of a parameter to another, in continuous columns.

    Raises
    ------
    NumericalError
        If they cannot be told apart all the way.
    """
    from mbstab.analysis.reference.continuation import follow as follow_path
    from mbstab.analysis.sweep.batched_spectra import Evaluator
    from mbstab.analysis.sweep.blocks import followed
    from mbstab.analysis.sweep.branches import Branches

    low, high = min(first, last), max(first, last)
    path = None if model.reference.find is None else follow_path(model, parameter, low, high, first)
    evaluator = Evaluator(model, path)
    x = np.linspace(low, high, TOLERANCES.points_followed)
    raw = followed(evaluator.near({parameter: x}, count))
    # Where most points have nothing in common, or no neighbours have, as many in between would take minutes.
    if evaluator.alone <= len(x) // 2 and np.any(raw.clear):
        branches = Branches(evaluator, parameter, x, raw, TOLERANCES.points_between_names, locates=True)
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
    if len(before) != len(after) or np.any(np.isnan(before)) or np.any(np.isnan(after)):
        raise NumericalError("the eigenvalues cannot be followed from where the file defines the modes")
    order = assigned(np.abs(after[:, None] - before[None, :]))
    return [names[k] for k in order]


def paired(names: Sequence[str], values: Complex) -> list[str]:
    """Return the names of eigenvalues, those of a pair together."""
    found = []
    for name, value in zip(names, values.tolist(), strict=True):
        other = names[int(np.argmin(np.abs(values - value.conjugate())))] if value.imag else name
        both = sorted({name, other}, key=lambda x: (not x, x))
        found.append(" + ".join(x or UNNAMED for x in both) if any(both) and len(both) > 1 else name)
    return found
