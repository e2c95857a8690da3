"""Bodies of next to no mass, and of very large mass: light ones between heavy ones carry their inertia."""

import random

import numpy as np
import pytest
from elimination import eliminated
from light_vehicles import light_vehicle
from mpmath import mp
from scipy.integrate import solve_ivp
from scipy.optimize import linear_sum_assignment
from test_massless import close

import mbstab
from mbstab.analysis.simulate.constrained import Constrained
from mbstab.analysis.simulate.start import start_of
from mbstab.errors import MassError

LIGHT_LINK = """\
mbstab: 1
gravity: [0, -9.81]
parameters: {m: 1}
bodies:
  one: {type: planar, mass: 1, inertia: 0.1}
  link: {type: planar, mass: m, inertia: m}
  two: {type: planar, mass: 2, inertia: 0.3}
joints:
  O: {type: revolute, between: [{body: one, point: [0, 1]}, ground]}
  A: {type: revolute, between: [{body: one, point: [0, -1]}, {body: link, point: [0, 0.5]}]}
  B: {type: revolute, between: [{body: link, point: [0, -0.5]}, {body: two, point: [0, 1]}]}
reference:
  coordinates: {one: {theta: 0}, link: {theta: 0}, two: {theta: 0}}
  guess: {one: {y: -1}, link: {y: -2.5}, two: {y: -4}}
"""
LIGHT_BOB = """\
mbstab: 1
gravity: [0, -9.81]
parameters: {m: 1}
bodies:
  cart: {type: planar, mass: 1, inertia: 0.1}
  bob: {type: planar_point, mass: m}
  rod: {type: planar, mass: 0, inertia: 0}
joints:
  rail: {type: prismatic, between: [cart, ground], axis: x}
  A: {type: revolute, between: [{body: rod, point: [0, 1]}, cart]}
  B: {type: revolute, between: [rod, bob]}
forces:
  spring: {type: bushing, between: [cart, ground], stiffness: [50, 0]}
reference:
  coordinates: {cart: {x: 0, y: 0, theta: 0}, rod: {theta: 0}}
  guess: {bob: {y: -1}, rod: {y: -1}}
"""
MASSES = [1e-8, 1e-14, 1e-17, 1e-18, 1e-22, 1e-30]


def frequencies(mass, stiffness):
    """Return √λ of λ M x = K x, M and K as matrices of numbers of mpmath."""
    squares = mp.eig(mp.matrix(mass) ** -1 * mp.matrix(stiffness), left=False, right=False)
    return sorted(mp.sqrt(mp.re(x)) for x in squares)


def light_link(m):
    """Return the frequencies of three pendulums, one below the other, from the angles to the vertical."""
    arms, masses, inertias = ((1, 0, 0), (2, mp.mpf(1) / 2, 0), (2, 1, 1)), (1, m, 2), (0.1, m, 0.3)
    parts = [(x, [mp.mpf(y) for y in arm]) for x, arm in zip(masses, arms, strict=True)]
    mass = [[sum(x * arm[i] * arm[j] for x, arm in parts) for j in range(3)] for i in range(3)]
    stiffness = [[0, 0, 0] for _ in range(3)]
    for i in range(3):
        mass[i][i] += mp.mpf(inertias[i])
        stiffness[i][i] = mp.mpf(9.81) * sum(x * arm[i] for x, arm in parts)
    return frequencies(mass, stiffness)


def light_bob(m):
    """Return the frequencies of a cart on a spring that carries a pendulum of 1 m."""
    return frequencies([[1 + m, m], [m, m]], [[50, 0], [0, m * mp.mpf(9.81)]])


