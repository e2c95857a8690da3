"""Zeros that form a chain: motions that leave like a power of t where the equations are linear, nothing elsewhere."""

import numpy as np
import pytest
from sampling import sample

import mbstab

POINT = """
mbstab: 1
parameters: {e: 0}
bodies: {p: {type: planar_point, mass: 1}}
forces: {all: {type: expression, on: {p.x: "ALONG", p.y: "ACROSS"}}}
STATES
reference: {coordinates: {p: {x: 0, y: 0}}}
"""


def point(along, across, rates=()):
    states = ", ".join(f"{name}: {{rate: {rate}}}" for name, rate in rates)
    text = POINT.replace("ALONG", along).replace("ACROSS", across)
    return mbstab.loads(text.replace("STATES", f"states: {{{states}}}" if rates else ""))


LEAVING = [
    ("rate(p.y)", "0", []),  # the speed along x grows like t
    ("p.y", "0", []),
    ("0", "-p.y", [("z", "p.x")]),  # an integrator that is cut off: x is no symmetry, and grows like t
    ("0", "-p.y", [("z", "p.x"), ("w", "z")]),
    ("0", "-p.y - rate(p.y)", [("z", "-3*p.x + p.y - z"), ("w", "z")]),
    ("0*z - rate(p.x)", "0", [("z", "p.y")]),
    ("1e-9*rate(p.y)", "0", []),
]
STAYING = [
    ("0", "0", []),  # only what symmetries name grows
    ("rate(p.y)", "-rate(p.x)", []),  # circles
    ("0", "-p.y", [("z", "rate(p.x)")]),
    ("0", "-p.y", [("z", "p.x - z")]),  # all moves on together
]
NOT_LINEAR = [
    ("rate(p.y)", "-1e-30*rate(p.y)**3", []),
    ("-1e-30*p.x**3", "-p.y", [("z", "p.x")]),
    ("0", "-p.y", [("z", "p.x + 1e-30*p.x**2")]),
    ("p.y", "-1e-12*p.y*abs(p.y)", []),
    ("-p.x**3", "0", []),  # two zeros in a chain, and it stays
]


@pytest.mark.parametrize(("along", "across", "rates"), sample(LEAVING, 2))
def test_a_chain_of_zeros_leaves_where_the_equations_are_linear(along, across, rates):
    model = point(along, across, rates)
    found = model.eig()
    assert found.verdict == "unstable"
    assert "grow like t" in found.reasons[0]
    assert model.eig_precise(30).verdict == "unstable"
    assert model.sweep("e", [0.0, 0.1]).verdicts == ["unstable", "unstable"]
    assert model.certify().verdict in ("unstable", "not provable")


@pytest.mark.parametrize(("along", "across", "rates"), STAYING)
def test_a_chain_that_ends_in_a_symmetry_is_drift(along, across, rates):
    assert "stable up to symmetry" in point(along, across, rates).eig().verdict


@pytest.mark.parametrize(("along", "across", "rates"), NOT_LINEAR)
def test_a_chain_proves_nothing_where_the_equations_are_not_linear(along, across, rates):
    assert point(along, across, rates).eig().verdict != "unstable"


def test_a_zero_that_is_only_nearly_one_is_not_counted():
    model = point("rate(p.y)", "-1e-60*rate(p.y)")
    assert model.eig().verdict == "undecided"
    assert model.eig_precise(80).verdict == "asymptotically stable up to symmetry"


AXIS = """
mbstab: 1
parameters: {P: 0, I: 0, D: 0}
bodies: {table: {type: planar_point, mass: 2}}
constraints: {rail: {holonomic: table.y}}
forces: {pid: {type: pid, coordinate: table.x, of: table.x, P: P, I: I, D: D}}
reference: {coordinates: {table: {x: 0}}}
"""


def test_a_controller_without_gains_on_a_free_axis():
    axis = mbstab.loads(AXIS)
    assert axis.eig().verdict == "unstable"  # x grows like t, and its integral like t**2
    assert axis.eig(I=3).verdict == "unstable"
    assert axis.eig(P=3, D=1).verdict == "asymptotically stable up to symmetry"
    assert axis.eig(P=3, I=1, D=2).verdict == "asymptotically stable"
    assert axis.sweep("D", np.linspace(0.0, 1.0, 3)).verdicts == [
        "unstable", "asymptotically stable up to symmetry", "asymptotically stable up to symmetry",
    ]  # fmt: skip
