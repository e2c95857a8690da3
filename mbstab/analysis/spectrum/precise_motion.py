"""The reference motion in refined numbers, starting from double precision: with any number of digits, or with slopes.

Given values are the decimals of the file. Double precision selects the solution;
the residual of the same equations on numbers with many digits, corrected by the Jacobian in double
precision, takes it to all digits; on numbers with slopes, to its derivatives by parameters.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np

from mbstab.analysis.algebra.arrays import norms
from mbstab.analysis.algebra.digits import misfits
from mbstab.analysis.algebra.rank import rank_of
from mbstab.analysis.algebra.refining import Matrix, Refining, Stalled
from mbstab.analysis.algebra.tolerances import TOLERANCES as ALGEBRA
from mbstab.analysis.linear.linearize import Linearization, linearize
from mbstab.analysis.reference.equations import Balance, State
from mbstab.analysis.reference.equilibrium import Problem
from mbstab.analysis.reference.motion import Motion
from mbstab.analysis.reference.requested import reference_motion
from mbstab.analysis.reference.rotation import rate_matrix
from mbstab.analysis.reference.sharpening import family_in, sharpened
from mbstab.analysis.reference.steady import Family, Generator, centered, declared_family
from mbstab.analysis.reference.tolerances import TOLERANCES as REFERENCE
from mbstab.analysis.spectrum.eigenvalues import judged
from mbstab.analysis.spectrum.results import EigenResult
from mbstab.analysis.verdict.directions import span
from mbstab.analysis.verdict.facts import Grounds
from mbstab.analysis.verdict.many_digits import ManyDigits
from mbstab.compiler.system import Array, Dynamics, System
from mbstab.errors import ConstraintError, MbstabError, NumericalError, UsageError
from mbstab.model import balls
from mbstab.model.schema import Model
from mbstab.model.values import evaluate
from mbstab.records import dataclass

# --- what double precision says -------------------------------------------------------------------------------------


class Start:
    """The answer in double precision, from which everything is refined.

    Parameters
    ----------
    model : Model
    frozen : bool
        As in `mbstab.analysis.linear.linearize.linearize`.
    digits : ManyDigits, optional
        As in `mbstab.analysis.spectrum.eigenvalues.eigenvalues`.

    Attributes
    ----------
    system : System
    motion : Motion
    linear : Linearization
    grounds : Grounds
        The structure, which does not depend on the digits.
    balance, at : Balance and State, or None
        The equations of an equilibrium or a steady motion that was solved for, and their solution.

    Raises
    ------
    UsageError
        If the motion is periodic.
    """

    def __init__(self, model: Model, frozen: bool, digits: ManyDigits | None = None) -> None:
        self.model = model
        self.system = system = System(evaluate(model))
        if system.scene.period is not None and not frozen:
            raise UsageError(
                f"{model.name} describes a periodic motion: its multipliers come in double precision only, "
                "without derivatives\nhint: leave out --precision or --sensitivity"
            )
        self.at: State | None = None
        self.balance: Balance | None = None
        if model.reference.find is not None:
            self.motion, search, self.at, _ = Problem(system, massless=True).solved(Problem(system).start)
            self.balance = search.balance
        else:
            self.motion = reference_motion(system, massless=True)
        self.linear: Linearization = linearize(system, self.motion, frozen)
        self.motion = self.linear.motion
        self.grounds = Grounds(self.linear, digits)

    @cached_property
    def plain(self) -> EigenResult:
        """The answer in double precision."""
        return judged(self.grounds)

    @cached_property
    def loose(self) -> tuple[str, ...]:
        """Coordinates that neither the file nor the equations determine to all digits, unless nothing depends on them.

        Newton's method does not refine critical positions, at which the derivative of the equations is singular.
        """
        motion, names = self.motion, self.system.names
        if self.balance is not None and self.at is not None:
            open_ = self.balance.open.tolist()
            null = self.balance.equations(self.at).loose[: len(open_)]
        else:
            open_ = [i for i, name in enumerate(names) if name not in self.system.scene.coordinates]
            J = (motion.dynamics.J[: self.system.n_h] * motion.sizes)[:, open_]
            lengths = np.linalg.norm(J, axis=1)
            null = rank_of(J[lengths > 0.0] / lengths[lengths > 0.0, None]).null
        shifts = [x.direction[open_] / motion.sizes[open_] for x in self.grounds.invariance.symmetries]
        basis = span(np.array(shifts).reshape(len(shifts), len(open_)).T)
        free = np.linalg.norm(null - basis @ (basis.T @ null), axis=1) > REFERENCE.sharpened_coordinate
        return tuple(names[i] for i, loose in zip(open_, free, strict=True) if loose)


# --- the reference motion -------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Point:
    """The reference motion with all digits, or with slopes.

    Attributes
    ----------
    q, u, a, nu : ndarray of objects
        As in `mbstab.analysis.reference.motion.Motion`.
    state : Dynamics
        Matrices of objects and exact floats.
    generator : Generator or None
        Generator of the rotating frame in which the equations are written.
    rates : tuple of numbers
        Rates of that frame and of the coordinates that spin in it, as in `mbstab.analysis.verdict.neutral.Separated`.
    excess : tuple
        The largest residual, relative to the terms that balance, and what it belongs to.
    """

    q: Matrix
    u: Matrix
    a: Matrix
    nu: Matrix
    state: Dynamics
    generator: Generator | None
    rates: tuple[Any, ...]
    excess: tuple[Any, str]


def reference_point(start: Start, system: System, f: Refining) -> Point:
    """Return the reference motion of a scene in numbers that are refined.

    Raises
    ------
    ConstraintError, EquilibriumError, NumericalError
        If the solution in double precision cannot be refined with more digits.
    """
    motion, scene = start.motion, system.scene
    steady: Generator | None = None
    if start.balance is not None and start.at is not None:
        q, steady = sharpened(f, start.balance, start.at, system)
        u = f.exact(steady.field(q))
    else:
        q = _assembled(f, start, system)
        if scene.steady is not None:
            steady = _declared(f, start, system, q)
            u = f.exact(steady.field(q))
        else:
            u = _rates(f, start, system, q)
            if motion.at_rest:
                steady = family_in(f, system, Family(system, None, np.zeros(3), np.zeros((0, 3)), ()))[0].generator(
                    f.zeros(0)
                )
    state = system.dynamics(q, u, scene.time)
    a, nu, force = _accelerations(f, start, state, None if steady is None else f.exact(steady.acceleration(q)))
    generator = start.linear.generator
    if generator is not None and generator.turns and (steady is None or not steady.turns):
        steady = _detected(f, start, system, q, u)
    excess = _excess(f, system, motion, state, force)
    # A rate of zero may have a derivative.
    turning = steady if (generator is not None and generator.turns) or (steady is not None and steady.starts) else None
    rates = tuple(u) if turning is None else (turning.rate, *turning.spins)
    return Point(q, u, a, nu, state, turning, tuple(abs(x) for x in rates), excess)


def _assembled(f: Refining, start: Start, system: System) -> Matrix:
    """Return the coordinates: given ones unchanged, the others from the constraints."""
    scene, motion, n_h = system.scene, start.motion, system.n_h
    q = f.exact(motion.q)
    missing = np.array([name not in scene.coordinates for name in system.names])
    for i in np.flatnonzero(~missing):
        q[i] = scene.coordinates[system.names[i]] + f.zero
    if not (missing.any() and n_h):
        return q
    still, sizes = f.zeros(system.n_q), motion.sizes
    J = start.system.closing.dynamics(motion.q, np.zeros(system.n_q), motion.time).J[:n_h] * sizes
    lengths = norms(J[:, missing])

    def residual(x: Matrix) -> Matrix:
        return f.exact(system.closing.dynamics(x, still, scene.time).E)[:n_h]

    return _refined(f, system, q, np.flatnonzero(missing), sizes, J, lengths, residual, 1.0)


def _refined(
    f: Refining, system: System, known: Matrix, columns: Any, sizes: Array, J: Array, lengths: Array,
    residual: Callable[[Matrix], Matrix], floor: float,
) -> Matrix:  # fmt: skip
    """Return known numbers, those of some columns refined so that a residual vanishes.

    Parameters
    ----------
    J : ndarray
        Its derivative in double precision by all numbers in their `sizes`.
    lengths : ndarray
        Sizes of its entries.
    floor : float
        Scale of the numbers where they vanish.

    Raises
    ------
    ConstraintError
        If it does not vanish to all digits.
    """
    inverse = np.linalg.pinv(J[:, columns] / lengths[:, None], rcond=ALGEBRA.singular_value_zero)

    def placed(x: Matrix) -> Matrix:
        found = known.copy()
        found[columns] = x * sizes[columns]
        return found

    def correction(x: Matrix) -> Matrix:
        return -f.applied(inverse, residual(placed(x)) / lengths)

    try:
        return placed(f.polished(known[columns] / sizes[columns], correction, floor))
    except Stalled:
        raise ConstraintError(
            f"{system.scene.model.reference.location}: reference: the constraints are satisfied in double precision "
            "only: with more digits the decimals of the file contradict each other\n"
            "hint: write lengths and given coordinates as expressions, such as sqrt(3)/2, or leave out what the "
            "constraints determine"
        ) from None


def _rates(f: Refining, start: Start, system: System, q: Matrix) -> Matrix:
    """Return the rates: given ones unchanged, the others from the constraints."""
    scene, motion = system.scene, start.motion
    u = f.exact(motion.u)
    missing = np.array([name not in scene.rates for name in system.names])
    for i in np.flatnonzero(~missing):
        u[i] = scene.rates[system.names[i]] + f.zero
    columns, sizes = np.flatnonzero(missing), motion.sizes
    if not (len(columns) and system.n_c):
        return u
    J = motion.dynamics.J * sizes
    fastest = float(np.max(np.abs(motion.u / sizes), initial=0.0))

    def residual(x: Matrix) -> Matrix:
        return f.exact(system.dynamics(q, x, scene.time).V)

    return _refined(f, system, u, columns, sizes, J, norms(J), residual, fastest)


def _declared(f: Refining, start: Start, system: System, q: Matrix) -> Generator:
    """Return the generator of a declared steady motion whose position is given."""
    motion, scene = start.motion, system.scene
    rough, rough_known = declared_family(start.system)
    family, known = family_in(f, system, rough)
    found = motion.generators[0]
    c = [*([found.rate] if rough.axis is not None else []), *(rough.directions @ found.velocity)]
    plain = np.array([*c, *found.spins[list(rough.columns)]], dtype=float)
    free = [k for k in range(rough.size) if k not in rough_known]
    full = f.exact(plain)
    for k, value in known.items():
        full[k] = value
    if not free:
        return family.generator(full)
    given = [i for i, name in enumerate(system.names) if name in scene.rates]
    rates = f.exact([scene.rates[system.names[i]] for i in given])
    basis, sizes = rough.basis(motion.q), motion.sizes
    lengths = norms(np.vstack([motion.dynamics.J * sizes, np.diag(sizes)[given]]))

    def residual(c: Matrix) -> Matrix:
        u = f.exact(family.generator(c).field(q))
        return np.concatenate([f.exact(system.dynamics(q, u, scene.time).V), u[given] - rates])

    J, fastest = np.vstack([motion.dynamics.J @ basis, basis[given]]), float(np.max(np.abs(plain), initial=0.0))
    return family.generator(_refined(f, system, full, free, np.ones(len(full)), J, lengths, residual, fastest))


def _detected(f: Refining, start: Start, system: System, q: Matrix, u: Matrix) -> Generator:
    """Return the generator that double precision has found in the speeds of a motion, with all digits."""
    rough = start.linear.generator
    assert rough is not None
    d, sizes = system.scene.dimension, start.motion.sizes
    columns = tuple(int(i) for i in np.flatnonzero(rough.spins))
    moves = bool(np.any(rough.point) or np.any(rough.velocity))
    axis = _axis(f, start, system, q, u)
    family = Family(system, axis, f.zeros(3), f.exact(np.eye(3))[: d if moves else 0], columns)
    plain = Family(start.system, rough.axis, np.zeros(3), np.eye(3)[: d if moves else 0], columns)
    inverse = np.linalg.pinv(plain.basis(start.motion.q) / sizes[:, None], rcond=1e-12)
    basis = f.exact(
        np.array([f.exact(unit.field(q)) for unit in map(family.generator, f.exact(np.eye(family.size)))])
    ).T
    c = f.polished(f.zeros(family.size), lambda c: f.applied(inverse, (u - f.times(basis, c)) / sizes), abs(rough.rate))
    found = family.generator(c)
    return centered(found) if moves else found


def _axis(f: Refining, start: Start, system: System, q: Matrix, u: Matrix) -> Matrix:
    """Return the axis of rotation with all digits: the vertical, x, y, z, or that of a spin."""
    rough = start.linear.generator
    assert rough is not None
    gravity = f.exact(system.scene.gravity)
    candidates = [sign * row for row in f.exact(np.eye(3)) for sign in (1, -1)]
    if system.scene.dimension == 3:
        candidates += [-gravity]
        for body, part in zip(system.scene.bodies, system.body_slices, strict=True):
            if body.orientation:
                angles = slice(part.start + 3, part.stop)
                candidates.append(f.exact(rate_matrix(body, q[angles]) @ u[angles]))
    units = [x / f.sqrt(sum(x * x)) for x in candidates if f.largest(x) > 0]
    return min(units, key=lambda x: float(np.linalg.norm((x - rough.axis).astype(float))))


def _accelerations(f: Refining, start: Start, state: Dynamics, known: Matrix | None) -> tuple[Matrix, Matrix, Matrix]:
    """Return a and ν with M a + Jᵀ ν = −F0 and J a = −B, or the known a, and the relative imbalance of the forces."""
    motion, linear = start.motion, start.linear
    scale, row_scale, plain = motion.spaces.scale, motion.spaces.row_scale, motion.augmented
    M = f.exact(state.M) * scale * scale[:, None]
    J = f.exact(state.J) * scale * row_scale[:, None]
    force, bias = -(f.exact(state.F0) * scale), f.exact(state.B) * row_scale
    n = len(M)
    # Without loads, forces are measured by those that small motions of the size of the scene would cause.
    size = (np.abs(linear.K) @ motion.sizes + np.abs(linear.R) @ np.abs(motion.u) + np.abs(motion.dynamics.F0)) * scale
    floor = float(np.max(size, initial=0.0))
    if known is not None:
        a = known / scale
        loads = force - f.times(M, a)
        # The imbalance is kept: its rounding in double precision would exceed the digits.
        to_nu = f.exact(plain.inverse.T)
        try:
            nu = f.polished(f.zeros(len(J)), lambda nu: f.times(to_nu, loads - f.times(J.T, nu)), floor)
        except Stalled as stalled:
            raise _undetermined(start, f.values(J), stalled) from None
        return known, nu * row_scale, (loads - f.times(J.T, nu)) / (floor or 1.0)

    def correction(x: Matrix) -> Matrix:
        a, nu = x[:n], x[n:]
        missing = force - f.times(M, a) - f.times(J.T, nu)
        return f.exact(np.concatenate(plain.solve(missing, bias + f.times(J, a), f.applied)))

    try:
        x = f.polished(f.zeros(n + len(J)), correction, floor)
    except Stalled as stalled:
        raise _undetermined(start, f.values(J), stalled) from None
    a, nu = x[:n], x[n:]
    return a * scale, nu * row_scale, (force - f.times(M, a) - f.times(J.T, nu)) / (floor or 1.0)


def _undetermined(start: Start, J: Matrix, stalled: Stalled) -> MbstabError:
    """Return why accelerations and reactions do not converge: rows that are redundant in double precision only."""
    motion, misfit = start.motion, rank_misfit(start.motion, J, start.system.n_h)
    if motion.redundant and misfit > balls.small(ALGEBRA.polished_digits):
        return another_rank(motion, misfit)
    return NumericalError(
        f"accelerations and reactions do not converge (steps of {stalled.reached:.1e}): "
        "the masses that move differ by too many orders\n"
        "hint: look for masses and inertias of extreme size in the file"
    )


def rank_misfit(motion: Motion, J: Matrix, n_h: int) -> Any:
    """Return by how much scaled rows that are redundant in double precision differ from those that imply them."""
    spaces = motion.spaces
    return max(misfits(J[:n_h], spaces.C.rank), misfits(J, spaces.C.rank + spaces.W.rank))


def another_rank(motion: Motion, misfit: Any) -> ConstraintError:
    """Return the error about rows that are redundant in double precision but not with more digits."""
    rows = ", ".join(dict.fromkeys(str(item.row) for item in motion.redundant))
    which = f" ({rows})" if rows else ""
    return ConstraintError(
        f"with {balls.digits_in_use()} digits the constraints have another rank than in double precision: rows that "
        f"depend on each other there differ by {balls.decimals(misfit, 2)}{which}\n"
        "hint: write lengths and given coordinates as expressions, such as sqrt(3)/2, or leave out what the "
        "constraints determine; or remove the redundant rows that mbstab check names"
    )


def _excess(f: Refining, system: System, motion: Motion, state: Dynamics, force: Matrix) -> tuple[Any, str]:
    """Return the largest residual of the reference motion, relative to the terms that balance, and its name."""
    n_h, sizes = system.n_h, motion.sizes
    lengths = norms(motion.dynamics.J * sizes)
    fastest = float(np.max(np.abs(motion.u / sizes), initial=0.0)) or 1.0
    candidates = [(f.zero, "")]
    for i, row in enumerate(system.rows):
        if i < n_h:
            candidates.append((abs(f.exact(state.E)[i]) / lengths[i], str(row)))
        candidates.append((abs(f.exact(state.V)[i]) / (lengths[i] * fastest), f"the rates of {row}"))
    candidates += [(abs(x), f"the balance of forces on {system.names[i]}") for i, x in enumerate(force)]
    return max(candidates, key=lambda pair: pair[0])
