"""What does work on a scene, and its power; the potential energy is that of the system."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mbstab.analysis.simulate.constrained import Form
from mbstab.compiler.system import Array, Dynamics, System

NODES, WEIGHTS = (x.tolist() for x in np.polynomial.legendre.leggauss(4))
"""Gauss quadrature of the power over a part of a step: exact to order 8."""


@dataclass(frozen=True)
class Energy:
    """What does work on a scene.

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
        """Whether nothing does work: the sum of kinetic and potential energy is constant."""
        return not (self.working or self.damped or self.driven)

    def power(self, parts: Mapping[str, Form], q: Array, u: Array, t: float, state: Dynamics, nu: Array) -> float:
        """Return the power of all that has no potential (W): forces, dampers, drives."""
        total = -float(nu @ (state.J @ u)) if self.driven else 0.0
        zero = np.zeros(len(u))
        for path in self.working:
            total -= float(parts[path].dynamics(q, u, t).F0 @ u)
        for path in self.damped:
            part = parts[path]
            total -= float((part.dynamics(q, u, t).F0 - part.dynamics(q, zero, t).F0) @ u)
        return total
