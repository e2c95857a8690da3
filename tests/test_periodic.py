"""Stability of periodic motions by ``eig``: against Hill's equation integrated here, and closed forms."""

import cmath
import itertools
import json
import math

import numpy as np
import pytest
import scipy.linalg
from click.testing import CliRunner
from sampling import sample
from scipy.integrate import solve_ivp
from zoo import SYSTEMS

import mbstab
from mbstab.analysis.verdict.multipliers import enclosed, placed
from mbstab.analysis.verdict.rule import STRENGTH, UNDECIDED
from mbstab.cli import main
from mbstab.errors import ModelFileError, UsageError
from mbstab.model.library import installed_models

MODELS = {path.stem: path for path in installed_models()}
G = 9.81


def multipliers(stiffness, period, damping=0.0):
    """Return the multipliers of θ̈ + damping θ̇ + stiffness(t) θ = 0, the larger first."""

    def slope(t, x):
        return [x[1], -stiffness(t) * x[0] - damping * x[1], x[3], -stiffness(t) * x[2] - damping * x[3]]

    end = solve_ivp(slope, (0.0, period), [1.0, 0.0, 0.0, 1.0], "DOP853", rtol=3e-14, atol=1e-15).y[:, -1]
    trace, determinant = end[0] + end[3], math.exp(-damping * period)
    root = cmath.sqrt(trace * trace / 4.0 - determinant)
    return sorted((trace / 2.0 + root, trace / 2.0 - root), key=lambda mu: (-abs(mu), -mu.imag))


def judged(model, **parameters):
    """Return the answer, and its multipliers that are not neutral, the larger first."""
    result = model.eig(**parameters)
    found = [e.multiplier for e in result.eigenvalues if e.kind != "neutral"]
    return result, sorted(found, key=lambda mu: (-abs(mu), -mu.imag))


# --- Kapitza's pendulum ---------------------------------------------------------------------------------------------


def kapitza(nu):
    L, A = 0.15, 0.02
    return multipliers(lambda t: -3.0 * (G - A * nu**2 * math.cos(nu * t)) / (4.0 * L), 2.0 * math.pi / nu)


@pytest.mark.parametrize("nu", [60, 95, 110, 150, 200, 400])
def test_the_upright_pendulum_has_the_multipliers_of_hills_equation(nu):
    model = mbstab.load(MODELS["kapitza"])
    expected = kapitza(nu)
    result, found = judged(model, nu=nu)
    np.testing.assert_allclose(found, expected, rtol=1e-9)
    period = 2.0 * math.pi / nu
    assert result.period == period
    assert result.method == "floquet"
    bounds = [e.error_bound for e in result.eigenvalues]
    for e in result.eigenvalues:
        assert abs(cmath.exp(e.value * period) - e.multiplier) < 1e-12
        exact = min(expected, key=lambda mu: abs(mu - e.multiplier))
        assert abs(e.value - cmath.log(exact) / period) <= max(bounds) + 1e-9
    stable = all(abs(abs(mu) - 1.0) < 1e-6 for mu in expected)
    assert result.verdict == ("marginally stable" if stable else "unstable")


def test_both_verdicts_are_met():
    model = mbstab.load(MODELS["kapitza"])
    # The pendulum stands where A ν > sqrt(2 g l) with the reduced length l = 4 L/3.
    limit = math.sqrt(2.0 * G * 0.2) / 0.02
    assert judged(model, nu=0.9 * limit)[0].verdict == "unstable"
    assert judged(model, nu=1.1 * limit)[0].verdict == "marginally stable"


PARAMETRIC = """\
mbstab: 1
parameters: {{w0: 1, h: 0.3, w: 2, d: 0, T: 2*pi/w}}
bodies:
  p: {{type: planar_point, mass: 1}}
joints:
  line: {{type: point_on_line, between: [ground, p], axis: x}}
forces:
  pull: {{type: expression, on: {{p.x: -w0**2*(1 + h*cos(w*t))*p.x - d*rate(p.x)}}}}
{more}
reference:
  period: {period}
  coordinates: {{p: {{x: 0, y: 0}}}}
  rates: {{p: {{x: 0, y: 0}}}}
"""


