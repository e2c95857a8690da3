"""Symmetries and conserved functions of a scene, verified as identities in balls.

`mbstab.analysis.reference.symmetries` and `mbstab.analysis.verdict.work` find symmetries, conserved functions and the
work of the elements in double precision. Here each of them is verified again, infinitesimally and
element by element, at random rational states with the digits of a proof: the force of an element
changes along a field Y by Dᵀ(Y) F + ∂F/∂q Y + ∂F/∂u Ẏ + M Ÿ, which has to enclose zero and be
smaller than half of the digits. An identity between analytic functions that holds at random states
holds everywhere (Schwartz 1980 for polynomials). One of the states lies close to the reference, in
the same piece of piecewise functions.

That an element does not contain a coordinate at all is structure and needs no states.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from mbstab.analysis.algebra import ball_matrices
from mbstab.analysis.algebra.balls import Ball, Matrix, ball
from mbstab.analysis.proof.element_changes import (
    UNVERIFIED,
    ElementChanges,
    Finding,
    State,
    dot,
    is_zero,
    least,
    sum_of,
    tiny,
)
from mbstab.analysis.proof.fields import short
from mbstab.analysis.proof.tolerances import TOLERANCES
from mbstab.analysis.reference.fields import Symmetry
from mbstab.analysis.verdict.drag import Drag
from mbstab.compiler.placed import Acting
from mbstab.compiler.system import System


class Identities(ElementChanges):
    """What is proven about the elements of a scene.

    Parameters
    ----------
    reference : Reference
        At exact values of all parameters.
    grounds : Grounds
        What double precision has found.
    """

    # --- states -----------------------------------------------------------------------------------------------------

    # --- fields -----------------------------------------------------------------------------------------------------

    # --- symmetries ---------------------------------------------------------------------------------------------------

    def symmetry(self, item: Symmetry) -> Finding:
        """Return what a symmetry rests on, which balls have verified as an identity."""
        return self.invariance.identities.worth(item.of)

    def steady(self) -> Finding:
        """Return whether the reference is constant in its own frame, also with drives of constant speed."""
        return self._once("steady", self._steady)

    def _once(self, key: str, find: Callable[[], Finding]) -> Finding:
        """Find something out at first use."""
        if key not in self._found:
            try:
                self._found[key] = find()
            except UNVERIFIED:
                self._found[key] = "open"
        return self._found[key]

    def _steady(self) -> Finding:
        u = self.reference.state.u
        if all(x.is_zero() for x in u):
            return "structural"
        found = [_worth(self.elements)]
        for state in self.states:
            at = self.local("the motion itself", None, state)
            if any(not _tiny(*self._change(element, at, state)) for element in self.elements):
                return "open"
        if not self.states:
            return "open"
        rows, r_h = self.reference.rows, self.reference.r_h
        for state in self._needed_on_rows():
            at = self.local("the motion itself", None, state)
            found.append(self._satisfied(state, at.Y, rows[:r_h]))
            # A drive adds a constant to its row: the rest of the rate of the row has to vanish.
            found.append(self._rows_change(at, state, [ball(0)] * len(at.Y)))
        return least(found)

    # --- families ------------------------------------------------------------------------------------------

    def at_any_speed(self, item: Symmetry) -> Finding:
        """Return whether the scene may move from the reference along a symmetry at any speed: no force deflects it."""
        return self._once(f"speed of {item.name}", lambda: self._at_any_speed(item))

    def _at_any_speed(self, item: Symmetry) -> Finding:
        reference = self.reference
        q, still = reference.state.q, [ball(0)] * self.system.n_q
        at = self._local(self.field(item.name, item.of, reference), State(q, still, still))
        turned, found = ball_matrices.apply(at.slope, at.Y), list[Finding](["structural"])
        for speed in map(short, TOLERANCES.trial_speeds):
            state = State(q, [speed * x for x in at.Y], [speed * speed * x for x in turned])
            found.append(self._satisfied(state, state.u, reference.rows))
            force, size = still[:], ball(0)
            for element in self.elements:
                own = ball_matrices.vector(element.force(q, state.u, state.a, self.time, self.f))
                size = size + sum_of(own)
                for i, x in zip(element.columns, own, strict=True):
                    force[i] = force[i] + x
            left = ball_matrices.apply(ball_matrices.transposed(self._allowed(state)), force)
            found += [is_zero(x, size) for x in left]
        return least([*found, "structural" if all(x.analytic for x in self.elements) else "open"])

    # --- work ---------------------------------------------------------------------------------------------------------

    def rows_at_rest(self) -> Finding:
        """Return whether rest satisfies all rows."""
        return self._once("rows at rest", lambda: self._homogeneous(False))

    def _homogeneous(self, moving: bool, beside: bool = False) -> Finding:
        """Return whether all rows, or all beside those of states, hold for u = X, or u = 0, at all positions."""
        found: list[Finding] = ["structural"]
        rows = [i for i in self.reference.rows if not (beside and self.system.rows[i].section == "states")]
        zero = [ball(0)] * self.system.n_q
        for state in self._needed_on_rows():
            X = self.local("the motion itself", None, state).Y if moving else zero
            found.append(self._satisfied(state, X, rows))
        return least(found)

    def conserved(self, moving: bool) -> Finding:
        """Return whether the energy, in the co-moving frame if `moving`, is constant along every motion."""
        if self.work.dissipates or self.work.kinds["other"]:
            return "open"
        return self._once(f"conserved {moving}", lambda: self._relative(moving))

    def decreases(self, system: System, beside: bool = False) -> Finding:
        """Return whether the energy in the co-moving frame never increases, for the parameters of a system.

        With `beside` whatever the rates of first-order states are, which take no force.
        """
        if self.work.kinds["other"] or not self.states:
            return "open"
        found = self._once(f"decreases {beside}", lambda: self._decreases(beside))
        return found if self._takes(system) else "refuted"

    def _dampers(self, system: System) -> list[Acting]:
        paths = {e.path for e in self.work.kinds["damping"]}
        return [e for e in system.acting() if e.path in paths and not e.inertia]

    def _takes(self, system: System) -> bool:
        """Return whether dampers dissipate energy: their coefficients are not negative; and drag as it is written."""
        zero = [ball(0)] * self.system.n_q
        for element in self._dampers(system):
            if element.stored:
                if not all(ball(x) >= 0 for x in element.damping or ()):
                    return False
                continue
            R = element.slopes(self.states[0].q, zero, zero, self.time, self.f)[1]
            if not _not_negative(ball_matrices.matrix(R)):
                return False
        drag = Drag(system, self.invariance.motion.q, self.invariance.motion.time)
        return all(np.all(drag.resists(path)) for path in self.work.resisting)

    def _decreases(self, beside: bool) -> Finding:
        return least(
            [
                self._relative(True, beside),
                *(self._damps(e) for e in self._dampers(self.system)),
                *(self._held(e) for e in self.work.kinds["drag"]),
            ]
        )

    def _held(self, element: Acting) -> Finding:
        """Return whether drag has a potential at rest."""
        drag = Drag(self.system, self.invariance.motion.q, self.invariance.motion.time)
        if drag.potential(element.path):
            return "structural"
        return least([x for state in self.states for x in self._potential(element, state)] if self.states else ["open"])

    def _relative(self, moving: bool, beside: bool = False) -> Finding:
        """Return whether undamped forces and rows, or those beside states, do no work in the co-moving frame."""
        damping = {e.path for kind in ("damping", "drag") for e in self.work.kinds[kind]}
        found: list[Finding] = [self._homogeneous(moving, beside), "structural" if self.states else "open"]
        for element in self.elements:
            if element.inertia or element.stored or element.path in damping:
                continue
            for state in self.states:
                found += self._potential(element, state) + self._powerless(element, state, moving)
        return least(found)

    def _potential(self, element: Acting, state: State) -> list[Finding]:
        """Return whether the stiffness matrix of a force at rest is symmetric."""
        zero = [ball(0)] * self.system.n_q
        K = ball_matrices.matrix(element.slopes(state.q, zero, zero, self.time, self.f)[0])
        size = sum_of(x for row in K for x in row)
        return [is_zero(K[i][j] - K[j][i], size) for i in range(len(K)) for j in range(i)]

    def _powerless(self, element: Acting, state: State, moving: bool) -> list[Finding]:
        """Return whether the velocity-dependent part of a force does no work, nor any along the motion."""
        zero = [ball(0)] * self.system.n_q
        more, still = (element.force(state.q, u, zero, self.time, self.f) for u in (state.u, zero))
        speeds = [state.u]
        if moving:
            speeds.append(self.local("the motion itself", None, state).Y)
        added = [ball(x) - ball(y) for x, y in zip(more, still, strict=True)]
        moved = [[u[i] for i in element.columns] for u in speeds]
        size = sum_of(ball_matrices.vector(more)) + sum_of(ball_matrices.vector(still))
        return [is_zero(dot(added, u), size * sum_of(u)) for u in moved]

    def _damps(self, element: Acting) -> Finding:
        """Return whether a damper is linear in the speeds and depends only on those relative to the motion."""
        found: list[Finding] = ["structural" if self.states else "open"]
        zero = [ball(0)] * self.system.n_q
        first = element.slopes(self.states[0].q, zero, zero, self.time, self.f)[1] if self.states else []
        for state in self.states:
            K, R = element.slopes(state.q, state.u, zero, self.time, self.f)
            X = self.local("the motion itself", None, state).Y
            found += _blind(ball_matrices.matrix(R), [X[j] for j in element.columns])
            if element.stored:
                continue
            still, _ = element.slopes(state.q, zero, zero, self.time, self.f)
            for one, other in ((R, first), (K, still)):
                found += _equal([x for row in one for x in row], [x for row in other for x in row])
            found += self._potential(element, state)
        return least(found)

    def reversible(self) -> Finding:
        """Return whether the equations are reversible in time: forces even in the speeds, rows odd."""
        return self._once("reversible", self._reversible)

    def _reversible(self) -> Finding:
        found: list[Finding] = [self._homogeneous(False), "structural" if self.states else "open"]
        for element in self.elements:
            if element.inertia or (element.stored and not element.damped):
                continue
            for state in self.states:
                back = [-x for x in state.u]
                one, other = (element.force(state.q, u, state.a, self.time, self.f) for u in (state.u, back))
                found += _equal(one, other)
        return least(found)


# --- fields in balls --------------------------------------------------------------------------------------------------


# --- numbers ----------------------------------------------------------------------------------------------------------


def _tiny(entries: Sequence[Ball], size: Ball) -> bool:
    return all(tiny(x, size) for x in entries)


def _equal(one: Sequence[Any], other: Sequence[Any]) -> list[Finding]:
    """Return whether numbers are the same."""
    pairs = [(ball(x), ball(y)) for x, y in zip(one, other, strict=True)]
    size = sum_of(x for pair in pairs for x in pair)
    return [is_zero(x - y, size) for x, y in pairs]


def _blind(R: Matrix, direction: Sequence[Ball]) -> list[Finding]:
    """Return whether a direction is in the null space of a matrix."""
    return [is_zero(dot(row, direction), sum_of(row) * sum_of(direction)) for row in R]


def _not_negative(R: Matrix) -> bool:
    """Return whether the symmetric part of a matrix is proven positive semidefinite; pivots may be exact zeros."""
    A = [
        [x + y for x, y in zip(row, column, strict=True)]
        for row, column in zip(R, ball_matrices.transposed(R), strict=True)
    ]
    for k in range(len(A)):
        pivot = A[k][k]
        if pivot.is_zero():
            if not all(x.is_zero() for x in A[k][k:]):
                return False
            continue
        if not pivot > 0:
            return False
        for i in range(k + 1, len(A)):
            factor = A[i][k] / pivot
            A[i] = [x - factor * y for x, y in zip(A[i], A[k], strict=True)]
    return True


def _worth(elements: Sequence[Acting]) -> Finding:
    """Return the finding about elements that are unchanged at random states: structural if there are none."""
    return "enclosed" if elements else "structural"
