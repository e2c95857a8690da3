"""Wheelsets on rails with linear creep: hunting against closed forms, and a bogie of two of them."""

import math

import numpy as np
import pytest

import mbstab
from mbstab.errors import ModelFileError, NumericalError

WHEELSET = """\
mbstab: 1
title: Wheelset on springs
parameters: {V: {value: 40, unit: m/s}, f23: 0, f33: 0, load: 0, k_y: 1e6, k_psi: 1.5e6}
bodies:
  wheelset: {type: planar, mass: 1022, inertia: 678}
drives:
  travel: {type: point, at: wheelset, direction: x, position: V*t}
  frame: {type: point, at: frame, direction: x, position: V*t}
  level: {type: point, at: frame, direction: y, position: 0}
forces:
  creep:
    {type: creep, at: wheelset, half_gauge: 0.75, conicity: 0.05, radius: 0.4572,
     f11: 11865600, f22: 10569600, f23: f23, f33: f33, load: load}
  springs: {type: bushing, between: [wheelset, frame], stiffness: [0, k_y], torsional_stiffness: k_psi}
reference:
  coordinates: {wheelset: {x: 0, y: 0, theta: 0}, frame: {x: 0, y: 0, theta: 0}}
"""
FRAME = "  frame: {type: planar, mass: 1, inertia: 1}\n"
SPIN = {"f23": 25401.6, "f33": 123.3792}


def wheelset():
    text = WHEELSET.replace("drives:", FRAME + "drives:")
    return mbstab.loads(text + "constraints: {straight: {holonomic: frame.theta}}\n")


def upper(found):
    return sorted((s for s in found.values() if s.imag >= 0.0), key=lambda s: -s.real)


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ({}, [-2.73930405068965 + 15.38686335366139j, -501.9187497393801 + 7.028279073061502j]),
        (SPIN, [-2.730770280236609 + 15.39472015151833j, -501.9318328903642 + 11.61990154859739j]),
    ],
)
def test_a_wheelset_on_springs(values, expected):
    found = wheelset().eig(**values)
    np.testing.assert_allclose(upper(found), expected, rtol=1e-11)
    assert found.verdict == "asymptotically stable"


@pytest.mark.parametrize(
    ("values", "speed", "frequency"),
    [
        ({}, 105.43733456709245847, 40.132862304982559778),
        pytest.param(SPIN, 105.3649935715784602, 40.088728389712971, marks=pytest.mark.long),
    ],
)
def test_a_wheelset_hunts_above_its_critical_speed(values, speed, frequency):
    (critical,) = wheelset().sweep("V", [90.0, 120.0], **values).critical
    assert critical.value == pytest.approx(speed, rel=1e-11)
    assert critical.frequency == pytest.approx(frequency, rel=1e-11)


def test_the_load_draws_the_wheelset_to_the_middle_and_turns_it_away():
    """m y'' + … + (k_y + W λ/e) y = 0, J ψ'' + … + (k_ψ − W λ e) ψ = 0."""
    W, e, slope = 2e5, 0.75, 0.05
    one = wheelset().eig(load=W)
    other = wheelset().eig(k_y=1e6 + W * slope / e, k_psi=1.5e6 - W * slope * e)
    np.testing.assert_allclose(upper(one), upper(other), rtol=1e-12)
    assert abs(upper(one)[0] - upper(wheelset().eig())[0]) > 1e-4


def test_rails_may_lie_in_any_direction():
    """The same wheelset free on rails at 30 degrees, off the origin."""
    text = """\
mbstab: 1
parameters: {V: 40, h: 0}
bodies: {wheelset: {type: planar, mass: 1022, inertia: 678}}
forces:
  creep:
    {type: creep, at: wheelset, rails: [cos(h), sin(h)], origin: [-3*sin(h), 3*cos(h)], half_gauge: 0.75,
     conicity: 0.05, radius: 0.4572, f11: 1.2e7, f22: 1.1e7}
reference:
  coordinates: {wheelset: {x: -3*sin(h), y: 3*cos(h), theta: h}}
  rates: {wheelset: {x: V*cos(h), y: V*sin(h)}}
"""
    one, other = (mbstab.loads(text).eig(h=h) for h in (0.0, math.pi / 6))
    np.testing.assert_allclose(upper(one)[:3], upper(other)[:3], rtol=1e-9, atol=1e-9)


def test_creep_has_no_value_at_rest():
    with pytest.raises(NumericalError, match=r"forces.creep .*\n.*give the body a speed along them"):
        wheelset().eig(V=0)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("half_gauge: 0.75, ", "", "the key 'half_gauge' is missing"),
        ("half_gauge: 0.75", "half_gauge: -1", "half gauge must be positive, got -1 m"),
        ("f22: 10569600", "f22: -1", "f22 must not be negative, got -1 N"),
    ],
)
def test_bad_creep_is_refused(old, new, message):
    with pytest.raises(ModelFileError, match=message):
        mbstab.loads(WHEELSET.replace(old, new).replace("drives:", FRAME + "drives:")).eig()


@pytest.mark.parametrize("load", [0.0, 2e5])
@pytest.mark.parametrize("V", [40.0, 130.0])
def test_a_wheelset_runs_either_way_alike(V, load):
    """Turned by half a turn about the vertical, a wheelset that runs backwards is one that runs ahead."""
    ahead, astern = (wheelset().eig(V=v, load=load, **SPIN) for v in (V, -V))
    np.testing.assert_allclose(upper(astern), upper(ahead), rtol=1e-9)
    assert astern.verdict == ahead.verdict == ("asymptotically stable" if V < 100.0 else "unstable")
    text = WHEELSET.replace("drives:", FRAME + "drives:").replace("half_gauge", "rails: -x, along: -x, half_gauge")
    text += "constraints: {straight: {holonomic: frame.theta}}\n"
    np.testing.assert_allclose(upper(mbstab.loads(text).eig(V=-V, load=load, **SPIN)), upper(ahead), rtol=1e-9)


def test_a_joint_that_does_not_close_is_told_where_creep_has_no_value_at_rest():
    text = """\
mbstab: 1
bodies:
  set: {type: planar, mass: 1000, inertia: 500, points: {a: [0.5, 0]}}
  frame: {type: planar, mass: 2000, inertia: 900, points: {a: [0.7, 0]}}
joints: {pin: {type: revolute, between: [set.a, frame.a]}}
forces:
  creep: {type: creep, at: set, half_gauge: 0.75, conicity: 0.1, radius: 0.45, f11: 1e6, f22: 1e6}
reference:
  coordinates: {set: {x: 0, y: 0, theta: 0}, frame: {x: 0, y: 0, theta: 0}}
  rates: {set: {x: 20}, frame: {x: 20}}
"""
    with pytest.raises(ModelFileError, match=r"<text>:5:15: joints.pin: .* \(coincident x\): the residual is -0\.2 m"):
        mbstab.loads(text).eig()
