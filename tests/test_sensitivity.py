"""Derivatives of eigenvalues by parameters, against closed forms and against differences with many digits."""

import math

import numpy as np
import pytest
from mpmath import mp

from mbstab import load, loads
from mbstab.analysis.linear.sensitivity import sensitivities
from mbstab.errors import MbstabError, UsageError
from mbstab.model.arithmetic import mpmath_arithmetic
from mbstab.model.parameters import evaluate_parameters


def slopes(found, name, number=0):
    return found.derivatives[number].slopes[found.parameters.index(name)]


def differences(mechanism, name, digits=30):
    """Return the differences of eigenvalues with many digits over a tiny step of a parameter, and the eigenvalues."""
    with mp.workdps(2 * digits):
        value = evaluate_parameters(mechanism.model, {}, mpmath_arithmetic())[name]
        h = (abs(value) or 1) * mp.mpf(10) ** (-digits // 2)
        ends = []
        for sign in (1, -1):
            result = mechanism.eig_precise(digits, **{name: f"1*({mp.nstr(value + sign * h, 2 * digits)})"})
            ends.append([e.value for e in result.eigenvalues])

        def slope(s):
            after, before = (min(end, key=lambda x: abs(x - s)) for end in ends)
            return complex((after - before) / (2 * h))

        return slope


def assert_slopes(mechanism, names, tolerance=1e-10):
    found = sensitivities(mechanism.model)
    scales = np.where(found.values, np.abs(found.values), 1.0)
    compared = 0
    for name in names:
        k = found.parameters.index(name)
        assert name not in found.missing
        exact = differences(mechanism, name)
        for item in found.derivatives:
            if not item.missing:
                row = np.nanmax(np.abs(item.slopes) * scales) / scales[k]
                off = abs(item.slopes[k] - exact(item.eigenvalue.value))
                assert off <= tolerance * row
                assert off <= 10.0 * item.errors[k] + 1e-14 * row  # the estimate is no fiction
                compared += 1
    assert compared
    return found


def test_a_pendulum():
    found = sensitivities(load("pendulum.yaml").model)
    assert slopes(found, "L") == pytest.approx(-15.1631749643667965j, rel=1e-14)
    assert slopes(found, "g") == pytest.approx(0.309137104268436218j, rel=1e-14)
    assert abs(slopes(found, "m")) < 1e-14  # the inertia is written in terms of m
    # omega = sqrt(m g L/(I + m L**2)) with I = m L**2/3.
    assert slopes(found, "I_zz") == pytest.approx(-6.0652699857467186j / (2 * 4 / 3 * 0.2**2), rel=1e-14)


def test_the_whipple_bicycle():
    found = sensitivities(load("whipple_bicycle.yaml").at(v=5).model)
    weave, capsize, castering = (
        next(i for i, x in enumerate(found.derivatives) if abs(x.eigenvalue.value - s) < 0.01)
        for s in (-0.7753 + 4.4649j, -0.3229, -14.078)
    )
    assert slopes(found, "v", capsize) == pytest.approx(0.5592202429888759, rel=1e-12)
    assert slopes(found, "v", weave) == pytest.approx(-0.891101156940564913 + 1.47048886071312979j, rel=1e-12)
    assert slopes(found, "v", castering) == pytest.approx(-1.96740590634654969, rel=1e-12)


@pytest.mark.parametrize(
    ("model", "names"),
    [
        ("top.yaml", ["I_z", "omega"]),  # a drive
        ("rolling_disk.yaml", ["omega", "R"]),  # in a turning frame, nonholonomic, with neutral directions
        ("shimmy.yaml", ["a"]),
        ("wheelset.yaml", ["h"]),
        ("free_rigid_body.yaml", ["I2"]),
    ],
)
def test_models_against_differences_of_30_digits(model, names):
    assert_slopes(load(model), names)


HUNG = """
mbstab: 1
parameters: {m: 2.0, k: 300.0, l: 0.4, d: 0.05}
gravity: [0, -9.81]
bodies:
  beam: {type: planar, mass: m, inertia: 0.1*m*l**2, points: {A: [-l, 0], B: [l, d]}}
joints:
  left: {type: point_on_line, between: [ground, beam.A], axis: [0, 1]}
  right: {type: point_on_line, between: [ground, beam.A], axis: [0, 1]}
forces:
  spring: {type: expression, on: {beam.y: -k*beam.y, beam.theta: -k*(beam.theta - d)}}
reference: {find: equilibrium}
"""


def test_redundant_rows_and_a_reference_that_moves():
    mechanism = loads(HUNG)
    assert mechanism.eig().counts.rank_holonomic < 2
    assert_slopes(mechanism, ["m", "k", "l", "d"])


SPRING = """
mbstab: 1
parameters: {m: 1.0, k: 4.0, c: 0.0, x_0: 0.3}
bodies:
  a: {type: planar, mass: m, inertia: 1}
forces:
  spring: {type: expression, on: {a.x: -k*(a.x - x_0) - c*rate(a.x), a.y: -4*a.y, a.theta: -25*a.theta}}
reference:
  coordinates: {a: {x: 0.3, y: 0, theta: 0}}
"""


def test_equal_eigenvalues_have_no_derivative_and_say_so():
    found = sensitivities(loads(SPRING).model)
    double, single = sorted(found.derivatives, key=lambda x: not x.missing)[::2]
    assert "2 eigenvalues cannot be told apart" in double.missing
    assert np.isnan(double.slopes).all()
    assert single.eigenvalue.value == pytest.approx(5j)
    assert not single.missing


def test_a_given_position_that_does_not_follow_a_parameter():
    found = sensitivities(loads(SPRING).model)
    assert set(found.missing) == {"x_0"}
    assert "do not balance" in found.missing["x_0"]
    assert all(math.isnan(abs(x.slopes[found.parameters.index("x_0")])) for x in found.derivatives)


def test_no_parameters_is_an_error_in_words():
    with pytest.raises(UsageError, match="no parameters"):
        sensitivities(loads("mbstab: 1\nbodies:\n  a: {type: planar, mass: 1, inertia: 1}\n").model)


def test_a_periodic_motion_is_refused():
    with pytest.raises(MbstabError, match="without derivatives"):
        sensitivities(load("kapitza.yaml").model)
