"""Groups of eigenvalues: equal ones, close ones, and those whose vectors are nearly dependent."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from mbstab.analysis.algebra.arrays import Complex
from mbstab.analysis.algebra.tolerances import EPS
from mbstab.analysis.bounds.discs import Disc, Group, meeting
from mbstab.analysis.bounds.tolerances import TOLERANCES
from mbstab.compiler.system import Array

if TYPE_CHECKING:
    import numpy.typing as npt


def row_scaled_inverse(W: Complex) -> Complex:
    """Return the inverse of a matrix whose rows may differ in size, nan where there is none."""
    size = np.max(np.abs(W), axis=1, initial=0.0)
    scale = 1.0 / np.where(size > 0.0, size, 1.0)
    try:
        result: Complex = np.asarray(np.linalg.inv(W * scale[:, None]) * scale, dtype=np.complex128)
    except np.linalg.LinAlgError:
        return np.full_like(W, np.nan)
    return result + (np.eye(len(W)) - result @ W) @ result


def partners(values: Complex) -> list[int]:
    """Return for each eigenvalue the number of its conjugate, its own number if it is real."""
    partner = list(range(len(values)))
    open_ = [i for i in range(len(values)) if values[i].imag < 0.0]
    for i in np.flatnonzero(values.imag > 0.0).tolist():
        j = min(open_, key=lambda k: abs(values[k] - values[i].conjugate()))
        open_.remove(j)
        partner[i], partner[j] = j, i
    return partner


def dependent(values: Complex, partner: list[int], vectors: Callable[[Group], Complex]) -> list[Group]:
    """Return groups of eigenvalues that are equal, or all small, where their vectors depend on each other."""
    size = np.abs(values)
    larger = np.maximum(size[:, None], size)
    near = (larger <= TOLERANCES.parallel_vectors * np.max(size)) | (
        np.abs(values[:, None] - values) <= TOLERANCES.defective_distance * larger
    )
    singles: list[Group] = [[i] for i in range(len(values))]
    pairs = [(int(i), int(j)) for i, j in zip(*np.nonzero(np.triu(near, 1)), strict=True)]
    found: list[Group] = []
    for members in united(singles, pairs, partner) if pairs else singles:
        if len(members) > 1:
            V = vectors(members)
            unit = V / np.linalg.norm(V, axis=0)
            if not np.linalg.svd(unit, compute_uv=False)[-1] > TOLERANCES.parallel_vectors:
                found.append(members)
                continue
        found += [[i] for i in members]
    return found


def coupled(E: Array, gap: Array) -> npt.NDArray[np.bool_]:
    """Return which eigenvalues are coupled too strongly for their distance."""
    limit, diagonal = TOLERANCES.coupling_of_pair * gap, np.diag(E)
    product: npt.NDArray[np.float64] = E * E.T
    return np.asarray((product >= limit**2) | (diagonal[:, None] + diagonal >= limit))


def below(matrices: Array, limit: float) -> bool:
    """Return whether the spectral radii of nonnegative matrices, shape (m, n, n), are below a limit.

    For any x > 0, a radius lies between the smallest and the largest of (P x)_i / x_i (Collatz 1942).
    """
    x = np.ones((*matrices.shape[:2], 1))
    for _ in range(TOLERANCES.radius_powers):
        y = matrices @ x
        ratio = (y / x)[..., 0]
        if np.any(np.min(ratio, axis=1) >= limit):
            return False
        if np.all(np.max(ratio, axis=1) < limit):
            return True
        # A small multiple of x keeps y positive where the matrix has zeros.
        x = y / np.max(y, axis=1, keepdims=True) + EPS * x
    return bool(np.max(np.abs(np.linalg.eigvals(matrices))) < limit)


def united(groups: list[Group], pairs: list[tuple[int, int]], mirror: list[int]) -> list[Group]:
    """Return larger groups: pairs of groups are joined, and so are their conjugates."""
    parent = list(range(len(groups)))

    def root(g: int) -> int:
        while parent[g] != g:
            g = parent[g]
        return g

    for g, h in pairs:
        parent[root(g)] = root(h)
        parent[root(mirror[g])] = root(mirror[h])
    together: dict[int, Group] = {}
    for g, members in enumerate(groups):
        together.setdefault(root(g), []).extend(members)
    return list(together.values())


def covering(discs: Sequence[Disc]) -> list[Disc]:
    """Return disjoint discs, each around discs that overlap; those of radius inf stay as they are."""
    found = list(discs)
    while pairs := meeting([d.centre for d in found], [d.radius for d in found]):
        each = list(range(len(found)))
        found = [_around([found[i] for i in members]) for members in united([[i] for i in each], pairs, each)]
    return found


def _around(discs: list[Disc]) -> Disc:
    if len(discs) == 1:
        return discs[0]
    centres, radii = np.array([d.centre for d in discs]), np.array([d.radius for d in discs])
    middle = complex(*(0.5 * (np.min(x - radii) + np.max(x + radii)) for x in (centres.real, centres.imag)))
    radius = float(np.max(np.abs(centres - middle) + radii)) * (1.0 + 4.0 * EPS)
    return Disc(middle, radius, tuple(i for d in discs for i in d.members))