@pytest.mark.parametrize("m", MASSES)
@pytest.mark.parametrize(("text", "truth"), [(LIGHT_LINK, light_link), (LIGHT_BOB, light_bob)])
def test_bodies_of_next_to_no_mass_are_answered(text, truth, m):
    """What joints tie to heavy bodies on both sides carries their inertia, what swings from one its own."""
    with mp.workdps(80):
        expected = truth(mp.mpf(m))
        model = mbstab.loads(text)
        found = model.eig(m=m)
        assert (found.verdict, found.warnings, found.counts.massless) == ("stable", (), ())
        upper = sorted((e for e in found.eigenvalues if e.value.imag > 0.0), key=lambda e: e.value.imag)
        assert len(upper) == len(expected)
        for one, omega in zip(upper, expected, strict=True):
            error = abs(mp.mpc(one.value) - 1j * omega)
            assert error <= one.error_bound
            assert one.error_bound < 1e-11 * omega
    swept = model.sweep("m", np.array([m, 2.0 * m]))
    assert not swept.problems
    assert close(swept.branches[0], [s * 1j * float(x) for x in expected for s in (1, -1)], 1e-12)


def test_a_light_link_tends_to_one_without_mass():
    light = mbstab.loads(LIGHT_LINK)
    assert close(light.eig(m=1e-30).values(), light.eig(m=0).values(), 1e-14)


def three_pendulums(m, start, end):
    """Return the angles to the vertical of the light link and its neighbours after some time, from a turn of one."""
    arms, masses, inertias = np.array([[1, 0, 0], [2, 0.5, 0], [2, 1, 1]]), np.array([1, m, 2]), np.array([0.1, m, 0.3])

    def slope(t, y):
        angle, rate = y[:3], y[3:]
        share = np.einsum("k,ki,kj->ij", masses, arms, arms)
        turn = angle[:, None] - angle
        force = (share * np.sin(turn)) @ rate**2 + 9.81 * (masses @ arms) * np.sin(angle)
        return np.concatenate([rate, np.linalg.solve(share * np.cos(turn) + np.diag(inertias), -force)])

    return solve_ivp(slope, (0.0, end), [*start, 0.0, 0.0, 0.0], method="DOP853", rtol=1e-12, atol=1e-12).y[:3, -1]


@pytest.mark.few(1)
@pytest.mark.parametrize("method", ["projection", "radau"])
@pytest.mark.parametrize("m", [1e-6, 1e-9, 1e-12, 1e-15, 1e-30])
def test_a_light_link_costs_a_simulation_neither_steps_nor_digits(m, method):
    mechanism, angles = mbstab.loads(LIGHT_LINK), ["one.theta", "link.theta", "two.theta"]
    heavy = mechanism.simulate(1.0, perturb={"two.theta": 0.5}, method=method, m=1e-3)
    found = mechanism.simulate(1.0, perturb={"two.theta": 0.5}, method=method, m=m)
    turned = found.q[:, [found.names.index(name) for name in angles]]
    assert turned[-1] == pytest.approx(three_pendulums(m, turned[0], 1.0), abs=3e-8)
    assert found.steps < 1.1 * heavy.steps


@pytest.mark.parametrize("m", [1e-3, 1e-9, 1e-15])
def test_accelerations_of_light_links_are_right_to_the_last_digits(m):
    """Against the index-1 equations with the same matrices in 60 digits."""
    start = start_of(mbstab.loads(LIGHT_LINK).system(m=m), {"two.theta": 0.5, "rate(link.theta)": 1.0})
    equations = Constrained(start.system, start.motion)
    a, _, at = equations.accelerations(0.0, start.motion.q, start.motion.u)
    with mp.workdps(60):
        A = mp.matrix(np.block([[at.M, at.J.T], [at.J, np.zeros((len(at.J), len(at.J)))]]).tolist())
        exact = mp.lu_solve(A, mp.matrix([*(-at.F0).tolist(), *(-at.B).tolist()]))
        assert a == pytest.approx([float(x) for x in exact[: len(a)]], rel=1e-13, abs=1e-14)


# --- very large masses ----------------------------------------------------------------------------------------------


def squeezer(m):
    """Return the eigenvalues of `andrews_squeezer`, from its slope of the torque and its inertia over the crank angle.

    The rod of mass m moves its centre of mass with √1.775e-5 m per rad. From the loop equations in 60 digits.
    """
    stiffness, others, rod = "0.531462893058115108678", "2.26210110560813951022e-6", "1.77541412673622053764e-5"
    s = mp.sqrt(mp.mpf(stiffness) / (mp.mpf(others) + m * mp.mpf(rod)))
    return [s, -s]


