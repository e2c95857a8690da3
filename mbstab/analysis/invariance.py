"""What the equations of a scene are invariant under, element by element: the structure that verdicts rest on.

A symmetry carries *all* motions near the reference into motions, not only those of the linearized
equations. It counts if every element has it by itself, nonlinearly: because the element does not
contain the coordinate at all (structure), or because element(g state) = g element(state) holds
for large g at states spread over the scene, relative to what the element does itself, at rest and
in motion: a weak push is seen beside a strong damper. Elements that are written as expressions are
compared with 40 digits. Constraint rows count as a set: g must carry states that satisfy them into
states that satisfy them.

Fields Y(q) generate the symmetries; a disturbance along one is (Δq, Δu) = (Y, DY u).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from mbstab.analysis.motion import Motion
from mbstab.analysis.names import expressions_in
from mbstab.analysis.rotation import euler_angles, orientation, rate_drift, rate_matrix, rotation_matrix
from mbstab.analysis.roundings import Rounded, rounded_arithmetic
from mbstab.analysis.steady import Generator, axis_text, through
from mbstab.compiler.system import Acting, Array, System
from mbstab.errors import MbstabError
from mbstab.mechanics.catalogue import GROUND
from mbstab.model.arithmetic import FLOAT, mpmath_arithmetic

ANGLE = 0.7
"""Turns (rad), and shifts in sizes of the scene, by which elements are tried."""

CARRIED = 1e-11
"""An element is carried into itself if each of its forces changes by no more than this part of its size …"""

CANCELLED = 1e-14
"""… or than this part of all that the element does: what turned axes mix is rounded so."""

EPS = float(np.finfo(float).eps)

ROUNDINGS = 8.0
"""So many roundings of their terms numbers that are computed here may be off."""

DIGITS, EXACT = 40, 1e-32
"""Expressions are compared with so many digits, and are equal to this."""

ON_ROWS = 1e-12
"""Constraint rows hold to this, relative to the sizes in the scene."""

AGREED = 30.0
"""Rows that repeat others agree elsewhere to so many times what their directions agree to at the reference."""

SEEMS = 1e-7
"""Work along combinations of symmetries that is smaller than this is looked at more closely."""

RESTING = 1e-6
"""Slower speeds, relative to those of the scene, count as rest where rows on speeds are asked."""

FIRST_ORDER = 1e-6
"""What constraints do not allow to first order is not tried."""

INDEPENDENT = 1e-8
"""Field are independent if the smallest of their singular values, of unit vectors, is larger than this."""

SPREADS = (0.5, 0.15, 0.04, 0.01)
"""How far from the reference states are spread, in sizes of the scene and rad; less where equations have no value."""

NEAR = 1e-3
"""Surroundings of the reference, relative to the spread of the other states."""

STEPS = 25
"""Newton steps onto the constraints."""

OFF = 1e-6
"""So far off are the parameters of expressions with which structure is looked for."""

PARTS = (1.0, 2.0**-20, 2.0**-40)
"""Parts of a step: functions may be flat but for a narrow range."""

SPEEDS = (0.3, -1.0, 3.0, 1e-3, -1e-6, 1e-9, -1e-12)
"""Speeds along symmetries, in rates of the scene, at which what rests is tried."""

GRID = 24
"""Bits of the states at which elements are compared."""

UNEVEN = 5661 / 4096
"""Steps are this times a power of two."""

MOST_DENOMINATOR = 1000
"""Ratios of the entries of a shift are fractions if their denominators are no larger."""

POINTS = 8
"""So many points fixed in the ground are tried as centres of turns."""


class Field(Protocol):
    """A one-parameter group that acts on the coordinates."""

    def field(self, q: Array) -> Array:
        """Return Y(q)."""
        ...

    def slope(self, q: Array) -> Array:
        """Return DY(q)."""
        ...

    def moved(self, q: Array) -> tuple[Array, Array]:
        """Return where a large step along it leads, and the derivative of that by q."""
        ...


@dataclass(frozen=True)
class Shift:
    """The same change of the coordinates everywhere."""

    direction: Array
    step: float

    def field(self, q: Array) -> Array:  # noqa: D102
        return self.direction

    def slope(self, q: Array) -> Array:  # noqa: D102
        return np.zeros((len(q), len(q)))

    def moved(self, q: Array) -> tuple[Array, Array]:  # noqa: D102
        return q + self.step * self.direction, np.eye(len(q))


@dataclass(frozen=True)
class Turn:
    """A turn of the ground, a screw, or a steady motion: what a `Generator` generates."""

    generator: Generator
    time: float

    def field(self, q: Array) -> Array:  # noqa: D102
        return self.generator.field(q)

    def slope(self, q: Array) -> Array:  # noqa: D102
        return self.generator.frame(q)[0]

    def moved(self, q: Array) -> tuple[Array, Array]:  # noqa: D102
        return self.generator.flow(q, self.time)


@dataclass(frozen=True)
class OwnTurn:
    """A turn of a planar body about its centre of mass, where that is not its place."""

    part: slice
    center: Array

    def _lever(self, angle: float) -> Array:
        c, s = math.cos(angle), math.sin(angle)
        return np.array([[c, -s], [s, c]]) @ self.center

    def field(self, q: Array) -> Array:  # noqa: D102
        result, lever = np.zeros(len(q)), self._lever(q[self.part.stop - 1])
        result[self.part] = lever[1], -lever[0], 1.0
        return result

    def slope(self, q: Array) -> Array:  # noqa: D102
        result, angle = np.zeros((len(q), len(q))), self.part.stop - 1
        result[self.part.start : angle, angle] = self._lever(q[angle])
        return result

    def moved(self, q: Array) -> tuple[Array, Array]:  # noqa: D102
        angle, places = self.part.stop - 1, slice(self.part.start, self.part.stop - 1)
        before, after = self._lever(q[angle]), self._lever(q[angle] + ANGLE)
        new, T = q.copy(), np.eye(len(q))
        new[places] += before - after
        new[angle] += ANGLE
        T[places, angle] = np.array([-before[1], before[0]]) - np.array([-after[1], after[0]])
        return new, T


@dataclass(frozen=True)
class Spin:
    """A turn of a body in space about an axis fixed in it, through its place."""

    body: Any
    part: slice
    axis: Array

    def _rates(self, angles: Array) -> tuple[Array, Array]:
        """Return the Euler rates of a turn at 1 rad/s, and their derivative by the angles."""
        (_, c2, c3), (_, s2, s3) = np.cos(angles), np.sin(angles)
        across = self.axis[0] * c3 - self.axis[1] * s3
        along = self.axis[0] * s3 + self.axis[1] * c3
        t2 = s2 / c2
        rates = np.array([across / c2, along, self.axis[2] - across * t2])
        slope = np.array(
            [
                [0.0, across * t2 / c2, -along / c2],
                [0.0, 0.0, across],
                [0.0, -across / c2**2, along * t2],
            ]
        )
        return rates, slope

    @property
    def angles(self) -> slice:
        """Where the angles are among the coordinates."""
        return slice(self.part.start + 3, self.part.stop)

    def field(self, q: Array) -> Array:  # noqa: D102
        result = np.zeros(len(q))
        result[self.angles] = self._rates(q[self.angles])[0]
        return result

    def slope(self, q: Array) -> Array:  # noqa: D102
        result = np.zeros((len(q), len(q)))
        result[self.angles, self.angles] = self._rates(q[self.angles])[1]
        return result

    def moved(self, q: Array) -> tuple[Array, Array]:  # noqa: D102
        old = q[self.angles]
        new = euler_angles(self.body, orientation(self.body, old) @ rotation_matrix(self.axis, ANGLE), old)
        result, T = q.copy(), np.eye(len(q))
        result[self.angles] = new
        T[self.angles, self.angles] = np.linalg.solve(rate_matrix(self.body, new), rate_matrix(self.body, old))
        return result, T


@dataclass(frozen=True)
class Combination:
    """A combination of fields with constant coefficients, which need not be a group."""

    parts: tuple[tuple[float, Field], ...]

    def field(self, q: Array) -> Array:  # noqa: D102
        return np.asarray(sum(c * part.field(q) for c, part in self.parts))

    def slope(self, q: Array) -> Array:  # noqa: D102
        return np.asarray(sum(c * part.slope(q) for c, part in self.parts))

    def moved(self, q: Array) -> tuple[Array, Array]:
        """Return where the steps of all parts lead, one after the other."""
        T = np.eye(len(q))
        for _, part in self.parts:
            q, step = part.moved(q)
            T = step @ T
        return q, T


@dataclass(frozen=True, eq=False)
class Symmetry:
    """A one-parameter group that carries motions into motions.

    Attributes
    ----------
    name : str
        Such as ``wheel.psi``, ``translation along x``, ``rotation about z``.
    direction, rate : ndarray, shape (n_q,)
        What it changes of the coordinates and of the speeds of the reference, Y and DY u.
    of : Field
    """

    name: str
    direction: Array
    rate: Array
    of: Field


@dataclass(frozen=True)
class State:
    """Coordinates, speeds and accelerations at which elements are compared."""

    q: Array
    u: Array
    a: Array


Numbers = list[float | Rounded]


def _rounded(state: State, spread: State | None = None) -> tuple[Numbers, Numbers, Numbers]:
    """Return q, u and a of a state, with how far they may be off."""
    if spread is None:
        return state.q.tolist(), state.u.tolist(), state.a.tolist()
    pairs = ((state.q, spread.q), (state.u, spread.u), (state.a, spread.a))
    q, u, a = ([Rounded(v, e) if e else v for v, e in zip(x.tolist(), dx.tolist(), strict=True)] for x, dx in pairs)
    return q, u, a


def symmetries(system: System, motion: Motion) -> list[Symmetry]:
    """Return independent symmetries of the scene that move the reference motion."""
    return Invariance(system, motion).symmetries


class Invariance:
    """What carries the motions of a scene into motions; each part is worked out when it is asked for.

    Parameters
    ----------
    system : System
    motion : Motion
        The reference.
    """

    def __init__(self, system: System, motion: Motion) -> None:
        self.system, self.motion = system, motion
        self.elements = [_general(element) for element in system.acting()]
        self._steady: dict[bytes, bool] = {}

    # --- states -----------------------------------------------------------------------------------------------------

    @cached_property
    def rate(self) -> float:
        """A rate at which the scene moves by itself or is moved (1/s)."""
        motion, scale = self.motion, self.motion.spaces.scale
        K, R, _ = self.system.linearize(motion.q, motion.u, motion.a, motion.nu, motion.time)
        K, R = (np.abs(x * scale * scale[:, None]) for x in (K, R))
        sizes = float(np.max(np.abs(motion.u) / motion.sizes)), float(np.max(K)) ** 0.5, float(np.max(R))
        return max(sizes) or 1.0

    @cached_property
    def states(self) -> list[State]:
        """States off the constraints at which all elements have a value: at rest, in motion, accelerating."""
        motion, sizes = self.motion, self.motion.sizes
        for spread in SPREADS:
            rng = np.random.default_rng(11)
            found = []
            # The reference itself and its surroundings too: functions may be flat elsewhere.
            for part, moves, accelerates in (
                (0.0, 0.0, 0.0),  # where strong terms vanish weak ones are seen
                (1.0, 0.0, 0.0),
                (1.0, 1.0, 0.0),
                (1.0, 1.0, 1.0),
                (0.0, 1.0, 0.0),
                (NEAR, 1.0, 0.0),
            ):
                q, u, a = (spread * sizes * rng.uniform(-1.0, 1.0, len(sizes)) for _ in range(3))
                q, u = _on_grid(motion.q + part * q, sizes), moves * (motion.u + self.rate * u)
                u = _on_grid(u, self.rate * sizes)
                found.append(State(q, u, accelerates * (motion.a + self.rate**2 * a)))
            try:
                for state in found:
                    for element in self.elements:
                        element.force(state.q, state.u, state.a, motion.time)
                return found
            except (ArithmeticError, ValueError):
                continue
        return []

    @cached_property
    def on_rows(self) -> list[State]:
        """States that satisfy the constraints, spread around the reference; the reference itself comes first."""
        motion = self.motion
        found = [State(motion.q, motion.u, motion.a)]
        if not self.system.n_c:
            return found + self.states[1:]
        rng = np.random.default_rng(5)
        for _ in range(2):
            for spread in SPREADS:
                state = self._projected(rng, spread)
                if state is not None:
                    found.append(state)
                    break
        return found

    @cached_property
    def seen(self) -> bool:
        """Whether there are states beside the reference at which constraint rows can be asked."""
        if not self.system.n_c or not self.motion.spaces.N.shape[1]:
            return True
        rows = (item for item in self.system.scene.items if item.entry.section == "constraints")
        pieced = any(expression.pieced() for item in rows for expression in expressions_in(item.entry.values))
        return len(self.on_rows) > 1 and not pieced

    def _projected(self, rng: np.random.Generator, spread: float) -> State | None:
        """Return a state near a random one that satisfies the constraints, or None if there is none."""
        motion, sizes = self.motion, self.motion.sizes
        q = motion.q + spread * sizes * rng.uniform(-1.0, 1.0, len(sizes))
        return self.onto_rows(q, motion.u + self.rate * spread * sizes * rng.uniform(-1.0, 1.0, len(sizes)))

    @cached_property
    def agreed(self) -> float:
        """To what the rows hold, relative to the sizes in the scene: redundant ones, as well as they agree."""
        motion, n_h = self.motion, self.system.n_h
        if motion.spaces.C.rank == n_h:
            return ON_ROWS
        J = motion.dynamics.J[:n_h] * motion.sizes
        s = np.linalg.svd(J / (np.linalg.norm(J, axis=1) + 1e-300)[:, None], compute_uv=False)
        return max(ON_ROWS, AGREED * float(np.max(s[motion.spaces.C.rank :], initial=0.0)))

    def onto_rows(self, q: Array, u: Array, within: float | None = None) -> State | None:
        """Return the state that satisfies the constraints nearest to a given one, or None if there is none."""
        system, time, sizes = self.system, self.motion.time, self.motion.sizes
        n_h = system.n_h
        try:
            for _ in range(STEPS if n_h else 0):
                state = system.dynamics(q, 0.0 * u, time)
                J = state.J[:n_h] * sizes
                lengths = np.linalg.norm(J, axis=1) + 1e-300
                step = np.linalg.lstsq(J / lengths[:, None], -state.E[:n_h] / lengths, rcond=1e-10)[0]
                if float(np.max(np.abs(step))) > 4.0:
                    return None
                q = q + sizes * step
                if float(np.max(np.abs(step))) < 1e-13:
                    break
            for _ in range(2 if system.n_c else 0):
                state = system.dynamics(q, u, time)
                J = state.J * sizes
                lengths = np.linalg.norm(J, axis=1) + 1e-300
                u = u + sizes * np.linalg.lstsq(J / lengths[:, None], -state.V / lengths, rcond=1e-10)[0]
        except (MbstabError, ValueError, np.linalg.LinAlgError):
            return None
        return State(q, u, 0.0 * u) if self.satisfies(q, u, within=within) else None

    def satisfies(self, q: Array, u: Array, time: float | None = None, within: float | None = None) -> bool:
        """Whether a state satisfies the constraint rows."""
        system, motion = self.system, self.motion
        if not system.n_c:
            return True
        state = system.dynamics(q, u, motion.time if time is None else time)
        allowed = (self.agreed if within is None else within) * np.abs(state.J) @ motion.sizes + 1e-300
        fastest = max(float(np.max(np.abs(u / motion.sizes))), RESTING * self.rate)
        n_h = system.n_h
        return bool(np.all(np.abs(state.E[:n_h]) <= allowed[:n_h]) and np.all(np.abs(state.V) <= allowed * fastest))

    # --- symmetries -------------------------------------------------------------------------------------------------

    @cached_property
    def fields(self) -> list[tuple[str, Field]]:
        """All verified groups with their names, also those that leave the reference as it is."""
        found = [(name, field) for name, field in self._candidates() if self.carries(field)]
        for generator in self.motion.generators:
            if generator.turns or np.any(generator.velocity) or np.any(generator.spins):
                return [*found, ("the motion itself", self.along(generator))] if self.steady(generator) else found
        return found

    @cached_property
    def symmetries(self) -> list[Symmetry]:
        """Independent symmetries that move the reference."""
        motion, found = self.motion, list[Symmetry]()
        room = np.zeros((2 * len(motion.q) + 1, 2 * len(motion.q)))
        for name, field in self.fields:
            direction, rate = field.field(motion.q), field.slope(motion.q) @ motion.u
            vector = self.disturbance(direction, rate)
            length = float(np.linalg.norm(vector))
            if length < 1e-9:
                continue
            count = len(found)
            room[count] = vector / length
            # What has nothing in common with those before is independent of them: of many free bodies, most.
            apart = not np.any(room[:count] @ room[count])
            if apart or np.linalg.svd(room[: count + 1], compute_uv=False)[-1] > INDEPENDENT:
                found.append(Symmetry(name, direction, rate, field))
        return found

    def disturbance(self, direction: Array, rate: Array) -> Array:
        """Return (Δq, Δu) in units of a large change."""
        sizes = self.motion.sizes
        return np.concatenate([direction / sizes, rate / (sizes * self.rate)])

    @cached_property
    def boosts(self) -> list[Symmetry]:
        """Shifts that the speeds may be given as well: moving along them with another speed changes nothing else."""
        found = []
        for item in self.symmetries:
            if isinstance(item.of, Shift) and self._boosts(item.of.direction):
                found.append(item)
        return found

    def _boosts(self, direction: Array) -> bool:
        """Whether all elements and rows are blind to a common speed along a direction."""
        step = self.rate * float(self.motion.sizes.max()) * ANGLE / float(np.max(np.abs(direction)))
        faster = _short(step) * direction
        for element in self.elements:
            if not any(direction[i] for i in element.columns):
                continue
            if not element.analytic:
                return False
            for state, part in ((state, part) for state in self.states for part in PARTS):
                there = State(state.q, state.u + part * faster, state.a)
                if not self.same(element, state, there, np.eye(len(direction)), exact=True):
                    return False
        faithful = all(self.satisfies(state.q, state.u + faster) for state in self.on_rows)
        return faithful and self._horizontal(Shift(direction, 1.0))

    @cached_property
    def momenta(self) -> list[Symmetry]:
        """Momenta that are conserved: no force and no constraint does work along the symmetry.

        A wheel that rolls along a line keeps neither its momentum nor its spin, but a combination of both.
        """
        q, u = self.motion.q, self.motion.u
        found = [item for item in self.symmetries if self.conserves(item.of)]
        single = np.array([[float(item is other) for other in self.symmetries] for item in found])
        single = single.reshape(len(found), len(self.symmetries))
        for c in self._idle_combinations():
            chosen = [(float(x), item) for x, item in zip(c, self.symmetries, strict=True) if x]
            if np.linalg.norm(c - single.T @ (single @ c)) < INDEPENDENT * np.linalg.norm(c):
                continue
            field = Combination(tuple((x, item.of) for x, item in chosen))
            if self.conserves(field):
                name = " with ".join(item.name for _, item in chosen)
                found.append(Symmetry(name, field.field(q), field.slope(q) @ u, field))
        return found

    @cached_property
    def integrals(self) -> list[Symmetry]:
        """Momenta that are conserved, also with a linear function of the coordinates added.

        Where the forces along a shift are together the rate of such a function, as those of Coriolis
        are, it need not be a symmetry. What is conserved must not change along symmetries: that is
        the same everywhere if these are shifts.
        """
        known = self.momenta
        written = any(element.written for element in self.elements)
        if not written or not self.states or not all(isinstance(item.of, Shift) for item in self.symmetries):
            return known
        still, found = np.zeros(self.system.n_q), list(known)
        basis = [item.direction for item in known]
        for direction in _echelon(self._balanced_shifts().T):
            field = self._shift(direction)
            new = np.linalg.matrix_rank(np.array([*basis, direction]) / self.motion.sizes, tol=INDEPENDENT) > len(basis)
            if new and self._total(field) and self._horizontal(field):
                names = [name for name, x in zip(self.system.names, direction, strict=True) if x]
                found.append(Symmetry(" with ".join(names), direction, still, field))
                basis.append(direction)
        return found

    def _balanced_shifts(self) -> Array:
        """Return along which constant shifts no force depends on coordinates or speeds of symmetries, as columns."""
        system, sizes = self.system, self.motion.sizes
        rows = [np.zeros((1, system.n_q))]
        Y = np.array([item.direction for item in self.symmetries]).reshape(-1, system.n_q).T
        for state in self.on_rows:
            dynamics = system.dynamics(state.q, state.u, self.motion.time)
            K, R, _ = system.linearize(state.q, state.u, state.a, np.zeros(system.n_c), self.motion.time)
            parts = K.T * sizes, (R @ Y).T * sizes, dynamics.J * sizes
            rows += [x / (np.linalg.norm(x, axis=1, keepdims=True) + 1e-300) for x in parts]
        _, s, right = np.linalg.svd(np.vstack(rows))
        result: Array = right[int(np.sum(s > SEEMS)) :].T * sizes[:, None]
        return result

    def _total(self, field: Shift) -> bool:
        """Whether what all do along a shift is the rate of a linear function that no symmetry changes."""
        found = [self._rates(element, field) for element in self.elements]
        if any(rates is None for rates in found):
            return False
        limit = (
            CARRIED if any(not e.written and rates for e, rates in zip(self.elements, found, strict=True)) else EXACT
        )
        from mpmath import mp

        with mp.workdps(DIGITS):
            for item in self.symmetries:
                terms = [
                    rate * float(item.direction[i])
                    for element, rates in zip(self.elements, found, strict=True)
                    for i, rate in zip(element.columns, rates or (), strict=False)
                ]
                if abs(sum(terms)) > limit * sum(abs(x) for x in terms):
                    return False
        return True

    def _rates(self, element: Acting, field: Shift) -> list[Any] | None:
        """Return c if what an element does along a shift is c·u, and nothing for its inertia; None if it is not."""
        if not any(field.direction[i] for i in element.columns):
            return []
        if element.inertia:
            images = [self._moved(field, state) for state in self.states]
            return [] if self._unseen(element, field) or self._carried(element, images, exact=False) else None
        if not element.analytic or (element.written and not _exact(field)):
            return None
        found: list[tuple[Any, Any]] = []
        for state in self.states:
            with Digits(element, exact=_exact(field)) as f:
                limit = EXACT if f.name == "mpmath" else CARRIED
                weights = [f.number(repr(float(field.direction[i]))) for i in element.columns]
                q, u, zero = numbers(state.q, f), numbers(state.u, f), numbers(0.0 * state.q, f)
                K, R = element.slopes(q, u, zero, self.motion.time, f)
                still = element.force(q, zero, zero, self.motion.time, f)
                pushes = [_weighted(weights, still), *(_weighted(weights, column) for column in zip(*K, strict=True))]
                if any(abs(total) > limit * size for total, size in pushes):
                    return None
                rates = [_weighted(weights, column) for column in zip(*R, strict=True)]
                changes = zip(rates, found or rates, strict=True)
                if any(abs(one[0] - other[0]) > limit * (one[1] + other[1]) for one, other in changes):
                    return None
                found = rates
        return [rate for rate, _ in found]

    def _idle_combinations(self) -> list[Array]:
        """Return coefficients of the symmetries along which nothing seems to do work, as a basis."""
        fields = [item.of for item in self.symmetries]
        if not fields or not self.states:
            return []
        rows = []
        for state in self.on_rows if self.system.n_c else []:
            Y = np.array([field.field(state.q) for field in fields]).T
            J = self.system.dynamics(state.q, state.u, self.motion.time).J
            rows += list((J @ Y) / (np.abs(J) @ np.abs(Y) + 1e-300).max(axis=1, keepdims=True))
        for element in self.elements:
            for state in self.states if not element.inertia else []:
                Y = np.array([field.field(state.q) for field in fields])[:, list(element.columns)]
                force = np.array(element.force(state.q, state.u, state.a, self.motion.time), dtype=float)
                size = float(np.max(np.abs(Y) @ np.abs(force)))
                rows += [(Y @ force) / size] if size > 0.0 else []
        _, s, right = np.linalg.svd(np.array([*rows, np.zeros(len(fields))]))
        return _echelon(right[int(np.sum(s > SEEMS)) :])

    def moves_on(self, field: Field) -> bool:
        """Whether what rests at the reference may move along a group at any speed: no force then turns it aside."""
        motion = self.motion
        Y, slope = field.field(motion.q), field.slope(motion.q)
        slow = self.rate / float(np.max(np.abs(Y) / motion.sizes))
        spaces = motion.spaces
        allowed = spaces.scale[:, None] * (spaces.N @ spaces.Z)
        if not all(element.analytic for element in self.elements):
            return False
        for speed in (UNEVEN * slow * x for x in SPEEDS):
            u, a = speed * Y, speed**2 * (slope @ Y)
            if not self.satisfies(motion.q, u):
                return False
            turned = np.abs(slope) @ np.abs(Y) + motion.sizes * (self.rate / slow) ** 2
            off = ROUNDINGS * EPS * np.abs(u), ROUNDINGS * EPS * speed**2 * turned
            changed = (u != 0.0) | (a != 0.0) | np.any([x != 0.0 for x in off], axis=0)
            moving = _rounded(State(motion.q, u, a), State(0.0 * u, *off))
            resting = _rounded(State(motion.q, 0.0 * u, 0.0 * a))
            pushed, unsure = np.zeros((2, len(u)))
            for element in self.elements:
                columns = list(element.columns)
                if not any(changed[j] for j in (*columns, *(j for _, j in element.slots))):
                    continue
                try:
                    # What speed changes of each by itself: loads at rest hide no weak drag.
                    F, error = self._forced(element, moving)
                    still, known = self._forced(element, resting)
                except (ArithmeticError, ValueError):
                    return False
                pushed[columns] += F - still
                unsure[columns] += np.where(F - still, error + known, 0.0)
            left, rounding = pushed @ allowed, unsure @ np.abs(allowed)
            if np.any(np.abs(left) > ROUNDINGS * rounding):
                return False
        return True

    def conserves(self, field: Field) -> bool:
        """Whether the momentum along a symmetry is the same along every motion."""
        return all(e.inertia or self._idle(e, field) for e in self.elements) and self._horizontal(field)

    def _idle(self, element: Acting, field: Field) -> bool:
        """Whether an element does no work along a field, whatever the state."""
        if not element.analytic and any(field.field(self.motion.q)[i] for i in element.columns):
            return False
        for state in self.states:
            Y = field.field(state.q)
            if not any(Y[i] for i in element.columns):
                continue
            if element.written and not _exact(field):
                F, error = self.bounded(element, state)
                if abs(float(Y @ F)) > float(np.abs(Y) @ (error + ROUNDINGS * EPS * np.abs(F))):
                    return False
                continue
            with Digits(element, exact=_exact(field)) as f:
                force = element.force(
                    numbers(state.q, f), numbers(state.u, f), numbers(state.a, f), self.motion.time, f
                )
                work = [x * f.number(repr(float(Y[i]))) for i, x in zip(element.columns, force, strict=True)]
                limit = EXACT if f.name == "mpmath" else CARRIED
                if abs(sum(work)) > limit * sum(abs(x) for x in work):
                    return False
        return True

    def _horizontal(self, field: Field) -> bool:
        """Whether no constraint row resists a field, at all states that satisfy the rows."""
        if not self.system.n_c or not self.seen:
            return self.seen
        sizes = self.motion.sizes
        for state in self.on_rows:
            J = self.system.dynamics(state.q, state.u, self.motion.time).J
            Y = field.field(state.q)
            if np.any(np.abs(J @ Y) > ON_ROWS * (np.abs(J) @ sizes) * float(np.max(np.abs(Y / sizes)))):
                return False
        return True

    # --- one group --------------------------------------------------------------------------------------------------

    def carries(self, field: Field) -> bool:
        """Whether a group carries all motions into motions."""
        try:
            if not self._allowed(field) or not self._rows_carried(field):
                return False
            seen = [e for e in self.elements if not self._unseen(e, field)]
            if not seen:
                return True
            images = [self._moved(field, state) for state in self.states]
            broken = [e for e in seen if not self._carried(e, images, exact=_exact(field))]
            return self._near_too(seen, field) and (not broken or self._together(broken, field))
        except (MbstabError, ArithmeticError, ValueError, np.linalg.LinAlgError):
            return False

    def _near_too(self, seen: list[Acting], field: Field) -> bool:
        """Whether small steps of a shift carry what is written as well: it may be flat but for a narrow range."""
        written = [e for e in seen if e.written]
        if not written or not isinstance(field, Shift):
            return True
        for part in PARTS[1:]:
            images = [self._moved(replace(field, step=part * field.step), state) for state in self.states]
            if not all(self._carried(e, images, exact=_exact(field)) for e in written):
                return False
        return True

    def steady(self, generator: Generator) -> bool:
        """Whether going along a steady motion carries all motions into motions."""
        # Generators are equal where they move the reference alike.
        key = generator.field(self.motion.q).tobytes() + np.array([generator.rate, *generator.axis]).tobytes()
        if key not in self._steady:
            self._steady[key] = self.carries(self.along(generator))
        return self._steady[key]

    def along(self, generator: Generator) -> Field:
        """Return the group of a steady motion, with a step that shows."""
        span = self._span(generator)
        if generator.turns:
            return Turn(generator, span)
        direction = generator.field(self.motion.q)
        largest = float(np.max(np.abs(direction)))
        whole = _whole(direction / largest)
        return Shift(whole, span * largest / float(np.max(np.abs(whole))))

    def _span(self, generator: Generator) -> float:
        """Return a time in which a steady motion goes far enough to show (s)."""
        direction = np.abs(generator.field(self.motion.q))
        span = ANGLE / (float(np.max(direction / self.motion.sizes)) or self.rate)
        largest = float(np.max(direction)) or 1.0
        return _short(span * largest) / largest

    def _allowed(self, field: Field) -> bool:
        """Whether the constraints allow the disturbance of the reference to first order."""
        motion, system = self.motion, self.system
        if not system.n_c:
            return True
        Y, n_h = field.field(motion.q), system.n_h
        J = motion.dynamics.J
        size = float(np.max(np.abs(Y / motion.sizes))) or 1.0
        return bool(np.all(np.abs(J[:n_h] @ Y) <= FIRST_ORDER * size * (np.abs(J[:n_h]) @ motion.sizes) + 1e-300))

    def _unseen(self, element: Acting, field: Field) -> bool:
        """Whether an element contains none of the coordinates that a shift changes."""
        if not isinstance(field, Shift):
            return False
        return not any(field.direction[j] for _, j in element.slots)

    def _carried(self, element: Acting, images: list[tuple[State, Array]], exact: bool) -> bool:
        """Whether an element does the same at all states, moved along."""
        if not self.states or not element.analytic:
            return False
        pairs = zip(self.states, images, strict=True)
        return all(self.same(element, state, there, T, exact) for state, (there, T) in pairs)

    def _force(self, element: Acting, state: State) -> Array:
        """Return the force of one element on all coordinates, shape (n_q,)."""
        F: Array = np.zeros(self.system.n_q)
        F[list(element.columns)] = element.force(state.q.tolist(), state.u.tolist(), state.a.tolist(), self.motion.time)
        return F

    def same(self, element: Acting, here: State, there: State, T: Array, exact: bool) -> bool:
        """Whether Tᵀ F(there) = F(here) for one element."""
        columns, time = list(element.columns), self.motion.time
        signs = np.diag(T)[columns]
        if exact and element.written and np.array_equal(T[np.ix_(columns, columns)], np.diag(np.sign(signs))):
            with Digits(element, exact=True) as f:
                first, second = (
                    element.force(numbers(x.q, f), numbers(x.u, f), numbers(x.a, f), time, f) for x in (here, there)
                )
                pairs = zip(first, second, signs.tolist(), strict=True)
                return all(abs(x - sign * y) <= EXACT * (abs(x) + abs(y)) for x, y, sign in pairs)
        if element.written:
            return self._same_to_rounding(element, here, there, T)
        F, moved = (self._force(element, x) for x in (here, there))
        rows = T[columns]  # the element has no force on others
        after: Array = moved[columns] @ rows
        mixed: Array = np.abs(moved[columns]) @ np.abs(rows)
        sizes = self.motion.sizes
        total = float(np.max((np.abs(F) + mixed) * sizes))
        allowed = CARRIED * np.maximum(np.abs(F), np.abs(after)) + CANCELLED * total / sizes
        off = np.abs(F - after)
        if np.all(off <= allowed):
            return True
        # Where a force is a small difference, the rounding of coordinates and speeds counts.
        rounding = self._rounding(element, here) + np.abs(T).T @ self._rounding(element, there)
        spread = float(np.max(rounding * sizes)) / sizes
        return bool(np.all(off <= allowed + CANCELLED * spread))

    def _same_to_rounding(self, element: Acting, here: State, there: State, T: Array) -> bool:
        """Whether Tᵀ F(there) = F(here) to rounding, which is followed through what is written."""
        sizes, size = self.motion.sizes, np.abs(T)
        F, error = self.bounded(element, here)
        # What leads there is computed to some roundings of what it is computed from.
        spread = State(
            ROUNDINGS * EPS * (np.abs(there.q) + size @ (np.abs(here.q) + sizes)),
            ROUNDINGS * EPS * (size @ np.abs(here.u)),
            ROUNDINGS * EPS * (np.abs(there.a) + size @ np.abs(here.a)),
        )
        moved, moved_error = self.bounded(element, there, spread)
        allowed = error + size.T @ (moved_error + ROUNDINGS * EPS * np.abs(moved))
        return bool(np.all(np.abs(F - T.T @ moved) <= allowed))

    def bounded(self, element: Acting, state: State, spread: State | None = None) -> tuple[Array, Array]:
        """Return the force of an element at a state, and how far it may be off, shapes (n_q,) each.

        Parameters
        ----------
        spread : State, optional
            How far the state may be off.
        """
        F, error = np.zeros((2, len(state.q)))
        columns = list(element.columns)
        F[columns], error[columns] = self._forced(element, _rounded(state, spread))
        return F, error

    def _forced(self, element: Acting, state: tuple[Numbers, Numbers, Numbers]) -> tuple[Array, Array]:
        """Return the force of an element on its columns, and how far it may be off, at q, u and a with their errors."""
        force = element.force(*state, self.motion.time, rounded_arithmetic())
        return np.array([float(x) for x in force]), np.array([x.e if isinstance(x, Rounded) else 0.0 for x in force])

    def _rounding(self, element: Acting, state: State) -> Array:
        """Return what a change of coordinates and speeds by all their size makes of an element."""
        columns = list(element.columns)
        q, u = np.maximum(np.abs(state.q), self.motion.sizes)[columns], np.abs(state.u)[columns]
        result: Array = np.zeros(len(state.q))
        K, R = (np.abs(np.array(x, dtype=float)) for x in self._slopes(element, state))
        result[columns] = K @ q + R @ u
        return result

    def _slopes(self, element: Acting, state: State) -> Any:
        """Return ∂F/∂q and ∂F/∂u of an element at a state, on its columns."""
        return element.slopes(state.q.tolist(), state.u.tolist(), state.a.tolist(), self.motion.time)

    def _moved(self, field: Field, state: State) -> tuple[State, Array]:
        """Return where a group leads a state, with the speeds and accelerations of motions that are carried along."""
        q, T = field.moved(state.q)
        if isinstance(field, OwnTurn):
            a = T @ state.a
            angle, places = field.part.stop - 1, slice(field.part.start, field.part.stop - 1)
            a[places] += (field._lever(q[angle]) - field._lever(state.q[angle])) * state.u[angle] ** 2
            return State(q, T @ state.u, a), T
        a = T @ state.a if isinstance(field, Shift) else self.accelerations(state, q, T)
        return State(q, T @ state.u, a), T

    def accelerations(self, state: State, moved: Array, T: Array) -> Array:
        """Return the accelerations of a motion through a state, carried along by a map with the derivative T."""
        a: Array = T @ state.a
        for body, part in zip(self.system.scene.bodies, self.system.body_slices, strict=True):
            if body.orientation and self.system.scene.dimension == 3:
                # Euler angles change nonlinearly: the angular accelerations, G a + Ġ u, are what turns.
                angles = slice(part.start + 3, part.stop)
                G, G_before = rate_matrix(body, moved[angles]), rate_matrix(body, state.q[angles])
                turn = G @ T[angles, angles] @ np.linalg.inv(G_before)
                rates = T[angles, angles] @ state.u[angles]
                drift = turn @ rate_drift(body, state.q[angles], state.u[angles]) - rate_drift(
                    body, moved[angles], rates
                )
                a[angles] += np.linalg.solve(G, drift)
        return a

    def _rows_carried(self, field: Field) -> bool:
        """Whether states that satisfy the rows are led to states that do."""
        if not self.system.n_c or not self.seen:
            return self.seen
        for state in self.on_rows:
            q, T = field.moved(state.q)
            if not self.satisfies(q, T @ state.u):
                return False
        return True

    def _together(self, broken: list[Acting], field: Field) -> bool:
        """Whether elements that a group changes are unchanged together, along all motions that the rows allow."""
        if not self.system.n_c or any(e.written for e in broken) or len(self.on_rows) < 2:
            return False
        system, time = self.system, self.motion.time
        # At rest too: dampers that are moved fast would hide weak springs.
        moving = self.on_rows
        for state in [*(State(x.q, 0.0 * x.u, 0.0 * x.a) for x in moving), *moving]:
            there, T = self._moved(field, state)
            J = system.dynamics(state.q, state.u, time).J * self.motion.sizes
            lengths = np.linalg.norm(J, axis=1) + 1e-300
            _, s, right = np.linalg.svd(J / lengths[:, None])
            allowed = self.motion.sizes[:, None] * right[int(np.sum(s > 1e-8)) :].T
            total, size, rounding = np.zeros((3, allowed.shape[1]))
            for element in broken:
                F, moved = (self._force(element, x) for x in (state, there))
                after: Array = T.T @ moved
                change = (after - F) @ allowed
                total += change
                size += np.abs(change)
                load = float(np.max((np.abs(F) + np.abs(after)) * self.motion.sizes))
                rounding += load * np.max(np.abs(allowed) / self.motion.sizes[:, None], axis=0)
            if np.any(np.abs(total) > ON_ROWS * size + CANCELLED * rounding):
                return False
        return True

    def keeps_time(self, generator: Generator) -> str:
        """Return the first entry that a steady motion does not carry into itself at later times; empty: none.

        For equations that contain the time in drives: they stand still in the frame of the motion if
        going along with it for a while is the same as waiting.
        """
        field, span = self.along(generator), self._span(generator)
        later = self.motion.time + span
        images = [self._moved(field, state) for state in self.states]
        for element in self.elements:
            if not self._unseen(element, field) and not self._carried(element, images, exact=_exact(field)):
                return element.path
        for state in self.on_rows:
            q, T = field.moved(state.q)
            if not self.satisfies(q, T @ state.u, later):
                return "the constraints"
        return ""

    # --- candidates -------------------------------------------------------------------------------------------------

    def _candidates(self) -> Iterator[tuple[str, Field]]:
        """Yield the groups worth trying, the simplest first."""
        yield from self._shifts()
        system = self.system
        for name, axis, point in self._axes():
            yield name, Turn(Generator(system, axis, point, 1.0, np.zeros(3), np.zeros(system.n_q)), ANGLE)
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

    def _shifts(self) -> Iterator[tuple[str, Field]]:
        """Yield constant shifts that the equations do not see at the reference: named ones, then their combinations."""
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
        for direction in _echelon(left.T[: int(np.sum(s > 1e-6))] * sizes):
            size = np.abs(direction)
            strong = [n for n, x in zip(system.names, size, strict=True) if x > 0.3 * np.max(size)]
            yield "joint shift of " + ", ".join(strong[:4]), self._shift(direction)

    def _shift(self, direction: Array) -> Shift:
        """Return the shift along a direction by a step that shows."""
        step = ANGLE * float(np.min(self.motion.sizes[direction != 0.0] / np.abs(direction[direction != 0.0])))
        return Shift(direction, _short(step))

    def _named_shifts(self, null: Array) -> Iterator[tuple[str, Array]]:
        """Yield shifts of everything along an axis, and of single coordinates, that lie in a space of shifts."""
        names, sizes = self.system.names, self.motion.sizes

        def inside(direction: Array) -> bool:
            scaled = direction / sizes / np.linalg.norm(direction / sizes)
            return bool(np.linalg.norm(scaled - null @ (null.T @ scaled)) < 1e-7)

        single = np.linalg.norm(np.eye(len(names)) - null @ null.T, axis=0) < 1e-7
        for axis in "xyz":
            along = np.array([name.endswith(f".{axis}") for name in names])
            # Where each may be shifted by itself, all of them together say less.
            if np.sum(along) > 1 and not np.all(single[along]) and inside(along.astype(float)):
                yield f"translation along {axis}", along.astype(float)
        for i in np.flatnonzero(single):
            direction = np.zeros(len(names))
            direction[i] = 1.0
            yield names[i], direction

    def _blind(self) -> Array:
        """Return what constant shifts neither the forces nor the rows see at some states, as orthonormal columns."""
        system, sizes = self.system, self.motion.sizes
        blocks = []
        for state in self.on_rows:
            dynamics = system.dynamics(state.q, state.u, self.motion.time)
            still = np.zeros(system.n_c)
            K, _, D_q = system.linearize(state.q, state.u, state.a, still, self.motion.time)
            rows = np.vstack([dynamics.J[: system.n_h], D_q]) * sizes
            blocks.append(rows[np.linalg.norm(rows, axis=1) > 0.0])
            # What acts along the rows only is balanced by reactions.
            J = dynamics.J * sizes
            J = J[np.linalg.norm(J, axis=1) > 0.0]
            J = J / np.linalg.norm(J, axis=1)[:, None]
            forces = (K * sizes) * sizes[:, None]
            if len(J):
                forces = forces - np.linalg.pinv(J, rcond=1e-10) @ (J @ forces)
            lengths = np.linalg.norm(forces, axis=1)
            total = float(np.max(np.abs(K * sizes * sizes[:, None]), initial=0.0))
            blocks.append(forces[lengths > 1e-9 * total])
        stacked = np.vstack(blocks) if blocks else np.zeros((0, system.n_q))
        if not len(stacked):
            return np.eye(system.n_q)
        stacked = stacked / np.linalg.norm(stacked, axis=1)[:, None]
        _, s, right = np.linalg.svd(stacked)
        result: Array = right[int(np.sum(s > 1e-8 * max(1.0, s[0]))) :].T
        return result

    def _axes(self) -> Iterator[tuple[str, Array, Array]]:
        """Yield the rotations worth trying: name, axis and a point of it."""
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
        return found[:POINTS]

    def _ground_axes(self) -> list[Array]:
        """Return the axes of joints with the ground."""
        found = []
        for item in self.system.scene.items:
            if item.entry.section == "joints" and item.given("axis"):
                sides = zip(item.markers("between"), item.triads("axis", "zero"), strict=True)
                found += [np.array([float(x) for x in triad.v1]) for marker, triad in sides if marker.body == GROUND]
        return found[:POINTS]


def _own_axes(body: Any) -> list[Array]:
    """Return axes through the place of a body about which turning it changes nothing of its inertia, apart from z."""
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
    # The last Euler angle turns a body about its z axis.
    return [x for x in found if abs(abs(x[2]) - 1.0) > 1e-12 and not np.any(np.cross(x, center))]


def _general(element: Acting) -> Acting:
    """Return an element that is written in the file with parameters a little off, each by itself.

    What holds only because two of them round to the same number is no structure.
    """
    if not element.written:
        return element
    rng = np.random.default_rng(len(element.placed.parameters))
    parameters = tuple(x * (1.0 + OFF * rng.uniform(0.5, 1.0)) for x in element.placed.parameters)
    return replace(element, placed=replace(element.placed, parameters=parameters))


def _exact(field: Field) -> bool:
    """Whether steps along a field are exact, so that expressions can be compared with many digits."""
    if isinstance(field, Combination):
        return all(isinstance(part, Shift) and c.is_integer() and _exact(part) for c, part in field.parts)
    return isinstance(field, Shift) and bool(np.array_equal(field.direction, np.round(field.direction)))


def _weighted(weights: list[Any], column: Any) -> tuple[Any, Any]:
    """Return a weighted sum and the sum of the sizes of its terms."""
    terms = [w * x for w, x in zip(weights, column, strict=True)]
    return sum(terms), sum(abs(x) for x in terms)


def _short(step: float) -> float:
    """Return a step of about a size with few digits, so that sums are exact, but no number that a model would contain.

    By a step of two lengths a spring is led through its end to where its force is the same.
    """
    return UNEVEN * 2.0 ** math.floor(math.log2(step))


def _on_grid(x: Array, sizes: Array) -> Array:
    """Return numbers with so few digits that sums of them are exact: expressions are compared with many digits."""
    grid = 2.0 ** (np.floor(np.log2(sizes)) - GRID)
    result: Array = np.round(x / grid) * grid
    return result


def _echelon(rows: Array) -> list[Array]:
    """Return a basis of the span of rows with as many zeros as elimination makes, in whole numbers where it can be.

    Expressions are compared with many digits: a direction that is known to 16 is none for them.
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
    return [_whole(np.where(np.abs(row) > 1e-12, row, 0.0)) for row in A]


def _whole(direction: Array) -> Array:
    """Return a multiple of a direction in whole numbers, if the ratios of its entries are small fractions."""
    if np.array_equal(direction, np.round(direction)):
        return direction
    parts = [Fraction(float(x)).limit_denominator(MOST_DENOMINATOR) for x in direction]
    if any(abs(float(part) - x) > 1e-12 for part, x in zip(parts, direction, strict=True)):
        return direction
    common = math.lcm(*(part.denominator for part in parts))
    return np.array([float(part * common) for part in parts])


class Digits:
    """The arithmetic in which an element is asked: many digits for expressions, floats for the others."""

    def __init__(self, element: Acting, exact: bool = True) -> None:
        self.exact = exact and element.written

    def __enter__(self) -> Any:
        if not self.exact:
            return FLOAT
        from mpmath import mp

        self.before, mp.dps = mp.dps, DIGITS
        return mpmath_arithmetic()

    def __exit__(self, *_: object) -> None:
        if self.exact:
            from mpmath import mp

            mp.dps = self.before


def numbers(x: Array, f: Any) -> list[Any]:
    """Return floats as exact numbers of an arithmetic."""
    return [f.number(value) for value in x.tolist()]
