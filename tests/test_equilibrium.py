"""Equilibria and steady motions that the program finds, against closed forms and balances written down here."""

import itertools
import math
import re
from dataclasses import replace

import numpy as np
import pytest
from mpmath import mp
from sampling import sample
from scipy.optimize import brentq, root

import mbstab
from mbstab.analysis.reference.equilibrium import found_motion
from mbstab.compiler.system import System
from mbstab.errors import ConstraintError, EquilibriumError, MbstabError, ModelFileError
from mbstab.model.library import installed_models

MODELS = {path.stem: path for path in installed_models()}
G = 9.81


def solutions(text, starts=1, seed=1, **parameters):
    """Return coordinates by name of all equilibria, and the equilibria."""
    model = mbstab.loads(text)
    found = model.equilibria(starts, seed, **parameters)
    return [dict(zip(model.model.coordinates(), item.motion.q, strict=True)) for item in found], found


def only(text, **parameters):
    (state,), (item,) = solutions(text, **parameters)
    return state, item


def apart(angle, other):
    return abs(math.remainder(angle - other, 2.0 * math.pi))


# --- closed forms ---------------------------------------------------------------------------------------------------

PENDULUM = """
mbstab: 1
gravity: [0, -9.81]
bodies:
  rod: {type: planar, mass: 2, shape: {type: rod, length: 1}, points: {O: [-0.5, 0]}}
joints:
  pivot: {type: revolute, between: [rod.O, ground]}
"""


def test_a_pendulum_has_two_equilibria():
    found, items = solutions(PENDULUM + "reference: {find: equilibrium, guess: {rod: {x: 0.4, y: -0.3}}}", 8)
    assert len(found) == 2
    found.sort(key=lambda state: state["rod.y"])
    for state, side in zip(found, (-1.0, 1.0), strict=True):
        assert apart(state["rod.theta"], side * math.pi / 2.0) < 1e-14
        assert abs(state["rod.x"]) < 1e-15
        assert abs(state["rod.y"] - side * 0.5) < 1e-15
    assert all(item.isolated and not item.symmetries for item in items)


def test_the_nearer_one_is_found_from_the_start_of_the_file():
    for theta, expected in ((-1.2, -math.pi / 2.0), (1.2, math.pi / 2.0)):
        guess = f"{{rod: {{x: {0.5 * math.cos(theta)}, y: {0.5 * math.sin(theta)}, theta: {theta}}}}}"
        state, _ = only(PENDULUM + f"reference: {{find: equilibrium, guess: {guess}}}")
        assert abs(state["rod.theta"] - expected) < 1e-14


def test_a_mass_hangs_from_a_spring_or_stands_on_it():
    stiffness, mass, free = 200.0, 3.0, 0.6
    text = f"""
mbstab: 1
gravity: [0, -9.81]
bodies:
  bob: {{type: planar_point, mass: {mass}}}
forces:
  spring: {{type: spring, between: [bob, ground], stiffness: {stiffness}, length: {free}}}
reference: {{find: equilibrium, guess: {{bob: {{x: 0.1, y: -0.3}}}}}}
"""
    found, items = solutions(text, 30)
    sag = mass * G / stiffness
    heights = sorted(state["bob.y"] for state in found)
    assert len(heights) == 2
    np.testing.assert_allclose(heights, [-free - sag, free - sag], rtol=1e-14)
    assert all(abs(state["bob.x"]) < 1e-15 for state in found)
    assert all(item.isolated for item in items)


def test_a_toggle_of_two_springs_has_three_equilibria():
    half, free, stiffness, mass = 1.0, 1.25, 400.0, 4.0
    text = f"""
mbstab: 1
gravity: [0, -9.81]
ground: {{points: {{left: [-{half}, 0], right: [{half}, 0]}}}}
bodies:
  knee: {{type: planar_point, mass: {mass}}}
joints:
  slot: {{type: point_on_line, between: [ground, knee], axis: y}}
forces:
  left: {{type: spring, between: [knee, ground.left], stiffness: {stiffness}, length: {free}}}
  right: {{type: spring, between: [knee, ground.right], stiffness: {stiffness}, length: {free}}}
reference: {{find: equilibrium, guess: {{knee: {{y: 0.6}}}}}}
"""

    def lift(y):
        length = math.hypot(half, y)
        return -2.0 * stiffness * (length - free) * y / length - mass * G

    grid = np.linspace(-2.0, 2.0, 401)
    expected = [
        brentq(lift, a, b, xtol=1e-15) for a, b in itertools.pairwise(grid) if (lift(a) < 0.0) != (lift(b) < 0.0)
    ]
    assert len(expected) == 3
    found, _ = solutions(text, 40)
    np.testing.assert_allclose(sorted(state["knee.y"] for state in found), expected, atol=1e-13)
    assert not any(abs(state["knee.x"]) > 1e-15 for state in found)
    # Without weight the outer ones are where the springs have no force.
    found, _ = solutions(text.replace("gravity: [0, -9.81]", ""), 40)
    outer = math.sqrt(free**2 - half**2)
    np.testing.assert_allclose(sorted(state["knee.y"] for state in found), [-outer, 0.0, outer], atol=1e-13)


@pytest.mark.parametrize("starts", sample([8, 30], 2))
def test_too_heavy_a_mass_snaps_the_toggle_through(starts):
    text = """
mbstab: 1
gravity: [0, -9.81]
ground: {points: {left: [-1, 0], right: [1, 0]}}
bodies:
  knee: {type: planar_point, mass: 20}
joints:
  slot: {type: point_on_line, between: [ground, knee], axis: y}
forces:
  left: {type: spring, between: [knee, ground.left], stiffness: 400, length: 1.25}
  right: {type: spring, between: [knee, ground.right], stiffness: 400, length: 1.25}
reference: {find: equilibrium, guess: {knee: {y: 0.7}}}
"""

    def lift(y):
        length = math.hypot(1.0, y)
        return -800.0 * (length - 1.25) * y / length - 20.0 * G

    found, _ = solutions(text, starts)
    (state,) = found
    assert abs(state["knee.y"] - brentq(lift, -3.0, -0.7, xtol=1e-15)) < 1e-13


