"""A zero eigenvalue is judged by the lowest power of the force, however small its coefficient is beside the others."""

import random

import pytest
from sampling import sample

import mbstab
from mbstab.analysis.verdict.rule import ASYMPTOTIC, ASYMPTOTIC_UP_TO, STABLE, UNSTABLE

POWERS = (2, 3, 4, 5, 7)

ONE = """
mbstab: 1
bodies: {{p: {{type: planar_point, mass: 1}}}}
constraints: {{rail: {{holonomic: p.y}}}}
forces: {{f: {{type: expression, on: {{p.x: {force}}}}}}}
reference: {{coordinates: {{p: {{x: 0}}}}}}
"""

LEVER = """
mbstab: 1
bodies: {{a: {{type: planar, mass: 1, inertia: 1/12, points: {{end: [1/2, 0], start: [-1/2, 0]}}}}}}
joints: {{pin: {{type: revolute, between: [a.start, ground]}}}}
forces: {{f: {{type: expression, on: {{a.theta: {force}}}}}}}
reference: {{coordinates: {{a: {{theta: 0}}}}}}
"""


def polynomial(seed):
    """Return a force on x at random, its lowest power and the sign of the potential there, and whether it is damped."""
    rng = random.Random(seed)
    terms = {k: rng.choice((-1, 1)) * 10.0 ** rng.randint(-140, 12) for k in rng.sample(POWERS, rng.randint(1, 3))}
    return terms, rng.random() < 0.5


@pytest.mark.parametrize(("text", "seed"), sample([(x, seed) for x in (ONE, LEVER) for seed in range(60)], 16))
def test_the_lowest_power_decides_however_weak_it_is(text, seed):
    terms, damped = polynomial(seed)
    x = "p.x" if text is ONE else "a.theta"
    force = " + ".join(f"{c!r}*{x}**{k}" for k, c in terms.items()) + (f" - rate({x})" if damped else "")
    lowest = min(terms)
    minimum = lowest % 2 == 1 and terms[lowest] < 0.0
    truth = (ASYMPTOTIC if damped else STABLE) if minimum else UNSTABLE
    result = mbstab.loads(text.format(force=force)).eig()
    assert result.verdict == truth, (force, result.reasons)


@pytest.mark.parametrize(("weak", "truth"), [("1e-17", UNSTABLE), ("-1e-17", UNSTABLE), ("0", STABLE)])
def test_a_weak_slope_of_a_spring_beside_a_wall_is_seen_by_every_command(weak, truth):
    scene = mbstab.loads("parameters: {w: " + weak + "}" + ONE.format(force="-w*p.x**2 - p.x**3"))
    assert scene.eig().verdict == truth
    assert scene.eig_precise(50).verdict == truth
    assert scene.sweep("w", [float(weak), 1.0]).verdicts[0] == truth


@pytest.mark.parametrize(
    ("weak", "truth"),
    [
        ("", ASYMPTOTIC_UP_TO),
        (" - 1e-20*p.x**7", ASYMPTOTIC),
        (" + 1e-20*p.x**5", UNSTABLE),
        (" + 1e-20*p.x**2", UNSTABLE),
    ],
)
def test_a_valley_of_rest_positions_is_none_if_a_weak_force_acts_along_it(weak, truth):
    laws = f"{{p.x: 2*p.x*(p.y - p.x**2) - rate(p.x){weak}, p.y: -(p.y - p.x**2) - rate(p.y)}}"
    text = (
        f"mbstab: 1\nbodies: {{p: {{type: planar_point, mass: 1}}}}\nforces: {{f: {{type: expression, on: {laws}}}}}\n"
        "reference: {coordinates: {p: {x: 0, y: 0}}}"
    )
    assert mbstab.loads(text).eig().verdict == truth


@pytest.mark.parametrize(
    ("weak", "truth"),
    [
        ("", ASYMPTOTIC_UP_TO),
        (" - 1e-20*p.y**3", ASYMPTOTIC),
        (" + 1e-20*p.y**3", UNSTABLE),
        (" + 1e-20*p.y", UNSTABLE),
        (" - 1e-20*p.y", ASYMPTOTIC),
    ],
)
def test_a_ring_is_none_if_a_weak_force_breaks_its_symmetry(weak, truth):
    push = "-(p.x**2 + p.y**2 - 1)"
    laws = f"{{p.x: {push}*p.x - rate(p.x), p.y: {push}*p.y - rate(p.y){weak}}}"
    text = (
        f"mbstab: 1\nbodies: {{p: {{type: planar_point, mass: 1}}}}\nforces: {{f: {{type: expression, on: {laws}}}}}\n"
        "reference: {coordinates: {p: {x: 1, y: 0}}}"
    )
    assert mbstab.loads(text).eig().verdict == truth


def test_turns_of_written_forces_are_seen_with_parameters_of_many_digits():
    """The products C·a in the torque of a tyre are rounded differently in a force and in its derivatives."""
    text = """
mbstab: 1
parameters: {C: 0.7, a: 1.3, b: 1.1, v: 20}
bodies: {car: {type: planar, mass: 1.5, inertia: 2.5, points: {front: [a, 0], rear: [-b, 0]}}}
constraints: {cruise: {nonholonomic: vx(car) - v}}
forces:
  tyres:
    type: expression
    on: {vy(car.front): -C*atan(vy(car.front)/v), vy(car.rear): -C*atan(vy(car.rear)/v)}
reference: {coordinates: {car: {x: 0, y: 0, theta: 0}}, rates: {car: {x: v, y: 0, theta: 0}}}
"""
    result = mbstab.loads(text).eig()
    assert result.neutral_directions == ("car.x", "car.y", "rotation in the plane")
