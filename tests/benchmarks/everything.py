"""Every command × example model × parameter: ``python tests/benchmarks/everything.py [MODEL ...]``.

Prints calls that end in a traceback, work for more than 20 s or take more than 1 GB, and values at
which `eig` and `sweep` contradict each other; at the end how many calls there were, and the slowest.
"""

import sys
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from every_pair import contradiction, everything, odd_settings, of_model, of_parameter

import mbstab.analysis.compare.methods
import mbstab.analysis.proof.certify
import mbstab.analysis.simulate.simulate
import mbstab.analysis.spectrum.precise
import mbstab.analysis.sweep.sweep
import mbstab.cli.main
import mbstab.report.pictures.stability_map  # noqa: F401 (in the parent, that children need not)


def report(answer, counts):
    """Count an answer, and print what is wrong with it."""
    counts["calls"] += 1
    if answer.fault:
        counts["faults"] += 1
        print(f"{' '.join(map(str, answer.args))}: {answer.fault}", flush=True)
        if answer.traceback:
            print(answer.traceback, flush=True)
    counts[f"exit {answer.code}"] += 1


def main(names):
    counts, slowest = Counter(), []
    for path, parameters in everything().items():
        if names and path.stem not in names:
            continue
        answers = list(of_model(path))
        for name in parameters:
            found = list(of_parameter(path, name))
            wrong = contradiction(found[:2], found[2])
            if wrong:
                counts["contradictions"] += 1
                print(wrong, flush=True)
            answers += [*found, *odd_settings(path, name)]
        for answer in answers:
            report(answer, counts)
        slowest += answers
        slowest = sorted(slowest, key=lambda x: -x.seconds)[:10]
        print(f"# {path.stem}: {dict(counts)}", flush=True)
    for answer in slowest:
        print(f"{answer.seconds:6.1f} s {answer.memory / 1e6:6.0f} MB  {' '.join(map(str, answer.args))}")


if __name__ == "__main__":
    main(sys.argv[1:])
