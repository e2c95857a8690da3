"""Functions given by points: against the formulas of others, in every number system and every command."""

import json
import math
import re
from contextlib import suppress
from fractions import Fraction

import mpmath
import numpy as np
import pytest
import sympy
from click.testing import CliRunner
from mpmath_numbers import mpmath_arithmetic
from scipy.interpolate import CubicSpline, PchipInterpolator

import mbstab
from mbstab.analysis.algebra.rounded import Rounded, rounded_arithmetic
from mbstab.cli.main import main
from mbstab.compiler.tape import Tape
from mbstab.compiler.trace import Trace
from mbstab.errors import MbstabError, ModelFileError
from mbstab.model.arithmetic import FLOAT, array_arithmetic, symbol_arithmetic
from mbstab.model.functions import NATIVE
from mbstab.model.hermite import monotone_slopes, no_slopes, spline_slopes
from mbstab.model.jets import Jet, jet_arithmetic

X = [-2.0, -0.5, 0.25, 1.0, 3.0, 3.5]
Y = [-1.0, -0.75, 0.5, 2.0, 2.0, 1.25]
PEERS = {"table": PchipInterpolator(X, Y), "spline": CubicSpline(X, Y, bc_type="natural")}
SLOPES = {"table": monotone_slopes, "spline": spline_slopes, "linear": no_slopes}
ORDERS = ["hermite1", "hermite2", "hermite3"]


def points(name, x=X, y=Y):
    """Return x, y and slope of each point."""
    slopes = SLOPES[name]([Fraction(a) for a in x], [Fraction(b) for b in y])
    return [float(a) for row in zip(x, y, slopes, strict=True) for a in row]


INSIDE = np.linspace(-1.99, 3.49, 37)


@pytest.mark.parametrize("name", PEERS)
def test_values_and_derivatives_are_those_of_another_library(name):
    for order, function in enumerate([name, *ORDERS]):
        expected = PEERS[name](INSIDE, nu=order)
        found = [getattr(FLOAT, function)(x, *points(name)) for x in INSIDE.tolist()]
        assert found == pytest.approx(expected.tolist(), rel=1e-13, abs=1e-13)
        together = getattr(array_arithmetic(), function)(INSIDE, *points(name))
        assert together == pytest.approx(found, rel=1e-13, abs=1e-13)


@pytest.mark.parametrize("name", PEERS)
def test_two_points_are_joined_by_a_line_and_ends_belong_to_the_table(name):
    assert FLOAT.table(0.25, *points(name, [0.0, 1.0], [1.0, 3.0])) == 1.5
    assert array_arithmetic().table(np.array([0.25]), *points(name, [0.0, 1.0], [1.0, 3.0])) == [1.5]
    for f in (FLOAT, array_arithmetic(), mpmath_arithmetic()):
        assert [float(f.table(x, *points(name))) for x in X] == pytest.approx(Y, rel=1e-15)


@pytest.mark.parametrize("function", ["table", *ORDERS])
@pytest.mark.parametrize("x", [0.8125, 1.0])
def test_every_number_system_has_the_same_function(function, x):
    at = points("spline")
    value = getattr(FLOAT, function)(x, *at)
    near = pytest.approx(value, rel=1e-13)
    with mpmath.workdps(30):
        assert float(getattr(mpmath_arithmetic(), function)(mpmath.mpf(x), *map(mpmath.mpf, at))) == near
    symbol = sympy.Symbol("x")
    written = getattr(symbol_arithmetic(), function)(symbol, *map(sympy.Rational, at))
    assert float(written.subs(symbol, Fraction(x))) == near
    trace = Trace()
    text = trace.text({"x": [trace.input("x0")]}, [getattr(trace.arithmetic(), function)(trace.input("x0"), *at)])
    names = {key: getattr(FLOAT, key) for key in NATIVE} | {"pack": lambda *values: values}
    exec(text, names)
    assert names["evaluate"]([x])[0] == near
    if x != 1.0:
        from mbstab.model.balls import ball, ball_arithmetic, digits

        with digits(30):
            assert float(getattr(ball_arithmetic(), function)(ball(x), *map(ball, at)).mid()) == near


