"""Linearization of the index-3 equations about a reference motion, and its exact deflation.

    M Δa + R Δu + K Δq + Jᵀ Δν = 0,   C_q Δq = 0,   D_u Δu + D_q Δq = 0

(Pappalardo, Lettieri, Guida 2020, Eqs. (57)-(67)). The deflated system ẏ = S y has exactly
the finite eigenvalues: with N, Z, P of `mbstab.analysis.subspaces` and y = [ξ; η],

    ξ̇ = P ξ + Z η,   M_z η̇ = −Zᵀ[(M_r P² + R_r P + K_r) ξ + (M_r P + R_r) Z η].
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from mbstab.analysis.motion import ROUNDING, TOLERANCE, Motion, motion_at, unbalance
from mbstab.analysis.names import names_in
from mbstab.analysis.steady import Generator
from mbstab.analysis.subspaces import RANK_TOLERANCE, Subspaces, rank_of
from mbstab.compiler.system import Array, Row, System
from mbstab.errors import ConstraintError, MbstabError, ModelFileError, percent
from mbstab.model.schema import is_length

if TYPE_CHECKING:
    from mbstab.analysis.roundings import Roundings

GUARD_TOLERANCE = 1e-8
"""Coefficients that change less than this along the motion, relative to their size, count as constant."""

LITTLE = 1e-3
"""A change below this is told with the least one that counts."""

TURN = 0.3
"""The coefficients are compared after a turn by this angle (rad) and a travel by this part of the scene's size."""


class Matrices(NamedTuple):
    """Coefficients of the linearized equations."""

    M: Array
    R: Array
    K: Array
    J: Array
    D_q: Array


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
class Linearization:
    """Matrices of the linearized equations.

    Attributes
    ----------
    system : System
        Whose equations they are.
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
        The symmetry in whose frame the equations are written; None: in the coordinates of the file.
    frozen : bool
        Whether frozen-time coefficients were asked for.
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

    @property
    def constant(self) -> bool:
        """Whether the coefficients stay what they are along the motion."""
        return self.variation <= GUARD_TOLERANCE

    @property
    def n_f(self) -> int:
        """Number of finite eigenvalues, 2(n_q − rank C_q) − rank(D_u N)."""
        return self.motion.spaces.n_f

    @cached_property
    def terms(self) -> Matrices:
        """Sizes of the terms of which M, R, K, J and D_q are sums."""
        return _terms(self.system, self.motion, self.generator)

    @cached_property
    def entries(self) -> Matrices:
        """Sizes of the terms entry by entry, at the multipliers there are: what is zero stays it."""
        motion = self.motion
        return _entries(self.system, motion, self.generator, np.abs(motion.nu))

    @cached_property
    def roundings(self) -> Roundings:
        """How much M, R, K, J and D_q may differ from those of the decimals of the file."""
        from mbstab.analysis.roundings import roundings

        return roundings(self)

    def beside(self, change: Array) -> Matrices:
        """Return M, R, K, J and D_q where the coordinates are a little different, and what balances there."""
        return _beside(self.system, self.motion, self.generator, change)

    def composite(self) -> tuple[Array, Array, Array]:
        """Return M̄, R̄, K̄ of Eqs. (62)-(67), for [Δq; Δν]."""
        return composite(Matrices(self.M, self.R, self.K, self.J, self.D_q))

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
    to_coordinates, to_rates : ndarray, shape (n_q, n_f)
        Δq = to_coordinates @ y, Δu = to_rates @ y.
    n_xi : int
        The first n_xi components of y are positions, the others speeds.
    M_z : ndarray
        Mass matrix of the speeds.
    """

    A: Array
    to_coordinates: Array
    to_rates: Array
    n_xi: int
    M_z: Array


