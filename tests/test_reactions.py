"""What joints, contacts and drives transmit: against statics by hand, and action = reaction."""

import math

import numpy as np
import pytest

import mbstab
from mbstab.model.library import installed_models

MODELS = {path.stem: path for path in installed_models()}
G = 9.81


def loads(text, **parameters):
    """Return the reactions of the first solution by owner."""
    item = mbstab.loads(text).equilibria(**parameters)[0]
    return {r.owner: r for r in item.reactions}


def check(reaction, force, torque=(), size=1.0, on=None, at=None):
    np.testing.assert_allclose(reaction.force, force, atol=1e-12 * size)
    np.testing.assert_allclose(reaction.torque, torque, atol=1e-12 * size)
    if on is not None:
        assert reaction.body == on
    if at is not None:
        np.testing.assert_allclose(reaction.point, at, atol=1e-12)


# --- beams and arches -----------------------------------------------------------------------------------------------


def test_a_simply_supported_beam():
    # Span 4 m, a weight of 50 N in the middle and 120 N at 1 m from the pin.
    text = """
mbstab: 1
gravity: [0, -10]
bodies:
  beam: {type: planar, mass: 5, inertia: 1, points: {a: [-2, 0], b: [2, 0], load: [-1, 0]}}
joints:
  pin: {type: revolute, between: [beam.a, ground]}
  roller: {type: point_on_line, between: [ground, beam.b], axis: x}
forces:
  load: {type: force, at: beam.load, vector: [30, -120]}
reference: {find: equilibrium, guess: {beam: {x: 2, theta: 0.1}}}
"""
    found = loads(text)
    assert list(found) == ["joint 'pin'", "joint 'roller'"]
    check(found["joint 'pin'"], [-30.0, 25.0 + 90.0], [0.0], 100.0, "beam", [0.0, 0.0])
    roller = found["joint 'roller'"]
    check(roller, [0.0, 25.0 + 30.0], [0.0], 100.0, "beam")
    np.testing.assert_allclose(roller.point, [4.0, 0.0], atol=1e-12)


def test_a_cantilever_is_held_by_a_force_and_a_moment():
    text = """
mbstab: 1
gravity: [0, -10]
ground: {points: {wall: [1, 2]}}
bodies:
  beam: {type: planar, mass: 5, inertia: 1, points: {a: [-2, 0], tip: [2, 0]}}
joints:
  wall: {type: fixed, between: [beam.a, ground.wall]}
forces:
  load: {type: force, at: beam.tip, vector: [7, -20]}
  twist: {type: torque, body: beam, value: 3}
reference: {find: equilibrium, guess: {beam: {x: 3, y: 2}}}
"""
    check(loads(text)["joint 'wall'"], [-7.0, 70.0], [50.0 * 2.0 + 20.0 * 4.0 - 3.0], 100.0, "beam", [1.0, 2.0])
    # The other way round the reaction is still that on the body, not on the ground.
    turned = text.replace("[beam.a, ground.wall]", "[ground.wall, beam.a]")
    check(loads(turned)["joint 'wall'"], [-7.0, 70.0], [177.0], 100.0, "beam", [1.0, 2.0])


def test_a_three_hinged_arch():
    # Rods from (0, 0) and (6, 0) to the crown at (2, 3); weights in their middles.
    text = f"""
mbstab: 1
gravity: [0, -10]
ground: {{points: {{B: [6, 0]}}}}
bodies:
  left: {{type: planar, mass: 4, inertia: 1, points: {{a: [-{math.sqrt(13) / 2}, 0], c: [{math.sqrt(13) / 2}, 0]}}}}
  right: {{type: planar, mass: 6, inertia: 1, points: {{b: [-2.5, 0], c: [2.5, 0]}}}}
joints:
  A: {{type: revolute, between: [left.a, ground]}}
  B: {{type: revolute, between: [right.b, ground.B]}}
  crown: {{type: revolute, between: [left.c, right.c]}}
reference:
  find: equilibrium
  guess: {{left: {{x: 1, y: 1.5, theta: 1}}, right: {{x: 4, y: 1.4, theta: 2.5}}}}
"""
    found = loads(text)
    # Moments about A of the whole, and about the crown of the left half.
    B_y = (40.0 * 1.0 + 60.0 * 4.0) / 6.0
    A_y = 100.0 - B_y
    A_x = (A_y * 2.0 - 40.0 * 1.0) / 3.0
    check(found["joint 'A'"], [A_x, A_y], [0.0], 100.0, "left", [0.0, 0.0])
    check(found["joint 'B'"], [-A_x, B_y], [0.0], 100.0, "right", [6.0, 0.0])
    check(found["joint 'crown'"], [-A_x, 40.0 - A_y], [0.0], 100.0, "left", [2.0, 3.0])


