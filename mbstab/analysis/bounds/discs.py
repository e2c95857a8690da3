"""Discs of the complex plane that contain eigenvalues."""

from __future__ import annotations

import numpy as np

from mbstab.analysis.algebra.arrays import Complex, Index
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


def relative(error: Array, values: Complex) -> Array:
    """Return errors relative to the sizes of eigenvalues, inf at zero."""
    size = np.abs(values)
    result: Array = np.where(size > 0.0, error / np.where(size > 0.0, size, 1.0), np.inf)
    return result
