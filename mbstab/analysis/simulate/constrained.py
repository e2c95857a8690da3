"""The constrained equations as a right-hand side: accelerations, projections, and monitoring of the rank.

At a state q, u and a time t, the accelerations and multipliers solve

    M a + Jᵀ ν = −F0,   J a = −B                                     (index 1)

and a state near the constraints is projected onto them by the least change in the metric of
the mass matrix,

    min Δqᵀ M Δq  with  C(q + Δq, t) = 0,   min Δuᵀ M Δu  with  V(q, u + Δu, t) = 0

(Eich 1993, SIAM J. Numer. Anal. 30; Hairer and Wanner 1996, section VII.2). Where rows are
redundant, they are replaced by orthonormal combinations of them, as many as the rank at the
start. Everything is computed in coordinates scaled by the masses that resist their motion at the start: a light link
between heavy bodies carries theirs. Scaled by its own, the matrix of the index-1 equations loses the digits of the
ratio of both.

Most functions take many states at once: times (n_t,), coordinates and speeds (n_t, n_q). Then the scene is evaluated
by its kernels over arrays, redundant rows are combined at each state, and nothing is counted.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from mbstab.analysis.algebra.arrays import Flags, least_squares, others
from mbstab.analysis.algebra.augmented import augmented_matrix, least_multipliers
from mbstab.analysis.algebra.sparse import dense, row_norms
from mbstab.analysis.reference.motion import Motion
from mbstab.analysis.simulate.tolerances import TOLERANCES
from mbstab.analysis.spectrum.tolerances import TOLERANCES as SPECTRUM
from mbstab.compiler.form import Form
from mbstab.compiler.system import Array, Dynamics, System
from mbstab.errors import ConstraintError, MbstabError, NumericalError, amount
from mbstab.model.arithmetic import array_arithmetic
from mbstab.model.schema import is_state
from mbstab.records import dataclass

if TYPE_CHECKING:
    from mbstab.compiler.fused import Program


DIMENSIONS = {"M": 2, "F0": 1, "E": 1, "V": 1, "J": 2, "B": 1}
"""Of the matrices of one state."""

BRANCH_HINT = (
    "hint: from there the motion may go on in different ways; --through-singular takes the smooth one, if there is "
    "one; else keep away from it, or take out what locks it"
)

LIMIT_HINT = (
    "hint: the mechanism may be driven to a limit beyond which it cannot go, such as a dead centre or links at full "
    "reach, where speeds grow without bound; end before (--to), or change the drive or the lengths"
)


@dataclass(frozen=True)
class Watch:
    """The smallest singular value of the scaled constraints at an instant, with its vectors."""

    left: Array
    right: Array
    value: float


class Constrained:
    """The equations of motion of a scene as a right-hand side.

    Parameters
    ----------
    system : System
    motion : Motion
        The motion at the start: ranks and scales.
    form : Form, optional
        Evaluates the scene; several runs share one.

    Attributes
    ----------
    system : System
    sizes : ndarray, shape (n_q,)
        Characteristic size of each coordinate (m, rad).
    kept : list of int
        Rows without the redundant ones.
    evaluations : int
        Number of evaluations of the equations of motion or their derivatives.
    rows : ndarray, shape (n_c, n_q)
        Factors by which entries of J are scaled; `weights` (n_q, n_q) are those of M, `scale` and `row_scale` those of
        coordinates and rows.
    massless : ndarray of int
        First-order states and balances, which have no mass.
    slowest : float (1/s)
        Speeds below this, in sizes of the scene, count as rest.
    least_energy : float (J)
        Kinetic energy of such speeds.
    """

    def __init__(self, system: System, motion: Motion, form: Form | None = None) -> None:
        from scipy.linalg.lapack import dgesv

        self._dgesv = dgesv
        spaces = motion.spaces
        self.system, self.sizes = system, motion.sizes
        self.scale = _carried(motion)
        self.row_scale = 1.0 / row_norms(dense(motion.dynamics.J) * self.scale)
        self.n, self.n_h, self.n_c = system.n_q, system.n_h, system.n_c
        self.rank_h, self.rank = spaces.C.rank, spaces.C.rank + spaces.W.rank
        self.evaluations = 0
        self.form = form or Form(system)
        without = {redundancy.row for redundancy in motion.redundant}
        self.kept = [i for i, row in enumerate(system.rows) if row not in without]
        factors = np.concatenate([self.scale, self.row_scale[self.kept]])
        self._factors, self._products = factors, factors * factors[:, None]
        self._program: Program | None = None
        # Rates of first-order states, however fast, carry no energy.
        bodily, u = others(self.n, system.states[0]), motion.u.copy()
        u[system.states[0]] = 0.0
        pulled = np.abs(motion.dynamics.F0 * self.scale * self.scale / motion.sizes)[bodily]
        natural = max(self.fastest(u), float(np.sqrt(np.max(pulled, initial=0.0))))
        self.slowest = TOLERANCES.resting_speed_of_forces * (natural or 1.0)
        self.least_energy = 0.5 * float(np.diag(motion.dynamics.M) @ (motion.sizes * self.slowest) ** 2)
        first_order = {name for x in system.scene.balances if x.first_order for name in x.direction}
        self.massless = np.flatnonzero([is_state(name) or name in first_order for name in system.names])
        self.full = self.rank == self.n_c
        self.weights = self.scale * self.scale[:, None]
        self.rows = self.scale * self.row_scale[:, None]
        # What is singular, and which multipliers are the least ones, is told by the masses of the coordinates
        # themselves, unless they carry far heavier ones.
        self._told = np.minimum(spaces.scale, TOLERANCES.carried_most * self.scale)
        self._told_scale = 1.0 / row_norms(dense(motion.dynamics.J) * self._told)
        self._told_rows = self._told * self._told_scale[:, None]
        self._all = np.eye(self.n_c, self.rank)
        self._least: float | None = None
        self.trouble: MbstabError | None = None
        self.refresh(motion.dynamics)

    @property
    def independent(self) -> bool:
        """Whether the number of rows kept equals the rank."""
        return len(self.kept) == self.rank

    @cached_property
    def arrays(self) -> System:
        """The system for many states at once."""
        return self.system.in_arithmetic(replace(self.system.scene, arithmetic=array_arithmetic()))

    # --- the one place where the scene is evaluated -----------------------------------------------------------------

    def evaluate(self, t: Any, q: Array, u: Array) -> Dynamics:
        """Return the matrices of the equations of motion; every right-hand side comes from here.

        Raises
        ------
        NumericalError
            If a force or a given function of time has no value there; of many states any error.
        """
        if q.ndim > 1:
            found = self.arrays.dynamics(q, u, t)
            parts = {name: getattr(found, name) for name in DIMENSIONS}
            return Dynamics(**{k: np.broadcast_to(x, (len(q), *x.shape[-DIMENSIONS[k] :])) for k, x in parts.items()})
        self.evaluations += 1
        try:
            return self.form.dynamics(q, u, t)
        except NumericalError as error:
            self.trouble = error
            raise
        except MbstabError as error:
            self.trouble = NumericalError(f"a given function of time has no value at t = {t:.9g} s: {error}")
            raise self.trouble from None

    # --- accelerations ----------------------------------------------------------------------------------------------

    def accelerations(self, t: Any, q: Array, u: Array) -> tuple[Array, Array, Dynamics]:
        """Return a (…, n_q), the multipliers ν (…, n_c) and the matrices at states."""
        state = self.evaluate(t, q, u)
        a, nu = self.solve(state)
        return a, nu, state

    def acceleration(self, t: float, q: Array, u: Array) -> Array:
        """Return a (n_q,) alone at a state, from the straight-line functions where there are some."""
        program = self._program or self._quick_program()
        if program is not None:
            try:
                A, b = program(q.tolist(), u.tolist(), t)
            except (ArithmeticError, ValueError):
                return self.accelerations(t, q, u)[0]
            self.evaluations += 1
            # The matrix is symmetric: its transpose is in Fortran order, and may be overwritten.
            pivots, _, found, failed = self._dgesv((A * self._products).T, b * self._factors, 1, 1)
            if not failed and (self.full or _strong(pivots)):
                return np.asarray(found[: self.n] * self.scale)
        return self.accelerations(t, q, u)[0]

    def _quick_program(self) -> Program | None:
        """Return the function of the matrix and the right-hand side of the accelerations, once it pays to build it."""
        if self.form.quick and self.independent:
            self._program = self.form.fused.augmented(self.kept)
        return self._program

    def solve(self, state: Dynamics) -> tuple[Array, Array]:
        """Return a (…, n_q) and ν (…, n_c) from the matrices at states."""
        J = state.J * self.rows
        P = self._independent(J)
        self._matrix = augmented_matrix(state.M * self.weights, _combined(P, J))
        bias = _combined(P, (state.B * self.row_scale)[..., None])[..., 0]
        x = self._solved(self._matrix, -np.concatenate([state.F0 * self.scale, bias], axis=-1))
        nu = x[..., self.n :] if P is None else (P @ x[..., self.n :, None])[..., 0]
        return x[..., : self.n] * self.scale, nu * self.row_scale

    def _independent(self, J: Array) -> Array | None:
        """Return independent combinations of scaled rows; None if all are independent."""
        return None if self.full else self._all if J.ndim == 2 else self.combined(J)

    def _solved(self, A: Array, b: Array) -> Array:
        """Return A⁻¹ b for symmetric matrices; by LAPACK directly, as for a small one the overhead dominates."""
        if A.ndim > 2:
            return np.asarray(np.linalg.solve(A, b[..., None])[..., 0])
        *_, found, failed = self._dgesv(A, b)
        if failed:
            raise np.linalg.LinAlgError("singular matrix")
        return np.asarray(found)

    def jacobian(self, t: float, q: Array, u: Array) -> Array:
        """Return the derivatives of u and a by q and u, shape (2 n_q, 2 n_q)."""
        a, nu, _ = self.accelerations(t, q, u)
        K, R, _, A_q, A_u = self.derivatives(t, q, u, a, nu)
        n = self.n
        right = -np.block([[K, R], [A_q, A_u]])
        right[:n] *= self.scale[:, None]
        lower = right[n:] * self.row_scale[:, None]
        lower = lower if self.full else self._all.T @ lower
        found = np.linalg.solve(self._matrix, np.vstack([right[:n], lower]))[:n] * self.scale[:, None]
        return np.vstack([np.eye(n, 2 * n, n), found])

    # --- projections ------------------------------------------------------------------------------------------------

    def residuals(self, state: Dynamics, fastest: Any) -> tuple[Any, Any]:
        """Return the largest residuals of rows in position and in velocity, relative to the sizes in the scene.

        `fastest` is the largest speed of a coordinate in its size (1/s); where all are slow, residuals in velocity
        count relative to `slowest`.
        """
        reach = np.abs(state.J) @ self.sizes + 1e-300
        position = np.abs(state.E[..., : self.n_h]) / reach[..., : self.n_h]
        velocity = np.abs(state.V) / (reach * np.maximum(fastest, self.slowest)[..., None])
        return position.max(axis=-1, initial=0.0), velocity.max(axis=-1, initial=0.0)

    def onto_positions(self, t: float, q: Array, held: Flags | None = None) -> tuple[Array, float]:
        """Return the nearest coordinates that satisfy C(q, t) = 0, and the remaining residual.

        Parameters
        ----------
        held : ndarray of bool, shape (n_q,), optional
            Coordinates that must not change.
        """
        q, _, left, _ = self._nearest(t, q, np.zeros(self.n), held, speeds=False)
        return q, left

    def onto_velocities(self, t: float, q: Array, u: Array, held: Flags | None = None) -> tuple[Array, float, Dynamics]:
        """Return the nearest speeds that satisfy V(q, u, t) = 0, the remaining residual, and the matrices there."""
        _, u, left, state = self._nearest(t, q, u, held, positions=False)
        return u, left, state

    def project(self, t: Any, q: Array, u: Array) -> tuple[Array, Array, Dynamics]:
        """Return coordinates and speeds that satisfy the constraints, and of one state the matrices there.

        Raises
        ------
        NumericalError
            If the constraints cannot be satisfied near a state.
        """
        q, u, left, state = self._nearest(t, q, u)
        if _any(~(left <= TOLERANCES.projection_residual_failed)):
            worst = int(np.argmax(left))
            raise NumericalError(
                f"the constraints cannot be satisfied at t = {np.ravel(t)[worst]:.9g} s: a residual of "
                f"{amount(np.ravel(left)[worst])} of the sizes in the scene is left, where "
                f"{TOLERANCES.projection_residual_failed:g} is allowed"
            )
        return q, u, state

    def _nearest(
        self, t: Any, q: Array, u: Array, held: Flags | None = None, positions: bool = True, speeds: bool = True
    ) -> tuple[Array, Array, Any, Dynamics]:
        """Return coordinates and speeds after Newton steps towards the constraints, what is left, and the matrices.

        The best state on the way counts; the matrices are those of one state only.
        """
        evaluate = self.evaluate if speeds else lambda t, q, u: self.system.closing.dynamics(q, u, t)
        state = matrices = evaluate(t, q, u)
        best: tuple[Array, Array] = (q, u)
        least: Any = np.inf
        for _ in range(TOLERANCES.projection_steps):
            position, velocity = self.residuals(state, self.fastest(u))
            size = np.maximum(position, velocity) if positions and speeds else position if positions else velocity
            better = size < least
            # Rounding is reached, or it does not converge.
            going = (size < 0.5 * least) & (size > TOLERANCES.projection_residual)
            if not _any(~better):
                best, matrices = (q, u), state
            else:
                best = np.where(better[..., None], q, best[0]), np.where(better[..., None], u, best[1])
            least = np.fmin(size, least)
            if not _any(going):
                break
            if positions and _any(position > TOLERANCES.projection_residual):
                q = q + self._least_change(state, state.E[..., : self.n_h], self.n_h, held)
                state = evaluate(t, q, u)
            if speeds:
                u = u + self._least_change(state, state.V, self.n_c, held)
                state = evaluate(t, q, u)
        return *best, least, matrices

    def nearer(self, t: float, q: Array, u: Array) -> tuple[Array, Array, Dynamics]:
        """Return coordinates and speeds after one Newton step each towards the constraints, and the matrices there."""
        state = self.evaluate(t, q, u)
        if self.n_h:
            q = q + self._least_change(state, state.E[: self.n_h], self.n_h, None)
            state = self.evaluate(t, q, u)
        u = u + self._least_change(state, state.V, self.n_c, None)
        return q, u, self.evaluate(t, q, u)

    def fastest(self, u: Array) -> Any:
        """Return the largest speed of a coordinate in its sizes (1/s), shape (…)."""
        return np.abs(u / self.sizes).max(axis=-1, initial=0.0)

    def _least_change(self, state: Dynamics, residual: Array, rows: int, held: Flags | None) -> Array:
        """Return the least Δ in the metric of M with J Δ = −residual for the first rows."""
        J = state.J * self.rows
        P = self._independent(J)
        if P is not None:
            P = P[..., :rows, : self.rank_h if rows == self.n_h else self.rank]
        J, goal = _combined(P, J[..., :rows, :]), _combined(P, -(residual * self.row_scale[:rows])[..., None])[..., 0]
        if held is not None:
            free = np.flatnonzero(~held)
            # Rows may contain held coordinates only; then the least change of the others in the Euclidean metric.
            moved = np.zeros(self.n)
            if len(free):
                moved[free] = least_squares(J[:, free], goal, rcond=1e-12)
            return moved * self.scale
        A = augmented_matrix(state.M * self.weights, J)
        if rows == self.n_h:
            # First-order states and balances have no mass; only their rates follow the others.
            A[..., self.massless, self.massless] = 1.0
        b = np.concatenate([np.zeros((*goal.shape[:-1], self.n)), goal], axis=-1)
        return np.asarray(self._solved(A, b)[..., : self.n] * self.scale)

    # --- rank -------------------------------------------------------------------------------------------------------

    def refresh(self, state: Dynamics) -> Watch:
        """Choose the combinations of redundant rows anew; return the smallest singular value that should not vanish."""
        if not self.rank:
            return Watch(np.zeros(0), np.zeros(self.n), np.inf)
        left, s, right = np.linalg.svd(state.J * self._told_rows, full_matrices=False)
        if not self.full:
            self._all = self.combined(state.J * self.rows)
        k = self.rank - 1
        if self._least is None:
            self._least = float(s[k])
        return Watch(left[:, k], right[k], float(s[k]))

    def combined(self, J: Array) -> Array:
        """Return independent combinations of scaled rows, shape (…, n_c, rank), holonomic ones first.

        The two kinds are not mixed. J has the shape (…, n_c, n_q).
        """
        n_h, rank_h = self.n_h, self.rank_h
        own, _, rest = np.linalg.svd(J[..., :n_h, :])
        free = J[..., n_h:, :] @ np.swapaxes(rest[..., rank_h:, :], -1, -2)
        both = np.zeros((*J.shape[:-1], self.rank))
        both[..., :n_h, :rank_h] = own[..., :rank_h]
        both[..., n_h:, rank_h:] = np.linalg.svd(free)[0][..., : self.rank - rank_h]
        return both

    def least(self, nu: Array, J: Array) -> Array:
        """Return the minimum-norm multipliers (…, n_c) with the same effect, if rows J (…, n_c, n_q) are redundant."""
        if self.full or not self.rank:
            return nu
        span = np.linalg.svd(J * self._told_rows, full_matrices=False)[0][..., : self.rank]
        parts = np.swapaxes(span, -1, -2) @ (nu / self._told_scale)[..., None]
        return np.asarray((span @ parts)[..., 0] * self._told_scale)

    def multipliers(self, state: Dynamics, a: Array) -> Array:
        """Return the minimum-norm multipliers (n_c,) that balance given accelerations, also where rank is lost."""
        force = -(state.F0 + state.M @ a) * self._told
        J = state.J * self._told_rows
        return least_multipliers(J, force, TOLERANCES.multiplier_singular_value) * self._told_scale

    def flipped(self, before: Watch, state: Dynamics, after: Watch) -> bool:
        """Return whether the smallest singular value changed its sign, along its own vectors, or is nearly zero."""
        if not self.rank:
            return False
        assert self._least is not None
        if after.value <= SPECTRUM.constraints_singular * self._least:
            return True
        return self.signed(before, state) < 0.0

    def signed(self, before: Watch, state: Dynamics) -> float:
        """Return the present value of an earlier smallest singular value, along its own vectors."""
        return float(before.left @ (state.J * self._told_rows) @ before.right)

    def start_from(self, other: Constrained) -> None:
        """Measure singular values relative to those at the start of another chart of the same motion."""
        self._least = other._least

    def smallness(self, state: Dynamics) -> float:
        """Return the smallest singular value relative to that at the start."""
        assert self._least is not None
        s = np.linalg.svd(state.J * self._told_rows, compute_uv=False)
        return float(s[self.rank - 1]) / self._least

    def remaining(self, watch: Watch) -> float:
        """Return the smallest singular value relative to that at the start; infinite without constraints."""
        return watch.value / self._least if self._least else math.inf

    def singular(self, t: float, state: Dynamics, value: float, hint: str = BRANCH_HINT) -> ConstraintError:
        """Return the error about a singular configuration: number, threshold, rows, time."""
        left = np.linalg.svd(state.J * self._told_rows)[0][:, self.rank - 1]
        return ConstraintError(
            f"the mechanism is at a singular configuration at t = {t:.9g} s: the least singular value of its "
            f"constraints falls to {amount(value)} of that at the start, where {SPECTRUM.constraints_singular:g} is "
            "the threshold\n"
            f"the rows that depend on each other there: {self.owners(left)}\n{hint}"
        )

    def approached(self, t: float, watch: Watch, reason: str) -> ConstraintError:
        """Return the error about a step that failed near a singular configuration: as `singular`, with a reason."""
        return ConstraintError(
            f"the mechanism comes to a singular configuration just after t = {t:.9g} s: the least singular value of "
            f"its constraints has fallen to {amount(self.remaining(watch))} of that at the start "
            f"({SPECTRUM.constraints_singular:g} counts as singular), and {reason}\n"
            f"the rows that depend on each other there: {self.owners(watch.left)}\n{LIMIT_HINT}"
        )

    def owners(self, left: Array) -> str:
        """Return the owners of the rows with the largest components in a left singular vector."""
        order = [i for i in np.argsort(-np.abs(left)) if abs(left[i]) > 0.1][:6]
        return ", ".join(dict.fromkeys(self.system.rows[i].owner for i in order))

    def derivatives(self, t: float, q: Array, u: Array, a: Array, nu: Array) -> tuple[Array, ...]:
        """Return K, R, V_q, A_q and A_u; at a kink in the speeds, such as that of |u| at rest, those next to it.

        The derivatives only guide the iterations of implicit methods, whose results do not depend on them.
        """
        self.evaluations += 1
        try:
            K, R, _ = self.form.linearize(q, u, a, nu, t)
        except NumericalError:
            u = u + TOLERANCES.kink_offset * max(self.fastest(u), self.slowest) * self.sizes
            K, R, _ = self.form.linearize(q, u, a, nu, t)
        return K, R, *self.form.linearize_rows(q, u, a, t)

    @property
    def combinations(self) -> tuple[Array, Array]:
        """Independent combinations of scaled holonomic rows (n_h, rank) and of all scaled rows (n_c, rank)."""
        return self._all[: self.n_h, : self.rank_h], self._all


def _carried(motion: Motion) -> Array:
    """Return 1/√m for each coordinate, m being the mass that resists a force along it.

    Coordinates that the constraints hold count as heavy as the heaviest of the others.
    """
    scale, massless = motion.spaces.scale, dense(motion.dynamics.M).diagonal() <= 0.0
    moved = np.sqrt(np.maximum(dense(motion.augmented.mobility @ np.eye(len(scale))).diagonal(), 0.0))
    free = (moved > TOLERANCES.blocked) & ~massless
    if not free.any():
        return scale
    least = motion.sizes * np.min((scale * moved / motion.sizes)[free])
    return np.where(massless, scale, np.maximum(scale * moved, least))


def _combined(P: Array | None, x: Array) -> Array:
    return x if P is None else np.asarray(np.swapaxes(P, -1, -2) @ x)


def _any(flags: Any) -> bool:
    """Whether a flag is set; of a single one NumPy takes twenty times as long."""
    return bool(flags if flags.ndim == 0 else flags.any())


def _strong(factors: Any) -> bool:
    """Whether no pivot of a factored matrix is small."""
    pivots = np.abs(factors.diagonal())
    return bool(pivots.min() > TOLERANCES.pivot_of_rows * pivots.max())
