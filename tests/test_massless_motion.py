"""Nonlinear motions with bodies without mass that springs and dampers determine."""

from __future__ import annotations

import numpy as np
import pytest
from mpmath import mp
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import fsolve
from test_massless import LEVER, line

import mbstab
from mbstab.errors import NumericalError

METHODS = {"projection": 1e-8, "radau": 1e-6, "alpha": 1e-4}
"""Tolerances for methods; alpha is of order 2."""

ZENER = [1.0, 0.0], [(0, -1, 100, 0), (0, 1, 400, 0), (1, -1, 0, 10)]


def zener(times, x, force):
    """Return place and force in the damper of m ẍ + k x + F = 0, Ḟ = k_m ẋ − (k_m/c) F, from rest, to 30 digits."""
    with mp.workdps(30):
        A = mp.matrix([[0, 1, 0], [-100, 0, -1], [0, 400, -40]])
        found = [mp.expm(A * mp.mpf(float(t))) * mp.matrix([x, 0, force]) for t in times]
        return np.array([[float(y[0]), float(y[2])] for y in found]).T


@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"solver": "RK45"},
        {"solver": "Radau"},
        {"solver": "BDF"},
        {"method": "radau"},
        {"method": "alpha", "tol": 1e-4},
    ],
)
def test_a_spring_and_a_damper_in_series(settings):
    tol = settings.get("tol", 1e-7)
    run = line(*ZENER).simulate(to=1.0, points=6, perturb={"n0.x": 0.1}, **({"tol": tol} | settings))
    i, j = (run.names.index(x) for x in ("n0.x", "n1.x"))
    assert run.q[0, [i, j]] == pytest.approx([0.1, 0.0], abs=1e-15)  # the damper holds its end at first
    place, force = zener(run.times, 0.1, 40.0)
    assert run.q[:, i] == pytest.approx(place, abs=tol)
    assert 400.0 * (run.q[:, i] - run.q[:, j]) == pytest.approx(force, abs=400.0 * tol)
    assert 10.0 * run.u[:, j] == pytest.approx(force, abs=1000.0 * tol)


def test_the_end_of_a_damper_starts_where_it_is_put():
    run = line(*ZENER).simulate(to=0.5, points=3, perturb={"n1.x": 0.05}, tol=1e-7)
    place, _ = zener(run.times, 0.0, -20.0)
    assert run.q[:, run.names.index("n0.x")] == pytest.approx(place, abs=1e-7)


def test_the_damper_takes_the_energy():
    text = """\
mbstab: 1
bodies: {m: {type: planar_point, mass: 1}, n: {type: planar_point, mass: 0}}
constraints: {r: {holonomic: m.y}, s: {holonomic: n.y}}
forces:
  base: {type: expression, on: {m.x: -100*m.x}}
  spring: {type: expression, on: {m.x: 400*(n.x - m.x), n.x: 400*(m.x - n.x)}}
  damper: {type: expression, on: {n.x: -10*rate(n.x)}}
"""
    run = mbstab.loads(text).simulate(to=1.0, points=6, perturb={"m.x": 0.1}, tol=1e-8)
    m, n = (run.q[:, run.names.index(x)] for x in ("m.x", "n.x"))
    # Springs that are written as expressions have no potential: all is work.
    stored = 50.0 * m**2 + 200.0 * (m - n) ** 2
    assert run.kinetic == pytest.approx(run.work, abs=1e-7)
    assert np.all(np.diff(run.kinetic + stored) < 0.0)


def test_springs_in_series_on_both_sides_of_a_damper():
    """As one spring of 100·300/400 = 75 N/m in series with the damper: balances of sums of coordinates."""
    system = line([1.0, 0.0, 0.0], [(0, 1, 100, 0), (1, 2, 0, 10), (2, -1, 300, 0)])
    run = system.simulate(to=1.0, points=5, perturb={"n0.x": 0.1}, tol=1e-7)
    force = 100.0 * float(run.q[0, run.names.index("n0.x")] - run.q[0, run.names.index("n1.x")])
    with mp.workdps(30):
        A = mp.matrix([[0, 1, 0], [0, 0, -1], [0, 75, -7.5]])
        expected = [(mp.expm(A * mp.mpf(float(t))) * mp.matrix([0.1, 0, force]))[0] for t in run.times]
    assert run.q[:, run.names.index("n0.x")] == pytest.approx([float(x) for x in expected], abs=1e-7)


