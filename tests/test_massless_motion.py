"""Nonlinear motions with bodies without mass that springs and dampers determine."""

from __future__ import annotations

import numpy as np
import pytest
from mpmath import mp
from test_massless import LEVER, line

import mbstab
from mbstab.errors import MassError, NumericalError

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


def test_directions_that_constraints_see_are_refused_in_simulations():
    text = LEVER.replace("AT", "0.5").replace("D}", "0}")
    with pytest.raises(MassError, match=r"bodies\.lever: the motion of lever\..* constraints tie these") as caught:
        mbstab.loads(text).simulate(to=1.0, perturb={"b.y": 0.01})
    assert "whose reference point lies on the joint" in str(caught.value)


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
