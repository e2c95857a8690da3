"""A model with numbers: parameters evaluated, entries resolved, every number checked.

Values may be floats or arrays over the points of a sweep; the checks then hold for all points.
"""

from __future__ import annotations

import contextlib
import math
import numbers
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from decimal import Decimal, localcontext
from fractions import Fraction
from typing import Any

from mbstab.errors import Location, UsageError, suggestion
from mbstab.mechanics import vectors
from mbstab.mechanics.bodies import combine, shape_moments
from mbstab.mechanics.catalogue import GROUND, Field, Kind, Marker, Number, Sign, Triad, Vector
from mbstab.model.arithmetic import CONSTANTS, FLOAT, Arithmetic, array_arithmetic
from mbstab.model.charts import euler_matrix, regular
from mbstab.model.expressions import MAX_NUMBER, Expression, ExpressionError, parse
from mbstab.model.jets import Jet, jet_arithmetic
from mbstab.model.schema import (
    Components,
    Entry,
    MarkerValue,
    Model,
    Parameter,
    PartValue,
    Quantity,
    ShapeValue,
    Steady,
    after_number,
    body_coordinates,
    parse_finite,
)
from mbstab.model.units import UNITS, exact_factor, parse_unit


@dataclass(frozen=True)
class BodyValues:
    """A body with its numbers.

    Attributes
    ----------
    mass : number (kg)
    inertia : tuple (kg·m²)
        About the centre of mass, in body axes: Izz in the plane; xx, yy, zz, xy, xz, yz in space.
    center : tuple (m)
        Centre of mass in the body frame.
    base : tuple of 9
        Constant rotation before the Euler angles, row by row (spatial bodies).
    coordinates : tuple of str
        Names of its coordinates.
    """

    name: str
    location: Location
    orientation: bool
    mass: Number
    inertia: Vector
    center: Vector
    base: Vector
    coordinates: tuple[str, ...]


@dataclass(frozen=True)
class Law:
    """A given function of time."""

    expression: Quantity
    names: Mapping[str, Number]
    arithmetic: Arithmetic

    def at(self, time: Number) -> Jet:
        """Return value, first and second derivative at a time (s)."""
        names = {**self.names, "t": Jet(time, 1, 0)}
        return Jet.of(self.expression.evaluate(names, jet_arithmetic(self.arithmetic)))


@dataclass(frozen=True)
class SteadyValues:
    """A steady motion with its numbers: unit vectors, rates in rad/s and m/s; None for what is not given."""

    axis: Vector | None
    rate: Number | None
    point: Vector
    direction: Vector | None
    speed: Number | None


@dataclass(frozen=True)
class InitialValues:
    """Where a simulation starts, with its numbers: given values by coordinate name; None: the reference time (s)."""

    time: Number | None = None
    coordinates: dict[str, Number] = field(default_factory=dict)
    rates: dict[str, Number] = field(default_factory=dict)


@dataclass(frozen=True)
class Scene:
    """A model at given parameter values.

    Attributes
    ----------
    parameters : dict
        Value of every parameter, in SI.
    bodies : tuple of BodyValues
    items : list of ItemValues
        Joints, contacts, drives, forces and constraints in the order of the file.
    time : number (s)
    coordinates, rates, guess : dict
        Given values of the reference, by coordinate name.
    steady : SteadyValues or None
    period : number or None
        Period of a periodic motion (s).
    points : int or None
        Number of points of a sweep, if numbers may be arrays over them.
    lengths : list of float
        Sizes that occur in the scene (m), for scaling tolerances.
    initial : InitialValues
        Where a simulation starts.
    turned : tuple of str
        Bodies whose given angles are singular, and are counted from their place instead (`mbstab.model.charts`).
    """

    model: Model
    arithmetic: Arithmetic
    parameters: dict[str, Number]
    gravity: Vector
    bodies: tuple[BodyValues, ...]
    items: list[ItemValues]
    time: Number
    coordinates: dict[str, Number]
    rates: dict[str, Number]
    guess: dict[str, Number]
    steady: SteadyValues | None
    period: Number | None
    points: int | None = None
    lengths: list[float] = field(default_factory=list)
    initial: InitialValues = field(default_factory=InitialValues)
    turned: tuple[str, ...] = ()

    @property
    def dimension(self) -> int:
        """2 for a planar scene, 3 for a spatial one."""
        return self.model.dimension

    def coordinate_names(self) -> list[str]:
        """Return the names of the coordinates in the order of q."""
        return self.model.coordinates()


