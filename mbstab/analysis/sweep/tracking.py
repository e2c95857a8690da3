"""Spectra: links of eigenvalues between two points, and functions that vanish where stability changes."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import numpy.typing as npt

from mbstab.analysis.algebra.arrays import Complex, Flags, Index
from mbstab.analysis.algebra.matching import assigned
from mbstab.analysis.sweep.tolerances import TOLERANCES
from mbstab.compiler.system import Array


def squares(values: Complex) -> Complex:
    """Return λ² of a symmetric spectrum of an even number of eigenvalues, each one once."""
    square = np.sort_complex(values * values)
    left = list(square)
    found = []
    while left:
        first = left.pop(0)
        twin = min(range(len(left)), key=lambda k: abs(left[k] - first))
        found.append(0.5 * (first + left.pop(twin)))
    return np.array(found, dtype=complex)


def product(values: Complex, size: float, zeros: int = 0) -> float:
    """Return the product of the eigenvalues, in units of a size; real.

    Parameters
    ----------
    zeros : int
        Number of zeros among them that are left out, whatever rounding made of them: the sum of the
        products of all the others, a coefficient of the characteristic polynomial.
    """
    scaled = values / size
    if zeros:
        return float(np.poly(scaled)[len(values) - zeros].real) * (-1.0) ** (len(values) - zeros)
    return float(np.prod(scaled).real)


def symmetric_product(values: Complex, size: float, zeros: int = 0) -> float:
    """Return the product of the eigenvalues of a symmetric spectrum; its zeros are left out as by `discriminant`."""
    return product(values, size, _zeros_of_symmetric(len(values), zeros))


def discriminant(values: Complex, zeros: int = 0) -> float:
    """Return the discriminant of λ² of a symmetric spectrum; real.

    Each difference counts relative to what differs, and all together relative to those of the squares of the whole
    numbers: so the product of many neither vanishes nor grows beyond the range of numbers.

    Parameters
    ----------
    zeros : int
        Number of zeros that are left out. If an odd number of eigenvalues remains, one more is left out: the one
        that is its own mirror image about the imaginary axis.
    """
    others = values[np.argsort(np.abs(values), kind="stable")[_zeros_of_symmetric(len(values), zeros) :]]
    found = _differences(squares(others))
    usual = _differences(np.arange(1.0, len(others) // 2 + 1.0).astype(complex) ** 2)
    if np.any(found == 0.0):
        return 0.0
    size = 2.0 * float(np.sum(np.log(np.abs(found))) - np.sum(np.log(np.abs(usual))))
    sign = np.prod((found / np.abs(found)) ** 2).real
    return float(np.sign(sign) * np.exp(np.clip(size, *TOLERANCES.logarithms)))


def _differences(mu: Complex) -> Complex:
    """Return the differences of all pairs, relative to the sums of their sizes."""
    i, j = np.triu_indices(len(mu), 1)
    sizes = np.abs(mu[i]) + np.abs(mu[j])
    return np.asarray((mu[i] - mu[j]) / np.where(sizes, sizes, 1.0))


def _zeros_of_symmetric(count: int, zeros: int) -> int:
    """Return the number of zeros of a symmetric spectrum, of which some are known: an even number is not zero."""
    return zeros + (count - zeros) % 2


def has_twins(values: Complex, distance: float = TOLERANCES.twin_distance) -> Flags:
    """Return which spectra, shape (m, r), have eigenvalues nearer than a fraction of the largest."""
    size = np.max(np.abs(values), axis=1, initial=0.0)
    found: Flags = np.min(_gaps(values), axis=(1, 2), initial=np.inf) < distance * size
    return found


def follow(before: Complex, after: Complex, twins: Flags | None = None) -> tuple[Index, Flags]:
    """Return for spectra, shape (m, r), the successor of each eigenvalue, and whether it is certain.

    Equal eigenvalues may be multiple ones in all intervals, or in those where `twins` says so.
    """
    m, r = before.shape
    link, clear = np.zeros((m, r), dtype=np.intp), np.ones(m, dtype=bool)
    if r < 2:
        return link, clear
    for start in range(0, m, TOLERANCES.intervals_together):
        part = slice(start, start + TOLERANCES.intervals_together)
        link[part], clear[part] = _followed(before[part], after[part], None if twins is None else twins[part])
    return link, clear


def uncertain(before: Complex, after: Complex, link: Index) -> Flags:
    """Return which eigenvalues, shape (r,), move too far beside their distance to the others for a link to be sure."""
    moved, own = np.abs(after[link] - before), np.where(np.eye(len(before), dtype=bool), np.inf, 0.0)
    # At the second point those that want the same successor are one.
    gap = [np.min(np.abs(x[:, None] - x[None, :]) + own, axis=1, initial=np.inf) for x in (before, after[link])]
    found: Flags = ~(moved <= TOLERANCES.tracking_step * np.minimum(*gap))
    return found


def together(spectra: Complex, steps: Array) -> tuple[Index, Flags]:
    """Return the successors of eigenvalues that move far but together, for spectra, shape (m, r), and m − 1 steps.

    In a certain interval the difference of any two changes little beside itself, so that none of them meet, and at the
    points around it each moves on at the same rate, beside its distance to the others.
    """
    moved = np.abs(spectra[:-1, :, None] - spectra[1:, None, :])
    # The sum of squares is least where differences keep their direction; that of distances does not tell.
    link = np.array([assigned(x * x) for x in moved])
    after = np.take_along_axis(spectra[1:], link, axis=1)
    step, before = after - spectra[:-1], spectra[:-1]
    own = np.where(np.eye(spectra.shape[1], dtype=bool), np.inf, 0.0)
    gap = np.minimum(*(np.abs(x[:, :, None] - x[:, None, :]) + own for x in (before, after)))
    change = np.abs(step[:, :, None] - step[:, None, :])
    certain = np.all(change <= TOLERANCES.tracking_step * gap, axis=(1, 2))
    rate = step / steps[:, None]
    bend = np.abs(np.take_along_axis(rate[1:], link[:-1], axis=1) - rate[:-1])
    room = TOLERANCES.tracking_step * np.min(gap[:-1], axis=2)
    for side, length in ((certain[:-1], steps[:-1]), (certain[1:], steps[1:])):
        side &= np.all(bend * length[:, None] <= room, axis=1)
    return link, certain


def certain_links(x: Array, spectra: Complex) -> tuple[Index, Flags]:
    """Return the successors of eigenvalues over ascending values, shape (m − 1, r), and which intervals are certain.

    They are so by themselves, as `follow` says, or because the eigenvalues move `together`.
    """
    links, clear = follow(spectra[:-1], spectra[1:])
    open_ = ~clear & ~np.isnan(spectra[:-1]).any(axis=1) & ~np.isnan(spectra[1:]).any(axis=1)
    # With the intervals beside them, which tell whether each moves on.
    near = open_.copy()
    near[1:] |= open_[:-1]
    near[:-1] |= open_[1:]
    near &= ~np.isnan(spectra[:-1]).any(axis=1) & ~np.isnan(spectra[1:]).any(axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], near, [False]])))
    for a, b in edges.reshape(-1, 2).tolist():
        link, certain = together(spectra[a : b + 1], np.diff(x[a : b + 1]))
        links[a:b] = np.where(open_[a:b, None], link, links[a:b])
        clear[a:b] |= open_[a:b] & certain
    return links, clear


def _gaps(values: Complex) -> npt.NDArray[np.float64]:
    """Return the distances within spectra, shape (m, r, r), with an infinite diagonal."""
    gap: npt.NDArray[np.float64] = np.abs(values[:, :, None] - values[:, None, :])
    each = np.arange(values.shape[1])
    gap[:, each, each] = np.inf
    return gap


def _followed(before: Complex, after: Complex, twins: Flags | None) -> tuple[Index, Flags]:
    nothing = np.any(np.isnan(before), axis=1) | np.any(np.isnan(after), axis=1)
    if nothing.any():
        ranks = np.broadcast_to(np.arange(before.shape[1]) + 0j, before.shape)
        before, after = (np.where(nothing[:, None], ranks, x) for x in (before, after))
    moved = np.abs(before[:, :, None] - after[:, None, :])
    link = np.argmin(moved, axis=2)
    distance = np.take_along_axis(moved, link[:, :, None], axis=2)[:, :, 0]
    unique = np.all(np.sort(link, axis=1) == np.arange(before.shape[1]), axis=1)
    size = np.max(np.abs(before), axis=1)[:, None]
    gaps = _gaps(before), _gaps(np.take_along_axis(after, link, axis=1))
    # Eigenvalues that are the same on both sides are one multiple eigenvalue.
    same = (gaps[0] < TOLERANCES.twin_distance * size[:, :, None]) & (
        gaps[1] < TOLERANCES.twin_distance * size[:, :, None]
    )
    if twins is not None:
        same &= twins[:, None, None]
    gap = np.min(np.where(same, np.inf, np.minimum(*gaps)), axis=2)
    clear = np.all(distance <= TOLERANCES.tracking_step * gap, axis=1) & (unique | np.any(same, axis=(1, 2)))
    if np.any(same & clear[:, None, None]):
        _untwin(link, moved, clear & ~unique)
    return link, clear


def continuous(links: Index, clear: Flags) -> Index:
    """Return the order of each spectrum, shape (m, r), in which columns are continuous according to `follow`.

    Where links are uncertain, the order does not change.

    Parameters
    ----------
    links : ndarray of int, shape (m − 1, r)
    clear : ndarray of bool, shape (m − 1,)
    """
    m, r = len(links) + 1, links.shape[1]
    identity = np.arange(r)
    if r < 2 or m < 2 or np.all(links == identity):
        return np.broadcast_to(identity, (m, r))
    # About √m parts of about √m points: all parts are followed at once, then joined.
    length = int(np.sqrt(m)) + 1
    order = np.broadcast_to(identity, (-(-m // length) * length, r)).copy()
    order[1:m] = np.where(clear[:, None], links, identity)
    parts = order.reshape(-1, length, r)
    for i in range(1, length):
        parts[:, i] = np.take_along_axis(parts[:, i], parts[:, i - 1], axis=1)
    for one, other in pairwise(parts):
        other[:] = other[:, one[-1]]
    return order[:m]


def doubtful(clear: Flags, x: Array) -> Flags:
    """Return in which intervals between values x nearest successors may be wrong although they are clear, (m − 1,).

    Where two eigenvalues pass each other in the middle of an interval, each is then where the other was. In the
    intervals beside it they move too far to be clear, unless these are short; so an interval between such ones has
    nothing that confirms it.
    """
    length, confirmed = np.diff(x), np.zeros_like(clear)
    confirmed[1:] |= clear[:-1] & (length[:-1] >= TOLERANCES.tracking_step * length[1:])
    confirmed[:-1] |= clear[1:] & (length[1:] >= TOLERANCES.tracking_step * length[:-1])
    return clear & ~confirmed


def turning(before: Complex, now: Complex, after: Complex) -> Flags:
    """Return whether real parts come close to zero and turn back, for spectra in continuous columns, shape (m, r)."""
    rising, falling = now.real - before.real, now.real - after.real
    # Equal values at two points have the turn between them.
    top = (rising * falling >= 0.0) & (np.sign(now.real) == -np.sign(rising + falling)) & (now.real != 0.0)
    near = np.abs(now.real) < 2.0 * np.maximum(np.abs(rising), np.abs(falling))
    found: Flags = top & near
    return found


def _untwin(link: Index, moved: npt.NDArray[np.float64], doubtful: Flags) -> None:
    """Give each of several equal eigenvalues a successor of its own; others have one that is clearly nearest."""
    rows = np.flatnonzero(doubtful)
    left = moved[rows]
    for i in range(left.shape[1]):
        nearest = np.argmin(left[:, i], axis=1)
        link[rows, i] = nearest
        left[np.arange(len(rows)), :, nearest] = np.inf
