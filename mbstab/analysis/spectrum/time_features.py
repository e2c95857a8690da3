"""Where functions of time or of a known motion change so fast that steps of an integration must be short to see it."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from itertools import chain
from typing import Any

import numpy as np

from mbstab.analysis.algebra.failures import FAILURES
from mbstab.analysis.reference.attitude import Attitudes
from mbstab.analysis.reference.efforts import Placement
from mbstab.analysis.spectrum.tolerances import TOLERANCES
from mbstab.analysis.verdict.written import expressions
from mbstab.compiler.system import Array, System
from mbstab.errors import MbstabError
from mbstab.model.arithmetic import array_arithmetic
from mbstab.model.dependencies import flat_somewhere
from mbstab.model.expressions import Expression, ExpressionError
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
    for values in chain(_functions(system, times), _of_motion(system, times, *path(part)) if path else ()):
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


def with_features(system: System) -> bool:
    """Whether functions of the motion may be flat along a way and then have a bump."""
    return any(next(flat_somewhere(x, system.names), None) for _, _, x, _ in expressions(system))


def _of_motion(system: System, times: Array, q: Array, u: Array) -> Iterator[Array]:
    """Yield the values of such functions along a motion, shape (n_t,)."""
    place = Placement(Attitudes.of(system), system, q, u)
    for _, _, expression, _ in expressions(system):
        for node in flat_somewhere(expression, system.names):
            with contextlib.suppress(*FAILURES), np.errstate(all="ignore"):
                # What has no value is told where it is evaluated.
                yield np.broadcast_to(place.value(Expression(expression.text, node), times), times.shape)


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
