"""Numbers of a model that are exactly known: an expression of the file, or decimals; and exponents made of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from fractions import Fraction
from typing import Any, NamedTuple, TypeVar

from mbstab.model.arithmetic import Arithmetic
from mbstab.model.expressions import MAX_EXPONENT, Binary, Call, Expression, ExpressionError, Negative, Node, Number
from mbstab.model.schema import Model, Parameter
from mbstab.model.units import exact_factor, parse_unit

E = TypeVar("E", bound=Expression)

MOST = 10**15
"""Numerators and denominators up to it are exact in floats."""


def _power(base: Fraction, exponent: Fraction) -> Fraction:
    if exponent.denominator != 1 or abs(exponent) > MAX_EXPONENT:
        raise ValueError("the power is not a short fraction")
    return base ** int(exponent)


FRACTIONS = Arithmetic(
    "fraction",
    Fraction,
    {},
    {"abs": abs, "held": lambda x: min(max(x, Fraction(0)), Fraction(1)), "power": _power},
)
"""The arithmetic of functions that are composed of polynomials."""


class Meaning(NamedTuple):
    """What a number of a scene is exactly: an expression or decimals, in a unit."""

    content: Expression | Fraction
    unit: str = ""


def meaning(
    value: Any, expression: Expression, parameters: Mapping[str, Any], f: Arithmetic, parameter: Parameter | None = None
) -> Meaning | None:
    """Return what a number is exactly: its expression in the file or in a setting, if that has its value, or decimals.

    None is returned of numbers that vary over the points of a sweep, or are only known to lie in an interval.

    Parameters
    ----------
    value : number
        In SI.
    expression : Expression
        What the file says.
    parameters : mapping
        Values of all parameters (SI) in the number system `f`.
    parameter : Parameter, optional
        The one whose number it is.
    """
    plain, unit, factor = f.name in ("float", "array"), "", 1.0
    if parameter is None:
        if same_number(expression.evaluate(parameters, f), value):
            return Meaning(expression)
    else:
        unit, factor = parameter.unit, parameter.factor
        for source, own, size in _sources(parameter):
            # Exactly as the scene was built: in balls, even a factor of 1 has an effect.
            times = size if plain or size == 1.0 else exact_factor(own, f)
            if same_number(source.evaluate(parameters, f) * times, value):
                return Meaning(source, own if size != 1.0 else "")
    if plain and factor != 1.0 and not getattr(value, "ndim", 0):
        in_unit = f"{float(value) / factor:.12g}"
        if float(in_unit) * factor == value:
            return Meaning(Fraction(in_unit), unit)
    decimals = _decimals(value, f)
    return None if decimals is None else Meaning(decimals)


def _sources(parameter: Parameter) -> list[tuple[Expression, str, float]]:
    """Return what the file and a setting say about a parameter, each with its unit and the factor to SI."""
    found: list[tuple[Expression, str, float]] = [(parameter.expression, parameter.unit, parameter.factor)]
    if parameter.given is not None and len(parameter.given.ends) == 1:
        ((setting, unit),) = parameter.given.ends
        # An expression of other parameters counts their values in the file.
        if not setting.names():
            found.append((setting, unit or "", parse_unit(unit)[0] if unit else 1.0))
    return found


class Rationals:
    """The parameters of a scene that are rational numbers.

    Parameters
    ----------
    model : Model
    parameters : mapping
        Value of every parameter (SI).
    arithmetic : Arithmetic
        Their number system.
    """

    def __init__(self, model: Model, parameters: Mapping[str, Any], arithmetic: Arithmetic) -> None:
        self._model, self._parameters, self._arithmetic = model, parameters, arithmetic
        self._known: dict[str, Fraction | None] = {}

    def settled(self, expression: E) -> E:
        """Return an expression in which exponents made of parameters are written as fractions, if they are such.

        The rounding of 2*h, with h = 1/2, would leave open whether x**(2*h) has a derivative at x = 0.
        """
        root = self._put(expression.root)
        return expression if root is expression.root else replace(expression, root=root)

    def _put(self, node: Node) -> Node:
        if not node.named_exponents:
            return node
        match node:
            case Binary():
                left, right = self._put(node.left), self._put(node.right)
                if node.operator == "**" and (n := self._value(node.right)) is not None:
                    right = _written(n, node.right.position)
                return replace(node, left=left, right=right)
            case Negative():
                return replace(node, operand=self._put(node.operand))
            case Call():
                return replace(node, arguments=tuple(map(self._put, node.arguments)))
            case _:
                return node

    def _value(self, node: Node) -> Fraction | None:
        """Return the value of a part of an expression, if it is a fraction of two short numbers."""
        names = {name: self._parameter(name) for name in node.used[0]}
        if node.used[1] or any(value is None for value in names.values()):
            return None
        try:
            found: Fraction = Expression("", node).evaluate(names, FRACTIONS)
        except (ExpressionError, AttributeError, KeyError):
            return None
        return None if max(abs(found.numerator), found.denominator) > MOST else found

    def _parameter(self, name: str) -> Fraction | None:
        if name not in self._known:
            self._known[name] = self._found(name) if name in self._parameters else None
        return self._known[name]

    def _found(self, name: str) -> Fraction | None:
        parameter = self._model.parameters[name]
        known = meaning(self._parameters[name], parameter.expression, self._parameters, self._arithmetic, parameter)
        if known is None:
            return None
        value = known.content if isinstance(known.content, Fraction) else self._value(known.content.root)
        try:
            return value * exact_factor(known.unit, FRACTIONS) if value is not None and known.unit else value
        except KeyError:  # a unit that contains pi
            return None


def _written(x: Fraction, position: int) -> Node:
    """Return a fraction as part of an expression."""
    above: Node = Number(str(abs(x.numerator)), position)
    if x.denominator != 1:
        above = Binary("/", above, Number(str(x.denominator), position), position)
    return Negative(above, position) if x < 0 else above


def same_number(a: Any, b: Any) -> bool:
    """Return whether two numbers of a number system are the same."""
    if hasattr(a, "shape") or hasattr(b, "shape"):
        import numpy as np

        return bool(np.array_equal(a, b))
    if hasattr(a, "rad") and hasattr(b, "rad"):
        return bool(a.mid() == b.mid() and a.rad() == b.rad())
    try:
        return bool(a == b)
    except TypeError:
        return False


def _decimals(value: Any, f: Arithmetic) -> Fraction | None:
    """Return the printed decimals of a number, if they are exactly its value; None for others."""
    if getattr(value, "ndim", 0):
        value = value.flat[0] if (value == value.flat[0]).all() else None
    if value is None or f.name == "symbol":
        return None
    try:
        text = repr(float(value))
        same = f.name in ("float", "array") or same_number(f.number(text), value)
        return Fraction(text) if same else None
    except (TypeError, ValueError, OverflowError):
        return None
