"""Scenes that once were answered wrongly: drawn at another angle, stretched straight, round, or without free length."""

import math

import numpy as np
import pytest
from click.testing import CliRunner

import mbstab
import mbstab.errors
from mbstab.cli import main
from mbstab.errors import NumericalError
from mbstab.mechanics.bodies import BODY_COORDINATES

RING = """
mbstab: 1
parameters:
  a: {value: 0.4, unit: rad}
  l0: {value: 0.1, unit: m}
bodies:
  b: {type: planar_point, mass: 1}
forces:
  s: {type: spring, between: [b, ground], stiffness: 100, length: l0}
reference:
  coordinates: {b: {x: l0*cos(a), y: l0*sin(a)}}
"""


@pytest.mark.parametrize("a", [0.0, 0.1, 0.4, 0.5, 0.6435, math.pi / 4, 1.0, 2.0, 3.0])
def test_an_unloaded_spring_is_judged_the_same_at_every_angle(a):
    result = mbstab.loads(RING).eig(a=a)
    assert result.verdict == "stable up to symmetry"
    assert result.modulo.symmetries == ("rotation in the plane",)
    assert abs(result.values().imag).max() == pytest.approx(10.0, rel=1e-12)


FREE = """
mbstab: 1
parameters:
  a: {value: 0, unit: rad}
bodies:
  b: {type: spatial, mass: 1, inertia: [1, 2, 2.6]}
reference:
  steady: {axis: [cos(a), sin(a), 0], rate: 3}
  coordinates:
    b: {x: 0, y: 0, z: 0, phi: 0, theta: 0, psi: a}
"""


@pytest.mark.parametrize("a", [0.0, 0.1, 0.4, 0.8, math.pi / 2])
def test_a_free_body_that_turns_is_judged_the_same_about_every_axis(a):
    result = mbstab.loads(FREE).eig(a=a)
    # The energy is greatest at the given angular momentum: damping inside the body would tip it over.
    assert result.verdict == "stable up to symmetry"
    assert any("damping" in warning for warning in result.warnings)
    assert result.counts.neutral == 10
    # Euler's equations about the axis of the smallest inertia.
    nutation = 3.0 * math.sqrt((2.0 - 1.0) * (2.6 - 1.0) / (2.0 * 2.6))
    assert abs(result.values().imag).max() == pytest.approx(nutation, rel=1e-11)


ARM = """
mbstab: 1
parameters:
  Om: {value: 6, unit: rad/s}
ground:
  points: {P: [1.3, -0.4]}
bodies:
  hub: {type: planar, mass: 2, inertia: 0.3, points: {A: [0.4, 0.1]}}
  arm: {type: planar, mass: 1, inertia: 0.02, points: {O: [-0.3, 0]}}
joints:
  b: {type: revolute, between: [hub, ground.P]}
  h: {type: revolute, between: [arm.O, hub.A]}
reference:
  find: steady
  steady: {axis: z, rate: Om, point: [1.3, -0.4]}
  coordinates:
    hub: {theta: 0}
  guess:
    hub: {x: 1.3, y: -0.4}
    arm: {x: 2, y: -0.3}
"""


def test_an_arm_that_is_stretched_by_its_turn_needs_no_spins():
    # Straight, the hinges allow spins for an instant. Frequency: turn and hinge as two degrees of freedom.
    r, s = math.hypot(0.4, 0.1), 0.3
    inner, outer, coupling = 0.3 + r * r, 0.02 + s * s, r * s
    total = inner + outer + 2.0 * coupling
    # Angular momentum is conserved: the turn gives way to the arm.
    mass = outer - (outer + coupling) ** 2 / total
    result = mbstab.loads(ARM).eig()
    assert abs(result.values().imag).max() == pytest.approx(6.0 * math.sqrt(coupling / mass), rel=1e-11)
    assert result.verdict == "stable up to symmetry"


def test_an_ideal_spring_may_have_no_length():
    text = """
mbstab: 1
bodies:
  b: {type: planar_point, mass: 1}
forces:
  s: {type: spring, between: [b, ground], stiffness: 100}
reference:
  coordinates: {b: {x: 0, y: 0}}
"""
    result = mbstab.loads(text).eig()
    assert [e.kind for e in result.eigenvalues] == ["center"] * 4
    assert abs(result.values().imag) == pytest.approx([10.0] * 4, rel=1e-14)
    assert result.verdict == "stable"


BEARING = """
mbstab: 1
parameters:
  c: {value: 2, unit: N*s/m}
bodies:
  b: {type: KIND, mass: 1INERTIA}
forces:
  s: {type: bearing, between: [b, ground], stiffness: 100, damping: c}
reference:
  coordinates: {b: {COORDINATES}}
"""


def bearing(kind):
    inertia = {"planar": ", inertia: 2", "spatial": ", inertia: [2, 2, 2]"}.get(kind, "")
    names = BODY_COORDINATES[kind]
    coordinates = ", ".join(f"{name}: 0" for name in names)
    return BEARING.replace("KIND", kind).replace("INERTIA", inertia).replace("COORDINATES", coordinates)


@pytest.mark.parametrize("kind", BODY_COORDINATES)
@pytest.mark.parametrize("damping", [0.0, 2.0])
def test_a_bearing_whose_ends_coincide_acts_the_same_in_all_directions(kind, damping):
    linear = mbstab.loads(bearing(kind)).linearize(c=damping)
    d = 2 if kind.startswith("planar") else 3
    assert np.array_equal(linear.K[:d, :d], 100.0 * np.eye(d))
    assert np.array_equal(linear.R[:d, :d], damping * np.eye(d))
    assert not linear.K[d:].any()
    assert not linear.R[d:].any()


