"""Discs of `mbstab.analysis.bounds.location` beside eigenvalues with many digits."""

import numpy as np
from mpmath import mp

from mbstab.analysis.algebra.matching import assigned
from mbstab.analysis.bounds.location import enclosures
from mbstab.analysis.spectrum.precise import precise_eigenvalues
from mbstab.analysis.verdict.facts import Grounds

DIGITS = 30


def placed(mechanism, structure=True):
    """Return discs, and the eigenvalues that symmetries and conserved functions explain, which have none."""
    grounds = Grounds(mechanism.linearize())
    S = grounds.S
    if not structure:
        nothing = np.zeros((len(S), 0))
        return enclosures(grounds.linear, grounds.space, grounds.gamma, S, nothing, nothing.T), []
    T, L = grounds.separated.T, grounds.separated.L
    neutral = [*np.linalg.eigvals(T.T @ S @ T), *np.zeros(len(L))] if T.shape[1] else list(np.zeros(len(L)))
    return enclosures(grounds.linear, grounds.space, grounds.gamma, S, T, L), neutral


def exact(mechanism, digits=DIGITS):
    """Return all finite eigenvalues, zeros and pairs of symmetries among them."""
    return listed(precise_eigenvalues(mechanism.model, digits))


def listed(precise):
    """Return the eigenvalues of a precise result, zeros and pairs of symmetries among them."""
    values = [mp.mpmathify(e.value) for e in precise.eigenvalues]
    values += [mp.mpc(0, sign * mp.mpf(x)) for x in precise.shifts for sign in (1, -1)]
    return values + [mp.mpf(0)] * (precise.neutral - 2 * len(precise.shifts))


def without(true, neutral):
    """Return eigenvalues without those that belong to neutral ones."""
    true = list(true)
    for s in neutral:
        true.remove(min(true, key=lambda x: abs(complex(x) - complex(s))))
    return true


def compared(found, true):
    """Return for each disc error / radius, radius relative to the eigenvalue, and error relative to it.

    The true eigenvalues are given to discs so that the largest error in radii is least, nearly; the error of a disc
    is how far the farthest of its own is from its centre.
    """
    if len(true) != len(found.values):
        return [(np.inf, np.inf, np.inf)]
    seats = [d for d in found.discs for _ in d.members]
    with mp.workdps(60):
        off = np.array([[float(mp.fabs(mp.mpc(d.centre) - s)) for s in true] for d in seats])
    radii = np.array([d.radius for d in seats])
    known = np.isfinite(radii)
    cost = np.where(known[:, None], off / np.where(known & (radii > 0), radii, 1e-300)[:, None], 1e-3)
    columns = assigned(np.minimum(cost, 1e12) ** 0.5)
    rows, at = [], 0
    for disc in found.discs:
        part = range(at, at + len(disc.members))
        at += len(disc.members)
        size = max(abs(complex(true[columns[i]])) for i in part)
        error = max(off[i, columns[i]] for i in part)
        if not np.isfinite(disc.radius):
            rows.append((0.0, np.inf, error / size if size else 0.0))
            continue
        ratio = error / disc.radius if disc.radius > 0 else (0.0 if error == 0 else np.inf)
        rows.append((ratio, disc.radius / size if size else 0.0, error / size if size else 0.0))
    return rows
