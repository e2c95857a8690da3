"""Loops that do not quite close: rows that repeat others to first order and contradict them by the digits of a file.

A loop of a spatial mechanism with parallel axes has redundant rows. Rounded lengths, as drawing programs write them,
let these contradict the others by little, and then they would lock the mechanism, or leave no position at all.
"""

from __future__ import annotations

import numpy as np

from mbstab.analysis.algebra.arrays import norms
from mbstab.analysis.algebra.failures import FAILURES
from mbstab.analysis.algebra.rank import last_rows
from mbstab.analysis.algebra.sparse import large
from mbstab.analysis.reference.assembly import assembled
from mbstab.analysis.reference.attitude import Attitudes
from mbstab.analysis.reference.efforts import Placement
from mbstab.analysis.reference.motion import Finder
from mbstab.analysis.reference.state_units import characteristic_sizes
from mbstab.analysis.reference.tolerances import TOLERANCES
from mbstab.compiler.system import Array, System
from mbstab.errors import ModelFileError
from mbstab.model.arithmetic import FLOAT
from mbstab.model.schema import LeftOut


def contradicting(system: System) -> tuple[LeftOut, ...]:
    """Return the rows that other rows imply but for less than the closure tolerance of the file.

    Raises
    ------
    ModelFileError
        If a row contradicts others by more, but by little; names it.
    """
    if not system.n_h or large(system):
        return ()
    finder, n_h = Finder(system), system.n_h
    q, missing = finder.start()

    def rows_at(q: Array) -> tuple[Array, Array]:
        state = system.closing.dynamics(q, 0.0 * q, system.scene.time)
        J = state.J[:n_h] * finder.sizes
        return state.E[:n_h], J / norms(J)[:, None]

    try:
        unit = rows_at(q := finder.assemble(q, missing) if missing.any() else q)[1]
        left, s, _ = np.linalg.svd(unit)
        combinations = left[:, int(np.sum(s > TOLERANCES.row_repeated)) :]
        if not combinations.size:
            return ()
        last = [i for i, _ in last_rows(combinations, TOLERANCES.row_repeated)]
        kept = np.setdiff1d(np.arange(n_h), last)
        if missing.any():
            q = assembled(system, finder.sizes, q, missing, kept.tolist())
        gaps, unit = rows_at(q)
    except FAILURES:
        return ()
    size = float(np.max(finder.sizes[finder.is_length]))
    lengths = np.array([1.0 if row.unit == "m" else size for row in system.rows[:n_h]])
    if np.max(np.abs(gaps * lengths)[kept], initial=0.0) > TOLERANCES.residual * size:
        return ()
    weights = unit[last] @ np.linalg.pinv(unit[kept])
    apart = np.linalg.norm(unit[last] - weights @ unit[kept], axis=1)
    loops = [kept[np.abs(weight) > TOLERANCES.row_in_loop] for weight in weights]
    return _judged(system, q, last, np.abs(gaps[last]), apart, loops)


def _judged(
    system: System, q: Array, last: list[int], gaps: Array, parts: Array, loops: list[Array]
) -> tuple[LeftOut, ...]:
    """Return which of the last rows are left out, given their contradictions, independent parts and other rows."""
    given, parameters = system.scene.model.reference.closure_tolerance, system.scene.parameters
    found, problems = list[LeftOut](), []
    for k, gap, part, others in zip(last, gaps.tolist(), parts, loops, strict=True):
        row, size = system.rows[k], _extent(system, q, [k, *others])
        gap *= 1.0 if row.unit == "m" else size
        # What holds, holds.
        if gap <= TOLERANCES.closure_rounding * size or max(gap / size, part) > TOLERANCES.row_repeated:
            continue
        allowed = TOLERANCES.closure * size if given is None else float(given.evaluate(parameters, FLOAT))
        owners = ", ".join(dict.fromkeys(system.rows[i].owner for i in others))
        over = "" if row.unit == "m" else " over the size of the loop"
        text = f"{row} repeats what {owners} already impose, and contradicts them by {gap:.2g} m{over}"
        if gap <= allowed:
            found.append(LeftOut(system.row_keys[k], f"redundant constraint: {text}; it is left out"))
        else:
            least = f"{2.0 * gap:.1g}"
            hint = f"correct the lengths, or leave it out with reference: {{closure_tolerance: {least}}} (m)"
            problems.append(system.scene.model.document.problem(row.location, f"{row.section}.{row.name}", text, hint))
    if problems:
        raise ModelFileError(problems)
    return tuple(found)


def _extent(system: System, q: Array, rows: list[int]) -> float:
    """Return the largest distance between two points at which the entries of some rows act (m)."""
    entries = {(system.rows[i].section, system.rows[i].name) for i in rows}
    at = Placement(Attitudes.of(system), system, q, np.zeros_like(q))
    items = (item for item in system.scene.items if (item.entry.section, item.name) in entries)
    places = np.array([at.place(marker) for item in items for marker in item.points_acted_on()])
    apart = np.linalg.norm(places[:, None] - places[None, :], axis=2) if len(places) else np.zeros(1)
    # Points that coincide, as of one joint about its centre, have no size of their own.
    return float(np.max(apart)) or float(np.max(characteristic_sizes(system, q)))
