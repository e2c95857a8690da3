"""N four-bar loops side by side (IFToMM benchmark A02): long mechanisms of one degree of freedom, and one in singular
configurations.

Gonzalez, Dopico, Gonzalez, Cuadrado (2006), A benchmarking system for MBS simulation software.
"""

import functools
import math
import re

import numpy as np
import pytest
from chains import four_bar_loops

import mbstab
from mbstab.errors import ConstraintError

LOOPS = (1, 2, 10, 40)
# As printed from the closed form with more digits than a double has.
DIGITS = {1: 3.43103482931899, 2: 3.38304596480745, 10: 3.33556226291102, 40: 3.32552242194847}


def omega(loops):
    # Cranks about their ends, couplers that move with the pins and do not turn.
    return math.sqrt(9.81 * ((loops + 1) / 2 + loops) / ((loops + 1) / 3 + loops))


@functools.cache
def answer(loops, angle, solved=False):
    return mbstab.loads(four_bar_loops(loops, angle, solved)).eig()


def assert_pair(result, expected):
    """The two eigenvalues are ±expected, within their error bounds and to twelve digits."""
    found = sorted(result.values(), key=lambda s: (s / expected).real)
    np.testing.assert_allclose(found, [-expected, expected], rtol=1e-12)
    for e in result.eigenvalues:
        assert min(abs(e.value - expected), abs(e.value + expected)) <= e.error_bound < 1e-11


@pytest.mark.parametrize("loops", LOOPS)
def test_the_closed_form_has_the_digits_of_the_literature(loops):
    assert omega(loops) == pytest.approx(DIGITS[loops], rel=1e-14)


@pytest.mark.parametrize("solved", [False, True], ids=["given", "assembled"])
@pytest.mark.parametrize("loops", LOOPS)
def test_hanging_loops_swing_with_the_frequency_of_the_closed_form(loops, solved):
    result = answer(loops, "-pi/2", solved)
    assert_pair(result, 1j * omega(loops))
    assert result.verdict == "stable"
    assert (result.counts.expected, result.counts.found, result.counts.neutral) == (2, 2, 0)


@pytest.mark.parametrize("solved", [False, True], ids=["given", "assembled"])
@pytest.mark.parametrize("loops", LOOPS)
def test_upright_loops_fall_with_the_same_rate(loops, solved):
    result = answer(loops, "pi/2", solved)
    assert_pair(result, omega(loops))
    assert result.verdict == "unstable"


@pytest.mark.parametrize("loops", LOOPS)
def test_loops_have_one_degree_of_freedom_and_no_redundant_row(loops):
    report = mbstab.loads(four_bar_loops(loops, "-pi/2")).check()
    assert report.redundant == []
    counts = answer(loops, "-pi/2").counts
    assert (counts.n_q, counts.n_holonomic, counts.rank_holonomic) == (6 * loops + 3, 6 * loops + 2, 6 * loops + 2)


@pytest.mark.parametrize("gravity", ["[0, -9.81]", "[0, 0]"], ids=["heavy", "weightless"])
@pytest.mark.parametrize("angle", ["0", "pi"], ids=["right", "left"])
@pytest.mark.parametrize("loops", LOOPS)
def test_flat_loops_are_refused_and_their_joints_named(loops, angle, gravity):
    # The cranks lie in one line with the couplers: each loop may fold in two ways, and the rank drops by one a loop.
    # pi is no round number: the rank is decided in spite of the rounding of its sine.
    text = re.sub(r'"gravity": \[[^]]*\]', f'"gravity": {gravity}', four_bar_loops(loops, angle))
    with pytest.raises(ConstraintError, match="singular configuration") as caught:
        mbstab.loads(text).eig()
    named = set(re.findall(r"joint '(\w+)'", str(caught.value)))
    assert named
    assert named <= set(mbstab.loads(text).model.entries["joints"])
