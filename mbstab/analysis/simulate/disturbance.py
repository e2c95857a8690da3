"""Disturbances of coordinates and of motions of joints, and the choice of what stays unchanged.

A requested disturbance leaves other motions free. Of these as many stay unchanged as the constraints allow: motions
of joints, if some were requested, then angles of bodies, then positions; of each kind first those that the
constraints restrict least, and among these in the order of the file. The constraints move the others.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from mbstab.analysis.algebra.arrays import least_squares, norms
from mbstab.analysis.reference.attitude import Attitudes
from mbstab.analysis.reference.efforts import MOTION_UNITS, Placement, motion_name, moving_joints
from mbstab.analysis.simulate.constrained import Constrained
from mbstab.analysis.simulate.tolerances import TOLERANCES
from mbstab.compiler.system import Array, System
from mbstab.errors import UsageError, suggestion
from mbstab.model.scene import ItemValues
from mbstab.model.schema import is_length, is_state
from mbstab.records import dataclass

_RATE = re.compile(r"rate\(\s*(.*?)\s*\)")
_JOINT = re.compile(r"(angle|displacement)\(\s*([^()\s]+)\s*\)")


@dataclass(frozen=True, eq=False)
class Quantity:
    """A coordinate, or a motion of a joint.

    Attributes
    ----------
    name : str
        Such as ``rod.theta`` or ``angle(pivot)``.
    unit : str
    size : float
        Its characteristic size (m, rad).
    number : int
        Number of the coordinate; -1: a motion of a joint.
    kind : str
        ``angle`` or ``displacement`` of a joint.
    joint : ItemValues or None
    """

    name: str
    unit: str
    size: float
    number: int = -1
    kind: str = ""
    joint: ItemValues | None = None

    def value(self, at: Placement, near: float = 0.0) -> float:
        """Return its value; in space, an angle within half a turn of `near`."""
        return float(at.q[self.number] if self.joint is None else at.motion(self.kind, self.joint, near))

    def gradient(self, at: Placement) -> Array:
        """Return its derivative by the coordinates, shape (n_q,)."""
        unit = np.eye(len(at.q))
        if self.joint is None:
            return np.asarray(unit[self.number])
        each = Placement(at.attitudes, at.system, np.tile(at.q, (len(unit), 1)), unit)
        return np.asarray(each.rate(self.kind, self.joint))


def coordinates(system: System, sizes: Array) -> list[Quantity]:
    """Return the coordinates of a scene, in the order of q."""
    return [
        Quantity(name, system.units[i], float(size), i)
        for i, (name, size) in enumerate(zip(system.names, sizes, strict=True))
    ]


def joint_motions(system: System, sizes: Array) -> list[Quantity]:
    """Return the angles and displacements of all joints."""
    length = max((float(x) for x, name in zip(sizes, system.names, strict=True) if is_length(name)), default=1.0)
    return [
        Quantity(
            motion_name(kind, item.name), MOTION_UNITS[kind], 1.0 if kind == "angle" else length, kind=kind, joint=item
        )
        for kind, item in moving_joints(system.scene)
    ]


def read_name(system: System, sizes: Array, name: str) -> tuple[Quantity, bool]:
    """Return the quantity of a name such as ``rod.theta`` or ``rate(angle(pivot))``, and whether its rate is meant.

    Raises
    ------
    UsageError
        If there is no such coordinate or joint.
    """
    rate = _RATE.fullmatch(name.strip())
    inner = rate[1] if rate else name.strip()
    moving = joint_motions(system, sizes)
    known = {x.name: x for x in (*coordinates(system, sizes), *moving)}
    joint = _JOINT.fullmatch(inner)
    found = known.get(motion_name(joint[1], joint[2]) if joint else inner)
    if found is not None:
        return found, rate is not None
    whole = [*known, *(f"rate({x})" for x in known)]
    of_joint = [x.name for x in moving if x.joint is not None and x.joint.name in (inner, joint and joint[2])]
    hint = "motions of joints: " + ", ".join(of_joint) if of_joint else suggestion(name, whole)
    hint = hint or coordinates_text(system.names)
    what = f"joint motion {inner!r}" if joint else f"coordinate {inner!r}"
    raise UsageError(f"--perturb {name}: there is no {what}\nhint: {hint}")


def coordinates_text(names: Sequence[str], most: int = 12) -> str:
    """Return the first names of coordinates and those of states, as a hint."""
    placed, states = [x for x in names if not is_state(x)], [x for x in names if is_state(x)]
    groups = (("coordinates", placed), ("states", states))
    shown = (f"{what}: {', '.join(own[:most])}{' …' if len(own) > most else ''}" for what, own in groups if own)
    return "; ".join(shown)


def staying(at: Placement, J: Array, named: Sequence[Quantity], sizes: Array) -> list[Quantity]:
    """Return the quantities that stay unchanged besides the named ones, as far as the constraints allow.

    Parameters
    ----------
    J : ndarray, shape (n, n_q)
        Jacobian of the constraints.
    """
    groups = _in_turn(at, sizes, any(x.joint is not None for x in named))
    rows = np.vstack([J, *(x.gradient(at)[None] for x in named)]) * sizes
    span = np.zeros((0, len(sizes)))
    if np.any(rows):
        rows = rows / norms(rows)[:, None]
        _, s, right = np.linalg.svd(rows, full_matrices=False)
        span = right[s > 1e-9 * s[0]]
    names, found = {x.name for x in named}, []
    for group in groups:
        rest = {x: x.gradient(at) * sizes for x in group if x.name not in names}
        rest = {x: row / np.linalg.norm(row) for x, row in rest.items() if np.any(row)}
        while rest:
            rest = {x: row - span.T @ (span @ row) for x, row in rest.items()}
            apart = {x: float(np.linalg.norm(row)) for x, row in rest.items()}
            largest = max(apart.values())
            if largest <= TOLERANCES.independent_motion_sine:
                break
            # The first of those that the constraints restrict least.
            x = next(x for x in rest if apart[x] >= TOLERANCES.equally_bound * largest)
            span = np.vstack([span, rest.pop(x) / apart[x]])
            found.append(x)
    return found


def _in_turn(at: Placement, sizes: Array, joints: bool) -> list[list[Quantity]]:
    """Return the quantities that may stay in groups, those first that stay rather than others."""
    own = coordinates(at.system, sizes)
    groups = [[x for x in own if x.unit == "rad"], [x for x in own if x.unit != "rad"]]
    if joints:
        groups.insert(0, joint_motions(at.system, sizes))
    light = np.isin(at.system.names, [name for x in at.system.scene.balances for name in x.names])
    if not light.any():
        return groups
    # What has no mass follows from the rest.
    following = {x for group in groups for x in group if not np.any(x.gradient(at)[~light])}
    return [[x for x in group if (x in following) == last] for last in (False, True) for group in groups]


def reached(
    equations: Constrained, attitudes: Attitudes, t: float, q: Array, goals: Sequence[tuple[Quantity, float]]
) -> tuple[Array, float]:
    """Return coordinates on the constraints at which quantities have given values, and the remaining residual.

    Parameters
    ----------
    q : ndarray, shape (n_q,)
        Coordinates from which they are followed.
    """
    system, sizes, zero = equations.system, equations.sizes, np.zeros(len(q))
    first = [x.value(Placement(attitudes, system, q, zero)) for x, _ in goals]
    far = max((abs(goal - start) / x.size for (x, goal), start in zip(goals, first, strict=True)), default=0.0)
    count = int(np.clip(np.ceil(far / TOLERANCES.value_increment), 1, 200))
    left = np.inf
    for k in range(1, count + 1):
        wanted = [start + k / count * (goal - start) for (_, goal), start in zip(goals, first, strict=True)]
        for _ in range(TOLERANCES.newton_steps_to_values):
            at, state = Placement(attitudes, system, q, zero), system.closing.dynamics(q, zero, t)
            J, E = state.J[: equations.n_h] * sizes, state.E[: equations.n_h]
            lengths = norms(J)
            missing = [(x.value(at, goal) - goal) / x.size for (x, _), goal in zip(goals, wanted, strict=True)]
            residual = np.concatenate([E / lengths, missing])
            rows = [x.gradient(at) * sizes / x.size for x, _ in goals]
            step = least_squares(np.vstack([J / lengths[:, None], *rows]), -residual, rcond=1e-12)
            left = float(np.max(np.abs(residual), initial=0.0))
            q = q + step * sizes
            if np.linalg.norm(step) < 1e-14:
                break
        if left > TOLERANCES.value_reached:
            return q, left
    return q, max(left, equations.residuals(system.closing.dynamics(q, zero, t), 1.0)[0])


def speeds(
    equations: Constrained, attitudes: Attitudes, t: float, q: Array, u: Array, goals: Sequence[tuple[Quantity, float]]
) -> tuple[Array, float]:
    """Return speeds on the constraints at which quantities have given rates, and the remaining residual (1/s)."""
    system, sizes, fast = equations.system, equations.sizes, 1.0
    at = Placement(attitudes, system, q, u)
    rows = np.array([x.gradient(at) * sizes / x.size for x, _ in goals]).reshape(len(goals), len(q))
    wanted = np.array([goal / x.size for x, goal in goals])
    left = np.inf
    for _ in range(TOLERANCES.newton_steps_to_values):
        state = system.bodily.dynamics(q, u, t)
        J = state.J * sizes
        lengths = norms(J)
        residual = np.concatenate([state.V / lengths, rows @ (u / sizes) - wanted])
        step = least_squares(np.vstack([J / lengths[:, None], rows]), -residual, rcond=1e-12)
        fast = max(equations.fastest(u), float(np.max(np.abs(wanted), initial=0.0)), equations.slowest)
        left = float(np.max(np.abs(residual), initial=0.0)) / fast
        if np.linalg.norm(step) <= 1e-15 * fast:
            break
        u = u + step * sizes
    return system.with_state_rates(q, u, t), left
