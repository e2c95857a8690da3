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

from mbstab.analysis.algebra.arrays import Complex, Flags
from mbstab.analysis.linear.sparse_pencil import product
from mbstab.analysis.reference.attitude import Attitudes
from mbstab.analysis.reference.efforts import MOTION_UNITS, Placement, motion_name, moving_joints
from mbstab.analysis.reference.motion import Motion
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


@dataclass(frozen=True)
class _Rotor:
    """A body that spins about an axis that stands still: its number, the axis, and two directions across it."""

    body: int
    across: Array
    axis: Array
    frame: float


class Whirl:
    """The sense in which the axes and centres of spinning bodies go round, seen from the ground.

    Forward: in the sense of the spin. An ellipse consists of a circle forward and one backward, the larger of which
    gives the sense. In a turning frame both are seen with the rate of the frame added. Bodies whose centre is
    accelerated, or whose spin axis moves with the frame, have no such sense.
    """

    def __init__(self, system: System, motion: Motion, generator: Generator | None) -> None:
        self.system, self.motion, self.attitudes = system, motion, Attitudes.of(system)
        turning = np.zeros(3)
        if generator is not None and generator.turns:
            turning = float(generator.rate) * generator.axis
        self.rotors: list[_Rotor] = []
        if motion.at_rest:
            return
        spins = self.attitudes.spins(system, motion.q, motion.u)
        for i, (body, spin) in enumerate(zip(system.scene.bodies, spins, strict=True)):
            rate = float(np.linalg.norm(spin))
            place = slice(system.body_slices[i].start, system.body_slices[i].start + system.scene.dimension)
            slow = TOLERANCES.rotor_still * rate
            if not body.orientation or not rate:
                continue
            axis = spin / rate
            along = float(turning @ axis)
            still = np.linalg.norm(motion.a[place]) <= slow * rate * motion.sizes[place.start]
            if still and np.linalg.norm(turning - along * axis) <= slow:
                self.rotors.append(_Rotor(i, _across(axis), axis, along))

    def of(self, value: complex, shape: Complex | None) -> str:
        """Return ``forward``, ``backward``, ``mixed``, or nothing if no spinning body moves to and fro.

        Parameters
        ----------
        value : complex (1/s)
        shape : ndarray of complex, shape (n_q,), or None
        """
        if shape is None or not self.rotors:
            return ""
        found = [self._circles(rotor, value.imag, shape) for rotor in self.rotors]
        most = max((sum(x) for x in found), default=0.0)
        moved = float(np.max(np.abs(shape / self.motion.sizes), initial=0.0))
        if not most > (TOLERANCES.rotor_moves * moved) ** 2:
            return ""
        # The sense of a body that hardly moves says nothing.
        senses = [(f - b) / (f + b) for f, b in found if f + b > TOLERANCES.rotor_moves**2 * most]
        if all(x > TOLERANCES.whirl_round for x in senses):
            return "forward"
        return "backward" if all(x < -TOLERANCES.whirl_round for x in senses) else "mixed"

    def _circles(self, rotor: _Rotor, frequency: float, shape: Complex) -> tuple[float, float]:
        """Return the sums of squares of the circles forward and backward, of the centre and of the axis of a body."""
        d, start = self.system.scene.dimension, self.system.body_slices[rotor.body].start
        centre = np.zeros(3, dtype=complex)
        centre[:d] = shape[start : start + d] / self.motion.sizes[start]
        turns = [self.attitudes.spins(self.system, self.motion.q, x)[rotor.body] for x in (shape.real, shape.imag)]
        tilt = np.cross(turns[0] + 1j * turns[1], rotor.axis)
        forward = backward = 0.0
        for vector in (centre, tilt):
            one, other = rotor.across @ vector
            for size, rate in (
                (one + 1j * other, rotor.frame + frequency),
                (one - 1j * other, rotor.frame - frequency),
            ):
                square = 0.25 * abs(size) ** 2
                if abs(rate) > TOLERANCES.rotor_still * (abs(rotor.frame) + abs(frequency)):
                    forward, backward = forward + square * (rate > 0.0), backward + square * (rate < 0.0)
        return forward, backward


def _across(axis: Array) -> Array:
    """Return two directions that form a right-handed system with an axis, shape (2, 3)."""
    first = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    first /= math.hypot(*first)
    return np.array([first, np.cross(axis, first)])
