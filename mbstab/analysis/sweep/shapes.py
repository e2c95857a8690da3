"""Eigenvalues that are told apart by their eigenvectors: which continues which between two points, and what meets.

In coordinates that both points share, the matrix at the second one is written in the eigenvectors of the first. Of two
eigenvalues that come near to each other the block of both is interpolated linearly, H(t) = (1 − t) H(0) + t H(1), whose
eigenvalues m(t) ± √D(t) have a discriminant D of second degree. They do not meet where its roots are apart from
0 … 1: the square root is continued along that line. Without coupling, D is a square, and they cross.
"""

from __future__ import annotations

import numpy as np

from mbstab.analysis.algebra.arrays import Complex, Flags, Index
from mbstab.analysis.algebra.matching import assigned, together
from mbstab.analysis.algebra.stacks import beside, transposed, under
from mbstab.analysis.sweep.batched_structure import Separation
from mbstab.analysis.sweep.points import Points
from mbstab.analysis.sweep.tolerances import TOLERANCES
from mbstab.analysis.sweep.tracking import follow, uncertain
from mbstab.records import dataclass


@dataclass(frozen=True)
class Shapes:
    """Eigenvalues and vectors of points, in coordinates and speeds that all of them share.

    Attributes
    ----------
    values : ndarray of complex, shape (points, r)
    right : ndarray of complex, shape (points, 2 n_q, r)
        Eigenvectors as columns …
    left : ndarray of complex, shape (points, r, 2 n_q)
        … and those rows with left @ right = 1.
    """

    values: Complex
    right: Complex
    left: Complex

    def each(self) -> list[Shapes]:
        """Return those of each point by itself."""
        return [Shapes(*x) for x in zip(self.values, self.right, self.left, strict=True)]


@dataclass(frozen=True)
class Approach:
    """Two eigenvalues that meet at a fraction t of an interval, or come near to that there.

    Attributes
    ----------
    t : float
    coupled, collides : bool
        Whether they have a part in each other's motion, and whether their square root is zero there.
    """

    t: float
    coupled: bool = False
    collides: bool = False


@dataclass(frozen=True)
class Told:
    """What eigenvectors tell about an interval: the successor of each eigenvalue, and which of them meet.

    Attributes
    ----------
    link : ndarray of int, shape (r,)
    approaches : tuple of Approach
    coupled : bool
        Whether eigenvalues that come near to each other have a part in each other's motion.
    touches : bool
        Whether others may meet without passing each other: they are equal at an end, or nothing tells of it there.
    """

    link: Index
    approaches: tuple[Approach, ...] = ()
    coupled: bool = False
    touches: bool = False


def shapes_of(points: Points, separation: Separation) -> Shapes:
    """Return the eigenvalues and vectors of points of a pattern."""
    values, V = np.linalg.eig(separation.A)
    with np.errstate(all="ignore"):
        try:
            Y = np.linalg.inv(V)
        except np.linalg.LinAlgError:
            Y = np.full_like(V, np.nan)
    gamma, n = points.gamma[:, None, None], points.n_xi
    right = under(*points.disturbances(separation.B @ V))
    rows = Y @ transposed(separation.B)
    on_rates = rows[:, :, n:] @ (transposed(points.Z) / gamma) @ transposed(points.N)
    on_moves = (rows[:, :, :n] - rows[:, :, n:] @ (transposed(points.Z) / gamma) @ points.P) @ transposed(points.N)
    if points.slope is not None:
        on_moves = on_moves - on_rates @ points.slope
    left = beside(on_moves, on_rates) / np.concatenate([points.scale, points.scale], axis=1)[:, None, :]
    return Shapes(values.astype(complex), right.astype(complex), left.astype(complex))


def told(before: Complex, after: Complex, one: Shapes | None, other: Shapes | None) -> Told | None:
    """Return what the eigenvectors of two points tell, None if nothing.

    Parameters
    ----------
    before, after : ndarray of complex, shape (r,)
        Eigenvalues at both points, in any order.
    one, other : Shapes or None
        Those of each point, without an axis for points; None where there are none.
    """
    if one is None or other is None:
        return None
    first, last = (assigned(np.abs(x[:, None] - y.values)) for x, y in ((before, one), (after, other)))
    link = follow(before[None], after[None])[0][0]
    overlap = one.left[first] @ other.right[:, last]
    share = overlap * (other.left[last] @ one.right[:, first]).T
    own = np.abs(share[np.arange(len(link)), link] - 1.0)
    # Where two have passed each other each may be nearest to where the other was.
    open_ = uncertain(before, after, link) | ~(own <= TOLERANCES.other_vectors)
    if not open_.any():
        return Told(link, touches=True)
    columns = np.setdiff1d(np.arange(len(after)), link[~open_])
    if len(columns) != np.sum(open_) or not np.all(np.isfinite(share[open_][:, columns])):
        return None
    link[open_] = columns[assigned(-np.abs(share[open_][:, columns]))]
    passing = _passing(before, after[link])
    rows = np.flatnonzero(open_ | passing.any(axis=1))
    within = np.ix_(rows, link[rows])
    return _resolved(link, rows, (before[rows], after[link[rows]]), overlap[within], share[within])


