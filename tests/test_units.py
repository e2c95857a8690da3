"""Units: factors, dimensions, and sums and functions that do not fit."""

import math
import re
from fractions import Fraction

import mpmath
import pytest
from mpmath_numbers import mpmath_arithmetic

import mbstab
from mbstab.compiler.system import System
from mbstab.errors import ModelFileError, UsageError
from mbstab.mechanics.elements import KINDS
from mbstab.model.expressions import ExpressionError, parse
from mbstab.model.functions import FUNCTIONS
from mbstab.model.parameters import bound
from mbstab.model.reader import read_model_text
from mbstab.model.units import LITERAL, NONE, UNITS, UNKNOWN, dimension_of, exact_factor, parse_unit, show
from mbstab.model.values import evaluate

pytestmark = pytest.mark.table

KG, M, S = (tuple(Fraction(int(i == j)) for i in range(4)) for j in range(3))


def dimension(kilogram, metre, second, ampere=0):
    return Fraction(kilogram), Fraction(metre), Fraction(second), Fraction(ampere)


NEWTON = dimension(1, 1, -2)
NAMES = {"m": KG, "L": M, "T": S, "v": dimension(0, 1, -1), "F": NEWTON, "phi": NONE, "free": UNKNOWN}


def infer(text):
    return dimension_of(parse(text), NAMES)


# --- units ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "factor", "expected"),
    [
        ("1", 1.0, NONE),
        ("rad", 1.0, NONE),
        ("deg", math.pi / 180, NONE),
        ("m", 1.0, M),
        ("mm", 1e-3, M),
        ("cm", 1e-2, M),
        ("um", 1e-6, M),
        ("mrad", 1e-3, NONE),
        ("MN", 1e6, NEWTON),
        ("kW", 1e3, dimension(1, 2, -3)),
        ("kPa", 1e3, dimension(1, -1, -2)),
        ("MPa", 1e6, dimension(1, -1, -2)),
        ("GPa", 1e9, dimension(1, -1, -2)),
        ("km", 1e3, M),
        ("kg", 1.0, KG),
        ("g", 1e-3, KG),
        ("t", 1e3, KG),
        ("s", 1.0, S),
        ("ms", 1e-3, S),
        ("min", 60.0, S),
        ("h", 3600.0, S),
        ("Hz", 1.0, dimension(0, 0, -1)),
        ("rpm", 2 * math.pi / 60, dimension(0, 0, -1)),
        ("N", 1.0, NEWTON),
        ("kN", 1e3, NEWTON),
        ("J", 1.0, dimension(1, 2, -2)),
        ("W", 1.0, dimension(1, 2, -3)),
        ("Pa", 1.0, dimension(1, -1, -2)),
        ("A", 1.0, dimension(0, 0, 0, 1)),
        ("mA", 1e-3, dimension(0, 0, 0, 1)),
        ("C", 1.0, dimension(0, 0, 1, 1)),
        ("V", 1.0, dimension(1, 2, -3, -1)),
        ("ohm", 1.0, dimension(1, 2, -3, -2)),
        ("H", 1.0, dimension(1, 2, -2, -2)),
        ("mH", 1e-3, dimension(1, 2, -2, -2)),
        ("F", 1.0, dimension(-1, -2, 4, 2)),
        ("V*s/rad", 1.0, dimension(1, 2, -2, -1)),
        ("N*m/A", 1.0, dimension(1, 2, -2, -1)),
        ("mph", 1609.344 / 3600.0, dimension(0, 1, -1)),
        ("kg*m^2", 1.0, dimension(1, 2, 0)),
        ("kg*m**2", 1.0, dimension(1, 2, 0)),
        ("N*s/m", 1.0, dimension(1, 0, -1)),
        ("N/m", 1.0, dimension(1, 0, -2)),
        ("mm^2", 1e-6, dimension(0, 2, 0)),
        ("mm^-1", 1e3, dimension(0, -1, 0)),
        ("1/s", 1.0, dimension(0, 0, -1)),
        ("km/h", 1 / 3.6, dimension(0, 1, -1)),
        ("m/s/s", 1.0, dimension(0, 1, -2)),
        ("m/s^2", 1.0, dimension(0, 1, -2)),
        ("deg/s", math.pi / 180, dimension(0, 0, -1)),
        (" kg * m ^ 2 / s ", 1.0, dimension(1, 2, -1)),
        ("(m)", 1.0, dimension(0, 1, 0)),
        ("N/(rad*s)", 1.0, dimension(1, 1, -3)),
        ("N*m / ( deg / s )", 180 / math.pi, dimension(1, 2, -1)),
        ("(mm/(ms^2))^-2*(m)", 1e-6, dimension(0, -1, 4)),
        ("kg/(m*(s/(km)))/s", 1e3, dimension(1, 0, -2)),
    ],
)
def test_a_unit_has_its_factor_and_its_dimension(text, factor, expected):
    found = parse_unit(text)
    assert found[0] == pytest.approx(factor, rel=1e-15, abs=0)
    assert found[1] == expected


