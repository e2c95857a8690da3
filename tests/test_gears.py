"""Joints of drive trains against closed forms, independent reductions and each other."""

import math
import re

import numpy as np
import pytest

import mbstab


def frequencies(model, **parameters):
    """Return the imaginary parts above zero of the eigenvalues (rad/s), which must be all of them, in their order."""
    values = [e.value for e in mbstab.loads(model).eig(**parameters).eigenvalues]
    found = sorted(z.imag for z in values if z.imag > 1e-5)
    size = max(abs(z) for z in values)
    assert max(abs(z.real) for z in values) <= 1e-12 * size
    return found


# --- constant-velocity joints ---------------------------------------------------------------------------------------

SHAFTS = """
mbstab: 1
parameters: {beta: 0.5}
ground: {directions: {bent: [cos(beta), sin(beta), 0]}}
bodies:
  one: {type: spatial, mass: 1, inertia: [0.02, 0.03, 0.03]}
  shaft: {type: spatial, mass: 0, inertia: [0, 0, 0], axes: [0, 0, beta]}
  two: {type: spatial, mass: 1, inertia: [0.05, 0.07, 0.07], axes: [0, 0, beta]}
joints:
  bearing_1: {type: revolute, between: [one, ground], axis: x}
  bearing_2: {type: cylindrical, between: [two, ground], axis: [x, bent]}
  bend: {type: constant_velocity, between: [one, shaft], axis: x}
  twist: {type: planar, between: [two, shaft], axis: x}
forces:
  shaft: {type: joint_spring, joint: twist, stiffness: 500}
reference: {}
"""
HOOKE = SHAFTS.replace(
    "constant_velocity, between: [one, shaft], axis: x", "universal, between: [one, shaft], axis: [z, y]"
)
TWISTED = 187.082869338697069  # sqrt(500 (1/0.02 + 1/0.05))


@pytest.mark.parametrize("beta", [0.0, 0.1, math.pi / 6, 1.0, 1.5, 2.5, 3.0, -0.8])
def test_shafts_turn_equally_at_any_bend(beta):
    assert frequencies(SHAFTS, beta=beta) == pytest.approx([TWISTED], rel=1e-13)


@pytest.mark.parametrize(("turn", "expected"), [(0.0, 169.558249578131703), (math.pi / 2, 208.166599946613274)])
def test_behind_a_hooke_joint_they_do_not(turn, expected):
    # At 30 degrees, in two places of a turn: the other shaft turns by cos(beta) or 1/cos(beta) as much.
    at = (
        f"reference: {{coordinates: {{one: {{phi: {turn}}}}}, guess: {{shaft: {{phi: {turn}}}, two: {{phi: {turn}}}}}}}"
    )
    model = HOOKE.replace("reference: {}", at)
    assert frequencies(model, beta=math.pi / 6) == pytest.approx([expected], rel=1e-11)
    turned = model.replace("universal", "constant_velocity").replace("axis: [z, y]", "axis: x")
    assert frequencies(turned, beta=math.pi / 6) == pytest.approx([TWISTED], rel=1e-13)


def test_a_straight_shaft_is_proven_and_a_bent_one_up_to_what_its_cosines_say():
    straight, bent = (mbstab.loads(SHAFTS).certify(beta=beta) for beta in (0, 0.7))
    assert straight.proven
    assert bent.conditions == ("the reference satisfies the equations of motion",)
    for certificate in (straight, bent):
        assert certificate.verdict == "stable up to symmetry"
        assert max(float(e.imag) for e in certificate.eigenvalues) == pytest.approx(TWISTED, rel=1e-12)


def test_a_driven_shaft_turns_the_other_at_the_same_rate():
    model = SHAFTS.replace("forces:", "drives:\n  motor: {type: coordinate, coordinate: one.phi, velocity: 7}\nforces:")
    run = mbstab.loads(model.replace("reference: {}", "reference: {rates: {two: {phi: 7}}}")).simulate(3.0, beta=0.9)
    angle = np.asarray(run.q)[:, run.names.index("two.phi")]
    np.testing.assert_allclose(angle, 7.0 * np.asarray(run.times), atol=1e-6)


@pytest.mark.parametrize("reference", ["shaft: {phi: pi}", "shaft: {phi: 3.0}", "shaft: {psi: pi}"])
def test_shafts_turned_by_half_a_turn_against_each_other_are_refused(reference):
    model = SHAFTS.replace("beta: 0.5", "beta: 0").replace(
        "reference: {}", f"reference: {{coordinates: {{one: {{phi: 0}}, {reference}}}}}"
    )
    with pytest.raises(mbstab.MbstabError, match=r"<text>:12:9: joints.bend"):
        mbstab.loads(model).eig()


# --- trains against closed forms ------------------------------------------------------------------------------------


