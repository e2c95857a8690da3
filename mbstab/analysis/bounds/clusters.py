"""Clusters of eigenvalues: decoupled, refined, and enclosed in discs by Gershgorin's theorem and Newton steps."""

from __future__ import annotations

import math
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from mbstab.analysis.algebra.arrays import Complex, at_block, least_squares
from mbstab.analysis.algebra.tolerances import EPS
from mbstab.analysis.bounds.backward_errors import BackwardErrors, Motions, Weights
from mbstab.analysis.bounds.discs import Disc, Group, Placed, bounds_in, meeting, relative
from mbstab.analysis.bounds.grouping import below, coupled, dependent, partners, row_scaled_inverse, united
from mbstab.analysis.bounds.tolerances import TOLERANCES
from mbstab.analysis.linear.tolerances import TOLERANCES as LINEAR
from mbstab.compiler.system import Array

if TYPE_CHECKING:
    import numpy.typing as npt


class _Around:
    """The surroundings of a group: the effect of the others on its block, for all s within a circle."""

    def __init__(self, found: Clusters, members: Group, centre: complex) -> None:
        self.members, self.centre = members, centre
        rest = np.flatnonzero(found.of != found.of[members[0]])
        self.rest, self.distance = rest, np.abs(found.s[rest] - centre)
        E = found.E
        self.inner, self.way = E[at_block(members, members)], E[at_block(rest, members)]
        self.among, self.into = E[at_block(rest, rest)], E[at_block(members, rest)]
        self.clusters = []
        for g in sorted(set(found.of[rest].tolist())):
            if len(found.groups[g]) > 1:
                part = np.flatnonzero(found.of[rest] == g)
                block = found.T[at_block(rest[part], rest[part])]
                try:
                    inverse = np.abs(np.linalg.inv(centre * np.eye(len(part)) - block))
                except np.linalg.LinAlgError:
                    inverse = np.full(block.shape, np.inf)
                radius = float(np.max(np.abs(np.linalg.eigvals(inverse)))) if np.isfinite(inverse).all() else np.inf
                self.clusters.append((part, inverse, radius))

    @cached_property
    def culprit(self) -> int | None:
        """The nearest eigenvalue outside the group."""
        return int(self.rest[np.argmin(np.nan_to_num(self.distance, nan=0.0))]) if len(self.rest) else None

    def outside(self, radius: float) -> Array | None:
        """Return the effect of the others on the block, None if it has no bound."""
        if not len(self.rest):
            return np.zeros((len(self.members), len(self.members)))
        distance = self.distance - radius
        if not np.all(distance > 0.0):
            return None
        matrix: Array = np.diag(1.0 / distance)
        for part, inverse, largest in self.clusters:
            # (s − C)⁻¹ is a power series about the centre.
            if not radius * largest < 0.5:
                return None
            matrix[at_block(part, part)] = np.linalg.solve(np.eye(len(part)) - radius * inverse, inverse)
        x = 1.2 * (matrix @ self.way)
        for _ in range(6):
            y = matrix @ (self.way + self.among @ x)
            if np.all(y <= x):
                result: Array = self.into @ y
                return result
            x = 1.2 * np.maximum(x, y)
        return None


