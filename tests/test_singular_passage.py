"""Motions through singular configurations, along their smooth continuation, against exact solutions.

IFToMM benchmark A02 (Gonzalez, Dopico, Gonzalez, Cuadrado 2006, A benchmarking system for MBS simulation software):
N four-bar loops start upright, their pins moving at 1 m/s. Wherever the cranks lie flat the constraints lose
rank N, and each loop could fold. While all cranks stay parallel the loops move as a physical pendulum:
the half angle from the hanging position is am(K − Ω t/2, k²), Ω² = v² + 4ω², k = 2ω/Ω.
"""

import functools
import json
import math
import re

import numpy as np
import pytest
from chains import four_bar_loops
from click.testing import CliRunner
from mechanisms import SLIDER_CRANK
from sampling import sample
from scipy.special import ellipj, ellipk

import mbstab
from mbstab.cli import main
from mbstab.errors import SimulationError

START = {"rate(crank_0.theta)": -1.0}


def exact(loops, times, speed=1.0):
    """Return the angle from the hanging position, and its rate, for cranks that start upright."""
    square = 9.81 * ((loops + 1) / 2 + loops) / ((loops + 1) / 3 + loops)
    rate = math.sqrt(speed**2 + 4.0 * square)
    modulus = 4.0 * square / rate**2
    _, _, dn, am = ellipj(ellipk(modulus) - 0.5 * rate * np.asarray(times), modulus)
    return 2.0 * am, -rate * dn


def passages(loops, to):
    """Return the times at which the cranks lie flat, by the quarter periods of the incomplete integral."""
    from scipy.special import ellipkinc

    square = 9.81 * ((loops + 1) / 2 + loops) / ((loops + 1) / 3 + loops)
    rate = math.sqrt(1.0 + 4.0 * square)
    modulus = 4.0 * square / rate**2
    angles = math.pi / 4 - 0.5 * math.pi * np.arange(40)
    times = 2.0 / rate * (ellipk(modulus) - ellipkinc(angles, modulus))
    return times[times < to]


@functools.cache
def model(loops):
    return mbstab.loads(four_bar_loops(loops, "pi/2"))


def assert_exact(sim, loops, allowed):
    angle, rate = exact(loops, sim.times)
    turns, speeds = (x[:, 2 : 3 * loops + 3 : 3] for x in (sim.q, sim.u))
    assert np.max(np.abs(turns + 0.5 * math.pi - angle[:, None])) <= allowed * np.max(np.abs(rate))
    assert np.max(np.abs(speeds - rate[:, None])) <= allowed * np.max(np.abs(rate))
    # Cranks and couplers stay parallel.
    assert np.max(np.ptp(turns, axis=1)) <= 1e-10
    assert np.max(np.abs(sim.q[:, 3 * loops + 5 :: 3])) <= 1e-10


@pytest.mark.parametrize(
    ("loops", "to", "tol"), sample([(2, 5.0, 1e-8), (1, 10.0, 1e-8), (10, 1.5, 1e-7), (2, 4.0, 1e-10)], 4)
)
def test_the_n_four_bar_mechanism_turns_through_its_singular_configurations(loops, to, tol):
    sim = model(loops).simulate(to, perturb=START, tol=tol, through_singular=True)
    assert_exact(sim, loops, 3.0 * tol)
    assert sim.energy_drift <= tol
    assert sim.max_constraint_residual <= 1e-12
    assert sim.steps <= 30 * to
    (said,) = sim.warnings
    found = [float(x) for x in re.search(r"configurations at t = ([\d., ]*\d)", said)[1].split(", ")]
    expected = passages(loops, to)
    assert found == pytest.approx(expected[: len(found)], abs=1e-5)
    assert len(found) == min(len(expected), 8)
    assert f"({len(expected)} times)" in said or len(expected) <= 8
    assert "could have gone on in another way" in said
    assert re.search(r"joint 'left_\d+'", said)


