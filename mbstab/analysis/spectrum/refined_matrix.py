"""The matrix of the linearized motion in refined numbers: with many digits, or with derivatives by parameters."""

from __future__ import annotations

import numpy as np

from mbstab.analysis.algebra.deflation import in_frame, on_speeds, restricted
from mbstab.analysis.algebra.refining import Matrix, Refining, Stalled
from mbstab.analysis.algebra.subspaces import Subspaces
from mbstab.analysis.linear.massless import Massless
from mbstab.analysis.spectrum.precise_motion import Point, Start
from mbstab.compiler.system import System
from mbstab.errors import NumericalError


def state_matrix(start: Start, system: System, point: Point, f: Refining, spaces: Subspaces) -> Matrix:
    """Return S of ẏ = S y for a basis that is nearly orthonormal (`mbstab.analysis.linear.linearize`).

    Parameters
    ----------
    spaces : Subspaces
        Those of the linearization, or the same in another basis.

    Raises
    ------
    Stalled
        If the rank of the rows differs from that in double precision.
    """
    n_h, light = system.n_h, start.linear.massless
    K, R, D_q = (f.exact(x) for x in system.linearize(point.q, point.u, point.a, point.nu, system.scene.time))
    M, J = f.exact(point.state.M), f.exact(point.state.J)
    if point.generator is not None:
        Xi, Xi_2 = (f.exact(x) for x in point.generator.frame(point.q))
        R, K, D_q = in_frame(M, R, K, J[n_h:], D_q, Xi, Xi_2, f)
    gamma = start.grounds.gamma  # the unit of speeds
    if light is not None:
        algebraic, first = refined_directions(light, M, R, J, f)
        J = f.exact(np.vstack([J[:n_h], f.times(algebraic, K), J[n_h:], f.times(first, R)]))
        D_q = f.exact(np.vstack([D_q, f.times(first, K)]))
    return deflated(spaces, gamma, (M, R, K), J, D_q, f)


def refined_directions(light: Massless, M: Matrix, R: Matrix, J: Matrix, f: Refining) -> tuple[Matrix, Matrix]:
    """Return the algebraic and the first-order directions without mass as rows, from J of the constraints alone.

    Along them M N₀ = 0 and J N₀ = 0; to those that are algebraic the others are added so that Gᵀ N₀ᵀ R N₀ = 0 remains
    (`mbstab.analysis.linear.massless`).

    Raises
    ------
    Stalled
        If they carry mass, or are held, by more than in double precision.
    """
    if light.exact:
        return f.exact(light.algebraic), f.exact(light.first_order)
    scale, count = light.spaces.scale, len(light.algebraic)
    found = np.vstack([light.algebraic, light.first_order]).T
    rows = np.vstack([M, J])
    plain = np.asarray(f.values(rows), dtype=float) * scale
    lengths = np.maximum(np.linalg.norm(plain, axis=1), np.finfo(float).tiny)
    left, s, right = np.linalg.svd(plain / lengths[:, None])
    rank = len(found) - found.shape[1]
    inverse = (right[:rank].T / s[:rank]) @ left[:, :rank].T / lengths * scale[:, None]
    moved = f.null_space(rows, found, inverse)
    algebraic, first = moved[:, :count].T, moved[:, count:].T
    if count and len(first):
        damping = f.times(first, R, moved)
        mixed = f.times(algebraic, R, moved)
        back = np.linalg.pinv(np.asarray(f.values(damping), dtype=float).T)
        algebraic = algebraic - f.times(f.solved(damping.T, mixed.T, back).T, first)
    return algebraic, first


def deflated(
    spaces: Subspaces, gamma: float, matrices: tuple[Matrix, Matrix, Matrix], J: Matrix, D_q: Matrix, f: Refining
) -> Matrix:
    """Return S from M, R and K, the constraint rows and ∂D/∂q.

    Raises
    ------
    Stalled
        If the rank of the rows differs from that in double precision.
    """
    scale, row_scale, n_h = spaces.scale, spaces.row_scale, len(J) - len(D_q)
    M, R, K = (x * scale * scale[:, None] for x in matrices)
    J = J * scale * row_scale[:, None]
    D_q = D_q * scale * row_scale[n_h:, None]
    N = f.null_space(J[:n_h], spaces.N, spaces.C.pseudo_inverse)
    W, drift = f.times(J[n_h:], N), f.times(D_q, N)
    Z = f.null_space(W, spaces.Z, spaces.W.pseudo_inverse)
    P = -f.solved(W, drift, spaces.W.pseudo_inverse)
    M_z, K_z, R_z = on_speeds(*restricted(M, R, K, N, f), Z, P, f)
    n, lower = N.shape[1], np.hstack([K_z, R_z])
    if M_z.size:
        try:
            lower = -f.solved(M_z, lower, np.linalg.inv(M_z.astype(float)))
        except (Stalled, np.linalg.LinAlgError):
            raise NumericalError("the mass matrix of the motions that are allowed is singular") from None
    S = np.vstack([np.hstack([P, Z]), lower])
    weights = np.ones(len(S))
    weights[n:] = gamma
    return f.exact(S * weights / weights[:, None])
