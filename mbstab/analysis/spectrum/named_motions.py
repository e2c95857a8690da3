"""What moves in a mode, in few words, and the sense in which spinning bodies whirl.

Motions of joints and coordinates of bodies are chosen so that they are independent and together determine every small
motion that the holonomic rows allow: first the motions of joints, each time the one that the others determine least,
then coordinates, those of heavier bodies
first, and angles before lengths. Lengths count relative to the size of the scene, angles in rad.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cached_property

import numpy as np

from mbstab.analysis.algebra.arrays import Complex, Flags, Index
from mbstab.analysis.algebra.sparse import dense, product
from mbstab.analysis.reference.attitude import Attitudes
from mbstab.analysis.reference.efforts import MOTION_UNITS, Placement, motion_name, moving_joints
from mbstab.analysis.reference.motion import Motion
from mbstab.analysis.reference.rotation import cross_matrix
from mbstab.analysis.reference.steady import Generator
from mbstab.analysis.spectrum.tolerances import TOLERANCES
from mbstab.compiler.system import Array, System
from mbstab.mechanics.measures import is_measure
from mbstab.model.schema import is_length, is_state
from mbstab.records import dataclass

Told = tuple[tuple[str, complex], ...]
"""Motions by name with their relative amplitudes, the largest first, which is 1."""


@dataclass(frozen=True)
class NamedMotions:
    """Small motions by name, such as ``rod.theta`` and ``angle(pivot)``.

    Attributes
    ----------
    names, units : tuple of str
        Motions of joints, then coordinates; their SI units.
    rows : ndarray, shape (m, n_q)
        Their derivatives by the coordinates.
    sizes : ndarray, shape (m,)
        Characteristic sizes (in the same units).
    joints : int
        Number of motions of joints.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    rows: Array
    sizes: Array
    joints: int

    @classmethod
    def of(cls, system: System, q: Array, scales: Array) -> NamedMotions:
        """Return all motions that have a name at given coordinates; `scales` are sizes of the coordinates."""
        n = system.n_q
        every = np.broadcast_to(q, (n, n))
        place = Placement(Attitudes.of(system), system, every, np.eye(n))
        joints = moving_joints(system.scene)
        found = [np.broadcast_to(place.rate(kind, item), (n,)) for kind, item in joints]
        lengths = [float(size) for name, size in zip(system.names, scales, strict=True) if is_length(name)]
        units = (*(MOTION_UNITS[kind] for kind, _ in joints), *system.units)
        length = max(lengths, default=1.0)
        return cls(
            (*(motion_name(kind, item.name) for kind, item in joints), *system.names),
            units,
            np.vstack([*found, np.eye(n)]),
            np.array([*(length if MOTION_UNITS[kind] == "m" else 1.0 for kind, _ in joints), *scales]),
            len(joints),
        )


