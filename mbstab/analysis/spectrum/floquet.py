"""Floquet theory of a periodic motion: the map of small disturbances over one period.

A motion with accelerations and multipliers

    M a + Jᵀ ν = −F0,   J a = −B

has neighbours Δq, Δu = Δq̇ that satisfy the equations linearized along it,

    M Δa + Jᵀ Δν = −(R Δu + K Δq),   J Δa = −(A_q Δq + A_u Δu),
    C_q Δq = 0,   V_q Δq + J Δu = 0,

whose coefficients are periodic if the motion is. The last line holds at all times if it
holds initially. With N and Z of `mbstab.analysis.algebra.subspaces` at the start of the period and

    Δq = N ξ,   Δu = N Z η − J⁺ V_q N ξ,   y = [ξ; T η],

y(T) = Φ y(0): the eigenvalues of the monodromy matrix Φ are the multipliers μ, and
log(μ)/T the exponents (Floquet 1883; Yakubovich and Starzhinskii 1975, chapter II). Where
the coefficients are constant Φ = exp(A T), with A of `mbstab.analysis.linear.linearize` for the
speeds T η.

Motion and neighbours are integrated together, in accelerations (index 1), by the method of
Dormand and Prince of order 8 (Hairer, Nørsett, Wanner 1993, section II.10). Over one period
the drift off the constraints is of the size of the integration error; it is measured.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from mbstab.analysis.algebra.failures import guarded
from mbstab.analysis.algebra.tolerances import EPS
from mbstab.analysis.reference.motion import Motion
from mbstab.analysis.spectrum.flow import Flow, Instant, norm
from mbstab.analysis.spectrum.period_rounding import error_of_data
from mbstab.analysis.spectrum.time_features import short_steps
from mbstab.analysis.spectrum.tolerances import TOLERANCES
from mbstab.compiler.system import Array, System
from mbstab.errors import ConstraintError, ModelFileError, NumericalError, UsageError
from mbstab.model.schema import is_angle
from mbstab.model.units import per_second
from mbstab.records import dataclass

FIX = (
    "give the period after which everything repeats, a whole multiple of the periods of all given functions of time, "
    "and a reference on the periodic motion itself"
)


@dataclass(frozen=True)
class Monodromy:
    """The map of small disturbances over a period.

    Attributes
    ----------
    Phi : ndarray, shape (n_f, n_f)
        The monodromy matrix, y(T) = Phi @ y(0); its eigenvalues are the multipliers.
    error : float
        Estimate of its error in the spectral norm: the difference of two tolerances, the part outside
        the basis, and rounding, that of the numbers of the file included.
    period : float (s)
    n_xi : int
        The first n_xi components of y are positions, the others speeds times the period.
    to_coordinates, to_rates : ndarray, shape (n_q, n_f)
        Δq = to_coordinates @ y, Δu = to_rates @ y, at the start of the period.
    to_components : ndarray, shape (n_f, 2 n_q)
        The way back, y = to_components @ [Δq; Δu], for disturbances that the constraints allow:
        (u, a) of a motion without given functions of time is one, with the multiplier 1.
    advance : ndarray, shape (n_q,)
        q(T) − q(0): whole turns, or a shift on which nothing depends.
    drift : float
        Largest violation of the constraints, relative to the sizes in the scene.
    mismatch : float
        Difference of speeds and coefficients after the period, relative to their largest values.
    times, path : ndarray, shape (n_t,) and (n_t, 2, n_q)
        The motion at the steps of the integration (s): coordinates and speeds.
    evaluations : int
        Number of evaluations of the equations of motion.
    """

    Phi: Array
    error: float
    period: float
    n_xi: int
    to_coordinates: Array
    to_rates: Array
    to_components: Array
    advance: Array
    drift: float
    mismatch: float
    times: Array
    path: Array
    evaluations: int


@guarded
def monodromy(
    system: System, motion: Motion, period: float, progress: Callable[[float], object] | None = None
) -> Monodromy:
    """Return the monodromy matrix of a periodic motion.

    Parameters
    ----------
    system : System
    motion : Motion
        The motion at the start of the period.
    period : float
        The period T (s), or any multiple of it.
    progress : callable, optional
        Called with the fraction of the work that is done, from 0 to 1.

    Raises
    ------
    UsageError
        If the period is not a positive number.
    ModelFileError
        If the motion does not have this period; names the coordinate that differs most.
    ConstraintError
        If the constraints lose rank on the way.
    NumericalError
        If the motion cannot be followed over the period.
    """
    if not (math.isfinite(period) and period > 0.0):
        raise UsageError(f"the period must be a positive number of seconds, not {period:g}")
    flow = Flow(system, motion, period)
    ends, fastest, evaluations = [], 0.0, 0
    for number, accuracy in enumerate(zip(TOLERANCES.monodromy_tolerances, TOLERANCES.monodromy_steps, strict=True)):
        told = _part(progress, number, len(TOLERANCES.monodromy_tolerances))
        parts, states, count = _integrate(flow, *accuracy, told)
        if not number and flow.looked_along(parts, states, accuracy[1]):
            parts, states, more = _integrate(flow, *accuracy, told)
            count += more
        ends.append(states[-1])
        fastest = float(np.max(np.abs(states[:, 1, :, 0])))
        evaluations += count
    (rough, _), (Phi, rest) = (flow.components(end) for end in ends)
    end = ends[-1]
    size = max(1.0, norm(Phi))
    mismatch = _check_periodic(flow, end, fastest, 10.0 * TOLERANCES.monodromy_tolerances[-1] * size)
    scale, units = flow.scale, np.stack([flow.sizes, flow.sizes / period])
    return Monodromy(
        Phi=Phi,
        error=norm(Phi - rough) + rest + TOLERANCES.monodromy_rounding * size + error_of_data(flow, parts, states),
        period=period,
        n_xi=motion.spaces.N.shape[1],
        to_coordinates=scale[:, None] * flow.basis[0],
        to_rates=scale[:, None] * flow.basis[1] / period,
        to_components=np.hstack([flow.dual[0] / scale, flow.dual[1] * period / scale]),
        advance=(end - flow.begin)[0, :, 0] * flow.sizes,
        drift=_drift(flow, end),
        mismatch=mismatch,
        times=motion.time + period * parts,
        path=states[:, :, :, 0] * units,
        evaluations=evaluations,
    )


def _integrate(
    flow: Flow, tolerance: float, longest: float, progress: Callable[[float], object]
) -> tuple[Array, Array, int]:
    """Return all steps through a period, as fractions of it, the states there, and the number of evaluations."""
    from scipy.integrate import DOP853

    done, evaluations = 0.0, 0

    def slope(part: float, x: Array) -> Array:
        nonlocal done, evaluations
        evaluations += 1
        if evaluations > TOLERANCES.monodromy_evaluations:
            raise NumericalError(
                f"the motion needs more than {TOLERANCES.monodromy_evaluations} evaluations: {part:.2%} of the period "
                "was done\n"
                "hint: motions much faster than the period, strong dampers and Euler angles near theta = ±pi/2 need "
                "small steps; give the least period, or another base rotation"
            )
        neighbours = x.reshape(flow.begin.shape)[:, :, 1:]
        if (growth := float(np.max(np.abs(neighbours), initial=0.0))) > TOLERANCES.monodromy_growth:
            raise NumericalError(
                f"disturbances grow by a factor {growth:.1e} in {part * flow.period:.6g} s, which should be below "
                f"{TOLERANCES.monodromy_growth:g}: what rounding makes of them and of the motion is not small any "
                "more\n"
                "hint: give the least period; if it is that, disturbances leave the motion so far on the way, whether "
                "or not they come back by its end"
            )
        if part > done + 0.01:
            done = part
            progress(done)
        try:
            return flow.slope(part, x.reshape(flow.begin.shape)).ravel()
        except (ConstraintError, NumericalError) as error:
            time = flow.motion.time + part * flow.period
            raise type(error)(f"the motion cannot be followed beyond t = {time:.6g} s: {error}") from None

    solver: Any = DOP853(slope, 0.0, flow.begin.ravel(), 1.0, rtol=tolerance, atol=tolerance, max_step=longest)
    parts, states = [solver.t], [solver.y]
    places = [*short_steps(*flow.variation, longest).tolist(), math.inf]
    while solver.status == "running":
        while places[0] <= solver.t + 2.0 * EPS:
            del places[0]
        solver.max_step = min(longest, places[0] - solver.t)
        message = solver.step()
        if message:
            raise NumericalError(
                f"the motion cannot be followed beyond t = {flow.motion.time + solver.t * flow.period:.6g} s: "
                f"{message[:1].lower()}{message[1:].rstrip('.')}\n"
                "hint: look for a jump in a given function of time, or an expression at a kink"
            )
        parts.append(solver.t)
        states.append(solver.y)
    progress(1.0)
    return np.array(parts), np.array(states).reshape(-1, *flow.begin.shape), evaluations


def _part(progress: Callable[[float], object] | None, number: int, count: int) -> Callable[[float], object]:
    """Return the progress function of one of several equal parts of the work."""
    return lambda done: progress((number + done) / count) if progress else None


def _drift(flow: Flow, x: Array) -> float:
    """Return the largest residual of a row, relative to its change by the characteristic sizes of the coordinates."""
    state = flow.at(x[:, :, 0], 1.0).state
    sizes = np.abs(state.J) @ flow.sizes
    residuals = np.abs(state.V) * flow.period
    residuals[: flow.system.n_h] += np.abs(state.E[: flow.system.n_h])
    return float(np.max(residuals / np.where(sizes > 0.0, sizes, 1.0), initial=0.0))


# --- does it repeat? ------------------------------------------------------------------------------------------------


def _check_periodic(flow: Flow, end: Array, fastest: float, rounding: float) -> float:
    """Return the difference of a motion after the period, and refuse it if it is more than rounding.

    Speeds, accelerations and the deflated coefficients are compared, not coordinates: these may have advanced by whole
    turns, or by a shift on which nothing depends.
    """
    sizes, period = flow.sizes, flow.period
    speeds = (end - flow.begin)[1, :, 0]
    allowed = TOLERANCES.periodicity * max(fastest, TOLERANCES.motion_in_period) + rounding
    if np.max(np.abs(speeds)) > allowed:
        raise _not_periodic(flow, speeds * sizes / period, "rate", 1)
    now, then = flow.at(flow.begin[:, :, 0], 0.0), flow.at(end[:, :, 0], 1.0)
    accelerations = (then.a - now.a) * period**2 / sizes
    largest = float(np.max(np.abs(now.a) * period**2 / sizes))
    if np.max(np.abs(accelerations)) > allowed + (TOLERANCES.periodicity + rounding) * largest:
        raise _not_periodic(flow, then.a - now.a, "acceleration", 2)
    if (worst := _change(flow, now, then)) > TOLERANCES.periodicity + rounding:
        advance = (end - flow.begin)[0, :, 0] * sizes
        angular = np.array([is_angle(name) for name in flow.system.names])
        advance[angular] -= 2.0 * math.pi * np.round(advance[angular] / (2.0 * math.pi))
        i = int(np.argmax(np.abs(advance / sizes)))
        moved = abs(advance[i] / sizes[i]) > TOLERANCES.periodicity + rounding
        reason = f"{flow.system.names[i]} differs by {advance[i]:.6g} {flow.system.units[i]}"
        message = f"small motions have other coefficients after {period:.6g} s, by {worst:.2g} of their size: "
        raise _problem(flow, message + (reason if moved else "given functions of time do not have this period"))
    return max(float(np.max(np.abs(speeds), initial=0.0)) / max(fastest, TOLERANCES.motion_in_period), worst)


def _change(flow: Flow, now: Instant, then: Instant) -> float:
    """Return the largest change of the deflated coefficients, relative to their size or to 1 per period."""
    spaces, n_h = flow.motion.spaces, flow.system.n_h
    N, Z = spaces.N, spaces.Z
    changes = [then.J[:n_h] @ N, then.J[n_h:] @ N @ Z, (then.follow - now.follow) @ N]
    worst = float(max(np.max(np.abs(x), initial=0.0) for x in changes))
    for A, B in ((now.M, then.M), (now.R, then.R), (now.K, then.K)):
        size = max(1.0, float(np.max(np.abs(A))))
        worst = max(worst, float(np.max(np.abs(N.T @ (B - A) @ N), initial=0.0)) / size)
    return worst


def _not_periodic(flow: Flow, difference: Array, what: str, order: int) -> ModelFileError:
    i = int(np.argmax(np.abs(difference) / flow.sizes))
    name = flow.system.names[i]
    unit = per_second(flow.system.units[i], order)
    message = f"the motion does not repeat after {flow.period:.6g} s: the {what} of {name} differs by"
    return _problem(flow, f"{message} {difference[i]:.6g} {unit}")


def _problem(flow: Flow, message: str) -> ModelFileError:
    model = flow.system.scene.model
    return ModelFileError([model.document.problem(model.reference.location, "reference", message, FIX)])
