"""Derivatives of all eigenvalues of all models by all parameters, against differences of 50 digits; their cost."""

import sys
import time
from pathlib import Path

import numpy as np

import mbstab
from mbstab.errors import MbstabError

sys.path.insert(0, str(Path(__file__).parents[1]))

from differences import differences

DIGITS, FIGURE = 50, 1e-10


def seconds(run):
    run()
    began = time.process_time()
    run()
    return time.process_time() - began


def compared(mechanism):
    """Return the largest error relative to the largest derivative per percent, and the number of derivatives."""
    found = mechanism.sensitivities()
    scales = np.where(found.values, np.abs(found.values), 1.0)
    worst, count = 0.0, 0
    for k, name in enumerate(found.parameters):
        if name in found.missing:
            print(f"    {name}: {found.missing[name]}")
            continue
        exact = differences(mechanism, name, DIGITS)
        for item in found.derivatives:
            if not item.missing and (row := np.nanmax(np.abs(item.slopes) * scales) / scales[k]):
                worst = max(worst, abs(item.slopes[k] - exact(found.eigenvalue(item).value)) / row)
                count += 1
    return worst, count


def main(paths):
    wrong = []
    for path in paths:
        try:
            mechanism = mbstab.load(path)
            worst, count = compared(mechanism)
        except MbstabError as error:
            print(f"{path.stem:26}  {str(error).splitlines()[0]}", flush=True)
            continue
        cost = seconds(mechanism.sensitivities) / seconds(mechanism.eig)
        print(f"{path.stem:26}  {count:4} derivatives  error {worst:.1e}  cost {cost:.2f} eig", flush=True)
        wrong += [path.stem] if worst > FIGURE else []
    return f"beyond {FIGURE}: {', '.join(wrong)}" if wrong else 0


if __name__ == "__main__":
    models = Path(__file__).parents[2] / "models"
    sys.exit(main([Path(x) for x in sys.argv[1:]] or sorted(models.glob("*.yaml"))))
