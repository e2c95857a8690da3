"""Sweeps against one batched LAPACK call of the same size and count; those whose motion is solved; several processes.

Run with OPENBLAS_NUM_THREADS=1, as the command line does by itself; with a word such as ``governor`` only
that part. Times are those of the processor, but for several processes.
"""

import sys
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np

import mbstab
from mbstab.analysis.sweep import batched_spectra
from mbstab.analysis.sweep.chart import chart
from mbstab.analysis.sweep.settings import SweepSettings
from mbstab.analysis.sweep.sweep import sweep

sys.path.insert(0, str(Path(__file__).parents[1]))
from chains import straight_chain

from mbstab.model.ranges import sweep_values

CASES = (
    ("top", "omega", (0.0, 10.0), 100_001, 4, 4.0),
    ("whipple_bicycle", "v", (0.0, 10.0), 10_001, 10, 4.0),
    ("chain of 20", "g", (5.0, 20.0), 2_001, 40, 4.0),
)
MEETING = (("rail", "V", 6.0), ("wagons", "V", 6.0), ("two_disk", "Omega", 6.0), ("mono", "d", 6.0))
LONG = 1_000_000
SHORT, MANY, SIDE = 2, 5_000, 300


def timed(function, clock=time.process_time):
    start = clock()
    result = function()
    return clock() - start, result


def eigenvalue_call(points, size):
    matrices = np.random.default_rng(0).standard_normal((points, size, size))
    return timed(lambda: np.linalg.eigvals(matrices))[0]


def model_of(name):
    """Return an example, or a chain of rods with its gravity as a parameter."""
    if not name.startswith("chain"):
        return mbstab.load(f"{name}.yaml").model
    head = '{"parameters": {"g": {"value": 9.81, "unit": "m/s^2"}},'
    return mbstab.loads(straight_chain(20).replace("-9.81", '"-g"').replace("{", head, 1)).model


def given():
    """Sweeps of motions that are given."""
    for name, parameter, ends, points, size, goal in CASES:
        model, x = model_of(name), np.linspace(*ends, points)
        sweep(model, parameter, x[:1000])
        ratios = sorted(timed(lambda: sweep(model, parameter, x))[0] / eigenvalue_call(points, size) for _ in range(3))  # noqa: B023
        print(f"{name}, {points} points: {ratios[1]:.2f} x numpy.linalg.eigvals (goal {goal:g})")
    model = mbstab.load("rolling_disk.yaml").model
    grid = {"omega": np.linspace(0.1, 10.0, 300), "R": np.linspace(0.1, 1.0, 300)}
    seconds, _ = timed(lambda: chart(model, grid))
    print(f"chart of the disk, 300 x 300: {seconds:.2f} s, {seconds / eigenvalue_call(90_000, 6):.1f} x eigvals")


def governor():
    """Sweeps of motions that are solved: of the governor, whose steady motion depends on its spin and its masses."""
    model = mbstab.load("governor.yaml").model
    sweep(model, "omega", np.linspace(1.0, 39.0, SHORT))  # patterns are kept: another range
    first, _ = timed(lambda: sweep(model, "omega", np.linspace(1.0, 40.0, SHORT)))
    print(f"governor, {SHORT} points: {first:.2f} s (goal for the first one 0.3)")
    less, more = (timed(lambda: sweep(model, "omega", np.linspace(1.0, 40.0, n)))[0] for n in (MANY // 5, MANY))  # noqa: B023
    further = 1e3 * (more - less) / (0.8 * MANY)
    print(f"governor, {MANY} points: {more:.2f} s; {further:.2f} ms for a further one (goal 0.3)")
    grid = {"omega": np.linspace(1.0, 40.0, SIDE), "m_c": np.linspace(2.0, 4.0, SIDE)}
    seconds, _ = timed(lambda: chart(model, grid))
    print(f"chart of the governor, {SIDE} x {SIDE}: {seconds:.1f} s (goal 35)")


def meeting():
    """Sweeps with eigenvalues that meet, or nearly do: spectra for each point, time over `eigvals` of the points."""
    for name, parameter, goal in MEETING:
        model = mbstab.load(Path(__file__).parent / "scenes" / f"{name}.yaml").model
        x = sweep_values(model, parameter)
        with counted() as spectra:
            seconds, result = timed(lambda: sweep(model, parameter, x))  # noqa: B023
        least = eigenvalue_call(len(x), result.branches.shape[1])
        print(
            f"{name}, {len(x)} points, {result.branches.shape[1]} eigenvalues: "
            f"{sum(spectra) / len(x):.1f} spectra a point "
            f"(goal {goal:g}), {seconds:.2f} s, eigvals {least:.3f} s"
        )


@contextmanager
def counted():
    """Yield a list to which the numbers of points are added whose spectra are computed."""
    numbers, kept = [], {}

    def counting(name, number):
        function = kept[name] = getattr(batched_spectra, name)

        def counted_function(*arguments, **named):
            numbers.append(number(arguments))
            return function(*arguments, **named)

        setattr(batched_spectra, name, counted_function)

    counting("judged", lambda arguments: len(arguments[1].q))
    counting("shapes_of", lambda arguments: len(arguments[0].q))
    counting("enclosures", lambda arguments: 1)
    try:
        yield numbers
    finally:
        for name, function in kept.items():
            setattr(batched_spectra, name, function)


def processes():
    """Two processes against one, in time that passes."""
    cases = (("top", "omega", np.linspace(0.0, 10.0, LONG)), ("governor", "omega", np.linspace(1.0, 40.0, 50_000)))
    for name, parameter, x in cases:
        model = mbstab.load(f"{name}.yaml").model
        one, two = (
            timed(lambda: sweep(model, parameter, x, settings=SweepSettings(jobs=jobs)), time.perf_counter)[0]  # noqa: B023
            for jobs in (1, 2)
        )
        print(f"{name}, {len(x)} points: two processes are {one / two:.2f} x as fast as one (goal 1.7)")


PARTS = {part.__name__: part for part in (given, governor, meeting, processes)}


if __name__ == "__main__":
    for chosen in sys.argv[1:] or PARTS:
        PARTS[chosen]()