def in_space(model):
    """Return a planar model in space, in the plane across z."""
    model = re.sub(r"planar, mass: (\S+), inertia: ([^,}]+)", r"spatial, mass: \1, inertia: [1, 1, \2]", model)
    model = re.sub(r"(type: revolute, between: \[[^]]*\])", r"\1, axis: z", model)
    return re.sub(r"\[(-?[\w./*]+), (-?[\w./*]+)\](?=[^\n]*# points)", r"[\1, \2, 0]", model)


def in_dimension(model, dimension):
    return model if dimension == 2 else in_space(model)


SHAFTS_IN_MESH = """
mbstab: 1
bodies:
  motor: {type: planar, mass: 1, inertia: 0.02}
  gear1: {type: planar, mass: 1, inertia: 0.01}
  gear2: {type: planar, mass: 1, inertia: 0.3}
  load: {type: planar, mass: 1, inertia: 0.5}
joints:
  mesh: {type: gear, joints: [g1, g2], MESH}
  m: {type: revolute, between: [motor, ground]}
  g1: {type: revolute, between: [gear1, ground]}
  g2: {type: revolute, between: [gear2, ground]}
  l: {type: revolute, between: [load, ground]}
  s1: {type: revolute, between: [motor, gear1]}
  s2: {type: revolute, between: [gear2, load]}
forces:
  s1: {type: joint_spring, joint: s1, stiffness: 2000}
  s2: {type: joint_spring, joint: s2, stiffness: 5000}
reference: {}
"""
RACK = """
mbstab: 1
parameters: {twist: 0}
bodies:
  bar: {type: planar, mass: 8, inertia: 1}
  wheel: {type: planar, mass: 1, inertia: 0.02}
joints:
  mesh: {type: rack, joints: [slide, pin], radius: 0.05}
  slide: {type: prismatic, between: [bar, ground], axis: x}
  pin: {type: revolute, between: [wheel, ground]}
forces:
  k: {type: joint_spring, joint: slide, stiffness: 3000}
  t: {type: joint_spring, joint: pin, stiffness: twist}
reference: {}
"""
DIFF = """
mbstab: 1
bodies:
  case: {type: planar, mass: 1, inertia: 0.05}
  left: {type: planar, mass: 1, inertia: 0}
  right: {type: planar, mass: 1, inertia: 0}
  wl: {type: planar, mass: 1, inertia: 0.8}
  wr: {type: planar, mass: 1, inertia: 1.1}
joints:
  d: {type: differential, joints: [c, l, r]}
  c: {type: revolute, between: [case, ground]}
  l: {type: revolute, between: [left, ground]}
  r: {type: revolute, between: [right, ground]}
  jl: {type: revolute, between: [wl, ground]}
  jr: {type: revolute, between: [wr, ground]}
  sl: {type: revolute, between: [left, wl]}
  sr: {type: revolute, between: [right, wr]}
forces:
  sl: {type: joint_spring, joint: sl, stiffness: 9000}
  sr: {type: joint_spring, joint: sr, stiffness: 7000}
  k: {type: joint_spring, joint: c, stiffness: 4000}
reference: {}
"""

# J = 0.02 and 0.5 kg m^2, r = 0.05 and 0.15 m
PAIR = """
mbstab: 1
bodies:
  one: {type: planar, mass: 1, inertia: 0.02}
  two: {type: planar, mass: 1, inertia: 0.5}
joints:
  mesh: {TRAIN}
  a: {type: revolute, between: [one, ground]}
  b: {type: revolute, between: [two, ground]}
reference: {}
"""
RIGID = [134.893296954531193, 388.301631996436039]


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize(
    ("mesh", "expected"),
    [
        ("ratio: 3", RIGID),
        ("teeth: [17, 51]", RIGID),
        ("radii: [0.05, 0.15]", RIGID),
        ("ratio: 3, internal: true", RIGID),
        ("radii: [0.05, 0.15], stiffness: 1e7", [134.51692406922334, 379.906870148334022, 1847.7669316825968]),
    ],
)
def test_a_gear_between_two_shafts(mesh, expected, dimension):
    found = frequencies(in_dimension(SHAFTS_IN_MESH.replace("MESH", mesh), dimension))
    assert found == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize(
    ("train", "expected"),
    [
        ("type: gear, joints: [a, b], radii: [0.05, 0.15], stiffness: 1e7", 1303.84048104052974j),
        ("type: gear, joints: [a, b], radii: [0.05, 0.15], stiffness: 1e7, damping: 200", -17 + 1303.729649889117j),
        ("type: belt, joints: [a, b], radii: [0.05, 0.15], stiffness: 4e4", 116.619037896906009j),
        ("type: belt, joints: [b, a], radii: [0.15, 0.05], stiffness: 4e4, crossed: true", 116.619037896906009j),
    ],
)
def test_elastic_teeth_and_belts(train, expected, dimension):
    result = mbstab.loads(in_dimension(PAIR.replace("TRAIN", train), dimension)).eig()
    top = max((e.value for e in result.eigenvalues), key=lambda z: z.imag)
    assert top == pytest.approx(expected, rel=1e-12)
    assert result.verdict == ("asymptotically stable up to symmetry" if expected.real else "stable up to symmetry")


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize(("twist", "expected"), [(0, 13.6930639376291528), (12, 22.0794021658196171)])
def test_a_rack_and_its_pinion(twist, expected, dimension):
    assert frequencies(in_dimension(RACK, dimension), twist=twist) == pytest.approx([expected], rel=1e-12)


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_differential(dimension):
    found = frequencies(in_dimension(DIFF, dimension))
    assert found == pytest.approx([41.1415855117961055, 633.883893466398958], rel=1e-12)