def parse_overrides(model: Model, settings: Mapping[str, object], arithmetic: Arithmetic = FLOAT) -> dict[str, Number]:
    """Return parameter values in SI for settings such as ``{"omega": "2*pi"}``.

    A plain number counts in the declared unit of the parameter, one with a unit of its own such as
    ``2 kg`` in that; an expression may use the other parameters' values in the file and counts in
    SI. In a number system other than floats a text keeps all its digits, and a float stands for
    the decimals it is printed with.

    Raises
    ------
    UsageError
        If a parameter is unknown or the value is no finite number in a unit that fits.
    """
    return {name: _override(model, name, setting, arithmetic) for name, setting in settings.items()}


def settings_in_si(values: Mapping[str, float]) -> dict[str, str]:
    """Return values in SI as settings for `parse_overrides`: as expressions they do not count in declared units."""
    return {name: f"1*({value!r})" for name, value in values.items()}


def _parameter(model: Model, name: str) -> Parameter:
    if name not in model.parameters:
        hint = suggestion(name, model.parameters) or "parameters: " + (", ".join(model.parameters) or "none")
        raise UsageError(f"{model.name} has no parameter {name!r}\nhint: {hint}")
    return model.parameters[name]


def _factor(parameter: Parameter, arithmetic: Arithmetic) -> Number:
    """Return what turns the unit of a parameter into SI, as exact as the number system can have it."""
    if parameter.factor == 1.0 or arithmetic.name in ("float", "array"):
        return parameter.factor
    return exact_factor(parameter.unit, arithmetic)


_WITH_UNIT = re.compile(r"(?P<value>[-+*/(). 0-9eE]*[0-9.)])\s*(?![eE][0-9])(?P<unit>[A-Za-z1].*)")


MANY = 2000
"""Digits of a setting that is given as a number with many digits."""


def plain_setting(model: Model, name: str, setting: object) -> int | float | str:
    """Return the value of a parameter as it is told, as a number or a text.

    Raises
    ------
    UsageError
        If the parameter is unknown, or what is given is neither one number nor a text.
    """
    parameter = _parameter(model, name)
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
    hint = "a number, or a text with an expression; None and True are neither, several values are for a sweep"
    raise UsageError(f"{name}={setting!r}: a parameter is one number\nhint: {hint}")


def parse_setting(model: Model, name: str, text: str) -> tuple[Expression, str]:
    """Return the value that a text such as ``2*pi`` or ``2 kg`` gives a parameter, and the unit it is written with.

    Raises
    ------
    ExpressionError
        If it is neither an expression nor a number with a unit that fits that of the parameter.
    """
    try:
        return parse_finite(text, model.parameters), ""
    except ExpressionError:
        match = _WITH_UNIT.fullmatch(text.strip())
        if match is None or match["unit"] in {*model.parameters, *CONSTANTS} - {*UNITS}:
            raise
        value, unit = parse(match["value"]), match["unit"].strip()
    own = _parameter(model, name).unit
    if not own:
        hint = f"give the number alone, or declare it: {name}: {{value: …, unit: {unit}}}"
        raise ExpressionError(f"the parameter {name} has no unit in the file", 0, hint)
    found, expected = parse_unit(unit)[1], parse_unit(own)[1]
    if found != expected:
        raise ExpressionError(f"{unit} is no unit of {name}, which is declared in {own}", 0, f"give it in {own}")
    return value, unit


