"""Springs, bushings and bearings: closed forms, what they transmit, energies at large turns, any angle and length."""

import json
import math

import numpy as np
import pytest
from click.testing import CliRunner

import mbstab
import mbstab.errors
from mbstab.cli.main import main
from mbstab.errors import ModelFileError, NumericalError
from mbstab.mechanics.bodies import BODY_COORDINATES

BLOCK = """\
mbstab: 1
bodies:
  block: {type: spatial, mass: 20, inertia: [1, 1.5, 2], points: {P: [0.1, 0.2, -0.3]}}
forces:
  mount:
    type: bushing
    between: [block.P, {body: ground, point: [0.1, 0.2, -0.3]}]
    stiffness: [1e5, 2e5, 3e5]
    damping: [100, 200, 300]
    torsional_stiffness: [4e3, 5e3, 6e3]
    torsional_damping: [4, 5, 6]
"""


def test_a_block_on_a_bushing_has_the_eigenvalues_of_its_matrices():
    """K at the centre of mass is TᵀKT with T = [1, −[r]×; 0, 1]; damping is 1e-3 s of it."""
    r = np.array([0.1, 0.2, -0.3])
    cross = np.array([[0, -r[2], r[1]], [r[2], 0, -r[0]], [-r[1], r[0], 0]])
    T = np.block([[np.eye(3), -cross], [np.zeros((3, 3)), np.eye(3)]])
    K = T.T @ np.diag([1e5, 2e5, 3e5, 4e3, 5e3, 6e3]) @ T
    scale = np.array([20, 20, 20, 1, 1.5, 2]) ** -0.5
    squares = np.linalg.eigvalsh(K * scale * scale[:, None])
    expected = np.concatenate([np.roots([1, 1e-3 * x, x]) for x in squares])
    assert min(abs(expected - (-0.4960624818853302 + 31.49410874726774j))) < 1e-11
    found = mbstab.loads(BLOCK).eig()
    assert found.verdict == "asymptotically stable"
    for e in found.eigenvalues:
        assert np.min(np.abs(expected - e.value)) < 1e-12 * abs(e.value)


def test_directions_turn_the_axes_of_a_bushing():
    turned = BLOCK.replace("stiffness: [1e5, 2e5, 3e5]", "axis: z\n    zero: x\n    stiffness: [3e5, 1e5, 2e5]", 1)
    turned = turned.replace("[100, 200, 300]", "[300, 100, 200]")
    turned = turned.replace("[4e3, 5e3, 6e3]", "[6e3, 4e3, 5e3]").replace("[4, 5, 6]", "[6, 4, 5]")
    one, other = (mbstab.loads(text).linearize() for text in (BLOCK, turned))
    np.testing.assert_allclose(one.K, other.K, rtol=1e-13, atol=1e-9)
    np.testing.assert_allclose(one.R, other.R, rtol=1e-13, atol=1e-9)


@pytest.mark.parametrize("angle", [0.3, 1.5, 3.0])
def test_a_large_turn_counts_as_twice_the_sine_of_its_half(angle):
    text = "mbstab: 1\nbodies: {b: {type: spatial, mass: 1, inertia: [1, 1, 1]}}\nforces:\n"
    text += "  m: {type: bushing, between: [b, ground], torsional_stiffness: [5, 5, 5]}\n"
    system = mbstab.loads(text).system()
    for k in range(3):
        q = np.zeros(6)
        q[3 + k] = angle if k != 1 else angle / 2.5
        turn = q[3 + k]
        assert system.potential(q) == pytest.approx(0.5 * 5 * (2 * math.sin(turn / 2)) ** 2)


PLANAR = """\
mbstab: 1
gravity: [0, -10]
bodies: {bar: {type: planar, mass: 3, inertia: 0.2, points: {E: [0.5, 0]}}}
forces:
  mount: {type: bushing, between: [bar.E, ground], stiffness: [4e3, 6e3], torsional_stiffness: 500, PRELOAD}
reference: {find: equilibrium, guess: {bar: {x: -0.5}}}
"""


def test_a_bushing_carries_the_weight_by_a_force_and_a_torque(tmp_path):
    model = tmp_path / "bar.yaml"
    model.write_text(PLANAR.replace("PRELOAD", "damping: [1, 2]"), encoding="utf-8")
    result = CliRunner().invoke(main, ["equilibrium", str(model), "--format", "json"])
    (found,) = json.loads(result.stdout)["equilibria"]
    (reaction,) = found["reactions"]
    assert (reaction["of"], reaction["on"]) == ("force 'mount'", "bar")
    theta = found["coordinates"]["bar.theta"]
    assert reaction["force"] == pytest.approx([0, 30], abs=1e-10)
    # About its end, the centre of mass hangs half a metre to the left.
    assert reaction["torque"] == pytest.approx([-30 * 0.5 * math.cos(theta)], rel=1e-10)
    assert reaction["torque"] == pytest.approx([-500 * theta], rel=1e-10)
    simulated = mbstab.load(model).simulate(0.01, points=3, tol=1e-6)
    assert any("mount" in owner for owner, *_ in simulated.load_names)


def test_a_preload_that_carries_the_weight_leaves_the_bushing_in_its_place():
    text = PLANAR.replace("PRELOAD", "preload: [0, 30], torsional_preload: -15")
    (found,) = mbstab.loads(text).equilibria()
    np.testing.assert_allclose(found.motion.q, [-0.5, 0, 0], atol=1e-12)


def test_a_bushing_between_turning_bodies_loses_no_energy_but_by_its_dampers():
    text = """\
mbstab: 1
bodies:
  a: {type: spatial, mass: 2, inertia: [0.1, 0.2, 0.25]}
  b: {type: spatial, mass: 1, inertia: [0.1, 0.12, 0.2]}
forces:
  mount: {type: bushing, between: [a, b], stiffness: [40, 50, 60], torsional_stiffness: [3, 4, 5], DAMPING}
initial: {coordinates: {a: {phi: 0.4}}, rates: {a: {phi: 1, x: 0.3}, b: {theta: 0.5}}}
"""
    free = mbstab.loads(text.replace(", DAMPING", "")).simulate(1.0, points=5, tol=1e-8)
    energy = free.kinetic + free.potential
    np.testing.assert_allclose(energy, energy[0], rtol=1e-8)
    damped = mbstab.loads(text.replace("DAMPING", "damping: [1, 1, 1], torsional_damping: [1, 1, 1]"))
    lost = damped.simulate(1.0, points=5, tol=1e-8)
    energy = lost.kinetic + lost.potential
    assert np.all(np.diff(energy) < 0)
    np.testing.assert_allclose(energy - lost.work, energy[0], rtol=1e-7)


def test_a_bushing_is_proven():
    certified = mbstab.loads(BLOCK).certify()
    assert certified.proven
    assert certified.verdict == "asymptotically stable"


def test_negative_coefficients_are_refused():
    with pytest.raises(ModelFileError, match=r"damping must .*got -1 N\*s/m"):
        mbstab.loads(BLOCK.replace("[100, 200, 300]", "[100, -1, 300]")).eig()


# --- ideal springs and bearings: at any angle, of length zero, between points that coincide ---------------------------


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
