"""What verdicts ask of arithmetic with many digits, about motions beside a reference and what holds or drives them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np

from mbstab.analysis.algebra.arrays import norms
from mbstab.analysis.reference.coefficients import Matrices
from mbstab.compiler.system import Array
from mbstab.records import dataclass

Power = tuple[int, int]
"""The power of the distance with which a function begins, and the sign of its coefficient; (0, 0) if it vanishes."""


@dataclass(frozen=True)
class Line:
    """A direction beside a reference, and what holds motions at distances along it, or drives them there.

    Attributes
    ----------
    along : ndarray, shape (n_q,)
        The direction; measure·along = 1.
    measure : ndarray, shape (n_q,)
        The distance of q is measure·(q − q₀), and a force that holds it acts along measure.
    held : tuple of ndarray, shape (n_q,)
        Shifts of symmetries: their products with q − q₀, relative to the sizes, are kept at zero.
    drifts : bool
        Whether the motion is left to drift: along the line, and along the shifts of symmetries.
    """

    along: Array
    measure: Array
    held: tuple[Array, ...]
    drifts: bool

    def drift(self, sizes: Array) -> Array:
        """Return the directions in which a motion drifts, that of the line last, as columns, shape (n_q, number)."""
        return np.array([*(sizes * x for x in self.held), self.along]).T if self.drifts else np.zeros((len(sizes), 1))

    def pushed(self, sizes: Array) -> Array:
        """Return the forces that act, as columns, shape (n_q, number)."""
        return 0.0 * self.drift(sizes) if self.drifts else self.measure[:, None]

    def bordered(self, matrices: Matrices, n_h: int, sizes: Array) -> tuple[Array, Array, Array]:
        """Return the derivative of balance, rows and distances, and the sizes of its rows and columns.

        By the coordinates, relative to their sizes, the reactions, and the force or the speeds of the drift; divided
        by both sizes.

        Parameters
        ----------
        matrices : Matrices
            Of the linearized equations, in the frame of the motion.
        n_h : int
            The first so many rows are those on positions.
        sizes : ndarray, shape (n_q,)
        """
        J, drift, kept = matrices.J, self.drift(sizes), self.kept(sizes)
        n, last = len(sizes), len(sizes) + len(J)
        matrix = np.zeros((last + len(kept), last + drift.shape[1]))
        matrix[:n, :n], matrix[:n, n:last] = matrices.K * sizes, J.T
        matrix[:n, last:] = matrices.R @ drift - self.pushed(sizes)
        matrix[n : n + n_h, :n], matrix[n + n_h : last, :n] = J[:n_h] * sizes, matrices.D_q * sizes
        matrix[n + n_h : last, last:], matrix[last:, :n] = J[n_h:] @ drift, kept
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
        """Return how the force that holds the motion along a line, or its drift, begins ahead and behind.

        None if it is not known. The sign is that away from the reference.
        """
