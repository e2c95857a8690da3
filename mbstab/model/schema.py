"""What a model file says once it is read: expressions with their places, nothing evaluated yet."""

from __future__ import annotations

import re
from collections.abc import Container
from decimal import Decimal
from fractions import Fraction
from typing import Any

from mbstab.errors import Location
from mbstab.mechanics import bodies
from mbstab.mechanics.catalogue import Kind, Sign
from mbstab.model.arithmetic import as_float
from mbstab.model.expressions import Expression, ExpressionError, parse
from mbstab.model.functions import TABULATED
from mbstab.model.hermite import OutsideTable, monotone_slopes, no_slopes, spline_slopes
from mbstab.model.units import behind_number, per_second
from mbstab.model.yamlfile import Document
from mbstab.records import dataclass


@dataclass(frozen=True)
class Quantity(Expression):
    """An expression of a model file that knows where it stands."""

    location: Location
    path: str


def constant(text: str, location: Location, path: str) -> Quantity:
    """Return a number that the file leaves out, with the place where it would stand."""
    return Quantity(text, parse(text).root, location, path)


_NOT_FINITE = re.compile(r"[-+]?\.?(nan|inf|infinity)", re.IGNORECASE)


def parse_finite(text: str, parameters: Container[str]) -> Expression:
    """Read an expression; words such as ``nan`` and ``inf`` are refused by name.

    Raises
    ------
    ExpressionError
        If the text is not an expression.
    """
    if _NOT_FINITE.fullmatch(text) and text not in parameters:
        raise ExpressionError(f"{text!r} is not a number", 0, "values must be finite")
    try:
        return parse(text)
    except ExpressionError as error:
        raise behind_number(text) or error from None


@dataclass(frozen=True)
class Components:
    """A vector or a tensor of a model file: its components, and where the whole stands."""

    values: tuple[Quantity, ...]
    location: Location
    path: str


@dataclass(frozen=True)
class Given:
    """What a question says about a parameter, instead of the file.

    Attributes
    ----------
    setting : int, float or str
        As it was given.
    ends : tuple of (Expression, str or None)
        The value, or both ends of an interval: an expression and the unit in which it counts; None: an expression in SI
        of the values that the file gives to parameters.
    """

    setting: int | float | str
    ends: tuple[tuple[Expression, str | None], ...]


@dataclass(frozen=True)
class Parameter:
    """A named number; `factor` turns its declared unit into SI, `sign` says which values it may have.

    Where a question gives it another value (`given`), the expression of the file does not count.
    """

    name: str
    expression: Quantity
    location: Location
    unit: str = ""
    factor: float = 1.0
    description: str = ""
    sign: Sign = "any"
    given: Given | None = None


@dataclass(frozen=True)
class MarkerValue:
    """A point of a body (None: the ground) in the body's frame."""

    body: str | None
    point: Components


@dataclass(frozen=True)
class MeasureValue:
    """A measure in an expression (`mbstab.mechanics.measures`): the joint or the points and bodies that it names."""

    kind: str
    joint: str | None
    points: tuple[MarkerValue, ...]


@dataclass(frozen=True)
class ShapeValue:
    """A homogeneous shape with its lengths; `along` is the number of its axis or None, `reversed`: it points back."""

    kind: bodies.ShapeKind
    lengths: dict[str, Quantity]
    along: int | None
    reversed: bool = False


@dataclass(frozen=True)
class PartValue:
    """A shape with its own place, and a mass unless it is only drawn."""

    mass: Quantity | None
    shape: ShapeValue
    place: Components


@dataclass(frozen=True)
class Entry:
    """One body, joint, contact, drive, force or constraint."""

    section: str
    name: str
    kind: Kind
    values: dict[str, Any]
    location: Location
    places: dict[str, Location]

    @property
    def path(self) -> str:
        """Return where it stands, such as ``joints.pivot``."""
        return f"{self.section}.{self.name}"

    @property
    def called(self) -> str:
        """Return what messages call it, such as ``joint 'pivot'``."""
        return f"{entry_word(self.section)} {self.name!r}"

    @property
    def own_state(self) -> str | None:
        """Return the name of its own first-order state, if it has one."""
        state = self.kind.state
        return f"{self.name}_{state.suffix}" if state is not None and state.field in self.values else None

    @property
    def equations(self) -> dict[str, Expression]:
        """Return the equations that the file itself gives (`Kind.written`): forces by coordinate, others by role."""
        if self.kind.written is None:
            return {}
        keys = ("on", "rate", "energy", "function", self.kind.written)
        value = next(self.values[key] for key in keys if key in self.values)
        return value if isinstance(value, dict) else {self.kind.written: value}

    @property
    def load(self) -> tuple[str, Expression] | None:
        """Return the one motion along which the effort that the file itself gives acts, and that effort."""
        loads = self.values.get("on") if self.kind.written == "force" else None
        return next(iter(loads.items())) if isinstance(loads, dict) and len(loads) == 1 else None

    @property
    def has_effort(self) -> bool:
        """Whether it acts along one motion, so that it has an effort, a force or a torque."""
        return self.kind.effort is not None or self.load is not None

    @property
    def has_reaction(self) -> bool:
        """Whether it transmits a force or a torque between bodies, or from the ground."""
        return self.section != "states" and (self.section != "forces" or self.kind.transmits)

    def expressions(self) -> list[Expression]:
        """Return its expressions, of which those of its equations and of some of its numbers contain coordinates."""
        return [x for x in (*self.equations.values(), *self.values.values()) if isinstance(x, Expression)]


