"""Bodies of next to no mass: those between heavy ones carry their inertia, others swing with their own."""

import numpy as np
import pytest
from mpmath import mp
from test_massless import close

import mbstab

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
