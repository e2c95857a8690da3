"""Candidates for symmetries of a scene: shifts and rotations that its elements and axes suggest."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction
from functools import cached_property
from typing import Any

import numpy as np

from mbstab.analysis.algebra.sparse import bordered, largest, row_norms, scaled
from mbstab.analysis.algebra.tolerances import EPS
from mbstab.analysis.algebra.tolerances import TOLERANCES as ALGEBRA
from mbstab.analysis.reference.element_comparison import (
    ElementComparison,
)
from mbstab.analysis.reference.fields import Field, OwnTurn, Shift, Spin, Turn
from mbstab.analysis.reference.steady import Generator, axis_text, through
from mbstab.analysis.reference.tolerances import TOLERANCES
from mbstab.compiler.system import Array
from mbstab.mechanics.catalogue import GROUND
from mbstab.model.schema import is_state

UNEVEN = 5661 / 4096
"""Steps are this times a power of two."""


class SymmetryCandidates(ElementComparison):
    """Candidates for symmetries of a scene."""

    def _candidates(self) -> Iterator[tuple[str, Field]]:
        """Yield the groups worth trying, the simplest first."""
        if not self.isolated:
            yield from self._shifts()
        system = self.system
        for name, axis, point in self._axes():
            plain = Generator(system, axis, point, 1.0, np.zeros(3), np.zeros(system.n_q))
            yield name, Turn(replace(plain, spins=self._carried_states(plain)), TOLERANCES.trial_move)
        for body, part in zip(system.scene.bodies, system.body_slices, strict=True):
            if not body.orientation:
                continue
            if system.scene.dimension == 2:
                if any(body.center):
                    center = np.array([float(x) for x in body.center[:2]])
                    yield system.names[part.stop - 1], OwnTurn(part, center)
                continue
            for axis in _own_axes(body):
                words = axis_text(axis)
                yield f"turn of {body.name} about its axis {words}", Spin(body, part, axis)

    def _carried_states(self, generator: Generator) -> Array:
        """Return the rates of first-order states that go with a turn, so that their rows do not change."""
        system, found = self.system, np.zeros(self.system.n_q)
        columns, rows = system.states
        if system.sparse or not len(columns):
            return found
        blocks, changes, sizes = [], [], self.motion.sizes[columns]
        for state in self.on_rows:
            V_q = system.linearize_rows(state.q, state.u, state.a, self.motion.time)[0][rows]
            moved, turned, J = generator.field(state.q), generator.slope(state.q) @ state.u, state.dynamics.J[rows]
            change = V_q @ moved + J @ turned
            rounding = TOLERANCES.roundings_of_comparison * EPS * (abs(V_q) @ abs(moved) + abs(J) @ abs(turned))
            blocks.append(V_q[:, columns] * sizes)
            changes.append(np.where(np.abs(change) > rounding, change, 0.0))
        rates = -np.linalg.pinv(np.vstack(blocks), rcond=TOLERANCES.independent_fields) @ np.concatenate(changes)
        rates = np.where(np.abs(rates) > 1e-12 * np.max(np.abs(rates)), rates, 0.0) * sizes
        found[columns] = in_whole_numbers(rates)
        return found

    def _shifts(self) -> Iterator[tuple[str, Field]]:
        """Yield constant shifts that do not change the equations at the reference: named ones, then combinations."""
        system, sizes = self.system, self.motion.sizes
        null = self._blind()
        room, count = np.zeros((system.n_q + 1, system.n_q)), 0
        for name, direction in self._named_shifts(null):
            scaled = direction / sizes / np.linalg.norm(direction / sizes)
            rest = scaled - room[:count].T @ (room[:count] @ scaled)
            if np.linalg.norm(rest) > 1e-6:
                room[count] = rest / np.linalg.norm(rest)
                count += 1
                yield name, self._shift(direction)
        basis = room[:count]
        left, s, _ = np.linalg.svd(null - basis.T @ (basis @ null), full_matrices=False)
        for direction in echelon(left.T[: int(np.sum(s > 1e-6))] * sizes):
            strong = self._strongest(direction)
            yield (
                "common shift of " + ", ".join([*strong[:4], *["…"] * (len(strong) > 4)]),
                self._shift(self._refined(direction)),
            )

    def _strongest(self, direction: Array) -> list[str]:
        """Return the coordinates that a shift moves most; only those of one unit are compared."""
        model, moved = self.system.scene.model, np.abs(direction)
        moved = np.where(moved / self.motion.sizes > 1e-9 * np.max(moved / self.motion.sizes), moved, 0.0)
        units = np.array([model.unit_of(name) for name in self.system.names])
        most = np.array([np.max(moved, where=units == unit, initial=0.0) for unit in units])
        return [name for name, x, least in zip(self.system.names, moved, 0.3 * most, strict=True) if x > least]

    def _refined(self, direction: Array) -> Array:
        """Return a shift with its small entries as exact as its large ones.

        In a basis from singular values all entries have the same absolute error.
        """
        if self.system.sparse or np.array_equal(direction, np.round(direction)):
            return direction
        sizes, pivot = self.motion.sizes, int(np.argmax(np.abs(direction)))
        x = direction / sizes
        x = x - np.linalg.pinv(self._changes_by_shifts, rcond=1e-8) @ (self._changes_by_shifts @ x)
        x = np.where(direction != 0.0, x, 0.0) * sizes
        result: Array = x * (direction[pivot] / x[pivot])
        return result

    def _shift(self, direction: Array) -> Shift:
        """Return the shift along a direction by a noticeable step."""
        step = TOLERANCES.trial_move * float(
            np.min(self.motion.sizes[direction != 0.0] / np.abs(direction[direction != 0.0]))
        )
        return Shift(direction, short(step))

    def _named_shifts(self, null: Array) -> Iterator[tuple[str, Array]]:
        """Yield the shifts of everything along an axis, and of single coordinates, that lie in a space of shifts."""
        names, sizes = self.system.names, self.motion.sizes

        def inside(direction: Array) -> bool:
            scaled = direction / sizes / np.linalg.norm(direction / sizes)
            return bool(np.linalg.norm(scaled - null @ (null.T @ scaled)) < 1e-7)

        if len(names) < ALGEBRA.sparse_derivatives_from:
            single = np.linalg.norm(np.eye(len(names)) - null @ null.T, axis=0) < 1e-7
        else:
            single = 1.0 - np.sum(null * null, axis=1) < 1e-13
        for axis in "xyz":
            along = np.array([name.endswith(f".{axis}") for name in names])
            # Where each coordinate may be shifted by itself, the shift of all together says less.
            if np.sum(along) > 1 and not np.all(single[along]) and inside(along.astype(float)):
                yield f"translation along {axis}", along.astype(float)
        for i in np.flatnonzero(single):
            direction = np.zeros(len(names))
            direction[i] = 1.0
            yield f"state {names[i]}" if is_state(names[i]) else names[i], direction

    def _blind(self) -> Array:
        """Return constant shifts that change neither forces nor rows at some states, as orthonormal columns."""
        if self.system.sparse:
            return self._blind_in_large()
        _, s, right = np.linalg.svd(self._changes_by_shifts)
        result: Array = right[int(np.sum(s > 1e-8 * max(1.0, np.max(s, initial=0.0)))) :].T
        return result

    @cached_property
    def _changes_by_shifts(self) -> Array:
        """Changes of forces and rows of constraints at some states by constant shifts, as rows of unit length."""
        system, sizes = self.system, self.motion.sizes
        blocks = [np.zeros((0, system.n_q))]
        for state in self.on_rows:
            dynamics, still = state.dynamics, np.zeros(system.n_c)
            K, _, D_q = system.linearize(state.q, state.u, state.a, still, self.motion.time)
            rows = np.vstack([dynamics.J[: system.n_h], D_q]) * sizes
            blocks.append(rows[np.linalg.norm(rows, axis=1) > 0.0])
            # Forces along the rows only are balanced by reactions.
            J = dynamics.J * sizes
            J = J[np.linalg.norm(J, axis=1) > 0.0]
            J = J / np.linalg.norm(J, axis=1)[:, None]
            forces = (K * sizes) * sizes[:, None]
            if len(J):
                forces = forces - np.linalg.pinv(J, rcond=1e-10) @ (J @ forces)
            lengths = np.linalg.norm(forces, axis=1)
            total = float(np.max(np.abs(K * sizes * sizes[:, None]), initial=0.0))
            blocks.append(forces[lengths > 1e-9 * total])
        stacked = np.vstack(blocks)
        result: Array = stacked / np.linalg.norm(stacked, axis=1)[:, None]
        return result

    def _blind_in_large(self) -> Array:
        """Return the same for a large scene: shifts that do not change the rows, nor the forces along such shifts.

        Where the rows leave very many directions, forces that reactions balance count as well.
        """
        from scipy.sparse import vstack

        from mbstab.analysis.algebra.sparse_rank import Rows, sparse_null_space, with_unit_rows

        system, sizes = self.system, self.motion.sizes
        rows, forces, held = [], [], []
        for state in self.on_rows:
            dynamics = state.dynamics
            K, _, D_q = system.linearize(state.q, state.u, state.a, np.zeros(system.n_c), self.motion.time)
            rows.append(with_unit_rows(scaled(vstack([dynamics.J[: system.n_h], D_q], format="csr"), sizes)))
            force, strongest = scaled(K, sizes, sizes), largest(scaled(K, sizes, sizes))
            forces.append(force * (1.0 / strongest) if strongest else force)
            held.append(scaled(dynamics.J, sizes))
        blind = (
            sparse_null_space(vstack(rows, format="csr"), max(ALGEBRA.sparse_derivatives_from, system.n_q // 2))
            if system.n_c
            else None
        )
        if blind is None:
            blind = sparse_null_space(vstack([*rows, *forces], format="csr"), system.n_q)
            assert blind is not None
            return blind
        pushes = []
        if not blind.shape[1]:
            return blind
        for force, J in zip(forces, held, strict=True):
            push, lengths = force @ blind, row_norms(J)
            pushes.append(Rows(scaled(J, np.ones(system.n_q), 1.0 / lengths)[self._kept_rows]).allowed(push))
        _, s, right = np.linalg.svd(np.vstack(pushes), full_matrices=False)
        result: Array = blind @ right[int(np.sum(s > 1e-8)) :].T
        return result

    @property
    def _kept_rows(self) -> list[int]:
        redundant = {id(item.row) for item in self.motion.redundant}
        return [i for i, row in enumerate(self.system.rows) if id(row) not in redundant]

    @cached_property
    def isolated(self) -> bool:
        """Whether the reference rests where there is no other rest beside it, to first order."""
        motion, system, sizes = self.motion, self.system, self.motion.sizes
        if not motion.at_rest or motion.massless is not None or system.n_n or system.scene.timed:
            return False
        K = scaled(self.slopes_there[0], sizes, sizes)
        strongest = largest(K)
        if not strongest:
            return False
        J = scaled(motion.dynamics.J, sizes)
        J = scaled(J, np.ones(system.n_q), 1.0 / row_norms(J))[self._kept_rows]
        K = K * (1.0 / strongest)
        if not system.sparse:
            whole = np.block([[K, J.T], [J, np.zeros((len(J), len(J)))]])
            return float(np.min(np.linalg.svd(whole, compute_uv=False))) > TOLERANCES.shift_felt
        from mbstab.analysis.algebra.sparse_rank import least_singular_value

        return least_singular_value(bordered(K, J)) > TOLERANCES.shift_felt

    def _axes(self) -> Iterator[tuple[str, Array, Array]]:
        """Yield the rotations worth trying: name, axis and a point on it."""
        scene, origin = self.system.scene, np.zeros(3)
        gravity = np.array([float(x) for x in scene.gravity])
        up = None
        if scene.dimension == 2:
            if np.any(gravity):
                return
            axes = [("rotation in the plane", np.array([0.0, 0.0, 1.0]))]
        elif np.any(gravity):
            up = -gravity / np.linalg.norm(gravity)
            k = int(np.argmax(np.abs(up)))
            axes = [(f"rotation about {'xyz'[k]}" if abs(up[k]) > 1.0 - 1e-12 else "rotation about the vertical", up)]
        else:
            axes = [(f"rotation about {name}", np.eye(3)[i]) for i, name in enumerate("xyz")]
            for axis in self._ground_axes():
                if all(np.linalg.norm(np.cross(axis, other)) > 1e-9 for _, other in axes):
                    axes.append((f"rotation about {axis_text(axis)}", axis))
        own = [(g.axis, g.point) for g in self.motion.generators if g.turns]
        for axis, _ in own:
            if up is None and all(np.linalg.norm(np.cross(axis, other)) > 1e-9 for _, other in axes):
                axes.append((f"rotation about {axis_text(axis)}", axis))
        points = [origin, *(point for _, point in own), *self._ground_points()]
        for name, axis in axes:
            seen: list[Array] = []
            for point in points:
                across = point - axis * (axis @ point)
                if all(np.linalg.norm(across - other) > 1e-12 * (1.0 + np.linalg.norm(other)) for other in seen):
                    seen.append(across)
                    yield name + through(across), axis, across

    def _ground_points(self) -> list[Array]:
        """Return points fixed in the ground at which something is attached."""
        d, found = self.system.scene.dimension, list[Array]()
        for item in self.system.scene.items:
            if item.given("between"):
                for marker in item.markers("between"):
                    if marker.body == GROUND:
                        point = np.zeros(3)
                        point[:d] = [float(x) for x in marker.point]
                        found.append(point)
        return found[: TOLERANCES.trial_centres]

    def _ground_axes(self) -> list[Array]:
        """Return the axes of joints with the ground."""
        found = []
        for item in self.system.scene.items:
            if item.entry.section == "joints" and item.given("axis"):
                sides = zip(item.markers("between"), item.triads("axis", "zero"), strict=True)
                found += [np.array([float(x) for x in triad.v1]) for marker, triad in sides if marker.body == GROUND]
        return found[: TOLERANCES.trial_centres]


def _own_axes(body: Any) -> list[Array]:
    """Return axes of symmetry of the inertia of a body, through its reference point, apart from z."""
    xx, yy, zz, xy, xz, yz = (float(x) for x in body.inertia)
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    moments, axes = np.linalg.eigh(tensor)
    size = float(np.max(np.abs(moments))) or 1.0
    center = np.array([float(x) for x in body.center])
    if moments[2] - moments[0] < 1e-12 * size:
        found = list(np.eye(3)) if not np.any(center) else [center / np.linalg.norm(center)]
    elif moments[1] - moments[0] < 1e-12 * size:
        found = [axes[:, 2]]
    elif moments[2] - moments[1] < 1e-12 * size:
        found = [axes[:, 0]]
    else:
        return []
    found = [np.where(np.abs(x) > 1e-13, x, 0.0) for x in found]
    # A turn about z is a shift of the last Euler angle.
    return [x for x in found if abs(abs(x[2]) - 1.0) > 1e-12 and not np.any(np.cross(x, center))]


def short(step: float) -> float:
    """Return a step of about a size with few digits, so that sums are exact, but unlikely as a number of a model.

    A step of twice its length would move a spring to the other side of its end, where its force is the same.
    """
    return UNEVEN * 2.0 ** math.floor(math.log2(step))


def echelon(rows: Array) -> list[Array]:
    """Return the reduced echelon form of the span of rows, in whole numbers where possible.

    Expressions are compared with many digits: a direction with 16 digits is too inexact for them.
    """
    A = rows.copy()
    free = np.ones(A.shape[1])
    for k in range(len(A)):
        pivot = int(np.argmax(np.where(free, np.max(np.abs(A[k:]), axis=0), -1.0)))
        best = k + int(np.argmax(np.abs(A[k:, pivot])))
        A[[k, best]] = A[[best, k]]
        A[k] /= A[k, pivot]
        others = np.flatnonzero(A[:, pivot])
        others = others[others != k]
        A[others] -= A[others, pivot, None] * A[k]
        free[pivot] = 0.0
    return [in_whole_numbers(np.where(np.abs(row) > 1e-12, row, 0.0)) for row in A]


def in_whole_numbers(direction: Array) -> Array:
    """Return a multiple of a direction in whole numbers, if the ratios of its entries are small fractions."""
    if np.array_equal(direction, np.round(direction)):
        return direction
    parts = [Fraction(float(x)).limit_denominator(TOLERANCES.shift_denominator) for x in direction]
    if any(abs(float(part) - x) > 1e-12 for part, x in zip(parts, direction, strict=True)):
        return direction
    common = math.lcm(*(part.denominator for part in parts))
    return np.array([float(part * common) for part in parts])
