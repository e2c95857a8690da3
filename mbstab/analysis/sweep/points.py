"""The linearized equations at many points of a sweep, and disturbances of their motions."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from mbstab.analysis.reference.fields import Symmetry
from mbstab.analysis.reference.steady import Generator
from mbstab.analysis.sweep.stacks import some
from mbstab.analysis.verdict.followers import disturbances
from mbstab.compiler.system import Array, System
from mbstab.records import dataclass


@dataclass(frozen=True)
class Points:
    """The linearized equations at many points, in scaled coordinates.

    Attributes
    ----------
    system : System
    q, u, a : ndarray, shape (points, n_q)
    steady : Generator or None
        The co-moving frame of the motions, if it rotates.
    data : tuple of ndarray
        Error bounds of K and R by the numbers of the file, shape (points, n_q, n_q), and the ratio by which that of M
        and of the rows is larger than the rounding of an evaluation, shape (points,); as in
        `mbstab.analysis.sweep.data_errors`.
    scale : ndarray, shape (points, n_q)
    M, R, K : ndarray, shape (points, n_q, n_q)
    allowed : ndarray, shape (points, n_q, m)
        Motions that the constraints alone allow; N obeys the balance of what has no mass as well.
    N, Z, P : ndarray
        As in `mbstab.analysis.algebra.subspaces`.
    S : ndarray, shape (points, n, n)
        Balanced with …
    gamma : ndarray, shape (points,)
        … these rates (1/s).
    error : ndarray, shape (points,)
        Norm of the rounding error of S (1/s).
    across : ndarray, shape (points,)
        Forces across rows on speeds, relative to all forces.
    spread : ndarray, shape (points,)
        Ratio of the terms of the matrices to their sums.
    terms : ndarray, shape (points, n_q, n_q)
        Sizes of the terms of K.
    """

    system: System
    q: Array
    u: Array
    a: Array
    steady: Generator | None
    data: tuple[Array, Array, Array]
    scale: Array
    M: Array
    R: Array
    K: Array
    allowed: Array
    N: Array
    Z: Array
    P: Array
    S: Array
    gamma: Array
    error: Array
    across: Array
    spread: Array
    terms: Array

    @property
    def n_xi(self) -> int:
        """Number of positions among the components of y."""
        return int(self.N.shape[-1])

    def followers(self, states: list[int]) -> Array:
        """Return disturbances of states that only follow, as columns in the coordinates of S."""
        return disturbances(self.N, self.Z, self.P, self.gamma, states)

    @cached_property
    def size(self) -> Array:
        """Norms of S (1/s)."""
        result: Array = np.linalg.norm(self.S, axis=(-2, -1))
        return result

    @cached_property
    def slope(self) -> Array | None:
        """Ξ of the rotating frame in scaled coordinates; None without one."""
        if self.steady is None:
            return None
        result: Array = self.steady.frame(self.q)[0] * self.scale[:, None, :] / self.scale[:, :, None]
        return result

    def stiffness_on_ground(self) -> tuple[Array, Array]:
        """Return K in the frame of the ground, and the sizes of the terms by which it differs from that here."""
        assert self.steady is not None
        first, second = (x * self.scale[:, None, :] / self.scale[:, :, None] for x in self.steady.frame(self.q))
        R = self.R - 2.0 * self.M @ first
        terms = np.abs(R) @ np.abs(first) + np.abs(self.M) @ np.abs(second)
        return self.K - R @ first - self.M @ second, terms

    def at(self, index: Any) -> Points:
        """Return some of the points."""
        steady = self.steady
        if steady is not None:
            parts = (some(np.asarray(x), index, dims) for x, dims in
                     ((steady.rate, 1), (steady.velocity, 2), (steady.spins, 2)))  # fmt: skip
            rate, velocity, spins = parts
            steady = Generator(steady.system, steady.axis, steady.point, rate, velocity, spins)  # type: ignore[arg-type]
        arrays = (
            some(x, index, 0) for x in (
                self.scale, self.M, self.R, self.K, self.allowed, self.N, self.Z, self.P, self.S, self.gamma,
                self.error, self.across, self.spread, self.terms,
            )
        )  # fmt: skip
        K, R, ratio = (some(x, index, 0) for x in self.data)
        return Points(self.system, self.q[index], self.u[index], self.a[index], steady, (K, R, ratio), *arrays)


def seen_from(points: Points, step: Generator, rate: Array) -> Points:
    """Return points in a frame that rotates faster by a rate."""
    R, K, turn = points.R, points.K, rate
    if points.steady is not None:
        first, second = _frame(points, points.steady)
        R = R - 2.0 * points.M @ first
        K = K - R @ first - points.M @ second
        turn = rate + points.steady.rate
    spins = step.spins * rate[:, None]
    generator = Generator(step.system, step.axis, step.point, turn, np.zeros(3), spins)  # type: ignore[arg-type]
    first, second = _frame(points, generator)
    K = K + R @ first + points.M @ second
    return replace(points, R=R + 2.0 * points.M @ first, K=K, steady=generator)


def _frame(points: Points, generator: Generator) -> tuple[Array, Array]:
    """Return Ξ and Ξ₂ in scaled coordinates."""
    first, second = (x * points.scale[:, None, :] / points.scale[:, :, None] for x in generator.frame(points.q))
    return first, second


def disturbance(item: Symmetry, points: Points) -> tuple[Array, Array]:
    """Return the changes of coordinates and speeds under a symmetry, (Y, DY u), each of shape (points or 1, n_q)."""
    q, u, field = points.q, points.u, item.of
    if item.name == "the motion itself":
        return u, points.a
    if field.shift is not None:
        return field.shift[None], 0.0 * field.shift[None]
    return field.field(q), (field.slope(q) @ u[..., None])[..., 0]
