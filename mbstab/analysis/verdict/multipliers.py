"""Discs that contain the multipliers of a periodic motion, single ones and clusters alike.

The monodromy matrix A is known to an error ε in the spectral norm. A point z is not an eigenvalue of
any matrix within ε if the smallest singular value of z − A is larger than ε; on a circle of such points
the number of eigenvalues inside is that of A (pseudospectra: Trefethen and Embree 2005, section
2). Equal multipliers, defective or not, share one disc.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence

import numpy as np

from mbstab.analysis.algebra.arrays import Complex
from mbstab.analysis.bounds.discs import Disc
from mbstab.analysis.verdict import rule
from mbstab.analysis.verdict.tolerances import TOLERANCES
from mbstab.compiler.system import Array


def enclosed(A: Array, error: float) -> tuple[Complex, list[Disc]]:
    """Return the eigenvalues of a matrix with a given error in the spectral norm, and disjoint discs around them."""
    n = len(A)
    if not n:
        return np.zeros(0, dtype=complex), []
    if not (np.isfinite(A).all() and math.isfinite(error)):
        values = np.full(n, np.nan, dtype=complex)
        return values, [Disc(complex(math.nan, math.nan), math.inf, tuple(range(n)))]
    values = np.linalg.eigvals(A).astype(complex)
    groups = [[i] for i in range(n)]
    while True:
        discs = [_disc(A, error, values, members) for members in groups]
        met = _meeting(discs)
        if met is None:
            return values, discs
        groups[met[0]] += groups[met[1]]
        del groups[met[1]]


def _meeting(discs: list[Disc]) -> tuple[int, int] | None:
    """Return two discs that overlap; one without a radius overlaps the nearest one."""
    centres, radii = np.array([x.centre for x in discs]), np.array([x.radius for x in discs])
    apart = np.abs(centres[:, None] - centres)
    np.fill_diagonal(apart, np.inf)
    open_ = ~np.isfinite(radii)
    between = np.where(open_[:, None], apart, np.inf) if open_.any() else apart - radii[:, None] - radii
    i, j = np.unravel_index(int(np.argmin(between)), between.shape)
    met = len(discs) > 1 and (bool(open_.any()) or not between[i, j] > 0.0)
    return (int(i), int(j)) if met else None


def _disc(A: Array, error: float, values: Complex, members: list[int]) -> Disc:
    """Return a disc that contains a group of eigenvalues and no others; the radius is inf if none is found."""
    inside, outside = values[members], np.delete(values, members)
    centre = complex(np.mean(inside))
    if all(np.any(inside == s.conjugate()) for s in inside):
        centre = complex(centre.real)
    count = TOLERANCES.multiplier_circle_points
    angles = np.exp(2j * np.pi * (np.arange(count) + 0.5) / count)
    shifted = centre * np.eye(len(A)) - A

    def clear(radius: float) -> bool:
        points = shifted + radius * angles[:, None, None] * np.eye(len(A))
        return bool(
            np.min(np.linalg.svd(points, compute_uv=False)[:, -1]) > TOLERANCES.multiplier_circle_errors * error
        )

    low = max(float(np.max(np.abs(inside - centre))), error, 1e-300)
    far = float(np.min(np.abs(outside - centre), initial=np.inf))
    tried = (
        [part * far for part in TOLERANCES.multiplier_circle_parts]
        if len(outside)
        else [4.0 * (float(np.linalg.norm(shifted, 2)) + error)]
    )
    high = next((radius for radius in tried if radius > low and clear(radius)), math.inf)
    while math.isfinite(high) and high > 1.2 * low:
        middle = math.sqrt(low * high)
        low, high = (low, middle) if clear(middle) else (middle, high)
    return Disc(centre, high, tuple(members))


def placed(discs: Sequence[Disc], period: float, mirrored: str) -> list[rule.Disc]:
    """Return the discs of the exponents log(μ)/T with the side of the axis on which they lie.

    Parameters
    ----------
    discs : sequence of Disc
        Of the multipliers, disjoint.
    period : float (s)
    mirrored : str
        What makes 1/μ̄ a multiplier if μ is one, in words; empty: nothing does. If not empty, a disc that
        contains a single multiplier lies on the unit circle if no other disc overlaps its mirror image;
        1 and −1, where multipliers may leave the circle, do not count as held there.
    """
    found = []
    for i, disc in enumerate(discs):
        size = abs(disc.centre)
        where, why = rule.side(size - 1.0, disc.radius), ""
        alone = len(disc.members) == 1 and min(abs(disc.centre - 1.0), abs(disc.centre + 1.0)) > disc.radius
        if where == "open" and mirrored and alone and size > disc.radius:
            image, radius = 1.0 / disc.centre.conjugate(), disc.radius / (size * (size - disc.radius))
            if all(abs(image - x.centre) > radius + x.radius for j, x in enumerate(discs) if j != i):
                where, why = "axis", mirrored
        exponent = cmath.log(disc.centre or 1e-300) / period if size == size else disc.centre
        spread = -math.log1p(-disc.radius / size) / period if size > disc.radius else math.inf
        found.append(rule.Disc(exponent, spread, len(disc.members), where, why))
    return found
