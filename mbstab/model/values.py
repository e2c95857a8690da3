"""A model with numbers: parameters evaluated, entries resolved, every number checked.

Values may be floats or arrays over the points of a sweep; the checks then hold for all points.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from mbstab.errors import Location, ModelFileError, UsageError, suggestion
from mbstab.mechanics import vectors
from mbstab.mechanics.bodies import combine, shape_moments
from mbstab.mechanics.catalogue import GROUND, Field, Kind, Marker, Number, Triad, Vector
from mbstab.model.arithmetic import FLOAT, Arithmetic, array_arithmetic
from mbstab.model.expressions import Expression, ExpressionError, parse
from mbstab.model.jets import Jet, jet_arithmetic
from mbstab.model.schema import Entry, MarkerValue, Model, PartValue, ShapeValue, StateValues, body_coordinates


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

    expression: Expression
    names: Mapping[str, Number]
    arithmetic: Arithmetic
    location: Location
    path: str

    def at(self, time: Number) -> Jet:
        """Return value, first and second derivative at a time (s)."""
        names = {**self.names, "t": Jet(time, 1.0, 0.0)}
        return Jet.of(self.expression.evaluate(names, jet_arithmetic(self.arithmetic)))


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
    lengths : list of float
        Sizes that occur in the scene (m), for scaling tolerances.
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
    lengths: list[float] = field(default_factory=list)

    @property
    def dimension(self) -> int:
        """2 for a planar scene, 3 for a spatial one."""
        return self.model.dimension

    def coordinate_names(self) -> list[str]:
        """Return the names of the coordinates in the order of q."""
        return self.model.coordinates()


def parse_overrides(model: Model, settings: Mapping[str, Number | str]) -> dict[str, Number]:
    """Return parameter values in SI for settings such as ``{"omega": "2*pi"}``.

    A plain number counts in the declared unit of the parameter; an expression may use the
    other parameters' values in the file and counts in SI.

    Raises
    ------
    UsageError
        If a parameter is unknown or the value is no finite number.
    """
    nominal: dict[str, Number] = {}
    result: dict[str, Number] = {}
    for name, setting in settings.items():
        parameter = model.parameters.get(name)
        if parameter is None:
            hint = suggestion(name, model.parameters) or "parameters: " + (", ".join(model.parameters) or "none")
            raise UsageError(f"{model.name} has no parameter {name!r}\nhint: {hint}")
        if not isinstance(setting, str):
            result[name] = setting * parameter.factor
            continue
        try:
            expression = parse(setting)
            if expression.literal:
                value = expression.evaluate({}, FLOAT) * parameter.factor
            else:
                nominal = nominal or evaluate_parameters(model, {}, FLOAT)
                for used in expression.names():
                    if used not in nominal:
                        raise ExpressionError(f"unknown parameter {used!r}", 0, suggestion(used, nominal))
                value = expression.evaluate(nominal, FLOAT)
        except ExpressionError as error:
            hint = f"\nhint: {error.hint}" if error.hint else ""
            raise UsageError(f"{name}={setting}: {error.message}{hint}") from None
        if not math.isfinite(value):
            raise UsageError(f"{name}={setting}: the value is not finite")
        result[name] = value
    return result


def evaluate_parameters(model: Model, overrides: Mapping[str, Number], arithmetic: Arithmetic) -> dict[str, Number]:
    """Return the value of every parameter in SI, with some of them replaced."""
    values: dict[str, Number] = {}
    document = model.document
    for name, parameter in model.parameters.items():
        if name in overrides:
            values[name] = overrides[name]
            continue
        try:
            value = parameter.expression.evaluate(values, arithmetic) * parameter.factor
            if not _finite(value):
                raise ExpressionError("the value is not finite")
            values[name] = value
        except ExpressionError as error:
            document.problems.clear()
            document.complain(parameter.location, f"parameters.{name}", error.message)
            problems = list(document.problems)
            document.problems.clear()
            raise ModelFileError(problems) from None
    return values


def evaluate(model: Model, overrides: Mapping[str, Number] | None = None, arithmetic: Arithmetic | None = None) -> Scene:
    """Return the scene at the given parameter values (SI).

    Raises
    ------
    ModelFileError
        With every number that is out of range, at its place in the file.
    """
    overrides = overrides or {}
    if arithmetic is None:
        arithmetic = array_arithmetic() if any(hasattr(v, "shape") for v in overrides.values()) else FLOAT
    return _Evaluator(model, evaluate_parameters(model, overrides, arithmetic), arithmetic).scene()


def _finite(value: Number) -> bool:
    if hasattr(value, "shape"):
        import numpy as np

        return bool(np.all(np.isfinite(value)))
    return not isinstance(value, float) or math.isfinite(value)


def _all(condition: Any) -> bool:
    return bool(condition.all()) if hasattr(condition, "all") else bool(condition)


class _Evaluator:
    def __init__(self, model: Model, parameters: dict[str, Number], arithmetic: Arithmetic) -> None:
        self.model = model
        self.parameters = parameters
        self.f = arithmetic
        self.symbolic = arithmetic.name == "symbol"
        self.problems_before = len(model.document.problems)
        self.lengths: list[float] = []
        self.body_numbers = {name: i for i, name in enumerate(model.bodies)}
        self.coordinate_numbers = {name: i for i, name in enumerate(model.coordinates())}

    def scene(self) -> Scene:
        model, document = self.model, self.model.document
        document.problems.clear()
        gravity = tuple(self.number(x, model.gravity_location, "gravity") for x in model.gravity)
        bodies = tuple(self.body(entry) for entry in model.bodies.values())
        items: list[ItemValues] = []
        resolved: dict[str, ItemValues] = {}
        for section in model.order:
            for entry in model.entries[section].values():
                items.append(ItemValues(entry, self, resolved))
                if section == "joints":
                    resolved[entry.name] = items[-1]
        for item in items:
            item.check()
        reference = model.reference
        scene = Scene(
            model,
            self.f,
            self.parameters,
            gravity,
            bodies,
            items,
            self.number(reference.time, reference.location, "reference.time"),
            self.state(reference.coordinates, "reference.coordinates"),
            self.state(reference.rates, "reference.rates"),
            self.state(reference.guess, "reference.guess"),
            self.lengths,
        )
        problems = list(document.problems)
        document.problems.clear()
        if problems:
            raise ModelFileError(problems)
        return scene

    def complain(self, location: Location, path: str, message: str, hint: str = "") -> None:
        self.model.document.complain(location, path, message, hint)

    def number(self, expression: Expression, location: Location, path: str, field: Field | None = None) -> Number:
        try:
            value = expression.evaluate(self.parameters, self.f)
        except ExpressionError as error:
            self.complain(location, path, error.message)
            return 1.0
        if self.symbolic:
            return value
        if not _finite(value):
            self.complain(location, path, f"the value of {expression.text!r} is not finite")
            return 1.0
        if field is not None:
            self._check_sign(value, location, path, field)
            if field.unit == "m" and not hasattr(value, "shape"):
                self.lengths.append(abs(value))
        return value

    def _check_sign(self, value: Number, location: Location, path: str, field: Field) -> None:
        unit = f" {field.unit}" if field.unit not in ("", "1") else ""
        rules = {"positive": value > 0, "nonnegative": value >= 0, "nonzero": value != 0}
        words = {"positive": "be positive", "nonnegative": "not be negative", "nonzero": "not be zero"}
        if field.sign in rules and not _all(rules[field.sign]):
            shown = f"{value:g}" if not hasattr(value, "shape") else f"{value[~rules[field.sign]][0]:g}"
            self.complain(location, path, f"{field.name.replace('_', ' ')} must {words[field.sign]}, got {shown}{unit}")

    def vector(self, expressions: tuple[Expression, ...], location: Location, path: str, length: bool = False) -> Vector:
        values = tuple(self.number(x, location, path) for x in expressions)
        if length and not self.symbolic:
            self.lengths += [abs(x) for x in values if not hasattr(x, "shape")]
        return values

    def state(self, values: StateValues, path: str) -> dict[str, Number]:
        return {name: self.number(x, values.places[name], f"{path}.{name}") for name, x in values.values.items()}

    # --- bodies -----------------------------------------------------------------------------------------------------

    def body(self, entry: Entry) -> BodyValues:
        dimension = self.model.dimension
        coordinates = body_coordinates(entry)
        orientation = len(coordinates) > dimension
        base: Vector = tuple(float(i == j) for i in range(3) for j in range(3)) if dimension == 3 else ()
        size = 1 if dimension == 2 else 6
        if not orientation:
            mass = self.number(entry.values["mass"], entry.places["mass"], f"{entry.path}.mass", entry.kind.field("mass"))
            return BodyValues(entry.name, entry.location, False, mass, (0.0,) * size, (0.0,) * dimension, base, coordinates)
        for key in ("points", "directions"):
            for name, point in entry.values.get(key, {}).items():
                self.vector(point, entry.places[key], f"{entry.path}.{key}.{name}", key == "points")
        mass, center, inertia = self._distribution(entry)
        if "axes" in entry.values:
            angles = self.vector(entry.values["axes"], entry.places["axes"], f"{entry.path}.axes")
            base = euler_matrix(angles, self.f)
        return BodyValues(entry.name, entry.location, True, mass, inertia, center, base, coordinates)

    def _distribution(self, entry: Entry) -> tuple[Number, Vector, Vector]:
        dimension, values = self.model.dimension, entry.values
        if "parts" in values:
            place = entry.places["parts"]
            parts = [self._part(part, place, f"{entry.path}.parts[{i}]") for i, part in enumerate(values["parts"])]
            total, center, inertia = combine(parts, dimension)
            self._check_inertia(inertia, place, f"{entry.path}.parts")
            return total, center, inertia
        mass = self.number(values["mass"], entry.places["mass"], f"{entry.path}.mass", entry.kind.field("mass"))
        center = (0.0,) * dimension
        if "center_of_mass" in values:
            center = self.vector(values["center_of_mass"], entry.places["center_of_mass"], f"{entry.path}.center_of_mass", True)
        if "shape" in values:
            place, path = entry.places["shape"], f"{entry.path}.shape"
            moments = self._moments(values["shape"], mass, place, path)
            return mass, center, moments[2:] if dimension == 2 else (*moments, 0.0, 0.0, 0.0)
        place = entry.places["inertia"]
        inertia = self.vector(values["inertia"], place, f"{entry.path}.inertia")
        self._check_inertia(inertia, place, f"{entry.path}.inertia")
        return mass, center, inertia

    def _part(self, part: PartValue, place: Location, path: str) -> tuple[Number, Vector, Vector]:
        mass_field = Field("mass", "number", "", "kg", sign="positive")
        mass = self.number(part.mass, place, f"{path}.mass", mass_field)
        return mass, self.vector(part.place, place, f"{path}.at", True), self._moments(part.shape, mass, place, path)

    def _moments(self, shape: ShapeValue, mass: Number, place: Location, path: str) -> Vector:
        lengths = tuple(self.number(shape.lengths[f.name], place, f"{path}.{f.name}", f) for f in shape.kind.fields)
        return shape_moments(shape.kind, lengths, mass, shape.along)

    def _check_inertia(self, inertia: Vector, place: Location, path: str) -> None:
        """A rigid body's principal moments are not negative, and none exceeds the sum of the other two."""
        if self.symbolic:
            return
        if len(inertia) == 1:
            if not _all(inertia[0] >= 0):
                self.complain(place, path, f"inertia must not be negative, got {_nominal(inertia[0]):g} kg*m^2")
            return
        import numpy as np

        xx, yy, zz, xy, xz, yz = np.broadcast_arrays(*(np.asarray(x, dtype=float) for x in inertia))
        tensor = np.stack([np.stack([xx, xy, xz], -1), np.stack([xy, yy, yz], -1), np.stack([xz, yz, zz], -1)], -2)
        moments = np.linalg.eigvalsh(tensor)
        slack = 1e-12 * np.abs(moments).max(axis=-1)
        low, middle, high = (moments[..., i] for i in range(3))
        shown = ", ".join(f"{x:g}" for x in moments.reshape(-1, 3)[0])
        if not np.all(low >= -slack):
            self.complain(place, path, f"inertia must be positive: its principal moments are {shown} kg*m^2")
        elif not np.all(low + middle >= high - slack):
            hint = "no principal moment of a body exceeds the sum of the other two"
            self.complain(place, path, f"impossible inertia: its principal moments are {shown} kg*m^2", hint)


