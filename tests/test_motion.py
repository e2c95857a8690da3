"""The reference motion: assembly, each joint, drive, contact and force in a small mechanism, and what is refused."""

import math
import re

import numpy as np
import pytest

import mbstab
from mbstab.analysis.algebra.matching import matched
from mbstab.errors import ConstraintError, EquilibriumError, MassError, MbstabError, ModelFileError, NumericalError
from mbstab.model.library import find_model


def source(name):
    """Return the text of an example."""
    return find_model(name).path.read_text(encoding="utf-8")


# --- a frame that is turned against everything ----------------------------------------------------------------------

ANGLES = (0.4, -0.5, 0.9)


def rotation(phi, theta, psi):
    def about(axis, angle):
        c, s = math.cos(angle), math.sin(angle)
        j, k = (axis + 1) % 3, (axis + 2) % 3
        matrix = np.eye(3)
        matrix[[j, j, k, k], [j, k, j, k]] = c, -s, s, c
        return matrix

    return about(0, phi) @ about(1, theta) @ about(2, psi)


TURNED = rotation(*ANGLES)


def text(vector):
    return "[" + ", ".join(repr(float(x)) for x in vector) + "]"


def ground(vector):
    """Return, as text, a vector of the turned frame in ground axes."""
    return text(TURNED @ np.array(vector, dtype=float))


def axis(own, other=None):
    """Return, as text, a joint axis in the frame of the body and in that of the ground, which is not turned."""
    return f"[{text(own)}, {ground(own if other is None else other)}]"


def scene(gravity=(0, 0, 0), reference="", **sections):
    """Return a model text: sections with one entry per line, gravity and reference."""
    lines = ["mbstab: 1", f"gravity: {gravity if isinstance(gravity, str) else list(gravity)}"]
    for name, entries in sections.items():
        lines += [f"{name}:", *(f"  {entry}" for entry in ([entries] if isinstance(entries, str) else entries))]
    return "\n".join([*lines, "reference:", *(f"  {line}" for line in reference.splitlines()), ""])


def assert_eigenvalues(result, expected, rtol=1e-13):
    # Zeros that no symmetry explains are among the values.
    found, expected = ([s for s in x if abs(s) > 1e-9 * max(np.abs(x))] for x in (result.values(), expected))
    assert len(found) == len(expected)
    np.testing.assert_array_less(matched(found, expected), rtol * np.abs(expected) + 1e-300)


def components(vector):
    """Return x, y, z of a vector as keys of a model text."""
    return ", ".join(f"{name}: {float(x)!r}" for name, x in zip("xyz", vector, strict=True))


def pairs(*squares):
    """Return ±√(s²) for each."""
    roots = [complex(square) ** 0.5 for square in squares]
    return [sign * root for root in roots for sign in (1, -1)]


# --- assembly -------------------------------------------------------------------------------------------------------

# Links of 1, 2.5, 1.8 m on a base of 2.2 m; without gravity every position is at rest.
FOUR_BAR = """\
mbstab: 1
parameters: {turn: 0}
ground: {points: {B: [2.2, 0]}}
bodies:
  crank: {type: planar, mass: 1, inertia: 0.1, points: {A: [-0.5, 0], C: [0.5, 0]}}
  coupler: {type: planar, mass: 2, inertia: 0.4, points: {C: [-1.25, 0], D: [1.25, 0]}}
  rocker: {type: planar, mass: 1.5, inertia: 0.3, points: {B: [-0.9, 0], D: [0.9, 0]}}
joints:
  A: {type: revolute, between: [crank.A, ground]}
  B: {type: revolute, between: [rocker.B, ground.B]}
  C: {type: revolute, between: [coupler.C, crank.C]}
  D: {type: revolute, between: [coupler.D, rocker.D]}
reference:
  coordinates: {crank: {theta: 1.1}}
  rates: {crank: {theta: turn}}
  guess:
    coupler: {x: 1, y: SIDE, theta: 0}
    rocker: {x: 2, y: SIDE, theta: SIDE}
"""


def four_bar_pins(crank, side):
    """Return the pins C and D where circles about C and B meet, on one side of the line between them."""
    C, B = np.array([math.cos(crank), math.sin(crank)]), np.array([2.2, 0.0])
    line = B - C
    span = np.linalg.norm(line)
    along = (2.5**2 - 1.8**2 + span**2) / (2.0 * span)
    across = math.sqrt(2.5**2 - along**2)
    e = line / span
    return C, C + along * e + side * across * np.array([-e[1], e[0]])


@pytest.mark.parametrize("side", [1, -1])
def test_the_guess_chooses_the_branch_of_a_four_bar(side):
    motion = mbstab.loads(FOUR_BAR.replace("SIDE", str(side))).motion()
    C, D = four_bar_pins(1.1, side)
    places = np.concatenate([C / 2, [1.1], (C + D) / 2, [np.arctan2(*(D - C)[::-1])]])
    np.testing.assert_allclose(motion.q[:6], places, rtol=1e-13, atol=1e-14)
    np.testing.assert_allclose(motion.q[6:8], (D + np.array([2.2, 0.0])) / 2, rtol=1e-13, atol=1e-14)
    assert motion.at_rest
    assert len(motion.solved) == 8


@pytest.mark.parametrize("side", [1, -1])
def test_missing_rates_are_those_of_the_moving_four_bar(side):
    motion = mbstab.loads(FOUR_BAR.replace("SIDE", str(side))).motion(turn=0.7)
    step = 1e-5
    before, after = (np.concatenate(four_bar_pins(1.1 + sign * step, side)) for sign in (-1, 1))
    rates = 0.7 * (after - before) / (2 * step)
    C, D = rates[:2], rates[2:]
    np.testing.assert_allclose(motion.u[[0, 1, 3, 4, 6, 7]], np.concatenate([C, C + D, D]) / 2, rtol=1e-8, atol=1e-10)


def test_a_slider_crank_off_symmetry_is_assembled():
    lines = source("slider_crank").partition("reference:")[0]
    r, length, angle = 0.1, 0.3, 0.7
    assembled = mbstab.loads(
        lines.replace("stiffness: k", "stiffness: k, rest: 0.7")
        + f"reference:\n  coordinates: {{crank: {{theta: {angle}}}}}\n"
        + "  guess: {slider: {x: 0.4}, rod: {x: 0.2}}\n"
    ).motion()
    lean = -math.asin(r * math.sin(angle) / length)
    slider = r * math.cos(angle) + length * math.cos(lean)
    np.testing.assert_allclose(assembled.q[5:], [lean, slider, 0.0, 0.0], rtol=1e-13, atol=1e-15)


def test_a_position_that_cannot_be_reached_is_an_error_that_asks_for_a_guess():
    broken = FOUR_BAR.replace("SIDE", "1").replace("B: [2.2, 0]", "B: [22, 0]")
    with pytest.raises(
        ModelFileError,
        match=r"no coordinates were found that satisfy all(.|\n)*give starting values under reference\.guess",
    ):
        mbstab.loads(broken).motion()


# --- spatial joints -------------------------------------------------------------------------------------------------

MASS, INERTIA = 2.0, (0.3, 0.4, 0.5)
BODY = f"type: spatial, mass: {MASS}, inertia: {list(INERTIA)}, axes: {list(ANGLES)}"
AT_REST = "coordinates: {b: {x: 0, y: 0, z: 0, phi: 0, theta: 0, psi: 0}}"
LEVEL = "coordinates: {b: {phi: 0, theta: 0, psi: 0}}"
# A direction and the moment of inertia about it; all of it is written in the turned frame.
N = np.array([0.6, 0.64, 0.48])
J = float(np.array(INERTIA) @ N**2)
ZERO = np.array([-0.64, 0.6, 0.0])
HINGE = f"axis: {axis(N)}, zero: {axis(ZERO)}"
K, KT, L, G = 7.0, 11.0, 0.8, 9.81
HANGING = f"points: {{O: [0, 0, {L}]}}"


