"""Eigenvalues of stacks of matrices, in which slow ones beside fast ones come from the inverse."""

from __future__ import annotations

import numpy as np

from mbstab.analysis.algebra.arrays import Complex
from mbstab.analysis.algebra.tolerances import EPS
from mbstab.compiler.system import Array


def eigenpairs(A: Array, slow: float, vectors: bool = True, departure: float = np.inf) -> tuple[Complex, Complex]:
    """Return the eigenvalues of matrices, shape (points, r), and their vectors as columns, (points, r or 0, r).

    Parameters
    ----------
    A : ndarray, shape (points, r, r)
    slow : float
        Eigenvalues below this fraction of the largest have lost digits in A, and come from its inverse.
    vectors : bool
    departure : float
        An inverse whose norm is larger than this, relative to its eigenvalues, tells no more of the slow ones than A.
    """
    values, V = _solved(A, vectors)
    size = np.abs(values)
    stiff = np.flatnonzero(np.min(size, axis=1) < slow * np.max(size, axis=1))
    if len(stiff):
        try:
            inverse = np.asarray(np.linalg.inv(A[stiff]), dtype=float)
        except np.linalg.LinAlgError:  # zero is an eigenvalue: the inverse does not exist
            return values, V
        finite = np.isfinite(inverse).all(axis=(1, 2))
        stiff, inverse = stiff[finite], inverse[finite]
        found, W = _solved(inverse, vectors)
        # Where two zeros form a chain, the inverse is far larger than its eigenvalues, and their sum is lost in it.
        normal = np.linalg.norm(inverse, axis=(1, 2)) <= departure * np.max(np.abs(found), axis=1)
        some = stiff[normal]
        values[some], V[some] = _parted(values[some], V[some], found[normal], W[normal])
    return values, V


def _solved(A: Array, vectors: bool) -> tuple[Complex, Complex]:
    if not vectors:
        return np.linalg.eigvals(A).astype(complex), np.zeros((len(A), 0, A.shape[-1]), dtype=complex)
    values, V = np.linalg.eig(A)
    return values.astype(complex), V.astype(complex)


def _parted(values: Complex, V: Complex, inverse: Complex, W: Complex) -> tuple[Complex, Complex]:
    """Return fast pairs from those of matrices, slow ones from those of their inverses: divided at the widest gap."""
    each = np.arange(values.shape[1])
    order, other = (np.argsort(-np.abs(x), axis=1, kind="stable") for x in (values, inverse))
    rates = np.take_along_axis(np.abs(values), order, axis=1)
    with np.errstate(all="ignore"):
        fast = 1 + np.argmax(rates[:, :-1] / np.maximum(rates[:, 1:], EPS * rates[:, :1]), axis=1)[:, None]
        other = np.take_along_axis(other, np.maximum(each - fast, 0), axis=1)
        slow = 1.0 / np.take_along_axis(inverse, other, axis=1)
    found = np.where(each < fast, np.take_along_axis(values, order, axis=1), slow)
    columns = np.where((each < fast)[:, None], *(
        np.take_along_axis(x, index[:, None], axis=2) for x, index in ((V, order), (W, other))
    ))  # fmt: skip
    # A pair must not be divided.
    parts = np.sort(found.imag, axis=1)
    good = np.all(parts == -parts[:, ::-1], axis=1) & np.isfinite(found).all(axis=1)
    good &= np.isfinite(columns).all(axis=(1, 2))
    return np.where(good[:, None], found, values), np.where(good[:, None, None], columns, V)
