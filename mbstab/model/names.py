"""What a model file names: parameters, bodies and their coordinates, joints; how one part of it finds another."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping

from mbstab.errors import alternatives
from mbstab.mechanics.catalogue import Kind
from mbstab.model import units
from mbstab.model.expressions import Expression
from mbstab.model.measures import Places
from mbstab.model.nodes import NodeReader
from mbstab.model.schema import Components, Entry, MeasureValue, Parameter, TableValue, entry_word
from mbstab.model.turns import Counted
from mbstab.model.yamlfile import Mapping as MappingNode
from mbstab.model.yamlfile import Scalar, YamlNode


class Names:
    """The names of one file, each filled in before anything looks it up.

    Attributes
    ----------
    dimension : int
        2 for a planar scene, 3 for a spatial one.
    parameters, units : dict
        Parameters by name, and what is known of their units.
    counted : dict of Counted
        What parameters count: radians or turns.
    state_units : dict
        Units of the states that have one, as they are written or as their equations decide.
    bodies : dict of Entry
        The bodies that were read.
    joints : dict of Kind
        The types of the joints. They are known before any joint is read, so entries may name
        joints that stand further down.
    contacts : dict of (Kind, Mapping)
        The types of the contacts, and what is written of them, known before any is read.
    written : dict of collections of str
        By section, every name in the file; an entry with a problem is written, but not known.
    tables : dict of TableValue
        Functions given by points.
    definitions : dict of Expression
        Named expressions, as they are written.
    coordinates : dict
        Names of all coordinates, such as ``rod.theta``, in the order of q.
    measures : dict
        What the measures in expressions name.
    geometry : dict of pairs of dict
        Named points and named directions by body; None stands for the ground.
    """

    def __init__(self, nodes: NodeReader) -> None:
        self.nodes = nodes
        self.dimension = 3
        self.parameters: dict[str, Parameter] = {}
        self.units: dict[str, units.Known] = {}
        self.counted: dict[str, Counted] = {}
        self.state_units: dict[str, str] = {}
        self.bodies: dict[str, Entry] = {}
        self.joints: dict[str, Kind] = {}
        self.contacts: dict[str, tuple[Kind, MappingNode]] = {}
        self.written: dict[str, Collection[str]] = {}
        self.tables: dict[str, TableValue] = {}
        self.definitions: dict[str, Expression] = {}
        self.coordinates: dict[str, None] = {}
        self.measures: dict[str, MeasureValue] = {}
        self.geometry: dict[str | None, tuple[dict[str, Components], dict[str, Components]]] = {}

    @property
    def places(self) -> Places:
        """What measures may name, as far as the file has been read."""
        points = {body: points for body, (points, _) in self.geometry.items()}
        return Places(self.dimension, self.joints, self.bodies, points, self.written["bodies"])

    def unread(self, coordinate: str) -> bool:
        """Whether a coordinate belongs to a body that is in the file but could not be read."""
        body = coordinate.partition(".")[0]
        return body in self.written["bodies"] and body not in self.bodies

    def _known(
        self, node: YamlNode, path: str, word: str, section: str, known: Collection[str], also: tuple[str, ...] = ()
    ) -> bool:
        """Whether a name is known; one that is written but could not be read has its problem already."""
        found = word in known or word in also
        if not found and word not in self.written[section]:
            what = entry_word(section)
            hint = alternatives(word, [*known, *also], section)
            self.nodes.complain(node, path, f"there is no {what} {word!r}", hint)
        return found

    def has_body(self, node: YamlNode, path: str, word: str) -> bool:
        """Whether there is a body of that name; refuse it if not."""
        return self._known(node, path, word, "bodies", self.bodies)

    def has_body_or_ground(self, node: YamlNode, path: str, word: str) -> bool:
        """Whether a name is that of a body, or ``ground``; refuse it if not."""
        return self._known(node, path, word, "bodies", self.bodies, ("ground",))

    def has_drive(self, node: YamlNode, path: str, word: str) -> bool:
        """Whether there is a drive of that name; refuse it if not."""
        return self._known(node, path, word, "drives", self.written["drives"])

    def joint(self, node: YamlNode, path: str, word: str) -> Kind | None:
        """Return the type of the joint of that name."""
        return self.joints[word] if self._known(node, path, word, "joints", self.joints) else None

    def contact(self, node: YamlNode, path: str, word: str) -> tuple[Kind, MappingNode] | None:
        """Return the type of the contact of that name, and what is written of it."""
        return self.contacts[word] if self._known(node, path, word, "contacts", self.contacts) else None

    def coordinate(self, node: YamlNode, path: str) -> str | None:
        """Return the name of a coordinate."""
        word = self.nodes.word(node, path, "a coordinate such as body.x")
        if word is None or self.unread(word):
            return None
        if word not in self.coordinates:
            hint = self.places.meant(word, self.coordinates)
            self.nodes.complain(node, path, f"there is no coordinate {word!r}", hint)
            return None
        return word

    def check_parameter(self, node: Scalar, path: str) -> None:
        """Refuse a name that no parameter has."""
        if node.text not in self.parameters:
            hint = alternatives(node.text, self.parameters, "parameters")
            self.nodes.complain(node, path, f"there is no parameter {node.text!r}", hint)


def in_order(needs: Mapping[str, Iterable[str]]) -> tuple[list[str], list[list[str]]]:
    """Return names so that each comes after those it needs, and the circles that had to be cut.

    Parameters
    ----------
    needs : mapping
        From each name to those it needs, all of them keys.

    Returns
    -------
    order : list of str
    circles : list of list of str
        Each begins and ends with the same name.
    """
    done: dict[str, None] = {}
    circles = []
    for start in needs:
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
                circles.append([*names[names.index(following) :], following])
            else:
                path[following] = iter(needs[following])
    return list(done), circles
