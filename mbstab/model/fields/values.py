"""Fields that hold values: numbers, vectors, functions of time, words."""

from __future__ import annotations

from typing import Any, ClassVar

from mbstab.mechanics.catalogue import Field, Number, Vector
from mbstab.model.evaluator import Law
from mbstab.model.expressions import ExpressionError
from mbstab.model.fields.base import NUMBER, NUMBERS, TEXT, VECTOR, FieldKind, Owner, Reading
from mbstab.model.schema import Components, Quantity
from mbstab.model.units import parse_unit
from mbstab.model.yamlfile import Sequence, YamlNode


class NumberField(FieldKind):
    """A number."""

    name = "number"
    form = NUMBER

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> Quantity:
        """Return its expression."""
        return reading.quantities.expression(node, path, field.unit, time=self.moving)

    def numbers(self, owner: Owner, field: Field, value: Quantity) -> Number | Law:
        """Return the number."""
        return owner.evaluator.number(value, field)


class LawField(NumberField):
    """A function of time."""

    name = "law"
    moving = True

    def numbers(self, owner: Owner, field: Field, value: Quantity) -> Law:
        """Return the function with the values of the parameters."""
        return owner.evaluator.law(value)

    def check(self, owner: Owner, field: Field, numbers: Law, time: Number) -> None:
        """Require finite values and derivatives."""
        owner.evaluator.check_law(numbers, time)


class VectorField(FieldKind):
    """A vector with its magnitude, in the axes that its field says; each component has the sign that is asked for."""

    name = "vector"
    form = VECTOR
    component: ClassVar[NumberField] = NumberField()

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> Components | None:
        """Return its components."""
        return reading.quantities.vector(node, path, field.unit, time=self.moving)

    def numbers(self, owner: Owner, field: Field, value: Components) -> Vector:
        """Return the vector as written."""
        return tuple(self.component.numbers(owner, field, x) for x in value.values)

    def check(self, owner: Owner, field: Field, numbers: Vector, time: Number) -> None:
        """Check each component."""
        for number in numbers:
            self.component.check(owner, field, number, time)


class LawVectorField(VectorField):
    """A vector whose components are functions of time."""

    name = "law vector"
    moving = True
    component = LawField()


class AnglesField(VectorField):
    """Three angles."""

    name = "angles"
    form = NUMBERS

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> Components | None:
        """Return the angles; names of axes do not count here."""
        if not isinstance(node, Sequence) or len(node.items) != 3:
            reading.nodes.complain(node, path, "expected three angles (rad)", "for example [pi/2, 0, 0]")
            return None
        return reading.quantities.components(node.items, node, path, field.unit)


class ChoiceField(FieldKind):
    """One of the words that its field lists."""

    name = "choice"
    names = "none"

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> str | None:
        """Return the word."""
        return reading.nodes.choice(node, path, field.choices)

    def schema(self, field: Field) -> dict[str, Any]:
        """Return the schema of these words."""
        return {**TEXT, "enum": list(field.choices)}


class FlagField(FieldKind):
    """Yes or no."""

    name = "flag"
    names = "none"
    form: ClassVar[dict[str, Any]] = {"type": "boolean"}

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> bool | None:
        """Return whether it is true."""
        word = reading.nodes.choice(node, path, ("true", "false"))
        return None if word is None else word == "true"


class UnitField(FieldKind):
    """A unit in which numbers in SI count."""

    name = "unit"
    names = "none"

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