def test_a_bearing_decays_and_its_energy_is_accounted_for():
    model = mbstab.loads(bearing("planar_point"))
    result = model.eig()
    assert result.verdict == "asymptotically stable"
    assert result.values() == pytest.approx([complex(-1.0, s * math.sqrt(99.0)) for s in (1, 1, -1, -1)], rel=1e-13)
    assert model.certify().verdict == "asymptotically stable"
    run = model.simulate(1.0, perturb={"b.x": 0.1, "rate(b.y)": 0.2}, tol=1e-9)
    assert run.energy_drift < 1e-7


def test_a_bearing_that_turns_with_its_housing_dissipates_nothing():
    text = """
mbstab: 1
parameters:
  w: {value: 3, unit: rad/s}
bodies:
  housing: {type: planar, mass: 4, inertia: 2}
  shaft: {type: planar, mass: 1, inertia: 1}
forces:
  s: {type: bearing, between: [shaft, housing], stiffness: 100, damping: 5}
reference:
  coordinates: {housing: {theta: 0}, shaft: {theta: 0}}
  rates: {housing: {theta: w}, shaft: {theta: w}}
"""
    system = mbstab.loads(text).system()
    q, w = np.array([0.1, 0.2, 0.3, 0.6, -0.2, 0.1]), 3.0
    u = np.array([-q[1] * w, q[0] * w, w, -q[4] * w, q[3] * w, w])
    assert system.dynamics(q, u).F0 @ u == pytest.approx(system.dynamics(q, 0.0 * u).F0 @ u, abs=1e-12)


@pytest.mark.parametrize("kind", BODY_COORDINATES)
def test_a_damper_along_a_line_that_has_no_direction_is_refused_with_what_to_write_instead(kind):
    with pytest.raises(NumericalError, match=r":\d+:\d+: forces\.s has no finite [^\0]*length 0 write type: bearing"):
        mbstab.loads(bearing(kind).replace("type: bearing", "type: spring")).eig()


TOP = """
mbstab: 1
parameters:
  spin: {value: 60, unit: rad/s}
gravity: [0, 0, -9.81]
bodies:
  top: {type: spatial, mass: 0.5, inertia: [0.002, 0.002, 0.003], points: {O: [0, 0, -0.1]}}
joints:
  tip: {type: spherical, between: [top.O, ground]}
reference:
  find: steady
  steady: {axis: z}
  coordinates:
    top: {phi: 0, theta: 0.5}
  rates:
    top: {psi: spin}
  guess:
    top: {x: 0.1*sin(0.5), z: 0.1*cos(0.5)}
"""


def test_both_precessions_of_a_leaning_top_are_found():
    # The turn has the Euler rates psi_t = W/cos(theta) here, so the spin about the own axis is spin − W/cos(theta).
    A, C, moment, c = 0.002 + 0.5 * 0.01, 0.003, 0.5 * 9.81 * 0.1, math.cos(0.5)
    found = sorted(item.steady.rate for item in mbstab.loads(TOP).equilibria(20))
    assert len(found) == 2
    for item in mbstab.loads(TOP).equilibria(20):
        W, s = item.steady.rate, float(item.steady.spins[5])
        # W² (C − A) cos + W C s = m g l, the balance of moments about the line of nodes.
        assert W * W * (C - A) * c + W * C * s == pytest.approx(moment, rel=1e-12)


def test_a_top_that_is_too_slow_says_what_is_given():
    with pytest.raises(
        mbstab.errors.MbstabError, match=r"no balance of forces was found: at best, \S+ N\*m unbalanced on top"
    ) as error:
        mbstab.loads(TOP).eig(spin=30)
    assert "rates.top.psi" in str(error.value)


@pytest.mark.parametrize("section", ["reference", "reference.steady", "expect", "sweep", "constraints", "parameters"])
def test_sections_without_types_are_documented_as_well(section):
    result = CliRunner().invoke(main, ["schema", section])
    assert result.exit_code == 0
    assert ": " in result.stdout
    assert max(map(len, result.stdout.splitlines())) <= 80


@pytest.mark.parametrize("seed", range(12))
def test_a_platform_on_more_equal_links_than_it_needs_is_stable(seed):
    """Beside the positions that they allow, the links contradict each other."""
    rng = np.random.default_rng(seed)
    links = int(rng.integers(3, 6))
    places = np.cumsum(rng.uniform(0.1, 2.0, links)) * 10.0 ** rng.uniform(-2, 2)
    length = 10.0 ** rng.uniform(-1, 1)
    points = ", ".join(f"P{i}: [{x!r}, 0]" for i, x in enumerate(places.tolist()))
    fixed = ", ".join(f"P{i}: [{x!r}, {length!r}]" for i, x in enumerate(places.tolist()))
    joints = ", ".join(
        f"link{i}: {{type: distance, between: [bar.P{i}, ground.P{i}], length: {length!r}}}" for i in range(links)
    )
    mechanism = mbstab.loads(
        f"{{mbstab: 1, gravity: [0, -9.81], ground: {{points: {{{fixed}}}}}, joints: {{{joints}}}, "
        f"bodies: {{bar: {{type: planar, mass: 1, inertia: {10.0 ** rng.uniform(-2, 2)!r}, points: {{{points}}}}}}}, "
        "reference: {coordinates: {bar: {x: 0}}}}"
    )
    result = mechanism.eig()
    assert result.verdict == "stable"
    assert abs(result.eigenvalues[0].value - 1j * np.sqrt(9.81 / length)) <= result.eigenvalues[0].error_bound
