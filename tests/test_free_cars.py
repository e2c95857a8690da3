"""Random cars on tyres at extremes, against their linear equations in 40 digits, and proven.

Place, heading and speed are neutral.
"""

import random
import re

import mpmath
import numpy as np
import pytest

import mbstab
from mbstab.analysis.proof.characteristic import Proof


def a_car(seed):
    """Return the text of a car that rolls freely, and the matrix of its speeds across, its yaw rate and its slips."""
    rng = random.Random(seed)

    def size(low, high):
        return 10.0 ** rng.uniform(low, high)

    m, inertia, a, b, u = size(-3, 6), size(-3, 6), size(-2, 1), size(-2, 1), size(-1, 2)
    relaxed = rng.random() < 0.5
    n = 4 if relaxed else 2
    A, tyres = mpmath.zeros(n), []
    A[0, 1] = -mpmath.mpf(u)
    for i, (point, x) in enumerate((("f", mpmath.mpf(a)), ("r", -mpmath.mpf(b)))):
        C, K, t, sigma = size(0, 6), size(-3, 5), size(-4, -1), size(-2, 1)
        text = f"type: tyre, at: c.{point}, cornering_stiffness: {C!r}, trail: {t!r}, aligning_stiffness: {K!r}"
        if rng.random() < 0.5:
            peak, shape, curvature = size(0, 4), rng.uniform(0.5, 3.0), rng.uniform(-3.0, 1.0)
            text += f", aligning_peak: {peak!r}, aligning_shape_factor: {shape!r}"
            text += f", aligning_curvature_factor: {curvature!r}"
        tyres.append(f"{{{text}{f', relaxation_length: {sigma!r}' if relaxed else ''}}}")
        slip = [1 / mpmath.mpf(u), x / u]
        force, moment = -mpmath.mpf(C), -x * C + mpmath.mpf(t) * C + K
        if relaxed:
            A[0, 2 + i], A[1, 2 + i] = force / m, moment / inertia
            A[2 + i, 0], A[2 + i, 1] = (y * u / sigma for y in slip)
            A[2 + i, 2 + i] = -mpmath.mpf(u) / sigma
        else:
            for k in range(2):
                A[0, k] += force * slip[k] / m
                A[1, k] += moment * slip[k] / inertia
    body = f"{{type: planar, mass: {m!r}, inertia: {inertia!r}, points: {{f: [{a!r}, 0], r: [{-b!r}, 0]}}}}"
    return (
        f"mbstab: 1\nbodies: {{c: {body}}}\nforces:\n  f: {tyres[0]}\n  r: {tyres[1]}\n"
        f"reference: {{coordinates: {{c: {{x: 0, y: 0, theta: 0}}}}, rates: {{c: {{x: {u!r}}}}}}}\n"
    ), A


@pytest.mark.parametrize("seed", range(80))
def test_a_free_car_is_judged_as_its_linear_equations_are(seed):
    with mpmath.workdps(40):
        text, A = a_car(seed)
        expected = list(mpmath.eig(A, left=False, right=False))
        found = mbstab.loads(text).eig()
        growing = any(x.real > 0 for x in expected)
        assert found.verdict == ("unstable" if growing else "asymptotically stable up to symmetry")
        certificate = mbstab.loads(text).certify()
        assert (certificate.status, certificate.verdict) == ("proven", found.verdict)
        left = [x for x in found.eigenvalues if x.kind != "neutral"]
        assert len(left) == len(expected)
        for x in left:
            distance = min(abs(mpmath.mpc(x.value) - y) for y in expected)
            assert distance <= x.error_bound + 4e-16 * abs(x.value)


def test_a_car_that_a_force_brakes_is_not_proven_to_roll_at_any_speed():
    """However weak the force is, which vanishes at the speed of the reference."""
    text = re.sub(r"rates: {c: {x: [^}]*", "rates: {c: {x: 20", a_car(1)[0])
    for drag, finding in (
        ("", "structural"),
        ("  drag: {type: expression, on: {c.x: -1e-30*(rate(c.x) - 20)**3}}\n", "refuted"),
    ):
        proof = Proof(mbstab.loads(text.replace("reference:", f"{drag}reference:")).model, {})
        (along,) = (x for x in proof.identities.invariance.symmetries if x.name == "c.x")
        assert proof.identities.at_any_speed(along) == finding


STEERED = """
mbstab: 1
title: Car whose front wheel without mass the driver holds at a constant angle to it
parameters: {{v: 20, a: 1.2, b: 1.0, C: 80000, m: 1500}}
bodies:
  car: {{type: planar, mass: m, inertia: 2500, points: {{front: [a, 0], rear: [-b, 0]}}}}
  wheel: {{type: planar, mass: 0, inertia: 0}}
joints: {{king: {{type: revolute, between: [wheel, car.front]}}}}
constraints:
  cruise: {{nonholonomic: vx(car) - v}}
  driver: {{nonholonomic: rate(angle(king))}}
forces:
  front: {{type: tyre, at: wheel, cornering_stiffness: C}}
  rear: {{type: tyre, at: car.rear, cornering_stiffness: C}}
reference:
  coordinates: {{car: {{x: 0, y: 0, theta: 0}}, wheel: {{theta: 0}}}}
  rates: {{car: {{x: v, y: 0, theta: 0}}, wheel: {{theta: 0}}}}
""".format()


def test_the_zero_of_a_held_steering_angle_is_neutral_whatever_else_grows():
    """Each angle of the steering is a circle of its own, on both sides of the speed √(C (a + b)²/(m (a − b)))."""
    car = mbstab.loads(STEERED)
    critical = np.sqrt(80000 * 2.2**2 / (1500 * 0.2))
    for v, word in ((0.6 * critical, "asymptotically stable up to symmetry"), (1.6 * critical, "unstable")):
        found = car.eig(v=v)
        assert (found.verdict, found.counts.neutral) == (word, 4)
        assert all(e.kind != "undecided" for e in found.eigenvalues)
        assert (
            any("motions of the same kind" in name for name in found.neutral_directions)
            or len(found.neutral_directions) == 4
        )
    (change,) = car.sweep("v", np.linspace(5.0, 60.0, 12)).critical
    assert (change.kind, change.unstable) == ("divergence", (0, 1))
    assert change.value == pytest.approx(critical, rel=1e-11)
