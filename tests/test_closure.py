"""Loops that do not quite close, and rows that repeat others at the reference only."""

import re

import numpy as np
import pytest
from sampling import sample

import mbstab
from mbstab.errors import ModelFileError, UsageError

LOOP = """
mbstab: 1
parameters: {{off: {off}, tilt: {tilt}, g: 9.81}}
gravity: [0, 0, -g]
ground: {{points: {{A: [0, 0, 0], B: [{d}, 0, 0]}}}}
bodies:
  a: {{type: spatial, mass: 1, inertia: [0.01, 0.01, 0.001], points: {{o: [0, 0, {a}/2], e: [0, 0, -{a}/2]}}}}
  b:
    type: spatial
    mass: 1.3
    inertia: [0.001, 0.02, 0.02]
    points: {{o: [-{b}/2, 0, 0], e: [{b}/2, off, 0]}}
    directions: {{axle: [tilt, 1, 0]}}
  c:
    type: spatial
    mass: 1
    inertia: [0.01, 0.01, 0.001]
    points: {{o: [0, 0, {c}/2], e: [0, 0, -{c}/2]}}
    directions: {{axle: [0, 1, 0]}}
joints:
  A: {{type: revolute, between: [a.o, ground.A], axis: y}}
  B: {{type: revolute, between: [c.o, ground.B], axis: y}}
  C: {{type: revolute, between: [b.o, a.e], axis: y}}
  D: {{type: revolute, between: [b.e, c.e], axis: axle}}
reference:
  find: equilibrium
  guess: {{a: {{z: -{a}/2}}, b: {{x: {d}/2, z: -({a}+{c})/2, theta: {lean}}}, c: {{x: {d}, z: -{c}/2}}}}
"""


def loop(seed):
    """Return a four-bar linkage in space, and its misclosure: of a point (m), of odd seeds of an axis (rad)."""
    rng = np.random.default_rng(seed)
    a, c, d = (round(float(x), 6) for x in rng.uniform([0.1, 0.1, 0.3], [0.3, 0.3, 0.6]))
    off = float(10.0 ** rng.uniform(-12.0, -5.0))
    b = f"sqrt({d}**2 + ({a} - {c})**2)"
    shape = {"a": a, "b": f"({b})", "c": c, "d": d, "lean": f"asin(({c} - {a})/{b})"}
    return LOOP.format(off=0 if seed % 2 else off, tilt=off if seed % 2 else 0, **shape), off


def frequency(text, **given):
    result = mbstab.loads(text).eig(**given)
    (pair,) = [e for e in result.eigenvalues if e.value.imag > 0.0]
    return pair, result


@pytest.mark.parametrize("seed", sample(range(100), 23))
def test_a_loop_of_a_drawing_is_answered_or_its_row_is_named(seed):
    text, off = loop(seed)
    exact, _ = frequency(text, off=0.0, tilt=0.0)
    try:
        found, result = frequency(text)
        assert off < 1e-8
    except ModelFileError as error:
        assert off > 1e-10
        said = re.search(r"joint 'D' \(.*\) repeats .* contradicts them by (\S+) m", str(error))
        assert 0.1 * off < float(said[1]) < 10.0 * off
        found, result = frequency(text.replace("find: equilibrium", "find: equilibrium\n  closure_tolerance: 2e-5"))
    if off > 1e-11:
        assert any("joint 'D' (" in x and "it is left out" in x for x in result.warnings)
    assert abs(found.value - exact.value) <= found.error_bound + exact.error_bound + 100.0 * off
    assert result.verdict == "stable"


def test_the_tolerance_belongs_to_the_loop_and_not_to_the_scene():
    """A body 1000 m away makes no row negligible: the loop of 0.4 m is open by 1e-8 m."""
    text = LOOP.format(a=0.2, b=0.4, c=0.2, d=0.4, off=1e-8, tilt=0, lean=0)
    far = "ground: {points: {F: [1000, 0, 0], "
    far = text.replace("ground: {points: {", far).replace("bodies:\n", "bodies:\n  f: {type: point, mass: 1}\n")
    far = far.replace("joints:\n", "joints:\n  F: {type: spherical, between: [f, ground.F]}\n")
    for model in (text, far):
        with pytest.raises(ModelFileError, match=r"joint 'D' \(.*\) repeats .* contradicts them by 1e-08 m"):
            mbstab.loads(model).eig()


