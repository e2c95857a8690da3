"""Motions that run into a limit end soon and say why; steps that are limited by stability are said to be."""

import itertools
import math
import re
from itertools import product

import numpy as np
import pytest
from click.testing import CliRunner
from mechanisms import SLIDER_CRANK
from sampling import sample
from scipy.linalg import expm

import mbstab
from mbstab.analysis.algebra import budget
from mbstab.analysis.simulate import pace, recording
from mbstab.analysis.simulate.tolerances import TOLERANCES as SIMULATE
from mbstab.cli.main import main
from mbstab.errors import SimulationError

# Each ends where two links lie on a line; the time is exact.
LINKS = """\
mbstab: 1
bodies: {p: {type: planar_point, mass: 1}, e: {type: planar_point, mass: 1}}
joints: {one: {type: distance, between: [p, ground], length: 1}, two: {type: distance, between: [e, p], length: 1}}
drives: {dx: {type: coordinate, coordinate: e.x, LAW}, dy: {type: coordinate, coordinate: e.y, position: 0}}
reference: {coordinates: {e: {x: 1, y: 0}}, guess: {p: {x: 0.5, y: 0.8}}}
"""
# A second motion is free here: the links turn about the line between their ends, faster and faster.
SPATIAL_LINKS = """\
mbstab: 1
gravity: [0, 0, -9.81]
bodies: {p: {type: point, mass: 1}, e: {type: point, mass: 1}}
joints: {one: {type: distance, between: [p, ground], length: 1}, two: {type: distance, between: [e, p], length: 1}}
drives:
  dx: {type: coordinate, coordinate: e.x, LAW}
  dy: {type: coordinate, coordinate: e.y, position: 0}
  dz: {type: coordinate, coordinate: e.z, position: 0}
reference: {coordinates: {e: {x: 1, y: 0, z: 0}, p: {y: 0.1}}, rates: {p: {y: 1}}, guess: {p: {x: 0.5, z: -0.8}}}
"""
FOUR_BAR = """\
mbstab: 1
gravity: [0, -9.81]
bodies:
  crank: {type: planar, mass: 1, shape: {type: rod, length: 2}, points: {O: [-1, 0], A: [1, 0]}}
  coupler: {type: planar, mass: 1, shape: {type: rod, length: 2}, points: {A: [-1, 0], B: [1, 0]}}
  rocker: {type: planar, mass: 1, shape: {type: rod, length: 2}, points: {B: [-1, 0], C: [1, 0]}}
joints:
  O: {type: revolute, between: [crank.O, ground]}
  A: {type: revolute, between: [crank.A, coupler.A]}
  B: {type: revolute, between: [coupler.B, rocker.B]}
  C: {type: revolute, between: [rocker.C, {body: ground, point: [3, 0]}]}
drives: {motor: {type: coordinate, coordinate: crank.theta, LAW}}
reference:
  coordinates: {crank: {theta: pi/3}}
  guess: {crank: {x: 0.5, y: 0.9}, coupler: {x: 2, y: 1.8, theta: 0}, rocker: {x: 3, y: 1, theta: -1.4}}
"""
SPATIAL_LEVER = """\
mbstab: 1
gravity: [0, 0, -9.81]
bodies:
  a: {type: point, mass: 1}
  b: {type: spatial, mass: 1, inertia: [0.1, 0.2, 0.3], points: {E: [0.5, 0, 0]}}
joints:
  hinge: {type: revolute, between: [b, ground], axis: z}
  d: {type: distance, between: [a, b.E], length: 1}
  line: {type: point_on_line, between: [{body: ground, point: [0, 0, 0.3]}, a], axis: x}
drives: {go: {type: coordinate, coordinate: a.x, LAW}}
reference: {coordinates: {a: {x: 1}, b: {z: 0}}, guess: {a: {z: 0.3}, b: {psi: 1}}}
"""
LIMITS = {
    "links": (LINKS, "1 + t/2", 0.5, 2.0, "joint 'one', joint 'two', drive 'dx'"),
    "spatial links": (SPATIAL_LINKS, "1 + t/2", 0.5, 2.0, "joint 'one', joint 'two', drive 'dx'"),
    "slider crank": (
        SLIDER_CRANK.replace("LENGTH", "0.8"),
        "0.2 + 2*t",
        2.0,
        (math.asin(0.8) - 0.2) / 2,
        "joint 'A', joint 'B', drive 'motor'",
    ),
    "four-bar": (FOUR_BAR, "pi/3 + t", 1.0, math.acos(-0.25) - math.pi / 3, "joint 'A', joint 'B', drive 'motor'"),
    "spatial lever": (SPATIAL_LEVER, "1 + 0.4*t", 0.4, (0.5 + math.sqrt(0.91) - 1) / 0.4, "joint 'd', drive 'go'"),
}


