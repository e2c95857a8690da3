"""Crossings of frequencies with orders of the spin, against closed forms of a rigid rotor on two bearings."""

import json
from dataclasses import replace

import numpy as np
import pytest
from test_cli import run

import mbstab
from mbstab.analysis.sweep import orders
from mbstab.errors import UsageError

MASS, TRANSVERSE, POLAR, HALF = 122.679193122681426, 2.86251450619589994, 0.61339596561340713, 0.25
ROTOR = f"""mbstab: 1
title: Rigid rotor on two bearings
parameters:
  Omega: {{value: 300, unit: rad/s}}
  k_1: {{value: 1.0e6, unit: N/m}}
  k_2: {{value: 1.3e6, unit: N/m}}
  c: {{value: 0, unit: N*s/m}}
bodies:
  rotor:
    type: spatial
    mass: {MASS}
    inertia: [{TRANSVERSE}, {TRANSVERSE}, {POLAR}]
    points: {{A: [0, 0, {HALF}], B: [0, 0, -{HALF}]}}
forces:
  upper: {{type: bearing, between: [rotor.A, {{body: ground, point: [0, 0, {HALF}]}}], stiffness: k_1, damping: c}}
  lower: {{type: bearing, between: [rotor.B, {{body: ground, point: [0, 0, -{HALF}]}}], stiffness: k_2, damping: c}}
constraints: {{axial: {{holonomic: rotor.z}}}}
outputs: {{x: rotor.x, y: rotor.y, tilt: rotor.theta}}
reference:
  coordinates: {{rotor: {{x: 0, y: 0, z: 0, phi: 0, theta: 0, psi: 0}}}}
  rates: {{rotor: {{x: 0, y: 0, z: 0, phi: 0, theta: 0, psi: Omega}}}}
"""


def critical_speed(order, sense, k_1=1e6, k_2=1.3e6):
    """Return the speeds at which forward (+1) or backward (-1) whirl has this order: a quadratic in Ω²."""
    k, c, h = k_1 + k_2, (k_1 - k_2) * HALF, (k_1 + k_2) * HALF**2
    # (k - m n²Ω²)(h - (I_d n² ∓ I_p n) Ω²) = c²
    turning = TRANSVERSE * order**2 - sense * POLAR * order
    roots = np.roots([MASS * order**2 * turning, -(k * turning + h * MASS * order**2), k * h - c * c])
    return sorted(np.sqrt(roots))


def test_critical_speeds_and_orders_of_a_rigid_rotor():
    found = mbstab.loads(ROTOR).sweep("Omega", np.linspace(0.0, 400.0, 41), orders=(1.0, 2.0, 3.0))
    expected = [
        (speed, order, word)
        for order in (1, 2, 3)
        for word, sense in (("forward", 1), ("backward", -1))
        for speed in critical_speed(order, sense)
    ]
    assert [(c.order, c.whirl) for c in found.crossings] == [x[1:] for x in sorted(expected)]
    np.testing.assert_allclose([c.value for c in found.crossings], [x[0] for x in sorted(expected)], rtol=1e-11)
    for c in found.crossings:
        assert abs(c.frequency - c.order * c.value) <= 1e-10 * c.frequency
    # Friswell, Penny, Garvey and Lees (2010), example 3.5.1 with these bearings.
    first = [c.value for c in found.crossings if c.order == 1]
    known = [134.829299181393875, 135.281713243235735, 204.75648095431793, 253.694444835764111]
    np.testing.assert_allclose(first, known, rtol=1e-11)


def test_branches_tell_the_sense_of_their_whirl():
    """Both motions of a pair have it, and forward whirl has the higher frequency."""
    found = mbstab.loads(ROTOR).sweep("Omega", np.linspace(50.0, 400.0, 15), orders=(1.0,))
    last = found.branches[-1]
    assert sorted(found.whirls) == 4 * ["backward"] + 4 * ["forward"]
    for j, s in enumerate(last):
        assert found.whirls[int(np.argmin(np.abs(last - np.conj(s))))] == found.whirls[j]
    highest = int(np.argmax(last.imag))
    assert found.whirls[highest] == "forward"
    assert mbstab.loads(ROTOR).sweep("Omega", np.array([50.0, 60.0])).whirls == ()


def test_a_whirl_that_changes_its_sense_is_told():
    """Also where only a crossing shows it, on both branches of its pair."""
    found = mbstab.loads(ROTOR).sweep("Omega", np.linspace(50.0, 400.0, 15), orders=(1.0,))
    changed = replace(
        found.crossings[0], whirl={"forward": "backward", "backward": "forward"}[found.crossings[0].whirl]
    )
    search = orders._Search(mbstab.loads(ROTOR).model, found)
    told = replace(found, senses=search.senses([changed])).whirls
    pair = [j for j, (one, other) in enumerate(zip(told, found.whirls, strict=True)) if one != other]
    assert [told[j] for j in pair] == ["changing", "changing"]
    assert changed.branch in pair


