"""YAML text to nodes that know where they stand.

Only the event stream of PyYAML is used: no value is resolved (``yes``, ``010`` and
``1e-3`` stay the text they are), no tag constructs anything, and the nesting is
bounded before anything recurses. Anchors, aliases, tags, repeated keys, merge keys and
second documents are refused, all at once, with their place.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import yaml

from mbstab.errors import Location, ModelFileError, Problem, UsageError

MAX_BYTES = 1_000_000
MAX_NESTING = 30


@dataclass(frozen=True)
class Scalar:
    """A leaf: its text as written, without quotes."""

    text: str
    location: Location
    quoted: bool = False

    @property
    def empty(self) -> bool:
        """Whether nothing is written (``mass:`` alone)."""
        return not self.text.strip() and not self.quoted


@dataclass(frozen=True)
class Sequence:
    """A list of nodes."""

    items: list[YamlNode]
    location: Location


@dataclass(frozen=True)
class Mapping:
    """Keys with their nodes, in the order of the file."""

    entries: dict[str, YamlNode]
    keys: dict[str, Scalar]
    location: Location


YamlNode = Scalar | Sequence | Mapping


@dataclass
class Document:
    """A file as nodes, with its lines for messages and the problems found so far."""

    name: str
    lines: list[str]
    root: YamlNode | None = None
    problems: list[Problem] = field(default_factory=list)

    def complain(self, location: Location, path: str, message: str, hint: str = "") -> None:
        """Record a problem at a place."""
        source = self.lines[location.line - 1] if 0 < location.line <= len(self.lines) else ""
        self.problems.append(Problem(location, path, message, hint, source))

    def raise_problems(self) -> None:
        """Raise `ModelFileError` if anything was recorded."""
        if self.problems:
            raise ModelFileError(self.problems)


def read_text(path: Path) -> bytes:
    """Return the bytes of a model file.

    Raises
    ------
    UsageError
        If the file cannot be read or is larger than `MAX_BYTES`.
    """
    try:
        with path.open("rb") as stream:
            data = stream.read(MAX_BYTES + 1)
    except OSError as error:
        raise UsageError(f"{path}: cannot be read: {error.strerror}") from None
    if len(data) > MAX_BYTES:
        raise UsageError(f"{path}: a model file may have {MAX_BYTES:,} bytes at most; this one is larger")
    return data


def parse_yaml(data: bytes | str, name: str) -> Document:
    """Read YAML into nodes.

    Parameters
    ----------
    data : bytes or str
        The text; bytes must be UTF-8.
    name : str
        What messages call the file.

    Raises
    ------
    ModelFileError
        If the text is no YAML, or uses what model files refuse.
    """
    text = _decode(data, name) if isinstance(data, bytes) else data
    document = Document(name, text.splitlines())
    for line_number, line in enumerate(document.lines, 1):
        for column, character in enumerate(line, 1):
            if not (character.isprintable() or character == "\t"):
                message = f"the file contains the control character U+{ord(character):04X}"
                document.complain(Location(name, line_number, column), "", message)
                document.raise_problems()
    _Composer(document).run(text)
    document.raise_problems()
    if document.root is None:
        document.complain(Location(name, 1, 1), "", "the file is empty", "a model starts with the line mbstab: 1")
        document.raise_problems()
    return document


def _decode(data: bytes, name: str) -> str:
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        before = data[: error.start]
        line = before.count(b"\n") + 1
        column = len(before[before.rfind(b"\n") + 1 :].decode("utf-8", "replace")) + 1
        message = f"the file is not UTF-8 text: byte 0x{data[error.start]:02X}"
        raise ModelFileError([Problem(Location(name, line, column), "", message)]) from None


class _Composer:
    """Builds nodes from parser events with an explicit stack."""

    def __init__(self, document: Document) -> None:
        self.document = document
        # Open containers: the node and, in a mapping, the key that waits for its value.
        self.stack: list[tuple[Sequence | Mapping, Scalar | None]] = []

    def run(self, text: str) -> None:
        loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
        documents = 0
        try:
            for event in yaml.parse(text, Loader=loader):
                if isinstance(event, yaml.DocumentStartEvent):
                    documents += 1
                    if documents > 1:
                        hint = "one file holds one model; remove the second '---'"
                        self.document.complain(self._at(event), "", "a second document starts here", hint)
                        return
                elif isinstance(event, yaml.NodeEvent):
                    self._node(event)
                    if len(self.stack) > MAX_NESTING:
                        message = f"a model file may be nested {MAX_NESTING} deep"
                        self.document.complain(self._at(event), "", message)
                        return
                elif isinstance(event, yaml.CollectionEndEvent):
                    self.stack.pop()
        except yaml.MarkedYAMLError as error:
            mark = error.problem_mark or error.context_mark
            line, column = (mark.line + 1, mark.column + 1) if mark else (1, 1)
            reason = error.problem or error.context or "the text is no YAML"
            self.document.complain(Location(self.document.name, line, column), "", f"not valid YAML: {reason}")
        except yaml.YAMLError as error:
            self.document.complain(Location(self.document.name, 1, 1), "", f"not valid YAML: {error}")

    def _at(self, event: yaml.Event) -> Location:
        mark = event.start_mark
        return Location(self.document.name, mark.line + 1, mark.column + 1)

    def _node(self, event: yaml.NodeEvent) -> None:
        location = self._at(event)
        if isinstance(event, yaml.AliasEvent):
            hint = "start an expression with a number, a name or a parenthesis"
            self.document.complain(location, "", "aliases (*name) are not allowed in a model file", hint)
            self._place(Scalar("0", location))
            return
        if event.anchor is not None:
            self.document.complain(location, "", "anchors (&name) are not allowed in a model file")
        if getattr(event, "tag", None) is not None:
            self.document.complain(location, "", f"tags ({event.tag}) are not allowed in a model file")
        if isinstance(event, yaml.ScalarEvent):
            self._place(Scalar(event.value, location, event.style not in (None, "")))
        elif isinstance(event, yaml.SequenceStartEvent):
            self._open(Sequence([], location))
        else:
            self._open(Mapping({}, {}, location))

    def _open(self, node: Sequence | Mapping) -> None:
        self._place(node)
        self.stack.append((node, None))

    def _place(self, node: YamlNode) -> None:
        if not self.stack:
            self.document.root = node
            return
        parent, key = self.stack[-1]
        if isinstance(parent, Sequence):
            parent.items.append(node)
        elif key is None:
            if not isinstance(node, Scalar):
                self.document.complain(node.location, "", "a key must be a word")
                node = Scalar(f"key at {node.location.line}:{node.location.column}", node.location)
            elif node.text == "<<":
                self.document.complain(node.location, "", "merge keys (<<) are not allowed in a model file")
            elif node.text in parent.entries:
                message = f"the key {node.text!r} is repeated; it stands first in line {parent.keys[node.text].location.line}"
                self.document.complain(node.location, "", message)
            self.stack[-1] = (parent, node)
        else:
            parent.entries.setdefault(key.text, node)
            parent.keys.setdefault(key.text, key)
            self.stack[-1] = (parent, None)
