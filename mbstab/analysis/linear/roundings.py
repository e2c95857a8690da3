"""Error bounds of the linearized equations, by running error analysis.

A number is a float with a bound of its distance from the result of exact arithmetic with the decimals of
the file (running error analysis: Wilkinson 1986, SIGNUM Newsletter 21; Higham 2002, Accuracy and
Stability of Numerical Algorithms, section 3.3). The kernels run on such numbers as on any other, so
that cancellation inside an element is taken into account, and structural zeros stay
zero. The errors of quantities that were solved for, coordinates, speeds, accelerations and multipliers, follow
from the residuals of their equations and from the rounding of these.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from mbstab.analysis.algebra.arrays import norms
from mbstab.analysis.algebra.rank import inverse_of_part
from mbstab.analysis.algebra.rounded import UNIT, Rounded, WithErrors, value_and_error
from mbstab.analysis.algebra.sparse import dense
from mbstab.analysis.algebra.tolerances import EPS
from mbstab.analysis.linear.linearize import Linearization
from mbstab.analysis.linear.tolerances import TOLERANCES
from mbstab.analysis.reference.coefficients import Matrices
from mbstab.analysis.reference.rounded_scene import errors_of, rounded_system, with_errors
from mbstab.analysis.reference.steady import Generator, declared_family
from mbstab.compiler.system import Array
from mbstab.records import dataclass

if TYPE_CHECKING:
    import numpy.typing as npt

# --- numbers with errors ----------------------------------------------------------------------------------------------


def _misfits(x: Any) -> Array:
    """Return the sums of sizes and errors of residuals."""
    if isinstance(x, WithErrors):
        return np.asarray(np.abs(x.values) + x.errors)
    return np.array([abs(y.v) + y.e if y.__class__ is Rounded else abs(float(y)) for y in x], dtype=float)


# --- what rounding makes of a linearization -------------------------------------------------------------------------


class Direction(NamedTuple):
    """A large change of coordinates by rounding along one direction, in which they are held weakly."""

    change: Array
    amount: float


@dataclass(frozen=True)
class Roundings:
    """Error bounds of M, R, K, J and D_q.

    Attributes
    ----------
    errors : Matrices
        Entry by entry, without `displaced`.
    displaced : tuple of Matrices
        Changes of all entries together, by rounding errors of coordinates that are held weakly.
    q : ndarray, shape (n_q,)
        Error bounds of the coordinates, without the changes behind `displaced`.
    """

    errors: Matrices
    displaced: tuple[Matrices, ...]
    q: Array


def roundings(linear: Linearization) -> Roundings:
    """Return error bounds of the matrices of a linearization, relative to those for the decimals of the file.

    Computed once for each linearization.
    """
    if "roundings" not in linear.kept:
        linear.kept["roundings"] = _Roundings(linear).found()
    known: Roundings = linear.kept["roundings"]
    return known


def _displaced(linear: Linearization, directions: list[Direction]) -> tuple[Matrices, ...]:
    """Return changes of M, R, K, J and D_q by changes of the coordinates."""
    found, sizes = [], linear.motion.sizes
    for change, amount in directions:
        # Differences over a range in which the equations are as weak as here.
        step = 1e-6 / (float(np.max(np.abs(change) / sizes)) or 1.0)
        there, back = (linear.beside(sign * step * change) for sign in (1.0, -1.0))
        found.append(Matrices(*((a - b) * (amount / (2.0 * step)) for a, b in zip(there, back, strict=True))))
    return tuple(found)


class _Roundings:
    """The motion of a linearization with error bounds of its parts."""

    def __init__(self, linear: Linearization) -> None:
        self.linear, self.motion = linear, linear.motion
        self.plain, self.system = linear.system, rounded_system(linear.system)
        self.time = self.system.scene.time
        if self.motion.time != float(self.time):
            self.time = self.motion.time
        self.directions: list[Direction] = []
        self.rate_error = 0.0
        self.missing: npt.NDArray[np.bool_] = np.array(
            [name not in self.system.scene.coordinates for name in self.plain.names]
        )

    def found(self) -> Roundings:
        """Return the error bounds of the matrices."""
        linear, motion, system = self.linear, self.motion, self.system
        dq, du = self._state()
        q, u = with_errors(motion.q, dq), with_errors(motion.u, du)
        state = system.dynamics(q, u, self.time)
        M, J = errors_of(state.M), errors_of(state.J)
        da = self._accelerations(state, M, J, dq, du)
        dnu = self._multipliers(state, M, J, da)
        a, nu = with_errors(motion.a, da), with_errors(motion.nu, dnu)
        K, R, D_q = (errors_of(x) for x in system.linearize(q, u, a, nu, self.time))
        generator = linear.generator
        if generator is not None and generator.turns:
            K, R, D_q = self._turned(generator, Matrices(M, R, K, J, D_q), dq)
        errors = linear.with_all_rows(Matrices(M, R, K, J, D_q), sizes=True)
        if linear.massless is not None and not linear.massless.exact:
            errors = linear.massless.with_roundings(errors, Matrices(*map(np.abs, linear.matrices)))
        return Roundings(errors, _displaced(linear, self.directions), dq)

    def _turned(self, generator: Generator, errors: Matrices, dq: Array) -> tuple[Array, Array, Array]:
        """Return the error bounds of K, R and D_q in a rotating frame."""
        motion, n_h = self.motion, self.system.n_h
        M, R, K, J, D_q = errors
        plain_K, plain_R, _ = self.plain.linearize(motion.q, motion.u, motion.a, motion.nu, motion.time)
        Xi, Xi_2 = (np.abs(x) for x in generator.frame(motion.q))
        first, second = self._frame(generator, dq)
        mass, rows = np.abs(motion.dynamics.M), np.abs(motion.dynamics.J[n_h:])
        plain_K, plain_R = np.abs(plain_K), np.abs(plain_R)
        K = K + R @ Xi + plain_R @ first + M @ Xi_2 + mass @ second
        K = K + EPS * (plain_K + 4.0 * (plain_R @ Xi + mass @ Xi_2))
        R = R + 2.0 * (M @ Xi + mass @ first) + 4.0 * EPS * (mass @ Xi)
        return K, R, D_q + J[n_h:] @ Xi + rows @ first + 4.0 * EPS * (rows @ Xi)

    # --- the motion -------------------------------------------------------------------------------------------------

    def _state(self) -> tuple[Array, Array]:
        """Return the error bounds of q and u."""
        motion, scene = self.motion, self.system.scene
        steady = motion.generators[0] if motion.generators else None
        dq, du = self._given(scene.coordinates, motion.q), self._given(scene.rates, motion.u)
        if self.plain.scene.model.reference.find is not None and steady is not None:
            return self._balanced(steady, dq)
        if self.missing.any() and self.plain.n_h:
            still = [0.0] * self.plain.n_q
            E = self.system.closing.dynamics(with_errors(motion.q, dq), still, self.time).E
            dq = self._coordinates(E, dq)
        if motion.declared and steady is not None:
            return dq, self._steady(steady, dq)
        if not motion.at_rest and self.plain.n_c:
            du = self._rates(dq, du)
        return dq, du

    def _given(self, values: dict[str, Any], found: Array) -> Array:
        """Return the errors of given values, 0 for others; a motion at another state is taken as exact."""
        errors = np.zeros(len(found))
        for i, name in enumerate(self.plain.names):
            if name in values:
                v, e = value_and_error(values[name])
                errors[i] = e if abs(v - found[i]) <= e + 4.0 * UNIT * abs(v) else UNIT * abs(float(found[i]))
        return errors

    def _coordinates(self, E: Any, dq: Array) -> Array:
        """Return the error bounds of the coordinates: given ones, and those that the constraints determine."""
        motion, n_h = self.motion, self.plain.n_h
        columns, sizes = np.flatnonzero(self.missing), motion.sizes
        J = dense(motion.dynamics.J[:n_h]) * sizes
        lengths = norms(J)
        G = J[:, columns] / lengths[:, None]
        steps = self._solved(inverse_of_part(G), _misfits(E[:n_h]) / lengths, columns, sizes[columns])
        result = dq.copy()
        result[columns] = steps * sizes[columns] + UNIT * np.abs(motion.q[columns])
        return result

    def _solved(self, inverse: Array, misfit: Array, columns: Any, sizes: Array) -> Array:
        """Return the error bound of unknowns by their inverse, |r| ≤ misfit; large joint changes are kept separately.

        The error of one equation changes all unknowns in a fixed ratio: changes that cancel in a stiff force
        must not be taken entry by entry.
        """
        moves = inverse * misfit
        result: Array = np.sum(np.abs(moves), axis=1)
        n, relative = len(columns), sizes / self.motion.sizes[columns]
        own = moves[:n] * relative[:, None]
        left, _, _ = np.linalg.svd(own, full_matrices=False)
        for together in left.T[: TOLERANCES.loose_directions]:
            share = together @ own
            amount = float(np.sum(np.abs(share)))
            if not amount * float(np.max(np.abs(together), initial=0.0)) > TOLERANCES.loose_direction:
                break
            change = np.zeros(self.plain.n_q)
            change[columns] = together * self.motion.sizes[columns]
            self.directions.append(Direction(change, amount))
            own = own - np.outer(together, share)
        result[:n] = np.sum(np.abs(own), axis=1) / np.where(relative > 0.0, relative, 1.0)
        return result

    def _rates(self, dq: Array, du: Array) -> Array:
        """Return the error bounds of the speeds: given ones, and those that the constraints determine."""
        motion = self.motion
        columns = np.array([i for i, name in enumerate(self.plain.names) if name not in self.plain.scene.rates])
        if not len(columns):
            return du
        V = self.system.dynamics(with_errors(motion.q, dq), with_errors(motion.u, du), self.time).V
        J = motion.dynamics.J * motion.sizes
        lengths = norms(J)
        inverse = inverse_of_part(J[:, columns] / lengths[:, None])
        result = du.copy()
        steps = np.abs(inverse) @ (_misfits(V) / lengths)
        result[columns] = steps * motion.sizes[columns] + UNIT * np.abs(motion.u[columns])
        return result

    def _steady(self, steady: Generator, dq: Array) -> Array:
        """Return the error bounds of the speeds of a declared steady motion."""
        motion, plain = self.motion, self.plain
        family, known = declared_family(plain)
        c, basis = family.coefficients_of(steady), family.basis(motion.q)
        given = self._given_rates()
        dc = np.array([given.get(k, 0.0) for k in range(family.size)])
        free = [k for k in range(family.size) if k not in known]
        if free:
            du = self._field(steady, basis, dq, dc)
            V = self.system.dynamics(with_errors(motion.q, dq), with_errors(motion.u, du), self.time).V
            rates = [i for i, name in enumerate(plain.names) if name in plain.scene.rates]
            columns = np.vstack([motion.dynamics.J @ basis[:, free], basis[np.ix_(rates, free)]])
            lengths = norms(np.vstack([motion.dynamics.J * motion.sizes, np.diag(motion.sizes)[rates]]))
            misfit = np.concatenate([_misfits(V), self._off(rates) + du[rates]]) / lengths
            dc[free] = np.abs(inverse_of_part(columns / lengths[:, None])) @ misfit
        self.rate_error = _relative(dc, c)
        return self._field(steady, basis, dq, dc)

    def _off(self, which: Any) -> Array:
        """Return how far the speeds are from those that the file gives, and the errors of these."""
        given = [value_and_error(self.system.scene.rates[self.plain.names[i]]) for i in which]
        return np.array([abs(self.motion.u[i] - v) + e for i, (v, e) in zip(which, given, strict=True)])

    def _given_rates(self) -> dict[int, float]:
        """Return the errors of the rates of a steady motion that are given, by number."""
        steady = self.system.scene.steady
        if steady is None:
            return {}
        given = [steady.rate] if steady.axis is not None else []
        given += [steady.speed] if steady.direction is not None else []
        return {k: value_and_error(x)[1] for k, x in enumerate(given) if x is not None}

    def _field(self, steady: Generator, basis: Array, dq: Array, dc: Array) -> Array:
        """Return the error bounds of the speeds of a steady motion."""
        slope = np.abs(steady.frame(self.motion.q)[0])
        result: Array = np.abs(basis) @ dc + slope @ dq + 4.0 * EPS * np.abs(self.motion.u)
        return result

    def _frame(self, generator: Generator, dq: Array) -> tuple[Array, Array]:
        """Return the error bounds of Ξ and Ξ₂."""
        q, d = self.motion.q, self.plain.scene.dimension
        Xi, Xi_2 = generator.frame(q)
        rate = self.rate_error + 8.0 * EPS
        first, second = rate * np.abs(Xi), 2.0 * rate * np.abs(Xi_2) + rate * np.abs(Xi) @ np.abs(Xi)
        if d == 2:
            return first, second
        for k in (3, 4):
            parts = [part for part in self.plain.body_slices if part.stop - part.start == 6]
            angles = [part.start + k for part in parts]
            step = np.zeros(len(q))
            step[angles] = TOLERANCES.angle_difference
            there, back = (generator.frame(q + sign * step) for sign in (1.0, -1.0))
            weights = np.zeros(len(q))
            for part in parts:
                weights[part] = (dq[part.start + k] + EPS * abs(q[part.start + k])) / (
                    2.0 * TOLERANCES.angle_difference
                )
            first = first + np.abs(there[0] - back[0]) * weights[:, None]
            second = second + np.abs(there[1] - back[1]) * weights[:, None]
        return first, second

    # --- equilibria and steady motions that were looked for ---------------------------------------------------------

    def _balanced(self, steady: Generator, dq: Array) -> tuple[Array, Array]:
        """Return the error bounds of q and u of a solution of the balance equations."""
        from mbstab.analysis.reference.equations import Balance

        plain, motion = self.plain, self.motion
        family, known = declared_family(plain)
        if len(known) < family.size and not np.any(steady.spins[list(family.columns)]):
            family = replace(family, columns=())
        if motion.sharpened:
            dq = np.where(self.missing, UNIT * np.abs(motion.q), dq)
            c, basis = family.coefficients_of(steady), family.basis(motion.q)
            given = self._given_rates()
            dc = np.array([given.get(k, UNIT * abs(x)) for k, x in enumerate(c)])
            self.rate_error = _relative(dc, c)
            return dq, self._field(steady, basis, dq, dc)
        balance = Balance(plain, motion.sizes, family, known, ~self.missing)
        # Forces and speeds in units of the scene.
        balance.energy = float(np.max(np.abs(self.linear.K * motion.sizes * motion.sizes[:, None]), initial=0.0)) or 1.0
        balance.speed = float(np.max(np.abs(motion.u) / motion.sizes, initial=0.0)) or 1.0
        balance.row_speeds = np.full(plain.n_c, balance.speed)
        c, basis = family.coefficients_of(steady), family.basis(motion.q)
        at = balance.state(motion.q, c)
        given = self._given_rates()
        dc = np.array([given.get(k, 0.0) for k in range(family.size)])
        du = self._field(steady, basis, dq, dc) if family.size else 0.0 * dq
        state = self.system.dynamics(with_errors(motion.q, dq), with_errors(motion.u, du), self.time)
        M, J = errors_of(state.M), errors_of(state.J)
        da = self._steady_accelerations(steady, dq, du)
        force = self._force(state, M, J, da, at.nu)
        lengths, n_h = balance.lengths(motion.dynamics.J), plain.n_h
        misfit = [
            (np.abs(force[0]) + force[1]) * motion.sizes / balance.energy,
            _misfits(state.E[:n_h]) / lengths[:n_h],
        ]
        if balance.with_speeds:
            rates = (self._off(balance.given) + du[balance.given]) / motion.sizes[balance.given]
            misfit += [_misfits(state.V) / (lengths * balance.speed), rates / balance.speed]
        sizes, count = motion.sizes[balance.open], len(balance.open)
        steps = self._solved(balance.equations(at).inverse, np.concatenate(misfit), balance.open, sizes)
        dq = dq.copy()
        dq[balance.open] = steps[:count] * sizes + UNIT * np.abs(motion.q[balance.open])
        dq += 0.0 if motion.spread is None else motion.spread
        if not family.size:
            return dq, 0.0 * dq
        dc[balance.free] = steps[count : balance.moving] * balance.speed
        self.rate_error = _relative(dc, c)
        return dq, self._field(steady, basis, dq, dc)

    # --- accelerations and multipliers ------------------------------------------------------------------------------

    def _force(self, state: Any, M: Array, J: Array, da: Array, nu: Array) -> tuple[Array, Array]:
        """Return the unbalanced forces and their error bounds."""
        motion, plain = self.motion, self.motion.dynamics
        value = plain.F0 + plain.M @ motion.a + plain.J.T @ nu
        error = errors_of(state.F0) + M @ np.abs(motion.a) + abs(plain.M) @ da + J.T @ np.abs(nu)
        size = np.abs(plain.F0) + abs(plain.M) @ np.abs(motion.a) + abs(plain.J.T) @ np.abs(nu)
        return value, error + TOLERANCES.roundings_of_sum * EPS * size

    def _steady_accelerations(self, steady: Generator, dq: Array, du: Array) -> Array:
        motion = self.motion
        if motion.at_rest or not np.any(motion.a):
            return np.zeros_like(dq)
        first, _ = self._frame(steady, dq)
        slope = np.abs(steady.frame(motion.q)[0])
        result: Array = slope @ du + first @ np.abs(motion.u) + 4.0 * EPS * np.abs(motion.a)
        return result

    def _accelerations(self, state: Any, M: Array, J: Array, dq: Array, du: Array) -> Array:
        """Return the error bounds of the accelerations."""
        motion, spaces = self.motion, self.motion.spaces
        steady = motion.generators[0] if motion.generators else None
        if steady is not None and (motion.declared or motion.at_rest):
            return self._steady_accelerations(steady, dq, du)
        value, error = self._force(state, M, J, np.zeros_like(dq), motion.nu)
        bias = _misfits(state.B + motion.dynamics.J @ motion.a) + J @ np.abs(motion.a)
        inverse, move = motion.augmented.inverse, motion.augmented.mobility
        off = np.abs(inverse) @ (bias * spaces.row_scale)
        if spaces.Z.shape[1]:
            off = off + np.abs(move @ (value * spaces.scale))
            off = off + np.abs(move) @ (error * spaces.scale + np.abs(motion.augmented.M) @ off)
        result: Array = off * spaces.scale + UNIT * np.abs(motion.a)
        return result

    def _multipliers(self, state: Any, M: Array, J: Array, da: Array) -> Array:
        """Return the error bounds of the multipliers, from the rounding of all the forces that they balance."""
        motion = self.motion
        if not len(motion.nu):
            return np.zeros(0)
        value, error = self._force(state, M, J, da, motion.nu)
        result: Array = np.abs(motion.balancing(value)) + motion.balancing_sizes(error) + UNIT * np.abs(motion.nu)
        return result


def _relative(error: Array, c: Array) -> float:
    """Return the largest relative error of rates."""
    size = np.abs(c)
    return float(np.max(np.where(size > 0.0, error / np.where(size > 0.0, size, 1.0), 0.0), initial=0.0))
