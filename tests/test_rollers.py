"""Disks that roll on each other in the plane, against closed forms."""

import math

import numpy as np
import pytest

import mbstab
from mbstab.analysis.reference.reactions import reactions

RING = """\
mbstab: 1
parameters: {{m: 2, r: 0.1, R: 0.5, k: 0.5, Omega: 3, y: {y}}}
gravity: [0, -9.81]
bodies:
  disk: {{type: planar, mass: m, inertia: k*m*r**2}}
{roller}
contacts: {{pair: {{type: rollers, between: [disk, {on}], radii: [r, R], internal: {internal}{more}}}}}
reference:
  coordinates: {{disk: {{x: 0, y: y, theta: 0}}}}
"""


@pytest.mark.parametrize(
    ("internal", "more", "squared"),
    [
        # (1 + k) (R -+ r) phi'' = -+ g phi, without friction k = 0.
        ("true", "", -9.81 / (1.5 * 0.4)),
        ("false", "", 9.81 / (1.5 * 0.6)),
        ("true", ", motion: frictionless", -9.81 / 0.4),
    ],
)
def test_a_disk_inside_a_ring_and_on_top_of_a_cylinder(internal, more, squared):
    y = "r - R" if internal == "true" else "r + R"
    found = mbstab.loads(RING.format(y=y, roller="", on="ground", internal=internal, more=more)).eig()
    values = [x for x in found.values() if abs(x) > 1e-6]
    np.testing.assert_allclose(np.square(values), [squared, squared], rtol=1e-12)


RIG = """\
mbstab: 1
parameters: {m: 2, r: 0.3, R: 0.1, a: 0.2, k: 0.5, Omega: 3, A: 0.7}
gravity: [0, -9.81]
bodies:
  wheel: {type: planar, mass: m, inertia: k*m*r**2}
  left: {type: planar, mass: 1, inertia: 0.01}
  right: {type: planar, mass: 1, inertia: 0.01}
joints:
  one: {type: revolute, between: [left, {body: ground, point: [-a, 0]}]}
  two: {type: revolute, between: [right, {body: ground, point: [a, 0]}]}
contacts:
  first: {type: rollers, between: [wheel, left], radii: [r, R]}
  second: {type: rollers, between: [wheel, right], radii: [r, R]}
drives: {turning: {type: joint, joint: one, motion: angle, velocity: Omega + A*t}}
reference:
  coordinates: {left: {x: -a, y: 0, theta: 0}, right: {x: a, y: 0, theta: 0}, wheel: {x: 0, theta: 0}}
  guess: {wheel: {y: r}}
"""


def test_a_wheel_on_two_rollers_of_a_rig_turns_against_the_driven_one_and_takes_its_work():
    run = mbstab.loads(RIG).simulate(to=1.0, points=3)
    names = list(run.names)
    turn, place, other = (names.index(x) for x in ("wheel.theta", "wheel.y", "right.theta"))
    driven = 3.0 + 0.7 * run.times
    np.testing.assert_allclose(run.u[:, turn], -driven * 0.1 / 0.3, rtol=1e-10)
    np.testing.assert_allclose(run.u[:, other], driven, rtol=1e-10)
    np.testing.assert_allclose(run.q[:, place], math.sqrt(0.4**2 - 0.2**2), rtol=1e-12)
    assert run.energy_drift < 1e-9 * np.max(run.kinetic)
    assert np.ptp(run.kinetic) > 0.1 * np.max(run.kinetic)


def test_reactions_of_a_resting_wheel_on_two_rollers_carry_its_weight():
    mechanism = mbstab.loads(RIG.replace("Omega + A*t", "0"))
    at = mechanism.motion()
    carried = [x.force for x in reactions(mechanism.system(), at.q, at.u, at.dynamics.J, at.nu) if x.body == "wheel"]
    # Each roller pushes half of the weight along the line of centres, which stands at asin(a/(r + R)) = 30 deg.
    half, across = 9.81, 9.81 * math.tan(math.pi / 6)
    np.testing.assert_allclose(carried, [[across, half], [-across, half]], rtol=1e-12)
