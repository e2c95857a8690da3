"""What the expressions of a scene say about time and smoothness, by their structure."""

import math
import time

import numpy as np
import pytest
from mpmath_numbers import mpmath_arithmetic

import mbstab
from mbstab.analysis.verdict.constancy import _period, _shape, affine_drives, period_doubt, time_doubt, time_uses
from mbstab.analysis.verdict.exact_sums import Structure
from mbstab.analysis.verdict.smoothness import kinks
from mbstab.compiler.system import System
from mbstab.errors import MbstabError
from mbstab.model.arithmetic import FLOAT, array_arithmetic
from mbstab.model.expressions import parse
from mbstab.model.parameters import bound
from mbstab.model.values import evaluate

POINT = """
mbstab: 1
parameters:
  c: {{value: 0}}
  w: {{value: 2*pi/3, unit: rad/s}}
  w2: {{value: 3*w, unit: rad/s}}
  rpm: {{value: 30, unit: rpm}}
  T: {{value: 10, unit: s}}
bodies:
  b: {{type: planar_point, mass: 1}}
{more}
reference:
  time: {start}
  coordinates: {{b: {{x: 0, y: 0}}}}
"""


def point(more, start="0", **settings):
    return mbstab.loads(POINT.format(more=more, start=start)).system(**settings)


def force(text, start="0", **settings):
    return point(f"forces:\n  p: {{type: expression, on: {{b.x: '{text}'}}}}", start, **settings)


def drive(text, start="0", what="position", **settings):
    return point(f"drives:\n  d: {{type: coordinate, coordinate: b.x, {what}: '{text}'}}", start, **settings)


def only(system):
    (use,) = time_uses(system)
    return use


@pytest.mark.parametrize(
    "text", ["-b.x", "0*sin(t) - b.x", "(t - t)*b.x", "c*tanh(t - 50)", "t/t", "sin(t) - sin(t)", "t**0", "2*t - t - t"]
)
def test_what_folds_away_is_no_dependence_on_time(text):
    system = force(text, start="1")
    assert time_uses(system) == ()
    assert time_doubt(system) == ""
    assert period_doubt(system, 1.23) == ""


def test_a_scene_without_time_costs_next_to_nothing():
    system = mbstab.load("models/whipple_bicycle.yaml").system()
    best = min(timed(time_doubt, system) for _ in range(5))
    assert time_doubt(system) == ""
    assert best < 1e-3


def timed(function, *arguments):
    begin = time.process_time()
    function(*arguments)
    return time.process_time() - begin


def test_frozen_constancy_far_from_the_change_is_refused():
    system = force("tanh(t - 50)*b.x - 0.1*rate(b.x)")
    use = only(system)
    assert (use.path, use.text, use.kind) == ("forces.p", "tanh(t - 50)", "other")
    assert time_doubt(system) == (
        "the equations depend on time through forces.p (tanh(t - 50)): the numbers are those of t = 0 s "
        "and say nothing about stability"
    )
    assert "forces.p (tanh(t - 50))" in period_doubt(system, 1.0)


@pytest.mark.parametrize("text", ["exp(-t)", "-(1 + exp(-t))*b.x", "t", "t*b.x", "sin(t**2)", "sin(b.x*t)", "sin(t)*t"])
def test_what_neither_settles_nor_repeats_is_other(text):
    system = force(text)
    assert only(system).kind == "other"
    assert time_doubt(system)
    assert period_doubt(system, 2 * math.pi)


# --- periodic -------------------------------------------------------------------------------------------------------


def test_a_period_that_samples_would_miss_is_found():
    system = force("-(1 + 0.5*sin(2*pi*t/3))*b.x")
    use = only(system)
    assert (use.kind, use.text) == ("periodic", "sin(2*pi*t/3)")
    assert use.period == pytest.approx(3.0, rel=1e-15)
    assert "periodic with 3 s" in time_doubt(system)
    assert "give reference.period" in time_doubt(system)
    assert period_doubt(system, 3.0) == ""
    assert period_doubt(system, 6.0) == ""
    assert period_doubt(system, 1.5) == (
        "the equations depend on time through forces.p (sin(2*pi*t/3)), which repeats after 3 s: "
        "1.5 s is no whole multiple of it"
    )
    assert period_doubt(system, 3.0 * (1 + 1e-13)) == ""
    assert period_doubt(system, 3.0 * (1 + 1e-9))


