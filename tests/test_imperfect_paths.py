"""Paths of equilibria past imperfect pitchforks and transcritical bifurcations, against roots of the polynomial."""

import math
from itertools import product

import numpy as np
import pytest
from sampling import sample

import mbstab
from mbstab.analysis.reference import continuation
from mbstab.analysis.reference.paths import PathEnd

RAIL = """\
mbstab: 1
parameters: {q: 0}
bodies:
  p: {type: planar_point, mass: 1}
constraints:
  rail: {holonomic: p.y}
forces:
  f: {type: expression, on: {p.x: LOAD - rate(p.x)}}
reference: {find: equilibrium, guess: {p: {x: 0, y: 0}}}
"""

ROD = """\
mbstab: 1
parameters: {m: 1, k: 4}
gravity: [0, -10]
bodies: {rod: {type: planar, mass: m, inertia: 0.1, points: {O: [0, -1]}}}
joints: {pivot: {type: revolute, between: [rod.O, ground]}}
forces: {hinge: {type: joint_spring, joint: pivot, stiffness: k, damping: 1, rest: 5.0e-4}}
reference: {find: equilibrium, guess: {rod: {x: 0, y: 1, theta: 0}}}
"""

FUNCTIONS = ["table", "spline", "linear"]
SIZES = [1e-2, 2e-3, 1e-3, 1e-4, 1e-6, 1e-8]
BOTH = [1.0, -1.0]


def rail(power, e):
    return mbstab.loads(RAIL.replace("LOAD", f"q*p.x - p.x**{power} + ({e!r})"))


def equilibrium(power, e, up, q):
    """Return the root of q x - x**power + e on the path that begins at q = -1 (up) or 1; None beyond its fold."""
    if power == 2:
        square = q * q + 4.0 * e
        if square < 0.0 or (e < 0.0 and q * up > 0.0):
            return None
        far = 0.5 * (q - up * math.sqrt(square))
        return 0.5 * (q + up * math.sqrt(square)) if q * up > 0.0 else -e / far
    roots = np.roots([-1.0, 0.0, q, e])
    real = np.sort(roots.real[np.abs(roots.imag) < 1e-13 * np.max(np.abs(roots))])
    if up > 0.0:
        return float(real[-1] if e > 0.0 else real[0])
    return float(real[1]) if q > 3.0 * (0.5 * abs(e)) ** (2.0 / 3.0) else None


@pytest.mark.parametrize(("size", "power", "up", "sign"), sample(product(SIZES, [2, 3], BOTH, BOTH), 7))
def test_an_imperfect_bifurcation_is_followed_on_one_branch(size, power, up, sign):
    e = sign * size
    path = continuation.follow(rail(power, e).model, "q", -1.0, 1.0, first_at=-up)
    assert path.crossings == ()
    folds = path.ends
    for q, x in zip(path.values.tolist(), path.q[:, 0].tolist(), strict=True):
        # At the fold itself the roots are equal.
        exact = None if any(q == fold for fold, _ in folds) else equilibrium(power, e, up, q)
        if exact is not None:
            assert abs(x - exact) < 1e-7
        else:
            assert any(abs(q - fold) < 1e-9 for fold, _ in folds)
    if power == 3 and up < 0.0:
        assert [fold for fold, _ in folds] == pytest.approx([3.0 * (0.5 * size) ** (2.0 / 3.0)], rel=1e-6)
    elif power == 2 and e < 0.0:
        assert [fold for fold, _ in folds] == pytest.approx([-2.0 * up * math.sqrt(size)], rel=1e-6)
    else:
        assert (path.values[0], path.values[-1], folds) == (-1.0, 1.0, ())


