"""The equations of a scene at many states: first from `System`, then as straight-line functions when it pays."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

from mbstab.compiler.system import Array, Dynamics, System

if TYPE_CHECKING:
    from mbstab.compiler.fused import Fused

FUSED_AFTER = 60
"""Number of evaluations from which on straight-line functions of the scene, which must be generated first, pay."""


class Form:
    """The equations of a scene: first from the system, then as straight-line functions when it pays.

    Functions have the arguments and results of those of `System` and raise the same errors.
    """

    def __init__(self, system: System) -> None:
        self.system = system
        self._count = 0

    @cached_property
    def fused(self) -> Fused:
        """The straight-line functions."""
        from mbstab.compiler.fused import Fused

        return self.system.remember("fused", None, lambda: Fused(self.system))

    @property
    def quick(self) -> bool:
        """Whether there are straight-line functions, or it pays to generate them."""
        return self._count >= FUSED_AFTER

    def dynamics(self, q: Array, u: Array, t: float) -> Dynamics:
        """Return the matrices of the equations of motion."""
        if self._count >= FUSED_AFTER:
            return self.fused.dynamics(q, u, t)
        self._count += 1
        return self.system.dynamics(q, u, t)

    def linearize(self, q: Array, u: Array, a: Array, nu: Array, t: float) -> tuple[Array, Array, Array]:
        """Return K, R and D_q."""
        source: System | Fused = self.fused if self.quick else self.system
        self._count += 1
        return source.linearize(q, u, a, nu, t)

    def linearize_rows(self, q: Array, u: Array, a: Array, t: float) -> tuple[Array, Array, Array]:
        """Return V_q, A_q and A_u."""
        source: System | Fused = self.fused if self.quick else self.system
        return source.linearize_rows(q, u, a, t)
