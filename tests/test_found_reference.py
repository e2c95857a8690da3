"""Equilibria and steady motions that are found: to rounding, with an error that the eigenvalues include."""

import math

import mpmath
import pytest
from mpmath import mp

import mbstab
from mbstab.model.library import installed_models

MODELS = {path.stem: path for path in installed_models()}
G = 9.81

PARALLELOGRAM = """
mbstab: 1
parameters: {a: 0.25, d: 0.3, ma: 0.6, mc: 0.4, k: 60, angle: 1e-5, r: angle - (ma + mc)*9.81*a*cos(angle)/k}
gravity: [0, -9.81]
ground: {points: {L: [0, 0], R: [d, 0]}}
bodies:
  c1: {type: planar, mass: ma, shape: {type: rod, length: a}, points: {o: [-a/2, 0], e: [a/2, 0]}}
  c2: {type: planar, mass: ma, shape: {type: rod, length: a}, points: {o: [-a/2, 0], e: [a/2, 0]}}
  co: {type: planar, mass: mc, shape: {type: rod, length: d}, points: {o: [-d/2, 0], e: [d/2, 0]}}
joints:
  m1: {type: revolute, between: [c1.o, ground.L]}
  m2: {type: revolute, between: [c2.o, ground.R]}
  e1: {type: revolute, between: [co.o, c1.e]}
  e2: {type: revolute, between: [co.e, c2.e]}
forces:
  pd1: {type: joint_spring, joint: m1, stiffness: k, rest: -r}
reference: {find: equilibrium, guess: {c1: {theta: angle}, c2: {theta: angle}}}
"""


@pytest.mark.parametrize("angle", [1e-2, -1e-3, 1e-4, -3e-5, 1e-5])
def test_beside_a_change_point_the_bound_holds_the_frequency(angle):
    # Levers that stay parallel are a pendulum with a torsion spring; the rest of the spring makes `angle` its rest.
    text = PARALLELOGRAM.replace("rest: -r", "rest: 2*angle - r")
    (first, _) = mbstab.loads(text).eig(angle=angle).eigenvalues
    k, a, ma, mc = 60.0, 0.25, 0.6, 0.4
    exact = math.sqrt((k - (ma + mc) * a * G * math.sin(angle)) / (2.0 * ma * a**2 / 3.0 + mc * a**2))
    assert abs(first.value.imag - exact) <= first.error_bound < 1e-5


def test_digits_are_gained_beside_a_change_point():
    text = PARALLELOGRAM.replace("rest: -r", "rest: 2*angle - r")
    (first, _) = mbstab.loads(text).eig_precise(20).eigenvalues
    assert first.imag.startswith("34.6410090716")


SAG = """
mbstab: 1
parameters: {n: {value: 100, unit: rad/s}, ka: {value: 1e8, unit: N/m}, s: 1, g: 9.81}
gravity: [0, -g, 0]
bodies:
  hub: {type: spatial, mass: 3, inertia: [0.02, 0.02, 0.03], points: {R: [0, 0, 0.2]}}
  disc: {type: spatial, mass: 16, inertia: [0.25, 0.25, 0.45], points: {L: [0, 0, -0.2]}}
joints: {thrust: {type: point_on_plane, between: [ground, hub], axis: z}}
drives: {hold: {type: coordinate, coordinate: hub.psi, position: n*t}}
forces:
  shaft:
    type: bushing
    between: [disc.L, hub.R]
    stiffness: [1.5e6*s, 1.5e6*s, ka*s]
    damping: [300, 300, 1000]
    torsional_stiffness: [2e4*s, 2e4*s, 1e5*s]
    torsional_damping: [4, 4, 1]
  mount: {type: bushing, between: [hub, ground], stiffness: [1e6*s, 2e6*s, 0], damping: [300, 300, 0]}
  tilt: {type: expression, on: {hub.phi: -5e4*s*hub.phi, hub.theta: -5e4*s*hub.theta}}
reference:
  find: steady
  steady: {axis: z, rate: 0}
  guess: {disc: {z: 0.4}}
  rates: {hub: {psi: n}, disc: {psi: n}}
"""


