"""Stability of periodic motions and their multipliers: Hill's equation integrated here, closed forms, constants."""

import cmath
import functools
import itertools
import json
import math
import re

import numpy as np
import pytest
import scipy.linalg
from click.testing import CliRunner
from sampling import sample
from scipy.integrate import solve_ivp
from scipy.special import ellipe, ellipk, i0e
from zoo import SYSTEMS

import mbstab
from mbstab.analysis.algebra.matching import matched
from mbstab.analysis.linear.linearize import linearize, state_space
from mbstab.analysis.spectrum import floquet
from mbstab.analysis.spectrum.floquet import monodromy
from mbstab.analysis.verdict.multipliers import enclosed, placed
from mbstab.analysis.verdict.rule import ASYMPTOTIC, STRENGTH, UNDECIDED
from mbstab.cli import main
from mbstab.compiler.system import System
from mbstab.errors import ConstraintError, ModelFileError, NumericalError, UsageError
from mbstab.model.library import installed_models

MODELS = {path.stem: path for path in installed_models()}
G = 9.81


def hill_multipliers(stiffness, period, damping=0.0):
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


def kapitza_multipliers(nu):
    L, A = 0.15, 0.02
    return hill_multipliers(lambda t: -3.0 * (G - A * nu**2 * math.cos(nu * t)) / (4.0 * L), 2.0 * math.pi / nu)


@pytest.mark.parametrize("nu", [60, 95, 110, 150, 200, 400])
def test_the_upright_pendulum_has_the_multipliers_of_hills_equation(nu):
    model = mbstab.load(MODELS["kapitza"])
    expected = kapitza_multipliers(nu)
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
    expected = hill_multipliers(lambda t: 1.0 + 0.3 * math.cos(2.0 * t), math.pi)
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
    expected = hill_multipliers(lambda t: 1.0 + 0.3 * math.cos(2.0 * t), math.pi, damping)
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
    np.testing.assert_allclose(found, hill_multipliers(lambda t: 1.0 + 0.3 * math.cos(2.0 * t), math.pi), rtol=1e-10)
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
    assert "only this offset drifts like t" in result.reasons[0]
    assert result.counts.neutral == 2


def test_the_terminal_and_json_answers_of_a_periodic_motion(tmp_path):
    path = tmp_path / "model.yaml"
    path.write_text(PARAMETRIC.format(period="T", more=""), encoding="utf-8")
    shown = CliRunner().invoke(main, ["eig", str(path)])
    assert shown.exit_code == 0
    assert "multiplier" in shown.stdout
    assert "Verdict: unstable" in shown.stdout
    assert max(map(len, shown.stdout.splitlines())) <= 80
    data = json.loads(CliRunner().invoke(main, ["eig", str(path), "--format", "json"]).stdout)
    assert data["period"] == math.pi
    expected = hill_multipliers(lambda t: 1.0 + 0.3 * math.cos(2.0 * t), math.pi)
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


# --- multipliers as answers -------------------------------------------------------------------------------------------


def of(model, period, progress=None, **parameters):
    """Return the monodromy matrix of the motion that a model describes."""
    return monodromy(model.system(**parameters), model.motion(**parameters), period, progress)


def multipliers(found):
    return np.linalg.eigvals(found.Phi)


# --- constant coefficients ------------------------------------------------------------------------------------------


CONSTANT = {
    "pendulum": 2.3,
    "double_pendulum": 1.1,
    "four_bar": 1.7,
    "slider_crank": 0.9,
    "trailer": 1.3,
    "chaplygin_sleigh": 1.9,
    "rolling_disk": 0.7,
    "rolling_torus": 1.1,
    "wheeled_inverted_pendulum": 0.4,
    "whipple_bicycle": 0.8,
}


@pytest.mark.few(2)
@pytest.mark.parametrize("name", sample(CONSTANT, 3))
def test_the_monodromy_matrix_of_constant_coefficients_is_their_exponential(name):
    model, T = mbstab.load(MODELS[name]), CONSTANT[name]
    system = model.system()
    linear = linearize(system, model.motion(), frozen=True)
    found, A = monodromy(system, linear.motion, T), state_space(linear).A
    units = np.concatenate([np.ones(found.n_xi), np.full(len(A) - found.n_xi, T)])
    expected = units[:, None] * scipy.linalg.expm(A * T) / units
    size = np.linalg.norm(expected, 2)
    error = np.linalg.norm(found.Phi - expected, 2)
    assert error < 1e-11 * size
    assert error < found.error + 1e-14 * size < 1e-10 * size


