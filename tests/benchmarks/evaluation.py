"""One evaluation of the equations of motion: by the system, fused in Python, and as machine code (with the extra fast).

Columns: microseconds of `System.dynamics`; how many times as fast M, F0, J, B, then the accelerations (with their
solution), then K, R, D_q are found; milliseconds until the first M, F0, J, B are there. Machine code is compiled
anew, in a directory of its own; the last column is the time of a second process, which finds it there.
"""

import os
import subprocess
import sys
import tempfile
import time
from importlib.util import find_spec

import mbstab
from mbstab.analysis.accelerations import Accelerations
from mbstab.model.library import installed_models

MACHINE_CODE = ("pendulum", "top", "rolling_disk", "whipple_bicycle", "governor")
FIRST = (
    "import sys, time, numpy, mbstab, numba\n"
    "system = mbstab.load(sys.argv[1]).system()\n"
    "q = numpy.full(system.n_q, 0.3)\n"
    "system.dynamics(q, q)\n"
    "start = time.perf_counter()\n"
    "system.fused(machine_code=True).equations(q, q)\n"
    "print(time.perf_counter() - start)\n"
)


def seconds(function, repeat=7, least=0.01):
    """Return the least time of one call."""
    count = 1
    while True:
        start = time.perf_counter()
        for _ in range(count):
            function()
        if time.perf_counter() - start > least:
            break
        count *= 4
    best = float("inf")
    for _ in range(repeat):
        start = time.perf_counter()
        for _ in range(count):
            function()
        best = min(best, (time.perf_counter() - start) / count)
    return best


def first(name):
    """Return the seconds until a process has its first matrices from machine code."""
    run = subprocess.run([sys.executable, "-c", FIRST, name], capture_output=True, text=True, check=True)
    return float(run.stdout)


def row(path, machine_code):
    """Return the line of a model."""
    model = mbstab.load(path)
    system, motion = model.system(), model.motion()
    q, u, a, nu = motion.q, motion.u, motion.a, motion.nu
    start = time.perf_counter()
    fused = system.fused(machine_code)
    fused.equations(q, u)
    ready = time.perf_counter() - start
    accelerations = Accelerations(system, motion.redundant, machine_code)
    slow, slow_linearize = (
        seconds(lambda: system.dynamics(q, u)),
        seconds(lambda: system.linearize(q, u, a, nu)),
    )
    equations, both, linearize = (
        seconds(lambda: fused.equations(q, u)),
        seconds(lambda: accelerations(q, u)),
        seconds(lambda: fused.linearize(q, u, a, nu)),
    )
    speeds = (slow / equations, slow / both, slow_linearize / linearize)
    return f"{path.stem:27}{1e6 * slow:9.1f}" + "".join(f"{x:9.1f}" for x in speeds) + f"{1e3 * ready:10.1f}"


def main():
    heads = ("dynamics", "M F0 J B", "a, nu", "K R D_q", "ready")
    print(f"{'in Python':27}" + "".join(f"{head:>9}" for head in heads))
    paths = list(installed_models())
    for path in paths:
        print(row(path, False), flush=True)
    if find_spec("numba") is None:
        return
    print(f"\n{'machine code':27}" + "".join(f"{head:>9}" for head in (*heads, "again")))
    with tempfile.TemporaryDirectory() as directory:
        os.environ["XDG_CACHE_HOME"] = directory
        for path in paths:
            if path.stem in MACHINE_CODE:
                print(f"{row(path, True)}{1e3 * first(path.name):9.1f}", flush=True)


if __name__ == "__main__":
    main()
