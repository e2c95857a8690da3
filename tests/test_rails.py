"""Wheelsets and bogies on rails with linear creep: closed forms, equations in 40 digits, published critical speeds."""

import math
import re
from functools import cache
from pathlib import Path

import mpmath
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


# --- Cooperrider's complex bogie in space -----------------------------------------------------------------------------


# The constants of creep of Vermeulen and Johnson, and exchanged, as some have used them.
R1 = {"f_11": 6.563e6 / 0.54219, "f_22": 6.563e6 / 0.60252}
R2 = {"f_11": 6.563e6 / 0.60252, "f_22": 6.563e6 / 0.54219}


BOGIE = (Path(__file__).parents[1] / "models" / "bogie.yaml").read_text(encoding="utf-8")


@cache
def bogie():
    return mbstab.loads(BOGIE)


def equations(V, f_11, f_22):
    """Return M, C, K for y₁, ψ₁, y₂, ψ₂ of the wheelsets, and y, ψ, φ of the frame, spring by spring."""
    mpf = mpmath.mpf
    a, b, d1, d2, h1, h2, slope, r0 = map(mpf, ("0.716", "1.074", "0.62", "0.68", "0.0762", "0.6584", "0.05", "0.4572"))
    k1, k2, k3, k4, k5, k6 = map(mpf, ("1823e3", "3646e3", "3646e3", "182300", "333300", "2.71e6"))
    f11, f22 = mpf(f_11), mpf(f_22)
    M = mpmath.diag([1022, 678, 1022, 678, mpf("2918.9"), 6780, 6780])
    C, K = mpmath.zeros(7), mpmath.zeros(7)

    def add(to, coefficient, **stretch):
        row = mpmath.matrix([stretch.get(x, 0) for x in ("y1", "p1", "y2", "p2", "y", "psi", "phi")])
        to += coefficient * row * row.T
        return to

    K = add(K, 2 * k1, y1=1, y=-1, psi=-b, phi=-h1)
    K = add(K, 2 * k1, y2=1, y=-1, psi=b, phi=-h1)
    K = add(K, 2 * k2 * d1**2, p1=1, psi=-1)
    K = add(K, 2 * k2 * d1**2, p2=1, psi=-1)
    K = add(K, 2 * k4, y=1, phi=-h2)
    K = add(K, k6, psi=1)
    K = add(K, 2 * k5 * d2**2 + 4 * k3 * d1**2, phi=1)
    C = add(C, 2 * mpf("29.2e3"), y=1, phi=-h2)
    C = add(C, 2 * mpf("20e3") * d2**2, phi=1)
    for y, p in ((0, 1), (2, 3)):
        C[y, y] += 2 * f22 / V
        K[y, p] -= 2 * f22
        C[p, p] += 2 * f11 * a**2 / V
        K[p, y] += 2 * f11 * a * slope / r0
    return M, C, K


def expected(V, **constants):
    """Return the eigenvalues, from 40 digits."""
    with mpmath.workdps(40):
        M, C, K = equations(mpmath.mpf(V), **constants)
        A = mpmath.zeros(14)
        A[:7, 7:] = mpmath.eye(7)
        A[7:, :7], A[7:, 7:] = -(M**-1) * K, -(M**-1) * C
        return mpmath.eig(A, left=False, right=False)


def hunting(guess, **constants):
    """Return the critical speed and its frequency: det(K − ω² M + iω C) = 0."""
    with mpmath.workdps(40):

        def determinant(V, w):
            M, C, K = equations(V, **constants)
            found = mpmath.det((K - w**2 * M + 1j * w * C) / mpmath.mpf("1e6"))
            return [found.real, found.imag]

        return [float(x) for x in mpmath.findroot(determinant, guess)]


@pytest.mark.parametrize(("V", "constants"), [(60, R1), (80, R1), (80, R2)])
def test_a_bogie_has_the_eigenvalues_of_its_equations(V, constants):
    found = bogie().eig(V=V, **constants)
    assert len(found.values()) == 14
    for value in expected(V, **constants):
        assert np.min(np.abs(found.values() - complex(value))) < 1e-12 * abs(value)
    assert found.verdict == ("asymptotically stable" if V < 65 else "unstable")


