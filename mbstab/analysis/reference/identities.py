"""Which fields leave the elements of a scene unchanged, as identities at random states with many digits.

The force of an element changes along a field X by K X + R X' + M X'' + (DX)ᵀ F, a row by C_q X, or D_q X + D_u X', at
states that satisfy the rows of its bodies. Where that vanishes at a random state, it does so everywhere (an analytic
function that is not zero vanishes at a random point with probability 0: Schwartz 1980, Zippel 1979; Mityagin 2015), and
the group of X carries motions into motions (Lie; Olver 1993, theorem 2.31). Doubles propose a space of fields, element
by element; balls of Arb with 220 bits, in which decimals of the file are exact, keep those of it for which the change
vanishes.

Of what is not analytic, as a force with abs, nothing is concluded from random states: fields pass if they change none
of the coordinates and speeds that it contains.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from fractions import Fraction
from functools import cached_property, partial
from typing import Any, Literal

import numpy as np

from mbstab.analysis.algebra.arrays import Flags, RandomNumbers
from mbstab.analysis.algebra.ball_arrays import (
    BALLS,
    DOUBLES,
    NONE,
    Doubles,
    as_ball,
    kept_combinations,
    largest_terms,
    many_bits,
    middle,
    plain_ball,
    shows,
)
from mbstab.analysis.reference.changes import Changes, Cluster, Local, Sized, State, Whole
from mbstab.analysis.reference.fields import ROTATIONS, SIZES, Basis, Block, Field
from mbstab.analysis.reference.motion import Motion
from mbstab.analysis.reference.rounded_scene import exact_system
from mbstab.analysis.reference.steady import Generator
from mbstab.analysis.reference.tolerances import TOLERANCES
from mbstab.compiler.system import Array, System
from mbstab.errors import MbstabError

NO_VALUE = (ArithmeticError, ValueError, MbstabError, np.linalg.LinAlgError)
"""Errors of a state at which an element has no value."""


class Identities:
    """Which fields of the class the elements of a scene have.

    Parameters
    ----------
    system : System
    motion : Motion
        The reference, near which states lie.
    rate : float
        A characteristic rate of the scene (1/s).
    together : bool
        Whether only the sum of all forces must stay the same, as far as rows do not balance it.
    """

    def __init__(self, system: System, motion: Motion, rate: float, together: bool = False) -> None:
        self.system, self.motion, self.rate, self.together = system, motion, rate, together
        self.basis = Basis(system)

    @cached_property
    def _exact(self) -> System:
        """The scene in balls."""
        return exact_system(self.system)

    @cached_property
    def exact_blocks(self) -> list[Block]:
        """The blocks of the fields, with bases in balls."""
        return Basis(self._exact).blocks

    @cached_property
    def _locals(self) -> list[tuple[tuple[int, ...], Local]]:
        """The elements of the scene that contain coordinates, each with the numbers of the blocks of these."""
        found, system = [], self.system
        for k, e in enumerate(system._elements):
            on = tuple(sorted({self.basis.of_coordinate[i] for i in e.columns if i < system.n_q}))
            if on:
                exactly = partial(lambda k: self._exact._elements[k], k)
                found.append((on, Local(e, exactly, system, e.path not in self._pieced)))
        return found

    @cached_property
    def clusters(self) -> list[Cluster]:
        """The elements by the bodies and states that they contain, with all rows on these."""
        found, touching = dict[tuple[int, ...], Cluster](), dict[int, list[tuple[tuple[int, ...], Local]]]()
        for on, own in self._locals:
            for k in on if own.element.rows else ():
                touching.setdefault(k, []).append((on, own))
            if on not in found:
                exactly = partial(lambda on: [self.exact_blocks[k] for k in on], on)
                found[on] = Cluster([self.basis.blocks[k] for k in on], exactly)
            found[on].elements.append(own.among(found[on].columns))
        for on, cluster in found.items():
            near = {id(own): own for k in on for other, own in touching.get(k, ()) if set(other) <= set(on)}
            cluster.rows = [own.among(cluster.columns) for own in near.values()]
        return list(found.values())

    @cached_property
    def _pieced(self) -> set[str]:
        """Paths of the entries that are not analytic."""
        items, names = self.system.scene.items, self.system.names
        return {x.entry.path for x in items if any(expression.pieced(names) for expression in x.entry.expressions())}

    @cached_property
    def _searched(self) -> list[Cluster]:
        """The clusters that fields must leave unchanged."""
        if not self.together:
            return self.clusters
        whole = Whole(self.basis.blocks, lambda: self.exact_blocks, self.motion.sizes)
        whole.elements = [own.among(whole.columns) for _, own in self._locals]
        whole.rows = [x for x in whole.elements if x.element.rows]
        return [whole]

    @cached_property
    def scale(self) -> Array:
        """Sizes of fields that move the scene by about its own size, shape (basis.size,)."""
        found, sizes = np.ones(self.basis.size), self.motion.sizes
        for b in self.basis.blocks:
            own = slice(b.start, b.start + SIZES[b.kind])
            if b.kind == "scalar":
                found[own] = sizes[b.part]
            else:
                found[own] = np.where(self.basis.lengths[own], np.max(sizes[b.part.start : b.part.start + 2]), 1.0)
        return found

    # --- states -----------------------------------------------------------------------------------------------------

    def _random(self, own: Cluster, rng: RandomNumbers, count: int, spread: float) -> State:
        """Return random states near the reference that satisfy the rows of a cluster, shape (count, n) each."""
        motion, columns = self.motion, own.columns
        sizes = motion.sizes[columns]
        q, u, a = (rng.uniform(-1.0, 1.0, count, len(columns)) for _ in range(3))
        # At rest, in motion, accelerated: fast motions hide weak forces.
        kinds = np.arange(count)[::-1, None] % 3
        q, u = motion.q[columns] + spread * sizes * q, motion.u[columns] + spread * self.rate * sizes * u
        u, a = np.where(kinds == 2, 0.0, u), np.where(kinds == 0, a, 0.0)
        # What holds at one time only, as where a drive passes through an axis, is no identity.
        later = float(rng.uniform(-1.0, 1.0, 1)[0]) / self.rate if self.system.scene.timed else 0.0
        return self._onto_rows(own, (q, u, self.rate**2 * sizes * a, motion.time + later), DOUBLES)

    def _onto_rows(self, own: Cluster, state: State, f: Doubles) -> State:
        """Return nearby states that satisfy the rows, by Newton's method; those that are not found are left out."""
        q, u, a, time = state
        sizes, good = self.motion.sizes[own.columns], np.ones(q.shape[:-1], dtype=bool)
        levels = [level for level in "EV" if any(x.holonomic or level == "V" for x in own.rows)]
        for level in levels[:1] if own.still else levels:
            unit = sizes * (1.0 if level == "E" else self.rate)
            for _ in range(TOLERANCES.newton_steps_onto_rows):
                left, J = map(middle, own.residuals(level, (q, 0 * u if level == "E" else u, a, time), f))
                good &= np.all(np.isfinite(J), axis=(-1, -2)) & np.all(np.isfinite(left), axis=-1)
                J, left = np.where(good[..., None, None], J * sizes, 0.0), np.where(good[..., None], left, 0.0)
                step = sizes * (np.linalg.pinv(J, rcond=1e-10) @ left[..., None])[..., 0]
                q, u = (f.settled(q - step), u) if level == "E" else (q, f.settled(u - step))
                if not np.any(np.abs(step) > f.resolution * unit):
                    break
            good &= np.all(np.abs(step) <= 1e3 * f.resolution * unit, axis=-1)
        return (q[good], u[good], a[good], time) if q.ndim > 1 else (q, u, a, time)

    def _exact_states(self, own: Cluster, rng: RandomNumbers) -> Iterator[State]:
        """Yield random states in balls: one far from the reference, and of what the file writes some near it."""
        for spread in TOLERANCES.exact_spreads[: None if own.written else 1]:
            for part in TOLERANCES.state_spreads:
                with np.errstate(all="ignore"):
                    rough = self._random(own, rng, 1, spread * part)
                if not len(rough[0]):
                    continue
                try:
                    q, u, a = (BALLS.of(x[0]) for x in rough[:3])
                    yield self._onto_rows(own, (q, u, a, as_ball(rough[3])), BALLS)
                    break
                except NO_VALUE:
                    continue

    # --- the space of fields ----------------------------------------------------------------------------------------

    @cached_property
    def _proposed(self) -> Array:
        """The fields that leave each element unchanged to rounding, as columns, shape (basis.size, number)."""
        known: dict[tuple[Any, ...], Array] = {}
        rng = RandomNumbers(2)
        parts: list[tuple[list[int], Array]] = []
        for own in self._searched:
            if own.key not in known:
                known[own.key] = self._conditions(own, rng)
            parts.append((own.fields, known[own.key]))
        return null_space(parts, self.basis.size) * self.scale[:, None]

    def _conditions(self, own: Cluster, rng: RandomNumbers) -> Array:
        """Return what elements demand of the fields of their bodies, relative to their scale, as orthonormal rows."""
        for spread in TOLERANCES.state_spreads[1:]:
            with np.errstate(all="ignore"), suppress(*NO_VALUE):
                rows = self._demands(own, rng, spread)
                if len(rows):
                    _, s, right = np.linalg.svd(rows, full_matrices=False)
                    return np.asarray(right[: int(np.sum(s > TOLERANCES.proposed_change * max(s[0], 1.0)))])
        return np.eye(len(own.fields))

    def _demands(self, own: Cluster, rng: RandomNumbers, spread: float) -> Array:
        """Return the changes of elements along fields at random states, relative to their terms, as rows."""
        scale = self.scale[own.fields]
        state = self._random(own, rng, TOLERANCES.states_beyond + 2 * len(scale) // own.least, spread)
        if not len(state[0]):
            return np.zeros((0, len(scale)))
        value, size = own.changes(state, DOUBLES).along
        most = np.exp2(np.max(size + np.log2(scale), axis=-1, keepdims=True, initial=NONE))
        # A row without terms is rounding; what is dropped with it is seen in balls.
        felt = most > TOLERANCES.row_without_terms * np.max(most, initial=0.0)
        rows = np.where(felt, value * scale / most, 0.0)
        return np.asarray(rows[np.all(np.isfinite(rows), axis=(-1, -2))].reshape(-1, len(scale)))

    @cached_property
    def space(self) -> Array:
        """The fields that leave each element unchanged, as columns of balls, shape (basis.size, number)."""
        found = self._proposed
        if not found.shape[1]:
            return found
        with many_bits():
            reduced_ = echelon(found, self.scale, self.basis.lengths, self._simple(found))
            exact = in_balls(reduced_)
            rough = [k for k, c in enumerate(reduced_.T) if any(isinstance(x, float) for x in c)]
            if moving := [k for k in rough if self._moves(reduced_[:, k])]:
                exact[:, moving] = self._refined(exact[:, moving], np.array(reduced_ == 1))
            return self._kept(np.delete(exact, [k for k in rough if k not in moving], axis=1))

    def _moves(self, c: Array) -> bool:
        """Return whether a field moves the reference."""
        step = self.field(c).field(self.motion.q) / self.motion.sizes
        return bool(
            np.max(np.abs(step)) > TOLERANCES.field_felt * np.max(np.abs(np.array(c, dtype=float) / self.scale))
        )

    def _refined(self, space: Array, pivots: Array) -> Array:
        """Return fields that doubles propose with all digits, by Newton's method; others do not converge."""
        free = np.flatnonzero(~np.any(pivots & (np.sum(pivots, axis=1, keepdims=True) == 1), axis=1))
        parts: list[tuple[Cluster, Array, Array]] = []
        for own in self._searched:
            for visit in range(TOLERANCES.states_beyond + len(own.fields) // own.least):
                for at in self._visited(own, visit):
                    value, size = at.along
                    most = np.max(size + np.log2(self.scale[own.fields]), axis=1, initial=NONE)
                    # What a row cancels by itself is rounding of the state.
                    felt = most > np.max(most, initial=NONE) - TOLERANCES.bits_of_weak_terms
                    unit = BALLS.of(np.where(felt, np.exp2(-np.where(felt, most, 0.0)), 0.0))
                    parts.append((own, value * unit[:, None], middle(value * unit[:, None])))
        rough = np.zeros((sum(len(x) for _, _, x in parts), self.basis.size))
        start = 0
        for own, _, x in parts:
            rough[start : start + len(x), own.fields] = x
            start += len(x)
        inverse = np.linalg.pinv((rough * self.scale)[:, free], rcond=TOLERANCES.proposed_change)
        for _ in range(TOLERANCES.steps_of_refinement):
            left = np.concatenate([BALLS.multiplied(x, space[own.fields]) for own, x, _ in parts])
            power = float(np.max(BALLS.powers(left), initial=NONE))
            if not np.isfinite(power):
                break
            unit = BALLS.of(np.array(2.0))[()] ** int(power)
            step = -inverse @ middle(left / unit) * self.scale[free][:, None]
            space[free] = BALLS.settled(space[free] + BALLS.of(step) * unit)
        return space

    def _simple(self, space: Array) -> Array:
        """Return independent fields of a space that are motions of everything with the ground, or of single bodies."""
        bodies, columns = [b for b in self.basis.blocks if b.body is not None], []
        if bodies:
            ground = 6 if bodies[0].kind.startswith("spatial") else 3
            columns = [[b.start + k for b in bodies] for k in range(ground)]
        columns += [[k] for k in range(self.basis.size)]
        Q = np.linalg.qr(space / self.scale[:, None])[0] if space.shape[1] else space
        room = np.zeros((self.basis.size, 0))
        found: list[Array] = []
        for places in columns:
            x = np.zeros(self.basis.size)
            x[places] = 1.0
            unit = x / self.scale / np.linalg.norm(x / self.scale)
            if np.linalg.norm(unit - Q @ (Q.T @ unit)) < TOLERANCES.simple_field:
                left = unit - room @ (room.T @ unit)
                if np.linalg.norm(left) > TOLERANCES.independent_fields:
                    room = np.column_stack([room, left / np.linalg.norm(left)])
                    found.append(x)
        return np.array(found).reshape(-1, self.basis.size).T

    def _kept(self, space: Array, what: str = "along") -> Array:
        """Return the combinations of fields for which nothing shows anywhere, at fresh states until none fails."""
        doubtful = self._searched if what == "along" else self.clusters
        for k in range(TOLERANCES.rounds_of_identities):
            failed = []
            for own in doubtful:
                on = np.flatnonzero(np.any(space[own.fields] != 0, axis=0)).tolist()
                if not on:
                    continue
                found = [self._along(own, x, space[own.fields][:, on], what) for x in self._visited(own, k)]
                combinations = BALLS.zeros((len(on), 0))
                if found:
                    combinations = kept_combinations(*(np.concatenate(x) for x in zip(*found, strict=True)))
                if combinations.shape[1] < len(on):
                    failed.append(own)
                    mixed = BALLS.settled(BALLS.multiplied(space[:, on], combinations))
                    space = np.hstack([np.delete(space, on, axis=1), mixed])
            if not failed:
                return space
            doubtful = failed
        return space[:, :0]

    def _visited(self, own: Cluster, visit: int = 0) -> list[Changes]:
        """Return what fields do to elements at random states, others at each visit; each is computed once."""
        while len(own.visited) <= visit:
            rng = RandomNumbers(3 + len(own.visited))
            own.visited.append([own.changes(state, BALLS) for state in self._exact_states(own, rng)])
        return own.visited[visit]

    def _along(self, own: Cluster, at: Changes, fields: Array, what: str) -> Sized:
        """Return what combinations of the fields of a cluster do to its elements at a state."""
        value, size = getattr(at, what)
        terms = largest_terms(size, BALLS.powers(fields))
        if own.rows:
            # What vanishes on rows does so to the digits of the state only, and kernels cancel it by themselves.
            most = np.max(size + np.log2(self.scale[own.fields]), axis=-1, keepdims=True, initial=NONE)
            terms = np.maximum(terms, most - TOLERANCES.bits_of_weak_terms)
        return BALLS.multiplied(value, fields), terms

    # --- questions --------------------------------------------------------------------------------------------------

    def idle(self, fields: Sequence[Field]) -> Array:
        """Return the combinations of fields along which no force does work and which no row resists.

        Returns
        -------
        c : ndarray, shape (len(fields), number)
        """
        with many_bits():
            columns = self._columns(fields)
            # Below the fields stand the coefficients of their combinations.
            kept = np.vstack([columns, BALLS.of(np.eye(len(fields)))])
            for what in ("work", "held"):
                kept = self._kept(kept, what)
            return middle(kept[len(columns) :])

    def passing(self, fields: Sequence[Field], what: str) -> list[bool]:
        """Return for each field whether nothing shows along it, of one kind of `Changes`."""
        if not fields:
            return []
        with many_bits():
            space, good = self._columns(fields), np.ones(len(fields), dtype=bool)
            for own in self.clusters:
                on = np.flatnonzero(good & np.any(space[own.fields] != 0, axis=0))
                if not len(on):
                    continue
                visited = self._visited(own)
                good[on] &= bool(visited)
                for at in visited:
                    good[on] &= ~np.any(shows(*self._along(own, at, space[own.fields][:, on], what)), axis=0)
        return good.tolist()

    def worth(self, field: Field) -> Literal["structural", "enclosed"]:
        """Return what an identity of a field of the space rests on: structural if no element contains what it moves."""
        with many_bits():
            fields = self._columns([field])
            for own in self.clusters:
                if np.any(fields[own.fields] != 0):
                    found = (self._along(own, at, fields[own.fields], "along")[0] for at in self._visited(own))
                    if any(np.any(x != 0) for x in found):
                        return "enclosed"
        return "structural"

    def _columns(self, fields: Sequence[Field]) -> Array:
        """Return the coefficients of fields as columns of balls."""
        return (
            np.array([in_balls(np.array(x.exact, dtype=object)) for x in fields], dtype=object)
            .reshape(len(fields), self.basis.size)
            .T
        )

    def changed(self, c: Array) -> list[str]:
        """Return the entries that are not the same a little later after a motion along a field.

        Coefficients are those of a motion, which is known to rounding.
        """
        found = dict[str, None]()
        with many_bits():
            fields, rng, step = BALLS.of(c)[:, None], RandomNumbers(4), Fraction(1, 2**70) / Fraction(self.rate)
            for own in self.clusters:
                for state in self._exact_states(own, rng):
                    value, terms = self._along(own, own.changes(state, BALLS), fields[own.fields], "along")
                    if self.system.scene.timed:
                        later = own.later(state, step)[:, None]
                        value, terms = value + later, np.maximum(terms, BALLS.powers(later))
                    broken = shows(value, terms, TOLERANCES.bits_of_motion)[:, 0]
                    owners = [x.element.path for x, rows in own.owners for _ in range(rows)]
                    found |= dict.fromkeys(path for path, bad in zip(owners, broken, strict=True) if bad)
        return list(found)

    def of_shift(self, *coordinates: int) -> Array | None:
        """Return the exact coefficients of the field that shifts coordinates alike; None if there is none."""
        found = np.full(self.basis.size, 0, dtype=object)
        for i in coordinates:
            b = self.exact_blocks[self.basis.of_coordinate[i]]
            k = i - b.part.start
            if k < ROTATIONS.get(b.kind, 1):
                found[b.start + k] = 1
            elif i == b.part.stop - 1:
                found[b.start + (11 if b.kind == "spatial" else 3)] = 1
            elif k == 3:  # the first angle turns a body in place about an axis of its base
                found[b.start + 6 : b.start + 9] = [plain_ball(b.base[3 * j]) for j in range(3)]
            else:
                return None
        return found

    def shift(self, direction: Sequence[Any]) -> Field | None:
        """Return a constant shift of coordinates as a field; None where it contains angles that others turn."""
        found = np.full(self.basis.size, 0, dtype=object)
        for i, x in enumerate(direction):
            if x:
                own = self.of_shift(i)
                if own is None or np.any(own[~self.basis.still] != 0):
                    return None
                found = found + x * own
        return self.field(found)

    def field(self, entries: Sequence[Any] | Array) -> Field:
        """Return the field with these coefficients."""
        return Field(self.basis, np.array([float(x) for x in entries]), list(entries))

    def of_generator(self, generator: Generator) -> Array | None:
        """Return the coefficients of a motion of everything with the ground, and of spins; None if it has none."""
        found = np.zeros(self.basis.size)
        turn = float(generator.rate) * generator.axis
        shifted = generator.velocity - np.cross(turn, generator.point)
        for b in (b for b in self.basis.blocks if b.body is not None):
            first, spatial = ROTATIONS[b.kind], b.kind.startswith("spatial")
            found[b.start : b.start + first] = shifted[:first]
            found[b.start + first : b.start + (6 if spatial else 3)] = turn if spatial else turn[2:]
        for i in np.flatnonzero(generator.spins):
            own = self.of_shift(int(i))
            if own is None:
                return None
            found += float(generator.spins[i]) * own.astype(float)
        return found

    def contains(self, entries: Any) -> bool:
        """Return whether the space of fields contains one, given by exact coefficients."""
        space, pivots = self._reduced
        with many_bits():
            x = in_balls(np.array(entries, dtype=object))
            taken = [k for k, row in enumerate(pivots) if entries[row] != 0]
            if not taken:
                return not np.any(x != 0)
            left = x - BALLS.multiplied(space[:, taken], x[[pivots[k] for k in taken]][:, None])[:, 0]
            return bool(np.all(BALLS.powers(left) <= np.max(BALLS.powers(x)) - TOLERANCES.bits_of_coefficients))

    @cached_property
    def _reduced(self) -> tuple[Array, list[int]]:
        with many_bits():
            return reduced(self.space, self.scale, self.basis.lengths)

    def within(self, excluded: Flags) -> Array:
        """Return the fields of the space whose coefficients vanish where they are excluded, as reduced columns."""
        # Each reduced column has a row of its own: one whose row is excluded takes no part.
        space, pivots = self._reduced
        part = space[:, [k for k, row in enumerate(pivots) if not excluded[row]]]
        return self._those(part, part[excluded])

    def in_place(self) -> list[Field]:
        """Return the fields of the space that turn bodies in place, and do nothing else."""
        excluded: Flags = np.ones(self.basis.size, dtype=bool)
        for b in self.basis.blocks:
            if b.kind == "spatial":
                excluded[b.start + 6 : b.start + 9] = False
        return [self.field(c) for c in self.within(excluded).T]

    def common(self, bodies: Sequence[Block]) -> Array:
        """Return the fields of the space that move all bodies with the ground, and states, as reduced columns."""
        first, rows = bodies[0], []
        for b in bodies:
            ground = 6 if b.kind.startswith("spatial") else 3
            rows.append(self.space[b.start + ground : b.start + SIZES[b.kind]])
            rows.append(self.space[b.start : b.start + ground] - self.space[first.start : first.start + ground])
        return self._those(self.space, np.concatenate(rows))

    def _those(self, space: Array, rows: Array) -> Array:
        """Return the combinations of fields for which rows vanish, as reduced columns of exact numbers."""
        with many_bits():
            sizes = np.broadcast_to(np.max(BALLS.powers(space), axis=0, initial=NONE), rows.shape)
            combinations = kept_combinations(rows, sizes)
            if not combinations.shape[1]:
                return np.zeros((self.basis.size, 0), dtype=object)
            found, _ = reduced(BALLS.multiplied(space, combinations), self.scale, self.basis.lengths)
            return np.asarray(np.frompyfunc(_short_ball, 1, 1)(found), dtype=object)


def null_space(parts: Sequence[tuple[list[int], Array]], size: int) -> Array:
    """Return the vectors that obey conditions on parts of their entries, as orthonormal columns."""
    rows = sum(len(x) for _, x in parts)
    if size <= TOLERANCES.fields_at_once:
        matrix, start = np.zeros((rows, size)), 0
        for fields, conditions in parts:
            matrix[start : start + len(conditions), fields] = conditions
            start += len(conditions)
        _, s, right = np.linalg.svd(matrix)
        return right[int(np.sum(s > TOLERANCES.proposed_change)) :].T
    from scipy.sparse import csr_array

    from mbstab.analysis.algebra.sparse_rank import sparse_null_space

    entries, columns, ends = [], [], [0]
    for fields, conditions in parts:
        for row in conditions:
            entries.append(row)
            columns.append(fields)
            ends.append(ends[-1] + len(row))
    matrix = csr_array((np.concatenate(entries), np.concatenate(columns), ends), shape=(rows, size))
    found = sparse_null_space(matrix, size)
    assert found is not None
    return found


def echelon(space: Array, scale: Array, lengths: Flags, simple: Array | None = None) -> Array:
    """Return the reduced echelon form of a space of columns, with fractions where these are short, as objects.

    Rotations are its pivots before translations: the place of an axis is a decimal, its inverse mostly not.

    Parameters
    ----------
    simple : ndarray, shape (size, number), optional
        Independent columns of the space that come first: the others must not mix with them.
    """
    first = np.zeros((len(scale), 0)) if simple is None else simple
    A = (np.hstack([first, space]) / scale[:, None]).T.copy()
    weight, pivots = np.where(lengths, 1e-3, 1.0), list[int]()
    for k in range(space.shape[1]):
        choice = A[k : k + 1] if k < first.shape[1] else A[k:]
        best, pivot = map(int, np.unravel_index(int(np.argmax(np.abs(choice) * weight)), choice.shape))
        A[[k, k + best]] = A[[k + best, k]]
        A[k] /= A[k, pivot]
        others = np.flatnonzero(A[:, pivot])
        others = others[others != k]
        A[others] -= A[others, pivot, None] * A[k]
        A[others, pivot] = 0.0
        pivots.append(pivot)
    found = A[: space.shape[1]].T * scale[:, None] / scale[pivots]
    return np.asarray(np.frompyfunc(short, 1, 1)(found), dtype=object) if found.size else found.astype(object)


def reduced(space: Array, scale: Array, lengths: Flags) -> tuple[Array, list[int]]:
    """Return the reduced echelon form of columns of balls, and the numbers of its pivots.

    Rotations are its pivots before translations: the place of an axis is a decimal, its inverse mostly not.
    """
    A, weight, pivots = space.copy(), np.where(lengths, 1e-3, 1.0) / scale, list[int]()
    for k in range(A.shape[1]):
        sizes = np.abs(middle(A[:, k:])) * weight[:, None]
        pivot, best = map(int, np.unravel_index(int(np.argmax(sizes)), sizes.shape))
        A[:, [k, k + best]] = A[:, [k + best, k]]
        A[:, k] = A[:, k] / A[pivot, k]
        A[pivot, k] = 1
        for j in range(A.shape[1]):
            if j != k and A[pivot, j] != 0:
                A[:, j] = BALLS.settled(A[:, j] - A[pivot, j] * A[:, k])
                A[pivot, j] = 0
        pivots.append(pivot)
    sizes = BALLS.powers(A)
    tiny = sizes <= np.max(sizes, axis=0, initial=NONE) - TOLERANCES.bits_of_coefficients
    A[tiny] = 0
    return A, pivots


def _short_ball(x: Any) -> Any:
    """Return a ball as the short fraction that it is to all digits, or unchanged."""
    if isinstance(x, int):
        return x
    near = short(float(x))
    if isinstance(near, float):
        return x
    off = x - in_balls(np.array([near], dtype=object))[0]
    return near if BALLS.powers(np.array([off], dtype=object))[0] <= -TOLERANCES.bits_of_coefficients else x


def short(x: float) -> Any:
    """Return the short fraction next to a float, or the float itself."""
    if abs(x) < TOLERANCES.coefficient_zero:
        return 0
    for fraction in (Fraction(x).limit_denominator(TOLERANCES.shift_denominator), Fraction(f"{x:.7g}")):
        if abs(float(fraction) - x) <= TOLERANCES.coefficient_zero * abs(x):
            return fraction
    return x


def in_balls(x: Array) -> Array:
    """Return an array of fractions and floats in balls."""
    from flint import arb, fmpq

    def one(y: Any) -> Any:
        return arb(fmpq(y.numerator, y.denominator)) if isinstance(y, Fraction) else y if isinstance(y, int) else arb(y)

    return np.asarray(np.frompyfunc(one, 1, 1)(x), dtype=object)
