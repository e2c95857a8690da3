"""Linearization of the index-3 equations about a reference motion, and its exact deflation.

    M Δa + R Δu + K Δq + Jᵀ Δν = 0,   C_q Δq = 0,   D_u Δu + D_q Δq = 0

(Pappalardo, Lettieri, Guida 2020, Eqs. (57)-(67)). The deflated system ẏ = S y has exactly
the finite eigenvalues: with N, Z, P of `mbstab.analysis.algebra.subspaces` and y = [ξ; η],

    ξ̇ = P ξ + Z η,   M_z η̇ = −Zᵀ[(M_r P² + R_r P + K_r) ξ + (M_r P + R_r) Z η].
"""

from __future__ import annotations

import math
from dataclasses import field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from mbstab.analysis.algebra.deflation import in_frame, time_scale
from mbstab.analysis.algebra.sparse import dense
from mbstab.analysis.algebra.subspaces import Subspaces
from mbstab.analysis.linear.tolerances import TOLERANCES
from mbstab.analysis.reference.coefficients import Matrices, deflated, matrices_in, multiplier_sizes
from mbstab.analysis.reference.guard import coefficients
from mbstab.analysis.reference.motion import Motion
from mbstab.analysis.reference.steady import Generator
from mbstab.analysis.reference.tolerances import TOLERANCES as REFERENCE
from mbstab.compiler.system import Array, Row, System
from mbstab.model.schema import is_length
from mbstab.records import Answer, dataclass

if TYPE_CHECKING:
    from mbstab.analysis.linear.massless import Massless


def composite(matrices: Matrices) -> tuple[Array, Array, Array]:
    """Return M̄, R̄, K̄ of Eqs. (62)-(67), for [Δq; Δν]."""
    n, c = len(matrices.M), len(matrices.J)
    n_h = c - len(matrices.D_q)
    M, R, K = (np.zeros((n + c, n + c)) for _ in range(3))
    M[:n, :n], R[:n, :n], K[:n, :n] = matrices.M, matrices.R, matrices.K
    R[n + n_h :, :n] = matrices.J[n_h:]
    K[:n, n:] = matrices.J.T
    K[n : n + n_h, :n] = matrices.J[:n_h]
    K[n + n_h :, :n] = matrices.D_q
    return M, R, K


