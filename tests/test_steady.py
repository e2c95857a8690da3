"""Steady motions: generators and their frames, what breaks a symmetry, and closed forms of relative equilibria."""

import math
import random
import re

import numpy as np
import pytest
from chains import spinning_chain
from scipy.optimize import linear_sum_assignment

import mbstab
import mbstab.errors
from mbstab.analysis.reference.motion import Finder
from mbstab.analysis.reference.steady import Generator, detected
from mbstab.errors import ModelFileError
from mbstab.model.library import installed_models

MODELS = {path.stem: path for path in installed_models()}
G = 9.81


def eigenvalues(text, frozen=False, **parameters):
    """Return the eigenvalues that are not neutral, by imaginary part, and the answer."""
    result = mbstab.loads(text, "model.yaml").eig(frozen=frozen, **parameters)
    found = sorted((e.value for e in result.eigenvalues if e.kind != "neutral"), key=lambda s: (s.imag, s.real))
    return found, result


def frequencies(text, **parameters):
    found, result = eigenvalues(text, **parameters)
    assert max((abs(s.real) for s in found), default=0.0) < 1e-9 * max((abs(s) for s in found), default=1.0)
    return [s.imag for s in found if s.imag > 0.0], result


def refusal(text, **parameters):
    with pytest.raises(ModelFileError) as caught:
        mbstab.loads(text, "model.yaml").eig(**parameters)
    return str(caught.value)


# --- the field and its frame ----------------------------------------------------------------------------------------

SPATIAL = """
mbstab: 1
bodies:
  a: {type: spatial, mass: 1, inertia: [1, 2, 2.5]}
  b: {type: spatial, mass: 2, inertia: [0.3, 0.3, 0.2], axes: [0.7, -0.4, 1.9]}
  p: {type: point, mass: 1}
"""

PLANAR = """
mbstab: 1
bodies:
  a: {type: planar, mass: 1, inertia: 1}
  p: {type: planar_point, mass: 1}
"""


def combined(text, seed, turn=True):
    """Return a turn, translation and spins of a scene, and a state of it."""
    rng = np.random.default_rng(seed)
    system = mbstab.loads(text).system()
    planar = system.scene.dimension == 2
    axis = np.array([0.0, 0.0, 1.0]) if planar else rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    point, velocity = rng.normal(size=3), rng.normal(size=3)
    if planar:
        point[2] = velocity[2] = 0.0
    spins = np.array([2.3 if name in ("a.psi", "b.psi") else 0.0 for name in system.names])
    q = rng.uniform(-1.0, 1.0, system.n_q)
    return Generator(system, axis, point, 1.7 if turn else 0.0, velocity, spins), q


CASES = [(SPATIAL, 1), (SPATIAL, 2), (SPATIAL, 3), (PLANAR, 1), (PLANAR, 2)]


def derivative(function, step=1e-3):
    """Return the derivative at 0 by central differences of order 6."""
    weights = ((1, 3.0 / 4.0), (2, -3.0 / 20.0), (3, 1.0 / 60.0))
    return sum(w * (function(k * step) - function(-k * step)) for k, w in weights) / step