def parametric(period="T", more=""):
    return mbstab.loads(PARAMETRIC.format(period=period, more=more), "model.yaml")


def test_period_doubling_has_a_negative_multiplier():
    # Excited at twice the own frequency: what grows has twice the period.
    expected = multipliers(lambda t: 1.0 + 0.3 * math.cos(2.0 * t), math.pi)
    assert expected[0].real < -1.2
    assert max(abs(mu.imag) for mu in expected) == 0.0
    result, found = judged(parametric())
    np.testing.assert_allclose(found, expected, rtol=1e-10)
    assert result.verdict == "unstable"
    assert "multiplier -1.2" in result.reasons[0]
    worst = max(result.eigenvalues, key=lambda e: e.value.real)
    assert abs(worst.value.real - math.log(abs(expected[0])) / math.pi) < 1e-10
    assert abs(abs(worst.value.imag) - 1.0) < 1e-12  # half of the frequency of the excitation


@pytest.mark.parametrize("damping", [0.01, 0.3])
def test_damping_moves_the_multipliers_inwards(damping):
    expected = multipliers(lambda t: 1.0 + 0.3 * math.cos(2.0 * t), math.pi, damping)
    result, found = judged(parametric(), d=damping)
    np.testing.assert_allclose(found, expected, rtol=1e-9)
    stable = max(abs(mu) for mu in expected) < 1.0
    assert stable == (damping == 0.3)
    assert result.verdict == ("asymptotically stable" if stable else "unstable")


def test_twice_the_period_squares_the_multipliers():
    once, twice = judged(parametric())[1], judged(parametric("2*T"))[1]
    np.testing.assert_allclose(twice, np.square(once), rtol=1e-10)


def test_multipliers_of_constant_coefficients_are_exponentials():
    result, found = judged(parametric("1.3"), h=0, d=0.2)
    s = complex(-0.1, math.sqrt(1.0 - 0.01))
    np.testing.assert_allclose(found[0], cmath.exp(1.3 * s), rtol=1e-11)
    assert result.verdict == "asymptotically stable"


# --- mistakes -------------------------------------------------------------------------------------------------------


def test_a_period_that_is_none_is_refused_at_its_place():
    for factor in ("1.01", "0.5"):
        with pytest.raises(ModelFileError) as caught:
            parametric(f"{factor}*T").eig()
        message = str(caught.value)
        assert message.startswith("model.yaml:10:1: reference: ")
        assert "period" in message


def test_a_motion_that_does_not_repeat_is_refused_by_coordinate_and_difference():
    text = PARAMETRIC.format(period="2.5", more="").replace("p: {x: 0, y: 0}}\n  rates", "p: {x: 0.4, y: 0}}\n  rates")
    with pytest.raises(ModelFileError) as caught:
        mbstab.loads(text, "model.yaml").eig(h=0)
    message = str(caught.value)
    assert "does not repeat after 2.5 s" in message
    assert f"the rate of p.x differs by {-0.4 * math.sin(2.5):.6g} m/s" in message


@pytest.mark.parametrize("method", ["index3", "paper"])
def test_a_period_has_one_method(method):
    with pytest.raises(UsageError) as caught:
        parametric().eig(method)
    assert str(caught.value).startswith(f"--method {method} ")
    result = CliRunner().invoke(main, ["eig", str(MODELS["kapitza"]), "--method", method])
    assert result.exit_code == 2
    assert result.stdout == ""


@pytest.mark.parametrize("period", ["0", "-T", "T - T"])
def test_a_period_must_be_positive(period):
    with pytest.raises(ModelFileError, match="the period must be positive"):
        parametric(period).eig()


# --- multipliers 1 --------------------------------------------------------------------------------------------------


