"""Scenes in the arithmetic of numbers with error bounds."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

import numpy as np

from mbstab.analysis.algebra.rounded import UNIT, Rounded, WithErrors, rounded_arithmetic, value_and_error
from mbstab.analysis.reference.tolerances import TOLERANCES
from mbstab.compiler.system import Array, System
from mbstab.errors import MbstabError
from mbstab.model.exact_values import exact_parameters
from mbstab.model.expressions import ExpressionError
from mbstab.model.garbage import uncollected
from mbstab.model.schema import Model
from mbstab.model.units import exact_factor
from mbstab.model.values import evaluate


def rounded_system(system: System) -> System:
    """Return a scene in the arithmetic of numbers with error bounds."""

    def made() -> System:
        with uncollected():
            return _rounded(system)

    return system.remember("rounded", None, made)


def _rounded(system: System) -> System:
    model, given = system.scene.model, system.scene.parameters
    scene = evaluate(model, _parameters(model, given), rounded_arithmetic(), checked=True)
    if not system.sparse:
        return system.renumbered(scene)
    from mbstab.analysis.algebra.rounded_arrays import RoundedNumbers

    return system.renumbered(scene, RoundedNumbers())


def without_chance_zeros(system: System) -> System:
    """Return a scene in which no parameter is nearly zero for the rounding of a float alone.

    Such parameters get their values by the decimals of the file, or one beyond their error where these are not known.
    """
    scene = system.scene
    if scene.arithmetic.name != "float":
        return system
    given = {name: float(x) for name, x in scene.parameters.items()}
    pairs = {name: value_and_error(x) for name, x in _parameters(scene.model, given).items()}
    beside = {name: given[name] + 2.0 * e for name, (v, e) in pairs.items() if e and abs(v) <= e}
    if not beside:
        return system
    better = given | beside | exact_parameters(beside, scene.model, given, scene.arithmetic)
    if better == given:
        return system
    try:
        return system.renumbered(evaluate(scene.model, better))
    except MbstabError:  # a sign that is not allowed
        return system


def exact_system(system: System) -> System:
    """Return a scene in balls, with the decimals of the file where the parameters have the values that these give."""

    def made() -> System:
        from mbstab.analysis.algebra.ball_arrays import many_bits
        from mbstab.model.balls import ball_arithmetic, decimal

        with uncollected(), many_bits(TOLERANCES.bits_of_scene):
            f, values, scene = ball_arithmetic(), dict[str, Any](), system.scene
            known = _parameters(scene.model, scene.parameters)
            for name, parameter in scene.model.parameters.items():
                given, error = value_and_error(known[name])
                values[name] = decimal(repr(given))
                with suppress(ExpressionError, ArithmeticError, ValueError):
                    found = parameter.expression.evaluate(values, f) * exact_factor(parameter.unit, f)
                    # What cancels in doubles may leave nothing of a value there.
                    if abs(float(found) - given) <= error + 8.0 * UNIT * abs(given):
                        values[name] = found
            return system.renumbered(evaluate(scene.model, values, f, checked=True))

    return system.remember("exact", None, made)


def _parameters(model: Model, given: dict[str, Any]) -> dict[str, Any]:
    """Return the parameters: those of the file with the errors of their expressions, others as decimals."""
    f, values = rounded_arithmetic(), dict[str, Any]()
    for name, parameter in model.parameters.items():
        v = float(given[name])
        values[name] = Rounded(v, UNIT * abs(v))
        try:
            found = parameter.expression.evaluate(values, f)
        except (ExpressionError, ArithmeticError):
            continue
        if parameter.factor != 1.0:
            found = found * exact_factor(parameter.unit, f)
        x, e = value_and_error(found)
        if abs(x - v) <= e + 4.0 * UNIT * abs(v):
            values[name] = Rounded(v, e + abs(x - v))
    return values


def errors_of(x: Any) -> Any:
    """Return the errors of an array."""
    if isinstance(x, WithErrors):
        return x.errors
    flat = np.asarray(x, dtype=object)
    return np.array([y.e if y.__class__ is Rounded else 0.0 for y in flat.flat], dtype=float).reshape(flat.shape)


def with_errors(values: Array, errors: Array) -> list[Any]:
    """Return numbers with errors; exact zeros stay floats."""
    return [Rounded(v, e) if e or v else v for v, e in zip(values.tolist(), errors.tolist(), strict=True)]
