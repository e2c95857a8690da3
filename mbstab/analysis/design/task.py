"""What is asked of a design: parameters with ranges, and one goal."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import field

from mbstab.errors import UsageError, suggestion
from mbstab.model.arguments import whole
from mbstab.model.parameters import bound
from mbstab.model.ranges import interval, swept_interval
from mbstab.model.schema import Model
from mbstab.records import dataclass

GOALS = {
    "decay": "the slowest disturbance decays as fast as possible",
    "damping": "the smallest damping ratio is as large as possible",
    "range:NAME": "the range of the parameter NAME in which the motion is stable is as wide as possible",
}
"""Goals by what is written."""

Ends = tuple[float, float]
Given = str | Sequence[float]


@dataclass(frozen=True)
class Limits:
    """What else is asked of a design.

    Attributes
    ----------
    over : mapping
        Ranges of other parameters, written as those that vary: what counts is the worst in their box.
    least : float or None
        A value of the goal, in SI, that is enough.
    steps : int
        Steps of the search at most.

    Raises
    ------
    UsageError
        If a number is out of range.
    """

    over: Mapping[str, Given] = field(default_factory=dict)
    least: float | None = None
    steps: int = 40

    def __post_init__(self) -> None:
        """Refuse numbers that mean nothing."""
        whole("steps", self.steps, 1)
        if self.least is not None and not (math.isfinite(self.least) and self.least > 0.0):
            raise UsageError(f"at least {self.least:g}: give a positive number")


@dataclass(frozen=True)
class Task:
    """What is asked of a design; all values are in SI.

    Attributes
    ----------
    goal : str
        ``decay``, ``damping`` or ``range``.
    vary : dict
        First and last value of each parameter that may change.
    parameter : str
        That whose stable range is widened …
    window : tuple of float
        … and where it is looked for.
    over : dict
        First and last value of each parameter of the box.
    limits : Limits
    """

    goal: str
    vary: dict[str, Ends]
    parameter: str
    window: Ends
    over: dict[str, Ends]
    limits: Limits


def read_task(model: Model, vary: Mapping[str, Given], goal: str, limits: Limits) -> Task:
    """Return what is asked of a design.

    Parameters
    ----------
    model : Model
    vary : mapping
        A range for each parameter that may change, as in `mbstab.model.ranges.interval`.
    goal : str
        A key of `GOALS`; a range is looked for in the ``sweep:`` block of the file, or as ``range:NAME=FIRST..LAST``
        says.
    limits : Limits

    Raises
    ------
    UsageError
        If a parameter or the goal is unknown, a range is empty or reversed, or a parameter has two roles.
    """
    if not vary:
        raise UsageError("a design varies at least one parameter\nhint: --vary NAME=FIRST..LAST, or NAME=5%")
    kind, colon, rest = goal.partition(":")
    if (kind == "range") != bool(colon) or kind not in ("decay", "damping", "range"):
        hint = suggestion(goal, GOALS) or "; ".join(f"{name}: {text}" for name, text in GOALS.items())
        raise UsageError(f"there is no goal {goal!r}\nhint: {hint}")
    varied = {name: interval(model, name, given) for name, given in vary.items()}
    box = {name: interval(model, name, given) for name, given in limits.over.items()}
    parameter, window = "", (0.0, 0.0)
    if kind == "range":
        parameter, equals, text = (part.strip() for part in rest.partition("="))
        bound(model, {parameter: 0.0})  # is there such a parameter?
        window = interval(model, parameter, text) if equals else swept_interval(model, parameter)
        if box:
            raise UsageError("--over goes with the goals decay and damping, not with a range")
    for name in varied:
        if name in box or name == parameter:
            role = "spans the box" if name in box else "is the range of the goal"
            raise UsageError(f"{name} is varied, and {role} at the same time\nhint: leave out one of them")
    return Task(kind, varied, parameter, window, box, limits)