TWO_RAILS = """\
mbstab: 1
parameters: {q: 0}
bodies:
  p: {type: planar_point, mass: 1}
  r: {type: planar_point, mass: 1}
constraints:
  one: {holonomic: p.y}
  other: {holonomic: r.y}
forces:
  f:
    type: expression
    on: {p.x: q*p.x - p.x**3 + ONE - rate(p.x), r.x: (q - LATER)*r.x - r.x**3 + (OTHER) - rate(r.x)}
reference: {find: equilibrium, guess: {p: {x: 0, y: 0}, r: {x: 0, y: 0}}}
"""


@pytest.mark.parametrize(("later", "part"), sample([(0.0, 1.0), (0.0, -1.0), (1e-2, 0.5)], 3))
def test_two_eigenvalues_that_change_sign_together_are_no_way_to_another_path(part, later):
    size, other = 1e-3, part * 1e-3
    text = TWO_RAILS.replace("ONE", repr(size)).replace("OTHER", repr(other)).replace("LATER", repr(later))
    values = np.linspace(-1.0, 1.0, 15)
    swept = mbstab.loads(text).sweep("q", values)
    assert set(swept.unstable) == {0}
    # At the end both rest where their loads push them: q x - x^3 + e = 0, x of the sign of e.
    expected = []
    for e, q in ((size, 1.0), (other, 1.0 - later)):
        roots = np.roots([1.0, 0.0, -q, -e])
        x = max(roots[np.abs(roots.imag) < 1e-9].real, key=lambda root: root * np.sign(e))
        expected += list(np.roots([1.0, 1.0, 3.0 * x * x - q]))
    found = np.sort_complex(np.round(swept.branches[-1], 9))
    np.testing.assert_allclose(found, np.sort_complex(np.round(expected, 9)), atol=2e-9)


IMPERFECT = [(3, 1e-3, 1.0), (3, 1e-8, 1.0), (3, 1e-4, -1.0), (2, 1e-3, 1.0), (2, -1e-4, 1.0)]


@pytest.mark.parametrize(("imperfect", "points"), sample(product(IMPERFECT, [15, 41, 401]), 4))
def test_a_sweep_past_an_imperfect_bifurcation_answers_for_one_branch(imperfect, points):
    power, e, up = imperfect
    result = rail(power, e).sweep("q", np.linspace(-up, up, points))
    for q, count, values in zip(result.values, result.unstable, result.branches, strict=True):
        x = None if abs(q + 0.02) < 1e-12 and e < 0.0 else equilibrium(power, e, up, float(q))  # -0.02: the fold
        assert count == (-1 if x is None else int(up < 0.0))
        if x is not None:
            assert abs(np.prod(values) + q - power * x ** (power - 1)) < 1e-9
    folds = [3.0 * (0.5 * e) ** (2.0 / 3.0)] if power == 3 and up < 0.0 else [-0.02] if e < 0.0 else []
    assert [c.kind for c in result.critical] == ["fold"] * len(folds)
    assert [c.value for c in result.critical] == pytest.approx(folds, rel=1e-9)


def test_a_rod_on_a_spring_that_is_not_quite_upright_stays_stable():
    result = mbstab.loads(ROD).sweep("m", np.linspace(0.1, 0.8, 15))
    assert result.critical == ()
    assert result.problems == {}
    assert set(result.unstable) == {0}
    # k (theta - rest) = m g sin(theta)
    for m, values in zip(result.values, result.branches, strict=True):
        low, high = 1e-4, math.pi
        for _ in range(60):
            theta = 0.5 * (low + high)
            low, high = (theta, high) if 4.0 * (theta - 5e-4) < 10.0 * m * math.sin(theta) else (low, theta)
        stiffness = (4.0 - 10.0 * m * math.cos(theta)) / (m + 0.1)
        assert np.prod(values).real == pytest.approx(stiffness, rel=1e-7)


def test_the_path_ends_where_branches_cannot_be_told_apart(monkeypatch):
    monkeypatch.setattr(continuation._Curve, "_cross", lambda self, run, *ends: False)
    result = rail(3, 0.0).sweep("q", np.linspace(-1.0, 1.0, 14))
    assert set(result.unstable[:7]) == {0}
    assert set(result.unstable[7:]) == {-1}
    assert all(PathEnd.UNSURE in message for message in result.problems.values())
    assert [c.kind for c in result.critical] == ["unresolved"]


