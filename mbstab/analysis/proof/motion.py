"""A motion in balls: its field, its state, and the same scene in double precision."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from mbstab.analysis.algebra import ball_matrices, balls
from mbstab.analysis.algebra.balls import Ball, Matrix, ball
from mbstab.analysis.linear.linearize import Linearization
from mbstab.analysis.reference.motion import Motion
from mbstab.analysis.reference.rotation import cross_matrix
from mbstab.compiler.system import System


class Field:
    """The generator X(q) of a steady motion in balls; see `mbstab.analysis.reference.steady.Generator`."""

    def __init__(
        self, system: System, axis: list[Ball], point: list[Ball], rate: Ball, velocity: list[Ball], spins: list[Ball]
    ) -> None:
        self.system, self.axis, self.point, self.rate = system, axis, point, rate
        self.velocity, self.spins = velocity, spins

    def at(self, q: Sequence[Ball]) -> tuple[list[Ball], Matrix, Matrix]:
        """Return X, Ξ = DX and D²X[X, ·] without the spins' part, shapes (n_q,), (n_q, n_q), (n_q, n_q)."""
        system, n, d = self.system, self.system.n_q, self.system.scene.dimension
        X, slope, growth = list(self.spins), ball_matrices.zeros(n, n), ball_matrices.zeros(n, n)
        turns = not self.rate.is_zero()
        cross = [[self.rate * x for x in row[:d]] for row in cross_matrix(np.array(self.axis, dtype=object))[:d]]
        cross = ball_matrices.matrix(cross)
        for body, part in zip(system.scene.bodies, system.body_slices, strict=True):
            s = part.start
            for i in range(d):
                X[s + i] = X[s + i] + self.velocity[i]
                if turns:
                    for j in range(d):
                        X[s + i] = X[s + i] + cross[i][j] * (q[s + j] - self.point[j])
                        slope[s + i][s + j] = cross[i][j]
            if not body.orientation or not turns:
                continue
            if d == 2:
                X[s + 2] = X[s + 2] + self.rate * self.axis[2]
                continue
            x, first, second = self._angles(body, q[s + 3 : s + 6])
            for i in range(3):
                X[s + 3 + i] = X[s + 3 + i] + self.rate * x[i]
                for j in range(3):
                    slope[s + 3 + i][s + 3 + j] = self.rate * first[i][j]
                    growth[s + 3 + i][s + 3 + j] = self.rate * self.rate * second[i][j]
        return X, slope, growth

    def _angles(self, body: Any, angles: Sequence[Ball]) -> tuple[list[Ball], Matrix, Matrix]:
        """Return X, slope and growth of the Euler angles as `mbstab.analysis.reference.rotation.turning_rates`."""
        f, base = balls.ball_arithmetic(), [ball(x) for x in body.base]
        w1, w2, w3 = (sum((base[3 * i + k] * self.axis[i] for i in range(3)), ball(0)) for k in range(3))
        c1, s1, t2 = f.cos(angles[0]), f.sin(angles[0]), f.tan(angles[1])
        sec = 1 / f.cos(angles[1])
        x, y = c1 * w2 + s1 * w3, c1 * w3 - s1 * w2
        p = w1 - t2 * y
        x_t, y_t, t_t, sec_t = y * p, -x * p, sec * sec * x, sec * t2 * x
        slope, growth = ball_matrices.zeros(3, 3), ball_matrices.zeros(3, 3)
        slope[0][0], slope[0][1], slope[1][0] = t2 * x, -sec * sec * y, y
        slope[2][0], slope[2][1] = -sec * x, sec * t2 * y
        growth[0][0], growth[0][1] = t_t * x + t2 * x_t, -2 * sec * sec_t * y - sec * sec * y_t
        growth[1][0], growth[2][0] = y_t, -sec_t * x - sec * x_t
        growth[2][1] = (sec_t * t2 + sec * t_t) * y + sec * t2 * y_t
        return [p, x, sec * y], slope, growth


class State(NamedTuple):
    """The reference motion in balls."""

    q: list[Ball]
    u: list[Ball]
    a: list[Ball]
    nu: list[Ball]
    slope: Matrix
    second: Matrix
    field: Field


class Rough(NamedTuple):
    """The same scene in double precision."""

    system: System
    motion: Motion
    linear: Linearization


def steady_state(field: Field, q: list[Ball], nu: list[Ball]) -> State:
    """Return the motion that follows a field, given its multipliers."""
    u, slope, growth = field.at(q)
    second = ball_matrices.plus(ball_matrices.times(slope, slope), growth)
    return State(q, u, ball_matrices.apply(slope, u), nu, slope, second, field)
