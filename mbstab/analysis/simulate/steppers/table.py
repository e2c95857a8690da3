"""Integration methods with a common interface, each with its order.

A method is a `Method` in the table `METHODS`: a function that starts a `Stepper` at a state
(`mbstab.analysis.simulate.steppers.interface`). A new method is one more entry. Every stepper takes one
step at a time and gives dense output over it; `mbstab.analysis.simulate.run` does the rest: output, change of
charts, monitoring of the rank, work.

The method `projection` has the integrators of SciPy (`mbstab.analysis.simulate.steppers.explicit`): DOP853 of
order 8, RK45 of order 5 (Dormand and Prince), Radau IIA of order 5 and the backward differentiation formulas
of orders 1 to 5 with exact derivatives. The methods `alpha` and `radau` are in
`mbstab.analysis.simulate.steppers.implicit`.
"""

from __future__ import annotations

from mbstab.analysis.simulate.steppers.explicit import Projected
from mbstab.analysis.simulate.steppers.implicit import GeneralizedAlpha, RadauIIA
from mbstab.analysis.simulate.steppers.interface import Method

METHODS: dict[str, dict[str, Method]] = {
    "projection": {
        "DOP853": Method(Projected, 8, 1.0, "DOP853", 6.1, compiled="explicit"),
        "RK45": Method(Projected, 5, 1.0, "RK45", 3.3, compiled="explicit"),
        "Radau": Method(Projected, 5, 1.25, "Radau", fixed=False),
        "BDF": Method(Projected, 5, 0.8, "BDF", fixed=False),
    },
    "alpha": {"": Method(GeneralizedAlpha, 2, 2.0 / 3.0, compiled="alpha")},
    "radau": {"": Method(RadauIIA, 5, 1.25, compiled="radau")},
}
"""Methods by name, and the solvers of each; the first is the default."""
