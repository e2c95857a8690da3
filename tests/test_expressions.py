"""The arithmetic of model files: grammar, precedence, messages with places, limits, number systems."""

import math
import time
from itertools import product

import mpmath
import numpy as np
import pytest
import sympy
from mpmath_numbers import mpmath_arithmetic

from mbstab.compiler.tape import Tape
from mbstab.model.arithmetic import (
    CONSTANTS,
    FLOAT,
    array_arithmetic,
    symbol_arithmetic,
)
from mbstab.model.expressions import MAX_CHAIN, MAX_DEPTH, MAX_LENGTH, ExpressionError, Number, parse
from mbstab.model.functions import CALLED, FUNCTIONS, TABLE
from mbstab.model.jets import Jet, jet_arithmetic


def value(text, **names):
    return parse(text).evaluate(names, FLOAT)


# --- grammar and precedence -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("-2**2", -4.0),
        ("(-2)**2", 4.0),
        ("2**3**2", 512.0),
        ("(2**3)**2", 64.0),
        ("2**-1", 0.5),
        ("2**-1**2", 0.5),
        ("2**+3", 8.0),
        ("-2**-2", -0.25),
        ("2*-3", -6.0),
        ("2--3", 5.0),
        ("--3", 3.0),
        ("+-+3", -3.0),
        ("1 - 2 - 3", -4.0),
        ("24/4/3", 2.0),
        ("24/4*3", 18.0),
        ("2 + 3*4**2", 50.0),
        ("(2 + 3)*4", 20.0),
        ("-3*2 + 1", -5.0),
        ("4*-2**2", -16.0),
        ("atan2(1, 0)*2/pi", 1.0),
        ("90*deg/pi", 0.5),
        ("abs(-3)", 3.0),
        ("\t1 \n+ 1 ", 2.0),
    ],
)
def test_an_expression_has_the_value_that_mathematics_gives(text, expected):
    assert value(text) == pytest.approx(expected, rel=1e-15, abs=0)


@pytest.mark.parametrize("text", ["0", "12", "0.5", ".5", "5.", "1e3", "1E3", "1.5e-3", "2.e+02", "0.0e+00", "007"])
def test_a_literal_is_read_as_python_reads_floats(text):
    expression = parse(text)
    assert expression.literal
    assert expression.evaluate({}, FLOAT) == float(text)


@pytest.mark.parametrize(
    ("text", "literal"), [("-2", True), ("+2", True), ("2", True), ("1+1", False), ("pi", False), ("--2", False)]
)
def test_a_literal_is_a_number_with_at_most_one_sign(text, literal):
    assert parse(text).literal is literal


def test_a_literal_keeps_all_its_digits():
    text = "0.1234567890123456789012345678901234567890"
    with mpmath.workdps(50):
        assert parse(text).evaluate({}, mpmath_arithmetic()) == mpmath.mpf(text)
    assert parse(text).evaluate({}, symbol_arithmetic()) == sympy.Rational(text)


def test_names_and_rates_are_listed_with_the_place_of_their_first_use():
    expression = parse("L*rod.x + rate(rod.x) - L*pi*rate(rod.theta) + t")
    assert expression.names() == {"L": 0, "rod.x": 2, "t": 47}
    assert expression.rates() == {"rod.x": 10, "rod.theta": 29}


def test_names_and_rates_get_their_values():
    expression = parse("L*b.x - rate(b.x)**2")
    assert expression.evaluate({"L": 2.0, "b.x": 5.0}, FLOAT, {"b.x": 3.0}) == 1.0


def test_walking_visits_every_node():
    nodes = list(parse("-(1 + 2)*sin(3)**atan2(4, 5)").walk())
    assert sorted(node.text for node in nodes if isinstance(node, Number)) == ["1", "2", "3", "4", "5"]
    assert len(nodes) == 5 + 2 + 1 + 3  # numbers, functions, sign, operators


