"""Zeros of transfer functions that lie on the imaginary axis exactly.

With P(s) = [s E − A, B; C, D(s)] a transfer function is G = det P / det(s E − A). Two things follow from the places of
the exact zeros among the entries of P alone:

* Each product of the determinant vanishes at s = 0 at least as often as its factors do together. The least sum over all
  ways to choose one entry of each row and column is a bound from below of the order of the zero of det P at 0 (Murota,
  Matrices and Matroids for Systems Analysis, 2000, section 6.2).
* If signs of rows and columns turn each P_ij(−s) into P_ij(s), which is so without damping, G(−s) = ±G(s): the mirror
  image of a zero in the axis is a zero, and one that is alone in a disc that meets the axis is its own.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Powers = npt.NDArray[np.bool_]
"""Which entries of P have a term with s^0, s^1, s^2, shape (3, n, n); the last row and column are output and input."""


def order_at_zero(powers: Powers) -> int:
    """Return how often 0 is a root of det P at least; 0 if det P vanishes."""
    from scipy.optimize import linear_sum_assignment

    least = np.where(powers.any(axis=0), np.argmax(powers, axis=0), len(powers) * len(powers[0]))
    cost = int(least[linear_sum_assignment(least)].sum())
    return cost if cost < len(powers) * len(powers[0]) else 0


def mirrored(powers: Powers) -> bool:
    """Whether G(−s) = ±G(s), by the places of the entries that belong to the input and the output.

    Each row and each column stands for two nodes of a graph, one of each sign. Even entries join nodes of one sign, odd
    ones those of both; signs exist unless both nodes of a row are joined.
    """
    from scipy.sparse import block_array, csr_array
    from scipy.sparse.csgraph import connected_components

    n = len(powers[0])
    even, odd = csr_array(powers[0] | powers[2]), csr_array(powers[1])
    joined = block_array([[even, odd], [odd, even]])
    _, label = connected_components(block_array([[None, joined], [joined.T, None]]), directed=False)
    rows, columns = label[: 2 * n].reshape(2, n)[:, -1], label[2 * n :].reshape(2, n)[:, -1]
    return bool(rows[0] != rows[1] and columns[0] != columns[1])
