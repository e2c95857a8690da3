"""Eigenvalues of a model to many digits, by elimination in multiprecision arithmetic: the truth for double precision.

Nothing here is shared with `mbstab.analysis`: the constraints are eliminated by solving for some of the coordinates
(no orthonormal bases, no scaling), and the rounding of what remains is far below what is asked for. Only the matrices
come from the program's kernels, run on mpmath numbers, and where the file asks for an equilibrium or a steady motion,
the program's solution in double precision is where Newton's method starts.

A steady motion q(t) = Φ_t(q₀) and the frame that goes along come from turning the bodies by finite rotations and
reading off their Euler angles: u = ∂Φ/∂t, a = ∂²Φ/∂t², and with Δq(t) = DΦ_t z the product rule gives the equations
for z from ∂DΦ/∂t and ∂²DΦ/∂t². The derivatives at t = 0 are differences with many more digits; no formula of
`mbstab.analysis.reference.steady` is used.
"""

import mpmath
import numpy as np
import scipy.linalg
from mpmath import mp
from mpmath_numbers import mpmath_arithmetic

import mbstab.analysis.reference.requested
from mbstab.compiler.system import System
from mbstab.model.values import evaluate

DIFFERENCE_DIGITS = 240
STEP = mpmath.mpf(10) ** -40
"""Central differences, of third derivatives at most: off by STEP² from Taylor and by 1e-240/STEP³ from rounding."""


def eliminated(model, zero, digits, parameters):
    """Return the eigenvalues of a model that are not neutral, as mpmath numbers, and how many are neutral.

    Neutral are zeros, and pairs ±iω where a frame turns at ω and nothing depends on the place across its axis.
    Parameters are texts in SI units. Missing coordinates are solved for by Newton's method, from ``reference.guess``
    if only the constraints determine them. Eigenvalues smaller than `zero` times the largest count as zeros. `digits`
    are those to compute with.
    """
    with mp.workdps(digits):
        overrides = {name: mp.mpf(value) for name, value in parameters.items()}
        system = System(evaluate(model, overrides, mpmath_arithmetic()))
        rough = System(evaluate(model, {name: float(value) for name, value in overrides.items()}))
        A, moving, carried = _state_matrix(system, rough)
        if not A.size:
            return [], 0
        if moving:
            values = _eigenvalues(A)
        else:
            half = len(A) // 2
            values = [sign * mp.sqrt(s) for s in _eigenvalues(A[half:, :half]) for sign in (1, -1)]
        size = max(abs(value) for value in values)
        neutral = [0, *((mp.mpc(0, carried), mp.mpc(0, -carried)) if carried else ())]
        kept = [value for value in values if all(abs(value - other) > zero * size for other in neutral)]
        return kept, len(values) - len(kept)


def _eigenvalues(A):
    # mpmath returns a matrix with one entry as its own eigenvector.
    return mp.eig(mp.matrix(A.tolist()), left=False, right=False) if len(A) > 1 else [A[0, 0]]


def _state_matrix(system, rough):
    """Return A of ẏ = A y with y = [free coordinates; free speeds], whether speeds enter otherwise than as ẋ = u, and
    the rate of a frame that carries symmetric shifts around, or 0."""
    n, n_h = system.n_q, system.n_h
    q, u, flow = _reference(system, rough)
    state = system.dynamics(q, u)
    M, J = state.M + mp.zero, state.J + mp.zero
    rows = _independent(J.T)
    unknown = solve(
        np.block([[M, J[rows].T], [J[rows], zeros(len(rows), len(rows))]]), -np.concatenate([state.F0, state.B[rows]])
    )
    a, nu = unknown[:n], zeros(system.n_c)
    nu[rows] = unknown[n:]
    K, R, D_q = (x + mp.zero for x in system.linearize(q, u, a, nu))
    carried = mp.zero
    if flow is not None:
        # The motion goes on as the symmetry says.
        assert max(abs(x) for x in a - flow.acceleration(q)) < mp.mpf(10) ** -60 * (1 + max(abs(x) for x in a))
        carried = _carried(system, flow, [K, J[:n_h], D_q])
        first, second = flow.frame(q)
        K, R, D_q = K + R @ first + M @ second, R + 2 * M @ first, D_q + J[n_h:] @ first
    N = _null(J[:n_h])
    W, drift = J[n_h:] @ N, D_q @ N
    Z = _null(W)
    P = zeros(N.shape[1], N.shape[1])
    if len(W):
        lines = _independent(W.T)
        pivots = _independent(W[lines])
        P[pivots] = -solve(W[np.ix_(lines, pivots)], drift[lines])
    M, R, K = (N.T @ x @ N for x in (M, R, K))
    inertia = M @ P + R
    right = np.hstack([Z.T @ (inertia @ P + K), Z.T @ inertia @ Z])
    lower = -solve(Z.T @ M @ Z, right) if Z.shape[1] else zeros(0, N.shape[1])
    A = np.vstack([np.hstack([P, Z]), lower])
    moving = bool(len(W)) or any(x != 0 for x in lower[:, N.shape[1] :].flat)
    return A, moving, carried