PENDULUM = """\
mbstab: 1
gravity: [0, -9.81]
bodies:
  bob: {type: planar_point, mass: 2}
  node: {type: planar_point, mass: 0}
forces:
  top: {type: spring, between: [node, ground], stiffness: 300, length: 0.5}
  low: {type: spring, between: [bob, node], stiffness: 200, length: 0.5}
reference: {find: equilibrium, guess: {bob: {y: -1.2}, node: {y: -0.6}}}
"""
SWUNG = {
    1.0: [-0.262942603387734120220019134752, -1.12283519061611939422093750892],
    2.0: [0.218561936024567667192047921778, -1.08583294437432616925347351061],
}
"""x and y of the bob on one spring of 120 N/m and 1 m from (0.3, −1 − 2·9.81/120), by Taylor series of 34 digits."""


def test_a_pendulum_on_two_springs_in_series():
    run = mbstab.loads(PENDULUM).simulate(to=2.0, points=3, perturb={"bob.x": 0.3}, tol=1e-8)
    bob, node = (run.q[:, run.names.index(f"{name}.x") :][:, :2] for name in ("bob", "node"))
    for t, place in SWUNG.items():
        assert bob[run.times == t][0] == pytest.approx(place, abs=1e-7)
    # The node stays on the line, where both springs pull equally.
    upper, lower = np.linalg.norm(node, axis=1), np.linalg.norm(bob - node, axis=1)
    assert upper + lower == pytest.approx(np.linalg.norm(bob, axis=1), abs=1e-12)
    assert 300.0 * (upper - 0.5) == pytest.approx(200.0 * (lower - 0.5), abs=1e-9)


def test_a_damper_that_begins_to_act_is_refused():
    system = mbstab.loads("""\
mbstab: 1
bodies: {m: {type: planar_point, mass: 1}, n: {type: planar_point, mass: 0}}
constraints: {r: {holonomic: m.y}, s: {holonomic: n.y}}
forces:
  one: {type: expression, on: {m.x: 100*(n.x - m.x), n.x: 100*(m.x - n.x) - 300*n.x - 500*m.x**2*rate(n.x)}}
""")
    assert system.eig().counts.massless
    with pytest.raises(
        NumericalError, match=r"forces along n\.x, which carries no mass, are out of balance at t = 0\."
    ):
        system.simulate(to=1.0, perturb={"m.x": 0.1})


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("damping", ["0", "20"])
def test_a_lever_moves_alike_whatever_point_describes_it(damping, method):
    """About its hinge a lever is an angle alone; elsewhere constraints tie three coordinates without mass."""
    runs = []
    for at in ("0", "-3"):
        lever = mbstab.loads(LEVER.replace("AT", at).replace("D}", f"{damping}}}"))
        run = lever.simulate(to=0.5, points=5, perturb={"b.y": 0.3}, tol=METHODS[method], method=method)
        runs.append(run.q[:, [run.names.index("b.y"), run.names.index("lever.theta")]])
    assert np.max(np.abs(runs[1] - runs[0])) < 100.0 * METHODS[method]


def test_a_lever_in_space_moves_like_one_in_the_plane():
    run = mbstab.loads(LEVER.replace("AT", "0.5").replace("D}", "20}")).simulate(1.0, points=3, perturb={"b.y": 0.3})
    there = mbstab.loads(SPATIAL_LEVER).simulate(1.0, points=3, perturb={"b.z": 0.3})
    assert there.q[:, there.names.index("b.z")] == pytest.approx(run.q[:, run.names.index("b.y")], abs=1e-6)