def linearize(system: System, motion: Motion, frozen: bool = False) -> Linearization:
    """Return the linearized equations about a reference motion, and how constant they are along it.

    The equations are written in the frame that goes along with the motion; of the symmetries
    that the motion may follow, the first in whose frame the coefficients are constant is taken.

    Parameters
    ----------
    frozen : bool
        Take the coefficients in the coordinates of the file as they are at the reference time.

    Raises
    ------
    ModelFileError
        If the file declares a steady motion that the scene has no symmetry for; names what breaks it.
    """
    if frozen or not motion.generators:
        candidates: tuple[Generator | None, ...] = (None,)
    else:
        candidates = motion.generators
    best: tuple[float, Generator | None, Matrices] | None = None
    for generator in candidates:
        matrices = matrices_in(system, motion, generator)
        variation = _variation(system, motion, matrices, generator)
        if best is None or variation < best[0]:
            best = variation, generator, matrices
        if variation <= GUARD_TOLERANCE:
            break
    assert best is not None
    variation, generator, matrices = best
    if variation > GUARD_TOLERANCE:
        if motion.declared and not frozen:
            raise _asymmetric(system, motion, variation)
        # Nothing makes the coefficients constant: the plain equations are shown.
        matrices = matrices_in(system, motion, None)
        variation, generator = _variation(system, motion, matrices, None), None
    return Linearization(
        system, *matrices, system.n_h, tuple(system.names), tuple(system.rows), motion, variation, generator, frozen
    )


def matrices_in(system: System, motion: Motion, generator: Generator | None) -> Matrices:
    """Return the coefficients in the frame that follows a generator, or in the coordinates of the file."""
    K, R, D_q = system.linearize(motion.q, motion.u, motion.a, motion.nu, motion.time)
    M, J = motion.dynamics.M, motion.dynamics.J
    if generator is not None and generator.turns:
        Xi, Xi_2 = generator.frame(motion.q)
        K, R, D_q = K + R @ Xi + M @ Xi_2, R + 2.0 * M @ Xi, D_q + J[system.n_h :] @ Xi
    return Matrices(M, R, K, J, D_q)


def _terms(system: System, motion: Motion, generator: Generator | None) -> Matrices:
    """Return the sizes of the terms of which the coefficients are sums, the same for all directions of a body."""
    state, spaces = motion.dynamics, motion.spaces
    # Multipliers bear the rounding of all the forces that they balance, and of the coordinates these depend on.
    loads = system.terms(motion.q, motion.u, motion.a, motion.nu, motion.time)
    J = state.J * spaces.scale * spaces.row_scale[:, None]
    inverse = np.abs(np.linalg.pinv(J, rcond=RANK_TOLERANCE)) if len(J) else J.T
    balanced = loads["F"] + loads["M"] @ np.abs(motion.a) + loads["J"].T @ np.abs(motion.nu)
    balanced = balanced + loads["K"] @ motion.sizes + loads["R"] @ np.abs(motion.u)
    nu = np.abs(motion.nu) + (inverse.T @ (balanced * spaces.scale)) * spaces.row_scale
    M, R, K, J, D_q = _entries(system, motion, generator, nu)
    # Turned axes mix the directions of a body: none of them is known better than the others.
    kinds = [(name.partition(".")[0], is_length(name)) for name in system.names]
    first = [i for i, kind in enumerate(kinds) if i == 0 or kind != kinds[i - 1]]
    counts = np.diff([*first, len(kinds)])
    M, R, K, J, D_q = (np.repeat(np.maximum.reduceat(x, first, axis=1), counts, axis=1) for x in (M, R, K, J, D_q))
    M, R, K = (np.repeat(np.maximum.reduceat(x, first, axis=0), counts, axis=0) for x in (M, R, K))
    return Matrices(M, R, K, J, D_q)


def _entries(system: System, motion: Motion, generator: Generator | None, nu: Array) -> Matrices:
    """Return the sizes of the terms of which the coefficients are sums, for multipliers of given sizes."""
    found = system.terms(motion.q, motion.u, motion.a, nu, motion.time)
    M, R, K, J, D_q = (found[key] for key in "MRKJD")
    if generator is not None and generator.turns:
        Xi, Xi_2 = (np.abs(x) for x in generator.frame(motion.q))
        K, R, D_q = K + R @ Xi + M @ Xi_2, R + 2.0 * M @ Xi, D_q + J[system.n_h :] @ Xi
    return Matrices(M, R, K, J, D_q)


def _beside(system: System, motion: Motion, generator: Generator | None, change: Array) -> Matrices:
    """Return the coefficients a little beside the motion, where other multipliers balance the forces."""
    q, u, a, spaces = motion.q + change, motion.u, motion.a, motion.spaces
    state = system.dynamics(q, u, motion.time)
    force = state.F0 + state.M @ a + state.J.T @ motion.nu
    inverse = np.linalg.pinv(motion.dynamics.J * spaces.scale * spaces.row_scale[:, None], rcond=RANK_TOLERANCE)
    nu = motion.nu - (inverse.T @ (force * spaces.scale)) * spaces.row_scale
    return matrices_in(system, replace(motion, q=q, nu=nu, dynamics=state), generator)