@pytest.mark.parametrize("name", PEERS)
def test_derivatives_come_by_the_chain_rule(name):
    jet = getattr(jet_arithmetic(FLOAT), name)(Jet(0.8, 0.7, -1.3), *points(name))
    value, first, second = (float(PEERS[name](0.8, nu=n)) for n in range(3))
    expected = [value, first * 0.7, second * 0.49 - first * 1.3]
    assert [jet.value, jet.rate, jet.second] == pytest.approx(expected, rel=1e-13)
    tape = Tape()
    x, at = tape.input("x"), [tape.literal(str(a)) for a in points(name)]
    called = getattr(tape.arithmetic(), name)(x, *at)
    slope = tape.gradient([(tape.term(1), called)], [x])[0]
    assert not slope.is_zero
    assert not tape.gradient([(tape.term(1), slope)], [x])[0].is_zero


def _systems():
    """Return the number systems of single numbers, each with how its numbers are made."""
    yield FLOAT, float
    yield array_arithmetic(), lambda x: np.array([x])
    with mpmath.workdps(30):
        yield mpmath_arithmetic(), mpmath.mpf


def test_lines_between_points_are_those_of_another_library():
    at = points("linear")
    chords = np.diff(Y) / np.diff(X)
    for f, number in _systems():
        given = list(map(number, at))
        for x in [*INSIDE.tolist(), *X]:
            assert float(np.squeeze(f.linear(number(x), *given))) == pytest.approx(np.interp(x, X, Y), rel=1e-14)
        for x in INSIDE.tolist():
            slope = chords[np.searchsorted(X, x) - 1]
            assert float(np.squeeze(f.linear1(number(x), *given))) == pytest.approx(slope, rel=1e-13)
    jet = jet_arithmetic(FLOAT).linear(Jet(0.8, 0.7, -1.3), *at)
    assert [jet.value, jet.rate, jet.second] == pytest.approx([1.6, 1.4, -2.6], rel=1e-13)


def test_where_lines_meet_there_is_no_slope():
    at = points("linear")
    with pytest.raises(ValueError, match=r"two lines of the table meet at 0\.25"):
        FLOAT.linear1(0.25, *at)
    assert np.isnan(array_arithmetic().linear1(np.array([0.25]), *at)).all()
    with pytest.raises(ValueError, match="no derivative"):
        mpmath_arithmetic().linear1(mpmath.mpf(0.25), *map(mpmath.mpf, at))
    assert FLOAT.linear1(X[0], *at) == pytest.approx(1.0 / 6.0, rel=1e-15)
    assert FLOAT.linear1(X[-1], *at) == pytest.approx(-1.5, rel=1e-15)


@pytest.mark.parametrize("name", ["table", "spline", "linear"])
def test_an_argument_that_is_rounded_beyond_an_end_is_the_end(name):
    at = points(name)
    for f, number in _systems():
        given = list(map(number, at))
        for end, y, out in ((X[0], Y[0], -1.0), (X[-1], Y[-1], 1.0)):
            assert float(np.squeeze(getattr(f, name)(number(end + out * 1e-14), *given))) == pytest.approx(y, rel=1e-12)
            with suppress(ValueError):
                assert np.isnan(getattr(f, name)(number(end + out * 1e-11), *given)).all()


def test_errors_of_arguments_are_carried_on():
    found = rounded_arithmetic().table(Rounded(0.8, 1e-3), *points("table"))
    far = max(abs(float(PEERS["table"](0.8 + d)) - found.v) for d in (-1e-3, 1e-3))
    assert far <= found.e <= 50.0 * far


# --- in a model -----------------------------------------------------------------------------------------------------

MODEL = """\
mbstab: 1
parameters: {{s: 1, F: "{F}"}}
tables:
  grip:
    x: [-2, -0.5, 0.25, 1, 3, 3.5]
    y: [-1, -0.75, 0.5, 2, 2, 1.25]
bodies: {{b: {{type: planar_point, mass: 1}}}}
constraints: {{line: {{holonomic: b.y}}}}
forces:
  all: {{type: expression, on: {{b.x: "F - s*{function}(b.x, grip) - 0.3*rate(b.x)"}}}}
reference: {{find: equilibrium, guess: {{b: {{x: 0.5}}}}}}
"""


def model(function="spline", F=1.25, **replaced):
    """Return a mass on a spring with a characteristic."""
    text = MODEL.format(function=function, F=F)
    for old, new in replaced.items():
        text = text.replace({"x": "x: [-2, -0.5, 0.25, 1, 3, 3.5]", "y": "y: [-1, -0.75, 0.5, 2, 2, 1.25]"}[old], new)
    return mbstab.loads(text)


