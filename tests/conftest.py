"""Two lanes: by default a few cases of every test, with ``--long`` all of them.

A test with the mark ``table`` runs all its cases always, one with ``few(2)`` two of them; a test or a case with the
mark ``long`` runs with ``--long`` only.
Workers share the cores among them: linear algebra takes one thread in each.
"""

import os

import pytest
from sampling import FEW, differing

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def pytest_addoption(parser):
    parser.addoption("--long", action="store_true", help="all cases of all tests, also those that are slow")


@pytest.hookimpl(wrapper=True)
def pytest_generate_tests(metafunc):
    """Keep a few cases of a test; pytest has no public way to leave out cases before they are made."""
    yield
    if metafunc.config.getoption("long") or not metafunc._calls:
        return
    calls = [call for call in metafunc._calls if not any(mark.name == "long" for mark in call.marks)]
    few = metafunc.definition.get_closest_marker("few")
    if not metafunc.definition.get_closest_marker("table"):
        calls = differing(calls, few.args[0] if few else FEW)
    metafunc._calls = calls


def pytest_collection_modifyitems(config, items):
    """Leave out the tests of the long lane."""
    if config.getoption("long"):
        return
    left_out = [item for item in items if item.get_closest_marker("long")]
    if left_out:
        config.hook.pytest_deselected(items=left_out)
        items[:] = [item for item in items if not item.get_closest_marker("long")]
