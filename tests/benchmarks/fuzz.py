"""Mutated files and command lines: ``python tests/benchmarks/fuzz.py --files 100000 --lines 5000 [--seed 1]``.

Every mutated file is read and asked one question, every mutated command line is run, each with 20 s of CPU time
and 2 GB of memory. Printed are exceptions that are no errors of mbstab, hangs, control characters that are written, and
what libraries such as LAPACK write past Python.
"""

import argparse
import contextlib
import io
import os
import pickle
import random
import re
import resource
import shlex
import signal
import sys
import tempfile
import traceback
import unicodedata
import warnings
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from test_fuzz import JUNK, LINES, NUMBERS, TEXTS, VALUES, WORDS

import mbstab.analysis.simulate.simulate
import mbstab.analysis.spectrum.eigenvalues
import mbstab.analysis.sweep.sweep
import mbstab.api  # noqa: F401 (in the parent, that children need not)
from mbstab.cli import main

SECONDS = 20
MEMORY = 2_000_000_000
BATCH = 200

QUESTIONS = (
    "check FILE", "eig FILE", "eig FILE", "eig FILE --format json", "equilibrium FILE", "linearize FILE --full",
    "simulate FILE --to 0.05 --points 3", "test FILE", "response FILE", "energy FILE", "eig FILE --sensitivity",
    "eig FILE --rightmost --modes 2",
)  # fmt: skip
COMMAND_LINES = (
    "eig pendulum.yaml --set L=0.5 --format json", "eig top.yaml --set omega=5.6 --require stable",
    "eig pendulum.yaml --method index3", "eig pendulum.yaml --precision 20",
    "eig pendulum.yaml --certify --set L=[1,2]",
    "sweep top.yaml --param omega --from 0 --to 12 --points 5 --plot none", "check four_bar.yaml --format json",
    "sweep pendulum.yaml --param L --values 1,2,3 --plot none", "linearize pendulum.yaml --form pencil --frozen",
    "simulate pendulum.yaml --to 0.1 --points 3 --perturb rod.theta=0.1 --tol 1e-6",
    "equilibrium governor.yaml --starts 2", "simulate pendulum.yaml --to 0.1 --step 0.01 --method radau",
    "test pendulum.yaml --format junit", "models show top", "schema joints.revolute", "models list",
    "compare pendulum.yaml --digits 20", "linearize pendulum.yaml --symbolic", "energy top.yaml --format json",
    "response whipple_bicycle.yaml --from 0.1 --to 10 --points 5 --format json", "manual verdicts", "new rotor",
    "response dc_motor_arm.yaml --step 1 --points 5", "eig top.yaml --sensitivity --format csv",
    "response rigid_rotor.yaml --unbalance rotor --speed Omega --from 1 --to 9 --points 5",
    "eig car.yaml --modes 1 --rightmost",
    "design shimmy.yaml --vary a=0.1..0.5 --goal decay --steps 3",
)  # fmt: skip
ARGUMENTS = (
    "-1", "0", "1e999", "nan", "inf", "1e-300", "1e300", "2 kg", "[1,2]", "[2,1]", "1,2", "a=b", "L=", "=1", "--help",
    "-h", "--", "-", "", " ", "/dev/null", "/dev/zero", ".", "/", "nothing.yaml", "--quiet", "--full", "\x1b[31m",
    "\u202e", "²", "mode:1=0.1", "rate(rod.theta)=1", "--to", "--set", "-o", "--format", "npz", "9" * 400, "1/0",
    "rod.theta", "omega",
)  # fmt: skip


def mutated_text(text, rng):
    """Return a file with one to three changes."""
    for _ in range(rng.randint(1, 3)):
        kind, lines = rng.randrange(9), text.split("\n")
        i = rng.randrange(len(lines))
        if kind == 0:
            del lines[i]
        elif kind == 1:
            lines.insert(rng.randrange(len(lines)), lines[i])
        elif kind == 2:
            lines[i] = rng.choice(LINES)
        elif kind == 3:
            lines[i] = " " * rng.randint(0, 8) + lines[i].lstrip()
        elif kind in (4, 5, 6):
            pattern, new = (
                (r"(?<=[ \[])-?\d[\d.]*(?=[,\]}\n])", NUMBERS),
                (r"(?<=: )([^\s{}\[\],]+|\[[^\[\]]*\]|\{[^{}]*\})(?=[,}\n])", [*VALUES, *WORDS]),
                (r"[\w.*/+()-]+", WORDS),
            )[kind - 4]
            if found := list(re.finditer(pattern, text)):
                match = rng.choice(found)
                text = text[: match.start()] + rng.choice(new) + text[match.end() :]
            continue
        else:
            at = rng.randrange(len(text) + 1)
            text = text[:at] + (rng.choice(JUNK) if kind == 7 else "") + text[at + rng.randint(0, 20) :]
            continue
        text = "\n".join(lines)
    return text


