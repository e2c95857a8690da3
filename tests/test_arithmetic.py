"""Arithmetics of the program: numbers with slopes, values with time derivatives, least squares."""

from pathlib import Path

import mpmath
import numpy as np
import pytest
import sympy
from mpmath import mp
from mpmath_numbers import mpmath_arithmetic

import mbstab
from mbstab.analysis.algebra.arrays import least_squares
from mbstab.analysis.algebra.refining import Stalled
from mbstab.analysis.algebra.slopes import Slopes
from mbstab.model.arithmetic import FLOAT, array_arithmetic, symbol_arithmetic
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


# --- values with their first two time derivatives, against differences in many digits ---------------------------------


TIME = 0.4375  # exact in binary
TEXTS = {
    **{name: f"{name}(0.25 + t**2)" for name, entry in FUNCTIONS.items() if entry.arguments == 1},
    "abs of a negative number": "abs(t**2 - 3)",
    "tan beyond a right angle": "tan(2 + t)",
    "atan2 in each argument": "atan2(1 - 2*t, t**2 - 3)",
    "atan2 across the axis": "atan2(t - 0.4375, t + 1)",
    "smooth_start before": "smooth_start(t - 2)*t + t**3",
    "smooth_start after": "smooth_start(t + 2)*t**2",
    "sum": "t + 3 + (1 - t**2) - (2 - t)",
    "product": "t**3*(1 - t)*(t + 5)",
    "quotient": "(1 + t**2)/(3 - t)/t",
    "number over jet": "1/t**3 - 2/(1 + t)",
    "square": "(1 - 3*t)**2",
    "power zero": "(1 - 3*t)**0 + t",
    "power one": "(1 - 3*t)**1",
    "negative power": "(1 - 3*t)**-3",
    "fractional power": "(1 + 3*t)**2.5",
    "power to the time": "2**t + 0.5**(t**2)",
    "time to the time": "(1 + t)**(2*t)",
    "constant power of a constant": "0**0.5*t + sqrt(0)*t**2 + abs(0)*t",
    "chain": "exp(sin(3*t)*log(2 + cos(t)))/sqrt(1 + tanh(t)**2)",
    "harmonic": "0.1*sin(2*pi*3*t + 30*deg)*smooth_start(t/2)",
}


def expected(text):
    """Return value, first and second derivative by differences in 40 digits."""
    expression, f = parse(text), mpmath_arithmetic()
    with mpmath.workdps(40):
        return [mpmath.diff(lambda t: expression.evaluate({"t": t}, f), mpmath.mpf(TIME), n) for n in range(3)]


def assert_jet(jet, values, tolerance):
    for found, value in zip((jet.value, jet.rate, jet.second), values, strict=True):
        assert abs(found - value) <= tolerance * max(abs(value), mpmath.mpf("0.01"))


@pytest.mark.parametrize("text", TEXTS.values(), ids=TEXTS)
def test_a_law_has_its_derivatives_in_floats(text):
    jet = parse(text).evaluate({"t": Jet(TIME, 1.0, 0.0)}, jet_arithmetic(FLOAT))
    assert_jet(jet, expected(text), 1e-12)


@pytest.mark.parametrize("text", TEXTS.values(), ids=TEXTS)
def test_a_law_has_its_derivatives_in_30_digits(text):
    values = expected(text)
    with mpmath.workdps(30):
        time = Jet(mpmath.mpf(TIME), mpmath.mpf(1), mpmath.mpf(0))
        jet = parse(text).evaluate({"t": time}, jet_arithmetic(mpmath_arithmetic()))
        assert_jet(jet, values, mpmath.mpf("1e-20"))


@pytest.mark.parametrize("text", TEXTS.values(), ids=TEXTS)
def test_a_law_has_its_derivatives_in_arrays(text):
    times = np.array([TIME, TIME / 2])
    f = jet_arithmetic(array_arithmetic())
    jet = parse(text).evaluate({"t": Jet(times, 1.0, 0.0)}, f)
    first = Jet(*(np.broadcast_to(x, 2)[0] for x in (jet.value, jet.rate, jet.second)))
    assert_jet(first, expected(text), 1e-12)


@pytest.mark.parametrize("text", TEXTS.values(), ids=TEXTS)
def test_a_law_has_its_derivatives_in_symbols(text):
    time = Jet(sympy.Rational(7, 16), sympy.Integer(1), sympy.Integer(0))
    jet = parse(text).evaluate({"t": time}, jet_arithmetic(symbol_arithmetic()))
    with mpmath.workdps(30):
        exact = Jet(*(mpmath.mpf(sympy.N(x, 30)) for x in (jet.value, jet.rate, jet.second)))
        assert_jet(exact, expected(text), mpmath.mpf("1e-20"))


