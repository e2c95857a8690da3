"""Values of parameters: those of the file, and those given for one question."""

from __future__ import annotations

import numbers
import re
from collections.abc import Callable, Container, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from decimal import Decimal, localcontext
from fractions import Fraction
from typing import Generic, TypeVar

from mbstab.errors import UsageError, listed, suggestion
from mbstab.mechanics.catalogue import Number
from mbstab.model.arithmetic import CONSTANTS, FLOAT, Arithmetic
from mbstab.model.expressions import MAX_NUMBER, Expression, ExpressionError, parse
from mbstab.model.numbers import broken_sign, require_finite
from mbstab.model.schema import (
    Given,
    Model,
    Parameter,
    after_number,
    parse_finite,
)
from mbstab.model.turns import counted_by, one_counts_turns
from mbstab.model.units import UNITS, as_name, exact_factor, parse_unit

T = TypeVar("T")


class Latest(Generic[T]):
    """Keeps what was made last of the settings of parameters; a copy keeps nothing."""

    def __init__(self) -> None:
        self._known: tuple[object, T] | None = None

    def __reduce__(self) -> tuple[type[Latest[T]], tuple[()]]:
        return Latest, ()

    def of(self, settings: Mapping[str, object], make: Callable[[], T]) -> T:
        """Return what was made of the same settings the last time, or make it."""
        # A number may be equal to one of another type, or with the other sign, that means something else.
        key = tuple((name, type(value), repr(value)) for name, value in settings.items())
        known = self._known
        if known is not None and known[0] == key:
            return known[1]
        made = make()
        if all(isinstance(value, (int, float, str, Fraction, Decimal)) for value in settings.values()):
            self._known = key, made
        return made


def bound(model: Model, settings: Mapping[str, object]) -> Model:
    """Return a model whose parameters have the values of settings such as ``{"omega": "2*pi"}``.

    A plain number is in the declared unit of the parameter, and one with a unit of its own, such as
    ``2 kg``, in that unit. An expression may use the other parameters' values in the file and is in
    SI. In a number system other than floats a text keeps all its digits, and a float stands for
    the decimals with which it is printed. An interval, ``[5.6, 10]``, has a value in balls only.

    Raises
    ------
    UsageError
        If a parameter is unknown or the value is not a finite number in a unit that fits.
    """
    if not settings:
        return model
    given = {
        name: replace(require_parameter(model, name), given=_given(model, name, x)) for name, x in settings.items()
    }
    found = replace(model, parameters={**model.parameters, **given})
    for name, parameter in given.items():
        if parameter.given is not None and len(parameter.given.ends) == 1:
            given_value(found, name, FLOAT)
    return found


def settings_in_si(values: Mapping[str, float]) -> dict[str, str]:
    """Return values in SI as settings for `bound`: as expressions they do not count in declared units."""
    return {name: f"1*({value!r})" for name, value in values.items()}


def require_parameter(model: Model, name: str) -> Parameter:
    """Return a parameter.

    Raises
    ------
    UsageError
        If there is none of this name.
    """
    if name not in model.parameters:
        if name in model.document.counts:
            raise UsageError(f"{name} is a count of {model.name}, not a parameter\nhint: use --set {name}=…")
        names = list(model.parameters)
        hint = f"{suggestion(name, names)} {listed('parameters', names)}".lstrip()
        raise UsageError(f"{model.name} has no parameter {name!r}\nhint: {hint}")
    return model.parameters[name]


_WITH_UNIT = re.compile(r"(?P<value>[-+*/(). 0-9eE]*[0-9.)])\s*(?![eE][0-9])(?P<unit>[A-Za-z1].*)")

_NOT_DECIMAL = re.compile(r"[-+]?0[xXoObB]\w+")

MANY = 2000
"""Digits that are kept of a setting given as a multiprecision number."""


