"""Accelerations and multipliers at thousands of states of one scene, for an integrator.

They solve

    [M  Jᵀ] [a]   [−F0]
    [J  0 ] [ν] = [−B ]

by one LU factorization of the whole: unlike the elimination of a it needs no invertible M,
and it is the cheapest: measured from 5 to 580 unknowns, LAPACK's ``dsysv`` takes 1.2 to 1.9 times as long, and the
elimination of a by Cholesky factors, even with those of a constant M at hand, saves nothing.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property

import numpy as np
from scipy.linalg.lapack import dgesv

from mbstab.analysis.subspaces import Redundancy, coordinate_scale
from mbstab.compiler.fused import Program
from mbstab.compiler.system import Array, System
from mbstab.errors import ConstraintError, MassError

SMALL_PIVOT = 1e-13
"""Below this, relative to the largest pivot, the matrix may be singular and is scaled first."""

SMALL_SINGULAR_VALUE = 1e-11
"""Singular values of the scaled matrix below this, relative to the largest, count as zero."""

UNBALANCED = 1e-6
"""Part of the scaled forces that a solution may leave."""


class Accelerations:
    """The accelerations a (m/s², rad/s²) and multipliers ν of a scene, as a function of the state.

    Parameters
    ----------
    system : System
    redundant : iterable of Redundancy
        Rows that others imply, as `Motion` lists them; they are left out and get the multiplier zero.
        Where dependent rows remain, the multipliers are of least size, and each call takes much longer.
    machine_code : bool
        As in `System.fused`.
    """

    def __init__(self, system: System, redundant: Iterable[Redundancy] = (), machine_code: bool = False) -> None:
        self.system = system
        without = {redundancy.row for redundancy in redundant}
        self.rows = [i for i, row in enumerate(system.rows) if row not in without]
        self._columns = np.array([*range(system.n_q), *(system.n_q + i for i in self.rows)])
        self._all = len(self.rows) == system.n_c
        self._fused = system.fused(machine_code)

    @cached_property
    def _program(self) -> Program:
        return self._fused.augmented(self.rows)

    def __call__(self, q: Array, u: Array, time: float | None = None) -> tuple[Array, Array]:
        """Return a, shape (n_q,), and ν, shape (n_c,), at a state.

        Parameters
        ----------
        q, u : ndarray, shape (n_q,)
            They need not satisfy the constraints.
        time : float, optional
            Time (s); the reference time if not given.

        Raises
        ------
        NumericalError
            If the equations do not exist at this state.
        MassError
            If more than one acceleration satisfies them.
        ConstraintError
            If none does.
        """
        n, vector, program = self.system.n_q, self._fused.vector, self._program
        t = float(self.system.scene.time if time is None else time)
        try:
            matrix, right = program(vector(q), vector(u), t)
        except (ArithmeticError, ValueError):
            return self._carefully(q, u, time)
        # The matrix is symmetric: its transpose is what LAPACK calls in order, and may be overwritten.
        factors, _, x, failed = dgesv(matrix.T, right, 1, 1)
        pivots = [abs(pivot) for pivot in factors.diagonal().tolist()]
        if failed or not min(pivots) > SMALL_PIVOT * max(pivots):
            return self._carefully(q, u, time)
        if self._all:
            return x[:n], x[n:]
        full = np.zeros(n + self.system.n_c)
        full[self._columns] = x
        return full[:n], full[n:]

    def _carefully(self, q: Array, u: Array, time: float | None) -> tuple[Array, Array]:
        """Return the solution of least size of the scaled equations."""
        state, n = self.system.dynamics(q, u, time), self.system.n_q
        scale = coordinate_scale(state.M, np.ones(n))
        J = state.J[self.rows] * scale
        lengths = np.linalg.norm(J, axis=1)
        rows = 1.0 / np.where(lengths > 0.0, lengths, 1.0)
        J = J * rows[:, None]
        M = state.M * scale * scale[:, None]
        count = len(rows)
        left = np.block([[M, J.T], [J, np.zeros((count, count))]])
        right = -np.concatenate((state.F0 * scale, state.B[self.rows] * rows))
        values, vectors = np.linalg.eigh(left)
        large = np.abs(values) > SMALL_SINGULAR_VALUE * np.max(np.abs(values), initial=0.0)
        x = vectors[:, large] @ ((vectors[:, large].T @ right) / values[large])
        if np.max(np.abs(vectors[:n, ~large]), initial=0.0) > UNBALANCED:
            raise MassError(
                "the accelerations are not determined: a motion that the constraints allow carries no mass\n"
                "hint: give it a mass or an inertia, or model it without coordinates of its own"
            )
        if np.linalg.norm(left @ x - right) > UNBALANCED * np.linalg.norm(right):
            raise ConstraintError(
                "no accelerations satisfy the constraints here\n"
                "hint: constraints that depend on each other contradict each other, or the configuration is singular"
            )
        nu = np.zeros(self.system.n_c)
        nu[self.rows] = x[n:] * rows
        return x[:n] * scale, nu
