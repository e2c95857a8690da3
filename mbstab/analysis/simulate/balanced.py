"""Motions without mass in simulations: their balances of forces as constraint rows.

At the reference, `mbstab.analysis.linear.massless` tells which directions are algebraic and which of first order. The
balances of forces along them are rows (`mbstab.compiler.balances`) of the equations of motion, and all integrators take
them as constraints. Their multipliers vanish as long as algebraic directions stay without damping; `check_balanced`
looks at them. Where constraints tie coordinates without mass to each other, as many of these as there are directions
are independent, angles rather than lengths, and the others follow.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbstab.analysis.algebra.arrays import Flags
from mbstab.analysis.linear.linearize import linearize
from mbstab.analysis.reference.motion import Finder, Motion
from mbstab.analysis.simulate.tolerances import TOLERANCES
from mbstab.compiler.system import Array, System
from mbstab.errors import MassError, NumericalError, amount
from mbstab.model.scene import BalanceValues
from mbstab.model.schema import is_length


def balanced(system: System, motion: Motion) -> tuple[System, Motion]:
    """Return the equations with balances along the directions without mass of a reference as rows, and the reference.

    Raises
    ------
    MassError
        If forces do not determine one of them, or constraints tie it in a way that is not known here; names body and
        coordinate.
    """
    if motion.massless is None:
        return system, motion
    linear = linearize(system, motion)
    light = linear.massless
    assert light is not None
    tied = _tied(system, motion, len(light.algebraic))
    found = []
    for directions, first_order in ((light.algebraic, False), (light.first_order, True)):
        for d in directions:
            own = {system.names[i]: float(d[i]) for i in np.flatnonzero(d) if i not in tied}
            found.append(BalanceValues(own, first_order, tuple((system.names[i], row) for i, row in tied.items())))
    other = System(replace(system.scene, balances=tuple(found)))
    return other, Finder(other).motion(motion.q, motion.u, motion.time)


def _tied(system: System, motion: Motion, further: int) -> dict[int, int]:
    """Return the coordinates without mass that follow from others, and a row for each, in the order of elimination.

    Parameters
    ----------
    further : int
        So many holonomic rows stand before those on speeds afterwards.
    """
    from scipy.linalg import lu_factor, qr

    assert motion.massless is not None
    J = motion.dynamics.J * motion.sizes
    moving = np.max(np.abs(motion.massless), axis=1) > TOLERANCES.component_without_mass
    moving = np.flatnonzero(_with_tied(system, motion, moving))
    rows = np.flatnonzero(np.any(J[:, moving], axis=1))
    count = len(moving) - motion.massless.shape[1]
    if not count:
        return {}
    heavy = moving[np.any(motion.dynamics.M[moving], axis=1)]
    if len(heavy):
        raise _refused(system, [system.names[i] for i in heavy])
    # Where lengths follow from angles, a lever may turn all around.
    weights = np.where([is_length(system.names[i]) for i in moving], 1.0, TOLERANCES.angle_that_follows)
    _, _, columns = qr(J[np.ix_(rows, moving)] * weights, mode="economic", pivoting=True)
    columns = columns[:count]
    _, _, chosen = qr(J[np.ix_(rows, moving[columns])].T, mode="economic", pivoting=True)
    order = np.arange(count)
    for k, best in enumerate(lu_factor(J[np.ix_(rows[chosen[:count]], moving[columns])])[1].tolist()):
        order[[k, best]] = order[[best, k]]
    following = rows[chosen[:count]][order]
    following = np.where(following >= system.n_h, following + further, following)
    return dict(zip(moving[columns].tolist(), following.tolist(), strict=True))


def _with_tied(system: System, motion: Motion, moving: Flags) -> Flags:
    """Return the coordinates that move, and all without mass that holonomic rows may tie to them.

    What a row contains counts, not the slopes at the reference, which may vanish there alone.
    """
    contained = np.zeros((system.n_c + 1, system.n_q + 1), dtype=bool)
    for e in system._elements:
        if e.rows and min(e.rows) < system.n_h:
            for i, j in e.kernel.DYNAMICS["J"]:
                contained[e.rows[i], e.columns[j]] = True
    contained = contained[: system.n_h, :-1]
    light = ~np.any(motion.dynamics.M, axis=1)
    light[system.states[0]] = False
    found = moving
    while True:
        grown = found | (light & np.any(contained[np.any(contained[:, found], axis=1)], axis=0))
        if np.all(grown == found):
            return found
        found = grown


def _refused(system: System, names: list[str]) -> MassError:
    body = next(b for b in system.scene.bodies if b.name == names[0].partition(".")[0])
    message = (
        f"a motion of {', '.join(names)} carries no mass, but these coordinates carry mass in other motions, and "
        "constraints tie them"
    )
    hint = "mbstab eig finds its eigenvalues; for its nonlinear motion give it a mass"
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
