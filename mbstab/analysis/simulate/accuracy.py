"""Runs of one motion with decreasing tolerances, until they agree."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from mbstab.analysis.simulate.estimate import Estimate, estimated, reduction
from mbstab.analysis.simulate.run import Follower, Run, difference, fastest
from mbstab.analysis.simulate.steppers.interface import Method, Options
from mbstab.analysis.simulate.tolerances import TOLERANCES
from mbstab.analysis.verdict.written import functions_along, with_features
from mbstab.compiler.system import Array, System
from mbstab.model.arithmetic import array_arithmetic
from mbstab.model.dependencies import uneven


class Work:
    """Runs with decreasing tolerances."""

    def __init__(
        self,
        follower: Follower,
        method: Method,
        tol: float,
        step: float | None,
        compiled: bool,
        progress: Callable[[float], object],
    ) -> None:
        self.follower, self.method = follower, method
        self.tol, self.step, self.compiled, self.progress = tol, step, compiled, progress
        self.first = tol
        motion = follower.motion
        relative = float(np.max(np.abs(motion.u / motion.sizes), initial=0.0))
        pulled = math.sqrt(float(np.max(np.abs(motion.a / motion.sizes), initial=0.0)))
        self.rate = max(relative, pulled, 1.0 / float(follower.times[-1] - follower.times[0]))
        falling = math.sqrt(math.hypot(*map(float, follower.system.scene.gravity)) / float(np.max(motion.sizes)))
        self.natural = max(self.rate, falling)
        self.longest = longest_step(follower)
        self.estimate, self.fast, self.runs, self.evaluations = math.nan, math.nan, 0, 0
        self.warnings = pulses(
            follower.system, float(follower.times[0]), float(follower.times[-1]), step or self.longest
        )
        self.notes: list[str] = []

    def once(self, tol: float, progress: Callable[[float], object] | None = None) -> Run:
        """Follow the motion with a tolerance per step."""
        # The longest step shrinks with the tolerance like the others: else runs would not differ where it is active.
        longest = self.longest * (tol / self.first) ** self.method.exponent
        options = Options(self.method, tol, self.step, None, self.rate, longest, self.compiled)
        if self.follower.budget:
            self.follower.budget.start_run(self._further(refining=progress is not None))
        run = self.follower.run(options, progress or self.progress)
        self.runs += 1
        self.notes = run.notes or self.notes
        self.evaluations += run.evaluations
        return run

    def _further(self, refining: bool) -> float:
        """Return the minimum number of runs as long as the next one that follow it."""
        if not refining:
            return 0.0
        longer = TOLERANCES.step_tolerance_reduction**-self.method.exponent
        return float(sum(longer**k for k in range(1, TOLERANCES.runs_least - self.runs)))

    def refined(self) -> Run:
        """Follow the motion until the estimate of its global error is below the tolerance."""
        least = TOLERANCES.step_tolerance_least
        coarse = min(TOLERANCES.first_tolerance * self.tol, TOLERANCES.first_tolerance_most)
        local = self.first = max(self.tol, coarse, least)
        sizes = self.follower.motion.sizes
        before = self.once(local, self._share(0.0, 0.15))
        if not before.complete:
            # Where a motion ends is told as exactly as it is asked for.
            return before if before.interrupted or local <= self.tol else self.once(max(self.tol, least))
        started, speed = self.rate, fastest(before.track, float(np.max(sizes)))
        self.rate = max(speed, 1e-3 * self.rate, TOLERANCES.resting_speed * self.natural)
        fast = self.fast = max(speed, TOLERANCES.resting_speed * self.natural)
        if speed < fast:
            local = self.first = max(self.tol, least)  # of rest, coarse runs show nothing but the rounding of forces
        following = max(local * TOLERANCES.step_tolerance_reduction, least)
        # A first run that assumed too large a rate as fast has larger errors of speeds than its tolerance.
        if following >= local or TOLERANCES.step_tolerance_reduction * started > self.rate or speed < fast:
            following, local = (least, 10.0 * least) if following >= local else (following, local)
            before = self.once(local, self._share(0.15, 0.2))
            if not before.complete:
                return before
        shares = [0.15, 0.3, 0.5, 0.8, 0.95, 1.0]
        # The first run assumed another rate as fast: for speeds its tolerance was smaller by that factor.
        known, improved = [(local * (min(started / self.rate, 1.0) if self.runs == 1 else 1.0), before)], True
        for k in range(1, TOLERANCES.runs_most):
            run = self.once(following, self._share(shares[k - 1], shares[k]))
            if not run.complete:
                return self._better(known[-1][1], run)
            known.append((following, run))
            # Earlier runs may have missed something.
            last = self.estimate
            found = self._estimated(known[-TOLERANCES.runs_least :], fast)
            self.estimate = found.error
            improved = not self.estimate > TOLERANCES.estimate_improvement * last
            if following <= least or (self.estimate <= self.tol and k + 1 >= TOLERANCES.runs_least):
                break
            following = self._next(following, found.likely)
        if self.estimate > self.tol:
            reason = (
                f"stopped after {self.runs} runs"
                if improved and following > least
                else f"the tolerance of a step is at its least, {least:g}, and what is left comes from rounding and "
                "the growth of small errors over this time; shorter steps (--step) may do better"
                if following <= least
                else "smaller tolerances of a step change the result by as much"
            )
            self.warnings.append(
                f"the estimate of the global error, {self.estimate:.2e}, is above the tolerance {self.tol:.2e}: "
                + reason
            )
        self.progress(1.0)
        return run

    def _estimated(self, known: list[tuple[float, Run]], fast: float) -> Estimate:
        """Return the error of the last of some runs, each with its tolerance per step."""
        *earlier, (tol, run) = known
        sizes, states = self.follower.motion.sizes, self.follower.system.states[0]
        found = [(tol / larger, difference(run.track, x.track, sizes, states, fast)) for larger, x in earlier]
        return estimated(found, self.method.power)

    def _next(self, last: float, likely: float) -> float:
        """Return the tolerance per step of the next run, from that of the last one and its likely error."""
        least, wanted = TOLERANCES.step_tolerance_least, last
        if likely >= TOLERANCES.difference_of_motions:
            wanted = math.sqrt(last * least)  # nothing is known yet: half the digits that are left
        elif likely > self.tol:
            wanted = last * reduction(TOLERANCES.repeated_run_aim * self.tol / likely, self.method.power)
        # An estimate needs a run nearby: far reductions are made in two.
        if max(wanted, least) < TOLERANCES.clear_reduction * last:
            wanted = max(wanted, least) / TOLERANCES.step_tolerance_reduction
        return max(min(wanted, TOLERANCES.confirming_reduction * last), least)

    def _share(self, low: float, high: float) -> Callable[[float], object]:
        """Return the progress function of a part of the work."""
        return lambda done: self.progress(low + (high - low) * done)

    def _better(self, before: Run, run: Run) -> Run:
        """Return the run to keep after an early end: if stopped by the user, a complete run with a larger error."""
        if run.interrupted:
            size = "is not known" if math.isnan(self.estimate) else f"is {self.estimate:.2e} as estimated"
            self.warnings.append(f"stopped while the error was being reduced: its size {size}")
            return replace(before, interrupted=True)
        return run


def longest_step(follower: Follower) -> float:
    """Return the longest step (s): where functions of time or of the motion may rest, about that of the output."""
    system = follower.system
    if not system.remember("uneven", None, lambda: any(uneven(x, system.names) for x in system.scene.written)):
        return math.inf
    times = follower.times
    duration = float(times[-1] - times[0])
    return min(
        max(float(times[1] - times[0]), duration / TOLERANCES.longest_step_parts[1]),
        duration / TOLERANCES.longest_step_parts[0],
    )


def pulses(system: System, first: float, last: float, longest: float) -> list[str]:
    """Return a warning for each given function of time with a pulse so short that steps may miss it.

    Parameters
    ----------
    first, last : float (s)
    longest : float
        Longest step (s).
    """
    if not longest < last - first:
        return []
    cells, each = _cells(first, last, longest)
    times = np.linspace(first, last, cells * each + 1)
    found: dict[str, str] = {}
    for owner, law in system.given_functions():
        with np.errstate(all="ignore"):
            values = np.broadcast_to(replace(law, arithmetic=array_arithmetic()).at(times).value, times.shape)
        _look(found, owner, times, values, each, longest)
    return list(found.values())


def bumps(system: System, times: Array, q: Array, u: Array, longest: float) -> list[str]:
    """Return a warning for each function of a motion with a bump so short that steps may have missed it.

    Parameters
    ----------
    times : ndarray, shape (n_t,) (s)
    q, u : ndarray, shape (n_t, n_q)
        The motion that was found.
    longest : float
        Longest step (s).
    """
    if len(times) < 2 or not longest < times[-1] - times[0] or not with_features(system):
        return []
    from scipy.interpolate import CubicHermiteSpline

    cells, each = _cells(float(times[0]), float(times[-1]), longest)
    fine, motion = np.linspace(times[0], times[-1], cells * each + 1), CubicHermiteSpline(times, q, u)
    found: dict[str, str] = {}
    for path, values in functions_along(system, fine, motion(fine), motion(fine, 1)):
        _look(found, path, fine, values, each, longest)
    return list(found.values())


def _cells(first: float, last: float, longest: float) -> tuple[int, int]:
    """Return the number of cells of a duration, several in the longest step, and of the samples in each."""
    cells = math.ceil((last - first) * TOLERANCES.looks_at_given_functions / longest)
    return cells, max(TOLERANCES.looks_at_given_functions, TOLERANCES.looks_in_all // cells)


def _look(found: dict[str, str], owner: str, times: Array, values: Array, each: int, longest: float) -> None:
    """Add a warning if a function has a pulse that lies within a cell."""
    size, count = float(np.ptp(values)), (len(times) - 1) // each
    if not (math.isfinite(size) and size > 0.0):
        return
    for shift in (0, each // 2):  # a pulse at the end of one cell lies inside another
        place = _pulse(values[shift : shift + (count - 1) * each + 1], each, size)
        if place is not None:
            time, width = times[shift + place[0]], place[1] * (times[1] - times[0])
            found.setdefault(
                owner,
                f"{owner} has a pulse of about {width:.1g} s at t = {time:.6g} s, which steps of up to "
                f"{longest:.2g} s may pass over: give --step, more --points, or a time nearby with --from",
            )


def _pulse(values: Array, each: int, size: float) -> tuple[int, int] | None:
    """Return where a function deviates most from its values at the ends of cells, and for how long; or None."""
    ends, inside = values[::each], values[:-1].reshape(-1, each)
    off = np.abs(inside - ends[:-1, None] - (ends[1:] - ends[:-1])[:, None] * np.arange(each) / each)
    far = np.max(off, axis=1)
    lively = far > TOLERANCES.clear_pulse * size
    # A deviation that reaches the end of a cell shows there, and one that is everywhere shows everywhere.
    rise = np.abs(np.diff(ends))
    beside = np.pad(rise, 1)
    # The top of a longer pulse shows in the cells beside it.
    hidden = lively & (rise < TOLERANCES.clear_pulse * far) & (np.maximum(beside[:-2], beside[2:]) < far)
    if not np.any(hidden) or np.count_nonzero(lively) > TOLERANCES.clear_pulse * len(far):
        return None
    k = int(np.argmax(np.where(hidden, far, 0.0)))
    return k * each + int(np.argmax(off[k])), int(np.count_nonzero(2.0 * off[k] > far[k]))