def unit_factor(unit: str, arithmetic: Arithmetic) -> Number:
    """Return what turns a unit into SI, as exact as the number system can have it."""
    return parse_unit(unit)[0] if arithmetic.name in ("float", "array") else exact_factor(unit, arithmetic)


def _override(model: Model, name: str, given: object, arithmetic: Arithmetic) -> Number:
    parameter = _parameter(model, name)
    setting = plain_setting(model, name, given)
    factor = _factor(parameter, arithmetic)
    if isinstance(setting, str) and setting.strip().startswith("["):
        raise UsageError(f"{name}={setting}: this is an interval\nhint: intervals need mbstab eig --certify")
    try:
        if not isinstance(setting, str):
            _require_finite(setting)
            number = setting if arithmetic is FLOAT else arithmetic.number(repr(setting))
            return _require_finite(number * factor)
        expression, unit = parse_setting(model, name, setting)
        if unit:
            return _require_finite(expression.evaluate({}, arithmetic) * unit_factor(unit, arithmetic))
        if expression.literal:
            return _require_finite(expression.evaluate({}, arithmetic) * factor)
        nominal = evaluate_parameters(model, {}, arithmetic)
        if expression.rates():
            raise ExpressionError("rate(...) cannot be used here")
        for used in expression.names():
            if used not in nominal:
                raise ExpressionError(f"unknown parameter {used!r}", 0, suggestion(used, nominal))
        return _require_finite(expression.evaluate(nominal, arithmetic))
    except ExpressionError as error:
        hint = f"\nhint: {error.hint}" if error.hint else ""
        raise UsageError(f"{name}={setting}: {error.message}{hint}") from None


def evaluate_parameters(model: Model, overrides: Mapping[str, Number], arithmetic: Arithmetic) -> dict[str, Number]:
    """Return the value of every parameter in SI, with some of them replaced.

    Raises
    ------
    ModelFileError
        With every parameter that has no finite value, or one that the file does not allow.
    UsageError
        If a parameter to be replaced is unknown.
    """
    for name in overrides:
        _parameter(model, name)
    document = replace(model.document, problems=[])
    values: dict[str, Number] = {}
    for name, parameter in model.parameters.items():
        try:
            if name in overrides:
                value = overrides[name]
            else:
                value = parameter.expression.evaluate(values, arithmetic)
                value = _require_finite(value * _factor(parameter, arithmetic))
            if arithmetic.name != "symbol" and (broken := broken_sign(value, parameter.sign)):
                rule, shown = broken
                got = f"{shown / parameter.factor:g}{after_number(parameter.unit)}"
                raise ExpressionError(f"{name} must {rule}, got {got}")
            values[name] = value
        except ExpressionError as error:
            document.complain(parameter.location, parameter.expression.path, error.message)
            values[name] = 1.0
    document.raise_problems()
    return values


def evaluate(
    model: Model, overrides: Mapping[str, Number] | None = None, arithmetic: Arithmetic | None = None
) -> Scene:
    """Return the scene at the given parameter values (SI).

    Raises
    ------
    ModelFileError
        With every number that is out of range, at its place in the file.
    UsageError
        If a parameter to be replaced is unknown.
    """
    overrides = overrides or {}
    if arithmetic is None:
        arithmetic = array_arithmetic() if any(hasattr(v, "shape") for v in overrides.values()) else FLOAT
    with _quiet(arithmetic):
        return _Evaluator(model, evaluate_parameters(model, overrides, arithmetic), arithmetic).scene()


def _quiet(arithmetic: Arithmetic) -> contextlib.AbstractContextManager[Any]:
    """Return a context without NumPy's warnings: what is not finite is found and said by the checks."""
    if arithmetic.name != "array":
        return contextlib.nullcontext()
    import numpy as np

    return np.errstate(all="ignore")


def _require_finite(value: Number) -> Number:
    if not _finite(value):
        raise ExpressionError("the value is not finite")
    return value


