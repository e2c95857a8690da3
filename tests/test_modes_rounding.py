"""A few eigenvalues where written numbers cancel: bounds and counts hold for the decimals of the file."""

from fractions import Fraction

import mpmath
import numpy as np
import pytest

import mbstab


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


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("damping", [0, 1])
def test_numbers_that_cancel(scene, damping):
    rng, told = np.random.default_rng(12), 0
    for _ in range(25):
        text, k = _written(rng)
        model = mbstab.loads("mbstab: 1\n" + SCENES[scene].format(text=text, d=damping))
        told += _check(model.modes(1), k, Fraction(damping))
    assert told > 5


@pytest.mark.parametrize("damping", [0, 1])
def test_a_spring_far_from_the_origin(damping):
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
