"""Data whose terms cancel: no word, count or bound is stronger than the decimals of the file allow.

A mass on a line with −s x − c x′ has the eigenvalues (−c ± √(c² − 4 s))/2: with one coefficient positive, it is
unstable where the other one is negative and asymptotically stable where it is positive. Doubles know only the rounding
of a coefficient that is written as a sum that cancels; its exact value is a fraction.
"""

import math
import random
from fractions import Fraction

import mpmath
import numpy as np
import pytest

import mbstab
from mbstab.compiler.system import System
from mbstab.errors import MbstabError
from mbstab.model.evaluator import Law
from mbstab.model.values import evaluate
from mbstab.report.eigenvalues import eigen_text

SEEDS = range(5)
KINDS = ("stiffness", "damping")


def scene(coefficient, kind="stiffness", named=True, period=None):
    """Return a mass on a line with a coefficient as its stiffness or its damping; the other one is c*w."""
    factor = "s" if named else f"({coefficient})"
    pair = (factor, "c*w") if kind == "stiffness" else ("c*w", factor)
    wave = "*(1 + 0*cos(2*pi*t))" if period else ""
    return mbstab.loads(f"""
mbstab: 1
parameters:
  k: {{value: 60, unit: deg}}
  c: 1
  w: 1
{f"  s: '{coefficient}'" if named else ""}
bodies: {{p: {{type: planar_point, mass: 1}}}}
constraints: {{g: {{holonomic: p.y}}}}
forces: {{f: {{type: expression, on: {{p.x: "-{pair[0]}{wave}*p.x - {pair[1]}*rate(p.x)"}}}}}}
reference: {{{f"period: {period}" if period else ""}}}
""")


def cancelled(seed):
    """Return coefficients of which doubles know the rounding only, and the exact value of each."""
    rng = random.Random(seed)
    small = Fraction(rng.choice((-1, 1)) * rng.randint(1, 9), 10 ** rng.randint(14, 18))
    size = 10 ** rng.randint(8, 12)
    exact = Fraction(repr(float(small * size)))
    yield f"{size}*cos(k) - {size // 2} + ({float(exact)!r})", exact
    yield f"{size} + ({float(exact)!r}) - {size}", exact
    a, b = (Fraction(rng.randint(10**5, 10**7), 10 ** rng.randint(1, 3)) for _ in range(2))
    total, exact = a + b, Fraction(repr(float(small * a)))
    yield f"{float(a)!r} + {float(b)!r} - {total.numerator}/{total.denominator} + ({float(exact)!r})", exact


def allowed(exact):
    """Return the verdicts that are true; those of stability without decay are weaker than the truth."""
    if exact < 0:
        return {"unstable", "undecided"}
    return {"asymptotically stable", "stable", "marginally stable", "undecided"}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", SEEDS)
def test_eig_says_no_more_than_the_exact_coefficient_allows(seed, kind):
    for coefficient, exact in cancelled(seed):
        for named in (True, False):
            assert scene(coefficient, kind, named).eig().verdict in allowed(exact), coefficient


@pytest.mark.few(1)
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", SEEDS)
def test_sweep_and_chart_say_no_more_than_the_exact_coefficient_allows(seed, kind):
    for coefficient, exact in cancelled(seed):
        for named in (True, False):
            model = scene(coefficient, kind, named)
            assert set(model.sweep("c", np.linspace(0.5, 2.0, 7)).verdicts) <= allowed(exact), coefficient
            found = model.chart({"c": np.linspace(0.5, 2.0, 4), "w": np.linspace(0.5, 2.0, 3)})
            assert {word for row in found.verdicts for word in row} <= allowed(exact), coefficient


@pytest.mark.few(3)
@pytest.mark.parametrize("seed", SEEDS)
def test_a_sweep_through_a_cancellation_is_certain_beside_it_only(seed):
    """What is certain at the ends of a sweep is not at a point between them, where the terms cancel."""
    for coefficient, exact in cancelled(seed):
        if "k" in coefficient:
            model, wide = scene(coefficient), np.radians(10.0)
            found = model.sweep("k", np.linspace(np.radians(60.0) - wide, np.radians(60.0) + wide, 21), si=True)
            assert found.verdicts[10] in {"undecided", *allowed(exact)}
            assert set(found.verdicts[:10]) == {"asymptotically stable"}
            assert set(found.verdicts[11:]) == {"unstable"}


@pytest.mark.few(1)
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", SEEDS)
def test_a_periodic_motion_is_called_no_more_than_the_exact_coefficient_allows(seed, kind):
    for coefficient, exact in cancelled(seed):
        for named in (True, False):
            assert scene(coefficient, kind, named, period=1).eig().verdict in allowed(exact), coefficient