def spring(motion, stiffness=K, more=""):
    return f"{motion}: {{type: joint_spring, joint: j, motion: {motion}, stiffness: {stiffness}{more}}}"


def spatial(joint, *forces, body="", gravity=(0, 0, 0), reference=AT_REST):
    sections = {"bodies": f"b: {{{BODY}{', ' if body else ''}{body}}}", "joints": f"j: {{{joint}}}"}
    return scene(ground(gravity), reference, **sections, **({"forces": forces} if forces else {}))


SPATIAL_JOINTS = {
    # Model, degrees of freedom, eigenvalues that are not zero.
    "revolute": (spatial(f"type: revolute, between: [b, ground], {HINGE}", spring("angle")), 1, pairs(-K / J)),
    "revolute-about-a-point-of-the-body": (
        spatial(
            f"type: revolute, between: [b.O, ground], axis: {axis([0, 1, 0])}",
            body=HANGING,
            gravity=(0, 0, -G),
            reference=LEVEL,
        ),
        1,
        pairs(-MASS * G * L / (INERTIA[1] + MASS * L**2)),
    ),
    "prismatic": (
        spatial(f"type: prismatic, between: [b, ground], {HINGE}", spring("displacement")),
        1,
        pairs(-K / MASS),
    ),
    "cylindrical": (
        spatial(f"type: cylindrical, between: [b, ground], {HINGE}", spring("angle"), spring("displacement", KT)),
        2,
        pairs(-K / J, -KT / MASS),
    ),
    "universal": (
        spatial(
            f"type: universal, between: [b.O, ground], axis: {axis([0, 1, 0], [1, 0, 0])}",
            body=HANGING,
            gravity=(0, 0, -G),
            reference=LEVEL,
        ),
        2,
        pairs(*(-MASS * G * L / (moment + MASS * L**2) for moment in INERTIA[:2])),
    ),
    "spherical": (
        spatial(
            "type: spherical, between: [b.O, ground]",
            body=HANGING,
            gravity=(0, 0, -G),
            reference=LEVEL,
        ),
        3,
        pairs(*(-MASS * G * L / (moment + MASS * L**2) for moment in INERTIA[:2])),
    ),
    "planar": (
        spatial(
            f"type: planar, between: [b, ground], {HINGE}",
            spring("angle"),
            f"soil: {{type: expression, on: {{b.x: -{KT}*b.x, b.y: -{KT}*b.y, b.z: -{KT}*b.z}}}}",
        ),
        3,
        pairs(-K / J, -KT / MASS, -KT / MASS),
    ),
    "point-on-line": (
        spatial(
            f"type: point_on_line, between: [b, ground], axis: {axis(N)}",
            f"soil: {{type: expression, on: {{b.x: -{KT}*b.x, b.y: -{KT}*b.y, b.z: -{KT}*b.z}}}}",
        ),
        4,
        pairs(-KT / MASS),
    ),
    "screw": (
        spatial(f"type: screw, between: [b, ground], {HINGE}, lead: 3.5", spring("angle")),
        1,
        pairs(-K / (J + MASS * (3.5 / (2 * math.pi)) ** 2)),
    ),
    "screw-pulled-along": (
        spatial(f"type: screw, between: [b, ground], {HINGE}, lead: -3.5", spring("displacement", KT)),
        1,
        pairs(-KT * (3.5 / (2 * math.pi)) ** 2 / (J + MASS * (3.5 / (2 * math.pi)) ** 2)),
    ),
    "distance": (
        scene(
            ground((0, 0, -G)),
            "coordinates: {p: {" + components(TURNED @ [0, 0, -L]) + "}}",
            bodies="p: {type: point, mass: 3}",
            joints=f"j: {{type: distance, between: [p, ground], length: {L}}}",
        ),
        2,
        pairs(-G / L, -G / L),
    ),
    "fixed": (
        scene(
            "0",
            AT_REST + "\nguess: {c: {x: 0}}",
            bodies=[f"b: {{{BODY}}}", f"c: {{{BODY.replace('2.0', '1.5')}, points: {{P: [0.2, -0.1, 0.3]}}}}"],
            joints=[
                f"j: {{type: revolute, between: [b, ground], {HINGE}}}",
                f"weld: {{type: fixed, between: [c.P, b], axis: {text(N)}, zero: {text(ZERO)}}}",
            ],
            forces=spring("angle"),
        ),
        1,
        pairs(-K / (2 * J + 1.5 * float(np.sum(np.cross(N, [0.2, -0.1, 0.3]) ** 2)))),
    ),
}


@pytest.mark.parametrize("name", SPATIAL_JOINTS)
def test_a_body_on_a_spatial_joint_moves_as_its_closed_form_says(name):
    model, freedoms, expected = SPATIAL_JOINTS[name]
    result = mbstab.loads(model).eig()
    assert result.counts.degrees_of_freedom == freedoms
    assert result.counts.neutral == 2 * freedoms - len(expected)
    assert_eigenvalues(result, expected)
    assert result.warnings == ()


@pytest.mark.parametrize("start", [0.0, 0.25, -0.6])
@pytest.mark.parametrize("name", ["revolute", "prismatic", "cylindrical", "universal", "spherical", "planar", "screw"])
def test_a_spatial_joint_is_assembled_from_a_rough_guess(name, start):
    """Two bodies, the second one somewhere near; the first is held by its coordinates."""
    hinge = {"spherical": "", "universal": f", axis: [{text(N)}, {text(ZERO)}]"}.get(
        name, f", axis: {text(N)}, zero: {text(ZERO)}"
    )
    lead = ", lead: 0.4" if name == "screw" else ""
    model = scene(
        "0",
        "coordinates: {a: {x: 0.1, y: 0.2, z: 0.3, phi: 0.1, theta: 0.2, psi: -0.3}}\n"
        f"guess: {{b: {{x: {start}, y: 0.1, z: 0.2, phi: {start}, theta: 0.1, psi: -0.2}}}}",
        bodies=[f"a: {{{BODY}, points: {{P: [0.3, 0, 0.1]}}}}", f"b: {{{BODY}, points: {{Q: [0, -0.2, 0.1]}}}}"],
        joints=f"j: {{type: {name}, between: [b.Q, a.P]{hinge}{lead}}}",
    )
    motion = mbstab.loads(model).motion()
    np.testing.assert_allclose(motion.dynamics.E, 0.0, rtol=0.0, atol=1e-14)
    assert motion.solved == tuple(f"b.{name}" for name in ("x", "y", "z", "phi", "theta", "psi"))
    assert np.all(motion.q[:6] == [0.1, 0.2, 0.3, 0.1, 0.2, -0.3])


# --- planar joints --------------------------------------------------------------------------------------------------

