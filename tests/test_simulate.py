"""Simulations against closed forms, the orders of the methods, and what happens where a motion cannot go on."""

import csv
import functools
import json
import math
import re
import signal
import subprocess
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from children import child, command_line, processor_time, until
from click.testing import CliRunner
from mechanisms import FREE_DISK
from sampling import sample
from scipy.integrate import solve_ivp
from scipy.special import ellipj, ellipk

import mbstab
from mbstab.analysis.reference.motion import Finder
from mbstab.analysis.reference.rotation import euler_angles, rate_drift, rate_matrix
from mbstab.analysis.simulate.accuracy import pulses
from mbstab.analysis.simulate.start import mode_shape, start_of
from mbstab.analysis.simulate.steppers.table import METHODS
from mbstab.analysis.simulate.tolerances import TOLERANCES as SIMULATE
from mbstab.cli import main
from mbstab.compiler import form
from mbstab.errors import MbstabError, ModelFileError, SimulationError, UsageError
from mbstab.model.dependencies import uneven
from mbstab.model.expressions import parse
from mbstab.model.library import installed_models

PENDULUM = mbstab.load("pendulum.yaml")
RELEASED = {"rod.theta": math.pi / 4}
OMEGA = math.sqrt(3.0 * 9.81 / 0.8)
MODULUS = math.sin(math.pi / 8)
PERIOD = 4.0 * ellipk(MODULUS**2) / OMEGA

SOURCE = Path(PENDULUM.model.document.name).read_text(encoding="utf-8")

BODY = """\
mbstab: 1
bodies: {body: {type: spatial, mass: 1, inertia: [1, 2, 3]}}
"""


def exact_pendulum(times):
    """Return the angle from the downward vertical and its rate after release at 45 degrees."""
    sn, cn, dn, _ = ellipj(ellipk(MODULUS**2) - OMEGA * times, MODULUS**2)
    angle = 2.0 * np.arcsin(MODULUS * sn)
    return angle, -2.0 * MODULUS * OMEGA * cn * dn / np.cos(0.5 * angle)


# --- accuracy -------------------------------------------------------------------------------------------------------


def test_a_pendulum_released_at_45_degrees_moves_as_the_elliptic_functions_say():
    sim = PENDULUM.simulate(5.0, perturb=RELEASED, tol=1e-9)
    angle, rate = exact_pendulum(sim.times)
    assert sim.q[0, 2] - 1.5 * math.pi == pytest.approx(math.pi / 4, abs=1e-15)
    assert np.max(np.abs(sim.q[:, 2] - 1.5 * math.pi - angle)) <= 1e-9
    assert np.max(np.abs(sim.u[:, 2] - rate)) <= 1e-9 * OMEGA
    assert np.max(np.abs(sim.a[:, 2] + OMEGA**2 * np.sin(angle))) <= 1e-8 * OMEGA**2


@pytest.mark.parametrize(
    ("tol", "options"),
    sample(
        [
            (1e-4, {}),
            (1e-7, {}),
            (1e-10, {}),
            (1e-5, {"solver": "RK45"}),
            (1e-8, {"solver": "RK45"}),
            (1e-6, {"solver": "Radau"}),
            (1e-4, {"solver": "BDF"}),
            (1e-3, {"method": "alpha"}),
            (1e-7, {"method": "radau"}),
            (1e-4, {"method": "radau"}),
        ],
        every=3,
    ),
    ids=str,
)
def test_the_tolerance_is_the_global_error_to_the_factor_that_is_documented(tol, options):
    sim = PENDULUM.simulate(2.5, perturb=RELEASED, tol=tol, points=51, **options)
    angle, rate = exact_pendulum(sim.times)
    place = 0.2 * np.stack([np.sin(angle), -np.cos(angle)], axis=1)
    error = max(
        np.max(np.abs(sim.positions[:, 0] - place)) / 0.2,
        np.max(np.abs(sim.rotations[:, 0, 0, 0] - np.sin(angle))),
        np.max(np.abs(sim.u[:, 2] - rate)) / np.max(np.abs(rate)),
    )
    assert sim.warnings == ()
    assert sim.error_estimate <= tol
    assert error <= SIMULATE.error_factor * sim.error_estimate + 1e-13
    assert error <= SIMULATE.error_factor * tol


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("degrees", "to"), sample([(165, 10), (165, 20), (170, 10), (172, 10), (172, 20), (175, 10)], 3)
)
def test_the_estimate_holds_where_errors_of_two_runs_agree_by_chance(degrees, to):
    start = math.radians(degrees)
    modulus = math.sin(start / 2)
    sim = PENDULUM.simulate(to, perturb={"rod.theta": start}, tol=1e-6)
    sn, cn, dn, _ = ellipj(ellipk(modulus**2) - OMEGA * sim.times, modulus**2)
    angle = 2.0 * np.arcsin(modulus * sn)
    rate = -2.0 * modulus * OMEGA * cn * dn / np.cos(0.5 * angle)
    error = max(
        np.max(np.abs(sim.rotations[:, 0, 0, 0] - np.sin(angle))),
        np.max(np.abs(sim.rotations[:, 0, 1, 0] + np.cos(angle))),
        np.max(np.abs(sim.u[:, 2] - rate)) / np.max(np.abs(rate)),
    )
    assert sim.warnings == ()
    assert sim.runs >= 3
    assert error <= SIMULATE.error_factor * sim.error_estimate


@pytest.mark.parametrize(
    "options", sample([{}, {"solver": "RK45"}, {"method": "radau"}, {"method": "alpha"}], 2), ids=str
)
def test_many_outputs_cost_no_evaluations_and_are_as_accurate_as_few(options):
    tol = 1e-5 if options else 1e-9
    text = SOURCE.replace(
        "expect:", "forces:\n  d: {type: joint_spring, joint: pivot, stiffness: 0, damping: 0.01}\nexpect:"
    )
    model = mbstab.loads(text)
    few, many = (model.simulate(2.0, perturb=RELEASED, tol=tol, points=n, once=True, **options) for n in (21, 2001))
    exact = model.simulate(2.0, perturb=RELEASED, tol=1e-13, points=21, once=True)
    # Dense output of DOP853 takes three evaluations in each step that has an output time.
    assert many.evaluations <= few.evaluations + 3 * many.steps
    assert np.max(np.abs(many.q[::100] - few.q)) <= 1e-13
    assert np.max(np.abs(many.work[::100] - few.work)) <= 1e-15
    # Work and energy are as accurate as the motion.
    work, moved = np.max(np.abs(exact.work)), np.max(np.abs(exact.u))
    limit = max(30.0 * tol, np.max(np.abs(many.u[::100] - exact.u)) / moved)
    assert np.max(np.abs(many.work[::100] - exact.work)) <= limit * work
    assert many.energy_drift <= limit
    assert many.max_constraint_residual <= 2e-14


def test_every_one_of_many_outputs_keeps_the_tolerance():
    sim = PENDULUM.simulate(2.5, perturb=RELEASED, tol=1e-8, points=5001)
    angle, rate = exact_pendulum(sim.times)
    error = max(
        np.max(np.abs(sim.rotations[:, 0, 0, 0] - np.sin(angle))),
        np.max(np.abs(sim.u[:, 2] - rate)) / np.max(np.abs(rate)),
    )
    assert error <= SIMULATE.error_factor * sim.error_estimate + 1e-13
    assert sim.error_estimate <= 1e-8
    assert sim.max_constraint_residual <= 2e-14


def test_errors_at_rest_are_those_of_the_scene():
    sim = PENDULUM.simulate(1.0)
    assert sim.warnings == ()
    assert sim.error_estimate <= 1e-9


@pytest.mark.parametrize(
    ("to", "tol", "runs", "reason"),
    [(10.0, 1e-13, 5, "rounding and the growth of small errors"), (10.0, 1e-6, 2, "stopped after 2 runs")],
)
def test_why_a_tolerance_is_not_met_is_said(to, tol, runs, reason, monkeypatch):
    monkeypatch.setattr("mbstab.analysis.simulate.tolerances.Tolerances.runs_most", runs)
    sim = PENDULUM.simulate(to, perturb={"rod.theta": math.radians(175)}, tol=tol)
    (text,) = sim.warnings
    assert reason in text


