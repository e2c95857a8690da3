"""Elements that conserve, dissipate or supply energy, as identities.

In the frame of a steady motion with the field X(q), the function E − p_X (the energy at rest, where
X = 0; the integral of Jacobi in a turning frame) is

* conserved, if every force has a potential or does no work, and the constraint rows are
  homogeneous in the speeds relative to X: then reactions do no work on u − X;
* not increasing, if there are also dampers between points and joints, which depend on speeds
  relative to X only.

A built-in spring is known to have a potential and a dissipation function. Other forces are
evaluated in balls at random states (`mbstab.analysis.reference.identities`): a force has a potential if its
∂F/∂q is symmetric and it does not depend on speeds; it does no work if F·u = 0; it damps if ∂F/∂u is a constant matrix
with a positive semidefinite symmetric part. About a rest a written force may also depend on speeds in any
other way, if its power is not positive near it (`mbstab.analysis.verdict.drag`).
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property, partial
from typing import Any, Literal

import numpy as np

from mbstab.analysis.algebra.arrays import RandomNumbers
from mbstab.analysis.algebra.ball_arrays import BALLS, as_ball, excludes_zero, many_bits, not_negative
from mbstab.analysis.reference.changes import At, Cluster, Local, Results
from mbstab.analysis.reference.identities import NO_VALUE
from mbstab.analysis.reference.symmetries import Invariance
from mbstab.analysis.reference.tolerances import TOLERANCES as REFERENCE
from mbstab.analysis.verdict.drag import Drag
from mbstab.compiler.placed import Acting
from mbstab.compiler.system import Array

Kind = Literal["potential", "powerless", "damping", "drag", "other"]


class Work:
    """The work of the elements of a scene in the frame of a steady motion.

    Parameters
    ----------
    invariance : Invariance
        Symmetries of the scene.
    generator : Generator or None
        The steady motion that defines the frame of the energy, in doubles or in balls; None: the ground.
    bits : int
        Bits to which it is known.
    """

    def __init__(self, invariance: Invariance, generator: Any, bits: int = REFERENCE.bits_of_motion) -> None:
        self.invariance, self.generator, self.bits = invariance, generator, bits
        self.system, self.motion = invariance.system, invariance.motion

    # --- the energy -------------------------------------------------------------------------------------------------

    @cached_property
    def kinds(self) -> dict[Kind, list[Acting]]:
        """The forces of the scene by their effect on the energy in the ground frame."""
        found: dict[Kind, list[Acting]] = {"potential": [], "powerless": [], "damping": [], "drag": [], "other": []}
        for element in self.system.acting():
            if not element.inertia and element.columns:
                found[self._kind(element)].append(element)
        return found

    @property
    def asked(self) -> bool:
        """Whether any of it was found at states, not from the kinds of elements alone."""
        forces = (x for kind in self.kinds.values() for x in kind)
        return any(not x.stored for x in forces) or not self._rows_vanish

    @property
    def dissipates(self) -> bool:
        """Whether any force dissipates energy."""
        return bool(self.kinds["damping"] or self.kinds["drag"])

    @cached_property
    def conserved_at_rest(self) -> bool:
        """Whether the energy in the ground frame is constant along every motion."""
        return not self.dissipates and not self.kinds["other"] and self.rows_at_rest

    @cached_property
    def conserved(self) -> bool:
        """Whether the energy in the co-moving frame is constant along every motion."""
        return self._relative and not self.dissipates

    @property
    def resisting(self) -> frozenset[str]:
        """The paths of written forces that give no energy to any motion near the reference, which is at rest."""
        drag = self.kinds["drag"] + [x for x in self.kinds["powerless"] if self._resists(x)]
        return frozenset(element.path for element in drag)

    @cached_property
    def decreases(self) -> bool:
        """Whether the energy in the co-moving frame never increases."""
        return self._relative and all(map(self._turns_along, self.kinds["damping"]))

    @cached_property
    def decreases_beside_states(self) -> bool:
        """Whether it never increases whatever the rates of first-order states are: their rows take no force."""
        of_states = frozenset(self.system.states[1].tolist())
        return self._without_work(of_states) and all(map(self._turns_along, self.kinds["damping"]))

    @cached_property
    def rows_at_rest(self) -> bool:
        """Whether all constraint rows are homogeneous in the speeds: rest satisfies them everywhere."""
        return self._homogeneous(False)

    @cached_property
    def led_at_rest(self) -> bool:
        """Whether rest satisfies all rows everywhere, whatever the rates of states that only follow are."""
        columns, rows = self.system.states
        return self._homogeneous(False, frozenset(rows[np.isin(columns, self.system.following)].tolist()))

    @cached_property
    def _relative(self) -> bool:
        """Whether undamped forces and rows do no work in the co-moving frame."""
        return self._without_work(frozenset())

    def _without_work(self, beside: frozenset[int]) -> bool:
        """Whether undamped forces and the rows, but for some, do no work in the co-moving frame."""
        return (
            not self.kinds["other"]
            and self._homogeneous(True, beside)
            and all(map(self._no_relative_work, self.kinds["powerless"]))
        )

    # --- states -----------------------------------------------------------------------------------------------------

    @cached_property
    def _places(self) -> dict[int, tuple[Cluster, Local]]:
        """The elements among their bodies, by their identity."""
        clusters = self.invariance.identities.clusters
        return {id(own.element): (cluster, own) for cluster in clusters for own in cluster.elements}

    def _at(self, element: Acting) -> Iterator[tuple[At, Local]]:
        """Yield an element at random states."""
        cluster, own = self._places[id(element.placed)]
        for at in self.invariance.identities.beside(cluster):
            yield at, own

    @cached_property
    def _coefficients(self) -> Array | None:
        """Those of the field X among the fields of the scene, in balls; None where it has none."""
        if self.generator is None:
            return BALLS.zeros((self.invariance.identities.basis.size,))
        found = self.invariance.identities.of_generator(self.generator)
        return found if found is None else self.invariance.identities.known_to(found, self.bits)

    def _field(self, cluster: Cluster, at: At) -> Array:
        """Return X at a state, shape (n,)."""
        c = self._coefficients
        assert c is not None
        return np.concatenate([x[0] for x in at.fields(c[cluster.fields][:, None])])[:, 0]

    # --- rows -------------------------------------------------------------------------------------------------------

    @property
    def _rows_vanish(self) -> bool:
        """Whether the rows are J(q) u, and rest in the frame is rest."""
        return not self.system.n_c or (not self._moves and self.invariance.rows_of_places)

    @property
    def _moves(self) -> bool:
        """Whether the frame does."""
        c = self._coefficients if self.generator is not None else None
        return self.generator is not None and (c is None or bool(np.any(c != 0)))

    def _homogeneous(self, moving: bool, beside: frozenset[int] = frozenset()) -> bool:
        """Whether the rows, but for some, hold for u = X, or for rest, and are linear in u − X."""
        if self._rows_vanish or (not moving and self.invariance.rows_of_places):
            return True
        if moving and self._coefficients is None:
            return False
        identities, scene = self.invariance.identities, self.system.scene
        pairs = ((cluster, own) for cluster in identities.clusters for own in cluster.elements if own.element.rows)
        try:
            with many_bits():
                for cluster, own in pairs:
                    # The rate of a function of coordinates alone is J(q) u.
                    at_rest = not moving and own.holonomic and not (scene.timed or scene.balances)
                    if at_rest or beside.issuperset(own.element.rows):
                        continue
                    states = identities.states(cluster) if own.analytic else []
                    fields = (self._field(cluster, at) if moving else 0 * at.state[1] for at in states)
                    if not states or not all(map(partial(self._holds, own), states, fields)):
                        return False
        except NO_VALUE:  # rows with the slip of a tyre have no value at rest
            return False
        return True

    def _holds(self, own: Local, at: At, X: Array) -> bool:
        """Return whether a row is J (u − X) at any speeds."""
        (q, u, a, time), J = at.state, at.entry(own, "J")[0]
        if own.holonomic:
            # Those on positions are linear in the speeds, and hold at those of the state.
            speeds, V = u, 0 * J[:, 0]
        else:
            factors = BALLS.of(RandomNumbers(7).uniform(0.5, 1.5, len(u)))
            speeds = X + factors * (u - X)
            V = own.run("dynamics", (q, speeds, a, time), BALLS)["V"]
        return not np.any(excludes_zero(V - BALLS.multiplied(J, (speeds - X)[own.columns, None])[:, 0]))

    # --- one force --------------------------------------------------------------------------------------------------

    def _kind(self, element: Acting) -> Kind:
        """Return the effect of a force on the energy."""
        if element.stored:
            return "damping" if element.damped else "potential"
        try:
            with many_bits():
                kind = self._asked(element) if element.analytic else "other"
                if kind != "other" or not self._resists(element):
                    return kind
                return "drag" if self._drag.works(element.path) else "potential"
        except NO_VALUE:
            return "other"

    def _resists(self, element: Acting) -> bool:
        """Return whether a written force gives no energy to any motion near the reference, which is at rest."""
        at_rest = not np.any(self.motion.u) and not self._moves
        if not (element.written and at_rest and np.all(self._drag.resists(element.path))):
            return False
        known = self._drag.potential(element.path)
        if known is None:
            found = [_resting(own, at)["K"] for at, own in self._at(element)]
            return bool(found) and all(same(K, K.T) for K in found)
        return known

    @cached_property
    def _drag(self) -> Drag:
        return Drag(self.system, self.motion.q, self.motion.time)

    def _asked(self, element: Acting) -> Kind:
        """Return the effect of a force on the energy, from its derivatives at some states."""
        kind: Kind = "potential"
        found = list(self._at(element))
        if not found:
            return "other"
        damping: Array | None = None
        for at, own in found:
            rest, moving = _resting(own, at), {key: at.entry(own, key)[0] for key in "KR"}
            if not same(rest["K"], rest["K"].T):
                return "other"
            if not np.any(moving["R"] != 0):
                continue
            kind = "powerless" if kind == "potential" else kind
            if kind == "powerless" and not _works_not(at, own, at.state[1][own.columns]):
                kind = "damping"
            if kind == "damping":
                damping = moving["R"] if damping is None else damping
                if not (same(damping, moving["R"]) and same(rest["K"], moving["K"])):
                    return "other"
        return "other" if damping is not None and not not_negative(damping) else kind

    def _no_relative_work(self, element: Acting) -> bool:
        """Return whether a force that does no work does none in the co-moving frame either."""
        if self.generator is None:
            return True
        with many_bits():
            return self._coefficients is not None and all(
                _works_not(at, own, self._field(at.cluster, at)[own.columns]) for at, own in self._at(element)
            )

    def _turns_along(self, element: Acting) -> bool:
        """Return whether a damper depends only on speeds relative to the motion."""
        if self.generator is None:
            return True
        if self._coefficients is None:
            return False
        with many_bits():
            for at, own in self._at(element):
                X = self._field(at.cluster, at)[own.columns][:, None]
                if np.any(excludes_zero(BALLS.multiplied(at.entry(own, "R")[0], X))):
                    return False
        return True

    # --- time backwards ---------------------------------------------------------------------------------------------

    @cached_property
    def reversible(self) -> bool:
        """Whether the equations are reversible in time: forces are even in the speeds, rows odd."""
        return self.rows_at_rest and all(self._even(e) for kind in self.kinds.values() for e in kind)

    def _even(self, element: Acting) -> bool:
        if element.stored:
            return not element.damped
        if not element.analytic:
            return False
        try:
            with many_bits():
                found = [
                    (at.entry(own, "F")[0], own.run("dynamics", (q, -u, a, time), BALLS)["F"])
                    for at, own in self._at(element)
                    for q, u, a, time in [at.state]
                ]
                return bool(found) and all(same(*x) for x in found)
        except NO_VALUE:
            return False


def _resting(own: Local, at: At) -> Results:
    """Return the derivatives of a force at rest, at the same place."""
    q, u, a, time = at.state
    return own.run("linearize", (q, 0 * u, 0 * a, time), BALLS)


def _works_not(at: At, own: Local, along: Array) -> bool:
    """Return whether the part of a force that depends on speeds does no work along a direction."""
    q, u, a, time = at.state
    moving, still = at.entry(own, "F")[0], own.run("dynamics", (q, 0 * u, a, time), BALLS)["F"]
    return not np.any(excludes_zero(np.array([(moving - still) @ along])))


def same(one: Array, other: Array) -> bool:
    """Return whether numbers may be equal."""
    return not np.any(excludes_zero(one - other))


def acts_symmetrically(element: Acting, q: list[Any], time: float) -> tuple[bool, bool] | None:
    """Return whether a force at rest damps and whether it has gyroscopic terms; None if it is neither, nor stiffness.

    Parameters
    ----------
    element : Acting
        With numbers in balls.
    q : list of balls, length n_q
    time : float (s)
    """
    try:
        with many_bits():
            still = [0] * len(q)
            K, R = (
                np.array([[as_ball(x) for x in row] for row in A], dtype=object)
                for A in element.slopes(q, still, still, time, BALLS.f)
            )
            if not (same(K, K.T) and not_negative(R)):
                return None
            return not same(R, -R.T), not same(R, R.T)
    except NO_VALUE:
        return None
