"""The linearized equations of a scene in balls, and the factors of their characteristic polynomial.

The constraints are eliminated by pivots that are proven to be nonzero, and the resulting ẏ = S y
contains the linearized equations for all values of the parameters in their balls. S is taken modulo the directions of
symmetries and families, restricted to given values of conserved functions, and split along its exact zeros, as
`mbstab.analysis.proof.certify` says.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import replace
from fractions import Fraction
from functools import cached_property
from typing import NamedTuple

import numpy as np

from mbstab.analysis.algebra import ball_matrices, ball_polynomials
from mbstab.analysis.algebra.balls import Matrix, NotProvable
from mbstab.analysis.algebra.deflation import in_frame, on_speeds, restricted
from mbstab.analysis.algebra.matching import reached, together
from mbstab.analysis.algebra.tolerances import TOLERANCES as ALGEBRA
from mbstab.analysis.proof.analytic import require_analytic
from mbstab.analysis.proof.enclosures import Reference
from mbstab.analysis.proof.identities import Identities
from mbstab.analysis.proof.motion import BallGenerator, generator_in_balls, steady_state
from mbstab.model import balls
from mbstab.model.balls import Ball, ball, real, zero_inside
from mbstab.model.schema import Model
from mbstab.records import dataclass

GENERIC = Fraction(38197, 100000)
"""Generic position of a value in the interval of a parameter, at which structure is looked for."""


@dataclass(frozen=True)
class Enclosure:
    """One eigenvalue, or several that are not separated.

    Attributes
    ----------
    real, imag : ball (1/s)
        ``flint.arb``; an exact zero has no radius.
    count : int
        Number of eigenvalues inside.
    kind : str
        ``left``, ``right``, ``imaginary`` (on the axis), ``zero`` or ``carried`` (zero, or ±iΩ of a turning frame, by
        symmetries and families of motions), or ``open``; all but the last proven.
    why : str
        What keeps it on the axis, or what an unexplained zero eigenvalue belongs to.
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
        """Whether the radius is not zero."""
        return not (self.real.is_exact() and self.imag.is_exact())

    def contains(self, s: complex, slack: float = 0.0) -> bool:
        """Whether a number lies inside, or not further outside than `slack` (1/s)."""
        from flint import arb

        gap = arb(0, slack)
        return bool((self.real + gap).contains(arb(s.real)) and (self.imag + gap).contains(arb(s.imag)))


@dataclass(frozen=True)
class Factor:
    """A factor of the characteristic polynomial, monic, the constant first; `even`: a polynomial in σ = s².

    Attributes
    ----------
    states : frozenset of int
        States it belongs to; factors are apart if their states do not act on each other.
    """

    p: list[Ball]
    even: bool
    why: str = ""
    states: frozenset[int] = frozenset()


@dataclass(frozen=True)
class Spectrum:
    """The characteristic polynomial of the eigenvalues left to judge: exact zeros, by their states, and factors.

    Attributes
    ----------
    reach : mapping
        States on which each state acts, directly or through others.
    """

    zeros: list[str]
    factors: list[Factor]
    reach: Mapping[int, frozenset[int]]

    def apart(self, one: Factor, other: Factor) -> bool:
        """Whether two factors belong to states that do not act on each other."""
        return bool(one.states and other.states) and not any(
            self.reach[i] & y for x, y in ((one.states, other.states), (other.states, one.states)) for i in x
        )


class Reduced(NamedTuple):
    """The linearized equations in the co-moving frame, before and after elimination of the constraints.

    Attributes
    ----------
    M, R : matrix, shape (n_q, n_q)
    N : matrix, shape (n_q, m)
        Basis of the null space of the holonomic rows: the identity in the `free` coordinates.
    M_N, K_N : matrix, shape (m, m)
        Nᵀ M N and Nᵀ K N.
    P : matrix, shape (m, m)
    Z : matrix, shape (m, k)
        ξ̇ = P ξ + Z η; the identity in the `moving` ones among the free coordinates.
    S : matrix, shape (m + k, m + k)
        ẏ = S y for y = [ξ; η].
    free, moving : list of int
    """

    M: Matrix
    R: Matrix
    N: Matrix
    M_N: Matrix
    K_N: Matrix
    P: Matrix
    Z: Matrix
    S: Matrix
    free: list[int]
    moving: list[int]