# --- errors and where they are --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "message", "position"),
    [
        ("", "the expression is empty", 0),
        ("   ", "the expression is empty", 0),
        ("1 +", r"expected a number, a name or '\(', the expression ends", 3),
        ("1 + *2", r"expected a number, a name or '\(', found '\*'", 4),
        ("2 3", "unexpected '3'", 2),
        ("(1 + 2", r"expected '\)', found the end", 6),
        ("1 + 2)", r"unexpected '\)'", 5),
        ("()", r"expected a number, a name or '\(', found '\)'", 1),
        ("sin 1", "unexpected '1'", 4),
        ("sin()", r"found '\)'", 4),
        ("sin(1, 2)", r"sin\(\) takes 1 argument, got 2", 0),
        ("1 + atan2(1)", r"atan2\(\) takes 2 arguments, got 1", 4),
        ("1 + 2 $ 3", r"unexpected character '\$'", 6),
        ("2 ^ 3", r"unexpected character '\^'", 2),
        ("1 +\u00a0€", "unexpected character '€'", 4),
        ("x == 1", "unexpected character '='", 2),
        ("1 // 2", "found '/'", 3),
        ("1,2", "unexpected ','", 1),
        ("1_000", "unexpected '_000'", 1),
        ("0x10", "unexpected 'x10'", 1),
        ("1e", "unexpected 'e'", 1),
        ("1.2.3", "unexpected '.3'", 3),
        ("2**101", "an exponent may be at most 100", 3),
        ("x**-(101)", "an exponent may be at most 100", 3),
        ("1 + 1e999", "a number may be at most 1e[+]300", 4),
        ("x**1e-999999999", "a number may be at most 1e[+]300", 3),
        ("0e99999999999", "a number may be at most 1e[+]300", 0),
        ("9" * 400, "a number may be at most 1e[+]300", 0),
        ("1 + rate(2)", r"rate\(...\) takes one coordinate", 4),
        ("rate(a.x, b.x)", r"rate\(...\) takes one coordinate", 0),
        ("rate(a.x + 1)", r"rate\(...\) takes one coordinate", 0),
        ("rate(rate(a.x))", r"rate\(...\) takes one coordinate", 0),
        ("\u0663", "unexpected character", 0),
    ],
)
def test_a_text_outside_the_grammar_is_refused_at_the_character_where_it_leaves_it(text, message, position):
    with pytest.raises(ExpressionError, match=message) as caught:
        parse(text)
    assert caught.value.position == position


@pytest.mark.parametrize(
    "text",
    [
        "__import__('os')",
        "__import__(os)",
        "().__class__",
        "(1).__class__.__bases__",
        "x.__class__()",
        "lambda: 1",
        "lambda x: x",
        "f'{1}'",
        'f"{x}"',
        "'a'*10",
        "[1]*10",
        "x[0]",
        "{1: 2}",
        "x if y else z",
        "x and y",
        "not x",
        "x := 1",
        "x = 1",
        "x; y",
        "print(1)",
        "eval(1)",
        "open(x)",
        "sin.__call__(1)",
        "1 if 1 else 1",
        "x @ y",
        "x % y",
        "~x",
        "*x",
        "sin(*x)",
        "sin(x=1)",
        "1j",
        "None()",
        "x`",
        "x\\n",
        "# comment",
        "1 # comment",
        "$(id)",
    ],
)
def test_nothing_but_arithmetic_is_accepted(text):
    with pytest.raises(ExpressionError, match=r"unexpected|expected|unknown function"):
        parse(text)


@pytest.mark.parametrize("text", ["a.__class__", "__builtins__", "a.b.c"])
def test_a_name_is_only_looked_up_among_the_given_names(text):
    class Trap(dict):
        def __missing__(self, key):
            return 7.0

    assert parse(text).evaluate(Trap(), FLOAT) == 7.0
    assert list(parse(text).names()) == [text]


@pytest.mark.parametrize(
    ("text", "hint"),
    [
        ("sine(1)", "did you mean 'sin'?"),
        ("artan(1)", "did you mean 'atan'?"),
        ("sqr(1)", "did you mean 'sqrt'?"),
        ("Rate(1)", "did you mean 'rate'?"),
        ("xyzzy(1)", "known functions: " + ", ".join(CALLED)),
    ],
)
def test_an_unknown_function_is_refused_with_a_suggestion(text, hint):
    with pytest.raises(ExpressionError, match="unknown function") as caught:
        parse(f"1 + {text}")
    assert caught.value.position == 4
    assert caught.value.hint == hint


def test_a_caret_is_refused_with_the_way_to_write_powers():
    with pytest.raises(ExpressionError, match="unexpected character") as caught:
        parse("x^2")
    assert caught.value.hint == "powers are written **"


