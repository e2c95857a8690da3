"""QZ on undeflated pencils, for comparison with the default method.

The regular index-3 pencil has infinite eigenvalues in Jordan blocks of size 3 and 2; the
pencil of Eq. (70) of Pappalardo, Lettieri, Guida (2020) is singular, because its last n_c
rows and columns are zero in both matrices, and QZ returns as many pairs 0/0.
"""

from __future__ import annotations

import numpy as np

from mbstab.analysis.algebra.arrays import Complex
from mbstab.analysis.linear.linearize import Linearization
from mbstab.analysis.linear.methods import Found
from mbstab.analysis.linear.tolerances import TOLERANCES
from mbstab.compiler.system import Array
from mbstab.errors import NumericalError


def index3(linear: Linearization, gamma: float, known: Complex) -> Found:
    """Return the finite eigenvalues of the regular index-3 pencil; it is solved in the time unit 1/γ."""
    scale, rows = linear.spaces.scale, linear.spaces.row_scale
    # Coordinates scaled by mass, rows to unit length, speeds in units of γ: y = right · scaled y.
    right = np.concatenate([scale, rows * gamma * gamma, scale * gamma])
    left = np.concatenate([1.0 / scale, scale, rows])
    return _finite(*linear.pencil(), left, right, linear, gamma)


def paper(linear: Linearization, gamma: float, known: Complex) -> Found:
    """Return the finite eigenvalues of the singular pencil of Eq. (70); it is solved in the time unit 1/γ."""
    scale, rows = linear.spaces.scale, linear.spaces.row_scale
    right = np.concatenate([scale, rows * gamma * gamma, scale * gamma, rows * gamma**3])
    left = np.concatenate([scale, rows, scale, rows])
    return _finite(*linear.paper_pencil(), left, right, linear, gamma)


def _finite(A: Array, E: Array, left: Array, right: Array, linear: Linearization, gamma: float) -> Found:
    A, E = A * left[:, None] * right, gamma * E * left[:, None] * right
    alpha, beta, vectors = _qz(A, E)
    size = max(float(np.linalg.norm(A)), float(np.linalg.norm(E)))
    undefined = (np.abs(alpha) < TOLERANCES.zero_pair * size) & (np.abs(beta) < TOLERANCES.zero_pair * size)
    finite = ~undefined & (np.abs(alpha) < TOLERANCES.finite_eigenvalue * np.abs(beta))
    values = gamma * alpha[finite] / beta[finite]
    vectors = (right[:, None] * vectors)[: len(linear.M), finite]
    return Found(values, vectors, int(np.sum(~finite & ~undefined)), int(np.sum(undefined)))


def _qz(A: Array, E: Array) -> tuple[Complex, Complex, Complex]:
    """Return α, β and vectors of a pencil.

    With many infinite eigenvalues the iteration of LAPACK may not converge; other bases, which
    change no eigenvalue, give it another start.

    Raises
    ------
    NumericalError
        If no attempt converges.
    """
    from scipy.linalg import eig

    rng, n = np.random.default_rng(1), len(A)
    left = right = np.eye(n)
    for _ in range(TOLERANCES.qz_attempts):
        try:
            (alpha, beta), vectors = eig(left @ A @ right, left @ E @ right, homogeneous_eigvals=True)
        except np.linalg.LinAlgError:
            left, right = (np.linalg.qr(rng.standard_normal((n, n)))[0] for _ in range(2))
        else:
            return alpha, beta, right @ vectors
    raise NumericalError(
        f"the QZ iteration did not converge in {TOLERANCES.qz_attempts} attempts on a pencil with many infinite "
        "eigenvalues\n"
        "hint: --method nullspace"
    )
