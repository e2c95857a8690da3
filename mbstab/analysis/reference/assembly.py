"""Coordinates that satisfy the holonomic constraints, and what to say where there are none."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from mbstab.analysis.algebra.failures import FAILURES
from mbstab.analysis.algebra.rank import inverse_of_part
from mbstab.analysis.algebra.sparse import dense, is_sparse, large, row_norms, scaled
from mbstab.analysis.algebra.sparse_rank import Rows
from mbstab.analysis.reference.refusals import vanishing_rows
from mbstab.analysis.reference.tolerances import TOLERANCES
from mbstab.compiler.system import Array, Row, System
from mbstab.errors import Problem
from mbstab.model.measures import unit_of_expression
from mbstab.model.schema import after_number
from mbstab.model.units import per_second

if TYPE_CHECKING:
    import numpy.typing as npt

    Flags = npt.NDArray[np.bool_]


def assembled(system: System, sizes: Array, q: Array, missing: Flags, kept: list[int] | None = None) -> Array:
    """Solve C = 0 for the missing coordinates: damped Gauss-Newton steps of minimum norm.

    Parameters
    ----------
    sizes : ndarray, shape (n_q,)
        Characteristic size of each coordinate.
    kept : list of int or None
        The rows of C that count; all, if not given.
    """
    zero, rows = np.zeros(system.n_q), slice(system.n_h) if kept is None else kept
    columns = np.flatnonzero(missing)

    def state(x: Array) -> tuple[Array, Any]:
        found = system.closing.dynamics(x, zero, system.scene.time)
        J = scaled(found.J[rows] if large(system) else dense(found.J[rows]), sizes)
        lengths = row_norms(J)
        unit = scaled(J, np.ones(len(q)), 1.0 / lengths) if is_sparse(J) else J / lengths[:, None]
        return found.E[rows] / lengths, unit

    E, J = state(q)
    for _ in range(TOLERANCES.newton_steps_onto_constraints):
        step = np.zeros(len(q))
        part = J[:, columns]
        change = Rows(part, TOLERANCES.assembly_shift).shortest(-E) if is_sparse(J) else -inverse_of_part(part) @ E
        step[columns] = change * sizes[columns]
        fraction, before = 1.0, float(np.linalg.norm(E))
        least = 1e-4 if float(np.linalg.norm(step / sizes)) > TOLERANCES.assembly_rounding else 1.0
        # Where linear rows promise nothing, no state is near.
        promised = float(np.linalg.norm(E + part @ change))
        if not np.any(step) or promised > (1.0 - TOLERANCES.assembly_gain) * before:
            break
        while True:
            trial = q + fraction * step
            E, J = state(trial)
            if np.linalg.norm(E) <= before * (1.0 - 1e-4 * fraction) or fraction <= least:
                break
            fraction *= 0.5
        improved = float(np.linalg.norm(E)) < before
        if improved:
            q = trial
        if not improved or np.linalg.norm(fraction * step / sizes) < 1e-15:
            break
    return q


def unclosed(system: System, sizes: Array, q: Array, missing: Flags) -> list[Problem]:
    """Return a problem for each row that a position does not satisfy, with the entries that it contradicts."""
    bad, E = _open_rows(system, sizes, q)
    # Forces may have no value without speeds, as creep and the slip of tyres.
    at, closing = (q, np.zeros(system.n_q), system.scene.time), system.closing
    if bad and (squares := vanishing_rows(closing, at, closing.dynamics(*at).J, sizes)):
        return squares
    if not missing.any():
        hint = "correct the values, or leave out those that the constraints determine"
        return [not_satisfied(system, i, E[i], hint) for i in bad]
    given = "" if missing.all() else ", and the coordinates that are given"
    hint = (
        "no coordinates were found that satisfy all of them: check lengths and points, which may contradict "
        f"each other or not reach{given}; if they do fit, give starting values under reference.guess"
    )
    owners = list(dict.fromkeys(system.rows[i].owner for i in bad))
    said: dict[str, dict[str, str]] = {}
    if 1 < len(owners) <= TOLERANCES.contradictions_sought and not system.sparse:
        said = {owner: _contradiction(system, sizes, q, missing, owner, bad) for owner in owners}
    told: dict[Any, Problem] = {}
    for i in bad:
        owner, unit = system.rows[i].owner, system.rows[i].unit
        apart = said.get(owner, {}).get(unit, "")
        # Of rows that come together when the others hold, one gap is told.
        told.setdefault((owner, unit) if apart else i, not_satisfied(system, i, E[i], hint, apart))
    return list(told.values())


def not_satisfied(system: System, i: int, value: float, hint: str, apart: str = "", per: str = "") -> Problem:
    """Return the problem of a row that the reference does not satisfy, or of its entry if that is known to be apart."""
    row = system.rows[i]
    measured = f"{row}: {row.residual} is {value:.6g}{unit_of_row(system, row, per)}"
    message = f"the reference does not satisfy {f'{row.owner}: {apart}' if apart else measured}"
    return system.scene.model.document.problem(row.location, f"{row.section}.{row.name}", message, hint)


def unit_of_row(system: System, row: Row, per: str = "") -> str:
    """Return the unit of the residual of a row as it is written after a number, `per` a unit such as ``/s``."""
    unit, model = row.unit, system.scene.model
    if unit.startswith("unit"):
        ((_, expression),) = model.entries[row.section][row.name].equations.items()
        unit = unit_of_expression(model, expression) or f"in the {unit}"
    return after_number(per_second(unit) if per and not unit.startswith("in") else unit + per)


def _open_rows(system: System, sizes: Array, q: Array) -> tuple[list[int], Array]:
    """Return the rows that a position does not satisfy, and the residuals of all."""
    state = system.closing.dynamics(q, np.zeros(system.n_q), system.scene.time)
    allowed = TOLERANCES.residual * abs(state.J) @ sizes + 1e-300
    return [i for i in range(system.n_h) if not abs(state.E[i]) <= allowed[i]], state.E


def _contradiction(
    system: System, sizes: Array, q: Array, missing: Flags, owner: str, bad: list[int]
) -> dict[str, str]:
    """Return by unit what is left of an entry where those that it contradicts are satisfied.

    It contradicts the entries that a position near this one satisfies without it.
    """
    kept = [i for i in range(system.n_h) if system.rows[i].owner != owner]
    try:
        still, E = _open_rows(system, sizes, assembled(system, sizes, q, missing, kept))
    except FAILURES:
        return {}
    left = {system.rows[i].owner for i in still}
    closed = list(dict.fromkeys(x for i in bad if (x := system.rows[i].owner) != owner and x not in left))
    said = {}
    for unit in {system.rows[i].unit for i in still if system.rows[i].owner == owner} if closed else ():
        own = [i for i in range(system.n_h) if (system.rows[i].owner, system.rows[i].unit) == (owner, unit)]
        gap = float(np.linalg.norm(E[own]))
        what = "the gap" if all(system.rows[i].residual == Row.residual for i in own) else system.rows[own[0]].residual
        where = f"{', '.join(closed)} {'is' if len(closed) == 1 else 'are'} satisfied"
        said[unit] = f"where {where}, {what} is {gap:.6g}{unit_of_row(system, system.rows[own[0]])}"
    return said
