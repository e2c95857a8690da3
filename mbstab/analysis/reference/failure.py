"""Why no equilibrium or steady motion was found, in words."""

from __future__ import annotations

import math
from copy import copy
from typing import Protocol

import numpy as np

from mbstab.analysis.algebra.arrays import Flags
from mbstab.analysis.algebra.failures import FAILURES
from mbstab.analysis.reference.assembly import unclosed, unit_of_row
from mbstab.analysis.reference.equations import State
from mbstab.analysis.reference.imbalance import force_change, force_rounding, rate_rounding
from mbstab.analysis.reference.motion import Finder
from mbstab.analysis.reference.newton import Search, Stalled
from mbstab.analysis.reference.refusals import inertias_too_far_apart, turns_and_degrees
from mbstab.analysis.reference.steady import Family, not_round
from mbstab.analysis.reference.tolerances import TOLERANCES
from mbstab.compiler.system import Array, System
from mbstab.errors import EquilibriumError, MbstabError, ModelFileError, counted
from mbstab.model.scene import Scene
from mbstab.model.schema import is_length

STRATEGIES = ("Newton", "relaxation", "valley", "spin-up")
"""What leads to a solution, in the order in which it is tried."""


def excess(search: Search, at: State) -> Array:
    """Return the imbalance of each coordinate relative to what rounding of the forces that balance may leave.

    Those forces are the ones along the coordinate itself, so that large ones elsewhere hide nothing. Multipliers spread
    an imbalance over all coordinates that rows couple, and have a rounding of their own, which rows carry.
    """
    system, energy, sizes = search.system, search.balance.energy, search.sizes
    free = search.balance.unconstrained(at.J)
    projector = free @ free.T
    left = np.abs(projector @ at.residual[: system.n_q]) * energy
    transmitted = np.abs(at.J.T) @ np.abs(at.nu[search.balance.rows])
    allowed = TOLERANCES.residual * (system.loads(at.q, at.u, at.a) + transmitted) * sizes
    if np.any(left > allowed):
        # Where all loads vanish, the forces are only the effect of rounded coordinates and data.
        state = at.q, at.u, at.a, at.nu
        rounding = TOLERANCES.coordinate_rounding * force_change(system, state, sizes, sizes)
        allowed += np.minimum(np.maximum(rounding, force_rounding(system, state) * sizes), TOLERANCES.residual * energy)
        allowed = np.maximum(allowed, np.abs(projector) @ allowed)
    found: Array = left / np.maximum(allowed, 1e-300)
    return found


def undetermined(search: Search, at: State) -> tuple[Array, float]:
    """Return a motion along which forces do not balance although no step leads along it, and the work left there.

    Beside stiffness that is very much larger the steps leave out what holds a soft motion. The stiff springs do not
    change along it, so the rounding of their forces is no excuse there: what is left must be rounding of the loads.

    Returns
    -------
    motion : ndarray, shape (n_q,)
        Of unit length, relative to the sizes of the coordinates; zero: there is none.
    work : float (J)
        The imbalance along it.
    """
    system, energy, sizes, n = search.system, search.balance.energy, search.sizes, search.system.n_q
    loose = search.balance.equations(at).unmoved
    if not loose.size:
        return np.zeros(n), 0.0
    work = (loose.T @ at.residual[:n]) * energy
    transmitted = np.abs(at.J.T) @ np.abs(at.nu[search.balance.rows])
    loads = TOLERANCES.residual * (system.loads(at.q, at.u, at.a) + transmitted) * sizes
    loads += force_rounding(system, (at.q, at.u, at.a, at.nu)) * sizes
    K, R, _ = system.linearize(at.q, at.u, at.a, at.nu)
    change = np.abs((loose.T * sizes) @ K) @ sizes + np.abs((loose.T * sizes) @ R) @ np.abs(at.u)
    allowed = np.abs(loose.T) @ loads + TOLERANCES.coordinate_rounding * change
    beyond = np.abs(work) - allowed
    if not np.any(beyond > 0.0):
        return np.zeros(n), 0.0
    worst = int(np.argmax(beyond))
    return loose[:, worst], float(work[worst])


