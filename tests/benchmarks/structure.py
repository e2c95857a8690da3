"""What a reader of one answer meets: functions and files that run, and how rooms and objects hang together.

    python tests/benchmarks/structure.py [--list] [ARGUMENT ...]

Runs ``mbstab ARGUMENT ...`` (``eig pendulum.yaml``) in a process of its own, and counts the distinct named code objects
of the package that are entered, with the files that hold them; generated kernels are not counted. Of the sources it
counts circles of imports, imports from a room into one above it, and accesses to private names that another file or
library defines.
"""

import ast
import re
import subprocess
import sys
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from test_layers import FILES, PACKAGE, circling, imports, upward, upward_in_analysis

GOALS = {"functions": 700, "files": 90, "circles": 0, "upward": 0, "private": 10}
PUBLIC = {"_replace", "_asdict", "_fields", "_make", "_exit"}
"""Documented names of named tuples and of `os`."""
RUN = """
import contextlib, io, os, sys
from pathlib import Path
seen = set()
package = sys.argv.pop(1)
def enter(frame, event, argument):
    code = frame.f_code
    if event == "call" and code.co_filename.startswith(package) and not code.co_name.startswith("<"):
        seen.add((code.co_filename, code.co_qualname))
sys.setprofile(enter)
from mbstab.cli import main
with contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(SystemExit):
    main(sys.argv[1:])
sys.setprofile(None)
for file, name in sorted(seen):
    print(os.path.relpath(file, package), name)
"""


def entered(arguments: list[str]) -> list[tuple[str, str]]:
    """Return the functions of the package that a command enters, as files and qualified names."""
    command = [sys.executable, "-c", RUN, f"{PACKAGE}/", *arguments]
    run = subprocess.run(command, capture_output=True, encoding="utf-8", check=True)
    pairs = (line.split(" ", 1) for line in run.stdout.splitlines())
    return [(file, name) for file, name in pairs if not file.startswith("compiler/kernels/")]


def private(path: Path) -> list[str]:
    """Return the accesses of a file to private names of objects that it does not define itself."""
    text = path.read_text(encoding="utf-8")
    tree = ast.parse(text if re.search(r"(?<!self)(?<!cls)\._[a-z]", text) else "")
    own = set(re.findall(r"(?:def |self\.|^    )(_\w+)(?=\(|: | = )", text, re.MULTILINE))
    return [
        f"{path.relative_to(PACKAGE)}:{x.lineno}: {ast.unparse(x)}"
        for x in ast.walk(tree)
        if isinstance(x, ast.Attribute) and x.attr.startswith("_") and not x.attr.endswith("__")
        if x.attr not in PUBLIC | own and not (isinstance(x.value, ast.Name) and x.value.id in ("self", "cls"))
    ]


def main(arguments: list[str]) -> None:
    listed = "--list" in arguments
    asked = [x for x in arguments if x != "--list"] or ["eig", "pendulum.yaml"]
    functions = entered(asked)
    files = Counter(file for file, _ in functions)
    inside = [path for path in FILES if path.parent != PACKAGE]
    found = {
        "functions": [" ".join(pair) for pair in functions],
        "files": [f"{count:4} {file}" for file, count in files.most_common()],
        "circles": sorted(circling()),
        "upward": [f"{path.relative_to(PACKAGE)}: {name}" for path in inside for name in upward(path, imports(path))]
        + upward_in_analysis(),
        "private": [text for path in FILES for text in private(path)],
    }
    print(f"mbstab {' '.join(asked)}")
    for name, items in found.items():
        print(f"{name:10} {len(items):5}   goal {GOALS[name]}")
        if listed:
            print(*items, sep="\n")


if __name__ == "__main__":
    main(sys.argv[1:])
