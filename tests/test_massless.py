"""Bodies without mass or inertia: motions that joints, springs and dampers determine all the same."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

import mbstab
from mbstab.errors import MassError


def close(found, expected, part):
    """Whether two sets of eigenvalues are equal, each relative to its own size."""
    found, expected = np.asarray(found, dtype=complex), np.asarray(expected, dtype=complex)
    assert len(found) == len(expected)
    rows, columns = linear_sum_assignment(np.abs(found[:, None] - expected))
    return bool(np.all(np.abs(found[rows] - expected[columns]) <= part * np.abs(expected[columns])))


# --- massless links and frames: joints determine their motion ---------------------------------------------------------

RODS = """\
mbstab: 1
gravity: [0, -9.81]
parameters: {m: 1, M: 2}
bodies:
  one: {type: planar, mass: 0, inertia: 0}
  a: {type: planar_point, mass: m}
  two: {type: planar, mass: 0, inertia: 0}
  b: {type: planar_point, mass: M}
joints:
  O: {type: revolute, between: [{body: one, point: [0, 1]}, ground]}
  A: {type: revolute, between: [one, a]}
  B: {type: revolute, between: [{body: two, point: [0, 1]}, a]}
  C: {type: revolute, between: [two, b]}
reference:
  coordinates: {one: {theta: 0}, two: {theta: 0}}
  guess: {a: {y: -1}, one: {y: -1}, b: {y: -2}, two: {y: -2}}
"""


def double_pendulum(m, M):
    """Return the frequencies of two point masses on massless rods of 1 m, one below the other."""
    mass, stiffness = np.array([[m + M, M], [M, M]]), 9.81 * np.diag([m + M, M])
    return np.sqrt(np.linalg.eigvals(np.linalg.solve(mass, stiffness)).real)


def test_a_double_pendulum_of_point_masses_on_massless_rods():
    rods = mbstab.loads(RODS)
    expected = np.concatenate([1j * s * double_pendulum(1.0, 2.0) for s in (1.0, -1.0)])
    found = rods.eig()
    assert found.verdict == "stable"
    assert found.counts.expected == 4
    assert close(found.values(), expected, 1e-14)
    for method in ("index3", "augmented", "udwadia-kalaba"):
        assert close(rods.eig(method).values(), expected, 1e-11)
    precise = rods.eig_precise(25)
    assert close([complex(x) for x in precise.values()], expected, 1e-15)
    assert close(rods.modes(2).values(), expected, 1e-12)
    swept = rods.sweep("m", np.array([0.5, 1.0]))
    assert close(swept.branches[1], expected, 1e-12)


def test_the_motion_of_massless_rods_is_simulated():
    """Both rods together at 0.1 rad: the energy is kept, and so are the lengths."""
    run = mbstab.loads(RODS).simulate(to=1.0, points=5, perturb={"one.theta": 0.1}, tol=1e-6)
    a, b = run.q[:, 3:5], run.q[:, 8:10]
    assert np.linalg.norm(a, axis=1) == pytest.approx(1.0, abs=1e-12)
    assert np.linalg.norm(b - a, axis=1) == pytest.approx(1.0, abs=1e-12)
    energy = 0.5 * (run.u[:, 3:5] ** 2).sum(1) + (run.u[:, 8:10] ** 2).sum(1) + 9.81 * (a[:, 1] + 2.0 * b[:, 1])
    assert np.ptp(energy) < 1e-5
    assert np.ptp(a[:, 0]) > 0.05


def test_massless_rods_are_proven():
    pytest.importorskip("flint")
    assert mbstab.loads(RODS).certify().verdict == "stable"


HOOKE = """\
mbstab: 1
gravity: [0, 0, -9.81]
bodies:
  bob: {type: spatial, mass: 3, inertia: [0.2, 0.3, 0.1], center_of_mass: [0.05, 0, -1]}
YOKE
reference: {find: equilibrium}
"""
HINGES = """\
  yoke: {type: spatial, mass: 0, inertia: [0, 0, 0]}
joints:
  first: {type: revolute, between: [yoke, ground], axis: [1, 0, 0]}
  second: {type: revolute, between: [bob, yoke], axis: [0, 1, 0]}"""
CROSS = "joints: {hooke: {type: universal, between: [bob, ground], axis: [[0, 1, 0], [1, 0, 0]]}}"


def test_a_massless_yoke_between_two_hinges_is_a_universal_joint():
    yoke, hooke = (mbstab.loads(HOOKE.replace("YOKE", x)).eig() for x in (HINGES, CROSS))
    assert yoke.counts.expected == hooke.counts.expected == 4
    assert close(yoke.values(), hooke.values(), 1e-13)
    assert yoke.verdict == hooke.verdict == "stable"


def test_what_nothing_determines_is_refused_where_it_stands():
    text = RODS.replace("  C: {type: revolute, between: [two, b]}\n", "").replace("mass: M", "mass: M + 0")
    with pytest.raises(MassError, match=r"<text>:7:8: bodies\.two: a motion of two\.theta.* carries no mass"):
        mbstab.loads(text.replace("  b: {type: planar_point, mass: M + 0}\n", "").replace(", b: {y: -2}", "")).motion()
