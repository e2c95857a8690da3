"""What is proven about the elements of a scene.

Symmetries, conserved momenta and the work of the elements are identities that balls have verified at random states
(`mbstab.analysis.reference.identities`, `mbstab.analysis.verdict.work`); here it is told what they rest on. That an
element does not contain a coordinate at all is structure and needs no states. What is known of the reference alone is
asked at its enclosure.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import cached_property
from typing import Any, Literal

import numpy as np

from mbstab.analysis.algebra import ball_matrices
from mbstab.analysis.algebra.balls import Matrix
from mbstab.analysis.algebra.tolerances import TOLERANCES as ALGEBRA
from mbstab.analysis.proof.enclosures import Reference
from mbstab.analysis.proof.fields import moved, short
from mbstab.analysis.proof.tolerances import TOLERANCES
from mbstab.analysis.reference.fields import Symmetry
from mbstab.analysis.verdict.drag import Drag
from mbstab.analysis.verdict.facts import Grounds
from mbstab.analysis.verdict.work import Work
from mbstab.compiler.system import System
from mbstab.errors import MbstabError
from mbstab.model import balls
from mbstab.model.balls import Ball, ball, zero_inside

Finding = Literal["structural", "enclosed", "open", "refuted"]
"""``open``: not verified; ``refuted``: proven to be wrong."""

UNVERIFIED = (MbstabError, ArithmeticError, ValueError)
"""Errors of a state that cannot be enclosed."""


class Identities:
    """What is proven about the elements of a scene.

    Parameters
    ----------
    reference : Reference
        At exact values of all parameters.
    grounds : Grounds
        What is known about the same motion, as identities or in double precision.
    """

    def __init__(self, reference: Reference, grounds: Grounds) -> None:
        self.reference, self.grounds, self.invariance = reference, grounds, grounds.invariance
        self.system, self.time = reference.system, reference.time
        self.elements = self.system.acting()
        self.f = balls.ball_arithmetic()
        self._found: dict[str, Finding] = {}

    # --- fields -----------------------------------------------------------------------------------------------------

    def disturbance(self, item: Symmetry, reference: Reference) -> tuple[Matrix, Matrix]:
        """Return the changes of the coordinates and speeds of a reference under a symmetry."""
        state = reference.state
        return (state.u, state.a) if item.name == "the motion itself" else moved(item.of, reference, state.q, state.u)

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
        if all(x.is_zero() for x in self.reference.state.u):
            return "structural"
        c = self.invariance.identities.of_generator(self.reference.state.field)
        kept = c is not None and not self.invariance.identities.changed(c, ALGEBRA.bits_of_zero)
        return "open" if not kept else "enclosed" if self.elements else "structural"

    # --- families ------------------------------------------------------------------------------------------

    def at_any_speed(self, item: Symmetry) -> Finding:
        """Return whether the scene may move from the reference along a symmetry at any speed: no force deflects it."""
        return self._once(f"speed of {item.name}", lambda: self._at_any_speed(item))

    def _at_any_speed(self, item: Symmetry) -> Finding:
        reference = self.reference
        q, still = reference.state.q, ball_matrices.zeros(self.system.n_q)
        Y = self.disturbance(item, reference)[0]
        itself = item.name == "the motion itself"
        turned = reference.state.a if itself else moved(item.of, reference, q, Y)[1]
        found: list[Finding] = ["structural" if all(x.analytic for x in self.elements) else "open"]
        for speed in map(short, TOLERANCES.trial_speeds):
            u, a = speed * Y, speed * speed * turned
            at = self.system.dynamics(q, u, self.time)
            V, J = ball_matrices.matrix(at.V), ball_matrices.matrix(at.J)
            found += [is_zero(V[i], 2 * sum_of(J[i]) * sum_of(u)) for i in reference.rows]
            force, size = still.copy(), ball(0)
            for element in self.elements:
                own = ball_matrices.matrix(element.force(q, u, a, self.time, self.f))
                size = size + sum_of(own)
                for i, x in zip(element.columns, own, strict=True):
                    force[i] = force[i] + x
            found += [is_zero(x, size) for x in ball_matrices.times(self._allowed(J).T, force)]
        return least(found)

    def _allowed(self, J: Matrix) -> Matrix:
        """Return admissible directions, as columns, given the rows."""
        rows, sizes = self.reference.rows, self.invariance.motion.sizes.tolist()
        pivots, T = ball_matrices.eliminate(J[rows], len(rows), self.system.n_q, None, sizes)
        return ball_matrices.null_space(pivots, T, self.system.n_q)[1]

    # --- work ---------------------------------------------------------------------------------------------------------

    @cached_property
    def exact_work(self) -> Work:
        """The work of the elements in the frame of the reference in balls."""
        return Work(self.invariance, self.reference.state.field, ALGEBRA.bits_of_zero)

    def _worked(self, name: str) -> Finding:
        """Return what a fact about the work rests on: balls, if they verify it; what doubles do not show is refuted."""
        if not getattr(self.grounds.structure.work, name):
            return "refuted"
        return "open" if not getattr(self.exact_work, name) else "enclosed" if self.exact_work.asked else "structural"

    def rows_at_rest(self) -> Finding:
        """Return whether rest satisfies all rows."""
        return self._worked("rows_at_rest")

    def conserved(self, moving: bool) -> Finding:
        """Return whether the energy, in the co-moving frame if `moving`, is constant along every motion."""
        return self._worked("conserved" if moving else "conserved_at_rest")

    def decreases(self, system: System, beside: bool = False) -> Finding:
        """Return whether the energy in the co-moving frame never increases, for the parameters of a system.

        With `beside` whatever the rates of first-order states are, which take no force.
        """
        found = self._worked("decreases_beside_states" if beside else "decreases")
        return found if found == "open" or self._takes(system) else "refuted"

    def _takes(self, system: System) -> bool:
        """Return whether dampers dissipate energy: their coefficients are not negative; and drag as it is written."""
        zero, paths = ball_matrices.zeros(self.system.n_q), {e.path for e in self.exact_work.kinds["damping"]}
        for element in (e for e in system.acting() if e.path in paths and not e.inertia):
            if element.stored:
                if not all(ball(x) >= 0 for x in element.damping or ()):
                    return False
                continue
            R = ball_matrices.matrix(element.slopes(self.reference.state.q, zero, zero, self.time, self.f)[1])
            if not ball_matrices.positive(R + R.T, semi=True):
                return False
        drag = Drag(system, self.invariance.motion.q, self.invariance.motion.time)
        return all(np.all(drag.resists(path)) for path in self.exact_work.resisting)

    def reversible(self) -> Finding:
        """Return whether the equations are reversible in time: forces even in the speeds, rows odd."""
        return self._worked("reversible")


# --- numbers ----------------------------------------------------------------------------------------------------------


def is_zero(x: Ball, size: Ball) -> Finding:
    """Return whether a ball vanishes, relative to a size."""
    if x.is_zero():
        return "structural"
    if tiny(x, size):
        return "enclosed"
    return "open" if zero_inside(x) else "refuted"


def sum_of(entries: Iterable[Any]) -> Ball:
    """Return the sum of sizes."""
    return sum((abs(ball(x)) for x in entries), ball(0))


def least(found: Sequence[Finding]) -> Finding:
    """Return the weakest of several findings."""
    order: tuple[Finding, ...] = ("refuted", "open", "enclosed", "structural")
    return min(found, key=order.index, default="structural")


def tiny(x: Ball, size: Ball) -> bool:
    """Return whether a ball contains zero and is smaller than a size by half of the digits in use."""
    if x.is_zero():
        return True
    return zero_inside(x) and bool(x.abs_upper() <= balls.small(0.5) * size.abs_upper())
