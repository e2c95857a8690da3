"""Names of modes through random avoided crossings: ``python tests/benchmarks/mode_names.py [number]``.

Names are given at the first value of a parameter, and a sweep with few points carries them to the last; see
`avoided_crossings`. Printed is how many arrive at another eigenvalue than the truth.
"""

import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from avoided_crossings import swaps


def main():
    """Print the number of swaps."""
    number = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    began, wrong, total, bad = time.process_time(), 0, 0, []
    for seed in range(number):
        one, count = swaps(seed)
        wrong, total = wrong + one, total + count
        bad += [seed] if one else []
    print(f"{number} cases, {total} names, {wrong} swaps {bad[:20]}, {time.process_time() - began:.0f} s of CPU time")


if __name__ == "__main__":
    main()
