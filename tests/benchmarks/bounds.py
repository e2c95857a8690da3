"""Error bounds of eigenvalues against many digits: ``python tests/benchmarks/bounds.py 0 2000 [bare]``.

For each seed of `random_mechanisms` the discs of `mbstab.analysis.bounds.location` are compared with
eigenvalues of 30 digits.
With ``bare`` nothing is separated by structure: zeros are judged as well. Printed are the seeds whose bounds are
broken or worst, and how many times larger than the errors bounds are.
"""

import sys
import time
import warnings
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from discs import compared, exact, placed, without
from random_mechanisms import KINDS, random_mechanism

import mbstab

EPS = float(np.finfo(float).eps)


def main(first, last, structure=True):
    worst, rough, unknown, skipped, failed = [], [], [], 0, 0
    pessimism = {kind: [] for kind in KINDS}
    began = time.perf_counter()
    for seed in range(first, last):
        try:
            mechanism = mbstab.loads(random_mechanism(seed))
            found, neutral = placed(mechanism, structure)
        except mbstab.MbstabError:
            skipped += 1
            continue
        try:
            true = exact(mechanism)
        except mbstab.MbstabError:
            failed += 1
            continue
        rows = compared(found, without(true, neutral))
        worst.append((max((r[0] for r in rows), default=0.0), seed))
        if worst[-1][0] > 1.0:
            print(f"seed {seed}: error / bound {worst[-1][0]:.3g}", flush=True)
        if any(not np.isfinite(r[1]) for r in rows):
            unknown.append((seed, sum(not np.isfinite(r[1]) for r in rows), len(rows)))
        for _, radius, error in rows:
            if np.isfinite(radius) and radius:
                pessimism[KINDS[seed % len(KINDS)]].append(radius / max(error, EPS))
                rough.append((radius / max(error, EPS), radius, seed))
    worst.sort(reverse=True)
    rough.sort(reverse=True)
    print(f"{len(worst)} mechanisms ({skipped} refused, {failed} without digits), {time.perf_counter() - began:.0f} s")
    print("error / bound, worst:", ", ".join(f"{x:.2g} ({seed})" for x, seed in worst[:12]))
    print("broken by more than 1:", sum(x > 1 for x, _ in worst), " by more than 3:", sum(x > 3 for x, _ in worst))
    print("nothing known (seed, discs, of):", len(unknown), unknown[:20])
    for kind, x in pessimism.items():
        if x:
            print(f"bound / error, {kind}: median {np.median(x):.0f}, 90 % {np.quantile(x, 0.9):.2g}, {len(x)} discs")
    print("most pessimistic:", ", ".join(f"{x:.1e} at {r:.0e} ({seed})" for x, r, seed in rough[:300:20]))


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    main(*(int(x) for x in sys.argv[1:3]), "bare" not in sys.argv)
