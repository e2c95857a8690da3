"""All integrators on one motion: cost and global error for several tolerances.

A run is one pass with a tolerance per step, without the repetitions that control the global error in
`mbstab.analysis.simulate.simulate`. Its error is the largest distance from a reference at any output time, in the
measure of that module. The reference is the solution of that module with DOP853 (with Radau IIA
where DOP853 takes too long) and the tolerance `TOLERANCES.reference_error`; its own error is its estimate.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from mbstab.analysis.compare.tolerances import TOLERANCES
from mbstab.analysis.simulate.accuracy import Work
from mbstab.analysis.simulate.recording import Record, Track, states
from mbstab.analysis.simulate.run import Follower, Run, difference
from mbstab.analysis.simulate.start import Start, start_of
from mbstab.analysis.simulate.steppers.interface import Method
from mbstab.analysis.simulate.steppers.table import METHODS
from mbstab.compiler.system import Array, System
from mbstab.errors import ModelFileError, NumericalError, SimulationError, UsageError
from mbstab.records import Answer, dataclass

DISTURBANCE: dict[str, float | str] = {"mode:1": 0.1}
"""Disturbance of the reference if neither the file nor the caller gives one."""


@dataclass(frozen=True)
class Integration:
    """One integrator with one tolerance.

    Attributes
    ----------
    method, solver : str
        Keys of `mbstab.analysis.simulate.steppers.table.METHODS`.
    tol : float
        Tolerance per step.
    error : float
        Largest difference from the reference at any output time, measured as `error_estimate` of
        `mbstab.analysis.simulate.result.Simulation`.
    seconds : float
        CPU time (s).
    evaluations, steps, rejected : int
    energy : float
        Largest imbalance of energy, relative to the energy that is exchanged.
    constraints : float
        Largest residual of a constraint row after any step, relative to sizes and speeds in the scene.
    failure : str
        Why the run did not reach the end.
    """

    method: str
    solver: str
    tol: float
    error: float = math.nan
    seconds: float = math.nan
    evaluations: int = 0
    steps: int = 0
    rejected: int = 0
    energy: float = math.nan
    constraints: float = math.nan
    failure: str = ""

    @property
    def name(self) -> str:
        """The name of the integrator on the command line."""
        return self.solver or self.method


@dataclass(frozen=True)
class Integrations(Answer):
    """All integrators on one motion.

    Attributes
    ----------
    runs : tuple of Integration
    start, end : float (s)
    disturbance : dict
        Disturbance that was added to the reference motion.
    reference : str
        The integrator of the reference.
    known : float
        Accuracy of the reference: the estimate of its global error.
    final : ndarray, shape (n_q,)
        Coordinates of the reference at the end (m, rad).
    tolerance : float or None
    chosen : Integration or None
        The fastest run with at most this error.
    """

    runs: tuple[Integration, ...]
    start: float
    end: float
    disturbance: dict[str, float | str]
    reference: str
    known: float
    final: Array
    tolerance: float | None
    chosen: Integration | None


def compare_integrators(
    system: System,
    to: float | None = None,
    perturb: Mapping[str, float | str] | None = None,
    tolerance: float | None = None,
    progress: Callable[[float], object] = lambda done: None,
    forced: bool = False,
) -> Integrations:
    """Return error, cost and drift of every integrator with several tolerances.

    Parameters
    ----------
    system : System
    to : float, optional
        Last time (s); `TOLERANCES.default_duration` after the start if not given.
    perturb : mapping, optional
        As in `mbstab.analysis.simulate.start.start_of`; `DISTURBANCE` if nothing moves otherwise.
    tolerance : float, optional
        Largest error, for the choice of an integrator.
    progress : callable
        Called with the fraction of the work that is done, from 0 to 1.
    forced : bool
        Continue beyond `TOLERANCES.comparison_time`.

    Raises
    ------
    UsageError
        If an argument is out of range or a name is unknown.
    SimulationError
        If the motion cannot be followed to the end.
    NumericalError
        If no integrator keeps the tolerance.
    """
    if tolerance is not None and not 0.0 < tolerance < 1.0:
        raise UsageError(f"--tol {tolerance:g}: an error above 0 and below 1")
    begin, disturbance = _disturbed(system, dict(perturb or {}))
    first = begin.motion.time
    last = first + TOLERANCES.default_duration if to is None else float(to)
    if not (math.isfinite(last) and last > first):
        raise UsageError(f"the end of the simulation, {last:g} s, must be later than its start, {first:g} s")
    follower = Follower(begin.system, begin.motion, np.linspace(first, last, TOLERANCES.output_times))
    race = _Race(follower, math.inf if forced else TOLERANCES.comparison_time)
    reference, known = race.reference()
    runs = race.runs(reference, progress)
    chosen = None if tolerance is None else _fastest_within(runs, tolerance)
    final = states(reference.stretches)[0][-1]
    return Integrations(tuple(runs), first, last, disturbance, race.name, known, final, tolerance, chosen)


def _disturbed(system: System, perturb: dict[str, float | str]) -> tuple[Start, dict[str, float | str]]:
    """Return the start of the motion, and what was added to the reference: a mode, if nothing else is given."""
    initial = system.scene.initial
    if not perturb and not initial.coordinates and not initial.rates:
        try:
            return start_of(system, DISTURBANCE), dict(DISTURBANCE)
        except (UsageError, ModelFileError):  # no mode, or a reference that moves on its own
            pass
    return start_of(system, perturb), perturb


def _fastest_within(runs: list[Integration], tolerance: float) -> Integration:
    good = [x for x in runs if x.error <= tolerance]
    if not good:
        best = min((x for x in runs if not math.isnan(x.error)), key=lambda x: x.error, default=None)
        nearest = f": {best.name} comes closest with {best.error:.1e}" if best is not None else ""
        raise NumericalError(f"no integrator keeps {tolerance:g}{nearest}")
    least = TOLERANCES.equal_times * min(x.seconds for x in good)
    return next(x for x in good if x.seconds <= least)


class _Race:
    """Runs of the same motion."""

    def __init__(self, follower: Follower, budget: float) -> None:
        self.follower = follower
        self.name = ""
        self.rate = self.fast = math.nan
        self.end = self.end_of_share = time.process_time() + budget

    def share(self, solvers: int) -> None:
        """Start one of the remaining solvers: it may use its share of the remaining budget."""
        now = time.process_time()
        self.end_of_share = now + max(self.end - now, 0.0) / solvers

    def reference(self) -> tuple[Run, float]:
        """Return the reference and its accuracy."""
        failure = ""
        limit = min(10.0 * TOLERANCES.integration_time, (self.end - time.process_time()) / 3.0)
        for name, method in (("DOP853", METHODS["projection"]["DOP853"]), ("radau", METHODS["radau"][""])):
            work = Work(self.follower, method, TOLERANCES.reference_error, None, False, _watch(limit))
            run = work.refined()
            if run.interrupted:
                raise KeyboardInterrupt
            self.follower.settle(run)
            if run.complete:
                self.name, self.rate, self.fast = name, work.rate, work.fast
                return run, work.estimate
            failure = failure or run.failure
        raise SimulationError(f"there is no reference to compare with: {failure}", None)

    def runs(self, reference: Run, progress: Callable[[float], object]) -> list[Integration]:
        """Return cost and error of every integrator with every tolerance, as far as the budget allows."""
        solvers = [(name, key, solver) for name, group in METHODS.items() for key, solver in group.items()]
        found: list[Integration] = []
        for done, (name, key, solver) in enumerate(solvers):
            given_up = False
            self.share(len(solvers) - done)
            for tol in TOLERANCES.step_tolerances:
                if given_up:
                    found.append(Integration(name, key, tol, failure="not tried: a larger tolerance took too long"))
                else:
                    found.append(self.measured(name, key, solver, tol, reference))
                    given_up = bool(found[-1].failure)
                progress(len(found) / (len(solvers) * len(TOLERANCES.step_tolerances)))
        return found

    def run(self, method: Method, tol: float, limit: float) -> tuple[Run, float]:
        """Return a run and how long it took (s); one that takes longer than the limit fails."""
        work = Work(self.follower, method, 1.0, None, False, _watch(limit, TOLERANCES.pace_known * limit))
        work.rate = self.rate
        began = time.process_time()
        run = work.once(tol)
        self.follower.settle(run)
        if run.interrupted:
            raise KeyboardInterrupt
        return run, time.process_time() - began

    def measured(self, name: str, key: str, method: Method, tol: float, reference: Run) -> Integration:
        """Return cost and error of a run."""
        run, seconds = self.run(
            method, tol, min(TOLERANCES.integration_time, max(self.end_of_share - time.process_time(), 0.0))
        )
        counts: dict[str, Any] = {"evaluations": run.evaluations, "steps": run.steps, "rejected": run.rejected}
        if not run.complete:
            return Integration(name, key, tol, seconds=seconds, failure=run.failure.partition("\n")[0], **counts)
        tracks = Track.of(run.stretches), Track.of(reference.stretches)
        states_of = self.follower.system.states[0]
        error = difference(*tracks, self.follower.motion.sizes, states_of, self.fast)
        return Integration(name, key, tol, error, seconds, energy=_imbalance(run), constraints=run.drift, **counts)


def _watch(limit: float, enough: float = math.inf) -> Callable[[float], object]:
    """Return a progress function that gives up after `limit` seconds, or if its pace predicts more than `enough`."""
    began = time.process_time()

    def watch(done: float) -> None:
        spent = time.process_time() - began
        if spent > limit or (spent > enough and spent > TOLERANCES.pace_slow * limit * done):
            raise NumericalError(f"given up after {spent:.2g} s, when {done:.0%} was done")

    return watch


def _imbalance(run: Run) -> float:
    """Return the largest imbalance of energy, relative to the energy that is exchanged."""
    record, work = Record.of(run.stretches), np.concatenate([x.work for x in run.stretches])
    total = record.kinetic + record.potential - work
    scale = max(run.peak, float(np.ptp(record.potential)), float(np.max(np.abs(work))))
    return float(np.max(np.abs(total - total[0]))) / scale if scale > 0.0 else 0.0
