"""Modes of first-order states alone, such as the own eigenvalue of a filter: no body moves in them.

Eigenvectors have rounding errors: in such a mode they let bodies move by next to nothing, and other states, too. What
moves is found from the equations, not from the size of these motions: a mode is one of states alone if the largest
states, with all else at rest, satisfy the linearized equations entry by entry to the errors of their coefficients. A
force on a body, however small, or another state that follows, is no such error. Where the effects of several states
cancel, as those of three tyres that relax against each other, their amplitudes are first corrected within the errors of
an eigenvector.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from mbstab.analysis.algebra.arrays import Complex, Flags, Index, least_squares
from mbstab.analysis.algebra.tolerances import TOLERANCES as ALGEBRA
from mbstab.analysis.linear.linearize import Linearization
from mbstab.analysis.spectrum.tolerances import TOLERANCES
from mbstab.compiler.system import Array

if TYPE_CHECKING:
    from mbstab.analysis.algebra.shift_invert import SparseQuadratic
    from mbstab.analysis.linear.sparse_equations import SparseEquations


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
            x_alone, satisfies = _corrected(equations, values[which], bounds[which], alone[:, which])
        alone[:, which], satisfied = x_alone, which[satisfies]
        found[:, satisfied], open_[satisfied] = alone[:, satisfied], False
    return found


def at_rest_beside_states(linear: Linearization, values: Complex, bounds: Array, x: Complex) -> Complex:
    """Return modes of a linearization as `states_alone` does."""
    states = linear.system.states[0]
    if not len(states):
        return x
    from mbstab.analysis.linear.sparse_equations import SparseEquations

    return states_alone(SparseEquations.of_linearization(linear), states, values, bounds, x)


def _corrected(equations: SparseEquations, s: Complex, bounds: Array, x: Complex) -> tuple[Complex, Flags]:
    """Return motions of states with corrected amplitudes, and which satisfy the equations to the errors of entries."""
    found, (left, known) = x.copy(), _residuals(equations, s, bounds, x)
    satisfied = np.all(np.abs(left) <= known, axis=0)
    near = np.max(np.abs(left), axis=0) <= TOLERANCES.amplitudes_corrected * np.max(known, axis=0)
    for k in np.flatnonzero(near & ~satisfied).tolist():
        moving = np.flatnonzero(x[:, k])
        free = moving[moving != np.argmax(np.abs(x[:, k]))]
        if not len(free):
            continue
        units = np.zeros((len(x), len(free)), dtype=complex)
        units[free, np.arange(len(free))] = x[free, k]
        repeated = np.full(len(free), s[k]), np.zeros(len(free))
        weight = np.max(known[:, k])
        effects = _residuals(equations, *repeated, units)[0] / weight
        change = least_squares(effects, -left[:, k] / weight, rcond=None)
        if np.max(np.abs(change)) <= TOLERANCES.amplitude_change:
            found[:, k] += units @ change
    changed = np.flatnonzero(np.any(found != x, axis=0))
    if len(changed):
        left, known = _residuals(equations, s[changed], bounds[changed], found[:, changed])
        satisfied[changed] = np.all(np.abs(left) <= known, axis=0)
    return found, np.asarray(satisfied)


def _residuals(equations: SparseEquations, s: Complex, bounds: Array, x: Complex) -> tuple[Complex, Array]:
    """Return what is left of the equations for each column, and what errors of their entries and of s explain."""
    from mbstab.analysis.algebra.sparse_rank import Rows

    problem, sizes = equations.problem, equations.known_to
    J, size = equations.matrices.J, np.abs(s)

    def summed(parts: SparseQuadratic, s: Any, z: Any) -> Any:
        rows = len(z)
        return sum(parts.part(k)[:rows, :rows] @ (z * s**k) for k in range(3))

    def errors(z: Complex) -> Any:
        moved, rows = np.abs(z), len(z)
        known = ALGEBRA.entry_rounding * summed(sizes, size, moved)
        known += sum(np.abs(summed(change, s, z)) for change in equations.moved)
        return known + bounds * sum(
            k * (abs(problem.part(k)[:rows, :rows]) @ (moved * size ** (k - 1))) for k in (1, 2)
        )

    force = summed(problem, s, x)
    force = np.where(np.abs(force) <= errors(x), 0.0, force)  # what errors explain needs no reactions
    reactions = Rows(J).multipliers(np.hstack([force.real, force.imag]))
    z = np.vstack([x, -reactions[:, : len(s)] - 1j * reactions[:, len(s) :]])
    return np.asarray(summed(problem, s, z)), np.asarray(errors(z))