def _variation(system: System, motion: Motion, matrices: Matrices, generator: Generator | None) -> float:
    """Return the largest relative change of the coefficients a little later on the motion."""
    worst = 0.0
    try:
        if generator is not None and (generator.turns or motion.declared):
            later = _followed(system, motion, matrices, generator)
        else:
            later = ((x, matrices_in(system, x, None)) for x in _continuing(system, motion, matrices))
        for state, then in later:
            worst = max(worst, _change(system, motion, matrices, then, state.time - motion.time))
    except MbstabError:
        return np.inf
    return worst


def _followed(
    system: System, motion: Motion, matrices: Matrices, generator: Generator
) -> Iterator[tuple[Motion, Matrices]]:
    """Yield the steady motion later on, and the coefficients there in the directions of now."""
    rate = abs(generator.rate)
    speed = float(np.linalg.norm(generator.velocity)) / float(
        np.max(motion.sizes[_lengths(system)], initial=0.0) or 1.0
    )
    spin = float(np.max(np.abs(generator.spins), initial=0.0))
    fastest = max(rate, speed, spin)
    times = [part * TURN / x for x in (rate, speed, spin) if x > ROUNDING * fastest for part in (1.0, 3.0)]
    times += _law_times(system, motion, matrices)
    for time in times:
        q, T = generator.flow(motion.q, time)
        u = generator.field(q)
        if left := _left_rows(system, motion, q, u, time):
            raise ConstraintError(f"the steady motion leaves {', '.join(left)}")
        later = motion_at(system, q, u, motion.time + time)
        excess = (later.dynamics.M @ (later.a - generator.acceleration(q))) * motion.spaces.scale
        if np.max(np.abs(excess)) > unbalance(system, later):
            worst = system.names[int(np.argmax(np.abs(excess)))]
            raise ConstraintError(f"the forces do not keep {worst} on the steady motion")
        later = replace(later, a=generator.acceleration(q))
        M, R, K, J, D_q = matrices_in(system, later, generator)
        yield later, Matrices(T.T @ M @ T, T.T @ R @ T, T.T @ K @ T, J @ T, D_q @ T)


def _left_rows(system: System, motion: Motion, q: Array, u: Array, time: float) -> list[str]:
    """Return the owners of constraint rows that a state does not satisfy."""
    state = system.dynamics(q, u, motion.time + time)
    allowed = TOLERANCE * np.abs(state.J) @ motion.sizes
    fastest = float(np.max(np.abs(u / motion.sizes)))
    bad = [i for i in range(system.n_h) if abs(state.E[i]) > allowed[i]]
    bad += [i for i in range(system.n_c) if abs(state.V[i]) > allowed[i] * fastest]
    return list(dict.fromkeys(system.rows[i].owner for i in bad))


def _lengths(system: System) -> Any:
    return np.array([is_length(name) for name in system.names])


def _continuing(system: System, motion: Motion, matrices: Matrices) -> Iterator[Motion]:
    yield from _moved(system, motion)
    yield from _continued(system, motion, matrices)


def _moved(system: System, motion: Motion) -> Iterator[Motion]:
    """Yield the motion some way along its speeds: after a turn that shows, and after a shift that shows."""
    u, a = motion.u, motion.a
    if np.max(np.abs((motion.dynamics.M @ a) * motion.spaces.scale)) <= unbalance(system, motion):
        a = 0.0 * a  # steady: rounding must not add up
    lengths = _lengths(system)
    for kind in (~lengths, lengths):
        rate = float(np.max(np.abs(u / motion.sizes)[kind], initial=0.0))
        if rate > 0.0:
            time = TURN / rate
            yield motion_at(system, motion.q + time * u + 0.5 * time * time * a, u + time * a, motion.time + time)


def _law_times(system: System, motion: Motion, matrices: Matrices) -> list[float]:
    """Return times at which given functions of time may have changed."""
    if not any("t" in names_in(item.entry.values) for item in system.scene.items):
        return []
    scale = motion.spaces.scale
    R, K = (float(np.max(np.abs(x * scale * scale[:, None]), initial=0.0)) for x in (matrices.R, matrices.K))
    # Given functions can be fast or slow; what the scene would do by itself says what matters.
    step = 3.0 / (max(R, math.sqrt(K)) or 1.0)
    return [0.5 * step, step]