class Asked(Protocol):
    """What was looked for: `mbstab.analysis.reference.equilibrium.Problem`."""

    system: System
    scene: Scene
    finder: Finder
    family: Family
    held: Flags

    @property
    def start(self) -> Array: ...  # noqa: D102
    def rates(self, q: Array) -> Array: ...  # noqa: D102


class Failure:
    """A search that found no solution.

    Parameters
    ----------
    problem : Asked
    search : Search
    """

    def __init__(self, problem: Asked, search: Search) -> None:
        self.search, self.finder, self.family, self.rates = search, problem.finder, problem.family, problem.rates
        self.system, self.scene, self.held, self.start = problem.system, problem.scene, problem.held, problem.start

    def error(self, state: State | None, cause: MbstabError | None = None) -> MbstabError:
        """Return what to say of a search that ended at a state, or nowhere; `cause` refused the state that it found.

        Where the mechanism does not close at the start, the error is that of a reference that is not searched for.
        """
        what = "steady motion" if self.family.size else "equilibrium"
        place = self.scene.model.reference.location
        if state is None:
            return EquilibriumError(
                f"{place}: reference: no {what} found: the equations have no value at the start\n"
                "hint: give starting values under reference.guess that are nearer to an assembled position"
            )
        state = self._closer(state)
        steps = counted(self.search.iterations, "step")
        tried = ", ".join(STRATEGIES if self.search.balance.known else STRATEGIES[:3])
        lines = [f"{place}: reference: no {what} found in {steps} ({tried})"]
        said, hint = self._reason(state, cause)
        lines.append(said)
        flat = [
            body.name
            for body, part in zip(self.scene.bodies, self.system.body_slices, strict=True)
            if len(body.coordinates) == 6 and abs(math.cos(state.q[part.start + 4])) < TOLERANCES.euler_cosine_warned
        ]
        if flat:
            lines.append(f"the Euler angles of {', '.join(map(repr, flat))} are singular there")
            hint = "give them another base rotation with axes: [phi, theta, psi], so that theta stays away from pi/2"
        M = self.system.bodily.dynamics(state.q, 0.0 * state.q, self.scene.time).M
        if apart := inertias_too_far_apart(self.system, M, self.search.sizes):
            return EquilibriumError("\n".join([*lines, apart]))
        open_there = self._gap_of(state) > TOLERANCES.gap_of_constraints
        if open_there and (problems := unclosed(self.system, self.finder.sizes, self.start, ~self.held)):
            return ModelFileError(problems)
        if pulled := self._nothing_holds(state):
            lines.append(f"no spring or joint resists {pulled}: the net force along it does not depend on position")
            hint = "hold it with a joint, a spring or a contact; a body in free fall has no equilibrium"
        elif drained := self._drained(state):
            lines.append(drained)
            hint = "hold the speed by a drive, such as {type: coordinate, coordinate: body.psi, velocity: …}"
        return EquilibriumError("\n".join([*lines, f"hint: {hint}{turns_and_degrees(self.scene)}"]))

    def _reason(self, state: State, cause: MbstabError | None) -> tuple[str, str]:
        """Return why a state is no solution, and a hint. An imbalance that may be rounding is no reason."""
        load = np.abs(state.residual[: self.system.n_q])
        balanced = bool(np.max(load, initial=0.0) <= TOLERANCES.residual)
        if balanced:
            load = excess(self.search, state)
            balanced = bool(np.all(load <= 1.0))
            if balanced and (found := self._beside_stiffness(state)):
                return found
        found = self._broken_row(state, balanced) or self._without_effect(state) or self._wrong_rate(state, balanced)
        if found:
            return found
        if moving := self._moving_row(state):
            return (
                f"{moving} is not satisfied at rest: it drives the mechanism",
                "look for a steady motion with find: steady, or choose a time at which the drive rests",
            )
        if not balanced:
            return self._unbalanced(state, int(np.argmax(load)))
        return self._left_out(state) or (
            "forces balance, but " + (str(cause) if cause else "the iteration did not converge"),
            "other starting values under reference.guess, or --starts 20",
        )

    def _beside_stiffness(self, state: State) -> tuple[str, str] | None:
        """Return what to say where a stiffness leaves no digits for the forces along softer motions, and a hint."""
        motion, work = undetermined(self.search, state)
        if not work:
            return None
        sizes, still = self.search.sizes, np.zeros(self.system.n_c)
        slopes = {
            path: float(np.max(np.abs(part.linearize(state.q, state.u, state.a, still)[0]) * np.outer(sizes, sizes)))
            for path, part in self.system.parts()
        }
        stiffest = max(slopes, key=lambda path: slopes[path])
        along = [self.system.names[i] for i in np.argsort(-np.abs(motion))[:4]]
        worst = int(np.argmax(np.abs(motion)))
        unit = "N" if self.finder.is_length[worst] else "N*m"
        force = f"{abs(work * motion[worst]) / sizes[worst]:.4g} {unit} on {self.system.names[worst]}"
        said = (
            f"the stiffness of {stiffest} ({slopes[stiffest]:.3g} J over the size of the scene) leaves no digits for "
            f"softer motions: {force}, is out of balance along {', '.join(along)} ({abs(work):.4g} J over the scene)"
        )
        return said, "put a joint in place of what is that stiff, or give it a stiffness nearer to the others"

    def _unbalanced(self, state: State, worst: int) -> tuple[str, str]:
        """Return what to say of forces that do not balance along a coordinate, and a hint."""
        name, force = self.system.names[worst], state.residual[worst] * self.search.balance.energy
        left = f"{abs(float(force)) / self.search.sizes[worst]:.4g} {'N' if is_length(name) else 'N*m'}"
        ways = np.abs(state.q - self.start) / self.finder.sizes
        far = int(np.argmax(ways))
        if ways[far] > TOLERANCES.search_ran_off:
            there = f"{self.system.names[far]} = {state.q[far]:.6g} {self.system.units[far]}"
            said = f"the iteration diverged to {there} without a balance of forces: {left} unbalanced on {name}"
        else:
            said = f"no balance of forces was found: at best, {left} unbalanced on {name}"
        hint = "other starting values under reference.guess, or --starts 20"
        given = [name for name, held in zip(self.system.names, self.held, strict=True) if held]
        given += [f"rates.{self.system.names[i]}" for i in self.search.balance.given]
        if given:
            shown = f"{', '.join(given[:6])}{' …' if len(given) > 6 else ''}"
            hint += f"; given are {shown}: a guess leaves them free"
        return said, hint

    def _broken_row(self, state: State, balanced: bool) -> tuple[str, str] | None:
        """Return the constraint that is not satisfied where a search ended, and a hint.

        While forces are out of balance, a search may have left constraints a little; where they balance, it did not.
        """
        n, balance = self.system.n_q, self.search.balance
        gap = np.abs(state.residual[n : n + balance.n_h])
        if np.max(gap, initial=0.0) <= (TOLERANCES.residual if balanced else TOLERANCES.gap_of_constraints):
            return None
        i = balance.rows[int(np.argmax(gap))]
        hint = "correct the lengths, or give starting values under reference.guess"
        if self.held.any() or len(balance.given):
            hint = "correct or leave out the coordinates that are given, or the lengths"
        if np.max(gap) > TOLERANCES.gap_of_constraints:
            return f"it stalled where {self.system.rows[i]} is not satisfied: the mechanism does not close there", hint
        row = self.system.dynamics(state.q, 0.0 * state.q, self.scene.time).J[i]
        against = [name for name, held, x in zip(self.system.names, self.held, row, strict=True) if held and x]
        if against:
            hint = f"leave out {' or '.join(against)}, which is given, or put it under reference.guess"
        return f"forces balance, but {self._gap(state, i)}", hint

    def _left_out(self, state: State) -> tuple[str, str] | None:
        """Return a constraint that repeated others where a search began, and is not satisfied where it ended."""
        at = self.system.dynamics(state.q, 0.0 * state.q, self.scene.time)
        n_h = self.system.n_h
        beyond = np.abs(at.E[:n_h]) / (TOLERANCES.residual * np.abs(at.J[:n_h]) @ self.finder.sizes + 1e-300)
        if np.max(beyond, initial=0.0) <= 1.0:
            return None
        return (
            "the search began at a singular position, where constraints repeat each other that are independent beside "
            f"it; forces balance only where {self._gap(state, int(np.argmax(beyond)))}",
            "eigenvalues do not exist at a singular position, such as that of a stretched linkage: give starting "
            "values away from it under reference.guess, or other lengths",
        )

    def _gap(self, state: State, i: int) -> str:
        """Return in words how far a constraint is from being satisfied."""
        row, left = self.system.rows[i], self.system.dynamics(state.q, 0.0 * state.q, self.scene.time).E[i]
        return f"{row} is not satisfied: {row.residual} is {left:.4g}{unit_of_row(self.system, row)}"

    def _without_effect(self, state: State) -> tuple[str, str] | None:
        """Return a state that acts on nothing, and whose rate nothing can therefore bring to zero, and a hint."""
        states, rows = self.system.states
        if np.any(state.u) or not len(states):
            return None
        K, R, D_q = self.system.linearize(state.q, state.u, state.a, state.nu)
        at = self.system.dynamics(state.q, state.u)
        acts = np.any(K[:, states], axis=0) | np.any(R[:, states], axis=0) | np.any(D_q[:, states], axis=0)
        acts |= np.sum(at.J[:, states] != 0.0, axis=0) > 1
        # Its row is one more condition on the others: the search may end where it holds and forces do not balance.
        asked = np.any(D_q[rows - self.system.n_h], axis=1) | (at.V[rows] != 0.0)
        loose = np.flatnonzero(asked & ~acts)
        if not len(loose):
            return None
        said = (
            f"the state {self.system.names[states[loose[0]]]} acts on nothing here, and its rate does not come to zero"
        )
        return said, "with a gain of 0 it integrates without end: leave the gain out, or give another value"

    def _wrong_rate(self, state: State, balanced: bool) -> tuple[str, str] | None:
        """Return the given rate or the constraint that does not fit the motion where a search ended, and a hint."""
        n, n_h, balance = self.system.n_q, self.search.balance.n_h, self.search.balance
        speeds, rates = np.split(np.abs(state.residual[n + n_h :]), [len(balance.rows) * balance.with_speeds])
        largest = max((float(np.max(x, initial=0.0)) for x in (speeds, rates)), default=0.0)
        allowed = TOLERANCES.residual if balanced else max(1e-6, float(np.max(np.abs(state.residual[:n]))))
        if largest <= allowed:
            return None
        if len(rates) and float(np.max(rates)) == largest:
            i = self.search.balance.given[int(np.argmax(rates))]
            said = f"the given rate of {self.system.names[i]} does not belong to the motion ({state.steady})"
            if hint := not_round(self.system, i):
                return said, hint
        else:
            row = self.system.rows[self.search.balance.rows[int(np.argmax(speeds))]]
            if row.section == "states" and not np.any(state.u):
                said = f"the rate of the state {row.name} is not zero at rest"
                return said, "leave out coordinates that are given: they settle where the rate is zero"
            said = f"the motion ({state.steady}) does not satisfy {row}: it drives, blocks or slips"
            if row.section == "drives":
                i, at = self.system.rows.index(row), self.system.dynamics(state.q, state.u, self.scene.time)
                unit = unit_of_row(self.system, row, "/s" if i < self.system.n_h else "")
                moved = float(at.J[i] @ state.u)
                said = (
                    f"the motion ({state.steady}) does not satisfy {row}: at t = {self.scene.time:g} s it gives "
                    f"{moved - float(at.V[i]):.4g}{unit}, and the motion has {moved:.4g}{unit}"
                )
                if self.scene.timed:
                    return said, "give reference.time, at which the drive has its rate: initial.time may be earlier"
        return said, "correct reference.steady or the given rates: axis, point and rate must be those of the mechanism"

    def _closer(self, state: State) -> State:
        """Return a state that satisfies the holonomic constraints, if there is one near this one or the start."""
        for start in (state.q, self.start):
            if self._gap_of(state) <= TOLERANCES.gap_of_constraints:
                break
            try:
                closed = self.search.state(
                    start if self.held.all() else self.finder.assemble(start, ~self.held), state.c
                )
            except FAILURES:
                continue
            state = closed if self._gap_of(closed) <= TOLERANCES.gap_of_constraints else state
        return state

    def _gap_of(self, state: State) -> float:
        """Return the largest residual of the holonomic constraints at a state."""
        n = self.system.n_q
        return float(np.max(np.abs(state.residual[n : n + self.search.balance.n_h]), initial=0.0))

    def _moving_row(self, state: State) -> str:
        """Return a row that a state at rest does not satisfy, in words."""
        if np.any(state.u):
            return ""
        V = np.abs(self.system.dynamics(state.q, state.u).V)
        V[self.system.states[1]] = 0.0  # their rates are no motion, and are looked at before
        V[rate_rounding(self.system, state.q, state.u) >= V] = 0.0
        return str(self.system.rows[int(np.argmax(V))]) if np.any(V) else ""

    def _nothing_holds(self, state: State) -> str:
        """Name a coordinate on which a force acts that depends on no position and that no constraint carries."""
        sizes, load = self.finder.sizes, np.abs(state.residual[: self.system.n_q])
        places = (state.q, state.q + TOLERANCES.other_position * sizes)
        try:
            changes = sum(np.abs(self.system.linearize(q, state.u, state.a, state.nu)[0]) for q in places)
        except FAILURES:
            return ""
        weights = np.max(changes * np.outer(sizes, sizes), axis=0)
        loose = (load >= 1e-6) & (weights <= 1e-9 * np.max(weights)) & ~np.any(state.J, axis=0)
        return self.system.names[int(np.argmax(np.where(loose, load, 0.0)))] if np.any(loose) else ""

    def _drained(self, state: State) -> str:
        """Return what takes power at the given rates where neither a force nor a row gives any, in words."""
        time = self.scene.time
        if not self.family.size or not any(self.scene.rates.values()):
            return ""
        q = self._at_given_rates(state)
        u = self.family.basis(q) @ self.rates(q)
        if np.any(self.system.dynamics(q, 0.0 * u, time).V):
            return ""
        taken, given, size = dict[str, float](), 0.0, 0.0
        for path, part in self.system.parts():
            moving, still = part.dynamics(q, u, time), part.dynamics(q, 0.0 * u, time)
            if np.any(moving.M):  # its inertia does no work in a steady motion
                continue
            taken[path] = float((moving.F0 - still.F0) @ u)
            given -= float(still.F0 @ u)
            size += float(np.abs(moving.F0) @ np.abs(u))
        total = sum(taken.values(), 0.0)
        if total <= 2.0 * given or total <= TOLERANCES.coordinate_rounding * size:
            return ""
        most = max(taken, key=lambda path: taken[path])
        return f"{most} takes {taken[most]:.3g} W from the motion there, and nothing gives any: it slows down"

    def _at_given_rates(self, state: State) -> Array:
        """Return where forces balance while something holds the given rates; where the search ended if nowhere."""
        search, balance = copy(self.search), copy(self.search.balance)
        balance.acting = np.where(np.isin(np.arange(self.system.n_q), balance.given), 0.0, balance.acting)
        search.balance = balance
        try:
            return search.newton(search.state(state.q, state.c)).q
        except (Stalled, *FAILURES):
            return state.q
