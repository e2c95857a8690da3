"""Fields that say how the mass of a body is distributed: inertias, shapes, parts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, ClassVar

from mbstab.errors import suggestion
from mbstab.mechanics.bodies import SHAPES, ShapeKind, shape_moments
from mbstab.mechanics.catalogue import Field, Number, Vector
from mbstab.model.evaluator import Evaluator
from mbstab.model.fields.base import (
    BY_NAME,
    NUMBER,
    NUMBERS,
    FieldKind,
    Owner,
    Reading,
)
from mbstab.model.fields.catalogue import read_fields, typed_schema
from mbstab.model.keys import ALONG, PART
from mbstab.model.nodes import decimal_commas
from mbstab.model.numbers import all_of
from mbstab.model.quantities import AXES
from mbstab.model.schema import Components, PartValue, ShapeValue, constant
from mbstab.model.yamlfile import Mapping, YamlNode
from mbstab.model.yamlfile import Sequence as SequenceNode

TENSOR_KEYS = ("xx", "yy", "zz", "xy", "xz", "yz")

_DIRECTIONS = (*AXES, *(f"-{axis}" for axis in AXES))

Moments = Callable[[Number], Vector]
"""From a mass (kg) to the principal moments about the centre (kg·m²)."""


class TensorField(FieldKind):
    """An inertia: a number in the plane; in space xx, yy, zz, xy, xz, yz, or a matrix row by row."""

    name = "tensor"
    form: ClassVar[dict[str, Any]] = {
        "anyOf": [NUMBER, {"type": "array", "items": {"anyOf": [NUMBER, NUMBERS]}}, BY_NAME]
    }

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> Components | None:
        """Return its components: one, six or nine."""
        quantities, unit = reading.quantities, field.unit
        if reading.names.dimension == 2:
            return Components((quantities.expression(node, path, unit),), node.location, path)
        zero = constant("0", node.location, path)
        if isinstance(node, Mapping):
            reading.nodes.known_keys(node, path, TENSOR_KEYS)
            for key in TENSOR_KEYS[:3]:
                reading.nodes.required(node, key, path)
            given = node.entries
            found = (quantities.expression(given[k], f"{path}.{k}", unit) if k in given else zero for k in TENSOR_KEYS)
            return Components(tuple(found), node.location, path)
        if isinstance(node, SequenceNode) and len(node.items) == 3:
            rows = [item for item in node.items if isinstance(item, SequenceNode)]
            if not rows:
                moments = quantities.components(node.items, node, path, unit)
                return Components((*moments.values, zero, zero, zero), node.location, path)
            if len(rows) == 3 and all(len(row.items) == 3 for row in rows):
                lines = [quantities.components(row.items, row, f"{path}[{i}]", unit) for i, row in enumerate(rows)]
                return Components(tuple(x for line in lines for x in line.values), node.location, path)
        keys = ", ".join(TENSOR_KEYS)
        message = f"expected three principal moments, a 3×3 matrix, or keys {keys} (kg*m^2)"
        reading.nodes.complain(node, path, message, decimal_commas(node, 3) if isinstance(node, SequenceNode) else "")
        return None

    def numbers(self, owner: Owner, field: Field, value: Components) -> Vector:
        """Return one number in the plane, xx, yy, zz, xy, xz, yz in space (kg·m²); a matrix must be symmetric."""
        evaluator = owner.evaluator
        m = evaluator.vector(value)
        if len(m) != 9:
            return m
        if not evaluator.symbolic:
            largest = sum(abs(x) for x in m)
            for upper, lower in ((1, 3), (2, 6), (5, 7)):
                if not all_of(abs(m[upper] - m[lower]) <= 1e-12 * largest):
                    one, other = value.values[upper], value.values[lower]
                    message = f"the inertia is not symmetric: {one.text!r} and {other.text!r} must be the same"
                    evaluator.complain(other, message)
        return m[0], m[4], m[8], m[1], m[2], m[5]


class ShapeAxisField(FieldKind):
    """The axis of symmetry of a shape: its number, and whether it points back."""

    name = "axis of a shape"
    names = "none"
    form: ClassVar[dict[str, Any]] = {"enum": list(_DIRECTIONS)}

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> tuple[int, bool] | None:
        """Return the number, and whether it points back."""
        letter = reading.nodes.choice(node, path, _DIRECTIONS)
        return None if letter is None else (AXES[letter[-1]], letter.startswith("-"))


def _shape_keys(kind: ShapeKind, more: Sequence[Field]) -> list[Field]:
    return [*kind.fields, *([ALONG] if kind.axis is not None else []), *more]


def _read_shape(
    reading: Reading, node: Mapping, path: str, more: Sequence[Field] = ()
) -> tuple[ShapeValue, dict[str, Any]] | None:
    """Return the shape that a mapping describes, and what all keys say; `more` are further ones that it may have."""
    nodes = reading.nodes
    known = "known shapes: " + ", ".join(SHAPES)
    type_node = nodes.required(node, "type", path, known)
    word = nodes.word(type_node, f"{path}.type", "a shape") if type_node is not None else None
    if type_node is None or word is None:
        return None
    kind = SHAPES.get(word)
    if kind is None:
        nodes.complain(type_node, f"{path}.type", f"unknown shape {word!r}", suggestion(word, SHAPES) or known)
        return None
    keys, inner = _shape_keys(kind, more), Reading(reading.quantities, node, path)
    names = ["type", *(field.name for field in keys)]
    read_fields(inner, keys, nodes.known_keys(node, path, names, others={"axis": "along"} if ALONG in keys else {}))
    along, back = inner.values.get("along") or (None, False)
    lengths = {field.name: inner.values[field.name] for field in kind.fields if field.name in inner.values}
    return ShapeValue(kind, lengths, along, back), inner.values


def _moments(evaluator: Evaluator, shape: ShapeValue) -> Moments:
    lengths = tuple(evaluator.number(shape.lengths[f.name], f) for f in shape.kind.fields)
    return lambda mass: shape_moments(shape.kind, lengths, mass, shape.along)


def _shape_schemas(more: Sequence[Field] = ()) -> dict[str, Any]:
    return {"anyOf": [typed_schema(kind.name, kind.doc, _shape_keys(kind, more)) for kind in SHAPES.values()]}


class ShapeField(FieldKind):
    """A homogeneous shape about the centre of mass."""

    name = "shape"
    explained = "shape"

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> ShapeValue | None:
        """Return the shape with its lengths."""
        mapping = reading.nodes.mapping(node, path, hint="for example {type: rod, length: 1}")
        found = _read_shape(reading, mapping, path) if mapping else None
        return found and found[0]

    def numbers(self, owner: Owner, field: Field, value: ShapeValue) -> Moments:
        """Return the moments of the shape for any mass."""
        return _moments(owner.evaluator, value)

    def schema(self, field: Field) -> dict[str, Any]:
        """Return the schema of any shape."""
        return _shape_schemas()


class PartsField(FieldKind):
    """Several shapes with their own masses and places."""

    name = "parts"
    explained = "shape"
    more: tuple[Field, ...] = PART

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> tuple[PartValue, ...] | None:
        """Return the parts."""
        if not isinstance(node, SequenceNode) or not node.items:
            masses = " with masses" if PART[0] in self.more else ""
            reading.nodes.complain(node, path, f"expected a list of shapes{masses}")
            return None
        parts = [self._part(reading, item, f"{path}[{i}]") for i, item in enumerate(node.items)]
        return tuple(part for part in parts if part is not None)

    def _part(self, reading: Reading, node: YamlNode, path: str) -> PartValue | None:
        mapping = reading.nodes.mapping(node, path)
        found = _read_shape(reading, mapping, path, self.more) if mapping is not None else None
        return PartValue(found[1].get("mass"), found[0], found[1]["at"]) if found is not None else None

    def numbers(self, owner: Owner, field: Field, value: tuple[PartValue, ...]) -> list[tuple[Number, Vector, Vector]]:
        """Return mass (kg), place (m) and principal moments (kg·m²) of each part."""
        evaluator, mass_field = owner.evaluator, replace(owner.entry.kind.field("mass"), sign="positive")
        found = []
        for part in value:
            assert part.mass is not None
            mass = evaluator.number(part.mass, mass_field)
            found.append((mass, evaluator.vector(part.place, length=True), _moments(evaluator, part.shape)(mass)))
        return found

    def schema(self, field: Field) -> dict[str, Any]:
        """Return the schema of a list of shapes with their places, and masses if they have them."""
        return {"type": "array", "items": _shape_schemas(self.more), "minItems": 1}


class DrawingField(PartsField):
    """Shapes without mass, for pictures: nothing that is computed depends on them."""

    name = "drawing"
    more = PART[1:]

    def numbers(self, owner: Owner, field: Field, value: tuple[PartValue, ...]) -> Any:
        """Return the lengths (m) of each shape and its place (m); they do not count towards the size of the scene."""
        number, vector = owner.evaluator.number, owner.evaluator.vector
        return [
            (tuple(number(x.shape.lengths[f.name], f, length=False) for f in x.shape.kind.fields), vector(x.place))
            for x in value
        ]
