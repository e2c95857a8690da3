"""Elements that conserve, dissipate or supply energy, by structure.

In the frame of a steady motion with the field X(q), the function E − p_X (the energy at rest, where
X = 0; the integral of Jacobi in a turning frame) is

* conserved, if every force has a potential or does no work, and the constraint rows are
  homogeneous in the speeds relative to X: then reactions do no work on u − X;
* not increasing, if there are also dampers between points and joints, which depend on speeds
  relative to X only.

A built-in spring is known to have a potential and a dissipation function. Other forces are
evaluated at states spread over the scene: a force has a potential if its ∂F/∂q is symmetric and it
does not depend on speeds; it does no work if F·u = 0; it damps if ∂F/∂u is a constant matrix with a
positive semidefinite symmetric part. About a rest a written force may also depend on speeds in any
other way, if its power is not positive near it (`mbstab.analysis.verdict.drag`).
"""

from __future__ import annotations

from functools import cached_property
from typing import Any, Literal

import numpy as np

from mbstab.analysis.algebra.rounded import rounded_arithmetic, value_and_error
from mbstab.analysis.algebra.sparse import unchanged
from mbstab.analysis.reference.element_comparison import Digits, State, numbers
from mbstab.analysis.reference.rounded_scene import rounded_system
from mbstab.analysis.reference.steady import Generator
from mbstab.analysis.reference.symmetries import Invariance
from mbstab.analysis.reference.tolerances import TOLERANCES as REFERENCE
from mbstab.analysis.verdict.drag import Drag
from mbstab.compiler.placed import Acting
from mbstab.compiler.system import Array, System
from mbstab.errors import MbstabError

Kind = Literal["potential", "powerless", "damping", "drag", "other"]


