"""The linear model from inputs to outputs: A, B, C, D with chosen states, and the descriptor form.

With y = [ξ; η] of `mbstab.analysis.linear.linearize` in scaled coordinates, and the columns f, c, d of
`mbstab.analysis.response.signals`, a motion that the rows allow is

    Δq = N ξ + α w,   Δq̇ = N (P ξ + Z η) + α ẇ + β w,   J α = [−c; 0],   J β = [0; −d − D_q α].

The signals w of inputs that move constraint rows act with their rates and second derivatives, which are columns too.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np

from mbstab.analysis.algebra.rank import rank_of
from mbstab.analysis.algebra.tolerances import EPS
from mbstab.analysis.linear.linearize import Linearization, StateSpace, state_space
from mbstab.analysis.reference.tolerances import TOLERANCES as REFERENCE
from mbstab.analysis.response.descriptor import Descriptor, Unreduced
from mbstab.analysis.response.measured import Meter
from mbstab.analysis.response.signals import Signals, State
from mbstab.analysis.response.tolerances import TOLERANCES
from mbstab.compiler.system import Array
from mbstab.errors import Location, ModelFileError, NumericalError, Problem, UsageError
from mbstab.model.expressions import ExpressionError
from mbstab.model.measures import unit_of_output
from mbstab.model.schema import Quantity
from mbstab.model.sections.outputs import measured_expression
from mbstab.records import Answer, dataclass


@dataclass(frozen=True)
class ControlModel(Answer):
    """The linear model ẋ = A x + B w, z = C x + D w about a reference motion, all small changes.

    Attributes
    ----------
    A, B, C, D : ndarray
        Of shapes (n, n), (n, m), (p, n), (p, m). The columns of B and D belong to `signals`: each input, then its
        rate and its second derivative where these act.
    states, state_units : tuple of str
    signals : tuple of str
        Such as ``force`` or ``rate(drive)``.
    inputs, input_units, outputs, output_units : tuple of str
    orders : tuple of (int, int)
        Number of the input of each column, and how often it is differentiated.
    coordinates : tuple of str
        Those that the states determine.
    to_coordinates, to_rates : ndarray, shape (coordinates, n)
        Δq and Δu of these from the states, without inputs, in the frame of a steady motion.
    descriptor : Descriptor
    linear : Linearization
    """

    A: Array
    B: Array
    C: Array
    D: Array
    states: tuple[str, ...]
    state_units: tuple[str, ...]
    signals: tuple[str, ...]
    inputs: tuple[str, ...]
    input_units: tuple[str, ...]
    outputs: tuple[str, ...]
    output_units: tuple[str, ...]
    orders: tuple[tuple[int, int], ...]
    coordinates: tuple[str, ...]
    to_coordinates: Array
    to_rates: Array
    descriptor: Descriptor
    linear: Linearization

    def to_scipy(self) -> Any:
        """Return a `scipy.signal.StateSpace`."""
        from scipy.signal import StateSpace as Scipy

        return Scipy(*self._required())

    def to_control(self) -> Any:
        """Return a `control.StateSpace` with named states, inputs and outputs.

        Raises
        ------
        UsageError
            If python-control is not installed, or there are no inputs or outputs.
        """
        try:
            import control  # type: ignore[import-not-found,import-untyped,unused-ignore]
        except ImportError:
            raise UsageError("python-control is not installed\nhint: pip install control") from None
        names = {"states": list(self.states), "inputs": list(self.signals), "outputs": list(self.outputs)}
        return control.ss(*self._required(), **names)

    def _required(self) -> tuple[Array, Array, Array, Array]:
        if not self.signals or not self.outputs:
            what = "outputs" if self.signals else "inputs"
            raise UsageError(f"the model declares no {what}\nhint: add the section {what}: to the file")
        return self.A, self.B, self.C, self.D


def _refuse(location: Location, path: str, message: str, hint: str) -> ModelFileError:
    return ModelFileError([Problem(location, path, message, hint)])


class _Ports:
    """What inputs do to motions, and outputs tell of them, in the scaled bases of the deflated system."""

    def __init__(self, linear: Linearization) -> None:
        scene = linear.system.scene
        if not linear.constant and not linear.frozen and (scene.inputs or scene.model.outputs):
            raise NumericalError(
                "the coefficients change along the motion: there is no linear model with constant A, B, C, D\n"
                "hint: --frozen takes the equations as they are at the reference time"
            )
        self.linear, self.space = linear, state_space(linear)
        self.system, self.motion = linear.system, linear.motion
        self.signals = Signals(self.system)
        self.m = len(self.signals.items)
        motion = linear.motion
        self.at = State(motion.q, motion.u, motion.a, motion.nu, motion.time)
        self.f, self.rows = self.signals.columns(self.at)
        self._require_steady_columns()
        if linear.massless is not None:
            self.rows = linear.massless.with_signals(self.rows, self.f)

    # --- the frame ----------------------------------------------------------------------------------------------------

    @cached_property
    def frame(self) -> tuple[Array, Array]:
        """Ξ and Ξ₂ of the frame of the equations."""
        generator, n = self.linear.generator, self.system.n_q
        if generator is None or not generator.turns:
            return np.zeros((n, n)), np.zeros((n, n))
        return generator.frame(self.motion.q)

    @cached_property
    def later(self) -> list[tuple[State, Array, tuple[Array, Array]]]:
        """The motion at later times, how directions have turned, and Ξ and Ξ₂ there."""
        generator, motion = self.linear.generator, self.motion
        if generator is None or self.linear.frozen:
            return []
        fastest = float(np.max(np.abs(motion.u / motion.sizes), initial=0.0))
        found = []
        for part in (1.0, 2.3) if fastest > 0.0 else ():
            time = part * REFERENCE.guard_turn / fastest
            q, T = generator.flow(motion.q, time)
            u, a = generator.field(q), generator.acceleration(q)
            found.append((State(q, u, a, motion.nu, motion.time + time), T, generator.frame(q)))
        return found

    def _require_steady_columns(self) -> None:
        """Refuse an input that is not constant in the frame in which the equations are."""
        for at, T, _ in self.later:
            f, rows = self.signals.columns(at)
            scale = self.motion.spaces.scale[:, None]
            change = np.vstack([(T.T @ f - self.f) * scale, rows - self.rows])
            size = np.vstack([self.f * scale, self.rows])
            for i, item in enumerate(self.signals.items):
                if np.max(np.abs(change[:, i])) > TOLERANCES.steady_signal * np.max(np.abs(size[:, i]), initial=0.0):
                    hint = "write frame: body if it turns with a body, act along a joint, or ask with --frozen"
                    raise _refuse(
                        item.entry.location,
                        item.entry.path,
                        f"the input changes along the motion ({self._moving()})",
                        hint,
                    )

    def _moving(self) -> str:
        return str(self.linear.generator)

    # --- inputs -------------------------------------------------------------------------------------------------------

    @cached_property
    def maps(self) -> dict[str, Array]:
        """δ, δ̇, δ̈ and Δν (keys q, u, a, nu; scaled), and ẏ, of y, w, ẇ and ẅ side by side."""
        linear, spaces, n_xi, m = self.linear, self.linear.spaces, self.space.n_xi, self.m
        s, r, N, Z = spaces.scale, spaces.row_scale, spaces.N, spaces.Z
        n_h, n_f = linear.n_h, len(self.space.A)
        J, D_q = (linear.J * s) * r[:, None], (linear.D_q * s) * r[n_h:, None]
        inverse = self._inverse(J)
        rows = self.rows * r[:, None]
        alpha = -inverse @ np.vstack([rows[:n_h], np.zeros_like(rows[n_h:])])
        beta = -inverse @ np.vstack([np.zeros_like(rows[:n_h]), rows[n_h:] + D_q @ alpha])
        self._require_consistent(J @ alpha + np.vstack([rows[:n_h], np.zeros_like(rows[n_h:])]), rows)
        self._require_consistent(J[n_h:] @ beta + rows[n_h:] + D_q @ alpha, rows)
        M, R, K = (x * s * s[:, None] for x in (linear.M, linear.R, linear.K))
        y = slice(0, n_f)
        blocks = [slice(n_f + k * m, n_f + (k + 1) * m) for k in range(3)]
        width = n_f + 3 * m
        rate = np.zeros((n_f, width))
        rate[:, y] = self.space.A
        rate[:n_xi, blocks[0]] = N.T @ beta
        q, u, a = (np.zeros((len(s), width)) for _ in range(3))
        q[:, :n_xi], q[:, blocks[0]] = N, alpha
        u[:] = N @ rate[:n_xi]
        # N Nᵀ β is β, and is there already.
        u[:, blocks[1]] += alpha
        # ξ̈ = P ξ̇ + Z η̇ + Nᵀ β ẇ, with η̇ from the equations of motion without the part of A.
        P = self.space.A[:n_xi, :n_xi]
        known = N @ (P @ rate[:n_xi])
        known[:, blocks[1]] += beta
        known[:, blocks[2]] += alpha
        force = M @ known + R @ u + K @ q
        force[:, blocks[0]] += self.f * s[:, None]
        free = N @ Z
        rate[n_xi:, n_f:] = -np.linalg.solve(self.space.M_z, _product(free.T, force[:, n_f:])) if Z.shape[1] else 0.0
        a[:] = known + free @ rate[n_xi:]
        nu = -inverse.T @ (M @ a + R @ u + K @ q + _placed(self.f * s[:, None], blocks[0], width))
        return {"q": q * s[:, None], "u": u * s[:, None], "a": a * s[:, None], "nu": nu * r[:, None], "y": rate}

    def _inverse(self, J: Array) -> Array:
        """Return a right inverse of the scaled rows, all together."""
        linear, spaces, own = self.linear, self.linear.spaces, self.motion.spaces
        constraints = np.asarray(self.motion.augmented.inverse)
        if linear.massless is None:
            return constraints
        assert self.motion.massless is not None
        light, units = linear.massless, (own.scale / spaces.scale)[:, None]
        n = light.n_h + len(light.algebraic)
        rows = np.concatenate([spaces.row_scale[: light.n_h], spaces.row_scale[n : n + light.n_n]])
        constraints = units * constraints * own.row_scale / rows
        return light.right_inverse(J, constraints, units * self.motion.massless)

    def _require_consistent(self, left: Array, rows: Array) -> None:
        """Refuse an input that moves a row against others that imply it."""
        for i, item in enumerate(self.signals.items):
            if np.max(np.abs(left[:, i]), initial=0.0) > TOLERANCES.steady_signal * np.max(
                np.abs(rows[:, i]), initial=0.0
            ):
                redundant = "; ".join(str(x) for x in self.motion.redundant)
                message = "the input moves constraint rows that other rows hold: no motion satisfies them"
                raise _refuse(item.entry.location, item.entry.path, message, f"remove the redundant rows: {redundant}")

    def require_effect(self, outputs: Array) -> None:
        """Refuse an input that moves nothing and that no output shows; rows of outputs as `measured` returns them.

        Where all that an input acts on is held, outputs show it by reactions, at once.
        """
        n_f, m = len(self.space.A), self.m
        by_w = self.maps["y"][:, n_f:]
        moved = np.vstack([by_w[:, k * m : (k + 1) * m] for k in range(3)])
        for i, item in enumerate(self.signals.items):
            f = np.max(np.abs(self.f[:, i] * self.motion.spaces.scale), initial=0.0)
            if np.any(self.rows[:, i]) or np.max(np.abs(moved[:, i]), initial=0.0) > TOLERANCES.steady_signal * f:
                continue
            if np.any(outputs[:, n_f + i :: m]):
                continue
            if f == 0.0:
                message, hint = "the input has no effect on the equations here", "let it act elsewhere, or remove it"
            else:
                columns = np.flatnonzero(self.f[:, i])
                held = [row for k, row in enumerate(self.linear.rows) if np.any(self.linear.J[k, columns])]
                drives = [row.owner for row in held if row.section == "drives"] or [row.owner for row in held]
                message = (
                    f"the input moves nothing: {', '.join(dict.fromkeys(drives))} prescribes the motion it acts on"
                )
                hint = "make the function of the drive the input (type: drive), or measure the effort that holds it"
            raise _refuse(item.entry.location, item.entry.path, message, hint)

    # --- what is measured --------------------------------------------------------------------------------------------

    def measured(self, expression: Quantity, relative: bool = False) -> Array:
        """Return an expression as a row over y, w, ẇ and ẅ.

        Parameters
        ----------
        relative : bool
            Take rates in the frame of the equations, as states do, not in ground axes.
        """
        slope = self._slope(expression, self.at)
        row = self._in_frame(slope, None if relative else self.frame)
        if not relative:
            self._require_steady(
                expression, row, self._in_frame(np.abs(slope), (abs(self.frame[0]), abs(self.frame[1])))
            )
        q, u, a, nu, by_w = self._parts(row)
        self._require_unique(expression, nu)
        maps, n_f = self.maps, len(self.space.A)
        found: Array = q @ maps["q"] + u @ maps["u"] + a @ maps["a"] + nu @ maps["nu"]
        found[n_f:] += by_w
        return found

    def outputs(self) -> Array:
        """Return the outputs of the file as rows over y, w, ẇ and ẅ."""
        rows = [self.measured(x) for x in self.system.scene.model.outputs.values()]
        return np.array(rows).reshape(len(rows), len(self.space.A) + 3 * self.m)

    def slope(self, expression: Quantity) -> list[Array]:
        """Return the slopes of an output by δ, δ̇, δ̈, Δν and the signals in the frame of the equations."""
        return self._parts(self._in_frame(self._slope(expression, self.at), self.frame))

    def _parts(self, row: Array) -> list[Array]:
        """Return the slopes by δ, δ̇, δ̈, the multipliers of all rows and the signals."""
        q, u, a, nu, by_w = np.split(row, np.cumsum([self.system.n_q] * 3 + [self.system.n_c]))
        light = self.linear.massless
        return [q, u, a, nu if light is None else light.padded(nu), by_w]

    def _slope(self, expression: Quantity, at: State) -> Array:
        try:
            return Meter(self.system, self.signals, at).slope(expression)
        except ExpressionError as error:
            raise _refuse(
                expression.location, expression.path, error.message, "measure something that is smooth at the reference"
            ) from None

    def _in_frame(self, row: Array, frame: tuple[Array, Array] | None, T: Array | None = None) -> Array:
        """Return a slope by Δq, Δu, Δa and others as one by δ, δ̇, δ̈ and others."""
        n = self.system.n_q
        q, u, a, rest = row[:n], row[n : 2 * n], row[2 * n : 3 * n], row[3 * n :]
        if frame is not None:
            q, u = q + u @ frame[0] + a @ frame[1], u + 2.0 * (a @ frame[0])
        if T is not None:
            q, u, a = q @ T, u @ T, a @ T
        return np.concatenate([q, u, a, rest])

    def _require_steady(self, expression: Quantity, row: Array, terms: Array) -> None:
        """Refuse an output that is not constant in the frame in which the equations are.

        Parameters
        ----------
        row, terms : ndarray
            Its slope in that frame, and the sum of the sizes of all terms of it.
        """
        n, scale = self.system.n_q, self.motion.spaces.scale
        for at, T, frame in self.later:
            then = self._in_frame(self._slope(expression, at), frame, T)
            for k in range(3):
                now, other, sizes = (x[k * n : (k + 1) * n] * scale for x in (row, then, terms))
                # Rounding is relative to the largest term.
                if np.max(np.abs(other - now), initial=0.0) > TOLERANCES.steady_signal * np.max(sizes, initial=0.0):
                    raise _refuse(
                        expression.location,
                        expression.path,
                        f"the output changes along the motion ({self._moving()}): no constant C describes it",
                        "measure along a joint or relative to a body that takes part, or ask with --frozen",
                    )

    def _require_unique(self, expression: Quantity, nu: Array) -> None:
        """Refuse an output that needs multipliers which the motion does not determine."""
        if not np.any(nu):
            return
        spaces = self.linear.spaces
        free = rank_of(self.linear.J * spaces.scale * spaces.row_scale[:, None]).left_null
        own = nu * spaces.row_scale
        if np.max(np.abs(own @ free), initial=0.0) > TOLERANCES.steady_signal * np.max(np.abs(own)):
            redundant = "; ".join(str(x) for x in self.motion.redundant)
            message = f"the output needs a reaction that is not unique: {redundant}"
            hint = "remove the redundant rows, or measure a sum that does not depend on how they share the load"
            raise _refuse(expression.location, expression.path, message, hint)


def _placed(block: Array, where: slice, width: int) -> Array:
    found = np.zeros((len(block), width))
    found[:, where] = block
    return found


# --- states ---------------------------------------------------------------------------------------------------------


def _chosen(space: StateSpace, names: Sequence[str]) -> list[str]:
    """Return coordinates and rates that determine the motion, chosen by pivoting in scaled coordinates."""
    from scipy.linalg import qr

    N, Z = space.spaces.N, space.spaces.Z
    places = qr(N.T, pivoting=True, mode="r")[1][: N.shape[1]] if N.size else []
    free = N @ Z
    rates: Any = []
    if free.shape[1]:
        R, order = qr(free[places].T, pivoting=True, mode="r")
        own = np.abs(np.diag(R))
        if len(own) == free.shape[1] and own[-1] > TOLERANCES.pivot * own[0]:
            rates = np.asarray(places)[order[: free.shape[1]]]
        else:
            rates = qr(free.T, pivoting=True, mode="r")[1][: free.shape[1]]
    return [*(names[i] for i in sorted(places)), *(f"rate({names[i]})" for i in sorted(rates))]


def split_states(text: str) -> list[str]:
    """Return the expressions of a list with commas between them, such as ``x, rate(x)``."""
    return [part.strip() for part in re.split(r",(?![^()]*\))", text) if part.strip()]


def unreduced(linear: Linearization) -> Unreduced:
    """Return the index-3 system about a reference motion, for the inputs and outputs of the file.

    Raises
    ------
    ModelFileError, NumericalError
        As `control_model`.
    """
    ports = _Ports(linear)
    outputs, inputs = linear.system.scene.model.outputs, tuple(item.name for item in ports.signals.items)
    ports.require_effect(ports.outputs())
    orders = tuple((i, k) for i in range(ports.m) for k in range(3))
    units = tuple(unit_of_output(linear.system.scene.model, x) for x in outputs.values())
    return Unreduced(_descriptor(ports, orders), linear, orders, inputs, tuple(outputs), units)


def control_model(linear: Linearization, states: Sequence[str] = ()) -> ControlModel:
    """Return A, B, C, D about a reference motion, for the inputs and outputs of the file.

    Parameters
    ----------
    linear : Linearization
    states : sequence of str
        Expressions of coordinates, joint angles and their rates; none: chosen by the program so that the map from
        them is well conditioned. They must determine the motion, or at least their own rates.

    Raises
    ------
    ModelFileError
        If an input moves nothing or changes along the motion, or an output changes or needs a reaction that is not
        unique.
    UsageError
        If the states do not determine the motion.
    NumericalError
        If the coefficients change along the motion.
    """
    ports = _Ports(linear)
    model, n_f, m = linear.system.scene.model, len(ports.space.A), ports.m
    texts = list(states) or _chosen(ports.space, linear.names)
    expressions = [_state(model, text) for text in texts]
    rows = np.array([ports.measured(x, relative=True) for x in expressions]).reshape(len(texts), n_f + 3 * m)
    outputs = ports.outputs()
    ports.require_effect(outputs)
    S, s = rows[:, :n_f], [rows[:, n_f + k * m : n_f + (k + 1) * m] for k in range(3)]
    if any(np.any(x) for x in s[2:]):
        raise UsageError("a state cannot be an acceleration\nhint: states are coordinates, joint motions and rates")
    # Speeds in units of a typical rate: the states then depend on both alike.
    units = np.where(np.arange(n_f) < ports.space.n_xi, 1.0, ports.space.rate)
    scale = 1.0 / np.maximum(np.linalg.norm(S * units, axis=1), 1e-300)
    balanced = S * scale[:, None] * units
    inverse, error = (units[:, None] * x * scale for x in _inverse(balanced))
    rate = ports.maps["y"]
    b = [rate[:, n_f + k * m : n_f + (k + 1) * m] for k in range(3)]
    A = _product(S, rate[:, :n_f], inverse, error=error)
    _require_states(S, rate[:, :n_f], A, balanced, texts, given=bool(states))
    B = [_product(S, b[0]) - A @ s[0], _product(S, b[1]) - A @ s[1] + s[0], _product(S, b[2]) + s[1]]
    C = _product(outputs[:, :n_f], inverse, error=error)
    _require_told(outputs[:, :n_f], C @ S, list(model.outputs.values()), texts)
    D = [outputs[:, n_f + k * m : n_f + (k + 1) * m] for k in range(3)]
    D = [D[0] - C @ s[0], D[1] - C @ s[1], D[2]]
    used = [(i, k) for i in range(m) for k in range(3) if k == 0 or np.any(B[k][:, i]) or np.any(D[k][:, i])]
    inputs = tuple(item.name for item in ports.signals.items)
    return ControlModel(
        A,
        _columns(B, used),
        C,
        _columns(D, used),
        tuple(texts),
        tuple(unit_of_output(model, x) for x in expressions),
        tuple((inputs[i], f"rate({inputs[i]})", f"acceleration({inputs[i]})")[k] for i, k in used),
        inputs,
        tuple(ports.signals.units),
        tuple(model.outputs),
        tuple(unit_of_output(model, x) for x in model.outputs.values()),
        tuple(used),
        *_maps(ports, S, inverse, error),
        _descriptor(ports, used),
        linear,
    )


def _columns(parts: Sequence[Array], used: Sequence[tuple[int, int]]) -> Array:
    """Return column i of part k for each pair (i, k)."""
    return np.array([parts[k][:, i] for i, k in used]).reshape(len(used), len(parts[0])).T


def _inverse(S: Array) -> tuple[Array, Array]:
    """Return the pseudo-inverse and the size of the rounding in each of its entries (Bauer 1966, Skeel 1979)."""
    inverse = np.asarray(np.linalg.pinv(S), dtype=float)
    # Singular values give it to the rounding of its largest entries: a step of Newton's method, to that of its own.
    missed = np.eye(len(S)) - S @ inverse
    found, off = inverse + inverse @ missed, np.abs(missed) + len(S) * EPS * (np.abs(S) @ np.abs(inverse))
    return found, np.abs(inverse) @ off @ off + len(S) * EPS * (np.abs(found) @ np.abs(S) @ np.abs(found))


def _product(*factors: Array, error: Array | float = 0.0) -> Array:
    """Return a product in which entries that are no larger than the rounding of their sums are zero.

    `error` is the size of the errors in the last factor.
    """
    value, size = factors[0], np.abs(factors[0])
    off: Array | float = 0.0
    for factor in factors[1:]:
        off = size @ (error * np.ones_like(factor)) if factor is factors[-1] else off
        value, size = value @ factor, size @ np.abs(factor)
    rounding = EPS * sum(len(x) for x in factors[1:])
    return np.where(np.abs(value) > rounding * size + off, value, 0.0)


def _state(model: Any, text: str) -> Quantity:
    try:
        return measured_expression(model, text)
    except ExpressionError as error:
        raise UsageError(
            f"--states {text}: {error.message}" + (f"\nhint: {error.hint}" if error.hint else "")
        ) from None


def _require_states(S: Array, A: Array, own: Array, balanced: Array, texts: Sequence[str], given: bool) -> None:
    """Refuse states that depend on each other, or whose rates depend on other things.

    `balanced` are the rows of S with speeds in units of a typical rate, of length 1.
    """
    smallest = float(np.linalg.svd(balanced, compute_uv=False)[-1]) if len(S) <= S.shape[1] and S.size else 0.0
    if len(S) and smallest < TOLERANCES.independent_states and not given:
        raise NumericalError(
            f"no well conditioned states were found: {', '.join(texts)} nearly depend on each other, {smallest:.1e}, "
            f"should be {TOLERANCES.independent_states:g} or more\n"
            "hint: rates and states of very different speeds do that, such as a very short time constant; leave it out"
        )
    if len(S) and smallest < TOLERANCES.independent_states:
        raise UsageError(
            f"--states {', '.join(texts)}: these states depend on each other: {smallest:.1e}, should be "
            f"{TOLERANCES.independent_states:g} or more\n"
            "hint: leave out one of them; without --states the program chooses them"
        )
    left, size = S @ A - own @ S, np.abs(S) @ np.abs(A)
    for text, rest, whole in zip(texts, left, size, strict=True):
        if np.max(np.abs(rest), initial=0.0) > TOLERANCES.steady_signal * max(np.max(whole, initial=0.0), 1e-300):
            raise UsageError(
                f"--states {', '.join(texts)}: these states do not determine the motion: the rate of {text} depends on "
                f"others\nhint: all of it has {S.shape[1]} states; without --states the program chooses them"
            )


def _require_told(rows: Array, told: Array, outputs: Sequence[Quantity], texts: Sequence[str]) -> None:
    """Refuse outputs that the states do not determine."""
    for row, other, output in zip(rows, told, outputs, strict=True):
        if np.max(np.abs(row - other), initial=0.0) > TOLERANCES.steady_signal * np.max(np.abs(row), initial=0.0):
            message = f"the states {', '.join(texts)} do not determine this output"
            raise _refuse(output.location, output.path, message, "add states, or leave out --states")


def _maps(ports: _Ports, S: Array, inverse: Array, error: Array) -> tuple[tuple[str, ...], Array, Array]:
    """Return the coordinates that the states determine, and the maps to them and their rates."""
    n_f = len(ports.space.A)
    q, u = ports.maps["q"][:, :n_f], ports.maps["u"][:, :n_f]
    both = np.stack([q, u], axis=1)
    missed, size = (np.max(np.abs(x), axis=(1, 2), initial=0.0) for x in (both @ inverse @ S - both, both))
    known = np.flatnonzero(missed <= TOLERANCES.steady_signal * size)
    to_coordinates, to_rates = (_product(x[known], inverse, error=error) for x in (q, u))
    return tuple(ports.linear.names[i] for i in known), to_coordinates, to_rates


def _descriptor(ports: _Ports, used: Sequence[tuple[int, int]]) -> Descriptor:
    linear, n, c, m = ports.linear, ports.system.n_q, len(ports.linear.J), ports.m
    A, E = linear.pencil()
    B = np.zeros((2 * n + c, m))
    B[n : 2 * n], B[2 * n :] = -ports.f, ports.rows
    outputs = list(ports.system.scene.model.outputs.values())
    slopes = [ports.slope(x) for x in outputs]
    widths = (n, n, n, c, 3 * m)
    q, u, a, nu, by_w = (np.array([x[k] for x in slopes]).reshape(len(slopes), width) for k, width in enumerate(widths))
    C = np.hstack([q, nu, u])
    names = linear.names
    variables = [*names, *(f"ν {row.name}: {row.label}" for row in linear.rows), *(f"rate({x})" for x in names)]
    if np.any(a):
        # u̇ = Δa and 0 = −M Δa − … in the place of M u̇ = −…
        size = 3 * n + c
        whole_A, whole_E, whole_B = np.zeros((size, size)), np.zeros((size, size)), np.zeros((size, m))
        whole_A[: 2 * n + c, : 2 * n + c], whole_E[:n, :n] = A, E[:n, :n]
        whole_A[n : 2 * n, 2 * n + c :] = -linear.M
        whole_E[2 * n + c :, n + c : 2 * n + c] = np.eye(n)
        whole_A[2 * n + c :, 2 * n + c :] = np.eye(n)
        whole_B[: 2 * n + c] = B
        A, E, B, C = whole_A, whole_E, whole_B, np.hstack([C, a])
        variables += [f"acceleration({x})" for x in names]
    D = _columns(np.split(by_w, 3, axis=1), used)
    return Descriptor(E, A, B, C, D, tuple(variables))
