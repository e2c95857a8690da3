"""Large scenes at rest: the reference with sparse matrices, without bases of what the constraints allow.

What `mbstab.analysis.reference.motion` does for any motion is done here for a given state of rest: constraints and
balance are checked, redundant rows are left out, and the multipliers solve

    [[1, Ĵᵀ], [Ĵ, 0]] [x; ν̂] = [−F̂; 0]

in scaled coordinates. The stiffness depends on the multipliers, so they are refined, with F + Jᵀν in more digits.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from mbstab.analysis.algebra.arrays import others
from mbstab.analysis.algebra.inertia import ConstrainedForms
from mbstab.analysis.algebra.rounded import value_and_error
from mbstab.analysis.algebra.sparse import identity, in_sparse, row_norms, scaled
from mbstab.analysis.algebra.sparse_rank import Rows, SparseRank, sparse_rank
from mbstab.analysis.algebra.subspaces import Redundancy, coordinate_scale, require_gap
from mbstab.analysis.algebra.tolerances import TOLERANCES as ALGEBRA
from mbstab.analysis.reference.coefficients import Matrices
from mbstab.analysis.reference.imbalance import balanced_at
from mbstab.analysis.reference.motion import Finder
from mbstab.analysis.reference.refusals import redundant_rows, singular_configuration
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
    kept, rank, warnings = _independent(system, J)
    forms = ConstrainedForms(J[kept])
    M = scaled(state.M, scale, scale)
    least = TOLERANCES.massless * abs(M).max()
    if forms.negatives(M - least * identity(system.n_q), TOLERANCES.rest_rounding * abs(M)) != 0:
        return None
    rest = Rest(
        system, q, np.zeros(system.n_c), Matrices(*5 * (None,)), (), time, finder.sizes, state, scale, row_scale, kept,
        rank, forms, (*finder.warnings, *warnings),
    )  # fmt: skip
    _check_constant_rank(rest, J)
    return _balanced(finder, rest, J)


def _power_of_two(x: Array) -> Array:
    result: Array = np.exp2(np.round(np.log2(x)))
    return result


def _independent(system: System, J: Any) -> tuple[Any, int, list[str]]:
    """Return which rows to keep, how many of them are holonomic, and warnings about the others."""
    C = sparse_rank(J[: system.n_h])
    require_gap(C, system.rows[: system.n_h])
    rows = np.concatenate([C.kept, np.arange(system.n_h, system.n_c)]).astype(np.intp)
    if system.n_c == system.n_h:
        return rows, C.rank, _redundant(system, C, np.arange(system.n_h))
    both = sparse_rank(J[rows])
    require_gap(both, [system.rows[i] for i in rows])
    kept = rows[both.kept]
    return kept, int(np.sum(kept < system.n_h)), [
        *_redundant(system, C, np.arange(system.n_h)), *_redundant(system, both, rows)
    ]  # fmt: skip


def _redundant(system: System, found: SparseRank, rows: Any) -> list[str]:
    """Return warnings about redundant rows."""
    if not len(found.dropped):
        return []
    weights = found.left_null @ np.linalg.inv(found.left_null[found.dropped])
    redundant = []
    for i, combination in zip(found.dropped, weights.T, strict=True):
        repeats = [k for k in np.flatnonzero(np.abs(combination) > ALGEBRA.row_weight_dependent) if k != i]
        redundant.append(Redundancy(system.rows[rows[i]], tuple(system.rows[rows[k]] for k in repeats)))
    return redundant_rows(redundant, found.largest_dropped)


def _balanced(finder: Finder, rest: Rest, J: Any) -> Rest:
    """Return the reference with its multipliers; refuse one that is not in equilibrium."""
    system, scale = rest.system, rest.scale
    force, rows = rest.dynamics.F0 * scale, J[rest.kept]
    allowed = Rows(rows)
    forces, transposed = force.astype(np.longdouble), rows.T.astype(np.longdouble)
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


def stiffness_of(rest: Rest, nu: Array) -> Any:
    """Return the part of the stiffness that multipliers cause, a sparse matrix."""
    return _added(lambda x: rest.system.linearize(rest.q, 0.0 * rest.q, 0.0 * rest.q, x, rest.time)[0], nu)


def curvature_sizes(rest: Rest, nu: Array) -> Any:
    """Return the sizes of the terms whose sum that part is."""
    return _added(lambda x: rest.system.terms(rest.q, 0.0 * rest.q, 0.0 * rest.q, x, rest.time)["K"], nu)


def _added(stiffness: Callable[[Array], Any], nu: Array) -> Any:
    """Return what multipliers add to a matrix."""
    plain = stiffness(0.0 * nu)
    found = stiffness(nu) - plain
    size, beside = float(abs(found).max()), float(abs(plain).max())
    if not size or size >= beside:
        return found
    # Multipliers so large that their terms are not lost beside stiff springs.
    factor = beside / size
    return (stiffness(factor * nu) - plain) / factor


def _check_constant_rank(rest: Rest, J: Any) -> None:
    """Refuse redundancy that does not persist nearby: curvatures of dependent rows must cancel in allowed motions."""
    system = rest.system
    dropped = others(system.n_h, rest.kept[rest.kept < system.n_h])
    if not len(dropped):
        return
    left_null = sparse_rank(J[: system.n_h]).left_null
    probes = Rows(J[rest.kept]).split(np.random.default_rng(9).normal(size=(system.n_q, TOLERANCES.curvature_probes)))[
        0
    ]

    def along(matrix: Any, x: Array) -> Array:
        result: Array = x.T @ (scaled(matrix, rest.scale, rest.scale) @ x)
        return result

    every = np.where(np.arange(system.n_c) < system.n_h, rest.row_scale, 0.0)
    # Where rows are straight, the rest of their curvatures is rounding.
    rounding = TOLERANCES.curvature_rounding * along(curvature_sizes(rest, every), np.abs(probes))
    for combination in left_null.T:
        nu = np.zeros(system.n_c)
        nu[: system.n_h] = combination * rest.row_scale[: system.n_h]
        total, single = np.abs(along(stiffness_of(rest, nu), probes)), along(curvature_sizes(rest, nu), np.abs(probes))
        if np.any(total > np.maximum(TOLERANCES.curvature_of_dependent_rows * single, rounding)):
            raise singular_configuration(float(np.max(total / single)), combination, system.rows)
