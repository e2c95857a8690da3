"""Large scenes: the elements of one kernel evaluated together, with arrays, and their numbers put into sparse matrices.

The arithmetic is that of sweeps, with the elements of a kernel in place of the points. Which number
belongs to which stored entry is worked out once for each function of the kernels.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any, Literal, Protocol

import numpy as np
import numpy.typing as npt

from mbstab.compiler.scatter import OF_ROWS, arithmetic_of, signals_at
from mbstab.records import dataclass

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.intp]

Form = Callable[[Array, Index, Index, tuple[int, int]], Any]
"""Makes a matrix of its entries row by row, their columns, where rows begin, and its shape (compressed sparse rows)."""

What = Literal["sum", "sizes", "lost"]
"""What is asked of the numbers of all elements: their sum, that of sizes, or what rounding has lost in the sum."""

FEW = 4
"""Up to so many elements are faster one by one."""


class Element(Protocol):
    """An element at its place."""

    @property
    def kernel(self) -> Any: ...  # noqa: D102
    @property
    def columns(self) -> tuple[int, ...]: ...  # noqa: D102
    @property
    def rows(self) -> tuple[int, ...]: ...  # noqa: D102
    @property
    def parameters(self) -> tuple[Any, ...]: ...  # noqa: D102
    @property
    def laws(self) -> tuple[Any, ...]: ...  # noqa: D102
    @property
    def takes_acceleration(self) -> bool: ...  # noqa: D102


@dataclass(frozen=True)
class State:
    """Where elements are evaluated: q, u, a with one fixed coordinate behind them, multipliers, time.

    What a function of the kernels does not take is None.
    """

    q: Array
    u: Array
    a: Array | None
    nu: Array | None
    time: Any


class Group:
    """Elements of one kernel.

    Attributes
    ----------
    columns, rows : ndarray, shape (columns or rows of one, elements)
    """

    def __init__(self, elements: Sequence[Element]) -> None:
        self.kernel, self.laws = elements[0].kernel, elements[0].laws
        self.takes_acceleration, self.count = elements[0].takes_acceleration, len(elements)
        self.columns = np.array([e.columns for e in elements], dtype=np.intp).T
        self.rows = np.array([e.rows for e in elements], dtype=np.intp).reshape(self.count, -1).T
        self.parameters = tuple(map(_together, zip(*(e.parameters for e in elements), strict=True)))

    def values(self, function: str, at: State) -> Array:
        """Return what the kernel returns, shape (outputs, elements)."""
        places = at.q[self.columns], at.u[self.columns]
        arguments: list[Any] = [*map(self._each, places), self.parameters]
        arguments.append(signals_at(self.laws, at.time) if self.laws else ())
        if at.a is not None and (function == "linearize_rows" or self.takes_acceleration):
            arguments.append(self._each(at.a[self.columns]))
        elif at.nu is not None and len(self.rows):
            arguments.append(self._each(at.nu[self.rows]))
        found = getattr(self.kernel, function)(arithmetic_of(arguments), *arguments)
        result = np.empty((len(found), self.count))
        for row, value in zip(result, found, strict=True):
            row[:] = value
        return result

    def _each(self, x: Array) -> list[Any]:
        return list(x) if self.count > 1 else x[:, 0].tolist()


def _together(values: tuple[Any, ...]) -> Any:
    """Return numbers as an array, as one number if they are all the same."""
    return values[0] if all(x == values[0] for x in values) else np.array(values, dtype=float)


def grouped(elements: Sequence[Element]) -> list[Group]:
    """Return elements in groups of one kernel; by themselves where functions of time act or there are few."""
    found: dict[Any, list[Element]] = {}
    for element in elements:
        found.setdefault(id(element) if element.laws else (id(element.kernel), element.takes_acceleration), []).append(
            element
        )
    parts = [[group] if len(group) > FEW else [[e] for e in group] for group in found.values()]
    return [Group(part) for several in parts for part in several]


@dataclass(frozen=True)
class Pattern:
    """Which of the numbers of all groups are added to which entry of a vector or of a sparse matrix."""

    take: Index
    slot: Index
    indices: Index
    starts: Index
    shape: tuple[int, ...]

    def filled(self, numbers: Array, form: Form) -> Any:
        """Return the vector or the matrix."""
        size = self.shape[0] if len(self.shape) == 1 else len(self.indices)
        data: Array = np.bincount(self.slot, weights=numbers[self.take], minlength=size).astype(float)
        if len(self.shape) == 1:
            return data
        return form(data, self.indices, self.starts, (self.shape[0], self.shape[1]))

    def lost(self, numbers: Array, form: Form) -> Any:
        """Return what rounding has lost in each sum of the matrix, where the machine has longer numbers."""
        order = np.argsort(self.slot, kind="stable")
        begins = np.searchsorted(self.slot[order], np.arange(len(self.indices)))
        terms = numbers[self.take][order]
        exact = np.add.reduceat(terms.astype(np.longdouble), begins) if len(terms) else np.zeros(0)
        rounded = self.filled(numbers, lambda data, *_: data)
        return form((exact - rounded).astype(float), self.indices, self.starts, (self.shape[0], self.shape[1]))


class Assembly:
    """The sparse matrices of a scene.

    Parameters
    ----------
    elements : sequence of Element
    n_q : int
    form : callable
        See `Form`.
    """

    def __init__(self, elements: Sequence[Element], n_q: int, form: Form) -> None:
        self.elements, self.n_q, self.form = elements, n_q, form
        self._patterns: dict[str, dict[str, Pattern]] = {}

    @cached_property
    def _groups(self) -> list[Group]:
        return grouped(self.elements)

    def outputs(
        self, function: str, at: State, shapes: dict[str, tuple[int, ...]], what: What
    ) -> dict[str, Any] | None:
        """Return vectors and matrices by name, or what `What` says of the matrices; None if one is not finite."""
        running = [g for g in self._groups if len(g.rows) or function != "linearize_rows"]
        try:
            with np.errstate(all="ignore"):
                parts = [g.values(function, at).ravel() for g in running]
        except (ArithmeticError, ValueError):
            return None
        numbers = np.concatenate([np.zeros(0), *parts])
        if not np.isfinite(numbers).all():
            return None
        if function not in self._patterns:
            self._patterns[function] = {
                key: _pattern(function, key, running, self.n_q, shape) for key, shape in shapes.items()
            }
        patterns = self._patterns[function]
        if what == "lost":
            return {key: p.lost(numbers, self.form) for key, p in patterns.items() if len(p.shape) == 2}
        numbers = np.abs(numbers) if what == "sizes" else numbers
        return {key: pattern.filled(numbers, self.form) for key, pattern in patterns.items()}


def _pattern(function: str, key: str, groups: list[Group], n_q: int, shape: tuple[int, ...]) -> Pattern:
    """Return the pattern of one output."""
    none: Index = np.zeros(0, dtype=np.intp)
    take, place = [none], [none]
    start = 0
    for g in groups:
        position = 0
        for name, entries in getattr(g.kernel, function.upper()).items():
            for index in entries:
                if name == key:
                    at = (g.rows if key in OF_ROWS else g.columns)[index[0]]
                    inside = np.ones(g.count, dtype=bool) if key in OF_ROWS else at < n_q
                    if len(index) == 2:
                        column = g.columns[index[1]]
                        inside, at = inside & (column < n_q), at * n_q + column
                    take.append((start + position * g.count + np.arange(g.count))[inside])
                    place.append(at[inside])
                position += 1
        start += position * g.count
    taken, target = np.concatenate(take), np.concatenate(place)
    if len(shape) == 1:
        return Pattern(taken, target, np.zeros(0, dtype=np.intp), np.zeros(0, dtype=np.intp), shape)
    entries, slot = np.unique(target, return_inverse=True)
    starts = np.searchsorted(entries, np.arange(shape[0] + 1) * n_q)
    return Pattern(taken, slot, entries % max(n_q, 1), starts, shape)
