"""Methods that follow a motion, behind one interface, each with its order.

A method is a `mbstab.analysis.stepping.Method` in the table `METHODS`: a function that starts a `Stepper` at a state.
The next method is one more entry. Every stepper takes one step at a time and gives dense output over it;
`mbstab.analysis.follow` does the rest: output, change of charts, watch on the rank, work.

The method `projection` has the integrators of SciPy (`mbstab.analysis.projected`): DOP853 of order 8, RK45 of order 5
(Dormand and Prince), Radau IIA of order 5 and the backward differentiation formulas of orders 1 to 5 with exact
derivatives. The methods `alpha` and `radau` stand in `mbstab.analysis.implicit`.
"""

from __future__ import annotations

from mbstab.analysis.implicit import GeneralizedAlpha, RadauIIA
from mbstab.analysis.projected import explicit, implicit
from mbstab.analysis.stepping import Method

METHODS: dict[str, dict[str, Method]] = {
    "projection": {
        "DOP853": Method(explicit, 8, 1.0, compiled=True),
        "RK45": Method(explicit, 5, 1.0, compiled=True),
        "Radau": Method(implicit, 5, 1.25, fixed=False),
        "BDF": Method(implicit, 5, 0.8, fixed=False),
    },
    "alpha": {"": Method(GeneralizedAlpha, 2, 2.0 / 3.0)},
    "radau": {"": Method(RadauIIA, 5, 1.25)},
}
"""Methods by name, and the solvers of each; the first is the default."""
