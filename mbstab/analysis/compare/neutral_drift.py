"""Neutral directions in the nonlinear motion: a displacement along them stays, or drifts as predicted.

They span the invariant subspace of the zero eigenvalues (in a turning frame also of the pairs ±iΩ), in
which y(t) = exp(A t) y(0) grows as a power of time, or rotates. Each of its directions is excited, and the motion is
compared with this prediction.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from mbstab.analysis.compare.tolerances import TOLERANCES
from mbstab.compiler.system import Array
from mbstab.records import dataclass

AMPLITUDES = "what is seen along them depends on the amplitude"


@dataclass(frozen=True)
class Drift:
    """The nonlinear motion along the neutral directions.

    Attributes
    ----------
    count, staying : int
        Number of the directions, and of those along which a displacement stays constant.
    power : int
        Highest power of time with which the others grow; 0 if all stay, -1 if they rotate with a frame.
    error : float
        Largest difference from the prediction, relative to the largest displacement of the same motion; nan where
        they were not tried.
    span : float (s)
        Length of the motions.
    verdict : str
        ``confirmed``, ``contradicted`` or ``cannot be judged``.
    reason : str
        Why it is not confirmed, or empty.
    """

    count: int
    staying: int
    power: int
    error: float
    span: float
    verdict: str
    reason: str = ""


def flow(matrix: Array, times: Array) -> list[Array]:
    """Return exp(A t) at times, each of shape (n, n)."""
    from scipy.linalg import expm

    return [np.asarray(expm(matrix * t)) for t in times]


def powers(matrix: Array, times: Array) -> list[Array]:
    """Return the powers 0, 1, 2, … of a monodromy matrix, one for every time."""
    return [np.linalg.matrix_power(matrix, k) for k in range(len(times))]


def untried(count: int, reason: str) -> Drift:
    """Return the result without a motion: it cannot be judged."""
    return Drift(count, 0, 0, math.nan, math.nan, "cannot be judged", reason)


def invariant_subspace(matrix: Array, exact: Sequence[complex]) -> Array | None:
    """Return an orthonormal basis of the invariant subspace of given eigenvalues, which are exact but for rounding.

    Parameters
    ----------
    matrix : ndarray, shape (n, n)
    exact : sequence of complex
        Eigenvalues, repeated by multiplicity.

    Returns
    -------
    ndarray, shape (n, len(exact)), or None if they cannot be told from the others.
    """
    from scipy.linalg import schur

    goals = np.array(exact)
    away = np.sort([float(np.min(np.abs(goals - s))) for s in np.linalg.eigvals(matrix)])
    count = len(exact)
    if count == len(matrix):
        return np.eye(count)
    if not away[count - 1] < TOLERANCES.neutral_distance * away[count]:
        return None
    limit = math.sqrt(TOLERANCES.neutral_distance) * away[count]
    _, vectors, found = schur(matrix, sort=lambda real, imag: bool(np.min(np.abs(goals - real - 1j * imag)) <= limit))
    return np.asarray(vectors[:, :count]) if found == count else None


def observed(
    matrix: Array,
    exact: Sequence[complex],
    span: float,
    advance: Callable[[Array, Array], list[Array]],
    seen: Callable[[Array, float, float], tuple[Array, Array] | str],
) -> Drift:
    """Return the behaviour of motions that are displaced along the neutral directions.

    Parameters
    ----------
    matrix : ndarray, shape (n, n)
        Matrix of the linearized equations, with components of equal size.
    exact : sequence of complex
        The neutral eigenvalues of `matrix`.
    span : float
        Length of a motion (s).
    advance : callable
        Maps a matrix of the equations and times since the start to the matrices from y(0) to y(t).
    seen : callable
        Maps y(0), span and amplitude, relative to the usual one, to times and y(t) relative to this amplitude, shape
        (n_t, n); or to the reason why there is none.
    """
    count = len(exact)
    basis = invariant_subspace(matrix, exact)
    if basis is None:
        return untried(count, "neutral eigenvalues cannot be distinguished from slow ones")
    inner = basis.T @ matrix @ basis
    turning = len(set(exact)) > 1
    growing = inner if turning else inner - np.real(exact[0]) * np.eye(count)
    power = -1 if turning else _power(growing, span)
    _, _, directions = np.linalg.svd(growing)
    staying, worst = 0, 0.0
    for start in directions:
        y0 = basis @ start
        differences: list[Array] = []
        for amplitude in (1.0, TOLERANCES.drift_amplitude_reduction):
            found = seen(y0, span, amplitude)
            if isinstance(found, str):
                return untried(count, found)
            times, y = found
            predicted = np.array([basis @ (step @ start) for step in advance(inner, times)])
            size = float(np.max(np.linalg.norm(predicted, axis=1)))
            differences.append((y - predicted) / size)
            error = float(np.max(np.linalg.norm(differences[-1], axis=1)))
            if error <= TOLERANCES.drift_error:
                break
        else:
            moved = float(np.max(np.abs(differences[1] - differences[0])))
            if moved > TOLERANCES.drift_amplitude_reduction * error:
                return Drift(count, staying, power, error, span, "cannot be judged", AMPLITUDES)
            reason = f"a motion displaced along a neutral direction is off by {error:.1e} of its displacement"
            return Drift(count, staying, power, error, span, "contradicted", reason)
        staying += bool(np.max(np.linalg.norm(predicted - predicted[0], axis=1)) <= TOLERANCES.drift_none * size)
        worst = max(worst, error)
    return Drift(count, staying, power, worst, span, "confirmed")


def _power(growing: Array, span: float) -> int:
    """Return the highest power of time in the growth exp(A t) of a nilpotent matrix."""
    power, step = 0, growing * span
    while power < len(growing) and np.linalg.norm(step) > TOLERANCES.drift_none:
        power += 1
        step = step @ growing * span / (power + 1)
    return power
