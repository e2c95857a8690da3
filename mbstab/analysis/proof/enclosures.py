"""The reference motion of a scene in balls: given as it is written, assembled, at rest or steady, proven to exist.

Double precision says where it is; the operator of Krawczyk (1969, Computing 4; Rump 2010, Acta Numerica 19,
section 13) proves that there is one and only one next to it, for all values of the parameters in their balls.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np

from mbstab.analysis.algebra import balls
from mbstab.analysis.algebra.balls import Ball, Hopeless, Matrix, NotProvable, ball, real, zero_inside
from mbstab.analysis.algebra.deflation import in_frame
from mbstab.analysis.linear.constancy import time_doubt
from mbstab.analysis.linear.facts import Grounds
from mbstab.analysis.linear.linearize import Linearization, linearize
from mbstab.analysis.reference.equilibrium import Problem
from mbstab.analysis.reference.motion import Motion
from mbstab.analysis.reference.requested import reference_motion
from mbstab.analysis.reference.rotation import cross_matrix
from mbstab.analysis.reference.steady import Generator
from mbstab.compiler.system import System
from mbstab.errors import MbstabError
from mbstab.model.schema import Model
from mbstab.model.values import evaluate

# --- reference motion -----------------------------------------------------------------------------------------------


class Field:
    """The generator X(q) of a steady motion in balls; see `mbstab.analysis.reference.steady.Generator`."""

    def __init__(
        self, system: System, axis: list[Ball], point: list[Ball], rate: Ball, velocity: list[Ball], spins: list[Ball]
    ) -> None:
        self.system, self.axis, self.point, self.rate = system, axis, point, rate
        self.velocity, self.spins = velocity, spins

    def at(self, q: Sequence[Ball]) -> tuple[list[Ball], Matrix, Matrix]:
        """Return X, Ξ = DX and D²X[X, ·] without the spins' part, shapes (n_q,), (n_q, n_q), (n_q, n_q)."""
        system, n, d = self.system, self.system.n_q, self.system.scene.dimension
        X, slope, growth = list(self.spins), balls.zeros(n, n), balls.zeros(n, n)
        turns = not self.rate.is_zero()
        cross = [[self.rate * x for x in row[:d]] for row in cross_matrix(np.array(self.axis, dtype=object))[:d]]
        cross = balls.matrix(cross)
        for body, part in zip(system.scene.bodies, system.body_slices, strict=True):
            s = part.start
            for i in range(d):
                X[s + i] = X[s + i] + self.velocity[i]
                if turns:
                    for j in range(d):
                        X[s + i] = X[s + i] + cross[i][j] * (q[s + j] - self.point[j])
                        slope[s + i][s + j] = cross[i][j]
            if not body.orientation or not turns:
                continue
            if d == 2:
                X[s + 2] = X[s + 2] + self.rate * self.axis[2]
                continue
            x, first, second = self._angles(body, q[s + 3 : s + 6])
            for i in range(3):
                X[s + 3 + i] = X[s + 3 + i] + self.rate * x[i]
                for j in range(3):
                    slope[s + 3 + i][s + 3 + j] = self.rate * first[i][j]
                    growth[s + 3 + i][s + 3 + j] = self.rate * self.rate * second[i][j]
        return X, slope, growth

    def _angles(self, body: Any, angles: Sequence[Ball]) -> tuple[list[Ball], Matrix, Matrix]:
        """Return X, slope and growth of the Euler angles as `mbstab.analysis.reference.rotation.turning_rates`."""
        f, base = balls.ball_arithmetic(), [ball(x) for x in body.base]
        w1, w2, w3 = (sum((base[3 * i + k] * self.axis[i] for i in range(3)), ball(0)) for k in range(3))
        c1, s1, t2 = f.cos(angles[0]), f.sin(angles[0]), f.tan(angles[1])
        sec = 1 / f.cos(angles[1])
        x, y = c1 * w2 + s1 * w3, c1 * w3 - s1 * w2
        p = w1 - t2 * y
        x_t, y_t, t_t, sec_t = y * p, -x * p, sec * sec * x, sec * t2 * x
        slope, growth = balls.zeros(3, 3), balls.zeros(3, 3)
        slope[0][0], slope[0][1], slope[1][0] = t2 * x, -sec * sec * y, y
        slope[2][0], slope[2][1] = -sec * x, sec * t2 * y
        growth[0][0], growth[0][1] = t_t * x + t2 * x_t, -2 * sec * sec_t * y - sec * sec * y_t
        growth[1][0], growth[2][0] = y_t, -sec_t * x - sec * x_t
        growth[2][1] = (sec_t * t2 + sec * t_t) * y + sec * t2 * y_t
        return [p, x, sec * y], slope, growth


