"""What a model file says, after reading: expressions with their places, nothing evaluated yet."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from mbstab.errors import Location
from mbstab.mechanics import bodies
from mbstab.mechanics.catalogue import Field, Kind
from mbstab.mechanics.elements import KINDS
from mbstab.model.expressions import Expression
from mbstab.model.yamlfile import Document

VERSION = "1"

SECTIONS: dict[str, str] = {
    "mbstab": "version of the file format; write 1",
    "title": "one line that names the system",
    "source": "where the model and its expected values come from",
    "parameters": "named numbers: value, or {value, unit, description}; values may be expressions of other parameters",
    "gravity": "acceleration of gravity, a vector in ground axes (m/s^2); without it there is none",
    "ground": "named points and directions of the ground",
    "bodies": "the bodies, by name",
    "joints": "the joints, by name",
    "contacts": "contacts with fixed lines and planes, by name",
    "drives": "motions given as functions of time, by name",
    "forces": "springs, dampers, forces and torques, by name",
    "constraints": "constraints written as expressions, by name: {holonomic: …} or {nonholonomic: …}",
    "reference": "the motion whose stability is asked for: coordinates and rates by body",
    "sweep": "default ranges of parameters: {from, to, points}",
    "expect": "what the answer must be, checked by mbstab test",
}
"""Keys at the top of a model file."""


@dataclass(frozen=True)
class Parameter:
    """A named number; `factor` turns its declared unit into SI."""

    name: str
    expression: Expression
    location: Location
    unit: str = ""
    factor: float = 1.0
    description: str = ""


@dataclass(frozen=True)
class MarkerValue:
    """A point of a body (None: the ground) in the body's frame."""

    body: str | None
    point: tuple[Expression, ...]


@dataclass(frozen=True)
class ShapeValue:
    """A homogeneous shape with its lengths; `along` is the number of the axis or None."""

    kind: bodies.ShapeKind
    lengths: dict[str, Expression]
    along: int | None


@dataclass(frozen=True)
class PartValue:
    """A shape with its own mass and place."""

    mass: Expression
    shape: ShapeValue
    place: tuple[Expression, ...]


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


@dataclass(frozen=True)
class StateValues:
    """Values of coordinates or rates, by name such as ``rod.theta``."""

    values: dict[str, Expression] = field(default_factory=dict)
    places: dict[str, Location] = field(default_factory=dict)


@dataclass(frozen=True)
class Reference:
    """The reference motion: what is given, and guesses for what is not."""

    location: Location
    time: Expression
    coordinates: StateValues
    rates: StateValues
    guess: StateValues


@dataclass(frozen=True)
class SweepRange:
    """Default range of a parameter."""

    start: Expression
    stop: Expression
    points: int


@dataclass(frozen=True)
class ExpectedEigenvalue:
    """Real and imaginary part; a conjugate pair if the imaginary part is not zero."""

    real: Expression
    imag: Expression


@dataclass(frozen=True)
class CriticalValue:
    """A parameter value at which the verdict changes."""

    parameter: str
    value: Expression
    tolerance: float
    below: str
    above: str
    location: Location


@dataclass(frozen=True)
class Expectation:
    """One entry of ``expect``: at these parameters, this answer."""

    location: Location
    at: dict[str, Expression]
    eigenvalues: tuple[ExpectedEigenvalue, ...] | None
    tolerance: float
    neutral: int | None
    verdict: str | None
    critical: CriticalValue | None
    source: str


@dataclass(frozen=True)
class Model:
    """Everything a model file says.

    Attributes
    ----------
    dimension : int
        2 for a planar scene, 3 for a spatial one.
    order : tuple of str
        Sections in the order of the file; constraint rows follow it.
    """

    document: Document
    dimension: int
    order: tuple[str, ...]
    title: str
    source: str
    parameters: dict[str, Parameter]
    gravity: tuple[Expression, ...]
    gravity_location: Location
    bodies: dict[str, Entry]
    entries: dict[str, dict[str, Entry]]
    reference: Reference
    sweep: dict[str, SweepRange]
    expect: tuple[Expectation, ...]

    @property
    def name(self) -> str:
        """Return what messages call the file."""
        return self.document.name

    def coordinates(self) -> list[str]:
        """Return the names of the coordinates in the order of q, such as ``rod.theta``."""
        return [f"{name}.{c}" for name, body in self.bodies.items() for c in body_coordinates(body)]


def body_coordinates(body: Entry) -> tuple[str, ...]:
    """Return the names of the coordinates of a body."""
    return bodies.BODY_COORDINATES[body.kind.name]


VERDICTS = ("asymptotically stable", "marginally stable", "unstable", "undecided")