def test_multipliers_of_a_pendulum_are_exponentials_of_its_eigenvalues():
    model = mbstab.load(MODELS["pendulum"])
    expected = np.exp(np.array([1j, -1j]) * math.sqrt(3.0 * 9.81 / 0.8) * 2.3)
    np.testing.assert_array_less(matched(multipliers(of(model, 2.3)), expected), 1e-10)


# --- parametric excitation ------------------------------------------------------------------------------------------

A, L, GRAVITY = 0.03, 0.2, 9.81

KAPITZA = """
mbstab: 1
parameters: {{m: 1.5, L: {{value: 0.2, unit: m}}, A: {{value: 0.03, unit: m}}, w: {{value: 120, unit: rad/s}}}}
gravity: [0, -9.81]
bodies:
  rod: {{type: planar, mass: m, inertia: m*L**2/3, points: {{O: [-L, 0]}}}}
{support}
reference:
  coordinates:
    rod: {{x: 0, y: {side}*L, theta: {side}*pi/2}}
  rates:
    rod: {{theta: 0}}
"""

DRIVES = """
drives:
  sideways: {type: point, at: rod.O, direction: x, position: "0"}
  up: {type: point, at: rod.O, direction: y, position: A*sin(w*t)}
"""

EXPRESSIONS = """
constraints:
  sideways: {holonomic: rod.x - L*cos(rod.theta)}
  up: {holonomic: rod.y - L*sin(rod.theta) - A*sin(w*t)}
"""

GIVEN_RATE = """
drives:
  sideways: {type: point, at: rod.O, direction: x, position: "0"}
  up: {type: point, at: rod.O, direction: y, velocity: A*w*cos(w*t)}
"""

TWICE = (
    DRIVES
    + """
  sideways_again: {type: point, at: rod.O, direction: x, position: "0"}
  up_again: {type: point, at: rod.O, direction: [1, 1], position: A*sin(w*t)/sqrt(2)}
"""
)


def kapitza(side, support=DRIVES):
    return mbstab.loads(KAPITZA.format(side=side, support=support))


