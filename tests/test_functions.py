"""The table of functions: what it says is true, and number systems, derivatives and texts have them from it."""

import math
import random
import re
from fractions import Fraction
from pathlib import Path

import mpmath
import numpy as np
import pytest
import sympy
from mpmath_numbers import mpmath_arithmetic
from scipy.integrate import solve_ivp

import mbstab
from mbstab.analysis.algebra.rounded import Rounded, rounded_arithmetic
from mbstab.cli.commands.schema import section_text
from mbstab.compiler.tape import Tape
from mbstab.compiler.trace import Trace
from mbstab.errors import MbstabError, ModelFileError
from mbstab.model.arithmetic import FLOAT, array_arithmetic, symbol_arithmetic
from mbstab.model.expressions import parse
from mbstab.model.functions import CALLED, FUNCTIONS, NATIVE
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
    assert f"and {', '.join(name for name, entry in FUNCTIONS.items() if not entry.smoothed)}." in text
    assert [line.split("(")[0] for line in section_text("functions").splitlines()] == list(CALLED)


# --- the same function everywhere -----------------------------------------------------------------------------------

PLACES = {name: [0.4375, 0.75, 1.5, 0.25][: entry.arguments] for name, entry in FUNCTIONS.items()}


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
    import flint

    from mbstab.model.balls import ball, ball_arithmetic, digits, real

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


# --- smoothed over a width ------------------------------------------------------------------------------------------

SMOOTHED = {
    "sign": (("x",), "x/sqrt(x**2 + w**2)"),
    "min": (("a", "b"), "(a + b - sqrt((a - b)**2 + w**2))/2"),
    "max": (("a", "b"), "(a + b + sqrt((a - b)**2 + w**2))/2"),
    "saturate": (("x", "lo", "hi"), "(lo + hi + sqrt((x - lo)**2 + w**2) - sqrt((x - hi)**2 + w**2))/2"),
}


@pytest.mark.parametrize("name", SMOOTHED)
def test_a_smoothed_function_is_what_its_text_says(name):
    arguments, formula = SMOOTHED[name]
    assert f"{name}({', '.join(arguments)}, w): {formula}," in section_text("functions")
    rng = random.Random(name)
    with mpmath.workdps(40):
        for _ in range(5):
            at = {x: mpmath.mpf(rng.uniform(-2.0, 2.0)) for x in (*arguments, "w")}
            expected = parse(formula).evaluate(at, mpmath_arithmetic())
            assert abs(getattr(mpmath_arithmetic(), name)(*at.values()) - expected) < mpmath.mpf("1e-37")


@pytest.mark.parametrize(
    ("name", "arguments", "expected"),
    [
        ("sign", (-3.0,), -1.0),
        ("min", (2.0, -5.0), -5.0),
        ("max", (2.0, -5.0), 2.0),
        ("saturate", (1e17, -1.0, 2.0), 2.0),
        ("saturate", (-1e17, -1.0, 2.0), -1.0),
        ("saturate", (0.5, -1.0, 2.0), 0.5),
    ],
)
def test_far_from_its_corner_a_smoothed_function_is_the_sharp_one(name, arguments, expected):
    assert getattr(FLOAT, name)(*arguments, 1e-9) == pytest.approx(expected, rel=1e-15)


SLIDER = """\
mbstab: 1
parameters: {{w: {w}, F: 2, k: 64}}
bodies: {{b: {{type: planar_point, mass: 1}}}}
constraints: {{line: {{holonomic: b.y}}}}
forces:
  all: {{type: expression, on: {{b.x: "{force}"}}}}
"""


@pytest.mark.parametrize(
    ("force", "slope", "at"),
    [
        ("-F*sign(rate(b.x), w) - k*b.x", 2.0 / 0.1, "u"),
        ("saturate(-k*b.x, -F, F, w)", 64.0 * 2.0 / math.hypot(2.0, 0.1), "q"),
        ("w/2 - max(k*b.x, 2*k*b.x, w)", 96.0, "q"),
        ("-w/2 - min(k*b.x, 2*k*b.x, w)", 96.0, "q"),
    ],
)
def test_a_smoothed_function_in_a_force_has_its_slope(force, slope, at):
    mechanism = mbstab.loads(SLIDER.format(w=0.1, force=force))
    motion = mechanism.motion()
    K, R, _ = mechanism.system().linearize(motion.q, motion.u, motion.a, motion.nu)
    assert (K if at == "q" else R)[0, 0] == pytest.approx(slope, rel=1e-15)


