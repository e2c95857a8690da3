"""What is wrong with a file is told with what mends it."""

import math

import pytest
from click.testing import CliRunner

import mbstab
from mbstab.cli import main
from mbstab.errors import MbstabError

HEAD = "mbstab: 1\ntitle: x\n"
ROD = "bodies: {rod: {type: planar, mass: 1, inertia: 1}}\n"
HELD = ROD + "joints: {pivot: {type: revolute, between: [rod, ground]}}\n"
CONTROLLED = HELD + "forces: {c: {type: state_feedback, joint: pivot, gains: {angle(GIVEN): 20}LAG}}\n"
ROTOR = (
    "bodies: {disk: {type: spatial, mass: 1, inertia: INERTIA}}\n"
    "forces: {b: {type: bushing, between: [disk, ground], stiffness: [1e4, 1e4, 1e4], damping: [1, 1, 1]}}\n"
    "reference: {find: steady, steady: {axis: z, rate: 0}, rates: {disk: {psi: 100}}}\n"
)

CORNERING = (
    "bodies: {car: {type: planar, mass: 1000, inertia: 1000}}\n"
    "forces:\n"
    "  a: {type: tyre, at: car, cornering_stiffness: 1e4}\n"
    "reference: {rates: {car: {x: 10}}}\n"
)

CASES = {
    "bodies:\n  rod: {type: planar}\n   b: {type: planar}\n": ("5:4", "indented by 3 blanks"),
    "bodies: {rod: {type: planar mass: 1}}\n": ("3:", "lacks a comma"),
    ROD + "springs:\n  s: {type: spring}\n": ("4:1", "in the section 'forces', of type joint_spring, spring"),
    ROD + "dampers:\n  s: {}\n": ("4:1", "dampers stand in the section 'forces'"),
    ROD + "Motors:\n  s: {}\n": ("4:1", "in the section 'forces', of type motor"),
    ROD + "gears:\n  s: {}\n": ("4:1", "in the section 'joints', of type gear"),
    "bodies: {d: {type: spatial, mass: 1, shape: {type: disk, radius: 1, axis: z}}}\n": ("3:", "did you mean 'along'?"),
    "source: a: b\n" + ROD: ("3:10", "in quotes"),
    "bodies:\n  rod: {type: planar, mass: 1, inertia: 1}\n  pivot: {type: revolute, between: [rod, ground]}\n": (
        "5:17", "'revolute' is a type of joints: is the line 'joints:' missing or indented?"
    ),
    CONTROLLED.replace("GIVEN", "pivt").replace("LAG", ""): ("5:", "did you mean 'pivot'?"),
    CONTROLLED.replace("GIVEN", "pivot").replace("LAG", ", lag: 0"): ("5:", "leave it out: without it"),
    "parameters: {T: 5 ms}\n" + ROD: ("3:17", "write {value: 5, unit: ms}"),
    HELD + "forces: {c: {type: pid, joint: pivto, of: angle(pivot), P: 1}}\n": ("5:", "did you mean 'pivot'?"),
    HELD + "forces: {c: {type: pid, joint: pivot, of: rod.phi, P: 1}}\n": ("5:", "rod has the coordinates x, y, theta"),
    HELD + "forces: {c: {type: joint_spring, joint: pivot, stifness: 1}}\n": ("5:", "did you mean 'stiffness'?"),
    HELD + "forces: {c: {type: transfer_function, joint: pivot, signal: angle(pivot), numerator: 0.5, "
    "denominator: [1, 2]}}\n": ("5:", "for example [1, 0.5]"),
    HELD + "forces: {c: {type: state_space, joint: pivot, signal: angle(pivot), A: -20, B: [1], C: [1]}}\n": (
        "5:", "for example [[0, 1], [-2, -3]]"
    ),
    HELD + "forces: {c: {type: expression, on: {angle(pivot): -effort(c)}}}\n": ("5:", "the state NAME_effort"),
    HELD + "states: {u: {rate: acceleration(rod.theta)}}\n": ("5:", "take rate(w)"),
    ROD + "constraints: {c: {nonholonomic: rate(rod.x) = 1}}\n": ("4:", "what is zero: left - (right)"),
    HELD + "forces: {c: {type: pid, joint: pivot, of: angle(pivot), target: 1, P: 3, I: 1}}\n"
    "reference: {find: equilibrium, coordinates: {rod: {theta: 0}}}\n": ("6:", "they settle where the rate is zero"),
    CONTROLLED.replace("angle(GIVEN): 20", "pivot: 20").replace("LAG", ""): ("5:", "'pivot' is a joint: angle(pivot)"),
    CONTROLLED.replace("angle(GIVEN): 20", "rod: 20").replace("LAG", ""): (
        "5:", "'rod' is a body: it has the coordinates rod.x"
    ),
    CONTROLLED.replace("GIVEN", "pivot").replace("LAG", "").replace("20", "20,5"): ("5:", "write 0.5 for 0,5"),
    ROD + "expect: [{source: a book}]\n": ("4:10", "mbstab schema expect shows the keys"),
    ROD + "constraints: {c: {holonomic: rod.y**2}}\n": ("4:", "without a power"),
    ROD + "constraints: {c: {holonomic: (rod.x - 1)**4}}\nreference: {guess: {rod: {x: 1.3}}}\n": (
        "4:", "without a power"
    ),
    ROD + "constraints: {c: {holonomic: rod.x**2 + rod.y**2}}\nreference: {coordinates: {rod: {x: 0, y: 0}}}\n": (
        "4:", "one constraint for each"
    ),
    CORNERING.replace("x: 10", "theta: 10"): ("5:", "at rest or turning on the spot"),
    HELD + "states: {z: {rate: y - z}}\n": ("5:", "coordinates are written with their body, such as rod.y"),
    HELD + "states: {z: {rate: -z, initial: 3}}\n": ("5:", "stands under initial: coordinates:"),
    HELD + "tables: {T: {x: [0, 1], y: [0, 1]}}\nstates: {z: {rate: \"table(T, rod.x)\"}}\n": (
        "6:", "the table comes last: table(x, T)"
    ),
    HELD + "forces: {c: {type: pid, joint: pivot, of: angle(pivot), P: 3, setpoint: 1}}\n": ("5:", "mean 'target'?"),
    HELD + "forces: {c: {type: bearing, between: [rod, ground], stiffness: 1, kxx: 1}}\n": (
        "5:", "kxx is a key of the type rotor_bearing"
    ),
    CORNERING.replace("1e4", "-1e4"): ("5:", "the other sign have it negative"),
    CORNERING.replace("1e4", "1e4, camber_stiffness: 10"): (
        "5:", "a tyre has camber_stiffness in spatial scenes only, and this one is planar"
    ),
    ROTOR.replace("INERTIA", "[0.01, 0.012, 0.02]"): ("5:", "only with equal moments of inertia xx and yy"),
}  # fmt: skip


