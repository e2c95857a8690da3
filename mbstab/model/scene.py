"""A model with numbers: bodies, laws of motion, initial values, entries."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from mbstab.errors import Location
from mbstab.mechanics import vectors
from mbstab.mechanics.catalogue import GROUND, Kind, Marker, Number, Triad, Vector
from mbstab.model.arithmetic import Arithmetic
from mbstab.model.evaluator import Evaluator
from mbstab.model.expressions import ExpressionError
from mbstab.model.jets import Jet, jet_arithmetic
from mbstab.model.numbers import all_of, require_finite
from mbstab.model.schema import (
    Components,
    Entry,
    MarkerValue,
    Model,
    Quantity,
)


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


class ItemValues:
    """An entry with its numbers; the `Item` that `Kind.build` sees."""

    def __init__(self, entry: Entry, evaluator: Evaluator, joints: dict[str, ItemValues]) -> None:
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
                require_finite(value)
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
            if not all_of(vectors.dot(across, across) > 1e-16):
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
