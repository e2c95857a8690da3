"""Fields that hold values: numbers, vectors, functions of time, words, constraints."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from mbstab.mechanics.catalogue import Field, Number, Vector
from mbstab.model.evaluator import Law
from mbstab.model.expressions import Binary, ExpressionError, Rate, moves
from mbstab.model.fields.base import NUMBER, NUMBERS, TEXT, VECTOR, FieldKind, Owner, Reading
from mbstab.model.schema import Components, Quantity
from mbstab.model.units import parse_unit
from mbstab.model.yamlfile import Sequence, YamlNode


class NumberField(FieldKind):
    """A number."""

    name = "number"

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> Quantity:
        """Return its expression."""
        return reading.quantities.expression(node, path, field.unit)

    def numbers(self, owner: Owner, field: Field, value: Quantity) -> Number:
        """Return the number."""
        return owner.evaluator.number(value, field)

    def schema(self, field: Field) -> dict[str, Any]:
        """Return the schema of a number or an expression."""
        return {**NUMBER}


class VectorField(FieldKind):
    """A vector with its magnitude, in the axes that its field says."""

    name = "vector"

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> Components | None:
        """Return its components."""
        return reading.quantities.vector(node, path, field.unit)

    def numbers(self, owner: Owner, field: Field, value: Components) -> Vector:
        """Return the vector as written; each component has the sign that its field asks for."""
        return tuple(owner.evaluator.number(x, field) for x in value.values)

    def schema(self, field: Field) -> dict[str, Any]:
        """Return the schema of a vector."""
        return {**VECTOR}


class AnglesField(VectorField):
    """Three angles."""

    name = "angles"

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> Components | None:
        """Return the angles; names of axes do not count here."""
        if not isinstance(node, Sequence) or len(node.items) != 3:
            reading.nodes.complain(node, path, "expected three angles (rad)", "for example [pi/2, 0, 0]")
            return None
        return reading.quantities.components(node.items, node, path, field.unit)

    def schema(self, field: Field) -> dict[str, Any]:
        """Return the schema of a list of numbers."""
        return {**NUMBERS}


class LawField(FieldKind):
    """A function of time."""

    name = "law"
    moving = True

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> Quantity:
        """Return its expression."""
        return reading.quantities.expression(node, path, field.unit, time=True)

    def numbers(self, owner: Owner, field: Field, value: Quantity) -> Law:
        """Return the function with the values of the parameters."""
        return owner.evaluator.law(value)

    def check(self, owner: Owner, field: Field, numbers: Law, time: Number) -> None:
        """Require finite values and derivatives."""
        owner.evaluator.check_law(numbers, time)

    def schema(self, field: Field) -> dict[str, Any]:
        """Return the schema of a number or an expression."""
        return {**NUMBER}


class LawVectorField(FieldKind):
    """A vector whose components are functions of time."""

    name = "law vector"
    moving = True

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> Components:
        """Return its components."""
        return reading.quantities.vector(node, path, field.unit, time=True)

    def numbers(self, owner: Owner, field: Field, value: Components) -> tuple[Law, ...]:
        """Return a function for each component."""
        return tuple(owner.evaluator.law(x) for x in value.values)

    def check(self, owner: Owner, field: Field, numbers: tuple[Law, ...], time: Number) -> None:
        """Require finite values and derivatives."""
        for law in numbers:
            owner.evaluator.check_law(law, time)

    def schema(self, field: Field) -> dict[str, Any]:
        """Return the schema of a vector."""
        return {**VECTOR}


class ChoiceField(FieldKind):
    """One of the words that its field lists."""

    name = "choice"

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> str | None:
        """Return the word."""
        return reading.nodes.choice(node, path, field.choices)

    def schema(self, field: Field) -> dict[str, Any]:
        """Return the schema of these words."""
        return {**TEXT, "enum": list(field.choices)}


class ConstraintField(FieldKind):
    """An expression of coordinates, rates and time that must be zero."""

    moving = True

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> Quantity | None:
        """Return the expression."""
        expression = reading.quantities.quantity(node, path, time=True, state=True)
        if expression is not None:
            self.check_contents(reading, node, expression)
        return expression

    def check_contents(self, reading: Reading, node: YamlNode, expression: Quantity) -> None:
        """Check that the expression depends on what it must depend on."""
        raise NotImplementedError

    def check(self, owner: Owner, field: Field, numbers: Quantity, time: Number) -> None:
        """Require positive widths of smoothing."""
        owner.evaluator.check_widths(numbers)

    def coordinates(self, value: Quantity) -> Iterable[str]:
        """Return the names in the expression, and those of its rates."""
        return {*value.names(), *value.rates()}

    def schema(self, field: Field) -> dict[str, Any]:
        """Return the schema of an expression."""
        return {**TEXT}


class HolonomicField(ConstraintField):
    """A constraint on coordinates."""

    name = "holonomic"

    def check_contents(self, reading: Reading, node: YamlNode, expression: Quantity) -> None:
        """Refuse rates, and an expression without coordinates."""
        if expression.rates():
            message = "a holonomic constraint contains no rates"
            reading.nodes.complain(node, expression.path, message, "make it nonholonomic")
        elif not any(moves(name, reading.names.coordinates) for name in expression.names()):
            reading.nodes.complain(node, expression.path, "the constraint contains no coordinate")


class NonholonomicField(ConstraintField):
    """A constraint on rates."""

    name = "nonholonomic"

    def check_contents(self, reading: Reading, node: YamlNode, expression: Quantity) -> None:
        """Refuse an expression without rates."""
        if not expression.rates():
            reading.nodes.complain(node, expression.path, "the constraint contains no rate of a coordinate")


class RateField(FieldKind):
    """The rate of a first-order state: an expression of coordinates, rates, states and time."""

    name = "rate"
    moving = True

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> Quantity | None:
        """Return the expression that must be zero: rate(state) minus the given one."""
        given = reading.quantities.quantity(node, path, time=True, state=True)
        if given is None:
            return None
        state = reading.path.partition(".")[2]
        unit = reading.names.state_units.get(state)
        try:
            reading.quantities.check_unit(given, f"{unit}/s" if unit else "")
        except ExpressionError as error:
            reading.nodes.complain(node, path, error.message, error.hint)
        if state in given.rates():
            message = f"the rate of {state!r} depends on itself"
            reading.nodes.complain(node, path, message, "solve the equation for the rate")
            return None
        root = Binary("-", Rate(state, 0), given.root, 0)
        return Quantity(f"rate({state}) - ({given.text})", root, given.location, path)

    def check(self, owner: Owner, field: Field, numbers: Quantity, time: Number) -> None:
        """Require positive widths of smoothing."""
        owner.evaluator.check_widths(numbers)

    def coordinates(self, value: Quantity) -> Iterable[str]:
        """Return the names in the expression, and those of its rates."""
        return {*value.names(), *value.rates()}

    def schema(self, field: Field) -> dict[str, Any]:
        """Return the schema of a number or an expression."""
        return {**NUMBER}


class UnitField(FieldKind):
    """A unit in which numbers in SI count."""

    name = "unit"

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> str | None:
        """Return it as it is written."""
        word = reading.nodes.word(node, path, "a unit such as A or N*m")
        if word is None:
            return None
        try:
            factor = parse_unit(word)[0]
        except ExpressionError as error:
            reading.nodes.complain(node, path, error.message, error.hint)
            return None
        if factor != 1.0:
            hint = "expressions are computed in kg, m, s, A and rad; declare the unit in these"
            reading.nodes.complain(node, path, f"a state cannot have the unit {word}", hint)
        return word

    def schema(self, field: Field) -> dict[str, Any]:
        """Return the schema of a unit."""
        return {**TEXT}


KINDS = (
    NumberField(),
    VectorField(),
    AnglesField(),
    LawField(),
    LawVectorField(),
    ChoiceField(),
    HolonomicField(),
    NonholonomicField(),
    RateField(),
    UnitField(),
)
