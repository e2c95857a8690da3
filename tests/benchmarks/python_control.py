"""Exported linear models in python-control against closed forms: frequency responses, zeros, margins, largest gains.

The bicycle of Meijaard, Papadopoulos, Ruina and Schwab (2007) also at 101 speeds: A and B against its 2 by 2 equations.
"""

import sys
import warnings
from pathlib import Path

import numpy as np

import mbstab

sys.path.insert(0, str(Path(__file__).parents[1]))

from test_control import MASSES, WHIPPLE, cart, whipple

from mbstab.analysis.response.frequency import FrequencyResponse
from mbstab.analysis.response.margins import largest_gain, margins
from mbstab.analysis.response.transfer import channels
from mbstab.analysis.response.zeros import TransferZeros

OMEGA = (0.1, 1.0, 10.0, 100.0)


def bicycle(s):
    A, B = whipple(5.0)
    return np.linalg.solve(s * np.eye(4) - A, B)[:2]


def wheeled(s):
    a, b, c, d, r = 1 + 0.005 / 0.01 + 5, 5 * 0.2, 0.1 + 5 * 0.04, 5 * 9.81 * 0.2, 0.1
    below = (a * c - b * b) * s**2 - a * d
    return -np.array([[((c / r + b) * s**2 - d / r) / (s**2 * below)], [(a + b / r) / below]])


def masses(s):
    below = (s**2 + 0.5 * s + 100) * (2 * s**2 + 0.5 * s + 100) - (0.5 * s + 100) ** 2
    near, far = (2 * s**2 + 0.5 * s + 100) / below, (0.5 * s + 100) / below
    return np.array([[near], [far], [(0.5 * s + 100) * (near - far)]])


def pendulum(s):
    phi = -2.0 / (s**2 - 9.81 * 1.1 / 0.5)
    return np.array([[(1.0 - 0.1 * 9.81 * phi) / s**2], [-phi]])


WIP = {"m_d": 1, "R_d": 0.1, "I_d": 0.005, "m_p": 5, "L_p": 0.2, "I_p": 0.1}
CASES = {
    "bicycle, 4 states": (lambda: mbstab.load("whipple_bicycle.yaml").state_space(WHIPPLE, v=5), bicycle),
    "bicycle, 10 states": (lambda: mbstab.load("whipple_bicycle.yaml").state_space(v=5), bicycle),
    "wheeled pendulum": (lambda: mbstab.load("wheeled_inverted_pendulum.yaml").state_space(**WIP), wheeled),
    "cart and pendulum": (lambda: cart(outputs=["cart.x", "angle(pin)"]).state_space(), pendulum),
    "two masses": (lambda: mbstab.loads(MASSES).state_space(), masses),
}


def worst(found, known):
    return max((abs(x - y) / abs(y) for x, y in zip(found, known, strict=True)), default=0.0)


def compared(control, model, closed):
    """Return the largest relative differences of responses, there and here, zeros, largest gains and crossings."""
    theirs, own, zeros, gains, crossings = 0.0, 0.0, 0.0, 0.0, 0.0
    system = model.to_control()
    exact = FrequencyResponse(model)
    every = TransferZeros(exact)
    for channel in channels(model):
        i, j = model.outputs.index(channel.goal), model.inputs.index(channel.source)
        known = [closed(1j * omega)[i, j] for omega in OMEGA]
        single = system[i, j]
        theirs = max(theirs, worst([single(1j * omega) for omega in OMEGA], known))
        own = max(own, worst(exact.of(channel)(OMEGA)[0], known))
        minimal = control.minreal(single, verbose=False)
        answer = every.of(channel)
        found = answer.values
        if len(found):
            other = np.array(minimal.zeros())
            zeros = max(zeros, *(np.min(np.abs(other - z)) / max(abs(z), 1.0) for z in found))
        largest = largest_gain(answer, exact.of(channel))
        if np.isfinite(largest.value):
            peak = max(abs(minimal(1j * x)) for x in np.append(np.geomspace(1e-3, 1e3, 2001), largest.frequency))
            gains = max(gains, abs(largest.value / peak - 1.0))
        *_, at = control.stability_margins(minimal, returnall=True)[:5]
        for x in margins(answer, exact.of(channel), None).phase:
            if len(at):
                crossings = max(crossings, float(np.min(np.abs(at - x.frequency))) / x.frequency)
    return theirs, own, zeros, gains, crossings


def main():
    import control

    warnings.simplefilter("ignore")
    print(f"python-control {control.__version__}; relative differences")
    print(f"{'':20}  responses there, and here    zeros  largest gain  gain crossings")
    for name, (model, closed) in CASES.items():
        theirs, own, zeros, gains, crossings = compared(control, model(), closed)
        print(f"{name:20}  {theirs:15.1e}  {own:8.1e}  {zeros:7.1e}  {gains:12.1e}  {crossings:14.1e}")
    mechanism, most = mbstab.load("whipple_bicycle.yaml"), 0.0
    for v in np.linspace(0.0, 10.0, 101):
        found = mechanism.state_space(WHIPPLE, v=v)
        for x, y in zip((found.A, found.B), whipple(v), strict=True):
            most = max(most, np.abs(x - y).max() / np.abs(y).max())
    print(f"A and B of the bicycle at 101 speeds: {most:.1e} of the largest entry (goal 1e-12)")


if __name__ == "__main__":
    main()
