"""What a scene is invariant under and what it conserves, as identities in balls.

`mbstab.analysis.reference.symmetries` and `mbstab.analysis.linear.work` find symmetries, conserved functions and the
work of the elements in double precision. Here each of them is verified again, infinitesimally and
element by element, at random rational states with the digits of a proof: what an element does
changes along a field Y by Dᵀ(Y) F + ∂F/∂q Y + ∂F/∂u Ẏ + M Ÿ, and that has to enclose zero and be
smaller than half of the digits. An identity between analytic functions that holds at random states
holds everywhere (Schwartz 1980 for polynomials). One of the states lies close to the reference, in
the same piece of functions that are made of pieces.

What an element does not contain at all is structure and needs no states.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np

from mbstab.analysis.algebra import balls
from mbstab.analysis.algebra.balls import Ball, Matrix, NotProvable, ball, zero_inside
from mbstab.analysis.linear.facts import Grounds
from mbstab.analysis.proof.enclosures import Field, Reference, independent_rows, krawczyk_boxes
from mbstab.analysis.reference.steady import Generator
from mbstab.analysis.reference.symmetries import Field as Group
from mbstab.analysis.reference.symmetries import OwnTurn, Shift, Spin, Symmetry, Turn
from mbstab.analysis.reference.symmetries import State as Rough
from mbstab.compiler.system import Acting, Array, System
from mbstab.errors import MbstabError
from mbstab.mechanics.catalogue import GROUND
from mbstab.model.jets import Jet, jet_arithmetic

Finding = Literal["structural", "enclosed", "open", "refuted"]
"""``open``: not verified; ``refuted``: proven to be wrong."""

CLOSE = 2.0**-10
"""How far from the reference the close states are, relative to the others."""

SHORT = 10**6
"""A float that is next to a fraction with no larger denominator stands for it …"""

NEXT = 1e-15
"""… if it differs by no more than this, relative to its size."""

NEAR = 1e-9
"""Points in double precision and in balls that are closer than this (m) are the same."""

UNVERIFIED = (MbstabError, ArithmeticError, ValueError)
"""What a state without an enclosure ends with."""


@dataclass(frozen=True)
class State:
    """Coordinates, speeds and accelerations in balls."""

    q: list[Ball]
    u: list[Ball]
    a: list[Ball]


Map = Callable[[Sequence[Jet]], list[Jet]]
"""A field, for jets of balls."""


class Local(NamedTuple):
    """A field at a state: Y, DY, DY u, and DY a + D²Y[u, u]."""

    Y: list[Ball]
    slope: Matrix
    rate: list[Ball]
    growth: list[Ball]


class Identities:
    """What is proven about the elements of a scene.

    Parameters
    ----------
    reference : Reference
        At exact values of all parameters.
    grounds : Grounds
        What double precision has found.
    """

    def __init__(self, reference: Reference, grounds: Grounds) -> None:
        self.reference, self.grounds = reference, grounds
        self.invariance, self.work = grounds.invariance, grounds.structure.work
        self.system, self.time = reference.system, reference.time
        self.elements = self.system.acting()
        self.f = balls.ball_arithmetic()
        self._found: dict[str, Finding] = {}
        self._locals: dict[tuple[str, int], Local] = {}

    # --- states -----------------------------------------------------------------------------------------------------

    @cached_property
    def states(self) -> list[State]:
        """States off the constraints: those of double precision as they are written, and one close to the reference."""
        motion, rough = self.invariance.motion, self.invariance.states
        if not rough:
            return []
        last = rough[-1]
        close = Rough(motion.q + CLOSE * (last.q - motion.q), last.u, last.a)
        return [State(_exact(x.q), _exact(x.u), _exact(x.a)) for x in (*rough, close)]

    @cached_property
    def on_rows(self) -> list[State]:
        """Enclosures of states that satisfy the constraints."""
        if not self.system.n_c:
            return self.states
        found, motion = [], self.invariance.motion
        for rough in self.invariance.on_rows[1:]:
            for part in (1.0, CLOSE):
                q = motion.q + part * (rough.q - motion.q)
                try:
                    found.append(self._closed(Rough(q, rough.u, rough.a)))
                except (*UNVERIFIED, np.linalg.LinAlgError):
                    continue
        return found

    def _closed(self, rough: Rough) -> State:
        """Return a state next to a rough one that is proven to satisfy the constraints."""
        reference, sizes = self.reference, self.invariance.motion.sizes
        rows, r_h, start = reference.rows, reference.r_h, _exact(rough.q)
        zero = [ball(0)] * len(start)

        def put(x: Sequence[Ball]) -> list[Ball]:
            moved = start[:]
            for i, value in zip(columns, x, strict=True):
                moved[i] = value
            return moved

        def residual(x: Sequence[Ball]) -> list[Ball]:
            E = balls.vector(self.system.dynamics(put(x), zero, self.time).E)
            return [E[i] for i in rows[:r_h]]

        def jacobian(x: Sequence[Ball]) -> Matrix:
            J = balls.matrix(self.system.dynamics(put(x), zero, self.time).J)
            return [[J[i][j] for j in columns] for i in rows[:r_h]]

        columns: list[int] = []
        J = _middle(self.system.dynamics(start, zero, self.time).J)[rows] * sizes
        columns = independent_rows(J[:r_h].T, r_h)
        q = put(krawczyk_boxes(residual, jacobian, [start[i] for i in columns], "a state on the constraints")[0])
        u = self._fitted(q, zero, _exact(rough.u), lambda at: at.V)
        rng = np.random.default_rng(17)
        a = _exact(self.invariance.rate**2 * sizes * rng.uniform(-1.0, 1.0, len(start)))
        return State(q, u, self._fitted(q, u, a, lambda at: at.B))

    def _fitted(self, q: list[Ball], u: list[Ball], start: list[Ball], rest: Callable[[Any], Any]) -> list[Ball]:
        """Return x next to a start with J x + rest = 0, the rest taken at (q, u)."""
        rows = self.reference.rows
        at = self.system.dynamics(q, u, self.time)
        J, b = balls.matrix(at.J), balls.vector(rest(at))
        J, b = [J[i] for i in rows], [b[i] for i in rows]
        middle = _middle(J).reshape(len(rows), len(q)) * self.invariance.motion.sizes
        columns = independent_rows(middle.T, len(rows))
        found = start[:]
        for i in columns:
            found[i] = ball(0)
        slack = [[-x - y] for x, y in zip(balls.apply(J, found), b, strict=True)]
        for i, (x,) in zip(columns, balls.solve([[row[j] for j in columns] for row in J], slack), strict=True):
            found[i] = x
        return found

    # --- fields -----------------------------------------------------------------------------------------------------

    def field(self, name: str, group: Group, reference: Reference) -> Map:
        """Return Y(q) for jets of balls, with the numbers of the file in place of floats."""
        if isinstance(group, Shift):
            constant = [Jet.of(short(x)) for x in group.direction.tolist()]
            return lambda q: constant
        if isinstance(group, Turn):
            turn = reference.state.field if name == "the motion itself" else ground_turn(group.generator, reference)
            return lambda q: _turned(turn, q)
        bodies = zip(reference.system.scene.bodies, reference.system.body_slices, strict=True)
        body = next(b for b, part in bodies if part == group.part)  # type: ignore[attr-defined]
        return _own_turn(group, body) if isinstance(group, OwnTurn) else _spin(group)  # type: ignore[arg-type]

    def local(self, name: str, group: Group, state: State) -> Local:
        """Return a field and its derivatives at one of the states."""
        key = name, id(state)
        if key not in self._locals:
            self._locals[key] = self._local(self.field(name, group, self.reference), state)
        return self._locals[key]

    def _local(self, Y: Map, state: State) -> Local:
        n, slices = self.system.n_q, self.system.body_slices
        slope = balls.zeros(n, n)
        # What a field does to a body depends on the coordinates of that body only.
        for k in range(max(part.stop - part.start for part in slices)):
            columns = {part.start + k: part for part in slices if part.start + k < part.stop}
            found = _along(Y, state.q, [ball(int(j in columns)) for j in range(n)])
            for j, part in columns.items():
                for i in range(part.start, part.stop):
                    slope[i][j] = ball(found[i].rate)
        moved = _along(Y, state.q, state.u)
        growth = [x + ball(y.second) for x, y in zip(balls.apply(slope, state.a), moved, strict=True)]
        return Local([ball(x.value) for x in moved], slope, [ball(x.rate) for x in moved], growth)

    def disturbance(self, item: Symmetry, reference: Reference) -> tuple[list[Ball], list[Ball]]:
        """Return what a symmetry changes of the coordinates and the speeds of a reference."""
        state = reference.state
        found = _along(self.field(item.name, item.of, reference), state.q, state.u)
        return [ball(x.value) for x in found], [ball(x.rate) for x in found]

    # --- symmetries ---------------------------------------------------------------------------------------------------

    def symmetry(self, item: Symmetry) -> Finding:
        """Return whether a group carries all motions into motions."""
        return self._once(f"symmetry {item.name}", lambda: self._symmetry(item.name, item.of))

    def steady(self) -> Finding:
        """Return whether the reference stays as it is in its own frame, also with drives of constant speed."""
        return self._once("steady", self._steady)

    def _once(self, key: str, find: Callable[[], Finding]) -> Finding:
        """Find something out at first use."""
        if key not in self._found:
            try:
                self._found[key] = find()
            except UNVERIFIED:
                self._found[key] = "open"
        return self._found[key]

    def _symmetry(self, name: str, group: Group) -> Finding:
        shift = group.direction if isinstance(group, Shift) else None
        seen = [e for e in self.elements if shift is None or any(shift[j] for _, j in e.slots)]
        found: list[Finding] = []
        broken = []
        for element in seen:
            changes = [self._change(element, self.local(name, group, state), state) for state in self.states]
            if not changes or not all(_tiny(change, size) for change, size in changes):
                broken.append(element)
        found.append(_worth(seen))
        if broken and not self._together(broken, name, group):
            wrong = any(not zero_inside(x) for x in self._sums(broken, name, group))
            found.append("refuted" if wrong and not self.system.n_c else "open")
        found.append(self._rows_carried(name, group))
        return _least(found)

    def _change(self, element: Acting, at: Local, state: State) -> tuple[list[Ball], Ball]:
        """Return how what an element does changes along a field, and the size of all that is summed."""
        columns, n = element.columns, self.system.n_q
        arguments = (state.q, state.u, state.a, self.time, self.f)
        K, R = element.slopes(*arguments)
        force = [ball(x) for x in element.force(*arguments)]
        result = [ball(0)] * n
        size = _total(force) + _total(x for row in K for x in row) * _total(at.Y)
        size = size + _total(x for row in R for x in row) * _total(at.rate)
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

    def _sums(self, broken: list[Acting], name: str, group: Group) -> list[Ball]:
        """Return how several elements change together, at all states."""
        found: list[Ball] = []
        for state in self.states:
            at = self.local(name, group, state)
            changes = [self._change(element, at, state)[0] for element in broken]
            found += [sum(entries, ball(0)) for entries in zip(*changes, strict=True)]
        return found

    def _together(self, broken: list[Acting], name: str, group: Group) -> bool:
        """Whether elements change by nothing together, along all motions that the rows allow."""
        if not self.system.n_c or not self.on_rows:
            return False
        for state in self.on_rows:
            at = self.local(name, group, state)
            changes = [self._change(element, at, state) for element in broken]
            total = [sum(entries, ball(0)) for entries in zip(*(x for x, _ in changes), strict=True)]
            size = sum((x for _, x in changes), ball(0))
            if not _tiny(balls.apply(balls.transposed(self._allowed(state)), total), size):
                return False
        return True

    def _allowed(self, state: State) -> Matrix:
        """Return directions that the rows allow, as columns."""
        rows, n = self.reference.rows, self.system.n_q
        J = balls.matrix(self.system.dynamics(state.q, state.u, self.time).J)
        pivots, T = balls.eliminate([J[i] for i in rows], len(rows), n, None, self.invariance.motion.sizes.tolist())
        return balls.null_space(pivots, T, n)[1]

    def _rows_carried(self, name: str, group: Group) -> Finding:
        """Return whether states that satisfy the rows stay such states along a field."""
        found: list[Finding] = ["structural"]
        for state in self._needed_on_rows():
            at = self.local(name, group, state)
            found.append(self._rows_change(at, state, at.Y))
        return _least(found)

    def _needed_on_rows(self) -> list[State]:
        if self.system.n_c and not self.on_rows:
            raise NotProvable("no state on the constraints is enclosed")
        return self.on_rows if self.system.n_c else []

    def _rows_change(self, at: Local, state: State, Y: Sequence[Ball]) -> Finding:
        """Return whether holonomic rows are constant along Y, and nonholonomic ones along (Y, DY u)."""
        rows, r_h = self.reference.rows, self.reference.r_h
        J = balls.matrix(self.system.dynamics(state.q, state.u, self.time).J)
        V_q = balls.matrix(self.system.linearize_rows(state.q, state.u, state.a, self.time)[0])
        found: list[Finding] = []
        for k, i in enumerate(rows):
            if k < r_h:
                found.append(_is_zero(_dot(J[i], Y), _total(J[i]) * _total(Y)))
                continue
            size = _total(V_q[i]) * _total(at.Y) + _total(J[i]) * _total(at.rate)
            found.append(_is_zero(_dot(V_q[i], at.Y) + _dot(J[i], at.rate), size))
        return _least(found)

    def _steady(self) -> Finding:
        u = self.reference.state.u
        if all(x.is_zero() for x in u):
            return "structural"
        group = self._own()
        found = [_worth(self.elements)]
        for state in self.states:
            at = self.local("the motion itself", group, state)
            if any(not _tiny(*self._change(element, at, state)) for element in self.elements):
                return "open"
        if not self.states:
            return "open"
        rows, r_h = self.reference.rows, self.reference.r_h
        for state in self._needed_on_rows():
            at = self.local("the motion itself", group, state)
            found.append(self._satisfied(state, at.Y, rows[:r_h]))
            # A drive adds a constant to its row: what is left of the rate of the row has to vanish.
            found.append(self._rows_change(at, state, [ball(0)] * len(at.Y)))
        return _least(found)

    def _satisfied(self, state: State, u: Sequence[Ball], rows: Sequence[int]) -> Finding:
        """Return whether speeds satisfy rows at a place."""
        dynamics = self.system.dynamics(state.q, u, self.time)
        V, J = balls.vector(dynamics.V), balls.matrix(dynamics.J)
        size = _total(u) + _total(state.u)
        return _least([_is_zero(V[i], _total(J[i]) * size) for i in rows])

    def _own(self) -> Turn:
        """Return the motion as a group; its numbers are those of the reference in balls."""
        zero = np.zeros(3)
        system = self.invariance.system
        return Turn(Generator(system, np.array([0.0, 0.0, 1.0]), zero, 0.0, zero, np.zeros(system.n_q)), 0.0)

    # --- conserved functions ------------------------------------------------------------------------------------------

    def boost(self, item: Symmetry) -> Finding:
        """Return whether a common speed along a shift changes nothing."""
        return self._once(f"boost {item.name}", lambda: self._boost(item))

    def _boost(self, item: Symmetry) -> Finding:
        direction = [short(x) for x in item.direction.tolist()]
        found: list[Finding] = ["structural" if self.states else "open"]
        for element in self.elements:
            for state in self.states:
                _, R = element.slopes(state.q, state.u, state.a, self.time, self.f)
                found += _blind(balls.matrix(R), [direction[j] for j in element.columns])
        return _least([*found, self._horizontal(item)])

    def momentum(self, item: Symmetry) -> Finding:
        """Return whether the momentum along a symmetry is the same along every motion."""
        return self._once(f"momentum {item.name}", lambda: self._momentum(item))

    def _momentum(self, item: Symmetry) -> Finding:
        found: list[Finding] = ["structural" if self.states else "open"]
        zero = [ball(0)] * self.system.n_q
        for state in self.states:
            at = self.local(item.name, item.of, state)
            for element in self.elements:
                speeds = zero if element.inertia else state.u
                force = element.force(state.q, speeds, zero, self.time, self.f)
                Y = [at.Y[i] for i in element.columns]
                found.append(_is_zero(_dot(balls.vector(force), Y), _total(balls.vector(force)) * _total(Y)))
        return _least([*found, self._horizontal(item)])

    def _horizontal(self, item: Symmetry) -> Finding:
        """Return whether no row resists a field."""
        found: list[Finding] = ["structural"]
        for state in self._needed_on_rows():
            Y = self.local(item.name, item.of, state).Y
            J = balls.matrix(self.system.dynamics(state.q, state.u, self.time).J)
            found += [_is_zero(_dot(J[i], Y), _total(J[i]) * _total(Y)) for i in self.reference.rows]
        return _least(found)

    # --- work ---------------------------------------------------------------------------------------------------------

    def rows_at_rest(self) -> Finding:
        """Return whether rest satisfies all rows."""
        return self._once("rows at rest", lambda: self._homogeneous(False))

    def _homogeneous(self, moving: bool) -> Finding:
        """Return whether all rows hold for u = X, or u = 0, at all places."""
        found: list[Finding] = ["structural"]
        zero = [ball(0)] * self.system.n_q
        for state in self._needed_on_rows():
            X = self.local("the motion itself", self._own(), state).Y if moving else zero
            found.append(self._satisfied(state, X, self.reference.rows))
        return _least(found)

    def conserved(self, moving: bool) -> Finding:
        """Return whether the energy, in the frame of the motion if `moving`, is the same along every motion."""
        if self.work.kinds["damping"] or self.work.kinds["other"]:
            return "open"
        return self._once(f"conserved {moving}", lambda: self._relative(moving))

    def decreases(self, system: System) -> Finding:
        """Return whether the energy in the frame of the motion never increases, for the parameters of a system."""
        if self.work.kinds["other"] or not self.states:
            return "open"
        found = self._once("decreases", self._decreases)
        return found if self._takes(system) else "refuted"

    def _dampers(self, system: System) -> list[Acting]:
        paths = {e.path for e in self.work.kinds["damping"]}
        return [e for e in system.acting() if e.path in paths and not e.inertia]

    def _takes(self, system: System) -> bool:
        """Whether dampers take energy: their coefficients are not negative."""
        zero = [ball(0)] * self.system.n_q
        for element in self._dampers(system):
            if element.stored:
                if not all(ball(x) >= 0 for x in element.damping or ()):
                    return False
                continue
            R = element.slopes(self.states[0].q, zero, zero, self.time, self.f)[1]
            if not _not_negative(balls.matrix(R)):
                return False
        return True

    def _decreases(self) -> Finding:
        return _least([self._relative(True), *(self._damps(e) for e in self._dampers(self.system))])

    def _relative(self, moving: bool) -> Finding:
        """Return whether forces without damping and rows do no work in the frame of the motion."""
        damping = {e.path for e in self.work.kinds["damping"]}
        found: list[Finding] = [self._homogeneous(moving), "structural" if self.states else "open"]
        for element in self.elements:
            if element.inertia or element.stored or element.path in damping:
                continue
            for state in self.states:
                found += self._potential(element, state) + self._powerless(element, state, moving)
        return _least(found)

    def _potential(self, element: Acting, state: State) -> list[Finding]:
        """Return whether the slope of a force at rest is symmetric."""
        zero = [ball(0)] * self.system.n_q
        K = balls.matrix(element.slopes(state.q, zero, zero, self.time, self.f)[0])
        size = _total(x for row in K for x in row)
        return [_is_zero(K[i][j] - K[j][i], size) for i in range(len(K)) for j in range(i)]

    def _powerless(self, element: Acting, state: State, moving: bool) -> list[Finding]:
        """Return whether what a force adds in motion does no work, and none along the motion."""
        zero = [ball(0)] * self.system.n_q
        more, still = (element.force(state.q, u, zero, self.time, self.f) for u in (state.u, zero))
        speeds = [state.u]
        if moving:
            speeds.append(self.local("the motion itself", self._own(), state).Y)
        added = [ball(x) - ball(y) for x, y in zip(more, still, strict=True)]
        moved = [[u[i] for i in element.columns] for u in speeds]
        size = _total(balls.vector(more)) + _total(balls.vector(still))
        return [_is_zero(_dot(added, u), size * _total(u)) for u in moved]

    def _damps(self, element: Acting) -> Finding:
        """Return whether a damper is linear in the speeds, and sees those relative to the motion only."""
        found: list[Finding] = ["structural" if self.states else "open"]
        zero = [ball(0)] * self.system.n_q
        first = element.slopes(self.states[0].q, zero, zero, self.time, self.f)[1] if self.states else []
        for state in self.states:
            K, R = element.slopes(state.q, state.u, zero, self.time, self.f)
            X = self.local("the motion itself", self._own(), state).Y
            found += _blind(balls.matrix(R), [X[j] for j in element.columns])
            if element.stored:
                continue
            still, _ = element.slopes(state.q, zero, zero, self.time, self.f)
            for one, other in ((R, first), (K, still)):
                found += _equal([x for row in one for x in row], [x for row in other for x in row])
            found += self._potential(element, state)
        return _least(found)

    def reversible(self) -> Finding:
        """Return whether motions backwards in time are motions: forces even in the speeds, rows odd."""
        return self._once("reversible", self._reversible)

    def _reversible(self) -> Finding:
        found: list[Finding] = [self._homogeneous(False), "structural" if self.states else "open"]
        for element in self.elements:
            if element.inertia or (element.stored and not element.damped):
                continue
            for state in self.states:
                back = [-x for x in state.u]
                one, other = (element.force(state.q, u, state.a, self.time, self.f) for u in (state.u, back))
                found += _equal(one, other)
        return _least(found)


# --- fields in balls --------------------------------------------------------------------------------------------------


def _along(Y: Map, q: Sequence[Ball], v: Sequence[Ball]) -> list[Jet]:
    """Return a field at q with its first two derivatives in a direction."""
    return [Jet.of(x) for x in Y([Jet(x, y, ball(0)) for x, y in zip(q, v, strict=True)])]


def _own_turn(group: OwnTurn, body: Any) -> Map:
    """Return a turn of a planar body about its centre of mass."""
    f, angle = jet_arithmetic(balls.ball_arithmetic()), group.part.stop - 1
    center = [Jet.of(ball(x)) for x in body.center[:2]]

    def field(q: Sequence[Jet]) -> list[Jet]:
        c, s = f.cos(q[angle]), f.sin(q[angle])
        found = [Jet.of(ball(0))] * len(q)
        found[group.part] = [s * center[0] + c * center[1], s * center[1] - c * center[0], Jet.of(ball(1))]
        return found

    return field


def _spin(group: Spin) -> Map:
    """Return a turn of a body in space about an axis fixed in it."""
    f, axis = jet_arithmetic(balls.ball_arithmetic()), [Jet.of(short(x)) for x in group.axis.tolist()]

    def field(q: Sequence[Jet]) -> list[Jet]:
        _, theta, psi = q[group.angles]
        c3, s3 = f.cos(psi), f.sin(psi)
        across = axis[0] * c3 - axis[1] * s3
        found = [Jet.of(ball(0))] * len(q)
        found[group.angles] = [
            across / f.cos(theta), axis[0] * s3 + axis[1] * c3, axis[2] - across * f.tan(theta)
        ]  # fmt: skip
        return found

    return field


def _turned(turn: Field, q: Sequence[Jet]) -> list[Jet]:
    """Return what a turn, translation and spins do to coordinates that are jets."""
    system, d = turn.system, turn.system.scene.dimension
    f, found = jet_arithmetic(balls.ball_arithmetic()), [Jet.of(x) for x in turn.spins]
    w = [Jet.of(turn.rate * x) for x in turn.axis]
    for body, part in zip(system.scene.bodies, system.body_slices, strict=True):
        s = part.start
        out = [q[s + k] - Jet.of(turn.point[k]) for k in range(d)] + [Jet.of(ball(0))] * (3 - d)
        across = [w[1] * out[2] - w[2] * out[1], w[2] * out[0] - w[0] * out[2], w[0] * out[1] - w[1] * out[0]]
        for k in range(d):
            found[s + k] = found[s + k] + across[k] + Jet.of(turn.velocity[k])
        if not body.orientation or turn.rate.is_zero():
            continue
        if d == 2:
            found[s + 2] = found[s + 2] + w[2]
            continue
        base = [ball(x) for x in body.base]
        w1, w2, w3 = (
            Jet.of(sum((base[3 * i + k] * turn.rate * turn.axis[i] for i in range(3)), ball(0))) for k in range(3)
        )
        c1, s1 = f.cos(q[s + 3]), f.sin(q[s + 3])
        x, y = c1 * w2 + s1 * w3, c1 * w3 - s1 * w2
        for k, change in enumerate((w1 - f.tan(q[s + 4]) * y, x, y / f.cos(q[s + 4]))):
            found[s + 3 + k] = found[s + 3 + k] + change
    return found


def ground_turn(generator: Generator, reference: Reference) -> Field:
    """Return a turn of the ground at 1 rad/s, about an axis and a point of the file where it knows them."""
    system, zero = reference.system, [ball(0)] * 3
    axis = next((x for x in _axes(reference) if _same(x, generator.axis)), None)
    axis = axis or [short(x) for x in generator.axis.tolist()]
    point = next((x for x in _points(reference, axis) if _same(x, generator.point)), None)
    point = point or [short(x) for x in generator.point.tolist()]
    return Field(system, axis, point, ball(1), zero, [ball(0)] * system.n_q)


def _axes(reference: Reference) -> Iterable[list[Ball]]:
    """Yield axes that the file knows."""
    yield from ([ball(int(i == k)) for i in range(3)] for k in range(3))
    scene = reference.system.scene
    gravity = [*balls.vector(scene.gravity), ball(0)][:3]
    if any(not x.is_zero() for x in gravity):
        size = balls.ball_arithmetic().sqrt(sum((x * x for x in gravity), ball(0)))
        yield [-x / size for x in gravity]
    yield reference.state.field.axis
    for item in scene.items:
        if item.entry.section == "joints" and item.given("axis") and item.given("between"):
            sides = zip(item.markers("between"), item.triads("axis", "zero"), strict=True)
            yield from ([*balls.vector(triad.v1), ball(0)][:3] for marker, triad in sides if marker.body == GROUND)


def _points(reference: Reference, axis: list[Ball]) -> Iterable[list[Ball]]:
    """Yield points that the file knows, moved along an axis to the plane across it through the origin."""
    found = [[ball(0)] * 3, reference.state.field.point]
    for item in reference.system.scene.items:
        if item.given("between"):
            markers = (x for x in item.markers("between") if x.body == GROUND)
            found += [[*balls.vector(x.point), ball(0)][:3] for x in markers]
    for point in found:
        along = sum((x * y for x, y in zip(axis, point, strict=True)), ball(0))
        yield [x - along * y for x, y in zip(point, axis, strict=True)]


# --- numbers ----------------------------------------------------------------------------------------------------------


def short(x: float) -> Ball:
    """Return the short fraction that a float is next to, or the float itself."""
    fraction = Fraction(x).limit_denominator(SHORT)
    return ball(fraction if abs(float(fraction) - x) <= NEXT * abs(x) else Fraction(x))


def tiny(x: Ball, size: Ball) -> bool:
    """Whether a ball contains zero and is smaller than a size by half of the digits in use."""
    if x.is_zero():
        return True
    return zero_inside(x) and bool(x.abs_upper() <= balls.half_digits() * size.abs_upper())


def _tiny(entries: Sequence[Ball], size: Ball) -> bool:
    return all(tiny(x, size) for x in entries)


def _is_zero(x: Ball, size: Ball) -> Finding:
    """Return whether a ball vanishes, beside something of a size."""
    if x.is_zero():
        return "structural"
    if tiny(x, size):
        return "enclosed"
    return "open" if zero_inside(x) else "refuted"


def _equal(one: Sequence[Any], other: Sequence[Any]) -> list[Finding]:
    """Return whether numbers are the same."""
    pairs = [(ball(x), ball(y)) for x, y in zip(one, other, strict=True)]
    size = _total(x for pair in pairs for x in pair)
    return [_is_zero(x - y, size) for x, y in pairs]


def _blind(R: Matrix, direction: Sequence[Ball]) -> list[Finding]:
    """Return whether a matrix sends a direction to zero."""
    return [_is_zero(_dot(row, direction), _total(row) * _total(direction)) for row in R]


def _dot(x: Sequence[Ball], y: Sequence[Ball]) -> Ball:
    return sum((a * b for a, b in zip(x, y, strict=True)), ball(0))


def _total(entries: Iterable[Any]) -> Ball:
    """Return the sum of sizes."""
    return sum((abs(ball(x)) for x in entries), ball(0))


def _not_negative(R: Matrix) -> bool:
    """Whether the symmetric part of a matrix is proven not to be negative; some pivots may be exact zeros."""
    A = [[x + y for x, y in zip(row, column, strict=True)] for row, column in zip(R, balls.transposed(R), strict=True)]
    for k in range(len(A)):
        pivot = A[k][k]
        if pivot.is_zero():
            if not all(x.is_zero() for x in A[k][k:]):
                return False
            continue
        if not pivot > 0:
            return False
        for i in range(k + 1, len(A)):
            factor = A[i][k] / pivot
            A[i] = [x - factor * y for x, y in zip(A[i], A[k], strict=True)]
    return True


def _worth(elements: Sequence[Acting]) -> Finding:
    """Return what it is worth that elements are unchanged at some states."""
    return "enclosed" if elements else "structural"


def _least(found: Sequence[Finding]) -> Finding:
    order: tuple[Finding, ...] = ("refuted", "open", "enclosed", "structural")
    return min(found, key=order.index, default="structural")


def _exact(x: Array) -> list[Ball]:
    return [ball(value) for value in x.tolist()]


def _middle(J: Any) -> Array:
    return np.array([[float(x) for x in row] for row in J])


def _same(x: Sequence[Ball], y: Array) -> bool:
    return all(abs(float(a) - b) <= NEAR for a, b in zip(x, y.tolist(), strict=True))