def _finite(value: Number) -> bool:
    if hasattr(value, "shape"):
        import numpy as np

        return bool(np.all(np.isfinite(value)))
    return not isinstance(value, float) or math.isfinite(value)


def broken_sign(value: Number, sign: Sign) -> tuple[str, float] | None:
    """Return the rule that a value breaks, such as ``be positive``, and the value; None: it has the sign."""
    match sign:
        case "positive":
            good, rule = value > 0, "be positive"
        case "nonnegative":
            good, rule = value >= -_blur(value), "not be negative"
        case "nonzero":
            good, rule = value != 0, "not be zero"
        case _:
            return None
    if _all(good):
        return None
    shown = value[~good].flat[0] if getattr(value, "shape", ()) else value
    return rule, _nominal(shown.lower() if hasattr(shown, "lower") else shown)


def _blur(value: Number) -> Number:
    """Return what the rounded radius of a wide ball adds to it: the ends of an interval are judged as points."""
    return value.rad() * 2.0**-20 if hasattr(value, "rad") else 0


def _all(condition: Any) -> bool:
    return bool(condition.all()) if hasattr(condition, "all") else bool(condition)


class _Evaluator:
    """Turns the quantities of a model into numbers; a problem is recorded, then a harmless number returned."""

    def __init__(self, model: Model, parameters: dict[str, Number], arithmetic: Arithmetic) -> None:
        self.model = model
        self.document = replace(model.document, problems=[])
        self.parameters = parameters
        self.f = arithmetic
        self.symbolic = arithmetic.name == "symbol"
        self.lengths: list[float] = []
        self.body_numbers = {name: i for i, name in enumerate(model.bodies)}
        self.coordinate_numbers = {name: i for i, name in enumerate(model.coordinates())}

    def scene(self) -> Scene:
        model, reference = self.model, self.model.reference
        gravity = self.vector(model.gravity)
        bodies = tuple(self.body(entry) for entry in model.bodies.values())
        items: list[ItemValues] = []
        joints: dict[str, ItemValues] = {}
        for section in model.order:
            for entry in model.entries[section].values():
                items.append(ItemValues(entry, self, joints))
                if section == "joints":
                    joints[entry.name] = items[-1]
        time = self.number(reference.time)
        for item in items:
            item.check(time)
        coordinates, rates, guess = (
            {name: self.number(value) for name, value in values.items()}
            for values in (reference.coordinates, reference.rates, reference.guess)
        )
        steady, period = self.steady(reference.steady), self.period(reference.period)
        initial = self.initial()
        self.document.raise_problems()
        return regular(Scene(
            model, self.f, self.parameters, gravity, bodies, items, time, coordinates, rates, guess, steady,
            period, self.points(), self.lengths, initial,
        ))  # fmt: skip

    def initial(self) -> InitialValues:
        given = self.model.initial
        time = None if given.time is None else self.number(given.time)
        coordinates, rates = (
            {name: self.number(value) for name, value in values.items()} for values in (given.coordinates, given.rates)
        )
        return InitialValues(time, coordinates, rates)

    def points(self) -> int | None:
        return next((len(value) for value in self.parameters.values() if getattr(value, "ndim", 0)), None)

    def steady(self, steady: Steady | None) -> SteadyValues | None:
        if steady is None:
            return None
        axis, direction = (
            None if x is None else vectors.unit(self.direction(x), self.f.sqrt) for x in (steady.axis, steady.direction)
        )
        rate, speed = (None if x is None else self.number(x) for x in (steady.rate, steady.speed))
        point = (0.0,) * self.model.dimension if steady.point is None else self.vector(steady.point)
        return SteadyValues(axis, rate, point, direction, speed)

    def period(self, period: Quantity | None) -> Number | None:
        if period is None:
            return None
        value = self.number(period)
        if not self.symbolic and not _all(value > 0):
            self.complain(period, f"the period must be positive, got {_nominal(value):g} s")
        return value

    def complain(self, quantity: Quantity | Components, message: str, hint: str = "") -> None:
        self.document.complain(quantity.location, quantity.path, message, hint)

    def number(self, quantity: Quantity, field: Field | None = None) -> Number:
        try:
            value = quantity.evaluate(self.parameters, self.f)
        except ExpressionError as error:
            self.complain(quantity, error.message)
            return 1.0
        if self.symbolic:
            return value
        if not _finite(value):
            self.complain(quantity, f"the value of {quantity.text!r} is not finite")
            return 1.0
        if field is not None:
            if not self._has_sign(value, quantity, field):
                return 1.0
            if field.unit == "m" and not hasattr(value, "shape"):
                self.lengths.append(abs(value))
        return value

    def _has_sign(self, value: Number, quantity: Quantity, field: Field) -> bool:
        broken = broken_sign(value, field.sign)
        if broken is None:
            return True
        rule, shown = broken
        got = f"{shown:g}{after_number(field.unit)}"
        self.complain(quantity, f"{field.name.replace('_', ' ')} must {rule}, got {got}")
        return False

    def vector(self, components: Components, length: bool = False) -> Vector:
        values = tuple(self.number(x) for x in components.values)
        if length and not self.symbolic:
            self.lengths += [abs(x) for x in values if not hasattr(x, "shape")]
        return values

    def direction(self, components: Components) -> Vector:
        """Return a vector whose length matters only in that it exists."""
        values = self.vector(components)
        if self.symbolic:
            return values
        square = vectors.dot(values, values)
        if not _all((square > 0) & (square < math.inf)):
            self.complain(components, f"a direction must have a length, this one has {_nominal(square) ** 0.5:g}")
            return (1.0, 2.0, 3.0)[: len(values)]
        return values

    # --- bodies -----------------------------------------------------------------------------------------------------

    def body(self, entry: Entry) -> BodyValues:
        dimension = self.model.dimension
        coordinates = body_coordinates(entry)
        orientation = len(coordinates) > dimension
        base: Vector = tuple(float(i == j) for i in range(3) for j in range(3)) if dimension == 3 else ()
        size = 1 if dimension == 2 else 6
        if not orientation:
            mass = self.number(entry.values["mass"], entry.kind.field("mass"))
            return BodyValues(
                entry.name, entry.location, False, mass, (0.0,) * size, (0.0,) * dimension, base, coordinates
            )
        for point in entry.values.get("points", {}).values():
            self.vector(point, length=True)
        for direction in entry.values.get("directions", {}).values():
            self.direction(direction)
        mass, center, inertia = self._distribution(entry)
        if "axes" in entry.values:
            base = euler_matrix(self.vector(entry.values["axes"]), self.f)
        return BodyValues(entry.name, entry.location, True, mass, inertia, center, base, coordinates)

    def _distribution(self, entry: Entry) -> tuple[Number, Vector, Vector]:
        dimension, values = self.model.dimension, entry.values
        mass_field = entry.kind.field("mass")
        if "parts" in values:
            mass, center, inertia = combine((self._part(part, mass_field) for part in values["parts"]), dimension)
            self._check_inertia(entry, "parts", (mass, *center, *inertia), inertia)
            return mass, center, inertia
        mass = self.number(values["mass"], mass_field)
        center = (0.0,) * dimension
        if "center_of_mass" in values:
            center = self.vector(values["center_of_mass"], length=True)
        if "shape" in values:
            moments = self._moments(values["shape"], mass)
            inertia = moments[2:] if dimension == 2 else (*moments, 0.0, 0.0, 0.0)
            self._check_inertia(entry, "shape", inertia, inertia)
            return mass, center, inertia
        inertia = self._tensor(values["inertia"])
        self._check_inertia(entry, "inertia", inertia, inertia)
        return mass, center, inertia

    def _part(self, part: PartValue, mass_field: Field) -> tuple[Number, Vector, Vector]:
        mass = self.number(part.mass, mass_field)
        return mass, self.vector(part.place, length=True), self._moments(part.shape, mass)

    def _moments(self, shape: ShapeValue, mass: Number) -> Vector:
        lengths = tuple(self.number(shape.lengths[f.name], f) for f in shape.kind.fields)
        return shape_moments(shape.kind, lengths, mass, shape.along)

    def _tensor(self, components: Components) -> Vector:
        """Return the inertia as one number in the plane, as xx, yy, zz, xy, xz, yz in space."""
        m = self.vector(components)
        if len(m) != 9:
            return m
        if not self.symbolic:
            largest = sum(abs(x) for x in m)
            for upper, lower in ((1, 3), (2, 6), (5, 7)):
                if not _all(abs(m[upper] - m[lower]) <= 1e-12 * largest):
                    one, other = components.values[upper], components.values[lower]
                    message = f"the inertia is not symmetric: {one.text!r} and {other.text!r} must be the same"
                    self.complain(other, message)
        return m[0], m[4], m[8], m[1], m[2], m[5]

    def _check_inertia(self, entry: Entry, name: str, numbers: Vector, inertia: Vector) -> None:
        """Refuse principal moments that are negative, or one that exceeds the sum of the other two."""
        if self.symbolic:
            return

        def complain(message: str, hint: str = "") -> None:
            self.document.complain(entry.places[name], f"{entry.path}.{name}", message, hint)

        if not all(_finite(x) for x in numbers):
            complain("mass and inertia are not finite")
            return
        if len(inertia) == 1:
            if not _all(inertia[0] >= 0):
                complain(f"inertia must not be negative, got {_nominal(inertia[0]):g} kg*m^2")
            return
        import numpy as np

        xx, yy, zz, xy, xz, yz = np.broadcast_arrays(*(np.asarray(x, dtype=float) for x in inertia))
        tensor = np.stack([np.stack([xx, xy, xz], -1), np.stack([xy, yy, yz], -1), np.stack([xz, yz, zz], -1)], -2)
        moments = np.linalg.eigvalsh(tensor)
        slack = 1e-12 * np.abs(moments).max(axis=-1)
        low, middle, high = (moments[..., i] for i in range(3))
        shown = ", ".join(f"{x:g}" for x in moments.reshape(-1, 3)[0])
        if not np.all(low >= -slack):
            complain(f"inertia must be positive: its principal moments are {shown} kg*m^2")
        elif not np.all(low + middle >= high - slack):
            hint = "no principal moment of a body exceeds the sum of the other two"
            complain(f"impossible inertia: its principal moments are {shown} kg*m^2", hint)