@pytest.mark.parametrize(
    ("text", "period"),
    [
        ("sin(t)**2", math.pi),
        ("sin(t)**3", 2 * math.pi),
        ("sin(t)*cos(t)", math.pi),
        ("sin(t)*sin(2*t)", 2 * math.pi),
        ("sin(t)*sin(3*t)", math.pi),
        ("sin(t)**3*exp(cos(2*t))", 2 * math.pi),
        ("sin(2*t) + cos(3*t)", 2 * math.pi),
        ("0.1*cos(w*t) + sin(w2*t)", 3.0),
        ("sin(w*t + b.y)", 3.0),
        ("sin(2*pi*t + sin(w*t))", 3.0),
        ("1/(2 + cos(w*t))", 3.0),
        ("abs(sin(w*t))", 1.5),
        ("tan(w*t)", 1.5),
        ("exp(sin(w*t))*b.x**2", 3.0),
        ("sin(rpm*t)", 2.0),
        ("sin(sqrt(2)*t) + cos(t/sqrt(2))", 2 * math.pi * math.sqrt(2)),
        ("sin(360*deg*t) + sin(pi*t)", 2.0),
        ("sin(0.1*t) + sin(0.3*t)", 20 * math.pi),
        ("sqrt(1 + cos(w*t)**2)", 1.5),
        ("smooth_start(sin(w*t))", 3.0),
    ],
)
def test_the_common_period(text, period):
    system = force(text, start="0.3")
    assert only(system).kind == "periodic"
    assert only(system).period == pytest.approx(period, rel=1e-14)
    assert period_doubt(system, period) == ""
    assert period_doubt(system, 7 * period) == ""
    assert period_doubt(system, 0.7 * period)


@pytest.mark.parametrize("text", ["sin(t) + sin(sqrt(2)*t)", "sin(t)*cos(pi*t)", "sin(t + sin(w*t))"])
def test_irrational_ratios_have_no_common_period(text):
    use = only(force(text))
    assert use.kind == "other"
    assert "no common period" in use.why
    assert "no common period" in time_doubt(force(text))


def test_entries_that_are_periodic_each_may_have_no_common_period():
    text = "forces:\n  p: {type: expression, on: {b.x: sin(t)}}\n  r: {type: expression, on: {b.y: 'cos(pi*t)'}}"
    system = point(text)
    assert [use.kind for use in time_uses(system)] == ["periodic", "periodic"]
    assert "no common period" in time_doubt(system)
    assert "forces.r" in period_doubt(system, 2 * math.pi)


def test_values_from_the_command_line_count_as_decimals_or_in_their_unit():
    assert only(force("sin(w*t) + sin(3*t)", w=1.5)).period == pytest.approx(4 * math.pi / 3)
    assert only(force("sin(rpm*t)", rpm=45)).period == pytest.approx(4 / 3, rel=1e-15)
    assert period_doubt(force("sin(rpm*t) + cos(pi*t)", rpm=45), 4.0) == ""


def test_the_period_of_the_file_is_compared_exactly():
    system = mbstab.load("models/kapitza.yaml").system()
    use = only(system)
    assert (use.path, use.text, use.kind) == ("drives.shaker", "cos(nu*t)", "periodic")
    assert period_doubt(system, float(system.scene.period)) == ""
    assert period_doubt(system, 0.5 * float(system.scene.period))


@pytest.mark.parametrize("nu", [60.0, 61.7])
def test_other_number_systems_agree(nu):
    model = mbstab.load("models/kapitza.yaml").model
    f = mpmath_arithmetic()
    system = System(evaluate(bound(model, {"nu": nu}), arithmetic=f))
    assert only(system).period == pytest.approx(2 * math.pi / nu)
    assert period_doubt(system, system.scene.period) == ""


