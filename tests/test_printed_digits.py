"""Digits that are printed: none below an error bound, and pairs and zeros as the structure has them."""

import math
import re

import numpy as np
import pytest

import mbstab
from mbstab.analysis.verdict.wording import known, show
from mbstab.model.library import installed_models
from mbstab.report.eigenvalues import eigen_text

MODELS = {path.stem: path for path in installed_models()}


@pytest.mark.parametrize(
    ("x", "bound", "text"),
    [
        (41.42976418, 2e-6, "41.42976"),
        (41.42976418, 1e-14, "41.42976418"),
        (-34.6, 0.5, "-35"),
        (3e-9, 4e-9, "0"),
        (0.0, 1.0, "0"),
        (2.5, math.inf, "2.5"),
        (9.9996, 1e-3, "10"),
    ],
)
def test_no_digit_is_below_the_bound(x, bound, text):
    assert known(x, 10, bound) == text


def test_both_parts_have_the_same_last_place():
    assert show(1.548297243e-05 + 3.523878761j, 10, 3e-9) == "1.548e-05 ± 3.52387876i"


def test_a_flutter_pair_of_a_conservative_system_is_a_pair():
    result = mbstab.load(MODELS["top"]).eig(omega=5.5677284416)
    values = sorted((e.value for e in result.eigenvalues if not e.exact), key=lambda s: (s.real, s.imag))
    np.testing.assert_array_equal(np.sort_complex(values), np.sort_complex(-np.conj(values)))
    exact = mbstab.load(MODELS["top"]).eig_precise(16, omega=5.5677284416).values()
    assert max(s.real for s in values) == pytest.approx(float(max(s.real for s in exact)), abs=5e-9)
    assert re.search(r"^ 1\.548e-05 ± 3\.52387876i", eigen_text(result, None), re.M)


PLANES = """
mbstab: 1
parameters: {k: 4, c: 4}
bodies: {b: {type: point, mass: 1}}
forces:
  hold: {type: expression, on: {b.x: -k*b.x - c*rate(b.x), b.y: -k*b.y - c*rate(b.y), b.z: -9*b.z - rate(b.z)}}
reference: {coordinates: {b: {x: 0, y: 0, z: 0}}}
"""


def test_a_double_real_eigenvalue_has_no_frequency():
    result = mbstab.loads(PLANES).eig()
    double = [e for e in result.eigenvalues if abs(e.value + 2.0) < 0.1]
    assert len(double) == 4
    assert all(e.kind == "stable node" and e.frequency == 0.0 for e in double)
    assert all(abs(e.value + 2.0) <= e.error_bound for e in double)


BALLBOT = """
mbstab: 1
parameters: {R: 0.105, l: 0.69, k1: 838.4705858156624, k2: 276.15591511183897, k3: 10.000000000000124}
gravity: [0, 0, -9.81]
bodies:
  ball: {type: spatial, mass: 2.4, inertia: [0.0174, 0.0174, 0.0174]}
  body: {type: spatial, mass: 51, inertia: [12.6, 12.6, 0.66], points: {c: [0, 0, -l]}}
joints: {centre: {type: spherical, between: [body.c, ball]}}
contacts: {roll: {type: ellipsoid, center: ball, a: R, b: R, c: R}}
definitions:
  tx: k1*body.phi + k2*wx(body) - k3*ball.y/R - 17.228190823094643*rate(ball.y)/R
  ty: k1*body.theta + k2*wy(body) + k3*ball.x/R + 17.228190823094643*rate(ball.x)/R
forces: {motors: {type: expression, on: {wx(ball): tx, wx(body): -tx, wy(ball): ty, wy(body): -ty}}}
reference:
  coordinates:
    ball: {x: 0, y: 0, z: R, phi: 0, theta: 0, psi: 0}
    body: {x: 0, y: 0, z: R+l, phi: 0, theta: 0, psi: 0}
"""


def test_zeros_in_chains_leave_the_bounds_of_the_others():
    # Both planes are alike: each decaying eigenvalue is double; yaw of both bodies and place drift.
    R, h, ball, body, k = 0.105, 0.69, 2.4, 51.0, [838.4705858156624, 276.15591511183897, 10.000000000000124]
    M = np.array([[ball + body + 0.0174 / R**2, body * h], [body * h, 12.6 + body * h**2]])
    push = np.array([1.0 / R, -1.0])  # of a torque on the ball and against it on the body, on x and the lean
    K = np.diag([0.0, body * 9.81 * h]) + np.outer(push, [k[2] / R, k[0]])
    D = np.outer(push, [17.228190823094643 / R, k[1]])
    plane = np.linalg.eigvals(np.block([[np.zeros((2, 2)), np.eye(2)], [np.linalg.solve(M, K), np.linalg.solve(M, D)]]))
    values = sorted(e.value.real for e in mbstab.loads(BALLBOT).eig().eigenvalues if e.kind == "stable node")
    np.testing.assert_allclose(values, np.repeat(np.sort(plane.real), 2), rtol=1e-9)


@pytest.mark.parametrize(
    ("model", "given", "still"), [("rolling_disk", {"omega": 5.0}, ["m"]), ("governor_paper", {}, ["m_s", "H"])]
)
def test_derivatives_that_are_zero_are_zero_within_their_errors(model, given, still):
    found = mbstab.load(MODELS[model]).sensitivities(**given)
    for item in found.derivatives:
        for name in still if not item.missing else ():
            k = found.parameters.index(name)
            assert abs(item.slopes[k]) <= item.errors[k]
