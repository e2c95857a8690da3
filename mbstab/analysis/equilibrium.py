"""Equilibria and steady motions: Newton's method on the constrained equations with exact derivatives.

Unknown are the coordinates q, the multipliers ν, and the rates c of the generator X(q; c) that
are not given (`mbstab.analysis.steady`; X = 0 at rest). With u = X and a = DX X,

    M a + F0 + Jᵀν = 0,   C(q, t) = 0,   V(q, X, t) = 0,   X_i = given rates.

The derivative of the first row by q is the stiffness matrix of the co-moving frame,
K + R Ξ + M Ξ₂. Steps are of least length, so coordinates that nothing depends on stay where
they are; they are bounded and damped as in the Levenberg-Marquardt method. Where that
stalls, the motion is damped until it rests (pseudo-transient continuation; Kelley and Keyes
1998, SIAM J. Numer. Anal. 35), or spun up from rest.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from mbstab.analysis.motion import CHART_WARNING, NEWTON_STEPS, TOLERANCE, Finder, Motion
from mbstab.analysis.reactions import Reaction, reactions
from mbstab.analysis.reference import declared_family
from mbstab.analysis.steady import Family, Generator, detected
from mbstab.analysis.subspaces import rank_of
from mbstab.analysis.symmetry import Symmetry, symmetries
from mbstab.compiler.system import Array, System
from mbstab.errors import EquilibriumError, MbstabError, ModelFileError, NumericalError
from mbstab.model.schema import is_length

Flags = npt.NDArray[np.bool_]

REACH = 0.5
"""No step is longer than this part of the size of the scene, or this angle (rad)."""

CONVERGED = 1e-9
"""Residuals below this, relative to what balances, are polished by undamped steps until they stop falling."""

RELAXATION_STEPS = 400
SPIN_UP_STEPS = 40
DEPENDENT = 1e-7
"""A row repeats others if less than this part of it is independent of them."""

SINGULAR = 1e-7
"""A direction of the equations whose singular value is this small beside the largest leaves a solution not isolated."""


@dataclass(frozen=True)
class Equilibrium:
    """An equilibrium or a steady motion.

    Attributes
    ----------
    motion : Motion
    steady : Generator
        The motion it is; its text is ``rest`` at rest.
    reactions : list of Reaction
        What each joint, contact and drive transmits.
    residual : float
        Largest remaining imbalance, relative to the forces that balance.
    unbalanced : tuple of float
        Largest unbalanced force (N) and torque (N·m).
    iterations : int
    strategy : str
        ``Newton``, ``relaxation`` or ``spin-up``: what led to the solution.
    symmetries : tuple of str
        Shifts that lead from this solution to others like it.
    open : tuple of str
        Directions besides in which the solution is not isolated, in words; empty: it is isolated.
    """

    motion: Motion
    steady: Generator
    reactions: list[Reaction]
    residual: float
    unbalanced: tuple[float, float]
    iterations: int
    strategy: str
    symmetries: tuple[str, ...]
    open: tuple[str, ...]

    @property
    def isolated(self) -> bool:
        """Whether no other solution is near, apart from symmetries."""
        return not self.open


@dataclass(frozen=True)
class _State:
    """A trial: unknowns, residuals and what is needed for a step."""

    q: Array
    c: Array
    nu: Array
    residual: Array
    steady: Generator
    u: Array
    a: Array
    M: Array
    J: Array

    @property
    def size(self) -> float:
        return float(np.linalg.norm(self.residual))


class _Stalled(Exception):
    """A strategy came to rest without a solution, at this state."""

    def __init__(self, state: _State | None) -> None:
        self.state = state


class _Search:
    """Newton's method from one start.

    Attributes
    ----------
    ramp : float
        Part of the given rates that is reached: 1 but for spin-up.
    """

    def __init__(
        self, system: System, finder: Finder, family: Family, known: dict[int, float], held: Flags, start: Array
    ) -> None:
        self.system, self.finder, self.family, self.known = system, finder, family, known
        self.sizes = finder.sizes
        self.open = np.flatnonzero(~held)
        self.rows = self._independent_rows(start)
        self.n_h = int(np.sum(self.rows < system.n_h))
        self.free = [k for k in range(family.size) if k not in known]
        self.ramp = 1.0
        self.iterations = 0
        self.best: _State | None = None
        self.energy = 1.0
        self.speed = 1.0
        rates = system.scene.rates if family.size else {}
        self.given = [i for i, name in enumerate(system.names) if name in rates]
        self.rates = np.array([rates[system.names[i]] for i in self.given], dtype=float)

    def _independent_rows(self, q: Array) -> npt.NDArray[np.intp]:
        """Return rows of which none repeats others at an assembled start: away from it they would contradict."""
        system = self.system
        state = system.dynamics(q, np.zeros(system.n_q))
        J = state.J * self.sizes
        lengths = self._lengths(state.J)
        if np.max(np.abs(state.E[: system.n_h] / lengths[: system.n_h]), initial=0.0) > TOLERANCE:
            return np.arange(system.n_c)
        kept: list[int] = []
        basis = np.zeros((0, system.n_q))
        for i in range(system.n_c):
            row = J[i] / lengths[i]
            for _ in range(2):
                row = row - basis.T @ (basis @ row)
            length = float(np.linalg.norm(row))
            if length > DEPENDENT or not np.any(J[i]):
                kept.append(i)
                basis = np.vstack([basis, row / (length or 1.0)])
        return np.array(kept, dtype=np.intp)

    # --- equations --------------------------------------------------------------------------------------------------

    def state(self, q: Array, c: Array) -> _State:
        """Return a trial state with the multipliers that balance it best.

        Raises
        ------
        MbstabError, ArithmeticError, ValueError
            If the equations have no value there.
        """
        system, n_h = self.system, self.n_h
        self.finder.check_chart(q, np.zeros(len(q), dtype=bool))
        full = c.copy()
        for k, value in self.known.items():
            full[k] = self.ramp * value
        steady = self.family.generator(full)
        u, a = steady.field(q), steady.acceleration(q)
        dynamics = system.dynamics(q, u)
        M, J, E, V = dynamics.M, dynamics.J[self.rows], dynamics.E[self.rows], dynamics.V[self.rows]
        force = (M @ a + dynamics.F0) * self.sizes / self.energy
        lengths = self._lengths(J)
        if self.ramp < 1.0:
            # Given rates of drives grow with the ramp.
            V = V - (1.0 - self.ramp) * system.dynamics(q, 0.0 * u).V[self.rows]
        rows = J * self.sizes / lengths[:, None]
        nu = -np.linalg.lstsq(rows.T, force, rcond=1e-12)[0] if len(J) else np.zeros(0)
        residual = np.concatenate(
            [
                force + rows.T @ nu,
                E[:n_h] / lengths[:n_h],
                V / (lengths * self.speed) if self.family.size else np.zeros(0),
                (u[self.given] - self.ramp * self.rates) / (self.sizes[self.given] * self.speed),
            ]
        )
        if not np.all(np.isfinite(residual)):
            raise NumericalError("the equations are not finite")
        multipliers = np.zeros(system.n_c)
        multipliers[self.rows] = nu * self.energy / lengths
        return _State(q, full, multipliers, residual, steady, u, a, M, J)

    def _lengths(self, J: Array) -> Array:
        lengths = np.linalg.norm(J * self.sizes, axis=1)
        return np.where(lengths > 0.0, lengths, 1.0)

    def jacobian(self, at: _State) -> tuple[Array, int]:
        """Return the derivative of the residuals by [Δq; Δc; Δν], scaled, and the number of the first Δν."""
        system, n_h = self.system, self.n_h
        K, R, _ = system.linearize(at.q, at.u, at.a, at.nu)
        M, J = at.M, at.J
        lengths = self._lengths(J)
        Xi, Xi_2 = at.steady.frame(at.q)
        units = [self.family.units()[k] for k in self.free]
        X = np.array([unit.field(at.q) for unit in units]).reshape(len(units), system.n_q).T
        # a = DX X is quadratic in the rates.
        A = np.array([Xi @ unit.field(at.q) + unit.frame(at.q)[0] @ at.u for unit in units])
        A = A.reshape(len(units), system.n_q).T
        weights = (self.sizes / self.energy)[:, None]
        columns = self.sizes[self.open]
        blocks = [
            [
                (K + R @ Xi + M @ Xi_2)[:, self.open] * columns * weights,
                (R @ X + M @ A) * self.speed * weights,
                J.T * (self.energy / lengths) * weights,
            ],
            [J[:n_h, self.open] * columns / lengths[:n_h, None], np.zeros((n_h, len(units))), np.zeros((n_h, len(J)))],
        ]
        if self.family.size:
            V_q = system.linearize_rows(at.q, at.u, at.a)[0][self.rows]
            rows = (lengths * self.speed)[:, None]
            blocks.append(
                [
                    (V_q + J @ Xi)[:, self.open] * columns / rows,
                    J @ X * self.speed / rows,
                    np.zeros((len(J), len(J))),
                ]
            )
            rows = (self.sizes[self.given] * self.speed)[:, None]
            blocks.append(
                [
                    Xi[np.ix_(np.array(self.given, dtype=np.intp), self.open)] * columns / rows,
                    X[self.given] * self.speed / rows,
                    np.zeros((len(self.given), len(J))),
                ]
            )
        return np.block(blocks), len(self.open) + len(units)

    def tried(self, at: _State, step: Array) -> _State | None:
        """Return the state after a scaled step, or None where the equations have no value."""
        q, c = at.q.copy(), at.c.copy()
        q[self.open] += step[: len(self.open)] * self.sizes[self.open]
        c[self.free] += step[len(self.open) : len(self.open) + len(self.free)] * self.speed
        try:
            return self.state(q, c)
        except (MbstabError, ArithmeticError, ValueError, np.linalg.LinAlgError):
            return None

    # --- strategies -------------------------------------------------------------------------------------------------

    def newton(self, at: _State) -> _State:
        """Return the solution that damped steps lead to."""
        damping = 0.0
        if self.best is None:
            self.best = at
        for _ in range(NEWTON_STEPS):
            self.iterations += 1
            G, moving = self.jacobian(at)
            accepted = None
            while accepted is None:
                step = _step(G, at.residual, moving, damping)
                longest = float(np.max(np.abs(step[:moving]), initial=0.0))
                trial = self.tried(at, step * min(1.0, REACH / longest) if longest > REACH else step)
                if trial is not None and trial.size < at.size * (1.0 - 1e-6):
                    accepted = trial
                    damping = 0.0 if damping < 1e-6 else damping * 0.1
                elif at.size < CONVERGED:
                    return at
                else:
                    damping = max(4.0 * damping, 1e-4)
                    if damping > 1e8:
                        raise _Stalled(at)
            at = accepted
            if self.best is None or at.size < self.best.size:
                self.best = at
        if at.size < CONVERGED:
            return at
        raise _Stalled(at)

    def relaxed(self, at: _State) -> _State:
        """Return the solution at which a heavily damped motion comes to rest."""
        inertia = np.diag(at.M) * self.sizes**2 / self.energy
        inertia = np.maximum(inertia, 1e-6 * np.max(inertia))
        G, _ = self.jacobian(at)
        n = len(self.open)
        pace = float(np.max(inertia)) / max(float(np.max(np.abs(G[: self.system.n_q, :n]))), 1e-300)
        for _ in range(RELAXATION_STEPS):
            self.iterations += 1
            G, moving = self.jacobian(at)
            G[self.open, np.arange(n)] += inertia[self.open] / pace
            step = _step(G, at.residual, moving, 0.0)
            longest = float(np.max(np.abs(step[:moving]), initial=0.0))
            trial = self.tried(at, step * min(1.0, REACH / longest) if longest > REACH else step)
            if trial is None or trial.size > 10.0 * at.size:
                pace *= 0.25
                if pace < 1e-12:
                    break
                continue
            pace = min(pace * min(3.0, at.size / max(trial.size, 1e-300) * 1.3), 1e12)
            at = trial
            if at.size < 1e-3:
                try:
                    return self.newton(at)
                except _Stalled:
                    pass
        raise _Stalled(at)

    def spun_up(self, q: Array, c: Array) -> _State:
        """Return the solution reached from rest by raising the given rates."""
        self.ramp, reached, stride = 0.0, 0.0, 0.25
        try:
            at = self.started(q, c)
            for _ in range(SPIN_UP_STEPS):
                self.ramp = min(1.0, reached + stride)
                try:
                    at = self.newton(self.state(at.q, at.c))
                    reached, stride = self.ramp, 1.5 * stride
                except _Stalled:
                    stride *= 0.4
                if reached == 1.0:
                    return at
        finally:
            self.ramp = 1.0
        raise _Stalled(self.best)

    def started(self, q: Array, c: Array) -> _State:
        """Return the solution from a start by the first strategy that leads to one."""
        at = self.state(q, c)
        try:
            return self.newton(at)
        except _Stalled:
            return self.relaxed(at)

    def solve(self, q: Array, c: Array) -> tuple[_State, str]:
        """Return a solution and the strategy that led to it.

        Raises
        ------
        _Stalled
            If none does.
        """
        self._measure(q, c)
        strategies: list[tuple[str, Callable[[], _State]]] = [
            ("Newton", lambda: self.newton(self.state(q, c))),
            ("relaxation", lambda: self.relaxed(self.state(q, c))),
        ]
        if self.known:
            strategies.append(("spin-up", lambda: self.spun_up(q, c)))
        for name, strategy in strategies:
            try:
                return strategy(), name
            except _Stalled:
                continue
            except (MbstabError, ArithmeticError, ValueError, np.linalg.LinAlgError):
                continue
        raise _Stalled(self.best)

    def _measure(self, q: Array, c: Array) -> None:
        """Set the scales of energy and speed by which residuals are judged."""
        scene = self.system.scene
        gravity = float(np.linalg.norm([float(x) for x in scene.gravity]))
        size = float(np.max(self.sizes))
        energy = max(float(body.mass) for body in scene.bodies) * gravity * size
        full = np.array([self.known.get(k, c[k]) for k in range(self.family.size)])
        u = self.family.generator(full).field(q)
        self.speed = max(float(np.max(np.abs(u / self.sizes))), float(np.max(np.abs(full), initial=0.0))) or 1.0
        dynamics = self.system.dynamics(q, u)
        K, _, _ = self.system.linearize(q, u, 0.0 * u, np.zeros(self.system.n_c))
        for forces in (dynamics.F0 * self.sizes, K * self.sizes * self.sizes[:, None]):
            energy = max(energy, float(np.max(np.abs(forces), initial=0.0)))
        if self.family.size:
            energy = max(energy, float(np.max(np.diag(dynamics.M) * self.sizes**2)) * self.speed**2)
        self.energy = energy or 1.0


def _step(G: Array, residual: Array, moving: int, damping: float) -> Array:
    """Return the step of least length; damped in coordinates and rates, not in multipliers."""
    if damping:
        extra: Array = np.zeros((moving, G.shape[1]))
        extra[:, :moving] = math.sqrt(damping) * np.eye(moving)
        G, residual = np.vstack([G, extra]), np.concatenate([residual, np.zeros(moving)])
    return np.asarray(np.linalg.lstsq(G, -residual, rcond=1e-11)[0], dtype=np.float64)


# --- from a scene to its equilibria ---------------------------------------------------------------------------------


def found_motion(system: System) -> Motion:
    """Return the equilibrium or steady motion that the reference of a file leads to, given coordinates held.

    Raises
    ------
    EquilibriumError
        If none is found; says where the search stalled, and what to try.
    """
    problem = _Problem(system)
    return problem.solved(problem.start)[0]


def find_equilibria(
    system: System, starts: int, seed: int = 1, track: Callable[[list[int]], Iterator[int]] = iter
) -> list[Equilibrium]:
    """Return the distinct equilibria or steady motions that several starts lead to, the file's own first.

    Given coordinates are held if the file says ``find``; otherwise they are a start like the
    guessed ones.

    Parameters
    ----------
    starts : int
        Number of starts: the reference of the file, and others at random around it.
    seed : int
        Of the random numbers; the same seed gives the same starts.
    track : callable
        Takes the list of starts and returns them one by one, for a progress bar.

    Raises
    ------
    EquilibriumError
        If no start leads to one.
    """
    problem = _Problem(system)
    rng = np.random.default_rng(seed)
    distinct: list[Equilibrium] = []
    failure: MbstabError | None = None
    for number in track(list(range(starts))):
        try:
            found = problem.described(*problem.solved(problem.start if number == 0 else problem.elsewhere(rng)))
        except MbstabError as error:
            failure = failure or error
            continue
        if not any(problem.same(found, other) for other in distinct):
            distinct.append(found)
    if not distinct:
        assert failure is not None
        raise failure
    return distinct


class _Problem:
    """What is asked for, and the checks that a solution must pass."""

    def __init__(self, system: System) -> None:
        self.system, self.scene = system, system.scene
        self.finder = Finder(system)
        q, missing = self.finder.start()
        self.held: Flags = ~missing if self.scene.model.reference.find is not None else np.zeros(len(q), dtype=bool)
        self.start = q
        if system.n_h and not self.held.all():
            self.start = self.finder.assemble(q, ~self.held)
        self.family, self.known = declared_family(system)
        if self.scene.steady is None and self.scene.model.reference.find is None and any(self.scene.rates.values()):
            self.family, self.known = self._moving()

    def _moving(self) -> tuple[Family, dict[int, float]]:
        """Return the generator that the rates of a file without ``find`` or ``steady`` describe, all of it given."""
        u = np.array([self.scene.rates.get(name, 0.0) for name in self.system.names], dtype=float)
        generator = detected(self.system, self.start, u, self.finder.sizes)[-1]
        columns = tuple(int(i) for i in np.flatnonzero(generator.spins))
        axis = generator.axis if generator.turns else None
        directions = generator.velocity[None, :] if np.any(generator.velocity) else np.zeros((0, 3))
        family = Family(self.system, axis, generator.point, directions, columns)
        rates = [*([generator.rate] if generator.turns else []), *([1.0] * len(directions))]
        return family, dict(enumerate([*rates, *generator.spins[list(columns)]]))

    def solved(self, start: Array) -> tuple[Motion, _Search, _State, str]:
        """Return the solution from a start, checked, and how it was found."""
        search = _Search(self.system, self.finder, self.family, self.known, self.held, start)
        c = self._rates(start)
        try:
            with np.errstate(all="ignore"):
                at, strategy = search.solve(start, c)
        except _Stalled as stalled:
            raise self._failure(search, stalled.state) from None
        at = _tidied(search, at)
        finder = Finder(self.system)
        finder.solved = [name for name, held in zip(self.system.names, self.held, strict=True) if not held]
        if not (np.all(np.abs(at.residual) <= TOLERANCE) and self._closed(at)):
            raise self._failure(search, at)
        try:
            motion = finder.motion(at.q, at.u, steady=at.steady, declared=self.scene.steady is not None)
        except ModelFileError:
            raise self._failure(search, at) from None
        if not at.steady.turns and np.any(at.u):
            motion = replace(motion, generators=tuple(detected(self.system, at.q, at.u, self.finder.sizes)))
        return motion, search, at, strategy

    def described(self, motion: Motion, search: _Search, at: _State, strategy: str) -> Equilibrium:
        """Return a solution with what it means."""
        known = symmetries(self.system, motion)
        force = at.residual[: self.system.n_q] * search.energy / self.finder.sizes
        unbalanced = [
            float(np.max(np.abs(force[kind]), initial=0.0)) for kind in (self.finder.is_length, ~self.finder.is_length)
        ]
        return Equilibrium(
            motion, at.steady, reactions(self.system, motion), float(np.max(np.abs(at.residual))),
            (unbalanced[0], unbalanced[1]), search.iterations, strategy, tuple(s.name for s in known),
            tuple(_open_directions(search, at, known)),
        )  # fmt: skip

    def _closed(self, at: _State) -> bool:
        """Whether a state satisfies all rows, those that repeat others included."""
        dynamics = self.system.dynamics(at.q, at.u)
        allowed = TOLERANCE * np.abs(dynamics.J) @ self.finder.sizes + 1e-300
        fastest = float(np.max(np.abs(at.u / self.finder.sizes), initial=0.0))
        n_h = self.system.n_h
        good = np.all(np.abs(dynamics.E[:n_h]) <= allowed[:n_h])
        return bool(good and np.all(np.abs(dynamics.V) <= allowed * max(fastest, 1e-300)))

    def _rates(self, q: Array) -> Array:
        """Return starting values of the rates: given ones, and for the others what fits the constraints best."""
        c = np.array([self.known.get(k, 0.0) for k in range(self.family.size)])
        free = [k for k in range(self.family.size) if k not in self.known]
        if free:
            basis = self.family.basis(q)
            given = [i for i, name in enumerate(self.system.names) if name in self.scene.rates]
            rates = np.array([self.scene.rates[self.system.names[i]] for i in given], dtype=float)
            state = self.system.dynamics(q, basis @ c)
            left = np.vstack([state.J @ basis[:, free], basis[np.ix_(given, free)]])
            c[free] = np.linalg.lstsq(left, -np.concatenate([state.V, (basis @ c)[given] - rates]), rcond=1e-9)[0]
        return c

    def elsewhere(self, rng: np.random.Generator) -> Array:
        """Return a random start that satisfies the constraints as well as it can."""
        change = rng.uniform(-1.0, 1.0, len(self.start)) * np.where(self.finder.is_length, self.finder.sizes, math.pi)
        q = self.start + np.where(self.held, 0.0, change)
        if self.system.n_h and not self.held.all():
            try:
                q = self.finder.assemble(q, ~self.held)
            except (MbstabError, ArithmeticError, ValueError, np.linalg.LinAlgError):
                return self.start
        return q

    def same(self, one: Equilibrium, other: Equilibrium) -> bool:
        """Whether two solutions are the same, apart from whole turns and symmetries."""
        difference = one.motion.q - other.motion.q
        angles = ~self.finder.is_length
        difference[angles] -= 2.0 * math.pi * np.round(difference[angles] / (2.0 * math.pi))
        if np.max(np.abs(difference / self.finder.sizes)) < 1e-6:
            return True
        if not one.symmetries or one.symmetries != other.symmetries:
            return False
        # What a symmetry leaves alone: the loads and the spectrum of the stiffness.
        return _alike(_signature(self.system, one), _signature(self.system, other))

    def _failure(self, search: _Search, state: _State | None) -> EquilibriumError:
        what = "steady motion" if self.family.size else "equilibrium"
        place = self.scene.model.reference.location
        if state is None:
            return EquilibriumError(
                f"{place}: reference: no {what} found: the equations have no value at the start\n"
                "hint: give starting values under reference.guess that are nearer to an assembled position"
            )
        n, n_h = self.system.n_q, search.n_h
        force = state.residual[:n] * search.energy / search.sizes
        gap = state.residual[n : n + n_h]
        lines = [f"{place}: reference: no {what} found in {search.iterations} steps (Newton, relaxation"]
        lines[0] += ", spin-up)" if search.known else ")"
        broken = len(gap) and float(np.max(np.abs(gap))) > 1e-6
        worst = int(np.argmax(np.abs(state.residual[:n])))
        unit = "N" if is_length(self.system.names[worst]) else "N*m"
        if broken:
            row = self.system.rows[search.rows[int(np.argmax(np.abs(gap)))]]
            lines.append(f"it stalled where {row} is not satisfied: the mechanism does not close there")
            hint = "correct the lengths, or give starting values under reference.guess"
        else:
            lines.append(f"it stalled with {abs(force[worst]):.4g} {unit} unbalanced on {self.system.names[worst]}")
            hint = "other starting values under reference.guess, or --starts 20"
            if self.held.any():
                names = [name for name, held in zip(self.system.names, self.held, strict=True) if held]
                hint += f"; held are {', '.join(names[:6])}{' …' if len(names) > 6 else ''}: a guess leaves them free"
        flat = [
            body.name
            for body, part in zip(self.scene.bodies, self.system.body_slices, strict=True)
            if len(body.coordinates) == 6 and abs(math.cos(state.q[part.start + 4])) < CHART_WARNING
        ]
        if flat:
            lines.append(f"the Euler angles of {', '.join(map(repr, flat))} are singular there")
            hint = "give them another base rotation with axes: [phi, theta, psi], so that theta stays away from pi/2"
        pulled = self._nothing_holds(state)
        if pulled:
            lines.append(f"nothing holds {pulled}: whatever the position, the force along it stays")
            hint = "hold it with a joint, a spring or a contact; a body in free fall has no equilibrium"
        return EquilibriumError("\n".join([*lines, f"hint: {hint}"]))

    def _nothing_holds(self, state: _State) -> str:
        """Name a coordinate on which a force acts that no position changes and no constraint takes."""
        K, _, _ = self.system.linearize(state.q, state.u, state.a, state.nu)
        sizes = self.finder.sizes
        load = state.residual[: self.system.n_q]
        for i in np.argsort(-np.abs(load)):
            if abs(load[i]) < 1e-6:
                break
            weights = np.abs(K * sizes * sizes[:, None])
            if np.max(weights[:, i]) <= 1e-9 * np.max(weights) and not np.any(state.J[:, i]):
                return self.system.names[int(i)]
        return ""


def _tidied(search: _Search, at: _State) -> _State:
    """Return a solution whose zeros are zeros, where that costs nothing."""
    q, c = at.q.copy(), at.c.copy()
    q[np.abs(q / search.sizes) < 1e-15] = 0.0
    c[np.abs(c) < 1e-13 * search.speed] = 0.0
    try:
        cleaned = search.state(q, c)
    except (MbstabError, ArithmeticError, ValueError):
        return at
    return cleaned if cleaned.size <= max(2.0 * at.size, 1e-14) else at


def _open_directions(search: _Search, at: _State, known: list[Symmetry]) -> list[str]:
    """Return directions in which a solution is not isolated although no symmetry explains them."""
    G, moving = search.jacobian(at)
    if not moving:
        return []
    # Without the multipliers: only what the free directions of the forces say.
    forces = G[:, moving:]
    rest = (
        rank_of(forces.T / max(float(np.max(np.abs(forces), initial=0.0)), 1e-300)).null
        if forces.size
        else np.eye(len(G))
    )
    reduced = rest.T @ G[:, :moving]
    _, s, right = np.linalg.svd(reduced)
    rank = int(np.sum(s > SINGULAR * max(float(s[0]), 1e-300))) if len(s) else 0
    null = right[rank:].T[: len(search.open)]
    if known:
        shifts = np.array([s.direction for s in known])[:, search.open].T / search.sizes[search.open, None]
        basis, _ = np.linalg.qr(shifts)
        null = null - basis @ (basis.T @ null)
    left, s, _ = np.linalg.svd(null, full_matrices=False)
    names = [search.system.names[i] for i in search.open]
    found = []
    for vector in left.T[: int(np.sum(s > 1e-6))]:
        strong = np.argsort(-np.abs(vector))
        parts = [names[i] for i in strong if abs(vector[i]) > 0.3 * np.max(np.abs(vector))]
        kind = "a continuum" if _continues(search, at, vector) else "a critical position"
        found.append(f"{kind} along {', '.join(parts[:4])}")
    return found


def _continues(search: _Search, at: _State, vector: Array) -> bool:
    """Whether there are solutions some way along a direction."""
    distance = 0.02 / float(np.max(np.abs(vector)))
    step = np.concatenate([distance * vector, np.zeros(len(search.free))])
    trial = search.tried(at, step)
    for _ in range(20):
        if trial is None:
            return False
        if trial.size < 1e-10:
            moved = (trial.q - at.q)[search.open] / search.sizes[search.open]
            return bool(abs(moved @ vector) > 0.5 * distance)
        G, moving = search.jacobian(trial)
        G = np.vstack([G, np.concatenate([vector, np.zeros(G.shape[1] - len(vector))])])
        trial = search.tried(trial, _step(G, np.append(trial.residual, 0.0), moving, 0.0))
    return False


def _signature(system: System, found: Equilibrium) -> Array:
    """Return numbers that symmetries leave alone: sizes of reactions, and eigenvalues of the reduced stiffness."""
    motion = found.motion
    K, R, _ = system.linearize(motion.q, motion.u, motion.a, motion.nu)
    Xi, Xi_2 = found.steady.frame(motion.q)
    spaces, scale = motion.spaces, motion.spaces.scale
    full = (K + R @ Xi + motion.dynamics.M @ Xi_2) * scale * scale[:, None]
    values = np.linalg.eigvals(spaces.N.T @ full @ spaces.N)
    loads = [float(np.linalg.norm(r.force)) for r in found.reactions]
    return np.concatenate([np.sort(values.real), np.sort(np.abs(values.imag)), loads])


def _alike(one: Array, other: Array) -> bool:
    size = max(float(np.max(np.abs(one), initial=0.0)), float(np.max(np.abs(other), initial=0.0)), 1e-300)
    return len(one) == len(other) and bool(np.max(np.abs(one - other), initial=0.0) < 1e-6 * size)