def _nominal(x: Number) -> float:
    return float(x.flat[0]) if hasattr(x, "flat") else float(x)


class ItemValues:
    """An entry with its numbers; the `Item` that `Kind.build` sees."""

    def __init__(self, entry: Entry, evaluator: _Evaluator, joints: dict[str, ItemValues]) -> None:
        self.entry = entry
        self.name = entry.name
        self.kind: Kind = entry.kind
        self.functions = evaluator.f
        self.dimension = evaluator.model.dimension
        self._evaluator = evaluator
        self._joints = joints
        self._cache: dict[str, Any] = {}

    def check(self, time: Number) -> None:
        """Evaluate every field once, so that all problems are found together; functions of time at `time`."""
        for field_ in self.kind.fields:
            if not self.given(field_.name):
                continue
            match field_.shape:
                case "number":
                    self.number(field_.name)
                case "vector" if field_.unit == "m":
                    self.vector(field_.name)
                case "vector" | "direction":
                    self.unit_vector(field_.name)
                case "directions":
                    self.triads("axis", "zero")
                case "marker":
                    self.marker(field_.name)
                case "markers":
                    self.markers(field_.name)
                case "law" | "law vector":
                    for law in self.laws(field_.name):
                        self._check_law(law, time)

    def _check_law(self, law: Law, time: Number) -> None:
        if self._evaluator.symbolic:
            return
        try:
            jet = law.at(time)
            for value in (jet.value, jet.rate, jet.second):
                _require_finite(value)
        except ExpressionError as error:
            self._evaluator.complain(law.expression, error.message)

    def given(self, name: str) -> bool:
        """Whether the field has a value, its own or a default."""
        return name in self.entry.values

    def number(self, name: str) -> Number:
        """Return a number of the entry."""
        if name not in self._cache:
            self._cache[name] = self._evaluator.number(self.entry.values[name], self.kind.field(name))
        return self._cache[name]

    def vector(self, name: str) -> Vector:
        """Return a vector in ground axes, as written."""
        if name not in self._cache:
            self._cache[name] = self._evaluator.vector(self.entry.values[name], self.kind.field(name).unit == "m")
        return self._cache[name]  # type: ignore[no-any-return]

    def unit_vector(self, name: str) -> Vector:
        """Return a vector in ground axes with length 1."""
        if name not in self._cache:
            direction = self._evaluator.direction(self.entry.values[name])
            self._cache[name] = vectors.unit(direction, self._evaluator.f.sqrt)
        return self._cache[name]  # type: ignore[no-any-return]

    def direction(self, name: str) -> Vector:
        """Return a unit vector in the frame of the entry's body."""
        return self.unit_vector(name)

    def choice(self, name: str) -> str:
        """Return a word."""
        return str(self.entry.values[name])

    def body(self, name: str) -> int:
        """Return the number of a body."""
        return self._evaluator.body_numbers[self.entry.values[name]]

    def _marker(self, value: MarkerValue) -> Marker:
        body = GROUND if value.body is None else self._evaluator.body_numbers[value.body]
        return Marker(body, self._evaluator.vector(value.point, length=True))

    def marker(self, name: str) -> Marker:
        """Return a point of a body."""
        if name not in self._cache:
            self._cache[name] = self._marker(self.entry.values[name])
        return self._cache[name]  # type: ignore[no-any-return]

    def markers(self, name: str) -> tuple[Marker, Marker]:
        """Return two points."""
        if name not in self._cache:
            first, second = self.entry.values[name]
            self._cache[name] = self._marker(first), self._marker(second)
        return self._cache[name]  # type: ignore[no-any-return]

    def triads(self, axis: str, zero: str) -> tuple[Triad, Triad]:
        """Return the triads of the two markers of a joint."""
        key = f"triads {axis}"
        if key not in self._cache:
            axes = self.entry.values[axis]
            zeros = self.entry.values.get(zero, (None, None))
            self._cache[key] = tuple(self._triad(*pair) for pair in zip(axes, zeros, strict=True))
        return self._cache[key]  # type: ignore[no-any-return]

    def _triad(self, axis: Components, zero: Components | None) -> Triad:
        evaluator = self._evaluator
        direction = evaluator.direction(axis)
        reference = None if zero is None else evaluator.direction(zero)
        if zero is not None and reference is not None and not evaluator.symbolic:
            across = vectors.cross(*(vectors.unit(v, evaluator.f.sqrt) for v in (direction, reference)))
            if not _all(vectors.dot(across, across) > 1e-16):
                evaluator.complain(zero, "zero must not be along the axis")
                reference = None
        return vectors.triad(direction, reference, evaluator.f.sqrt)

    def coordinate(self, name: str) -> int:
        """Return the number of a coordinate."""
        return self._evaluator.coordinate_numbers[self.entry.values[name]]

    def joint(self, name: str) -> ItemValues:
        """Return the joint that the entry names."""
        return self._joints[self.entry.values[name]]

    def laws(self, name: str) -> tuple[Law, ...]:
        """Return functions of time."""
        value = self.entry.values[name]
        quantities = value.values if isinstance(value, Components) else (value,)
        return tuple(Law(x, self._evaluator.parameters, self._evaluator.f) for x in quantities)

    def law(self, name: str) -> Law:
        """Return a function of time."""
        return self.laws(name)[0]