def chain_text(lengths, masses, span, drop):
    bodies, joints, guess = [], [], []
    for i, (length, mass) in enumerate(zip(lengths, masses, strict=True)):
        bodies.append(
            f"  r{i}: {{type: planar, mass: {mass}, shape: {{type: rod, length: {length}}}, "
            f"points: {{a: [{-length / 2}, 0], b: [{length / 2}, 0]}}}}"
        )
        joints.append(f"  j{i}: {{type: revolute, between: [r{i}.a, {'ground' if i == 0 else f'r{i - 1}.b'}]}}")
        part = (i + 0.5) / len(lengths)
        guess.append(f"    r{i}: {{x: {part * span}, y: {-4.0 * part * (1.0 - part)}, theta: {2.0 * part - 1.0}}}")
    joints.append(f"  last: {{type: revolute, between: [r{len(lengths) - 1}.b, ground.end]}}")
    return "\n".join(
        [
            "mbstab: 1",
            "gravity: [0, -9.81]",
            f"ground: {{points: {{end: [{span}, {-drop}]}}}}",
            "bodies:",
            *bodies,
            "joints:",
            *joints,
            "reference:",
            "  find: equilibrium",
            "  guess:",
            *guess,
        ]
    )


@pytest.mark.parametrize("links", [3, 7, 12])
def test_a_hanging_chain_of_rods_has_the_shape_that_its_tension_allows(links):
    rng = np.random.default_rng(links)
    lengths, masses = rng.uniform(0.3, 0.6, links), rng.uniform(0.5, 2.0, links)
    span, drop = 0.7 * float(np.sum(lengths)), 0.2
    # The tension at the left support is (−H, V); half of its weight below, every rod is along the force in its middle.
    carried = np.concatenate([[0.0], np.cumsum(masses)[:-1]]) + masses / 2.0

    def slopes(tension):
        return np.arctan2(carried * G - tension[1], tension[0])

    def gap(tension):
        theta = slopes(tension)
        return [lengths @ np.cos(theta) - span, lengths @ np.sin(theta) + drop]

    weight = float(np.sum(masses)) * G
    tension = root(gap, [0.3 * weight, 0.5 * weight], tol=1e-14).x
    assert np.max(np.abs(gap(tension))) < 1e-12
    state, item = only(chain_text(lengths, masses, span, drop))
    for i, theta in enumerate(slopes(tension)):
        assert apart(state[f"r{i}.theta"], theta) < 1e-11
    forces = {r.owner: r.force for r in item.reactions}
    np.testing.assert_allclose(forces["joint 'j0'"], [-tension[0], tension[1]], rtol=1e-11)
    np.testing.assert_allclose(forces["joint 'last'"], [tension[0], weight - tension[1]], rtol=1e-11)
    assert item.isolated


def test_a_ladder_rests_against_its_spring():
    length, mass, stiffness, free = 2.0, 12.0, 150.0, 0.5
    text = f"""
mbstab: 1
gravity: [0, -9.81]
bodies:
  ladder:
    type: planar
    mass: {mass}
    shape: {{type: rod, length: {length}}}
    points: {{foot: [-{length / 2}, 0], top: [{length / 2}, 0]}}
joints:
  floor: {{type: point_on_line, between: [ground, ladder.foot], axis: x}}
  wall: {{type: point_on_line, between: [ground, ladder.top], axis: y}}
forces:
  rope: {{type: spring, between: [ladder.foot, ground], stiffness: {stiffness}, length: {free}}}
reference: {{find: equilibrium, guess: {{ladder: {{x: 0.5, y: 0.9, theta: 2}}}}}}
"""

    def moment(slope):  # of weight and rope about where floor and wall push
        pull = stiffness * (length * math.cos(slope) - free)
        return mass * G * length / 2.0 * math.cos(slope) - pull * length * math.sin(slope)

    slope = brentq(moment, 0.7, 1.35, xtol=1e-15)
    state, item = only(text)
    assert abs(math.pi - state["ladder.theta"] - slope) < 1e-13
    push = stiffness * (length * math.cos(slope) - free)
    forces = {r.owner: r.force for r in item.reactions}
    np.testing.assert_allclose(forces["joint 'floor'"], [0.0, mass * G], atol=1e-11)
    np.testing.assert_allclose(forces["joint 'wall'"], [push, 0.0], atol=1e-11)


# --- equilibria that are not isolated -------------------------------------------------------------------------------


def test_a_sleigh_held_by_a_spring_rests_wherever_the_blade_takes_the_pull():
    text = """
mbstab: 1
bodies:
  sleigh: {type: planar, mass: 3, inertia: 0.2}
contacts:
  blade: {type: knife_edge, at: sleigh, along: x}
forces:
  rope: {type: spring, between: [sleigh, ground], stiffness: 50, length: 0.4}
reference: {find: equilibrium, guess: {sleigh: {x: 0.9, y: 0.1, theta: 1.2}}}
"""
    state, item = only(text)
    x, y, theta = (state[f"sleigh.{k}"] for k in ("x", "y", "theta"))
    pull = -50.0 * (math.hypot(x, y) - 0.4) * np.array([x, y]) / math.hypot(x, y)
    assert abs(pull @ [math.cos(theta), math.sin(theta)]) < 1e-12  # along the blade there is nothing to take it
    (reaction,) = item.reactions
    np.testing.assert_allclose(reaction.force, -pull, atol=1e-12)
    assert item.symmetries == ("rotation in the plane",)
    assert not item.isolated
    assert any(text.startswith("a continuum along ") for text in item.open)


def test_a_pendulum_without_weight_rests_anywhere():
    text = PENDULUM.replace("gravity: [0, -9.81]", "") + "reference: {find: equilibrium, guess: {rod: {x: 0.5}}}"
    _, item = only(text)
    assert (item.symmetries, item.open) == (("rotation in the plane",), ())
    # About another point than the origin the turn is none of the symmetries that are looked for.
    moved = text.replace("between: [rod.O, ground]", "between: [rod.O, ground.P]")
    moved = moved.replace("mbstab: 1", "mbstab: 1\nground: {points: {P: [3, 1]}}").replace("x: 0.5", "x: 3.5, y: 1")
    _, item = only(moved)
    named = [*item.symmetries, *item.open]
    assert len(named) == 1
    assert "rod.theta" in named[0] or "rotation" in named[0]


