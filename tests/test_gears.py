"""Joints of drive trains against closed forms, independent reductions and each other."""

import math
import re

import mpmath
import numpy as np
import pytest
from mechanisms import frequencies

import mbstab

# --- trains against closed forms ------------------------------------------------------------------------------------


def in_space(model):
    """Return a planar model in space, in the plane across z."""
    model = re.sub(r"planar, mass: (\S+), inertia: ([^,}]+)", r"spatial, mass: \1, inertia: [1, 1, \2]", model)
    model = re.sub(r"(type: revolute, between: \[[^]]*\])", r"\1, axis: z", model).replace("theta:", "psi:")
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


# --- trains off symmetry, against reductions to one coordinate ------------------------------------------------------

PENDULUMS = """
mbstab: 1
gravity: [0, -9.81]   # points
ground: {points: {B: [0.6, 0.1]}}   # points
bodies:
  one: {type: planar, mass: 2, inertia: 0.03, center_of_mass: [0.3, 0]}   # points
  two: {type: planar, mass: 5, inertia: 0.2, center_of_mass: [0.1, 0.2]}   # points
joints:
  mesh: {type: gear, joints: [b, a], teeth: [24, 36], TRAIN}
  a: {type: revolute, between: [one, ground]}
  b: {type: revolute, between: [two, ground.B]}
forces:
  spring: {type: joint_spring, joint: a, stiffness: 20, rest: 0.2}
reference: {find: equilibrium, guess: {one: {theta: 0.3}, two: {theta: -0.4, x: 0.6, y: 0.1}}}
"""
# A cart on a slope carries a wheel with its mass off its axle, which rolls on a rack of the ground.
CART = """
mbstab: 1
parameters: {r: 0.2, slope: 0.1}
gravity: [3, -9]   # points
bodies:
  cart: {type: planar, mass: 3, inertia: 1}
  wheel: {type: planar, mass: 2, inertia: 0.05, center_of_mass: [0.03, -0.08]}   # points
joints:
  pin: {type: revolute, between: [wheel, cart]}
  mesh: {type: rack, joints: [slide, pin], radius: r}
  slide: {type: prismatic, between: [cart, ground], axis: x}
forces:
  spring: {type: joint_spring, joint: slide, stiffness: 70, rest: 0.1}
reference: {find: equilibrium, guess: {cart: {x: 0.2}, wheel: {x: 0.2, theta: 0.5}}}
"""


def reduced(kinetic, potential, guess):
    """Return q and the angular frequency of small motions about V'(q) = 0, with T = M(q) u^2/2."""
    with mpmath.workdps(30):
        q = mpmath.findroot(lambda x: mpmath.diff(potential, x), guess)
        return float(q), float(mpmath.sqrt(mpmath.diff(potential, q, 2) / kinetic(q)))


def coordinate(model, name):
    """Return a coordinate of the equilibrium of a model."""
    mechanism = mbstab.loads(model)
    return float(mechanism.motion().q[mechanism.system().names.index(name)])


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize(("kind", "sense"), [("internal: false", -1), ("internal: true", 1)])
def test_two_pendulums_in_mesh_hang_and_swing_as_their_reduction_does(kind, sense, dimension):
    model = in_dimension(PENDULUMS.replace("TRAIN", kind), dimension)
    turn = sense * mpmath.mpf(36) / 24

    def potential(angle):
        other = -mpmath.mpf("0.4") + turn * (angle - mpmath.mpf("0.3"))
        heights = 2 * 0.3 * mpmath.sin(angle) + 5 * (0.1 * mpmath.sin(other) + 0.2 * mpmath.cos(other))
        return mpmath.mpf("9.81") * heights + 10 * (angle - mpmath.mpf("0.2")) ** 2

    inertia = 0.03 + 2 * 0.3**2 + turn**2 * (0.2 + 5 * (0.1**2 + 0.2**2))
    found = coordinate(model, "one.theta" if dimension == 2 else "one.psi")
    angle, frequency = reduced(lambda q: inertia, potential, found)
    assert found == pytest.approx(angle, rel=1e-11)
    assert frequencies(model) == pytest.approx([frequency], rel=1e-11)