def test_friction_that_is_smoothed_is_judged_swept_proven_and_simulated():
    mechanism = mbstab.loads(SLIDER.format(w=0.1, force="-F*sign(rate(b.x), w) - k*b.x"))
    expected = np.roots([1.0, 2.0 / 0.1, 64.0])
    found = mechanism.eig()
    assert np.sort_complex(found.values()) == pytest.approx(np.sort_complex(expected), rel=1e-12, abs=1e-12)
    for method in ("index3", "paper"):
        assert np.sort(mechanism.eig(method).values().real) == pytest.approx(np.sort(expected.real), rel=1e-6)
    assert np.max(mechanism.sweep("w", np.array([0.05, 0.1])).branches[1].real) == pytest.approx(max(expected.real))
    run = mechanism.simulate(to=0.2, points=3, perturb={"b.x": 0.1})

    def slope(t, y):
        return [y[1], -2.0 * y[1] / math.sqrt(y[1] ** 2 + 0.01) - 64.0 * y[0]]

    end = solve_ivp(slope, (0.0, 0.2), [0.1, 0.0], method="DOP853", rtol=1e-11, atol=1e-12).y[:, -1]
    assert [run.q[-1][0], run.u[-1][0]] == pytest.approx(end.tolist(), abs=1e-6)
    damped = mbstab.loads(SLIDER.format(w=0.1, force="-F*sign(rate(b.x), w) - saturate(k*b.x, -F, F, w)"))
    assert damped.certify().verdict == "asymptotically stable"


@pytest.mark.parametrize(
    ("force", "message"),
    [
        ("-F*sign(rate(b.x), b.x)", "the width of sign() must be constant"),
        ("-F*sign(rate(b.x), t)", "the width of sign() must be constant"),
        ("-F*sign(rate(b.x), -w)", "the width of sign() must be positive, got -0.1"),
        ("-F*max(b.x, 0, 0)", "the width of max() must be positive, got 0"),
        ("-F*sign(rate(b.x))", "sign() takes 2 arguments, got 1"),
        ("-F*max(b.x, 0)", "hint: max(a, b, 0.001): the last one is the width over which a corner is rounded"),
    ],
)
def test_a_width_is_a_positive_constant(force, message):
    with pytest.raises(ModelFileError) as caught:
        mbstab.loads(SLIDER.format(w=0.1, force=force)).system()
    assert re.search("<text>:6:[0-9]+: forces.all", str(caught.value))
    assert message in str(caught.value)


ON_A_RAIL = """
mbstab: 1
parameters: {c: 0.7, x: 0}
bodies: {p: {type: planar_point, mass: 1}}
constraints: {rail: {holonomic: p.y}}
forces: {f: {type: expression, on: {p.x: "FORCE"}}}
reference: {coordinates: {p: {x: x}}, rates: {p: {x: x}}}
"""


@pytest.mark.parametrize(
    "force",
    [
        "x*abs(x)", "-2*c*abs(3*x)*x", "abs(x)*x**2", "-c*(x*sin(x))*(2*abs(x))", "abs(x)*x**3*abs(x)",
        "-c*v*abs(v)", "abs(-2*x)*x/c", "hypot(x, v)*v", "-c*sqrt(4*x**2 + v**2)*x", "-c*hypot(x + v, 2*v)**3*(x + v)",
        "x*v/hypot(v, x)*v", "(x + v)*abs(x + v)", "x**2*v*abs(v)/c",
    ],
)  # fmt: skip
def test_a_product_with_a_size_has_its_derivative_where_the_size_has_none(force):
    functions = {"abs": abs, "sin": math.sin, "sqrt": math.sqrt, "hypot": math.hypot}

    def plain(x, v):
        return eval(force, functions | {"c": 0.7, "x": x, "v": v})

    model = mbstab.loads(ON_A_RAIL.replace("FORCE", re.sub(r"\bv\b", "rate(p.x)", re.sub(r"\bx\b", "p.x", force))))
    for at in (0.0, 0.3, -0.4):
        linear, h = model.linearize(x=at, frozen=True), 1e-6
        stiffness = -(plain(at + h, at) - plain(at - h, at)) / (2.0 * h)
        damping = -(plain(at, at + h) - plain(at, at - h)) / (2.0 * h)
        assert linear.K[0, 0] == pytest.approx(stiffness, abs=1e-5, rel=1e-8)
        assert linear.R[0, 0] == pytest.approx(damping, abs=1e-5, rel=1e-8)


def test_quadratic_drag_leaves_the_energy_to_decide_beside_an_axis_and_abs_alone_is_refused():
    text = ON_A_RAIL.replace("FORCE", "-p.x - c*rate(p.x)*abs(rate(p.x))")
    result = mbstab.loads(text).eig()
    assert [e.value for e in result.eigenvalues] == [1j, -1j]
    assert result.verdict == "stable"
    fed = mbstab.loads(text.replace("- c*rate", "+ c*rate")).eig()
    assert fed.verdict == "undecided"
    assert "abs(rate(p.x))) has no second derivative" in fed.reasons[0]
    assert mbstab.loads(text.replace("-p.x -", "-p.x - rate(p.x) -")).eig().verdict == "asymptotically stable"
    with pytest.raises(MbstabError, match=r"sqrt\(x\*\*2 \+ w\*\*2\)"):
        mbstab.loads(ON_A_RAIL.replace("FORCE", "-c*abs(rate(p.x))")).eig()