@pytest.mark.parametrize(
    "options",
    sample(
        [
            {"method": "radau", "tol": 1e-6},
            {"method": "alpha", "tol": 1e-3},
            {"solver": "RK45", "tol": 1e-6},
            {"solver": "Radau", "tol": 1e-5},
            {"solver": "BDF", "tol": 1e-4},
            {"compiled": True, "tol": 1e-8},
        ],
        3,
    ),
    ids=str,
)
def test_every_method_goes_through_and_keeps_its_tolerance(options):
    sim = model(2).simulate(2.0, perturb=START, points=101, through_singular=True, **options)
    assert_exact(sim, 2, 3.0 * options["tol"])
    assert len(sim.warnings) == 1


@pytest.mark.few(1)
@pytest.mark.parametrize(("method", "step", "order"), [("radau", 0.04, 5), ("alpha", 0.01, 2), ("projection", 0.1, 8)])
def test_fixed_steps_keep_their_order_through_singular_configurations(method, step, order):
    errors = []
    for h in (step, step / 2, step / 4):
        sim = model(1).simulate(3.0, perturb=START, points=61, through_singular=True, method=method, step=h)
        errors.append(np.max(np.abs(sim.q[:, 2] + 0.5 * math.pi - exact(1, sim.times)[0])))
    # Steps differ in where they begin again behind a passage: a single halving of the step tells too little.
    assert 0.5 * math.log2(errors[0] / errors[2]) == pytest.approx(order, abs=0.8)


def test_without_the_option_it_is_refused_and_the_option_named():
    with pytest.raises(SimulationError, match="singular configuration at t = ") as caught:
        model(2).simulate(2.0, perturb=START)
    assert "--through-singular" in str(caught.value)
    assert caught.value.partial.times[-1] < passages(2, 2.0)[0]


def test_what_does_work_is_counted_on_a_passage_too():
    damped = json.loads(four_bar_loops(2, "pi/2"))
    damped["forces"] = {"d": {"type": "joint_spring", "joint": "pivot_0", "stiffness": 0.0, "damping": 0.7}}
    sim = mbstab.loads(json.dumps(damped)).simulate(3.0, perturb=START, through_singular=True)
    assert not sim.conservative
    assert sim.work[-1] < -20.0
    assert sim.energy_drift <= 1e-8
    assert "singular" in sim.warnings[0]


def test_output_at_the_singular_instant_is_finite():
    time = passages(2, 2.0)[0]
    sim = model(2).simulate(2.0 * time, perturb=START, points=3, through_singular=True)
    angle, rate = exact(2, time)
    assert sim.q[1, :3] == pytest.approx([0.5, 0.0, angle - 0.5 * math.pi], abs=1e-8)
    assert sim.u[1, 2] == pytest.approx(rate, rel=1e-8)
    # Half of the angle from the hanging position is a quarter turn: all weight accelerates.
    assert sim.a[1, 2] == pytest.approx(-9.81 * 3.5 / 3.0, rel=1e-7)
    assert np.all(np.isfinite(sim.loads))


def test_a_driven_slider_crank_of_equal_lengths_goes_through():
    text = SLIDER_CRANK.replace("LENGTH", "1").replace("LAW", "position: 0.2 + 2*t")
    sim = mbstab.loads(text).simulate(4.0, through_singular=True)
    assert sim.q[:, sim.names.index("slider.x")] == pytest.approx(2.0 * np.cos(0.2 + 2.0 * sim.times), abs=1e-10)
    assert sim.energy_drift <= 1e-8
    assert "drive 'motor'" in sim.warnings[0]


