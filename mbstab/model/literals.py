"""Decimals of a model that may have been rounded when they were written, and the model with others in their place."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import fields, is_dataclass, replace
from decimal import Decimal
from typing import Any

from mbstab.errors import Location
from mbstab.mechanics.catalogue import Kind
from mbstab.model.expressions import Binary, Call, Expression, Name, Negative, Node, Number
from mbstab.model.functions import CALLED
from mbstab.model.schema import Given, Model, Parameter, constant

LEAST_DIGITS = 4
"""Numbers with a point and so many digits count as rounded: 0.7071 does, 0.5 and 9.81 do not."""

PHYSICAL = ("parameters", "gravity", "ground", "bodies", "entries", "measures")
"""What of a model determines the equations of motion."""


def rounded_literals(model: Model) -> dict[str, float]:
    """Return the decimals of the equations of a model that count as rounded, with the unit of their last digit.

    What is equal in the file stays equal: each text counts once. Exponents, points of tables and settings are left out.
    """
    found = dict[str, float]()

    def note(node: Number) -> Node:
        if "." in node.text:
            _, digits, exponent = Decimal(node.text).as_tuple()
            if len(digits) >= LEAST_DIGITS and isinstance(exponent, int) and any(digits):
                found[node.text] = 10.0**exponent
        return node

    def expression(x: Expression) -> Expression:
        _changed(x.root, note)
        return x

    for name in PHYSICAL:
        _mapped(getattr(model, name), expression)
    return found


def with_literals(model: Model, texts: Mapping[str, str]) -> Model:
    """Return a model with other texts in the place of some of its decimals."""
    return _with_nodes(model, {text: Number(new, 0) for text, new in texts.items()})


def named_literals(model: Model, texts: Iterable[str]) -> tuple[Model, list[str]]:
    """Return a model with parameters in the place of some of its decimals, and their names."""
    named, nodes, place = dict[str, Parameter](), dict[str, Node](), model.reference.location
    for k, text in enumerate(texts):
        name = f"decimal_{k}"
        while name in model.parameters:
            name += "_"
        named[name] = Parameter(name, constant(text, place, f"parameters.{name}"), place)
        nodes[text] = Name(name, 0)
    found = _with_nodes(model, nodes)
    return replace(found, parameters={**named, **found.parameters}), [*named]


def _with_nodes(model: Model, nodes: Mapping[str, Node]) -> Model:
    """Return a model with other nodes in the place of some decimals."""

    def expression(x: Expression) -> Expression:
        if not any(isinstance(node, Number) and node.text in nodes for node in x.walk()):
            return x
        return replace(x, root=_changed(x.root, lambda node: nodes.get(node.text, node)))

    names = [x.name for x in fields(model) if x.name != "document"]
    return replace(model, **{name: _mapped(getattr(model, name), expression) for name in names})


def _changed(node: Node, change: Callable[[Number], Node]) -> Node:
    """Return an expression with its decimals changed, but for exponents and the points of tables."""
    match node:
        case Number():
            return change(node)
        case Call():
            first = 1 if CALLED[node.function].knots >= 0 else len(node.arguments)
            changed = (_changed(part, change) for part in node.arguments[:first])
            return replace(node, arguments=(*changed, *node.arguments[first:]))
        case Binary():
            right = node.right if node.operator == "**" else _changed(node.right, change)
            return replace(node, left=_changed(node.left, change), right=right)
        case Negative():
            return replace(node, operand=_changed(node.operand, change))
    return node


def _mapped(x: Any, change: Callable[[Expression], Expression]) -> Any:
    """Return something of a model with other expressions; what does not change is the same object."""
    if isinstance(x, Expression):
        return change(x)
    if isinstance(x, dict):
        found = {key: _mapped(y, change) for key, y in x.items()}
        return found if any(found[key] is not y for key, y in x.items()) else x
    if isinstance(x, (tuple, list)):
        items = [_mapped(y, change) for y in x]
        return type(x)(items) if any(a is not b for a, b in zip(items, x, strict=True)) else x
    if is_dataclass(x) and not isinstance(x, (Kind, Location, Given, type)):
        parts = {y.name: _mapped(getattr(x, y.name), change) for y in fields(x)}
        changed = {name: y for name, y in parts.items() if y is not getattr(x, name)}
        return replace(x, **changed) if changed else x
    return x
