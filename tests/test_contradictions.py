"""Constraints that contradict each other: every command says the same, with the gap and the entries."""

import re

import pytest
from click.testing import CliRunner

import mbstab
from mbstab.cli.main import main
from mbstab.errors import ModelFileError

HEAD = "mbstab: 1\ngravity: GRAVITY\n"
PINS = """\
ground: {points: {A: [0, 0], B: [0.8, 0]}}
bodies: {rod: {type: planar, mass: 1, inertia: 0.1, points: {A: [0, 0], B: [0.5, 0]}}}
joints:
  left: {type: revolute, between: [rod.A, ground.A]}
  right: {type: revolute, between: [rod.B, ground.B]}
"""
WELDS = """\
ground: {points: {P: [0.3, 0.4]}}
bodies: {plate: {type: planar, mass: 1, inertia: 0.1}}
joints:
  left: {type: fixed, between: [plate, ground]}
  right: {type: fixed, between: [plate, ground.P]}
"""
BALLS = """\
ground: {points: {A: [0, 0, 0], B: [0, 0, 0.7]}}
bodies: {rod: {type: spatial, mass: 1, inertia: [0.1, 0.1, 0.1], points: {A: [0, 0, 0], B: [0, 0, 0.5]}}}
joints:
  left: {type: spherical, between: [rod.A, ground.A]}
  right: {type: spherical, between: [rod.B, ground.B]}
"""
SPIN = "bodies: {d: {type: planar, mass: 1, inertia: 0.1}}\njoints:\n  pin: {type: revolute, between: [d, ground]}\n"
DRIVE = "  {}: {{type: coordinate, coordinate: d.theta, position: {}}}\n"
DRIVES = SPIN + "drives:\n" + DRIVE.format("left", 0.25) + DRIVE.format("right", 1)
CASES = {
    "pins": (PINS, "joint", "[0, -9.81]", "0.3 m"),
    "pins without gravity": (PINS, "joint", "[0, 0]", "0.3 m"),
    "welds": (WELDS, "joint", "[0, -9.81]", "0.5 m"),
    "balls": (BALLS, "joint", "[0, 0, -9.81]", "0.2 m"),
    "angles": (DRIVES, "drive", "[0, -9.81]", "0.75 rad"),
}


@pytest.mark.parametrize("name", CASES)
def test_the_gap_and_both_entries_are_told_alike_by_every_command(name, tmp_path):
    text, kind, gravity, gap = CASES[name]
    path = tmp_path / "open.yaml"
    path.write_text(HEAD.replace("GRAVITY", gravity) + text)
    told = set()
    for command in (["check"], ["eig"], ["equilibrium"], ["linearize"], ["simulate", "--to", "0.1"]):
        result = CliRunner().invoke(main, [command[0], str(path), *command[1:]])
        assert (result.exit_code, result.stdout) == (2, "")
        told.add(result.stderr)
    assert len(told) == 1
    for one, other in (("left", "right"), ("right", "left")):
        said = (
            rf"satisfy {kind} '{one}' .*: the residual is .*; where {kind} '{other}' is satisfied, the gap is {gap}\n"
        )
        assert re.search(said, told.copy().pop())


def test_the_one_entry_that_contradicts_the_others_is_told():
    """A gap is told for the entry without which the others close; independent contradictions do not hide each other."""
    third = "  again: {type: fixed, between: [plate, ground.P]}\n"
    with pytest.raises(ModelFileError) as caught:
        mbstab.loads("mbstab: 1\n" + WELDS + third).eig()
    gaps = {p.path: "the gap is" in p.message for p in caught.value.problems}
    assert gaps == {"joints.left": True, "joints.right": False, "joints.again": False}
    assert "where joint 'right', joint 'again' are satisfied, the gap is 0.5 m" in str(caught.value)

    both = PINS + "  near: {type: revolute, between: [bar.A, ground.A]}\n"
    both += "  far: {type: revolute, between: [bar.B, ground.B]}\n"
    bar = "bar: {type: planar, mass: 1, inertia: 0.1, points: {A: [0, 0], B: [0.2, 0]}}"
    both = both.replace("bodies: {", f"bodies: {{{bar}, ")
    with pytest.raises(ModelFileError) as caught:
        mbstab.loads("mbstab: 1\n" + both).eig()
    assert "where joint 'right' is satisfied, the gap is 0.3 m" in str(caught.value)
    assert "where joint 'near' is satisfied, the gap is 0.6 m" in str(caught.value)
