"""A and B of the Whipple bicycle at 101 speeds against BicycleParameters (Moore, Hubbard, Peterson), which has its own
equations: ``pip install BicycleParameters``, best in an environment of its own.
"""

import sys
from pathlib import Path

import numpy as np

import mbstab

sys.path.insert(0, str(Path(__file__).parents[1]))

from test_control import WHIPPLE, whipple

# Table 1 of Meijaard, Papadopoulos, Ruina, Schwab (2007), Proc. R. Soc. A 463.
BENCHMARK = {
    "IBxx": 9.2, "IBxz": 2.4, "IByy": 11.0, "IBzz": 2.8, "IFxx": 0.1405, "IFyy": 0.28, "IHxx": 0.05892,
    "IHxz": -0.00756, "IHyy": 0.06, "IHzz": 0.00708, "IRxx": 0.0603, "IRyy": 0.12, "c": 0.08, "g": 9.81,
    "lam": np.pi / 10.0, "mB": 85.0, "mF": 3.0, "mH": 4.0, "mR": 2.0, "rF": 0.35, "rR": 0.3, "v": 1.0, "w": 1.02,
    "xB": 0.3, "xH": 0.9, "zB": -0.9, "zH": -0.7,
}  # fmt: skip


def main():
    from bicycleparameters.models import Meijaard2007Model
    from bicycleparameters.parameter_sets import Meijaard2007ParameterSet

    theirs = Meijaard2007Model(Meijaard2007ParameterSet(BENCHMARK, True))
    mechanism, worst = mbstab.load("whipple_bicycle.yaml"), np.zeros(2)
    for v in np.linspace(0.0, 10.0, 101):
        found = mechanism.state_space(WHIPPLE, v=v)
        here, there, closed = (found.A, found.B), theirs.form_state_space_matrices(v=v), whipple(v)
        for n, other in enumerate((there, closed)):
            worst[n] = max(worst[n], *(np.abs(x - y).max() / np.abs(y).max() for x, y in zip(here, other, strict=True)))
    print("A and B of the bicycle at 101 speeds, differences relative to the largest entry (goal 1e-12):")
    print(f"from BicycleParameters {worst[0]:.1e}, from the closed form {worst[1]:.1e}")


if __name__ == "__main__":
    main()
