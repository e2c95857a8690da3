"""The energy of a mode, and the powers that change it, entry by entry.

With the matrices of the linearized equations in the frame where they are constant, a mode Δq = x exp(λt) has

    (λ² M + λ R + K) x + Jᵀ ν = 0,   C_q x = 0,   (λ D_u + D_q) x = 0.

The real part of this equation times the conjugate speeds λ̄ xᴴ is the balance

    2 Re λ · E = P,   E = ½ xᴴ (|λ|² M + K₊) x,
    P = −|λ|² xᴴ R₊ x − Re(λ̄ xᴴ K₋ x) − Re((λ D_u x)ᴴ μ)

with the symmetric and skew parts R₊, K₊ and K₋ of the matrices. E consists of the kinetic energy, the strain of
springs, and the geometric stiffness of loads: weight, reactions, tension, centrifugal forces of a turning frame. The
power consists of that of dampers (R₊), of circulatory stiffness (K₋), and of the reactions of nonholonomic rows, along
whose change of direction a disturbance moves. Gyroscopic forces (the skew part of R) and holonomic reactions have no
power.

Every matrix is the sum of those of the entries of the scene, and so is every term.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from mbstab.analysis.algebra.arrays import Complex, least_squares
from mbstab.analysis.algebra.sparse import in_sparse, large
from mbstab.analysis.algebra.tolerances import EPS
from mbstab.analysis.linear.linearize import Linearization
from mbstab.analysis.reference.attitude import Attitudes
from mbstab.analysis.reference.efforts import Placement
from mbstab.analysis.spectrum.tolerances import TOLERANCES
from mbstab.compiler.system import Array
from mbstab.records import dataclass


@dataclass(frozen=True)
class EnergyShare:
    """The part of an entry in the energy of a mode, and in the power that changes it.

    Attributes
    ----------
    owner : str
        Such as ``body 'rod'`` or ``force 'spring'``.
    kinetic, strain, load : float
        Energies relative to the kinetic energy of the mode: of its motion in the frame of the equations, of a
        spring's stretch, of the geometric stiffness of weight, reactions, preload and the turning frame.
    damping, circulation, reaction : float (1/s)
        Powers, relative to the same energy: of the symmetric part of R, of the skew part of K, of the reactions of
        nonholonomic rows. Positive where they feed the mode.
    """

    owner: str
    kinetic: float
    strain: float
    load: float
    damping: float
    circulation: float
    reaction: float

    @property
    def energy(self) -> float:
        """The sum of the energies."""
        return self.kinetic + self.strain + self.load

    @property
    def power(self) -> float:
        """The sum of the powers (1/s)."""
        return self.damping + self.circulation + self.reaction


@dataclass(frozen=True)
class EnergyBalance:
    """The energy of a mode and the powers that change it.

    Attributes
    ----------
    value : complex (1/s)
        The eigenvalue of the matrices as they are rounded: from the more accurate one of `mbstab.analysis.linear` it
        differs within its error bound.
    shares : tuple of EnergyShare
        In the order of the file, bodies first; entries without energy and power are left out.
    """

    value: complex
    shares: tuple[EnergyShare, ...]

    @property
    def total(self) -> EnergyShare:
        """The sum over the scene."""
        return EnergyShare("sum", *(float(sum(getattr(x, name) for x in self.shares)) for name in ENTRIES))

    @property
    def defect(self) -> float:
        """|2 Re λ · E − P|, relative to the largest of its terms: energies times |λ|, and powers."""
        total = self.total
        sizes = (*(abs(self.value),) * 3, 1.0, 1.0, 1.0)
        terms = [size * abs(getattr(x, name)) for x in self.shares for size, name in zip(sizes, ENTRIES, strict=True)]
        return abs(2.0 * self.value.real * total.energy - total.power) / max(terms, default=1.0)


ENTRIES = ("kinetic", "strain", "load", "damping", "circulation", "reaction")
"""The numbers of a share."""


def mode_energies(linear: Linearization, modes: Sequence[tuple[complex, Complex]]) -> list[EnergyBalance]:
    """Return the energy balance of modes.

    Parameters
    ----------
    linear : Linearization
    modes : sequence of (complex, ndarray)
        Eigenvalues (1/s), and shapes Δq (m, rad) of any size, shape (n_q,).
    """
    energies, modes = _Energies(linear), list(modes)
    found = energies.balances(modes)
    for _ in range(TOLERANCES.balance_improvements):
        loose = [i for i, x in enumerate(found) if x.defect > TOLERANCES.balance_defect]
        if not loose:
            break
        for i in loose:
            modes[i] = energies.improved(*modes[i])
        for i, other in zip(loose, energies.balances([modes[i] for i in loose]), strict=True):
            found[i] = min(found[i], other, key=lambda x: x.defect)
    return found


class _Energies:
    """The terms of the balance, entry by entry."""

    def __init__(self, linear: Linearization) -> None:
        self.linear, self.motion = linear, linear.motion
        self.system = in_sparse(linear.system) if large(linear.system) else linear.system
        scene = self.system.scene
        self.items = {item.entry.path: item for item in scene.items}
        self.called = {f"bodies.{body.name}": f"body {body.name!r}" for body in scene.bodies}
        self.called |= {path: item.entry.called for path, item in self.items.items()}
        elements = [x for x in self.system.acting() if not x.inertia]
        # Forces with a potential, and those written as expressions.
        self.elastic = {x.path for x in elements if x.stored or x.written}

    def balances(self, modes: Sequence[tuple[complex, Complex]]) -> list[EnergyBalance]:
        """Return the balance of each mode."""
        values = np.array([value for value, _ in modes], dtype=complex)
        X = np.array([x for _, x in modes], dtype=complex).reshape(len(modes), self.system.n_q).T
        squares = np.abs(values) ** 2
        unit = 0.5 * squares * np.real(np.sum(X.conj() * (self.linear.M @ X), axis=0))
        unit[unit == 0.0] = 1.0
        reactions = self._reactions(values, X)
        shares: list[list[EnergyShare]] = [[] for _ in modes]
        for path, (m, r, k) in self._forms(X):
            strain = self._strain(path, X, k)
            none = np.zeros(len(modes))
            numbers = np.array([
                0.5 * squares * m.real, strain, 0.5 * k.real - strain,
                -squares * r.real, -values.imag * k.imag, reactions.get(path, none),
            ])  # fmt: skip
            for own, column in zip(shares, (numbers / unit + 0.0).T.tolist(), strict=True):
                if any(column):
                    own.append(EnergyShare(self.called[path], *column))
        return [EnergyBalance(value, tuple(own)) for (value, _), own in zip(modes, shares, strict=True)]

    def _forms(self, X: Complex) -> Iterator[tuple[str, tuple[Complex, Complex, Complex]]]:
        """Yield for each entry xᴴMx, xᴴRx and xᴴKx of every mode, in the frame of the equations."""
        generator, motion = self.linear.generator, self.motion
        turned = twice = np.zeros_like(X)
        if generator is not None and generator.turns:
            turned, twice = (A @ X for A in generator.frame(motion.q))
        for path, part in self.system.parts():
            K, R, _ = part.linearize(motion.q, motion.u, motion.a, motion.nu, motion.time)
            M = part.dynamics(motion.q, motion.u, motion.time).M
            forms = M @ X, R @ X + 2.0 * (M @ turned), K @ X + R @ turned + M @ twice
            m, r, k = (np.sum(X.conj() * Y, axis=0) for Y in forms)
            yield path, (m, r, k)

    def _strain(self, path: str, X: Complex, k: Complex) -> Array:
        """Return the strain energy of an entry in each mode; `k` is xᴴKx."""
        item = self.items.get(path)
        if item is None or path not in self.elastic:
            return np.zeros(X.shape[1])
        effort = item.kind.effort(item) if item.kind.effort is not None else None
        if effort is None or (effort.motion == "distance" and not effort.rest):
            return np.asarray(0.5 * k.real)  # the same in all directions, or not along a single motion
        q, n = self.motion.q, X.shape[1]
        place = Placement(
            Attitudes.of(self.system), self.system, np.broadcast_to(q, (2 * n, len(q))), np.vstack([X.real.T, X.imag.T])
        )
        stretch = np.asarray(place.rate(effort.motion, effort.of)).reshape(2, n)
        return np.asarray(0.5 * float(effort.stiffness) * np.sum(stretch**2, axis=0))

    def _reactions(self, values: Complex, X: Complex) -> dict[str, Array]:
        """Return the power of the reactions of nonholonomic rows by entry; redundant rows share it equally."""
        linear = self.linear
        if not linear.D_q.shape[0]:
            return {}
        force = (linear.M @ X) * values**2 + (linear.R @ X) * values + linear.K @ X
        nu = linear.balancing(force.T).T
        power = -np.real(np.conj(values * (linear.J @ X)) * nu)
        found: dict[str, Array] = {}
        for row, one in zip(linear.rows[linear.n_h :], power[linear.n_h :], strict=True):
            if row.section == "directions":
                continue  # a direction without mass: its multiplier is zero
            path = f"{row.section}.{row.name}"
            found[path] = found.get(path, 0.0) + one
        return found

    def improved(self, value: complex, x: Complex) -> tuple[complex, Complex]:
        """Return eigenvalue and shape after a Newton step in the coordinates that the holonomic rows allow."""
        linear, spaces = self.linear, self.linear.spaces
        N = spaces.scale[:, None] * spaces.N
        D_u, D_q = (A * spaces.row_scale[linear.n_h :, None] for A in (linear.J[linear.n_h :], linear.D_q))
        Q, slope = value**2 * linear.M + value * linear.R + linear.K, 2.0 * value * linear.M + linear.R
        rows = value * D_u + D_q
        n, c = N.shape[1], len(D_u)
        A = np.zeros((n + c + 1, n + c + 1), dtype=complex)
        A[:n, :n], A[:n, n:-1], A[:n, -1] = N.T @ Q @ N, (D_u @ N).T, N.T @ (slope @ x)
        A[n:-1, :n], A[n:-1, -1], A[-1, :n] = rows @ N, D_u @ x, (x / spaces.scale).conj() @ spaces.N
        right = np.concatenate([N.T @ (Q @ x), rows @ x, [0.0]])
        step = least_squares(A, right, rcond=EPS * len(A))
        change = complex(step[-1])
        return value - (change if value.imag else change.real), x - N @ step[:n]