def _carried(system, flow, blocks):
    """Return the rate of a frame if shifting everything across its axis changes no equation, or 0."""
    if not flow.rate:
        return mp.zero
    d = system.scene.dimension
    plane = [np.eye(3, dtype=int)[k] + mp.zero for k in range(d)]
    plane = [x - flow.axis * (flow.axis @ x) for x in plane]
    for shift in plane:
        everything = zeros(system.n_q)
        for part in system.body_slices:
            everything[part.start : part.start + d] = shift[:d]
        for block in blocks:
            if any(abs(x) > mp.mpf(10) ** -60 * (1 + max(map(abs, block.flat))) for x in block @ everything):
                return mp.zero
    return abs(flow.rate)


# --- the reference motion -------------------------------------------------------------------------------------------


def _reference(system, rough):
    """Return q and u with all digits, and the flow of a steady motion or None.

    Given values are taken as they are, the others come from the constraints, or also from the balance of the forces
    where the file says ``find``.
    """
    scene = system.scene
    find, steady = scene.model.reference.find, scene.steady
    if find is None and steady is None:
        return *_assembled(system), None
    motion = mbstab.analysis.reference.requested.reference_motion(rough)
    flow = _Flow(system, motion.generators[0])
    q = motion.q.astype(object) + mp.zero
    for i, name in enumerate(system.names):
        if name in scene.coordinates:
            q[i] = mp.mpf(scene.coordinates[name])
    if find is None:
        q = _assembled(system)[0]
    free = [i for i, name in enumerate(system.names) if find and name not in scene.coordinates]
    q, flow = _balanced(system, q, flow, free, motion.sizes)
    return q, flow.velocity(q), flow if find == "steady" or steady is not None else None