C, S = math.cos(0.7), math.sin(0.7)
RAIL, OWN_RAIL = text([C, S]), text([math.cos(0.5), math.sin(0.5)])  # in the ground, and in a body turned by 0.2
FLAT = "type: planar, mass: 2.0, inertia: 0.3"
PLANAR_JOINTS = {
    "revolute": (
        scene(
            (0, 0),
            "coordinates: {b: {theta: 0.7}}",
            bodies=f"b: {{{FLAT}, points: {{O: [0.3, -0.4]}}}}",
            joints="j: {type: revolute, between: [b.O, ground]}",
            forces=spring("angle", more=", rest: 0.7"),
        ),
        1,
        pairs(-K / (0.3 + 2.0 * 0.5**2)),
    ),
    "revolute-in-gravity": (
        scene(
            (-G * S, -G * C),
            "coordinates: {b: {theta: -0.7}}\nguess: {b: {y: -1}}",
            bodies=f"b: {{{FLAT}, points: {{O: [0, 0.5]}}}}",
            joints="j: {type: revolute, between: [b.O, ground]}",
        ),
        1,
        pairs(-2.0 * G * 0.5 / (0.3 + 2.0 * 0.5**2)),
    ),
    "spherical-in-gravity": (
        scene(
            (0, -G),
            "coordinates: {b: {theta: 0}}",
            bodies=f"b: {{{FLAT}, points: {{O: [0, 0.5]}}}}",
            joints="j: {type: spherical, between: [b.O, ground]}",
        ),
        1,
        pairs(-2.0 * G * 0.5 / (0.3 + 2.0 * 0.5**2)),
    ),
    "prismatic": (
        scene(
            (0, 0),
            f"coordinates: {{b: {{x: {0.9 * C!r}, y: {0.9 * S!r}, theta: 0.2}}}}",
            bodies=f"b: {{{FLAT}}}",
            joints=f"j: {{type: prismatic, between: [b, ground], axis: [{OWN_RAIL}, {RAIL}]}}",
            forces=spring("displacement", more=", rest: 0.9, damping: 3"),
        ),
        1,
        [(-3.0 + root) / 4.0 for root in pairs(3.0**2 - 4 * 2.0 * K)],
    ),
    "point-on-line": (
        scene(
            (0, 0),
            "coordinates: {b: {x: 0, y: 0, theta: 0.4}}",
            bodies=f"b: {{{FLAT}}}",
            joints=f"j: {{type: point_on_line, between: [b, ground], axis: [[1, 0], [{C!r}, {S!r}]]}}",
            forces=f"soil: {{type: expression, on: {{b.x: -{KT}*b.x, b.y: -{KT}*b.y}}}}",
        ),
        2,
        pairs(-KT / 2.0),
    ),
    "fixed": (
        scene(
            (0, 0),
            "coordinates: {b: {theta: 0.7}}",
            bodies=[
                f"b: {{{FLAT}, points: {{O: [0, 0], P: [0.3, 0.1]}}}}",
                f"c: {{{FLAT}, points: {{Q: [-0.2, 0.2]}}}}",
            ],
            joints=[
                "j: {type: revolute, between: [b.O, ground]}",
                f"weld: {{type: fixed, between: [c.Q, b.P], axis: [[1, 0], [{C!r}, {S!r}]]}}",
            ],
            forces=spring("angle", more=", rest: 0.7"),
        ),
        1,
        pairs(
            -K / (0.6 + 2.0 * float(np.sum((np.array([0.3, 0.1]) - np.array([[C, -S], [S, C]]) @ [-0.2, 0.2]) ** 2)))
        ),
    ),
    "distance": (
        scene(
            (0, -G),
            f"coordinates: {{p: {{x: 0}}}}\nguess: {{p: {{y: -{L}}}}}",
            bodies="p: {type: planar_point, mass: 3}",
            joints=f"j: {{type: distance, between: [p, ground], length: {L}}}",
        ),
        1,
        pairs(-G / L),
    ),
}


@pytest.mark.parametrize("name", PLANAR_JOINTS)
def test_a_body_on_a_planar_joint_moves_as_its_closed_form_says(name):
    model, freedoms, expected = PLANAR_JOINTS[name]
    result = mbstab.loads(model).eig()
    assert result.counts.degrees_of_freedom == freedoms
    assert result.counts.neutral == 2 * freedoms - len(expected)
    assert_eigenvalues(result, expected)


# --- drives ---------------------------------------------------------------------------------------------------------

LAW, RATE, SECOND, TIME = "0.2 + 0.3*sin(2*t)", "0.6*cos(2*t)", "-1.2*sin(2*t)", 0.4
VALUES = 0.2 + 0.3 * math.sin(0.8), 0.6 * math.cos(0.8), -1.2 * math.sin(0.8)
PLANAR_ARM = {
    "bodies": f"b: {{{FLAT}, points: {{O: [-0.5, 0], P: [0.5, 0.2]}}}}",
    "joints": "j: {type: revolute, between: [b.O, ground]}",
}
PLANAR_SLIDE = {
    "bodies": f"b: {{{FLAT}}}",
    "joints": f"j: {{type: prismatic, between: [b, ground], axis: [[1, 0], [{C!r}, {S!r}]]}}",
}
SPATIAL_ARM = {"bodies": f"b: {{{BODY}}}", "joints": f"j: {{type: revolute, between: [b, ground], {HINGE}}}"}
SPATIAL_SLIDE = {"bodies": f"b: {{{BODY}}}", "joints": f"j: {{type: prismatic, between: [b, ground], {HINGE}}}"}


DRIVES = {
    # Scene, what is driven, how to read its value off coordinates, speeds or accelerations.
    "planar-coordinate": (PLANAR_ARM, "type: coordinate, coordinate: b.theta", lambda x: x[2]),
    "planar-joint-angle": (PLANAR_ARM, "type: joint, joint: j", lambda x: x[2]),
    "planar-joint-travel": (PLANAR_SLIDE, "type: joint, joint: j", lambda x: C * x[0] + S * x[1]),
    "planar-point": (PLANAR_SLIDE, "type: point, at: b, direction: [0, -2]", lambda x: -x[1]),
    "spatial-coordinate": (SPATIAL_SLIDE, "type: coordinate, coordinate: b.y", lambda x: x[1]),
    "spatial-joint-travel": (SPATIAL_SLIDE, "type: joint, joint: j", lambda x: TURNED @ N @ x[:3]),
    "spatial-point": (SPATIAL_SLIDE, "type: point, at: b, direction: [0, 0, 3]", lambda x: x[2]),
}


def driven(parts, drive, law):
    return scene(
        "0" if parts in (SPATIAL_ARM, SPATIAL_SLIDE) else (0, 0),
        f"time: {TIME}",
        **parts,
        drives=f"d: {{{drive}, {law}}}",
    )


@pytest.mark.parametrize("name", DRIVES)
def test_a_driven_position_fixes_place_speed_and_acceleration(name):
    parts, drive, read = DRIVES[name]
    model = mbstab.loads(driven(parts, drive, f"position: {LAW}"))
    motion = model.motion()
    np.testing.assert_allclose([read(motion.q), read(motion.u), read(motion.a)], VALUES, rtol=1e-13, atol=0.0)
    assert model.eig().counts.expected == 0
    assert model.check().n_nonholonomic == 0


@pytest.mark.parametrize("name", DRIVES)
def test_a_driven_rate_fixes_speed_and_acceleration_and_leaves_the_place(name):
    parts, drive, read = DRIVES[name]
    model = mbstab.loads(driven(parts, drive, f"velocity: {RATE}"))
    motion = model.motion()
    np.testing.assert_allclose([read(motion.u), read(motion.a)], VALUES[1:], rtol=1e-13, atol=0.0)
    result = model.eig()
    assert (result.counts.expected, result.counts.neutral) == (1, 1)
    assert result.counts.n_nonholonomic == 1


@pytest.mark.parametrize("law", [f"position: {LAW}", f"velocity: {RATE}"], ids=["position", "velocity"])
def test_a_driven_angle_of_a_spatial_joint_turns_the_body_about_the_axis(law):
    motion = mbstab.loads(driven(SPATIAL_ARM, "type: joint, joint: j", law)).motion()
    phi, theta, _ = motion.q[3:]
    rates = np.array(
        [
            [1.0, 0.0, math.sin(theta)],
            [0.0, math.cos(phi), -math.sin(phi) * math.cos(theta)],
            [0.0, math.sin(phi), math.cos(phi) * math.cos(theta)],
        ]
    )
    np.testing.assert_allclose(rates @ motion.u[3:], VALUES[1] * N, rtol=1e-13, atol=0.0)
    if law.startswith("position"):
        cosine = (np.trace(rotation(*motion.q[3:])) - 1.0) / 2.0
        assert math.acos(cosine) == pytest.approx(VALUES[0], rel=1e-13)


# --- contacts -------------------------------------------------------------------------------------------------------

UPRIGHT = (
    "coordinates: {b: {x: 0, y: 0, z: 0.4, phi: pi/2, theta: 0, psi: 0}}\n"  # the axle along -y, the track along x
)


