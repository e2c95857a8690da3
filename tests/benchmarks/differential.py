"""Two versions of mbstab side by side: what differs, and who is right where an oracle knows.

    python tests/benchmarks/differential.py OLD NEW [--suites gallery,zoo] [--mechanisms 500] [--linear 2000] [FILE ...]

OLD and NEW are Python interpreters in whose environments a version is installed, or folders that hold a package
``mbstab`` (a checkout). The same questions go to both: `eig` and `sweep` of the shipped models and of the files named,
`eig` with every parameter of these at its extremes, the zoo, models whose eigenvalues are stored with 80 digits, random
mechanisms, random linear systems. Each version answers in one process of its own, at the same time as the other.

Printed is every question whose answers differ or end in an exception: exit codes, verdicts, eigenvalues farther apart
than both their bounds, critical values. Where a truth is known (proof, many digits, exact integers), it is said which
of the two it contradicts. A table has the number of questions, differences and contradictions, and the processor time.
"""

import argparse
import contextlib
import io
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter, defaultdict
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).parents[2]
SUITES = ("gallery", "sweeps", "extremes", "zoo", "truths", "mechanisms", "linear", "files")
FACTORS = (0.0, -1.0, 1e-8, 1e8)
"""By what parameters are multiplied at their extremes."""
SECONDS = 60
"""The longest processor time of an answer (s): what runs beside decides nothing."""
ROUNDING = 1e-12
"""Distance of eigenvalues, relative to the largest, that no bound need explain: exact ones are rounded as well."""
CRITICAL = 1e-8
"""Distance of critical values, relative to the range."""


# --- the process of one version -------------------------------------------------------------------------------------


def work() -> None:
    """Answer questions from standard input, one JSON object a line."""
    import warnings

    from mbstab.cli.main import main as command

    warnings.simplefilter("ignore")
    signal.signal(signal.SIGPROF, _stop)
    out = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    for line in sys.stdin:
        arguments = json.loads(line)
        shown, said, code = io.StringIO(), io.StringIO(), 0
        start = time.process_time()
        signal.setitimer(signal.ITIMER_PROF, SECONDS)
        with contextlib.redirect_stdout(shown), contextlib.redirect_stderr(said):
            try:
                command.main(arguments, prog_name="mbstab")
            except SystemExit as end:
                code = end.code or 0
            except BaseException as error:
                code = f"{type(error).__name__}: {error}"
        signal.setitimer(signal.ITIMER_PROF, 0)
        spent = time.process_time() - start
        answer = None
        with contextlib.suppress(ValueError):
            answer = _brief(json.loads(shown.getvalue()))
        print(json.dumps([code, answer, said.getvalue()[-300:], spent]), file=out, flush=True)


def _stop(*_) -> None:
    raise TimeoutError(f"no answer in {SECONDS} s")


def _brief(data: dict) -> dict:
    """Return what is compared of an answer."""
    if "eigenvalues" in data:
        # What is neutral is exact: what differs from zero there by no more than its bound is rounding.
        exact = [e["kind"] == "neutral" for e in data["eigenvalues"]]
        sizes = [abs(complex(e["real"], e["imag"])) for e in data["eigenvalues"]]
        bounds = [float("inf") if e["error_bound"] is None else e["error_bound"] for e in data["eigenvalues"]]
        values = [
            [0.0] * 3 if known and size <= bound else [e["real"], e["imag"], 0.0 if known else e["error_bound"]]
            for e, known, size, bound in zip(data["eigenvalues"], exact, sizes, bounds, strict=True)
        ]
        return {"verdict": data["verdict"], "eigenvalues": values, "in_place": data.get("in_place")}
    critical = [[x["value"], x["kind"]] for x in data["critical"]]
    values = data["values"]
    return {"verdicts": data["verdicts"], "critical": critical, "range": abs(values[-1] - values[0]) or 1.0}


