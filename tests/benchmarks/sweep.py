"""Sweeps against one batched LAPACK call of the same size and count, in one run; and two processes against one.

Run with OPENBLAS_NUM_THREADS=1, as the command line does by itself.
"""

import time

import numpy as np

import mbstab
from mbstab.analysis.sweep.chart import chart
from mbstab.analysis.sweep.settings import SweepSettings
from mbstab.analysis.sweep.sweep import sweep

CASES = (("top", "omega", 100_001, 4, 4.0), ("whipple_bicycle", "v", 10_001, 10, 6.0))
LONG = 1_000_000


def timed(function):
    start = time.perf_counter()
    result = function()
    return time.perf_counter() - start, result


def eigenvalue_call(points, size):
    matrices = np.random.default_rng(0).standard_normal((points, size, size))
    return timed(lambda: np.linalg.eigvals(matrices))[0]


def main():
    for name, parameter, points, size, goal in CASES:
        model, x = mbstab.load(f"{name}.yaml").model, np.linspace(0.0, 10.0, points)
        sweep(model, parameter, x[:1000])
        ratios = sorted(timed(lambda: sweep(model, parameter, x))[0] / eigenvalue_call(points, size) for _ in range(3))  # noqa: B023
        print(f"{name}, {points} points: {ratios[1]:.2f} x numpy.linalg.eigvals (goal {goal:g})")
    model = mbstab.load("rolling_disk.yaml").model
    grid = {"omega": np.linspace(0.1, 10.0, 300), "R": np.linspace(0.1, 1.0, 300)}
    seconds, _ = timed(lambda: chart(model, grid))
    print(f"chart of the disk, 300 x 300: {seconds:.2f} s, {seconds / eigenvalue_call(90_000, 6):.1f} x eigvals")
    model, x = mbstab.load("top.yaml").model, np.linspace(0.0, 10.0, LONG)
    one, two = (timed(lambda: sweep(model, "omega", x, settings=SweepSettings(jobs=jobs)))[0] for jobs in (1, 2))  # noqa: B023
    print(f"{LONG} points: two processes are {one / two:.2f} x as fast as one (goal 1.7)")


if __name__ == "__main__":
    main()
