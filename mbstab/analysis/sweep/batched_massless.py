"""Directions without mass at many points of a sweep at once, as `mbstab.analysis.linear.massless`."""

from __future__ import annotations

import numpy as np

from mbstab.analysis.algebra.arrays import Flags
from mbstab.analysis.algebra.stacks import transposed
from mbstab.analysis.algebra.tolerances import EPS
from mbstab.analysis.algebra.tolerances import TOLERANCES as ALGEBRA
from mbstab.analysis.linear.linearize import Linearization
from mbstab.analysis.linear.massless import Massless
from mbstab.analysis.linear.tolerances import TOLERANCES as LINEAR
from mbstab.analysis.reference.tolerances import TOLERANCES as REFERENCE
from mbstab.compiler.system import Array


class Light:
    """The directions without mass of a pattern, and the rows of their balance.

    At each point they are those of the pattern, moved into the motions that carry no mass there.

    Parameters
    ----------
    linear : Linearization
    light : Massless
    """

    def __init__(self, linear: Linearization, light: Massless) -> None:
        self.n_h, self.exact = light.n_h, light.exact
        directions = np.vstack([light.algebraic, light.first_order]) / light.spaces.scale
        self.units = directions / np.linalg.norm(directions, axis=1, keepdims=True)
        self.count, self.algebraic = len(self.units), len(light.algebraic)
        n = light.n_h + self.algebraic
        own = [*range(light.n_h, n), *range(n + light.n_n, len(linear.J))]
        terms, rows = (x[own] * light.spaces.scale for x in (linear.entries.J, linear.J))
        self.cancelling = float(np.max(np.linalg.norm(terms, axis=1) / np.linalg.norm(rows, axis=1)))
        """Ratio of the terms of the rows of balance to their sums at the point, with the rounding of directions."""
        self.cancelling *= 1.0 if self.exact else max(1.0, light.accuracy / EPS)

    def found(self, M: Array, allowed: Array) -> tuple[Array, Flags]:
        """Return bases of the motions without mass, shape (…, n_q, k), and where there are as many as in the pattern.

        Parameters
        ----------
        M : ndarray, shape (…, n_q, n_q)
        allowed : ndarray, shape (…, n_q, n_f)
            Bases of the motions that the constraints allow.
        """
        if self.exact:
            # The same coordinates carry no mass, and no constraint holds them.
            columns = self.units.T[None]
            outside = columns - allowed @ (transposed(allowed) @ columns)
            free = np.max(np.abs(outside), axis=(-2, -1)) <= ALGEBRA.singular_value_zero
            return columns, free & ~np.any(M @ columns, axis=(-2, -1))
        values, vectors = np.linalg.eigh(transposed(allowed) @ M @ allowed)
        least = np.maximum(REFERENCE.massless * values[:, -1], REFERENCE.rounding_of_mass)
        heavy = values > least[:, None]
        good: Flags = np.sum(~heavy, axis=1) == self.count
        good &= np.min(values, axis=1, initial=np.inf, where=heavy) > ALGEBRA.rank_gap * least
        return allowed @ vectors[:, :, : self.count], good

    def extended(self, basis: Array, R: Array, K: Array, J: Array, D_q: Array) -> tuple[Array, Array, Flags]:
        """Return J and D_q with the rows of balance, all of unit length in J, and where these determine the motion."""
        points = max(len(x) for x in (basis, R, K, J, D_q))
        basis, R, K, J, D_q = (np.broadcast_to(x, (points, *x.shape[1:])) for x in (basis, R, K, J, D_q))
        directions = self.units @ basis @ transposed(basis)
        algebraic, first = directions[:, : self.algebraic], directions[:, self.algebraic :]
        damping = [x @ R @ basis for x in (algebraic, first)]
        algebraic = algebraic - damping[0] @ np.linalg.pinv(damping[1]) @ first
        # Nothing damps what is left.
        sizes = np.abs(algebraic) @ np.abs(R)
        known = np.all(np.abs(algebraic @ R) <= LINEAR.balance_zero * np.max(sizes, initial=0.0), axis=(-2, -1))
        rows = [algebraic @ K, first @ R]
        lengths = [np.linalg.norm(x, axis=-1, keepdims=True) for x in rows]
        known &= np.all(lengths[0] > 0.0, axis=(-2, -1)) & np.all(lengths[1] > 0.0, axis=(-2, -1))
        units = [1.0 / np.where(x > 0.0, x, 1.0) for x in lengths]
        algebraic, damped = (x * unit for x, unit in zip(rows, units, strict=True))
        own = np.concatenate([algebraic, damped], axis=1) @ basis
        known &= np.linalg.svd(own, compute_uv=False)[:, -1] >= ALGEBRA.singular_value_kept
        D_q = np.concatenate([D_q, first @ K * units[1]], axis=1)
        return np.concatenate([J[:, : self.n_h], algebraic, J[:, self.n_h :], damped], axis=1), D_q, known

    def carried(self, M_z: Array) -> Flags:
        """Return where all motions that are left carry mass."""
        values = np.linalg.eigvalsh(M_z)
        if not values.shape[-1]:
            return np.ones(len(values), dtype=bool)
        result: Flags = values[:, 0] > REFERENCE.massless * values[:, -1]
        return result
