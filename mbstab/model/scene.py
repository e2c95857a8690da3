"""A model with numbers: bodies, laws of motion, initial values, entries."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from functools import cached_property
from typing import Any

from mbstab.errors import Location
from mbstab.mechanics import vectors
from mbstab.mechanics.catalogue import Kind, Marker, Number, Triad, Vector
from mbstab.mechanics.frames import Frame, cross, dot
from mbstab.model.arithmetic import Arithmetic
from mbstab.model.dependencies import expressions_in
from mbstab.model.evaluator import Evaluator
from mbstab.model.expressions import Expression
from mbstab.model.fields.catalogue import given_fields, kind_of
from mbstab.model.numbers import all_of
from mbstab.model.rationals import Rationals
from mbstab.model.schema import (
    Components,
    Entry,
    Model,
)
from mbstab.records import dataclass


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
class SteadyValues:
    """A steady motion with its numbers: unit vectors, rates in rad/s and m/s; None for what is not given."""

    axis: Vector | None
    rate: Number | None
    point: Vector
    direction: Vector | None
    speed: Number | None


@dataclass(frozen=True)
class InitialValues:
    """Where a simulation starts, with numbers: values by coordinate name; a time (s) of None: the reference's."""

    time: Number | None = None
    coordinates: dict[str, Number] = field(default_factory=dict)
    rates: dict[str, Number] = field(default_factory=dict)


@dataclass(frozen=True)
class MeasureNumbers:
    """A measure in an expression: its kind, the numbers of its bodies (`GROUND` is −1), and its own numbers."""

    kind: str
    bodies: tuple[int, ...]
    numbers: Vector


@dataclass(frozen=True)
class BalanceValues:
    """A direction without mass along which forces balance (`mbstab.compiler.balances`).

    Attributes
    ----------
    direction : dict
        Its components, by coordinate name.
    first_order : bool
        Whether the forces along it depend on speeds.
    tied : tuple of (str, int)
        Further coordinates, whose components constraint rows determine, and the number of a row for each, in the order
        in which they are eliminated.
    """

    direction: dict[str, float]
    first_order: bool
    tied: tuple[tuple[str, int], ...] = ()

    @property
    def name(self) -> str:
        """The coordinate after which it is called: that with the largest component."""
        return max(self.direction, key=lambda name: abs(self.direction[name]))

    @property
    def names(self) -> list[str]:
        """The coordinates without mass that it contains."""
        return [*self.direction, *(name for name, _ in self.tied)]


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
    coordinates, rates, guess, guess_rates : dict
        Given values of the reference and starting values, by coordinate name.
    steady : SteadyValues or None
    period : number or None
        Period of a periodic motion (s).
    points : int or None
        Number of points of a sweep, if the numbers are arrays over them.
    lengths : list of float
        Sizes that occur in the scene (m), for scaling tolerances.
    initial : InitialValues
        Where a simulation starts.
    turned : tuple of str
        Bodies whose given angles are singular; theirs count from the given orientation instead (`mbstab.model.charts`).
    measures : dict of MeasureNumbers
        What expressions measure, such as ``angle(pivot)``.
    inputs : tuple of ItemValues
        Signals on the linearized motion, which are zero and so act nowhere else.
    balances : tuple of BalanceValues
        Directions without mass whose balances are constraint rows.
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
    measures: dict[str, MeasureNumbers] = field(default_factory=dict)
    inputs: tuple[ItemValues, ...] = ()
    balances: tuple[BalanceValues, ...] = ()
    guess_rates: dict[str, Number] = field(default_factory=dict)

    @property
    def dimension(self) -> int:
        """2 for a planar scene, 3 for a spatial one."""
        return self.model.dimension

    @cached_property
    def rationals(self) -> Rationals:
        """Which parameters are rational numbers."""
        return Rationals(self.model, self.parameters, self.arithmetic)

    @cached_property
    def written(self) -> list[Expression]:
        """The expressions of all entries but bodies; one of those that share their text."""
        found = (expression for item in self.items for expression in expressions_in(item.entry.values))
        return list({id(expression.root): expression for expression in found}.values())

    @cached_property
    def timed(self) -> bool:
        """Whether anything is a function of the time; a load that is written as numbers is not."""
        moving = [x for item in self.items for _, kind, x in given_fields(item.entry) if kind.moving]
        return any("t" in expression.names() for expression in expressions_in(moving))

    def coordinate_names(self) -> list[str]:
        """Return the names of the coordinates in the order of q."""
        return self.model.coordinates()


