"""YAML text to nodes that know where they stand.

Only the event stream of PyYAML is used: no value is resolved (``yes``, ``010`` and
``1e-3`` stay the text they are), no tag constructs anything, and the nesting is
bounded before anything recurses. Anchors, aliases, tags, repeated keys, merge keys and
second documents are refused, all at once, with their place.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import field
from pathlib import Path
from typing import Any, BinaryIO, NoReturn

import yaml

from mbstab.errors import Location, ModelFileError, Problem, UsageError, counted, unseen
from mbstab.records import dataclass

MAX_BYTES = 1_000_000
MAX_NESTING = 30
MAX_PROBLEMS = 100

_LINE_BREAK = re.compile(r"\r\n|\r|\n")


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

    def pairs(self) -> Iterator[tuple[Scalar, YamlNode]]:
        """Yield each key with its value."""
        return zip(self.keys.values(), self.entries.values(), strict=True)


YamlNode = Scalar | Sequence | Mapping


Opened = Callable[[Path], object]
"""What is told which files are read: whoever writes files too keeps them apart, also where a model is wrong."""


def not_told(path: Path) -> None:
    """Tell nobody which files are read."""


@dataclass
class Document:
    """What messages about a file need: its name and lines, and the problems found so far."""

    name: str
    lines: list[str]
    problems: list[Problem] = field(default_factory=list)
    beside: dict[str, str] = field(default_factory=dict)
    """Texts of other files that it names, by their names."""
    origins: dict[str, Location] = field(default_factory=dict)
    """Where parts are included first, by the names of their files."""
    counts: dict[str, YamlNode] = field(default_factory=dict)
    """The values of ``counts:`` as they are written."""
    indices: set[str] = field(default_factory=set)
    """Names of the indices of ``repeat:``."""
    doubts: list[str] = field(default_factory=list)
    """Warnings about what is likely to be meant otherwise."""
    opened: Opened = not_told
    """Is called with the path of each file that is read beside it, before it is."""
    empty: dict[str, tuple[Location, str]] = field(default_factory=dict)
    """By the sections that a repetition over an empty range does not add: where the range stands, and what it is."""

    def problem(self, location: Location, path: str, message: str, hint: str = "") -> Problem:
        """Return a problem at a place, with its line of the file."""
        lines = self._lines(location)
        source = lines[location.line - 1] if 0 < location.line <= len(lines) else ""
        if location.file in self.origins:
            message = f"{message} (included in {self.origins[location.file]})"
        return Problem(location, path, message, hint, source)

    def complain(self, location: Location, path: str, message: str, hint: str = "") -> None:
        """Record a problem at a place, once; give up after `MAX_PROBLEMS`."""
        problem = self.problem(location, path, message, hint)
        if any((x.location, x.message) == (location, problem.message) for x in self.problems):
            return  # in another repetition of the same text
        self.problems.append(problem)
        if len(self.problems) == MAX_PROBLEMS:
            end = Location(self.name, len(self.lines), 1)
            raise ModelFileError([*self.problems, Problem(end, "", f"stopped after {MAX_PROBLEMS} problems")])

    def fail(self, location: Location, path: str, message: str, hint: str = "") -> NoReturn:
        """Record a problem that makes it impossible to go on, and raise all problems."""
        self.complain(location, path, message, hint)
        raise ModelFileError(self.problems)

    def locate(self, node: Scalar, position: int) -> Location:
        """Return the place of a character of a scalar; its start if the text is not written literally on one line."""
        place = node.location
        column = place.column + (1 if node.quoted else 0)
        if not self._lines(place)[place.line - 1].startswith(node.text, column - 1):
            return place
        return Location(place.file, place.line, column + position)

    def _lines(self, place: Location) -> list[str]:
        return _LINE_BREAK.split(self.beside[place.file]) if place.file in self.beside else self.lines

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
            return read_limited(stream, str(path))
    except OSError as error:
        raise UsageError(f"{path}: cannot be read: {error.strerror}") from None


def read_beside(document: Document, name: str) -> str:
    """Return the text of a file in the folder of a model file, which then belongs to it.

    Raises
    ------
    UsageError
        If it cannot be read, has another folder in its name, or is a link into one or no file.
    """
    if name not in document.beside:
        if Path(name).name != name:
            raise UsageError(f"{name!r} is not the name of a file in the folder of the model")
        model = Path(document.name)
        path = model.parent / name
        document.opened(path)
        try:
            _refuse_elsewhere(path, model)
            document.beside[name] = read_text(path).decode("utf-8-sig")
        except UnicodeDecodeError:
            raise UsageError(f"{name}: is not text in UTF-8") from None
        except (OSError, RuntimeError, ValueError) as error:  # names that the system refuses, circles of links
            raise UsageError(f"{name}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
    return document.beside[name]


def _refuse_elsewhere(path: Path, model: Path) -> None:
    """Refuse what is no file, such as a pipe, which is never read to its end, and a link out of the folder."""
    if not path.exists():
        return  # told when it is read
    if not path.is_file():
        raise UsageError(f"{path.name}: is not a file")
    if path.resolve().parent not in (model.parent.resolve(), model.resolve().parent):
        raise UsageError(f"{path.name}: is a link to a file outside the folder of the model")


def read_limited(stream: BinaryIO, name: str) -> bytes:
    """Return what a stream holds; `name` is what messages call it.

    Raises
    ------
    UsageError
        If it is larger than `MAX_BYTES`.
    """
    data = stream.read(MAX_BYTES + 1)
    if len(data) > MAX_BYTES:
        raise UsageError(f"{name}: a model file may have at most {MAX_BYTES:,} bytes; this one is larger")
    return data


def parse_yaml(data: bytes | str, name: str) -> tuple[Document, Mapping]:
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
        If the text is not YAML, or uses parts of YAML that model files do not allow.
    """
    text = decoded(data, name) if isinstance(data, bytes) else data.removeprefix("\ufeff")
    document = Document(name, _LINE_BREAK.split(text))
    _refuse_invisible(document)
    root = _Composer(document).run(text)
    document.raise_problems()
    hint = "a model starts with the line mbstab: 1"
    if root is None:
        document.fail(Location(name, 1, 1), "", "the file is empty", hint)
    if not isinstance(root, Mapping):
        document.fail(root.location, "", "a model file holds keys and values", hint)
    return document, root


