"""Eigenvalues at all points of a sweep at once, by broadcasting through kernels and linear algebra.

One point is answered in full (`mbstab.analysis.eigen`): its ranks, its symmetries, the frame
of its motion and the steps of its neutral staircase are the pattern. Every other point must
show the same pattern, which is checked with the same thresholds; points that do not are taken
up again with a pattern of their own, in the end one by one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from mbstab.analysis.balance import Balance
from mbstab.analysis.continuation import Path, Sheet
from mbstab.analysis.eigen import (
    EPS,
    NEUTRAL_GAP,
    NEUTRAL_ROUNDING,
    balanced,
    carried_shifts,
    deflate_neutral,
    deflate_pairs,
    explained,
    rounding_of,
    time_scale,
)
from mbstab.analysis.equilibrium import Problem
from mbstab.analysis.linearize import Linearization, deflated_matrix, linearize, state_space
from mbstab.analysis.motion import EQUILIBRIUM_TOLERANCE, NEWTON_STEPS, ROUNDING, TOLERANCE, Motion
from mbstab.analysis.reference import reference_motion
from mbstab.analysis.spectrum import NO_EIGENVALUE
from mbstab.analysis.steady import Family, Generator, spinning_columns
from mbstab.analysis.subspaces import RANK_LEAST, RANK_TOLERANCE
from mbstab.analysis.symmetry import symmetries
from mbstab.compiler.system import Array, Dynamics, System
from mbstab.errors import MbstabError, UsageError
from mbstab.model.schema import Model
from mbstab.model.values import Scene, evaluate

Complex = npt.NDArray[np.complex128]
Flags = npt.NDArray[np.bool_]

BLOCK_ENTRIES = 600_000
"""Entries of a matrix over all points evaluated together: enough to hide Python, few enough for the caches."""

POLISHING, POLISHED = 20, 1e-7
"""Newton steps from a predicted equilibrium, and the size of the last one: what it leaves is its square."""

RIDGE = 1e-14
"""Normal equations are regularized by this part of their trace."""

GUARDED = 9
"""At so many points of a sweep, spread over it, the frame of the motion is checked along the motion."""

FROZEN = "frozen-time: the coefficients change along the motion"

FEW = 8
"""A pattern that fits no more points than this is a lonely one …"""

PATIENCE = 4
"""… and after so many of them in a row the other points are answered one by one."""


@dataclass(frozen=True)
class Spectra:
    """Eigenvalues over the points of a sweep.

    Attributes
    ----------
    values : ndarray of complex, shape (points, r)
        Eigenvalues that are not neutral (1/s), in no order; nan where there are none.
    problems : dict
        By the number of a point, why it has no eigenvalues, or none that say something about stability.
    neutral : int
        Number of neutral eigenvalues besides.
    known : ndarray, shape (points, 2)
        Norms of the matrices, and of disturbances of them that are rounding (1/s).
    """

    values: Complex
    problems: dict[int, str]
    neutral: int
    known: Array


@dataclass(frozen=True)
class _Pattern:
    """What one point, answered in full, says about its neighbours."""

    linear: Linearization
    steps: tuple[int, ...]
    pairs: int
    family: Family | None
    sizes: Array
    balance: Balance | None

    @cached_property
    def unexplained(self) -> int:
        """Number of zero eigenvalues that no symmetry explains."""
        zeros = sum(self.steps)
        if not zeros:
            return 0
        known = symmetries(self.linear.system, self.linear.motion)
        return max(0, zeros - explained(self.linear, known))

    @property
    def n_neutral(self) -> int:
        return sum(self.steps) + 2 * self.pairs


class Evaluator:
    """Computes spectra of a model at values of some of its parameters.

    Parameters
    ----------
    model : Model
    settings : mapping
        Values of other parameters (SI).
    path : Path or Sheet, optional
        Equilibria over the parameters that vary, where a file asks to find them; without it
        each point is looked for by itself.
    """

    def __init__(self, model: Model, settings: Mapping[str, float], path: Path | Sheet | None = None) -> None:
        self.model, self.settings, self.path = model, dict(settings), path
        self.patterns: list[_Pattern] = []

    def spectra(self, values: Mapping[str, Array], progress: Callable[[float], object] = lambda done: None) -> Spectra:
        """Return the eigenvalues at many points.

        Parameters
        ----------
        values : mapping
            Parameter values in SI, arrays of shape (points,).
        progress : callable, optional
            Is called with the part of the work that is done, from 0 to 1.
        """
        work = _Work(self, values, progress)
        work.run()
        work.guard()
        return work.gathered()

    def near(self, values: Mapping[str, Array], count: int) -> Spectra:
        """Return `count` eigenvalues at points between others; nan where there are none.

        Close to a critical value one of them may be as small as those that are neutral: it is
        told from them by their number alone.
        """
        work = _Work(self, values, lambda done: None)
        work.lenient = True
        work.run()
        return work.gathered(count)

    def modes(self, values: Mapping[str, float]) -> tuple[Complex, Complex, Linearization]:
        """Return eigenvalues of one point, their shapes Δq as columns, and the linearized equations."""
        work = _Work(self, {name: np.array([x]) for name, x in values.items()}, lambda done: None)
        system = System(work.scene(0))
        linear = linearize(system, work.motion(system, 0)[0])
        space = state_space(linear)
        found, vectors = np.linalg.eig(space.A)
        return found.astype(complex), space.to_coordinates @ vectors, linear

    def learn(self, values: Mapping[str, Array]) -> None:
        """Take the patterns of some of many points."""
        points = len(next(iter(values.values())))
        some = np.unique(np.linspace(0, points - 1, 4 * FEW).round().astype(int))
        _Work(self, {name: x[some] for name, x in values.items()}, lambda done: None).run()


class _Work:
    """The points of one call."""

    def __init__(self, evaluator: Evaluator, values: Mapping[str, Array], progress: Callable[[float], object]) -> None:
        self.evaluator, self.values, self.progress = evaluator, values, progress
        self.points = len(next(iter(values.values())))
        self.lenient = False
        self.path = evaluator.path
        self.problems: dict[int, str] = {}
        self.found: list[tuple[npt.NDArray[np.intp], Complex, Array, _Pattern]] = []

    def scene(self, index: npt.NDArray[np.intp] | int) -> Scene:
        """Return the scene at some points, or at one."""
        chosen = {
            name: float(x[index]) if isinstance(index, int) else np.asarray(x[index]) for name, x in self.values.items()
        }
        return evaluate(self.evaluator.model, {**self.evaluator.settings, **chosen})

    def run(self) -> None:
        """Compute all points."""
        pending = np.arange(self.points)
        if self.path is not None:
            covered = self.path.covers(self.values)
            self.problems |= {int(i): self._missing(int(i), self.path) for i in pending[~covered]}
            pending = pending[covered]
        for pattern in self.evaluator.patterns:
            pending = pending[~self._fitting(pattern, pending)]
        lonely, number = 0, 0
        while len(pending):
            # From place to place: special values often stand in the middle or at an end.
            i = int(pending[int(len(pending) * ((0.37 + 0.618 * number) % 1.0))])
            number += 1
            found = self._pattern(i)
            pending = pending[pending != i]
            if found is None:
                continue
            pattern, values, known = found
            self.found.append((np.array([i]), values[None, :], known[None, :], pattern))
            if lonely < PATIENCE and len(pending):
                done = self._fitting(pattern, pending)
                pending = pending[~done]
                lonely = 0 if np.sum(done) > FEW else lonely + 1
                if np.sum(done) > FEW:
                    self.evaluator.patterns.append(pattern)

    def _missing(self, i: int, path: Path | Sheet) -> str:
        """Say why there is no solution at a point: the scene itself may not exist there."""
        try:
            self.scene(i)
        except MbstabError as error:
            return str(error)
        return path.missing(self.values, i)

    def _fitting(self, pattern: _Pattern, pending: npt.NDArray[np.intp]) -> Flags:
        """Compute points with a pattern; return which of them have it."""
        done = np.zeros(len(pending), dtype=bool)
        block = max(64, BLOCK_ENTRIES // pattern.linear.M.size)
        for start in range(0, len(pending), block):
            part = slice(start, start + block)
            done[part] = self._block(pattern, pending[part])
            self.progress(1.0 - (len(pending) - start) / self.points)
        return done

    def guard(self) -> None:
        """Refuse points whose motion does not stand still in the frame of their pattern; a sample says which."""
        good = np.sort(np.concatenate([index for index, *_ in self.found])) if self.found else np.arange(0)
        sample = good[np.unique(np.linspace(0, len(good) - 1, GUARDED).round().astype(int))] if len(good) else good
        doubts = {int(i): self._doubt(int(i)) for i in sample}
        if any(doubts.values()):
            doubts |= {int(i): self._doubt(int(i)) for i in good if int(i) not in doubts}
            for i, doubt in doubts.items():
                if doubt:
                    self.problems.setdefault(i, doubt)

    def _doubt(self, i: int) -> str:
        """Say why the motion at a point does not stand still, or is none."""
        try:
            system = System(self.scene(i))
            return "" if linearize(system, self.motion(system, i)[0]).constant else FROZEN
        except MbstabError as error:
            return str(error)

    def gathered(self, count: int | None = None) -> Spectra:
        """Return what was found; `count` decides how many are neutral, or the points at which fewest are."""
        if not self.found:
            nothing = np.full((self.points, count or 0), NO_EIGENVALUE)
            return Spectra(nothing, self.problems, 0, np.zeros((self.points, 2)))
        counts: dict[tuple[int, int], int] = {}
        for index, values, _, pattern in self.found:
            key = values.shape[1] + pattern.n_neutral, pattern.n_neutral
            counts[key] = counts.get(key, 0) + len(index)
        n_f = max(counts, key=lambda key: counts[key])[0]
        # More may be zero where a symmetry is added: there they are eigenvalues like others.
        neutral = min(zeros for n, zeros in counts if n == n_f) if count is None else max(n_f - count, 0)
        least = [pattern for *_, pattern in self.found if pattern.n_neutral == neutral]
        hidden = count is None and all(pattern.unexplained for pattern in least)
        result, known = np.full((self.points, n_f - neutral), NO_EIGENVALUE), np.zeros((self.points, 2))
        for index, values, known[index], pattern in self.found:
            other = pattern.n_neutral
            if hidden and other == neutral:
                # Zeros everywhere that nothing explains may be slow eigenvalues that rounding hides.
                text = f"nothing explains {pattern.unexplained} of {other} zero eigenvalues: slow ones may be lost"
                self.problems |= {int(i): f"{text}\nhint: mbstab eig --precision" for i in index}
            if values.shape[1] + other != n_f:
                text = f"{values.shape[1] + other} finite eigenvalues exist here, elsewhere {n_f}"
                self.problems |= {int(i): text for i in index}
                continue
            # Further zeros, or eigenvalues that are zero elsewhere.
            full = np.hstack([values, np.zeros((len(index), other), dtype=complex)])
            order = np.argsort(-np.abs(full), axis=1)[:, : n_f - neutral]
            result[index] = np.take_along_axis(full, order, axis=1)
        result[list(self.problems)] = NO_EIGENVALUE
        return Spectra(result, self.problems, neutral, known)

    # --- one point --------------------------------------------------------------------------------------------------

    def _pattern(self, i: int) -> tuple[_Pattern, Complex, Array] | None:
        """Return the pattern of a point, its eigenvalues and to what they are known, or None if it has a problem."""
        try:
            with np.errstate(over="raise", divide="raise", invalid="raise", under="ignore"):
                system = System(self.scene(i))
                if system.scene.period is not None:
                    raise UsageError("periodic motions are not swept: their multipliers take an integration each")
                motion, balance = self.motion(system, i)
                linear = linearize(system, motion)
                space = state_space(linear)
                gamma = time_scale(space)
                S = balanced(space, gamma)
                rounding = rounding_of(linear, space, gamma, S)
                deflated = deflate_neutral(S, rounding)
                turning = linear.generator if linear.generator is not None and linear.generator.turns else None
                known = symmetries(system, motion) if turning is not None else []
                deflated = deflate_pairs(deflated, carried_shifts(turning, motion.q, known), rounding)
        except UsageError:
            raise
        except (MbstabError, ArithmeticError, np.linalg.LinAlgError) as error:
            self.problems[i] = str(error)
            return None
        if not linear.constant or deflated.undecided:
            self.problems[i] = FROZEN if not linear.constant else deflated.undecided
            return None
        family = None
        if turning is not None:
            directions = np.eye(3)[: system.scene.dimension]
            family = Family(system, turning.axis, np.zeros(3), directions, spinning_columns(system))
        pattern = _Pattern(linear, deflated.steps, len(deflated.pairs), family, motion.sizes, balance)
        size = float(np.linalg.norm(S))
        limits = np.array([size, NEUTRAL_ROUNDING * rounding * size])
        return pattern, np.linalg.eigvals(deflated.S).astype(complex), limits

    def motion(self, system: System, i: int) -> tuple[Motion, Balance | None]:
        """Return the motion at a point, and the equations it was found with if it was."""
        if self.path is None:
            return reference_motion(system), None
        q, c = self.path.predicted({name: x[i : i + 1] for name, x in self.values.items()})
        motion, search, _, _ = Problem(system).solved(q[0], c[0])
        return motion, search.balance

    # --- many points ------------------------------------------------------------------------------------------------

    def _block(self, pattern: _Pattern, index: npt.NDArray[np.intp]) -> Flags:
        """Compute points of a pattern together; return which of them have it."""
        if not len(index):
            return np.zeros(0, dtype=bool)
        try:
            scene = self.scene(index)
        except MbstabError:  # some of them are out of range
            if len(index) == 1:
                return np.zeros(1, dtype=bool)
            half = len(index) // 2
            return np.concatenate([self._block(pattern, index[:half]), self._block(pattern, index[half:])])
        with np.errstate(all="ignore"):
            try:
                block = _Block(pattern, System(scene), len(index), self.lenient)
                if self.path is not None:
                    block.start = self.path.predicted({name: x[index] for name, x in self.values.items()})
                good, values, known = block.values()
            except (MbstabError, ArithmeticError, np.linalg.LinAlgError):
                return np.zeros(len(index), dtype=bool)
        if np.any(good):
            self.found.append((index[good], values[good], known[good], pattern))
        return good


def _t(x: Any) -> Array:
    result: Array = np.swapaxes(x, -1, -2)
    return result


class _Block:
    """Points of a pattern, evaluated together. Arrays have a first axis for the points, of length 1 where all agree."""

    def __init__(self, pattern: _Pattern, system: System, points: int, lenient: bool) -> None:
        self.pattern, self.system, self.points, self.lenient = pattern, system, points, lenient
        self.good: Flags = np.ones(points, dtype=bool)
        self.start: tuple[Array, Array] | None = None

    def values(self) -> tuple[Flags, Complex, Array]:
        """Return which points fit the pattern, the eigenvalues that are not neutral, and to what they are known."""
        pattern, system = self.pattern, self.system
        steady: Generator | None
        if self.start is not None:
            q, steady, u = self._balanced(*self.start)
        else:
            q = self._coordinates()
            steady, u = self._speeds(q)
        self._rate = steady.rate if steady is not None else 0.0
        dynamics = system.dynamics(q, u)
        self._require_rows(dynamics, u)
        # A pattern at rest says nothing about motions, and the other way round.
        self.good &= np.any(u, axis=1) != pattern.linear.motion.at_rest
        M, J, scale, row_scale = self._scaled(dynamics)
        N, Z, D_u = self._subspaces(J)
        K, R, D_q, balance = self._linearized(q, u, steady, dynamics, J, scale, row_scale)
        T = N @ Z
        self.good &= np.max(np.abs(_t(T) @ balance[0][..., None]), axis=(-1, -2), initial=0.0) <= balance[1]
        W_inverse = np.linalg.pinv(D_u @ N, rcond=RANK_TOLERANCE)
        P = -(W_inverse @ (D_q @ N))
        A, M_z = deflated_matrix(M, R, K, N, Z, P)
        return self._eigenvalues(A, M_z, (M, R, K), N.shape[-1])

    # --- the reference ----------------------------------------------------------------------------------------------

    def _given(self, values: Mapping[str, object], default: Array) -> Array:
        columns = [
            np.broadcast_to(np.asarray(values.get(name, default[i]), dtype=float), (self.points,))
            for i, name in enumerate(self.system.names)
        ]
        return np.stack(columns, axis=1)

    def _coordinates(self) -> Array:
        scene, motion = self.system.scene, self.pattern.linear.motion
        q = self._given(scene.coordinates, motion.q)
        missing = np.array([name not in scene.coordinates for name in self.system.names])
        return self._assembled(q, missing) if missing.any() and self.system.n_h else q

    def _assembled(self, q: Array, missing: Flags) -> Array:
        """Solve C = 0 for the missing coordinates, from those of the pattern."""
        sizes, n_h = self.pattern.sizes[missing], self.system.n_h
        for _ in range(NEWTON_STEPS):
            dynamics = self.system.dynamics(q, 0.0 * q)
            J = dynamics.J[:, :n_h, missing] * sizes
            lengths = np.linalg.norm(dynamics.J[:, :n_h] * self.pattern.sizes, axis=-1)
            lengths[lengths == 0.0] = 1.0
            weighted = J / lengths[..., None], (dynamics.E[:, :n_h] / lengths)[..., None]
            step = -(np.linalg.pinv(weighted[0], rcond=1e-12) @ weighted[1])[..., 0]
            q = q.copy()
            q[:, missing] += step * sizes
            if not np.max(np.abs(step)) > 1e-15:
                break
        return q

    def _balanced(self, q: Array, c: Array) -> tuple[Array, Generator | None, Array]:
        """Return equilibria or steady motions near predicted ones, by Newton's method."""
        assert self.pattern.balance is not None
        balance = self.pattern.balance.over(self.system)
        q = balance.completed(q)
        at = balance.state(q, c)
        for _ in range(POLISHING):
            G = balance.jacobian(at)
            square = _t(G) @ G
            size = np.trace(square, axis1=-2, axis2=-1)[:, None, None]
            # Directions that nothing depends on stay where they are.
            step = -np.linalg.solve(square + RIDGE * size * np.eye(G.shape[-1]), _t(G) @ at.residual[..., None])[..., 0]
            self.good &= np.max(np.abs(step[:, : balance.moving]), axis=1) < 0.2
            step[~self.good] = 0.0
            at = balance.state(*balance.moved(at, step))
            if not np.max(np.abs(step[:, : balance.moving])) > POLISHED:
                break
        self.good &= np.max(np.abs(at.residual), axis=1) <= TOLERANCE
        return at.q, (at.steady if self.pattern.family is not None else None), at.u

    def _speeds(self, q: Array) -> tuple[Generator | None, Array]:
        """Return the generator of the motion in a turning frame, if there is one, and the speeds."""
        system, scene = self.system, self.system.scene
        u = self._given(scene.rates, np.zeros(system.n_q))
        missing = np.array([name not in scene.rates for name in system.names])
        family = self.pattern.family
        if family is not None:
            return self._turning(q, u, missing, family)
        if missing.any() and system.n_c and not self._at_rest():
            sizes = self.pattern.sizes
            for _ in range(2):
                dynamics = system.dynamics(q, u)
                step = np.linalg.pinv(dynamics.J[..., missing] * sizes[missing], rcond=1e-12) @ dynamics.V[..., None]
                u = u.copy()
                u[:, missing] -= step[..., 0] * sizes[missing]
            fast = np.max(np.abs(u / sizes), axis=1, keepdims=True)
            u[(np.abs(u / sizes) < 1e-14 * fast) & missing] = 0.0
        return None, u

    def _at_rest(self) -> bool:
        return self.pattern.linear.motion.at_rest and not any(np.any(x) for x in self.system.scene.rates.values())

    def _turning(self, q: Array, u: Array, missing: Flags, family: Family) -> tuple[Generator, Array]:
        """Return the generator whose speeds satisfy the rows and the given rates."""
        system, sizes = self.system, self.pattern.sizes
        own = replace(family, system=system)
        basis = own.basis(q)
        zero = system.dynamics(q, 0.0 * q)
        lengths = np.linalg.norm(zero.J * sizes, axis=-1)
        lengths[lengths == 0.0] = 1.0
        given = ~missing
        rows = np.concatenate([zero.J @ basis / lengths[..., None], (basis / sizes[:, None])[:, given]], axis=1)
        known = self._declared()
        right = np.concatenate(
            [np.broadcast_to(-zero.V / lengths, (self.points, system.n_c)), (u / sizes)[:, given]], axis=1
        )
        free = [k for k in range(own.size) if k not in known]
        c = np.zeros((self.points, own.size))
        for k, value in known.items():
            c[:, k] = value
        right = right - (rows @ c[..., None])[..., 0]
        c[:, free] = (np.linalg.pinv(rows[..., free], rcond=1e-11) @ right[..., None])[..., 0]
        generator = own.generator(c)
        speeds = generator.field(q)
        fast = np.max(np.abs(speeds / sizes), axis=1)
        self.good &= np.max(np.abs((speeds - u) / sizes)[:, given], axis=1, initial=0.0) <= TOLERANCE * fast
        return generator, speeds

    def _declared(self) -> dict[int, Array | float]:
        """Return the coefficients of a declared steady motion."""
        steady = self.system.scene.steady
        if steady is None or steady.rate is None:
            return {}
        known: dict[int, Array | float] = {0: steady.rate}
        return known

    def _require_rows(self, dynamics: Dynamics, u: Array) -> None:
        sizes, n_h = self.pattern.sizes, self.system.n_h
        allowed = TOLERANCE * np.abs(dynamics.J) @ sizes + 1e-300
        fast = np.max(np.abs(u / sizes), axis=1, initial=0.0)[:, None]
        self.good &= np.all(np.abs(dynamics.E[:, :n_h]) <= allowed[:, :n_h], axis=1)
        self.good &= np.all(np.abs(dynamics.V) <= allowed * fast + 1e-300, axis=1)

    # --- subspaces --------------------------------------------------------------------------------------------------

    def _scaled(self, dynamics: Dynamics) -> tuple[Array, Array, Array, Array]:
        diagonal = np.diagonal(dynamics.M, axis1=-2, axis2=-1)
        known = self.pattern.linear.motion.spaces.scale
        scale = np.where(diagonal > 0.0, 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0)), known)
        J = dynamics.J * scale[:, None, :]
        lengths = np.linalg.norm(J, axis=-1)
        row_scale = np.where(lengths > 0.0, 1.0 / np.where(lengths > 0.0, lengths, 1.0), 1.0)
        return dynamics.M * scale[:, None, :] * scale[:, :, None], J * row_scale[..., None], scale, row_scale

    def _subspaces(self, J: Array) -> tuple[Array, Array, Array]:
        spaces, n_h = self.pattern.linear.motion.spaces, self.system.n_h
        N = self._null(J[:, :n_h], spaces.C.rank)
        D_u = J[:, n_h:]
        return N, self._null(D_u @ N, spaces.W.rank), D_u

    def _null(self, matrix: Array, rank: int) -> Array:
        """Return the null space, checking the rank at every point."""
        rows, columns = matrix.shape[-2:]
        if rows == 0 or columns == 0:
            return np.eye(columns)[None]
        _, s, right = np.linalg.svd(matrix)
        if rank:
            self.good &= s[:, rank - 1] >= RANK_LEAST
        if rank < s.shape[-1]:
            self.good &= s[:, rank] <= RANK_TOLERANCE
        return _t(right[:, rank:])

    # --- coefficients -----------------------------------------------------------------------------------------------

    def _linearized(
        self,
        q: Array,
        u: Array,
        steady: Generator | None,
        dynamics: Dynamics,
        J: Array,
        scale: Array,
        row_scale: Array,
    ) -> tuple[Array, Array, Array, tuple[Array, Array]]:
        """Return K, R, D_q in scaled coordinates, and how far the forces are from balance and may be."""
        system, n_h = self.system, self.system.n_h
        a = steady.acceleration(q) if steady is not None else np.zeros_like(q)
        force = ((dynamics.M @ a[..., None])[..., 0] + dynamics.F0) * scale
        nu = np.zeros((1, system.n_c))
        if system.n_c:
            inverse = np.linalg.pinv(J, rcond=1e-11)
            nu = -(_t(inverse) @ force[..., None])[..., 0]
            balance = force + (_t(J) @ nu[..., None])[..., 0]
        else:
            balance = force
        K, R, D_q = system.linearize(q, u, a, nu * row_scale)
        sizes = self.pattern.sizes
        scene = system.scene
        gravity = math.sqrt(sum(float(np.max(np.abs(x))) ** 2 for x in scene.gravity))
        weights = max(math.sqrt(float(np.max(body.mass))) for body in scene.bodies) * gravity
        changes = (np.abs(K) @ sizes + (np.abs(R) @ np.abs(u)[..., None])[..., 0]) * scale
        largest = np.maximum(np.max(np.abs(dynamics.F0 * scale), axis=-1), weights)
        allowed = EQUILIBRIUM_TOLERANCE * largest + ROUNDING * np.max(changes, axis=-1)
        if steady is not None:
            Xi, Xi_2 = steady.frame(q)
            M = dynamics.M
            K, R, D_q = K + R @ Xi + M @ Xi_2, R + 2.0 * M @ Xi, D_q + dynamics.J[:, n_h:] @ Xi
        both = scale[:, None, :] * scale[:, :, None]
        D_q = D_q * scale[:, None, :] * row_scale[:, n_h:, None]
        return K * both, R * both, D_q, (balance, allowed)

    # --- eigenvalues ------------------------------------------------------------------------------------------------

    def _eigenvalues(
        self, A: Array, M_z: Array, matrices: tuple[Array, Array, Array], n_xi: int
    ) -> tuple[Flags, Complex, Array]:
        pattern = self.pattern
        n = A.shape[-1]
        gamma = _time_scales(A, n_xi)
        weights = np.ones((len(A), n))
        weights[:, n_xi:] = gamma[:, None]
        S = A * weights[:, None, :] / weights[:, :, None]
        if S.shape[0] == 1 and self.points > 1:
            S = np.broadcast_to(S, (self.points, n, n))
        finite = np.all(np.isfinite(S), axis=(1, 2))
        self.good &= finite
        if not finite.all():
            S = np.where(finite[:, None, None], S, 0.0)
        size = np.linalg.norm(S, axis=(1, 2))
        whole = gamma * _norm(matrices[0]) + _norm(matrices[1]) + _norm(matrices[2]) / gamma
        condition = np.linalg.cond(M_z) if M_z.size else np.ones(1)
        limit = NEUTRAL_ROUNDING * EPS * condition * np.maximum(size, whole)
        for zeros in pattern.steps:
            S = self._deflated(S, S, zeros, limit)
        if pattern.pairs:
            rate = np.abs(np.asarray(self._rate))
            for _ in range(pattern.pairs):
                square = S @ S + rate[:, None, None] ** 2 * np.eye(S.shape[-1])
                S = self._deflated(S, square, 2, limit * size)
        values = np.linalg.eigvals(S).astype(complex) if S.shape[-1] else np.zeros((len(S), 0), dtype=complex)
        if not pattern.steps and not self.lenient:
            # Without a staircase nothing has said yet that no eigenvalue is zero.
            self.good &= np.min(np.abs(values), axis=1, initial=math.inf) > 1e-7 * size
        known = np.stack(np.broadcast_arrays(size, limit), axis=-1)
        return self.good, values, known

    def _deflated(self, S: Array, matrix: Array, zeros: int, limit: Array) -> Array:
        """Return S on what a null space of `matrix`, of the dimension of the pattern, leaves."""
        right: Array
        _, s, right = np.linalg.svd(matrix)
        largest = s[:, -zeros]
        next_one = s[:, -zeros - 1] if zeros < s.shape[-1] else np.full(len(s), math.inf)
        self.good &= largest <= limit
        if not self.lenient:
            self.good &= (next_one >= NEUTRAL_GAP * largest) & (next_one > limit)
        rest = right[:, : right.shape[-2] - zeros]
        return rest @ S @ _t(rest)


def _time_scales(A: Array, n_xi: int) -> Array:
    """Return a typical rate of each deflated system (1/s), as `mbstab.analysis.eigen.time_scale`."""
    sizes = [np.sqrt(_norm(A[:, n_xi:, :n_xi])), _norm(A[:, n_xi:, n_xi:]), _norm(A[:, :n_xi, :n_xi])]
    largest: Array = np.max(sizes, axis=0)
    return np.where(largest > 0.0, largest, 1.0)


def _norm(x: Array) -> Array:
    result: Array = np.linalg.norm(x, axis=(-2, -1))
    return result
