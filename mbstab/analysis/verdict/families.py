"""Families of steady motions that no structure explains: followed a finite distance in all directions.

A motion is of the kind of the reference if its speeds and accelerations are those of a symmetry:
(u, a) = Σ c_k (Y_k, DY_k u). Where A, apart from symmetries, has a null space that symmetries,
conserved functions and reversors do not explain, such motions are searched at a finite distance along
each null direction and along combinations of them, by the Gauss-Newton method. If they exist, to
rounding, the null space belongs to a family "as far as checked": this is no proof, and the answer says so.

Where constants of the motion that are linear in places and speeds tell the motions apart
(`mbstab.analysis.verdict.constants`), no search is needed: each value of them belongs to exactly one motion.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbstab.analysis.algebra.arrays import RandomNumbers, least_squares, norms
from mbstab.analysis.algebra.stacks import beside, complement, unit
from mbstab.analysis.algebra.tolerances import TOLERANCES as ALGEBRA
from mbstab.analysis.reference.element_comparison import State
from mbstab.analysis.verdict.constants import LinearFunctions, linear_functions
from mbstab.analysis.verdict.directions import span
from mbstab.analysis.verdict.neutral import Separated, Structure
from mbstab.analysis.verdict.spectrum import Neutral
from mbstab.analysis.verdict.tolerances import TOLERANCES
from mbstab.compiler.system import Array
from mbstab.errors import MbstabError, counted


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
        search = _Search(structure, symmetries, null)
        if not all(search.reaches(direction) for direction in _directions(size)):
            return None
    except (MbstabError, ArithmeticError, ValueError, np.linalg.LinAlgError):
        return None
    T = span(symmetries, null)
    wider = replace(found, T=T, L=np.zeros((0, n)), B=complement(T))
    checked = f"motions of the same kind were found {TOLERANCES.family_reach:g} of the size of the scene to all sides"
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
    counts = norms(parts) > TOLERANCES.direction_closure * float(np.linalg.norm(structure.at.S, 2))
    names = [f"speed of {x.name}" for x, goes in zip(items, counts.tolist(), strict=True) if goes]
    return names if len(names) == moved.shape[1] else []


def _directions(size: int) -> list[Array]:
    """Return the directions of a null space that are followed, each in both senses."""
    rng = RandomNumbers(3)
    some = [*np.eye(size), *rng.uniform(-1.0, 1.0, 2 * size, size)]
    return [sign * x / np.linalg.norm(x) for x in some for sign in (1.0, -1.0)]


class _Search:
    """Search for motions of the kind of the reference."""

    def __init__(self, structure: Structure, symmetries: Array, null: Array) -> None:
        self.structure, self.symmetries, self.null = structure, symmetries, null
        self.linear, self.space = structure.linear, structure.space
        self.motion, self.system = self.linear.motion, self.linear.system
        self.rate = structure.invariance.rate
        self.held = np.hstack([symmetries, null])
        self.sizes = self.motion.sizes
        self.free = complement(self.held)
        # A drive breaks the shift along it; what is driven goes on so.
        invariance, driven = structure.invariance, self.system.scene.timed
        own = [g for g in self.motion.generators if driven and g.moves and not invariance.broken(g)]
        self.driven = [invariance.along(g) for g in own[:1]]

    def reaches(self, direction: Array) -> bool:
        """Return whether there is a motion of the kind at a finite distance along a null direction."""
        return all(self._reaches(direction, TOLERANCES.family_reach * part) for part in TOLERANCES.family_parts)

    def _reaches(self, direction: Array, reach: float) -> bool:
        y = self.null @ direction
        y = y * (reach / self._extent(y))
        for _ in range(TOLERANCES.newton_steps_family):
            left = self._left(y)
            if self._vanishes(y, left):
                return True
            if not self.free.shape[1]:
                return False
            h = TOLERANCES.acceleration_difference
            slopes = np.array([(self._left(y + h * x) - self._left(y - h * x)) / (2.0 * h) for x in self.free.T]).T
            columns = np.maximum(norms(slopes, 0), 1e-300)  # a first-order state may be in any unit
            y = y - self.free @ (least_squares(slopes / columns, left, rcond=1e-10) / columns)
        return False

    def _vanishes(self, y: Array, left: Array) -> bool:
        """Return whether a residual is rounding, relative to the force of each single element along it."""
        sizes, n = self.sizes, len(self.motion.q)
        state = self._state(y)
        fastest = max(float(np.max(np.abs(state.u) / sizes)), float(np.max(np.abs(self.motion.u) / sizes)))
        allowed = TOLERANCES.force_vanishes * fastest + TOLERANCES.force_rounding * self._rates_of_states(y)
        if float(np.linalg.norm(left[:n])) * self.rate > allowed:
            return False
        direction = left[n:] * sizes
        at = self.system.dynamics(state.q, state.u, self.motion.time)
        M = at.M
        push = float(direction @ M @ direction) * self.rate**2
        still = np.zeros(n)
        each = each_size = 0.0
        for element in self.structure.invariance.elements:
            columns = list(element.columns)
            force = np.array(element.force(state.q, state.u, still, self.motion.time), dtype=float)
            # Constant loads must not hide a weak force.
            before = np.array(element.force(self.motion.q, self.motion.u, still, self.motion.time), dtype=float)
            each += abs(float((force - before) @ direction[columns]))
            each_size += float(np.abs(force) @ np.abs(direction[columns]))
        a, nu = self.structure.balanced(state.q, state.u)
        each_size += float((np.abs(M @ a) + np.abs(nu) @ np.abs(at.J)) @ np.abs(direction))
        # Where no force acts at all, the residual is the effect of rounding in the change; a residual that is
        # zero to the last bit is zero by structure.
        K, R, _ = self.system.linearize(state.q, state.u, a, nu, self.motion.time)
        q, u = np.transpose([self.structure.disturbance(x) for x in np.eye(len(y))[y != 0.0]], (1, 2, 0))
        each_size += float(np.linalg.norm(y)) * float(np.sum(np.abs(direction @ (K @ q + R @ u))))
        return push <= TOLERANCES.force_vanishes * each + TOLERANCES.force_rounding * each_size

    def _extent(self, y: Array) -> float:
        direction, rate = self.structure.disturbance(y)
        sizes = self.sizes
        return max(float(np.max(np.abs(direction / sizes))), float(np.max(np.abs(rate / sizes))) / self.rate)

    def _rates_of_states(self, y: Array) -> float:
        """Return the size of the terms of which the rates of first-order coordinates are sums, at rest as well."""
        spaces, n = self.linear.spaces, self.space.n_xi
        terms = np.abs(spaces.N) @ (np.abs(self.space.A[:n, :n]) @ np.abs(y[:n]))
        return float(np.linalg.norm(spaces.scale * terms / self.sizes))

    def _state(self, y: Array) -> State:
        """Return the state nearest to a disturbance that satisfies the constraints."""
        direction, rate = self.structure.disturbance(y)
        state = self.structure.invariance.onto_rows(self.motion.q + direction, self.motion.u + rate)
        if state is None:
            raise ValueError("no state that satisfies the constraints")
        return state

    def _left(self, y: Array) -> Array:
        """Return the residual of speeds and accelerations modulo symmetries, relative to the characteristic sizes."""
        state = self._state(y)
        q, u = state.q, state.u
        a, _ = self.structure.balanced(q, u)
        # The accelerations of first-order states follow from what else is compared.
        a[self.system.states[0]] = 0.0
        sizes, rate_ = self.sizes, self.rate
        moves = np.concatenate([u / sizes / rate_, a / sizes / rate_**2])
        fields = [field for _, field in self.structure.invariance.fields] + self.driven
        columns = [np.concatenate([x.field(q) / sizes, x.slope(q) @ u / sizes / rate_]) for x in fields]
        basis = span(np.array(columns).reshape(len(columns), len(moves)).T)
        result: Array = moves - basis @ (basis.T @ moves)
        return result
