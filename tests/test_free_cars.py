"""Random cars on tyres at extremes, against their linear equations in 40 digits, and proven.

Place, heading and speed are neutral.
"""

import random
import re

import mpmath
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
