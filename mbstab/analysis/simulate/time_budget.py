"""The time that a simulation takes: where it is long, the rest is reported early."""

from __future__ import annotations

import time

from mbstab.analysis.simulate.tolerances import TOLERANCES

clock = time.monotonic
"""Returns the time (s)."""


class Budget:
    """Monitor of the time of a simulation.

    Parameters
    ----------
    first, last : float
        The times that each run goes through (s).

    Attributes
    ----------
    more : float
        Minimum number of further runs as long as the present one.
    """

    def __init__(self, first: float, last: float) -> None:
        self._first, self._last, self.more = first, last, 0.0
        self._begin = self._run = clock()
        self._next, self._said = self._begin + TOLERANCES.time_to_judge, 0.0

    def start_run(self, more: float) -> None:
        """Begin a run, after which `more` runs of the same length follow."""
        self._run, self.more = clock(), more

    def passed(self, t: float) -> float:
        """Return the time of a run before t (s)."""
        return t - self._first

    def left(self, t: float) -> float | None:
        """Return the remaining time (s) at the pace of a run that has reached t, if it is to be reported now."""
        now = clock()
        if now < max(self._next, self._run + TOLERANCES.time_of_run_to_judge) or t <= self._first:
            return None
        self._next = now + (now - self._begin)
        spent = now - self._run
        left = spent * (self._last - self._first) / (t - self._first) * (1.0 + self.more) - spent
        whole = now - self._begin + left
        if whole <= max(TOLERANCES.time_told, TOLERANCES.time_growth_told * self._said):
            return None
        self._said = whole
        return left
