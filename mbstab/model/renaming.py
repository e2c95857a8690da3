"""Names that are changed wherever they stand in a part of a model file.

What stands where follows from the sections and from the kinds of fields (`FieldKind.names`): words of the file format,
columns of files and units stay, also where a name of the part is spelled the same.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Iterator
from collections.abc import Mapping as MappingType
from contextlib import suppress
from dataclasses import replace

from mbstab.mechanics.catalogue import Field, Kind, PartError
from mbstab.mechanics.elements import KINDS
from mbstab.model.fields.base import FormError
from mbstab.model.fields.catalogue import kind_of
from mbstab.model.keys import ALONG, CURVES, SECTIONS
from mbstab.model.yamlfile import Mapping, Scalar, Sequence, YamlNode

_TOKEN = re.compile(r"(?<![\w.])(ground\.)?([A-Za-z_]\w*)")
_BARE = re.compile(r"-?[A-Za-z_]\w*")
_WORDS = ("type", *(field.name for field in (ALONG, *CURVES) if field.shape != "number"))
"""Keys within a field of an entry whose values are words of the file format or texts."""


class Renaming:
    """The names that a part gives, with what they become.

    Parameters
    ----------
    words : dict
        New names by the old ones: of entries, parameters and all else that stands in expressions.
    points, directions : dict
        Those of points and directions of the ground.
    of_bodies : collection of str
        The directions of bodies, which keep their names.
    """

    def __init__(
        self,
        words: MappingType[str, str],
        points: MappingType[str, str],
        directions: MappingType[str, str],
        of_bodies: Collection[str],
    ) -> None:
        self.words, self.points, self.directions = words, points, directions
        self.named_directions = {"x", "y", "z", *directions, *of_bodies}

    def of(self, part: Mapping) -> Mapping:
        """Return the sections of a part with other names."""
        found = Mapping({}, {}, part.location)
        for key, node in part.pairs():
            found.entries[key.text], found.keys[key.text] = self._section(key.text, node), key
        return found

    def text(self, text: str) -> str:
        """Return an expression or a name with other names."""
        return _TOKEN.sub(self._token, text)

    def _token(self, match: re.Match[str]) -> str:
        ground, name = match[1], match[2]
        return f"{ground}{self.points.get(name, name)}" if ground else self.words.get(name, name)

    # --- keys ---------------------------------------------------------------------------------------------------------

    def _section(self, section: str, node: YamlNode) -> YamlNode:
        if section == "ground":
            return self._mapped(node, self._places)
        if section in KINDS:
            return self._mapped(node, lambda _, entry: self._fields(_fields_of(section, entry), entry), self.text)
        return self._field(SECTIONS[section], node, node) if section in SECTIONS else self._values(node)

    def _places(self, group: str, node: YamlNode) -> YamlNode:
        names = self.points if group == "points" else self.directions
        return self._mapped(node, lambda _, place: self._values(place), lambda name: names.get(name, name))

    def _fields(self, fields: Iterable[Field], node: YamlNode) -> YamlNode:
        known = {field.name: field for field in fields}
        return self._mapped(
            node, lambda key, x: self._field(known[key], x, node) if key in known else self._other(key, x)
        )

    def _other(self, key: str, node: YamlNode) -> YamlNode:
        """Return the value of a key that is no field."""
        return node if key == "type" else self._values(node)

    def _field(self, field: Field, node: YamlNode, entry: YamlNode) -> YamlNode:
        match kind_of(field).names:
            case "none":
                return node
            case "keys":
                return self._mapped(node, lambda _, item: self._values(item), self.text)
            case "only keys":
                return self._mapped(node, lambda _, item: item, self.text)
            case "guess":
                rates = replace(field, shape="rates")
                return self._mapped(
                    node, lambda key, x: self._field(rates, x, node) if key == "rates" else self._values(x), self.text
                )
            case "fields":
                return self._fields(field.keys, node)
            case "fields by name":
                return self._mapped(node, lambda _, item: self._fields(field.keys, item), self.text)
            case "ground direction":
                return self._direction(node)
            case "direction":
                return self._of_body(node)
            case "directions":
                return self._directions(node, entry)
        return self._values(node)

    def _direction(self, node: YamlNode) -> YamlNode:
        """Return a direction in the axes of the ground."""
        if not isinstance(node, Scalar):
            return self._values(node)
        return Scalar(self.directions.get(node.text, node.text), node.location, node.quoted)

    def _of_body(self, node: YamlNode) -> YamlNode:
        """Return a direction in the frame of a body."""
        return node if isinstance(node, Scalar) else self._values(node)

    def _directions(self, node: YamlNode, entry: YamlNode) -> YamlNode:
        """Return a direction in the frames of two bodies, one of which may be the ground, or a list of two."""
        between = entry.entries.get("between") if isinstance(entry, Mapping) else None
        grounds = [self._is_ground(x) for x in between.items] if isinstance(between, Sequence) else []
        if len(grounds) != 2 or (isinstance(node, Sequence) and not self._is_pair(node)):
            return self._values(node)
        pair = node.items if isinstance(node, Sequence) else [node, node]
        first, second = (
            self._direction(x) if ground else self._of_body(x) for x, ground in zip(pair, grounds, strict=True)
        )
        return Sequence([first, second], node.location) if isinstance(node, Sequence) or first != second else first

    def _is_pair(self, node: Sequence) -> bool:
        """Whether a list has two directions, and not the components of one."""
        return len(node.items) == 2 and not any(self._is_number(item) for item in node.items)

    def _is_ground(self, node: YamlNode) -> bool:
        if isinstance(node, Mapping):
            node = node.entries.get("body", node)
        return isinstance(node, Scalar) and self.text(node.text).partition(".")[0] == "ground"

    def _is_number(self, node: YamlNode) -> bool:
        """Whether a node is a component of a direction, and not a direction."""
        if not isinstance(node, Scalar):
            return not isinstance(node, Sequence)
        name = node.text.strip()
        return not _BARE.fullmatch(name) or (name in self.words and name not in self.named_directions)

    # --- nodes --------------------------------------------------------------------------------------------------------

    def _values(self, node: YamlNode) -> YamlNode:
        """Return a node whose values are expressions or names, and whose keys are words of the file format."""
        if isinstance(node, Scalar):
            return Scalar(self.text(node.text), node.location, node.quoted)
        if isinstance(node, Sequence):
            return Sequence([self._values(x) for x in node.items], node.location)
        return self._mapped(node, lambda key, x: x if key in _WORDS else self._values(x))

    def _mapped(
        self, node: YamlNode, value: Callable[[str, YamlNode], YamlNode], name: Callable[[str], str] | None = None
    ) -> YamlNode:
        """Return a mapping with other values, and with other keys if these are names."""
        if not isinstance(node, Mapping):
            return self._values(node)
        found = Mapping({}, {}, node.location)
        for key, item in node.pairs():
            own = key if name is None else Scalar(name(key.text), key.location, key.quoted)
            found.entries[own.text], found.keys[own.text] = value(key.text, item), own
        return found


def states_of_force(name: str, entry: Mapping) -> Iterator[str]:
    """Yield the names of the states that a force has itself; an entry that cannot be read has none."""
    from mbstab.model.sections.parts import part_of

    for kind in _kinds("forces", entry):
        if kind.state is not None and kind.state.field in entry.entries:
            yield f"{name}_{kind.state.suffix}"
        elif kind.part is not None:
            with suppress(PartError, KeyError, FormError):
                yield from part_of(kind, name, entry).states


def _fields_of(section: str, entry: YamlNode) -> list[Field]:
    return [field for kind in _kinds(section, entry) for field in kind.fields]


def _kinds(section: str, entry: YamlNode) -> list[Kind]:
    """Return the kind of an entry, in the plane and in space; none if its type is unknown."""
    node = entry.entries.get("type") if isinstance(entry, Mapping) else None
    kinds = [KINDS[section].get((node.text, d)) for d in (2, 3)] if isinstance(node, Scalar) else []
    return [kind for kind in kinds if kind is not None]