@pytest.mark.long
@pytest.mark.parametrize("periods", sample([100.0, 1000.0], 2))
def test_the_energy_of_a_pendulum_stays_over_a_thousand_periods(periods):
    sim = PENDULUM.simulate(periods * PERIOD, perturb=RELEASED, tol=1e-11, once=True, points=201)
    assert sim.conservative
    assert sim.energy_drift <= 1e-8
    assert sim.max_constraint_residual <= 1e-12
    angle, _ = exact_pendulum(sim.times)
    assert np.max(np.abs(sim.q[:, 2] - 1.5 * math.pi - angle)) <= 1e-7


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("model", "perturb"),
    [
        (mbstab.load("top.yaml"), {"top.theta": 0.3}),
        (mbstab.load("rolling_disk.yaml"), {"mode:1": 0.02}),
        (mbstab.loads(FREE_DISK), {"disk.phi": 0.05}),
    ],
    ids=["top", "rolling_disk", "free disk"],
)
def test_constraints_hold_for_a_minute_at_every_time_of_output(model, perturb):
    sim = model.simulate(60.0, perturb=perturb, tol=1e-8, once=True)
    assert len(sim.times) == 501
    assert np.max(sim.residuals) <= 1e-12
    assert sim.max_constraint_residual <= 1e-12
    assert sim.energy_drift <= 1e-5


ORDERS = {
    # The time of the end, and numbers of steps at which errors lie between the longest step that says something and
    # rounding.
    "pendulum": (
        RELEASED,
        {
            "DOP853": (0.73, (8, 12, 18)),
            "RK45": (0.73, (40, 56, 80)),
            "alpha": (0.73, (40, 80, 160)),
            "radau": (0.73, (20, 28, 40)),
        },
    ),
    "top": (
        {"top.theta": 0.3, "rate(top.phi)": 0.5},
        {
            "DOP853": (0.73, (8, 12, 18)),
            "RK45": (0.73, (28, 40, 56)),
            "alpha": (0.73, (40, 80, 160)),
            "radau": (0.73, (28, 40, 56)),
        },
    ),
    "rolling_disk": (
        {"disk.phi": 0.4, "rate(disk.theta)": 1.0},
        {
            "DOP853": (0.73, (15, 18, 21, 24)),
            "RK45": (0.6, (80, 112, 160)),
            "alpha": (0.6, (40, 80, 160)),
            "radau": (0.6, (20, 28, 40)),
        },
    ),
    "governor": (
        {"right_crank.psi": 0.2},
        {
            "DOP853": (1.0, (10, 14, 20)),
            "RK45": (0.3, (20, 28, 40)),
            "alpha": (0.3, (20, 40)),
            "radau": (0.3, (5, 10)),
        },
    ),
}


@pytest.fixture(scope="module")
def exact_end():
    @functools.cache
    def found(name, end):
        model = mbstab.load(f"{name}.yaml")
        return model.simulate(end, perturb=ORDERS[name][0], tol=1e-13, once=True, points=2)

    return found


@pytest.mark.long
@pytest.mark.parametrize(("name", "solver"), sample(product(ORDERS, ["DOP853", "RK45", "alpha", "radau"]), 7))
def test_the_observed_order_is_that_of_theory(name, solver, exact_end):
    perturb, (end, counts) = ORDERS[name][0], ORDERS[name][1][solver]
    model, exact = mbstab.load(f"{name}.yaml"), exact_end(name, end)
    options = {"method": solver} if solver in METHODS else {"solver": solver}
    order = (METHODS[solver][""] if solver in METHODS else METHODS["projection"][solver]).order
    errors = []
    for count in counts:
        sim = model.simulate(end, perturb=perturb, step=end / count * (1.0 + 1e-12), points=2, **options)
        assert sim.steps == count
        errors.append(
            max(
                np.max(np.abs(sim.positions[-1] - exact.positions[-1])) / np.max(exact.sizes),
                np.max(np.abs(sim.rotations[-1] - exact.rotations[-1])),
                np.max(np.abs(sim.spins[-1] - exact.spins[-1])) / np.max(np.abs(exact.spins)),
            )
        )
    observed = -np.polyfit(np.log(counts), np.log(errors), 1)[0]
    assert observed == pytest.approx(order, abs=0.15)


@pytest.mark.parametrize("options", [{}, {"method": "radau", "tol": 1e-6}], ids=["projection", "radau"])
@pytest.mark.parametrize("name", ["top", "rolling_disk", "governor", "shimmy", "bricard"])
def test_straight_line_functions_change_nothing_but_the_rounding(name, options, monkeypatch):
    model = mbstab.load(f"{name}.yaml")
    begin = start_of(model.system()).motion.time
    found = []
    for after in (0, 10**9):
        monkeypatch.setattr(form, "FUSED_AFTER", after)
        found.append(model.simulate(begin + 0.01, once=True, points=3, **{"tol": 1e-9, **options}))
    one, other = found
    assert one.steps == other.steps
    assert np.max(np.abs(one.q - other.q) / one.sizes) <= 1e-12
    assert np.max(np.abs(one.u - other.u) / one.sizes) <= 1e-11 * max(1.0, np.max(np.abs(one.u / one.sizes)))
    assert np.max(np.abs(one.loads - other.loads), initial=0.0) <= 1e-9 * np.max(np.abs(one.loads), initial=1.0)


# --- orientation ----------------------------------------------------------------------------------------------------


def exact_spin(inertia, start, times):
    """Return Euler's angular velocity in principal axes I1 < I2 < I3, for a motion with L² > 2 T I2."""
    I1, I2, I3 = inertia
    energy, L2 = (
        sum(i * w * w for i, w in zip(inertia, start, strict=True)),
        sum((i * w) ** 2 for i, w in zip(inertia, start, strict=True)),
    )
    assert energy * I2 < L2
    a1 = math.sqrt((energy * I3 - L2) / (I1 * (I3 - I1)))
    a2 = math.sqrt((energy * I3 - L2) / (I2 * (I3 - I2)))
    a3 = math.sqrt((L2 - energy * I1) / (I3 * (I3 - I1)))
    rate = math.sqrt((L2 - energy * I1) * (I3 - I2) / (I1 * I2 * I3))
    m = (I2 - I1) * (energy * I3 - L2) / ((I3 - I2) * (L2 - energy * I1))
    sn, cn, dn, _ = ellipj(rate * times, m)
    return np.stack([a1 * cn, a2 * sn, a3 * dn], axis=1)


@pytest.mark.parametrize("options", sample([{}, {"method": "radau", "tol": 1e-5}], 2), ids=["projection", "radau"])
def test_a_body_that_tumbles_through_all_attitudes_follows_eulers_solution(options):
    inertia = (1.0, 2.0, 3.0)
    start = (1.5, 0.0, 0.9)
    sim = mbstab.loads(BODY).simulate(
        30.0,
        perturb={"rate(body.phi)": start[0], "rate(body.psi)": start[2]},
        points=1001,
        **{"tol": 1e-9, **options},
    )
    tol = options.get("tol", 1e-9)
    A, fast = sim.rotations[:, 0], 2.0
    local = np.einsum("tji,tj->ti", A, sim.spins[:, 0])
    assert np.max(np.abs(local - exact_spin(inertia, start, sim.times))) <= SIMULATE.error_factor * tol * fast
    momentum = np.einsum("tij,tj->ti", A, local * inertia)
    assert np.max(np.abs(momentum - momentum[0])) <= 10.0 * tol * fast
    assert np.max(np.abs(A @ np.swapaxes(A, 1, 2) - np.eye(3))) <= 1e-13
    # It passed the singular attitude of the file's own angles, which go on continuously or by half turns.
    assert np.max(np.abs(A[:, 0, 2])) > 0.99
    assert sim.charts >= 2
    body = mbstab.loads(BODY).system().scene.bodies[0]
    for k in range(0, len(sim.times), 50):
        angles, rates, growth = (x[k, 3:] for x in (sim.q, sim.u, sim.a))
        again = euler_angles(body, A[k], angles)
        assert np.max(np.abs(again - angles)) <= 1e-9
        assert np.max(np.abs(rate_matrix(body, angles) @ rates - sim.spins[k, 0])) <= 1e-9
        # Euler's equations from the accelerations of the angles.
        turning = A[k].T @ (rate_matrix(body, angles) @ growth + rate_drift(body, angles, rates))
        assert np.max(np.abs(inertia * turning + np.cross(local[k], inertia * local[k]))) <= 1e-8


