"""Large scenes: the elements of one kernel evaluated together, as arrays, and assembled into sparse matrices.

The arithmetic is that of sweeps, with the elements of a kernel in place of the points. Which number
belongs to which stored entry is determined once for each function of the kernels.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any, Literal, Protocol

import numpy as np
import numpy.typing as npt

from mbstab.compiler.scatter import OF_ROWS, arithmetic_of, signals_at
from mbstab.model.arithmetic import Arithmetic
from mbstab.records import dataclass

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.intp]

Form = Callable[[Array, Index, Index, tuple[int, int]], Any]
"""Makes a matrix from its entries row by row, their columns, the starts of rows, and its shape (CSR)."""

What = Literal["sum", "sizes", "lost"]
"""What is computed from the numbers of all elements: their sum, the sum of sizes, or the rounding error of the sum."""

FEW = 4
"""Up to this number, elements are faster one by one."""


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
    """The state at which elements are evaluated: q, u, a with one fixed coordinate appended, multipliers, time.

    Arguments that a function of the kernels does not take are None.
    """

    q: Any
    u: Any
    a: Any
    nu: Any
    time: Any


class Numbers:
    """The type of the numbers of a scene: here floats."""

    def state(self, x: Any) -> Any:
        """Return a vector with one fixed coordinate appended."""
        return np.append(x, 0.0)

    def taken(self, x: Any, places: Index) -> list[Any]:
        """Return what the places of the elements hold, shape (places of one, elements): arrays, or plain numbers."""
        found = x[places]
        return list(found) if places.shape[1] > 1 else found[:, 0].tolist()

    def together(self, values: tuple[Any, ...]) -> Any:
        """Return the same number of all elements, or all of them."""
        return values[0] if all(x == values[0] for x in values) else np.array(values, dtype=float)

    def arithmetic(self, arguments: list[Any]) -> Arithmetic:
        """Return the number system in which elements are evaluated."""
        return arithmetic_of(arguments)

    def stacked(self, found: Any, count: int) -> Any:
        """Return the results of a kernel, shape (layers, outputs, elements)."""
        result = np.empty((1, len(found), count))
        for row, value in zip(result[0], found, strict=True):
            row[:] = value
        return result

    def filled(self, pattern: Pattern, layers: list[Array], form: Form) -> Any:
        """Return a vector or a matrix assembled from the results of the elements, layer by layer."""
        return pattern.filled(layers[0], form)


FLOATS = Numbers()


class Group:
    """Elements of one kernel.

    Attributes
    ----------
    columns, rows : ndarray, shape (columns or rows of one, elements)
    """

    def __init__(self, elements: Sequence[Element], numbers: Numbers) -> None:
        self.numbers = numbers
        self.kernel, self.laws = elements[0].kernel, elements[0].laws
        self.takes_acceleration, self.count = elements[0].takes_acceleration, len(elements)
        self.columns = np.array([e.columns for e in elements], dtype=np.intp).T
        self.rows = np.array([e.rows for e in elements], dtype=np.intp).reshape(self.count, -1).T
        self.parameters = tuple(map(numbers.together, zip(*(e.parameters for e in elements), strict=True)))

    def values(self, function: str, at: State) -> Any:
        """Return the results of the kernel as the numbers stack them: of floats, shape (layers, outputs, elements)."""
        taken = self.numbers.taken
        arguments: list[Any] = [taken(at.q, self.columns), taken(at.u, self.columns), self.parameters]
        arguments.append(signals_at(self.laws, at.time) if self.laws else ())
        if at.a is not None and (function == "linearize_rows" or self.takes_acceleration):
            arguments.append(taken(at.a, self.columns))
        elif at.nu is not None and len(self.rows):
            arguments.append(taken(at.nu, self.rows))
        found = getattr(self.kernel, function)(self.numbers.arithmetic(arguments), *arguments)
        return self.numbers.stacked(found, self.count)


def grouped(elements: Sequence[Element], numbers: Numbers = FLOATS) -> list[Group]:
    """Return elements in groups of one kernel each; one by one where functions of time act or there are few."""
    found: dict[Any, list[Element]] = {}
    for element in elements:
        found.setdefault(id(element) if element.laws else (id(element.kernel), element.takes_acceleration), []).append(
            element
        )
    parts = [[group] if len(group) > FEW else [[e] for e in group] for group in found.values()]
    return [Group(part, numbers) for several in parts for part in several]


@dataclass(frozen=True)
class Pattern:
    """Which of the numbers of all groups are added to which entry of a vector or of a sparse matrix."""

    take: Index
    slot: Index
    indices: Index
    starts: Index
    shape: tuple[int, ...]

    @cached_property
    def further(self) -> Array:
        """For each number, the number of others that are added to it."""
        result: Array = (np.bincount(self.slot)[self.slot] - 1).astype(float)
        return result

    def filled(self, numbers: Array, form: Form, weighted: bool = False) -> Any:
        """Return the vector or the matrix; `weighted` by the number of others that are added."""
        size = self.shape[0] if len(self.shape) == 1 else len(self.indices)
        weights = numbers[self.take] * self.further if weighted else numbers[self.take]
        data: Array = np.bincount(self.slot, weights=weights, minlength=size).astype(float)
        if len(self.shape) == 1:
            return data
        return form(data, self.indices, self.starts, (self.shape[0], self.shape[1]))

    def lost(self, numbers: Array, form: Form) -> Any:
        """Return the rounding error of each sum of the matrix: exact sums, however far apart its terms are."""
        order = np.argsort(self.slot, kind="stable")
        begins = np.searchsorted(self.slot[order], np.arange(len(self.indices) + 1))
        terms, rounded = numbers[self.take][order].tolist(), self.filled(numbers, lambda data, *_: data)
        lost, ends = np.zeros(len(rounded)), begins.tolist()
        for i in np.flatnonzero(np.diff(begins) > 1).tolist():
            lost[i] = math.fsum([*terms[ends[i] : ends[i + 1]], -rounded[i]])
        return form(lost, self.indices, self.starts, (self.shape[0], self.shape[1]))


class Assembly:
    """The sparse matrices of a scene.

    Parameters
    ----------
    elements : sequence of Element
    n_q : int
    form : callable
        See `Form`.
    numbers : Numbers
    """

    def __init__(self, elements: Sequence[Element], n_q: int, form: Form, numbers: Numbers = FLOATS) -> None:
        self.elements, self.n_q, self.form, self.numbers = elements, n_q, form, numbers
        self._patterns: dict[str, dict[str, Pattern]] = {}

    @cached_property
    def _groups(self) -> list[Group]:
        return grouped(self.elements, self.numbers)

    def of(self, elements: Sequence[Element]) -> Assembly:
        """Return the same for other elements."""
        return Assembly(elements, self.n_q, self.form, self.numbers)

    def renumbered(self, elements: Sequence[Element], numbers: Numbers | None) -> Assembly:
        """Return the same for elements that differ in their numbers only."""
        other = Assembly(elements, self.n_q, self.form, numbers or self.numbers)
        other._patterns = self._patterns
        return other

    def outputs(
        self, function: str, at: tuple[Any, ...], shapes: dict[str, tuple[int, ...]], what: What
    ) -> dict[str, Any] | None:
        """Return vectors and matrices by name, or for the matrices what `what` selects; None if one is not finite."""
        q, u, a, nu = (None if x is None else self.numbers.state(x) for x in at[:4])
        state = State(q, u, a, nu, at[4])
        running = [g for g in self._groups if len(g.rows) or function != "linearize_rows"]
        try:
            with np.errstate(all="ignore"):
                parts = [g.values(function, state) for g in running]
        except (ArithmeticError, ValueError):
            return None
        count = len(parts[0]) if parts else 1
        layers = [np.concatenate([np.zeros(0), *(x[k].ravel() for x in parts)]) for k in range(count)]
        if not np.isfinite(layers[0]).all():
            return None
        if function not in self._patterns:
            self._patterns[function] = {
                key: _pattern(function, key, running, self.n_q, shape) for key, shape in shapes.items()
            }
        patterns = self._patterns[function]
        if what == "lost":
            return {key: p.lost(layers[0], self.form) for key, p in patterns.items() if len(p.shape) == 2}
        layers = [np.abs(x) if what == "sizes" else x for x in layers]
        return {key: self.numbers.filled(pattern, layers, self.form) for key, pattern in patterns.items()}


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
                    inside = at < (shape[0] if key in OF_ROWS else n_q)
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