@dataclass(frozen=True)
class Linearization(Answer):
    """Matrices of the linearized equations.

    Attributes
    ----------
    system : System
        The system whose equations they are.
    M, R, K : ndarray, shape (n_q, n_q)
        ∂F/∂a, ∂F/∂u, ∂F/∂q; K contains the multiplier terms ∂(Jᵀν)/∂q.
    J : ndarray, shape (n_c, n_q)
        [C_q; D_u].
    D_q : ndarray, shape (n_n, n_q)
    n_h : int
        Number of holonomic rows.
    names : tuple of str
        Coordinates in the order of q.
    rows : tuple of Row
    motion : Motion
    variation : float
        Relative change of the coefficients along the motion; 0 for a reference at rest.
    generator : Generator or None
        The symmetry that defines the frame of the equations; None: the coordinates of the file.
    frozen : bool
        Whether frozen-time coefficients were requested.
    massless : Massless or None
        Directions without mass, whose rows `J`, `D_q`, `n_h` and `rows` contain; None: there are none.
    kept : dict
        Results for several modules that are computed once, by name; the module that computes one reads and
        writes it.
    """

    system: System
    M: Array
    R: Array
    K: Array
    J: Array
    D_q: Array
    n_h: int
    names: tuple[str, ...]
    rows: tuple[Row, ...]
    motion: Motion
    variation: float
    generator: Generator | None = None
    frozen: bool = False
    massless: Massless | None = None
    kept: dict[str, Any] = field(default_factory=dict, init=False, compare=False, repr=False)

    @property
    def constant(self) -> bool:
        """Whether the coefficients are constant along the motion."""
        return self.variation <= REFERENCE.variation_along_motion

    @property
    def n_f(self) -> int:
        """Number of finite eigenvalues, 2(n_q − rank C_q) − rank(D_u N)."""
        return self.spaces.n_f

    @property
    def spaces(self) -> Subspaces:
        """What all rows allow."""
        return self.motion.spaces if self.massless is None else self.massless.spaces

    @property
    def matrices(self) -> Matrices:
        """M, R, K, J and D_q."""
        return Matrices(self.M, self.R, self.K, self.J, self.D_q)

    @property
    def nu(self) -> Array:
        """Multipliers of all rows at the reference."""
        return self.motion.nu if self.massless is None else self.massless.padded(self.motion.nu)

    def balancing(self, force: Any) -> Any:
        """Return the minimum-norm multipliers of all rows, (…, n_c), that balance forces best, (…, n_q)."""
        nu = self.motion.balancing(force)
        return nu if self.massless is None else self.massless.padded(nu)

    def with_all_rows(self, matrices: Matrices, sizes: bool = False) -> Matrices:
        """Return matrices of the scene, or sizes of their entries, with the rows of directions without mass."""
        return matrices if self.massless is None else self.massless.extended(matrices, sizes)

    @cached_property
    def terms(self) -> Matrices:
        """Sizes of the terms of which M, R, K, J and D_q are sums."""
        return self.with_all_rows(_terms(self.system, self.motion, self.generator), sizes=True)

    @cached_property
    def entries(self) -> Matrices:
        """Sizes of the terms entry by entry, with the actual multipliers: zeros stay zero."""
        motion = self.motion
        found = entries_of(self.system, motion, self.generator, np.abs(motion.nu))
        return self.with_all_rows(found, sizes=True)

    def beside(self, change: Array) -> Matrices:
        """Return M, R, K, J and D_q after a small change of the coordinates, with multipliers that balance there."""
        return self.with_all_rows(_beside(self.system, self.motion, self.generator, change))

    def composite(self) -> tuple[Array, Array, Array]:
        """Return M̄, R̄, K̄ of Eqs. (62)-(67), for [Δq; Δν]."""
        return composite(self.matrices)

    def pencil(self) -> tuple[Array, Array]:
        """Return A, E of the regular index-3 pencil A y = s E y with y = [Δq; Δν; Δu], size 2 n_q + n_c."""
        n, c = len(self.M), len(self.J)
        A, E = np.zeros((2 * n + c, 2 * n + c)), np.zeros((2 * n + c, 2 * n + c))
        q, nu, u = slice(0, n), slice(n, n + c), slice(n + c, 2 * n + c)
        E[:n, q] = np.eye(n)
        A[:n, u] = np.eye(n)
        E[n : 2 * n, u] = self.M
        A[n : 2 * n, q], A[n : 2 * n, nu], A[n : 2 * n, u] = -self.K, -self.J.T, -self.R
        A[2 * n : 2 * n + self.n_h, q] = self.J[: self.n_h]
        A[2 * n + self.n_h :, q] = self.D_q
        A[2 * n + self.n_h :, u] = self.J[self.n_h :]
        return A, E

    def paper_pencil(self) -> tuple[Array, Array]:
        """Return V̄, Ū of Eq. (70); singular whenever there are constraints."""
        M, R, K = self.composite()
        zero = np.zeros_like(M)
        return np.block([[-K, zero], [zero, M]]), np.block([[R, M], [M, zero]])


@dataclass(frozen=True)
class StateSpace:
    """The deflated system ẏ = A y with the maps back to coordinates.

    Attributes
    ----------
    A : ndarray, shape (n_f, n_f)
    n_xi : int
        The first n_xi components of y are positions, the others speeds.
    M_z : ndarray
        Mass matrix of the speeds.
    spaces : Subspaces
        The motions that the constraints allow.
    """

    A: Array
    n_xi: int
    M_z: Array
    spaces: Subspaces

    @cached_property
    def rate(self) -> float:
        """A typical rate (1/s)."""
        return float(time_scale(self.A, self.n_xi))

    @cached_property
    def to_coordinates(self) -> Array:
        """Δq = to_coordinates @ y, shape (n_q, n_f)."""
        scale, N = self.spaces.scale, self.spaces.N
        return scale[:, None] * np.hstack([N, np.zeros((len(scale), self.spaces.Z.shape[1]))])

    @cached_property
    def to_rates(self) -> Array:
        """Δu = to_rates @ y, shape (n_q, n_f)."""
        return self.spaces.scale[:, None] * (self.spaces.N @ self.A[: self.n_xi])