def _nominal(x: Number) -> float:
    return float(x.flat[0]) if hasattr(x, "flat") else float(x)


def euler_matrix(angles: Vector, f: Any) -> Vector:
    """Return Ax(φ) Ay(θ) Az(ψ), row by row; Eqs. (120)-(122) of Pappalardo, Lettieri, Guida (2020)."""
    (c1, s1), (c2, s2), (c3, s3) = ((f.cos(x), f.sin(x)) for x in angles)
    return (
        c2 * c3, -c2 * s3, s2,
        c1 * s3 + s1 * s2 * c3, c1 * c3 - s1 * s2 * s3, -s1 * c2,
        s1 * s3 - c1 * s2 * c3, s1 * c3 + c1 * s2 * s3, c1 * c2,
    )  # fmt: skip


class ItemValues:
    """An entry with its numbers; the `Item` that `Kind.build` sees."""

    def __init__(self, entry: Entry, evaluator: _Evaluator, joints: dict[str, ItemValues]) -> None:
        self.entry = entry
        self.name = entry.name
        self.kind: Kind = entry.kind
        self.dimension = evaluator.model.dimension
        self._evaluator = evaluator
        self._joints = joints
        self._cache: dict[str, Any] = {}

    def _place(self, name: str) -> Location:
        return self.entry.places.get(name, self.entry.location)

    def _path(self, name: str) -> str:
        return f"{self.entry.path}.{name}"

    def check(self) -> None:
        """Evaluate every field once, so that all problems are found together."""
        for field_ in self.kind.fields:
            if not self.given(field_.name):
                continue
            match field_.shape:
                case "number":
                    self.number(field_.name)
                case "vector":
                    vector = self.vector(field_.name)
                    if field_.name in ("normal", "direction"):
                        self._check_direction(vector, field_.name)
                case "direction":
                    self._check_direction(self._values(field_.name), field_.name)
                case "directions":
                    for part in self.entry.values[field_.name]:
                        self._check_direction(self._evaluator.vector(part, self._place(field_.name), self._path(field_.name)), field_.name)
                case "marker":
                    self.marker(field_.name)
                case "markers":
                    self.markers(field_.name)
                case "law" | "law vector":
                    for law in self.laws(field_.name):
                        self._check_law(law)

    def _check_direction(self, vector: Vector, name: str) -> None:
        if self._evaluator.symbolic:
            return
        if not _all(sum(x * x for x in vector) > 0):
            self._evaluator.complain(self._place(name), self._path(name), f"{name} must not be the zero vector")
            self._cache[name] = (1.0,) + (0.0,) * (self.dimension - 1)

    def _check_law(self, law: Law) -> None:
        try:
            jet = law.at(self._evaluator.parameters.get("t", 0.0))
        except ExpressionError as error:
            # A law may have no value at t = 0 if the reference stands at another time.
            if not self._evaluator.symbolic and not law.expression.names().keys() & {"t"}:
                self._evaluator.complain(law.location, law.path, error.message)
            return
        if not self._evaluator.symbolic and not _finite(jet.value):
            self._evaluator.complain(law.location, law.path, "the value is not finite")

    def given(self, name: str) -> bool:
        """Whether the field has a value, its own or a default."""
        return name in self.entry.values

    def _values(self, name: str) -> Vector:
        if name not in self._cache:
            length = self.kind.field(name).unit == "m"
            self._cache[name] = self._evaluator.vector(self.entry.values[name], self._place(name), self._path(name), length)
        return self._cache[name]  # type: ignore[no-any-return]

    def number(self, name: str) -> Number:
        """Return a number of the entry."""
        if name not in self._cache:
            field_ = self.kind.field(name)
            self._cache[name] = self._evaluator.number(self.entry.values[name], self._place(name), self._path(name), field_)
        return self._cache[name]

    def vector(self, name: str) -> Vector:
        """Return a vector in ground axes, as written."""
        return self._values(name)

    def unit_vector(self, name: str) -> Vector:
        """Return a vector in ground axes with length 1."""
        return vectors.unit(self._values(name), self._evaluator.f.sqrt)  # type: ignore[attr-defined]

    def direction(self, name: str) -> Vector:
        """Return a unit vector in the frame of the entry's body."""
        return self.unit_vector(name)

    def choice(self, name: str) -> str:
        """Return a word."""
        return str(self.entry.values[name])

    def body(self, name: str) -> int:
        """Return the number of a body."""
        return self._evaluator.body_numbers[self.entry.values[name]]

    def _marker(self, value: MarkerValue, name: str) -> Marker:
        body = GROUND if value.body is None else self._evaluator.body_numbers[value.body]
        return Marker(body, self._evaluator.vector(value.point, self._place(name), self._path(name), True))

    def marker(self, name: str) -> Marker:
        """Return a point of a body."""
        if name not in self._cache:
            self._cache[name] = self._marker(self.entry.values[name], name)
        return self._cache[name]  # type: ignore[no-any-return]

    def markers(self, name: str) -> tuple[Marker, Marker]:
        """Return two points."""
        if name not in self._cache:
            first, second = self.entry.values[name]
            self._cache[name] = self._marker(first, name), self._marker(second, name)
        return self._cache[name]  # type: ignore[no-any-return]

    def triads(self, axis: str, zero: str) -> tuple[Triad, Triad]:
        """Return the triads of the two markers of a joint."""
        key = f"triads {axis}"
        if key not in self._cache:
            axes = self.entry.values[axis]
            zeros = self.entry.values.get(zero, (None, None))
            self._cache[key] = tuple(self._triad(a, z, axis, zero) for a, z in zip(axes, zeros, strict=True))
        return self._cache[key]  # type: ignore[no-any-return]

    def _triad(self, axis: tuple[Expression, ...], zero: tuple[Expression, ...] | None, axis_name: str, zero_name: str) -> Triad:
        evaluator = self._evaluator
        direction = evaluator.vector(axis, self._place(axis_name), self._path(axis_name))
        reference = None if zero is None else evaluator.vector(zero, self._place(zero_name), self._path(zero_name))
        if reference is not None and not evaluator.symbolic:
            across = vectors.cross(direction, reference)
            size = vectors.dot(direction, direction) * vectors.dot(reference, reference)
            if not _all(vectors.dot(across, across) > 1e-16 * size):
                evaluator.complain(self._place(zero_name), self._path(zero_name), "zero must not be along the axis")
                reference = None
        return vectors.triad(direction, reference, evaluator.f.sqrt)  # type: ignore[attr-defined]

    def coordinate(self, name: str) -> int:
        """Return the number of a coordinate."""
        return self._evaluator.coordinate_numbers[self.entry.values[name]]

    def joint(self, name: str) -> ItemValues:
        """Return the joint that the entry names."""
        joint = self.entry.values[name]
        if joint not in self._joints:  # drives may stand before joints in the file
            entry = self._evaluator.model.entries["joints"][joint]
            self._joints[joint] = ItemValues(entry, self._evaluator, self._joints)
        return self._joints[joint]

    def laws(self, name: str) -> tuple[Law, ...]:
        """Return functions of time."""
        value = self.entry.values[name]
        expressions = value if isinstance(value, tuple) else (value,)
        e = self._evaluator
        return tuple(Law(x, e.parameters, e.f, self._place(name), self._path(name)) for x in expressions)

    def law(self, name: str) -> Law:
        """Return a function of time."""
        return self.laws(name)[0]