class State(NamedTuple):
    """The reference motion in balls."""

    q: list[Ball]
    u: list[Ball]
    a: list[Ball]
    nu: list[Ball]
    slope: Matrix
    second: Matrix
    field: Field


class Rough(NamedTuple):
    """The same scene in double precision."""

    system: System
    motion: Motion
    linear: Linearization


class Solution(NamedTuple):
    """What the operator of Krawczyk has proven.

    Attributes
    ----------
    unknowns : tuple of str
        Coordinates, rates and multipliers that are solved for.
    equations : tuple of int
        Which of the equations determine them.
    found : list of ball
        Contain the solution.
    alone : list of ball
        Contain no other one.
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
        Another one, from which this one is looked for instead of from the guess of the file.
    steady : bool
        Whether it is known that the motion of later is that of now by a symmetry.

    Attributes
    ----------
    assumed : list of str
        What is not proven, in full.
    conditions : list of str
        The same as clauses of a sentence.
    solutions : list of Solution
        What was solved for, in order; empty: the file gives the motion.
    found : list of str
        Coordinates among what was solved for.
    taken : dict
        Coordinates that nothing determines; they stay as they are in what is near.
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
        self.solutions: list[Solution] = []
        self.found: list[str] = []
        self.closed: set[int] = set()
        self.driven: set[int] = set()
        self.taken: dict[str, float] = near.taken if near is not None else {}
        self.near = near if near is not None and near.solutions else None
        self.wide = any(float(x.rad()) > balls.WIDE * abs(float(x.mid())) for x in overrides.values())
        nominal = {name: float(x.mid()) for name, x in overrides.items()}
        system = System(evaluate(model, nominal))
        if system.scene.period is not None:
            raise Hopeless("the motion is periodic: multipliers are not enclosed")
        motion = self._rough_motion(system)
        linear = linearize(system, motion)
        self.rough = Rough(system, motion, linear)
        self.grounds = Grounds(linear)
        self.system = balls.ball_system(model, overrides)
        # Constancy is a matter of the expressions: looking at some times can only refute it.
        doubt = time_doubt(self.system) or (self.grounds.time if not steady or not linear.constant else "")
        if doubt:
            raise Hopeless(doubt)
        self.time = ball(self.system.scene.time)
        self._choose_rows()
        self.state = self._reference()
        self._check()

    def _rough_motion(self, system: System) -> Motion:
        """Return the motion in double precision, with `near` the one that Newton's method leads to from there."""
        if system.scene.model.reference.find is not None:
            problem = Problem(system)
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
        # What nothing determines stays where it was.
        system.scene = replace(system.scene, guess=guess, coordinates={**system.scene.coordinates, **self.taken})
        return reference_motion(system)

    def same_at(self, point: Reference) -> bool:
        """Whether the solution at one value of the parameters, for which this one holds too, is proven to be this one.

        Both are the only solution in their boxes. If the narrow one lies in the box of this one, it is its solution.
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
        """Return the solution next to this one that belongs to what is solved for now."""
        k = len(self.solutions)
        return self.near.solutions[k] if self.near is not None and k < len(self.near.solutions) else None

    # --- what the scene says ----------------------------------------------------------------------------------------

    def _choose_rows(self) -> None:
        """Take constraint rows that are independent of each other; the others are assumed to repeat them."""
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

    def _generator(self, q: Sequence[Ball], c: Sequence[Ball] | None = None) -> Field:
        """Return the field of the steady motion; `c` are the coefficients that are not given."""
        scene, n = self.system.scene, self.system.n_q
        generator, names = self.rough.linear.generator, self.system.names
        zero = [ball(0)] * 3
        steady, unknown = scene.steady, list(c or [])
        axis, point, velocity, rate = [ball(0), ball(0), ball(1)], zero[:], zero[:], ball(0)
        spins = [ball(0)] * n
        if steady is not None:
            if steady.axis is not None:
                axis, point = balls.vector(steady.axis), balls.vector([*steady.point, 0])[:3]
                rate = ball(steady.rate) if steady.rate is not None else unknown.pop(0)
            if steady.direction is not None:
                speed = ball(steady.speed) if steady.speed is not None else unknown.pop(0)
                velocity = [speed * x for x in balls.vector([*steady.direction, 0])[:3]]
            for i in self._spinning():
                spins[i] = unknown.pop(0)
            return Field(self.system, axis, point, rate, velocity, spins)
        if generator is not None and generator.turns:
            return self._turning(q, generator)
        if generator is None:
            raise NotProvable("no frame is known in which the motion stands still")
        for i, name in enumerate(names):
            spins[i] = ball(scene.rates.get(name, 0))
        return Field(self.system, axis, zero, rate, velocity, spins)

    def _turning(self, q: Sequence[Ball], generator: Generator) -> Field:
        """Return the turn whose field the rates of the file are, by the rate that it changes most."""
        names, scene, motion = self.system.names, self.system.scene, self.rough.motion
        zero, known = [ball(0)] * 3, [*generator.axis.tolist(), *generator.point.tolist()]
        if not all(x == round(x, 6) for x in known) or generator.velocity.any() or generator.spins.any():
            raise NotProvable(
                f"the motion ({generator}) is known in double precision only; declare it with reference.steady"
            )
        axis, point = ([ball(Fraction(str(x))) for x in part] for part in (known[:3], known[3:]))
        unit = Field(self.system, axis, point, ball(1), zero, [ball(0)] * self.system.n_q)
        Y = unit.at(q)[0]
        given = [i for i, name in enumerate(names) if name in scene.rates and not zero_inside(Y[i])]
        if not given:
            raise NotProvable(
                f"the motion ({generator}) is steady in a turning frame; declare it with reference.steady"
            )
        k = max(given, key=lambda i: abs(float(motion.u[i])) / motion.sizes[i])
        rate = ball(scene.rates[names[k]]) / Y[k]
        field = Field(self.system, axis, point, rate, zero, [ball(0)] * self.system.n_q)
        u = field.at(q)[0]
        self._vanish(
            [u[i] - ball(scene.rates[name]) for i, name in enumerate(names) if name in scene.rates],
            f"the reference satisfies the motion ({generator})",
        )
        return field

    def _spinning(self) -> list[int]:
        generator = self.rough.linear.generator
        return [] if generator is None else [int(i) for i in np.flatnonzero(generator.spins)]

    def _free(self) -> list[float]:
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
        free = self._free()
        if scene.steady is not None and free:
            return self._balanced(q, hold=True)
        field_ = self._generator(q)
        if scene.steady is None and field_.rate.is_zero():
            field_ = self._with_rates(q, field_)
        u, slope, growth = field_.at(q)
        second = balls.plus(balls.times(slope, slope), growth)
        a = balls.apply(slope, u)
        return State(q, u, a, self._multipliers(q, u, a), slope, second, field_)

    def _dynamics(
        self, q: Sequence[Ball], u: Sequence[Ball]
    ) -> tuple[Matrix, list[Ball], list[Ball], list[Ball], Matrix]:
        """Return M, F0, E, V and J, rows of the chosen constraints only."""
        state = self.system.dynamics(list(q), list(u), self.time)
        E, V, J = balls.vector(state.E), balls.vector(state.V), balls.matrix(state.J)
        return (
            balls.matrix(state.M), balls.vector(state.F0), [E[i] for i in self.rows], [V[i] for i in self.rows],
            [J[i] for i in self.rows],
        )  # fmt: skip

    def _all_nu(self, nu: Sequence[Ball]) -> list[Ball]:
        full = [ball(0)] * self.system.n_c
        for i, x in zip(self.rows, nu, strict=True):
            full[i] = x
        return full

    def _assembled(self, q: list[Ball], missing: list[int]) -> list[Ball]:
        """Return coordinates of which the missing ones are proven to close the constraints."""
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
            return [self._dynamics(put(x), still)[2][k] for k in chosen]

        def jacobian(x: Sequence[Ball]) -> Matrix:
            J = self._dynamics(put(x), still)[4]
            return [[J[k][i] for i in columns] for k in chosen]

        names = [self.system.names[i] for i in columns]
        return put(self._solve(residual, jacobian, [q[i] for i in columns], "the assembled position", names, chosen))

    def _take(self, q: Sequence[Ball], places: Sequence[int]) -> None:
        """Note coordinates that nothing determines and keep them as they are."""
        names = self.system.names
        self.taken = {names[i]: float(q[i]) for i in places}
        if any(self.taken.values()):
            self.assumed.append(f"what the constraints leave open is taken as found ({', '.join(self.taken)})")

    def _with_rates(self, q: list[Ball], field_: Field) -> Field:
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
            rates = field_.spins[:]
            for i, value in zip(columns, x, strict=True):
                rates[i] = value
            return rates

        def residual(x: Sequence[Ball]) -> list[Ball]:
            return [self._dynamics(q, put(x))[3][k] for k in chosen]

        def jacobian(x: Sequence[Ball]) -> Matrix:
            J = self._dynamics(q, put(x))[4]
            return [[J[k][i] for i in columns] for k in chosen]

        start, labels = [ball(float(u[i])) for i in columns], [f"rate of {names[i]}" for i in columns]
        found = self._solve(residual, jacobian, start, "the rates", labels, chosen)
        self.driven |= {self.rows[k] for k in chosen}
        return Field(self.system, field_.axis, field_.point, field_.rate, field_.velocity, put(found))

    def _multipliers(self, q: list[Ball], u: list[Ball], a: list[Ball]) -> list[Ball]:
        """Return ν from as many equations of motion as there are rows; the others are checked."""
        M, F0, _, _, J = self._dynamics(q, u)
        force = [x + y for x, y in zip(balls.apply(M, a), F0, strict=True)]
        if not self.rows:
            return []
        augmented = [[*column, -f] for column, f in zip(balls.transposed(J), force, strict=True)]
        spaces = self.rough.motion.spaces
        scale = [float(1.0 / spaces.row_scale[i]) for i in self.rows]
        pivots, T = balls.eliminate(
            augmented, len(self.rows), len(self.rows), spaces.scale.tolist(), [1 / x for x in scale]
        )
        nu = [ball(0)] * len(self.rows)
        for i, k in pivots:
            nu[k] = T[i][-1]
        return nu

    # --- equilibria and steady motions ------------------------------------------------------------------------------

    def _balanced(self, q: list[Ball], hold: bool = False) -> State:
        """Return the equilibrium or steady motion that is proven to exist next to the program's solution."""
        system, scene, motion = self.system, self.system.scene, self.rough.motion
        open_ = [i for i, name in enumerate(system.names) if not hold and name not in scene.coordinates]
        free = self._free()
        nu = motion.nu[self.rows]
        if self.left_out:  # multipliers of the chosen rows alone
            J = motion.dynamics.J[self.rows].T * motion.spaces.scale[:, None]
            force = (motion.dynamics.F0 + motion.dynamics.M @ motion.a) * motion.spaces.scale
            nu = -np.linalg.lstsq(J, force, rcond=1e-12)[0]
        start = [*(q[i] for i in open_), *(ball(x) for x in free), *(ball(float(x)) for x in nu)]
        n_open, n_free = len(open_), len(free)
        given = {i: ball(scene.rates[name]) for i, name in enumerate(system.names) if name in scene.rates}
        moving = scene.steady is not None

        def split(x: Sequence[Ball]) -> tuple[list[Ball], list[Ball], list[Ball]]:
            moved = q[:]
            for i, value in zip(open_, x, strict=False):
                moved[i] = value
            return moved, list(x[n_open : n_open + n_free]), list(x[n_open + n_free :])

        def residual(x: Sequence[Ball]) -> list[Ball]:
            at, c, nu = split(x)
            u, slope, _ = self._generator(at, c).at(at)
            M, F0, E, V, J = self._dynamics(at, u)
            force = [
                sum(terms, ball(0))
                for terms in zip(
                    balls.apply(M, balls.apply(slope, u)),
                    F0,
                    balls.apply(balls.transposed(J, system.n_q), nu),
                    strict=True,
                )
            ]
            return [
                *force,
                *E[: self.r_h],
                *(V if moving else []),
                *((u[i] - r for i, r in given.items()) if moving else ()),
            ]

        def jacobian(x: Sequence[Ball]) -> Matrix:
            at, c, nu = split(x)
            steady = self._generator(at, c)
            u, slope, growth = steady.at(at)
            a = balls.apply(slope, u)
            second = balls.plus(balls.times(slope, slope), growth)
            M, _, _, _, J = self._dynamics(at, u)
            full = self._all_nu(nu)
            K, R, _ = system.linearize(at, u, a, full, self.time)
            K, R = balls.matrix(K), balls.matrix(R)
            V_q = self._rows_of(system.linearize_rows(at, u, a, self.time)[0]) if moving else []
            _, stiffness, turned = in_frame(M, R, K, J if moving else [], V_q, slope, second, balls.BALLS)
            # X and DX X by the free coefficients: X is linear in them.
            columns, growths = [], []
            for k in range(n_free):
                unit = [ball(float(j == k)) for j in range(n_free)]
                one, one_slope, _ = self._generator(at, unit).at(at)
                none, none_slope, _ = self._generator(at, [ball(0)] * n_free).at(at)
                X = [x - y for x, y in zip(one, none, strict=True)]
                D = [[x - y for x, y in zip(*rows, strict=True)] for rows in zip(one_slope, none_slope, strict=True)]
                columns.append(X)
                growths.append([x + y for x, y in zip(balls.apply(slope, X), balls.apply(D, u), strict=True)])
            by_c = [
                [x + y for x, y in zip(balls.apply(R, X), balls.apply(M, A), strict=True)]
                for X, A in zip(columns, growths, strict=True)
            ]
            r = len(self.rows)
            result = [
                [*(stiffness[i][j] for j in open_), *(by_c[k][i] for k in range(n_free)), *(J[k][i] for k in range(r))]
                for i in range(system.n_q)
            ]
            blank = [ball(0)] * r
            result += [[*(J[k][j] for j in open_), *([ball(0)] * n_free), *blank] for k in range(self.r_h)]
            if moving:
                by_rate = [balls.apply(J, X) for X in columns]
                result += [
                    [*(turned[k][j] for j in open_), *(by_rate[c][k] for c in range(n_free)), *blank] for k in range(r)
                ]
                result += [
                    [*(slope[i][j] for j in open_), *(columns[c][i] for c in range(n_free)), *blank] for i in given
                ]
            return result

        G = np.array([[float(x.mid()) for x in row] for row in jacobian([x.mid() for x in start])])
        weights = np.array(
            [*motion.sizes[open_], *([1.0] * n_free), *(1e-300 + np.max(np.abs(nu), initial=1.0) + 0.0 * nu)]
        )
        lengths = np.linalg.norm(G * weights, axis=1)
        scaled = G * weights / np.where(lengths > 1e-9 * np.max(lengths, initial=1e-300), lengths, np.inf)[:, None]
        n = len(start)
        rank = int(np.linalg.matrix_rank(scaled, tol=1e-9)) if n else 0
        if rank < n:
            raise NotProvable(
                f"the {'steady motion' if moving else 'equilibrium'} is not isolated ({n - rank} directions are open): "
                "its existence is not proven; give what symmetries leave open under reference.coordinates"
            )
        chosen = list(earlier.equations) if (earlier := self._earlier()) else independent_rows(scaled, n)
        what = "the steady motion" if moving else "the equilibrium"
        found = self._solve(
            lambda x: [y for i, y in enumerate(residual(x)) if i in set(chosen)],
            lambda x: [row for i, row in enumerate(jacobian(x)) if i in set(chosen)],
            start,
            what,
            [
                *(system.names[i] for i in open_),
                *(f"free rate {k}" for k in range(n_free)),
                *(f"multiplier of row {i}" for i in self.rows),
            ],
            chosen,
        )
        at_rows = [k - system.n_q for k in chosen if k >= system.n_q]
        self.closed |= {self.rows[k] for k in at_rows if k < self.r_h}
        if moving:
            self.driven |= {self.rows[k - self.r_h] for k in at_rows if 0 <= k - self.r_h < len(self.rows)}
        others = [y for i, y in enumerate(residual(found)) if i not in set(chosen)]
        self._vanish(others, f"{what} satisfies the equations besides those that determine it")
        at, c, nu_ = split(found)
        steady = self._generator(at, c)
        u, slope, growth = steady.at(at)
        second = balls.plus(balls.times(slope, slope), growth)
        return State(at, u, balls.apply(slope, u), nu_, slope, second, steady)

    def _rows_of(self, matrix: Any) -> Matrix:
        full = balls.matrix(matrix)
        return [full[i] for i in self.rows]

    def _vanish(self, residuals: Sequence[Ball], what: str) -> None:
        """Note that residuals are zero as far as balls can tell; refuse those that are not."""
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
            self.assumed.append(f"{what} ({size})")
            self.conditions.append(what)

    def _check_rank(self, J: Matrix) -> None:
        """Refuse redundant rows of which it is proven that they are independent of the others."""
        if not self.left_out:
            return
        n, n_h = self.system.n_q, self.system.n_h
        spaces = self.rough.motion.spaces
        scale, row_scale = spaces.scale.tolist(), spaces.row_scale.tolist()

        def rest(A: Matrix, rank: int, columns: list[int], rows: list[float], name: str) -> tuple[list[int], Matrix]:
            """Return free columns and the null space if no minor larger than the rank is proven not to be zero."""
            pivots, T = balls.eliminate(A, rank, len(columns), rows, [scale[j] for j in columns])
            bound = {i for i, _ in pivots}
            free, N = balls.null_space(pivots, T, len(columns))
            for i in range(len(A)):
                if i not in bound and any(not zero_inside(T[i][j]) for j in free):
                    raise NotProvable(
                        f"the {name} do not repeat each other: their rank is at least {rank + 1} at these decimals, "
                        f"{rank} in double precision"
                    )
            return free, N

        free, N = rest(J[:n_h], self.r_h, list(range(n)), row_scale[:n_h], "holonomic rows")
        if self.system.n_n:
            rest(balls.times(J[n_h:], N), self.r_n, free, row_scale[n_h:], "nonholonomic rows")

    def _check(self) -> None:
        """Check that the state is a steady motion."""
        s = self.state
        M, F0, E, V, J = self._dynamics(s.q, s.u)
        full = self.system.dynamics(s.q, s.u, self.time)
        E, V, B = balls.vector(full.E), balls.vector(full.V), balls.vector(full.B)
        J_all = balls.matrix(full.J)
        self._check_rank(J_all)
        if not self.system.scene.model.reference.find:
            force = [
                sum(terms, ball(0))
                for terms in zip(
                    balls.apply(M, s.a), F0, balls.apply(balls.transposed(J, self.system.n_q), s.nu), strict=True
                )
            ]
            self._vanish(force, "the reference satisfies the equations of motion")
        slack = [x + y for x, y in zip(B, balls.apply(J_all, s.a), strict=True)]
        left = [x for i, x in enumerate(E[: self.system.n_h]) if i not in self.closed]
        left += [x for i, x in enumerate(V) if i not in self.driven]
        self._vanish([*left, *slack], "the reference satisfies the constraints")


