"""Compute and store the truths that the tests ask for: ``python tests/truths/make.py [--again]``.

The tests that use truths are run. What is stored is taken as it is, unless all is to be computed again; what no test
asks for any more is removed.
"""

import inspect
import json
import os
import sys
from pathlib import Path

import pytest

TESTS = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(TESTS))
import truth  # noqa: E402


class Asking:
    """Of the tests those that ask for truths."""

    def pytest_collection_modifyitems(self, items):
        items[:] = [item for item in items if asks(item.function, set())]


def asks(function, seen):
    """Return whether a function of a test file asks for a truth, itself or through others of its file."""
    function = inspect.unwrap(function)
    if not inspect.isfunction(function) or function in seen:
        return False
    seen.add(function)
    if function is truth.exact_eigenvalues:
        return True
    names = set(names_in(function.__code__)) & function.__globals__.keys()
    return any(asks(function.__globals__[name], seen) for name in names)


def names_in(code):
    """Yield the names that a function uses, and those inside of it."""
    yield from code.co_names
    for inside in code.co_consts:
        if inspect.iscode(inside):
            yield from names_in(inside)


def main():
    """Run the tests with a table that fills, and write it."""
    known = {} if "--again" in sys.argv[1:] or not truth.STORE.exists() else truth.stored()
    wanted = {}

    def lookup(question):
        name = truth.key(question)
        if name not in wanted:
            wanted[name] = known.get(name) or truth.computed(question)
        return wanted[name]

    truth.lookup = lookup
    files = [path for path in sorted(TESTS.glob("test_*.py")) if "exact_eigenvalues" in path.read_text()]
    os.chdir(TESTS.parent)
    code = pytest.main(["-q", "-n", "0", "-p", "no:cacheprovider", "-m", "", *map(str, files)], [Asking()])
    # A test that fails may not have asked for all.
    table = {**known, **wanted} if code else wanted
    lines = [f"[{name}, {json.dumps(table[name])}]\n" for name in sorted(table)]
    truth.STORE.write_text("".join(lines), encoding="utf-8")
    print(f"{len(lines)} truths, {sum(map(len, lines)) // 1000} kB")
    return int(code)


if __name__ == "__main__":
    sys.exit(main())
