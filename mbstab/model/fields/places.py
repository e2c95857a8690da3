"""Fields that hold points and directions, in the frame of a body or of the ground."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, ClassVar

from mbstab.errors import alternatives
from mbstab.mechanics import vectors
from mbstab.mechanics.catalogue import GROUND, Field, Marker, Number, Vector
from mbstab.mechanics.frames import dot
from mbstab.model.evaluator import Evaluator
from mbstab.model.fields.base import (
    DIRECTION,
    NUMBER,
    NUMBERS,
    TEXT,
    VECTOR,
    FieldKind,
    NamesIn,
    Owner,
    Reading,
)
from mbstab.model.fields.catalogue import object_schema, read_keys
from mbstab.model.keys import MARKER
from mbstab.model.numbers import all_of
from mbstab.model.schema import Components, MarkerValue, owner_of_point
from mbstab.model.yamlfile import Mapping, Scalar, Sequence, YamlNode


def read_marker(reading: Reading, node: YamlNode, path: str) -> MarkerValue | None:
    """Return a point of a body or of the ground: ``body.point``, ``body``, or a mapping with both."""
    nodes, quantities, names = reading.nodes, reading.quantities, reading.names
    if isinstance(node, Mapping):
        given = read_keys(quantities, node, path, MARKER).values
        return None if given["body"] is None else MarkerValue(given["body"] or None, given["point"])
    word = nodes.word(node, path, "a point such as body.point, body or ground")
    if word is None:
        return None
    name, _, point_name = word.partition(".")
    if not names.has_body_or_ground(node, path, name):
        return None
    body = None if name == "ground" else name
    if not point_name:
        return MarkerValue(body, quantities.zero(node, path))
    points = names.geometry[body][0]
    if point_name not in points:
        hint = alternatives(point_name, points, "its points")
        nodes.complain(node, path, f"{owner_of_point(body)} has no point {point_name!r}", hint)
        return None
    return MarkerValue(body, points[point_name])


def _marker(evaluator: Evaluator, value: MarkerValue) -> Marker:
    body = GROUND if value.body is None else evaluator.body_numbers[value.body]
    return Marker(body, evaluator.vector(value.point, length=True))


class OwnerField(FieldKind):
    """The name of a body, or ``ground``."""

    name = "body or ground"

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> str | None:
        """Return the name of the body, an empty text for the ground."""
        word = reading.nodes.word(node, path, "the name of a body or ground")
        if word is None or not reading.names.has_body_or_ground(node, path, word):
            return None
        return "" if word == "ground" else word


class MarkerField(FieldKind):
    """A point of a body."""

    name = "marker"

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> MarkerValue | None:
        """Return the point; directions of the entry are then in the frame of its body."""
        marker = read_marker(reading, node, path)
        if marker is None:
            return None
        if marker.body is None:
            reading.nodes.complain(node, path, "expected a point of a body, not of the ground")
            return None
        reading.bodies.append(marker.body)
        return marker

    def numbers(self, owner: Owner, field: Field, value: MarkerValue) -> Marker:
        """Return the point with its number of the body."""
        return _marker(owner.evaluator, value)

    def markers(self, numbers: Marker) -> Iterable[Marker]:
        """Return the point."""
        return (numbers,)

    def schema(self, field: Field) -> dict[str, Any]:
        """Return the schema of a point."""
        return {"anyOf": [TEXT, object_schema(MARKER)]}


class MarkersField(FieldKind):
    """Two points, of different bodies or of a body and the ground."""

    name = "markers"

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> tuple[MarkerValue, MarkerValue] | None:
        """Return the points; directions of the entry are then in the frames of their bodies."""
        if not isinstance(node, Sequence) or len(node.items) != 2:
            reading.nodes.complain(node, path, "expected a list of two points", "for example [rod.O, ground]")
            return None
        first, second = (read_marker(reading, item, f"{path}[{i}]") for i, item in enumerate(node.items))
        if first is None or second is None:
            return None
        if first.body == second.body:
            reading.nodes.complain(node, path, f"both points belong to {owner_of_point(first.body)}")
            return None
        reading.bodies += [first.body, second.body]
        return first, second

    def numbers(self, owner: Owner, field: Field, value: tuple[MarkerValue, MarkerValue]) -> tuple[Marker, Marker]:
        """Return the points with the numbers of their bodies."""
        first, second = value
        return _marker(owner.evaluator, first), _marker(owner.evaluator, second)

    def markers(self, numbers: tuple[Marker, Marker]) -> Iterable[Marker]:
        """Return the points."""
        return numbers

    def schema(self, field: Field) -> dict[str, Any]:
        """Return the schema of a list of two points."""
        return {"type": "array", "items": MarkerField().schema(field), "minItems": 2, "maxItems": 2}


class DirectionField(FieldKind):
    """A direction in the frame of the body whose point the entry names; its length does not matter."""

    name = "direction"
    form = DIRECTION
    names: ClassVar[NamesIn] = "direction"

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> Components | None:
        """Return the direction; also None if the point of the entry has a problem."""
        return reading.quantities.direction(node, path, reading.bodies[0]) if reading.bodies else None

    def numbers(self, owner: Owner, field: Field, value: Components) -> Vector:
        """Return the unit vector."""
        return vectors.unit(owner.evaluator.direction(value), owner.evaluator.f.sqrt)


class GroundDirectionField(DirectionField):
    """A direction in ground axes; its length does not matter."""

    name = "ground direction"
    names = "ground direction"

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> Components | None:
        """Return the direction."""
        return reading.quantities.direction(node, path, None)


class LevelDirectionField(GroundDirectionField):
    """A direction in ground axes, in space across the direction of the field ``normal``."""

    name = "level direction"

    def check(self, owner: Owner, field: Field, numbers: Vector, time: Number) -> None:
        """Refuse a direction that is not across the normal."""
        evaluator, written = owner.evaluator, owner.entry.values
        if len(numbers) == 2 or evaluator.symbolic:
            return
        normal = evaluator.vector(written["normal"])
        rise = dot(numbers, normal)
        if not all_of(rise * rise <= 1e-16 * dot(normal, normal)):
            evaluator.complain(written[field.name], f"{field.name} must lie across normal", "correct one of the two")


class DirectionsField(FieldKind):
    """A direction in the frames of the two bodies that the entry joins, the same or a list of two."""

    name = "directions"
    form: ClassVar[dict[str, Any]] = {"anyOf": [TEXT, {"type": "array", "items": {"anyOf": [NUMBER, NUMBERS]}}]}
    names = "directions"

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> tuple[Components, Components] | None:
        """Return both directions; also None if the points of the entry have a problem."""
        if len(reading.bodies) != 2:
            return None
        one, other = self._nodes(reading, node)
        first = reading.quantities.direction(one, path, reading.bodies[0])
        second = reading.quantities.direction(other, path, reading.bodies[1])
        return None if first is None or second is None else (first, second)

    def _nodes(self, reading: Reading, node: YamlNode) -> tuple[YamlNode, YamlNode]:
        """Return the nodes of the two directions: in the plane [a, b] is a vector unless both are directions."""
        items = node.items if isinstance(node, Sequence) else []
        if len(items) == 2 and (reading.names.dimension == 3 or all(_is_direction(reading, item) for item in items)):
            return items[0], items[1]
        return node, node

    def numbers(self, owner: Owner, field: Field, value: tuple[Components, Components]) -> tuple[Vector, Vector]:
        """Return both vectors, as long as they are written."""
        first, second = value
        return owner.evaluator.direction(first), owner.evaluator.direction(second)


class ZeroField(DirectionsField):
    """Directions from which an angle about the field ``axis`` counts."""

    name = "zero directions"

    def check(self, owner: Owner, field: Field, numbers: Any, time: Number) -> None:
        """Refuse a direction along the axis."""
        owner.triads("axis", field.name)


def _is_direction(reading: Reading, node: YamlNode) -> bool:
    """Whether a node is a direction, and not a component of one."""
    if not isinstance(node, Scalar):
        return isinstance(node, Sequence)
    named = any(node.text in directions for _, directions in reading.names.geometry.values())
    return named or reading.quantities.axis(node, "") is not None


class PointsField(FieldKind):
    """Points by name, in the frame of the body."""

    name = "points"
    form: ClassVar[dict[str, Any]] = {"type": "object", "additionalProperties": VECTOR}

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> dict[str, Components]:
        """Return the points."""
        return reading.quantities.named_vectors(node, path, "point", field.unit)

    def numbers(self, owner: Owner, field: Field, value: dict[str, Components]) -> dict[str, Vector]:
        """Return the points (m)."""
        return {name: owner.evaluator.vector(point, length=True) for name, point in value.items()}


class NamedDirectionsField(FieldKind):
    """Directions by name, in the frame of the body."""

    name = "named directions"
    form: ClassVar[dict[str, Any]] = {"type": "object", "additionalProperties": DIRECTION}

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> dict[str, Components]:
        """Return the directions."""
        return reading.quantities.named_vectors(node, path, "direction")

    def numbers(self, owner: Owner, field: Field, value: dict[str, Components]) -> dict[str, Vector]:
        """Return the vectors, as long as they are written."""
        return {name: owner.evaluator.direction(direction) for name, direction in value.items()}
