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
from mbstab.compiler.machine import tables
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
    parts : ndarray of int, shape (2, n)
        The same of the parts of Newton matrices.
    order : ndarray of int, shape (N,)
        The unknowns by place.
    """

    machine: Machine
    entries: Any
    parts: Any
    order: Any


def _newton_parts(fused: Fused, unknown: dict[int, int]) -> list[tuple[int, int, int, Any]]:
    """Return kind, unknowns and value of the parts of Newton matrices; unknowns of rows by row."""
    K, R, V_q = fused.traced_derivatives
    traced, n_h = fused.traced, fused.system.n_h
    blocks = ((tables.MASS, traced.M), (tables.STIFFNESS, K), (tables.DAMPING, R))
    found = [(kind, i, j, x) for kind, block in blocks for i, j, x in _entries(block)]
    for i, j, x in _entries(traced.J):
        if i in unknown:
            own, back = (
                (tables.HOLONOMIC, tables.HOLONOMIC_FORCE)
                if i < n_h
                else (tables.NONHOLONOMIC, tables.NONHOLONOMIC_FORCE)
            )
            found += [(own, unknown[i], j, x), (back, j, unknown[i], x)]
    kinds = (tables.HOLONOMIC_RATE, tables.NONHOLONOMIC_RATE)
    return [*found, *((kinds[i >= n_h], unknown[i], j, x) for i, j, x in _entries(V_q) if i in unknown)]


def layout_of(
    system: System, kept: Sequence[int], free: Sequence[int], attitudes: Attitudes, energy: Energy, implicit: bool
) -> Layout:
    """Write the equations of a scene with the rows kept; the base rotations of some bodies are set later.

    For implicit methods, the parts of Newton matrices as well.
    """
    fused = Fused(system, free=free)
    n, traced = system.n_q, fused.traced
    rank, rows = len(kept), system.n_c
    mass, jacobian = _entries(traced.M), _entries(traced.J)
    unknown = {row: n + k for k, row in enumerate(kept)}
    matrix = [(i, j, x) for i, j, x in mass if i >= j]
    matrix += [(unknown[i], j, x) for i, j, x in jacobian if i in unknown]
    parts = _newton_parts(fused, unknown) if implicit else []
    neighbours: list[set[int]] = [set() for _ in range(n + rank)]
    for i, j in (*((i, j) for i, j, _ in matrix), *((i, j) for _, i, j, _ in parts)):
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
    if implicit:
        groups.append([x for *_, x in parts])
    code = fused.code(groups, implicit)
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
    part_register, part_sign = registers(len(parts))

    order = np.argsort(place)
    shift = np.where(np.arange(n + rank) < n, DELTA, -DELTA)
    places = [(place[i], place[j]) for i, j, _ in matrix]
    base = code.inputs + len(code.constants)
    w = np.zeros(base + len(code.operands))
    w[code.inputs : base] = code.constants
    arrays = {
        tables.RUN_OPERATION: [operation for operation, _ in code.runs],
        tables.RUN_START: [0, *(end for _, end in code.runs)],
        tables.FIRST: [x for x, _ in code.operands],
        tables.SECOND: [x for _, x in code.operands],
        tables.ENDS: code.ends,
        tables.W: w,
        tables.ENTRY_REGISTER: entry,
        tables.ENTRY_FACTOR: entry_sign,
        tables.ENTRY_ROW: [max(pair) for pair in places],
        tables.ENTRY_COLUMN: [min(pair) for pair in places],
        tables.ENTRY_TARGET: [-1 if i == j else at[max(i, j), min(i, j)] for i, j in places],
        tables.ENTRY_VALUE: np.zeros(len(matrix)),
        tables.RIGHT_REGISTER: right_register[order],
        tables.RIGHT_FACTOR: -right_sign[order],
        tables.SHIFT: shift[order],
        tables.COLUMN_START: start,
        tables.LOWER_ROW: [row for column in columns for row in column],
        tables.LOWER: np.zeros(int(start[-1])),
        tables.UPDATE_START: np.cumsum([0, *map(len, updates)]),
        tables.UPDATE_TARGET: [target for column in updates for target in column],
        **{k: np.zeros(n + rank) for k in (tables.DIAGONAL, tables.B, tables.X, tables.DX, tables.RIGHT)},
        tables.PLACE: place[:n],
        tables.ROW_PLACE: [place[unknown[i]] if i in unknown else -1 for i in range(rows)],
        tables.JACOBIAN_ROW: [i for i, _, _ in jacobian],
        tables.JACOBIAN_COLUMN: [j for _, j, _ in jacobian],
        tables.JACOBIAN_REGISTER: jacobian_register,
        tables.JACOBIAN_SIGN: jacobian_sign,
        tables.MASS_ROW: [i for i, _, _ in mass],
        tables.MASS_COLUMN: [j for _, j, _ in mass],
        tables.MASS_REGISTER: mass_register,
        tables.MASS_SIGN: mass_sign,
        tables.RESIDUAL_REGISTER: residual_register,
        tables.RESIDUAL_SIGN: residual_sign,
        tables.NEWTON_KIND: [kind for kind, *_ in parts],
        tables.NEWTON_REGISTER: part_register,
        tables.NEWTON_FACTOR: part_sign,
        tables.NEWTON_VALUE: np.zeros(len(parts)),
        tables.NEWTON_ROW: [place[i] for _, i, _, _ in parts],
        tables.NEWTON_COLUMN: [place[j] for _, _, j, _ in parts],
        tables.NEWTON_TARGET: [_newton_target(place[i], place[j], at, n + rank) for _, i, j, _ in parts],
        tables.LEFT: np.where(shift[order] < 0.0, 1.0 / np.sqrt(max(rank, 1)), 0.0),
        tables.REACH: np.zeros(rows),
        **{k: np.zeros(2 * n) for k in (tables.BEST, tables.Y, tables.BEFORE, tables.TRIAL, tables.INSIDE)},
        **{k: np.zeros(2 * n) for k in (tables.RATES, tables.OTHER)},
        **_memory(n, rows, len(place), int(start[-1]), implicit),
        tables.SCALE: np.zeros(n),
        tables.ROW_SCALE: np.zeros(rows),
        tables.SIZES: np.zeros(n),
        tables.ANGLE: [part.start + 1 for _, part in attitudes.parts],
        tables.LEAST_COSINE: [
            REFERENCE.euler_cosine_pinned if i in attitudes.pinned else REFERENCE.euler_cosine_chart_left
            for i, _ in attitudes.parts
        ],
        tables.PINNED: [i in attitudes.pinned for i, _ in attitudes.parts],
    }
    numbers = {
        "coordinates": n,
        "rows": rows,
        "holonomic": system.n_h,
        "base": base,
        "given": 2 * n + 1 + 9 * len(free),
        "power_register": int(power_register),
        "power_sign": float(power_sign),
        "driven": int(energy.driven),
        "projections": TOLERANCES.projection_steps,
        "projected": TOLERANCES.projection_residual,
        "accepted": TOLERANCES.projection_residual_failed,
        "slowest": 0.0,
    }
    entries = np.array([(i, j) for i, j, _ in matrix], dtype=np.int64).reshape(-1, 2).T
    both = np.array([(i, j) for _, i, j, _ in parts], dtype=np.int64).reshape(-1, 2).T
    return Layout(machine(arrays, **numbers), entries, both, order)


def _memory(n: int, rows: int, unknowns: int, below: int, implicit: bool) -> dict[int, Array]:
    """Return the working memory of implicit methods."""
    at, factors = tables, unknowns + 2 * below
    sizes = {k: n for k in (at.A, at.NEXT_A, at.JERK, at.DRIFT, at.PAST, at.AHEAD, at.CHANGE)}
    sizes |= {at.NU: rows, at.NEXT_NU: rows, at.KNOWN: 2 * n, at.NEWTON_C: at.KINDS, at.NEWTON_B: unknowns}
    sizes |= {at.NEWTON_LU: factors, at.GRAM: factors, at.REAL_E: unknowns, at.REAL_G: unknowns}
    sizes |= {at.STAGE_Y: 6 * n, at.STAGE_A: 3 * n, at.STAGE_NU: 3 * rows, at.STAGE_PULL: 3 * n}
    sizes |= {at.STAGE_B: 3 * unknowns, at.STAGE_E: 3 * unknowns, at.STEP_A: 3 * n, at.STEP_PULL: 3 * n}
    sizes |= {at.LAST_A: 3 * n, at.LAST_NU: 3 * rows, at.COMPLEX_C: 2 * at.KINDS, at.COMPLEX_LU: 2 * factors}
    sizes |= {k: 2 * unknowns for k in (at.COMPLEX_B, at.COMPLEX_E, at.COMPLEX_G)}
    return {k: np.zeros(size if implicit else 0) for k, size in sizes.items()}


def _newton_target(i: int, j: int, at: dict[tuple[int, int], int], count: int) -> int:
    """Return the place of an entry in a factored matrix: the diagonal, columns below it, rows beside it."""
    return i if i == j else count + at[i, j] if i > j else count + len(at) + at[j, i]


def machine_of(
    equations: Constrained, free: Sequence[int], attitudes: Attitudes, energy: Energy, implicit: bool = False
) -> Machine:
    """Return a scene as arrays; the base rotations of some bodies are set later."""
    system, kept = equations.system, equations.kept
    key = (*kept, None, *free), energy, implicit
    layout = system.remember("layout", key, lambda: layout_of(system, kept, free, attitudes, energy, implicit))
    floats = layout.machine.floats.copy()
    found = layout.machine._replace(floats=floats, slowest=float(equations.slowest))
    factors = np.concatenate([equations.scale, equations.row_scale[kept]])
    table(found, tables.ENTRY_FACTOR)[:] *= factors[layout.entries[0]] * factors[layout.entries[1]]
    table(found, tables.NEWTON_FACTOR)[:] *= factors[layout.parts[0]] * factors[layout.parts[1]]
    table(found, tables.RIGHT_FACTOR)[:] *= factors[layout.order]
    table(found, tables.SCALE)[:], table(found, tables.ROW_SCALE)[:] = equations.scale, equations.row_scale
    table(found, tables.SIZES)[:] = equations.sizes
    return found