SPATIAL_LEVER = """\
mbstab: 1
gravity: [0, 0, -9.81]
bodies:
  lever: {type: spatial, mass: 0, inertia: [0, 0, 0],
    points: {pin: [0.5, 0, 0.2], end: [2.5, 0, 0.2], mid: [1.5, 0, 0.2]}}
  b: {type: point, mass: 2}
joints: {pin: {type: revolute, between: [lever.pin, ground], axis: y}}
constraints: {rail: {holonomic: b.x - 2}, side: {holonomic: b.y}}
forces:
  hanger: {type: spring, between: [b, lever.end], stiffness: 100, length: 0.5}
  stay: {type: spring, between: [lever.mid, {body: ground, point: [1, 0, -3]}], stiffness: 300, length: 3, damping: 20}
reference: {find: equilibrium, coordinates: {b: {x: 2, y: 0}}, guess: {b: {z: -0.6}, lever: {x: -0.5, z: -0.2}}}
"""


SLIDER = """\
mbstab: 1
parameters: {K: 40, C: 3, k: 10}
bodies:
  m: {type: planar_point, mass: 1}
  node: {type: planar, mass: 0, inertia: 0, points: {p: [0.3, -0.1]}}
joints: {rail: {type: prismatic, between: [node.p, {body: ground, point: [0.3, -0.1]}], axis: [0.6, 0.8]}}
constraints: {line: {holonomic: 4*m.x - 3*m.y}}
forces:
  spring: {type: expression, on: {m.x: K*(node.x - m.x), m.y: K*(node.y - m.y), node.x: K*(m.x - node.x),
    node.y: K*(m.y - node.y)}}
  damper: {type: joint_spring, joint: rail, damping: C}
  own: {type: expression, on: {m.x: -k*m.x, m.y: -k*m.y}}
"""


@pytest.mark.parametrize("method", METHODS)
def test_a_slider_without_mass_between_a_spring_and_a_damper(method):
    """Along the rail: m ẍ = −K (x − n) − k x, C ṅ = K (x − n)."""
    run = mbstab.loads(SLIDER).simulate(1.0, points=5, perturb={"m.x": 0.3}, tol=METHODS[method], method=method)
    A = np.array([[0.0, 1.0, 0.0], [-50.0, 0.0, 40.0], [40.0 / 3.0, 0.0, -40.0 / 3.0]])
    expected = [(expm(A * t) @ [0.3, 0.0, 0.0])[0] for t in run.times]
    assert run.q[:, run.names.index("m.x")] == pytest.approx(expected, abs=30.0 * METHODS[method])


LEVERS = """\
mbstab: 1
gravity: [0, -9.81]
bodies:
  one: {type: planar, mass: 0, inertia: 0, points: {a: [-0.5, 0], b: [0.5, 0]}}
  two: {type: planar, mass: 0, inertia: 0, points: {a: [-0.5, 0], b: [0.5, 0]}}
  bob: {type: planar_point, mass: 1}
joints:
  top: {type: revolute, between: [one.a, ground]}
  mid: {type: revolute, between: [two.a, one.b]}
forces:
  first: {type: joint_spring, joint: top, stiffness: 40}
  second: {type: joint_spring, joint: mid, stiffness: 60, damping: C}
  spring: {type: spring, between: [bob, two.b], stiffness: 400, length: 0.3}
reference:
  find: equilibrium
  guess: {bob: {x: 2, y: -0.5}, one: {x: 0.5, y: 0, theta: 0}, two: {x: 1.5, y: 0, theta: 0}}
"""


