"""Simulations against published motions, and against equations of motion that are written down independently.

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
from chains import four_bar_loops
from click.testing import CliRunner
from mechanisms import FREE_DISK
from PIL import Image
from sampling import sample
from scipy.integrate import solve_ivp

import mbstab
from mbstab.cli import main
from mbstab.errors import ConstraintError
from mbstab.report.animation.frames import motion_frames
from mbstab.report.animation.sketch import Sketch
from mbstab.report.animation.stage import Stage

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


@pytest.mark.long
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


@pytest.mark.long
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


# --- the Watt governor as its source judges it ------------------------------------------------------------------------
# Pappalardo, Lettieri, Guida (2020), section 5.5: the shaft starts at rest in the static equilibrium, follows the cubic
# law of Eq. (153) and then turns with omega; after 30 s the angle of the cranks is read off, and the motion found
# there is linearized.


PRINTED = {10: (5.566, -0.2720 + 12.762j), 20: (5.885, -0.3273 + 17.721j), 30: (6.050, -0.3417 + 23.037j)}
TRUE = {
    10: -0.271958656303631506 + 12.182367622566508j,
    20: -0.327287364122660392 + 17.2575443686642488j,
    30: -0.341688077058614566 + 22.7731617257270104j,
}
RUN_UP_START, RUN_UP_END = 1.0, 30.0

# At rest where the static equilibrium is; the law of the drive has ended when the reference begins.
AT_REST = """\
  time: 0
  coordinates: {shaft: {psi: 0}, right_crank: {psi: 5*pi/3}}
  rates: {shaft: {psi: 0}, right_crank: {psi: 0}}
