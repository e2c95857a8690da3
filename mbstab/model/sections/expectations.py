"""The sections ``sweep`` and ``expect``: default ranges of parameters, and what the answers must be."""

from __future__ import annotations

import math

from mbstab.model.arithmetic import FLOAT
from mbstab.model.quantities import QuantityReader
from mbstab.model.schema import (
    CRITICAL_FIELDS,
    EIGENVALUE_FIELDS,
    EXPECT_FIELDS,
    SWEEP_FIELDS,
    CriticalValue,
    Expectation,
    ExpectedEigenvalue,
    Quantity,
    SweepRange,
    constant,
)
from mbstab.model.sections.reference import read_state
from mbstab.model.words import WORDS
from mbstab.model.yamlfile import Mapping, Scalar, Sequence, YamlNode


class ExpectationReader:
    """Reads ranges and expectations."""

    def __init__(self, quantities: QuantityReader) -> None:
        self.quantities = quantities
        self.nodes, self.names = quantities.nodes, quantities.names

    def sweep(self, node: YamlNode | None) -> dict[str, SweepRange]:
        """Return the default ranges by parameter."""
        mapping = self.nodes.optional(node, "sweep")
        ranges: dict[str, SweepRange] = {}
        for key, item in mapping.pairs() if mapping else ():
            path = f"sweep.{key.text}"
            self.names.check_parameter(key, path)
            inner = self.nodes.mapping(item, path, "{from: …, to: …, points: …}")
            if inner is None:
                continue
            self.nodes.known_keys(inner, path, SWEEP_FIELDS)
            ends = [(self.nodes.required(inner, key, path), f"{path}.{key}") for key in ("from", "to")]
            start, stop = (self._value(end or Scalar("1", inner.location), here) for end, here in ends)
            points = self.nodes.integer(inner.entries.get("points"), f"{path}.points", 2, 10_000_000, 401)
            ranges[key.text] = SweepRange(start, stop, points)
        return ranges

    def expect(self, node: YamlNode | None) -> tuple[Expectation, ...]:
        """Return the expectations."""
        if node is None or (isinstance(node, Scalar) and node.empty):
            return ()
        if not isinstance(node, Sequence):
            self.nodes.complain(node, "expect", "expected a list", "each item starts with a dash")
            return ()
        found = [self._expectation(item, f"expect[{i}]") for i, item in enumerate(node.items)]
        return tuple(expectation for expectation in found if expectation is not None)

    def _expectation(self, node: YamlNode, path: str) -> Expectation | None:
        nodes = self.nodes
        mapping = nodes.mapping(node, path)
        if mapping is None:
            return None
        nodes.known_keys(mapping, path, EXPECT_FIELDS)
        entries = mapping.entries
        frozen = "frozen" in entries and nodes.choice(entries["frozen"], f"{path}.frozen", ("true", "false")) == "true"
        found = Expectation(
            mapping.location,
            self.parameter_values(entries.get("at"), f"{path}.at"),
            self._eigenvalues(entries.get("eigenvalues"), f"{path}.eigenvalues"),
            self._tolerance(entries.get("tolerance"), f"{path}.tolerance", 1e-9),
            self._count(entries.get("neutral"), f"{path}.neutral"),
            frozen,
            read_state(self.quantities, entries.get("coordinates"), f"{path}.coordinates"),
            self._count(entries.get("redundant"), f"{path}.redundant"),
            self._verdict(entries.get("verdict"), f"{path}.verdict"),
            self._critical(entries.get("critical"), f"{path}.critical"),
            nodes.text(entries.get("source"), f"{path}.source"),
        )
        if not entries.keys() - {"at", "tolerance", "frozen", "source"} and not nodes.faulty(path):
            nodes.complain(mapping, path, "nothing is expected here", "mbstab schema expect shows the keys")
        return found

    def parameter_values(self, node: YamlNode | None, path: str) -> dict[str, Quantity]:
        """Return values of parameters by name."""
        mapping = self.nodes.optional(node, path)
        values = {}
        for key, item in mapping.pairs() if mapping else ():
            self.names.check_parameter(key, path)
            values[key.text] = self._value(item, f"{path}.{key.text}")
        return values

    def _value(self, node: YamlNode, path: str) -> Quantity:
        """Return the value of a parameter: in its unit if it is a number."""
        return self.quantities.quantity(node, path, shared=False) or constant("1", node.location, path)

    def _count(self, node: YamlNode | None, path: str) -> int | None:
        return None if node is None else self.nodes.integer(node, path, 0, 10_000, 0)

    def _tolerance(self, node: YamlNode | None, path: str, default: float) -> float:
        if node is None:
            return default
        expression = self.quantities.quantity(node, path)
        if expression is None:
            return default
        value = expression.evaluate({}, FLOAT) if expression.literal else math.nan
        if not 0.0 < value < 1.0:
            self.nodes.complain(node, path, "expected a number between 0 and 1")
            return default
        return float(value)

    def _verdict(self, node: YamlNode | None, path: str) -> str | None:
        return self.nodes.choice(node, path, WORDS) if node is not None else None

    def _eigenvalues(self, node: YamlNode | None, path: str) -> tuple[ExpectedEigenvalue, ...] | None:
        if node is None:
            return None
        if not isinstance(node, Sequence):
            self.nodes.complain(node, path, "expected a list of {real: …, imag: …}")
            return None
        found = [self._eigenvalue(item, f"{path}[{i}]") for i, item in enumerate(node.items)]
        return tuple(eigenvalue for eigenvalue in found if eigenvalue is not None)

    def _eigenvalue(self, node: YamlNode, path: str) -> ExpectedEigenvalue | None:
        mapping = self.nodes.mapping(node, path, "{real: …, imag: …}")
        if mapping is None:
            return None
        self.nodes.known_keys(mapping, path, EIGENVALUE_FIELDS)
        parts = (
            self.quantities.expression(mapping.entries.get(key, Scalar("0", mapping.location)), f"{path}.{key}")
            for key in EIGENVALUE_FIELDS
        )
        return ExpectedEigenvalue(*parts)

    def _critical(self, node: YamlNode | None, path: str) -> CriticalValue | None:
        mapping: Mapping | None = self.nodes.mapping(node, path) if node is not None else None
        if mapping is None:
            return None
        self.nodes.known_keys(mapping, path, CRITICAL_FIELDS)
        tolerance = self._tolerance(mapping.entries.get("tolerance"), f"{path}.tolerance", 1e-6)
        keys = ("parameter", "value", "below", "above")
        parameter_node, value_node, *verdict_nodes = (self.nodes.required(mapping, key, path) for key in keys)
        below, above = (self._verdict(x, f"{path}.{key}") for key, x in zip(keys[2:], verdict_nodes, strict=True))
        value = self.quantities.quantity(value_node, f"{path}.value") if value_node is not None else None
        parameter = None
        if parameter_node is not None:
            parameter = self.nodes.word(parameter_node, f"{path}.parameter", "the name of a parameter")
        if isinstance(parameter_node, Scalar) and parameter is not None:
            self.names.check_parameter(parameter_node, f"{path}.parameter")
        if parameter is None or value is None or below is None or above is None:
            return None
        return CriticalValue(parameter, value, tolerance, below, above, mapping.location)