def linearize(system: System, motion: Motion, frozen: bool = False) -> Linearization:
    """Return the linearized equations about a reference motion, and their variation along it.

    The equations are written in the co-moving frame; of the symmetries
    that the motion may follow, the first one with constant coefficients is taken.

    Parameters
    ----------
    frozen : bool
        Use the coefficients at the reference time, in the coordinates of the file.

    Raises
    ------
    ModelFileError
        If the file declares a steady motion whose symmetry the scene does not have; names what breaks it.
    MassError
        If nothing determines a motion without mass; names body and coordinate.
    """
    variation, generator, matrices = coefficients(system, motion, frozen)
    names, plain = tuple(system.names), motion.spaces.plain
    if motion.massless is None:
        better = TOLERANCES.better_scale
        if plain is not None and better * _fastest(matrices, plain) < _fastest(matrices, motion.spaces):
            motion = motion.scaled(plain)
        rows = tuple(system.rows)
        return Linearization(system, *matrices, system.n_h, names, rows, motion, variation, generator, frozen)
    terms = entries_of(system, motion, generator, multiplier_sizes(system, motion))
    from mbstab.analysis.linear.massless import massless

    light = massless(system, motion, matrices, terms, generator is not None)
    n_h = system.n_h + len(light.algebraic)
    matrices = light.extended(matrices)
    return Linearization(system, *matrices, n_h, names, light.rows, motion, variation, generator, frozen, light)


def _fastest(matrices: Matrices, spaces: Subspaces) -> float:
    """Return the largest rate in the scaled equations before they are reduced, which multiplies rounding of bases."""
    scale, n_h = spaces.scale, len(matrices.J) - len(matrices.D_q)
    with np.errstate(over="ignore", invalid="ignore"):
        M, R, K = (x * scale * scale[:, None] for x in matrices[:3])
        D_q = matrices.D_q * scale * spaces.row_scale[n_h:, None]
    if not all(np.isfinite(x).all() for x in (M, R, K, D_q)):
        return math.inf
    M_z = spaces.allowed.T @ M @ spaces.allowed
    least = float(np.linalg.eigvalsh(M_z)[0]) if len(M_z) else 1.0
    if not least > 0.0:
        return math.inf
    norms = [float(np.linalg.norm(x, 2)) if x.size else 0.0 for x in (K, R, D_q)]
    return max(math.sqrt(norms[0] / least), norms[1] / least, norms[2] / spaces.W.smallest_kept if len(D_q) else 0.0)


def _terms(system: System, motion: Motion, generator: Generator | None) -> Matrices:
    """Return the sizes of the terms of which the coefficients are sums, the same for all directions of a body."""
    nu = multiplier_sizes(system, motion)
    M, R, K, J, D_q = map(dense, entries_of(system, motion, generator, nu))
    # Rotated axes mix the directions of a body: none of them is known better than the others.
    kinds = [(name.partition(".")[0], is_length(name)) for name in system.names]
    first = [i for i, kind in enumerate(kinds) if i == 0 or kind != kinds[i - 1]]
    counts = np.diff([*first, len(kinds)])
    M, R, K, J, D_q = (np.repeat(np.maximum.reduceat(x, first, axis=1), counts, axis=1) for x in (M, R, K, J, D_q))
    M, R, K = (np.repeat(np.maximum.reduceat(x, first, axis=0), counts, axis=0) for x in (M, R, K))
    return Matrices(M, R, K, J, D_q)


def entries_of(system: System, motion: Motion, generator: Generator | None, nu: Array) -> Matrices:
    """Return the sizes of the terms of which the coefficients are sums, as `matrices_in`, for sizes of multipliers."""
    found = system.terms(motion.q, motion.u, motion.a, nu, motion.time)
    M, R, K, J, D_q = (found[key] for key in "MRKJD")
    if generator is not None and generator.turns:
        Xi, Xi_2 = (np.abs(x) for x in generator.frame(motion.q))
        R, K, D_q = in_frame(M, R, K, J[..., system.n_h :, :], D_q, Xi, Xi_2)
    return Matrices(M, R, K, J, D_q)


def _beside(system: System, motion: Motion, generator: Generator | None, change: Array) -> Matrices:
    """Return the coefficients near the motion, where other multipliers balance the forces."""
    q, u, a = motion.q + change, motion.u, motion.a
    state = system.dynamics(q, u, motion.time)
    nu = motion.nu + motion.balancing(state.F0 + state.M @ a + state.J.T @ motion.nu)
    return matrices_in(system, replace(motion, q=q, nu=nu, dynamics=state), generator)


def state_space(linear: Linearization) -> StateSpace:
    """Return the deflated system; all its eigenvalues are finite, and they are all finite eigenvalues."""
    spaces = linear.spaces
    A, M_z = deflated(spaces, linear.matrices)
    return StateSpace(A, spaces.N.shape[1], M_z, spaces)
