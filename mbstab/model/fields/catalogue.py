"""All kinds of fields, in one place, and what follows from them: how keys are read and described."""

from __future__ import annotations

from collections.abc import Container, Iterable, Iterator
from types import ModuleType
from typing import Any

from mbstab.mechanics.catalogue import Field
from mbstab.mechanics.gathered import Gathered
from mbstab.model.fields.base import FieldKind, Reading
from mbstab.model.quantities import QuantityReader
from mbstab.model.schema import Entry
from mbstab.model.yamlfile import Mapping, Scalar

FIELD_KINDS: Gathered[str, FieldKind] = Gathered(
    __package__,
    "values mappings motions answers places masses names signals trains curves",
    lambda module: {kind.name: kind() for kind in _kinds_in(module)},
)
"""Every kind under the name that `Field.shape` gives it: each class of these modules that has a name of its own."""


def _kinds_in(module: ModuleType) -> Iterator[type[FieldKind]]:
    own = (x for x in vars(module).values() if isinstance(x, type) and x.__module__ == module.__name__)
    return (kind for kind in own if issubclass(kind, FieldKind) and "name" in vars(kind))


def kind_of(field: Field) -> FieldKind:
    """Return the kind of a field."""
    return FIELD_KINDS[field.shape]


def given_fields(entry: Entry) -> Iterator[tuple[Field, FieldKind, Any]]:
    """Yield the fields of an entry that have a value, its own or a default, with their kinds and values."""
    values = entry.values
    return ((x, FIELD_KINDS[x.shape], values[x.name]) for x in entry.kind.fields if x.name in values)


def read_fields(reading: Reading, fields: Iterable[Field], misspelt: Container[str] = ()) -> None:
    """Read keys, or their defaults; one with a problem has no value.

    Parameters
    ----------
    misspelt : container of str
        Keys that seem to be there under another name, and are not called missing.
    """
    node, path = reading.node, reading.path
    for field in fields:
        item = node.entries.get(field.name)
        if item is None and field.required and field.name not in misspelt:
            reading.nodes.complain(node, path, f"the key {field.name!r} is missing", field.doc)
        if item is None and field.default is not None:
            item = Scalar(field.default, node.location)
        if item is not None:
            reading.read(kind_of(field), field, item)
    for field in fields:
        kind_of(field).finish(reading, field)


def read_keys(quantities: QuantityReader, node: Mapping, path: str, fields: Iterable[Field]) -> Reading:
    """Read a mapping that has these keys and no others; each has a value afterwards, that of an absent one at least."""
    reading = Reading(quantities, node, path)
    reading.values = {field.name: kind_of(field).absent for field in fields}
    read_fields(reading, fields, reading.nodes.known_keys(node, path, [field.name for field in fields]))
    return reading


def describe_field(field: Field) -> dict[str, Any]:
    """Return the JSON Schema of a field, with what it means and its unit."""
    return {**kind_of(field).schema(field), "description": field.text}


def object_schema(fields: Iterable[Field], more: Iterable[str] = ()) -> dict[str, Any]:
    """Return the JSON Schema of a mapping with these keys and no others, of which some must be given, `more` too."""
    properties = {field.name: describe_field(field) for field in fields if not field.made}
    found = {"type": "object", "properties": properties, "additionalProperties": False}
    required = [*more, *(field.name for field in fields if field.required)]
    return {**found, "required": required} if required else found


def typed_schema(name: str, doc: str, fields: Iterable[Field]) -> dict[str, Any]:
    """Return the JSON Schema of a mapping whose ``type`` is `name`."""
    found = object_schema(fields, ["type"])
    properties = {"type": {"const": name, "description": doc}, **found["properties"]}
    return {**found, "description": doc, "properties": properties}