def test_the_exact_factor_of_a_unit_with_brackets():
    with mpmath.workdps(40):
        f = mpmath_arithmetic()
        assert mpmath.almosteq(exact_factor("N*m/(deg/s)", f) * f.constants["deg"], 1, 1e-39)
        assert exact_factor("(mm/(ms^2))^-2*(m)", f) == mpmath.mpf(1) / 10**6


def test_every_unit_of_the_table_is_tested_here():
    (mark,) = test_a_unit_has_its_factor_and_its_dimension.pytestmark
    assert set(UNITS) <= {case[0] for case in mark.args[1]}


@pytest.mark.parametrize(
    ("text", "message", "position"),
    [
        ("", "'' is not a unit", 0),
        ("m*", "is not a unit", 2),
        ("*m", "is not a unit", 0),
        ("m s", "is not a unit", 2),
        ("m^", "is not a unit", 1),
        ("m^x", "is not a unit", 1),
        ("m^1.5", "is not a unit", 3),
        ("m^100", "is not a unit", 4),
        ("m^\u0662", "is not a unit", 1),
        ("m//s", "is not a unit", 2),
        ("()", "is not a unit", 1),
        ("m(s)", "is not a unit", 1),
        ("m)", "is not a unit", 1),
        ("N/(rad*s", r"'\(' is not closed in the unit", 2),
        ("N/(rad*/s)", "is not a unit", 7),
        ("((m^50)^2)^3", "has a power beyond 99", 6),
        ("2*m", "is not a unit", 0),
        ("kg*metre", "unknown unit 'metre'", 3),
        ("h^99", "out of the range of numbers", 0),
        ("km^99*km^99", "out of the range of numbers", 6),
        ("mm^99/km^99", "out of the range of numbers", 6),
    ],
)
def test_what_is_no_unit_is_refused_at_its_place(text, message, position):
    with pytest.raises(ExpressionError, match=message) as caught:
        parse_unit(text)
    assert caught.value.position == position


@pytest.mark.parametrize(
    ("text", "hint"),
    [
        ("Kg", "did you mean 'kg'?"),
        ("hz", "did you mean 'Hz'?"),
        ("Nm", "write N*m"),
        ("mN", "known units: " + ", ".join(UNITS)),
        ("lightyear", "known units: " + ", ".join(UNITS)),
    ],
)
def test_an_unknown_unit_is_refused_with_a_suggestion(text, hint):
    with pytest.raises(ExpressionError, match="unknown unit") as caught:
        parse_unit(text)
    assert caught.value.hint == hint


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ((1, 2, -2), "N*m"),
        ((1, 0, -2), "N/m"),
        ((1, 0, -1), "N*s/m"),
        ((1, 2, -1), "N*m*s"),
        ((1, 2, 0), "kg*m^2"),
        ((0, 0, -1), "1/s"),
        ((0, 1, 0), "m"),
        ((0, 0, 0), "1"),
        ((1, -1, -2), "N/m^2"),
        ((0, Fraction(1, 2), 0), "m^1/2"),
    ],
)
def test_a_dimension_is_shown_in_si_units(values, text):
    assert show(dimension(*values)) == text


