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

from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from functools import cached_property

import numpy as np

from mbstab.analysis.algebra.arrays import RandomNumbers, least_squares, norms
from mbstab.analysis.algebra.augmented import of_rank
from mbstab.analysis.algebra.sparse import scaled
from mbstab.analysis.algebra.stacks import beside, complement, frobenius, under, unit
from mbstab.analysis.algebra.tolerances import EPS
from mbstab.analysis.linear.linearize import Linearization, StateSpace
from mbstab.analysis.linear.roundings import roundings
from mbstab.analysis.reference.fields import Field, Symmetry
from mbstab.analysis.reference.steady import Generator
from mbstab.analysis.reference.symmetries import Invariance
from mbstab.analysis.reference.tolerances import TOLERANCES as REFERENCE
from mbstab.analysis.verdict.directions import Deflated, Ranks, misfit, own_speed, rests, span, speeds_along, vanishing
from mbstab.analysis.verdict.spectrum import Chains, Neutral
from mbstab.analysis.verdict.tolerances import TOLERANCES
from mbstab.analysis.verdict.work import Work
from mbstab.compiler.system import Array
from mbstab.model.schema import is_length
from mbstab.records import dataclass


@dataclass(frozen=True)
class Choice:
    """What a point has beside its symmetries, as points of the same structure must have it.

    Attributes
    ----------
    ranks : mapping
        Decisions of `Ranks` by name.
    rests : bool
        Whether directions of neighbouring rest positions are among T.
    momenta : tuple of Symmetry
        Those whose momenta are conserved, if functions tell motions apart.
    energy : bool
        Whether the energy is one of these functions.
    moving : tuple of Symmetry
        Those along which the scene may move on, if speeds along them are among T.
    alone : bool
        Whether it may do so along the motion itself only, not along each of them.
    family : int
        Dimension of the family of a reversor.
    """

    ranks: Mapping[str, int] = field(default_factory=dict)
    rests: bool = False
    momenta: tuple[Symmetry, ...] = ()
    energy: bool = False
    moving: tuple[Symmetry, ...] = ()
    alone: bool = False
    family: int = 0


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
    choice : Choice
    fitted : float
        How far T was moved to fit the rounding of S.
    """

    S: Array
    T: Array
    L: Array
    B: Array
    neutral: Neutral
    rates: tuple[float, ...] = ()
    choice: Choice = field(default_factory=Choice)
    fitted: float = 0.0

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
    at : Deflated
        The same in balanced coordinates.
    invariance : Invariance
    work : Work, optional
        The work of the elements in the frame of the motion, if something is known of it.
    """

    def __init__(
        self, linear: Linearization, space: StateSpace, at: Deflated, invariance: Invariance, work: Work | None = None
    ) -> None:
        self.linear, self.space, self.at, self.invariance = linear, space, at, invariance
        self.work = work or Work(invariance, linear.generator)

    def column(self, direction: Array, rate: Array) -> Array:
        """Return a disturbance (Δq, Δu) in the coordinates of the balanced S."""
        return self.at.columns(direction[:, None], rate[:, None])[:, 0]

    def disturbance(self, y: Array) -> tuple[Array, Array]:
        """Return Δq and Δu of a disturbance in the coordinates of the balanced S."""
        direction, rate = self.at.disturbances(y[:, None])
        return direction[:, 0], rate[:, 0]

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

    def separated(self) -> Separated:
        """Return the balanced S with its neutral directions."""
        at, ranks = self.at, Ranks()
        S, invariance, generator = at.S, self.invariance, self.linear.generator
        rates = () if generator is None else _rates(generator)
        if not len(S):
            return unseparated(S)
        columns = beside(at.of_symmetries(invariance.symmetries), at.of_boosts(invariance.boosts))
        family = [f"speed along {_axis(item)}" for item in invariance.boosts]
        rest = self._rest(ranks)
        if rest is not None:
            family += ["position at rest"] * (rest.shape[1] > span(columns).shape[1])
            columns = beside(columns, rest)
        T = span(columns, ranks=ranks, name="directions")
        choice = Choice(ranks.known, rest is not None)
        L, choice, kept = self._conserved(T, choice, ranks)
        family += kept
        # Where conserved functions have other values, the motion need not be steady.
        moving, choice, speeds = self._moving(T, choice, ranks) if not len(L) else (T[:, :0], choice, [])
        family += speeds
        if moving.shape[1]:
            T = span(T, moving, ranks=ranks, name="directions with speeds")
        d = T.shape[1]
        # Where forces cancel in a critical state, S itself may be only rounding.
        if misfit(S, T, L) > TOLERANCES.direction_closure * max(float(frobenius(S)), invariance.rate):
            return unseparated(S)  # equations of an instant need not have the symmetries of the motion
        T, B, fitted = settled(S, T, L, complement(beside(T, L.T)))
        found = Separated(S, T, L, B, Neutral(), rates, choice, fitted)
        neutral = Neutral(
            tuple(item.name for item in invariance.symmetries),
            tuple(family),
            d + len(L),
            self.chains(found),
            "numerical" if d + len(L) else "structural",
            # The energy may bound the speeds of a scene at rest.
            slow=() if np.any(self.linear.motion.u) else tuple(speeds),
            tumbling=bool(len(L)) and self._tumbles(),
        )
        return replace(found, neutral=neutral)

    def chains(self, found: Separated) -> Chains | None:
        """Return the chains of neutral directions, with the names of the symmetries that drift."""
        items = self.invariance.symmetries
        return chains_of(found, [(x.name, y) for x, y in zip(items, self.at.of_symmetries(items).T, strict=True)])

    @property
    def symmetric(self) -> Array:
        """Orthonormal directions of the symmetries alone, shape (n, d)."""
        return span(self.at.of_symmetries(self.invariance.symmetries))

    def _rest(self, ranks: Ranks) -> Array | None:
        """Return the directions of neighbouring rest positions, where rows on speeds leave a manifold of them."""
        linear, at = self.linear, self.at
        if linear.massless is not None and len(linear.massless.first_order):
            return None  # their rows are not satisfied by every rest
        if len(at.S) >= 2 * at.n_xi or np.any(linear.motion.u) or not self.work.rows_at_rest:
            return None
        found = rests(at, ranks)
        return None if found is None or (at.Z.shape[1] and not self._held_by_forces()) else found

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

    def _moving(self, T: Array, choice: Choice, ranks: Ranks) -> tuple[Array, Choice, list[str]]:
        """Return speeds along symmetries at which a scene may move as steadily as at rest, and as the reference does.

        A wheel may roll, and a balanced rotor turn, at any speed, although no momentum along it is conserved.
        """
        items = tuple(x for x in self.invariance.symmetries if self.commutes(x))
        linear, nothing = self.linear, (T[:, :0], choice, list[str]())
        if not items or not (np.any(linear.motion.u) or self.work.led_at_rest):
            return nothing
        moved, c, along = speeds_along(self.at, items, linear.system.following, T, ranks)
        u = linear.motion.u / linear.spaces.scale
        own = own_speed(along, u)
        if not len(own) or np.linalg.norm(u - (along @ own)[:, 0]) > TOLERANCES.independent_direction * np.linalg.norm(
            u
        ):
            return nothing
        alone, chosen = False, self._at_any_speed(c, items)
        if chosen is None and np.any(own):
            # A wheel with a tyre may roll at any speed, but not sideways.
            alone, moved, chosen = True, moved @ unit(own), self._at_any_speed(c @ unit(own), items)
        if chosen is None:
            return nothing
        names = [
            f"speed of {items[int(np.argmax(np.abs(x)))].name}" if np.sum(x != 0.0) == 1 else "speed" for x in chosen
        ]
        return moved, replace(choice, moving=items, alone=alone), names

    def _at_any_speed(self, c: Array, items: Sequence[Symmetry]) -> list[Array] | None:
        """Return combinations of symmetries, given as columns, if the scene moves along all of them at any speed."""
        chosen = [np.where(np.abs(x) > TOLERANCES.independent_direction * np.max(np.abs(x)), x, 0.0) for x in c.T]
        mixed = [*RandomNumbers(7).uniform(-1.0, 1.0, 2 if c.shape[1] > 1 else 0, c.shape[1])]
        asked = (*chosen, *(np.array(chosen).T @ x for x in mixed))
        return chosen if all(self.invariance.moves_on(_combined(x, items)) for x in asked) else None

    def _conserved(self, T: Array, choice: Choice, ranks: Ranks) -> tuple[Array, Choice, list[str]]:
        """Return independent differentials that vanish on T, and names of what their values distinguish."""
        motion, at = self.linear.motion, self.at
        S, nothing = at.S, (T.T[:0], choice, list[str]())
        integrals = tuple(item for item in self.invariance.integrals if self.commutes(item))
        rows = at.of_momenta(integrals)
        names = [f"{kind} of {item.name}" for kind, item in zip(self._told_apart(rows, T, S), integrals, strict=True)]
        moves = bool(np.any(motion.u)) and self.work.conserved_at_rest
        if moves:
            energy = at.differentials(motion.u[:, None], motion.a[:, None])
            change, size = energy @ S, float(np.linalg.norm(energy)) * max(spectral_norm(S), self.invariance.rate)
            # Along a motion that is not steady the differential of the energy changes.
            moves = bool(np.linalg.norm(change - (change @ T) @ T.T) <= TOLERANCES.direction_closure * size)
        if moves:
            rows, names = under(rows, energy), [*names, "speed"]
        if not names or self._driven_boost():
            return nothing
        rows = rows / norms(rows)[:, None]
        L = vanishing(rows, T, ranks, "functions")
        # Each is named after its largest component whose name is not taken yet.
        left, taken = list(zip(names, rows, strict=True)), list[str]()
        for differential in L:
            # Of equal ones the first: rounding names nothing.
            weights = [-round(float(abs(x @ differential)), 9) for _, x in left]
            taken.append(left.pop(weights.index(min(weights)))[0])
        taken.sort(key=names.index)  # of equal ones any basis is as good
        return L, replace(choice, momenta=integrals, energy=moves) if len(L) else choice, taken

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
        for other in still[1:]:
            mixed = mixed + other.times(float(rng.uniform(0.5, 1.0, 1)[0]))
        return not invariance.moves_on(mixed)

    def _told_apart(self, rows: Array, T: Array, S: Array) -> list[str]:
        """Return whether motions with different conserved functions end at another speed or at another place."""
        n = self.space.n_xi
        if not len(rows) or (self.linear.system.sparse and not np.any(rows[:, :n])):
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
        return bool(np.linalg.norm(y[self.space.n_xi :]) <= 1e-9 * np.linalg.norm(y))

    def _driven_boost(self) -> bool:
        """Return whether everything may be given another speed along a shift, although forces act along it.

        Motions of such a family need not be steady where other conserved functions have other values.
        """
        return not all(self.invariance.conserves(x.of) for x in self.invariance.boosts)