def test_a_ball_on_a_table_rests_anywhere():
    text = """
mbstab: 1
gravity: [0, 0, -9.81]
bodies:
  ball: {type: spatial, mass: 1, shape: {type: sphere, radius: 0.1}, center_of_mass: 0}
contacts:
  table: {type: ellipsoid, center: ball, a: 0.1, b: 0.1, c: 0.1}
reference: {find: equilibrium, guess: {ball: {z: 0.3, phi: 0.4, theta: 0.3, psi: 0.2}}}
"""
    state, item = only(text)
    assert abs(state["ball.z"] - 0.1) < 1e-15
    assert {"translation along x", "translation along y"} <= set(item.symmetries) or {"ball.x", "ball.y"} <= set(
        item.symmetries
    )
    assert len(item.symmetries) + len(item.open) == 5
    np.testing.assert_allclose(item.reactions[0].force, [0.0, 0.0, G], atol=1e-13)


def test_the_place_of_a_mass_in_nothing_is_open():
    _, item = only("mbstab: 1\nbodies: {b: {type: planar_point, mass: 1}}\nreference: {find: equilibrium}")
    assert item.open == ()
    assert item.symmetries == ("b.x", "b.y")


def test_a_critical_position_is_no_continuum():
    # A quartic potential has one equilibrium, but no stiffness there.
    text = """
mbstab: 1
bodies:
  b: {type: planar_point, mass: 1}
joints:
  line: {type: point_on_line, between: [ground, b], axis: x}
forces:
  quartic: {type: expression, on: {b.x: -b.x**3}}
reference: {find: equilibrium, guess: {b: {x: 0}}}
"""
    _, item = only(text)
    assert item.open == ("a critical position along b.x",)


# --- what cannot be found -------------------------------------------------------------------------------------------


def failure(text, error=EquilibriumError, **parameters):
    with pytest.raises(error) as caught:
        solutions(text, **parameters)
    return str(caught.value)


def test_free_fall_is_no_equilibrium_and_the_coordinate_is_named():
    message = failure(
        "mbstab: 1\ngravity: [0, -9.81]\nbodies: {a: {type: planar_point, mass: 1}, b: {type: planar_point, mass: 2}}\n"
        "joints: {held: {type: spherical, between: [a, ground]}}\nreference: {find: equilibrium}"
    )
    assert "no spring or joint resists b.y" in message
    assert "a." not in re.sub(r"a mechanism|a force|a joint", "", message).split("hint")[0]
    assert "unbalanced on b.y" in message
    assert f"{2 * G:.4g} N" in message


def test_a_force_that_changes_elsewhere_is_not_said_to_stay():
    """The force p - x² is flat where the search begins, and zero at two places."""
    text = (
        "mbstab: 1\nbodies: {b: {type: planar_point, mass: 1}}\nconstraints: {rail: {holonomic: b.y}}\n"
        "forces: {f: {type: expression, on: {b.x: p - b.x**2}}}\nparameters: {p: 0.3}\nreference: {find: equilibrium}"
    )
    message = failure(text)
    assert "resists" not in message
    assert "other starting values under reference.guess" in message
    state, _ = only(text.replace("equilibrium}", "equilibrium, guess: {b: {x: 1}}}"))
    assert abs(state["b.x"] - math.sqrt(0.3)) < 1e-14


def test_a_mechanism_that_cannot_close_is_said_not_to():
    text = """
mbstab: 1
gravity: [0, -9.81]
ground: {points: {far: [3, 0]}}
bodies:
  b: {type: planar_point, mass: 1}
joints:
  short: {type: distance, between: [b, ground], length: 1}
  also_short: {type: distance, between: [b, ground.far], length: 1.5}
reference: {find: equilibrium, guess: {b: {x: 1, y: -0.2}}}
"""
    message = failure(text, ModelFileError)
    assert "where joint 'also_short' is satisfied, (d² − l²) / 2l" in message
    assert "where joint 'short' is satisfied, (d² − l²) / 2l" in message
    state, _ = only(text.replace("length: 1.5", "length: 2.5"))
    x = (1.0 - 2.5**2 + 9.0) / 6.0
    assert abs(state["b.x"] - x) < 1e-14


def test_given_coordinates_are_held_and_guesses_are_not():
    place = "{rod: {x: 0.3, y: -0.4, theta: -0.927295218001612}}"
    message = failure(PENDULUM + f"reference: {{find: equilibrium, coordinates: {place}}}")
    assert "given are rod.x, rod.y, rod.theta: a guess leaves them free" in message
    state, _ = only(PENDULUM + f"reference: {{find: equilibrium, guess: {place}}}")
    assert abs(state["rod.theta"] + math.pi / 2.0) < 1e-14
    # Where the file asks for nothing, the command takes what is given as a start.
    state, _ = only(PENDULUM + f"reference: {{coordinates: {place}}}")
    assert abs(state["rod.theta"] + math.pi / 2.0) < 1e-14


def test_a_held_coordinate_stays_exactly_what_it_is():
    text = """
mbstab: 1
gravity: [0, -9.81]
bodies:
  b: {type: planar_point, mass: 1}
  c: {type: planar_point, mass: 1}
forces:
  k1: {type: spring, between: [b, ground], stiffness: 100, length: 0.3}
  k2: {type: spring, between: [c, ground], stiffness: 100, length: 0.3}
reference: {find: equilibrium, coordinates: {b: {x: 0}}, guess: {b: {y: -0.2}, c: {x: 0.01, y: -0.2}}}
"""
    state, _ = only(text)
    assert state["b.x"] == 0.0
    assert abs(state["b.y"] + 0.3 + G / 100.0) < 1e-15
    message = failure(text.replace("coordinates: {b: {x: 0}}", "coordinates: {b: {x: 0.2}}"))
    assert "unbalanced on b.x" in message


CHANGE_POINT = """
mbstab: 1
gravity: [9.81, 0]
ground: {points: {B: [4, 0]}}
bodies:
  crank: {type: planar, mass: 1, shape: {type: rod, length: 2}, points: {a: [-1, 0], b: [1, 0]}}
  coupler: {type: planar, mass: 1, shape: {type: rod, length: 3}, points: {a: [-1.5, 0], b: [1.5, 0]}}
  rocker: {type: planar, mass: 1, shape: {type: rod, length: 3}, points: {a: [-1.5, 0], b: [1.5, 0]}}
joints:
  A: {type: revolute, between: [crank.a, ground]}
  C: {type: revolute, between: [coupler.a, crank.b]}
  D: {type: revolute, between: [rocker.b, coupler.b]}
  B: {type: revolute, between: [rocker.a, ground.B]}
reference:
  find: equilibrium
  guess:
    crank: {x: -1, y: 0, theta: pi}
    coupler: {x: -0.5, y: 0, theta: 0}
    rocker: {x: 2.5, y: 0, theta: pi}
"""


