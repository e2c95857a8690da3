"""Where functions of time or of a known motion change so fast that steps of an integration must be short to see it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import chain
from typing import Any

import numpy as np

from mbstab.analysis.spectrum.tolerances import TOLERANCES
from mbstab.analysis.verdict.written import expressions, functions_along
from mbstab.compiler.system import Array, System
from mbstab.errors import MbstabError
from mbstab.model.arithmetic import array_arithmetic
from mbstab.model.expressions import ExpressionError
from mbstab.model.jets import Jet, jet_arithmetic

Path = Callable[[Array], tuple[Array, Array]]
"""Coordinates and rates at fractions of a period, each of shape (instants, n_q)."""


def variation(system: System, start: float, period: float, path: Path | None = None) -> tuple[Array, Array]:
    """Return instants of a period, as fractions of it, and how much functions have varied until then.

    Each is sampled densely and counts as a part of its whole variation; where several vary, the one that does so most.

    Parameters
    ----------
    start, period : float (s)
    path : callable, optional
        The motion. Without it functions of the time alone are looked at.
    """
    part = np.linspace(0.0, 1.0, TOLERANCES.time_samples + 1)
    change, times = np.zeros(TOLERANCES.time_samples), start + period * part
    along = (values for _, values in functions_along(system, times, *path(part))) if path else ()
    for values in chain(_functions(system, times), along):
        own = np.abs(np.diff(values))
        total, size = float(np.sum(own)), float(np.max(np.abs(values)))
        if np.isfinite(total) and total > TOLERANCES.change_in_time * size:
            change = np.maximum(change, own / total)
    return part, np.concatenate([[0.0], np.cumsum(change)])


def short_steps(part: Array, done: Array, longest: float) -> Array:
    """Return places within a period that steps must not pass over: features are between them.

    Between two places no function varies by more than a fraction of its whole variation; places that are no closer
    than steps anyway are left out.

    Parameters
    ----------
    part, done
        As `variation` returns.
    longest : float
        The longest step, as a fraction of the period.
    """
    count = int(done[-1] / (TOLERANCES.change_in_step * longest))
    places = np.interp(np.linspace(0.0, done[-1], count + 2), done, part) if count else np.zeros(0)
    near = np.diff(places) < TOLERANCES.feature_of_step * longest
    kept: Array = places[np.append(near, False) | np.append(False, near)] if count else places
    return kept


def _functions(system: System, times: Array) -> Iterator[Array]:
    """Yield the values of all parts of expressions that depend on the time alone; of given motions what accelerates."""
    f, names = jet_arithmetic(array_arithmetic()), {x: Jet(y) for x, y in system.scene.parameters.items()}
    names["t"] = Jet(times, np.ones_like(times), np.zeros_like(times))
    for _, role, expression, _ in expressions(system):
        if "t" not in expression.names():
            continue
        try:
            with np.errstate(all="ignore"):
                found = [Jet.of(x) for x in expression.coefficients(names, f)]
        except (ExpressionError, MbstabError, ArithmeticError, ValueError, TypeError):
            continue  # what has no value is told where it is evaluated
        for x in found:
            values: Any = x.second if role in ("position", "holonomic") else x.rate if role == "velocity" else x.value
            if np.shape(values) == times.shape:
                yield np.asarray(values, dtype=float)
