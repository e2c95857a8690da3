"""Motions of published benchmarks, against printed numbers and against equations written down independently.

Andrews' squeezing mechanism: Test Set for IVP Solvers (Mazzia, Magherini 2008), Hairer and Wanner (1996), section
VII.7. Bricard mechanism and stiff flyball governor: IFToMM benchmarks A04 and A05 (Gonzalez et al. 2006), published as
curves only, so what is compared are own equations in one and two coordinates.
"""

import functools
import json
import math
import re

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import mbstab

ANGLES = ("beta", "Theta", "gamma", "Phi", "delta", "Omega", "epsilon")
START = (
    -0.0617138900142764496358948458001,
    0.0,
    0.455279819163070380255912382449,
    0.222668390165885884674473185609,
    0.487364979543842550225598953530,
    -0.222668390165885884674473185609,
    1.23054744454982119249735015568,
)
GROWTH = (14222.4439199541138705911625887, -10666.8329399655854029433719415, 0.0, 0.0, 0.0, 0.0, 0.0)
# At 0.03 s, as printed with 16 digits.
END = (
    0.1581077119629904e2,
    -0.1575637105984298e2,
    0.4082224013073101e-1,
    -0.5347301163226948,
    0.5244099658805304,
    0.5347301163226948,
    0.1048080741042263e1,
)
SPEEDS = (
    0.1139920302151208e4,
    -0.1424379294994111e4,
    0.1103291221937134e2,
    0.1929337464421385e2,
    0.5735699284790808,
    -0.1929337464421385e2,
    0.3231791658026955,
)


def relative(sim, values):
    """Return the angles of the Test Set, or their rates, from those of the bodies."""
    turn = {body: values[sim.names.index(f"{body}.theta")] for body in sim.bodies}
    crank, rod, lever, b4, b5, b6, b7 = (
        turn[x] for x in ("crank", "rod", "lever", *(f"body_{i}" for i in range(4, 8)))
    )
    return np.array([crank, rod - crank, lever, b4 - b5, b5, b6 - b7, b7])


def squeezer(_, y):
    """Return the rates of the printed equations in seven angles, with drift held by feedback."""
    p, v = y[:7], y[7:]
    s, c = np.sin(p), np.cos(p)
    m1, m2, m3, m4, m5, m6, m7 = 0.04325, 0.00365, 0.02373, 0.00706, 0.07050, 0.00706, 0.05498
    i1, i2, i3, i4, i5, i6, i7 = 2.194e-6, 4.410e-7, 5.255e-6, 5.667e-7, 1.169e-5, 5.667e-7, 1.912e-5
    rr, ra, d, da, ss, zt, zf, u = 7e-3, 92e-5, 28e-3, 115e-4, 35e-3, 4e-2, 2e-2, 4e-2
    sc, sd, e, near, far = 18e-3, 2e-2, 2e-2, 2e-2 - 1421e-5, 2e-2 - 1421e-5
    M = np.diag(
        [
            m1 * ra**2 + m2 * (rr**2 - 2 * da * rr * c[1] + da**2) + i1 + i2,
            m2 * da**2 + i2,
            m3 * (1874e-5**2 + 1043e-5**2) + i3,
            m4 * near**2 + i4,
            m4 * (zt**2 + 2 * zt * near * s[3] + near**2) + m5 * (2308e-5**2 + 916e-5**2) + i4 + i5,
            m6 * far**2 + i6,
            m6 * (far**2 - 2 * u * far * s[5] + u**2) + m7 * (1228e-5**2 + 449e-5**2) + i6 + i7,
        ]
    )
    M[0, 1] = M[1, 0] = m2 * (da**2 - da * rr * c[1]) + i2
    M[3, 4] = M[4, 3] = m4 * (near**2 + zt * near * s[3]) + i4
    M[5, 6] = M[6, 5] = m6 * (far**2 - u * far * s[5]) + i6
    arm = np.array([sd * c[2] + sc * s[2], sd * s[2] - sc * c[2]])
    reach = arm + np.array([-0.03635 - 0.014, 0.03273 - 0.072])
    length = np.hypot(*reach)
    pull = -4530.0 * (length - 0.07785) / length * reach
    force = np.array(
        [
            0.033 - m2 * da * rr * v[1] * (v[1] + 2 * v[0]) * s[1],
            m2 * da * rr * v[0] ** 2 * s[1],
            arm[0] * pull[1] - arm[1] * pull[0],
            m4 * zt * near * v[4] ** 2 * c[3],
            -m4 * zt * near * v[3] * (v[3] + 2 * v[4]) * c[3],
            -m6 * u * far * v[6] ** 2 * c[5],
            m6 * u * far * v[5] * (v[5] + 2 * v[6]) * c[5],
        ]
    )
    # Each loop as a sum of unit vectors times lengths: exp(i angle), complex.
    loops = (
        (((0,), rr), ((0, 1), -d), ((2,), ss * 1j), -(-0.03635 + 0.03273j)),
        (((0,), rr), ((0, 1), -d), ((3, 4), e * 1j), ((4,), -zt), -(-0.06934 - 0.00227j)),
        (((0,), rr), ((0, 1), -d), ((5, 6), -zf), ((6,), u * 1j), -(-0.06934 - 0.00227j)),
    )
    gap, bias, J = np.zeros(6), np.zeros(6), np.zeros((6, 7))
    for k, (*terms, last) in enumerate(loops):
        parts = [(np.array(i), x * np.exp(1j * p[list(i)].sum())) for i, x in terms]
        rows = slice(2 * k, 2 * k + 2)
        total = last + sum(x for _, x in parts)
        turning = -sum(x * v[i].sum() ** 2 for i, x in parts)
        gap[rows], bias[rows] = (total.real, total.imag), (turning.real, turning.imag)
        for i, x in parts:
            J[rows, i] += np.array([[-x.imag], [x.real]])
    A = np.block([[M, J.T], [J, np.zeros((6, 6))]])
    back = 1e3
    return np.concatenate(
        [v, np.linalg.solve(A, np.concatenate([force, -bias - 2 * back * (J @ v) - back**2 * gap]))[:7]]
    )


