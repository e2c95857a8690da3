"""Kinematics of a body, in terms of which elements and measures are defined, in any number system.

Orientation in space is Euler X-Y-Z after a constant base rotation, A = B Ax(φ) Ay(θ) Az(ψ),
Eqs. (120)-(122) of Pappalardo, Lettieri, Guida (2020) with B = 1.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import cached_property
from typing import Any


def dot(a: Sequence[Any], b: Sequence[Any]) -> Any:
    """Return a·b."""
    first, *rest = (x * y for x, y in zip(a, b, strict=True))
    return sum(rest, first)


def cross(a: Sequence[Any], b: Sequence[Any]) -> tuple[Any, Any, Any]:
    """Return a×b of vectors with three components."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


class Column(tuple[Any, ...]):
    """A vector with the operations in which elements are defined."""

    __slots__ = ()

    def __add__(self, other: Iterable[Any]) -> Column:
        return Column(x + y for x, y in zip(self, other, strict=True))

    def __sub__(self, other: Iterable[Any]) -> Column:
        return Column(x - y for x, y in zip(self, other, strict=True))

    def __neg__(self) -> Column:
        return Column(-x for x in self)

    def __mul__(self, number: Any) -> Column:
        return Column(x * number for x in self)

    __rmul__ = __mul__  # of a number that multiplies arrays by itself, write it second

    def __truediv__(self, number: Any) -> Column:
        return Column(x / number for x in self)

    def dot(self, other: Sequence[Any]) -> Any:
        """Return the scalar product."""
        return dot(self, other)

    def cross(self, other: Sequence[Any]) -> Column:
        """Return the vector product of vectors with three components."""
        return Column(cross(self, other))


def combined(vectors: Sequence[Column], numbers: Sequence[Any]) -> Column:
    """Return the sum of vectors times numbers."""
    first, *rest = (vector * x for vector, x in zip(vectors, numbers, strict=True))
    total: Column = sum(rest, first)
    return total


class Frame:
    """Where a body is, how it is turned, and how it moves.

    Parameters
    ----------
    f : arithmetic
        Has ``sin``, ``cos``, ``sqrt``, ``atan2`` …
    dimension : int
        2 or 3; 0 for a bare coordinate.
    q : sequence of numbers
        Coordinates: of a point only those of its place; none for the ground.
    base : sequence of 9 numbers
        B, row by row (of a body in space).
    u : sequence of numbers
        Rates of the coordinates, where speeds are asked for.
    rate : callable
        Returns the time derivative of what was computed from coordinates of any frames.
    """

    def __init__(
        self,
        f: Any,
        dimension: int,
        q: Sequence[Any],
        base: Sequence[Any] = (),
        u: Sequence[Any] = (),
        rate: Callable[[Any], Any] | None = None,
    ) -> None:
        self.f, self.dimension, self.q, self.base, self.u = f, dimension, q, base, u
        if rate is not None:
            self.rate = rate

    @cached_property
    def hinges(self) -> tuple[Column, ...]:
        """The axes about which the angles turn, in those of the ground (in space)."""
        return self._turns[0]

    @cached_property
    def axes(self) -> tuple[Column, ...]:
        """The axes of the body in those of the ground, the columns of A."""
        return self._turns[1]

    @cached_property
    def _turns(self) -> tuple[tuple[Column, ...], tuple[Column, ...]]:
        f, d = self.f, self.dimension
        angles = self.q[d:]
        if not angles:
            return (), tuple(Column(f.number("1") if i == j else f.number("0") for i in range(d)) for j in range(d))
        c, s = zip(*((f.cos(x), f.sin(x)) for x in angles), strict=True)
        if d == 2:
            return (), (Column((c[0], s[0])), Column((-s[0], c[0])))
        g1, e2, e3 = (Column(self.base[j::3]) for j in range(3))
        g2, e3 = e2 * c[0] + e3 * s[0], e3 * c[0] - e2 * s[0]
        e1, g3 = g1 * c[1] - e3 * s[1], g1 * s[1] + e3 * c[1]
        return (g1, g2, g3), (e1 * c[2] + g2 * s[2], g2 * c[2] - e1 * s[2], g3)

    def origin(self) -> Column:
        """Return the position of the reference point."""
        return Column(self.q[: self.dimension] or [self.f.number("0")] * self.dimension)

    def direction(self, vector: Sequence[Any]) -> Column:
        """Return A times a vector given in the body frame."""
        if not self.q[self.dimension :]:
            return Column(vector)
        return combined(self.axes, vector)

    def position(self, point: Sequence[Any] | None) -> Column:
        """Return the position of a point given in the body frame; None: the reference point."""
        return self.origin() if point is None else self.origin() + self.direction(point)

    def angular_velocity(self) -> Column:
        """Return ω in ground components (a vector of one component in the plane)."""
        if self.dimension == 2:
            return Column(self.u[2:])
        return combined(self.hinges, self.u[3:])

    def local_angular_velocity(self) -> Column:
        """Return ω in body components (a vector of one component in the plane); Eq. (111) of the paper."""
        if self.dimension == 2:
            return self.angular_velocity()
        phi_t, theta_t, psi_t = self.u[3:]
        (c2, c3), (s2, s3) = (tuple(map(function, self.q[4:])) for function in (self.f.cos, self.f.sin))
        return Column((c3 * (c2 * phi_t) + s3 * theta_t, c3 * theta_t - s3 * (c2 * phi_t), s2 * phi_t + psi_t))

    def velocity(self, point: Sequence[Any] | None) -> Column:
        """Return the velocity of a point given in the body frame; None: of the reference point."""
        speed = Column(self.u[: self.dimension])
        if point is None or not self.u[self.dimension :]:
            return speed
        arm, turn = self.direction(point), self.angular_velocity()
        return speed + (turn.cross(arm) if self.dimension == 3 else Column((-arm[1], arm[0])) * turn[0])
