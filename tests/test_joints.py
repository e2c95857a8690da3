"""The table of joints: how many rows each has, that it is documented, what a new one needs; turns of shafts."""

import math
from pathlib import Path

import numpy as np
import pytest
from mechanisms import frequencies

import mbstab
from mbstab.mechanics import joints
from mbstab.mechanics.elements import list_kinds

MANUAL = (Path(mbstab.__file__).parent / "manual" / "model-file.md").read_text(encoding="utf-8")

ROWS = {
    ("revolute", 3): 5,
    ("revolute", 2): 2,
    ("prismatic", 3): 5,
    ("prismatic", 2): 2,
    ("cylindrical", 3): 4,
    ("universal", 3): 4,
    ("constant_velocity", 3): 4,
    ("spherical", 3): 3,
    ("spherical", 2): 2,
    ("planar", 3): 3,
    ("fixed", 3): 6,
    ("fixed", 2): 3,
    ("point_on_line", 3): 2,
    ("point_on_line", 2): 1,
    ("point_on_plane", 3): 1,
    ("distance", 3): 1,
    ("distance", 2): 1,
    ("screw", 3): 5,
}

BODY = {2: "{type: planar, mass: 1, inertia: 1}", 3: "{type: spatial, mass: 1, inertia: [1, 1, 1]}"}
EXTRA = {"distance": ", length: 1", "screw": ", axis: z, lead: 0.1"}
START = {"distance": "{x: 1}"}


def test_the_table_is_complete():
    assert set(ROWS) == set(list_kinds(joints))


@pytest.mark.parametrize(("name", "dimension"), ROWS, ids=lambda x: str(x))
def test_a_joint_takes_away_as_many_freedoms_as_it_has_rows(name, dimension):
    kind = list_kinds(joints)[name, dimension]
    axis = ", axis: x" if any(f.name == "axis" for f in kind.fields) else ""
    axis = ", axis: [x, y]" if name == "universal" else axis
    text = (
        f"mbstab: 1\nbodies:\n  b: {BODY[dimension]}\n"
        f"joints:\n  j: {{type: {name}, between: [b, ground]{EXTRA.get(name, axis)}}}\n"
        f"reference: {{guess: {{b: {START.get(name, '{x: 0}')}}}}}\n"
    )
    report = mbstab.loads(text).check()
    assert report.n_holonomic == report.rank_holonomic == ROWS[name, dimension]
    assert report.degrees_of_freedom == {2: 3, 3: 6}[dimension] - ROWS[name, dimension]


@pytest.mark.parametrize("name", sorted({name for name, _ in ROWS}))
def test_a_joint_is_in_the_manual(name):
    row = next(line for line in MANUAL.splitlines() if line.startswith("| `joints` |"))
    assert name in row.replace("|", ",").replace(" ", "").split(",")


@pytest.mark.parametrize("slope", [0.0, 0.4, -1.1])
def test_a_bead_on_a_tilted_wire_swings_with_its_spring(slope):
    text = (
        f"mbstab: 1\nparameters: {{a: {slope}, k: 7, m: 2, g: 9.81}}\ngravity: [0, 0, -g]\n"
        "bodies: {bead: {type: point, mass: m}}\n"
        "ground: {directions: {wire: [cos(a), 0, sin(a)]}}\n"
        "joints: {on: {type: point_on_line, between: [ground, bead], axis: [wire, x]}}\n"
        "forces:\n  spring: {type: spring, between: [bead, {body: ground, point: [10*cos(a), 0, 10*sin(a)]}], "
        "stiffness: k, length: 10}\n"
        "reference:\n  coordinates:\n    bead: {x: -m*g*sin(a)/k*cos(a), y: 0, z: -m*g*sin(a)/k*sin(a)}\n"
    )
    result = mbstab.loads(text).eig()
    assert result.verdict == "stable"
    assert [e.value.imag for e in result.eigenvalues] == pytest.approx([math.sqrt(3.5), -math.sqrt(3.5)], rel=1e-13)


# --- constant velocity: shafts turn equally at any bend, behind Hooke's joints they do not ----------------------------


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


@pytest.mark.long
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


@pytest.mark.parametrize("beta", [pytest.param(0, marks=pytest.mark.long), 0.7])
def test_a_straight_shaft_is_proven_and_a_bent_one_up_to_what_its_cosines_say(beta):
    certificate = mbstab.loads(SHAFTS).certify(beta=beta)
    assert certificate.conditions == (("the reference satisfies the equations of motion",) if beta else ())
    assert certificate.proven == (not beta)
    assert certificate.verdict == "stable up to symmetry"
    assert max(float(e.imag) for e in certificate.eigenvalues) == pytest.approx(TWISTED, rel=1e-12)


def test_a_driven_shaft_turns_the_other_at_the_same_rate():
    model = SHAFTS.replace("forces:", "drives:\n  motor: {type: coordinate, coordinate: one.phi, velocity: 7}\nforces:")
    run = mbstab.loads(model.replace("reference: {}", "reference: {rates: {two: {phi: 7}}}")).simulate(0.5, beta=0.9)
    angle = np.asarray(run.q)[:, run.names.index("two.phi")]
    np.testing.assert_allclose(angle, 7.0 * np.asarray(run.times), atol=1e-6)


@pytest.mark.parametrize("reference", ["shaft: {phi: pi}", "shaft: {phi: 3.0}", "shaft: {psi: pi}"])
def test_shafts_turned_by_half_a_turn_against_each_other_are_refused(reference):
    model = SHAFTS.replace("beta: 0.5", "beta: 0").replace(
        "reference: {}", f"reference: {{coordinates: {{one: {{phi: 0}}, {reference}}}}}"
    )
    with pytest.raises(mbstab.MbstabError, match=r"<text>:12:9: joints.bend"):
        mbstab.loads(model).eig()