@pytest.mark.parametrize("dimension", [2, 3])
def test_an_eccentric_pinion_on_a_cart_rolls_as_its_reduction_does(dimension):
    model = in_dimension(CART, dimension)
    r, arm, ahead = 0.2, math.hypot(0.03, 0.08), math.atan2(-0.08, 0.03)

    def turn(x):  # it rolls to the right by turning clockwise
        return mpmath.mpf("0.5") - (x - mpmath.mpf("0.2")) / mpmath.mpf("0.2") + ahead

    def potential(x):
        across = x + arm * mpmath.cos(turn(x))
        return -3 * (3 * x + 2 * across) + 18 * arm * mpmath.sin(turn(x)) + 35 * (x - mpmath.mpf("0.1")) ** 2

    def inertia(x):
        along, up = 1 + arm / r * mpmath.sin(turn(x)), -arm / r * mpmath.cos(turn(x))
        return 3 + 2 * (along**2 + up**2) + 0.05 / r**2

    found = coordinate(model, "cart.x")
    place, frequency = reduced(inertia, potential, found)
    assert found == pytest.approx(place, rel=1e-11)
    assert frequencies(model) == pytest.approx([frequency], rel=1e-11)


# --- planetary trains -----------------------------------------------------------------------------------------------

# The ring gear is the ground: it turns against the carrier as the carrier turns against it.
PLANETARY = """
mbstab: 1
bodies:
  carrier: {type: planar, mass: 1, inertia: 0.1, points: {P: [0.35, 0]}}   # points
  sun: {type: planar, mass: 1, inertia: 0.02}
  planet: {type: planar, mass: 0.5, inertia: 0.005}
joints:
  sun_and_planet: {type: gear, joints: [s, p], teeth: [20, 15]}
  c: {type: revolute, between: [carrier, ground]}
  s: {type: revolute, between: [sun, carrier]}
  p: {type: revolute, between: [planet, carrier.P]}
  ring_and_planet: {type: gear, joints: [c, p], teeth: [50, 15], internal: true}
forces:
  spring: {type: joint_spring, joint: c, stiffness: 100}
  torque: {type: actuator, joint: s, effort: 8}
reference: {find: equilibrium, guess: {planet: {x: 0.35}}}
"""
WHOLE = """
mbstab: 1
bodies:
  carrier: {type: planar, mass: 1, inertia: 0.1}
  sun: {type: planar, mass: 1, inertia: 0.02}
  ring: {type: planar, mass: 1, inertia: 0.3}
joints:
  set: {type: differential, joints: [c, s, r], teeth: [20, 50]}
  c: {type: revolute, between: [carrier, ground]}
  s: {type: revolute, between: [sun, ground]}
  r: {type: revolute, between: [ground, ring]}
  stop: {type: fixed, between: [ring, ground]}
forces:
  spring: {type: joint_spring, joint: c, stiffness: 100}
reference: {}
"""


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_planetary_train_has_the_ratios_of_willis(dimension):
    model = in_dimension(PLANETARY, dimension)
    sun, planet = 1 + 50 / 20, 1 - 50 / 15
    inertia = 0.1 + 0.02 * sun**2 + 0.005 * planet**2 + 0.5 * 0.35**2
    assert frequencies(model) == pytest.approx([math.sqrt(100 / inertia)], rel=1e-12)
    # 8 N m on the sun: the carrier carries it and what the ring holds.
    torques = {(x.owner, x.body): float(x.torque[-1]) for x in mbstab.loads(model).equilibria()[0].reactions}
    mesh, ring = "joint 'sun_and_planet'", "joint 'ring_and_planet'"
    expected = {(mesh, "sun"): -8, (mesh, "planet"): -6, (mesh, "carrier"): 14}
    expected |= {(ring, "planet"): 6, (ring, "carrier"): 14, (ring, "ground"): -20}
    assert {key: torques[key] for key in expected} == pytest.approx(expected, rel=1e-11)


