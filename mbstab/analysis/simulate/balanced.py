"""Motions without mass in simulations: their balances of forces as constraint rows.

At the reference, `mbstab.analysis.linear.massless` tells which directions are algebraic and which of first order. Along
directions that no constraint sees these balances are rows (`mbstab.compiler.balances`) of the equations of motion, and
all integrators take them as constraints. Their multipliers vanish as long as the directions stay without constraints
and algebraic ones without damping; `check_balanced` looks at them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbstab.analysis.linear.linearize import linearize
from mbstab.analysis.reference.motion import Finder, Motion
from mbstab.analysis.simulate.tolerances import TOLERANCES
from mbstab.compiler.system import Array, System
from mbstab.errors import MassError, NumericalError, amount
from mbstab.model.scene import BalanceValues


def balanced(system: System, motion: Motion) -> tuple[System, Motion]:
    """Return the equations with balances along the directions without mass of a reference as rows, and the reference.

    Raises
    ------
    MassError
        If forces do not determine one of them, or a constraint sees it; names body and coordinate.
    """
    if motion.massless is None:
        return system, motion
    linear = linearize(system, motion)
    light = linear.massless
    assert light is not None
    found = []
    for directions, first_order in ((light.algebraic, False), (light.first_order, True)):
        for d in directions:
            involved = np.flatnonzero(d)
            names = [system.names[i] for i in involved]
            if np.any(motion.dynamics.J[:, involved]) or np.any(motion.dynamics.M[involved]):
                raise _refused(system, names)
            found.append(BalanceValues(dict(zip(names, d[involved].tolist(), strict=True)), first_order))
    other = System(replace(system.scene, balances=tuple(found)))
    return other, Finder(other).motion(motion.q, motion.u, motion.time)


def _refused(system: System, names: list[str]) -> MassError:
    body = next(b for b in system.scene.bodies if b.name == names[0].partition(".")[0])
    message = f"the motion of {', '.join(names)} carries no mass, and constraints tie these coordinates to each other"
    hint = (
        "mbstab eig finds its eigenvalues; for its nonlinear motion give it a mass, or use coordinates that move "
        "freely: a planar_point, or a body whose reference point lies on the joint"
    )
    return MassError(str(system.scene.model.document.problem(body.location, f"bodies.{body.name}", message, hint)))


def check_balanced(system: System, times: Array, q: Array, u: Array, a: Array, nu: Array) -> None:
    """Refuse states in which forces along a direction without mass are out of balance.

    Parameters
    ----------
    times : ndarray, shape (n_t,)
    q, u, a : ndarray, shape (n_t, n_q)
    nu : ndarray, shape (n_t, n_c)

    Raises
    ------
    NumericalError
        With the force that is left; names the coordinate.
    """
    rows = [i for i, row in enumerate(system.rows) if row.section == "balances"]
    if not rows:
        return
    J = [system.dynamics(*state).J[rows] for state in zip(q, u, times, strict=True)]
    left = np.abs(np.einsum("ti,tij->tj", nu[:, rows], np.array(J)))
    sizes = np.array([system.loads(*state) for state in zip(q, u, a, times, strict=True)])
    # Where all forces along a direction vanish, those elsewhere and at other times are the measure.
    allowed = TOLERANCES.balance_left * (sizes + np.max(sizes))
    if np.any(left > allowed):
        k, i = np.unravel_index(int(np.argmax(left - allowed)), left.shape)
        raise NumericalError(
            f"the forces along {system.names[i]}, which carries no mass, are out of balance at t = {times[k]:.9g} s: "
            f"{amount(left[k, i])} is left, where {amount(allowed[k, i])} is allowed\n"
            "hint: dampers begin to act along it, or constraints to hold it; give it a mass"
        )
