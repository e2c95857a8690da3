"""The shipped kernels are what the definitions give, small, and divide by nothing of their own making."""

import ast
import json
import os
import shutil
import subprocess
import sys
from collections import Counter
from fractions import Fraction

import pytest
from element_tables import DIVISORS

from mbstab.compiler.derive import Derived, derive
from mbstab.compiler.emit import emit, source
from mbstab.compiler.kernels import FOLDER, STAMP, hash_of_sources
from mbstab.compiler.tape import Product, Sum, Tape
from mbstab.compiler.user import moved_kernel
from mbstab.mechanics.catalogue import Element, Load
from mbstab.mechanics.elements import ELEMENTS
from mbstab.model.arithmetic import FLOAT, symbol_arithmetic
from mbstab.model.expressions import ExpressionError, parse

# Operations and calls in (dynamics, linearize, linearize_rows or potential); a little above what they have.
BUDGET = {
    "planar_body_offset": (45, 50, 20),
    "planar_coincident": (45, 25, 45),
    "planar_spring": (70, 290, 35),
    "spatial_body": (155, 435, 10),
    "spatial_body_offset": (475, 1545, 90),
    "spatial_coincident": (530, 335, 1000),
    "spatial_perpendicular": (565, 400, 1150),
    "spatial_screw": (1315, 2285, 2835),
    "spatial_spring": (365, 1855, 175),
    "spatial_wheel_slip_along": (415, 790, 1130),
}


def functions(name):
    tree = ast.parse((FOLDER / f"{name}.py").read_text(encoding="utf-8"))
    return {node.name: node for node in tree.body if isinstance(node, ast.FunctionDef)}


# --- shipped kernels ------------------------------------------------------------------------------------------------


def test_the_kernels_are_those_of_the_definitions():
    assert STAMP.read_text(encoding="ascii") == hash_of_sources()
    assert {path.stem for path in FOLDER.glob("*.py")} == {*ELEMENTS, "__init__"}


@pytest.mark.few(12)
@pytest.mark.parametrize("name", sorted(ELEMENTS))
def test_deriving_a_kernel_again_gives_its_text(name):
    assert source(name) == (FOLDER / f"{name}.py").read_text(encoding="utf-8")


@pytest.mark.long
def test_a_checkout_whose_definitions_are_newer_derives_them_and_says_so(tmp_path):
    copy = tmp_path / "mbstab"
    shutil.copytree(FOLDER.parents[1], copy, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copytree(FOLDER.parents[2] / "models", tmp_path / "models")
    (tmp_path / "pyproject.toml").touch()
    ask = [sys.executable, "-m", "mbstab", "eig", "pendulum.yaml", "--format", "json"]
    asked = {"capture_output": True, "encoding": "utf-8", "cwd": tmp_path, "check": True}
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
    before = subprocess.run(ask, env=environment, **asked)
    assert "kernels" not in before.stderr
    place = copy / "mechanics" / "bodies.py"
    # A body of twice the inertia.
    changed = place.read_text(encoding="utf-8").replace(".dot(spin) / 2", ".dot(spin)")
    place.write_text(changed, encoding="utf-8")
    after = subprocess.run(ask, env=environment, **asked)
    assert "'python -m mbstab.compiler.build' writes them" in after.stderr
    assert json.loads(after.stdout)["eigenvalues"] != json.loads(before.stdout)["eigenvalues"]
    subprocess.run([sys.executable, "-m", "mbstab.compiler.build"], env=environment, **asked)
    built = subprocess.run(ask, env=environment, **asked)
    assert "kernels" not in built.stderr
    assert json.loads(built.stdout)["eigenvalues"] == json.loads(after.stdout)["eigenvalues"]


@pytest.mark.long
def test_the_text_of_a_kernel_does_not_depend_on_the_hash_seed():
    code = "from mbstab.compiler.emit import source; print(*map(source, ('planar_spring', 'spatial_perpendicular')))"
    texts = {
        subprocess.run(
            [sys.executable, "-c", code],
            env={"PYTHONHASHSEED": seed, "PYTHONPATH": str(FOLDER.parents[2])},
            capture_output=True,
            encoding="utf-8",
            check=True,
        ).stdout
        for seed in ("1", "2", "3")
    }
    assert len(texts) == 1
    assert "def linearize" in texts.pop()


@pytest.mark.parametrize("name", BUDGET)
def test_a_kernel_stays_within_its_budget_of_operations(name):
    counts = [
        sum(isinstance(node, ast.BinOp | ast.UnaryOp | ast.Call) for node in ast.walk(function))
        for function in functions(name).values()
    ]
    for count, budget in zip(counts, BUDGET[name], strict=True):
        assert count <= budget


def is_square(product):
    """Return whether each factor of a product or a quotient of products stands in it an even number of times."""
    counts, left = Counter(), [product]
    while left:
        match left.pop():
            case ast.BinOp(one, ast.Mult() | ast.Div(), other):
                left += [one, other]
            case factor:
                counts[ast.dump(factor)] += 1
    return all(count % 2 == 0 for count in counts.values())


def in_words(total, steps):
    """Return what a sum of products, some of them with names, consists of, or its text."""
    terms, left = [], [total]
    while left:
        match left.pop():
            case ast.BinOp(one, ast.Add(), other):
                left += [other, one]
            case ast.Name(name) if name in steps:
                left.append(steps[name])
            case term:
                terms.append(term)
    one = "1 + " if ast.unparse(terms[0]) == "1" else ""
    products = terms[1:] if one else terms
    if not all(isinstance(term, ast.BinOp) and isinstance(term.op, ast.Mult | ast.Div) for term in products):
        return ast.unparse(total)
    squares = all(map(is_square, products))
    kind = "squares" if squares else "products"
    return one + ("square" if squares and len(products) == 1 else f"sum of {kind}")


def divisors(function):
    """Yield what a function divides by, with names replaced by what they stand for."""
    steps = {
        node.targets[0].id: node.value
        for node in function.body
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name)
    }
    rooted = {
        node.args[0].id
        for node in ast.walk(function)
        if isinstance(node, ast.Call) and node.func.attr == "sqrt" and isinstance(node.args[0], ast.Name)
    }
    for node in ast.walk(function):
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Div):
            stack = [node.right]
            while stack:
                match stack.pop():
                    case ast.BinOp(left, ast.Mult(), right):
                        stack += [left, right]
                    case ast.Name(name) if name in rooted:  # the square of a root
                        yield "sqrt"
                    case ast.Name(name) if name in steps:
                        stack.append(steps[name])
                    case ast.Name(name):
                        yield name
                    case ast.Constant(value):
                        assert value != 0
                    case ast.Call(ast.Attribute(attr=called)):
                        yield called
                    case ast.Subscript(slice=ast.Constant(value)):
                        yield value
                    case ast.BinOp(_, ast.Add(), _) as total:
                        yield in_words(total, steps)
                    case other:
                        yield ast.unparse(other)


