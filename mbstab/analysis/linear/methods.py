"""The methods for eigenvalues: an entry of `METHODS` is a method of the library, the command line and its help.

Nothing heavy is imported here, so that a help text can list them.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any, Protocol

from mbstab.records import dataclass

if TYPE_CHECKING:
    from mbstab.analysis.algebra.arrays import Complex
    from mbstab.analysis.linear.linearize import Linearization


@dataclass(frozen=True)
class Method:
    """The description of a method, and its function.

    Attributes
    ----------
    description : str
    solver : str
        A `Solver` of this package as ``module:function``; empty: the deflated system that every answer rests on.
    """

    description: str
    solver: str = ""


METHODS = {
    "nullspace": Method("constraints and zeros deflated"),
    "index3": Method("QZ on the regular index-3 pencil", "pencil:index3"),
    "paper": Method("QZ on the singular pencil of Eq. (70)", "pencil:paper"),
    "augmented": Method("accelerations from the augmented matrix", "acceleration_methods:augmented"),
    "embedding": Method("accelerations of independent coordinates", "acceleration_methods:embedding"),
    "amalgamated": Method("the same as one large system", "acceleration_methods:amalgamated"),
    "projection": Method("projected equations with the constraints", "acceleration_methods:projection"),
    "udwadia-kalaba": Method("accelerations by a pseudo-inverse", "acceleration_methods:udwadia_kalaba"),
}
"""By name; the first is the default."""

DEFAULT = next(iter(METHODS))


@dataclass(frozen=True)
class Found:
    """What a method found.

    Attributes
    ----------
    values : ndarray of complex, shape (k,)
        Finite eigenvalues (1/s).
    vectors : ndarray of complex, shape (n_q or more, k)
        The first n_q components of a column are Δq (m, rad).
    infinite, undefined : int
        Additional numbers of infinite eigenvalues and of pairs 0/0.
    extra : int
        Additional number of eigenvalues of constraint drift.
    extra_error : float (1/s)
        Largest distance of one of these from its exact value.
    """

    values: Complex
    vectors: Complex
    infinite: int = 0
    undefined: int = 0
    extra: int = 0
    extra_error: float = 0.0


class Solver(Protocol):
    """The function of a method."""

    def __call__(self, linear: Linearization, gamma: float, known: Complex) -> Found:
        """Return eigenvalues and vectors; `gamma` is a typical rate (1/s), `known` are those of the deflated system."""


def solver(name: str) -> Solver | None:
    """Return the function of a method; None for the deflated system."""
    if not METHODS[name].solver:
        return None
    module, _, function = METHODS[name].solver.partition(":")
    found: Any = getattr(importlib.import_module(f"mbstab.analysis.linear.{module}"), function)
    result: Solver = found
    return result