# --- expressions ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("2.5", LITERAL),
        ("-pi/2", LITERAL),
        ("2**3*sin(1)", LITERAL),
        ("30*deg", LITERAL),
        ("L", M),
        ("-L", M),
        ("2*L", M),
        ("L + 1", M),
        ("1 - L", M),
        ("L/T", dimension(0, 1, -1)),
        ("1/T", dimension(0, 0, -1)),
        ("m*L/T**2 + F", NEWTON),
        ("m*v**2/L - F", NEWTON),
        ("L**-2", dimension(0, -2, 0)),
        ("sqrt(L**2 + L*v*T)", M),
        ("sqrt(L)", dimension(0, Fraction(1, 2), 0)),
        ("L**0.5", dimension(0, Fraction(1, 2), 0)),
        ("abs(v)", dimension(0, 1, -1)),
        ("atan2(L, v*T)", LITERAL),
        ("sin(L/(v*T))", LITERAL),
        ("exp(-phi)", LITERAL),
        ("smooth_start(3*phi)", LITERAL),
        ("phi + 30*deg", NONE),
        ("phi**phi", NONE),
        ("L**phi", UNKNOWN),
        ("free", UNKNOWN),
        ("free*L", UNKNOWN),
        ("free + L", UNKNOWN),
        ("L + free", UNKNOWN),
        ("sin(free)", LITERAL),
        ("rate(b.x)", UNKNOWN),
        ("b.x", UNKNOWN),
        ("L + rate(b.x)*T", UNKNOWN),
        ("2 + 3*(1 + 1)", LITERAL),
        ("10*phi", LITERAL),
        ("phi/2 + L", M),
        ("L*sin(phi)", M),
        ("phi*phi", NONE),
    ],
)
def test_an_expression_has_the_dimension_of_its_parts(text, expected):
    assert infer(text) == expected


@pytest.mark.parametrize(
    ("text", "message", "position"),
    [
        ("L + T", "m and s cannot be added or compared", 2),
        ("1 + (L - T)", "m and s cannot be added or compared", 7),
        ("m*v + F", "kg[*]m/s and N cannot be added or compared", 4),
        ("L + phi", "m and 1 cannot be added or compared", 2),
        ("free + (L + T)", "m and s cannot be added or compared", 10),
        ("atan2(L, T)", "m and s cannot be added or compared", 0),
        ("2*sin(L)", r"sin\(\) takes a plain number or an angle, its argument has the unit m", 2),
        ("2**L", "an exponent is a plain number, this one has the unit m", 1),
        ("L**T", "an exponent is a plain number, this one has the unit s", 1),
        ("abs(L + T)", "cannot be added", 6),
        ("sqrt(L + T)", "cannot be added", 7),
        ("-(L + T)", "cannot be added", 4),
        ("rate(b.x)*(L - T)", "cannot be added", 13),
    ],
)
def test_quantities_that_do_not_fit_are_refused_at_their_place(text, message, position):
    with pytest.raises(ExpressionError, match=message) as caught:
        infer(text)
    assert caught.value.position == position


@pytest.mark.parametrize(
    "name", sorted({name for name, entry in FUNCTIONS.items() if entry.arguments == 1} - {"abs", "sqrt"})
)
def test_a_transcendental_function_takes_no_length(name):
    assert infer(f"{name}(L/L)") == LITERAL
    with pytest.raises(ExpressionError, match=rf"{name}\(\) takes a plain number or an angle"):
        infer(f"{name}(L)")


# --- turns ----------------------------------------------------------------------------------------------------------

