"""A sweep with all that is asked about its critical values: proofs, derivatives, the names of the branches."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from mbstab.analysis.sweep.critical_slopes import with_slopes
from mbstab.analysis.sweep.named_branches import with_branch_names
from mbstab.analysis.sweep.orders import with_orders
from mbstab.analysis.sweep.settings import SweepSettings
from mbstab.analysis.sweep.sweep import Sweep, sweep
from mbstab.compiler.system import Array
from mbstab.model.schema import Model


def swept(
    model: Model,
    parameter: str,
    values: Array,
    settings: SweepSettings,
    progress: Callable[[float], object],
    certify: bool,
    sensitivity: bool,
    orders: Sequence[float],
    drawn: tuple[bool, bool] = (False, False),
) -> Sweep:
    """Return a sweep as `mbstab.api.Mechanism.sweep` does; `drawn` says whether with meetings, and with detail.

    Raises
    ------
    UsageError
        As `mbstab.analysis.sweep.sweep.sweep`, or if orders are wrong.
    """
    parts = 1 + certify + sensitivity
    found = sweep(model, parameter, values, lambda done: progress(done / parts), settings, *drawn)
    if certify:
        from mbstab.analysis.proof.critical_values import with_enclosures

        found = with_enclosures(model, found, lambda done: progress((1 + done) / parts))
    if sensitivity:
        found = with_slopes(model, found, lambda done: progress((parts - 1 + done) / parts))
    return with_orders(model, with_branch_names(model, found), orders)
