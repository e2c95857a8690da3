"""Do the tests notice mistakes? Forty mistakes are drawn from a fixed seed and made one at a time.

Kinds of mistakes: a sign (a + b for a - b, a for -a), a factor (2*a for a in a product), a dropped term (a for a + b),
a loosened bound (a thousand times a tolerance, or what an error is compared to). They are drawn in turn from all
packages, by a hash of seed, file and text, so that most stay the same while the program changes.

    python tests/benchmarks/mutants.py list
    python tests/benchmarks/mutants.py record mutants.json   runs the tests once
    python tests/benchmarks/mutants.py run mutants.json      each mutant: the tests that touch it, until one fails

`record` keeps the tests that reach the place of each mutant and the time of every test. `--checkout` names another
clone whose program and tests are asked, `--only 3,7` some of the mutants, `--pytest` further arguments of pytest
(``--pytest=--long``). A mutant on which tests run far longer than without it counts as noticed.
"""

import argparse
import ast
import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ElementTree
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
SEED, NUMBER = 38, 40
KINDS = ("sign", "factor", "term", "bound")
GENERATED = "mbstab/compiler/kernels/"
NO_NUMBERS = (ast.JoinedStr, ast.List, ast.ListComp, ast.Tuple)
LIMIT = re.compile("bound|error|limit|radi|rounding|tol|known|most", re.IGNORECASE)


@dataclass(frozen=True)
class Mutant:
    """One mistake: in the file `path`, `text` at the offset `start` (bytes) becomes `new`."""

    kind: str
    path: str
    function: str
    line: int
    start: int
    text: str
    new: str

    def __str__(self):
        return f"{self.path}:{self.line} {self.function}: {self.kind}: {self.text} -> {self.new}"

    def applied(self, source: bytes) -> bytes:
        stop = self.start + len(self.text.encode())
        assert source[self.start : stop] == self.text.encode(), f"{self.path} is not what mutants were drawn from"
        return source[: self.start] + self.new.encode() + source[stop:]


def is_text(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, str)


def replacements(node: ast.AST, text_of) -> list[tuple[str, str]]:
    """Return the mistakes that can be made at a node: their kinds and what stands there instead."""
    match node:
        case ast.BinOp(left=left, right=right) if any(isinstance(x, NO_NUMBERS) or is_text(x) for x in (left, right)):
            return []
        case ast.BinOp(left=left, op=ast.Add() | ast.Sub(), right=right):
            other = "-" if isinstance(node.op, ast.Add) else "+"
            return [("sign", f"({text_of(left)} {other} ({text_of(right)}))"), ("term", f"({text_of(left)})")]
        case ast.UnaryOp(op=ast.USub(), operand=operand) if not isinstance(operand, ast.Constant):
            return [("sign", f"({text_of(operand)})")]
        case ast.BinOp(op=ast.Mult() | ast.Div()):
            return [("factor", f"(2 * ({text_of(node)}))")]
        case ast.Attribute(value=ast.Name(id="TOLERANCES")):
            return [("bound", f"(1000 * {text_of(node)})")]
        case ast.Compare(left=left, ops=[ast.Lt() | ast.LtE()], comparators=[right]) if LIMIT.search(text_of(right)):
            sign = "<" if isinstance(node.ops[0], ast.Lt) else "<="
            return [("bound", f"({text_of(left)} {sign} 1000 * ({text_of(right)}))")]
    return []


def candidates(root: Path) -> list[Mutant]:
    """Return every mistake that could be made in a function written by hand."""
    found = []
    for path in sorted((root / "mbstab").rglob("*.py")):
        place = path.relative_to(root).as_posix()
        if place.startswith(GENERATED):
            continue
        source = path.read_bytes()
        starts = [0]
        for row in source.splitlines(keepends=True):
            starts.append(starts[-1] + len(row))

        def span(node, starts=starts):
            return starts[node.lineno - 1] + node.col_offset, starts[node.end_lineno - 1] + node.end_col_offset

        def text_of(node, source=source, span=span):
            start, stop = span(node)
            return source[start:stop].decode()

        def visit(node, function, inside, place=place, span=span, text_of=text_of):
            if isinstance(node, ast.JoinedStr):
                return
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                inside = inside or isinstance(node, ast.FunctionDef)
                function = f"{function}.{node.name}".lstrip(".")
                children = node.body
            else:
                children = list(ast.iter_child_nodes(node))
                if inside:
                    for kind, new in replacements(node, text_of):
                        start, _ = span(node)
                        found.append(Mutant(kind, place, function, node.lineno, start, text_of(node), new))
            for child in children:
                visit(child, function, inside)

        visit(ast.parse(source), "", False)
    return found