@pytest.mark.parametrize("function", PEERS)
def test_a_spring_with_a_characteristic(function):
    peer = PEERS[function]
    (found,) = model(function).equilibria()
    (at,) = (x for x in peer.solve(1.25) if 0.25 < x < 1.0)
    assert found.motion.q[0] == pytest.approx(at, rel=1e-12)
    expected = np.sort_complex(np.roots([1.0, 0.3, float(peer(at, nu=1))]))
    for method in ("nullspace", "index3", "paper"):
        values = np.sort_complex(model(function).eig(method).values())
        assert values == pytest.approx(expected, rel=1e-11 if method == "nullspace" else 1e-8)
    precise = np.sort_complex([complex(x) for x in model(function).eig_precise(25).values()])
    assert precise == pytest.approx(expected, rel=1e-13)
    assert model(function).certify().verdict == "asymptotically stable"


CRITICAL = """\
mbstab: 1
tables: {{T: {{x: {x}, y: {y}}}}}
bodies: {{b: {{type: planar_point, mass: 1}}}}
constraints: {{line: {{holonomic: b.y}}}}
forces:
  all: {{type: expression, on: {{b.x: "{force} - rate(b.x)"}}}}
reference: {{coordinates: {{b: {{x: 0, y: 0}}}}}}
"""


@pytest.mark.parametrize(
    ("x", "y", "force", "verdict"),
    [
        # The spline through these points is x³ between -1 and 1: its moments there are -6, 0 and 6.
        ("[-2, -1, 0, 1, 2]", "[-6, -1, 0, 1, 6]", "-spline(b.x, T)", "asymptotically stable"),
        ("[-2, -1, 0, 1, 2]", "[6, 1, 0, -1, -6]", "-spline(b.x, T)", "unstable"),
        # The slope at 0 is the harmonic mean of 1 and 5, 5/3; the curvatures on its sides differ.
        ("[-1, 0, 1]", "[-1, 0, 5]", "-table(b.x, T) + 5/3*b.x", "undecided"),
        ("[-3, 0, 3]", "[-1, 0, 2]", "-table(b.x, T) + 4/9*b.x", "undecided"),
    ],
)
def test_a_slope_that_is_zero_is_exactly_zero(x, y, force, verdict):
    """Rounded slopes would let --certify prove, and many digits show, what the sign of the rounding says."""
    mechanism = mbstab.loads(CRITICAL.format(x=x, y=y, force=force))
    for found in (mechanism.eig(), mechanism.eig_precise(30)):
        assert found.verdict == verdict
        assert min(abs(x.value) for x in found.eigenvalues) == 0.0
    assert mechanism.certify().verdict == "not provable"


@pytest.mark.parametrize("name", ["table", "spline", "linear"])
def test_whole_numbers_stay_exact_in_every_number_system(name):
    """Quotients of Python integers are floats."""
    x, y = [-3, 0, 3, 7], [-1, 0, 2, 1]
    slopes = SLOPES[name](list(map(Fraction, x)), list(map(Fraction, y)))
    with mpmath.workdps(50):
        f = mpmath_arithmetic()
        at = [v for row in zip(x, y, map(f.number, map(str, slopes)), strict=True) for v in row]
        found = [getattr(f, name)(mpmath.mpf(1), *points) for points in (at, map(mpmath.mpf, at))]
        assert abs(found[0] - found[1]) < 1e-48


@pytest.mark.parametrize("text", ["1/3", "10000000000000001/10000000000000000", "-7/9", "3.00000000000000000001"])
def test_a_literal_that_is_no_float_has_the_error_of_the_next_one(text):
    found = rounded_arithmetic().number(text)
    assert 0 < abs(Fraction(text) - Fraction(float(found))) <= found.e


def test_slopes_are_exact_fractions_or_decimals_of_sixty_digits():
    for count in (3, 7, 40, 101, 160):
        x = [Fraction(i * 7 + i % 3, 10) for i in range(count)]
        y = [Fraction((i * i * 37) % 101 - 50, 8) for i in range(count)]
        slopes = spline_slopes(x, y)
        # The second derivative is continuous, and zero at both ends.
        for i in range(count):
            bends = []
            if i:
                h, chord = x[i] - x[i - 1], (y[i] - y[i - 1]) / (x[i] - x[i - 1])
                bends.append((2 * slopes[i - 1] + 4 * slopes[i] - 6 * chord) / h)
            if i < count - 1:
                h, chord = x[i + 1] - x[i], (y[i + 1] - y[i]) / (x[i + 1] - x[i])
                bends.append((6 * chord - 4 * slopes[i] - 2 * slopes[i + 1]) / h)
            step = bends[0] - bends[1] if len(bends) == 2 else bends[0]
            assert step == 0 if count <= 100 else abs(step) < Fraction(1, 10**58)


