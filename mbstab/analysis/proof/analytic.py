"""Whether all expressions of a model file are analytic functions of its parameters over their intervals.

What is proven about the elements at one value of a parameter holds for all values only if the
expressions are analytic in between: beyond a kink of ``abs``, a joint of ``smooth_start``, a pole or
the end of a domain, another function may begin.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from fractions import Fraction
from typing import Any

from mbstab.analysis.algebra.balls import NotProvable
from mbstab.model.balls import Ball as BallType
from mbstab.model.balls import at_part, ball, ball_arithmetic
from mbstab.model.dependencies import expressions_in
from mbstab.model.expressions import OPERATIONS, Binary, Call, Expression, Name, Negative, Node, Number, Rate
from mbstab.model.functions import CALLED, PIECED, Break
from mbstab.model.parameters import evaluate_parameters
from mbstab.model.schema import Model

Known = BallType | None
"""The enclosure of a value; None: it depends on the motion."""

HALF = Fraction(1, 2)


def require_analytic(model: Model, overrides: Mapping[str, BallType]) -> None:
    """Refuse intervals of parameters over which an expression of a model is not one analytic function of them.

    Raises
    ------
    NotProvable
        Names the expression.
    """
    wide = {name for name, x in overrides.items() if at_part(x, HALF) is not x}
    if not wide:
        return
    values = evaluate_parameters(model, overrides, ball_arithmetic())
    for name, parameter in model.parameters.items():
        if name not in overrides and parameter.given is None and wide & set(parameter.expression.names()):
            wide.add(name)
    for expression in _expressions(model, overrides):
        if wide & set(expression.names()):
            _Reader(expression, values, wide).value(expression.root)


def _expressions(model: Model, overrides: Mapping[str, BallType]) -> Iterator[Expression]:
    """Yield the expressions of parameters, bodies, elements and the reference."""
    yield from (x.expression for name, x in model.parameters.items() if name not in overrides and x.given is None)
    entries = [*model.bodies.values(), *(entry for group in model.entries.values() for entry in group.values())]
    reference = model.reference
    asked = [
        reference.coordinates,
        reference.rates,
        reference.guess,
        reference.guess_rates,
        reference.time,
        reference.period,
    ]
    yield from expressions_in([model.gravity, [entry.values for entry in entries], asked, reference.steady])


class _Reader:
    """Evaluates an expression over intervals of parameters, and refuses what is not analytic in them."""

    def __init__(self, expression: Expression, values: Mapping[str, BallType], wide: set[str]) -> None:
        self.expression, self.values, self.wide, self.f = expression, values, wide, ball_arithmetic()

    def value(self, node: Node) -> Known:
        """Return the enclosure of a node."""
        match node:
            case Name() if node.name in self.values:
                return self.values[node.name]
            case Name() if node.name in self.f.constants:
                return ball(self.f.constants[node.name])
            case Name() | Rate():
                return None
            case Negative():
                inner = self.value(node.operand)
                return None if inner is None else -inner
            case Binary():
                return self._operation(node)
            case Call():
                return self._function(node)
            case Number():
                return ball(self.f.number(node.text))

    def _varies(self, node: Node) -> bool:
        return bool(self.wide & set(Expression("", node).names()))

    def _refuse(self, what: str) -> NotProvable:
        return NotProvable(f"{self.expression.text!r} is not analytic there: {what}")

    def _operation(self, node: Binary) -> Known:
        left, right = self.value(node.left), self.value(node.right)
        if node.operator == "/" and self._varies(node.right) and right is not None and not (right > 0 or right < 0):
            raise self._refuse("a divisor may be zero")
        if node.operator == "**" and (self._varies(node.left) or self._varies(node.right)) and left is not None:
            whole = isinstance(node.right, Number) and node.right.text.isdigit()
            if not whole and not left > 0:
                raise self._refuse("the base of a power may be zero or negative")
        if left is None or right is None:
            return None
        return self._evaluated(lambda: OPERATIONS[node.operator](left, right, self.f))

    def _function(self, node: Call) -> Known:
        found = [self.value(argument) for argument in node.arguments]
        if any(self._varies(argument) for argument in node.arguments):
            if any(x is None for x in found):
                if node.function in PIECED:
                    raise self._refuse(f"{node.function} has pieces")
            elif not all(self._avoided(where, found) for where in CALLED[node.function].breaks_at(len(found))):
                raise self._refuse(f"{node.function} has no single analytic piece")
        if any(x is None for x in found):
            return None
        return self._evaluated(lambda: getattr(self.f, node.function)(*found))

    def _avoided(self, where: Break, arguments: list[Any]) -> bool:
        """Return whether the arguments avoid a break everywhere."""
        if where.unless is not None and where.unless(self.f, *arguments) > 0:
            return True
        return any(x > 0 or x < 0 for x in where.where(self.f, *arguments))

    def _evaluated(self, function: Callable[[], Any]) -> BallType:
        try:
            result = ball(function())
        except (ArithmeticError, ValueError) as error:
            raise self._refuse(str(error) or "it has no value") from None
        if not result.is_finite():
            raise self._refuse("it has no finite enclosure")
        return result