def test_balls_and_intervals():
    import flint

    from mbstab.model.balls import ball_arithmetic, digits

    model = mbstab.load("models/kapitza.yaml").model
    with digits(30):
        f = ball_arithmetic()
        for nu in (f.number("61.7"), f.number("60"), flint.arb(60, 1)):
            system = System(evaluate(model, {"nu": nu}, f))
            assert only(system).kind == "periodic"
            assert period_doubt(system, system.scene.period) == ""
        # An interval has no value that a time could be compared with.
        ramp = mbstab.loads(
            POINT.format(more="forces:\n  p: {type: expression, on: {b.x: smooth_start(t/T)}}", start="20")
        ).model
        assert only(System(evaluate(ramp, {"T": f.number("19.9")}, f))).kind == "settled"
        assert only(System(evaluate(ramp, {"T": flint.arb(15, 1)}, f))).kind == "other"


def test_points_of_a_sweep_are_judged_together():
    model = mbstab.load("models/kapitza.yaml").model
    system = System(evaluate(model, {"nu": np.array([60.0, 100.0, 200.0])}))
    assert only(system).period == pytest.approx(2 * math.pi / 60)
    assert "depends on the point of the sweep" in time_doubt(system)
    assert period_doubt(system, system.scene.period) == ""
    assert period_doubt(system, float(system.scene.period[0]))

    model = mbstab.loads(
        POINT.format(more="forces:\n  p: {type: expression, on: {b.x: smooth_start(t/T)}}", start="20")
    ).model
    assert only(System(evaluate(model, {"T": np.array([5.0, 15.0])}))).kind == "settled"
    late = only(System(evaluate(model, {"T": np.array([5.0, 30.0])})))
    assert (late.kind, late.from_time, late.later) == ("other", 30.0, "steady")


PIECES = (
    "t", "x", "1", "2", "0.5", "c", "w*t", "sin({})", "cos({})", "tanh({})", "exp({})", "abs({})", "smooth_start({})",
    "sqrt(1+({})**2)", "({}) + ({})", "({})*({})", "({}) - ({})", "({})/(7+({}))", "({})**2", "({})**3", "-({})",
)  # fmt: skip


def some_text(random, depth=4):
    pieces = PIECES if depth else PIECES[:7]
    piece = pieces[random.integers(len(pieces))]
    return piece.format(*[some_text(random, depth - 1) for _ in range(piece.count("{}"))])


def test_what_is_claimed_holds_at_many_times():
    random = np.random.default_rng(1)
    structure = Structure(force("-b.x", start="1").scene)
    names = {"c": 0.0, "w": 2 * np.pi / 3, "x": 0.83}
    later = 1.0 + 100.0 * random.random(50)
    kinds = dict.fromkeys(("free", "steady", "periodic", "other"), 0)
    for _ in range(1500):
        text = some_text(random)
        expression = parse(text)

        def value(t, expression=expression):
            with np.errstate(all="ignore"):
                return expression.evaluate({**names, "t": t}, array_arithmetic()) + 0.0 * t

        exact = structure.exact(expression)
        if not exact.time:
            kinds["free"] += 1
            values = value(np.append(later, [-6.9, 0.3]))
            assert not np.ptp(values) > 1e-9 * np.max(np.abs(values)), text
            continue
        shape = _shape(structure.exact(expression, structure.start), "position")
        kinds[shape.kind] += 1
        if shape.kind == "other":
            continue
        period = _period(structure, shape.frequencies) if shape.frequencies else 7.3
        slope = float(structure.value(shape.slope)[0])
        with np.errstate(all="ignore"):
            change = value(later + period) - value(later) - slope * period
            # Angles are large, so sines are only as good as these; what overflows says nothing.
            assert not np.any(np.abs(change) > 1e-7 * (1.0 + np.abs(value(later)))), text
    assert min(kinds.values()) > 30, kinds