@pytest.mark.parametrize(
    ("constants", "guess", "digits", "published"),
    [
        pytest.param(R1, (65, 24), 65.28777395144450868, None, marks=pytest.mark.long),
        (R2, (69, 25), 68.64245831049231592, 68.66),
    ],
)
def test_a_bogie_hunts_above_its_critical_speed(constants, guess, digits, published):
    (critical,) = bogie().sweep("V", [60.0, 75.0], **constants).critical
    speed, frequency = hunting(guess, **constants)
    assert speed == pytest.approx(digits, rel=1e-15)
    assert critical.value == pytest.approx(speed, rel=1e-11)
    assert critical.frequency == pytest.approx(frequency, rel=1e-11)
    assert published is None or critical.value == pytest.approx(published, rel=3e-4)


def test_the_answer_is_proven():
    assert bogie().certify().verdict == "asymptotically stable"
    assert bogie().certify(V=80).verdict == "unstable"


SPATIAL_WHEELSET = """\
mbstab: 1
title: Wheelset in space on rails along z, its load upright along y
parameters: {V: {value: 40, unit: m/s}}
bodies: {wheelset: {type: spatial, mass: 1022, inertia: [700, 678, 740]}}
HELD
drives: {travel: {type: coordinate, coordinate: wheelset.z, position: V*t}}
forces:
  creep:
    {type: creep, at: wheelset, along: z, rails: z, normal: y, origin: [0.5, 0, 0], half_gauge: 0.75, conicity: 0.05,
     radius: 0.4572, f11: 1.2e7, f22: 1.1e7, f23: 2.5e4, f33: 120, load: 2e5}
  springs:
    {type: bushing, between: [wheelset, ground.o], stiffness: [1e6, 0, 0], torsional_stiffness: [0, 1.5e6, 3e6]}
ground: {points: {o: [0.5, 0, 0]}}
reference: {coordinates: {wheelset: {x: 0.5, z: 0, theta: 0}}}
"""


@pytest.mark.parametrize("rolls", [False, True])
def test_creep_acts_at_the_rails_where_the_wheelset_may_roll(rolls):
    """The contacts move sideways with x − r₀ φ, and their force rolls the wheelset; f₂₂, f₂₃ and f₃₃ by creepages."""
    held = "constraints: {pitch: {holonomic: wheelset.phi}, height: {holonomic: wheelset.y}}"
    if not rolls:
        held = "joints: {track: {type: planar, between: [wheelset, ground], axis: y}}"
    found = mbstab.loads(SPATIAL_WHEELSET.replace("HELD", held)).eig().values()
    V, e, r0, slope, load, f11, f22, f23, f33 = 40.0, 0.75, 0.4572, 0.05, 2e5, 1.2e7, 1.1e7, 2.5e4, 120.0
    # Coordinates x, yaw about y, roll about z; the contact lies below, at x + r₀ roll.
    contact, yaw = np.array([1.0, 0.0, r0]), np.array([0.0, 1.0, 0.0])
    middle = np.array([1.0, 0.0, 0.0])
    C = (2 * f22 * np.outer(contact, contact) + 2 * f23 * (np.outer(contact, yaw) - np.outer(yaw, contact))) / V
    C += (2 * f11 * e**2 + 2 * f33) * np.outer(yaw, yaw) / V
    K = np.diag([1e6, 1.5e6 - load * slope * e, 3e6]) - 2 * f22 * np.outer(contact, yaw) + 2 * f23 * np.outer(yaw, yaw)
    K += 2 * f11 * e * slope / r0 * np.outer(yaw, middle) + load * slope / e * np.outer(contact, middle)
    M = np.diag([1022.0, 678.0, 740.0])
    n = 3 if rolls else 2
    M, C, K = M[:n, :n], C[:n, :n], K[:n, :n]
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
    assert len(found) == 2 * n
    for value in np.linalg.eigvals(A):
        assert np.min(np.abs(found - value)) < 1e-11 * abs(value)


def test_creep_in_space_has_no_value_at_rest():
    with pytest.raises(NumericalError, match=r"<text>:\d+:\d+: forces.creep1 .*\n.*give the body a speed along"):
        bogie().eig(V=0)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("half_gauge: a", "half_gauge: -a", "half gauge must be positive, got -0.716 m"),
        ("at: axle<i>, half", "at: axle<i>, rails: [1, 0], half", "expected 3 numbers, got 2"),
        ("at: axle<i>, half", "at: axle<i>, rails: [1, 0, 1e-3], half", "rails must lie across normal"),
        ("at: axle<i>, half", "at: axle<i>, normal: [0, 0, 0], half", "a direction must have a length"),
    ],
)
def test_bad_creep_in_space_is_refused(old, new, message):
    with pytest.raises(ModelFileError, match=rf"<text>:\d+:\d+: forces\.creep1.*{re.escape(message)}"):
        mbstab.loads(BOGIE.replace(old, new, 1)).eig()
