"""What each part of an answer costs, over one eigenvalue call on a matrix of its size."""

import time

import numpy as np

from mbstab import load
from mbstab.analysis.linear.linearize import linearize, state_space
from mbstab.analysis.reference.requested import reference_motion
from mbstab.analysis.spectrum.eigenvalues import eigenvalues
from mbstab.compiler.system import System
from mbstab.model.library import installed_models
from mbstab.model.reader import read_model
from mbstab.model.values import evaluate

PARTS = ("read", "evaluate", "assemble", "reference", "linearize", "eigenvalues")


def seconds(function, repeat=15):
    """Return the least time of one call."""
    best = float("inf")
    for _ in range(repeat):
        start = time.perf_counter()
        function()
        best = min(best, time.perf_counter() - start)
    return best


def main():
    print("milliseconds; the last column is numpy.linalg.eigvals of the deflated matrix")
    print(f"{'model':28}" + "".join(f"{part:>12}" for part in PARTS) + f"{'eigvals':>9}")
    for path in installed_models():
        model = load(path).model
        scene = evaluate(model)
        system = System(scene)
        motion = reference_motion(system)
        linear = linearize(system, motion)
        A = state_space(linear).A
        calls = (
            lambda path=path: read_model(path),
            lambda model=model: evaluate(model),
            lambda scene=scene: System(scene),
            lambda system=system: reference_motion(system),
            lambda system=system, motion=motion: linearize(system, motion),
            lambda linear=linear: eigenvalues(linear),
            lambda A=A: np.linalg.eigvals(A),
        )
        print(
            f"{path.stem:28}"
            + "".join(f"{1e3 * seconds(call):12.3f}" for call in calls[:-1])
            + f"{1e3 * seconds(calls[-1]):9.3f}"
        )


if __name__ == "__main__":
    main()