@pytest.mark.long
def test_joints_and_springs_mean_the_same_in_every_chart():
    arm = """\
mbstab: 1
gravity: [0, 0, -9.81]
bodies:
  arm: {type: spatial, mass: 1, inertia: [0.01, 0.02, 0.025], points: {O: [-0.3, 0, 0], end: [0.2, 0.1, 0]}, axes: AXES}
joints: {pivot: {type: spherical, between: [arm.O, ground]}}
forces: {s: {type: spring, between: [arm.end, {body: ground, point: [0, 0.2, -0.3]}], stiffness: 8, length: 0.2}}
initial:
  coordinates: {arm: {x: X, y: 0, z: Z, phi: PHI, theta: THETA, psi: 0}}
reference: {coordinates: {arm: {x: X, y: 0, z: Z, phi: PHI, theta: THETA, psi: 0}}}
"""
    along = {"AXES": "[0, 0, 0]", "X": "0.3", "Z": "0", "PHI": "0", "THETA": "0"}
    # The same start: another base rotation, undone by the first angle.
    turned = {**along, "AXES": "[0.7, 0, 0]", "PHI": "-0.7"}
    found = []
    for values in (along, turned):
        text = re.sub(r"\b(AXES|X|Z|PHI|THETA)\b", lambda match, values=values: values[match[0]], arm)
        found.append(mbstab.loads(text).simulate(3.0, tol=1e-9, points=61))
    one, other = found
    assert one.charts > 0
    assert np.max(np.abs(one.rotations - other.rotations)) <= 1e-7
    assert np.max(np.abs(one.loads - other.loads)) <= 1e-6 * np.max(np.abs(one.loads))
    assert one.energy_drift <= 1e-8


def test_a_chart_that_is_named_by_a_drive_is_not_changed_silently():
    text = BODY + "drives: {d: {type: coordinate, coordinate: body.psi, position: 0.1*t}}\n"
    with pytest.raises(SimulationError, match=r"theta of 'body' comes to ±pi/2.*drive 'd' names one of them") as caught:
        mbstab.loads(text).simulate(10.0, perturb={"rate(body.theta)": 1.0})
    partial = caught.value.partial
    assert 1.0 < partial.times[-1] < 1.7
    assert not partial.complete
    assert "the part until t = " in str(caught.value)


# --- initial conditions ---------------------------------------------------------------------------------------------


def test_the_initial_block_starts_the_motion_and_missing_values_are_solved():
    own = mbstab.loads(
        SOURCE + "initial:\n  time: 2\n  coordinates: {rod: {theta: -pi/4}}\n  rates: {rod: {theta: 1}}\n"
    )
    sim = own.simulate(3.0, points=2, tol=1e-6)
    assert sim.times.tolist() == [2.0, 3.0]
    assert sim.q[0] == pytest.approx([0.2 * math.cos(math.pi / 4), -0.2 * math.sin(math.pi / 4), -math.pi / 4])
    assert sim.u[0] == pytest.approx([0.2 * math.sin(math.pi / 4), 0.2 * math.cos(math.pi / 4), 1.0])
    assert sim.warnings == ()
    assert own.simulate(3.0, start=2.5, points=2, tol=1e-6).times[0] == 2.5


def test_the_initial_block_is_read_like_the_reference():
    text = BODY + "initial: {coordinates: {body: {thta: 1}}, speeds: {}, rates: {bodi: {}}}\n"
    with pytest.raises(ModelFileError) as caught:
        mbstab.loads(text)
    said = str(caught.value)
    assert "initial.coordinates.body: unknown key 'thta'" in said
    assert "did you mean 'theta'?" in said
    assert "initial: unknown key 'speeds'" in said
    assert "did you mean 'body'?" in said
    shown = CliRunner().invoke(main, ["schema", "initial"])
    assert shown.exit_code == 0
    assert "rates" in shown.stdout


@pytest.mark.few(3)
@pytest.mark.parametrize("name", sample(sorted(path.stem for path in installed_models()), 2))
def test_every_example_moves_from_its_reference(name):
    model = mbstab.load(f"{name}.yaml")
    begin = start_of(model.system()).motion.time
    sim = model.simulate(begin + 0.1, points=3, tol=1e-6)
    assert sim.max_constraint_residual <= 1e-12
    assert sim.error_estimate <= 1e-6
    assert sim.energy_drift <= 1e-4


def test_inconsistent_values_are_moved_by_the_least_change_or_refused():
    perturb = {"rod.theta": 0.3, "rod.x": 0.1, "rod.y": 0.0}
    sim = PENDULUM.simulate(0.1, perturb=perturb, points=2, tol=1e-4)
    (text,) = sim.warnings
    assert "moved onto them: rod.theta by 0.1" in text
    # The least change in the metric of the masses: x and y count with m, the angle with I.
    angles = np.linspace(0.2, 0.5, 300_001)
    goal = np.array([0.1, -0.2, 0.3])
    cost = (0.2 * np.sin(angles) - goal[0]) ** 2 + (-0.2 * np.cos(angles) - goal[1]) ** 2
    cost += 0.04 / 3.0 * (angles - goal[2]) ** 2
    assert sim.q[0, 2] - 1.5 * math.pi == pytest.approx(angles[np.argmin(cost)], abs=2e-2)
    with pytest.raises(ModelFileError, match="do not satisfy the constraints"):
        PENDULUM.simulate(0.1, perturb=perturb, strict=True)


def test_rates_that_the_constraints_forbid_are_moved_too():
    sim = PENDULUM.simulate(0.1, perturb={"rate(rod.theta)": 1.0, "rate(rod.x)": 1.0}, points=2, tol=1e-4)
    assert "rate(rod." in sim.warnings[0]
    # min m (0.2 w − 1)² + I (w − 1)²
    assert sim.u[0, 2] == pytest.approx((0.2 + 0.04 / 3.0) / (0.04 + 0.04 / 3.0), rel=1e-9)


def started(initial):
    """Return where the pendulum starts; the block is line 38."""
    return start_of(mbstab.loads(f"{SOURCE}initial: {initial}\n").system())


@pytest.mark.parametrize(
    ("initial", "place", "message"),
    [
        (
            "{coordinates: {rod: {x: 0.5}}}",
            "38:34: initial.coordinates.rod.x",
            "was found with rod.x = 0.5 m; one near",
        ),
        ("{rates: {rod: {y: 1}}}", "38:28: initial.rates.rod.y", "allow no rate(rod.y) = 1 m/s here, but 0 m/s"),
        # Each of these is possible, but both together are nowhere near.
        (
            "{coordinates: {rod: {x: 0.05, theta: 0}}}",
            "38:34: initial.coordinates.rod.x",
            "no state near the initial",
        ),
        pytest.param(
            "{coordinates: {rod: {x: 5, y: 7}}}",
            "38:40: initial.coordinates.rod.y",
            "found with rod.y = 7 m",
            marks=pytest.mark.long,
        ),
    ],
)
def test_values_that_no_state_has_are_errors_of_the_file(initial, place, message, tmp_path):
    with pytest.raises(ModelFileError) as caught:
        started(initial)
    assert place in str(caught.value)
    assert message in str(caught.value)
    assert f" 38 | initial: {initial}" in str(caught.value)
    path = tmp_path / "own.yaml"
    path.write_text(f"{SOURCE}initial: {initial}\n")
    result = run(str(path), "--to", "1")
    assert result.exit_code == 2
    assert f"{path}:{place}" in result.stderr


