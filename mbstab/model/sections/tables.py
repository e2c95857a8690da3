"""The section ``tables``: functions given by points, in the file or in a CSV file beside it."""

from __future__ import annotations

from dataclasses import replace
from decimal import Decimal

from mbstab.errors import alternatives
from mbstab.model.columns import MAX_POINTS, Column, read_csv, table_of
from mbstab.model.keys import TABLE
from mbstab.model.nodes import NodeReader, decimal_commas
from mbstab.model.schema import TableValue
from mbstab.model.sections.parameters import RESERVED
from mbstab.model.yamlfile import Mapping, Scalar, Sequence, YamlNode


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
                table = self._table(item, path) or TableValue(
                    (Decimal(-1), Decimal(1)), (Decimal(0), Decimal(0)), key.location
                )
                file = item.entries.get("file") if isinstance(item, Mapping) else None
                name = file.text.strip() if isinstance(file, Scalar) else ""
                found[key.text] = replace(table, location=key.location, file=name)
        return found

    def _table(self, node: YamlNode, path: str) -> TableValue | None:
        mapping = self.nodes.mapping(node, path, "{x: [...], y: [...]} or {file: name.csv, x: column, y: column}")
        if mapping is None:
            return None
        self.nodes.known_keys(mapping, path, [field.name for field in TABLE])
        columns = self._from_file(mapping, path) if "file" in mapping.entries else self._from_lists(mapping, path)
        if columns is None:
            return None
        x, y = columns
        if len(x) != len(y):
            message = f"{len(x)} values of x and {len(y)} of y"
            longer = mapping.entries.get("y" if len(y) > len(x) else "x")
            hint = decimal_commas(longer, min(len(x), len(y))) if isinstance(longer, Sequence) else ""
            self.nodes.complain((y if len(y) > len(x) else x)[min(len(x), len(y))][1], path, message, hint)
            return None
        return table_of(self.nodes, x, y, mapping, path)

    def _from_lists(self, mapping: Mapping, path: str) -> tuple[Column, Column] | None:
        columns = []
        for field in TABLE[:2]:
            key = field.name
            node = self.nodes.required(mapping, key, path, field.doc)
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
        csv = read_csv(self.nodes, mapping.entries["file"], f"{path}.file")
        if csv is None:
            return None
        chosen = []
        for number, key in enumerate(("x", "y")):
            given = mapping.entries.get(key)
            word = self.nodes.word(given, f"{path}.{key}", "the name of a column") if given is not None else None
            if given is None or word is None:
                chosen.append(number)
                continue
            if (found := csv.header.count(word)) != 1:
                hint = "" if found else alternatives(word, csv.header, "columns")
                message = f"{csv.name} has {'two columns' if found else 'no column'} {word!r} in its first line"
                self.nodes.complain(given, f"{path}.{key}", message, hint)
                return None
            chosen.append(csv.header.index(word))
        if max(chosen) >= len(csv.header):
            self.nodes.complain(mapping.entries["file"], f"{path}.file", f"{csv.name} has only one column")
            return None
        return csv.columns[chosen[0]], csv.columns[chosen[1]]
