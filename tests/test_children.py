"""Child processes of tests end with them."""

import os
import subprocess
import sys

import pytest
from children import child, command_line, until


def test_a_child_ends_with_a_test_that_fails():
    with pytest.raises(AssertionError, match="nothing happened within"), child(["sleep", "60"]) as process:
        until(lambda: False, process, 0.02)
    with pytest.raises(ProcessLookupError):
        os.kill(process.pid, 0)


def test_a_child_that_ends_early_is_not_waited_for():
    with pytest.raises(AssertionError, match="ended early"), child([sys.executable, "-c", ""]) as process:
        until(lambda: False, process)


@pytest.mark.parametrize(
    "arguments", [("--help",), ("eig", "pendulum", "--require", "asymptotic", "-q"), ("models", "list"), ("schema",)]
)
def test_a_closed_pipe_ends_a_command_quietly_as_sigpipe_does(arguments):
    """Also one whose answer would have its own exit code: nobody has read it."""
    reading, writing = os.pipe()
    os.close(reading)
    with child(command_line(*arguments), stdout=writing, stderr=subprocess.PIPE) as process:
        os.close(writing)
        _, said = process.communicate(timeout=60)
    assert (process.returncode, said) == (141, "")
