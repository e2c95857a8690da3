"""Eigenvalues of a matrix that moves, singly where they are simple and as sums over groups where they are not.

Where eigenvalues meet or are equal, each of them may have no derivative; the mean of a group and the mean square of the
distances from it have, as long as the group stays apart from the others (Kato 1966, Perturbation Theory, II.2). With
bases X and Y of its invariant subspaces, Yᴴ X = 1, they are sums over the block Yᴴ A X, which moves with Yᴴ (dA) X.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mbstab.analysis.algebra.arrays import Complex
from mbstab.analysis.algebra.matching import together
from mbstab.analysis.design.tolerances import TOLERANCES
from mbstab.compiler.system import Array


class Moving:
    """A real matrix that moves with parameters.

    Parameters
    ----------
    A : ndarray, shape (r, r)
    slopes : ndarray, shape (parameters, r, r)
        ∂A/∂p.

    Attributes
    ----------
    values : ndarray of complex, shape (r,)
        Its eigenvalues (1/s).
    upper : list of list of int
        Groups of equal eigenvalues with Im >= 0.
    """

    def __init__(self, A: Array, slopes: Array) -> None:
        from scipy.linalg import schur

        self.A, self.slopes = A, slopes
        self._T, self._Q = schur(A, output="complex")
        self.values: Complex = np.diag(self._T).copy()
        self._size = float(np.max(np.abs(self.values), initial=0.0))
        self.upper = self._groups()

    def at(self, shift: Array) -> Moving:
        """Return the matrix where the parameters differ by a shift, to first order."""
        return Moving(self.A + np.tensordot(shift, self.slopes, 1), self.slopes)

    def _groups(self) -> list[list[int]]:
        equal = TOLERANCES.equal * self._size
        upper = np.flatnonzero(self.values.imag >= -equal)
        near = np.abs(self.values[upper][:, None] - self.values[upper]) <= equal
        return [upper[group].tolist() for group in together(near)]

    def nearest(self, group: Sequence[int]) -> list[int]:
        """Return a group of equal eigenvalues with those next to it, if these are near enough to meet it."""
        centre = complex(np.mean(self.values[group]))
        others = [j for j in range(len(self.values)) if j not in group]
        if not others:
            return list(group)
        gaps = np.abs(self.values[others] - centre)
        next_ = complex(self.values[others[int(np.argmin(gaps))]])
        if abs(next_ - centre) > TOLERANCES.near_partner * max(abs(centre), abs(next_)):
            return list(group)
        reach = float(np.min(gaps)) + TOLERANCES.equal * self._size
        return [*group, *(j for j, gap in zip(others, gaps.tolist(), strict=True) if gap <= reach)]

    def sums(self, group: Sequence[int]) -> tuple[complex, Complex, complex, Complex]:
        """Return the mean of a group, the mean square of the distances from it (1/s²), each followed by its slopes."""
        from scipy.linalg.lapack import ztrsen, ztrsyl

        m = len(group)
        chosen = np.zeros(len(self.values), dtype=np.int32)
        chosen[list(group)] = 1
        T, Q, *_ = ztrsen(chosen, self._T, self._Q, job=b"N")
        left = Q[:, :m].conj().T
        if m < len(T):
            # [1 R; 0 0] commutes with T.
            R, scale, _ = ztrsyl(T[:m, :m], T[m:, m:], T[:m, m:], isgn=-1)
            left = left + R / scale @ Q[:, m:].conj().T
        moved = left @ self.slopes @ Q[:, :m]
        mean = complex(np.trace(T[:m, :m])) / m
        apart = T[:m, :m] - mean * np.eye(m)
        return (
            mean,
            np.trace(moved, axis1=1, axis2=2) / m,
            complex(np.trace(apart @ apart)) / m,
            2.0 * np.einsum("ij,pji->p", apart, moved) / m,
        )