def slider(m):
    """Return the eigenvalues of `slider_crank`: stretched, the slider stands still to first order."""
    r, c, k = mp.mpf("0.1"), mp.mpf("0.02"), 3
    inertia = mp.mpf("1.3") * r**2 / 3
    s = -c / (2 * inertia) + 1j * mp.sqrt(k / inertia - (c / (2 * inertia)) ** 2)
    return [s, mp.conj(s)]


def bead(m):
    """Return the eigenvalues of `bead_on_hoop` at the bottom."""
    s = 1j * mp.sqrt(mp.mpf("9.81") / mp.mpf("0.5") - 16)
    return [s, -s]


@pytest.mark.parametrize("exponent", [10, 14, 16, 18, 20, 22, 26, 30])
@pytest.mark.parametrize(
    ("name", "parameter", "truth", "verdict"),
    [
        ("andrews_squeezer", "m2", squeezer, "unstable"),
        ("slider_crank", "m_s", slider, "asymptotically stable"),
        ("bead_on_hoop", "m", bead, "stable up to symmetry"),
    ],
)
def test_masses_so_large_that_all_others_are_light(name, parameter, truth, verdict, exponent):
    m = 10.0**exponent
    with mp.workdps(60):
        found = mbstab.load(f"{name}.yaml").eig(**{parameter: m})
        assert found.verdict == verdict
        assert len(found.eigenvalues) - found.counts.neutral == 2
        for s in truth(mp.mpf(m)):
            one = min(found.eigenvalues, key=lambda e: abs(mp.mpc(e.value) - s))
            assert abs(mp.mpc(one.value) - s) <= one.error_bound <= 1e-13 * abs(s)


# --- trees ----------------------------------------------------------------------------------------------------------


REFUSED = (11, 12, 52)
"""Trees with inertias 23 to 62 decades apart, of which double precision cannot tell which carry none."""


def tree(seed):
    """Return a tree of planar bodies with springs in its joints, and its frequencies with 160 digits.

    Masses lie up to 60 decades apart; some bodies have no inertia, or no mass at all. Places are tenths of a meter.
    """
    r = random.Random(seed)
    n, style = r.randint(2, 5), r.choice(["all", "one", "two", "massless", "massless_light"])
    span, pick = r.choice([6, 12, 16, 20, 24, 30]), r.randrange(n)
    empty = {r.randrange(n)} - {pick} if style.startswith("massless") else set()
    parent, arm, com, mass, inertia, stiffness, place = [], [], [], [], [], [], []
    for i in range(n):
        parent.append(r.randrange(-1, i) if r.random() < 0.3 else i - 1)
        arm.append((r.randint(1, 20), r.randint(-20, 20)))
        com.append((r.randint(1, 20), r.randint(-20, 20)))
        base = place[parent[i]] if parent[i] >= 0 else (0, 0)
        place.append(tuple(sum(x) for x in zip(base, arm[i], com[i], strict=True)))
        far = {"all": r.uniform(-span, span), "two": r.choice([-span, 0, span]), "massless": 0.0}
        if i == pick:
            far |= {"one": r.choice([-span, span]), "massless_light": -span}
        mass.append(0.0 if i in empty else float(f"{10 ** (far.get(style, 0.0) + r.uniform(-1, 1)):.3e}"))
        inertia.append(mass[i] * r.choice([0.0, 0.1, 0.01]))
        stiffness.append(r.randint(1, 1000))
    return tree_text(parent, arm, com, mass, inertia, stiffness, place), tree_frequencies(
        parent, arm, com, mass, inertia, stiffness
    )