def text(name, drive):
    model, law, rate, time, rows = LIMITS[name]
    return model.replace("LAW", f"position: {law}" if drive == "law" else f"velocity: {rate!r}"), time, rows


@pytest.mark.parametrize("drive", ["law", "rate"])
@pytest.mark.parametrize("name", LIMITS)
def test_a_drive_into_a_limit_ends_there_with_the_rows_that_lock(name, drive):
    model, time, rows = text(name, drive)
    with pytest.raises(SimulationError, match="singular configuration at t = ") as caught:
        mbstab.loads(model).simulate(10.0)
    said, partial = str(caught.value), caught.value.partial
    assert float(re.search(r"at t = (\S+) s", said)[1]) == pytest.approx(time, abs=1e-8)
    assert re.search(r"falls to \d\.\de-0\d of that at the start, where 1e-05 is the threshold", said)
    assert all(row in said for row in rows.split(", "))
    assert "hint: the mechanism may be driven to a limit" in said
    assert "the part until t = " in said
    assert time - 0.021 < partial.times[-1] <= time
    assert partial.max_constraint_residual < 1e-11
    # The largest run makes a few hundred steps, where it once made millions.
    assert partial.evaluations < 20000


OTHERS = [
    {"tol": 1e-12},
    {"tol": 1e-3},
    {"solver": "RK45"},
    {"solver": "Radau", "tol": 1e-6},
    {"solver": "BDF", "tol": 1e-4},
    {"method": "radau"},
    {"method": "alpha", "tol": 1e-4},
    {"step": 0.01},
    {"method": "radau", "step": 0.01},
    {"method": "alpha", "step": 0.01},
    {"compiled": True},
    {"compiled": True, "solver": "RK45", "tol": 1e-6},
]


@pytest.mark.few(2)
@pytest.mark.parametrize(
    ("which", "options"), sample(product([("four-bar", "law"), ("spatial links", "rate")], OTHERS), 5), ids=str
)
def test_every_method_ends_at_a_limit(which, options):
    model, time, rows = text(*which)
    with pytest.raises(SimulationError, match="singular configuration") as caught:
        mbstab.loads(model).simulate(10.0, **options)
    said = str(caught.value)
    assert float(re.search(r"t = (\S+) s", said)[1]) == pytest.approx(time, abs=0.0201 if "step" in options else 1e-3)
    assert any(row in said for row in rows.split(", "))
    assert "hint: the mechanism may be driven to a limit" in said
    assert len(caught.value.partial.times) > 10


@pytest.mark.parametrize(("gap", "compiled"), sample([(1e-6, True), (1e-2, True), (1e-2, False), (1e-6, False)], 4))
def test_a_motion_that_turns_just_before_its_limit_goes_on(gap, compiled):
    model = mbstab.loads(LINKS.replace("LAW", f"position: 1 + {1 - gap!r}*sin(t)"))
    sim = model.simulate(3.0, tol=1e-7, compiled=compiled)
    x = 0.5 * (1.0 + (1.0 - gap) * np.sin(sim.times))
    y, speed = np.sqrt(1.0 - x * x), 0.5 * (1.0 - gap) * np.cos(sim.times)
    assert np.max(np.abs(sim.q[:, 1] - y)) <= 1e-7
    assert np.max(np.abs(sim.u[:, 1] + x * speed / y)) <= 1e-7 * np.max(np.abs(sim.u))
    assert sim.warnings == ()


# --- stiff motions ----------------------------------------------------------------------------------------------------

DRAGGED = """\
mbstab: 1
bodies: {rod: {type: planar, mass: 1, inertia: 0.03, points: {O: [-0.3, 0]}}}
joints: {pivot: {type: revolute, between: [rod.O, ground]}}
forces: {drag: {type: expression, on: {rod.theta: -DRAG*(rate(rod.theta) + rod.theta - 1)}}}
reference: {coordinates: {rod: {theta: 0}}, guess: {rod: {x: 0.3}}}
"""