@pytest.mark.parametrize("name", sorted(ELEMENTS))
def test_a_kernel_divides_only_by_what_its_definition_divides_by(name):
    found = {divisor for function in functions(name).values() for divisor in divisors(function)}
    assert found == DIVISORS.get(name, set())


# --- what a force says of itself ------------------------------------------------------------------------------------


def bushing(dissipation):
    """Return a force between two points with two stiffnesses, two dampings and a dissipation function of these."""

    def define(frames, p, s):
        first, second = frames
        gap = first.position(p.first) - second.position(p.second)
        speed = first.velocity(p.first) - second.velocity(p.second)
        stored = sum(c * x**2 / 2 for c, x in zip(p.stiffness, gap, strict=True))
        return Load(stored, dissipation(p.damping, speed))

    parameters = (("first", 0), ("second", 0), ("stiffness", 2), ("damping", 2))
    return Element("bushing", "force", ("planar",), 2, parameters, define)


def test_a_new_force_says_itself_which_of_its_parameters_are_coefficients_of_damping():
    derived = derive(bushing(lambda c, v: c[0] * v[0] ** 2 / 2 + c[1] * v[1] ** 2 / 2), "planar")
    assert [derived.inputs["p"][i] for i in derived.damping] == ["damping_1", "damping_2"]
    assert "def potential(f, q, p):" in emit(derived, "a title")
    assert derive(bushing(lambda c, v: 0), "planar").damping == ()


def test_a_dissipation_function_that_does_not_vanish_with_its_coefficients_is_refused():
    with pytest.raises(ValueError, match="a sum of coefficients"):
        derive(bushing(lambda c, v: c[0] ** 2 * v[0] ** 2), "planar")
    with pytest.raises(ValueError, match="a sum of coefficients"):
        derive(bushing(lambda c, v: v[0] ** 2), "planar")


def test_the_coefficients_of_what_has_a_potential_do_not_change_with_the_motion():
    with pytest.raises(ValueError, match="no parameters that change with the motion"):
        moved_kernel("planar_spring", "planar", ((4, parse("2 + x").root, True),), ("x",), ())


# --- the tape -------------------------------------------------------------------------------------------------------


@pytest.fixture
def tape():
    return Tape()


