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
    solver : str
        Integrator of SciPy, or empty.
    boundary : float
        Largest h |λ| of an explicit method where λ is negative, the number of the test for stiffness in Hairer and
        Wanner 1996, section IV.2; infinite for the others.
    fixed : bool
        Whether steps of fixed size are possible.
    compiled : str
        The module of `mbstab.compiler.machine` that can take the steps, or empty.
    """

    start: Callable[[Constrained, float, Array, Array, float, Options], Stepper]
    order: int
    power: float
    solver: str = ""
    boundary: float = math.inf
    fixed: bool = True
    compiled: str = ""

    @property
    def exponent(self) -> float:
        """Steps are proportional to this power of the tolerance per step: 1 / (order of the error estimate + 1)."""
        return self.power / self.order


@dataclass(frozen=True)
class Options:
    """Options of a stepper.

    Attributes
    ----------
    method : Method
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
    compiled : bool
        Let `mbstab.analysis.simulate.steppers.compiled` take the steps.
    """

    method: Method
    tol: float
    step: float | None
    first: float | None
    rate: float
    longest: float = math.inf
    compiled: bool = False

    def tolerances(self, sizes: Array) -> Array:
        """Return the allowed errors per step in q and u, shape (2 n_q,)."""
        # With a fixed step the tolerance has no effect, and the largest step is the step.
        tol = self.tol if self.step is None else 1e6
        return tol * np.concatenate([sizes, sizes * self.rate])


class Reached(Protocol):
    """The state that a method has reached; it satisfies the constraints to the accuracy of the method."""

    @property
    def t(self) -> float:
        """The time (s)."""

    @property
    def q(self) -> Array:
        """Coordinates, shape (n_q,)."""

    @property
    def u(self) -> Array:
        """Speeds, shape (n_q,)."""

    @property
    def taken(self) -> float:
        """The last step (s)."""


class Stepper(Reached, Protocol):
    """A method at work.

    Attributes
    ----------
    rejected : int
        Number of rejected steps.
    state : Dynamics
        Matrices at the state reached.
    """

    rejected: int
    state: Dynamics

    def advance(self) -> None:
        """Take one step, or raise a `NumericalError`."""

    def at(self, t: Any) -> tuple[Array, Array]:
        """Return q and u, shape (…, n_q), at times within the last step."""
