"""A model at values of its parameters: its equations, its reference motion, and what is affordable."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import field, replace
from decimal import Decimal
from fractions import Fraction
from typing import TYPE_CHECKING, ParamSpec, Self, TypeVar

from mbstab.analysis.algebra.budget import Cost, Task
from mbstab.analysis.algebra.failures import guarded
from mbstab.analysis.algebra.threads import one_thread
from mbstab.analysis.linear.linearize import Linearization, linearize
from mbstab.analysis.reference.closure import contradicting
from mbstab.analysis.reference.motion import Motion
from mbstab.analysis.reference.requested import reference_motion
from mbstab.api.printing import printed
from mbstab.compiler.system import System
from mbstab.errors import MbstabError
from mbstab.model.arithmetic import FLOAT
from mbstab.model.doubts import extreme_numbers
from mbstab.model.garbage import uncollected
from mbstab.model.parameters import Latest, bound, evaluate_parameters
from mbstab.model.reader import with_counts
from mbstab.model.schema import Model, after_number
from mbstab.model.values import evaluate
from mbstab.records import dataclass

if TYPE_CHECKING:
    from mbstab.analysis.sweep.named_branches import Lines

Setting = float | str | Fraction | Decimal

SHOWN = 12
"""Bodies and parameters that the text of a mechanism lists."""

P = ParamSpec("P")
T = TypeVar("T")


def asked(question: Callable[P, T]) -> Callable[P, T]:
    """Return a question whose failures can be acted on, with one thread, whose answer prints as that of the command."""

    def numbers(*args: P.args, **kwargs: P.kwargs) -> list[str]:
        assert isinstance(args[0], Core)
        return extreme_numbers(args[0].model)

    ask = guarded(question, numbers)

    @functools.wraps(question)
    def inner(*args: P.args, **kwargs: P.kwargs) -> T:
        mechanism = args[0]
        assert isinstance(mechanism, Core)
        with one_thread():
            answer = ask(*args, **kwargs)
        return printed(answer, mechanism.model)

    return inner


@dataclass(frozen=True)
class Core:
    """A model at values of its parameters, with the attributes that `mbstab.api.mechanism.Mechanism` describes."""

    model: Model
    force: bool = False
    _latest: Latest[System] = field(default_factory=Latest, init=False, repr=False, compare=False)
    _followed: Latest[Lines] = field(default_factory=Latest, init=False, repr=False, compare=False)

    def __repr__(self) -> str:
        """Return title, bodies and parameters, the first twelve of each."""
        parts = [f"<Mechanism {self.model.title or self.model.name!r}"]
        values = {
            name: str(x.given.setting) if x.given else f"{x.expression.text}{after_number(x.unit)}"
            for name, x in self.model.parameters.items()
        }
        for what, items in (
            ("bodies", list(self.model.bodies)),
            ("parameters", [f"{name} = {value}" for name, value in values.items()]),
        ):
            if items:
                parts.append(f"{what}: {', '.join(items[:SHOWN])}{' …' if len(items) > SHOWN else ''}")
        return "; ".join(parts) + ">"

    def at(self, **parameters: Setting) -> Self:
        """Return the mechanism at values of parameters and counts; what is asked of it is asked there.

        Raises
        ------
        UsageError
            If a parameter is unknown or its value no number.
        """
        return replace(self, model=bound(*with_counts(self.model, parameters))) if parameters else self

    def _affordable(self, task: Task, parameters: Mapping[str, Setting]) -> System:
        """Return the equations of motion if a task about them is within the limits of memory and time."""
        return self._within(task, self.system(**parameters))

    def _within(self, task: Task, system: System) -> System:
        """Return a system if a task about it is within the limits of memory and time."""
        if not self.force:
            Cost.of(task, system.n_q, system.n_c).require()
        return system

    def _afforded(self, task: Task, parameters: Mapping[str, Setting]) -> Model:
        """Return the model at parameter values; refuse a task beyond the limits, at whatever values."""
        # What is small enough without constraints need not be assembled.
        if not Cost.of(task, len(self.model.coordinates()), 0).affordable:
            self._affordable(task, {})
        return self.closed(**parameters)

    def closed(self, **parameters: Setting) -> Model:
        """Return the model at parameter values, without rows that only the digits of the file keep from redundancy."""
        model = self.at(**parameters).model
        if not model.entries["joints"]:
            return model
        try:
            return replace(model, left_out=self.system(**parameters).scene.model.left_out)
        except MbstabError:
            return model  # another value may do

    def system(self, **parameters: Setting) -> System:
        """Return the equations of motion at parameter values.

        Raises
        ------
        UsageError
            If a parameter is unknown.
        ModelFileError
            If a value is out of range.
        """

        def made() -> System:
            with uncollected():
                system = System(evaluate(model := self.at(**parameters).model))
                left_out = contradicting(system)
                return System(evaluate(replace(model, left_out=left_out))) if left_out else system

        return self._latest.of(parameters, made)

    def parameters(self, **parameters: Setting) -> dict[str, float]:
        """Return the value of every parameter in SI."""
        return evaluate_parameters(self.at(**parameters).model, {}, FLOAT)

    @asked
    def motion(self, **parameters: Setting) -> Motion:
        """Return the reference motion: q, u, a (m, rad, s) and multipliers.

        Raises
        ------
        ModelFileError, MassError
            If the reference does not satisfy constraints or equations of motion; if nothing determines a motion of it.
        """
        system = self._affordable("motion", parameters)
        motion = reference_motion(system, massless=True)
        return motion if motion.massless is None else linearize(system, motion).motion

    @asked
    def linearize(self, frozen: bool = False, **parameters: Setting) -> Linearization:
        """Return M, R, K, J, D_q at the reference, as `mbstab.analysis.linear.linearize.linearize` does."""
        system = self._affordable("motion", parameters)
        return linearize(system, reference_motion(system, massless=True), frozen)
