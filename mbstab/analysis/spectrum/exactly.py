"""A motion with many digits, for verdicts that rest on exact zeros; nothing is computed before it is asked for."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property

from mbstab.analysis.verdict.many_digits import UNKNOWN, Line, Power, Zeros
from mbstab.model.schema import Model


class Exactly:
    """The reference motion of a model with many digits, an `mbstab.analysis.verdict.many_digits.ManyDigits`.

    Parameters
    ----------
    model : callable
        Returns the model, or None if many digits would belong to another motion.
    """

    def __init__(self, model: Callable[[], Model | None]) -> None:
        self._given = model
        self._zeros: Zeros | None = None

    @cached_property
    def _model(self) -> Model | None:
        return self._given()

    def zeros(self, turns: Sequence[complex]) -> Zeros:
        """Return the eigenvalues that are zero to many digits; see `ManyDigits`."""
        if self._zeros is None:
            from mbstab.analysis.spectrum.precise import exact_zeros

            self._zeros = UNKNOWN if self._model is None else exact_zeros(self._model, turns)
        return self._zeros

    def powers(self, line: Line) -> tuple[Power, Power] | None:
        """Return how the force begins that holds the motion along a line, ahead and behind; None if it is not known."""
        from mbstab.analysis.spectrum.holding_force import powers

        return None if self._model is None else powers(self._model, line)