@dataclass(frozen=True)
class Telling:
    """The motions by which the modes of a scene are told.

    Attributes
    ----------
    names : tuple of str
    rows : ndarray, shape (k, n_q)
        Their derivatives by the coordinates, relative to their sizes.
    """

    names: tuple[str, ...]
    rows: Array

    @classmethod
    def of(cls, system: System, q: Array, scales: Array, allowed: Callable[[], Array]) -> Telling:
        """Choose independent motions that determine all others; none in scenes of very many coordinates.

        Parameters
        ----------
        system : System
        q, scales : ndarray, shape (n_q,)
            Coordinates of the reference, and their sizes.
        allowed : callable
            Returns a basis of the small motions Δq that the holonomic rows allow, as columns.
        """
        if system.n_q > TOLERANCES.told_coordinates:
            return cls((), np.zeros((0, system.n_q)))
        named = NamedMotions.of(system, q, scales)
        relative = named.rows / named.sizes[:, None]
        basis = np.linalg.qr(allowed() / scales[:, None])[0] * scales[:, None]
        # Below the motions of joints, rows are those of single coordinates.
        rows = np.vstack([relative[: named.joints] @ basis, basis / named.sizes[named.joints :, None]])
        # What the holonomic rows hold moves by rounding only.
        rows[np.linalg.norm(rows, axis=1) <= TOLERANCES.told_held * np.linalg.norm(relative * scales, axis=1)] = 0.0
        chosen = _independent(rows, [range(named.joints), *_by_mass(system, named)])
        return cls(tuple(named.names[i] for i in chosen), relative[chosen])

    @cached_property
    def _states(self) -> Flags:
        """Which motions are first-order states."""
        return np.array([is_state(name) and not is_measure(name) for name in self.names])

    def told(self, shapes: Sequence[Complex | None]) -> list[Told]:
        """Return for each mode, shape (n_q,), its motions that are not small, the largest first."""
        found: list[Told] = [()] * len(shapes)
        known = [(k, shape) for k, shape in enumerate(shapes) if shape is not None]
        if not known or not len(self.names):
            return found
        moved = product(self.rows, np.array([shape for _, shape in known]).T).T
        sizes = np.abs(moved)
        bodily = np.any(sizes[:, ~self._states] > 0.0, axis=1)
        sizes[np.ix_(bodily, self._states)] = 0.0  # in units of their own
        most = np.max(sizes, axis=1)
        # The first of those that move equally, so that rounding does not decide.
        first = np.argmax(sizes >= (1.0 - 1e-9) * most[:, None], axis=1).tolist()
        orders = np.argsort(-sizes, axis=1, kind="stable")[:, : TOLERANCES.told_motions + 1]
        large = np.take_along_axis(sizes, orders, axis=1) >= TOLERANCES.told_part * most[:, None]
        for (k, _), row, i, order, told, size in zip(known, moved, first, orders, large, most, strict=True):
            if size > 0.0:
                chosen = [i, *(j for j in order[told].tolist() if j != i)][: TOLERANCES.told_motions]
                parts = (row[chosen] / row[i]).tolist()
                found[k] = tuple((self.names[j], x + 0.0) for j, x in zip(chosen, parts, strict=True))
        return found


def mirrored(told: Told) -> Told:
    """Return the motions of the conjugate mode."""
    return tuple((name, x.conjugate() + 0.0) for name, x in told)


def _by_mass(system: System, named: NamedMotions) -> Iterator[list[int]]:
    """Yield the numbers of the coordinates of each body, heavy ones first, angles before lengths; then states."""
    bodies = zip(system.scene.bodies, system.body_slices, strict=True)
    for _, part in sorted(bodies, key=lambda x: -float(x[0].mass)):
        own = range(named.joints + part.start, named.joints + part.stop)
        for unit in ("rad", "m"):
            yield [i for i in own if named.units[i] == unit]
    yield [i for i, name in enumerate(named.names) if i >= named.joints and is_state(name)]


def _independent(rows: Array, groups: Iterable[Sequence[int]]) -> list[int]:
    """Return independent rows that span all, group by group, each time the most independent one."""
    chosen, width = list[int](), rows.shape[1]
    spanned = np.zeros((width, width))  # an orthonormal basis, filled row by row
    own = np.linalg.norm(rows, axis=1)
    for number, group in enumerate(groups):
        if len(chosen) == width:
            break
        least = TOLERANCES.told_independent if number else TOLERANCES.told_joint_independent
        part = np.array(group, dtype=np.intp)
        left = rows[part]
        for _ in range(2):  # the second time for what rounding left
            basis = spanned[: len(chosen)]
            left = left - (left @ basis.T) @ basis
        while len(chosen) < width:
            size = np.sqrt(np.einsum("ij,ij->i", left, left))
            size[size <= least * own[part]] = 0.0
            most = float(np.max(size, initial=0.0))
            if not most > 0.0:
                break
            k = int(np.argmax(size >= (1.0 - 1e-9) * most))
            direction = spanned[len(chosen)] = left[k] / size[k]
            chosen.append(int(part[k]))
            left -= (left @ direction)[:, None] * direction
    return chosen


# --- whirl ----------------------------------------------------------------------------------------------------------