@dataclass(frozen=True)
class Steady:
    """A motion that follows a turn about an axis, a translation, or both; a rate that is not given is solved for."""

    location: Location
    axis: Components | None
    rate: Quantity | None
    point: Components | None
    direction: Components | None
    speed: Quantity | None


@dataclass(frozen=True)
class LeftOut:
    """A constraint row that repeats others and contradicts them by little: section, name and number, and a warning."""

    row: tuple[str, str, int]
    text: str


@dataclass(frozen=True)
class Reference:
    """The reference motion: what is given, and guesses for what is not, by name such as ``rod.theta``.

    `guess_rates` are those of a steady motion that is looked for.

    `find` is ``equilibrium``, ``steady`` or None; `period` is that of a periodic motion; rows that repeat others may
    contradict them by less than the `closure_tolerance` (m).
    """

    location: Location
    time: Quantity
    coordinates: dict[str, Quantity]
    rates: dict[str, Quantity]
    guess: dict[str, Quantity]
    find: str | None
    steady: Steady | None
    period: Quantity | None
    guess_rates: dict[str, Quantity]
    closure_tolerance: Quantity | None


@dataclass(frozen=True)
class Initial:
    """Where a simulation starts, by name such as ``rod.theta``; a time of None is that of the reference."""

    location: Location
    time: Quantity | None
    coordinates: dict[str, Quantity]
    rates: dict[str, Quantity]


@dataclass(frozen=True)
class SweepRange:
    """Default range of a parameter."""

    start: Quantity
    stop: Quantity
    points: int


@dataclass(frozen=True)
class ModeName:
    """The name of a mode: near an eigenvalue (1/s), or similar to a shape, at these parameters.

    `shape` holds complex amplitudes (m, rad) of coordinates and motions of joints, such as ``angle(pivot)``.
    """

    name: str
    location: Location
    at: dict[str, Quantity]
    near: complex | None
    shape: dict[str, complex]

    @property
    def called(self) -> str:
        """Return what messages call it, with its place."""
        return f"{self.location}: mode {self.name!r}"


@dataclass(frozen=True)
class ExpectedEigenvalue:
    """Real and imaginary part; a conjugate pair if the imaginary part is not zero."""

    real: Quantity
    imag: Quantity


@dataclass(frozen=True)
class CriticalValue:
    """A parameter value at which the verdict changes, in the unit of the parameter."""

    parameter: str
    value: Quantity
    tolerance: float
    below: str
    above: str
    location: Location


@dataclass(frozen=True)
class Expectation:
    """One entry of ``expect``: at these parameters, this answer."""

    location: Location
    at: dict[str, Quantity]
    eigenvalues: tuple[ExpectedEigenvalue, ...] | None
    tolerance: float
    neutral: int | None
    frozen: bool
    coordinates: dict[str, Quantity]
    redundant: int | None
    verdict: str | None
    critical: CriticalValue | None
    source: str


@dataclass(frozen=True)
class TableValue:
    """A function given by points; `file` is the name of the file that they come from, if they do."""

    x: tuple[Decimal, ...]
    y: tuple[Decimal, ...]
    location: Location
    file: str = ""

    def points(self, function: str) -> tuple[str, ...]:
        """Return x, y and slope of each point for a function of `mbstab.model.functions.TABULATED`."""
        slopes = {"table": monotone_slopes, "spline": spline_slopes, "linear": no_slopes}[function]
        found = slopes([Fraction(x) for x in self.x], [Fraction(y) for y in self.y])
        return tuple(str(number) for row in zip(self.x, self.y, found, strict=True) for number in row)