@pytest.mark.parametrize("text", CASES)
def test_what_is_wrong_is_told_with_what_mends_it(text):
    place, hint = CASES[text]
    with pytest.raises(MbstabError) as error:
        mbstab.loads(HEAD + text).eig()
    told = str(error.value)
    assert f":{place}" in told
    assert hint in told
    assert told.count("hint:") == 1  # nothing that follows from it is told beside it


def test_a_round_rotor_spins():
    answer = mbstab.loads(HEAD + ROTOR.replace("INERTIA", "[0.01, 0.01, 0.02]")).eig()
    assert len(answer.eigenvalues) == 12


@pytest.mark.parametrize("given", ["rod.theta=10 deg", "rod.theta=10*deg", "rod.theta=10000*deg/1000"])
def test_disturbances_take_units(given):
    answer = CliRunner().invoke(main, ["simulate", "pendulum.yaml", "--perturb", given, "--to", "0.1", "--once"])
    assert answer.exit_code == 0, answer.stderr
    assert "0.034729636" in answer.stdout  # 0.2 m * sin(10 deg)


@pytest.mark.parametrize(("given", "hint"), [("rod.theta=1 kg", "in rad"), ("rate(rod.theta)=1 deg", "in rad/s")])
def test_units_of_disturbances_must_fit(given, hint):
    answer = CliRunner().invoke(main, ["simulate", "pendulum.yaml", "--perturb", given])
    assert answer.exit_code == 2
    assert f"hint: give it {hint}" in answer.stderr


