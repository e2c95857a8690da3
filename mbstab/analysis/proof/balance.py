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

    def generator(self, q: Sequence[Ball], c: Sequence[Ball] | None = None) -> BallGenerator:
        """Return the field of the steady motion for coefficients that are not given."""

    def free_rates(self) -> list[float]:
        """Return these coefficients in double precision."""

    def dynamics(
        self, q: Sequence[Ball], u: Sequence[Ball]
    ) -> tuple[Matrix, list[Ball], list[Ball], list[Ball], Matrix]:
        """Return M, F0, E, V and J of the chosen rows."""

    def all_multipliers(self, nu: Sequence[Ball]) -> list[Ball]:
        """Return the multipliers of all rows."""


def forces(M: Matrix, a: Sequence[Ball], F0: Sequence[Ball], J: Matrix, nu: Sequence[Ball]) -> list[Ball]:
    """Return M a + F0 + Jᵀν."""
    through = ball_matrices.apply(ball_matrices.transposed(J, len(F0)), nu)
    return [sum(terms, ball(0)) for terms in zip(ball_matrices.apply(M, a), F0, through, strict=True)]


class Equations:
    """The equations F = 0, E = 0 of an equilibrium, and V = 0 of a steady motion or with states, in balls.

    The unknowns are the coordinates that are not given, the coefficients of the steady motion that
    are not given, and the multipliers of the chosen rows.

    Parameters
    ----------
    known : Known
    q : list of ball
        Coordinates; only those that are given are used.
    hold : bool
        Whether all of them are given.
    """

    def __init__(self, known: Known, q: list[Ball], hold: bool) -> None:
        self.known, self.system, self.q = known, known.system, q
        scene, names = known.system.scene, known.system.names
        self.open = [i for i, name in enumerate(names) if not hold and name not in scene.coordinates]
        self.free = known.free_rates()
        self.given = {i: ball(scene.rates[name]) for i, name in enumerate(names) if name in scene.rates}
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

    def start(self) -> list[Ball]:
        """Return the unknowns as found in double precision."""
        found = [*self.free, *(float(x) for x in self.multipliers)]
        return [*(self.q[i] for i in self.open), *(ball(x) for x in found)]

    def unknowns(self) -> list[str]:
        """Return the names of the unknowns."""
        return [
            *(self.system.names[i] for i in self.open),
            *(f"free rate {k}" for k in range(len(self.free))),
            *(f"multiplier of row {i}" for i in self.known.rows),
        ]

    def _split(self, x: Sequence[Ball]) -> tuple[list[Ball], list[Ball], list[Ball]]:
        """Return coordinates, coefficients and multipliers."""
        moved, n, k = self.q[:], len(self.open), len(self.free)
        for i, value in zip(self.open, x, strict=False):
            moved[i] = value
        return moved, list(x[n : n + k]), list(x[n + k :])

    def state(self, x: Sequence[Ball]) -> State:
        """Return the motion for given unknowns."""
        q, c, nu = self._split(x)
        return steady_state(self.known.generator(q, c), q, nu)

    def residual(self, x: Sequence[Ball]) -> list[Ball]:
        """Return the residuals of forces, positions, speeds and given rates, in this order."""
        at = self.state(x)
        M, F0, E, V, J = self.known.dynamics(at.q, at.u)
        left = [*forces(M, at.a, F0, J, at.nu), *E[: self.known.r_h]]
        if self.moving:
            left += [*V, *(at.u[i] - rate for i, rate in self.given.items())]
        return left

    def jacobian(self, x: Sequence[Ball]) -> Matrix:
        """Return the derivative of the residual."""
        at, system = self.state(x), self.system
        M, _, _, _, J = self.known.dynamics(at.q, at.u)
        full = self.known.all_multipliers(at.nu)
        K, R = (ball_matrices.matrix(x) for x in system.linearize(at.q, at.u, at.a, full, self.known.time)[:2])
        J_moving, V_q = (J, self._speeds_by_coordinates(at)) if self.moving else ([], [])
        _, stiffness, turned = in_frame(M, R, K, J_moving, V_q, at.slope, at.second, ball_matrices.BALLS)
        columns, growths = self._by_coefficients(at)
        by_c = [
            [x + y for x, y in zip(ball_matrices.apply(R, X), ball_matrices.apply(M, A), strict=True)]
            for X, A in zip(columns, growths, strict=True)
        ]
        n_c, r = len(columns), len(self.known.rows)
        blank = [ball(0)] * r
        result = [
            [*(stiffness[i][j] for j in self.open), *(by_c[k][i] for k in range(n_c)), *(J[k][i] for k in range(r))]
            for i in range(system.n_q)
        ]
        result += [[*(J[k][j] for j in self.open), *([ball(0)] * n_c), *blank] for k in range(self.known.r_h)]
        if self.moving:
            by_rate = [ball_matrices.apply(J, X) for X in columns]
            result += [
                [*(turned[k][j] for j in self.open), *(by_rate[c][k] for c in range(n_c)), *blank] for k in range(r)
            ]
            result += [
                [*(at.slope[i][j] for j in self.open), *(columns[c][i] for c in range(n_c)), *blank] for i in self.given
            ]
        return result

    def _speeds_by_coordinates(self, at: State) -> Matrix:
        full = ball_matrices.matrix(self.system.linearize_rows(at.q, at.u, at.a, self.known.time)[0])
        return [full[i] for i in self.known.rows]

    def _by_coefficients(self, at: State) -> tuple[Matrix, Matrix]:
        """Return the derivatives of X and of DX X by the free coefficients: X is linear in them."""
        columns, growths = [], []
        none = steady_state(self.known.generator(at.q, [ball(0)] * len(self.free)), at.q)
        for k in range(len(self.free)):
            unit = [ball(float(j == k)) for j in range(len(self.free))]
            one = steady_state(self.known.generator(at.q, unit), at.q)
            X = [x - y for x, y in zip(one.u, none.u, strict=True)]
            D = [[x - y for x, y in zip(*rows, strict=True)] for rows in zip(one.slope, none.slope, strict=True)]
            through, own = ball_matrices.apply(at.slope, X), ball_matrices.apply(D, at.u)
            columns.append(X)
            growths.append([x + y for x, y in zip(through, own, strict=True)])
        return columns, growths

    def independent(self, start: Sequence[Ball], what: str) -> list[int]:
        """Return the numbers of equations that determine the unknowns.

        Raises
        ------
        NotProvable
            If there are fewer than unknowns.
        """
        nu, n = self.multipliers, len(start)
        G = np.array([[float(x.mid()) for x in row] for row in self.jacobian([x.mid() for x in start])])
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
