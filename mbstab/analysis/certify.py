"""Eigenvalues with proven radii, and verdicts that are theorems.

The kernels run on balls (`mbstab.analysis.balls`), the constraints are eliminated by pivots that
are proven to be different from zero, and what is left, ẏ = S y, contains the linearized equations
for all values of the parameters in their balls. Then

1.  shifts along which nothing depends on the coordinates (columns that are exact zeros), turns of
    a scene whose elements all turn with it, and the motion itself are divided out: each is an
    eigenvalue zero by symmetry;
2.  S is split along its exact zeros into blocks that do not feed back into each other (strongly
    connected components). The roots of a block are those of its characteristic polynomial;
3.  if the states of a block fall into two kinds such that each kind drives the other only, then
    S = [[0, A], [B, 0]] and the roots are ±√σ for the eigenvalues σ of A B, and zeros: the spectrum
    is symmetric, and a σ that is real, negative and simple is a pair that lies *on* the imaginary
    axis. The same is so for systems of Lagrange with holonomic constraints and without damping
    (M and K symmetric, R skew), whose polynomial is even;
4.  roots are enclosed in discs (Smith 1970) where the parameters are numbers; where they are
    intervals, Routh's array says on which side of the axis they are.

Equilibria and steady motions are enclosed by the operator of Krawczyk (1969, Computing 4; Rump
2010, Acta Numerica 19, section 13), which proves that there is one and only one near the
program's solution. What a statement rests on besides is listed with it as assumed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np

from mbstab.analysis import balls
from mbstab.analysis.balls import Ball, Matrix, NotProvable, ball, real, zero_inside
from mbstab.analysis.linearize import Linearization, linearize
from mbstab.analysis.motion import Motion
from mbstab.analysis.reference import reference_motion
from mbstab.analysis.rotation import cross_matrix
from mbstab.analysis.symmetry import symmetries
from mbstab.compiler.system import System
from mbstab.errors import MbstabError, UsageError, counted
from mbstab.model.schema import Model
from mbstab.model.values import evaluate

MORE_DIGITS = (1, 2, 4)
"""Where a verdict is open, it is tried again with so many times the digits."""

WIDTH = 2.0**-24
"""A part of an interval that is narrower than this part of the whole is given up …"""

BOXES = 500
"""… and so is the rest of an interval after so many parts."""

RELATIVE = frozenset(
    [
        *("aligned", "coincident", "in_plane", "perpendicular", "distance", "screw", "spring", "ideal_spring"),
        *("body_force", "body_torque", "angle_spring", "angle_effort", "angle_position", "angle_velocity"),
        *("displacement_spring", "displacement_effort", "displacement_position", "displacement_velocity"),
    ]
)
"""Elements that see only how bodies lie to each other: turning all of them together changes nothing."""

NORMALS = {"wheel": 8, "ellipsoid": 7, "knife": 6}
"""Where the normal of the plane is among the numbers of a contact in space, after the base rotation."""


@dataclass(frozen=True)
class Enclosure:
    """One eigenvalue, or several that are not told apart.

    Attributes
    ----------
    real, imag : ball (1/s)
        ``flint.arb``; an exact zero has no radius.
    count : int
        Number of eigenvalues inside.
    kind : str
        ``left``, ``right``, ``imaginary`` (on the axis), ``zero`` or ``open``, all but the last proven.
    why : str
        What makes it lie on the axis.
    """

    real: Ball
    imag: Ball
    count: int
    kind: str
    why: str = ""

    @property
    def radius(self) -> float:
        """Largest radius of both parts (1/s), rounded up."""
        return float(np.nextafter(max(float(self.real.rad()), float(self.imag.rad())), np.inf)) if self.wide else 0.0

    @property
    def wide(self) -> bool:
        """Whether there is a radius at all."""
        return not (self.real.is_exact() and self.imag.is_exact())

    def contains(self, s: complex, slack: float = 0.0) -> bool:
        """Whether a number lies inside, or not further outside than `slack` (1/s)."""
        from flint import arb

        gap = arb(0, slack)
        return bool((self.real + gap).contains(arb(s.real)) and (self.imag + gap).contains(arb(s.imag)))


@dataclass(frozen=True)
class Part:
    """What is proven for all values of a parameter between two ends (SI): a verdict, or ``not provable``."""

    low: Fraction
    high: Fraction
    verdict: str


@dataclass(frozen=True)
class Certificate:
    """A proven verdict, or why there is none.

    Attributes
    ----------
    verdict : str
        ``asymptotically stable``, ``marginally stable`` (no eigenvalue to the right of the
        imaginary axis, some on it), ``unstable`` or ``not provable``.
    statement : str
        What is proven, in a sentence.
    eigenvalues : list of Enclosure
        Empty over an interval.
    assumed : tuple of str
        What the statement rests on besides the model file.
    reasons : tuple of str
        Why there is no verdict.
    digits : int
        Decimal digits of the computation.
    parameter : str
        Which parameter is an interval; empty: none.
    parts : tuple of Part
        Of an interval, in ascending order.
    """

    verdict: str
    statement: str
    eigenvalues: list[Enclosure]
    assumed: tuple[str, ...]
    reasons: tuple[str, ...]
    digits: int
    parameter: str = ""
    parts: tuple[Part, ...] = ()

    @property
    def proven(self) -> bool:
        """Whether there is a verdict."""
        return self.verdict != "not provable"


@dataclass(frozen=True)
class Factor:
    """A factor of the characteristic polynomial, monic, the constant first; `even`: a polynomial in σ = s²."""

    p: list[Ball]
    even: bool
    why: str = ""


@dataclass(frozen=True)
class Spectrum:
    """The characteristic polynomial as a product: exact zeros, with what makes them zero, and factors."""

    zeros: list[str]
    factors: list[Factor]
    assumed: tuple[str, ...]


# --- reference motion -----------------------------------------------------------------------------------------------


class _Field:
    """The generator X(q) of a steady motion in balls; see `mbstab.analysis.steady.Generator`."""

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
        """Return X, slope and growth of the Euler angles as `mbstab.analysis.rotation.turning_rates`."""
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


class _State(NamedTuple):
    """The reference motion in balls."""

    q: list[Ball]
    u: list[Ball]
    a: list[Ball]
    nu: list[Ball]
    slope: Matrix
    second: Matrix
    field: _Field


class _Rough(NamedTuple):
    """The same scene in double precision."""

    system: System
    motion: Motion
    linear: Linearization


class _Proof:
    """The linearized equations of a scene in balls, and the factors of their characteristic polynomial."""

    def __init__(self, model: Model, overrides: Mapping[str, Ball]) -> None:
        self.assumed: list[str] = []
        self.wide = any(float(x.rad()) > 1e-12 * abs(float(x.mid())) for x in overrides.values())
        self._symmetries: list[Any] | None = None
        nominal = {name: float(x.mid()) for name, x in overrides.items()}
        system = System(evaluate(model, nominal))
        if system.scene.period is not None:
            raise NotProvable("the motion is periodic: multipliers are not enclosed")
        motion = reference_motion(system)
        linear = linearize(system, motion)
        if not linear.constant:
            raise NotProvable("the coefficients of the linearized equations change along the motion")
        self.rough = _Rough(system, motion, linear)
        self.system = balls.ball_system(model, overrides)
        self.time = ball(self.system.scene.time)
        self._choose_rows()
        self.state = self._reference()
        self._check()

    # --- what the scene says ----------------------------------------------------------------------------------------

    def _choose_rows(self) -> None:
        """Take constraint rows that are independent of each other; the others are assumed to repeat them."""
        motion, n_h = self.rough.motion, self.system.n_h
        J = motion.dynamics.J * motion.spaces.scale * motion.spaces.row_scale[:, None]
        C, W = motion.spaces.C, motion.spaces.W
        holonomic = _independent(J[:n_h], C.rank)
        others = [n_h + i for i in _independent(J[n_h:] @ motion.spaces.N, W.rank)]
        self.rows = [*holonomic, *others]
        self.r_h, self.r_n = len(holonomic), len(others)
        left_out = [i for i in range(self.system.n_c) if i not in set(self.rows)]
        if left_out:
            names = ", ".join(dict.fromkeys(str(self.system.rows[i]) for i in left_out))
            self.assumed.append(
                f"rows that repeat others are left out ({names}): that they follow from the others is not proven"
            )
        self.left_out = left_out

    def _generator(self, q: Sequence[Ball], c: Sequence[Ball] | None = None) -> _Field:
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
            return _Field(self.system, axis, point, rate, velocity, spins)
        if generator is not None and generator.turns:
            # The file gives rates only: the turn whose field they are.
            if not all(abs(x) in (0.0, 1.0) for x in generator.axis) or generator.velocity.any():
                raise NotProvable(f"the axis of the motion ({generator}) is known in double precision only")
            raise NotProvable(
                f"the motion ({generator}) is steady in a turning frame; declare it with reference.steady"
            )
        if generator is None:
            raise NotProvable("no frame is known in which the motion stands still")
        for i, name in enumerate(names):
            spins[i] = ball(scene.rates.get(name, 0))
        return _Field(self.system, axis, zero, rate, velocity, spins)

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

    def _reference(self) -> _State:
        scene, motion = self.system.scene, self.rough.motion
        q = [ball(scene.coordinates.get(name, x)) for name, x in zip(self.system.names, motion.q.tolist(), strict=True)]
        if scene.model.reference.find is not None:
            return self._balanced(q)
        missing = [i for i, name in enumerate(self.system.names) if name not in scene.coordinates]
        if missing and self.r_h:
            q = self._assembled(q, missing)
        free = self._free()
        if scene.steady is not None and free:
            return self._balanced(q, hold=True)
        field_ = self._generator(q)
        if scene.steady is None:
            field_ = self._with_rates(q, field_)
        u, slope, growth = field_.at(q)
        second = balls.plus(balls.times(slope, slope), growth)
        a = balls.apply(slope, u)
        return _State(q, u, a, self._multipliers(q, u, a), slope, second, field_)

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
        chosen = _independent(J, rank)
        columns = [missing[k] for k in _independent(J[chosen].T, rank)]
        others = [self.system.names[i] for i in missing if i not in columns]
        if others and any(not q[i].is_zero() for i in missing if i not in columns):
            self.assumed.append(f"what the constraints leave open is taken as found ({', '.join(others)})")

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

        return put(krawczyk(residual, jacobian, [q[i] for i in columns], "the assembled position"))

    def _with_rates(self, q: list[Ball], field_: _Field) -> _Field:
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
        chosen = _independent(J, rank)
        columns = [missing[k] for k in _independent(J[chosen].T, rank)]

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

        found = krawczyk(residual, jacobian, [ball(float(u[i])) for i in columns], "the rates")
        return _Field(self.system, field_.axis, field_.point, field_.rate, field_.velocity, put(found))

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

    def _balanced(self, q: list[Ball], hold: bool = False) -> _State:
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
            stiffness = balls.plus(K, balls.times(R, slope), balls.times(M, second))
            V_q = self._rows_of(system.linearize_rows(at, u, a, self.time)[0]) if moving else []
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
                turned = balls.plus(V_q, balls.times(J, slope)) if r else []
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
        chosen = _independent(scaled, n)
        what = "the steady motion" if moving else "the equilibrium"
        found = krawczyk(
            lambda x: [y for i, y in enumerate(residual(x)) if i in set(chosen)],
            lambda x: [row for i, row in enumerate(jacobian(x)) if i in set(chosen)],
            start,
            what,
        )
        others = [y for i, y in enumerate(residual(found)) if i not in set(chosen)]
        self._vanish(others, f"{what} satisfies the equations besides those that determine it")
        at, c, nu_ = split(found)
        steady = self._generator(at, c)
        u, slope, growth = steady.at(at)
        second = balls.plus(balls.times(slope, slope), growth)
        return _State(at, u, balls.apply(slope, u), nu_, slope, second, steady)

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
                "checked at both ends of each part, zero is inside between"
                if self.wide
                else f"residuals are zero to within {largest:.0e}"
            )
            self.assumed.append(f"{what} ({size})")

    def _check(self) -> None:
        """Check that the state is a steady motion."""
        s = self.state
        M, F0, E, V, J = self._dynamics(s.q, s.u)
        full = self.system.dynamics(s.q, s.u, self.time)
        E, V, B = balls.vector(full.E), balls.vector(full.V), balls.vector(full.B)
        J_all = balls.matrix(full.J)
        if not self.system.scene.model.reference.find:
            force = [
                sum(terms, ball(0))
                for terms in zip(
                    balls.apply(M, s.a), F0, balls.apply(balls.transposed(J, self.system.n_q), s.nu), strict=True
                )
            ]
            self._vanish(force, "the reference satisfies the equations of motion")
        slack = [x + y for x, y in zip(B, balls.apply(J_all, s.a), strict=True)]
        self._vanish([*E[: self.system.n_h], *V, *slack], "the reference satisfies the constraints")
        if not self._stands_still():
            change = max(self.rough.linear.variation, 1e-16)
            self.assumed.append(
                f"the scene does not change along the motion ({self.rough.linear.generator}): its coefficients are the "
                f"same later on to {change:.0e}, checked in double precision"
            )

    def _stands_still(self) -> bool:
        """Whether it is proven that the coefficients stay the same while all that moves goes on by up to 10 s.

        A shift changes no inertia, and neither does a turn of a body about an axis of symmetry of its
        mass. What the other entries do is enclosed over that time at once.
        """
        s = self.state
        if not s.field.rate.is_zero():
            return False
        while_ = _arb(0, 10)
        q = [x if v.is_zero() else real(x) + real(v) * while_ for x, v in zip(s.q, s.u, strict=True)]
        nu = self._all_nu(s.nu)
        for path, part in self.system.parts():
            element = part._elements[0]
            if not element.rows and path.startswith("bodies."):
                if not self._symmetric_where_it_turns(path.partition(".")[2]):
                    return False
                continue
            moved = q[:]
            for i in self._carried_along(element):
                moved[i] = s.q[i]
            try:
                once, always = (
                    _coefficients(part, x, s, nu, t) for x, t in ((s.q, self.time), (moved, self.time + while_))
                )
            except MbstabError:  # no enclosure over such a time
                return False
            rounding = 1e-30 * max((abs(float(x.mid())) for x in once), default=0.0)
            for x, y in zip(once, always, strict=True):
                if float(y.rad()) > 1.01 * float(x.rad()) + rounding:
                    return False
        return True

    def _carried_along(self, element: Any) -> list[int]:
        """Return places of bodies that an element connects and that move alike: it sees only their difference."""
        name = element.kernel.__name__.rpartition(".")[2] if hasattr(element.kernel, "__name__") else "user"
        d, size = self.system.scene.dimension, 3 if self.system.scene.dimension == 2 else 6
        if name.partition("_")[2] not in RELATIVE or name.startswith("coordinate_"):
            return []
        slots = [element.columns[k : k + d] for k in range(0, len(element.columns), size)]
        if any(i >= self.system.n_q for slot in slots for i in slot):
            return []
        u = self.state.u
        alike = all((u[i] - u[j]).is_zero() for slot in slots[1:] for i, j in zip(slots[0], slot, strict=True))
        return [i for slot in slots for i in slot] if alike else []

    def _symmetric_where_it_turns(self, name: str) -> bool:
        """Whether a body turns about an axis of symmetry of its mass only, if it turns."""
        scene, s = self.system.scene, self.state
        for body, part in zip(scene.bodies, self.system.body_slices, strict=True):
            if body.name != name or not body.orientation:
                continue
            angles = s.u[part.start + scene.dimension : part.stop]
            if any(not x.is_zero() for x in angles[:-1]):
                return False
            if angles[-1].is_zero():
                continue
            inertia, center = ([ball(x) for x in values] for values in (body.inertia, body.center))
            if not all(x.is_zero() for x in center[:2]):
                return False
            if scene.dimension == 3 and not all(x.is_zero() for x in (inertia[0] - inertia[1], *inertia[3:])):
                return False
        return True

    # --- elimination ------------------------------------------------------------------------------------------------

    def factors(self) -> Spectrum:
        """Return the characteristic polynomial of the linearized equations as a product."""
        s, n = self.state, self.system.n_q
        K, R, _ = self.system.linearize(s.q, s.u, s.a, self._all_nu(s.nu), self.time)
        K, R = balls.matrix(K), balls.matrix(R)
        M, _, _, _, J = self._dynamics(s.q, s.u)
        C, D = J[: self.r_h], J[self.r_h :]
        D_q = balls.matrix(self.system.linearize(s.q, s.u, s.a, self._all_nu(s.nu), self.time)[2])
        D_q = [D_q[i - self.system.n_h] for i in self.rows[self.r_h :]]
        K = balls.plus(K, balls.times(R, s.slope), balls.times(M, s.second))
        R = balls.plus(R, [[2 * x for x in row] for row in balls.times(M, s.slope)])
        D_q = balls.plus(D_q, balls.times(D, s.slope)) if D else []
        blocks = [C, K, D_q]
        scale = self.rough.motion.spaces.scale.tolist()
        row_scale = [float(self.rough.motion.spaces.row_scale[i]) for i in self.rows]
        pivots, T = balls.eliminate(C, self.r_h, n, row_scale[: self.r_h], scale)
        free, N = balls.null_space(pivots, T, n)
        m = len(free)
        W, W_q = balls.times(D, N), balls.times(D_q, N)
        pivots, T = balls.eliminate(
            [a + b for a, b in zip(W, W_q, strict=True)], self.r_n, m, row_scale[self.r_h :], [scale[j] for j in free]
        )
        moving, Z = balls.null_space(pivots, T, m)
        P = balls.zeros(m, m)
        for i, j in pivots:
            P[j] = [-x for x in T[i][m:]]
        N_t, Z_t = balls.transposed(N, m), balls.transposed(Z, len(moving))
        M, R, K = (balls.times(N_t, balls.times(x, N)) if m else [] for x in (M, R, K))
        k = len(moving)
        S = balls.zeros(m + k, m + k)
        for i in range(m):
            S[i] = P[i] + Z[i]
        if k:
            inertia = balls.plus(balls.times(M, P), R)
            lower = balls.times(Z_t, balls.plus(balls.times(inertia, P), K))
            right = balls.times(Z_t, balls.times(inertia, Z))
            M_z = balls.times(Z_t, balls.times(M, Z))
            solved = balls.solve(M_z, [a + b for a, b in zip(lower, right, strict=True)])
            for i in range(k):
                S[m + i] = [-x for x in solved[i]]
        return self._split(S, free, moving, blocks)

    # --- structure --------------------------------------------------------------------------------------------------

    def _split(self, S: Matrix, free: list[int], moving: list[int], blocks: list[Matrix]) -> Spectrum:
        """Divide the symmetries out, then split along exact zeros."""
        zeros: list[str] = []
        alive = list(range(len(S)))
        kept = [row[:] for row in S]

        divided: list[tuple[int, dict[int, Ball]]] = []

        def seen(v: dict[int, Ball]) -> dict[int, Ball]:
            """Return a vector in the quotient by those before it."""
            for pivot, other in divided:
                part = v.pop(pivot, ball(0))
                if not part.is_zero():
                    for i, x in other.items():
                        if i != pivot:
                            v[i] = v.get(i, ball(0)) - part / other[pivot] * x
            return {i: x for i, x in v.items() if not x.is_zero()}

        def divide(v: dict[int, Ball]) -> None:
            """Go over to the quotient by a null vector."""
            pivot = max((i for i in v if not zero_inside(v[i])), key=lambda i: abs(float(v[i].mid())))
            for i, x in v.items():
                if i != pivot and not x.is_zero():
                    ratio = x / v[pivot]
                    for j in alive:
                        if not kept[pivot][j].is_zero():
                            kept[i][j] = kept[i][j] - ratio * kept[pivot][j]
            alive.remove(pivot)
            divided.append((pivot, v))

        # Constant shifts of the coordinates on which nothing depends: exact zeros.
        for name, w in self._shifts():
            if all(x.is_zero() for block in blocks for x in balls.apply(block, w)):
                v = seen({k: w[j] for k, j in enumerate(free)})
                if any(not zero_inside(x) for x in v.values()):
                    divide(v)
                    zeros.append(name)
        for name, w, change, proven in self._turns():
            v = {k: w[j] for k, j in enumerate(free)}
            v |= {len(free) + k: change[free[j]] for k, j in enumerate(moving)}
            v = seen(v)
            if all(zero_inside(x) for x in v.values()):
                continue
            image = [sum((kept[i][j] * x for j, x in v.items()), ball(0)) for i in alive]
            if not all(zero_inside(x) for x in image):
                continue
            if not proven and not any("rotation" in x.name for x in self.known()):
                continue
            divide(v)
            zeros.append(name)
            if not proven:
                self.assumed.append(f"{name} is a symmetry (checked in double precision)")
        factors: list[Factor] = []
        uneven: list[list[Ball]] = []
        for component in _components(kept, alive):
            block = [[kept[i][j] for j in component] for i in component]
            if len(block) == 1 and block[0][0].is_zero():
                zeros.append(self._state_name(component[0], free, moving))
                continue
            sides = _two_kinds(block)
            if sides is None:
                uneven.append(balls.characteristic(block))
                continue
            small, large = sorted(sides, key=len)
            zeros += ["the motion is reversible"] * (len(large) - len(small))
            A = [[block[i][j] for j in large] for i in small]
            B = [[block[i][j] for j in small] for i in large]
            if len(block) <= balls.SMALL:
                even = balls.characteristic(block)[len(large) - len(small) :: 2]
            else:
                even = balls.characteristic(balls.times(A, B))
            factors.append(Factor(even, True, "the motion is reversible"))
        if uneven and self._conservative():
            whole = [ball(1)]
            for p in uneven:
                whole = balls.product(whole, p)
            if len(whole) % 2 == 1:
                why = "there is neither damping nor a nonholonomic row"
                factors.append(Factor(whole[::2], True, why))
                uneven = []
        factors += [Factor(p, False) for p in uneven]
        for k, factor in enumerate(factors):
            p = factor.p
            while len(p) > 1 and p[0].is_zero():
                zeros += ["no constant in the characteristic polynomial"] * (2 if factor.even else 1)
                p = p[1:]
            factors[k] = replace(factor, p=p)
        factors = [factor for factor in factors if len(factor.p) > 1]
        return Spectrum(zeros, factors, tuple(dict.fromkeys(self.assumed)))

    def _state_name(self, i: int, free: list[int], moving: list[int]) -> str:
        j = free[i] if i < len(free) else free[moving[i - len(free)]]
        return f"nothing drives {'' if i < len(free) else 'the rate of '}{self.system.names[j]}"

    def _shifts(self) -> Iterator[tuple[str, list[Ball]]]:
        names = self.system.names
        for axis in "xyz":
            w = [ball(int(name.endswith(f".{axis}"))) for name in names]
            if any(not x.is_zero() for x in w):
                yield f"translation along {axis}", w
        for i, name in enumerate(names):
            yield name, [ball(int(i == j)) for j in range(len(names))]

    def _turns(self) -> Iterator[tuple[str, list[Ball], list[Ball], bool]]:
        """Yield symmetries that are no constant shifts: name, direction w, ẇ in the frame, and whether it is proven."""
        s, scene = self.state, self.system.scene
        d, zero = scene.dimension, [ball(0)] * 3
        still = [ball(0)] * self.system.n_q
        if not s.field.rate.is_zero():
            yield "the motion itself", s.u, still, True
        axes: list[list[Ball]] = []
        if d == 2:
            axes = [[ball(0), ball(0), ball(1)]] if all(ball(x).is_zero() for x in scene.gravity) else []
        else:
            units = [[ball(int(i == k)) for i in range(3)] for k in range(3)]
            axes = [
                e for k, e in enumerate(units) if all(ball(x).is_zero() for i, x in enumerate(scene.gravity) if i != k)
            ]
        for axis in axes:
            turn = _Field(self.system, axis, zero, ball(1), zero, still)
            try:
                w, slope, _ = turn.at(s.q)
            except (ArithmeticError, ValueError):
                continue
            change = [x - y for x, y in zip(balls.apply(slope, s.u), balls.apply(s.slope, w), strict=True)]
            letter = "xyz"[next(k for k in range(3) if not axis[k].is_zero())]
            yield f"rotation about {letter}", w, change, self._turns_with(axis)

    def known(self) -> list[Any]:
        """Return the symmetries of the scene, checked in double precision."""
        if self._symmetries is None:
            self._symmetries = symmetries(self.rough.system, self.rough.motion)
        return self._symmetries

    def _turns_with(self, axis: list[Ball]) -> bool:
        """Whether every element of the scene is known to turn along with everything about an axis."""
        for element in self.system._elements:
            name = element.kernel.__name__.rpartition(".")[2] if hasattr(element.kernel, "__name__") else "user"
            kind = name.partition("_")[2]
            if kind in ("body", "body_offset", "point"):
                continue  # gravity is along the axis
            if self.system.scene.dimension == 2:
                return False
            if kind in RELATIVE and all(
                element.columns[k] < self.system.n_q for k in range(0, len(element.columns), 6)
            ):
                continue
            at = NORMALS.get(kind.partition("_")[0])
            if at is None:
                return False
            normal = element.parameters[9 + at : 12 + at]
            if not all(x.is_zero() for x, e in zip(normal, axis, strict=True) if e.is_zero()):
                return False
        return True

    def _conservative(self) -> bool:
        """Whether the equations are those of Lagrange without damping, with holonomic constraints."""
        if self.system.n_n:
            return False
        for element in self.system._elements:
            name = element.kernel.__name__.rpartition(".")[2] if hasattr(element.kernel, "__name__") else "user"
            kind = name.partition("_")[2]
            if kind.endswith("spring") and kind != "ideal_spring" and not element.parameters[-1].is_zero():
                return False
            if not (element.rows or kind.endswith("spring") or kind in ("body", "body_offset", "point")):
                return False
        return True


def _arb(middle: Any, radius: Any) -> Any:
    from flint import arb

    return arb(middle, radius)


def _coefficients(part: System, q: list[Ball], s: _State, nu: list[Ball], time: Ball) -> list[Ball]:
    """Return all that a part of a scene adds to the equations and their linearization, in one list."""
    state = part.dynamics(q, s.u, time)
    found = [state.M, state.F0, state.V, state.J, state.B, *part.linearize(q, s.u, s.a, nu, time)]
    return [ball(x) for block in found for x in np.ravel(block)]


def _independent(A: Any, rank: int) -> list[int]:
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
    """Return balls that contain one and only one zero of as many equations as unknowns.

    With an approximate inverse Y and x near the zero, x − Y f(x) + (1 − Y f'(X))(X − x) inside X
    proves it (Krawczyk 1969).

    Raises
    ------
    NotProvable
        If that is not reached.
    """
    from flint import arb, ctx

    if not start:
        return []
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
            return [y + z for y, z in zip(x, moved, strict=True)]
        reach = [2 * max(balls.real(abs(z)).abs_upper(), r, key=float) for z, r in zip(moved, reach, strict=True)]
    raise NotProvable(f"{what} is not proven to exist: the operator of Krawczyk does not contract")


def _components(S: Matrix, alive: list[int]) -> list[list[int]]:
    """Return the strongly connected components of the graph of entries that are not exact zeros (Tarjan 1972)."""
    following = {i: [j for j in alive if j != i and not S[i][j].is_zero()] for i in alive}
    reach: dict[int, set[int]] = {}
    for i in alive:
        seen, stack = {i}, [i]
        while stack:
            for j in following[stack.pop()]:
                if j not in seen:
                    seen.add(j)
                    stack.append(j)
        reach[i] = seen
    found: list[list[int]] = []
    for i in alive:
        if not any(i in component for component in found):
            found.append([j for j in alive if j in reach[i] and i in reach[j]])
    return found


def _two_kinds(block: Matrix) -> tuple[list[int], list[int]] | None:
    """Return two groups of states such that each drives only the other, or None."""
    n = len(block)
    color = [-1] * n
    color[0] = 0
    stack = [0]
    while stack:
        i = stack.pop()
        for j in range(n):
            if block[i][j].is_zero() and block[j][i].is_zero():
                continue
            if color[j] < 0:
                color[j] = 1 - color[i]
                stack.append(j)
            elif color[j] == color[i]:
                return None
    return [i for i in range(n) if color[i] == 0], [i for i in range(n) if color[i] == 1]


# --- verdicts -------------------------------------------------------------------------------------------------------

VERDICTS = ("asymptotically stable", "marginally stable", "unstable")


def certify(
    model: Model,
    settings: Mapping[str, str | float] | None = None,
    digits: int = 50,
    progress: Callable[[float], object] = lambda done: None,
) -> Certificate:
    """Return enclosures of all eigenvalues and a verdict that is proven, or why there is none.

    Parameters
    ----------
    model : Model
    settings : mapping
        Values of parameters: numbers or texts as for ``--set``, one of them also an interval such
        as ``[5.6, 10]``. Texts are exact decimals.
    digits : int
        Decimal digits; twice and four times as many where a verdict is open.
    progress : callable
        Is called with the part of an interval that is decided, from 0 to 1.

    Raises
    ------
    UsageError
        If python-flint is missing, a parameter is unknown, or more than one is an interval.
    MbstabError
        As `mbstab.analysis.reference.reference_motion`.
    """
    balls.require_flint()
    if not 10 <= digits <= 10_000:
        raise UsageError(f"--precision {digits}: give a number from 10 to 10000")
    texts = {name: value.strip() if isinstance(value, str) else repr(value) for name, value in (settings or {}).items()}
    wide = [name for name, text in texts.items() if text.startswith("[")]
    if len(wide) > 1:
        raise UsageError(
            f"{' and '.join(wide)} are intervals\nhint: one parameter may be an interval, the others numbers"
        )
    result = None
    for more in MORE_DIGITS:
        with balls.digits(more * digits):
            ends = {name: balls.interval(model, name, text) for name, text in texts.items()}
            if wide:
                return _over(model, ends, wide[0], digits, progress)
            result = _at(model, {name: low for name, (low, _) in ends.items()}, more * digits)
        if result.proven:
            break
    assert result is not None
    return result


def _refused(reason: str, digits: int) -> Certificate:
    return Certificate("not provable", f"not provable with {digits} digits: {reason}", [], (), (reason,), digits)


def _at(model: Model, overrides: Mapping[str, Ball], digits: int) -> Certificate:
    """Return what is proven at one point."""
    try:
        proof = _Proof(model, overrides)
        spectrum = proof.factors()
    except NotProvable as error:
        return _refused(str(error), digits)
    found = [_zeros(spectrum)] if spectrum.zeros else []
    for factor in spectrum.factors:
        found += _enclosed(factor)
    found.sort(key=lambda e: (e.kind == "zero", -float(e.real.mid()), abs(float(e.imag.mid())), -float(e.imag.mid())))
    verdict, reasons = _judged(found, proof)
    statement = _sentence(verdict, found) if not reasons else f"not provable with {digits} digits: {reasons[0]}"
    return Certificate(verdict, statement, found, spectrum.assumed, tuple(reasons), digits)


def _zeros(spectrum: Spectrum) -> Enclosure:
    why = ", ".join(
        f"{name} ({counted(count, 'time')})" if count > 1 else name
        for name, count in ((x, spectrum.zeros.count(x)) for x in dict.fromkeys(spectrum.zeros))
    )
    return Enclosure(real(ball(0)), real(ball(0)), len(spectrum.zeros), "zero", why)


def _enclosed(factor: Factor) -> list[Enclosure]:
    """Return enclosures of the roots of a factor."""
    from flint import acb, arb

    zero = arb(0)
    found = []
    for centre, radius, count in balls.root_discs(factor.p):
        x = centre.real + arb(0, radius)
        y = centre.imag + arb(0, radius)
        # The roots of a real polynomial come in pairs: one alone in a disc about a real centre is real.
        if count == 1 and centre.imag == 0:
            y = zero
        if not factor.even:
            kind = "left" if x < 0 else "right" if x > 0 else "open"
            found.append(Enclosure(x, y, count, kind))
        elif y.is_zero() and x < 0:
            root = (-x).sqrt()
            found += [Enclosure(zero, sign * root, 1, "imaginary", factor.why) for sign in (1, -1)]
        elif y.is_zero() and x > 0:
            root = x.sqrt()
            found += [Enclosure(sign * root, zero, 1, "right" if sign > 0 else "left") for sign in (1, -1)]
        elif not (x.is_finite() and y.is_finite()):
            found.append(Enclosure(x, y, 2 * count, "open"))
        elif zero_inside(x) and zero_inside(y):
            size = (abs(x) + abs(y)).sqrt().abs_upper()
            found.append(Enclosure(arb(0, size), arb(0, size), 2 * count, "open"))
        else:
            # Away from zero, and from the cut of the root, which is turned out of the way.
            turned = x < 0 or not x > 0
            s = acb(-x, -y).sqrt() * acb(0, 1) if turned else acb(x, y).sqrt()
            for sign in (1, -1):
                part = sign * s.real
                kind = "right" if part > 0 else "left" if part < 0 else "open"
                found.append(Enclosure(part, sign * s.imag, count, kind))
    return found


def _judged(found: list[Enclosure], proof: _Proof) -> tuple[str, list[str]]:
    """Return the verdict, and why there is none."""
    if any(e.kind == "right" for e in found):
        return "unstable", []
    reasons = []
    if not found:
        reasons.append("constraints and drives leave no motion free whose stability could be judged")
    for e in found:
        if e.kind == "open" and float(e.imag.mid()) >= 0.0:
            size = f"{counted(e.count, 'eigenvalue lies', 'eigenvalues lie')}"
            reasons.append(
                f"{size} in a disc about {_short(e.real)} + {_short(e.imag)}i that reaches over the imaginary axis "
                f"(radius {e.radius:.0e}): neutral, double or critical"
            )
    zeros = sum(e.count for e in found if e.kind == "zero")
    if zeros and zeros > 2 * len(proof.known()):
        reasons.append(
            f"{counted(zeros, 'eigenvalue is', 'eigenvalues are')} zero, more than symmetries explain: a critical "
            "state or a continuum of equilibria, which the linearized equations cannot judge"
        )
    if reasons:
        return "not provable", reasons
    on_axis = any(e.kind in ("zero", "imaginary") for e in found)
    return "marginally stable" if on_axis else "asymptotically stable", []


def _short(x: Ball) -> str:
    return f"{float(x.mid()):.6g}"


def _sentence(verdict: str, found: list[Enclosure]) -> str:
    """Return what is proven in words."""
    counts = {
        kind: sum(e.count for e in found if e.kind == kind) for kind in ("left", "right", "imaginary", "zero", "open")
    }
    words = {
        "right": "to the right of the imaginary axis",
        "left": "to the left of the imaginary axis",
        "imaginary": "exactly on it" if counts["left"] or counts["right"] else "exactly on the imaginary axis",
        "zero": "exactly zero",
        "open": "not told from the axis",
    }
    parts = [f"{counted(counts[kind], 'eigenvalue')} {words[kind]}" for kind in words if counts[kind]]
    return f"proven {verdict}: {', '.join(parts)}"


# --- intervals of a parameter ---------------------------------------------------------------------------------------


def _over(
    model: Model, ends: Mapping[str, tuple[Ball, Ball]], name: str, digits: int, progress: Callable[[float], object]
) -> Certificate:
    """Return what is proven for all values of a parameter in an interval, by bisection."""
    low, high = _fraction(ends[name][0], False), _fraction(ends[name][1], True)
    others = {key: value[0] for key, value in ends.items() if key != name}
    least = (high - low) * Fraction(WIDTH)
    stack, boxes = [(low, high)], 0
    parts: list[Part] = []
    assumed: list[str] = []
    reasons: dict[Fraction, str] = {}
    checked: dict[Fraction, str] = {}

    def wrong(x: Fraction) -> str:
        """Return what is wrong with the reference at a value of the parameter."""
        if x not in checked:
            try:
                _Proof(model, {**others, name: ball(x)})
                checked[x] = ""
            except MbstabError as error:
                checked[x] = str(error).partition("\n")[0]
        return checked[x]

    while stack:
        a, b = stack.pop()
        boxes += 1
        box = balls.between(ball(a), ball(b))
        verdict, reason, notes = _verdict_over(model, {**others, name: box})
        if verdict != "not provable" and (bad := wrong(a) or wrong(b)):
            verdict, reason = "not provable", bad
        if verdict == "not provable" and b - a > least and boxes < BOXES:
            middle = (a + b) / 2
            stack += [(middle, b), (a, middle)]
            continue
        if reason:
            reasons[a] = reason
        assumed += [x for x in notes if x not in assumed]
        if parts and parts[-1].verdict == verdict:
            parts[-1] = replace(parts[-1], high=b)
        else:
            parts.append(Part(a, b, verdict))
        progress(float((b - low) / (high - low)))
    verdicts = {part.verdict for part in parts}
    factor = balls.exact_factor(model.parameters[name])
    unit = model.parameters[name].unit
    text = f"{name} in [{_decimal(ball(low) / factor)}, {_decimal(ball(high) / factor)}] {unit}".rstrip()
    if len(verdicts) == 1 and verdicts != {"not provable"}:
        (verdict,) = verdicts
        return Certificate(
            verdict, f"proven {verdict} for every {text}", [], tuple(assumed), (), digits, name, tuple(parts)
        )
    open_ = [part for part in parts if part.verdict == "not provable"]
    why = []
    if len(verdicts - {"not provable"}) > 1:
        why.append(f"the verdict is not the same for every {text}")
    elif len(verdicts) > 1:
        why.append(f"a part of {text} is open")
    for part in open_:
        shown = f"[{_decimal(ball(part.low) / factor, 12)}, {_decimal(ball(part.high) / factor, 12)}]"
        width = float(part.high - part.low)
        why.append(f"open in {shown}, width {width:.1e} (SI): {reasons.get(part.low, 'too many parts')}")
    statement = f"not provable with {digits} digits: {why[0]}"
    return Certificate("not provable", statement, [], tuple(assumed), tuple(why), digits, name, tuple(parts))


def _verdict_over(model: Model, overrides: Mapping[str, Ball]) -> tuple[str, str, tuple[str, ...]]:
    """Return the verdict for all parameters in balls, why there is none, and what is assumed."""
    try:
        proof = _Proof(model, overrides)
        spectrum = proof.factors()
    except MbstabError as error:
        return "not provable", str(error).partition("\n")[0], ()
    verdict = "marginally stable" if spectrum.zeros else "asymptotically stable"
    open_ = ""
    for factor in spectrum.factors:
        if factor.even:
            inside = balls.all_negative_and_simple(factor.p)
            right = None if inside is None else int(not inside)
            verdict = "marginally stable"
        else:
            right = balls.right_roots(factor.p)
        if right is None:
            kinds = {e.kind for e in _enclosed(factor)}
            right = 1 if "right" in kinds else None if "open" in kinds else 0
        if right:
            return "unstable", "", spectrum.assumed
        if right is None:
            open_ = open_ or "an eigenvalue may be on the imaginary axis, or two may meet on it"
    if spectrum.zeros and len(spectrum.zeros) > 2 * len(proof.known()):
        open_ = open_ or "more eigenvalues are zero than symmetries explain"
    if not spectrum.factors and not spectrum.zeros:
        open_ = "constraints and drives leave no motion free whose stability could be judged"
    return ("not provable", open_, ()) if open_ else (verdict, "", spectrum.assumed)


def _fraction(x: Ball, up: bool) -> Fraction:
    """Return a number as a fraction, rounded outwards if it is none."""
    exact = balls.fraction(x)
    if exact is not None:
        return exact
    bound = real(x).upper() if up else real(x).lower()
    mantissa, exponent = (int(part) for part in bound.mid().man_exp())
    slack = Fraction(1, 10**30)
    return Fraction(mantissa) * Fraction(2) ** exponent + (slack if up else -slack)


def _decimal(x: Ball, places: int = 6) -> str:
    return f"{float(x):.{places}g}"


# --- critical values ------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Critical:
    """An interval of a parameter (SI) that contains a critical value for certain.

    Attributes
    ----------
    low, high : Fraction
    test : str
        Which function changes its sign: ``divergence`` (the product of eigenvalues), ``flutter``
        (the last but one Hurwitz determinant) or ``collision`` (the discriminant of the
        polynomial in s²).
    digits : int
    """

    low: Fraction
    high: Fraction
    test: str
    digits: int

    @property
    def value(self) -> Any:
        """Return the enclosure as ``flint.arb``."""
        return balls.between(ball(self.low), ball(self.high))

    def text(self) -> str:
        """Return the digits of the critical value that are proven."""
        with balls.digits(self.digits):
            return str(self.value.str(self.digits + 2))


def certified_critical(
    model: Model,
    parameter: str,
    low: str | float,
    high: str | float,
    digits: int = 30,
    settings: Mapping[str, str | float] | None = None,
) -> Critical:
    """Return an enclosure of a value at which a test function of stability is zero.

    Between the ends of the enclosure the function changes its sign and is continuous, as the
    elimination is proven to go through for all values in it.

    Parameters
    ----------
    parameter : str
    low, high : str or float
        In the unit of the parameter; the functions must have opposite signs there.
    digits : int
        Correct digits of the enclosure.

    Raises
    ------
    NotProvable
        If no function changes its sign.
    UsageError
        If python-flint is missing or a parameter is unknown.
    """
    balls.require_flint()
    bits = int(3.33 * digits) + 8
    with balls.digits(digits + 30):
        values = {
            key: balls.interval(model, key, text if isinstance(text, str) else repr(text))[0]
            for key, text in {**(settings or {}), "": ""}.items()
            if key
        }
        ends = [
            _fraction(balls.interval(model, parameter, x if isinstance(x, str) else repr(x))[0], up)
            for x, up in ((low, False), (high, True))
        ]

        def tests(x: Any) -> list[tuple[str, Ball]]:
            return _tests(_Proof(model, {**values, parameter: ball(x)}).factors())

        first, last = (tests(x) for x in ends)
        if [name for name, _ in first] != [name for name, _ in last]:
            raise NotProvable(f"the equations have not the same structure at both ends of {parameter}")
        k = next((k for k, (x, y) in enumerate(zip(first, last, strict=True)) if _opposite(x[1], y[1])), None)
        if k is None:
            raise NotProvable(f"no test function changes its sign between both ends of {parameter}")
        a, b, f_a, f_b = *ends, first[k][1], last[k][1]
        small = max(abs(a), abs(b)) / Fraction(2) ** bits
        side = 0
        for _ in range(40 * digits):
            if b - a <= small:
                break
            weight = _fraction(real(f_a / (f_a - f_b)).mid(), True)
            # Next to the better end, but not nearer than what is asked for.
            x = a + (b - a) * min(max(weight, Fraction(0)), Fraction(1))
            x = min(max(x, a + small / 3), b - small / 3)
            x = Fraction(round(x / small * 2**12), 2**12) * small
            f_x = tests(x)[k][1]
            if zero_inside(f_x):
                x += small / 4
                f_x = tests(x)[k][1]
            if zero_inside(f_x):
                raise NotProvable(f"the sign of the test function next to {_decimal(ball(x), 12)} is open")
            if _opposite(f_a, f_x):
                b, f_b = x, f_x
                f_a = f_a / 2 if side == 1 else f_a  # the Illinois rule
                side = 1
            else:
                a, f_a = x, f_x
                f_b = f_b / 2 if side == -1 else f_b
                side = -1
        tests(balls.between(ball(a), ball(b)))
        return Critical(a, b, first[k][0], digits)


def _opposite(x: Ball, y: Ball) -> bool:
    return bool((x > 0 and y < 0) or (x < 0 and y > 0))


def _tests(spectrum: Spectrum) -> list[tuple[str, Ball]]:
    """Return functions of the coefficients that are zero where stability changes."""
    found = []
    for factor in spectrum.factors:
        p, n = factor.p, len(factor.p) - 1
        found.append(("divergence", p[0]))
        if factor.even and n > 1:
            slope = [k * x for k, x in enumerate(p)][1:]
            found.append(("collision", balls.resultant(p, slope)))
        elif not factor.even and n > 1:
            hurwitz = [
                [p[n - 1 - 2 * j + i] if 0 <= n - 1 - 2 * j + i <= n else ball(0) for j in range(n - 1)]
                for i in range(n - 1)
            ]
            found.append(("flutter", balls.determinant(hurwitz)))
    return found