@pytest.mark.few(1)
@pytest.mark.parametrize("seed", SEEDS)
def test_a_design_moves_nothing_for_the_sake_of_rounding(seed):
    """A design moves no parameter for the sake of rounding, and does not call a growing motion good."""
    for coefficient, exact in cancelled(seed):
        found = scene(coefficient).design({"c": "5%"}, "decay")
        before, now = (
            2.0 * float(exact) / (c + math.sqrt(c * c - 4.0 * float(exact))) for c in (1.0, found.values["c"])
        )
        assert now >= before
        assert found.result.verdict in allowed(exact)


@pytest.mark.few(2)
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("exact", [-1e-7, 1e-7])
def test_small_coefficients_are_decided(exact, kind):
    """Written plainly, a coefficient has all its digits."""
    expected = "unstable" if exact < 0 else "asymptotically stable"
    for named in (True, False):
        assert scene(repr(exact), kind, named).eig().verdict == expected
        assert set(scene(repr(exact), kind, named).sweep("c", np.linspace(0.5, 2.0, 7)).verdicts) == {expected}
        assert scene(repr(exact), kind, named, period=1).eig().verdict == expected


@pytest.mark.parametrize("s", ["1e10 + 1e-7 - 1e10", "1e10 - 1e-7 - 1e10", "-1e-7"])
def test_circulatory_forces_that_doubles_do_not_see(s):
    """x″ = −x − s y, y″ = −y + s x flutters for s ≠ 0, with eigenvalues √(−1 ± i s)."""
    model = mbstab.loads(f"""
mbstab: 1
parameters: {{c: 1, s: "{s}"}}
bodies: {{p: {{type: planar_point, mass: 1}}}}
forces: {{f: {{type: expression, on: {{p.x: "-c*p.x - s*p.y", p.y: "-c*p.y + s*p.x"}}}}}}
""")
    expected = {"unstable"} if s == "-1e-7" else {"unstable", "undecided"}
    assert {model.eig().verdict, *model.sweep("c", np.linspace(0.5, 2.0, 7)).verdicts} <= expected


@pytest.mark.parametrize("s", ["0.5*0.2 - 0.1", "0"])
def test_a_coefficient_of_zero_leaves_a_symmetry(s):
    expected = "asymptotically stable up to symmetry"
    assert scene(s).eig().verdict == expected
    assert set(scene(s).sweep("c", np.linspace(0.5, 2.0, 7)).verdicts) == {expected}


def test_a_coefficient_that_is_zero_by_rounding_leaves_none():
    model = scene("1e10 - 1e-7 - 1e10")
    assert {model.eig().verdict, *model.sweep("c", np.linspace(0.5, 2.0, 7)).verdicts} == {"undecided"}


def test_a_buckled_spring_far_from_the_origin_is_not_called_stable():
    """A buckled spring between points that are near each other and far from the origin: K = k (1 - L/l) < 0."""
    apart, length = Fraction("0.3"), Fraction("0.300000000015522")
    assert 1 - length / apart < 0
    found = mbstab.loads(f"""
mbstab: 1
bodies: {{p: {{type: planar_point, mass: 1}}}}
ground: {{points: {{A: [1000000, 0], B: [1000000.3, 0]}}}}
joints: {{g: {{type: point_on_line, between: [ground.B, p], axis: y}}}}
forces:
  s: {{type: spring, between: [ground.A, p], stiffness: 1e6, length: {float(length)!r}}}
  c: {{type: bearing, between: [ground.B, p], damping: 1}}
reference: {{coordinates: {{p: {{x: 1000000.3, y: 0}}}}}}
""")
    assert found.eig().verdict in {"unstable", "undecided"}


SPRING = """
mbstab: 1
parameters: {{a: 0.1, b: 0.2, c: {c}}}
bodies: {{p: {{type: planar_point, mass: 1}}}}
ground: {{points: {{A: [-1, 0]}}}}
constraints: {{g: {{holonomic: p.y}}}}
forces: {{s: {{type: spring, between: [ground.A, p], stiffness: "{k}", damping: 1, length: 1}}}}
"""


@pytest.mark.parametrize("k", ["c - b - a", "10*c - 10*b - 10*a", "5e4 - 1e5*cos(60*deg)"])
def test_a_stiffness_of_zero_is_not_negative_by_rounding(k):
    model = mbstab.loads(SPRING.format(c="0.3", k=k))
    assert model.eig().verdict == "asymptotically stable up to symmetry"
    assert model.eig_precise(30).verdict == "asymptotically stable up to symmetry"


