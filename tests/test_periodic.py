"""Stability of periodic motions by ``eig``: against Hill's equation integrated here, and closed forms."""

import cmath
import json
import math

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.integrate import solve_ivp

import mbstab
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
    assert result.chains == (2, 2)
    np.testing.assert_allclose(found, multipliers(lambda t: 1.0 + 0.3 * math.cos(2.0 * t), math.pi), rtol=1e-10)
    assert {"free.x", "free.y"} <= set(result.symmetries)


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
    assert result.verdict == "marginally stable"
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