@pytest.mark.parametrize(
    ("name", "message"),
    [("rod.x", "was found with rod.x = 0.5 m"), ("rate(rod.y)", "allow no rate(rod.y) = 0.5 m/s here, but 0 m/s")],
)
def test_disturbances_that_lead_to_no_state_are_refused(name, message):
    with pytest.raises(UsageError, match=re.escape(f"--perturb {name}: ")) as caught:
        PENDULUM.simulate(1.0, perturb={name: 0.5})
    assert message in str(caught.value)


def test_a_value_that_a_drive_holds_is_an_error_of_the_file():
    text = BODY + "drives: {d: {type: coordinate, coordinate: body.x, position: 0.1*t}}\n"
    text += "initial:\n  time: 1\n  coordinates: {body: {x: 0.1}}\n"
    assert start_of(mbstab.loads(text).system()).motion.u[0] == pytest.approx(0.1)
    with pytest.raises(ModelFileError, match=r"found with body\.x = 0\.2 m; one near it has 0\.1 m, 0\.1 m away"):
        start_of(mbstab.loads(text.replace("{x: 0.1}", "{x: 0.2}")).system())


def test_a_value_on_the_other_side_of_a_symmetric_reference_is_found():
    # Upright: the way there may lead to the right or to the left.
    motion = started("{coordinates: {rod: {y: 0.2}}}").motion
    assert motion.q[:2] == pytest.approx([0.0, 0.2], abs=1e-7)
    assert math.sin(motion.q[2]) == pytest.approx(1.0)


def test_of_values_that_contradict_each_other_those_that_differ_from_the_reference_stay():
    text = Path(mbstab.load("rolling_disk.yaml").model.document.name).read_text(encoding="utf-8").partition("sweep:")[0]
    initial = "initial:\n  rates: {disk: {x: -R*omega, y: 0, z: 0, phi: 0.1, theta: 0, psi: omega}}\n"
    begin = start_of(mbstab.loads(text + initial).at(omega=-3.8).system())
    rate = dict(zip(begin.system.names, begin.motion.u, strict=True))
    # A disk that leans over at 0.1 rad/s moves its centre, 0.3 m above the ground, sideways.
    assert rate["disk.phi"] == pytest.approx(0.1, abs=1e-15)
    assert rate["disk.y"] == pytest.approx(-0.03, abs=1e-14)
    assert rate["disk.x"] == pytest.approx(0.3 * 3.8, abs=1e-14)
    (warning,) = begin.warnings
    assert warning.endswith("moved onto them: rate(disk.y) by -0.03 m/s")
    with pytest.raises(ModelFileError, match=r"rate\(disk.y\)"):
        start_of(mbstab.loads(text + initial).system(), strict=True)


def test_initial_values_are_enough_where_there_is_no_reference():
    text = """\
mbstab: 1
gravity: [0, -9.81]
bodies: {rod: {type: planar, mass: 1, inertia: 0.1, points: {O: [-1, 0]}}}
joints: {pivot: {type: revolute, between: [rod.O, ground]}}
forces: {push: {type: torque, body: rod, value: 100}}
reference: {find: equilibrium, guess: {rod: {x: 1, y: 0, theta: 0}}}
"""
    with pytest.raises(MbstabError, match="no equilibrium found"):
        start_of(mbstab.loads(text).system())
    begin = start_of(mbstab.loads(text + "initial: {coordinates: {rod: {theta: 0.5}}}\n").system())
    assert begin.motion.q == pytest.approx([math.cos(0.5), math.sin(0.5), 0.5], abs=1e-14)
    assert any("no equilibrium found" in x for x in begin.warnings)


def test_inconsistent_values_near_a_state_are_moved_and_said(tmp_path):
    begin = started("{coordinates: {rod: {x: 0.12, y: -0.17}}}")
    (text,) = begin.warnings
    moved = begin.motion.q[:2] - [0.12, -0.17]
    assert f"rod.x by {moved[0]:.6g} m" in text
    assert f"rod.y by {moved[1]:.6g} m" in text
    # The point of the circle that is nearest, as the angle was not given.
    assert moved == pytest.approx((0.2 / math.hypot(0.12, 0.17) - 1.0) * np.array([0.12, -0.17]), rel=0.3)


@pytest.mark.few(3)
@pytest.mark.parametrize(
    ("name", "number", "parameters"),
    [("top", 1, {"omega": 10}), ("rolling_disk", -1, {}), ("whipple_bicycle", 2, {"v": 5}), ("governor", 1, {})],
)
def test_a_mode_of_the_linearized_equations_is_where_a_small_motion_stays(name, number, parameters):
    model = mbstab.load(f"{name}.yaml")
    modes = [e for e in model.eig(**parameters).eigenvalues if e.kind != "neutral" and e.value.imag >= 0]
    # The pair of the disk comes after zeros that nothing explains, one or two of them as they are rounded.
    number = number if number > 0 else len(modes)
    mode = modes[number - 1]
    end = 1.0 / abs(mode.value)
    size = 1e-5
    plain, disturbed = (
        model.simulate(end, perturb=perturb, points=3, tol=1e-10, once=True, **parameters)
        for perturb in ({}, {f"mode:{number}": size})
    )
    shift = disturbed.q - plain.q
    system = model.system(**parameters)
    dq, _ = mode_shape(system, model.motion(**parameters), number)
    sizes = Finder(system).sizes
    assert np.max(np.abs(shift[0] / sizes)) == pytest.approx(np.max(np.abs(dq / sizes)) * size, rel=1e-3)
    # It decays and turns as the eigenvalue says: x(t) satisfies the equation of the pair, at three times.
    if name != "governor":  # there the frame turns
        s, h = mode.value, end / 2
        after = 2.0 * np.exp(s.real * h) * math.cos(s.imag * h) * shift[1] - np.exp(2.0 * s.real * h) * shift[0]
        if s.imag == 0.0:
            after = np.exp(s.real * h) * shift[1]
        lean = [i for i, x in enumerate(dq) if abs(x) > 0.1 * np.max(np.abs(dq))]
        assert shift[2][lean] == pytest.approx(after[lean], abs=2e-3 * size)


@pytest.mark.parametrize(
    ("perturb", "message"),
    [
        ({"rod.tetha": 0.1}, "there is no coordinate 'rod.tetha'\nhint: did you mean 'rod.theta'?"),
        ({"rate(rod.tetha)": 0.1}, "there is no coordinate 'rod.tetha'\nhint: did you mean 'rate(rod.theta)'?"),
        ({"mode:2": 0.1}, "no mode 2: there is 1 to choose from"),
        ({"rod.theta": "LL"}, "unknown parameter 'LL'\nhint: did you mean 'L'?"),
        ({"rod.theta": "nan"}, "'nan' is not a number"),
        ({"rod.theta": math.inf}, "not finite"),
    ],
)
def test_wrong_disturbances_are_named(perturb, message):
    with pytest.raises(UsageError, match=re.escape(message)):
        PENDULUM.simulate(1.0, perturb=perturb)


def test_a_reference_out_of_balance_is_a_start_like_any_other():
    text = """\
mbstab: 1
gravity: [0, -9.81]
bodies: {p: {type: planar_point, mass: 1}}
joints: {rope: {type: distance, between: [p, ground], length: 1}}
reference: {coordinates: {p: {x: 1, y: 0}}}
"""
    sim = mbstab.loads(text).simulate(0.5, tol=1e-8)
    assert sim.q[-1, 1] < -0.5
    assert sim.energy_drift < 1e-8


# --- published accelerations ----------------------------------------------------------------------------------------