@pytest.mark.parametrize(("text", "seed"), CASES)
@pytest.mark.parametrize("turn", [True, False])
def test_the_field_is_the_velocity_of_the_flow(text, seed, turn):
    generator, q = combined(text, seed, turn)
    found = derivative(lambda t: generator.flow(q, t)[0])
    np.testing.assert_allclose(generator.field(q), found, rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(
        generator.acceleration(q), derivative(lambda t: generator.field(generator.flow(q, t)[0])), atol=1e-9, rtol=1e-10
    )


@pytest.mark.parametrize(("text", "seed"), CASES)
def test_the_frame_is_made_of_the_derivatives_of_the_field(text, seed):
    generator, q = combined(text, seed)
    Xi, Xi_2 = generator.frame(q)
    columns = np.eye(len(q))
    slope = np.column_stack([derivative(lambda h, e=e: generator.field(q + h * e)) for e in columns])
    np.testing.assert_allclose(Xi, slope, rtol=1e-9, atol=1e-9)
    X = generator.field(q)
    growth = derivative(lambda h: generator.frame(q + h * X)[0])
    np.testing.assert_allclose(Xi_2, slope @ slope + growth, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize(("text", "seed"), CASES)
@pytest.mark.parametrize("turn", [True, False])
def test_flows_make_a_group(text, seed, turn):
    generator, q = combined(text, seed, turn)
    first, T_first = generator.flow(q, 0.11)
    second, T_second = generator.flow(first, 0.07)
    at_once, T = generator.flow(q, 0.18)
    np.testing.assert_allclose(second, at_once, atol=1e-13)
    np.testing.assert_allclose(T_second @ T_first, T, atol=1e-12)
    back, _ = generator.flow(at_once, -0.18)
    np.testing.assert_allclose(back, q, atol=1e-13)


@pytest.mark.parametrize(("text", "seed"), CASES)
def test_the_derivative_of_the_flow(text, seed):
    generator, q = combined(text, seed)
    _, T = generator.flow(q, 0.15)
    columns = [derivative(lambda h, e=e: generator.flow(q + h * e, 0.15)[0]) for e in np.eye(len(q))]
    np.testing.assert_allclose(T, np.column_stack(columns), atol=1e-9)
    # The field is carried into itself.
    moved, _ = generator.flow(q, 0.15)
    np.testing.assert_allclose(T @ generator.field(q), generator.field(moved), atol=1e-12)


def test_a_turn_keeps_distances_and_turns_orientations():
    generator, q = combined(SPATIAL, 4)
    moved, _ = generator.flow(q, 0.2)
    places = [slice(0, 3), slice(6, 9), slice(12, 15)]
    for one in places:
        for other in places:
            before, after = (np.linalg.norm(x[one] - x[other]) for x in (q, moved))
            assert abs(before - after) < 1e-14


# --- detection ------------------------------------------------------------------------------------------------------


def found_in(text, u):
    system = mbstab.loads(text).system()
    q = np.zeros(system.n_q)
    for name, value in system.scene.coordinates.items():
        q[system.names.index(name)] = value
    return system, q, detected(system, q, u(system, q), Finder(system).sizes)


def test_a_state_at_rest_has_only_the_trivial_generator():
    _, _, found = found_in(PLANAR, lambda system, q: 0.0 * q)
    assert [str(x) for x in found] == ["rest"]
    assert not found[0].turns


def test_a_turn_about_a_point_is_seen_as_one():
    text = PLANAR + "reference: {coordinates: {a: {x: 2, y: 1}, p: {x: -1, y: 3}}}"
    point = np.array([0.5, -0.25])

    def speeds(system, q):
        return np.array(
            [-3 * (q[1] - point[1]), 3 * (q[0] - point[0]), 3, -3 * (q[4] - point[1]), 3 * (q[3] - point[0])]
        )

    _, _, found = found_in(text, speeds)
    assert not found[0].turns
    assert len({str(x) for x in found[1:]}) == 1
    assert abs(found[1].rate - 3.0) < 1e-13
    np.testing.assert_allclose(found[1].point[:2], point, atol=1e-13)
    np.testing.assert_allclose(found[1].velocity, 0.0, atol=1e-13)
    assert str(found[1]) == "rotation about z through (0.5, -0.25, 0) m at 3 rad/s"


def test_a_helix_along_gravity_is_a_turn_with_a_translation():
    text = (
        SPATIAL
        + "gravity: [0, 0, -9.81]\nreference: {coordinates: {a: {x: 1}, b: {x: -1, y: 0.5, phi: 0.2}, p: {y: 2, z: 1}}}"
    )
    system = mbstab.loads(text).system()
    up = np.array([0.0, 0.0, 1.0])
    given = Generator(system, up, np.zeros(3), -2.0, 0.3 * up, np.zeros(system.n_q))
    _, q, found = found_in(text, lambda system, q: given.field(q))
    assert len({str(x) for x in found[1:]}) == 1
    np.testing.assert_allclose(found[1].field(q), given.field(q), atol=1e-13)
    assert abs(found[1].rate + 2.0) < 1e-13
    np.testing.assert_allclose(found[1].velocity, [0.0, 0.0, 0.3], atol=1e-13)


def test_spins_about_axes_of_symmetry_are_told_from_the_turn():
    text = SPATIAL + "reference: {coordinates: {a: {x: 1}, b: {x: -1, y: 0.5, phi: 0.2}, p: {y: 2, z: 1}}}"
    system = mbstab.loads(text).system()
    axis = np.array([1.0, 0.0, 0.0])
    spins = np.array([7.0 * (name == "b.psi") for name in system.names])
    given = Generator(system, axis, np.zeros(3), 2.0, np.zeros(3), spins)
    _, q, found = found_in(text, lambda system, q: given.field(q))
    turning = [x for x in found if x.turns]
    assert turning
    assert all(np.allclose(x.field(q), given.field(q), atol=1e-12) for x in turning)
    assert any(abs(x.rate - 2.0) < 1e-12 and np.allclose(x.spins, spins, atol=1e-12) for x in turning)
    # The other body has three different moments of inertia: its own spin is no symmetry.
    other = Generator(system, axis, np.zeros(3), 2.0, np.zeros(3), np.roll(spins, -6))
    _, _, found = found_in(text, lambda system, q: other.field(q))
    assert not any(x.turns and np.any(x.spins) for x in found)


def test_bodies_that_spin_about_one_axis_give_one_turn():
    motion = mbstab.loads(spinning_chain(4)).linearize().motion
    assert list(map(str, motion.generators[1:])) == ["rotation about z at 100 rad/s"]


def test_speeds_that_follow_no_turn_are_left_alone():
    _, _q, found = found_in(PLANAR, lambda system, q: np.array([1.0, 2.0, 3.0, 4.0, 5.5]))
    rates = [x.rate for x in found]
    assert rates[0] == 0.0
    text = PLANAR.replace("planar_point, mass: 1}", "planar_point, mass: 1}\n  r: {type: planar_point, mass: 1}")
    text += "reference: {coordinates: {p: {x: 1}, r: {y: 1}}}"
    _, _, found = found_in(text, lambda system, q: np.array([1.0, 2.0, 3.0, 4.0, 5.5, 0.0, 0.7]))
    assert [x.turns for x in found] == [False]


# --- declared motions that are none ---------------------------------------------------------------------------------

CIRCLE = """\
mbstab: 1
parameters: {Omega: 3, m: 2, r: 0.5}
bodies:
  bob: {type: planar_point, mass: m}
joints:
  string: {type: distance, between: [bob, ground], length: r}
reference:
  coordinates: {bob: {x: r, y: 0}}
  steady: {axis: z, rate: Omega}
"""


def test_a_mass_on_a_string_goes_round_in_a_circle():
    found, result = eigenvalues(CIRCLE)
    assert found == []
    assert result.frame == "rotation about z at 3 rad/s"
    motion = mbstab.loads(CIRCLE).motion()
    np.testing.assert_allclose(motion.u, [0.0, 1.5], atol=1e-15)
    np.testing.assert_allclose(motion.a, [-4.5, 0.0], atol=1e-15)


def test_a_declared_motion_that_is_none_is_refused_with_the_force_that_lacks():
    text = CIRCLE.replace("joints:\n  string: {type: distance, between: [bob, ground], length: r}\n", "")
    message = refusal(text)
    assert message.startswith("model.yaml:5:1: reference: ")
    assert "no steady motion (rotation about z at 3 rad/s)" in message
    assert "bob.x would accelerate with 4.5 m/s^2" in message
    assert "unbalanced 9 N" in message  # what has to be added is −m r Ω²; it accelerates relative to the circle


def test_a_declared_motion_that_its_joints_do_not_allow_is_refused():
    text = CIRCLE.replace("joints:", "joints:\n  rail: {type: point_on_line, between: [ground, bob], axis: x}")
    message = refusal(text)
    assert "rail" in message
    assert "string" not in message.split("hint")[0]
    assert re.match(r"model\.yaml:6:\d+: joints\.rail", message)


BREAKING = """\
mbstab: 1
parameters: {{Omega: 3}}
{more}
bodies:
  hub: {{type: spatial, mass: 1, inertia: [0.1, 0.1, 0.1]}}
  arm: {{type: spatial, mass: 2, inertia: [0.01, 0.2, 0.2], points: {{root: [-0.5, 0, 0]}}}}
joints:
  bearing: {{type: revolute, between: [hub, ground], axis: z}}
  weld: {{type: fixed, between: [arm.root, hub]}}
  {joint}
forces:
  friendly: {{type: spring, between: [hub, arm], stiffness: 7, damping: 0.1}}
  {force}
reference:
  coordinates:
    hub: {{x: 0, y: 0, z: 0, phi: 0, theta: 0, psi: 0}}
    arm: {{x: 0.5, y: 0, z: 0, phi: 0, theta: 0, psi: 0}}
  steady: {{axis: z, rate: Omega}}
"""


def breaking(more="", joint="", force=""):
    return BREAKING.format(more=more, joint=joint, force=force)


def broken_by(message):
    """Return the entries that a message says break the symmetry."""
    found = re.search(r"the symmetry is broken by ([^\n]*)", message)
    assert found, message
    return set(found[1].split(", "))


def test_the_same_scene_with_nothing_that_breaks_it_is_judged():
    found, result = eigenvalues(breaking())
    assert found == []
    assert sum(e.kind == "neutral" for e in result.eigenvalues) == 2
    assert result.frame == "rotation about z at 3 rad/s"


def test_gravity_across_the_axis_breaks_the_symmetry_of_the_bodies_only():
    message = refusal(breaking("gravity: [-9.81, 0, 0]"))
    assert broken_by(message) == {"bodies.hub", "bodies.arm"}
    assert re.match(r"model\.yaml:\d+:\d+: reference\.steady: ", message)


def test_gravity_along_the_axis_breaks_nothing():
    eigenvalues(breaking("gravity: [0, 0, -9.81]"))


def test_a_spring_to_the_ground_off_the_axis_breaks_the_symmetry():
    text = breaking(
        "ground: {points: {P: [1, 0, 0]}}", force="tether: {type: spring, between: [arm, ground.P], stiffness: 5}"
    )
    assert broken_by(refusal(text)) == {"forces.tether"}
    eigenvalues(text.replace("ground.P]", "ground]"))


def test_a_second_joint_to_the_ground_breaks_the_symmetry():
    # The sideways plane touches the arm at this instant only, in its velocity it does not.
    text = CIRCLE.replace(
        "bob: {type: planar_point, mass: m}",
        "bob: {type: planar_point, mass: m}\n  other: {type: planar_point, mass: 1}",
    )
    text = text.replace("joints:", "joints:\n  rail: {type: point_on_line, between: [ground, other], axis: x}")
    message = refusal(text.replace("{bob: {x: r, y: 0}}", "{bob: {x: r, y: 0}, other: {x: 0, y: 0}}"))
    assert "rail" in message
    assert "string" not in message


def test_a_time_law_that_does_not_follow_the_turn_breaks_it():
    text = breaking(force="push: {type: force, at: arm, vector: [10*cos(Omega*t), 10*sin(Omega*t), 0]}")
    eigenvalues(text)  # it goes round with the arm
    text = breaking(force="push: {type: force, at: arm, vector: [10, 0, 0]}")
    assert broken_by(refusal(text)) == {"forces.push"}


# --- rates ----------------------------------------------------------------------------------------------------------

TOP = """\
mbstab: 1
parameters: {{H: 0.05, m: 0.3, A: 4e-4, C: 2.5e-4, theta: 0.4, Omega: 12}}
gravity: [0, 0, -9.81]
bodies:
  top: {{type: spatial, mass: m, inertia: [A, A, C], points: {{O: [0, 0, -H]}}}}
joints:
  tip: {{type: spherical, between: [top.O, ground]}}
reference:
  coordinates: {{top: {{phi: 0, theta: theta, psi: 0}}}}
  guess: {{top: {{x: H*sin(theta), z: H*cos(theta)}}}}
  steady: {{axis: z, rate: Omega}}
  {rates}
"""


def spin_of_top(theta, Omega, A_tip, C, mgH):
    """Return ψ̇ of steady precession: mgH = C(ψ̇ + Ω cos θ)Ω − A Ω² cos θ."""
    return (mgH + A_tip * Omega**2 * math.cos(theta)) / (C * Omega) - Omega * math.cos(theta)


def test_a_spin_that_nothing_determines_must_be_given_by_name():
    message = refusal(TOP.format(rates=""))
    assert "the constraints do not determine rates.top.psi of the steady motion" in message
    assert message.startswith("model.yaml:8:1: reference: ")


def test_a_given_rate_that_the_steady_motion_has_not_is_refused():
    text = CIRCLE + "  rates: {bob: {y: 2}}\n"
    message = refusal(text)
    assert "the rate of bob.y is given as 2 m/s" in message
    assert "has 1.5" in message
    eigenvalues(CIRCLE + "  rates: {bob: {y: 1.5}}\n")


def test_a_rate_that_is_not_given_follows_from_a_drive():
    text = breaking(force="").replace(
        "forces:", "drives:\n  spin: {type: joint, joint: bearing, velocity: Omega}\nforces:"
    )
    _, result = eigenvalues(text.replace("steady: {axis: z, rate: Omega}", "steady: {axis: z}"))
    assert result.frame == "rotation about z at 3 rad/s"


@pytest.mark.parametrize(
    ("reference", "at", "words"),
    [
        ("{steady: {rate: 3}}", "3}", "rate needs axis"),
        ("{steady: {speed: 4}}", "4}", "speed needs direction"),
        ("{steady: {point: [0, 5]}}", "[0,", "point needs axis"),
        ("{steady: {}}", "{}", "give an axis of the turn, a direction of the translation, or both"),
        ("{find: steady}", "steady", "a steady motion needs its symmetry"),
        ("{find: equilibrium, steady: {axis: z}}", "equilibrium", "an equilibrium is at rest"),
        ("{find: motion}", "motion", "'motion'"),
        ("{find: equilibrium, period: 2}", "2", "the period belongs to a motion that is neither"),
        ("{steady: {axis: z}, period: 2}", "2", "the period belongs to a motion that is neither"),
        ("{steady: {axis: x, rate: 3}}", "x,", "'x'"),
        ("{steady: {axis: z, turns: 3}}", "turns", "unknown key"),
        ("{steady: {direction: [0, 0], speed: 3}}", "[0", "direction"),
        ("{period: -2}", "-2", "the period must be positive"),
    ],
)
def test_mistakes_in_the_search_are_placed(reference, at, words):
    line = f"reference: {reference}"
    message = refusal(f"{line}\nmbstab: 1\nbodies: {{p: {{type: planar_point, mass: 1}}}}\n")
    (found,) = [text for text in message.splitlines() if text.startswith("model.yaml:") and words in text]
    assert found.startswith(f"model.yaml:1:{line.index(at) + 1}: reference.")


# --- frozen ---------------------------------------------------------------------------------------------------------


def test_the_rotating_pendulum_is_judged_in_its_frame_and_frozen_numbers_are_not():
    model = mbstab.load(MODELS["rotating_pendulum"])
    turning, frozen = model.eig(), model.eig(frozen=True)
    assert abs(turning.eigenvalues[0].value.imag - 7.61480424896136) < 1e-13
    assert turning.verdict == "stable"
    assert not turning.frozen
    assert turning.frame.startswith("rotation about z")
    assert frozen.frozen
    assert frozen.frame == ""
    assert frozen.verdict == "undecided"
    np.testing.assert_allclose(sorted(e.value.imag for e in frozen.eigenvalues), [-8.0, 8.0], rtol=1e-13)
    assert any("froz" in reason for reason in frozen.reasons)


# --- relative equilibria with closed forms --------------------------------------------------------------------------


@pytest.mark.parametrize("slope", [0.3, 1.0])
def test_a_mass_circles_in_a_smooth_cone(slope):
    # z = r cot β: at the radius r the rate is Ω² = g cot β / r, and small motions have ω² = 3 Ω² sin² β.
    r, cot = 0.4, 1.0 / math.tan(slope)
    text = f"""
mbstab: 1
gravity: [0, 0, -9.81]
bodies:
  p: {{type: point, mass: 0.7}}
constraints:
  cone: {{holonomic: p.z - {cot}*sqrt(p.x**2 + p.y**2)}}
reference:
  find: steady
  steady: {{axis: z}}
  coordinates: {{p: {{x: {r}, y: 0}}}}
  guess: {{p: {{z: {r * cot}}}}}
"""
    Omega = math.sqrt(G * cot / r)
    model = mbstab.loads(
        text.replace("axis: z", f"axis: z, rate: {Omega}")
        .replace("x: 0.4, y: 0", "y: 0")
        .replace("{p: {z:", "{p: {x: 0.5, z:")
    )
    assert abs(model.motion().q[0] - r) < 1e-14
    result = model.eig()
    found = sorted(e.value.imag for e in result.eigenvalues if e.kind != "neutral")
    expected = math.sqrt(3.0) * Omega * math.sin(slope)
    np.testing.assert_allclose(found, [-expected, expected], rtol=1e-12)
    assert sum(e.kind == "neutral" for e in result.eigenvalues) == 2


def test_a_given_rate_or_a_rate_that_is_solved_lead_to_the_same_motion():
    text = """
mbstab: 1
gravity: [0, 0, -9.81]
bodies:
  p: {type: point, mass: 0.7}
constraints:
  cone: {holonomic: p.z - 2*sqrt(p.x**2 + p.y**2)}
reference:
  find: steady
  steady: {axis: z}
  coordinates: {p: {x: 0.4, y: 0, z: 0.8}}
  rates: {p: {y: 3}}
"""
    with pytest.raises(mbstab.errors.MbstabError):
        mbstab.loads(text).motion()  # 3 m/s is not the speed of this circle
    motion = mbstab.loads(text.replace("y: 3}", f"y: {0.4 * math.sqrt(2.0 * G / 0.4)}}}")).motion()
    np.testing.assert_allclose(motion.u, [0.0, math.sqrt(0.8 * G), 0.0], atol=1e-14)


def conical_pendulum(theta, length):
    Omega = math.sqrt(G / (length * math.cos(theta)))
    # Two frequencies: ω² = Ω²(1 + 3 cos² θ), and the shift in azimuth, which is neutral.
    return Omega, Omega * math.sqrt(1.0 + 3.0 * math.cos(theta) ** 2)


@pytest.mark.parametrize("theta", [0.2, 0.9])
def test_a_conical_pendulum_of_a_point(theta):
    Omega, expected = conical_pendulum(theta, 0.8)
    text = f"""
mbstab: 1
gravity: [0, 0, -9.81]
bodies:
  p: {{type: point, mass: 0.7}}
joints:
  string: {{type: distance, between: [p, ground], length: 0.8}}
reference:
  find: steady
  steady: {{axis: z, rate: {Omega}}}
  coordinates: {{p: {{y: 0}}}}
  guess: {{p: {{x: {0.9 * math.sin(theta)}, z: {-0.7 * math.cos(theta)}}}}}
"""
    motion = mbstab.loads(text).motion()
    np.testing.assert_allclose(motion.q, [0.8 * math.sin(theta), 0.0, -0.8 * math.cos(theta)], atol=1e-14)
    found, result = frequencies(text)
    np.testing.assert_allclose(found, [expected], rtol=1e-12)
    assert sum(e.kind == "neutral" for e in result.eigenvalues) == 2


HANGING = """
mbstab: 1
parameters: {Omega: 4}
gravity: [0, 0, -9.81]
bodies:
  bob: {type: point, mass: 0.3}
joints:
  string: {type: distance, between: [bob, ground], length: 1.2}
reference:
  find: steady
  steady: {axis: z, rate: Omega}
  coordinates: {bob: {y: 0}}
  guess: {bob: {x: 0.6, z: -1.2}}
"""


def test_a_steady_motion_that_moves_nothing_is_judged_as_a_rest():
    model = mbstab.loads(HANGING)
    result = model.eig()
    # Turned at any rate, it is the pendulum of the ground: its energy has a minimum where it hangs.
    w = math.sqrt(G / 1.2)
    found = sorted(abs(e.value.imag) for e in result.eigenvalues)
    np.testing.assert_allclose(found, [4 - w, 4 - w, 4 + w, 4 + w], rtol=1e-12)
    assert result.verdict == "stable"
    assert result.in_place
    assert not any("gyroscopic" in text for text in result.warnings)
    (text,) = (text for text in result.warnings if "does not move anything" in text)
    assert "bob.z = -1.2 m" in text
    assert "mbstab equilibrium --starts" in text
    assert model.eig(Omega=2).verdict == "stable"
    swept = model.sweep("Omega", np.linspace(2.0, 8.0, 13))
    assert set(swept.verdicts) == {"stable"}


BOWL = """
mbstab: 1
parameters: {Omega: 4, c: 0, inner: 0}
gravity: [0, 0, -9.81]
bodies:
  ball: {type: point, mass: 0.3}
constraints:
  bowl: {holonomic: "ball.z - (ball.x**2 + ball.y**2)"}
forces:
  still: {type: expression, on: {ball.x: -c*rate(ball.x), ball.y: -c*rate(ball.y)}}
  turning:
    type: expression
    on: {ball.x: -inner*(rate(ball.x) + Omega*ball.y), ball.y: -inner*(rate(ball.y) - Omega*ball.x)}
reference:
  steady: {axis: z, rate: Omega}
  coordinates: {ball: {x: 0, y: 0, z: 0}}
"""


@pytest.mark.few(1)
@pytest.mark.parametrize(("c", "inner"), [(0, 0), (0.1, 0), (0, 0.1), (0.1, 0.3), (-0.05, 0)])
def test_damping_in_either_frame_decides_about_a_ball_on_the_axis_of_a_turning_bowl(c, inner):
    model = mbstab.loads(BOWL).at(c=c, inner=inner)
    rates = np.array([1.0, 4.0, 6.0, 20.0])
    # z = x + iy on the ground: m z'' + (c + c_i) z' + (k - i c_i Ω) z = 0, seen from the frame as z e^(-iΩt).
    roots = [np.roots([0.3, c + inner, 0.6 * G - 1j * inner * rate]) for rate in rates]
    growth = np.array([np.max(x.real) for x in roots])
    words = ["stable" if not (c or inner) else "unstable" if x > 0.0 else "asymptotically stable" for x in growth]
    assert [model.eig(Omega=rate).verdict for rate in rates] == words
    assert list(model.sweep("Omega", rates[2:]).verdicts) == words[2:]
    result = model.eig(Omega=rates[2])
    found = np.array([e.value for e in result.eigenvalues])
    for root in roots[2] - 1j * rates[2]:
        assert np.min(np.abs(found - root)) < 1e-12 * abs(root)


def top_on_its_tip(theta, Omega, A, C, m, H):
    """Return ψ̇ and the nutation frequency of a heavy top, from its energy with one degree of freedom θ.

    V(θ) = (p_φ − p_ψ cos θ)²/(2 A sin² θ) + m g H cos θ with the momenta of the steady precession: A θ̈ = −V′.
    """
    A_tip = A + m * H**2
    spin = spin_of_top(theta, Omega, A_tip, C, m * G * H)
    p_psi = C * (spin + Omega * math.cos(theta))
    p_phi = A_tip * Omega * math.sin(theta) ** 2 + p_psi * math.cos(theta)
    c, s = math.cos(theta), math.sin(theta)
    gap = p_phi - p_psi * c
    # V″, with gap′ = p_ψ s.
    curvature = (p_psi**2 * s**2 + gap * p_psi * c) / s**2 - 4.0 * gap * p_psi * c / s**2
    curvature += gap**2 * (2.0 * c**2 + 1.0) / s**4 - m * G * H * c * A_tip
    return spin, math.sqrt(curvature) / A_tip


def test_the_curvature_of_the_effective_potential_is_right():
    from mpmath import mp

    theta, Omega, A, C, m, H = 0.4, 12.0, 4e-4, 2.5e-4, 0.3, 0.05
    with mp.workdps(30):
        A_tip = A + m * H**2
        spin, nutation = top_on_its_tip(theta, Omega, A, C, m, H)
        p_psi = C * (spin + Omega * mp.cos(theta))
        p_phi = A_tip * Omega * mp.sin(theta) ** 2 + p_psi * mp.cos(theta)

        def V(x):
            return (p_phi - p_psi * mp.cos(x)) ** 2 / (2 * A_tip * mp.sin(x) ** 2) + m * G * H * mp.cos(x)

        assert abs(mp.diff(V, theta)) < 1e-13
        assert abs(mp.sqrt(mp.diff(V, theta, 2) / A_tip) - nutation) < 1e-9


@pytest.mark.parametrize(("theta", "Omega"), [(0.4, 12.0), (0.9, 6.0), (1.2, -20.0)])
@pytest.mark.parametrize("find", [False, True])
def test_a_top_in_steady_precession(theta, Omega, find):
    A, C, m, H = 4e-4, 2.5e-4, 0.3, 0.05
    spin, nutation = top_on_its_tip(theta, Omega, A, C, m, H)
    text = TOP.format(rates=f"rates: {{top: {{psi: {spin!r}}}}}")
    # Tilted by theta about x, as psi of the Euler angles X-Y-Z turns about the axis of the top.
    text = text.replace("phi: 0, theta: theta, psi: 0", "phi: theta, theta: 0, psi: 0")
    text = text.replace(
        "guess: {top: {x: H*sin(theta), z: H*cos(theta)}}", "guess: {top: {y: -H*sin(theta), z: H*cos(theta)}}"
    )
    if find:
        text = text.replace("reference:", "reference:\n  find: steady")
    # The rate of psi is the spin about the axis of the top, besides what the turn does to it: with phi = θ and
    # theta = 0 the turn about z moves the Euler angles with rates (0, Ω sin θ, Ω cos θ).
    text = text.replace(f"psi: {spin!r}", f"psi: {spin + Omega * math.cos(theta)!r}")
    found, result = frequencies(text, theta=theta, Omega=Omega)
    np.testing.assert_allclose(found, [nutation], rtol=1e-10)
    # Precession and spin may be shifted in angle and rate.
    assert sum(e.kind == "neutral" for e in result.eigenvalues) == 4


def test_two_masses_and_a_spring_circle_each_other():
    m1, m2, k, free, Omega = 1.0, 2.5, 90.0, 0.4, 4.0
    mu = m1 * m2 / (m1 + m2)
    text = f"""
mbstab: 1
bodies:
  a: {{type: planar_point, mass: {m1}}}
  b: {{type: planar_point, mass: {m2}}}
forces:
  spring: {{type: spring, between: [a, b], stiffness: {k}, length: {free}}}
reference:
  find: steady
  steady: {{axis: z, rate: {Omega}}}
  guess: {{a: {{x: 0.3, y: 0.05}}, b: {{x: -0.12}}}}
"""
    length = k * free / (k - mu * Omega**2)
    motion = mbstab.loads(text).motion()
    a, b = motion.q[:2], motion.q[2:]
    assert abs(math.hypot(*(a - b)) - length) < 1e-13
    np.testing.assert_allclose(m1 * a + m2 * b, 0.0, atol=1e-13)
    found, result = frequencies(text)
    np.testing.assert_allclose(found[-1], math.sqrt(k / mu + 3.0 * Omega**2), rtol=1e-11)
    # What is left are the shift of both and its speed (±Ω seen from the turning axes), and the turn with its rate.
    assert len(found) == 1
    assert sum(e.kind == "neutral" for e in result.eigenvalues) == 6
    assert sorted(round(abs(e.value.imag), 9) for e in result.eigenvalues if e.kind == "neutral") == [0, 0, 4, 4, 4, 4]
    assert result.verdict == "stable up to symmetry"


def test_a_mass_turned_by_a_string_about_another_point():
    # As about the origin: the turn itself is the symmetry that explains the two zeros.
    text = """
mbstab: 1
gravity: [0, 0, -9.81]
ground: {points: {P: [1, 2, 0]}}
bodies:
  p: {type: point, mass: 1}
joints:
  string: {type: distance, between: [p, ground.P], length: 1}
reference: {find: steady, steady: {axis: z, rate: 6, point: [1, 2, 0]}, guess: {p: {x: 1.9, y: 2, z: -0.4}}}
"""
    found, result = frequencies(text)
    theta = math.acos(G / 36.0)
    np.testing.assert_allclose(found, [6.0 * math.sqrt(1.0 + 3.0 * math.cos(theta) ** 2)], rtol=1e-12)
    assert result.verdict == "stable up to symmetry"


def test_a_turn_about_another_axis_than_gravity_explains_its_zeros():
    text = """
mbstab: 1
gravity: [0, 0, -9.81]
bodies:
  rotor: {type: spatial, mass: 2, inertia: [0.1, 0.1, 0.1]}
joints:
  bearing: {type: revolute, between: [rotor, ground], axis: [[1, 0, 1], [1, 0, 1]]}
reference: {find: steady, steady: {axis: [1, 0, 1], rate: 3}}
"""
    _, result = eigenvalues(text)
    assert (result.counts.neutral, result.verdict) == (2, "stable up to symmetry")


# Linear springs have the same stiffness everywhere, so the coefficients do not tell that these are no steady motions.
OFF_THE_AXIS = """
mbstab: 1
ground: {points: {P: [0.2, 0]}}
bodies:
  p: {type: planar_point, mass: 1}
forces:
  spring: {type: spring, between: [p, ground.P], stiffness: 20, length: 0}
reference: {coordinates: {p: {x: 0.25, y: 0}}, steady: {axis: z, rate: 2}}
"""

ALONG = """
mbstab: 1
bodies:
  p: {type: planar_point, mass: 1}
joints:
  rail: {type: point_on_line, between: [ground, p], axis: x}
forces:
  spring: {type: expression, on: {p.x: -p.x}}
reference: {coordinates: {p: {x: 0, y: 0}}, steady: {direction: [1, 0], speed: 2}}
"""


@pytest.mark.parametrize("text", [OFF_THE_AXIS, ALONG])
@pytest.mark.parametrize("find", [False, True])
def test_a_motion_that_balances_at_its_first_instant_only_is_refused(text, find):
    if find:
        text = text.replace("coordinates: {p", "find: steady, guess: {p")
    with pytest.raises(mbstab.errors.MbstabError, match=r"forces\.spring|\bp\."):
        mbstab.loads(text).eig()


def test_equilibrium_refuses_a_steady_motion_without_its_symmetry_too():
    text = """
mbstab: 1
bodies:
  p: {type: planar_point, mass: 1}
forces:
  square: {type: expression, on: {p.x: -p.x**3, p.y: -p.y**3}}
reference: {find: steady, steady: {axis: z, rate: 2}, guess: {p: {x: 2, y: 0}}}
"""
    with pytest.raises(mbstab.errors.MbstabError, match=r"forces\.square"):
        mbstab.loads(text).equilibria()


@pytest.mark.parametrize(("axis", "k"), [("x", 0), ("y", 1), ("z", 2)])
@pytest.mark.parametrize("moments", [(0.1, 0.2, 0.25), (0.1, 0.1, 0.15)])
def test_a_free_body_turning_about_a_principal_axis(axis, k, moments):
    # Euler's equations: s² = (I_k − I_i)(I_j − I_k)/(I_i I_j) Ω²; all other motions are shifts.
    i, j = (n for n in range(3) if n != k)
    Omega = 3.0
    square = (moments[k] - moments[i]) * (moments[j] - moments[k]) / (moments[i] * moments[j]) * Omega**2
    text = f"""
mbstab: 1
bodies:
  r: {{type: spatial, mass: 2, inertia: {list(moments)}}}
reference: {{steady: {{axis: {axis}, rate: {Omega}}}, rates: {{r: {{psi: {Omega if axis == "z" else 0}}}}}}}
"""
    found, result = eigenvalues(text)
    root = complex(square) ** 0.5
    expected = [root, -root] if square else []
    values = [s for s in found if abs(abs(s.imag) - Omega) > 1e-6]  # shifts go round with Ω
    assert len(values) == len(expected)
    for s in expected:
        assert min(abs(s - x) for x in values) < 1e-9
    assert (result.verdict == "unstable") == (square > 0.0)


def test_a_screw_sinks_at_the_speed_that_its_brake_allows():
    text = """
mbstab: 1
gravity: [0, 0, -9.81]
bodies:
  nut: {type: spatial, mass: 2, inertia: [0.3, 0.2, 0.4], center_of_mass: [0.1, 0, 0]}
joints:
  screw: {type: screw, between: [nut, ground], axis: z, lead: 0.05}
forces:
  brake: {type: joint_spring, joint: screw, motion: angle, damping: 0.2}
reference: {find: steady, steady: {axis: z, direction: [0, 0, 1]}}
"""
    model = mbstab.loads(text)
    rise = 0.05 / (2.0 * math.pi)
    Omega = -2.0 * G * rise / 0.2
    (item,) = model.equilibria()
    assert abs(item.steady.rate - Omega) < 1e-12
    np.testing.assert_allclose(item.steady.velocity, [0.0, 0.0, Omega * rise], atol=1e-13)
    found, _ = eigenvalues(text)
    inertia = 0.4 + 2.0 * 0.1**2 + 2.0 * rise**2
    np.testing.assert_allclose(found, [-0.2 / inertia], rtol=1e-11)


def test_a_spin_and_a_turn_about_one_axis_are_not_shared_out():
    # A nut with its mass on the axis of the screw: turning with the frame or in it is the same.
    text = """
mbstab: 1
gravity: [0, 0, -9.81]
bodies:
  nut: {type: spatial, mass: 2, inertia: [0.2, 0.2, 0.3]}
joints:
  screw: {type: screw, between: [nut, ground], axis: z, lead: 0.05}
forces:
  brake: {type: joint_spring, joint: screw, motion: angle, damping: 0.2}
reference: {find: steady, steady: {axis: z, direction: [0, 0, 1]}}
"""
    model = mbstab.loads(text)
    state = dict(zip(model.model.coordinates(), model.motion().u, strict=True))
    assert abs(state["nut.psi"] + 2.0 * G * 0.05 / (2.0 * math.pi) / 0.2) < 1e-12
    (item,) = model.equilibria()
    assert item.isolated
    assert model.eig().verdict == "asymptotically stable up to symmetry"


def test_a_mass_pushed_against_a_brake_reaches_its_speed():
    text = """
mbstab: 1
bodies:
  p: {type: planar_point, mass: 4}
joints:
  rail: {type: point_on_line, between: [ground, p], axis: x}
forces:
  thrust: {type: expression, on: {p.x: 10 - 4*rate(p.x)}}
reference: {find: steady, steady: {direction: [1, 0]}}
"""
    (item,) = mbstab.loads(text).equilibria()
    np.testing.assert_allclose(item.steady.velocity, [2.5, 0.0, 0.0], rtol=1e-14)
    found, result = eigenvalues(text)
    np.testing.assert_allclose(found, [-1.0], rtol=1e-13)
    assert result.counts.neutral == 1


# --- trains whose rotors do not all turn ----------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(12))
def test_eigenvalues_of_an_elastic_train_do_not_depend_on_which_rotors_turn(seed):
    """The equations are linear: at any instant of any motion the eigenvalues are those at rest."""
    rng = random.Random(seed)
    count = rng.choice((2, 3, 4))
    inertias = [rng.uniform(0.5, 3.0) for _ in range(count)]
    springs = [rng.choice((-1, 1, 1)) * rng.uniform(100.0, 900.0) for _ in range(count - 1)]
    rates = {i: rng.choice((0.001, 1.0, 100.0)) for i in rng.sample(range(count), rng.randint(1, count))}
    K = np.zeros((count, count))
    laws = [[] for _ in range(count)]
    for i, k in enumerate(springs):
        K[i : i + 2, i : i + 2] += k * np.array([[1.0, -1.0], [-1.0, 1.0]])
        laws[i].append(f"-{k!r}*(r{i}.theta - r{i + 1}.theta)".replace("--", ""))
        laws[i + 1].append(f"{k!r}*(r{i}.theta - r{i + 1}.theta)")
    text = (
        "mbstab: 1\nbodies: {"
        + ", ".join(f"r{i}: {{type: planar, mass: 1, inertia: {x!r}}}" for i, x in enumerate(inertias))
        + "}\njoints: {"
        + ", ".join(f"j{i}: {{type: revolute, between: [r{i}, ground]}}" for i in range(count))
        + "}\nforces: {s: {type: expression, on: {"
        + ", ".join(f"r{i}.theta: {' + '.join(law)}" for i, law in enumerate(laws))
        + "}}}\nreference: {rates: {"
        + ", ".join(f"r{i}: {{theta: {x!r}}}" for i, x in rates.items())
        + "}}"
    )
    result = mbstab.loads(text).eig()
    squares = np.linalg.eigvals(-K / np.array(inertias)[:, None])
    squares = np.delete(squares, np.argmin(np.abs(squares))).astype(complex)
    truth = np.concatenate([np.sqrt(squares), -np.sqrt(squares)])
    found = [e for e in result.eigenvalues if e.kind != "neutral"]
    assert result.counts.neutral == 2
    assert len(found) == len(truth)
    rows, columns = linear_sum_assignment(np.abs(np.array([e.value for e in found])[:, None] - truth))
    for i, j in zip(rows, columns, strict=True):
        assert abs(found[i].value - truth[j]) <= found[i].error_bound + 1e-13 * abs(truth[j])
    steady = len(rates) == count and len(set(rates.values())) == 1
    if not steady and not any(s.real > 1e-6 for s in truth):
        assert result.verdict == "undecided"


# --- turns about axes at any angle, and of mechanisms that are stretched straight -------------------------------------


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


LEANING = """
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


@pytest.mark.long
def test_both_precessions_of_a_leaning_top_are_found():
    # The turn has the Euler rates psi_t = W/cos(theta) here, so the spin about the own axis is spin − W/cos(theta).
    A, C, moment, c = 0.002 + 0.5 * 0.01, 0.003, 0.5 * 9.81 * 0.1, math.cos(0.5)
    found = sorted(item.steady.rate for item in mbstab.loads(LEANING).equilibria(20))
    assert len(found) == 2
    for item in mbstab.loads(LEANING).equilibria(20):
        W, s = item.steady.rate, float(item.steady.spins[5])
        # W² (C − A) cos + W C s = m g l, the balance of moments about the line of nodes.
        assert W * W * (C - A) * c + W * C * s == pytest.approx(moment, rel=1e-12)


def test_a_top_that_is_too_slow_says_what_is_given():
    with pytest.raises(
        mbstab.errors.MbstabError, match=r"no balance of forces was found: at best, \S+ N\*m unbalanced on top"
    ) as error:
        mbstab.loads(LEANING).eig(spin=30)
    assert "rates.top.psi" in str(error.value)


def test_a_drive_that_does_not_have_the_declared_rate_yet_is_named_with_both_rates():
    text = """\
mbstab: 1
bodies:
  rotor: {type: spatial, mass: 1, inertia: [1, 1, 2]}
  arm: {type: spatial, mass: 1, inertia: [1, 1, 2], points: {O: [-1, 0, 0]}}
joints:
  bearing: {type: revolute, between: [rotor, ground], axis: z}
  hinge: {type: revolute, between: [arm.O, rotor], axis: y}
drives: {spin: {type: coordinate, coordinate: rotor.psi, velocity: 10*smooth_start(t)}}
gravity: [0, 0, -9.81]
reference: {find: steady, TIMEsteady: {axis: z, rate: 10}, guess: {arm: {x: 1, y: 0, z: 0, phi: 0, theta: 0, psi: 0}}}
"""
    with pytest.raises(
        mbstab.errors.EquilibriumError,
        match=r"at t = 0 s it gives 0 rad/s, and the motion has 10 rad/s\nhint: give reference\.time",
    ):
        mbstab.loads(text.replace("TIME", "")).motion()
    assert mbstab.loads(text.replace("TIME", "time: 2, ")).motion().u[5] == pytest.approx(10.0, rel=1e-12)


STATIONS = """
mbstab: 1
parameters: {W: 30}
bodies:
  one: {type: spatial, mass: 1, inertia: [0.01, 0.01, 0.02]}
  two: {type: spatial, mass: 1, inertia: [0.01, 0.01, 0.02]}
joints:
  a: {type: revolute, between: [one, ground], axis: z}
  b: {type: revolute, between: [two, {body: ground, point: [0, 0, 1]}], axis: z}
forces:
  shaft: {type: expression, on: {one.psi: 50*(two.psi - one.psi), two.psi: 50*(one.psi - two.psi) - 0.1*rate(two.psi)}}
drives: {spin: {type: coordinate, coordinate: one.psi, velocity: W}}
reference:
  find: steady
  steady: {axis: z, rate: W}
  coordinates: {one: {psi: 0}, two: {psi: 0, z: 1}}
"""


def test_a_given_angle_that_keeps_torques_from_balancing_is_named():
    """The drag twists the shaft by 0.1·30/50."""
    with pytest.raises(ModelFileError, match=r"hint: put two\.psi under reference\.guess"):
        mbstab.loads(STATIONS).eig()
    (found,) = mbstab.loads(STATIONS.replace("two: {psi: 0, z: 1}}", "two: {z: 1}}")).equilibria()
    assert found.motion.q[-1] == pytest.approx(-0.06, rel=1e-12)
