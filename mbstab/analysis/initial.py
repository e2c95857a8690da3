"""Where a simulation starts: the reference motion, what ``initial:`` gives, disturbances, and all of it consistent.

Given values are held while the others are moved onto the constraints. Where that is impossible
everything is moved by the least change in the metric of the masses, and it is said by how much.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mbstab.analysis.constrained import ACCEPTED, Constrained
from mbstab.analysis.motion import Finder, Motion
from mbstab.analysis.reference import reference_motion
from mbstab.compiler.system import Array, System
from mbstab.errors import ModelFileError, NumericalError, UsageError, suggestion
from mbstab.model.arithmetic import FLOAT
from mbstab.model.expressions import ExpressionError
from mbstab.model.schema import parse_finite, unit_of

INCREMENT = 0.2
"""Given coordinates go from the reference to their values in steps of this part of their sizes, the others follow."""

LARGEST_CHANGE = 1e-9
"""What is moved by less, relative to its size, is not mentioned."""

_RATE = re.compile(r"rate\(\s*([^()\s]+)\s*\)")
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
    """

    system: System
    motion: Motion
    warnings: tuple[str, ...]


@dataclass
class _Wanted:
    """A state and which of its values were asked for."""

    q: Array
    u: Array
    held_q: Any
    held_u: Any


def start_of(
    system: System, perturb: Mapping[str, float | str] | None = None, time: float | None = None, strict: bool = False
) -> Start:
    """Return the state at which a simulation starts.

    Parameters
    ----------
    perturb : mapping, optional
        What is added to the reference motion: by coordinate such as ``rod.theta``, by rate such as
        ``rate(rod.theta)``, or by mode such as ``mode:1``, numbers or expressions of the parameters (m, rad, s).
    time : float, optional
        The start (s); that of ``initial:``, else that of the reference, if not given.
    strict : bool
        Refuse given values that the constraints do not allow.

    Raises
    ------
    UsageError
        If a name is unknown or a value is no number.
    ModelFileError
        If the constraints do not allow the given values, and `strict`; if the reference is none.
    NumericalError
        If no state near the given values satisfies the constraints.
    """
    scene = system.scene
    q0, u0, motion = _reference(system)
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
    for name, value in (perturb or {}).items():
        _disturb(system, motion, wanted, name, value)
    system = System(replace(scene, time=begin))
    finder = Finder(system)
    equations = Constrained(system, motion)
    warnings: list[str] = []
    q, moved = _positions(finder, equations, begin, q0, wanted)
    _report(system, finder, moved, "", strict, warnings)
    u, moved = _speeds(equations, begin, q, wanted)
    _report(system, finder, moved, "/s", strict, warnings)
    finder.check_chart(q, np.zeros(n, dtype=bool))
    found = finder.motion(q, u, begin)
    q, u, state = Constrained(system, found).project(begin, q, u)
    found = replace(finder.motion(q, u, begin), dynamics=state)
    return Start(system, found, (*warnings, *dict.fromkeys(found.warnings)))


def _reference(system: System) -> tuple[Array, Array, Motion]:
    """Return the reference of the file, which may be out of balance, and the motion through it."""
    reference = system.scene.model.reference
    if reference.find is not None or reference.steady is not None:
        motion = reference_motion(system)
        return motion.q, motion.u, motion
    finder = Finder(system)
    try:
        q = finder.coordinates()
        u = finder.rates(q)
    except ModelFileError:
        if not system.scene.initial.coordinates:
            raise
        q, _ = finder.start()
        u = np.array([system.scene.rates.get(name, 0.0) for name in system.names], dtype=float)
    return q, u, finder.motion(q, u)


# --- disturbances ---------------------------------------------------------------------------------------------------


def _disturb(system: System, motion: Motion, wanted: _Wanted, name: str, value: float | str) -> None:
    """Add a disturbance to a state."""
    size = _value(system, name, value)
    if mode := _MODE.fullmatch(name):
        dq, du = mode_shape(system, motion, int(mode[1]))
        wanted.q += size * dq
        wanted.u += size * du
        return
    rate = _RATE.fullmatch(name)
    coordinate = rate[1] if rate else name
    if coordinate not in system.names:
        known = [*system.names, *(f"rate({x})" for x in system.names)]
        hint = suggestion(name, known) or "coordinates: " + ", ".join(system.names[:12])
        raise UsageError(f"--perturb {name}: there is no coordinate {coordinate!r}\nhint: {hint}")
    i = system.names.index(coordinate)
    if rate:
        wanted.u[i] += size
        wanted.held_u[i] = True
    else:
        wanted.q[i] += size
        wanted.held_q[i] = True


def _value(system: System, name: str, value: float | str) -> float:
    parameters = system.scene.parameters
    try:
        if not isinstance(value, str):
            found = float(value)
        else:
            expression = parse_finite(value, parameters)
            for used in (*expression.names(), *expression.rates()):
                if used not in parameters:
                    raise ExpressionError(f"unknown parameter {used!r}", 0, suggestion(used, parameters))
            found = float(expression.evaluate(parameters, FLOAT))
    except ExpressionError as error:
        hint = f"\nhint: {error.hint}" if error.hint else ""
        raise UsageError(f"--perturb {name}={value}: {error.message}{hint}") from None
    if not np.isfinite(found):
        raise UsageError(f"--perturb {name}={value}: the value is not finite")
    return found


