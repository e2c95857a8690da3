"""Written potential energies and dissipation functions."""

import numpy as np
import pytest
from mpmath import mp
from mpmath_numbers import mpmath_arithmetic

import mbstab
from mbstab.compiler.system import System
from mbstab.errors import ModelFileError
from mbstab.model.values import evaluate

PLANAR = """\
mbstab: 1
gravity: [0, -9.81]
parameters: {{k: 50, c: 0.3, L: 0.7}}
bodies:
  a: {{type: planar, mass: 1.3, inertia: 0.1, points: {{t: [0.5, 0.1], o: [-0.5, 0]}}}}
  b: {{type: planar_point, mass: 0.7}}
joints:
  pin: {{type: revolute, between: [ground, a.o]}}
forces:
{}
reference:
  find: equilibrium
  guess: {{a: {{x: 0, y: -0.5, theta: -pi/2}}, b: {{x: 0.05, y: -1.8}}}}
"""
SPATIAL = """\
mbstab: 1
gravity: [0, 0, -9.81]
parameters: {{k: 50, c: 0.3, L: 0.7}}
bodies:
  a: {{type: spatial, mass: 1.3, inertia: [0.2, 0.1, 0.15], points: {{t: [0.1, 0.5, 0.1], o: [0, -0.5, 0]}}}}
  b: {{type: point, mass: 0.7}}
joints:
  pin: {{type: revolute, between: [ground, a.o], axis: x}}
forces:
{}
reference:
  find: equilibrium
  guess: {{a: {{x: 0, y: 0, z: -0.5, phi: -pi/2, theta: 0, psi: 0}}, b: {{x: 0.05, y: 0.1, z: -1.8}}}}
"""


def written(scene, **forces):
    """Return a scene with forces, by name."""
    return mbstab.loads(scene.format("\n".join(f"  {name}: {{{x}}}" for name, x in forces.items())))


def same(one, other):
    """Check that two answers are the same."""
    assert (one.verdict, one.judged.reasons) == (other.verdict, other.judged.reasons)
    left, right = (sorted(x.values(), key=lambda s: (round(s.imag, 6), s.real)) for x in (one, other))
    assert np.allclose(left, right, rtol=0.0, atol=1e-14 * max(map(abs, left)))


@pytest.mark.parametrize("scene", [PLANAR, SPATIAL])
def test_a_written_energy_is_a_spring(scene):
    spring = written(
        scene, s="type: spring, between: [a.t, b], stiffness: k, length: L",
        j="type: joint_spring, joint: pin, stiffness: 3, rest: 0.2",
    )  # fmt: skip
    energy = written(
        scene, s='type: potential, energy: "k*(distance(a.t, b) - L)**2/2"',
        j="type: potential, energy: 3*(angle(pin) - 0.2)**2/2",
    )  # fmt: skip
    same(spring.eig(), energy.eig())
    same(spring.eig(k=70), energy.eig(k=70))
    for one, other in zip(spring.energies().shares, energy.energies().shares, strict=True):
        assert one.potential == pytest.approx(other.potential, rel=1e-12)
        assert other.power == 0.0
    assert spring.eig_precise(30).verdict == energy.eig_precise(30).verdict


@pytest.mark.parametrize("scene", [PLANAR, SPATIAL])
def test_a_written_function_is_a_damper(scene):
    damped = written(scene, s="type: spring, between: [a.t, b], stiffness: k, length: L, damping: c")
    function = written(
        scene, s='type: potential, energy: "k*(distance(a.t, b) - L)**2/2"',
        d='type: dissipation, function: "c*rate(distance(a.t, b))**2/2"',
    )  # fmt: skip
    same(damped.eig(), function.eig())


def test_a_written_weight_is_gravity():
    text = PLANAR.replace("-9.81", "0")
    spring = "type: spring, between: [a.t, b], stiffness: k, length: L"
    lifted = written(text, s=spring, g="type: potential, energy: 9.81*(1.3*a.y + 0.7*b.y)")
    same(written(PLANAR, s=spring).eig(), lifted.eig())


@pytest.mark.parametrize(("linear", "cubic"), [(40.0, 3.0), (2.0, -5.0), (-1.0, 60.0)])
def test_a_duffing_law_is_that_of_its_force(linear, cubic):
    """Its potential decides as the force does, also where the linear part pushes away."""
    text = (
        "mbstab: 1\nbodies: {{a: {{type: planar_point, mass: 2}}}}\nconstraints: {{y: {{holonomic: a.y}}}}\n"
        "forces:\n{}\nreference: {{coordinates: {{a: {{x: 0, y: 0}}}}}}\n"
    )
    energy = written(text, f=f"type: potential, energy: {linear!r}*a.x**2/2 + {cubic!r}*a.x**4/4").eig()
    force = written(text, f=f"type: expression, on: {{a.x: -({linear!r})*a.x - ({cubic!r})*a.x**3}}").eig()
    same(energy, force)
    assert energy.verdict == ("stable" if linear > 0.0 else "unstable")


