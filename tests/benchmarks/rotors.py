"""Campbell diagrams beside ROSS: ``python tests/benchmarks/rotors.py [COUNT …]``.

The rotor of ``scenes/two_disk.yaml`` with shafts of 3 COUNT elements (2 and 4 if none is given), at the 19 speeds of
its file: by mbstab every branch, its whirl, critical values and crossings with the first order, by ROSS the slowest
modes and their whirl (``pip install '.[benchmarks]'``). Both have the same mass matrix: the elements of ROSS have the
stiffness of an Euler beam and next to no mass, and a disk at each node has the mass of the cylinder about it. The
largest relative difference of the frequencies is printed. Each program runs in a process of its own with one thread,
and is measured after its imports and a first diagram of the smallest rotor: medians of runs taken in turn, with those
of the ratios of each. *numbers* is the sweep alone, *diagram* counts what its picture needs, too.
"""

import json
import os
import resource
import statistics
import subprocess
import sys
import time
import warnings
from importlib.util import find_spec
from pathlib import Path

RUNS = 3
COUNTS = (2, 4)
MODES = 12
"""So many frequencies of ROSS are compared."""
SCENE = Path(__file__).parent / "scenes" / "two_disk.yaml"


def mechanism(count):
    """Return the rotor."""
    import mbstab

    return mbstab.load(SCENE).at(n=count)


def own(count):
    """Return what is computed and the frequencies (rad/s) of an answer, shape (speeds, branches)."""
    model = mechanism(count)

    def asked(**keywords):
        branches = model.sweep("Omega", **keywords).branches
        return branches.imag.tolist()

    return {"numbers": asked, "diagram": lambda: asked(orders=[1.0], detail=True)}


def of_ross(count):
    """Return the same of ROSS."""
    import numpy as np

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import ross

    model = mechanism(count)
    p, speeds = model.parameters(), np.linspace(0.0, 4500.0, 19) * np.pi / 30.0
    elements, part, d = 3 * count, p["part"], p["d"]
    beam = ross.Material(name="beam", rho=1e-9, E=p["E"], G_s=p["G"])

    def campbell():
        shaft = [
            ross.ShaftElement(part, 0.0, d, material=beam, shear_effects=False, rotary_inertia=False, gyroscopic=False)
            for _ in range(elements)
        ]
        m = p["m"]
        ends = [ross.DiskElement(n, m / 2, m * d**2 / 32, m * d**2 / 16) for n in (0, elements)]
        across = m * (3 * d**2 / 4 + part**2) / 12
        cylinders = [ross.DiskElement(n, m, across, m * d**2 / 8) for n in range(1, elements)]
        disks = [ross.DiskElement(n, p["m_d"], p["I_t"], p["I_a"]) for n in (count, 2 * count)]
        bearings = [ross.BearingElement(n, kxx=1e6, kyy=0.8e6, cxx=0.0) for n in (0, elements)]
        rotor = ross.Rotor(shaft, [*ends, *cylinders, *disks], bearings)
        return rotor.run_campbell(speeds, frequencies=MODES).wd.tolist()

    return {"numbers": campbell, "diagram": campbell}


PROGRAMS = {"mbstab": own, "ross": of_ross}


def measured(program, count):
    """Print processor time, peak of memory and frequencies of a program as JSON."""
    for ask in PROGRAMS[program](COUNTS[0]).values():
        ask()
    found = {}
    for name, ask in PROGRAMS[program](count).items():
        began = time.process_time()
        frequencies = ask()
        found[name] = time.process_time() - began
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(json.dumps([found, memory, frequencies]))


def answer(program, count):
    """Return the same from a process of its own."""
    command = [sys.executable, __file__, "--only", program, str(count)]
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
    shown = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, env=environment)
    shown.check_returncode()
    return json.loads(shown.stdout.splitlines()[-1])


def apart(ours, theirs):
    """Return the largest relative difference of a frequency of ROSS from the nearest one of mbstab."""
    return max(
        min(abs(x - y) for y in row) / x for row, others in zip(ours, theirs, strict=True) for x in others if x > 1.0
    )


def main():
    """Print the table."""
    counts = [int(x) for x in sys.argv[1:]] or COUNTS
    programs = [name for name in PROGRAMS if find_spec(name) is not None]
    print("elements  program   numbers  diagram     MB   over ROSS  apart")
    for count in counts:
        runs = [{name: answer(name, count) for name in programs} for _ in range(RUNS)]
        off = apart(runs[0]["mbstab"][2], runs[0]["ross"][2]) if "ross" in programs else None
        for name in programs:
            times = [statistics.median(run[name][0][kind] for run in runs) for kind in ("numbers", "diagram")]
            row = f"{3 * count:8}  {name:8} {times[0]:8.2f} {times[1]:8.2f} {runs[0][name][1]:6.0f}"
            if off is not None and name != "ross":
                over = [
                    statistics.median(run[name][0][kind] / run["ross"][0][kind] for run in runs)
                    for kind in ("numbers", "diagram")
                ]
                row += f"  {over[0]:4.1f} {over[1]:4.1f}  {off:.1e}"
            print(row, flush=True)
    if "ross" not in programs:
        print("ross is not installed")


if __name__ == "__main__":
    if sys.argv[1:2] == ["--only"]:
        measured(sys.argv[2], int(sys.argv[3]))
    else:
        main()