def wheel(motion, rates):
    return mbstab.loads(
        scene(
            (0, 0, -G),
            UPRIGHT + f"rates: {{b: {{{rates}, z: 0, phi: 0, theta: 0}}}}",
            bodies=f"b: {{type: spatial, mass: {MASS}, inertia: [0.3, 0.3, 0.5]}}",
            contacts=f"c: {{type: wheel, center: b, axle: z, radius: 0.4, motion: {motion}}}",
        )
    )


@pytest.mark.parametrize(
    ("motion", "freedoms", "slips_along", "slips_across"),
    [
        ("rolling", 3, False, False),
        ("skate", 4, True, False),
        ("sideways", 4, False, True),
        ("frictionless", 5, True, True),
    ],
)
def test_a_wheel_slips_as_its_motion_says(motion, freedoms, slips_along, slips_across):
    assert wheel(motion, "x: 0, y: 0, psi: 0").check().degrees_of_freedom == freedoms
    assert wheel(motion, "x: 2, y: 0, psi: -5").motion().u[0] == 2.0
    along, across = wheel(motion, "x: 1, y: 0, psi: 0"), wheel(motion, "x: 0, y: 1, psi: 0")
    for slipping, allowed, row in ((along, slips_along, "slip along"), (across, slips_across, "slip across")):
        if allowed:
            assert not slipping.motion().at_rest
        else:
            with pytest.raises(ModelFileError, match=rf"contact 'c' \({row}\): the residual is -?1 m/s"):
                slipping.motion()


@pytest.mark.parametrize(
    ("motion", "freedoms", "inertia"), [("rolling", 1, 2.0 + 0.3 / 0.4**2), ("frictionless", 2, 2.0)]
)
def test_a_disk_rolls_with_its_inertia_or_slides_without(motion, freedoms, inertia):
    model = scene(
        (G * S, -G * C),
        "coordinates: {b: {x: 0.3, theta: 0}}",
        bodies=f"b: {{{FLAT}}}",
        contacts=f"c: {{type: disk, center: b, radius: 0.4, origin: [0, 0.1], motion: {motion}}}",
        forces=f"s: {{type: expression, on: {{b.x: -{KT}*(b.x - 0.3) - 2*{G * S!r}}}}}",
    )
    result = mbstab.loads(model).eig()
    assert result.counts.degrees_of_freedom == freedoms
    assert_eigenvalues(result, pairs(-KT / inertia))


KNIFE_PLANAR = scene(
    (0, 0),
    "coordinates: {b: {x: 0, y: 0, theta: 0.7}}\nrates: {b: {RATES}}",
    bodies=f"b: {{{FLAT}, points: {{E: [-0.25, 0.1]}}}}",
    contacts="edge: {type: knife_edge, at: b.E, along: [1, 0]}",
)
KNIFE_SPATIAL = scene(
    "0",
    AT_REST + "\nrates: {b: {RATES}}",
    bodies=f"b: {{{BODY}}}",
    contacts=f"edge: {{type: knife_edge, at: b, along: [1, 0, 0], normal: {ground([0, 0, 1])}}}",
)
STRAIGHT = ", phi: 0, theta: 0, psi: 0"


@pytest.mark.parametrize(
    ("model", "freedoms", "along", "across"),
    [
        (KNIFE_PLANAR, 2, f"x: {2 * C!r}, y: {2 * S!r}, theta: 0", f"x: {-S!r}, y: {C!r}, theta: 0"),
        (KNIFE_SPATIAL, 5, components(TURNED @ [2, 0, 0]) + STRAIGHT, components(TURNED @ [0, 1, 0]) + STRAIGHT),
    ],
    ids=["planar", "spatial"],
)
def test_a_knife_edge_moves_along_its_blade_only(model, freedoms, along, across):
    moving = mbstab.loads(model.replace("RATES", along))
    assert moving.check().degrees_of_freedom == freedoms
    assert not moving.motion().at_rest
    with pytest.raises(ModelFileError, match=r"contact 'edge' \(sideways\): the residual is -?1 m/s"):
        mbstab.loads(model.replace("RATES", across)).motion()


# --- forces ---------------------------------------------------------------------------------------------------------

ARM = {
    "bodies": f"b: {{{FLAT}, points: {{O: [0, -0.5], T: [0, 0.5]}}}}",
    "joints": "j: {type: revolute, between: [b.O, ground]}",
}
UPWARDS, SIDEWAYS = "coordinates: {b: {theta: 0}}\nguess: {b: {y: 1}}", "coordinates: {b: {theta: -pi/2}}"
ARM_INERTIA, MOMENT = 0.3 + 2.0 * 0.5**2, 2.0 * G * 0.5
STRETCHED = 0.4 + 3 * G / 50
HOLD = "s: {type: joint_spring, joint: j, stiffness: 5, rest: -pi/2}"
LOAD = np.array([3.0, -4.0, 5.0])
TIP = np.array([0.2, 0.3, -0.1])


def damped(inertia, damping, stiffness):
    return [(-damping + root) / (2 * inertia) for root in pairs(damping**2 - 4 * inertia * stiffness)]


def hinged(force, moment):
    """Return a body on a hinge that a force with this moment about the hinge holds against a spring."""
    rest = f", rest: {-moment / K!r}"
    return spatial(
        f"type: revolute, between: [b, ground], {HINGE}",
        spring("angle", more=rest),
        force,
        body=f"points: {{T: {text(TIP)}}}",
    )


FORCES = {
    # A point mass that hangs in a spring stretched by its weight swings as a pendulum of the stretched length.
    "spring": (
        scene(
            (0, -G),
            f"coordinates: {{p: {{x: 0, y: {-STRETCHED!r}}}}}",
            bodies="p: {type: planar_point, mass: 3}",
            forces="s: {type: spring, between: [p, ground], stiffness: 50, length: 0.4}",
        ),
        pairs(-50 / 3, -G / STRETCHED),
    ),
    "spring-and-damper-in-space": (
        scene(
            ground((0, 0, -G)),
            "coordinates: {p: {" + components(TURNED @ [0, 0, -STRETCHED]) + "}}",
            bodies="p: {type: point, mass: 3}",
            forces="s: {type: spring, between: [ground, p], stiffness: 50, length: 0.4, damping: 6}",
        ),
        [*damped(3, 6, 50), *pairs(-G / STRETCHED, -G / STRETCHED)],
    ),
    "joint-spring": (
        scene((0, -G), UPWARDS, **ARM, forces="s: {type: joint_spring, joint: j, stiffness: 30, damping: 2}"),
        damped(ARM_INERTIA, 2, 30 - MOMENT),
    ),
    "expression": (
        scene((0, -G), UPWARDS, **ARM, forces="s: {type: expression, on: {b.theta: -30*b.theta - 2*rate(b.theta)}}"),
        damped(ARM_INERTIA, 2, 30 - MOMENT),
    ),
    # An arm held sideways: its weight has no stiffness there.
    "actuator": (
        scene((0, -G), SIDEWAYS, **ARM, forces=[f"a: {{type: actuator, joint: j, effort: {MOMENT}}}", HOLD]),
        pairs(-5 / ARM_INERTIA),
    ),
    "torque": (
        scene((0, -G), SIDEWAYS, **ARM, forces=[f"a: {{type: torque, body: b, value: {MOMENT}}}", HOLD]),
        pairs(-5 / ARM_INERTIA),
    ),
    "actuator-along-a-travel": (
        scene(
            (0, -G),
            "coordinates: {b: {x: 0, y: 0, theta: 0}}",
            bodies=f"b: {{{FLAT}}}",
            joints="j: {type: prismatic, between: [b, ground], axis: -y}",
            forces=[
                f"a: {{type: actuator, joint: j, effort: {-2 * G}}}",
                "s: {type: joint_spring, joint: j, stiffness: 5}",
            ],
        ),
        pairs(-5 / 2.0),
    ),
    # A dead load on the tip of an arm softens it; a load that follows the arm does not.
    "force-in-ground-axes": (
        scene(
            (0, 0), UPWARDS, **ARM, forces=["p: {type: force, at: b.T, vector: [0, -6]}", HOLD.replace("-pi/2", "0")]
        ),
        pairs(-(5 - 6 * 1.0) / ARM_INERTIA),
    ),
    "force-in-body-axes": (
        scene(
            (0, 0),
            UPWARDS,
            **ARM,
            forces=["p: {type: force, at: b.T, vector: [0, -6], frame: body}", HOLD.replace("-pi/2", "0")],
        ),
        pairs(-5 / ARM_INERTIA),
    ),
    "force-in-ground-axes-in-space": (
        spatial(
            "type: spherical, between: [b.O, ground]",
            f"w: {{type: force, at: b, vector: {ground([0, 0, -MASS * G])}}}",
            body=HANGING,
            reference=LEVEL,
        ),
        pairs(*(-MASS * G * L / (moment + MASS * L**2) for moment in INERTIA[:2])),
    ),
    "force-in-body-axes-in-space": (
        hinged(f"f: {{type: force, at: b.T, vector: {text(LOAD)}, frame: body}}", float(N @ np.cross(TIP, LOAD))),
        pairs(-K / J),
    ),
    "torque-in-ground-axes-in-space": (
        hinged(f"t: {{type: torque, body: b, vector: {ground(LOAD)}}}", float(N @ LOAD)),
        pairs(-K / J),
    ),
    "torque-in-body-axes-in-space": (
        hinged(f"t: {{type: torque, body: b, vector: {text(LOAD)}, frame: body}}", float(N @ LOAD)),
        pairs(-K / J),
    ),
    "actuator-in-space": (
        hinged("a: {type: actuator, joint: j, effort: 2.5}", 2.5),
        pairs(-K / J),
    ),
}


