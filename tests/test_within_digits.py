"""Rounded decimals break symmetries: the verdict is that of the decimals, a line tells that of the symmetric scene."""

import json
import random

import pytest
from click.testing import CliRunner

import mbstab
from mbstab.analysis.verdict.rule import ASYMPTOTIC, ASYMPTOTIC_UP_TO, MARGINAL, STABLE_UP_TO, UNSTABLE
from mbstab.cli.main import main
from mbstab.model.literals import rounded_literals, with_literals

# What should be equal stands as %s.
TOP = """
mbstab: 1
gravity: [0, 0, -9.81]
bodies: {a: {type: spatial, mass: 1, inertia: [%s, %s, 0.2], center_of_mass: [0, 0, -0.5], points: {top: 0}}}
joints: {j: {type: spherical, between: [a.top, ground]}}
reference: {rates: {a: {phi: 0, theta: 0, psi: 10}}, coordinates: {a: {phi: 0, theta: 0, psi: 0}}}
"""
SHIFT = """
mbstab: 1
bodies: {a: {type: planar_point, mass: 1}, b: {type: planar_point, mass: 2}}
forces:
  f:
    type: expression
    on:
      a.x: -%s*a.x + %s*b.x - (a.x - b.x) - rate(a.x) + rate(b.x)
      b.x: a.x - b.x + rate(a.x) - rate(b.x)
  g: {type: expression, on: {a.y: -a.y - rate(a.y), b.y: -b.y - rate(b.y)}}
reference: {coordinates: {a: {x: 0, y: 0}, b: {x: 0, y: 0}}}
"""
HAT = """
mbstab: 1
bodies: {p: {type: planar_point, mass: 1}}
forces:
  k:
    type: expression
    on:
      p.x: p.x*(1 - %s*(p.x**2 + p.y**2)) - rate(p.x)
      p.y: p.y*(1 - %s*(p.x**2 + p.y**2)) - rate(p.y)
reference: {find: equilibrium, guess: {p: {x: 1.7, y: 0}}}
"""
BEARING = """
mbstab: 1
bodies: {rotor: {type: spatial, mass: 1, inertia: [0.01, 0.01, 0.02]}}
forces:
  b: {type: rotor_bearing, between: [rotor, ground], kxx: 1e3*%s, kyy: 1e3*%s, cxx: 1.5, cyy: 1.5}
  e: {type: expression, on: {rotor.z: -100*rotor.z - rate(rotor.z)}}
reference:
  rates: {rotor: {x: 0, y: 0, z: 0, phi: 0, theta: 0, psi: 30}}
  coordinates: {rotor: {x: 0, y: 0, z: 0, phi: 0, theta: 0, psi: 0}}
"""
SCENES = {"top": TOP, "shift": SHIFT, "hat": HAT, "bearing": BEARING}


def written(text, *numbers):
    """Return a scene with numbers by turns."""
    count = text.count("%s")
    return text % tuple((numbers * count)[:count])


@pytest.mark.parametrize(
    ("name", "numbers", "verdict", "if_exact", "about"),
    [
        ("top", ("0.12345", "0.12346"), MARGINAL, STABLE_UP_TO, "a.psi"),
        ("shift", ("0.3333", "0.33333"), UNSTABLE, ASYMPTOTIC_UP_TO, "translation along x"),
        ("shift", ("0.3333333333333333", "0.33333"), ASYMPTOTIC, ASYMPTOTIC_UP_TO, "translation along x"),
        ("hat", ("0.3333", "0.33333"), ASYMPTOTIC, ASYMPTOTIC_UP_TO, "rotation in the plane"),
        ("hat", ("0.33333", "0.3333"), UNSTABLE, ASYMPTOTIC_UP_TO, "rotation in the plane"),
    ],
)
def test_the_verdict_is_that_of_the_decimals_and_a_line_tells_that_of_the_symmetric_scene(
    name, numbers, verdict, if_exact, about
):
    found = mbstab.loads(written(SCENES[name], *numbers)).eig()
    assert found.verdict == verdict
    assert found.if_symmetric.verdict == if_exact
    assert about in found.if_symmetric.about
    line = f"symmetric within the digits of the file: {', '.join(found.if_symmetric.about)}; if exact: {if_exact}"
    assert line in " ".join(str(found).split())


@pytest.mark.few(4)
@pytest.mark.parametrize("seed", range(24))
def test_one_number_rounded_twice_gives_the_verdict_of_the_number(seed):
    r = random.Random(seed)
    text, decimals = SCENES[sorted(SCENES)[seed % 4]], "".join(r.choices("1234", k=14))
    digits = r.sample(range(4, 15), 2)
    found = mbstab.loads(written(text, *(f"0.{decimals[:d]}" for d in digits))).eig()
    assert found.if_symmetric.verdict == mbstab.loads(written(text, f"0.{decimals}")).eig().verdict


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize(
    "numbers",
    [("0.12345",), ("0.12345", "0.12349"), ("0.123", "0.124"), ("0.12345678", "0.12346678"), ("1/3", "1/2")],
    ids=str,
)
def test_nothing_is_said_where_nothing_is_broken_or_decimals_differ_by_more(name, numbers):
    assert mbstab.loads(written(SCENES[name], *numbers)).eig().if_symmetric is None


def test_the_line_stands_in_every_answer_about_a_point_and_satisfies_no_requirement(tmp_path):
    path = tmp_path / "top.yaml"
    path.write_text(written(TOP, "0.12345", "0.12346"), encoding="utf-8")
    expected = {"about": ["a.psi"], "verdict": STABLE_UP_TO}
    for options in ([], ["--precision", "30"], ["--certify"]):
        answer = CliRunner().invoke(main, ["eig", str(path), *options, "--format", "json"])
        assert json.loads(answer.stdout)["if_symmetric"] == expected
        text = CliRunner().invoke(main, ["eig", str(path), *options]).stdout
        assert "symmetric within the digits of the file: a.psi; if exact: stable up to symmetry" in text
    assert CliRunner().invoke(main, ["eig", str(path), "--require", "stable"]).exit_code == 3
    assert CliRunner().invoke(main, ["eig", str(path), "--require", "marginal"]).exit_code == 0


def test_the_decimals_that_count_as_rounded():
    text = """
mbstab: 1
parameters: {k: 1000.25, m: 12, c: 0.50, d: 1.234e-3}
tables: {load: {x: [0, 1, 2], y: [0.12345, 0.2, 0.6]}}
bodies: {a: {type: planar_point, mass: m}}
forces: {f: {type: expression, on: {a.x: "-k*a.x - 0.7071*a.x**3.0001 - load(a.x)*c*0 - d*0.7071"}}}
reference: {coordinates: {a: {x: 0.123456, y: 0}}}
""".replace("load(a.x)", "table(a.x, load)")
    model = mbstab.loads(text).model
    assert rounded_literals(model) == pytest.approx({"1000.25": 1e-2, "1.234e-3": 1e-6, "0.7071": 1e-4})
    moved = with_literals(model, {"0.7071": "0.70712", "1000.25": "1000.2"})
    assert rounded_literals(moved) == pytest.approx({"1000.2": 1e-1, "1.234e-3": 1e-6, "0.70712": 1e-5})
    assert moved.reference is model.reference


def test_settings_are_not_rounded():
    top = mbstab.loads(written(TOP, "A", "B").replace("mbstab: 1", "mbstab: 1\nparameters: {A: 1, B: 1}"))
    assert top.eig(A=0.12341, B=0.1234).if_symmetric is None
    assert mbstab.loads(written(TOP, "0.12341", "0.1234")).eig().if_symmetric is not None
