"""Imports point one way, heavy libraries are imported where they are needed and nowhere else."""

import ast
import functools
import re
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

import mbstab

PACKAGE = Path(mbstab.__file__).parent
# The types and symbols of mechanics come before the model: the file format is read from their tables.
LAYERS = ["records", "errors", "mechanics", "model", "compiler", "analysis", "report", "api", "cli"]
# Inside of the analysis: every wing rests on those before it.
WINGS = [
    "algebra",
    "reference",
    "linear",
    "bounds",
    "verdict",
    "spectrum",
    "response",
    "sweep",
    "design",
    "simulate",
    "proof",
    "compare",
]
ONLY_IN = {
    "yaml": {"model/yamlfile.py"},
    "click": {"cli"},
    "sympy": {"mechanics", "compiler", "model/arithmetic.py", "analysis/linear/symbolic.py", "report/symbolic.py"},
    "matplotlib": {"report/pictures", "report/animation"},
    "PIL": {"report/animation"},
    "rich": {"cli/terminal.py", "cli/handbook/terminal.py"},
    "markdown_it": {"cli/handbook/site.py"},
    "numba": {"compiler/machine"},
    "scipy": {
        "analysis",
        "report/export.py",
        "report/animation/frames.py",
        "report/animation/solids.py",
        "report/pictures/bifurcation.py",
        "report/pictures/stability_chart.py",
    },
    "mpmath": set(),
    "flint": {"model/balls.py", "analysis/algebra/digits.py", "analysis/spectrum/holding_force.py"}
    | {f"analysis/algebra/ball_{x}.py" for x in ("arrays", "matrices", "polynomials")}
    | {"analysis/reference/identities.py", "analysis/proof/krawczyk.py", "analysis/proof/characteristic.py"},
}
FILES = sorted(p for p in PACKAGE.rglob("*.py") if p.parent.name != "kernels")


def layer(module: str) -> int | None:
    """Return the layer of a module of the package; the package itself re-exports the interface, lazily."""
    parts = module.split(".")
    if parts[0] != "mbstab":
        return None
    return LAYERS.index(parts[1] if len(parts) > 1 and parts[1] in LAYERS else "api")


def imported(text: str) -> list[str]:
    """Return all modules that a text imports, anywhere, with the names that it takes from them."""
    found = []
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            found += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"imports are absolute: {ast.unparse(node)}"
            found += [f"{node.module}.{alias.name}" for alias in node.names]
    return found


@functools.cache
def imports(path: Path) -> list[str]:
    return imported(path.read_text(encoding="utf-8"))


def test_every_module_belongs_to_a_layer():
    loose = {p.relative_to(PACKAGE).parts[0].removesuffix(".py") for p in FILES} - set(LAYERS)
    assert loose == {"__init__", "__main__"}


def upward(path: Path, names: list[str]) -> list[str]:
    """Return those of the imports of a file that point to a layer above its own."""
    own = LAYERS.index(path.relative_to(PACKAGE).parts[0].removesuffix(".py"))
    return [name for name in names if (level := layer(name)) is not None and level > own]


def test_imports_point_one_way():
    outside = {PACKAGE / "__main__.py", PACKAGE / "__init__.py"}
    wrong = {str(path.relative_to(PACKAGE)): upward(path, imports(path)) for path in FILES if path not in outside}
    assert {path: names for path, names in wrong.items() if names} == {}


@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        ("import mbstab", ["mbstab"]),
        ("from mbstab import load", ["mbstab.load"]),
        ("from mbstab import report", ["mbstab.report"]),
        ("def f():\n    import mbstab.cli.main", ["mbstab.cli.main"]),
        ("from mbstab.errors import NumericalError\nfrom mbstab.analysis.linear import modes\nimport numpy", []),
    ],
)
def test_an_import_of_what_stands_above_is_seen(text, wrong):
    assert upward(PACKAGE / "analysis" / "sweep" / "jobs.py", imported(text)) == wrong


def module_of(path: Path) -> str:
    return ".".join(["mbstab", *path.relative_to(PACKAGE).with_suffix("").parts]).removesuffix(".__init__")


def upward_in_analysis() -> list[str]:
    """Return the imports of wings from those that rest on them."""
    wrong = []
    for path in (PACKAGE / "analysis").rglob("*.py"):
        parts = path.relative_to(PACKAGE / "analysis").parts
        if parts == ("__init__.py",):
            continue
        assert parts[0] in WINGS, f"{path} stands in no wing"
        for name in imports(path):
            other = name.split(".")
            if other[:2] == ["mbstab", "analysis"] and WINGS.index(other[2]) > WINGS.index(parts[0]):
                wrong.append(f"{path.relative_to(PACKAGE)} imports {name}")
    return wrong


