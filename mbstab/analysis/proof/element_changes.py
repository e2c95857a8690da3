"""How the elements of a scene change along a field, in balls and at random rational states."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np

from mbstab.analysis.algebra import ball_matrices, balls
from mbstab.analysis.algebra.arrays import RandomNumbers
from mbstab.analysis.algebra.balls import Ball, Matrix, NotProvable, ball, zero_inside
from mbstab.analysis.proof.enclosures import Reference
from mbstab.analysis.proof.fields import Map, along_direction, combined, turned
from mbstab.analysis.proof.krawczyk import independent_rows, krawczyk_boxes
from mbstab.analysis.proof.tolerances import TOLERANCES
from mbstab.analysis.reference.element_comparison import State as Rough
from mbstab.analysis.reference.fields import Field as Group
from mbstab.analysis.reference.fields import Symmetry
from mbstab.analysis.verdict.facts import Grounds
from mbstab.compiler.placed import Acting
from mbstab.compiler.system import Array
from mbstab.errors import MbstabError
from mbstab.records import dataclass

Finding = Literal["structural", "enclosed", "open", "refuted"]
"""``open``: not verified; ``refuted``: proven to be wrong."""

UNVERIFIED = (MbstabError, ArithmeticError, ValueError)
"""Errors of a state that cannot be enclosed."""


@dataclass(frozen=True)
class State:
    """Coordinates, speeds and accelerations in balls."""

    q: list[Ball]
    u: list[Ball]
    a: list[Ball]


class Local(NamedTuple):
    """A field at a state: Y, DY, DY u, and DY a + D²Y[u, u]."""

    Y: list[Ball]
    slope: Matrix
    rate: list[Ball]
    growth: list[Ball]


class ElementChanges:
    """How the elements of a scene change along a field, at random rational states."""

    def __init__(self, reference: Reference, grounds: Grounds) -> None:
        self.reference, self.grounds = reference, grounds
        self.invariance, self.work = grounds.invariance, grounds.structure.work
        self.system, self.time = reference.system, reference.time
        self.elements = self.system.acting()
        self.f = balls.ball_arithmetic()
        self._found: dict[str, Finding] = {}
        self._locals: dict[tuple[str, int], Local] = {}

    @cached_property
    def states(self) -> list[State]:
        """States off the constraints: those of double precision, taken as exact, and one close to the reference."""
        motion, rough = self.invariance.motion, self.invariance.states
        if not rough:
            return []
        last = rough[-1]
        close = Rough(motion.q + TOLERANCES.close_states * (last.q - motion.q), last.u, last.a)
        return [State(_exact(x.q), _exact(x.u), _exact(x.a)) for x in (*rough, close)]

    @cached_property
    def on_rows(self) -> list[State]:
        """Enclosures of states that satisfy the constraints."""
        if not self.system.n_c:
            return self.states
        found, motion = [], self.invariance.motion
        for rough in self.invariance.on_rows[1:]:
            for part in (1.0, TOLERANCES.close_states):
                q = motion.q + part * (rough.q - motion.q)
                try:
                    found.append(self._closed(Rough(q, rough.u, rough.a)))
                except (*UNVERIFIED, np.linalg.LinAlgError):
                    continue
        return found

    def _closed(self, rough: Rough) -> State:
        """Return a state near a rough one that is proven to satisfy the constraints."""
        reference, motion, start = self.reference, self.invariance.motion, _exact(rough.q)
        still, what = [ball(0)] * len(start), "a state on the constraints"
        holonomic = reference.rows[: reference.r_h]
        q = self._on(holonomic, start, lambda x: self.system.closing.dynamics(x, still, self.time), "E", what)
        u = self._on(reference.rows, _exact(rough.u), lambda x: self.system.dynamics(q, x, self.time), "V", what)
        rng = RandomNumbers(17)
        a = _exact(self.invariance.rate**2 * motion.sizes * rng.uniform(-1.0, 1.0, len(start)))
        return State(q, u, self._accelerated(q, u, a))

    def _on(
        self, rows: list[int], start: list[Ball], dynamics: Callable[[list[Ball]], Any], level: str, what: str
    ) -> list[Ball]:
        """Return coordinates or speeds near a start that satisfy rows, which may be nonlinear in them."""

        def put(x: Sequence[Ball]) -> list[Ball]:
            moved = start[:]
            for i, value in zip(columns, x, strict=True):
                moved[i] = value
            return moved

        def residual(x: Sequence[Ball]) -> list[Ball]:
            values = ball_matrices.vector(getattr(dynamics(put(x)), level))
            return [values[i] for i in rows]

        def jacobian(x: Sequence[Ball]) -> Matrix:
            J = ball_matrices.matrix(dynamics(put(x)).J)
            return [[J[i][j] for j in columns] for i in rows]

        columns = self._determined(dynamics(start).J, rows)
        return put(krawczyk_boxes(residual, jacobian, [start[i] for i in columns], what)[0])

    def _accelerated(self, q: list[Ball], u: list[Ball], start: list[Ball]) -> list[Ball]:
        """Return accelerations near a start that satisfy all rows."""
        at = self.system.dynamics(q, u, self.time)
        J, B = ([ball_matrices.matrix(at.J)[i] for i in self.reference.rows], ball_matrices.vector(at.B))
        columns = self._determined(at.J, self.reference.rows)
        found = [ball(0) if i in columns else x for i, x in enumerate(start)]
        slack = [[-x - B[i]] for i, x in zip(self.reference.rows, ball_matrices.apply(J, found), strict=True)]
        for i, (x,) in zip(columns, ball_matrices.solve([[row[j] for j in columns] for row in J], slack), strict=True):
            found[i] = x
        return found

    def _determined(self, J: Any, rows: list[int]) -> list[int]:
        """Return coordinates that rows determine from the others."""
        return independent_rows((_middle(J)[rows] * self.invariance.motion.sizes).T, len(rows))

    def field(self, name: str, group: Group | None, reference: Reference) -> Map:
        """Return Y(q) for jets of balls; without a group that of the motion itself."""
        if group is None or name == "the motion itself":
            return lambda q: turned(reference.state.field, q)
        return combined(group, reference)

    def local(self, name: str, group: Group | None, state: State) -> Local:
        """Return a field and its derivatives at one of the states."""
        key = name, id(state)
        if key not in self._locals:
            self._locals[key] = self._local(self.field(name, group, self.reference), state)
        return self._locals[key]

    def _local(self, Y: Map, state: State) -> Local:
        n, slices = self.system.n_q, self.system.body_slices
        slope = ball_matrices.zeros(n, n)
        # The change of a body along a field depends on the coordinates of that body only.
        for k in range(max(part.stop - part.start for part in slices)):
            columns = {part.start + k: part for part in slices if part.start + k < part.stop}
            found = along_direction(Y, state.q, [ball(int(j in columns)) for j in range(n)])
            for j, part in columns.items():
                for i in range(part.start, part.stop):
                    slope[i][j] = ball(found[i].rate)
        moved = along_direction(Y, state.q, state.u)
        growth = [x + ball(y.second) for x, y in zip(ball_matrices.apply(slope, state.a), moved, strict=True)]
        return Local([ball(x.value) for x in moved], slope, [ball(x.rate) for x in moved], growth)

    def disturbance(self, item: Symmetry, reference: Reference) -> tuple[list[Ball], list[Ball]]:
        """Return the changes of the coordinates and speeds of a reference under a symmetry."""
        state = reference.state
        found = along_direction(self.field(item.name, item.of, reference), state.q, state.u)
        return [ball(x.value) for x in found], [ball(x.rate) for x in found]

    def _change(self, element: Acting, at: Local, state: State) -> tuple[list[Ball], Ball]:
        """Return the change of the force of an element along a field, and the sum of the sizes of its terms."""
        columns, n = element.columns, self.system.n_q
        arguments = (state.q, state.u, state.a, self.time, self.f)
        K, R = element.slopes(*arguments)
        force = [ball(x) for x in element.force(*arguments)]
        result = [ball(0)] * n
        size = sum_of(force) + sum_of(x for row in K for x in row) * sum_of(at.Y)
        size = size + sum_of(x for row in R for x in row) * sum_of(at.rate)
        terms: list[tuple[int, Ball]] = []
        for k, i in enumerate(columns):
            for m, j in enumerate(columns):
                terms += [(i, ball(K[k][m]) * at.Y[j]), (i, ball(R[k][m]) * at.rate[j])]
            terms += [(j, at.slope[i][j] * force[k]) for j in range(n) if not at.slope[i][j].is_zero()]
        if element.inertia and any(not x.is_zero() for x in at.growth):
            faster = [x + y for x, y in zip(state.a, at.growth, strict=True)]
            more = element.force(state.q, state.u, faster, self.time, self.f)
            for i, x, y in zip(columns, more, force, strict=True):
                terms += [(i, ball(x)), (i, -y)]
        for i, x in terms:
            result[i], size = result[i] + x, size + abs(x)
        return result, size

    def _allowed(self, state: State) -> Matrix:
        """Return admissible directions, as columns."""
        rows, n = self.reference.rows, self.system.n_q
        J = ball_matrices.matrix(self.system.dynamics(state.q, state.u, self.time).J)
        pivots, T = ball_matrices.eliminate(
            [J[i] for i in rows], len(rows), n, None, self.invariance.motion.sizes.tolist()
        )
        return ball_matrices.null_space(pivots, T, n)[1]

    def _needed_on_rows(self) -> list[State]:
        if self.system.n_c and not self.on_rows:
            raise NotProvable("no state on the constraints is enclosed")
        return self.on_rows if self.system.n_c else []

    def _rows_change(self, at: Local, state: State, Y: Sequence[Ball]) -> Finding:
        """Return whether holonomic rows are constant along Y, and nonholonomic ones along (Y, DY u)."""
        rows, r_h = self.reference.rows, self.reference.r_h
        J = ball_matrices.matrix(self.system.dynamics(state.q, state.u, self.time).J)
        V_q = ball_matrices.matrix(self.system.linearize_rows(state.q, state.u, state.a, self.time)[0])
        found: list[Finding] = []
        for k, i in enumerate(rows):
            if k < r_h:
                found.append(is_zero(dot(J[i], Y), sum_of(J[i]) * sum_of(Y)))
                continue
            size = sum_of(V_q[i]) * sum_of(at.Y) + sum_of(J[i]) * sum_of(at.rate)
            found.append(is_zero(dot(V_q[i], at.Y) + dot(J[i], at.rate), size))
        return least(found)

    def _satisfied(self, state: State, u: Sequence[Ball], rows: Sequence[int]) -> Finding:
        """Return whether speeds satisfy rows at a position."""
        dynamics = self.system.dynamics(state.q, u, self.time)
        V, J = ball_matrices.vector(dynamics.V), ball_matrices.matrix(dynamics.J)
        size = sum_of(u) + sum_of(state.u)
        return least([is_zero(V[i], sum_of(J[i]) * size) for i in rows])


def is_zero(x: Ball, size: Ball) -> Finding:
    """Return whether a ball vanishes, relative to a size."""
    if x.is_zero():
        return "structural"
    if tiny(x, size):
        return "enclosed"
    return "open" if zero_inside(x) else "refuted"


def dot(x: Sequence[Ball], y: Sequence[Ball]) -> Ball:
    """Return the scalar product."""
    return sum((a * b for a, b in zip(x, y, strict=True)), ball(0))


def sum_of(entries: Iterable[Any]) -> Ball:
    """Return the sum of sizes."""
    return sum((abs(ball(x)) for x in entries), ball(0))


def least(found: Sequence[Finding]) -> Finding:
    """Return the weakest of several findings."""
    order: tuple[Finding, ...] = ("refuted", "open", "enclosed", "structural")
    return min(found, key=order.index, default="structural")


def _exact(x: Array) -> list[Ball]:
    return [ball(value) for value in x.tolist()]


def _middle(J: Any) -> Array:
    return np.array([[float(x) for x in row] for row in J])


def tiny(x: Ball, size: Ball) -> bool:
    """Return whether a ball contains zero and is smaller than a size by half of the digits in use."""
    if x.is_zero():
        return True
    return zero_inside(x) and bool(x.abs_upper() <= balls.half_digits() * size.abs_upper())
