"""Random paths through avoided crossings: straight lines, s = 0 … 1, between two mechanisms that differ in numbers.

Paths of chains pass avoided crossings by themselves, the sharper the less their links couple. Those of bicycles hardly
ever do: their real eigenvalues rather collide. There a path is shifted until they only just do not.
"""

import re
from itertools import combinations
from pathlib import Path

import numpy as np
from chains import hanging_chain
from scipy.optimize import linear_sum_assignment

import mbstab
from mbstab.analysis.sweep.batched_spectra import Evaluator

NEARER = 3.0
"""Branches that avoid each other are by this factor nearer to each other there than at the ends of the path."""

SEEN = 41
"""Points at which a path is looked at to find out whether eigenvalues collide on it."""

NUMBER = re.compile(r"-?\d+\.\d+(?:e[+-]?\d+)?")
BICYCLE = (Path(__file__).parents[1] / "models" / "whipple_bicycle.yaml").read_text(encoding="utf-8")
RANGES = {
    "w": (0.8, 1.3), "c": (-0.1, 0.2), "tilt": (0.1, 0.6), "g": (7.0, 12.0), "v": (0.0, 4.0), "r_R": (0.25, 0.4),
    "r_F": (0.25, 0.4), "x_B": (0.1, 0.6), "z_B": (0.5, 1.2), "x_H": (0.7, 1.0), "z_H": (0.5, 0.9),
}  # fmt: skip


def between(one, other):
    """Return the text of all mechanisms between two, given by texts that are the same but for decimal numbers."""
    ends = iter(NUMBER.findall(other))

    def line(found):
        a, b = found[0], next(ends)
        return a if a == b else f"({a} + s*({b} - ({a})))"

    return NUMBER.sub(line, one).replace("parameters:\n", "parameters:\n  s: 0\n", 1)


def chain_path(rng, damping=None):
    """Return the text of a path between two random chains whose links become lighter from top to bottom."""
    links, lightest = int(rng.integers(2, 7)), rng.uniform(-5.0, -1.0)
    damping = float(rng.choice([0.0, 0.05])) if damping is None else damping
    masses = [np.sort(10.0 ** rng.uniform(lightest, 0.0, links))[::-1].tolist() for _ in range(2)]
    return between(*(hanging_chain(rng, links, m, damping, stiffness=float(damping > 0.0)) for m in masses))


def bicycle_paths(rng, tries):
    """Return the texts of paths between two random bicycles on which real eigenvalues nearly collide."""
    low, high = np.array(list(RANGES.values())).T
    ends = rng.uniform(low, high, (tries, 2, len(RANGES)))
    shift = rng.uniform(-0.5, 0.5, (tries, 1, len(RANGES))) * (high - low)
    evaluator = Evaluator(mbstab.loads(BICYCLE).model)
    free = [_are_free(_spectra(evaluator, ends + x * shift)) for x in (0.0, 1.0)]
    some = free[0] != free[1]
    ends, shift, apart = ends[some], shift[some], np.where(free[0][some], 0.0, 1.0)[:, None, None]
    collide, rounds = 1.0 - apart, rng.integers(2, 7, len(ends))
    for k in range(max(rounds)):
        on = np.flatnonzero(rounds > k)
        middle = 0.5 * (apart[on] + collide[on])
        is_free = _are_free(_spectra(evaluator, ends[on] + middle * shift[on]))
        apart[on[is_free]], collide[on[~is_free]] = middle[is_free], middle[~is_free]
    ends += apart * shift
    found = []
    for pair, spectra in zip(ends, _spectra(evaluator, ends), strict=True):
        gaps = np.diff([np.sort(row[row.imag == 0.0].real) for row in spectra], axis=1)
        if np.any(NEARER * np.min(gaps, axis=0, initial=np.inf) < np.minimum(gaps[0], gaps[-1])):
            found.append(between(*(_bicycle(values.tolist()) for values in pair)))
    return found


def _bicycle(values):
    text = BICYCLE[: BICYCLE.index("\nsweep:")]
    for name, value in zip(RANGES, values, strict=True):
        text = re.sub(rf"^  {name}: {{value: [^,]*", f"  {name}: {{value: {value:.17f}", text, flags=re.MULTILINE)
    return text


def _spectra(evaluator, ends):
    """Return the eigenvalues along paths, shape (paths, points, 4)."""
    part = np.linspace(0.0, 1.0, SEEN)[:, None]
    points = (1.0 - part) * ends[:, :1] + part * ends[:, 1:]
    columns = points.reshape(-1, len(RANGES)).T.copy()
    return evaluator.spectra(dict(zip(RANGES, columns, strict=True))).values.reshape(*points.shape[:2], -1)


def _are_free(spectra):
    """Return on which paths no real eigenvalues collide."""
    real = np.sum(spectra.imag == 0.0, axis=2)
    return np.all(real == real[:, :1], axis=1)


def avoided(branches):
    """Return where branches of a kind, both real or both above the real axis, avoid each other: their numbers, the row.

    Equal ones are not told from those that cross.
    """
    size = np.max(np.abs(branches))
    found = []
    for i, j in combinations(range(branches.shape[1]), 2):
        one, other = branches[:, i], branches[:, j]
        alike = (one.imag > 0.0) & (other.imag > 0.0) | (one.imag == 0.0) & (other.imag == 0.0)
        gap = np.abs(one - other)
        k = int(np.argmin(gap))
        if alike.all() and 1e-9 * size < gap[k] and NEARER * gap[k] < min(gap[0], gap[-1]):
            found.append((i, j, k))
    return found


def swaps(coarse, fine):
    """Return how many rows of branches have columns in another order than the same rows of a finer sweep."""
    order = linear_sum_assignment(np.abs(coarse[0][:, None] - fine[0][None, :]))[1]
    count = 0
    for row, other in zip(coarse, fine[:, order], strict=True):
        distance = np.abs(row[:, None] - other[None, :])
        # Next to a collision rounding is large, in any order.
        least = np.max(distance[linear_sum_assignment(distance)])
        count += bool(np.max(np.diagonal(distance)) > max(10.0 * least, 1e-7 * np.max(np.abs(row))))
    return count
