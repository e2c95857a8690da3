"""The five standard techniques: accelerations as explicit functions of the state, and their exact derivatives.

The augmented formulation and the embedding, amalgamated, projection and Udwadia-Kalaba
techniques (Pappalardo, Lettieri, Guida 2020, Eqs. (37)-(38) and (154)-(172); Shabana,
Computational Dynamics; Wehage and Haug 1982, J. Mech. Design 104; Udwadia and Kalaba 1992,
Proc. R. Soc. A 439) solve

    M a + Jᵀ ν = Q_b,   J a = Q_d                                           (33)

for a(q, u, t). With ∂a/∂q and ∂a/∂u, a disturbance obeys ż = [0, I; ∂a/∂q, ∂a/∂u] z, of size
2 n_q: besides the eigenvalues of the system, this has those of constraint drift, C̈ = 0 and
Ḋ = 0, two for each independent holonomic row and one for each nonholonomic one.

Derivatives. Each technique is differentiated step by step with its own factors, by
d(A⁻¹b) = A⁻¹(db − dA A⁻¹b). It needs only products of dM and dJ with vectors that it has
computed itself, and these come from the kernels, which are linear in a and ν:

    ∂F(a, ν) = dM a − dQ_b + dJᵀ ν,   ∂A(a) = dJ a − dQ_d.

With J_c = [J; B_i], J̄ = J_c⁻¹ [0; I] and w̄ = J_c⁻¹ [−Q_d; 0] of Eqs. (154)-(156) that is, at
fixed accelerations a_i of the independent coordinates and for any force p,

    dJ̄ a_i − dw̄ = −J_c⁻¹ [∂A(a); 0]   with a = J̄ a_i − w̄,
    dJ̄ᵀ p = −J̄ᵀ dJᵀ ν   with [ν; ·] = J_c⁻ᵀ p.

Scales. Everything is done in the coordinates and rows of `mbstab.analysis.algebra.subspaces`: scaled
by masses, rows of unit length. This compares the techniques, not the units of a
file; M + JᵀJ of Eq. (171) in other units would weigh constraints against masses arbitrarily.

Ranks. Udwadia and Kalaba's equation takes the pseudo-inverse of a matrix of the rank that the
reference motion; the others need independent rows and refuse redundant ones. None needs
M⁻¹: coordinates may have no mass as long as every allowed motion has.

Steady motions. Along a motion that turns, Δq = DΦ_t z as in `mbstab.analysis.reference.steady`:

    z̈ = (∂a/∂q + ∂a/∂u Ξ − Ξ₂) z + (∂a/∂u − 2 Ξ) ż.

Constraints that rotate with the frame drift with it: their eigenvalues are ±iω, not 0.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import numpy.typing as npt

from mbstab.analysis.algebra.arrays import Complex
from mbstab.analysis.algebra.matching import assigned
from mbstab.analysis.algebra.rank import Rank, rank_of
from mbstab.analysis.algebra.sparse_rank import SparseRank
from mbstab.analysis.algebra.tolerances import EPS
from mbstab.analysis.linear.linearize import Linearization
from mbstab.analysis.linear.methods import Found
from mbstab.analysis.linear.tolerances import TOLERANCES
from mbstab.compiler.system import Array, System
from mbstab.errors import NumericalError, UsageError
from mbstab.records import dataclass


@dataclass(frozen=True)
class Basis:
    """What is fixed while a state varies: scales and the choice of independent coordinates.

    Attributes
    ----------
    system : System
    scale : ndarray, shape (n_q,)
        q = scale · scaled q.
    row_scale : ndarray, shape (n_c,)
        Factors of the rows.
    rank : int
        Rank of J.
    independent : ndarray of int, shape (n_q − rank,)
        The rows of B_i in Eq. (154).
    """

    system: System
    scale: Array
    row_scale: Array
    rank: int
    independent: npt.NDArray[np.intp]


def basis_of(linear: Linearization) -> Basis:
    """Return scales and independent coordinates at the reference motion.

    The independent coordinates are those without a pivot in elimination with the largest pivots
    (Wehage and Haug 1982).
    """
    from scipy.linalg import qr

    spaces = linear.spaces
    rank = spaces.C.rank + spaces.W.rank
    order = np.arange(len(linear.M))
    if rank:
        order = qr(linear.J * spaces.scale * spaces.row_scale[:, None], mode="r", pivoting=True)[1]
    return Basis(linear.system, spaces.scale, spaces.row_scale, rank, np.sort(order[rank:]))


@dataclass(frozen=True)
class Equations:
    """M a + Jᵀ ν = Q_b and J a = Q_d at a state, in scaled coordinates and rows, with their derivatives.

    Attributes
    ----------
    basis : Basis
    q, u : ndarray, shape (n_q,)
        Coordinates (m, rad) and speeds, not scaled.
    time : float (s)
    M, Q_b, J, Q_d : ndarray
    """

    basis: Basis
    q: Array
    u: Array
    time: float
    M: Array
    Q_b: Array
    J: Array
    Q_d: Array

    def force_slope(self, a: Array, nu: Array) -> Array:
        """Return ∂(M a + Jᵀ ν − Q_b)/∂[q, u] at fixed a and ν, shape (n_q, 2 n_q)."""
        b = self.basis
        K, R, _ = b.system.linearize(self.q, self.u, a * b.scale, nu * b.row_scale, self.time)
        result: Array = np.hstack([K * b.scale, R * b.scale]) * b.scale[:, None]
        return result

    def row_slope(self, a: Array) -> Array:
        """Return ∂(J a − Q_d)/∂[q, u] at fixed a, shape (n_c, 2 n_q)."""
        b = self.basis
        _, A_q, A_u = b.system.linearize_rows(self.q, self.u, a * b.scale, self.time)
        result: Array = np.hstack([A_q * b.scale, A_u * b.scale]) * b.row_scale[:, None]
        return result


def equations(basis: Basis, q: Array, u: Array, time: float) -> Equations:
    """Return the equations at a state (m, rad, s), which need not satisfy the constraints."""
    state, s = basis.system.dynamics(q, u, time), basis.scale
    return Equations(
        basis, q, u, time, state.M * s * s[:, None], -state.F0 * s, state.J * s * basis.row_scale[:, None],
        -state.B * basis.row_scale,
    )  # fmt: skip


Solution = tuple[Array, Callable[[], Array]]
"""Accelerations a, shape (n_q,), and a function that returns ∂a/∂[q, u], shape (n_q, 2 n_q)."""


class Technique:
    """One of the five: a method of `mbstab.analysis.linear.methods`, made from the function that solves Eq. (33).

    Attributes
    ----------
    solve : callable
        Maps `Equations` to a `Solution`.
    needs_independent_rows : bool
    """

    def __init__(self, solve: Callable[[Equations], Solution], needs_independent_rows: bool = True) -> None:
        self.solve, self.needs_independent_rows = solve, needs_independent_rows
        self.name = solve.__name__.replace("_", "-")
        self.__doc__ = solve.__doc__

    def accelerations(self, basis: Basis, q: Array, u: Array, time: float) -> Array:
        """Return a(q, u, t) as the technique computes it, shape (n_q,), in m/s² and rad/s²."""
        a, _ = self.solve(equations(basis, q, u, time))
        return a * basis.scale

    def slopes(self, basis: Basis, q: Array, u: Array, time: float) -> tuple[Array, Array]:
        """Return ∂a/∂q and ∂a/∂u of that function, shape (n_q, n_q)."""
        _, derivative = self.solve(equations(basis, q, u, time))
        A_q, A_u = (x * basis.scale[:, None] / basis.scale for x in np.hsplit(derivative(), 2))
        return A_q, A_u

    def state_matrix(self, linear: Linearization) -> Array:
        """Return the matrix of ż = A z with z = [Δq; Δu] at the reference motion, shape (2 n_q, 2 n_q).

        For a steady motion that turns, the state is [z; ż] in the co-moving frame.

        Raises
        ------
        UsageError
            If the coefficients are not constant.
        NumericalError
            If rows are redundant and the technique needs independent ones.
        """
        self._check(linear)
        motion, n = linear.motion, len(linear.M)
        A_q, A_u = self.slopes(basis_of(linear), motion.q, motion.u, motion.time)
        if linear.generator is not None and linear.generator.turns:
            Xi, Xi_2 = linear.generator.frame(motion.q)
            A_q, A_u = A_q + A_u @ Xi - Xi_2, A_u - 2.0 * Xi
        return np.block([[np.zeros((n, n)), np.eye(n)], [A_q, A_u]])

    def __call__(self, linear: Linearization, gamma: float, known: Complex) -> Found:
        """Return those of the 2 n_q eigenvalues that do not belong to constraint drift, and the error of those that do.

        Each is paired with a known one or with an exact one of drift, so that the sum of
        all distances is least. Zeros of both kinds cannot be distinguished: their assignment is arbitrary.
        """
        scale = np.concatenate([linear.spaces.scale, linear.spaces.scale * gamma])
        A = self.state_matrix(linear) * scale / scale[:, None]
        values = np.linalg.eigvals(A).astype(complex)
        exact = drift(linear)
        distance = np.abs(values[:, None] - np.concatenate([known, exact])[None, :])
        columns = assigned(distance)
        extra = columns >= len(known)
        off = float(np.max(distance[np.arange(len(values)), columns][extra], initial=0.0))
        values = values[~extra]
        vectors = scale[:, None] * _vectors(A, values)
        return Found(values, vectors[: len(linear.M)], extra=len(exact), extra_error=off)

    def _check(self, linear: Linearization) -> None:
        if not linear.constant:
            raise UsageError(
                f"--method {self.name} needs constant coefficients: its constraints are those of accelerations, and "
                "frozen in time they differ from those of coordinates\nhint: --method nullspace"
            )
        motion = linear.motion
        if linear.massless is not None:
            raise UsageError(
                f"--method {self.name} needs motions that carry mass; without it: {'; '.join(linear.massless.names)}\n"
                "hint: --method nullspace or index3"
            )
        if motion.redundant and self.needs_independent_rows:
            rank = motion.spaces.C.rank + motion.spaces.W.rank
            repeated = "; ".join(str(item) for item in motion.redundant)
            raise NumericalError(
                f"--method {self.name} needs independent constraint rows, but {len(linear.J)} rows have rank {rank}: "
                f"{repeated}\nhint: free what a joint restricts twice, or --method udwadia-kalaba, which takes a "
                "pseudo-inverse, or nullspace"
            )


def drift(linear: Linearization) -> Complex:
    """Return the exact eigenvalues of constraint drift, shape (2 n_q − n_f,).

    A symmetry Φ_t maps constraint rows to each other, J(Φ_t q) DΦ_t = T(t) J(q), so that a drift
    at a constant rate is T(t)⁻¹ times that rate in the co-moving frame: Ċ and D have the
    eigenvalues of −Ṫ, and C has the same ones.
    """
    motion, spaces, n_h = linear.motion, linear.spaces, linear.n_h
    V_q, _, A_u = linear.system.linearize_rows(motion.q, motion.u, motion.a, motion.time)
    rate = A_u - V_q  # dJ/dt along the motion
    if linear.generator is not None and linear.generator.turns:
        rate = rate + linear.J @ linear.generator.frame(motion.q)[0]
    rate = rate * spaces.scale * spaces.row_scale[:, None]
    C, D = _row_rates(rate[:n_h], spaces.C), _row_rates(rate[n_h:] @ spaces.N, spaces.W)
    return -np.concatenate([C, C, D])


def _vectors(A: Array, values: Complex) -> Complex:
    """Return eigenvectors of A for given eigenvalues by inverse iteration, as columns.

    LAPACK balances a matrix before it computes vectors, mistakes rounding beside zeros for bad scaling
    and may return wrong vectors (Watkins 2006, ETNA 23); its eigenvalues are not affected.
    """
    n, rng = len(A), np.random.default_rng(1)
    shift = EPS * float(np.linalg.norm(A))
    found = np.zeros((n, len(values)), dtype=complex)
    for j, s in enumerate(values):
        B = A - (s + shift) * np.eye(n)
        x = rng.standard_normal(n).astype(complex)
        best = np.inf
        for _ in range(TOLERANCES.inverse_steps):
            try:
                x = np.linalg.solve(B, x / np.linalg.norm(x))
            except np.linalg.LinAlgError:
                if not shift:
                    raise
                B -= shift * np.eye(n)  # the shift hit an eigenvalue of the rounded matrix
                continue
            residual = 1.0 / float(np.linalg.norm(x))  # of x as a vector of length 1
            if residual < best:
                best, found[:, j] = residual, x / np.linalg.norm(x)
    return found


def _row_rates(rate: Array, rows: Rank | SparseRank) -> Complex:
    """Return the eigenvalues of G in rate = G · rows, on the row space."""
    kept = rank_of(rows.left_null.T).null
    result: Complex = np.linalg.eigvals(kept.T @ rate @ rows.pseudo_inverse @ kept).astype(complex)
    return result


# --- the techniques -------------------------------------------------------------------------------------------------


def _solve(A: Array, b: Array) -> Array:
    """Return A⁻¹ b.

    Raises
    ------
    NumericalError
        If A is singular.
    """
    try:
        return np.asarray(np.linalg.solve(A, b), dtype=np.float64)
    except np.linalg.LinAlgError:
        raise NumericalError(
            f"the {len(A)} equations for the accelerations are singular at this state\n"
            "hint: dependent constraint rows, or a motion without mass; mbstab check names them at the reference"
        ) from None


@Technique
def augmented(eq: Equations) -> Solution:
    """Augmented formulation, Eqs. (37)-(38): [M, Jᵀ; J, 0] [a; ν] = [Q_b; Q_d]."""
    n, c = len(eq.M), len(eq.J)
    matrix = np.block([[eq.M, eq.J.T], [eq.J, np.zeros((c, c))]])
    unknown = _solve(matrix, np.concatenate([eq.Q_b, eq.Q_d]))
    a, nu = unknown[:n], unknown[n:]

    def derivative() -> Array:
        return _solve(matrix, -np.vstack([eq.force_slope(a, nu), eq.row_slope(a)]))[:n]

    return a, derivative


class _Embedding:
    """J_c, J̄ and w̄ of Eqs. (154)-(156), and products with their derivatives."""

    def __init__(self, eq: Equations) -> None:
        n, independent = len(eq.M), eq.basis.independent
        self.eq, self.n_c = eq, len(eq.J)
        self.J_c = np.vstack([eq.J, np.eye(n)[independent]])
        ones = np.zeros((n, len(independent)))
        ones[self.n_c :] = np.eye(len(independent))
        self.J_bar = _solve(self.J_c, ones)
        self.w_bar = self._of_rows(-eq.Q_d)

    def _of_rows(self, rows: Array) -> Array:
        """Return J_c⁻¹ [rows; 0]."""
        filled = np.zeros((len(self.J_c), *rows.shape[1:]))
        filled[: self.n_c] = rows
        return _solve(self.J_c, filled)

    def change(self, a: Array) -> Array:
        """Return ∂(J̄ a_i − w̄) at fixed a_i, where a = J̄ a_i − w̄."""
        return -self._of_rows(self.eq.row_slope(a))

    def multipliers(self, force: Array) -> Array:
        """Return ν with ∂J̄ᵀ force = −J̄ᵀ ∂Jᵀ ν."""
        return _solve(self.J_c.T, force)[: self.n_c]


@Technique
def embedding(eq: Equations) -> Solution:
    """Embedding technique, Eqs. (154)-(159): M_ii a_i = Q_i and a = J̄ a_i − w̄."""
    e = _Embedding(eq)
    M_ii = e.J_bar.T @ eq.M @ e.J_bar
    a_i = _solve(M_ii, e.J_bar.T @ (eq.Q_b + eq.M @ e.w_bar))
    a = e.J_bar @ a_i - e.w_bar

    def derivative() -> Array:
        # ∂Q_i − ∂M_ii a_i = ∂J̄ᵀ(Q_b − M a) + J̄ᵀ(∂Q_b − ∂M a) − J̄ᵀ M (∂J̄ a_i − ∂w̄)
        change = e.change(a)
        forces = eq.force_slope(a, e.multipliers(eq.Q_b - eq.M @ a)) + eq.M @ change
        return e.J_bar @ _solve(M_ii, -(e.J_bar.T @ forces)) + change

    return a, derivative


@Technique
def amalgamated(eq: Equations) -> Solution:
    """Amalgamated formulation, Eqs. (160)-(165): a, the constraint forces and a_i from one system."""
    e = _Embedding(eq)
    n, i = e.J_bar.shape
    matrix = np.zeros((2 * n + i, 2 * n + i))
    matrix[:n, :n] = eq.M
    matrix[:n, n : 2 * n] = matrix[n : 2 * n, :n] = np.eye(n)
    matrix[n : 2 * n, 2 * n :] = -e.J_bar
    matrix[2 * n :, n : 2 * n] = -e.J_bar.T
    unknown = _solve(matrix, np.concatenate([eq.Q_b, -e.w_bar, np.zeros(i)]))
    a, force = unknown[:n], unknown[n : 2 * n]

    def derivative() -> Array:
        free = eq.force_slope(a, np.zeros(e.n_c))
        turned = eq.force_slope(a, e.multipliers(force)) - free  # ∂Jᵀ ν
        return _solve(matrix, np.vstack([-free, e.change(a), -(e.J_bar.T @ turned)]))[:n]

    return a, derivative


@Technique
def projection(eq: Equations) -> Solution:
    """Projection method, Eqs. (166)-(170): [J̄ᵀ M; J] a = [J̄ᵀ Q_b; Q_d]."""
    e = _Embedding(eq)
    matrix = np.vstack([e.J_bar.T @ eq.M, eq.J])
    a = _solve(matrix, np.concatenate([e.J_bar.T @ eq.Q_b, eq.Q_d]))

    def derivative() -> Array:
        forces = e.J_bar.T @ eq.force_slope(a, e.multipliers(eq.Q_b - eq.M @ a))
        return _solve(matrix, -np.vstack([forces, eq.row_slope(a)]))

    return a, derivative


@partial(Technique, needs_independent_rows=False)
def udwadia_kalaba(eq: Equations) -> Solution:
    """Udwadia and Kalaba's equation with the mass matrix M* = M + JᵀJ, Eqs. (171)-(172).

    With Q_b* = Q_b + Jᵀ Q_d, a₀ = M*⁻¹ Q_b* and G = J M*⁻¹ Jᵀ it is a = a₀ + M*⁻¹ Jᵀ G⁺ (Q_d − J a₀); the paper
    prints the pseudo-inverse of J M* Jᵀ, which satisfies no constraint. Of the derivative of a pseudo-inverse of
    constant rank (Golub and Pereyra 1973, SIAM J. Numer. Anal. 10),

        dG⁺ = −G⁺ dG G⁺ + G⁺ G⁺ dG (I − G G⁺) + (I − G⁺ G) dG G⁺ G⁺,

    the second term is applied to Q_d − J a₀, which lies in the range of G if accelerations exist, and the
    third one is multiplied by Jᵀ, whose null space is that of G: only the first one remains.
    """
    M_star = eq.M + eq.J.T @ eq.J
    lift = _solve(M_star, eq.J.T)
    inverse = _pseudo_inverse(eq.J @ lift, eq.basis.rank)
    a_0 = _solve(M_star, eq.Q_b + eq.J.T @ eq.Q_d)
    rho = inverse @ (eq.Q_d - eq.J @ a_0)
    a = a_0 + lift @ rho

    def derivative() -> Array:
        # ∂Q_b* + ∂Jᵀ ρ − ∂M* a: the rounding error Q_d − J a belongs to the multipliers.
        rows = eq.row_slope(a)
        forces = eq.force_slope(a, eq.J @ a - eq.Q_d - rho) + eq.J.T @ rows
        at_fixed_rho = -_solve(M_star, forces)
        result: Array = at_fixed_rho - lift @ (inverse @ (rows + eq.J @ at_fixed_rho))
        return result

    return a, derivative


def _pseudo_inverse(G: Array, rank: int) -> Array:
    """Return the pseudo-inverse of a symmetric matrix of a known rank."""
    values, vectors = np.linalg.eigh(0.5 * (G + G.T))
    kept = slice(len(G) - rank, None)
    return np.asarray((vectors[:, kept] / values[kept]) @ vectors[:, kept].T, dtype=np.float64)
