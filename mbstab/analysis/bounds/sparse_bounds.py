"""Location of the eigenvalues of a large scene: discs from eigenvectors of the unreduced equations.

As `mbstab.analysis.bounds.location`, for matrices that are too large to couple every eigenvector with every other one.
With κ = |x| |y| / |y* Q'(s) x| of all eigenvalues s_k, the effect of residuals and data errors on one of them is

    |y|ᵀ (|s|²δM + |s|δR + δK) |x| / |y* Q' x|   and to second order   |Q x| |Q* y| / |y* Q' x| Σ κ_k / |s − s_k|,

with the effect of data errors added to the sizes of residuals. Eigenvalues whose discs overlap are judged together:
in a basis of their subspace the same holds for a small matrix, which Gershgorin's discs separate again.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from mbstab.analysis.algebra.arrays import Complex
from mbstab.analysis.algebra.sparse import in_parts
from mbstab.analysis.algebra.tolerances import EPS
from mbstab.analysis.algebra.tolerances import TOLERANCES as ALGEBRA
from mbstab.analysis.bounds.discs import Disc, Group, Placed, bounds_in, meeting, relative
from mbstab.analysis.bounds.grouping import covering, row_scaled_inverse, united
from mbstab.analysis.bounds.tolerances import TOLERANCES
from mbstab.analysis.linear.linearize import Linearization, StateSpace
from mbstab.analysis.linear.sparse_pencil import Block, Pairs, Residuals, SparsePencil, blocks_of
from mbstab.compiler.system import Array
from mbstab.records import dataclass

Key = tuple[int, ...]


@dataclass
class _Vectors:
    """Right vectors, as positions, and left ones, as forces, in scaled coordinates, of eigenvalues with Im s ≥ 0.

    Of squares s all are real. Of symmetric equations left vectors are the conjugates of right ones.
    """

    s: Any
    x: Any
    y: Any


def sparse_enclosures(linear: Linearization, space: StateSpace, gamma: float, S: Array, T: Array, L: Array) -> Placed:
    """Return discs that contain the eigenvalues other than those of T and L; see `bounds.enclosures`."""
    pencil = SparsePencil(linear)
    with np.errstate(all="ignore"):
        still = _idle(space, T, L) if pencil.undamped else None
        if still is None:
            return _Discs(pencil, *_general(space, gamma, S, T, L, pencil.symmetric)).placed()
        pencil.squares = True
        return _rooted(_Discs(pencil, _undamped(space, still), _Rest(0.0, 0.0)).placed())


def _rooted(squares: Placed) -> Placed:
    """Return ±√λ with their discs; a disc of squares that holds zero makes one disc about zero."""
    roots: Complex = np.sqrt(squares.values.astype(complex))
    values, count = np.asarray(np.concatenate([roots, -roots]) + 0.0, dtype=complex), len(roots)
    discs = list[Disc]()
    for disc in squares.discs:
        size, radius = abs(disc.centre), disc.radius
        images = tuple(count + i for i in disc.members)
        if size <= radius < math.inf:
            discs.append(Disc(0j, math.sqrt(size + radius) * (1.0 + 4.0 * EPS), disc.members + images))
        else:
            centre, reach = complex(np.sqrt(disc.centre + 0j)), math.inf
            if radius < math.inf:
                reach = radius / (math.sqrt(size) + math.sqrt(size - radius)) + 4.0 * EPS * math.sqrt(size)
            discs += [Disc(centre, reach, disc.members), Disc(-centre + 0.0, reach, images)]
    bounds = bounds_in(discs, values)
    column = np.tile(np.arange(count) if squares.column is None else squares.column, 2)
    backward = np.tile(squares.backward_error, 2)
    return Placed(values, discs, bounds, relative(bounds / EPS, values), backward, squares.vectors, column=column)


@dataclass(frozen=True)
class _Rest:
    """The contribution of T and L to the resolvent.

    Attributes
    ----------
    condition : float
    rate : float
        Size of S restricted to them (1/s).
    """

    condition: float
    rate: float

    def at(self, s: Array) -> Array:
        """Return a bound of their part of the resolvent at a distance from zero."""
        result: Array = np.asarray(sum(self.condition * self.rate**k / s ** (k + 1) for k in range(4)))
        return result


def _idle(space: StateSpace, T: Array, L: Array) -> Array | None:
    """Return the positions of T if T and L consist of these and their speeds or momenta; else None."""
    n = space.n_xi
    if not T.shape[1] + len(L):
        return np.zeros((n, 0))
    left, s, _ = np.linalg.svd(T[:n], full_matrices=False)
    X = left[:, s > 0.5]
    pairs = 2 * X.shape[1] == T.shape[1] + len(L)
    held = np.linalg.norm(L[:, :n]) + np.linalg.norm(L[:, n:] - L[:, n:] @ _onto(space.M_z @ X))
    speeds = np.linalg.norm(T[n:] - _onto(X) @ T[n:])
    return X if pairs and held + speeds < TOLERANCES.momentum_misfit else None


def _onto(X: Array) -> Array:
    """Return the projection onto the span of columns."""
    Q = np.linalg.qr(X)[0]
    return np.asarray(Q @ Q.T)


def _undamped(space: StateSpace, still: Array) -> _Vectors:
    """Return the squares λ of a symmetric problem without damping, apart from free positions.

    Free positions do not couple to the others: K maps them to zero, and the others are orthogonal to them in M.
    """
    from scipy.linalg import eigh

    n, M, k = space.n_xi, space.M_z, still.shape[1]
    stiffness = -M @ space.A[n:, :n]
    stiffness, M, N = 0.5 * (stiffness + stiffness.T), 0.5 * (M + M.T), space.spaces.N
    if k:
        B = np.linalg.qr(M @ still, mode="complete")[0][:, k:]
        stiffness, M, N = B.T @ stiffness @ B, B.T @ M @ B, N @ B
    squares, X = eigh(stiffness, M, check_finite=False)
    x = N @ X
    return _Vectors(-squares, x, x)


def _general(space: StateSpace, gamma: float, S: Array, T: Array, L: Array, symmetric: bool) -> tuple[_Vectors, _Rest]:
    """Return the eigenvalues of S apart from T and L."""
    from scipy.linalg import eig

    n, known, A, rest = space.n_xi, np.hstack([T, L.T]), S, _Rest(0.0, 0.0)
    if known.shape[1]:
        B = np.linalg.qr(known, mode="complete")[0][:, known.shape[1] :]
        A = B.T @ S @ B
        rest = _neutral(space, gamma, S, T, L, B, A)
    values, *both = eig(A, left=not symmetric, right=True, check_finite=False)
    upper = values.imag >= 0.0
    values, *both = (np.asarray(z[..., upper], dtype=complex) for z in (values, *both))
    if known.shape[1]:
        both = [B @ z for z in both]
        both[-1] = both[-1] + T @ _shifted(T.T @ S @ T, (T.T @ S) @ both[-1], values)
    N = space.spaces.N
    x = in_parts(lambda b: N @ b, both[-1][:n])
    if symmetric:
        return _Vectors(values, x, x.conj()), rest
    left = both[0] + L.T @ ((S @ L.T).T @ both[0] / values.conj())
    return _Vectors(values, x, in_parts(lambda b: N @ np.linalg.solve(space.M_z, b), left[n:])), rest


def _shifted(inner: Array, c: Complex, values: Complex) -> Complex:
    """Return (s − inner)⁻¹ c_j for each eigenvalue: S on T is nilpotent, or close to a rotation."""
    from scipy.linalg import schur, solve_triangular

    if not inner.size:
        return np.zeros_like(c)
    triangle, basis = schur(inner, output="complex")
    turned, one = basis.conj().T @ c, np.eye(len(inner))
    if not np.any(np.abs(triangle) > EPS * np.max(np.abs(values), initial=0.0)):
        return np.asarray(c / values)
    return np.asarray(
        basis @ np.array([solve_triangular(s * one - triangle, turned[:, j]) for j, s in enumerate(values)]).T
    )


def _neutral(space: StateSpace, gamma: float, S: Array, T: Array, L: Array, B: Array, A: Array) -> _Rest:
    """Return the response of T and L to forces."""
    n, none = space.n_xi, np.zeros((len(S), 0))
    V = L.T - B @ _solved(A, B.T @ (S @ L.T)) if len(L) else none
    W = T - B @ _solved(A.T, B.T @ (S.T @ T)) if T.shape[1] else none
    right, left = np.hstack([T, V]), np.hstack([W, L.T])
    inner = np.linalg.solve(left.T @ right, left.T @ (S @ right))
    forces = np.linalg.solve(space.M_z, left[n:] / gamma)
    size = np.linalg.norm(right[:n], 2) * np.linalg.norm(np.linalg.solve(left.T @ right, forces.T), 2)
    return _Rest(float(size), float(np.linalg.norm(inner, 2)))


def _solved(A: Array, b: Array) -> Array:
    """Return A⁻¹ b; of a singular matrix, with singular values of the size of its rounding in place of those below."""
    try:
        return np.asarray(np.linalg.solve(A, b))
    except np.linalg.LinAlgError:
        left, s, right = np.linalg.svd(A)
        return np.asarray(right.T @ ((left.T @ b) / np.maximum(s, EPS * s[0])[:, None]))


class _Discs:
    """Discs about eigenvalues with Im s ≥ 0, and their conjugates."""

    def __init__(self, pencil: SparsePencil, found: _Vectors, rest: _Rest) -> None:
        self.pencil, self.found, self.rest = pencil, found, rest
        k = len(found.s)
        self.s, self.slope = np.zeros((2, k), dtype=found.s.dtype)
        self.step, self.first, self.right, self.left, self.backward = np.zeros((5, k))
        self.coupling = np.full(k, np.inf)
        for start in range(0, k, TOLERANCES.eigenvectors_at_once):
            index = np.arange(start, min(start + TOLERANCES.eigenvectors_at_once, k))
            x = found.x[:, index]
            y = x if found.y is found.x else found.y[:, index]
            self._put(index, pencil.pairs(found.s[index], x, y))

    def _put(self, index: Any, pairs: Pairs) -> None:
        # A real eigenvalue stays real.
        self.s[index] = np.where(self.found.s[index].imag == 0.0, pairs.s.real, pairs.s)
        for name in ("slope", "step", "first", "right", "left", "backward"):
            getattr(self, name)[index] = getattr(pairs, name)
        self.first[index] += np.abs(pairs.s - self.s[index])

    # --- single eigenvalues -----------------------------------------------------------------------------------------

    @property
    def _all(self) -> tuple[Complex, Any]:
        """All eigenvalues, and for each the number of that with Im s ≥ 0."""
        pair = np.flatnonzero(self.s.imag > 0.0)
        return np.concatenate([self.s, self.s[pair].conj()]), np.concatenate([np.arange(len(self.s)), pair])

    def _surroundings(self) -> tuple[Array, Array]:
        """Return for each eigenvalue Σ κ_k / |s − s_k| over the others, and the distance to the nearest."""
        everything, of = self._all
        weight = 1.0 / np.abs(self.slope[of])
        total, nearest = np.zeros((2, len(self.s)))
        for start in range(0, len(self.s), ALGEBRA.columns_at_once):
            index = np.arange(start, min(start + ALGEBRA.columns_at_once, len(self.s)))
            distance = np.abs(self.s[index, None] - everything)
            distance[np.arange(len(index)), index] = np.inf
            total[index] = (1.0 / distance) @ weight
            nearest[index] = np.min(distance, axis=1)
        return total + self.rest.at(np.abs(self.s)), nearest

    def _singles(self) -> tuple[Array, Array]:
        """Return radii of single eigenvalues, inf where they cannot be separated, and the second-order terms."""
        total, nearest = self._surroundings()
        second = np.minimum(self.right * self.left / np.abs(self.slope) * total, self.coupling)
        radius = self.first + second + 4.0 * EPS * np.abs(self.s)
        clear = (radius < TOLERANCES.sparse_disc_distance * nearest) & (
            self.step < TOLERANCES.sparse_disc_distance * nearest
        )
        return np.where(clear, radius, np.inf), second

    def _improve(self) -> None:
        """Compute the coupling where the second order matters, and improve vectors where it still does."""
        radius, second = self._singles()
        _, nearest = self._surroundings()
        self._couple(
            np.flatnonzero(
                (second > TOLERANCES.second_order_in_bound * self.first)
                & (nearest > TOLERANCES.equal_eigenvalues * np.abs(self.s))
            )
        )
        radius, second = self._singles()
        poor = np.flatnonzero(np.isfinite(radius) & (second > TOLERANCES.second_order_in_bound * self.first))
        for i in poor.tolist():
            s = self.s[i]
            found = self.pencil.better(s, *(z[:, [i]].astype(self.s.dtype) for z in (self.found.x, self.found.y)))
            if found is None:
                continue
            pairs = self.pencil.pairs(np.array([s]), *found)
            if pairs.right[0] * pairs.left[0] < self.right[i] * self.left[i] * abs(pairs.slope[0] / self.slope[i]):
                self._put(np.array([i]), pairs)

    def _couple(self, index: Any) -> None:
        """Find the second-order terms of some eigenvalues from their coupling to each other one.

        Where masses differ by many orders, the sizes of residuals say nothing: light bodies move far, at other rates.
        """
        for start in range(0, len(index), ALGEBRA.columns_at_once):
            own = index[start : start + ALGEBRA.columns_at_once]
            r = self.pencil.residuals(self.found.s[own], *self._unit(own))
            total = np.zeros(len(own))
            for first in range(0, len(self.s), ALGEBRA.columns_at_once):
                others = np.arange(first, min(first + ALGEBRA.columns_at_once, len(self.s)))
                total += self._coupled(own, r, others)
            rest = self.right[own] * self.left[own] * self.rest.at(np.abs(self.s[own]))
            self.coupling[own] = (total + rest) / np.abs(self.slope[own])

    def _unit(self, index: Any) -> tuple[Any, Any]:
        """Return some of the vectors, scaled to length 1."""
        x, y = self.found.x[:, index], self.found.y[:, index]
        return x / np.linalg.norm(x, axis=0), y / np.linalg.norm(y, axis=0)

    def _coupled(self, own: Any, r: Residuals, others: Any) -> Array:
        """Return the effect of some eigenvalues and their conjugates on others."""
        x, y = self._unit(others)
        s = self.found.s[others]
        nu = mu = self.pencil.multipliers(self.pencil.force(s, x))
        if not self.pencil.squares:
            mu = self.pencil.multipliers(self.pencil.force(s.conj(), y, transposed=True))
        # Sizes are the same for both.
        into = np.abs(y).T @ r.open + np.abs(mu).T @ r.rows
        back = np.abs(x).T @ r.shut + np.abs(nu).T @ r.columns
        total = np.zeros(len(own))
        for image in (False,) if self.pencil.squares else (False, True):
            x, y, nu, mu = (z.conj() if image else z for z in (x, y, nu, mu))
            centres = self.s[others].conj() if image else self.s[others]
            distance = np.abs(centres[:, None] - self.s[own])
            none = (
                others[:, None] == own if not image else np.broadcast_to(centres.imag[:, None] == 0.0, distance.shape)
            )
            distance[none] = np.inf
            there = into + np.abs(y.conj().T @ r.off + mu.conj().T @ r.gap)
            here = back + np.abs(x.conj().T @ r.back + nu.conj().T @ r.drift)
            total += np.sum(there * here / (distance * np.abs(self.slope[others])[:, None]), axis=0)
        return total

    # --- clusters ---------------------------------------------------------------------------------------------------

    def placed(self) -> Placed:
        """Return values, discs and bounds."""
        self._improve()
        radius, _ = self._singles()
        values, of = self._all
        index = np.concatenate([np.arange(len(self.s)), np.flatnonzero(self.s.imag > 0.0)])
        radii, centres = radius[index], values.copy()
        discs = self._told(values, centres, radii)
        bounds = bounds_in(discs, values)
        condition = relative(bounds / EPS, values)
        return Placed(values + 0.0, discs, bounds, condition, self.backward[of], self.found.x, column=of)

    def _told(self, values: Complex, centres: Complex, radii: Array) -> list[Disc]:
        """Return discs, one for eigenvalues that cannot be separated; inserts the values of clusters."""
        partner = partners_of(values, len(self.s))
        known: dict[Key, list[Disc]] = {}
        singles = [[i] for i in range(len(values))]
        open_ = [i for i in range(len(values)) if not math.isfinite(radii[i])]
        _, nearest = _neighbours(values)
        pairs = [(i, int(nearest[i])) for i in open_]
        groups = united(singles, pairs, partner) if pairs else singles
        for _ in range(TOLERANCES.sparse_joining_rounds):
            self._find([tuple(sorted(g)) for g in groups if len(g) > 1], known, values, partner)
            discs: list[Disc] = []
            for g in groups:
                i = g[0]
                one = [Disc(complex(centres[i]), float(radii[i]), (i,))]
                discs += known[tuple(sorted(g))] if len(g) > 1 else one
            places = [d.centre for d in discs], [d.radius for d in discs]
            found = [(discs[i].members[0], discs[j].members[0]) for i, j in meeting(*places)]
            if self.pencil.squares:  # in squares the equations are linear: their blocks may be wide
                found += _lost(values, groups, known)
            if not found:
                return discs
            joined = united(singles, found + [(g[0], i) for g in groups for i in g[1:]], partner)
            if len(joined) == len(groups):
                groups_of = {i: g for g, members in enumerate(groups) for i in members}
                alone = {groups_of[i] for pair in found for i in pair}
                return [Disc(d.centre, math.inf, d.members) if groups_of[d.members[0]] in alone else d for d in discs]
            groups = joined
        return [Disc(d.centre, math.inf, d.members) for d in discs]

    def _find(self, groups: list[Key], known: dict[Key, list[Disc]], values: Complex, partner: list[int]) -> None:
        """Find the discs of groups of eigenvalues from their subspaces, some of them at once; inserts their values."""
        mirror = {g: tuple(sorted(partner[i] for i in g)) for g in groups}
        new = [g for g in groups if g not in known and g <= mirror[g]]
        while new:
            count = max(1, int(np.searchsorted(np.cumsum([len(g) for g in new]), TOLERANCES.eigenvectors_at_once)))
            part, new = new[:count], new[count:]
            bases = [self._basis(g, values, partner, mirror[g] == g) for g in part]
            blocks = blocks_of(self.pencil, [b[0] for b in bases], [b[1] for b in bases], [b[2] for b in bases])
            for g, block in zip(part, blocks, strict=True):
                known[g] = self._cluster(block, list(g), values, partner, mirror[g] == g)
        for g in groups:
            if g not in known:
                known[g] = [Disc(d.centre.conjugate(), d.radius, tuple(partner[i] for i in d.members))
                            for d in known[mirror[g]]]  # fmt: skip

    def _basis(self, members: Key, values: Complex, partner: list[int], real: bool) -> tuple[Any, Any, Any]:
        """Return the middle of a group and orthonormal bases of its right and left vectors."""
        if self.pencil.squares:
            X = np.linalg.qr(self.found.x[:, members])[0]
            return np.mean(values[list(members)]), X, X
        count = len(self.s)
        x, y = (
            np.column_stack([z[:, i] if i < count else z[:, partner[i]].conj() for i in members]).astype(complex)
            for z in (self.found.x, self.found.y)
        )
        centre = complex(np.mean(values[list(members)]))
        if real:
            # A group that is its own conjugate has a real basis.
            centre, x, y = complex(centre.real), np.hstack([x.real, x.imag]), np.hstack([y.real, y.imag])
        X, Y = (np.linalg.svd(z, full_matrices=False)[0][:, : len(members)].astype(complex) for z in (x, y))
        return centre, X, X.conj() if self.pencil.symmetric else Y

    def _cluster(self, found: Block, members: Group, values: Complex, partner: list[int], real: bool) -> list[Disc]:
        """Return the discs of a group."""
        centre = found.s
        unknown = [Disc(complex(centre), math.inf, tuple(members))]
        others = np.ones(len(values), dtype=bool)
        others[members] = False
        everything, of = self._all
        distance = np.abs(centre - everything[others])
        nearest = float(np.min(distance, initial=np.inf))
        if not np.isfinite(found.D).all() or not nearest > 0.0:
            return unknown
        total = float(np.sum(1.0 / (distance * np.abs(self.slope[of[others]]))))
        error = found.error(total + float(self.rest.at(np.abs(np.array([centre])))[0]))
        w, W = self._turned(found, real)
        reach = np.sum(np.abs(row_scaled_inverse(W)) @ error @ np.abs(W), axis=1) + 4.0 * EPS * abs(centre)
        reach = np.where(np.isfinite(reach), reach, np.inf)
        # The values are replaced by those of the block, in an order that keeps conjugates together.
        order = _in_order(values[members] - centre, w)
        w, reach = w[order], reach[order]
        values[members] = centre + w
        if not real:
            values[[partner[i] for i in members]] = values[members].conj()
        places = zip((centre + w).tolist(), reach.tolist(), members, strict=True)
        discs = covering([Disc(complex(place), radius, (i,)) for place, radius, i in places])
        # Even near to defective: no eigenvalue is farther from the middle than the norm.
        whole = float(np.linalg.norm(found.D, 2) + np.linalg.norm(error, 2)) + 4.0 * EPS * abs(centre)
        if not all(d.radius < whole for d in discs):
            discs = [Disc(complex(centre), whole, tuple(members))]
        apart = max(abs(d.centre - centre) + d.radius for d in discs) < TOLERANCES.sparse_disc_distance * nearest
        return discs if apart else unknown

    def _turned(self, found: Block, real: bool) -> tuple[Any, Any]:
        """Return the eigenvalues of a block and their vectors."""
        if not self.pencil.squares:
            w, W = np.linalg.eig(found.D.real if real else found.D)
            return w.astype(complex), W.astype(complex)
        from scipy.linalg import eigh

        mass = np.linalg.inv(found.inverse)
        form = mass @ found.D
        w, W = eigh(0.5 * (form + form.T), 0.5 * (mass + mass.T))
        return w, W


def partners_of(values: Complex, count: int) -> list[int]:
    """Return for each eigenvalue the number of its conjugate: those from `count` on are the conjugates."""
    partner = list(range(len(values)))
    for image, i in enumerate(np.flatnonzero(values[:count].imag > 0.0).tolist(), count):
        partner[i], partner[image] = image, i
    return partner


def _neighbours(values: Complex) -> tuple[Array, Any]:
    """Return for each value the distance to the nearest other one, and its number."""
    distance, index = np.full(len(values), np.inf), np.zeros(len(values), dtype=int)
    for start in range(0, len(values), ALGEBRA.columns_at_once):
        rows = np.arange(start, min(start + ALGEBRA.columns_at_once, len(values)))
        gap = np.abs(values[rows, None] - values)
        gap[np.arange(len(rows)), rows] = np.inf
        index[rows] = np.argmin(gap, axis=1)
        distance[rows] = np.min(gap, axis=1)
    return distance, index


def _lost(values: Any, groups: list[Group], known: dict[Key, list[Disc]]) -> list[tuple[int, int]]:
    """Return pairs to be joined: groups that are not apart from the others, each with the value nearest to it."""
    found = []
    for group in groups:
        if 1 < len(group) < len(values) and math.isinf(known[tuple(sorted(group))][0].radius):
            distance = np.min(np.abs(values - values[group][:, None]), axis=0)
            distance[group] = np.inf
            found.append((group[0], int(np.argmin(distance))))
    return found


def _in_order(first: Complex, then: Complex) -> Any:
    """Return for each of some values its partner among others, one to one."""
    from mbstab.analysis.algebra.matching import assigned

    distance = np.abs(first[:, None] - then)
    return np.asarray(assigned(np.nan_to_num(distance, nan=1e300, posinf=1e300)))
