"""Large scenes: ``python tests/benchmarks/scale.py [--quick] [--peers]``.

For chains of some lengths: CPU time to read the text, CPU time of the whole answer, also relative to one
``scipy.linalg.eig(A, left=True, right=True)`` of a matrix of the size of the spectrum, the largest relative error of
some frequencies, the range of bound/error, and the peak of memory. Each in a process of its own, with one thread,
after a short chain of the same kind. With ``--peers`` other programs answer about the same chains (`peers.py`); those
that are not installed (``pip install '.[benchmarks]'``) are named.

Frequencies are compared with those of the chain solved link by link with many digits.
"""

import argparse
import json
import math
import os
import resource
import subprocess
import sys
import time
from functools import cache, partial
from importlib.util import find_spec
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
    "spinning": (20, 40, 80),
    "free": (40, 120),
}
BESIDE = {"rods": (100, 200, 400), "universal": (100, 200)}
"""The chains of which other programs are asked."""
SHAPES = {"rods": ((1, 12), (1, 2)), "universal": ((1, 12), (1, 2)), "points": ((0, 1), (1, 1))}
"""Moment of inertia (kg m²) and place of the centre (m) of the links of chains whose frequencies are known."""
SHORT = 50
"""So many links, or fewer where fewer are asked for, has the chain that is solved first."""
QUICK = 200
SAMPLES = 40
"""So many frequencies are compared."""
PATIENCE = 600
"""Wall time (s) after which a program is no longer waited for."""


def text_of(name, count):
    """Return the text of a model."""
    from chains import four_bar_loops, free_bodies, spinning_chain, straight_chain, string_of_points

    return {
        "rods": lambda: straight_chain(count),
        "damped": lambda: straight_chain(count, damping=0.01),
        "points": lambda: string_of_points(count),
        "universal": lambda: straight_chain(count, "universal"),
        "spherical": lambda: straight_chain(count, "spherical"),
        "four_bars": lambda: four_bar_loops(count, "-pi/2"),
        "spinning": lambda: spinning_chain(count),
        "free": lambda: free_bodies(count),
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


def nearly(name, count):
    """Return all frequencies of a hanging chain of rods or of points to some ten digits, ascending."""
    import numpy as np
    import scipy.linalg

    (over, under), (up, down) = SHAPES[name]
    center, below = up / down, np.arange(count)[::-1]
    # Angles from the vertical: the mass below link j moves with its whole length, its own with that of the centre.
    M = center + np.minimum.outer(below, below).astype(float)
    np.fill_diagonal(M, over / under + center**2 + below)
    return np.sqrt(scipy.linalg.eigh(np.diag(9.81 * (center + below)), M, eigvals_only=True))


@cache
def truths(name, count):
    """Return some frequencies of a chain by their numbers from below: the lowest, the highest and some between."""
    found = nearly(name, count)
    chosen = range(count) if count <= SAMPLES else [int(i * (count - 1) / (SAMPLES - 1)) for i in range(SAMPLES)]
    return {i: exact(count, *SHAPES[name], found[i]) for i in chosen}


def errors(name, count, frequencies, bounds):
    """Return the largest relative error of some frequencies, and the least and the median ratio of bound and error."""
    if name not in SHAPES:
        return None
    copies = 2 if name == "universal" else 1  # both planes
    if len(frequencies) != copies * count:
        return math.inf, math.nan, math.nan
    worst, ratios = 0.0, []
    for i, true in truths(name, count).items():
        for j in range(copies * i, copies * (i + 1)):
            off = float(abs(frequencies[j] - true))
            worst = max(worst, off / float(true))
            ratios.append(bounds[j] / max(off, 1e-300))
    return worst, min(ratios), sorted(ratios)[len(ratios) // 2]


def own(name, count):
    """Return what mbstab needs and finds: build a chain, then solve it."""
    import mbstab
    from mbstab.analysis.spectrum.eigenvalues import answer

    start = time.process_time()
    model = mbstab.loads(text_of(name, count))
    system = model.system()
    read = time.process_time() - start
    start = time.process_time()
    result = answer(system)
    whole = time.process_time() - start
    found = sorted((e.value.imag, e.error_bound) for e in result.eigenvalues if e.value.imag > 0)
    frequencies, bounds = ([x[k] for x in found] for k in (0, 1))
    return read, whole, frequencies, bounds, len(model.model.bodies), result.counts.expected, result.verdict


def of_peer(program, name, count):
    """Return the same of another program, which knows no bounds and no verdict."""
    from peers import AXES, PEERS

    start = time.process_time()
    solve = PEERS[program](AXES[name], count)
    read = time.process_time() - start
    start = time.process_time()
    found = solve().tolist()
    whole = time.process_time() - start
    return read, whole, found, [math.nan] * len(found), count, 2 * len(found), "-"


def measured(name, count, program):
    """Print what a program needs and finds, after a short chain of the same kind, as JSON."""
    import numpy as np
    import scipy.linalg

    run = own if program == "mbstab" else partial(of_peer, program)
    run(name, min(SHORT, count // 2))
    read, whole, found, bounds, bodies, size, verdict = run(name, count)
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    A = np.random.default_rng(1).standard_normal((size, size))
    start = time.process_time()
    scipy.linalg.eig(A, left=True, right=True)
    eig = time.process_time() - start
    print(json.dumps([read / bodies, whole, whole / eig, found, bounds, memory, size, verdict]))


def line(name, count, program, base):
    """Print one line of the table, and return the time of the answer; None if there is none."""
    head = f"{name:10} {count:5} {program:10}"
    if find_spec(program) is None:
        print(f"{head} not installed", flush=True)
        return None
    command = [sys.executable, __file__, "--only", name, str(count), program]
    try:
        answer = subprocess.run(command, stdout=subprocess.PIPE, text=True, timeout=PATIENCE, check=True).stdout
    except (subprocess.TimeoutExpired, subprocess.CalledProcessError) as error:
        print(f"{head} {error}", flush=True)
        return None
    read, whole, share, found, bounds, memory, size, verdict = json.loads(answer.splitlines()[-1])
    known = errors(name, count, found, bounds)
    error = "-" if known is None else f"{known[0]:.1e}"
    ratios = "-" if known is None or math.isnan(known[1]) else f"{known[1]:.1f}…{known[2]:.0f}"
    relative = whole / (base or whole)
    print(
        f"{head} {size:5} {1e3 * read:8.2f} {whole:8.3f} {share:8.2f} {relative:8.2f} {error:>9} {ratios:>10} "
        f"{memory:6.0f}  {verdict}",
        flush=True,
    )
    return whole


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="short chains only")
    parser.add_argument("--peers", action="store_true", help="other programs as well, where they are installed")
    parser.add_argument("--only", nargs=3, metavar=("MODEL", "COUNT", "PROGRAM"))
    options = parser.parse_args()
    if options.only:
        measured(options.only[0], int(options.only[1]), options.only[2])
        return
    from peers import PEERS

    print("model          N program      n_f  ms/body    s all    x eig x mbstab     error  bound/err     MB  verdict")
    for name, counts in (BESIDE if options.peers else MODELS).items():
        for count in counts:
            if not options.quick or count <= QUICK:
                base = line(name, count, "mbstab", None)
                for program in PEERS if options.peers else ():
                    line(name, count, program, base)


if __name__ == "__main__":
    main()