# --- settled --------------------------------------------------------------------------------------------------------

RAMP = "-(1 - 2*smooth_start((t - 5)/10))*b.x - 0.1*rate(b.x)"


@pytest.mark.parametrize("start", ["0", "5", "7", "14.999"])
def test_before_and_within_a_start(start):
    system = force(RAMP, start)
    use = only(system)
    assert (use.kind, use.text, use.from_time) == ("other", "smooth_start((t - 5)/10)", 15.0)
    doubt = time_doubt(system)
    assert "from t = 15 s on they are constant: give reference.time" in doubt
    assert "period" not in doubt
    assert period_doubt(system, 1.0)


@pytest.mark.parametrize("start", ["15", "20"])
def test_after_a_start(start):
    system = force(RAMP, start)
    assert only(system).kind == "settled"
    assert time_doubt(system) == ""
    assert period_doubt(system, 1.0) == ""


@pytest.mark.parametrize(
    ("text", "start", "kind"),
    [
        ("smooth_start(t/T)", "T", "settled"),
        ("smooth_start(t/(T*sqrt(2)*pi))", "T*sqrt(2)*pi", "settled"),
        ("smooth_start((8 - t)/3)", "8", "settled"),
        ("smooth_start((8 - t)/3)", "7.9", "other"),
        ("smooth_start(2*smooth_start(t/5))", "6", "settled"),
        ("smooth_start(5 + sin(t))", "0", "settled"),
        ("smooth_start(exp(t))", "0.1", "settled"),
        ("smooth_start(1 + sin(t))", "0", "periodic"),
        ("smooth_start(t*b.x)", "100", "other"),
        ("smooth_start(-t)*tanh(t)", "0", "settled"),
        ("abs(t) - t", "0", "settled"),
        ("abs(t) - t", "-1", "other"),
        ("smooth_start(t/T)*sin(w*t)", "11", "periodic"),
        ("smooth_start(t/T)*t", "11", "other"),
    ],
)
def test_pieces_that_are_over(text, start, kind):
    assert only(force(text, start)).kind == kind


def test_what_repeats_after_a_start_needs_both_keys():
    doubt = time_doubt(force("smooth_start(t/T)*sin(w*t)"))
    assert "from t = 10 s on they are periodic with 3 s: give reference.time and reference.period" in doubt


def test_the_latest_start_is_named_and_what_never_settles_first():
    text = (
        "forces:\n  p: {{type: expression, on: {{b.x: smooth_start(t/4)}}}}\n  r: {{type: expression, on: {{b.y: {}}}}}"
    )
    assert "from t = 8 s on" in time_doubt(point(text.format("smooth_start(t/8)")))
    doubt = time_doubt(point(text.format("exp(-t)")))
    assert "forces.r (exp(-t))" in doubt
    assert "reference.time" not in doubt


# --- drives and constraints -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("text", ["1 + 3*t", "3*t + c*sin(t)", "(t + 1)**2*3/2 - 1.5*t**2", "3*(t - 5)"])
def test_positions_of_first_degree(text):
    use = only(drive(text))
    assert (use.kind, use.slope, use.angular) == ("affine", 3.0, False)
    assert time_doubt(drive(text)) == ""
    assert [use.path for use in affine_drives(drive(text))] == ["drives.d"]
    assert "no symmetry" in time_doubt(drive(text), broken=("drives.d",))
    assert "no symmetry" in period_doubt(drive(text), 1.0, broken=("drives.d",))


def test_a_position_that_leads_after_a_start():
    assert only(drive("3*t*smooth_start(t/T)", "0")).kind == "other"
    use = only(drive("3*t*smooth_start(t/T)", "12"))
    assert (use.kind, use.slope) == ("settled", 3.0)
    assert len(affine_drives(drive("3*t*smooth_start(t/T)", "12"))) == 1


def test_a_position_that_leads_and_shakes():
    use = only(drive("3*t + 0.1*sin(w*t)"))
    assert (use.kind, use.slope) == ("periodic", 3.0)
    assert use.period == pytest.approx(3.0)