@dataclass(frozen=True)
class Model:
    """Everything a model file says.

    Attributes
    ----------
    dimension : int
        2 for a planar scene, 3 for a spatial one.
    parameters : dict
        With what a question gives some of them (`mbstab.model.parameters.bound`).
    order : tuple of str
        Sections in the order of the file; constraint rows follow it.
    ground : dict
        Named points of the ground.
    measures : dict
        What the measures in expressions name, by the measure, such as ``angle(pivot)``.
    definitions : dict
        Named expressions, as they are written; all others have them in the place of their names.
    state_units : dict
        Units of the first-order states that have one.
    left_out : tuple of LeftOut
        Rows that are no constraints.
    """

    document: Document
    dimension: int
    order: tuple[str, ...]
    title: str
    source: str
    parameters: dict[str, Parameter]
    gravity: Components
    ground: dict[str, Components]
    bodies: dict[str, Entry]
    entries: dict[str, dict[str, Entry]]
    inputs: dict[str, Entry]
    outputs: dict[str, Quantity]
    reference: Reference
    initial: Initial
    sweep: dict[str, SweepRange]
    modes: tuple[ModeName, ...]
    expect: tuple[Expectation, ...]
    measures: dict[str, MeasureValue]
    definitions: dict[str, Expression]
    tables: dict[str, TableValue]
    state_units: dict[str, str]
    left_out: tuple[LeftOut, ...] = ()

    @property
    def name(self) -> str:
        """Return what messages call the file."""
        return self.document.name

    def with_table(self, error: Exception) -> Exception:
        """Return an error that names the table which was left; another error as it is."""
        if not isinstance(error, OutsideTable):
            return error
        known = ((name, x.points(function)) for name, x in self.tables.items() for function in TABULATED)
        name = next(name for name, points in known if tuple(map(as_float, points)) == error.points)
        return OutsideTable(error.x, error.points, name)

    def table_hint(self, error: Exception) -> str:
        """Return what to do where a table was left, given the error that names it; nothing for another error."""
        if not isinstance(error, OutsideTable):
            return ""
        table = self.tables[error.name]
        place = f"{table.file}, {table.location}" if table.file else str(table.location)
        return f"hint: give the table {error.name!r} ({place}) more points, or saturate(...) its argument"

    @property
    def settings(self) -> dict[str, int | float | str]:
        """Return what a question says about parameters, as it was given."""
        return {name: x.given.setting for name, x in self.parameters.items() if x.given is not None}

    def coordinates(self) -> list[str]:
        """Return the names of the coordinates in the order of q, such as ``rod.theta``; the states come last."""
        placed = [f"{name}.{c}" for name, body in self.bodies.items() for c in body_coordinates(body)]
        return [*placed, *self.states]

    def unit_of(self, coordinate: str, order: int = 0) -> str:
        """Return the SI unit of a coordinate or of a time derivative of it; 1 for a state whose unit nothing says."""
        return per_second(self.state_units.get(coordinate, "1") if is_state(coordinate) else unit_of(coordinate), order)

    def unit_of_solved(self, name: str) -> str:
        """Return the SI unit of a coordinate or of its rate, ``rate(rod.theta)``."""
        coordinate = name.removeprefix("rate(").removesuffix(")")
        return self.unit_of(coordinate, int(coordinate != name))

    @property
    def states(self) -> dict[str, Entry]:
        """Return the first-order states."""
        return self.entries["states"]


def entry_word(section: str) -> str:
    """Return what messages call an entry of a section, such as ``joint``."""
    return "body" if section == "bodies" else section.removesuffix("s")


def owner_of_point(body: str | None) -> str:
    """Return what messages call a body, or the ground."""
    return "the ground" if body is None else f"the body {body!r}"


def body_coordinates(body: Entry) -> tuple[str, ...]:
    """Return the names of the coordinates of a body."""
    return bodies.BODY_COORDINATES[body.kind.name]


def is_length(coordinate: str) -> bool:
    """Whether a coordinate such as ``rod.x`` is a length; the others are angles and states."""
    return coordinate.rpartition(".")[1:] in ((".", "x"), (".", "y"), (".", "z"))


def is_state(coordinate: str) -> bool:
    """Whether a coordinate is a first-order state, which belongs to no body."""
    return "." not in coordinate


def is_angle(coordinate: str) -> bool:
    """Whether a coordinate such as ``rod.theta`` is an angle."""
    return not is_length(coordinate) and not is_state(coordinate)


def after_number(unit: str) -> str:
    """Return a unit as it is written after a number: a blank and the unit, or nothing for a plain number."""
    return f" {unit}" if unit not in ("", "1") else ""


def unit_of(coordinate: str) -> str:
    """Return the SI unit of a coordinate of a body: m or rad."""
    return "m" if is_length(coordinate) else "rad"
