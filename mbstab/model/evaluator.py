"""Quantities of a model as numbers, and as functions of time."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from mbstab.mechanics.catalogue import Field, Number, Vector
from mbstab.mechanics.frames import Frame, dot
from mbstab.model.arithmetic import Arithmetic
from mbstab.model.exact_values import with_more_digits
from mbstab.model.expressions import Expression, ExpressionError, Node
from mbstab.model.numbers import all_of, broken_sign, is_finite, nominal, require_finite
from mbstab.model.rationals import Rationals
from mbstab.model.schema import (
    Components,
    Model,
    Quantity,
    after_number,
)
from mbstab.records import dataclass

if TYPE_CHECKING:
    from mbstab.model.jets import Jet


@dataclass(frozen=True)
class Law:
    """A given function of time."""

    expression: Quantity
    names: Mapping[str, Number]
    arithmetic: Arithmetic

    @property
    def zero(self) -> bool:
        """Whether it is written as the number 0."""
        return self.expression.literal and float(self.expression.text) == 0.0

    def at(self, time: Number) -> Jet:
        """Return value, first and second derivative at a time (s)."""
        from mbstab.model.jets import Jet, jet_arithmetic

        names = {**self.names, "t": Jet(time, 1, 0)}
        return Jet.of(self.expression.evaluate(names, jet_arithmetic(self.arithmetic)))


class Evaluator:
    """Turns the quantities of a model into numbers; after a problem is recorded, it goes on with a harmless number.

    Attributes
    ----------
    poses : dict
        Where bodies stand at the reference, by number, as far as the file says, and the ground.
    checked : bool
        Whether the same values have passed in another arithmetic.
    judges : bool
        Whether numbers must be finite and have the signs that their fields ask for.
    """

    def __init__(
        self, model: Model, parameters: dict[str, Number], arithmetic: Arithmetic, checked: bool = False
    ) -> None:
        self.model = model
        self.document = replace(model.document, problems=[])
        self.parameters = parameters
        self.f = arithmetic
        self.symbolic = arithmetic.name == "symbol"
        self.checked = checked
        self.judges = not (checked or self.symbolic)
        self.rationals = Rationals(model, parameters, arithmetic)
        self.lengths: list[float] = []
        self._known: dict[int, tuple[Node, Number]] = {}
        self.body_numbers = {name: i for i, name in enumerate(model.bodies)}
        self.poses: dict[int, Frame] = {}
        self.coordinate_numbers = {name: i for i, name in enumerate(model.coordinates())}

    def complain(self, quantity: Quantity | Components, message: str, hint: str = "") -> None:
        """Record a problem at the place of a quantity."""
        self.document.complain(quantity.location, quantity.path, message, hint)

    def number(self, quantity: Quantity, field: Field | None = None, length: bool = True) -> Number:
        """Return a number that is finite and has the sign that its field asks for.

        If it is in metres, it counts towards the size of the scene, unless `length` is false.
        """
        known = self._known.get(id(quantity.root))  # the same texts share it
        value = self._value(quantity) if known is None else known[1]
        if value is None:
            return 1.0
        if field is not None and not self.symbolic:
            if self.judges and (value := self._with_sign(value, quantity, field)) is None:
                return 1.0
            if length and field.unit == "m" and not hasattr(value, "shape"):
                self.lengths.append(abs(value))
        return value

    def _value(self, quantity: Quantity) -> Number | None:
        """Return the value of a quantity, which is then known; None after a problem."""
        try:
            value = quantity.evaluate(self.parameters, self.f)
        except ExpressionError as error:
            self.complain(quantity, error.message, error.hint)
            return None
        good = self.check_widths(quantity)
        if self.judges and not is_finite(value):
            self.complain(quantity, f"the value of {quantity.text!r} is not finite")
            return None
        if good:
            self._known[id(quantity.root)] = quantity.root, value
        return value

    def check_widths(self, quantity: Quantity) -> bool:
        """Whether functions are smoothed over positive widths; record a problem if not."""
        good = True
        for function, width in quantity.widths if self.judges else ():
            try:
                broken = broken_sign(Expression("", width).evaluate(self.parameters, self.f), "positive")
            except ExpressionError as error:
                self.complain(quantity, error.message)
                good = False
                continue
            if broken is not None:
                good = False
                hint = "it is the size over which the change is smoothed"
                self.complain(quantity, f"the width of {function}() must {broken[0]}, got {broken[1]:g}", hint)
        return good

    def _with_sign(self, value: Number, quantity: Quantity, field: Field) -> Number | None:
        """Return a number with the sign that its field asks for, by the decimals of the file; None after a problem."""
        broken = broken_sign(value, field.sign, field.most)
        if broken is None:
            return value
        known = with_more_digits(value, quantity, self.model, self.parameters, self.f)
        if known is not None and (broken := broken_sign(known, field.sign, field.most)) is None:
            return known
        assert broken is not None
        rule, shown = broken
        got = f"{shown:g}{after_number(field.unit)}"
        without = re.search(r"; (without it[^;]*)", field.doc)
        hint = f"leave it out: {without[1]}" if without and not shown else field.instead
        self.complain(quantity, f"{field.name.replace('_', ' ')} must {rule}, got {got}", hint)
        return None

    def vector(self, components: Components, length: bool = False) -> Vector:
        """Return the numbers of a vector; if they are lengths, they count towards the size of the scene."""
        values = tuple(self.number(x) for x in components.values)
        if length and not self.symbolic:
            self.lengths += [abs(x) for x in values if not hasattr(x, "shape")]
        return values

    def direction(self, components: Components) -> Vector:
        """Return a vector that must not be zero, and whose length does not matter otherwise."""
        values = self.vector(components)
        if self.symbolic:
            return values
        square = dot(values, values)
        if not all_of((square > 0) & (square < math.inf)):
            self.complain(components, f"a direction must have a length, this one has {nominal(square) ** 0.5:g}")
            return (1.0, 2.0, 3.0)[: len(values)]
        return values

    def law(self, quantity: Quantity) -> Law:
        """Return a function of time."""
        return Law(self.rationals.settled(quantity), self.parameters, self.f)

    def check_law(self, law: Law, time: Number) -> None:
        """Record a problem if a function of time or one of its derivatives is not finite at a time (s)."""
        self.check_widths(law.expression)
        if self.symbolic:
            return
        try:
            jet = law.at(time)
            for value in (jet.value, jet.rate, jet.second):
                require_finite(value)
        except ExpressionError as error:
            self.complain(law.expression, error.message, error.hint)