def test_a_spatial_parallelogram_goes_through():
    text = """\
mbstab: 1
gravity: [0, -9.81, 0]
bodies:
  left: {type: spatial, mass: 1, inertia: [1/12, 1/12, 1/12], points: {A: [-0.5, 0, 0], C: [0.5, 0, 0]}}
  right: {type: spatial, mass: 1, inertia: [1/12, 1/12, 1/12], points: {B: [-0.5, 0, 0], D: [0.5, 0, 0]}}
  coupler: {type: spatial, mass: 1, inertia: [1/12, 1/12, 1/12], points: {C: [-0.5, 0, 0], D: [0.5, 0, 0]}}
joints:
  A: {type: revolute, between: [left.A, ground], axis: z}
  B: {type: revolute, between: [right.B, {body: ground, point: [1, 0, 0]}], axis: z}
  C: {type: universal, between: [coupler.C, left.C], axis: [[0, 1, 0], [0, 0, 1]]}
  D: {type: spherical, between: [coupler.D, right.D]}
reference:
  coordinates:
    left: {x: 0, y: 0.5, z: 0, phi: 0, theta: 0, psi: pi/2}
    right: {x: 1, y: 0.5, z: 0, phi: 0, theta: 0, psi: pi/2}
    coupler: {x: 0.5, y: 1, z: 0, phi: 0, theta: 0, psi: 0}
"""
    sim = mbstab.loads(text).simulate(2.0, perturb={"rate(left.psi)": -1.0}, tol=1e-7, through_singular=True)
    angle, rate = exact(1, sim.times)
    assert np.max(np.abs(sim.rotations[:, 0, 1, 0] + np.cos(angle))) <= 3e-7
    assert np.max(np.abs(sim.spins[:, 0, 2] - rate)) <= 3e-7 * np.max(np.abs(rate))
    assert np.max(np.abs(sim.spins[:, 2])) <= 1e-7
    assert "joint 'D'" in sim.warnings[0]


def test_a_limit_is_no_passage():
    text = """\
mbstab: 1
bodies: {p: {type: planar_point, mass: 1}, e: {type: planar_point, mass: 1}}
joints: {one: {type: distance, between: [p, ground], length: 1}, two: {type: distance, between: [e, p], length: 1}}
drives:
  dx: {type: coordinate, coordinate: e.x, position: 1 + t/2}
  dy: {type: coordinate, coordinate: e.y, position: 0}
reference: {coordinates: {e: {x: 1, y: 0}}, guess: {p: {x: 0.5, y: 0.8}}}
"""
    with pytest.raises(SimulationError, match=r"singular configuration at t = 2 s.*\n.*\nhint: the mechanism may be"):
        mbstab.loads(text).simulate(10.0, through_singular=True)


def test_the_command_goes_through_with_a_warning():
    arguments = ["simulate", "four_bar.yaml", "--to", "0.5", "--perturb", "rate(left.theta)=9", "--through-singular"]
    result = CliRunner().invoke(main, [*arguments, "--format", "json"])
    assert result.exit_code == 0
    assert "the motion passed singular configurations at t = 0.185283" in result.stderr
    (said,) = json.loads(result.stdout)["warnings"]
    assert "singular" in said


def test_a_turn_in_a_singular_configuration_is_refused():
    # The cranks are driven to lie flat at the turn: there is no crossing.
    driven = json.loads(four_bar_loops(1, "pi/2"))
    law = "pi/2*(1 - smooth_start(t))"
    driven["drives"] = {"motor": {"type": "coordinate", "coordinate": "crank_0.theta", "position": law}}
    with pytest.raises(SimulationError, match="singular configuration"):
        mbstab.loads(json.dumps(driven)).simulate(2.0, tol=1e-6, through_singular=True)


@pytest.mark.long
def test_a_passage_under_a_given_function_of_time():
    driven = json.loads(four_bar_loops(1, "pi/2"))
    law = "pi/2 - 2*sin(t)"
    driven["drives"] = {"motor": {"type": "coordinate", "coordinate": "crank_0.theta", "position": law}}
    sim = mbstab.loads(json.dumps(driven)).simulate(3.0, tol=1e-7, through_singular=True)
    assert sim.q[:, 5] == pytest.approx(0.5 * math.pi - 2.0 * np.sin(sim.times), abs=1e-7)
    assert sim.energy_drift <= 1e-6
    assert re.search(r"at t = 0\.903339, 2\.23825 s", sim.warnings[0])
