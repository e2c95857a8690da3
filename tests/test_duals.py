"""Numbers with slopes: derivatives by many variables at once, in any number system."""

import numpy as np
import pytest
from mpmath import mp

from mbstab.analysis.algebra.refining import Stalled
from mbstab.analysis.algebra.slopes import Slopes
from mbstab.model.arithmetic import FLOAT, mpmath_arithmetic
from mbstab.model.duals import Dual, dual_arithmetic
from mbstab.model.expressions import ExpressionError, parse
from mbstab.model.functions import FUNCTIONS
from mbstab.model.jets import Jet, jet_arithmetic

DUALS = dual_arithmetic(FLOAT)
EXPRESSIONS = [
    "a*b + a/b - b/3 + 2/a - (1 - b)",
    "-a**3 + a**b + 2**b + a**(-0.5)",
    "sin(a*b)*exp(-b)/sqrt(1 + a**2)",
    *(f"{name}(a*b{', b' * (f.arguments - 1)})" for name, f in FUNCTIONS.items()),
]


@pytest.mark.parametrize("text", EXPRESSIONS)
def test_slopes_are_those_of_differences_of_40_digits(text):
    at, f = {"a": "0.7", "b": "0.6"}, mpmath_arithmetic()
    seeds = {"a": Dual(0.7, np.array([1.0, 0.0])), "b": Dual(0.6, np.array([0.0, 1.0]))}
    found = parse(text).evaluate(seeds, DUALS)
    with mp.workdps(40):
        h = mp.mpf("1e-13")

        def value(name, step):
            return parse(text).evaluate({k: mp.mpf(x) + step * (k == name) for k, x in at.items()}, f)

        slopes = [float((value(name, h) - value(name, -h)) / (2 * h)) for name in at]
        assert found.value == pytest.approx(float(value("", 0)), rel=1e-14)
    np.testing.assert_allclose(found.slope, slopes, rtol=1e-13, atol=1e-14)


def test_the_rates_of_a_law_have_slopes():
    seed = Dual(0.0, np.array([1.0]))  # sin(w t) at w = 0: the rate is zero, its slope is not
    jet = parse("sin(w*t) + t**3").evaluate({"w": seed, "t": Jet(0.5, 1, 0)}, jet_arithmetic(DUALS))
    assert [x.value for x in (jet.value, jet.rate, jet.second)] == [0.125, 0.75, 3.0]
    assert [float(x.slope[0]) for x in (jet.value, jet.rate, jet.second)] == [0.5, 1.0, 0.0]


@pytest.mark.parametrize("text", ["abs(a)", "sqrt(a)", "hypot(a, 0*a)"])
def test_a_kink_has_no_slope_unless_its_argument_stays_there(text):
    assert parse(text).evaluate({"a": Dual(0.0, np.zeros(1))}, DUALS).value == 0.0
    with pytest.raises(ExpressionError, match="no value here"):
        parse(text).evaluate({"a": Dual(0.0, np.ones(1))}, DUALS)


def test_a_number_is_zero_only_if_it_stays_zero():
    assert Dual(0.0, np.ones(1))
    assert not Dual(0.0, np.zeros(1))
    assert Dual(0.0, np.ones(1)) != 0.0
    assert Dual(1.0, np.zeros(1)) == 1.0
    assert abs(Dual(-2.0, np.ones(1))).slope[0] == -1.0
    assert (Dual(3.0, np.ones(1)) ** 2).slope[0] == 6.0


def test_matrix_products_and_newton_steps_have_slopes():
    f = Slopes(np.ones(2))
    p, r = Dual(2.0, np.array([1.0, 0.0])), Dual(3.0, np.array([0.0, 1.0]))
    A = np.array([[p, 1.0], [0.5, r]], dtype=object)
    values, slopes = f.parts(f.times(A, A, np.array([1.0, 2.0])))
    np.testing.assert_allclose(values, [14.5, 21.5])  # A² (1, 2) with A² = [[p² + 1/2, p + r], [(p + r)/2, r² + 1/2]]
    np.testing.assert_allclose(slopes, [[6.0, 0.5], [2.0, 12.5]])
    inverse = np.linalg.inv(f.values(A).astype(float)) * (1.0 + 1e-9)  # each step leaves an error of 1e-9
    x = f.solved(A, np.array([1.0, 2.0]), inverse)
    determinant, expected = 5.5, np.array([1.0, 3.5]) / 5.5
    np.testing.assert_allclose(f.parts(x)[0], expected, rtol=1e-15)
    np.testing.assert_allclose(
        f.parts(x)[1][0], [-3.0 / determinant * expected[0], 2.0 / determinant - 3.0 / determinant * expected[1]],
        rtol=1e-14,
    )  # fmt: skip
    with pytest.raises(Stalled):
        f.solved(A, np.array([1.0, 2.0]), -inverse)
