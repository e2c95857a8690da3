"""Ranges of parameters: from the command line, or from the ``sweep:`` block of a file."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from mbstab.errors import UsageError
from mbstab.model.arguments import series
from mbstab.model.arithmetic import FLOAT
from mbstab.model.parameters import bound, evaluate_parameters, given_value, require_parameter
from mbstab.model.schema import Model, SweepRange, after_number

POINTS = 401


def sweep_values(
    model: Model,
    parameter: str,
    start: str | float | None = None,
    stop: str | float | None = None,
    points: int | None = None,
    logarithmic: bool = False,
    values: str | None = None,
    span: str | None = None,
) -> Any:
    """Return the values of a parameter in a sweep, in SI, shape (points,).

    Parameters
    ----------
    start, stop : str or float, optional
        First and last value: a number in the parameter's unit, or an expression; those of the
        file's ``sweep:`` block if not given.
    points : int, optional
        Number of values.
    logarithmic : bool
        Whether successive values have equal ratios instead of equal differences.
    values : str, optional
        The values themselves, separated by commas.
    span : str, optional
        Both ends instead: ``0.1..10``, or ``5%`` about the present value.

    Raises
    ------
    UsageError
        If the parameter is unknown, or the range is missing, empty or reaches zero on a logarithmic scale.
    """
    import numpy as np

    require_parameter(model, parameter)
    if span is not None and (start is not None or stop is not None):
        raise UsageError(f"{parameter}={span} gives both ends\nhint: leave out --from and --to")
    if values is not None:
        if start is not None or stop is not None or points is not None or logarithmic or span is not None:
            raise UsageError("--values gives the whole range: leave out any other, --points and --log")
        return _listed(model, parameter, values)
    default = model.sweep.get(parameter)
    first, last = _ends(model, parameter, start, stop, default) if span is None else _span(model, parameter, span)
    if first == last:
        raise UsageError(f"the range of {parameter} is empty: both ends are {in_unit(model, parameter, first)}")
    count = points if points is not None else default.points if default is not None else POINTS
    if logarithmic:
        if first <= 0.0 or last <= 0.0:
            ends = " and ".join(in_unit(model, parameter, x) for x in (first, last))
            raise UsageError(f"--log needs positive ends, not {ends}")
        return np.geomspace(first, last, count)
    return np.linspace(first, last, count)


def swept_values(model: Model, parameter: str, values: Any, si: bool = False) -> Any:
    """Return values for a sweep that is asked for in Python, in SI, shape (points,).

    Parameters
    ----------
    values : sequence of float or str, or None
        As settings: numbers and expressions count in the declared unit of the parameter, unless a text has a unit of
        its own. None: the ``sweep:`` block of the file.
    si : bool
        Whether numbers are in SI instead.

    Raises
    ------
    UsageError
        If they are no list of finite numbers, or the file has no such block.
    """
    import numpy as np

    if values is None:
        if parameter in model.parameters and parameter not in model.sweep:
            message = f"{model.name} has no sweep: block for {parameter}"
            raise UsageError(f"{message}\nhint: give its values, such as numpy.linspace(1, 2, 11)")
        return sweep_values(model, parameter)
    if isinstance(values, (list, tuple)) and any(isinstance(x, str) for x in values):
        return np.array([_value(model, parameter, x) for x in values])
    found = series(parameter, values)
    own = model.parameters.get(parameter)
    return found if si or own is None else found * own.factor


def in_unit(model: Model, parameter: str, value: float) -> str:
    """Return a value (SI) of a parameter in its unit."""
    own = model.parameters[parameter]
    return f"{value / own.factor:.6g}{after_number(own.unit)}"


def interval(model: Model, parameter: str, given: str | Sequence[float]) -> tuple[float, float]:
    """Return the ends of a range in SI, written ``0.9..1.1`` or, about the present value, ``5%``; or two numbers.

    Raises
    ------
    UsageError
        If the parameter is unknown, or the range is empty, reversed or not one.
    ModelFileError
        If an end is a value that the file forbids.
    """
    first, last = _span(model, parameter, given)
    if not first < last:
        what = "empty" if first == last else "reversed"
        shown = given if isinstance(given, str) else f"{given[0]}..{given[1]}"
        raise UsageError(f"the range of {parameter} is {what}: {shown}")
    for end in (first, last):
        evaluate_parameters(model, {parameter: end}, FLOAT)  # does the file allow it?
    return first, last


def _span(model: Model, parameter: str, given: str | Sequence[float]) -> tuple[float, float]:
    """Return the ends of a range as they are written, in SI."""
    require_parameter(model, parameter)
    text = given.strip() if isinstance(given, str) else ""
    if text.endswith("%"):
        value = float(evaluate_parameters(model, {}, FLOAT)[parameter])
        reach = abs(value) * _percent(parameter, text)
        if not reach > 0.0:
            raise UsageError(f"{parameter}={text}: that is no range about {value:g}\nhint: {parameter}=FIRST..LAST")
        return value - reach, value + reach
    parts = text.split("..") if isinstance(given, str) else list(given)
    if len(parts) != 2:
        shown = given if isinstance(given, str) else list(given)
        raise UsageError(f"{parameter}={shown}: a range is written FIRST..LAST, such as 0.9..1.1, or 5%")
    return _value(model, parameter, parts[0]), _value(model, parameter, parts[1])


def swept_interval(model: Model, parameter: str) -> tuple[float, float]:
    """Return the ends of the ``sweep:`` block of a parameter, in SI and in ascending order.

    Raises
    ------
    UsageError
        If the file has none.
    """
    if parameter not in model.sweep:
        message = f"{model.name} has no sweep: block for {parameter} that says where to look"
        raise UsageError(f"{message}\nhint: give the range, such as range:{parameter}=0..10")
    first, last = sorted(_ends(model, parameter, None, None, model.sweep[parameter]))
    return first, last


def _percent(parameter: str, text: str) -> float:
    """Return a number of percent as a fraction."""
    try:
        return 0.01 * float(text.removesuffix("%"))
    except ValueError:
        raise UsageError(f"{parameter}={text}: write a number of percent, such as 5%") from None


def _listed(model: Model, parameter: str, values: str) -> Any:
    """Return values that are separated by commas."""
    import numpy as np

    found = np.array([_value(model, parameter, text) for text in values.split(",")])
    steps = np.diff(found)
    if len(found) < 2 or not (np.all(steps > 0.0) or np.all(steps < 0.0)):
        raise UsageError(f"--values {values}: give at least two values in ascending or descending order")
    return found


def _ends(
    model: Model, parameter: str, start: str | float | None, stop: str | float | None, default: SweepRange | None
) -> list[float]:
    """Return the first and the last value: those given, or else those of the file."""
    ends = []
    written_ends = (None, None) if default is None else (default.start, default.stop)
    for name, given, written in zip(("--from", "--to"), (start, stop), written_ends, strict=True):
        if given is not None:
            ends.append(_value(model, parameter, given))
        elif written is not None:
            nominal = evaluate_parameters(model, {}, FLOAT)
            factor = model.parameters[parameter].factor if written.literal else 1.0
            ends.append(float(written.evaluate(nominal, FLOAT)) * factor)
        else:
            raise UsageError(
                f"{name} is missing: {model.name} has no sweep: block for {parameter}\n"
                f"hint: --from … --to …, or sweep: {{{parameter}: {{from: …, to: …}}}} in the file"
            )
    return ends


def _value(model: Model, parameter: str, given: str | float) -> float:
    return float(given_value(bound(model, {parameter: given}), parameter, FLOAT))
