"""Verdicts on random linear systems against their exact truth: what is wrong, and what is left open without need.

A verdict is wrong if the truth does not imply it. Wrong ones are printed as model files.
"""

import argparse
import random
import sys
import time
from collections import Counter, defaultdict
from pathlib import Path

import mbstab
from mbstab.analysis.verdict.rule import STRENGTH
from mbstab.errors import MbstabError

sys.path.insert(0, str(Path(__file__).parent.parent))
from linear_oracle import random_system, text, truth


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=20_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--show", type=int, default=3, help="wrong and weak ones that are printed, of each kind")
    arguments = parser.parse_args()
    rng = random.Random(arguments.seed)
    said, shown, wrong, spent = defaultdict(Counter), Counter(), 0, 0.0
    for _ in range(arguments.count):
        K, D = random_system(rng, rng.randint(1, 4))
        known, model = truth(K, D), text(K, D)
        start = time.perf_counter()
        try:
            result = mbstab.loads(model).eig()
            word, place = result.verdict, result.in_place
        except MbstabError as error:
            word, place = f"refused: {type(error).__name__}", None
        spent += time.perf_counter() - start
        said[known.kind, known.expected][word] += 1
        false = word not in known.allowed and not word.startswith("refused")
        false = false or (word.endswith("up to symmetry") and place is True and not known.in_place)
        wrong += false
        weak = known.expected not in STRENGTH.get(word, ())
        if (false or weak) and shown[known.kind, word] < arguments.show:
            shown[known.kind, word] += 1
            print(
                f"--- {'WRONG' if false else 'weak'}: {word} (in place: {place}), but {known.kind}\n{K}, {D}\n{model}"
            )
    print(f"{arguments.count} systems, {1e3 * spent / arguments.count:.1f} ms each, {wrong} wrong")
    for (kind, expected), words in sorted(said.items()):
        number = sum(words.values())
        weak = sum(count for word, count in words.items() if expected not in STRENGTH.get(word, ()))
        print(f"{kind}: {number}, {100 * weak / number:.1f} % weaker than {expected}")
        for word, count in words.most_common():
            print(f"    {count:6d} {word}")


if __name__ == "__main__":
    main()