TURNING = """mbstab: 1
parameters: {{f: {{value: 2, unit: {unit}}}, s: {{value: 0.1, unit: rad}}, T: {{value: 3, unit: s}}}}
bodies: {{disk: {{type: planar, mass: 1, inertia: 1}}}}
joints: {{axle: {{type: revolute, between: [disk, ground]}}}}
reference: {{rates: {{disk: {{theta: "{rate}"}}}}}}
"""


@pytest.mark.parametrize("unit", ["Hz", "1/min", "1/h", "min^-1"])
@pytest.mark.parametrize(
    "rate",
    [
        *("f", "2*f", "-f", "f*T/T", "f + 1", "abs(f)", "sin(f*T)", "sin(T/f**-1)", "sqrt(f**2)", "(f**4)**0.25"),
        *("hypot(1/T, f)", "max(1/T, f, 0.1)", "min(f, 1/T, 0.1)", "saturate(1/T, 0, f, 0.1)"),
    ],
)
def test_turns_are_no_angle(unit, rate):
    with pytest.raises(ModelFileError, match=r"f counts turns") as caught:
        mbstab.loads(TURNING.format(unit=unit, rate=rate))
    assert "write 2*pi*f" in str(caught.value)


@pytest.mark.parametrize(
    ("unit", "rate"),
    [
        *(("Hz", rate) for rate in ("2*pi*f", "f*2*pi", "6.2832*f", "f*s", "360*deg*f", "sin(2*pi*f*T)*2*pi*f", "1/T")),
        *(
            ("Hz", rate)
            for rate in ("2*acos(-1)*f", "4*asin(1)*f", "8*atan(1)*f", "2*atan2(0, -1)*f", "2*pi*sqrt(f*f)")
        ),
        *(("Hz", rate) for rate in ("sqrt((2*pi*f)**2)", "hypot(2*pi*f, 1/T)", "((2*pi*f)**4)**0.25")),
        *((unit, "f") for unit in ("rpm", "rad/s", "deg/s", "1/s", "rad/min", "mrad/s")),
    ],
)
def test_angles_are_accepted(unit, rate):
    mbstab.loads(TURNING.format(unit=unit, rate=rate))


@pytest.mark.parametrize(
    ("unit", "setting", "value"),
    [
        ("rad/s", "50 Hz", None),
        ("rpm", "50 Hz", None),
        ("rad/s", "3000 1/min", None),
        ("rad/s", "3000 rpm", 100 * math.pi),
        ("rad/s", "50 1/s", 50.0),
        ("Hz", "3000 rpm", None),
        ("Hz", "50 rad/s", None),
        ("Hz", "3000 1/min", 50.0),
    ],
)
def test_settings_in_turns_and_in_angles(unit, setting, value):
    mechanism = mbstab.loads(TURNING.format(unit=unit, rate="1/T"))
    if value is None:
        with pytest.raises(UsageError, match="turns"):
            mechanism.eig(f=setting)
    else:
        system = System(evaluate(bound(read_model_text(TURNING.format(unit=unit, rate="1/T")), {"f": setting})))
        assert system.scene.parameters["f"] == pytest.approx(value, rel=1e-15)


ALONG = """
mbstab: 1
parameters: {{x: {{value: 2, unit: {unit}}}}}
bodies: {{b: {{type: planar, mass: 1, inertia: 1}}}}
joints: {{j: {{type: {joint}, between: [b, ground]}}}}
{section}: {{e: {{{entry}}}}}
reference: {{coordinates: {{b: {{x: 0, y: 0, theta: 0}}}}}}
"""


