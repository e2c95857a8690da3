"""The nonlinear motion of a scene, as accurate as asked for.

The tolerance is that of the result: the largest error of places (in the size of the scene), of
orientations (of entries of the rotation matrices) and of speeds (relative to the largest of the
motion; where nothing moves, to the part `REST` of the natural rate of the scene) at
any time of output. It is estimated from three runs at least with different tolerances of a step, to which
power the error is proportional (`SURE` times `Method.power` is counted on), and runs are repeated with
smaller ones until the estimate is below: the largest of those from each of the earlier runs, as the errors
of two runs may agree by chance.
The true error may exceed the estimate by the factor `TRUST`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from mbstab.analysis.algebra import budget
from mbstab.analysis.reference.dependencies import expressions_in, uneven_in_time
from mbstab.analysis.reference.efforts import MOTION_UNITS, motion_name, moving_joints
from mbstab.analysis.simulate.recording import Record, Track
from mbstab.analysis.simulate.run import Follower, Run, difference, fastest
from mbstab.analysis.simulate.start import Start, start_of
from mbstab.analysis.simulate.steppers.compiled import machine_code
from mbstab.analysis.simulate.steppers.interface import Method, Options
from mbstab.analysis.simulate.steppers.table import METHODS
from mbstab.analysis.simulate.time_budget import Budget
from mbstab.compiler.system import Array, System
from mbstab.errors import SimulationError, UsageError
from mbstab.model.arithmetic import array_arithmetic

TRUST = 3.0
"""The error of a result is below this factor times the tolerance, if no warning says that the tolerance is not met."""

RUNS, LEAST_RUNS = 5, 3
"""With different tolerances, at most and at least."""

REST = 1e-4
"""Speeds below this part of the natural rate are as good as none."""

SEEN, PULSES = 8, 2**16
"""Parts of the longest step, and at most so many of a simulation, in which given functions of time are looked at."""

CLEAR_PULSE = 0.05
"""Of a function's range, or of a number of parts: more counts."""

MOST_STEPS = 1e9
"""Of fixed size."""

SMALLEST = 1e-13
"""Tolerance of a step below which rounding decides."""

REDUCTION = 0.1
"""Of the tolerance of a step from the first run to the second."""

LARGEST_RATIO = 0.5
"""Of tolerances whose runs tell anything about the error."""

IMPROVED = 0.7
"""A run whose estimate is above this part of the one before has not improved the result."""

SURE = 0.75
"""Part of `Method.power` that is counted on: errors of single runs may shrink less than theory says."""

MARGIN = 0.3
"""A repeated run aims at this part of the tolerance."""

LONGEST_STEPS = (100.0, 1000.0)
"""With functions of time that may rest a step is at most the distance of two times of output, between these parts."""

SAMPLE = 40
"""Numbers that would take as much memory as what surrounds a state that is kept."""

RESOLVED = 1e-3
"""Part of the natural time of a scene within which the time has to be known."""

LONGEST = 10.0
"""Duration of a simulation whose end is not given (s)."""