@pytest.mark.few(1)
@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("elastic", [False, True])
def test_a_free_planetary_train_spins_on(elastic, dimension):
    model = re.sub(r"forces:(.|\n)*reference", "reference", PLANETARY)
    spinning = "guess: {planet: {x: 0.35}}, rates: {carrier: {theta: 3}, sun: {theta: 10.5}, planet: {theta: -7}}"
    model = model.replace("find: equilibrium, guess: {planet: {x: 0.35}}", spinning)
    if elastic:
        model = model.replace("teeth: [20, 15]", "radii: [0.2, 0.15], stiffness: 1e5, damping: 3")
    model = in_dimension(model, dimension)
    result, certificate = mbstab.loads(model).eig(), mbstab.loads(model).certify()
    assert (certificate.status, certificate.verdict) == ("proven", result.verdict)
    values = [e.value for e in result.eigenvalues]
    assert values.count(0) == 2
    if not elastic:
        assert result.verdict == "stable up to symmetry"
        return
    # The sun against carrier and planet, which turns by -50/15 of the carrier against it.
    rest, arm = 0.1 + 0.5 * 0.35**2 + 0.005 * (1 - 50 / 15) ** 2, 0.2 + 0.15 * 50 / 15
    square = 1e5 * (0.2**2 / 0.02 + arm**2 / rest)
    decay = 3e-5 * square / 2
    assert result.verdict == "asymptotically stable up to symmetry"
    assert values[0] == pytest.approx(-decay + 1j * math.sqrt(square - decay**2), rel=1e-11)


def test_a_planetary_set_is_a_differential_with_teeth():
    # The joint of the ring is written the other way round: its angle counts against the ground all the same.
    model = WHOLE.replace("  stop: {type: fixed, between: [ring, ground]}\n", "")
    model = model.replace("reference", "  ring: {type: joint_spring, joint: r, stiffness: 1e9}\nreference")
    assert frequencies(model)[0] == pytest.approx(math.sqrt(100 / (0.1 + 0.02 * 3.5**2)), rel=1e-6)
    moved = model.replace("reference: {}", "reference: {rates: {carrier: {theta: 2}, sun: {theta: 3}}}")
    mechanism = mbstab.loads(moved)
    assert mechanism.motion().u[mechanism.system().names.index("ring.theta")] == pytest.approx((70 * 2 - 20 * 3) / 50)


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("stiff", ["", ", stiffness: 1e9"])
def test_a_rack_pushes_and_its_pinion_is_turned(stiff, dimension):
    model = RACK.replace("radius: 0.05", "radius: 0.05" + stiff)
    model = model.replace(
        "reference: {}", "  push: {type: force, at: bar, vector: [7, 0]}   # points\nreference: {find: equilibrium}"
    )
    found = {
        x.body: x
        for x in mbstab.loads(in_dimension(model, dimension)).equilibria(twist=12)[0].reactions
        if "mesh" in x.owner
    }
    # The bar moves by x: 3000 x + 12 x/r^2 = 7.
    force = 7 * 12 / 0.05**2 / (3000 + 12 / 0.05**2)
    share = 1e-5 if stiff else 1e-12
    assert (found["bar"].force[0], found["ground"].force[0]) == pytest.approx((-force, force), rel=share)
    assert (found["wheel"].torque[-1], found["ground"].torque[-1]) == pytest.approx(
        (force * 0.05, -force * 0.05), rel=share
    )


# --- agreement, extremes --------------------------------------------------------------------------------------------

SPRUNG = (
    PAIR.replace("mbstab: 1", "mbstab: 1\nparameters: {n: 20, r: 0.15, k: 50}")
    + "forces: {k: {type: joint_spring, joint: a, stiffness: k}}\n"
)


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("ratio", ["1e6", "1e3", "1", "1e-3", "1e-6", "-3", "2.64713", "-0.31416"])
def test_ratios_may_be_extreme(ratio, dimension):
    model = in_dimension(SPRUNG.replace("TRAIN", f"type: gear, joints: [a, b], ratio: {ratio}"), dimension)
    found = [e.value.imag for e in mbstab.loads(model).eig().eigenvalues]
    assert max(found) == pytest.approx(math.sqrt(50 / (0.02 + 0.5 / float(ratio) ** 2)), rel=1e-11)


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize(("one", "other"), [("gear", "internal"), ("belt", "crossed")])
def test_a_negative_ratio_turns_in_the_other_sense(one, other, dimension):
    rows = [
        mbstab.loads(in_dimension(SPRUNG.replace("TRAIN", f"type: {one}, joints: [a, b], {x}"), dimension)).motion()
        for x in ("ratio: -3/2", f"ratio: 3/2, {other}: true")
    ]
    assert rows[0].dynamics.J.tolist() == rows[1].dynamics.J.tolist()