class ItemValues:
    """An entry with its numbers; the `Item` that `Kind.build` sees."""

    def __init__(self, entry: Entry, evaluator: Evaluator, others: Mapping[str, ItemValues]) -> None:
        self.entry = entry
        self.name = entry.name
        self.kind: Kind = entry.kind
        self.functions = evaluator.f
        self.dimension = evaluator.model.dimension
        self.evaluator = evaluator
        self._others = others
        self._numbers: dict[str, Any] = {}

    def check(self, time: Number) -> None:
        """Evaluate every field once, so that all problems are found together; functions of time at `time` (s)."""
        for field_, kind, _ in given_fields(self.entry):
            kind.check(self, field_, self.value(field_.name), time)

    def given(self, name: str) -> bool:
        """Whether the field has a value, its own or a default."""
        return name in self.entry.values

    def value(self, name: str) -> Any:
        """Return a field with its numbers, as its kind makes them (`mbstab.model.fields`)."""
        if name not in self._numbers:
            field_ = self.kind.field(name)
            self._numbers[name] = kind_of(field_).numbers(self, field_, self.entry.values[name])
        return self._numbers[name]

    # The names under which the mechanics ask for it say what kind of field they expect.
    number = vector = direction = choice = body = marker = markers = coordinate = joint = contact = law = laws = value

    def joint_named(self, name: str) -> ItemValues:
        """Return the joint of that name."""
        return self._others[f"joints.{name}"]

    def at_reference(self, body: int) -> Frame:
        """Return where a body stands at the reference, as far as the file says: guesses, or 0, where it does not."""
        return self.evaluator.poses[body]

    def contact_named(self, name: str) -> ItemValues:
        """Return the contact of that name."""
        return self._others[f"contacts.{name}"]

    @property
    def state(self) -> int:
        """Number of the coordinate that is its own first-order state."""
        name = self.name if self.entry.section == "states" else self.entry.own_state
        assert name is not None
        return self.evaluator.coordinate_numbers[name]

    def triads(self, axis: str, zero: str) -> tuple[Triad, Triad]:
        """Return the triads of the two markers of a joint."""
        key = f"triads {axis}"
        if key not in self._numbers:
            zeros = self.value(zero) if self.given(zero) else (None, None)
            written = self.entry.values.get(zero, (None, None))
            pairs = zip(self.value(axis), zeros, written, strict=True)
            self._numbers[key] = tuple(self._triad(*pair) for pair in pairs)
        return self._numbers[key]  # type: ignore[no-any-return]

    def _triad(self, axis: Vector, zero: Vector | None, written: Components | None) -> Triad:
        evaluator = self.evaluator
        if zero is not None and written is not None and not evaluator.symbolic:
            across = cross(*(vectors.unit(v, evaluator.f.sqrt) for v in (axis, zero)))
            if not all_of(dot(across, across) > 1e-16):
                evaluator.complain(written, "zero must not be along the axis")
                zero = None
        return vectors.triad(axis, zero, evaluator.f.sqrt)

    def points(self) -> list[Marker]:
        """Return the points of bodies at which the entry itself acts."""
        return [
            marker for field_, kind, _ in given_fields(self.entry) for marker in kind.markers(self.value(field_.name))
        ]

    def points_acted_on(self) -> list[Marker]:
        """Return the points of bodies at which the entry acts, by itself or through the joints that it names."""
        named = (name for _, kind, value in given_fields(self.entry) for name in kind.joints(value))
        return self.points() or [marker for name in named for marker in self.joint_named(name).points_acted_on()]
