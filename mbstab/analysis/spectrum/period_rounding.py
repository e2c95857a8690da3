"""What the rounding of the numbers of a file makes of the map of small disturbances over a period.

With the errors δa of accelerations and those of the neighbours, δΔa, to first order

    δΦ = ∫ Φ(T, t) [0; δΔa(t)] dt,   δx(t) = ∫ Φ(t, τ) [0; δa(τ)] dτ,

where δΔa contains the change of the coefficients by δx. The errors at each instant are bounds (running error analysis,
as in `mbstab.analysis.linear.roundings`); the integrals are sums over some instants, between which coefficients are
taken as constant for Φ, so that the result is an estimate of a bound.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from mbstab.analysis.algebra.rounded import UNIT, value_and_error
from mbstab.analysis.reference.rounded_scene import errors_of, rounded_system, with_errors
from mbstab.analysis.spectrum.flow import Flow, Instant
from mbstab.analysis.spectrum.tolerances import TOLERANCES
from mbstab.compiler.system import Array


class _Place(NamedTuple):
    """An instant of the period: its equations, the motion and its neighbours there, and its weight in an integral."""

    now: Instant
    x: Array
    weight: float


class _Errors(NamedTuple):
    """The errors of the motion at an instant.

    Its state with errors and the time; those of M and J; in scaled coordinates those of the forces that accelerations
    and multipliers balance, and of the accelerations.
    """

    at: tuple[list[Any], list[Any], float]
    M: Array
    J: Array
    force: Array
    moved: Array


def error_of_data(flow: Flow, parts: Array, states: Array) -> float:
    """Return the error of the monodromy matrix in the spectral norm.

    Parameters
    ----------
    flow : Flow
    parts : ndarray, shape (n_t,)
        Instants as fractions of the period.
    states : ndarray, shape (n_t, 2, n_q, 1 + n_f)
        The motion and its neighbours there.
    """
    # Evenly by their number: where steps are short, coefficients change fast.
    chosen = np.unique(np.linspace(0, len(parts) - 1, TOLERANCES.instants_rounded).round().astype(int))
    at, ends = parts[chosen], np.concatenate([[0.0], 0.5 * (parts[chosen][1:] + parts[chosen][:-1]), [1.0]])
    places = [
        _Place(flow.at(states[i, :, :, 0], float(part)), states[i], float(weight))
        for i, part, weight in zip(chosen.tolist(), at, np.diff(ends), strict=True)
    ]
    with np.errstate(all="ignore"):
        total = _summed(flow, places, _steps(places, np.diff(at)))
    return float(np.linalg.norm(total, 2)) if np.isfinite(total).all() else np.inf


def _summed(flow: Flow, places: list[_Place], steps: list[Array]) -> Array:
    """Return the errors of the entries of the monodromy matrix."""
    scene, dual = _Scene(flow), np.hstack([flow.dual[0], flow.dual[1]])
    motion = scene.motion_errors(places, steps)
    n, total, after = len(flow.scale), np.zeros((len(dual), len(dual))), np.eye(dual.shape[1])
    for k in reversed(range(len(places))):
        total += places[k].weight * (np.abs(dual @ after)[:, n:] @ scene.neighbour_errors(places[k], motion[k]))
        after = after @ steps[k - 1] if k else after
    return total


def _steps(places: list[_Place], lengths: Array) -> list[Array]:
    """Return the maps of neighbours from each place to the next one, in scaled coordinates."""
    from scipy.linalg import expm

    rates = []
    for place in places:
        dq, du = np.split(np.eye(2 * len(place.now.M)), 2)
        rates.append(np.vstack([du, place.now.neighbours(dq, du)[0]]))
    return [expm(0.5 * h * (a + b)) for h, a, b in zip(lengths.tolist(), rates, rates[1:], strict=False)]


class _Scene:
    """The scene of a flow with error bounds of its numbers."""

    def __init__(self, flow: Flow) -> None:
        self.flow, self.system = flow, rounded_system(flow.system)
        self.scale, self.row_scale, self.period = flow.scale, flow.row_scale, flow.period

    def motion_errors(self, places: list[_Place], steps: list[Array]) -> list[Array]:
        """Return the errors of the motion at places, scaled as neighbours, shape (2, n_q) each."""
        n = len(self.scale)
        sources = [np.diag(self._start())]
        found: list[Array] = []
        for k, place in enumerate(places):
            if k:
                sources = [steps[k - 1] @ x for x in sources]
            total = np.sum([np.sum(np.abs(x), axis=1) for x in sources], axis=0)
            found.append(total.reshape(2, n))
            drive = np.zeros((2 * n, n))
            drive[n:] = np.diag(place.weight * self.period**2 * self._evaluated(place, np.zeros((2, n))).moved)
            sources.append(drive)
        return found

    def _start(self) -> Array:
        """Return the errors of the given state at the start."""
        motion, scene = self.flow.motion, self.system.scene
        errors = []
        for given, x in ((scene.coordinates, motion.q), (scene.rates, motion.u)):
            own = [value_and_error(given[name])[1] if name in given else 0.0 for name in self.flow.system.names]
            errors.append(np.array(own) + UNIT * np.abs(x))
        return np.concatenate([errors[0] / self.scale, errors[1] * self.period / self.scale])

    def _evaluated(self, place: _Place, spread: Array) -> _Errors:
        """Return the errors of the motion at a place, which is itself known to a spread."""
        now, sizes, own = place.now, self.flow.sizes, place.x[:, :, 0]
        q, u = own[0] * sizes, own[1] * sizes / self.period
        q, u = (
            with_errors(x, known * self.scale + UNIT * np.abs(x))
            for x, known in ((q, spread[0]), (u, spread[1] / self.period))
        )
        time = self.flow.motion.time + now.part * self.period
        state = self.system.dynamics(q, u, time)
        M, J, F0, B = (errors_of(x) for x in (state.M, state.J, state.F0, state.B))
        force = (F0 + M @ np.abs(now.a) + J.T @ np.abs(now.nu)) * self.scale
        moved = self._moved(now, force, (B + J @ np.abs(now.a)) * self.row_scale)
        return _Errors((q, u, time), M, J, force, moved)

    def _moved(self, now: Instant, force: Array, bias: Array) -> Array:
        """Return sizes of accelerations by forces and rows of given sizes."""
        across = np.abs(now.augmented.inverse) @ bias
        result: Array = np.abs(now.augmented.mobility) @ (force + np.abs(now.M) @ across) + across
        return result

    def neighbour_errors(self, place: _Place, spread: Array) -> Array:
        """Return the errors of the accelerations of the neighbours, shape (n_q, n_f)."""
        now, scale, period, errors = place.now, self.scale, self.period, self._evaluated(place, spread)
        forces = errors.force + np.abs(now.M) @ errors.moved
        dnu = (np.abs(now.augmented.inverse).T @ forces) * self.row_scale
        a = with_errors(now.a, errors.moved * scale + UNIT * np.abs(now.a))
        nu = with_errors(now.nu, dnu + UNIT * np.abs(now.nu))
        q, u, time = errors.at
        K, R, _ = (errors_of(x) for x in self.system.linearize(q, u, a, nu, time))
        _, A_q, A_u = (errors_of(x) for x in self.system.linearize_rows(q, u, a, time))
        dq, du = place.x[:, :, 1:]
        x, v, acc, reactions = (np.abs(y) for y in (dq, du, *now.neighbours(dq, du)))
        both, rows = scale * scale[:, None], scale * self.row_scale[:, None]
        J = errors.J * rows
        force = (K * both * period**2) @ x + (R * both * period) @ v + (errors.M * both) @ acc + J.T @ reactions
        return self._moved(now, force, (A_q * rows * period**2) @ x + (A_u * rows * period) @ v + J @ acc)