def _balanced(system, q, flow, free, sizes):
    """Solve M a + F0 + Jᵀν = 0, C = 0, V = 0 and the given rates for free coordinates, rates and ν.

    The steps come from one Jacobian in double precision, so each gains about ten digits.
    """
    n, n_h = system.n_q, system.n_h
    rates = {i: mp.mpf(system.scene.rates[name]) for i, name in enumerate(system.names) if name in system.scene.rates}
    rows = _independent((system.dynamics(q, flow.velocity(q)).J + mp.zero).T)
    nu = zeros(system.n_c)

    def residual(q, nu):
        u, a = flow.velocity(q), flow.acceleration(q)
        state = system.dynamics(q, u)
        given = [u[i] - rate for i, rate in rates.items()]
        force = state.M @ a + state.F0 + state.J.T @ nu
        return np.concatenate([force, state.E[:n_h], state.V, np.array(given, dtype=object)]), state

    def jacobian(q, nu):
        u, a, (first, second) = flow.velocity(q), flow.acceleration(q), flow.frame(q)
        K, R, _ = system.linearize(q, u, a, nu)
        state = system.dynamics(q, u)
        slope = system.linearize_rows(q, u, a)[0] + state.J @ first
        columns = [np.vstack([K + R @ first + state.M @ second, state.J[:n_h], slope, first[list(rates)]])[:, free]]
        for k in range(len(flow.unknown)):
            # Differences suffice: the steps need not be exact.
            changed = [flow.changed(k, sign * STEP) for sign in (1, -1)]
            (u_1, u_2), (a_1, a_2) = ([getattr(f, x)(q) for f in changed] for x in ("velocity", "acceleration"))
            du, da = (u_1 - u_2) / (2 * STEP), (a_1 - a_2) / (2 * STEP)
            column = np.concatenate([R @ du + state.M @ da, zeros(n_h), state.J @ du, du[list(rates)]])
            columns.append(column[:, None])
        below = zeros(n_h + system.n_c + len(rates), len(rows))
        columns.append(np.vstack([state.J[rows].T, below]))
        return np.hstack(columns).astype(float)

    # First the multipliers of the state as it is, then everything.
    force, state = residual(q, nu)
    nu[rows] = _least(state.J[rows].T.astype(float), -force[:n].astype(float))
    G = jacobian(q, nu)
    weights = np.concatenate([np.asarray(sizes)[free], np.ones(G.shape[1] - len(free))])
    lengths = np.linalg.norm(G * weights, axis=1)
    lengths = np.maximum(lengths, 1e-9 * np.max(lengths))  # what is rounding only stays so
    inverse = weights[:, None] * np.linalg.pinv(G * weights / lengths[:, None], rcond=1e-11) / lengths
    for _ in range(40):
        step = -(inverse.astype(object) @ residual(q, nu)[0])
        q[free] += step[: len(free)]
        for k in range(len(flow.unknown)):
            flow = flow.changed(k, step[len(free) + k], flow)
        nu[rows] += step[len(free) + len(flow.unknown) :]
        if all(abs(x) < mp.mpf(10) ** (5 - mp.dps) for x in step):
            break
    size = 1 + max(abs(x) for x in nu) if len(nu) else 1
    assert all(abs(x) < mp.mpf(10) ** -70 * size for x in residual(q, nu)[0])
    return q, flow


def _least(G, right):
    return np.linalg.lstsq(G, right, rcond=1e-11)[0].astype(object) + mp.zero


class _Flow:
    """The motion Φ_t of all bodies: a turn about an axis, a translation, and turns of bodies about their own axes."""

    def __init__(self, system, start):
        self.system = system
        steady = system.scene.steady
        zero = zeros(3)
        self.axis, self.point, self.direction = zero, zero.copy(), zero.copy()
        self.rate, self.speed, self.spins = mp.zero, mp.zero, start.spins.astype(object) + mp.zero
        self.unknown = [("spins", i) for i in np.flatnonzero(start.spins)]
        if steady is None:
            assert not self.unknown
            return
        d = system.scene.dimension
        if steady.axis is not None:
            self.axis = np.array(steady.axis, dtype=object) + mp.zero
            self.point[:d] = steady.point
            self.rate = mp.mpf(start.rate if steady.rate is None else steady.rate)
            self.unknown += [("rate", None)] if steady.rate is None else []
        if steady.direction is not None:
            assert steady.axis is None or all(x == 0 for x in np.cross(steady.axis, steady.direction))
            self.direction[:d] = steady.direction
            self.speed = self.direction @ (start.velocity + mp.zero) if steady.speed is None else mp.mpf(steady.speed)
            self.unknown += [("speed", None)] if steady.speed is None else []

    def changed(self, k, amount, of=None):
        """Return the flow with another value of an unknown rate."""
        name, i = self.unknown[k]
        flow = object.__new__(_Flow)
        flow.__dict__.update((of or self).__dict__)
        if i is None:
            setattr(flow, name, getattr(flow, name) + amount)
        else:
            flow.spins = flow.spins.copy()
            flow.spins[i] += amount
        return flow

    def at(self, q, t, part, body):
        """Return the coordinates of a body after a time, from its coordinates now."""
        d = self.system.scene.dimension
        turn = _rotation(self.axis, self.rate * t)
        moved = q + t * self.spins[part]
        moved[:d] += (
            ((turn - np.eye(3, dtype=int))[:d, :d]) @ (q[:d] - self.point[:d]) + t * self.speed * self.direction[:d]
        )
        if body.orientation and self.rate:
            if d == 2:
                moved[2] += self.axis[2] * self.rate * t
            else:
                base = np.array(body.base, dtype=object).reshape(3, 3)
                moved[3:] += _euler_angles(base.T @ turn @ base @ _orientation(q[3:]), q[3:]) - q[3:]
        return moved

    def _bodies(self):
        return zip(self.system.scene.bodies, self.system.body_slices, strict=True)

    def _in_time(self, q, body, part):
        """Return Φ, ∂Φ/∂t and ∂²Φ/∂t² of a body at t = 0, with the digits for differences."""
        # Differences cancel what the base rotation has of rounding.
        later, now, before = (self.at(q, k * STEP, part, body) for k in (1, 0, -1))
        return (later - before) / (2 * STEP), (later - 2 * now + before) / STEP**2

    def velocity(self, q):
        return self._whole(q, 0)

    def acceleration(self, q):
        return self._whole(q, 1)

    def _whole(self, q, order):
        result = zeros(len(q))
        with mp.workdps(DIFFERENCE_DIGITS):
            for body, part in self._bodies():
                result[part] = self._in_time(q[part], body, part)[order]
        return result + mp.zero

    def frame(self, q):
        """Return ∂DΦ/∂t and ∂²DΦ/∂t² at t = 0."""
        first, second = zeros(len(q), len(q)), zeros(len(q), len(q))
        with mp.workdps(DIFFERENCE_DIGITS):
            for body, part in self._bodies():
                own = q[part]
                for i in range(len(own)):
                    step = zeros(len(own))
                    step[i] = STEP
                    after, before = (self._in_time(own + sign * step, body, part) for sign in (1, -1))
                    for matrix, x, y in zip((first, second), after, before, strict=True):
                        matrix[part, part.start + i] = (x - y) / (2 * STEP)
        return first + mp.zero, second + mp.zero


