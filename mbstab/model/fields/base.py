"""What every kind of field has to say: how it is read, checked, turned into numbers and described."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, ClassVar, Literal, Protocol

from mbstab.mechanics.catalogue import Field, Kind, Marker, Number
from mbstab.model.evaluator import Evaluator
from mbstab.model.quantities import QuantityReader
from mbstab.model.schema import Entry, is_angle, is_length
from mbstab.model.yamlfile import Mapping as MappingNode
from mbstab.model.yamlfile import Scalar, YamlNode

NamesIn = Literal[
    "values", "keys", "only keys", "none", "fields", "fields by name", "guess",
    "direction", "ground direction", "directions",
]  # fmt: skip


class Reading:
    """A mapping while it is read: an entry, or the whole file.

    Attributes
    ----------
    node : Mapping
        All of it.
    path : str
        Where it stands, such as ``joints.pivot``; empty for the file.
    values : dict
        What the fields that were read before say.
    bodies : list of str or None
        The bodies of the points that the entry has named so far (None: the ground).
    joint : Kind or None
        The type of the joint that the entry has named.
    """

    def __init__(self, quantities: QuantityReader, node: MappingNode, path: str) -> None:
        self.quantities = quantities
        self.nodes, self.names = quantities.nodes, quantities.names
        self.node = node
        self.path = path
        self.values: dict[str, Any] = {}
        self.bodies: list[str | None] = []
        self.joint: Kind | None = None

    def read(self, kind: FieldKind, field: Field, node: YamlNode) -> None:
        """Read a field; one with a problem has no value."""
        path = f"{self.path}.{field.name}" if self.path else field.name
        value = kind.read(self, field.along(self._motion()), node, path)
        if value is not None:
            self.values[field.name] = value

    def _motion(self) -> str:
        """Return whether what the entry acts on is an ``angle`` or a ``displacement``, empty if it does not say."""
        if coordinate := self.values.get("coordinate"):
            return "angle" if is_angle(coordinate) else "displacement" if is_length(coordinate) else ""
        motions = self.joint.motions if self.joint is not None else ()
        return str(self.values.get("motion") or (motions[0] if len(motions) == 1 else ""))


class FormError(Exception):
    """What is written has another form than its field asks for; where the field is read, this is told."""


def text_of(node: YamlNode) -> str:
    """Return what is written where a number, an expression or a word is expected.

    Raises
    ------
    FormError
    """
    if not isinstance(node, Scalar) or node.empty:
        raise FormError
    return node.text


class Owner(Protocol):
    """An entry whose fields become numbers."""

    entry: Entry
    evaluator: Evaluator

    def value(self, name: str) -> Any: ...  # noqa: D102
    def joint_named(self, name: str) -> Any: ...  # noqa: D102
    def contact_named(self, name: str) -> Any: ...  # noqa: D102
    def triads(self, axis: str, zero: str) -> Any: ...  # noqa: D102


class FieldKind:
    """One kind of field.

    Attributes
    ----------
    name : str
        What `Field.shape` calls it.
    moving : bool
        Whether its expressions may contain the time, coordinates or rates.
    explained : str
        What to ask ``mbstab schema`` for its keys, if it has any.
    names : str
        Where names of the file stand in it: in its ``values``, in its ``keys`` as well or in ``only keys``, nowhere
        (``none``), in ``fields`` of its own or in ``fields by name``, in a ``guess``; or as a ``direction`` of a body,
        a ``ground direction``, or ``directions`` of both bodies that the entry joins.
    form : mapping
        The JSON Schema of its fields, where that is the same for all of them.
    absent : object
        The value of a key of a section that is not given.
    """

    name: ClassVar[str]
    moving: ClassVar[bool] = False
    explained: ClassVar[str] = ""
    names: ClassVar[NamesIn] = "values"
    form: ClassVar[Mapping[str, Any]] = {"type": "string"}
    absent: ClassVar[Any] = None

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> Any:
        """Return the value as it stands in the file; None after a problem."""
        raise NotImplementedError

    def texts(self, node: YamlNode) -> Any:
        """Return what is written, for an entry that is made of the texts of its keys.

        Raises
        ------
        FormError
        """
        return text_of(node)

    def finish(self, reading: Reading, field: Field) -> None:
        """Check what must hold between the fields of an entry, after all have been read; the field may be missing."""

    def numbers(self, owner: Owner, field: Field, value: Any) -> Any:
        """Return the value with numbers: what `Item` hands to the mechanics."""
        return value

    def check(self, owner: Owner, field: Field, numbers: Any, time: Number) -> None:
        """Record what is wrong with the numbers; functions of time are looked at at `time` (s)."""

    def schema(self, field: Field) -> dict[str, Any]:
        """Return the JSON Schema of the field."""
        return {**self.form}

    def coordinates(self, value: Any) -> Iterable[str]:
        """Return the names that a value uses, among them all the coordinates it acts on or depends on."""
        return ()

    def joints(self, value: Any) -> Iterable[str]:
        """Return the names of the joints that a value names."""
        return ()

    def markers(self, numbers: Any) -> Iterable[Marker]:
        """Return the points of bodies at which an entry with these numbers acts."""
        return ()


TEXT: Mapping[str, Any] = {"type": "string"}
NUMBER: Mapping[str, Any] = {"type": ["number", "string"]}
NUMBERS: Mapping[str, Any] = {"type": "array", "items": NUMBER}
VECTOR: Mapping[str, Any] = {"anyOf": [TEXT, {"const": 0}, NUMBERS]}
DIRECTION: Mapping[str, Any] = {"anyOf": [TEXT, NUMBERS]}
BY_NAME: Mapping[str, Any] = {"type": "object", "additionalProperties": NUMBER}
"""Parts of the JSON Schema that several kinds of fields and sections share."""