# --- motion ---------------------------------------------------------------------------------------------------------


def test_the_hinge_of_a_turning_arm_pulls_it_inwards():
    text = """
mbstab: 1
parameters: {Omega: 7}
bodies:
  arm: {type: planar, mass: 3, inertia: 0.2, points: {hinge: [-0.4, 0]}}
joints:
  hinge: {type: revolute, between: [arm.hinge, ground]}
reference:
  find: steady
  steady: {axis: z, rate: Omega}
  coordinates: {arm: {theta: 0.3}}
  guess: {arm: {x: 0.4}}
"""
    size = 3.0 * 0.4 * 49.0
    force = -size * np.array([math.cos(0.3), math.sin(0.3)])
    check(loads(text)["joint 'hinge'"], force, [0.0], size, "arm", [0.0, 0.0])


def test_a_drive_holds_a_rod_against_its_weight():
    text = """
mbstab: 1
gravity: [0, -10]
bodies:
  rod: {type: planar, mass: 2, inertia: 0.1, points: {O: [-0.5, 0]}}
joints:
  pivot: {type: revolute, between: [rod.O, ground]}
drives:
  motor: {type: joint, joint: pivot, position: 0.3}
reference: {find: equilibrium, guess: {rod: {x: 0.5}}}
"""
    found = loads(text)
    check(found["joint 'pivot'"], [0.0, 20.0], [0.0], 10.0)
    check(found["drive 'motor'"], [0.0, 0.0], [20.0 * 0.5 * math.cos(0.3)], 10.0, "rod")


def test_a_drive_turns_against_a_damper():
    text = """
mbstab: 1
bodies:
  rotor: {type: spatial, mass: 2, inertia: [0.1, 0.1, 0.2]}
joints:
  bearing: {type: revolute, between: [rotor, ground], axis: z}
drives:
  motor: {type: joint, joint: bearing, velocity: 5}
forces:
  brake: {type: joint_spring, joint: bearing, damping: 0.3}
reference:
  find: steady
  steady: {axis: z, rate: 5}
"""
    found = loads(text)
    check(found["drive 'motor'"], [0.0, 0.0, 0.0], [0.0, 0.0, 1.5], 1.0, "rotor")
    check(found["joint 'bearing'"], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0], 1.0)


# --- contacts -------------------------------------------------------------------------------------------------------


