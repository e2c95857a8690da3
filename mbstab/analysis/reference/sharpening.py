"""Equilibria and steady motions in refined numbers, starting from double precision.

The residual of the same equations on numbers with many digits, corrected by their derivative in double precision, takes
a solution to all digits; on numbers with slopes, to its derivatives by parameters. Where rounding is magnified so much
that a solution in double precision would be off by more, its coordinates are those with more digits, rounded.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from mbstab.analysis.algebra.arrays import norms, others
from mbstab.analysis.algebra.failures import FAILURES
from mbstab.analysis.algebra.refining import Matrix, Refining, Stalled
from mbstab.analysis.reference.equations import Balance, LinearBalance, State
from mbstab.analysis.reference.steady import Family, Generator
from mbstab.analysis.reference.tolerances import TOLERANCES
from mbstab.compiler.system import Array, System
from mbstab.errors import EquilibriumError
from mbstab.model.balls import digit_arithmetic, digits
from mbstab.model.values import evaluate


def exactly_rounded(balance: Balance, at: State) -> tuple[Array, Array] | None:
    """Return q and c of a solution to their rounding in double precision; None where more digits do not help."""
    from mbstab.analysis.algebra.digits import MANY_DIGITS

    system, given = balance.system, balance.system.scene.parameters
    try:
        f = digit_arithmetic()
        with digits(TOLERANCES.sharpened_digits):
            scene = evaluate(system.scene.model, arithmetic=f)
            # Values that the file does not have, as those of a sweep.
            other = {k: f.number(repr(float(x))) for k, x in given.items() if float(scene.parameters[k]) != float(x)}
            scene = evaluate(system.scene.model, other, f) if other else scene
            q, steady = sharpened(MANY_DIGITS, balance, at, system.renumbered(scene), TOLERANCES.sharpened_residual)
            return q.astype(float), balance.family.coefficients_of(steady)
    except FAILURES:
        return None


def family_in(f: Refining, system: System, family: Family) -> tuple[Family, dict[int, Any]]:
    """Return a family of steady motions in such numbers, and its given coefficients."""
    steady, d = system.scene.steady, system.scene.dimension
    point, directions, axis = f.zeros(3), f.zeros(len(family.directions), 3), None
    known: list[Any] = []
    if steady is not None:
        point[:d] = steady.point
        if steady.axis is not None:
            axis = f.exact(steady.axis)
            known.append(steady.rate)
        if steady.direction is not None:
            directions[0, :d] = steady.direction
            known.append(steady.speed)
    given = {k: x + f.zero for k, x in enumerate(known) if x is not None}
    return Family(system, axis, point, directions, family.columns), given


def sharpened(
    f: Refining, balance: Balance, at: State, system: System, largest: float = np.inf
) -> tuple[Matrix, Generator]:
    """Return coordinates and generator of an equilibrium or a steady motion, refined with `Balance`.

    Parameters
    ----------
    largest : float
        Residuals that may be left; they are not zero where what no step moves is no solution.

    Raises
    ------
    EquilibriumError
        If it is none, or Newton's method does not refine it.
    """
    family, known = family_in(f, system, balance.family)
    names, scene, sizes = system.names, system.scene, balance.sizes
    lengths = norms(at.J * sizes)
    open_, free, rows, n_h, moving = balance.open, balance.free, balance.rows, balance.n_h, balance.moving
    fixed = f.exact(at.q)
    for i in others(system.n_q, open_):
        fixed[i] = scene.coordinates[names[i]] + f.zero
    rates = f.exact([scene.rates[names[i]] for i in balance.given])
    jacobian = balance.jacobian(at)
    held = _held(balance.equations(at).loose[: len(open_)].T)
    moved = others(jacobian.shape[1], held)
    still = LinearBalance(jacobian[:, moved], system.n_q, moving - len(held))
    inverse = still.inverse_of_all

    def unpacked(x: Matrix) -> tuple[Matrix, Generator]:
        q, c = fixed.copy(), f.exact(at.c)
        q[open_] = x[: len(open_)] * sizes[open_]
        for k, value in known.items():
            c[k] = value
        c[free] = x[len(open_) : moving] * balance.speed
        return q, family.generator(c)

    def residual(x: Matrix) -> Matrix:
        q, steady = unpacked(x)
        u, a = f.exact(steady.field(q)), f.exact(steady.acceleration(q))
        state = system.dynamics(q, u)
        J, E, V = f.exact(state.J)[rows], f.exact(state.E)[rows], f.exact(state.V)[rows]
        force = (f.times(f.exact(state.M), a) + state.F0) * sizes / balance.energy
        force = force + f.times((J * sizes / lengths[:, None]).T, x[moving:])
        parts = [force, E[:n_h] / lengths[:n_h]]
        if balance.with_speeds:
            parts += [
                V / (lengths * balance.row_speeds[rows]),
                (u[balance.given] - rates) / (sizes[balance.given] * balance.speed),
            ]
        return f.exact(np.concatenate(parts))

    nu = at.nu[rows] * lengths / balance.energy
    first = f.exact(np.concatenate([at.q[open_] / sizes[open_], at.c[free] / balance.speed, nu]))

    def placed(y: Matrix) -> Matrix:
        x = first.copy()
        x[moved] = y
        return x

    # What rounding of the terms of the equations makes of the unknowns.
    terms = np.abs(jacobian[:, moved]) @ np.abs(f.values(first)[moved].astype(float))
    floor = max(1.0, float(np.max(np.abs(inverse) @ terms, initial=0.0)))
    try:
        x = placed(f.polished(first[moved], lambda y: -f.applied(inverse, residual(placed(y))), floor))
        if held and (left := float(np.max(np.abs(f.values(residual(x))), initial=0.0))) > largest:
            raise Stalled(left)
    except Stalled as stalled:
        raise EquilibriumError(
            f"{scene.model.reference.location}: reference: Newton's method does not sharpen the solution of double "
            f"precision (steps of {stalled.reached:.1e})\n"
            "hint: at a critical position the solution is a multiple one; move a parameter away from it"
        ) from None
    return unpacked(x)


def _held(null: Array) -> list[int]:
    """Return coordinates that equations with a singular slope do not determine, given the directions it leaves open.

    They keep their values, so that the others come out with all digits: at a critical position the equations may hold
    exactly, and only then their residuals vanish.
    """
    if not null.size:
        return []
    from scipy.linalg import qr

    _, R, order = qr(null, mode="economic", pivoting=True)
    sizes = np.abs(np.diag(R))
    return [int(k) for k, size in zip(order, sizes, strict=False) if size > TOLERANCES.sharpened_coordinate]
