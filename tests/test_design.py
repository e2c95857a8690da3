"""Designs against optima that are known in closed form, most of them where eigenvalues meet or several are active."""

import json
import math

import numpy as np
import pytest
from click.testing import CliRunner
from symmetric_plants import Plant

from mbstab import load, loads
from mbstab.analysis.design.goals import measure, measure_slope
from mbstab.cli import main
from mbstab.errors import NumericalError, UsageError
from mbstab.report.designs import with_values

OSCILLATOR = """
mbstab: 1
parameters: {m: 1.0, k: 4.0, c: 0.5}
bodies:
  a: {type: planar, mass: m, inertia: 1}
joints:
  rail: {type: prismatic, between: [a, ground], axis: [1, 0]}
forces:
  spring: {type: expression, on: {a.x: -k*a.x - c*rate(a.x)}}
"""


def test_critical_damping_is_the_fastest_decay():
    """The optimum is where the two eigenvalues meet: on one side the rate falls with an infinite slope."""
    found = loads(OSCILLATOR).design({"c": (0.1, 10.0)}, "decay")
    assert found.first == pytest.approx(0.25, rel=1e-12)
    assert found.best == pytest.approx(2.0, rel=1e-7)
    assert found.values["c"] == pytest.approx(4.0, rel=1e-7)
    assert found.active[0].meets
    assert not found.bounds
    assert found.result.verdict == "asymptotically stable"
    # From the other side, too.
    assert loads(OSCILLATOR).design({"c": (0.1, 10.0)}, "decay", c=9.0).best == pytest.approx(2.0, rel=1e-6)


def test_along_the_ridge_where_eigenvalues_meet():
    found = loads(OSCILLATOR).design({"c": (0.1, 10.0), "k": (1.0, 9.0)}, "decay")
    assert found.best == pytest.approx(3.0, rel=1e-6)
    assert found.values == pytest.approx({"c": 6.0, "k": 9.0}, rel=1e-6)
    assert found.bounds == {"k": "last"}


TWINS = """
mbstab: 1
parameters: {c: 0.5, k: 4.0, e: 0.0}
bodies: {a: {type: planar_point, mass: 1}}
forces: {f: {type: expression, on: {a.x: -k*a.x - c*rate(a.x), a.y: -(k + e)*a.y - c*rate(a.y)}}}
reference: {coordinates: {a: {x: 0, y: 0}}}
"""


def test_equal_eigenvalues_move_with_their_mean():
    """Two equal oscillators, at whose optimum four eigenvalues meet: critical damping."""
    found = loads(TWINS).design({"c": (0.1, 10.0)}, "decay")
    assert found.best == pytest.approx(2.0, rel=1e-6)
    ridge = loads(TWINS).design({"c": (0.1, 10.0), "k": (1.0, 9.0)}, "decay")
    assert ridge.best == pytest.approx(3.0, rel=1e-5)


def test_equal_eigenvalues_that_part_in_every_direction():
    """At e = 0 both pairs are equal; the rates are p and 1 − 2p + r/10: best at r = 1, p = 1.1/3."""
    text = TWINS.replace("c: 0.5, k: 4.0, e: 0.0", "p: 0.3333333333333333, r: 0.0")
    text = text.replace("-k*a.x - c*rate(a.x)", "-4*a.x - 2*p*rate(a.x)")
    text = text.replace("-(k + e)*a.y - c*rate(a.y)", "-4*a.y - 2*(1 - 2*p + 0.1*r)*rate(a.y)")
    found = loads(text).design({"p": (0.0, 1.0), "r": (0.0, 1.0)}, "decay")
    assert found.best == pytest.approx(1.1 / 3, rel=1e-6)


@pytest.mark.few(1)
@pytest.mark.parametrize("seed", [pytest.param(i, marks=[pytest.mark.long] if i > 3 else []) for i in range(200)])
def test_an_optimum_is_as_good_as_a_grid(seed):
    """Of plants with equal and crossing eigenvalues; the oracle computes those of its own matrices."""
    plant = Plant(seed)
    best, ended = plant.designed(loads)
    grid = plant.best_of_grid()
    assert best >= grid - 0.01 * abs(grid), ended


