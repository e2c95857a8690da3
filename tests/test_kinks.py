"""Products that have a derivative at a kink of one of their factors, because the others vanish there."""

import numpy as np
import pytest

import mbstab
from mbstab.analysis.verdict.smoothness import kinks
from mbstab.compiler.system import System
from mbstab.errors import MbstabError
from mbstab.model.arithmetic import FLOAT
from mbstab.model.values import evaluate

POINT = """
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
    return mbstab.loads(POINT.format(force=written(force)))


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