def _rotation(axis, angle):
    """Return the matrix of a turn, column by column from the parts of unit vectors along and across the axis."""
    c, s = mp.cos(angle), mp.sin(angle)
    columns = []
    for unit in np.eye(3, dtype=int):
        along = axis * (axis @ unit)
        columns.append(along + c * (unit - along) + s * np.cross(axis, unit))
    return np.array(columns).T


def _orientation(angles):
    """Return Ax(φ) Ay(θ) Az(ψ)."""
    axes = np.eye(3, dtype=int)
    x, y, z = (_rotation(axis, angle) for axis, angle in zip(axes, angles, strict=True))
    return x @ y @ z


def _euler_angles(A, near):
    """Return the angles of Ax(φ) Ay(θ) Az(ψ), those next to given ones."""
    theta = mp.asin(A[0, 2])
    phi, psi = mp.atan2(-A[1, 2], A[2, 2]), mp.atan2(-A[0, 1], A[0, 0])
    if mp.cos(near[1]) < 0:
        phi, theta, psi = phi + mp.pi, mp.pi - theta, psi + mp.pi
    turn = 2 * mp.pi
    return np.array([x + turn * mp.nint((y - x) / turn) for x, y in zip((phi, theta, psi), near, strict=True)])


def _assembled(system):
    """Return q and u: given values as they are, the others from the constraints."""
    scene, n_h = system.scene, system.n_h
    q = np.array([mp.mpf(scene.coordinates.get(name, scene.guess.get(name, 0))) for name in system.names])
    u = np.array([mp.mpf(scene.rates.get(name, 0)) for name in system.names])
    missing = [i for i, name in enumerate(system.names) if name not in scene.coordinates]
    for _ in range(60 if missing and n_h else 0):
        state = system.closing.dynamics(q, 0 * u)
        step = _least_change(state.J[:n_h][:, missing] + mp.zero, -state.E[:n_h])
        q[missing] += step
        if all(abs(x) < mp.mpf(10) ** (5 - mp.dps) for x in step):
            break
    missing = [i for i, name in enumerate(system.names) if name not in scene.rates]
    if missing and system.n_c:
        state = system.dynamics(q, u)
        u[missing] += _least_change(state.J[:, missing] + mp.zero, -state.V)
    return q, u


# --- linear algebra -------------------------------------------------------------------------------------------------


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