PARAMETER_FIELDS = {"value": "number or expression", "unit": "unit of the value", "description": "what it is"}
REFERENCE_FIELDS = {
    "time": "time at which the motion is looked at, 0 if not given (s)",
    "coordinates": "values by body: {body: {x: …}}; missing ones are solved from the constraints",
    "rates": "time derivatives by body; missing ones are solved from the constraints",
    "guess": "starting values for coordinates that are solved; choose between assemblies with them",
}
SWEEP_FIELDS = {"from": "first value", "to": "last value", "points": "number of points"}
EXPECT_FIELDS = {
    "at": "parameter values: {omega: 4}",
    "eigenvalues": "all that are not neutral: {real, imag}; an entry with imag stands for the conjugate pair",
    "tolerance": "relative tolerance of the eigenvalues",
    "neutral": "number of neutral (zero) eigenvalues",
    "verdict": "one of " + ", ".join(VERDICTS),
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
PART_FIELDS = {"type": "shape", "mass": "mass of the part (kg)", "at": "its centre in the body frame (m)", "along": "x, y or z"}
CONSTRAINT_FIELDS = {
    "holonomic": "expression of coordinates and t that must be zero",
    "nonholonomic": "expression of coordinates, rates rate(body.x) and t that must be zero",
}


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema of model files, for editors."""
    number: dict[str, Any] = {"type": ["number", "string"]}
    vector = {"anyOf": [{"type": "string"}, {"type": "array", "items": number}]}
    by_coordinate = {"type": "object", "additionalProperties": number}
    state = {"type": "object", "additionalProperties": by_coordinate}
    marker = {"anyOf": [{"type": "string"}, {"type": "object", "properties": {"body": {"type": "string"}, "point": vector}, "required": ["body"], "additionalProperties": False}]}  # fmt: skip
    shape_fields = {name: number for kind in bodies.SHAPES.values() for name in (f.name for f in kind.fields)}
    shape = {
        "type": "object",
        "properties": {"type": {"enum": sorted(bodies.SHAPES)}, "along": {"enum": ["x", "y", "z"]}, **shape_fields},
        "required": ["type"],
        "additionalProperties": False,
    }
    part = {**shape, "properties": {**shape["properties"], "mass": number, "at": vector}}  # type: ignore[dict-item]
    shapes: dict[str, Any] = {
        "number": number,
        "law": number,
        "vector": vector,
        "law vector": {"type": "array", "items": number},
        "angles": {"type": "array", "items": number},
        "direction": vector,
        "directions": {"anyOf": [{"type": "string"}, {"type": "array"}]},
        "tensor": {"anyOf": [number, {"type": "array"}, {"type": "object"}]},
        "marker": marker,
        "markers": {"type": "array", "items": marker, "minItems": 2, "maxItems": 2},
        "points": {"type": "object", "additionalProperties": vector},
        "shape": shape,
        "parts": {"type": "array", "items": part, "minItems": 1},
        "loads": {"type": "object", "additionalProperties": number},
    }

    def property_of(field: Field) -> dict[str, Any]:
        node = dict(shapes.get(field.shape, {"type": "string"}))
        if field.shape == "choice":
            node["enum"] = list(field.choices)
        unit = f" ({field.unit})" if field.unit not in ("", "1") else ""
        node["description"] = field.doc + unit
        return node

    def entry(kind: Kind) -> dict[str, Any]:
        return {
            "type": "object",
            "description": kind.doc,
            "properties": {"type": {"const": kind.name}, **{f.name: property_of(f) for f in kind.fields}},
            "required": ["type", *[f.name for f in kind.fields if f.required]],
            "additionalProperties": False,
        }

    def section(name: str) -> dict[str, Any]:
        kinds = list({id(kind): kind for kind in KINDS[name].values()}.values())
        return {
            "type": "object",
            "description": SECTIONS[name],
            "additionalProperties": {"anyOf": [entry(kind) for kind in kinds]},
        }

    def plain(fields: dict[str, str], **types: Any) -> dict[str, Any]:
        return {
            "type": "object",
            "properties": {key: {**types.get(key.replace(" ", "_"), {}), "description": doc} for key, doc in fields.items()},
            "additionalProperties": False,
        }

    text = {"type": "string"}
    critical = plain(CRITICAL_FIELDS, parameter=text, value=number, tolerance=number)
    eigenvalue = plain({"real": "real part (1/s)", "imag": "imaginary part (rad/s)"}, real=number, imag=number)
    expectation = plain(
        EXPECT_FIELDS,
        at=by_coordinate,
        eigenvalues={"type": "array", "items": eigenvalue},
        tolerance=number,
        neutral={"type": "integer"},
        verdict={"enum": list(VERDICTS)},
        critical=critical,
        source=text,
    )
    parameter = {"anyOf": [number, plain(PARAMETER_FIELDS, value=number, unit=text, description=text)]}
    sweep = plain(SWEEP_FIELDS, **{"from": number, "to": number, "points": {"type": "integer"}})
    properties: dict[str, Any] = {
        "mbstab": {"const": 1},
        "title": text,
        "source": text,
        "parameters": {"type": "object", "additionalProperties": parameter},
        "gravity": vector,
        "ground": plain({"points": "named points (m)", "directions": "named directions"}, points=shapes["points"], directions=shapes["points"]),  # fmt: skip
        **{name: section(name) for name in KINDS},
        "constraints": {"type": "object", "additionalProperties": plain(CONSTRAINT_FIELDS, holonomic=text, nonholonomic=text)},
        "reference": plain(REFERENCE_FIELDS, time=number, coordinates=state, rates=state, guess=state),
        "sweep": {"type": "object", "additionalProperties": sweep},
        "expect": {"type": "array", "items": expectation},
    }  # fmt: skip
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "mbstab model",
        "type": "object",
        "properties": {key: {**node, "description": SECTIONS[key]} for key, node in properties.items()},
        "required": ["mbstab", "bodies"],
        "additionalProperties": False,
    }
