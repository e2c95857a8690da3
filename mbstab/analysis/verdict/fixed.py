"""Motions that the isotropy of a reference fixes: a part that decouples, nonlinearly.

Symmetries that do not move the reference map disturbances to disturbances. Those that they leave alone, Fix, are an
invariant part of the motions; the linearized equations divide into those of Fix and of the rest (Schur; Vanderbauwhede
1989). Where the rest decays and the energy of Fix has a strict minimum, all motions nearby stay near (Pliss 1964; Carr
1981): the torsion of a rotor beside bearings that damp its bending.
"""

from __future__ import annotations

import numpy as np

from mbstab.analysis.algebra.arrays import RandomNumbers
from mbstab.analysis.algebra.ball_arrays import middle
from mbstab.analysis.algebra.stacks import complement
from mbstab.analysis.reference.fields import Field
from mbstab.analysis.verdict.directions import span
from mbstab.analysis.verdict.minimum import SecondVariation, sign_of
from mbstab.analysis.verdict.neutral import Separated, Structure
from mbstab.analysis.verdict.tolerances import TOLERANCES
from mbstab.compiler.system import Array


def fixed_motions(structure: Structure, separated: Separated, left: int) -> str:
    """Return why motions that the isotropy fixes stay near while all others decay; empty: not known.

    Parameters
    ----------
    left : int
        Number of eigenvalues left of the imaginary axis.
    """
    field = _isotropy(structure)
    if field is None or structure.linear.massless is not None:
        return ""
    S = separated.S
    H = _on_disturbances(structure, field)
    size = float(np.linalg.norm(S, 2)) * float(np.linalg.norm(H, 2))
    if not size or np.linalg.norm(H @ S - S @ H) > TOLERANCES.direction_closure * size:
        return ""
    images, s, right = np.linalg.svd(H)
    rank = int(np.sum(s > TOLERANCES.independent_direction * s[0]))
    rest, fixed = images[:, :rank], right[rank:].T
    if rank != left or float(np.max(np.linalg.eigvals(rest.T @ S @ rest).real)) >= 0.0:
        return ""
    if not _conserved(structure, field):
        return ""
    energy = SecondVariation(structure, separated)
    W = fixed @ complement(span(fixed.T @ structure.at.of_momenta(structure.invariance.integrals).T))
    W = W @ complement(span(W.T @ separated.T))
    if sign_of(energy.on(W)) != 1:
        return ""
    return (
        "motions that the symmetries of the reference leave alone are by themselves, and their energy has a strict "
        "minimum; all others decay"
    )


def _isotropy(structure: Structure) -> Field | None:
    """Return a symmetry that does not move the reference, of as general a kind as there is; None if there is none."""
    identities, motion = structure.invariance.identities, structure.linear.motion
    space = identities.space
    if not space.shape[1]:
        return None
    moved = np.array([identities.field(c).field(motion.q) / motion.sizes for c in space.T]).T
    _, s, right = np.linalg.svd(moved)
    still = right[int(np.sum(s > TOLERANCES.independent_direction)) :].T
    if not still.shape[1]:
        return None
    c = middle(space) @ (still @ RandomNumbers(6).uniform(0.5, 1.0, still.shape[1]))
    return identities.field(np.where(np.abs(c) > 1e-12 * np.max(np.abs(c)), c, 0.0))


def _on_disturbances(structure: Structure, field: Field) -> Array:
    """Return the action of a symmetry on disturbances in the coordinates of S, shape (n, n)."""
    motion, h, columns = structure.linear.motion, TOLERANCES.acceleration_difference, []
    slope = field.slope(motion.q)
    for y in np.eye(len(structure.space.A)):
        dq, du = structure.disturbance(y)
        bent = (field.slope(motion.q + h * dq) - field.slope(motion.q - h * dq)) @ motion.u / (2.0 * h)
        columns.append(structure.column(slope @ dq, slope @ du + bent))
    return np.array(columns).T


def _conserved(structure: Structure, field: Field) -> bool:
    """Return whether the forces on motions that a symmetry leaves alone conserve their energy, at random states.

    The power of F(q, X + w) along w, with the field X of the reference, is then linear in w, and closed.
    """
    linear = structure.linear
    motion, sizes, system = linear.motion, linear.motion.sizes, linear.system
    _, s, right = np.linalg.svd(field.slope(motion.q) * sizes / sizes[:, None])
    kept = sizes[:, None] * right[int(np.sum(s > TOLERANCES.independent_direction)) :].T
    rng, seen = RandomNumbers(7), 0
    acting = [e for e in structure.invariance.elements if not e.inertia]
    if not all(e.analytic for e in acting):
        return False
    for _ in range(TOLERANCES.fixed_states):
        step, speed = (kept @ rng.uniform(-0.3, 0.3, kept.shape[1]) for _ in range(2))
        at = structure.invariance.onto_rows(motion.q + step, motion.u + structure.invariance.rate * speed)
        if at is None or np.any(np.abs(field.field(at.q)) > TOLERANCES.independent_direction * sizes):
            continue
        seen += 1
        X = motion.u if linear.generator is None else linear.generator.field(at.q)
        w, none = at.u - X, np.zeros(len(X))

        def power(v: Array, q: Array = at.q, X: Array = X, none: Array = none) -> tuple[float, float]:
            terms = [np.array(e.force(q, X + v, none, motion.time), float) * v[list(e.columns)] for e in acting]
            return float(sum(np.sum(x) for x in terms)), float(sum(np.sum(np.abs(x)) for x in terms))

        (ahead, size), (back, _), (twice, more), (again, _) = (power(k * w) for k in (1.0, -1.0, 2.0, -2.0))
        limit = TOLERANCES.direction_closure * (size + more)
        if abs(ahead + back) > limit or abs(twice - again - 2.0 * (ahead - back)) > limit:
            return False
        K, R, _ = system.linearize(at.q, X, none, np.zeros(system.n_c), motion.time)
        slope = np.zeros((len(X), len(X))) if linear.generator is None else linear.generator.slope(at.q)
        stiffness = kept.T @ (K + R @ slope) @ kept
        off = np.abs(stiffness - stiffness.T)
        if np.any(off > TOLERANCES.direction_closure * np.max(np.abs(stiffness), initial=0.0)):
            return False
    return seen > 1