def chains(levels, terms, factors):
    """Return chains of sums and products, one inside the other."""
    text = "x"
    for _ in range(levels):
        text = f"({text}{'+x' * terms}){'*x' * factors}"
    return text


# --- limits ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "(" * 10_000 + "1" + ")" * 10_000,
            f"an expression may have at most {MAX_LENGTH} characters, this one has 20001",
        ),
        ("(" * 2_000 + "1" + ")" * 2_000, f"nested at most {MAX_DEPTH} deep"),
        ("sin(" * 900 + "1" + ")" * 900, f"nested at most {MAX_DEPTH} deep"),
        ("-" * 4_000 + "1", f"nested at most {MAX_DEPTH} deep"),
        ("2**" * 1_500 + "2", f"nested at most {MAX_DEPTH} deep"),
        ("x+" * 2_000 + "x", f"chain at most {MAX_CHAIN} operators"),
        ("x*" * 2_000 + "x", f"chain at most {MAX_CHAIN} operators"),
        (chains(8, 200, 80), f"chain at most {MAX_CHAIN} operators"),
    ],
    ids=["parentheses", "fewer parentheses", "calls", "signs", "powers", "sum", "product", "chains in chains"],
)
def test_a_text_that_would_cost_time_or_depth_is_refused_at_once(text, message):
    start = time.process_time()
    with pytest.raises(ExpressionError, match=message):
        parse(text)
    assert time.process_time() - start < 5.0


@pytest.mark.parametrize(
    "text",
    [
        "(" * (MAX_DEPTH - 1) + "x" + ")" * (MAX_DEPTH - 1),
        "-" * (MAX_DEPTH - 1) + "x",
        "+".join(["x"] * (MAX_CHAIN + 1)),
        chains(4, 60, 60),
    ],
    ids=["parentheses", "signs", "sum", "chains in chains"],
)
def test_a_text_within_the_limits_is_evaluated_in_every_arithmetic(text):
    expected = parse(text).evaluate({"x": 1.0}, FLOAT)
    assert float(parse(text).evaluate({"x": sympy.Integer(1)}, symbol_arithmetic())) == expected
    assert parse(text).evaluate({"x": mpmath.mpf(1)}, mpmath_arithmetic()) == expected
    jet = parse(text).evaluate({"x": Jet(1.0, 0.0, 0.0)}, jet_arithmetic(FLOAT))
    assert (jet.value, jet.rate) == (expected, 0.0)


def test_a_tiny_power_underflows():
    assert value("(1/9)**9**9") == 0.0


GIANT = ["9**9**9", "9**9**9**9", "((9**100)**100)**100", "-9**9**9"]
EXACT = [symbol_arithmetic(), mpmath_arithmetic()]


@pytest.mark.parametrize(
    ("text", "arithmetic"),
    [*product(GIANT, [FLOAT, *EXACT]), *product(["(1/9)**9**9"], EXACT)],
    ids=lambda x: getattr(x, "name", x),
)
def test_a_giant_power_has_no_value_and_takes_no_time(text, arithmetic):
    start = time.process_time()
    with pytest.raises(ExpressionError, match="the expression has no value here"):
        parse(text).evaluate({}, arithmetic)
    assert time.process_time() - start < 1.0


@pytest.mark.parametrize(
    ("text", "position"),
    [
        ("1 + 1/0", 5),
        ("1 + 1/(2 - 2)", 5),
        ("1 + log(-1)", 4),
        ("1 + sqrt(-1)", 4),
        ("asin(2)", 0),
        ("2*acos(1.5)", 2),
        ("1 + (0 - 8)**(1/3)", 11),
        ("0**-1", 1),
    ],
)
@pytest.mark.parametrize("arithmetic", [FLOAT, mpmath_arithmetic()], ids=lambda f: f.name)
def test_an_expression_without_a_value_says_where(text, position, arithmetic):
    with pytest.raises(ExpressionError, match=r"the expression has no value here \(.+\)") as caught:
        parse(text).evaluate({}, arithmetic)
    assert caught.value.position == position


@pytest.mark.parametrize("text", ["exp(1000)", "cosh(1000)", "1e300*exp(700)*exp(700) - exp(1e6)"])
def test_a_float_that_overflows_in_a_function_is_refused(text):
    with pytest.raises(ExpressionError, match="the expression has no value here"):
        value(text)


# --- number systems -------------------------------------------------------------------------------------------------

