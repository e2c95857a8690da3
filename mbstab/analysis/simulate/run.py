"""One run of a method over a span of time: output, charts, monitoring of the rank, and work.

A run gives the motion at the requested times from the polynomials of its steps; `Follower.settle` puts it onto the
constraints. If a run ends early, by a failure or an interrupt, the part so far is kept.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import field, replace
from functools import cached_property

import numpy as np

from mbstab.analysis.algebra.arrays import Index
from mbstab.analysis.reference.attitude import Attitudes
from mbstab.analysis.reference.motion import Motion
from mbstab.analysis.simulate.constrained import BRANCH_HINT, LIMIT_HINT, Constrained, Watch
from mbstab.analysis.simulate.energy import Energy
from mbstab.analysis.simulate.recording import Frame, Recorder, Stretch, Track, joined
from mbstab.analysis.simulate.singular_passage import NODES as NODES_OF_PASSAGE
from mbstab.analysis.simulate.singular_passage import Passage, passage, predicted
from mbstab.analysis.simulate.steppers.compiled import Marching
from mbstab.analysis.simulate.steppers.interface import HINT, Method, Options, Stepper
from mbstab.analysis.simulate.stiffness import Pace
from mbstab.analysis.simulate.time_budget import Budget
from mbstab.analysis.simulate.tolerances import TOLERANCES
from mbstab.analysis.spectrum.tolerances import TOLERANCES as SPECTRUM
from mbstab.compiler.form import Form
from mbstab.compiler.system import Array, Dynamics, System
from mbstab.errors import ConstraintError, MbstabError, NumericalError
from mbstab.model.units import per_second
from mbstab.records import dataclass

RUNAWAY_HINT = (
    "hint: end before (--to); if it should not grow, look for what feeds it, such as a gain or a damping of wrong sign"
)

LISTED = 8
"""Maximum number of times of passages that are listed."""


@dataclass
class Run:
    """The result of a run.

    Attributes
    ----------
    stretches : list of Stretch
        The motion at the output times.
    steps, rejected, evaluations, charts : int
        `charts` is the number of changes of Euler angles.
    reached : float (s)
    peak : float (J)
        The largest kinetic energy after any step, but at least that of speeds that count as rest.
    drift : float
        The largest residual of a constraint row after any step, relative to sizes and speeds in the scene.
    failure : str
        Why it ended early, or empty.
    interrupted : bool
    notes : list of str
        Messages to the user about the result.
    passed : list of (float, str)
        Times at which singular configurations were passed (s), and the rows that depend on each other there.
    """

    stretches: list[Stretch] = field(default_factory=list)
    steps: int = 0
    rejected: int = 0
    evaluations: int = 0
    charts: int = 0
    reached: float = 0.0
    peak: float = 0.0
    drift: float = 0.0
    failure: str = ""
    interrupted: bool = False
    notes: list[str] = field(default_factory=list)
    passed: list[tuple[float, str]] = field(default_factory=list)

    @cached_property
    def track(self) -> Track:
        """The bodies at all output times, at least one, before they are settled, of a run that has ended."""
        return Track.of(self.stretches)

    @property
    def complete(self) -> bool:
        """Whether the run reached its end."""
        return not self.failure and not self.interrupted


class Follower:
    """Follows the motion from a state, any number of times.

    Parameters
    ----------
    system : System
    motion : Motion
        The motion at the start: its state, and ranks and scales that are kept.
    times : ndarray, shape (n_t,)
        Output times (s), ascending; the first is the start.
    form : Form, optional
        Evaluates the scene, if it is shared.
    through : bool
        Continue through singular configurations where the motion is smooth, instead of refusing them.
    work : bool
        Sum the work of forces and drives without a potential; if not, the work of all samples is 0.

    Attributes
    ----------
    tell : callable
        Called with messages that should appear before a run ends.
    budget : Budget or None
        The time budget of all runs.
    """

    def __init__(
        self,
        system: System,
        motion: Motion,
        times: Array,
        form: Form | None = None,
        through: bool = False,
        work: bool = True,
    ) -> None:
        self.system, self.motion, self.times, self.through, self.work = system, motion, times, through, work
        self.attitudes = Attitudes.of(system)
        self.energy = Energy.of(system)
        self.form = form or Form(system)
        self.note = ""
        self.tell: Callable[[str], object] = lambda text: None
        self.budget: Budget | None = None
        self._marching: Marching | None = None

    def marching(self, equations: Constrained, method: Method) -> Marching:
        """Return compiled steps of the scene."""
        if self._marching is None:
            self._marching = Marching(equations, self.attitudes, self.energy, method)
        return self._marching

    def run(self, options: Options, progress: Callable[[float], object]) -> Run:
        """Follow the motion; failures end the run and are recorded in it."""
        run = Run(reached=float(self.times[0]))
        leg = _Leg(self, run, options.method.order)
        pace = Pace(options, float(self.times[-1]), self.note, self.tell, self.budget)
        run.peak = leg.equations.least_energy
        try:
            leg.begin()
            leg.follow(options, progress, pace)
        except KeyboardInterrupt:
            run.interrupted = True
        except (ArithmeticError, np.linalg.LinAlgError) as error:
            reason = f"the motion leaves the range of double precision near t = {run.reached:.9g} s: {error}"
            run.failure = leg.attributed(reason)
        except NumericalError as error:
            run.failure = leg.attributed(str(error))
        except MbstabError as error:
            run.failure = str(error)
        leg.recorder.close()
        self.note = pace.note
        if options.step is not None and run.failure and "\nhint: " not in run.failure:
            run.failure += "\nhint: take a shorter step with --step"
        if pace.note and not run.failure:
            run.notes.append(pace.note)
        if run.passed:
            run.notes.append(_passed(run.passed))
        run.evaluations += leg.equations.evaluations
        return run

    def settle(self, run: Run) -> None:
        """Put the output of a run onto the constraints and sum its work; failures are recorded in it."""
        done: list[Stretch] = []
        before = 0.0
        try:
            for stretch in run.stretches:
                worked = stretch.with_work(self.energy)
                for part in worked.on_constraints(before):
                    done.append(part)
                before += worked.done
        except KeyboardInterrupt:
            run.interrupted = True
        except NumericalError as error:
            run.failure = run.failure or str(error)
        run.stretches = joined(done)


def _passed(found: list[tuple[float, str]]) -> str:
    """Return the message about singular configurations that were passed."""
    times = ", ".join(f"{t:.6g}" for t, _ in found[:LISTED])
    if len(found) > LISTED:
        times += f", … ({len(found)} times)"
    owners = ", ".join(dict.fromkeys(name for _, names in found for name in names.split(", ")))
    return (
        f"the motion passed singular configurations at t = {times} s, where these rows depend on each other: {owners}; "
        "it was continued smoothly, but could have gone on in another way there, and reactions may grow without bound"
    )


class _Singular(Exception):
    """A singular configuration ahead: its time (s), exact or approximate, and the error about it."""

    def __init__(self, time: float, error: ConstraintError) -> None:
        super().__init__(str(error))
        self.time, self.error = time, error


class _Leg:
    """The state of a run: the present chart, the singular value watched, the output so far."""

    def __init__(self, follower: Follower, run: Run, order: int) -> None:
        self.follower, self.run = follower, run
        self.attitudes, self.energy = follower.attitudes, follower.energy
        self.system, self.motion = follower.system, follower.motion
        self.equations = Constrained(self.system, self.motion, follower.form)
        self.watch: Watch = self.equations.refresh(self.motion.dynamics)
        working = follower.work and not self.energy.conservative
        self.recorder = Recorder(run.stretches, self.energy, order if working else 0)
        self.least, self.looked = 0.0, TOLERANCES.looked_steps
        self.done, self.shown = 1, 0.0
        self.fall, self.tried, self.given_up = 0.0, math.inf, 0
        self.last, start = (float(follower.times[0]), self.motion.u), self.motion
        falling = math.hypot(*map(float, self.system.scene.gravity)) / float(np.max(start.sizes))
        pulled = max(falling, float(np.max(np.abs(start.a / start.sizes), initial=0.0)))
        span = float(follower.times[-1] - follower.times[0])
        self.begun = max(self.equations.fastest(start.u), math.sqrt(pulled), 1.0 / span)

    def begin(self) -> None:
        """Take the first state."""
        q, u, _ = self.equations.project(float(self.follower.times[0]), self.motion.q, self.motion.u)
        self.recorder.in_frame(Frame(self.equations, self.attitudes, self.motion.q))
        self.recorder.add(self.follower.times[:1], q[None], u[None], np.zeros(1), 0.0)

    def follow(  # noqa: PLR0915 (the loop of steps, with all that may end one)
        self, options: Options, progress: Callable[[float], object], pace: Pace
    ) -> None:
        run, end = self.run, float(self.follower.times[-1])
        t, q, u = float(self.follower.times[0]), self.motion.q, self.motion.u
        steeper, limit = options.rate, end
        self.rate = options.rate
        q, u = self._change_chart(q, q, u, t)
        while t < end:
            if self._marches(options):
                t, q, u, before, options = self._march(t, q, u, limit, options, progress, pace)
                if t >= end:
                    break
                limit = limit if t < limit else end
                q, u, _ = self.equations.project(t, q, u)  # as below
                if self.attitudes.needs_change(self.system, before, q):
                    q, u = self._change_chart(before, q, u, t)
                    continue
            stepper = options.method.start(self.equations, t, q, u, limit, options)
            passed: Passage | None = None
            started = run.steps
            again = False
            while True:
                before, speeds = stepper.q, stepper.u
                try:
                    self._advance(stepper, t, options)
                    self._watch(stepper, t)
                except _Singular as found:
                    if not self.follower.through:
                        raise found.error from None
                    passed = self._passage(t, found.time, before, speeds, options)
                    if passed is None:
                        # From a nearer state the passage is shorter.
                        limit = self._halfway(t, found, before, speeds)
                        q, u, again = before, speeds, True
                        break
                if passed is None:
                    change = self.attitudes.needs_change(self.system, before, stepper.q)
                    self._finish(stepper, t, progress)
                    t = stepper.t
                    if t < limit and self.follower.through and self._falling():
                        passed = self._passage(t, self._ahead(stepper), stepper.q, stepper.u, options)
                if passed is not None:
                    self._finish(passed, passed.start, progress)
                    t = passed.t
                    break
                if t >= limit:
                    break
                pace.look(run.steps, stepper, self.equations, options)
                if change or (steeper := self._steeper(stepper, options)) > options.rate:
                    break
                if options.compiled and run.steps >= started + self.looked:
                    break
            run.rejected += stepper.rejected
            if again:
                options = replace(options, first=None)
                continue
            limit = end
            options = replace(options, first=stepper.taken or None, rate=max(steeper, options.rate))
            if t < end:
                # Implicit methods leave speeds slightly off their constraints: the new start must satisfy them.
                last = passed or stepper
                q, u, _ = self.equations.project(t, last.q, last.u)
                q, u = self._change_chart(before, q, u, t)
        progress(1.0)

    def _marches(self, options: Options) -> bool:
        """Return whether compiled steps may be taken; these do not count turns."""
        return options.compiled and self.equations.independent and not self.attitudes.counted

    def _finish(self, stepper: Stepper, t: float, progress: Callable[[float], object]) -> None:
        """Record a step from a time: output, work, extremes."""
        run, times = self.run, self.follower.times
        run.steps += 1
        self.last = (stepper.t, stepper.u)
        run.peak = max(run.peak, 0.5 * float(stepper.u @ stepper.state.M @ stepper.u))
        run.drift = max(run.drift, *self.equations.residuals(stepper.state, self.equations.fastest(stepper.u)))
        first, self.done = self.done, int(np.searchsorted(times, stepper.t, "right"))
        inside = times[first : self.done]
        if isinstance(stepper, Passage):
            q, u = stepper.at(inside)
            work, done = stepper.work(inside, self._power) if self.recorder.works else (np.zeros(len(inside)), 0.0)
            self.recorder.add(inside, q, u, work, done, stepper.acceleration(inside))
        else:
            self.recorder.take(stepper, t, inside)
        self._reached(stepper.t, progress)

    def _reached(self, t: float, progress: Callable[[float], object]) -> None:
        times = self.follower.times
        self.run.reached = t
        part = (t - times[0]) / (times[-1] - times[0])
        if part > self.shown + TOLERANCES.progress_shown:
            self.shown = float(part)
            progress(self.shown)

    def _march(
        self,
        t: float,
        q: Array,
        u: Array,
        limit: float,
        options: Options,
        progress: Callable[[float], object],
        pace: Pace,
    ) -> tuple[float, Array, Array, Array, Options]:
        """Take compiled steps as far as possible; return the state there, q before the last step, and the options."""
        run, n, covered, worked = self.run, len(q), 0, 0.0
        times, steps = self.follower.times[self.done :], run.steps
        near = TOLERANCES.passage_tried_from if self.follower.through else TOLERANCES.singular_failure
        state = self.follower.marching(self.equations, options.method)
        state.start(self.system, t, q, u, times, limit, options, self.least, near)
        while True:
            reason = state.go()
            found = state.found[covered : state.done]
            work = found[:, 2 * n] - worked
            self.recorder.add(times[covered : state.done], found[:, :n], found[:, n : 2 * n], work, state.work - worked)
            covered, worked = state.done, state.work
            run.steps = steps + state.steps
            self._reached(state.t, progress)
            if reason != "more":
                break
            pace.look(run.steps, state, self.equations, options)
        if reason != "chart":
            self.watch = self.equations.refresh(self.equations.evaluate(state.t, state.q, state.u))
        self.least, self.last = state.least, (state.t, state.u)
        self.looked = TOLERANCES.looked_steps if state.steps else min(2 * self.looked, TOLERANCES.looked_steps_most)
        self.done += covered
        run.rejected += state.rejected
        run.peak, run.drift = max(run.peak, state.peak), max(run.drift, state.residual)
        self.equations.evaluations += state.evaluations
        return state.t, state.q, state.u, state.before, replace(options, first=state.following)

    # --- charts -----------------------------------------------------------------------------------------------------

    def _change_chart(self, before: Array, q: Array, u: Array, t: float) -> tuple[Array, Array]:
        if not self.attitudes.needs_change(self.system, before, q):
            return q, u
        bodies = self.system.scene.bodies
        self.system, q, u = self.attitudes.changed(self.system, q, u)
        self.run.charts += bodies != self.system.scene.bodies
        self.run.evaluations += self.equations.evaluations + 1
        state = self.system.dynamics(q, u, t)
        old = self.equations
        self.equations = Constrained(self.system, replace(self.motion, dynamics=state))
        self.equations.start_from(old)
        self.watch = self.equations.refresh(state)
        self.recorder.in_frame(Frame(self.equations, self.attitudes, self.motion.q))
        return q, u

    # --- rank -------------------------------------------------------------------------------------------------------

    def _watch(self, stepper: Stepper, t: float) -> None:
        """Check for a singular configuration within the last step."""
        equations = self.equations
        if not equations.rank:
            return
        state = stepper.state
        found = equations.refresh(state)
        if equations.flipped(self.watch, state, found):
            self._search(stepper, t)
        self.fall = (self.watch.value - found.value) / stepper.taken
        self.watch = found

    def _steeper(self, stepper: Stepper, options: Options) -> float:
        """Return the rate that counts as fast from now on (1/s).

        Where a mechanism reaches a limit, speeds grow as the inverse of the smallest singular value: the tolerance is
        relative to the largest, and their change within the rounding of the time cannot be known.
        """
        equations, state = self.equations, stepper.state
        if options.step is not None or not equations.remaining(self.watch) < TOLERANCES.singular_nearby:
            return options.rate
        growth, _ = equations.solve(state, -state.F0, state.B)
        rounding = TOLERANCES.roundings_of_time * math.ulp(stepper.t) * equations.fastest(growth) / options.tol
        found = max(equations.fastest(stepper.u), rounding)
        return found if found > TOLERANCES.speed_growth_near_singular * options.rate else options.rate

    def _advance(self, stepper: Stepper, t: float, options: Options) -> None:
        """Take a step from a time; a failure near a singular configuration is attributed to it."""
        try:
            stepper.advance()
            if options.step is not None and stepper.taken < TOLERANCES.fixed_step_shortened * min(
                options.step, self.follower.times[-1] - t
            ):
                raise NumericalError(
                    f"the step of {options.step:.3g} s fails at t = {t:.9g} s: its error is not finite\n"
                    "hint: take a shorter one with --step"
                )
        except NumericalError as error:
            if self._runs_away or not self.equations.remaining(self.watch) < TOLERANCES.singular_failure:
                raise
            near = self.equations.approached(t, self.watch, str(error).partition("\n")[0])
            raise _Singular(t + self.watch.value / self.fall if self.fall > 0.0 else math.inf, near) from None

    def _at(self, stepper: Stepper, t: float) -> Dynamics:
        """Return the matrices at a time within the last step, with Euler angles that are not singular there."""
        q, u = stepper.at(t) if t != stepper.t else (stepper.q, stepper.u)
        if self.attitudes.needs_change(self.system, q, q):
            system, q, u = self.attitudes.changed(self.system, q, u)
            self.run.evaluations += 1
            return system.dynamics(q, u, t)
        return self.equations.evaluate(t, q, u)

    def _search(self, stepper: Stepper, start: float) -> None:
        """Find where in the last step the constraints are closest to losing rank; raise an error if they do."""
        from scipy.optimize import minimize_scalar

        def smallness(t: float) -> float:
            return self.equations.smallness(self._at(stepper, t))

        grid = np.linspace(start, stepper.t, 9)
        values = [smallness(float(t)) for t in grid]
        k = int(np.argmin(values))
        low, high = float(grid[max(k - 1, 0)]), float(grid[min(k + 1, 8)])
        found = minimize_scalar(smallness, bounds=(low, high), method="bounded", options={"xatol": 1e-9 * (high - low)})
        t, least = min([(float(found.x), float(found.fun)), (float(grid[k]), values[k])], key=lambda x: x[1])
        if least <= SPECTRUM.constraints_singular:
            self.run.reached = start
            grown = self.equations.fastest(stepper.u) > TOLERANCES.speed_growth_at_limit * self.rate
            hint = LIMIT_HINT if grown else BRANCH_HINT
            raise _Singular(t, self.equations.singular(t, self._at(stepper, t), least, hint))

    # --- runaway ----------------------------------------------------------------------------------------------------

    @property
    def _growth(self) -> float:
        """How often the fastest rate of the last state contains the rate at the start."""
        return self.equations.fastest(self.last[1]) / self.begun

    @property
    def _runs_away(self) -> bool:
        """Whether speeds have grown far more than a singular configuration nearby explains: as its inverse distance."""
        part = self.equations.remaining(self.watch)
        return self._growth * min(part, 1.0) > TOLERANCES.speed_growth_at_limit

    def attributed(self, reason: str) -> str:
        """Return why a motion failed: with the growth of its speeds, if they have grown without bound."""
        if not self._runs_away:
            return reason
        (t, u), names = self.last, self.system.names
        k = int(np.argmax(np.abs(u / self.equations.sizes)))
        speed = f"{u[k]:.3g} {per_second(self.system.units[k])}"
        return (
            f"the motion runs away: at t = {t:.9g} s {names[k]} has {speed}, and rates are "
            f"{self._growth:.1e} times those at the start\nthere {reason.removesuffix(HINT).rstrip()}\n{RUNAWAY_HINT}"
        )

    # --- through singular configurations ----------------------------------------------------------------------------

    def _falling(self) -> bool:
        """Return whether a singular configuration is near and approaching, so that a passage should be tried."""
        if not self.equations.remaining(self.watch) < TOLERANCES.passage_tried_from:
            self.tried = math.inf
            return False
        if not 0.0 < self.watch.value < 0.5 * self.tried or self.fall <= 0.0:
            return False
        self.tried = self.watch.value
        return True

    def _ahead(self, stepper: Stepper) -> float:
        """Return the approximate time at which the smallest singular value vanishes (s); nan if it does not."""
        horizon = 3.0 * self.watch.value / self.fall
        return predicted(self.equations, stepper.t, stepper.q, stepper.u, self.watch, horizon)

    def _passage(self, t: float, singular: float, q: Array, u: Array, options: Options) -> Passage | None:
        """Return the step from a state to as far beyond a singular configuration, if the motion is smooth there."""
        if 2.0 * (singular - t) > 0.5 * NODES_OF_PASSAGE * options.longest:  # a given function might be passed over
            return None
        allowed = TOLERANCES.passage_error_fixed_steps if options.step is not None else options.tol
        last = float(self.follower.times[-1])
        found = passage(self.equations, self.watch, t, singular, last, q, u, allowed)
        if found is None or not found.locate(self.watch):
            return None
        self.watch = self.equations.refresh(found.state)
        self.fall, self.tried, self.given_up = 0.0, math.inf, 0
        self.run.passed.append((found.singular, found.owners))
        return found

    def _halfway(self, t: float, found: _Singular, q: Array, u: Array) -> float:
        """Return the time before a singular configuration from which the passage is tried next (s)."""
        self.given_up += 1
        limit = 0.5 * (t + found.time)
        if self.given_up > TOLERANCES.passage_halvings or not t < limit < self.follower.times[-1]:
            raise found.error from None
        self.watch = self.equations.refresh(self.equations.evaluate(t, q, u))
        return limit

    def _power(self, times: Array, q: Array, u: Array, a: Array) -> Array:
        return self.energy.power(self.equations, times, q, u, a)


def difference(one: Track, other: Track, sizes: Array, states: Index, fast: float | None = None) -> float:
    """Return the largest difference of positions, orientations, speeds and first-order states of two runs.

    They are taken at common times. Lengths are in sizes of the scene, orientations are entries of rotation matrices,
    speeds and angular velocities are relative to the largest, or to `fast` (1/s), and states to their largest value
    or their size in `sizes`, which `states` picks, whichever is larger.
    """
    count = min(len(one.positions), len(other.positions))
    length = float(np.max(sizes))
    fast = fastest(other, length) if fast is None else fast
    a, b = (
        [getattr(x, name)[:count] for name in ("positions", "rotations", "velocities", "spins")] for x in (one, other)
    )
    units = (length, 1.0, length * fast, fast)
    worst = max(_largest(x - y) / unit for x, y, unit in zip(a, b, units, strict=True))
    first, second = one.states[:count], other.states[:count]
    most = np.max(np.abs([first, second]), axis=(0, 1))
    worst = max(worst, _largest((first - second) / np.maximum(most, sizes[states])))
    return worst if math.isfinite(worst) else math.inf


def fastest(track: Track, length: float) -> float:
    """Return the largest speed over the size of the scene, or the largest angular velocity (1/s)."""
    return max(_largest(np.linalg.norm(track.velocities, axis=-1)) / length, _largest(track.spins)) or 1.0


def _largest(x: Array) -> float:
    return float(np.max(np.abs(x), initial=0.0))
