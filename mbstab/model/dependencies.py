"""The names in the expressions of a part of a model."""

from __future__ import annotations

import re
from collections.abc import Container, Iterator

from mbstab.errors import Location
from mbstab.model.expressions import Binary, Call, Expression, Name, Negative, Node, in_motion
from mbstab.model.schema import Model

_WORD = re.compile(r"[^\W\d][\w.]*")

PLAIN = frozenset((str, float, int, bool, type(None), Location))
"""What contains nothing."""


def names_in(value: object) -> set[str]:
    """Return the names in anything that a model is made of: parameters, coordinates, the time ``t``."""
    return {name for expression in expressions_in(value) for name in expression.names()}


def used_in(model: Model, parts: object) -> set[str]:
    """Return the names in parts of a model, and those behind its parameters among them."""
    found = names_in(parts)
    for parameter in reversed(list(model.parameters.values())):
        if parameter.name in found:
            found |= names_in(parameter.expression)
    return found


def unused_texts(model: Model) -> list[str]:
    """Return the tables and definitions that nothing else in a file uses, such as ``definition 'lift'``."""
    signals = [entry.values for entry in model.inputs.values()]
    besides = [model.parameters, signals, model.outputs, model.reference, model.initial, model.sweep, model.expect]
    used, left = set[str](), expressions_in([equations_of(model), besides])
    while left:
        words = set(_WORD.findall(left.pop().text)) - used
        used |= words
        left += [x for name, x in model.definitions.items() if name in words]
    named = [("table", name) for name in model.tables] + [("definition", name) for name in model.definitions]
    return [f"{what} {name!r}" for what, name in named if name not in used]


def equations_of(model: Model) -> list[object]:
    """Return the parts of a model that give the equations of motion."""
    entries = [*model.bodies.values(), *(entry for group in model.entries.values() for entry in group.values())]
    return [model.gravity, [entry.values for entry in entries]]


def expressions_in(value: object) -> list[Expression]:
    """Return the expressions in anything that a model is made of."""
    found, left = list[Expression](), [value]
    while left:
        x = left.pop()
        if x.__class__ in PLAIN:
            continue
        if isinstance(x, Expression):
            found.append(x)
        elif isinstance(x, dict):
            left += reversed(x.values())
        elif isinstance(x, (tuple, list)):
            left += reversed(x)
        elif names := getattr(x, "__dataclass_fields__", None):
            left += [getattr(x, name) for name in reversed(names)]
    return found


def uneven(expression: Expression, coordinates: Container[str]) -> bool:
    """Whether an expression may be the same for a while, or along a way, and then change.

    It may if it is not of the first degree in the time ``t``, or contains a quotient or a function of the motion, such
    as a table, that may be flat and then have a bump.
    """
    return _degree(expression.root) > 1 or next(flat_somewhere(expression, coordinates), None) is not None


def flat_somewhere(expression: Expression, coordinates: Container[str]) -> Iterator[Node]:
    """Yield the quotients and the functions of the motion in an expression that may be flat and then have a bump."""
    for node in expression.walk():
        if isinstance(node, Call):
            if node.function not in _NEVER_FLAT and in_motion(node, coordinates):
                yield node
        elif isinstance(node, Binary) and node.operator == "/" and in_motion(node.right, coordinates):
            yield node


_NEVER_FLAT = ("sin", "cos", "tan", "asin", "acos", "atan", "sqrt", "log")
"""Functions that change wherever their argument does."""


def _degree(node: Node) -> int:
    """Return the degree in t: 0, 1, or 2 for everything else."""
    match node:
        case Name():
            return int(node.name == "t")
        case Negative():
            return _degree(node.operand)
        case Call():
            return 2 if any(map(_degree, node.arguments)) else 0
        case Binary():
            left, right = _degree(node.left), _degree(node.right)
            if node.operator in "+-":
                return max(left, right)
            if node.operator == "*":
                return min(left + right, 2)
            return left if not right and (node.operator == "/" or not left) else 2
        case _:
            return 0