def _combined(c: Array, items: Sequence[Symmetry]) -> Field:
    """Return a combination of symmetries."""
    first, *others = (item.of.times(float(x)) for x, item in zip(c, items, strict=True) if x)
    for other in others:
        first = first + other
    return first


def may_turn(S: Array, generator: Generator | None, rate: float, closeness: float = 0.0) -> bool:
    """Return whether some direction is unchanged by S, or turns with the motion, as those of symmetries are or do.

    S has eigenvalues 0 or ± iΩ then, with the rates Ω of the motion.

    Parameters
    ----------
    rate : float (1/s)
        A characteristic rate of the scene.
    closeness : float
        How well S is known, relative to its size.
    """
    least = max(TOLERANCES.direction_closure, closeness) * max(spectral_norm(S), rate)
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


def settled(S: Array, T: Array, L: Array, B: Array) -> tuple[Array, Array, float]:
    """Return T and B after one step of Newton's method for S T = T C, if T is less accurate than to rounding.

    The span of directions that are nearly dependent loses as many digits as their angle is small. Exact ones are moved
    by the rounding of S: the last number says how far, and is 0 where they moved farther and so were not exact.
    """
    d = T.shape[1]
    r = B.shape[1]
    if not d or not 0 < d * r <= TOLERANCES.unknowns_of_correction:
        return T, B, 0.0
    inner = T.T @ S @ T
    left = B.T @ (S @ T)
    if float(np.max(np.abs(left))) <= TOLERANCES.roundings_of_directions * EPS * float(np.max(np.abs(S) @ np.abs(T))):
        return T, B, 0.0
    matrix = np.kron(B.T @ S @ B, np.eye(d)) - np.kron(np.eye(r), inner.T)
    try:
        step = least_squares(matrix, -left.ravel(), rcond=TOLERANCES.direction_closure).reshape(r, d)
    except np.linalg.LinAlgError:
        return T, B, 0.0
    if not float(np.max(np.abs(step))) < TOLERANCES.direction_closure:
        return T, B, 0.0
    exact, T = T, np.linalg.qr(T + B @ step)[0]
    B = complement(beside(T, L.T))
    moved = float(np.linalg.norm(B.T @ exact))
    return T, B, moved if moved <= TOLERANCES.roundings_of_directions * EPS else 0.0


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
