"""All kinds of fields, in one place."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from mbstab.mechanics.catalogue import Field
from mbstab.mechanics.gathered import Gathered
from mbstab.model.fields.base import FieldKind
from mbstab.model.schema import Entry

FIELD_KINDS: Gathered[str, FieldKind] = Gathered(
    __package__,
    "values places masses names signals trains curves",
    lambda module: {kind.name: kind for kind in module.KINDS},
)
"""Every kind under the name that `Field.shape` gives it."""


def kind_of(field: Field) -> FieldKind:
    """Return the kind of a field."""
    return FIELD_KINDS[field.shape]


def given_fields(entry: Entry) -> Iterator[tuple[Field, FieldKind, Any]]:
    """Yield the fields of an entry that have a value, its own or a default, with their kinds and values."""
    values = entry.values
    return ((x, FIELD_KINDS[x.shape], values[x.name]) for x in entry.kind.fields if x.name in values)
