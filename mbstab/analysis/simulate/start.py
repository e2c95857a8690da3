"""The consistent start of a simulation: the reference motion, the values of ``initial:``, and disturbances.

Given values are held while the others are moved onto the constraints, as few of them as possible
(`mbstab.analysis.simulate.disturbance`). Where that is impossible, those that differ from the reference are held: they
are the disturbance. Where that is impossible, too, everything is moved by the least change in the metric of the masses.
A warning tells by how much given values were moved. Values
that no state has, whatever the others are, and those far from every state found are errors.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import field, replace
from typing import Any

import numpy as np

from mbstab.analysis.algebra.arrays import Complex, Flags, norms
from mbstab.analysis.algebra.rank import rank_of
from mbstab.analysis.algebra.sparse import dense
from mbstab.analysis.reference.attitude import Attitudes
from mbstab.analysis.reference.efforts import Placement
from mbstab.analysis.reference.motion import Finder, Motion
from mbstab.analysis.reference.requested import reference_motion
from mbstab.analysis.simulate.balanced import balanced
from mbstab.analysis.simulate.constrained import Constrained
from mbstab.analysis.simulate.disturbance import Quantity, coordinates, reached, read_name, speeds, staying
from mbstab.analysis.simulate.tolerances import TOLERANCES
from mbstab.compiler.system import Array, System
from mbstab.errors import EquilibriumError, MbstabError, ModelFileError, UsageError, alternatives, amount
from mbstab.model.arithmetic import FLOAT
from mbstab.model.expressions import ExpressionError
from mbstab.model.parameters import with_unit
from mbstab.model.schema import parse_finite
from mbstab.model.units import parse_unit, per_second
from mbstab.records import dataclass

_MODE = re.compile(r"mode:\s*([0-9]{1,6})")


@dataclass(frozen=True)
class Start:
    """The state at which a simulation starts.

    Attributes
    ----------
    system : System
    motion : Motion
        A state that satisfies the constraints, with accelerations and multipliers.
    warnings : tuple of str
    notes : tuple of str
        Coordinates that the constraints have moved too, where this is not obvious.
    """

    system: System
    motion: Motion
    warnings: tuple[str, ...]
    notes: tuple[str, ...] = ()


@dataclass
class _Wanted:
    """A state, and which of its values were requested, in the file or with --perturb.

    Changes of motions of joints, and of their rates, are in `joints` and `joint_rates`.
    """

    q: Array
    u: Array
    held_q: Any
    held_u: Any
    perturbed: set[str] = field(default_factory=set)
    joints: list[tuple[Quantity, float]] = field(default_factory=list)
    joint_rates: list[tuple[Quantity, float]] = field(default_factory=list)


def start_of(
    system: System, perturb: Mapping[str, float | str] | None = None, time: float | None = None, strict: bool = False
) -> Start:
    """Return the state at which a simulation starts.

    Parameters
    ----------
    perturb : mapping, optional
        Changes added to the reference motion: by coordinate such as ``rod.theta``, by motion of a joint such as
        ``angle(pivot)`` or ``displacement(slider)``, by rate such as ``rate(rod.theta)`` or ``rate(angle(pivot))``, or
        by mode such as ``mode:1``, numbers or expressions of the parameters (m, rad, s).
    time : float, optional
        The start (s); that of ``initial:``, else that of the reference, if not given.
    strict : bool
        Refuse given values that the constraints do not allow.

    Raises
    ------
    UsageError, ModelFileError
        If a name is unknown or a value is not a number; if no state near the given values satisfies the constraints, or
        no state at all has one of them; if they have to be moved, and `strict`; if the reference is invalid.
    """
    given = perturb or {}
    if not all(isinstance(value, (int, float, str)) for value in given.values()):
        return _start_of(system, given, time, strict)
    key = tuple((name, type(value), repr(value)) for name, value in given.items()), repr(time), strict
    return system.remember("start", key, lambda: _start_of(system, given, time, strict))


def _start_of(system: System, perturb: Mapping[str, float | str], time: float | None, strict: bool) -> Start:
    scene = system.scene
    q0, u0, motion, told = system.remember("reference", None, lambda: _reference(system))
    plain, (system, motion) = system, balanced(system, motion)
    begin = scene.initial.time if time is None else time
    begin = float(scene.time if begin is None else begin)
    n = system.n_q
    number = {name: i for i, name in enumerate(system.names)}
    wanted = _Wanted(q0.copy(), u0.copy(), np.zeros(n, dtype=bool), np.zeros(n, dtype=bool))
    for values, x, held in (
        (scene.initial.coordinates, wanted.q, wanted.held_q),
        (scene.initial.rates, wanted.u, wanted.held_u),
    ):
        for name, value in values.items():
            x[number[name]], held[number[name]] = float(value), True
    for name, value in perturb.items():
        _disturb(plain, motion, wanted, name, value)
    system = system if begin == scene.time else System(replace(scene, time=begin))
    finder = Finder(system)
    equations = Constrained(system, motion)
    warnings = [told] if told else []
    held = _Held(finder, equations, begin, q0, u0, wanted)
    q, moved = held.positions()
    _check_positions(finder, equations, begin, (q, q0), wanted, moved)
    _report(system, finder, moved, "", strict, warnings)
    u, moved = held.speeds(q)
    _check_speeds(finder, equations, begin, q, u, wanted, moved)
    _check_moving(system, motion, begin, q, u, wanted)
    _report(system, finder, moved, "/s", strict, warnings)
    finder.check_chart(q, np.zeros(n, dtype=bool))
    found = finder.motion(q, u, begin)
    q, u, state = Constrained(system, found).project(begin, q, u)
    found = replace(finder.motion(q, u, begin), dynamics=state)
    return Start(system, found, (*warnings, *dict.fromkeys(found.warnings)), tuple(held.notes))


def _reference(system: System) -> tuple[Array, Array, Motion, str]:
    """Return the reference of the file, which may be out of balance, the motion through it, and a warning or "".

    Where there is no reference, as at the beginning of a run-up, the values of ``initial:`` are enough.
    """
    reference, told = system.scene.model.reference, ""
    finder = Finder(system, massless=True)
    try:
        if reference.find is not None or reference.steady is not None:
            motion = reference_motion(system, massless=True)
            return motion.q, motion.u, motion, told
        q = finder.coordinates()
        u, state = finder.rates(q)
    except (ModelFileError, EquilibriumError) as error:
        if not system.scene.initial.coordinates:
            raise
        if isinstance(error, EquilibriumError):
            why = str(error).partition("\n")[0]
            told = f"the motion starts at the values of initial:, the others near those of the file, as {why}"
        q, _ = finder.start()
        u, state = np.array([system.scene.rates.get(name, 0.0) for name in system.names], dtype=float), None
    return q, u, finder.motion(q, u, state=state), told


# --- disturbances ---------------------------------------------------------------------------------------------------


def _disturb(system: System, motion: Motion, wanted: _Wanted, name: str, value: float | str) -> None:
    """Add a disturbance to a state."""
    if mode := _MODE.fullmatch(name):
        size = _value(system, name, value)
        dq, du = mode_shape(system, motion, int(mode[1]))
        wanted.q += size * dq
        wanted.u += size * du
        return
    quantity, rate = read_name(system, motion.sizes, name)
    size = _value(system, name, value, f"{quantity.unit}/s" if rate else quantity.unit)
    if quantity.joint is not None:
        (wanted.joint_rates if rate else wanted.joints).append((quantity, size))
        return
    wanted.perturbed.add(f"rate({quantity.name})" if rate else quantity.name)
    x, held = (wanted.u, wanted.held_u) if rate else (wanted.q, wanted.held_q)
    x[quantity.number] += size
    held[quantity.number] = True


def _value(system: System, name: str, value: float | str, unit: str = "") -> float:
    """Return the size of a disturbance in SI, whose unit is given; "" for one that has none."""
    parameters = system.scene.parameters
    try:
        if not isinstance(value, str):
            if isinstance(value, bool) or not hasattr(value, "__float__"):
                raise ExpressionError("a disturbance is one number", 0, "a number, or a text with an expression")
            found = float(value)
        else:
            found = _expression(value, unit, parameters)
    except ExpressionError as error:
        hint = f"\nhint: {error.hint}" if error.hint else ""
        raise UsageError(f"--perturb {name}={value}: {error.message}{hint}") from None
    if not np.isfinite(found):
        raise UsageError(f"--perturb {name}={value}: the value is not finite")
    return found


def _expression(text: str, unit: str, parameters: Mapping[str, Any]) -> float:
    """Return what an expression in SI, or a number with a unit of its own such as ``10 deg``, amounts to in SI."""
    try:
        expression = parse_finite(text, parameters)
    except ExpressionError:
        if not unit or (parts := with_unit(text, parameters)) is None:
            raise
        number, own = parts
        factor, dimension = parse_unit(own)
        if dimension != parse_unit(unit)[1]:
            raise ExpressionError(f"{own} is not a unit of it", 0, f"give it in {unit}") from None
        return float(number.evaluate({}, FLOAT)) * factor
    for used in (*expression.names(), *expression.rates()):
        if used not in parameters:
            raise ExpressionError(f"unknown parameter {used!r}", 0, alternatives(used, parameters, "parameters"))
    return float(expression.evaluate(parameters, FLOAT))


def mode_shape(system: System, motion: Motion, number: int) -> tuple[Array, Array]:
    """Return Δq and Δu of a mode, the real part of its shape at an instant.

    The coordinate that moves most, relative to the sizes in the scene, moves by 1 (m or rad) and has its largest
    value at that instant.

    Parameters
    ----------
    number : int
        Number of the mode in ``mbstab eig``, from 1; a pair is one mode, neutral eigenvalues do not count.

    Raises
    ------
    UsageError
        If there is no such mode.
    """
    _, dq, du = complex_mode(system, number)
    return np.real(dq), np.real(du)


def complex_mode(system: System, number: int) -> tuple[complex, Complex, Complex]:
    """Return eigenvalue (1/s; the multiplier of a periodic motion), complex Δq and Δu of a mode, as in `mode_shape`."""
    from mbstab.analysis.linear.linearize import linearize, state_space
    from mbstab.analysis.spectrum.eigenvalues import answer
    from mbstab.analysis.spectrum.states_alone import at_rest_beside_states

    listed = [e for e in answer(system).eigenvalues if not e.exact and e.value.imag >= 0.0]
    if not 1 <= number <= len(listed):
        count = "is 1" if len(listed) == 1 else f"are {len(listed)}"
        raise UsageError(f"no mode {number}: there {count} to choose from, as mbstab eig lists them")
    mode = listed[number - 1]
    motion = reference_motion(system, massless=system.scene.period is None)
    if system.scene.period is not None:
        from mbstab.analysis.spectrum.floquet import monodromy

        around = monodromy(system, motion, float(system.scene.period))
        dq, du = _nearest(around.Phi, mode.multiplier, around.to_coordinates, around.to_rates)
    else:
        linear = linearize(system, motion)
        if mode.vector is not None:
            dq, du = mode.vector, mode.value * mode.vector
        else:
            space, scale = state_space(linear), linear.spaces.scale[:, None]
            dq, du = _nearest(space.A, mode.value, space.to_coordinates, space.to_rates)
            known = np.array([mode.value]), np.array([mode.error_bound])
            dq = (scale * at_rest_beside_states(linear, *known, dq[:, None] / scale))[:, 0]
        if linear.generator is not None and linear.generator.turns:
            du = du + linear.generator.frame(motion.q)[0] @ dq
    relative = np.abs(dq / motion.sizes)
    moves, x = (relative, dq) if np.any(relative > 0.0) else (np.abs(du / motion.sizes), du)
    largest = x[int(np.argmax(moves))]
    value = mode.significant if system.scene.period is None else mode.multiplier
    return complex(value or 0.0), dq / largest, du / largest


def _nearest(matrix: Array, value: complex | None, to_q: Array, to_u: Array) -> tuple[Complex, Complex]:
    """Return Δq and Δu of the eigenvector of a matrix whose eigenvalue is nearest."""
    values, vectors = np.linalg.eig(matrix)
    y = vectors[:, int(np.argmin(np.abs(values - value)))].astype(complex)
    return to_q @ y, to_u @ y


# --- onto the constraints -------------------------------------------------------------------------------------------


class _Held:
    """The search for a state on the constraints with the requested values and as many unchanged ones as possible.

    Attributes
    ----------
    notes : list of str
        Coordinates that the constraints have moved too, where this is not obvious.
    """

    def __init__(self, finder: Finder, equations: Constrained, t: float, q0: Array, u0: Array, wanted: _Wanted) -> None:
        self.finder, self.equations, self.t, self.wanted = finder, equations, t, wanted
        self.q0, self.u0 = q0, u0
        self.system, self.attitudes = finder.system, Attitudes.of(finder.system)
        self.own = coordinates(self.system, finder.sizes)
        self.notes: list[str] = []

    def positions(self) -> tuple[Array, Array]:
        """Return coordinates that satisfy the constraints, and by how much given ones were moved."""
        wanted, equations, t = self.wanted, self.equations, self.t
        goal, none = wanted.q, np.zeros(len(self.q0))
        named = [self.own[i] for i in np.flatnonzero(wanted.held_q)] + [x for x, _ in wanted.joints]
        if not named:
            return (goal, none) if not equations.n_h else self._nearest()
        at = Placement(self.attitudes, self.system, self.q0, self.u0)
        J = self.system.closing.dynamics(self.q0, np.zeros(len(goal)), t).J[: equations.n_h]
        others = staying(at, J, named, self.finder.sizes)
        if wanted.joints:
            q = self._with_joints(at, others)
            self._note(q, named, others)
            return q, none
        if not equations.n_h:
            return goal, none
        for held in (wanted.held_q | np.isin(np.arange(len(goal)), [x.number for x in others]), wanted.held_q):
            q, left = _held(self.finder, equations, t, self.q0, goal, held)
            if left <= TOLERANCES.projection_residual_failed:
                self._note(q, named, others)
                return q, none
        disturbed = self._disturbed(wanted.held_q, goal - self.q0)
        if disturbed is not None:
            q, left = _held(self.finder, equations, t, self.q0, goal, disturbed)
            if left <= TOLERANCES.projection_residual_failed:
                return q, np.where(wanted.held_q, q - goal, none)
        return self._nearest()

    def _disturbed(self, held: Flags, change: Array) -> Flags | None:
        """Return those of given values that differ from the reference, if there are any and not all do."""
        found = held & (np.abs(change) > TOLERANCES.change_told * self.finder.sizes)
        return found if np.any(found) and np.any(held & ~found) else None

    def _nearest(self) -> tuple[Array, Array]:
        """Return the nearest coordinates that satisfy the constraints, and by how much given ones were moved."""
        # Values other than the given ones start where they contradict these least.
        equations, finder, t, wanted = self.equations, self.finder, self.t, self.wanted
        goal, held = wanted.q, wanted.held_q
        q = goal
        if np.any(held):
            q, _ = _held(finder, equations, t, self.q0, goal, held)
        q, left = equations.onto_positions(t, q)
        if not left <= TOLERANCES.projection_residual_failed:
            q = finder.assemble(goal, np.ones(len(goal), dtype=bool))
            q, left = equations.onto_positions(t, q)
        if not left <= TOLERANCES.projection_residual_failed:
            text = (
                f"no state near the initial values satisfies the constraints at t = {t:.9g} s: a residual of "
                f"{amount(left)} of the sizes in the scene is left"
            )
            raise _refused(finder.system, wanted, text, "correct the values, or give those of other coordinates, too")
        return q, np.where(held, q - goal, 0.0)

    def _with_joints(self, at: Placement, others: list[Quantity]) -> Array:
        """Return coordinates on the constraints with given motions of joints."""
        wanted = self.wanted
        asked = [(self.own[i], float(wanted.q[i])) for i in np.flatnonzero(wanted.held_q)]
        asked += [(x, x.value(at) + change) for x, change in wanted.joints]
        # Changes by a mode stay as well.
        moved = Placement(self.attitudes, self.system, wanted.q, wanted.u)
        left = np.inf
        for goals in (asked + [(x, x.value(moved)) for x in others], asked):
            q, left = reached(self.equations, self.attitudes, self.t, self.q0, goals)
            if left <= TOLERANCES.value_reached:
                return self.equations.onto_positions(self.t, q)[0]
        names = ", ".join(x.name for x, _ in wanted.joints)
        raise UsageError(
            f"--perturb {names}: no state near has these values and satisfies the constraints: {amount(left)} of the "
            "sizes in the scene is left\nhint: take a smaller change, or a motion that no drive and no loop determines"
        )

    def speeds(self, q: Array) -> tuple[Array, Array]:
        """Return rates that satisfy the constraints, and by how much given ones were moved."""
        wanted, equations, t = self.wanted, self.equations, self.t
        goal, held, none = wanted.u, wanted.held_u, np.zeros(len(q))
        if np.any(held) or wanted.joint_rates or wanted.joints or np.any(wanted.held_q):
            disturbed = self._disturbed(held, goal - self.u0)
            for chosen in (held,) if disturbed is None else (held, disturbed):
                u, left = self._with_rates(q, chosen)
                if left <= TOLERANCES.projection_residual_failed:
                    return u, np.where(held & ~chosen, u - goal, none)
            if wanted.joint_rates:
                names = ", ".join(f"rate({x.name})" for x, _ in wanted.joint_rates)
                raise UsageError(f"--perturb {names}: the constraints allow no such rates here")
        u, left, _ = equations.onto_velocities(t, q, goal)
        if not left <= TOLERANCES.projection_residual_failed:
            text = (
                f"no rates near the initial values satisfy the constraints at t = {t:.9g} s: a residual of {left:.1e} "
                "of the rates in the scene is left"
            )
            raise _refused(equations.system, wanted, text, "correct the rates")
        return u, np.where(held, u - goal, none)

    def _with_rates(self, q: Array, held: Flags) -> tuple[Array, float]:
        """Return rates with some held, and as many others as possible, and the remaining residual (1/s)."""
        wanted, goal, t = self.wanted, self.wanted.u, self.t
        at = Placement(self.attitudes, self.system, q, goal)
        before = Placement(self.attitudes, self.system, self.q0, self.u0)
        named = [self.own[i] for i in np.flatnonzero(held)] + [x for x, _ in wanted.joint_rates]
        others = staying(at, self.system.bodily.dynamics(q, goal, t).J, named, self.finder.sizes)
        asked = [(self.own[i], float(goal[i])) for i in np.flatnonzero(held)]
        asked += [(x, float(x.gradient(before) @ self.u0) + change) for x, change in wanted.joint_rates]
        best, least = goal, np.inf
        for goals in (asked + [(x, float(x.gradient(before) @ goal)) for x in others], asked):
            u, left = speeds(self.equations, self.attitudes, t, q, goal, goals)
            if goals and left < least:
                best, least = u, left
            if least <= TOLERANCES.projection_residual_failed:
                break
        return best, least

    def _note(self, q: Array, named: list[Quantity], others: list[Quantity]) -> None:
        """Record what was moved although there was a choice: what should stay, and angles that the rest determines."""
        if not others:
            return
        joints = any(x.joint is not None for x in named)
        watched = [x for x in others if x.joint is not None or not joints]
        watched += [x for x in self.own if x.unit == "rad" and x not in others and x not in named and not joints]
        zero = np.zeros(len(q))
        there, here = (Placement(self.attitudes, self.system, x, zero) for x in (self.wanted.q, q))
        changes = [(x, x.value(here, start) - start) for x in watched for start in [x.value(there)]]
        moved = [
            f"{x.name} by {change:.6g} {x.unit}"
            for x, change in changes
            if abs(change) > TOLERANCES.change_told * x.size
        ]
        if moved:
            names = ", ".join(x.name for x in named)
            more = f" and {len(moved) - 6} more" if len(moved) > 6 else ""
            self.notes.append(f"with {names} the constraints move {', '.join(moved[:6])}{more}")


def _held(finder: Finder, equations: Constrained, t: float, q0: Array, goal: Array, held: Any) -> tuple[Array, float]:
    """Return coordinates whose held ones have their goals, followed from `q0`, and the remaining residual."""
    change = goal - q0
    count = int(
        np.clip(np.ceil(np.max(np.abs(change[held] / finder.sizes[held])) / TOLERANCES.value_increment), 1, 200)
    )
    aside = TOLERANCES.symmetric_start_offset * finder.sizes * np.sin(1.0 + np.arange(len(q0)))
    q, left = goal, np.inf
    for way in (0.0, 1.0, -1.0):
        q = q0 + np.where(held, 0.0, change + way * aside)
        for k in range(1, count + 1):
            q = np.where(held, q0 + (k / count) * change, q)
            q = finder.assemble(q, ~held)
        q, left = equations.onto_positions(t, np.where(held, goal, q), held)
        if left <= TOLERANCES.projection_residual_failed:
            break
    return q, left


def _refused(system: System, wanted: _Wanted, text: str, hint: str) -> MbstabError:
    """Return the error about the initial values as a whole."""
    model = system.scene.model
    if wanted.perturbed or not (model.initial.coordinates or model.initial.rates):
        return UsageError(f"--perturb: {text}\nhint: {hint}")
    return ModelFileError([model.document.problem(model.initial.location, "initial", text, hint)])


def _check_positions(
    finder: Finder, equations: Constrained, t: float, starts: tuple[Array, Array], wanted: _Wanted, moved: Array
) -> None:
    """Refuse values that no state has, whatever the others are, and those that had to be moved far.

    `starts` are states from which a value is searched; the first is the one to which the values were moved.
    """
    system, sizes, found = finder.system, finder.sizes, []
    for i in np.flatnonzero(np.abs(moved) > TOLERANCES.change_told * sizes):
        alone = np.arange(len(moved)) == i
        name, unit = system.names[i], system.units[i]
        near = f"{starts[0][i]:.6g} {unit}, {abs(moved[i]):.6g} {unit} away"
        goals = (np.where(alone, wanted.q, start) for start in starts)
        pairs = zip(starts, goals, strict=True)
        if not any(
            _held(finder, equations, t, start, goal, alone)[1] <= TOLERANCES.projection_residual_failed
            for start, goal in pairs
        ):
            text = f"no state of the mechanism was found with {name} = {wanted.q[i]:.6g} {unit}; one near it has {near}"
            found.append((name, text))
        elif abs(moved[i]) > TOLERANCES.change_far * sizes[i]:
            found.append(
                (name, f"no state near the initial values satisfies the constraints; one that does has {near}")
            )
    _refuse_values(system, wanted, found, "coordinates")


def _check_speeds(
    finder: Finder, equations: Constrained, t: float, q: Array, u: Array, wanted: _Wanted, moved: Array
) -> None:
    """Refuse rates that the constraints forbid, whatever the others are."""
    system, found = finder.system, []
    for i in np.flatnonzero(np.abs(moved) > TOLERANCES.change_told * finder.sizes):
        alone = np.arange(len(moved)) == i
        if (
            equations.onto_velocities(t, q, np.where(alone, wanted.u, u), alone)[1]
            <= TOLERANCES.projection_residual_failed
        ):
            continue
        name, unit = system.names[i], per_second(system.units[i])
        allowed = u[i] if abs(u[i]) > TOLERANCES.change_told * abs(wanted.u[i]) else 0.0
        text = f"the constraints allow no rate({name}) = {wanted.u[i]:.6g} {unit} here, but {allowed:.6g} {unit}"
        found.append((f"rate({name})", text))
    _refuse_values(system, wanted, found, "rates")


def _check_moving(system: System, motion: Motion, t: float, q: Array, u: Array, wanted: _Wanted) -> None:
    """Refuse positions at which rows that repeat others at the reference only take speeds away."""
    changed = np.abs(u - wanted.u) / motion.sizes
    fastest = float(np.max(np.abs(wanted.u) / motion.sizes, initial=0.0))
    if not motion.redundant or np.max(changed, initial=0.0) <= TOLERANCES.change_told * fastest:
        return
    J = dense(system.dynamics(q, u, t).J) * motion.sizes
    if rank_of(J / np.maximum(norms(J), 1e-300)[:, None]).rank <= motion.spaces.C.rank + motion.spaces.W.rank:
        return
    most = int(np.argmax(changed))
    name, unit = system.names[most], per_second(system.units[most])
    rows = ", ".join(dict.fromkeys(item.row.owner for item in motion.redundant))
    left = 0.0 if abs(u[most]) <= TOLERANCES.speed_stopped * abs(wanted.u[most]) else u[most]
    raise UsageError(
        f"{system.scene.model.reference.location}: the constraints stop the motion there: rate({name}) = "
        f"{wanted.u[most]:.6g} {unit} becomes {left:.6g}\nhint: {rows} only repeats other rows at the reference, and "
        "locks what moves beside it"
    )


def _refuse_values(system: System, wanted: _Wanted, found: list[tuple[str, str]], which: str) -> None:
    """Refuse values, each with its problem, where they were given."""
    if not found:
        return
    hint = "correct the value, or leave it out and it is solved for"
    for name, text in found:
        if name in wanted.perturbed:
            raise UsageError(f"--perturb {name}: {text}")
    model = system.scene.model
    given = getattr(model.initial, which)
    values = ((given[name.removeprefix("rate(").rstrip(")")], text) for name, text in found)
    raise ModelFileError([model.document.problem(value.location, value.path, text, hint) for value, text in values])


def _report(system: System, finder: Finder, moved: Array, per: str, strict: bool, warnings: list[str]) -> None:
    """Warn by how much given values were moved onto the constraints, or refuse them."""
    changed = [
        i for i in np.argsort(-np.abs(moved / finder.sizes)) if abs(moved[i]) > TOLERANCES.change_told * finder.sizes[i]
    ]
    if not changed:
        return
    texts = []
    for i in changed[:6]:
        name, unit = system.names[i], system.units[i]
        what = f"rate({name})" if per else name
        texts.append(f"{what} by {moved[i]:.6g} {unit}{per}")
    text = "the initial values do not satisfy the constraints; moved onto them: " + ", ".join(texts)
    if strict:
        location = system.scene.model.initial.location
        hint = "correct the values, or leave out those that the constraints determine"
        raise ModelFileError([system.scene.model.document.problem(location, "initial", text, hint)])
    warnings.append(text)