def parse_part(document: Document, text: str, name: str) -> Mapping | None:
    """Read YAML that belongs to a file; None if it is not valid, which the document then says."""
    try:
        return parse_yaml(text, name)[1]
    except ModelFileError as error:
        document.problems.extend(error.problems)
        return None


def yaml_text(root: Mapping) -> str:
    """Return nodes as YAML."""

    def events(node: YamlNode, depth: int) -> Iterator[yaml.Event]:
        if isinstance(node, Scalar):
            yield yaml.ScalarEvent(None, None, (True, True), node.text, style="'" if node.quoted else None)
        elif isinstance(node, Sequence):
            flat = depth > 1 or not any(isinstance(x, Mapping) for x in node.items)
            yield yaml.SequenceStartEvent(None, None, True, flow_style=flat)
            for item in node.items:
                yield from events(item, depth + 1)
            yield yaml.SequenceEndEvent()
        else:
            yield yaml.MappingStartEvent(None, None, True, flow_style=depth > 1)
            for key, value in node.pairs():
                yield from events(key, depth + 1)
                yield from events(value, depth + 1)
            yield yaml.MappingEndEvent()

    document = [yaml.DocumentStartEvent(explicit=False), *events(root, 0), yaml.DocumentEndEvent(explicit=False)]
    return str(
        yaml.emit([yaml.StreamStartEvent(), *document, yaml.StreamEndEvent()], width=1_000_000, allow_unicode=True)
    )


def _refuse_invisible(document: Document) -> None:
    """Refuse control characters and other characters that a reader could not see."""
    for line_number, line in enumerate(document.lines, 1):
        for column, character in _invisible(line):
            message = f"the file contains the invisible character U+{ord(character):04X}"
            document.fail(Location(document.name, line_number, column), "", message)


def _invisible(text: str) -> Iterator[tuple[int, str]]:
    """Yield the characters that cannot be seen, with their places from 1; blanks and line breaks do not count."""
    if not text.isprintable():
        for place, character in enumerate(text, 1):
            if character not in "\t\n" and unseen(character):
                yield place, character


