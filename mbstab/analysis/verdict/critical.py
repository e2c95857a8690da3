"""An unexplained zero eigenvalue: stability by the first nonlinear coefficient.

Rest positions (or steady motions of the same frame) are followed along the critical direction: the
coordinate z along it is prescribed, a force r along it holds the motion there, and Newton's method
brings everything else into balance (Lyapunov and Schmidt). How r = a z^k + … begins is seen with many
digits at tiny distances, where no weak term of a lower power is hidden. Where energy is conserved or lost,
it is that of a mass in the potential ∫ r dz (Koiter 1945; Thompson and Hunt 1973; Hagedorn and Mawhin
1992, Arch. Rat. Mech. Anal. 120, for the instability without a minimum). Elsewhere, if all other
disturbances decay, r is in place of the force the speed at which the motion drifts in balance: that on
the centre manifold is ż = r(z) to its lowest power (Lyapunov 1892; Carr 1981). If r vanishes all along,
there is a family of such motions, as far as checked.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mbstab.analysis.algebra.arrays import least_squares
from mbstab.analysis.algebra.stacks import complement
from mbstab.analysis.algebra.tolerances import EPS
from mbstab.analysis.reference.coefficients import matrices_in
from mbstab.analysis.verdict.directions import span
from mbstab.analysis.verdict.many_digits import Line, ManyDigits
from mbstab.analysis.verdict.minimum import SecondVariation, sign_of
from mbstab.analysis.verdict.neutral import Separated, Structure, chains_of
from mbstab.analysis.verdict.rule import ASYMPTOTIC, ASYMPTOTIC_UP_TO, STABLE, STABLE_UP_TO, UNSTABLE, Critical
from mbstab.analysis.verdict.spectrum import Neutral
from mbstab.analysis.verdict.tolerances import TOLERANCES
from mbstab.compiler.system import Array
from mbstab.errors import MbstabError
from mbstab.records import dataclass

_POWERS = {2: "the square", 3: "the cube"}


@dataclass(frozen=True)
class _Path:
    """The force that holds the motion at distances ± z = measure·(q − q₀), farthest first, and its zero tolerance."""

    z: Array
    ahead: Array
    behind: Array
    zero_ahead: Array
    zero_behind: Array

    def sides(self, flat: Sequence[bool]) -> list[tuple[Array, Array]]:
        """Return the forces and their zero tolerances on those sides, ahead and behind, that are flat."""
        both = (self.ahead, self.zero_ahead), (self.behind, self.zero_behind)
        return [side for side, chosen in zip(both, flat, strict=True) if chosen]

    def vanishes(self, flat: Sequence[bool]) -> bool:
        """Whether there is no force all along those sides; rounding that could hide one is no evidence."""
        return all(np.all(np.abs(force) <= zero) for force, zero in self.sides(flat))


def critical_zero(
    structure: Structure, separated: Separated, count: int, others_decay: bool, digits: ManyDigits
) -> Critical | None:
    """Return the verdict of the first nonlinear coefficient about a zero eigenvalue, or None if it decides nothing.

    Parameters
    ----------
    count : int
        Number of eigenvalues at zero: 1, or 2 where they form a chain of a coordinate and its rate.
    others_decay : bool
        Whether all others lie left of the imaginary axis.
    digits : ManyDigits
        The motion with many digits. In double precision a zero cannot be told from 1e-20, which decides
        before any term of a higher power.
    """
    energy = SecondVariation(structure, separated)
    by_energy = structure.work.decreases and energy.applies and _definite_beside(energy, structure, separated)
    # Motions along symmetries near the reference are not examined.
    if len(separated.L) or separated.choice.moving or count > 2 or not (by_energy or (count == 1 and others_decay)):
        return None
    direction = _direction(structure, separated)
    if direction is None or digits.zeros(separated.frequencies()).number != separated.neutral.count + count:
        return None
    line = _line(structure, direction, drifts=not by_energy)
    powers = digits.powers(line)
    if powers is None:
        return None
    # A force that holds a motion acts against its own; a drift goes where it goes.
    sides = [(-sign if by_energy else sign, k) for k, sign in powers]
    away, k = max(sides, key=lambda side: (side[0], -side[1]))
    neutral = bool(separated.neutral.count)
    what = "force" if by_energy else "speed of the drift"
    grows = f"along the critical direction the {what} grows with {_POWERS.get(k, f'the power {k}')} of the distance"
    if away > 0:
        no_minimum = "does not bring the motion back: the energy has no minimum there"
        why = no_minimum if by_energy else "drives the motion away"
        return Critical(UNSTABLE, f"{grows} and {why}" + ", at least to one side" * (min(sides)[0] <= 0))
    if not away:
        # Disturbances that do not decay may drive the motion along the family, out of its stable part.
        flat, alone = [not sign for sign, _ in sides], separated.A.shape[0] == count
        if not (others_decay and count == 1) and not (alone and all(flat)):
            return None
        path = _followed(structure, replace(line, drifts=False))
        if path is None or not path.vanishes(flat):
            return None
        return _family(structure, direction, path, flat, not alone or not all(flat), _drift(separated, count))
    if by_energy:
        word = STABLE_UP_TO if neutral else STABLE
        why = f"{grows} and brings the motion back: the energy has a strict minimum there"
        if others_decay and count == 1:
            word = ASYMPTOTIC_UP_TO if neutral else ASYMPTOTIC
            why += ", and damping takes energy from every motion"
        return Critical(word, why)
    why = f"{grows} and brings the motion back"
    if not neutral:
        return Critical(ASYMPTOTIC, why)
    # It decays like t^(-1/(k-1)): even its square, which linear equations do not show, need not be summable.
    return Critical(ASYMPTOTIC_UP_TO, why, drift=max(1, _drift(separated, count)))


def _definite_beside(energy: SecondVariation, structure: Structure, separated: Separated) -> bool:
    """Return whether the energy is positive definite except for one critical direction."""
    W = energy.basis
    if not W.shape[1]:
        return False
    h = W.T @ energy.H @ W
    # What is no more than rounding is the smallest, in whatever unit.
    rounding = TOLERANCES.critical_beyond_rounding * np.diag(np.abs(W).T @ energy.known_to @ np.abs(W))
    scale = 1.0 / np.sqrt(np.maximum(np.maximum(np.abs(np.diag(h)), rounding), np.max(np.abs(h)) * 1e-12))
    _, vectors = np.linalg.eigh(h * scale * scale[:, None])
    rest = W @ (scale[:, None] * vectors[:, 1:])
    return sign_of(energy.on(rest)) == 1


def _direction(structure: Structure, separated: Separated) -> Array | None:
    """Return the critical shift of the positions in the basis N; None if there is not exactly one."""
    n = structure.space.n_xi
    T = separated.T[:n]
    left, s, _ = np.linalg.svd(T) if T.shape[1] else (np.eye(n), np.zeros(0), None)
    free = left[:, int(np.sum(s > 1e-8)) :]
    # Rates of the coordinates, and forces: at a position of rest both vanish.
    _, s, right = np.linalg.svd(separated.S[:, :n] @ free)
    if not len(s) or (len(s) > 1 and s[-2] <= TOLERANCES.simple_zero * s[0]):
        return None
    shift: Array = free @ right[-1]
    return shift


def _line(structure: Structure, shift: Array, drifts: bool) -> Line:
    """Return the line along a shift of the positions in the basis N."""
    motion, spaces = structure.linear.motion, structure.linear.spaces
    along = spaces.scale * (spaces.N @ shift)
    unit = float(np.max(np.abs(along / motion.sizes)))
    held = tuple(x.direction / motion.sizes for x in structure.invariance.symmetries)
    return Line(along / unit, (spaces.N @ shift) / spaces.scale * unit, held, drifts)


def _followed(structure: Structure, line: Line) -> _Path | None:
    """Return the force that holds the motion along a line, at distances halved again and again."""
    motion, along, measure = structure.linear.motion, line.along, line.measure
    distances: Array = np.array([TOLERANCES.critical_reach * 0.5**k for k in range(TOLERANCES.critical_halvings)])
    sides = []
    for sign in (1.0, -1.0):
        forces, zeros = [], []
        q, nu, r = motion.q, motion.nu, 0.0
        for z in sign * distances[::-1]:
            q = q + (z - float(measure @ (q - motion.q))) * along
            try:
                found = _balanced(structure, q, nu, r, line, float(z))
            except (MbstabError, ArithmeticError, ValueError, np.linalg.LinAlgError):
                found = None
            if found is None:
                break
            before = q
            q, nu, r = found
            forces.append(r)
            zeros.append(_zero(structure, q, (q - before) / z + along))
        sides.append((forces, zeros))
    reached = min(len(forces) for forces, _ in sides)
    if reached < TOLERANCES.critical_distances:
        return None
    (ahead, zero_ahead), (behind, zero_behind) = ((np.array(part[:reached][::-1]) for part in side) for side in sides)
    return _Path(distances[TOLERANCES.critical_halvings - reached :], ahead, behind, zero_ahead, zero_behind)


def _zero(structure: Structure, q: Array, tangent: Array) -> float:
    """Return the tolerance for no force along a direction: a fraction of the forces of the single elements along it."""
    motion = structure.linear.motion
    each = size = 0.0
    for element in structure.invariance.elements:
        columns = list(element.columns)
        force = np.array(element.force(q, motion.u, motion.a, motion.time), dtype=float)
        before = np.array(element.force(motion.q, motion.u, motion.a, motion.time), dtype=float)
        # Constant loads must not hide a weak force.
        each += abs(float((force - before) @ tangent[columns]))
        size += float(np.abs(force) @ np.abs(tangent[columns]))
    return TOLERANCES.force_vanishes * each + TOLERANCES.force_rounding * size


def _acting(structure: Structure, q: Array, u: Array, a: Array) -> Array:
    """Return the sizes of the forces that act along each coordinate, shape (n_q,)."""
    total = np.zeros(len(q))
    for element in structure.invariance.elements:
        force = np.array(element.force(q, u, a, structure.linear.motion.time), dtype=float)
        total[list(element.columns)] += np.abs(force)
    return total


def _balanced(
    structure: Structure, q: Array, nu: Array, r: float, line: Line, z: float
) -> tuple[Array, Array, float] | None:
    """Return q, ν and r of the motion that a force r along the critical direction holds at a distance (Newton)."""
    linear, reference = structure.linear, structure.linear.motion
    system, generator = linear.system, linear.generator
    n, c, n_h = system.n_q, system.n_c, system.n_h
    sizes, measure = reference.sizes, line.measure
    kept = line.kept(sizes)
    before = np.inf
    for _ in range(TOLERANCES.newton_steps_critical):
        u = np.zeros(n) if not np.any(reference.u) else (generator.field(q) if generator is not None else reference.u)
        a = generator.acceleration(q) if generator is not None and generator.turns else np.zeros(n)
        state = system.dynamics(q, u, reference.time)
        at = replace(reference, q=q, u=u, a=a, nu=nu, dynamics=state)
        matrices = matrices_in(system, at, generator if generator is not None and generator.turns else None)
        K = matrices.K
        # Forces far away, or on other bodies, do not tell how well forces balance here.
        acting = _acting(structure, q, u, a) + np.abs(state.J.T) @ np.abs(nu) + np.abs(measure * r)
        rounding = TOLERANCES.critical_balance * acting + 4.0 * EPS * np.abs(K) @ (np.abs(q) + np.abs(reference.q))
        force = state.F0 + state.M @ a + state.J.T @ nu - measure * r
        distances = kept @ ((q - reference.q) / sizes)
        distances[-1] -= z
        residual = np.concatenate([force, state.E[:n_h], state.V[n_h:], distances])
        allowed = np.concatenate(
            [
                rounding,
                4.0 * EPS * np.abs(state.J[:n_h]) @ (np.abs(q) + sizes),
                4.0 * EPS * (np.abs(matrices.D_q) @ (np.abs(q) + sizes) + np.abs(state.J[n_h:]) @ np.abs(u)),
                np.full(len(line.held), TOLERANCES.critical_balance),
                [4.0 * EPS * float(np.abs(measure) @ (np.abs(q) + np.abs(reference.q)))],
            ]
        )
        off = float(np.max(np.abs(residual) / np.maximum(allowed, 1e-300)))
        if off <= 1.0 or (off <= 1e3 and off > 0.5 * before):
            return q, nu, r
        before = off
        matrix, rows, columns = line.bordered(matrices, n_h, sizes)
        step = -least_squares(matrix, residual / rows, rcond=1e-13) / columns
        q, nu, r = q + sizes * step[:n], nu + step[n : n + c], r + float(step[-1])
    return None


def _drift(separated: Separated, count: int) -> int:
    """Return the power of time with which disturbances along neutral directions and of the remaining zeros grow."""
    values, vectors = np.linalg.eig(separated.A)
    zeros = vectors[:, np.argsort(np.abs(values))[:count]]
    T = span(separated.T, separated.B @ zeros.real, separated.B @ zeros.imag)
    return Neutral(chains=chains_of(replace(separated, T=T, L=separated.L[:0], B=complement(T)))).drift


def _family(
    structure: Structure, shift: Array, path: _Path, flat: Sequence[bool], decays: bool, drift: int
) -> Critical:
    """Return the verdict from a family of motions that was followed to both sides, or to one, to which others return.

    From the other side, on the centre manifold ż = r(z), motions come back to the first member (Carr 1981).
    """
    spaces, names = structure.linear.spaces, structure.linear.names
    change = np.abs(spaces.scale * (spaces.N @ shift) / structure.linear.motion.sizes)
    name = names[int(np.argmax(change))]
    off = max(float(np.max(np.abs(force))) for force, _ in path.sides(flat))
    both = all(flat)
    goes, ways = ("goes through", "both ways") if both else ("begins with", "one way")
    return Critical(
        ASYMPTOTIC_UP_TO if decays else STABLE_UP_TO,
        f"as far as checked: a family of motions of the same kind {goes} this one, along {name} "
        f"(followed by {path.z[0]:.2g} of the size of the scene {ways}; {off:.0e} N or N*m are left of the forces), "
        + ("" if both else "a force brings motions on the other side back, ")
        + ("and all other disturbances decay" if decays else "and the energy has a strict minimum across it"),
        "numerical",
        f"position of {name}",
        drift,
    )