class Version:
    """A version that answers questions in a process of its own."""

    def __init__(self, place: str):
        self.place = place
        folder = Path(place).is_dir()
        command = [sys.executable if folder else place, str(Path(__file__).resolve()), "--work"]
        environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
        environment |= {"OPENBLAS_NUM_THREADS": "1"} | ({"PYTHONPATH": str(Path(place).resolve())} if folder else {})
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
            env=environment, cwd=tempfile.gettempdir(),
        )  # fmt: skip
        self.answers: list[Answer] = []

    def ask(self, questions: list["Question"]) -> None:
        """Answer all questions, in their order."""
        assert self.process.stdin
        assert self.process.stdout
        for question in questions:
            self.process.stdin.write(json.dumps(question.arguments) + "\n")
            self.process.stdin.flush()
            line = self.process.stdout.readline()
            if not line:
                raise SystemExit(f"{self.place} ended at: mbstab {' '.join(question.arguments)}")
            self.answers.append(Answer(*json.loads(line)))


# --- questions and answers ------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Answer:
    """Exit code or exception, what is compared, the end of what was said on stderr, and processor time (s)."""

    code: int | str
    data: dict | None
    said: str
    seconds: float


@dataclass(frozen=True)
class Question:
    """A command line, its suite, and what is known: verdicts that are true, the expected one, exact eigenvalues."""

    suite: str
    name: str
    arguments: list[str]
    allowed: frozenset[str] = frozenset()
    in_place: bool | None = None
    expected: str = ""
    exact: object = None
    """A function that returns eigenvalues that are not neutral, with many digits."""


@dataclass
class Comparison:
    """What was counted of a suite."""

    questions: int = 0
    differences: int = 0
    wrong: Counter = field(default_factory=Counter)
    seconds: Counter = field(default_factory=Counter)
    stronger: int = 0
    weaker: int = 0


def questions(suites: set[str], folder: Path, mechanisms: int, linear: int, files: list[Path]) -> list[Question]:
    """Return the questions; texts of models are written to a folder."""
    found: list[Question] = []
    shipped = sorted((ROOT / "models").glob("*.yaml"))
    for path in [*shipped, *files]:
        own = "files" if path in files else ""
        if (own or "gallery") in suites:
            found.append(Question(own or "gallery", path.stem, eig(path)))
        if (own or "sweeps") in suites:
            found += sweeps(own or "sweeps", path)
        if not own and "extremes" in suites:
            found += extremes(path)
    makers = {"zoo": zoo, "truths": truths}
    for suite, maker in makers.items():
        if suite in suites:
            found += maker(folder)
    if "mechanisms" in suites:
        found += random_mechanisms(folder, mechanisms)
    if "linear" in suites:
        found += linear_systems(folder, linear)
    return found


def eig(path: Path, **values: str) -> list[str]:
    settings = [part for name, value in values.items() for part in ("--set", f"{name}={value}")]
    return ["eig", str(path), "--format", "json", *settings]


def read(path: Path):
    """Return a model, or None where it cannot be read."""
    from mbstab.errors import MbstabError
    from mbstab.model.reader import read_model

    with contextlib.suppress(MbstabError):
        return read_model(path)
    return None


def sweeps(suite: str, path: Path) -> list[Question]:
    model = read(path)
    names = list(model.sweep) if model else []
    return [
        Question(suite, f"{path.stem} over {name}", ["sweep", str(path), "--param", name, *["--format", "json"]])
        for name in names[:1]
    ]


def extremes(path: Path) -> list[Question]:
    from mbstab.model.arithmetic import FLOAT
    from mbstab.model.parameters import evaluate_parameters

    model = read(path)
    found = []
    for name, value in evaluate_parameters(model, {}, FLOAT).items():
        plain = float(value) / model.parameters[name].factor
        for factor in FACTORS:
            text = repr(factor * (plain or 1.0))
            found.append(Question("extremes", f"{path.stem} {name}={text}", eig(path, **{name: text})))
    return found


def written(folder: Path, name: str, text: str) -> Path:
    path = folder / f"{name.replace('/', '_')[:80]}.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def zoo(folder: Path) -> list[Question]:
    from zoo import SYSTEMS

    found = []
    for number, system in enumerate(SYSTEMS):
        path = written(folder, f"zoo{number}", system.text)
        found.append(Question("zoo", system.name, eig(path), frozenset(system.allowed), system.in_place, system.best))
        if "sweep" in system.commands:
            name, values = system.swept
            points = 3 if name == "dummy" else 21  # on which nothing depends: all points are one
            ends = ["--from", repr(values[0]), "--to", repr(values[-1]), "--points", str(points), "--format", "json"]
            found.append(Question("zoo", f"{system.name} over {name}", ["sweep", str(path), "--param", name, *ends]))
    return found