class Proof(Reference):
    """The linearized equations about a reference motion in balls.

    Parameters
    ----------
    model, overrides, near
        As `mbstab.analysis.proof.enclosures.Reference`.
    identities : Identities, optional
        What is proven about the elements of the same model at other values of the parameters.
    """

    def __init__(
        self,
        model: Model,
        overrides: Mapping[str, Ball],
        near: Reference | None = None,
        identities: Identities | None = None,
    ) -> None:
        self._identities = identities
        proven = ("structural", "enclosed")
        super().__init__(model, overrides, near, identities is not None and identities.steady() in proven)

    @cached_property
    def identities(self) -> Identities:
        """What is proven about the elements; where a parameter is an interval, at a value inside."""
        if self._identities is not None:
            return self._identities
        if not self.wide:
            return Identities(self, self.grounds)
        require_analytic(self.model, self.overrides)
        inside = {name: balls.at_part(x, GENERIC) for name, x in self.overrides.items()}
        return Proof(self.model, inside, self if self.solutions else None).identities

    # --- elimination ------------------------------------------------------------------------------------------------

    @cached_property
    def reduced(self) -> Reduced:
        """The linearized equations without the constraints."""
        s, n = self.state, self.system.n_q
        K, R, D_q = (
            ball_matrices.matrix(x) for x in self.system.linearize(s.q, s.u, s.a, self.all_multipliers(s.nu), self.time)
        )
        M, _, _, _, J = self.dynamics(s.q, s.u)
        C, D = J[: self.r_h], J[self.r_h :]
        D_q = D_q[[i - self.system.n_h for i in self.rows[self.r_h :]]]
        R, K, D_q = in_frame(M, R, K, D, D_q, s.slope, s.second, ball_matrices.BALLS)
        scale = self.rough.motion.spaces.scale.tolist()
        row_scale = [float(self.rough.motion.spaces.row_scale[i]) for i in self.rows]
        scale_h, scale_n = row_scale[: self.r_h], row_scale[self.r_h :]
        # The balance of forces on what carries no mass is a row as well: on positions, or on speeds if it is damped.
        for direction, damped in self._light(M, R, C, D, scale_h):
            balance, rates = ball_matrices.times(direction, K), ball_matrices.times(direction, R)
            row = rates if damped else balance
            (scale_n if damped else scale_h).append(_row_scale(row, scale))
            C, D = (C, np.vstack([D, row])) if damped else (np.vstack([C, row]), D)
            D_q = np.vstack([D_q, balance]) if damped else D_q
        pivots, T = ball_matrices.eliminate(C, len(C), n, scale_h, scale)
        free, N = ball_matrices.null_space(pivots, T, n)
        m = len(free)
        W, W_q = ball_matrices.times(D, N), ball_matrices.times(D_q, N)
        pivots, T = ball_matrices.eliminate(np.hstack([W, W_q]), len(D), m, scale_n, [scale[j] for j in free])
        moving, Z = ball_matrices.null_space(pivots, T, m)
        P = ball_matrices.zeros(m, m)
        for i, j in pivots:
            P[j] = -T[i, m:]
        M_N, R_N, K_N = restricted(M, R, K, N, ball_matrices.BALLS)
        S = _state_matrix(M_N, R_N, K_N, P, Z, len(moving))
        return Reduced(M, R, N, M_N, K_N, P, Z, S, free, moving)

    def _light(
        self, M: Matrix, R: Matrix, C: Matrix, D: Matrix, row_scale: Sequence[float]
    ) -> list[tuple[Matrix, bool]]:
        """Return directions that holonomic rows C allow and that carry no mass, and whether a force there is damped.

        Raises
        ------
        NotProvable
            If the motions without mass are others, or not proven to be without mass and damping.
        """
        light = self.rough.linear.massless
        if light is None:
            return []
        scale, n = self.rough.motion.spaces.scale.tolist(), self.system.n_q
        pivots, T = ball_matrices.eliminate(C, len(C), n, list(row_scale), scale)
        directions = ball_matrices.null_space(pivots, T, n)[1].T
        found = []
        for d in directions:
            if all(x.is_zero() for A in (M, M.T, D) for x in ball_matrices.times(A, d)):
                found.append((d, any(not x.is_zero() for A in (R, R.T) for x in ball_matrices.times(A, d))))
        known = (len(light.first_order), len(light.algebraic))
        counted = sum(damped for _, damped in found)
        if not self.rough.motion.at_rest or known != (counted, len(found) - counted):
            raise NotProvable(
                "motions without mass are proven about a rest, where they are in no row on speeds and constraints tie "
                "them to no mass; here one of them is not, or moves along with others"
            )
        return found

    def column(self, direction: Matrix, rate: Matrix) -> Matrix:
        """Return an admissible disturbance (Δq, Δu) in the coordinates of S."""
        r = self.reduced
        slide = rate - ball_matrices.times(self.state.slope, direction)
        return np.concatenate([direction[r.free], slide[r.free][r.moving]])

    def differential(self, direction: Matrix, rate: Matrix) -> Matrix:
        """Return the differential of the momentum along a symmetry, as `neutral.Structure.differential`."""
        r, times = self.reduced, ball_matrices.times
        carried = rate - times(self.state.slope, direction)
        speeds, forces, frame = times(direction, r.M, r.N), times(direction, r.R, r.N), times(carried, r.M, r.N)
        return np.concatenate([forces - frame + times(speeds, r.P), times(speeds, r.Z)])

    def seen_from(self, step: BallGenerator, rate: Ball) -> Proof:
        """Return the same in a frame that also rotates at a rate, by a turn that does not move the reference."""
        own = self.state.field
        spins = own.spins + rate * step.spins
        field = generator_in_balls(self.system, step.axis, step.point, own.rate + rate, own.velocity, spins)
        seen = steady_state(field, self.state.q)
        other = copy(self)
        vars(other).pop("reduced", None)
        other.state = self.state._replace(slope=seen.slope, second=seen.second, field=field)
        return other

    def dynamic_rows(self) -> Matrix:
        """Return the rows on speeds that are not rates of rows on positions."""
        return self.dynamics(self.state.q, self.state.u)[4][self.r_h :]

    def name_of(self, i: int) -> str:
        """Return what a state stands for."""
        free, moving = self.reduced.free, self.reduced.moving
        j = free[i] if i < len(free) else free[moving[i - len(free)]]
        return f"{'' if i < len(free) else 'the rate of '}{self.system.names[j]}"


