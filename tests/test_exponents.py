"""Exponents made of parameters: where they are fractions, they count as such, not as rounded numbers."""

import math

import numpy as np
import pytest

import mbstab
from mbstab.compiler.system import System
from mbstab.errors import MbstabError
from mbstab.model.evaluator import Law
from mbstab.model.values import evaluate
from mbstab.report.eigenvalues import eigen_text

POINT = """
mbstab: 1
parameters: {{{parameters}}}
bodies: {{p: {{type: planar_point, mass: 1}}}}
constraints: {{rail: {{holonomic: p.y}}}}
forces: {{f: {{type: expression, on: {{p.x: "{force}"}}}}}}
"""

ONE = {
    "2*h": "h: 0.5",
    "h*(1/h)": "h: 3",
    "3*h": "h: 1/3",
    "10*h": "h: 0.1",
    "n": "h: 0.1, n: (h + 0.2)/0.3",
    "(h + k)/0.3": "h: 0.1, k: 0.2",
    "long/short": "long: {value: 30, unit: cm}, short: {value: 300, unit: mm}",
    "-h": "h: -1",
    "h**2*4": "h: 0.5",
    "2 - abs(h)": "h: -1",
}
"""Exponents that are exactly 1; some are another number in floats."""


def point(force, parameters="", **settings):
    return mbstab.loads(POINT.format(force=force, parameters=parameters)).eig(**settings)


def values(result):
    return np.sort_complex([e.value for e in result.eigenvalues])


@pytest.mark.parametrize(("exponent", "parameters"), ONE.items(), ids=list(ONE))
@pytest.mark.parametrize(
    "force", ["-p.x - 0.5*rate(p.x)**(N)", "-p.x**(N) - 0.5*rate(p.x)", "-p.x - 0.5*sin(rate(p.x)**(N))"]
)
def test_an_exponent_that_is_one_is_no_power(force, exponent, parameters):
    plain, found = point(force.replace("N", "1")), point(force.replace("N", exponent), parameters)
    assert np.abs(values(plain) - values(found)).max() < 1e-14
    assert max(e.error_bound for e in found.eigenvalues) < 1e-13
    assert (found.verdict, found.judged.reasons) == (plain.verdict, plain.judged.reasons)


@pytest.mark.parametrize("setting", ["1/3", "0.2/0.6", 0.25])
def test_a_setting_is_as_exact_as_it_is_written(setting):
    times = 4 if setting == 0.25 else 3
    found = point(f"-p.x - 0.5*rate(p.x)**({times}*h)", "h: 7", h=setting)
    assert np.abs(values(found) - (-0.25 + 1j * math.sqrt(1 - 1 / 16) * np.array([-1, 1]))).max() < 1e-14
    assert max(e.error_bound for e in found.eigenvalues) < 1e-13


@pytest.mark.parametrize("exponent", ["4*h", "h + 3/2", "k*10/3", "2*(k + 0.3)/0.9"])
def test_a_given_motion_starts_with_its_own_acceleration(exponent):
    mechanism = mbstab.loads(f"""
mbstab: 1
parameters: {{h: 0.5, k: 0.6}}
bodies: {{p: {{type: planar_point, mass: 1}}}}
drives:
  along: {{type: point, at: p, direction: x, position: "0.1*t**({exponent})"}}
  across: {{type: point, at: p, direction: y, position: 0}}
""")
    (law, _) = (law for _, law in System(evaluate(mechanism.model)).given_functions() if isinstance(law, Law))
    assert abs(law.at(0.0).second - 0.2) < 1e-15
    with pytest.raises(MbstabError, match=r"a drive accelerates p\.x with 0\.2 m/s"):
        mechanism.eig()


def test_a_sweep_over_an_exponent_agrees_with_single_points():
    mechanism = mbstab.loads(POINT.format(force="-p.x - 0.5*rate(p.x)**(2*h) - rate(p.x)**3", parameters="h: 0.5"))
    swept = mechanism.sweep("h", np.array([0.5, 1.0, 1.5, 2.0, 2.5]))
    for h, row in zip(swept.values, swept.branches, strict=True):
        assert np.abs(np.sort_complex(row) - values(mechanism.eig(h=float(h)))).max() < 1e-12


def test_an_eigenvalue_without_a_bound_is_not_printed():
    # Whether this exponent is 1 does not follow from arithmetic with fractions.
    found = point("-p.x - 0.5*rate(p.x)**n", "n: sin(1)**2 + cos(1)**2")
    assert all(math.isinf(e.error_bound) for e in found.eigenvalues)
    table = eigen_text(found, "")
    rows = [line.split() for line in table.split("Verdict:")[0].splitlines() if line.endswith("undecided")]
    # Two values or a pair: that, too, is up to rounding.
    assert [row[0] for row in rows] == ["unknown"] * len(rows)
    assert 1 <= len(rows) <= 2
    assert "2 eigenvalues may have any value" in " ".join(found.warnings)


def test_an_exponent_of_what_moves_stays_as_it_is():
    with pytest.raises(MbstabError, match="no finite equations"):
        point("-p.x - rate(p.x)**(p.x)")
