"""Elements at many points of a sweep: those of one kernel are evaluated together, as arrays.

With few points a sweep spends its time on starting operations of NumPy, not on numbers; elements of
one kernel share them. With many points they stay apart: what does not vary is faster as a plain float.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import groupby
from typing import Any

import numpy as np

from mbstab.compiler.grouped import Array, Group, Index, Numbers, State, What
from mbstab.compiler.placed import Placed
from mbstab.compiler.scatter import Plan, rows_of

MANY = 500
"""Above this number of points, elements are faster one by one."""


class Rows:
    """A vector at the points of a sweep, with one fixed coordinate appended.

    Attributes
    ----------
    rows : ndarray, shape (numbers, points)
    varies : ndarray of bool, shape (numbers,)
        Which numbers are not the same at all points.
    """

    def __init__(self, x: Any) -> None:
        self.rows, self.varies = rows_of(np.atleast_2d(np.asarray(x, dtype=float)), fixed=1)
        self._varying = frozenset(np.flatnonzero(self.varies).tolist())

    def vary(self, places: tuple[int, ...]) -> bool:
        """Return whether a number at one of some places varies."""
        return not self._varying.isdisjoint(places)

    def of(self, places: Index) -> list[Any]:
        """Return the numbers at places, shape (places of one, elements): floats that the elements share, else arrays.

        Their shape is (elements, points or 1), of a single element (points,).
        """
        varies, first = self.varies[places].any(axis=1), self.rows[:, 0][places]
        shared = ~varies & (first == first[:, :1]).all(axis=1)
        single = places.shape[1] == 1
        return [
            x[0].item() if s else self.rows[place[0] if single else place] if v else x[:, None]
            for place, x, v, s in zip(places, first, varies.tolist(), shared.tolist(), strict=True)
        ]


class AtPoints(Numbers):
    """The numbers of a sweep: floats, or arrays over its points."""

    def state(self, x: Any) -> Rows:
        """Return a vector with one fixed coordinate appended."""
        return Rows(x)

    def taken(self, x: Rows, places: Index) -> list[Any]:
        """Return what the places of the elements hold."""
        return x.of(places)

    def together(self, values: tuple[Any, ...]) -> Any:
        """Return the same number of all elements: a float that they share, or an array as in `Rows.of`."""
        if len(values) == 1:
            return values[0]
        if not any(isinstance(x, np.ndarray) for x in values):
            return values[0] if values.count(values[0]) == len(values) else np.array(values, dtype=float)[:, None]
        return np.stack(np.broadcast_arrays(*values))

    def stacked(self, found: Any, count: int) -> Any:
        """Return the results of a kernel as they are."""
        return found


class Together:
    """The elements that have a function of the kernels, in groups of one kernel.

    Those that do not vary are alone, and those that take functions of time.

    Parameters
    ----------
    function : str
    elements : sequence of Placed
    varying : sequence of bool
        Which elements vary over the points.
    plan : Plan
        Where their results are added.
    known : dict
        Groups by the identities of their elements, to which new ones are added.
    """

    def __init__(
        self,
        function: str,
        elements: Sequence[Placed],
        varying: Sequence[bool],
        plan: Plan,
        known: dict[tuple[int, ...], Group],
    ) -> None:
        self.function, self.plan = function, plan

        def kind(number: int) -> tuple[int, int]:
            apart = elements[number].laws or not varying[number]
            return (number, 0) if apart else (-1, id(elements[number].kernel))

        self.groups: list[Group] = []
        outputs = [sum(map(len, getattr(element.kernel, function.upper()).values())) for element in elements]
        starts = np.concatenate([[0], np.cumsum(outputs, dtype=np.intp)])
        place, start = np.empty(starts[-1], dtype=np.intp), 0
        for _, members in groupby(sorted(range(len(elements)), key=kind), kind):
            numbers = list(members)
            group = tuple(id(elements[i]) for i in numbers)
            if group not in known:
                known[group] = Group([elements[i] for i in numbers], NUMBERS)
            self.groups.append(known[group])
            # The results of a group follow each other, each for all of its elements.
            own = np.arange(outputs[numbers[0]])[:, None] + starts[numbers]
            place[own] = start + np.arange(own.size).reshape(own.shape)
            start += own.size
        self.places = {key: (place[take], target) for key, (take, target) in plan.places.items()}
        self.size = len(place)

    def matrices(self, at: State, points: int, sizes: bool) -> dict[str, Array]:
        """Return each matrix as `Plan.at_points`; with the sizes of all numbers if `sizes` is set.

        Raises
        ------
        ArithmeticError, ValueError
            If the equations of an element have no value at a point.
        """
        numbers, varies, start = np.empty((self.size, points)), np.zeros(self.size, dtype=bool), 0
        for group in self.groups:
            for value in group.values(self.function, at):
                own = slice(start, start + group.count)
                numbers[own] = value
                varies[own] = isinstance(value, np.ndarray) and value.shape[-1] > 1
                start += group.count
        return self.plan.filled(np.abs(numbers) if sizes else numbers, varies, self.places)


NUMBERS = AtPoints()


def matrices(
    elements: Sequence[Placed],
    remember: Callable[[str, Any, Callable[[], Any]], Any],
    function: str,
    at: tuple[Any, Any, Any, Any, Any],
    points: int,
    plan: Plan,
    what: What,
) -> dict[str, Array]:
    """Return the matrices of elements by a function of their kernels, at coordinates, speeds and so on; see `Together`.

    Parameters
    ----------
    remember : callable
        `mbstab.compiler.system.System.remember` of the system of the elements.
    """
    q, u, a, nu = (None if x is None else Rows(x) for x in at[:4])
    own = remember(f"{function} varies", None, lambda: [_varies(element) for element in elements])
    vectors = [x for x in (q, u, a) if x is not None]
    varying = tuple(
        known or any(x.vary(e.columns) for x in vectors) or (nu is not None and nu.vary(e.rows))
        for known, e in zip(own, elements, strict=True)
    )
    groups = remember("groups", None, dict)
    together = remember(f"{function} together", varying, lambda: Together(function, elements, varying, plan, groups))
    found: dict[str, Array] = together.matrices(State(q, u, a, nu, at[4]), points, what == "sizes")
    return found


def _varies(element: Placed) -> bool:
    """Return whether the numbers of an element vary over the points."""
    return any(isinstance(x, np.ndarray) for x in element.parameters)