def _row_scale(row: Matrix, scale: Sequence[float]) -> float:
    """Return the reciprocal of the length of a row in scaled coordinates."""
    length = float(np.linalg.norm(row.astype(float) * scale))
    return 1.0 / length if length else 1.0


def _state_matrix(M: Matrix, R: Matrix, K: Matrix, P: Matrix, Z: Matrix, k: int) -> Matrix:
    """Return S of ẏ = S y for matrices from which the holonomic rows are eliminated."""
    S = np.vstack([np.hstack([P, Z]), ball_matrices.zeros(k, len(P) + k)])
    if k:
        M_z, K_z, R_z = on_speeds(M, R, K, Z, P, ball_matrices.BALLS)
        S[len(P) :] = -ball_matrices.solve(M_z, np.hstack([K_z, R_z]))
    return S


class Quotient:
    """A matrix modulo an invariant subspace, restricted to given values of conserved functions.

    Parameters
    ----------
    S : matrix

    Attributes
    ----------
    kept : matrix
    alive : list of int
        Rows and columns of `kept` that remain.
    """

    def __init__(self, S: Matrix) -> None:
        self.kept, self.alive = S.copy(), list(range(len(S)))
        self._divided: list[tuple[int, dict[int, Ball]]] = []
        self._restricted: list[tuple[int, dict[int, Ball]]] = []

    def seen(self, vector: Matrix) -> dict[int, Ball]:
        """Return a vector modulo the directions so far."""
        v = dict(enumerate(vector))
        for pivot, other in self._divided:
            part = v.pop(pivot, ball(0))
            if not part.is_zero():
                for i, x in other.items():
                    if i != pivot:
                        v[i] = v.get(i, ball(0)) - part / other[pivot] * x
        return {i: x for i, x in v.items() if not x.is_zero()}

    def divide(self, vector: Matrix) -> bool:
        """Divide by a direction; return whether it is proven to be independent of the earlier ones."""
        v = self.seen(vector)
        if all(zero_inside(x) for x in v.values()):
            return False
        pivot = max((i for i in v if not zero_inside(v[i])), key=lambda i: abs(float(v[i].mid())))
        row = [(j, self.kept[pivot][j]) for j in self.alive if not self.kept[pivot][j].is_zero()]
        for i, x in v.items():
            if i != pivot:
                ratio = x / v[pivot]
                for j, y in row:
                    self.kept[i][j] = self.kept[i][j] - ratio * y
        self.alive.remove(pivot)
        self._divided.append((pivot, v))
        return True

    def restrict(self, differential: Matrix) -> bool:
        """Restrict to a given value of a function that is constant along the directions; return as `divide`."""
        row = {i: differential[i] for i in (*self.alive, *(j for j, _ in self._restricted))}
        for pivot, other in self._restricted:
            part = row.pop(pivot)
            if not part.is_zero():
                for i, x in other.items():
                    if i != pivot:
                        row[i] = row.get(i, ball(0)) - part / other[pivot] * x
        row = {i: x for i, x in row.items() if not x.is_zero()}
        sure = [i for i in row if not zero_inside(row[i])]
        if not sure:
            return False
        filled = {j: sum(not self.kept[i][j].is_zero() for i in self.alive) for j in sure}
        pivot = min(sure, key=lambda j: (filled[j], -abs(float(row[j].mid()))))
        self.alive.remove(pivot)
        for i in self.alive:
            x = self.kept[i][pivot]
            if not x.is_zero():
                for j, y in row.items():
                    if j != pivot:
                        self.kept[i][j] = self.kept[i][j] - x * y / row[pivot]
        self._restricted.append((pivot, row))
        return True

    def spectrum(self, names: Sequence[str], mirrored: str) -> Spectrum:
        """Return the characteristic polynomial of the quotient, split along exact zeros.

        Parameters
        ----------
        names : sequence of str
            Names of all states.
        mirrored : str
            What makes the spectrum symmetric about the imaginary axis, in words; empty: nothing does.
        """
        kept, zeros = self.kept, list[str]()
        factors: list[Factor] = []
        uneven: list[Factor] = []
        places = np.array(self.alive, dtype=int)
        acts = [[not x.is_zero() for x in row] for row in kept[np.ix_(places, places)]]
        reach = {i: frozenset(places[row].tolist()) for i, row in zip(self.alive, reached(acts), strict=True)}
        for component in (places[members].tolist() for members in together(acts)):
            block, states = kept[np.ix_(component, component)], frozenset(component)
            if len(block) == 1 and block[0, 0].is_zero():
                zeros.append(names[component[0]])
                continue
            sides = _two_kinds(block)
            if sides is None:
                p = ball_polynomials.characteristic(block)
                exact = len(p) % 2 == 1 and all(x.is_zero() for x in p[1::2])
                if exact:
                    factors.append(Factor(p[::2], True, "the linearized equations have it there exactly", states))
                else:
                    uneven.append(Factor(p, False, "", states))
                continue
            small, large = sorted(sides, key=len)
            A, B = block[np.ix_(small, large)], block[np.ix_(large, small)]
            zeros += [names[component[large[k]]] for k in _null_places(A)]
            if len(block) <= ALGEBRA.determinant_summed_size:
                even = ball_polynomials.characteristic(block)[len(large) - len(small) :: 2]
            else:
                even = ball_polynomials.characteristic(ball_matrices.times(A, B))
            factors.append(Factor(even, True, "the linearized equations are reversible", states))
        factors += _merged(uneven, mirrored)
        for k, factor in enumerate(factors):
            p = factor.p
            while len(p) > 1 and p[0].is_zero():
                zeros += ["no constant in the characteristic polynomial"] * (2 if factor.even else 1)
                p = p[1:]
            factors[k] = replace(factor, p=p)
        return Spectrum(zeros, [factor for factor in factors if len(factor.p) > 1], reach)