@functools.cache
def hill(side, w):
    """Return the multipliers of (4/3) L φ″ = side · (g − A w² sin w t) φ: gravity in the frame of the pivot."""

    def slope(t, y):
        return [y[1], side * 3.0 / (4.0 * L) * (GRAVITY - A * w * w * math.sin(w * t)) * y[0]]

    columns = [
        solve_ivp(slope, (0.0, 2.0 * math.pi / w), y, "DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
        for y in ([1.0, 0.0], [0.0, w])
    ]
    phi = np.array(columns).T
    phi[1] /= w
    # φ″ = f(t) φ conserves areas: eigenvalues from the trace keep the digits of a double root.
    half = np.trace(phi) / 2.0
    root = np.emath.sqrt(half * half - 1.0)
    return np.array([half + root, half - root])


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("w", [60.0, 120.0, 25.0])
def test_a_pendulum_on_a_shaken_pivot_has_the_multipliers_of_hills_equation(side, w):
    found = of(kapitza(side), 2.0 * math.pi / w, w=w)
    expected = hill(side, w)
    assert found.Phi.shape == (2, 2)
    assert np.trace(found.Phi) == pytest.approx(float(sum(expected).real), rel=1e-11)
    np.testing.assert_array_less(matched(multipliers(found), expected), 1e-9 * np.max(np.abs(expected)))
    # It stands if it is shaken fast enough: A w > sqrt(2 g (4/3) L) = 76 A / s.
    if side == 1:
        assert (np.max(np.abs(expected)) > 1.0 + 1e-6) == (w < 76.0)


@pytest.mark.parametrize("support", [EXPRESSIONS, TWICE], ids=["expressions", "redundant"])
def test_the_same_pivot_in_other_words_gives_the_same_multipliers(support):
    found = of(kapitza(1, support), 2.0 * math.pi / 120.0)
    np.testing.assert_array_less(matched(multipliers(found), hill(1, 120.0)), 1e-9)
    assert found.drift < 1e-12


def test_a_pivot_with_given_rate_adds_the_multiplier_one_of_its_height():
    found = of(kapitza(1, GIVEN_RATE), 2.0 * math.pi / 120.0)
    np.testing.assert_array_less(matched(multipliers(found), [*hill(1, 120.0), 1.0]), 1e-9)


def test_the_period_may_be_any_multiple():
    once, twice = (of(kapitza(1), n * 2.0 * math.pi / 60.0, w=60.0) for n in (1, 2))
    half = np.diag([1.0, 0.5])  # speeds are in units of 1/T
    np.testing.assert_allclose(half @ twice.Phi @ np.linalg.inv(half), once.Phi @ once.Phi, rtol=1e-10)


# --- nonholonomic ---------------------------------------------------------------------------------------------------

TOWED = """
mbstab: 1
parameters:
  L: {value: 4, unit: m}
  v: {value: 6, unit: m/s}
  w: {value: 3, unit: rad/s}
bodies:
  trailer: {type: planar, mass: 1000, inertia: 1500, points: {hitch: [L/2, 0], axle: [-L/2, 0]}}
drives:
  tow_along: {type: point, at: trailer.hitch, direction: x, position: v*(t + sin(w*t)/(2*w))}
  tow_across: {type: point, at: trailer.hitch, direction: y, position: "0"}
contacts:
  axle: {type: knife_edge, at: trailer.axle, along: x}
reference:
  coordinates:
    trailer: {x: -L/2, y: 0, theta: 0}
"""


@pytest.mark.parametrize("v", [6.0, -2.5])
def test_a_trailer_towed_with_periodic_speed_decays_by_the_way_it_makes(v):
    T = 2.0 * math.pi / 3.0
    found = of(mbstab.loads(TOWED), T, v=v)
    assert found.Phi == pytest.approx(np.array([[math.exp(-v * T / 4.0)]]), rel=1e-11)
    assert found.advance[0] == pytest.approx(v * T, rel=1e-12)


# --- rotors ---------------------------------------------------------------------------------------------------------

ROTOR = """
mbstab: 1
parameters: {{I_1: 0.02, I_2: 0.03, I_3: {{value: 0.025}}, k: 40, h: {{value: 0.1, unit: m}}, Omega: {{value: 7}}}}
bodies:
  rotor: {{type: spatial, mass: 2, inertia: [I_1, I_2, I_3], points: {{top: [0, 0, h], foot: [0, 0, -h]}}}}
ground:
  points: {{above: [0, 0, 3*h], below: [0, 0, -3*h]}}
{springs}
reference:
  coordinates:
    rotor: {{x: 0, y: 0, z: 0, phi: 0, theta: 0, psi: 0.3}}
  rates:
    rotor: {{x: 0, y: 0, z: 0, phi: 0, theta: 0, psi: Omega}}
"""

SPRINGS = """
forces:
  upper: {type: spring, between: [rotor.top, ground.above], stiffness: k, length: 0}
  lower: {type: spring, between: [rotor.foot, ground.below], stiffness: k, length: 0}
"""


def test_a_body_turning_about_its_middle_axis_has_the_growth_of_eulers_equations():
    # About z with the last Euler angle: the coefficients turn with the body.
    found = of(mbstab.loads(ROTOR.format(springs="")), 2.0 * math.pi / 7.0)
    growth = math.sqrt((0.025 - 0.02) * (0.03 - 0.025) / (0.02 * 0.03)) * 2.0 * math.pi
    values = multipliers(found)
    for expected in (math.exp(growth), math.exp(-growth)):
        assert np.min(np.abs(values - expected)) < 1e-10 * math.exp(growth)
    assert found.Phi.shape == (12, 12)
    # Only the direction of the axis and the six motions of the centre are left, all at 1 in Jordan blocks.
    assert np.sum(np.abs(values - 1.0) < 1e-4) == 10


def tilting(Omega, stiffness):
    """Return the exponents of a spinning body held upright by a potential, in the axes of the body.

    I_1 ω̇_1 − (I_2 − I_3) Ω ω_2 = −κ α, I_2 ω̇_2 − (I_3 − I_1) Ω ω_1 = −κ β with ω = (α̇ − Ω β, β̇ + Ω α).
    """
    I_1, I_2, I_3 = 0.02, 0.03, 0.025
    M = np.diag([I_1, I_2])
    R = Omega * np.array([[0.0, I_3 - I_1 - I_2], [I_1 + I_2 - I_3, 0.0]])
    K = np.diag([stiffness + Omega**2 * (I_3 - I_2), stiffness + Omega**2 * (I_3 - I_1)])
    return np.linalg.eigvals(
        np.block([[np.zeros((2, 2)), np.eye(2)], [-np.linalg.solve(M, K), -np.linalg.solve(M, R)]])
    )


@pytest.mark.parametrize("Omega", [7.0, 60.0])
def test_an_unround_rotor_on_springs_has_the_multipliers_of_its_own_axes(Omega):
    T = 2.0 * math.pi / Omega
    found = of(mbstab.loads(ROTOR.format(springs=SPRINGS)), T, Omega=Omega)
    # Springs without rest length pull on hn with k (3h − h n)…: the potential is 2 k h · 3h (1 − n_z).
    tilt, shake = tilting(Omega, 2.0 * 40.0 * 0.1 * 0.3), 1j * math.sqrt(2.0 * 40.0 / 2.0)
    expected = np.exp(np.array([*tilt, *3 * [shake, -shake], 0.0, 0.0]) * T)
    errors = matched(multipliers(found), expected)
    # The angle about the axis: the double multiplier 1 in one Jordan block.
    errors[np.argsort(np.abs(expected - 1.0))[:2]] /= 1e5
    np.testing.assert_array_less(errors, 1e-10 * np.max(np.abs(expected)))


# --- a motion that is not uniform -----------------------------------------------------------------------------------

SWINGING = """
mbstab: 1
parameters: {m: 1.5, L: {value: 0.2, unit: m}, spin: {value: 9, unit: rad/s}}
gravity: [0, -9.81]
bodies:
  rod: {type: planar, mass: m, inertia: m*L**2/3, points: {O: [-L, 0]}}
joints:
  pivot: {type: revolute, between: [rod.O, ground]}
reference:
  coordinates:
    rod: {x: 0, y: -L, theta: -pi/2}
  rates:
    rod: {theta: spin}
"""


def test_a_swinging_pendulum_shears_as_its_period_depends_on_the_rate():
    own, rate = math.sqrt(3.0 * GRAVITY / (4.0 * L)), 9.0
    k = rate / (2.0 * own)
    T = 4.0 * ellipk(k * k) / own
    slope = 4.0 / own * (ellipe(k * k) / (k * (1.0 - k * k)) - ellipk(k * k) / k) / (2.0 * own)  # dT/drate
    model = mbstab.loads(SWINGING)
    found, motion = of(model, T), model.motion()
    # Through the lowest point with a little more speed: later by that part of the period, with the same speed.
    start = found.to_components @ np.array([0, 0, 0, L, 0, 1.0])
    theta, rate_after = (x @ found.Phi @ start for x in (found.to_coordinates[2], found.to_rates[2]))
    assert theta == pytest.approx(-rate * slope, rel=1e-10)
    assert rate_after == pytest.approx(1.0, rel=1e-10)
    along = found.to_components @ np.concatenate([motion.u, motion.a])
    np.testing.assert_allclose(found.Phi @ along, along, rtol=0, atol=1e-10 * np.linalg.norm(along))


def test_whole_turns_are_a_return():
    own, rate = math.sqrt(3.0 * GRAVITY / (4.0 * L)), 30.0
    T = 4.0 / rate * ellipk((2.0 * own / rate) ** 2)
    found = of(mbstab.loads(SWINGING), T, spin=rate)
    np.testing.assert_allclose(found.advance, [0.0, 0.0, 2.0 * math.pi], rtol=0, atol=1e-10)
    assert np.trace(found.Phi) == pytest.approx(2.0, abs=1e-9)


@pytest.mark.parametrize("name", ["rolling_disk", "whipple_bicycle", "four_bar"])
def test_components_and_disturbances_are_inverse(name):
    model = mbstab.load(MODELS[name])
    found = of(model, 0.1)
    disturbances = np.vstack([found.to_coordinates, found.to_rates])
    np.testing.assert_allclose(found.to_components @ disturbances, np.eye(len(found.Phi)), rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", ["whipple_bicycle", "rolling_disk", "slider_crank", "trailer", "top"])
def test_neighbours_move_as_differences_of_motions_do(name):
    # At a state in motion off symmetry; accelerations are defined beside the constraints as well.
    model = mbstab.load(MODELS[name])
    flow = floquet.Flow(model.system(), model.motion(), 0.7)
    rng = np.random.default_rng(3)
    x = flow.begin + 0.1 * rng.uniform(-1.0, 1.0, flow.begin.shape)
    units = np.stack([flow.scale, flow.scale]) / flow.sizes  # neighbours are in other units than the motion
    expected = []
    for column in x.T[1:]:
        step = 1e-5 * column.T * units
        ends = []
        for sign in (1.0, -1.0):
            moved = x.copy()
            moved[:, :, 0] += sign * step
            ends.append(flow.slope(0.3, moved)[:, :, 0])
        expected.append((ends[0] - ends[1]) / (2e-5 * units))
    expected = np.array(expected).transpose(1, 2, 0)
    found = flow.slope(0.3, x)[:, :, 1:]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6 * np.max(np.abs(expected)))


# --- refusals -------------------------------------------------------------------------------------------------------

HILL_SPRING = """
mbstab: 1
bodies: {bob: {type: point, mass: 1}}
forces:
  spring: {type: expression, on: {bob.x: -(3 + cos(2*t))*bob.x, bob.y: -bob.y}}
reference:
  coordinates: {bob: {x: 0, y: 0}}
"""


def refusal(*arguments, **parameters):
    with pytest.raises(ModelFileError) as caught:
        of(*arguments, **parameters)
    return str(caught.value)


def test_a_rate_that_does_not_repeat_is_named_with_its_difference():
    text = refusal(kapitza(1), 0.05)
    found = re.search(r"the motion does not repeat after 0\.05 s: the rate of rod\.y differs by (\S+) m/s", text)
    assert float(found[1]) == pytest.approx(A * 120.0 * (math.cos(6.0) - 1.0), rel=1e-5)
    assert "hint: give the period after which everything repeats" in text


def test_a_pendulum_that_swings_differently_is_refused():
    text = refusal(mbstab.loads(SWINGING), 1.0)
    assert re.search(r"the rate of rod\.x differs by -1\.815\d+ m/s", text)


def test_the_smallest_difference_of_the_period_that_shows_is_refused():
    T = 2.0 * math.pi / 120.0
    of(kapitza(1), T * (1.0 + 1e-9))
    assert "the acceleration of rod.y differs by" in refusal(kapitza(1), T * (1.0 + 1e-6))


def test_coefficients_that_do_not_repeat_are_given_functions_of_another_period():
    assert of(mbstab.loads(HILL_SPRING), math.pi).error < 1e-9
    text = refusal(mbstab.loads(HILL_SPRING), 1.0)
    assert "small motions have other coefficients after 1 s" in text
    assert "given functions of time do not have this period" in text


@pytest.mark.parametrize("period", [0.0, -1.0, math.inf, math.nan])
def test_a_period_is_a_positive_number(period):
    with pytest.raises(UsageError, match="the period must be a positive number of seconds"):
        of(mbstab.load(MODELS["pendulum"]), period)


def test_a_period_that_takes_too_many_steps_is_refused(monkeypatch):
    monkeypatch.setattr("mbstab.analysis.spectrum.tolerances.Tolerances.monodromy_evaluations", 500)
    with pytest.raises(NumericalError, match=r"more than 500 evaluations: \d+\.\d+% of the period was done"):
        of(mbstab.load(MODELS["pendulum"]), 100.0)


FOLDING = """
mbstab: 1
ground:
  points: {B: [1, 0]}
bodies:
  left: {type: planar, mass: 1, inertia: 0.1, points: {A: [-0.5, 0], C: [0.5, 0]}}
  right: {type: planar, mass: 1, inertia: 0.1, points: {B: [-0.5, 0], D: [0.5, 0]}}
  coupler: {type: planar, mass: 1, inertia: 0.1, points: {C: [-0.5, 0], D: [0.5, 0]}}
joints:
  A: {type: revolute, between: [left.A, ground]}
  B: {type: revolute, between: [right.B, ground.B]}
  C: {type: revolute, between: [coupler.C, left.C]}
  D: {type: revolute, between: [coupler.D, right.D]}
reference:
  coordinates:
    left: {x: 0, y: -0.5, theta: -pi/2}
    right: {x: 1, y: -0.5, theta: -pi/2}
    coupler: {x: 0.5, y: -1, theta: 0}
  rates:
    left: {theta: 8}
"""


def test_a_motion_through_a_singular_configuration_is_refused():
    # A parallelogram is flat after a quarter of a turn.
    with pytest.raises(ConstraintError, match="the constraints lose rank") as caught:
        of(mbstab.loads(FOLDING), 2.0 * math.pi / 8.0)
    time = float(re.match(r"the motion cannot be followed beyond t = (\S+) s: ", str(caught.value))[1])
    assert time == pytest.approx(3.0 * math.pi / 2.0 / 8.0, rel=1e-4) or time == pytest.approx(math.pi / 16.0, rel=1e-4)


def test_a_motion_that_rounding_carries_away_is_refused():
    with pytest.raises(NumericalError, match=r"disturbances grow by a factor \d\.\de\+\d+ in \d\.\d+ s"):
        of(mbstab.load(MODELS["wheeled_inverted_pendulum"]), 4.0)


def test_growth_on_the_way_is_not_called_instability():
    """The multiplier of z' = -z (0.1 + 50 cos t) is exp(-0.2 pi), although z grows by exp(50) before."""
    rail = "bodies: {b: {type: planar_point, mass: 1}}\nconstraints: {r: {holonomic: b.y}}\n"
    spring = "forces: {s: {type: expression, on: {b.x: -b.x - rate(b.x)}}}\n"
    states = 'states: {z: {rate: "-z*(0.1 + 50*cos(t))"}}\nreference: {period: 2*pi}\n'
    with pytest.raises(NumericalError, match="whether or not they come back by its end") as caught:
        mbstab.loads(f"mbstab: 1\n{rail}{spring}{states}").eig()
    assert "unstable" not in str(caught.value)
    assert mbstab.loads(f"mbstab: 1\n{rail}{spring}{states.replace('50*', '5*')}").eig().verdict == ASYMPTOTIC


def test_a_scene_that_cannot_move_has_no_multipliers():
    held = DRIVES + "  turn: {type: coordinate, coordinate: rod.theta, position: pi/2}\n"
    assert of(kapitza(1, held), 2.0 * math.pi / 120.0).Phi.shape == (0, 0)


# --- progress -------------------------------------------------------------------------------------------------------


def test_progress_goes_from_zero_to_one():
    seen = []
    of(kapitza(1), 2.0 * math.pi / 120.0, seen.append)
    assert seen == sorted(seen)
    assert len(seen) > 20
    assert 0.0 < seen[0] < 0.05
    assert seen[-1] == 1.0


def test_a_period_is_followed_by_straight_line_functions(monkeypatch):
    asked, own = [], System.linearize_rows
    monkeypatch.setattr(System, "linearize_rows", lambda self, *at: asked.append(at) or own(self, *at))
    found = of(mbstab.load("kapitza.yaml"), 2.0 * math.pi / 200.0)
    assert found.evaluations > 500
    assert len(asked) < 100


# --- pulses that are short beside the period ------------------------------------------------------------------------

PULSE = """
mbstab: 1
parameters: {{w: {w}, a: {a}, t0: {t0}}}
bodies: {{b: {{type: planar_point, mass: 1}}}}
constraints: {{r: {{holonomic: b.y}}}}
forces: {{f: {{type: expression, on: {{b.x: -b.x - 0.01*rate(b.x) + a*exp(-(sin((t - t0)/2)/w)**2)*{on}}}}}}}
reference: {{period: 2*pi, coordinates: {{b: {{x: 0}}}}, rates: {{b: {{x: 0}}}}}}
"""


@pytest.mark.few(2)
@pytest.mark.parametrize("w", [1e-2, 1e-3, 1e-4])
@pytest.mark.parametrize("t0", [0.0, 2.5, 4.0])
def test_a_short_pulse_on_the_rate_changes_the_product_of_the_multipliers_as_liouville_says(w, t0):
    a = 1.5 / w
    result = mbstab.loads(PULSE.format(w=w, a=a, t0=t0, on="rate(b.x)")).eig()
    # The mean of exp(−sin²(x/2)/w²) is exp(−z) I0(z) with z = 1/(2w²).
    truth = math.exp(2.0 * math.pi * (a * i0e(0.5 / w**2) - 0.01))
    first, second = result.eigenvalues
    assert (first.multiplier * second.multiplier).real == pytest.approx(truth, rel=1e-8)
    assert result.verdict == "unstable"


@pytest.mark.few(2)
@pytest.mark.parametrize("w", [1e-3, 1e-4])
@pytest.mark.parametrize("height", [1.5, -1.5])
def test_a_short_pulse_on_the_place_turns_the_state(w, height):
    """A pulse far shorter than the period changes the speed by b·x, b being its integral, up to terms of its width."""
    a, t0 = height / w, 2.5
    result = mbstab.loads(PULSE.format(w=w, a=a, t0=t0, on="b.x")).eig()
    A = np.array([[0.0, 1.0], [-1.0, -0.01]])
    push = np.array([[1.0, 0.0], [2.0 * math.pi * a * i0e(0.5 / w**2), 1.0]])
    truth = np.linalg.eigvals(scipy.linalg.expm(A * (2.0 * math.pi - t0)) @ push @ scipy.linalg.expm(A * t0))
    found = sorted(abs(e.multiplier) for e in result.eigenvalues)
    assert found == pytest.approx(sorted(abs(truth)), rel=30.0 * w)
    assert (result.verdict == "unstable") == (max(abs(truth)) > 1.0)
    assert result.verdict in ("unstable", "asymptotically stable")


DRIVEN = """
joints: {pivot: {type: revolute, between: [rotor, ground]}}
drives: {turn: {type: joint, joint: pivot, position: t}}
"""


@pytest.mark.few(1)
@pytest.mark.parametrize("angle", ["rotor.theta", "angle(pivot)"])
@pytest.mark.parametrize(("w", "on"), [(1e-2, "rate(b.x)"), (1e-3, "rate(b.x)"), (1e-4, "rate(b.x)"), (1e-3, "b.x")])
def test_a_pulse_of_an_angle_that_a_motor_turns_is_one_of_the_time(w, on, angle):
    text = PULSE.format(w=w, a=-1.5 / w if on == "b.x" else 1.5 / w, t0=2.5, on=on)
    expected = mbstab.loads(text).eig()
    turned = text.replace("(t - t0)", f"({angle} - t0)") + DRIVEN
    turned = turned.replace("bodies: {", "bodies: {rotor: {type: planar, mass: 1, inertia: 1}, ")
    turned = turned.replace("rates: {b: {x: 0}}", "rates: {b: {x: 0}, rotor: {theta: 1}}")
    result = mbstab.loads(turned).eig()
    found, exact = (sorted((e.multiplier for e in x.eigenvalues), key=abs) for x in (result, expected))
    assert found == pytest.approx(exact, rel=1e-8)
    assert result.verdict == expected.verdict


def test_a_motion_that_drives_prescribe_whole_has_nothing_to_judge():
    text = """\
mbstab: 1
bodies: {rod: {type: planar, mass: 1, inertia: 1, points: {O: [-1, 0]}}}
joints: {p: {type: revolute, between: [rod.O, ground]}}
drives: {s: {type: joint, joint: p, position: "0.1*sin(t)"}}
reference: {coordinates: {rod: {theta: 0}}, period: 2*pi}
"""
    result = mbstab.loads(text).eig()
    assert result.eigenvalues == []
    assert result.reasons == ("constraints and drives leave no degree of freedom, so there is no stability question",)


# --- motions that repeat after several periods ------------------------------------------------------------------------


HOOKE = """
mbstab: 1
parameters:
  n: {value: 60, unit: rad/s}
  beta: {value: 30*deg, unit: rad}
  k: {value: 500, unit: N*m/rad}
  c: {value: 0.05, unit: N*m*s/rad}
  J1: {value: 0.02, unit: kg*m^2}
  J2: {value: 0.05, unit: kg*m^2}
  a0: {value: 0, unit: rad}
  w0: {value: n, unit: rad/s}
bodies:
  motor: {type: spatial, mass: 1, inertia: [1, 1, 1]}
  one: {type: spatial, mass: 1, inertia: [J1, J1, J1]}
  load: {type: spatial, mass: 1, inertia: [J2, J2, J2], axes: [0, 0, beta], points: {end: [0.5, 0, 0]}}
joints:
  engine: {type: revolute, between: [motor, ground], axis: x}
  shaft: {type: revolute, between: [one, motor], axis: x}
  hooke: {type: universal, between: [one, load], axis: [z, y]}
  bearing: {type: point_on_line, between: [ground, load.end], axis: [[cos(beta), sin(beta), 0], x]}
drives: {speed: {type: coordinate, coordinate: motor.phi, position: n*t}}
forces: {twist: {type: joint_spring, joint: shaft, stiffness: k, damping: c}}
reference:
  coordinates: {motor: {phi: 0}, one: {phi: a0}}
  rates: {motor: {phi: n}, one: {phi: w0}}
  period: pi/n
"""
BLADES = """
mbstab: 1
parameters:
  Om: {value: 7.4, unit: rad/s}
  M: {value: 50000, unit: kg}
  m: {value: 500, unit: kg}
  l: {value: 30, unit: m}
  kx: {value: 2e5, unit: N/m}
  ky: {value: 2e4, unit: N/m}
  kb: {value: m*l**2*f**2, unit: N*m}
  f: {value: 0.8*2*pi, unit: rad/s}
  odd: 1.1
bodies:
  hub: {type: planar, mass: M, inertia: 1}
  b1: {type: planar, mass: m, inertia: 0, points: {root: [-l, 0]}}
  b2: {type: planar, mass: m, inertia: 0, points: {root: [-l, 0]}}
  b3: {type: planar, mass: m, inertia: 0, points: {root: [-l, 0]}}
joints:
  h1: {type: revolute, between: [b1.root, hub]}
  h2: {type: revolute, between: [b2.root, hub]}
  h3: {type: revolute, between: [b3.root, hub]}
drives:
  spin: {type: coordinate, coordinate: hub.theta, position: Om*t}
forces:
  tower: {type: bushing, between: [hub, ground], stiffness: [kx, ky]}
  k1: {type: joint_spring, joint: h1, stiffness: kb*odd}
  k2: {type: joint_spring, joint: h2, stiffness: kb, rest: 2*pi/3}
  k3: {type: joint_spring, joint: h3, stiffness: kb, rest: 4*pi/3}
reference:
  period: 2*pi/Om
  coordinates:
    hub: {x: 0, y: 0, theta: 0}
    b1: {theta: 0}
    b2: {theta: 2*pi/3}
    b3: {theta: 4*pi/3}
  rates:
    hub: {x: 0, y: 0}
    b1: {theta: Om}
    b2: {theta: Om}
    b3: {theta: Om}
"""


def test_a_motion_that_repeats_after_two_periods_is_judged_over_both():
    """A universal joint has the same equations after half a turn, and its shafts stand upside down."""
    shaft = mbstab.loads(HOOKE)
    found = shaft.eig(n=84, a0=0.00032684614523095665, w0=96.10814670865621)
    assert found.verdict == "unstable"
    assert found.period == pytest.approx(2.0 * math.pi / 84.0)
    assert any("repeats after 2 times the stated period" in x for x in found.warnings)
    whole = mbstab.loads(HOOKE.replace("period: pi/n", "period: 2*pi/n"))
    expected = whole.eig(n=84, a0=0.00032684614523095665, w0=96.10814670865621)
    assert [e.multiplier for e in found.eigenvalues] == pytest.approx([e.multiplier for e in expected.eigenvalues])


def test_three_equal_blades_repeat_after_a_turn():
    assert mbstab.loads(BLADES).eig(odd=1, Om=7.4).verdict == "marginally stable"
    assert mbstab.loads(BLADES).eig(odd=1.1, Om=7.4).verdict == "unstable"
