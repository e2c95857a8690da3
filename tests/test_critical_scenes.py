"""A zero eigenvalue beside pieces, flat places and extreme ratios: nothing that is said is false."""

import critical_scenes
import pytest

import mbstab
from mbstab.analysis.verdict.rule import ASYMPTOTIC, ASYMPTOTIC_UP_TO, STABLE, UNDECIDED, UNSTABLE

COUNTS = {"springs": 400, "flats": 200, "shifts": 200}


@pytest.mark.few(12)
@pytest.mark.parametrize(("kind", "seed"), [(kind, seed) for kind, count in COUNTS.items() for seed in range(count)])
def test_what_is_said_about_a_critical_zero_is_true(kind, seed):
    text, truth = getattr(critical_scenes, kind)(seed)
    found = mbstab.loads(text).eig().verdict
    assert found in truth or found == UNDECIDED
    # The lowest power decides all that is damped and flat elsewhere.
    assert kind != "flats" or found != UNDECIDED


ON_A_RAIL = """
mbstab: 1
bodies: {p: {type: planar_point, mass: 1}}
constraints: {rail: {holonomic: p.y}}
forces: {f: {type: expression, on: {p.x: "%s"}}}
reference: {coordinates: {p: {x: 0, y: 0}}}
"""


@pytest.mark.parametrize(
    ("force", "truth"),
    [
        # 0 on the left; on the right it drives away, or brings back to a range of rests.
        ("p.x**3 + abs(p.x)**3 - rate(p.x)", UNSTABLE),
        ("p.x**3 + abs(p.x)**3", UNSTABLE),
        ("-p.x**3 - abs(p.x)**3 - rate(p.x)", ASYMPTOTIC_UP_TO),
        ("-p.x**3 - abs(p.x)**3", UNDECIDED),
        # The third power on one side, the fifth on the other.
        ("-p.x**3 - abs(p.x)**3 - p.x**5 - rate(p.x)", ASYMPTOTIC),
        ("-p.x**3 - abs(p.x)**3 - p.x**5", STABLE),
        ("-p.x**3 - abs(p.x)**3 + p.x**5 - rate(p.x)", UNSTABLE),
    ],
)
def test_each_side_of_a_piecewise_force_is_judged_by_its_own_power(force, truth):
    found = mbstab.loads(ON_A_RAIL % force).eig()
    assert found.verdict == truth
    if truth == ASYMPTOTIC_UP_TO:
        assert found.modulo.family == ("position of p.x",)
        assert "begins with this one, along p.x" in found.reasons[0]


@pytest.mark.parametrize(
    ("forces", "truth"),
    [
        ('p.x: "-p.x*abs(p.x)**2 - 2*p.x*p.y - p.x", p.y: "-p.y - p.x**2"', STABLE),
        ('p.x: "-p.x*abs(p.x)**2 - p.x*p.y", p.y: "-p.y - p.x**2/2"', STABLE),
        ('p.x: "-p.x*abs(p.x)**2 - 2*p.x*p.y", p.y: "-p.y - p.x**2/2"', UNDECIDED),
        ('p.x: "-p.x - abs(p.x)*p.y", p.y: "-p.y - p.x"', UNDECIDED),
    ],
)
def test_pieces_of_one_coordinate_beside_smooth_forces_have_a_potential(forces, truth):
    """Without friction the energy decides; the last two have none."""
    text = ON_A_RAIL.replace("constraints: {rail: {holonomic: p.y}}\n", "").replace('p.x: "%s"', forces)
    assert mbstab.loads(text).eig().verdict == truth


PARALLELOGRAM = """
mbstab: 1
gravity: [0, -10]
ground: {points: {A: [0, 0], B: [2, 0]}}
bodies:
  p: {type: planar, mass: 1, inertia: 0.1, points: {o: [0, -0.5], e: [0, 0.5]}}
  q: {type: planar, mass: 1, inertia: 0.1, points: {o: [0, -0.5], e: [0, 0.5]}}
  f: {type: planar, mass: 3, inertia: 1, points: {a: [FIRST, 0], b: [SECOND, 0]}}
joints:
  ja: {type: revolute, between: [p.o, ground.A]}
  jb: {type: revolute, between: [q.o, ground.B]}
  ka: {type: revolute, between: [f.a, p.e]}
  kb: {type: revolute, between: [f.b, q.e]}
forces: {t: {type: joint_spring, joint: ja, stiffness: 40}}
reference: {coordinates: {p: {theta: 0}, f: {theta: 0}}, guess: {f: {x: SECOND, y: 1}, p: {y: 0.5}, q: {x: 2, y: 0.5}}}
"""


@pytest.mark.parametrize("first", ["-1", "-2", "0", "-1.5", "-3"])
def test_the_point_that_names_a_coupler_decides_nothing(first):
    """V = 40 cos θ + 20 θ² has a minimum of the fourth power, wherever the coupler's own point is."""
    text = PARALLELOGRAM.replace("{x: SECOND", f"{{x: {-float(first)}").replace("SECOND", str(float(first) + 2.0))
    assert mbstab.loads(text.replace("FIRST", first)).eig().verdict == STABLE