@pytest.mark.parametrize("name", [*FUNCTIONS, "power"])
def test_a_function_of_a_moving_argument_obeys_the_chain_rule(name):
    # An argument with second derivative, which a function of t alone does not test.
    count = 2 if name == "power" else FUNCTIONS[name].arguments
    moving = [Jet(0.4, 0.7, -1.3), Jet(0.9, -0.6, 0.8), Jet(1.3, 0.5, -0.9), Jet(0.2, 0.1, 0.3)][:count]
    jet = getattr(jet_arithmetic(FLOAT), name)(*moving)
    f = mpmath_arithmetic()
    with mpmath.workdps(40):

        def along(t):
            return getattr(f, name)(*(x.value + x.rate * t + mpmath.mpf(x.second) / 2 * t**2 for x in moving))

        assert_jet(jet, [mpmath.diff(along, 0, n) for n in range(3)], 1e-12)


@pytest.mark.parametrize("operation", ["+", "-", "*", "/", "**"])
@pytest.mark.parametrize("order", ["jet first", "number first"])
def test_a_jet_and_a_plain_number_combine_in_either_order(operation, order):
    text = f"t {operation} x" if order == "jet first" else f"x {operation} t"
    f = jet_arithmetic(FLOAT)
    mixed = parse(text).evaluate({"t": Jet(0.5, 1.0, 0.0), "x": 3.0}, f)
    whole = parse(text).evaluate({"t": Jet(0.5, 1.0, 0.0), "x": Jet(3.0)}, f)
    assert mixed == whole
    assert mixed.rate != 0.0


@pytest.mark.parametrize("text", ["sqrt(x)", "x**0.5", "abs(x)", "x**1.5", "asin(1 + x)", "acos(1 + x)", "x**-x"])
def test_a_constant_at_the_edge_of_a_function_has_no_rate(text):
    if text == "x**-x":  # 0**0
        text = "x**x"
    jet = Jet.of(parse(f"({text})*t").evaluate({"x": 0.0, "t": Jet(2.0, 1.0, 0.0)}, jet_arithmetic(FLOAT)))
    constant = parse(text).evaluate({"x": 0.0}, FLOAT)
    assert (jet.value, jet.rate, jet.second) == (2 * constant, constant, 0.0)


@pytest.mark.parametrize("text", ["sqrt(t)", "t**0.5", "t**1.5", "asin(1 + t)", "log(t)", "t**t", "1/t"])
def test_a_law_without_a_second_derivative_at_the_time_is_refused(text):
    with pytest.raises(ExpressionError, match="the expression has no value here"):
        parse(text).evaluate({"t": Jet(0.0, 1.0, 0.0)}, jet_arithmetic(FLOAT))


@pytest.mark.parametrize("text", ["t", "t**2", "t**3 + 1", "t*t", "(t - 1)**2"])
def test_a_polynomial_has_its_derivatives_at_time_zero(text):
    jet = parse(text).evaluate({"t": Jet(0.0, 1.0, 0.0)}, jet_arithmetic(FLOAT))
    t = sympy.Symbol("t")
    polynomial = sympy.sympify(text)
    assert [jet.value, jet.rate, jet.second] == [float(polynomial.diff(t, n).subs(t, 0)) for n in range(3)]


def test_a_constant_law_is_a_jet_at_rest():
    assert Jet.of(parse("3*L").evaluate({"L": 2.0}, jet_arithmetic(FLOAT))) == Jet(6.0, 0.0, 0.0)
    assert Jet.of(2.0).constant
    assert not Jet(2.0, 0.0, 1.0).constant
    assert not Jet(2.0, np.array([0.0, 1.0])).constant


# --- least squares of what has no value are an error, without a word of the libraries below ---------------------------


@pytest.mark.parametrize("wrong", [np.nan, np.inf])
def test_what_is_not_finite_is_an_error_that_prints_nothing(wrong, capfd):
    with pytest.raises(np.linalg.LinAlgError, match="not finite"):
        least_squares(np.array([[1.0, wrong], [0.0, 1.0]]), np.ones(2))
    assert tuple(capfd.readouterr()) == ("", "")


def test_the_shortest_of_all_solutions():
    A = np.array([[1.0, 1.0], [1.0, 1.0], [0.0, 1e-14]])
    assert least_squares(A, np.array([2.0, 2.0, 0.0]), rcond=1e-10) == pytest.approx([1.0, 1.0])


def test_least_squares_have_one_place():
    files = Path(mbstab.__file__).parent.rglob("*.py")
    assert [x.name for x in files if "lstsq" in x.read_text(encoding="utf-8")] == ["arrays.py"]
