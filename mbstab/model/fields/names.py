"""Fields that name a body, a joint and its motion, or coordinates."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from mbstab.mechanics.catalogue import Field, Marker, Number
from mbstab.mechanics.contacts import SLIPPING, SURFACE
from mbstab.model.expressions import Name, Rate
from mbstab.model.fields.base import BY_NAME, FieldKind, Owner, Reading
from mbstab.model.fields.values import ChoiceField
from mbstab.model.measures import effort_unit
from mbstab.model.schema import Quantity, body_coordinates
from mbstab.model.yamlfile import Scalar, YamlNode


class BodyField(FieldKind):
    """The name of a body that has an orientation."""

    name = "body"

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> str | None:
        """Return the name."""
        word = reading.nodes.word(node, path, "the name of a body")
        if word is None or not reading.names.has_body(node, path, word):
            return None
        if len(body_coordinates(reading.names.bodies[word])) == reading.names.dimension:
            message = f"the body {word!r} is a point: it has no orientation that a torque could turn"
            reading.nodes.complain(node, path, message)
            return None
        return word

    def numbers(self, owner: Owner, field: Field, value: str) -> int:
        """Return the number of the body."""
        return owner.evaluator.body_numbers[value]


class JointField(FieldKind):
    """The name of a joint that has an angle or a travel, wherever it stands in the file."""

    name = "joint"

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> str | None:
        """Return the name."""
        word = reading.nodes.word(node, path, "the name of a joint")
        kind = reading.names.joint(node, path, word) if word is not None else None
        if kind is None:
            return None
        if not kind.motions:
            reading.nodes.complain(node, path, f"a {kind.name} joint has no single angle or travel")
            return None
        reading.joint = kind
        return word

    def numbers(self, owner: Owner, field: Field, value: str) -> Any:
        """Return the joint, an `Item`."""
        return owner.joint_named(value)

    def joints(self, value: str) -> Iterable[str]:
        """Return the name."""
        return (value,)


class MotionField(ChoiceField):
    """Which motion of the joint that the entry names: needed if the joint has several."""

    name = "motion"

    def finish(self, reading: Reading, field: Field) -> None:
        """Refuse a motion that the joint does not have."""
        joint, given = reading.joint, field.name in reading.values
        if joint is None:
            return
        if not given and len(joint.motions) > 1:
            hint = f"add {field.name}: " + f" or {field.name}: ".join(joint.motions)
            message = f"a {joint.name} joint has two motions, say which one is meant"
            reading.nodes.complain(reading.node, reading.path, message, hint)
        elif given and reading.values[field.name] not in joint.motions:
            message = f"a {joint.name} joint has no {reading.values[field.name]}, only {joint.motions[0]}"
            reading.nodes.complain(reading.node.entries[field.name], f"{reading.path}.{field.name}", message)


class SlippingWheelField(FieldKind):
    """The name of a contact of a wheel that may slip across its track, wherever it stands in the file."""

    name = "slipping wheel"

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> str | None:
        """Return the name."""
        word = reading.nodes.word(node, path, "the name of a contact")
        found = reading.names.contact(node, path, word) if word is not None else None
        if found is None:
            return None
        kind, contact = found
        if kind.name != "wheel":
            hint = "name a contact of type: wheel"
            reading.nodes.complain(node, path, f"the contact {word!r} is not a wheel but of type {kind.name!r}", hint)
            return None
        motion = contact.entries.get("motion")
        written = motion.text if isinstance(motion, Scalar) else kind.field("motion").default
        if written not in SLIPPING:
            message = f"the contact {word!r} holds its wheel across the track (motion: {written}): there is no slip"
            reading.nodes.complain(node, path, message, f"write motion: {SLIPPING[0]} in this contact")
            return None
        moved = next((key for key in SURFACE if key in contact.entries), None)
        if moved is not None:
            message = f"the contact {word!r} has a moving plane ({moved}), and slip counts against a plane at rest"
            reading.nodes.complain(node, path, message, "let the body move over a plane at rest instead")
            return None
        return word

    def numbers(self, owner: Owner, field: Field, value: str) -> Any:
        """Return the contact, an `Item`."""
        return owner.contact_named(value)

    def markers(self, numbers: Any) -> Iterable[Marker]:
        """Return the centre of the wheel."""
        return (numbers.marker("center"),)


class CoordinateField(FieldKind):
    """The name of a coordinate such as ``rod.theta``."""

    name = "coordinate"

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> str | None:
        """Return the name."""
        return reading.names.coordinate(node, path)

    def numbers(self, owner: Owner, field: Field, value: str) -> int:
        """Return the number of the coordinate."""
        return owner.evaluator.coordinate_numbers[value]

    def coordinates(self, value: str) -> Iterable[str]:
        """Return the name."""
        return (value,)


class DriveField(FieldKind):
    """The name of a drive, wherever it stands in the file."""

    name = "drive"

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> str | None:
        """Return the name."""
        word = reading.nodes.word(node, path, "the name of a drive")
        return word if word is not None and reading.names.has_drive(node, path, word) else None


class ParameterField(FieldKind):
    """The name of a parameter."""

    name = "parameter"

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> str | None:
        """Return the name."""
        word = reading.nodes.word(node, path, "the name of a parameter")
        if word is None or not isinstance(node, Scalar):
            return None
        reading.names.check_parameter(node, path)
        return word


class LoadsField(FieldKind):
    """Generalized forces by coordinate, as expressions of coordinates, rates and time."""

    name = "loads"
    form = BY_NAME
    names = "keys"
    moving = True

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> dict[str, Quantity] | None:
        """Return the expressions by coordinate."""
        hint = "for example {rod.theta: -c*rate(rod.theta)}"
        mapping = reading.nodes.mapping(node, path, "coordinates with generalized forces", hint)
        if mapping is None:
            return None
        loads = {}
        for key, item in mapping.pairs():
            unit = effort_unit(reading.quantities.unit_of(key.text))
            here = f"{path}.{key.text}"
            expression = reading.quantities.expression(item, here, unit, time=True, state=True, made=field.made)
            name = self._along(reading, key, path)
            if name is not None:
                loads[name] = expression
        return loads

    @staticmethod
    def _along(reading: Reading, key: Scalar, path: str) -> str | None:
        """Return the coordinate or the measure along which a force acts."""
        if "(" not in key.text:
            return reading.names.coordinate(key, path)
        quantity = reading.quantities.quantity(key, f"{path}.{key.text}", state=True)
        root = quantity.root if quantity is not None else None
        if not isinstance(root, (Name, Rate)):
            if quantity is not None:
                hint = "a coordinate such as body.x, or a measure such as angle(joint)"
                reading.nodes.complain(key, path, f"a force cannot act along {key.text!r}", hint)
            return None
        if isinstance(root, Rate) and root.name in ("", *reading.names.coordinates):
            reading.nodes.complain(key, path, f"write {root.name} instead of {key.text}")
            return None
        return root.name

    def check(self, owner: Owner, field: Field, numbers: dict[str, Quantity], time: Number) -> None:
        """Require positive widths of smoothing."""
        for expression in numbers.values():
            owner.evaluator.check_widths(expression)

    def coordinates(self, value: dict[str, Quantity]) -> Iterable[str]:
        """Return the coordinates acted on, and the names in the expressions and of their rates."""
        return {*value, *(name for x in value.values() for name in (*x.names(), *x.rates()))}