def test_the_damping_of_what_stays_unstable_is_not_its_growth():
    """Growth p + 0.1 at a frequency of 100 and 0.1 (1 − p) at 1: least at p = 0, the ratio where both are equal."""
    text = """
mbstab: 1
parameters: {p: 0.2}
bodies: {a: {type: planar_point, mass: 1}}
forces:
  f: {type: expression, on: {a.x: -1e4*a.x + 2*(p + 0.1)*rate(a.x), a.y: -a.y + 0.2*(1 - p)*rate(a.y)}}
"""
    found = loads(text).design({"p": (0.0, 1.0)}, "damping")
    # (p + 0.1)/100 = 0.1*(1 - p)
    assert found.values["p"] == pytest.approx(9.9 / 11.0, rel=1e-4)


def test_eigenvalues_that_do_not_limit_are_not_listed():
    """Rates of 0.01 and 0.015 beside frequencies of 100, and one far away that is fast."""
    text = """
mbstab: 1
parameters: {p: 0.02}
bodies: {a: {type: planar_point, mass: 1}, b: {type: planar_point, mass: 1}}
forces:
  f:
    type: expression
    on:
      a.x: -1e4*a.x - p*rate(a.x)
      a.y: -8e3*a.y - 0.02*rate(a.y)
      b.x: -1e8*b.x - 1e4*rate(b.x)
      b.y: -9*b.y - 2*rate(b.y)
"""
    found = loads(text).design({"p": (0.0, 0.03)}, "decay")
    assert found.best == pytest.approx(0.01)
    assert [x.value.imag for x in found.active if x.value.real < -0.0101] == []
    assert math.sqrt(8e3) in [pytest.approx(x.value.imag, rel=1e-6) for x in found.active]


ABSORBER = """
mbstab: 1
parameters: {mu: 0.1, f: 0.8, z: 0.1}
bodies:
  a: {type: planar, mass: 1, inertia: 1}
  b: {type: planar, mass: mu, inertia: 1}
joints:
  rail: {type: prismatic, between: [a, ground], axis: [1, 0]}
  rail_b: {type: prismatic, between: [b, ground], axis: [1, 0]}
forces:
  springs:
    type: expression
    on:
      a.x: -a.x + mu*f**2*(b.x - a.x) + 2*z*mu*f*(rate(b.x) - rate(a.x))
      b.x: -mu*f**2*(b.x - a.x) - 2*z*mu*f*(rate(b.x) - rate(a.x))
"""


def test_the_vibration_absorber_of_largest_decay():
    """Stability maximization (Nishihara and Matsuhisa 1997, Trans. JSME C 63): both pairs of eigenvalues coincide."""
    found = loads(ABSORBER).design({"f": (0.5, 1.5), "z": (0.01, 0.9)}, "decay")
    assert found.best == pytest.approx(0.5 * math.sqrt(0.1 / 1.1), rel=1e-4)
    assert found.values == pytest.approx({"f": 1 / 1.1, "z": math.sqrt(0.1 / 1.1)}, rel=1e-4)
    assert len(found.active) == 2
    assert all(x.meets for x in found.active)


THREE = """
mbstab: 1
parameters: {p: 0.1, r: 0.2}
bodies:
  a: {type: planar, mass: 1, inertia: 1}
forces:
  springs:
    type: expression
    on:
      a.x: -9*a.x - p*rate(a.x)
      a.y: -16*a.y - r*rate(a.y)
      a.theta: -25*a.theta - (1.2 - p - r)*rate(a.theta)
"""


def test_three_active_eigenvalues():
    found = loads(THREE).design({"p": (0.0, 2.0), "r": (0.0, 2.0)}, "decay")
    assert found.best == pytest.approx(0.2, rel=1e-9)
    assert found.values == pytest.approx({"p": 0.4, "r": 0.4}, rel=1e-8)
    assert sorted(round(x.value.imag) for x in found.active) == [3, 4, 5]


@pytest.mark.parametrize("kind", ["decay", "damping"])
def test_slopes_of_measures_are_those_of_their_values(kind):
    s, slope, step = -0.4 + 1.3j, 0.7 - 0.2j, 1e-6
    ahead, behind = (measure(kind, np.array(s + x * slope)) for x in (step, -step))
    assert measure_slope(kind, s, np.array([slope]))[0] == pytest.approx((ahead - behind) / (2 * step), rel=1e-8)


