"""Sharp's motorcycle of 1971 as a mechanism: wheels that roll, tyres with camber and relaxation."""

import numpy as np
import pytest

import mbstab
from mbstab.errors import ModelFileError

# The lift leaves the front wheel the printed load of 226 lb; statics alone give 226.488 lb.
MOTORCYCLE = """\
mbstab: 1
title: Motorcycle, Sharp 1971, in slug, ft, lb, s
parameters:
  {u: 50, M_f: 2.1, M_r: 14.9, a: 3.112, b: 1.574, e: 0.08, f: 0.093, h: 2.02, trail: 0.38, tilt: 0.4715, R: 1,
   sigma: 0.8, Z_f: 226, I_rx: 23, I_rz: 15.54, C_rxz: 1.28, I_fx: 0.91, I_fz: 0.326, i_fy: 0.53, i_ry: 0.775, g: 32.2,
   cs: cos(tilt), sn: sin(tilt), k: (a+e)*cs - f*sn, j: (a+e)*sn + f*cs, l: (a - trail)/cs, w_f: 0.2, w_r: 0.5,
   n_f: w_f*M_f/(M_f - w_f), n_r: w_r*M_r/(M_r - w_r), x_F: k - w_f/(M_f - w_f)*(l - k),
   z_F: j - w_f/(M_f - w_f)*(R - j), x_R: w_r/(M_r - w_r)*b, z_R: h - w_r/(M_r - w_r)*(R - h)}
gravity: [0, 0, -g]
bodies:
  rear_wheel: {type: spatial, mass: w_r, inertia: [i_ry/2, i_ry/2, i_ry], axes: [pi/2, 0, 0]}
  rear:
    type: spatial
    mass: M_r - w_r
    inertia: {xx: I_rx - i_ry/2 - n_r*(R - h)**2, yy: 30, zz: I_rz - i_ry/2 - n_r*b**2, xz: C_rxz - n_r*b*(R - h)}
    points: {hub: [-b - x_R, 0, R - z_R], head: [a/cs - x_R, 0, -z_R], foot: [l - x_R, 0, -z_R]}
    directions: {steer: [-sn, 0, cs]}
  front:
    type: spatial
    mass: M_f - w_f
    inertia:
      xx: I_fx*cs**2 + I_fz*sn**2 - i_fy/2 - n_f*(R - j)**2
      yy: 0.6
      zz: I_fx*sn**2 + I_fz*cs**2 - i_fy/2 - n_f*(l - k)**2
      xz: (I_fx - I_fz)*sn*cs + n_f*(l - k)*(R - j)
    points: {hub: [l - x_F, 0, R - z_F], head: [a/cs - x_F, 0, -z_F]}
    directions: {steer: [-sn, 0, cs]}
  front_wheel: {type: spatial, mass: w_f, inertia: [i_fy/2, i_fy/2, i_fy], axes: [pi/2, 0, 0]}
joints:
  rear_axle: {type: revolute, between: [rear.hub, rear_wheel], axis: [-y, z]}
  steering: {type: revolute, between: [front.head, rear.head], axis: steer}
  front_axle: {type: revolute, between: [front.hub, front_wheel], axis: [-y, z]}
contacts:
  rear: {type: wheel, center: rear_wheel, axle: z, radius: R, motion: sideways}
  front: {type: wheel, center: front_wheel, axle: z, radius: R, motion: sideways}
forces:
  lift: {type: force, at: rear.foot, vector: [0, 0, g*(M_f*(k + b) + M_r*b)/(l + b) - Z_f]}
  damper: {type: joint_spring, joint: steering, damping: 5}
  rear: {type: tyre, contact: rear, cornering_stiffness: 3559, camber_stiffness: 298, relaxation_length: sigma}
  front: {type: tyre, contact: front, cornering_stiffness: 2512, camber_stiffness: 211, relaxation_length: sigma}
reference:
  coordinates:
    rear_wheel: {x: -b, y: 0, z: R, phi: 0, theta: 0, psi: 0}
    rear: {x: x_R, y: 0, z: z_R, phi: 0, theta: 0, psi: 0}
    front: {x: x_F, y: 0, z: z_F, phi: 0, theta: 0, psi: 0}
    front_wheel: {x: l, y: 0, z: R, phi: 0, theta: 0, psi: 0}
  rates:
    rear_wheel: {x: u, psi: -u/R}
    rear: {x: u}
    front: {x: u}
    front_wheel: {x: u, psi: -u/R}
"""