def truths(folder: Path) -> list[Question]:
    from functools import partial

    from truth import lookup, number, stored

    found = []
    for position, key in enumerate(stored()):
        question = json.loads(key)
        text, parameters = question["model"], question["parameters"]
        path = written(folder, f"truth{position}", text) if "\n" in text else ROOT / "models" / text
        model = read(path)
        if model is None or not set(parameters) <= model.parameters.keys():
            continue
        values = {k: f"({v})/({model.parameters[k].factor!r})" for k, v in parameters.items()}

        def exact(question=question):
            return [number(parts) for parts in lookup(question)["eigenvalues"]]

        name = f"{path.stem} {' '.join(f'{k}={v}' for k, v in parameters.items())}"
        found.append(Question("truths", name, eig(path, **values), exact=partial(exact)))
    return found


def random_mechanisms(folder: Path, count: int) -> list[Question]:
    from random_mechanisms import random_mechanism

    found = []
    for seed in range(count):
        text = random_mechanism(seed)
        path = written(folder, f"mechanism{seed}", text)

        def exact(text=text):
            from discs import exact

            import mbstab

            return exact(mbstab.loads(text))

        found.append(Question("mechanisms", f"seed {seed}", eig(path), exact=exact))
    return found


def linear_systems(folder: Path, count: int) -> list[Question]:
    from linear_oracle import random_system, text, truth

    rng, found = random.Random(1), []
    for number in range(count):
        K, D = random_system(rng, rng.randint(1, 4))
        known = truth(K, D)
        path = written(folder, f"linear{number}", text(K, D))
        found.append(
            Question("linear", f"K={K} D={D}", eig(path), frozenset(known.allowed), known.in_place, known.expected)
        )
    return found


# --- comparison -----------------------------------------------------------------------------------------------------


def differences(question: Question, old: Answer, new: Answer) -> list[str]:
    """Return what differs between two answers, in words."""
    if old.code != new.code:
        more = new.said if new.code not in (0, 3) else old.said
        return [f"exit {old.code} -> {new.code}: {' '.join(more.split())[:160]}"]
    if isinstance(new.code, str):
        return [f"both end with {new.code}"]
    if old.data is None or new.data is None:
        return [] if old.data == new.data else ["only one of them answers"]
    found = []
    if "critical" in old.data:
        if old.data["verdicts"] != new.data["verdicts"]:
            changed = [
                (i, *words)
                for i, words in enumerate(zip(old.data["verdicts"], new.data["verdicts"], strict=False))
                if words[0] != words[1]
            ]
            found.append(f"verdicts at {len(changed)} points, first at {changed[:1]}")
        found += critical_differences(old.data, new.data)
        return found
    if old.data["verdict"] != new.data["verdict"]:
        found.append(f"{old.data['verdict']} -> {new.data['verdict']}")
    elif old.data["in_place"] != new.data["in_place"]:
        found.append(f"in place: {old.data['in_place']} -> {new.data['in_place']}")
    far = distance(old.data["eigenvalues"], new.data["eigenvalues"])
    if far > 1.0:
        found.append(f"eigenvalues apart by {far:.3g} times both bounds")
    return found


def critical_differences(old: dict, new: dict) -> list[str]:
    """Return critical values that only one of two sweeps has."""
    left = list(new["critical"])
    missing = []
    for value, kind in old["critical"]:
        near = [x for x in left if x[1] == kind and abs(x[0] - value) <= CRITICAL * old["range"]]
        if near:
            left.remove(near[0])
        else:
            missing.append((value, kind))
    return [f"critical values: {missing} -> {[tuple(x) for x in left]}"] if missing or left else []