@pytest.mark.parametrize("s", [1.0, 1e3, 1e6])
@pytest.mark.parametrize("g", [0.0, G])
def test_no_sagging_shaft_is_refused_for_rounding(s, g):
    model = mbstab.loads(SAG)
    (found,) = model.equilibria(s=s, g=g)
    place = dict(zip(model.model.coordinates(), found.motion.q, strict=True))
    # Weight bends a cantilever of two bushings and of a mount at its end: deflections add up, to first order.
    hub = 19.0 * g / (2e6 * s)
    tilt = 16.0 * g * 0.4 / (5e4 * s)
    bent = 16.0 * g * 0.2 / (2e4 * s)
    exact = -(hub + 0.4 * tilt + 16.0 * g / (1.5e6 * s) + 0.2 * bent)
    assert place["hub.y"] == pytest.approx(-hub, rel=1e-2, abs=1e-18)
    assert place["disc.y"] == pytest.approx(exact, rel=1e-2, abs=1e-18)
    assert found.isolated


def test_every_command_says_that_an_equilibrium_is_not_isolated():
    text = """
mbstab: 1
bodies: {b: {type: planar_point, mass: 1}}
joints: {line: {type: point_on_line, between: [ground, b], axis: x}}
forces: {quartic: {type: expression, on: {b.x: -b.x**3}}}
reference: {find: equilibrium, guess: {b: {x: 0}}}
"""
    said = "the equilibrium is not isolated to first order: a critical position along b.x"
    assert said in mbstab.loads(text).eig().warnings


CIRCLE = """
reference:
  find: steady
  steady: {axis: z}
  coordinates: {rear_body: {phi: 10*deg, psi: 0}, rear_wheel: {psi: 0}, front_wheel: {psi: 0}}
  guess:
    rear_wheel: {y: 20, z: 0.3, phi: 10*deg}
    rear_body: {y: 20, z: 0.9}
    front_body: {x: 0.6, y: 20, z: 0.7, phi: 10*deg, psi: -0.05}
    front_wheel: {x: 0.7, y: 20, z: 0.35, phi: 10*deg, psi: -0.05}
"""


def test_a_steady_circle_of_a_bicycle_is_isolated():
    whole = MODELS["whipple_bicycle"].read_text(encoding="utf-8")
    text = whole[: whole.index("\nreference:")] + CIRCLE
    (found,) = mbstab.loads(text).equilibria()
    assert found.isolated  # its lean is given: the family of other leans has been left
    assert {"translation along x", "rotation about z"} <= set(found.symmetries)


@pytest.mark.few(2)
@pytest.mark.parametrize("stiffer", [1.0, 1e4, 1e6])
def test_a_triple_solution_at_the_end_of_a_curved_valley_is_found_with_its_error(stiffer):
    """Without gravity the rods of the governor turn level, the slider at the height of their pivots.

    The springs hold the slider with the cube of its displacement only: two eigenvalues are 0. The rods swing like
    pendulums in the field of centrifugal forces. The guess is 0.3 rad away, in a valley whose walls are the springs.
    """
    model, omega = mbstab.load("flyball_governor.yaml"), 2.0 * math.pi
    bar, ball, arm, edge = 0.3, 5.0, 0.05, 0.01
    first, second = bar / 2.0 + ball, bar * (1.0 / 3.0 + edge**2 / 12.0) + ball
    swing = omega * ((arm * first + second - bar * edge**2 / 6.0) / second) ** 0.5
    found = model.eig(K=8e5 * stiffer, g=0)
    rates = [(e.value, e.error_bound) for e in found.eigenvalues if e.kind != "neutral"]
    assert len(rates) == 6
    for value, error in rates:
        assert min(abs(value - exact) for exact in (0.0, 1j * swing, -1j * swing)) <= error + 1e-12
    assert sum(abs(value) <= error for value, error in rates) == 2
    assert max(error for value, error in rates if abs(value) > 1.0) < 1e-3


BUCKLING = """
mbstab: 1
parameters: {m: 1.3, l: 0.7, k: STIFFNESS, r: REST}
gravity: [0, -9.81]
bodies: {b: {type: planar, mass: m, inertia: 0.02, points: {o: [0, -l]}}}
joints: {j: {type: revolute, between: [b.o, ground]}}
forces: {s: {type: joint_spring, joint: j, stiffness: k, rest: r, damping: 0.3}}
reference: {find: equilibrium, guess: {b: {theta: START, y: 0.7}}}
"""