def test_a_path_ends_where_the_equations_do():
    """Beyond p = 1/3 the load has no value."""
    text = """
mbstab: 1
parameters: {p: 0}
bodies: {a: {type: planar_point, mass: 1}}
constraints: {rail: {holonomic: a.y}}
forces: {load: {type: expression, on: {a.x: -a.x - 0.1*rate(a.x) + (1/3 - p)**1.5}}}
reference: {find: equilibrium, guess: {a: {x: 0}}}
"""
    for values in (np.linspace(0.0, 1.0, 11), np.linspace(0.3, 1.0, 4)):
        (end,) = mbstab.loads(text).sweep("p", values).critical
        assert end.kind == "end of the equations"
        assert end.value == round(1 / 3, 11)


LAW = """\
mbstab: 1
parameters: {F: {value: 0, unit: N}}
tables: {law: {x: [-0.2, 0, 0.1, 0.2], y: [-8, 0, 4, 9]}}
bodies: {b: {type: planar_point, mass: 1}}
constraints: {rail: {holonomic: b.y}}
forces: {s: {type: expression, on: {b.x: "F - FUNCTION(b.x, law) - rate(b.x)"}}}
reference: {find: equilibrium, guess: {b: {x: 0.01}}}
"""

SLIDER = """\
mbstab: 1
parameters: {F: {value: 0, unit: N}}
bodies: {b: {type: planar, mass: 1, inertia: 1}}
constraints: {heading: {holonomic: b.theta}, cruise: {nonholonomic: rate(b.x) - 7}}
forces:
  s: {type: expression, on: {b.y: F - 5*b.y - rate(b.y)}}
  wheel: {type: tyre, at: b, along: [cos(0.1), sin(0.1)], cornering_stiffness: 3 - 2*b.y}
reference: {find: steady, steady: {direction: x, speed: 7}, guess: {b: {y: 0}}}
"""


@pytest.mark.parametrize(
    ("text", "last", "end", "why"),
    [
        # The table ends at x = 0.2 with 9 N and at x = -0.2 with -8 N.
        *(
            (LAW.replace("FUNCTION", name), 12.0, 9.0, "forces.s has no finite equations here (0.200000")
            for name in FUNCTIONS
        ),
        (LAW.replace("FUNCTION", "table"), -11.0, -8.0, "is outside the table 'law', which goes from -0.2 to 0.2)"),
        # Without stiffness the wheel carries nothing at y = 1.5, and the spring 7.5 N.
        (SLIDER, 10.0, 7.5, "forces.wheel has no finite equations here (a function has no real value there; corn"),
    ],
)
def test_the_end_of_the_equations_is_no_loss_of_equilibrium(text, last, end, why):
    result = mbstab.loads(text).sweep("F", np.linspace(0.1 * last, last, 9))
    assert [(c.kind, c.value, c.branches) for c in result.critical] == [("end of the equations", end, ())]
    assert [i in result.problems for i in range(9)] == [abs(x) > abs(end) for x in result.values]
    assert all(x.startswith(f"the equations end at F = {end:g} N on this path: ") for x in result.problems.values())
    assert all(why in x for x in result.problems.values())
    assert "end of the equations" in str(result)
    assert "the equations end at F" in str(result)


def test_an_equilibrium_that_is_lost_where_the_equations_go_on():
    """The force of the spring falls from 3 N on."""
    law = LAW.replace("FUNCTION(b.x, law)", "(3 - 40*abs(b.x - 0.075))")
    (end,) = mbstab.loads(law).sweep("F", np.linspace(0.0, 8.0, 10)).critical
    assert end.kind == "loss of equilibrium"
    assert end.value == pytest.approx(3.0, abs=1e-9)
