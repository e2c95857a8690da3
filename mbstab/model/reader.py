"""Nodes to a `Model`: every rule of the file format, all problems of a file at once.

What an entry may contain comes from `mbstab.mechanics.elements.KINDS`; this module only
knows how each shape of field is written.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from mbstab.errors import Location, suggestion
from mbstab.mechanics import bodies as body_kinds
from mbstab.mechanics.catalogue import Field, Kind
from mbstab.mechanics.elements import KINDS
from mbstab.model import schema, units
from mbstab.model.arithmetic import CONSTANTS, FUNCTIONS
from mbstab.model.expressions import Expression, ExpressionError, parse
from mbstab.model.schema import (
    CriticalValue,
    Entry,
    Expectation,
    ExpectedEigenvalue,
    MarkerValue,
    Model,
    Parameter,
    PartValue,
    Reference,
    ShapeValue,
    StateValues,
    SweepRange,
    body_coordinates,
)
from mbstab.model.yamlfile import Document, Mapping, Scalar, Sequence, YamlNode, parse_yaml, read_text

NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*\Z")
AXES = {"x": 0, "y": 1, "z": 2}
ZERO = parse("0")
ONE = parse("1")
MAX_ENTRIES = 20_000

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
    return _Reader(parse_yaml(text, name)).read()


class _Reader:
    def __init__(self, document: Document) -> None:
        self.document = document
        self.dimension = 3
        self.parameters: dict[str, Parameter] = {}
        self.dimensions: dict[str, units.Known] = {}
        self.body_nodes: dict[str, Mapping] = {}
        self.bodies: dict[str, Entry] = {}
        self.entries: dict[str, dict[str, Entry]] = {}
        self.coordinates: list[str] = []
        self.geometry: dict[str | None, tuple[dict[str, Any], dict[str, Any]]] = {}

    # --- the file ---------------------------------------------------------------------------------------------------

    def read(self) -> Model:
        root = self.document.root
        if not isinstance(root, Mapping):
            assert root is not None
            self.complain(root, "", "a model file holds keys and values", "it starts with the line mbstab: 1")
            self.document.raise_problems()
            raise AssertionError
        top = root.entries
        self._known_keys(root, "", schema.SECTIONS)
        self._version(root)
        self._parameters(top.get("parameters"))
        self._find_dimension(root)
        ground = self._mapping(top.get("ground"), "ground")
        if ground is not None:
            self._known_keys(ground, "ground", ("points", "directions"))
        self.geometry[None] = tuple(  # type: ignore[assignment]
            self._points(ground.entries.get(key) if ground else None, f"ground.{key}") for key in ("points", "directions")
        )
        self._bodies()
        self.entries = {section: {} for section in (*KINDS, "constraints") if section != "bodies"}
        # Joints first: drives and forces name them.
        for section in ("joints", "contacts", "drives", "forces"):
            self._section(section, top.get(section))
        self._constraints(top.get("constraints"))
        gravity_node = top.get("gravity")
        gravity = self._vector(gravity_node, "gravity", "m/s^2") if gravity_node else (ZERO,) * self.dimension
        model = Model(
            document=self.document,
            dimension=self.dimension,
            order=tuple(key for key in top if key in self.entries),
            title=self._text(top.get("title"), "title"),
            source=self._text(top.get("source"), "source"),
            parameters=self.parameters,
            gravity=gravity,
            gravity_location=gravity_node.location if gravity_node else root.location,
            bodies=self.bodies,
            entries=self.entries,
            reference=self._reference(top.get("reference"), root),
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

    def _find_dimension(self, root: Mapping) -> None:
        """Planar or spatial: decided by the types of the bodies, before anything with a vector is read."""
        node = root.entries.get("bodies")
        if node is None:
            self.complain(root, "", "the key 'bodies' is missing")
            return
        section = self._mapping(node, "bodies")
        if section is None:
            return
        dimensions: dict[int, str] = {}
        for name, body in section.entries.items():
            self._check_name(section.keys[name], f"bodies.{name}", "body", reserved=("ground",))
            mapping = self._mapping(body, f"bodies.{name}")
            if mapping is None:
                continue
            kind = self._type(mapping, "bodies", f"bodies.{name}", None)
            if kind is not None:
                self.body_nodes[name] = mapping
                dimensions.setdefault(kind.dimensions[0], name)
        if not section.entries:
            self.complain(section, "bodies", "a model has one body at least")
        if len(dimensions) > 1:
            message = f"planar and spatial bodies cannot be mixed: {dimensions[2]!r} is planar, {dimensions[3]!r} spatial"
            self.complain(section, "bodies", message, "a planar body is a spatial one with a planar joint to the ground")
        self.dimension = min(dimensions, default=3)

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

    def _mapping(self, node: YamlNode | None, path: str) -> Mapping | None:
        if node is None or (isinstance(node, Scalar) and node.empty):
            return None
        if not isinstance(node, Mapping):
            self.complain(node, path, "expected keys with values")
            return None
        return node

    def _text(self, node: YamlNode | None, path: str) -> str:
        if node is None:
            return ""
        if not isinstance(node, Scalar):
            self.complain(node, path, "expected text")
            return ""
        return node.text.strip()

    def _word(self, node: YamlNode, path: str, what: str) -> str | None:
        if not isinstance(node, Scalar) or node.empty:
            self.complain(node, path, f"expected {what}")
            return None
        return node.text

    def _expression(
        self, node: YamlNode | None, path: str, unit: str = "", time: bool = False, state: bool = False
    ) -> Expression:
        """Read an expression; `time` allows t, `state` coordinates and rates. A problem is recorded, then 1 returned."""
        if not isinstance(node, Scalar) or node.empty:
            if node is not None:
                self.complain(node, path, "expected a number or an expression" + _unit(unit))
            return ONE
        try:
            expression = parse(node.text)
            self._check_names(expression, time, state)
            self._check_unit(expression, unit)
        except ExpressionError as error:
            self.complain(self._within(node, error.position), path, error.message, error.hint)
            return ONE
        return expression

    @staticmethod
    def _within(node: Scalar, position: int) -> Location:
        place = node.location
        if "\n" in node.text:
            return place
        return Location(place.file, place.line, place.column + position + (1 if node.quoted else 0))

    def _check_names(self, expression: Expression, time: bool, state: bool) -> None:
        known: list[str] = [*self.parameters]
        if time:
            known.append("t")
        if state:
            known += self.coordinates
        for name, at in expression.names().items():
            if name in known:
                continue
            hint = suggestion(name, [*known, *FUNCTIONS, *CONSTANTS])
            if name == "t":
                raise ExpressionError("the time t cannot be used here", at)
            if name.lower().strip(".") in ("nan", "inf", "infinity"):
                raise ExpressionError(f"{name!r} is no number", at, "values must be finite")
            what = "coordinate" if "." in name else "parameter"
            raise ExpressionError(f"unknown {what} {name!r}", at, hint)
        for name, at in expression.rates().items():
            if not state:
                raise ExpressionError("rate(...) cannot be used here", at)
            if name not in self.coordinates:
                raise ExpressionError(f"unknown coordinate {name!r}", at, suggestion(name, self.coordinates))

    def _check_unit(self, expression: Expression, unit: str) -> None:
        found = units.dimension_of(expression, self.dimensions)
        if not unit or isinstance(found, str):
            return
        expected = units.parse_unit(unit)[1]
        if found != expected:
            message = f"{expression.text!r} has the unit {units.show(found)}, expected {unit}"
            raise ExpressionError(message, 0, "check the units declared under parameters")

    def _vector(self, node: YamlNode, path: str, unit: str = "", time: bool = False) -> tuple[Expression, ...]:
        """Read a vector: a list, or the name of an axis such as -z, or 0."""
        if isinstance(node, Scalar):
            named = self._axis(node.text)
            if named is not None:
                return named
            if node.text.strip() == "0":
                return (ZERO,) * self.dimension
        if not isinstance(node, Sequence):
            self.complain(node, path, f"expected a list of {self.dimension} numbers{_unit(unit)}")
            return (ZERO,) * self.dimension
        if len(node.items) != self.dimension:
            count = len(node.items)
            self.complain(node, path, f"expected {self.dimension} numbers{_unit(unit)}, got {count}")
            return (ZERO,) * self.dimension
        return tuple(self._expression(item, f"{path}[{i}]", unit, time) for i, item in enumerate(node.items))

    def _axis(self, text: str) -> tuple[Expression, ...] | None:
        sign, letter = ("-1", text[1:]) if text.startswith("-") else ("1", text)
        if letter not in list(AXES)[: self.dimension]:
            return None
        return tuple(parse(sign) if i == AXES[letter] else ZERO for i in range(self.dimension))

    def _points(self, node: YamlNode | None, path: str) -> dict[str, tuple[Expression, ...]]:
        mapping = self._mapping(node, path)
        if mapping is None:
            return {}
        unit = "m" if path.endswith("points") else ""
        found = {}
        for name, item in mapping.entries.items():
            if self._check_name(mapping.keys[name], f"{path}.{name}", "point", reserved=tuple(AXES)):
                found[name] = self._vector(item, f"{path}.{name}", unit)
        return found

    # --- parameters -------------------------------------------------------------------------------------------------

    def _parameters(self, node: YamlNode | None) -> None:
        section = self._mapping(node, "parameters")
        if section is None:
            return
        raw: dict[str, tuple[Scalar, str, float, str]] = {}
        for name, item in section.entries.items():
            path = f"parameters.{name}"
            if not self._check_name(section.keys[name], path, "parameter", reserved=("t", "rate", *FUNCTIONS, *CONSTANTS)):
                continue
            unit, factor, description, value = "", 1.0, "", item
            if isinstance(item, Mapping):
                self._known_keys(item, path, schema.PARAMETER_FIELDS)
                description = self._text(item.entries.get("description"), f"{path}.description")
                unit, factor = self._unit_of(item.entries.get("unit"), f"{path}.unit")
                if "value" not in item.entries:
                    self.complain(item, path, "the key 'value' is missing")
                    value = Scalar("1", item.location)
                else:
                    value = item.entries["value"]
            if not isinstance(value, Scalar) or value.empty:
                self.complain(value, path, "expected a number or an expression")
                value = Scalar("1", value.location)
            raw[name] = (value, unit, factor, description)
            self.parameters[name] = Parameter(name, ONE, value.location)
        order = self._parameter_order(raw)
        for name in order:
            value, unit, factor, description = raw[name]
            expression = self._expression(value, f"parameters.{name}")
            if unit:
                self.dimensions[name] = units.parse_unit(unit)[1]
                if not expression.literal:
                    self._check_derived(value, name, expression, unit, factor)
                    factor = 1.0
            else:
                try:
                    found = units.dimension_of(expression, self.dimensions)
                except ExpressionError:  # complained about by _expression
                    found = units.UNKNOWN
                # A bare number may be meant in any unit.
                self.dimensions[name] = units.UNKNOWN if isinstance(found, str) else found
            self.parameters[name] = Parameter(name, expression, value.location, unit, factor, description)
        self.parameters = {name: self.parameters[name] for name in order}

    def _check_derived(self, value: Scalar, name: str, expression: Expression, unit: str, factor: float) -> None:
        path = f"parameters.{name}"
        if factor != 1.0:
            hint = "expressions are computed in kg, m, s and rad; declare the unit in these"
            self.complain(value, path, f"an expression cannot have the unit {unit}", hint)
            return
        try:
            self._check_unit(expression, unit)
        except ExpressionError as error:
            self.complain(self._within(value, error.position), path, error.message, error.hint)

    def _unit_of(self, node: YamlNode | None, path: str) -> tuple[str, float]:
        if node is None:
            return "", 1.0
        text = self._word(node, path, "a unit such as kg*m^2")
        if text is None:
            return "", 1.0
        try:
            return text, units.parse_unit(text)[0]
        except ExpressionError as error:
            assert isinstance(node, Scalar)
            self.complain(self._within(node, error.position), path, error.message, error.hint)
            return "", 1.0

    def _parameter_order(self, raw: dict[str, tuple[Scalar, str, float, str]]) -> list[str]:
        """Return the parameters so that each comes after those it needs; cycles are named."""
        needs: dict[str, list[str]] = {}
        for name, (value, *_) in raw.items():
            try:
                needs[name] = [other for other in parse(value.text).names() if other in raw]
            except ExpressionError:  # complained about when the value is read
                needs[name] = []
        order: list[str] = []
        done: set[str] = set()
        for start in raw:
            path: list[str] = []
            stack = [(start, iter(needs[start]))] if start not in done else []
            path += [start] if stack else []
            while stack:
                name, rest = stack[-1]
                following = next((other for other in rest if other not in done), None)
                if following is None:
                    stack.pop()
                    path.pop()
                    done.add(name)
                    order.append(name)
                elif following in path:
                    circle = [*path[path.index(following) :], following]
                    message = "parameters depend on each other in a circle: " + " → ".join(circle)
                    self.complain(raw[following][0], f"parameters.{following}", message)
                    self.document.raise_problems()
                else:
                    path.append(following)
                    stack.append((following, iter(needs[following])))
        return order

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
        for name, node in self.body_nodes.items():
            path = f"bodies.{name}"
            kind = self._type(node, "bodies", path, None)
            if kind is None or self.dimension not in kind.dimensions:
                continue
            entry = self._entry("bodies", name, kind, node)
            self.bodies[name] = entry
            self._check_distribution(entry, node)
            self.geometry[name] = (entry.values.get("points", {}), entry.values.get("directions", {}))
        self.coordinates = [f"{name}.{c}" for name, body in self.bodies.items() for c in body_coordinates(body)]

    def _check_distribution(self, entry: Entry, node: Mapping) -> None:
        given = [key for key in ("inertia", "shape", "parts") if key in entry.values]
        has_mass = "mass" in entry.values
        if "parts" in given:
            for key in ("mass", "inertia", "shape", "center_of_mass"):
                if key in entry.values:
                    place = entry.places[key]
                    self.complain(place, entry.path, f"{key!r} and 'parts' cannot both be given", "each part has its own mass")
            return
        if not has_mass:
            self.complain(node, entry.path, "the key 'mass' is missing")
        if entry.kind.name in ("planar", "spatial"):
            if not given:
                hint = "give inertia, shape or parts; a body without orientation is a point"
                self.complain(node, entry.path, "the body has no inertia", hint)
            elif len(given) > 1:
                self.complain(entry.places[given[1]], entry.path, f"{given[0]!r} and {given[1]!r} cannot both be given")

    def _section(self, section: str, node: YamlNode | None) -> None:
        mapping = self._mapping(node, section)
        if mapping is None:
            return
        if len(mapping.entries) > MAX_ENTRIES:
            self.complain(mapping, section, f"a model may have {MAX_ENTRIES} {section}")
            return
        for name, item in mapping.entries.items():
            path = f"{section}.{name}"
            self._check_name(mapping.keys[name], path, section.removesuffix("s"))
            entry_node = self._mapping(item, path)
            if entry_node is None:
                if not isinstance(item, Scalar) or not item.empty:
                    continue
                self.complain(item, path, "expected keys with values")
                continue
            kind = self._type(entry_node, section, path, self.dimension)
            if kind is not None:
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
            if item is None:
                if field.required:
                    self.complain(node, path, f"the key {field.name!r} is missing", field.doc)
                if field.default is None:
                    continue
                item = Scalar(field.default, node.location)
            value = self._field(field, item, f"{path}.{field.name}", markers)
            if value is not None:
                values[field.name] = value
                if field.shape == "markers" and section == "joints" and markers[0] == markers[1]:
                    what = "the ground" if markers[0] is None else repr(markers[0])
                    self.complain(item, f"{path}.{field.name}", f"the joint connects {what} with itself")
        for group in kind.one_of:
            given = [key for key in group if key in values]
            if len(given) != 1:
                found = "none" if not given else "both"
                self.complain(node, path, f"give one of {' and '.join(map(repr, group))}, {found} given")
        return Entry(section, name, kind, values, node.location, places)

    # --- fields: one reader for each shape --------------------------------------------------------------------------

    def _field(self, field: Field, node: YamlNode, path: str, markers: list[str | None]) -> Any:
        unit = field.unit if field.unit not in ("1",) else "1"
        match field.shape:
            case "number":
                return self._expression(node, path, unit)
            case "law":
                return self._expression(node, path, "" if unit == "1" else unit, time=True)
            case "vector":
                return self._vector(node, path, unit if unit != "1" else "")
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
                marker = self._marker(node, path)
                markers.append(marker.body if marker else None)
                return marker
            case "markers":
                return self._markers(node, path, markers)
            case "direction":
                return self._direction(node, path, markers[0] if markers else None)
            case "directions":
                return self._directions(node, path, markers)
            case "tensor":
                return self._tensor(node, path, unit)
            case "points":
                return self._points(node, path)
            case "shape":
                return self._shape(node, path)
            case "parts":
                return self._parts(node, path)
            case "angles":
                return self._angles(node, path)
            case "loads":
                return self._loads(node, path)
            case _:
                raise AssertionError(field.shape)

    def _choice(self, node: YamlNode, path: str, choices: tuple[str, ...]) -> str | None:
        word = self._word(node, path, "one of " + ", ".join(choices))
        if word is not None and word not in choices:
            hint = suggestion(word, choices) or "one of " + ", ".join(choices)
            self.complain(node, path, f"unknown choice {word!r}", hint)
            return None
        return word

    def _body_name(self, node: YamlNode, path: str) -> str | None:
        word = self._word(node, path, "the name of a body")
        if word is not None and word not in self.bodies:
            self.complain(node, path, f"there is no body {word!r}", suggestion(word, self.bodies))
            return None
        return word

    def _joint_name(self, node: YamlNode, path: str) -> str | None:
        word = self._word(node, path, "the name of a joint")
        if word is None:
            return None
        joint = self.entries["joints"].get(word)
        if joint is None:
            self.complain(node, path, f"there is no joint {word!r}", suggestion(word, self.entries["joints"]))
            return None
        if not joint.kind.motions:
            self.complain(node, path, f"a {joint.kind.name} joint has no single angle or travel")
            return None
        return word

    def _coordinate_name(self, node: YamlNode, path: str) -> str | None:
        word = self._word(node, path, "a coordinate such as body.x")
        if word is not None and word not in self.coordinates:
            hint = suggestion(word, self.coordinates) or "coordinates: " + ", ".join(self.coordinates[:12])
            self.complain(node, path, f"there is no coordinate {word!r}", hint)
            return None
        return word

    def _body_or_ground(self, node: YamlNode, word: str, path: str) -> tuple[bool, str | None]:
        if word == "ground":
            return True, None
        if word in self.bodies:
            return True, word
        if word not in self.body_nodes:
            self.complain(node, path, f"there is no body {word!r}", suggestion(word, [*self.bodies, "ground"]))
        return False, None

    def _marker(self, node: YamlNode, path: str) -> MarkerValue | None:
        if isinstance(node, Mapping):
            self._known_keys(node, path, ("body", "point"))
            body_node = node.entries.get("body")
            if body_node is None:
                self.complain(node, path, "the key 'body' is missing")
                return None
            word = self._word(body_node, f"{path}.body", "the name of a body or ground")
            found, body = self._body_or_ground(body_node, word, f"{path}.body") if word else (False, None)
            point_node = node.entries.get("point")
            point = self._vector(point_node, f"{path}.point", "m") if point_node else (ZERO,) * self.dimension
            return MarkerValue(body, point) if found else None
        word = self._word(node, path, "a point such as body.point, body or ground")
        if word is None:
            return None
        name, _, point_name = word.partition(".")
        found, body = self._body_or_ground(node, name, path)
        if not found:
            return None
        if not point_name:
            return MarkerValue(body, (ZERO,) * self.dimension)
        points = self.geometry[body][0]
        if point_name not in points:
            what = "the ground" if body is None else f"the body {body!r}"
            hint = suggestion(point_name, points) or "its points: " + (", ".join(points) or "none")
            self.complain(node, path, f"{what} has no point {point_name!r}", hint)
            return None
        return MarkerValue(body, points[point_name])

    def _markers(self, node: YamlNode, path: str, markers: list[str | None]) -> Any:
        if not isinstance(node, Sequence) or len(node.items) != 2:
            self.complain(node, path, "expected a list of two points", "for example [rod.O, ground]")
            return None
        pair = [self._marker(item, f"{path}[{i}]") for i, item in enumerate(node.items)]
        if pair[0] is None or pair[1] is None:
            return None
        markers += [pair[0].body, pair[1].body]
        return pair[0], pair[1]

    def _direction(self, node: YamlNode, path: str, body: str | None) -> tuple[Expression, ...] | None:
        if isinstance(node, Scalar):
            named = self._axis(node.text)
            if named is not None:
                return named
            directions = self.geometry[body][1]
            if node.text in directions:
                return directions[node.text]  # type: ignore[no-any-return]
            known = [*list(AXES)[: self.dimension], *directions]
            hint = suggestion(node.text, known) or "known directions: " + ", ".join(known)
            self.complain(node, path, f"unknown direction {node.text!r}", hint)
            return None
        return self._vector(node, path)

    def _directions(self, node: YamlNode, path: str, markers: list[str | None]) -> Any:
        if len(markers) != 2:  # the two points are wrong, and that is said
            return None
        two = isinstance(node, Sequence) and len(node.items) == 2
        # In the plane [a, b] is a vector unless its items are names or lists.
        if two and self.dimension == 2:
            assert isinstance(node, Sequence)
            two = all(isinstance(i, Sequence) or (isinstance(i, Scalar) and self._names_direction(i)) for i in node.items)
        if two:
            assert isinstance(node, Sequence)
            pair = [self._direction(item, f"{path}[{i}]", markers[i]) for i, item in enumerate(node.items)]
        else:
            pair = [self._direction(node, path, markers[0])]
            pair.append(pair[0] if not isinstance(node, Scalar) or self._axis(node.text) else self._direction(node, path, markers[1]))
        return None if pair[0] is None or pair[1] is None else (pair[0], pair[1])

    def _names_direction(self, node: Scalar) -> bool:
        return self._axis(node.text) is not None or any(node.text in directions for _, directions in self.geometry.values())

    def _tensor(self, node: YamlNode, path: str, unit: str) -> tuple[Expression, ...] | None:
        """Read an inertia: one number in the plane; [xx, yy, zz], a matrix or {xx, …, yz} in space."""
        if self.dimension == 2:
            return (self._expression(node, path, unit),)
        entries = ("xx", "yy", "zz", "xy", "xz", "yz")
        if isinstance(node, Mapping):
            self._known_keys(node, path, entries)
            for key in entries[:3]:
                if key not in node.entries:
                    self.complain(node, path, f"the key {key!r} is missing")
            return tuple(
                self._expression(node.entries[key], f"{path}.{key}", unit) if key in node.entries else ZERO for key in entries
            )
        if isinstance(node, Sequence) and len(node.items) == 3:
            rows = [item for item in node.items if isinstance(item, Sequence)]
            if not rows:
                return (*self._vector(node, path, unit), ZERO, ZERO, ZERO)
            if len(rows) == 3 and all(len(row.items) == 3 for row in rows):
                m = [self._vector(row, f"{path}[{i}]", unit) for i, row in enumerate(rows)]
                for i, j in ((0, 1), (0, 2), (1, 2)):
                    if m[i][j].text.replace(" ", "") != m[j][i].text.replace(" ", ""):
                        message = f"the inertia is not symmetric: {m[i][j].text!r} and {m[j][i].text!r} must be the same"
                        self.complain(rows[j].items[i], f"{path}[{j}][{i}]", message)
                return m[0][0], m[1][1], m[2][2], m[0][1], m[0][2], m[1][2]
        self.complain(node, path, "expected three principal moments, a 3×3 matrix, or keys xx, yy, zz, xy, xz, yz (kg*m^2)")
        return None

    def _shape_fields(self, node: Mapping, path: str, extra: tuple[str, ...]) -> ShapeValue | None:
        type_node = node.entries.get("type")
        if type_node is None:
            self.complain(node, path, "the key 'type' is missing", "known shapes: " + ", ".join(body_kinds.SHAPES))
            return None
        word = self._word(type_node, f"{path}.type", "a shape")
        if word is None:
            return None
        kind = body_kinds.SHAPES.get(word)
        if kind is None:
            hint = suggestion(word, body_kinds.SHAPES) or "known shapes: " + ", ".join(body_kinds.SHAPES)
            self.complain(type_node, f"{path}.type", f"unknown shape {word!r}", hint)
            return None
        axis = ("along",) if kind.axis is not None else ()
        self._known_keys(node, path, ("type", *(f.name for f in kind.fields), *axis, *extra))
        lengths = {}
        for field in kind.fields:
            item = node.entries.get(field.name)
            if item is None and field.required:
                self.complain(node, path, f"the key {field.name!r} is missing", field.doc)
            if item is None:
                item = Scalar(field.default or "1", node.location)
            lengths[field.name] = self._expression(item, f"{path}.{field.name}", field.unit)
        along = None
        if axis and "along" in node.entries:
            letter = self._choice(node.entries["along"], f"{path}.along", tuple(AXES))
            along = AXES[letter] if letter else None
        return ShapeValue(kind, lengths, along)

    def _shape(self, node: YamlNode, path: str) -> ShapeValue | None:
        mapping = self._mapping(node, path)
        return self._shape_fields(mapping, path, ()) if mapping else None

    def _parts(self, node: YamlNode, path: str) -> tuple[PartValue, ...] | None:
        if not isinstance(node, Sequence) or not node.items:
            self.complain(node, path, "expected a list of shapes with masses")
            return None
        parts = []
        for i, item in enumerate(node.items):
            here = f"{path}[{i}]"
            mapping = self._mapping(item, here)
            shape = self._shape_fields(mapping, here, ("mass", "at")) if mapping else None
            if mapping is None or shape is None:
                continue
            if "mass" not in mapping.entries:
                self.complain(mapping, here, "the key 'mass' is missing")
            mass = self._expression(mapping.entries.get("mass"), f"{here}.mass", "kg")
            at = mapping.entries.get("at")
            place = self._vector(at, f"{here}.at", "m") if at else (ZERO,) * self.dimension
            parts.append(PartValue(mass, shape, place))
        return tuple(parts)

    def _angles(self, node: YamlNode, path: str) -> tuple[Expression, ...] | None:
        if not isinstance(node, Sequence) or len(node.items) != 3:
            self.complain(node, path, "expected three angles (rad)", "for example [pi/2, 0, 0]")
            return None
        return tuple(self._expression(item, f"{path}[{i}]", "rad") for i, item in enumerate(node.items))

    def _loads(self, node: YamlNode, path: str) -> dict[str, Expression] | None:
        mapping = self._mapping(node, path)
        if mapping is None:
            self.complain(node, path, "expected coordinates with generalized forces", "for example {rod.theta: -c*rate(rod.theta)}")
            return None
        loads = {}
        for name, item in mapping.entries.items():
            if self._coordinate_name(mapping.keys[name], path) is not None:
                loads[name] = self._expression(item, f"{path}.{name}", time=True, state=True)
        return loads

    def _constraints(self, node: YamlNode | None) -> None:
        section = self._mapping(node, "constraints")
        if section is None:
            return
        for name, item in section.entries.items():
            path = f"constraints.{name}"
            self._check_name(section.keys[name], path, "constraint")
            mapping = self._mapping(item, path)
            if mapping is None:
                self.complain(item, path, "expected {holonomic: expression} or {nonholonomic: expression}")
                continue
            self._known_keys(mapping, path, CONSTRAINT_KINDS)
            given = [role for role in CONSTRAINT_KINDS if role in mapping.entries]
            if len(given) != 1:
                self.complain(mapping, path, "give one of 'holonomic' and 'nonholonomic'")
                continue
            role = given[0]
            expression = self._expression(mapping.entries[role], f"{path}.{role}", time=True, state=True)
            if role == "holonomic" and expression.rates():
                self.complain(mapping.entries[role], f"{path}.holonomic", "a holonomic constraint contains no rates", "make it nonholonomic")
            if not expression.rates() and (role == "nonholonomic" or not set(expression.names()) & set(self.coordinates)):
                what = "no rate of a coordinate" if role == "nonholonomic" else "no coordinate"
                self.complain(mapping.entries[role], f"{path}.{role}", f"the constraint contains {what}")
            places = {role: mapping.entries[role].location}
            self.entries["constraints"][name] = Entry("constraints", name, CONSTRAINT_KINDS[role], {role: expression}, mapping.location, places)

    # --- reference, sweep, expect -----------------------------------------------------------------------------------

    def _state(self, node: YamlNode | None, path: str, rates: bool) -> StateValues:
        state = StateValues()
        mapping = self._mapping(node, path)
        if mapping is None:
            return state
        for body, item in mapping.entries.items():
            if body not in self.bodies:
                if body not in self.body_nodes:
                    self.complain(mapping.keys[body], path, f"there is no body {body!r}", suggestion(body, self.bodies))
                continue
            inner = self._mapping(item, f"{path}.{body}")
            if inner is None:
                continue
            known = body_coordinates(self.bodies[body])
            self._known_keys(inner, f"{path}.{body}", known)
            for coordinate, value in inner.entries.items():
                if coordinate in known:
                    name = f"{body}.{coordinate}"
                    unit = ("m" if coordinate in AXES else "rad") + ("/s" if rates else "")
                    state.values[name] = self._expression(value, f"{path}.{name}", unit)
                    state.places[name] = value.location
        return state

    def _reference(self, node: YamlNode | None, root: Mapping) -> Reference:
        mapping = self._mapping(node, "reference")
        if mapping is None:
            return Reference(root.location, ZERO, StateValues(), StateValues(), StateValues())
        self._known_keys(mapping, "reference", schema.REFERENCE_FIELDS)
        entries = mapping.entries
        time = self._expression(entries["time"], "reference.time", "s") if "time" in entries else ZERO
        return Reference(
            root.keys["reference"].location,
            time,
            self._state(entries.get("coordinates"), "reference.coordinates", False),
            self._state(entries.get("rates"), "reference.rates", True),
            self._state(entries.get("guess"), "reference.guess", False),
        )

    def _sweep(self, node: YamlNode | None) -> dict[str, SweepRange]:
        mapping = self._mapping(node, "sweep")
        ranges: dict[str, SweepRange] = {}
        for name, item in mapping.entries.items() if mapping else ():
            path = f"sweep.{name}"
            assert mapping is not None
            self._known_parameter(mapping.keys[name], path)
            inner = self._mapping(item, path)
            if inner is None:
                self.complain(item, path, "expected {from: …, to: …, points: …}")
                continue
            self._known_keys(inner, path, schema.SWEEP_FIELDS)
            for key in ("from", "to"):
                if key not in inner.entries:
                    self.complain(inner, path, f"the key {key!r} is missing")
            start, stop = (self._expression(inner.entries.get(key), f"{path}.{key}") for key in ("from", "to"))
            points = self._integer(inner.entries.get("points"), f"{path}.points", 2, 10_000_000, 401)
            ranges[name] = SweepRange(start, stop, points)
        return ranges

    def _known_parameter(self, key: Scalar, path: str) -> None:
        if key.text not in self.parameters:
            self.complain(key, path, f"there is no parameter {key.text!r}", suggestion(key.text, self.parameters))

    def _integer(self, node: YamlNode | None, path: str, low: int, high: int, default: int) -> int:
        if node is None:
            return default
        if isinstance(node, Scalar) and re.fullmatch(r"[+-]?\d{1,9}", node.text) and low <= int(node.text) <= high:
            return int(node.text)
        self.complain(node, path, f"expected a whole number between {low} and {high}")
        return default

    def _tolerance(self, node: YamlNode | None, path: str, default: float) -> float:
        if node is None:
            return default
        expression = self._expression(node, path)
        value = float(expression.text) if expression.literal else -1.0
        if not 0.0 < value < 1.0:
            self.complain(node, path, "expected a number between 0 and 1")
            return default
        return value

    def _verdict(self, node: YamlNode | None, path: str) -> str | None:
        return self._choice(node, path, schema.VERDICTS) if node is not None else None

    def _expect(self, node: YamlNode | None) -> tuple[Expectation, ...]:
        if node is None:
            return ()
        if not isinstance(node, Sequence):
            self.complain(node, "expect", "expected a list", "each item starts with a dash")
            return ()
        return tuple(
            found for i, item in enumerate(node.items) if (found := self._expectation(item, f"expect[{i}]")) is not None
        )

    def _expectation(self, node: YamlNode, path: str) -> Expectation | None:
        mapping = self._mapping(node, path)
        if mapping is None:
            return None
        self._known_keys(mapping, path, schema.EXPECT_FIELDS)
        entries = mapping.entries
        at: dict[str, Expression] = {}
        overrides = self._mapping(entries.get("at"), f"{path}.at")
        for name, item in overrides.entries.items() if overrides else ():
            assert overrides is not None
            self._known_parameter(overrides.keys[name], f"{path}.at")
            at[name] = self._expression(item, f"{path}.at.{name}")
        neutral = entries.get("neutral")
        return Expectation(
            mapping.location,
            at,
            self._expected_eigenvalues(entries.get("eigenvalues"), f"{path}.eigenvalues"),
            self._tolerance(entries.get("tolerance"), f"{path}.tolerance", 1e-9),
            None if neutral is None else self._integer(neutral, f"{path}.neutral", 0, 10_000, 0),
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
            mapping = self._mapping(item, f"{path}[{i}]")
            if mapping is None:
                self.complain(item, f"{path}[{i}]", "expected {real: …, imag: …}")
                continue
            self._known_keys(mapping, f"{path}[{i}]", ("real", "imag"))
            parts = [
                self._expression(mapping.entries[key], f"{path}[{i}].{key}") if key in mapping.entries else ZERO
                for key in ("real", "imag")
            ]
            found.append(ExpectedEigenvalue(*parts))
        return tuple(found)

    def _critical(self, node: YamlNode | None, path: str) -> CriticalValue | None:
        mapping = self._mapping(node, path)
        if mapping is None:
            return None
        self._known_keys(mapping, path, schema.CRITICAL_FIELDS)
        for key in ("parameter", "value", "below", "above"):
            if key not in mapping.entries:
                self.complain(mapping, path, f"the key {key!r} is missing")
                return None
        parameter = self._word(mapping.entries["parameter"], f"{path}.parameter", "the name of a parameter")
        if parameter is not None:
            self._known_parameter(mapping.entries["parameter"], f"{path}.parameter")  # type: ignore[arg-type]
        value = self._expression(mapping.entries["value"], f"{path}.value")
        tolerance = self._tolerance(mapping.entries.get("tolerance"), f"{path}.tolerance", 1e-6)
        verdicts = [self._verdict(mapping.entries[key], f"{path}.{key}") for key in ("below", "above")]
        if parameter is None or None in verdicts:
            return None
        return CriticalValue(parameter, value, tolerance, str(verdicts[0]), str(verdicts[1]), mapping.location)


def _unit(unit: str) -> str:
    return f" ({unit})" if unit not in ("", "1") else ""


