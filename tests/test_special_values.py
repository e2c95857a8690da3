"""Structure that holds at special values of a parameter is not carried to others, however few points have it."""

from itertools import product

import numpy as np
import pytest
from sampling import sample

import mbstab
from mbstab.analysis.sweep.batched_verdict import WORD
from mbstab.analysis.verdict.rule import STRENGTH, WORDS

NAME = {number: word for word, number in WORD.items()}
WINDOW = "smooth_start((q-1.3)/0.1)*smooth_start((1.7-q)/0.1)"
RAIL = "point_on_line, between: [ground, p], axis: x"


def rail(force, k, more=""):
    """Return the text of a point on a rail; x, u: place and speed, k: a coefficient that depends on q and b."""
    force = force.replace("x", "p.x").replace("u", "rate(p.x)")
    return (
        f"mbstab: 1\nparameters: {{q: 1, b: 0, k: {k}}}\nbodies:\n  p: {{type: planar_point, mass: 1}}\n"
        f"joints:\n  r: {{type: {RAIL}}}\nforces:\n  f: {{type: expression, on: {{p.x: '{force}'}}}}\n"
        "reference:\n  coordinates: {p: {x: 0, y: 0}}\n"
    )


FORCES = ["-u + k*x**3", "-u - k*x**3", "-x + k*u**3", "-x - k*u**3", "-x + k*u*x**2", "-x - u + k*x**2", "-u + k*x*u"]


COEFFICIENTS = [WINDOW, f"-{WINDOW}", "abs(q-1)+q-1", "(q-1)**2"]


@pytest.mark.parametrize(("k", "force"), sample(product(COEFFICIENTS, FORCES), 18))
def test_a_term_that_is_zero_elsewhere_counts(k, force):
    model = mbstab.loads(rail(force, k))
    values = np.linspace(0.0, 2.0, 21)
    swept = model.sweep("q", values)
    for q, word in zip(values, swept.words, strict=True):
        single = model.eig(q=float(q)).verdict
        assert NAME[word] in STRENGTH[single], (q, NAME[word], single)
    assert {NAME[word] for word in swept.words} <= set(WORDS)


def test_growth_between_damped_ranges_is_found():
    swept = mbstab.loads(rail("-u + k*x**3", WINDOW)).sweep("q", np.linspace(0.0, 2.0, 41))
    inside = (swept.values > 1.31) & (swept.values < 1.69)
    assert {NAME[word] for word in swept.words[inside]} == {"unstable"}
    assert "unstable" not in {NAME[word] for word in swept.words[~inside]}


@pytest.mark.parametrize("order", [("q", "b"), ("b", "q")])
def test_a_triangle_of_a_chart_is_not_taken_for_the_rest(order):
    model = mbstab.loads(rail("-u + k*x**3", "abs(b-q)+b-q"))
    values = np.linspace(0.0, 1.0, 6)
    found = model.chart(dict.fromkeys(order, values))
    assert found.parameters == order
    for row, second in zip(found.verdicts, values, strict=True):
        for word, first in zip(row, values, strict=True):
            at = dict(zip(order, (first, second), strict=True))
            assert (word in ("unstable", "undecided")) == (at["b"] > at["q"]), (at, word)
