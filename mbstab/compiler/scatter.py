"""Assembly of the results of elements into the vectors and matrices of a scene, at one point or many."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from mbstab.model.arithmetic import FLOAT, Arithmetic, array_arithmetic
from mbstab.model.jets import Jet

OF_ROWS = ("E", "V", "B", "J", "D", "V_q", "A_q", "A_u")
"""Outputs of kernels whose first index is a row, not a coordinate."""


@lru_cache(maxsize=64)
def plan_of(
    function: str, keys: tuple[str, ...], elements: tuple[tuple[Any, tuple[int, ...], tuple[int, ...]], ...], n_q: int
) -> dict[str, tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]]:
    """Return the plan of elements given by their kernels, columns and rows; the scenes of a model share it."""
    take: dict[str, list[int]] = {key: [] for key in keys}
    target: dict[str, list[int]] = {key: [] for key in keys}
    position = 0
    for kernel, columns, rows in elements:
        for key, entries in getattr(kernel, function.upper()).items():
            for index in entries:
                of_rows = key in OF_ROWS
                place = (rows if of_rows else columns)[index[0]]
                inside = of_rows or place < n_q
                if len(index) == 2:
                    column = columns[index[1]]
                    inside = inside and column < n_q
                    place = place * n_q + column
                if inside:
                    take[key].append(position)
                    target[key].append(place)
                position += 1
    return {key: (np.array(take[key], dtype=np.intp), np.array(target[key], dtype=np.intp)) for key in keys}


class Time:
    """The time itself as a given function, for expressions that contain t."""

    @staticmethod
    def at(time: Any) -> Jet:
        """Return the time with its derivatives."""
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
        return [column if np.ptp(column) else float(column[0]) for column in np.ascontiguousarray(x.T)]
    return x.tolist() if isinstance(x, np.ndarray) and x.dtype != object and x.ndim == 1 else list(x)


def padded(x: Any, zero: Any) -> list[Any]:
    """Return a vector as a list with one fixed coordinate appended."""
    return [*listed(x), zero]


def scatter_points(values: Sequence[Any], take: Any, target: Any, shape: tuple[int, ...], points: int) -> Any:
    """Return a matrix for each point of a sweep, or one with a first axis of length 1 if it is the same for all."""
    size = int(np.prod(shape))
    if all(isinstance(values[i], (int, float)) for i in take):
        return scatter(values, take, target, shape)[None]
    dense = np.zeros((size, points))
    for i, place in zip(take, target, strict=True):
        dense[place] += values[i]
    return np.ascontiguousarray(dense.T).reshape(points, *shape)


def scatter(values: Sequence[Any], take: Any, target: Any, shape: tuple[int, ...]) -> Any:
    """Return a matrix in which the values `take` are added to the entries `target`."""
    size = int(np.prod(shape))
    chosen = [values[i] for i in take]
    if not chosen:
        return np.zeros(shape)
    if all(isinstance(value, (int, float)) for value in chosen):
        return np.bincount(target, weights=np.array(chosen, dtype=float), minlength=size).reshape(shape)
    dense = np.full(size, 0, dtype=object)
    for place, value in zip(target, chosen, strict=True):
        dense[place] = dense[place] + value
    return dense.reshape(shape)
