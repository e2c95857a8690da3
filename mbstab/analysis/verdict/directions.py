"""Disturbances of one motion, or of those of many points of a sweep, and the spaces that they span.

In the balanced deflated system ẏ = S y, with y = [ξ; η] of `mbstab.analysis.linear.linearize`. All arrays may have
leading axes for the points of a sweep, of length 1 where all of them agree.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property

import numpy as np

from mbstab.analysis.algebra.arrays import Flags, norms
from mbstab.analysis.algebra.deflation import balanced
from mbstab.analysis.algebra.sparse import scaled
from mbstab.analysis.algebra.stacks import beside, complement, frobenius, stacked, transposed, under, unit
from mbstab.analysis.algebra.tolerances import TOLERANCES as ALGEBRA
from mbstab.analysis.linear.linearize import Linearization, StateSpace
from mbstab.analysis.reference.fields import Symmetry
from mbstab.analysis.reference.steady import Generator
from mbstab.analysis.verdict.followers import disturbances, led, left_behind
from mbstab.analysis.verdict.tolerances import TOLERANCES
from mbstab.compiler.system import Array
from mbstab.records import dataclass


class Ranks:
    """Decisions about ranks: they are made at one point, and must be the same at all points that have its pattern.

    Parameters
    ----------
    known : mapping, optional
        The ranks of the pattern by name; without it they are those of the one point.
    points : int, optional
        Number of the points that are compared with the pattern.

    Attributes
    ----------
    good : ndarray of bool, shape (points,)
        Where all decisions so far are those of the pattern.
    """

    def __init__(self, known: Mapping[str, int] | None = None, points: int = 1) -> None:
        self.making, self.known = known is None, dict(known or {})
        self.good: Flags = np.ones(points, dtype=bool)

    def require(self, holds: Flags) -> bool:
        """Return whether to go on: at one point where this holds; others where it does not are marked."""
        if self.making:
            return bool(holds)
        self.good = self.good & holds
        return True

    def of(self, name: str, s: Array, least: float = TOLERANCES.independent_direction) -> int:
        """Return the number of singular values, shape (…, k), above a limit."""
        count = np.sum(s > least, axis=-1)
        if self.making:
            self.known[name] = int(count)
        rank = self.known.get(name, 0)
        self.require(count == rank)
        return rank


def orthonormal(columns: Array, ranks: Ranks, name: str) -> Array:
    """Return orthonormal bases of spans of columns, of which those count that are independent."""
    rank = ranks.known.get(name, -1)
    if not columns.shape[-1]:
        return columns
    if columns.shape[-1] == rank:
        Q, R = np.linalg.qr(columns)
        ranks.of(name, np.abs(np.diagonal(R, axis1=-2, axis2=-1)))
        return Q
    left, s, _ = np.linalg.svd(columns, full_matrices=columns.shape[-1] < rank)
    return np.asarray(left[..., : ranks.of(name, s)])


def span(*columns: Array, ranks: Ranks | None = None, name: str = "") -> Array:
    """Return orthonormal bases of what columns, whatever their lengths, span together."""
    return orthonormal(unit(beside(*columns)), ranks or Ranks(), name)


@dataclass(frozen=True)
class Deflated:
    """The deflated equations, and the way into their coordinates and back.

    Attributes
    ----------
    q : ndarray, shape (…, n_q)
    steady : Generator or None
        The co-moving frame of the motion, if it rotates.
    scale : ndarray, shape (…, n_q)
    M, R, K : ndarray, shape (…, n_q, n_q)
        In scaled coordinates.
    N, Z, P : ndarray
        As in `mbstab.analysis.algebra.subspaces`.
    S : ndarray, shape (…, n, n)
        Balanced with …
    gamma : ndarray, shape (…) (1/s)
        … these rates, the units of speeds.
    """

    q: Array
    steady: Generator | None
    scale: Array
    M: Array
    R: Array
    K: Array
    N: Array
    Z: Array
    P: Array
    S: Array
    gamma: Array

    @classmethod
    def of(cls, linear: Linearization, space: StateSpace, gamma: float) -> Deflated:
        """Return those of one point."""
        spaces, n, generator = space.spaces, space.n_xi, linear.generator
        M, R, K = (scaled(x, spaces.scale, spaces.scale) for x in (linear.M, linear.R, linear.K))
        steady, S = generator if generator and generator.turns else None, balanced(space.A, n, gamma)
        bases = spaces.N, spaces.Z, space.A[:n, :n]
        return cls(linear.motion.q, steady, spaces.scale, M, R, K, *bases, S, np.array(gamma))

    @property
    def n_xi(self) -> int:
        """Number of positions among the components of y."""
        return int(self.N.shape[-1])

    @property
    def _unit(self) -> Array:
        return np.asarray(self.gamma)[..., None, None]

    @cached_property
    def slope(self) -> Array | None:
        """Ξ of the rotating frame in scaled coordinates; None without one."""
        return None if self.steady is None else self.scaled(self.steady.frame(self.q)[0])

    def scaled(self, slope: Array) -> Array:
        """Return the slope of a field in scaled coordinates."""
        return slope * self.scale[..., None, :] / self.scale[..., :, None]

    @cached_property
    def allowed(self) -> Array:
        """Speeds that all rows allow, as orthonormal columns."""
        return self.N if self.Z.shape[-1] == self.Z.shape[-2] else self.N @ self.Z

    @cached_property
    def rates(self) -> Array:
        """The map from y to the rates of ξ, shape (…, n_ξ, n)."""
        return beside(self.P, self._unit * self.Z)

    # --- into the coordinates and back ------------------------------------------------------------------------------

    def changes(self, items: Sequence[Symmetry]) -> tuple[Array, Array]:
        """Return the changes of coordinates and speeds under symmetries, as columns."""
        return stacked([x.direction for x in items]), stacked([x.rate for x in items])

    def columns(self, direction: Array, rate: Array) -> Array:
        """Return disturbances (Δq, Δu), given as columns (…, n_q, k), in the coordinates of S."""
        direction, rate = (x / self.scale[..., :, None] for x in (direction, rate))
        if self.slope is not None:
            rate = rate - self.slope @ direction
        xi = transposed(self.N) @ direction
        eta = transposed(self.Z) @ (transposed(self.N) @ rate - self.P @ xi)
        return under(xi, eta / self._unit)

    def of_symmetries(self, items: Sequence[Symmetry]) -> Array:
        """Return the disturbances that symmetries make, shape (…, n, k)."""
        return self.columns(*self.changes(items)) if items else np.zeros((*self._one, self.S.shape[-1], 0))

    def still(self, columns: Array) -> Array:
        """Return disturbances without their speeds."""
        found = np.array(columns)
        found[..., self.n_xi :, :] = 0.0
        return found

    def of_boosts(self, items: Sequence[Symmetry]) -> Array:
        """Return the disturbances with further speeds along symmetries, shape (…, n, k)."""
        if not items:
            return self.of_symmetries(items)
        direction = self.changes(items)[0]
        return self.columns(0.0 * direction, direction)

    @property
    def _one(self) -> tuple[int, ...]:
        """Leading axes of what is the same at all points."""
        return (1,) * (self.S.ndim - 2)

    def disturbances(self, y: Array) -> tuple[Array, Array]:
        """Return Δq and Δu, as columns (…, n_q, k), of disturbances in the coordinates of S."""
        direction, rate = self.N @ y[..., : self.n_xi, :], self.N @ (self.rates @ y)
        if self.slope is not None:
            rate = rate + self.slope @ direction
        return self.scale[..., :, None] * direction, self.scale[..., :, None] * rate

    def differentials(self, direction: Array, rate: Array) -> Array:
        """Return the differentials of the momenta along symmetries Y, given as columns, as rows (…, k, n).

        Yᵀ times the linearized equations is its rate: (Yᵀ R − Y'ᵀ M) Δq + Yᵀ M Δu, with Y' the rate of change of Y in
        the co-moving frame. Along the motion itself it is the differential of the energy.
        """
        direction, rate = (transposed(x / self.scale[..., :, None]) for x in (direction, rate))
        carried = rate if self.slope is None else rate - direction @ transposed(self.slope)
        speeds = direction @ self.M @ self.N
        positions = direction @ self.R @ self.N - carried @ self.M @ self.N + speeds @ self.P
        return beside(positions, self._unit * (speeds @ self.Z))

    def of_momenta(self, items: Sequence[Symmetry]) -> Array:
        """Return the differentials of the momenta along symmetries, shape (…, k, n)."""
        return self.differentials(*self.changes(items)) if items else transposed(self.of_symmetries(items))

    def followers(self, states: list[int]) -> Array:
        """Return disturbances of states that only follow, as columns in the coordinates of S."""
        return disturbances(self.N, self.Z, self.P, self.gamma, states)

    def second_variation(self, K: Array | None = None) -> Array:
        """Return the second variation of the energy, shape (…, n, n), with another stiffness if it is given."""
        return energy_form(self.M, self.K if K is None else K, self.N, self.rates)


def energy_form(M: Array, K: Array, N: Array, rates: Array) -> Array:
    """Return żᵀ M ż + zᵀ K z for z = N ξ and ż = N times the rates of y, shape (…, n, n)."""
    n, stiffness = N.shape[-1], transposed(N) @ K @ N
    H = transposed(rates) @ (transposed(N) @ M @ N) @ rates
    H = np.broadcast_to(H, (*np.broadcast_shapes(H.shape[:-2], stiffness.shape[:-2]), *H.shape[-2:])).copy()
    H[..., :n, :n] += 0.5 * (stiffness + transposed(stiffness))
    return H


# --- directions and functions ----------------------------------------------------------------------------------------


def rests(at: Deflated, ranks: Ranks, error: Array | float = 0.0) -> Array | None:
    """Return the directions of neighbouring rest positions, where the forces on the positions have full rank.

    They are then a manifold of the dimension of the independent rows on speeds (Neimark, Fufaev 1972). The norm of S is
    known to an error (1/s).
    """
    n = at.n_xi
    lower = at.S[..., n:, :]
    n_eta = lower.shape[-2]
    null = np.broadcast_to(np.eye(n), (*at._one, n, n))
    if n_eta:
        _, s, right = np.linalg.svd(lower[..., :n])
        if not ranks.require(s[..., -1] > np.maximum(TOLERANCES.rest_manifold_rank * frobenius(lower), error)):
            return None
        null = transposed(right[..., n_eta:, :])
    return under(null, np.zeros((*at._one, n_eta, null.shape[-1])))


def vanishing(rows: Array, T: Array, ranks: Ranks, name: str, least: float = TOLERANCES.independent_direction) -> Array:
    """Return independent combinations of differentials that vanish on directions, as orthonormal rows (…, k, n).

    Parameters
    ----------
    rows : ndarray, shape (…, k, n)
        Of length 1.
    T : ndarray, shape (…, n, d)
    ranks, name
        How many of them change along the directions, and how many are left.
    least : float
        How well those that vanish must do so.
    """
    if T.shape[-1] and rows.shape[-2]:
        _, s, right = np.linalg.svd(transposed(rows @ T))
        rank = ranks.of(f"{name} that change", s)
        if rank < s.shape[-1]:
            ranks.require(s[..., rank] <= least)
        rows = right[..., rank:, :] @ rows
    # The difference of equal functions is rounding.
    length = np.linalg.norm(rows, axis=-1, keepdims=True)
    counts = length > TOLERANCES.independent_direction
    rows = np.where(counts, rows / np.where(counts, length, 1.0), 0.0)
    return transposed(orthonormal(transposed(rows), ranks, name))


def speeds_along(
    at: Deflated, items: Sequence[Symmetry], states: list[int], T: Array, ranks: Ranks
) -> tuple[Array, Array, Array]:
    """Return speeds along symmetries that the rows allow and that directions do not contain.

    Parameters
    ----------
    states : list of int
        Coordinates whose speeds follow from the others.

    Returns
    -------
    moved : ndarray, shape (…, n, m)
        Disturbances with such speeds.
    c : ndarray, shape (…, k, m)
        The combinations of the symmetries along which they go.
    along : ndarray, shape (…, n_q, m)
        The directions of these, in scaled coordinates.
    """
    changes = at.changes(items)
    directions = changes[0] / at.scale[..., :, None]
    lengths = norms(directions, -2, keepdims=True)
    directions = directions / lengths
    speeds, across = led(directions, at.allowed, states)
    eta = transposed(at.Z) @ (transposed(at.N) @ speeds)
    columns = under(np.zeros((*at._one, at.n_xi, eta.shape[-1])), eta)
    if states:
        along = at._unit * at.columns(*(x / lengths for x in changes))
        columns, lacking = left_behind(at.S, at.followers(states), columns, along)
        across = under(across, lacking / at._unit)
    _, s, right = np.linalg.svd(across)
    c = transposed(right[..., ranks.of("symmetries across rows", s) :, :])
    moved = columns @ c
    _, s, right = np.linalg.svd(moved - T @ (transposed(T) @ moved))
    c = c @ transposed(right[..., : ranks.of("speeds", s), :])
    return columns @ c, c / transposed(lengths), directions @ c


def not_driven(F: Array, T: Array, constant: list[int], ranks: Ranks) -> Array:
    """Return the disturbances of states that need not decay, as orthonormal combinations of columns F.

    They are those among unit columns T of symmetries, and those of states that are constant, of given numbers.
    """
    T = beside(T, unit(F[..., constant]))
    parts = np.linalg.pinv(F) @ T
    _, s, right = np.linalg.svd(T - F @ parts)
    parts = parts @ transposed(right[..., ranks.of("directions beyond states", s) :, :])
    return orthonormal(parts, ranks, "directions of states")


def own_speed(along: Array, u: Array) -> Array:
    """Return which combination of directions the motion follows with speeds u in scaled coordinates, (…, m, 1)."""
    found: Array = np.linalg.pinv(along) @ u[..., None]
    return found


def with_mirrored(at: Deflated, symmetries: Sequence[Symmetry], size: int, ranks: Ranks) -> tuple[Array, Array] | None:
    """Return the directions of symmetries and of the family of a reversor, and those of the family beside the others.

    Parameters
    ----------
    size : int
        Dimension of the family; None is returned where S modulo the symmetries has not as many zeros.
    """
    own = span(at.of_symmetries(symmetries), ranks=ranks, name="symmetries")
    Q = complement(own)
    _, s, right = np.linalg.svd(transposed(Q) @ at.S @ Q)
    limit = TOLERANCES.mirrored_singular_value * s[..., 0]
    fits = np.sum(s <= limit[..., None], axis=-1) == size
    if size < s.shape[-1]:
        fits = fits & (s[..., -size - 1] >= ALGEBRA.rank_gap * np.maximum(s[..., -size], 1e-300))
    if not ranks.require(fits):
        return None
    family = Q @ transposed(right[..., -size:, :])
    return span(own, family, ranks=ranks, name="family of a reversor"), family


def misfit(S: Array, T: Array, L: Array) -> Array:
    """Return how far S leads out of directions, and functions are not constant up to them, shape (…)."""
    ST, LS = S @ T, L @ S
    result: Array = frobenius(ST - T @ (transposed(T) @ ST)) + frobenius(LS - (LS @ T) @ transposed(T))
    return result


def at_given_momenta(columns: Array, rows: Array, ranks: Ranks) -> Array:
    """Return disturbances with given momenta, modulo symmetries that keep them, as orthonormal columns.

    Parameters
    ----------
    columns : ndarray, shape (…, n, k)
        Of symmetries.
    rows : ndarray, shape (…, m, n)
        Differentials of momenta.
    """
    kernel = complement(span(transposed(rows), ranks=ranks, name="momenta"))
    if not columns.shape[-1]:
        return kernel
    columns = unit(columns)
    inside = transposed(kernel) @ columns
    if rows.shape[-2]:
        _, s, right = np.linalg.svd(columns - kernel @ inside)
        inside = inside @ transposed(right[..., ranks.of("symmetries that change momenta", s) :, :])
    return kernel @ complement(orthonormal(inside, ranks, "symmetries at given momenta"))
