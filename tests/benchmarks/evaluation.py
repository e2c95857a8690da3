"""One evaluation of the equations of motion: by the system, fused in Python, and by the machine (with the extra fast).

Columns: microseconds of `System.dynamics`; how many times as fast the same, then the accelerations (with the
solution of the linear equations), then K, R, D_q are found fused in Python; how many times as fast the accelerations
by the machine; milliseconds until the first matrices are there in Python, and the first accelerations by the
machine.
"""

import time
from importlib.util import find_spec

import numpy as np

import mbstab
from mbstab.analysis.reference.attitude import Attitudes
from mbstab.analysis.simulate.constrained import Constrained
from mbstab.analysis.simulate.energy import Energy
from mbstab.analysis.simulate.steppers.compiled import Marching
from mbstab.analysis.simulate.steppers.interface import Options
from mbstab.analysis.simulate.steppers.table import METHODS
from mbstab.compiler.form import FUSED_AFTER
from mbstab.compiler.fused import Fused
from mbstab.model.library import installed_models


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


def compiled(equations, motion):
    """Return a function that finds the accelerations by the machine, and the seconds until it is there."""
    from mbstab.compiler.machine.linear import slope
    from mbstab.compiler.machine.native import called

    system, attitudes = equations.system, Attitudes.of(equations.system)
    start = time.perf_counter()
    options = Options(METHODS["projection"]["DOP853"], 1e-8, None, 1e-3, 1.0)
    marching = Marching(equations, attitudes, Energy.of(system), options.method)
    marching.start(system, motion.time, motion.q, motion.u, np.array([1.0]), 1.0, options, 0.0, 0.1)
    ready = time.perf_counter() - start
    y, dy = np.concatenate([motion.q, motion.u]), np.zeros(2 * system.n_q)

    @called
    def many(m, t, y, dy, count):  # a call from Python costs as much as the work
        for _ in range(count):
            slope(m, t, y, dy)

    many(marching.machine, motion.time, y, dy, 1)
    return lambda: many(marching.machine, motion.time, y, dy, 100), ready


def row(path, machine):
    """Return the line of a model."""
    system, motion = mbstab.load(path).system(), mbstab.load(path).motion()
    q, u, a, nu, t = motion.q, motion.u, motion.a, motion.nu, motion.time
    start = time.perf_counter()
    fused = Fused(system)
    fused.dynamics(q, u)
    ready = time.perf_counter() - start
    equations = Constrained(system, motion)
    for _ in range(FUSED_AFTER + 1):
        equations.acceleration(t, q, u)
    slow, slow_linearize = seconds(lambda: system.dynamics(q, u)), seconds(lambda: system.linearize(q, u, a, nu))
    times = [
        (slow, lambda: fused.dynamics(q, u)),
        (slow, lambda: equations.acceleration(t, q, u)),
        (slow_linearize, lambda: fused.linearize(q, u, a, nu)),
    ]
    text = f"{path.stem:27}{1e6 * slow:9.1f}" + "".join(f"{one / seconds(f):9.1f}" for one, f in times)
    if not machine:
        return f"{text}{1e3 * ready:10.1f}"
    many, also = compiled(equations, motion)
    return f"{text}{100.0 * slow / seconds(many):9.1f}{1e3 * ready:10.1f}{1e3 * also:9.1f}"


def main():
    machine = find_spec("numba") is not None
    heads = ("dynamics", "fused", "a, nu", "K R D_q", *(("machine",) if machine else ()), "ready")
    print(f"{'':27}" + "".join(f"{head:>9}" for head in heads))
    for path in installed_models():
        print(row(path, machine), flush=True)


if __name__ == "__main__":
    main()
