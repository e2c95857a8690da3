"""The linearized equations at many points of a sweep, and disturbances of their motions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from functools import cached_property
from typing import Any

import numpy as np

from mbstab.analysis.algebra.stacks import frobenius, some, stacked
from mbstab.analysis.reference.fields import Symmetry
from mbstab.analysis.reference.steady import Generator
from mbstab.analysis.verdict.directions import Deflated
from mbstab.compiler.system import Array, System
from mbstab.records import dataclass


@dataclass(frozen=True)
class Points(Deflated):
    """The deflated equations at many points.

    Attributes
    ----------
    system : System
    u, a : ndarray, shape (points, n_q)
    data : tuple of ndarray
        Error bounds of K and R by the numbers of the file, shape (points, n_q, n_q), and the ratio by which that of M
        and of the rows is larger than the rounding of an evaluation, shape (points,); as in
        `mbstab.analysis.sweep.data_errors`.
    free : ndarray, shape (points, n_q, m)
        Motions that the constraints alone allow; N obeys the balance of what has no mass as well.
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
    u: Array
    a: Array
    data: tuple[Array, Array, Array]
    free: Array
    error: Array
    across: Array
    spread: Array
    terms: Array

    @cached_property
    def size(self) -> Array:
        """Norms of S (1/s)."""
        return frobenius(self.S)

    def changes(self, items: Sequence[Symmetry]) -> tuple[Array, Array]:
        """Return the changes of coordinates and speeds under symmetries, as columns, at each point."""
        moved, rates = zip(*(self._change(item) for item in items), strict=True)
        return stacked(list(moved)), stacked(list(rates))

    def _change(self, item: Symmetry) -> tuple[Array, Array]:
        """Return (Y, DY u) of a symmetry, each of shape (points or 1, n_q)."""
        field = item.of
        if item.name == "the motion itself":
            return self.u, self.a
        if field.shift is not None:
            return field.shift[None], 0.0 * field.shift[None]
        return field.field(self.q), (field.slope(self.q) @ self.u[..., None])[..., 0]

    def on_ground(self) -> tuple[Array, Array, Array]:
        """Return R and K in the frame of the ground, and the sizes of the terms by which K differs from that here."""
        if self.steady is None:
            return self.R, self.K, 0.0 * self.K
        first, second = map(self.scaled, self.steady.frame(self.q))
        R = self.R - 2.0 * self.M @ first
        terms = np.abs(R) @ np.abs(first) + np.abs(self.M) @ np.abs(second)
        return R, self.K - R @ first - self.M @ second, terms

    def at(self, index: Any) -> Points:
        """Return some of the points."""
        steady = self.steady
        if steady is not None:
            parts = (some(np.asarray(x), index, dims) for x, dims in
                     ((steady.rate, 1), (steady.velocity, 2), (steady.spins, 2)))  # fmt: skip
            rate, velocity, spins = parts
            steady = replace(steady, rate=rate, velocity=velocity, spins=spins)  # type: ignore[arg-type]
        arrays: dict[str, Any] = {name: some(x, index, 0) for name, x in vars(self).items() if name in ARRAYS}
        K, R, ratio = (some(x, index, 0) for x in self.data)
        return replace(self, steady=steady, data=(K, R, ratio), **arrays)


ARRAYS = frozenset(x.name for x in fields(Points)) - {"system", "steady", "data"}
"""Names of what has an axis for the points."""


def seen_from(points: Points, step: Generator, rate: Array) -> Points:
    """Return points in a frame that rotates faster by a rate."""
    R, K, _ = points.on_ground()
    turn, spins = rate if points.steady is None else rate + points.steady.rate, step.spins * rate[:, None]
    generator = Generator(step.system, step.axis, step.point, turn, np.zeros(3), spins)  # type: ignore[arg-type]
    first, second = map(points.scaled, generator.frame(points.q))
    K = K + R @ first + points.M @ second
    return replace(points, R=R + 2.0 * points.M @ first, K=K, steady=generator)