@pytest.fixture
def open_loop():
    text = LOOP.format(a=0.2, b=0.4, c=0.2, d=0.4, off=1e-7, tilt=0, lean=0)
    return mbstab.loads(text.replace("find: equilibrium", "find: equilibrium\n  closure_tolerance: 2e-7"))


def test_a_row_that_is_left_out_is_no_constraint_anywhere(open_loop):
    exact = [x.value for x in open_loop.eig(off=0.0).eigenvalues]
    swept = open_loop.sweep("g", np.linspace(9.0, 10.0, 3))
    at_9 = open_loop.eig(g=9.0).eigenvalues
    np.testing.assert_allclose(sorted(np.abs(swept.branches[0])), sorted(abs(e.value) for e in at_9), rtol=1e-9)
    precise = open_loop.eig_precise(16).values()
    np.testing.assert_allclose(sorted(float(s.imag) for s in precise), sorted(s.imag for s in exact), atol=1e-5)
    motion = open_loop.simulate(0.2, points=3, perturb={"a.theta": 0.01})
    assert np.all(np.isfinite(motion.q))
    assert "left out" in " ".join(open_loop.check().warnings)


def test_a_true_constraint_is_never_left_out():
    # Beside its change point a parallelogram has rows that nearly repeat each other, and hold exactly.
    from test_found_reference import PARALLELOGRAM

    text = PARALLELOGRAM.replace("rest: -r", "rest: 2*angle - r")
    model = mbstab.loads(text)
    assert model.system(angle=1e-5).n_h == 8


STEERED = """
mbstab: 1
parameters: {v: {value: 2, unit: m/s}}
bodies:
  cart: {type: planar, mass: 100, inertia: 20, points: {rear: [-0.5, 0], L: [0.5, 0.3], R: [0.5, -0.3]}}
  left: {type: planar, mass: 1, inertia: 0.01}
  right: {type: planar, mass: 1, inertia: 0.01}
joints:
  kl: {type: revolute, between: [left, cart.L]}
  kr: {type: revolute, between: [right, cart.R]}
constraints: {rod: {holonomic: angle(kl) - angle(kr)}}
contacts:
  rear: {type: knife_edge, at: cart.rear, along: x}
  l: {type: knife_edge, at: left, along: x}
  r: {type: knife_edge, at: right, along: x}
reference:
  coordinates: {cart: {x: 0, y: 0, theta: 0}, left: {theta: 0}, right: {theta: 0}}
  rates: {cart: {x: v, y: 0, theta: 0}, left: {theta: 0}, right: {theta: 0}}
"""


def test_a_row_that_repeats_others_at_the_reference_only_is_needed():
    # Wheels that steer by the same angle have no common centre of turning: beside straight ahead they lock.
    model = mbstab.loads(STEERED)
    assert not [text for text in model.check().unneeded if "contact" in text]
    with pytest.raises(UsageError, match=r"stop the motion there: rate\(cart.x\) = 2 m/s becomes 0"):
        model.simulate(1.0, perturb={"left.theta": 0.1})


def test_a_speed_that_such_rows_take_away_is_an_error_beside_speeds_that_stay():
    text = STEERED.replace("bodies:\n", "bodies:\n  fan: {type: planar, mass: 1, inertia: 0.1}\n")
    text = text.replace("joints:\n", "joints:\n  hub: {type: revolute, between: [fan, cart]}\n")
    model = mbstab.loads(text.replace("rates: {", "rates: {fan: {theta: 50}, "))
    with pytest.raises(UsageError, match=r"stop the motion there: rate\(\w+.x\) = 2 m/s becomes 0"):
        model.simulate(0.1, perturb={"left.theta": 0.1})


def test_what_repeats_others_everywhere_takes_no_speed_away(open_loop):
    swung = open_loop.simulate(0.1, points=2, perturb={"a.theta": 0.3, "rate(a.theta)": 1.0}, off=0.0)
    assert np.all(np.isfinite(swung.q))
