"""A periodic motion and its neighbours in scaled units: their state, and the equations at an instant."""

from __future__ import annotations

import numpy as np

from mbstab.analysis.algebra.augmented import of_rank
from mbstab.analysis.reference.motion import Motion
from mbstab.analysis.spectrum.time_features import short_steps, variation
from mbstab.analysis.spectrum.tolerances import TOLERANCES
from mbstab.analysis.verdict.written import with_features
from mbstab.compiler.form import Form
from mbstab.compiler.system import Array, System
from mbstab.errors import ConstraintError, amount


class Flow:
    """The motion and its neighbours in scaled units.

    A state has the shape (2, n_q, 1 + n_f): positions, and speeds times the period; first the motion, relative to the
    sizes in the scene, then its neighbours in the scaled coordinates of `Subspaces`. So everything is of order 1.
    """

    def __init__(self, system: System, motion: Motion, period: float) -> None:
        spaces = motion.spaces
        self.system, self.motion, self.period = system, motion, period
        self.form, self.variation = Form(system), variation(system, motion.time, period)
        self.scale, self.row_scale, self.sizes = spaces.scale, spaces.row_scale, motion.sizes
        self.rank = spaces.C.rank + spaces.W.rank
        N, NZ = spaces.N, spaces.N @ spaces.Z
        self.least = 0.0
        own = np.stack([motion.q / self.sizes, motion.u * period / self.sizes])
        start = self.at(own, 0.0)
        self.least = TOLERANCES.constraints_singular * start.singular
        follow = start.follow @ N
        self.basis = np.stack([np.hstack([N, 0.0 * NZ]), np.hstack([follow, NZ])])
        self.dual = np.stack([np.vstack([N.T, -NZ.T @ follow @ N.T]), np.vstack([0.0 * N.T, NZ.T])])
        self.begin = np.concatenate([own[:, :, None], self.basis], axis=2)

    def looked_along(self, parts: Array, states: Array, longest: float) -> bool:
        """Take in functions of the motion as it was followed; return whether steps must be shorter for them."""
        if not with_features(self.system):
            return False
        from scipy.interpolate import CubicHermiteSpline

        q = CubicHermiteSpline(parts, states[:, 0, :, 0] * self.sizes, states[:, 1, :, 0] * self.sizes)
        self.variation = variation(
            self.system, self.motion.time, self.period, lambda part: (q(part), q(part, 1) / self.period)
        )
        return bool(len(short_steps(*self.variation, longest)))

    def at(self, own: Array, part: float) -> Instant:
        """Return the equations at a state of the motion, shape (2, n_q), at the time `part` · T."""
        return Instant(self, own[0] * self.sizes, own[1] * self.sizes / self.period, part)

    def slope(self, part: float, x: Array) -> Array:
        """Return the derivative of a state by t/T."""
        now = self.at(x[:, :, 0], part)
        dq, du = x[:, :, 1:]
        slope = np.empty_like(x)
        slope[0] = x[1]
        slope[1, :, 0] = now.a * self.period**2 / self.sizes
        slope[1, :, 1:] = now.neighbours(dq, du)[0]
        return slope

    def components(self, x: Array) -> tuple[Array, float]:
        """Return the neighbours in the basis, and the size of their part outside of it."""
        y = self.dual[0] @ x[0, :, 1:] + self.dual[1] @ x[1, :, 1:]
        rest = x[:, :, 1:] - self.basis @ y
        return y, norm(np.vstack([rest[0], rest[1]]))


class Instant:
    """The equations of motion and those of the neighbours, in scaled coordinates and with the period as unit of time.

    Attributes
    ----------
    part : float
        t/T.
    state : Dynamics
    a : ndarray, shape (n_q,)
        Accelerations (m/s², rad/s²).
    nu : ndarray, shape (n_c,)
        Multipliers.
    J, M, R, K, A_q, A_u : ndarray
    augmented : Augmented
        Of M and J.
    follow : ndarray, shape (n_q, n_q)
        −J⁺ V_q: the speeds that follow from the positions where rows move.
    singular : float
        Least singular value of J, apart from those of redundant rows.
    """

    def __init__(self, flow: Flow, q: Array, u: Array, part: float) -> None:
        form, scale, period = flow.form, flow.scale, flow.period
        time = flow.motion.time + part * period
        weights, rows = scale * scale[:, None], scale * flow.row_scale[:, None]
        self.state = form.dynamics(q, u, time)
        self.J, self.M = self.state.J * rows, self.state.M * weights
        # The rank is that at the start: off the constraints, where an integrator evaluates too, redundant rows are
        # slightly independent.
        self.augmented, self.singular = of_rank(self.M, self.J, flow.rank)
        if self.singular < flow.least:
            raise ConstraintError(
                f"the constraints lose rank: a singular value falls to {amount(self.singular)}\n"
                "hint: the motion passes a singular configuration of the mechanism, from which it may go on in "
                "different ways"
            )
        a, nu = self.augmented.solve(-self.state.F0 * scale, self.state.B * flow.row_scale)
        self.part, self.a, self.nu = part, a * scale, nu * flow.row_scale
        K, R, _ = form.linearize(q, u, self.a, self.nu, time)
        V_q, A_q, A_u = form.linearize_rows(q, u, self.a, time)
        self.R, self.K = R * weights * period, K * weights * period**2
        self.A_u, self.A_q = A_u * rows * period, A_q * rows * period**2
        self.follow = -self.augmented.inverse @ (V_q * rows * period)

    def neighbours(self, dq: Array, du: Array) -> tuple[Array, Array]:
        """Return the accelerations and multipliers of neighbours from their positions and speeds, as columns."""
        found: tuple[Array, Array] = self.augmented.solve(-(self.R @ du + self.K @ dq), self.A_u @ du + self.A_q @ dq)
        return found


def norm(matrix: Array) -> float:
    """Return the spectral norm of a matrix, 0 of an empty one."""
    return float(np.linalg.norm(matrix, 2)) if matrix.size else 0.0