def mutated_line(rng):
    """Return the arguments of a command line with one to three changes."""
    words = shlex.split(rng.choice(COMMAND_LINES))
    for _ in range(rng.randint(1, 3)):
        kind, i = rng.randrange(4), rng.randrange(len(words) + 1)
        other = rng.choice([*ARGUMENTS, *shlex.split(rng.choice(COMMAND_LINES))])
        if kind == 0:
            words.insert(i, other)
        elif kind == 1 and i < len(words):
            words[i] = other
        elif kind == 2 and i < len(words):
            del words[i]
        elif i < len(words):
            at = rng.randrange(len(words[i]) + 1)
            words[i] = words[i][:at] + rng.choice([*JUNK[:-12], "\x1b", "1", "-"]) + words[i][at:]
    return words


def expired(number, frame):
    """End a call that takes too long."""
    raise TimeoutError(f"more than {SECONDS} s")


def asked(arguments, past):
    """Return what is wrong with a call; empty: nothing. `past` is the file of what is written past Python."""
    out, err = io.StringIO(), io.StringIO()
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            main(arguments, prog_name="mbstab")
    except SystemExit as end:
        if end.code not in (0, 1, 2, 3, None):
            return f"exit code {end.code}"
    except BaseException:
        return traceback.format_exc()
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
    for c in set(out.getvalue() + err.getvalue()):
        if not (c.isprintable() or c in "\n\t" or unicodedata.category(c) == "Zs"):
            return f"control character {c!r}"
    written = os.pread(past, 200, 0)
    os.ftruncate(past, 0)
    return f"written past Python: {written.decode(errors='replace')}" if written else ""


def batch(seed, files, folder, past):
    """Return what was asked and is wrong, of `BATCH` files or command lines."""
    rng, wrong = random.Random(seed), []
    path = Path(folder) / f"fuzz-{seed}.yaml"
    for number in range(BATCH):
        if files:
            text = mutated_text(rng.choice(TEXTS), rng)
            path.write_bytes(text.encode("utf-8", "surrogatepass"))
            arguments = rng.choice(QUESTIONS).replace("FILE", str(path)).split()
        else:
            arguments = mutated_line(rng)
        if fault := asked(arguments, past):
            kept = Path(folder) / f"kept-{seed}-{number}.yaml"
            if files:
                kept.write_bytes(path.read_bytes())
            wrong.append((shlex.join(arguments), str(kept) if files else "", fault))
    path.unlink(missing_ok=True)
    return wrong


def child(seed, files, folder):
    """Start a batch in a process of its own; return its number and the pipe with its report."""
    read, write = os.pipe()
    pid = os.fork()
    if pid:
        os.close(write)
        return pid, read
    os.close(read)
    os.chdir(folder)
    sys.stdin = io.TextIOWrapper(io.BytesIO())
    past = os.open(f"past-{seed}", os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND)
    for stream in (1, 2):
        os.dup2(past, stream)
    warnings.simplefilter("ignore")
    signal.signal(signal.SIGPROF, expired)
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY + 2**32, MEMORY + 2**32))
    with os.fdopen(write, "wb") as stream:
        stream.write(pickle.dumps(batch(seed, files, folder, past)))
    os._exit(0)


def run(count, files, seed, folder, jobs):
    """Run batches side by side and print what is wrong."""
    counts, kinds, open_, number = Counter(), Counter(), [], 0
    batches = -(-count // BATCH)
    while number < batches or open_:
        while number < batches and len(open_) < jobs:
            open_.append((number, *child((seed << 20) + 2 * number + files, files, folder)))
            number += 1
        this, pid, read = open_.pop(0)
        with os.fdopen(read, "rb") as stream:
            data = stream.read()
        os.waitpid(pid, 0)
        counts["asked"] += BATCH
        if not data:
            counts["ended"] += 1
            print(f"batch {this} ended without a report", flush=True)
            continue
        for line, kept, fault in pickle.loads(data):
            counts["wrong"] += 1
            last = fault.strip().splitlines()[-1][:150]
            kinds[last] += 1
            if kinds[last] <= 3:
                print(f"{line}\n  {kept}\n{fault[-1500:]}", flush=True)
    print(f"{'files' if files else 'command lines'}: {dict(counts)}")
    for kind, times in kinds.most_common(20):
        print(f"  {times} × {kind}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--files", type=int, default=100_000)
    parser.add_argument("--lines", type=int, default=5_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    options = parser.parse_args()
    folder = tempfile.mkdtemp(prefix="fuzz-")
    run(options.lines, False, options.seed, folder, options.jobs)
    run(options.files, True, options.seed, folder, options.jobs)
