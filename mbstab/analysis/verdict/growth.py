"""Instability without a growing eigenvalue: zeros that form a chain, where motions obey linear equations.

A chain of zeros makes disturbances of the linearized equations grow like a power of t. Nonlinear terms may
hold such motions back (x'' = −x³), so this proves nothing about other equations. Where inertia, forces and rows are
linear in the state, the linearized equations are those of all motions. Two zeros in a chain are then uniform motions:
their first vector v, A v = 0, is a direction of equilibria. From three on the second vector grows, too, A w = v, along
which no motion can be shifted.
"""

from __future__ import annotations

import numpy as np

from mbstab.analysis.algebra.ball_arrays import many_bits
from mbstab.analysis.reference.identities import NO_VALUE
from mbstab.analysis.verdict.exact_sums import Structure as Exact
from mbstab.analysis.verdict.exact_sums import Sum
from mbstab.analysis.verdict.many_digits import ManyDigits
from mbstab.analysis.verdict.neutral import Structure
from mbstab.analysis.verdict.work import same
from mbstab.analysis.verdict.written import with_state
from mbstab.model.expressions import ExpressionError


def growing_zeros(structure: Structure, digits: ManyDigits) -> str:
    """Return why disturbances grow like a power of t beside the symmetries of a scene at rest; empty: not known.

    Parameters
    ----------
    digits : ManyDigits
        The motion with many digits, which counts the eigenvalues that are zero.
    """
    linear, items = structure.linear, structure.invariance.symmetries
    moves = np.any(linear.motion.u) or (linear.generator is not None and linear.generator.moves)
    if moves or any(x.of.shift is None for x in items):
        return ""
    if not all_linear(structure):
        return ""
    chain = digits.zeros(()).chain
    if chain < 3:
        return ""  # at most uniform motions: places and their speeds
    return (
        f"the equations are linear, and {chain} zero eigenvalues form a chain: disturbances grow like t^{chain - 1} "
        f"along one direction, and like {'t' if chain == 3 else f't^{chain - 2}'} along another, which no symmetry "
        "explains"
    )


def all_linear(structure: Structure) -> bool:
    """Return whether inertia, forces and rows are linear in the state: written ones as they are written."""
    system, invariance = structure.linear.system, structure.invariance
    if system.sparse:
        return False
    exact = Exact(system.scene)
    try:
        written = all(_linear(exact.exact(expression)) for _, expression in with_state(system))
    except ExpressionError:
        return False
    return written and _same_slopes(structure) and bool(invariance.seen) and _same_rows(structure)


def _linear(x: Sum) -> bool:
    """Return whether each term of a sum contains at most one coordinate or rate, and as a factor."""
    factors = ([(atom, n) for atom, n in monomial if atom.state] for monomial, _ in x.terms)
    return all(not found or (len(found) == 1 and found[0][0].kind == "state" and found[0][1] == 1) for found in factors)


def _same_slopes(structure: Structure) -> bool:
    """Return whether all elements have the same derivatives at other states."""
    identities = structure.invariance.identities
    try:
        with many_bits():
            for cluster in identities.clusters:
                states = identities.beside(cluster)
                for own in (x for x in cluster.elements if not x.element.rows):
                    if not states or not own.analytic:
                        return False
                    first, *others = ([at.entry(own, key)[0] for key in "KR"] for at in states)
                    if not all(same(*pair) for x in others for pair in zip(first, x, strict=True)):
                        return False
    except NO_VALUE:
        return False
    return True


def _same_rows(structure: Structure) -> bool:
    """Return whether all rows have the same derivatives at states that satisfy them."""
    system, time = structure.linear.system, structure.linear.motion.time
    first, *others = (
        (state.dynamics.J, system.linearize_rows(state.q, state.u, state.a, time)[0])
        for state in structure.invariance.on_rows
    )
    return all(np.array_equal(x, y) for other in others for x, y in zip(first, other, strict=True))