def turn(axis, angle):
    c, s = math.cos(angle), math.sin(angle)
    j, k = (axis + 1) % 3, (axis + 2) % 3
    A = np.eye(3)
    A[j, j], A[j, k], A[k, j], A[k, k] = c, -s, s, c
    return A


def test_the_bicycle_accelerates_as_basu_mandal_chatterjee_and_papadopoulos_print():
    """Proc. R. Soc. A 463 (2007), Table 1, in their names; lean counts from the plane, their x looks backwards.

    The angles of the table turn the bicycle in axes forward, right, down: yaw about the last, lean about the
    first, pitch about the second, steering about the tilted last one, all against their signs.
    """
    lean, pitch, steer, tilt = math.pi / 2 - 0.9501292851472, 3.1257073014894, -0.2311385135743, math.pi / 10
    pitch = math.pi - pitch + tilt  # of the frame whose last axis is that of the steering
    rates = -np.array([0.7830033527065, 0.6068425835418, -0.0119185528069])
    steer_rate, rear_rate, front_rate = -0.4859824687093, -8.9129896614890, -8.0133620584155
    model = mbstab.load("whipple_bicycle.yaml")
    system = model.system()
    at = {body.name: (body, part) for body, part in zip(system.scene.bodies, system.body_slices, strict=True)}
    items = {item.name: item for item in system.scene.items}
    upward = np.diag([1.0, -1.0, -1.0])  # to forward, left, up
    leaned = turn(0, lean)
    frame = leaned @ turn(1, pitch)
    steered = frame @ turn(2, steer)
    axes = np.array([[0.0, 0.0, 1.0], leaned[:, 0], leaned[:, 1]])
    spin = {"rear_body": rates @ axes}
    spin["front_body"] = spin["rear_body"] + steer_rate * frame[:, 2]
    spin["rear_wheel"] = spin["rear_body"] + rear_rate * frame[:, 1]
    spin["front_wheel"] = spin["front_body"] + front_rate * steered[:, 1]
    rear, front = (upward @ x @ turn(1, -tilt) @ upward for x in (frame, steered))
    turned = {"rear_body": rear, "front_body": front, "rear_wheel": rear, "front_wheel": front}
    hub, head = (np.array(items[name].markers("between")[0].point) for name in ("rear_axle", "steering"))
    own, fork = (np.array(items[n].markers("between")[i].point) for n, i in (("steering", 1), ("front_axle", 0)))
    place = {"rear_wheel": np.array([0.0, 0.0, 0.3 * math.cos(lean)])}
    assert place["rear_wheel"][2] == pytest.approx(0.2440472102925, abs=1e-12)
    place["rear_body"] = place["rear_wheel"] - rear @ hub
    place["front_body"] = place["rear_body"] + rear @ head - front @ own
    place["front_wheel"] = place["front_body"] + front @ fork
    q, u = np.zeros(system.n_q), np.zeros(system.n_q)
    for name, (body, part) in at.items():
        angles = slice(part.start + 3, part.stop)
        # The bodies of wheels have their axle along z: the base rotation of the file undone.
        base = np.array(body.base).reshape(3, 3)
        q[part.start : part.start + 3] = place[name]
        q[angles] = euler_angles(body, turned[name] @ base, np.zeros(3))
        u[angles] = np.linalg.solve(rate_matrix(body, q[angles]), upward @ spin[name])
    given = {name: u[i] for i, name in enumerate(system.names) if name[-2:] not in (".x", ".y", ".z")}
    perturb = {name: q[i] for i, name in enumerate(system.names)} | {f"rate({x})": v for x, v in given.items()}
    reference = model.motion()
    number = {name: i for i, name in enumerate(system.names)}
    perturb = {
        key: value
        - (reference.u if key.startswith("rate") else reference.q)[number[key.removeprefix("rate(").rstrip(")")]]
        for key, value in perturb.items()
    }
    begin = start_of(system, perturb)
    motion, part = begin.motion, at["rear_wheel"][1]
    assert np.max(np.abs(motion.q - q)) < 1e-12
    accuracy = 3e-11  # the state is printed to 13 decimals; the light front body makes hundreds of them
    assert motion.u[part][:3] == pytest.approx([2.8069345714545, 0.1480982396001, 0.1058778746261], abs=1e-12)
    assert motion.a[part][:3] == pytest.approx([0.5041626315047, 0.3449706619454, -1.4604528332980], abs=accuracy)
    growth = {}
    for name, (body, own_part) in at.items():
        angles = slice(own_part.start + 3, own_part.stop)
        x, v, w = motion.q[angles], motion.u[angles], motion.a[angles]
        growth[name] = upward @ (rate_matrix(body, x) @ w + rate_drift(body, x, v))
    # d/dt of ω = yaw' z + lean' x' + pitch' y'' without the second derivatives.
    yawing = rates[0] * axes[0]
    leaning = yawing + rates[1] * axes[1]
    drift = rates[1] * np.cross(yawing, axes[1]) + rates[2] * np.cross(leaning, axes[2])
    angular = np.linalg.solve(axes.T, growth["rear_body"] - drift)
    assert -angular == pytest.approx([0.8353281706379, -7.8555281128244, 0.1205543897884], abs=accuracy)
    for one, other, axis, expected in (
        ("front_body", "rear_body", frame[:, 2], -4.6198904039403),
        ("rear_wheel", "rear_body", frame[:, 1], 1.8472554144217),
        ("front_wheel", "front_body", steered[:, 1], 2.4548072904550),
    ):
        assert -(growth[one] - growth[other]) @ axis == pytest.approx(expected, abs=accuracy)


# --- where it cannot go on ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("options", [{}, {"method": "radau", "tol": 1e-6}], ids=["projection", "radau"])
def test_a_singular_configuration_on_the_way_is_found_between_the_steps(options):
    with pytest.raises(SimulationError) as caught:
        mbstab.load("four_bar.yaml").simulate(2.0, perturb={"rate(left.theta)": 9.0}, **options)
    text = str(caught.value)
    assert re.search(r"singular configuration at t = 0\.1852832\d+ s: the least singular value .* where 1e-05 is", text)
    assert all(f"joint '{name}'" in text for name in "ABCD")
    partial = caught.value.partial
    assert partial.times[-1] < 0.1853
    assert partial.max_constraint_residual < 1e-12
    # There the links lie on a line.
    assert abs(math.cos(2.0 * partial.q[-1, 2])) <= 1.0


def test_redundant_constraints_are_followed_with_the_least_reactions():
    sim = mbstab.load("bricard.yaml").simulate(0.3, points=4, tol=1e-7)
    assert sim.max_constraint_residual < 1e-12
    assert sim.energy_drift < 1e-7
    # Many states at once have the multipliers of least norm of each.
    many = mbstab.load("bricard.yaml").simulate(0.3, points=31, tol=1e-7)
    assert np.allclose(many.nu[::10], sim.nu, rtol=0.0, atol=1e-6 * np.max(np.abs(sim.nu)))
    assert many.max_constraint_residual < 1e-12


@pytest.mark.parametrize(
    "options", sample([{}, {"solver": "RK45"}, {"method": "radau"}, {"method": "alpha", "tol": 1e-3}], 3), ids=str
)
def test_a_drive_that_starts_late_is_not_passed_over(options):
    text = """\
mbstab: 1
bodies: {p: {type: planar_point, mass: 1}}
forces: {f: {type: force, at: p, vector: [smooth_start((t - 5)/0.2) - smooth_start((t - 5.2)/0.2), 0]}}
"""
    sim = mbstab.loads(text).simulate(10.0, points=101, **{"tol": 1e-6, **options})
    # The force rises and falls: half of its 0.4 s.
    assert sim.u[-1, 0] == pytest.approx(0.2, abs=3e-3)
    assert sim.energy_drift < 10.0 * options.get("tol", 1e-4)


