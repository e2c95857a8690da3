"""The expressions of a scene that may contain t or the state: forces, constraints, and given motions."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

import numpy as np

from mbstab.analysis.algebra.failures import FAILURES
from mbstab.analysis.reference.attitude import Attitudes
from mbstab.analysis.reference.efforts import Placement
from mbstab.compiler.system import Array, System
from mbstab.mechanics.catalogue import ROWS
from mbstab.model.dependencies import expressions_in, flat_somewhere
from mbstab.model.expressions import Expression, Name, moves
from mbstab.model.fields.catalogue import given_fields
from mbstab.model.scene import ItemValues
from mbstab.model.schema import is_angle

Role = Literal["position", "velocity", "force", "holonomic", "nonholonomic"]


def expressions(system: System) -> Iterator[tuple[str, Role, Expression, bool]]:
    """Yield path, role and expression of everything that may contain t or the state, and whether it gives an angle."""
    for item in system.scene.items:
        entry = item.entry
        if item.kind.written in ROWS:
            yield from ((entry.path, item.kind.written, x, False) for x in entry.equations.values())
            continue
        for known, kind, value in given_fields(entry):
            if not kind.moving:
                continue
            role: Role = "force"
            if entry.section in ("drives", "contacts"):
                role = "position" if known.name == "position" else "velocity"
            angular = role == "position" and _is_angle(item)
            yield from ((entry.path, role, x, angular) for x in expressions_in(value))


def _is_angle(drive: ItemValues) -> bool:
    """Whether a drive gives an angle."""
    assert drive.kind.effort
    motion = drive.kind.effort(drive).motion
    return motion == "angle" or (motion == "coordinate" and is_angle(str(drive.entry.values["coordinate"])))


def with_time(system: System) -> list[tuple[str, Role, Expression, bool]]:
    """Return those that contain t."""
    return [x for x in expressions(system) if any(isinstance(node, Name) and node.name == "t" for node in x[2].walk())]


def with_state(system: System) -> Iterator[tuple[str, Expression]]:
    """Yield path and expression of those that contain the state, but for given motions."""
    state = set(system.names)
    for path, role, expression, _ in expressions(system):
        if role not in ("position", "velocity") and (
            expression.rates() or any(moves(name, state) for name in expression.names())
        ):
            yield path, expression


def with_features(system: System) -> bool:
    """Whether functions of the motion may be flat along a way and then have a bump."""
    return any(next(flat_somewhere(x, system.names), None) for _, _, x, _ in expressions(system))


def functions_along(system: System, times: Array, q: Array, u: Array) -> Iterator[tuple[str, Array]]:
    """Yield path and values, shape (n_t,), of such functions along a motion, without those that have no value there.

    Parameters
    ----------
    times : ndarray, shape (n_t,) (s)
    q, u : ndarray, shape (n_t, n_q)
    """
    place = Placement(Attitudes.of(system), system, q, u)
    for path, _, expression, _ in expressions(system):
        for node in flat_somewhere(expression, system.names):
            try:
                with np.errstate(all="ignore"):
                    values = place.value(Expression(expression.text, node), times)
            except FAILURES:
                continue
            yield path, np.broadcast_to(values, times.shape)


def cut(text: str) -> str:
    """Return a text on one line, its end left out where it is long."""
    text = " ".join(text.split())
    return text if len(text) <= 60 else text[:57] + "..."