def mode_shape(system: System, motion: Motion, number: int) -> tuple[Array, Array]:
    """Return Δq and Δu of a mode, the real part of its shape at an instant.

    The coordinate that moves most, relative to the sizes in the scene, moves by 1 (m or rad) and has its largest
    value at that instant.

    Parameters
    ----------
    number : int
        As ``mbstab eig`` lists the modes, from 1; a pair is one mode, neutral eigenvalues are none.

    Raises
    ------
    UsageError
        If there is no such mode.
    """
    _, dq, du = complex_mode(system, number)
    return np.real(dq), np.real(du)


def complex_mode(system: System, number: int) -> tuple[complex, Array, Array]:
    """Return eigenvalue (1/s; the multiplier of a periodic motion), complex Δq and Δu of a mode, as in `mode_shape`."""
    from mbstab.analysis.eigen import answer
    from mbstab.analysis.linearize import linearize, state_space

    listed = [e for e in answer(system).eigenvalues if e.kind != "neutral" and e.value.imag >= 0.0]
    if not 1 <= number <= len(listed):
        count = "is 1" if len(listed) == 1 else f"are {len(listed)}"
        raise UsageError(f"--perturb mode:{number}: there {count} to choose from, as mbstab eig lists them")
    mode = listed[number - 1]
    motion = reference_motion(system)
    if system.scene.period is not None:
        from mbstab.analysis.floquet import monodromy

        around = monodromy(system, motion, float(system.scene.period))
        matrix, value = around.Phi, mode.multiplier
        to_q, to_u = around.to_coordinates, around.to_rates
    else:
        linear = linearize(system, motion)
        space = state_space(linear)
        matrix, value, to_q, to_u = space.A, mode.value, space.to_coordinates, space.to_rates
        if linear.generator is not None and linear.generator.turns:
            to_u = to_u + linear.generator.frame(motion.q)[0] @ to_q
    values, vectors = np.linalg.eig(matrix)
    y = vectors[:, int(np.argmin(np.abs(values - value)))]
    dq, du = to_q @ y, to_u @ y
    relative = np.abs(dq / motion.sizes)
    moves, x = (relative, dq) if np.any(relative > 0.0) else (np.abs(du / motion.sizes), du)
    largest = x[int(np.argmax(moves))]
    value = complex(value or 0.0)
    if mode.kind == "center" and system.scene.period is None:
        value = complex(0.0, value.imag)
    return value, dq / largest, du / largest


# --- onto the constraints -------------------------------------------------------------------------------------------


def _positions(finder: Finder, equations: Constrained, t: float, q0: Array, wanted: _Wanted) -> tuple[Array, Array]:
    """Return coordinates that satisfy the constraints, and by how much given ones were moved."""
    held, goal = wanted.held_q, wanted.q
    none = np.zeros(len(q0))
    if not equations.n_h:
        return goal, none
    change = goal - q0
    if np.any(held):
        count = int(np.clip(np.ceil(np.max(np.abs(change[held] / finder.sizes[held])) / INCREMENT), 1, 200))
        q = q0 + np.where(held, 0.0, change)
        for k in range(1, count + 1):
            q = np.where(held, q0 + (k / count) * change, q)
            q = finder.assemble(q, ~held)
        q = np.where(held, goal, q)
        q, left = equations.onto_positions(t, q, held)
        if left <= ACCEPTED:
            return q, none
    q, left = equations.onto_positions(t, goal)
    if not left <= ACCEPTED:
        q = finder.assemble(goal, np.ones(len(goal), dtype=bool))
        q, left = equations.onto_positions(t, q)
    if not left <= ACCEPTED:
        raise NumericalError(
            f"no state near the initial values satisfies the constraints at t = {t:.9g} s: a residual of {left:.1e} of "
            "the sizes in the scene is left\n"
            "hint: correct the values under initial: or --perturb, or give those of other coordinates, too"
        )
    return q, np.where(held, q - goal, none)


def _speeds(equations: Constrained, t: float, q: Array, wanted: _Wanted) -> tuple[Array, Array]:
    """Return rates that satisfy the constraints, and by how much given ones were moved."""
    held, goal = wanted.held_u, wanted.u
    none = np.zeros(len(goal))
    if np.any(held):
        u, left, _ = equations.onto_velocities(t, q, goal, held)
        if left <= ACCEPTED:
            return u, none
    u, left, _ = equations.onto_velocities(t, q, goal)
    if not left <= ACCEPTED:
        raise NumericalError(
            f"no rates near the initial values satisfy the constraints at t = {t:.9g} s: a residual of {left:.1e} of "
            "the rates in the scene is left\nhint: correct the rates under initial: or --perturb"
        )
    return u, np.where(held, u - goal, none)


def _report(system: System, finder: Finder, moved: Array, per: str, strict: bool, warnings: list[str]) -> None:
    """Say by how much given values were moved onto the constraints, or refuse that."""
    changed = [i for i in np.argsort(-np.abs(moved / finder.sizes)) if abs(moved[i]) > LARGEST_CHANGE * finder.sizes[i]]
    if not changed:
        return
    texts = []
    for i in changed[:6]:
        name, unit = system.names[i], unit_of(system.names[i])
        what = f"rate({name})" if per else name
        texts.append(f"{what} by {moved[i]:.6g} {unit}{per}")
    text = "the initial values do not satisfy the constraints; moved onto them: " + ", ".join(texts)
    if strict:
        location = system.scene.model.initial.location
        hint = "correct the values, or leave out those that the constraints determine"
        raise ModelFileError([system.scene.model.document.problem(location, "initial", text, hint)])
    warnings.append(text)
