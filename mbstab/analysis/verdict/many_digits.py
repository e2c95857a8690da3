"""What verdicts ask of arithmetic with many digits."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from mbstab.compiler.system import Array

Power = tuple[int, int]
"""The power of the distance with which a force begins, and the sign of its coefficient; (0, 0) if it vanishes."""


class ManyDigits(Protocol):
    """A reference motion with many digits, in which a zero is told from a small number."""

    def zeros(self) -> int:
        """Return the number of eigenvalues that are zero; −1 if it cannot be known."""

    def power(self, measure: Array, along: Array, held: Sequence[Array]) -> Power | None:
        """Return how the force begins that holds the motion at a distance along a direction.

        Parameters
        ----------
        measure : ndarray, shape (n_q,)
            The distance of q is measure·(q − q₀), and the force acts along measure.
        along : ndarray, shape (n_q,)
            The direction; measure·along = 1.
        held : sequence of ndarray, shape (n_q,)
            Further functions of q − q₀ that are kept at zero: shifts of symmetries.
        """
