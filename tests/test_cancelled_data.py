"""Coefficients whose terms cancel: no word is stronger than the exact value of the coefficient allows.

A mass on a line with −s x − c x′ has the eigenvalues (−c ± √(c² − 4 s))/2: with one coefficient positive, it is
unstable where the other one is negative and asymptotically stable where it is positive. Doubles know only the rounding
of a coefficient that is written as a sum that cancels; its exact value is a fraction.
"""

import math
import random
from fractions import Fraction

import numpy as np
import pytest

import mbstab

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
def test_eig(seed, kind):
    for coefficient, exact in cancelled(seed):
        for named in (True, False):
            assert scene(coefficient, kind, named).eig().verdict in allowed(exact), coefficient


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", SEEDS)
def test_sweep_and_chart(seed, kind):
    for coefficient, exact in cancelled(seed):
        for named in (True, False):
            model = scene(coefficient, kind, named)
            assert set(model.sweep("c", np.linspace(0.5, 2.0, 7)).verdicts) <= allowed(exact), coefficient
            found = model.chart({"c": np.linspace(0.5, 2.0, 4), "w": np.linspace(0.5, 2.0, 3)})
            assert {word for row in found.verdicts for word in row} <= allowed(exact), coefficient


@pytest.mark.parametrize("seed", SEEDS)
def test_sweep_through_the_cancellation(seed):
    """What is certain at the ends of a sweep is not at a point between them, where the terms cancel."""
    for coefficient, exact in cancelled(seed):
        if "k" in coefficient:
            model, wide = scene(coefficient), np.radians(10.0)
            found = model.sweep("k", np.linspace(np.radians(60.0) - wide, np.radians(60.0) + wide, 21))
            assert found.verdicts[10] in {"undecided", *allowed(exact)}
            assert set(found.verdicts[:10]) == {"asymptotically stable"}
            assert set(found.verdicts[11:]) == {"unstable"}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", SEEDS)
def test_floquet(seed, kind):
    for coefficient, exact in cancelled(seed):
        for named in (True, False):
            assert scene(coefficient, kind, named, period=1).eig().verdict in allowed(exact), coefficient


@pytest.mark.parametrize("seed", SEEDS)
def test_design(seed):
    """A design moves no parameter for the sake of rounding, and does not call a growing motion good."""
    for coefficient, exact in cancelled(seed):
        found = scene(coefficient).design({"c": "5%"}, "decay")
        before, now = (
            2.0 * float(exact) / (c + math.sqrt(c * c - 4.0 * float(exact))) for c in (1.0, found.values["c"])
        )
        assert now >= before
        assert found.result.verdict in allowed(exact)


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


def test_far_from_the_origin():
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
