"""The linear statement beside every verdict: how many eigenvalues lie where, and the chains of explained zeros."""

import json

import numpy as np
import pytest
from click.testing import CliRunner

import mbstab
from mbstab.analysis.verdict.neutral import Separated, chains_of
from mbstab.analysis.verdict.rule import MARGINAL, REQUIRED, UNDECIDED
from mbstab.analysis.verdict.spectrum import Neutral
from mbstab.cli import main

DRIFT = """
mbstab: 1
bodies: {a: {type: planar_point, mass: 1}, b: {type: planar_point, mass: 1}}
constraints: {ay: {holonomic: a.y}, by: {holonomic: b.y}}
forces: {s: {type: expression, on: {b.x: "-cos(a.x)*b.x - rate(b.x)"}}}
reference: {coordinates: {a: {x: 0, y: 0}, b: {x: 0, y: 0}}}
"""

BALLBOT = """
mbstab: 1
parameters: {mB: 2.4, R: 0.105, IB: 0.0174, mb: 51, l: 0.69, Ib: 12.6, Iz: 0.66, k1: 250, k2: 70, k3: 2, k4: 4}
gravity: [0, 0, -9.81]
bodies:
  ball: {type: spatial, mass: mB, inertia: [IB, IB, IB]}
  body: {type: spatial, mass: mb, inertia: [Ib, Ib, Iz], points: {c: [0, 0, -l]}}
joints:
  centre: {type: spherical, between: [body.c, ball]}
contacts:
  roll: {type: ellipsoid, center: ball, a: R, b: R, c: R}
definitions:
  tx: k1*body.phi + k2*wx(body) - k3*ball.y/R - k4*rate(ball.y)/R
  ty: k1*body.theta + k2*wy(body) + k3*ball.x/R + k4*rate(ball.x)/R
forces:
  motors: {type: expression, on: {ball.phi: tx, body.phi: -tx, ball.theta: ty, body.theta: -ty}}
reference:
  coordinates:
    ball: {x: 0, y: 0, z: R, phi: 0, theta: 0, psi: 0}
    body: {x: 0, y: 0, z: R+l, phi: 0, theta: 0, psi: 0}
"""


def required(name, *options):
    return CliRunner().invoke(main, ["eig", name, *options]).exit_code


@pytest.mark.parametrize(
    ("model", "expected"),
    [
        # Both drift apart from what they say at the reference: no more than the linear statement is true.
        (DRIFT, {"right": 0, "left": 2, "axis": 0, "open": 0, "zeros": 1, "explained": 1}),
        (BALLBOT, {"right": 0, "left": 8, "axis": 0, "open": 0, "zeros": 4, "explained": 2}),
    ],
)
def test_an_undecided_motion_says_what_is_known(model, expected):
    answer = mbstab.loads(model).eig()
    assert answer.verdict == UNDECIDED
    assert {key: getattr(answer.spectrum, key) for key in expected} == expected
    assert answer.spectrum.linear
    assert f"0 right of the imaginary axis, {expected['left']} left of it" in str(answer)


def test_all_ways_to_compute_say_the_same():
    bicycle = mbstab.load("whipple_bicycle.yaml")
    for answer in (bicycle.eig(v=5), bicycle.eig_precise(20, v=5), bicycle.certify(20, v=5)):
        found = answer.spectrum
        assert (found.right, found.left, found.axis, found.open, found.explained) == (0, 4, 0, 0, 6)
        # x and the two wheel angles follow the speed, y the heading.
        assert found.chains.zeros == (2, 2, 1, 1)
        assert dict(found.chains.drifting) == dict.fromkeys(
            ["translation along x", "translation along y", "rear_wheel.psi", "front_wheel.psi"], 1
        )
    assert bicycle.eig(v=4).spectrum.right == 2
    (at_4, at_5) = bicycle.sweep("v", [4, 5]).spectra
    assert at_4 == {"right": 2, "left": 2, "axis": 0, "open": 0}
    assert at_5 == {"right": 0, "left": 4, "axis": 0, "open": 0}


def test_json_and_the_table_have_it():
    answer = CliRunner().invoke(main, ["eig", "chaplygin_sleigh.yaml", "--format", "json"])
    found = json.loads(answer.stdout)["spectrum"]
    assert found["chains"] == [2, 2]
    assert found["drifting"] == [{"name": "sleigh.x", "power": 1}, {"name": "sleigh.y", "power": 1}]
    assert found["linear"]
    table = " ".join(CliRunner().invoke(main, ["eig", "chaplygin_sleigh.yaml"]).stdout.split())
    assert "in 2 chains of 2: the positions sleigh.x and sleigh.y drift like t" in table


def test_what_is_required_of_the_linearized_equations_is_the_least():
    assert set(REQUIRED["asymptotic"]) < set(REQUIRED["stable"]) < set(REQUIRED["marginal"]) <= set(REQUIRED["linear"])
    # The disk of the literature rolls, above its critical speed, with zeros that nothing explains.
    assert required("rolling_disk.yaml", "--set", "omega=8", "--require", "marginal") == 3
    assert required("rolling_disk.yaml", "--set", "omega=8", "--require", "linear") == 0
    assert required("rolling_disk.yaml", "--set", "omega=1", "--require", "linear") == 3
    # Equations of an instant say nothing about motions, not even linearly.
    assert required("governor_paper.yaml", "--frozen", "--require", "linear") == 3


# Its double pair ±i is defective: what no structure holds on the axis may lie right of it.
def test_a_pair_that_may_grow_is_not_accepted():
    circulating = mbstab.loads(
        "mbstab: 1\nbodies: {p: {type: planar_point, mass: 1}}\n"
        'forces: {f: {type: expression, on: {p.x: "-p.x + p.y", p.y: "-p.y"}}}\n'
        "reference: {coordinates: {p: {x: 0, y: 0}}}\n"
    )
    answer = circulating.eig()
    assert answer.verdict == UNDECIDED
    assert (answer.spectrum.open, answer.spectrum.linear) == (4, False)


def test_multipliers_are_counted_about_the_circle():
    answer = mbstab.load("kapitza.yaml").eig()
    assert answer.verdict == MARGINAL
    assert (answer.spectrum.right, answer.spectrum.axis) == (0, 2)
    assert "0 outside the unit circle, 2 on it" in str(answer)


def test_chains_have_the_lengths_of_jordan_blocks():
    rng = np.random.default_rng(4)
    for lengths in ((3, 1), (2, 2, 1), (1, 1), (4,)):
        n = sum(lengths)
        J, start = np.zeros((n, n)), 0
        for length in lengths:
            J[start : start + length - 1, start + 1 : start + length] = np.eye(length - 1)
            start += length
        Q = np.linalg.qr(rng.standard_normal((n + 2, n + 2)))[0]
        S = np.zeros((n + 2, n + 2))
        S[:n, :n], S[n:, n:] = J, -np.eye(2)
        S = Q @ S @ Q.T
        found = Separated(S, Q[:, :n], np.zeros((0, n + 2)), Q[:, n:], Neutral())
        assert chains_of(found).zeros == lengths
        named = [(f"x{k}", Q[:, k]) for k in range(n)]
        ends = np.cumsum((0, *lengths[:-1]))
        # The first vector of a chain of length m grows with the power m − 1.
        powers = {
            f"x{start + k}": length - 1 - k
            for start, length in zip(ends, lengths, strict=True)
            for k in range(length - 1)
        }
        assert dict(chains_of(found, named).drifting) == powers