class Work:
    """The work of the elements of a scene in the frame of a steady motion.

    Parameters
    ----------
    invariance : Invariance
        Symmetries of the scene.
    generator : Generator or None
        The steady motion that defines the frame of the energy; None: the ground.
    """

    def __init__(self, invariance: Invariance, generator: Generator | None) -> None:
        self.invariance, self.generator = invariance, generator
        self.system, self.motion = invariance.system, invariance.motion

    def _field(self, q: Array) -> Array:
        return np.zeros_like(q) if self.generator is None else self.generator.field(q)

    # --- the energy -------------------------------------------------------------------------------------------------

    @cached_property
    def kinds(self) -> dict[Kind, list[Acting]]:
        """The forces of the scene by their effect on the energy in the ground frame."""
        found: dict[Kind, list[Acting]] = {"potential": [], "powerless": [], "damping": [], "drag": [], "other": []}
        for element in self.invariance.elements:
            if not element.inertia:
                found[self._kind(element)].append(element)
        return found

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
        """The paths of drag: written forces that take energy from every motion near the reference, which is at rest."""
        return frozenset(element.path for element in self.kinds["drag"])

    @cached_property
    def decreases(self) -> bool:
        """Whether the energy in the co-moving frame never increases."""
        return self._relative and all(self._turns_along(element) for element in self.kinds["damping"])

    @cached_property
    def decreases_beside_states(self) -> bool:
        """Whether it never increases whatever the rates of first-order states are: their rows take no force."""
        return self._without_work(self.system.bodily) and all(
            self._turns_along(element) for element in self.kinds["damping"]
        )

    @cached_property
    def rows_at_rest(self) -> bool:
        """Whether all constraint rows are homogeneous in the speeds: rest satisfies them everywhere."""
        return self._homogeneous(np.zeros_like, self.system)

    @cached_property
    def led_at_rest(self) -> bool:
        """Whether rest satisfies all rows everywhere, whatever the rates of states that only follow are."""
        columns, rows = self.system.states
        followers = rows[np.isin(columns, self.system.following)]
        return self._homogeneous(np.zeros_like, self.system, np.delete(np.arange(self.system.n_c), followers))

    @cached_property
    def _relative(self) -> bool:
        """Whether undamped forces and rows do no work in the co-moving frame."""
        return self._without_work(self.system)

    def _without_work(self, system: System) -> bool:
        """Whether undamped forces and the rows of a system do no work in the co-moving frame."""
        return (
            not self.kinds["other"]
            and self._homogeneous(self._field, system)
            and all(self._no_relative_work(element) for element in self.kinds["powerless"])
        )

    def _homogeneous(self, field: Any, system: System, rows: Any = slice(None)) -> bool:
        """Whether the rows of a system, or some of them, hold for u = X(q), and are linear in u − X."""
        motion = self.motion
        still = field is np.zeros_like or self.generator is None or not self.generator.moves
        if still and self.invariance.rows_of_places:
            return True
        if not system.n_c or not self.invariance.seen:
            return self.invariance.seen
        for state in self.invariance.on_rows:
            X = field(state.q)
            fast = max(float(np.max(np.abs(x / motion.sizes))) for x in (X, state.u))
            fast = max(fast, REFERENCE.resting_speed * self.invariance.rate)
            try:
                at, there = (
                    state.dynamics
                    if system is self.system and np.array_equal(u, state.u)
                    else system.dynamics(state.q, u, motion.time)
                    for u in (X, X + 2.0 * (state.u - X))
                )
            except MbstabError:  # rows with the slip of a tyre have no value at rest
                return False
            if not np.any(X) and np.any(at.V[rows]):
                return False  # a row that rest does not satisfy is not rounding
            allowed = self.invariance.agreed * fast * (abs(at.J) @ motion.sizes)[rows]
            if np.any(np.abs(at.V[rows]) > allowed) or np.any(np.abs(there.V[rows]) > 2.0 * allowed):
                return False
        return True

    # --- one force --------------------------------------------------------------------------------------------------

    def _kind(self, element: Acting) -> Kind:
        """Return the effect of a force on the energy."""
        if element.stored:
            return "damping" if element.damped else "potential"
        try:
            with Digits(element) as f:
                kind = self._asked(element, f) if element.analytic else "other"
                return "drag" if kind == "other" and self._resists(element, f) else kind
        except (ArithmeticError, ValueError):
            return "other"

    def _resists(self, element: Acting, f: Any) -> bool:
        """Return whether a written force takes energy from all motions near the reference, which is at rest."""
        motion, generator = self.motion, self.generator
        if not element.written or np.any(motion.u) or (generator is not None and generator.moves):
            return False
        if not np.all(self._drag.resists(element.path)):
            return False
        known = self._drag.potential(element.path)
        return self._has_potential(element, f) if known is None else known

    @cached_property
    def _drag(self) -> Drag:
        return Drag(self.system, self.motion.q, self.motion.time)

    def _has_potential(self, element: Acting, f: Any) -> bool:
        """Return whether a force has a potential at rest."""
        for state in self.invariance.states:
            q, zero = numbers(state.q, f), numbers(0.0 * state.q, f)
            if not _symmetric(element.slopes(q, zero, zero, self.motion.time, f)[0], _limit(f)):
                return False
        return bool(self.invariance.states)

    def _asked(self, element: Acting, f: Any) -> Kind:
        """Return the effect of a force on the energy, from its derivatives at some states."""
        limit = _limit(f)
        kind: Kind = "potential"
        slopes = []
        if not self.invariance.states:
            return "other"
        for state in self.invariance.states:
            q, u = numbers(state.q, f), numbers(state.u, f)
            zero = numbers(0.0 * state.q, f)
            K, R = element.slopes(q, u, zero, self.motion.time, f)
            still, _ = element.slopes(q, zero, zero, self.motion.time, f)
            if not _symmetric(still, limit):
                return "other"
            if any(x for row in R for x in row):
                kind = "powerless" if kind == "potential" else kind
                slopes.append((R, K, still))
                if kind == "powerless" and not self._powerless(element, q, u, zero, f, limit):
                    kind = "damping"
        errors = self._errors(element)
        if errors is None or (kind == "damping" and not _damps(slopes, limit, errors)):
            return "other"
        return kind

    def _errors(self, element: Acting) -> list[list[float]] | None:
        """Return the error bounds of ∂F/∂u at the reference; None where an entry may be zero by rounding alone."""
        motion, f = self.motion, rounded_arithmetic()
        states = motion.q.tolist(), motion.u.tolist(), [0.0] * len(motion.q)
        _, R = self._rounded[id(element)].slopes(*states, motion.time, f)
        pairs = [[value_and_error(x) for x in row] for row in R]
        return None if any(e and not v for row in pairs for v, e in row) else [[e for _, e in row] for row in pairs]

    @cached_property
    def _rounded(self) -> dict[int, Acting]:
        """The elements with error bounds of their numbers, by the identity of the plain ones."""
        return {
            id(element): other
            for element, other in zip(self.invariance.elements, rounded_system(self.system).acting(), strict=True)
        }

    def _powerless(self, element: Acting, q: Any, u: Any, zero: Any, f: Any, limit: float) -> bool:
        """Return whether the velocity-dependent part of a force does no work: with all speeds, and each one and two."""
        moving = element.force(q, u, zero, self.motion.time, f)
        still = element.force(q, zero, zero, self.motion.time, f)
        work = [(x - y) * u[i] for i, x, y in zip(element.columns, moving, still, strict=True)]
        if not abs(sum(work)) <= limit * sum(abs(x) for x in work):
            return False
        n = len(element.columns)
        for i in range(n):
            for j in range(i + 1):
                # A small part must not be lost beside a large one: derivatives keep it.
                speeds = [x if k in (element.columns[i], element.columns[j]) else 0 * x for k, x in enumerate(u)]
                _, R = element.slopes(q, speeds, zero, self.motion.time, f)
                if R[i][i] or R[j][j] or abs(R[i][j] + R[j][i]) > limit * (abs(R[i][j]) + abs(R[j][i])):
                    return False
        return True

    def _no_relative_work(self, element: Acting) -> bool:
        """Return whether a force that does no work does none in the co-moving frame either."""
        if self.generator is None:
            return True
        if not self.invariance.states:
            return False
        zero = 0.0 * self.motion.q
        for state in self.invariance.states:
            X = self._field(state.q)
            moving = element.force(state.q, state.u, zero, self.motion.time)
            still = element.force(state.q, zero, zero, self.motion.time)
            work = [(x - y) * X[i] for i, x, y in zip(element.columns, moving, still, strict=True)]
            if abs(sum(work)) > REFERENCE.force_change * sum(abs(x) for x in work):
                return False
        return True

    def _turns_along(self, element: Acting) -> bool:
        """Return whether a damper depends only on speeds relative to the motion."""
        if self.generator is None:
            return True
        if not self.invariance.states:
            return False
        sizes, zero = self.motion.sizes[list(element.columns)], 0.0 * self.motion.q
        change = size = 0.0
        for state in self.invariance.states:
            X = self._field(state.q)
            one, other = (
                np.array(element.force(state.q, u, zero, self.motion.time), dtype=float) * sizes
                for u in (state.u, state.u + X)
            )
            change = max(change, float(np.max(np.abs(one - other))))
            size = max(size, float(np.max(np.abs(one) + np.abs(other))))
        return change <= REFERENCE.force_change * size

    # --- time backwards ---------------------------------------------------------------------------------------------

    @cached_property
    def reversible(self) -> bool:
        """Whether the equations are reversible in time: forces are even in the speeds, rows odd."""
        return self._rows_odd() and all(self._even(e) for e in self.invariance.elements)

    def _rows_odd(self) -> bool:
        if self.invariance.rows_of_places:
            return True
        odd = all(self.invariance.satisfies(state.q, -state.u) for state in self.invariance.on_rows)
        return odd and self.rows_at_rest

    def _even(self, element: Acting) -> bool:
        if element.inertia or element.stored:
            return not element.damped
        if not self.invariance.states or not element.analytic:
            return False
        identity = unchanged(len(self.motion.q))
        return all(
            self.invariance.same(element, state, State(state.q, -state.u, state.a), identity, exact=True)
            for state in self.invariance.states
        )