def put(tape, text):
    """Return an expression in x, y, z as a term."""
    return parse(text).evaluate({name: tape.input(name) for name in "xyz"}, tape.arithmetic())


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("(x + y)**2", "x**2 + 2*x*y + y**2"),
        ("sin(x*y)**2 + cos(y*x)**2", "1"),
        ("(x*y)/y", "x"),
        ("x - 2*y", "-2*(y - x/2)"),
        ("(x + y) + (x - y)", "2*x"),
        ("sqrt(x*y + z)", "sqrt(z + y*x)"),
        ("(y + x)/3 - x/3 - y/3", "0"),
    ],
)
def test_expressions_that_are_identical_are_one_term(tape, one, other):
    first, second = put(tape, one), put(tape, other)
    assert (first.step, first.coefficient) == (second.step, second.coefficient)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("abs(x)", "x"),
        ("sqrt(x**2)", "x"),
        ("sqrt(x**2 - 2*x*y + y**2)", "x - y"),
        ("atan2(sin(x), cos(x))", "x"),
        ("asin(sin(x))", "x"),
        ("smooth_start(x)", "x**2*(3 - 2*x)"),
        ("sin(x)", "x"),
        ("x**0.5*x**0.5", "abs(x)"),
    ],
)
def test_expressions_that_are_equal_in_some_states_only_are_different_terms(tape, one, other):
    first, second = put(tape, one), put(tape, other)
    assert (first.step, first.coefficient) != (second.step, second.coefficient)


def test_multiples_of_a_sum_share_its_step(tape):
    terms = [put(tape, text) for text in ("x + 2*y", "3*x + 6*y", "-x/7 - 2*y/7")]
    assert {term.step for term in terms} == {terms[0].step}
    assert [term.coefficient / terms[0].coefficient for term in terms] == [1, 3, Fraction(-1, 7)]


def test_equal_products_are_computed_once(tape):
    terms = [put(tape, text) for text in ("x*y", "y*x", "(x*y*z)/z", "2*x*(y/2)", "-x*(-y)")]
    assert {(term.step, term.coefficient) for term in terms} == {(terms[0].step, 1)}
    assert tape.steps[terms[0].step] == Product(((tape.input("x").step, 1), (tape.input("y").step, 1)))


def test_a_zero_does_not_become_a_step(tape):
    before = len(tape.steps)
    assert put(tape, "x - x").is_zero
    assert put(tape, "0*(x + 0)").is_zero
    assert not any(isinstance(step, Sum) for step in tape.steps[before:])


@pytest.mark.parametrize("text", ["1/0", "1/(x - x)", "(y*x - x*y)**-1", "0**-2"])
def test_a_division_by_an_expression_that_vanishes_identically_is_refused(tape, text):
    with pytest.raises(ExpressionError, match=r"no value here \(division by zero\)"):
        put(tape, text)


@pytest.mark.parametrize("text", ["9**9**9", "(9**100)**100", "x**(2**50)", "2**0.5**x"])
def test_powers_that_would_fill_the_memory_are_left_to_the_arithmetic(tape, text):
    assert not put(tape, text).is_zero


def one_row(text):
    """Return the source of a kernel with one row in x."""
    tape = Tape()
    return emit(Derived({"q": ["x"]}, tape, {"E": {(0,): put(tape, text)}}, {}), "a title")


@pytest.mark.parametrize(
    ("text", "written"),
    [
        ("2*x/2", "x"),
        ("x + 1/3", "(1 + 3*x)/3"),
        ("-x*x*x", "-x*x*x"),
        ("x**9", "x**9"),
        ("x**-2", "1/(x*x)"),
        ("2/(3*x)", "2/(3*x)"),
        ("sin(x/2)", "f.sin(x/2)"),
        ("0.123456*x", "x*f.number('0.123456')"),
        ("pi*x", "x*f.constants['pi']"),
        ("x**1.5", "f.power(x, f.number('3')/2)"),
        ("1 - x", "1 - x"),
        ("sqrt(x)*(1 - x)", "f.sqrt(x)*(1 - x)"),
    ],
)
def test_a_term_is_written_with_few_operations_and_exact_numbers(text, written):
    assert f"        {written},\n" in one_row(text)


def test_numbers_stay_exact_in_exact_arithmetics():
    module = {}
    exec(one_row("x/3 + 0.1 + sqrt(x)*0.123456789012345678"), module)
    f = symbol_arithmetic()
    (value,) = module["dynamics"](f, [f.number("4")])
    assert value == f.number("4") / 3 + f.number("0.1") + 2 * f.number("0.123456789012345678")


@pytest.mark.parametrize("operators", [" + ", " - ", "*", "/"])
def test_a_long_chain_is_written_without_deep_nesting(operators):
    text = operators.join(["x"] + [f"(x + {i})" for i in range(1, 400)])
    module = {}
    exec(compile(one_row(text), "<kernel>", "exec"), module)
    (value,) = module["dynamics"](FLOAT, [0.75])
    assert value == pytest.approx(parse(text).evaluate({"x": 0.75}, FLOAT), rel=1e-12, abs=0)
