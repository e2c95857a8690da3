"""Child processes of tests end with them."""

import os
import sys

import pytest
from children import child, until


def test_a_child_ends_with_a_test_that_fails():
    with pytest.raises(AssertionError, match="nothing happened within"), child(["sleep", "60"]) as process:
        until(lambda: False, process, 0.02)
    with pytest.raises(ProcessLookupError):
        os.kill(process.pid, 0)


def test_a_child_that_ends_early_is_not_waited_for():
    with pytest.raises(AssertionError, match="ended early"), child([sys.executable, "-c", ""]) as process:
        until(lambda: False, process)