@pytest.mark.parametrize(
    ("section", "entry", "angle", "travel"),
    [
        ("drives", "type: joint, joint: j, position: x", "rad", "m"),
        ("drives", "type: joint, joint: j, velocity: x", "rad/s", "m/s"),
        ("forces", "type: joint_spring, joint: j, stiffness: x", "N*m/rad", "N/m"),
        ("forces", "type: joint_spring, joint: j, stiffness: 1, rest: x", "rad", "m"),
        ("forces", "type: joint_spring, joint: j, damping: x", "N*m*s/rad", "N*s/m"),
        ("forces", "type: actuator, joint: j, effort: x", "N*m", "N"),
    ],
)
@pytest.mark.parametrize("joint", ["revolute", "prismatic"])
def test_units_along_a_joint_are_those_of_its_motion(section, entry, angle, travel, joint):
    right, wrong = (angle, travel) if joint == "revolute" else (travel, angle)
    along = "prismatic, axis: x" if joint == "prismatic" else joint
    mbstab.loads(ALONG.format(unit=right, joint=along, section=section, entry=entry))
    expected = rf"{section}\.e\..*: .* has the unit .*, expected {re.escape(right)}"
    with pytest.raises(ModelFileError, match=expected):
        mbstab.loads(ALONG.format(unit=wrong, joint=along, section=section, entry=entry))


@pytest.mark.parametrize(("name", "right", "wrong"), [("theta", "rad/s", "m/s"), ("x", "m/s", "rad/s")])
def test_the_units_of_a_driven_coordinate_are_its_own(name, right, wrong):
    entry = f"type: coordinate, coordinate: b.{name}, velocity: x"
    text = ALONG.format(unit="UNIT", joint="revolute", section="drives", entry=entry)
    mbstab.loads(text.replace("UNIT", right))
    with pytest.raises(ModelFileError, match=f"expected {right}"):
        mbstab.loads(text.replace("UNIT", wrong))


GAINED = """
mbstab: 1
parameters:
  K: {{value: 2, unit: {K}}}
  f: {{value: 2, unit: Hz}}
  x0: {{value: 2, unit: m}}
bodies:
  a: {{type: planar, mass: 1, inertia: 1}}
joints:
  pin: {{type: revolute, between: [a, ground]}}
{more}
reference: {{coordinates: {{a: {{x: 0, y: 0, theta: 0}}}}}}
"""
PID = "forces: {{c: {{type: pid, joint: pin, of: angle(pin), {}: K}}}}"
GAINS = "forces: {{c: {{type: state_feedback, joint: pin, gains: {{{}: K}}}}}}"
ON = "forces: {{c: {{type: expression, on: {{{}}}}}}}"


@pytest.mark.parametrize(
    ("more", "unit", "wrong", "expected"),
    [
        (PID.format("P"), "N*m/deg", "N/m", "expected N\\*m/rad"),
        (PID.format("I"), "N*m/(rad*s)", "N*m/rad", "expected N\\*m/\\(rad\\*s\\)"),
        (PID.format("D"), "N*m*s/rad", "N*m/rad", "expected N\\*m\\*s/rad"),
        (PID.format("P: 1, target"), "deg", "m", "expected rad"),
        (GAINS.format("rate(angle(pin))"), "N*m*s", "N*m", r"expected N\*m\*s"),
        (GAINS.format("a.x - x0"), "N", "N/m", "expected N\n"),
        (ON.format("a.theta: -K*a.theta"), "N*m/rad", "N/rad", "expected N\\*m"),
        (ON.format("angle(pin): -K*rate(angle(pin))"), "N*m*s", "N*m", "expected N\\*m"),
        (ON.format("a.x: -K*(a.x - x0)"), "N/m", "N", "expected N"),
        (ON.format("a.x: -K*a.x**2"), "N/m^2", "N/m", "expected N"),
        (ON.format("a.x: -K*rate(a.x)**(1/2)"), "N*s", "m", None),
        (ON.format("vx(a): -K*vx(a)"), "N*s/m", "N/m", "expected N"),
        (ON.format("a.theta: -K*tanh(vx(a)/(x0*f))"), "N*m", "N", "expected N\\*m"),
    ],
)
def test_gains_and_forces_of_the_motion_have_the_units_of_their_places(more, unit, wrong, expected):
    """Numbers beside what moves may be coefficients in any unit; declared units must fit."""
    if expected is not None:
        mbstab.loads(GAINED.format(K=unit, more=more))
    with pytest.raises(ModelFileError, match=expected or "expected N") as caught:
        mbstab.loads(GAINED.format(K=wrong, more=more))
    assert len(caught.value.problems) == 1


