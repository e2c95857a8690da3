"""The table of functions: what it says is true, and number systems, derivatives and texts have them from it."""

import math
import random
from fractions import Fraction
from pathlib import Path

import mpmath
import numpy as np
import pytest
import sympy

import mbstab
from mbstab.analysis.algebra.rounded import Rounded, rounded_arithmetic
from mbstab.cli.commands.schema import section_text
from mbstab.compiler.tape import Tape
from mbstab.compiler.trace import Trace
from mbstab.model.arithmetic import FLOAT, array_arithmetic, mpmath_arithmetic, symbol_arithmetic
from mbstab.model.functions import FUNCTIONS, NATIVE
from mbstab.model.jets import Jet, jet_arithmetic

NEAR = {"acos": 0.5, "asin": 0.5}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_what_the_table_says_of_a_function_is_true(name):
    entry, rng = FUNCTIONS[name], random.Random(name)
    function = getattr(FLOAT, name)
    for _ in range(10):
        x = [rng.uniform(0.01, 1.0) * NEAR.get(name, 1.0) for _ in range(entry.arguments)]
        assert entry.span[0] <= function(*x) <= entry.span[1]
        if entry.parity:
            assert function(-x[0], *x[1:]) == (-1 if entry.parity == "odd" else 1) * function(*x)
        if entry.half_turn:
            assert function(x[0] + math.pi) == pytest.approx(entry.half_turn * function(*x), rel=1e-12)
        if entry.rising:
            assert function(-x[0]) <= function(x[0]) <= function(2.0 * x[0])
        if entry.steepest is not None:
            with mpmath.workdps(30):
                steps = [mpmath.mpf(x[0]) + (i - 10) * mpmath.mpf(x[0]) / 100 for i in range(21)]
                slopes = [abs(mpmath.diff(getattr(mpmath_arithmetic(), name), at)) for at in steps]
            bound = entry.steepest(lambda at: abs(entry.slopes(FLOAT, function(at), at)[0]), x[0], x[0] / 10)
            assert bound >= max(slopes) * (1 - 1e-14)
    for at, found in entry.exact:
        assert function(float(at)) == found
    if entry.outside is not None:
        assert function(entry.joints[0] - 3.0) == entry.outside[0](entry.joints[0] - 3.0)
        assert function(entry.joints[-1] + 3.0) == entry.outside[1](entry.joints[-1] + 3.0)


def test_the_text_for_users_lists_all_functions():
    text = " ".join((Path(mbstab.__file__).parent / "manual" / "model-file.md").read_text(encoding="utf-8").split())
    assert f"and {', '.join(FUNCTIONS)}." in text
    assert [line.split("(")[0] for line in section_text("functions").splitlines()] == list(FUNCTIONS)


# --- the same function everywhere -----------------------------------------------------------------------------------

PLACES = {name: [0.4375, 0.75][: entry.arguments] for name, entry in FUNCTIONS.items()}


def exact(name, arguments=None):
    """Return the value of a function with 40 digits."""
    with mpmath.workdps(40):
        return getattr(mpmath_arithmetic(), name)(*map(mpmath.mpf, arguments or PLACES[name]))


@pytest.mark.parametrize("name", FUNCTIONS)
def test_floats_arrays_and_symbols_have_the_same_function(name):
    x, value = PLACES[name], float(exact(name))
    assert getattr(FLOAT, name)(*x) == pytest.approx(value, rel=4e-16)
    assert getattr(array_arithmetic(), name)(*(np.full(2, a) for a in x)) == pytest.approx([value] * 2, rel=4e-16)
    symbols = [sympy.Symbol(a) for a in FUNCTIONS[name].names]
    written = getattr(symbol_arithmetic(), name)(*symbols)
    assert float(written.subs(dict(zip(symbols, map(sympy.Rational, x), strict=True)))) == pytest.approx(
        value, rel=1e-15
    )


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_slope_is_the_derivative(name):
    x = PLACES[name]
    with mpmath.workdps(40):
        f, at = mpmath_arithmetic(), [mpmath.mpf(a) for a in x]
        slopes = FUNCTIONS[name].slopes(f, getattr(f, name)(*at), *at)
        for i, slope in enumerate(slopes):
            orders = tuple(int(i == j) for j in range(len(at)))
            assert slope == pytest.approx(mpmath.diff(getattr(f, name), tuple(at), orders), rel=1e-15)
        jets = [Jet(a, Fraction(i + 1, 2), 1 - i) for i, a in enumerate(at)]
        jets = [Jet(j.value, mpmath.mpf(float(j.rate)), mpmath.mpf(j.second)) for j in jets]
        found = getattr(jet_arithmetic(f), name)(*jets)

        def moving(t):
            return getattr(f, name)(*(j.value + j.rate * t + j.second / 2 * t**2 for j in jets))

        assert abs(found.second - mpmath.diff(moving, 0, 2)) < mpmath.mpf("1e-15")


@pytest.mark.parametrize("name", FUNCTIONS)
def test_balls_contain_the_value(name):
    flint = pytest.importorskip("flint")
    from mbstab.analysis.algebra.balls import ball, ball_arithmetic, digits, real

    with digits(30):
        value = real(getattr(ball_arithmetic(), name)(*map(ball, PLACES[name])))
        with mpmath.workdps(40):
            assert abs(float(value - flint.arb(mpmath.nstr(exact(name), 38)))) < 1e-36
        assert float(value.rad()) < 1e-30


@pytest.mark.parametrize("name", FUNCTIONS)
def test_errors_of_arguments_are_carried_on(name):
    x, rng = PLACES[name], random.Random(name)
    function = getattr(rounded_arithmetic(), name)
    for size in (1e-14, 1e-3, 0.03):
        found = function(*(Rounded(a, size) for a in x))
        far = max(abs(exact(name, [a + size * rng.uniform(-1, 1) for a in x]) - found.v) for _ in range(50))
        assert far <= found.e <= 50 * far + 1e-14


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_program_holds_operations_on_floats_only(name):
    x = PLACES[name]
    trace = Trace()
    inputs = [trace.input(f"x{i}") for i in range(len(x))]
    text = trace.text({"x": inputs}, [getattr(trace.arithmetic(), name)(*inputs)])
    names = {key: getattr(FLOAT, key) for key in NATIVE} | {"pack": lambda *values: values}
    exec(text, names)
    assert names["evaluate"](x)[0] == getattr(FLOAT, name)(*x)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_kernel_can_be_differentiated(name):
    tape = Tape()
    inputs = [tape.input(f"x{i}") for i in range(FUNCTIONS[name].arguments)]
    value = getattr(tape.arithmetic(), name)(*inputs)
    assert not any(slope.is_zero for slope in tape.gradient([(tape.term(1), value)], inputs))