@dataclass(frozen=True, repr=False)
class Simulation:
    """A motion over a span of time.

    Attributes
    ----------
    names, bodies, rows : tuple of str
        Coordinates in the order of q, bodies, constraint rows.
    times : ndarray, shape (n_t,)
        Times of output (s).
    q, u, a : ndarray, shape (n_t, n_q)
        Coordinates (m, rad), rates and accelerations, in the angles of the file.
    nu : ndarray, shape (n_t, n_c)
        Multipliers [λ; μ], the least ones where rows are redundant.
    positions : ndarray, shape (n_t, n_b, d)
        Reference points of the bodies in ground axes (m), d = 2 or 3.
    rotations : ndarray, shape (n_t, n_b, d, d)
        From body axes to ground axes; the unit matrix for point masses.
    velocities : ndarray, shape (n_t, n_b, d)
        Of the reference points (m/s).
    spins : ndarray, shape (n_t, n_b, 3)
        Angular velocities in ground axes (rad/s); about z in the plane.
    loads : ndarray, shape (n_t, n_l)
        Reactions as in `mbstab.analysis.reference.reactions`: forces (N) and torques (N·m), ground axes.
    load_names : tuple of (str, str, str)
        Owner, body acted on, and component such as ``force x``.
    efforts : ndarray, shape (n_t, n_e)
        Of springs, dampers, actuators and drives along their motions (N, N·m), positive where they drive them on.
    effort_names : tuple of (str, str)
        Owner and unit.
    motions, motion_rates : ndarray, shape (n_t, n_m)
        Angles and displacements of joints (rad, m), and their rates.
    motion_names : tuple of (str, str)
        Such as ``angle(pivot)``, and unit.
    kinetic, potential : ndarray, shape (n_t,)
        Energies (J): of the motion; of weight and springs.
    work : ndarray, shape (n_t,)
        What forces without a potential, dampers and drives have done since the start (J).
    residuals : ndarray, shape (n_t, 2)
        Largest residuals of constraint rows in position and velocity, relative to the sizes in the scene and to
        the speeds at that time.
    method, solver : str
    tol : float
        The global error asked for; nan with fixed steps.
    step : float or None
        The fixed step (s).
    error_estimate : float
        Of the global error, which is the largest of those of places, relative to the size of the scene, of entries
        of rotation matrices, and of speeds, relative to the largest speed of the motion, or where nothing moves to
        `REST` times the natural rate of the scene; nan where only one run was made.
    steps, rejected, evaluations : int
        Of the last run; evaluations count all runs.
    runs, charts : int
        How many runs were made; how often in the last one Euler angles were replaced by others.
    peak : float (J)
        The largest kinetic energy after any step; that of speeds as good as rest at least.
    sizes : ndarray, shape (n_q,)
        What a large change of each coordinate is.
    conservative : bool
        Whether nothing does work.
    warnings : tuple of str
    complete : bool
    failure : str
        Why the motion ends early, or empty.
    """

    names: tuple[str, ...]
    bodies: tuple[str, ...]
    rows: tuple[str, ...]
    times: Array
    q: Array
    u: Array
    a: Array
    nu: Array
    positions: Array
    rotations: Array
    velocities: Array
    spins: Array
    loads: Array
    load_names: tuple[tuple[str, str, str], ...]
    efforts: Array
    effort_names: tuple[tuple[str, str], ...]
    motions: Array
    motion_rates: Array
    motion_names: tuple[tuple[str, str], ...]
    kinetic: Array
    potential: Array
    work: Array
    residuals: Array
    method: str
    solver: str
    tol: float
    step: float | None
    error_estimate: float
    steps: int
    rejected: int
    evaluations: int
    runs: int
    charts: int
    peak: float
    sizes: Array
    conservative: bool
    warnings: tuple[str, ...]
    complete: bool
    failure: str

    def __repr__(self) -> str:
        """Return the size of it; the arrays are long."""
        solver = f" {self.solver}" if self.solver else ""
        return (
            f"<Simulation of {len(self.names)} coordinates at {len(self.times)} times from {self.times[0]:g} to "
            f"{self.times[-1]:g} s by {self.method}{solver}, error estimate {self.error_estimate:.2g}>"
        )

    @property
    def end_state(self) -> dict[str, dict[str, float]]:
        """Coordinates and rates by name at the last time."""
        q, u = (dict(zip(self.names, x[-1].tolist(), strict=True)) for x in (self.q, self.u))
        return {"coordinates": q, "rates": u}

    @property
    def max_constraint_residual(self) -> float:
        """The largest relative residual of a constraint row at any time of output."""
        return float(np.max(self.residuals, initial=0.0))

    @property
    def imbalance(self) -> Array:
        """T + V − work, relative to what it is at the start, shape (n_t,) (J): zero but for errors."""
        total = self.kinetic + self.potential - self.work
        return np.asarray(total - total[0])

    @property
    def energy_scale(self) -> float:
        """The largest energy that goes to and fro (J)."""
        swing = float(np.ptp(self.potential))
        return max(self.peak, float(np.max(self.kinetic)), swing, float(np.max(np.abs(self.work))))

    @property
    def energy_drift(self) -> float:
        """The largest imbalance of energy, relative to `energy_scale`; 0 where energies are too small for numbers."""
        return float(np.max(np.abs(self.imbalance))) / (self.energy_scale or 1.0)