STRETCHED = """
mbstab: 1
gravity: {gravity}
ground: {{points: {{D: [0, -0.7]}}}}
bodies:
  a: {{type: planar, mass: 1, shape: {{type: rod, length: 0.1}}, points: {{l: [-0.05, 0], r: [0.05, 0]}}}}
  b: {{type: planar, mass: 2, shape: {{type: rod, length: 0.25}}, points: {{l: [-0.125, 0], r: [0.125, 0]}}}}
  c: {{type: planar, mass: 1, shape: {{type: rod, length: 0.35}}, points: {{l: [-0.175, 0], r: [0.175, 0]}}}}
joints:
  A: {{type: revolute, between: [a.l, ground]}}
  B: {{type: revolute, between: [a.r, b.l]}}
  C: {{type: revolute, between: [b.r, c.l]}}
  D: {{type: revolute, between: [c.r, ground.D]}}
reference:
  find: equilibrium
  guess: {{a: {{theta: -pi/2 + {off}}}, b: {{theta: -pi/2 - {off}}}, c: {{theta: -pi/2 + {off}/2}}}}
"""


@pytest.mark.parametrize("gravity", ["[0, 0]", "[0, -9.81]", "[9.81, 0]"])
@pytest.mark.parametrize("off", [0, 0.03, 0.4])
def test_a_linkage_that_is_stretched_out_is_singular_and_not_out_of_balance(gravity, off):
    with pytest.raises((EquilibriumError, ConstraintError)) as caught:
        mbstab.loads(STRETCHED.format(gravity=gravity, off=off)).eig()
    # Stretched out across the weight, it has no balance.
    left = re.search(r"at best, (\S+) N", str(caught.value))
    assert float(left[1]) > 1.0 if left else "singular" in str(caught.value)


def test_a_held_coordinate_that_contradicts_a_joint_is_named_with_the_gap():
    """The plane of the thrust bearing tilts with the rotor, which sags more on one side: z of its middle is not 0."""
    text = """
mbstab: 1
gravity: [0, -9.81, 0]
ground: {points: {A: [0, 0, -0.55], B: [0, 0, 0.85]}}
bodies:
  rotor: {type: spatial, mass: 900, inertia: [210, 210, 45], points: {A: [0, 0, -0.55], B: [0, 0, 0.85]}}
joints: {thrust: {type: point_on_plane, between: [rotor, ground], axis: z}}
forces:
  A: {type: rotor_bearing, between: [rotor.A, ground.A], kxx: 3e7, kyy: 3e7}
  B: {type: rotor_bearing, between: [rotor.B, ground.B], kxx: 3e7, kyy: 3e7}
reference:
  find: steady
  steady: {axis: z, rate: 0}
  coordinates: {rotor: {z: 0, psi: 0}}
  rates: {rotor: {psi: 300}}
"""
    message = failure(text)
    # y = -m g/2k - (b - a)/2 tan(tilt), tilt = m g (b - a)/(k (a + b)²) with a + b = 1.4 m: the gap is y sin(tilt).
    tilt = math.atan(900 * 9.81 * 0.3 / (3e7 * 1.4**2) / 1.0)
    sag = 900 * 9.81 / 6e7 + 0.15 * math.tan(tilt)
    found = re.search(
        r"forces balance, but joint 'thrust' \(in plane v1\) is not satisfied: \S+ \S+ is (\S+) m", message
    )
    assert found, message
    assert abs(float(found[1])) == pytest.approx(sag * math.sin(tilt), rel=0.01)
    assert "hint: leave out rotor.z, which is given" in message
    state, _ = only(text.replace("[rotor, ground]", "[ground, rotor]"))
    assert state["rotor.y"] == pytest.approx(-sag, rel=1e-6)


def test_a_four_bar_linkage_with_all_links_in_a_line_is_refused_by_its_joints():
    message = failure(CHANGE_POINT, ConstraintError)
    assert "singular configuration" in message
    assert all(f"joint '{name}'" in message for name in "ABCD")


# --- governor and bicycle -------------------------------------------------------------------------------------------


def turning(system, q, rate):
    """Return u and a of a turn of everything about z through the origin at a rate, from angular velocities."""
    up, u, a = np.array([0.0, 0.0, 1.0]), np.zeros(system.n_q), np.zeros(system.n_q)
    for body, part in zip(system.scene.bodies, system.body_slices, strict=True):
        place, angles = slice(part.start, part.start + 3), slice(part.start + 3, part.stop)
        u[place] = rate * np.cross(up, q[place])
        a[place] = rate * np.cross(up, u[place])
        if body.orientation:
            phi, theta, _ = q[angles]
            B = np.array(body.base, dtype=float).reshape(3, 3)
            first = B @ [1.0, 0.0, 0.0]
            second = B @ [0.0, math.cos(phi), math.sin(phi)]
            third = B @ [math.sin(theta), -math.sin(phi) * math.cos(theta), math.cos(phi) * math.cos(theta)]
            axes = np.column_stack([first, second, third])
            p, t, s = rates = np.linalg.solve(axes, rate * up)
            # The second axis goes with the first turn, the third with both; ω is constant.
            drift = t * p * np.cross(first, second) + s * np.cross(p * first + t * second, third)
            u[angles], a[angles] = rates, np.linalg.solve(axes, -drift)
    return u, a


def imbalance(system, motion, u, a):
    """Return the largest unbalanced force and residual of a row, relative to the forces and lengths there."""
    state = system.dynamics(motion.q, u)
    force = state.M @ a + state.F0 + state.J.T @ motion.nu
    balancing = np.max(np.abs(state.M @ a)) + np.max(np.abs(state.F0)) + np.max(np.abs(state.J.T @ motion.nu))
    rows = max(np.max(np.abs(state.E[: system.n_h])), np.max(np.abs(state.V), initial=0.0))
    return np.max(np.abs(force)) / balancing, rows