@pytest.mark.parametrize("dimension", [2, 3])
def test_digits_proof_methods_and_sweeps_agree(dimension):
    mechanism = mbstab.loads(
        in_dimension(SPRUNG.replace("TRAIN", "type: gear, joints: [a, b], teeth: [n, 40]"), dimension)
    )
    expected = math.sqrt(50 / (0.02 + 0.5 / 4))
    assert float(mechanism.eig_precise(30).eigenvalues[0].imag) == pytest.approx(expected, rel=1e-15)
    certificate = mechanism.certify()
    assert certificate.proven
    assert float(certificate.eigenvalues[0].imag) == pytest.approx(expected, rel=1e-12)
    slope = mechanism.sensitivities().derivatives[0].slopes[0]
    assert slope == pytest.approx(-0.5j * expected * 0.0125 / 0.145, rel=1e-11)
    sweep = mechanism.sweep("n", [10, 20, 30])
    found = np.max(np.asarray(sweep.branches).imag, axis=-1)
    assert found == pytest.approx([math.sqrt(50 / (0.02 + 0.5 * (n / 40) ** 2)) for n in (10, 20, 30)], rel=1e-12)


@pytest.mark.parametrize("dimension", [2, pytest.param(3, marks=pytest.mark.long)])
def test_all_methods_agree(dimension):
    model = in_dimension(SPRUNG.replace("TRAIN", "type: gear, joints: [a, b], teeth: [n, 40]"), dimension)
    outcomes = mbstab.loads(model).compare().outcomes
    assert not any(x.lost or x.invented for x in outcomes)
    assert max(float(np.max(x.errors)) for x in outcomes) < 1e-10


def test_a_weak_spring_is_seen_beside_stiff_teeth():
    model = in_space(SPRUNG.replace("TRAIN", "type: gear, joints: [a, b], radii: [0.05, r], stiffness: 1e7"))
    assert mbstab.loads(model).eig(k=1e-7).verdict == "stable"
    assert mbstab.loads(model).eig(k=0).verdict == "stable up to symmetry"


# --- many turns in space --------------------------------------------------------------------------------------------

SPIN = in_space(PAIR.replace("TRAIN", "type: gear, joints: [a, b], teeth: [17, 41]")).replace(
    "reference: {}", "reference: {rates: {one: {psi: 50}}}"
)


def test_a_spinning_train_is_a_steady_motion():
    result = mbstab.loads(SPIN).eig()
    assert result.verdict == "stable up to symmetry"
    assert [e.value for e in result.eigenvalues] == [0, 0]


@pytest.mark.long
@pytest.mark.parametrize("dimension", [2, 3])
def test_a_spinning_train_is_proven_whatever_rates_the_file_leaves_out(dimension):
    turning = SPIN if dimension == 3 else PAIR.replace("TRAIN", "type: gear, joints: [a, b], teeth: [17, 41]").replace(
        "reference: {}", "reference: {rates: {one: {theta: 50}}}"
    )  # fmt: skip
    free = re.sub(r"forces:(.|\n)*reference", "reference", PLANETARY)
    planets = free.replace("find: equilibrium,", "rates: {carrier: {theta: 3}},")
    for model in (turning, in_dimension(planets, dimension)):
        certificate = mbstab.loads(model).certify()
        assert (certificate.status, certificate.verdict) == ("proven", "stable up to symmetry")


@pytest.mark.parametrize("options", [{}, {"method": "radau"}])
def test_wheels_keep_their_ratio_through_many_turns(options):
    model = SPIN.replace("reference:", "forces:\n  drag: {type: joint_spring, joint: b, damping: 0.05}\nreference:")
    model = model.replace("reference: {rates: {one: {psi: 50}}}", "initial: {rates: {one: {psi: 50}}}")
    run = mbstab.loads(model).simulate(2.0, **options)
    one, two = (np.asarray(run.q)[:, run.names.index(f"{name}.psi")] for name in ("one", "two"))
    np.testing.assert_allclose(17 * one + 41 * two, 0.0, atol=1e-9)
    inertia, drag = 0.02 + 0.5 * (17 / 41) ** 2, 0.05 * (17 / 41) ** 2
    np.testing.assert_allclose(one[-1], 50 * inertia / drag * (1 - math.exp(-2.0 * drag / inertia)), rtol=1e-6)
    assert one[-1] > 14 * 2 * math.pi


