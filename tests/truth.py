"""Eigenvalues of a model to 50 digits, by elimination in multiprecision arithmetic: the truth for double precision.

Nothing here is shared with `mbstab.analysis`: the constraints are eliminated by solving for some of the coordinates
(no orthonormal bases, no scaling), and the rounding of what remains is far below what is asked for. Only the matrices
come from the program's kernels, run on mpmath numbers.
"""

import mpmath
import numpy as np
import scipy.linalg
from mpmath import mp

from mbstab.compiler.system import System
from mbstab.model.arithmetic import mpmath_arithmetic
from mbstab.model.values import evaluate

DIGITS = 50
WORKING_DIGITS = 90
ZERO = 1e-15
"""Zero eigenvalues in Jordan blocks of size 5 come out as 1e-90 to the power 1/5; others are larger than this."""


def exact_eigenvalues(model, **parameters):
    """Return the eigenvalues of a model that are not zero, as mpmath numbers, and how many are zero.

    Parameters are texts in SI units. Missing coordinates are solved for by Newton's method from ``reference.guess``.
    """
    with mp.workdps(WORKING_DIGITS):
        overrides = {name: mp.mpf(value) for name, value in parameters.items()}
        A, moving = _state_matrix(System(evaluate(model, overrides, mpmath_arithmetic())))
        if not A.size:
            return [], 0
        if moving:
            values = _eigenvalues(A)
        else:
            half = len(A) // 2
            values = [sign * mp.sqrt(s) for s in _eigenvalues(A[half:, :half]) for sign in (1, -1)]
        size = max(abs(value) for value in values)
        kept = [value for value in values if abs(value) > ZERO * size]
        return kept, len(values) - len(kept)


def _eigenvalues(A):
    # mpmath returns a matrix with one entry as its own eigenvector.
    return mp.eig(mp.matrix(A.tolist()), left=False, right=False) if len(A) > 1 else [A[0, 0]]


def _state_matrix(system):
    """Return A of ẏ = A y, y = [free coordinates; free speeds], and whether speeds enter otherwise than as ẋ = u."""
    n, n_h = system.n_q, system.n_h
    q, u = _reference(system)
    state = system.dynamics(q, u)
    M, J = state.M + mp.zero, state.J + mp.zero
    rows = _independent(J.T)
    unknown = solve(
        np.block([[M, J[rows].T], [J[rows], zeros(len(rows), len(rows))]]), -np.concatenate([state.F0, state.B[rows]])
    )
    a, nu = unknown[:n], zeros(system.n_c)
    nu[rows] = unknown[n:]
    K, R, D_q = system.linearize(q, u, a, nu)
    N = _null(J[:n_h])
    W, drift = J[n_h:] @ N, (D_q + mp.zero) @ N
    Z = _null(W)
    P = zeros(N.shape[1], N.shape[1])
    if len(W):
        lines = _independent(W.T)
        pivots = _independent(W[lines])
        P[pivots] = -solve(W[np.ix_(lines, pivots)], drift[lines])
    M, R, K = (N.T @ (x + mp.zero) @ N for x in (M, R, K))
    inertia = M @ P + R
    right = np.hstack([Z.T @ (inertia @ P + K), Z.T @ inertia @ Z])
    lower = -solve(Z.T @ M @ Z, right) if Z.shape[1] else zeros(0, N.shape[1])
    A = np.vstack([np.hstack([P, Z]), lower])
    moving = bool(len(W)) or any(x != 0 for x in lower[:, N.shape[1] :].flat)
    return A, moving


def _reference(system):
    """Return q and u with 90 digits: given values as they are, the others from the constraints."""
    scene, n_h = system.scene, system.n_h
    q = np.array([mp.mpf(scene.coordinates.get(name, scene.guess.get(name, 0))) for name in system.names])
    u = np.array([mp.mpf(scene.rates.get(name, 0)) for name in system.names])
    missing = [i for i, name in enumerate(system.names) if name not in scene.coordinates]
    for _ in range(60 if missing and n_h else 0):
        state = system.dynamics(q, 0 * u)
        step = _least_change(state.J[:n_h][:, missing] + mp.zero, -state.E[:n_h])
        q[missing] += step
        if all(abs(x) < mp.mpf(10) ** (5 - WORKING_DIGITS) for x in step):
            break
    missing = [i for i, name in enumerate(system.names) if name not in scene.rates]
    if missing and system.n_c:
        state = system.dynamics(q, u)
        u[missing] += _least_change(state.J[:, missing] + mp.zero, -state.V)
    return q, u


def _least_change(J, right):
    rows = _independent(J.T)
    return J[rows].T @ solve(J[rows] @ J[rows].T, right[rows])


def zeros(*shape):
    return np.full(shape, mp.zero, dtype=object)


def _independent(A):
    """Return the numbers of independent columns, as many as the rank."""
    if not A.size:
        return []
    plain = A.astype(float)
    lengths = np.linalg.norm(plain, axis=1)
    plain = plain / np.where(lengths > 0.0, lengths, 1.0)[:, None]
    R, order = scipy.linalg.qr(plain, mode="r", pivoting=True)
    diagonal = np.abs(np.diag(R))
    return sorted(order[: int(np.sum(diagonal > 1e-9 * diagonal[0]))].tolist())


def _null(A):
    """Return a basis of the null space in which the free components are a unit matrix."""
    count = A.shape[1]
    rows = _independent(A.T)
    pivots = _independent(A[rows])
    free = [i for i in range(count) if i not in pivots]
    N = zeros(count, len(free))
    N[free] = np.eye(len(free), dtype=int) + mp.zero
    if pivots and free:
        N[pivots] = -solve(A[np.ix_(rows, pivots)], A[np.ix_(rows, free)])
    return N


def solve(A, B):
    """Return A⁻¹ B by Gaussian elimination with row exchanges."""
    n, columns = len(A), B.reshape(len(A), -1)
    T = np.hstack([A + mp.zero, columns + mp.zero])
    for k in range(n):
        best = max(range(k, n), key=lambda i: abs(T[i, k]))
        T[[k, best]] = T[[best, k]]
        T[k, k:] = T[k, k:] / T[k, k]
        for i in range(n):
            if i != k and T[i, k] != 0:
                T[i, k:] = T[i, k:] - T[i, k] * T[k, k:]
    return T[:, n:].reshape(B.shape)


def distance(found, exact):
    """Return |found − exact| after optimal pairing, and the exact values in the order of `found`, as floats."""
    from scipy.optimize import linear_sum_assignment

    rough = np.array([complex(value) for value in exact])
    found = np.asarray(found, dtype=complex)
    i, j = linear_sum_assignment(np.abs(found[:, None] - rough[None, :]))
    with mp.workdps(DIGITS):
        errors = np.array(
            [float(abs(mpmath.mpmathify(complex(found[a])) - exact[b])) for a, b in zip(i, j, strict=True)]
        )
    return errors, rough[j]