def acts_symmetrically(
    element: Acting, q: Array, time: float, states: dict[bool, list[Any]]
) -> tuple[bool, bool] | None:
    """Return whether a force at rest damps and whether it has gyroscopic terms; None if it is neither, nor stiffness.

    Parameters
    ----------
    element : Acting
    q : ndarray, shape (n_q,)
    time : float (s)
    states : dict
        The coordinates in the arithmetics used so far; empty at first.
    """
    try:
        with Digits(element) as f:
            limit = _limit(f)
            place = states.setdefault(f.name == "mpmath", numbers(q, f) if f.name == "mpmath" else q.tolist())
            still = [f.number("0")] * len(q)
            K, R = element.slopes(place, still, still, time, f)
            if not (_symmetric(K, limit) and _takes(R, limit)):
                return None
            each = range(len(R))
            damps = any(R[i][j] + R[j][i] for i in each for j in each)
            return damps, any(R[i][j] != R[j][i] for i in each for j in range(i))
    except (ArithmeticError, ValueError):
        return None


def _limit(f: Any) -> float:
    """Return how closely numbers of an arithmetic agree."""
    return REFERENCE.comparison_exact if f.name == "mpmath" else REFERENCE.force_change


def _symmetric(K: list[list[Any]], limit: float) -> bool:
    """Return whether a matrix is symmetric, each pair of entries relative to their own size."""
    n = len(K)
    total = max((abs(x) for row in K for x in row), default=0)
    floor = 0 if limit < 1e-20 else 1e-14 * total
    return all(
        abs(K[i][j] - K[j][i]) <= limit * (abs(K[i][j]) + abs(K[j][i])) + floor for i in range(n) for j in range(i)
    )


