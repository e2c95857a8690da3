"""The section ``parameters``: named numbers with units and signs, in an order in which they can be evaluated."""

from __future__ import annotations

import re

from mbstab.mechanics.catalogue import Sign
from mbstab.model import units
from mbstab.model.arithmetic import CONSTANTS
from mbstab.model.expressions import ExpressionError, parse
from mbstab.model.fields.base import Reading
from mbstab.model.fields.catalogue import kind_of, read_keys
from mbstab.model.functions import CALLED
from mbstab.model.keys import SECTIONS
from mbstab.model.names import in_order
from mbstab.model.quantities import QuantityReader
from mbstab.model.schema import Parameter, Quantity, constant
from mbstab.model.turns import count, counted_by
from mbstab.model.yamlfile import Mapping, Scalar, YamlNode
from mbstab.records import dataclass

RESERVED = ("t", "rate", *CALLED, *CONSTANTS)
"""Names that expressions use for something else."""
_WITH_UNIT = re.compile(r"([-+]?[0-9.]+(?:[eE][-+]?[0-9]+)?)\s*([A-Za-z°].*)")


@dataclass(frozen=True)
class _Written:
    """A parameter whose value has not been read yet."""

    value: Scalar
    unit: str = ""
    description: str = ""
    sign: Sign = "any"


class ParameterReader:
    """Reads the parameters and fills in their names."""

    def __init__(self, quantities: QuantityReader) -> None:
        self.quantities = quantities
        self.nodes, self.names = quantities.nodes, quantities.names

    def read(self, node: YamlNode | None) -> None:
        """Read the section; the parameters are then known to every expression."""
        section = self.nodes.optional(node, "parameters")
        written: dict[str, _Written] = {}
        for key, item in section.pairs() if section else ():
            path = f"parameters.{key.text}"
            if self.nodes.check_name(key, path, "parameter", reserved=(*RESERVED, *self.names.tables)):
                written[key.text] = self._written(item, path)
        # The names first: a value may use any of them.
        self.names.parameters = {
            name: Parameter(name, constant("1", item.value.location, f"parameters.{name}"), item.value.location)
            for name, item in written.items()
        }
        read = {name: self._parameter(name, written[name]) for name in self._order(written)}
        self.names.parameters = read

    def _written(self, node: YamlNode, path: str) -> _Written:
        keys = SECTIONS["parameters"].keys
        if isinstance(node, Mapping):
            found = read_keys(self.quantities, node, path, keys).values
        else:
            alone = Reading(self.quantities, Mapping({}, {}, node.location), path)
            found = {"value": kind_of(keys[0]).read(alone, keys[0], node, path)}
        value = found["value"] or Scalar("1", node.location)
        return _Written(value, found.get("unit", ""), found.get("description", ""), found.get("sign") or "any")

    def _order(self, written: dict[str, _Written]) -> list[str]:
        """Return the parameters so that each comes after those it needs; circles are refused."""
        needs: dict[str, list[str]] = {}
        for name, item in written.items():
            try:
                needs[name] = [other for other in parse(item.value.text).names() if other in written]
            except ExpressionError:  # refused when the value is read
                needs[name] = []
        order, circles = in_order(needs)
        for circle in circles:
            message = "parameters depend on each other in a circle: " + " → ".join(circle)
            self.nodes.complain(written[circle[0]].value, f"parameters.{circle[0]}", message)
        return order

    def _parameter(self, name: str, written: _Written) -> Parameter:
        value, unit = written.value, written.unit
        factor = units.parse_unit(unit)[0] if unit else 1.0
        path = f"parameters.{name}"
        apart = _WITH_UNIT.fullmatch(value.text.strip())
        if apart is not None and (own := units.meant(apart.group(2))):
            hint = f"write {{value: {apart.group(1)}, unit: {own}}}"
            self.nodes.complain(value, path, f"{value.text!r}: a number and its unit stand apart", hint)
            expression = constant("1", value.location, path)
        else:
            expression = self.quantities.expression(value, path)
        self.names.counted[name] = counted_by(unit) if unit else count(expression, self.names.counted)
        if unit:
            self.names.units[name] = units.parse_unit(unit)[1]
            if not expression.literal:
                self._check_derived(value, expression, unit, factor)
                factor = 1.0
        else:
            found = units.dimension_of(expression, self.names.units)
            # A bare number may be meant in any unit.
            self.names.units[name] = units.UNKNOWN if isinstance(found, str) else found
        return Parameter(name, expression, value.location, unit, factor, written.description, written.sign)

    def _check_derived(self, value: Scalar, expression: Quantity, unit: str, factor: float) -> None:
        """Check the declared unit of a parameter that is computed from others."""
        if factor != 1.0:
            hint = "expressions are computed in kg, m, s and rad; declare the unit in these"
            self.nodes.complain(value, expression.path, f"an expression cannot have the unit {unit}", hint)
            return
        try:
            self.quantities.check_unit(expression, unit)
        except ExpressionError as error:
            self.quantities.complain(value, expression.path, error)