@pytest.mark.long
def test_a_smooth_optimum_inside():
    text = OSCILLATOR.replace("c: 0.5", "p: 0.9, r: 0.9").replace("c*rate", "(1 - (p - 0.3)**2 - 2*(r - p)**2)*rate")
    found = loads(text).design({"p": (0.0, 1.0), "r": (0.0, 1.0)}, "decay")
    assert found.best == pytest.approx(0.5, rel=1e-5)
    assert found.values == pytest.approx({"p": 0.3, "r": 0.3}, abs=0.01)


def test_the_worst_of_a_box():
    """Overdamped for small masses, slow for large ones: c/4 = c - sqrt(c**2 - 8)."""
    found = loads(OSCILLATOR).design({"c": (0.1, 10.0)}, "decay", over={"m": (0.5, 2.0)})
    assert found.values["c"] == pytest.approx(math.sqrt(128 / 7), rel=1e-6)
    assert found.best == pytest.approx(math.sqrt(128 / 7) / 4, rel=1e-6)
    assert sorted(x.place["m"] for x in found.active) == pytest.approx([0.5, 2.0])
    assert found.worst["m"] in (0.5, 2.0)


@pytest.mark.long
def test_the_worst_inside_of_a_box():
    text = OSCILLATOR.replace("m: 1.0", "m: 1.0, w: 0.0").replace("c*rate", "(1 + (w - 0.37)**2)*(c - c**2/4)*rate")
    found = loads(text).design({"c": (0.1, 3.0)}, "decay", over={"w": (0.0, 1.0)})
    assert found.best == pytest.approx(0.5, rel=1e-5)
    assert found.worst["w"] == pytest.approx(0.37, abs=0.01)


@pytest.mark.long
def test_the_stated_margin_over_a_box_is_the_worst_although_it_is_narrow():
    """Two oscillators with a circulatory coupling e: damped by (c − e)/2 where they are alike, by c/2 elsewhere."""
    window = loads("""
mbstab: 1
parameters: {p: 1, e: 1e-3, c: 0.99999e-3}
bodies: {b: {type: planar_point, mass: 1}, d: {type: planar_point, mass: 1}}
constraints: {r: {holonomic: b.y}, s: {holonomic: d.y}}
forces: {f: {type: expression, on: {b.x: -c*rate(b.x)-b.x+e*d.x, d.x: -c*rate(d.x)-p*d.x-e*b.x}}}
""")
    for e, c in ((1e-3, 0.99999e-3), (1e-3, 1.1e-3), (1e-2, 2e-2)):
        at = window.at(e=e, c=c)
        found = at.design(
            vary={"c": (c * (1.0 - 1e-5), c * (1.0 + 1e-5))}, goal="decay", over={"p": (0.53, 1.51)}, steps=1
        )
        # At p = 1 the pair is s = (−c + e)/2 to first order.
        for stated, damping in ((found.first, c), (found.best, found.values["c"])):
            assert stated <= 0.5 * (damping - e) + 1e-9
            assert stated >= 0.5 * (damping - e) - 1e-6
        assert found.decays == (found.values["c"] > e)


def test_the_widest_stable_range():
    """Shimmy: stable for a between (l ± sqrt(l**2 - 4 I/m))/2."""
    found = load("shimmy.yaml").design({"I": (0.1, 0.21), "l": (0.9, 1.1)}, "range:a=0.05..1.05")
    assert found.interval_before == pytest.approx((0.3, 0.7), rel=1e-9)
    assert found.values == {"I": 0.1, "l": 1.1}
    half = math.sqrt(1.1**2 - 0.4) / 2
    assert found.interval == pytest.approx((0.55 - half, 0.55 + half), rel=1e-9)
    assert found.best == pytest.approx(2 * half, rel=1e-9)
    assert found.bounds == {"I": "first", "l": "last"}
    assert sorted(x.place["a"] for x in found.active) == pytest.approx(sorted(found.interval))
    one = load("shimmy.yaml").design({"I": (0.1, 0.21)}, "range:a=0.05..1.05", steps=1)
    assert one.best == pytest.approx(math.sqrt(0.6), rel=1e-9)


def test_a_range_that_is_split_inside():
    """The damping at k = 2, the least, is positive for p < 0.4 - sqrt(0.02): there two ranges become one."""
    text = OSCILLATOR.replace("c: 0.5", "p: 0.34").replace("c*rate", "(3*(k - 2)**2 + p**2 - 0.8*p + 0.14)*rate")
    found = loads(text).design({"p": (0.0, 0.35)}, "range:k=0.5..3.5")
    assert found.first == pytest.approx(1.5 - math.sqrt(0.0164 / 3), rel=1e-6)
    assert found.best == pytest.approx(3.0, rel=1e-9)
    assert found.values["p"] < 0.4 - math.sqrt(0.02)


