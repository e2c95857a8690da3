"""Directions without mass at many points of a sweep at once, as `mbstab.analysis.linear.massless`."""

from __future__ import annotations

import numpy as np

from mbstab.analysis.algebra.arrays import Flags
from mbstab.analysis.algebra.tolerances import TOLERANCES as ALGEBRA
from mbstab.analysis.linear.linearize import Linearization
from mbstab.analysis.linear.massless import Massless
from mbstab.analysis.reference.tolerances import TOLERANCES as REFERENCE
from mbstab.compiler.system import Array


class Light:
    """The coordinates without mass of a pattern, each by itself, and the rows of their balance.

    Parameters
    ----------
    linear : Linearization
    light : Massless
        Whose directions are single coordinates.
    """

    def __init__(self, linear: Linearization, light: Massless) -> None:
        self.n_h = light.n_h
        self.algebraic, self.first = (np.argmax(x, axis=1) for x in (light.algebraic, light.first_order))
        self.columns = np.concatenate([self.algebraic, self.first])
        n = light.n_h + len(self.algebraic)
        own = [*range(light.n_h, n), *range(n + light.n_n, len(linear.J))]
        terms, rows = (x[own] * light.spaces.scale for x in (linear.entries.J, linear.J))
        self.cancelling = float(np.max(np.linalg.norm(terms, axis=1) / np.linalg.norm(rows, axis=1)))
        """Ratio of the terms of the rows of balance to their sums at the point."""

    def found(self, M: Array, R: Array, J: Array) -> Flags:
        """Return where the same coordinates carry no mass, no constraint holds them and the same ones are damped."""
        held = np.any(M[:, self.columns], axis=(-2, -1)) | np.any(J[..., self.columns], axis=(-2, -1))
        result: Flags = ~(held | np.any(R[:, self.algebraic], axis=(-2, -1)))
        return result

    def extended(self, R: Array, K: Array, J: Array, D_q: Array) -> tuple[Array, Array, Flags]:
        """Return J and D_q with the rows of balance, all of unit length in J, and where these determine the motion."""
        points = max(len(x) for x in (R, K, J, D_q))
        R, K, J, D_q = (np.broadcast_to(x, (points, *x.shape[1:])) for x in (R, K, J, D_q))
        rows = [K[:, self.algebraic], R[:, self.first]]
        lengths = [np.linalg.norm(x, axis=-1, keepdims=True) for x in rows]
        known = np.all(lengths[0] > 0.0, axis=(-2, -1)) & np.all(lengths[1] > 0.0, axis=(-2, -1))
        units = [1.0 / np.where(x > 0.0, x, 1.0) for x in lengths]
        algebraic, first = (x * unit for x, unit in zip(rows, units, strict=True))
        own = np.concatenate([algebraic, first], axis=1)[..., self.columns]
        known &= np.linalg.svd(own, compute_uv=False)[:, -1] >= ALGEBRA.singular_value_kept
        D_q = np.concatenate([D_q, K[:, self.first] * units[1]], axis=1)
        return np.concatenate([J[:, : self.n_h], algebraic, J[:, self.n_h :], first], axis=1), D_q, known

    def carried(self, M_z: Array) -> Flags:
        """Return where all motions that are left carry mass."""
        values = np.linalg.eigvalsh(M_z)
        if not values.shape[-1]:
            return np.ones(len(values), dtype=bool)
        result: Flags = values[:, 0] > REFERENCE.massless * values[:, -1]
        return result