@pytest.mark.parametrize("name", FORCES)
def test_a_force_gives_the_eigenvalues_of_its_closed_form(name):
    model, expected = FORCES[name]
    result = mbstab.loads(model).eig()
    assert_eigenvalues(result, expected)


ZIEGLER = scene(
    (0, 0),
    "coordinates: {one: {theta: 0}, two: {theta: 0}}\nguess: {one: {y: 1}, two: {y: 2}}",
    parameters=["l: 0.7", "m: 1.3", "k: 11", "P: 0"],
    bodies=[
        "one: {type: planar, mass: 2*m, inertia: 0, points: {O: [0, -l], T: [0, 0]}}",
        "two: {type: planar, mass: m, inertia: 0, points: {O: [0, -l]}}",
    ],
    joints=["a: {type: revolute, between: [one.O, ground]}", "b: {type: revolute, between: [two.O, one.T]}"],
    forces=[
        "sa: {type: joint_spring, joint: a, stiffness: k}",
        "sb: {type: joint_spring, joint: b, stiffness: k}",
        "push: {type: force, at: two, vector: [0, -P], frame: body}",
    ],
)


@pytest.mark.parametrize(("factor", "verdict"), [(1.0 - 1e-6, "marginally stable"), (1.0 + 1e-6, "unstable")])
def test_zieglers_column_flutters_at_its_critical_follower_load(factor, verdict):
    load = factor * (3.5 - math.sqrt(2.0)) * 11 / 0.7
    assert mbstab.loads(ZIEGLER).eig(P=load).verdict == verdict


# --- constraints and forces as expressions --------------------------------------------------------------------------


def without(text, *names):
    """Return a model text without the lines of some entries, and without sections that become empty."""
    text = "".join(line for line in text.splitlines(True) if line.strip().partition(":")[0] not in names)
    return re.sub(r"^(joints|contacts|drives|forces):\n(?=\S|\n)", "", text, flags=re.MULTILINE)


RESTATED = {
    # Example, entries left out, expressions that say the same.
    "revolute": (
        "pendulum",
        ["pivot"],
        ["px: {holonomic: rod.x - L*cos(rod.theta)}", "py: {holonomic: rod.y - L*sin(rod.theta)}"],
    ),
    "distance": (
        "double_pendulum",
        ["second_rod"],
        ["rod: {holonomic: (lower.x - upper.x)**2 + (lower.y - upper.y)**2 - l**2}"],
    ),
    "distance-as-a-root": (
        "double_pendulum",
        ["second_rod", "first_rod"],
        [
            "one: {holonomic: sqrt(upper.x**2 + upper.y**2) - l}",
            "two: {holonomic: sqrt((lower.x - upper.x)**2 + (lower.y - upper.y)**2)/l - 1}",
        ],
    ),
    "prismatic": ("slider_crank", ["rail"], ["y: {holonomic: slider.y}", "theta: {holonomic: sin(slider.theta)}"]),
    "disk": (
        "wheeled_inverted_pendulum",
        ["ground_contact"],
        ["height: {holonomic: disk.y - R_d}", "rolling: {nonholonomic: rate(disk.x) + R_d*rate(disk.theta)}"],
    ),
    "rolling-is-integrable-in-the-plane": (
        "wheeled_inverted_pendulum",
        ["ground_contact"],
        ["height: {holonomic: disk.y - R_d}", "rolling: {holonomic: disk.x + R_d*disk.theta}"],
    ),
    "knife-edge": (
        "chaplygin_sleigh",
        ["edge"],
        [
            "blade: {nonholonomic: "
            "cos(sleigh.theta)*rate(sleigh.y) - sin(sleigh.theta)*rate(sleigh.x) - a*rate(sleigh.theta)}"
        ],
    ),
    "drive-of-a-coordinate": ("top", ["spin"], ["turn: {holonomic: top.psi - omega*t}"]),
    "drives-of-a-point": (
        "trailer",
        ["tow_along", "tow_across"],
        [
            "along: {holonomic: trailer.x + L/2*cos(trailer.theta) - v*t}",
            "across: {holonomic: trailer.y + L/2*sin(trailer.theta)}",
        ],
    ),
}


@pytest.mark.parametrize("name", RESTATED)
def test_constraints_written_as_expressions_are_as_good_as_the_built_in_ones(name):
    example, left_out, expressions = RESTATED[name]
    original = source(example).partition("\nexpect:")[0]
    added = "constraints:\n" + "".join(f"  {line}\n" for line in expressions)
    restated = without(original, *left_out).replace("reference:", f"{added}\nreference:")
    expected, found = mbstab.loads(original).eig(), mbstab.loads(restated).eig()
    assert_eigenvalues(found, expected.values())
    assert found.verdict == expected.verdict
    lost = int(name == "rolling-is-integrable-in-the-plane")
    assert found.counts.found == expected.counts.found - lost


# --- references that do not fit -------------------------------------------------------------------------------------

PENDULUM = """\
mbstab: 1
gravity: [0, -9.81]
bodies:
  rod: {type: planar, mass: 2, inertia: 0.1, points: {O: [-1, 0]}}
joints:
  pivot: {type: revolute, between: [rod.O, ground]}
reference:
  coordinates: {rod: {x: 0, y: -1, theta: -pi/2}}
"""


def test_a_reference_that_does_not_fit_names_joint_row_residual_unit_and_place():
    wrong = PENDULUM.replace("y: -1, ", "y: -1.25, ")
    message = (
        r"^swing\.yaml:6:10: joints\.pivot: the reference does not satisfy joint 'pivot' \(coincident y\): "
        r"the residual is -0\.25 m\n 6 \|   pivot: .*\n +\| +\^\n"
        r"hint: correct the values, or leave out those that the constraints determine$"
    )
    with pytest.raises(ModelFileError, match=message):
        mbstab.loads(wrong, "swing.yaml").motion()


def test_all_rows_that_do_not_fit_are_named_at_once():
    with pytest.raises(ModelFileError, match="coincident x") as caught:
        mbstab.loads(PENDULUM.replace("x: 0, y: -1, ", "x: 3, y: 4, ")).motion()
    assert len(caught.value.problems) == 2


