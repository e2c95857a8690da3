"""Forces and drives that do work on a scene, and their power; the potential energy is that of the system."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mbstab.compiler.form import Form
from mbstab.compiler.system import Array, System
from mbstab.records import dataclass


def quadrature(order: int) -> list[tuple[float, float]]:
    """Return nodes in −1 … 1 and weights for the power over a part of a step of a method of some order (Gauss)."""
    nodes, weights = np.polynomial.legendre.leggauss(max(2, (order + 1) // 2))
    return list(zip(nodes.tolist(), weights.tolist(), strict=True))


@dataclass(frozen=True)
class Energy:
    """Forces and drives that do work on a scene.

    Attributes
    ----------
    working : tuple of str
        Forces without a potential, such as ``forces.motor``.
    damped : tuple of str
        Forces with a potential that are dampers as well.
    driven : bool
        Whether constraints may do work: drives, and rows written as expressions.
    """

    working: tuple[str, ...]
    damped: tuple[str, ...]
    driven: bool

    @classmethod
    def of(cls, system: System) -> Energy:
        """Sort the entries of a scene."""
        forces = [element for element in system.acting() if not element.inertia]
        return cls(
            tuple(dict.fromkeys(x.path for x in forces if not x.stored)),
            tuple(dict.fromkeys(x.path for x in forces if x.damped)),
            any(item.entry.section in ("drives", "constraints") for item in system.scene.items),
        )

    @property
    def conservative(self) -> bool:
        """Whether nothing does work, so that the sum of kinetic and potential energy is constant."""
        return not (self.working or self.damped or self.driven)

    def power(self, parts: Mapping[str, Form], q: Array, u: Array, t: float) -> float:
        """Return the power of forces and dampers without a potential (W)."""
        total, zero = 0.0, np.zeros(len(u))
        for path in self.working:
            total -= float(parts[path].dynamics(q, u, t).F0 @ u)
        for path in self.damped:
            part = parts[path]
            total -= float((part.dynamics(q, u, t).F0 - part.dynamics(q, zero, t).F0) @ u)
        return total