SPRING = """\
mbstab: 1
bodies: {p: {type: planar_point, mass: 1}}
forces: {s: {type: spring, between: [p, ground], stiffness: 1e6, length: 1}}
reference: {coordinates: {p: {x: 1.1, y: 0}}}
"""


@pytest.mark.parametrize(("solver", "compiled"), sample(product(["DOP853", "RK45"], [False, True]), 3))
def test_steps_that_stability_limits_are_said(solver, compiled):
    model = mbstab.loads(DRAGGED.replace("DRAG", "2e3"))
    sim = model.simulate(0.3, tol=1e-5, once=True, solver=solver, compiled=compiled)
    (said,) = sim.warnings
    assert "are limited by stability, not by accuracy" in said
    # The inertia about the pivot is 0.12.
    assert float(re.search(r"possible there, (\S+) 1/s", said)[1]) == pytest.approx(2e3 / 0.12, rel=0.03)
    mean, other = (float(x) for x in re.findall(r"steps of (\S+) s", said))
    assert mean == pytest.approx(0.3 / sim.steps, rel=0.3)
    assert other >= SIMULATE.implicit_step_factor * mean
    assert model.simulate(0.3, tol=1e-5, once=True, method="radau").warnings == ()


@pytest.mark.long
@pytest.mark.parametrize("solver", sample(["RK45", "DOP853"], 2))
def test_a_motion_that_would_never_end_is_refused(solver):
    with pytest.raises(SimulationError, match="limited by stability, not by accuracy") as caught:
        mbstab.loads(DRAGGED.replace("DRAG", "1e9")).simulate(2.0, solver=solver)
    said = str(caught.value)
    assert re.search(r"\d\.\de\+\d\d more would be needed, where 1e\+07 is the limit\nhint: use --method radau", said)


@pytest.mark.parametrize(("name", "to"), sample([("rattleback", 10.0), ("kapitza", 2.0), ("wheelset", 10.0)], 3))
def test_the_examples_with_the_most_steps_are_not_stiff(name, to):
    sim = mbstab.load(f"{name}.yaml").simulate(to, perturb={"mode:1": 0.01}, once=True, tol=1e-10, points=2)
    assert sim.steps > SIMULATE.stiffness_first_test
    assert sim.warnings == ()


def test_steps_that_are_too_short_for_any_method_are_refused(monkeypatch):
    monkeypatch.setattr("mbstab.analysis.simulate.tolerances.Tolerances.steps_left", 100.0)
    monkeypatch.setattr("mbstab.analysis.simulate.tolerances.Tolerances.steps_of_slow_pace", 500)
    with pytest.raises(SimulationError, match=r"too short for the motion: \S+ more would be needed, where 1e\+02 is"):
        mbstab.loads(SPRING).simulate(10.0, once=True, points=2)


def test_a_fast_motion_that_is_seen_is_not_stiff():
    # It really swings at 1000 1/s.
    sim = mbstab.loads(SPRING).simulate(1.0, once=True, points=2)
    assert sim.steps > SIMULATE.stiffness_first_test
    assert sim.warnings == ()


# --- long simulations -------------------------------------------------------------------------------------------------


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("text", "to", "options", "said"),
    [
        (SPRING, 0.3, {}, r"for errors of 1e-06 in a step; .* p\.x with \S+ m/s, .* a rate of 1\.0e\+03 1/s"),
        (
            SPRING,
            0.3,
            {"step": 1e-3, "method": "radau"},
            r"steps of 1\.0e-03 s as given\nhint: --compiled \(steps in machine code\), a longer --step or an",
        ),
        (DRAGGED.replace("DRAG", "2e3"), 0.3, {"tol": 1e-5}, "limited by stability.*\nhint: --method radau .steps of"),
        (
            LINKS.replace("LAW", "position: 1 + 0.5*smooth_start(t/1.5)"),
            1.0,
            {"tol": 1e-3, "points": 501},
            r"where \S+ s is the longest, .*\nhint: .*fewer --points",
        ),
    ],
)
def test_a_long_simulation_says_early_how_long_and_why(monkeypatch, text, to, options, said):
    now = itertools.count(0.0, 1.0)
    monkeypatch.setattr(pace, "clock", lambda: next(now))  # a second goes by at each look
    told = []
    sim = mbstab.loads(text).simulate(to, tell=told.append, **options)
    first = next(x for x in told if "more at the present pace" in x)
    assert re.search(said, first)
    assert first not in sim.warnings