def test_a_joint_may_stand_anywhere_at_the_reference():
    # Both wheels at half a turn, where an angle within half a turn jumps.
    for reference in ("{one: {psi: pi}, two: {psi: -pi}}", "{one: {psi: 7}, two: {psi: 3}}"):
        model = (
            in_space(SPRUNG)
            .replace("TRAIN", "type: gear, joints: [a, b], teeth: [17, 41]")
            .replace("stiffness: k", "stiffness: k, rest: 0")
        )
        free = model.replace("reference: {}", f"reference: {{coordinates: {reference}}}").replace(
            "joint_spring, joint: a, stiffness: k, rest: 0", "joint_spring, joint: a, damping: k"
        )
        values = sorted(e.value.real for e in mbstab.loads(free).eig().eigenvalues)
        assert values == pytest.approx([-50 / (0.02 + 0.5 * (17 / 41) ** 2), 0.0], rel=1e-12, abs=1e-12)


def test_bodies_that_start_across_their_hinge_are_told():
    model = in_space(PAIR).replace("TRAIN", "type: gear, joints: [a, b], ratio: 2").replace("axis: z", "axis: [z, x]")
    with pytest.raises(
        mbstab.NumericalError, match=r"<text>:7:9: joints.mesh(.|\n)*give the angles of the bodies under"
    ):
        mbstab.loads(model).eig()


# --- what is fixed by the file --------------------------------------------------------------------------------------


@pytest.mark.parametrize("dimension", [2, 3])
def test_an_offset_says_how_the_wheels_stand(dimension):
    model = SPRUNG.replace("TRAIN", "type: belt, joints: [a, b], ratio: 4, offset: 0.2")
    model = in_dimension(model.replace("reference: {}", "reference: {coordinates: {one: {theta: 0}}}"), dimension)
    # angle 1 - 4 angle 2 = 0.2
    assert coordinate(model, "two.theta" if dimension == 2 else "two.psi") == pytest.approx(-0.05, rel=1e-12)


def test_wheels_that_lock_each_other_are_told():
    loop = PAIR.replace("TRAIN", "type: gear, joints: [a, b], ratio: 2").replace(
        "  a:", "  again: {type: gear, joints: [b, a], ratio: 1/2}\n  a:"
    )
    report = mbstab.loads(loop).check()
    assert report.degrees_of_freedom == 1
    assert report.n_holonomic - report.rank_holonomic == 1
    locked = mbstab.loads(loop.replace("1/2}", "1/2, internal: true}")).check()
    assert locked.degrees_of_freedom == 0


def test_wheels_are_drawn_by_their_pitch_circles():
    scene = mbstab.loads(PLANETARY).system().scene
    found = {
        item.name: [(scene.bodies[look.points[0].body].name, look.form.lengths[0]) for look in item.kind.look(item)]
        for item in scene.items
        if item.kind.name == "gear"
    }
    assert found["sun_and_planet"] == [("planet", pytest.approx(0.15)), ("sun", pytest.approx(0.2))]
    assert found["ring_and_planet"] == [("planet", pytest.approx(0.15))]


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("crossed", ["false", "true"])
def test_the_spans_of_a_belt_touch_both_wheels(crossed, dimension):
    belt = f"type: belt, joints: [a, b], radii: [0.05, 0.15], crossed: {crossed}"
    apart = PAIR.replace("mbstab: 1\n", "mbstab: 1\nground: {points: {B: [0.4, 0.3]}}   # points\n")
    apart = apart.replace("two, ground", "two, ground.B").replace("{}", "{guess: {two: {x: 0.4, y: 0.3}}}")
    scene = mbstab.loads(in_dimension(apart.replace("TRAIN", belt), dimension)).system().scene
    (item,) = (item for item in scene.items if item.kind.name == "belt")
    spans = [
        [np.array(point.point[:2]) for point in look.points] for look in item.kind.look(item) if look.sign == "line"
    ]
    for first, second in spans:
        for end, centre, radius in ((first, np.zeros(2), 0.05), (second, np.array([0.4, 0.3]), 0.15)):
            assert np.linalg.norm(end - centre) == pytest.approx(radius, rel=1e-12)
            assert (end - centre) @ (second - first) == pytest.approx(0.0, abs=1e-15)
        # On which side of the line between the axles the ends are.
        side, other = (float(np.array([-0.3, 0.4]) @ end) for end in (first, second))
        assert (side * other < 0.0) == (crossed == "true")
    assert len(spans) == 2