def plain_setting(model: Model, name: str, setting: object) -> int | float | str:
    """Return a setting as a number or a text, as it was given.

    Raises
    ------
    UsageError
        If the parameter is unknown, or the setting is neither a single number nor a text.
    """
    parameter = require_parameter(model, name)
    if getattr(setting, "shape", None) == ():
        setting = setting.item()  # type: ignore[attr-defined]
    match setting:
        case str():
            return setting.strip()
        case bool():
            pass
        case numbers.Integral():
            if abs(int(setting)) > MAX_NUMBER:
                raise UsageError(f"{name}: the value is beyond {MAX_NUMBER:g}")
            return int(setting)
        case Fraction():
            return f"{setting.numerator}/{setting.denominator} {parameter.unit}".rstrip()
        case Decimal():
            return str(setting)
        case _ if hasattr(setting, "man_exp"):  # of mpmath: a binary number with all its digits
            mantissa, exponent = (int(part) for part in setting.man_exp)
            with localcontext(prec=MANY):
                return str(Decimal(mantissa) * Decimal(2) ** exponent)
        case numbers.Real():
            return float(setting)
    hint = "give a number or a text with an expression, not None or True; several values are for a sweep"
    raise UsageError(f"{name}={setting!r}: a parameter is one number\nhint: {hint}")


def _given(model: Model, name: str, given: object) -> Given:
    """Read a setting.

    Raises
    ------
    UsageError
        If it is neither a finite number, nor an expression, nor an interval of such, or its unit does not fit.
    """
    setting = plain_setting(model, name, given)
    text = setting if isinstance(setting, str) else repr(setting)
    parts = [text]
    if text.startswith("["):
        parts = text.removeprefix("[").removesuffix("]").split(",")
        if not text.endswith("]") or len(parts) != 2:
            raise UsageError(f"{name}={text}: an interval is written [first, last]")
    with _refused(name, setting):
        if not isinstance(setting, str):
            require_finite(setting)
        return Given(setting, tuple(_end(model, name, part.strip()) for part in parts))


@contextmanager
def _refused(name: str, setting: object) -> Iterator[None]:
    """Say which setting an error of an expression is about."""
    try:
        yield
    except ExpressionError as error:
        hint = f"\nhint: {error.hint}" if error.hint else ""
        raise UsageError(f"{name}={setting}: {error.message}{hint}") from None


def with_unit(text: str, names: Container[str]) -> tuple[Expression, str] | None:
    """Return the number and the unit of a text such as ``2 kg``; None if the word after the number is no unit.

    Parameters
    ----------
    names : container of str
        Names that an expression may use, and that are then no units.

    Raises
    ------
    ExpressionError
        If the number is not decimal.
    """
    match = _WITH_UNIT.fullmatch(text)
    if match is None or (match["unit"] not in UNITS and (match["unit"] in names or match["unit"] in CONSTANTS)):
        return None
    if _NOT_DECIMAL.fullmatch(text):
        raise ExpressionError("numbers are decimal, such as 16 or 1.6e1")
    return parse(match["value"]), match["unit"].strip()


def _end(model: Model, name: str, text: str) -> tuple[Expression, str | None]:
    """Return the value that a text such as ``2*pi`` or ``2 kg`` gives a parameter, and the unit in which it counts."""
    own = model.parameters[name].unit
    try:
        expression = parse_finite(text, model.parameters)
    except ExpressionError:
        if (parts := with_unit(text, model.parameters)) is None:
            raise
        expression, unit = parts
    else:
        _check_names(model, expression)
        return expression, own if expression.literal else None
    if not own:
        hint = f"give the number alone, or declare it: {name}: {{value: …, unit: {unit}}}"
        raise ExpressionError(f"the parameter {name} has no unit in the file", 0, hint)
    found, expected = parse_unit(unit)[1], parse_unit(own)[1]
    if found != expected:
        raise ExpressionError(f"{unit} is not a unit of {name}, which is declared in {own}", 0, f"give it in {own}")
    if one_counts_turns(unit, own):
        message = (
            f"{unit} counts turns, and {name} is declared in {own}"
            if counted_by(unit).turns
            else (f"{name} counts turns in {own}, and {unit} measures an angle")
        )
        raise ExpressionError(message, 0, f"give it in {own}; a turn is 2*pi rad")
    return expression, unit