def _resolved(link: Index, rows: Index, ends: tuple[Complex, Complex], overlap: Complex, share: Complex) -> Told | None:
    """Return what is told of eigenvalues that come near to each other, the rows of a link that their vectors suggest.

    Parameters
    ----------
    link, rows : ndarray of int
    ends : tuple of ndarray, shape (k,)
        Those eigenvalues at both ends.
    overlap, share : ndarray, shape (k, k)
        Vectors of the second end in terms of those of the first, and how much of each other they are.
    """
    a, b = ends
    try:
        H: Complex = np.asarray(np.linalg.solve(overlap.T, (overlap * b).T).T, dtype=complex)
    except np.linalg.LinAlgError:
        return None
    size = float(np.max(np.abs(np.concatenate([a, b]))))
    # Vectors that are nearly parallel tell nothing of others.
    if not np.max(np.abs(H)) <= TOLERANCES.parallel_vectors * size:
        return None
    start, end = (x[:, None] - x[None, :] for x in (a, b))
    least = np.minimum(np.abs(start), np.abs(end))
    near = _passing(a, b) | (least <= np.sqrt(np.abs(H)) * np.sqrt(np.abs(H.T)))
    coupled = near & (np.minimum(np.abs(H), np.abs(H.T)) > TOLERANCES.uncoupled * size)
    same = least <= TOLERANCES.twin_distance * size
    found, approaches = link.copy(), list[Approach]()
    for group in together(coupled | same):
        within = np.ix_(group, group)
        # What the vectors of others have is lost.
        if np.any(np.abs(np.sum(share[within], axis=1) - 1.0) > TOLERANCES.other_vectors):
            return None
        if len(group) == 2 and not same[within][0, 1]:
            exchanged, meets = _pair(a[group], H[within], b[group])
            approaches += [Approach(t, True, collides) for t, collides in meets]
            found[rows[group]] = link[rows[group[::-1]]] if exchanged else link[rows[group]]
        elif len(group) > 2 and not same[within].all():
            return None
    touches = bool(np.any(np.triu(same, 1)))
    for i, k in np.argwhere(np.triu(near & ~coupled & ~same, 1)).tolist():
        t = start[i, k] / (start[i, k] - end[i, k])
        if 0.0 <= t.real <= 1.0:
            approaches.append(Approach(float(t.real)))
        else:
            touches = True
    return Told(found, tuple(approaches), bool(np.any(coupled & ~same)), touches)


def _passing(a: Complex, b: Complex) -> Flags:
    """Return which eigenvalues come near to each other, beside their approach, on straight lines from a to b."""
    start, end = (x[:, None] - x[None, :] for x in (a, b))
    step = end - start
    with np.errstate(all="ignore"):
        t = np.clip(np.nan_to_num(-(start * step.conj()).real / np.abs(step) ** 2), 0.0, 1.0)
    found: Flags = (np.abs(start + t * step) <= TOLERANCES.pass_near * np.abs(step)) & (step != 0.0)
    return found


def _pair(a: Complex, H: Complex, b: Complex) -> tuple[bool, list[tuple[float, bool]]]:
    """Return whether two eigenvalues that are coupled exchange their vectors; where they come near, and collide."""
    start, step = a[0] - a[1], H[0, 0] - H[1, 1] - a[0] + a[1]
    # Of 4 D(t), which is not zero at the ends.
    roots = np.roots([step**2 + 4.0 * H[0, 1] * H[1, 0], 2.0 * start * step, start**2]).astype(complex)
    last = start * np.prod(np.sqrt(1.0 - 1.0 / roots))
    exchanged = bool(abs(last - (b[0] - b[1])) > abs(last + (b[0] - b[1])))
    meets = [t for t in roots.tolist() if 0.0 <= t.real <= 1.0 and abs(t.imag) <= TOLERANCES.pass_near]
    collide = [abs(t.imag) <= TOLERANCES.twin_distance for t in meets]
    if sum(collide) == 1:
        # The direction is lost: the one that was ahead stays ahead.
        exchanged = (_ahead(a[0]) > _ahead(a[1])) != (_ahead(b[0]) > _ahead(b[1]))
    return exchanged, [(t.real, sure) for t, sure in zip(meets, collide, strict=True)]


def _ahead(value: complex) -> tuple[float, float]:
    return value.real, value.imag
