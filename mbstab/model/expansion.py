"""Parts of a model file that are written once: ``counts``, ``repeat`` and ``include``.

All of it happens before any section is read, on nodes that keep the place where they are written:

* ``counts: {N: 10}`` names whole numbers; ``<N>``, ``<2*N - 1>`` stand for them in names and values.
* ``repeat: [{for: {i: [1, N]}, bodies: …}]`` adds its sections once for each value of ``i``, which ``<i>`` stands for.
* ``include: [{file: wheel.yaml, prefix: left_, with: {r: 0.3}}]`` adds the sections of a part, whose names get the
  prefix; ``with`` gives values to its parameters and counts, and names to what it ``needs``.

Sections are merged; a name that stands twice is refused.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from itertools import product
from typing import Any

from mbstab.errors import UsageError, alternatives
from mbstab.mechanics.elements import KINDS
from mbstab.model.arithmetic import CONSTANTS
from mbstab.model.fields.catalogue import kind_of
from mbstab.model.functions import CALLED
from mbstab.model.keys import INCLUDE, SECTIONS, Section
from mbstab.model.nodes import NAME, NodeReader
from mbstab.model.renaming import Renaming, states_of_force
from mbstab.model.yamlfile import Document, Mapping, Scalar, Sequence, YamlNode, parse_part, read_beside

MAX_NODES = 300_000
MAX_TEXT = 20_000_000
"""Characters of all nodes."""
MAX_DEPTH = 8
RATES = "reference.guess.rates"
"""Names that stand one level deeper than others of their section."""
_RANGE = "write for: {i: [1, 10]} with the first and the last value"
_BLOCK = {
    "repeat": ("a block with the key for:", "write repeat: [{for: {i: [1, 10]}, bodies: {…}}]"),
    "include": ("a part with the key file:", "write include: [{file: part.yaml, prefix: left_}]"),
}
"""What an item of these sections is, and how one is written."""
_TEXTS = frozenset({"title", "source", "description"})
_INDEX = re.compile(r"<([^<>]*)>")
_WHOLE = re.compile(r"(?:\s*(?:[0-9]{1,10}(?![\w.])|[A-Za-z_]\w*(?!\w)|//|[-+*%()]))*\s*", re.ASCII)
"""Sums and products of decimal whole numbers and names."""
_OPERATIONS: dict[type, Callable[[int, int], int]] = {
    ast.Add: lambda a, b: a + b,
    ast.Sub: lambda a, b: a - b,
    ast.Mult: lambda a, b: a * b,
    ast.FloorDiv: lambda a, b: a // b,
    ast.Mod: lambda a, b: a % b,
}


def expanded(document: Document, root: Mapping) -> Mapping:
    """Return a model file with all its parts written out; the same mapping if it has none.

    Raises
    ------
    ModelFileError
        If a part cannot be read, or there would be more than `MAX_NODES` nodes.
    """
    if not any(_section(key).expanded for key in root.entries):
        return root
    if "needs" in root.entries:
        names = ", ".join(NodeReader(document).optional_pairs(root.entries["needs"], "needs"))
        hint = "another file takes it: include: [{file: …, prefix: …, with: {…}}]"
        document.fail(root.keys["needs"].location, "", f"this is a part of a model: it needs {names}", hint)
    return _Expansion(document).of(root, {}, ())


def _section(name: str) -> Section:
    """Return what is known of a section; of one that does not exist, nothing."""
    return SECTIONS.get(name, Section(name, "text", ""))


class _Expansion:
    """The expansion of one file."""

    def __init__(self, document: Document) -> None:
        self.document, self.nodes = document, NodeReader(document)
        self.left, self.characters = MAX_NODES, MAX_TEXT
        self.parts: dict[str, Mapping | None] = {}

    def of(
        self, root: Mapping, numbers: dict[str, int], chain: tuple[str, ...], given: dict[str, int] | None = None
    ) -> Mapping:
        """Return the sections of a file or a block, with numbers for what stands in angle brackets."""
        numbers = {**numbers, **self._counts(root.entries.get("counts"), numbers, given or {})}
        found = Mapping({}, {}, root.location)
        for key, node in root.pairs():
            if not _section(key.text).expanded:
                self._put(found, key, self._written(node, numbers, key.text), key.text, 0)
        for block in self._blocks(root.entries.get("repeat"), "repeat"):
            for values in self._values(block, numbers):
                self._spend(block)
                self._add(found, self.of(_without(block, "for"), {**numbers, **values}, chain), "repeated")
        for block in self._blocks(root.entries.get("include"), "include"):
            part = self._part(block, numbers, chain)
            if part is not None:
                self._add(found, part, "included")
        return found

    def _blocks(self, node: YamlNode | None, path: str) -> Iterator[Mapping]:
        if node is None or (isinstance(node, Scalar) and node.empty):
            return
        items = node.items if isinstance(node, Sequence) else [node]
        for i, item in enumerate(items):
            block = self.nodes.mapping(item, f"{path}[{i}]", *_BLOCK[path])
            if block is not None:
                yield block

    def _add(self, found: Mapping, part: Mapping, what: str) -> None:
        """Merge the sections of a block into those of a file."""
        for key, node in part.pairs():
            if _section(key.text).once:
                self.nodes.complain(key, key.text, f"the section {key.text!r} cannot be {what}", "write it in the file")
            else:
                self._put(found, key, node, key.text, 2 if kind_of(_section(key.text)).names == "fields" else 1)

    def _put(self, found: Mapping, key: Scalar, node: YamlNode, path: str, levels: int) -> None:
        """Put a node under a key; mappings are merged on so many levels, below which a name may stand once only."""
        other = found.entries.get(key.text)
        if other is None or (isinstance(other, Scalar) and other.empty):
            found.entries[key.text], found.keys[key.text] = node, key
        elif levels and isinstance(other, Mapping) and isinstance(node, Mapping):
            for inner, value in node.pairs():
                place = f"{path}.{inner.text}"
                self._put(other, inner, value, place, 1 if place == RATES else levels - 1)
        elif not (isinstance(node, Scalar) and node.empty) and not self._told(key):
            first = found.keys[key.text].location
            message = f"the name {key.text!r} is there already, from {first.file}:{first.line}"
            self.nodes.complain(key, path, message, "use an index such as <i> in the name, or another prefix")

    def _told(self, key: Scalar) -> bool:
        """Whether an index in a key has a problem that is told: what the key became is no name of its own."""
        return any(x.location == key.location for x in self.document.problems)

    # --- numbers in angle brackets ------------------------------------------------------------------------------------

    def _counts(self, node: YamlNode | None, numbers: dict[str, int], given: dict[str, int]) -> dict[str, int]:
        """Return the counts of a file by name; some may be given from outside."""
        found: dict[str, int] = {}
        for name, value in self.nodes.optional_pairs(node, "counts").items():
            key = node.keys[name] if isinstance(node, Mapping) else Scalar(name, value.location)
            if self.nodes.check_name(key, "counts", "count"):
                own = self._whole(value, f"counts.{name}", {**numbers, **found})
                found[name] = given.get(name, own)
        return found

    def _values(self, block: Mapping, numbers: dict[str, int]) -> Iterator[dict[str, int]]:
        """Yield the values of the indices of a block, one after the other."""
        node = self.nodes.required(block, "for", "repeat", _RANGE)
        indices = None if node is None else self.nodes.mapping(node, "repeat.for", "an index with its range", _RANGE)
        if indices is None:
            return
        ranges = {}
        for key, value in indices.pairs():
            path = f"repeat.for.{key.text}"
            self.document.indices.add(key.text)
            if not isinstance(value, Sequence) or len(value.items) != 2:
                self.nodes.complain(value, path, "expected the first and the last value", _RANGE)
                return
            if not self.nodes.check_name(key, path, "index"):
                return
            first, last = (self._whole(x, path, numbers) for x in value.items)
            if last < first:
                ends = (_told(x, number) for x, number in zip(value.items, (first, last), strict=True))
                said = f"the range of {key.text}, from {' to '.join(ends)}, is empty"
                for section in _brought(block):
                    self.document.empty.setdefault(section, (value.location, said))
            if last - first >= MAX_NODES:
                message = f"{last - first + 1} repetitions are too many: a file may have {MAX_NODES} nodes"
                self.document.fail(value.location, path, message)
            ranges[key.text] = range(first, last + 1)
        for values in product(*ranges.values()):
            yield dict(zip(ranges, values, strict=True))

    def _whole(self, node: YamlNode, path: str, numbers: dict[str, int]) -> int:
        """Return a whole number, written as such or in terms of counts and indices."""
        if not isinstance(node, Scalar):
            self.nodes.complain(node, path, "expected a whole number")
            return 1
        text = node.text[1:-1] if _INDEX.fullmatch(node.text) else node.text
        return self._number(text, node, path, numbers)

    def _number(self, text: str, node: Scalar, path: str, numbers: dict[str, int]) -> int:
        try:
            if not _WHOLE.fullmatch(text):
                raise ValueError
            return _integer(ast.parse(text.strip(), mode="eval").body, numbers)
        except KeyError as error:
            name = str(error.args[0])
            hint = alternatives(name, numbers, "counts and indices")
            self.nodes.complain(node, path, f"there is no count or index {name!r}", hint)
        except (SyntaxError, ValueError, ZeroDivisionError, RecursionError, MemoryError):
            hint = "whole numbers, counts and indices with + - * // %"
            self.nodes.complain(node, path, f"{text.strip()[:80]!r} is not a whole number", hint)
        return 1

    def _written(self, node: YamlNode, numbers: dict[str, int], path: str) -> YamlNode:
        """Return a copy of a node with numbers in the place of angle brackets."""
        self._spend(node)
        if isinstance(node, Scalar):
            return self._scalar(node, numbers, path)
        if isinstance(node, Sequence):
            return Sequence([self._written(x, numbers, path) for x in node.items], node.location)
        found = Mapping({}, {}, node.location)
        for key, value in node.pairs():
            own = self._scalar(key, numbers, path)
            where = f"{path}.{own.text}"
            self._put(found, own, self._written(value, numbers, where), where, 0)
        return found

    def _scalar(self, node: Scalar, numbers: dict[str, int], path: str) -> Scalar:
        if "<" not in node.text or not numbers or path.rpartition(".")[2] in _TEXTS:
            return node
        whole = _INDEX.fullmatch(node.text.strip()) is not None

        def put(match: re.Match[str]) -> str:
            number = self._number(match[1], node, path, numbers)
            return str(number) if whole or number >= 0 else f"({number})"  # <i>**2 and 1 - <i> of a negative number

        return Scalar(_INDEX.sub(put, node.text), node.location, node.quoted)

    def _spend(self, node: YamlNode) -> None:
        self.left -= 1
        self.characters -= len(node.text) if isinstance(node, Scalar) else sum(map(len, _keys(node)))
        if self.left < 0 or self.characters < 0:
            most = f"{MAX_NODES} nodes" if self.left < 0 else f"{MAX_TEXT} characters"
            self.document.fail(
                node.location, "repeat", f"written out, the file has more than {most}", "fewer repetitions"
            )

    # --- parts --------------------------------------------------------------------------------------------------------

    def _part(self, block: Mapping, numbers: dict[str, int], chain: tuple[str, ...]) -> Mapping | None:
        """Return the sections of a part, with its names prefixed."""
        block = _as_mapping(self._written(block, numbers, "include"))
        self.nodes.known_keys(block, "include", [field.name for field in INCLUDE])
        node = self.nodes.required(block, "file", "include", "the name of a file in the folder of the model")
        name = None if node is None else self.nodes.word(node, "include.file", "the name of a file")
        if node is None or name is None:
            return None
        if name in chain or len(chain) == MAX_DEPTH:
            circle = "includes itself" if name in chain else f"is included more than {MAX_DEPTH} deep"
            self.nodes.complain(node, "include.file", f"{name} {circle}: {' → '.join([*chain, name])}")
            return None
        try:
            text = read_beside(self.document, name)
        except UsageError as error:
            self.nodes.complain(node, "include.file", str(error))
            return None
        self._spend(node)
        self.document.origins.setdefault(name, node.location)
        if name not in self.parts:
            self.parts[name] = parse_part(self.document, text, name)
        root = self.parts[name]
        if root is None:
            return None
        prefix = (
            self.nodes.word(block.entries["prefix"], "include.prefix", "a prefix") if "prefix" in block.entries else ""
        )
        if prefix and not NAME.match(prefix):
            self.nodes.complain(block.entries["prefix"], "include.prefix", f"{prefix!r} cannot begin a name")
            return None
        given = self.nodes.optional(block.entries.get("with"), "include.with")
        values = {} if given is None else given.entries
        counts = set(self.nodes.optional_pairs(root.entries.get("counts"), "counts")) & set(values)
        whole = {name: self._whole(values[name], f"include.with.{name}", numbers) for name in sorted(counts)}
        own = _without(root, "mbstab", "title", "source", "needs")
        part = self.of(own, {}, (*chain, name), whole)
        rest = None if given is None else _without(given, *whole)
        return self._fitted(part, root.entries.get("needs"), rest, prefix or "", block)

    def _fitted(
        self, part: Mapping, needed: YamlNode | None, given: Mapping | None, prefix: str, block: Mapping
    ) -> Mapping:
        """Return a part with its own names prefixed, and what it needs replaced."""
        own = self._own(part)
        needs = self.nodes.optional(needed, "needs")
        wanted = set[str]()
        for name, key in needs.keys.items() if needs is not None else ():
            if name in own:
                self.nodes.complain(key, "needs", f"the part has {name!r} itself", "give one of the two another name")
            else:
                wanted.add(name)
        parameters = part.entries.get("parameters")
        settable = set(parameters.entries) if isinstance(parameters, Mapping) else set()
        values = {} if given is None else given.entries
        for key in () if given is None else given.keys.values():
            if key.text not in wanted | settable:
                known = sorted(wanted | settable)
                hint = alternatives(key.text, known, "it has")
                self.nodes.complain(key, "include.with", f"the part has no parameter and no need {key.text!r}", hint)
        for name in sorted(wanted - set(values)):
            self.nodes.complain(block, "include", f"the part needs {name!r}", f"write with: {{{name}: …}}")
        words = {name: prefix + name for name in (*own, *_made_states(part))}
        for name in wanted & set(values):
            word = self.nodes.word(values[name], f"include.with.{name}", "a name")
            words[name] = word or name
        points, directions = ({name: prefix + name for name in names} for names in self._of_ground(part))
        renamed = Renaming(words, points, directions, _directions_of_bodies(part)).of(part)
        inside = renamed.entries.get("parameters")
        for name in settable & set(values) & set(own):
            assert isinstance(inside, Mapping)
            old = inside.entries[prefix + name]
            if isinstance(old, Mapping):
                entries = {**old.entries, "value": values[name]}
                keys = {**old.keys, "value": old.keys.get("value", inside.keys[prefix + name])}
                inside.entries[prefix + name] = Mapping(entries, keys, old.location)
            else:
                inside.entries[prefix + name] = values[name]
        return renamed

    def _own(self, part: Mapping) -> list[str]:
        """Return the names that a part gives."""
        own: list[str] = []
        for section, node in part.entries.items():
            if kind_of(_section(section)).names not in ("keys", "fields by name"):
                continue
            for key in node.keys.values() if isinstance(node, Mapping) else ():
                if key.text in _reserved():
                    message = f"{key.text!r} is a word of the file format: a part cannot use it as a name"
                    self.nodes.complain(key, section, message, "choose another name")
                else:
                    own.append(key.text)
        return own

    def _of_ground(self, part: Mapping) -> tuple[list[str], list[str]]:
        """Return the names of the points of the ground in a part, and of its directions."""
        ground = self.nodes.optional(part.entries.get("ground"), "ground")
        groups = [None if ground is None else ground.entries.get(key) for key in ("points", "directions")]
        points, directions = (list(x.entries) if isinstance(x, Mapping) else [] for x in groups)
        return points, directions


def _directions_of_bodies(part: Mapping) -> set[str]:
    """Return the names of the directions of the bodies of a part."""
    bodies = part.entries.get("bodies")
    nodes = bodies.entries.values() if isinstance(bodies, Mapping) else ()
    groups = [body.entries.get("directions") for body in nodes if isinstance(body, Mapping)]
    return {name for x in groups if isinstance(x, Mapping) for name in x.entries}


def _made_states(part: Mapping) -> Iterator[str]:
    """Yield the names of the states that the forces of a part have themselves."""
    forces = part.entries.get("forces")
    for key, node in forces.pairs() if isinstance(forces, Mapping) else ():
        if isinstance(node, Mapping):
            yield from states_of_force(key.text, node)


def _integer(node: ast.AST, numbers: dict[str, int]) -> int:
    """Return the value of an expression of whole numbers."""
    if isinstance(node, ast.Constant) and type(node.value) is int:
        return node.value
    if isinstance(node, ast.Name):
        return numbers[node.id]
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        return -_integer(node.operand, numbers)
    if isinstance(node, ast.BinOp) and type(node.op) in _OPERATIONS:
        value = _OPERATIONS[type(node.op)](_integer(node.left, numbers), _integer(node.right, numbers))
        if abs(value) <= 10**9:
            return value
    raise ValueError


def _told(node: YamlNode, number: int) -> str:
    """Return the end of a range as it is written, with its value."""
    text = node.text.strip("<>") if isinstance(node, Scalar) else ""
    return str(number) if not text or text == str(number) else f"{text} = {number}"


def _brought(block: Mapping) -> Iterator[str]:
    """Yield the sections that a block adds, those that the repetitions in it add too; a part may add any."""
    for key, node in block.entries.items():
        if key == "repeat":
            for item in node.items if isinstance(node, Sequence) else [node]:
                yield from _brought(item) if isinstance(item, Mapping) else ()
        yield from SECTIONS if key == "include" else (key,)


def _keys(node: Mapping | Sequence) -> Iterable[str]:
    return node.entries if isinstance(node, Mapping) else ()


def _without(node: Mapping, *keys: str) -> Mapping:
    kept = [key for key in node.entries if key not in keys]
    return Mapping({key: node.entries[key] for key in kept}, {key: node.keys[key] for key in kept}, node.location)


def _as_mapping(node: YamlNode) -> Mapping:
    assert isinstance(node, Mapping)
    return node


@cache
def _reserved() -> frozenset[str]:
    """Return the words that stand for something else in values: types, choices, functions, constants, axes."""
    kinds: set[Any] = {kind for section in KINDS.values() for kind in section.values()}
    choices = {word for kind in kinds for field in kind.fields for word in field.choices}
    return frozenset({*choices, *CALLED, *CONSTANTS, *SECTIONS, "rate", "acceleration", "t", "x", "y", "z"})
