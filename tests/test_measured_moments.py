"""Measured moments of inertia that no body can have: taken as they are, with a warning that says whether it matters."""

import numpy as np
import pytest

import mbstab
from mbstab.errors import ModelFileError

CAR = """\
mbstab: 1
parameters: {u: 20}
bodies:
  car: {type: spatial, mass: 1700, inertia: [0, 0, 3500], measured: true, points: {f: [1.2, 0, 0], r: [-1.7, 0, 0]}}
joints: {road: {type: planar, between: [car, ground], axis: z}}
constraints: {speed: {nonholonomic: vx(car) - u}}
forces:
  f: {type: expression, on: {vy(car.f): -80000/u*vy(car.f)}}
  r: {type: expression, on: {vy(car.r): -80000/u*vy(car.r)}}
reference:
  coordinates: {car: {x: 0, y: 0, z: 0, phi: 0, theta: 0, psi: 0}}
  rates: {car: {x: u}}
"""
ARM = """\
mbstab: 1
gravity: [0, 0, -9.81]
bodies:
  arm: {type: spatial, mass: 101, inertia: [1.11, 100.11, 1.01], measured: true, points: {p: [0, 0, 0.5]}}
joints: {j: {type: JOINT, between: [arm.p, ground]}}
reference: {coordinates: {arm: {phi: 0, theta: 0, psi: 0}}}
"""


def told(model):
    (warning,) = model.eig().warnings
    return warning


def test_a_moment_about_one_axis_is_all_that_a_car_in_the_plane_has():
    model = mbstab.loads(CAR)
    assert "body 'car': the measured principal moments 0, 0, 3500 kg*m^2 are impossible" in told(model)
    assert "about one axis at most, and does not depend on the others" in told(model)
    m, J, a, b, c, u = 1700.0, 3500.0, 1.2, 1.7, 80000.0, 20.0
    A = -np.array(
        [[2 * c / (m * u), (a - b) * c / (m * u) + u], [(a - b) * c / (J * u), (a * a + b * b) * c / (J * u)]]
    )
    found = np.array(model.eig().values())
    for s in np.linalg.eigvals(A):
        assert np.min(np.abs(found - s)) < 1e-9 * abs(s)


def test_sweeps_warn_of_measured_moments_as_eig_does():
    model = mbstab.loads(CAR)
    assert told(model) in model.sweep("u", np.linspace(10.0, 30.0, 3)).warnings


def test_a_pendulum_in_space_depends_on_what_no_body_has():
    model = mbstab.loads(ARM.replace("JOINT", "spherical"))
    assert told(model).endswith("depends on them: what is found holds for these numbers, and for no body")
    squares = {101 * 9.81 * 0.5 / (moment + 101 * 0.25) for moment in (1.11, 100.11)}
    found = np.array(model.eig().values())
    for square in squares:
        assert np.min(np.abs(found**2 + square)) < 1e-9 * square


def test_a_hinge_needs_one_moment():
    text = ARM.replace("JOINT", "revolute").replace("ground]}", "ground], axis: y}")
    assert "about one axis at most" in told(mbstab.loads(text))


def test_a_universal_joint_needs_moments_in_a_plane():
    text = ARM.replace("JOINT", "universal").replace("ground]}", "ground], axis: [x, y]}")
    assert "depends on those in one plane only" in told(mbstab.loads(text))


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("measured: true", "measured: false", r"impossible inertia: .* 1\.01, 1\.11, 100\.11 (.|\n)*measured: true"),
        ("[1.11, 100.11, 1.01]", "[-1, 100, 1]", "inertia must be positive"),
        ("inertia: [1.11, 100.11, 1.01]", "shape: {type: sphere, radius: 1}", "'inertia'"),
    ],
)
def test_moments_are_refused_otherwise(old, new, said):
    with pytest.raises(ModelFileError, match=said):
        mbstab.loads(ARM.replace("JOINT", "spherical").replace(old, new)).eig()