def levers(damping, held=None):
    """Return the rates of the bob and of the second angle, by finding the angles that balance at every instant.

    The first angle may be held.
    """

    def forces(bob, angles):
        one, two = angles
        end = np.array([np.cos(one) + np.cos(two), np.sin(one) + np.sin(two)])
        apart = bob - end
        length = np.linalg.norm(apart)
        pull = 400.0 * (length - 0.3) * apart / length
        own = 60.0 * (two - one)
        moments = [-np.sin(x) * pull[0] + np.cos(x) * pull[1] for x in angles]
        return pull, moments[0] - 40.0 * one + own, moments[1] - own

    def rates(t, y):
        bob, speed, apart = y[:2], y[2:4], y[4]
        if held is not None:
            two = fsolve(lambda x: forces(bob, (held, x[0]))[2], [-0.5], xtol=1e-11)[0]
            angles, drift = (held, two), 0.0
        elif damping:  # the second angle relative to the first is a state
            one = fsolve(lambda x: sum(forces(bob, (x[0], x[0] + apart))[1:]), [-0.4], xtol=1e-11)[0]
            angles = one, one + apart
            drift = forces(bob, angles)[2] / damping
        else:
            angles = fsolve(lambda x: forces(bob, x)[1:], [-0.4, -0.5], xtol=1e-11)
            drift = 0.0
        return [*speed, *(-forces(bob, angles)[0] + [0.0, -9.81]), drift]

    return rates


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("damping", [0.0, 2.0])
def test_two_levers_without_mass_balance_at_every_instant(damping, method):
    run = mbstab.loads(LEVERS.replace("C}", f"{damping}}}")).simulate(
        0.5, points=6, perturb={"bob.x": -0.1, "bob.y": 0.2}, tol=METHODS[method], method=method
    )
    place = [run.names.index(x) for x in ("bob.x", "bob.y", "one.theta", "two.theta")]
    start = run.q[0, place]
    found = solve_ivp(
        levers(damping),
        (0.0, 0.5),
        [*start[:2], 0.0, 0.0, start[3] - start[2]],
        "DOP853",
        run.times,
        rtol=1e-10,
        atol=1e-12,
    )
    assert run.q[:, place[:2]] == pytest.approx(found.y[:2].T, abs=100.0 * METHODS[method])
    assert np.abs(run.u[0, place[:2]]) == pytest.approx([0.0, 0.0], abs=1e-12)


@pytest.mark.parametrize("compiled", [False, True])
def test_a_drive_holds_one_of_two_levers(compiled):
    text = LEVERS.replace("C}", "0}").replace("  first: {type: joint_spring, joint: top, stiffness: 40}\n", "")
    held = mbstab.loads(text.replace("forces:", "drives: {d: {type: joint, joint: top, position: -0.4}}\nforces:", 1))
    run = held.simulate(0.5, points=3, perturb={"bob.y": 0.1}, compiled=compiled, tol=1e-8)
    assert run.q[:, run.names.index("one.theta")] == pytest.approx(-0.4, abs=1e-12)
    place = [run.names.index(x) for x in ("bob.x", "bob.y")]
    start = [*run.q[0, place], 0.0, 0.0, 0.0]
    found = solve_ivp(levers(0.0, -0.4), (0.0, 0.5), start, "DOP853", run.times, rtol=1e-10, atol=1e-12)
    assert run.q[:, place] == pytest.approx(found.y[:2].T, abs=1e-6)


@pytest.mark.parametrize("lift", ["0", "0.2"])
def test_a_lever_in_space_has_the_frequency_of_one_in_the_plane(lift):
    """Rounding along angles that the hinge holds must not scale them."""
    found = mbstab.loads(SPATIAL_LEVER.replace("damping: 20", "damping: 0").replace("0.2]", f"{lift}]")).eig()
    assert np.sort(found.values().imag) == pytest.approx([-4.64505663185974978, 4.64505663185974978], rel=1e-12)
    assert np.max(np.abs(found.values().real)) < 1e-12


WHIRLED = """\
mbstab: 1
bodies: {p: {type: planar_point, mass: 0}, m: {type: planar_point, mass: 1}}
joints: {rod: {type: distance, between: [p, ground], length: 1}}
forces:
  a: {type: spring, between: [p, m], stiffness: 50, length: 0}
  b: {type: spring, between: [m, ground], stiffness: 50, length: 3}
reference: {coordinates: {p: {x: 1, y: 0}, m: {x: 2, y: 0}}}
"""


