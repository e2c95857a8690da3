"""Sparse matrices of large scenes."""

from __future__ import annotations

from typing import Any

from mbstab.compiler.system import System

LARGE = 200
"""Scenes with so many coordinates and constraint rows together have sparse matrices; below, dense ones are faster."""


def large(system: System) -> bool:
    """Whether sparse matrices pay for a scene."""
    return system.n_q + system.n_c >= LARGE


def in_sparse(system: System) -> System:
    """Return the same equations with matrices M, J, K, R, D_q, … that are `scipy.sparse.csr_array`."""

    def form(data: Any, indices: Any, starts: Any, shape: tuple[int, int]) -> Any:
        from scipy.sparse import csr_array

        return csr_array((data, indices, starts), shape=shape)

    return system.in_matrices(form)