def test_an_angle_that_does_not_fit_is_said_in_radians():
    model = scene(
        (0, 0),
        "coordinates: {b: {x: 0, y: 0, theta: 0.1}}",
        bodies=f"b: {{{FLAT}}}",
        joints="rail: {type: prismatic, between: [b, ground], axis: x}",
    )
    with pytest.raises(ModelFileError, match=r"joint 'rail' \(aligned\): the residual is 0\.1 rad"):
        mbstab.loads(model).motion()


def test_rates_that_do_not_fit_are_named_with_their_unit():
    wrong = PENDULUM + "  rates: {rod: {x: 0, y: 0, theta: 2}}\n"
    with pytest.raises(
        ModelFileError, match=r"<text>:6:10: .*joint 'pivot' \(coincident x\): the residual is -2 m/s\n"
    ):
        mbstab.loads(wrong).motion()


@pytest.mark.parametrize(("shift", "good"), [(1e-10, True), (1e-8, False)])
def test_a_reference_fits_if_its_residuals_are_below_a_billionth_of_the_size(shift, good):
    model = mbstab.loads(PENDULUM.replace("y: -1, ", f"y: {-1 + shift!r}, "))
    if good:
        assert model.motion().at_rest
    else:
        with pytest.raises(ModelFileError, match=r"the residual is 1e-08 m"):
            model.motion()


def test_a_reference_that_is_not_in_equilibrium_names_coordinate_acceleration_and_force():
    leaning = PENDULUM.replace("{x: 0, y: -1, theta: -pi/2}", "{theta: 0}")
    turning = 2 * G / (0.1 + 2)  # about the pivot
    message = (
        r"<text>:7:1: reference: the reference is at rest but not in equilibrium: rod\.(theta|y) would accelerate with "
        rf"-{turning:.6g} (rad|m)/s\^2 \(unbalanced -\S+ N(\*m)?\)"
    )
    with pytest.raises(ModelFileError, match=message):
        mbstab.loads(leaning).motion()


@pytest.mark.parametrize(("lean", "good"), [(1e-10, True), (1e-6, False)])
def test_forces_balance_if_they_do_to_one_part_in_a_hundred_million(lean, good):
    model = mbstab.loads(PENDULUM.replace("{x: 0, y: -1, theta: -pi/2}", f"{{theta: -pi/2 + {lean}}}"))
    if good:
        assert model.motion().at_rest
    else:
        with pytest.raises(ModelFileError, match=r"at rest but not in equilibrium: rod\.(x|theta)"):
            model.motion()


def test_a_drive_that_starts_from_rest_is_not_at_rest():
    model = scene(
        (0, 0),
        "coordinates: {p: {x: 0, y: 0}}",
        bodies="p: {type: planar_point, mass: 1}",
        drives="d: {type: coordinate, coordinate: p.x, position: 3*t**2}",
    )
    with pytest.raises(ModelFileError, match=r"at rest at this time only: a drive accelerates p\.x with 6 m/s\^2"):
        mbstab.loads(model).motion()


def test_rates_that_the_constraints_do_not_determine_are_asked_for():
    model = scene(
        (0, 0),
        "coordinates: {a: {x: 0, y: 0}, b: {x: 0, y: 0}}\nrates: {a: {x: 1, y: 0}}",
        bodies=["a: {type: planar_point, mass: 1}", "b: {type: planar_point, mass: 1}"],
        constraints="sum: {nonholonomic: rate(a.x) + rate(b.x) + rate(b.y)}",
    )
    with pytest.raises(ModelFileError, match=r"the constraints do not determine all rates: b\.[xy] is missing\n"):
        mbstab.loads(model).motion()
    given = mbstab.loads(model.replace("rates: {", "rates: {b: {x: 3}, "))
    np.testing.assert_allclose(given.motion().u, [1.0, 0.0, 3.0, -4.0], rtol=1e-13, atol=0.0)


@pytest.mark.parametrize("angle", [0.3, 1.0, 2.0])
def test_relaxed_springs_of_any_stiffness_are_in_equilibrium(angle):
    # What rounding leaves of the forces is no reason to refuse the reference.
    arm = {**ARM, "bodies": ARM["bodies"].replace("[0, -0.5]", "[0.123, -0.456]")}
    model = scene(
        (0, 0),
        f"coordinates: {{b: {{theta: {angle}}}}}",
        **arm,
        forces=[
            f"s: {{type: joint_spring, joint: j, stiffness: 1e12, rest: {angle / 3!r}*3}}",
            "t: {type: spring, between: [b.T, ground], stiffness: 1e9, length: sqrt(0.123**2 + 0.956**2)}",
        ],
    )
    assert mbstab.loads(model).motion().at_rest


def test_a_weight_that_a_stiff_rod_carries_must_be_balanced_all_the_same():
    # The rod gives way by 1e-11 of its length: without it nothing would carry the weight.
    model = scene(
        (0, -G),
        "coordinates: {p: {x: 0, y: -1}}",
        bodies="p: {type: planar_point, mass: 1}",
        forces="rod: {type: spring, between: [p, ground], stiffness: 1e12, length: 1}",
    )
    with pytest.raises(
        ModelFileError, match=r"not in equilibrium: p\.y would accelerate with -9\.81 m/s\^2 \(unbalanced -9\.81 N\)"
    ):
        mbstab.loads(model).motion()


# --- redundant and contradictory constraints ------------------------------------------------------------------------

DOOR = spatial(
    f"type: revolute, between: [b, ground], {HINGE}",
    spring("angle"),
    body="points: {P: [0.6, 0.64, 0.48]}",
).replace(
    "joints:\n",
    f"ground: {{points: {{P: {ground(N)}}}}}\njoints:\n"
    f"  lower: {{type: revolute, between: [b.P, ground.P], {HINGE}}}\n",
)

# A parallelogram with a second coupler parallel to the first.
PARALLELOGRAM = """\
mbstab: 1
parameters: {l: 1, m: 1}
gravity: [0, -9.81]
ground: {points: {B: [l, 0]}}
bodies:
  left: {type: planar, mass: m, shape: {type: rod, length: l}, points: {A: [-l/2, 0], C: [l/2, 0], E: [l/10, 0]}}
  right: {type: planar, mass: m, shape: {type: rod, length: l}, points: {B: [-l/2, 0], D: [l/2, 0], F: [l/10, 0]}}
  low: {type: planar, mass: m, shape: {type: rod, length: l}, points: {C: [-l/2, 0], D: [l/2, 0]}}
  high: {type: planar, mass: m, shape: {type: rod, length: l}, points: {E: [-l/2, 0], F: [l/2, 0]}}
joints:
  A: {type: revolute, between: [left.A, ground]}
  B: {type: revolute, between: [right.B, ground.B]}
  C: {type: revolute, between: [low.C, left.C]}
  D: {type: revolute, between: [low.D, right.D]}
  E: {type: revolute, between: [high.E, left.E]}
  F: {type: revolute, between: [high.F, right.F]}
reference:
  coordinates: {left: {theta: -pi/2}}
  guess:
    left: {y: -l/2}
    right: {x: l, y: -l/2, theta: -pi/2}
    low: {x: l/2, y: -l}
    high: {x: l/2, y: -l/2}
"""


def test_a_door_on_two_hinges_is_told_that_one_repeats_the_other_and_swings_all_the_same():
    result = mbstab.loads(DOOR).eig()
    assert len(result.warnings) == 5
    for warning in result.warnings:
        assert re.fullmatch(
            r"redundant constraint: joint 'j' \(.*\) repeats what joint 'lower' already imposes", warning
        )
    assert result.counts.rank_holonomic == 5
    assert_eigenvalues(result, pairs(-K / J))


