"""Forces and drives that do work on a scene, and their power; energies at the reference, entry by entry."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np
from numpy.polynomial import legendre

from mbstab.analysis.algebra.tolerances import EPS
from mbstab.analysis.reference.coefficients import multiplier_sizes
from mbstab.analysis.reference.motion import Motion
from mbstab.analysis.simulate.constrained import Constrained
from mbstab.analysis.simulate.many_states import FAILURES, found_at
from mbstab.analysis.simulate.tolerances import TOLERANCES
from mbstab.compiler.system import Array, System
from mbstab.records import Answer, dataclass


@cache
def antiderivative(count: int) -> tuple[Array, Array]:
    """Return nodes in −1 … 1 (Gauss), and the matrix from values there to the Legendre series of their integral."""
    nodes, _ = legendre.leggauss(count)
    series = np.linalg.inv(legendre.legvander(nodes, count - 1))
    return nodes, legendre.legint(series, lbnd=-1.0)


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
        Whether constraints may do work, as `may_work` says.
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
            bool(may_work(system)),
        )

    @property
    def conservative(self) -> bool:
        """Whether nothing does work, so that the sum of kinetic and potential energy is constant."""
        return not (self.working or self.damped or self.driven)

    def powers(self, parts: Mapping[str, System], q: Array, u: Array, t: Any) -> dict[str, Any]:
        """Return the power of each force without a potential and of each damper (W), by entry, of states (…, n_q)."""
        found = {path: -np.sum(parts[path].dynamics(q, u, t).F0 * u, axis=-1) for path in self.working}
        for path in self.damped:
            part = parts[path]
            force = part.dynamics(q, u, t).F0 - part.dynamics(q, np.zeros_like(u), t).F0
            found[path] = -np.sum(force * u, axis=-1)
        return found

    def power(self, equations: Constrained, times: Array, q: Array, u: Array, a: Array | None = None) -> Array:
        """Return the power of all without a potential, shape (n_t,) (W), at accelerations as in `found_at`."""
        system = equations.arrays
        parts = system.remember("parts", None, lambda: dict(system.parts()))
        try:
            with np.errstate(all="ignore"):
                total = sum(self.powers(parts, q, u, times).values(), np.zeros(len(times)))
            if not np.isfinite(total).all():
                raise FloatingPointError
        except FAILURES:
            own = dict(equations.system.parts())
            singly = [sum(self.powers(own, *state).values()) for state in zip(q, u, times.tolist(), strict=True)]
            total = np.array(singly, dtype=float)
        if not self.driven:
            return total
        found = found_at(equations, times, q, u, a)
        return np.asarray(total - np.sum(found.nu * (found.J @ u[..., None])[..., 0], axis=-1))


def may_work(system: System) -> set[str]:
    """Return the entries whose rows may do work: drives, rows written as expressions, contacts with moving surfaces."""
    moved = {path for path, _ in system.given_functions() if path.startswith("contacts.")}
    return moved | {item.entry.path for item in system.scene.items if item.entry.section in ("drives", "constraints")}


@dataclass(frozen=True)
class Share:
    """The part of an entry in the energy of a scene.

    Attributes
    ----------
    owner : str
        Such as ``body 'rod'`` or ``force 'spring'``.
    kinetic, potential : float (J)
        The potential energy of a body is that of its weight.
    power : float (W)
        What forces without a potential, dampers and driven rows do on the scene; negative where they take energy out;
        0 where it is below its rounding error.
    power_error : float (W)
        Bound of the rounding error of the power, from the sizes of the terms of which it is the sum.
    """

    owner: str
    kinetic: float
    potential: float
    power: float
    power_error: float

    @classmethod
    def of(cls, owner: str, kinetic: float, potential: float, power: float, power_error: float) -> Share:
        """Return a share, without a power that is rounding."""
        return cls(owner, kinetic, potential, power if abs(power) > power_error else 0.0, power_error)


@dataclass(frozen=True)
class Energies(Answer):
    """The energy of a scene at its reference motion, and what changes it.

    Attributes
    ----------
    motion : Motion
    shares : tuple of Share
        Of the bodies, and of the entries that have energy or do work, in the order of the file.
    """

    motion: Motion
    shares: tuple[Share, ...]

    @property
    def total(self) -> Share:
        """The sum over the scene; its power is the rate at which kinetic and potential energy change."""
        kinetic, potential, power, error = (
            sum(getattr(x, name) for x in self.shares) for name in ("kinetic", "potential", "power", "power_error")
        )
        return Share.of("sum", kinetic, potential, power, error)


def energies(motion: Motion, system: System) -> Energies:
    """Return the energies at a reference motion, and the power of what is not conservative."""
    q, u, t = motion.q, motion.u, motion.time
    zero, sizes, rounding = np.zeros(len(u)), np.abs(u), TOLERANCES.roundings_of_power * EPS
    reactions = multiplier_sizes(system, motion)
    energy, parts, driven = Energy.of(system), dict(system.parts()), may_work(system)
    powers = energy.powers(parts, q, u, t)
    called = {f"bodies.{body.name}": f"body {body.name!r}" for body in system.scene.bodies}
    called |= {item.entry.path: item.entry.called for item in system.scene.items}
    shares = []
    for path, name in called.items():
        part = parts.get(path)
        if part is None:
            continue
        section, _, own = path.partition(".")
        rows = [i for i, row in enumerate(system.rows) if (row.section, row.name) == (section, own)]
        power, terms = powers.get(path, 0.0), 0.0
        if path in powers:
            terms += float(part.terms(q, u, zero, motion.nu[rows], t)["F"] @ sizes)
        if path in driven:
            J = motion.dynamics.J[rows]
            power -= float(motion.nu[rows] @ (J @ u))
            terms += float(reactions[rows] @ np.abs(J @ u)) + float(np.abs(motion.nu[rows]) @ (abs(J) @ sizes))
        kinetic = 0.5 * float(u @ part.dynamics(q, u, t).M @ u) if section == "bodies" else 0.0
        if not rows or path in driven:
            shares.append(Share.of(name, kinetic, float(part.potential(q)), power, rounding * terms))
    return Energies(motion, tuple(shares))
