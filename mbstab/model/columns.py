"""Columns of numbers, in a model file or in a CSV file beside it, and the tables they make."""

from __future__ import annotations

import itertools
import re
from decimal import Decimal

from mbstab.errors import Location, UsageError
from mbstab.model.nodes import NodeReader
from mbstab.model.schema import TableValue
from mbstab.model.yamlfile import YamlNode, read_beside
from mbstab.records import dataclass

NUMBER = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]{1,2})?")
MAX_POINTS = 1000

Column = list[tuple[str, Location]]
"""Texts of numbers with their places."""


@dataclass(frozen=True)
class CsvFile:
    """A CSV file: the words of its first line, and the lines with numbers, each with its words and their columns."""

    name: str
    header: list[str]
    lines: list[tuple[int, list[tuple[str, int]]]]

    def column(self, nodes: NodeReader, number: int, path: str) -> Column | None:
        """Return a column, None if it is not as long as the others."""
        found: Column = []
        for line, parts in self.lines:
            if number >= len(parts):
                message = f"this line has {len(parts)} values, and the heading {len(self.header)} names"
                nodes.complain(Location(self.name, line, 1), path, message)
                return None
            word, at = parts[number]
            found.append((word, Location(self.name, line, at)))
        return found


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
    rows = [
        (i, [(part.group().strip(), part.start() + 1) for part in re.finditer(r"[^,;\t]+", line)])
        for i, line in enumerate(text.splitlines(), 1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if not rows:
        nodes.complain(node, path, f"{name} is empty")
        return None
    header = [word for word, _ in rows[0][1]]
    lines = rows if all(NUMBER.fullmatch(word) for word in header) else rows[1:]
    if not lines:
        nodes.complain(node, path, f"{name} has no numbers")
        return None
    return CsvFile(name, header, lines)


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
        if not NUMBER.fullmatch(text):
            nodes.complain(place, path, f"{text!r} is not a number", "tables hold plain numbers, in SI units")
            return []
    return [Decimal(text) for text, _ in column]


def _increases(nodes: NodeReader, column: Column, path: str) -> bool:
    for (before, _), (text, place) in itertools.pairwise(column):
        if Decimal(text) <= Decimal(before):
            nodes.complain(place, path, f"x must increase: {text} comes after {before}", "sort the points by x")
            return False
    return True