def drawn(root: Path) -> list[Mutant]:
    """Return the mutants: in turn from every package and of every kind, those with the least hashes."""
    groups = defaultdict(list)
    for mutant in candidates(root):
        parts = mutant.path.split("/")
        groups[parts[1] if parts[1] != "analysis" else "/".join(parts[1:3]), mutant.kind].append(mutant)

    def rank(mutant):
        text = f"{SEED} {mutant.path} {mutant.function} {mutant.kind} {mutant.text}"
        return hashlib.sha256(text.encode()).hexdigest()

    for group in groups.values():
        group.sort(key=rank, reverse=True)
    packages = sorted({package for package, _ in groups})
    packages.sort(key=lambda x: hashlib.sha256(f"{SEED} {x}".encode()).hexdigest())
    found, turn = [], 0
    while len(found) < NUMBER:
        group = groups.get((packages[turn % len(packages)], KINDS[(turn + turn // len(packages)) % len(KINDS)]))
        if group:
            found.append(group.pop())
        turn += 1
    return found


def environment(root: Path) -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(root), "OPENBLAS_NUM_THREADS": "1"}


HITS = """
import os

kept, seen = open({file!r}, "a", buffering=1), set()


def hit(number):
    hit = number, os.environ.get("PYTEST_CURRENT_TEST", "").rpartition(" (")[0]
    if hit not in seen:
        seen.add(hit)
        kept.write("%d %s\\n" % hit)
"""


def watched(source: bytes, mutants: dict[int, Mutant]) -> bytes:
    """Return a source in which the place of every mutant says when it is reached."""
    pieces = []
    for number, mutant in mutants.items():
        assert source.startswith(mutant.text.encode(), mutant.start), (
            f"{mutant.path} is not what mutants were drawn from"
        )
        stop = mutant.start + len(mutant.text.encode())
        # Where places begin together the longer one is outside.
        pieces.append((mutant.start, -stop, f'(__import__("mutant_hits").hit({number}) or ('.encode()))
        pieces.append((stop, 0, b"))"))
    for place, _, piece in sorted(pieces, reverse=True):
        source = source[:place] + piece + source[place:]
    return source


def record(root: Path, file: Path, more: list[str]) -> None:
    """Run the tests once; write the tests that reach each mutant, the quickest first, and their times as JSON."""
    mutants = drawn(root)
    with tempfile.TemporaryDirectory() as folder:
        copy, hits, times = Path(folder) / "copy", Path(folder) / "hits", Path(folder) / "times.xml"
        copy_program(root, copy)
        (copy / "mutant_hits.py").write_text(HITS.format(file=str(hits)))
        for path in {x.path for x in mutants}:
            place = copy / path
            place.write_bytes(watched(place.read_bytes(), {k: x for k, x in enumerate(mutants) if x.path == path}))
        command = [
            sys.executable,
            *["-m", "pytest", "-q", "-n", "2", "--dist", "worksteal"],
            f"--junitxml={times}",
            *more,
        ]
        subprocess.run(command, cwd=copy, env=environment(copy), check=False)
        seconds: dict[str, float] = defaultdict(float)
        for case in ElementTree.parse(times).iter("testcase"):
            seconds[f"{case.get('classname')}.{case.get('name')}"] += float(case.get("time", 0))
        touching = defaultdict(set)
        for row in hits.read_text().splitlines():
            number, _, test = row.partition(" ")
            if test:
                touching[int(number)].add(test)
    found = {str(x): sorted(touching[k], key=lambda x: seconds[junit_name(x)]) for k, x in enumerate(mutants)}
    file.write_text(json.dumps({"touching": found, "seconds": seconds}))


def junit_name(test: str) -> str:
    """Return the name that JUnit's XML has for a test."""
    path, _, name = test.partition("::")
    return f"{re.sub('[.]py$', '', path).replace('/', '.')}.{name.replace('::', '.')}"


def run(root: Path, file: Path, more: list[str], only: set[int] | None) -> None:
    """Make each mistake in a copy and run the tests that touch it, the quickest first, until one fails."""
    kept = json.loads(file.read_text())
    caught = total = 0
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "copy"
        copy_program(root, copy)
        for number, mutant in enumerate(drawn(root)):
            if only and number not in only:
                continue
            tests = kept["touching"].get(str(mutant), [])
            verdict, seconds = "no test touches it", 0.0
            if tests:
                seconds = sum(kept["seconds"].get(junit_name(x), 0) for x in tests)
                verdict = noticed(copy, mutant, tests, 120 + 5 * seconds, more)
            total += 1
            caught += verdict.startswith("noticed")
            print(f"{number:3d} {mutant}\n    {len(tests)} tests, {seconds:.0f} s; {verdict}", flush=True)
    print(f"{caught} of {total} noticed")


def noticed(copy: Path, mutant: Mutant, tests: list[str], limit: float, more: list[str]) -> str:
    """Return how the tests end on a mutant."""
    place = copy / mutant.path
    right = place.read_bytes()
    place.write_bytes(mutant.applied(right))
    (copy / ".tests").write_text("\n".join(tests))
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-n", "2", "-p", "no:cacheprovider", *more, "@.tests"]
    subprocess.run([sys.executable, "-m", "mbstab.compiler.build"], cwd=copy, env=environment(copy), check=False)
    try:
        ended = subprocess.run(
            command, cwd=copy, env=environment(copy), timeout=limit, capture_output=True, text=True, check=False
        )
    except subprocess.TimeoutExpired:
        return "noticed: too slow"
    finally:
        place.write_bytes(right)
    # Ended by -x, pytest-xdist answers 2 for 1.
    if failed := re.search(r"^(?:FAILED|ERROR) (\S+)", ended.stdout, re.MULTILINE):
        return f"noticed by {failed[1]}"
    return "survived" if ended.returncode == 0 else f"pytest ended with {ended.returncode}: {ended.stdout[-300:]}"


def copy_program(root: Path, copy: Path) -> None:
    shutil.copytree(root, copy, ignore=shutil.ignore_patterns(".git", "__pycache__", ".*_cache"))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("task", choices=["list", "record", "run"])
    parser.add_argument("file", type=Path, nargs="?")
    parser.add_argument("--checkout", type=Path, default=ROOT)
    parser.add_argument("--only", type=lambda text: {int(x) for x in text.split(",")})
    parser.add_argument("--pytest", action="append", default=[])
    given = parser.parse_args()
    root = given.checkout.resolve()
    if given.task == "list":
        for number, mutant in enumerate(drawn(root)):
            print(f"{number:3d} {mutant}")
    elif given.task == "record":
        record(root, given.file, given.pytest)
    else:
        run(root, given.file, given.pytest, given.only)


if __name__ == "__main__":
    main()
