"""The cost of a task on a large scene, before matrices are formed: memory and time are estimated and limited."""

from __future__ import annotations

from typing import Literal, NamedTuple

from mbstab.analysis.algebra.tolerances import TOLERANCES
from mbstab.errors import UsageError
from mbstab.records import dataclass

Task = Literal["motion", "modes", "spectrum", "digits", "proof", "run"]
"""``motion``: the reference and the matrices there; ``modes``: also the eigenvalues and their verdict; ``spectrum``:
the same with sparse matrices; ``digits``, ``proof``: with many digits, in balls; ``run``: a run of a simulation."""


class _Measured(NamedTuple):
    """What a task costs for each entry of matrices, and for each cube of their sizes, as measured."""

    numbers: float
    """Numbers in memory for each entry of a matrix with the number of coordinates as size."""
    of_spectrum: float
    """Additional ones for each entry of a matrix with the number of eigenvalues as size."""
    coordinates: float
    """Time per cube of the number of coordinates (s)."""
    eigenvalues: float
    """Additional time per cube of the number of eigenvalues (s)."""
    longer: bool = True
    """Whether it may take longer than other questions."""


_MEASURED: dict[Task, _Measured] = {
    "motion": _Measured(45.0, 0.0, 10e-9, 0.0, longer=False),
    "modes": _Measured(80.0, 0.0, 15e-9, 9e-9, longer=False),
    "spectrum": _Measured(0.0, 14.0, 0.0, 2e-9),
    "digits": _Measured(80.0, 40.0, 15e-9, 56e-6),
    "proof": _Measured(80.0, 40.0, 15e-9, 5e-6),
    "run": _Measured(100.0, 0.0, 50e-9, 0.0, longer=False),
}


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
        own, n_f = _MEASURED[task], 2.0 * max(0, n_q - n_c)
        time = own.coordinates * float(n_q) ** 3 + own.eigenvalues * n_f**3
        memory = 8.0 * (own.numbers * float(n_q) ** 2 + own.of_spectrum * n_f**2)
        most = TOLERANCES.estimated_time_of_spectrum if own.longer else TOLERANCES.estimated_time
        return cls(n_q, memory, time, most)

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