def simulate(
    system: System,
    to: float | None = None,
    start: float | None = None,
    method: str = "projection",
    solver: str = "",
    tol: float = 1e-8,
    step: float | None = None,
    points: int = 501,
    perturb: Mapping[str, float | str] | None = None,
    strict: bool = False,
    once: bool = False,
    compiled: bool = False,
    progress: Callable[[float], object] = lambda done: None,
    through_singular: bool = False,
    tell: Callable[[str], object] = lambda text: None,
    force: bool = False,
) -> Simulation:
    """Return the motion that starts as the file and `perturb` say.

    Parameters
    ----------
    to, start : float, optional
        Last time (s), 10 s after the start if not given, and first one, that of the file if not given.
    method, solver : str
        Keys of `mbstab.analysis.simulate.steppers.table.METHODS`; without a solver the first of the method.
    tol : float
        Global error.
    step : float, optional
        Fixed step (s), without control or estimate of the error.
    points : int
        Number of times of output, evenly spaced.
    perturb, strict
        As in `mbstab.analysis.simulate.start.start_of`.
    once : bool
        Make one run in which `tol` is the error of each step; nothing is known about the global error.
    compiled : bool
        Take the steps in machine code; for the projection method with DOP853 or RK45.
    progress : callable
        Is called with the part of the work that is done, from 0 to 1.
    through_singular : bool
        Go on through configurations where the constraints lose rank, along the smooth continuation of the motion,
        and say so in a warning. The tolerance holds there as well. Where there is no such continuation, or it cannot
        be found to the tolerance, the motion ends as without this.
    tell : callable
        Is called with what should be known before the end: warnings, which are among those of the result as well, and
        how long it takes and why, where that is long.
    force : bool
        Take more memory than `mbstab.analysis.algebra.budget.MOST_MEMORY`.

    Raises
    ------
    UsageError
        If an argument is out of range or a name is unknown.
    SimulationError
        If the motion cannot be followed to the end; `partial` holds the finished part.
    """
    chosen, solver = _method(method, solver, step, compiled)
    _check(tol, step, points)
    if not force:
        _check_memory(system, points)
    begin = start_of(system, perturb, None if start is None else _number(start, "the first time"), strict)
    for text in begin.notes:
        tell(text)
    first = begin.motion.time
    last = first + LONGEST if to is None else _number(to, "the last time")
    if not (math.isfinite(last) and last > first):
        raise UsageError(
            f"the end of the simulation, {last:g} s, must be later than its start, {first:g} s, and finite"
        )
    if step is not None and step > last - first:
        raise UsageError(f"the step of {step:g} s is longer than the simulation of {last - first:g} s")
    if step is not None and (last - first) / step > MOST_STEPS:
        raise UsageError(
            f"steps of {step:g} s make {(last - first) / step:.1e} of them until {last:g} s, where {MOST_STEPS:.0e} "
            "is the limit"
        )
    follower = Follower(begin.system, begin.motion, np.linspace(first, last, points), through=through_singular)
    follower.tell, follower.budget = tell, Budget(first, last)
    work = Work(follower, chosen, solver, tol, step, compiled, progress)
    lost = math.ulp(max(abs(first), abs(last)))
    if lost * work.natural > RESOLVED:
        raise UsageError(
            f"times up to {last:g} s are known to {lost:.1e} s only in double precision, where the scene moves within "
            f"{1.0 / work.natural:.1e} s\nhint: an earlier end, and a start nearer to 0 with --from"
        )
    run = work.once(tol) if step is not None or once else work.refined()
    if not run.samples:
        raise SimulationError(run.failure or "stopped before anything was found", None)
    result = _result(begin, follower, work, run, method, solver)
    if not run.complete:
        raise SimulationError(_reason(run, result, last), result)
    return result


def _number(x: object, what: str) -> float:
    try:
        return float(x)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        raise UsageError(f"{what} is a number of seconds, not {x!r}") from None