def test_a_coordinate_on_which_nothing_depends_gives_two_multipliers_of_one():
    text = PARAMETRIC.format(period="T", more="").replace(
        "p: {type: planar_point, mass: 1}", "p: {type: planar_point, mass: 1}\n  free: {type: planar_point, mass: 2}"
    )
    text = text.replace("p: {x: 0, y: 0}", "p: {x: 0, y: 0}, free: {x: 0, y: 0}")
    model = mbstab.loads(text)
    result, found = judged(model)
    assert result.counts.neutral == 4  # x, y and their rates
    assert [e.kind for e in result.eigenvalues].count("neutral") == 4
    assert result.verdict == "unstable"
    np.testing.assert_allclose(found, multipliers(lambda t: 1.0 + 0.3 * math.cos(2.0 * t), math.pi), rtol=1e-10)
    # Damped, what is excited decays: the verdict says up to what.
    result = model.eig(d=0.3)
    assert (result.verdict, result.in_place) == ("asymptotically stable up to symmetry", False)
    assert set(result.modulo.symmetries) == {"free.x", "free.y"}
    assert set(result.modulo.family) == {"speed along free.x", "speed along free.y"}


def test_a_free_swing_has_the_multiplier_one_twice():
    # 1.5 θ̈ = −sin θ from 1.2 rad: the period is sqrt(1.5)·4 K(sin 0.6); shifts in time and in energy give a block of 1.
    from scipy.special import ellipk

    amplitude = 1.2
    period = float(math.sqrt(1.5) * 4.0 * ellipk(math.sin(amplitude / 2.0) ** 2))
    text = f"""
mbstab: 1
gravity: [0, -1]
bodies:
  p: {{type: planar, mass: 1, inertia: 0.5, points: {{O: [0, 1]}}}}
joints:
  pivot: {{type: revolute, between: [p.O, ground]}}
reference:
  period: {period!r}
  coordinates: {{p: {{theta: {amplitude}}}}}
  guess: {{p: {{x: {math.sin(amplitude)}, y: {-math.cos(amplitude)}}}}}
  rates: {{p: {{theta: 0}}}}
"""
    result = mbstab.loads(text).eig()
    assert [e.kind for e in result.eigenvalues] == ["neutral", "neutral"]
    assert result.verdict == "stable up to symmetry"
    assert (result.modulo.symmetries, result.modulo.family) == (("the motion itself",), ("energy",))
    assert "goes on growing like t" in result.reasons[0]
    assert result.counts.neutral == 2


def test_the_terminal_and_json_answers_of_a_periodic_motion(tmp_path):
    path = tmp_path / "model.yaml"
    path.write_text(PARAMETRIC.format(period="T", more=""))
    shown = CliRunner().invoke(main, ["eig", str(path)])
    assert shown.exit_code == 0
    assert "multiplier" in shown.stdout
    assert "Verdict: unstable" in shown.stdout
    assert max(map(len, shown.stdout.splitlines())) <= 80
    data = json.loads(CliRunner().invoke(main, ["eig", str(path), "--format", "json"]).stdout)
    assert data["period"] == math.pi
    expected = multipliers(lambda t: 1.0 + 0.3 * math.cos(2.0 * t), math.pi)
    found = sorted(e["multiplier"]["real"] for e in data["eigenvalues"])
    np.testing.assert_allclose(found, sorted(mu.real for mu in expected), rtol=1e-10)


def test_frozen_numbers_of_a_periodic_motion_are_no_verdict():
    result = mbstab.load(MODELS["kapitza"]).eig(frozen=True)
    assert result.frozen
    assert result.verdict == "undecided"
    assert result.period is None
    # At t = 0 the pivot is at its top: θ̈ = m L (g − A ν²)/I_O θ.
    expected = math.sqrt(3.0 * (0.02 * 200.0**2 - G) / 0.6)
    np.testing.assert_allclose(sorted(e.value.imag for e in result.eigenvalues), [-expected, expected], rtol=1e-12)


# --- where multipliers are ------------------------------------------------------------------------------------------

BLOCKS = [
    [1.0, 2.0, -0.5],
    [(1.0, 2), 0.3],
    [(-1.0, 2), 1.0],
    [(0.5, 3), (0.5, 1), -2.0],
    [(1.0, 2), (1.0, 2)],
    [1.0, 1.0 + 1e-9],
    [0.0, 0.0, 3.0],
]


