"""Sparse matrices of large scenes."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from functools import lru_cache
from typing import Any

import numpy as np

from mbstab.analysis.algebra.arrays import norms
from mbstab.analysis.algebra.stacks import times
from mbstab.analysis.algebra.tolerances import TOLERANCES
from mbstab.compiler.system import Array, System


def large(system: System) -> bool:
    """Return whether a scene is large enough for sparse matrices."""
    return system.n_q + system.n_c >= TOLERANCES.sparse_from_size


def in_sparse(system: System) -> System:
    """Return the same equations with matrices M, J, K, R, D_q, … as `scipy.sparse.csr_array`."""
    known: dict[int, tuple[Any, Any]] = {}

    def form(data: Any, indices: Any, starts: Any, shape: tuple[int, int]) -> Any:
        from scipy.sparse import csr_array

        if id(indices) not in known:
            known[id(indices)] = csr_array((data, indices, starts), shape=shape), indices
        return with_data(known[id(indices)][0], data)

    return system.in_matrices(form)


def with_data(A: Any, data: Any) -> Any:
    """Return a sparse matrix with the pattern of another one; SciPy would check it again, which takes longer."""
    found = copy(A)
    found.data = data
    return found


def is_sparse(A: Any) -> bool:
    """Return whether a matrix is sparse."""
    return not isinstance(A, np.ndarray)


def dense(A: Any) -> Array:
    """Return a matrix as an array."""
    return np.asarray(A.toarray() if is_sparse(A) else A)


def scaled(A: Any, columns: Array, rows: Array | None = None) -> Any:
    """Return a matrix, in compressed rows or dense with any leading axes, with columns and rows times factors."""
    if not is_sparse(A):
        A = A * columns[..., None, :]
        return A if rows is None else A * rows[..., :, None]
    data = A.data * columns[A.indices]
    if rows is not None:
        data = data * np.repeat(rows, np.diff(A.indptr))
    return with_data(A, data)


def bordered(A: Any, J: Any, corner: float = 0.0) -> Any:
    """Return [A Jᵀ; J c·1] by columns, of sparse arrays, to be factored; `scipy.sparse.block_array` takes longer."""
    from scipy.sparse import csc_array

    (c, n), A = J.shape, A.tocoo()
    rows, last = np.repeat(np.arange(n, n + c), np.diff(J.indptr)), np.arange(n, n + c) if corner else np.arange(0)
    i = np.concatenate([A.coords[0], rows, J.indices, last])
    j = np.concatenate([A.coords[1], J.indices, rows, last])
    return csc_array((np.concatenate([A.data, J.data, J.data, np.full(len(last), corner)]), (i, j)), shape=(n + c,) * 2)


def row_norms(A: Any) -> Array:
    """Return the norms of rows as divisors: 1 for zero rows."""
    if not is_sparse(A):
        return norms(A)
    lengths = np.sqrt(np.asarray((A * A).sum(axis=1)).ravel())
    result: Array = np.where(lengths > 0.0, lengths, 1.0)
    return result


def largest(A: Any) -> Any:
    """Return the largest absolute value of the entries, 0 if there are none; of arrays of matrices that of each."""
    return float(np.max(np.abs(A.data), initial=0.0)) if is_sparse(A) else np.max(np.abs(A), axis=(-2, -1), initial=0.0)


def difference(b: Array, *products: tuple[Any, Array]) -> Array:
    """Return b − Σ A x; for sparse matrices A in the longest floating-point type of the machine."""
    sparse = any(is_sparse(A) for A, _ in products)
    result = b.astype(np.longdouble) if sparse else b
    for A, x in products:
        result = result - (A.astype(np.longdouble) @ x.astype(np.longdouble) if sparse else A @ x)
    return np.asarray(result, dtype=float)


def sizes_times(A: Any, x: Array) -> Array:
    """Return |A| x for arrays with any leading axes, or for a linear operator row by row."""
    if not is_sparse(A):
        return times(np.abs(A), x)
    count = A.shape[0]
    total = np.zeros((count, *x.shape[1:]))
    for start in range(0, count, TOLERANCES.columns_at_once):
        part = np.zeros((count, min(TOLERANCES.columns_at_once, count - start)))
        part[start : start + TOLERANCES.columns_at_once] = np.eye(part.shape[1])
        total[start : start + TOLERANCES.columns_at_once] = np.abs(A.T @ part).T @ x
    return total


def congruent(A: Any, N: Array) -> Array:
    """Return Nᵀ A N; for a sparse matrix from its nonzero rows and columns only."""
    if not is_sparse(A):
        form: Array = N.T @ A @ N
        return form
    A = A.tocoo()
    A.eliminate_zeros()
    rows, i = np.unique(A.coords[0], return_inverse=True)
    columns, j = np.unique(A.coords[1], return_inverse=True)
    local = type(A)((A.data, (i, j)), shape=(len(rows), len(columns))).tocsr()
    result: Array = N[rows].T @ (local @ N[columns])
    return result


# --- derivatives of maps that change few coordinates ----------------------------------------------------------------


@lru_cache(maxsize=2)
def identity(n: int) -> Any:
    """Return the identity matrix, sparse."""
    from scipy.sparse import csr_array, eye_array

    return csr_array(eye_array(n))


def nothing(n: int) -> Any:
    """Return a square matrix of zeros, sparse for many coordinates."""
    if n < TOLERANCES.sparse_derivatives_from:
        return np.zeros((n, n))
    from scipy.sparse import csr_array

    return csr_array((n, n))


def product(A: Any, x: Any) -> Any:
    """Return A x of a real matrix and real or complex columns."""
    return in_parts(lambda b: A @ b, x)


def in_parts(function: Callable[[Array], Array], x: Any) -> Any:
    """Return a real linear function of real or complex columns: the parts of complex ones side by side."""
    if not np.iscomplexobj(x):
        return function(x)
    x = np.ascontiguousarray(x)
    return np.ascontiguousarray(function(x.view(float))).view(complex)
