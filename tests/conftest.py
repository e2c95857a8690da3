"""Two lanes: by default a few cases of every test, with ``--long`` all of them.

A test with the mark ``table`` runs all its cases always, a test or a case with the mark ``long`` only with ``--long``.
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
    is_table = metafunc.definition.get_closest_marker("table")
    metafunc._calls = calls if is_table else differing(calls, FEW)


def pytest_collection_modifyitems(config, items):
    """Leave out the tests of the long lane."""
    if config.getoption("long"):
        return
    left_out = [item for item in items if item.get_closest_marker("long")]
    if left_out:
        config.hook.pytest_deselected(items=left_out)
        items[:] = [item for item in items if not item.get_closest_marker("long")]
