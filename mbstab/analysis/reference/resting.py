"""Large scenes at rest: the reference with sparse matrices, without bases of what the constraints allow.

What `mbstab.analysis.reference.motion` does for any motion is done here for a given state of rest: constraints and
balance are checked, redundant rows are left out, and the multipliers solve

    [[1, Ĵᵀ], [Ĵ, 0]] [x; ν̂] = [−F̂; 0]

in scaled coordinates. The stiffness depends on the multipliers, so they are refined, with F + Jᵀν in more digits.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from mbstab.analysis.algebra.arrays import Index
from mbstab.analysis.algebra.inertia import ConstrainedForms
from mbstab.analysis.algebra.rounded import value_and_error
from mbstab.analysis.algebra.sparse import identity, in_sparse, row_norms, scaled
from mbstab.analysis.algebra.sparse_rank import Rows, SparseRank, rank_decisions
from mbstab.analysis.algebra.subspaces import coordinate_scale, repetitions, require_gap
from mbstab.analysis.reference.coefficients import Matrices
from mbstab.analysis.reference.imbalance import balanced_at
from mbstab.analysis.reference.motion import Finder
from mbstab.analysis.reference.refusals import redundant_rows, require_constant_rank
from mbstab.analysis.reference.rounded_scene import errors_of, rounded_system
from mbstab.analysis.reference.tolerances import TOLERANCES
from mbstab.compiler.system import Array, Dynamics, System
from mbstab.records import dataclass


@dataclass(frozen=True)
class Rest:
    """A reference at rest, with sparse matrices.

    Attributes
    ----------
    system : System
        With sparse matrices.
    q, nu : ndarray
        Coordinates (m, rad) and multipliers.
    errors : Matrices
        Error bounds of M, R, K, J and D_q entry by entry, at exact coordinates and multipliers: by the rounding of the
        decimals of the file, and inside of parameters and elements.
    displaced : tuple of Matrices
        Changes of M, R, K, J and D_q, all entries together, by the possible rounding of the coordinates and of the
        forces that the multipliers balance, with random signs.
    time : float (s)
    sizes : ndarray, shape (n_q,)
        Characteristic size of each coordinate.
    dynamics : Dynamics
    scale, row_scale : ndarray
        Factors of coordinates and rows; powers of two, so that scaling rounds nothing.
    kept : ndarray of int
        Rows that are independent, the holonomic ones first.
    rank_holonomic : int
    forms : ConstrainedForms
        Of the kept rows, scaled.
    warnings : tuple of str
    """

    system: System
    q: Array
    nu: Array
    errors: Matrices
    displaced: tuple[Matrices, ...]
    time: float
    sizes: Array
    dynamics: Dynamics
    scale: Array
    row_scale: Array
    kept: Any
    rank_holonomic: int
    forms: ConstrainedForms
    warnings: tuple[str, ...]

    @property
    def n_f(self) -> int:
        """Number of finite eigenvalues."""
        return 2 * (self.system.n_q - self.rank_holonomic) - (len(self.kept) - self.rank_holonomic)


def at_rest(system: System) -> Rest | None:
    """Return the reference of a scene that is given at rest, or None if it moves or must be solved for.

    Raises
    ------
    ModelFileError
        If the reference does not satisfy the constraints or is not in equilibrium.
    ConstraintError
        If the rank of the constraints cannot be decided.
    """
    scene, reference = system.scene, system.scene.model.reference
    if reference.find is not None or scene.steady is not None or scene.period is not None:
        return None
    system = in_sparse(system)
    finder = Finder(system)
    if any(scene.rates.values()):
        return None
    q, still, time = finder.coordinates(), np.zeros(system.n_q), float(scene.time)
    state = system.dynamics(q, still, time)
    if np.any(state.V) or np.any(state.B):
        return None
    scale = _power_of_two(coordinate_scale(state.M, finder.sizes, state.J, system.n_h, len(system.states[0])))
    row_scale = _power_of_two(1.0 / row_norms(scaled(state.J, scale)))
    J = scaled(state.J, scale, row_scale)
    decisions = rank_decisions(J, system.n_h)
    warnings = [x for decision in decisions for x in _warnings(system, *decision)]
    (C, _), (last, both) = decisions[0], decisions[-1]
    M = scaled(state.M, scale, scale)
    least = TOLERANCES.massless * abs(M).max()
    if last.forms.negatives(M - least * identity(system.n_q), TOLERANCES.rest_rounding * abs(M)) != 0:
        return None
    rest = Rest(
        system, q, np.zeros(system.n_c), Matrices(*5 * (None,)), (), time, finder.sizes, state, scale, row_scale,
        both[last.kept], C.rank, last.forms, (*finder.warnings, *warnings),
    )  # fmt: skip
    require_constant_rank(system, (q, still, time), C.left_null, last.rows.allowed, (scale, row_scale))
    return _balanced(finder, rest, last.rows)


def _power_of_two(x: Array) -> Array:
    result: Array = np.exp2(np.round(np.log2(x)))
    return result


def _warnings(system: System, found: SparseRank, numbers: Index) -> list[str]:
    """Return warnings about rows that others imply; refuse a decision without a gap."""
    rows = [system.rows[i] for i in numbers]
    require_gap(found, rows)
    return redundant_rows(repetitions(found, rows), found.largest_dropped)


def _balanced(finder: Finder, rest: Rest, allowed: Rows) -> Rest:
    """Return the reference with its multipliers; refuse one that is not in equilibrium."""
    system, scale = rest.system, rest.scale
    force = rest.dynamics.F0 * scale
    forces, transposed = force.astype(np.longdouble), allowed.J.T.astype(np.longdouble)
    nu, left = np.zeros(len(rest.kept), dtype=np.longdouble), force
    for _ in range(1 + TOLERANCES.multiplier_corrections):
        nu = nu - allowed.split(left)[1]
        left = np.asarray(forces + transposed @ nu, dtype=float)
    multipliers = np.zeros(system.n_c)
    multipliers[rest.kept] = np.asarray(nu, dtype=float) * rest.row_scale[rest.kept]
    found = replace(rest, nu=multipliers)
    at = found.q, 0.0 * found.q, 0.0 * found.q, found.nu
    if not balanced_at(system, at, left, rest.dynamics.F0, rest.sizes, scale, rest.time):
        worst = int(np.argmax(np.abs(left)))
        finder.refuse_unbalanced(worst, float(-left[worst] * scale[worst]), float(-left[worst] / scale[worst]))
    errors, loads = _errors(found)
    return replace(found, errors=errors, displaced=_displaced(found, allowed, loads))


def _errors(rest: Rest) -> tuple[Matrices, Array]:
    """Return error bounds of the matrices, and of the forces that the multipliers balance."""
    system, still = rounded_system(rest.system), np.zeros_like(rest.q)
    at = system.dynamics(rest.q, still, system.scene.time)
    M, J = errors_of(at.M), errors_of(at.J)
    K, R, D_q = (errors_of(x) for x in system.linearize(rest.q, still, still, rest.nu, system.scene.time))
    return Matrices(M, R, K, J, D_q), errors_of(at.F0) + J.T @ np.abs(rest.nu)


def _displaced(rest: Rest, allowed: Rows, unsure_loads: Array) -> tuple[Matrices, ...]:
    system, scale, still = rest.system, rest.scale, 0.0 * rest.q

    def matrices(q: Array, nu: Array, at: Dynamics) -> Matrices:
        K, R, D_q = system.linearize(q, still, still, nu, rest.time)
        return Matrices(at.M, R, K, at.J, D_q)

    terms = system.terms(rest.q, still, still, rest.nu, rest.time)
    loads, unsure = terms["F"] + terms["J"].T @ np.abs(rest.nu), _unsure(rest)
    loads = np.maximum(loads, unsure_loads / TOLERANCES.rest_rounding)
    # Over no more than the sizes of the coordinates, however little is known of them.
    step = TOLERANCES.drawn_rounding_size / float(np.max(unsure / rest.sizes, initial=1.0))
    here, rng, found = matrices(rest.q, rest.nu, rest.dynamics), np.random.default_rng(23), []
    for _ in range(TOLERANCES.drawn_roundings):
        signs, others = rng.choice((-1.0, 1.0), size=(2, system.n_q))
        q = rest.q + step * signs * unsure
        at = system.dynamics(q, still, rest.time)
        left = (at.F0 + at.J.T @ rest.nu + step * others * loads) * scale
        nu = rest.nu.copy()
        nu[rest.kept] -= allowed.split(left)[1] * rest.row_scale[rest.kept]
        found.append(
            Matrices(
                *((x - y) * (TOLERANCES.rest_rounding / step) for x, y in zip(matrices(q, nu, at), here, strict=True))
            )
        )
    return tuple(found)


def _unsure(rest: Rest) -> Array:
    """Return the sizes to which the rounding of coordinates is relative: those given by their errors."""
    given = rounded_system(rest.system).scene.coordinates
    found: Array = rest.sizes.copy()
    for i, name in enumerate(rest.system.names):
        if name in given:
            found[i] = value_and_error(given[name])[1] / TOLERANCES.rest_rounding
    return found