# --- what files may say ---------------------------------------------------------------------------------------------

REFUSED = {
    "unknown joint": ("joints: [a, »c], teeth: [1, 2]", "there is no joint 'c'"),
    "one joint": ("joints: »[a], teeth: [1, 2]", "expected a list of 2 joints"),
    "the same joint": ("joints: [a, »a], teeth: [1, 2]", "the joint 'a' stands here twice"),
    "a joint without an angle": ("joints: [a, »free], teeth: [1, 2]", "the spherical joint 'free' has no angle"),
    "a slider": ("joints: [a, »slide], teeth: [1, 2]", "the prismatic joint 'slide' has no angle, only displacement"),
    "a gear": ("joints: [a, »mesh], teeth: [1, 2]", "the gear joint 'mesh' has no angle"),
    "a rack that turns": ("type: rack, joints: [»a, b], radius: 1", "has no displacement, only angle"),
    "a pinion of no size": ("type: rack, joints: [slide, b], radius: »0", "radius must not be zero, got 0 m"),
    "no teeth": ("joints: [a, b], teeth: [»0, 2]", "a number of teeth must be whole and positive, got 0"),
    "teeth below zero": ("joints: [a, b], teeth: [1, »-2]", "a number of teeth must be whole and positive, got -2"),
    "half a tooth": ("joints: [a, b], teeth: [»1.5, 2]", "a number of teeth must be whole and positive, got 1.5"),
    "teeth of one wheel": ("teeth: »3, joints: [a, b]", "expected a list of two numbers, one for each wheel"),
    "teeth and ratio": ("»joints: [a, b], teeth: [1, 2], ratio: 2", "'teeth' and 'ratio' given"),
    "no ratio": ("»joints: [a, b]", "give one of 'teeth' and 'radii' and 'ratio', none given"),
    "a ratio below zero": ("joints: [a, b], ratio: »-2", "ratio must be positive, got -2"),
    "a stiffness without radii": ("»joints: [a, b], ratio: 2, stiffness: 3", "the key 'radii' is missing"),
    "no flag": ("joints: [a, b], ratio: 2, internal: »maybe", "unknown choice 'maybe'"),
    "sides of a differential": ("type: differential, joints: »[a, b]", "expected a list of 3 joints"),
}


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("name", REFUSED)
def test_what_makes_no_sense_is_refused_where_it_stands(name, dimension):
    train, message = REFUSED[name]
    train = (
        train
        if "type:" in train
        else train.replace("»", "»type: gear, ", 1)
        if train[0] == "»"
        else f"type: gear, {train}"
    )
    lines = in_dimension(PAIR, dimension).replace("  mesh", OTHERS + "  mesh").replace("TRAIN", train).split("\n")
    row = next(i for i, line in enumerate(lines) if "»" in line)
    column = lines[row].index("»") + (0 if "{»" in lines[row] else 1)
    with pytest.raises(mbstab.ModelFileError) as refused:
        mbstab.loads("\n".join(lines).replace("»", "")).eig()
    (problem,) = [x for x in refused.value.problems if message in x.message]
    assert (problem.location.line, problem.location.column) == (row + 1, column)


OTHERS = """  free: {type: spherical, between: [one, two]}
  slide: {type: prismatic, between: [one, two], axis: x}
"""


def test_in_space_a_ratio_is_a_fraction():
    odd = PAIR.replace("TRAIN", "type: gear, joints: [a, b], ratio: 2.64713")
    assert mbstab.loads(odd).eig().verdict == "stable up to symmetry"
    with pytest.raises(
        mbstab.ModelFileError, match=r"in space a ratio must be a fraction .* got 2.64713(.|\n)*teeth: \[n1"
    ):
        mbstab.loads(in_space(odd)).eig()
    assert mbstab.loads(in_space(odd).replace("2.64713", "37/10")).eig().verdict == "stable up to symmetry"