"""


def run_up(coordinates=None):
    """Return the governor with the law (153), its steady motion sought near given coordinates, by name."""
    with open(mbstab.load("governor_paper.yaml").model.document.name, encoding="utf-8") as stream:
        text = stream.read()
    text = text.partition("sweep:")[0]
    text = text.replace("velocity: omega", f"velocity: omega*smooth_start(t/{RUN_UP_START})")
    text = text.replace("  find: steady\n", f"  find: steady\n  time: {RUN_UP_END}\n")
    for name, value in (coordinates or {}).items():
        body, key = name.split(".")
        text = re.sub(rf"(?m)^(    {body}: {{.*\b{key}: )[^,}}]*", lambda m, v=value: f"{m[1]}{v!r}", text)
    return mbstab.loads(text + "initial:\n" + AT_REST)


@functools.cache
def simulated(omega):
    return run_up().simulate(RUN_UP_END, tol=1e-7, points=121, once=True, omega=omega)


def angle(sim):
    return sim.q[:, sim.names.index("right_crank.psi")]


@pytest.mark.long
@pytest.mark.parametrize("omega", sample(PRINTED, 3))
def test_the_motion_starts_in_the_static_equilibrium_and_the_shaft_follows_the_law(omega):
    sim = simulated(omega)
    rest = mbstab.load("governor_paper.yaml").motion(omega=0)
    assert sim.q[0] == pytest.approx(rest.q, abs=1e-12)
    assert sim.u[0] == pytest.approx(np.zeros(36), abs=1e-12)
    assert sim.warnings == ()
    shaft = sim.names.index("shaft.psi")
    tau = np.minimum(sim.times / RUN_UP_START, 1.0)
    assert sim.u[:, shaft] == pytest.approx(omega * (3.0 * tau**2 - 2.0 * tau**3), abs=1e-9 * omega)
    assert sim.q[-1, shaft] == pytest.approx(omega * (RUN_UP_END - RUN_UP_START / 2.0), rel=1e-9)
    assert sim.max_constraint_residual <= 1e-12
    assert sim.energy_drift <= 1e-6


@pytest.mark.long
@pytest.mark.parametrize("omega", sample(PRINTED, 3))
def test_the_motion_ends_at_the_printed_angle(omega):
    sim = simulated(omega)
    decay = math.exp(TRUE[omega].real * (RUN_UP_END - RUN_UP_START))
    swing = np.ptp(angle(sim)[sim.times <= 5.0])
    assert angle(sim)[-1] == pytest.approx(PRINTED[omega][0], abs=swing * decay + 5.1e-4)
    # Printed is the angle that is left when the swing has decayed: the mean over whole swings is nearer.
    late = sim.times >= RUN_UP_END - 10.0
    assert np.mean(angle(sim)[late]) == pytest.approx(PRINTED[omega][0], abs=1e-3)


@pytest.mark.long
@pytest.mark.parametrize("omega", sample(PRINTED, 3))
def test_the_end_of_the_motion_is_linearized(omega):
    sim = simulated(omega)
    end = sim.end_state["coordinates"]
    turned = end["shaft.psi"]
    model = run_up({"shaft.psi": turned} | {name: x for name, x in end.items() if not name.startswith("shaft.")})
    motion = model.motion(omega=omega)
    steady = motion.q[sim.names.index("right_crank.psi")]
    assert abs(steady - angle(sim)[-1]) <= 2e-3
    assert steady == pytest.approx(PRINTED[omega][0], abs=6e-4)
    values = [e.value for e in model.eig(omega=omega).eigenvalues if e.kind != "neutral" and e.value.imag > 0.0]
    assert values == [pytest.approx(TRUE[omega], rel=1e-9)]
    assert model.eig(omega=omega).verdict == "asymptotically stable up to symmetry"  # the shaft may stand anywhere
    # The printed eigenvalues are those of the equations frozen at an instant of the turn.
    frozen = [e.value for e in model.eig(frozen=True, omega=omega).eigenvalues if e.kind != "neutral"]
    nearest = min(frozen, key=lambda s: abs(s - PRINTED[omega][1]))
    assert abs(nearest - PRINTED[omega][1]) <= 1e-3


# --- N four-bar loops side by side (IFToMM benchmark A02) -------------------------------------------------------------
# Long mechanisms of one degree of freedom, and one in singular configurations. Gonzalez, Dopico, Gonzalez, Cuadrado
# (2006), A benchmarking system for MBS simulation software.


LOOPS = (1, 2, 10, 40)
# As printed from the closed form with more digits than a double has.
DIGITS = {1: 3.43103482931899, 2: 3.38304596480745, 10: 3.33556226291102, 40: 3.32552242194847}


def omega(loops):
    # Cranks about their ends, couplers that move with the pins and do not turn.
    return math.sqrt(9.81 * ((loops + 1) / 2 + loops) / ((loops + 1) / 3 + loops))


@functools.cache
def answer(loops, angle, solved=False):
    return mbstab.loads(four_bar_loops(loops, angle, solved)).eig()


def assert_pair(result, expected):
    """The two eigenvalues are ±expected, within their error bounds and to twelve digits."""
    found = sorted(result.values(), key=lambda s: (s / expected).real)
    np.testing.assert_allclose(found, [-expected, expected], rtol=1e-12)
    for e in result.eigenvalues:
        assert min(abs(e.value - expected), abs(e.value + expected)) <= e.error_bound < 1e-11


@pytest.mark.parametrize("loops", LOOPS)
def test_the_closed_form_has_the_digits_of_the_literature(loops):
    assert omega(loops) == pytest.approx(DIGITS[loops], rel=1e-14)


@pytest.mark.parametrize("solved", [False, True], ids=["given", "assembled"])
@pytest.mark.parametrize("loops", LOOPS)
def test_hanging_loops_swing_with_the_frequency_of_the_closed_form(loops, solved):
    result = answer(loops, "-pi/2", solved)
    assert_pair(result, 1j * omega(loops))
    assert result.verdict == "stable"
    assert (result.counts.expected, result.counts.found, result.counts.neutral) == (2, 2, 0)


@pytest.mark.parametrize("solved", [False, True], ids=["given", "assembled"])
@pytest.mark.parametrize("loops", LOOPS)
def test_upright_loops_fall_with_the_same_rate(loops, solved):
    result = answer(loops, "pi/2", solved)
    assert_pair(result, omega(loops))
    assert result.verdict == "unstable"


@pytest.mark.parametrize("loops", LOOPS)
def test_loops_have_one_degree_of_freedom_and_no_redundant_row(loops):
    report = mbstab.loads(four_bar_loops(loops, "-pi/2")).check()
    assert report.redundant == []
    counts = answer(loops, "-pi/2").counts
    assert (counts.n_q, counts.n_holonomic, counts.rank_holonomic) == (6 * loops + 3, 6 * loops + 2, 6 * loops + 2)


@pytest.mark.parametrize("gravity", ["[0, -9.81]", "[0, 0]"], ids=["heavy", "weightless"])
@pytest.mark.parametrize("angle", ["0", "pi"], ids=["right", "left"])
@pytest.mark.parametrize("loops", LOOPS)
def test_flat_loops_are_refused_and_their_joints_named(loops, angle, gravity):
    # The cranks lie in one line with the couplers: each loop may fold in two ways, and the rank drops by one a loop.
    # pi is no round number: the rank is decided in spite of the rounding of its sine.
    text = re.sub(r'"gravity": \[[^]]*\]', f'"gravity": {gravity}', four_bar_loops(loops, angle))
    with pytest.raises(ConstraintError, match="singular configuration") as caught:
        mbstab.loads(text).eig()
    named = set(re.findall(r"joint '(\w+)'", str(caught.value)))
    assert named
    assert named <= set(mbstab.loads(text).model.entries["joints"])


# --- equations from other coordinates, integrated by SciPy ------------------------------------------------------------


RADIUS, MASS, GRAVITY = 0.3, 2.0, 9.81

DISK = (
    FREE_DISK
    + """\
