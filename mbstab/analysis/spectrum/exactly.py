"""A motion with many digits, for verdicts that rest on exact zeros; nothing is computed before it is asked for."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from mbstab.analysis.verdict.many_digits import Power
from mbstab.compiler.system import Array
from mbstab.model.schema import Model


class Exactly:
    """The reference motion of a model with many digits, an `mbstab.analysis.verdict.many_digits.ManyDigits`.

    Parameters
    ----------
    model : callable
        Returns the model, or None if many digits would belong to another motion.
    """

    def __init__(self, model: Callable[[], Model | None]) -> None:
        self._model = model

    def zeros(self) -> int:
        """Return the number of eigenvalues that are zero to many digits; −1 if it cannot be known."""
        from mbstab.analysis.spectrum.precise import exact_zeros

        model = self._model()
        return -1 if model is None else exact_zeros(model)

    def power(self, measure: Array, along: Array, held: Sequence[Array]) -> Power | None:
        """Return how the force begins that holds the motion at a distance along a direction; None if unknown."""
        from mbstab.analysis.spectrum.holding_force import power

        model = self._model()
        return None if model is None else power(model, measure, along, held)