def test_where_branches_meet_is_told_with_parameter_and_unit():
    answer = CliRunner().invoke(main, ["sweep", "ziegler_column.yaml", "--param", "P", "--plot", "none"])
    assert "branches meet at P (N): " in answer.stdout


@pytest.mark.parametrize(("coordinate", "held"), [("rod.x", True), ("rod.theta", False)])
def test_a_controller_of_a_coordinate_that_constraints_hold_is_told(coordinate, held):
    text = HEAD + HELD + f"forces: {{c: {{type: pid, coordinate: {coordinate}, of: rod.theta, P: 3, D: 1}}}}\n"
    found = mbstab.loads(text + "reference: {coordinates: {rod: {theta: 0}}}\n").eig()
    assert (f"forces.c acts on {coordinate}, which the constraints hold" in " ".join(found.warnings)) == held


SPUN = """mbstab: 1
bodies: {{rotor: {{type: spatial, mass: 9, inertia: {inertia}, points: {{A: {end}}}}}}}
ground: {{points: {{A: {end}}}}}
forces: {{A: {{type: rotor_bearing, between: [rotor.A, ground.A], axis: {axis}, zero: {zero}, kxx: 3e5, kyy: 2e5}}}}
constraints: {{thrust: {{holonomic: rotor.{axis}}}}}
reference:
  coordinates: {{rotor: {{x: 0, y: 0, z: 0, phi: 0, theta: 0, psi: 0}}}}
  rates: {{rotor: {{{angle}: 300}}}}
"""


@pytest.mark.parametrize(
    ("inertia", "axis", "angle", "said"),
    [
        ("[1, 2, 2]", "x", "phi", "turn its axes by axes: [0, 90*deg, 0] in bodies.rotor"),
        ("[2, 1, 2]", "y", "theta", "turn its axes by axes: [-90*deg, 0, 0] in bodies.rotor"),
        ("[2, 2.1, 1]", "z", "psi", "only with equal moments of inertia xx and yy"),
        ("[2, 2, 1]", "z", "psi", ""),
    ],
)
def test_a_spin_that_is_not_steady_is_told_with_the_remedy(inertia, axis, angle, said):
    end, zero = {"x": ("[0.3, 0, 0]", "y"), "y": ("[0, 0.3, 0]", "z"), "z": ("[0, 0, 0.3]", "x")}[axis]
    text = SPUN.format(inertia=inertia, axis=axis, angle=angle, end=end, zero=zero)
    reasons = " ".join(mbstab.loads(text).eig().reasons)
    assert said in reasons
    assert ("frozen-time" in reasons) == bool(said)


@pytest.mark.parametrize(
    ("model", "right", "wrong", "said"),
    [
        (
            "rolling_torus",
            "z: rho",
            "z: R",
            "the height of its lowest point (upright, its centre is at the height radius + tube) is -0.05 m",
        ),
        ("rattleback", "z: c - h,", "z: c - h + 0.01,", "the height of its lowest point is 0.01 m"),
    ],
)
def test_a_contact_at_the_wrong_height_is_told_which_height_it_has(model, right, wrong, said):
    text = CliRunner().invoke(main, ["models", "show", model]).stdout
    assert right in text
    with pytest.raises(MbstabError) as error:
        mbstab.loads(text.replace(right, wrong)).eig()
    assert said in str(error.value)


@pytest.mark.parametrize("given", ["1e-9*rod.x + rod.y**2", "rod.y - exp(rod.x/0.001) + 1", "rod.y**2 - 1e-8"])
def test_a_small_derivative_that_does_not_vanish_is_no_square(given):
    found = mbstab.loads(
        f"{HEAD}{ROD}constraints: {{c: {{holonomic: {given}}}}}\nreference: {{guess: {{rod: {{y: 0.5}}}}}}\n"
    )
    assert found.eig().counts.expected == 4


