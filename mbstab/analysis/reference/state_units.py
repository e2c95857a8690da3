"""Units of first-order states that balance the linearized equations.

A state may be a force in N or in µN: the unit is up to the file, and nothing else says how large it is. In the
deflated system ẏ = A y it is chosen as in balancing a matrix (Osborne 1960, J. ACM 7; Parlett and Reinsch 1969): the
effect of a state on all others is as large as theirs on it, with speeds in the unit for which the same holds.
"""

from __future__ import annotations

import math
from contextlib import suppress

import numpy as np

from mbstab.analysis.algebra.rank import rank_of
from mbstab.analysis.algebra.sparse import is_sparse, scaled
from mbstab.analysis.algebra.subspaces import Subspaces, subspaces
from mbstab.analysis.reference.tolerances import TOLERANCES
from mbstab.compiler.system import Array, Dynamics, System
from mbstab.errors import MbstabError
from mbstab.model.schema import is_length
from mbstab.model.units import parse_unit


def characteristic_sizes(system: System, start: Array) -> Array:
    """Return the characteristic size of each coordinate, (n_q,); those of first-order states where a search starts."""
    is_a_length, scene = np.array([is_length(name) for name in system.names]), system.scene
    given = [abs(v) for n, v in scene.coordinates.items() if is_length(n)]
    length = max([*scene.lengths, *given], default=0.0) or _longest_parameter(system) or 1.0
    sizes, units = np.where(is_a_length, length, 1.0), None
    if len(system.states[0]):
        with suppress(MbstabError, ArithmeticError, ValueError):
            at = start, np.zeros(system.n_q), scene.time
            state = system.dynamics(*at)
            spaces = subspaces(state.M, state.J, system.n_h, system.rows, sizes)
            units = balanced_states(system, spaces, state, at, sizes)
    return sizes if units is None else units[0]


def _longest_parameter(system: System) -> float:
    """Return the largest parameter that is a length, for scenes whose size only equations determine; or 0."""
    values, metre = system.scene.parameters, parse_unit("m")[1]
    lengths = [n for n, p in system.scene.model.parameters.items() if p.unit and parse_unit(p.unit)[1] == metre]
    return max((abs(float(values[n])) for n in lengths if not hasattr(values[n], "shape")), default=0.0)


def balanced_states(
    system: System, spaces: Subspaces, state: Dynamics, at: tuple[Array, Array, float], sizes: Array
) -> tuple[Array, Array] | None:
    """Return characteristic sizes and scale of the coordinates with balanced units of first-order states.

    Parameters
    ----------
    spaces : Subspaces
        What the constraints allow, with any units of the states.
    state : Dynamics
    at : tuple
        q, u and the time.
    sizes : ndarray, shape (n_q,)

    Returns
    -------
    tuple of ndarray, or None if there are no states, or their units are balanced already
    """
    states = system.states[0]
    if not len(states) or is_sparse(state.M):
        return None
    # The reactions of a rest or of a steady motion are near enough.
    scale, row_scale = spaces.scale, spaces.row_scale
    nu = -row_scale * (spaces.inverse(scaled(state.J, scale, row_scale)).T @ (state.F0 * scale))
    q, u, time = at
    factors = _factors(_couplings(system, spaces, (state.J, *system.linearize(q, u, np.zeros_like(q), nu, time))))
    if np.all(factors == 1.0):
        return None
    scale, sizes, heavy = scale.copy(), sizes.copy(), state.M.diagonal() > 0.0
    scale[states] *= factors
    if heavy.any():
        sizes[states] = scale[states] * float(np.median(sizes[heavy] / scale[heavy]))
    return sizes, scale


def _couplings(system: System, spaces: Subspaces, matrices: tuple[Array, ...]) -> Array:
    """Return the sizes of the effects of positions, speeds and each state (columns) on each other (rows)."""
    (states, rows), scale, N = system.states, spaces.scale, spaces.N
    J, K, R, D_q = matrices
    # Constraints may couple states and bodies: a state moves these with it, and they move where no state does. What
    # rounding leaves of either would be taken for a coupling.
    X = _product(N, np.asarray(np.linalg.pinv(N[states])))
    N = N @ rank_of(N[states]).null
    N[states] = 0.0
    R, K = (x * scale * scale[:, None] for x in (R, K))
    rates = np.linalg.pinv(J[rows][:, states]) / scale[states, None]
    J, D_q = J[rows] * scale, D_q[rows - system.n_h] * scale
    found = np.zeros((2 + len(states), 2 + len(states)))
    found[0, 1] = 1.0
    found[1, 0], found[1, 1] = (float(np.linalg.norm(N.T @ x @ N)) for x in (K, R))
    found[1, 2:] = _lengths(_product(N.T, _product(K, X)), 0) + _lengths(_product(N.T, _product(R, X)), 0)
    found[2:, 0], found[2:, 1] = (_lengths(_product(_product(rates, x), N), 1) for x in (D_q, J))
    found[2:, 2:] = np.abs(_product(rates, _product(D_q, X)))
    return found


def _lengths(A: Array, axis: int) -> Array:
    return np.asarray(np.linalg.norm(A, axis=axis))


def _product(A: Array, B: Array) -> Array:
    """Return A B with zeros in place of what is rounding: it must not scale a state."""
    product, sizes = A @ B, (np.abs(A), np.abs(B))
    # Bases and derivatives are rounded relative to their largest entries, too, but rows of zeros are exact.
    largest = np.max(sizes[0], axis=1, keepdims=True, initial=0.0, where=np.any(B, axis=1))
    most = TOLERANCES.coordinate_rounding * largest * np.max(sizes[1], axis=0, initial=0.0)
    return np.where(np.abs(product) > np.maximum(TOLERANCES.state_coupling * (sizes[0] @ sizes[1]), most), product, 0.0)


def _factors(couplings: Array) -> Array:
    """Return factors for the units of the states, powers of two, that balance rows and columns."""
    size = couplings * (1.0 - np.eye(len(couplings)))
    weights = np.ones(len(size))
    seen, seeing = np.any(size, axis=0), np.any(size, axis=1)
    mutual = (seen & seeing) | (np.arange(len(size)) < 2)
    between = np.where(mutual[:, None] & mutual, size, 0.0)  # a state that only drives has no part in their balance
    for _ in range(TOLERANCES.balancing_steps):
        before = weights.copy()
        for i in range(1, len(size)):
            row, column = _around(between, weights, i)
            if row and column:
                weights[i] *= _power_of_two(math.sqrt(row / column))
        if np.all(weights == before):
            break
    rate = float(np.max((couplings * weights / weights[:, None])[np.ix_(mutual, mutual)]))
    for i in np.flatnonzero(seen ^ seeing).tolist():
        # The effect of what only follows or only drives is made as large as those of the others.
        row, column = _around(size, weights, i)
        if i > 1 and rate:
            weights[i] *= _power_of_two(row / rate if row else rate / column)
    return weights[2:]


def _around(size: Array, weights: Array, i: int) -> tuple[float, float]:
    """Return the lengths of a row and of a column in some units."""
    row, column = np.linalg.norm(size[i] * weights), np.linalg.norm(size[:, i] / weights)
    return float(row / weights[i]), float(column * weights[i])


def _power_of_two(x: float) -> float:
    return math.ldexp(1.0, round(math.log2(x)))
