"""Every method on random mechanisms against 30 digits: ``python tests/benchmarks/methods.py 0 2000``.

For each seed of `random_mechanisms` the values of every method are paired with those of 30 digits.
A bound is broken if the pairing leaves an error larger than the bound. Printed are the seeds at
which bounds are broken, verdicts that those of 30 digits do not imply, and what the default
method leaves undecided where 30 digits decide.
"""

import math
import sys
import warnings
from collections import Counter
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from discs import listed
from mpmath import mp
from random_mechanisms import random_mechanism

import mbstab
from mbstab.analysis.algebra.matching import assigned
from mbstab.analysis.linear.methods import DEFAULT, METHODS
from mbstab.analysis.spectrum.precise import precise_eigenvalues
from mbstab.analysis.verdict.rule import STRENGTH, UNDECIDED

DIGITS = 30
BROKEN = 3.0
EPS = float(np.finfo(float).eps)


def worst(found, exact):
    """Return the largest error in bounds of the best pairing, and whether all values have a partner."""
    judged = [e for e in found if math.isfinite(e.error_bound) and e.kind != "neutral"]
    if len(judged) > len(exact):
        return math.inf
    if not judged:
        return 0.0
    with mp.workdps(60):
        off = np.array([[float(mp.fabs(mp.mpc(e.value) - s)) for s in exact] for e in judged])
    bounds = np.array([max(e.error_bound, 1e-300) for e in judged])
    ratio = np.minimum(off / bounds[:, None], 1e12)
    square = np.full((len(exact), len(exact)), 0.0)
    square[: len(judged)] = ratio**2
    columns = assigned(square)[: len(judged)]
    return float(np.max(ratio[np.arange(len(judged)), columns]))


def contradicts(word, true):
    """Whether two verdicts on the same motion cannot both be true."""
    return word not in STRENGTH[true] and true not in STRENGTH[word]


def main(first, last):
    broken, refused, words = Counter(), Counter(), Counter()
    decided = undecided = mechanisms = 0
    for seed in range(first, last):
        try:
            mechanism = mbstab.loads(random_mechanism(seed))
            precise = precise_eigenvalues(mechanism.model, DIGITS)
        except mbstab.MbstabError:
            continue
        mechanisms += 1
        exact = listed(precise)
        for method in METHODS:
            try:
                result = mechanism.eig(method)
            except mbstab.MbstabError:
                refused[method] += 1
                continue
            ratio = worst(result.eigenvalues, exact)
            if ratio > 1.0:
                print(f"seed {seed}, {method}: error / bound {ratio:.3g}", flush=True)
                broken[method, ratio > BROKEN] += 1
            if contradicts(result.verdict, precise.verdict):
                print(f"seed {seed}, {method}: {result.verdict}, with {DIGITS} digits {precise.verdict}", flush=True)
            if method == DEFAULT and precise.verdict != UNDECIDED:
                decided += 1
                undecided += result.verdict == UNDECIDED
                if result.verdict != precise.verdict:
                    words[precise.verdict, result.verdict] += 1
    print(f"{mechanisms} mechanisms; refused: {dict(refused)}")
    for method in METHODS:
        little, much = broken[method, False], broken[method, True]
        print(f"{method}: broken {little + much}, by more than 3: {much}")
    print(f"{DEFAULT}: undecided {undecided} of {decided} that {DIGITS} digits decide")
    for (true, word), count in words.most_common():
        print(f"    {count:4d} {word} instead of {true}")


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    main(*(int(x) for x in sys.argv[1:3]))
