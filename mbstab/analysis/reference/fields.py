"""One-parameter groups that act on the coordinates: shifts, turns, spins, and their combinations."""

from __future__ import annotations

import math
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from mbstab.analysis.algebra.sparse import nothing, unchanged, with_block
from mbstab.analysis.reference.rotation import euler_angles, orientation, rate_matrix, rotation_matrix
from mbstab.analysis.reference.steady import Generator
from mbstab.analysis.reference.tolerances import TOLERANCES
from mbstab.compiler.system import Array
from mbstab.records import dataclass


class Field(Protocol):
    """A one-parameter group that acts on the coordinates."""

    def field(self, q: Array) -> Array:
        """Return Y(q)."""
        ...

    def slope(self, q: Array) -> Any:
        """Return DY(q)."""
        ...

    def moved(self, q: Array) -> tuple[Array, Any]:
        """Return the image of q under a large step of the group, and its derivative by q."""
        ...


@dataclass(frozen=True)
class Shift:
    """The same change of the coordinates everywhere."""

    direction: Array
    step: float

    @cached_property
    def changed(self) -> frozenset[int]:
        """Numbers of the coordinates that it changes."""
        return frozenset(np.flatnonzero(self.direction).tolist())

    def field(self, q: Array) -> Array:  # noqa: D102
        return self.direction

    def slope(self, q: Array) -> Any:  # noqa: D102
        return nothing(len(q))

    def moved(self, q: Array) -> tuple[Array, Any]:  # noqa: D102
        return q + self.step * self.direction, unchanged(len(q))


@dataclass(frozen=True)
class Turn:
    """A rotation of the ground, a screw, or a steady motion: the group of a `Generator`."""

    generator: Generator
    time: float

    def field(self, q: Array) -> Array:  # noqa: D102
        return self.generator.field(q)

    def slope(self, q: Array) -> Any:  # noqa: D102
        return self.generator.slope(q)

    def moved(self, q: Array) -> tuple[Array, Any]:  # noqa: D102
        return self.generator.flow(q, self.time)


@dataclass(frozen=True)
class OwnTurn:
    """A rotation of a planar body about its centre of mass, where that is not its reference point."""

    part: slice
    center: Array

    def _lever(self, angle: float) -> Array:
        c, s = math.cos(angle), math.sin(angle)
        return np.array([[c, -s], [s, c]]) @ self.center

    def field(self, q: Array) -> Array:  # noqa: D102
        result, lever = np.zeros(len(q)), self._lever(q[self.part.stop - 1])
        result[self.part] = lever[1], -lever[0], 1.0
        return result

    def slope(self, q: Array) -> Any:  # noqa: D102
        angle = self.part.stop - 1
        block = np.zeros((angle + 1 - self.part.start,) * 2)
        block[:-1, -1] = self._lever(q[angle])
        return with_block(nothing(len(q)), self.part, block)

    def moved(self, q: Array) -> tuple[Array, Any]:  # noqa: D102
        angle, places = self.part.stop - 1, slice(self.part.start, self.part.stop - 1)
        before, after = self._lever(q[angle]), self._lever(q[angle] + TOLERANCES.trial_move)
        new, block = q.copy(), np.eye(angle + 1 - self.part.start)
        new[places] += before - after
        new[angle] += TOLERANCES.trial_move
        block[:-1, -1] = np.array([-before[1], before[0]]) - np.array([-after[1], after[0]])
        return new, with_block(unchanged(len(q)), self.part, block)


@dataclass(frozen=True)
class Spin:
    """A rotation of a body in space about a body-fixed axis through its reference point."""

    body: Any
    part: slice
    axis: Array

    def _rates(self, angles: Array) -> tuple[Array, Array]:
        """Return the Euler rates of a rotation at 1 rad/s, and their derivative by the angles."""
        (_, c2, c3), (_, s2, s3) = np.cos(angles), np.sin(angles)
        across = self.axis[0] * c3 - self.axis[1] * s3
        along = self.axis[0] * s3 + self.axis[1] * c3
        t2 = s2 / c2
        rates = np.array([across / c2, along, self.axis[2] - across * t2])
        slope = np.array(
            [
                [0.0, across * t2 / c2, -along / c2],
                [0.0, 0.0, across],
                [0.0, -across / c2**2, along * t2],
            ]
        )
        return rates, slope

    @property
    def angles(self) -> slice:
        """Where the angles are among the coordinates."""
        return slice(self.part.start + 3, self.part.stop)

    def field(self, q: Array) -> Array:  # noqa: D102
        result = np.zeros(len(q))
        result[self.angles] = self._rates(q[self.angles])[0]
        return result

    def slope(self, q: Array) -> Any:  # noqa: D102
        return with_block(nothing(len(q)), self.angles, self._rates(q[self.angles])[1])

    def moved(self, q: Array) -> tuple[Array, Any]:  # noqa: D102
        old = q[self.angles]
        new = euler_angles(
            self.body, orientation(self.body, old) @ rotation_matrix(self.axis, TOLERANCES.trial_move), old
        )
        result = q.copy()
        result[self.angles] = new
        turn: Array = np.asarray(np.linalg.solve(rate_matrix(self.body, new), rate_matrix(self.body, old)), dtype=float)
        return result, with_block(unchanged(len(q)), self.angles, turn)


@dataclass(frozen=True)
class Combination:
    """A combination of fields with constant coefficients, which need not be a group."""

    parts: tuple[tuple[float, Field], ...]

    def field(self, q: Array) -> Array:  # noqa: D102
        return np.asarray(sum(c * part.field(q) for c, part in self.parts))

    def slope(self, q: Array) -> Any:  # noqa: D102
        return sum(c * part.slope(q) for c, part in self.parts)

    def moved(self, q: Array) -> tuple[Array, Any]:
        """Return the image under the steps of all parts, one after the other."""
        T = unchanged(len(q))
        for _, part in self.parts:
            q, step = part.moved(q)
            T = step @ T
        return q, T


@dataclass(frozen=True, eq=False)
class Symmetry:
    """A one-parameter group that carries motions into motions.

    Attributes
    ----------
    name : str
        Such as ``wheel.psi``, ``translation along x``, ``rotation about z``.
    direction, rate : ndarray, shape (n_q,)
        Its changes of the coordinates and of the speeds of the reference, Y and DY u.
    of : Field
    """

    name: str
    direction: Array
    rate: Array
    of: Field
