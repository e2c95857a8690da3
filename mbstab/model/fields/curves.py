"""Coefficients over a speed, in the columns of one CSV file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from mbstab.errors import alternatives
from mbstab.mechanics.catalogue import Field, Number
from mbstab.model.columns import CsvFile, read_csv, table_of
from mbstab.model.fields.base import FieldKind, Owner, Reading
from mbstab.model.fields.catalogue import object_schema, read_keys
from mbstab.model.keys import CURVES
from mbstab.model.schema import Quantity
from mbstab.model.yamlfile import Scalar, YamlNode

SPEEDS = {"rad/s": "({})", "rpm": "({})*30/pi"}
"""What may stand over the column of the speed, and a speed in SI as it is counted there."""


BEYOND = "the table is in the unit of its heading; a plain number or a parameter without a unit is in rad/s here"
"""What to look at where a speed is outside of a file."""


class SpeedCurvesField(FieldKind):
    """A CSV file with columns of values over a speed, each for one of the keys `Field.columns` of the entry.

    A key that is no column is given in the entry.
    """

    name = "speed curves"
    explained = "forces.curves"

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> dict[str, Quantity] | None:
        """Return an expression of the speed for each column, at the place of the speed, and the speed itself."""
        nodes = reading.nodes
        mapping = nodes.mapping(node, path, "{file: name.csv, speed: expression}")
        if mapping is None:
            return None
        given = read_keys(reading.quantities, mapping, path, CURVES).values
        speed, function = given["speed"], given["function"]
        if not given["file"] or speed is None or function is None:
            return None
        file = mapping.entries["file"]
        csv = read_csv(nodes, file, f"{path}.file")
        if csv is None or not self._fits(reading, field, file, csv):
            return None
        at, tables = SPEEDS[csv.header[0]].format(speed.text), self._tables(reading, file, f"{path}.file", csv)
        reading.names.tables.update(tables)
        texts = {name: f"{function}({at}, {name})" for name in tables}
        return {"speed": speed} | {
            name.rpartition(".")[2]: reading.quantities.expression(Scalar(text, speed.location), f"{path}.speed")
            for name, text in texts.items()
        }

    @staticmethod
    def _tables(reading: Reading, file: YamlNode, path: str, csv: CsvFile) -> dict[str, Any]:
        """Return the function of each column, by the name of the entry and of the column."""
        entry, found = reading.path.partition(".")[2], {}
        for column, y in zip(csv.header[1:], csv.columns[1:], strict=True):
            table = table_of(reading.nodes, csv.columns[0], y, file, path)
            if table is None:
                return {}
            found[f"{entry}.{column}"] = table
        return found

    @staticmethod
    def _fits(reading: Reading, field: Field, file: YamlNode, csv: CsvFile) -> bool:
        """Whether the columns are those that are needed; complain if not."""
        unit, *columns = csv.header
        given, wrong = reading.node.entries, []
        if unit not in SPEEDS:
            wrong.append((f"its first column is {unit!r}", "it is the speed, and its heading is rad/s or rpm"))
        for i, column in enumerate(columns):
            if column not in field.columns:
                hint = alternatives(column, field.columns, "columns")
                wrong.append((f"it has a column {column!r}", hint))
            elif column in columns[:i]:
                wrong.append((f"it has two columns {column!r}", ""))
            elif column in given:
                wrong.append((f"it has a column {column!r}, and the entry gives it too", "remove one of them"))
        for name in field.columns:
            if name not in columns and name not in given:
                wrong.append((f"it has no column {name!r}", f"give {name} in the entry, 0 if there is none"))
        for message, hint in wrong:
            reading.nodes.complain(file, f"{reading.path}.{field.name}", f"{csv.name}: {message}", hint)
        return not wrong

    def numbers(self, owner: Owner, field: Field, value: Mapping[str, Quantity]) -> dict[str, Number]:
        """Return the values at the speed; one that is outside of the file is a problem once, not in each column."""
        problems, found = owner.evaluator.document.problems, {}
        for name, quantity in value.items():
            if name not in field.columns:
                continue
            before = len(problems)
            found[name] = owner.evaluator.number(quantity, owner.entry.kind.field(name))
            if len(problems) > before:
                if "outside the table" in problems[-1].message:
                    problems[-1] = replace(problems[-1], hint=BEYOND)
                return dict.fromkeys(value, 1.0)
        return found

    def schema(self, field: Field) -> dict[str, Any]:
        """Return the schema of the mapping."""
        return object_schema(CURVES)
