"""Hidden surfaces in a parallel projection: bodies, as convex hulls, hide points behind them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from mbstab.compiler.system import Array
from mbstab.records import dataclass

FLAT = 1e-4
"""Half of the thickness that a flat body is given, as a fraction of its size."""


@dataclass(frozen=True)
class Solid:
    """A convex body in space.

    Attributes
    ----------
    corners : ndarray, shape (k, 3)
    faces : ndarray, shape (n, 4)
        Outward normal n and offset b of each: inside is n·x <= b.
    rim : ndarray, shape (m, 3)
        Its visible outline, closed; empty before `placed` has fixed the view.
    """

    corners: Array
    faces: Array
    rim: Array

    @classmethod
    def of(cls, skin: Array) -> Solid:
        """Return the convex hull of points, shape (k, 3); a flat one is given an invisibly small thickness."""
        from scipy.spatial import ConvexHull

        size = float(np.max(np.abs(skin)))
        points = skin / size
        _, extents, axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
        if extents[2] <= 1e-6 * extents[0]:
            points = np.concatenate([points - FLAT * axes[2], points + FLAT * axes[2]])
        found = ConvexHull(points)
        # All triangles of a face have the same equation.
        faces = np.unique(np.round(found.equations * [1.0, 1.0, 1.0, -1.0], 12), axis=0)
        return cls(points[found.vertices] * size, faces * [1.0, 1.0, 1.0, size], np.zeros((0, 3)))

    def placed(self, axes: Array, center: Array, across: Array) -> Solid:
        """Return the solid in another frame, with its outline as seen along the last row of `across`."""
        corners, normals = self.corners @ axes.T + center, self.faces[:, :3] @ axes.T
        seen = corners @ across[:2].T
        number = {tuple(p): k for k, p in enumerate(seen.tolist())}
        rim = corners[[number[tuple(p)] for p in hull(seen).tolist()]]
        return Solid(corners, np.column_stack([normals, self.faces[:, 3] + normals @ center]), rim)

    def through(self, points: Array, towards: Array) -> tuple[Array, Array]:
        """Return the distances from points at which rays enter and leave; a ray that misses leaves before it enters."""
        slope, room = self.faces[:, :3] @ towards, self.faces[:, 3] - points @ self.faces[:, :3].T
        along = np.abs(slope) < 1e-9
        with np.errstate(divide="ignore", invalid="ignore"):
            at = room / slope
        first = np.max(np.where(slope < -1e-9, at, -np.inf), axis=1)
        last = np.min(np.where(slope > 1e-9, at, np.inf), axis=1)
        missed = np.any(along & (room < 0.0), axis=1)
        return first, np.where(missed, -np.inf, last)

    def covers(self, other: Solid, towards: Array) -> bool:
        """Return whether the solid is in front of another one where both overlap."""
        shared = []
        for one, two in ((self, other), (other, self)):
            a, b = one.rim[:-1], one.rim[1:]
            rim = np.concatenate([a + (b - a) * part for part in (0.0, 0.25, 0.5, 0.75)])
            first, last = two.through(rim, towards)
            shared.append(rim[last > first])
        points = np.concatenate([x - np.outer(x @ towards, towards) for x in shared])
        if not len(points):
            return False
        # Both outlines are convex: the mean of points in both is in both.
        middle = points.mean(axis=0, keepdims=True)
        return bool(self.through(middle, towards)[1][0] > other.through(middle, towards)[1][0])


def in_order(solids: dict[int, Solid], towards: Array) -> list[int]:
    """Return the keys of solids in an order in which those that cover others come after them."""
    left = dict(sorted(solids.items(), key=lambda item: float((item[1].rim @ towards).mean())))
    covers = {(a, b) for a in left for b in left if a != b and left[a].covers(left[b], towards)}
    found = []
    while left:
        free = (a for a in left if not any((a, b) in covers for b in left))
        found.append(next(free, next(iter(left))))  # solids that cover each other cyclically have no order
        del left[found[-1]]
    return found


def hidden(
    points: Array, solids: Sequence[Solid], towards: Array, deep: float, inside: bool = True
) -> npt.NDArray[np.bool_]:
    """Return which of points, shape (k, 3), are deeper than `deep` (m) behind solids, or `inside` of them."""
    covered = np.zeros(len(points), dtype=bool)
    for solid in solids:
        first, last = solid.through(points, towards)
        # The ray is free before the solid, or runs through some thickness.
        passes = (last > first) & ((first > deep) | (last - np.maximum(first, 0.0) > deep))
        covered |= passes & (inside | (first > -deep))
    return covered


def hull(points: Array) -> Array:
    """Return the convex hull of points in the plane, shape (k, 2), its first point again at the end."""
    order = points[np.lexsort((points[:, 1], points[:, 0]))].tolist()
    halves: list[list[float]] = []
    for run in (order, order[::-1]):
        half: list[list[float]] = []
        for p in run:
            while len(half) > 1 and (
                (half[-1][0] - half[-2][0]) * (p[1] - half[-2][1]) <= (half[-1][1] - half[-2][1]) * (p[0] - half[-2][0])
            ):
                half.pop()
            half.append(p)
        halves += half[:-1]
    return np.array([*halves, halves[0]] if halves else order)
