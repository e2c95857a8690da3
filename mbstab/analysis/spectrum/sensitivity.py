"""Derivatives of eigenvalues by the parameters of a model, the motion of the reference included.

The reference motion, the null spaces of the constraints and the state matrix S are evaluated in numbers with slopes
(`mbstab.analysis.algebra.slopes`). With right and left vectors of a simple eigenvalue,

    dλ/dp = yᴴ (dS/dp) x / (yᴴ x)

(Lancaster 1964, Numer. Math. 6). Of ẏ = S y the directions of symmetries T and the conserved functions L are known
(`mbstab.analysis.verdict.neutral`): vectors of the matrix left to judge are completed by their parts along these.

A derivative exists for eigenvalues that are proven to be simple, and by parameters with which the reference can move:
where the coordinates of the file contradict the constraints as soon as a parameter changes, or forces no longer
balance, there is nothing to differentiate. Both are said, with the reason.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from mbstab.analysis.algebra.arrays import Complex, norms
from mbstab.analysis.algebra.refining import Stalled
from mbstab.analysis.algebra.slopes import Slopes
from mbstab.analysis.algebra.subspaces import along_coordinates
from mbstab.analysis.algebra.tolerances import EPS
from mbstab.analysis.algebra.tolerances import TOLERANCES as ALGEBRA
from mbstab.analysis.spectrum.precise_motion import Point, Start, reference_point
from mbstab.analysis.spectrum.refined_matrix import refined_directions, state_matrix
from mbstab.analysis.spectrum.results import EigenResult, Eigenvalue
from mbstab.analysis.spectrum.tolerances import TOLERANCES
from mbstab.analysis.verdict.facts import Grounds
from mbstab.analysis.verdict.many_digits import ManyDigits
from mbstab.analysis.verdict.smoothness import kinks
from mbstab.compiler.system import Array, System
from mbstab.errors import NumericalError, UsageError
from mbstab.model.arithmetic import FLOAT
from mbstab.model.duals import Dual, dual_arithmetic
from mbstab.model.schema import Model
from mbstab.model.values import evaluate
from mbstab.records import Answer, dataclass


@dataclass(frozen=True)
class Derivatives:
    """The derivatives of an eigenvalue by the parameters; of a conjugate pair, of the one with Im λ > 0.

    Attributes
    ----------
    number : int
        Which of the eigenvalues of the answer it is.
    slopes : ndarray of complex, shape (parameters,)
        dλ/dp in 1/s per SI unit of each parameter; nan where there is none.
    errors : ndarray, shape (parameters,)
        Estimate of the error of each: the error bound of the eigenvalue, carried to its vectors, and rounding.
    missing : str
        Why it has no derivatives; empty: it has.
    """

    number: int
    slopes: Complex
    errors: Array
    missing: str = ""


@dataclass(frozen=True)
class Sensitivities(Answer):
    """Derivatives of the eigenvalues of a model.

    Attributes
    ----------
    result : EigenResult
    parameters : tuple of str
        In the order of the file.
    values : ndarray, shape (parameters,)
        In SI.
    missing : dict
        Why there are no derivatives by some of the parameters.
    derivatives : list of Derivatives
        In the order of `result`, without neutral eigenvalues.
    """

    result: EigenResult
    parameters: tuple[str, ...]
    values: Array
    missing: dict[str, str]
    derivatives: list[Derivatives]

    def eigenvalue(self, item: Derivatives) -> Eigenvalue:
        """Return the eigenvalue to which derivatives belong."""
        return self.result.eigenvalues[item.number]

    def order(self, item: Derivatives) -> list[int]:
        """Return the numbers of the parameters with derivatives, what moves an eigenvalue most per percent first.

        Parameters that are zero have no percent; they are last.
        """
        change = np.abs(item.slopes * self.values)
        known = np.flatnonzero(~np.isnan(change)).tolist()
        return sorted(known, key=lambda k: (-change[k], not self.values[k], -abs(item.slopes[k])))


@dataclass(frozen=True)
class MovedMatrix:
    """The matrix left to judge, and how it moves.

    Attributes
    ----------
    result : EigenResult
    parameters : tuple of str
        In the order of the file.
    missing : dict
        Why there are no derivatives by some of the parameters.
    A : ndarray, shape (r, r)
        Its eigenvalues are those of `result` that are not neutral.
    slopes : ndarray, shape (parameters, r, r), or None
        Its derivatives, as far as eigenvalues depend on it; None where the motion has none.
    """

    result: EigenResult
    parameters: tuple[str, ...]
    missing: dict[str, str]
    A: Array
    slopes: Array | None


def sensitivities(model: Model, frozen: bool = False, digits: ManyDigits | None = None) -> Sensitivities:
    """Return the derivatives of all eigenvalues of a model by all of its parameters.

    Parameters
    ----------
    model : Model
    frozen, digits
        As in `mbstab.analysis.spectrum.eigenvalues.answer`.

    Raises
    ------
    UsageError
        If the model has no parameters, or the motion is periodic.
    EquilibriumError
        If the reference is a critical position, at which it has no derivative.
    MbstabError
        As `mbstab.analysis.reference.requested.reference_motion`.
    """
    start, values, missing, slopes, turn = _differentiated_matrix(model, frozen, digits)
    found = _differentiated(start.plain, _Vectors(start.grounds, turn), slopes, values, _kink(start))
    names = tuple(model.parameters)
    lost = [name in missing for name in names]
    for item in found:
        item.slopes[lost], item.errors[lost] = math.nan, math.nan
    return Sensitivities(start.plain, names, values, missing, found)


def moved_matrix(model: Model) -> MovedMatrix:
    """Return the matrix left to judge and its derivatives; it has them where eigenvalues meet, too.

    Raises
    ------
    MbstabError
        As `sensitivities`.
    """
    start, _, missing, slopes, turn = _differentiated_matrix(model, False, None)
    vectors = _Vectors(start.grounds, turn)
    moved = None if _kink(start) else vectors.moved(slopes)
    return MovedMatrix(start.plain, tuple(model.parameters), missing, vectors.A, moved)


def _kink(start: Start) -> str:
    """Return what has no derivative at the reference; empty: all have."""
    return kinks(start.linear.system, start.motion.q, start.motion.u, start.motion.time)


def _differentiated_matrix(
    model: Model, frozen: bool, digits: ManyDigits | None
) -> tuple[Start, Array, dict[str, str], Array, Array]:
    """Return the answer, the values of the parameters, which ones have no derivatives, and those of S in a basis."""
    if not model.parameters:
        raise UsageError(
            f"{model.name} has no parameters by which to differentiate\n"
            "hint: declare numbers under parameters: and use their names"
        )
    start = Start(model, frozen, digits)
    names, kinked = tuple(model.parameters), dict[str, str]()
    spaces, turn = along_coordinates(start.linear.spaces)

    def differentiated(by: Sequence[str]) -> tuple[Slopes, System, Point, Array]:
        f, system = seeded(model, by)
        point = reference_point(start, system, f)
        return f, system, point, f.parts(state_matrix(start, system, point, f, spaces))[1]

    try:
        try:
            f, system, point, slopes = differentiated(names)
        except NumericalError:
            kinked = _kinked(names, differentiated)
            if not kinked:
                raise
            f, system, point, slopes = differentiated([name for name in names if name not in kinked])
    except Stalled as stalled:
        raise NumericalError(
            f"derivatives by parameters do not converge (steps of {stalled.reached:.1e} instead of "
            f"{ALGEBRA.slope_rounding:.0e})\nhint: look for numbers of extreme size in the file"
        ) from None
    values = np.array([float(system.scene.parameters[name]) for name in names])
    return start, values, {**_unfollowed(start, system, point, f, values), **kinked}, slopes, turn


def _kinked(names: Sequence[str], differentiated: Callable[[Sequence[str]], object]) -> dict[str, str]:
    """Return the parameters by which the equations have no derivative, as at a kink of a table, and why."""
    differentiated([])  # raises where it is not for a parameter
    found = dict[str, str]()
    for name in names:
        try:
            differentiated([name])
        except NumericalError as error:
            found[name] = str(error).splitlines()[0]
    return found


def seeded(model: Model, by: Sequence[str]) -> tuple[Slopes, System]:
    """Return the equations of a model in numbers with slopes by its parameters; those are 0 that are not asked for.

    Raises
    ------
    ModelFileError
        If the file has a kink at the value of a parameter asked for.
    """
    rows = np.eye(len(model.parameters))
    added = {name: Dual(0.0, row * (name in by)) for name, row in zip(model.parameters, rows, strict=True)}
    scene = evaluate(model, arithmetic=dual_arithmetic(FLOAT), added=added)
    values = np.array([float(scene.parameters[name]) for name in added])
    return Slopes(np.where(values, np.abs(values), 1.0)), System(scene)


# --- the reference --------------------------------------------------------------------------------------------------


def _unfollowed(start: Start, system: System, point: Point, f: Slopes, values: Array) -> dict[str, str]:
    """Return the parameters with which the reference cannot move, and what would be violated if they changed."""
    motion, n_h, state = start.motion, system.n_h, point.state
    sizes, spaces = motion.sizes, motion.spaces
    lengths = norms(motion.dynamics.J * sizes)
    fastest = float(np.max(np.abs(motion.u / sizes), initial=0.0)) or 1.0
    names = list(system.scene.parameters)
    found: dict[str, str] = {}

    def note(slopes: Array, whole: Array, text: Callable[[int], str]) -> None:
        """Note the parameters by which residuals have slopes, beside slopes of the terms of which they are sums."""
        size = np.max(np.abs(whole), axis=1, initial=0.0)
        for k in np.flatnonzero(np.max(np.abs(slopes), axis=1, initial=0.0) > TOLERANCES.slope_of_residual * size):
            found.setdefault(names[k], text(int(np.argmax(np.abs(slopes[k])))))

    moved = f.sizes[:, None]
    q, u = (f.parts(x)[1] / sizes * moved for x in (point.q, point.u))
    rows = [str(row) for row in system.rows]
    if motion.at_rest and point.generator is None:
        text = "the reference rests, and would move with another value"
        found.update((names[k], text) for k in np.flatnonzero(u.any(axis=1)))
    light = start.linear.massless
    if light is not None:
        # What is zero without it would add eigenvalues; the equations for those that exist lack its terms.
        text = "with another value it gives mass, or damping alone, to what has none"
        R = system.linearize(point.q, point.u, point.a, point.nu, system.scene.time)[1]
        algebraic, first = refined_directions(light, f.exact(state.M), f.exact(R), f.exact(state.J), f)
        allowed = spaces.allowed * spaces.scale[:, None]
        for directions, x in ((algebraic, state.M), (first, state.M), (algebraic, R)):
            # Products of what is turned and what changes, each as large as anywhere.
            turned, moving = (
                [np.max(np.abs(part), axis=(-2, -1), initial=0.0) for part in f.parts(y)]
                for y in (directions, f.times(x, allowed))
            )
            size = TOLERANCES.slope_of_residual * (turned[0] * moving[1] + turned[1] * moving[0])
            changed = np.max(np.abs(f.parts(f.times(directions, x, allowed))[1]), axis=(1, 2), initial=0.0)
            found.update((names[k], text) for k in np.flatnonzero(changed > size))
    _, E = f.parts(state.E)
    _, V = f.parts(state.V)
    unit = np.maximum(np.max(np.abs(q), axis=1, initial=0.0), 1.0)[:, None]
    fast = np.maximum(np.max(np.abs(u), axis=1, initial=0.0), fastest)[:, None]
    note(E[:, :n_h] / lengths[:n_h] * moved, unit, lambda i: f"with another value the reference violates {rows[i]}")
    note(V / lengths * moved, fast, lambda i: f"with another value the speeds of the reference violate {rows[i]}")
    inertia, reaction = f.times(state.M, point.a), f.times(f.exact(state.J).T, point.nu)
    terms = [f.parts(x)[1] * spaces.scale * moved for x in (inertia, f.exact(state.F0), reaction)]
    # Without loads, forces are measured by those that small motions of the size of the scene would cause.
    loads = (np.abs(start.linear.K) @ sizes + np.abs(start.linear.R) @ np.abs(motion.u)) * spaces.scale
    whole = np.hstack([*terms, np.full((len(values), 1), float(np.max(loads, initial=0.0)))])
    note(
        sum(terms[1:], terms[0]), whole, lambda i: f"with another value the forces on {system.names[i]} do not balance"
    )
    return found


# --- the eigenvalues ------------------------------------------------------------------------------------------------


def _differentiated(
    result: EigenResult, vectors: _Vectors, slopes: Array, values: Array, kink: str
) -> list[Derivatives]:
    """Return the derivatives of all eigenvalues that are not neutral; with a kink there are none."""
    listed = [e for e in result.eigenvalues if not e.exact]
    neutral = [e.value for e in result.eigenvalues if e.exact]
    count, found = len(slopes), []
    for number, e in enumerate(result.eigenvalues):
        if e.exact or e.value.imag < 0.0:
            continue
        missing = kink or _multiple(e, listed, neutral)
        derivative, error = np.full(count, math.nan + 0j), np.full(count, math.nan)
        if not missing:
            derivative, error = vectors.derivative(e, slopes)
            # Slopes may be rounding of terms that cancel, each as if the eigenvalue grew with the parameter.
            error += TOLERANCES.roundings_of_vectors * EPS * abs(e.value) / np.where(values, np.abs(values), np.inf)
        found.append(Derivatives(number, derivative, error, missing))
    return found


def _multiple(e: Eigenvalue, listed: list[Eigenvalue], neutral: list[complex]) -> str:
    """Return why an eigenvalue is not known to be simple; empty: it is."""
    if not math.isfinite(e.error_bound):
        return "nothing is known about its error"
    near = [x for x in listed if x is not e and not abs(x.value - e.value) > x.error_bound + e.error_bound]
    if near:
        return f"not known to be simple: {len(near) + 1} eigenvalues cannot be told apart"
    if any(abs(s - e.value) <= e.error_bound + TOLERANCES.neutral_apart * abs(e.value) for s in neutral):
        return "not distinguishable from a neutral one"
    return ""


class _Vectors:
    """Right and left vectors of S, from the matrix left to judge.

    Parameters
    ----------
    grounds : Grounds
    turn : ndarray, shape (n, n)
        The basis in which the slopes of S are given, as columns.
    """

    def __init__(self, grounds: Grounds, turn: Array) -> None:
        self.separated, self.turn = grounds.separated, turn
        separated = self.separated
        self.S, T, L, B = separated.S, separated.T, separated.L, separated.B
        self.A = separated.A
        self.turned, self.size = turn.T @ self.S @ turn, float(np.linalg.norm(self.S, 2))
        self.inner, self.along, self.across = T.T @ self.S @ T, T.T @ self.S @ B, B.T @ self.S @ L.T

    def moved(self, slopes: Array) -> Array | None:
        """Return Yᵀ (dS/dp) X, shape (parameters, r, r), where S X = X A, Yᵀ S = A Yᵀ and Yᵀ X = 1.

        It is None where A shares an eigenvalue with what is neutral, so that there are no such bases.
        """
        from scipy.linalg import solve_sylvester

        separated = self.separated
        X, Y = separated.B, separated.B
        try:
            if separated.T.shape[1]:
                X = X + separated.T @ solve_sylvester(-self.inner, self.A, self.along)
            if len(separated.L):
                Y = Y + separated.L.T @ np.linalg.solve(self.A, self.across).T
        except np.linalg.LinAlgError:
            return None
        moved: Array = (self.turn.T @ Y).T @ slopes @ (self.turn.T @ X)
        return moved

    def derivative(self, e: Eigenvalue, slopes: Array) -> tuple[Complex, Array]:
        """Return dλ/dp and an estimate of its error, shape (parameters,)."""
        x, y, at = self._pair(e.value)
        x, y = self.turn.T @ x, self.turn.T @ y
        number = complex(np.vdot(y, x))
        carried = slopes @ x
        derivative = carried @ y.conj() / number
        n = len(x)
        # (λ − S) z = rest with yᴴ z = 0: the change of the vectors with an error of S.
        shifted = at * np.eye(n) - self.turned
        bordered = np.block([[shifted, y[:, None]], [x.conj()[None, :], np.zeros((1, 1))]])
        behind = np.zeros((n + 1, len(slopes)), dtype=complex)
        behind[:n] = (carried - derivative[:, None] * x).T
        ahead = np.zeros((n + 1, len(slopes)), dtype=complex)
        ahead[:n] = (np.einsum("i,pij->pj", y.conj(), slopes) - derivative[:, None] * y.conj()).T
        reach = np.linalg.norm(np.linalg.solve(bordered, behind)[:n], axis=0) * np.linalg.norm(y)
        reach += np.linalg.norm(np.linalg.solve(bordered.T, ahead)[:n], axis=0) * np.linalg.norm(x)
        weight = np.linalg.norm(x) * np.linalg.norm(y) / abs(number)
        backward = max(e.error_bound / weight, TOLERANCES.roundings_of_vectors * EPS * self.size)
        rounding = TOLERANCES.roundings_of_vectors * EPS * (np.abs(slopes) @ np.abs(x)) @ np.abs(y) / abs(number)
        return derivative, backward * reach / abs(number) + rounding

    def _pair(self, value: complex) -> tuple[Complex, Complex, complex]:
        """Return the right and the left vector of an eigenvalue of S, and its value there."""
        v, w, at = _inverse_iteration(self.A, value)
        separated = self.separated
        x = separated.B @ v
        y = separated.B @ w
        if separated.T.shape[1]:
            x = x + separated.T @ np.linalg.solve(at * np.eye(len(self.inner)) - self.inner, self.along @ v)
        if len(separated.L):
            y = y + separated.L.T @ (self.across.T @ w / at.conjugate())
        return x, y, at


def _inverse_iteration(A: Array, value: complex) -> tuple[Complex, Complex, complex]:
    """Return right and left unit vectors of the eigenvalue of a matrix next to a value, and that eigenvalue."""
    n = len(A)
    shifted = A - value * np.eye(n)
    left, _, right = np.linalg.svd(shifted)
    v, w = right[-1].conj(), left[:, -1]
    return v, w, value + complex(np.vdot(w, shifted @ v) / np.vdot(w, v))
