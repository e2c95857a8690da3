"""Curves between the points of a chart on which the number of unstable eigenvalues changes.

On every edge between two neighbours that differ the change is located by bisection, all edges at once, and the points
found are joined through the cells of the grid to curves. Where a curve bends sharply, where regions meet, and where
an edge passes through a third region, the grid gets more lines, and so on until its cells are small.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import compress

import numpy as np
import numpy.typing as npt

from mbstab.analysis.algebra.arrays import Flags, Index
from mbstab.analysis.reference.paths import Sheet
from mbstab.analysis.sweep.batched_spectra import Evaluator
from mbstab.analysis.sweep.blocks import Block
from mbstab.analysis.sweep.spectra import Spectra, settled
from mbstab.analysis.sweep.tolerances import TOLERANCES
from mbstab.analysis.sweep.tracking import discriminant, symmetric_product
from mbstab.analysis.verdict.rule import RIGHT
from mbstab.compiler.system import Array
from mbstab.records import dataclass

Counts = npt.NDArray[np.intp]

Edge = tuple[int, int, int]
"""Its axis (0: along x), row and column."""

Place = tuple[float, float, float, float]
"""Both ends of an edge."""


@dataclass(frozen=True)
class Grid:
    """Numbers of unstable eigenvalues over two parameters.

    Attributes
    ----------
    x, y : ndarray
        Values of the parameters (SI), ascending.
    unstable : ndarray of int, shape (len(y), len(x))
        Number of unstable eigenvalues, −1 where the verdict is open or there is no answer …
    settled : ndarray of int, shape (len(y), len(x))
        … or −1 only where more eigenvalues are undecided than at all points, and −2 where there is no answer …
    oscillating : ndarray of int, shape (len(y), len(x))
        … and how many of them are complex.
    """

    x: Array
    y: Array
    unstable: Counts
    settled: Counts
    oscillating: Counts


def counts(found: Spectra | Block, unplaced: int) -> tuple[Counts, Counts, Counts]:
    """Return the three numbers of a `Grid` for each of some points."""
    complex_right = np.sum((found.sides == RIGHT) & (found.values.imag != 0.0), axis=1)
    return (
        found.unstable,
        settled(found.sides, found.words, unplaced),
        np.minimum(complex_right, np.maximum(found.unstable, 0)),
    )


def traced(
    evaluator: Evaluator, names: tuple[str, str], grid: Grid, count: int, unplaced: int
) -> tuple[Grid, list[Array], list[Array]]:
    """Return a grid with more lines where they are needed, and the curves on which its numbers change.

    The last are curves between equally many unstable eigenvalues, of which not equally many oscillate.

    Parameters
    ----------
    evaluator : Evaluator
    names : tuple of str
        The parameters along x and y.
    grid : Grid
    count : int
        Number of eigenvalues of a point.
    unplaced : int
        Number of eigenvalues that are undecided at all points.
    """
    known: dict[Place, tuple[Array, bool]] = {}
    while True:
        told = replace(grid, settled=_beside_boundaries(grid.settled))
        edges = _followed(evaluator, names, grid, _changes(told.settled))
        places = {edge: _place(grid, edge) for edge in edges}
        new = [edge for edge in edges if places[edge] not in known]
        found = _located(evaluator, names, new, told, count, unplaced)
        known |= dict(zip((places[edge] for edge in new), found, strict=True))
        points = {edge: known[places[edge]][0] for edge in edges}
        neighbours = _neighbours(points, *grid.unstable.shape)
        crossed = [edge for edge in edges if known[places[edge]][1]]
        x, y = _finer(evaluator, grid, points, neighbours, crossed)
        if len(x) == len(grid.x) and len(y) == len(grid.y):
            divided = _divided(evaluator, names, grid, count, unplaced)
            return grid, _curves(points, neighbours), divided
        grid = _filled(evaluator, names, grid, (x, y), count, unplaced)


# --- points on edges ------------------------------------------------------------------------------------------------


def _beside_boundaries(numbers: Counts) -> Counts:
    """Return the numbers with that of a neighbour at open points whose neighbours differ: boundaries run through them.

    Of neighbours on opposite sides, along rows, columns and diagonals.
    """
    result, around = numbers.copy(), np.pad(numbers, 1, constant_values=-2)
    for i, j in ((0, 1), (1, 0), (1, 1), (1, -1)):
        one, other = (
            around[1 + s * i : around.shape[0] - 1 + s * i, 1 + s * j : around.shape[1] - 1 + s * j] for s in (-1, 1)
        )
        inside = (result == -1) & (one >= 0) & (other >= 0) & (one != other)
        result = np.where(inside, one, result)
    return result


def _changes(numbers: Counts) -> list[Edge]:
    """Return the edges whose ends differ."""
    sides = [(numbers[:, :-1], numbers[:, 1:]), (numbers[:-1], numbers[1:])]
    return [
        (axis, i, j)
        for axis, (left, right) in enumerate(sides)
        for i, j in np.argwhere((left != right) & (left >= 0) & (right >= 0)).tolist()
    ]


def _followed(evaluator: Evaluator, names: tuple[str, str], grid: Grid, edges: list[Edge]) -> list[Edge]:
    """Return the edges along which equilibria are known; between those that no path joins nothing is followed."""
    if evaluator.path is None or not edges:
        return edges
    ends = np.array([_place(grid, edge) for edge in edges])
    x, y = (0.5 * (ends[:, :2] + ends[:, 2:])).T
    return list(compress(edges, evaluator.path.covers({names[0]: x, names[1]: y})))


def changing(grid: Grid) -> list[Edge]:
    """Return the edges of a grid between whose ends a boundary or a line between divergence and flutter passes."""
    return list(dict.fromkeys([*_changes(_beside_boundaries(grid.settled)), *_changes(_divisions(grid))]))


def untold(evaluator: Evaluator, names: tuple[str, str], grid: Grid) -> list[Edge]:
    """Return the edges between whose ends the number changes at a place that is not followed."""
    edges = _changes(grid.settled)
    return sorted(set(edges) - set(_followed(evaluator, names, grid, edges)))


def _place(grid: Grid, edge: Edge) -> Place:
    """Return both ends of an edge."""
    axis, i, j = edge
    return float(grid.x[j]), float(grid.y[i]), float(grid.x[j + (axis == 0)]), float(grid.y[i + (axis == 1)])


def _located(
    evaluator: Evaluator, names: tuple[str, str], edges: Sequence[Edge], grid: Grid, count: int, unplaced: int
) -> list[tuple[Array, bool]]:
    """Return where the number changes on each edge, and whether the edge passes through a third region."""
    if not edges:
        return []
    ends = np.array([_place(grid, edge) for edge in edges])
    a, b = ends[:, :2], ends[:, 2:]
    first = np.array([grid.settled[i, j] for _, i, j in edges])
    last = np.array([grid.settled[i + (axis == 1), j + (axis == 0)] for axis, i, j in edges])
    kind = _signatures(evaluator.near({names[0]: a[:, 0], names[1]: a[:, 1]}, count), unplaced)

    def told(found: Spectra, of: Index) -> tuple[Flags, Flags]:
        numbers = settled(found.sides, found.words, unplaced)
        # Near the boundary, where bounds do not decide, the functions that vanish on it do.
        hidden = np.flatnonzero(numbers < 0)
        same = numbers == first[of]
        same[hidden] = np.all(_signatures(found, unplaced, hidden) == kind[of[hidden]], axis=1)
        return same, (numbers >= 0) & (numbers != first[of]) & (numbers != last[of])

    points, crossed = _bisected(evaluator, names, (a, b), count, told)
    return list(zip(points, crossed.tolist(), strict=True))


def _bisected(
    evaluator: Evaluator,
    names: tuple[str, str],
    ends: tuple[Array, Array],
    count: int,
    told: Callable[[Spectra, Index], tuple[Flags, Flags]],
) -> tuple[Array, Flags]:
    """Return points between ends by bisection, and whether something was met on the way, each of shape (edges, …).

    Several steps are computed at once, with all points to which they may lead: a call takes longer than few points.

    Parameters
    ----------
    evaluator, names, count
        As in `traced`.
    ends : tuple of ndarray, shape (edges, 2)
    told : callable
        Returns of points, with the numbers of their edges, which are like the first end, and at which that is met.
    """
    a, b = ends
    edges, low, met = np.arange(len(a)), np.zeros(len(a)), np.zeros(len(a), dtype=bool)
    steps = next(k for k in TOLERANCES.halvings_together if len(a) << k <= TOLERANCES.edge_points or k == 1)
    parts = 1 << steps
    for done in range(0, TOLERANCES.edge_halvings, steps):
        size = 0.5 ** (done + steps)
        inside = low[:, None] + size * np.arange(1, parts)
        at = (a[:, None] + inside[..., None] * (b - a)[:, None]).reshape(-1, 2)
        found = evaluator.near({names[0]: at[:, 0], names[1]: at[:, 1]}, count)
        same, meets = (x.reshape(inside.shape) for x in told(found, np.repeat(edges, parts - 1)))
        place = np.zeros(len(a), dtype=np.intp)
        for k in reversed(range(steps)):
            middle = place + (1 << k)
            met |= meets[edges, middle - 1]
            place = np.where(same[edges, middle - 1], middle, place)
        low = low + size * place
    return a + (low + 0.5 ** (TOLERANCES.edge_halvings + 1))[:, None] * (b - a), met


def _divisions(grid: Grid) -> Counts:
    """Return numbers that differ where the number of unstable eigenvalues or of those that oscillate does."""
    numbers: Counts = (np.max(grid.oscillating, initial=0) + 1) * grid.settled + grid.oscillating
    return np.where(grid.settled > 0, numbers, -1)


def _divided(evaluator: Evaluator, names: tuple[str, str], grid: Grid, count: int, unplaced: int) -> list[Array]:
    """Return the curves between divergence and flutter where the number of unstable eigenvalues is the same."""
    edges = [
        (axis, i, j)
        for axis, i, j in _followed(evaluator, names, grid, _changes(_divisions(grid)))
        if grid.settled[i, j] == grid.settled[i + (axis == 1), j + (axis == 0)]
    ]
    if not edges:
        return []
    ends = np.array([_place(grid, edge) for edge in edges])
    a, b = ends[:, :2], ends[:, 2:]
    first = np.array([grid.oscillating[i, j] for _, i, j in edges])

    def told(found: Spectra, of: Index) -> tuple[Flags, Flags]:
        same = counts(found, unplaced)[2] == first[of]
        return same, ~same

    points = dict(zip(edges, _bisected(evaluator, names, (a, b), count, told)[0], strict=True))
    return _curves(points, _neighbours(points, *grid.settled.shape))


def _signatures(found: Spectra, unplaced: int, index: npt.NDArray[np.intp] | None = None) -> npt.NDArray[np.intp]:
    """Return two numbers for each of some points, at least one of which changes at a boundary.

    The number of eigenvalues with computed real parts right of the axis; where the spectrum is symmetric about
    it, the signs of the product of the eigenvalues and of the discriminant of λ², apart from unexplained zeros.
    """
    index = np.arange(len(found.values)) if index is None else index
    result = np.stack([np.sum(found.values[index].real > 0.0, axis=1), np.zeros(len(index), dtype=int)], axis=1)
    for n, i in enumerate(index.tolist()):
        values = found.values[i]
        if found.mirrored[i] and not np.any(np.isnan(values)):
            size = float(np.max(np.abs(values), initial=1e-300))
            tests = symmetric_product(values, size, unplaced), discriminant(values, unplaced)
            result[n] = np.sign(tests)
    return result


# --- more lines -----------------------------------------------------------------------------------------------------


def _finer(
    evaluator: Evaluator,
    grid: Grid,
    points: dict[Edge, Array],
    neighbours: dict[Edge, list[Edge]],
    crossed: Sequence[Edge],
) -> tuple[Array, Array]:
    """Return the values of both parameters, with more between neighbours where the grid does not resolve boundaries.

    Parameters
    ----------
    evaluator : Evaluator
    grid : Grid
    points : dict
        Where boundaries cross edges.
    neighbours : dict
        How they are joined.
    crossed : sequence of Edge
        Those that pass through a third region.
    """
    divided = np.zeros(len(grid.x) - 1, dtype=bool), np.zeros(len(grid.y) - 1, dtype=bool)
    for axis, i, j in crossed:
        divided[axis][j if axis == 0 else i] = True
    size = np.array([np.ptp(grid.x), np.ptp(grid.y)])
    for edge in points:
        if _bends(edge, points, neighbours[edge], size):
            for other in neighbours[edge]:
                for part, values, u, v in zip(divided, (grid.x, grid.y), points[edge], points[other], strict=True):
                    part[np.clip(np.searchsorted(values, 0.5 * (u + v)) - 1, 0, len(part) - 1)] = True
    if isinstance(evaluator.path, Sheet):  # its rows are paths
        divided[1][:] = False
    return _with_more(grid.x, divided[0]), _with_more(grid.y, divided[1])


def _bends(edge: Edge, points: dict[Edge, Array], beside: Sequence[Edge], size: Array) -> bool:
    """Return whether a boundary turns sharply in a point, or divides there."""
    if len(beside) < 2:
        return False
    ways = np.array([(points[other] - points[edge]) / size for other in beside])
    if not np.all(np.any(np.abs(ways) > TOLERANCES.same_place, axis=1)):
        return False  # it runs through a point of the grid, which is on it
    one, other = ways[0], -ways[1]
    cosine = float(one @ other) / max(float(np.hypot(*one) * np.hypot(*other)), 1e-300)
    return len(beside) > 2 or cosine < TOLERANCES.boundary_turn


def _with_more(values: Array, divided: Flags) -> Array:
    """Return values with more of them in the intervals to be divided, unless these are short."""
    wide = np.diff(values) * TOLERANCES.boundary_cells > np.ptp(values)
    parts = np.arange(1, TOLERANCES.boundary_parts) / TOLERANCES.boundary_parts
    new = [values[k] + parts * (values[k + 1] - values[k]) for k in np.flatnonzero(divided & wide).tolist()]
    return np.sort(np.concatenate([values, *new]))


def _filled(
    evaluator: Evaluator, names: tuple[str, str], grid: Grid, axes: tuple[Array, Array], count: int, unplaced: int
) -> Grid:
    """Return a grid with more lines, whose new points are computed."""
    x, y = axes
    old = np.ix_(np.isin(y, grid.y), np.isin(x, grid.x))
    new = np.ones((len(y), len(x)), dtype=bool)
    new[old] = False
    rows, columns = np.nonzero(new)
    found = evaluator.near({names[0]: x[columns], names[1]: y[rows]}, count, exact=True)
    whole = []
    for before, numbers in zip((grid.unstable, grid.settled, grid.oscillating), counts(found, unplaced), strict=True):
        filled = np.empty(new.shape, dtype=np.intp)
        filled[old], filled[new] = before, numbers
        whole.append(filled)
    whole[1][rows[list(found.problems)], columns[list(found.problems)]] = -2
    return replace(grid, x=x, y=y, unstable=whole[0], settled=whole[1], oscillating=whole[2])


# --- curves ---------------------------------------------------------------------------------------------------------


def _neighbours(points: dict[Edge, Array], n_y: int, n_x: int) -> dict[Edge, list[Edge]]:
    """Return how points on the edges of a grid are joined: those of one cell are neighbours."""
    neighbours: dict[Edge, list[Edge]] = {edge: [] for edge in points}
    for i in range(n_y - 1):
        for j in range(n_x - 1):
            around = [e for e in ((0, i, j), (1, i, j + 1), (0, i + 1, j), (1, i, j)) if e in points]
            pairs = [around[:2], around[2:]] if len(around) == 4 else [around] if len(around) == 2 else []
            if len(around) == 3:
                # Three regions meet: every point is joined to the one nearest to all others.
                middle = min(around, key=lambda e: sum(float(np.sum((points[e] - points[o]) ** 2)) for o in around))
                pairs = [[middle, e] for e in around if e != middle]
            for one, other in pairs:
                neighbours[one].append(other)
                neighbours[other].append(one)
    return neighbours


def _curves(points: dict[Edge, Array], neighbours: dict[Edge, list[Edge]]) -> list[Array]:
    """Return the curves through points that are joined."""
    curves = []
    left = {frozenset((one, other)) for one, others in neighbours.items() for other in others}
    for start in sorted(points, key=lambda e: len(neighbours[e])):
        curve = [start]
        while following := [e for e in neighbours[curve[-1]] if frozenset((curve[-1], e)) in left]:
            left.remove(frozenset((curve[-1], following[0])))
            curve.append(following[0])
        if len(curve) > 1 or not neighbours[start]:
            curves.append(np.array([points[e] for e in curve]))
    return curves
