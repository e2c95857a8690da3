"""Reversors of steady motions: reflections that, combined with time reversal, map the motion to itself.

A wheel that rolls straight ahead, seen in a mirror perpendicular to its line of travel and with time
reversed, rolls as before, and so does every motion near it: ρ(q, u) = (σ(q), −Dσ u) maps all
motions to motions with time reversed. The spectrum is then symmetric about the imaginary axis. In
the space Q of motions modulo symmetries, ρ keeps m₊ directions and reverses m₋; where the
m₋ equations of steady motions among the kept ones have full rank, there is a family of steady
motions of dimension m₊ − m₋ (circles beside straight rolling). With m₋ = 1 and one pair of
eigenvalues, motions nearby are periodic (Devaney 1976, Trans. AMS 218; Sevryuk 1986).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from mbstab.analysis.algebra.stacks import beside, complement
from mbstab.analysis.reference.element_comparison import State
from mbstab.analysis.reference.rotation import (
    euler_angles,
    lever,
    lever_acceleration,
    orientation,
    rate_drift,
    rate_matrix,
)
from mbstab.analysis.reference.symmetries import Invariance
from mbstab.analysis.verdict.directions import Ranks, span, vanishing, with_mirrored
from mbstab.analysis.verdict.neutral import Separated, Structure, settled
from mbstab.analysis.verdict.tolerances import TOLERANCES
from mbstab.compiler.system import Array, System
from mbstab.model.schema import is_state
from mbstab.records import dataclass


@dataclass(frozen=True)
class Mirror:
    """The reflection of a scene in a plane, each body with a body-fixed plane through its centre of mass."""

    system: System
    normal: Array
    point: Array
    reference: Array

    def _reflection(self) -> Array:
        return np.eye(3) - 2.0 * np.outer(self.normal, self.normal)

    def moved(self, q: Array) -> tuple[Array, Array]:
        """Return σ(q) and Dσ(q)."""
        d, image = self.system.scene.dimension, self._reflection()
        result, T = q.copy(), np.eye(len(q))
        for body, part in zip(self.system.scene.bodies, self.system.body_slices, strict=True):
            place, angles = slice(part.start, part.start + d), slice(part.start + d, part.stop)
            T[place, place] = image[:d, :d]
            before, after = np.zeros(3), np.zeros(3)
            if body.orientation:
                if d == 2:
                    result[angles] = 2.0 * self.reference[angles] - q[angles]
                    T[angles, angles] = -1.0
                else:
                    first = orientation(body, self.reference[angles])
                    own = first.T @ image @ first
                    result[angles] = euler_angles(body, image @ orientation(body, q[angles]) @ own, q[angles])
                    T[angles, angles] = np.linalg.solve(
                        rate_matrix(body, result[angles]), -image @ rate_matrix(body, q[angles])
                    )
                # The plane of a body passes through its centre of mass, not through its reference point.
                (before, turn), (after, turned) = (lever(body, x[angles]) for x in (q, result))
                T[place, angles] = image[:d, :d] @ turn[:d] - turned[:d] @ T[angles, angles]
            result[place] = (self.point + image @ (_place(q[place]) + before - self.point) - after)[:d]
        return result, T

    def accelerations(self, state: State, moved: Array, T: Array) -> Array:
        """Return the accelerations of the image of a motion."""
        d, image = self.system.scene.dimension, self._reflection()
        result: Array = T @ state.a
        u = T @ state.u
        for body, part in zip(self.system.scene.bodies, self.system.body_slices, strict=True):
            place, angles = slice(part.start, part.start + d), slice(part.start + d, part.stop)
            if body.orientation and d == 3:
                # Euler angles change nonlinearly: it is the angular acceleration, G a + Ġ u, that is reflected.
                q, rates, G = state.q[angles], state.u[angles], rate_matrix(body, moved[angles])
                before = rate_matrix(body, q) @ state.a[angles] + rate_drift(body, q, rates)
                result[angles] = np.linalg.solve(G, -image @ before - rate_drift(body, moved[angles], u[angles]))
            if body.orientation and any(body.center):
                before = lever_acceleration(body, *(x[angles] for x in (state.q, state.u, state.a)))
                after = lever_acceleration(body, *(x[angles] for x in (moved, u, result)))
                result[place] = image[:d, :d] @ (state.a[place] + before[:d]) - after[:d]
        return result


def _place(x: Array) -> Array:
    """Return a planar or spatial point as a spatial one."""
    return np.concatenate([x, np.zeros(3 - len(x))])


@dataclass(frozen=True)
class Reversor:
    """A verified reversor.

    Attributes
    ----------
    kept, reversed_ : int
        m₊ and m₋, the multiplicities of 1 and −1 on Q.
    """

    kept: int
    reversed_: int

    def widened(self, structure: Structure, found: Separated) -> Separated:
        """Return the matrix with the family of steady motions of the reversor added to its directions."""
        size, ranks = self.kept - self.reversed_, Ranks()
        wide = with_mirrored(structure.at, structure.invariance.symmetries, size, ranks) if size > 0 else None
        if wide is None:
            return found
        T, family = wide
        # Functions that distinguish members of the family are no longer needed.
        L = vanishing(found.L, T, ranks, "functions beside a family")
        names = _names(structure, family, found.neutral.family)
        T, B, fitted = settled(found.S, T, L, complement(beside(T, L.T)))
        choice = replace(found.choice, ranks={**found.choice.ranks, **ranks.known}, family=size)
        wider = replace(found, T=T, L=L, B=B, choice=choice, fitted=fitted)
        neutral = replace(
            found.neutral, family=names, count=T.shape[1] + len(L), chains=structure.chains(wider), evidence="numerical"
        )
        return replace(wider, neutral=neutral)

    @property
    def simple(self) -> bool:
        """Whether −1 is a simple eigenvalue on Q."""
        return self.reversed_ == 1


def _names(structure: Structure, directions: Array, known: tuple[str, ...]) -> tuple[str, ...]:
    """Return names that distinguish the members of a family: known functions, then the rates that change most.

    Where no rate changes it is the places that do: other values of a first-order state beside a rest.
    """
    motion, at = structure.linear.motion, structure.at
    names = list(known)[: directions.shape[1]]
    taken = structure.column(np.zeros_like(motion.u), motion.u)[:, None] if names else directions[:, :0]
    while len(names) < directions.shape[1]:
        basis = span(taken)
        rest = directions - basis @ (basis.T @ directions)
        left, _, _ = np.linalg.svd(rest, full_matrices=False)
        y = left[:, 0]
        taken = beside(taken, left[:, :1])
        place, rate = np.abs(at.N @ y[: at.n_xi]), np.abs(at.N @ (at.rates @ y))
        moves = np.max(rate) > TOLERANCES.direction_closure * at.gamma * np.max(place)
        what, size = ("rate", rate) if moves else ("position", place)
        largest = (structure.linear.names[i] for i in np.argsort(-size))
        named = (f"state {x}" if is_state(x) and not moves else f"{what} of {x}" for x in largest)
        names.append(next(name for name in named if name not in names))
    return tuple(names)


def reversor(structure: Structure) -> Reversor | None:
    """Return a reversor of the motion, or None if none of the reflections that are tried is one."""
    invariance = structure.invariance
    for mirror in _mirrors(invariance):
        if _fixes(invariance, mirror) and _reverses(invariance, mirror):
            symmetries = structure.symmetric
            trace = _trace(structure, mirror, symmetries)
            size = len(symmetries) - symmetries.shape[1]
            difference = round(trace)
            if abs(trace - difference) < 1e-3 and (size - difference) % 2 == 0:
                return Reversor((size + difference) // 2, (size - difference) // 2)
    return None


def _mirrors(invariance: Invariance) -> Iterator[Mirror]:
    """Yield the planes worth trying, through the middle of the bodies.

    Their normals are the velocity, the axes, and in space what is level and across a body's angular velocity: the image
    of a motion with time reversed keeps velocities along the normal and angular velocities across it.
    """
    system, motion = invariance.system, invariance.motion
    d = system.scene.dimension
    places, speeds, across = [], [], [*np.eye(3)]
    for body, part in zip(system.scene.bodies, system.body_slices, strict=True):
        arm, turn = lever(body, motion.q[part.start + d : part.stop])
        places.append(_place(motion.q[part.start : part.start + d]) + arm)
        speeds.append(_place(motion.u[part.start : part.start + d]) + turn @ motion.u[part.start + d : part.stop])
        if d == 3 and body.orientation:
            angles = slice(part.start + d, part.stop)
            across.append(rate_matrix(body, motion.q[angles]) @ motion.u[angles])
    point, velocity = np.mean(places, axis=0), np.mean(speeds, axis=0)
    level = [np.cross(system.scene.gravity, x) for x in reversed(across)] if d == 3 else []
    normals = list[Array]()
    for x in (velocity, *np.eye(3)[:d], *level):
        normal = x / (np.linalg.norm(x) or 1.0)
        if np.any(normal) and all(abs(abs(normal @ n) - 1.0) > 1e-9 for n in normals):
            normals.append(normal)
            yield Mirror(system, normal, point, motion.q)


def _image(mirror: Mirror, state: State) -> tuple[State, Array]:
    """Return the mirror image of a state with time reversed."""
    q, T = mirror.moved(state.q)
    return State(q, -T @ state.u, mirror.accelerations(state, q, T)), T


def _fixes(invariance: Invariance, mirror: Mirror) -> bool:
    """Return whether the reference is its own image."""
    motion = invariance.motion
    q, T = mirror.moved(motion.q)
    off = np.abs(q - motion.q) / motion.sizes, np.abs(-T @ motion.u - motion.u) / motion.sizes
    fastest = float(np.max(np.abs(motion.u) / motion.sizes))
    return bool(
        np.max(off[0]) <= TOLERANCES.mirrored_reference and np.max(off[1]) <= TOLERANCES.mirrored_reference * fastest
    )


def _reverses(invariance: Invariance, mirror: Mirror) -> bool:
    """Return whether all elements and rows are unchanged by the reflection with time reversed."""
    if not invariance.states or not invariance.seen or not all(e.analytic for e in invariance.elements):
        return False
    try:
        for element in invariance.elements:
            for state in invariance.states:
                there, T = _image(mirror, state)
                if not invariance.same(element, state, there, T, exact=not np.any(mirror.point)):
                    return False
        for state in invariance.on_rows:
            there, _ = _image(mirror, state)
            if not invariance.satisfies(there.q, there.u):
                return False
    except (ArithmeticError, ValueError, np.linalg.LinAlgError):
        return False
    return True


def _trace(structure: Structure, mirror: Mirror, symmetries: Array) -> float:
    """Return the trace of the reversor on Q."""
    motion, Q = structure.linear.motion, complement(symmetries)
    total = 0.0
    for y in Q.T:
        direction, rate = structure.disturbance(y)
        _, T = mirror.moved(motion.q)
        size = float(np.max(np.abs(direction / motion.sizes))) or 1.0
        h = TOLERANCES.mirror_difference / size
        change = (mirror.moved(motion.q + h * direction)[1] - mirror.moved(motion.q - h * direction)[1]) / (2.0 * h)
        total += float(y @ structure.column(T @ direction, -T @ rate - change @ motion.u))
    return total
