"""The linear model from inputs to outputs: closed forms, nonlinear quantities, and what is refused."""

import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest
from test_cli import run

import mbstab
from mbstab.analysis.reference.reactions import reactions
from mbstab.analysis.reference.rotation import orientation
from mbstab.analysis.response import state_space
from mbstab.analysis.response.measured import Meter
from mbstab.analysis.response.response import answer
from mbstab.analysis.response.signals import Signals, State
from mbstab.errors import ModelFileError, NumericalError, UsageError
from mbstab.model.sections.outputs import measured_expression

ROOT = Path(__file__).parents[1]
WHIPPLE = ["rear_body.phi", "angle(steering)", "rate(rear_body.phi)", "rate(angle(steering))"]
MASS = np.array([[80.81722, 2.319413322087091], [2.319413322087091, 0.2978418819968555]])
DAMPING = np.array([[0, 33.86641391492494], [-0.8503564145697844, 1.685403973975597]])
GRAVITY = 9.81 * np.array([[-80.95, -2.599516852498716], [-2.599516852498716, -0.8032948845861769]])
SPEED = np.array([[0, 76.59734589573222], [0, 2.65431523794604]])


def whipple(v):
    """Return A and B of roll and steer by Meijaard, Papadopoulos, Ruina and Schwab (2007)."""
    A = np.zeros((4, 4))
    A[:2, 2:] = np.eye(2)
    A[2:, :2], A[2:, 2:] = -np.linalg.solve(MASS, GRAVITY + v * v * SPEED), -v * np.linalg.solve(MASS, DAMPING)
    return A, np.vstack([np.zeros((2, 2)), np.linalg.inv(MASS)])


def transfer(x, s):
    """Return the transfer matrix of the state form; columns of rates of inputs count with powers of s."""
    powers = np.array([s**k for _, k in x.orders])
    found = x.C @ np.linalg.solve(s * np.eye(len(x.A)) - x.A, x.B * powers) + x.D * powers
    return np.stack([found[:, [i == j for i, _ in x.orders]].sum(axis=1) for j in range(len(x.inputs))], axis=1)


def rounding(x, s):
    """Return how much one rounding of each entry of A changes the transfer matrix at most, and that of its entries."""
    resolvent = np.linalg.inv(s * np.eye(len(x.A)) - x.A)
    effect = np.abs(x.C @ resolvent) @ np.abs(x.A) @ np.abs(resolvent @ x.B)
    return np.finfo(float).eps * max(effect.max(), np.abs(transfer(x, s)).max())


def descriptor_transfer(x, s):
    """Return the transfer matrix of the descriptor form, of constraints without redundant rows."""
    d = x.descriptor
    powers = np.array([s**k for _, k in x.orders])
    direct = np.stack(
        [(d.D * powers)[:, [i == j for i, _ in x.orders]].sum(axis=1) for j in range(len(x.inputs))], axis=1
    )
    return d.C @ np.linalg.solve(s * d.E - d.A, d.B.astype(complex)) + direct


@pytest.mark.parametrize("v", [0.0, 1.0, 5.0, 9.0])
def test_the_bicycle_has_the_matrices_of_meijaard_et_al(v):
    found = mbstab.load("whipple_bicycle.yaml").state_space(WHIPPLE, v=v)
    A, B = whipple(v)
    np.testing.assert_allclose(found.A, A, rtol=0, atol=1e-12 * np.abs(A).max())
    np.testing.assert_allclose(found.B, B, rtol=0, atol=1e-12 * np.abs(B).max())
    np.testing.assert_allclose(found.C, np.eye(2, 4), rtol=0, atol=1e-14)
    assert not found.D.any()
    assert found.coordinates == ("rear_wheel.phi", "rear_body.phi", "front_body.phi", "front_wheel.phi")


@pytest.mark.long
def test_the_bicycle_has_them_at_101_speeds():
    mechanism = mbstab.load("whipple_bicycle.yaml")
    for v in np.linspace(0.0, 10.0, 101):
        found = mechanism.state_space(WHIPPLE, v=v)
        for x, known in zip((found.A, found.B), whipple(v), strict=True):
            np.testing.assert_allclose(x, known, rtol=0, atol=1e-12 * np.abs(known).max())