def _reason(run: Run, result: Simulation, last: float) -> str:
    """Return why a motion ended early, and what is kept of it."""
    if run.interrupted and run.reached >= last:
        return "stopped before its error was reduced to the tolerance\nthe motion is kept as it was found before"
    reason = run.failure or f"stopped at t = {run.reached:.9g} s"
    return f"{reason}\nthe part until t = {result.times[-1]:.9g} s is kept" if len(result.times) else reason


def _method(method: str, solver: str, step: float | None, compiled: bool) -> tuple[Method, str]:
    if method not in METHODS:
        raise UsageError(f"there is no method {method!r}: {', '.join(METHODS)}")
    solvers = METHODS[method]
    solver = solver or next(iter(solvers))
    if solver not in solvers:
        known = ", ".join(filter(None, solvers)) or "none: it is a solver of its own"
        raise UsageError(f"the method {method} has no solver {solver!r}; solvers: {known}")
    if step is not None and not solvers[solver].fixed:
        raise UsageError(f"the solver {solver} chooses its own steps; fixed ones go with --method radau or alpha")
    if compiled and not solvers[solver].compiled:
        known = ", ".join(f"{m} {x}" for m, group in METHODS.items() for x in group if group[x].compiled)
        raise UsageError(f"there are no compiled steps for {f'{method} {solver}'.strip()}; there are for {known}")
    if compiled:
        machine_code()
    return solvers[solver], solver


def _check(tol: float, step: float | None, points: int) -> None:
    if not (math.isfinite(tol) and 0.0 < tol < 1.0):
        raise UsageError(f"the tolerance must lie between 0 and 1, not at {tol:g}")
    if step is not None and not (math.isfinite(step) and step > 0.0):
        raise UsageError(f"the step must be a positive number of seconds, not {step:g}")
    if points != int(points) or points < 2:
        raise UsageError(f"a simulation has two times of output at least, a whole number, not {points}")


def _check_memory(system: System, points: int) -> None:
    """Refuse times of output that take more memory than there should be need for."""
    d, bodies = system.scene.dimension, len(system.scene.bodies)
    moving = len(moving_joints(system.scene))
    results = 3 * system.n_q + system.n_c + bodies * (2 * d + d * d + 3) + 6 * len(system.scene.items) + 2 * moving + 6
    columns = results + LEAST_RUNS * (2 * system.n_q + SAMPLE)
    size = 8.0 * points * columns
    if size > budget.MOST_MEMORY:
        raise UsageError(
            f"{points} times of output take about {size / 1e9:.2g} GB of memory ({columns} numbers each), where "
            f"{budget.MOST_MEMORY / 1e9:g} GB is the limit\n"
            f"hint: {math.floor(budget.MOST_MEMORY / (8 * columns))} --points fit, or allow it with --force"
        )


def longest_step(follower: Follower) -> float:
    """Return the longest step: with functions of time that may rest about the distance of two times of output."""
    given = (x for item in follower.system.scene.items for x in expressions_in(item.entry.values))
    if not any(map(uneven_in_time, given)):
        return math.inf
    times = follower.times
    duration = float(times[-1] - times[0])
    return min(max(float(times[1] - times[0]), duration / LONGEST_STEPS[1]), duration / LONGEST_STEPS[0])


