"""The table of joints: how many rows each has, that it is documented, and what a new one needs."""

import math
from pathlib import Path

import pytest

import mbstab
from mbstab.mechanics.joints import KINDS

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
    assert set(ROWS) == set(KINDS)


@pytest.mark.parametrize(("name", "dimension"), ROWS, ids=lambda x: str(x))
def test_a_joint_takes_away_as_many_freedoms_as_it_has_rows(name, dimension):
    kind = KINDS[name, dimension]
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
