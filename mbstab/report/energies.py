"""Energies and powers at the reference, as text and as data."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from mbstab.model.schema import Model
from mbstab.report.tables import number, table

if TYPE_CHECKING:
    from mbstab.analysis.simulate.energy import Energies


def energies_text(result: Energies, model: Model) -> str:
    """Return the table of ``mbstab energy``: the entries of a scene and their sum."""
    rows = [
        [x.owner, *(number(y, 6) for y in (x.kinetic, x.potential, x.power))] for x in (*result.shares, result.total)
    ]
    return table(["energy of", "kinetic\n(J)", "potential\n(J)", "power\n(W)"], rows, left=(0,))


def energies_data(result: Energies, model: Model) -> dict[str, Any]:
    """Return the JSON object of ``mbstab energy``.

    Keys: ``model``, ``title``, ``time`` (s), ``entries`` (``owner``, ``kinetic`` and ``potential`` in J, ``power`` in
    W: what forces without a potential, dampers and drives do on the scene, 0 where it is below ``power_error``, the
    bound of its rounding error) and ``sum`` of them: its power is the rate at which the energy changes.
    """
    return {
        "time": result.motion.time,
        "entries": [vars(x) for x in result.shares],
        "sum": vars(result.total),
    }
