"""Disturbances that lead to other motions of the same kind, and the matrix left to judge.

In the deflated system ẏ = S y, with y = [ξ; η] of `mbstab.analysis.linear.linearize`, two things are known
by structure: directions T, S T ⊂ T, of verified symmetries and of families of motions, and
differentials L, L S = 0, of functions that are constant along every motion (momenta, energy).
If S restricted to the rest, A = Bᵀ S B with B an orthonormal basis of {y ⟂ T, L y = 0}, is regular,
then for each value of those functions there is exactly one motion of the same kind near the reference
(implicit function theorem), and each row of L adds a direction to the family.

No eigenvalue is taken as zero because it is small: those that T and L do not explain stay in A.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from mbstab.analysis.algebra.arrays import RandomNumbers, least_squares
from mbstab.analysis.algebra.augmented import of_rank
from mbstab.analysis.algebra.sparse import scaled
from mbstab.analysis.algebra.tolerances import EPS
from mbstab.analysis.linear.linearize import Linearization, StateSpace
from mbstab.analysis.linear.roundings import roundings
from mbstab.analysis.reference.fields import Field, Symmetry
from mbstab.analysis.reference.steady import Generator
from mbstab.analysis.reference.symmetries import Invariance
from mbstab.analysis.reference.tolerances import TOLERANCES as REFERENCE
from mbstab.analysis.verdict.followers import disturbances, led, left_behind
from mbstab.analysis.verdict.spectrum import Chains, Neutral
from mbstab.analysis.verdict.tolerances import TOLERANCES
from mbstab.analysis.verdict.work import Work
from mbstab.compiler.system import Array
from mbstab.model.schema import is_length
from mbstab.records import dataclass


@dataclass(frozen=True)
class Separated:
    """The balanced matrix S and its structure.

    Attributes
    ----------
    S : ndarray, shape (n, n)
    T : ndarray, shape (n, d)
        Orthonormal directions of symmetries and families.
    L : ndarray, shape (k, n)
        Orthonormal differentials of conserved functions, L T = 0.
    B : ndarray, shape (n, n − d − k)
        Orthonormal basis of the rest.
    neutral : Neutral
    rates : tuple of float (1/s)
        Ω of the co-moving frame, if it rotates, and rates of the coordinates that spin in it.
    speeds : int
        Number of directions of T that are speeds along symmetries, at which a scene at rest may move.
    """

    S: Array
    T: Array
    L: Array
    B: Array
    neutral: Neutral
    rates: tuple[float, ...] = ()
    speeds: int = 0

    @property
    def misfit(self) -> float:
        """How far S leads out of the directions, and the functions are not constant up to them."""
        S, T, L = self.S, self.T, self.L
        outside = float(np.linalg.norm(S @ T - T @ (T.T @ S @ T), 2)) if T.shape[1] else 0.0
        return max(outside, float(np.linalg.norm((L @ S) - (L @ S @ T) @ T.T, 2)) if len(L) else 0.0)

    @cached_property
    def A(self) -> Array:
        """The matrix left to judge, Bᵀ S B."""
        if self.B.shape[0] == self.B.shape[1]:
            return self.S
        result: Array = self.B.T @ self.S @ self.B
        return result

    def frequencies(self) -> list[complex]:
        """Return ±iΩ for each pair of neutral directions that rotates with the motion; the others are zero."""
        if not self.rates or not self.T.shape[1]:
            return []
        values = np.linalg.eigvals(self.T.T @ self.S @ self.T).imag
        nearest = np.array(self.rates)[np.argmin(np.abs(values[:, None] - self.rates), axis=1)]
        turning = sorted(
            nearest[np.abs(values - nearest) < TOLERANCES.turning_frequency * nearest].tolist(), reverse=True
        )
        return [complex(0.0, sign * rate) for rate in turning for sign in (1.0, -1.0)]


class Structure:
    """The structure of a linearization; each part is computed at first use.

    Parameters
    ----------
    linear : Linearization
    space : StateSpace
    gamma : float (1/s)
        The unit of speeds.
    invariance : Invariance
    work : Work, optional
        The work of the elements in the frame of the motion, if something is known of it.
    """

    def __init__(
        self, linear: Linearization, space: StateSpace, gamma: float, invariance: Invariance, work: Work | None = None
    ) -> None:
        self.linear, self.space, self.gamma, self.invariance = linear, space, gamma, invariance
        self.work = work or Work(invariance, linear.generator)

    @cached_property
    def _slope(self) -> Array:
        """Ξ of the motion, if it is steady."""
        assert self.linear.generator is not None
        return self.linear.generator.frame(self.linear.motion.q)[0]

    @cached_property
    def _basis(self) -> Array:
        """N in coordinates (m, rad)."""
        spaces = self.linear.spaces
        return spaces.scale[:, None] * spaces.N

    @cached_property
    def followers(self) -> Array:
        """Disturbances of the states that only follow, as columns in the coordinates of the balanced S."""
        spaces, n = self.linear.spaces, self.space.n_xi
        return disturbances(spaces.N, spaces.Z, self.space.A[:n, :n], self.gamma, self.linear.system.following)

    # --- into the coordinates of S ----------------------------------------------------------------------------------

    def column(self, direction: Array, rate: Array) -> Array:
        """Return a disturbance (Δq, Δu), or columns of some, in the coordinates of the balanced S."""
        linear, space = self.linear, self.space
        spaces, n = linear.spaces, self.space.n_xi
        generator = linear.generator
        if generator is not None and generator.turns:
            rate = rate - self._slope @ direction
        xi = spaces.N.T @ (direction.T / spaces.scale).T
        eta = spaces.Z.T @ (spaces.N.T @ (rate.T / spaces.scale).T - space.A[:n, :n] @ xi)
        return np.concatenate([xi, eta / self.gamma])

    def columns(self, pairs: list[tuple[Array, Array]]) -> list[Array]:
        """Return disturbances one by one; those of a large scene are computed together."""
        if not self.linear.system.sparse or not pairs:
            return [self.column(direction, rate) for direction, rate in pairs]
        return list(self.column(*(np.array(x).T for x in zip(*pairs, strict=True))).T)

    def differential(self, direction: Array, rate: Array) -> Array:
        """Return the differential of the momentum along a symmetry Y, or of the energy along the motion itself, as row.

        Yᵀ times the linearized equations is its rate: (Yᵀ R − Y'ᵀ M) Δq + Yᵀ M Δu, with Y' the
        rate of change of Y in the co-moving frame.
        """
        linear, space = self.linear, self.space
        spaces, n = linear.spaces, self.space.n_xi
        N = self._basis
        carried = rate if linear.generator is None else rate - self._slope @ direction
        speeds = direction.T @ linear.M @ N
        positions = direction.T @ linear.R @ N - carried.T @ linear.M @ N
        return np.concatenate([positions + speeds @ space.A[:n, :n], self.gamma * (speeds @ spaces.Z)], axis=-1)

    def disturbance(self, y: Array) -> tuple[Array, Array]:
        """Return Δq and Δu of a disturbance in the coordinates of the balanced S."""
        linear, n = self.linear, self.space.n_xi
        spaces, generator = linear.spaces, linear.generator
        direction = spaces.scale * (spaces.N @ y[:n])
        rate = spaces.scale * (spaces.N @ (self.space.A[:n, :n] @ y[:n] + self.gamma * (spaces.Z @ y[n:])))
        if generator is not None and generator.turns:
            rate = rate + self._slope @ direction
        return direction, rate

    def balanced(self, q: Array, u: Array) -> tuple[Array, Array]:
        """Return the accelerations and the multipliers at a state."""
        system, spaces = self.linear.system, self.linear.spaces
        state = system.dynamics(q, u, self.linear.motion.time)
        M = state.M * spaces.scale * spaces.scale[:, None]
        J = state.J * spaces.scale * spaces.row_scale[:, None]
        augmented, _ = of_rank(M, J, spaces.C.rank + spaces.W.rank)
        # Refined, forces across a coordinate leave no rounding in its acceleration.
        force, bias = -state.F0 * spaces.scale, state.B * spaces.row_scale
        a, nu = augmented.refined(force, bias, REFERENCE.balance_refinements)
        return spaces.scale * a, spaces.row_scale * nu

    # --- directions -------------------------------------------------------------------------------------------------

    def separated(self, S: Array) -> Separated:
        """Return the balanced S with its neutral directions."""
        n = len(S)
        generator = self.linear.generator
        rates = () if generator is None else _rates(generator)
        if not n:
            return unseparated(S)
        symmetries = self.invariance.symmetries
        boosts = self.invariance.boosts
        columns = self.columns([(item.direction, item.rate) for item in symmetries])
        columns += self.columns([(np.zeros_like(item.direction), item.direction) for item in boosts])
        family = [f"speed along {_axis(item)}" for item in boosts]
        rest, named = self._rest(S, columns)
        T = orthonormal([*columns, *rest], n)
        family += named
        L, kept = self._conserved(T, S)
        family += kept
        # Where conserved functions have other values, the motion need not be steady.
        moving, speeds, slow = self._moving(T, S) if not len(L) else ([], [], [])
        family += speeds
        T = orthonormal([*T.T, *moving], n) if moving else T
        d = T.shape[1]
        B = complement(np.hstack([T, L.T]))
        # Where forces cancel in a critical state, S itself may be only rounding.
        size = max(spectral_norm(S), self.invariance.rate) if d + len(L) else 1.0
        if Separated(S, T, L, B, Neutral()).misfit > TOLERANCES.direction_closure * size:
            return unseparated(S)  # equations of an instant need not have the symmetries of the motion
        T, B = settled(S, T, L, B)
        found = Separated(S, T, L, B, Neutral(), rates, len(moving))
        names = tuple(item.name for item in symmetries)
        neutral = Neutral(
            names,
            tuple(family),
            d + len(L),
            self.chains(found),
            "numerical" if d + len(L) else "structural",
            slow=tuple(slow),
            tumbling=bool(len(L)) and self._tumbles(),
        )
        return replace(found, neutral=neutral)

    def chains(self, found: Separated) -> Chains | None:
        """Return the chains of neutral directions, with the names of the symmetries that drift."""
        items = self.invariance.symmetries
        columns = self.columns([(item.direction, item.rate) for item in items])
        return chains_of(found, [(item.name, x) for item, x in zip(items, columns, strict=True)])

    def symmetric(self, n: int) -> Array:
        """Return orthonormal directions of the symmetries alone, shape (n, d)."""
        return orthonormal(self.columns([(item.direction, item.rate) for item in self.invariance.symmetries]), n)

    def _rest(self, S: Array, columns: list[Array]) -> tuple[list[Array], list[str]]:
        """Return the directions of neighbouring rest positions, where rows on speeds leave a manifold of them.

        Where forces along all allowed motions have full rank as functions of the positions, rests
        form a manifold of the dimension of the independent nonholonomic rows (Neimark, Fufaev 1972).
        """
        linear, n = self.linear, self.space.n_xi
        if linear.massless is not None and len(linear.massless.first_order):
            return [], []  # their rows are not satisfied by every rest
        n_eta = len(S) - n
        if n_eta >= n or np.any(linear.motion.u) or not self.work.rows_at_rest:
            return [], []
        size = float(np.linalg.norm(S[n:], 2)) or 1.0
        if n_eta:
            _, s, right = np.linalg.svd(S[n:, :n])
            if s[-1] <= TOLERANCES.rest_manifold_rank * size or not self._held_by_forces():
                return [], []
            null = right[n_eta:].T
        else:
            null = np.eye(n)
        found = [np.concatenate([x, np.zeros(n_eta)]) for x in null.T]
        further = len(found) - orthonormal(columns, len(S)).shape[1]
        return found, ["position at rest"] if further > 0 else []

    def _held_by_forces(self) -> bool:
        """Return whether the stiffness along all allowed motions has full rank, beyond its rounding."""
        spaces = self.linear.spaces
        known = roundings(self.linear)
        stiffness, error, *moved = (
            scaled(x, spaces.scale, spaces.scale)
            for x in (self.linear.K, known.errors.K, *(x.K for x in known.displaced))
        )
        allowed, N = spaces.allowed, spaces.N
        least = float(np.linalg.svd(allowed.T @ (stiffness @ N), compute_uv=False)[-1])
        off = float(np.linalg.norm(np.abs(allowed).T @ (error @ np.abs(N))))
        return least > off + sum(float(np.linalg.norm(allowed.T @ (x @ N))) for x in moved)

    def _moving(self, T: Array, S: Array) -> tuple[list[Array], list[str], list[str]]:
        """Return speeds along symmetries at which a scene may move as steadily as at rest, and as the reference does.

        A wheel may roll, and a balanced rotor turn, at any speed, although no momentum along it is conserved. The names
        of speeds that the energy may bound, those of a scene at rest, are repeated.
        """
        invariance, linear = self.invariance, self.linear
        items, u = [x for x in invariance.symmetries if self.commutes(x)], linear.motion.u
        if not items or not (np.any(u) or self.work.led_at_rest):
            return [], [], []
        spaces, states = linear.spaces, linear.system.following
        directions = np.array([x.direction for x in items]).T / spaces.scale[:, None]
        lengths = np.linalg.norm(directions, axis=0)
        directions = directions / lengths
        speeds, across = led(directions, spaces.allowed, states)
        columns = self.gamma * np.array([self.column(0.0 * x, spaces.scale * x) for x in speeds.T]).T
        if states:
            along = self.columns([(x.direction / s, x.rate / s) for x, s in zip(items, lengths, strict=True)])
            columns, lacking = left_behind(S, self.followers, columns, self.gamma * np.array(along).T)
            across = np.vstack([across, lacking / self.gamma])
        c = admissible(across)
        _, s, right = np.linalg.svd(columns @ c - T @ (T.T @ (columns @ c)))
        c = c @ right[: int(np.sum(s > TOLERANCES.independent_direction))].T
        along, own = directions @ c, u / spaces.scale
        off = own - along @ (np.linalg.pinv(along) @ own)
        if not c.shape[1] or np.linalg.norm(off) > TOLERANCES.independent_direction * np.linalg.norm(own):
            return [], [], []
        c, chosen = self._at_any_speed(c, lengths, np.linalg.pinv(along) @ own, items)
        names = [
            f"speed of {items[int(np.argmax(np.abs(x)))].name}" if np.sum(x != 0.0) == 1 else "speed" for x in chosen
        ]
        return [columns @ x for x in c.T], names, [] if np.any(u) else names

    def _at_any_speed(self, c: Array, lengths: Array, own: Array, items: list[Symmetry]) -> tuple[Array, list[Array]]:
        """Return the combinations along which the scene moves at any speed: all of them, or that of the reference."""

        def moves(coefficients: Array) -> bool:
            return self.invariance.moves_on(_combined(coefficients, items))

        chosen = _sparse(c / lengths[:, None])
        mixed = [*RandomNumbers(7).uniform(-1.0, 1.0, 2 if c.shape[1] > 1 else 0, c.shape[1])]
        if all(moves(x) for x in (*chosen, *(np.array(chosen).T @ x for x in mixed))):
            return c, chosen
        if np.any(own):
            # A wheel with a tyre may roll at any speed, but not sideways.
            c = c @ (own / np.linalg.norm(own))[:, None]
            chosen = _sparse(c / lengths[:, None])
            if moves(chosen[0]):
                return c, chosen
        return c[:, :0], []

    def _conserved(self, T: Array, S: Array) -> tuple[Array, list[str]]:
        """Return independent differentials that vanish on T, and names of what their values distinguish."""
        motion, n = self.linear.motion, len(S)
        integrals = [item for item in self.invariance.integrals if self.commutes(item)]
        pairs = [(item.direction, item.rate) for item in integrals]
        if self.linear.system.sparse and pairs:
            differentials = list(self.differential(*(np.array(x).T for x in zip(*pairs, strict=True))))
        else:
            differentials = [self.differential(direction, rate) for direction, rate in pairs]
        kinds = self._told_apart(differentials, T, S)
        named = zip(kinds, integrals, differentials, strict=True)
        candidates = [(f"{kind} of {item.name}", x) for kind, item, x in named]
        if np.any(motion.u) and self.work.conserved_at_rest:
            energy = self.differential(motion.u, motion.a)
            change, size = energy @ S, float(np.linalg.norm(energy)) * max(spectral_norm(S), self.invariance.rate)
            # Along a motion that is not steady the differential of the energy changes.
            if np.linalg.norm(change - (change @ T) @ T.T) <= TOLERANCES.direction_closure * size:
                candidates.append(("speed", energy))
        if not candidates or self._driven_boost():
            return np.zeros((0, n)), []
        rows = np.array([x / (np.linalg.norm(x) or 1.0) for _, x in candidates])
        # Combinations that do not change along T.
        if T.shape[1]:
            _, s, right = np.linalg.svd((rows @ T).T)
            rank = int(np.sum(s > TOLERANCES.independent_direction))
            rows = right[rank:] @ rows
            # The difference of equal functions is rounding.
            rows = rows[np.linalg.norm(rows, axis=1) > TOLERANCES.independent_direction]
        basis = orthonormal(list(rows), n)
        # Each is named after its largest component whose name is not taken yet.
        names: list[str] = []
        left = [(name, x, np.linalg.norm(x) or 1.0) for name, x in candidates]
        for differential in basis.T:
            # Of equal ones the first: rounding names nothing.
            weights = [-round(float(abs(x @ differential) / length), 9) for _, x, length in left]
            names.append(left.pop(weights.index(min(weights)))[0])
        if self.linear.system.sparse:
            names.sort(key=[name for name, _ in candidates].index)  # for many equal ones any basis is as good
        return basis.T, names

    def _tumbles(self) -> bool:
        """Return whether conserved momenta are those of rotations that do not commute, and do not all move on steadily.

        At rest such momenta are zero. With others a body of different moments tumbles for ever (Euler): what tells
        motions of the same kind apart must be constant in time and the same for all of a symmetry's images.
        """
        motion, invariance = self.linear.motion, self.invariance
        turns = [] if np.any(motion.u) else [x.of for x in invariance.momenta if x.of.shift is None]
        rng, brackets = RandomNumbers(5), list[Array]()
        for _ in range(2):
            q = motion.q + motion.sizes * rng.uniform(-0.5, 0.5, len(motion.q))
            at = [(field.field(q), field.slope(q)) for field in turns]
            pairs = ((D @ Y - E @ X) / motion.sizes for X, E in at for Y, D in at)
            brackets.append(np.array(list(pairs)).reshape(-1, len(q)))
        # Brackets of rotations and translations are translations, the same everywhere.
        if float(np.max(np.abs(brackets[0] - brackets[1]), initial=0.0)) <= TOLERANCES.independent_direction:
            return False
        # A ball turns about any axis in place, at any speed.
        still = invariance.identities.in_place()
        moved = np.array([x.field(motion.q) / motion.sizes for x in (*still, *turns)])
        ranks = [np.linalg.matrix_rank(x, tol=TOLERANCES.independent_direction) for x in (moved[: len(still)], moved)]
        if not still or ranks[0] < ranks[1]:
            return True
        mixed = still[0].times(float(rng.uniform(0.5, 1.0, 1)[0]))
        for field in still[1:]:
            mixed = mixed + field.times(float(rng.uniform(0.5, 1.0, 1)[0]))
        return not invariance.moves_on(mixed)

    def _told_apart(self, rows: list[Array], T: Array, S: Array) -> list[str]:
        """Return whether motions with different conserved functions end at another speed or at another place."""
        n = self.space.n_xi
        if self.linear.system.sparse and not any(np.any(row[:n]) for row in rows):
            return ["speed"] * len(rows)  # functions of the speeds alone
        _, s, right = np.linalg.svd(S - T @ (T.T @ S))
        kernel = right[s <= TOLERANCES.independent_direction * s[0]] if s[0] else right
        found = [kernel.T @ (kernel @ row) for row in rows]
        return [
            "position" if np.linalg.norm(y[n:]) <= TOLERANCES.direction_closure * np.linalg.norm(y[:n]) else "speed"
            for y in found
        ]

    def commutes(self, item: Symmetry) -> bool:
        """Return whether a symmetry is constant in the co-moving frame."""
        if self.linear.system.sparse and not np.any(item.rate):
            return True  # at rest
        y = self.column(item.direction, item.rate)
        n = self.space.n_xi
        moving = np.concatenate([self.space.A[:n, :n] @ y[:n], y[n:]])
        return bool(np.linalg.norm(moving[n:]) <= 1e-9 * np.linalg.norm(y))

    def _driven_boost(self) -> bool:
        """Return whether everything may be given another speed along a shift, although forces act along it.

        Motions of such a family need not be steady where other conserved functions have other values.
        """
        return not all(self.invariance.conserves(x.of) for x in self.invariance.boosts)


def admissible(across: Array) -> Array:
    """Return the combinations of directions that the rows allow as speeds, from what they forbid of each.

    Parameters
    ----------
    across : ndarray, shape (rows, k)

    Returns
    -------
    c : ndarray, shape (k, number), orthonormal columns
    """
    _, s, right = np.linalg.svd(across)
    result: Array = right[int(np.sum(s > TOLERANCES.independent_direction)) :].T
    return result


def _sparse(c: Array) -> list[Array]:
    """Return the columns with rounding errors set to zero."""
    return [np.where(np.abs(x) > TOLERANCES.independent_direction * np.max(np.abs(x)), x, 0.0) for x in c.T]


def _combined(c: Array, items: list[Symmetry]) -> Field:
    """Return a combination of symmetries."""
    first, *others = (item.of.times(float(x)) for x, item in zip(c, items, strict=True) if x)
    for other in others:
        first = first + other
    return first


def may_turn(S: Array, generator: Generator | None, rate: float) -> bool:
    """Return whether some direction is unchanged by S, or turns with the motion, as those of symmetries are or do.

    S has eigenvalues 0 or ± iΩ then, with the rates Ω of the motion.

    Parameters
    ----------
    rate : float (1/s)
        A characteristic rate of the scene.
    """
    least = TOLERANCES.direction_closure * max(spectral_norm(S), rate)
    shifted = (
        S - turn * 1j * np.eye(len(S)) if turn else S for turn in (0.0, *(_rates(generator) if generator else ()))
    )
    return any(_least_singular_value(x) <= least for x in shifted)


def _least_singular_value(S: Array) -> float:
    """Return the smallest singular value; for large matrices a lower bound by the inverse."""
    if len(S) < TOLERANCES.norm_by_powers_from:
        return float(np.linalg.svd(S, compute_uv=False)[-1])
    try:
        return 1.0 / float(np.linalg.norm(np.linalg.inv(S)))
    except np.linalg.LinAlgError:
        return 0.0


def unseparated(S: Array) -> Separated:
    """Return a matrix without known structure."""
    n = len(S)
    return Separated(S, np.zeros((n, 0)), np.zeros((0, n)), np.eye(n), Neutral())


def _rates(generator: Generator) -> tuple[float, ...]:
    """Return the different rates at which a steady motion turns (rad/s), fastest first."""
    spins = [x for name, x in zip(generator.system.names, generator.spins.tolist(), strict=True) if not is_length(name)]
    return tuple(sorted({abs(x) for x in (float(generator.rate), *spins) if x}, reverse=True))


def _axis(item: Symmetry) -> str:
    return item.name.removeprefix("translation along ")


def orthonormal(columns: list[Array], n: int) -> Array:
    """Return an orthonormal basis of the span of columns of length n."""
    if not columns:
        return np.zeros((n, 0))
    matrix = np.array([x / (np.linalg.norm(x) or 1.0) for x in columns]).T
    left, s, _ = np.linalg.svd(matrix, full_matrices=False)
    result: Array = left[:, s > TOLERANCES.independent_direction]
    return result


def complement(columns: Array) -> Array:
    """Return an orthonormal basis of the orthogonal complement of independent columns."""
    if not columns.shape[1]:
        return np.eye(len(columns))
    if len(columns) >= TOLERANCES.norm_by_powers_from:
        return np.asarray(np.linalg.qr(columns, mode="complete")[0][:, columns.shape[1] :])
    result: Array = np.linalg.svd(columns)[0][:, columns.shape[1] :]
    return result


def settled(S: Array, T: Array, L: Array, B: Array) -> tuple[Array, Array]:
    """Return T and B after one step of Newton's method for S T = T C, if T is less accurate than to rounding.

    The span of directions that are nearly dependent loses as many digits as their angle is small.
    """
    d = T.shape[1]
    r = B.shape[1]
    if not d or not 0 < d * r <= TOLERANCES.unknowns_of_correction:
        return T, B
    inner = T.T @ S @ T
    left = B.T @ (S @ T)
    if float(np.max(np.abs(left))) <= TOLERANCES.roundings_of_directions * EPS * float(np.max(np.abs(S) @ np.abs(T))):
        return T, B
    matrix = np.kron(B.T @ S @ B, np.eye(d)) - np.kron(np.eye(r), inner.T)
    try:
        step = least_squares(matrix, -left.ravel(), rcond=TOLERANCES.direction_closure).reshape(r, d)
    except np.linalg.LinAlgError:
        return T, B
    if not float(np.max(np.abs(step))) < TOLERANCES.direction_closure:
        return T, B
    T = np.linalg.qr(T + B @ step)[0]
    return T, complement(np.hstack([T, L.T]))


def spectral_norm(S: Array) -> float:
    """Return |S|₂; for large matrices a lower bound from some steps of the power method."""
    if len(S) < TOLERANCES.norm_by_powers_from:
        return float(np.linalg.norm(S, 2))
    x = np.random.default_rng(9).standard_normal(len(S))
    for _ in range(TOLERANCES.norm_powers):
        x = S.T @ (S @ (x / np.linalg.norm(x)))
    return float(np.sqrt(np.linalg.norm(x)))


def chains_of(found: Separated, named: Sequence[tuple[str, Array]] = ()) -> Chains | None:
    """Return the Jordan chains of the neutral directions; None where the rest has a zero that they would need.

    Parameters
    ----------
    named : sequence of (str, ndarray)
        Symmetries by name, with their directions in the coordinates of S: those along which disturbances grow are told.
    """
    S, T, L, B = found.S, found.T, found.L, found.B
    d, k = T.shape[1], len(L)
    if not d + k:
        return Chains()
    V = L.T
    if k and B.shape[1]:
        try:
            V = L.T - B @ np.linalg.solve(found.A, B.T @ S @ L.T)
        except np.linalg.LinAlgError:
            return None
    step = np.zeros((d + k, d + k))
    step[:d, :d], step[:d, d:] = T.T @ S @ T, T.T @ S @ V
    zero = max(TOLERANCES.neutral_rate * spectral_norm(S), TOLERANCES.direction_closure * spectral_norm(step))
    ranks, into, drifting = [d + k], np.hstack([T, V]), dict[str, int]()
    # Restricted to its range again and again, a matrix loses one link of its chains at zero each time. What is left may
    # be far smaller: where a motion turns slowly, only there its rate is not small beside what the speeds drive.
    while len(step):
        left, s, _ = np.linalg.svd(step)
        rank = int(np.sum(s > zero))
        if rank == len(step):
            break
        into = into @ left[:, :rank]
        drifting |= dict.fromkeys(_reached(into, named), len(ranks))
        step = left[:, :rank].T @ step @ left[:, :rank]
        ranks.append(rank)
    lost = -np.diff(ranks)
    zeros = tuple(int(np.sum(lost > i)) for i in range(lost[0] if len(lost) else 0))
    return Chains(zeros, len(step), _chain_of_turns(step), tuple(drifting.items()) if not len(step) else ())


def _reached(span: Array, named: Sequence[tuple[str, Array]]) -> list[str]:
    """Return the names of the symmetries of which some vector in a span, shape (n, r), has a part."""
    if not (span.shape[1] and named):
        return []
    directions = np.array([x / np.linalg.norm(x) for _, x in named]).T
    parts = np.abs(np.linalg.pinv(directions) @ (span / np.linalg.norm(span, axis=0))).max(axis=1)
    return [name for (name, _), part in zip(named, parts, strict=True) if part > TOLERANCES.independent_direction]


def _chain_of_turns(step: Array) -> int:
    """Return the length of the longest Jordan chain of a regular matrix whose eigenvalues are on the imaginary axis."""
    if not len(step):
        return 0
    size = float(np.linalg.norm(step, 2))
    once, values = np.eye(len(step)), np.linalg.eigvals(step / size)
    values = values[values.imag >= 0.0]
    while len(values):
        # Eigenvalues of a chain are known to a fraction of their digits, the mean of them to all.
        near = np.abs(values - values[0]) <= TOLERANCES.equal_turns
        mean = complex(np.mean(values[near]))
        part = step / size
        once = once @ (part @ part - 2.0 * mean.real * part + abs(mean) ** 2 * np.eye(len(step)))
        values = values[~near]
    product = np.eye(len(step))
    for order in range(1, TOLERANCES.chain_length + 1):
        product = product @ once
        if np.linalg.norm(product, 2) <= TOLERANCES.direction_closure:
            return order
    return TOLERANCES.chain_length