def test_sweeps_derivatives_and_simulations_follow_the_characteristic():
    peer, mechanism = PEERS["spline"], model()
    swept = mechanism.sweep("F", np.array([1.0, 1.25, 1.5]))
    for F, values in zip(swept.values, swept.branches, strict=True):
        (at,) = (x for x in peer.solve(F) if 0.25 < x < 1.0)
        expected = np.roots([1.0, 0.3, float(peer(at, nu=1))])
        assert np.sort_complex(values) == pytest.approx(np.sort_complex(expected), rel=1e-9)
    (at,) = (x for x in peer.solve(1.25) if 0.25 < x < 1.0)
    text = MODEL.format(function="spline", F=1.25)
    result = CliRunner().invoke(main, ["eig", "-", "--sensitivity", "--format", "json"], input=text)
    assert result.exit_code == 0, result.output
    (row,) = json.loads(result.output)["sensitivity"]["eigenvalues"]
    # λ² + 0.3 λ + g'(x) = 0 with g(x) = F: dλ/dF = -(g''/g') / (2 λ + 0.3).
    slope, bend = float(peer(at, nu=1)), float(peer(at, nu=2))
    expected = -bend / slope / (2.0 * complex(row["real"], row["imag"]) + 0.3)
    assert row["derivatives"]["F"]["imag"] == pytest.approx(expected.imag, rel=1e-10)


@pytest.mark.parametrize("settings", [{}, {"compiled": True}])
def test_a_simulation_within_a_table_and_beyond_it(settings):
    if settings:
        pytest.importorskip("numba")
    run = model().simulate(to=0.5, points=3, perturb={"b.x": 0.05}, **settings)
    assert run.q[0][0] > run.q[-1][0] > 0.3
    with pytest.raises(MbstabError) as caught:
        model(F=1.9).simulate(to=20.0, points=3, perturb={"rate(b.x)": 4.0}, **settings)
    assert "is outside the table 'grip', which goes from -2 to 3.5" in str(caught.value)
    assert "table 'grip' (<text>:4:3)" in str(caught.value)


def test_at_a_point_of_a_table_eigenvalues_exist_and_their_derivatives_need_a_spline():
    for function in PEERS:
        text = MODEL.format(function=function, F=0.5)
        result = CliRunner().invoke(main, ["eig", "-", "--sensitivity", "--format", "json"], input=text)
        (row,) = json.loads(result.output)["sensitivity"]["eigenvalues"]
        slope = float(PEERS[function](0.25, nu=1))
        value = complex(-0.15, math.sqrt(slope - 0.15**2))
        assert complex(row["real"], row["imag"]) == pytest.approx(value, rel=1e-12)
        if function == "spline":
            assert row["missing"] == ""
            expected = -float(PEERS["spline"](0.25, nu=2)) / slope / (2.0 * value + 0.3)
            assert row["derivatives"]["F"]["imag"] == pytest.approx(expected.imag, rel=1e-10)
        else:
            said = "forces.all (table(b.x, grip)) has no second derivative where its argument is a point of the table"
            assert said in row["missing"]


def test_a_table_stands_in_a_parameter_an_output_and_a_law():
    text = (
        MODEL.format(function="table", F="table(0.5, grip)").replace("parameters: {", "parameters: {one: 1, ")
        + "outputs: {force: 'spline(b.x, grip)'}\n"
    )
    mechanism = mbstab.loads(text)
    assert mechanism.system().scene.parameters["F"] == pytest.approx(float(PEERS["table"](0.5)), rel=1e-15)
    assert mechanism.motion().q[0] == pytest.approx(0.5, rel=1e-12)
    result = CliRunner().invoke(main, ["linearize", "-", "--format", "json"], input=text)
    C = json.loads(result.output)["state-space"]["C"]
    assert np.linalg.norm(C) == pytest.approx(float(PEERS["spline"](0.5, nu=1)), rel=1e-12)
    law = (
        text.replace("F - s*", "-s*") + "drives: {d: {type: coordinate, coordinate: b.x, position: 'table(t, grip)'}}\n"
    )
    run = mbstab.loads(law.replace("find: equilibrium, guess: {b: {x: 0.5}}", "time: 0.5")).simulate(to=1.0, points=2)
    assert run.q[-1][0] == pytest.approx(float(PEERS["table"](1.0)), rel=1e-9)