def guessed(system, guess, coordinates=None):
    scene = replace(system.scene, guess=guess)
    return System(scene if coordinates is None else replace(scene, coordinates=coordinates))


def governor():
    return mbstab.load(MODELS["governor"]).system()


def test_the_governor_is_found_from_angles_off_by_03_rad():
    system = governor()
    expected = found_motion(system).q
    rng = np.random.default_rng(5)
    for _ in range(10):
        off = {
            name: value + (0.3 * rng.choice([-1.0, 1.0]) if name.endswith("psi") else 0.0)
            for name, value in system.scene.guess.items()
        }
        found = found_motion(guessed(system, off)).q
        difference = [math.remainder(x, 2.0 * math.pi) for x in found - expected]
        assert np.max(np.abs(difference)) < 1e-13


def rough_guess(system, rng, spread):
    """Return the guess of a scene with random errors: parts of 0.2 m and 3 rad."""
    sizes = {n: 0.2 if n.rpartition(".")[2] in "xyz" else 3.0 for n in system.scene.guess}
    return {n: x + spread * sizes[n] * rng.uniform(-1.0, 1.0) for n, x in system.scene.guess.items()}


def test_rounding_of_multipliers_is_no_imbalance():
    system = governor()
    motion = found_motion(guessed(system, rough_guess(system, np.random.default_rng(103), 0.3)))
    assert imbalance(system, motion, *turning(system, motion.q, 10.0))[0] < 1e-9


@pytest.mark.long
@pytest.mark.parametrize(("spread", "seed"), sample([(spread, seed) for spread in (1.0, 0.3) for seed in range(5)], 10))
def test_a_random_guess_for_the_governor_leads_to_a_steady_motion_or_an_error(spread, seed):
    system = governor()
    rng = np.random.default_rng(100 + seed)
    verified = 0
    for _ in range(10):
        try:
            motion = found_motion(guessed(system, rough_guess(system, rng, spread)))
        except MbstabError:
            continue
        u, a = turning(system, motion.q, 10.0)
        np.testing.assert_allclose(motion.u, u, atol=1e-12)
        np.testing.assert_allclose(motion.a, a, atol=1e-11)
        force, rows = imbalance(system, motion, u, a)
        assert force < 1e-9
        assert rows < 1e-9
        verified += 1
    assert verified >= 2


def bicycle():
    text = MODELS["whipple_bicycle"].read_text(encoding="utf-8")
    head, _, tail = text.partition("reference:\n")
    coordinates, _, _ = tail.partition("  rates:")
    search = "  find: steady\n  steady: {direction: x, speed: v}\n"
    return mbstab.loads(head + "reference:\n" + search + coordinates.replace("coordinates:", "guess:"))


@pytest.mark.long
@pytest.mark.parametrize("guesses", sample([25, 100], 2))
def test_a_random_guess_for_the_bicycle_leads_to_a_steady_motion_or_an_error(guesses):
    model = bicycle()
    system = model.system()
    rng = np.random.default_rng(200)
    verified = 0
    for _ in range(guesses):
        guess = {
            n: x + rng.uniform(-1.0, 1.0) * (0.1 if n.rpartition(".")[2] in "xyz" else 0.3)
            for n, x in system.scene.guess.items()
        }
        try:
            motion = found_motion(guessed(system, guess))
        except MbstabError:
            continue
        names = system.names
        u = np.zeros(system.n_q)
        u[[i for i, n in enumerate(names) if n.endswith(".x")]] = 5.0
        for wheel in ("rear_wheel.psi", "front_wheel.psi"):
            u[names.index(wheel)] = motion.u[names.index(wheel)]
        np.testing.assert_allclose(motion.u, u, atol=1e-12)
        force, rows = imbalance(system, motion, u, 0.0 * u)
        assert force < 1e-12
        assert rows < 1e-11
        verified += 1
    assert verified >= 0.1 * guesses


def test_the_bicycle_upright_is_found_from_a_leaning_guess():
    model = bicycle()
    system = model.system()
    guess = dict(system.scene.guess)
    for body in ("rear_wheel", "rear_body", "front_body", "front_wheel"):
        guess[f"{body}.phi"] += 0.05
    motion = found_motion(guessed(system, guess))
    state = dict(zip(system.names, motion.q, strict=True))
    assert all(abs(state[f"{body}.phi"]) < 1e-9 for body in ("rear_wheel", "rear_body", "front_body", "front_wheel"))
    speeds = dict(zip(system.names, motion.u, strict=True))
    assert abs(speeds["rear_wheel.psi"] + 5.0 / 0.3) < 1e-9


def governor_by_hand(omega, digits=40):
    """Return the angle of the cranks and the eigenvalue of the governor with one degree of freedom."""
    with mp.workdps(digits):
        L, R, e = mp.mpf("0.05"), mp.mpf("0.002"), mp.mpf("0.01777")
        m_b, m_p, m_c, g, sigma = mp.mpf(4), mp.mpf(5), mp.mpf(3), mp.mpf("9.81"), mp.mpf(10)
        l_0 = mp.sqrt(2) * L
        k = g * (10 * m_b + 8 * m_c + 4 * m_p) / (4 * (4 * L * mp.sin(mp.pi / 3) - l_0))

        def bar_about_axis(length, radius_of_centre, psi):
            axial, across = m_b * R**2 / 2, m_b * (R**2 / 4 + length**2 / 12)
            return m_b * radius_of_centre**2 + axial * mp.sin(psi) ** 2 + across * mp.cos(psi) ** 2

        def about_axis(psi):
            c = mp.cos(psi)
            crank = bar_about_axis(4 * L, e + 2 * L * c, psi) + m_c * (e + 4 * L * c) ** 2
            return 2 * (crank + bar_about_axis(2 * L, e + L * c, psi))

        def potential(psi):
            s = mp.sin(psi)  # heights above the pivots of the cranks
            weight = 2 * g * (m_b * 2 * L * s + m_c * 4 * L * s + m_b * 3 * L * s) + m_p * g * 4 * L * s
            return weight + k * (-4 * L * s - l_0) ** 2 / 2 - mp.mpf(omega) ** 2 * about_axis(psi) / 2

        def mass(psi):
            s, c = mp.sin(psi), mp.cos(psi)
            crank = m_b * (R**2 / 4 + (4 * L) ** 2 / 12 + (2 * L) ** 2) + m_c * (4 * L) ** 2
            rod = m_b * (R**2 / 4 + (2 * L) ** 2 / 12 + (L * s) ** 2 + (3 * L * c) ** 2)
            return 2 * (crank + rod) + m_p * (4 * L * c) ** 2

        psi = mp.findroot(lambda x: mp.diff(potential, x), (mp.mpf("5.1"), mp.mpf("6.27")), solver="anderson")
        m, d, v = mass(psi), sigma * (4 * L * mp.cos(psi)) ** 2, mp.diff(potential, psi, 2)
        return float(psi), complex(-d / (2 * m), mp.sqrt(v / m - (d / (2 * m)) ** 2))


