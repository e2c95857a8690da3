"""The reference motion of a scene in balls: given exactly, assembled, at rest or steady, proven to exist.

Double precision locates it; the operator of Krawczyk (1969, Computing 4; Rump 2010, Acta Numerica 19,
section 13) proves that there is exactly one near it, for all values of the parameters in their balls.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np

from mbstab.analysis.algebra import ball_matrices
from mbstab.analysis.algebra.balls import Hopeless, Matrix, NotProvable, ball_system
from mbstab.analysis.linear.linearize import linearize
from mbstab.analysis.proof.balance import Equations, forces
from mbstab.analysis.proof.krawczyk import independent_rows, krawczyk_boxes
from mbstab.analysis.proof.motion import BallGenerator, Rough, State, generator_in_balls, steady_state
from mbstab.analysis.reference.equilibrium import Problem
from mbstab.analysis.reference.motion import Motion
from mbstab.analysis.reference.requested import reference_motion
from mbstab.analysis.reference.steady import Generator
from mbstab.analysis.verdict.constancy import time_doubt
from mbstab.analysis.verdict.facts import Grounds
from mbstab.compiler.system import System
from mbstab.model import balls
from mbstab.model.balls import Ball, ball, real, zero_inside
from mbstab.model.schema import Model
from mbstab.model.values import evaluate

# --- reference motion -----------------------------------------------------------------------------------------------


class Solution(NamedTuple):
    """What the operator of Krawczyk has proven.

    Attributes
    ----------
    unknowns : tuple of str
        Coordinates, rates and multipliers that are solved for.
    equations : tuple of int
        Numbers of the equations that determine them.
    found : array of balls
        Balls that contain the solution.
    alone : array of balls
        Balls that contain no other solution.
    """

    unknowns: tuple[str, ...]
    equations: tuple[int, ...]
    found: Matrix
    alone: Matrix


class Reference:
    """The reference motion of a scene in balls.

    Parameters
    ----------
    model : Model
    overrides : mapping
        Parameters in SI.
    near : Reference, optional
        Another reference, from which the search starts instead of from the guess of the file.
    steady : bool
        Whether it is known that a symmetry maps the reference to the motion at later times.

    Attributes
    ----------
    assumed : list of str
        What is not proven, in full.
    conditions : list of str
        The same as clauses of a sentence.
    pending : list of str
        What holds in full if the motion is proven to be steady (`settle`).
    solutions : list of Solution
        Solutions in the order in which they were found; empty: the file gives the motion.
    found : list of str
        Coordinates that were solved for.
    taken : dict
        Coordinates that nothing determines; they keep the values of `near`.
    closed, driven : set of int
        Constraint rows that the solution is proven to satisfy, and their rates.
    state : State

    Raises
    ------
    NotProvable
        If the motion is not proven to exist, or redundant rows are proven not to repeat each other.
    Hopeless
        If the equations are not known to be constant from the time of the reference on.
    MbstabError
        As `mbstab.analysis.reference.requested.reference_motion`.
    """

    rows: list[int]
    r_h: int
    r_n: int
    rates: Any = None

    def __init__(
        self, model: Model, overrides: Mapping[str, Ball], near: Reference | None = None, steady: bool = False
    ) -> None:
        self.model, self.overrides = model, overrides
        self.assumed: list[str] = []
        self.conditions: list[str] = []
        self.pending: list[str] = []
        self.solutions: list[Solution] = []
        self.found: list[str] = []
        self.closed: set[int] = set()
        self.driven: set[int] = set()
        self.taken: dict[str, float] = near.taken if near is not None else {}
        self.near = near if near is not None and near.solutions else None
        self.wide = any(map(balls.is_wide, overrides.values()))
        nominal = {name: float(x.mid()) for name, x in overrides.items()}
        system = System(evaluate(model, nominal))
        if system.scene.period is not None:
            raise Hopeless("the motion is periodic: multipliers are not enclosed")
        motion = self._rough_motion(system)
        linear = linearize(system, motion)
        self.rough = Rough(system, motion, linear)
        self.grounds = Grounds(linear)
        self.system = ball_system(model, overrides)
        # Constancy follows from the expressions: samples at some times can only refute it.
        doubt = time_doubt(self.system) or (self.grounds.time if not steady or not linear.constant else "")
        if doubt:
            raise Hopeless(doubt)
        self.time = ball(self.system.scene.time)
        self._choose_rows()
        self.state = self._reference()
        self._check()

    def _rough_motion(self, system: System) -> Motion:
        """Return the motion in double precision; with `near`, the one that Newton's method finds from there."""
        if system.scene.model.reference.find is not None:
            problem = Problem(system, massless=True)
            if self.near is None:
                motion, _, at, _ = problem.solved(problem.start)
            else:
                q = np.array([float(x.mid()) for x in self.near.state.q])
                motion, _, at, _ = problem.solved(q, self.near.rates)
            self.rates = at.c
            return motion
        guess = system.scene.guess
        if self.near is not None:
            guess = {name: float(x.mid()) for name, x in zip(system.names, self.near.state.q, strict=True)}
        # Coordinates that nothing determines keep their values.
        system.scene = replace(system.scene, guess=guess, coordinates={**system.scene.coordinates, **self.taken})
        return reference_motion(system, massless=True)

    def same_at(self, point: Reference) -> bool:
        """Return whether a solution at one value of the parameters is proven to be this one, which holds there too.

        Each is the only solution in its box. If the narrow enclosure lies in the box of this one, both are the same.
        """
        return len(self.solutions) == len(point.solutions) and all(
            one.unknowns == other.unknowns
            and one.equations == other.equations
            and all(real(x).contains(real(y)) for x, y in zip(one.alone, other.found, strict=True))
            for one, other in zip(self.solutions, point.solutions, strict=True)
        )

    def solved(self) -> dict[str, Ball]:
        """Return enclosures of the coordinates that the file does not give."""
        return {name: x for name, x in zip(self.system.names, self.state.q, strict=True) if name in self.found}

    def _solve(
        self,
        residual: Callable[[Matrix], Matrix],
        jacobian: Callable[[Matrix], Matrix],
        start: Matrix,
        what: str,
        unknowns: Sequence[str],
        equations: Sequence[int],
    ) -> Matrix:
        """Return balls that contain the one solution."""
        if not len(start):
            return start
        found, alone = krawczyk_boxes(residual, jacobian, start, what)
        self.solutions.append(Solution(tuple(unknowns), tuple(equations), found, alone))
        self.found += [name for name in unknowns if name in self.system.names]
        return found

    def _earlier(self) -> Solution | None:
        """Return the solution of `near` that corresponds to the next one, if there is one."""
        k = len(self.solutions)
        return self.near.solutions[k] if self.near is not None and k < len(self.near.solutions) else None

    # --- what the scene says ----------------------------------------------------------------------------------------

    def _choose_rows(self) -> None:
        """Choose independent constraint rows; the others are assumed to be redundant."""
        motion, n_h = self.rough.motion, self.system.n_h
        J = motion.dynamics.J * motion.spaces.scale * motion.spaces.row_scale[:, None]
        C, W = motion.spaces.C, motion.spaces.W
        holonomic = independent_rows(J[:n_h], C.rank)
        others = [n_h + i for i in independent_rows(J[n_h:] @ motion.spaces.N, W.rank)]
        if self.near is not None:  # multipliers of other rows would be other unknowns
            if (len(holonomic), len(others)) != (self.near.r_h, self.near.r_n):
                raise NotProvable("the number of rows that repeat others changes")
            holonomic, others = self.near.rows[: self.near.r_h], self.near.rows[self.near.r_h :]
        self.rows = [*holonomic, *others]
        self.r_h, self.r_n = len(holonomic), len(others)
        left_out = [i for i in range(self.system.n_c) if i not in set(self.rows)]
        if left_out:
            names = ", ".join(dict.fromkeys(str(self.system.rows[i]) for i in left_out))
            self.assumed.append(
                f"rows that repeat others are left out ({names}): that they follow from the others is not proven"
            )
            self.conditions.append(f"these rows repeat others: {names}")
        self.left_out = left_out

    def generator(self, q: Matrix, c: Sequence[Ball] | None = None) -> BallGenerator:
        """Return the field of the steady motion; `c` are the coefficients that are not given."""
        scene, n = self.system.scene, self.system.n_q
        generator, names = self.rough.linear.generator, self.system.names
        steady, unknown = scene.steady, list(c or [])
        zero, axis, rate = ball_matrices.zeros(3), ball_matrices.matrix([0, 0, 1]), ball(0)
        point, velocity, spins = zero, zero, ball_matrices.zeros(n)
        if steady is not None:
            if steady.axis is not None:
                axis, point = ball_matrices.matrix(steady.axis), ball_matrices.matrix([*steady.point, 0])[:3]
                rate = ball(steady.rate) if steady.rate is not None else unknown.pop(0)
            if steady.direction is not None:
                speed = ball(steady.speed) if steady.speed is not None else unknown.pop(0)
                velocity = speed * ball_matrices.matrix([*steady.direction, 0])[:3]
            for i in self._spinning():
                spins[i] = unknown.pop(0)
            return generator_in_balls(self.system, axis, point, rate, velocity, spins)
        if generator is not None and generator.turns:
            return self._turning(q, generator)
        if generator is None:
            raise NotProvable("no frame is known in which the motion stands still")
        for i, name in enumerate(names):
            spins[i] = ball(scene.rates.get(name, 0))
        return generator_in_balls(self.system, axis, zero, rate, velocity, spins)

    def _turning(self, q: Matrix, generator: Generator) -> BallGenerator:
        """Return the turn whose field, with spins of its own, gives the rates of the file, scaled by the largest."""
        names, scene, motion = self.system.names, self.system.scene, self.rough.motion
        zero, known = [ball(0)] * 3, [*generator.axis.tolist(), *generator.point.tolist()]
        if not all(x == round(x, 6) for x in known) or generator.velocity.any():
            raise NotProvable(
                f"the motion ({generator}) is known in double precision only; declare it with reference.steady"
            )
        axis, point = ([ball(Fraction(str(x))) for x in part] for part in (known[:3], known[3:]))
        still, spinning = [ball(0)] * self.system.n_q, set(self._spinning())
        Y = generator_in_balls(self.system, axis, point, ball(1), zero, still).field(q)
        rates = {i: ball(scene.rates[name]) for i, name in enumerate(names) if name in scene.rates}
        if not spinning <= set(rates):
            own = generator_in_balls(
                self.system, axis, zero, ball(0), zero, [rates.get(i, x) for i, x in enumerate(still)]
            )
            rates = dict(enumerate(self._with_rates(q, own).spins))
        given = [i for i in rates if i not in spinning and not zero_inside(Y[i])]
        if not given:
            raise NotProvable(
                f"the motion ({generator}) is steady in a turning frame; declare it with reference.steady"
            )
        k = max(given, key=lambda i: abs(float(motion.u[i])) / motion.sizes[i])
        rate = rates[k] / Y[k]
        spins = [rates[i] - rate * Y[i] if i in spinning else x for i, x in enumerate(still)]
        field = generator_in_balls(self.system, axis, point, rate, zero, spins)
        u = field.field(q)
        self._vanish(
            [u[i] - x for i, x in rates.items() if i not in spinning],
            f"the reference satisfies the motion ({generator})",
        )
        return field

    def _spinning(self) -> list[int]:
        generator = self.rough.linear.generator
        return [] if generator is None else [int(i) for i in np.flatnonzero(generator.spins)]

    def free_rates(self) -> list[float]:
        """Return the coefficients of a declared steady motion that are not given, in double precision."""
        steady, generator = self.system.scene.steady, self.rough.motion.generators[0]
        if steady is None:
            return []
        found = []
        if steady.axis is not None and steady.rate is None:
            found.append(float(generator.rate))
        if steady.direction is not None and steady.speed is None:
            found.append(
                float(np.array([float(x) for x in steady.direction]) @ generator.velocity[: len(steady.direction)])
            )
        return found + [float(generator.spins[i]) for i in self._spinning()]

    def _reference(self) -> State:
        scene, motion = self.system.scene, self.rough.motion
        found = zip(self.system.names, motion.q.tolist(), strict=True)
        q = ball_matrices.matrix([scene.coordinates.get(name, x) for name, x in found])
        if scene.model.reference.find is not None:
            return self._balanced(q)
        missing = [i for i, name in enumerate(self.system.names) if name not in scene.coordinates]
        if missing and self.r_h:
            q = self._assembled(q, missing)
        elif missing:
            self._take(q, missing)
        free = self.free_rates()
        if scene.steady is not None and free:
            return self._balanced(q, hold=True)
        field_ = self.generator(q)
        if scene.steady is None and field_.rate.is_zero():
            field_ = self._with_rates(q, field_)
        state = steady_state(field_, q)
        return state._replace(nu=self._multipliers(q, state.u, state.a))

    def dynamics(self, q: Matrix, u: Matrix) -> tuple[Matrix, Matrix, Matrix, Matrix, Matrix]:
        """Return M, F0, E, V and J, rows of the chosen constraints only."""
        state = self.system.dynamics(q, u, self.time)
        M, F0, E, V, J = map(ball_matrices.matrix, (state.M, state.F0, state.E, state.V, state.J))
        return M, F0, E[self.rows], V[self.rows], J[self.rows]

    def all_multipliers(self, nu: Matrix) -> Matrix:
        """Return the multipliers of all rows; those of redundant rows are zero."""
        full = ball_matrices.zeros(self.system.n_c)
        full[self.rows] = nu
        return full

    def _solved(
        self, rows: list[int], missing: list[int], labels: Sequence[str], known: Matrix, rough: Matrix,
        equations: Callable[[Matrix], tuple[Matrix, ...]], what: str,
    ) -> tuple[Matrix, list[int], list[int]]:  # fmt: skip
        """Return missing coordinates or rates that are proven to satisfy rows, which of them and which rows these are.

        Parameters
        ----------
        labels : sequence of str
            Names of the unknowns, of all coordinates.
        known, rough : array of balls
            All coordinates or rates, and where the search for missing ones begins.
        equations : callable
            Returns the residuals of the rows and their derivatives by all coordinates or rates.
        """
        motion = self.rough.motion
        J = motion.dynamics.J[rows] * motion.sizes
        J = (J / np.linalg.norm(J, axis=1)[:, None])[:, missing]
        rank = int(np.linalg.matrix_rank(J, tol=1e-9))
        chosen = independent_rows(J, rank)
        columns = [missing[k] for k in independent_rows(J[chosen].T, rank)]
        if earlier := self._earlier():
            chosen = list(earlier.equations)
            columns = [i for i in missing if labels[i] in earlier.unknowns]

        def put(x: Matrix) -> Matrix:
            moved = known.copy()
            moved[columns] = x
            return moved

        found = self._solve(
            lambda x: equations(put(x))[0][chosen],
            lambda x: equations(put(x))[1][np.ix_(chosen, columns)],
            rough[columns], what, [labels[i] for i in columns], chosen,
        )  # fmt: skip
        return put(found), columns, [rows[k] for k in chosen]

    def _assembled(self, q: Matrix, missing: list[int]) -> Matrix:
        """Return coordinates whose missing ones are proven to satisfy the constraints."""
        still, rows, names = ball_matrices.zeros(self.system.n_q), self.rows[: self.r_h], self.system.names

        def equations(q: Matrix) -> tuple[Matrix, Matrix]:
            state = self.system.closing.dynamics(q, still, self.time)
            return ball_matrices.matrix(state.E)[rows], ball_matrices.matrix(state.J)[rows]

        found, columns, closed = self._solved(rows, missing, names, q, q, equations, "the assembled position")
        self._take(q, [i for i in missing if i not in columns])
        self.closed |= set(closed)
        return found

    def _take(self, q: Matrix, places: Sequence[int]) -> None:
        """Record coordinates that nothing determines, and keep their values."""
        names = self.system.names
        self.taken = {names[i]: float(q[i]) for i in places}
        if any(self.taken.values()):
            self.assumed.append(f"what the constraints leave open is taken as found ({', '.join(self.taken)})")

    def _with_rates(self, q: Matrix, field_: BallGenerator) -> BallGenerator:
        """Return the field with rates that the file leaves out, from the velocity rows."""
        scene, names, u = self.system.scene, self.system.names, self.rough.motion.u
        missing = [i for i, name in enumerate(names) if name not in scene.rates]
        if not any(u[i] for i in missing):
            return field_
        labels, rough = [f"rate of {name}" for name in names], ball_matrices.matrix(u.tolist())
        spins, _, driven = self._solved(
            self.rows, missing, labels, field_.spins, rough, lambda u: self.dynamics(q, u)[3:], "the rates"
        )
        self.driven |= set(driven)
        return generator_in_balls(self.system, field_.axis, field_.point, field_.rate, field_.velocity, spins)

    def _multipliers(self, q: Matrix, u: Matrix, a: Matrix) -> Matrix:
        """Return ν from as many equations of motion as there are rows; the others are checked."""
        M, F0, _, _, J = self.dynamics(q, u)
        force = ball_matrices.times(M, a) + F0
        spaces, r = self.rough.motion.spaces, len(self.rows)
        scale = [float(spaces.row_scale[i]) for i in self.rows]
        pivots, T = ball_matrices.eliminate(np.hstack([J.T, -force[:, None]]), r, r, spaces.scale.tolist(), scale)
        nu = ball_matrices.zeros(r)
        for i, k in pivots:
            nu[k] = T[i, -1]
        return nu

    # --- equilibria and steady motions ------------------------------------------------------------------------------

    def _balanced(self, q: Matrix, hold: bool = False) -> State:
        """Return the equilibrium or steady motion that is proven to exist near the solution in double precision."""
        equations = Equations(self, q, hold)
        start, moving = equations.start(), equations.moving
        what = "the steady motion" if self.system.scene.steady is not None else "the equilibrium"
        chosen = list(earlier.equations) if (earlier := self._earlier()) else equations.independent(start, what)
        found = self._solve(
            lambda x: equations.residual(x)[chosen],
            lambda x: equations.jacobian(x)[chosen],
            start,
            what,
            equations.unknowns(),
            chosen,
        )
        at_rows = [k - self.system.n_q for k in chosen if k >= self.system.n_q]
        self.closed |= {self.rows[k] for k in at_rows if k < self.r_h}
        if moving:
            self.driven |= {self.rows[k - self.r_h] for k in at_rows if 0 <= k - self.r_h < len(self.rows)}
        others = np.delete(equations.residual(found), chosen)
        self._vanish(others, f"{what} satisfies the equations besides those that determine it")
        return equations.state(found)

    def _vanish(self, residuals: Sequence[Ball] | Matrix, what: str, later: bool = False) -> None:
        """Record that residuals are zero as far as balls can tell; refuse those that are not.

        With `later` they are if a symmetry is proven to map the motion to that at later times.
        """
        wrong = [x for x in residuals if not zero_inside(x)]
        if wrong:
            raise NotProvable(f"{what.replace('satisfies', 'does not satisfy')}: a residual is {wrong[0].str(5)}")
        largest = max((float(x.rad()) for x in residuals), default=0.0)
        if largest > 0.0:
            size = (
                "checked at some values in each part, zero is inside between"
                if self.wide
                else f"residuals are zero to within {largest:.0e}"
            )
            (self.pending if later else self.assumed).append(f"{what} ({size})")
            if not later:
                self.conditions.append(what)

    def settle(self, steady: bool) -> None:
        """Turn what is pending into conditions, unless the motion is proven to be steady."""
        for text in self.pending:
            what = text.rpartition(" (")[0]
            if not steady and what not in self.conditions:
                self.assumed.append(text)
                self.conditions.append(what)
        self.pending = []

    def _check_rank(self, J: Matrix) -> None:
        """Refuse rows that were taken as redundant but are proven to be independent of the others."""
        if not self.left_out:
            return
        n, n_h = self.system.n_q, self.system.n_h
        spaces = self.rough.motion.spaces
        scale, row_scale = spaces.scale.tolist(), spaces.row_scale.tolist()

        def rest(A: Matrix, rank: int, columns: list[int], rows: list[float], name: str) -> tuple[list[int], Matrix]:
            """Return free columns and the null space if no minor larger than the rank is proven not to be zero."""
            pivots, T = ball_matrices.eliminate(A, rank, len(columns), rows, [scale[j] for j in columns])
            bound = {i for i, _ in pivots}
            free, N = ball_matrices.null_space(pivots, T, len(columns))
            for i in range(len(A)):
                if i not in bound and any(not zero_inside(T[i, j]) for j in free):
                    raise NotProvable(
                        f"the {name} do not repeat each other: their rank is at least {rank + 1} at these decimals, "
                        f"{rank} in double precision"
                    )
            return free, N

        free, N = rest(J[:n_h], self.r_h, list(range(n)), row_scale[:n_h], "holonomic rows")
        if self.system.n_n:
            rest(ball_matrices.times(J[n_h:], N), self.r_n, free, row_scale[n_h:], "nonholonomic rows")

    def _check(self) -> None:
        """Check that the state is a steady motion."""
        s = self.state
        M, F0, E, V, J = self.dynamics(s.q, s.u)
        full = self.system.dynamics(s.q, s.u, self.time)
        E, V, B, J_all = map(ball_matrices.matrix, (full.E, full.V, full.B, full.J))
        self._check_rank(J_all)
        if not self.system.scene.model.reference.find:
            force = forces(M, s.a, F0, J, s.nu)
            self._vanish(force, "the reference satisfies the equations of motion")
        slack = B + ball_matrices.times(J_all, s.a)
        left = [x for i, x in enumerate(E[: self.system.n_h]) if i not in self.closed]
        left += [x for i, x in enumerate(V) if i not in self.driven]
        held = "the reference satisfies the constraints"
        self._vanish(left, held)
        self._vanish(slack, held, later=True)
