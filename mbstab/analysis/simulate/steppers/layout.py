"""A scene as the arrays of `mbstab.compiler.machine`: its equations as numbers, and the order of elimination."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from mbstab.analysis.reference.attitude import Attitudes
from mbstab.analysis.reference.tolerances import TOLERANCES as REFERENCE
from mbstab.analysis.simulate.constrained import Constrained
from mbstab.analysis.simulate.energy import Energy
from mbstab.analysis.simulate.tolerances import TOLERANCES
from mbstab.compiler.fused import Fused
from mbstab.compiler.machine.tables import DELTA, Machine, machine, table
from mbstab.compiler.system import Array, System
from mbstab.compiler.trace import Traced
from mbstab.records import dataclass


@dataclass(frozen=True)
class Elimination:
    """The order in which the unknowns of a symmetric matrix are eliminated, and the fill-in.

    Attributes
    ----------
    place : list of int
        Position of each unknown in the order.
    columns : list of list of int
        Nonzero places below the diagonal in each column of L, ascending.
    """

    place: list[int]
    columns: list[list[int]]

    @classmethod
    def of(cls, neighbours: list[set[int]], first: int) -> Elimination:
        """Choose the unknown with the fewest neighbours each time; those from `first` on follow all their neighbours.

        Parameters
        ----------
        neighbours : list of set of int
            Unknowns that share an equation with each.
        first : int
            Number of the first unknown whose diagonal entry is zero.
        """
        present = [set(x) for x in neighbours]
        left, order = set(range(len(present))), []
        columns: list[set[int]] = []
        while left:
            ready = (i for i in left if i < first or all(j >= first or j not in left for j in neighbours[i]))
            k = min(ready, key=lambda i: (len(present[i]), i))
            left.remove(k)
            order.append(k)
            columns.append(present[k])
            for i in present[k]:
                present[i] = (present[i] | present[k]) - {i, k}
        place = [0] * len(order)
        for position, unknown in enumerate(order):
            place[unknown] = position
        return cls(place, [sorted(place[i] for i in column) for column in columns])


def _entries(matrix: Any) -> list[tuple[int, int, Any]]:
    """Return row, column and value of the nonzero entries of a matrix of traced numbers."""
    rows = np.asarray(matrix).tolist()
    return [(i, j, x) for i, row in enumerate(rows) for j, x in enumerate(row) if isinstance(x, Traced) or x != 0.0]


def _integers(values: Any) -> Any:
    return np.array(list(values), dtype=np.int64)


def _floats(values: Any) -> Array:
    return np.array(list(values), dtype=np.float64)


@dataclass(frozen=True)
class Layout:
    """A scene as arrays, but for what depends on where a motion starts.

    Attributes
    ----------
    machine : Machine
        With signs for factors, without scales; its working memory is not to be used.
    entries : ndarray of int, shape (2, n)
        Unknowns to which the entries of the matrix belong, the coordinates and then the rows kept.
    order : ndarray of int, shape (N,)
        The unknowns by place.
    """

    machine: Machine
    entries: Any
    order: Any


def layout_of(system: System, kept: Sequence[int], free: Sequence[int], attitudes: Attitudes, energy: Energy) -> Layout:
    """Write the equations of a scene with the rows kept; the base rotations of some bodies are set later."""
    fused = Fused(system, free=free)
    n, traced = system.n_q, fused.traced
    rank, rows = len(kept), system.n_c
    mass, jacobian = _entries(traced.M), _entries(traced.J)
    unknown = {row: n + k for k, row in enumerate(kept)}
    matrix = [(i, j, x) for i, j, x in mass if i >= j]
    matrix += [(unknown[i], j, x) for i, j, x in jacobian if i in unknown]
    neighbours: list[set[int]] = [set() for _ in range(n + rank)]
    for i, j, _ in matrix:
        if i != j:
            neighbours[i].add(j)
            neighbours[j].add(i)
    elimination = Elimination.of(neighbours, n)
    place, columns = elimination.place, elimination.columns
    start = np.cumsum([0, *map(len, columns)])
    at = {(row, k): int(start[k]) + i for k, column in enumerate(columns) for i, row in enumerate(column)}
    updates = [[at[j, i] for a, i in enumerate(column) for j in column[a + 1 :]] for column in columns]

    working = not energy.conservative
    power = [fused.traced_power(energy.working, energy.damped)] if working else []
    right = [*traced.F0.tolist(), *traced.B[list(kept)].tolist()]
    residuals = [*traced.E.tolist(), *traced.V.tolist()]
    groups = [
        [*(x for *_, x in matrix), *right, *power],
        [*(x for *_, x in mass), *(x for *_, x in jacobian), *residuals],
    ]
    code = fused.code(groups)
    results = iter(code.results)

    def registers(count: int) -> tuple[Any, Array]:
        found = [next(results) for _ in range(count)]
        return _integers(r for r, _ in found), _floats(-1.0 if minus else 1.0 for _, minus in found)

    entry, entry_sign = registers(len(matrix))
    right_register, right_sign = registers(n + rank)
    (power_register,), (power_sign,) = registers(1) if working else ([-1], [0.0])
    mass_register, mass_sign = registers(len(mass))
    jacobian_register, jacobian_sign = registers(len(jacobian))
    residual_register, residual_sign = registers(2 * rows)

    order = np.argsort(place)
    shift = np.where(np.arange(n + rank) < n, DELTA, -DELTA)
    places = [(place[i], place[j]) for i, j, _ in matrix]
    base = code.inputs + len(code.constants)
    w = np.zeros(base + len(code.operands))
    w[code.inputs : base] = code.constants
    tables = {
        "run_operation": [operation for operation, _ in code.runs],
        "run_start": [0, *(end for _, end in code.runs)],
        "first": [x for x, _ in code.operands],
        "second": [x for _, x in code.operands],
        "ends": code.ends,
        "w": w,
        "entry_register": entry,
        "entry_factor": entry_sign,
        "entry_row": [max(pair) for pair in places],
        "entry_column": [min(pair) for pair in places],
        "entry_target": [-1 if i == j else at[max(i, j), min(i, j)] for i, j in places],
        "entry_value": np.zeros(len(matrix)),
        "right_register": right_register[order],
        "right_factor": -right_sign[order],
        "shift": shift[order],
        "column_start": start,
        "lower_row": [row for column in columns for row in column],
        "lower": np.zeros(int(start[-1])),
        "update_start": np.cumsum([0, *map(len, updates)]),
        "update_target": [target for column in updates for target in column],
        **{name: np.zeros(n + rank) for name in ("diagonal", "b", "x", "dx", "right")},
        "place": place[:n],
        "row_place": [place[unknown[i]] if i in unknown else -1 for i in range(rows)],
        "jacobian_row": [i for i, _, _ in jacobian],
        "jacobian_column": [j for _, j, _ in jacobian],
        "jacobian_register": jacobian_register,
        "jacobian_sign": jacobian_sign,
        "mass_row": [i for i, _, _ in mass],
        "mass_column": [j for _, j, _ in mass],
        "mass_register": mass_register,
        "mass_sign": mass_sign,
        "residual_register": residual_register,
        "residual_sign": residual_sign,
        "left": np.where(shift[order] < 0.0, 1.0 / np.sqrt(max(rank, 1)), 0.0),
        "reach": np.zeros(rows),
        "best": np.zeros(2 * n),
        "scale": np.zeros(n),
        "row_scale": np.zeros(rows),
        "sizes": np.zeros(n),
        "angle": [part.start + 1 for _, part in attitudes.parts],
        "least_cosine": [
            REFERENCE.euler_cosine_pinned if i in attitudes.pinned else REFERENCE.euler_cosine_chart_left
            for i, _ in attitudes.parts
        ],
        "pinned": [i in attitudes.pinned for i, _ in attitudes.parts],
    }
    numbers = {
        "coordinates": n,
        "rows": rows,
        "holonomic": system.n_h,
        "base": base,
        "power_register": int(power_register),
        "power_sign": float(power_sign),
        "driven": int(energy.driven),
        "projections": TOLERANCES.projection_steps,
        "projected": TOLERANCES.projection_residual,
        "accepted": TOLERANCES.projection_residual_failed,
        "slowest": 0.0,
    }
    entries = np.array([(i, j) for i, j, _ in matrix], dtype=np.int64).reshape(-1, 2).T
    return Layout(machine(tables, **numbers), entries, order)


def machine_of(equations: Constrained, free: Sequence[int], attitudes: Attitudes, energy: Energy) -> Machine:
    """Return a scene as arrays; the base rotations of some bodies are set later."""
    system, kept = equations.system, equations.kept
    key = (*kept, None, *free), energy
    layout = system.remember("layout", key, lambda: layout_of(system, kept, free, attitudes, energy))
    floats = layout.machine.floats.copy()
    found = layout.machine._replace(floats=floats, slowest=float(equations.slowest))
    factors = np.concatenate([equations.scale, equations.row_scale[kept]])
    table(found, "entry_factor")[:] *= factors[layout.entries[0]] * factors[layout.entries[1]]
    table(found, "right_factor")[:] *= factors[layout.order]
    for name in ("scale", "row_scale", "sizes"):
        table(found, name)[:] = getattr(equations, name)
    return found
