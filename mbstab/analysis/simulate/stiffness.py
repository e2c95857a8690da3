"""Whether a run takes too many steps, and why: steps of explicit methods may be short for stability alone.

An explicit method is stable while h |λ| is below its stability limit for every eigenvalue λ of the
accelerations: `Method.boundary` where λ is negative, less where it is complex. Where the steps of a method come near
this limit, Radau IIA is tried from the same state, with the same tolerance: only if its steps become much longer does
stability, and not the accuracy of the motion, limit the steps.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from mbstab.analysis.algebra.budget import duration
from mbstab.analysis.simulate.constrained import Constrained
from mbstab.analysis.simulate.steppers.interface import HINT, Options, Reached
from mbstab.analysis.simulate.steppers.table import METHODS
from mbstab.analysis.simulate.time_budget import Budget
from mbstab.analysis.simulate.tolerances import TOLERANCES
from mbstab.errors import MbstabError, NumericalError
from mbstab.model.units import per_second
from mbstab.records import dataclass


@dataclass(frozen=True)
class _Limit:
    """Result of a test: the fastest rate (1/s), the mean step and that of Radau IIA (s)."""

    rate: float
    mean: float
    implicit: float


class Pace:
    """Monitor of the steps of a run.

    Parameters
    ----------
    options : Options
    end : float
        Last time (s).
    note : str
        The note of an earlier run, or empty.
    tell : callable
        Called with a note when there is one.
    budget : Budget, optional
        The time budget; without it no time is reported.

    Attributes
    ----------
    note : str
        Message about the steps, or empty.
    """

    def __init__(
        self,
        options: Options,
        end: float,
        note: str = "",
        tell: Callable[[str], object] = str,
        budget: Budget | None = None,
    ) -> None:
        method = options.method
        self.boundary = method.boundary if options.step is None else math.inf
        self.end, self.budget = end, budget
        self.note, self._tell, self._machine = note, tell, bool(method.compiled) and not options.compiled
        self._next, self._steps, self._time = TOLERANCES.stiffness_first_test, 0, -np.inf

    def look(self, steps: int, stepper: Reached, equations: Constrained, options: Options) -> None:
        """Check the pace after a step.

        Raises
        ------
        NumericalError
            If the rest would take too many steps.
        """
        self._look_at_time(steps, stepper, equations, options)
        if steps < self._next - TOLERANCES.stiffness_window:
            return
        if self._time == -np.inf:
            self._steps, self._time = steps, stepper.t
        if steps < self._next or steps == self._steps:
            return
        mean = (stepper.t - self._time) / (steps - self._steps)
        self._next += min(self._next, TOLERANCES.stiffness_next_test)
        self._time = -np.inf
        left = (self.end - stepper.t) / max(mean, 1e-300)
        found = self._limit(mean, stepper, equations, options)
        if found is not None:
            text = (
                f"the steps of {found.mean:.1e} s at t = {stepper.t:.6g} s are limited by stability, not by accuracy: "
                f"the fastest motion that is possible there, {found.rate:.1e} 1/s, is not seen"
            )
            if not self.note:
                self.note = f"{text}; --method radau takes steps of {found.implicit:.1e} s there"
                self._tell(self.note)
            if steps >= TOLERANCES.steps_of_slow_pace and left > TOLERANCES.steps_left_explicit:
                raise NumericalError(
                    f"{text}; {left:.1e} more would be needed, where {TOLERANCES.steps_left_explicit:.0e} is the "
                    "limit\n"
                    f"hint: use --method radau, which takes steps of {found.implicit:.1e} s there"
                )
        elif steps >= TOLERANCES.steps_of_slow_pace and left > TOLERANCES.steps_left:
            raise NumericalError(
                f"the steps of {mean:.1e} s at t = {stepper.t:.9g} s are too short for the motion: {left:.1e} more "
                f"would be needed, where {TOLERANCES.steps_left:.0e} is the limit\n{HINT}"
            )

    def _look_at_time(self, steps: int, stepper: Reached, equations: Constrained, options: Options) -> None:
        """Report the rest of a long simulation, what limits its steps, and what to do."""
        left = self.budget.left(stepper.t) if self.budget else None
        if left is None or self.budget is None:
            return
        mean = self.budget.passed(stepper.t) / max(steps, 1)
        reason, ways = self._reason(mean, stepper, equations, options)
        if self.budget.more:
            ways.append("--once (one run, its error unknown)")
        ways.append("an earlier end (--to)")
        self._tell(
            f"this takes about {duration(left)} more at the present pace: steps of {mean:.1e} s {reason}\n"
            f"hint: {', '.join(ways[:-1])} or {ways[-1]} makes it shorter"
        )

    def _reason(self, mean: float, stepper: Reached, equations: Constrained, options: Options) -> tuple[str, list[str]]:
        """Return what limits the steps, and what makes them longer or faster."""
        machine = ["--compiled (steps in machine code)"] if self._machine else []
        if options.step is not None:
            return "as given", [*machine, "a longer --step"]
        if mean >= TOLERANCES.longest_step_part * options.longest:
            return (
                f"where {options.longest:.1e} s is the longest, so that no given function of time is passed over",
                [*machine, "fewer --points"],
            )
        found = self._limit(mean, stepper, equations, options)
        if found is not None:
            return (
                "are limited by stability, not by accuracy: the fastest motion that is possible at "
                f"t = {stepper.t:.6g} s, {found.rate:.1e} 1/s, is not seen",
                [f"--method radau (steps of {found.implicit:.1e} s there)", *machine],
            )
        k = int(np.argmax(np.abs(stepper.u / equations.sizes)))
        name = equations.system.names[k]
        possible = self._fastest(stepper, equations)
        text = f"for errors of {options.tol:.0e} in a step; at t = {stepper.t:.6g} s the fastest coordinate is {name}"
        text += f" with {stepper.u[k]:.3g} {per_second(equations.system.units[k])}"
        if possible is not None:
            text += f", and the fastest motion that is possible has a rate of {possible:.1e} 1/s"
        return text, [*machine, "a larger --tol"]

    @staticmethod
    def _fastest(stepper: Reached, equations: Constrained) -> float | None:
        """Return the largest rate of small motions about a state (1/s); None if it cannot be found."""
        try:
            rates = np.linalg.eigvals(equations.jacobian(stepper.t, stepper.q, stepper.u))
            return float(np.max(np.abs(rates), initial=0.0))
        except (MbstabError, ArithmeticError, np.linalg.LinAlgError, ValueError):
            return None

    def _limit(self, mean: float, stepper: Reached, equations: Constrained, options: Options) -> _Limit | None:
        """Return the stability limit if it limits the steps, else None."""
        rate = None if math.isinf(self.boundary) else self._fastest(stepper, equations)
        if rate is None or mean * rate < TOLERANCES.stability_boundary_part * self.boundary:
            return None
        try:
            radau = replace(options, method=METHODS["radau"][""], first=stepper.taken)
            other = radau.method.start(equations, stepper.t, stepper.q, stepper.u, self.end, radau)
            longest = 0.0
            for _ in range(TOLERANCES.implicit_probes):
                other.advance()
                longest = max(longest, float(other.taken))
                if other.t >= self.end:
                    break
        except (MbstabError, ArithmeticError, np.linalg.LinAlgError, ValueError):
            return None
        return _Limit(rate, mean, longest) if longest >= TOLERANCES.implicit_step_factor * mean else None