class Whirl:
    """The sense in which the axes and centres of spinning bodies go round, seen from the ground.

    Forward: in the sense of the spin. An ellipse consists of a circle forward and one backward, the larger of which
    gives the sense of a body; those of several bodies count by their kinetic energies. In a turning frame both are seen
    with the rate of the frame added. Bodies whose centre is accelerated, or whose spin axis moves with the frame, have
    no such sense.
    """

    def __init__(self, system: System, motion: Motion, generator: Generator | None) -> None:
        self.sizes, d, attitudes = motion.sizes, system.scene.dimension, Attitudes.of(system)
        turning = np.zeros(3)
        if generator is not None and generator.turns:
            turning = float(generator.rate) * generator.axis
        own, across, frames, masses = list[Index](), list[Array](), list[float](), list[Array]()
        for i, body in enumerate(() if motion.at_rest else system.scene.bodies):
            if not body.orientation:
                continue
            angles, G = attitudes.turning(system, motion.q, i)
            spin, centre = G @ motion.u[angles], np.arange(angles.start - d, angles.start)
            rate = float(np.linalg.norm(spin))
            if not rate:
                continue
            axis, size, slow = spin / rate, motion.sizes[centre[0]], TOLERANCES.rotor_still * rate
            along = float(turning @ axis)
            still = np.linalg.norm(motion.a[centre]) <= slow * rate * size
            if still and np.linalg.norm(turning - along * axis) <= slow:
                directions, rows = _across(axis), np.zeros((4, angles.stop - int(centre[0])))
                rows[:2, :d], rows[2:, d:] = directions[:, :d] / size, -directions @ cross_matrix(axis) @ G
                own.append(np.arange(centre[0], angles.stop))
                masses.append(dense(motion.dynamics.M[own[-1]][:, own[-1]]))
                across.append(rows)
                frames.append(along)
        self.own, self.across, self.frames = np.array(own, dtype=np.intp), np.array(across), np.array(frames)
        self.masses = np.array(masses)

    def of(self, value: complex, shape: Complex | None) -> str:
        """Return ``forward``, ``backward``, ``mixed``, or nothing if no spinning body moves to and fro.

        Parameters
        ----------
        value : complex (1/s)
        shape : ndarray of complex, shape (n_q,), or None
        """
        if shape is None or not len(self.own):
            return ""
        forward, backward = self._circles(value.imag, shape)
        both = forward + backward
        most, moved = float(np.max(both)), float(np.max(np.abs(shape / self.sizes)))
        if not most > (TOLERANCES.rotor_moves * moved) ** 2:
            return ""
        x = shape[self.own]
        energies = np.einsum("bi,bij,bj->b", x.conj(), self.masses, x).real
        sense = float(np.sum(energies * (forward - backward) / np.maximum(both, 1e-300)) / np.sum(energies))
        return "mixed" if abs(sense) <= TOLERANCES.whirl_round else "forward" if sense > 0.0 else "backward"

    def _circles(self, frequency: float, shape: Complex) -> tuple[Array, Array]:
        """Return for each rotor the squares of the circles forward and backward, of its centre and its axis together.

        The columns of `across` belong to the coordinates of the rotor, its rows to the two directions across the axis:
        first the place of the centre, relative to its size, then the tip of the axis, which moves by ω × axis.
        """
        parts = (self.across @ shape[self.own][:, :, None])[:, :, 0]
        one, other = parts[:, 0::2], parts[:, 1::2]
        forward, backward = np.zeros((2, len(parts)))
        for circle, rate in ((one + 1j * other, self.frames + frequency), (one - 1j * other, self.frames - frequency)):
            square = 0.25 * np.sum(np.abs(circle) ** 2, axis=1)
            square[np.abs(rate) <= TOLERANCES.rotor_still * (np.abs(self.frames) + abs(frequency))] = 0.0
            forward += np.where(rate > 0.0, square, 0.0)
            backward += np.where(rate < 0.0, square, 0.0)
        return forward, backward


def _across(axis: Array) -> Array:
    """Return two directions that form a right-handed system with an axis, shape (2, 3)."""
    first = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    first /= math.hypot(*first)
    return np.array([first, np.cross(axis, first)])