def distance(old: list[list[float]], new: list[list[float]]) -> float:
    """Return the largest distance of two sets of eigenvalues over the sum of their bounds, after optimal pairing."""
    import numpy as np
    from scipy.optimize import linear_sum_assignment

    if len(old) != len(new):
        return float("inf")
    if not old:
        return 0.0
    a, b = (np.array([complex(re, im) for re, im, _ in values]) for values in (old, new))
    bounds = [np.array([np.inf if x is None else x for *_, x in values]) for values in (old, new)]
    sums = bounds[0][:, None] + bounds[1][None, :] + ROUNDING * max(np.max(np.abs(a)), np.max(np.abs(b)), 1e-300)
    apart = np.abs(a[:, None] - b[None, :]) / sums
    apart = np.where(np.isfinite(apart), apart, 0.0)
    i, j = linear_sum_assignment(np.minimum(apart, 1e6) + 1e-6 * np.abs(a[:, None] - b[None, :]))
    return float(np.max(apart[i, j]))


def contradicted(question: Question, answer: Answer, is_disputed: bool) -> str:
    """Return in which way an answer contradicts what is known; empty: not at all, or nothing is known."""
    data = answer.data
    if data is None or "eigenvalues" not in data:
        return ""
    word = data["verdict"]
    if question.allowed and word != "undecided" and word not in question.allowed:
        return f"{word} is false"
    if question.in_place is False and data["in_place"] and word.endswith("up to symmetry"):
        return "neighbours do not stay in place"
    if question.exact and (is_disputed or question.suite == "truths"):
        exact = question.exact()
        pairs = [e for e in data["eigenvalues"] if e[2] != 0.0]
        if len(pairs) == len(exact):
            far = distance(pairs, [[float(x.real), float(x.imag), 0.0] for x in exact])
            return f"an error is {far:.3g} times its bound" if far > 1.0 else ""
    return ""


def compare(asked: list[Question], old: list[Answer], new: list[Answer]) -> dict[str, Comparison]:
    """Print what differs; return what was counted."""
    from mbstab.analysis.verdict.rule import STRENGTH

    counted: dict[str, Comparison] = defaultdict(Comparison)
    for question, *answers in zip(asked, old, new, strict=True):
        own = counted[question.suite]
        own.questions += 1
        differs = differences(question, *answers)
        wrong = {}
        for side, answer in zip(("old", "new"), answers, strict=True):
            own.seconds[side] += answer.seconds
            wrong[side] = contradicted(question, answer, bool(differs))
            own.wrong[side] += bool(wrong[side])
        words = [(answer.data or {}).get("verdict") for answer in answers]
        if all(words) and words[0] != words[1]:
            own.stronger += words[0] in STRENGTH[words[1]]
            own.weaker += words[1] in STRENGTH[words[0]]
        own.differences += bool(differs)
        if differs or any(wrong.values()):
            said = [f"{side} is wrong: {text}" for side, text in wrong.items() if text]
            known = f" (expected: {question.expected})" if question.expected else ""
            print(f"{question.suite}: {question.name}{known}\n    " + "\n    ".join([*differs, *said]))
    return counted


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("old")
    parser.add_argument("new")
    parser.add_argument("files", type=Path, nargs="*")
    parser.add_argument("--suites", default=",".join(SUITES))
    parser.add_argument("--mechanisms", type=int, default=500)
    parser.add_argument("--linear", type=int, default=2000)
    given = parser.parse_intermixed_args()
    sys.path[:0] = [str(ROOT), str(ROOT / "tests")]
    began = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        files = [path.resolve() for path in given.files]
        asked = questions(set(given.suites.split(",")), Path(folder), given.mechanisms, given.linear, files)
        versions = [Version(given.old), Version(given.new)]
        threads = [threading.Thread(target=version.ask, args=[asked]) for version in versions]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        counted = compare(asked, *(version.answers for version in versions))
    print(f"\n{'suite':12s}{'questions':>10s}{'differ':>8s}{'stronger':>9s}{'weaker':>8s}", end="")
    print(f"{'wrong: old':>11s}{'new':>5s}{'CPU (s): old':>14s}{'new':>8s}{'ratio':>7s}")
    for suite, own in counted.items():
        one, other = own.seconds["old"], own.seconds["new"]
        print(f"{suite:12s}{own.questions:10d}{own.differences:8d}{own.stronger:9d}{own.weaker:8d}", end="")
        print(f"{own.wrong['old']:11d}{own.wrong['new']:5d}{one:14.1f}{other:8.1f}{other / (one or 1.0):7.2f}")
    print(f"{time.perf_counter() - began:.0f} s")


if __name__ == "__main__":
    if sys.argv[1:] == ["--work"]:
        work()
    else:
        main()
