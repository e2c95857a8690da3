"""Every key of a model file that no type of entry has, in one table.

The reader, the JSON Schema, ``mbstab schema``, the manual, hints, and the names that parts change follow from it. The
keys of bodies, joints, contacts, drives, forces and inputs stand in `mbstab.mechanics.elements.KINDS`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from mbstab.mechanics.catalogue import Field
from mbstab.model.units import UNITS
from mbstab.model.words import WORDS
from mbstab.records import dataclass

VERSION = "1"

FINDS = ("equilibrium", "steady")
SIGNS = ("positive", "nonnegative", "nonzero")


@dataclass(frozen=True)
class Section(Field):
    """A key at the top of a model file.

    Attributes
    ----------
    once : bool
        Whether only the file itself has it, and neither a part nor a repetition.
    expanded : bool
        Whether it is gone once the file is written out.
    """

    once: bool = False
    expanded: bool = False


# fmt: off
MARKER = (
    Field("body", "body or ground", "name of a body, or ground", required=True),
    Field("point", "vector", "the point in the frame of the body", "m", default="0"),
)
PART = (
    Field("mass", "number", "mass of the part", "kg", required=True),
    Field("at", "vector", "its centre in the body frame", "m", default="0"),
)
ALONG = Field(
    "along", "axis of a shape", "axis of symmetry of the shape in the body frame: x, y or z; -x, -y or -z turn a cone "
    "round",
)
CURVES = (
    Field("file", "text", "name of a CSV file beside the model; its first line has rad/s or rpm over the speed, then "
        "names of keys", required=True),
    Field("speed", "number", "the speed at which they count, an expression of parameters", "rad/s", required=True),
    Field("function", "choice", "table (monotone; used if it is not given), spline or linear, between the speeds of "
        "the file", default="table", choices=("table", "spline", "linear")),
)
CONSTRAINTS = (
    Field("holonomic", "holonomic", "expression of coordinates and t that must be zero"),
    Field("nonholonomic", "nonholonomic", "expression of coordinates, rates rate(body.x) and t that must be zero"),
)
STATE = (
    Field("rate", "rate", "its rate: an expression of coordinates, rates rate(body.x), states, parameters and t",
        required=True),
    Field("unit", "unit", "its unit, such as A, V, m or N, with which its rate and the sums it stands in are checked"),
)
_PARAMETER = (
    Field("value", "postponed", "number or expression", required=True),
    Field("unit", "declared unit",
        "unit of the value: a product or quotient of " + ", ".join(UNITS) + "; Hz counts turns"),
    Field("sign", "choice",
        "values it may have, also with --set and in a sweep; any if not given: one of " + ", ".join(SIGNS),
        choices=SIGNS),
    Field("description", "text", "what it is"),
)
TABLE = (
    Field("x", "column", "values of the argument, which increase (SI); with file the name of the column, the first "
        "if not given"),
    Field("y", "column", "values of the function (SI); with file the name of the column, the second if not given"),
    Field("file", "text", "name of a CSV file beside the model, with the names of its columns in the first line"),
)
_STEADY = (
    Field("axis", "turn axis", "axis of the turn in ground axes: x, -z or a vector; in the plane z"),
    Field("rate", "number", "rate of the turn; solved for if not given; 0 if only bodies spin about their own axes",
        "rad/s"),
    Field("point", "vector", "a point of the axis, the origin if not given", "m"),
    Field("direction", "ground direction", "direction of the translation in ground axes"),
    Field("speed", "number", "speed of the translation; solved for if not given", "m/s"),
)
_REFERENCE = (
    Field("time", "number", "time at which the motion is looked at, 0 if not given", "s", default="0"),
    Field("coordinates", "state", "values by body: {body: {x: …}}; missing ones are solved from the constraints"),
    Field("rates", "rates", "time derivatives by body; missing ones are solved from the constraints"),
    Field("guess", "guess", "starting values for coordinates that are solved; choose between assemblies with them; "
        "under rates: those of a steady motion that is looked for, such as its direction of travel"),
    Field("find", "choice", "equilibrium or steady: coordinates that are not given are solved so that the forces "
        "balance", choices=FINDS),
    Field("steady", "steady", "the motion is a steady turn about an axis, a steady translation, or both",
        keys=_STEADY),
    Field("period", "number", "period of a periodic motion, judged by its Floquet multipliers", "s"),
    Field("closure_tolerance", "number", "rows that repeat others and contradict them by less are left out, with a "
        "warning", "m"),
)
_INITIAL = (
    Field("time", "number", "time at which the simulation starts, that of the reference if not given", "s"),
    Field("coordinates", "state", "values by body: {body: {x: …}}; others are those of the reference, moved onto the "
        "constraints"),
    Field("rates", "rates", "time derivatives by body; others are those of the reference, moved onto the constraints"),
)
_SWEEP = (
    Field("from", "value", "first value", required=True),
    Field("to", "value", "last value", required=True),
    Field("points", "number of points", "number of points", default="401"),
)
_MODE = (
    Field("near", "complex", "the eigenvalue it is nearest to, such as -0.3+4.4i", "1/s"),
    Field("shape", "amplitudes", "coordinates (m, rad) and motions of joints, {body.phi: 1, angle(joint): 0.5 ∠ "
        "-30}, phases in degrees"),
    Field("at", "settings", "parameter values at which it is found, those of the file if not given; followed from "
        "there: {v: 5}"),
)
_EIGENVALUE = (
    Field("real", "number", "real part (1/s)", "", default="0"),
    Field("imag", "number", "imaginary part (rad/s)", "", default="0"),
)
_CRITICAL = (
    Field("parameter", "parameter", "name of the parameter", required=True),
    Field("value", "number", "value at which the verdict changes", "", required=True),
    Field("tolerance", "fraction", "relative distance from the value at which both verdicts are checked",
        default="1e-6"),
    Field("below", "choice", "verdict below it", required=True, choices=WORDS),
    Field("above", "choice", "verdict above it", required=True, choices=WORDS),
)
_EXPECT = (
    Field("at", "settings", "parameter values: {omega: 4}"),
    Field("eigenvalues", "eigenvalues", "all that are not neutral: {real, imag}; an entry with imag stands for the "
        "conjugate pair", keys=_EIGENVALUE),
    Field("tolerance", "fraction", "relative, for eigenvalues (zeros: within their bounds) and coordinates (against "
        "at least 1 m, 1 rad)", default="1e-9"),
    Field("neutral", "count", "number of neutral eigenvalues: zeros, and the imaginary pairs that shifts become in a "
        "turning frame"),
    Field("frozen", "flag", "true: eigenvalues of the equations frozen at the reference time, as mbstab eig --frozen",
        default="false"),
    Field("coordinates", "state", "coordinates of the reference motion, by body: {body: {x: …}}"),
    Field("redundant", "count", "number of redundant constraint rows"),
    Field("verdict", "choice", "one of " + ", ".join(WORDS), choices=WORDS),
    Field("critical", "critical", "{parameter, value, tolerance, below, above}: where the verdict changes, and from "
        "what to what", keys=_CRITICAL),
    Field("source", "text", "where the expected values come from"),
)
_REPEAT = (
    Field("for", "ranges", "indices, each with its first and last value: {i: [1, 10]}; one may use counts: [2, N]",
        required=True),
)
INCLUDE = (
    Field("file", "text", "name of the part, a file in the folder of the model", required=True),
    Field("prefix", "text", "what is put before each of its names"),
    Field("with", "settings", "values of its parameters, and names for what it needs"),
)
GROUND = (
    Field("points", "points", "named points", "m"),
    Field("directions", "named directions", "named directions"),
)
_SECTIONS = (
    Section("mbstab", "version", "version of the file format; write 1", once=True, required=True),
    Section("title", "text", "one line that names the system", once=True),
    Section("source", "text", "where the model and its expected values come from", once=True),
    Section("counts", "counts", "named whole numbers, for which <NAME> stands in names and values", expanded=True),
    Section("repeat", "blocks", "blocks of sections that are read once for each value of an index: {for: {i: [1, "
        "10]}, bodies: …}; <i>, <i - 1> and <2*i> stand for numbers in their names and values", keys=_REPEAT,
        expanded=True),
    Section("include", "list", "parts from other files: {file, prefix, with}; their names get the prefix",
        keys=INCLUDE, expanded=True),
    Section("needs", "texts", "names that a part takes from the file that includes it, each with a description; only "
        "in parts", expanded=True),
    Section("parameters", "parameters", "named numbers: value, or {value, unit, sign, description}; values may be "
        "expressions of others", keys=_PARAMETER),
    Section("tables", "by name", "functions given by points, by name, that table(x, NAME), spline(x, NAME) and "
        "linear(x, NAME) evaluate", keys=TABLE),
    Section("definitions", "settings", "named expressions of parameters, coordinates, measures, states and t that "
        "all others may use, but those of parameters"),
    Section("gravity", "vector", "acceleration of gravity, a vector in ground axes; without it there is none",
        "m/s^2", once=True),
    Section("ground", "mapping", "named points and directions of the ground", keys=GROUND),
    Section("bodies", "entries", "the bodies, by name"),
    Section("joints", "entries", "the joints, by name"),
    Section("contacts", "entries", "contacts with fixed lines and planes, by name"),
    Section("drives", "entries", "motions given as functions of time, by name"),
    Section("forces", "entries", "springs, dampers, forces and torques, by name"),
    Section("inputs", "entries", "signals that act on the linearized motion, by name; none of them changes the "
        "reference motion"),
    Section("constraints", "by name", "constraints written as expressions, by name: {holonomic: …} or {nonholonomic: "
        "…}", keys=CONSTRAINTS),
    Section("states", "by name", "first-order states (filters, lags, integrals, currents), by name: {rate: "
        "expression}", keys=STATE),
    Section("outputs", "texts", "what is measured of the motion, by name: expressions of coordinates, measures, "
        "their rate(...) and acceleration(...), and force(joint.x), torque(joint.z), effort(name)"),
    Section("reference", "reference", "the motion whose stability is asked for: coordinates and rates by body",
        keys=_REFERENCE),
    Section("initial", "initial", "where mbstab simulate starts: coordinates and rates by body; the others are those "
        "of the reference", keys=_INITIAL),
    Section("sweep", "sweep ranges", "default ranges of parameters: {from, to, points}", keys=_SWEEP, once=True),
    Section("modes", "modes", "names of modes: {near: eigenvalue} or {shape: motions}, each with {at: parameter "
        "values}", keys=_MODE),
    Section("expect", "expectations", "what the answer must be, checked by mbstab test", keys=_EXPECT, once=True),
)

# fmt: on

SECTIONS: dict[str, Section] = {section.name: section for section in _SECTIONS}
"""Keys at the top of a model file, by name."""


def _explained(fields: Iterable[Field], path: str = "") -> Iterator[tuple[str, tuple[Field, ...]]]:
    for field in fields:
        if field.keys:
            yield path + field.name, field.keys
            yield from _explained(field.keys, f"{path}{field.name}.")


EXPLAINED: dict[str, tuple[Field, ...]] = {**dict(_explained(_SECTIONS)), "forces.curves": CURVES}
"""Keys of all that has keys and no types, by where it stands, such as ``reference.steady``."""
