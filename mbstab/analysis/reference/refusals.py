"""What is said of references at which ranks cannot be decided, or forces do not balance."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from mbstab.analysis.algebra.arrays import RandomNumbers, least_squares
from mbstab.analysis.algebra.failures import FAILURES
from mbstab.analysis.algebra.sparse import dense, largest, scaled
from mbstab.analysis.algebra.subspaces import Redundancy
from mbstab.analysis.algebra.tolerances import TOLERANCES as ALGEBRA
from mbstab.analysis.reference.tolerances import TOLERANCES
from mbstab.compiler.system import Array, Row, System
from mbstab.errors import ConstraintError, Problem, amount
from mbstab.model.bare_degrees import bare_degrees
from mbstab.model.scene import Scene
from mbstab.model.schema import is_length


def singular_configuration(curvature: float, combination: Array, rows: Sequence[Row]) -> ConstraintError:
    """Return the error about rows of which a combination vanishes at the reference only."""
    weights = np.abs(combination)
    named = [str(rows[i]) for i in np.argsort(-weights) if weights[i] > 0.1 * weights.max()][:4]
    return ConstraintError(
        "the mechanism is at a singular configuration: constraints that are independent nearby depend on "
        f"each other here (curvature {curvature:.3g})\nthe rows involved: {'; '.join(named)}\n"
        "hint: eigenvalues do not exist at such a point; move the reference away from it"
    )


def require_constant_rank(
    system: System,
    at: tuple[Array, Array, float],
    left_null: Array,
    allowed: Callable[[Array], Array],
    scales: tuple[Array, Array],
    instead: Callable[[], None] = lambda: None,
) -> None:
    """Refuse redundancy that does not persist nearby, along random motions.

    Nᵀ (Σ δ_i ∇²C_i) N = 0 must hold for every dependence δ.

    Parameters
    ----------
    at : tuple
        q, u and the time.
    left_null : ndarray, shape (n_h, k)
        The dependences of the scaled holonomic rows.
    allowed : callable
        Returns what the rows allow of motions in scaled coordinates, as columns.
    scales : tuple of ndarray, shapes (n_q,) and (n_c,)
        Of the coordinates and of the rows.
    instead : callable, optional
        Raises an error that explains the dependence better, if there is one.

    Raises
    ------
    ConstraintError
        Names the rows of a dependence that does not persist.
    """
    (q, u, time), (scale, row_scale), n_h, still = at, scales, len(left_null), np.zeros(system.n_q)
    if not left_null.size:
        return
    probes = allowed(RandomNumbers(9).uniform(-1.0, 1.0, system.n_q, TOLERANCES.curvature_probes))

    def stiffness(nu: Array) -> tuple[Any, Any]:
        return system.linearize(q, u, still, nu, time)[0], system.terms(q, u, still, nu, time)["K"]

    plain = stiffness(np.zeros(system.n_c))

    def curvature(weights: Array) -> list[Any]:
        """Return what multipliers of the rows add to the stiffness and to the sizes of its terms."""
        nu, factor = np.zeros(system.n_c), 1.0
        nu[:n_h] = weights * row_scale[:n_h]
        found = [x - y for x, y in zip(stiffness(nu), plain, strict=True)]
        size, beside = largest(found[1]), largest(plain[1])
        if 0.0 < size < beside:  # multipliers so large that their terms are not lost beside stiff springs
            factor = beside / size
            found = [x - y for x, y in zip(stiffness(factor * nu), plain, strict=True)]
        return [scaled(x, scale / factor, scale) for x in found]

    def along(matrix: Any, x: Array) -> Array:
        return np.asarray(x.T @ (matrix @ x))

    # Where rows are straight, the rest of their curvatures is rounding.
    rounding = TOLERANCES.curvature_rounding * along(curvature(np.ones(n_h))[1], np.abs(probes))
    for combination in left_null.T:
        bent, single = curvature(combination)
        # What the rows hold moves by rounding alone.
        most, total = np.maximum(along(single, np.abs(probes)), largest(single)), np.abs(along(bent, probes))
        if np.any(total > np.maximum(TOLERANCES.curvature_of_dependent_rows * most, rounding)):
            instead()
            raise singular_configuration(float(np.max(total / most)), combination, system.rows)


def redundant_rows(redundant: Sequence[Redundancy], misfit: float) -> list[str]:
    """Return warnings about rows that repeat others, up to a misfit relative to their lengths."""
    found = [f"redundant constraint: {item}" for item in redundant]
    if redundant and misfit > TOLERANCES.coordinate_rounding:
        found.append(
            f"the redundant rows repeat the others to {amount(misfit)} only; smaller than "
            f"{ALGEBRA.singular_value_zero:g}, this is taken for rounding in the file, not for a constraint"
        )
    return found


def vanishing_rows(system: System, at: tuple[Array, Array, float], J: Any, sizes: Array) -> list[Problem]:
    """Return a problem for each holonomic row whose derivative vanishes where it holds, as that of a square does."""
    q, u, time = at
    n_h, zero = system.n_h, np.zeros(system.n_q)
    here = abs(J[:n_h]) @ sizes
    try:
        beside = abs(system.dynamics(q + TOLERANCES.other_position * sizes, zero, time).J[:n_h]) @ sizes
    except FAILURES:
        return []
    problems = []
    for i in np.flatnonzero(here <= TOLERANCES.vanishing_derivative * beside).tolist():
        bent = dense(system.linearize(q, u, zero, np.eye(1, system.n_c, i)[0], time)[0])
        bent = bent - dense(system.linearize(q, u, zero, np.zeros(system.n_c), time)[0])
        H, gradient = bent * sizes * sizes[:, None], dense(J[[i]])[0] * sizes
        way = least_squares(H, -gradient, rcond=1e-9)
        left = float(np.linalg.norm(gradient + H @ way))
        if np.linalg.norm(way) <= TOLERANCES.vanishing_derivative and left <= 1e-3 * np.linalg.norm(gradient):
            row = system.rows[i]
            message = f"the derivative of {row} vanishes where it holds, as that of a square: it constrains no velocity"
            hint = "write what must be zero without a power, such as a.x for a.x**2, one constraint for each"
            problems.append(
                system.scene.model.document.problem(row.location, f"{row.section}.{row.name}", message, hint)
            )
    return problems


def inertias_too_far_apart(system: System, M: Any, sizes: Array) -> str:
    """Return what to say where inertias differ by so much that double precision cannot tell ranks; else nothing."""
    diagonal = M.diagonal()
    moved = np.flatnonzero(diagonal > 0.0)
    if not len(moved):
        return ""
    # Squares of sizes may leave the range of double precision.
    inertia = np.log10(diagonal[moved]) + 2.0 * np.log10(sizes[moved])
    heavy, light = moved[np.argmax(inertia)], moved[np.argmin(inertia)]
    decades, most = float(np.ptp(inertia)), -2.0 * math.log10(ALGEBRA.singular_value_zero)
    if decades < most:
        return ""

    def shown(i: np.intp) -> str:
        return f"{diagonal[i]:.3g} {'kg' if is_length(system.names[i]) else 'kg*m^2'} along {system.names[i]}"

    return (
        f"the inertias are too far apart for double precision: {shown(heavy)}, {shown(light)} "
        f"(ratio 1e{decades:.0f}, at most 1e{most:.0f})\n"
        "hint: correct the larger or the smaller; what is meant to stand still can be joined to ground"
    )


def turns_and_degrees(scene: Scene) -> str:
    """Return the end of a hint about the first given angle of more than a turn (rad); empty: there is none."""
    for name, value in scene.coordinates.items():
        if "." in name and not is_length(name) and abs(value) > 2.0 * math.pi:
            turns = f"{value / (2.0 * math.pi):.3g} turns"
            return f"; {name}: {value:g} rad are {turns}, and degrees are written {value:g}*deg"
    for text in bare_degrees(scene.model):
        return f"; {text}".replace("\nhint: ", ", and ")
    return ""