NAMES = {"x": 0.37, "y": 0.81, "b.x": 0.59}
RATES = {"b.x": 0.23}
WIDTH = ", x/16"
TEXTS = {
    name: f"{name}(x{', y' * (entry.arguments - 1 - entry.smoothed)}{WIDTH * entry.smoothed})"
    for name, entry in FUNCTIONS.items()
} | {
    "operators": "x + y*b.x - x/y/b.x - -y",
    "powers": "x**2 + y**-3 + b.x**0.5 + x**y",
    "constants": "pi*x + 30*deg",
    "rate": "rate(b.x)*x - 1/3",
    "literals": "0.1 + 1e-3*x + .25",
    "outside of the start": "smooth_start(-x) + 2*smooth_start(1 + y)",
}


@pytest.mark.parametrize("text", TEXTS.values(), ids=TEXTS)
def test_all_number_systems_agree(text):
    expression = parse(text)
    with mpmath.workdps(40):
        exact = expression.evaluate(
            {name: mpmath.mpf(x) for name, x in NAMES.items()},
            mpmath_arithmetic(),
            {name: mpmath.mpf(x) for name, x in RATES.items()},
        )
    expected = float(exact)
    single = expression.evaluate(NAMES, FLOAT, RATES)
    assert single == pytest.approx(expected, rel=4e-16, abs=0)
    jet = expression.evaluate(NAMES, jet_arithmetic(FLOAT), RATES)
    assert getattr(jet, "value", jet) == pytest.approx(expected, rel=1e-15, abs=0)
    arrays = [{name: np.array([x, x]) for name, x in numbers.items()} for numbers in (NAMES, RATES)]
    array = expression.evaluate(arrays[0], array_arithmetic(), arrays[1])
    np.testing.assert_allclose(array, [expected, expected], rtol=1e-15, atol=0)
    symbols = {name: sympy.Symbol(name.replace(".", "_"), real=True) for name in NAMES}
    rates = {name: sympy.Symbol(f"{name[0]}_rate", real=True) for name in RATES}
    symbolic = expression.evaluate(symbols, symbol_arithmetic(), rates)
    values = {symbols[n]: sympy.Float(x, 40) for n, x in NAMES.items()} | {
        rates[n]: sympy.Float(x, 40) for n, x in RATES.items()
    }
    assert float(sympy.N(symbolic.subs(values), 30)) == pytest.approx(expected, rel=1e-15, abs=0)


@pytest.mark.parametrize("name", [*TABLE, "power"])
def test_every_arithmetic_has_every_function(name):
    for f in (
        FLOAT,
        array_arithmetic(),
        symbol_arithmetic(),
        mpmath_arithmetic(),
        jet_arithmetic(FLOAT),
        Tape().arithmetic(),
    ):
        assert callable(getattr(f, name))


@pytest.mark.parametrize(("x", "expected"), [(-0.5, -1.0), (0.0, 0.0), (2.0, 1.0)])
def test_the_sign_is_the_same_in_every_arithmetic(x, expected):
    assert FLOAT.signum(x) == expected
    assert array_arithmetic().signum(np.array([x]))[0] == expected
    assert mpmath_arithmetic().signum(mpmath.mpf(x)) == expected
    assert float(symbol_arithmetic().signum(sympy.Rational(x))) == expected


def test_an_arithmetic_has_no_other_functions():
    with pytest.raises(AttributeError, match="float arithmetic has no function 'gamma'"):
        FLOAT.gamma(1.0)


def test_the_constants_are_those_of_mathematics():
    assert {"pi": math.pi, "deg": math.pi / 180} == CONSTANTS
    constants = mpmath_arithmetic().constants
    with mpmath.workdps(40):
        assert abs(180 * constants["deg"] - constants["pi"]) < mpmath.mpf("1e-38")
    assert symbol_arithmetic().constants["deg"] == sympy.pi / 180


@pytest.mark.parametrize(
    ("x", "expected"), [(-1.0, 0.0), (0.0, 0.0), (0.25, 0.15625), (0.5, 0.5), (1.0, 1.0), (3.0, 1.0)]
)
def test_a_smooth_start_rises_from_0_to_1(x, expected):
    assert value("smooth_start(x)", x=x) == expected
    assert array_arithmetic().smooth_start(np.array([x]))[0] == expected
    assert mpmath_arithmetic().smooth_start(mpmath.mpf(x)) == expected