def test_an_oscillator_has_its_closed_form():
    text = (
        "mbstab: 1\nbodies: {{a: {{type: planar_point, mass: 2}}}}\nconstraints: {{y: {{holonomic: a.y}}}}\n"
        "forces:\n{}\nreference: {{coordinates: {{a: {{x: 0, y: 0}}}}}}\n"
    )
    spring, damper = "type: potential, energy: 40*a.x**2/2", "type: dissipation, function: 3*rate(a.x)**2/2"
    found = written(text, f=spring, d=damper).eig().values()
    assert sorted(found, key=lambda s: s.imag) == pytest.approx(
        [-0.75 - x * 1j * np.sqrt(20 - 0.75**2) for x in (1, -1)]
    )


TERMS = (
    "exp(-x(a.t)**2)", "sin(angle(pin))*b.x", 'log(1 + distance(a.t, b)**2)', "cos(a.theta)*y(a.t)**3",
    "sqrt(1 + b.x**2 + b.y**2)", "tanh(angle(pin) - b.y)", "distance(a.o, b)**3",
)  # fmt: skip


@pytest.mark.parametrize("seed", range(30))
@pytest.mark.parametrize("scene", [PLANAR, SPATIAL])
def test_forces_are_the_slopes_of_the_energy(scene, seed):
    """Against differences of V with 60 digits, at states off the rows; stiffnesses are symmetric."""
    rng = np.random.default_rng(seed)
    terms = rng.choice(TERMS, 3, replace=False)
    energy = " + ".join(f"{rng.uniform(-2, 2):.3f}*{x}" for x in terms)
    model = written(scene, s=f'type: potential, energy: "{energy}"').model
    with mp.workdps(60):
        system = System(evaluate(model, {}, mpmath_arithmetic()))
        part = dict(system.parts())["forces.s"]
        q, zero, step = (
            rng.uniform(-1, 1, system.n_q).astype(object) + mp.zero,
            [mp.zero] * system.n_q,
            mp.mpf(10) ** -20,
        )
        V = next(x for x in part.acting() if x.path == "forces.s").placed
        own = [q[i] for i in V.columns]
        f = mpmath_arithmetic()
        for k, i in enumerate(V.columns):
            there, back = (
                V.kernel.potential(f, [x + sign * step * (j == k) for j, x in enumerate(own)], V.parameters)[0]
                for sign in (1, -1)
            )
            slope = (there - back) / (2 * step)
            assert abs(part.dynamics(q, zero).F0[i] - slope) < mp.mpf(10) ** -30
        K = part.linearize(q, zero, zero, [mp.zero] * system.n_c)[0]
        assert max(abs(x) for x in (K - K.T).flat) < mp.mpf(10) ** -50


@pytest.mark.parametrize(
    ("function", "verdict"),
    [
        ("c*(rate(a.theta)**2 + rate(b.x)**2 + rate(b.y)**2)", "asymptotically stable"),
        ("c*(1 + a.theta**2)*rate(a.theta)**4", "stable"),
        ("-c*rate(a.theta)**4", "undecided"),
        ("-c*vx(a.t)**2", "unstable"),
        ("-c*rate(a.theta)**2", "unstable"),
    ],
)
def test_what_a_function_takes_or_gives(function, verdict):
    energy = 'type: potential, energy: "k*(distance(a.t, b) - L)**2/2"'
    found = written(PLANAR, s=energy, d=f'type: dissipation, function: "{function}"').eig()
    assert found.verdict == verdict


def test_a_simulation_keeps_the_energy():
    scene = written(PLANAR, s='type: potential, energy: "k*(distance(a.t, b) - L)**2/2"')
    found = scene.simulate(2.0, perturb={"b.x": 0.1})
    assert found.conservative
    assert np.ptp(found.kinetic + found.potential) < 1e-7 * np.ptp(found.potential)


@pytest.mark.parametrize(
    ("force", "message"),
    [
        ("type: potential, energy: t*b.x", "depends on the time"),
        ("type: potential, energy: b.x*rate(b.x)", r"depends on a speed \(b.x\)"),
        ("type: potential, energy: b.y*vx(a.t)", r"depends on a speed \(vx\(a.t\)\)"),
        ("type: potential, energy: abs(b.x)**3", "has pieces"),
        ("type: potential, energy: k", "contains no coordinate"),
        ("type: dissipation, function: b.x**2", "contains no rate"),
        ("type: dissipation, function: t*rate(b.x)**2", "depends on the time"),
    ],
)
def test_what_is_no_energy_is_refused(force, message):
    with pytest.raises(ModelFileError, match=message) as caught:
        written(PLANAR, s=force)
    assert ":10:" in str(caught.value)