@pytest.mark.parametrize("c", ["0.29999999999999999", "0.2999"])
def test_a_stiffness_that_is_negative_is_refused_by_its_decimals(c):
    """0.29999999999999999 is the double 0.3, but less than 0.1 + 0.2."""
    with pytest.raises(mbstab.ModelFileError, match=f"got {float(Fraction(c) - Fraction('0.3')):g} N/m"):
        mbstab.loads(SPRING.format(c=c, k="c - b - a")).eig()


# --- a few eigenvalues: bounds and counts hold for the decimals of the file -------------------------------------------


def _roots(k, d):
    """Return the roots of s² + d s + k with many digits."""
    with mpmath.workdps(40):
        k, d = (mpmath.mpf(x.numerator) / x.denominator for x in (k, d))
        half = mpmath.sqrt(d * d / 4 - k)
        return [mpmath.mpc(-d / 2 + half), mpmath.mpc(-d / 2 - half)]


def _check(result, k, d):
    """Assert that a result about x'' + d x' + k x = 0 does not contradict its roots."""
    roots = _roots(k, d)
    for e in result.eigenvalues:
        if e.kind != "neutral":
            assert min(abs(mpmath.mpc(e.value) - s) for s in roots) <= e.error_bound
    growing = sum(s.real > 0 for s in roots)
    assert result.counts.unstable_proven in (None, growing)
    allowed = {"unstable"} if growing else {"asymptotically stable"} if d else {"stable", "marginally stable"}
    assert result.verdict in {"undecided", *allowed}
    return result.verdict != "undecided"


def _written(rng):
    """Return the text of a number that is small after cancellation, and the number."""
    large, left = (
        10 ** int(rng.integers(0, 12)),
        Fraction(int(rng.integers(-99, 100)) or 1, 10 ** int(rng.integers(1, 14))),
    )
    texts = (
        f"{2 * large}*cos(pi/3) - {large} + {float(left)!r}",
        f"{large}*(0.1 + 0.2 - 0.3) + {float(left)!r}",
        f"{large}*tan(pi/4) - {large} + {float(left)!r}",
        f"({large} + {float(left)!r}) - {large}",
    )
    return texts[int(rng.integers(0, 4))], Fraction(repr(float(left)))


SCENES = {
    "stiffness": """
parameters: {{s: "{text}"}}
bodies: {{p: {{type: planar_point, mass: 1}}}}
constraints: {{g: {{holonomic: p.y}}}}
forces: {{f: {{type: expression, on: {{p.x: "-s*p.x-{d}*rate(p.x)"}}}}}}
""",
    "inside an expression": """
bodies: {{p: {{type: planar_point, mass: 1}}}}
constraints: {{g: {{holonomic: p.y}}}}
forces: {{f: {{type: expression, on: {{p.x: "-({text})*p.x-{d}*rate(p.x)"}}}}}}
""",
    # A load on a pendulum, which its joint balances.
    "gravity": """
gravity: [0, "-({text})"]
bodies: {{p: {{type: planar_point, mass: 1}}}}
joints: {{rod: {{type: distance, between: [p, ground], length: 1}}}}
forces: {{f: {{type: expression, on: {{p.x: "-{d}*rate(p.x)"}}}}}}
reference: {{coordinates: {{p: {{x: 0, y: -1}}}}}}
""",
}


@pytest.mark.long
@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("damping", [0, 1])
def test_a_few_eigenvalues_of_numbers_that_cancel_do_not_contradict_the_decimals(scene, damping):
    rng, told = np.random.default_rng(12), 0
    for _ in range(25):
        text, k = _written(rng)
        model = mbstab.loads("mbstab: 1\n" + SCENES[scene].format(text=text, d=damping))
        told += _check(model.modes(1), k, Fraction(damping))
    assert told > 5


