"""Many states: their projection onto the constraints, their accelerations, multipliers and residuals.

`Constrained` takes them all at once. Where that fails at some state, each is looked at by itself, which says what is
wrong and when.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from mbstab.analysis.simulate.constrained import Constrained
from mbstab.analysis.simulate.tolerances import TOLERANCES
from mbstab.compiler.system import Array, System
from mbstab.errors import MbstabError

FAILURES = (MbstabError, ArithmeticError, ValueError, np.linalg.LinAlgError)


class Found(NamedTuple):
    """What belongs to states on the constraints.

    Attributes
    ----------
    a : ndarray, shape (n_t, n_q)
    nu : ndarray, shape (n_t, n_c)
        Multipliers, of least norm where rows are redundant.
    J : ndarray, shape (n_t, n_c, n_q)
    kinetic : ndarray, shape (n_t,) (J)
    residuals : ndarray, shape (n_t, 2)
        As of `Constrained.residuals`.
    """

    a: Array
    nu: Array
    J: Array
    kinetic: Array
    residuals: Array


def chunks(system: System, count: int) -> Iterator[slice]:
    """Yield the parts of a number of states that are processed together."""
    size = 1 + TOLERANCES.matrix_numbers_together // (1 + (system.n_c + system.n_q) ** 2)
    size = min(TOLERANCES.states_together, size)
    for start in range(0, count, size):
        yield slice(start, start + size)


def found_at(equations: Constrained, times: Array, q: Array, u: Array, a: Array | None = None) -> Found:
    """Return what belongs to states, shapes (n_t,) and (n_t, n_q), with given accelerations where rows leave them open.

    Raises
    ------
    MbstabError
        If a force or a given function of time has no value at a state.
    """
    if a is None and len(times) >= TOLERANCES.states_singly:
        try:
            with np.errstate(all="ignore"):
                found = _found(equations, times, q, u)
            if all(np.isfinite(x).all() for x in found):
                return found
        except FAILURES:
            pass
    singly = []
    for t, x, v, given in zip(times, q, u, [None] * len(times) if a is None else a, strict=True):
        if given is None and not equations.full:
            equations.refresh(equations.evaluate(t, x, v))
        singly.append(_found(equations, t, x, v, given))
    return Found(*(np.array(x) for x in zip(*singly, strict=True)))


def _found(e: Constrained, t: Any, q: Array, u: Array, a: Array | None = None) -> Found:
    """Return what belongs to one state or to many."""
    if a is None:
        a, nu, state = e.accelerations(t, q, u)
        nu = e.least(nu, state.J)
    else:
        state = e.evaluate(t, q, u)
        nu = e.multipliers(state, a)
    kinetic = 0.5 * np.sum(u * (state.M @ u[..., None])[..., 0], axis=-1)
    return Found(a, nu, state.J, kinetic, np.stack(e.residuals(state, e.fastest(u)), axis=-1))


def settled(equations: Constrained, times: Array, q: Array, u: Array) -> Iterator[tuple[Array, Array, Array]]:
    """Yield times and states near the constraints after the projection of `Constrained.project`, in parts.

    Raises
    ------
    NumericalError
        If a state cannot satisfy them; the states before have been yielded.
    """
    for part in chunks(equations.system, len(times)):
        state = times[part], q[part], u[part]
        if equations.n_c == 0:
            yield state
            continue
        try:
            with np.errstate(all="ignore"):
                x, v, _ = equations.project(*state)
        except FAILURES:
            for t, x, v in zip(*state, strict=True):
                if not equations.full:
                    equations.refresh(equations.evaluate(t, x, v))
                x, v, _ = equations.project(t, x, v)
                yield np.array([t]), x[None], v[None]
        else:
            yield state[0], x, v