@functools.cache
def squeezed():
    return mbstab.load("andrews_squeezer.yaml").simulate(0.03, points=4, tol=1e-12)


def test_the_squeezing_mechanism_starts_as_printed():
    sim = squeezed()
    np.testing.assert_allclose(relative(sim, sim.q[0]), START, rtol=0, atol=5e-16)
    np.testing.assert_allclose(relative(sim, sim.a[0]), GROWTH, rtol=0, atol=1e-7)


def test_the_squeezing_mechanism_ends_as_printed_to_the_digits_that_are_right():
    # Of the 16 printed digits nine to eleven are right: all methods and the next test agree on the difference.
    sim = squeezed()
    found, rates = relative(sim, sim.q[-1]), relative(sim, sim.u[-1])
    np.testing.assert_allclose(found, END, rtol=3e-10, atol=0)
    np.testing.assert_allclose(rates, SPEEDS, rtol=6e-8, atol=0)
    assert found[0] - END[0] == pytest.approx(-1.1453e-9, rel=1e-2)


def test_the_squeezing_mechanism_ends_as_the_printed_equations_say():
    exact = solve_ivp(squeezer, (0.0, 0.03), [*START, *[0.0] * 7], method="DOP853", rtol=1e-13, atol=1e-13).y[:, -1]
    sim = squeezed()
    np.testing.assert_allclose(relative(sim, sim.q[-1]), exact[:7], rtol=0, atol=3e-11)
    np.testing.assert_allclose(relative(sim, sim.u[-1]), exact[7:], rtol=0, atol=1e-11 * abs(SPEEDS[1]))
    assert sim.energy_drift < 1e-11


def flyball(times):
    """Return slider, angle of the rods and spin of the flyball governor: two coordinates, angular momentum kept."""
    bar, slide, ball, stiffness, damping, g = 0.3, 3.0, 5.0, 8e5, 4e4, 9.81
    mass = bar + ball
    c = (0.5 * bar + ball) / mass
    across = bar * (1.0 + 1e-4) / 12.0 + bar * ball / mass * 0.25
    along = bar * 1e-4 / 6.0
    rest = bar * 1e-4 / 6.0 + slide * 0.01 / 6.0

    def inertia(a):
        return rest + 2.0 * (
            mass * (0.05 + c * math.cos(a)) ** 2 + across * math.cos(a) ** 2 + along * math.sin(a) ** 2
        )

    def slope(a):
        sides = -2.0 * mass * (0.05 + c * math.cos(a)) * c * math.sin(a)
        return 2.0 * (sides + 2.0 * (along - across) * math.sin(a) * math.cos(a))

    momentum = 2.0 * math.pi * inertia(math.pi / 6)

    def rates(_, y):
        s, a, ds, da = y
        x, z = 0.5 * math.cos(a), 1.0 - s - 0.5 * math.sin(a)
        length = math.hypot(x, z)
        by_s, by_a = -z / length, (-0.5 * x * math.sin(a) - 0.5 * z * math.cos(a)) / length
        force = stiffness * (length - 0.5) + damping * (by_s * ds + by_a * da)
        spin = momentum / inertia(a)
        falling = -2.0 * force * by_s / slide - g
        turning = 0.5 * spin**2 * slope(a) + 2.0 * mass * g * c * math.cos(a) - 2.0 * force * by_a
        return [ds, da, falling, turning / (2.0 * (across + mass * c * c))]

    start = [0.5, math.pi / 6, 0.0, 0.0]
    found = solve_ivp(rates, (0.0, times[-1]), start, method="Radau", t_eval=times, rtol=1e-10, atol=1e-12).y
    return found[0], found[1], momentum / np.array([inertia(a) for a in found[1]])