@pytest.mark.parametrize(
    "law", ["-a.x", "-3*a.x - rate(a.x)**3", "-7*(a.x - x0)", "a.y*a.x - 2*a.theta*a.x", "-K*a.x - a.y**3"]
)
def test_numbers_beside_what_moves_fit_everywhere(law):
    assert mbstab.loads(GAINED.format(K="N/m", more=ON.format(f"a.x: {law}")))


def test_turns_are_told_from_radians_in_constraints():
    more = "constraints: {{spin: {{nonholonomic: rate(a.theta) - {}f}}}}"
    with pytest.raises(ModelFileError, match=r"f counts turns .* added to an angle or to a turn rate"):
        mbstab.loads(GAINED.format(K="m", more=more.format("")))
    assert mbstab.loads(GAINED.format(K="m", more=more.format("2*pi*")))


@pytest.mark.parametrize(("power", "unit"), [("(1/2)", "m"), ("-(1/2)", "1/m"), ("(3 - 1)/4", "m^2"), ("(1 + 1)", "m")])
def test_an_exponent_may_be_computed(power, unit):
    names = {"L": parse_unit("m")[1]}
    found = dimension_of(parse(f"L**({power})"), names)
    exponent = {"(1/2)": Fraction(1, 2), "-(1/2)": Fraction(-1, 2), "(3 - 1)/4": Fraction(1, 2), "(1 + 1)": Fraction(2)}
    assert found == tuple(Fraction(i == 1) * exponent[power] for i in range(4))


FIELDS = {
    "number": "q",
    "moving number": "q",
    "signal": "q",
    "law": "q",
    "ratio": "q",
    "vector": "[q, 1, 1]",
    "law vector": "[q, 1, 1]",
    "angles": "[q, 0, 0]",
    "radii": "[q, 1]",
    "teeth": "[q, 1]",
}
"""What stands in a field of each shape that is in a unit."""


@pytest.mark.parametrize("section", [x for x in KINDS if x != "bodies"])
def test_every_number_of_every_part_is_refused_at_its_key_in_a_wrong_unit(section):
    asked = 0
    for kind in {KINDS[section][key].name: KINDS[section][key] for key in KINDS[section]}.values():
        for field in kind.fields:
            if field.shape not in FIELDS or not (field.unit or field.units) or field.made:
                continue
            dimension = max(kind.dimensions) if not field.units else min(kind.dimensions)
            if dimension not in field.dimensions:
                dimension = field.dimensions[0]
            body = "planar" if dimension == 2 else "spatial"
            given = FIELDS[field.shape] if dimension == 3 else FIELDS[field.shape].replace("[q, 1, 1]", "[q, 1]")
            along = "joint: pin, " if any(x.name == "joint" for x in kind.fields) else ""
            entry = f"  e: {{type: {kind.name}, {along}{field.name}: {given}}}"
            axis = ", axis: z" if dimension == 3 else ""
            joint = f"  pin: {{type: revolute, between: [a, ground]{axis}}}"
            lines = [f"{section}:", entry, *([joint] if section == "joints" else ["joints:", joint])]
            inertia = 1 if dimension == 2 else "[1, 1, 1]"
            text = "\n".join([
                "mbstab: 1",
                "parameters: {q: {value: 2, unit: kg^7}}",
                f"bodies: {{a: {{type: {body}, mass: 1, inertia: {inertia}}}}}",
                *lines,
                "reference: {}",
            ])  # fmt: skip
            with pytest.raises(ModelFileError) as caught:
                mbstab.loads(text)
            told = [x for x in caught.value.problems if "'q' has the unit kg^7, expected" in x.message]
            assert told, (kind.name, field.name)
            assert all(x.path.startswith(f"{section}.e.{field.name}") for x in told), (kind.name, field.name)
            asked += 1
    assert asked or section in ("contacts", "inputs")