def sharp(u):
    """Return the eigenvalues of Sharp's equations, states v, r, φ', δ', φ, δ and the side forces of both tyres."""
    M_f, M_r, a, b, e, f, h, t, tilt, K, sigma, g = (
        2.1,
        14.9,
        3.112,
        1.574,
        0.08,
        0.093,
        2.02,
        0.38,
        0.4715,
        5,
        0.8,
        32.2,
    )
    I_rx, I_rz, C_rxz, I_fx, I_fz, g_f, g_r = 23, 15.54, 1.28, 0.91, 0.326, 0.53, 0.775
    c, s = np.cos(tilt), np.sin(tilt)
    k, j, l = (a + e) * c - f * s, (a + e) * s + f * c, (a - t) / c  # noqa: E741
    S = M_f * e * g + t * 226
    M = np.zeros((4, 4))
    M[0] = M_f + M_r, M_f * k, M_f * j + M_r * h, M_f * e
    M[1, 1:] = (
        M_f * k * k + I_rz + I_fx * s * s + I_fz * c * c,
        M_f * j * k - C_rxz + (I_fz - I_fx) * s * c,
        M_f * e * k + I_fz * c,
    )
    M[2, 2:] = M_f * j * j + M_r * h * h + I_rx + I_fx * c * c + I_fz * s * s, M_f * e * j + I_fz * s
    M[3, 3] = I_fz + M_f * e * e
    E, B = np.eye(8), np.zeros((8, 8))
    E[:4, :4] = M + np.triu(M, 1).T
    B[0, [1, 6, 7]] = -(M_f + M_r) * u, 1, 1
    B[1] = 0, -M_f * k * u, (g_f + g_r) * u, g_f * s * u, 0, 0, l, -b
    B[2] = 0, -(M[0, 2] + g_f + g_r) * u, 0, -g_f * c * u, M[0, 2] * g, S, 0, 0
    B[3] = 0, -(M_f * e + g_f * s) * u, g_f * c * u, -K, S, S * s, -t, 0
    B[4, 2] = B[5, 3] = 1
    B[6] = np.array([-2512 / u, -2512 * l / u, 0, 2512 * t / u, 211, 2512 * c + 211 * s, -1, 0]) * u / sigma
    B[7] = np.array([-3559 / u, 3559 * b / u, 0, 0, 298, 0, 0, -1]) * u / sigma
    return np.linalg.eigvals(np.linalg.solve(E, B))


PRINTED = {
    10: (-3.56, 2.01 + 1.63j, -5.20 + 55.7j),
    30: (-0.13, -3.36 + 4.56j, -6.42 + 55.5j),
    160: (0.04, -0.96 + 21.2j, -0.82 + 57.5j),
}
# Evaluated in 40 digits.
EXACT = {
    10: (-3.56268377594572, 2.01228139761372 + 1.63280897394531j, -5.20365111038097 + 55.6816452426451j),
    30: (-0.128109521122303, -3.36060102420535 + 4.55575767175336j, -6.4175345567029 + 55.51209499472j),
    160: (0.0440138325861541, -0.961027431910383 + 21.20119184021j, -0.824595462433745 + 57.5321926735261j),
}


@pytest.mark.parametrize("u", [pytest.param(10, marks=pytest.mark.long), 30, 160])
def test_a_motorcycle_has_the_printed_eigenvalues_and_those_of_its_equations(u):
    found = mbstab.loads(MOTORCYCLE).eig(u=u)
    values = np.array([e.value for e in found.eigenvalues if abs(e.value) > 1e-9])
    expected = sharp(u)
    assert len(values) == len(expected) == 8
    for e in found.eigenvalues:
        if abs(e.value) > 1e-9:
            error = np.min(np.abs(expected - e.value))
            assert error < max(1e-11 * abs(e.value), e.error_bound)
    for exact, printed in zip(EXACT[u], PRINTED[u], strict=True):
        nearest = values[np.argmin(np.abs(values - exact))]
        assert abs(nearest - exact) < 1e-11 * abs(exact)
        for x, y in ((nearest.real, np.real(printed)), (nearest.imag, np.imag(printed))):
            assert abs(x - y) <= (0.05 if abs(y) >= 10 else 0.005)