@pytest.mark.parametrize(
    ("text", "limits"),
    [
        ("omega*t", False),
        ("-(2*t + 1)/T - t*sin(a)", False),
        ("3", False),
        ("T/t", True),
        ("t*t", True),
        ("t**2", True),
        ("2**t", True),
        ("sin(t)", True),
        ("omega*smooth_start(t/T)", True),
        ("-k*p.x*sin(p.x)*rate(p.x)**2 + exp(c)/m", False),
        ("exp(-(p.x/w)**2)", True),
        ("max(rate(p.x), 0, w)", True),
        ("c/(1 + p.x**2)", True),
    ],
)
def test_only_functions_that_may_rest_limit_the_steps(text, limits):
    assert uneven(parse(text), ["p.x"]) is limits


BUMP = """
mbstab: 1
tables: {road: {x: [-500, 99.8, 100, 100.2, 500], y: [0, 0, 0.05, 0, 0]}}
bodies: {p: {type: planar_point, mass: 300}}
constraints: {cruise: {nonholonomic: rate(p.x) - 20}}
forces:
  f: {type: expression, on: {p.y: "-30000*(p.y - HEIGHT) - 1000*rate(p.y)"}}
reference: {coordinates: {p: {x: 0, y: 0}}, rates: {p: {x: 20, y: 0}}}
"""


@pytest.mark.few(1)
@pytest.mark.parametrize(
    "options", sample([{}, {"compiled": True}, {"method": "radau"}, {"solver": "Radau"}], 2), ids=str
)
def test_a_short_bump_far_down_an_even_road_is_met(options):
    sim = mbstab.loads(BUMP.replace("HEIGHT", "linear(p.x, road)")).simulate(8.0, tol=1e-6, **options)

    def rate(t, y):
        road = np.interp(20.0 * t, [99.8, 100.0, 100.2], [0.0, 0.05, 0.0])
        return [y[1], -(30000.0 * (y[0] - road) + 1000.0 * y[1]) / 300.0]

    exact = solve_ivp(rate, (0.0, 8.0), [0.0, 0.0], t_eval=sim.times, max_step=1e-3, rtol=1e-10, atol=1e-12).y[0]
    assert np.max(np.abs(exact)) > 3e-3
    assert np.max(np.abs(sim.q[:, 1] - exact)) < 1e-5


@pytest.mark.long
def test_a_bump_that_is_shorter_than_steps_is_told():
    text = BUMP.replace("HEIGHT", "linear(p.x, road)")
    narrow = text.replace("99.8,", "99.99,").replace("100.2,", "100.01,")
    (told,) = mbstab.loads(narrow).simulate(8.0, points=101, tol=1e-6).warnings
    assert re.match(r"forces\.f has a pulse of about 0\.000[456] s at t = 5 s, which steps of up to 0\.08 s may", told)
    assert mbstab.loads(narrow).simulate(8.0, points=101, step=2e-4).warnings == ()
    assert mbstab.loads(text).simulate(8.0, points=501, tol=1e-6).warnings == ()
    # Without a bump the same function may vary as it likes.
    wave = text.replace("linear(p.x, road)", "0.01*tanh(5*sin(p.x))")
    assert mbstab.loads(wave).simulate(8.0, points=101, tol=1e-4).warnings == ()


@pytest.mark.parametrize("options", sample([{"method": "radau"}, {"solver": "Radau"}, {"solver": "BDF"}], 3), ids=str)
def test_stiff_motions_take_steps_of_the_slow_part(options):
    text = """\
mbstab: 1
bodies: {rod: {type: planar, mass: 1, inertia: 0.03, points: {O: [-0.3, 0]}}}
joints: {pivot: {type: revolute, between: [rod.O, ground]}}
forces: {drag: {type: expression, on: {rod.theta: -1e5*(rate(rod.theta) + rod.theta - sin(t))}}}
reference: {coordinates: {rod: {theta: 0}}, guess: {rod: {x: 0.3}}}
"""
    sim = mbstab.loads(text).simulate(2.0, tol=1e-5, points=11, **options)
    # θ' + θ = sin t but for an inertia of 1e-6; the fast rate is 8e5 1/s, beyond explicit methods.
    slow = 0.5 * (np.exp(-sim.times) + np.sin(sim.times) - np.cos(sim.times))
    assert np.max(np.abs(sim.q[:, 2] - slow)) < SIMULATE.error_factor * 1e-5
    assert sim.steps < 1000
    assert sim.max_constraint_residual < 1e-12


def test_a_force_that_ends_ends_the_simulation_with_a_reason():
    text = """mbstab: 1
bodies: {p: {type: planar_point, mass: 1}}
forces: {f: {type: force, at: p, vector: [sqrt(1 - t), 0]}}
"""
    with pytest.raises(SimulationError, match=r"the step size has collapsed at t = ") as caught:
        mbstab.loads(text).simulate(2.0, points=201)
    assert caught.value.partial.times[-1] == pytest.approx(1.0, abs=0.02)


def test_a_force_that_loses_its_value_is_named():
    text = """mbstab: 1
bodies: {p: {type: planar_point, mass: 1}}
forces: {f: {type: expression, on: {p.x: sqrt(1 - p.x)}}}
"""
    with pytest.raises(
        SimulationError, match=r"forces\.f has no finite equations here \(a function has no real value there\)"
    ):
        mbstab.loads(text).simulate(3.0)


@pytest.mark.parametrize("options", [{"solver": "Radau"}, {"solver": "BDF"}, {"method": "radau"}, {"method": "alpha"}])
def test_a_drag_that_has_a_kink_at_rest_starts_from_rest(options):
    text = """mbstab: 1
bodies: {p: {type: planar_point, mass: 1}}
forces: {f: {type: expression, on: {p.x: 1 - rate(p.x)*abs(rate(p.x))}}}
"""
    sim = mbstab.loads(text).simulate(1.0, tol=1e-4, points=11, **options)
    assert np.max(np.abs(sim.u[:, 0] - np.tanh(sim.times))) < SIMULATE.error_factor * 1e-4
    with pytest.raises(MbstabError, match="at rest but not in equilibrium"):
        mbstab.loads(text + "reference: {coordinates: {p: {x: 0, y: 0}}}\n").eig()


PULSE = """mbstab: 1
bodies: {p: {type: planar_point, mass: 1}}
forces: {f: {type: force, at: p, vector: [exp(-((t - 3.137)/WIDTH)**2)/WIDTH, 0]}}
"""


@pytest.mark.parametrize("points", sample([5, 501], 2))
def test_a_pulse_that_steps_may_pass_over_is_said(points):
    said = mbstab.loads(PULSE.replace("WIDTH", "1e-4")).simulate(4.0, points=points).warnings[0]
    assert re.match(r"forces\.f has a pulse of about 0\.000[12] s at t = 3\.13[67]\d* s, which steps of up to", said)
    sim = mbstab.loads(PULSE.replace("WIDTH", "0.3")).simulate(4.0, points=points)
    assert sim.warnings == ()
    assert sim.u[-1, 0] == pytest.approx(math.sqrt(math.pi), rel=1e-4)  # the last part lies behind 4 s


def test_a_pulse_that_no_step_passes_over_is_not_said():
    model = mbstab.loads(PULSE.replace("3.137", "0.037").replace("WIDTH", "1e-4"))
    assert len(model.simulate(0.05, step=1e-2, points=5, once=True).warnings) == 1
    assert model.simulate(0.05, step=1e-4, points=5, once=True).warnings == ()


@pytest.mark.parametrize("law", ["sin(1e4*t)", "smooth_start((t - 1)/1e-3)", "abs(sin(3*t + 1))", "cos(t)**2*t"])
def test_other_functions_of_time_have_no_pulses(law):
    text = f"""mbstab: 1
bodies: {{p: {{type: planar_point, mass: 1}}}}
forces: {{f: {{type: force, at: p, vector: ["{law}", 0]}}}}
"""
    system = mbstab.loads(text).system()
    for longest in (0.04, 0.004):
        assert pulses(system, 0.0, 4.0, longest) == []