def test_a_wheel_on_a_slope_is_held_by_a_spring():
    # Plane through the origin, raised by 0.5 rad in x; the spring is along the slope and holds the centre.
    slope, radius, mass, stiffness = 0.5, 0.2, 3.0, 400.0
    normal = np.array([-math.sin(slope), math.cos(slope)])
    along = np.array([math.cos(slope), math.sin(slope)])
    anchor = 5.0 * along + radius * normal
    text = f"""
mbstab: 1
gravity: [0, -10]
ground: {{points: {{P: [{anchor[0]}, {anchor[1]}]}}}}
bodies:
  wheel: {{type: planar, mass: {mass}, inertia: 0.05}}
contacts:
  slope: {{type: disk, center: wheel, radius: {radius}, normal: [{normal[0]}, {normal[1]}]}}
forces:
  rope: {{type: spring, between: [wheel, ground.P], stiffness: {stiffness}, length: 2}}
reference: {{find: equilibrium, guess: {{wheel: {{x: {(3.1 * along)[0]}, y: {(3.1 * along + radius * normal)[1]}}}}}}}
"""
    reaction = loads(text)["contact 'slope'"]
    # About the point of contact the rope at the centre balances the weight: no friction.
    check(reaction, mass * 10.0 * math.cos(slope) * normal, (), 10.0, "wheel")
    assert reaction.point is None
    # Held at its top instead, rope and friction share the weight's pull.
    top = text.replace("inertia: 0.05", f"inertia: 0.05, points: {{top: [{radius * normal[0]}, {radius * normal[1]}]}}")
    top = top.replace("[wheel, ground.P]", "[wheel.top, ground.Q]").replace(
        "P: [", f"Q: [{(anchor + radius * normal)[0]}, {(anchor + radius * normal)[1]}], P: ["
    )
    top = top.replace("guess: {wheel: {", "guess: {wheel: {theta: 0.0, ")
    reaction = loads(top)["contact 'slope'"]
    model = mbstab.loads(top)
    item = model.equilibria()[0]
    rope = -(reaction.force + np.array([0.0, -30.0]))
    x, y, theta = item.motion.q
    arm = np.array([[math.cos(theta), -math.sin(theta)], [math.sin(theta), math.cos(theta)]]) @ (radius * normal)
    contact = -radius * normal
    moment = arm[0] * rope[1] - arm[1] * rope[0] + contact[0] * reaction.force[1] - contact[1] * reaction.force[0]
    assert abs(moment) < 1e-11
    gap = anchor + radius * normal - (np.array([x, y]) + arm)
    pull = stiffness * (np.linalg.norm(gap) - 2.0) * gap / np.linalg.norm(gap)
    np.testing.assert_allclose(rope, pull, atol=1e-10)
    assert reaction.force @ along > 1.0  # friction shares the pull of the weight


def test_the_contact_forces_of_a_bicycle_carry_its_weight():
    item = mbstab.load(MODELS["whipple_bicycle"]).equilibria()[0]
    found = {r.owner: r for r in item.reactions}
    total = 9.81 * (2.0 + 85.0 + 4.0 + 3.0)
    # Moments about the contact of the rear wheel; wheel base 1.02 m.
    front = 9.81 * (85.0 * 0.3 + 4.0 * 0.9 + 3.0 * 1.02) / 1.02
    check(found["contact 'front'"], [0.0, 0.0, front], (), total)
    check(found["contact 'rear'"], [0.0, 0.0, total - front], (), total)


def test_a_disk_rolling_straight_ahead_needs_no_friction():
    item = mbstab.load(MODELS["rolling_disk"]).equilibria()[0]
    found = {r.owner: r for r in item.reactions}
    check(found["contact 'rolling'"], [0.0, 0.0, 2.0 * G], (), 20.0)


# --- space ----------------------------------------------------------------------------------------------------------


def rotation(axes):
    """Return Ax(φ) Ay(θ) Az(ψ)."""
    (a, b, c), (x, y, z) = np.cos(axes), np.sin(axes)
    one = np.array([[1, 0, 0], [0, a, -x], [0, x, a]])
    two = np.array([[b, 0, y], [0, 1, 0], [-y, 0, b]])
    return one @ two @ np.array([[c, -z, 0], [z, c, 0], [0, 0, 1]])