def test_a_table_that_is_left_is_told_with_value_range_and_name():
    found = "find: equilibrium, guess: {b: {x: 0.5}}"
    text = MODEL.format(function="table", F=1).replace(found, "coordinates: {b: {x: 4}}")
    with pytest.raises(MbstabError) as caught:
        mbstab.loads(text).eig()
    assert "<text>:10:" in str(caught.value)
    said = "forces.all has no finite equations here (4 is outside the table 'grip', which goes from -2 to 3.5)"
    assert said in str(caught.value)
    assert "give the table 'grip' (<text>:4:3) more points" in str(caught.value)
    with pytest.raises(ModelFileError, match=r"<text>:2:.*9 is outside the table"):
        mbstab.loads(MODEL.format(function="table", F="table(9, grip)")).eig()


@pytest.mark.parametrize(
    ("replaced", "place", "message"),
    [
        ({"x": "x: [-2, -0.5, -0.5, 1, 3, 3.5]"}, "5:19", "x must increase: -0.5 comes after -0.5"),
        ({"y": "y: [-1, -0.75, 0.5, 2, 2]"}, "5:31", "6 values of x and 5 of y"),
        ({"y": "y: [-1, -0.75, s, 2, 2, 1.25]"}, "6:20", "'s' is not a number"),
        ({"x": "x: [1]", "y": "y: [2]"}, "5:5", "a table has 2 to 1000 points, this one has 1"),
        ({"x": "x: []", "y": "y: []"}, "5:5", "a table has 2 to 1000 points, this one has none"),
        ({"x": "x: 3"}, "5:8", "expected a list of numbers"),
        ({"x": "z: [1]"}, "5:5", "unknown key 'z'"),
        ({"x": "file: none.csv\n    x: a", "y": "y: b"}, "5:11", "none.csv: cannot be read"),
        ({"x": "file: ../none.csv", "y": ""}, "5:11", "'../none.csv' is not the name of a file"),
    ],
)
def test_a_bad_table_is_refused_where_it_stands(replaced, place, message):
    with pytest.raises(ModelFileError) as caught:
        model(**replaced)
    assert re.search(f"<text>:{place}: tables.grip[a-z.]*: {re.escape(message)}", str(caught.value)), str(caught.value)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        ("table(b.x, grib)", "there is no table 'grib'"),
        ("table(b.x, 3)", "table() takes a number and the name of a table"),
        ("table(b.x)", "table() takes a number and the name of a table"),
        ("grip*b.x", "unknown parameter 'grip'"),
    ],
)
def test_a_bad_call_is_refused(call, message):
    with pytest.raises(ModelFileError) as caught:
        mbstab.loads(MODEL.format(function="table", F=1).replace("table(b.x, grip)", call))
    assert message in str(caught.value)


def test_a_table_in_a_file_beside_the_model(tmp_path):
    file = tmp_path / "mass.yaml"
    text = MODEL.format(function="spline", F=1.25)
    lists = text[text.index("    x:") : text.index("bodies")]
    file.write_text(text.replace(lists, "    {file: grip.csv, x: slip, y: load}\n"), encoding="utf-8")
    lines = [f"{i}, {b},{a}" for i, (a, b) in enumerate(zip(X, Y, strict=True))]
    (tmp_path / "grip.csv").write_text("# a comment\nnumber,load,slip\n" + "\n".join(lines) + "\n", encoding="utf-8")
    assert mbstab.load(file).eig().values().tolist() == model().eig().values().tolist()
    assert mbstab.load(file).sweep("s", np.array([1.0, 1.1])).branches == pytest.approx(
        model().sweep("s", np.array([1.0, 1.1])).branches, rel=1e-12
    )
    lines[3] = "3, 2.0,0.1"
    (tmp_path / "grip.csv").write_text("number,load,slip\n" + "\n".join(lines) + "\n", encoding="utf-8")
    with pytest.raises(ModelFileError) as caught:
        mbstab.load(file)
    assert "grip.csv:5:8: tables.grip: x must increase: 0.1 comes after 0.25" in str(caught.value)
    assert "3, 2.0,0.1" in str(caught.value)