@pytest.mark.long
def test_an_unstable_start_first_becomes_stable():
    found = loads(OSCILLATOR).design({"c": (-3.0, 3.0)}, "damping", c=-1.0)
    assert found.first == pytest.approx(-0.25)
    assert found.best == pytest.approx(0.75, rel=1e-6)
    assert found.bounds == {"c": "last"}
    text = OSCILLATOR.replace("c: 0.5", "c: -0.5, p: 0.0").replace("c*rate(a.x)", "(c + p - 0.1*(k - 4)**2)*rate(a.x)")
    found = loads(text).design({"p": (0.0, 1.0)}, "range:k=1..9")
    assert found.interval_before is None
    assert found.interval == pytest.approx((4 - math.sqrt(5), 4 + math.sqrt(5)), rel=1e-6)


def test_neutral_directions_do_not_count():
    text = ABSORBER.replace("-a.x + mu", "mu").replace("mu: 0.1, f: 0.8", "mu: 0.5, f: 2.0")
    found = loads(text).design({"z": (0.01, 3.0)}, "decay")
    assert found.result.counts.neutral == 2
    # m x'' + 2 z mu f x' + mu f**2 x = 0 with the reduced mass m = mu/(1 + mu).
    assert found.values["z"] == pytest.approx(1 / math.sqrt(1.5), rel=1e-6)
    assert found.best == pytest.approx(2.0 * math.sqrt(1.5), rel=1e-6)


@pytest.mark.long
def test_values_at_which_there_is_no_answer_are_avoided():
    text = OSCILLATOR.replace("m: 1.0", "p: 0.5").replace("mass: m", "mass: 2 - p").replace("c: 0.5", "c: 1")
    found = loads(text).design({"p": (0.0, 3.0)}, "decay")
    assert found.values["p"] == pytest.approx(2 - 1 / 16, rel=1e-6)
    assert found.best == pytest.approx(8.0, rel=1e-5)


def test_a_conservative_system_gains_nothing_and_says_so():
    found = load("pendulum.yaml").design({"L": "5%"}, "decay")
    assert not found.reached
    assert abs(found.best) < 1e-12
    assert found.values == pytest.approx(found.before, rel=1e-15)  # rounding is no gain
    run = CliRunner().invoke(main, ["design", "pendulum.yaml", "--vary", "L=5%", "--goal", "decay"])
    assert run.exit_code == 0
    assert "no motion was found about which all disturbances decay" in run.output


def test_the_best_so_far_is_kept_when_it_is_interrupted_or_out_of_steps():
    def stop(done):
        raise KeyboardInterrupt

    found = loads(ABSORBER).design({"f": (0.5, 1.5), "z": (0.01, 0.9)}, "decay", stop)
    assert found.steps == 1
    assert found.ended.startswith("interrupted")
    once = loads(ABSORBER).design({"f": (0.5, 1.5), "z": (0.01, 0.9)}, "decay", steps=1)
    assert once.values == found.values
    assert once.ended.startswith("the steps are used up")
    assert once.best > once.first


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--vary", "cc=1..2", "--goal", "decay"], "did you mean 'c'"),
        (["--vary", "c=2..1", "--goal", "decay"], "the range of c is reversed"),
        (["--vary", "c=1..1", "--goal", "decay"], "the range of c is empty"),
        (["--vary", "c=1", "--goal", "decay"], "FIRST..LAST"),
        (["--vary", "c=x%", "--goal", "decay"], "number of percent"),
        (["--vary", "c=1..2", "--goal", "dekay"], "did you mean 'decay'"),
        (["--vary", "c=1..2", "--goal", "range"], "there is no goal 'range'"),
        (["--vary", "c=1..2", "--goal", "range:k"], "no sweep: block for k"),
        (["--vary", "c=1..2", "--goal", "range:c=1..2"], "c is varied, and is the range of the goal"),
        (["--vary", "c=1..2", "--goal", "decay", "--over", "c=1..2"], "c is varied, and spans the box"),
        (["--vary", "c=1..2", "--goal", "range:k=1..2", "--over", "m=1..2"], "--over goes with"),
        (["--vary", "c=1..2", "--goal", "decay", "--at-least", "-1"], "give a positive number"),
    ],
)
def test_what_is_wrong_is_said_with_exit_code_2(arguments, said):
    run = CliRunner().invoke(main, ["design", "-", *arguments], input=OSCILLATOR)
    assert run.exit_code == 2, run.output
    assert said in run.output


