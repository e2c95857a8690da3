"""Values of parameters that are best for a goal, within ranges: the best found, checked as any other model."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from mbstab.analysis.design.goals import Active, Cube, Goal, Margin, Range
from mbstab.analysis.design.plant import Plant
from mbstab.analysis.design.search import STOPPED, Found, search
from mbstab.analysis.design.task import Task
from mbstab.analysis.design.tolerances import TOLERANCES
from mbstab.analysis.spectrum.eigenvalues import answer
from mbstab.analysis.spectrum.results import EigenResult
from mbstab.analysis.verdict.rule import ASYMPTOTIC
from mbstab.compiler.system import Array, System
from mbstab.errors import NumericalError, UsageError
from mbstab.model.arithmetic import FLOAT
from mbstab.model.parameters import bound, evaluate_parameters, settings_in_si
from mbstab.model.schema import Model
from mbstab.model.values import evaluate
from mbstab.records import Answer, dataclass


@dataclass(frozen=True)
class Design(Answer):
    """The best values found for a goal; all values are in SI.

    Attributes
    ----------
    task : Task
    before, values : dict
        Values of the parameters that vary: those of the model, and the best found.
    first, best : float
        The goal at both: decay rate (1/s), damping ratio, or width of the range; negative: unstable, by how much; -inf
        where there is no answer, or no stable value.
    interval_before, interval : tuple of float, or None
        The stable range at both, where that is the goal.
    bounds : dict
        Parameters at an end of their range: ``first`` or ``last``.
    active : list of Active
        The eigenvalues that limit the goal.
    worst : dict
        Values of the other parameters at which the result is checked: the worst of the box, the middle of the range.
    result : EigenResult
        Eigenvalues and verdict there.
    steps : int
    ended : str
        Why the search ended.
    checked : int
        Number of places of the box, or of values of the range, at which the result is checked.
    """

    task: Task
    before: dict[str, float]
    values: dict[str, float]
    first: float
    best: float
    interval_before: tuple[float, float] | None
    interval: tuple[float, float] | None
    bounds: dict[str, str]
    active: list[Active]
    worst: dict[str, float]
    result: EigenResult
    steps: int
    ended: str
    checked: int

    @property
    def reached(self) -> bool:
        """Whether the value asked for is reached, or, if none is, disturbances decay."""
        least = self.task.limits.least
        return self.decays and (least is None or self.best >= least)

    @property
    def decays(self) -> bool:
        """Whether the verdict about the result is asymptotic stability."""
        return self.result.verdict.startswith(ASYMPTOTIC)


def design(model: Model, task: Task, progress: Callable[[float], object] = lambda done: None) -> Design:
    """Return the best values of parameters that are found for a goal.

    A search from one start finds a local optimum at best. From an unstable start it first looks for a stable motion.

    Parameters
    ----------
    progress : callable
        Is called with the part of the steps that are done, from 0 to 1.

    Raises
    ------
    UsageError
        If the reference cannot follow a parameter, or the motion is periodic.
    MbstabError
        As `mbstab.analysis.spectrum.sensitivity.sensitivities`, at the start.
    """
    if evaluate(model).period is not None:
        raise UsageError(f"{model.name} describes a periodic motion: its multipliers come without derivatives")
    cube, nominal = Cube(task.vary), evaluate_parameters(model, {}, FLOAT)
    before = {name: float(nominal[name]) for name in cube.names}
    start = cube.of(before)
    others = {name: float(np.clip(nominal[name], *ends)) for name, ends in _others(task).items()}
    plant = Plant(model, cube.at(start) | others)
    if not plant.count:
        raise NumericalError(f"{model.name} has neutral eigenvalues only: there is nothing to design")
    goal = _goal(plant, cube, task)
    # The present values may lie outside of the ranges.
    given = (np.array([before[name] for name in cube.names]) - cube.low) / cube.size
    first = goal.worst(given)[0] if isinstance(goal, Margin) else float(goal.values(given[None])[0])
    interval = _interval(goal, given)
    found = _stable(plant, cube, task, start, float(goal.values(start[None])[0]), others, progress)
    if found.ended != STOPPED and (task.goal != "range" or float(goal.values(found.x[None])[0]) > -np.inf):
        best = search(goal, found.x, task.limits.steps - found.steps, task.limits.least, progress)
        found = replace(best, steps=found.steps + best.steps)
    return _checked(model, task, cube, goal, found, (before, first, interval))


def _others(task: Task) -> dict[str, tuple[float, float]]:
    """Return the ranges of the parameters that do not belong to the design."""
    return {task.parameter: task.window} if task.parameter else task.over


def _goal(plant: Plant, cube: Cube, task: Task) -> Goal:
    if task.goal == "range":
        return Range(plant, cube, task.parameter, task.window)
    return Margin(plant, cube, task.goal, task.over)


def _interval(goal: Goal, x: Array) -> tuple[float, float] | None:
    """Return the range that is stable at a point, if that is the goal and there is one."""
    if not isinstance(goal, Range):
        return None
    low, high = (float(end[0]) for end in goal.ends(x[None], TOLERANCES.range_points_checked))
    return None if np.isnan(low) else (low, high)


def _stable(
    plant: Plant,
    cube: Cube,
    task: Task,
    start: Array,
    value: float,
    others: dict[str, float],
    progress: Callable[[float], object],
) -> Found:
    """Return a point from which the goal can be improved, or the least unstable one that is found."""
    if task.goal == "decay" or value > 0.0:
        return Found(start, value, 0, "")
    vary, over = dict(task.vary), task.over
    if task.goal == "range":
        vary[task.parameter], over = task.window, {}
    wide = Cube(vary)
    goal = Margin(plant, wide, "decay", over)
    found = search(goal, wide.of(cube.at(start) | others), task.limits.steps, goal.rounding, progress)
    return replace(found, x=found.x[: len(start)])


def _checked(
    model: Model,
    task: Task,
    cube: Cube,
    goal: Goal,
    found: Found,
    start: tuple[dict[str, float], float, tuple[float, float] | None],
) -> Design:
    """Return the result, with the verdict about it."""
    before, first, interval_before = start
    x, best = found.x, found.value
    interval = _interval(goal, x)
    worst, active = dict[str, float](), list[Active]()
    if isinstance(goal, Range):
        active = goal.active(x)
        best = -np.inf if interval is None else interval[1] - interval[0]
        worst = {task.parameter: 0.5 * sum(interval or task.window)}
    elif isinstance(goal, Margin):
        best, worst = goal.worst(x)
        active = goal.active(x, worst)
    values = cube.at(x)
    result = answer(System(evaluate(bound(model, settings_in_si(values | worst)))))
    ends = {name: "first" if x[i] < 0.5 else "last" for i, name in enumerate(cube.names) if _at_end(float(x[i]))}
    return Design(
        task, before, values, first, best, interval_before, interval, ends, active, worst, result, found.steps,
        found.ended, goal.checked**goal.sides if isinstance(goal, Margin) else TOLERANCES.range_points_checked,
    )  # fmt: skip


def _at_end(x: float) -> bool:
    return min(x, 1.0 - x) <= TOLERANCES.at_bound


def settings(model: Model, values: Mapping[str, float]) -> dict[str, str]:
    """Return values in SI as settings in the declared units."""
    return {name: repr(float(value) / model.parameters[name].factor) for name, value in values.items()}
