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

import numpy as np

from mbstab.analysis.algebra import budget
from mbstab.analysis.reference.efforts import MOTION_UNITS, motion_name, moving_joints
from mbstab.analysis.simulate.accuracy import LEAST_RUNS, Work
from mbstab.analysis.simulate.recording import Record, Track
from mbstab.analysis.simulate.result import Simulation
from mbstab.analysis.simulate.run import Follower, Run
from mbstab.analysis.simulate.start import Start, start_of
from mbstab.analysis.simulate.steppers.compiled import machine_code
from mbstab.analysis.simulate.steppers.interface import Method
from mbstab.analysis.simulate.steppers.table import METHODS
from mbstab.analysis.simulate.time_budget import Budget
from mbstab.compiler.system import System
from mbstab.errors import SimulationError, UsageError

TRUST = 3.0
"""The error of a result is below this factor times the tolerance, if no warning says that the tolerance is not met."""


MOST_STEPS = 1e9
"""Of fixed size."""


SAMPLE = 40
"""Numbers that would take as much memory as what surrounds a state that is kept."""

RESOLVED = 1e-3
"""Part of the natural time of a scene within which the time has to be known."""

LONGEST = 10.0
"""Duration of a simulation whose end is not given (s)."""


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
