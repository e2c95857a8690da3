"""A scene with more symmetries, within the digits of the file.

An axis of 0.866 and 0.5 is that of no cosine and sine: rounded decimals break symmetries that the machine has. Here the
decimals of the file are moved by less than a unit of their last digits, until more fields leave all elements unchanged
to many digits. With A(p) c the changes of the elements along a field c, at random states on the rows, and p the
decimals, Newton's method solves A(p) C = 0 for the fields C that doubles propose within the digits. Of all solutions p
is next to the decimals of the file, each in the unit of its last digit.
"""

from __future__ import annotations

from decimal import Decimal, localcontext
from typing import Any

import numpy as np

from mbstab.analysis.algebra.ball_arrays import BALLS, NONE, as_ball, many_bits, middle
from mbstab.analysis.reference.element_comparison import ElementComparison
from mbstab.analysis.reference.identities import NO_VALUE, Identities, row_units
from mbstab.analysis.reference.tolerances import TOLERANCES
from mbstab.compiler.system import Array, System
from mbstab.model.balls import ball_arithmetic, decimal
from mbstab.model.garbage import uncollected
from mbstab.model.literals import named_literals, rounded_literals
from mbstab.model.values import evaluate


def closeness(system: System) -> float:
    """Return how well the decimals of a scene are known at worst, relative to them; 0 if none counts as rounded."""
    return max((unit / float(text) for text, unit in rounded_literals(system.scene.model).items()), default=0.0)


def symmetric_decimals(identities: Identities) -> dict[str, str] | None:
    """Return decimals for those of the file with which more fields leave all elements unchanged; None: not found."""
    system = identities.system
    units = rounded_literals(system.scene.model)
    if not 0 < len(units) <= TOLERANCES.decimals_moved:
        return None
    try:
        with np.errstate(all="ignore"), many_bits():
            fields, others = identities.nearly(closeness(system))
            if fields.shape[1] <= identities.space.shape[1]:
                return None
            off = _Moved(identities, units).solved(fields, others)
    except NO_VALUE:
        return None
    return None if off is None else {text: _written(text, x) for text, x in zip(units, off, strict=True)}


class _Moved:
    """A scene with its decimals as unknowns, in units of their last digits."""

    def __init__(self, identities: Identities, units: dict[str, float]) -> None:
        self.identities, self.scale = identities, BALLS.of(identities.scale)[:, None]
        self.units, self.given = np.array([*units.values()]), [decimal(text) for text in units]
        self.parts = self.units / np.array([float(text) for text in units])
        self.model, self.names = named_literals(identities.system.scene.model, units)
        self.system = System(evaluate(self.model))
        self.near = ElementComparison(self.system, identities.motion)

    def solved(self, fields: Array, others: int) -> Array | None:
        """Return how far the decimals are moved so that fields leave all elements unchanged; None: too far.

        Parameters
        ----------
        fields : ndarray, shape (size, number)
            Those that doubles propose, as columns.
        others : int
            The number of fields that leave elements nearly unchanged, those that vanish on the rows included.
        """
        every, still = BALLS.of(np.eye(len(fields))), BALLS.zeros((len(self.units),))
        changes = self.changes(every, still)
        weights, slopes = row_units(BALLS.powers(changes)), []
        changes = changes * weights
        for k in range(len(still)):
            step = still.copy()
            step[k] = as_ball(2.0) ** -TOLERANCES.bits_of_step
            slopes.append(middle((self.changes(every, step) * weights - changes) / step[k]))
        C = BALLS.of(fields) / self.scale
        left, s, right = np.linalg.svd(middle(changes))
        rank = len(right) - others
        inverse, rest = right[:rank].T @ (left[:, :rank].T / s[:rank, None]), left[:, rank:].T
        along = np.array([x @ middle(C) for x in slopes])  # decimals, rows, fields
        matrix = np.concatenate([rest @ along[:, :, j].T for j in range(C.shape[1])])
        # Changes that leave a symmetric scene symmetric are felt by rounding alone: they mend nothing.
        left, s, _ = np.linalg.svd(matrix / self.parts)
        felt = left[:, : len(s)][:, s > TOLERANCES.roundings_felt * np.max(self.parts) * np.max(s, initial=0.0)].T
        solve = np.linalg.pinv(felt @ matrix, rcond=TOLERANCES.decimals_alike) @ felt
        for _ in range(TOLERANCES.steps_of_decimals):
            residual = self.changes(C, still) * weights
            power = float(np.max(BALLS.powers(residual), initial=NONE))
            if power < -TOLERANCES.bits_of_moved:
                found: Array = still * self.units
                return found
            unit = as_ball(2.0) ** int(power)
            value = middle(residual / unit)
            step = -solve @ np.concatenate([rest @ x for x in value.T])
            C = BALLS.settled(C - BALLS.of(inverse @ (value + np.einsum("i,irj->rj", step, along))) * unit)
            still = BALLS.settled(still + BALLS.of(step) * unit)
            if not float(np.max(np.abs(middle(still)))) <= 1.0:
                return None
        return None

    def changes(self, C: Array, off: Array) -> Array:
        """Return what fields, in columns relative to their scale, do to all elements with decimals that are moved."""
        with uncollected(), many_bits(TOLERANCES.bits_of_scene):
            moved = {x: y + z * u for x, y, z, u in zip(self.names, self.given, off, self.units, strict=True)}
            exact = self.system.renumbered(evaluate(self.model, moved, ball_arithmetic(), checked=True))
        return Identities(self.near, exact=exact, states=self.identities).changes(C * self.scale)


def _written(text: str, off: Any) -> str:
    """Return a decimal that is moved by a ball."""
    mantissa, power = (int(x) for x in as_ball(off).mid().man_exp())
    with localcontext(prec=2 * TOLERANCES.digits_of_moved):
        moved = Decimal(text) + Decimal(mantissa) * Decimal(2) ** power
    with localcontext(prec=TOLERANCES.digits_of_moved):
        return str(+moved)
