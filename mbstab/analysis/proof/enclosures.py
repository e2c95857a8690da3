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
    found : list of ball
        Balls that contain the solution.
    alone : list of ball
        Balls that contain no other solution.
    """

    unknowns: tuple[str, ...]
    equations: tuple[int, ...]
    found: list[Ball]
    alone: list[Ball]


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
        residual: Callable[[Sequence[Ball]], list[Ball]],
        jacobian: Callable[[Sequence[Ball]], Matrix],
        start: Sequence[Ball],
        what: str,
        unknowns: Sequence[str],
        equations: Sequence[int],
    ) -> list[Ball]:
        """Return balls that contain the one solution."""
        if not start:
            return []
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

    def generator(self, q: Sequence[Ball], c: Sequence[Ball] | None = None) -> BallGenerator:
        """Return the field of the steady motion; `c` are the coefficients that are not given."""
        scene, n = self.system.scene, self.system.n_q
        generator, names = self.rough.linear.generator, self.system.names
        zero = [ball(0)] * 3
        steady, unknown = scene.steady, list(c or [])
        axis, point, velocity, rate = [ball(0), ball(0), ball(1)], zero[:], zero[:], ball(0)
        spins = [ball(0)] * n
        if steady is not None:
            if steady.axis is not None:
                axis, point = ball_matrices.vector(steady.axis), ball_matrices.vector([*steady.point, 0])[:3]
                rate = ball(steady.rate) if steady.rate is not None else unknown.pop(0)
            if steady.direction is not None:
                speed = ball(steady.speed) if steady.speed is not None else unknown.pop(0)
                velocity = [speed * x for x in ball_matrices.vector([*steady.direction, 0])[:3]]
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

    def _turning(self, q: Sequence[Ball], generator: Generator) -> BallGenerator:
        """Return the turn whose field, with spins of its own, gives the rates of the file, scaled by the largest."""
        names, scene, motion = self.system.names, self.system.scene, self.rough.motion
        zero, known = [ball(0)] * 3, [*generator.axis.tolist(), *generator.point.tolist()]
        if not all(x == round(x, 6) for x in known) or generator.velocity.any():
            raise NotProvable(
                f"the motion ({generator}) is known in double precision only; declare it with reference.steady"
            )
        axis, point = ([ball(Fraction(str(x))) for x in part] for part in (known[:3], known[3:]))
        still, spinning = [ball(0)] * self.system.n_q, set(self._spinning())
        Y = generator_in_balls(self.system, axis, point, ball(1), zero, still).field(np.array(q, dtype=object))
        rates = {i: ball(scene.rates[name]) for i, name in enumerate(names) if name in scene.rates}
        if not spinning <= set(rates):
            own = generator_in_balls(
                self.system, axis, zero, ball(0), zero, [rates.get(i, x) for i, x in enumerate(still)]
            )
            rates = dict(enumerate(self._with_rates(list(q), own).spins))
        given = [i for i in rates if i not in spinning and not zero_inside(Y[i])]
        if not given:
            raise NotProvable(
                f"the motion ({generator}) is steady in a turning frame; declare it with reference.steady"
            )
        k = max(given, key=lambda i: abs(float(motion.u[i])) / motion.sizes[i])
        rate = rates[k] / Y[k]
        spins = [rates[i] - rate * Y[i] if i in spinning else x for i, x in enumerate(still)]
        field = generator_in_balls(self.system, axis, point, rate, zero, spins)
        u = field.field(np.array(q, dtype=object))
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
        q = [ball(scene.coordinates.get(name, x)) for name, x in zip(self.system.names, motion.q.tolist(), strict=True)]
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

    def dynamics(
        self, q: Sequence[Ball], u: Sequence[Ball]
    ) -> tuple[Matrix, list[Ball], list[Ball], list[Ball], Matrix]:
        """Return M, F0, E, V and J, rows of the chosen constraints only."""
        state = self.system.dynamics(list(q), list(u), self.time)
        E, V = ball_matrices.vector(state.E), ball_matrices.vector(state.V)
        M, F0, J = ball_matrices.matrix(state.M), ball_matrices.vector(state.F0), ball_matrices.matrix(state.J)
        return M, F0, [E[i] for i in self.rows], [V[i] for i in self.rows], [J[i] for i in self.rows]

    def all_multipliers(self, nu: Sequence[Ball]) -> list[Ball]:
        """Return the multipliers of all rows; those of redundant rows are zero."""
        full = [ball(0)] * self.system.n_c
        for i, x in zip(self.rows, nu, strict=True):
            full[i] = x
        return full

    def _assembled(self, q: list[Ball], missing: list[int]) -> list[Ball]:
        """Return coordinates whose missing ones are proven to satisfy the constraints."""
        still = [ball(0)] * self.system.n_q
        J = self.rough.motion.dynamics.J[self.rows[: self.r_h]][:, missing] * self.rough.motion.sizes[missing]
        lengths = np.linalg.norm(self.rough.motion.dynamics.J[self.rows[: self.r_h]] * self.rough.motion.sizes, axis=1)
        J = J / lengths[:, None]
        rank = int(np.linalg.matrix_rank(J, tol=1e-9))
        chosen = independent_rows(J, rank)
        columns = [missing[k] for k in independent_rows(J[chosen].T, rank)]
        if earlier := self._earlier():
            chosen = list(earlier.equations)
            columns = [i for i in missing if self.system.names[i] in earlier.unknowns]
        self._take(q, [i for i in missing if i not in columns])
        self.closed |= {self.rows[k] for k in chosen}

        def put(x: Sequence[Ball]) -> list[Ball]:
            moved = q[:]
            for i, value in zip(columns, x, strict=True):
                moved[i] = value
            return moved

        def residual(x: Sequence[Ball]) -> list[Ball]:
            E = ball_matrices.vector(self.system.closing.dynamics(put(x), still, self.time).E)
            return [E[self.rows[k]] for k in chosen]

        def jacobian(x: Sequence[Ball]) -> Matrix:
            J = ball_matrices.matrix(self.system.closing.dynamics(put(x), still, self.time).J)
            return [[J[self.rows[k]][i] for i in columns] for k in chosen]

        names = [self.system.names[i] for i in columns]
        return put(self._solve(residual, jacobian, [q[i] for i in columns], "the assembled position", names, chosen))

    def _take(self, q: Sequence[Ball], places: Sequence[int]) -> None:
        """Record coordinates that nothing determines, and keep their values."""
        names = self.system.names
        self.taken = {names[i]: float(q[i]) for i in places}
        if any(self.taken.values()):
            self.assumed.append(f"what the constraints leave open is taken as found ({', '.join(self.taken)})")

    def _with_rates(self, q: list[Ball], field_: BallGenerator) -> BallGenerator:
        """Return the field with rates that the file leaves out, from the velocity rows."""
        scene, names = self.system.scene, self.system.names
        missing = [i for i, name in enumerate(names) if name not in scene.rates]
        u = self.rough.motion.u
        if not missing or not any(u[i] for i in missing):
            return field_
        motion = self.rough.motion
        J = motion.dynamics.J[self.rows] * motion.sizes
        J = (J / np.linalg.norm(J, axis=1)[:, None])[:, missing]
        rank = int(np.linalg.matrix_rank(J, tol=1e-9))
        chosen = independent_rows(J, rank)
        columns = [missing[k] for k in independent_rows(J[chosen].T, rank)]
        if earlier := self._earlier():
            chosen = list(earlier.equations)
            columns = [i for i in missing if f"rate of {names[i]}" in earlier.unknowns]

        def put(x: Sequence[Ball]) -> list[Ball]:
            rates = [*field_.spins]
            for i, value in zip(columns, x, strict=True):
                rates[i] = value
            return rates

        def residual(x: Sequence[Ball]) -> list[Ball]:
            return [self.dynamics(q, put(x))[3][k] for k in chosen]

        def jacobian(x: Sequence[Ball]) -> Matrix:
            J = self.dynamics(q, put(x))[4]
            return [[J[k][i] for i in columns] for k in chosen]

        start, labels = [ball(float(u[i])) for i in columns], [f"rate of {names[i]}" for i in columns]
        found = self._solve(residual, jacobian, start, "the rates", labels, chosen)
        self.driven |= {self.rows[k] for k in chosen}
        return generator_in_balls(self.system, field_.axis, field_.point, field_.rate, field_.velocity, put(found))

    def _multipliers(self, q: list[Ball], u: list[Ball], a: list[Ball]) -> list[Ball]:
        """Return ν from as many equations of motion as there are rows; the others are checked."""
        M, F0, _, _, J = self.dynamics(q, u)
        force = [x + y for x, y in zip(ball_matrices.apply(M, a), F0, strict=True)]
        if not self.rows:
            return []
        augmented = [[*column, -f] for column, f in zip(ball_matrices.transposed(J), force, strict=True)]
        spaces = self.rough.motion.spaces
        scale = [float(1.0 / spaces.row_scale[i]) for i in self.rows]
        pivots, T = ball_matrices.eliminate(
            augmented, len(self.rows), len(self.rows), spaces.scale.tolist(), [1 / x for x in scale]
        )
        nu = [ball(0)] * len(self.rows)
        for i, k in pivots:
            nu[k] = T[i][-1]
        return nu

    # --- equilibria and steady motions ------------------------------------------------------------------------------

    def _balanced(self, q: list[Ball], hold: bool = False) -> State:
        """Return the equilibrium or steady motion that is proven to exist near the solution in double precision."""
        equations = Equations(self, q, hold)
        start, moving = equations.start(), equations.moving
        what = "the steady motion" if self.system.scene.steady is not None else "the equilibrium"
        chosen = list(earlier.equations) if (earlier := self._earlier()) else equations.independent(start, what)
        found = self._solve(
            lambda x: [y for i, y in enumerate(equations.residual(x)) if i in set(chosen)],
            lambda x: [row for i, row in enumerate(equations.jacobian(x)) if i in set(chosen)],
            start,
            what,
            equations.unknowns(),
            chosen,
        )
        at_rows = [k - self.system.n_q for k in chosen if k >= self.system.n_q]
        self.closed |= {self.rows[k] for k in at_rows if k < self.r_h}
        if moving:
            self.driven |= {self.rows[k - self.r_h] for k in at_rows if 0 <= k - self.r_h < len(self.rows)}
        others = [y for i, y in enumerate(equations.residual(found)) if i not in set(chosen)]
        self._vanish(others, f"{what} satisfies the equations besides those that determine it")
        return equations.state(found)

    def _vanish(self, residuals: Sequence[Ball], what: str, later: bool = False) -> None:
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
                if i not in bound and any(not zero_inside(T[i][j]) for j in free):
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
        E, V, B = ball_matrices.vector(full.E), ball_matrices.vector(full.V), ball_matrices.vector(full.B)
        J_all = ball_matrices.matrix(full.J)
        self._check_rank(J_all)
        if not self.system.scene.model.reference.find:
            force = forces(M, s.a, F0, J, s.nu)
            self._vanish(force, "the reference satisfies the equations of motion")
        slack = [x + y for x, y in zip(B, ball_matrices.apply(J_all, s.a), strict=True)]
        left = [x for i, x in enumerate(E[: self.system.n_h]) if i not in self.closed]
        left += [x for i, x in enumerate(V) if i not in self.driven]
        held = "the reference satisfies the constraints"
        self._vanish(left, held)
        self._vanish(slack, held, later=True)
