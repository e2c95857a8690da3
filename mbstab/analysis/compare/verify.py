"""Eigenvalues against the nonlinear motion: each mode is excited slightly, and its growth and frequency are measured.

Two motions start at the reference plus and minus a small part of the mode; half of their
difference is free of quadratic terms. It is transformed to the co-moving frame (Δq = DΦ_t z, Δu = DΦ_t ż
+ DX DΦ_t z, as in `mbstab.analysis.reference.steady`), or sampled after whole periods of a periodic motion, and
projected with the left eigenvector w of the mode: c(t) = wᴴy(t) is exp(s t) where the
prediction s holds. The slope of log c gives the growth rate and the frequency that are
observed. Their uncertainty follows from the difference of the slopes of its two halves, its distance from a line,
and the errors of integration, which at worst add up.
Where this does not confirm the prediction it is repeated with smaller amplitudes, until two of them agree: the
linear range may be small. The reference itself need not be integrated. Neutral directions are tested as in
`mbstab.analysis.compare.neutral_drift`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from mbstab.analysis.algebra.arrays import Complex, least_squares, norms
from mbstab.analysis.algebra.matching import assigned
from mbstab.analysis.compare import neutral_drift
from mbstab.analysis.compare.neutral_drift import Drift
from mbstab.analysis.compare.tolerances import TOLERANCES
from mbstab.analysis.linear.linearize import Linearization, linearize, state_space
from mbstab.analysis.reference.motion import Finder, Motion
from mbstab.analysis.reference.requested import reference_motion
from mbstab.analysis.reference.tolerances import TOLERANCES as REFERENCE
from mbstab.analysis.simulate.balanced import balanced
from mbstab.analysis.simulate.constrained import Constrained
from mbstab.analysis.simulate.recording import states
from mbstab.analysis.simulate.run import Follower, Run
from mbstab.analysis.simulate.steppers.interface import Options
from mbstab.analysis.simulate.steppers.table import METHODS
from mbstab.analysis.spectrum.eigenvalues import answer
from mbstab.analysis.spectrum.floquet import monodromy
from mbstab.analysis.spectrum.results import EigenResult, Eigenvalue
from mbstab.analysis.verdict.facts import Grounds
from mbstab.analysis.verdict.many_digits import ManyDigits
from mbstab.analysis.verdict.rule import ASYMPTOTIC, ASYMPTOTIC_UP_TO, UNDECIDED, UNSTABLE
from mbstab.analysis.verdict.wording import show
from mbstab.compiler.form import Form
from mbstab.compiler.system import Array, System
from mbstab.errors import MbstabError, percent
from mbstab.records import Answer, dataclass


@dataclass(frozen=True)
class Observation:
    """One mode, predicted and observed.

    Attributes
    ----------
    number : int
        Number of the mode in ``mbstab eig``, from 1; a pair is one mode.
    predicted : complex (1/s)
        The eigenvalue, its imaginary part not negative.
    kind : str
    observed : complex (1/s)
        Growth rate and frequency of the nonlinear motion; nan where there is none.
    uncertainty : float (1/s)
        Their uncertainty: from the fit, the errors of integration and the difference of two amplitudes.
    span : float (s)
        Length of the motion.
    amplitude : float
        Largest amplitude of the mode in the last motion, relative to the sizes in the scene.
    verdict : str
        ``confirmed``, ``contradicted`` or ``cannot be judged``.
    reason : str
        Why it cannot be judged, or what contradicts.
    """

    number: int
    predicted: complex
    kind: str
    observed: complex
    uncertainty: float
    span: float
    amplitude: float
    verdict: str
    reason: str = ""

    @property
    def error(self) -> float:
        """|observed − predicted| relative to |predicted|; nan where nothing was observed."""
        return abs(self.observed - self.predicted) / abs(self.predicted) if self.predicted else math.nan


@dataclass(frozen=True)
class Verification(Answer):
    """Whether the nonlinear motion confirms a result.

    Attributes
    ----------
    result : EigenResult
        The result that is verified.
    modes : tuple of Observation
    verdict : str
        ``confirmed``, ``contradicted`` or ``cannot be judged``.
    reason : str
    evaluations : int
        How often the equations of motion were formed.
    neutral : Drift or None
        The motion along the neutral directions, if there are any.
    """

    result: EigenResult
    modes: tuple[Observation, ...]
    verdict: str
    reason: str
    evaluations: int
    neutral: Drift | None


@dataclass(frozen=True)
class _Frame:
    """The map from differences of two motions to components of the linearized equations.

    `matrix` is that of ẏ = A y, or of y(T) = Φ y(0) with `period`; `to_q`, `to_u` map y to Δq and Δu at the
    start, `components` maps Δq, Δu at a time to y.
    """

    matrix: Array
    to_q: Array
    to_u: Array
    components: Callable[[float, Array, Array], Array]
    period: float | None


def verify(
    system: System,
    frozen: bool = False,
    progress: Callable[[float], object] = lambda done: None,
    digits: ManyDigits | None = None,
) -> Verification:
    """Return whether the nonlinear motion confirms the eigenvalues.

    Parameters
    ----------
    system : System
    frozen : bool
        Judge the eigenvalues of the equations frozen at the reference time.
    progress : callable
        Called with the fraction of the work that is done, from 0 to 1.
    digits : ManyDigits, optional
        As for `mbstab.analysis.spectrum.eigenvalues.eigenvalues`.

    Raises
    ------
    MbstabError
        As `mbstab.analysis.spectrum.eigenvalues.answer`.
    """
    result = answer(system, frozen=frozen, digits=digits)
    modes = [e for e in result.eigenvalues if not e.exact and e.value.imag >= 0.0]
    motion = reference_motion(system, massless=True)
    frame = _frame(system, motion)
    # Unexplained zeros cannot be told from neutral eigenvalues: all of them are tested together. Those that are
    # known to a bound only are taken as 0; the others are known exactly by structure.
    still = [e for e in result.eigenvalues if e.exact or _zero(e)]
    exact = [e.value if math.isnan(e.error_bound) else 0j for e in still]
    count = len(exact)
    if isinstance(frame, str):
        observations = [_unjudged(k, e, frame) for k, e in enumerate(modes, 1)]
        return Verification(
            result,
            tuple(observations),
            "cannot be judged",
            frame,
            0,
            neutral_drift.untried(count, frame) if count else None,
        )
    excited = _Excited(*balanced(system, motion), frame)
    partners = excited.partners([e.value for e in modes])
    observations = []
    for number, (mode, partner) in enumerate(zip(modes, partners, strict=True), 1):
        observations.append(excited.observed(number, mode, partner))
        progress(number / (len(modes) + bool(count)))
    neutral = excited.neutral(exact) if exact else None
    if neutral is not None and neutral.verdict == "contradicted" and any(map(_zero, still)):
        reason = f"zeros that nothing explains cannot be distinguished from slow motions: {neutral.reason}"
        neutral = replace(neutral, verdict="cannot be judged", reason=reason)
    progress(1.0)
    verdict, reason = _overall(result, observations, neutral)
    return Verification(result, tuple(observations), verdict, reason, excited.evaluations, neutral)


def _zero(mode: Eigenvalue) -> bool:
    """Return whether an eigenvalue cannot be told from zero."""
    return mode.kind == "undecided" and abs(mode.value) <= mode.error_bound


def _frame(system: System, motion: Motion) -> _Frame | str:
    """Return the frame in which the linearized equations are constant, or why there is none."""
    if system.scene.period is not None:
        around = monodromy(system, motion, float(system.scene.period))
        back = around.to_components
        return _Frame(
            around.Phi, around.to_coordinates, around.to_rates,
            lambda t, dq, du: np.asarray(back @ np.concatenate([dq, du])), around.period,
        )  # fmt: skip
    linear = linearize(system, motion)
    if not linear.constant:
        size = f" by {percent(linear.variation)}" if math.isfinite(linear.variation) else " without bound"
        least = (
            f", where {percent(REFERENCE.variation_along_motion)} counts as constant"
            if linear.variation < REFERENCE.variation_told
            else ""
        )
        return (
            "the motion is neither steady nor declared as periodic: the coefficients of its linearized equations "
            f"change{size} along it{least}"
        )
    return Grounds(linear).kink(1) or _steady_frame(linear, motion)


def _steady_frame(linear: Linearization, motion: Motion) -> _Frame:
    space = state_space(linear)
    generator = linear.generator if linear.generator is not None and linear.generator.turns else None
    to_u = space.to_rates
    rows = 1.0 / np.concatenate([motion.sizes, motion.sizes * space.rate])
    matrix = np.vstack([space.to_coordinates, to_u]) * rows[:, None]
    lengths = np.linalg.norm(matrix, axis=0)
    inverse = np.linalg.pinv(matrix / lengths) * rows / lengths[:, None]

    def components(t: float, dq: Array, du: Array) -> Array:
        if generator is not None:
            q, T = generator.flow(motion.q, t - motion.time)
            dq, du = np.linalg.solve(T, np.stack([dq, du - generator.frame(q)[0] @ dq], axis=1)).T
        return np.asarray(inverse @ np.concatenate([dq, du]))

    if generator is not None:
        to_u = to_u + generator.frame(motion.q)[0] @ space.to_coordinates
    return _Frame(space.A, space.to_coordinates, to_u, components, None)


class _Excited:
    """The modes of a motion, and runs that start in one of them."""

    def __init__(self, system: System, motion: Motion, frame: _Frame) -> None:
        self.system, self.motion, self.frame = system, motion, frame
        self.form = Form(system)
        self.finder = Finder(system)
        self.evaluations = 0
        self.speed = float(np.max(np.abs(motion.u / motion.sizes), initial=0.0))
        pulled = math.sqrt(float(np.max(np.abs(motion.a / motion.sizes), initial=0.0)))
        falling = math.sqrt(math.hypot(*map(float, system.scene.gravity)) / float(np.max(motion.sizes)))
        self.pace = max(pulled, falling) or 1.0
        n, n_f = len(motion.q), len(frame.matrix)
        self.values, self.right, self.left = np.zeros(0, complex), np.zeros((n, 0)), np.zeros((n, 0))
        self.weights = np.ones(n_f)
        if n_f:
            self._decompose()

    def _decompose(self) -> None:
        """Find eigenvalues (1/s), right and left vectors; for multiple eigenvalues those that belong together."""
        from scipy.linalg import eig

        frame, motion = self.frame, self.motion
        self.weights = weights = 1.0 / norms(np.vstack([frame.to_q, frame.to_u]) / np.tile(motion.sizes, 2)[:, None], 0)
        values, left, right = eig(frame.matrix * weights / weights[:, None], left=True)
        self.multipliers = values
        rates = values if frame.period is None else np.log(values.astype(complex) + 0j) / frame.period
        for i, s in enumerate(rates):
            group = np.flatnonzero(np.abs(rates - s) <= TOLERANCES.equal_eigenvalues * abs(s))
            if len(group) > 1 and group[0] == i:
                product = right[:, group].conj().T @ left[:, group]
                # The vectors have length 1.
                if np.linalg.svd(product, compute_uv=False)[-1] > 1.0 / TOLERANCES.defective_overlap:
                    left[:, group] = left[:, group] @ np.linalg.inv(product)
        self.values, self.right, self.left = rates, right * weights[:, None], left / weights[:, None]

    def partners(self, predicted: list[complex]) -> list[int]:
        """Return for each predicted eigenvalue which mode of the motion it belongs to."""
        found = np.flatnonzero(self.values.imag >= 0.0)
        size = max(len(found), len(predicted))
        cost = np.zeros((size, size))
        for i, s in enumerate(predicted):
            cost[i, : len(found)] = np.abs(self.values[found] - s)
            cost[i, len(found) :] = 2.0 * np.max(np.abs(self.values), initial=1.0)
        columns = assigned(cost)
        return [int(found[columns[i]]) if columns[i] < len(found) else -1 for i in range(len(predicted))]

    def observed(self, number: int, mode: Eigenvalue, k: int) -> Observation:
        """Return the observed motion after a start in mode `k`."""
        if k < 0:
            return _unjudged(number, mode, "the motion has no mode that belongs to it")
        s, v, w = complex(self.values[k]), self.right[:, k], self.left[:, k]
        if not s or _zero(mode):
            return _unjudged(number, mode, "it is zero, and has neither growth nor frequency to be measured")
        overlap = complex(np.vdot(w, v))
        # Both have length 1 in components of y of equal size.
        if abs(overlap) * TOLERANCES.defective_overlap < 1.0:
            return _unjudged(number, mode, "it is one of several equal eigenvalues without modes of their own")
        times = self._times(s)
        span = float(times[-1] - times[0])
        found: list[Observation] = []
        for repeat in range(TOLERANCES.amplitude_repeats + 1):
            amplitude = TOLERANCES.mode_amplitude * TOLERANCES.amplitude_reduction**repeat
            seen = self._seen(times, k, overlap, amplitude)
            if isinstance(seen, str):
                return _unjudged(number, mode, seen) if not found else _undecided(found[-1], found, seen)
            c, noise = seen
            found.append(_fitted(number, mode, s, times - times[0], c, amplitude, noise / span))
            if math.isnan(found[-1].uncertainty):
                return found[-1]
            if (judged := _judged(found)) is not None:
                return judged
            if len(found) > 1 and found[-1].uncertainty > found[-2].uncertainty and all(map(_possible, found[-2:])):
                # The uncertainty is due to rounding, not to the amplitude.
                return _undecided(found[-2], found[-2:-1], "")
        return _undecided(found[-1], found, "")

    def _seen(self, times: Array, k: int, overlap: complex, amplitude: float) -> tuple[Complex, float] | str:
        """Return the amplitude of mode `k` over time, relative to its start, and its possible relative error."""
        s, v, w = complex(self.values[k]), self.right[:, k], self.left[:, k]
        growth = math.exp(max(s.real, 0.0) * float(times[-1] - times[0]))
        y = np.real(v) if abs(s.imag) <= TOLERANCES.equal_eigenvalues * abs(s) else 2.0 * np.real(v)
        dq, du = self.frame.to_q @ y, self.frame.to_u @ y
        sizes, rate = self.motion.sizes, max(abs(s), self.speed)
        extent = max(
            float(np.max(np.abs(self.frame.to_q @ v / sizes))),
            float(np.max(np.abs(self.frame.to_u @ v / sizes))) / rate,
        )
        size = amplitude / (growth * extent)
        tol = max(TOLERANCES.step_tolerance * amplitude / TOLERANCES.mode_amplitude, TOLERANCES.step_tolerance_least)
        runs = []
        for sign in (1.0, -1.0):
            run = self._followed(times, sign * size * dq, sign * size * du, s, tol)
            if isinstance(run, str):
                return run
            runs.append(run)
        (q, u), (q_less, u_less) = (states(run.stretches) for run in runs)
        c = np.array(
            [
                np.vdot(w, self.frame.components(t, x, v)) / (overlap * size)
                for t, x, v in zip(times, 0.5 * (q - q_less), 0.5 * (u - u_less), strict=True)
            ]
        )
        return c, runs[0].steps * tol / amplitude

    def neutral(self, exact: list[complex]) -> Drift:
        """Return the observed motion after a start along the neutral directions."""
        frame, weights = self.frame, self.weights
        matrix = frame.matrix * weights / weights[:, None]
        if frame.period is None:
            return neutral_drift.observed(
                matrix, exact, self._neutral_span(len(exact)), neutral_drift.flow, self._displaced
            )
        multipliers = [complex(np.exp(s * frame.period)) for s in exact]
        return neutral_drift.observed(
            matrix, multipliers, TOLERANCES.periodic_rounds * frame.period, neutral_drift.powers, self._displaced
        )

    def _neutral_span(self, count: int) -> float:
        """Return the length of motions along neutral directions (s)."""
        sizes = np.sort(np.abs(self.values))
        fastest = max(float(sizes[-1]), self.speed, self.pace)
        moving = sizes[count:][sizes[count:] > TOLERANCES.equal_eigenvalues * fastest]
        slowest = float(moving[0]) if len(moving) else self.speed or self.pace
        grown = float(np.max(self.values.real))
        spans = [TOLERANCES.run_periods * 2.0 * math.pi / slowest, TOLERANCES.run_fastest_times / fastest]
        return min([*spans, TOLERANCES.run_growths / grown] if grown > TOLERANCES.eigenvalue_error * fastest else spans)

    def _displaced(self, y0: Array, span: float, part: float) -> tuple[Array, Array] | str:
        """Return times since the start (s), and the difference of a motion with a displaced start, shape (n_t, n)."""
        frame, start, sizes = self.frame, self.motion.time, self.motion.sizes
        count = TOLERANCES.neutral_samples if frame.period is None else TOLERANCES.periodic_rounds + 1
        times = np.asarray(np.linspace(start, start + span, count), dtype=np.float64)
        y = self.weights * y0
        dq, du = frame.to_q @ y, frame.to_u @ y
        rate = max(self.speed, self.pace)
        # A drift must not leave the linear range within the span.
        extent = float(np.max(np.abs(dq / sizes))) + float(np.max(np.abs(du / sizes))) * max(1.0 / rate, span)
        size = part * TOLERANCES.mode_amplitude / extent
        tol = max(TOLERANCES.step_tolerance * part, TOLERANCES.step_tolerance_least)
        runs = []
        for sign in (1.0, -1.0):
            run = self._followed(times, sign * size * dq, sign * size * du, complex(rate), tol)
            if isinstance(run, str):
                return run
            runs.append(run)
        (q, u), (q_less, u_less) = (states(run.stretches) for run in runs)
        differences = zip(times.tolist(), 0.5 * (q - q_less), 0.5 * (u - u_less), strict=True)
        found = [frame.components(t, dq, du) / (size * self.weights) for t, dq, du in differences]
        return times - start, np.array(found)

    def _times(self, s: complex) -> Array:
        """Return the times of output for a mode with the eigenvalue s (s)."""
        start, period = self.motion.time, self.frame.period
        if period is not None:
            return np.asarray(start + period * np.arange(TOLERANCES.periodic_rounds + 1), dtype=np.float64)
        spans = [TOLERANCES.run_periods * 2.0 * math.pi / abs(s)]
        spans += [(TOLERANCES.run_growths if s.real > 0.0 else TOLERANCES.run_decays) / abs(s.real)] if s.real else []
        spans.append(TOLERANCES.run_fastest_times / max(float(np.max(np.abs(self.values.imag))), self.speed, abs(s)))
        fastest = float(np.max(self.values.real))
        spans += [TOLERANCES.run_fastest_growths / fastest] if fastest > 0.0 else []
        return np.asarray(np.linspace(start, start + min(spans), TOLERANCES.run_samples), dtype=np.float64)

    def _followed(self, times: Array, dq: Array, du: Array, s: complex, tol: float) -> Run | str:
        """Return the motion from a disturbed start, or why there is none."""
        motion, system = self.motion, self.system
        start, span = float(times[0]), float(times[-1] - times[0])
        stiff = float(np.max(-self.values.real)) * span > TOLERANCES.stiff_decay
        solver = "Radau" if stiff else "DOP853"
        try:
            equations = Constrained(system, motion, self.form)
            q, u, _ = equations.project(start, motion.q + dq, motion.u + du)
            follower = Follower(system, self.finder.motion(q, u, start), times, self.form, work=False)
        except MbstabError as error:
            return f"the disturbed start: {error}"
        method, rate = METHODS["projection"][solver], max(abs(s), self.speed, 1.0 / span)
        run = follower.run(Options(method, 1e3 * tol if stiff else tol, None, None, rate), lambda done: None)
        self.evaluations += run.evaluations + equations.evaluations
        if run.interrupted:
            raise KeyboardInterrupt
        follower.settle(run)
        return run if run.complete else f"the simulation ends early: {run.failure}".partition("\n")[0]


def _unjudged(number: int, mode: Eigenvalue, reason: str) -> Observation:
    nan = math.nan
    return Observation(number, mode.value, mode.kind, complex(nan, nan), nan, nan, nan, "cannot be judged", reason)


def _fitted(
    number: int, mode: Eigenvalue, s: complex, times: Array, c: Complex, amplitude: float, noise: float
) -> Observation:
    """Return the observed eigenvalue: the slope of the logarithm of the amplitude of a mode."""
    span = float(times[-1])
    if not np.all(np.abs(c) > 0.0):
        return _unjudged(number, mode, "its part of the motion vanishes")
    # Divided by the prediction, the rest turns slowly: there is no ambiguity of whole turns.
    rest = c * np.exp(-s * times)
    logs = np.log(np.abs(rest)) + 1j * np.unwrap(np.angle(rest))
    weights = np.abs(c) / np.max(np.abs(c))
    slope, off = _line(times, logs, weights)
    half = len(times) // 2 + 1
    halves = (
        _line(times[:half], logs[:half], weights[:half])[0],
        _line(times[-half:], logs[-half:], weights[-half:])[0],
    )
    observed = s + slope
    if mode.value.imag == 0.0 and abs(s.imag) <= TOLERANCES.equal_eigenvalues * abs(s):
        observed = complex(observed.real)
    # A smooth change of the slope shows in the two halves, noise in the distance from the line.
    uncertainty = 0.5 * abs(halves[0] - halves[1]) + off / span + noise
    return Observation(number, mode.value, mode.kind, observed, uncertainty, span, amplitude, "confirmed")


def _judged(found: list[Observation]) -> Observation | None:
    """Return the verdict on a mode from observations with decreasing amplitudes; None if one more is needed."""
    last, size, apart = found[-1], abs(found[-1].predicted), 0.0
    if len(found) > 1:
        before = found[-2]
        apart = abs(last.observed - before.observed)
        blur = last.uncertainty + before.uncertainty
        last = replace(last, uncertainty=last.uncertainty + apart)
        if blur > TOLERANCES.eigenvalue_error * size or apart > TOLERANCES.eigenvalue_error * size:
            return None
    off = last.observed - last.predicted
    known, worst = last.uncertainty, max(abs(off.real), abs(off.imag))
    if known <= TOLERANCES.eigenvalue_error * size and worst <= TOLERANCES.uncertainties_of_observation * known:
        if (
            last.kind not in ("center", "undecided")
            and abs(last.predicted.real) <= TOLERANCES.uncertainties_of_observation * known
        ):
            what = "growth" if last.predicted.real > 0.0 else "decay"
            first = "frequency confirmed; " if last.predicted.imag else ""
            reason = f"{first}{what} too small to be seen in {last.span:.3g} s (known to {known:.1e} 1/s)"
            return replace(last, verdict="cannot be judged", reason=reason)
        return last
    # A deviation must agree relative to itself: friction at its limit hardly damps.
    if len(found) == 1 or apart > TOLERANCES.eigenvalue_error * abs(last.observed):
        return None
    if abs(off) > max(TOLERANCES.eigenvalue_error * size, TOLERANCES.uncertainties_of_observation * known):
        reason = f"the motion has {show(last.observed)} 1/s, known to {known:.1e} 1/s"
        return replace(last, verdict="contradicted", reason=reason)
    return None


def _possible(x: Observation) -> bool:
    """Return whether an observation is consistent with the prediction."""
    return abs(x.observed - x.predicted) <= TOLERANCES.uncertainties_of_observation * x.uncertainty


def _undecided(last: Observation, found: list[Observation], failure: str) -> Observation:
    """Return the last observation, with the reason why the amplitudes together are inconclusive."""
    size = abs(last.predicted)
    apart = abs(last.observed - found[-2].observed) if len(found) > 1 else 0.0
    known = last.uncertainty + apart
    if failure:
        reason = f"with a smaller amplitude, {failure}"
    elif last.uncertainty > TOLERANCES.eigenvalue_error * size:
        reason = (
            f"what is seen depends on the amplitude, and at {last.amplitude:.0e} of the sizes in the scene errors of "
            f"integration let it be known to {last.uncertainty:.1e} 1/s only"
            if apart > TOLERANCES.eigenvalue_error * size
            else f"the motion shows it to {last.uncertainty:.1e} 1/s only"
        )
    elif apart > TOLERANCES.eigenvalue_error * min(size, abs(last.observed)):
        reason = (
            f"what is seen depends on the amplitude: two, {found[-2].amplitude:.0e} and {last.amplitude:.0e} of the "
            f"sizes in the scene, differ by {apart:.1e} 1/s"
        )
    else:
        off = last.observed - last.predicted
        reason = (
            f"it is off by {abs(off.real):.1e} 1/s in growth and {abs(off.imag):.1e} 1/s in frequency, more than the "
            f"{known:.1e} 1/s to which it is known"
        )
    return replace(last, uncertainty=known, verdict="cannot be judged", reason=reason)


def _line(times: Array, values: Complex, weights: Array) -> tuple[complex, float]:
    """Return the slope of a line fitted to complex values by weighted least squares, and the distance from it (rms)."""
    X = np.stack([np.ones(len(times)), times - times[0]], axis=1)
    found: Any = least_squares(X * weights[:, None], values * weights, rcond=None)
    away = (values - X @ found) * weights
    return complex(found[1]), float(np.sqrt(np.mean(np.abs(away) ** 2)))


def _overall(result: EigenResult, modes: list[Observation], neutral: Drift | None) -> tuple[str, str]:
    """Return the overall verdict and its reason."""
    wrong = [m for m in modes if m.verdict == "contradicted"]
    if wrong:
        names = ", ".join(str(m.number) for m in wrong)
        return "contradicted", f"mode{'s' if len(wrong) > 1 else ''} {names}: {wrong[0].reason}"
    if neutral is not None and neutral.verdict == "contradicted":
        return "contradicted", neutral.reason
    if result.verdict == UNDECIDED:
        return "cannot be judged", "the linearized equations decide nothing that could be verified"
    growing = [
        m
        for m in modes
        if m.verdict == "confirmed" and m.observed.real > TOLERANCES.uncertainties_of_observation * m.uncertainty
    ]
    if result.verdict == UNSTABLE and growing:
        worst = max(growing, key=lambda m: m.observed.real)
        return "confirmed", f"mode {worst.number} grows with {worst.observed.real:.6g} 1/s in the nonlinear motion"
    unknown = [m for m in modes if m.verdict != "confirmed"]
    if unknown:
        return "cannot be judged", f"mode {unknown[0].number}: {unknown[0].reason}"
    if not modes and neutral is None:
        return "cannot be judged", "there is no mode that could be excited"
    if result.verdict == UNSTABLE:
        return "cannot be judged", "no single mode grows in the nonlinear motion: what is unstable was not excited"
    if neutral is not None and neutral.verdict != "confirmed":
        return "cannot be judged", f"neutral directions: {neutral.reason}"
    what = "all modes decay" if result.verdict in (ASYMPTOTIC, ASYMPTOTIC_UP_TO) else "no mode grows"
    if neutral is not None:
        what += " and neutral directions do what the linearized equations say"
    return "confirmed", f"{what} in the nonlinear motion, within the time it was followed"
