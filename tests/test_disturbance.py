"""What --perturb moves, and what it leaves as it is."""

import numpy as np
import pytest
from click.testing import CliRunner

import mbstab
from mbstab.analysis.reference.attitude import Attitudes
from mbstab.analysis.reference.efforts import Placement
from mbstab.analysis.simulate.disturbance import joint_motions
from mbstab.analysis.simulate.start import start_of
from mbstab.cli.main import main
from mbstab.errors import UsageError

ARM = """\
mbstab: 1
gravity: [0, -10]
bodies:
  upper: {type: planar, mass: 2, inertia: 0.1, points: {a: [0, 0.5], b: [0, -0.5]}}
  fore: {type: planar, mass: 1, inertia: 0.1, points: {a: [0, 0.5]}}
joints:
  shoulder: {type: revolute, between: [upper.a, ground]}
  elbow: {type: revolute, between: [fore.a, upper.b]}
reference: {coordinates: {upper: {theta: 0.1}, fore: {theta: 0.3}}, rates: {upper: {theta: 2}, fore: {theta: -1}}}
"""

CART = """\
mbstab: 1
gravity: [0, -10]
bodies:
  cart: {type: planar, mass: 2, inertia: 0.1}
  rod: {type: planar, mass: 1, inertia: 0.1, points: {a: [0, 0.5]}}
joints:
  rail: {type: prismatic, between: [cart, ground], axis: x}
  pivot: {type: revolute, between: [rod.a, cart]}
reference: {coordinates: {cart: {x: 0.3}, rod: {theta: 0}}}
"""

SPATIAL = """\
mbstab: 1
gravity: [0, 0, -10]
bodies:
  base: {type: spatial, mass: 2, inertia: [0.1, 0.2, 0.25], points: {a: [0.1, 0.2, 0.3]}}
  rod: {type: spatial, mass: 1, inertia: [0.1, 0.12, 0.2], points: {a: [-0.5, 0.1, 0.2]}}
  tip: {type: spatial, mass: 1, inertia: [0.1, 0.12, 0.2]}
joints:
  pin: {type: revolute, between: [base, ground], axis: [0, 1, 2], zero: x}
  sleeve: {type: cylindrical, between: [rod.a, base.a], axis: [[1, 0, 1], [0, 1, 2]], zero: [y, x]}
  hinge: {type: revolute, between: [tip, rod], axis: y, zero: x}
reference: {coordinates: {}}
"""


def started(text, perturb):
    """Return names, reference and start."""
    system = mbstab.loads(text).system()
    return system, start_of(system, {}), start_of(system, perturb)


@pytest.mark.parametrize(
    ("perturb", "angles", "rates"),
    [
        ({"upper.theta": 0.2}, (0.3, 0.3), (2, -1)),
        ({"fore.theta": 0.2}, (0.1, 0.5), (2, -1)),
        ({"angle(shoulder)": 0.2}, (0.3, 0.5), (2, -1)),
        ({"angle(elbow)": "pi"}, (0.1, 0.3 + np.pi), (2, -1)),
        ({"rate(upper.theta)": 1}, (0.1, 0.3), (3, -1)),
        ({"rate(angle(shoulder))": 1}, (0.1, 0.3), (3, 0)),
        ({"rate(angle(elbow))": 1}, (0.1, 0.3), (2, 0)),
        ({"angle(elbow)": 0.1, "upper.theta": 0.2, "rate( fore.theta )": 0.5}, (0.3, 0.6), (2, -0.5)),
        ({"angle(shoulder)": 7.0}, (7.1, 7.3), (2, -1)),
    ],
)
def test_the_other_angles_of_a_chain_stay(perturb, angles, rates):
    system, _, start = started(ARM, perturb)
    k = [system.names.index(x) for x in ("upper.theta", "fore.theta")]
    np.testing.assert_allclose(start.motion.q[k], angles, atol=1e-12)
    np.testing.assert_allclose(start.motion.u[k], rates, atol=1e-12)
    assert start.warnings == ()
    assert start.notes == ()


