"""Families of steady motions that no structure explains, as identities.

A motion is of the kind of the reference if its speeds are those of symmetries: E(q, ω, ν) = 0 with u = Σ ω_k X_k(q),
u̇ = DX u, forces in balance and rows. Where A, apart from symmetries, has a null space that symmetries, conserved
functions and reversors do not explain, a finite step is taken along a random vector of it, and the rest solved by
Newton's method with many digits. What is then left along the null space is an analytic function of the step (Lyapunov,
Schmidt; Golubitsky, Schaeffer 1985): one that vanishes at a random step does so everywhere, and the motions are a
manifold of the dimension of the null space. Digits are many, not all: "as far as checked".

Where constants of the motion that are linear in places and speeds tell the motions apart
(`mbstab.analysis.verdict.constants`), no search is needed: each value of them belongs to exactly one motion.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from mbstab.analysis.algebra.arrays import RandomNumbers, least_squares, norms
from mbstab.analysis.algebra.ball_arrays import BALLS, NONE, as_ball, many_bits, middle
from mbstab.analysis.algebra.stacks import beside, complement, unit
from mbstab.analysis.algebra.tolerances import TOLERANCES as ALGEBRA
from mbstab.analysis.reference.fields import field_values
from mbstab.analysis.reference.identities import NO_VALUE, in_balls
from mbstab.analysis.reference.rounded_scene import exact_system
from mbstab.analysis.verdict.constants import LinearFunctions, linear_functions
from mbstab.analysis.verdict.directions import span
from mbstab.analysis.verdict.neutral import Separated, Structure
from mbstab.analysis.verdict.spectrum import Neutral
from mbstab.analysis.verdict.tolerances import TOLERANCES
from mbstab.compiler.system import Array
from mbstab.errors import counted


def family(structure: Structure, found: Separated, count: int) -> Neutral | None:
    """Return the neutral directions with a family that was followed, or None if it does not explain the zeros.

    Parameters
    ----------
    found : Separated
    count : int
        Number of unexplained zero eigenvalues.
    """
    if (told := _told_apart(structure, found, count)) is not None:
        return told
    n = len(found.S)
    symmetries = structure.symmetric
    Q = complement(symmetries)
    if n > TOLERANCES.family_states or not Q.shape[1]:
        return None
    _, s, right = np.linalg.svd(Q.T @ found.S @ Q)
    size = int(np.sum(s <= TOLERANCES.family_singular_value * max(float(s[0]), structure.invariance.rate)))
    known = found.T.shape[1] + len(found.L) - symmetries.shape[1]
    if size != known + count or (
        size < len(s) and s[-size - 1] < ALGEBRA.rank_gap * TOLERANCES.family_singular_value * s[0]
    ):
        return None
    null = Q @ right[-size:].T
    if not _drifts_along_symmetries(structure, found, symmetries, null):
        return None
    try:
        with np.errstate(all="ignore"), many_bits():
            direction = null @ RandomNumbers(3).uniform(-1.0, 1.0, size)
            members = _Members(structure)
            # Pieces may meet at the reference.
            if not all(members.reached(sign * direction) for sign in (1.0, -1.0)):
                return None
    except NO_VALUE:
        return None
    T = span(symmetries, null)
    wider = replace(found, T=T, L=np.zeros((0, n)), B=complement(T))
    checked = "motions of the same kind were found in a random direction of the family, to 70 digits"
    directions = counted(size - known, "more direction" if known else "direction")
    names = _speeds(structure, found.S @ null) or [f"motions of the same kind nearby ({directions})"]
    return Neutral(
        found.neutral.symmetries,
        (*found.neutral.family, *names),
        T.shape[1],
        structure.chains(wider),
        "numerical",
        checked,
    )


def _told_apart(structure: Structure, found: Separated, count: int) -> Neutral | None:
    """Return the neutral directions if further constants of the motion explain all zeros that are left, or None."""
    T, n = found.T, len(found.S)
    if n > TOLERANCES.family_states:
        return None
    functions = linear_functions(structure)
    if functions is None:
        return None
    columns = functions.constants.T - T @ (T.T @ functions.constants.T)
    L = span(found.L.T, columns[:, np.linalg.norm(columns, axis=0) > TOLERANCES.independent_direction]).T
    wider = replace(found, L=L, B=complement(beside(T, L.T)))
    size = max(float(np.linalg.norm(found.S, 2)), structure.invariance.rate)
    changing = L @ found.S
    closed = float(np.max(np.abs(changing - (changing @ T) @ T.T), initial=0.0)) <= TOLERANCES.direction_closure * size
    least = np.linalg.svd(wider.A, compute_uv=False)[-1:]
    if len(L) != len(found.L) + count or not closed or np.any(least <= TOLERANCES.family_singular_value * size):
        return None
    exact = _all_linear(functions, structure.symmetric, found, T.shape[1] + len(L))
    name = f"constants of the motion that are linear in places and speeds ({count})"
    return Neutral(
        found.neutral.symmetries, (*found.neutral.family, name), T.shape[1] + len(L), structure.chains(wider),
        "numerical", linear=exact,
    )  # fmt: skip


def _all_linear(functions: LinearFunctions, symmetries: Array, found: Separated, zeros: int) -> bool:
    """Return whether functions that obey linear equations tell all motions apart, up to symmetries and nothing else.

    Zero is a semisimple eigenvalue of these equations if there are as many constants as zeros.
    """
    n, d = symmetries.shape
    rank, constants = span(functions.closed.T).shape[1], span(found.L.T, functions.constants.T).shape[1]
    blind = float(np.max(np.abs(functions.closed @ symmetries), initial=0.0)) <= TOLERANCES.independent_direction
    return blind and rank + d == n and constants >= zeros - d


def _drifts_along_symmetries(structure: Structure, found: Separated, symmetries: Array, null: Array) -> bool:
    """Return whether members of a family stand still up to symmetries and common speeds along them.

    Those that drift along the family itself may come to members that are unstable (Fenichel 1971; Krupa 1990).
    """
    group = span(symmetries, structure.at.of_boosts(structure.invariance.boosts))
    moved = found.S @ null
    left = moved - group @ (group.T @ moved)
    size = max(float(np.linalg.norm(found.S, 2)), structure.invariance.rate)
    return float(np.linalg.norm(left)) <= TOLERANCES.direction_closure * size


def _speeds(structure: Structure, moved: Array) -> list[str]:
    """Return names of the speeds that tell the motions of a family apart, if each goes along a symmetry of its own."""
    items = structure.invariance.symmetries
    parts = np.linalg.pinv(unit(structure.at.of_symmetries(items))) @ moved
    size = TOLERANCES.direction_closure * float(np.linalg.norm(structure.at.S, 2))
    counts = np.linalg.norm(parts, axis=-1) > size
    names = [f"speed of {x.name}" for x, goes in zip(items, counts.tolist(), strict=True) if goes]
    return names if len(names) == moved.shape[1] else []


class _NoMember(Exception):
    """Forces are left where a motion was looked for."""


class _Members:
    """The equations E(q, ω, ν) = 0 of motions whose speeds are those of symmetries, u = Σ ω_k X_k(q), in balls."""

    def __init__(self, structure: Structure) -> None:
        self.structure, self.identities = structure, structure.invariance.identities
        self.motion, self.system = structure.linear.motion, structure.linear.system
        self.exact, self.rate = exact_system(self.system), structure.invariance.rate
        # A drive breaks the shift along it; what is driven goes on so.
        invariance, driven = structure.invariance, self.system.scene.timed
        own = [g for g in self.motion.generators if driven and g.moves and not invariance.broken(g)]
        more = [np.array(invariance.along(g).exact, dtype=object)[:, None] for g in own[:1]]
        self.fields = np.hstack([self.identities.space, *(in_balls(x) for x in more)])
        n, k, c = self.system.n_q, self.fields.shape[1], self.system.n_c
        self.parts = slice(0, n), slice(n, n + k), slice(n + k, n + k + c)
        self.start = np.concatenate([self.motion.q, self._rates(self.motion.q, self.motion.u), self.motion.nu])
        units = [self.motion.sizes, np.full(k, self.rate), np.ones(c)]
        self.units = np.concatenate(units)

    def _values(self, q: Array, u: Array) -> tuple[Array, Array]:
        """Return the fields and their rates of change along speeds, in balls, shape (n_q, k)."""
        found = BALLS.zeros((2, len(q), self.fields.shape[1]))
        for b in self.identities.exact_blocks:
            x = field_values(b, q[b.part], u[b.part], 0 * u[b.part])
            for whole, own in zip(found, x[:2], strict=True):
                whole[b.part] = BALLS.multiplied(own, self.fields[b.fields])
        return found[0], found[1]

    def _rates(self, q: Array, u: Array) -> Array:
        """Return the rates of the symmetries of which speeds are made, as nearly as can be."""
        X = middle(self._values(BALLS.of(q), BALLS.of(u))[0]) / self.motion.sizes[:, None]
        found: Array = least_squares(X, u / self.motion.sizes, rcond=TOLERANCES.independent_direction)
        return found

    def speeds(self, x: Array) -> Array:
        """Return u."""
        q, w, _ = (x[part] for part in self.parts)
        found: Array = BALLS.multiplied(self._values(q, 0 * q)[0], w[:, None])[:, 0]
        return found

    def residual(self, x: Array) -> Array:
        """Return the forces that are left, and the residuals of the rows."""
        q, w, nu = (x[part] for part in self.parts)
        u = self.speeds(x)
        a = BALLS.multiplied(self._values(q, u)[1], w[:, None])[:, 0]
        at = self.exact.dynamics(list(q), list(u), self.motion.time)
        M, J, F, E, V = (np.array(y, dtype=object) for y in (at.M, at.J, at.F0, at.E, at.V))
        left = F + BALLS.multiplied(M, a[:, None])[:, 0]
        if len(nu):
            left = left + BALLS.multiplied(J.T, nu[:, None])[:, 0]
        n_h = self.system.n_h
        return np.concatenate([left, E[:n_h], V[n_h:]])

    @cached_property
    def _slopes(self) -> tuple[Array, Array, Array, Array]:
        """DE, divided by the sizes of its rows and columns, these sizes, and the change of the motion so divided."""
        start, step = BALLS.of(self.start), as_ball(2.0) ** -TOLERANCES.bits_of_difference
        first, here, columns, changes = self.residual(start), self.speeds(start), list[Array](), list[Array]()
        for i, size in enumerate(BALLS.of(self.units)):
            moved = start.copy()
            moved[i] = moved[i] + step * size
            columns.append(middle((self.residual(moved) - first) / step))
            change = np.concatenate([(moved - start)[self.parts[0]], (self.speeds(moved) - here) / as_ball(self.rate)])
            changes.append(middle(change / step) / np.tile(self.motion.sizes, 2))
        matrix = np.array(columns).T
        rows = self._felt(norms(matrix))
        matrix = matrix / rows[:, None]
        sizes = self._felt(norms(matrix, 0))
        matrix = matrix / sizes
        matrix = np.where(np.abs(matrix) > TOLERANCES.family_singular_value, matrix, 0.0)
        return matrix, rows, sizes, np.array(changes).T / sizes

    @staticmethod
    def _felt(sizes: Array) -> Array:
        """Return sizes of rows or columns, the largest for those in which differences leave rounding alone."""
        most = float(np.max(sizes, initial=0.0)) or 1.0
        return np.where(sizes > TOLERANCES.family_slope * most, sizes, most)

    def reached(self, y: Array) -> bool:
        """Return whether there are members along a disturbance y of S, at a finite distance and nearer."""
        matrix, rows, sizes, change = self._slopes
        direction, rate = self.structure.disturbance(y)
        sizes_of_both = np.tile(self.motion.sizes, 2)
        asked = np.concatenate([direction, rate / self.rate]) / sizes_of_both
        # What is solved for leaves the distance along the disturbance.
        along = unit((asked / np.max(np.abs(asked)) @ change)[:, None]).T
        inverse = np.linalg.pinv(np.vstack([matrix, along]), rcond=TOLERANCES.family_singular_value)[:, :-1]
        reached = False
        for part in TOLERANCES.family_parts:
            reach = TOLERANCES.family_reach * part / float(np.max(np.abs(asked)))
            q, u = self.motion.q + reach * direction, self.motion.u + reach * rate
            start = np.concatenate([q, self._rates(q, u), self.motion.nu])
            try:
                found = self._solved(start, inverse, rows, sizes)
            except _NoMember:
                return False
            moved = np.zeros(len(asked))
            if found is not None:
                moved = np.concatenate([found[0] - self.motion.q, (found[1] - self.motion.u) / self.rate])
            # What comes back to the reference is none; and what begins far from it, beyond a narrow hump, no family.
            near = float((moved / sizes_of_both) @ asked) > 0.5 * reach * float(asked @ asked)
            if reached and not near:
                return False
            reached = near
        return reached

    def _solved(self, start: Any, inverse: Any, rows: Array, sizes: Array) -> tuple[Array, Array] | None:
        """Return q and u of a member, by Newton's method with the slopes at the reference; None: it does not converge.

        Raises
        ------
        _NoMember
            If steps end where forces are left, however small: no member is there, nor nearer to the reference.
        """
        x, least, best = BALLS.of(start), -float(TOLERANCES.bits_of_member), np.inf
        left = self.residual(x) / BALLS.of(rows)
        for _ in range(TOLERANCES.newton_steps_family):
            before, power = left, float(np.max(BALLS.powers(left), initial=NONE))
            if not power < best + 4.0:
                return None
            best, size = min(best, power), as_ball(2.0) ** (int(power) if power > NONE else 0)
            step = -inverse @ middle(left / size) / sizes
            x = BALLS.settled(x + BALLS.of(step * self.units) * size)
            left = self.residual(x) / BALLS.of(rows)
            largest = float(np.max(np.abs(step), initial=0.0))
            if power < least or not largest or np.log2(largest) + power < least:
                # Rounding changes with the step, a force that no step reaches does not.
                if any(map(_stays, before, left)):
                    raise _NoMember
                return middle(x[self.parts[0]]), middle(self.speeds(x))
        return None


def _stays(before: Any, after: Any) -> bool:
    """Return whether a number is not zero, and was the same to many digits, as balls."""
    return bool(abs(after - before) < as_ball(2.0) ** -TOLERANCES.bits_that_stay * abs(after))