def _null_places(A: Matrix) -> list[int]:
    """Return the columns with the largest entries in the null vectors of a matrix with fewer rows than columns."""
    null = np.linalg.svd(A.astype(float))[2][len(A) :]
    return [int(np.argmax(np.abs(v))) for v in null]


def _merged(uneven: list[Factor], mirrored: str) -> list[Factor]:
    """Return factors that together have a symmetric spectrum as one even polynomial, and a zero if one is left over."""
    if not mirrored or not uneven:
        return uneven
    whole = ball_polynomials.product(*(factor.p for factor in uneven))
    odd = len(whole) % 2 == 0
    states = frozenset(i for factor in uneven for i in factor.states)
    even = Factor(whole[1::2] if odd else whole[::2], True, mirrored, states)
    return [even, Factor([ball(0), ball(1)], False, "", states)] if odd else [even]


def null_combinations(A: Matrix) -> tuple[Matrix, float]:
    """Return combinations of the columns of A that vanish within their balls, as rows, and the largest radius."""
    T, pivots, (m, width) = A.copy(), list[tuple[int, int]](), A.shape
    while True:
        rows = [i for i in range(m) if i not in {x for x, _ in pivots}]
        free = [j for j in range(width) if j not in {y for _, y in pivots}]
        sure = [(abs(float(T[i, j])), i, j) for i in rows for j in free if not zero_inside(T[i, j])]
        if not sure:
            slack = max((float(T[i, j].rad()) for i in rows for j in free), default=0.0)
            return ball_matrices.null_space(pivots, T, width)[1].T, slack
        _, i, j = max(sure)
        T[i] = T[i] / T[i, j]
        for other in range(m):
            if other != i and not T[other, j].is_zero():
                T[other] = T[other] - T[other, j] * T[i]
        pivots.append((i, j))


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


# --- roots ------------------------------------------------------------------------------------------------------------


def zero_enclosure(kind: str, count: int, why: str) -> Enclosure:
    """Return the enclosure of exact zeros."""
    return Enclosure(real(ball(0)), real(ball(0)), count, kind, why)


def carried_enclosures(rate: Ball, why: str) -> list[Enclosure]:
    """Return the eigenvalues ±iω of neutral directions that rotate with the motion."""
    return [Enclosure(real(ball(0)), real(sign * rate), 1, "carried", why) for sign in (1, -1)]


def touch(one: Enclosure, other: Enclosure) -> bool:
    """Return whether two enclosures overlap."""
    return zero_inside(one.real - other.real) and zero_inside(one.imag - other.imag)


def enclosed(factor: Factor) -> list[Enclosure]:
    """Return enclosures of the roots of a factor."""
    from flint import acb, arb

    zero = arb(0)
    found = []
    for centre, radius, count in ball_polynomials.root_discs(factor.p):
        x = centre.real + arb(0, radius)
        y = centre.imag + arb(0, radius)
        # The roots of a real polynomial come in conjugate pairs: a single root in a disc about a real centre is real.
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
            size = (abs(x) + abs(y)).abs_upper().sqrt().abs_upper()
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
