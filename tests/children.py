"""Child processes that do not outlive the test that starts them."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any


def _as_in_a_terminal() -> None:
    """In the background of a script interrupts are ignored, under nohup the end of the terminal; that is inherited."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)


@contextmanager
def child(command: list[str], **options: Any) -> Iterator[subprocess.Popen[str]]:
    """Give a process that is killed at the end, however that comes about."""
    process = subprocess.Popen(command, text=True, encoding="utf-8", preexec_fn=_as_in_a_terminal, **options)
    try:
        yield process
    finally:
        process.kill()
        process.wait()
        for stream in (process.stdin, process.stdout, process.stderr):
            if stream is not None:
                stream.close()


def command_line(*arguments: object) -> list[str]:
    """Return the command line of the program."""
    return [sys.executable, "-m", "mbstab", *map(str, arguments)]


def until(condition: Callable[[], bool], process: subprocess.Popen[str], seconds: float = 30.0) -> None:
    """Wait for a condition while a process runs."""
    deadline = time.monotonic() + seconds
    while not condition():
        assert process.poll() is None, "the process ended early"
        assert time.monotonic() < deadline, f"nothing happened within {seconds:g} s"
        time.sleep(0.01)


def processor_time(process: subprocess.Popen[str]) -> float:
    """Return the seconds for which a process has worked (Linux)."""
    with open(f"/proc/{process.pid}/stat", encoding="ascii") as file:
        user, system = file.read().rpartition(")")[2].split()[11:13]
    return (int(user) + int(system)) / os.sysconf("SC_CLK_TCK")


def ended(number: int, seconds: float = 30.0) -> bool:
    """Return whether a process ends; its number is free a moment later."""
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        try:
            os.kill(number, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.01)
    return False
