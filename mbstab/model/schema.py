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
from mbstab.model.units import UNITS, behind_number, per_second
from mbstab.model.words import WORDS
from mbstab.model.yamlfile import Document
from mbstab.records import dataclass

VERSION = "1"

SECTIONS: dict[str, str] = {
    "mbstab": "version of the file format; write 1",
    "title": "one line that names the system",
    "source": "where the model and its expected values come from",
    "counts": "named whole numbers, for which <NAME> stands in names and values",
    "repeat": "blocks of sections that are read once for each value of an index: {for: {i: [1, 10]}, bodies: …}; "
    "<i>, <i - 1> and <2*i> stand for numbers in their names and values",
    "include": "parts from other files: {file, prefix, with}; their names get the prefix",
    "needs": "names that a part takes from the file that includes it, each with a description; only in parts",
    "parameters": "named numbers: value, or {value, unit, sign, description}; values may be expressions of others",
    "tables": "functions given by points, by name, that table(x, NAME), spline(x, NAME) and linear(x, NAME) evaluate",
    "definitions": "named expressions of parameters, coordinates, measures, states and t that all others may use, but "
    "those of parameters",
    "gravity": "acceleration of gravity, a vector in ground axes (m/s^2); without it there is none",
    "ground": "named points and directions of the ground",
    "bodies": "the bodies, by name",
    "joints": "the joints, by name",
    "contacts": "contacts with fixed lines and planes, by name",
    "drives": "motions given as functions of time, by name",
    "forces": "springs, dampers, forces and torques, by name",
    "inputs": "signals that act on the linearized motion, by name; none of them changes the reference motion",
    "constraints": "constraints written as expressions, by name: {holonomic: …} or {nonholonomic: …}",
    "states": "first-order states (filters, lags, integrals, currents), by name: {rate: expression}",
    "outputs": "what is measured of the motion, by name: expressions of coordinates, measures, "
    "their rate(...) and acceleration(...), and force(joint.x), torque(joint.z), effort(name)",
    "reference": "the motion whose stability is asked for: coordinates and rates by body",
    "initial": "where mbstab simulate starts: coordinates and rates by body; the others are those of the reference",
    "sweep": "default ranges of parameters: {from, to, points}",
    "modes": "names of modes: {near: eigenvalue} or {shape: motions}, each with {at: parameter values}",
    "expect": "what the answer must be, checked by mbstab test",
}
"""Keys at the top of a model file."""


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


