"""What the elements of a scene do at states spread over it, compared before and after a motion of a group."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from mbstab.analysis.algebra.arrays import Flags, RandomNumbers, least_squares
from mbstab.analysis.algebra.ball_arrays import BALLS, as_ball, many_bits
from mbstab.analysis.algebra.rounded import Rounded, rounded_arithmetic
from mbstab.analysis.algebra.sparse import is_sparse, largest, row_norms, scaled
from mbstab.analysis.algebra.tolerances import EPS
from mbstab.analysis.reference.imbalance import carrying
from mbstab.analysis.reference.motion import Motion
from mbstab.analysis.reference.rounded_scene import without_chance_zeros
from mbstab.analysis.reference.tolerances import TOLERANCES
from mbstab.compiler.placed import Acting
from mbstab.compiler.system import Array, Dynamics, System
from mbstab.errors import MbstabError
from mbstab.mechanics.catalogue import ROWS
from mbstab.model.dependencies import expressions_in
from mbstab.records import dataclass


@dataclass(frozen=True)
class State:
    """Coordinates, speeds and accelerations at which elements are compared."""

    q: Array
    u: Array
    a: Array


@dataclass(frozen=True)
class OnRows(State):
    """A state that satisfies the constraint rows, with the matrices there."""

    dynamics: Dynamics


Numbers = list[float | Rounded]


def with_errors(state: State, spread: State | None = None) -> tuple[Numbers, Numbers, Numbers]:
    """Return q, u and a of a state with their error bounds."""
    if spread is None:
        return state.q.tolist(), state.u.tolist(), state.a.tolist()
    pairs = ((state.q, spread.q), (state.u, spread.u), (state.a, spread.a))
    q, u, a = ([Rounded(v, e) if e else v for v, e in zip(x.tolist(), dx.tolist(), strict=True)] for x, dx in pairs)
    return q, u, a


class ElementComparison:
    """What the elements of a scene do at states spread over it, and when that is the same."""

    def __init__(self, system: System, motion: Motion) -> None:
        self.system, self.motion = system, motion
        self.elements = [_general(element) for element in without_chance_zeros(system).acting()]

    @cached_property
    def rate(self) -> float:
        """A characteristic rate of the scene (1/s)."""
        return self._rate_of(np.ones(len(self.motion.q), dtype=bool))

    @cached_property
    def rate_of_states(self) -> float:
        """The same without inertias so small that forces on others do not show beside those of their fast motions."""
        if self.system.sparse:
            return self.rate
        inertias = np.diagonal(self.motion.dynamics.M) * self.motion.sizes**2
        heavy = inertias >= TOLERANCES.inertia_of_states * np.max(inertias, initial=0.0)
        return self.rate if np.all(heavy | (inertias <= 0.0)) else self._rate_of(heavy)

    def _rate_of(self, coordinates: Flags) -> float:
        motion = self.motion
        K, R = self.slopes_there
        # States may be in any unit.
        scale = np.where(coordinates, motion.spaces.scale, 0.0)
        scale[self.system.states[0]] = 0.0
        K, R = (largest(scaled(x, scale, scale)) for x in (K, R))
        sizes = float(np.max(np.abs(motion.u) / motion.sizes)), K**0.5, R
        # Where nothing acts and nothing moves, moving surfaces give the only rate.
        return max(sizes) or self._surface_rate or 1.0

    @cached_property
    def slopes_there(self) -> tuple[Any, Any]:
        """K = ∂F/∂q and R = ∂F/∂u at the reference."""
        motion = self.motion
        return self.system.linearize(motion.q, motion.u, motion.a, motion.nu, motion.time)[:2]

    @property
    def _surface_rate(self) -> float:
        size = abs(self.motion.dynamics.J[self.system.n_h :]) @ self.motion.sizes
        return float(np.max(self._carrying / size, initial=0.0))

    @cached_property
    def states(self) -> list[State]:
        """States off the constraints at which all elements have a value: at rest, in motion, accelerating.

        None at all where there are too few: nothing may be concluded then.
        """
        motion, sizes = self.motion, self.motion.sizes
        for spread in TOLERANCES.state_spreads:
            rng = RandomNumbers(11)
            found = []
            # The reference itself and its neighbourhood too: functions may be flat elsewhere.
            for part, moves, accelerates in (
                (0.0, 0.0, 0.0),  # where strong terms vanish, weak ones show
                (1.0, 0.0, 0.0),
                (1.0, 1.0, 0.0),
                (1.0, 1.0, 1.0),
                (0.0, 1.0, 0.0),
                (TOLERANCES.state_surroundings, 1.0, 0.0),
            ):
                q, u, a = (spread * sizes * rng.uniform(-1.0, 1.0, len(sizes)) for _ in range(3))
                q, u = _on_grid(motion.q + part * q, sizes), moves * (motion.u + self.rate_of_states * u)
                u = _on_grid(u, self.rate_of_states * sizes)
                found.append(State(q, u, accelerates * (motion.a + self.rate_of_states**2 * a)))
            good = [self._has_value(state) for state in found]
            # Forces such as those of tyres have no value at rest.
            if all(has or (not np.any(x.u) and not motion.at_rest) for x, has in zip(found, good, strict=True)):
                return [x for x, has in zip(found, good, strict=True) if has]
        return []

    def _has_value(self, state: State) -> bool:
        """Whether all elements have a value at a state."""
        q, u, a = (x.tolist() for x in (state.q, state.u, state.a))
        try:
            for element in self.elements:
                element.force(q, u, a, self.motion.time)
        except (ArithmeticError, ValueError):
            return False
        return True

    @cached_property
    def on_rows(self) -> list[OnRows]:
        """States that satisfy the constraints, spread around the reference; the reference itself comes first."""
        motion = self.motion
        found = [OnRows(motion.q, motion.u, motion.a, motion.dynamics)]
        if not self.system.n_c:
            others = self.states[1:]
            return found + [OnRows(x.q, x.u, x.a, self.system.dynamics(x.q, x.u, motion.time)) for x in others]
        rng = RandomNumbers(5)
        # Functions may be flat but near the reference.
        for part in (1.0, 1.0, TOLERANCES.near_rows):
            for spread in TOLERANCES.state_spreads:
                state = self.projected(rng, part * spread)
                if state is not None:
                    found.append(state)
                    break
        return found

    @cached_property
    def seen(self) -> bool:
        """Whether there are states other than the reference at which constraint rows can be tested."""
        if not self.system.n_c or not self.motion.spaces.N.shape[1]:
            return True
        rows = (item for item in self.system.scene.items if item.kind.written in ROWS)
        pieced = any(
            expression.pieced(self.system.names) for item in rows for expression in expressions_in(item.entry.values)
        )
        return len(self.on_rows) > 1 and not pieced

    @cached_property
    def rows_of_places(self) -> bool:
        """Whether rows contain coordinates alone, so that their rates are J(q) u: no speeds and no time."""
        system, scene = self.system, self.system.scene
        if system.n_n or scene.timed or scene.balances:
            return False
        written = (item for item in scene.items if item.kind.written in ROWS)
        return not any(x.rates() for item in written for x in expressions_in(item.entry.values))

    def projected(self, rng: RandomNumbers, spread: float) -> OnRows | None:
        """Return a state near a random one that satisfies the constraints, or None if there is none."""
        motion, sizes = self.motion, self.motion.sizes
        q = motion.q + spread * sizes * rng.uniform(-1.0, 1.0, len(sizes))
        u = motion.u + self.rate_of_states * spread * sizes * rng.uniform(-1.0, 1.0, len(sizes))
        return self.onto_rows(q, u)

    @cached_property
    def agreed(self) -> float:
        """How well the rows hold, relative to the sizes in the scene; redundant ones only as well as they agree."""
        motion, n_h = self.motion, self.system.n_h
        if motion.spaces.C.rank == n_h:
            return TOLERANCES.row_residual
        if is_sparse(motion.dynamics.J):
            return max(TOLERANCES.row_residual, TOLERANCES.repeated_row_misfit * motion.spaces.C.largest_dropped)
        J = motion.dynamics.J[:n_h] * motion.sizes
        s = np.linalg.svd(J / (np.linalg.norm(J, axis=1) + 1e-300)[:, None], compute_uv=False)
        return max(
            TOLERANCES.row_residual,
            TOLERANCES.repeated_row_misfit * float(np.max(s[motion.spaces.C.rank :], initial=0.0)),
        )

    def onto_rows(self, q: Array, u: Array, within: float | None = None, time: float | None = None) -> OnRows | None:
        """Return the state nearest to a given one that satisfies the constraints, or None if there is none."""
        system, sizes = self.system, self.motion.sizes
        time = self.motion.time if time is None else time
        n_h = system.n_h
        try:
            for _ in range(TOLERANCES.newton_steps_onto_rows if n_h else 0):
                state = system.closing.dynamics(q, 0.0 * u, time)
                shortest = self._shortest(state.J[:n_h])
                step = shortest(-state.E[:n_h])
                if float(np.max(np.abs(step))) > 4.0:
                    return None
                q = q + sizes * step
                if float(np.max(np.abs(step))) < TOLERANCES.settled_onto_rows:
                    break
            # Rows are linear in the speeds, up to slips.
            for _ in range(TOLERANCES.newton_steps_onto_rows if system.n_n else 2 * bool(n_h)):
                state = system.dynamics(q, u, time)
                if system.n_n:
                    shortest = self._shortest(state.J)
                change = sizes * shortest(-state.V)
                u = u + change
                if np.all(np.abs(change) <= 1e-13 * np.max(np.abs(u / sizes)) * sizes):
                    break
            state = system.dynamics(q, u, time)
        except (MbstabError, ValueError, RuntimeError, np.linalg.LinAlgError):
            return None
        return OnRows(q, u, 0.0 * u, state) if self._holds(state, u, within) else None

    def _shortest(self, J: Any) -> Callable[[Array], Array]:
        """Return what gives the shortest x, in sizes of the scene, with J x = b, as nearly as can be."""
        J = scaled(J, self.motion.sizes)
        lengths = row_norms(J) if is_sparse(J) else np.linalg.norm(J, axis=1) + 1e-300
        unit = scaled(J, np.ones(len(self.motion.sizes)), 1.0 / lengths)
        # Redundant rows are nearly so beside the constraints, and would magnify rounding.
        redundant = {id(item.row) for item in self.motion.redundant}
        kept = [i for i, row in enumerate(self.system.rows[: len(lengths)]) if id(row) not in redundant]
        unit = unit[kept] if redundant else unit
        if not is_sparse(J):
            return lambda b: np.asarray(least_squares(unit, (b / lengths)[kept], rcond=1e-10))
        from mbstab.analysis.algebra.sparse_rank import Rows

        rows = Rows(unit)
        return lambda b: rows.shortest((b / lengths)[kept])

    def satisfies(self, q: Array, u: Array, time: float | None = None) -> bool:
        """Whether a state satisfies the constraint rows."""
        if not self.system.n_c:
            return True
        return self._holds(self.system.dynamics(q, u, self.motion.time if time is None else time), u)

    def keeps_rows(self, at: State, q: Array, later: float) -> bool:
        """Return whether the rows have the same residuals at other coordinates and a later time as at a state."""
        if not self.system.n_c:
            return True
        here = self.system.dynamics(at.q, at.u, self.motion.time)
        there = self.system.dynamics(q, at.u, self.motion.time + later)
        return self._holds(replace(there, E=there.E - here.E, V=there.V - here.V), at.u)

    def _holds(self, state: Dynamics, u: Array, within: float | None = None) -> bool:
        """Return whether the constraint rows hold, given their residuals."""
        motion, n_h = self.motion, self.system.n_h
        allowed = (self.agreed if within is None else within) * abs(state.J) @ motion.sizes + 1e-300
        fastest = max(float(np.max(np.abs(u / motion.sizes))), TOLERANCES.resting_speed * self.rate)
        speeds = allowed * fastest
        if self.system.n_n:
            # What moves under resting bodies, as a turntable does, rounds with its own speed.
            speeds[n_h:] += (TOLERANCES.row_residual if within is None else within) * self._carrying
        return bool(np.all(np.abs(state.E[:n_h]) <= allowed[:n_h]) and np.all(np.abs(state.V) <= speeds))

    @cached_property
    def _carrying(self) -> Array:
        motion = self.motion
        return carrying(self.system, (motion.q, motion.u), motion.time, motion.sizes)[self.system.n_h :]

    def same(self, element: Acting, here: State, there: State, T: Array, exact: bool) -> bool:
        """Whether Tᵀ F(there) = F(here) for one element.

        A state that T reaches is known to a few roundings of the numbers of which it is computed, or, if `exact`, as it
        is where T only changes signs.
        """
        columns, time, size = list(element.columns), self.motion.time, np.abs(T)
        signs = np.diag(np.sign(T.diagonal()[columns]))
        plain = exact and element.written and np.array_equal(T[np.ix_(columns, columns)], signs)
        rounded = 0.0 if plain else TOLERANCES.roundings_of_comparison * EPS
        errors = [
            rounded * x
            for x in (
                np.abs(there.q) + size @ (np.abs(here.q) + self.motion.sizes),
                size @ np.abs(here.u),
                np.abs(there.a) + size @ np.abs(here.a),
            )
        ]
        with many_bits():
            left, moved = BALLS.zeros((len(T),)), BALLS.zeros((len(T),))
            q, u, a = (BALLS.of(x) for x in (here.q, here.u, here.a))
            left[columns] = element.force(q, u, a, time, BALLS.f)
            q, u, a = (BALLS.within(x, e) for x, e in zip((there.q, there.u, there.a), errors, strict=True))
            moved[columns] = element.force(q, u, a, time, BALLS.f)
            # T is rounded, too, and levers in it may cancel.
            levers = self.motion.sizes[:, None] / self.motion.sizes
            turned = T.T if plain else BALLS.within(T.T, rounded * np.maximum(size, levers).T)
            left = left - BALLS.multiplied(BALLS.prepared(turned), moved[:, None])[:, 0]
            return all(as_ball(x).contains(0) for x in left)

    def forced(self, element: Acting, state: tuple[Numbers, Numbers, Numbers]) -> tuple[Array, Array]:
        """Return the force of an element on its columns and its error bound, at q, u and a with their error bounds."""
        force = element.force(*state, self.motion.time, rounded_arithmetic())
        return np.array([float(x) for x in force]), np.array([x.e if isinstance(x, Rounded) else 0.0 for x in force])


def _general(element: Acting) -> Acting:
    """Return an element with each of the parameters in its expressions perturbed a little by itself.

    A symmetry that holds only because two parameters round to the same number is not structure.
    """
    if not element.written:
        return element
    named, others = element.placed.parameters[: element.placed.named], element.placed.parameters[element.placed.named :]
    rng = RandomNumbers(len(named))
    offsets = (TOLERANCES.parameter_offset * float(rng.uniform(0.5, 1.0)) for _ in named)
    parameters = (*(x * (1.0 + offset) for x, offset in zip(named, offsets, strict=True)), *others)
    return replace(element, placed=replace(element.placed, parameters=parameters))


def _on_grid(x: Array, sizes: Array) -> Array:
    """Return numbers rounded to so few digits that their sums are exact: expressions are compared with many digits."""
    grid = 2.0 ** (np.floor(np.log2(sizes)) - TOLERANCES.state_bits)
    result: Array = np.round(x / grid) * grid
    return result