@pytest.mark.parametrize("axes", [(0.0, 0.0, 0.0), (0.4, -0.7, 1.1)])
@pytest.mark.parametrize("angles", [(0.0, 0.0, 0.0), (0.3, 0.5, -0.9)])
def test_a_bracket_in_space_is_held_by_a_force_and_a_torque_with_three_components(axes, angles):
    A = rotation(axes) @ rotation(angles)
    root, tip, centre = np.array([0.1, -0.2, 0.3]), np.array([0.5, 0.6, -0.4]), np.array([0.2, 0.1, 0.05])
    foot = np.array([1.0, 2.0, -1.0])
    push, twist = np.array([3.0, -8.0, 5.0]), np.array([0.7, -0.2, 1.3])
    origin = foot - A @ root
    triad = [(A.T @ np.eye(3)[k]).tolist() for k in (2, 0)]
    text = f"""
mbstab: 1
gravity: [1, -2, -9]
ground: {{points: {{foot: {foot.tolist()}}}}}
bodies:
  bracket:
    type: spatial
    mass: 2
    inertia: [0.1, 0.1, 0.1]
    axes: {list(axes)}
    center_of_mass: {centre.tolist()}
    points: {{root: {root.tolist()}, tip: {tip.tolist()}}}
joints:
  weld:
    type: fixed
    between: [bracket.root, ground.foot]
    axis: [{triad[0]}, z]
    zero: [{triad[1]}, x]
forces:
  push: {{type: force, at: bracket.tip, vector: {push.tolist()}}}
  twist: {{type: torque, body: bracket, vector: {twist.tolist()}}}
reference:
  find: equilibrium
  guess:
    bracket: {{x: {origin[0]}, y: {origin[1]}, z: {origin[2]}, phi: {angles[0]}, theta: {angles[1]}, psi: {angles[2]}}}
"""
    weight = 2.0 * np.array([1.0, -2.0, -9.0])
    torque = -twist - np.cross(A @ (tip - root), push) - np.cross(A @ (centre - root), weight)
    check(loads(text)["joint 'weld'"], -push - weight, torque, 30.0, "bracket", foot)


def test_a_hinge_takes_torque_across_its_axis_only():
    text = """
mbstab: 1
gravity: [0, 0, -10]
bodies:
  door: {type: spatial, mass: 20, inertia: [1, 1, 1], points: {hinge: [-0.5, 0, -0.3]}}
joints:
  hinge: {type: revolute, between: [door.hinge, ground], axis: z}
forces:
  gust: {type: torque, body: door, vector: [4, 0, 0]}
reference: {find: equilibrium, coordinates: {door: {psi: 0}}, guess: {door: {x: 0.5, z: 0.3}}}
"""
    check(loads(text)["joint 'hinge'"], [0.0, 0.0, 200.0], [-4.0, -100.0, 0.0], 200.0, "door", [0.0, 0.0, 0.0])


def test_a_tilted_arm_that_turns_is_held_by_a_torque_across_the_shaft():
    # A rod welded at 0.6 rad to a shaft that turns: its products of inertia need the torque Ω² I_rz.
    Omega, slope, inertia, mass = 9.0, 0.6, 0.3, 2.0
    text = f"""
mbstab: 1
bodies:
  rod: {{type: spatial, mass: {mass}, inertia: [0.001, {inertia}, {inertia}]}}
joints:
  bearing: {{type: revolute, between: [rod, ground], axis: [[{math.sin(slope)}, 0, {math.cos(slope)}], z]}}
reference:
  find: steady
  steady: {{axis: z, rate: {Omega}}}
  coordinates: {{rod: {{phi: 0, psi: 0}}}}
  guess: {{rod: {{theta: {-slope}}}}}
"""
    found = loads(text)["joint 'bearing'"]
    # The rod is along r = (cos θ, 0, −sin θ) with θ = −slope or so; L = I·ω, torque = ω × L.
    item = mbstab.loads(text).equilibria()[0]
    theta = item.motion.q[4]
    A = rotation(item.motion.q[3:])
    np.testing.assert_allclose(A @ [math.sin(slope), 0.0, math.cos(slope)], [0.0, 0.0, 1.0], atol=1e-14)
    tensor = A @ np.diag([0.001, inertia, inertia]) @ A.T
    omega = np.array([0.0, 0.0, Omega])
    expected = np.cross(omega, tensor @ omega)
    assert abs(expected[1]) > 1.0
    assert abs(abs(expected[1]) - Omega**2 * (inertia - 0.001) * abs(math.sin(theta) * math.cos(theta))) < 1e-12
    check(found, [0.0, 0.0, 0.0], expected, 10.0, "rod")


