"""One run of a method over a span of time: output, charts, a watch on the rank, and work.

A run gives samples at the times asked for. Wherever it ends early, by a failure or by hand, the
samples so far are kept.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from mbstab.analysis.attitude import Attitudes
from mbstab.analysis.constrained import SINGULAR, Constrained, Form, Watch
from mbstab.analysis.energy import NODES, WEIGHTS, Energy
from mbstab.analysis.integrators import Method, Options, Stepper, first_step
from mbstab.analysis.marching import Marching
from mbstab.analysis.motion import Motion
from mbstab.analysis.samples import Frame, Sample, Track
from mbstab.compiler.system import Array, Dynamics, System
from mbstab.errors import MbstabError

LEAST_PROGRESS = 0.002
"""The progress function is called when this part of the work is done."""

LOOKED = 5
"""Where compiled steps leave something to others, so many are taken one by one."""


@dataclass
class Run:
    """What a run found.

    Attributes
    ----------
    samples : list of Sample
    steps, rejected, evaluations, charts : int
        `charts` counts how often Euler angles were replaced by others.
    reached : float (s)
    peak : float (J)
        The largest kinetic energy after any step; that of speeds as good as rest at least.
    drift : float
        The largest residual of a constraint row after any step, relative to sizes and speeds in the scene.
    failure : str
        Why it ended early, or empty.
    interrupted : bool
    """

    samples: list[Sample] = field(default_factory=list)
    steps: int = 0
    rejected: int = 0
    evaluations: int = 0
    charts: int = 0
    reached: float = 0.0
    peak: float = 0.0
    drift: float = 0.0
    failure: str = ""
    interrupted: bool = False

    @property
    def complete(self) -> bool:
        """Whether it reached its end."""
        return not self.failure and not self.interrupted


class Follower:
    """Follows the motion from a state, any number of times.

    Parameters
    ----------
    system : System
    motion : Motion
        The motion at the start: its state, and ranks and scales that are kept.
    times : ndarray, shape (n_t,)
        Times of output (s), ascending; the first is the start.
    form : Form, optional
        What evaluates the scene, where others use it as well.
    """

    def __init__(self, system: System, motion: Motion, times: Array, form: Form | None = None) -> None:
        self.system, self.motion, self.times = system, motion, times
        self.attitudes = Attitudes.of(system)
        self.energy = Energy.of(system, self.attitudes)
        self.form = form or Form(system)
        self.parts = self.working_parts(system)
        self._marching: Marching | None = None

    def marching(self, equations: Constrained, solver: str) -> Marching:
        """Return compiled steps of the scene."""
        if self._marching is None:
            self._marching = Marching(equations, self.attitudes, self.energy, solver)
        return self._marching

    def working_parts(self, system: System) -> dict[str, Form]:
        """Return the forces without a potential, each alone, in the coordinates of `system`."""
        wanted = {*self.energy.working, *self.energy.damped}
        return {path: Form(part) for path, part in system.parts() if path in wanted} if wanted else {}

    def run(self, method: Method, options: Options, progress: Callable[[float], object]) -> Run:
        """Follow the motion; failures end the run and are kept in it."""
        run = Run(reached=float(self.times[0]))
        leg = _Leg(self, run)
        run.peak = leg.equations.least_energy
        try:
            leg.sample(float(self.times[0]), self.motion.q, self.motion.u)
            leg.follow(method, options, progress)
        except KeyboardInterrupt:
            run.interrupted = True
        except (ArithmeticError, np.linalg.LinAlgError) as error:
            run.failure = f"the motion leaves the range of double precision near t = {run.reached:.9g} s: {error}"
        except MbstabError as error:
            run.failure = str(error)
        run.evaluations += leg.equations.evaluations
        return run


class _Leg:
    """The state of a run: the present chart, the watch, the work so far."""

    def __init__(self, follower: Follower, run: Run) -> None:
        self.follower, self.run = follower, run
        self.attitudes, self.energy = follower.attitudes, follower.energy
        self.system, self.motion = follower.system, follower.motion
        self.equations = Constrained(self.system, self.motion, follower.form)
        self.watch: Watch = self.equations.refresh(self.motion.dynamics)
        self.frame: Frame | None = None
        self.work = 0.0
        self.parts = follower.parts
        self.done = 1  # times of output
        self.least = 0.0

    def follow(self, method: Method, options: Options, progress: Callable[[float], object]) -> None:
        times, run = self.follower.times, self.run
        t, end = float(times[0]), float(times[-1])
        q, u = self.motion.q, self.motion.u
        shown = 0.0

        def reached(t: float) -> None:
            nonlocal shown
            run.reached = t
            if (t - times[0]) / (end - times[0]) > shown + LEAST_PROGRESS:
                shown = (t - times[0]) / (end - times[0])
                progress(shown)

        q, u = self._change_chart(q, q, u, t)
        while t < end:
            if options.compiled and self.equations.independent:
                t, q, u, before, options = self._march(t, q, u, options, reached)
                if t >= end:
                    break
                if self.attitudes.needs_change(self.system, before, q):
                    q, u = self._change_chart(before, q, u, t)
                    continue
            stepper = method.start(self.equations, t, q, u, end, options)
            steps = 0
            while True:
                before = stepper.q
                stepper.advance()
                steps += 1
                run.steps += 1
                run.peak = max(run.peak, 0.5 * float(stepper.u @ stepper.state.M @ stepper.u))
                run.drift = max(run.drift, *self.equations.residuals(stepper.state, self.equations.fastest(stepper.u)))
                self._watch(stepper, t)
                change = self.attitudes.needs_change(self.system, before, stepper.q)
                self._cover(stepper, t, self._due(stepper.t))
                t = stepper.t
                reached(t)
                if t >= end or change or (options.compiled and steps >= LOOKED):
                    break
            run.rejected += stepper.rejected
            options = replace(options, first=stepper.taken)
            if t < end:
                # Implicit methods leave speeds a little off their constraints: the new start must satisfy them.
                q, u, _ = self.equations.project(t, stepper.q, stepper.u)
                q, u = self._change_chart(before, q, u, t)
        progress(1.0)

    def _due(self, t: float) -> list[float]:
        """Return the times of output until t that were not covered before."""
        first = self.done
        while self.done < len(self.follower.times) and self.follower.times[self.done] <= t:
            self.done += 1
        return [float(x) for x in self.follower.times[first : self.done]]

    def _march(
        self, t: float, q: Array, u: Array, options: Options, reached: Callable[[float], None]
    ) -> tuple[float, Array, Array, Array, Options]:
        """Take compiled steps as far as they go; return the state there, q before the last step, and the options."""
        run, n = self.run, len(q)
        marching, base, covered = self.follower.marching(self.equations, options.solver), self.work, 0
        times = self.follower.times[self.done :]
        if options.first is None:
            options = replace(options, first=first_step(self.equations, t, q, u, float(times[-1]), options))
        reason = marching.start(self.system, t, q, u, times, options, self.least)
        state = marching.state
        while True:
            for time, found in zip(times[covered : state.done], state.found[covered : state.done], strict=True):
                self.work = base + float(found[2 * n])
                self.sample(float(time), found[:n], found[n : 2 * n], settled=True)
            covered = state.done
            reached(state.time)
            if reason != "more":
                break
            reason = marching.go()
        if reason == "look":
            self.watch = self.equations.refresh(self.equations.evaluate(state.time, state.q, state.u))
        self.least, self.work = state.least, base + state.work
        self.done += covered
        run.steps += state.steps
        run.rejected += state.rejected
        run.peak, run.drift = max(run.peak, state.peak), max(run.drift, state.drift)
        self.equations.evaluations += state.evaluations
        return state.time, state.q, state.u, state.before, replace(options, first=state.following)

    # --- charts -----------------------------------------------------------------------------------------------------

    def _change_chart(self, before: Array, q: Array, u: Array, t: float) -> tuple[Array, Array]:
        if not self.attitudes.needs_change(self.system, before, q):
            return q, u
        self.system, q, u = self.attitudes.changed(self.system, q, u)
        self.run.charts += 1
        self.run.evaluations += self.equations.evaluations + 1
        state = self.system.dynamics(q, u, t)
        old = self.equations
        self.equations = Constrained(self.system, replace(self.motion, dynamics=state))
        self.equations.start_from(old)
        self.watch = self.equations.refresh(state)
        self.parts = self.follower.working_parts(self.system)
        return q, u

    # --- rank -------------------------------------------------------------------------------------------------------

    def _watch(self, stepper: Stepper, t: float) -> None:
        """Look for a singular configuration within the last step."""
        equations = self.equations
        if not equations.rank:
            return
        state = stepper.state
        found = equations.refresh(state)
        if equations.flipped(self.watch, state, found):
            self._search(stepper, t)
        self.watch = found

    def _at(self, stepper: Stepper, t: float) -> Dynamics:
        """Return the matrices at a time within the last step, with Euler angles that are not singular there."""
        q, u = stepper.at(t) if t != stepper.t else (stepper.q, stepper.u)
        if self.attitudes.needs_change(self.system, q, q):
            system, q, u = self.attitudes.changed(self.system, q, u)
            self.run.evaluations += 1
            return system.dynamics(q, u, t)
        return self.equations.evaluate(t, q, u)

    def _search(self, stepper: Stepper, start: float) -> None:
        """Find where in the last step the constraints are closest to losing rank; refuse if they do."""
        from scipy.optimize import minimize_scalar

        def smallness(t: float) -> float:
            return self.equations.smallness(self._at(stepper, t))

        grid = np.linspace(start, stepper.t, 9)
        values = [smallness(float(t)) for t in grid]
        k = int(np.argmin(values))
        low, high = float(grid[max(k - 1, 0)]), float(grid[min(k + 1, 8)])
        found = minimize_scalar(smallness, bounds=(low, high), method="bounded", options={"xatol": 1e-9 * (high - low)})
        t, least = min([(float(found.x), float(found.fun)), (float(grid[k]), values[k])], key=lambda x: x[1])
        if least <= SINGULAR:
            self.run.reached = start
            raise self.equations.singular(t, self._at(stepper, t), least)

    # --- output -----------------------------------------------------------------------------------------------------

    def _cover(self, stepper: Stepper, t: float, inside: list[float]) -> None:
        """Take the samples within the last step, and add up the work."""
        for time in inside:
            self._add_work(stepper, t, time)
            t = time
            self.sample(time, *(stepper.at(time) if time != stepper.t else (stepper.q, stepper.u)))
        self._add_work(stepper, t, stepper.t)

    def _add_work(self, stepper: Stepper, start: float, stop: float) -> None:
        if self.energy.conservative or stop <= start:
            return
        half = 0.5 * (stop - start)
        for node, weight in zip(NODES, WEIGHTS, strict=True):
            t = start + half * (1.0 + node)
            q, u = stepper.at(t)
            _, nu, state = self.equations.accelerations(t, q, u)
            self.work += half * weight * self.energy.power(self.parts, q, u, t, state, nu)

    def sample(self, t: float, q: Array, u: Array, settled: bool = False) -> None:
        """Record the motion at a time, projected onto the constraints if it is not `settled` there."""
        if not settled:
            q, u, _ = self.equations.project(t, q, u)
        if self.frame is None or self.frame.equations is not self.equations:
            self.frame = Frame(self.equations, self.attitudes, self.energy, self.motion.q)
        self.run.samples.append(Sample(self.frame, t, q, u, self.work))


def difference(one: Run, other: Run, sizes: Array, fast: float | None = None) -> float:
    """Return how much two runs differ: the largest difference of places, orientations and speeds at common times.

    Lengths count in the size of the scene, orientations by the entries of rotation matrices, speeds and
    angular velocities relative to the largest, or to `fast` (1/s).
    """
    count = min(len(one.samples), len(other.samples))
    length = float(np.max(sizes))
    fast = fastest(other, length) if fast is None else fast
    a, b = Track.of(one.samples[:count]), Track.of(other.samples[:count])
    worst = max(
        _largest(a.positions - b.positions) / length,
        _largest(a.rotations - b.rotations),
        _largest(a.velocities - b.velocities) / (length * fast),
        _largest(a.spins - b.spins) / fast,
    )
    return worst if math.isfinite(worst) else math.inf


def fastest(run: Run, length: float) -> float:
    """Return the largest speed over the size of the scene, or the largest angular velocity (1/s)."""
    track = Track.of(run.samples)
    return max(_largest(np.linalg.norm(track.velocities, axis=-1)) / length, _largest(track.spins)) or 1.0


def _largest(x: Array) -> float:
    return float(np.max(np.abs(x), initial=0.0))