@pytest.mark.parametrize("blocks", BLOCKS, ids=str)
@pytest.mark.parametrize("error", [1e-12, 1e-7])
def test_discs_hold_as_many_multipliers_as_they_say_whatever_the_error(blocks, error):
    blocks = [b if isinstance(b, tuple) else (b, 1) for b in blocks]
    A = scipy.linalg.block_diag(*(value * np.eye(n) + np.eye(n, k=1) for value, n in blocks))
    rng = np.random.default_rng(7)
    T = rng.normal(size=A.shape)
    A = T @ A @ np.linalg.inv(T)
    _, discs = enclosed(A, error)
    assert sum(len(d.members) for d in discs) == len(A)
    for one, other in itertools.combinations(discs, 2):
        assert abs(one.centre - other.centre) > one.radius + other.radius
    for _ in range(50):
        E = rng.normal(size=A.shape)
        found = np.linalg.eigvals(A + error * E / np.linalg.norm(E, 2))
        for d in discs:
            assert np.sum(np.abs(found - d.centre) <= d.radius) == len(d.members)


def test_turned_pairs_are_told_apart_and_equal_ones_are_not():
    def turn(angle):
        return np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])

    for angles, counts in (((0.3, 0.5), [1, 1, 1, 1]), ((0.3, 0.3), [2, 2])):
        _, discs = enclosed(scipy.linalg.block_diag(*map(turn, angles)), 1e-12)
        assert sorted(len(d.members) for d in discs) == counts
        sides = {d.side for d in placed(discs, 1.0, "a structure")}
        assert sides == ({"axis"} if counts[0] == 1 else {"open"})
        assert {d.side for d in placed(discs, 1.0, "")} == {"open"}


@pytest.mark.parametrize("value", [1.0, -1.0])
def test_one_and_minus_one_are_never_held_on_the_circle(value):
    _, discs = enclosed(np.array([[value]]), 1e-12)
    assert placed(discs, 1.0, "a structure")[0].side == "open"


@pytest.mark.parametrize(
    ("A", "error"), [(np.diag([0.1, 0.2]), math.inf), (np.diag([0.1, 0.2]), math.nan), (np.diag([0.1, math.nan]), 1e-9)]
)
def test_what_is_not_a_number_is_placed_nowhere(A, error):
    _, discs = enclosed(A, error)
    (disc,) = placed(discs, 1.0, "a structure")
    assert (disc.side, disc.count) == ("open", 2)


# --- the verdict ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("system", sample([s for s in SYSTEMS if "precise" not in s.commands], 2), ids=lambda s: s.name)
def test_systems_with_known_truth_are_judged_right(system):
    try:
        verdict = mbstab.loads(system.text).eig().verdict
    except ModelFileError:
        verdict = UNDECIDED
    assert verdict in system.allowed
    assert system.least in STRENGTH[verdict]


PLANE = """\
mbstab: 1
bodies: {{p: {{type: planar_point, mass: 1}}}}
forces: {{f: {{type: expression, on: {{p.x: "{x}", p.y: "{y}"}}}}}}
reference: {{period: "{period}", time: "{time}", coordinates: {{p: {{x: 0, y: 0}}}}, rates: {{p: {{x: 0, y: 0}}}}}}
"""
SHAKEN = "-(0.5 + 0.1*cos(t))*p.x"
SHAKEN_TOO = "-(0.5 + 0.1*cos(t))*p.y"


def plane(x, y, period="2*pi", time="0"):
    return mbstab.loads(PLANE.format(x=x, y=y, period=period, time=time)).eig()