@pytest.mark.parametrize("text", ["t**2", "t*abs(t)", "exp(t)"])
def test_positions_that_speed_up(text):
    assert only(drive(text, "-1")).kind == "other"


def test_velocities():
    assert time_uses(drive("3", what="velocity")) == ()
    assert only(drive("3*t", what="velocity")).kind == "other"
    assert only(drive("3*smooth_start(t/T)", "20", what="velocity")).kind == "settled"
    assert only(drive("3*smooth_start(t/T)", "2", what="velocity")).kind == "other"
    assert only(drive("3 + sin(w*t)", what="velocity")).kind == "periodic"


def test_a_slope_that_is_zero_at_the_first_point_of_a_sweep_leads():
    model = mbstab.loads(
        POINT.format(more="drives:\n  d: {type: coordinate, coordinate: b.x, position: c*t}", start="0")
    ).model
    assert len(affine_drives(System(evaluate(model, {"c": np.array([0.0, 1.0])})))) == 1


@pytest.mark.parametrize(
    ("text", "kind"),
    [("{holonomic: b.x - 2*t}", "affine"), ("{holonomic: b.x - 2*t*b.y}", "other"),
     ("{holonomic: b.x - t**2}", "other"),
     ("{holonomic: 'b.x - sin(w*t)'}", "periodic"), ("{nonholonomic: rate(b.x) - t}", "other"),
     ("{nonholonomic: 'rate(b.x)*(2 + cos(t)) - rate(b.y)'}", "periodic")],
)  # fmt: skip
def test_constraints(text, kind):
    assert only(point(f"constraints:\n  k: {text}")).kind == kind


def test_angles_and_vectors():
    text = """
mbstab: 1
bodies:
  b: {type: planar, mass: 1, inertia: 1}
joints:
  h: {type: revolute, between: [b, ground]}
drives:
  spin: {type: joint, joint: h, position: 2*t}
forces:
  f: {type: force, at: b, vector: [sin(3*t), 0]}
"""
    system = mbstab.loads(text).system()
    assert [(use.path, use.kind, use.angular) for use in time_uses(system)] == [
        ("drives.spin", "affine", True),
        ("forces.f", "periodic", False),
    ]


# --- smoothness -----------------------------------------------------------------------------------------------------


def kink(text, x=0.0, y=0.0, vx=0.0, vy=0.0, order=2, **settings):
    return kinks(force(text, **settings), [x, y], [vx, vy], 0.0, order)


def test_a_push_that_starts_here_is_reported():
    assert kink("smooth_start(b.y)") == (
        "the equations have a kink at the reference: forces.p (smooth_start(b.y)) has no second derivative "
        "where its argument is 0"
    )
    assert kink("smooth_start(b.y)", y=1.0)
    assert kink("smooth_start(b.y)", y=1e-13)
    assert kink("smooth_start(b.y)", order=1) == ""


@pytest.mark.parametrize("y", [-0.1, 0.3, 1.5, -1e-6])
def test_inside_a_piece_there_is_no_kink(y):
    assert kink("smooth_start(b.y)", y=y) == ""


@pytest.mark.parametrize(
    "text",
    ["abs(b.x)", "b.x*abs(b.x)", "c - 3*abs(rate(b.x))*rate(b.x)", "abs(b.x - 1 + 1)", "sqrt(b.x**2 + b.y**2)",
     "b.x/sqrt(b.x**2 + b.y**2)", "abs(b.x)**1.5", "abs(b.x)**0.5", "asin(1 + b.x)", "acos(b.x - 1)", "log(b.x + b.y)",
     "atan2(b.y, b.x - 1)", "atan2(b.x, b.y)", "tan(b.x + pi/2)", "sin(abs(b.x))", "exp(-abs(b.x)/3)*b.y",
     "(b.x + b.y)**0.5", "1/(b.x + b.y)", "smooth_start(b.x)**2/(1 + b.y) + abs(b.y)", "(0.1 + 0.2 - 0.3 + abs(b.y))"],
)  # fmt: skip
def test_a_kink_of_an_expression_is_told_with_its_force(text):
    assert "forces.p" in kink(text)