@pytest.mark.long
def test_what_limits_the_steps_is_told_before_the_end():
    text = """mbstab: 1
bodies: {p: {type: planar_point, mass: 1}}
forces: {f: {type: expression, on: {p.x: -2e4*(rate(p.x) - cos(t))}}}
"""
    told, done = [], []
    sim = mbstab.loads(text).simulate(
        3.0, tol=1e-5, once=True, tell=lambda text: told.append((text, len(done))), progress=done.append
    )
    ((said, when),) = [(text, when) for text, when in told if text in sim.warnings]
    assert "limited by stability" in said
    assert when < 0.5 * len(done)


def test_memory_is_refused_before_it_is_taken_unless_forced(monkeypatch):
    monkeypatch.setattr("mbstab.analysis.algebra.tolerances.Tolerances.estimated_memory", 1e5)
    with pytest.raises(UsageError, match=r"1001 output times take about .* numbers each\), where 0.0001 GB") as caught:
        PENDULUM.simulate(0.1, points=1001)
    fitting = int(re.search(r"(\d+) --points fit, or allow it with --force", str(caught.value))[1])
    assert len(PENDULUM.simulate(0.1, points=fitting).times) == fitting
    with pytest.raises(UsageError):
        PENDULUM.simulate(0.1, points=fitting + 1)
    assert len(replace(PENDULUM, force=True).simulate(0.1, points=1001).times) == 1001


def test_a_result_is_shown_in_a_line():
    sim = PENDULUM.simulate(1.0, points=3)
    assert re.fullmatch(
        r"<Simulation of 3 coordinates at 3 times from 0 to 1 s by projection DOP853, error estimate \S+>", repr(sim)
    )


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"to": 0.0}, "the end of the simulation, 0 s, must be later than its start, 0 s"),
        ({"to": 1.0, "start": 1.0}, "must be later than its start, 1 s"),
        ({"to": math.nan}, "must be later"),
        ({"to": math.inf}, "and finite"),
        ({"to": 1e300}, "times up to 1e+300 s are known to 1.5e+284 s only"),
        ({"to": 1e16, "start": 0.99e16}, "known to 2.0e+00 s only in double precision"),
        ({"to": 1.0, "points": 10_000_000}, "10000000 output times take about"),
        ({"to": "soon"}, "the last time is a number of seconds, not 'soon'"),
        ({"to": 1.0, "start": "now"}, "the first time is a number of seconds, not 'now'"),
        ({"to": 1.0, "points": 2.5}, "a whole number, not 2.5"),
        ({"to": 1.0, "step": 1e-12}, "steps of 1e-12 s make 1.0e+12 of them until 1 s, where 1e+09 is the limit"),
        ({"to": 1.0, "step": 0.0}, "the step must be a positive number of seconds, not 0"),
        ({"to": 1.0, "step": -1.0}, "the step must be a positive number"),
        ({"to": 1.0, "step": 2.0}, "the step of 2 s is longer than the simulation of 1 s"),
        ({"to": 1.0, "tol": 0.0}, "the tolerance must lie between 0 and 1, not at 0"),
        ({"to": 1.0, "points": 1}, "at least two output times"),
        ({"to": 1.0, "method": "euler"}, "there is no method 'euler'"),
        ({"to": 1.0, "method": "radau", "solver": "BDF"}, "the method radau has no solver 'BDF'"),
        ({"to": 1.0, "solver": "BDF", "step": 0.1}, "the solver BDF chooses its own steps"),
    ],
    ids=str,
)
def test_wrong_arguments_are_refused(options, message):
    with pytest.raises(UsageError, match=re.escape(message)):
        PENDULUM.simulate(**options)


# --- energy and work ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("model", "perturb"),
    [
        ("kapitza.yaml", {"rod.theta": 0.2}),
        ("top.yaml", {"top.theta": 0.4}),
        ("governor.yaml", {"right_crank.psi": 0.2}),
        ("shimmy.yaml", {"rate(wheel.psi)": 0.3}),
    ],
)
def test_kinetic_and_potential_energy_change_by_the_work_of_all_else(model, perturb):
    mechanism = mbstab.load(model)
    names = mechanism.model.coordinates()
    known = {key: value for key, value in perturb.items() if key.removeprefix("rate(").rstrip(")") in names}
    sim = mechanism.simulate(0.5, perturb=known or {f"rate({names[-1]})": 0.1}, tol=1e-11, points=21, once=True)
    assert sim.energy_drift < 1e-8
    assert np.any(sim.work != 0.0) or sim.conservative


# --- the command ----------------------------------------------------------------------------------------------------


def run(*arguments):
    return CliRunner().invoke(main, ["simulate", *arguments])


def test_the_json_answer_has_the_keys_scripts_rely_on():
    result = run("pendulum.yaml", "--to", "1", "--perturb", "rod.theta=pi/4", "--format", "json")
    assert result.exit_code == 0
    data = json.loads(result.stdout)
    assert set(data) >= {"end_state", "max_constraint_residual", "energy_drift", "steps", "evaluations"}
    assert set(data) >= {"method", "tol", "warnings", "error_estimate", "complete"}
    angle, rate = exact_pendulum(np.array([1.0]))
    assert data["end_state"]["coordinates"]["rod.theta"] - 1.5 * math.pi == pytest.approx(angle[0], abs=3e-8)
    assert data["end_state"]["rates"]["rod.theta"] == pytest.approx(rate[0], abs=1e-6)


def test_csv_and_npz_hold_the_same_columns(tmp_path):
    table, archive = tmp_path / "a.csv", tmp_path / "a.npz"
    for path in (table, archive):
        result = run("pendulum.yaml", "--to", "1", "--points", "11", "--perturb", "rod.theta=0.1", "-o", str(path))
        assert result.exit_code == 0
        assert "constraints   largest residual" in result.stdout
    with table.open() as stream:
        head, *rows = csv.reader(stream)
    assert len(rows) == 11
    assert head[:4] == ["time (s)", "rod.x (m)", "rod.y (m)", "rod.theta (rad)"]
    assert "rate(rod.theta) (rad/s)" in head
    assert "force x of joint 'pivot' on rod (N)" in head
    assert "kinetic energy (J)" in head
    with np.load(archive) as stored:
        data = dict(stored)
    assert data["q"].tolist() == [[float(x) for x in row[1:4]] for row in rows]
    assert data["rotations"].shape == (11, 1, 2, 2)
    assert data["coordinates"].tolist() == ["rod.x", "rod.y", "rod.theta"]


OUTPUTS = """\
outputs:
  height: y(rod) + L
  speed: vy(rod)
  swing: angle(pivot)
  load: force(pivot.y)
  gone: 1/rod.x
"""


def test_outputs_of_the_file_stand_in_every_answer_about_a_motion(tmp_path):
    model = mbstab.loads(SOURCE + OUTPUTS)
    sim = model.simulate(1.0, perturb=RELEASED, points=101)
    found = dict(zip([name for name, _ in sim.output_names], sim.outputs.T, strict=True))
    assert sim.output_names == (("height", "m"), ("speed", "m/s"), ("swing", "rad"), ("load", "N"), ("gone", ""))
    angle, rate = exact_pendulum(sim.times)
    assert found["height"] == pytest.approx(0.2 * (1.0 - np.cos(angle)), abs=1e-8)
    assert found["speed"] == pytest.approx(0.2 * rate, abs=1e-7)
    assert found["swing"] == pytest.approx(1.5 * math.pi + angle, abs=1e-7)
    column = sim.load_names.index(("joint 'pivot'", "rod", "force y"))
    assert found["load"] == pytest.approx(sim.loads[:, column], abs=1e-12)
    assert sim.end_state["outputs"]["height"] == found["height"][-1]
    path = tmp_path / "outputs.yaml"
    path.write_text(SOURCE + OUTPUTS, encoding="utf-8")
    table = tmp_path / "a.csv"
    result = run(str(path), "--to", "0.1", "--points", "3", "--plot", "height", "-o", str(table))
    assert result.exit_code == 0
    # Nothing divides by the rod's x at rest.
    assert "outputs.gone has no value at t = 0 s" in result.stderr
    assert re.search(r"^output +unit +at first +at last +least +largest$", result.stdout, flags=re.M)
    assert "height (m)" in table.read_text(encoding="utf-8").partition("\n")[0]
    assert (tmp_path / "a-height.png").exists()
    rest = CliRunner().invoke(main, ["equilibrium", str(path), "--format", "json"])
    (solution,) = json.loads(rest.stdout)["equilibria"]
    assert solution["outputs"]["load"] == pytest.approx(9.81, abs=1e-12)
    assert solution["outputs"]["gone"] is None


