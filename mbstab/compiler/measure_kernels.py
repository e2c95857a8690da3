"""Measures in expressions, by kernels of their own.

A measure such as ``angle(pivot)`` contains all coordinates of its bodies, an expression a few measures. So an
expression is derived as if measures were coordinates z, and the results are carried to the coordinates q of the bodies
by the chain rule. With the rates ζ = ż of the measures and J_k = ∂ζ_k/∂u, a force F̂(z, ζ) acts as F = Jᵀ F̂, and

    K = Jᵀ (∂F̂/∂z J + ∂F̂/∂ζ ∂ζ/∂q) + Σ F̂_k ∂J_kᵀ/∂q,   R = Jᵀ ∂F̂/∂ζ J;

constraint rows likewise. A measure that is a speed is a ζ without a z.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import repeat
from types import ModuleType
from typing import Any

from mbstab.compiler import kernels
from mbstab.compiler.measured import Measured
from mbstab.compiler.scatter import by_entry
from mbstab.mechanics.catalogue import COORDINATES, FRAMES
from mbstab.mechanics.measures import parts
from mbstab.model.arithmetic import FLOAT, Arithmetic

Entries = dict[str, dict[tuple[int, ...], Any]]
"""Results by their keys and indices."""

_ADDS_TO = {
    **{key: ((key, "J"),) for key in ("J", "K", "D", "V_q", "A_q")},
    "R": (("R", "J"), ("K", "V_q")),
    "A_u": (("A_u", "J"), ("A_q", "V_q")),
}
"""To what a derivative by a measure or its rate adds, and the derivative of the measure that multiplies it."""

_OF_RATES = {
    "dynamics": {"B": "B"},
    "linearize": {"D": "V_q"},
    "linearize_rows": {key: key for key in ("V_q", "A_q", "A_u")},
}
"""To what the derivative of a row by a rate adds, and what of the measure multiplies it, by functions of kernels."""


class MeasureKernel:
    """The kernel of a measure, and its place among the coordinates and numbers of expressions.

    Parameters
    ----------
    measure : Measured
    number : dict
        Numbers of the coordinates, by name.
    place : int
        Of its first number, counted from the end of those of the expressions.
    """

    def __init__(self, measure: Measured, number: dict[str, int], place: int) -> None:
        self.name, self.kind, self.size = measure.name, measure.kind, measure.size
        frame = FRAMES[measure.dimension]
        self._kernel = kernels.load(f"{frame}_measure_{parts(measure.name)[0]}")
        # None: a coordinate that the body does not have, or of the ground; a number of its base rotation likewise.
        columns, numbers = list[int | None](), list[int | None]()
        for body, base in zip(measure.bodies, measure.bases, strict=True):
            columns += [*(number[x] for x in body), *[None] * (len(COORDINATES[frame]) - len(body))]
            numbers += range(place, place + base) if base or frame == "planar" else [None] * 9
            place += base
        self._columns, self._numbers = columns, [*numbers, *range(place, place + measure.count)]
        self._places = {x: list(_places(getattr(self._kernel, x.upper()), columns)) for x in _OF_RATES}

    def at(self, function: str, f: Arithmetic, q: Any, u: Any, p: Any, a: Any = None) -> Entries:
        """Return what a function of the kernel of expressions takes of the measure; its places are () in E, V and B."""
        zero, one = f.number("0"), f.number("1")
        identity = [one if k % 4 == 0 else zero for k in range(9)]
        numbers = [identity[k % 9] if i is None else p[i] for k, i in enumerate(self._numbers)]
        q, u, *last = ([zero if i is None else x[i] for i in self._columns] for x in (q, u, a) if x is not None)
        last = [[one]] if function == "linearize" else last
        found = self.named(function, getattr(self._kernel, function)(f, q, u, numbers, (), *last), zero)
        if self.kind.root:
            found["E"][()] = f.sqrt(found["E"][()] + found["E"][()])
        return found

    def named(self, function: str, values: Iterable[Any], zero: Any) -> Entries:
        """Return the results of a function of the kernel of the measure with their keys and places."""
        found: Entries = {**{key: {(): zero} for key in "EVB"}, **{key: {} for key in ("J", "K", "V_q", "A_q", "A_u")}}
        for (key, place), x in zip(self._places[function], values, strict=False):
            if place == ():
                found[key][place] = x
            elif place is not None:
                _add(found[key], place, x)
        return found


def _places(table: dict[str, Any], columns: list[int | None]) -> Iterator[tuple[str, tuple[int, ...] | None]]:
    """Yield the key of each result of a measure, and its place among coordinates; None where one is fixed."""
    for key, entries in table.items():
        for index in entries:
            place = tuple(columns[i] for i in (index if key == "K" else index[1:]))
            yield key, None if None in place else place


def _add(entries: dict[tuple[int, ...], Any], index: tuple[int, ...], x: Any) -> None:
    entries[index] = entries[index] + x if index in entries else x


def carried(kernel: ModuleType, measures: Sequence[MeasureKernel], count: int) -> ModuleType:
    """Return the kernel by coordinates of what was derived by coordinates and measures.

    Parameters
    ----------
    kernel : module
        Its last coordinates are the measures, and its last speeds their rates; those of a distance that of half its
        square, by which it is derived, too. Entries of K by a distance and itself are multiplied by it.
    measures : sequence of MeasureKernel
    count : int
        Number of its other coordinates; those that only measures contain follow them.
    """
    found = ModuleType(kernel.__name__)
    for function in _OF_RATES:
        if hasattr(kernel, function):
            run = _Carried(kernel, function, measures, count)
            vars(found).update({function: run, function.upper(): run.table})
    if hasattr(kernel, "potential"):

        def potential(f: Arithmetic, q: Any, p: Any) -> Any:
            still = [f.number("0")] * len(q)
            seen = [x.at("dynamics", f, q, still, p, None)["E"][()] for x in measures]
            return kernel.potential(f, [*q[:count], *seen], p[: len(p) - sum(x.size for x in measures)])

        vars(found).update(potential=potential, POTENTIAL=kernel.POTENTIAL)
    if hasattr(kernel, "DAMPING"):
        vars(found)["DAMPING"] = kernel.DAMPING
    return found


class _Carried:
    """A function of such a kernel.

    Attributes
    ----------
    table : dict
        The indices of its results by their keys, in order.
    """

    def __init__(self, kernel: ModuleType, function: str, measures: Sequence[MeasureKernel], count: int) -> None:
        self._kernel, self._function, self._measures, self._count = kernel, function, measures, count
        self._numbers = sum(x.size for x in measures)
        results, forces = ([1.0] * sum(map(len, getattr(kernel, x).values())) for x in (function.upper(), "DYNAMICS"))
        seen = [x.named(function, repeat(1.0), 1.0) for x in measures]
        self.table = {key: tuple(x) for key, x in self._carried(FLOAT, results, forces, seen, forces).items()}

    def __call__(self, f: Arithmetic, q: Any, u: Any, p: Any, s: Any, *last: Any) -> tuple[Any, ...]:
        """Return the results in the order of the table."""
        a = last[0] if self._function == "linearize_rows" else None
        seen = [x.at(self._function, f, q, u, p, a) for x in self._measures]
        if a is not None:
            last = ([*a[: self._count], *(sum((w * a[c] for (c,), w in x["J"].items()), x["B"][()]) for x in seen)],)
        n, numbers = self._count, p[: len(p) - self._numbers]
        state = [*q[:n], *(x["E"][()] for x in seen)], [*u[:n], *(x["V"][()] for x in seen)], numbers, s
        results = forces = self._kernel.dynamics(f, *state)
        if self._function != "dynamics":
            results = getattr(self._kernel, self._function)(f, *state, *last)
        found = self._carried(f, results, forces, seen, last[0] if last else ())
        return tuple(x for own in found.values() for x in own.values())

    def _carried(self, f: Arithmetic, results: Any, forces: Any, seen: list[Entries], nu: Any) -> Entries:
        """Return the results by coordinates, from those by measures and from the forces or rows along measures."""
        function, n = self._function, self._count
        found: Entries = {key: {} for key in getattr(self._kernel, function.upper())}
        for key, index, x in by_entry(self._kernel, function, results):
            *row, j = index
            if key in ("E", "V", "B", "F") or j < n:
                _add(found[key], index, x)
                continue
            for into, slope in _ADDS_TO[key]:
                for (c,), w in seen[j - n][slope].items():
                    if key == "K" and row == [j] and self._measures[j - n].kind.root:
                        w = f.share(w, seen[j - n]["E"][()])
                    _add(found[into], (*row, c), x * w)
        along = [
            (index, x) for key, index, x in by_entry(self._kernel, "dynamics", forces) if key in "FJ" and index[-1] >= n
        ]
        for (*row, k), x in along:
            for into, of in _OF_RATES[function].items():
                for place, w in seen[k - n][of].items() if row and into in found else ():
                    _add(found[into], (*row, *place), x * w)
        for key in found.keys() & {"F", "K", "R"}:
            own, found[key] = found[key], {}
            for (i, *rest), x in own.items():
                for (c,), w in seen[i - n]["J"].items() if i >= n else [((i,), None)]:
                    _add(found[key], (c, *rest), x if w is None else w * x)
        for (*row, k), x in along if function == "linearize" else ():
            for place, w in seen[k - n]["K"].items():
                _add(found["K"], place, w * (x * nu[row[0]] if row else x))
        return found