def test_joints_between_two_bodies_act_on_the_first():
    text = """
mbstab: 1
gravity: [0, -10]
bodies:
  upper: {type: planar_point, mass: 1}
  lower: {type: planar_point, mass: 4}
joints:
  hook: {type: distance, between: [upper, ground], length: 1}
  string: {type: distance, between: [BETWEEN], length: 1}
reference: {find: equilibrium, guess: {upper: {y: -1}, lower: {x: 0.1, y: -2}}}
"""
    found = loads(text.replace("BETWEEN", "upper, lower"))
    check(found["joint 'hook'"], [0.0, 50.0], (), 50.0, "upper", [0.0, -1.0])
    check(found["joint 'string'"], [0.0, -40.0], (), 50.0, "upper", [0.0, -1.0])
    found = loads(text.replace("BETWEEN", "lower, upper"))
    check(found["joint 'string'"], [0.0, 40.0], (), 50.0, "lower", [0.0, -2.0])


def test_constraints_written_as_expressions_react_at_their_body():
    text = """
mbstab: 1
gravity: [0, -10]
bodies:
  p: {type: planar_point, mass: 3}
constraints:
  slope: {holonomic: p.y - 0.5*p.x}
forces:
  stop: {type: spring, between: [p, ground], stiffness: 100, length: 1}
reference: {find: equilibrium, guess: {p: {x: -1, y: -0.5}}}
"""
    found = loads(text)
    push = 30.0 * 2.0 / math.sqrt(5.0)
    check(found["constraint 'slope'"], push * np.array([-1.0, 2.0]) / math.sqrt(5.0), (), 30.0, "p")


TRAIN = """
mbstab: 1
bodies:
  one: {type: planar, mass: 1, inertia: 1}
  two: {type: planar, mass: 1, inertia: 1}
  three: {type: planar, mass: 1, inertia: 1}
joints:
  a: {type: revolute, between: [one, ground]}
  b: {type: revolute, between: [two, ground]}
  c: {type: revolute, between: [three, ground]}
  train: {KIND}
forces:
  push: {type: torque, body: one, value: 8}
  b: {type: joint_spring, joint: b, stiffness: 50}
  c: {type: joint_spring, joint: c, stiffness: 70}
reference: {find: equilibrium}
"""


@pytest.mark.parametrize(
    ("kind", "torques"),
    [
        ("type: gear, joints: [a, b], teeth: [20, 60]", {"one": -8, "two": -24, "ground": 32}),
        ("type: gear, joints: [a, b], teeth: [20, 60], internal: true", {"one": -8, "two": 24, "ground": -16}),
        ("type: belt, joints: [a, b], ratio: 3", {"one": -8, "two": 24, "ground": -16}),
        ("type: belt, joints: [a, b], ratio: 3, crossed: true", {"one": -8, "two": -24, "ground": 32}),
        ("type: belt, joints: [a, b], radii: [0.1, 0.3], stiffness: 4e3", {"one": -8, "two": 24, "ground": -16}),
        ("type: differential, joints: [a, b, c]", {"one": -8, "two": 4, "three": 4, "ground": 0}),
        ("type: differential, joints: [a, b, c], teeth: [1, 3]", {"one": -8, "two": 2, "three": 6, "ground": 0}),
    ],
)
def test_trains_pass_torques_on_and_leave_the_rest_to_the_ground(kind, torques):
    """No work is lost: a wheel that turns n times as fast takes 1/n of the torque."""
    reactions = mbstab.loads(TRAIN.replace("KIND", kind)).equilibria()[0].reactions
    found = {x.body: x for x in reactions if x.owner == "joint 'train'"}
    assert found.keys() == torques.keys()
    for body, torque in torques.items():
        check(found[body], [0.0, 0.0], [torque], 100.0)


