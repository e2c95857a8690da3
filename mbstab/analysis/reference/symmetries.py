"""Symmetries of the equations of a scene, element by element: the structure that verdicts rest on.

A symmetry maps *all* motions near the reference to motions, not only those of the linearized
equations. It counts if every element has it by itself, nonlinearly: either the element does not
contain the coordinate at all (structure), or element(g state) = g element(state) holds
for large g at states spread over the scene, relative to the force of the element itself, at rest and
in motion: a weak force shows beside a strong damper. Elements that are written as expressions are
compared with 40 digits. Constraint rows count as a set: g must map states that satisfy them to
states that satisfy them.

Fields Y(q) generate the symmetries; a disturbance along one is (Δq, Δu) = (Y, DY u).
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from mbstab.analysis.algebra.arrays import least_squares
from mbstab.analysis.algebra.sparse import is_sparse, put, unchanged
from mbstab.analysis.algebra.tolerances import EPS
from mbstab.analysis.reference.element_comparison import Digits, State, numbers, steps_are_exact, with_errors
from mbstab.analysis.reference.fields import Combination, Field, Shift, Symmetry, Turn
from mbstab.analysis.reference.motion import Motion
from mbstab.analysis.reference.state_rows import states_follow, states_unmoved
from mbstab.analysis.reference.steady import Generator
from mbstab.analysis.reference.symmetry_candidates import UNEVEN, SymmetryCandidates, echelon, in_whole_numbers, short
from mbstab.analysis.reference.tolerances import TOLERANCES
from mbstab.compiler.placed import Acting
from mbstab.compiler.system import Array, System
from mbstab.errors import MbstabError


def symmetries(system: System, motion: Motion) -> list[Symmetry]:
    """Return independent symmetries of the scene that move the reference motion."""
    return Invariance(system, motion).symmetries


class Invariance(SymmetryCandidates):
    """Symmetries and conserved momenta of a scene; each part is computed at first use.

    Parameters
    ----------
    system : System
    motion : Motion
        The reference.
    """

    # --- states -----------------------------------------------------------------------------------------------------

    # --- symmetries -------------------------------------------------------------------------------------------------

    @cached_property
    def fields(self) -> list[tuple[str, Field]]:
        """All verified groups with their names, including those that do not move the reference."""
        q, sizes = self.motion.q, self.motion.sizes
        candidates = list(self._candidates())
        if self.isolated:
            # A symmetry that moved the reference would lead to other rests beside it.
            candidates = [x for x in candidates if np.all(np.abs(x[1].field(q)) < TOLERANCES.field_felt * sizes)]
        carried = self.passing([field for _, field in candidates], self.carries)
        found = [candidate for candidate, good in zip(candidates, carried, strict=True) if good]
        for generator in self.motion.generators:
            # The reference may follow several groups, of which the simplest need not be a symmetry.
            if any(isinstance(field, Turn) and field.generator.turns_as(generator) for _, field in found):
                self._steady[self._key(generator)] = True
            if generator.moves and self.steady(generator):
                return [*found, ("the motion itself", self.along(generator))]
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
            if length < TOLERANCES.field_felt:
                continue
            count = len(found)
            room[count] = vector / length
            # A field that shares no entry with earlier ones is independent of them, as with many free bodies.
            apart = not np.any(room[:count] @ room[count])
            if apart or np.linalg.svd(room[: count + 1], compute_uv=False)[-1] > TOLERANCES.independent_fields:
                found.append(Symmetry(name, direction, rate, field))
        return found

    def disturbance(self, direction: Array, rate: Array) -> Array:
        """Return (Δq, Δu) relative to the characteristic sizes."""
        sizes = self.motion.sizes
        return np.concatenate([direction / sizes, rate / (sizes * self.rate)])

    @cached_property
    def boosts(self) -> list[Symmetry]:
        """Shifts that may also be added to the speeds: another constant speed along them changes nothing else."""
        shifts = [item for item in self.symmetries if isinstance(item.of, Shift)]
        if self.system.sparse and shifts and self.states:
            felt = self._felt(np.array([item.direction for item in shifts]).T)
            shifts = [item for item, feels in zip(shifts, felt, strict=True) if not feels]
        good = self.passing([item.of for item in shifts], self._boosts)
        return [item for item, passes in zip(shifts, good, strict=True) if passes]

    def _felt(self, directions: Array) -> Any:
        """Return along which columns speeds change forces to first order, by more than rounding: no boosts."""
        state, time, none = self.states[-1], self.motion.time, np.zeros(self.system.n_c)
        R = self.system.linearize(state.q, state.u, state.a, none, time)[1]
        sizes = self.system.terms(state.q, state.u, state.a, none, time)["R"]
        return np.any(np.abs(R @ directions) > TOLERANCES.speed_felt * (sizes @ np.abs(directions)), axis=0)

    def _boosts(self, shift: Shift) -> bool:
        """Whether all elements and rows are blind to a common speed along a shift."""
        if not self.states:
            return False
        direction = shift.direction
        step = self.rate * float(self.motion.sizes.max()) * TOLERANCES.trial_move / float(np.max(np.abs(direction)))
        faster, identity = short(step) * direction, unchanged(len(direction))
        # Rows first: those of a rolling wheel see the speed at once, without an element.
        touched = self._containing(shift)
        try:
            if not all(self.satisfies(state.q, state.u + faster, part=touched) for state in self.on_rows):
                return False
        except MbstabError:  # rows with the slip of a tyre have no value at some speeds
            return False
        if not states_unmoved(self.system, self.on_rows, shift, self.motion.time):
            return False
        pairs = [(x, State(x.q, x.u + part * faster, x.a)) for x in self.states for part in TOLERANCES.trial_parts]
        for element in self.containing(shift):
            if not element.analytic or not all(self.same(element, *pair, identity, exact=True) for pair in pairs):
                return False
        return self._horizontal(shift)

    def _containing(self, field: Shift) -> System:
        """Return a system with only the rows that a shift changes; in a small scene with all rows."""
        if not self.system.sparse:
            return self.system
        return self.system.containing(field.changed)

    @cached_property
    def momenta(self) -> list[Symmetry]:
        """Momenta that are conserved: no force and no constraint does work along the symmetry.

        A wheel that rolls along a line conserves neither its momentum nor its spin, but a combination of both.
        """
        q, u = self.motion.q, self.motion.u
        kept = self.passing([item.of for item in self.symmetries], self.conserves)
        found = [item for item, good in zip(self.symmetries, kept, strict=True) if good]
        single = np.array([[float(item is other) for other in self.symmetries] for item in found])
        single = single.reshape(len(found), len(self.symmetries))
        for c in self._idle_combinations():
            chosen = [(float(x), item) for x, item in zip(c, self.symmetries, strict=True) if x]
            if np.linalg.norm(c - single.T @ (single @ c)) < TOLERANCES.independent_fields * np.linalg.norm(c):
                continue
            field = Combination(tuple((x, item.of) for x, item in chosen))
            if self.conserves(field):
                name = " with ".join(item.name for _, item in chosen)
                found.append(Symmetry(name, field.field(q), field.slope(q) @ u, field))
        return found

    @cached_property
    def integrals(self) -> list[Symmetry]:
        """Momenta that are conserved, also with a linear function of the coordinates added.

        Where the forces along a shift sum to the rate of such a function, as Coriolis forces
        do, the shift need not be a symmetry. The conserved quantity must not change along symmetries: this is
        the same everywhere if the symmetries are shifts.
        """
        known = self.momenta
        written = any(element.written for element in self.elements)
        if not written or not self.states or not all(isinstance(item.of, Shift) for item in self.symmetries):
            return known
        still, found = np.zeros(self.system.n_q), list(known)
        basis = [item.direction for item in known]
        for direction in echelon(self._balanced_shifts().T):
            field = self._shift(direction)
            new = np.linalg.matrix_rank(
                np.array([*basis, direction]) / self.motion.sizes, tol=TOLERANCES.independent_fields
            ) > len(basis)
            if new and self._total(field) and self._horizontal(field):
                names = [name for name, x in zip(self.system.names, direction, strict=True) if x]
                found.append(Symmetry(" with ".join(names), direction, still, field))
                basis.append(direction)
        return found

    def _balanced_shifts(self) -> Array:
        """Return the shifts along which no force depends on coordinates or speeds of symmetries, as columns."""
        system, sizes = self.system, self.motion.sizes
        if system.sparse:
            return np.zeros((system.n_q, 0))  # not searched in large scenes
        rows = [np.zeros((1, system.n_q))]
        Y = np.array([item.direction for item in self.symmetries]).reshape(-1, system.n_q).T
        for state in self.on_rows:
            K, R, _ = system.linearize(state.q, state.u, state.a, np.zeros(system.n_c), self.motion.time)
            parts = K.T * sizes, (R @ Y).T * sizes, state.dynamics.J * sizes
            rows += [x / (np.linalg.norm(x, axis=1, keepdims=True) + 1e-300) for x in parts]
        _, s, right = np.linalg.svd(np.vstack(rows))
        result: Array = right[int(np.sum(s > TOLERANCES.work_of_combination)) :].T * sizes[:, None]
        return result

    def _total(self, field: Shift) -> bool:
        """Return whether the total force along a shift is the rate of a linear function that no symmetry changes."""
        found = [self._rates(element, field) for element in self.elements]
        if any(rates is None for rates in found):
            return False
        limit = (
            TOLERANCES.force_change
            if any(not e.written and rates for e, rates in zip(self.elements, found, strict=True))
            else TOLERANCES.comparison_exact
        )
        from mpmath import mp

        with mp.workdps(TOLERANCES.comparison_digits):
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
        """Return c if the force of an element along a shift is c·u, with nothing for its inertia; None if it is not."""
        if not any(field.direction[i] for i in element.columns):
            return []
        if element.inertia:
            images = [self._moved(field, state) for state in self.states]
            return [] if self._unseen(element, field) or self._carried(element, images, exact=False) else None
        if not element.analytic or (element.written and not steps_are_exact(field)):
            return None
        found: list[tuple[Any, Any]] = []
        for state in self.states:
            with Digits(element, exact=steps_are_exact(field)) as f:
                limit = TOLERANCES.comparison_exact if f.name == "mpmath" else TOLERANCES.force_change
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
        """Return coefficients of the combinations of symmetries along which nothing seems to do work, as a basis."""
        fields = [item.of for item in self.symmetries]
        if not fields or not self.states:
            return []
        rows = []
        for there in self.on_rows if self.system.n_c else []:
            Y = np.array([field.field(there.q) for field in fields]).T
            J = there.dynamics.J
            rows += list((J @ Y) / (abs(J) @ np.abs(Y) + 1e-300).max(axis=1, keepdims=True))
        acting = [element for element in self.elements if not element.inertia]
        for state in self.states if acting else []:
            every = np.array([field.field(state.q) for field in fields])
            for element in acting:
                Y = every[:, list(element.columns)]
                force = np.array(element.force(state.q, state.u, state.a, self.motion.time), dtype=float)
                size = float(np.max(np.abs(Y) @ np.abs(force)))
                rows += [(Y @ force) / size] if size > 0.0 else []
        _, s, right = np.linalg.svd(np.array([*rows, np.zeros(len(fields))]))
        return echelon(right[int(np.sum(s > TOLERANCES.work_of_combination)) :])

    def moves_on(self, field: Field) -> bool:
        """Return whether a scene may move along a group at any speed: no force deflects it then."""
        motion = self.motion
        Y, slope = field.field(motion.q), field.slope(motion.q)
        slow = self.rate / float(np.max(np.abs(Y) / motion.sizes))
        spaces = motion.spaces
        allowed = spaces.scale[:, None] * spaces.allowed
        if not all(element.analytic for element in self.elements):
            return False
        rounded = TOLERANCES.roundings_of_comparison * EPS
        for speed in (UNEVEN * slow * x for x in TOLERANCES.trial_speeds):
            u, a = speed * Y, speed**2 * (slope @ Y)
            try:
                if not self.satisfies(self._followed(u), u):
                    return False
            except (MbstabError, np.linalg.LinAlgError):  # a load that follows the motion may be lost at other speeds
                return False
            turned = abs(slope) @ np.abs(Y) + motion.sizes * (self.rate / slow) ** 2
            off = rounded * np.abs(u), rounded * speed**2 * turned
            changed = (u != motion.u) | (a != motion.a) | np.any([x != 0.0 for x in off], axis=0)
            moving = with_errors(State(motion.q, u, a), State(0.0 * u, *off))
            # The reference itself is balanced; a tyre has no force at rest.
            known = rounded * self.rate**2 * motion.sizes
            own = np.where(np.abs(motion.a) <= known, 0.0, motion.a)
            spread = State(0.0 * u, rounded * np.abs(motion.u), rounded * np.abs(own))
            resting = with_errors(State(motion.q, motion.u, own), spread)
            pushed, unsure = np.zeros((2, len(u)))
            for element in self.elements:
                columns = list(element.columns)
                if not any(changed[j] for j in (*columns, *(j for _, j in element.slots))):
                    continue
                try:
                    # The change with speed of each element by itself, so that loads do not hide a weak drag.
                    F, error = self.forced(element, moving)
                    still, known = self.forced(element, resting)
                except (ArithmeticError, ValueError):
                    return False
                pushed[columns] += F - still
                unsure[columns] += np.where(F - still, error + known, 0.0)
            if not np.all(np.isfinite([pushed, unsure])):
                return False
            left, rounding = pushed @ allowed, unsure @ np.abs(allowed)
            if np.any(np.abs(left) > TOLERANCES.roundings_of_comparison * rounding):
                return False
        return True

    def _followed(self, u: Array) -> Array:
        """Return the coordinates of the reference, with followers where these speeds leave them."""
        system, motion = self.system, self.motion
        if system.sparse or not system.following:
            return motion.q
        q, states = motion.q.copy(), system.following
        rows = system.states[1][np.isin(system.states[0], states)]
        for _ in range(TOLERANCES.newton_steps_onto_rows):
            V = system.dynamics(q, u, motion.time).V[rows]
            D_q = system.linearize(q, u, 0.0 * q, np.zeros(system.n_c), motion.time)[2]
            step = least_squares(D_q[rows - system.n_h][:, states], -V, rcond=None)
            q[states] += step
            if np.all(np.abs(step) <= EPS * np.abs(q[states])):
                break
        return q

    def conserves(self, field: Field) -> bool:
        """Return whether the momentum along a symmetry is constant along every motion."""
        acting = [e for e in self.containing(field) if not e.inertia]
        return (not acting or (bool(self.states) and self._idle(acting, field))) and self._horizontal(field)

    def _idle(self, acting: list[Acting], field: Field) -> bool:
        """Whether elements, each by itself, do no work along a field, whatever the state."""
        here, directions = field.field(self.motion.q), [field.field(state.q) for state in self.states]
        return all(
            (e.analytic or not any(here[i] for i in e.columns)) and self._workless(e, field, directions) for e in acting
        )

    def _workless(self, element: Acting, field: Field, directions: list[Array]) -> bool:
        """Whether an element does no work along a field, which has these directions at the states."""
        for state, Y in zip(self.states, directions, strict=True):
            if not any(Y[i] for i in element.columns):
                continue
            if element.written and not steps_are_exact(field):
                F, error = self.bounded(element, state)
                if abs(float(Y @ F)) > float(
                    np.abs(Y) @ (error + TOLERANCES.roundings_of_comparison * EPS * np.abs(F))
                ):
                    return False
                continue
            with Digits(element, exact=steps_are_exact(field)) as f:
                force: Any = self._force(element, state)
                if f.name == "mpmath":
                    q, u, a = (numbers(x, f) for x in (state.q, state.u, state.a))
                    force = element.force(q, u, a, self.motion.time, f)
                work = [x * f.number(repr(float(Y[i]))) for i, x in zip(element.columns, force, strict=True)]
                limit = TOLERANCES.comparison_exact if f.name == "mpmath" else TOLERANCES.force_change
                if abs(sum(work)) > limit * sum(abs(x) for x in work):
                    return False
        return True

    def _horizontal(self, field: Field) -> bool:
        """Whether no constraint row resists a field, at all states that satisfy the rows; those of states never do."""
        if not self.system.n_c or not self.seen:
            return self.seen
        sizes, resisting = self.motion.sizes, np.ones(self.system.n_c, dtype=bool)
        resisting[self.system.states[1]] = False
        for state, (J, size) in zip(self.on_rows, self.rows_there, strict=True):
            Y = field.field(state.q)
            off = np.abs(J @ Y) > TOLERANCES.row_residual * size * float(np.max(np.abs(Y / sizes)))
            if np.any(off & resisting):
                return False
        return True

    # --- one group --------------------------------------------------------------------------------------------------

    def carries(self, field: Field) -> bool:
        """Return whether a group maps all motions to motions."""
        try:
            if not self._allowed(field) or not self._rows_carried(field):
                return False
            if not states_follow(self.system, self.on_rows, field, self.motion.time):
                return False
            seen = [e for e in self.containing(field) if not self._unseen(e, field)]
            if not seen:
                return True
            images = [self._moved(field, state) for state in self.states]
            exact = steps_are_exact(field)
            broken = [e for e in seen if not (self._carried(e, images, exact) and self.generated(e, field))]
            return self._near_too(seen, field) and (not broken or self._together(broken, field))
        except (MbstabError, ArithmeticError, ValueError, np.linalg.LinAlgError):
            return False

    def _near_too(self, seen: list[Acting], field: Field) -> bool:
        """Return whether expressions also pass small steps of a shift: they may be flat except in a narrow range."""
        written = [e for e in seen if e.written]
        if not written or not isinstance(field, Shift):
            return True
        reach = np.abs(field.direction / self.motion.sizes)[field.direction != 0.0]
        wide = 2.0 ** np.ceil(np.log2(np.max(reach) / np.min(reach)))
        for part in TOLERANCES.trial_parts[1:]:
            # Also the coordinate that moves least must do so by a step of which no bit is lost.
            step = min(part * wide, 0.5) * field.step
            images = [self._moved(replace(field, step=step), state) for state in self.states]
            if not all(self._carried(e, images, exact=steps_are_exact(field)) for e in written):
                return False
        return True

    def steady(self, generator: Generator) -> bool:
        """Return whether the flow of a steady motion maps all motions to motions."""
        key = self._key(generator)
        if key not in self._steady:
            self._steady[key] = self.carries(self.along(generator))
        return self._steady[key]

    def _key(self, generator: Generator) -> bytes:
        """Return the same for generators that move the reference in the same way."""
        return generator.field(self.motion.q).tobytes() + np.array([generator.rate, *generator.axis]).tobytes()

    def along(self, generator: Generator) -> Field:
        """Return the group of a steady motion, with a noticeable step."""
        span = self._span(generator)
        if generator.turns:
            return Turn(generator, span)
        direction = generator.field(self.motion.q)
        largest = float(np.max(np.abs(direction)))
        whole = in_whole_numbers(direction / largest)
        return Shift(whole, span * largest / float(np.max(np.abs(whole))))

    def _span(self, generator: Generator) -> float:
        """Return a time in which a steady motion moves noticeably (s)."""
        direction = np.abs(generator.field(self.motion.q))
        span = TOLERANCES.trial_move / (float(np.max(direction / self.motion.sizes)) or self.rate)
        largest = float(np.max(direction)) or 1.0
        return short(span * largest) / largest

    def _allowed(self, field: Field) -> bool:
        """Return whether the constraints allow the disturbance of the reference to first order."""
        motion, system = self.motion, self.system
        if not system.n_c:
            return True
        Y, n_h = field.field(motion.q), system.n_h
        J = motion.dynamics.J
        size = float(np.max(np.abs(Y / motion.sizes))) or 1.0
        return bool(
            np.all(
                np.abs(J[:n_h] @ Y) <= TOLERANCES.row_change_first_order * size * (abs(J[:n_h]) @ motion.sizes) + 1e-300
            )
        )

    def _rows_carried(self, field: Field) -> bool:
        """Return whether states that satisfy the rows are mapped to states that do."""
        if not self.system.n_c or not self.seen:
            return self.seen
        part = self._containing(field) if isinstance(field, Shift) else None
        for state in self.on_rows:
            q, T = field.moved(state.q)
            if not self.satisfies(q, T @ state.u, part=part):
                return False
        return True

    def _together(self, broken: list[Acting], field: Field) -> bool:
        """Return whether the sum of elements that a group changes is unchanged, in all motions that the rows allow."""
        if not self.system.n_c or any(e.written for e in broken) or len(self.on_rows) < 2:
            return False
        system, time = self.system, self.motion.time
        # At rest too: dampers at high speed would hide weak springs.
        moving = self.on_rows
        for state in [*(State(x.q, 0.0 * x.u, 0.0 * x.a) for x in moving), *moving]:
            there, T = self._moved(field, state)
            J = system.dynamics(state.q, state.u, time).J
            if is_sparse(J):
                return False  # in a large scene only the comparison element by element is tried
            J = J * self.motion.sizes
            lengths = np.linalg.norm(J, axis=1) + 1e-300
            _, s, right = np.linalg.svd(J / lengths[:, None])
            allowed = self.motion.sizes[:, None] * right[int(np.sum(s > 1e-8)) :].T
            total, size, rounding = np.zeros((3, allowed.shape[1]))
            for element in broken:
                columns, everything = list(element.columns), slice(None)
                F, moved = (put(self._force(element, x), columns, everything, len(state.q)) for x in (state, there))
                after: Array = T.T @ moved
                change = (after - F) @ allowed
                mixing = np.max(np.abs(allowed) / self.motion.sizes[:, None], axis=0)
                # What rounding of the coordinates makes of a stiff element must not hide the change of a weak one.
                own = self._rounding_there(element, state, there, T) * mixing
                change = np.where(np.abs(change) <= TOLERANCES.force_change_rounding * own, 0.0, change)
                total += change
                size += np.abs(change)
                rounding += float(np.max((np.abs(F) + np.abs(after)) * self.motion.sizes)) * mixing
            if np.any(np.abs(total) > TOLERANCES.row_residual * size + TOLERANCES.force_change_rounding * rounding):
                return False
        return True

    def _rounding_there(self, element: Acting, state: State, there: State, T: Array) -> float:
        """Return how much an element's force changes at a state and its image if these change by their whole size."""
        columns, count = list(element.columns), len(state.q)
        here, moved = (put(self._rounding(element, x), columns, slice(None), count) for x in (state, there))
        return float(np.max((here + abs(T).T @ moved) * self.motion.sizes))

    def keeps_time(self, generator: Generator) -> str:
        """Return the first entry that is not invariant under a steady motion at later times; empty: none.

        For equations that contain the time in drives: they are constant in the co-moving frame if
        following the motion for some time is the same as waiting.
        """
        field, span = self.along(generator), self._span(generator)
        later = self.motion.time + span
        images = [self._moved(field, state) for state in self.states]
        for element in self.elements:
            if not self._unseen(element, field) and not self._carried(element, images, exact=steps_are_exact(field)):
                return element.path
        for state in self.on_rows:
            q, T = field.moved(state.q)
            if not self.satisfies(q, T @ state.u, later):
                return "the constraints"
        return ""

    # --- candidates -------------------------------------------------------------------------------------------------


def _weighted(weights: list[Any], column: Any) -> tuple[Any, Any]:
    """Return a weighted sum and the sum of the sizes of its terms."""
    terms = [w * x for w, x in zip(weights, column, strict=True)]
    return sum(terms), sum(abs(x) for x in terms)