def test_a_periodic_motion_and_a_reference_that_cannot_follow_are_refused():
    with pytest.raises(UsageError, match="periodic motion"):
        load("kapitza.yaml").design({"L": "5%"}, "decay")
    text = OSCILLATOR.replace("m: 1.0", "m: 1.0, d: 0").replace("-k*a.x", "-k*(a.x - d)")
    with pytest.raises(UsageError, match="d cannot be varied"):
        loads(text).design({"d": (-1.0, 1.0)}, "decay")
    free = "mbstab: 1\nparameters: {m: 1.0}\nbodies:\n  a: {type: planar, mass: m, inertia: 1}\n"
    with pytest.raises(NumericalError, match="neutral eigenvalues only"):
        loads(free).design({"m": (1.0, 2.0)}, "decay")


def test_the_command_says_what_was_found_and_how_to_repeat_it(tmp_path):
    file = tmp_path / "model.yaml"
    file.write_text(OSCILLATOR.replace("c: 0.5", "c: {value: 500, unit: g/s}"), encoding="utf-8")
    arguments = ["design", str(file), "--vary", "c=100..10000", "--goal", "decay", "--certify"]
    run = CliRunner().invoke(main, arguments, catch_exceptions=False)
    assert run.exit_code == 0, run.output
    assert "decay rate of the slowest disturbance: 0.25 1/s before, 2 1/s now" in run.output
    assert "which nearly meets another one" in run.output
    assert "proof at these values: proven asymptotically stable" in run.output
    setting = run.output.rstrip().splitlines()[-1].removeprefix("again: --set ")
    again = CliRunner().invoke(main, ["eig", str(file), "--set", setting, "--format", "json"], catch_exceptions=False)
    assert json.loads(again.stdout)["verdict"] == "asymptotically stable"
    run = CliRunner().invoke(main, [*arguments[:-1], "--format", "json"], catch_exceptions=False)
    data = json.loads(run.stdout)
    assert data["best"] == pytest.approx(2.0, rel=1e-6)
    assert data["parameters"]["c"]["value"] == pytest.approx(4000.0, rel=1e-6)
    copy = tmp_path / "better.yaml"
    run = CliRunner().invoke(main, [*arguments[:-1], "-o", str(copy)], catch_exceptions=False)
    assert run.exit_code == 0
    assert load(copy).parameters()["c"] == pytest.approx(4.0, rel=1e-6)


def test_at_least():
    arguments = ["design", "-", "--vary", "c=0.1..10", "--goal", "decay", "--at-least"]
    run = CliRunner().invoke(main, [*arguments, "1", "--format", "json"], input=OSCILLATOR)
    assert run.exit_code == 0
    assert json.loads(run.stdout)["best"] >= 1.0
    assert json.loads(run.stdout)["ended"] == "the value asked for is reached"
    run = CliRunner().invoke(main, [*arguments, "3"], input=OSCILLATOR)
    assert run.exit_code == 3
    assert "at least 3 was asked for" in run.output


@pytest.mark.long
def test_a_bicycle_with_a_wider_range_of_stable_speeds():
    """The optimum is at ends of all ranges; tests/benchmarks/design.py confirms it by a grid."""
    vary = {name: "5%" for name in ("w", "c", "tilt", "x_H", "z_H")}
    found = load("whipple_bicycle.yaml").design(vary, "range:v")
    assert found.interval_before == pytest.approx((4.29238253634111, 6.02426201538837), rel=1e-7)
    assert found.best > 2.08
    assert found.bounds == {"w": "first", "c": "last", "tilt": "first", "x_H": "last", "z_H": "first"}
    assert found.result.verdict == "asymptotically stable up to symmetry"


@pytest.mark.parametrize("ends", ["", "\n", "\r\n"])
def test_a_file_with_other_values_has_no_empty_last_line(ends):
    model = loads("mbstab: 1\nparameters: {J: 2}\nbodies: {b: {type: planar, mass: 1, inertia: J}}" + ends).model
    assert with_values(model, {"J": "3"}).endswith("inertia: J}}\n")