UNEQUAL = """mbstab: 1
title: Rotor on bearings of unequal stiffness
parameters:
  Omega: {value: 300, unit: rad/s}
bodies:
  rotor:
    type: spatial
    mass: 50
    inertia: [1.2, 1.2, 2.0]
    points: {A: [0, 0, 0.3], B: [0, 0, -0.3]}
ground: {points: {A: [0, 0, 0.3], B: [0, 0, -0.3]}}
forces:
  upper: {type: rotor_bearing, between: [rotor.A, ground.A], kxx: 8e6, kyy: 7e6, cxx: 50, cyy: 50}
  lower: {type: rotor_bearing, between: [rotor.B, ground.B], kxx: 8.8e6, kyy: 6.6e6, cxx: 50, cyy: 50}
constraints: {axial: {holonomic: rotor.z}}
reference:
  coordinates: {rotor: {x: 0, y: 0, z: 0, phi: 0, theta: 0, psi: 0}}
  rates: {rotor: {x: 0, y: 0, z: 0, phi: 0, theta: 0, psi: Omega}}
"""


@pytest.mark.few(1)
@pytest.mark.parametrize("points", [4, 6, 9, 41])
def test_where_whirl_changes_its_sense_does_not_depend_on_the_points(points):
    """The backward conical mode falls past both cylindrical ones, which avoid it and take its sense over.

    Near the changes single answers tell it; between the points no curve is interrupted.
    """
    model = mbstab.loads(UNEQUAL)
    speeds = np.linspace(100.0, 20000.0, points) * np.pi / 30.0
    found = model.sweep("Omega", speeds, orders=(1.0,), detail=True)
    (lowest,) = (parts for parts, s in zip(found.senses, found.branches[-1], strict=True) if 0 < s.imag < 320)
    assert [word for *_, word in lowest] == ["mixed", "forward", "mixed", "backward"]
    np.testing.assert_allclose([end for _, end, _ in lowest[:-1]], np.array([7345, 8135, 8765]) * np.pi / 30, rtol=5e-3)
    for begin, end, word in lowest:
        answer = model.eig(Omega=begin + 0.9 * (end - begin))
        assert min((e for e in answer.eigenvalues if e.value.imag > 0), key=lambda e: e.value.imag).whirl == word
    assert not np.any(np.isnan(found.detail.branches))


def test_a_campbell_diagram_ends_at_a_frequency_that_is_given(tmp_path):
    path = tmp_path / "rotor.yaml"
    path.write_text(ROTOR, encoding="utf-8")
    arguments = ("sweep", str(path), "--param", "Omega", "--from", "100", "--to", "300", "--points", "5")
    drawn = (*arguments, "--plot", "campbell", "--pictures", str(tmp_path / "a.svg"), "--max-frequency")
    assert run(*drawn, "25").exit_code == 0
    text = (tmp_path / "a-campbell.svg").read_text(encoding="utf-8")
    assert "backward whirl" in text
    data = json.loads(run(*arguments, "--orders", "1", "--format", "json").stdout)
    assert set(data["whirls"]) == {"forward", "backward"}
    assert "the lowest frequency is 21.39" in run(*drawn, "5").stderr
    for wrong in ((*drawn, "0"), (*arguments, "--plot", "map", "--max-frequency", "3")):
        assert "goes with --plot campbell" in run(*wrong).stderr


def test_a_sweep_without_any_answer_draws_nothing(tmp_path):
    path = tmp_path / "rotor.yaml"
    path.write_text(
        ROTOR.replace("{value: 0, unit: N*s/m}", "{value: sqrt(-k_1**2/Omega**2), unit: N*s/m}"), encoding="utf-8"
    )
    arguments = ("sweep", str(path), "--param", "Omega", "--from", "100", "--to", "300", "--points", "5")
    result = run(*arguments, "--plot", "map", "--pictures", str(tmp_path / "a.svg"))
    assert result.exit_code
    assert "5 of 5 points have no answer" in result.stderr
    assert "the others" not in result.stderr
    assert not list(tmp_path.glob("*.svg"))


def test_speeds_that_fall_and_names_of_modes():
    named = ROTOR + "modes: {bounce: {near: 135i, at: {Omega: 300, k_2: 1.0e6}}}\n"
    down = mbstab.loads(named).sweep("Omega", np.linspace(400.0, 50.0, 36), orders=(1.0,))
    np.testing.assert_allclose(down.crossings[-1].value, 253.694444835764111, rtol=1e-11)
    assert down.crossings[0].motions