def test_what_is_left_of_a_long_simulation(monkeypatch):
    now = [100.0]
    monkeypatch.setattr(pace, "clock", lambda: now[0])
    budget = pace.Budget(1.0, 11.0)
    budget.start_run(2.0)
    found = {}
    for second in range(1, 40):
        now[0] = 100.0 + second
        found[second] = budget.left(1.0 + 0.1 * second)  # a run of 100 s, and two more
    assert [k for k, left in found.items() if left is not None] == [5]
    assert found[5] == pytest.approx(295.0)
    now[0] = 260.0  # it has become four times as slow
    assert budget.left(1.0 + 0.1 * 40) == pytest.approx(3 * 400.0 - 160.0)


def test_a_short_simulation_says_nothing_about_its_time(monkeypatch):
    now = itertools.count(0.0, 1e-3)
    monkeypatch.setattr(pace, "clock", lambda: next(now))
    told = []
    mbstab.loads(SPRING).simulate(0.5, tell=told.append)
    assert told == []


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.2, "1 s"), (89.0, "89 s"), (700.0, "12 min"), (1e4, "3 h"), (1e6, "12 days"), (1e300, "1.2e+295 days")],
)
def test_durations(seconds, text):
    assert budget.duration(seconds) == text


# --- numbers at the ends of the range of double precision -------------------------------------------------------------


@pytest.mark.parametrize("value", ["1e-200", "1e-160", "0", "-1", "1e160", "1e200"])
@pytest.mark.parametrize(
    ("model", "name"),
    [
        ("chaplygin_sleigh", "v"),
        ("free_rigid_body", "Omega"),
        ("shimmy", "u"),
        ("trailer", "v"),
        ("wheelset_no_slip", "v"),
        ("pendulum", "g"),
        ("top", "g"),
    ],
)
def test_extreme_parameters_give_an_answer_or_a_message(model, name, value):
    result = CliRunner().invoke(
        main, ["simulate", f"{model}.yaml", "--to", "0.05", "--points", "3", "--set", f"{name}={value}"]
    )
    assert result.exception is None or isinstance(result.exception, SystemExit)
    assert "Traceback" not in result.output
    if result.exit_code == 0:
        assert re.search(r"drift by \d\.\de[+-]\d\d of", " ".join(result.stdout.split()))
    else:
        assert result.stderr.strip()


@pytest.mark.parametrize("compiled", [False, True])
def test_rest_is_found_to_the_tolerance_with_few_steps(compiled):
    # Rounding leaves forces of 1e-16 of the weight there.
    sim = mbstab.load("pendulum.yaml").simulate(30.0, compiled=compiled)
    assert sim.warnings == ()
    assert sim.error_estimate <= 1e-8
    assert sim.steps < 500
    assert np.max(np.abs(sim.u)) < 1e-11


def test_matrices_of_large_scenes_are_held_for_few_states(monkeypatch):
    held = []
    monkeypatch.setattr(recording, "reactions", lambda system, q, u, J, nu: held.append(J.shape) or [])
    monkeypatch.setattr("mbstab.analysis.simulate.tolerances.Tolerances.matrix_numbers_together", 3 * 20)
    result = mbstab.load("double_pendulum.yaml").simulate(0.01, points=11)
    assert len(result.times) == 11
    assert sum(shape[0] for shape in held) == 11
    assert max(math.prod(shape) for shape in held) <= 60