@pytest.mark.parametrize(("length", "mass"), [(1.0, 1.0), (1e-6, 1e-9), (1e6, 1e6)])
def test_a_parallelogram_with_two_couplers_is_told_so_at_any_size(length, mass):
    result = mbstab.loads(PARALLELOGRAM).eig(l=length, m=mass)
    assert result.warnings == (
        "redundant constraint: joint 'F' (coincident x) repeats what joint 'A', joint 'B', joint 'C', joint 'D', "
        "joint 'E' already impose",
    )
    # Two rods about their ends, one coupler at l, the other at 0.6 l.
    inertia, moment = 2 / 3 + 1 + 0.6**2, 2 * 0.5 + 1 + 0.6
    assert_eigenvalues(result, pairs(-moment * G / (inertia * length)), rtol=1e-12)


def test_a_speed_held_twice_is_redundant_at_any_angle():
    model = scene(
        (0, 0),
        "coordinates: {b: {x: 0, y: 0, theta: 0}}",
        bodies=f"b: {{{FLAT}}}",
        joints=f"rail: {{type: prismatic, between: [b, ground], axis: [{C!r}, {S!r}]}}",
        forces="s: {type: joint_spring, joint: rail, stiffness: 8}",
        constraints=f"again: {{nonholonomic: {C!r}*rate(b.y) - {S!r}*rate(b.x)}}",
    )
    result = mbstab.loads(model).eig()
    assert result.warnings == (
        "redundant constraint: constraint 'again' (nonholonomic) repeats what joint 'rail' already imposes",
    )
    assert_eigenvalues(result, [2j, -2j])


def test_multipliers_of_redundant_constraints_add_up_to_the_reaction():
    motion = mbstab.loads(PARALLELOGRAM).motion()
    reactions = -motion.nu.reshape(-1, 2)
    np.testing.assert_allclose(reactions[0] + reactions[1], [0.0, 4 * G], rtol=1e-13, atol=1e-12)
    np.testing.assert_allclose(reactions[4] + reactions[5], [0.0, G], rtol=1e-13, atol=1e-12)


def test_a_door_whose_hinges_do_not_quite_line_up_is_an_error():
    crooked = DOOR.replace("points: {P: [0.6, ", "points: {P: [0.6000000005, ").replace(
        f"P: {ground(N)}", f"P: {ground(N + np.array([5e-10, 0.0, 0.0]))}"
    )
    with pytest.raises(ConstraintError, match=r"the rank of the constraints cannot be decided(.|\n)*joint 'lower'"):
        mbstab.loads(crooked).motion()


TWO_RODS = """\
mbstab: 1
ground: {points: {B: [1, 0]}}
bodies:
  p: {type: planar_point, mass: 1}
joints:
  one: {type: distance, between: [p, ground], length: 0.3}
  two: {type: distance, between: [p, ground.B], length: 0.4}
reference:
  REFERENCE
"""


def test_rods_too_short_to_meet_cannot_be_assembled():
    with pytest.raises(
        ModelFileError,
        match=r"joint '(one|two)': where .* is satisfied, \(d² − l²\) / 2l, .* is \S+ m(.|\n)*no coordinates",
    ):
        mbstab.loads(TWO_RODS.replace("REFERENCE", "guess: {p: {x: 0.4, y: 0.1}}")).motion()


def test_the_element_whose_equations_overflow_is_named():
    text = TWO_RODS.replace("0.4}", "1e200}").replace("REFERENCE", "coordinates: {p: {x: 0.3, y: 0}}")
    with pytest.raises(NumericalError, match=r":7:8: joints\.two: an entry of the matrices is not finite"):
        mbstab.loads(text).motion()


def drives(*laws):
    return scene(
        (0, 0),
        "coordinates: {p: {y: 0}}",
        bodies="p: {type: planar_point, mass: 1}",
        drives=[f"d{i}: {{type: coordinate, coordinate: p.x, {law}}}" for i, law in enumerate(laws)],
    )


def test_drives_that_disagree_about_the_place_are_an_error():
    with pytest.raises(ModelFileError, match=r"satisfy drive 'd0': where drive 'd1' .* the gap is 1 m\n"):
        mbstab.loads(drives("position: t", "position: t + 1")).motion()


def test_drives_that_disagree_about_the_speed_are_an_error():
    with pytest.raises(ModelFileError, match=r"drive 'd[01]' \(position\): the residual is -?0\.5 m/s\n"):
        mbstab.loads(drives("position: t", "position: 2*t")).motion()


def test_drives_that_disagree_about_the_acceleration_are_an_error():
    with pytest.raises(
        ConstraintError, match=r"<text>:\d+:7: drive 'd[01]' \(position\) contradicts other constraints"
    ):
        mbstab.loads(drives("position: t", "position: t + t**2")).motion()


def test_drives_that_agree_are_redundant():
    motion = mbstab.loads(drives("position: t + t**2", "velocity: 1 + 2*t")).motion()
    assert (motion.u[0], motion.a[0]) == pytest.approx((1.0, 2.0), rel=1e-13)
    assert motion.warnings == ("redundant constraint: drive 'd1' (velocity) repeats what drive 'd0' already imposes",)


@pytest.mark.parametrize(("length", "mass"), [(1.0, 1.0), (1e-6, 1e-9), (1e6, 1e6)])
def test_a_parallelogram_with_all_rods_in_line_is_at_a_singular_configuration(length, mass):
    four_bar = source("four_bar").partition("reference:")[0]
    places = {"left": "l/2", "right": "l*3/2", "coupler": "l*3/2"}
    bodies = ", ".join(f"{body}: {{x: {x}, y: 0, theta: 0}}" for body, x in places.items())
    flat = f"reference: {{coordinates: {{{bodies}}}}}\n"
    with pytest.raises(
        ConstraintError, match=r"at a singular configuration(.|\n)*the rows involved: joint '[ABCD]' \(coincident x\)"
    ):
        mbstab.loads(four_bar + flat).motion(l=length, m=mass)


# --- mass and angles ------------------------------------------------------------------------------------------------


def test_a_motion_without_mass_is_an_error_that_names_the_body():
    weightless = PENDULUM.replace("inertia: 0.1, points: {O: [-1, 0]}", "inertia: 0, points: {O: [0, 0]}").replace(
        "y: -1", "y: 0"
    )
    message = r"<text>:4:8: bodies\.rod: the motion of rod\.theta carries no mass, and no force depends on it"
    with pytest.raises(MassError, match=message):
        mbstab.loads(weightless).motion()


def test_inertias_too_far_apart_for_a_rank_decision_are_named():
    with pytest.raises(MbstabError, match=r"inertias are too far apart for double precision: 1e\+30 kg\*m\^2 along"):
        mbstab.load("governor.yaml").eig(I_rod=1e30)


def test_a_search_does_not_follow_motions_of_inertias_that_are_too_far_apart():
    text = find_model("governor_paper.yaml").path.read_text(encoding="utf-8")
    far = text.replace("C: [e, 0, 0]", "C: [e, 0, tan(pi/2)]")
    assert far != text
    with pytest.raises(EquilibriumError, match=r"found in [0-9]{1,2} steps?(.|\n)*inertias are too far apart"):
        mbstab.loads(far).motion()


def test_no_inertia_is_needed_where_a_joint_gives_a_lever():
    rod = PENDULUM.replace("inertia: 0.1", "inertia: 0")
    assert_eigenvalues(mbstab.loads(rod).eig(), pairs(-G))


def at_theta(theta):
    return scene(
        "0", f"coordinates: {{b: {{x: 0, y: 0, z: 0, phi: 0, theta: {theta}, psi: 0}}}}", bodies=f"b: {{{BODY}}}"
    )


SINGULAR = ["pi/2", "-pi/2", "pi/2 + 9e-7"]