def test_a_point_that_a_joint_holds_has_a_motion_at_every_time():
    pinned = SOURCE.replace(
        "joints:\n", "joints:\n  still: {type: revolute, between: [pin, {body: ground, point: [1, 0]}]}\n"
    )
    pinned = pinned.replace("bodies:\n", "bodies:\n  pin: {type: planar_point, mass: 1}\n")
    pinned = pinned.replace("  coordinates:\n", "  coordinates:\n    pin: {x: 1, y: 0}\n")
    model = mbstab.loads(pinned + "outputs: {still: angle(still)}\n")
    sim = model.simulate(0.1, points=11)
    assert sim.motions.shape == (11, 2)
    assert not sim.outputs.any()
    assert not model.state_space().C.any()


def test_the_reaction_of_a_hanging_rod_carries_its_weight():
    sim = PENDULUM.simulate(0.1, points=2, tol=1e-6)
    assert sim.load_names[1] == ("joint 'pivot'", "rod", "force y")
    assert sim.loads[0] == pytest.approx([0.0, 9.81, 0.0], abs=1e-12)


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (("pendulum.yaml", "--to", "0"), 2, "must be later than its start"),
        (("pendulum.yaml", "--step", "0"), 2, "the step must be a positive number"),
        (("pendulum.yaml", "--perturb", "rod.tetha=1"), 2, "did you mean 'rod.theta'?"),
        (("pendulum.yaml", "--perturb", "rod.theta"), 2, "--perturb rod.theta: write NAME=VALUE"),
        (("pendulum.yaml", "--format", "npz"), 2, "is binary: name a file with --output"),
        (("pendulum.yaml", "--perturb", "rod.theta=0.3", "--perturb", "rod.x=0.1", "--strict"), 2, "do not satisfy"),
        (("four_bar.yaml", "--to", "2", "--perturb", "rate(left.theta)=9"), 1, "singular configuration"),
    ],
    ids=str,
)
def test_exit_codes_and_messages(arguments, code, message):
    result = run(*arguments)
    assert result.exit_code == code
    assert message in result.stderr


@pytest.mark.parametrize(
    ("name", "message"), [("none/a.csv", "there is no directory"), ("a.xls", "the suffix .xls says no format")]
)
def test_what_cannot_be_written_is_found_before_the_simulation(tmp_path, name, message, monkeypatch):
    monkeypatch.setattr(mbstab.Mechanism, "simulate", None)
    result = run("pendulum.yaml", "--to", "1", "-o", str(tmp_path / name))
    assert result.exit_code == 2
    assert message in result.stderr


def test_rates_have_their_unit():
    lines = run("pendulum.yaml", "--to", "0.1").stdout.splitlines()
    assert next(x for x in lines if x.startswith("coordinate")).split()[:2] == ["coordinate", "unit"]
    assert lines[next(i for i, x in enumerate(lines) if x.startswith("coordinate")) - 1].split() == ["last", "rate"]
    assert next(x for x in lines if x.startswith("coordinate")).split()[-1] == "(unit/s)"
    assert next(x for x in lines if x.startswith("rod.theta")).split()[1] == "rad"


def test_the_energy_that_the_drift_is_a_part_of_is_named():
    sim = PENDULUM.simulate(1.0, perturb={"rod.theta": 1.0}, tol=1e-6)
    text = " ".join(run("pendulum.yaml", "--to", "1", "--perturb", "rod.theta=1", "--tol", "1e-6").stdout.split())
    assert f"of {sim.energy_scale:.4g} J, the largest kinetic energy or change of potential energy" in text
    assert sim.energy_scale == pytest.approx(0.2 * 9.81 * (1.0 - math.cos(1.0)), rel=1e-3)
    assert "change of potential energy or work" in " ".join(run("kapitza.yaml", "--to", "0.01").stdout.split())


def test_a_motion_that_stays_at_rest_says_so_and_shows_no_rounding(tmp_path):
    said = "the simulation starts in equilibrium, so nothing moves"
    path = tmp_path / "own.yaml"
    path.write_text(SOURCE.replace("{x: 0, y: -L, theta: 3*pi/2}", "{theta: -pi/2}"))
    assert start_of(mbstab.load(path).system()).motion.q[0] != 0.0
    shown = run(str(path), "--to", "0.5").stdout
    assert said in shown
    row = next(x for x in shown.splitlines() if x.startswith("rod.x")).split()
    assert row == ["rod.x", "m", "0", "0", "0", "0", "0"]
    # What it says to do does it.
    assert said not in run("pendulum.yaml", "--to", "0.5", "--perturb", "mode:1=0.1").stdout
    assert said not in run("rolling_disk.yaml", "--to", "0.1").stdout


def test_a_failure_leaves_the_finished_part_on_disk(tmp_path):
    path = tmp_path / "part.csv"
    result = run("four_bar.yaml", "--to", "2", "--perturb", "rate(left.theta)=9", "-o", str(path))
    assert result.exit_code == 1
    assert f"wrote {path}" in result.stderr
    assert "is kept" in result.stderr
    with path.open() as stream:
        rows = list(csv.reader(stream))
    assert len(rows) > 30
    assert float(rows[-1][0]) < 0.1853


def test_ctrl_c_leaves_the_finished_part_on_disk(tmp_path):
    path = tmp_path / "part.json"
    arguments = ("--perturb", "rod.theta=1", "--to", "1e5", "--points", "200001", "-o", path)
    pipes = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE}
    with child(command_line("simulate", "pendulum.yaml", *arguments), **pipes) as process:
        until(lambda: processor_time(process) > 2.0, process, 100.0)
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "stopped at t = " in said
    data = json.loads(path.read_text())
    assert not data["complete"]
    assert 0.0 < data["end"] < 1e5
    assert len(data["rows"]) > 2


def test_a_full_disk_is_said_and_the_summary_still_shown():
    result = run("pendulum.yaml", "--to", "0.2", "--points", "3", "--format", "csv", "-o", "/dev/full")
    assert result.exit_code == 1
    kept = re.search(r"/dev/full: cannot be written: No space left on device; .* is kept in (\S+)", result.stderr)[1]
    assert len(Path(kept).read_text(encoding="utf-8").splitlines()) > 3
    Path(kept).unlink()
    assert "energy" in result.stdout


def test_an_output_counts_the_turns_of_an_angle_as_the_forces_do():
    text = """\
mbstab: 1
gravity: [0, 0, -9.81]
bodies: {a: {type: spatial, mass: 1, inertia: [0.01, 0.02, 0.02], points: {A: [0, 0.3, 0]}}}
joints: {h: {type: revolute, between: [a.A, ground], axis: x}}
forces: {f: {type: expression, on: {angle(h): "8.0 - 1.5*angle(h)"}}}
outputs: {turn: angle(h), moment: "8.0 - 1.5*angle(h)"}
reference: {find: equilibrium, guess: {a: {phi: 3.0}}}
"""
    model = mbstab.loads(text)
    sim = model.simulate(0.02, points=3)
    # Weight and torque balance at 3.49 rad, beyond half a turn.
    turn, moment = sim.outputs[0]
    assert turn == pytest.approx(3.487637806, rel=1e-9)
    assert moment == pytest.approx(1.0 * 9.81 * 0.3 * -math.cos(turn), rel=1e-9)
