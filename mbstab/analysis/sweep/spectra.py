"""Eigenvalues and verdicts at many points, as arrays."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from mbstab.analysis.algebra.arrays import Complex, Flags, Index
from mbstab.analysis.sweep.batched_verdict import unstable_counts
from mbstab.analysis.verdict.rule import Sides
from mbstab.compiler.system import Array
from mbstab.records import dataclass


@dataclass(frozen=True)
class Spectra:
    """Eigenvalues over the points of a sweep, and their verdicts.

    Attributes
    ----------
    values : ndarray of complex, shape (points, r)
        Eigenvalues that are not neutral (1/s), in no order; nan where there are none.
    sides : ndarray of int8, shape (points, r)
        Side of the imaginary axis, as in `mbstab.analysis.sweep.batched_verdict`.
    words : ndarray of int8, shape (points,)
        Numbers of the verdicts among `mbstab.analysis.verdict.rule.WORDS`.
    mirrored : ndarray of bool, shape (points,)
        Whether the spectrum is symmetric about the imaginary axis by structure.
    problems : dict
        By the number of a point, why it has no eigenvalues, or none that decide about stability.
    neutral : int
        Additional number of neutral eigenvalues.
    sizes : ndarray, shape (points,)
        Norms of the matrices (1/s).
    motion : ndarray, shape (points, 2 n_q)
        Coordinates and rates of solved references, nan where there are none; (points, 0) if the file gives them.
    """

    values: Complex
    sides: Sides
    words: npt.NDArray[np.int8]
    mirrored: Flags
    problems: dict[int, str]
    neutral: int
    sizes: Array
    motion: Array

    def at(self, point: int) -> Spectra:
        """Return one of the points, without an axis for points."""
        arrays: dict[str, Any] = {name: x[point] for name, x in vars(self).items() if isinstance(x, np.ndarray)}
        return replace(self, **arrays)

    @property
    def unstable(self) -> Index:
        """Number of unstable eigenvalues of each point; −1 where the verdict is open."""
        return unstable_counts(self.sides, self.words)
