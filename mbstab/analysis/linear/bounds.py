"""Where the eigenvalues are: discs of the complex plane that hold them, single ones and clusters alike.

What symmetries and conserved functions explain is separated before (`mbstab.analysis.linear.neutral`): T
spans directions with S T ⊂ T, the rows of L are differentials with L S = 0, and what is left to
judge is A = Bᵀ S B on {y ⟂ T, L y = 0}. With approximate eigenvectors V = B W, dual rows Y and
A W ≈ W C, C block diagonal, one block for each cluster, every column is lifted to a motion with
positions x, speeds ẋ, accelerations ẍ and multipliers ν, every row to forces y and to the weights
λ, μ of the rows of the constraints. In these bases

    F = y (M ẍ + R ẋ + K x + Jᵀ ν) + λ C x + μ (D_u ẋ + D_q x)

is how much C is wrong, to first order, and the same expression with sizes instead of numbers and
with the errors of M, R, K, J and D_q (`mbstab.analysis.linear.roundings`) is how much the data leave open.
The equations before they are reduced show both entry by entry: it does not matter what was lost in
reducing them, nor in units, nor that masses differ by many orders. C and W are corrected by F until
what couples the blocks no longer counts; with E, the sizes of what is left, the matrix is C + E,
and s is no eigenvalue of it if, for the block I and all others R,

    ρ(|(s − C_I)⁻¹| (E_II + E_IR X)) < 1,   X ≥ |(s − C_R)⁻¹| (E_RI + E_RR X),

which is evaluated on circles (Gershgorin's discs for blocks: Feingold and Varga 1962, Pacific J.
Math. 12). By continuity the disc inside holds as many eigenvalues as the block. Blocks grow where
there is no such circle. At last single eigenvalues that bear the rounding of T and L, or of much
larger ones, are refined (`mbstab.analysis.algebra.refinement`); what is found counts if it lies in the disc.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from mbstab.analysis.algebra.arrays import Complex
from mbstab.analysis.algebra.matching import assigned
from mbstab.analysis.algebra.refinement import ROUNDINGS, Quadratic, refined
from mbstab.analysis.linear.linearize import Linearization, StateSpace, composite
from mbstab.analysis.linear.roundings import roundings
from mbstab.analysis.reference.coefficients import Matrices
from mbstab.compiler.system import Array

EPS = float(np.finfo(float).eps)

APART = 1e-8
"""Eigenvalues smaller than this part of the largest have lost half of their digits in the matrix."""

SUMMED = 2.0
"""A sum of products is computed to so many roundings of its terms, and to one more for four times as many terms."""

CLOSE = 0.3
"""Two eigenvalues are judged together if what couples them is more than this part of their distance."""

PARALLEL = 1e-6
"""Vectors of equal eigenvalues are independent if the least singular value of them, as unit vectors, is larger."""

SLOWEST = 1e-10
"""Rates are not told from zero below this part of the typical one."""

DEPENDENT = 1e-11
"""They still span their subspace if it is larger than this."""

NEAR = 1e-3
"""Eigenvalues of a cluster with parallel vectors differ by less than this part of them."""

CIRCLE = 48
"""Points of a circle on which a block is shown to have no eigenvalue …"""

MARGIN = 0.8
"""… with this much left between them."""

POWERS = 20
"""Powers of a matrix by which its spectral radius is compared with a limit, before its eigenvalues are found."""

DISTINCT = 1e-4
"""Eigenvalues farther from those of T than this part of what S does there are none of them."""

ROUNDS = 40
"""Rounds of joining eigenvalues that cannot be told apart."""

IMPROVEMENTS = 4
"""Rounds in which vectors are made better."""

SMALL = 0.1
"""What couples an eigenvalue to others may add this part to its bound before vectors are made better."""

FAR = 0.1
"""Two vectors are not turned towards each other if the product of both angles is larger."""

ROUGH = 100.0 * EPS
"""Eigenvalues with larger relative error bounds are refined …"""

MUCH = 10.0
"""… if the errors of the data alone leave so many times less open …"""

FEW = 1e-12
"""… and beside zeros of the structure also if the relative error bound is larger than this."""

DIFFERENT = 10.0
"""A value of another method that lies so many times farther from an eigenvalue than its vector says is none."""

UNLIKE = 1e150
"""Distance of what has no value."""

Group = list[int]


@dataclass(frozen=True)
class Disc:
    """A disc that holds exactly as many eigenvalues as it has members; the radius is inf where nothing is known."""

    centre: complex
    radius: float
    members: tuple[int, ...]


@dataclass(frozen=True)
class Placed:
    """Eigenvalues of what is left to judge, and where they can be.

    Attributes
    ----------
    values : ndarray of complex, shape (r,)
        (1/s)
    discs : list of Disc
        Disjoint, but for those of radius inf.
    bounds : ndarray, shape (r,)
        How far each value can be off (1/s); inf: nothing is known.
    condition : ndarray, shape (r,)
        How much the rounding of the data is magnified: the bound relative to the eigenvalue, in roundings.
    backward_error : ndarray, shape (r,)
        Residual of the pair relative to the matrices.
    vectors : ndarray of complex, shape (n_q, r)
        Δq in scaled coordinates; for members of a cluster a basis of its subspace.
    neutral : tuple of int
        Which of the values belong to T and L; they have no disc. Empty for the default method.
    """

    values: Complex
    discs: list[Disc]
    bounds: Array
    condition: Array
    backward_error: Array
    vectors: Complex
    neutral: tuple[int, ...] = ()


class Motions(NamedTuple):
    """Columns lifted to motions."""

    pos: Complex
    vel: Complex
    acc: Complex
    nu: Complex


class Weights(NamedTuple):
    """Rows lifted to forces and to weights of the rows of the constraints, polynomials in s."""

    y: Complex
    lam: tuple[Complex, ...]
    mu: tuple[Complex, ...]


def enclosures(linear: Linearization, space: StateSpace, gamma: float, S: Array, T: Array, L: Array) -> Placed:
    """Return discs that hold the eigenvalues apart from T and L.

    Parameters
    ----------
    linear : Linearization
    space : StateSpace
    gamma : float
        A typical rate (1/s), in units of which the speeds of S count.
    S : ndarray, shape (n, n)
        The balanced matrix.
    T : ndarray, shape (n, d)
        Orthonormal, with S T ⊂ T by structure.
    L : ndarray, shape (k, n)
        Orthonormal rows with L S = 0 by structure and L T = 0.
    """
    with np.errstate(all="ignore"):
        return _Judge(linear, space, gamma, S, T, L).found().placed()


def enclosures_of(
    linear: Linearization,
    space: StateSpace,
    gamma: float,
    S: Array,
    T: Array,
    L: Array,
    values: Complex,
    vectors: Complex,
) -> Placed:
    """Return bounds of eigenvalues that another method has found: how far they are from the discs, and the discs.

    Parameters
    ----------
    values : ndarray of complex, shape (r,)
        All finite eigenvalues that it has found, those of T and L among them.
    vectors : ndarray of complex, shape (n_q or more, r)
        The first n_q components of a column are Δq (m, rad).
    """
    with np.errstate(all="ignore"):
        return _of_others(_Judge(linear, space, gamma, S, T, L), np.asarray(values, dtype=complex), vectors)


class _Judge:
    """Eigenvectors of A, lifted to the equations before they are reduced, and what these say."""

    def __init__(self, linear: Linearization, space: StateSpace, gamma: float, S: Array, T: Array, L: Array) -> None:
        self.linear, self.space, self.gamma, self.S, self.T, self.L = linear, space, gamma, S, T, L
        self.n_h, self.n_xi, n = linear.n_h, space.n_xi, len(S)
        known = np.hstack([T, L.T])
        self.B = np.linalg.qr(known, mode="complete")[0][:, known.shape[1] :] if known.shape[1] else np.eye(n)
        self.A = self.B.T @ S @ self.B if known.shape[1] else S
        self.inside, self.outside = T.T @ S, S @ L.T
        spaces = linear.motion.spaces
        scale, rows = spaces.scale, spaces.row_scale
        self.P = space.A[: self.n_xi, : self.n_xi]
        self.lift_C, self.lift_W = spaces.C.pseudo_inverse, spaces.W.pseudo_inverse
        self.factors = Matrices(
            scale * scale[:, None], scale * scale[:, None], scale * scale[:, None], rows[:, None] * scale,
            rows[self.n_h :, None] * scale,
        )  # fmt: skip
        self.m = self.scaled(Matrices(linear.M, linear.R, linear.K, linear.J, linear.D_q))
        # Where a light body is held, rounding of the bases beside zeros would be a great force.
        C, D_u = self.m.J[: self.n_h], self.m.J[self.n_h :]
        self.N = spaces.N - self.lift_C @ (C @ spaces.N)
        self.Z = spaces.Z - self.lift_W @ ((D_u @ self.N) @ spaces.Z)

    def scaled(self, matrices: Matrices) -> Matrices:
        """Return M, R, K, J and D_q in scaled coordinates and rows."""
        return Matrices(*(x * f for x, f in zip(matrices, self.factors, strict=True)))

    # --- from vectors of A to motions and forces --------------------------------------------------------------------

    def motions(self, V: Complex, C: Complex) -> tuple[Motions, Complex]:
        """Return what columns V with S V = V C + T c are as motions, and V with the speeds that belong to these."""
        n, N, m = self.n_xi, self.N, self.m
        # Speeds from places, not both from V: their roundings must not differ.
        pos, rate = N @ V[:n], V[:n] @ C
        vel = pos @ C
        acc = vel @ C
        if self.T.shape[1]:
            c = self.inside @ V
            shift = self.T[:n] @ c
            rate = rate + shift
            vel = vel + N @ shift
            acc = acc + N @ (self.T[:n] @ (c @ C + (self.inside @ self.T) @ c))
        nu = self._multipliers(m.M @ acc + m.R @ vel + m.K @ pos)
        V = np.vstack([V[:n], self.Z.T @ (rate - self.P @ V[:n]) / self.gamma])
        return Motions(pos, vel, acc, nu), V

    def _multipliers(self, force: Complex) -> Complex:
        """Return ν with Jᵀ ν = −force as nearly as can be."""
        mu = -self.lift_W.T @ (self.N.T @ force)
        lam = -self.lift_C.T @ (force + self.m.J[self.n_h :].T @ mu)
        return np.vstack([lam, mu])

    def weights(self, Y: Complex) -> Weights:
        """Return what rows Y are as forces, and the weights of the rows of the constraints as polynomials in s."""
        n, N, Z, m = self.n_xi, self.N, self.Z, self.m
        M_z = self.space.M_z
        w = np.linalg.solve(M_z.T, Y[:, n:].T / self.gamma).T if M_z.size else Y[:, n:]
        y = (w @ Z.T) @ N.T
        mass = y @ m.M
        inertia, damping = mass @ N, y @ m.R
        mu = (Y[:, :n] - inertia @ self.P - damping @ N) @ self.lift_W, -inertia @ self.lift_W
        D_u, D_q = m.J[self.n_h :], m.D_q
        lam = y @ m.K + mu[0] @ D_q, damping + mu[0] @ D_u + mu[1] @ D_q, mass + mu[1] @ D_u
        return Weights(y, tuple(-x @ self.lift_C for x in lam), mu)

    def residual(self, x: Motions, w: Weights, C: Complex, m: Matrices | None = None) -> Complex:
        """Return y (M ẍ + R ẋ + K x + Jᵀ ν) + λ C x + μ (D_u ẋ + D_q x)."""
        m = self.m if m is None else m
        forces = m.M @ x.acc + m.R @ x.vel + m.K @ x.pos + m.J.T @ x.nu
        first, second = m.J[: self.n_h] @ x.pos, m.J[self.n_h :] @ x.vel + m.D_q @ x.pos
        result: Complex = w.y @ forces + _polynomial(w.lam, first, C) + _polynomial(w.mu, second, C)
        return result

    def data(self, x: Motions, w: Weights, V: Complex, Y: Complex, C: Complex, blocks: Any) -> Array:
        """Return how much the errors of the data, and of evaluating `residual`, leave open of it."""
        m, y = self.errors, np.abs(w.y)
        pos, vel, acc, nu = (np.abs(part) for part in x)
        first, second = m.J[: self.n_h] @ pos, m.J[self.n_h :] @ vel + m.D_q @ pos
        result: Array = y @ (m.M @ acc + m.R @ vel + m.K @ pos + m.J.T @ nu)
        for weights, rows in ((w.lam, first), (w.mu, second)):
            # What one block does to itself: its weights as they are, not the sizes of their terms.
            own = np.zeros_like(weights[0])
            for part in reversed(weights):
                own = C @ own + part
            each = _polynomial(tuple(map(np.abs, weights)), rows, np.abs(C)) if len(rows) else np.zeros_like(result)
            result += np.where(blocks, np.abs(own) @ rows, each)
        result += self._displacing(x, w, C)
        # T and L are known to rounding.
        if self.T.shape[1]:
            result += SUMMED * EPS * np.outer(np.linalg.norm(Y, axis=1), np.linalg.norm(self.inside @ V, axis=0))
        if self.outside.shape[1]:
            result += SUMMED * EPS * np.outer(np.linalg.norm(Y @ self.outside, axis=1), np.linalg.norm(V, axis=0))
        for change in self.displaced:
            result += np.abs(self.residual(x, w, C, change))
        return result

    def _displacing(self, x: Motions, w: Weights, C: Complex) -> Array:
        """Return what is of second order where neither motions nor forces satisfy the constraints exactly."""
        rows, lift, size = self.m.J[: self.n_h], np.abs(self.lift_C), np.abs(C)
        result: Array = np.zeros((len(w.y), len(w.y)))
        if not len(rows):
            return result
        rounding = SUMMED * EPS * np.abs(rows)
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
        """Errors of M, R, K, J and D_q in scaled coordinates, and of summing products with them."""
        summed = (SUMMED + 0.5 * math.log2(len(self.m.M) + len(self.m.J))) * EPS
        known = (np.nan_to_num(x, nan=np.inf) for x in self.scaled(roundings(self.linear).errors))
        return Matrices(*(x + summed * np.abs(y) for x, y in zip(known, self.m, strict=True)))

    @cached_property
    def displaced(self) -> list[Matrices]:
        """Changes of the matrices by what rounding makes of the coordinates where little holds them."""
        return [self.scaled(changes) for changes in roundings(self.linear).displaced]

    def weighted(self, W: Complex, rate: float) -> Complex:
        """Return vectors of A with speeds in units of a rate: of slow motions they are small."""
        weights = np.ones(len(self.S))
        weights[self.n_xi :] = self.gamma / max(rate, SLOWEST * self.gamma)
        result: Complex = (self.B @ W) * weights[:, None]
        return result

    # --- what is reported -------------------------------------------------------------------------------------------

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

    def spread(self, x: Motions, y: Complex, lam: Complex, mu: Complex, s: Complex) -> Array:
        """Return how much the errors of the data alone leave open of eigenvalues, to first order."""
        m, (pos, vel, acc, nu) = self.errors, (np.abs(part) for part in x)
        forces = m.M @ acc + m.R @ vel + m.K @ pos + m.J.T @ nu
        rows = m.J[self.n_h :] @ vel + m.D_q @ pos
        result: Array = np.sum(np.abs(y) * forces.T, axis=1) + np.sum(np.abs(mu) * rows.T, axis=1)
        result += np.sum(np.abs(lam) * (m.J[: self.n_h] @ pos).T, axis=1)
        return result

    def quadratic(self, change: Matrices | None = None) -> tuple[Quadratic, npt.NDArray[np.intp]]:
        """Return the equations before they are reduced, without redundant rows, and what is left of their rows."""
        own = self.m if change is None else Matrices(*(x + dx for x, dx in zip(self.m, change, strict=True)))
        linear, n = self.linear, len(self.m.M)
        redundant = [id(item.row) for item in linear.motion.redundant]
        kept = np.array([*range(n), *(n + i for i, row in enumerate(linear.rows) if id(row) not in redundant)])
        terms = (part / (ROUNDINGS * EPS) for part in self.errors)
        M, R, K, *sizes = (part[_at(kept, kept)] for m in (own, Matrices(*terms)) for part in composite(m))
        return Quadratic.of(M, R, K, tuple(sizes)), kept

    def moved(self, s: complex, right: Complex, left: Complex) -> float:
        """Return how far an eigenvalue moves where little holds the coordinates, in all orders; inf: not known."""
        total = 0.0
        for change in self.displaced:
            for sign in (1.0, -1.0):
                problem, kept = self.quadratic(Matrices(*(sign * x for x in change)))
                found = refined(problem, s, right[kept], left[kept])
                total = max(total, abs(found[0] - s)) if found is not None else math.inf
        return total * len(self.displaced)

    def whole(self, V: Complex, values: Complex, pos: Complex) -> Complex:
        """Return eigenvectors as coordinates, with the part along T."""
        if not self.T.shape[1]:
            return pos
        from scipy.linalg import schur, solve_triangular

        inner, c, one = self.inside @ self.T, self.inside @ V, np.eye(self.T.shape[1])
        triangle, basis = schur(inner, output="complex")
        turned, own = basis.conj().T @ c, np.diag(triangle)
        clear = DISTINCT * float(np.max(np.abs(triangle)))
        result = pos.copy()
        for j, s in enumerate(values):
            if np.isfinite(s) and np.isfinite(c[:, j]).all():
                if np.min(np.abs(s - own)) > clear:
                    part = basis @ solve_triangular(s * one - triangle, turned[:, j])
                else:
                    part = np.linalg.lstsq(s * one - inner, c[:, j], rcond=1e-12)[0]
                result[:, j] += self.N @ (self.T[: self.n_xi] @ part)
        return result

    # --- vectors of A -----------------------------------------------------------------------------------------------

    def found(self) -> _Found:
        """Return the eigenvalues in groups that can be told apart; nothing is known of them where that fails."""
        n = len(self.A)
        if not n:
            none = np.zeros((0, 0), dtype=complex)
            return _Found(self, none, none, [], [])
        try:
            return self._found()
        except (np.linalg.LinAlgError, ArithmeticError):
            return self._unknown(n)

    def _unknown(self, n: int) -> _Found:
        unknown = np.full((n, n), np.nan + 0j)
        return _Found(self, unknown, unknown, [[i] for i in range(n)], list(range(n)))

    def _found(self) -> _Found:
        values, W = _eig(self.A)
        partner = _partners(values)
        found = self._joined(W, np.diag(values), [[i] for i in range(len(values))], partner)
        if found.clear():
            return found
        groups = _dependent(values, partner, lambda g: self.weighted(W[:, g], float(np.max(np.abs(values[g])))))
        if len(groups) < len(values):
            # Vectors that are nearly parallel come from their subspace, in which what belongs to whom is seen better.
            start = _Found(self, W, np.diag(values), groups, partner).split()
            found = min(found, self._joined(*start), key=lambda x: x.spread())
        if len(found.groups) < len(values):
            # What was too rough to be told apart is not, perhaps, in the basis of its subspace.
            start = found.split()
            if len(start[2]) > len(found.groups):
                found = min(found, self._joined(*start), key=lambda x: x.spread())
        return found

    def _joined(self, W: Complex, C: Complex, groups: list[Group], partner: list[int]) -> _Found:
        """Return the eigenvalues in larger groups, until these can be told apart."""
        try:
            return self._told(W, C, groups, partner)
        except (np.linalg.LinAlgError, ArithmeticError):
            return self._unknown(len(W))

    def _told(self, W: Complex, C: Complex, groups: list[Group], partner: list[int]) -> _Found:
        rates = np.zeros(len(W))
        for _ in range(ROUNDS):
            found = _Found(self, W, C, groups, partner, rates)
            joined = found.joined()
            if joined is None:
                break
            groups, rates = joined, found.rates(joined)
        else:
            found.radii = np.full(len(found.groups), np.inf)
            return found
        if len(groups) < len(W):
            # The basis of a cluster is best where speeds are in units of its radius.
            other = _Found(self, W, C, groups, partner, np.nan_to_num(found.radii, posinf=0.0)[found.of])
            if other.joined() is None:
                found = min(found, other, key=lambda x: x.spread())
        return found


def _at(rows: Any, columns: Any) -> Any:
    """Return the index of a block."""
    return np.ix_(rows, columns)


def _eig(A: Array) -> tuple[Complex, Complex]:
    """Return eigenvalues and vectors; slow ones that are lost beside fast ones come from the inverse."""
    values, vectors = (x.astype(complex) for x in np.linalg.eig(A))
    size = np.abs(values)
    order = np.argsort(-size)
    if size[order[-1]] > APART * size[order[0]]:
        return values, vectors
    try:
        inverse, others = (x.astype(complex) for x in np.linalg.eig(np.linalg.inv(A)))
    except np.linalg.LinAlgError:
        return values, vectors
    slow = np.argsort(-np.abs(inverse))
    if not np.isfinite(others).all() or inverse[slow[-1]] == 0.0:
        return values, vectors
    # The spectrum is parted where its gap is widest.
    rates = size[order]
    fast = 1 + int(np.argmax(rates[:-1] / np.maximum(rates[1:], EPS * rates[0])))
    fast_ones, slow_ones = order[:fast], slow[: len(A) - fast]
    together = np.concatenate([values[fast_ones], 1.0 / inverse[slow_ones]])
    if not _paired(together):
        return values, vectors
    return together, np.hstack([vectors[:, fast_ones], others[:, slow_ones]])


def _paired(values: Complex) -> bool:
    """Whether all complex eigenvalues come with their mirror images."""
    return sorted(values[values.imag > 0.0].tolist(), key=_key) == sorted(
        values[values.imag < 0.0].conj().tolist(), key=_key
    )


def _key(s: complex) -> tuple[float, float]:
    return s.real, s.imag


def _polynomial(weights: tuple[Any, ...], rows: Any, C: Any) -> Any:
    """Return Σ weights_k rows Cᵏ."""
    result = weights[0] @ rows
    for part in weights[1:]:
        rows = rows @ C
        result = result + part @ rows
    return result


def _inverse(W: Complex) -> Complex:
    """Return the inverse of a matrix whose rows may differ in size, nan where there is none."""
    size = np.max(np.abs(W), axis=1, initial=0.0)
    scale = 1.0 / np.where(size > 0.0, size, 1.0)
    try:
        result: Complex = np.asarray(np.linalg.inv(W * scale[:, None]) * scale, dtype=np.complex128)
    except np.linalg.LinAlgError:
        return np.full_like(W, np.nan)
    return result + (np.eye(len(W)) - result @ W) @ result


def _partners(values: Complex) -> list[int]:
    """Return for each eigenvalue the number of its mirror image, itself if it is real."""
    partner = list(range(len(values)))
    open_ = [i for i in range(len(values)) if values[i].imag < 0.0]
    for i in np.flatnonzero(values.imag > 0.0).tolist():
        j = min(open_, key=lambda k: abs(values[k] - values[i].conjugate()))
        open_.remove(j)
        partner[i], partner[j] = j, i
    return partner


def _dependent(values: Complex, partner: list[int], vectors: Callable[[Group], Complex]) -> list[Group]:
    """Return groups of eigenvalues that are equal, or all small, where their vectors depend on each other."""
    size = np.abs(values)
    larger = np.maximum(size[:, None], size)
    near = (larger <= PARALLEL * np.max(size)) | (np.abs(values[:, None] - values) <= NEAR * larger)
    singles: list[Group] = [[i] for i in range(len(values))]
    pairs = [(int(i), int(j)) for i, j in zip(*np.nonzero(np.triu(near, 1)), strict=True)]
    found: list[Group] = []
    for members in _united(singles, pairs, partner) if pairs else singles:
        if len(members) > 1:
            V = vectors(members)
            unit = V / np.linalg.norm(V, axis=0)
            if not np.linalg.svd(unit, compute_uv=False)[-1] > PARALLEL:
                found.append(members)
                continue
        found += [[i] for i in members]
    return found


def _near(E: Array, gap: Array) -> npt.NDArray[np.bool_]:
    """Return which eigenvalues are coupled too strongly for their distance."""
    limit, diagonal = CLOSE * gap, np.diag(E)
    product: npt.NDArray[np.float64] = E * E.T
    return np.asarray((product >= limit**2) | (diagonal[:, None] + diagonal >= limit))


def _below(matrices: Array, limit: float) -> bool:
    """Whether the spectral radii of matrices without negative entries, shape (m, n, n), are below a limit.

    With any x > 0 a radius lies between the least and the largest of (P x)_i / x_i (Collatz 1942).
    """
    x = np.ones((*matrices.shape[:2], 1))
    for _ in range(POWERS):
        y = matrices @ x
        ratio = (y / x)[..., 0]
        if np.any(np.min(ratio, axis=1) >= limit):
            return False
        if np.all(np.max(ratio, axis=1) < limit):
            return True
        # A little of x keeps y positive where the matrix has zeros.
        x = y / np.max(y, axis=1, keepdims=True) + EPS * x
    return bool(np.max(np.abs(np.linalg.eigvals(matrices))) < limit)


def _united(groups: list[Group], pairs: list[tuple[int, int]], mirror: list[int]) -> list[Group]:
    """Return larger groups: pairs of groups are joined, and so are their mirror images."""
    parent = list(range(len(groups)))

    def root(g: int) -> int:
        while parent[g] != g:
            g = parent[g]
        return g

    for g, h in pairs:
        parent[root(g)] = root(h)
        parent[root(mirror[g])] = root(mirror[h])
    together: dict[int, Group] = {}
    for g, members in enumerate(groups):
        together.setdefault(root(g), []).extend(members)
    return list(together.values())


class _Around:
    """What surrounds a group: what the others add to its block, for all s within a circle."""

    def __init__(self, found: _Found, members: Group, centre: complex) -> None:
        self.members, self.centre = members, centre
        rest = np.flatnonzero(found.of != found.of[members[0]])
        self.rest, self.distance = rest, np.abs(found.s[rest] - centre)
        E = found.E
        self.inner, self.way = E[_at(members, members)], E[_at(rest, members)]
        self.among, self.into = E[_at(rest, rest)], E[_at(members, rest)]
        self.clusters = []
        for g in sorted(set(found.of[rest].tolist())):
            if len(found.groups[g]) > 1:
                part = np.flatnonzero(found.of[rest] == g)
                block = found.T[_at(rest[part], rest[part])]
                try:
                    inverse = np.abs(np.linalg.inv(centre * np.eye(len(part)) - block))
                except np.linalg.LinAlgError:
                    inverse = np.full(block.shape, np.inf)
                radius = float(np.max(np.abs(np.linalg.eigvals(inverse)))) if np.isfinite(inverse).all() else np.inf
                self.clusters.append((part, inverse, radius))

    @cached_property
    def culprit(self) -> int | None:
        """The nearest eigenvalue that is not of the group."""
        return int(self.rest[np.argmin(np.nan_to_num(self.distance, nan=0.0))]) if len(self.rest) else None

    def outside(self, radius: float) -> Array | None:
        """Return what the others add to the block, None if that has no bound."""
        if not len(self.rest):
            return np.zeros((len(self.members), len(self.members)))
        distance = self.distance - radius
        if not np.all(distance > 0.0):
            return None
        matrix: Array = np.diag(1.0 / distance)
        for part, inverse, largest in self.clusters:
            # (s − C)⁻¹ is a power series about the centre.
            if not radius * largest < 0.5:
                return None
            matrix[_at(part, part)] = np.linalg.solve(np.eye(len(part)) - radius * inverse, inverse)
        x = 1.2 * (matrix @ self.way)
        for _ in range(6):
            y = matrix @ (self.way + self.among @ x)
            if np.all(y <= x):
                result: Array = self.into @ y
                return result
            x = 1.2 * np.maximum(x, y)
        return None


class _Found:
    """What is known with eigenvalues judged in groups: bases, blocks, what is open, and radii."""

    def __init__(
        self,
        judge: _Judge,
        W: Complex,
        C: Complex,
        groups: list[Group],
        partner: list[int],
        rates: Array | None = None,
    ) -> None:
        self.judge, self.partner = judge, partner
        self.groups = groups
        self.of = np.zeros(len(W), dtype=int)
        for g, members in enumerate(groups):
            self.of[members] = g
        self.mirror = [int(self.of[partner[members[0]]]) for members in groups]
        self.centres, self.radii = np.zeros(len(groups), dtype=complex), np.full(len(groups), np.inf)
        self.W, self.C = W.copy(), C.copy()
        for g, members in enumerate(groups):
            if len(members) > 1 and self.mirror[g] >= g:
                rate = 0.0 if rates is None else float(np.max(rates[members]))
                self._base(members, self.mirror[g] == g, rate)
        self._settle()

    # --- bases ------------------------------------------------------------------------------------------------------

    def _base(self, members: Group, real: bool, rate: float) -> None:
        """Put in an orthonormal basis of the subspace of a group, a real one if it is its own mirror image.

        Orthonormal with speeds in units of the rate of the group: what is slow stays visible beside what is fast.
        """
        judge, at = self.judge, _at(members, members)
        columns, block = self.W[:, members], self.C[at]
        V = np.full_like(columns, np.nan)
        if np.isfinite(columns).all() and np.isfinite(block).all():
            values = np.linalg.eigvals(block)
            rate = max(rate, float(np.max(np.abs(values))))
            V = judge.weighted(columns, rate)
        known = np.isfinite(V).all() and np.all(np.any(V, axis=0))
        if known and not np.linalg.svd(V / np.linalg.norm(V, axis=0), compute_uv=False)[-1] >= DEPENDENT:
            columns = self._schur(values, len(members))
            block, V = columns.conj().T @ judge.A @ columns, judge.weighted(columns, rate)
        lengths = np.linalg.norm(V, axis=0)
        V = V / lengths
        if not np.isfinite(V).all():
            self.W[:, members], self.C[at] = np.nan, np.nan
            return
        if real:
            basis = np.linalg.svd(np.hstack([V.real, V.imag]), full_matrices=False)[0][:, : len(members)]
        else:
            basis = np.linalg.qr(V)[0]
        turn = np.linalg.lstsq(V, basis.astype(complex), rcond=None)[0] / lengths[:, None]
        columns, block = columns @ turn, np.linalg.solve(turn, block @ turn)
        if real:
            columns, block = columns.real, block.real
        self.W[:, members], self.C[at] = columns, block
        if not real:
            others = [self.partner[i] for i in members]
            self.groups[self.mirror[self.of[members[0]]]] = others
            self.W[:, others], self.C[_at(others, others)] = columns.conj(), block.conj()

    def _schur(self, centre: Complex, count: int) -> Complex:
        """Return an orthonormal basis of the invariant subspace of a cluster without enough vectors."""
        from scipy.linalg import schur

        A = self.judge.A.astype(complex)
        near = np.sort([float(np.min(np.abs(centre - x))) for x in np.linalg.eigvals(A)])
        limit = 0.5 * (near[count - 1] + near[count]) if count < len(A) else np.inf

        def inside(x: complex) -> bool:
            return bool(np.min(np.abs(centre - x)) <= limit)

        # Where more are as near, what couples the block to the others will tell.
        _, basis, _ = schur(A, output="complex", sort=inside)
        result: Complex = basis[:, :count]
        return result

    def _settle(self) -> None:
        """Correct blocks and bases by what the equations before they are reduced say of them."""
        judge = self.judge
        blocks = self.of[:, None] == self.of
        best = math.inf
        for _ in range(IMPROVEMENTS):
            x, V = judge.motions(judge.B @ self.W, self.C)
            rows = _inverse(judge.B.T @ V) @ judge.B.T
            w = judge.weights(rows)
            # What the speeds that belong to the motions have along L does not belong to them.
            F = judge.residual(x, w, self.C) + (rows @ judge.outside) @ (judge.L @ V)
            data = judge.data(x, w, V, rows, self.C, blocks)
            # Left after the correction: what is of second order in it.
            step = np.where(blocks, F, 0.0)
            left = np.abs(step) @ np.abs(w.y @ (judge.m.M @ x.pos)) @ np.abs(step)
            # Rows are the inverse of the columns up to rounding.
            off = np.abs(rows @ V - np.eye(len(F))) + SUMMED * EPS * (np.abs(rows) @ np.abs(V))
            left += off @ np.abs(F)
            T, outside = self.C - step, np.where(blocks, 0.0, F)
            spectrum = self._spectrum(T)
            worst = np.maximum(self._coupled(outside, spectrum, data), np.diag(left) / np.diag(data))
            amount = float(np.max(np.nan_to_num(worst, nan=np.inf), initial=0.0))
            if best == math.inf or amount < best:
                best = amount
                self.E, self.T, self.s = data + np.abs(outside) + left, T, spectrum
                self.V, self.rows, self.x, self.w, self.F, self.data = V, rows, x, w, F, data
                kept = self.W, self.C
            else:
                break
            if not amount > SMALL:
                break
            self.W, self.C = self.W + self.W @ self._turn(F, blocks), T
        self.W, self.C = kept

    def _coupled(self, outside: Complex, s: Complex, data: Array) -> Array:
        """Return what residuals outside of the blocks make of each eigenvalue, relative to what the data leave open."""
        gap = np.abs(s[:, None] - s)
        gap[self.of[:, None] == self.of] = np.inf
        product = np.abs(outside * outside.T) / gap
        result: Array = np.sum(product, axis=1) / np.diag(data)
        return np.nan_to_num(result, nan=np.inf)

    def _turn(self, F: Complex, blocks: npt.NDArray[np.bool_]) -> Complex:
        """Return Δ with which W (1 + Δ) has residuals of second order outside of the blocks: C Δ − Δ C = F there."""
        s = np.diag(self.C)
        gap = s[:, None] - s
        gap[blocks] = np.inf
        turn = np.where(blocks, 0.0, F / gap)
        for g, members in enumerate(self.groups):
            if len(members) == 1:
                continue
            block, one = self.C[_at(members, members)], np.eye(len(members))
            for h, others in enumerate(self.groups):
                if h != g:
                    # The other one may be a block as well: column by column of (C_g ⊗ 1 − 1 ⊗ C_hᵀ).
                    there = self.C[_at(others, others)]
                    both = np.kron(block, np.eye(len(others))) - np.kron(one, there.T)
                    for rows, columns, sign in ((members, others, 1.0), (others, members, -1.0)):
                        at = _at(rows, columns)
                        system = both if sign > 0 else np.kron(there, one) - np.kron(np.eye(len(others)), block.T)
                        try:
                            turn[at] = np.linalg.solve(system, F[at].ravel()).reshape(F[at].shape)
                        except np.linalg.LinAlgError:
                            turn[at] = 0.0
        turn[~(np.abs(turn * turn.T) < FAR)] = 0.0
        return turn

    def rates(self, groups: list[Group]) -> Array:
        """Return for each eigenvalue how far, about, those of its new group spread: a root of what disturbs them."""
        result = np.zeros(len(self.of))
        for members in groups:
            if len(members) > 1:
                at = _at(members, members)
                s, most = self.s[members], np.max(np.nan_to_num(self.E[at], posinf=0.0))
                gap = np.nan_to_num(np.max(np.abs(s[:, None] - s)))
                powers = np.arange(1, len(members)) / np.arange(2.0, len(members) + 1)
                roots = np.exp(powers * np.log(gap) + (1.0 - powers) * np.log(most))
                result[members] = np.max(np.nan_to_num(roots, posinf=0.0))
        return result

    def split(self) -> tuple[Complex, Complex, list[Group], list[int]]:
        """Return bases, blocks, groups and mirror images, with blocks split where their eigenvalues are apart."""
        groups: list[Group] = []
        values = self.s.copy()
        for g, members in enumerate(self.groups):
            if self.mirror[g] < g:
                continue
            at, others = _at(members, members), [self.partner[i] for i in members]
            parts = [members]
            if len(members) > 1 and np.isfinite(self.T[at]).all() and np.isfinite(self.E[at]).all():
                parts = self._parts(members, values, self.mirror[g] == g)
            groups += parts
            if self.mirror[g] != g:
                values[others], self.W[:, others] = values[members].conj(), self.W[:, members].conj()
                self.C[_at(others, others)] = self.C[at].conj()
                groups += [[self.partner[i] for i in part] for part in parts]
        return self.W, self.C, groups, _partners(values)

    def _parts(self, members: Group, values: Complex, real: bool) -> list[Group]:
        """Split a block; return which of its eigenvalues are too near to be told apart."""
        at = _at(members, members)
        T = self.T[at]
        s, X = (x.astype(complex) for x in np.linalg.eig(T.real if real else T))
        partner = _partners(s) if real else list(range(len(s)))
        block, one = np.diag(s), np.eye(len(s))
        groups = _dependent(s, partner, lambda g: X[:, g])
        of = np.zeros(len(s), dtype=int)
        for g, part in enumerate(groups):
            of[part] = g
            if len(part) > 1:
                # What the product of (T − s) over the part makes zero is its subspace.
                product = one
                for k in part:
                    product = product @ (T - s[k] * one)
                    product = product / (np.linalg.norm(product) or 1.0)
                X[:, part] = np.linalg.svd(product)[2][len(s) - len(part) :].conj().T
                block[_at(part, part)] = X[:, part].conj().T @ T @ X[:, part]
        rounding = EPS * (np.abs(T) @ np.abs(X) + np.abs(X) @ np.abs(block)) + np.abs(T @ X - X @ block)
        E = np.abs(_inverse(X)) @ (self.E[at] @ np.abs(X) + rounding)
        near = _near(E, np.abs(s[:, None] - s)) & (of[:, None] != of)
        if not np.isfinite(E).all():
            return [members]
        pairs = [(int(of[i]), int(of[j])) for i, j in zip(*np.nonzero(near), strict=True)]
        parts = _united(groups, pairs, [int(of[partner[part[0]]]) for part in groups])
        if len(parts) == 1:
            return [members]
        values[members], self.W[:, members], self.C[at] = s, self.W[:, members] @ X, block
        return [[members[i] for i in part] for part in parts]

    # --- radii ------------------------------------------------------------------------------------------------------

    def joined(self) -> list[Group] | None:
        """Return larger groups where eigenvalues cannot be told apart, or None; sets the radii."""
        pairs = self._close()
        if not pairs:
            pairs = self._radii()
        if not pairs:
            pairs = self._overlapping()
        if not pairs:
            return None
        groups = _united(self.groups, pairs, self.mirror)
        return groups if len(groups) < len(self.groups) else None

    def _close(self) -> list[tuple[int, int]]:
        """Return pairs of groups that are coupled too strongly for their distance, each the nearest of the other."""
        E, s = np.where(np.isfinite(self.E), self.E, np.inf), self.s
        gap = np.abs(s[:, None] - s)
        near = _near(E, gap)
        near &= self.of[:, None] != self.of
        if not near.any():
            return []
        # What is farther may be told apart when the nearest are judged together.
        gap = np.where(near, np.nan_to_num(gap, nan=1e300), np.inf)
        nearest = np.min(gap, axis=1)
        joined = near & (gap <= 2.0 * np.minimum(nearest[:, None], nearest))
        return [(int(self.of[i]), int(self.of[j])) for i, j in zip(*np.nonzero(np.triu(joined, 1)), strict=True)]

    def _spectrum(self, T: Complex) -> Complex:
        """Return the eigenvalues of blocks, as they are numbered."""
        s = np.diag(T).copy()
        for g, members in enumerate(self.groups):
            if len(members) == 1:
                i = members[0]
                if self.partner[i] == i:
                    s[i] = s[i].real
                continue
            block = T[_at(members, members)]
            if not np.isfinite(block).all():
                s[members] = np.nan
            elif self.mirror[g] == g:
                s[members] = np.linalg.eigvals(block.real)
            elif self.mirror[g] > g:
                s[members] = np.linalg.eigvals(block)
                s[[self.partner[i] for i in members]] = s[members].conj()
        for i, j in enumerate(self.partner):
            if len(self.groups[self.of[i]]) == 1 and i < j:
                s[j] = s[i].conjugate()
        return s

    def _radii(self) -> list[tuple[int, int]]:
        """Find centre and radius for each group; return groups that must be judged together."""
        if len(self.groups) == len(self.W) and self._all_single():
            return []
        pairs: list[tuple[float, int, int]] = []
        for g, members in enumerate(self.groups):
            h = self.mirror[g]
            if h < g:
                self.centres[g], self.radii[g] = self.centres[h].conjugate(), self.radii[h]
                continue
            centre = complex(np.mean(self.s[members]))
            self.centres[g] = centre = complex(centre.real) if h == g else centre
            around = _Around(self, members, centre)
            radius, culprit = self._radius(around) if len(members) == 1 else self._block_radius(around)
            self.radii[g] = radius
            if culprit is not None:
                pairs.append((float(np.nan_to_num(abs(self.s[culprit] - centre))), g, int(self.of[culprit])))
        return [min(pairs)[1:]] if pairs else []

    def _all_single(self) -> bool:
        """Find the radii of all eigenvalues at once, if all can be told apart; see `_radius`."""
        own, one = np.diag(self.E), np.eye(len(self.E), dtype=bool)
        gap = np.abs(self.s[:, None] - self.s)
        radii = own.copy()
        for _ in range(4):
            distance = np.where(one, np.inf, gap - radii)
            if not np.all(distance > 0.0):
                return False
            x = 1.2 * self.E / distance
            y = (self.E + self.E @ x) / distance
            if not np.all(y <= x):
                return False
            new = own + np.sum(self.E * y.T, axis=1)
            if np.all(new <= radii):
                mirror = self.mirror
                self.radii = np.maximum(radii, radii[mirror]) + 2.0 * EPS * np.abs(self.s)
                self.centres = self.s.copy()
                return True
            radii = 1.2 * new
        return False

    def _radius(self, around: _Around) -> tuple[float, int | None]:
        """Return the radius of a circle about an eigenvalue on which no other lies, or with whom there is none."""
        own = radius = float(around.inner[0, 0])
        for _ in range(8):
            size = around.outside(radius)
            if size is None:
                break
            new = own + float(size[0, 0])
            if new <= radius:
                return radius + 2.0 * EPS * abs(around.centre), None
            radius = 1.2 * new
        return math.inf, around.culprit

    def _block_radius(self, around: _Around) -> tuple[float, int | None]:
        """Return the same for a block."""
        members, centre, inner = around.members, around.centre, around.inner
        block = self.T[_at(members, members)]
        if not (np.isfinite(block).all() and np.isfinite(inner).all()):
            return math.inf, around.culprit
        spread = float(np.max(np.abs(self.s[members] - centre)))
        low = max(spread, float(np.max(inner)), EPS * abs(centre), 1e-150)
        high = 0.5 * float(np.min(around.distance, initial=np.inf))
        high = min(high, 1e3 * (low + float(np.linalg.norm(block - centre * np.eye(len(block))))))
        angles = np.exp(2j * np.pi * (np.arange(CIRCLE) + 0.5) / CIRCLE)[:, None, None]

        def clear(radius: float) -> bool:
            size = around.outside(radius)
            if size is None:
                return False
            try:
                resolvent = np.abs(np.linalg.inv((centre + radius * angles) * np.eye(len(members)) - block))
            except np.linalg.LinAlgError:
                return False
            product = resolvent @ (inner + size)
            return bool(np.isfinite(product).all()) and _below(product, MARGIN)

        # Too near the block is in the way, too far the others are.
        middle = 1.2 * low
        while not clear(middle):
            low, middle = middle, 4.0 * middle
            if not middle < high:
                return math.inf, around.culprit
        high = middle
        while high > 1.2 * low:
            middle = math.sqrt(low) * math.sqrt(high)
            if clear(middle):
                high = middle
            else:
                low = middle
        return high * (1.0 + 4.0 * EPS) + 2.0 * EPS * abs(centre), None

    def _overlapping(self) -> list[tuple[int, int]]:
        """Return pairs of groups whose discs meet."""
        apart = np.abs(self.centres[:, None] - self.centres)
        meet = ~(apart > self.radii[:, None] + self.radii)
        meet &= np.isfinite(self.radii)[:, None] & np.isfinite(self.radii)
        return [(int(g), int(h)) for g, h in zip(*np.nonzero(np.triu(meet, 1)), strict=True)]

    def clear(self) -> bool:
        """Whether all eigenvalues are told apart, and from zero."""
        return len(self.groups) == len(self.W) and bool(np.all(self.radii < np.abs(self.s)))

    def spread(self) -> float:
        """Return a measure of how far all eigenvalues may be off."""
        return float(np.sum(np.log(np.clip(self.radii[self.of], 1e-200, 1e200))))

    def misfit(self, j: int, s: complex, pairs: Motions, i: int) -> float:
        """Return how far an eigenvalue may be from a value of another method, by the vector that belongs to it."""
        if len(self.groups[self.of[j]]) > 1:
            return math.inf
        judge, C = self.judge, np.array([[s]])
        x = Motions(*(part[:, [i]] for part in pairs))
        w = Weights(self.w.y[[j]], tuple(y[[j]] for y in self.w.lam), tuple(y[[j]] for y in self.w.mu))
        m, n_h = judge.m, judge.n_h
        slope = w.y @ ((2.0 * s) * (m.M @ x.pos) + m.R @ x.pos) + (w.mu[0] + s * w.mu[1]) @ (m.J[n_h:] @ x.pos)
        result = float(np.abs(judge.residual(x, w, C) / slope)[0, 0]) + float(self.E[j, j])
        return result if math.isfinite(result) else math.inf

    # --- refinement -------------------------------------------------------------------------------------------------

    def refine(self) -> None:
        """Make single eigenvalues more exact that bear the rounding of T and L, or of what is far larger than they are.

        Newton's method on the equations before they are reduced does not see these; it is tried where the errors of
        the data alone would leave much less open, and what it finds counts if it lies in the disc, with its bound.
        """
        judge, s = self.judge, self.s
        rough = [
            g for g, members in enumerate(self.groups)
            if len(members) == 1 and ROUGH * abs(s[members[0]]) < self.radii[g] < min(abs(s[members[0]]), np.inf)
            and self.mirror[g] >= g
        ]  # fmt: skip
        if not rough:
            return
        index = [self.groups[g][0] for g in rough]
        x, w, lam, mu = judge.full(self.V[:, index], self.rows[index], s[index])
        known = judge.spread(x, w, lam, mu, s[index])
        beside = bool(judge.T.shape[1] or len(judge.L))
        hopeful = [
            k for k, g in enumerate(rough)
            if MUCH * known[k] < self.radii[g] or (beside and FEW * abs(s[index[k]]) < self.radii[g])
        ]  # fmt: skip
        if not hopeful:
            return
        problem, kept = judge.quadratic()
        for k in hopeful:
            g, i = rough[k], index[k]
            right = np.concatenate([x.pos[:, k], x.nu[:, k]])
            left = np.concatenate([w[k], lam[k], mu[k]]).conj()
            found = refined(problem, complex(s[i]), right[kept], left[kept])
            if found is None:
                continue
            value, bound, _ = found
            bound += judge.moved(value, right, left)
            if self.mirror[g] == g:
                value, bound = complex(value.real), bound + abs(value.imag)
            off, radius = abs(value - self.centres[g]), float(self.radii[g])
            if off + bound > radius:
                # The disc stays what it is, about the better value.
                bound = radius + off
            if off > SMALL * radius and bound > radius:
                continue
            numbers = {g: value} if self.mirror[g] == g else {g: value, self.mirror[g]: value.conjugate()}
            others = np.array([h not in numbers for h in range(len(self.groups))])
            apart = np.abs(self.centres - value) > self.radii + bound
            if np.all(apart[others]) and (value.imag == 0.0 or abs(value.imag) > bound):
                for h, number in numbers.items():
                    self.s[self.groups[h][0]] = self.centres[h] = number
                    self.radii[h] = bound

    # --- the answer -------------------------------------------------------------------------------------------------

    def _relabel(self) -> None:
        """Give discs of single eigenvalues the values that lie in them: conjugates may have changed places."""
        wrong = [
            g
            for g, members in enumerate(self.groups)
            if len(members) == 1 and abs(self.s[members[0]] - self.centres[g]) > self.radii[g]
        ]
        pool = [self.groups[g][0] for g in wrong]
        chosen = [min(pool, key=lambda i: abs(self.s[i] - self.centres[g])) for g in wrong]
        inside = [abs(self.s[i] - self.centres[g]) <= self.radii[g] for g, i in zip(wrong, chosen, strict=True)]
        if len(set(chosen)) == len(wrong) and all(inside):
            for g, i in zip(wrong, chosen, strict=True):
                self.groups[g] = [i]

    def placed(self) -> Placed:
        """Return values, discs and bounds."""
        self.refine()
        self._relabel()
        values = self.s
        discs, bounds = [], np.full(len(values), np.inf)
        for g, members in enumerate(self.groups):
            radius = float(self.radii[g])
            if not math.isfinite(radius):
                radius = math.inf
            discs.append(Disc(complex(self.centres[g]), radius, tuple(members)))
            bounds[members] = radius + np.abs(values[members] - self.centres[g])
        bounds[~np.isfinite(bounds)] = np.inf
        values = values + 0.0  # no −0
        return Placed(
            values, discs, bounds, _relative(bounds / EPS, values), self.judge.backward(values, self.x),
            self.judge.whole(self.V, values, self.x.pos),
        )  # fmt: skip


def _relative(error: Array, values: Complex) -> Array:
    """Return errors relative to the sizes of eigenvalues, inf at zero."""
    size = np.abs(values)
    result: Array = np.where(size > 0.0, error / np.where(size > 0.0, size, 1.0), np.inf)
    return result


# --- eigenvalues of other methods -----------------------------------------------------------------------------------


def _of_others(judge: _Judge, values: Complex, vectors: Complex) -> Placed:
    """Return bounds for values of another method: how far they are from the default ones, and the bounds of these."""
    found = judge.found()
    own = found.placed()
    T = judge.T
    inner = judge.inside @ T
    zeros = np.linalg.eigvals(inner).astype(complex) if T.shape[1] else np.zeros(0, dtype=complex)
    rounding = SUMMED * EPS * float(np.linalg.norm(inner))
    known = np.concatenate([own.values, zeros, np.zeros(judge.outside.shape[1], dtype=complex)])
    count, size = len(values), max(len(values), len(known))
    distance = np.full((size, size), UNLIKE)
    distance[:count, : len(known)] = np.nan_to_num(np.abs(values[:, None] - known), nan=UNLIKE, posinf=UNLIKE)
    columns = assigned(distance)[:count].tolist() if size else []
    x = vectors[: len(judge.N)] / judge.linear.motion.spaces.scale[:, None]
    pairs = judge.pairs(values, x)
    bounds, neutral = np.full(count, np.inf), []
    for i, j in enumerate(columns):
        if j >= len(known) or not np.isfinite(values[i]):
            continue
        off = float(abs(values[i] - known[j]))
        if j >= len(own.values):
            # One that is nearer to another eigenvalue was lost, and this one is not it.
            if off <= float(np.min(np.abs(own.values - values[i]), initial=np.inf)):
                neutral.append(i)
                bounds[i] = off + rounding + EPS * abs(values[i])
        elif off <= own.bounds[j] + DIFFERENT * found.misfit(j, complex(values[i]), pairs, i):
            bounds[i] = (off + float(own.bounds[j])) * (1.0 + 4.0 * EPS)
    discs = _covering([Disc(complex(values[i]), float(bounds[i]), (i,)) for i in range(count) if i not in neutral])
    condition = _relative(bounds / EPS, values)
    return Placed(values + 0.0, discs, bounds, condition, judge.backward(values, pairs), x, tuple(neutral))


def _covering(discs: list[Disc]) -> list[Disc]:
    """Return discs of which none meets another, each around those that met."""
    left = sorted(discs, key=lambda d: d.radius)
    done: list[Disc] = []
    while left:
        disc = left.pop()
        met = [d for d in done if abs(d.centre - disc.centre) <= d.radius + disc.radius < math.inf]
        if not met:
            done.append(disc)
            continue
        other = met[0]
        done.remove(other)
        apart = abs(other.centre - disc.centre)
        members = other.members + disc.members
        if apart + disc.radius <= other.radius:
            left.append(Disc(other.centre, other.radius, members))
            continue
        radius = 0.5 * (apart + other.radius + disc.radius)
        centre = other.centre + (disc.centre - other.centre) * ((radius - other.radius) / apart)
        left.append(Disc(centre, radius * (1.0 + 4.0 * EPS), members))
    return done
