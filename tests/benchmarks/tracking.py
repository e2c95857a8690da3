"""Branches on 50 random paths through avoided crossings of bicycles and of chains, against paths 100 times finer."""

import sys
from itertools import chain, count
from pathlib import Path

import numpy as np

import mbstab

sys.path.insert(0, str(Path(__file__).parents[1]))

from paths import avoided, bicycle_paths, chain_path, swaps

PATHS, POINTS, FINER = 25, 41, 100


def compared(text):
    """Return of the avoided crossings of a path how near branches come, on the fine grid and on the coarse; the swaps.

    Both distances are parts of the eigenvalue.
    """
    mechanism, s = mbstab.loads(text), np.linspace(0.0, 1.0, (POINTS - 1) * FINER + 1)
    fine, coarse = (mechanism.sweep("s", x, meetings=True) for x in (s, s[::FINER]))
    if fine.problems or coarse.problems:
        raise SystemExit(f"points without eigenvalues: {fine.problems}, {coarse.problems}")
    gaps = []
    for i, j, k in avoided(fine.branches):
        gap = np.abs(fine.branches[:, i] - fine.branches[:, j]) / np.abs(fine.branches[k, i])
        gaps.append((gap[k], np.min(gap[::FINER])))
    return gaps, swaps(coarse.branches, fine.branches[::FINER]), len(fine.meetings)


def main():
    rng = np.random.default_rng(0)
    bicycles = chain.from_iterable(bicycle_paths(rng, 200) for _ in count())
    chains = (chain_path(rng) for _ in count())
    for name, texts in (("bicycle", bicycles), ("chain", chains)):
        found, tried, gaps, rows, meetings = 0, 0, [], 0, 0
        for text in texts:
            passed, swapped, met = compared(text)
            tried, rows, meetings = tried + 1, rows + swapped, meetings + met
            found, gaps = found + bool(passed), gaps + passed
            if found == PATHS:
                break
        least, hidden = min(gap for gap, _ in gaps), sum(seen > 2.0 * gap for gap, seen in gaps)
        print(
            f"{name}: {tried} paths, {found} of them through {len(gaps)} avoided crossings, {hidden} of these hidden "
            f"between two points, least relative gap {least:.1e}, {meetings} meetings besides; swaps: {rows} (goal 0)"
        )


if __name__ == "__main__":
    main()
