"""The section ``tables``: functions given by points, in the file or in a CSV file beside it."""

from __future__ import annotations

import itertools
import re
from decimal import Decimal

from mbstab.errors import Location, UsageError, suggestion
from mbstab.model.nodes import NodeReader
from mbstab.model.schema import TABLE_FIELDS, TableValue
from mbstab.model.sections.parameters import RESERVED
from mbstab.model.yamlfile import Mapping, Scalar, Sequence, YamlNode, read_beside

NUMBER = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]{1,2})?")
MAX_POINTS = 1000

Column = list[tuple[str, Location]]
"""Texts of numbers with their places."""


class TableReader:
    """Reads the tables."""

    def __init__(self, nodes: NodeReader) -> None:
        self.nodes = nodes

    def read(self, node: YamlNode | None) -> dict[str, TableValue]:
        """Return the tables by name; one with a problem is a line."""
        section = self.nodes.optional(node, "tables")
        found = {}
        for key, item in section.pairs() if section else ():
            path = f"tables.{key.text}"
            if self.nodes.check_name(key, path, "table", RESERVED):
                found[key.text] = self._table(key, item, path) or TableValue(
                    (Decimal(-1), Decimal(1)), (Decimal(0), Decimal(0)), key.location
                )
        return found

    def _table(self, key: Scalar, node: YamlNode, path: str) -> TableValue | None:
        mapping = self.nodes.mapping(node, path, "{x: [...], y: [...]} or {file: name.csv, x: column, y: column}")
        if mapping is None:
            return None
        self.nodes.known_keys(mapping, path, TABLE_FIELDS)
        columns = self._from_file(mapping, path) if "file" in mapping.entries else self._from_lists(mapping, path)
        if columns is None:
            return None
        x, y = columns
        if len(x) != len(y):
            message = f"{len(x)} values of x and {len(y)} of y"
            self.nodes.complain((y if len(y) > len(x) else x)[min(len(x), len(y))][1], path, message)
            return None
        numbers = [self._numbers(column, path) for column in (x, y)]
        if not all(numbers) or not self._increases(x, path):
            return None
        if not 2 <= len(x) <= MAX_POINTS:
            self.nodes.complain(mapping, path, f"a table has 2 to {MAX_POINTS} points, this one has {len(x)}")
            return None
        return TableValue(tuple(numbers[0]), tuple(numbers[1]), key.location)

    def _numbers(self, column: Column, path: str) -> list[Decimal]:
        """Return the numbers of a column; none if there is a problem."""
        for text, place in column:
            if not NUMBER.fullmatch(text):
                self.nodes.complain(place, path, f"{text!r} is not a number", "tables hold plain numbers, in SI units")
                return []
        return [Decimal(text) for text, _ in column]

    def _increases(self, column: Column, path: str) -> bool:
        for (before, _), (text, place) in itertools.pairwise(column):
            if Decimal(text) <= Decimal(before):
                self.nodes.complain(
                    place, path, f"x must increase: {text} comes after {before}", "sort the points by x"
                )
                return False
        return True

    def _from_lists(self, mapping: Mapping, path: str) -> tuple[Column, Column] | None:
        columns = []
        for key in ("x", "y"):
            node = self.nodes.required(mapping, key, path, TABLE_FIELDS[key])
            if node is None:
                return None
            if not isinstance(node, Sequence) or not all(isinstance(item, Scalar) for item in node.items):
                self.nodes.complain(node, f"{path}.{key}", "expected a list of numbers")
                return None
            columns.append([(item.text.strip(), item.location) for item in node.items if isinstance(item, Scalar)])
        if not all(columns):
            self.nodes.complain(mapping, path, f"a table has 2 to {MAX_POINTS} points, this one has none")
            return None
        return columns[0], columns[1]

    def _from_file(self, mapping: Mapping, path: str) -> tuple[Column, Column] | None:
        node = mapping.entries["file"]
        name = self.nodes.word(node, f"{path}.file", "the name of a CSV file")
        if name is None:
            return None
        try:
            text = read_beside(self.nodes.document, name)
        except UsageError as error:
            self.nodes.complain(node, f"{path}.file", str(error))
            return None
        rows = [
            (i, [(part.group().strip(), part.start() + 1) for part in re.finditer(r"[^,;\t]+", line)])
            for i, line in enumerate(text.splitlines(), 1)
            if line.strip() and not line.lstrip().startswith("#")
        ]
        if not rows:
            self.nodes.complain(node, f"{path}.file", f"{name} is empty")
            return None
        header = [word for word, _ in rows[0][1]]
        chosen = []
        for number, key in enumerate(("x", "y")):
            given = mapping.entries.get(key)
            word = self.nodes.word(given, f"{path}.{key}", "the name of a column") if given is not None else None
            if given is not None and word is not None and word not in header:
                hint = suggestion(word, header) or "columns: " + ", ".join(header)
                self.nodes.complain(given, f"{path}.{key}", f"{name} has no column {word!r} in its first line", hint)
                return None
            chosen.append(number if word is None else header.index(word))
        body = rows if all(NUMBER.fullmatch(word) for word in header) else rows[1:]
        columns: tuple[Column, Column] = ([], [])
        for line, parts in body:
            for column, number in zip(columns, chosen, strict=True):
                if number >= len(parts):
                    message = f"this line has {len(parts)} columns, number {number + 1} is asked for"
                    self.nodes.complain(Location(name, line, 1), path, message)
                    return None
                word, at = parts[number]
                column.append((word, Location(name, line, at)))
        if not columns[0]:
            self.nodes.complain(node, f"{path}.file", f"{name} has no numbers")
            return None
        return columns
