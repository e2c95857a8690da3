"""Elements where they stand in a scene: each with its kernel, its coordinates and rows, and its numbers."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from mbstab.compiler.scatter import signals_at
from mbstab.mechanics.catalogue import COORDINATES, FRAMES, GROUND, Element, ElementUse
from mbstab.mechanics.elements import ELEMENTS
from mbstab.mechanics.vectors import plain_zero
from mbstab.model.arithmetic import FLOAT, KINK, Arithmetic
from mbstab.model.expressions import NO_REAL_VALUE, why_no_number
from mbstab.model.scene import Scene
from mbstab.model.schema import is_state
from mbstab.records import dataclass

if TYPE_CHECKING:
    import numpy.typing as npt


@dataclass(frozen=True)
class Placed:
    """An element of a scene: its kernel, its places among coordinates and rows, its numbers."""

    kernel: Any
    columns: tuple[int, ...]
    rows: tuple[int, ...]
    parameters: tuple[Any, ...]
    laws: tuple[Any, ...]
    takes_acceleration: bool
    path: str
    named: int = 0
    """How many of the parameters are those that its expressions name; the others are numbers of measures."""
    positive: tuple[str, ...] = ()
    """Names of its fields that change with the motion and must stay positive."""

    def arguments(self, function: str, q: Any, u: Any, a: Any, nu: Any, time: Any) -> list[Any]:
        """Return what a function of the kernel takes, from vectors with one fixed coordinate appended."""
        signals = signals_at(self.laws, time) if self.laws else ()
        found = [[q[i] for i in self.columns], [u[i] for i in self.columns], self.parameters, signals]
        if function == "linearize_rows" or (function == "linearize" and self.takes_acceleration):
            found.append([a[i] for i in self.columns])
        elif function == "linearize" and self.rows:
            found.append([nu[i] for i in self.rows])
        return found

    def why(self, error: Exception) -> str:
        """Return why it has no finite equations at a state, in words."""
        said = why_no_number(error)
        if self.positive and said == NO_REAL_VALUE:
            return f"{said}; {' and '.join(self.positive)} must stay positive"
        return said

    def hint(self, error: Exception) -> str:
        """Return a hint for a state without finite equations; `error` says why it has none."""
        element = ELEMENTS.get(self.kernel.__name__.rpartition(".")[2])
        if element is not None and element.hint:
            return f"hint: {element.hint}"
        if self.kernel.__name__ == "user":
            if str(error) == KINK:
                return "hint: for abs(x) near 0 write sqrt(x**2 + w**2) with a small width w"
            return (
                "hint: the expression or a derivative of it has no value here, as that of sqrt(x) at 0: change it, or "
                "the reference"
            )
        return (
            "hint: two points that coincide, a wheel lying flat, an expression outside its domain or at a kink has no "
            "derivative"
        )


@dataclass(frozen=True)
class Acting:
    """A single element without rows, which exerts forces or has inertia.

    Attributes
    ----------
    path : str
        The entry it belongs to.
    columns : tuple of int
        Numbers of the coordinates it contains.
    written : bool
        Whether it is written as expressions in the file.
    inertia : bool
    damping : tuple of numbers or None
        The coefficients of the dissipation function of a force with one and a potential; None for others.
    analytic : bool
        Whether it is an analytic function of the state: no abs and the like of coordinates.
    """

    path: str
    columns: tuple[int, ...]
    written: bool
    inertia: bool
    damping: tuple[Any, ...] | None
    analytic: bool
    placed: Placed

    @cached_property
    def slots(self) -> frozenset[tuple[int, int]]:
        """Entries of ∂F/∂q that are not identically zero, as numbers of coordinates."""
        own, places = set(self.columns), self.placed.columns
        pairs = ((places[i], places[j]) for i, j in self.placed.kernel.LINEARIZE.get("K", ()))
        return frozenset(pair for pair in pairs if own.issuperset(pair))

    @cached_property
    def seen(self) -> frozenset[int]:
        """Numbers of the coordinates by which ∂F/∂q is not identically zero."""
        return frozenset(j for _, j in self.slots)

    @property
    def stored(self) -> bool:
        """Whether its force comes from a potential and a dissipation function."""
        return self.damping is not None

    @property
    def damped(self) -> bool:
        """Whether such a force has a dissipation function."""
        return any(not plain_zero(x) for x in self.damping or ())

    def force(self, q: Any, u: Any, a: Any, time: Any, f: Arithmetic = FLOAT) -> list[Any]:
        """Return its part of the residual F, with its inertia, on its own columns.

        Parameters
        ----------
        q, u, a : sequences of numbers, length n_q
        time : number (s)
        f : Arithmetic
            Arithmetic of the numbers.
        """
        n, zero = len(q), f.number("0")
        return self.own_force([[x[i] if i < n else zero for i in self.placed.columns] for x in (q, u, a)], time, f)

    def own_force(self, own: list[list[Any]], time: Any, f: Arithmetic = FLOAT) -> list[Any]:
        """Return the same for the coordinates, speeds and accelerations that it contains, in its order."""
        e, a = self.placed, own[2]
        signals = signals_at(e.laws, time) if e.laws else ()
        values = tuple(e.kernel.dynamics(f, own[0], own[1], e.parameters, signals))
        total = [f.number("0")] * len(self.columns)
        for k, row, j in self._sums:
            total[row] = total[row] + (values[k] if j is None else values[k] * a[j])
        return total

    @cached_property
    def _sums(self) -> list[tuple[int, int, int | None]]:
        """Numbers of the values that add to a force, of the column, and of the acceleration that is their factor."""
        e, place = self.placed, {column: k for k, column in enumerate(self.columns)}
        indices = ((key, index) for key, entries in e.kernel.DYNAMICS.items() for index in entries)
        return [
            (k, place[e.columns[index[0]]], index[1] if key == "M" else None)
            for k, (key, index) in enumerate(indices)
            if e.columns[index[0]] in place
        ]

    def slopes(self, q: Any, u: Any, a: Any, time: Any, f: Arithmetic = FLOAT) -> tuple[list[list[Any]], ...]:
        """Return the parts of ∂F/∂q and ∂F/∂u on its own columns, as rows."""
        e, zero = self.placed, f.number("0")
        n = len(q)
        own = [[x[i] if i < n else zero for i in e.columns] for x in (q, u, a)]
        signals = signals_at(e.laws, time) if e.laws else ()
        arguments = [own[0], own[1], e.parameters, signals, *([own[2]] if e.takes_acceleration else [])]
        values = iter(e.kernel.linearize(f, *arguments))
        place = {column: k for k, column in enumerate(self.columns)}
        found: dict[str, list[list[Any]]] = {key: [[zero] * len(place) for _ in place] for key in "KR"}
        for key, entries in e.kernel.LINEARIZE.items():
            for i, j in entries:
                value = next(values)
                if e.columns[i] in place and e.columns[j] in place:
                    row = found[key][place[e.columns[i]]]
                    row[place[e.columns[j]]] = row[place[e.columns[j]]] + value
        return found["K"], found["R"]


def columns_of(use: ElementUse, element: Element, scene: Scene, slices: list[slice], n_q: int) -> tuple[int, ...]:
    """Return the coordinate numbers of an element, n_q where one is fixed; `slices` are those of the bodies."""
    if element.on_coordinates:
        return use.slots
    size = len(COORDINATES[FRAMES[scene.dimension]])
    columns: list[int] = []
    for body in use.slots[: element.slots]:
        own = range(0) if body == GROUND else range(slices[body].start, slices[body].stop)
        columns += [*own, *[n_q] * (size - len(own))]
    return (*columns, *use.slots[element.slots :])


def bases_of(use: ElementUse, element: Element, scene: Scene) -> tuple[Any, ...]:
    """Return the base rotations of the bodies of an element, one after the other; there are none in the plane."""
    if scene.dimension == 2 or element.on_coordinates:
        return ()
    return tuple(x for b in use.slots[: element.slots] for x in (_IDENTITY if b == GROUND else scene.bodies[b].base))


_IDENTITY = tuple(float(i == j) for i in range(3) for j in range(3))


def acting(elements: Iterable[Placed], scene: Scene, names: Sequence[str]) -> list[Acting]:
    """Return the elements without rows, each by itself; `names` are those of the coordinates."""
    pieced = {
        item.entry.path
        for item in scene.items
        if any(expression.pieced(names) for expression in item.entry.expressions())
    }
    found = []
    for e in elements:
        if e.rows:
            continue
        columns = tuple(dict.fromkeys(i for i in e.columns if i < len(names)))
        places = getattr(e.kernel, "DAMPING", None)
        damping = None if places is None else tuple(e.parameters[i] for i in places)
        written = e.kernel.__name__ == "user"
        found.append(Acting(e.path, columns, written, e.takes_acceleration, damping, e.path not in pieced, e))
    return found


def force_sizes(acting: Iterable[Acting], q: Any, u: Any, a: Any, time: Any) -> npt.NDArray[np.float64]:
    """Return the sums of the sizes of forces, with inertia, on each coordinate; those of one entry are added first.

    Where a force has no finite value, sums are not finite.
    """
    at, speeds, accelerations = (x.tolist() for x in (q, u, a))
    forces: dict[str, npt.NDArray[np.float64]] = {}
    total = np.zeros(len(q))
    try:
        for element in acting:
            own = forces.setdefault(element.path, np.zeros(len(q)))
            own[list(element.columns)] += element.force(at, speeds, accelerations, time)
    except (ArithmeticError, ValueError):
        return np.full(len(q), np.nan)
    for own in forces.values():
        total += np.abs(own)
    return total


def unfelt_states(scene: Scene, names: Sequence[str]) -> dict[str, set[int]]:
    """Return by the path of an entry the numbers of the states in its expressions that only have a factor zero."""
    found = {}
    for item in scene.items:
        written = item.entry.equations.values()
        felt = set[str]().union(*(x.felt(scene.parameters, scene.arithmetic) for x in written))
        there = {name for x in written for name in (*x.names(), *x.rates())}
        found[item.entry.path] = {i for i, name in enumerate(names) if is_state(name) and name in there - felt}
    return found


def following(
    elements: Iterable[Placed], states: Iterable[int], rows: Iterable[int], unfelt: Mapping[str, set[int]]
) -> list[int]:
    """Return the numbers of those states that no element contains but the rows of their own rates and of each other.

    Parameters
    ----------
    states, rows
        Numbers of the coordinates that are first-order states, and of the rows of their rates, in the same order.
    unfelt
        As `unfelt_states` returns.
    """
    own = dict(zip(map(int, rows), map(int, states), strict=True))
    found, before = set(own.values()), -1
    while found and len(found) != before:
        before = len(found)
        for element in elements:
            if not element.rows or any(own.get(row) not in found for row in element.rows):
                found.difference_update(set(element.columns) - unfelt.get(element.path, set()))
    return sorted(found)