def independent_rows(A: Any, rank: int) -> list[int]:
    """Return the numbers of rows that are independent of each other, as many as asked for (pivoted Gram-Schmidt)."""
    rest = np.array(A, dtype=float)
    chosen: list[int] = []
    for _ in range(rank):
        sizes = np.linalg.norm(rest, axis=1)
        sizes[chosen] = -1.0
        k = int(np.argmax(sizes))
        chosen.append(k)
        unit = rest[k] / sizes[k]
        for _ in range(2):
            rest = rest - np.outer(rest @ unit, unit)
    return sorted(chosen)


def krawczyk(
    residual: Callable[[Sequence[Ball]], list[Ball]],
    jacobian: Callable[[Sequence[Ball]], Matrix],
    start: Sequence[Ball],
    what: str,
) -> list[Ball]:
    """Return balls that contain one and only one zero of as many equations as unknowns; see `krawczyk_boxes`."""
    return krawczyk_boxes(residual, jacobian, start, what)[0]


def krawczyk_boxes(
    residual: Callable[[Sequence[Ball]], list[Ball]],
    jacobian: Callable[[Sequence[Ball]], Matrix],
    start: Sequence[Ball],
    what: str,
) -> tuple[list[Ball], list[Ball]]:
    """Return balls that contain a zero of as many equations as unknowns, and wider ones that contain no other.

    With an approximate inverse Y and x near the zero, x − Y f(x) + (1 − Y f'(X))(X − x) inside X
    proves it (Krawczyk 1969).

    Raises
    ------
    NotProvable
        If that is not reached.
    """
    from flint import arb, ctx

    if not start:
        return [], []
    x = [balls.real(value).mid() for value in start]
    slope = np.array([[float(y.mid()) for y in row] for row in jacobian(x)])
    rows = np.max(np.abs(slope), axis=1)
    with np.errstate(all="ignore"):
        try:
            inverse = np.linalg.inv(slope / rows[:, None]) / rows
        except np.linalg.LinAlgError:
            inverse = np.full_like(slope, np.nan)
    if not np.all(np.isfinite(inverse)):
        raise NotProvable(f"{what} is not proven to exist: the equations are singular there")
    Y = [[ball(float(y)) for y in row] for row in inverse]
    size = [max(abs(float(y)), 1e-30) for y in x]
    last = np.inf
    for _ in range(60):
        step = balls.apply(Y, residual(x))
        x = [balls.real(y - z).mid() for y, z in zip(x, step, strict=True)]
        change = max(float(abs(z).mid()) for z in step)
        if change == 0.0 or change > 0.5 * last:
            break
        last = change
    base = balls.apply(Y, residual(x))
    tiny = arb(2) ** (-ctx.prec)
    reach = [balls.real((2 * abs(z).abs_upper() + tiny * ball(s)).abs_upper()) for z, s in zip(base, size, strict=True)]
    for _ in range(12):
        offset = [arb(0, r) for r in reach]
        X = [y + o for y, o in zip(x, offset, strict=True)]
        try:
            product = balls.times(Y, jacobian(X))
        except (NotProvable, MbstabError):
            break
        rest = [[ball(int(i == j)) - y for j, y in enumerate(row)] for i, row in enumerate(product)]
        moved = [-b + z for b, z in zip(base, balls.apply(rest, offset), strict=True)]
        if all(arb(0, r).contains_interior(balls.real(z)) for z, r in zip(moved, reach, strict=True)):
            return [y + z for y, z in zip(x, moved, strict=True)], X
        reach = [2 * max(balls.real(abs(z)).abs_upper(), r, key=float) for z, r in zip(moved, reach, strict=True)]
    raise NotProvable(f"{what} is not proven to exist: the operator of Krawczyk does not contract")
