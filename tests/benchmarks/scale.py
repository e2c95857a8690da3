"""Large scenes: ``python tests/benchmarks/scale.py [--quick]``.

For chains of some lengths: CPU time to read the text, CPU time of the whole answer relative to one
``scipy.linalg.eig(A, left=True, right=True)`` of a matrix of the size of the spectrum, the largest relative error of
some frequencies, the range of bound/error, and the peak of memory. Each in a process of its own, with one thread.

Frequencies are compared with those of the chain solved link by link with many digits.
"""

import argparse
import os
import resource
import subprocess
import sys
import time
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[1]))

MODELS = {
    "rods": (100, 400, 1000),
    "damped": (100, 400, 1000),
    "points": (100, 400, 1000),
    "universal": (50, 200),
    "spherical": (50, 200),
    "four_bars": (100, 400),
}
QUICK = 200
SAMPLES = 40
"""So many frequencies are compared, the lowest, the highest and some between."""


def text_of(name, count):
    """Return the text of a model."""
    from chains import four_bar_loops, straight_chain, string_of_points

    return {
        "rods": lambda: straight_chain(count),
        "damped": lambda: straight_chain(count, damping=0.01),
        "points": lambda: string_of_points(count),
        "universal": lambda: straight_chain(count, "universal"),
        "spherical": lambda: straight_chain(count, "spherical"),
        "four_bars": lambda: four_bar_loops(count, "-pi/2"),
    }[name]()


def exact(count, inertia, center, near):
    """Return the frequency next to one of a hanging chain of links of 1 kg and 1 m, from link to link.

    With the deflection x and the force H at a joint, θ of the link below it follows from its moments, then x and H
    at the next joint; at the free end H = 0.
    """
    from mpmath import mp

    mp.dps = 60 + count // 2
    g, z = mp.mpf("9.81"), mp.mpf(near) ** 2
    inertia, a = mp.mpf(inertia[0]) / inertia[1], mp.mpf(center[0]) / center[1]
    b = 1 - a
    for _ in range(8):
        x, dx, H, dH = mp.mpf(0), mp.mpf(0), mp.mpf(1), mp.mpf(0)
        for i in range(count):
            above, below = g * (count - i), g * (count - i - 1)
            # Moments about the centre: θ (a T + b T' + z (a b − I)) = −H − b z x, with H' = H + z (x + a θ).
            stiff, dstiff = a * above + b * below - z * inertia + z * a * b, a * b - inertia
            load, dload = -(a + b) * H - b * z * x, -(a + b) * dH - b * (x + z * dx)
            turn = load / stiff
            dturn = (dload - turn * dstiff) / stiff
            H, dH = H + z * (x + a * turn), dH + (x + a * turn) + z * (dx + a * dturn)
            x, dx = x + turn, dx + dturn
        step = H / dH
        z -= step
        if abs(step) < abs(z) * mp.mpf(10) ** -40:
            break
    return mp.sqrt(z)


def errors(name, count, result):
    """Return the largest relative error of some frequencies, and the least and largest ratio of bound and error."""
    if name not in ("rods", "points"):
        return None
    shape = ((1, 12), (1, 2)) if name == "rods" else ((0, 1), (1, 1))
    found = sorted((e for e in result.eigenvalues if e.value.imag > 0), key=lambda e: e.value.imag)
    chosen = found if count <= SAMPLES else [found[int(i * (count - 1) / (SAMPLES - 1))] for i in range(SAMPLES)]
    worst, ratios = 0.0, []
    for e in chosen:
        true = exact(count, *shape, e.value.imag)
        off = float(abs(e.value.imag - true))
        worst = max(worst, off / abs(e.value))
        ratios.append(e.error_bound / max(off, 1e-300))
    return worst, min(ratios), sorted(ratios)[len(ratios) // 2]


def measured(name, count):
    """Print one line of the table."""
    import numpy as np
    import scipy.linalg
    import scipy.sparse.linalg

    import mbstab

    text = text_of(name, count)
    mbstab.load("pendulum.yaml").eig()
    start = time.process_time()
    model = mbstab.loads(text)
    model.system()
    read = time.process_time() - start
    start = time.process_time()
    result = model.eig()
    whole = time.process_time() - start
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    size = result.counts.expected
    A = np.random.default_rng(1).standard_normal((size, size))
    start = time.process_time()
    scipy.linalg.eig(A, left=True, right=True)
    eig = time.process_time() - start
    known = errors(name, count, result)
    accuracy = "         -          -" if known is None else f"{known[0]:10.1e} {known[1]:4.1f}…{known[2]:<5.0f}"
    print(
        f"{name:10} {count:5} {size:5} {1e3 * read / len(model.model.bodies):8.2f} {whole:8.2f} {whole / eig:8.2f} "
        f"{accuracy} {memory:6.0f}  {result.verdict}",
        flush=True,
    )


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="short chains only")
    parser.add_argument("--only", nargs=2, metavar=("MODEL", "COUNT"))
    options = parser.parse_args()
    if options.only:
        measured(options.only[0], int(options.only[1]))
        return
    print("model          N   n_f  ms/body    s all   x eig      error  bound/err     MB  verdict")
    for name, counts in MODELS.items():
        for count in counts:
            if not options.quick or count <= QUICK:
                subprocess.run([sys.executable, __file__, "--only", name, str(count)], check=False)


if __name__ == "__main__":
    main()
