"""Goals of a design: their values at many points together, and the inequalities that bound them to first order.

A margin is the smallest of the decay rates, or of the damping ratios, of all eigenvalues at all places of a box. A
range ends where a first real part becomes positive. Both are smallest or largest values of smooth functions, one for
each eigenvalue and place: near a point x each gives a linear inequality. Of equal eigenvalues it is that of their mean.
Where two eigenvalues λ± = m ± √d meet, their derivatives grow without bound, but m and d are smooth: on the side
Re √d = 0 the inequality is that of m (Burke, Lewis and Overton 2006, on the spectral abscissa, which is not Lipschitz
there). Where eigenvalues cross, what each becomes depends on the direction: inequalities at points nearby, of the
matrix that moves to first order, bound all of them (its generalized gradient; Burke, Lewis and Overton 2005, SIAM J.
Optim. 15, who sample gradients).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Protocol

import numpy as np

from mbstab.analysis.algebra.arrays import Complex, Index
from mbstab.analysis.design.moving import Moving
from mbstab.analysis.design.plant import Local, Plant
from mbstab.analysis.design.rows import Rows
from mbstab.analysis.design.tolerances import TOLERANCES
from mbstab.compiler.system import Array
from mbstab.records import dataclass

Ends = tuple[float, float]
Variant = Callable[[float], Array | None]
"""A point to be tried within a reach, if there is one."""


@dataclass(frozen=True)
class Active:
    """An eigenvalue that limits a goal.

    Attributes
    ----------
    value : complex
        With Im >= 0 (1/s).
    place : dict
        Where, in SI: values of the parameters of the box, or the end of the range.
    meets : bool
        Whether it nearly meets another one there.
    """

    value: complex
    place: dict[str, float]
    meets: bool


class Goal(Protocol):
    """What is to become large.

    Attributes
    ----------
    limits : ndarray, shape (k, 2)
        Bounds of the unknowns of the inequalities.
    rounding : float
        Values that differ by less are equal.
    scattered : int
        Number of points over all ranges that are tried where no model leads on.
    """

    limits: Array
    rounding: float
    scattered: int

    def values(self, x: Array) -> Array:
        """Return its values at points of the unit cube, shape (points,); -inf where there is none."""

    def model(self, x: Array) -> tuple[Rows, list[Variant]]:
        """Return the inequalities of all eigenvalues near a point, and what is to be tried besides."""


class Cube:
    """Parameters that vary between two ends, as a unit cube."""

    def __init__(self, vary: Mapping[str, Ends]) -> None:
        self.names = tuple(vary)
        ends = np.array(list(vary.values()))
        self.low, self.size = ends[:, 0], ends[:, 1] - ends[:, 0]

    def at(self, x: Array) -> dict[str, float]:
        """Return the values of the parameters at a point."""
        return dict(zip(self.names, (self.low + self.size * x).tolist(), strict=True))

    def points(self, x: Array, others: Mapping[str, Array]) -> dict[str, Array]:
        """Return values at points, each with all values of other parameters; these of shape (points, k) or (k,)."""
        k = next(iter(others.values())).shape[-1] if others else 1
        found = {name: np.repeat(self.low[i] + self.size[i] * x[:, i], k) for i, name in enumerate(self.names)}
        return found | {name: np.broadcast_to(v, (len(x), k)).ravel() for name, v in others.items()}

    def of(self, values: Mapping[str, float]) -> Array:
        """Return the point of the cube next to values."""
        given = np.array([values[name] for name in self.names])
        return np.asarray(np.clip((given - self.low) / self.size, 0.0, 1.0))


def measure(kind: str, s: Complex) -> Array:
    """Return decay rates (1/s), or damping ratios."""
    return -s.real if kind == "decay" else -s.real / np.maximum(np.abs(s), 1e-300)


def measure_slope(kind: str, s: complex, slopes: Complex) -> Array:
    """Return the derivatives of a measure."""
    if kind == "decay":
        return -slopes.real
    size = abs(s) or 1e-300
    return np.asarray(-slopes.real / size + s.real * (s.conjugate() * slopes).real / size**3)


def _known_to(kind: str, local: Local) -> float:
    """Return the error of the measure that is smallest, if it is that of a simple eigenvalue."""
    if not len(local.values):
        return 0.0
    i = int(np.argmin(measure(kind, local.values)))
    if local.is_multiple(i):
        return 0.0  # where eigenvalues meet, their bounds say little about how they move
    return float(local.errors[i] / (1.0 if kind == "decay" else max(abs(local.values[i]), 1e-300)))


class Margin:
    """The smallest decay rate or damping ratio over a box of other parameters."""

    limits = np.array([[-np.inf, np.inf]])

    def __init__(self, plant: Plant, cube: Cube, kind: str, over: Mapping[str, Ends]) -> None:
        self.plant, self.cube, self.kind = plant, cube, kind
        self.rounding = max(
            TOLERANCES.rounding * (plant.size if kind == "decay" else 1.0), _known_to(kind, plant.start)
        )
        self.box, self.sides = Cube(over) if over else None, len(over)
        self.scattered = TOLERANCES.scattered_in_boxes if over else TOLERANCES.scattered
        few = self.sides <= len(TOLERANCES.grid)
        self.count = TOLERANCES.grid[self.sides - 1] if few else TOLERANCES.grid_of_many
        self.checked = TOLERANCES.grid_checked[self.sides - 1] if few else TOLERANCES.grid_of_many
        self.finer = TOLERANCES.finer[self.sides - 1] if few else 2

    def values(self, x: Array) -> Array:
        """Return the worst margins at points of the unit cube."""
        if self.box is None:
            return self._at(x, None)[:, 0]
        worst, found = self._coarse(x, self.count)
        lowest = np.min(found, axis=1)[:, None]
        return np.asarray(np.min(self._refined(x, worst[:, None], lowest, self.count)[1], axis=1))

    def _at(self, x: Array, box: Array | None) -> Array:
        """Return the margins at points, shape (points, k), for places in the box, shape (points, k, sides)."""
        others = {} if box is None or self.box is None else self.box_values(box)
        values = self.plant.values(self.cube.points(x, others))
        margins = np.min(measure(self.kind, values), axis=1, initial=np.inf)
        return np.where(np.isnan(margins), -np.inf, margins).reshape(len(x), -1)

    def box_values(self, box: Array) -> dict[str, Array]:
        """Return values of the parameters of the box at its places, shape (..., sides)."""
        assert self.box is not None
        return {name: self.box.low[i] + self.box.size[i] * box[..., i] for i, name in enumerate(self.box.names)}

    def _grid(self, count: int) -> Array:
        """Return the places of a grid over the unit box, shape (places, sides)."""
        axes = np.meshgrid(*[np.linspace(0.0, 1.0, count)] * self.sides, indexing="ij")
        return np.stack([axis.ravel() for axis in axes], axis=1)

    def _coarse(self, x: Array, count: int) -> tuple[Array, Array]:
        """Return the worst place of a grid for each point, and the margins at all of them."""
        grid = self._grid(count)
        found = self._at(x, np.broadcast_to(grid, (len(x), *grid.shape)))
        return grid[np.argmin(found, axis=1)], found

    def _refined(
        self, x: Array, places: Array, margins: Array, count: int, rounds: int = TOLERANCES.finer_rounds
    ) -> tuple[Array, Array]:
        """Return places that are worse than given ones of a grid, shape (points, k, sides), and their margins."""
        width = 1.0 / (count - 1)
        cell = 2.0 * self._grid(self.finer) - 1.0
        k = places.shape[1]
        for _ in range(rounds):
            near = np.clip(places[:, :, None, :] + width * cell, 0.0, 1.0)
            found = self._at(x, near.reshape(len(x), -1, self.sides)).reshape(len(x), k, -1)
            best = np.argmin(found, axis=2)
            better = np.take_along_axis(near, best[:, :, None, None], axis=2)[:, :, 0]
            lower = np.min(found, axis=2)
            places = np.where((lower < margins)[:, :, None], better, places)
            margins = np.minimum(lower, margins)
            width *= 2.0 / (self.finer - 1)
        return places, margins

    def worst(self, x: Array) -> tuple[float, dict[str, float]]:
        """Return the margin at a point as the result is checked, on a fine grid, and where in the box it is reached."""
        if self.box is None:
            return float(self.values(x[None])[0]), {}
        count, rounds = self.checked, TOLERANCES.checked_rounds
        (margin, place), *_ = self._minima(x, count, rounds)
        return min(margin, float(self.values(x[None])[0])), self.box.at(place)

    def places(self, x: Array) -> list[dict[str, float]]:
        """Return where in the box the margin has its smallest minima, the smallest first."""
        if self.box is None:
            return [{}]
        return [self.box.at(place) for _, place in self._minima(x, self.count, TOLERANCES.finer_rounds)]

    def _minima(self, x: Array, count: int, rounds: int) -> list[tuple[float, Array]]:
        """Return the smallest minima of the margin over the box and their places, the smallest first."""
        _, found = self._coarse(x[None], count)
        grid, step = self._grid(count), 1.5 / (count - 1)
        chosen: list[int] = []
        for i in np.argsort(found[0], kind="stable").tolist():
            near = np.max(np.abs(grid - grid[i]), axis=1) <= step
            if found[0, i] <= np.min(found[0, near]) and not any(near[j] for j in chosen):
                chosen.append(i)
            if len(chosen) == TOLERANCES.places:
                break
        places, margins = self._refined(x[None], grid[chosen][None], found[:, chosen], count, rounds)
        return [(float(margins[0, i]), places[0, i]) for i in np.argsort(margins[0], kind="stable")]

    def _locals(self, x: Array, worst: dict[str, float] | None = None) -> Iterator[tuple[dict[str, float], Local]]:
        """Yield the eigenvalues at the worst places; a place that is known to be the worst stands for those near it."""
        places = self.places(x)
        if worst is not None and self.box is not None:
            near, at = 1.5 / (self.count - 1), self.box.of(worst)
            places = [worst, *(place for place in places if np.max(np.abs(self.box.of(place) - at)) > near)]
        for place in places:
            local = self.plant.known(self.cube.at(x) | place, self.cube.names)
            if local is not None:
                yield place, local

    def model(self, x: Array) -> tuple[Rows, list[Variant]]:
        """Return the inequalities near a point, and what is tried besides: smooth sides of meetings, and crossings."""
        found = [local.moving for _, local in self._locals(x) if local.moving is not None]
        plain = self._rows(found, x)
        if plain is None:
            return Rows(np.zeros((0, len(x))), np.zeros((0, 1)), np.zeros(0), np.zeros(0)), []

        def smooth(part: float) -> Variant:
            def point(reach: float) -> Array | None:
                shift = part * reach**2
                rows = [r for moving in found for group in moving.upper for r in self._apart(moving, group, x, shift)]
                return Rows.joined(rows).best(x, reach, self.limits)

            return point

        return plain, [smooth(0.0), smooth(1.0), lambda reach: self._crossing(found, plain, x, reach)]

    def _rows(self, found: Sequence[Moving], x: Array) -> Rows | None:
        """Return the inequalities of all eigenvalues, those of equal ones together."""
        rows = [self._below(*moving.sums(group)[:2], x) for moving in found for group in moving.upper]
        return Rows.joined(rows) if rows else None

    def _crossing(self, found: Sequence[Moving], plain: Rows, x: Array, reach: float) -> Array | None:
        """Return the best point for matrices that move to first order, by cutting planes (Kelley 1960, J. SIAM 8)."""
        rows, best, most = [plain], None, -np.inf
        for _ in range(TOLERANCES.cutting_planes):
            point = Rows.joined(rows).best(x, reach, self.limits)
            if point is None:
                break
            moved = [moving.at((point - x) * self.cube.size) for moving in found]
            value = min(float(np.min(measure(self.kind, moving.values))) for moving in moved)
            if value > most:
                best, most = point, value
            more = self._rows(moved, point)
            rows += [] if more is None else [more]
        return best

    def _below(self, s: complex, slopes: Complex, x: Array) -> Rows:
        """Return that a margin t is at most that of a number s that moves."""
        slope = measure_slope(self.kind, s, slopes) * self.cube.size
        return Rows.of(-slope, np.ones(1), measure(self.kind, np.array([s])), x)

    def _apart(self, moving: Moving, group: Sequence[int], x: Array, shift: float) -> list[Rows]:
        """Return the inequalities of an eigenvalue: those of some that may meet on the side where they do not."""
        near = moving.nearest(group)
        mean, slopes, square, along = moving.sums(near)
        found = [self._below(mean, slopes, x)]
        if len(near) == 1:
            return found
        size = float(np.max(np.abs(moving.values[near]))) or 1.0
        square, along = square / size**2, along * self.cube.size / size**2
        rows = [(1.0, square.real, along.real, shift)]
        if abs(mean.imag) > TOLERANCES.on_a_line * size:  # neither real, nor a pair
            rows = [(sign, square.imag, along.imag, 0.0) for sign in (1.0, -1.0)]
            rows += [(1.0, square.real, along.real, 0.0)]
            rows += [(-1.0, square.real, along.real, 0.0)] if self.kind == "damping" else []
        for sign, value, slope, room in rows:
            own = Rows.of(sign * slope, np.zeros(1), np.array([-sign * value - room]), x)
            found.append(Rows(own.A, own.B, own.b, np.ones(1)))
        return found

    def active(self, x: Array, at: dict[str, float]) -> list[Active]:
        """Return the eigenvalues with the smallest margins, given the place that `worst` has found."""
        found = []
        for place, local in self._locals(x, at):
            margins = measure(self.kind, local.values)
            sizes = np.abs(local.values) if self.kind == "decay" else np.ones(len(margins))
            found += [(float(margins[i]), float(sizes[i]), local, i, place) for i in range(len(margins))]
        worst = min((x[0] for x in found), default=0.0)
        scale = max((x[1] for x in found if x[0] == worst), default=0.0)
        limit = worst + TOLERANCES.active * abs(worst) + TOLERANCES.rounding * scale
        # Those that meet part like a root: next to the optimum they are apart by more.
        apart = worst + TOLERANCES.active * scale
        return [
            Active(complex(local.values[i]), place, meets)
            for margin, _, local, i, place in found
            if local.values[i].imag >= 0.0
            and (
                margin <= (apart if (meets := _meets(local, i)) else limit)
                or (self.kind == "damping" and _slow(local, i))
            )
        ]


def _meets(local: Local, i: int) -> bool:
    """Return whether an eigenvalue nearly meets another one."""
    if len(local.values) < 2:
        return False
    s, other = local.values[i], local.values[local.partner(i)]
    return bool(abs(s - other) <= TOLERANCES.meets * max(abs(s), abs(other)))


def _slow(local: Local, i: int) -> bool:
    """Return whether an eigenvalue nearly reaches the axis, although its damping ratio may be 1."""
    return bool(local.values[i].real >= -TOLERANCES.active * np.max(np.abs(local.values)))


class Range:
    """The width of the widest range of a parameter in which no eigenvalue lies right of the imaginary axis."""

    def __init__(self, plant: Plant, cube: Cube, parameter: str, window: Ends) -> None:
        self.plant, self.cube, self.parameter, self.window = plant, cube, parameter, window
        self.rounding = TOLERANCES.rounding * (window[1] - window[0])
        self.limits = np.array([window, (-window[1], -window[0])])
        self.scattered = TOLERANCES.scattered_in_boxes

    def values(self, x: Array) -> Array:
        """Return the widths at points of the unit cube; -inf where no value in the window is stable."""
        low, high = self.ends(x)
        return np.where(np.isnan(low), -np.inf, high - low)

    def _growth(self, x: Array, v: Array) -> Array:
        """Return the largest real parts, shape (points, k), at values of the parameter of shape (points, k) or (k,)."""
        values = self.plant.values(self.cube.points(x, {self.parameter: v}))
        growth = np.max(values.real, axis=1, initial=-np.inf)
        return np.where(np.isnan(growth), np.inf, growth).reshape(len(x), -1)

    def ends(self, x: Array, points: int = TOLERANCES.range_points) -> tuple[Array, Array]:
        """Return the ends of the widest ranges, nan where there are none."""
        low, high, _, _ = self._ranges(x, points)
        return low, high

    def _ranges(self, x: Array, points: int = TOLERANCES.range_points) -> tuple[Array, Array, Array, Array]:
        """Return the ends of the widest ranges, the values at which they are looked for, and the growth there."""
        # At the ends themselves a motion may have more symmetries, such as one at rest.
        first, last = self.window
        inside = TOLERANCES.window_inside * (last - first)
        v = np.linspace(first + inside, last - inside, points)
        growth = self._growth(x, v)
        runs = [_longest(row) for row in growth <= 0.0]
        known = np.array([run is not None for run in runs])
        rows = np.arange(len(x))[:, None]
        stable = np.array([run or (0, 0) for run in runs])
        other = np.clip(stable + np.array([-1, 1]), 0, points - 1)
        ends = self._located(x, (v[stable], v[other]), (growth[rows, stable], growth[rows, other]))
        ends = np.where(stable == [0, points - 1], self.window, ends)
        return np.where(known, ends[:, 0], np.nan), np.where(known, ends[:, 1], np.nan), v, growth

    def _located(self, x: Array, places: tuple[Array, Array], growth: tuple[Array, Array]) -> Array:
        """Return the last stable values between stable ones and others, shape (points, 2)."""
        (a, b), (fa, fb) = places, growth
        kept = np.zeros(a.shape)
        for _ in range(TOLERANCES.range_rounds):
            # Where one side has no eigenvalues, bisection.
            part = _secant(fa, fb)
            middle = a + np.where(np.isnan(part), 0.5, part) * (b - a)
            f = self._growth(x, middle)
            inside = f <= 0.0
            # The end that stays twice counts half (Illinois rule; Dowell and Jarratt 1971, BIT 11).
            fa = np.where(inside, f, np.where(kept < 0.0, 0.5 * fa, fa))
            fb = np.where(inside, np.where(kept > 0.0, 0.5 * fb, fb), f)
            a, b = np.where(inside, middle, a), np.where(inside, b, middle)
            kept = np.where(inside, 1.0, -1.0)
            if np.all(np.abs(b - a) <= TOLERANCES.range_known * np.abs(a)):
                break
        return a + np.nan_to_num(_secant(fa, fb)) * (b - a)

    def _places(self, x: Array) -> tuple[list[tuple[float, int]], list[float]]:
        """Return where eigenvalues are looked at, and the ends of the range; nothing where no value is stable.

        Places are next to the low end (0), to the high one (1), or inside (2).
        """
        lows, highs, v, found = self._ranges(x[None])
        low, high, growth = float(lows[0]), float(highs[0]), found[0]
        if np.isnan(low):
            return [], []
        step = min(TOLERANCES.inside * (self.window[1] - self.window[0]), 0.25 * (high - low))
        inside = [i for i in range(1, len(v) - 1) if low < v[i - 1] and v[i + 1] < high]
        least = -TOLERANCES.peak * max((-growth[i] for i in inside), default=0.0)
        beside = {i: (growth[i - 1], growth[i + 1]) for i in inside}
        peaks = [i for i in inside if growth[i] >= max(*beside[i], least) and growth[i] > min(beside[i])]
        return [(low + step, 0), (high - step, 1), *((float(v[i]), 2) for i in peaks)], [low, high]

    def model(self, x: Array) -> tuple[Rows, list[Variant]]:
        """Return the inequalities near a point: no eigenvalue has a positive real part in the range."""
        names, found = (*self.cube.names, self.parameter), []
        for v, side in self._places(x)[0]:
            local = self.plant.known(self.cube.at(x) | {self.parameter: v}, names)
            if local is None or local.moving is None:
                continue
            for group in local.moving.upper:
                mean, moved = local.moving.sums(group)[:2]
                slopes, growth = moved.real, mean.real
                B = slopes[-1] * np.array([[0.0, -1.0], [1.0, 0.0], [0.0, 0.0]][side])
                b = np.array([-growth + (slopes[-1] * v if side < 2 else 0.0)])
                found.append(Rows.of(slopes[:-1] * self.cube.size, B, b, x))
        if not found:
            return Rows(np.zeros((0, len(x))), np.zeros((0, 2)), np.zeros(0), np.zeros(0)), []
        return Rows.joined(found), []

    def active(self, x: Array) -> list[Active]:
        """Return the eigenvalues that reach the axis at the ends of the range, or inside."""
        places, ends = self._places(x)
        if not places:
            return []
        v = np.array([ends[side] if side < 2 else v for v, side in places])
        values = self.plant.values(self.cube.points(x[None], {self.parameter: v}))
        found = []
        for row, at in zip(values, v.tolist(), strict=True):
            s, size = complex(row[np.argmax(row.real)]), float(np.max(np.abs(row)))
            if s.real >= -TOLERANCES.active * size:
                gaps = np.sort(np.abs(row - s))
                meets = len(row) > 1 and bool(gaps[1] <= TOLERANCES.meets * abs(s))
                found.append(Active(complex(s.real, abs(s.imag)), {self.parameter: at}, meets))
        return found


def _secant(fa: Array, fb: Array) -> Array:
    """Return the fraction of the way from a to b at which a linear function is zero; nan where it is not between."""
    with np.errstate(invalid="ignore", divide="ignore"):
        part = fa / (fa - fb)
        return np.where((part > 0.0) & (part < 1.0), part, np.nan)


def _longest(row: Index) -> tuple[int, int] | None:
    """Return the first and the last number of the longest run of true entries; None if there is none."""
    padded = np.concatenate([[False], row, [False]]).astype(np.int8)
    starts, stops = np.flatnonzero(np.diff(padded) == 1), np.flatnonzero(np.diff(padded) == -1)
    if not len(starts):
        return None
    k = int(np.argmax(stops - starts))
    return int(starts[k]), int(stops[k]) - 1
