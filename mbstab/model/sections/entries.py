"""Sections of entries by name: bodies, joints, contacts, drives, forces and constraints, and the points of the ground.

What an entry may contain comes from `mbstab.mechanics.elements.KINDS`, how a field is read from
`mbstab.model.fields`.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from collections.abc import Mapping as MappingType
from contextlib import suppress
from dataclasses import replace
from functools import partial

from mbstab.errors import Location, suggestion
from mbstab.mechanics.catalogue import ROWS, Kind, Part, PartError
from mbstab.mechanics.elements import KINDS
from mbstab.mechanics.measures import is_speed
from mbstab.model.arithmetic import CONSTANTS
from mbstab.model.expressions import ExpressionError, filled_in, moves, parse
from mbstab.model.fields.base import FormError, Reading
from mbstab.model.fields.catalogue import given_fields, read_fields, read_keys
from mbstab.model.functions import CALLED
from mbstab.model.keys import SECTIONS
from mbstab.model.names import in_order
from mbstab.model.quantities import QuantityReader
from mbstab.model.schema import Entry, body_coordinates, entry_word
from mbstab.model.sections.definitions import DefinitionReader
from mbstab.model.units import parse_unit
from mbstab.model.yamlfile import Mapping, Scalar, YamlNode

NAMING = tuple(section for section in KINDS if section != "bodies")
"""Sections whose entries have types and may name bodies and joints."""

CONSTRAINT_KINDS = {
    role: Kind(role, field.doc, (2, 3), (field,), lambda item: (), written=role)
    for role in ROWS
    for field in SECTIONS["constraints"].keys
    if field.name == role
}

STATE_KIND = Kind(
    "state", "a variable with its own rate", (2, 3), SECTIONS["states"].keys, lambda item: (), written="nonholonomic"
)
"""A state z is a coordinate without mass; its rate is a row of the speeds, rate(z) - g = 0, that takes no force."""

MADE_STATE_KIND = replace(STATE_KIND, fields=(replace(STATE_KIND.field("rate"), shape="made rate"),))
"""A state of a controller or a motor."""

ELSEWHERE = {"setpoint": "target", "set_point": "target", "desired": "target"}
"""Keys by what they are called elsewhere."""

STARTING = ("initial", "value", "start", "x0")

FRICTION = ("friction", "friction_coefficient", "coulomb", "mu")

RUBBING = (
    "nothing sticks or rubs by itself: friction that grows with the speed is the damping of a spring; dry friction of "
    "what goes on sliding is a force, type: expression, on: {body.x: -mu*N*tanh(rate(body.x)/w)} with a small speed w"
)
"""What there is instead of friction."""

Found = dict[str, tuple[Kind, Mapping]]
"""Entries by name whose types are known, but whose fields have not been read yet."""


class EntryReader:
    """Reads all sections that hold entries by name."""

    def __init__(self, quantities: QuantityReader) -> None:
        self.quantities = quantities
        self.nodes, self.names = quantities.nodes, quantities.names
        self.parts: dict[str, Part] = {}
        self.places: dict[str, Location] = {}

    def read(self, sections: MappingType[str, YamlNode], definitions: DefinitionReader) -> dict[str, dict[str, Entry]]:
        """Return the entries of all sections but the bodies, which must have been read; an entry may name any other."""
        found = {
            section: self._find(section, self.nodes.optional(sections.get(section), section), self.names.dimension)
            for section in NAMING
        }
        self.names.joints = {name: kind for name, (kind, _) in found["joints"].items()}
        self._note_units_of_parts(found["forces"])
        definitions.check()
        self.names.contacts = found["contacts"]
        entries = {
            section: {name: self._entry(section, name, *item) for name, item in found[section].items()}
            for section in NAMING
        }
        self._refuse_circles(entries["joints"])
        written = self.nodes.optional_pairs(sections.get("states"), "states")
        made = {
            state: Mapping({"rate": Scalar(rate, at)}, {"rate": Scalar("rate", at)}, at)
            for name, part in self.parts.items()
            for state, rate in part.states.items()
            for at in [self.places[name]]
        }
        found_states = {
            name: self._entry("states", name, MADE_STATE_KIND if name in made else STATE_KIND, item)
            for name, node in {**written, **made}.items()
            if name in self.names.coordinates
            and (item := self.nodes.mapping(node, f"states.{name}", "{rate: expression}")) is not None
        }
        self._refuse_loops(found_states)
        constraints = self._constraints(sections.get("constraints"))
        states = found_states | dict(self._own_states(entries["forces"]))
        self._refuse_reactions_of_states(constraints, states)
        return {**entries, "constraints": constraints, "states": states}

    @staticmethod
    def _own_states(forces: dict[str, Entry]) -> Iterator[tuple[str, Entry]]:
        """Yield the states that forces have themselves, by name: entries with the same fields."""
        for entry in forces.values():
            name, state = entry.own_state, entry.kind.state
            if name is not None and state is not None:
                kind = Kind(entry.kind.name, state.doc, entry.kind.dimensions, entry.kind.fields, state.build)
                yield name, replace(entry, section="states", name=name, kind=kind)

    def find_states(self, sections: MappingType[str, YamlNode]) -> None:
        """Find the names of the states, those of forces after those of the file; all then count as coordinates."""
        section = self.nodes.optional(sections.get("states"), "states")
        names = self.names
        taken = {
            "t",
            "ground",
            *CONSTANTS,
            *CALLED,
            *names.bodies,
            *names.parameters,
            *names.definitions,
            *names.tables,
        }
        for key, node in section.pairs() if section else ():
            path = f"states.{key.text}"
            if self.nodes.check_name(key, path, "state", taken):
                names.coordinates[key.text] = None
                self._note_unit(key.text, node.entries.get("unit") if isinstance(node, Mapping) else None)
        forces = sections.get("forces")
        for key, node in forces.pairs() if isinstance(forces, Mapping) else ():
            type_node = node.entries.get("type") if isinstance(node, Mapping) else None
            kind = KINDS["forces"].get((type_node.text if isinstance(type_node, Scalar) else "", names.dimension))
            if not isinstance(node, Mapping) or kind is None:
                continue
            for state in self._states_of(kind, key, node):
                if state in taken or state in names.coordinates:
                    message = f"its state would be called {state!r}, and that name is taken"
                    self.nodes.complain(key, f"forces.{key.text}", message, "give one of them another name")
                names.coordinates[state] = None

    def _states_of(self, kind: Kind, key: Scalar, node: Mapping) -> list[str]:
        """Return the names of the states of a force; a part that they belong to is noted."""
        if kind.state is not None and kind.state.field in node.entries:
            state = f"{key.text}_{kind.state.suffix}"
            self.names.state_units[state] = kind.state.unit
            return [state]
        if kind.part is None:
            return []
        from mbstab.model.sections.parts import part_of

        try:
            part = part_of(kind, key.text, node)
        except PartError as error:
            at = node.entries.get(error.key, node)
            self.nodes.complain(at, f"forces.{key.text}", error.message, error.hint)
            return []
        except (KeyError, FormError):  # told where the key is read
            return []
        self.parts[key.text], self.places[key.text] = part, key.location
        return list(part.states)

    def _note_units_of_parts(self, forces: Found) -> None:
        """Note the units of the states of controllers and motors; the joints are known."""
        if self.parts:
            from mbstab.model.sections.parts import motion_of, note_units

            along = {name: motion_of(forces[name][1], self.names.joints) for name in self.parts if name in forces}
            note_units(self.quantities, {name: (self.parts[name], x) for name, x in along.items()})

    def _note_unit(self, state: str, node: YamlNode | None) -> None:
        """Note the unit of a state; one with a problem is refused when the state is read."""
        if isinstance(node, Scalar):
            with suppress(ExpressionError):
                self.names.units[state] = parse_unit(node.text)[1]
                self.names.state_units[state] = node.text

    # --- the ground and the bodies ----------------------------------------------------------------------------------

    def read_ground(self, node: YamlNode | None) -> None:
        """Read the named points and directions of the ground."""
        ground = self.nodes.optional(node, "ground")
        found = read_keys(self.quantities, ground, "ground", SECTIONS["ground"].keys).values if ground else {}
        self.names.geometry[None] = found.get("points") or {}, found.get("directions") or {}

    def find_bodies(self, root: Mapping) -> Found:
        """Find the types of the bodies, and from them whether vectors have two components or three."""
        nodes = self.nodes
        written = root.entries.get("bodies")
        none = written is None or (isinstance(written, Scalar) and written.empty)
        none |= isinstance(written, Mapping) and not written.entries
        if none and "bodies" in nodes.document.empty:
            place, said = nodes.document.empty["bodies"]
            hint = "a repetition adds its sections once for each number from the first to the last; write a larger last"
            nodes.document.fail(place, "repeat", f"the model has no body: {said}", hint)
        if written is None:
            nodes.document.fail(root.location, "", "the key 'bodies' is missing")
        section = nodes.mapping(root.entries["bodies"], "bodies")
        found = self._find("bodies", section, None, reserved=("ground",))
        if section is not None and not section.entries:
            nodes.complain(section, "bodies", "a model needs at least one body")
        dimensions: dict[int, str] = {}
        for name, (kind, _) in found.items():
            dimensions.setdefault(kind.dimensions[0], name)
        if len(dimensions) > 1:
            flat, deep = dimensions[2], dimensions[3]
            message = f"planar and spatial bodies cannot be mixed: {flat!r} is planar, {deep!r} spatial"
            hint = "a planar body is a spatial one with a planar joint to the ground"
            nodes.complain(root.entries["bodies"], "bodies", message, hint)
        if len(dimensions) != 1:
            nodes.document.raise_problems()
        self.names.dimension = min(dimensions)
        return found

    def read_bodies(self, found: Found) -> dict[str, Entry]:
        """Return the bodies; their names, coordinates, points and directions are then known."""
        names = self.names
        for name, (kind, node) in found.items():
            entry = self._entry("bodies", name, kind, node)
            names.bodies[name] = entry
            self._check_distribution(entry, node)
            names.geometry[name] = (entry.values.get("points", {}), entry.values.get("directions", {}))
        coordinates = (f"{name}.{c}" for name, body in names.bodies.items() for c in body_coordinates(body))
        names.coordinates = dict.fromkeys(coordinates)
        return names.bodies

    def _check_distribution(self, entry: Entry, node: Mapping) -> None:
        """Check that the mass and the inertia of a body are given exactly once."""
        given = [key for key in ("inertia", "shape", "parts") if key in entry.places]
        if "parts" in given:
            for key in ("mass", "inertia", "shape", "center_of_mass"):
                if key in entry.places:
                    message = f"{key!r} and 'parts' cannot both be given"
                    self.nodes.complain(entry.places[key], entry.path, message, "each part has its own mass")
            return
        self.nodes.required(node, "mass", entry.path)
        if not given and any(field.name == "inertia" for field in entry.kind.fields):
            hint = "give inertia, shape or parts; a body without orientation is a point"
            self.nodes.complain(node, entry.path, "the body has no inertia", hint)
        elif len(given) > 1:
            message = f"{given[0]!r} and {given[1]!r} cannot both be given"
            self.nodes.complain(entry.places[given[1]], entry.path, message)

    # --- entries with a type ----------------------------------------------------------------------------------------

    def _find(
        self, section: str, mapping: Mapping | None, dimension: int | None, reserved: tuple[str, ...] = ()
    ) -> Found:
        """Find the entries of a section and their types; a `dimension` of None stands for both."""
        self.names.written[section] = mapping.entries if mapping else ()
        found: Found = {}
        for key, item in mapping.pairs() if mapping else ():
            path = f"{section}.{key.text}"
            self.nodes.check_name(key, path, entry_word(section), reserved)
            entry = self.nodes.mapping(item, path)
            kind = self._type(entry, section, path, dimension) if entry else None
            if entry is not None and kind is not None:
                found[key.text] = self._of_its_laws(kind, key.text, entry), entry
        return found

    def _of_its_laws(self, kind: Kind, name: str, node: Mapping) -> Kind:
        """Return what a kind is with the laws of an entry: another one if they depend on the motion."""
        for field in kind.fields if kind.following is not None else ():
            item = node.entries.get(field.name)
            if field.shape == "law" and isinstance(item, Scalar):
                with suppress(ExpressionError):
                    law = filled_in(parse(item.text), self.names.definitions, self.names.tables)
                    if law.rates() or any(moves(x, self.names.coordinates) for x in law.names()):
                        self.parts[name], self.places[name] = Part({}, item.text), node.location
                        return kind.following or kind
        return kind

    def _type(self, node: Mapping, section: str, path: str, dimension: int | None) -> Kind | None:
        kinds = KINDS[section]
        type_node = node.entries.get("type")
        if type_node is None:
            hint = "known types: " + ", ".join(_names(kinds, dimension))
            self.nodes.complain(node, path, "the key 'type' is missing", hint)
            return None
        name = self.nodes.word(type_node, f"{path}.type", "a type")
        if name is None:
            return None
        for d in (2, 3) if dimension is None else (dimension,):
            if (name, d) in kinds:
                return kinds[name, d]
        here = _names(kinds, dimension)
        other = any(kind_name == name for kind_name, _ in kinds)
        scene = "planar" if dimension == 2 else "spatial"
        message = f"the type {name!r} does not exist in a {scene} scene" if other else f"unknown type {name!r}"
        elsewhere = [x for x in KINDS if any(kind_name == name for kind_name, _ in KINDS[x])]
        hint = RUBBING if name in FRICTION else suggestion(name, here) or "known types: " + ", ".join(here)
        if elsewhere and not other:
            hint = (
                f"{name!r} is a type of {' and '.join(elsewhere)}: is the line '{elsewhere[0]}:' missing or indented?"
            )
        self.nodes.complain(type_node, f"{path}.type", message, hint)
        return None

    def _entry(self, section: str, name: str, kind: Kind, node: Mapping) -> Entry:
        path = f"{section}.{name}"
        fields = [field for field in kind.fields if self.names.dimension in field.dimensions and not field.made]
        known = [*(["type"] if section in KINDS else []), *(field.name for field in fields)]
        misspelt = self.nodes.known_keys(
            node, path, known, partial(self._of_another, section), ELSEWHERE, partial(self._not_here, section, kind)
        )
        reading, told = Reading(self.quantities, node, path), len(self.nodes.document.problems)
        read_fields(reading, fields, misspelt)
        self._check_given(reading, kind)
        if kind.part is not None and name in self.parts:
            from mbstab.model.sections.parts import write_effort

            sound = len(self.nodes.document.problems) == told  # else what its states would complain about is told
            part = write_effort(reading, kind, name, node) if sound else None
            self.parts[name] = part or Part(dict.fromkeys(self.parts[name].states, "0"), "0")
        places = {field.name: node.entries[field.name].location for field in fields if field.name in node.entries}
        return Entry(section, name, kind, reading.values, node.location, places)

    def _of_another(self, section: str, key: str) -> str:
        """Return which types of a section have a key, as a hint; empty: none."""
        kinds: MappingType[tuple[str, int], Kind] = KINDS.get(section, {})
        having = [
            name
            for (name, dimension), kind in kinds.items()
            if dimension == self.names.dimension and any(field.name == key and not field.made for field in kind.fields)
        ]
        return f"{key} is a key of the type{'s' * (len(having) > 1)} {', '.join(having)}" if having else ""

    def _not_here(self, section: str, kind: Kind, key: str) -> str:
        """Return why an entry of this scene cannot have a key, as a hint; empty: nothing is known of it."""
        if section == "states" and key in STARTING:
            return (
                "where it starts stands under initial: coordinates:, and at the reference under reference: coordinates:"
            )
        if key in FRICTION and section in ("joints", "contacts", "forces"):
            return RUBBING
        here, there = ("planar", "spatial") if self.names.dimension == 2 else ("spatial", "planar")
        kinds: MappingType[tuple[str, int], Kind] = KINDS.get(section, {})
        other = kinds.get((kind.name, 5 - self.names.dimension), kind)
        if any(field.name == key and not field.made for field in (*kind.fields, *other.fields)):
            return f"a {kind.name} has {key} in {there} scenes only, and this one is {here}"
        return ""

    def _check_given(self, reading: Reading, kind: Kind) -> None:
        """Refuse keys that exclude each other, or that need one which is missing."""
        node, path = reading.node, reading.path
        for group in kind.one_of:
            given = [key for key in group if key in reading.values or key in node.entries]
            if len(given) != 1:
                said = " and ".join(map(repr, given)) if len(group) > 2 and given else "both" if given else "none"
                self.nodes.complain(node, path, f"give one of {' and '.join(map(repr, group))}, {said} given")
        if kind.some_of and not any(key in node.entries for key in kind.some_of) and not self.nodes.faulty(path):
            *others, last = map(repr, kind.some_of)
            hint = f"without them, a {kind.name} does nothing; each may be 0"
            self.nodes.complain(node, path, f"give at least one of {', '.join(others)} and {last}", hint)
        for field in kind.fields:
            for other in field.needs if field.name in node.entries else ():
                self.nodes.required(node, other, f"{path}.{field.name}", f"it is needed for the {field.doc}")

    def _refuse_circles(self, joints: dict[str, Entry]) -> None:
        """Refuse joints that name each other in a circle."""
        named = {
            name: {other: field.name for field, kind, value in given_fields(joint) for other in kind.joints(value)}
            for name, joint in joints.items()
        }
        for circle in in_order(named)[1]:
            # The last link that closes the circle is where it can be cut.
            joint, key = joints[circle[-2]], named[circle[-2]][circle[-1]]
            message = "joints depend on each other in a circle: " + " → ".join(circle)
            self.nodes.complain(joint.places[key], f"{joint.path}.{key}", message, "let one of them name another joint")

    def _refuse_loops(self, states: dict[str, Entry]) -> None:
        """Refuse states whose rates need each other: nothing says in which order they follow."""
        needs = {
            name: [x for x in state.values["rate"].rates() if x in states and x != name]
            for name, state in states.items()
            if "rate" in state.values
        }
        needs = {name: [x for x in named if x in needs] for name, named in needs.items()}
        for circle in in_order(needs)[1]:
            state = states[circle[0]]
            message = "an algebraic loop: rates depend on each other in a circle: " + " → ".join(circle)
            hint = "solve the equations for the rates, or let one of them be a lag: (x - z)/T"
            self.nodes.complain(state.places["rate"], f"{state.path}.rate", message, hint)

    def _refuse_reactions_of_states(self, constraints: dict[str, Entry], states: dict[str, Entry]) -> None:
        """Refuse constraints on states whose rates contain speeds of bodies.

        The row of such a rate passes the reaction of the constraint on to these bodies, as a linkage does; a signal
        has no such effect.
        """
        felt: dict[str, str] = {}  # states, and the coordinate or the state whose speed stands in their rates
        while True:
            before = len(felt)
            for name, state in states.items():
                rate = state.values.get("rate")
                seen = [x for x in rate.rates() if x not in states or x in felt] if rate is not None else [name]
                if seen and name not in felt:
                    felt[name] = seen[0]
            if len(felt) == before:
                break
        for entry in constraints.values():
            for role, expression in entry.values.items():
                used = expression.names() if role == "holonomic" else expression.rates()
                for name in (x for x in used if x in felt):
                    # A speed such as vx(point) counts as the rate of itself.
                    speed = felt[name] if is_speed(felt[name]) else f"rate({felt[name]})"
                    message = (
                        f"state '{name}' moves bodies here, and its rate contains {speed}: the reaction would act on "
                        f"what has this speed, too, as through a linkage"
                    )
                    hint = (
                        f"let another state follow the speed, such as w: {{rate: ({speed} - w)/T}}, and '{name}' "
                        "follow w; or apply a force instead, of type: actuator"
                    )
                    self.nodes.complain(entry.places[role], f"{entry.path}.{role}", message, hint)

    # --- constraints ------------------------------------------------------------------------------------------------

    def _constraints(self, node: YamlNode | None) -> dict[str, Entry]:
        section = self.nodes.optional(node, "constraints")
        read = (
            self._constraint(key, item, f"constraints.{key.text}") for key, item in (section.pairs() if section else ())
        )
        return {entry.name: entry for entry in read if entry is not None}

    def _constraint(self, key: Scalar, node: YamlNode, path: str) -> Entry | None:
        self.nodes.check_name(key, path, "constraint")
        mapping = self.nodes.mapping(node, path, "{holonomic: expression} or {nonholonomic: expression}")
        if mapping is None:
            return None
        self.nodes.known_keys(mapping, path, CONSTRAINT_KINDS)
        given = [role for role in CONSTRAINT_KINDS if role in mapping.entries]
        if len(given) != 1:
            self.nodes.complain(mapping, path, "give one of 'holonomic' and 'nonholonomic'")
            return None
        entry = self._entry("constraints", key.text, CONSTRAINT_KINDS[given[0]], mapping)
        return entry if entry.values else None


def home(word: str) -> str:
    """Return a hint on the section where entries of a kind stand, as forces for ``springs``, or an empty string."""
    singular = word.lower().removesuffix("s")
    for section, own in SECTIONS.items():
        kinds: MappingType[tuple[str, int], Kind] = KINDS.get(section, {})
        named = [name for name in _names(kinds, None) if singular in (name, *name.split("_"))]
        if named or re.search(rf"\b{re.escape(singular)}s\b", own.doc):
            types = f", of type {', '.join(named)}" if named else ""
            return f"{word} stand in the section '{section}'{types}"
    return ""


def _names(kinds: Iterable[tuple[str, int]], dimension: int | None) -> list[str]:
    """Return the names of the types in scenes of a dimension, or of any."""
    return sorted({name for name, d in kinds if dimension in (None, d)})