SIGNS: tuple[Sign, ...] = ("positive", "nonnegative", "nonzero")
PARAMETER_FIELDS = {
    "value": "number or expression",
    "unit": "unit of the value: a product or quotient of " + ", ".join(UNITS) + "; Hz counts turns",
    "sign": "values it may have, also with --set and in a sweep; any if not given: one of " + ", ".join(SIGNS),
    "description": "what it is",
}
REFERENCE_FIELDS = {
    "time": "time at which the motion is looked at, 0 if not given (s)",
    "coordinates": "values by body: {body: {x: …}}; missing ones are solved from the constraints",
    "rates": "time derivatives by body; missing ones are solved from the constraints",
    "guess": "starting values for coordinates that are solved; choose between assemblies with them; under rates: "
    "those of a steady motion that is looked for, such as its direction of travel",
    "find": "equilibrium or steady: coordinates that are not given are solved so that the forces balance",
    "steady": "the motion is a steady turn about an axis, a steady translation, or both",
    "period": "period of a periodic motion, judged by its Floquet multipliers (s)",
    "closure_tolerance": "rows that repeat others and contradict them by less are left out, with a warning (m)",
}
INITIAL_FIELDS = {
    "time": "time at which the simulation starts, that of the reference if not given (s)",
    "coordinates": "values by body: {body: {x: …}}; others are those of the reference, moved onto the constraints",
    "rates": "time derivatives by body; others are those of the reference, moved onto the constraints",
}
FINDS = ("equilibrium", "steady")
STEADY_FIELDS = {
    "axis": "axis of the turn in ground axes: x, -z or a vector; in the plane z",
    "rate": "rate of the turn; solved for if not given; 0 if only bodies spin about their own axes (rad/s)",
    "point": "a point of the axis, the origin if not given (m)",
    "direction": "direction of the translation in ground axes",
    "speed": "speed of the translation; solved for if not given (m/s)",
}
SWEEP_FIELDS = {"from": "first value", "to": "last value", "points": "number of points"}
MODE_FIELDS = {
    "near": "the eigenvalue it is nearest to, such as -0.3+4.4i (1/s)",
    "shape": "coordinates (m, rad) and motions of joints, {body.phi: 1, angle(joint): 0.5 ∠ -30}, phases in degrees",
    "at": "parameter values at which it is found, those of the file if not given; followed from there: {v: 5}",
}
EXPECT_FIELDS = {
    "at": "parameter values: {omega: 4}",
    "eigenvalues": "all that are not neutral: {real, imag}; an entry with imag stands for the conjugate pair",
    "tolerance": "relative, for eigenvalues (zeros: within their bounds) and coordinates (against at least 1 m, 1 rad)",
    "neutral": "number of neutral eigenvalues: zeros, and the imaginary pairs that shifts become in a turning frame",
    "frozen": "true: eigenvalues of the equations frozen at the reference time, as mbstab eig --frozen",
    "coordinates": "coordinates of the reference motion, by body: {body: {x: …}}",
    "redundant": "number of redundant constraint rows",
    "verdict": "one of " + ", ".join(WORDS),
    "critical": "{parameter, value, tolerance, below, above}: where the verdict changes, and from what to what",
    "source": "where the expected values come from",
}
CRITICAL_FIELDS = {
    "parameter": "name of the parameter",
    "value": "value at which the verdict changes",
    "tolerance": "relative distance from the value at which both verdicts are checked",
    "below": "verdict below it",
    "above": "verdict above it",
}
MARKER_FIELDS = {"body": "name of a body, or ground", "point": "the point in the frame of the body (m)"}
PART_FIELDS = {"mass": "mass of the part (kg)", "at": "its centre in the body frame (m)"}
ALONG = "axis of symmetry of the shape in the body frame: x, y or z; -x, -y or -z turn a cone round"
EIGENVALUE_FIELDS = {"real": "real part (1/s)", "imag": "imaginary part (rad/s)"}
TABLE_FIELDS = {
    "x": "values of the argument, which increase (SI); with file the name of the column, the first if not given",
    "y": "values of the function (SI); with file the name of the column, the second if not given",
    "file": "name of a CSV file beside the model, with the names of its columns in the first line",
}
CURVE_FIELDS = {
    "file": "name of a CSV file beside the model; its first line has rad/s or rpm over the speed, then names of keys",
    "speed": "the speed at which they count, an expression of parameters (rad/s)",
    "function": "table (monotone; used if it is not given), spline or linear, between the speeds of the file",
}
GEOMETRY_FIELDS = {"points": "named points (m)", "directions": "named directions"}
STATE_FIELDS = {
    "rate": "its rate: an expression of coordinates, rates rate(body.x), states, parameters and t",
    "unit": "its unit, such as A, V, m or N, with which its rate and the sums it stands in are checked",
}
CONSTRAINT_FIELDS = {
    "holonomic": "expression of coordinates and t that must be zero",
    "nonholonomic": "expression of coordinates, rates rate(body.x) and t that must be zero",
}


REPEAT_FIELDS = {"for": "indices, each with its first and last value: {i: [1, 10]}; one may use counts: [2, N]"}
INCLUDE_FIELDS = {
    "file": "name of the part, a file in the folder of the model",
    "prefix": "what is put before each of its names",
    "with": "values of its parameters, and names for what it needs",
}


SECTION_FIELDS: dict[str, dict[str, str]] = {
    "repeat": REPEAT_FIELDS,
    "include": INCLUDE_FIELDS,
    "parameters": PARAMETER_FIELDS,
    "tables": TABLE_FIELDS,
    "forces.curves": CURVE_FIELDS,
    "ground": GEOMETRY_FIELDS,
    "constraints": CONSTRAINT_FIELDS,
    "states": STATE_FIELDS,
    "reference": REFERENCE_FIELDS,
    "reference.steady": STEADY_FIELDS,
    "initial": INITIAL_FIELDS,
    "sweep": SWEEP_FIELDS,
    "modes": MODE_FIELDS,
    "expect": EXPECT_FIELDS,
    "expect.critical": CRITICAL_FIELDS,
}
"""Keys of the sections that have no types, with what they mean."""