def _continued(system: System, motion: Motion, matrices: Matrices) -> Iterator[Motion]:
    """Yield where given functions of time carry the motion, by a step of the midpoint rule."""
    last = motion
    for time in _law_times(system, motion, matrices):
        last = motion_at(system, motion.q + time * last.u, motion.u + time * last.a, motion.time + time)
        yield last


def _asymmetric(system: System, motion: Motion, variation: float) -> ModelFileError:
    """Return the error about a declared steady motion whose scene has not the symmetry."""
    generator, scene = motion.generators[0], system.scene
    names = breaking(system, motion, generator)
    least = f", where {percent(GUARD_TOLERANCE)} is allowed" if variation < LITTLE else ""
    change = (
        f"change by {percent(variation)} along it{least}" if math.isfinite(variation) else "cannot be followed along it"
    )
    broken = f"; the symmetry is broken by {', '.join(names)}" if names else ""
    message = (
        f"the scene has not the symmetry of the declared steady motion ({generator}): its equations {change}{broken}"
    )
    hint = "correct reference.steady, or give the period of the motion, or ask for frozen-time numbers with --frozen"
    reference = scene.model.reference
    place = reference.location if reference.steady is None else reference.steady.location
    return ModelFileError([scene.model.document.problem(place, "reference.steady", message, hint)])


def breaking(system: System, motion: Motion, generator: Generator) -> list[str]:
    """Return the entries of a scene whose equations a symmetry does not carry into themselves."""
    time = TURN / abs(generator.rate) if generator.turns else 1.0
    rng = np.random.default_rng(7)
    scale = motion.spaces.scale
    found = []
    for name, part in system.parts():
        rows = [i for i, row in enumerate(system.rows) if f"{row.section}.{row.name}" == name]
        worst, size = 0.0, 1e-300
        # Rows of constraints may mix and stretch away from them, so they are compared on them only.
        for spread in (0.0,) if rows else (0.0, 0.05, 0.05):
            q = motion.q + spread * motion.sizes * rng.uniform(-1.0, 1.0, system.n_q)
            u = motion.u + spread * np.max(np.abs(motion.u)) * rng.uniform(-1.0, 1.0, system.n_q)
            moved, T = generator.flow(q, time)
            before = part.dynamics(q, u, motion.time)
            after = part.dynamics(moved, T @ u, motion.time + time)
            if rows:
                J, J_after = (x[rows] * motion.sizes for x in (before.J, after.J @ T))
                lengths = np.linalg.norm(J, axis=1) + 1e-300
                both = np.vstack([J, J_after]) / np.concatenate([lengths, lengths])[:, None]
                rank = np.linalg.matrix_rank(both[: len(rows)], tol=TOLERANCE)
                shift = np.abs(after.E[rows] / lengths)
                worst = max(float(np.linalg.svd(both, compute_uv=False)[rank:].max(initial=0.0)), float(shift.max()))
                size = 1.0
            elif np.any(before.M):
                still = np.zeros(system.n_q)
                pull, pull_after = part.dynamics(q, still).F0, T.T @ part.dynamics(moved, still).F0
                inertia = np.abs(T.T @ after.M @ T - before.M) * scale * scale[:, None]
                worst = max(worst, float(inertia.max()), float(np.max(np.abs((pull - pull_after) * scale))))
                size = max(size, 1.0, float(np.max(np.abs(pull * scale))))
            else:
                worst = max(worst, float(np.max(np.abs(T.T @ after.F0 - before.F0) * scale)))
                size = max(size, float(np.max(np.abs(before.F0 * scale))))
        if worst > 1e-6 * size:
            found.append(name)
    return found


