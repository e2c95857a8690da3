"""Tolerances stand together, described, in their wing; every file of tests stands in the map."""

import ast
import itertools
import re
from pathlib import Path

ROOT = Path(__file__).parents[1]

NUMBERS_BESIDE_TOLERANCES = {
    "mbstab/analysis/sweep/batched_verdict.py:NOT_COUNTED",
    "mbstab/analysis/algebra/shift_invert.py:SEED",
    "mbstab/analysis/bounds/location.py:UNLIKE",
    "mbstab/analysis/verdict/smoothness.py:SMOOTH",
    "mbstab/analysis/verdict/minimum.py:RATIOS",
    "mbstab/analysis/spectrum/periodic.py:INSTANTS",
    "mbstab/analysis/verdict/wording.py:MOST",
    "mbstab/analysis/reference/symmetries.py:UNEVEN",
    "mbstab/analysis/simulate/run.py:LISTED",
    "mbstab/analysis/algebra/rounded.py:WHOLE",
    "mbstab/analysis/simulate/singular_passage.py:NODES",
    "mbstab/analysis/sweep/batched_verdict.py:MINIMUM, MAXIMUM, MULTIPLE",
    "mbstab/analysis/verdict/rule.py:RIGHT, LEFT, AXIS, OPEN",
}
"""Codes, coefficients of integrators, lengths of lists, values without a structure: what is no tolerance."""


def place(path):
    return path.relative_to(ROOT).as_posix()


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
        name
        for path in (ROOT / "mbstab").rglob("*.py")
        if path.parent.name != "kernels"
        for name in re.findall(r"[.](\w+)", path.read_text(encoding="utf-8"))
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


def test_the_map_of_the_tests_names_each_file_once():
    named = re.findall(
        r"^\| `(test_\w+\.py)` \|", (ROOT / "tests" / "README.md").read_text(encoding="utf-8"), re.MULTILINE
    )
    assert sorted(named) == sorted(path.name for path in (ROOT / "tests").glob("test_*.py"))