@pytest.mark.parametrize("omega", [0, 3, 10, 17.5, 30, 40])
def test_the_governor_turns_like_its_system_with_one_degree_of_freedom(omega):
    model = mbstab.load(MODELS["governor"])
    psi, eigenvalue = governor_by_hand(omega)
    motion = model.motion(omega=omega)
    state = dict(zip(model.model.coordinates(), motion.q, strict=True))
    assert abs(state["right_crank.psi"] - psi) < 1e-12
    assert abs(state["slider.z"] - 0.2 * (1.0 + math.sin(psi))) < 1e-13
    result = model.eig(omega=omega)
    found = [e.value for e in result.eigenvalues if e.kind != "neutral" and e.value.imag > 0.0]
    assert len(found) == 1
    assert abs(found[0] - eigenvalue) < 1e-10 * abs(eigenvalue)


# --- starts ---------------------------------------------------------------------------------------------------------


def test_the_same_seed_gives_the_same_solutions():
    text = PENDULUM + "reference: {find: equilibrium, guess: {rod: {x: 0.4, y: -0.3}}}"
    one, other = (solutions(text, 6, 3)[0] for _ in range(2))
    assert one == other


@pytest.mark.long
@pytest.mark.parametrize("starts", sample([2, 6], 2))
def test_random_starts_leave_held_coordinates_alone(starts):
    model = mbstab.load(MODELS["governor"])
    for item in model.equilibria(starts, 2):
        state = dict(zip(model.model.coordinates(), item.motion.q, strict=True))
        assert [state[f"shaft.{k}"] for k in ("x", "y", "z", "phi", "theta", "psi")] == [0, 0, 0.1, 0, 0, 0]


def test_a_failing_reference_that_is_given_says_what_would_find_it():
    with pytest.raises(ModelFileError, match="at rest but not in equilibrium") as caught:
        mbstab.loads(PENDULUM + "reference: {coordinates: {rod: {theta: 0}}}").motion()
    assert "mbstab equilibrium" in str(caught.value)


# --- what is no equilibrium must not be called one ------------------------------------------------------------------


def test_a_start_where_a_spring_has_no_length_does_not_hide_the_weight():
    # The stiffness there is 1e17 N/m: beside it the weight of 29 N is no rounding.
    text = """
mbstab: 1
gravity: [0, -9.81]
bodies:
  bob: {type: planar_point, mass: 3}
forces:
  spring: {type: spring, between: [bob, ground], stiffness: 200, length: 0.6}
reference: {find: equilibrium, guess: {bob: {x: 1e-15, y: -1e-15}}}
"""
    state, item = only(text)
    assert item.unbalanced[0] < 1e-6
    assert min(abs(state["bob.y"] - y) for y in (0.6 - 3.0 * G / 200.0, -0.6 - 3.0 * G / 200.0)) < 1e-12


@pytest.mark.parametrize("size", [1e-9, 1e-6, 1e-3, 1.0, 1e3, 1e6])
@pytest.mark.parametrize("mass", [1e-9, 1.0, 1e6])
def test_small_and_large_pendulums_are_found_alike(size, mass):
    text = f"""
mbstab: 1
gravity: [0, -9.81]
bodies:
  rod: {{type: planar, mass: {mass}, shape: {{type: rod, length: {size}}}, points: {{O: [{-size / 2}, 0]}}}}
joints:
  pivot: {{type: revolute, between: [rod.O, ground]}}
reference: {{find: equilibrium, guess: {{rod: {{x: {0.3 * size}, y: {-0.3 * size}, theta: -1}}}}}}
"""
    state, item = only(text)
    assert abs(state["rod.theta"] + math.pi / 2.0) < 1e-14
    assert abs(state["rod.y"] + size / 2.0) < 1e-14 * size
    assert item.strategy == "Newton"
    assert item.iterations <= 10


STIFF = """
mbstab: 1
gravity: [0, -9.81]
bodies:
  b: {{type: planar_point, mass: 1}}
forces:
  s: {{type: spring, between: [b, ground], stiffness: {stiffness}, length: 0.6}}
reference: {{find: equilibrium, guess: {{b: {{x: 0.2, y: -0.5}}}}}}
"""


@pytest.mark.parametrize("stiffness", [1e2, 1e4, 1e6, 1e9, 1e12])
def test_stiff_springs_are_found_like_soft_ones(stiffness):
    """From a guess beside it, along a valley as narrow as the weight is small beside the spring."""
    state, _ = only(STIFF.format(stiffness=stiffness))
    assert abs(state["b.y"] + 0.6 + G / stiffness) < 1e-14


# --- messages name what is wrong ------------------------------------------------------------------------------------


def test_a_drive_that_moves_is_named_where_an_equilibrium_is_asked_for():
    message = failure("""
mbstab: 1
bodies:
  rotor: {type: planar, mass: 2, inertia: 1}
joints:
  bearing: {type: revolute, between: [rotor, ground]}
drives:
  motor: {type: joint, joint: bearing, velocity: 5}
reference: {find: equilibrium}
""")
    assert "drive 'motor'" in message
    assert "0 N unbalanced" not in message


def test_a_state_that_follows_what_falls_is_no_drive():
    message = failure("""
mbstab: 1
gravity: [0, -9.81]
bodies:
  a: {type: planar, mass: 1, inertia: 0.1}
  b: {type: planar, mass: 1, inertia: 0.1}
joints:
  rise: {type: prismatic, between: [a, ground], axis: y}
  slide: {type: prismatic, between: [b, ground], axis: x}
states:
  s: {rate: 0.3*exp(-a.y) - s}
forces:
  spring: {type: joint_spring, joint: slide, stiffness: 20}
  push: {type: expression, on: {b.x: s}}
reference: {find: equilibrium}
""")
    assert "9.81 N unbalanced on a.y" in message
    assert "drives" not in message


