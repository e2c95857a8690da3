"""Sizes of what multipliers balance: their rounding errors are relative to these, not to the multipliers."""

from __future__ import annotations

import numpy as np

from mbstab.analysis.reference.motion import Motion
from mbstab.compiler.system import Array, System


def multiplier_sizes(system: System, motion: Motion) -> Array:
    """Return the sizes of the terms of which the multipliers are sums, shape (n_c,).

    They contain the rounding of all the forces that they balance, and of the coordinates of these.
    """
    loads = system.terms(motion.q, motion.u, motion.a, motion.nu, motion.time)
    balanced = loads["F"] + loads["M"] @ np.abs(motion.a) + loads["J"].T @ np.abs(motion.nu)
    balanced = balanced + loads["K"] @ motion.sizes + loads["R"] @ np.abs(motion.u)
    return np.abs(motion.nu) + motion.balancing_sizes(balanced)
