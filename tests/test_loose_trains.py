"""Drive trains whose joints have no body in common: what their equations are, and that they are told."""

import numpy as np
import pytest
from mechanisms import frequencies
from test_gears import in_dimension

import mbstab

HOUSINGS = """
mbstab: 1
bodies:
  h1: {type: planar, mass: 1, inertia: 0.3}
  h2: {type: planar, mass: 1, inertia: 0.5}
  w1: {type: planar, mass: 1, inertia: 0.02}
  w2: {type: planar, mass: 1, inertia: 0.07}
joints:
  a: {type: revolute, between: [h1, ground]}
  b: {type: HELD, between: [h2, AT]}
  c: {type: revolute, between: [w1, h1]}
  d: {type: revolute, between: [ORDER]}
  mesh: {type: TRAIN, joints: [c, d], ratio: 2}
forces:
  s1: {type: joint_spring, joint: a, stiffness: 20}
  s2: {type: joint_spring, joint: c, stiffness: 3}
OTHER
reference: {}
"""
FREE = "  s3: {type: joint_spring, joint: b, stiffness: 50}"


def housings(held="revolute", at="ground", order="w2, h2", train="gear", other=FREE):
    keys = {"HELD": held, "AT": at, "ORDER": order, "TRAIN": train, "OTHER": other}
    text = HOUSINGS
    for key, value in keys.items():
        text = text.replace(key, value)
    return text


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize(("train", "sense"), [("gear", -1), ("belt", 1)])
def test_joints_without_a_common_body_are_coupled_as_by_a_cable_and_told(train, sense, dimension):
    model = in_dimension(housings(train=train), dimension)
    # Turns of both housings, and of the first wheel in its own; each coupling moment acts on all four bodies.
    T = np.array([[1, 0, 0], [0, 1, 0], [1, 0, 1], [0, 1, 0.5 * sense]])
    M = T.T @ np.diag([0.3, 0.5, 0.02, 0.07]) @ T
    exact = np.sqrt(np.sort(np.linalg.eigvals(np.linalg.solve(M, np.diag([20.0, 50.0, 3.0]))).real))
    assert frequencies(model) == pytest.approx(exact, rel=1e-9)
    (text,) = mbstab.loads(model).eig().warnings
    assert text.startswith("joint 'mesh': the joints 'c' and 'd' have no body in common; their motions are coupled as")


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"order": "w2, h1"}, False),
        ({"order": "h1, w2"}, False),
        ({"held": "fixed", "at": "h1", "other": ""}, False),
        # The sense of the second angle would be another one in mesh.
        ({"held": "fixed", "at": "h1", "other": "", "order": "h2, w2"}, True),
        ({"held": "fixed", "at": "ground", "other": ""}, True),
        ({"order": "w2, ground"}, True),
    ],
)
def test_one_body_that_carries_the_wheels_is_enough(change, told):
    mechanism = mbstab.loads(housings(**change))
    assert any("no body in common" in text for text in mechanism.eig().warnings) == told
    swept = mbstab.loads(
        housings(**change).replace("mbstab: 1", "mbstab: 1\nparameters: {k: 3}").replace("ss: 3", "ss: k")
    )
    assert any("no body in common" in text for text in swept.sweep("k", np.linspace(1.0, 3.0, 3)).warnings) == told
