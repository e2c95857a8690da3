"""The equations of equilibria and steady motions in balls, and their derivatives."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Protocol

import numpy as np

from mbstab.analysis.algebra import ball_matrices
from mbstab.analysis.algebra.augmented import least_multipliers
from mbstab.analysis.algebra.balls import Matrix, NotProvable
from mbstab.analysis.algebra.deflation import in_frame
from mbstab.analysis.proof.krawczyk import independent_rows
from mbstab.analysis.proof.motion import BallGenerator, Rough, State, steady_state
from mbstab.compiler.system import Array, System
from mbstab.model.balls import Ball, ball


class Known(Protocol):
    """What the equations need from a scene in balls (`mbstab.analysis.proof.enclosures.Reference`)."""

    system: System
    rough: Rough
    rows: list[int]
    r_h: int
    time: Ball
    left_out: list[int]

    def generator(self, q: Matrix, c: Sequence[Ball] | None = None) -> BallGenerator:
        """Return the field of the steady motion for coefficients that are not given."""

    def free_rates(self) -> list[float]:
        """Return these coefficients in double precision."""

    def dynamics(self, q: Matrix, u: Matrix) -> tuple[Matrix, Matrix, Matrix, Matrix, Matrix]:
        """Return M, F0, E, V and J of the chosen rows."""

    def all_multipliers(self, nu: Matrix) -> Matrix:
        """Return the multipliers of all rows."""


def forces(M: Matrix, a: Matrix, F0: Matrix, J: Matrix, nu: Matrix) -> Matrix:
    """Return M a + F0 + Jᵀν."""
    return ball_matrices.times(M, a) + F0 + ball_matrices.times(J.T, nu)  # type: ignore[no-any-return]


class Equations:
    """The equations F = 0, E = 0 of an equilibrium, and V = 0 of a steady motion or with states, in balls.

    The unknowns are the coordinates that are not given, the coefficients of the steady motion that
    are not given, and the multipliers of the chosen rows.

    Parameters
    ----------
    known : Known
    q : array of balls
        Coordinates; only those that are given are used.
    hold : bool
        Whether all of them are given.
    """

    def __init__(self, known: Known, q: Matrix, hold: bool) -> None:
        self.known, self.system, self.q = known, known.system, q
        scene, names = known.system.scene, known.system.names
        self.open = [i for i, name in enumerate(names) if not hold and name not in scene.coordinates]
        self.free = known.free_rates()
        self.given = [i for i, name in enumerate(names) if name in scene.rates]
        self.rates = ball_matrices.matrix([scene.rates[names[i]] for i in self.given])
        self.moving = scene.steady is not None or bool(scene.model.states)  # which must come to rest

    @cached_property
    def multipliers(self) -> Array:
        """Multipliers of the chosen rows in double precision."""
        motion = self.known.rough.motion
        if not self.known.left_out:
            result: Array = motion.nu[self.known.rows]
            return result
        force = (motion.dynamics.F0 + motion.dynamics.M @ motion.a) * motion.spaces.scale
        return -least_multipliers(motion.dynamics.J[self.known.rows] * motion.spaces.scale, force)

    def start(self) -> Matrix:
        """Return the unknowns as found in double precision."""
        return ball_matrices.matrix([*self.q[self.open], *self.free, *self.multipliers.tolist()])

    def unknowns(self) -> list[str]:
        """Return the names of the unknowns."""
        return [
            *(self.system.names[i] for i in self.open),
            *(f"free rate {k}" for k in range(len(self.free))),
            *(f"multiplier of row {i}" for i in self.known.rows),
        ]

    def state(self, x: Matrix) -> State:
        """Return the motion for given unknowns."""
        q, n, k = self.q.copy(), len(self.open), len(self.free)
        q[self.open] = x[:n]
        return steady_state(self.known.generator(q, x[n : n + k].tolist()), q, x[n + k :])

    def residual(self, x: Matrix) -> Matrix:
        """Return the residuals of forces, positions, speeds and given rates, in this order."""
        at = self.state(x)
        M, F0, E, V, J = self.known.dynamics(at.q, at.u)
        parts = [forces(M, at.a, F0, J, at.nu), E[: self.known.r_h]]
        return np.concatenate([*parts, V, at.u[self.given] - self.rates] if self.moving else parts)

    def jacobian(self, x: Matrix) -> Matrix:
        """Return the derivative of the residual."""
        at, system = self.state(x), self.system
        M, _, _, _, J = self.known.dynamics(at.q, at.u)
        full = self.known.all_multipliers(at.nu)
        K, R = (ball_matrices.matrix(x) for x in system.linearize(at.q, at.u, at.a, full, self.known.time)[:2])
        rows, r_h = self.known.rows, self.known.r_h
        V_q = J[:0]
        if self.moving:
            V_q = ball_matrices.matrix(system.linearize_rows(at.q, at.u, at.a, self.known.time)[0])[rows]
        _, stiffness, turned = in_frame(M, R, K, J[: len(V_q)], V_q, at.slope, at.second, ball_matrices.BALLS)
        columns, growths = self._by_coefficients(at)
        by_c = ball_matrices.times(R, columns) + ball_matrices.times(M, growths)
        zeros, n_c, r = ball_matrices.zeros, columns.shape[1], len(rows)
        blocks = [[stiffness[:, self.open], by_c, J.T], [J[:r_h, self.open], zeros(r_h, n_c), zeros(r_h, r)]]
        if self.moving:
            blocks += [[turned[:, self.open], ball_matrices.times(J, columns), zeros(r, r)]]
            given = self.given
            blocks += [[at.slope[np.ix_(given, self.open)], columns[given], zeros(len(given), r)]]
        return np.vstack([np.hstack(row) for row in blocks])

    def _by_coefficients(self, at: State) -> tuple[Matrix, Matrix]:
        """Return the derivatives of X and of DX X by the free coefficients, as columns: X is linear in them."""
        k, times = len(self.free), ball_matrices.times
        trials = ([ball(float(j == i)) for j in range(k)] for i in range(-1, k))
        none, *units = (steady_state(self.known.generator(at.q, c), at.q) for c in trials)
        columns, growths = ball_matrices.zeros(k, len(at.q)), ball_matrices.zeros(k, len(at.q))
        for i, one in enumerate(units):
            columns[i] = one.u - none.u
            growths[i] = times(at.slope, columns[i]) + times(one.slope - none.slope, at.u)
        return columns.T, growths.T

    def independent(self, start: Matrix, what: str) -> list[int]:
        """Return the numbers of equations that determine the unknowns.

        Raises
        ------
        NotProvable
            If there are fewer than unknowns.
        """
        nu, n = self.multipliers, len(start)
        G = self.jacobian(np.array([x.mid() for x in start], dtype=object)).astype(float)
        sizes = self.known.rough.motion.sizes[self.open]
        loads = 1e-300 + np.max(np.abs(nu), initial=1.0) + 0.0 * nu
        weights = np.array([*sizes, *([1.0] * len(self.free)), *loads])
        lengths = np.linalg.norm(G * weights, axis=1)
        scaled = G * weights / np.where(lengths > 1e-9 * np.max(lengths, initial=1e-300), lengths, np.inf)[:, None]
        rank = int(np.linalg.matrix_rank(scaled, tol=1e-9)) if n else 0
        if rank < n:
            raise NotProvable(
                f"{what} is not isolated ({n - rank} directions are open): "
                "its existence is not proven; give what symmetries leave open under reference.coordinates"
            )
        return independent_rows(scaled, n)
