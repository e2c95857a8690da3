"""Which fields leave the elements of a scene unchanged, as identities at random states with many digits.

The force of an element changes along a field X by K X + R X' + M X'' + (DX)ᵀ F, a row by C_q X, or D_q X + D_u X', at
states that satisfy the rows of its bodies. Where that vanishes at a random state, it does so everywhere (an analytic
function that is not zero vanishes at a random point with probability 0: Schwartz 1980, Zippel 1979; Mityagin 2015), and
the group of X carries motions into motions (Lie; Olver 1993, theorem 2.31). Doubles propose a space of fields, element
by element; balls of Arb with 320 bits, in which decimals of the file are exact, keep those of it for which the change
may vanish. Coordinates that rows determine, and coefficients that are no fractions, are balls that contain them: so a
change that excludes zero is one, however weak it is.

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
    excludes_zero,
    filled,
    in_ball,
    kept_combinations,
    many_bits,
    middle,
    plain_ball,
    radii,
    resolved,
    widened,
)
from mbstab.analysis.reference.changes import At, Cluster, Local, Results, State, What, Whole, independent
from mbstab.analysis.reference.element_comparison import ElementComparison
from mbstab.analysis.reference.fields import ROTATIONS, SIZES, Basis, Block, Field
from mbstab.analysis.reference.rounded_scene import exact_system
from mbstab.analysis.reference.tolerances import TOLERANCES
from mbstab.compiler.system import Array, System
from mbstab.errors import MbstabError

Conditions = tuple[list[int], Array, Array]
"""Numbers of fields, and orthonormal rows of their coefficients, relative to their scale, with how much each counts."""

NO_VALUE = (ArithmeticError, ValueError, MbstabError, np.linalg.LinAlgError)
"""Errors of a state at which an element has no value."""


class Identities:
    """Which fields of the class the elements of a scene have.

    Parameters
    ----------
    near : ElementComparison
        The scene and its reference, near which states lie.
    alone : Identities, optional
        Those of each element by itself: then only the sum of all forces must stay the same, as far as rows do not
        balance it.
    exact : System, optional
        The scene in balls, if its numbers are others than those of the file.
    states : Identities, optional
        Those at whose random states these are asked.
    """

    def __init__(
        self,
        near: ElementComparison,
        alone: Identities | None = None,
        exact: System | None = None,
        states: Identities | None = None,
    ) -> None:
        states = states or alone
        self.near, self.alone, self.together, self._given = near, alone, alone is not None, exact
        self.system, self.motion, self.rate = near.system, near.motion, near.rate_of_states
        self.basis = Basis(self.system)
        self._found: dict[tuple[int, int, float], list[State]] = {} if states is None else states._found

    @cached_property
    def _exact(self) -> System:
        """The scene in balls."""
        return self._given or exact_system(self.system)

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
        """The elements by the bodies and states that they contain, with all rows on these; of small scenes, all."""
        if self.alone is not None:
            return self.alone.clusters
        blocks, every = self.basis.blocks, tuple(range(len(self.basis.blocks)))
        together = not self.system.sparse and self.system.n_q <= TOLERANCES.searched_together
        found, touching = dict[tuple[int, ...], Cluster](), dict[int, list[tuple[tuple[int, ...], Local]]]()
        for on, own in self._locals:
            for k in on if own.element.rows else ():
                touching.setdefault(k, []).append((on, own))
            key = every if together else on
            if key not in found:
                exactly = partial(lambda key: [self.exact_blocks[k] for k in key], key)
                found[key] = Cluster([blocks[k] for k in key], exactly)
            found[key].elements.append(own.among(found[key]))
        for key, cluster in found.items():
            if together:
                cluster.rows = [x for x in cluster.elements if x.element.rows]
            else:
                near = {id(own): own for k in key for other, own in touching.get(k, ()) if set(other) <= set(key)}
                cluster.rows = [own.among(cluster) for own in near.values()]
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
        whole = Whole(self.basis.blocks, lambda: self.exact_blocks)
        whole.elements = [own.among(whole) for _, own in self._locals]
        whole.rows = [x for x in whole.elements if x.element.rows]
        return [whole]

    def _asked(self, what: What) -> list[Cluster]:
        """Return the clusters of which something is asked: sums of forces are those of the whole scene."""
        return self._searched if what in ("along", "work") else self.clusters

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

    @cached_property
    def _known(self) -> list[State]:
        """The states on rows at which other questions about a scene are asked, with random accelerations."""
        if self.alone is not None:
            return self.alone._known
        if self.system.scene.timed or not self.system.n_c:
            return []
        sizes, rng, time = self.motion.sizes, RandomNumbers(2), self.motion.time
        return [
            (x.q, x.u, self.rate**2 * sizes * rng.uniform(-1.0, 1.0, len(sizes)), time) for x in self.near.on_rows[1:]
        ]

    def _states(self, seed: int, count: int, spread: float) -> list[State]:
        """Return random states near the reference that satisfy all rows, in doubles: fewer where none are found."""
        key = seed, count, spread
        if key not in self._found:
            self._found[key] = self._searched_states(RandomNumbers(seed), count, spread)
        return self._found[key]

    def _searched_states(self, rng: RandomNumbers, count: int, spread: float) -> list[State]:
        motion, sizes, found = self.motion, self.motion.sizes, list[State]()
        # What holds at one time only, as where a drive passes through an axis, is no identity.
        time = motion.time + (float(rng.uniform(-1.0, 1.0, 1)[0]) / self.rate if self.system.scene.timed else 0.0)
        for k in reversed(range(count)):
            # At rest, in motion, accelerated: fast motions hide weak forces.
            kind = k % 3
            q, u, a = (spread * sizes * rng.uniform(-1.0, 1.0, len(sizes)) for _ in range(3))
            u = 0.0 * u if kind == 2 else motion.u + self.rate * u
            q, a = motion.q + q, self.rate**2 / spread * a if kind == 0 else 0.0 * a
            if self.system.n_c:
                at = self.near.onto_rows(q, u, time=time)
                if at is None:
                    continue
                q, u = at.q, at.u
            found.append((q, u, a, time))
        return found

    def _ranks(self, own: Cluster) -> tuple[int, int]:
        """Return the number of independent rows on positions at the reference, and that of all."""
        if own.ranks is None:
            motion, at = self.motion, own.columns
            state = motion.q[at], motion.u[at], motion.a[at], motion.time
            J = own.stacked({id(x): x.run("dynamics", state, DOUBLES) for x in own.closing}, "J", DOUBLES)
            J = np.nan_to_num(J) * motion.sizes[at]
            own.ranks = own.ranked(independent(J, own.holonomic))
        return own.ranks

    def _closed(self, own: Cluster, state: State) -> At:
        """Return a cluster in balls at a state near one in doubles at which its rows hold, by Newton's method."""
        q, u, a = (BALLS.of(x[own.columns]) for x in state[:3])
        time, sizes, found, asked = as_ball(state[3]), self.motion.sizes[own.columns], dict[int, Results](), own.closing
        further = [x for x in asked if not x.holonomic]
        kept, half = list[int](), TOLERANCES.half_of_digits
        # The last steps of coordinates and of speeds: each step doubles the digits.
        far, fast, least = np.inf if np.any(own.holonomic) else 0.0, np.inf, np.full(2, half**2)
        for visit in range(TOLERANCES.newton_steps_onto_rows if asked else 0):
            found |= {id(x): x.run("dynamics", (q, u, a, time), BALLS) for x in asked}
            J = own.stacked(found, "J", BALLS)
            if not visit:
                rough = middle(J) * sizes
                kept = independent(rough, own.holonomic)
                if own.ranked(kept) < self._ranks(own):
                    raise ArithmeticError("rows become dependent at this state")
            left, on = np.stack([own.stacked(found, key, BALLS)[kept] for key in "EV"], axis=-1), own.holonomic[kept]
            left[~on, 0] = 0
            if asked is not own.closing:
                left[on] = 0  # these hold, and are linear in the speeds
            steps = BALLS.shortest(BALLS.settled(J[kept]), sizes, BALLS.settled(left))
            reach = np.max(np.abs(middle(steps)) / sizes[:, None], axis=0).tolist()
            # Of rounded data midpoints have some digits more than they are known to.
            lengths = np.linalg.norm(middle(J[kept]) * sizes, axis=1)[:, None]
            vague = TOLERANCES.digits_of_midpoints * np.max(middle(radii(left)) / lengths, axis=0, initial=0.0)
            least = np.maximum(least, vague / (1.0, self.rate))
            settled = far < half or reach[0] < least[0]
            if not settled:
                q, far = BALLS.settled(q - steps[:, 0]), reach[0]
            u, before, fast = BALLS.settled(u - steps[:, 1]), fast, reach[1] / self.rate
            if settled and (not further or before < half or fast < least[1]):
                break
            asked = further if settled else asked
        else:
            if asked:
                raise ArithmeticError("no state on the rows")
        if asked:
            # Nothing is known of what rows determine beyond the last step.
            held = np.where(np.any(J != 0, axis=0), sizes, 0.0)
            off = np.maximum(TOLERANCES.rounding_on_rows, np.where(least > half**2, 16.0 * least, 0.0))
            q, u = widened(q, off[0] * held * np.any(own.holonomic)), widened(u, off[1] * held * self.rate)
        return self._at(own, (q, u, a, time), BALLS)

    # --- the space of fields ----------------------------------------------------------------------------------------

    @cached_property
    def _proposed(self) -> Array:
        """The fields that leave each element unchanged to rounding, as columns, shape (basis.size, number)."""
        return self._unchanged(TOLERANCES.proposed_change)

    def _unchanged(self, least: float) -> Array:
        """Return the fields along which each element changes by less than a part of its terms, as columns."""
        parts = [(on, rows[: int(np.sum(s > least))]) for on, s, rows in self._conditions]
        return null_space(parts, self.basis.size, least) * self.scale[:, None]

    @cached_property
    def _conditions(self) -> list[Conditions]:
        """What elements demand of the fields."""
        known = dict[tuple[Any, ...], list[Conditions]]()
        equations = sum(len(own.element.rows) or len(own.columns) for x in self._searched for own in x.elements)
        count = TOLERANCES.states_beyond + 2 * self.basis.size // equations
        parts = list[Conditions]()
        for own in self._searched:
            if own.key not in known:
                known[own.key] = self._conditions_of(own, count)
            parts += [([own.fields[k] for k in places], s, rows) for places, s, rows in known[own.key]]
        return parts

    def _conditions_of(self, own: Cluster, count: int) -> list[Conditions]:
        """Return what elements demand of the fields of their bodies."""
        for spread in (None, *TOLERANCES.state_spreads[1:]):
            with np.errstate(all="ignore"), suppress(*NO_VALUE):
                states = self._known if spread is None else self._states(2, count, spread)
                if len(states) > 1 and (found := self._demands(own, states)):
                    return found
        return [(list(range(len(own.fields))), np.ones(len(own.fields)), np.eye(len(own.fields)))]

    def _demands(self, own: Cluster, states: Sequence[State]) -> list[Conditions]:
        """Return the changes of elements along fields at states, relative to their terms."""
        if not states:
            return []
        scale, found = self.scale[own.fields], list[Conditions]()
        q, u, a = (np.array(x)[:, own.columns] for x in list(zip(*states, strict=True))[:3])
        every = [(q, u, a)] if not self.together else zip(q, u, a, strict=True)
        own.rough = [self._at(own, (*x, states[0][3]), DOUBLES) for x in every]
        for change in (x for at in own.rough for x in at.changes("along")):
            on = own.fields_of(change.of)
            most = np.exp2(np.max(change.size + np.log2(scale[on]), axis=-1, keepdims=True, initial=NONE))
            # A row without terms is rounding; what is dropped with it is seen in balls.
            felt = most > TOLERANCES.row_without_terms * np.max(most, initial=0.0)
            rows = np.where(felt, change.value * scale[on] / most, 0.0)
            good = rows[np.all(np.isfinite(rows), axis=(-1, -2))].reshape(-1, len(on))
            if rows.size and not len(good):
                return []
            _, s, right = np.linalg.svd(good, full_matrices=False)
            found.append((on, s / np.max(s, initial=1.0), right))
        return found

    def nearly(self, closeness: float) -> tuple[Array, int]:
        """Return the fields that leave each element unchanged but for numbers that are known so well, as columns.

        Those that are equal on the rows count once; their number is that of all.
        """
        found = self._unchanged(max(TOLERANCES.proposed_change, TOLERANCES.roundings_within_digits * closeness))
        simple = self._simple(found, TOLERANCES.simple_field[0])
        return np.hstack([simple, np.asarray(self._further(simple, found), dtype=float)]), found.shape[1]

    def _at(self, own: Cluster, state: State, f: Doubles) -> At:
        return own.at(state, f, self.motion.sizes[own.columns], self.rate)

    @cached_property
    def space(self) -> Array:
        """The fields that leave each element unchanged, as columns of balls, shape (basis.size, number)."""
        found = self._proposed
        best, tried = found[:, :0], -1
        for closeness in TOLERANCES.simple_field:
            simple = self._simple(found, closeness)
            # What only looks simple to doubles is not unchanged, and hides the field beside it.
            if simple.shape[1] == tried or best.shape[1] == found.shape[1]:
                break
            kept, tried = self._held(simple, self._further(simple, found)), simple.shape[1]
            best = kept if kept.shape[1] > best.shape[1] else best
        return best

    def _held(self, simple: Array, others: Array) -> Array:
        """Return those combinations of proposed fields, some of them simple, that leave each element unchanged."""
        with many_bits():
            exact = in_balls(np.hstack([simple.astype(int).astype(object), others]))
            rough = [k for k, c in enumerate(others.T, simple.shape[1]) if any(isinstance(x, float) for x in c)]
            if moving := [k for k in rough if self._moves(others[:, k - simple.shape[1]])]:
                exact[:, moving] = self._refined(exact[:, moving], np.array(exact == 1))
            return self._kept(np.delete(exact, [k for k in rough if k not in moving], axis=1))

    def _further(self, simple: Array, space: Array) -> Array:
        """Return the fields of a space besides simple ones, in echelon form; what is equal on the rows counts as one.

        Of equal fields that one is taken that turns the fewest bodies with the ground.
        """
        number = space.shape[1] - simple.shape[1]
        if not number:
            return np.zeros((len(space), 0), dtype=object)
        scale, weight = self.scale, np.where(self.basis.lengths, 1e-3, 1.0)
        S, Q = simple / scale[:, None], space / scale[:, None]
        S = np.linalg.qr(S)[0] if S.shape[1] else S
        # Those that vanish at pivots of the simple ones are none of their combinations.
        fixed = pivots_of(S, weight)
        Q = Q - S @ np.linalg.solve(S[fixed], Q[fixed]) if fixed else Q
        Q = np.linalg.svd(Q, full_matrices=False)[0][:, :number]
        known, new = self._images(S), self._images(Q)
        room = np.linalg.qr(known)[0] if known.shape[1] else known
        _, s, right = np.linalg.svd(np.linalg.qr(new - room @ (room.T @ new), mode="r"))
        rank = int(np.sum(s > TOLERANCES.independent_fields))
        found, equal = Q @ right[:rank].T, Q @ right[rank:].T
        if taken := pivots_of(equal, np.where(self.basis.still, 0.5, 1.0) * weight):
            found = found - equal @ np.linalg.solve(equal[taken], found[taken])
        return echelon(found * scale[:, None], scale, weight)

    def _images(self, c: Array) -> Array:
        """Return what fields, given relative to their scale, do to the coordinates at states on the rows."""
        found, c = [np.zeros((1, c.shape[1]))], c * self.scale[:, None]
        for own in self._searched:
            sizes = self.motion.sizes[own.columns]
            for at in own.rough:
                X = np.concatenate([x[0] for x in at.fields(c[own.fields])], axis=-2) / sizes[:, None]
                found.append(X.reshape(int(np.prod(X.shape[:-1])), c.shape[1]))
        return np.concatenate(found)

    def _moves(self, c: Array) -> bool:
        """Return whether a field moves the reference."""
        step = self.field(c).field(self.motion.q) / self.motion.sizes
        return bool(
            np.max(np.abs(step)) > TOLERANCES.field_felt * np.max(np.abs(np.array(c, dtype=float) / self.scale))
        )

    def _tested(self) -> Iterator[tuple[Cluster, At]]:
        """Yield clusters at as many random states as it takes to see all their fields."""
        for own in self._searched:
            for visit in range(TOLERANCES.states_beyond + len(own.fields) // own.least):
                for at in self._visited(own, visit):
                    yield own, at

    def changes(self, c: Array) -> Array:
        """Return what fields, as columns of balls, do to all elements at random states, as rows."""
        found = [self._along(own, at, c[own.fields], "along") for own, at in self._tested()]
        return np.concatenate([BALLS.zeros((0, c.shape[1])), *found])

    def _refined(self, space: Array, pivots: Array) -> Array:
        """Return fields that doubles propose with all digits, by Newton's method; others do not converge."""
        free = np.flatnonzero(~np.any(pivots & (np.sum(pivots, axis=1, keepdims=True) == 1), axis=1))
        parts, slopes = list[tuple[Cluster, At, Array]](), [np.zeros((0, self.basis.size))]
        for own, at in self._tested():
            value = self._along(own, at, BALLS.of(np.diag(self.scale[own.fields])), "along")
            units = row_units(np.where(excludes_zero(value), BALLS.powers(value), NONE))
            slopes.append(np.zeros((len(value), self.basis.size)))
            slopes[-1][:, own.fields] = middle(value * units)
            parts.append((own, at, units))
        # What the rows leave open stays as proposed: a step along it would be rounding that no step takes away.
        matrix = np.concatenate(slopes)[:, free]
        solved = independent(matrix.T, np.any(space[free] != 0, axis=1))
        inverse = np.linalg.pinv(matrix[:, solved], rcond=TOLERANCES.proposed_change)
        free = free[solved]
        for _ in range(TOLERANCES.steps_of_refinement):
            found = [self._along(own, at, space[own.fields], "along") * x for own, at, x in parts]
            left = np.concatenate([BALLS.zeros((0, space.shape[1])), *found])
            power = float(np.max(BALLS.powers(left), initial=NONE))
            if not np.isfinite(power):
                break
            unit = BALLS.of(np.array(2.0))[()] ** int(power)
            step = -inverse @ middle(left / unit) * self.scale[free][:, None]
            space[free] = BALLS.settled(space[free] + BALLS.of(step) * unit)
        # Data that are rounded decimals determine no more digits than they have.
        off = max(TOLERANCES.rounding_on_rows, 8.0 * float(np.max(middle(radii(left)), initial=0.0)))
        most = np.max(np.abs(middle(space)) / self.scale[:, None], axis=0)
        space[free] = widened(space[free], off * self.scale[free][:, None] * most)
        return space

    def _simple(self, space: Array, closeness: float) -> Array:
        """Return independent fields near a space that move everything with the ground, or single bodies."""
        bodies, columns = [b for b in self.basis.blocks if b.body is not None], []
        if bodies:
            columns = [[b.start + k for b in bodies] for k in range(bodies[0].ground)]
        columns += [[k] for k in range(self.basis.size)]
        Q = np.linalg.qr(space / self.scale[:, None])[0] if space.shape[1] else space
        room, found = np.zeros((self.basis.size, len(columns))), list[Array]()
        for places in columns:
            x = np.zeros(self.basis.size)
            x[places] = 1.0
            unit = x / self.scale / np.linalg.norm(x / self.scale)
            if np.linalg.norm(unit - Q @ (Q.T @ unit)) < closeness:
                known = room[:, : len(found)]
                left = unit - known @ (known.T @ unit)
                if np.linalg.norm(left) > TOLERANCES.independent_fields:
                    room[:, len(found)] = left / np.linalg.norm(left)
                    found.append(x)
        return np.array(found).reshape(-1, self.basis.size).T

    def _kept(self, space: Array, what: What = "along") -> Array:
        """Return the combinations of fields for which nothing shows anywhere, at fresh states until none fails."""
        doubtful = self._asked(what)
        for k in range(TOLERANCES.rounds_of_identities):
            failed = []
            for own in doubtful:
                on = np.flatnonzero(np.any(space[own.fields] != 0, axis=0)).tolist()
                if not on:
                    continue
                found = [self._along(own, x, space[own.fields][:, on], what) for x in self._visited(own, k)]
                combinations = kept_combinations(np.concatenate(found)) if found else BALLS.zeros((len(on), 0))
                if combinations.shape[1] < len(on):
                    # A field that passes with the others left out was not chosen by this state.
                    failed += [own] * bool(np.any(np.sum(combinations != 0, axis=0) > 1))
                    mixed = BALLS.multiplied(space[:, on], combinations)
                    space = np.hstack([np.delete(space, on, axis=1), mixed])
            if not failed:
                return space
            doubtful = failed
        return space[:, :0]

    def _visited(self, own: Cluster, visit: int = 0) -> list[At]:
        """Return elements at random states in balls, others at each visit: far from the reference, and near it.

        Only what the file writes is asked near it: a function may be flat to all digits elsewhere.
        """
        while len(own.visited) <= visit:
            written = [x for x in own.elements if x.written]
            found = self._exactly(own, 3 + len(own.visited), TOLERANCES.exact_spreads[0], own.elements)
            for spread in TOLERANCES.exact_spreads[1:] if written else ():
                found += self._exactly(own, 3 + len(own.visited), spread, written)
            own.visited.append(found)
        return own.visited[visit]

    def states(self, own: Cluster) -> list[At]:
        """Return the elements of a cluster at random states in balls, the first of them far from the reference."""
        with many_bits():
            return self._visited(own)

    def beside(self, own: Cluster) -> list[At]:
        """Return a cluster at random states in motion in balls, which need not satisfy its rows."""
        if not own.beside:
            with many_bits():
                for x in (x for x in self.near.states if np.any(x.u)):
                    q, u, a = (BALLS.of(y[own.columns]) for y in (x.q, x.u, x.a))
                    own.beside.append(self._at(own, (q, u, a, as_ball(self.motion.time)), BALLS))
        return own.beside

    def _exactly(self, own: Cluster, seed: int, spread: float, elements: Sequence[Local]) -> list[At]:
        """Return some elements of a cluster at a random state in balls; none where they have no value."""
        for part in TOLERANCES.state_spreads:
            with np.errstate(all="ignore"), suppress(*NO_VALUE):
                first = (
                    self._known[:1]
                    if seed == 3 and spread == TOLERANCES.exact_spreads[0] and part == TOLERANCES.state_spreads[0]
                    else []
                )
                for state in first or self._states(seed, 1, spread * part):
                    found = [self._closed(own, state)]
                    found[0].evaluate(elements)
                    if self.together:  # in a sum, terms of fast motions hide weak forces
                        q, u, a, time = state
                        with suppress(*NO_VALUE):  # a tyre has no slip at rest
                            rest = self._closed(own, (q, 0.0 * u, 0.0 * a, time))
                            rest.evaluate(elements)
                            found.append(rest)
                    return found
        return []

    def _along(self, own: Cluster, at: At, c: Array, what: What) -> Array:
        """Return what combinations of the fields of a cluster do to its elements at a state."""
        return np.concatenate([BALLS.zeros((0, c.shape[1])), *(x.value for x in at.changes(what, c))])

    # --- questions --------------------------------------------------------------------------------------------------

    def idle(self, fields: Sequence[Field]) -> Array:
        """Return the combinations of fields along which no force does work and which no row resists.

        Returns
        -------
        c : ndarray, shape (len(fields), number)
        """
        if self._all_act(fields):
            return np.zeros((len(fields), 0))
        with many_bits():
            columns = self._columns(fields)
            # Below the fields stand the coefficients of their combinations.
            kept = np.vstack([columns, BALLS.of(np.eye(len(fields)))])
            asked: tuple[What, ...] = ("work", "held")
            for what in asked:
                kept = self._kept(kept, what)
            return middle(kept[len(columns) :])

    def _all_act(self, fields: Sequence[Field]) -> bool:
        """Return whether forces do work along all combinations of fields, or rows resist them: doubles show it."""
        c = np.array([x.c / np.max(np.abs(x.c / self.scale)) for x in fields]).T
        rows = [np.zeros((1, len(fields)))]
        asked: tuple[What, ...] = ("work", "held")
        for what in asked:
            ats = ((own, at) for own in self._asked(what) for at in own.rough)
            for x in (x for own, at in ats for x in at.changes(what, c[own.fields])):
                most = np.exp2(np.max(np.maximum(x.size, x.usual), axis=-1, keepdims=True, initial=NONE))
                part = (x.value / np.where(most > 0.0, most, 1.0)).reshape(-1, len(fields))
                rows.append(part[np.all(np.isfinite(part), axis=-1)])
        left = np.linalg.svd(np.concatenate(rows), compute_uv=False)
        return len(left) >= len(fields) and bool(left[-1] > TOLERANCES.proposed_change)

    def passing(self, fields: Sequence[Field], what: What) -> list[bool]:
        """Return for each field whether nothing shows along it, of what is asked."""
        if not fields:
            return []
        good = ~self._seen(fields, what)
        with many_bits():
            space = self._columns(fields)
            good &= [resolved(x) for x in space.T]
            for own in self.clusters:
                on = np.flatnonzero(good & np.any(space[own.fields] != 0, axis=0))
                if not len(on):
                    continue
                visited = self._visited(own)
                good[on] &= bool(visited)
                for at in visited:
                    good[on] &= ~np.any(excludes_zero(self._along(own, at, space[own.fields][:, on], what)), axis=0)
        result: list[bool] = good.tolist()
        return result

    def _seen(self, fields: Sequence[Field], what: What) -> Flags:
        """Return for each field whether doubles show something along it: then no balls are asked."""
        c, found = np.array([x.c for x in fields]).T, np.zeros(len(fields), dtype=bool)
        _ = self._proposed  # has the states
        for own in self.clusters:
            for x in (x for at in own.rough for x in at.changes(what, c[own.fields])):
                most = np.exp2(np.maximum(x.size, x.usual))
                seen = np.abs(x.value) > TOLERANCES.proposed_change * most
                found |= np.any(seen.reshape(-1, len(fields)), axis=0)
        return found

    def worth(self, field: Field) -> Literal["structural", "enclosed"]:
        """Return what an identity of a field of the space rests on: structural if no element contains what it moves."""
        with many_bits():
            fields = self._columns([field])
            for own in self.clusters:
                if np.any(fields[own.fields] != 0):
                    found = (self._along(own, at, fields[own.fields], "along") for at in self._visited(own))
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

    def known_to(self, c: Array, bits: int) -> Array:
        """Return the coefficients of a motion that is known to so many bits, relative to the largest, as balls."""
        if not np.any(c != 0):
            return BALLS.zeros(c.shape)
        with many_bits():
            found = in_balls(c)
            rough = np.abs(middle(found))
            return widened(
                found, np.where(rough, np.max(rough / self.scale, initial=0.0) * self.scale, 0.0) * 2.0**-bits
            )

    def changed(self, c: Array, bits: int = TOLERANCES.bits_of_motion) -> list[str]:
        """Return the entries that are not the same a little later after a motion along a field.

        Coefficients are those of a motion, which is known to so many bits.
        """
        found = dict[str, None]()
        with many_bits():
            fields, step = self.known_to(c, bits)[:, None], Fraction(1, 2**70) / Fraction(self.rate)
            for own in self.clusters:
                pairs = ((at, x) for at in self._visited(own) for x in at.changes("along", fields[own.fields]))
                for at, x in pairs:
                    later = at.later(x.of, step, len(x.value))[:, None] if self.system.scene.timed else 0
                    if np.any(excludes_zero(x.value + later)):
                        found[x.of.element.path] = None
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

    def of_generator(self, generator: Any) -> Array | None:
        """Return the coefficients of a motion of everything with the ground, and of spins; None if it has none.

        Parameters
        ----------
        generator : Generator
            In doubles or in balls.
        """

        def plain(x: Any) -> Any:
            return x if isinstance(x, (int, float)) else as_ball(x)

        axis, point, shift = ([plain(x) for x in v] for v in (generator.axis, generator.point, generator.velocity))
        turn = np.array([plain(generator.rate) * x for x in axis], dtype=object)
        shifted = np.array(shift, dtype=object) - np.cross(turn, np.array(point, dtype=object))
        found = np.full(self.basis.size, 0, dtype=object)
        for b in (b for b in self.basis.blocks if b.body is not None):
            first = ROTATIONS[b.kind]
            found[b.start : b.start + first] = shifted[:first]
            found[b.start + first : b.start + b.ground] = turn[first + 3 - b.ground :]
        for i, x in enumerate(map(plain, generator.spins)):
            if x == 0:
                continue
            own = self.of_shift(i)
            if own is None:
                return None
            found = found + x * own
        return found

    def contains(self, entries: Any) -> bool:
        """Return whether the space of fields contains one, given by exact coefficients."""
        space, pivots = self._reduced
        with many_bits():
            x = np.array(entries, dtype=object)
            taken = [k for k, row in enumerate(pivots) if x[row] != 0]
            if not taken:
                return not np.any(x != 0)
            on = sorted({*filled(x), *(i for k in taken for i in self._filled[k])})
            c, x = in_balls(x[[pivots[k] for k in taken]]), in_balls(x[on])
            left = x - BALLS.multiplied(space[np.ix_(on, taken)], c[:, None])[:, 0]
            return bool(np.all(BALLS.powers(left) <= np.max(BALLS.powers(x)) - TOLERANCES.bits_of_coefficients))

    @cached_property
    def _reduced(self) -> tuple[Array, list[int]]:
        with many_bits():
            return reduced(self.space, self.scale, self.basis.lengths)

    @cached_property
    def _filled(self) -> list[list[int]]:
        """The places at which the reduced columns are not zero."""
        return [filled(c) for c in self._reduced[0].T]

    def within(self, excluded: Flags) -> Array:
        """Return the fields of the space whose coefficients vanish where they are excluded, as reduced columns."""
        # Each reduced column has a row of its own: one whose row is excluded takes no part.
        space, pivots = self._reduced
        part = space[:, [k for k, row in enumerate(pivots) if not excluded[row]]]
        found = self._those(part, part[excluded])
        found[excluded] = 0
        return found

    def in_place(self) -> list[Field]:
        """Return the fields of the space that turn bodies in place, and do nothing else."""
        excluded: Flags = np.ones(self.basis.size, dtype=bool)
        for b in self.basis.blocks:
            if b.kind == "spatial":
                excluded[b.start + 6 : b.start + 9] = False
        return [self.field(c) for c in self.within(excluded).T]

    def common(self, bodies: Sequence[Block]) -> Array:
        """Return the fields of the space that move all bodies with the ground, and states, as reduced columns."""
        space, rows = self.space, []
        parts = [(slice(b.start, b.start + b.ground), slice(b.start + b.ground, b.fields.stop)) for b in bodies]
        first = parts[0][0]
        for ground, own in parts:
            rows += [space[own], space[ground] - space[first]]
        found = self._those(space, np.concatenate(rows))
        for ground, own in parts:
            found[ground], found[own] = found[first], 0
        return found

    def _those(self, space: Array, rows: Array) -> Array:
        """Return the combinations of fields for which rows vanish, as reduced columns of exact numbers."""
        with many_bits():
            combinations = kept_combinations(rows)
            if not combinations.shape[1]:
                return np.zeros((self.basis.size, 0), dtype=object)
            found, _ = reduced(BALLS.multiplied(space, combinations), self.scale, self.basis.lengths)
            return np.asarray(np.frompyfunc(_short_ball, 1, 1)(found), dtype=object)


def row_units(powers: Array) -> Array:
    """Return powers of two that bring the largest entry of each row to about one, as a column; 0 for rows of zeros."""
    most = np.max(powers, axis=1, initial=NONE)
    return BALLS.of(np.where(most > NONE, np.exp2(-np.where(most > NONE, most, 0.0)), 0.0)[:, None])


def null_space(parts: Sequence[tuple[list[int], Array]], size: int, least: float) -> Array:
    """Return the vectors that obey conditions on parts of their entries, as orthonormal columns.

    Parameters
    ----------
    parts : sequence of (list of int, ndarray)
        The numbers of the entries, and orthonormal rows.
    size : int
        Number of entries.
    least : float
        Combinations of conditions that restrict vectors by less do not count.
    """
    rows = sum(len(x) for _, x in parts)
    if size <= TOLERANCES.fields_at_once:
        matrix, start = np.zeros((rows, size)), 0
        for fields, conditions in parts:
            matrix[start : start + len(conditions), fields] = conditions
            start += len(conditions)
        _, s, right = np.linalg.svd(matrix)
        return right[int(np.sum(s > least)) :].T
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


def echelon(space: Array, scale: Array, weight: Array) -> Array:
    """Return the reduced echelon form of a space of columns, with fractions where these are short, as objects.

    It depends on the space alone, not on the columns that are given.

    Parameters
    ----------
    space : ndarray, shape (size, number)
        Independent columns.
    scale : ndarray, shape (size,)
        Sizes of the entries.
    weight : ndarray, shape (size,)
        Those with the largest are preferred as pivots.
    """
    if not space.shape[1]:
        return space.astype(object)
    Q = np.linalg.qr(space / scale[:, None])[0]
    pivots = pivots_of(Q, weight)
    found = Q @ np.linalg.inv(Q[pivots]) * scale[:, None] / scale[pivots]
    return np.asarray(np.frompyfunc(short, 1, 1)(found), dtype=object)


def pivots_of(Q: Array, weight: Array) -> list[int]:
    """Return as many rows of orthonormal columns as there are columns, that are independent.

    The first of the largest is taken, then the columns that vanish there are left: by its length relative to these,
    which depends on the space alone.
    """
    found = list[int]()
    while Q.shape[1]:
        sizes = np.linalg.norm(Q, axis=1) * weight
        k = int(np.argmax(sizes >= (1.0 - TOLERANCES.proposed_change) * np.max(sizes)))
        found.append(k)
        mirror = Q[k].copy()
        mirror[0] += np.copysign(np.linalg.norm(mirror), mirror[0])
        Q = (Q - np.outer(Q @ mirror, mirror * (2.0 / (mirror @ mirror))))[:, 1:]
    return found


def reduced(space: Array, scale: Array, lengths: Flags) -> tuple[Array, list[int]]:
    """Return the reduced echelon form of columns of balls, and the numbers of its pivots.

    Rotations are its pivots before translations: the place of an axis is a decimal, its inverse mostly not.
    """
    A, weight, pivots = space.copy(), np.where(lengths, 1e-3, 1.0) / scale, list[int]()
    weighted = np.abs(middle(A)) * weight[:, None]
    most = np.max(weighted, axis=1, initial=0.0)
    for k in range(A.shape[1]):
        pivot = int(np.argmax(most))
        best = int(np.argmax(weighted[pivot, k:]))
        for x in (A, weighted):
            x[:, [k, k + best]] = x[:, [k + best, k]]
        on = filled(A[:, k])
        A[on, k] = A[on, k] / as_ball(A[pivot, k])
        A[pivot, k] = 1
        for j in filled(A[pivot]):
            if j != k:
                A[on, j] = A[on, j] - A[pivot, j] * A[on, k]
                A[pivot, j] = 0
                weighted[on, j] = np.abs(middle(A[on, j])) * weight[on]
        most[on] = np.max(weighted[on, k + 1 :], axis=1, initial=0.0)
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
    return np.asarray(np.frompyfunc(in_ball, 1, 1)(x), dtype=object)
