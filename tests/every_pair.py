"""Every command with every example model and every parameter of it, each in a process of its own.

A call fails if it ends in a traceback, works for more than `SECONDS` or takes more than `MEMORY`;
verdicts of `eig` and of `sweep` at the same value must not contradict each other.
"""

import contextlib
import io
import json
import os
import pickle
import resource
import traceback
import warnings
from dataclasses import dataclass

from mbstab.model.library import installed_models
from mbstab.model.reader import read_model

SECONDS = 20
MEMORY = 1_000_000_000
POINTS = 5

COMMANDS = (
    ("check",),
    ("linearize",),
    ("equilibrium",),
    ("equilibrium", "--starts", "4"),
    ("eig", "--verify"),
    ("eig", "--precision", "20"),
    ("eig", "--certify"),
    ("compare", "--digits", "30"),
    ("compare", "--simulate", "--to", "0.1"),
    ("test",),
    ("simulate", "--to", "0.1"),
)
"""What is asked of every model as it is."""

ODD = (0.0, -1.0, 1e-200, 1e-8, 1e8, 1e200)
"""Settings of every parameter."""


@dataclass(frozen=True)
class Answer:
    """What a call did: its exit code, what it wrote, its traceback, seconds of work, and the most memory (bytes)."""

    args: tuple[str, ...]
    code: int
    out: str
    err: str
    traceback: str
    seconds: float
    memory: int

    @property
    def fault(self):
        """What is wrong with the call; empty: nothing."""
        if self.traceback:
            return self.traceback.strip().splitlines()[-1]
        if self.seconds > SECONDS:
            return f"{self.seconds:.0f} s"
        if self.memory > MEMORY:
            return f"{self.memory / 1e6:.0f} MB"
        return "" if self.code in (0, 1, 2, 3) else f"exit code {self.code}"


def called(*args, limit=4 * SECONDS):
    """Return what ``mbstab ARGS`` does in a process that begins as a copy of this one, for so many seconds of work."""
    read, write = os.pipe()
    child = os.fork()
    if not child:
        os.close(read)
        resource.setrlimit(resource.RLIMIT_CPU, (limit, limit))
        resource.setrlimit(resource.RLIMIT_AS, (8 * MEMORY, 8 * MEMORY))
        with os.fdopen(write, "wb") as stream:
            stream.write(pickle.dumps(_answer(args)))
        os._exit(0)
    os.close(write)
    with os.fdopen(read, "rb") as stream:
        data = stream.read()
    _, _, usage = os.wait4(child, 0)
    if not data:
        return Answer(args, -1, "", "", "", usage.ru_utime + usage.ru_stime, usage.ru_maxrss * 1024)
    return Answer(args, *pickle.loads(data), usage.ru_utime + usage.ru_stime, usage.ru_maxrss * 1024)


def _answer(args):
    from mbstab.cli.main import main

    warnings.simplefilter("ignore")
    out, err, found, code = io.StringIO(), io.StringIO(), "", 0
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            main.main([str(x) for x in args], prog_name="mbstab")
        except SystemExit as end:
            code = end.code or 0
        except BaseException:
            found = traceback.format_exc()
    return code, out.getvalue(), err.getvalue(), found


def ends(model, name):
    """Return the first and last value in which a parameter is swept, in its unit."""
    from mbstab.model.arithmetic import FLOAT
    from mbstab.model.parameters import evaluate_parameters
    from mbstab.model.ranges import sweep_values

    factor = model.parameters[name].factor
    if name in model.sweep:
        values = sweep_values(model, name)
        return float(values[0]) / factor, float(values[-1]) / factor
    value = float(evaluate_parameters(model, {}, FLOAT)[name]) / factor
    return (0.5 * value, 2.0 * value) if value else (-1.0, 1.0)


def of_model(path):
    """Yield what is asked of a model as it is."""
    for command, *options in COMMANDS:
        yield called(command, path, *options)


def of_parameter(path, name):
    """Yield the answers about a parameter; `eig` and `sweep` at the ends are compared."""
    first, last = ends(read_model(path), name)
    single = [called("eig", path, "--set", f"{name}={x!r}", "--format", "json") for x in (first, last)]
    values = ("--from", repr(first), "--to", repr(last), "--points", POINTS)
    swept = called("sweep", path, "--param", name, *values, "--format", "json")
    yield from single
    yield swept
    yield called("simulate", path, "--set", f"{name}={last!r}", "--to", "0.05")


def contradiction(single, swept):
    """Return what is contradictory between `eig` at both ends and a sweep; empty: nothing."""
    from mbstab.analysis.verdict.rule import STRENGTH

    if not swept.out:
        return ""
    verdicts = json.loads(swept.out)["verdicts"]
    for answer, word in zip(single, (verdicts[0], verdicts[-1]), strict=True):
        if answer.code or not answer.out:
            continue
        own = json.loads(answer.out)["verdict"]
        if word not in STRENGTH[own] and own not in STRENGTH[word]:
            return f"{' '.join(map(str, answer.args))}: {own}, in the sweep {word}"
    return ""


def odd_settings(path, name):
    """Yield what `eig` says at odd values of a parameter."""
    for value in ODD:
        yield called("eig", path, "--set", f"{name}={value!r}")


def everything():
    """Return models with their parameters."""
    return {path: tuple(read_model(path).parameters) for path in installed_models()}
