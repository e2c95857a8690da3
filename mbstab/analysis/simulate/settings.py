"""Settings of a simulation: duration, start, method and accuracy."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import field

from mbstab.analysis.simulate.steppers.interface import Method
from mbstab.analysis.simulate.steppers.table import METHODS
from mbstab.analysis.simulate.tolerances import TOLERANCES
from mbstab.errors import UsageError
from mbstab.records import dataclass


@dataclass(frozen=True)
class SimulationSettings:
    """Settings of a simulation.

    Attributes
    ----------
    to, start : float, optional
        Last time (s), 10 s after the start if not given, and first one, that of the file if not given.
    method, solver : str
        ``projection`` (with DOP853, RK45, Radau, BDF), ``alpha`` or ``radau``: keys of
        `mbstab.analysis.simulate.steppers.table.METHODS`; without a solver the first of the method.
    tol : float
        Largest error of positions (relative to the size of the scene), of entries of rotation matrices and of speeds
        (relative to the largest of the motion) at any output time.
    step : float, optional
        Fixed step (s), without control or estimate of the error.
    points : int
        Number of output times, evenly spaced.
    perturb : mapping
        Changes added to the reference motion, by ``rod.theta``, ``angle(pivot)`` or ``displacement(slider)`` of a
        joint, ``rate(…)`` of these, or ``mode:1``; other free motions stay unchanged.
    strict : bool
        Refuse initial values that the constraints do not allow, instead of moving them.
    once : bool
        Make one run in which `tol` is the error of each step; nothing is known about the global error.
    compiled : bool
        Take the steps of DOP853, RK45, ``alpha`` or ``radau`` in machine code (extra ``fast``), compiled once.
    through_singular : bool
        Continue through configurations where the constraints lose rank, along the smooth continuation of the motion,
        and say so in a warning. The tolerance holds there as well. Where there is no such continuation, or it cannot
        be found to the tolerance, the motion ends as without this.

    Raises
    ------
    UsageError
        Names all settings that are out of range, unknown or exclude each other.
    """

    to: float | None = None
    start: float | None = None
    method: str = "projection"
    solver: str = ""
    tol: float = 1e-8
    step: float | None = None
    points: int = 501
    perturb: Mapping[str, float | str] = field(default_factory=dict)
    strict: bool = False
    once: bool = False
    compiled: bool = False
    through_singular: bool = False

    def __post_init__(self) -> None:
        """Check each setting, fill in the default solver of the method, and convert values to plain numbers."""
        problems: list[str] = []
        object.__setattr__(self, "perturb", self.perturb or {})
        for name, what in (("start", "the first time"), ("to", "the last time")):
            try:
                object.__setattr__(self, name, _number(getattr(self, name), what))
            except UsageError as error:
                problems.append(str(error))
        problems += self._method_problems()
        if not (math.isfinite(self.tol) and 0.0 < self.tol < 1.0):
            problems.append(f"the tolerance must lie between 0 and 1, not at {self.tol:g}")
        if self.step is not None and not (math.isfinite(self.step) and self.step > 0.0):
            problems.append(f"the step must be a positive number of seconds, not {self.step:g}")
        if self.points != int(self.points) or self.points < 2:
            problems.append(f"a simulation has at least two output times, a whole number, not {self.points}")
        if problems:
            raise UsageError("\n".join(problems))

    def _method_problems(self) -> list[str]:
        """Return the problems of the method, the solver, and the settings for them."""
        if self.method not in METHODS:
            return [f"there is no method {self.method!r}: {', '.join(METHODS)}"]
        solvers = METHODS[self.method]
        solver = self.solver or next(iter(solvers))
        object.__setattr__(self, "solver", solver)
        if solver not in solvers:
            known = ", ".join(filter(None, solvers))
            hint = f"solvers: {known}" if known else "it takes none; --solver goes with --method projection"
            return [f"the method {self.method} has no solver {solver!r}; {hint}"]
        problems = []
        if self.step is not None and not solvers[solver].fixed:
            problems.append(f"the solver {solver} chooses its own steps; fixed ones go with --method radau or alpha")
        if self.compiled and not solvers[solver].compiled:
            known = ", ".join(f"{m} {x}".strip() for m, group in METHODS.items() for x in group if group[x].compiled)
            problems.append(
                f"there are no compiled steps for {f'{self.method} {solver}'.strip()}; there are for {known}"
            )
        return problems

    @property
    def stepping(self) -> Method:
        """How the steps are taken."""
        return METHODS[self.method][self.solver]

    def end(self, first: float) -> float:
        """Return the last time of a motion from its first one (s).

        Raises
        ------
        UsageError
            If it is not later, or too far for the fixed step.
        """
        last, step = first + TOLERANCES.default_duration if self.to is None else self.to, self.step
        if not (math.isfinite(last) and last > first):
            raise UsageError(
                f"the end of the simulation, {last:g} s, must be later than its start, {first:g} s, and finite"
            )
        if step is not None and step > last - first:
            raise UsageError(f"the step of {step:g} s is longer than the simulation of {last - first:g} s")
        if step is not None and (last - first) / step > TOLERANCES.fixed_steps:
            raise UsageError(
                f"steps of {step:g} s make {(last - first) / step:.1e} of them until {last:g} s, where "
                f"{TOLERANCES.fixed_steps:.0e} is the limit"
            )
        return last


def _number(x: object, what: str) -> float | None:
    try:
        return None if x is None else float(x)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        raise UsageError(f"{what} is a number of seconds, not {x!r}") from None
