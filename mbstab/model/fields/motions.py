"""The sections ``reference`` and ``initial``: the motion that is asked about, and where a simulation starts."""

from __future__ import annotations

from typing import Any, ClassVar

from mbstab.mechanics.catalogue import Field
from mbstab.model.fields.base import BY_NAME, DIRECTION, NUMBER, FieldKind, NamesIn, Reading
from mbstab.model.fields.catalogue import read_keys
from mbstab.model.fields.mappings import MappingField
from mbstab.model.schema import Components, Initial, Quantity, Reference, Steady, body_coordinates, constant, unit_of
from mbstab.model.yamlfile import Mapping, Scalar, YamlNode


class StateField(FieldKind):
    """Values of coordinates: by body, and of first-order states by name."""

    name = "state"
    names: ClassVar[NamesIn] = "keys"
    form: ClassVar[dict[str, Any]] = {"type": "object", "additionalProperties": {"anyOf": [BY_NAME, NUMBER]}}
    absent: ClassVar[Any] = {}
    per = ""

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> dict[str, Quantity]:
        """Return them by name such as ``rod.theta``."""
        nodes, names, quantities = reading.nodes, reading.names, reading.quantities
        mapping, state = nodes.optional(node, path), {}
        for key, item in mapping.pairs() if mapping else ():
            body, here = key.text, f"{path}.{key.text}"
            if body in names.coordinates:  # a first-order state
                unit = names.state_units.get(body, "")
                state[body] = quantities.expression(item, here, unit + self.per if unit else "")
                continue
            inner = nodes.mapping(item, here)
            if not names.has_body(key, path, body):
                continue
            known = body_coordinates(names.bodies[body])
            if inner is not None:
                nodes.known_keys(inner, here, known)
            for coordinate, value in inner.entries.items() if inner else ():
                if coordinate in known:
                    name = f"{body}.{coordinate}"
                    state[name] = quantities.expression(value, f"{here}.{coordinate}", unit_of(name) + self.per)
        return state


class RatesField(StateField):
    """Rates of coordinates."""

    name = "rates"
    per = "/s"


class GuessField(StateField):
    """Starting values of coordinates, and of rates of a steady motion; a body may be called rates, too."""

    name = "guess"
    names = "guess"
    form: ClassVar[dict[str, Any]] = {
        **StateField.form,
        "properties": {"rates": {**StateField.form, "description": "guesses of rates, with find: steady"}},
    }

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> dict[str, Quantity]:
        """Return those of coordinates; those of rates are the value of ``guess_rates``."""
        if isinstance(node, Mapping) and "rates" in node.entries and "rates" not in reading.names.bodies:
            rest = {key: item for key, item in node.entries.items() if key != "rates"}
            self._read_rates(reading, field, node.entries["rates"], f"{path}.rates")
            node = Mapping(rest, {key: node.keys[key] for key in rest}, node.location)
        return super().read(reading, field, node, path)

    @staticmethod
    def _read_rates(reading: Reading, field: Field, node: YamlNode, path: str) -> None:
        find = reading.node.entries.get("find")
        if not (isinstance(find, Scalar) and find.text == "steady"):
            hint = "write find: steady, or what is known of the motion under reference.rates"
            reading.nodes.complain(node, path, "rates are guessed only of a steady motion that is looked for", hint)
            return
        reading.values["guess_rates"] = RatesField().read(reading, field, node, path)


class TurnAxisField(FieldKind):
    """The axis of a turn, with three components also in the plane."""

    name = "turn axis"
    names = "ground direction"
    form = DIRECTION

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> Components | None:
        """Return the axis."""
        if reading.names.dimension == 3:
            return reading.quantities.direction(node, path, None)
        if reading.nodes.choice(node, path, ("z",)) is None:
            return None
        return Components(tuple(constant(x, node.location, path) for x in "001"), node.location, path)


class SteadyField(MappingField):
    """A motion along a symmetry."""

    name = "steady"
    expected = "{axis: z, rate: …} or {direction: x, speed: …}"

    def build(self, reading: Reading) -> Steady:
        """Return the motion; refuse keys that mean nothing without another."""
        node, path, complain = reading.node, reading.path, reading.nodes.complain
        entries = node.entries
        lonely = [
            (key, needed)
            for key, needed in (("rate", "axis"), ("point", "axis"), ("speed", "direction"))
            if key in entries and needed not in entries
        ]
        for key, needed in lonely:
            if needed == "axis":
                example = "z" if reading.names.dimension == 2 else "z, or -z or a vector such as [0, 0.6, 0.8]"
                hint = f"add axis: {example}; a turn has an axis, in the plane always z"
            else:
                hint = "add direction: x, or -x or a vector; a translation has a direction"
            complain(entries[key], f"{path}.{key}", f"{key} needs {needed}", hint)
        if not lonely and "axis" not in entries and "direction" not in entries:
            complain(node, path, "give an axis of the turn, a direction of the translation, or both")
        return Steady(node.location, **reading.values)


class MotionField(MappingField):
    """A section that says a motion; without it, or after a problem, it is that of no keys."""

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> Any:
        """Return what the keys say, at the place of the section."""
        written = reading.nodes.optional(node, path)
        if written is None:
            mapping = Mapping({}, {}, reading.node.location)
        else:
            mapping = Mapping(written.entries, written.keys, reading.node.keys[field.name].location)
        return self.build(read_keys(reading.quantities, mapping, path, field.keys))


class ReferenceField(MotionField):
    """The reference motion."""

    name = "reference"

    def build(self, reading: Reading) -> Reference:
        """Return the motion; refuse what contradicts what is looked for."""
        entries, find = reading.node.entries, reading.values["find"]

        def complain(key: str, message: str, hint: str) -> None:
            reading.nodes.complain(entries[key], f"reference.{key}", message, hint)

        if find == "steady" and "steady" not in entries:
            hint = "add steady: {axis: z, rate: …} or steady: {direction: x, speed: …}"
            complain("find", "a steady motion needs its symmetry", hint)
        if find == "equilibrium" and "steady" in entries:
            complain("find", "an equilibrium is at rest, but reference.steady asks for a motion", "write find: steady")
        if find == "equilibrium" and "rates" in entries:
            hint = "leave them out, or write find: steady; for a rotor with steady: {axis: z, rate: 0}"
            complain("rates", "an equilibrium is at rest: rates have no effect", hint)
        if "period" in entries and ("find" in entries or "steady" in entries):
            message = "the period belongs to a motion that is neither at rest nor steady"
            complain("period", message, "leave out find and steady, or the period")
        return Reference(reading.node.location, **{"guess_rates": {}, **reading.values})


class InitialField(MotionField):
    """Where a simulation starts."""

    name = "initial"

    def build(self, reading: Reading) -> Initial:
        """Return the start."""
        return Initial(reading.node.location, **reading.values)