def _damps(slopes: list[tuple[Any, Any, Any]], limit: float, errors: list[list[float]]) -> bool:
    """Return whether ∂F/∂u is the same matrix at all states, with a positive semidefinite symmetric part."""
    first = slopes[0][0]
    for R, K, still in slopes:
        for one, other in ((R, first), (K, still)):
            for row, same in zip(one, other, strict=True):
                if any(abs(x - y) > limit * (abs(x) + abs(y)) for x, y in zip(row, same, strict=True)):
                    return False
    return _takes(first, limit, errors)


def _takes(R: list[list[Any]], limit: float, errors: list[list[float]] | None = None) -> bool:
    """Return whether Σ R_ij u_i u_j ≥ 0 for all u: by elimination, each row in its own unit, however small.

    With error bounds of the numbers in R, what is not zero must be positive beyond them.
    """
    n = len(R)
    rounded = [[abs(R[i][j] + R[j][i]) <= limit * (abs(R[i][j]) + abs(R[j][i])) for j in range(n)] for i in range(n)]
    S = [[0 * R[i][j] if i != j and rounded[i][j] else R[i][j] + R[j][i] for j in range(n)] for i in range(n)]
    units, known = [S[i][i] for i in range(n)], n * limit
    left = [i for i in range(n) if any(S[i])]
    # A zero on the diagonal with a nonzero entry beside it supplies energy in one direction.
    if any(not units[i] > 0 for i in left):
        return False
    spread = 0.0
    if errors is not None and left:
        spread = n * max(2.0 * errors[i][j] / float(units[i] * units[j]) ** 0.5 for i in left for j in left)
    while left:
        k = max(left, key=lambda i: S[i][i] / units[i])
        if S[k][k] <= known * units[k]:  # only rounding is left, as must be off the diagonal, too
            return all(abs(S[i][j]) <= known * (units[i] * units[j]) ** 0.5 for i in left for j in left)
        if not S[k][k] > spread * units[k]:
            return False
        left.remove(k)
        for i in left:
            factor = S[i][k] / S[k][k]
            for j in left:
                S[i][j] = S[i][j] - factor * S[k][j]
    return True