@pytest.mark.parametrize("theta", SINGULAR)
def test_euler_angles_that_something_names_are_an_error_at_their_singularity(theta):
    message = (
        r"<text>:4:6: bodies\.b: the Euler angles of 'b' are singular here: \|cos theta\| = \S+(.|\n)*"
        "hint: give the body another base rotation"
    )
    named = at_theta(theta) + "forces: {f: {type: expression, on: {b.phi: 0*b.theta}}}\n"
    with pytest.raises(ModelFileError, match=message):
        mbstab.loads(named).motion()


def tilted(theta, rates=""):
    """Return a body on bearings by its Euler angles and by its base rotation, and cosines and sines of the angles."""
    turns = (c1, s1), (c2, s2), (c3, s3) = [(np.cos(x), np.sin(x)) for x in (0.4, eval(theta, {"pi": np.pi}), -0.7)]
    A = np.array([[1, 0, 0], [0, c1, -s1], [0, s1, c1]]) @ [[c2, 0, s2], [0, 1, 0], [-s2, 0, c2]]
    A = A @ [[c3, -s3, 0], [s3, c3, 0], [0, 0, 1]]
    held = ([0.1, 0.2, 0.3], [0.3, -0.1, 0.2])
    bearings = [
        f"f{i}: {{type: bearing, between: [{{body: b, point: {x}}}, {{body: ground, point: {(A @ x).tolist()}}}], "
        "stiffness: 40}"
        for i, x in enumerate(held)
    ]
    text = (
        "mbstab: 1\nbodies: {b: {type: spatial, mass: 2, inertia: [0.3, 0.4, 0.5]%s}}\n"
        "joints: {pivot: {type: spherical, between: [b, ground]}}\n"
        f"forces: {{{', '.join(bearings)}}}\n"
        "reference: {coordinates: {b: {x: 0, y: 0, z: 0, phi: %s, theta: %s, psi: %s}}%s}\n"
    )
    given = mbstab.loads(text % ("", "0.4", theta, "-0.7", rates))
    # The same by hand: the orientation as the base rotation.
    written = mbstab.loads(text % (f", axes: [0.4, {theta}, -0.7]", "0", "0", "0", rates))
    return given, written, turns


@pytest.mark.parametrize("theta", SINGULAR)
def test_rates_of_singular_euler_angles_give_the_angular_velocity(theta):
    given, _, ((c1, s1), (c2, s2), _) = tilted(theta, ", rates: {b: {phi: 0.3, theta: -0.2, psi: 0.5}}")
    one = given.linearize(frozen=True)
    assert "count from the orientation that they give" in one.motion.warnings[0]
    # Angular velocity in ground axes: of the rates as they are given, and as they are now.
    spin = np.array([[1, 0, s2], [0, c1, -s1 * c2], [0, s1, c1 * c2]]) @ [0.3, -0.2, 0.5]
    base = np.array(given.system().scene.bodies[0].base, dtype=float).reshape(3, 3)
    np.testing.assert_allclose(base @ one.motion.u[3:6], spin, atol=1e-14)


@pytest.mark.parametrize("theta", SINGULAR)
def test_singular_euler_angles_count_from_the_orientation_that_they_give(theta):
    given, written, _ = tilted(theta)
    one, other = given.linearize(frozen=True), written.linearize(frozen=True)
    assert "count from the orientation that they give" in one.motion.warnings[0]
    np.testing.assert_allclose(one.M, other.M, atol=1e-14)
    np.testing.assert_allclose(one.K, other.K, atol=1e-12)
    digits = [[complex(e.value) for e in x.eig().eigenvalues] for x in (given, written)]
    np.testing.assert_allclose(*digits, atol=1e-12)
    assert given.eig_precise(20).verdict == given.eig().verdict == written.eig().verdict


@pytest.mark.parametrize("theta", ["pi/2 - 0.019", "-pi/2 + 2e-4"])
def test_euler_angles_near_their_singularity_are_a_warning(theta):
    (warning,) = mbstab.loads(at_theta(theta)).motion().warnings
    assert re.match(
        r"the Euler angles of body 'b' are close to singular: \|cos theta\| = \S+; give the body another", warning
    )


def test_euler_angles_far_from_their_singularity_are_no_matter():
    assert mbstab.loads(at_theta("pi/2 - 0.021")).motion().warnings == ()


# --- multipliers ----------------------------------------------------------------------------------------------------

# M a + F0 + Jᵀ ν = 0: the joint acts on its first body with −ν.


def test_the_reaction_of_a_pivot_carries_the_weight():
    np.testing.assert_allclose(mbstab.loads(PENDULUM).motion().nu, [0.0, -2 * G], rtol=1e-14, atol=1e-14)


def test_the_reaction_of_a_pivot_carries_the_weight_and_pulls_the_turning_body_round():
    motion = mbstab.loads(PENDULUM + "  rates: {rod: {theta: 3}}\n").motion()
    np.testing.assert_allclose(motion.nu, [0.0, -2 * (G + 3.0**2)], rtol=1e-14, atol=1e-13)


def test_a_pendulum_let_go_sideways_accelerates_and_is_held_by_its_pivot():
    # Not at rest: a rate that is small, but not zero.
    motion = mbstab.loads(
        PENDULUM.replace("{x: 0, y: -1, theta: -pi/2}", "{theta: 0}") + "  rates: {rod: {theta: 1e-9}}\n"
    ).motion()
    turning = -2 * G / (0.1 + 2)
    np.testing.assert_allclose(motion.a, [0.0, turning, turning], rtol=1e-14, atol=1e-15)
    np.testing.assert_allclose(motion.nu, [0.0, -2 * (G + turning)], rtol=1e-13, atol=1e-14)


def test_the_multiplier_of_a_massless_rod_is_its_tension():
    motion = mbstab.loads(source("double_pendulum")).motion()
    np.testing.assert_allclose(motion.nu, [2 * G, G], rtol=1e-14, atol=0.0)


def test_the_multiplier_of_a_wheel_is_the_load_on_it_and_rolling_straight_takes_no_force():
    motion = wheel("rolling", "x: 2, y: 0, psi: -5").motion()
    np.testing.assert_allclose(motion.nu, [-MASS * G, 0.0, 0.0], rtol=1e-14, atol=1e-13)


def test_the_reaction_of_a_spatial_joint_is_the_weight_and_its_moment():
    # A body cantilevered by a fixed joint: forces along the ground axes, then the moments.
    offset = np.array([0.5, 0.0, 0.0])
    model = scene(
        (0, 0, -G),
        LEVEL,
        bodies=f"b: {{type: spatial, mass: {MASS}, inertia: {list(INERTIA)}, points: {{O: {text(-offset)}}}}}",
        joints="weld: {type: fixed, between: [b.O, ground]}",
    )
    motion = mbstab.loads(model).motion()
    force = -motion.nu[:3]
    np.testing.assert_allclose(force, [0.0, 0.0, MASS * G], rtol=1e-13, atol=1e-13)
    moment = -(motion.dynamics.J[3:, 3:].T @ motion.nu[3:])
    np.testing.assert_allclose(moment + np.cross(-offset, force), 0.0, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("reverse", [False, True])
def test_small_multipliers_beside_large_ones_are_right_to_all_digits(reverse):
    masses = [10.0**i for i in range(12)]
    masses = masses[::-1] if reverse else masses
    bodies = [
        f"b{i}: {{type: planar, mass: {m!r}, inertia: {m!r}, points: {{A: [0.3, 1], B: [-0.2, -1]}}}}"
        for i, m in enumerate(masses)
    ]
    joints = [
        f"j{i}: {{type: distance, between: [b{i}, {f'b{i - 1}' if i else 'ground'}], length: 1}}" for i in range(12)
    ]
    model = scene(
        (0, -G),
        "coordinates:\n" + "\n".join(f"  b{i}: {{x: 0, y: {-i - 1}, theta: 0}}" for i in range(12)),
        bodies=bodies,
        joints=joints,
    )
    tension = [G * sum(masses[i:]) for i in range(12)]
    np.testing.assert_allclose(mbstab.loads(model).motion().nu, tension, rtol=1e-14, atol=0.0)