@pytest.mark.parametrize(
    ("name", "moved"), [("cart.x", "cart.x"), ("displacement(rail)", "cart.x"), ("rod.theta",) * 2]
)
def test_a_cart_and_its_pendulum_are_apart(name, moved):
    system, before, start = started(CART, {name: 0.2})
    for free in ("cart.x", "rod.theta"):
        i = system.names.index(free)
        assert start.motion.q[i] - before.motion.q[i] == pytest.approx(0.2 if free == moved else 0.0, abs=1e-12)


@pytest.mark.parametrize("name", ["angle(pin)", "angle(sleeve)", "displacement(sleeve)", "angle(hinge)"])
def test_one_joint_in_space_moves_alone(name):
    system, before, start = started(SPATIAL, {name: 0.2, f"rate({name})": 0.7})
    attitudes = Attitudes.of(system)
    sizes = start.motion.sizes
    one, other = (Placement(attitudes, system, x.motion.q, x.motion.u) for x in (before, start))
    found = {x.name: (x.value(other) - x.value(one), x.gradient(other) @ other.u) for x in joint_motions(system, sizes)}
    assert len(found) == 4
    for joint, (change, rate) in found.items():
        assert (change, rate) == pytest.approx((0.2, 0.7) if joint == name else (0.0, 0.0), abs=1e-10)
    assert start.notes == ()


def test_a_steady_motion_that_is_turned_is_steady():
    system = mbstab.load("governor.yaml").system()
    before, start = start_of(system, {}), start_of(system, {"shaft.psi": 0.1})
    spins = [Attitudes.of(system).spins(system, x.motion.q, x.motion.u) for x in (before, start)]
    np.testing.assert_allclose(spins[1], spins[0], atol=1e-12)
    assert np.max(np.abs(start.motion.u[[i for i, x in enumerate(system.names) if x == "slider.z"]])) < 1e-12


def test_a_bicycle_leans_without_steering_and_says_what_moves_along():
    model = mbstab.load("whipple_bicycle.yaml")
    told = []
    model.simulate(0.01, perturb={"rear_body.phi": 0.01}, points=2, tol=1e-3, tell=told.append)
    (text,) = told
    assert text.startswith("with rear_body.phi the constraints move rear_wheel.phi by 0.01 rad")
    assert "front_body.psi" not in text


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("shoulder", "no coordinate 'shoulder'\nhint: motions of joints: angle(shoulder)"),
        ("angle(sholder)", "no joint motion 'angle(sholder)'\nhint: did you mean 'angle(shoulder)'?"),
        ("angel(elbow)", "did you mean 'angle(elbow)'?"),
        ("displacement(elbow)", "no joint motion 'displacement(elbow)'\nhint: motions of joints: angle(elbow)"),
        ("rate(angle(ellbow))", "did you mean 'rate(angle(elbow))'?"),
        ("rate(uper.theta)", "did you mean 'rate(upper.theta)'?"),
    ],
)
def test_unknown_names_are_told_with_what_is_known(name, said):
    with pytest.raises(UsageError) as caught:
        started(ARM, {name: 0.1})
    assert f"--perturb {name}: " in str(caught.value)
    assert said in str(caught.value)


def test_a_driven_joint_cannot_be_disturbed():
    text = ARM + "drives: {motor: {type: joint, joint: elbow, position: 0.2}}\n"
    text = text.replace("rates: {upper: {theta: 2}, fore: {theta: -1}}", "rates: {upper: {theta: 0}}")
    for name, said in (
        ("angle(elbow)", "no state near has these values"),
        ("rate(angle(elbow))", "allow no such rates"),
    ):
        with pytest.raises(UsageError, match=said):
            started(text, {name: 0.1})


def test_what_moves_along_is_told_on_the_terminal():
    result = CliRunner().invoke(
        main, ["simulate", "whipple_bicycle.yaml", "--to", "0.01", "--perturb", "rear_body.phi=0.01", "--tol", "1e-3"]
    )
    assert result.exit_code == 0
    assert "the constraints move rear_wheel.phi by 0.01 rad" in result.stderr