@pytest.mark.few(1)
@pytest.mark.parametrize("damping", [0, 1])
def test_a_few_eigenvalues_far_from_the_origin_do_not_contradict_the_decimals(damping):
    """Across a spring of stiffness c, length r and free length L the stiffness is c (1 − L/r)."""
    rng, told = np.random.default_rng(4), 0
    for _ in range(25):
        far = 10 ** int(rng.integers(0, 8))
        ends = Fraction(far), Fraction(far) + Fraction(int(rng.integers(1, 9)), 10)
        r = ends[1] - ends[0]
        free = Fraction(
            repr(float(r * (1 + Fraction(int(rng.integers(-99, 99)) or 1, 10 ** int(rng.integers(2, 12))))))
        )
        places = [repr(float(x)) for x in ends]
        model = mbstab.loads(f"""
mbstab: 1
ground: {{points: {{A: [{places[0]}, 0]}}}}
bodies: {{p: {{type: planar_point, mass: 1}}}}
constraints: {{line: {{holonomic: p.x-{places[1]}}}}}
forces:
  spring: {{type: spring, between: [p, ground.A], stiffness: 1000, length: {float(free)!r}}}
  drag: {{type: expression, on: {{p.y: "-{damping}*rate(p.y)"}}}}
reference: {{coordinates: {{p: {{x: {places[1]}, y: 0}}}}}}
""")
        told += _check(model.modes(1), 1000 * (1 - free / r), Fraction(damping))
    assert told > 5


def test_a_stiffness_that_decimals_make_negative():
    """s is −1e-7 N/m exactly; of doubles it is +8.5e-7."""
    model = mbstab.loads("""
mbstab: 1
parameters: {k: {value: 60, unit: deg}, s: "1e10*cos(k) - 5e9 - 1e-7"}
bodies: {p: {type: planar_point, mass: 1}}
constraints: {g: {holonomic: p.y}}
forces: {f: {type: expression, on: {p.x: "-s*p.x-rate(p.x)"}}}
""")
    result = model.modes(1)
    assert result.verdict == "undecided"
    assert result.counts.unstable_proven is None
    assert abs(result.eigenvalues[0].value - 9.99999e-8) <= result.eigenvalues[0].error_bound < 1e-4


@pytest.mark.parametrize("push", ["1e-6", "1e-8", "1e-3", "-1e-6"])
@pytest.mark.parametrize("mass", [1, 3])
def test_a_weak_force_beside_a_strong_spring_leaves_no_neutral_shift(push, mass):
    """Two masses m on a spring k, one pushed away by a x: to first order the squares of the slow pair are a/(2 m)."""
    model = mbstab.loads(f"""
mbstab: 1
bodies: {{p: {{type: planar_point, mass: {mass}}}, q: {{type: planar_point, mass: {mass}}}}}
constraints: {{g: {{holonomic: p.y}}, h: {{holonomic: q.y}}}}
forces:
  s: {{type: bearing, between: [p, q], stiffness: 1e12}}
  n: {{type: expression, on: {{q.x: {push}*q.x}}}}
""")
    result = model.modes(1)
    assert result.counts.unstable_proven in (None, int(float(push) > 0.0))
    assert result.counts.neutral == 0
    assert result.verdict in ({"undecided", "unstable"} if float(push) > 0.0 else {"undecided", "stable"})


# --- exponents made of parameters: fractions count as such, not as rounded numbers ------------------------------------


POINT = """
mbstab: 1
parameters: {{{parameters}}}
bodies: {{p: {{type: planar_point, mass: 1}}}}
constraints: {{rail: {{holonomic: p.y}}}}
forces: {{f: {{type: expression, on: {{p.x: "{force}"}}}}}}
"""

ONE = {
    "2*h": "h: 0.5",
    "h*(1/h)": "h: 3",
    "3*h": "h: 1/3",
    "10*h": "h: 0.1",
    "n": "h: 0.1, n: (h + 0.2)/0.3",
    "(h + k)/0.3": "h: 0.1, k: 0.2",
    "long/short": "long: {value: 30, unit: cm}, short: {value: 300, unit: mm}",
    "-h": "h: -1",
    "h**2*4": "h: 0.5",
    "2 - abs(h)": "h: -1",
}
"""Exponents that are exactly 1; some are another number in floats."""


def point(force, parameters="", **settings):
    return mbstab.loads(POINT.format(force=force, parameters=parameters)).eig(**settings)


def values(result):
    return np.sort_complex([e.value for e in result.eigenvalues])


@pytest.mark.parametrize(("exponent", "parameters"), ONE.items(), ids=list(ONE))
@pytest.mark.parametrize(
    "force", ["-p.x - 0.5*rate(p.x)**(N)", "-p.x**(N) - 0.5*rate(p.x)", "-p.x - 0.5*sin(rate(p.x)**(N))"]
)
def test_an_exponent_that_is_one_is_no_power(force, exponent, parameters):
    plain, found = point(force.replace("N", "1")), point(force.replace("N", exponent), parameters)
    assert np.abs(values(plain) - values(found)).max() < 1e-14
    assert max(e.error_bound for e in found.eigenvalues) < 1e-13
    assert (found.verdict, found.judged.reasons) == (plain.verdict, plain.judged.reasons)


