"""Numbers of a file whose terms cancel, with more digits: whether one is negative, or is so by rounding alone."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from fractions import Fraction
from typing import Any

from mbstab.mechanics.catalogue import Number
from mbstab.model.arithmetic import Arithmetic
from mbstab.model.balls import ball_arithmetic, digits, digits_in_use, zero_inside
from mbstab.model.expressions import ExpressionError
from mbstab.model.rationals import Meaning, meaning
from mbstab.model.schema import Model, Quantity
from mbstab.model.units import exact_factor

MORE_DIGITS = 100
"""Digits beyond those of the arithmetic; a number of which none is left is zero."""

UNKNOWN = (ExpressionError, ArithmeticError, ValueError, TypeError, KeyError)
"""Errors of numbers that are not exactly known."""


def with_more_digits(
    value: Number, quantity: Quantity, model: Model, parameters: Mapping[str, Number], f: Arithmetic
) -> Number | None:
    """Return what a number is by the decimals of the file, as one of its arithmetic; None where that is not known.

    Parameters
    ----------
    value : number
        Its value (SI).
    quantity : Quantity
    model : Model
    parameters : mapping
        Values of all parameters (SI).
    f : Arithmetic
        Their number system: floats, or numbers with many digits.
    """
    if f.name not in ("float", "digits"):
        return None
    known, exact = _meanings(model, parameters, f), ball_arithmetic()
    with digits(MORE_DIGITS + (digits_in_use() if f.name == "digits" else 0)):
        try:
            found = quantity.evaluate({name: _value(name, known, exact) for name in quantity.names()}, exact)
        except UNKNOWN:
            return None
        zero = zero_inside(found)
    return f.number("0") if zero else float(found) if f.name == "float" else found


def exact_parameters(
    unsure: Iterable[str], model: Model, parameters: Mapping[str, float], f: Arithmetic
) -> dict[str, float]:
    """Return the values (SI) of parameters by the decimals of the file, of those for which they are known.

    Parameters
    ----------
    unsure : iterable of str
        Their names.
    model : Model
    parameters : mapping
        Values of all parameters, floats.
    f : Arithmetic
        Their number system.
    """
    known, found = _meanings(model, parameters, f), dict[str, float]()
    with digits(MORE_DIGITS):
        for name in unsure:
            try:
                value = _value(name, known, ball_arithmetic())
            except UNKNOWN:
                continue
            found[name] = 0.0 if zero_inside(value) else float(value)
    return found


def _meanings(model: Model, parameters: Mapping[str, Number], f: Arithmetic) -> dict[str, Meaning | None]:
    return {
        name: meaning(parameters[name], parameter.expression, parameters, f, parameter)
        for name, parameter in model.parameters.items()
    }


def _value(name: str, known: Mapping[str, Meaning | None], exact: Arithmetic) -> Any:
    """Return a parameter with all digits."""
    own = known[name]
    if own is None:
        raise ValueError(f"{name} is not exactly known")
    if isinstance(own.content, Fraction):
        value = exact.number(str(own.content.numerator)) / exact.number(str(own.content.denominator))
    else:
        value = own.content.evaluate({x: _value(x, known, exact) for x in own.content.names()}, exact)
    return value * exact_factor(own.unit, exact) if own.unit else value