def _check_names(model: Model, expression: Expression) -> None:
    """Refuse an expression of anything but parameters."""
    if expression.rates():
        raise ExpressionError("rate(...) cannot be used here")
    for used in expression.names():
        if used not in model.parameters:
            hint = as_name(used) or suggestion(used, model.parameters)
            hint = hint or "give a number, or an expression of numbers and parameters"
            raise ExpressionError(f"unknown parameter {used!r}", 0, hint)


def given_value(model: Model, name: str, arithmetic: Arithmetic) -> Number:
    """Return the value in SI that a question gives a parameter; raises as `given_values`, and of an interval."""
    given = model.parameters[name].given
    if given is not None and len(given.ends) > 1:
        message = f"{name}={given.setting}: this is an interval"
        raise UsageError(f"{message}\nhint: intervals need mbstab eig --certify")
    return given_values(model, name, arithmetic)[0]


def given_values(model: Model, name: str, arithmetic: Arithmetic) -> list[Number]:
    """Return the value in SI that a question gives a parameter, or both ends of its interval.

    Raises
    ------
    UsageError
        If one is not finite.
    """
    given = model.parameters[name].given
    assert given is not None

    def value(expression: Expression, unit: str | None) -> Number:
        values = evaluate_parameters(of_file(model), {}, arithmetic) if expression.names() else {}
        found = expression.evaluate(values, arithmetic)
        return require_finite(found * _factor(unit, parse_unit(unit)[0], arithmetic) if unit else found)

    with _refused(name, given.setting):
        return [value(*end) for end in given.ends]


def of_file(model: Model) -> Model:
    """Return a model with the values that the file gives to parameters."""
    return replace(model, parameters={name: replace(x, given=None) for name, x in model.parameters.items()})


def _factor(unit: str, factor: float, arithmetic: Arithmetic) -> Number:
    """Return the factor from a unit to SI, as exactly as the number system can represent it."""
    return factor if factor == 1.0 or arithmetic.name in ("float", "array") else exact_factor(unit, arithmetic)


def evaluate_parameters(
    model: Model, overrides: Mapping[str, Number], arithmetic: Arithmetic, added: Mapping[str, Number] | None = None
) -> dict[str, Number]:
    """Return the value of every parameter in SI, with some of them replaced.

    What is `added` to parameters counts in those that are written in terms of them, too.

    Raises
    ------
    ModelFileError
        With every parameter whose value is not finite or not allowed by the file.
    UsageError
        If a parameter to be replaced is unknown, or one is given as an interval.
    """
    for name in overrides:
        require_parameter(model, name)
    document = replace(model.document, problems=[])
    values: dict[str, Number] = {}
    for name, parameter in model.parameters.items():
        try:
            if name in overrides:
                value = overrides[name]
            elif parameter.given is not None:
                value = given_value(model, name, arithmetic)
            else:
                value = parameter.expression.evaluate(values, arithmetic)
                value = require_finite(value * _factor(parameter.unit, parameter.factor, arithmetic))
            if added and name in added:
                value = value + added[name]
            if arithmetic.name != "symbol" and (broken := broken_sign(value, parameter.sign)):
                rule, shown = broken
                got = f"{shown / parameter.factor:g}{after_number(parameter.unit)}"
                raise ExpressionError(f"{name} must {rule}, got {got}", 0, f"the file says sign: {parameter.sign}")
            values[name] = value
        except ExpressionError as error:
            document.complain(parameter.location, parameter.expression.path, error.message, error.hint)
            values[name] = 1.0
    document.raise_problems()
    return values