def test_wings_rest_on_those_before_them():
    assert upward_in_analysis() == []


def test_the_page_for_engineers_names_places_that_exist_and_all_wings_in_their_order():
    text = (PACKAGE / "manual" / "inside.md").read_text(encoding="utf-8")
    named = re.findall(r"`((?:mbstab|tests|\.ci)/[\w./]*)`", text)
    assert len(named) > 30
    assert [x for x in named if "NAME" not in x and not (PACKAGE.parent / x).exists()] == []
    assert re.findall(r"^\| `(\w+)/` \|", text, re.MULTILINE) == WINGS


def circling() -> set[str]:
    """Return the modules that import each other in a circle; imports inside of functions and for types count."""
    modules = {module_of(path) for path in FILES}
    edges: dict[str, set[str]] = {}
    for path in FILES:
        pairs = [({name}, {name.rpartition(".")[0]}) for name in imports(path)]
        edges[module_of(path)] = set().union(*(name & modules or module & modules for name, module in pairs))
    while free := {name for name, found in edges.items() if not found & edges.keys()}:
        edges = {name: found for name, found in edges.items() if name not in free}
    return set(edges)


def test_no_modules_import_each_other_in_a_circle():
    assert circling() == set()


def test_the_count_of_what_an_answer_runs_finds_its_functions_and_files(capsys):
    runpy.run_path(str(Path(__file__).parent / "benchmarks" / "structure.py"))["main"](["--list"])
    shown = capsys.readouterr().out
    counts = {words[0]: int(words[1]) for words in map(str.split, shown.splitlines()) if words[2:3] == ["goal"]}
    assert counts.keys() == {"functions", "files", "circles", "upward", "private"}
    assert counts["functions"] > counts["files"] > 50
    assert counts["circles"] == counts["upward"] == 0
    assert "api/mechanism.py Mechanism.eig\n" in shown


def test_each_library_is_imported_in_its_places_only():
    wrong = [
        f"{path.relative_to(PACKAGE)} imports {library}"
        for library, places in ONLY_IN.items()
        for path in FILES
        if any(name.split(".")[0] == library for name in imports(path))
        and not any(f"{path.relative_to(PACKAGE).as_posix()}/".startswith(f"{place}/") for place in places)
    ]
    assert wrong == []


LIBRARIES = (
    "numpy numpy.ma numpy.random numpy.typing multiprocessing concurrent.futures logging rich sympy scipy mpmath "
    "matplotlib yaml flint"
)
"""What takes noticeably long to import."""


def loaded_by(arguments: list[str]) -> set[str]:
    code = (
        "import sys\n"
        "from mbstab.cli import main\n"
        "try:\n    main(sys.argv[1:])\n"
        "except SystemExit as stop:\n    assert not stop.code, stop.code\n"
        f"print('loaded:', *[m for m in '{LIBRARIES}'.split() if m in sys.modules])\n"
    )
    run = subprocess.run([sys.executable, "-c", code, *arguments], capture_output=True, encoding="utf-8", check=True)
    return set(run.stdout.splitlines()[-1].split()[1:])


def test_flint_is_imported_inside_functions_only():
    for path in (PACKAGE / name for name in ONLY_IN["flint"]):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        outside = [name for node in tree.body for name in ([node.module] if isinstance(node, ast.ImportFrom) else [])]
        assert not any(name.startswith("flint") for name in outside)


def test_help_imports_no_numerics():
    assert loaded_by(["--help"]) == set()


# But where equal eigenvalues are defective: their subspaces come from a Schur form. Symmetries are verified in balls.
@pytest.mark.parametrize(
    ("model", "more"),
    [
        ("pendulum.yaml", set()),
        ("top.yaml", {"flint"}),
        ("trailer.yaml", {"flint"}),
        ("rolling_torus.yaml", {"flint"}),
        ("whipple_bicycle.yaml", {"flint"}),
    ],
)
def test_eig_imports_neither_sympy_nor_scipy_nor_matplotlib(model, more):
    assert loaded_by(["eig", model]) == {"numpy", "yaml"} | more


def test_the_help_of_eig_lists_its_methods_without_numerics():
    assert loaded_by(["eig", "--help"]) == set()


def test_eig_as_json_needs_no_tables():
    assert loaded_by(["eig", "pendulum.yaml", "--format", "json"]) == {"numpy", "yaml"}
