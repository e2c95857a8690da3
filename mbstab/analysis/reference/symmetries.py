"""Symmetries of the equations of a scene: the structure that verdicts rest on.

A symmetry maps *all* motions near the reference to motions, not only those of the linearized
equations. `mbstab.analysis.reference.identities` finds all fields of a class that leave the elements of the scene
unchanged; here they get the names by which people know them: translations, rotations, single coordinates.

Fields Y(q) generate the symmetries; a disturbance along one is (Δq, Δu) = (Y, DY u).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fractions import Fraction
from functools import cached_property
from typing import Any

import numpy as np

from mbstab.analysis.algebra.arrays import Flags, least_squares
from mbstab.analysis.algebra.ball_arrays import BALLS, excludes_zero, many_bits
from mbstab.analysis.algebra.tolerances import EPS
from mbstab.analysis.reference.changes import At, Local
from mbstab.analysis.reference.element_comparison import ElementComparison, State, with_errors
from mbstab.analysis.reference.fields import DRIFTS, ROTATIONS, SIZES, SPINS, Field, Symmetry
from mbstab.analysis.reference.identities import Identities, echelon
from mbstab.analysis.reference.motion import Motion
from mbstab.analysis.reference.steady import Generator, axis_text, through
from mbstab.analysis.reference.tolerances import TOLERANCES
from mbstab.compiler.system import Array, System
from mbstab.errors import MbstabError
from mbstab.model.schema import is_state

UNEVEN = 5661 / 4096
"""Trial speeds are multiples of this number, which no model has."""


def symmetries(system: System, motion: Motion) -> list[Symmetry]:
    """Return independent symmetries of the scene that move the reference motion."""
    return Invariance(system, motion).symmetries


class Invariance(ElementComparison):
    """Symmetries and conserved momenta of a scene; each part is computed at first use.

    Parameters
    ----------
    system : System
    motion : Motion
        The reference.
    alone : Invariance, optional
        That of each element by itself: then the sum of all forces is tested, as far as the rows do not balance it.

    Attributes
    ----------
    isolated : bool
        Whether it is known by other means that no symmetry moves the reference.
    """

    def __init__(self, system: System, motion: Motion, alone: Invariance | None = None) -> None:
        super().__init__(system, motion)
        self._alone = alone
        self.isolated = False

    # --- symmetries -------------------------------------------------------------------------------------------------

    @cached_property
    def identities(self) -> Identities:
        """What the elements of the scene do along fields."""
        return Identities(self) if self._alone is None else Identities(self._alone, self._alone.identities)

    @property
    def alone(self) -> Identities:
        """What each element by itself does along fields."""
        return (self._alone or self).identities

    @cached_property
    def fields(self) -> list[tuple[str, Field]]:
        """All groups with their names, including those that do not move the reference; some may be combinations."""
        named = list(Names(self.identities, self.motion).found())
        if not named:
            return []
        known = np.array([field.c for _, field in named])
        for generator in self.motion.generators:
            own = self.identities.of_generator(generator)
            moves = generator.moves and own is not None and not _spanned(own.astype(float)[:, None], known)[0]
            if moves and self.steady(generator):
                return [*named, ("the motion itself", self.along(generator))]
        return named

    @cached_property
    def symmetries(self) -> list[Symmetry]:
        """Independent symmetries that move the reference."""
        motion, found = self.motion, list[Symmetry]()
        if self.isolated:
            return found
        basis = np.zeros((2 * len(motion.q) + 1, 2 * len(motion.q)))
        for name, field in self.fields:
            direction, rate = field.field(motion.q), field.slope(motion.q) @ motion.u
            vector = self.disturbance(direction, rate)
            length = float(np.linalg.norm(vector))
            if length < TOLERANCES.field_felt:
                continue
            known, left = basis[: len(found)], vector / length
            for _ in range(2):  # twice is enough (Parlett 1998, section 6.9)
                left = left - known.T @ (known @ left)
            rest = float(np.linalg.norm(left))
            if rest > TOLERANCES.independent_fields:
                basis[len(found)] = left / rest
                found.append(Symmetry(name, direction, rate, field))
        return found

    def disturbance(self, direction: Array, rate: Array) -> Array:
        """Return (Δq, Δu) relative to the characteristic sizes."""
        sizes = self.motion.sizes
        return np.concatenate([direction / sizes, rate / (sizes * self.rate)])

    @cached_property
    def boosts(self) -> list[Symmetry]:
        """Shifts that may also be added to the speeds: another constant speed along them changes nothing else."""
        shifts = [item for item in self.symmetries if item.of.shift is not None]
        good = self.identities.passing([item.of for item in shifts], "driven")
        return [item for item, passes in zip(shifts, good, strict=True) if passes]

    @cached_property
    def momenta(self) -> list[Symmetry]:
        """Momenta that are conserved: no force and no constraint does work along the symmetry.

        A wheel that rolls along a line conserves neither its momentum nor its spin, but a combination of both.
        """
        items = self.symmetries
        if not items:
            return []
        found = [item for item, alone in zip(items, self._idle_alone, strict=True) if alone]
        combinations = echelon(self._idle, np.ones(len(items)), np.ones(len(items)))
        for c in combinations[:, np.any(combinations[~self._idle_alone] != 0, axis=0)].T:
            chosen = [(x, item) for x, item in zip(c, items, strict=True) if x]
            field = chosen[0][1].of.times(chosen[0][0])
            for x, item in chosen[1:]:
                field = field + item.of.times(x)
            direction = np.sum([float(x) * item.direction for x, item in chosen], axis=0)
            rate = np.sum([float(x) * item.rate for x, item in chosen], axis=0)
            name, parts = " with ".join(item.name for _, item in chosen), tuple((float(x), item) for x, item in chosen)
            found.append(Symmetry(name, direction, rate, field, parts))
        return found

    def conserves(self, field: Field) -> bool:
        """Return whether the momentum along a symmetry is constant along every motion."""
        known = [k for k, item in enumerate(self.symmetries) if item.of is field]
        if known:
            return bool(self._idle_alone[known[0]])
        return bool(self.identities.idle([field]).shape[1])

    @cached_property
    def _idle(self) -> Array:
        """The combinations of symmetries along which no force and no row does work, as columns."""
        return self.identities.idle([item.of for item in self.symmetries])

    @cached_property
    def _idle_alone(self) -> Flags:
        """Which symmetries are such by themselves."""
        return _spanned(np.eye(len(self.symmetries)), self._idle.T)

    def carries(self, field: Field) -> bool:
        """Return whether a group maps all motions to motions."""
        return self.identities.passing([field], "along")[0]

    @cached_property
    def integrals(self) -> list[Symmetry]:
        """Momenta that are conserved, also with a linear function of the coordinates added.

        Where the forces along a shift sum to the rate of such a function, as Coriolis forces
        do, the shift need not be a symmetry. The conserved quantity must not change along symmetries: this is
        the same everywhere if the symmetries are shifts.
        """
        known = self.momenta
        written = any(element.written for element in self.elements)
        if not written or not self.states or any(item.of.shift is None for item in self.symmetries):
            return known
        still, found = np.zeros(self.system.n_q), list(known)
        basis = [item.direction for item in known]
        sizes = self.motion.sizes
        for entries in echelon(self._balanced_shifts(), sizes, np.ones(len(sizes))).T:
            field = self.identities.shift(entries)
            if field is None:
                continue
            direction = np.array(entries, dtype=float)
            new = np.linalg.matrix_rank(
                np.array([*basis, direction]) / self.motion.sizes, tol=TOLERANCES.independent_fields
            ) > len(basis)
            if new and self._total(field) and self.identities.passing([field], "held")[0]:
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

    def _total(self, field: Field) -> bool:
        """Return whether the total force along a shift is the rate of a linear function that no symmetry changes."""
        shift, n = field.shift, self.system.n_q
        assert shift is not None
        rates = BALLS.zeros((n,))
        with many_bits():
            for cluster in self.identities.clusters:
                columns = np.array(cluster.columns, dtype=int)
                for own in (x for x in cluster.elements if not x.element.rows):
                    places = columns[own.columns]
                    if not np.any(shift[places]):
                        continue
                    found = _rate(own, self.identities.beside(cluster), BALLS.of(shift[places]))
                    if found is None:
                        return False
                    rates[places] = rates[places] + found
            for item in self.symmetries:
                along = BALLS.of(item.direction)
                if np.any(excludes_zero(np.array([rates @ along]))):
                    return False
        return True

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

    # --- one group --------------------------------------------------------------------------------------------------

    def steady(self, generator: Generator) -> bool:
        """Return whether a steady motion follows a symmetry, as far as the rows let it differ from one."""
        identities, sizes = self.identities, self.motion.sizes
        c = identities.of_generator(generator)
        if c is not None and (not np.any(c != 0) or self.carries(self.along(generator))):
            return True
        fields = [identities.field(c) for c in identities.space.T]
        own = np.concatenate([generator.field(x.q) / sizes for x in self.on_rows])
        if not fields:
            return not np.any(own)
        rows = np.array([np.concatenate([y.field(x.q) / sizes for x in self.on_rows]) for y in fields])
        return bool(_spanned(own[:, None], rows / np.maximum(np.linalg.norm(rows, axis=1), 1e-300)[:, None])[0])

    def along(self, generator: Generator) -> Field:
        """Return the field of a steady motion, scaled to a size of one."""
        c = self.identities.of_generator(generator)
        assert c is not None
        c = c.astype(float)
        exact = [Fraction(x) for x in (c / np.max(np.abs(c))).tolist()]
        return Field(self.identities.basis, c / np.max(np.abs(c)), exact)

    def broken(self, generator: Generator) -> list[str]:
        """Return the entries that are not invariant under a steady motion.

        Where drives contain the time, the equations are constant in the co-moving frame if following the motion for
        some time is the same as waiting.
        """
        c = self.identities.of_generator(generator)
        return ["the motion"] if c is None else self.identities.changed(c)


class Names:
    """The fields of a scene by the names under which people know them, the simplest first.

    Parameters
    ----------
    identities : Identities
    motion : Motion
    """

    def __init__(self, identities: Identities, motion: Motion) -> None:
        self.identities, self.motion = identities, motion
        self.basis, self.system = identities.basis, identities.system

    def found(self) -> Iterator[tuple[str, Field]]:
        """Yield the fields with their names; later ones may be combinations of earlier ones."""
        if not self.identities.space.shape[1]:
            return
        with many_bits():
            yield from self._shifts()
            yield from self._turns()
            yield from self._own_turns()
            for entries in self.identities.within(np.zeros(self.basis.size, dtype=bool)).T:
                yield self._described(entries), self.identities.field(entries)

    # --- shifts -----------------------------------------------------------------------------------------------------

    def _shifts(self) -> Iterator[tuple[str, Field]]:
        """Yield translations of everything, shifts of single coordinates, and common shifts of several."""
        basis, names, single = self.basis, self.system.names, dict[int, Field]()
        for i in range(len(names)):
            entries = self.identities.of_shift(i)
            if entries is not None and self.identities.contains(entries):
                single[i] = self.identities.field(entries)
        for axis, letter in enumerate("xyz"[: self.system.scene.dimension]):
            places = [b.part.start + axis for b in basis.blocks if b.body is not None]
            entries = self.identities.of_shift(*places)
            # Where each coordinate may be shifted by itself, the shift of all together says less.
            several = len(places) > 1 and not single.keys() >= set(places)
            if several and entries is not None and self.identities.contains(entries):
                yield f"translation along {letter}", self.identities.field(entries)
        for i, field in single.items():
            yield f"state {names[i]}" if is_state(names[i]) else names[i], field
        for entries in self.identities.within(~basis.still).T:
            field = self.identities.field(entries)
            assert field.shift is not None
            strong = self._strongest(field.shift)
            yield "common shift of " + ", ".join([*strong[:4], *["…"] * (len(strong) > 4)]), field

    @cached_property
    def _units(self) -> Array:
        """The units of the coordinates."""
        return np.array([self.system.scene.model.unit_of(name) for name in self.system.names])

    def _strongest(self, direction: Array) -> list[str]:
        """Return the coordinates that a shift moves most; only those of one unit are compared."""
        units, moved = self._units, np.abs(direction)
        moved = np.where(moved / self.motion.sizes > 1e-9 * np.max(moved / self.motion.sizes), moved, 0.0)
        most = {unit: np.max(moved[units == unit]) for unit in set(units.tolist())}
        return [name for name, x, unit in zip(self.system.names, moved, units, strict=True) if x > 0.3 * most[unit]]

    # --- rotations --------------------------------------------------------------------------------------------------

    def _turns(self) -> Iterator[tuple[str, Field]]:
        """Yield rotations of everything with the ground; states may go with them."""
        spatial = self.system.scene.dimension == 3
        bodies = [b for b in self.basis.blocks if b.body is not None]
        if not bodies:
            return
        first = bodies[0]
        for entries in self.identities.common(bodies).T:
            turn = np.array(
                [float(entries[k]) for k in range(first.start + ROTATIONS[first.kind], first.start + first.ground)]
            )
            size = float(np.linalg.norm(turn))
            if not size:
                continue
            field = self.identities.field(entries)
            generator = field.generator
            assert generator is not None
            place = through(np.where(np.abs(generator.point) > 1e-12 * np.max(self.motion.sizes), generator.point, 0.0))
            name = f"rotation about {axis_text(turn / size)}" if spatial else "rotation in the plane"
            yield name + place, field.times(1 / size) if size != 1.0 else field

    def _own_turns(self) -> Iterator[tuple[str, Field]]:
        """Yield rotations of single bodies about an axis of their own, through their centres of mass."""
        for b in self.basis.blocks:
            if b.kind not in SPINS:
                continue
            own = np.ones(self.basis.size, dtype=bool)
            own[b.start + SPINS[b.kind] : b.start + SIZES[b.kind]] = False
            for entries in self.identities.within(own).T:
                axis = np.array([float(x) for x in entries[b.start + SPINS[b.kind] : b.start + DRIFTS[b.kind]]])
                if not np.any(axis):
                    continue
                name, body = self.system.names[b.part.stop - 1], self.system.scene.bodies[b.body or 0]
                if len(axis) == 3 and np.any(axis[:2]):
                    name = f"turn of {body.name} about its axis {axis_text(axis / np.linalg.norm(axis))}"
                yield name, self.identities.field(entries)

    def _described(self, entries: Sequence[Any]) -> str:
        """Return a name for a field that has none of its own."""
        moved = [b for b in self.basis.blocks if any(entries[k] != 0 for k in b.fields)]
        owners = [
            self.system.names[b.part.start] if b.body is None else self.system.scene.bodies[b.body].name for b in moved
        ]
        return f"motion of {', '.join([*owners[:4], *['…'] * (len(owners) > 4)])}"


def _spanned(X: Array, rows: Array) -> Flags:
    """Return which columns lie in the span of rows, to rounding."""
    if not len(rows):
        return np.asarray(~np.any(X, axis=0))
    _, s, right = np.linalg.svd(rows, full_matrices=False)
    basis = right[s > TOLERANCES.coefficient_zero * s[0]]
    left = np.linalg.norm(X - basis.T @ (basis @ X), axis=0)
    result: Flags = left <= 10.0 * TOLERANCES.coefficient_zero * np.linalg.norm(X, axis=0)
    return result


def _rate(own: Local, ats: Sequence[At], Y: Array) -> Array | None:
    """Return c, if the force of an element along a shift is c·u and its inertia is the same."""
    found = list[Array]()
    if not own.analytic:
        return None
    for at in ats:
        K, R = (at.entry(own, key)[0] for key in "KR")
        inertia = own.element.takes_acceleration
        if np.any(excludes_zero(K @ Y if inertia else Y @ K)):
            return None
        q, u, a, time = at.state
        F = own.run("dynamics", (q, 0 * u, a, time), BALLS)["F"]
        if not inertia and np.any(excludes_zero(np.array([Y @ F]))):
            return None
        found.append(0 * Y if inertia else Y @ R)
    return found[0] if found and not any(np.any(excludes_zero(c - found[0])) for c in found) else None