@pytest.mark.parametrize(
    "text",
    ["b.x**3", "abs(b.x)**3", "abs(b.x)**2", "b.x**2*abs(b.x)", "c*abs(b.x)", "abs(b.x + 1)", "sqrt(1 + b.x**2)",
     "smooth_start(b.x)*b.x", "smooth_start(b.x)**2", "abs(b.x)**2.5", "atan2(b.y, 1 + b.x)", "smooth_start(t)*b.x",
     "asin(b.x)", "tan(b.x)", "tanh(1000*b.x)", "abs(c)*b.x", "1/(1 + b.x)"],
)  # fmt: skip
def test_smooth_expressions(text):
    assert kink(text) == ""


def test_quadratic_drag_has_a_kink_only_at_rest():
    assert kink("-abs(rate(b.x))*rate(b.x)")
    assert kink("-abs(rate(b.x))*rate(b.x)", order=1) == ""
    assert kink("-abs(rate(b.x))*rate(b.x)", vx=1e-3) == ""


def test_kinks_of_constraints_and_of_no_expressions():
    assert "constraints.k" in kinks(point("constraints:\n  k: {holonomic: b.x - abs(b.y)}"), [0, 0], [0, 0], 0.0)
    system = mbstab.load("models/whipple_bicycle.yaml").system()
    assert kinks(system, np.zeros(system.n_q), np.zeros(system.n_q), 0.0) == ""


# --- products that have a derivative at a kink of one of their factors ------------------------------------------------


WITH_FORCE = """
mbstab: 1
parameters: {{c: 0.7, n: pi/2}}
bodies: {{p: {{type: planar_point, mass: 1}}}}
constraints: {{rail: {{holonomic: p.y}}}}
forces:
  spring: {{type: expression, on: {{p.x: -p.x - 0.1*rate(p.x)}}}}
  f: {{type: expression, on: {{p.x: "{force}"}}}}
"""

SMOOTH = [
    "v*abs(v)", "abs(v)*sin(v)", "sinh(v)*abs(v)", "sqrt(abs(v))*v", "c*abs(v)**1.5*v", "abs(v)**2", "abs(v)**3",
    "abs(v)**1.5", "abs(v)**n", "abs(v)*(exp(v) - 1)", "abs(sin(v))*v", "abs(v)*x", "abs(x)*abs(v)", "abs(v)*(v + x)",
    "x*sqrt(abs(x))", "abs(2*v)**0.7*v", "abs(v)*tan(x)*cos(v)", "abs(3*x - v)*(3*x - v)", "abs(3*x - v)*sin(v - 3*x)",
    "(c - 0.7)*abs(v)", "v*sqrt(2*abs(v))", "abs(v*x)*v", "abs(x + v)*(exp(x) - cos(v))", "tanh(abs(v))*v",
]  # fmt: skip
"""Functions of x and v whose derivatives at 0 are 0."""

STEADY = {
    "v/(1 + abs(v))": (0, 1),
    "x*exp(abs(v))": (1, 0),
    "-v*cos(abs(x))": (0, -1),
}
"""Functions with other derivatives by x and v."""

KINKED = [
    "abs(v)", "abs(v)*cos(v)", "sqrt(abs(v))", "abs(v)**0.5*abs(v)**0.5", "abs(v)*exp(x)", "abs(v)*(1 + x)",
    "sqrt(abs(v))*sqrt(abs(x))", "abs(v) + abs(v)*v", "abs(sin(v))", "abs(abs(v))", "c*abs(v)", "abs(v)**0.9",
    "abs(v)/sqrt(abs(v))*sqrt(abs(v))*cos(x)",
]  # fmt: skip
"""Functions without a derivative at 0."""


