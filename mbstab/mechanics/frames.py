"""Symbolic kinematics of a body, in terms of which elements are defined.

Orientation in space is Euler X-Y-Z after a constant base rotation, A = B Ax(φ) Ay(θ) Az(ψ),
Eqs. (120)-(122) of Pappalardo, Lettieri, Guida (2020) with B = 1.
"""

from __future__ import annotations

from typing import Any

import sympy

from mbstab.mechanics.catalogue import COORDINATES


class Frame:
    """Coordinates, speeds and kinematics of one slot.

    Attributes
    ----------
    q, u, a : list of Symbol
        Coordinates, speeds and accelerations.
    dimension : int
        2 or 3 (0 for a bare coordinate).
    base : list of Symbol
        The nine numbers of B, row by row (spatial frames only).
    """

    def __init__(self, kind: str, number: int) -> None:
        self.kind = kind
        names = COORDINATES[kind]
        self.q = [sympy.Symbol(f"{name}{number}", real=True) for name in names]
        self.u = [sympy.Symbol(f"{name}{number}_t", real=True) for name in names]
        self.a = [sympy.Symbol(f"{name}{number}_tt", real=True) for name in names]
        self.dimension = {"planar": 2, "spatial": 3}.get(kind, 0)
        self.base = [sympy.Symbol(f"base{number}_{i}{j}", real=True) for i in "123" for j in "123"]
        if kind != "spatial":
            self.base = []

    def _turned(self, vector: Any, first: int, last: int) -> Any:
        """Return a vector after the elementary rotations `first` … `last` − 1, the last one applied first."""
        for axis in reversed(range(first, last)):
            c, s = sympy.cos(self.q[3 + axis]), sympy.sin(self.q[3 + axis])
            j, k = (axis + 1) % 3, (axis + 2) % 3
            turned = list(vector)
            turned[j], turned[k] = c * vector[j] - s * vector[k], s * vector[j] + c * vector[k]
            vector = turned
        return sympy.Matrix(vector)

    def _based(self, vector: Any) -> Any:
        return sympy.Matrix(3, 3, self.base) * vector

    def origin(self) -> Any:
        """Return the position of the reference point."""
        return sympy.Matrix(self.q[: self.dimension])

    def position(self, point: Any) -> Any:
        """Return the position of a point given in the body frame."""
        return self.origin() + self.direction(point)

    def direction(self, vector: Any) -> Any:
        """Return A times a vector given in the body frame."""
        if self.dimension == 2:
            c, s = sympy.cos(self.q[2]), sympy.sin(self.q[2])
            return sympy.Matrix([c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]])
        return self._based(self._turned(vector, 0, 3))

    def rate(self, expression: Any) -> Any:
        """Return the time derivative of an expression of this frame's coordinates."""
        return sum((expression.diff(q) * u for q, u in zip(self.q, self.u, strict=True)), 0 * expression)

    def velocity(self, point: Any) -> Any:
        """Return the velocity of a point given in the body frame."""
        return self.rate(self.position(point))

    def squared_speed(self, point: Any) -> Any:
        """Return |v|² of a point; in space computed in the base axes, which costs fewer operations."""
        if self.dimension == 2:
            velocity = self.velocity(point)
        else:
            origin = sympy.Matrix(3, 3, self.base).T * sympy.Matrix(self.u[:3])
            velocity = origin + self.rate(self._turned(point, 0, 3))
        return velocity.dot(velocity)

    def local_angular_velocity(self) -> Any:
        """Return ω in body components (a 1-vector in the plane); Eq. (111) of the paper."""
        if self.dimension == 2:
            return sympy.Matrix([self.u[2]])
        phi_t, theta_t, psi_t = self.u[3:]
        c2, s2 = sympy.cos(self.q[4]), sympy.sin(self.q[4])
        c3, s3 = sympy.cos(self.q[5]), sympy.sin(self.q[5])
        return sympy.Matrix([c3 * (c2 * phi_t) + s3 * theta_t, c3 * theta_t - s3 * (c2 * phi_t), s2 * phi_t + psi_t])

    def angular_velocity(self) -> Any:
        """Return ω in ground components."""
        if self.dimension == 2:
            return self.local_angular_velocity()
        phi_t, theta_t, psi_t = self.u[3:]
        inner = self._turned(sympy.Matrix([0, theta_t, 0]) + self._turned([0, 0, psi_t], 1, 2), 0, 1)
        return self._based(sympy.Matrix([phi_t + inner[0], inner[1], inner[2]]))
