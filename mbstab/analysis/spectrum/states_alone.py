"""Modes of first-order states alone, such as the own eigenvalue of a filter: no body moves in them.

Eigenvectors have rounding errors: in such a mode they let bodies move by next to nothing, and other states, too. What
moves is found from the equations, not from the size of these motions: a mode is one of states alone if the largest
states, with all else at rest, satisfy the linearized equations entry by entry to the errors of their coefficients. A
force on a body, however small, or another state that follows, is no such error.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from mbstab.analysis.algebra.arrays import Complex, Flags, Index
from mbstab.analysis.algebra.shift_invert import SparseQuadratic
from mbstab.analysis.algebra.sparse_rank import Rows
from mbstab.analysis.algebra.tolerances import TOLERANCES as ALGEBRA
from mbstab.analysis.linear.linearize import Linearization
from mbstab.analysis.linear.sparse_equations import SparseEquations
from mbstab.analysis.spectrum.tolerances import TOLERANCES
from mbstab.compiler.system import Array


def states_alone(equations: SparseEquations, states: Index, values: Complex, bounds: Array, x: Complex) -> Complex:
    """Return modes in which all that moves by rounding only is at rest, where states move alone.

    Parameters
    ----------
    equations : SparseEquations
    states : ndarray of int
        Numbers of the coordinates that are first-order states.
    values, bounds : ndarray, shape (k,)
        Eigenvalues and their error bounds (1/s).
    x : ndarray of complex, shape (n_q, k)
        Δq in scaled coordinates, as columns.
    """
    if not len(states) or not x.size:
        return x
    sizes = np.zeros(x.shape)
    sizes[states] = np.abs(x[states])
    largest = np.max(sizes, axis=0)
    found, open_ = x.copy(), (largest > 0.0) & np.isfinite(bounds)
    for decade in range(TOLERANCES.states_apart + 1):
        alone = np.where((sizes > 0.0) & (sizes >= 10.0**-decade * largest), x, 0.0)
        which = np.flatnonzero(open_)
        with np.errstate(all="ignore"):  # errors may be infinite
            satisfied = which[_satisfied(equations, values[which], bounds[which], alone[:, which])]
        found[:, satisfied], open_[satisfied] = alone[:, satisfied], False
    return found


def at_rest_beside_states(linear: Linearization, values: Complex, bounds: Array, x: Complex) -> Complex:
    """Return modes of a linearization as `states_alone` does."""
    states = linear.system.states[0]
    return states_alone(SparseEquations.of_linearization(linear), states, values, bounds, x) if len(states) else x


def _satisfied(equations: SparseEquations, s: Complex, bounds: Array, x: Complex) -> Flags:
    """Return for each column whether it satisfies the equations to the errors of their entries and of s."""
    problem, sizes, n = equations.problem, equations.known_to, equations.n_q
    J = equations.matrices.J
    force = sum(problem.part(k)[:n, :n] @ (x * s**k) for k in range(3))
    reactions = Rows(J).multipliers(np.hstack([force.real, force.imag]))
    z = np.vstack([x, -reactions[:, : len(s)] - 1j * reactions[:, len(s) :]])
    size, moved, rows = np.abs(s), np.abs(z), n + J.shape[0]

    def summed(parts: SparseQuadratic, s: Any, z: Any) -> Any:
        return sum(parts.part(k)[:rows, :rows] @ (z * s**k) for k in range(3))

    known = ALGEBRA.entry_rounding * summed(sizes, size, moved)
    known += sum(np.abs(summed(change, s, z)) for change in equations.moved)
    known += bounds * sum(k * (abs(problem.part(k)[:rows, :rows]) @ (moved * size ** (k - 1))) for k in (1, 2))
    return np.asarray(np.all(np.abs(summed(problem, s, z)) <= known, axis=0))
