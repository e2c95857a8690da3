"""Derivatives of critical values by parameters, against closed forms and against critical values computed again."""

import csv
import json
import math

import numpy as np
import pytest
from click.testing import CliRunner
from sampling import sample

from mbstab import load, loads
from mbstab.cli import main


def swept(mechanism, parameter, first, last, points=9):
    return mechanism.sweep(parameter, np.linspace(first, last, points), sensitivity=True).critical


def assert_slopes(c, expected, tolerance):
    """Compare derivatives and their error estimates."""
    found = dict(zip(c.slopes.names, zip(c.slopes.slopes, c.slopes.errors, strict=True), strict=True))
    for name, exact in expected.items():
        slope, error = found[name]
        assert abs(slope - exact) <= tolerance * abs(exact)
        assert abs(slope - exact) <= 10.0 * error + 1e-14 * abs(exact)  # the estimate is no fiction
        assert error <= 1e-5 * abs(exact)  # nor is it useless


def test_flutter_of_a_column():
    (c,) = swept(load("ziegler_column.yaml"), "P", 0.5, 2.0)
    b_1, b_2 = 0.1, 0.2
    # Where k, l and m are 1: P = (k/l) (4 b**2 + 33 b + 4)/(2 (b**2 + 7 b + 6)) + b_1 b_2/(2 m l**3) with b = b_1/b_2.
    b = b_1 / b_2
    over, under = 4 * b**2 + 33 * b + 4, 2 * (b**2 + 7 * b + 6)
    moved = ((8 * b + 33) * under - over * (4 * b + 14)) / under**2
    expected = {
        "k": over / under,
        "l": -over / under - 3 * b_1 * b_2 / 2,
        "m": -b_1 * b_2 / 2,
        "b_1": moved / b_2 + b_2 / 2,
        "b_2": -moved * b / b_2 + b_1 / 2,
    }
    assert_slopes(c, expected, 1e-10)


def test_shimmy_at_both_ends_of_its_range():
    low, high = swept(load("shimmy.yaml"), "a", 0.1, 0.9)
    root = math.sqrt(1.0 - 4.0 * 0.21)  # a = (l ± sqrt(l**2 - 4 I/m))/2
    for c, sign in ((low, -1.0), (high, 1.0)):
        expected = {"l": 0.5 * (1.0 + sign / root), "I": -sign / root, "m": sign * 0.21 / root}
        assert_slopes(c, expected, 1e-10)
        k, u = (c.slopes.names.index(name) for name in ("k", "u"))
        assert abs(c.slopes.slopes[k]) <= 10.0 * c.slopes.errors[k] < 1e-10  # it is critical at any speed
        assert abs(c.slopes.slopes[u]) <= 10.0 * c.slopes.errors[u] < 1e-10


def test_the_collision_of_a_sleeping_top():
    (c,) = swept(load("top.yaml"), "omega", 4.0, 8.0)
    assert c.kind == "collision"
    about = 3e-4 + 0.01 * 0.04**2  # omega = 2 sqrt((I_x + m H**2) m g H)/I_z
    omega = 2.0 * math.sqrt(about * 0.01 * 9.81 * 0.04) / 4e-4
    expected = {
        "I_z": -omega / 4e-4,
        "I_x": omega / (2 * about),
        "g": omega / (2 * 9.81),
        "m": omega * (0.04**2 / (2 * about) + 1 / (2 * 0.01)),
        "H": omega * (0.01 * 0.04 / about + 1 / (2 * 0.04)),
    }
    assert_slopes(c, expected, 1e-9)


STANDING = """
mbstab: 1
parameters: {m: 2.0, l: 0.5, g: 9.81, k: 12.0, c: 0.3, m_c: 4.0}
gravity: [0, -g]
bodies:
  cart: {type: planar, mass: m_c, inertia: 1}
  rod: {type: planar, mass: m, inertia: 0.01, points: {O: [0, -l]}}
joints:
  rail: {type: prismatic, between: [cart, ground], axis: [1, 0]}
  hinge: {type: revolute, between: [rod.O, cart]}
forces:
  spring: {type: expression, on: {rod.theta: -k*rod.theta - c*rate(rod.theta)}}
reference:
  coordinates: {cart: {x: 0, y: 0, theta: 0}, rod: {x: 0, y: l, theta: 0}}
"""


@pytest.mark.parametrize("damping", sample([0.3, 0.0], 2))
def test_a_zero_eigenvalue_beside_neutral_ones(damping):
    """An upright rod on a free cart: k = m g l, where one eigenvalue passes zero, or a pair turns real."""
    (c,) = swept(loads(STANDING).at(c=damping), "k", 5.0, 15.0)
    assert c.kind == "divergence"
    assert c.value == pytest.approx(9.81, rel=1e-9)
    assert_slopes(c, {"m": 9.81 * 0.5, "g": 1.0, "l": 2.0 * 9.81}, 1e-8)
    for name in ("m_c", "c"):
        k = c.slopes.names.index(name)
        assert abs(c.slopes.slopes[k]) <= 10.0 * c.slopes.errors[k] < 1e-5


