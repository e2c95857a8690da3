"""Nodes to a `Model`: every rule of the file format, all problems of a file at once.

What an entry may contain comes from `mbstab.mechanics.elements.KINDS`; this module only
knows how each shape of field is written.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterable
from pathlib import Path
from typing import Any, TypeVar

from mbstab.errors import Location, suggestion
from mbstab.mechanics import bodies as body_kinds
from mbstab.mechanics.catalogue import Field, Kind, Sign
from mbstab.mechanics.elements import KINDS
from mbstab.model import schema, units
from mbstab.model.arithmetic import CONSTANTS, FLOAT
from mbstab.model.expressions import Expression, ExpressionError, parse
from mbstab.model.functions import FUNCTIONS
from mbstab.model.schema import (
    Components,
    CriticalValue,
    Entry,
    Expectation,
    ExpectedEigenvalue,
    Initial,
    MarkerValue,
    Model,
    Parameter,
    PartValue,
    Quantity,
    Reference,
    ShapeValue,
    Steady,
    SweepRange,
    body_coordinates,
    parse_finite,
)
from mbstab.model.words import WORDS
from mbstab.model.yamlfile import Document, Mapping, Scalar, Sequence, YamlNode, parse_yaml, read_text

Word = TypeVar("Word", bound=str)

NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*\Z")
AXES = {"x": 0, "y": 1, "z": 2}
TENSOR_KEYS = ("xx", "yy", "zz", "xy", "xz", "yz")

CONSTRAINT_KINDS = {
    role: Kind(role, schema.CONSTRAINT_FIELDS[role], (2, 3), (), lambda item: ())
    for role in ("holonomic", "nonholonomic")
}


def read_model(path: Path) -> Model:
    """Read a model file.

    Raises
    ------
    ModelFileError
        With all problems of the file.
    UsageError
        If the file cannot be read.
    """
    return read_model_text(read_text(path), str(path))


def read_model_text(text: str | bytes, name: str = "<text>") -> Model:
    """Read a model from text; `name` is what messages call it."""
    document, root = parse_yaml(text, name)
    return _Reader(document).read(root)


class _Reader:
    """Reads one document; a problem is recorded, and reading goes on with something harmless."""

    def __init__(self, document: Document) -> None:
        self.document = document
        self.dimension = 3
        self.parameters: dict[str, Parameter] = {}
        self.units: dict[str, units.Known] = {}
        # What the file names; an entry with a problem is named, but not read.
        self.named: dict[str, Collection[str]] = {}
        self.body_nodes: dict[str, tuple[Kind, Mapping]] = {}
        self.bodies: dict[str, Entry] = {}
        self.entries: dict[str, dict[str, Entry]] = {}
        self.coordinates: dict[str, None] = {}
        self.geometry: dict[str | None, tuple[dict[str, Components], dict[str, Components]]] = {}

    # --- the file ---------------------------------------------------------------------------------------------------

    def read(self, root: Mapping) -> Model:
        top = root.entries
        self._known_keys(root, "", schema.SECTIONS)
        self._version(root)
        self._parameters(top.get("parameters"))
        self._find_bodies(root)
        self._ground(top.get("ground"))
        self._bodies()
        self.entries = {section: {} for section in (*KINDS, "constraints") if section != "bodies"}
        # Joints first: drives and forces name them.
        for section in ("joints", "contacts", "drives", "forces"):
            self._section(section, top.get(section))
        self._constraints(top.get("constraints"))
        gravity = Scalar("0", root.location) if "gravity" not in top else top["gravity"]
        model = Model(
            document=self.document,
            dimension=self.dimension,
            order=tuple(key for key in top if key in self.entries),
            title=self._text(top.get("title"), "title"),
            source=self._text(top.get("source"), "source"),
            parameters=self.parameters,
            gravity=self._vector(gravity, "gravity", "m/s^2"),
            bodies=self.bodies,
            entries=self.entries,
            reference=self._reference(top.get("reference"), root),
            initial=self._initial(top.get("initial"), root),
            sweep=self._sweep(top.get("sweep")),
            expect=self._expect(top.get("expect")),
        )
        self.document.raise_problems()
        return model

    def _version(self, root: Mapping) -> None:
        node = root.entries.get("mbstab")
        if node is None:
            self.complain(root, "", "the key 'mbstab' is missing", "write mbstab: 1 in the first line")
        elif not isinstance(node, Scalar) or node.text != schema.VERSION:
            self.complain(node, "mbstab", f"this program reads version {schema.VERSION} of the file format")

    def _find_bodies(self, root: Mapping) -> None:
        """Find the types of the bodies, and from them whether vectors have two components or three."""
        if "bodies" not in root.entries:
            self.document.fail(root.location, "", "the key 'bodies' is missing")
        section = self._mapping(root.entries["bodies"], "bodies")
        self.named["bodies"] = section.entries if section else ()
        dimensions: dict[int, str] = {}
        for key, node in section.pairs() if section else ():
            name, path = key.text, f"bodies.{key.text}"
            self._check_name(key, path, "body", reserved=("ground",))
            mapping = self._mapping(node, path)
            kind = self._type(mapping, "bodies", path, None) if mapping else None
            if mapping is not None and kind is not None:
                self.body_nodes[name] = kind, mapping
                dimensions.setdefault(kind.dimensions[0], name)
        if section is not None and not section.entries:
            self.complain(section, "bodies", "a model has one body at least")
        if len(dimensions) > 1:
            flat, deep = dimensions[2], dimensions[3]
            message = f"planar and spatial bodies cannot be mixed: {flat!r} is planar, {deep!r} spatial"
            hint = "a planar body is a spatial one with a planar joint to the ground"
            self.complain(root.entries["bodies"], "bodies", message, hint)
        if len(dimensions) != 1:
            self.document.raise_problems()
        self.dimension = min(dimensions)

    def _ground(self, node: YamlNode | None) -> None:
        ground = self._optional(node, "ground")
        if ground is not None:
            self._known_keys(ground, "ground", schema.GEOMETRY_FIELDS)
        entries = ground.entries if ground else {}
        self.geometry[None] = (
            self._points(entries.get("points"), "ground.points", "m"),
            self._points(entries.get("directions"), "ground.directions"),
        )

    # --- problems ---------------------------------------------------------------------------------------------------

    def complain(self, node: YamlNode | Location, path: str, message: str, hint: str = "") -> None:
        location = node if isinstance(node, Location) else node.location
        self.document.complain(location, path, message, hint)

    def _known_keys(self, node: Mapping, path: str, known: Iterable[str]) -> None:
        known = list(known)
        for key, scalar in node.keys.items():
            if key not in known:
                hint = suggestion(key, known) or "known keys: " + ", ".join(known)
                self.complain(scalar, path, f"unknown key {key!r}", hint)

    def _check_name(self, key: Scalar, path: str, what: str, reserved: Iterable[str] = ()) -> bool:
        if not NAME.match(key.text):
            self.complain(key, path, f"{key.text!r} is no name for a {what}", "use letters, digits and _")
            return False
        if key.text in reserved:
            self.complain(key, path, f"the name {key.text!r} is taken and cannot be a {what}")
            return False
        return True

    # --- simple nodes -----------------------------------------------------------------------------------------------

    def _mapping(self, node: YamlNode, path: str, expected: str = "keys with values", hint: str = "") -> Mapping | None:
        if not isinstance(node, Mapping):
            self.complain(node, path, f"expected {expected}", hint)
            return None
        return node

    def _optional(self, node: YamlNode | None, path: str) -> Mapping | None:
        """Read a mapping that may be missing, or empty because all of it is commented out."""
        if node is None or (isinstance(node, Scalar) and node.empty):
            return None
        return self._mapping(node, path)

    def _required(self, node: Mapping, key: str, path: str, hint: str = "") -> YamlNode | None:
        if key not in node.entries:
            self.complain(node, path, f"the key {key!r} is missing", hint)
            return None
        return node.entries[key]

    def _text(self, node: YamlNode | None, path: str) -> str:
        if node is None:
            return ""
        if not isinstance(node, Scalar):
            self.complain(node, path, "expected text")
            return ""
        return " ".join(node.text.split())

    def _word(self, node: YamlNode, path: str, what: str) -> str | None:
        if not isinstance(node, Scalar) or node.empty:
            self.complain(node, path, f"expected {what}")
            return None
        return node.text

    def _quantity(
        self, node: YamlNode, path: str, unit: str = "", time: bool = False, state: bool = False
    ) -> Quantity | None:
        """Read an expression; `time` allows t, `state` coordinates and rates. None if there is a problem."""
        if not isinstance(node, Scalar) or node.empty:
            self.complain(node, path, "expected a number or an expression" + _unit(unit))
            return None
        try:
            expression = parse_finite(node.text, self.parameters)
            self._check_names(expression, time, state)
            self._check_unit(expression, unit)
        except ExpressionError as error:
            self.complain(self.document.locate(node, error.position), path, error.message, error.hint)
            return None
        return Quantity(expression.text, expression.root, node.location, path)

    def _expression(
        self, node: YamlNode, path: str, unit: str = "", time: bool = False, state: bool = False
    ) -> Quantity:
        """Read an expression as `_quantity` does; 1 if there is a problem."""
        return self._quantity(node, path, unit, time, state) or _constant("1", node.location, path)

    def _check_names(self, expression: Expression, time: bool, state: bool) -> None:
        for name, at in expression.names().items():
            if name in self.parameters or (name == "t" and time):
                continue
            if name == "t":
                raise ExpressionError("the time t cannot be used here", at)
            if "." in name:
                self._check_coordinate(name, at, state)
                continue
            known = [*self.parameters, *FUNCTIONS, *CONSTANTS, *(("t",) if time else ())]
            raise ExpressionError(f"unknown parameter {name!r}", at, suggestion(name, known))
        for name, at in expression.rates().items():
            if not state:
                raise ExpressionError("rate(...) cannot be used here", at)
            self._check_coordinate(name, at, state)

    def _check_coordinate(self, name: str, at: int, allowed: bool) -> None:
        if not allowed:
            raise ExpressionError(f"coordinates such as {name!r} cannot be used here", at)
        if name not in self.coordinates and not self._unread(name):
            raise ExpressionError(f"unknown coordinate {name!r}", at, suggestion(name, self.coordinates))

    def _check_unit(self, expression: Expression, unit: str) -> None:
        found = units.dimension_of(expression, self.units)
        if not unit or isinstance(found, str):
            return
        expected = units.parse_unit(unit)[1]
        if found != expected:
            message = f"{expression.text!r} has the unit {units.show(found)}, expected {unit}"
            raise ExpressionError(message, 0, "check the units declared under parameters")

    def _components(self, items: Iterable[YamlNode], node: YamlNode, path: str, unit: str, time: bool) -> Components:
        values = (self._expression(item, f"{path}[{i}]", unit, time) for i, item in enumerate(items))
        return Components(tuple(values), node.location, path)

    def _vector(self, node: YamlNode, path: str, unit: str = "", time: bool = False) -> Components:
        """Read a vector: a list, or the name of an axis such as -z, or 0."""
        if isinstance(node, Scalar):
            named = self._axis(node, path)
            if named is not None:
                return named
            if node.text.strip() == "0":
                return self._zero(node, path)
        if not isinstance(node, Sequence):
            self.complain(node, path, f"expected a list of {self.dimension} numbers{_unit(unit)}")
            return self._zero(node, path)
        if len(node.items) != self.dimension:
            count = len(node.items)
            self.complain(node, path, f"expected {self.dimension} numbers{_unit(unit)}, got {count}")
            return self._zero(node, path)
        return self._components(node.items, node, path, unit, time)

    def _zero(self, node: YamlNode, path: str) -> Components:
        zero = _constant("0", node.location, path)
        return Components((zero,) * self.dimension, node.location, path)

    def _axis(self, node: Scalar, path: str) -> Components | None:
        text = node.text
        sign, letter = ("-1", text[1:]) if text.startswith("-") else ("1", text)
        if letter not in list(AXES)[: self.dimension]:
            return None
        numbers = (sign if i == AXES[letter] else "0" for i in range(self.dimension))
        return Components(tuple(_constant(x, node.location, path) for x in numbers), node.location, path)

    def _points(self, node: YamlNode | None, path: str, unit: str = "") -> dict[str, Components]:
        mapping = self._optional(node, path)
        found = {}
        for key, item in mapping.pairs() if mapping else ():
            here = f"{path}.{key.text}"
            self._check_name(key, here, "point", reserved=AXES)
            found[key.text] = self._vector(item, here, unit)
        return found

    # --- parameters -------------------------------------------------------------------------------------------------

    def _parameters(self, node: YamlNode | None) -> None:
        section = self._optional(node, "parameters")
        if section is None:
            return
        raw: dict[str, tuple[Scalar, str, float, str, Sign]] = {}
        for key, item in section.pairs():
            path = f"parameters.{key.text}"
            if self._check_name(key, path, "parameter", reserved=("t", "rate", *FUNCTIONS, *CONSTANTS)):
                raw[key.text] = self._parameter(item, path)
        # The names first: a value may use any of them.
        self.parameters = {
            name: Parameter(name, _constant("1", value.location, f"parameters.{name}"), value.location)
            for name, (value, *_) in raw.items()
        }
        order = self._parameter_order({name: value for name, (value, *_) in raw.items()})
        for name in order:
            value, unit, factor, description, sign = raw[name]
            expression = self._expression(value, f"parameters.{name}")
            if unit:
                self.units[name] = units.parse_unit(unit)[1]
                if not expression.literal:
                    self._check_derived(value, expression, unit, factor)
                    factor = 1.0
            else:
                found = units.dimension_of(expression, self.units)
                # A bare number may be meant in any unit.
                self.units[name] = units.UNKNOWN if isinstance(found, str) else found
            self.parameters[name] = Parameter(name, expression, value.location, unit, factor, description, sign)
        self.parameters = {name: self.parameters[name] for name in order}

    def _parameter(self, node: YamlNode, path: str) -> tuple[Scalar, str, float, str, Sign]:
        """Return the node of the value, unit, factor to SI, description and sign of a parameter."""
        unit, factor, description, value = "", 1.0, "", node
        sign: Sign = "any"
        if isinstance(node, Mapping):
            self._known_keys(node, path, schema.PARAMETER_FIELDS)
            description = self._text(node.entries.get("description"), f"{path}.description")
            unit, factor = self._unit_of(node.entries.get("unit"), f"{path}.unit")
            if "sign" in node.entries:
                sign = self._choice(node.entries["sign"], f"{path}.sign", schema.SIGNS) or sign
            value = self._required(node, "value", path) or Scalar("1", node.location)
        if not isinstance(value, Scalar):
            self.complain(value, path, "expected a number or an expression")
            value = Scalar("1", value.location)
        return value, unit, factor, description, sign

    def _check_derived(self, value: Scalar, expression: Quantity, unit: str, factor: float) -> None:
        if factor != 1.0:
            hint = "expressions are computed in kg, m, s and rad; declare the unit in these"
            self.complain(value, expression.path, f"an expression cannot have the unit {unit}", hint)
            return
        try:
            self._check_unit(expression, unit)
        except ExpressionError as error:
            self.complain(self.document.locate(value, error.position), expression.path, error.message, error.hint)

    def _unit_of(self, node: YamlNode | None, path: str) -> tuple[str, float]:
        if node is None:
            return "", 1.0
        if not isinstance(node, Scalar) or node.empty:
            self.complain(node, path, "expected a unit such as kg*m^2")
            return "", 1.0
        try:
            return node.text, units.parse_unit(node.text)[0]
        except ExpressionError as error:
            self.complain(self.document.locate(node, error.position), path, error.message, error.hint)
            return "", 1.0

    def _parameter_order(self, raw: dict[str, Scalar]) -> list[str]:
        """Return the parameters so that each comes after those it needs; circles are named, and cut."""
        needs: dict[str, list[str]] = {}
        for name, value in raw.items():
            try:
                needs[name] = [other for other in parse(value.text).names() if other in raw]
            except ExpressionError:  # complained about when the value is read
                needs[name] = []
        done: dict[str, None] = {}
        for start in raw:
            if start in done:
                continue
            path = {start: iter(needs[start])}
            while path:
                name = next(reversed(path))
                following = next((other for other in path[name] if other not in done), None)
                if following is None:
                    del path[name]
                    done[name] = None
                elif following in path:
                    names = list(path)
                    circle = [*names[names.index(following) :], following]
                    message = "parameters depend on each other in a circle: " + " → ".join(circle)
                    self.complain(raw[following], f"parameters.{following}", message)
                else:
                    path[following] = iter(needs[following])
        return list(done)

    # --- entries ----------------------------------------------------------------------------------------------------

    def _type(self, node: Mapping, section: str, path: str, dimension: int | None) -> Kind | None:
        kinds = KINDS[section]
        here = sorted({name for name, d in kinds if dimension in (None, d)})
        type_node = node.entries.get("type")
        if type_node is None:
            self.complain(node, path, "the key 'type' is missing", "known types: " + ", ".join(here))
            return None
        name = self._word(type_node, f"{path}.type", "a type")
        if name is None:
            return None
        found = [kind for (kind_name, d), kind in kinds.items() if kind_name == name and dimension in (None, d)]
        if found:
            return found[0]
        other = any(kind_name == name for kind_name, _ in kinds)
        scene = "planar" if dimension == 2 else "spatial"
        message = f"the type {name!r} does not exist in a {scene} scene" if other else f"unknown type {name!r}"
        self.complain(type_node, f"{path}.type", message, suggestion(name, here) or "known types: " + ", ".join(here))
        return None

    def _bodies(self) -> None:
        for name, (kind, node) in self.body_nodes.items():
            entry = self._entry("bodies", name, kind, node)
            self.bodies[name] = entry
            self._check_distribution(entry, node)
            self.geometry[name] = (entry.values.get("points", {}), entry.values.get("directions", {}))
        names = (f"{name}.{c}" for name, body in self.bodies.items() for c in body_coordinates(body))
        self.coordinates = dict.fromkeys(names)

    def _check_distribution(self, entry: Entry, node: Mapping) -> None:
        given = [key for key in ("inertia", "shape", "parts") if key in entry.places]
        if "parts" in given:
            for key in ("mass", "inertia", "shape", "center_of_mass"):
                if key in entry.places:
                    message = f"{key!r} and 'parts' cannot both be given"
                    self.complain(entry.places[key], entry.path, message, "each part has its own mass")
            return
        self._required(node, "mass", entry.path)
        if not given and any(field.name == "inertia" for field in entry.kind.fields):
            hint = "give inertia, shape or parts; a body without orientation is a point"
            self.complain(node, entry.path, "the body has no inertia", hint)
        elif len(given) > 1:
            message = f"{given[0]!r} and {given[1]!r} cannot both be given"
            self.complain(entry.places[given[1]], entry.path, message)

    def _section(self, section: str, node: YamlNode | None) -> None:
        mapping = self._optional(node, section)
        self.named[section] = mapping.entries if mapping else ()
        for key, item in mapping.pairs() if mapping else ():
            name, path = key.text, f"{section}.{key.text}"
            self._check_name(key, path, section.removesuffix("s"))
            entry_node = self._mapping(item, path)
            kind = self._type(entry_node, section, path, self.dimension) if entry_node else None
            if entry_node is not None and kind is not None:
                self.entries[section][name] = self._entry(section, name, kind, entry_node)

    def _entry(self, section: str, name: str, kind: Kind, node: Mapping) -> Entry:
        path = f"{section}.{name}"
        fields = [field for field in kind.fields if self.dimension in field.dimensions]
        self._known_keys(node, path, ["type", *[field.name for field in fields]])
        values: dict[str, Any] = {}
        places = {field.name: node.entries[field.name].location for field in fields if field.name in node.entries}
        markers: list[str | None] = []
        for field in fields:
            item = node.entries.get(field.name)
            if item is None and field.required:
                self.complain(node, path, f"the key {field.name!r} is missing", field.doc)
            if item is None and field.default is not None:
                item = Scalar(field.default, node.location)
            value = self._field(field, item, f"{path}.{field.name}", markers) if item is not None else None
            if value is not None:
                values[field.name] = value
        for group in kind.one_of:
            given = [key for key in group if key in values]
            if len(given) != 1:
                found = "none" if not given else "both"
                self.complain(node, path, f"give one of {' and '.join(map(repr, group))}, {found} given")
        if "joint" in values:
            joint = self.entries["joints"][values["joint"]].kind
            if "motion" not in values and len(joint.motions) > 1:
                hint = "add motion: " + " or motion: ".join(joint.motions)
                self.complain(node, path, f"a {joint.name} joint has two motions, say which one is meant", hint)
            elif "motion" in values and values["motion"] not in joint.motions:
                message = f"a {joint.name} joint has no {values['motion']}, only {joint.motions[0]}"
                self.complain(places["motion"], f"{path}.motion", message)
        return Entry(section, name, kind, values, node.location, places)

    # --- fields: one reader for each shape --------------------------------------------------------------------------

    def _field(self, field: Field, node: YamlNode, path: str, markers: list[str | None]) -> Any:
        unit = "" if field.unit == "1" else field.unit  # "1" stands for everything without a declared unit
        match field.shape:
            case "number":
                return self._expression(node, path, unit)
            case "law":
                return self._expression(node, path, unit, time=True)
            case "vector":
                return self._vector(node, path, unit)
            case "law vector":
                return self._vector(node, path, unit, time=True)
            case "choice":
                return self._choice(node, path, field.choices)
            case "body":
                return self._body_name(node, path)
            case "joint":
                return self._joint_name(node, path)
            case "coordinate":
                return self._coordinate_name(node, path)
            case "marker":
                return self._body_marker(node, path, markers)
            case "markers":
                return self._markers(node, path, markers)
            case "direction":
                return self._direction(node, path, markers[0]) if markers else None
            case "directions":
                return self._directions(node, path, markers)
            case "tensor":
                return self._tensor(node, path, unit)
            case "points":
                return self._points(node, path, unit)
            case "shape":
                return self._shape(node, path)
            case "parts":
                return self._parts(node, path)
            case "angles":
                return self._angles(node, path, unit)
            case "loads":
                return self._loads(node, path)
            case _:
                raise AssertionError(field.shape)

    def _choice(self, node: YamlNode, path: str, choices: tuple[Word, ...]) -> Word | None:
        word = self._word(node, path, "one of " + ", ".join(choices))
        if word is not None and word not in choices:
            hint = suggestion(word, choices) or "one of " + ", ".join(choices)
            self.complain(node, path, f"unknown choice {word!r}", hint)
        return next((choice for choice in choices if choice == word), None)

    def _found(self, node: YamlNode, path: str, word: str, what: str, known: Collection[str]) -> bool:
        """Whether a name is known; one that is in the file but could not be read has its problem already."""
        section = "joints" if what == "joint" else "bodies"
        if word not in known and word not in self.named[section]:
            self.complain(node, path, f"there is no {what} {word!r}", suggestion(word, known))
        return word in known

    def _unread(self, coordinate: str) -> bool:
        """Whether a coordinate belongs to a body that is in the file but could not be read."""
        body = coordinate.partition(".")[0]
        return body in self.named["bodies"] and body not in self.bodies

    def _body_name(self, node: YamlNode, path: str) -> str | None:
        word = self._word(node, path, "the name of a body")
        if word is None or not self._found(node, path, word, "body", self.bodies):
            return None
        if len(body_coordinates(self.bodies[word])) == self.dimension:
            self.complain(node, path, f"the body {word!r} is a point: it has no orientation that a torque could turn")
            return None
        return word

    def _joint_name(self, node: YamlNode, path: str) -> str | None:
        word = self._word(node, path, "the name of a joint")
        if word is None or not self._found(node, path, word, "joint", self.entries["joints"]):
            return None
        kind = self.entries["joints"][word].kind
        if not kind.motions:
            self.complain(node, path, f"a {kind.name} joint has no single angle or travel")
            return None
        return word

    def _coordinate_name(self, node: YamlNode, path: str) -> str | None:
        word = self._word(node, path, "a coordinate such as body.x")
        if word is None or self._unread(word):
            return None
        if word not in self.coordinates:
            hint = suggestion(word, self.coordinates) or "coordinates: " + ", ".join(list(self.coordinates)[:12])
            self.complain(node, path, f"there is no coordinate {word!r}", hint)
            return None
        return word

    def _marker(self, node: YamlNode, path: str) -> MarkerValue | None:
        if isinstance(node, Mapping):
            self._known_keys(node, path, schema.MARKER_FIELDS)
            point_node = node.entries.get("point")
            point = self._vector(point_node, f"{path}.point", "m") if point_node else self._zero(node, f"{path}.point")
            body_node = self._required(node, "body", path)
            word = self._word(body_node, f"{path}.body", "the name of a body or ground") if body_node else None
            if body_node is None or word is None or not self._body_or_ground(body_node, f"{path}.body", word):
                return None
            return MarkerValue(None if word == "ground" else word, point)
        word = self._word(node, path, "a point such as body.point, body or ground")
        if word is None:
            return None
        name, _, point_name = word.partition(".")
        if not self._body_or_ground(node, path, name):
            return None
        body = None if name == "ground" else name
        if not point_name:
            return MarkerValue(body, self._zero(node, path))
        points = self.geometry[body][0]
        if point_name not in points:
            hint = suggestion(point_name, points) or "its points: " + (", ".join(points) or "none")
            self.complain(node, path, f"{_owner(body)} has no point {point_name!r}", hint)
            return None
        return MarkerValue(body, points[point_name])

    def _body_or_ground(self, node: YamlNode, path: str, word: str) -> bool:
        return self._found(node, path, word, "body", [*self.bodies, "ground"])

    def _body_marker(self, node: YamlNode, path: str, markers: list[str | None]) -> MarkerValue | None:
        marker = self._marker(node, path)
        if marker is None:
            return None
        if marker.body is None:
            self.complain(node, path, "expected a point of a body, not of the ground")
            return None
        markers.append(marker.body)
        return marker

    def _markers(self, node: YamlNode, path: str, markers: list[str | None]) -> tuple[MarkerValue, MarkerValue] | None:
        if not isinstance(node, Sequence) or len(node.items) != 2:
            self.complain(node, path, "expected a list of two points", "for example [rod.O, ground]")
            return None
        first, second = (self._marker(item, f"{path}[{i}]") for i, item in enumerate(node.items))
        if first is None or second is None:
            return None
        if first.body == second.body:
            self.complain(node, path, f"both points belong to {_owner(first.body)}")
            return None
        markers += [first.body, second.body]
        return first, second

    def _direction(self, node: YamlNode, path: str, body: str | None) -> Components | None:
        if not isinstance(node, Scalar):
            return self._vector(node, path)
        named = self._axis(node, path)
        if named is not None:
            return named
        word = self._word(node, path, "a direction such as x or -y, or a list of numbers")
        directions = self.geometry[body][1]
        if word is not None and word not in directions:
            known = [*list(AXES)[: self.dimension], *directions]
            hint = suggestion(word, known) or "known directions: " + ", ".join(known)
            self.complain(node, path, f"{_owner(body)} has no direction {word!r}", hint)
        return directions.get(word) if word is not None else None

    def _directions(self, node: YamlNode, path: str, markers: list[str | None]) -> tuple[Components, Components] | None:
        if len(markers) != 2:  # the two points are wrong, and that is said
            return None
        nodes = [node, node]
        # In the plane [a, b] is a vector unless its items are names or lists.
        items = node.items if isinstance(node, Sequence) else []
        if len(items) == 2 and (self.dimension == 3 or all(map(self._is_direction, items))):
            nodes = items
        first, second = (self._direction(item, path, body) for item, body in zip(nodes, markers, strict=True))
        return None if first is None or second is None else (first, second)

    def _is_direction(self, node: YamlNode) -> bool:
        if not isinstance(node, Scalar):
            return isinstance(node, Sequence)
        named = any(node.text in directions for _, directions in self.geometry.values())
        return named or self._axis(node, "") is not None

    def _tensor(self, node: YamlNode, path: str, unit: str) -> Components | None:
        """Read an inertia: a number in the plane; in space xx, yy, zz, xy, xz, yz, or a matrix row by row."""
        if self.dimension == 2:
            return Components((self._expression(node, path, unit),), node.location, path)
        zero = _constant("0", node.location, path)
        if isinstance(node, Mapping):
            self._known_keys(node, path, TENSOR_KEYS)
            for key in TENSOR_KEYS[:3]:
                self._required(node, key, path)
            entries = node.entries
            found = (self._expression(entries[k], f"{path}.{k}", unit) if k in entries else zero for k in TENSOR_KEYS)
            return Components(tuple(found), node.location, path)
        if isinstance(node, Sequence) and len(node.items) == 3:
            rows = [item for item in node.items if isinstance(item, Sequence)]
            if not rows:
                moments = self._components(node.items, node, path, unit, False)
                return Components((*moments.values, zero, zero, zero), node.location, path)
            if len(rows) == 3 and all(len(row.items) == 3 for row in rows):
                lines = [self._components(row.items, row, f"{path}[{i}]", unit, False) for i, row in enumerate(rows)]
                return Components(tuple(x for line in lines for x in line.values), node.location, path)
        keys = ", ".join(TENSOR_KEYS)
        self.complain(node, path, f"expected three principal moments, a 3×3 matrix, or keys {keys} (kg*m^2)")
        return None

    def _shape_fields(self, node: Mapping, path: str, extra: Iterable[str] = ()) -> ShapeValue | None:
        known = "known shapes: " + ", ".join(body_kinds.SHAPES)
        type_node = self._required(node, "type", path, known)
        word = self._word(type_node, f"{path}.type", "a shape") if type_node is not None else None
        if type_node is None or word is None:
            return None
        kind = body_kinds.SHAPES.get(word)
        if kind is None:
            hint = suggestion(word, body_kinds.SHAPES) or known
            self.complain(type_node, f"{path}.type", f"unknown shape {word!r}", hint)
            return None
        axis = ("along",) if kind.axis is not None else ()
        self._known_keys(node, path, ("type", *(f.name for f in kind.fields), *axis, *extra))
        lengths = {}
        for field in kind.fields:
            item: YamlNode | None = Scalar(field.default or "1", node.location)
            if field.required or field.name in node.entries:
                item = self._required(node, field.name, path, field.doc) or item
            assert item is not None
            lengths[field.name] = self._expression(item, f"{path}.{field.name}", field.unit)
        along = None
        if axis and "along" in node.entries:
            letter = self._choice(node.entries["along"], f"{path}.along", tuple(AXES))
            along = AXES[letter] if letter else None
        return ShapeValue(kind, lengths, along)

    def _shape(self, node: YamlNode, path: str) -> ShapeValue | None:
        mapping = self._mapping(node, path, hint="for example {type: rod, length: 1}")
        return self._shape_fields(mapping, path) if mapping else None

    def _parts(self, node: YamlNode, path: str) -> tuple[PartValue, ...] | None:
        if not isinstance(node, Sequence) or not node.items:
            self.complain(node, path, "expected a list of shapes with masses")
            return None
        parts = [self._part(item, f"{path}[{i}]") for i, item in enumerate(node.items)]
        return tuple(part for part in parts if part is not None)

    def _part(self, node: YamlNode, path: str) -> PartValue | None:
        mapping = self._mapping(node, path)
        if mapping is None:
            return None
        shape = self._shape_fields(mapping, path, schema.PART_FIELDS)
        mass_node = self._required(mapping, "mass", path)
        mass = self._expression(mass_node, f"{path}.mass", "kg") if mass_node is not None else None
        at = mapping.entries.get("at", Scalar("0", mapping.location))
        place = self._vector(at, f"{path}.at", "m")
        return PartValue(mass, shape, place) if shape is not None and mass is not None else None

    def _angles(self, node: YamlNode, path: str, unit: str) -> Components | None:
        if not isinstance(node, Sequence) or len(node.items) != 3:
            self.complain(node, path, "expected three angles (rad)", "for example [pi/2, 0, 0]")
            return None
        return self._components(node.items, node, path, unit, False)

    def _loads(self, node: YamlNode, path: str) -> dict[str, Quantity] | None:
        hint = "for example {rod.theta: -c*rate(rod.theta)}"
        mapping = self._mapping(node, path, "coordinates with generalized forces", hint)
        if mapping is None:
            return None
        loads = {}
        for key, item in mapping.pairs():
            expression = self._expression(item, f"{path}.{key.text}", time=True, state=True)
            if self._coordinate_name(key, path) is not None:
                loads[key.text] = expression
        return loads

    def _constraints(self, node: YamlNode | None) -> None:
        section = self._optional(node, "constraints")
        for key, item in section.pairs() if section else ():
            name, path = key.text, f"constraints.{key.text}"
            self._check_name(key, path, "constraint")
            mapping = self._mapping(item, path, "{holonomic: expression} or {nonholonomic: expression}")
            if mapping is None:
                continue
            self._known_keys(mapping, path, CONSTRAINT_KINDS)
            given = [role for role in CONSTRAINT_KINDS if role in mapping.entries]
            if len(given) != 1:
                self.complain(mapping, path, "give one of 'holonomic' and 'nonholonomic'")
                continue
            role = given[0]
            value = mapping.entries[role]
            expression = self._quantity(value, f"{path}.{role}", time=True, state=True)
            if expression is None:
                continue
            if role == "holonomic" and expression.rates():
                message = "a holonomic constraint contains no rates"
                self.complain(value, expression.path, message, "make it nonholonomic")
            elif role == "holonomic" and not expression.names().keys() & self.coordinates.keys():
                self.complain(value, expression.path, "the constraint contains no coordinate")
            elif role == "nonholonomic" and not expression.rates():
                self.complain(value, expression.path, "the constraint contains no rate of a coordinate")
            places = {role: value.location}
            kind = CONSTRAINT_KINDS[role]
            self.entries["constraints"][name] = Entry(
                "constraints", name, kind, {role: expression}, mapping.location, places
            )

    # --- reference, sweep, expect -----------------------------------------------------------------------------------

    def _reference(self, node: YamlNode | None, root: Mapping) -> Reference:
        mapping = self._optional(node, "reference")
        if mapping is not None:
            self._known_keys(mapping, "reference", schema.REFERENCE_FIELDS)
        entries = mapping.entries if mapping else {}
        return Reference(
            root.keys["reference"].location if mapping else root.location,
            self._expression(entries.get("time", Scalar("0", root.location)), "reference.time", "s"),
            self._state(entries.get("coordinates"), "reference.coordinates"),
            self._state(entries.get("rates"), "reference.rates", "/s"),
            self._state(entries.get("guess"), "reference.guess"),
            *self._search(entries),
            self._expression(entries["period"], "reference.period", "s") if "period" in entries else None,
        )

    def _initial(self, node: YamlNode | None, root: Mapping) -> Initial:
        mapping = self._optional(node, "initial")
        if mapping is not None:
            self._known_keys(mapping, "initial", schema.INITIAL_FIELDS)
        entries = mapping.entries if mapping else {}
        return Initial(
            root.keys["initial"].location if mapping else root.location,
            self._expression(entries["time"], "initial.time", "s") if "time" in entries else None,
            self._state(entries.get("coordinates"), "initial.coordinates"),
            self._state(entries.get("rates"), "initial.rates", "/s"),
        )

    def _search(self, entries: dict[str, YamlNode]) -> tuple[str | None, Steady | None]:
        """Read what kind of motion is looked for, and along which symmetry."""
        find = self._choice(entries["find"], "reference.find", schema.FINDS) if "find" in entries else None
        steady = self._steady(entries["steady"]) if "steady" in entries else None
        if find == "steady" and "steady" not in entries:
            hint = "add steady: {axis: z, rate: …} or steady: {direction: x, speed: …}"
            self.complain(entries["find"], "reference.find", "a steady motion needs its symmetry", hint)
        if find == "equilibrium" and "steady" in entries:
            message = "an equilibrium is at rest, but reference.steady asks for a motion"
            self.complain(entries["find"], "reference.find", message, "write find: steady")
        if find == "equilibrium" and "rates" in entries:
            message = "an equilibrium is at rest: rates have no effect"
            self.complain(entries["rates"], "reference.rates", message, "leave them out, or write find: steady")
        if "period" in entries and ("find" in entries or "steady" in entries):
            message = "the period belongs to a motion that is neither at rest nor steady"
            self.complain(entries["period"], "reference.period", message, "leave out find and steady, or the period")
        return find, steady

    def _steady(self, node: YamlNode) -> Steady | None:
        path = "reference.steady"
        mapping = self._mapping(node, path, "{axis: z, rate: …} or {direction: x, speed: …}")
        if mapping is None:
            return None
        self._known_keys(mapping, path, schema.STEADY_FIELDS)
        entries = mapping.entries
        lonely = [
            (key, needed)
            for key, needed in (("rate", "axis"), ("point", "axis"), ("speed", "direction"))
            if key in entries and needed not in entries
        ]
        for key, needed in lonely:
            if needed == "axis":
                example = "z" if self.dimension == 2 else "z, or -z or a vector such as [0, 0.6, 0.8]"
                hint = f"add axis: {example}; a turn has an axis, in the plane always z"
            else:
                hint = "add direction: x, or -x or a vector; a translation has a direction"
            self.complain(entries[key], f"{path}.{key}", f"{key} needs {needed}", hint)
        if not lonely and "axis" not in entries and "direction" not in entries:
            self.complain(mapping, path, "give an axis of the turn, a direction of the translation, or both")
        axis = None
        if "axis" in entries and self.dimension == 3:
            axis = self._vector(entries["axis"], f"{path}.axis")
        elif "axis" in entries and self._choice(entries["axis"], f"{path}.axis", ("z",)):
            place = entries["axis"].location
            axis = Components(tuple(_constant(x, place, f"{path}.axis") for x in "001"), place, f"{path}.axis")
        quantities = {
            key: self._expression(entries[key], f"{path}.{key}", unit) if key in entries else None
            for key, unit in (("rate", "rad/s"), ("speed", "m/s"))
        }
        vectors = {
            key: self._vector(entries[key], f"{path}.{key}", unit) if key in entries else None
            for key, unit in (("point", "m"), ("direction", ""))
        }
        return Steady(
            mapping.location, axis, quantities["rate"], vectors["point"], vectors["direction"], quantities["speed"]
        )

    def _state(self, node: YamlNode | None, path: str, per: str = "") -> dict[str, Quantity]:
        mapping = self._optional(node, path)
        state = {}
        for key, item in mapping.pairs() if mapping else ():
            body, here = key.text, f"{path}.{key.text}"
            inner = self._mapping(item, here)
            if not self._found(key, path, body, "body", self.bodies):
                continue
            known = body_coordinates(self.bodies[body])
            if inner is not None:
                self._known_keys(inner, here, known)
            for coordinate, value in inner.entries.items() if inner else ():
                if coordinate in known:
                    unit = ("m" if coordinate in AXES else "rad") + per
                    state[f"{body}.{coordinate}"] = self._expression(value, f"{here}.{coordinate}", unit)
        return state

    def _sweep(self, node: YamlNode | None) -> dict[str, SweepRange]:
        mapping = self._optional(node, "sweep")
        ranges: dict[str, SweepRange] = {}
        for key, item in mapping.pairs() if mapping else ():
            path = f"sweep.{key.text}"
            self._known_parameter(key, path)
            inner = self._mapping(item, path, "{from: …, to: …, points: …}")
            if inner is None:
                continue
            self._known_keys(inner, path, schema.SWEEP_FIELDS)
            ends = [(self._required(inner, key, path), f"{path}.{key}") for key in ("from", "to")]
            start, stop = (self._expression(end or Scalar("1", inner.location), here) for end, here in ends)
            points = self._integer(inner.entries.get("points"), f"{path}.points", 2, 10_000_000, 401)
            ranges[key.text] = SweepRange(start, stop, points)
        return ranges

    def _known_parameter(self, node: Scalar, path: str) -> None:
        if node.text not in self.parameters:
            self.complain(node, path, f"there is no parameter {node.text!r}", suggestion(node.text, self.parameters))

    def _integer(self, node: YamlNode | None, path: str, low: int, high: int, default: int) -> int:
        if node is None:
            return default
        if isinstance(node, Scalar) and re.fullmatch(r"[+-]?[0-9]{1,9}", node.text) and low <= int(node.text) <= high:
            return int(node.text)
        self.complain(node, path, f"expected a whole number between {low} and {high}")
        return default

    def _tolerance(self, node: YamlNode | None, path: str, default: float) -> float:
        if node is None:
            return default
        expression = self._quantity(node, path)
        if expression is None:
            return default
        value = expression.evaluate({}, FLOAT) if expression.literal else math.nan
        if not 0.0 < value < 1.0:
            self.complain(node, path, "expected a number between 0 and 1")
            return default
        return float(value)

    def _verdict(self, node: YamlNode | None, path: str) -> str | None:
        return self._choice(node, path, WORDS) if node is not None else None

    def _expect(self, node: YamlNode | None) -> tuple[Expectation, ...]:
        if node is None or (isinstance(node, Scalar) and node.empty):
            return ()
        if not isinstance(node, Sequence):
            self.complain(node, "expect", "expected a list", "each item starts with a dash")
            return ()
        found = [self._expectation(item, f"expect[{i}]") for i, item in enumerate(node.items)]
        return tuple(expectation for expectation in found if expectation is not None)

    def _expectation(self, node: YamlNode, path: str) -> Expectation | None:
        mapping = self._mapping(node, path)
        if mapping is None:
            return None
        self._known_keys(mapping, path, schema.EXPECT_FIELDS)
        entries = mapping.entries
        at: dict[str, Quantity] = {}
        overrides = self._optional(entries.get("at"), f"{path}.at")
        for key, item in overrides.pairs() if overrides else ():
            self._known_parameter(key, f"{path}.at")
            at[key.text] = self._expression(item, f"{path}.at.{key.text}")
        neutral, redundant = entries.get("neutral"), entries.get("redundant")
        return Expectation(
            mapping.location,
            at,
            self._expected_eigenvalues(entries.get("eigenvalues"), f"{path}.eigenvalues"),
            self._tolerance(entries.get("tolerance"), f"{path}.tolerance", 1e-9),
            None if neutral is None else self._integer(neutral, f"{path}.neutral", 0, 10_000, 0),
            "frozen" in entries and self._choice(entries["frozen"], f"{path}.frozen", ("true", "false")) == "true",
            self._state(entries.get("coordinates"), f"{path}.coordinates"),
            None if redundant is None else self._integer(redundant, f"{path}.redundant", 0, 10_000, 0),
            self._verdict(entries.get("verdict"), f"{path}.verdict"),
            self._critical(entries.get("critical"), f"{path}.critical"),
            self._text(entries.get("source"), f"{path}.source"),
        )

    def _expected_eigenvalues(self, node: YamlNode | None, path: str) -> tuple[ExpectedEigenvalue, ...] | None:
        if node is None:
            return None
        if not isinstance(node, Sequence):
            self.complain(node, path, "expected a list of {real: …, imag: …}")
            return None
        found = []
        for i, item in enumerate(node.items):
            here = f"{path}[{i}]"
            mapping = self._mapping(item, here, "{real: …, imag: …}")
            if mapping is None:
                continue
            self._known_keys(mapping, here, schema.EIGENVALUE_FIELDS)
            parts = (
                self._expression(mapping.entries.get(key, Scalar("0", mapping.location)), f"{here}.{key}")
                for key in schema.EIGENVALUE_FIELDS
            )
            found.append(ExpectedEigenvalue(*parts))
        return tuple(found)

    def _critical(self, node: YamlNode | None, path: str) -> CriticalValue | None:
        mapping = self._mapping(node, path) if node is not None else None
        if mapping is None:
            return None
        self._known_keys(mapping, path, schema.CRITICAL_FIELDS)
        tolerance = self._tolerance(mapping.entries.get("tolerance"), f"{path}.tolerance", 1e-6)
        keys = ("parameter", "value", "below", "above")
        parameter_node, value_node, *verdict_nodes = (self._required(mapping, key, path) for key in keys)
        below, above = (self._verdict(x, f"{path}.{key}") for key, x in zip(keys[2:], verdict_nodes, strict=True))
        value = self._quantity(value_node, f"{path}.value") if value_node is not None else None
        parameter = None
        if parameter_node is not None:
            parameter = self._word(parameter_node, f"{path}.parameter", "the name of a parameter")
        if isinstance(parameter_node, Scalar) and parameter is not None:
            self._known_parameter(parameter_node, f"{path}.parameter")
        if parameter is None or value is None or below is None or above is None:
            return None
        return CriticalValue(parameter, value, tolerance, below, above, mapping.location)


def _constant(text: str, location: Location, path: str) -> Quantity:
    return Quantity(text, parse(text).root, location, path)


def _owner(body: str | None) -> str:
    return "the ground" if body is None else f"the body {body!r}"


def _unit(unit: str) -> str:
    return f" ({unit})" if unit else ""