def test_all_states_and_the_descriptor_form_have_the_same_transfer_functions():
    model = mbstab.load("whipple_bicycle.yaml")
    few, all_ = model.state_space(WHIPPLE), model.state_space()
    assert len(all_.states) == 10
    for omega in (0.1, 1.0, 10.0):
        known = transfer(few, 1j * omega)
        # Near the zero eigenvalues of place and heading, roundings of A count more.
        assert np.abs(transfer(all_, 1j * omega) - known).max() <= 64.0 * rounding(all_, 1j * omega)
        np.testing.assert_allclose(
            descriptor_transfer(all_, 1j * omega), known, rtol=0, atol=1e-11 * np.abs(known).max()
        )


def test_the_wheeled_inverted_pendulum_has_the_transfer_functions_of_its_equations():
    a, b, c, d = 1 + 0.005 / 0.01 + 5, 5 * 0.2, 0.1 + 5 * 0.04, 5 * 9.81 * 0.2
    r, delta = 0.1, a * c - b * b
    found = mbstab.load("wheeled_inverted_pendulum.yaml").state_space(m_d=1, R_d=r, I_d=0.005, m_p=5, L_p=0.2, I_p=0.1)
    for omega in (0.1, 1, 5, 10, 100):
        s = 1j * omega
        x = ((c / r + b) * s**2 - d / r) / (s**2 * (delta * s**2 - a * d))
        theta = -(a + b / r) / (delta * s**2 - a * d)
        # Here the torque on the wheel is counter-clockwise, forwards in the equations; so is the tilt.
        np.testing.assert_allclose(transfer(found, s)[:, 0], [-x, theta], rtol=1e-12)


CART = """mbstab: 1
parameters: {M: 1, m: 0.1, l: 0.5, g: 9.81}
gravity: [0, -g]
bodies:
  cart: {type: planar, mass: M, inertia: 1}
  bob: {type: planar, mass: m, inertia: 0, points: {top: [0, -l]}}
joints:
  rail: {type: prismatic, between: [cart, ground], axis: x}
  pin: {type: revolute, between: [bob.top, cart]}
DRIVES
inputs:
  push: INPUT
outputs:
OUTPUTS
reference:
  coordinates: {cart: {x: 0, y: 0, theta: 0}, bob: {x: 0, theta: 0}}
"""


def cart(push="{type: force, at: cart, direction: x}", outputs=("cart.x",), drives=""):
    lines = "\n".join(f"  z{i}: {x}" for i, x in enumerate(outputs))
    return mbstab.loads(CART.replace("INPUT", push).replace("OUTPUTS", lines).replace("DRIVES", drives))