def test_weave_and_capsize_of_the_bicycle():
    """Lengths of all kinds scale: v is as sqrt(g L); and g against critical speeds computed again."""
    bicycle = load("whipple_bicycle.yaml")
    weave, capsize = swept(bicycle, "v", 4.0, 6.5)
    assert (weave.kind, capsize.kind) == ("flutter", "divergence")
    assert_slopes(weave, {"g": weave.value / (2 * 9.81)}, 1e-11)
    assert_slopes(capsize, {"g": capsize.value / (2 * 9.81)}, 1e-8)


@pytest.mark.long
def test_the_bicycle_against_critical_speeds_computed_again():
    bicycle = load("whipple_bicycle.yaml")
    weave, capsize = swept(bicycle, "v", 4.0, 6.5)
    for name in ("c", "z_B"):
        at, h = bicycle.parameters()[name], 1e-2
        near = [
            [x.value for x in bicycle.sweep("v", np.linspace(4.0, 6.5, 9), **{name: at * (1 + n * h)}).critical]
            for n in (-3, -2, -1, 1, 2, 3)
        ]
        exact = np.array([-1, 9, -45, 45, -9, 1]) @ np.array(near) / (60 * h * at)
        for c, difference, tolerance in ((weave, exact[0], 1e-8), (capsize, exact[1], 1e-6)):
            assert c.slopes.slopes[c.slopes.names.index(name)] == pytest.approx(difference, rel=tolerance)


@pytest.mark.parametrize(
    ("model", "parameter", "ends", "reason"),
    sample(
        [
            ("bead_on_hoop.yaml", "Omega", (1.0, 8.0), "other equilibria branch off"),
            ("von_mises_truss.yaml", "P", (-10.0, 10.0), "the path of equilibria turns back"),
        ],
        2,
    ),
)
def test_where_there_is_no_derivative_the_reason_is_said(model, parameter, ends, reason):
    (c,) = swept(load(model), parameter, *ends)
    assert reason in c.slopes.missing
    assert not c.slopes.names


def test_two_that_pass_together_are_not_differentiated():
    text = """
mbstab: 1
parameters: {k: 1.0}
bodies:
  a: {type: planar, mass: 1, inertia: 1}
forces:
  spring: {type: expression, on: {a.x: -k*a.x - rate(a.x), a.y: -k*a.y - rate(a.y), a.theta: -a.theta}}
"""
    (c,) = swept(loads(text), "k", -1.0, 1.5)
    assert "together" in c.slopes.missing


def test_the_command_prints_what_moves_a_critical_value_most_first():
    arguments = ["sweep", "top.yaml", "--param", "omega", "--from", "4", "--to", "8", "--points", "11", "--sensitivity"]
    run = CliRunner().invoke(main, [*arguments, "--plot", "none"], catch_exceptions=False)
    assert run.exit_code == 0, run.output
    lines = run.stdout.rstrip().splitlines()
    assert "omega = 5.567728442 rad/s, collision" in lines
    assert [line.split()[0] for line in lines[-5:]] == ["I_z", "H", "m", "g", "I_x"]
    run = CliRunner().invoke(main, [*arguments, "--format", "csv"], catch_exceptions=False)
    rows = {row["parameter"]: row for row in csv.DictReader(run.stdout.splitlines())}
    assert float(rows["g"]["derivative"]) == pytest.approx(5.567728441644 / (2 * 9.81), rel=1e-9)
    run = CliRunner().invoke(main, [*arguments, "--format", "json"], catch_exceptions=False)
    (item,) = json.loads(run.stdout)["sensitivity"]
    assert item["derivatives"]["g"]["percent"] == pytest.approx(0.01 * 5.567728441644 / 2, rel=1e-9)
    assert next(iter(item["derivatives"])) == "I_z"


def test_derivatives_are_in_the_declared_units_of_both_parameters():
    text = STANDING.replace("l: 0.5,", "l: {value: 500, unit: mm},").replace("k: 12.0", "k: {value: 12, unit: N*m}")
    arguments = ["sweep", "-", "--param", "k", "--from", "5", "--to", "15", "--points", "9", "--sensitivity"]
    run = CliRunner().invoke(main, [*arguments, "--format", "json"], input=text, catch_exceptions=False)
    (item,) = json.loads(run.stdout)["sensitivity"]
    assert item["derivatives"]["l"]["derivative"] == pytest.approx(2.0 * 9.81e-3, rel=1e-8)


def test_options_that_contradict_are_refused():
    run = CliRunner().invoke(main, ["sweep", "top.yaml", "--param", "omega", "--param", "H", "--sensitivity"])
    assert run.exit_code == 2
    assert "--sensitivity goes with one parameter" in run.output