def test_redundant_supports_carry_the_weight_in_sum():
    text = """
mbstab: 1
gravity: [0, -10]
bodies:
  beam: {type: planar, mass: 6, inertia: 1, points: {a: [-2, 0], b: [0, 0], c: [2, 0]}}
joints:
  pin: {type: revolute, between: [beam.a, ground]}
  middle: {type: point_on_line, between: [ground, beam.b], axis: x}
  end: {type: point_on_line, between: [ground, beam.c], axis: x}
reference: {find: equilibrium, guess: {beam: {x: 2}}}
"""
    item = mbstab.loads(text).equilibria()[0]
    assert len(item.motion.redundant) == 1
    forces = [r.force for r in item.reactions]
    np.testing.assert_allclose(sum(forces), [0.0, 60.0], atol=1e-12)
    moment = 2.0 * forces[1][1] + 4.0 * forces[2][1]
    assert abs(moment - 120.0) < 1e-11


# --- action = reaction ----------------------------------------------------------------------------------------------


def totals(model, **parameters):
    """Return force and torque about the origin of all reactions of the ground, and what mass and weight need."""
    system = model.system(**parameters)
    item = model.equilibria(**parameters)[0]
    grounded = set()
    for section in ("joints", "contacts", "drives", "constraints"):
        for name, entry in model.model.entries[section].items():
            between = entry.values.get("between")
            if between is None or any(marker.body is None for marker in between):
                grounded.add(f"{section.removesuffix('s')} {name!r}")
    force, torque = np.zeros(3), np.zeros(3)
    for r in item.reactions:
        if r.owner in grounded:
            force += r.force
            torque += np.cross(r.point, r.force) + r.torque
    return system, item, force, torque


@pytest.mark.parametrize(("name", "parameters"), [("governor", {"omega": 20}), ("governor", {}), ("bricard", {})])
def test_the_ground_carries_what_mass_and_weight_need(name, parameters):
    model = mbstab.load(MODELS[name])
    system, item, force, torque = totals(model, **parameters)
    gravity = np.array([float(x) for x in system.scene.gravity])
    needed_force, needed_torque = np.zeros(3), np.zeros(3)
    omega = np.array([0.0, 0.0, item.steady.rate])
    for body, part in zip(system.scene.bodies, system.body_slices, strict=True):
        q = item.motion.q[part]
        A = np.array(body.base, dtype=float).reshape(3, 3) @ rotation(q[3:])
        place = q[:3] + A @ np.array([float(x) for x in body.center])
        load = float(body.mass) * (np.cross(omega, np.cross(omega, place)) - gravity)
        xx, yy, zz, xy, xz, yz = (float(x) for x in body.inertia)
        tensor = A @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ A.T
        needed_force += load
        needed_torque += np.cross(place, load) + np.cross(omega, tensor @ omega)
    size = np.linalg.norm(gravity) * sum(float(body.mass) for body in system.scene.bodies)
    np.testing.assert_allclose(force, needed_force, atol=1e-11 * size)
    np.testing.assert_allclose(torque, needed_torque, atol=1e-11 * size)


def test_the_spring_of_the_governor_pulls_the_slider_as_hard_as_its_bars_and_its_weight():
    model = mbstab.load(MODELS["governor"])
    item = model.equilibria()[0]
    found = {r.owner: r for r in item.reactions}
    state = dict(zip(model.model.coordinates(), item.motion.q, strict=True))
    stiffness = G * (40 + 24 + 20) / (4.0 * (0.2 * math.sin(math.pi / 3.0) - math.sqrt(2.0) * 0.05))
    pull = stiffness * (0.2 - state["slider.z"] - math.sqrt(2.0) * 0.05)
    # right_end acts on the rod, left_end on the slider: the first body that is named.
    assert (found["joint 'right_end'"].body, found["joint 'left_end'"].body) == ("right_rod", "slider")
    total = pull - 5.0 * G - found["joint 'right_end'"].force[2] + found["joint 'left_end'"].force[2]
    assert abs(total) < 1e-10
