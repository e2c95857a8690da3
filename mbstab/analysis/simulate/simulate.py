"""The nonlinear motion of a scene to a requested accuracy.

The tolerance is that of the result: the largest error of positions (in sizes of the scene), of
orientations (of entries of the rotation matrices) and of speeds (relative to the largest of the
motion; where nothing moves, to the part `TOLERANCES.resting_speed` of the natural rate of the scene) at
any output time. It is estimated from at least three runs with different tolerances per step, the first with one
`TOLERANCES.first_tolerance` times as large as that of the result. To which power of it the error is proportional is
assumed (`TOLERANCES.order_counted_on` times `Method.power`, and all of it far below), unless the runs show a smaller
power (`mbstab.analysis.simulate.estimate`). Runs are repeated with smaller tolerances until the estimate is below the
tolerance: the largest estimate from the two runs before, as the errors of two may agree by chance, without those that
differ by `TOLERANCES.difference_of_motions` or more.
The true error may exceed the estimate by the factor `TOLERANCES.error_factor`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from mbstab.analysis.algebra.budget import require_room
from mbstab.analysis.reference.efforts import MOTION_UNITS, motion_name, moving_joints
from mbstab.analysis.reference.outputs import Outputs
from mbstab.analysis.simulate.accuracy import Work, bumps
from mbstab.analysis.simulate.half_turns import beyond_half_turn
from mbstab.analysis.simulate.pace import Budget
from mbstab.analysis.simulate.recording import Record, Track
from mbstab.analysis.simulate.result import Simulation
from mbstab.analysis.simulate.run import Follower, Run
from mbstab.analysis.simulate.settings import SimulationSettings
from mbstab.analysis.simulate.start import Start, start_of
from mbstab.analysis.simulate.steppers.compiled import machine_code
from mbstab.analysis.simulate.tolerances import TOLERANCES
from mbstab.compiler.system import Array, System
from mbstab.errors import SimulationError, UsageError


def simulate(
    system: System,
    settings: SimulationSettings,
    progress: Callable[[float], object] = lambda done: None,
    tell: Callable[[str], object] = lambda text: None,
    force: bool = False,
) -> Simulation:
    """Return the motion that starts as the file and the settings say.

    Parameters
    ----------
    progress : callable
        Called with the fraction of the work that is done, from 0 to 1.
    tell : callable
        Called with messages that should appear before the end: warnings, which the result contains as well, and
        the expected duration and its reason, if it is long.
    force : bool
        Allow more memory than `mbstab.analysis.algebra.tolerances.Tolerances.estimated_memory`.

    Raises
    ------
    UsageError
        If the end is not after the start, or a name is unknown.
    SimulationError
        If the motion cannot be followed to the end; `partial` contains the finished part.
    """
    if settings.compiled:
        machine_code()
    if not force:
        require_room(settings.points, _numbers(system), "output times")
    begin = start_of(system, settings.perturb, settings.start, settings.strict)
    for text in begin.notes:
        tell(text)
    first = begin.motion.time
    last = settings.end(first)
    times = np.linspace(first, last, settings.points)
    follower = Follower(begin.system, begin.motion, times, through=settings.through_singular)
    follower.tell, follower.budget = tell, Budget(first, last)
    tol, step = settings.tol, settings.step
    work = Work(follower, settings.stepping, tol, step, settings.compiled, progress)
    lost = math.ulp(max(abs(first), abs(last)))
    if lost * work.natural > TOLERANCES.time_resolution:
        raise UsageError(
            f"times up to {last:g} s are known to {lost:.1e} s only in double precision, where the scene moves within "
            f"{1.0 / work.natural:.1e} s\nhint: an earlier end, and a start nearer to 0 with --from"
        )
    run = work.once(tol) if step is not None or settings.once else work.refined()
    follower.settle(run)
    if not run.stretches:
        raise SimulationError(run.failure or "stopped before anything was found", None)
    result = _result(begin, follower, work, run, settings, last)
    if not run.complete:
        raise SimulationError(_reason(run, result), result)
    return result


def _reason(run: Run, result: Simulation) -> str:
    """Return why a motion ended early, and what is kept of it."""
    if result.complete:
        return "stopped before its error was reduced to the tolerance\nthe motion is kept as it was found before"
    reason = run.failure or f"stopped at t = {run.reached:.9g} s"
    return f"{reason}\nthe part until t = {result.times[-1]:.9g} s is kept" if len(result.times) else reason


def without_value(times: Array, values: Array, names: Sequence[tuple[str, str]]) -> list[str]:
    """Return a warning for each output that has no value at some time."""
    missing = ~np.isfinite(values)
    return [
        f"outputs.{name} has no value at t = {times[int(np.argmax(missing[:, i]))]:.6g} s"
        + (f" and {int(np.sum(missing[:, i])) - 1} other output times" if np.sum(missing[:, i]) > 1 else "")
        for i, (name, _) in enumerate(names)
        if np.any(missing[:, i])
    ]


def _numbers(system: System) -> int:
    """Return how many numbers an output time takes in memory."""
    d, bodies = system.scene.dimension, len(system.scene.bodies)
    moving = len(moving_joints(system.scene))
    results = (
        3 * system.n_q
        + system.n_c
        + bodies * (2 * d + d * d + 3)
        + 6 * len(system.scene.items)
        + 2 * moving
        + 6
        + len(system.scene.model.outputs)
    )
    return results + TOLERANCES.runs_least * (2 * system.n_q + TOLERANCES.memory_of_state)


def _result(
    begin: Start, follower: Follower, work: Work, run: Run, settings: SimulationSettings, last: float
) -> Simulation:
    """Return the simulation of a run; it is complete if it reaches the last time."""
    system, record, track = follower.system, Record.of(run.stretches), Track.of(run.stretches)
    times, work_done = (np.concatenate([getattr(x, name) for x in run.stretches]) for name in ("times", "work"))
    count = len(record.q)
    run.interrupted = run.interrupted or count < len(times)
    outputs = Outputs(system).names
    labels, driving, moving = tuple(record.loads), tuple(record.efforts), moving_joints(system.scene)
    return Simulation(
        names=tuple(system.names),
        units=system.units,
        bodies=tuple(body.name for body in system.scene.bodies),
        rows=tuple(str(row) for row in system.rows),
        times=times[:count],
        q=record.q,
        u=record.u,
        a=record.a,
        nu=record.nu,
        positions=track.positions[:count],
        rotations=track.rotations[:count],
        velocities=track.velocities[:count],
        spins=track.spins[:count],
        loads=np.array([record.loads[x] for x in labels]).reshape(len(labels), count).T,
        load_names=labels,
        efforts=np.array([record.efforts[x] for x in driving]).reshape(len(driving), count).T,
        effort_names=driving,
        motions=record.motions,
        motion_rates=record.motion_rates,
        motion_names=tuple((motion_name(kind, item.name), MOTION_UNITS[kind]) for kind, item in moving),
        outputs=record.outputs,
        output_names=outputs,
        kinetic=record.kinetic,
        potential=record.potential,
        work=work_done[:count],
        residuals=record.residuals,
        method=settings.method,
        solver=settings.solver,
        tol=math.nan if work.step is not None else work.tol,
        step=work.step,
        error_estimate=work.estimate,
        steps=run.steps,
        rejected=run.rejected,
        evaluations=work.evaluations,
        runs=work.runs,
        charts=run.charts,
        peak=run.peak,
        sizes=follower.motion.sizes.copy(),
        conservative=follower.energy.conservative,
        warnings=(
            *begin.warnings,
            *work.warnings,
            *work.notes,
            *without_value(times[:count], record.outputs, outputs),
            *bumps(system, times[:count], record.q, record.u, work.step or work.longest),
            *beyond_half_turn(system.scene, times[:count], record.motions),
        ),
        complete=not run.failure and count == len(times) and run.reached >= last,
        failure=run.failure,
    )