def test_the_stiff_flyball_governor_moves_as_two_coordinates_say():
    sim = mbstab.load("flyball_governor.yaml").simulate(1.0, points=11, tol=1e-6, method="radau")
    slider, angle, spin = flyball(sim.times)
    assert np.max(np.abs(sim.q[:, sim.names.index("slider.z")] - slider)) <= 1e-7
    assert np.max(np.abs(sim.rotations[:, sim.bodies.index("right_rod"), 2, 0] + np.sin(angle))) <= 1e-7
    assert np.max(np.abs(sim.spins[:, 0, 2] - spin)) <= 1e-6
    assert np.ptp(slider) > 0.2
    assert sim.warnings == ()


HINGES = np.array([[0, 1, 0], [0, 0, 1], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float)
EDGES = np.array([[1, 0, 0], [0, -1, 0], [0, 0, 1], [-1, 0, 0], [0, 1, 0]], dtype=float)


def bricard(angle):
    """Return the mass and the potential energy over the first hinge angle, and where the ends of the rods are.

    By symmetry the hinges turn alternately by a and b from the cube; the loop closes where sin a + sin b +
    sin a sin b = 0. Complex angles give derivatives by their imaginary part.
    """
    other = np.arcsin(-np.sin(angle) / (1.0 + np.sin(angle)))
    ratio = -np.cos(angle) / (1.0 + np.sin(angle)) ** 2 / np.cos(other)
    turned, end, spin, speed = np.eye(3), np.zeros(3), np.zeros(3), np.zeros(3)
    mass, potential, ends = 0.0, 0.0, []
    for k, (axis, edge) in enumerate(zip(HINGES, EDGES, strict=True)):
        turn, rate = ((angle, 1.0), (other, ratio))[k % 2]
        spin = spin + rate * (turned @ axis)
        cross = np.cross(np.eye(3), axis)
        turned = turned @ (np.eye(3) + np.sin(turn) * cross + (1.0 - np.cos(turn)) * cross @ cross)
        rod = turned @ edge
        half = speed + np.cross(spin, 0.5 * rod)
        along, across = 0.02 / 12.0, 1.01 / 12.0
        mass += half @ half + across * (spin @ spin) + (along - across) * (spin @ rod) ** 2
        potential += 9.81 * (end + 0.5 * rod)[1]
        end, speed = end + rod, speed + np.cross(spin, rod)
        ends.append(end)
    return mass, potential, ends


def test_bricards_mechanism_falls_from_the_cube_as_one_coordinate_says():
    # IFToMM benchmark A04, published as a curve of P3 over 10 s: at rest in the cube at first. The base rotations of
    # the example are singular there.
    path = mbstab.load("bricard.yaml").model.document.name
    with open(path, encoding="utf-8") as stream:
        text = re.sub(r"    axes: .*\n", "", stream.read().partition("reference:")[0])
    places = np.cumsum(EDGES, axis=0) - 0.5 * EDGES
    reference = {
        f"rod_{k + 1}": dict(zip("xyz", x.tolist(), strict=True)) | {"phi": 0, "theta": 0, "psi": 0}
        for k, x in enumerate(places)
    }
    text += f"reference: {json.dumps({'coordinates': reference, 'rates': {'rod_1': {'theta': 0}}})}\n"
    sim = mbstab.loads(text).simulate(10.0, points=41, tol=1e-8)

    def rates(_, y):
        mass, potential, _ = bricard(y[0] + 1e-30j)
        slope = 1e30 * (0.5 * mass.imag * y[1] ** 2 + potential.imag)
        return [y[1], -slope / mass.real]

    assert bricard(0.7)[2][-1] == pytest.approx([0.0, 0.0, 1.0], abs=1e-15)
    exact = solve_ivp(rates, (0.0, 10.0), [0.0, 0.0], method="DOP853", t_eval=sim.times, rtol=1e-12, atol=1e-12).y
    body = sim.bodies.index("rod_3")
    found = sim.positions[:, body] + 0.5 * sim.rotations[:, body, :, 2]
    assert found == pytest.approx(np.array([bricard(a)[2][2] for a in exact[0]]), abs=3e-8)
    assert np.max(exact[0]) > 3.1
    assert sim.energy_drift < 1e-8
    (said,) = sim.warnings
    assert "redundant" in said