def test_a_point_on_a_rod_follows_all_around():
    """The rod points at the mass, at every angle: as a spring of length 1 at the pivot, of the same stiffness.

    At the reference the rod does not see y of the point: what a row contains counts, not its slopes there.
    """
    alone = WHIRLED.replace("p: {type: planar_point, mass: 0}, ", "").replace("p: {x: 1, y: 0}, ", "")
    alone = alone.replace("joints: {rod: {type: distance, between: [p, ground], length: 1}}\n", "")
    alone = alone.replace("between: [p, m], stiffness: 50, length: 0", "between: [ground, m], stiffness: 50, length: 1")
    settings = {"to": 4.0, "points": 9, "perturb": {"rate(m.y)": 4.0}, "tol": 1e-8}
    run, other = (mbstab.loads(text).simulate(**settings) for text in (WHIRLED, alone))
    place = run.q[:, [run.names.index(name) for name in ("m.x", "m.y")]]
    assert place == pytest.approx(other.q, abs=1e-6)
    assert np.unwrap(np.arctan2(*place.T[::-1]))[-1] > 2.0 * np.pi
    point = run.q[:, [run.names.index(name) for name in ("p.x", "p.y")]]
    assert np.linalg.norm(place, axis=1)[:, None] * point == pytest.approx(place, abs=1e-9)


def test_a_lever_about_its_reference_point_swings():
    """Small vibrations have the frequency that eig gives; the spring of the stay is part of the balance."""
    lever = mbstab.loads(LEVER.replace("AT", "0").replace("D}", "0}"))
    omega = max(lever.eig().values().imag)
    run = lever.simulate(to=float(2.0 * np.pi / omega), points=3, perturb={"b.y": 1e-4}, tol=1e-8)
    y = run.q[:, run.names.index("b.y")]
    assert y[0] - y[1] == pytest.approx(2e-4, abs=1e-7)
    assert y[2] == pytest.approx(y[0], abs=1e-7)


@pytest.mark.parametrize("system", [lambda: line(*ZENER), lambda: mbstab.loads(PENDULUM)], ids=["zener", "pendulum"])
def test_motions_verify_eigenvalues(system):
    found = system().verify()
    assert found.verdict == "confirmed"
    assert all(mode.error < 1e-3 for mode in found.modes)


def test_a_motion_starts_in_a_mode():
    run = line(*ZENER).simulate(to=0.2, points=3, perturb={"mode:2": 0.01}, tol=1e-8)
    i, j = (run.names.index(x) for x in ("n0.x", "n1.x"))
    values = line(*ZENER).eig().values()
    real = values[np.argmin(np.abs(values.imag))].real
    assert np.max(np.abs(run.q[0, [i, j]])) == pytest.approx(0.01, rel=1e-9)
    assert run.u[0, i] == pytest.approx(real * run.q[0, i], rel=1e-9)
    assert run.q[:, i] == pytest.approx(run.q[0, i] * np.exp(real * run.times), abs=1e-8)


HINGED = """
mbstab: 1
bodies:
  load: {type: planar, mass: 2, inertia: 1}
  lever: {type: planar, mass: 0, inertia: 0, points: {A: [X, 1], B: [0, 0.4]}}
joints:
  rail: {type: prismatic, between: [load, {body: ground, point: [0, 1]}], axis: x}
  hinge: {type: revolute, between: [lever, ground]}
forces:
  link: {type: spring, between: [lever.A, load], stiffness: 300, length: 1 - X}
  mount: {type: bearing, between: [lever.B, {body: ground, point: [0, 0.4]}], stiffness: 20, damping: C}
reference: {coordinates: {load: {x: 1, y: 1, theta: 0}, lever: {x: 0, y: 0, theta: 0}}}
"""


@pytest.mark.parametrize("x", ["0", "0.2"])
@pytest.mark.parametrize(("c", "verdict"), [(5, "asymptotically stable"), (0, "stable")])
def test_a_lever_without_mass_on_a_hinge_is_proven(x, c, verdict):
    """2 s^2 (300 + z) + 300 z = 0 with z = 0.4^2 (20 + c s), wherever the link is fixed along its line."""
    pytest.importorskip("flint")
    certificate = mbstab.loads(HINGED.replace("X", x).replace("C}", f"{c}}}")).certify()
    assert (certificate.status, certificate.verdict) == ("proven", verdict)
    h = 0.4**2
    expected = np.roots([2 * h * c, 2 * (300 + 20 * h), 300 * h * c, 300 * 20 * h][0 if c else 1 :])
    assert sum(e.count for e in certificate.eigenvalues) == len(expected)
    for s in expected:
        assert any(e.contains(s, 1e-11 * abs(s)) for e in certificate.eigenvalues), s
