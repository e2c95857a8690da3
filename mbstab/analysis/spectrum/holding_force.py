"""What holds a motion beside its reference, or drives it there: with which power of the distance it begins.

Near a zero eigenvalue, q − q₀ with measure·(q − q₀) = z and the force r along measure that balances everything, or the
speed r along the line at which everything is in balance, are functions of z (Lyapunov and Schmidt). At distances far
below all ratios of the numbers in a file, powers of z beyond the tenth are rounding in r = a z^k + …, and as many
points as there are other powers give all their coefficients, on each side its own: the lowest power counts, however
small a is.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from mbstab.analysis.algebra.balls import ball_system
from mbstab.analysis.algebra.digits import MANY_DIGITS
from mbstab.analysis.algebra.refining import Matrix, Stalled
from mbstab.analysis.reference.coefficients import matrices_in
from mbstab.analysis.spectrum.precise_motion import Point, Start, reference_point
from mbstab.analysis.spectrum.tolerances import TOLERANCES
from mbstab.analysis.verdict.many_digits import Line, Power
from mbstab.compiler.system import System
from mbstab.errors import MbstabError
from mbstab.model import balls
from mbstab.model.schema import Model


def powers(model: Model, line: Line) -> tuple[Power, Power] | None:
    """Return how the force or the drift begins ahead of a reference and behind; None if it is not known."""
    try:
        start = Start(model, False)
        with balls.digits(TOLERANCES.digits_of_holding):
            system = ball_system(model, {}, balls.digit_arithmetic())
            point = reference_point(start, system, MANY_DIGITS)
            force = _force(start, system, point, line)
            near = balls.real(10) ** -TOLERANCES.distance_digits
            found = [[force(side * times * near) for times in TOLERANCES.distances] for side in (1, -1)]
            # Powers beyond the tenth are left out. What nothing balances, as along symmetries, hides what is smaller by
            # the range of floats.
            unbalanced = max(left for sides in found for _, left in sides)
            least = max((near**21).sqrt(), unbalanced * balls.real(10) ** -TOLERANCES.float_range)
            ahead, behind = (
                _first([side * value for value, _ in values], least)
                for side, values in zip((1, -1), found, strict=True)
            )
            return (ahead, behind) if ahead[0] != 1 != behind[0] else None
    except (MbstabError, Stalled, ArithmeticError, ValueError):
        return None


def _first(values: list[Any], least: Any) -> Power:
    """Return the lowest power of a function, and the sign of its coefficient, from its values at distances to one side.

    Where pieces meet at the reference, as of abs, both sides have series of their own.
    """
    from flint import arb_mat

    exponents = range(1, len(values) + 1)
    matrix = arb_mat([[balls.real(times) ** k for k in exponents] for times in TOLERANCES.distances])
    terms = matrix.solve(arb_mat([[x] for x in values])).entries()
    lowest = next((k for k, term in zip(exponents, terms, strict=True) if abs(term) > least), 0)
    return lowest, int(float(terms[lowest - 1].sgn())) if lowest else 0


def _force(start: Start, system: System, point: Point, line: Line) -> Callable[[Any], tuple[Any, Any]]:
    """Return the force at a distance z, or the speed of the drift, and what nothing balances there.

    Relative to the forces that small motions of the size of the scene cause, or to the rates of the scene.
    """
    f, motion, linear = MANY_DIGITS, start.motion, start.linear
    n, n_h, sizes = system.n_q, system.n_h, motion.sizes
    generator = linear.generator if linear.generator is not None and linear.generator.turns else None
    matrices = matrices_in(start.system, motion, generator)
    kept, pushed, drift = (f.exact(x) for x in (line.kept(sizes), line.pushed(sizes), line.drift(sizes)))
    last = n + system.n_c
    matrix, rows, columns = line.bordered(matrices, n_h, sizes)
    inverse = np.linalg.pinv(matrix, rcond=TOLERANCES.sharpened_slope)
    moving = bool(np.any(motion.u))
    forces = np.abs(matrices.K) @ sizes + np.abs(matrices.J.T) @ np.abs(motion.nu)
    scale = start.grounds.structure.invariance.rate if line.drifts else float(np.max(forces, initial=0.0)) or 1.0

    def residual(x: Matrix, z: Any) -> Matrix:
        q, u, a = point.q + x[:n] * sizes, point.u, f.zeros(n)
        if moving and point.generator is not None:
            u, a = f.exact(point.generator.field(q)), f.exact(point.generator.acceleration(q))
        speeds = f.times(drift, x[last:])
        if moving and point.generator is not None:
            a = a + 2 * f.times(f.exact(point.generator.frame(q)[0]), speeds)
        there = system.dynamics(q, u + speeds, system.scene.time)
        force = f.exact(there.F0) + f.times(f.exact(there.M), a) - f.times(pushed, x[last:])
        force = force + f.times(f.exact(there.J).T, point.nu + x[n:last])
        distances = f.times(kept, x[:n])
        distances[-1] -= z
        parts = force, f.exact(there.E)[:n_h], f.exact(there.V)[n_h:], distances
        return f.exact(np.concatenate(parts)) / rows

    along = f.zeros(len(columns))
    along[:n] = f.exact(line.along / sizes)
    known: list[tuple[Any, Matrix]] = []

    def force(z: Any) -> tuple[Any, Any]:
        # The solution is analytic in z, and 0 at 0: each one found brings the first guess of the next closer to it.
        first = along * z if not known else f.zeros(len(columns))
        for at, x in known:
            others = (other for other, _ in known if other is not at)
            first = first + x * (z / at * math.prod((z - other) / (at - other) for other in others))
        found = f.polished(first, lambda x: -f.applied(inverse, residual(x, z)) / columns, 1.0)
        known.append((z, found))
        return found[-1] / scale, f.largest(residual(found, z))

    return force