@pytest.mark.parametrize(("first", "last", "told"), [("5", "8", True), ("0", "8", False), ("0", "3", False)])
def test_a_sweep_that_is_undecided_everywhere_says_what_tells_more(first, last, told):
    arguments = ["sweep", "rolling_disk.yaml", "--param", "omega", "--from", first, "--to", last, "--points", "5"]
    answer = CliRunner().invoke(main, [*arguments, "--plot", "none"])
    assert answer.exit_code == 0, answer.stderr
    assert ("hint: mbstab eig with --set omega=6.5 says what is open there" in answer.stdout) == told


FALLING = """
mbstab: 1
gravity: [0, -9.81]
bodies:
  disk: {type: planar, mass: 1, inertia: 1}
forces:
  f: {type: expression, on: {disk.x: -200*disk.x, disk.y: -100*disk.y - 500*disk.y**2}}
reference:
  rates: {disk: {theta: 1e4}}
"""


@pytest.mark.parametrize("force", ["-100*disk.y - 500*disk.y**2", "-100*disk.y"])
def test_a_spin_about_a_place_where_forces_do_not_balance_is_told_with_the_acceleration(force):
    # With the soft spring the disk falls out of its reach, although it is stiff where the reference is.
    answer = mbstab.loads(FALLING.replace("-100*disk.y - 500*disk.y**2", force)).eig()
    assert answer.verdict == "undecided"
    (reason,) = answer.reasons
    assert "forces do not balance (disk.y accelerates with -9.81 m/s^2)" in reason
    assert "find: steady" in reason


@pytest.mark.parametrize(
    ("forces", "word"),
    [("{}", "stable up to symmetry"), ("{f: {type: expression, on: {b.z: -100*b.z}}}", "undecided")],
)
def test_a_spin_in_free_fall_is_steady_but_for_the_fall(forces, word):
    # Nothing depends on place or speed of the fall: its disturbances are those without gravity.
    body = "bodies: {b: {type: spatial, mass: 1, inertia: [1, 1, 2]}}\nreference: {rates: {b: {psi: 3}}}\n"
    assert mbstab.loads(f"mbstab: 1\ngravity: [0, 0, -9.81]\n{body}forces: {forces}\n").eig().verdict == word


SAGGING = """
mbstab: 1
parameters: {Omega: 50}
gravity: [0, -9.81, 0]
ground: {points: {A: [0, 0, -0.2], B: [0, 0, 0.6]}}
bodies:
  one: {type: spatial, mass: 2, inertia: [0.02, 0.02, 0.03], points: {L: [0, 0, -0.2], R: [0, 0, 0.2]}}
  two: {type: spatial, mass: 1, inertia: [0.01, 0.01, 0.015], points: {L: [0, 0, -0.2], R: [0, 0, 0.2]}}
forces:
  b1: {type: bushing, between: [one.L, ground.A], stiffness: [2e4, 2e4, 1e5]}
  b2: {type: bushing, between: [two.R, ground.B], stiffness: [2e4, 2e4, 1e5]}
  shaft:
    type: bushing
    between: [one.R, two.L]
    stiffness: [1e6, 1e6, 1e5]
    torsional_stiffness: [3000, 3000, 500]
    torsional_damping: [1, 1, 0.1]
reference:
  find: steady
  steady: {axis: z, rate: 0}
  rates: {one: {psi: Omega}, two: {psi: Omega}}
  guess: {two: {z: 0.4}}
"""


def test_a_sagging_rotor_with_inner_damping_is_told_to_need_a_drive():
    with pytest.raises(MbstabError) as error:
        mbstab.loads(SAGGING).eig()
    assert "forces.shaft takes 0.00241 W from the motion" in str(error.value)
    assert "hold the speed by a drive" in str(error.value)
    drive = "drives:\n  spin: {type: coordinate, coordinate: one.psi, velocity: Omega}\nreference:"
    motion = mbstab.loads(SAGGING.replace("reference:", drive)).motion()
    # The bend of the shaft turns on the spot: its damper sees the rate of the bend in the turning shaft.
    bend = motion.q[3] - motion.q[9]
    assert math.isclose(50.0**2 * bend**2, 0.00241, rel_tol=0.01)