def test_cart_and_pendulum():
    found = cart(
        outputs=["cart.x", "angle(pin)", "acceleration(cart.x)", "force(pin.x)", "torque(rail.z)"]
    ).state_space()
    M, m, length, g = 1.0, 0.1, 0.5, 9.81
    for omega in (0.1, 1.0, 3.0, 10.0, 100.0):
        s = 1j * omega
        phi = -1.0 / (M * length) / (s**2 - g * (M + m) / (M * length))
        x = (1.0 / M - m / M * g * phi) / s**2
        # The angle is counter-clockwise; the bob at rest hangs above the pin.
        expected = np.array([x, -phi, s**2 * x, m * s**2 * (x + length * phi), 0.0])
        np.testing.assert_allclose(transfer(found, s)[:, 0], expected, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(descriptor_transfer(found, s)[:, 0], expected, rtol=1e-11, atol=1e-12)
    assert abs(transfer(found, 1j)[0, 0] + 0.9131166415729342) < 1e-13


def test_the_function_of_a_drive_acts_with_its_derivatives():
    drives = "drives:\n  motor: {type: joint, joint: rail, position: 0}"
    found = cart("{type: drive, drive: motor}", ["cart.x", "bob.theta", "effort(motor)"], drives).state_space()
    assert found.inputs == ("push",)
    assert found.orders[-1] == (0, 2)
    for omega in (0.3, 2.0, 20.0):
        s = 1j * omega
        theta = s**2 / 0.5 / (s**2 - 9.81 / 0.5)
        effort = 1.0 * s**2 + 0.1 * (s**2 - 0.5 * s**2 * theta)
        np.testing.assert_allclose(transfer(found, s)[:, 0], [1.0, theta, effort], rtol=1e-12)
        np.testing.assert_allclose(descriptor_transfer(found, s)[:, 0], [1.0, theta, effort], rtol=1e-11)


def test_a_given_speed_acts_with_its_rate():
    drives = "drives:\n  motor: {type: joint, joint: rail, velocity: 0}"
    found = cart(
        "{type: drive, drive: motor}", ["cart.x", "rate(displacement(rail))", "bob.theta"], drives
    ).state_space()
    s = 0.7j
    theta = s / 0.5 / (s**2 - 9.81 / 0.5)
    np.testing.assert_allclose(transfer(found, s)[:, 0], [1 / s, 1.0, theta], rtol=1e-12)


def test_a_parameter_as_a_disturbance():
    """With a string of changing length, and with changing gravity about a tilted pendulum held by a spring."""
    found = cart("{type: parameter, parameter: l}", ["bob.y", "rate(place(bob.top.y))"]).state_space()
    np.testing.assert_allclose(transfer(found, 0.5j)[:, 0], [1.0, 0.0], rtol=0, atol=1e-13)
    text = """mbstab: 1
parameters: {g: 9.81, k: 40}
gravity: [0, -g]
bodies: {rod: {type: planar, mass: 2, inertia: 0.1, points: {end: [-0.5, 0]}}}
joints: {pin: {type: revolute, between: [rod.end, ground]}}
forces: {spring: {type: joint_spring, joint: pin, stiffness: k}}
inputs: {field: {type: parameter, parameter: g}, soft: {type: parameter, parameter: k}}
outputs: {angle: angle(pin), torque: effort(spring)}
reference: {find: equilibrium, guess: {rod: {x: 0.5, y: 0, theta: 0}}}
"""
    model = mbstab.loads(text)
    gain = transfer(model.state_space(), 0.0)
    h = 1e-4

    def angle(g, k):
        return model.motion(g=g, k=k).q[2]

    by_g = (angle(9.81 + h, 40.0) - angle(9.81 - h, 40.0)) / (2 * h)
    by_k = (angle(9.81, 40.0 + h) - angle(9.81, 40.0 - h)) / (2 * h)
    np.testing.assert_allclose(gain[0], [by_g, by_k], rtol=1e-7)
    np.testing.assert_allclose(gain[1], [-40 * by_g, -40 * by_k - angle(9.81, 40.0)], rtol=1e-7)


MASSES = """mbstab: 1
bodies:
  one: {type: planar, mass: 1, inertia: 1}
  two: {type: planar, mass: 2, inertia: 1}
joints:
  first: {type: prismatic, between: [one, ground], axis: x}
  second: {type: prismatic, between: [two, ground], axis: x}
forces:
  link: {type: spring, between: [two, one], stiffness: 100, damping: 0.5, length: 1}
inputs: {push: {type: force, at: one, direction: x}}
outputs: {near: one.x, far: two.x, pull: effort(link)}
reference: {coordinates: {one: {x: 0, y: 0, theta: 0}, two: {x: 1, y: 0, theta: 0}}}
"""


def test_two_masses_with_a_spring():
    found = mbstab.loads(MASSES).state_space()
    expected = {0.1: -33.33555570315791 + 1.111258996223596e-6j, 10: -0.009853300733496333 + 0.0009779951100244499j}
    for omega, far in expected.items():
        s = 1j * omega
        near = (2 * s**2 + 0.5 * s + 100) / (s**2 * (2 * s**2 + 1.5 * s + 300))
        known = [near, far, (100 + 0.5 * s) * (near - far)]
        np.testing.assert_allclose(transfer(found, s)[:, 0], known, rtol=1e-11)


def test_what_is_measured_has_the_slopes_of_the_nonlinear_quantities():
    """Reactions of spatial joints in motion, against differences of what `reactions` computes."""
    model = mbstab.load("governor.yaml")
    system, motion = model.system(), model.motion()
    at = State(motion.q, motion.u, motion.a, motion.nu, motion.time)
    rng = np.random.default_rng(3)
    steps = [rng.standard_normal(len(x)) for x in (motion.q, motion.u, motion.nu)]

    def wrench(h):
        q, u, nu = (x + h * d for x, d in zip((motion.q, motion.u, motion.nu), steps, strict=True))
        J = system.dynamics(q, u).J
        return {x.owner.split("'")[1]: (x.force, x.torque) for x in reactions(system, q, u, J, nu)}

    h = 1e-5
    before, after = wrench(-h), wrench(h)
    meter = Meter(system, Signals(system), at)
    moved = np.concatenate([steps[0], steps[1], np.zeros(system.n_q), steps[2], np.zeros(meter.size)])[: meter.size]
    joints = [name for name in before if name in model.model.entries["joints"]]
    assert joints
    for name in joints:
        for k, kind in enumerate(("force", "torque")):
            for i, axis in enumerate("xyz"):
                slope = meter.slope(measured_expression(model.model, f"{kind}({name}.{axis})")) @ moved
                known = (after[name][k][i] - before[name][k][i]) / (2 * h)
                size = max(np.abs(x).max() for pair in after.values() for x in pair)
                assert abs(slope - known) < 1e-6 * size, (name, kind, axis)


def test_outputs_measure_what_expressions_measure():
    """Distance, place, speeds and turn rates about a spatial motion, against differences of closed forms."""
    model = mbstab.loads(
        "mbstab: 1\nbodies: {a: {type: spatial, mass: 1, inertia: [1, 2, 3], points: {p: [0.3, -0.2, 0.5]}}}\n"
        "ground: {points: {o: [1, 2, -1]}}\nreference: {coordinates: {a: {x: 0}}}\n"
    )
    system = model.system()
    rng = np.random.default_rng(5)
    q, u, a, *steps = rng.uniform(-0.9, 0.9, (6, 6))
    point, origin = np.array([0.3, -0.2, 0.5]), np.array([1.0, 2.0, -1.0])
    body, t = system.scene.bodies[0], 1e-2

    def pose(x):
        turn = orientation(body, x[3:])
        return x[:3] + turn @ point, turn

    def along(h):
        """Return what is measured at a neighbour of the state, from a five-point formula over time."""
        x, v, w = (y + h * d for y, d in zip((q, u, a), steps, strict=True))
        places, turns = zip(*(pose(x + k * t * v + 0.5 * (k * t) ** 2 * w) for k in (-2, -1, 0, 1, 2)), strict=True)
        first, second = np.array([1, -8, 0, 8, -1]) / (12 * t), np.array([-1, 16, -30, 16, -1]) / (12 * t * t)
        lengths = np.linalg.norm(np.array(places) - origin, axis=1)
        speed = turns[2].T @ np.tensordot(first, places, 1)
        spin = (turns[2].T @ np.tensordot(first, turns, 1))[2, 1]
        return np.array([lengths[2], first @ lengths, second @ lengths, places[2][1], *speed[:2], spin])

    meter = Meter(system, Signals(system), State(q, u, a, np.zeros(0), 0.0))
    moved = np.concatenate(steps)
    texts = "distance(a.p, ground.o)", "y(a.p)", "vx(a.p)", "vy(a.p)", "wx(a)"
    texts = texts[0], f"rate({texts[0]})", f"acceleration({texts[0]})", *texts[1:]
    found = [meter.slope(measured_expression(model.model, text))[:18] @ moved for text in texts]
    h = 1e-4
    np.testing.assert_allclose(found, (along(h) - along(-h)) / (2 * h), rtol=1e-6, atol=1e-6)
    place, y = (meter.slope(measured_expression(model.model, text)) for text in ("place(a.p.y)", "y(a.p)"))
    assert np.array_equal(place, y)


TURNING = """mbstab: 1
bodies:
  hub: {type: spatial, mass: 1, inertia: [1, 1, 1]}
  bead: {type: spatial, mass: 1, inertia: [0.1, 0.1, 0.1]}
joints:
  axle: {type: revolute, between: [hub, ground], axis: z}
  rail: {type: prismatic, between: [bead, hub], axis: x}
forces: {spring: {type: joint_spring, joint: rail, stiffness: 100}}
inputs: {push: INPUT}
outputs: {travel: OUTPUT}
reference: {find: steady, steady: {axis: z, rate: 3}, guess: {bead: {x: 0.1}}, coordinates: {hub: {x: 0, y: 0, z: 0}}}
"""


def turning(push, output):
    return mbstab.loads(TURNING.replace("INPUT", push).replace("OUTPUT", output))


def test_in_a_turning_frame():
    along = turning("{type: joint, joint: rail}", "displacement(rail)").state_space()
    follower = turning("{type: force, at: bead, direction: x, frame: body}", "displacement(rail)").state_space()
    for s in (0.4j, 5j):
        # At the axis Coriolis forces vanish: x'' = (Ω² − k) x + w.
        np.testing.assert_allclose(transfer(along, s), 1.0 / (s**2 + 100 - 9), rtol=1e-11)
        np.testing.assert_allclose(transfer(follower, s), transfer(along, s), rtol=1e-11)
    assert "rate(angle(axle))" not in along.states


@pytest.mark.parametrize(
    ("push", "output", "rule"),
    [
        (
            "{type: force, at: bead, direction: x}",
            "displacement(rail)",
            "inputs.push: the input changes along the motion",
        ),
        ("{type: joint, joint: rail}", "bead.x", "outputs.travel: the output changes along the motion"),
    ],
)
def test_what_is_not_constant_in_a_turning_frame_is_refused(push, output, rule):
    model = turning(push, output)
    with pytest.raises(ModelFileError, match=rule):
        model.state_space()
    assert model.state_space(frozen=True).B.any()


REDUNDANT = MASSES.replace("forces:", "  again: {type: prismatic, between: [one, ground], axis: x}\nforces:")


def test_redundant_rows_leave_the_model_as_it_is_and_their_reactions_are_refused():
    known, found = mbstab.loads(MASSES).state_space(), mbstab.loads(REDUNDANT).state_space()
    np.testing.assert_allclose(transfer(found, 2j), transfer(known, 2j), rtol=1e-12)
    sole = mbstab.loads(MASSES.replace("effort(link)", "force(first.y)")).state_space()
    np.testing.assert_allclose(transfer(sole, 2j)[2], 0.0, atol=1e-14)
    with pytest.raises(
        ModelFileError, match=r"<text>:\d+:\d+: outputs.pull: the output needs a reaction that is not unique"
    ):
        mbstab.loads(REDUNDANT.replace("effort(link)", "force(first.y)")).state_space()


def test_an_input_that_a_drive_holds_is_refused():
    drives = "drives:\n  motor: {type: joint, joint: rail, position: 0}"
    with pytest.raises(ModelFileError, match=r"inputs.push: the input moves nothing: drive 'motor' prescribes"):
        cart(drives=drives).state_space()


@pytest.mark.parametrize(
    ("states", "rule"),
    [
        (["cart.x", "rate(cart.x)"], "the rate of rate\\(cart.x\\) depends on others"),
        (["cart.x", "displacement(rail)", "bob.theta", "rate(bob.theta)"], "depend on each other"),
        (["cart.x", "bob.theta", "acceleration(cart.x)", "rate(bob.theta)"], "acceleration"),
        (["cart.y"], "no"),
        (["bob.phi"], "unknown coordinate"),
    ],
)
def test_states_that_do_not_determine_the_motion_are_refused(states, rule):
    with pytest.raises(UsageError, match=rule if rule != "no" else "depend on each other"):
        cart().state_space(states)


def test_a_motion_with_changing_coefficients_has_no_constant_model():
    text = (ROOT / "models" / "kapitza.yaml").read_text(encoding="utf-8")
    model = mbstab.loads(text.replace("reference:", "outputs: {z: 2}\n\nreference:", 1))
    with pytest.raises(NumericalError, match="change along the motion"):
        model.state_space()
    assert mbstab.load("kapitza.yaml").state_space().A.any()


@pytest.mark.parametrize(
    ("outputs", "rule"),
    [
        ("cart.z", "unknown coordinate 'cart.z'"),
        ("angle(rail)", "has no angle, only displacement"),
        ("angle(pim)", "there is no joint 'pim'"),
        ("place(bob.tip.x)", "the body 'bob' has no point 'tip'"),
        ("place(bob.top)", "needs a component"),
        ("force(pin.z)", "needs a component"),
        ("rate(force(pin.x))", r"rate\(\.\.\.\) does not take force"),
        ("effort(pin)", "there is no force or drive"),
        ("cart.x + t", "the time t cannot be used"),
        ("angle(pin", "expected"),
        ("angle(2*pin)", "takes the name of a joint"),
        ("acceleration(vx(bob))", "takes one coordinate or measure"),
        ("vx(bob.tip)", "has no point"),
        ("wz(bob)", "does not exist in a planar scene"),
    ],
)
def test_wrong_outputs_are_told_at_their_place(outputs, rule):
    with pytest.raises(ModelFileError, match=rule) as error:
        cart(outputs=[outputs])
    assert str(error.value).startswith("<text>:14:")


@pytest.mark.parametrize(
    ("push", "rule"),
    [
        ("{type: drive, drive: rotor}", "there is no drive 'rotor'"),
        ("{type: parameter, parameter: q}", "there is no parameter 'q'"),
        ("{type: joint, joint: wheel}", "there is no joint 'wheel'"),
        ("{type: pull}", "unknown type 'pull'"),
        ("{type: force, at: cart}", "the key 'direction' is missing"),
    ],
)
def test_wrong_inputs_are_told_at_their_place(push, rule):
    with pytest.raises(ModelFileError, match=rule) as error:
        cart(push)
    assert str(error.value).startswith("<text>:12:")


@pytest.mark.long
def test_inputs_and_outputs_change_no_other_answer(tmp_path):
    text = (ROOT / "models" / "whipple_bicycle.yaml").read_text(encoding="utf-8")
    plain = text[: text.index("inputs:")] + text[text.index("reference:") :]
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    answers = []
    for folder, content in (("a", text), ("b", plain)):
        path = tmp_path / folder / "m.yaml"
        path.write_text(content, encoding="utf-8")
        answers.append(
            [
                run(*command, str(path)).stdout.replace(str(path), "")
                for command in (
                    ["eig", "--format", "json"],
                    ["check"],
                    ["linearize"],
                    ["sweep", "--points", "5", "--param", "v"],
                )
            ]
        )
        answers[-1].append(mbstab.load(path).simulate(0.1).q.tobytes())
    assert answers[0] == answers[1]
    assert all(answers[0])


def test_files_hold_the_matrices_where_they_are_looked_for(tmp_path):
    from scipy.io import loadmat

    model = mbstab.load("wheeled_inverted_pendulum.yaml")
    known = model.state_space()
    data = json.loads(run("linearize", "wheeled_inverted_pendulum.yaml", "--format", "json").stdout)
    assert [x["name"] for x in data["inputs"]] == ["wheel_torque"]
    assert [x["unit"] for x in data["outputs"]] == ["m", "rad"]
    for kind in ("npz", "mat"):
        goal = tmp_path / f"m.{kind}"
        assert run("linearize", "wheeled_inverted_pendulum.yaml", "--format", kind, "-o", str(goal)).exit_code == 0
        arrays = np.load(goal) if kind == "npz" else loadmat(goal, squeeze_me=False)
        for name in "ABCD":
            np.testing.assert_array_equal(arrays[name], getattr(known, name))
            np.testing.assert_array_equal(np.array(data["state-space"][name]), getattr(known, name))
        assert arrays["A_descriptor"].shape == known.descriptor.A.shape
        assert "E" not in arrays
    text = run("linearize", "wheeled_inverted_pendulum.yaml", "--format", "latex").stdout
    assert text.count(r"\begin{equation}") == text.count(r"\end{equation}") == 7
    assert r"\text{wheel\_torque}" in text


def test_as_a_model_of_scipy_and_of_python_control():
    known = mbstab.load("whipple_bicycle.yaml").state_space(WHIPPLE)
    scipy = known.to_scipy()
    np.testing.assert_array_equal(scipy.A, known.A)
    if importlib.util.find_spec("control") is None:
        with pytest.raises(UsageError, match="pip install control"):
            known.to_control()
        return
    system = known.to_control()
    assert list(system.input_labels) == ["roll_torque", "steer_torque"]
    for omega in (0.1, 1.0, 10.0):
        np.testing.assert_allclose(system(1j * omega), transfer(known, 1j * omega), rtol=1e-10)


def test_a_model_without_inputs_cannot_be_exported():
    with pytest.raises(UsageError, match="declares no inputs"):
        mbstab.load("pendulum.yaml").state_space().to_scipy()


def test_the_control_model_is_built_only_where_it_is_asked_for(monkeypatch):
    asked = []
    own = state_space.control_model
    monkeypatch.setattr("mbstab.analysis.response.state_space.control_model", lambda *x: asked.append(x) or own(*x))
    for form in ("equations", "composite"):
        assert run("linearize", "pendulum.yaml", "--form", form).exit_code == 0
    assert not asked
    # Inputs and outputs are checked whatever is shown.
    for arguments in (
        ("pendulum.yaml", "--form", "pencil"),
        ("whipple_bicycle.yaml",),
        ("pendulum.yaml", "--format=json"),
    ):
        assert run("linearize", *arguments).exit_code == 0
    assert len(asked) == 3


GUIDED = """\
mbstab: 1
bodies: {b: {type: planar, mass: 2, inertia: 1, points: {tip: [1, 0]}}}
joints: {guide: {type: prismatic, between: [b, ground], axis: x}}
forces: {s: {type: joint_spring, joint: guide, stiffness: 50, damping: 1}}
inputs: {push: {type: force, at: b.tip, direction: y}}
outputs: {place: b.x, support: force(guide.y), moment: torque(guide.z)}
reference: {}
"""


def test_an_input_that_a_guide_holds_is_felt_by_its_reactions_at_once():
    found = mbstab.loads(GUIDED).state_space()
    np.testing.assert_array_equal(found.B, 0.0)
    np.testing.assert_allclose(np.abs(transfer(found, 2j)).ravel(), [0.0, 1.0, 1.0], rtol=1e-14)
    place, support, moment = answer(found, points=5).values
    np.testing.assert_array_equal(place, 0.0)
    np.testing.assert_allclose(np.abs([support, moment]), 1.0, rtol=1e-13)
    with pytest.raises(ModelFileError, match=r"inputs.push: the input moves nothing: joint 'guide' prescribes"):
        mbstab.loads(GUIDED.replace(", support: force(guide.y), moment: torque(guide.z)", "")).state_space()


def test_rounding_of_a_slanting_guide_is_no_motion():
    slanting = GUIDED.replace("axis: x", "axis: [0.28, 0.96]").replace("direction: y", "direction: [-0.96, 0.28]")
    np.testing.assert_array_equal(mbstab.loads(slanting).state_space().B, 0.0)


def test_rounding_of_the_map_from_states_is_no_entry_of_the_state_space():
    """Torque and its rate are states here in the place of a speed, and the map from them is badly conditioned."""
    text = """\
mbstab: 1
bodies: {a: {type: planar, mass: 1, inertia: 0.03}, b: {type: planar, mass: 1, inertia: 0.03}}
joints:
  one: {type: revolute, between: [a, ground]}
  two: {type: revolute, between: [b, ground]}
forces:
  shaft: {type: expression, on: {a.theta: "-300*(a.theta - b.theta) - c", b.theta: 300*(a.theta - b.theta)}}
states: {c: {rate: (4e4*rate(a.theta) - c)/0.002 + 1e3*b.theta}}
outputs: {one: a.theta, two: rate(b.theta), three: c}
"""
    model = mbstab.loads(text).state_space(["a.theta", "b.theta", "c", "rate(b.theta)", "rate(c)"])
    for matrix in (model.A, model.C, model.to_coordinates, model.to_rates):
        rows = abs(matrix)[abs(matrix).max(axis=1) > 0]
        assert ((rows == 0.0) | (rows > 1e-12 * rows.max(axis=1, keepdims=True))).all()
    assert (model.C != 0.0).sum() == 3