@pytest.mark.parametrize("function", ["table", "spline", "linear"])
def test_a_table_from_a_file_that_is_left_is_told_with_the_name_of_the_file(function, tmp_path):
    found = "find: equilibrium, guess: {b: {x: 0.5}}"
    text = MODEL.format(function=function, F=1).replace(found, "coordinates: {b: {x: 4}}")
    (table,) = mbstab.loads(text).model.tables.values()
    start = text.index("tables:")
    end = text.index("\n", text.index("y:", start))
    (tmp_path / "m.yaml").write_text(text[:start] + "tables:\n  grip: {file: grip.csv}" + text[end:], encoding="utf-8")
    lines = [f"{x},{y}" for x, y in zip(table.x, table.y, strict=True)]
    (tmp_path / "grip.csv").write_text("\n".join(["slip,load", *lines]) + "\n", encoding="utf-8")
    with pytest.raises(MbstabError) as caught:
        mbstab.load(tmp_path / "m.yaml").eig()
    assert "4 is outside the table 'grip', which goes from -2 to 3.5" in str(caught.value)
    assert re.search(r"give the table 'grip' \(grip\.csv, .*m\.yaml:\d+:3\) more points", str(caught.value))


@pytest.mark.parametrize("separator", [",", ";", "\t", " ; ", ", "])
def test_one_separator_stands_in_a_whole_file(separator, tmp_path):
    rows = ["slip", "load"], *zip(map(str, X), map(str, Y), strict=True)
    (tmp_path / "grip.csv").write_text("\n".join(separator.join(row) for row in rows), encoding="utf-8")
    assert _from_file(tmp_path).eig().values().tolist() == model().eig().values().tolist()


def _from_file(folder, columns=""):
    """Return the mass on a spring whose characteristic stands in grip.csv of a folder."""
    text = MODEL.format(function="spline", F=1.25)
    lists = text[text.index("    x:") : text.index("bodies")]
    (folder / "mass.yaml").write_text(text.replace(lists, f"    {{file: grip.csv{columns}}}\n"), encoding="utf-8")
    return mbstab.load(folder / "mass.yaml")


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        (
            "n,k\n1000,1,5e4\n2000,2,5e4",
            "grip.csv:2:1: tables.grip.file: this line has 3 values, and the heading 2 names",
        ),
        ("n,k\n1000,\n", "grip.csv:2:6: tables.grip: a number is missing here"),
        ("n,k\n1000,1,\n", "grip.csv:2:1: tables.grip.file: this line has 3 values, and the heading 2 names"),
        ("n,k,m\n1,,2\n2,3,4", "grip.csv:2:3: tables.grip: a number is missing here"),
        ("n,k\n1\n", "grip.csv:2:1: tables.grip.file: this line has 1 value, and the heading 2 names"),
        ("n,k\n1;2\n", "the first line has ',', this one ';'"),
        ("n;k\n1,2\n", "the first line has ';', this one ','"),
        ("n;k\n1;3,0e7\n2;4e7", "grip.csv:2:3: tables.grip: '3,0e7' is not a number"),
        ("n;k\n1;3,0e7\n2;4e7", "decimals follow a point: 3.0e7"),
        ("1;3,5\n2;4", "grip.csv:1:3: tables.grip: '3,5' is not a number"),
        ("n\tk\n1\t1,5\n2\t2", "decimals follow a point: 1.5"),
        ("1,2\n3,4,5\n", "grip.csv:2:1: tables.grip.file: this line has 3 values, and the first line 2"),
        ("n\n1\n2\n", "grip.csv has only one column"),
    ],
)
def test_lines_that_do_not_fit_the_first_one_are_refused(lines, message, tmp_path):
    (tmp_path / "grip.csv").write_text(lines, encoding="utf-8")
    with pytest.raises(ModelFileError) as caught:
        _from_file(tmp_path)
    assert message in str(caught.value)


def test_a_column_that_is_there_twice_is_refused(tmp_path):
    (tmp_path / "grip.csv").write_text("n,k,k\n1,2,3\n2,3,4", encoding="utf-8")
    with pytest.raises(ModelFileError, match="has two columns 'k'"):
        _from_file(tmp_path, ", x: n, y: k")


def test_many_points_cost_little():
    x = np.linspace(0.0, 10.0, 200)
    at = points("spline", x.tolist(), np.sin(x).tolist())
    assert FLOAT.table(3.3, *at) == pytest.approx(math.sin(3.3), abs=1e-6)
