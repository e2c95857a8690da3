"""Keys of sections: texts, whole numbers, values of parameters, and mappings with keys of their own."""

from __future__ import annotations

import math
from typing import Any, ClassVar

from mbstab.mechanics.catalogue import Field
from mbstab.mechanics.elements import KINDS
from mbstab.model.arithmetic import FLOAT
from mbstab.model.expressions import ExpressionError
from mbstab.model.fields.base import BY_NAME, NUMBER, TEXT, FieldKind, NamesIn, Reading
from mbstab.model.fields.catalogue import object_schema, read_keys, typed_schema
from mbstab.model.keys import VERSION
from mbstab.model.nodes import single
from mbstab.model.schema import Quantity, constant
from mbstab.model.units import parse_unit
from mbstab.model.yamlfile import Scalar, Sequence, YamlNode

INTEGER = {"type": "integer"}
COUNT = {"anyOf": [INTEGER, TEXT]}


def by_name(form: Any) -> dict[str, Any]:
    """Return the JSON Schema of a mapping from names."""
    return {"type": "object", "additionalProperties": form}


class TextField(FieldKind):
    """A text on one line."""

    name = "text"
    names = "none"
    absent = ""

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> str:
        """Return it."""
        return reading.nodes.text(node, path)


class DeclaredUnitField(FieldKind):
    """The unit in which a parameter counts."""

    name = "declared unit"
    names = "none"
    absent = ""

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> str | None:
        """Return it as it is written."""
        if not isinstance(node, Scalar) or node.empty:
            reading.nodes.complain(node, path, "expected a unit such as kg*m^2")
            return None
        try:
            parse_unit(node.text)
        except ExpressionError as error:
            reading.quantities.complain(node, path, error)
            return None
        return node.text


class PostponedField(FieldKind):
    """An expression that is read when all parameters have names."""

    name = "postponed"
    form = NUMBER

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> Scalar | None:
        """Return where it stands."""
        if isinstance(node, Scalar):
            return node
        reading.nodes.complain(node, path, "expected a number or an expression", single(node))
        return None


class ValueField(FieldKind):
    """The value of a parameter: in its unit if it is a number."""

    name = "value"
    form = NUMBER

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> Quantity:
        """Return its expression, 1 after a problem."""
        return reading.quantities.quantity(node, path, shared=False) or constant("1", node.location, path)


class SettingsField(FieldKind):
    """Values of parameters, by name."""

    name = "settings"
    names = "keys"
    form = BY_NAME
    absent: ClassVar[Any] = {}

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> dict[str, Quantity]:
        """Return the values."""
        mapping, found = reading.nodes.optional(node, path), {}
        for key, item in mapping.pairs() if mapping else ():
            reading.names.check_parameter(key, path)
            found[key.text] = ValueField().read(reading, field, item, f"{path}.{key.text}")
        return found


class CountField(FieldKind):
    """How many of something there are."""

    name = "count"
    form = INTEGER
    least, most = 0, 10_000

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> int:
        """Return the number, the least one after a problem."""
        return reading.nodes.integer(node, path, self.least, self.most, self.least)


class NumberOfPointsField(CountField):
    """How many values a range has."""

    name = "number of points"
    least, most = 2, 10_000_000


class FractionField(FieldKind):
    """A plain number between 0 and 1."""

    name = "fraction"
    form = NUMBER

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> float:
        """Return the number, the default after a problem."""
        expression = reading.quantities.quantity(node, path)
        value = expression.evaluate({}, FLOAT) if expression is not None and expression.literal else math.nan
        if 0.0 < value < 1.0:
            return float(value)
        if expression is not None:
            reading.nodes.complain(node, path, "expected a number between 0 and 1")
        return float(field.default or math.nan)


class MappingField(FieldKind):
    """A mapping with keys of its own, `Field.keys`."""

    name = "mapping"
    names: ClassVar[NamesIn] = "fields"
    expected: ClassVar[str] = ""

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> Any:
        """Return what the keys say."""
        expected = self.expected or "{" + ", ".join(f"{key.name}: …" for key in field.keys) + "}"
        mapping = reading.nodes.mapping(node, path, expected)
        return None if mapping is None else self.build(read_keys(reading.quantities, mapping, path, field.keys))

    def build(self, reading: Reading) -> Any:
        """Return what the values of the keys make; None after a problem."""
        return reading.values

    def schema(self, field: Field) -> dict[str, Any]:
        """Return the schema of the mapping."""
        return object_schema(field.keys)


class MappingsField(MappingField):
    """Mappings by name."""

    name = "by name"
    names = "fields by name"

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> dict[str, Any]:
        """Return what each says, but for those with a problem."""
        section, found = reading.nodes.optional(node, path), dict[str, Any]()
        for key, item in section.pairs() if section else ():
            here = f"{path}.{key.text}"
            self.check_name(reading, key, here)
            if (one := super().read(reading, field, item, here)) is not None:
                found[key.text] = one
        return found

    def check_name(self, reading: Reading, key: Scalar, path: str) -> None:
        """Refuse what can be no name here."""

    def schema(self, field: Field) -> dict[str, Any]:
        """Return the schema of the mappings by name."""
        return by_name(super().schema(field))


class ListField(MappingField):
    """A list of mappings."""

    name = "list"

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> tuple[Any, ...]:
        """Return what each says, but for those with a problem."""
        if not isinstance(node, Sequence):
            reading.nodes.complain(node, path, "expected a list", "each item starts with a dash")
            return ()
        found = (MappingField.read(self, reading, field, x, f"{path}[{i}]") for i, x in enumerate(node.items))
        return tuple(x for x in found if x is not None)

    def schema(self, field: Field) -> dict[str, Any]:
        """Return the schema of the list."""
        return {"type": "array", "items": super().schema(field)}


class ParametersField(MappingsField):
    """Parameters by name: a value, or a mapping."""

    name = "parameters"

    def schema(self, field: Field) -> dict[str, Any]:
        """Return the schema of values and mappings."""
        return by_name({"anyOf": [NUMBER, object_schema(field.keys)]})


class EntriesField(FieldKind):
    """Entries by name, each with a type and the keys of this."""

    name = "entries"
    names = "fields by name"

    def schema(self, field: Field) -> dict[str, Any]:
        """Return the schema of all types of a section."""
        kinds = {id(kind): kind for kind in KINDS[field.name].values()}.values()
        return by_name({"anyOf": [typed_schema(kind.name, kind.doc, kind.fields) for kind in kinds]})


class VersionField(FieldKind):
    """The version of the file format."""

    name = "version"
    form: ClassVar[dict[str, Any]] = {"const": int(VERSION)}


class BlocksField(FieldKind):
    """Sections that are repeated."""

    name = "blocks"
    form: ClassVar[dict[str, Any]] = {"type": "array", "items": {"type": "object"}}


class CountsField(FieldKind):
    """Whole numbers by name."""

    name = "counts"
    form = by_name(COUNT)


class RangesField(FieldKind):
    """Whole numbers by index, the first and the last one."""

    name = "ranges"
    form = by_name({"type": "array", "items": COUNT, "minItems": 2, "maxItems": 2})


class TextsField(FieldKind):
    """Texts or expressions by name."""

    name = "texts"
    names = "keys"
    form = by_name(TEXT)


class ColumnField(FieldKind):
    """Numbers, or the name of a column of a file."""

    name = "column"
    names = "none"
    form: ClassVar[dict[str, Any]] = {"anyOf": [TEXT, {"type": "array", "items": {"type": "number"}}]}
