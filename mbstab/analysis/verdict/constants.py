"""Functions that are linear in places and speeds: constants of the motion, and those that obey linear equations.

A ball that rolls on a turntable keeps the middle of its circle and its spin about the vertical, although reactions
turn it. With constant a, b and c in the axes of the ground, f = Σ a·r + b·v + c·ω over the bodies may be constant along
every motion. Where speeds are tied by rows, such functions are sought at states spread over the scene: f is
constant if ḟ = Σ a·v + b·v̇ + c·ω̇ vanishes at all of them, at more states than there are coefficients.
Where such functions tell all motions apart, up to symmetries, and their rates are linear in themselves, motions obey
linear equations: eigenvalues decide, also those on the imaginary axis.
"""

from __future__ import annotations

import numpy as np

from mbstab.analysis.algebra.arrays import RandomNumbers, norms
from mbstab.analysis.algebra.stacks import beside
from mbstab.analysis.algebra.tolerances import TOLERANCES as ALGEBRA
from mbstab.analysis.reference.rotation import rate_drift, rate_matrix
from mbstab.analysis.verdict.directions import span
from mbstab.analysis.verdict.neutral import Structure
from mbstab.analysis.verdict.tolerances import TOLERANCES
from mbstab.compiler.system import Array, System
from mbstab.records import dataclass


@dataclass(frozen=True)
class LinearFunctions:
    """Functions linear in places and speeds, by their differentials in the coordinates of S.

    Attributes
    ----------
    constants : ndarray, shape (k, n)
        Those that are constant along every motion; some may depend on each other.
    closed : ndarray, shape (m, n)
        Those that obey linear equations among themselves.
    """

    constants: Array
    closed: Array


def linear_functions(structure: Structure) -> LinearFunctions | None:
    """Return the functions of a scene that obey linear equations, None where they are not sought."""
    linear, invariance = structure.linear, structure.invariance
    system, motion, generator = linear.system, linear.motion, linear.generator
    turning = generator is not None and generator.turns
    if not system.n_n or turning or not _only_loads(structure):
        return None
    bodies = _Bodies(system, motion.sizes, invariance.rate)
    rng, values, changes = RandomNumbers(17), list[Array](), list[Array]()
    for _ in range(2 * bodies.count + TOLERANCES.further_states):
        state = invariance.projected(rng, TOLERANCES.family_reach)
        if state is None:
            return None
        values.append(bodies.values(state.q, state.u))
        changes.append(bodies.rates(state.q, state.u, structure.balanced(state.q, state.u)[0]))
    disturbed = [structure.disturbance(x) for x in np.eye(len(structure.space.A))]
    slopes = np.array([bodies.change(motion.q, motion.u, direction, rate) for direction, rate in disturbed])
    known, rates = np.array(values), np.array(changes)
    lengths = norms(beside(known, rates), keepdims=True)
    one, known, rates = 1.0 / lengths, known / lengths, rates / lengths
    constant = _vanishing(rates, float(np.linalg.norm(rates, 2)))
    return LinearFunctions(constant.T @ slopes.T, _closed(one, known, rates).T @ slopes.T)


def _only_loads(structure: Structure) -> bool:
    """Return whether nothing but inertia and constant forces acts: however weak, a spring must not be overlooked."""
    invariance = structure.invariance
    acting = [element for element in invariance.elements if not element.inertia]
    return all(element.analytic for element in invariance.elements) and not any(
        x
        for element in acting
        for state in invariance.states
        for part in element.slopes(state.q.tolist(), state.u.tolist(), state.a.tolist(), invariance.motion.time)
        for row in part
        for x in row
    )


def _vanishing(matrix: Array, size: float) -> Array:
    """Return orthonormal columns of coefficients with matrix c = 0, to `size`; none if the rank has no gap."""
    _, s, right = np.linalg.svd(matrix)
    limit = TOLERANCES.family_singular_value * size
    kept = int(np.sum(s > limit))
    if kept and s[kept - 1] < ALGEBRA.rank_gap * limit:
        kept = len(right)
    return right[kept:].T


def _closed(one: Array, known: Array, rates: Array) -> Array:
    """Return coefficients of the functions whose rates are linear in these functions, as orthonormal columns."""
    size = float(np.linalg.norm(rates, 2))
    C = np.eye(known.shape[1])
    while C.shape[1]:
        basis = span(one, known @ C)
        beyond = rates @ C
        kept = _vanishing(beyond - basis @ (basis.T @ beyond), size)
        if kept.shape[1] == C.shape[1]:
            break
        C = C @ kept
    return C


class _Bodies:
    """Places, speeds and angular velocities of the bodies of a scene, each in its unit."""

    def __init__(self, system: System, sizes: Array, rate: float) -> None:
        self.d, self.rate, self.sizes = system.scene.dimension, rate, sizes
        self.parts = list(zip(system.scene.bodies, system.body_slices, strict=True))
        self.count = sum(2 * self.d + (body.orientation and (3 if self.d == 3 else 1)) for body, _ in self.parts)

    def rates(self, q: Array, u: Array, a: Array) -> Array:
        """Return the rates of all functions at a state, shape (count,)."""
        found = []
        for body, part in self.parts:
            place, angles = slice(part.start, part.start + self.d), slice(part.start + self.d, part.stop)
            size = self.sizes[place]
            found += [u[place] / size / self.rate, a[place] / size / self.rate**2]
            if body.orientation:
                if self.d == 3:
                    turn = rate_matrix(body, q[angles]) @ a[angles] + rate_drift(body, q[angles], u[angles])
                else:
                    turn = a[angles]
                found.append(turn / self.rate**2)
        return np.concatenate(found)

    def values(self, q: Array, u: Array) -> Array:
        """Return all functions at a state, shape (count,)."""
        found = []
        for body, part in self.parts:
            place, angles = slice(part.start, part.start + self.d), slice(part.start + self.d, part.stop)
            size = self.sizes[place]
            found += [q[place] / size, u[place] / size / self.rate]
            if body.orientation:
                turn = rate_matrix(body, q[angles]) @ u[angles] if self.d == 3 else u[angles]
                found.append(turn / self.rate)
        return np.concatenate(found)

    def change(self, q: Array, u: Array, direction: Array, rate: Array) -> Array:
        """Return the changes of all functions by a disturbance, shape (count,)."""
        found = []
        for body, part in self.parts:
            place, angles = slice(part.start, part.start + self.d), slice(part.start + self.d, part.stop)
            size = self.sizes[place]
            found += [direction[place] / size, rate[place] / size / self.rate]
            if body.orientation:
                turn = rate[angles]
                if self.d == 3:
                    h = TOLERANCES.acceleration_difference / (float(np.max(np.abs(direction[angles]))) or 1.0)
                    ahead, behind = (rate_matrix(body, q[angles] + s * direction[angles]) for s in (h, -h))
                    turn = rate_matrix(body, q[angles]) @ rate[angles] + (ahead - behind) @ u[angles] / (2.0 * h)
                found.append(turn / self.rate)
        return np.concatenate(found)