def test_a_joint_that_blocks_the_steady_motion_is_named():
    message = failure("""
mbstab: 1
bodies:
  p: {type: planar_point, mass: 1}
joints:
  rail: {type: point_on_line, between: [ground, p], axis: x}
reference: {find: steady, steady: {direction: [0, 1], speed: 2}}
""")
    assert "joint 'rail'" in message
    assert "0 N unbalanced" not in message


def test_a_wheel_that_would_slip_is_named():
    message = failure("""
mbstab: 1
gravity: [0, 0, -9.81]
bodies:
  wheel: {type: spatial, mass: 2, inertia: [0.0454, 0.0454, 0.09]}
contacts:
  road: {type: wheel, center: wheel, axle: z, radius: 0.3}
reference:
  find: steady
  steady: {direction: [0, 1, 0], speed: 1.5}
  coordinates: {wheel: {x: 1, y: 0, z: 0.3, phi: pi/2, theta: 0, psi: 0}}
""")
    assert "contact 'road'" in message


def test_rates_have_no_place_in_an_equilibrium():
    # Ignoring them would answer another question than the one that was asked.
    with pytest.raises(ModelFileError) as caught:
        solutions(
            PENDULUM + "reference: {find: equilibrium, rates: {rod: {theta: 5}}, guess: {rod: {x: 0.3, y: -0.3}}}"
        )
    assert "rates" in str(caught.value)


def test_a_rate_that_nothing_determines_is_asked_for_also_where_a_motion_is_looked_for():
    text = """
mbstab: 1
bodies:
  rotor: {type: planar, mass: 2, inertia: 1, center_of_mass: [0.1, 0]}
joints:
  bearing: {type: revolute, between: [rotor, ground]}
reference: {find: steady, steady: {axis: z}}
"""
    with pytest.raises(MbstabError, match=r"steady\.rate"):
        only(text)


# --- symmetries and lists -------------------------------------------------------------------------------------------


@pytest.mark.long
def test_a_body_that_hangs_freely_turned_about_the_vertical_has_two_equilibria():
    # Up and down, each with a turn about the vertical: not one for every heading that a start leads to.
    text = """
mbstab: 1
gravity: [0, 0, -9.81]
bodies:
  r: {type: spatial, mass: 2, inertia: [0.1, 0.2, 0.25], points: {O: [0, 0, 1]}}
joints:
  hook: {type: spherical, between: [r.O, ground]}
reference: {find: equilibrium, guess: {r: {x: 0.3, z: -0.9, theta: 0.3}}}
"""
    found, items = solutions(text, 40)
    isolated = [(state, item) for state, item in zip(found, items, strict=True) if item.isolated]
    assert sorted(round(state["r.z"], 9) for state, _ in isolated) == [-1.0, 1.0]
    assert all(item.symmetries == ("rotation about z",) for _, item in isolated)


@pytest.mark.long
def test_a_mass_on_a_string_that_turns_may_stand_above_its_pivot():
    text = """
mbstab: 1
gravity: [0, 0, -9.81]
bodies:
  p: {type: point, mass: 1}
joints:
  string: {type: distance, between: [p, ground], length: 1}
reference: {find: steady, steady: {axis: z, rate: 2}, guess: {p: {x: 0.3, z: -0.9}}}
"""
    found, _ = solutions(text, 100)
    assert sorted(round(state["p.z"], 12) for state in found) == [-1.0, 1.0]


# --- far away, and nowhere -------------------------------------------------------------------------------------------

HANGING = """
mbstab: 1
parameters: {m: 1, k: 1, L: 1}
gravity: [0, 0, -9.81]
ground: {points: {A: [L, 0, 0], B: [-L/2, L, 0], C: [-L/2, -L, 0]}}
bodies: {b: {type: point, mass: m}}
forces:
  a: {type: spring, between: [b, ground.A], stiffness: k, length: L/2}
  b: {type: spring, between: [b, ground.B], stiffness: k, length: L/2}
  c: {type: spring, between: [b, ground.C], stiffness: 2*k, length: L/2}
reference: {find: equilibrium, guess: {b: {x: 0, y: 0, z: -L/10}}}
"""