# The whole of Sharp's table: capsize; weave; wobble (1/s), over the speed (ft/s).
TABLE = {
    10: (-3.56, 2.01, 1.63, -5.20, 55.7),
    20: (-2.83, -0.18, 2.09, -5.91, 55.8),
    30: (-0.13, -3.36, 4.56, -6.42, 55.5),
    50: (0.08, -6.59, 11.4, -6.52, 54.6),
    70: (0.08, -3.97, 16.8, -5.70, 54.0),
    100: (0.07, -1.82, 19.2, -3.94, 54.3),
    130: (0.05, -1.13, 20.4, -2.24, 55.6),
    160: (0.04, -0.96, 21.2, -0.82, 57.5),
}


def test_the_example_has_all_forty_printed_numbers():
    result = mbstab.load("motorcycle.yaml").sweep("u", 0.3048 * np.array(list(TABLE)))
    for values, (capsize, *pairs) in zip(result.branches, TABLE.values(), strict=True):
        assert np.min(np.abs(values - capsize)) <= 0.005
        for real, imag in zip(pairs[::2], pairs[1::2], strict=True):
            near = values[np.argmin(np.abs(values - complex(real, imag)))]
            assert abs(near.real - real) <= 0.005
            assert abs(near.imag - imag) <= (0.05 if imag >= 10 else 0.005)


@pytest.mark.parametrize(
    ("u", "verdict"),
    [
        pytest.param(18, "unstable", marks=pytest.mark.long),
        (25, "asymptotically stable up to symmetry"),
        (70, "unstable"),
    ],
)
def test_a_motorcycle_is_stable_between_weave_and_capsize(u, verdict):
    assert mbstab.loads(MOTORCYCLE).eig(u=u).verdict == verdict


@pytest.mark.parametrize(("u", "mass"), [(3, 0.2), (10, 1e-6), pytest.param(50, 1e-8, marks=pytest.mark.long)])
def test_a_slow_motorcycle_and_one_with_light_wheels_are_known_to_run_steadily(u, mass):
    found = mbstab.loads(MOTORCYCLE).eig(u=u, w_f=mass, w_r=mass)
    assert (found.verdict, found.counts.neutral, found.counts.expected) == ("unstable", 6, 14)


def test_wheels_may_leave_their_mass_to_the_frames():
    """Where a massless wheel rolls, rounding in the row of a slip is not what determines its place."""
    found = mbstab.loads(MOTORCYCLE).eig(u=50, w_f=0, w_r=0)
    assert (found.counts.rank_nonholonomic, found.counts.expected) == (4, 14)
    assert found.verdict == "unstable"
    values = [s for s in found.values() if abs(s) > 1e-9]
    expected = sharp(50)
    assert len(values) == len(expected)
    assert all(np.min(np.abs(expected - s)) < 1e-10 * abs(s) for s in values)


def test_a_wheel_that_is_held_across_its_track_takes_no_tyre():
    text = MOTORCYCLE.replace(
        "center: rear_wheel, axle: z, radius: R, motion: sideways", "center: rear_wheel, axle: z, radius: R"
    )
    with pytest.raises(
        ModelFileError, match=r"'rear' holds its wheel across the track \(motion: rolling\): there is no slip"
    ):
        mbstab.loads(text)


@pytest.mark.parametrize(
    ("contact", "message"),
    [
        ("rare", "there is no contact 'rare'"),
        ("[rear]", "expected the name of a contact"),
    ],
)
def test_a_tyre_without_a_contact_is_refused(contact, message):
    with pytest.raises(ModelFileError, match=message):
        mbstab.loads(MOTORCYCLE.replace("{type: tyre, contact: rear,", f"{{type: tyre, contact: {contact},"))


@pytest.mark.long
def test_lengths_of_nanometres_have_the_verdict_of_feet():
    """Speeds that are tried then stop the wheels within rounding, where the slip of a tyre has no value."""
    small = mbstab.load("motorcycle.yaml").eig(ft=0.3048e-9)
    assert small.verdict == mbstab.load("motorcycle.yaml").eig().verdict
    assert small.counts.neutral == 5