@mpmath.workdps(60)
@pytest.mark.parametrize("beyond", ["-1e-2", "-1e-6", "-1e-10", "1e-14", "1e-8", "1e-3"])
@pytest.mark.parametrize("rest", ["0", "1e-6", "1e-12", "1e-15"])
def test_beside_buckling_nothing_is_refused_and_bounds_hold(beyond, rest):
    """An inverted pendulum on a spring that is as stiff as its weight, but for a part `beyond`, and nearly straight.

    No force acts along x but what the joint transmits: an imbalance there is that along the angle, or rounding.
    """
    mass, length = mp.mpf("1.3"), mp.mpf("0.7")
    weight, inertia = mass * mp.mpf("9.81") * length, mass * length**2 + mp.mpf("0.02")
    text = mp.nstr(weight * (1 + mp.mpf(beyond)), 30)
    k, r, start = mp.mpf(text), mp.mpf(rest), "0.01" if rest == "0" and beyond[0] != "-" else "0.3"
    found = mbstab.loads(BUCKLING.replace("STIFFNESS", text).replace("REST", rest).replace("START", start)).eig()
    size = mp.sqrt(max(-6 * mp.mpf(beyond), mp.mpf(0)))
    values = sorted(found.eigenvalues, key=lambda e: (-e.value.real, e.value.imag))
    held = []
    for near in (size + mp.cbrt(6 * r), mp.mpf("1e-20"), -size, mp.mpf("0.3")):
        angle = mp.findroot(lambda x: k * (x - r) - weight * mp.sin(x), near, tol=1e-100, maxsteps=300, verify=False)
        if abs(k * (angle - r) - weight * mp.sin(angle)) > 1e-50:
            continue
        exact = mp.polyroots([inertia, mp.mpf("0.3"), k - weight * mp.cos(angle)], maxsteps=500, extraprec=200)
        exact.sort(key=lambda s: (-s.real, s.imag))
        held.append(all(abs(mp.mpc(e.value) - s) <= e.error_bound for e, s in zip(values, exact, strict=True)))
    assert any(held)


ARM = """
mbstab: 1
gravity: [0, 0, -9.81]
parameters: {spin: {value: SPIN, unit: rad/s}, off: OFF}
bodies:
  hub: {type: spatial, mass: 3, inertia: [1, 1, 2], points: {p: [off, 0, 0]}}
  arm: {type: spatial, mass: 1.2, inertia: [0.064, 0.064, 0.008], points: {o: [0, 0, 0.4]}}
joints:
  b: {type: revolute, between: [hub, ground], axis: z}
  h: {type: revolute, between: [arm.o, hub.p], axis: y}
drives: {d: {type: coordinate, coordinate: hub.psi, velocity: spin}}
forces: {s: {type: joint_spring, joint: h, damping: 0.05}}
reference:
  find: steady
  steady: {axis: z, rate: spin}
  coordinates: {hub: {psi: 0}}
  guess: {arm: {x: off, z: -0.4, theta: START}}
"""


@mpmath.workdps(60)
@pytest.mark.parametrize("off", ["1e-9", "0", "1e-4"])
@pytest.mark.parametrize("beyond", ["1e-6", "-1e-8", "0", "1e-3"])
@pytest.mark.parametrize("start", ["0.15", "-0.2"])
def test_beside_the_spin_that_lifts_an_arm_a_small_residual_is_no_solution(beyond, off, start):
    """A pendulum on a hub lifts where centrifugal forces exceed its weight; its joint is beside the axis by a little.

    On one side the residuals have a small minimum without a solution, and the search must go on to the other side.
    """
    mass, length, across, along = (mp.mpf(x) for x in ("1.2", "0.4", "0.064", "0.008"))
    weight, arm, off_axis = mass * mp.mpf("9.81") * length, across + mass * length**2, mp.mpf(off)
    text = mp.nstr(mp.sqrt(weight / (arm - along)) * (1 + mp.mpf(beyond)), 30)
    square = mp.mpf(text) ** 2

    def slope(t):
        spread = (across - along) * mp.sin(t) * mp.cos(t) - mass * length * mp.cos(t) * (off_axis - length * mp.sin(t))
        return weight * mp.sin(t) - square * spread

    found = mbstab.loads(ARM.replace("SPIN", text).replace("OFF", off).replace("START", start)).eig()
    values = sorted((e for e in found.eigenvalues if e.kind != "neutral"), key=lambda e: (-e.value.real, e.value.imag))
    size, third, held = 2 * mp.sqrt(max(mp.mpf(beyond), mp.mpf(0))), mp.cbrt(3 * off_axis), []
    for near in (mp.mpf(start), size, -size, -third, third, mp.mpf("-1e-12")):
        angle = mp.findroot(slope, near, tol=1e-100, maxsteps=300, verify=False)
        if abs(slope(angle)) > 1e-45:
            continue
        exact = mp.polyroots([arm, mp.mpf("0.05"), mp.diff(slope, angle)], maxsteps=500, extraprec=300)
        exact.sort(key=lambda s: (-s.real, s.imag))
        held.append(all(abs(mp.mpc(e.value) - s) <= e.error_bound for e, s in zip(values, exact, strict=True)))
    assert any(held)
