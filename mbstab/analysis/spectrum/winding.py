"""The number of eigenvalues right of the imaginary axis, by the winding number of the determinant.

h(s) = det Q(s) / (s + a)^n, with n finite eigenvalues, is analytic right of the axis, finite and nonzero at infinity;
−Δ arg h / π over ω = 0 … ∞ along s = iω is the number of its zeros there. The phase comes from LU factors. That an
integer comes out is no evidence: changes by 2π between two points are not detected. An interval is accepted only if

* discs around its ends and its middle, with a fraction of the estimated distance to the nearest eigenvalue (Arnoldi),
  cover it so far that Simpson's rule for the slopes is right to less than π for as many eigenvalues as there are, and
* its change of phase agrees, up to multiples of 2π, with this rule.

The discs rest on estimates, so the count is not a proof (Ying, Katz 1988, Numer. Math. 53; Kamgnia,
Philippe 2013, ETNA 40, describe what a proof needs).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from mbstab.analysis.algebra.arrays import Complex, Index
from mbstab.analysis.algebra.shift_invert import Operator
from mbstab.analysis.algebra.tolerances import TOLERANCES as ALGEBRA
from mbstab.analysis.linear.sparse_equations import SparseEquations
from mbstab.analysis.spectrum.tolerances import TOLERANCES
from mbstab.analysis.verdict.rule import Census
from mbstab.records import dataclass


@dataclass(frozen=True)
class _Point:
    """h on the imaginary axis: its phase, the slope of the phase, and the radius of a disc without eigenvalues."""

    omega: float
    phase: float
    slope: float
    radius: float


class _Open(Exception):
    """Why nothing is counted."""


def winding(equations: SparseEquations, why: str) -> Census:
    """Return the number of eigenvalues right of the imaginary axis, apart from neutral shifts.

    Parameters
    ----------
    equations : SparseEquations
    why : str
        Why the stiffness alone does not count them.
    """
    zeros = equations.zeros
    try:
        number = _Winding(equations).number() if equations.n_left else 0
    except _Open as stop:
        return Census(None, zeros=zeros, how=f"{why}, and the winding number of the determinant fails: {stop}")
    how = "by the winding number of the determinant along the imaginary axis"
    return Census(number, least=number, zeros=zeros, left=not number and not zeros, how=how, proven=False)


class _Winding:
    """The phase of h, followed along the imaginary axis."""

    def __init__(self, equations: SparseEquations) -> None:
        self.problem, self.known_to = equations.problem, equations.known_to
        self.most, self.fastest = equations.n_left, equations.fastest
        self.left = min(TOLERANCES.winding_factorizations, int(TOLERANCES.winding_rows / self.problem.size))
        rng = np.random.default_rng(17)
        self.start: Complex = rng.normal(size=2 * len(self.problem.active)).astype(complex)
        self.signs = rng.choice((-1.0, 1.0), size=(TOLERANCES.winding_rounding_steps, self.problem.size))

    def number(self) -> int:
        """Return the number of zeros right of the axis."""
        first = self._point(0.0)
        last = self._point(TOLERANCES.winding_start * self.fastest)
        total = self._change(first, last)
        # Beyond all eigenvalues only the first term of their phases is left: the others fall as 1/ω³.
        while 2.0 * self.most * (self.fastest / last.omega) ** 3 > math.pi * TOLERANCES.winding_number_misfit:
            further = self._point(2.0 * last.omega)
            total += self._change(last, further)
            last = further
        total += last.slope * last.omega
        number = -total / math.pi
        if abs(number - round(number)) > TOLERANCES.winding_number_misfit or not 0 <= round(number) <= self.most:
            raise _Open(f"it comes out as {number:.3f}")
        return round(number)

    def _change(self, first: _Point, last: _Point) -> float:
        """Return the change of phase between two points.

        Simpson's rule for the slopes determines it up to an error, and the phases up to multiples of 2π. The slope of
        a factor s − λ has a fourth derivative of at most 24/ρ⁵ at distances ρ of λ, so the error of the rule is at
        most (width/ρ)⁵/120 for each zero and each pole of h: with less than π in total, the multiple is known.
        """
        stack, total = [(first, self._between(first, last), last)], 0.0
        while stack:
            one, middle, other = stack.pop()
            width = other.omega - one.omega
            nearest = min(_nearest(one, middle), _nearest(middle, other))
            if nearest > 0.0 and 2.0 * self.most * (width / nearest) ** 5 / 120.0 <= TOLERANCES.winding_phase:
                expected = (one.slope + 4.0 * middle.slope + other.slope) * width / 6.0
                change = math.remainder(other.phase - one.phase - expected, 2.0 * math.pi)
                if abs(change) > 2.0 * TOLERANCES.winding_phase:
                    raise _Open(f"phases and slopes disagree at {middle.omega:.6g} rad/s")
                total += expected + change
                continue
            stack += [
                (middle, self._between(middle, other), other),
                (one, self._between(one, middle), middle),
            ]
        return total

    def _between(self, one: _Point, other: _Point) -> _Point:
        return self._point(0.5 * (one.omega + other.omega))

    def _point(self, omega: float) -> _Point:
        s = 1j * omega
        phase, lu = self._phase(omega)
        _, once = self.problem.operator(lu, s)
        radius = TOLERANCES.winding_disc_radius / _largest(once, self.start)
        if not radius > TOLERANCES.winding_nearest_axis * self.fastest:
            raise _Open(f"an eigenvalue lies at {omega:.6g} rad/s, or next to it")
        if not self._unsure(lu, omega) < TOLERANCES.winding_rounding_effect:
            raise _Open(f"rounding may move eigenvalues over the axis at {omega:.6g} rad/s")
        step = TOLERANCES.winding_slope_step * radius / self.most
        beside, _ = self._phase(omega + step)
        slope = math.remainder(beside - phase, 2.0 * math.pi) / step
        return _Point(omega, phase, slope, radius)

    def _unsure(self, lu: Any, omega: float) -> float:
        """Return the relative change of solutions by errors of the entries: from 1 on the matrix may be singular."""
        sizes, x = self.known_to.at(omega), np.abs(lu.solve(self.signs[0].astype(complex)))
        growth = []
        for signs in self.signs:
            following = np.abs(lu.solve((ALGEBRA.entry_rounding * signs * (sizes @ x)).astype(complex)))
            before, after = np.linalg.norm(x), np.linalg.norm(following)
            if not (before > 0.0 and np.isfinite(after)):
                return math.inf if after else 0.0
            growth.append(float(after / before))
            x = following / after if after else following
        return max(growth[1:])

    def _phase(self, omega: float) -> tuple[float, Any]:
        """Return the phase of h, up to multiples of 2π, and the factors."""
        if self.left <= 0:
            raise _Open("eigenvalues lie so close to the axis that it takes too many factorizations")
        self.left -= 1
        # Complex factors at zero as well: the operator takes complex vectors.
        lu = self.problem.factors(complex(0.0, omega) if omega else complex(0.0, 5e-324))
        if lu is None:
            where = "zero" if not omega else f"{omega:.6g} rad/s"
            raise _Open(f"an eigenvalue lies at {where}, and no shift explains it")
        turns = (_odd(lu.perm_r) + _odd(lu.perm_c)) * math.pi
        pivots = float(np.sum(np.angle(lu.U.diagonal())))
        return pivots + turns - self.most * math.atan2(omega, self.fastest), lu


def _nearest(one: _Point, other: _Point) -> float:
    """Return a distance that no eigenvalue falls short of between two points; negative: it is not known."""
    return 0.5 * (one.radius + other.radius - (other.omega - one.omega))


def _odd(permutation: Index) -> int:
    """Return 1 for an odd permutation, 0 for an even one."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    n = len(permutation)
    graph = csr_array((np.ones(n), (np.arange(n), permutation)), shape=(n, n))
    return (n - int(connected_components(graph, directed=False, return_labels=False))) % 2


def _largest(once: Operator, start: Complex) -> float:
    """Return the size of the largest eigenvalue of an operator, estimated by Arnoldi steps."""
    basis = [start / np.linalg.norm(start)]
    H = np.zeros((TOLERANCES.winding_arnoldi_steps + 1, TOLERANCES.winding_arnoldi_steps), dtype=complex)
    for k in range(min(TOLERANCES.winding_arnoldi_steps, len(start))):
        y = once(basis[k])
        for _ in range(2):
            for j, x in enumerate(basis):
                part = np.vdot(x, y)
                H[j, k] += part
                y = y - part * x
        H[k + 1, k] = np.linalg.norm(y)
        if abs(H[k + 1, k]) <= 1e-14 * np.max(np.abs(H)):
            break
        basis.append(y / H[k + 1, k])
    return float(np.max(np.abs(np.linalg.eigvals(H[: k + 1, : k + 1]))))