@pytest.mark.parametrize(
    ("x", "y", "verdict"),
    [
        # Defective and equal multipliers are judged as what they are.
        ("2*rate(p.x) - p.x", "-p.y - rate(p.y)", "unstable"),
        ("-2*rate(p.x) - p.x", "-p.y - rate(p.y)", "asymptotically stable"),
        (f"{SHAKEN} - 0.1*rate(p.x)", f"{SHAKEN_TOO} - 0.1*rate(p.y)", "asymptotically stable"),
        (SHAKEN, "-(0.6 + 0.1*cos(t))*p.y", "marginally stable"),
        (SHAKEN, SHAKEN_TOO, "undecided"),
        (f"{SHAKEN} + p.y", SHAKEN_TOO, "undecided"),
        # Nothing holds multipliers on the circle that are there to rounding only.
        (f"{SHAKEN} - 1e-13*rate(p.x)", "-p.y - rate(p.y)", "undecided"),
        (f"{SHAKEN} + 1e-13*rate(p.x)", "-p.y - rate(p.y)", "undecided"),
        (f"{SHAKEN} + 1e-9*rate(p.x)", "-p.y - rate(p.y)", "unstable"),
        ("-p.x*(2 + cos(t)) + 0.3*p.y", "-p.y*(3 + cos(t))", "undecided"),
        # A shift is a symmetry of all equations or of none: of the linearized ones alone does not count.
        (f"{SHAKEN} - 0.1*rate(p.x)", "-rate(p.y)", "asymptotically stable up to symmetry"),
        (f"{SHAKEN} - 0.1*rate(p.x)", "-rate(p.y) + cos(t)*p.x", "asymptotically stable up to symmetry"),
        (f"{SHAKEN} - 0.1*rate(p.x)", "-rate(p.y) + p.y**3", "undecided"),
    ],
)
def test_multipliers_are_placed_by_their_bounds_or_by_structure(x, y, verdict):
    assert plane(x, y).verdict == verdict


def test_a_symmetry_at_one_instant_is_none():
    # At the start nothing pulls along y.
    result = plane(f"{SHAKEN} - 0.1*rate(p.x)", "-0.1*(1 - cos(t))*p.y - 0.2*rate(p.y)")
    assert result.counts.neutral == 0
    assert result.verdict == "asymptotically stable"


def test_rest_in_a_minimum_of_the_energy_is_stable_with_any_period():
    # Both multipliers are 1: the period is that of the spring itself.
    result = parametric("2*pi").eig(h=0)
    assert (result.verdict, result.in_place) == ("stable", True)
    assert "the energy has a strict minimum" in result.reasons[0]


SWING = """\
mbstab: 1
bodies: {{p: {{type: planar_point, mass: 1}}}}
joints: {{line: {{type: point_on_line, between: [ground, p], axis: x}}}}
forces: {{f: {{type: expression, on: {{p.x: "{force}"}}}}}}
reference: {{period: {period}, coordinates: {{p: {{x: 1, y: 0}}}}, rates: {{p: {{x: 0, y: 0}}}}}}
"""


def test_a_kink_that_the_motion_passes_leaves_it_undecided():
    smooth = mbstab.loads(SWING.format(force="-p.x", period="2*pi")).eig()
    # x'' = -x, and x'' = -2 x on one side: half a period of each.
    kinked = SWING.format(force="-1.5*p.x + 0.5*abs(p.x)", period="pi*(1 + 1/sqrt(2))")
    result = mbstab.loads(kinked).eig()
    assert smooth.verdict == "stable up to symmetry"
    assert result.verdict == "undecided"
    assert "kink" in result.reasons[0]


def test_a_motion_that_ends_elsewhere_needs_a_symmetry_there():
    free = """\
mbstab: 1
bodies: {p: {type: planar_point, mass: 1}}
joints: {line: {type: point_on_line, between: [ground, p], axis: x}}
forces: {f: {type: expression, on: {p.x: "FORCE"}}}
reference: {period: 2, coordinates: {p: {x: 0, y: 0}}, rates: {p: {x: 1, y: 0}}}
"""
    steady = mbstab.loads(free.replace("FORCE", "1 - rate(p.x)")).eig()
    assert steady.verdict == "asymptotically stable up to symmetry"
    # A force that is felt from x = 3 on.
    later = mbstab.loads(free.replace("FORCE", "1 - rate(p.x) + (smooth_start((p.x - 3)/5))")).eig()
    assert later.verdict == "undecided"
    assert "after the period the motion is elsewhere (p.x by 2 m)" in later.reasons[0]
