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
