"""What verdicts ask of arithmetic with many digits, about forces that hold a motion beside its reference."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np

from mbstab.analysis.algebra.arrays import norms
from mbstab.compiler.system import Array
from mbstab.records import dataclass

Power = tuple[int, int]
"""The power of the distance with which a force begins, and the sign of its coefficient; (0, 0) if it vanishes."""


@dataclass(frozen=True)
class Line:
    """A direction beside a reference, and a force that holds motions at distances along it.

    Attributes
    ----------
    along : ndarray, shape (n_q,)
        The direction; measure·along = 1.
    measure : ndarray, shape (n_q,)
        The distance of q is measure·(q − q₀), and the force acts along measure.
    held : tuple of ndarray, shape (n_q,)
        Shifts of symmetries: their products with q − q₀, relative to the sizes, are kept at zero.
    """

    along: Array
    measure: Array
    held: tuple[Array, ...]

    def bordered(self, K: Array, J: Array, n_h: int, sizes: Array) -> tuple[Array, Array, Array]:
        """Return the derivative of balance, rows and distances, and the sizes of its rows and columns.

        By the coordinates, relative to their sizes, the reactions and the force; divided by both sizes.

        Parameters
        ----------
        K : ndarray, shape (n_q, n_q)
        J : ndarray, shape (n_c, n_q)
        n_h : int
            The first so many rows are those on positions.
        sizes : ndarray, shape (n_q,)
        """
        kept = self.kept(sizes)
        n, last = len(sizes), len(sizes) + len(J)
        matrix = np.zeros((n + n_h + len(kept), last + 1))
        matrix[:n, :n], matrix[:n, n:last], matrix[:n, last] = K * sizes, J.T, -self.measure
        matrix[n : n + n_h, :n], matrix[n + n_h :, :n] = J[:n_h] * sizes, kept
        rows = norms(matrix)
        columns = norms(matrix / rows[:, None], 0)
        return matrix / rows[:, None] / columns, rows, columns

    def kept(self, sizes: Array) -> Array:
        """Return what makes the held shifts and then the distance of changes relative to the sizes, as rows."""
        return np.array([*self.held, self.measure * sizes])


class Zeros(NamedTuple):
    """The eigenvalues of a motion that are zero to many digits.

    Attributes
    ----------
    number : int
        −1 if it cannot be known.
    chain : int
        Length of their longest chain: disturbances of the linearized equations grow like t to one power less.
    """

    number: int
    chain: int


UNKNOWN = Zeros(-1, 0)


class ManyDigits(Protocol):
    """A reference motion with many digits, in which a zero is told from a small number."""

    def zeros(self, turns: Sequence[complex]) -> Zeros:
        """Return the eigenvalues that are zero, and pairs that turn with the motion; `UNKNOWN` if they cannot be known.

        Parameters
        ----------
        turns : sequence of complex (1/s)
            ±iΩ of these pairs in double precision.
        """

    def powers(self, line: Line) -> tuple[Power, Power] | None:
        """Return how the force begins that holds the motion along a line, ahead and behind; None if it is not known."""
