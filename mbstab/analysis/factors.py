"""The linearized equations of a scene in balls, and the factors of their characteristic polynomial.

The constraints are eliminated by pivots that are proven to be different from zero, and what is left, ẏ = S y,
contains the linearized equations for all values of the parameters in their balls. S is divided by symmetries and
split along its exact zeros, as `mbstab.analysis.certify` says.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mbstab.analysis import balls
from mbstab.analysis.balls import Ball, Matrix, ball, real, zero_inside
from mbstab.analysis.enclosures import RELATIVE, Field, Reference
from mbstab.analysis.symmetry import symmetries
from mbstab.errors import counted

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
    conditions: tuple[str, ...]


class Proof(Reference):
    """The equations about a reference motion, and the factors of their characteristic polynomial."""

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
                self.conditions.append(f"{name} is a symmetry")
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
            zeros += ["the linearized equations are reversible"] * (len(large) - len(small))
            A = [[block[i][j] for j in large] for i in small]
            B = [[block[i][j] for j in small] for i in large]
            if len(block) <= balls.SMALL:
                even = balls.characteristic(block)[len(large) - len(small) :: 2]
            else:
                even = balls.characteristic(balls.times(A, B))
            factors.append(Factor(even, True, "the linearized equations are reversible"))
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
        return Spectrum(zeros, factors, tuple(dict.fromkeys(self.assumed)), tuple(dict.fromkeys(self.conditions)))

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
            turn = Field(self.system, axis, zero, ball(1), zero, still)
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


# --- roots ------------------------------------------------------------------------------------------------------------


def zeros_of(spectrum: Spectrum) -> Enclosure:
    """Return the exact zeros, with what makes them zero."""
    why = ", ".join(
        f"{name} ({counted(count, 'time')})" if count > 1 else name
        for name, count in ((x, spectrum.zeros.count(x)) for x in dict.fromkeys(spectrum.zeros))
    )
    return Enclosure(real(ball(0)), real(ball(0)), len(spectrum.zeros), "zero", why)


def enclosed(factor: Factor) -> list[Enclosure]:
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
