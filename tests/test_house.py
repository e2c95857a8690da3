"""Files and functions written by hand are short and simple; those that are not are listed, and lists only shrink."""

import ast
import functools
import itertools
from pathlib import Path

ROOT = Path(__file__).parents[1]
HAND_WRITTEN = [path for folder in ("mbstab", "tests") for path in (ROOT / folder).rglob("*.py")]
FILES = sorted(path for path in HAND_WRITTEN if path.parent.name != "kernels")
LINES_OF_A_FILE = 600
LINES_OF_A_FUNCTION = 60
COMPLEXITY = 25
"""Ways through a function at most: one more than its branches, loops, handlers, conditions and their parts."""

NUMBERS_BESIDE_TOLERANCES = {
    "mbstab/analysis/sweep/batched_verdict.py:NOT_COUNTED",
    "mbstab/analysis/algebra/shift_invert.py:SEED",
    "mbstab/analysis/bounds/location.py:UNLIKE",
    "mbstab/analysis/verdict/smoothness.py:SMOOTH",
    "mbstab/analysis/verdict/minimum.py:RATIOS",
    "mbstab/analysis/spectrum/periodic.py:INSTANTS",
    "mbstab/analysis/verdict/wording.py:MOST",
    "mbstab/analysis/reference/symmetry_candidates.py:UNEVEN",
    "mbstab/analysis/simulate/run.py:LISTED",
    "mbstab/analysis/algebra/rounded.py:WHOLE",
    "mbstab/analysis/simulate/singular_passage.py:NODES",
    "mbstab/analysis/simulate/steppers/implicit.py:RADAU_GAMMA",
    "mbstab/analysis/simulate/steppers/implicit.py:RHO",
    "mbstab/analysis/sweep/batched_verdict.py:MINIMUM, MAXIMUM, MULTIPLE",
    "mbstab/analysis/sweep/batched_verdict.py:RIGHT, LEFT, AXIS, OPEN",
}
"""Codes, coefficients of integrators, lengths of lists, values without a structure: what is no tolerance."""

LONG_FILES = {
    "tests/test_certify.py",
    "tests/test_eigenvalues.py",
    "tests/test_equilibrium.py",
    "tests/test_extremes.py",
    "tests/test_kernels.py",
    "tests/test_motion.py",
    "tests/test_motion_pictures.py",
    "tests/test_reader.py",
    "tests/test_simulate.py",
    "tests/test_steady.py",
    "tests/test_sweep.py",
    "tests/zoo.py",
}

LONG_FUNCTIONS = {
    "mbstab/analysis/algebra/balls.py:ball_arithmetic",
    "mbstab/analysis/linear/symbolic.py:symbolic_blocks",
    "mbstab/analysis/simulate/run.py:_Leg.follow",
    "mbstab/analysis/simulate/steppers/layout.py:layout_of",
    "mbstab/compiler/derive.py:differentiate",
    "tests/random_mechanisms.py:_joined",
    "tests/test_simulate.py:test_the_bicycle_accelerates_as_basu_mandal_chatterjee_and_papadopoulos_print",
}

COMPLEX_FUNCTIONS = {
    "mbstab/analysis/verdict/critical.py:critical_zero",
    "mbstab/analysis/verdict/rule.py:judge",
    "mbstab/analysis/simulate/steppers/layout.py:layout_of",
    "mbstab/report/certificate.py:certificate_text",
    "tests/linear_oracle.py:truth",
    "tests/random_mechanisms.py:_joined",
}


def functions(path):
    """Return the functions of a file by their names with all that is around them."""
    found = {}

    def collect(node, around):
        for child in ast.iter_child_nodes(node):
            inside = around
            if isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
                inside = f"{around}.{child.name}" if around else child.name
                if not isinstance(child, ast.ClassDef):
                    found[f"{place(path)}:{inside}"] = child
            collect(child, inside)

    collect(ast.parse(path.read_text(encoding="utf-8")), "")
    return found


