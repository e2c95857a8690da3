"""Columns of numbers, in a model file or in a CSV file beside it, and the tables they make."""

from __future__ import annotations

import itertools
import re
from decimal import Decimal

from mbstab.errors import Location, UsageError, counted
from mbstab.model.nodes import NodeReader
from mbstab.model.schema import TableValue
from mbstab.model.yamlfile import YamlNode, read_beside
from mbstab.records import dataclass

NUMBER = re.compile(r"[-+]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][-+]?[0-9]{1,2})?")
DECIMAL_COMMA = re.compile(NUMBER.pattern.replace(r"\.", "[.,]"))
SEPARATORS = ";\t,"
"""What may stand between the values of a file: the first of these that its first line has."""
MAX_POINTS = 1000
MAX_DIGITS = 100
"""Characters of a number of a table."""

Column = list[tuple[str, Location]]
"""Texts of numbers with their places."""


@dataclass(frozen=True)
class CsvFile:
    """A CSV file: the words of its first line, and its columns."""

    name: str
    header: list[str]
    columns: list[Column]


def read_csv(nodes: NodeReader, node: YamlNode, path: str) -> CsvFile | None:
    """Return the CSV file that a node names, None if there is a problem."""
    name = nodes.word(node, path, "the name of a CSV file")
    if name is None:
        return None
    try:
        text = read_beside(nodes.document, name)
    except UsageError as error:
        nodes.complain(node, path, str(error))
        return None
    rows = [(i, x) for i, x in enumerate(text.splitlines(), 1) if x.strip() and not x.lstrip().startswith("#")]
    if not rows:
        nodes.complain(node, path, f"{name} is empty")
        return None
    first = rows[0][1]
    separator = next((x for x in SEPARATORS if x in first), SEPARATORS[-1])
    header = [word.strip() for word in first.split(separator)]
    numbers = all(len(word) <= MAX_DIGITS and DECIMAL_COMMA.fullmatch(word) for word in header)
    lines = rows if numbers else rows[1:]
    if not lines:
        nodes.complain(node, path, f"{name} has no numbers")
        return None
    found = []
    for line, text in lines:
        words = _words(name, line, text, separator)
        if len(words) != len(header):
            whole = f"first line {len(header)}" if lines is rows else f"heading {counted(len(header), 'name')}"
            said = f"this line has {counted(len(words), 'value')}, and the {whole}"
            other = next((x for x in SEPARATORS if x in text and x not in first), "")
            hint = f"one separator for the whole file: the first line has {separator!r}, this one {other!r}"
            nodes.complain(Location(name, line, 1), path, said, hint if other else "")
            return None
        found.append(words)
    return CsvFile(name, header, list(map(list, zip(*found, strict=True))))


def _words(name: str, line: int, text: str, separator: str) -> Column:
    """Return the values of a line; what has none is an empty word at its place."""
    parts = re.finditer(rf"(?:^|{separator})([^{separator}]*)", text)
    return [
        (part[1].strip(), Location(name, line, part.start(1) + 1 + len(part[1]) - len(part[1].lstrip())))
        for part in parts
    ]


def table_of(nodes: NodeReader, x: Column, y: Column, node: YamlNode, path: str) -> TableValue | None:
    """Return a function given by points, None if they make none; `node` is where it is written."""
    numbers = [_numbers(nodes, column, path) for column in (x, y)]
    if not all(numbers) or not _increases(nodes, x, path):
        return None
    if not 2 <= len(x) <= MAX_POINTS:
        nodes.complain(node, path, f"a table has 2 to {MAX_POINTS} points, this one has {len(x)}")
        return None
    return TableValue(tuple(numbers[0]), tuple(numbers[1]), node.location)


def _numbers(nodes: NodeReader, column: Column, path: str) -> list[Decimal]:
    """Return the numbers of a column; none if there is a problem."""
    for text, place in column:
        if len(text) > MAX_DIGITS:
            said = f"a number of a table has at most {MAX_DIGITS} characters, this one has {len(text)}"
            nodes.complain(place, path, said)
            return []
        if not NUMBER.fullmatch(text):
            hint = "tables hold plain numbers, in SI units"
            if DECIMAL_COMMA.fullmatch(text):
                hint = f"decimals follow a point: {text.replace(',', '.')}"
            nodes.complain(place, path, f"{text!r} is not a number" if text else "a number is missing here", hint)
            return []
    return [Decimal(text) for text, _ in column]


def _increases(nodes: NodeReader, column: Column, path: str) -> bool:
    for (before, _), (text, place) in itertools.pairwise(column):
        if Decimal(text) <= Decimal(before):
            nodes.complain(place, path, f"x must increase: {text} comes after {before}", "sort the points by x")
            return False
    return True
