"""Energy of a motion: kinetic, potential of weight and springs, and the power of everything else."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from mbstab.analysis.reference.attitude import Attitudes
from mbstab.analysis.reference.efforts import Placement
from mbstab.compiler.form import Form
from mbstab.compiler.system import Array, System
from mbstab.model.scene import ItemValues

SPRINGS = ("spring", "bearing", "joint_spring")
"""Types of forces with a potential; all others do work."""


def quadrature(order: int) -> list[tuple[float, float]]:
    """Return nodes in −1 … 1 and weights for the power over a part of a step of a method of some order (Gauss)."""
    nodes, weights = np.polynomial.legendre.leggauss(max(2, (order + 1) // 2))
    return list(zip(nodes.tolist(), weights.tolist(), strict=True))


@dataclass(frozen=True)
class Energy:
    """What stores energy in a scene, and what does work on it.

    Attributes
    ----------
    springs, working : tuple of str
        Entries with a potential, and forces without, such as ``forces.spring``.
    damped : tuple of str
        Springs that are dampers as well.
    driven : bool
        Whether constraints may do work: drives, and rows written as expressions.
    """

    system: System
    attitudes: Attitudes
    springs: tuple[ItemValues, ...]
    working: tuple[str, ...]
    damped: tuple[str, ...]
    driven: bool

    @classmethod
    def of(cls, system: System, attitudes: Attitudes) -> Energy:
        """Sort the entries of a scene."""
        forces = [item for item in system.scene.items if item.entry.section == "forces"]
        springs = tuple(item for item in forces if item.kind.name in SPRINGS)
        return cls(
            system,
            attitudes,
            springs,
            tuple(item.entry.path for item in forces if item.kind.name not in SPRINGS),
            tuple(item.entry.path for item in springs if item.given("damping") and item.number("damping") != 0.0),
            any(item.entry.section in ("drives", "constraints") for item in system.scene.items),
        )

    @property
    def conservative(self) -> bool:
        """Whether nothing does work: the sum of kinetic and potential energy is constant."""
        return not (self.working or self.damped or self.driven)

    def potential(self, system: System, q: Array) -> Array:
        """Return the potential energy of weight and springs (J), shape (…), at q (…, n_q) in the chart of `system`."""
        scene = system.scene
        at = Placement(self.attitudes, system, q, np.zeros_like(q))
        d, total = scene.dimension, np.zeros(q.shape[:-1])
        gravity = np.array(scene.gravity, dtype=float)
        for i, (body, part) in enumerate(zip(scene.bodies, system.body_slices, strict=True)):
            place = q[..., part.start : part.start + d] + at.turns[..., i, :, :] @ np.array(body.center, dtype=float)
            total -= float(body.mass) * (place @ gravity)
        return np.asarray(total + sum(_stored(at, spring) for spring in self.springs))

    def power(self, parts: Mapping[str, Form], q: Array, u: Array, t: float) -> float:
        """Return the power of forces and dampers without a potential (W)."""
        total, zero = 0.0, np.zeros(len(u))
        for path in self.working:
            total -= float(parts[path].dynamics(q, u, t).F0 @ u)
        for path in self.damped:
            part = parts[path]
            total -= float((part.dynamics(q, u, t).F0 - part.dynamics(q, zero, t).F0) @ u)
        return total


def _stored(at: Placement, item: ItemValues) -> Any:
    """Return the energy of a spring (J), shape (…)."""
    assert item.kind.effort
    effort = item.kind.effort(item)
    rest = float(effort.rest)
    return 0.5 * float(effort.stiffness) * (at.motion(effort.motion, effort.of, rest) - rest) ** 2