def decoded(data: bytes, name: str) -> str:
    """Return UTF-8 text; `name` is what messages call the file.

    Raises
    ------
    ModelFileError
        If the bytes are not UTF-8.
    """
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
        self.root: YamlNode | None = None
        # Open containers: the node and, in a mapping, the key that waits for its value.
        self.stack: list[tuple[Sequence | Mapping, Scalar | None]] = []

    def run(self, text: str) -> YamlNode | None:
        """Return the root node, or None if there is none; problems go to the document."""
        loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
        documents = 0
        try:
            for event in yaml.parse(text, Loader=loader):
                if isinstance(event, yaml.DocumentStartEvent):
                    documents += 1
                    if documents > 1:
                        hint = "one file holds one model; remove the second '---'"
                        self.document.complain(self._at(event.start_mark), "", "a second document starts here", hint)
                        break
                elif isinstance(event, yaml.NodeEvent):
                    self._node(event)
                    if len(self.stack) > MAX_NESTING:
                        message = f"a model file may be nested at most {MAX_NESTING} deep"
                        self.document.complain(self._at(event.start_mark), "", message)
                        break
                elif isinstance(event, yaml.CollectionEndEvent):
                    self.stack.pop()
        except yaml.MarkedYAMLError as error:
            reason = error.problem or error.context or "the text is not YAML"
            place = self._at(error.problem_mark or error.context_mark)
            if "nesting" in reason and error.problem_mark is not None:
                # The parser looks ahead: what stands before tells where it becomes too deep.
                return _Composer(self.document).run(text[: error.problem_mark.index])
            line = self.document.lines[place.line - 1]
            if "\t" in line[: len(line) - len(line.lstrip())]:
                hint = "indent with blanks only: YAML forbids tabs there"
                self.document.complain(place, "", "the line is indented with a tab", hint)
                return self.root
            self.document.complain(
                place, "", f"not valid YAML: {reason}", self._mended(place, reason, error.context or "")
            )
        except yaml.YAMLError as error:
            self.document.complain(self._at(None), "", f"not valid YAML: {error}")
        return self.root

    def _at(self, mark: Any) -> Location:
        lines = self.document.lines
        line, column = (mark.line + 1, mark.column + 1) if mark else (1, 1)
        if line > len(lines):  # the parser counts the end of the text as a line of its own
            line, column = len(lines), len(lines[-1]) + 1
        return Location(self.document.name, line, column)

    def _mended(self, place: Location, reason: str, context: str) -> str:
        """Return a hint if the indentation of a line is likely to be what makes the text no YAML."""
        line = self.document.lines[place.line - 1]
        indent = len(line) - len(line.lstrip())
        if "flow" in context:
            return "a bracket [ or { that is open here lacks a comma, a colon or its end"
        if "could not find expected ':'" in reason:
            above = next((x.strip() for x in reversed(self.document.lines[: place.line - 1]) if x.strip()), "")
            return f"a colon is missing above, as in key: value; the line before is {above!r}"
        if "mapping values are not allowed" in reason:
            return "indent a key as the keys beside it, and put a text with ': ' in quotes"
        if place.column == indent + 1:
            return f"the line is indented by {counted(indent, 'blank')}: keys that belong together start in one column"
        return ""

    def _node(self, event: yaml.NodeEvent) -> None:
        location = self._at(event.start_mark)
        if isinstance(event, yaml.AliasEvent):
            hint = "start an expression with a number, a name or a parenthesis"
            self.document.complain(location, "", "aliases (*name) are not allowed in a model file", hint)
            self._place(Scalar("0", location))
            return
        if event.anchor is not None:
            self.document.complain(location, "", "anchors (&name) are not allowed in a model file")
        if isinstance(event, yaml.ScalarEvent | yaml.CollectionStartEvent) and event.tag is not None:
            self.document.complain(location, "", f"tags ({event.tag}) are not allowed in a model file")
        if isinstance(event, yaml.ScalarEvent):
            for _, character in _invisible(event.value):  # an escape in quotes
                self.document.complain(location, "", f"the text holds the invisible character U+{ord(character):04X}")
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
            self.root = node
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
                first = parent.keys[node.text].location.line
                message = f"the key {node.text!r} is repeated; it first stands in line {first}"
                self.document.complain(node.location, "", message)
            self.stack[-1] = (parent, node)
        else:
            parent.entries.setdefault(key.text, node)
            parent.keys.setdefault(key.text, key)
            self.stack[-1] = (parent, None)
