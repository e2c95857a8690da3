"""Assembly of the results of elements into the vectors and matrices of a scene, at one point or many."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from functools import cached_property, lru_cache
from itertools import accumulate
from typing import TYPE_CHECKING, Any

import numpy as np

from mbstab.model.arithmetic import FLOAT, Arithmetic, array_arithmetic

if TYPE_CHECKING:
    import numpy.typing as npt

    from mbstab.model.jets import Jet

Index = np.ndarray[tuple[Any, ...], np.dtype[np.intp]]

OF_ROWS = ("E", "V", "B", "J", "D", "V_q", "A_q", "A_u")
"""Outputs of kernels whose first index is a row, not a coordinate."""


class Plan:
    """Which returned value is added to which entry of each matrix.

    Parameters
    ----------
    shapes : dict
        Of the matrices, by their keys.
    places : dict
        The numbers of the values and those of the entries (counted row by row) that they are added to, by key.
    """

    def __init__(self, shapes: dict[str, tuple[int, ...]], places: dict[str, tuple[Index, Index]]) -> None:
        self.shapes, self.places = shapes, places
        self.sizes = {key: math.prod(shape) for key, shape in shapes.items()}
        starts = dict(zip(shapes, accumulate(self.sizes.values(), initial=0), strict=False))
        # All matrices one behind the other.
        self._take = np.concatenate([places[key][0] for key in shapes])
        self._target = np.concatenate([places[key][1] + starts[key] for key in shapes])
        # Most entries stay zero: sums are formed of those that are used.
        self._used = {key: np.unique(target, return_inverse=True) for key, (_, target) in places.items()}
        # Lists are read one by one faster than arrays.
        self._pairs = {key: (take.tolist(), self._used[key][1].tolist()) for key, (take, _) in places.items()}
        self._parts = {key: slice(start, start + self.sizes[key]) for key, start in starts.items()}

    def matrices(self, values: list[Any]) -> dict[str, Any] | None:
        """Return the matrices at one point, or None if an entry of theirs is no finite float."""
        if are_plain(values):
            weights = np.array(values, dtype=float)[self._take]
            flat = _summed(self._target, weights, sum(self.sizes.values()))
            if not np.isfinite(flat).all():
                return None
            return {key: flat[part].reshape(self.shapes[key]) for key, part in self._parts.items()}
        out = {key: self._matrix(key, values) for key in self.shapes}
        finite = all(matrix.dtype == object or np.isfinite(matrix).all() for matrix in out.values())
        return out if finite else None

    def _matrix(self, key: str, values: list[Any]) -> Any:
        """Return a matrix; of floats, if all that is added to it is plain."""
        take, target = self.places[key]
        size, shape = self.sizes[key], self.shapes[key]
        chosen = [values[i] for i in take]
        if are_plain(chosen):
            return _summed(target, np.array(chosen, dtype=float), size).reshape(shape)
        dense = np.full(size, 0, dtype=object)
        for place, value in zip(target, chosen, strict=True):
            dense[place] = dense[place] + value
        return dense.reshape(shape)

    def at_points(self, values: list[Any], points: int) -> dict[str, Any]:
        """Return a matrix for each point of a sweep, or one with a first axis of length 1 if it is the same for all."""
        return {key: self._stack(key, values, points) for key in self.shapes}

    def _stack(self, key: str, values: list[Any], points: int) -> Any:
        take, slots = self._pairs[key]
        chosen = [values[i] for i in take]
        if are_plain(chosen):
            return self._matrix(key, values)[None]
        sums = np.zeros((len(self._used[key][0]), points))
        for value, slot in zip(chosen, slots, strict=True):
            sums[slot] += value
        return self._spread(key, sums)

    def _spread(self, key: str, sums: Any) -> Any:
        """Return the matrices whose entries that are used are rows over the points."""
        result = np.zeros((sums.shape[1], self.sizes[key]))
        result[:, self._used[key][0]] = sums.T
        return result.reshape(-1, *self.shapes[key])

    def filled(self, numbers: Any, varies: Any, places: dict[str, tuple[Index, Index]]) -> dict[str, Any]:
        """Return the same from the values as rows over the points, which of them vary, and the places of both."""
        found = {}
        for key, (take, target) in places.items():
            if not varies[take].any():
                found[key] = _summed(target, numbers[take, 0], self.sizes[key]).reshape(1, *self.shapes[key])
                continue
            used, slots = self._used[key]
            sums = np.zeros((len(used), numbers.shape[1]))
            for layer in self._layers[key]:
                sums[slots[layer]] += numbers[take[layer]]
            found[key] = self._spread(key, sums)
        return found

    @cached_property
    def _layers(self) -> dict[str, list[Index]]:
        """Numbers of the additions to different entries: the first one to each of them, the second one, and so on."""
        return {key: _in_layers(target) for key, (_, target) in self.places.items()}


def _summed(target: Index, weights: npt.NDArray[np.float64], size: int) -> npt.NDArray[np.float64]:
    """Return the sums of the weights of each entry; `numpy.bincount` returns integers where there are none."""
    return np.bincount(target, weights=weights, minlength=size).astype(float, copy=False)


def _in_layers(target: Index) -> list[Index]:
    order = np.argsort(target, kind="stable")
    begins = np.searchsorted(target[order], target[order])
    turn = np.empty_like(target)
    turn[order] = np.arange(len(target)) - begins
    return [np.flatnonzero(turn == k) for k in range(int(np.max(turn, initial=-1)) + 1)]


def are_plain(values: list[Any]) -> bool:
    """Whether all values are Python numbers."""
    return all(issubclass(kind, (int, float)) for kind in set(map(type, values)))


@lru_cache(maxsize=64)
def plan_of(
    function: str,
    shapes: tuple[tuple[str, tuple[int, ...]], ...],
    elements: tuple[tuple[Any, tuple[int, ...], tuple[int, ...]], ...],
    n_q: int,
    n_c: int,
) -> Plan:
    """Return the plan of elements given by their kernels, columns and rows; the scenes of a model share it."""
    take: dict[str, list[int]] = {key: [] for key, _ in shapes}
    target: dict[str, list[int]] = {key: [] for key, _ in shapes}
    position = 0
    for kernel, columns, rows in elements:
        for key, entries in getattr(kernel, function.upper()).items():
            for index in entries:
                of_rows = key in OF_ROWS
                place = (rows if of_rows else columns)[index[0]]
                inside = place < (n_c if of_rows else n_q)
                if len(index) == 2:
                    column = columns[index[1]]
                    inside = inside and column < n_q
                    place = place * n_q + column
                if inside:
                    take[key].append(position)
                    target[key].append(place)
                position += 1
    places = {key: (np.array(take[key], dtype=np.intp), np.array(target[key], dtype=np.intp)) for key in take}
    return Plan(dict(shapes), places)


def by_entry(kernel: Any, function: str, values: Iterable[Any]) -> Iterator[tuple[str, Any, Any]]:
    """Yield the results of a function of a kernel, each with its name and its index."""
    entries = ((key, index) for key, own in getattr(kernel, function.upper()).items() for index in own)
    return ((key, index, value) for (key, index), value in zip(entries, values, strict=True))


class Time:
    """The time itself as a given function, for expressions that contain t."""

    @staticmethod
    def at(time: Any) -> Jet:
        """Return the time with its derivatives."""
        from mbstab.model.jets import Jet

        return Jet(time, 1, 0)


def signals_at(laws: tuple[Any, ...], time: Any) -> list[Any]:
    """Return all values, then all rates, then all second derivatives."""
    jets = [law.at(time) for law in laws]
    return [jet.value for jet in jets] + [jet.rate for jet in jets] + [jet.second for jet in jets]


def arithmetic_of(arguments: list[Any]) -> Arithmetic:
    """Return the number system of an element: plain floats where nothing varies over the points of a sweep."""
    varies = any(isinstance(x, np.ndarray) for group in arguments for x in group)
    return array_arithmetic() if varies else FLOAT


def listed(x: Any) -> list[Any]:
    """Return the numbers of a vector; over the points of a sweep, those that are the same for all as floats."""
    # Python floats are several times faster than array elements in a kernel.
    if isinstance(x, np.ndarray) and x.ndim == 2:
        rows, varies = rows_of(x)
        return [row if v else row[0].item() for row, v in zip(rows, varies.tolist(), strict=True)]
    return x.tolist() if isinstance(x, np.ndarray) and x.dtype != object and x.ndim == 1 else list(x)


def rows_of(x: Any, fixed: int = 0) -> tuple[Any, Any]:
    """Return a vector at points as one row for each number, with some fixed ones appended, and which of them vary."""
    rows = np.zeros((x.shape[1] + fixed, len(x)))
    rows[: x.shape[1]] = x.T
    first = rows[:, :1]
    return rows, ~(np.isfinite(first[:, 0]) & (rows == first).all(axis=1))


def padded(x: Any, zero: Any) -> list[Any]:
    """Return a vector as a list with one fixed coordinate, or the multiplier of no row, appended."""
    return [*listed(x), zero]
