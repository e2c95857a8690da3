"""The force that holds a motion beside its reference, with many digits: with which power of the distance it begins.

Near a zero eigenvalue, q − q₀ with measure·(q − q₀) = z and the force r along measure that balances everything are
functions of z (Lyapunov and Schmidt). At distances far below all ratios of the numbers in a file, the lowest power in
r = a z^k + … alone is left, however small a is.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from mpmath import mp

from mbstab.analysis.algebra.digits import MANY_DIGITS
from mbstab.analysis.algebra.refining import Matrix, Stalled
from mbstab.analysis.reference.coefficients import matrices_in
from mbstab.analysis.spectrum.precise_motion import Point, Start, reference_point
from mbstab.analysis.spectrum.tolerances import TOLERANCES
from mbstab.analysis.verdict.many_digits import Line, Power
from mbstab.compiler.system import System
from mbstab.errors import MbstabError
from mbstab.model.arithmetic import mpmath_arithmetic
from mbstab.model.schema import Model
from mbstab.model.values import evaluate


def power(model: Model, line: Line) -> Power | None:
    """Return how the force begins that holds a motion beside its reference; None if it cannot be known."""
    try:
        start = Start(model, False)
        with mp.workdps(TOLERANCES.digits_of_holding):
            system = System(evaluate(model, arithmetic=mpmath_arithmetic()))
            point = reference_point(start, system, MANY_DIGITS)
            force = _force(start, system, point, line)
            near = mp.mpf(10) ** -TOLERANCES.distance_digits
            ahead, behind = ([force(sign * near), force(sign * 2 * near)] for sign in (1, -1))
            even = _part(ahead[0] + behind[0], ahead[1] + behind[1], 0)
            odd = _part(ahead[0] - behind[0], ahead[1] - behind[1], 1)
    except (MbstabError, Stalled, ArithmeticError, ValueError):
        return None
    if even is None or odd is None:
        return None
    return min((x for x in (even, odd) if x[0]), default=(0, 0))


def _part(near: Any, twice: Any, parity: int) -> Power | None:
    """Return how the even or the odd part of a force begins, from its values at a distance and at twice that."""
    least = mp.mpf(10) ** (2 * TOLERANCES.digits_beyond - mp.dps)
    if max(abs(near), abs(twice)) <= least:
        return 0, 0
    if not near * twice > 0:
        return None
    exponent = mp.log(twice / near, 2)
    k = int(mp.nint(exponent))
    if k < 2 or k % 2 != parity or abs(exponent - k) > TOLERANCES.power_misfit:
        return None
    return k, int(mp.sign(near))


def _force(start: Start, system: System, point: Point, line: Line) -> Callable[[Any], Any]:
    """Return the force at a distance z, relative to the forces that small motions of the size of the scene cause."""
    f, motion, linear = MANY_DIGITS, start.motion, start.linear
    n, n_h, sizes = system.n_q, system.n_h, motion.sizes
    generator = linear.generator if linear.generator is not None and linear.generator.turns else None
    K = matrices_in(start.system, motion, generator).K
    J, kept = motion.dynamics.J, f.exact(line.kept(sizes))
    last = n + len(J)
    matrix, rows, columns = line.bordered(K, J, n_h, sizes)
    inverse = np.linalg.pinv(matrix, rcond=TOLERANCES.sharpened_slope)
    moving = bool(np.any(motion.u))
    scale = float(np.max(np.abs(K) @ sizes + np.abs(J.T) @ np.abs(motion.nu), initial=0.0)) or 1.0

    def residual(x: Matrix, z: Any) -> Matrix:
        q, u, a = point.q + x[:n] * sizes, point.u, f.zeros(n)
        if moving and point.generator is not None:
            u, a = f.exact(point.generator.field(q)), f.exact(point.generator.acceleration(q))
        there = system.dynamics(q, u, system.scene.time)
        force = f.exact(there.F0) + f.times(f.exact(there.M), a) - line.measure * x[last]
        force = force + f.times(f.exact(there.J).T, point.nu + x[n:last])
        distances = f.times(kept, x[:n])
        distances[-1] -= z
        return f.exact(np.concatenate([force, f.exact(there.E)[:n_h], distances])) / rows

    def force(z: Any) -> Any:
        first = f.zeros(last + 1)
        first[:n] = f.exact(line.along / sizes) * z
        x = f.polished(first, lambda x: -f.applied(inverse, residual(x, z)) / columns, 1.0)
        return x[last] / scale

    return force
