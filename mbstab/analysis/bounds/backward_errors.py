"""Residuals of approximate eigenvectors in the linearized equations, and the effect of errors in these equations."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from mbstab.analysis.algebra.arrays import Complex, at_block, least_squares
from mbstab.analysis.algebra.tolerances import EPS
from mbstab.analysis.algebra.tolerances import TOLERANCES as ALGEBRA
from mbstab.analysis.bounds.tolerances import TOLERANCES
from mbstab.analysis.linear.linearize import Linearization, StateSpace, composite
from mbstab.analysis.linear.roundings import roundings
from mbstab.analysis.linear.tolerances import TOLERANCES as LINEAR
from mbstab.analysis.reference.coefficients import Matrices
from mbstab.compiler.system import Array

if TYPE_CHECKING:
    import numpy.typing as npt

    from mbstab.analysis.algebra.refinement import Quadratic


class BackwardErrors:
    """Residuals of approximate eigenvalues and vectors in the linearized equations."""

    def __init__(
        self, linear: Linearization, space: StateSpace, gamma: float, S: Array, T: Array, L: Array, fitted: float = 0.0
    ) -> None:
        self.fitted = fitted
        self.linear, self.space, self.gamma, self.S, self.T, self.L = linear, space, gamma, S, T, L
        self.n_h, self.n_xi, n = linear.n_h, space.n_xi, len(S)
        known = np.hstack([T, L.T])
        self.B = np.linalg.qr(known, mode="complete")[0][:, known.shape[1] :] if known.shape[1] else np.eye(n)
        self.A = self.B.T @ S @ self.B if known.shape[1] else S
        self.inside, self.outside = T.T @ S, S @ L.T
        spaces = linear.spaces
        scale, rows = spaces.scale, spaces.row_scale
        self.P, self.M_z = space.A[: self.n_xi, : self.n_xi], space.M_z
        self.lift_C, self.lift_W = spaces.C.pseudo_inverse, spaces.W.pseudo_inverse
        self.factors = Matrices(
            scale * scale[:, None], scale * scale[:, None], scale * scale[:, None], rows[:, None] * scale,
            rows[self.n_h :, None] * scale,
        )  # fmt: skip
        self.m = self.scaled(Matrices(linear.M, linear.R, linear.K, linear.J, linear.D_q))
        # Where a light body is constrained, rounding of zeros in the bases would cause a large force.
        C, D_u = self.m.J[: self.n_h], self.m.J[self.n_h :]
        self.N = spaces.N - self.lift_C @ (C @ spaces.N)
        W = D_u @ self.N
        self.Z = spaces.Z
        if np.max(np.abs(W @ self.lift_W - np.eye(len(W))), initial=0.0) > TOLERANCES.inverse_refined:
            # One step of Newton and Schulz: where rows on speeds are badly conditioned, few digits are right.
            self.lift_W = 2.0 * self.lift_W - self.lift_W @ (W @ self.lift_W)
            self.Z = self.Z - self.lift_W @ (W @ self.Z)
        self.off_W = np.abs(W @ self.lift_W - np.eye(len(W)))
        self.off_W += LINEAR.roundings_of_sum * EPS * (np.abs(W) @ np.abs(self.lift_W))
        self.Z = self.Z - self.lift_W @ (W @ self.Z)
        if len(W):
            # With the directions as they are now: their rounding is magnified in a small mass.
            free = self.N @ self.Z
            self.M_z = free.T @ (self.m.M @ free)
            self.P = -self.lift_W @ (self.m.D_q @ self.N)
        self.inner = self._inner()

    def _inner(self) -> Array:
        """Return C with S T = T C; what is no more than rounding is zero where stiff rows magnify the rounding."""
        inner: Array = self.inside @ self.T
        if not len(self.off_W):
            return inner
        T = np.abs(self.T)
        above = T[: self.n_xi]
        usual = T.T @ np.abs(self.S) @ T
        rows = above.T @ (np.abs(self.lift_W) @ (np.abs(self.m.D_q) @ (np.abs(self.N) @ above)))
        noise = LINEAR.roundings_of_sum * EPS * (usual + rows)
        magnified = rows > TOLERANCES.magnified_rounding * usual
        return np.where(magnified & (np.abs(inner) <= noise), 0.0, inner)

    def scaled(self, matrices: Matrices) -> Matrices:
        """Return M, R, K, J and D_q in scaled coordinates and rows."""
        return Matrices(*(x * f for x, f in zip(matrices, self.factors, strict=True)))

    def motions(self, V: Complex, C: Complex) -> tuple[Motions, Complex]:
        """Return the motions of columns V with S V = V C + T c, and V with the speeds of these motions."""
        n, N, m = self.n_xi, self.N, self.m
        # Speeds from positions and accelerations from speeds, not all from V: their rounding errors must agree.
        pos, rate = N @ V[:n], V[:n] @ C
        vel, turning = pos @ C, 0.0
        if self.T.shape[1]:
            c = self.inside @ V
            shift = self.T[:n] @ c
            rate = rate + shift
            vel = vel + N @ shift
            turning = N @ (self.T[:n] @ (self.inner @ c))
        acc = vel @ C + turning
        nu = self._multipliers(m.M @ acc + m.R @ vel + m.K @ pos)
        V = np.vstack([V[:n], self.Z.T @ (rate - self.P @ V[:n]) / self.gamma])
        return Motions(pos, vel, acc, nu), V

    def _multipliers(self, force: Complex) -> Complex:
        """Return the least-squares solution ν of Jᵀ ν = −force."""
        mu = -self.lift_W.T @ (self.N.T @ force)
        lam = -self.lift_C.T @ (force + self.m.J[self.n_h :].T @ mu)
        return np.vstack([lam, mu])

    def weights(self, Y: Complex) -> Weights:
        """Return the forces of rows Y, and the weights of the constraint rows as polynomials in s."""
        n, N, Z, m = self.n_xi, self.N, self.Z, self.m
        w = np.linalg.solve(self.M_z.T, Y[:, n:].T / self.gamma).T if self.M_z.size else Y[:, n:]
        y = (w @ Z.T) @ N.T
        mass = y @ m.M
        inertia, damping = mass @ N, y @ m.R
        mu = self._held(Y[:, :n] - inertia @ self.P - damping @ N), self._held(-inertia)
        D_u, D_q = m.J[self.n_h :], m.D_q
        lam = y @ m.K + mu[0] @ D_q, damping + mu[0] @ D_u + mu[1] @ D_q, mass + mu[1] @ D_u
        return Weights(y, tuple(-x @ self.lift_C for x in lam), mu, self._rounding(Y, y))

    def acting(self, Y: Complex, w: Weights) -> Complex:
        """Return the rows for which the forces of rows Y stand: these were solved for, with rounding errors."""
        return np.hstack([Y[:, : self.n_xi], self.gamma * ((w.y @ self.m.M @ self.N) @ self.Z)])

    def _held(self, forces: Complex) -> Complex:
        """Return the weights of the rows on speeds that hold forces, up to those along allowed speeds."""
        return np.asarray((forces - (forces @ self.Z) @ self.Z.T) @ self.lift_W)

    def _rounding(self, Y: Complex, y: Complex) -> tuple[Array, ...]:
        """Return the bounds of the rounding errors of the weights of the rows on speeds."""
        if not len(self.off_W):
            return ()
        N, lift, size = np.abs(self.N), np.abs(self.lift_W), np.abs(y)
        rounding = LINEAR.roundings_of_sum * EPS * lift
        inertia, damping = size @ np.abs(self.m.M) @ N, size @ np.abs(self.m.R) @ N
        forces = np.abs(Y[:, : self.n_xi]) + inertia @ np.abs(self.P) + damping
        # P as well follows from the pseudo-inverse.
        carried = (inertia @ lift) @ self.off_W @ (np.abs(self.m.D_q) @ N)
        return forces @ rounding + carried @ lift, inertia @ rounding

    def residual(self, x: Motions, w: Weights, C: Complex, m: Matrices | None = None) -> Complex:
        """Return y (M ẍ + R ẋ + K x + Jᵀ ν) + λ C x + μ (D_u ẋ + D_q x)."""
        m = self.m if m is None else m
        forces = m.M @ x.acc + m.R @ x.vel + m.K @ x.pos + m.J.T @ x.nu
        first, second = m.J[: self.n_h] @ x.pos, m.J[self.n_h :] @ x.vel + m.D_q @ x.pos
        result: Complex = w.y @ forces + _polynomial(w.lam, first, C) + _polynomial(w.mu, second, C)
        return result

    def data(self, x: Motions, w: Weights, V: Complex, Y: Complex, C: Complex, blocks: Any) -> Array:
        """Return the bound of the error of `residual` from the errors of the data and of its evaluation."""
        m, y = self.errors, np.abs(w.y)
        pos, vel, acc, nu = (np.abs(part) for part in x)
        first, second = m.J[: self.n_h] @ pos, m.J[self.n_h :] @ vel + m.D_q @ pos
        result: Array = y @ (m.M @ acc + m.R @ vel + m.K @ pos + m.J.T @ nu)
        for weights, rows in ((w.lam, first), (w.mu, second)):
            # The effect of a block on itself: with its weights, not with the sizes of their terms.
            own = np.zeros_like(weights[0])
            for part in reversed(weights):
                own = C @ own + part
            each = _polynomial(tuple(map(np.abs, weights)), rows, np.abs(C)) if len(rows) else np.zeros_like(result)
            result += np.where(blocks, np.abs(own) @ rows, each)
        result += self._displacing(x, w, C)
        # T and L are exact up to rounding.
        rounding = LINEAR.roundings_of_sum * EPS
        if self.T.shape[1]:
            sizes = np.outer(np.linalg.norm(Y, axis=1), np.linalg.norm(self.inside @ V, axis=0))
            result += (rounding + self.fitted) * sizes
        if self.outside.shape[1]:
            result += rounding * np.outer(np.linalg.norm(Y @ self.outside, axis=1), np.linalg.norm(V, axis=0))
        for change in self.displaced:
            result += np.abs(self.residual(x, w, C, change))
        return result

    def leaving(self, w: Weights, V: Complex, Y: Complex, C: Complex, blocks: Any) -> Array:
        """Return a bound of what T adds to the residuals of motions V + T p.

        T is exact by structure, but as it was computed the equations lead out of its span by roundings, many of them
        where its directions are nearly dependent. This is evaluated with S and with the unreduced equations: each has
        rounding errors of its own, which the smaller of both has least of. Twice as much is too little by 1.03 in one
        of 160 motions of a ball on a turntable.
        """
        T = self.T
        if not T.shape[1]:
            return np.zeros_like(C, dtype=float)
        inner = (self.inside @ T).astype(complex)
        pos = self.N @ T[: self.n_xi]
        vel = pos @ inner
        acc = vel @ inner
        x = Motions(pos, vel, acc, self._multipliers(self.m.M @ acc + self.m.R @ vel + self.m.K @ pos))
        p = self._along(self.inside @ V, inner, C, blocks)
        effects = self.residual(x, w, inner) @ p, Y @ (self.S @ T - T @ inner) @ p
        return np.where(blocks, 4.0 * np.min(np.abs(effects), axis=0), 0.0)

    @staticmethod
    def _along(c: Complex, inner: Array, C: Complex, blocks: Any) -> Complex:
        """Return the part p along T of motions V + T p, with p C − S_T p = c; none beside eigenvalues of S_T itself."""
        p = np.zeros_like(c)
        for members in {tuple(np.flatnonzero(column).tolist()) for column in blocks.T}:
            own = list(members)
            matrix = np.kron(np.eye(len(inner)), C[np.ix_(own, own)].T) - np.kron(inner, np.eye(len(own)))
            if np.isfinite(matrix).all():
                left, s, right = np.linalg.svd(matrix)
                if s[-1] > TOLERANCES.eigenvalue_of_neutral * s[0]:
                    found = right.conj().T @ ((left.conj().T @ c[:, own].ravel()) / s)
                    p[:, own] = found.reshape(len(inner), len(own))
        return p

    def _displacing(self, x: Motions, w: Weights, C: Complex) -> Array:
        """Return the second-order terms where neither motions nor forces satisfy the constraints exactly."""
        rows, lift, size = self.m.J[: self.n_h], np.abs(self.lift_C), np.abs(C)
        result: Array = np.zeros((len(w.y), len(w.y)))
        if len(self.off_W):
            # The weights of rows on speeds, and the motions, follow from a pseudo-inverse that is not exact.
            D_u, D_q = self.m.J[self.n_h :], self.m.D_q
            rounding = LINEAR.roundings_of_sum * EPS
            violated = np.abs(D_u @ x.vel + D_q @ x.pos)
            violated += rounding * (np.abs(D_u) @ np.abs(x.vel) + np.abs(D_q) @ np.abs(x.pos))
            off = tuple(np.abs(part) @ self.off_W + more for part, more in zip(w.mu, w.rounding, strict=True))
            result += _polynomial(off, violated, size)
        if not len(rows):
            return result
        rounding = LINEAR.roundings_of_sum * EPS * np.abs(rows)
        there = lift @ (np.abs(rows @ x.pos) + rounding @ np.abs(x.pos))
        here = (np.abs(w.y @ rows.T) + np.abs(w.y) @ rounding.T) @ lift.T
        for change in self.displaced:
            turned = change.J[: self.n_h]
            off = lift @ np.abs(turned @ x.pos)
            there, here = there + off, here + np.abs(w.y @ turned.T) @ lift.T
            result += np.abs(w.y) @ _polynomial(tuple(map(np.abs, (change.K, change.R, change.M))), off, size)
            result += _polynomial(tuple(np.abs(part @ turned) for part in w.lam), off, size)
        result += here @ _polynomial(tuple(map(np.abs, (self.m.K, self.m.R, self.m.M))), there, size)
        return result

    @cached_property
    def errors(self) -> Matrices:
        """Error bounds of M, R, K, J and D_q in scaled coordinates, and of the summation of products with them."""
        summed = (LINEAR.roundings_of_sum + 0.5 * math.log2(len(self.m.M) + len(self.m.J))) * EPS
        known = (np.nan_to_num(x, nan=np.inf) for x in self.scaled(roundings(self.linear).errors))
        return Matrices(*(x + summed * np.abs(y) for x, y in zip(known, self.m, strict=True)))

    @cached_property
    def displaced(self) -> list[Matrices]:
        """Changes of the matrices by the rounding errors of coordinates that are held weakly."""
        return [self.scaled(changes) for changes in roundings(self.linear).displaced]

    def weighted(self, W: Complex, rate: float) -> Complex:
        """Return vectors of A with speeds in units of a rate, which makes them small for slow motions."""
        weights = np.ones(len(self.S))
        weights[self.n_xi :] = self.gamma / max(rate, TOLERANCES.slowest_rate_of_errors * self.gamma)
        result: Complex = (self.B @ W) * weights[:, None]
        return result

    def backward(self, values: Complex, x: Motions) -> Array:
        """Return residuals of eigenpairs relative to the matrices."""
        m, size = self.m, np.abs(values)
        residual = np.linalg.norm(m.M @ x.acc + m.R @ x.vel + m.K @ x.pos + m.J.T @ x.nu, axis=0)
        M, R, K, J = (float(np.linalg.norm(part)) for part in m[:4])
        weight = (size**2 * M + size * R + K) * np.linalg.norm(x.pos, axis=0) + J * np.linalg.norm(x.nu, axis=0)
        result: Array = residual / weight
        return result

    def pairs(self, values: Complex, x: Complex) -> Motions:
        """Return eigenpairs of the whole problem as motions."""
        m = self.m
        vel, acc = x * values, x * values**2
        return Motions(x, vel, acc, self._multipliers(m.M @ acc + m.R @ vel + m.K @ x))

    def full(self, V: Complex, Y: Complex, s: Complex) -> tuple[Motions, Complex, Complex, Complex]:
        """Return eigenvectors of S as motions, and their left vectors as forces and weights of the rows."""
        x = self.pairs(s, self.whole(V, s, self.N @ V[: self.n_xi]))
        w = self.weights(Y + ((Y @ self.outside) / s[:, None]) @ self.L)
        lam, mu = (sum(part * s[:, None] ** k for k, part in enumerate(weights)) for weights in (w.lam, w.mu))
        slope = np.sum(w.y * ((2.0 * s) * (self.m.M @ x.pos) + self.m.R @ x.pos).T, axis=1)
        slope = slope + np.sum(mu * (self.m.J[self.n_h :] @ x.pos).T, axis=1)
        return x, w.y / slope[:, None], lam / slope[:, None], mu / slope[:, None]

    def spread(self, x: Motions, y: Complex, lam: Complex, mu: Complex) -> Array:
        """Return the bound of the error of eigenvalues from the errors of the data alone, to first order."""
        m, (pos, vel, acc, nu) = self.errors, (np.abs(part) for part in x)
        forces = m.M @ acc + m.R @ vel + m.K @ pos + m.J.T @ nu
        rows = m.J[self.n_h :] @ vel + m.D_q @ pos
        result: Array = np.sum(np.abs(y) * forces.T, axis=1) + np.sum(np.abs(mu) * rows.T, axis=1)
        result += np.sum(np.abs(lam) * (m.J[: self.n_h] @ pos).T, axis=1)
        return result

    def quadratic(self, change: Matrices | None = None) -> tuple[Quadratic, npt.NDArray[np.intp]]:
        """Return the unreduced equations without redundant rows, and the numbers of the kept rows."""
        own = self.m if change is None else Matrices(*(x + dx for x, dx in zip(self.m, change, strict=True)))
        linear, n = self.linear, len(self.m.M)
        redundant = [id(item.row) for item in linear.motion.redundant]
        kept = np.array([*range(n), *(n + i for i, row in enumerate(linear.rows) if id(row) not in redundant)])
        terms = (part / (ALGEBRA.roundings_of_entry * EPS) for part in self.errors)
        M, R, K, *sizes = (part[at_block(kept, kept)] for m in (own, Matrices(*terms)) for part in composite(m))
        from mbstab.analysis.algebra.refinement import Quadratic

        return Quadratic.of(M, R, K, tuple(sizes)), kept

    def moved(self, s: complex, right: Complex, left: Complex) -> float:
        """Return how far an eigenvalue moves where coordinates are held weakly, to all orders; inf: not known."""
        from mbstab.analysis.algebra.refinement import refined

        total = 0.0
        for change in self.displaced:
            for sign in (1.0, -1.0):
                problem, kept = self.quadratic(Matrices(*(sign * x for x in change)))
                found = refined(problem, s, right[kept], left[kept])
                total = max(total, abs(found[0] - s)) if found is not None else math.inf
        return total * len(self.displaced)

    def whole(self, V: Complex, values: Complex, pos: Complex) -> Complex:
        """Return eigenvectors as coordinates, with their part along T."""
        if not self.T.shape[1]:
            return pos
        inner, c = self.inner, self.inside @ V
        solved = _triangular(inner, c) if len(inner) > TOLERANCES.schur_from_symmetries else None
        result = pos.copy()
        for j, s in enumerate(values):
            if np.isfinite(s) and np.isfinite(c[:, j]).all():
                part = solved(complex(s), j) if solved is not None else None
                if part is None:
                    part = np.asarray(least_squares(s * np.eye(len(inner)) - inner, c[:, j], rcond=1e-12))
                result[:, j] += self.N @ (self.T[: self.n_xi] @ part)
        return result


def _triangular(inner: Array, c: Complex) -> Callable[[complex, int], Complex | None]:
    """Return a solver of (s − inner) x = c_j by one Schur form; it returns None if s is too near to an eigenvalue."""
    from scipy.linalg import schur, solve_triangular

    one, (triangle, basis) = np.eye(len(inner)), schur(inner, output="complex")
    turned, own = basis.conj().T @ c, np.diag(triangle)
    clear = TOLERANCES.eigenvalue_of_neutral * float(np.max(np.abs(triangle)))

    def solved(s: complex, j: int) -> Complex | None:
        if np.min(np.abs(s - own)) <= clear:
            return None
        return np.asarray(basis @ solve_triangular(s * one - triangle, turned[:, j]), dtype=complex)

    return solved


class Motions(NamedTuple):
    """Columns lifted to motions."""

    pos: Complex
    vel: Complex
    acc: Complex
    nu: Complex


class Weights(NamedTuple):
    """Rows lifted to forces and to weights of the constraint rows, polynomials in s; rounding errors of `mu`."""

    y: Complex
    lam: tuple[Complex, ...]
    mu: tuple[Complex, ...]
    rounding: tuple[Array, ...]


def _polynomial(weights: tuple[Any, ...], rows: Any, C: Any) -> Any:
    """Return Σ weights_k rows Cᵏ."""
    result = weights[0] @ rows
    for part in weights[1:]:
        rows = rows @ C
        result = result + part @ rows
    return result
