"""A leaning wheel led straight ahead: camber thrust, a moment of its own, and nothing over a slip angle of zero."""

import math

import numpy as np
import pytest

import mbstab
from mbstab.analysis.reference.reactions import reactions

WHEEL = """\
mbstab: 1
parameters: {v: 5, r: 0.3, lean: 0.1, C: 4500}
bodies:
  sled: {type: spatial, mass: 1, inertia: [1, 1, 1], directions: {axle: [0, cos(lean), sin(lean)]}}
  wheel: {type: spatial, mass: 1, inertia: [0.05, 0.05, 0.1], axes: AXES}
joints:
  axle: {type: revolute, between: [wheel, sled], axis: [AXLE, axle]}
  slide: {type: prismatic, between: [sled, {body: ground, point: [0, 0, r*cos(lean)]}], axis: x}
constraints: {cruise: {nonholonomic: rate(sled.x) - v}}
contacts: {c: {type: wheel, center: wheel, axle: z, radius: r, motion: sideways}}
forces: {t: {type: tyre, contact: c, cornering_stiffness: C, MORE}}
reference:
  coordinates: {sled: {x: 0}, wheel: {psi: 0}}
  rates: {sled: {x: v}, wheel: {x: v, psi: SPIN*v/r}}
"""
# The axle of the wheel to its right or to its left: the wheel then moves astern or ahead of its heading.
SIDES = {"astern": ("[lean + pi/2, 0, 0]", "-z", "-1"), "ahead": ("[lean - pi/2, 0, 0]", "z", "1")}


def led(side, more, **values):
    axes, axle, spin = SIDES[side]
    text = WHEEL.replace("AXES", axes).replace("AXLE", axle).replace("SPIN", spin).replace("MORE", more)
    return mbstab.loads(text).at(**values)


def loads(side, more, **values):
    """Return side force to the left and moment counter-clockwise that the tyre puts on the sled.

    Of a moment about the normal the part along the axle turns the wheel, and the rest is cos²(lean) of it.
    """
    model = led(side, more, **values)
    system, found = model.system(), model.motion()
    (slide,) = [
        x for x in reactions(system, found.q, found.u, found.dynamics.J, found.nu) if x.owner == "joint 'slide'"
    ]
    return -slide.force[1], -slide.torque[2]


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("stiffness", [4500, 0])
@pytest.mark.parametrize(
    ("more", "moment"),
    [
        ("aligning_stiffness: 20, trail: 0.05", 0.0),
        ("aligning_stiffness: 20, camber_moment: 3", -0.3),
        ("peak: 3000, shape_factor: 1.3, aligning_stiffness: 0, camber_moment: -3", 0.3),
    ],
)
def test_without_a_slip_angle_there_is_camber_thrust_and_its_own_moment_alone(side, stiffness, more, moment):
    force, turned = loads(side, f"camber_stiffness: 250, {more}", C=stiffness)
    assert force == pytest.approx(-25.0, rel=1e-9)  # to the right, to which the wheel leans
    assert turned == pytest.approx(moment * math.cos(0.1) ** 2, abs=1e-9)


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("magic", ["", "peak: 3000, shape_factor: 1.3, "])
def test_all_forces_are_the_same_once_the_state_has_settled(side, magic):
    more = f"{magic}camber_stiffness: 250, camber_moment: 3, aligning_stiffness: 20, trail: 0.05"
    now, later = led(side, more), led(side, f"{more}, relaxation_length: 0.4")
    at = now.motion()
    speeds = at.u + np.where([name.endswith(".y") for name in now.system().names], 0.2, 0.0)  # a slip angle, too
    slip = math.atan(0.2 / 5.0)
    settled = 250 * 0.1 / 4500 + slip if side == "ahead" else -(250 * 0.1 / 4500 + slip)
    loads = now.system().dynamics(at.q, speeds, 0.0).F0
    lagging = later.system().dynamics(np.append(at.q, settled), np.append(speeds, 0.0), 0.0)
    assert lagging.F0[:-1] == pytest.approx(loads, rel=1e-12, abs=1e-12)
    assert lagging.V[-1] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("more", ["", "trail: 0.05, ", "aligning_stiffness: 20, "])
def test_the_slip_of_a_wheel_that_is_led_straight_decays_by_itself(side, more):
    """Its forces act on what joints hold, and nothing moves the slip: its rate is |v|/σ in any unit."""
    found = led(side, f"{more}relaxation_length: 0.4").eig()
    assert found.verdict == "asymptotically stable up to symmetry"
    assert min(found.values().real) == pytest.approx(-5.0 / 0.4, rel=1e-12)


def test_camber_lags_behind_as_the_side_force_does():
    """One state for both: the thrust follows the lean over the relaxation length, |v|/σ."""
    text = (
        "mbstab: 1\nparameters: {v: 5, r: 0.3, s: 0.4}\n"
        "bodies: {w: {type: spatial, mass: 1, inertia: [0.05, 0.05, 0.1], axes: [-pi/2, 0, 0]}}\n"
        "contacts: {c: {type: wheel, center: w, axle: z, radius: r, motion: sideways}}\n"
        "forces:\n"
        "  t: {type: tyre, contact: c, cornering_stiffness: 4500, camber_stiffness: 250, relaxation_length: s}\n"
        "constraints:\n  y: {holonomic: w.y}\n  phi: {holonomic: w.phi}\n  theta: {holonomic: w.theta}\n"
        "reference: {coordinates: {w: {x: 0, y: 0, z: r, phi: 0, theta: 0, psi: 0}}, rates: {w: {x: v, psi: v/r}}}\n"
    )
    values = [e.value for e in mbstab.loads(text).eig().eigenvalues]
    assert min(abs(x + 5 / 0.4) for x in values) < 1e-9
    assert math.isclose(max(abs(x) for x in values), 12.5, rel_tol=1e-9)