def test_the_command_lists_and_draws_crossings(tmp_path):
    path = tmp_path / "rotor.yaml"
    path.write_text(ROTOR, encoding="utf-8")
    arguments = ("sweep", str(path), "--param", "Omega", "--from", "100", "--to", "300", "--points", "21")
    result = run(*arguments, "--plot", "campbell", "--pictures", str(tmp_path / "a.svg"))
    assert result.exit_code == 0
    assert "135.281713243" in result.stdout  # the first order, as none is given
    assert (tmp_path / "a-campbell.svg").stat().st_size > 5000
    data = json.loads(run(*arguments, "--orders", "1,0.5", "--format", "json", "--plot", "none").stdout)
    assert data["orders"] == [1.0, 0.5]
    assert {c["whirl"] for c in data["crossings"]} == {"forward", "backward"}
    assert data["crossings"][0]["motions"][0]["magnitude"] == 1.0
    assert (
        "no frequency crosses the orders 9, as far as 21 points show"
        in run(*arguments, "--orders", "9", "--plot", "none").stdout
    )


MEETING = """mbstab: 1
parameters:
  n: {value: 1000, unit: rad/s}
  n1: {value: 1030, unit: rad/s}
  n2: {value: 1060, unit: rad/s}
  m: {value: 1, unit: kg}
  k: {value: "m*(n**2 + 0.5*(n - n1)*(n - n2))", unit: N/m}
bodies: {r: {type: planar, mass: m, inertia: 1}}
forces: {b: {type: rotor_bearing, between: [r, ground], kxx: k, kyy: 4*k, cxx: 0.02, cyy: 0.02}}
outputs: {x: r.x}
reference: {coordinates: {r: {x: 0, y: 0, theta: 0}}, rates: {r: {theta: n}}}
"""


@pytest.mark.parametrize(("n1", "n2"), [(1030, 1060), (1031, 1033), (520, 540)])
@pytest.mark.parametrize("order", [1, 2])
def test_a_frequency_that_crosses_an_order_twice_between_two_points_is_found(n1, n2, order):
    """Im λ = sqrt(k - 0.01²) along x, twice that along y."""
    for x in (np.linspace(500.0, 1500.0, 11), np.linspace(1500.0, 500.0, 11)):
        found = mbstab.loads(MEETING).at(n1=n1, n2=n2).sweep("n", x, orders=(order,))
        roots = np.sort(np.roots([0.5, -0.5 * (n1 + n2), 0.5 * n1 * n2 - 0.01**2 / order**2]))
        np.testing.assert_allclose([c.value for c in found.crossings], roots, rtol=1e-9)
        assert not [text for text in found.warnings if "crossing" in text]


def test_a_frequency_that_begins_between_two_points_crosses_an_order_there():
    """λ² + 350 λ + 4 n² = 0: overdamped up to 87.5 rad/s, Im λ = n at sqrt(175²/3)."""
    text = MEETING.replace(
        "b: {type: rotor_bearing, between: [r, ground], kxx: k, kyy: 4*k, cxx: 0.02, cyy: 0.02}",
        'b: {type: expression, on: {r.x: "-4*m*n**2*r.x - 350*rate(r.x)", r.y: "-4*m*n**2*r.y - 4*m*n*rate(r.y)"}}',
    )
    for start in (50.0, 80.0, 87.5):
        crossings = mbstab.loads(text).sweep("n", np.linspace(start, 550.0, 6), orders=(1.0,)).crossings
        assert [c.value for c in crossings] == pytest.approx([175.0 / 3**0.5], rel=1e-11)


@pytest.mark.parametrize(
    ("parameter", "orders", "message"), [("k_1", (1.0,), "has the unit N/m"), ("Omega", (-1.0,), "positive numbers")]
)
def test_wrong_questions_are_refused(parameter, orders, message):
    with pytest.raises(UsageError, match=message):
        mbstab.loads(ROTOR).sweep(parameter, np.linspace(1e6, 2e6, 3), orders=orders)


ABSORBER = """
mbstab: 1
parameters: {n: {value: 100, unit: rad/s}}
bodies:
  wheel: {type: planar, mass: 10, inertia: 1, points: {p: [0.12, 0]}}
  pen: {type: planar, mass: 1, inertia: 0, points: {h: [-0.03, 0]}}
joints:
  hub: {type: revolute, between: [wheel, ground]}
  h: {type: revolute, between: [pen.h, wheel.p]}
drives: {speed: {type: joint, joint: hub, position: n*t}}
reference:
  coordinates: {wheel: {theta: 0}, pen: {theta: 0}}
  steady: {axis: z, rate: n}
"""


def test_an_order_on_which_a_branch_lies_is_told():
    """A pendulum in a turning wheel has a frequency of sqrt(0.12/0.03) = 2 times its spin at every speed."""
    found = mbstab.loads(ABSORBER).sweep("n", np.linspace(10.0, 100.0, 10), orders=[1, 2, 3])
    assert not found.crossings
    (told,) = [x for x in found.warnings if "line" in x]
    assert "the frequency of branch 1 is 2 times n at all points" in told