@pytest.mark.parametrize("length", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize("sag", [1e-3, 10.0, 1e3, 1e6])
def test_a_soft_spring_gives_way_as_far_as_the_weight_takes_it(length, sag):
    # Far below, the springs together are one of 4 k.
    settings = {"L": length, "m": 1.0, "k": G / (4.0 * sag * length)}
    (found,) = mbstab.loads(HANGING).equilibria(**settings)
    x, y, z = found.motion.q / length
    anchors = np.array([[1.0, 0.0, 0.0], [-0.5, 1.0, 0.0], [-0.5, -1.0, 0.0]])
    ways = anchors - np.array([x, y, z])
    lengths = np.linalg.norm(ways, axis=1)
    pull = np.array([1.0, 1.0, 2.0]) * (1.0 - 0.5 / lengths) @ ways / (4.0 * sag)
    np.testing.assert_allclose(pull, [0.0, 0.0, 1.0], atol=1e-9)
    assert sag < 100.0 or abs(z + sag) < 1.0


CART = """
mbstab: 1
parameters: {k: 1}
gravity: [0, -9.81]
bodies: {cart: {type: planar_point, mass: 1}}
constraints: {rail: {holonomic: cart.y}}
forces: {push: {type: expression, on: {cart.x: LAW}}}
reference: {find: equilibrium, guess: {cart: {x: 0.5, y: 0}}}
"""


@pytest.mark.few(1)
@pytest.mark.parametrize("values", [np.linspace(1e-4, 1.0, 9), np.geomspace(1e-4, 1.0, 9), np.linspace(1.0, 1e-4, 9)])
def test_a_cart_on_an_ever_softer_spring_is_followed(values):
    # x = 1/k
    result = mbstab.loads(CART.replace("LAW", "1 - k*cart.x - 0.5*rate(cart.x)")).sweep("k", values)
    assert set(result.verdicts) == {"asymptotically stable"}
    assert (result.critical, result.problems, result.moved) == ((), {}, "")


@pytest.mark.few(1)
@pytest.mark.parametrize("values", [np.linspace(1e-9, 1.0, 9), np.linspace(1.0, 1e-9, 9)])
def test_where_a_cart_runs_off_no_fold_is_invented(values):
    result = mbstab.loads(CART.replace("LAW", "1 - k*cart.x - 0.5*rate(cart.x)")).sweep("k", values)
    assert "fold" not in [c.kind for c in result.critical]
    assert all("turns back" not in text for text in result.problems.values())
    assert set(result.verdicts[1:-1]) == {"asymptotically stable"}


@pytest.mark.parametrize("law", ["exp(-cart.x)", "1/(1 + exp(cart.x))", "1/(1 + cart.x**2)"])
def test_where_forces_fade_out_nothing_balances_however_large_the_weight(law):
    message = failure(CART.replace("LAW", law))
    assert re.search(r"diverged to cart\.x = \d+.* without a balance of forces: \S+ N unbalanced on cart\.x", message)


def test_what_closes_but_does_not_balance_is_not_said_not_to_close():
    message = failure("""
mbstab: 1
gravity: [0, -9.81]
bodies: {arm: {type: planar, mass: 1, inertia: 0.1, points: {O: [-0.5, 0], E: [0.5, 0]}}}
joints: {pivot: {type: revolute, between: [arm.O, ground]}}
forces:
  motor: {type: expression, on: {arm.theta: 20}}
reference: {find: equilibrium, coordinates: {arm: {theta: 0.3}}}
""")
    assert "close" not in message
    assert re.search(r"no balance of forces was found: at best, \S+ N(\*m)? unbalanced on arm\.", message)


def test_slopes_that_overflow_leave_the_terminal_alone(capfd):
    with pytest.raises(EquilibriumError, match="no steady motion found"):
        mbstab.load("bead_on_hoop.yaml").eig(R=1e-200)
    assert "On entry to" not in "".join(capfd.readouterr())


INSTANT = """\
mbstab: 1
bodies: {b: {type: planar_point, mass: 2}}
constraints: {row: {holonomic: b.y}}
forces: {s: {type: spring, between: [b, {body: ground, point: [-2, 0]}], stiffness: 50, length: 1}}
reference: {coordinates: {b: {x: -0.9}}, rates: {b: {x: 3}}}
"""


def test_rates_with_which_forces_balance_at_an_instant_only_are_refused():
    """The mass passes the place where its spring is at rest; with a spring that moves along, the motion is steady."""
    with pytest.raises(ModelFileError) as caught:
        mbstab.loads(INSTANT).equilibria()
    assert "reference.rates: these rates are those of no steady motion: the forces do not keep b.x" in str(caught.value)
    (rest,) = mbstab.loads(INSTANT.replace("x: 3", "x: 0")).equilibria()
    assert rest.motion.q == pytest.approx([-1.0, 0.0])
    free = INSTANT.replace("forces: {s", "forces: {} #").replace("forces: {} #:", "forces: {} #")
    (steady,) = mbstab.loads(free).equilibria()
    assert steady.motion.u == pytest.approx([3.0, 0.0])


def test_why_a_declared_motion_cannot_be_followed_is_told():
    declared = INSTANT.replace("x: -0.9}}, rates: {b: {x: 3}}", "x: -1}}, steady: {direction: x, speed: 3}")
    with pytest.raises(
        ModelFileError, match=r"cannot be followed along it, as the forces do not keep b.x on the steady"
    ):
        mbstab.loads(declared).eig()


@pytest.mark.parametrize(("stiffness", "found"), [(4e3, True), (1e16, False)])
def test_what_a_very_stiff_spring_leaves_undetermined_is_no_equilibrium(stiffness, found):
    # Where the gear is rigid, 800 (30° − θ) = 3·9.81·0.5 cos θ holds the arm.
    model = mbstab.loads(
        "mbstab: 1\ngravity: [0, -9.81]\nbodies:\n"
        "  motor: {type: planar, mass: 2, inertia: 0.3}\n"
        "  arm: {type: planar, mass: 3, inertia: 0.1, points: {a: [-0.5, 0]}}\n"
        "joints:\n  shoulder: {type: revolute, between: [motor, ground]}\n"
        "  gear: {type: revolute, between: [arm.a, motor]}\n"
        f"forces:\n  flex: {{type: joint_spring, joint: gear, stiffness: {stiffness:g}}}\n"
        "  hold: {type: joint_spring, joint: shoulder, stiffness: 800, rest: 30*deg}\n"
        "reference: {find: equilibrium, guess: {motor: {theta: 1.0}, arm: {theta: 1.0}}}\n"
    )
    if found:
        angle = brentq(lambda x: 800.0 * (math.pi / 6.0 - x) - 3.0 * 9.81 * 0.5 * math.cos(x), 0.0, 1.0)
        (got,) = model.equilibria(1)
        assert got.motion.q[2] == pytest.approx(angle, abs=1e-3)
    else:
        with pytest.raises(MbstabError, match=r"stiffness of forces\.flex .* leaves no digits"):
            model.equilibria(1)


POWERS = [
    ("-k*p.x**3", 0.0), ("-k*p.x**7", 0.0), ("-k*(p.x - 0.7)**2", 0.7), ("-k*(p.x - 0.7)**3*(1 + p.x**2)", 0.7),
    ("-k*(exp(p.x) - 1)**3", 0.0), ("-k*p.x*abs(p.x)", 0.0), ("-k*p.x*abs(p.x)**1.5", 0.0), ("-k*sin(p.x)**9", 0.0),
]  # fmt: skip


@pytest.mark.table
@pytest.mark.parametrize(("force", "place"), POWERS)
def test_a_force_that_is_flat_where_it_vanishes_is_an_equilibrium(force, place):
    text = f"""
mbstab: 1
parameters: {{k: 100}}
bodies: {{p: {{type: planar_point, mass: 1}}}}
constraints: {{rail: {{holonomic: p.y}}}}
forces: {{f: {{type: expression, on: {{p.x: "{force}"}}}}}}
reference: {{find: equilibrium, guess: {{p: {{x: 0.3, y: 0}}}}}}
"""
    for stiffness in (1e-9, 100.0, 1e9):
        assert mbstab.loads(text).at(k=stiffness).motion().q[0] == pytest.approx(place, abs=1e-15)