initial:
  coordinates: {disk: {x: 0.1, y: -0.2, phi: pi/2 - LEAN, theta: 0.3, psi: 0.7}}
  rates: {disk: {phi: 0.4, theta: 0.9, psi: SPIN}}
"""
)

CRANE = """\
mbstab: 1
gravity: [0, -9.81]
parameters: {L: {value: 0.4, unit: m}}
bodies:
  cart: {type: planar, mass: 3, inertia: 0.1}
  rod: {type: planar, mass: 2, shape: {type: rod, length: 2*L}, points: {O: [-L, 0]}}
joints:
  rail: {type: prismatic, between: [ground, cart], axis: x}
  pivot: {type: revolute, between: [rod.O, cart]}
drives: {motor: {type: coordinate, coordinate: cart.x, position: LAW}}
reference:
  time: START
  coordinates: {rod: {theta: -pi/2}, cart: {y: 0, theta: 0}}
  guess: {rod: {y: -L}}
initial:
  coordinates: {rod: {theta: -pi/2 + 0.5}}
  rates: {rod: {theta: -1}}
"""


def frame(axis):
    """Return the axes along the contact line and up the disk for its axle, and how far the axle is from upright."""
    tilt = math.acos(axis[2])
    up = (np.array([0.0, 0.0, 1.0]) - math.cos(tilt) * axis) / math.sin(tilt)
    return np.cross(up, axis), up, tilt


def rolling(t, y):
    """Return the rates of a thin disk that rolls, its spin in the axes of `frame` (Routh, Advanced Part, art. 244).

    Of Newton's law the reaction is R = m(a + g z); Euler's equations have its moment about the centre, −r e2 × R, and
    a follows from v = r(−w3 e1 + w1 e3).
    """
    tilt, heading, _, _, w1, w2, w3 = y
    A, C = 0.25 * MASS * (RADIUS**2 + 0.05**2 / 3.0), 0.5 * MASS * RADIUS**2
    rim, turn = MASS * RADIUS**2, w2 / math.tan(tilt)
    e1 = np.array([math.cos(heading), math.sin(heading)])
    e3 = math.sin(tilt) * np.array([math.sin(heading), -math.cos(heading)])
    return [
        w1,
        w2 / math.sin(tilt),
        *(RADIUS * (w1 * e3 - w3 * e1)),
        (A * turn * w2 - (C + rim) * w2 * w3 - MASS * GRAVITY * RADIUS * math.cos(tilt)) / (A + rim),
        (C * w1 * w3 - A * turn * w1) / A,
        rim * w1 * w2 / (C + rim),
    ]


@pytest.mark.parametrize(
    ("lean", "spin", "end"),
    # A disk that runs fast and sways, and one that runs slowly and leans far over.
    [(0.3, 8.0, 3.0), (0.7, 3.0, 0.8)],
)
@pytest.mark.parametrize("options", sample([{}, {"method": "radau", "tol": 1e-6}], 2), ids=["projection", "radau"])
def test_a_disk_off_symmetry_rolls_as_its_own_equations_say(lean, spin, end, options):
    text = DISK.replace("LEAN", str(lean)).replace("SPIN", str(spin))
    sim = mbstab.loads(text).simulate(end, points=61, **{"tol": 1e-8, **options})
    assert sim.warnings == ()
    axle, spins = sim.rotations[:, 0, :, 2], sim.spins[:, 0]
    e1, e2, tilt = frame(axle[0])
    start = [tilt, math.atan2(e1[1], e1[0]), *sim.positions[0, 0, :2], *(np.array([e1, e2, axle[0]]) @ spins[0])]
    assert abs(math.cos(tilt)) > 0.2
    exact = solve_ivp(rolling, (0.0, end), start, "DOP853", sim.times, rtol=1e-12, atol=1e-13)
    assert exact.success
    allowed = 3.0 * options.get("tol", 1e-8)
    tilt, heading, x, y, *w = exact.y
    place = np.stack([x, y, RADIUS * np.sin(tilt)], axis=1)
    np.testing.assert_allclose(sim.positions[:, 0], place, rtol=0.0, atol=allowed * RADIUS)
    along = np.stack([np.cos(heading), np.sin(heading), np.zeros_like(tilt)], axis=1)
    axis = np.stack([np.sin(tilt) * np.sin(heading), -np.sin(tilt) * np.cos(heading), np.cos(tilt)], axis=1)
    np.testing.assert_allclose(axle, axis, rtol=0.0, atol=allowed)
    spun = w[0][:, None] * along + w[1][:, None] * np.cross(axis, along) + w[2][:, None] * axis
    np.testing.assert_allclose(spins, spun, rtol=0.0, atol=allowed * np.max(np.abs(spun)))
    # It does something worth comparing.
    assert np.ptp(tilt) > 0.2
    assert np.ptp(heading) > 0.5


@pytest.mark.parametrize(
    ("law", "start", "acceleration"),
    [
        ("0.2*sin(7*t) - 0.1*t", 0.3, lambda t: -0.2 * 49.0 * np.sin(7.0 * t)),
        ("0.5*t**3 - 0.3*t**2", 0.0, lambda t: 3.0 * t - 0.6),
        # A smooth start within the time: 3 s² − 2 s³ has the second derivative 6 − 12 s.
        (
            "0.3*smooth_start((t - 0.5)/0.8)",
            0.0,
            lambda t: np.where((t > 0.5) & (t < 1.3), 0.3 * (6.0 - 12.0 * (t - 0.5) / 0.8) / 0.64, 0.0),
        ),
    ],
    ids=["wave", "cubic", "smooth start"],
)
def test_what_a_drive_moves_by_a_law_of_time_follows_its_own_equation(law, start, acceleration):
    text = CRANE.replace("LAW", law).replace("START", str(start))
    mechanism = mbstab.loads(text)
    end = start + 2.0
    sim = mechanism.simulate(end, points=81, tol=1e-8)
    assert sim.warnings == ()
    L, m = 0.4, 2.0

    def swinging(t, y):
        # About the pivot, in which the acceleration of the cart acts as a field: I θ'' = −m L (g sin θ + a cos θ).
        return [y[1], -m * L * (GRAVITY * math.sin(y[0]) + acceleration(t) * math.cos(y[0])) / (m * (2.0 * L) ** 2 / 3)]

    # Steps end where the law has a kink in its acceleration.
    exact, y = [], [0.5, -1.0]
    for low, high in ((start, start + 0.5), (start + 0.5, start + 1.3), (start + 1.3, end)):
        inside = sim.times[(sim.times >= low) & (sim.times < high if high < end else sim.times <= end + 1e-9)]
        sides = low + 1e-12, high - 1e-12
        part = solve_ivp(
            lambda t, y, sides=sides: swinging(min(max(t, sides[0]), sides[1]), y),
            (low, high), y, "DOP853", [*inside, high] if inside[-1] < high else inside, rtol=1e-12, atol=1e-13,
        )  # fmt: skip
        exact.append(part.y[:, : len(inside)])
        y = part.y[:, -1]
    angle, rate = np.concatenate(exact, axis=1)
    number = {name: i for i, name in enumerate(sim.names)}
    np.testing.assert_allclose(sim.q[:, number["rod.theta"]] + 0.5 * math.pi, angle, rtol=0.0, atol=3e-8)
    np.testing.assert_allclose(sim.u[:, number["rod.theta"]], rate, rtol=0.0, atol=3e-8 * np.max(np.abs(rate)))
    # The motor accelerates the cart and the middle of the rod; times at a kink belong to either side.
    a = acceleration(sim.times)
    growth = np.array([swinging(t, y)[1] for t, y in zip(sim.times, np.stack([angle, rate], axis=1), strict=True)])
    force = 3.0 * a + m * (a + L * (growth * np.cos(angle) - rate**2 * np.sin(angle)))
    column = sim.load_names.index(("drive 'motor'", "cart", "force x"))
    smooth = ~np.isclose(sim.times, 0.5) & ~np.isclose(sim.times, 1.3) if "smooth" in law else np.full(81, True)
    np.testing.assert_allclose(sim.loads[smooth, column], force[smooth], rtol=0.0, atol=1e-6 * np.max(np.abs(force)))
    assert sim.energy_drift < 1e-7


# --- what is followed in a picture ----------------------------------------------------------------------------------


def test_in_a_film_the_followed_body_stays_in_its_place(tmp_path):
    spread = {}
    for name, options in (("still", ()), ("followed", ("--follow", "disk"))):
        path = tmp_path / f"{name}.gif"
        arguments = ("simulate", "rolling_disk.yaml", "--to", "1", "--tol", "1e-4", "--once", "--animate", str(path))
        result = CliRunner().invoke(main, [*arguments, "--fps", "10", "--view", "0,-90", *options])
        assert result.exit_code == 0
        middles = []
        with Image.open(path) as film:
            for k in range(film.n_frames):
                film.seek(k)
                grey = np.asarray(film.convert("L"), dtype=int)[60:-60, 40:-40]
                # The fill of the disk is the only grey that covers a whole area.
                columns = np.flatnonzero(np.count_nonzero(np.abs(grey - 237) < 6, axis=0) > 15)
                middles.append(0.5 * (columns[0] + columns[-1]))
        spread[name] = np.ptp(middles)
    assert len(middles) == 11
    assert spread["followed"] <= 1.5
    assert spread["still"] > 100.0


def test_the_ground_moves_back_by_as_much_as_the_followed_body_goes():
    model = mbstab.load("rolling_disk.yaml")
    sim = model.simulate(1.0, points=51, perturb={"disk.phi": 0.2}, tol=1e-5)
    stage = Stage(Sketch.of(model.system()), motion_frames(sim, 25.0), follow="disk", view=(90.0, -90.0))
    np.testing.assert_allclose(np.abs(stage.view.across[:2]), [[1, 0, 0], [0, 1, 0]], atol=1e-12)
    offsets = {}
    for k in (0, 7, 25):
        stage.show(k)
        lines = np.array(stage.ground.get_segments())
        for i in (0, 1):
            across = lines[np.ptp(lines[:, :, i], axis=1) < 1e-9][:, 0, i]
            moved = sim.positions[2 * k, 0, i] - sim.positions[0, 0, i]
            # The lines of a grid that is fixed to the ground are at whole multiples of its step.
            rest = (across + moved * stage.view.across[i, i]) / np.diff(np.sort(across))[0]
            offset = offsets.setdefault(i, rest[0])
            np.testing.assert_allclose(rest - offset, np.round(rest - offset), atol=1e-6)
    assert np.ptp(sim.positions[:, 0, :2], axis=0).max() > 1.0