RUNAWAY = """\
mbstab: 1
gravity: [0, 0, -9.81]
bodies:
  a: {type: spatial, mass: 1, inertia: [0.1, 0.1, 0.1], points: {p: [-0.5, 0, 0], e: [0.5, 0, 0]}}
  b: {type: spatial, mass: 1, inertia: [0.1, 0.1, 0.1], points: {p: [-0.5, 0, 0]}}
joints:
  pin: {type: revolute, between: [a.p, ground], axis: z}
  knee: {type: revolute, between: [b.p, a.e], axis: x}
forces:
  wrong: {type: expression, on: {angle(pin): 0.5*rate(angle(pin))**2}}
reference:
  coordinates: {a: {x: 0.5, y: 0, z: 0, phi: 0, theta: 0, psi: 0}, b: {phi: 0.3, theta: 0, psi: 0}}
  rates: {a: {psi: 2}, b: {phi: 1}}
"""


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("bound", "options"),
    [(True, {}), (True, {"compiled": True}), (False, {}), (False, {"compiled": True}), (False, {"method": "radau"})],
    ids=str,
)
def test_a_motion_that_runs_away_is_told_as_such(options, bound):
    # A torque with the square of the speed: infinite after a finite time.
    free = """\
mbstab: 1
bodies: {a: {type: planar, mass: 1, inertia: 0.5}}
forces: {wrong: {type: expression, on: {a.theta: rate(a.theta)**2}}}
reference: {rates: {a: {theta: 2}}}
"""
    with pytest.raises(mbstab.SimulationError) as caught:
        mbstab.loads(RUNAWAY if bound else free).simulate(20, points=21, tol=1e-3, **options)
    first = str(caught.value).splitlines()[0]
    told = re.fullmatch(
        r"the motion runs away: at t = (\S+) s (\S+) has (\S+) (m|rad)/s, and rates are (\S+) times .*", first
    )
    assert told, first
    assert "singular configuration" not in str(caught.value)
    assert abs(float(told[3])) > 1e5
    assert float(told[5]) > 1e4
    if not bound:  # 1/ω falls linearly: ω' = 2 ω² from 2 rad/s
        assert float(told[1]) == pytest.approx(0.25, rel=1e-3)


def test_a_failure_is_told_before_the_part_that_is_kept(tmp_path):
    model = tmp_path / "runaway.yaml"
    model.write_text(RUNAWAY, encoding="utf-8")
    result = CliRunner().invoke(main, ["simulate", str(model), "--to", "20", "--tol", "1e-3", "--points", "21"])
    assert result.exit_code == 1
    assert result.output.index("the motion runs away") < result.output.index("ended early")
    assert result.output.count("the motion runs away") == 1


TWISTED = """\
mbstab: 1
bodies:
  one: {type: KIND, mass: 1, inertia: INERTIA}
  two: {type: KIND, mass: 1, inertia: INERTIA}
joints:
  a: {type: revolute, between: [one, ground]AXIS}
  b: {type: revolute, between: [two, ground]AXIS}
  belt: {type: belt, joints: [a, b], radii: [0.3, 0.2], stiffness: 4}
forces:
  spring: {type: joint_spring, joint: a, stiffness: 0.1}
reference: {rates: {one: {ANGLE: RATE}}}
"""


def twisted(dimension, rate):
    words = (("KIND", "planar", "spatial"), ("INERTIA", "0.5", "[0.3, 0.3, 0.5]"), ("AXIS", "", ", axis: z"))
    text = TWISTED.replace("RATE", str(rate)).replace("ANGLE", "theta" if dimension == 2 else "psi")
    for word, plane, space in words:
        text = text.replace(word, plane if dimension == 2 else space)
    return mbstab.loads(text).simulate(4.0, points=41, tol=1e-6)


@pytest.mark.few(2)
@pytest.mark.parametrize(("rate", "told"), [(0.9, []), (1.7, ["belt"]), (8.0, ["belt", "spring"])])
def test_springs_in_space_that_a_motion_takes_beyond_half_a_turn_are_told(rate, told):
    """In the plane, where angles count turns, they hold; in space the motion is the same until what is told."""
    K = 8.0 * np.array([[0.09, -0.06], [-0.06, 0.04]]) + np.diag([0.1, 0.0])
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [-K / 0.5, np.zeros((2, 2))]])
    plane, space = twisted(2, rate), twisted(3, rate)
    own = np.array([expm(A * t) @ [0.0, 0.0, rate, 0.0] for t in plane.times])
    assert plane.warnings == ()
    assert plane.motions == pytest.approx(own[:, :2], abs=1e-5 * rate)
    beyond = np.abs(own[:, 0] - own[:, 1] * 2 / 3) > np.pi / 3  # the wheels stand as before after 2 and 3 turns
    until = int(np.argmax(beyond)) if beyond.any() else len(own)
    assert space.motions[:until] == pytest.approx(own[:until, :2], abs=1e-5 * rate)
    assert [name for name in ("belt", "spring") if any(f"'{name}' turned beyond" in x for x in space.warnings)] == told
    assert beyond.any() == ("belt" in told)
