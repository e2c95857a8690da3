"""The cost of a task on a large scene, before matrices are formed: memory and time are estimated and limited."""

from __future__ import annotations

from typing import Literal

from mbstab.analysis.algebra.tolerances import TOLERANCES
from mbstab.errors import UsageError
from mbstab.records import dataclass

Task = Literal["motion", "modes", "spectrum", "run"]
"""``motion``: the reference and the matrices there; ``modes``: also the eigenvalues and their verdict; ``spectrum``:
the same with sparse matrices; ``run``: a run of a simulation."""

_NUMBERS: dict[Task, float] = {"motion": 45.0, "modes": 80.0, "spectrum": 0.0, "run": 100.0}
"""Numbers in memory for each entry of a matrix with the number of coordinates as size; measured."""
_SPECTRUM: dict[Task, float] = {"motion": 0.0, "modes": 0.0, "spectrum": 14.0, "run": 0.0}
"""Additional numbers for each entry of a matrix with the number of eigenvalues as size; measured."""
_COORDINATES: dict[Task, float] = {"motion": 10e-9, "modes": 15e-9, "spectrum": 0.0, "run": 50e-9}
"""Time per cube of the number of coordinates (s); measured."""
_EIGENVALUES: dict[Task, float] = {"motion": 0.0, "modes": 9e-9, "spectrum": 2e-9, "run": 0.0}
"""Additional time per cube of the number of eigenvalues (s); measured."""


@dataclass(frozen=True)
class Cost:
    """An estimate for a scene.

    Attributes
    ----------
    n_q : int
        Number of coordinates.
    memory : float (bytes)
    time : float (s)
        On one core.
    most_time : float (s)
        Limit of the time.
    """

    n_q: int
    memory: float
    time: float
    most_time: float = TOLERANCES.estimated_time

    @classmethod
    def of(cls, task: Task, n_q: int, n_c: int) -> Cost:
        """Return the cost of a task for numbers of coordinates and of constraint rows, taken as independent."""
        n_f = 2.0 * max(0, n_q - n_c)
        time = _COORDINATES[task] * float(n_q) ** 3 + _EIGENVALUES[task] * n_f**3
        memory = 8.0 * (_NUMBERS[task] * float(n_q) ** 2 + _SPECTRUM[task] * n_f**2)
        return cls(
            n_q,
            memory,
            time,
            TOLERANCES.estimated_time_of_spectrum if task == "spectrum" else TOLERANCES.estimated_time,
        )

    @property
    def affordable(self) -> bool:
        """Whether it is within the limits."""
        return self.memory <= TOLERANCES.estimated_memory and self.time <= self.most_time

    def __str__(self) -> str:
        """Return it in words."""
        return f"about {self.memory / 1e9:.1f} GB of memory and {duration(self.time)} of work"

    def require(self) -> None:
        """Refuse what costs too much.

        Raises
        ------
        UsageError
            Tells the number of coordinates, the estimate and the limits.
        """
        if not self.affordable:
            raise UsageError(
                f"the scene has {self.n_q} coordinates: that takes {self}, more than "
                f"{TOLERANCES.estimated_memory / 1e9:.0f} GB or {self.most_time:.0f} s\nhint: --force (force=True in "
                "Python) runs it anyway; bodies that nothing connects can be analysed one by one"
            )


def require_room(points: int, numbers: int, what: str) -> None:
    """Refuse a result at many points, with so many numbers for each, that takes too much memory.

    Raises
    ------
    UsageError
        Tells the estimate, the limit, and how many points fit.
    """
    size, most = 8.0 * points * numbers, TOLERANCES.estimated_memory
    if size > most:
        raise UsageError(
            f"{points} {what} take about {size / 1e9:.2g} GB of memory ({numbers} numbers each), where "
            f"{most / 1e9:g} GB is the limit\n"
            f"hint: {int(most / (8 * numbers))} --points fit, or allow it with --force"
        )


def duration(seconds: float) -> str:
    """Return a time in words, such as ``40 s``, ``12 min`` or ``3 h``; at least one second."""
    seconds = max(seconds, 1.0)
    for unit, size, most in (("s", 1.0, 90.0), ("min", 60.0, 90.0), ("h", 3600.0, 48.0), ("days", 86400.0, 1000.0)):
        if seconds < most * size:
            return f"{seconds / size:.0f} {unit}"
    return f"{seconds / 86400.0:.1e} days"