@pytest.mark.parametrize("setting", ["1/3", "0.2/0.6", 0.25])
def test_a_setting_is_as_exact_as_it_is_written(setting):
    times = 4 if setting == 0.25 else 3
    found = point(f"-p.x - 0.5*rate(p.x)**({times}*h)", "h: 7", h=setting)
    assert np.abs(values(found) - (-0.25 + 1j * math.sqrt(1 - 1 / 16) * np.array([-1, 1]))).max() < 1e-14
    assert max(e.error_bound for e in found.eigenvalues) < 1e-13


@pytest.mark.parametrize("exponent", ["4*h", "h + 3/2", "k*10/3", "2*(k + 0.3)/0.9"])
def test_a_given_motion_starts_with_its_own_acceleration(exponent):
    mechanism = mbstab.loads(f"""
mbstab: 1
parameters: {{h: 0.5, k: 0.6}}
bodies: {{p: {{type: planar_point, mass: 1}}}}
drives:
  along: {{type: point, at: p, direction: x, position: "0.1*t**({exponent})"}}
  across: {{type: point, at: p, direction: y, position: 0}}
""")
    (law, _) = (law for _, law in System(evaluate(mechanism.model)).given_functions() if isinstance(law, Law))
    assert abs(law.at(0.0).second - 0.2) < 1e-15
    with pytest.raises(MbstabError, match=r"a drive accelerates p\.x with 0\.2 m/s"):
        mechanism.eig()


def test_a_sweep_over_an_exponent_agrees_with_single_points():
    mechanism = mbstab.loads(POINT.format(force="-p.x - 0.5*rate(p.x)**(2*h) - rate(p.x)**3", parameters="h: 0.5"))
    swept = mechanism.sweep("h", np.array([0.5, 1.0, 1.5, 2.0, 2.5]))
    for h, row in zip(swept.values, swept.branches, strict=True):
        assert np.abs(np.sort_complex(row) - values(mechanism.eig(h=float(h)))).max() < 1e-12


def test_an_eigenvalue_without_a_bound_is_not_printed():
    # Whether this exponent is 1 does not follow from arithmetic with fractions.
    found = point("-p.x - 0.5*rate(p.x)**n", "n: sin(1)**2 + cos(1)**2")
    assert all(math.isinf(e.error_bound) for e in found.eigenvalues)
    table = eigen_text(found, None)
    rows = [
        line.split()
        for line in table.partition("type\n")[2].split("Why ")[0].splitlines()
        if line.endswith("undecided")
    ]
    # Two values or a pair: that, too, is up to rounding.
    assert [row[0] for row in rows] == ["unknown"] * len(rows)
    assert 1 <= len(rows) <= 2
    assert "no error bound could be computed for 2 eigenvalues" in " ".join(found.warnings)


def test_an_exponent_of_what_moves_stays_as_it_is():
    with pytest.raises(MbstabError, match="no finite equations"):
        point("-p.x - rate(p.x)**(p.x)")


DRIVEN = """
mbstab: 1
parameters: {a: 0.1, b: 0.2, c: 0.3, more: 0}
bodies: {slider: {type: planar, mass: 1, inertia: 1}, p: {type: planar_point, mass: 1}}
joints: {rail: {type: prismatic, between: [slider, ground], axis: x}}
drives: {d: {type: joint, joint: rail, position: "(1e8*(a + b - c) + more)*t**2"}}
forces: {s: {type: bearing, between: [p, ground], stiffness: 5, damping: 1}}
REPEATED
reference:
  coordinates: {slider: {x: 0, y: 0, theta: 0}, p: {x: 0, y: 0}}
  rates: {slider: {x: 0, y: 0, theta: 0}, p: {x: 0, y: 0}}
"""


@pytest.mark.parametrize(
    ("repeated", "told"),
    [
        ("", "the reference is at rest at this time only: a drive accelerates slider.x"),
        ("constraints: {again: {holonomic: slider.x}}", "contradicts other constraints: no accelerations satisfy"),
    ],
)
def test_accelerations_that_the_decimals_of_the_file_do_not_have_are_none(repeated, told):
    """0.1 + 0.2 - 0.3 leaves 5.6e-17 in floats, here 1.1e-8 m/s²; what the file says beyond its rounding counts."""
    model = mbstab.loads(DRIVEN.replace("REPEATED", repeated))
    found = model.eig()
    assert found.verdict == "asymptotically stable"
    np.testing.assert_allclose(found.values().real, -0.5, rtol=1e-12)
    with pytest.raises(MbstabError, match=told):
        model.eig(more=1e-7)