def place(path):
    return path.relative_to(ROOT).as_posix()


def complexity(function):
    """Return the cyclomatic complexity of a function; functions inside of it count for themselves."""
    count, nodes = 1, list(ast.iter_child_nodes(function))
    while nodes:
        node = nodes.pop()
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            continue
        if isinstance(node, ast.If | ast.IfExp | ast.For | ast.While | ast.ExceptHandler | ast.match_case):
            count += 1
        elif isinstance(node, ast.BoolOp):
            count += len(node.values) - 1
        elif isinstance(node, ast.comprehension):
            count += 1 + len(node.ifs)
        nodes += ast.iter_child_nodes(node)
    return count


@functools.cache
def sizes():
    """Return the number of lines and the complexity of every function; syntax trees are not kept."""
    return {
        name: (function.end_lineno - function.lineno + 1, complexity(function))
        for path in FILES
        for name, function in functions(path).items()
    }


def require(found, exceptions, limit):
    """Refuse what is beyond a limit and no exception, and exceptions that are none any more."""
    beyond = {name: size for name, size in found.items() if size > limit}
    new = {name: size for name, size in beyond.items() if name not in exceptions}
    assert not new, f"more than {limit}: {new}"
    ended = exceptions - beyond.keys()
    assert not ended, f"within the limit now, to be taken off the list: {ended}"


def test_files_are_short():
    lengths = {place(path): len(path.read_text(encoding="utf-8").splitlines()) for path in FILES}
    require(lengths, LONG_FILES, LINES_OF_A_FILE)


def test_functions_are_short():
    require({name: lines for name, (lines, _) in sizes().items()}, LONG_FUNCTIONS, LINES_OF_A_FUNCTION)


def test_functions_are_simple():
    require({name: ways for name, (_, ways) in sizes().items()}, COMPLEX_FUNCTIONS, COMPLEXITY)


def test_ways_through_a_function_are_counted():
    text = (
        "def f(x):\n  def g(): return 1 if x else 2\n  for y in x:\n    if y and x or g(): return [z for z in y if z]"
    )
    assert complexity(ast.parse(text).body[0]) == 1 + 1 + 1 + 2 + 2


def numeric(node):
    """Whether an expression consists of numbers."""
    if isinstance(node, ast.Constant):
        return type(node.value) in (int, float)
    inside = (ast.Tuple, ast.BinOp, ast.UnaryOp, ast.operator, ast.unaryop, ast.expr_context)
    return isinstance(node, inside) and all(numeric(x) or isinstance(x, inside[3:]) for x in ast.iter_child_nodes(node))


def test_tolerances_stand_together_in_their_wing():
    found = {
        f"{place(path)}:{ast.unparse(node.targets[0]).strip('()')}"
        for path in (ROOT / "mbstab" / "analysis").rglob("*.py")
        if path.name != "tolerances.py"
        for node in ast.parse(path.read_text(encoding="utf-8")).body
        if isinstance(node, ast.Assign) and numeric(node.value)
    }
    assert found == NUMBERS_BESIDE_TOLERANCES


def test_tolerances_are_described_and_used():
    used = {
        node.attr
        for path in FILES
        if path.is_relative_to(ROOT / "mbstab")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Attribute)
    }
    for path in (ROOT / "mbstab" / "analysis").glob("*/tolerances.py"):
        (tolerances,) = (x for x in ast.parse(path.read_text(encoding="utf-8")).body if isinstance(x, ast.ClassDef))
        fields = [
            (x, next_) for x, next_ in itertools.pairwise([*tolerances.body, None]) if isinstance(x, ast.AnnAssign)
        ]
        assert fields
        for x, next_ in fields:
            assert isinstance(next_, ast.Expr), f"{place(path)}: {x.target.id} is not described"
            assert x.target.id in used, f"{place(path)}: {x.target.id} is not used"
