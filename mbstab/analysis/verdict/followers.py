"""States that only follow: no force, no row and no other state contains them.

A disturbance of them alone stays one of them alone: S F = F A, with F as columns. Where the others move steadily along
a symmetry, they stay behind by as much as makes their rates those of the symmetry. All arrays may be stacks, with one
matrix for each point of a sweep.
"""

from __future__ import annotations

import numpy as np

from mbstab.analysis.algebra.stacks import under
from mbstab.analysis.verdict.tolerances import TOLERANCES
from mbstab.compiler.system import Array


def disturbances(N: Array, Z: Array, P: Array, gamma: Array | float, states: list[int]) -> Array:
    """Return disturbances of states alone as columns, in the coordinates of the balanced S, shape (…, n, states).

    Parameters
    ----------
    N, Z, P : ndarray
        As in `mbstab.analysis.algebra.subspaces`.
    gamma : ndarray, shape (…), or float (1/s)
        The unit of speeds.
    """
    xi = np.swapaxes(N[..., states, :], -1, -2)
    allowed = N @ Z
    leading = _leading(allowed, states)
    # Bodies have no speed: those that come with the rows are taken back.
    eta = -_inverse(leading * allowed) @ (leading * (N @ P @ xi))
    return under(xi, eta / np.asarray(gamma)[..., None, None])


def led(directions: Array, allowed: Array, states: list[int]) -> tuple[Array, Array]:
    """Return the speeds along directions that the rows allow, and what of the directions they forbid.

    Parameters
    ----------
    directions : ndarray, shape (…, n_q, k)
        Unit columns in scaled coordinates.
    allowed : ndarray, shape (…, n_q, m)
        Orthonormal speeds that the rows allow.
    states : list of int
        Coordinates whose speeds follow from the others.

    Returns
    -------
    speeds, across : ndarray, shape (…, n_q, k)
    """
    if not states:
        speeds = allowed @ (np.swapaxes(allowed, -1, -2) @ directions)
        return speeds, directions - speeds
    leading = _leading(allowed, states)
    speeds = allowed @ (_inverse(leading * allowed) @ (leading * directions))
    return speeds, leading * (directions - speeds)


def left_behind(S: Array, F: Array, speeds: Array, along: Array) -> tuple[Array, Array]:
    """Return disturbances with speeds along symmetries that go on steadily, and what their states lack for that.

    Parameters
    ----------
    S : ndarray, shape (…, n, n)
    F : ndarray, shape (…, n, states)
        Disturbances of the states that follow.
    speeds : ndarray, shape (…, n, k)
        Speeds along symmetries, without a displacement.
    along : ndarray, shape (…, n, k)
        The rates of the coordinates that belong to them.

    Returns
    -------
    steady : ndarray, shape (…, n, k)
    lacking : ndarray, shape (…, states, k)
    """
    inverse = _inverse(F)
    A, wanted = inverse @ S @ F, inverse @ (along - S @ speeds)
    behind = _inverse(A) @ wanted
    return speeds + F @ behind, wanted - A @ behind


def _leading(allowed: Array, states: list[int]) -> Array:
    """Return a column that is zero at states that follow and one elsewhere."""
    leading = np.ones((allowed.shape[-2], 1))
    leading[states] = 0.0
    return leading


def _inverse(matrix: Array) -> Array:
    return np.asarray(np.linalg.pinv(matrix, rcond=TOLERANCES.independent_direction))