def written(force):
    return (
        force.replace("exp", "EXP")
        .replace("v", "rate(p.x)")
        .replace("x", "p.x")
        .replace("EXP", "exp")
        .replace("p.p.x", "p.x")
    )


def mechanism(force):
    return mbstab.loads(WITH_FORCE.format(force=written(force)))


@pytest.mark.parametrize("force", [*SMOOTH, *STEADY])
def test_the_derivative_is_the_limit_of_differences(force):
    K, R = STEADY.get(force, (0.0, 0.0))
    system = System(evaluate(mechanism(force).model))
    zero = np.zeros(2)
    found_K, found_R, _ = system.linearize(zero, zero, zero, np.zeros(1))
    # The residual is mass times acceleration less the force.
    assert found_K[0, 0] == pytest.approx(1.0 - K, abs=1e-15)
    assert found_R[0, 0] == pytest.approx(0.1 - R, abs=1e-15)
    for r in (1e-8, 1e-12):
        for x, v in r * np.array([(1, 0), (-1, 0), (0, 1), (0, -1), (0.6, -0.8)]):
            (f,) = (
                -part.force([x, 0.0], [v, 0.0], [0.0, 0.0], 0.0)[0]
                for part in system.acting()
                if part.path == "forces.f"
            )
            assert abs(f - K * x - R * v) < 3.0 * r**1.4


@pytest.mark.parametrize("force", [*SMOOTH, *STEADY])
def test_linearization_decides_where_there_is_a_derivative(force):
    K, R = STEADY.get(force, (0.0, 0.0))
    found = mechanism(force).eig()
    truth = np.roots([1.0, 0.1 - R, 1.0 - K])
    assert np.abs(np.sort_complex([e.value for e in found.eigenvalues]) - np.sort_complex(truth)).max() < 1e-13
    assert max(e.error_bound for e in found.eigenvalues) < 1e-13
    if K != 1:
        assert found.verdict == ("unstable" if truth.real.max() > 0.0 else "asymptotically stable")


@pytest.mark.parametrize("force", SMOOTH)
def test_many_digits_and_balls_know_the_same_derivative(force):
    pair = [complex(float(e.real), float(e.imag)) for e in mechanism(force).eig_precise(30).eigenvalues]
    assert np.abs(np.sort_complex(pair) - np.sort_complex(np.roots([1.0, 0.1, 1.0]))).max() < 1e-14


@pytest.mark.parametrize("force", SMOOTH)
def test_proofs_know_the_same_derivative(force):
    assert mechanism(force).certify().verdict == "asymptotically stable"


@pytest.mark.parametrize("force", KINKED)
def test_what_has_no_derivative_is_refused(force):
    with pytest.raises(MbstabError, match="has no finite equations here"):
        mechanism(force).eig()


@pytest.mark.parametrize("force", KINKED)
def test_smoothness_knows_that_there_is_none(force):
    system = System(evaluate(mechanism(force).model))
    assert "has no derivative" in kinks(system, np.zeros(2), np.zeros(2), 0.0, 1) or "**0.9" in force


def test_elsewhere_signs_are_as_they_were():
    system = System(evaluate(mechanism("abs(v)*sin(x) + abs(x)**1.5*v + sqrt(abs(v))*x*v").model))
    rng = np.random.default_rng(3)
    for x, v in rng.uniform(-1.0, 1.0, (20, 2)):
        K, R, _ = system.linearize([x, 0.0], [v, 0.0], np.zeros(2), np.zeros(1))
        h = np.abs(x) ** 0.5
        assert 1.0 - K[0, 0] == pytest.approx(
            abs(v) * np.cos(x) + 1.5 * h * np.sign(x) * v + np.sqrt(abs(v)) * v, rel=1e-12, abs=1e-13
        )
        assert 0.1 - R[0, 0] == pytest.approx(
            np.sign(v) * np.sin(x) + abs(x) ** 1.5 + 1.5 * np.sqrt(abs(v)) * x, rel=1e-12, abs=1e-13
        )
    assert FLOAT.signed(2.0, -3.0) == -2.0