def test_a_differential_is_drawn_by_its_axles():
    scene = mbstab.load("differential.yaml").system().scene
    (item,) = (item for item in scene.items if item.kind.name == "differential")
    found = [[scene.bodies[point.body].name for point in look.points] for look in item.kind.look(item)]
    assert found == [["case", "left"], ["case", "right"]]


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
    "a ratio of zero": ("joints: [a, b], ratio: »0", "ratio must not be zero, got 0"),
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
    odd = PAIR.replace("TRAIN", "type: gear, joints: [a, b], ratio: sqrt(2)")
    assert mbstab.loads(odd).eig().verdict == "stable up to symmetry"
    with pytest.raises(
        mbstab.ModelFileError, match=r"in space a ratio must be a fraction .* got 1.414(.|\n)*\[n1"
    ) as no:
        mbstab.loads(in_space(odd)).eig()
    assert mbstab.loads(in_space(odd).replace("sqrt(2)", "37/10")).eig().verdict == "stable up to symmetry"
    (row,) = re.findall(r"\{nonholonomic: .*?\}", str(no.value).replace("\n", " "))
    spring = "forces: {k: {type: joint_spring, joint: a, stiffness: 50}}\n"
    free = (
        re.sub(r"\n *mesh: .*", "", in_space(odd)) + f"constraints: {{r: {row.replace('ratio', 'sqrt(2)')}}}\n" + spring
    )
    found = max(e.value.imag for e in mbstab.loads(free).eig().eigenvalues)
    assert found == pytest.approx(math.sqrt(50 / (0.02 + 0.25)), rel=1e-11)


# --- trains whose joints have no body in common: what their equations are, and that they are told ---------------------


HOUSINGS = """
mbstab: 1
bodies:
  h1: {type: planar, mass: 1, inertia: 0.3}
  h2: {type: planar, mass: 1, inertia: 0.5}
  w1: {type: planar, mass: 1, inertia: 0.02}
  w2: {type: planar, mass: 1, inertia: 0.07}
joints:
  a: {type: revolute, between: [h1, ground]}
  b: {type: HELD, between: [h2, AT]}
  c: {type: revolute, between: [w1, h1]}
  d: {type: revolute, between: [ORDER]}
  mesh: {type: TRAIN, joints: [c, d], ratio: 2}
forces:
  s1: {type: joint_spring, joint: a, stiffness: 20}
  s2: {type: joint_spring, joint: c, stiffness: 3}
OTHER
reference: {}
"""
FREE = "  s3: {type: joint_spring, joint: b, stiffness: 50}"


def housings(held="revolute", at="ground", order="w2, h2", train="gear", other=FREE):
    keys = {"HELD": held, "AT": at, "ORDER": order, "TRAIN": train, "OTHER": other}
    text = HOUSINGS
    for key, value in keys.items():
        text = text.replace(key, value)
    return text


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize(("train", "sense"), [("gear", -1), ("belt", 1)])
def test_joints_without_a_common_body_are_coupled_as_by_a_cable_and_told(train, sense, dimension):
    model = in_dimension(housings(train=train), dimension)
    # Turns of both housings, and of the first wheel in its own; each coupling moment acts on all four bodies.
    T = np.array([[1, 0, 0], [0, 1, 0], [1, 0, 1], [0, 1, 0.5 * sense]])
    M = T.T @ np.diag([0.3, 0.5, 0.02, 0.07]) @ T
    exact = np.sqrt(np.sort(np.linalg.eigvals(np.linalg.solve(M, np.diag([20.0, 50.0, 3.0]))).real))
    assert frequencies(model) == pytest.approx(exact, rel=1e-9)
    (text,) = mbstab.loads(model).eig().warnings
    assert text.startswith("joint 'mesh': the joints 'c' and 'd' have no body in common; their motions are coupled as")


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"order": "w2, h1"}, False),
        ({"order": "h1, w2"}, False),
        ({"held": "fixed", "at": "h1", "other": ""}, False),
        # The sense of the second angle would be another one in mesh.
        ({"held": "fixed", "at": "h1", "other": "", "order": "h2, w2"}, True),
        ({"held": "fixed", "at": "ground", "other": ""}, True),
        ({"order": "w2, ground"}, True),
    ],
)
def test_one_body_that_carries_the_wheels_is_enough(change, told):
    mechanism = mbstab.loads(housings(**change))
    assert any("no body in common" in text for text in mechanism.eig().warnings) == told
    swept = mbstab.loads(
        housings(**change).replace("mbstab: 1", "mbstab: 1\nparameters: {k: 3}").replace("ss: 3", "ss: k")
    )
    assert any("no body in common" in text for text in swept.sweep("k", np.linspace(1.0, 3.0, 3)).warnings) == told
