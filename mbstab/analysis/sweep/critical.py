"""A value of a parameter at which stability changes, and what is known about it."""

from __future__ import annotations

from dataclasses import field
from typing import Any

import numpy as np

from mbstab.analysis.reference.paths import PathEnd
from mbstab.compiler.system import Array
from mbstab.records import dataclass


@dataclass(frozen=True)
class Enclosed:
    """What is proven about a critical value.

    Attributes
    ----------
    value : ball or None
        ``flint.arb``, in the unit of the parameter: somewhere inside stability changes; None: nothing is proven.
    digits : int
        Digits to which it is enclosed.
    conditions : tuple of str
        What is not proven and must hold, as clauses of a sentence.
    reason : str
        Why nothing is proven.
    """

    value: Any = None
    digits: int = 0
    conditions: tuple[str, ...] = ()
    reason: str = ""


@dataclass(frozen=True)
class CriticalSlopes:
    """The derivatives of a critical value by the other parameters.

    Attributes
    ----------
    names : tuple of str
        The other parameters, in the order of the file.
    values : ndarray, shape (parameters,)
        Of the parameters, in SI.
    slopes, errors : ndarray, shape (parameters,)
        d(critical value)/dq in SI, and estimates of their errors; nan where there are none.
    missing : str
        Why there are none at all; empty: there are.
    reasons : dict
        Why there are none by some of the parameters.
    """

    names: tuple[str, ...] = ()
    values: Array = field(default_factory=lambda: np.zeros(0))
    slopes: Array = field(default_factory=lambda: np.zeros(0))
    errors: Array = field(default_factory=lambda: np.zeros(0))
    missing: str = ""
    reasons: dict[str, str] = field(default_factory=dict)

    @property
    def order(self) -> list[int]:
        """Numbers of the parameters with derivatives, what moves the critical value most per percent first."""
        change = np.abs(self.slopes * self.values)
        known = np.flatnonzero(~np.isnan(change)).tolist()
        return sorted(known, key=lambda k: (-change[k], not self.values[k], -abs(self.slopes[k])))

    @property
    def relative(self) -> float:
        """The largest error, relative to the largest derivative; both per percent of the parameters."""
        sizes = np.where(self.values, np.abs(self.values), 1.0)
        largest = np.nanmax(np.abs(self.slopes) * sizes, initial=0.0)
        return float(np.nanmax(self.errors * sizes, initial=0.0) / (largest or 1.0))


@dataclass(frozen=True)
class Critical:
    """A parameter value at which stability changes.

    Attributes
    ----------
    value : float
        In SI.
    kind : str
        ``divergence`` (an eigenvalue passes zero), ``flutter`` (a pair passes the imaginary
        axis), ``collision`` (two pairs meet on the imaginary axis), ``infinity``
        (a real eigenvalue passes through infinity: constraints lose rank, or a mass or stiffness is infinite), ``branch
        point`` (other equilibria branch off; stability need not change), ``fold`` (the path of
        equilibria turns back), ``loss of equilibrium`` (it ends), ``end of the equations``
        (it ends where they have no value beyond), ``unresolved``.
    branches : tuple of int
        The branches that are involved.
    frequency : float (rad/s)
        Frequency of the motion at the boundary; 0 for a divergence.
    unstable : tuple of int
        Number of unstable eigenvalues below and above; −1 where there are none to count.
    signatures : tuple of int or None
        For a collision: the signs of the energies of the two modes that meet (Krein
        signatures); only modes of opposite sign can leave the axis.
    branching : bool
        Whether another path of equilibria crosses there.
    verdicts : tuple of str
        The verdicts just below and above it; empty where there is none.
    enclosed : Enclosed or None
        What is proven about it; None: no proof was requested.
    slopes : CriticalSlopes or None
        Its derivatives by the other parameters; None: they were not requested.
    error : float
        Rounding hides where it is within this distance (SI); 0: it is known to its last digits.
    """

    value: float
    kind: str
    branches: tuple[int, ...]
    frequency: float
    unstable: tuple[int, int]
    signatures: tuple[int, int] | None = None
    branching: bool = False
    verdicts: tuple[str, str] = ("", "")
    enclosed: Enclosed | None = None
    slopes: CriticalSlopes | None = None
    error: float = 0.0


def kind_of(reason: PathEnd) -> str:
    """Return the kind of the critical value at which a path of equilibria ends."""
    match reason:
        case PathEnd.TURNS:
            return "fold"
        case PathEnd.BRANCHES:
            return "branch point"
        case PathEnd.NONE | PathEnd.AWAY:
            return "loss of equilibrium"
        case PathEnd.EQUATIONS:
            return "end of the equations"
        case PathEnd.AGAIN | PathEnd.LONG | PathEnd.UNSURE | PathEnd.HIDDEN:
            return "unresolved"