def tree_text(parent, arm, com, mass, inertia, stiffness, place):
    bodies, joints, forces, reference = [], [], [], []
    for i, p in enumerate(parent):
        other = f"b{p}" if p >= 0 else "ground"
        start, end = [-x / 10 for x in com[i]], [x / 10 for x in arm[i]]
        bodies.append(f"  b{i}: {{type: planar, mass: {mass[i]!r}, inertia: {inertia[i]!r}}}\n")
        joints.append(
            f"  j{i}: {{type: revolute, between: [{{body: b{i}, point: {start}}}, {{body: {other}, point: {end}}}]}}\n"
        )
        forces.append(f"  s{i}: {{type: joint_spring, joint: j{i}, stiffness: {stiffness[i]}}}\n")
        reference.append(f"    b{i}: {{x: {place[i][0] / 10}, y: {place[i][1] / 10}, theta: 0}}\n")
    parts = ("bodies:\n", *bodies, "joints:\n", *joints, "forces:\n", *forces)
    return "".join(("mbstab: 1\n", *parts, "reference:\n  coordinates:\n", *reference))


def tree_frequencies(parent, arm, com, mass, inertia, stiffness):
    """Return 1/√μ of μ K x = M x in the angles of the bodies, those with μ = 0 left out."""
    n = len(parent)
    with mp.workdps(160):
        M, K = mp.zeros(n), mp.zeros(n)
        for i in range(n):
            # What turns a body moves its centre of mass and all that hangs on it.
            lever, j, below = {i: [mp.mpf(x) / 10 for x in com[i]]}, parent[i], i
            while j >= 0:
                lever[j] = [mp.mpf(x + y) / 10 for x, y in zip(com[j], arm[below], strict=True)]
                j, below = parent[j], j
            for a, x in lever.items():
                for b, y in lever.items():
                    M[a, b] += mp.mpf(mass[i]) * (x[0] * y[0] + x[1] * y[1])
            M[i, i] += mp.mpf(inertia[i])
            for a, b, sign in ((i, i, 1), (parent[i], parent[i], 1), (i, parent[i], -1), (parent[i], i, -1)):
                if a >= 0 and b >= 0:
                    K[a, b] += sign * stiffness[i]
        inverse = mp.cholesky(K) ** -1
        values = mp.eigsy(inverse * M * inverse.T, eigvals_only=True)
        return sorted(1 / mp.sqrt(x) for x in values if x > mp.mpf(10) ** -120 * max(values))


@pytest.mark.parametrize("seed", [*range(60), 78, 162, 684, 914])
def test_trees_of_light_and_heavy_bodies(seed):
    """Every eigenvalue is found, within its bound; inertias that leave no digits are refused by name."""
    text, expected = tree(seed)
    if seed in REFUSED:
        with pytest.raises(MassError, match="the inertias are too far apart for double precision"):
            mbstab.loads(text).eig()
        return
    found = mbstab.loads(text).eig()
    assert found.verdict in ("stable", "marginally stable", "undecided")
    # All springs hold: no motion has a negative energy.
    assert "negative energy" not in "".join(found.warnings)
    with mp.workdps(60):
        left = list(found.eigenvalues)
        for omega in expected:
            for s in (1j * omega, -1j * omega):
                one = min(left, key=lambda e: abs(mp.mpc(e.value) - s) / e.error_bound)
                assert abs(mp.mpc(one.value) - s) <= one.error_bound
                left.remove(one)
    assert not left


# --- beside nonholonomic rows ---------------------------------------------------------------------------------------


@pytest.mark.few(9)
@pytest.mark.parametrize("seed", range(120))
def test_light_bodies_beside_nonholonomic_rows_are_within_their_bounds(seed):
    """Against elimination with 90 digits; bounds are no wider than the rounding of the data asks for."""
    model = mbstab.loads(light_vehicle(seed))
    expected, neutral = eliminated(model.model, 1e-30, 90, {})
    result = model.eig()
    found = [e for e in result.eigenvalues if e.kind != "neutral"]
    assert (len(found), result.counts.neutral) == (len(expected), neutral)
    with mp.workdps(60):
        errors = np.array([[float(abs(mp.mpc(e.value) - s)) for s in expected] for e in found])
        for i, j in zip(*linear_sum_assignment(np.log(errors + 1e-300)), strict=True):
            assert errors[i, j] <= found[i].error_bound < 1e-8 * abs(found[i].value)