class Clusters:
    """Eigenvalues judged in groups: bases, blocks, error bounds and radii."""

    def __init__(
        self,
        judge: BackwardErrors,
        W: Complex,
        C: Complex,
        groups: list[Group],
        partner: list[int],
        rates: Array | None = None,
    ) -> None:
        self.judge, self.partner = judge, partner
        self.groups = groups
        self.of = np.zeros(len(W), dtype=int)
        for g, members in enumerate(groups):
            self.of[members] = g
        self.mirror = [int(self.of[partner[members[0]]]) for members in groups]
        self.centres, self.radii = np.zeros(len(groups), dtype=complex), np.full(len(groups), np.inf)
        self.W, self.C = W.copy(), C.copy()
        for g, members in enumerate(groups):
            if len(members) > 1 and self.mirror[g] >= g:
                # No spread of eigenvalues exceeds the matrix, whatever was made of vectors that are lost.
                rate = 0.0 if rates is None else min(float(np.max(rates[members])), float(np.linalg.norm(judge.A)))
                self._base(members, self.mirror[g] == g, rate)
        self._settle()

    # --- bases ------------------------------------------------------------------------------------------------------

    def _base(self, members: Group, real: bool, rate: float) -> None:
        """Insert an orthonormal basis of the subspace of a group, a real one if the group is its own conjugate.

        Orthonormal with speeds in units of the rate of the group, so that slow parts are not lost beside fast ones.
        """
        judge, at = self.judge, at_block(members, members)
        columns, block = self.W[:, members], self.C[at]
        V = np.full_like(columns, np.nan)
        if np.isfinite(columns).all() and np.isfinite(block).all():
            values = np.linalg.eigvals(block)
            rate = max(rate, float(np.max(np.abs(values))))
            V = judge.weighted(columns, rate)
        known = np.isfinite(V).all() and np.all(np.any(V, axis=0))
        least = np.linalg.svd(V / np.linalg.norm(V, axis=0), compute_uv=False)[-1] if known else np.inf
        if not least >= TOLERANCES.cluster_singular_value:
            columns = self._schur(values, len(members))
            block, V = columns.conj().T @ judge.A @ columns, judge.weighted(columns, rate)
        lengths = np.linalg.norm(V, axis=0)
        V = V / lengths
        if not np.isfinite(V).all():
            self.W[:, members], self.C[at] = np.nan, np.nan
            return
        if real:
            basis = np.linalg.svd(np.hstack([V.real, V.imag]), full_matrices=False)[0][:, : len(members)]
        else:
            basis = np.linalg.qr(V)[0]
        turn = least_squares(V, basis.astype(complex), rcond=None) / lengths[:, None]
        columns, block = columns @ turn, np.linalg.solve(turn, block @ turn)
        if real:
            columns, block = columns.real, block.real
        self.W[:, members], self.C[at] = columns, block
        if not real:
            others = [self.partner[i] for i in members]
            self.groups[self.mirror[self.of[members[0]]]] = others
            self.W[:, others], self.C[at_block(others, others)] = columns.conj(), block.conj()

    def _schur(self, centre: Complex, count: int) -> Complex:
        """Return an orthonormal basis of the invariant subspace of a cluster without enough vectors."""
        from scipy.linalg import schur

        A = self.judge.A.astype(complex)
        near = np.sort([float(np.min(np.abs(centre - x))) for x in np.linalg.eigvals(A)])
        limit = 0.5 * (near[count - 1] + near[count]) if count < len(A) else np.inf

        def inside(x: complex) -> bool:
            return bool(np.min(np.abs(centre - x)) <= limit)

        # If more are as near, the coupling of the block to the others will show it.
        _, basis, _ = schur(A, output="complex", sort=inside)
        result: Complex = basis[:, :count]
        return result

    def _settle(self) -> None:
        """Correct blocks and bases by their residuals in the unreduced equations."""
        judge = self.judge
        blocks = self.of[:, None] == self.of
        single = np.sum(blocks, axis=0) == 1
        best = math.inf
        for _ in range(TOLERANCES.vector_improvements):
            x, V = judge.motions(judge.B @ self.W, self.C)
            rows = row_scaled_inverse(judge.B.T @ V) @ judge.B.T
            w = judge.weights(rows)
            # The part of the speeds of the motions along L does not belong to them.
            F = judge.residual(x, w, self.C) + (rows @ judge.outside) @ (judge.L @ V)
            data = judge.data(x, w, V, rows, self.C, blocks) + judge.leaving(w, V, rows, self.C, blocks)
            # After the correction, terms of second order in it remain.
            step = np.where(blocks, F, 0.0)
            left = np.abs(step) @ np.abs(w.y @ (judge.m.M @ x.pos)) @ np.abs(step)
            # The rows are the inverse of the columns up to rounding, also that of their forces.
            off = np.abs(judge.acting(rows, w) @ V - np.eye(len(F)))
            off += LINEAR.roundings_of_sum * EPS * (np.abs(rows) @ np.abs(V))
            left += off @ np.abs(F)
            T, outside = self.C - step, np.where(blocks, 0.0, F)
            spectrum = self._spectrum(T)
            worst = np.maximum(self._coupled(outside, spectrum, data), np.diag(left) / np.diag(data))
            amount = float(np.max(np.nan_to_num(worst, nan=np.inf), initial=0.0))
            if best == math.inf or amount < best:
                best = amount
                # Blocks are known to their own rounding at best.
                own = np.where(blocks & ~single, TOLERANCES.roundings_of_block * EPS * np.abs(T), 0.0)
                self.E, self.T, self.s = data + np.abs(outside) + left + own, T, spectrum
                self.V, self.rows, self.x, self.w, self.F, self.data = V, rows, x, w, F, data
                kept = self.W, self.C
            else:
                break
            if not amount > TOLERANCES.coupling_in_bound:
                break
            self.W, self.C = self.W + self.W @ self._turn(F, blocks), T
        self.W, self.C = kept

    def _coupled(self, outside: Complex, s: Complex, data: Array) -> Array:
        """Return the effect of residuals outside the blocks on each eigenvalue, relative to that of data errors."""
        gap = np.abs(s[:, None] - s)
        gap[self.of[:, None] == self.of] = np.inf
        product = np.abs(outside * outside.T) / gap
        result: Array = np.sum(product, axis=1) / np.diag(data)
        return np.nan_to_num(result, nan=np.inf)

    def _turn(self, F: Complex, blocks: npt.NDArray[np.bool_]) -> Complex:
        """Return Δ such that W (1 + Δ) has residuals of second order outside the blocks: C Δ − Δ C = F there."""
        s = np.diag(self.C)
        gap = s[:, None] - s
        gap[blocks] = np.inf
        turn = np.where(blocks, 0.0, F / gap)
        for g, members in enumerate(self.groups):
            if len(members) == 1:
                continue
            block, one = self.C[at_block(members, members)], np.eye(len(members))
            for h, others in enumerate(self.groups):
                if h != g:
                    # The other group may be a block as well: solve column by column with C_g ⊗ 1 − 1 ⊗ C_hᵀ.
                    there = self.C[at_block(others, others)]
                    both = np.kron(block, np.eye(len(others))) - np.kron(one, there.T)
                    for rows, columns, sign in ((members, others, 1.0), (others, members, -1.0)):
                        at = at_block(rows, columns)
                        system = both if sign > 0 else np.kron(there, one) - np.kron(np.eye(len(others)), block.T)
                        try:
                            turn[at] = np.linalg.solve(system, F[at].ravel()).reshape(F[at].shape)
                        except np.linalg.LinAlgError:
                            turn[at] = 0.0
        turn[~(np.abs(turn * turn.T) < TOLERANCES.turn_product)] = 0.0
        return turn

    def rates(self, groups: list[Group]) -> Array:
        """Return for each eigenvalue the approximate spread of its new group: a root of the perturbation."""
        result = np.zeros(len(self.of))
        for members in groups:
            if len(members) > 1:
                at = at_block(members, members)
                s, most = self.s[members], np.max(np.nan_to_num(self.E[at], posinf=0.0))
                gap = np.nan_to_num(np.max(np.abs(s[:, None] - s)))
                powers = np.arange(1, len(members)) / np.arange(2.0, len(members) + 1)
                roots = np.exp(powers * np.log(gap) + (1.0 - powers) * np.log(most))
                result[members] = np.max(np.nan_to_num(roots, posinf=0.0))
        return result

    def split(self) -> tuple[Complex, Complex, list[Group], list[int]]:
        """Return bases, blocks, groups and conjugate groups, with blocks split where their eigenvalues are apart."""
        groups: list[Group] = []
        values = self.s.copy()
        for g, members in enumerate(self.groups):
            if self.mirror[g] < g:
                continue
            at, others = at_block(members, members), [self.partner[i] for i in members]
            parts = [members]
            if len(members) > 1 and np.isfinite(self.T[at]).all() and np.isfinite(self.E[at]).all():
                parts = self._parts(members, values, self.mirror[g] == g)
            groups += parts
            if self.mirror[g] != g:
                values[others], self.W[:, others] = values[members].conj(), self.W[:, members].conj()
                self.C[at_block(others, others)] = self.C[at].conj()
                groups += [[self.partner[i] for i in part] for part in parts]
        return self.W, self.C, groups, partners(values)

    def _parts(self, members: Group, values: Complex, real: bool) -> list[Group]:
        """Split a block; return the groups of its eigenvalues that are too near to be separated."""
        at = at_block(members, members)
        T = self.T[at]
        s, X = (x.astype(complex) for x in np.linalg.eig(T.real if real else T))
        partner = partners(s) if real else list(range(len(s)))
        block, one = np.diag(s), np.eye(len(s))
        groups = dependent(s, partner, lambda g: X[:, g])
        of = np.zeros(len(s), dtype=int)
        for g, part in enumerate(groups):
            of[part] = g
            if len(part) > 1:
                # The subspace of a part is the null space of the product of (T − s) over it.
                product = one
                for k in part:
                    product = product @ (T - s[k] * one)
                    product = product / (np.linalg.norm(product) or 1.0)
                X[:, part] = np.linalg.svd(product)[2][len(s) - len(part) :].conj().T
                block[at_block(part, part)] = X[:, part].conj().T @ T @ X[:, part]
        rounding = EPS * (np.abs(T) @ np.abs(X) + np.abs(X) @ np.abs(block)) + np.abs(T @ X - X @ block)
        E = np.abs(row_scaled_inverse(X)) @ (self.E[at] @ np.abs(X) + rounding)
        near = coupled(E, np.abs(s[:, None] - s)) & (of[:, None] != of)
        if not np.isfinite(E).all():
            return [members]
        pairs = [(int(of[i]), int(of[j])) for i, j in zip(*np.nonzero(near), strict=True)]
        parts = united(groups, pairs, [int(of[partner[part[0]]]) for part in groups])
        if len(parts) == 1:
            return [members]
        values[members], self.W[:, members], self.C[at] = s, self.W[:, members] @ X, block
        return [[members[i] for i in part] for part in parts]

    # --- radii ------------------------------------------------------------------------------------------------------

    def joined(self) -> list[Group] | None:
        """Return larger groups where eigenvalues cannot be separated, or None; sets the radii."""
        pairs = self._close()
        if not pairs:
            pairs = self._radii()
        if not pairs:
            pairs = meeting(self.centres, self.radii)
        if not pairs:
            return None
        groups = united(self.groups, pairs, self.mirror)
        return groups if len(groups) < len(self.groups) else None

    def _close(self) -> list[tuple[int, int]]:
        """Return pairs of groups that are coupled too strongly for their distance, each the nearest to the other."""
        E, s = np.where(np.isfinite(self.E), self.E, np.inf), self.s
        gap = np.abs(s[:, None] - s)
        near = coupled(E, gap)
        near &= self.of[:, None] != self.of
        if not near.any():
            return []
        # Groups farther away may be separable once the nearest are judged together.
        gap = np.where(near, np.nan_to_num(gap, nan=1e300), np.inf)
        nearest = np.min(gap, axis=1)
        joined = near & (gap <= 2.0 * np.minimum(nearest[:, None], nearest))
        return [(int(self.of[i]), int(self.of[j])) for i, j in zip(*np.nonzero(np.triu(joined, 1)), strict=True)]

    def _spectrum(self, T: Complex) -> Complex:
        """Return the eigenvalues of blocks in their numbering."""
        s = np.diag(T).copy()
        for g, members in enumerate(self.groups):
            if len(members) == 1:
                i = members[0]
                if self.partner[i] == i:
                    s[i] = s[i].real
                continue
            block = T[at_block(members, members)]
            if not np.isfinite(block).all():
                s[members] = np.nan
            elif self.mirror[g] == g:
                s[members] = np.linalg.eigvals(block.real)
            elif self.mirror[g] > g:
                s[members] = np.linalg.eigvals(block)
                s[[self.partner[i] for i in members]] = s[members].conj()
        for i, j in enumerate(self.partner):
            if len(self.groups[self.of[i]]) == 1 and i < j:
                s[j] = s[i].conjugate()
        return s

    def _radii(self) -> list[tuple[int, int]]:
        """Find centre and radius for each group; return groups that must be judged together."""
        if len(self.groups) == len(self.W) and self._all_single():
            return []
        pairs: list[tuple[float, int, int]] = []
        for g, members in enumerate(self.groups):
            h = self.mirror[g]
            if h < g:
                self.centres[g], self.radii[g] = self.centres[h].conjugate(), self.radii[h]
                continue
            centre = complex(np.mean(self.s[members]))
            self.centres[g] = centre = complex(centre.real) if h == g else centre
            around = _Around(self, members, centre)
            radius, culprit = self._radius(around) if len(members) == 1 else self._block_radius(around)
            self.radii[g] = radius
            if culprit is not None:
                pairs.append((float(np.nan_to_num(abs(self.s[culprit] - centre))), g, int(self.of[culprit])))
        return [min(pairs)[1:]] if pairs else []

    def _all_single(self) -> bool:
        """Find the radii of all eigenvalues at once, if all can be separated; see `_radius`."""
        own, one = np.diag(self.E), np.eye(len(self.E), dtype=bool)
        gap = np.abs(self.s[:, None] - self.s)
        radii = own.copy()
        for _ in range(4):
            distance = np.where(one, np.inf, gap - radii)
            if not np.all(distance > 0.0):
                return False
            x = 1.2 * self.E / distance
            y = (self.E + self.E @ x) / distance
            if not np.all(y <= x):
                return False
            new = own + np.sum(self.E * y.T, axis=1)
            if np.all(new <= radii):
                order = [members[0] for members in self.groups]
                self.centres, radii = self.s[order], radii[order]
                self.radii = np.maximum(radii, radii[self.mirror]) + 2.0 * EPS * np.abs(self.centres)
                return True
            radii = 1.2 * new
        return False

    def _radius(self, around: _Around) -> tuple[float, int | None]:
        """Return the radius of a circle about an eigenvalue that excludes all others, or which one prevents it."""
        own = radius = float(around.inner[0, 0])
        for _ in range(8):
            size = around.outside(radius)
            if size is None:
                break
            new = own + float(size[0, 0])
            if new <= radius:
                return radius + 2.0 * EPS * abs(around.centre), None
            radius = 1.2 * new
        return math.inf, around.culprit

    def _block_radius(self, around: _Around) -> tuple[float, int | None]:
        """Return the same for a block."""
        members, centre, inner = around.members, around.centre, around.inner
        block = self.T[at_block(members, members)]
        if not (np.isfinite(block).all() and np.isfinite(inner).all()):
            return math.inf, around.culprit
        spread = float(np.max(np.abs(self.s[members] - centre)))
        low = max(spread, float(np.max(inner)), EPS * abs(centre), 1e-150)
        high = 0.5 * float(np.min(around.distance, initial=np.inf))
        high = min(high, 1e3 * (low + float(np.linalg.norm(block - centre * np.eye(len(block))))))
        count = TOLERANCES.cluster_circle_points
        angles = np.exp(2j * np.pi * (np.arange(count) + 0.5) / count)[:, None, None]

        def clear(radius: float) -> bool:
            size = around.outside(radius)
            if size is None:
                return False
            try:
                resolvent = np.abs(np.linalg.inv((centre + radius * angles) * np.eye(len(members)) - block))
            except np.linalg.LinAlgError:
                return False
            product = resolvent @ (inner + size)
            return bool(np.isfinite(product).all()) and below(product, TOLERANCES.cluster_circle_product)

        # A small circle is too near to the block, a large one too near to the others.
        middle = 1.2 * low
        while not clear(middle):
            low, middle = middle, 4.0 * middle
            if not middle < high:
                return math.inf, around.culprit
        high = middle
        while high > 1.2 * low:
            middle = math.sqrt(low) * math.sqrt(high)
            if clear(middle):
                high = middle
            else:
                low = middle
        return high * (1.0 + 4.0 * EPS) + 2.0 * EPS * abs(centre), None

    def clear(self) -> bool:
        """Return whether all eigenvalues are separated from each other and from zero."""
        return len(self.groups) == len(self.W) and bool(np.all(self.radii < np.abs(self.s)))

    def spread(self) -> float:
        """Return a measure of the error bounds of all eigenvalues."""
        return float(np.sum(np.log(np.clip(self.radii[self.of], 1e-200, 1e200))))

    def misfit(self, j: int, s: complex, pairs: Motions, i: int) -> float:
        """Return a bound of the distance of an eigenvalue from a value of another method, by its vector."""
        if len(self.groups[self.of[j]]) > 1:
            return math.inf
        judge, C = self.judge, np.array([[s]])
        x = Motions(*(part[:, [i]] for part in pairs))
        w = Weights(
            self.w.y[[j]],
            tuple(y[[j]] for y in self.w.lam),
            tuple(y[[j]] for y in self.w.mu),
            tuple(y[[j]] for y in self.w.rounding),
        )
        m, n_h = judge.m, judge.n_h
        slope = w.y @ ((2.0 * s) * (m.M @ x.pos) + m.R @ x.pos) + (w.mu[0] + s * w.mu[1]) @ (m.J[n_h:] @ x.pos)
        result = float(np.abs(judge.residual(x, w, C) / slope)[0, 0]) + float(self.E[j, j])
        return result if math.isfinite(result) else math.inf

    # --- refinement -------------------------------------------------------------------------------------------------

    def refine(self) -> None:
        """Refine single eigenvalues that suffer from the rounding of T and L, or of much larger eigenvalues.

        Newton's method on the unreduced equations is free of that; it is tried where the errors of
        the data alone give a much smaller bound, and its result counts if it lies in the disc, with its bound.
        """
        judge, s = self.judge, self.s
        rough = [
            g for g, members in enumerate(self.groups)
            if len(members) == 1 and self.mirror[g] >= g
            and TOLERANCES.relative_bound_refined * abs(s[members[0]]) < self.radii[g] < min(abs(s[members[0]]), np.inf)
        ]  # fmt: skip
        if not rough:
            return
        index = [self.groups[g][0] for g in rough]
        x, w, lam, mu = judge.full(self.V[:, index], self.rows[index], s[index])
        known = judge.spread(x, w, lam, mu)
        beside = bool(judge.T.shape[1] or len(judge.L))
        hopeful = [
            k for k, g in enumerate(rough)
            if TOLERANCES.bound_beyond_data * known[k] < self.radii[g]
            or (beside and TOLERANCES.relative_bound_refined_at_zeros * abs(s[index[k]]) < self.radii[g])
        ]  # fmt: skip
        if not hopeful:
            return
        from mbstab.analysis.algebra.refinement import refined

        problem, kept = judge.quadratic()
        for k in hopeful:
            g, i = rough[k], index[k]
            right = np.concatenate([x.pos[:, k], x.nu[:, k]])
            left = np.concatenate([w[k], lam[k], mu[k]]).conj()
            found = refined(problem, complex(s[i]), right[kept], left[kept])
            if found is None:
                continue
            value, bound, _ = found
            bound += judge.moved(value, right, left)
            if self.mirror[g] == g:
                value, bound = complex(value.real), bound + abs(value.imag)
            off, radius = abs(value - self.centres[g]), float(self.radii[g])
            if off + bound > radius:
                # The disc is kept, with the better value in it.
                bound = radius + off
            if off > TOLERANCES.coupling_in_bound * radius and bound > radius:
                continue
            numbers = {g: value} if self.mirror[g] == g else {g: value, self.mirror[g]: value.conjugate()}
            others = np.array([h not in numbers for h in range(len(self.groups))])
            apart = np.abs(self.centres - value) > self.radii + bound
            if np.all(apart[others]) and (value.imag == 0.0 or abs(value.imag) > bound):
                for h, number in numbers.items():
                    self.s[self.groups[h][0]] = self.centres[h] = number
                    self.radii[h] = bound

    # --- the answer -------------------------------------------------------------------------------------------------

    def _relabel(self) -> None:
        """Assign to discs of single eigenvalues the values inside them: conjugates may have been swapped."""
        wrong = [
            g
            for g, members in enumerate(self.groups)
            if len(members) == 1 and abs(self.s[members[0]] - self.centres[g]) > self.radii[g]
        ]
        pool = [self.groups[g][0] for g in wrong]
        chosen = [min(pool, key=lambda i: abs(self.s[i] - self.centres[g])) for g in wrong]
        inside = [abs(self.s[i] - self.centres[g]) <= self.radii[g] for g, i in zip(wrong, chosen, strict=True)]
        if len(set(chosen)) == len(wrong) and all(inside):
            for g, i in zip(wrong, chosen, strict=True):
                self.groups[g] = [i]

    def placed(self) -> Placed:
        """Return values, discs and bounds."""
        self.refine()
        self._relabel()
        radii = np.where(np.isfinite(self.radii), self.radii, np.inf).tolist()
        discs = [
            Disc(complex(centre), radius, tuple(members))
            for centre, radius, members in zip(self.centres, radii, self.groups, strict=True)
        ]
        values, bounds = self.s + 0.0, bounds_in(discs, self.s)  # no −0
        turn = self._own_vectors()
        V, x = self.V @ turn, Motions(*(part @ turn for part in self.x))
        return Placed(
            values, discs, bounds, relative(bounds / EPS, values), self.judge.backward(values, x),
            self.judge.whole(V, values, x.pos),
        )  # fmt: skip

    def _own_vectors(self) -> Complex:
        """Return the combinations of columns that are eigenvectors, to within the discs.

        A cluster may have fewer of them than members, as a defective eigenvalue has: the first members have them, the
        columns of the others are zero.
        """
        turn = np.eye(len(self.of), dtype=complex)
        for g, members in enumerate(self.groups):
            at, h = at_block(members, members), self.mirror[g]
            V, block, radius = self.V[:, members], self.T[at], self.radii[g]
            if len(members) == 1 or h < g or not (np.isfinite(V).all() and np.isfinite(block).all()):
                continue
            R = np.linalg.qr(V)[1]
            off = R @ block @ np.linalg.inv(R) - self.centres[g] * np.eye(len(members))
            _, sizes, rows = np.linalg.svd(off)
            alone = rows[sizes <= TOLERANCES.radii_of_eigenvector * radius].conj().T
            if not 0 < alone.shape[1] < len(members):
                continue
            found = np.zeros_like(block, dtype=complex)
            order = sorted(range(len(members)), key=lambda k: (-self.s[members[k]].real, -self.s[members[k]].imag))
            for k, column in zip(order, np.linalg.solve(R, alone).T, strict=False):
                found[:, k] = column
            turn[at] = found
            if h != g:
                others = [self.partner[i] for i in members]
                turn[at_block(others, others)] = found.conj()
        return turn
