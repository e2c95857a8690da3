"""Pairing of the values of two lists with minimal distances, and sets of values that belong together."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from mbstab.analysis.algebra.arrays import Flags
from mbstab.compiler.system import Array

if TYPE_CHECKING:
    import numpy.typing as npt


def assigned(cost: npt.NDArray[np.float64]) -> npt.NDArray[np.intp]:
    """Return the column paired with each row of a square cost matrix, so that the sum of costs is least.

    Shortest augmenting paths (Jonker and Volgenant 1987, Computing 38) for the rows that do not get their own least
    cost. For the few of these among the eigenvalues of a mechanism this is faster than importing SciPy's routine.
    """
    n = len(cost)
    nearest: npt.NDArray[np.intp] = np.argmin(cost, axis=1) if n else np.zeros(0, dtype=np.intp)
    columns, first = np.unique(nearest, return_index=True)
    if len(columns) == n:  # each has its own least cost: no sum is less
        return nearest
    u, v = np.min(cost, axis=1), np.zeros(n + 1)
    row_of = np.full(n + 1, -1)  # the last column is where paths start
    row_of[columns] = first
    for row in np.setdiff1d(np.arange(n), first).tolist():
        row_of[n], j = row, n
        least, before = np.full(n, np.inf), np.full(n, n)
        seen = np.zeros(n + 1, dtype=bool)
        while row_of[j] >= 0:
            seen[j] = True
            i = int(row_of[j])
            reduced = cost[i] - u[i] - v[:n]
            better = ~seen[:n] & (reduced < least)
            least[better], before[better] = reduced[better], j
            following = int(np.argmin(np.where(seen[:n], np.inf, least)))
            delta = float(least[following])
            u[row_of[np.flatnonzero(seen)]] += delta
            v[seen] -= delta
            least[~seen[:n]] -= delta
            j = following
        while j != n:
            row_of[j] = row_of[before[j]]
            j = int(before[j])
    found = np.empty(n, dtype=np.intp)
    found[row_of[:n]] = np.arange(n)
    return found


def matched(found: Any, expected: Any) -> Array:
    """Return |found − expected| after the pairing that makes the sum smallest.

    Parameters
    ----------
    found, expected : array_like of complex, the same number

    Notes
    -----
    Sorting complex numbers pairs them wrongly when real parts differ by round-off.
    """
    found, expected = np.asarray(found, dtype=complex), np.asarray(expected, dtype=complex)
    distance = np.abs(found[:, None] - expected[None, :])
    result = np.empty(len(expected))
    columns = assigned(distance)
    result[columns] = distance[np.arange(len(found)), columns]
    return result


def reached(joined: Flags | list[list[bool]]) -> Flags:
    """Return what each of some things is joined to, directly or through others; itself as well, shape (n, n)."""
    n = len(joined)
    reach: Flags = np.array(joined, dtype=bool).reshape(n, n) | np.eye(n, dtype=bool)
    for _ in range(n.bit_length()):
        reach = reach @ reach
    return reach


def together(joined: Flags | list[list[bool]]) -> list[list[int]]:
    """Return the members of each set of things that are joined both ways, directly or through others."""
    reach = reached(joined)
    both = reach & reach.T
    return [np.flatnonzero(row).tolist() for i, row in enumerate(both) if int(np.argmax(row)) == i]