def _change(system: System, motion: Motion, now: Matrices, then: Matrices, time: float) -> float:
    """Return the largest relative change of the deflated system, apart from rounding."""
    spaces, scale = motion.spaces, motion.spaces.scale
    J = then.J * scale * spaces.row_scale[:, None]
    C, D = J[: system.n_h], J[system.n_h :]
    # The same motions must be allowed.
    turned = float(max(np.max(np.abs(x), initial=0.0) for x in (C @ spaces.N, D @ spaces.N @ spaces.Z)))
    if turned > ROUNDING:
        return turned
    n = spaces.N.shape[1]
    A, B = (_deflated(spaces, matrices)[0] for matrices in (now, then))
    # What rounding may be, beside the entries themselves: inertia over the time, and the forces that balance.
    forces = float(np.max(np.abs(motion.dynamics.F0 * scale)) / np.min(motion.sizes / scale))
    worst = 0.0
    for block, natural in (
        (np.s_[:n, :n], 1.0 / time),
        (np.s_[n:, :n], 1.0 / time**2 + forces),
        (np.s_[n:, n:], 1.0 / time),
    ):
        difference = float(np.max(np.abs(B[block] - A[block]), initial=0.0))
        if difference > ROUNDING * natural:
            worst = max(worst, difference / float(np.max(np.maximum(np.abs(A[block]), np.abs(B[block])))))
    return worst


def _deflated(spaces: Subspaces, matrices: Matrices) -> tuple[Array, Array]:
    """Return the matrix of ẏ = A y in the bases N and Z, and the mass matrix of the speeds."""
    n_h = len(matrices.J) - len(matrices.D_q)
    D_u, D_q = (x * spaces.scale * spaces.row_scale[n_h:, None] for x in (matrices.J[n_h:], matrices.D_q))
    P = -rank_of(D_u @ spaces.N).pseudo_inverse @ (D_q @ spaces.N)
    weights = spaces.scale * spaces.scale[:, None]
    M, R, K = (x * weights for x in (matrices.M, matrices.R, matrices.K))
    return deflated_matrix(M, R, K, spaces.N, spaces.Z, P)


def deflated_matrix(M: Array, R: Array, K: Array, N: Array, Z: Array, P: Array) -> tuple[Array, Array]:
    """Return the matrix of ẏ = A y in the bases N and Z, and the mass matrix of the speeds.

    Parameters
    ----------
    M, R, K : ndarray, shape (…, n_q, n_q)
        In scaled coordinates; further axes in front are those of a sweep, and broadcast.
    N : ndarray, shape (…, n_q, n_xi)
    Z : ndarray, shape (…, n_xi, n_eta)
    P : ndarray, shape (…, n_xi, n_xi)
    """
    M_z, *lower = reduced(M, R, K, N, Z, P)
    # Z is orthonormal in mass-scaled coordinates: M_z is as well conditioned as the scene allows.
    n, points = N.shape[-1], np.broadcast_shapes(*(x.shape[:-2] for x in (*lower, P, Z)))
    A = np.empty((*points, n + Z.shape[-1], n + Z.shape[-1]))
    A[..., :n, :n], A[..., :n, n:] = P, Z
    if M_z.size:
        inverse = np.linalg.inv(M_z) if M_z.ndim > 2 and len(M_z) == 1 else None
        for block, x in ((np.s_[..., n:, :n], lower[0]), (np.s_[..., n:, n:], lower[1])):
            A[block] = -np.linalg.solve(M_z, x) if inverse is None else -inverse @ x
    return A, M_z


def reduced(M: Array, R: Array, K: Array, N: Array, Z: Array, P: Array) -> tuple[Array, Array, Array]:
    """Return M_z, K_z and R_z of M_z η̇ = −K_z ξ − R_z η."""
    N_t, Z_t = np.swapaxes(N, -1, -2), np.swapaxes(Z, -1, -2)
    M_r, R_r, K_r = (N_t @ x @ N for x in (M, R, K))
    inertia = M_r @ P + R_r
    return Z_t @ M_r @ Z, Z_t @ (inertia @ P + K_r), Z_t @ inertia @ Z


def state_space(linear: Linearization) -> StateSpace:
    """Return the deflated system; all its eigenvalues are finite, and they are all finite eigenvalues."""
    spaces = linear.motion.spaces
    scale, N, Z = spaces.scale, spaces.N, spaces.Z
    n_xi = N.shape[1]
    A, M_z = _deflated(spaces, Matrices(linear.M, linear.R, linear.K, linear.J, linear.D_q))
    to_coordinates = scale[:, None] * np.hstack([N, np.zeros((len(scale), Z.shape[1]))])
    to_rates = scale[:, None] * (N @ A[:n_xi])
    return StateSpace(A, to_coordinates, to_rates, n_xi, M_z)
