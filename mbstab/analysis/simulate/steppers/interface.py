"""The interface of integration methods."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np

from mbstab.analysis.simulate.constrained import Constrained
from mbstab.compiler.system import Array, Dynamics
from mbstab.records import dataclass

HINT = (
    "hint: look for a jump or a kink in a given function of time or a force, for a singular configuration, or for "
    "motions that are much faster than what is asked for (--method radau)"
)


@dataclass(frozen=True)
class Options:
    """Options of a stepper.

    Attributes
    ----------
    tol : float
        Local error of a step, relative to the sizes in the scene and to their rates.
    step : float or None
        Fixed step (s); None: chosen by the tolerance.
    first : float or None
        Step to begin with (s).
    rate : float (1/s)
        The rate that counts as fast, for a coordinate of size 1.
    longest : float (s)
        Longest step; given functions of time may rest for a while and then start.
    solver : str
        Integrator of the projection method.
    compiled : bool
        Let `mbstab.analysis.simulate.steppers.compiled` take the steps.
    """

    tol: float
    step: float | None
    first: float | None
    rate: float
    longest: float = math.inf
    solver: str = ""
    compiled: bool = False

    def tolerances(self, sizes: Array) -> Array:
        """Return the allowed errors per step in q and u, shape (2 n_q,)."""
        # With a fixed step the tolerance has no effect, and the largest step is the step.
        tol = self.tol if self.step is None else 1e6
        return tol * np.concatenate([sizes, sizes * self.rate])


class Stepper(Protocol):
    """A method at work.

    Attributes
    ----------
    t : float (s)
    q, u : ndarray, shape (n_q,)
        The state reached; it satisfies the constraints to the accuracy of the method.
    rejected : int
        Number of rejected steps.
    taken : float
        The last step (s).
    state : Dynamics
        Matrices at the state reached.
    """

    t: float
    q: Array
    u: Array
    rejected: int
    taken: float
    state: Dynamics

    def advance(self) -> None:
        """Take one step, or raise a `NumericalError`."""

    def at(self, t: Any) -> tuple[Array, Array]:
        """Return q and u, shape (…, n_q), at times within the last step."""


Start = Callable[[Constrained, float, Array, Array, float, Options], Stepper]


@dataclass(frozen=True)
class Method:
    """An integration method.

    Attributes
    ----------
    start : callable
        ``start(equations, t, q, u, end, options)`` returns a `Stepper`.
    order : int
        Order of the global error in the step.
    power : float
        The global error is proportional to this power of the tolerance per step: order / (order of the
        error estimate + 1).
    fixed : bool
        Whether steps of fixed size are possible.
    compiled : str
        The module of `mbstab.compiler.machine` that can take the steps, or empty.
    """

    start: Start
    order: int
    power: float
    fixed: bool = True
    compiled: str = ""
