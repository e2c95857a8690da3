"""Rows of first-order states, compared term by term with a motion of a group.

A state is in any unit, and what drives it may be weak beside what else its rate contains. The change of a row along a
group is therefore judged by the size of its own terms, with many digits.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from mbstab.analysis.reference.element_comparison import State, numbers, steps_are_exact
from mbstab.analysis.reference.fields import Field, Shift
from mbstab.analysis.reference.tolerances import TOLERANCES
from mbstab.compiler.placed import Placed
from mbstab.compiler.scatter import by_entry
from mbstab.compiler.system import Array, System
from mbstab.model.arithmetic import mpmath_arithmetic


def states_follow(system: System, states: Sequence[State], field: Field, time: float) -> bool:
    """Return whether a group maps the rates of first-order states to their rates, to first order."""
    return _vanish(system, [(x, field.field(x.q), field.slope(x.q) @ x.u) for x in states], time, field)


def states_unmoved(system: System, states: Sequence[State], shift: Shift, time: float) -> bool:
    """Return whether a speed along a shift changes no rate of a first-order state."""
    return _vanish(system, [(x, np.zeros(system.n_q), shift.direction) for x in states], time, shift)


def _vanish(system: System, moves: list[tuple[State, Array, Array]], time: float, field: Field) -> bool:
    """Return whether V_q Y + V_u Ẏ vanishes in each row of a state, beside the sizes of its terms."""
    rows = set(system.states[1].tolist())
    moved = set(np.flatnonzero(np.any([x for _, *change in moves for x in change], axis=0)).tolist())
    elements = [e for e in system._elements if not (rows.isdisjoint(e.rows) or moved.isdisjoint(e.columns))]
    if not elements:
        return True
    from mpmath import mp

    limit = TOLERANCES.comparison_exact if steps_are_exact(field) else TOLERANCES.row_change_of_state
    with mp.workdps(TOLERANCES.comparison_digits):
        f = mpmath_arithmetic()
        for at, *change in moves:
            q, u = ([*numbers(x, f), f.number("0")] for x in (at.q, at.u))
            along = [[*numbers(x, f), f.number("0")] for x in change]
            for e in elements:
                if any(abs(total) > limit * size for total, size in _changes(e, f, q, u, along, time)):
                    return False
    return True


def _changes(e: Placed, f: Any, q: Any, u: Any, along: list[Any], time: float) -> list[tuple[Any, Any]]:
    """Return the change of each row of an element, and the sum of the sizes of its terms."""
    terms: list[list[Any]] = [[] for _ in e.rows]
    still = [f.number("0")] * len(q)
    for function, key, Y in (("linearize_rows", "V_q", along[0]), ("dynamics", "J", along[1])):
        values = getattr(e.kernel, function)(f, *e.arguments(function, q, u, still, still, time))
        for name, index, value in by_entry(e.kernel, function, values):
            if name == key:
                terms[index[0]].append(value * Y[e.columns[index[1]]])
    return [(sum(row), sum(abs(x) for x in row)) for row in terms]
