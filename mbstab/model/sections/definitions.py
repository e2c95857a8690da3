"""The section ``definitions``: named expressions that all others may use."""

from __future__ import annotations

from mbstab.model.expressions import ExpressionError, parse
from mbstab.model.names import in_order
from mbstab.model.quantities import QuantityReader
from mbstab.model.sections.parameters import RESERVED
from mbstab.model.yamlfile import Scalar, YamlNode


class DefinitionReader:
    """Reads the definitions and fills in their names."""

    def __init__(self, quantities: QuantityReader) -> None:
        self.quantities = quantities
        self.nodes, self.names = quantities.nodes, quantities.names
        self.written: dict[str, Scalar] = {}

    def find(self, node: YamlNode | None) -> None:
        """Read the expressions; what they contain is known later, and checked then."""
        section = self.nodes.optional(node, "definitions")
        taken = {"ground", *RESERVED, *self.names.parameters, *self.names.tables}
        for key, item in section.pairs() if section else ():
            path = f"definitions.{key.text}"
            if not self.nodes.check_name(key, path, "definition", taken):
                continue
            if not isinstance(item, Scalar) or item.empty:
                self.nodes.complain(item, path, "expected an expression")
                continue
            try:
                self.names.definitions[key.text] = parse(item.text)
                self.written[key.text] = item
            except ExpressionError as error:
                self.quantities.complain(item, path, error)
                self.names.definitions[key.text] = parse("1")
        needs = {
            name: [other for other in x.names() if other in self.names.definitions]
            for name, x in self.names.definitions.items()
        }
        order, circles = in_order(needs)
        for circle in circles:
            first, second = circle[:2]
            at = self.nodes.document.locate(self.written[first], self.names.definitions[first].names()[second])
            message = "definitions depend on each other in a circle: " + " → ".join(circle)
            self.nodes.complain(at, f"definitions.{first}", message, "let one of them be a state, with a rate")
        for circle in circles:
            self.names.definitions.update((name, parse("1")) for name in circle)
        self.written = {name: self.written[name] for name in order if name in self.written}

    def check(self) -> None:
        """Check what the definitions contain, once coordinates, states and joints are known."""
        for name, item in self.written.items():
            if self.quantities.quantity(item, f"definitions.{name}", time=True, state=True) is None:
                self.names.definitions[name] = parse("1")