def pulses(system: System, first: float, last: float, longest: float) -> list[str]:
    """Return a warning for each given function of time with a pulse so short that steps may pass over it.

    Parameters
    ----------
    first, last : float (s)
    longest : float
        Longest step (s).
    """
    if not longest < last - first:
        return []
    cells = math.ceil((last - first) * SEEN / longest)
    each = max(SEEN, PULSES // cells)
    times = np.linspace(first, last, cells * each + 1)
    found: dict[str, str] = {}
    for owner, law in system.given_functions():
        with np.errstate(all="ignore"):
            values = np.broadcast_to(replace(law, arithmetic=array_arithmetic()).at(times).value, times.shape)
        size = float(np.ptp(values))
        if not (math.isfinite(size) and size > 0.0):
            continue
        for shift in (0, each // 2):  # a pulse at the end of one cell lies inside another
            place = _pulse(values[shift : shift + (cells - 1) * each + 1], each, size)
            if place is not None:
                time, width = times[shift + place[0]], place[1] * (times[1] - times[0])
                found.setdefault(
                    owner,
                    f"{owner} has a pulse of about {width:.1g} s at t = {time:.6g} s, which steps of up to "
                    f"{longest:.2g} s may pass over: give --step, more --points, or a time nearby with --from",
                )
    return list(found.values())


def _pulse(values: Array, each: int, size: float) -> tuple[int, int] | None:
    """Return where a function is farthest from what its values at the ends of cells tell, and how long; or None."""
    ends, inside = values[::each], values[:-1].reshape(-1, each)
    off = np.abs(inside - ends[:-1, None] - (ends[1:] - ends[:-1])[:, None] * np.arange(each) / each)
    far = np.max(off, axis=1)
    lively = far > CLEAR_PULSE * size
    # What is still there at the end of a cell is seen there; and what is everywhere is seen everywhere.
    hidden = lively & (np.abs(ends[1:] - ends[:-1]) < CLEAR_PULSE * far)
    if not np.any(hidden) or np.count_nonzero(lively) > CLEAR_PULSE * len(far):
        return None
    k = int(np.argmax(np.where(hidden, far, 0.0)))
    return k * each + int(np.argmax(off[k])), int(np.count_nonzero(2.0 * off[k] > far[k]))


class Work:
    """Runs with smaller and smaller tolerances."""

    def __init__(
        self,
        follower: Follower,
        method: Method,
        solver: str,
        tol: float,
        step: float | None,
        compiled: bool,
        progress: Callable[[float], object],
    ) -> None:
        self.follower, self.method, self.solver = follower, method, solver
        self.tol, self.step, self.compiled, self.progress = tol, step, compiled, progress
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
        """Follow the motion with a tolerance of a step."""
        # The longest step shrinks with the tolerance as the others do: otherwise runs would not differ where it binds.
        longest = self.longest * (tol / self.tol) ** (self.method.power / self.method.order)
        options = Options(tol, self.step, None, self.rate, longest, self.solver, self.compiled)
        if self.follower.budget:
            self.follower.budget.start_run(self._further(refining=progress is not None))
        run = self.follower.run(self.method, options, progress or self.progress)
        self.runs += 1
        self.notes = run.notes or self.notes
        self.evaluations += run.evaluations
        return run

    def _further(self, refining: bool) -> float:
        """Return how many runs as long as the next one follow it at least."""
        if not refining:
            return 0.0
        longer = REDUCTION ** (-self.method.power / self.method.order)
        return float(sum(longer**k for k in range(1, LEAST_RUNS - self.runs)))

    def refined(self) -> Run:
        """Follow the motion until the estimate of its global error is below the tolerance."""
        local = max(self.tol, SMALLEST)
        sizes = self.follower.motion.sizes
        before = self.once(local, self._share(0.0, 0.15))
        if not before.complete:
            return before
        started, speed = self.rate, fastest(before, float(np.max(sizes)))
        self.rate = max(speed, 1e-3 * self.rate, REST * self.natural)
        fast = self.fast = max(speed, REST * self.natural)
        following = max(local * REDUCTION, SMALLEST)
        # A first run that took too much for fast has larger errors of speeds than its tolerance says.
        if following >= local or REDUCTION * started > self.rate:
            following, local = (SMALLEST, 10.0 * SMALLEST) if following >= local else (following, local)
            before = self.once(local, self._share(0.15, 0.2))
            if not before.complete:
                return before
        shares = [0.15, 0.3, 0.5, 0.8, 0.95, 1.0]
        # The first run took another rate as fast: for speeds its tolerance was as much smaller.
        earlier, improved = [(local * (min(started / self.rate, 1.0) if self.runs == 1 else 1.0), before)], True
        for k in range(1, RUNS):
            run = self.once(following, self._share(shares[k - 1], shares[k]))
            if not run.complete:
                return self._better(before, run)
            # Earlier runs may have passed over something.
            last, self.estimate = self.estimate, self._estimated(run, following, earlier[1 - LEAST_RUNS :], fast)
            improved = not self.estimate > IMPROVED * last
            if following <= SMALLEST or (self.estimate <= self.tol and k + 1 >= LEAST_RUNS):
                break
            wanted = REDUCTION * following
            if self.estimate > self.tol:
                wanted = following * (MARGIN * self.tol / self.estimate) ** (1.0 / (SURE * self.method.power))
            earlier.append((following, run))
            before = run
            following = max(min(wanted, 0.3 * following), SMALLEST)
        if self.estimate > self.tol:
            reason = (
                f"stopped after {self.runs} runs"
                if improved and following > SMALLEST
                else f"the tolerance of a step is at its least, {SMALLEST:g}, and what is left comes from rounding and "
                "the growth of small errors over this time; shorter steps (--step) may do better"
                if following <= SMALLEST
                else "smaller tolerances of a step change the result by as much"
            )
            self.warnings.append(
                f"the estimate of the global error, {self.estimate:.2e}, is above the tolerance {self.tol:.2e}: "
                + reason
            )
        self.progress(1.0)
        return run

    def _estimated(self, run: Run, tol: float, earlier: list[tuple[float, Run]], fast: float) -> float:
        """Return the error of a run: the largest of those that its differences from earlier ones tell."""
        found = 0.0
        for larger, other in earlier:
            ratio = min(tol / larger, LARGEST_RATIO) ** (SURE * self.method.power)
            found = max(found, difference(run, other, self.follower.motion.sizes, fast) * ratio / (1.0 - ratio))
        return found

    def _share(self, low: float, high: float) -> Callable[[float], object]:
        """Return the progress function of a part of the work."""
        return lambda done: self.progress(low + (high - low) * done)

    def _better(self, before: Run, run: Run) -> Run:
        """Return what is kept of an early end: a complete run with a larger error if it was stopped by hand."""
        if run.interrupted:
            self.warnings.append("stopped while the error was being reduced: its size is not known")
            return replace(before, interrupted=True)
        return run


def _result(begin: Start, follower: Follower, work: Work, run: Run, method: str, solver: str) -> Simulation:
    """Gather the samples of a run."""
    system, record = follower.system, Record.of(run.samples)
    samples = run.samples[: len(record.q)]
    run.interrupted = run.interrupted or len(samples) < len(run.samples)
    track, labels, driving = Track.of(samples), tuple(record.loads), tuple(record.efforts)
    moving = moving_joints(system.scene)
    return Simulation(
        names=tuple(system.names),
        bodies=tuple(body.name for body in system.scene.bodies),
        rows=tuple(str(row) for row in system.rows),
        times=np.array([s.t for s in samples]),
        q=record.q,
        u=record.u,
        a=record.a,
        nu=record.nu,
        positions=track.positions,
        rotations=track.rotations,
        velocities=track.velocities,
        spins=track.spins,
        loads=np.array([record.loads[x] for x in labels]).reshape(len(labels), len(samples)).T,
        load_names=labels,
        efforts=np.array([record.efforts[x] for x in driving]).reshape(len(driving), len(samples)).T,
        effort_names=driving,
        motions=record.motions,
        motion_rates=record.motion_rates,
        motion_names=tuple((motion_name(kind, item.name), MOTION_UNITS[kind]) for kind, item in moving),
        kinetic=record.kinetic,
        potential=record.potential,
        work=np.array([s.work for s in samples]),
        residuals=record.residuals,
        method=method,
        solver=solver,
        tol=math.nan if work.step is not None else work.tol,
        step=work.step,
        error_estimate=work.estimate,
        steps=run.steps,
        rejected=run.rejected,
        evaluations=work.evaluations,
        runs=work.runs,
        charts=run.charts,
        peak=run.peak,
        sizes=follower.motion.sizes,
        conservative=follower.energy.conservative,
        warnings=(*begin.warnings, *work.warnings, *work.notes),
        complete=run.complete,
        failure=run.failure,
    )
