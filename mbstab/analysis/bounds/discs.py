"""Discs of the complex plane that contain eigenvalues."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from mbstab.analysis.algebra.arrays import Complex, Index
from mbstab.analysis.algebra.tolerances import TOLERANCES as ALGEBRA
from mbstab.compiler.system import Array
from mbstab.records import dataclass

Group = list[int]


@dataclass(frozen=True)
class Disc:
    """A disc that contains exactly as many eigenvalues as it has members; radius inf: nothing is known."""

    centre: complex
    radius: float
    members: tuple[int, ...]


@dataclass(frozen=True)
class Placed:
    """Eigenvalues left to judge, and where they can be.

    Attributes
    ----------
    values : ndarray of complex, shape (r,)
        (1/s)
    discs : list of Disc
        Disjoint, except those of radius inf.
    bounds : ndarray, shape (r,)
        Error bound of each value (1/s); inf: nothing is known.
    condition : ndarray, shape (r,)
        Magnification of the rounding of the data: the bound relative to the eigenvalue, in roundings.
    backward_error : ndarray, shape (r,)
        Residual of the pair relative to the matrices.
    vectors : ndarray of complex, shape (n_q, r)
        Δq in scaled coordinates; zero for members of a cluster that has fewer eigenvectors.
    neutral : tuple of int
        Numbers of the values that belong to T and L, without discs. Empty for the default method.
    column : ndarray of int, optional
        Column of `vectors` for each value, to be conjugated where Im s < 0; None: column i belongs to value i.
    """

    values: Complex
    discs: list[Disc]
    bounds: Array
    condition: Array
    backward_error: Array
    vectors: Complex
    neutral: tuple[int, ...] = ()
    column: Index | None = None


def bounds_in(discs: Sequence[Disc], values: Complex) -> Array:
    """Return how far each eigenvalue can be from its value, by the discs; inf: nothing is known."""
    bounds = np.full(len(values), np.inf)
    for disc in discs:
        members = list(disc.members)
        bounds[members] = disc.radius + np.abs(values[members] - disc.centre)
    return np.where(np.isfinite(bounds), bounds, np.inf)


def meeting(centres: Any, radii: Any) -> list[tuple[int, int]]:
    """Return pairs of discs that overlap, the smaller number first; discs without a radius are left out."""
    known = np.flatnonzero(np.isfinite(radii))
    centres, radii = np.asarray(centres)[known], np.asarray(radii)[known]
    found: list[tuple[int, int]] = []
    for start in range(0, len(known), ALGEBRA.columns_at_once):
        rows = slice(start, start + ALGEBRA.columns_at_once)
        meet = ~(np.abs(centres[rows, None] - centres[start:]) > radii[rows, None] + radii[start:])
        for i, j in zip(*np.nonzero(np.triu(meet, 1)), strict=True):
            found.append((int(known[start + i]), int(known[start + j])))
    return found


def relative(error: Array, values: Complex) -> Array:
    """Return errors relative to the sizes of eigenvalues, inf at zero."""
    size = np.abs(values)
    result: Array = np.where(size > 0.0, error / np.where(size > 0.0, size, 1.0), np.inf)
    return result
