"""What fields do to the elements of a scene at states, in doubles and in balls."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from fractions import Fraction
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import Any, Literal, NamedTuple

import numpy as np

from mbstab.analysis.algebra.arrays import Flags
from mbstab.analysis.algebra.ball_arrays import (
    BALLS,
    NONE,
    Doubles,
    as_ball,
    largest_terms,
    middle,
    plain_ball,
    radii,
)
from mbstab.analysis.reference.fields import SIZES, Block, field_values
from mbstab.analysis.reference.tolerances import TOLERANCES
from mbstab.compiler.placed import Placed
from mbstab.compiler.scatter import signals_at
from mbstab.compiler.system import Array, System

State = tuple[Array, Array, Array, Any]
"""Coordinates, speeds and accelerations, shape (…, n), and the time."""

Sized = tuple[Array, Array]
"""A matrix, and the exponents of the sizes of its entries, or of the largest terms of these."""

What = Literal["along", "driven", "work", "held"]
"""What is asked of fields: how forces and rows change along them, and for speeds along them; the work of forces; what
they do against rows, but for those of states."""


OF_FUNCTION = {"dynamics": "MFEVJB", "linearize": "KRD"}
"""Results of the functions of kernels that are asked for."""

FUNCTION_OF = {key: function for function, keys in OF_FUNCTION.items() for key in keys}


class Results:
    """What a function of a kernel returns at states, put into matrices where these are asked for.

    Parameters
    ----------
    f : Doubles
        The numbers.
    values : ndarray, shape (states, number of results)
    lead : tuple of int
        Shape of the states.
    places : dict
        The shapes of the matrices and the places of the results in them, see `_places`.
    """

    def __init__(self, f: Doubles, values: Array, lead: tuple[int, ...], places: Places) -> None:
        self._f, self._values, self._lead, self._places = f, values, lead, places
        self._found, self._sizes = dict[str, Array](), dict[str, Sized]()

    def __getitem__(self, key: str) -> Array:
        if key not in self._found:
            shape, rounds = self._places[key]
            entries_of = self._f.zeros((len(self._values), math.prod(shape)))
            for k, (numbers, entries) in enumerate(rounds):
                entries_of[:, entries] = self._values[:, numbers] + (entries_of[:, entries] if k else 0)
            self._found[key] = entries_of.reshape(*self._lead, *shape)
        return self._found[key]

    def sized(self, key: str) -> Sized:
        """Return a matrix with the exponents of the sizes of its entries."""
        if key not in self._sizes:
            self._sizes[key] = self._f.sized(self[key])
        return self._sizes[key]


Places = dict[str, tuple[tuple[int, ...], list[tuple[list[int], list[int]]]]]


class Change(NamedTuple):
    """What fields do to an element, as a matrix with a column for each field.

    Attributes
    ----------
    of : Local
    value : ndarray, shape (…, rows, k)
    size : ndarray, shape (…, rows, k)
        Exponents of the largest terms of the entries, in doubles.
    usual : ndarray, shape (…, rows, 1)
        Exponents of the largest terms for fields that move the scene by about its own size, at its rate.
    """

    of: Local
    value: Array
    size: Array
    usual: Array


class Local:
    """An element among the coordinates of some bodies."""

    def __init__(self, element: Placed, exact: Callable[[], Placed], system: System, analytic: bool) -> None:
        self.element, self.analytic, self._given = element, analytic, exact
        self.of_state = bool(element.rows) and set(element.rows) <= set(system.states[1].tolist())
        self.holonomic = bool(element.rows) and max(element.rows) < system.n_h
        self.written = element.kernel.__name__ == "user"
        self.on: list[int] = []
        self.columns: list[int] = []
        self.own: list[int] = []

    def among(self, cluster: Cluster) -> Local:
        """Return the same element among the bodies of a cluster."""
        found = Local.__new__(Local)
        found.__dict__ |= self.__dict__
        inside = [i for i in self.element.columns if i in cluster.owner]
        found.on = sorted({cluster.owner[i] for i in inside})
        numbers = [i for k in found.on for i in range(cluster.blocks[k].part.start, cluster.blocks[k].part.stop)]
        found.columns = [cluster.place[i] for i in numbers]
        found.own = [numbers.index(i) if i in cluster.owner else -1 for i in self.element.columns]
        return found

    @cached_property
    def exact(self) -> Placed:
        """The same with numbers in balls."""
        found = self._given()
        return replace(found, parameters=tuple(map(plain_ball, found.parameters)))

    @cached_property
    def key(self) -> tuple[Any, ...]:
        """What elements that do the same have in common."""
        numbers = tuple(np.asarray(x, dtype=float).tobytes() for x in self.element.parameters)
        laws, places = tuple(map(id, self.element.laws)), (*self.on, *self.own)
        return id(self.element.kernel), numbers, places, laws, self.analytic

    def run(self, function: str, state: State, f: Doubles, nu: Any = None) -> Results:
        """Return the results of a function of its kernel on the coordinates of its bodies.

        With multipliers `nu` of all rows those of its own are taken.
        """
        e, (q, u, a, time) = self.exact if f.exact else self.element, state
        n, m, places = len(self.columns), len(e.rows), [self.columns[k] if k >= 0 else -1 for k in self.own]
        signals = signals_at(e.laws, time) if e.laws else ()
        evaluate = getattr(e.kernel, function)

        def values(one: Sequence[list[Any]]) -> list[Any]:
            q, u, a = ([x[k] if k >= 0 else 0.0 for k in places] for x in one)
            arguments = [q, u, e.parameters, signals]
            if function == "linearize" and e.takes_acceleration:
                arguments.append(a)
            elif function == "linearize" and e.rows:
                arguments.append([0.0 if nu is None else nu[i] for i in e.rows])
            try:
                return list(evaluate(f.f, *arguments))
            except (ArithmeticError, ValueError):
                if f.exact:
                    raise
                return [np.nan] * sum(map(len, getattr(e.kernel, function.upper()).values()))

        lead, states = q.shape[:-1], [x.reshape(-1, q.shape[-1]).tolist() for x in (q, u, a)]
        results = np.array([values(x) for x in zip(*states, strict=True)], dtype=q.dtype)
        return Results(f, results, lead, _places(e.kernel, function, tuple(self.own), n, m))

    @cached_property
    def contained(self) -> tuple[list[int], list[int]]:
        """Coordinates that a force, or a row, contains, and those whose speeds it contains or on which it acts."""
        kernel = self.element.kernel
        names = (name for name in ("DYNAMICS", "LINEARIZE") if hasattr(kernel, name))
        entries = [x for name in names for key, own in getattr(kernel, name).items() for x in ((key, y) for y in own)]
        seen, speeds = (
            {self.own[index[1]] for key, index in entries if key in keys} - {-1}
            for keys in (("K", "J", "D"), ("R", "M"))
        )
        return sorted(seen), sorted(seen | speeds | {self.own[index[0]] for key, index in entries if key == "F"} - {-1})


@lru_cache(maxsize=1000)
def _places(kernel: Any, function: str, own: tuple[int, ...], n: int, m: int) -> Places:
    """Return by matrix its shape, and the numbers of the results of a kernel with those of their entries.

    Results of the same entries come one after another.
    """
    shapes = {key: (n, n) for key in "MKR"} | {"F": (n,)} | {key: (m,) for key in "EVB"} | {key: (m, n) for key in "JD"}
    rounds: dict[str, list[dict[int, int]]] = {key: [] for key in OF_FUNCTION[function]}
    results = [(key, index) for key, entries in getattr(kernel, function.upper()).items() for index in entries]
    for k, (key, index) in enumerate(results):
        place = (index[0] if key in "EVBJD" else own[index[0]], *(own[i] for i in index[1:]))
        if key in rounds and min(place) >= 0:
            entry = place[0] if len(place) == 1 else place[0] * n + place[1]
            into = next((x for x in rounds[key] if entry not in x), None)
            if into is None:
                rounds[key].append(into := {})
            into[entry] = k
    return {key: (shapes[key], [([*x.values()], [*x]) for x in found]) for key, found in rounds.items()}


class Cluster:
    """Bodies and states that some elements have in common, with all rows on them."""

    def __init__(self, blocks: Sequence[Block], exact: Callable[[], Sequence[Block]]) -> None:
        self.blocks, self._given = list(blocks), exact
        self.columns = [i for b in self.blocks for i in range(b.part.start, b.part.stop)]
        self.owner = {i: k for k, b in enumerate(self.blocks) for i in range(b.part.start, b.part.stop)}
        self.place = {i: k for k, i in enumerate(self.columns)}
        self.fields = [k for b in self.blocks for k in b.fields]
        self.elements, self.rows = list[Local](), list[Local]()
        self.rough, self.beside, self.visited = list[At](), list[At](), list[list[At]]()
        self.ranks: tuple[int, int] | None = None

    @cached_property
    def exact_blocks(self) -> list[Block]:
        """The same blocks with bases in balls."""
        return [b._replace(base=tuple(map(plain_ball, b.base))) for b in self._given()]

    @cached_property
    def parts(self) -> list[slice]:
        """The places of the fields of each block."""
        ends = np.cumsum([0, *(SIZES[b.kind] for b in self.blocks)]).tolist()
        return [slice(*x) for x in pairwise(ends)]

    def fields_of(self, own: Local) -> list[int]:
        """Return the places of the fields of the bodies of an element."""
        return [k for b in own.on for k in range(self.parts[b].start, self.parts[b].stop)]

    @cached_property
    def key(self) -> tuple[Any, ...]:
        """What clusters that do the same have in common."""
        bodies = tuple((b.kind, *map(float, b.base)) for b in self.blocks)
        return bodies, tuple(x.key for x in self.elements), tuple(x.key for x in self.rows)

    @property
    def least(self) -> int:
        """How many equations a state gives at least."""
        return sum(len(x.element.rows) or len(x.columns) for x in self.elements)

    @property
    def still(self) -> bool:
        """Whether its elements are rows on positions alone."""
        return all(x.holonomic for x in self.elements)

    @cached_property
    def closing(self) -> list[Local]:
        """The rows that its states satisfy: those on positions alone where no speeds are asked for."""
        return [x for x in self.rows if x.holonomic or not self.still]

    @cached_property
    def holonomic(self) -> Flags:
        """Which of these rows are on positions."""
        return np.array([x.holonomic for x in self.closing for _ in x.element.rows], dtype=bool)

    def ranked(self, kept: list[int]) -> tuple[int, int]:
        """Return how many of some rows are on positions, and how many there are."""
        return int(np.sum(self.holonomic[kept])), len(kept)

    def stacked(self, found: dict[int, Results], key: str, f: Doubles) -> Array:
        """Return the residuals of these rows, or their derivatives by all coordinates, one below the other."""
        total = f.zeros((len(self.holonomic), len(self.columns)) if key == "J" else (len(self.holonomic),))
        start = 0
        for x in self.closing:
            here = slice(start, start + len(x.element.rows))
            total[(here, x.columns) if key == "J" else here] = found[id(x)][key]
            start = here.stop
        return total

    def at(self, state: State, f: Doubles, sizes: Array, rate: float) -> At:
        """Return its elements at states."""
        return At(self, state, f, sizes, rate)


class At:
    """The elements of a cluster at states, with the fields there.

    Parameters
    ----------
    cluster : Cluster
    state : State
    f : Doubles
        The numbers.
    sizes : ndarray, shape (n,)
        Characteristic sizes of the coordinates.
    rate : float
        A characteristic rate (1/s).
    """

    def __init__(self, cluster: Cluster, state: State, f: Doubles, sizes: Array, rate: float) -> None:
        self.cluster, self.state, self.f = cluster, state, f
        self.units, self.rate = np.log2(sizes), float(np.log2(rate))
        self.elements: Sequence[Local] = cluster.elements
        self._runs: dict[tuple[int, str], Results] = {}

    def entry(self, own: Local, key: str) -> Sized:
        """Return a matrix of an element, or its force, with the exponents of the sizes."""
        return self._run(own, FUNCTION_OF[key]).sized(key)

    def _run(self, own: Local, function: str, nu: Any = None) -> Results:
        """Return the results of a function of the kernel of an element."""
        key = id(own), function
        if key not in self._runs:
            self._runs[key] = own.run(function, self.state, self.f, nu)
        return self._runs[key]

    def evaluate(self, elements: Sequence[Local]) -> None:
        """Evaluate some elements of the cluster, those of which changes are asked."""
        self.elements = elements
        for own in (x for x in elements if x.analytic):
            self.entry(own, "J" if own.element.rows else "F")
            if not own.holonomic:
                self._run(own, "linearize")

    @cached_property
    def values(self) -> list[Any]:
        """The fields of each block: X, X', X'' and DX, one below the other."""
        (q, u, a, _), cluster, found = self.state, self.cluster, list[Any]()
        moving = not cluster.still or not all(x.analytic for x in cluster.elements)
        start = 0
        for b in cluster.exact_blocks if self.f.exact else cluster.blocks:
            m = b.part.stop - b.part.start
            here = slice(start, start + m)
            x = field_values(b, q[..., here], *((u[..., here], a[..., here]) if moving else ()))
            parts = (*x[:3], x.slope.reshape(*x.X.shape[:-2], -1, x.X.shape[-1])) if moving else x[:1]
            found.append(self.f.prepared(np.concatenate(parts, axis=-2)))
            start += m
        return found

    def fields(self, c: Array) -> list[tuple[Array, ...]]:
        """Return combinations of fields, given by their coefficients as columns: X, X', X'' and DX by block.

        DX has the shape (…, m, m, k).
        """
        return [
            _divided(self.f.multiplied(values, c[part]), b)
            for b, part, values in zip(self.cluster.blocks, self.cluster.parts, self.values, strict=True)
        ]

    def changes(self, what: What, c: Array | None = None) -> Iterator[Change]:
        """Yield what combinations of fields, or in doubles all of its bodies, do to each of its elements."""
        known = None if c is None else [list(map(self.f.sized, own)) for own in self.fields(c)]
        for own in self.elements:
            if known is None:
                fields = [list(map(self.f.sized, block)) for block in self._each(own.on)]
            else:
                fields = [known[k] for k in own.on]
            yield from self._change(own, what, fields)

    def _each(self, on: Sequence[int]) -> list[tuple[Array, ...]]:
        """Return each field of some blocks, in doubles."""
        sizes, start, found = [SIZES[self.cluster.blocks[k].kind] for k in on], 0, list[tuple[Array, ...]]()
        for k, size in zip(on, sizes, strict=True):
            values = np.zeros((*self.values[k].shape[:-1], sum(sizes)))
            values[..., start : start + size] = self.values[k]
            found.append(_divided(values, self.cluster.blocks[k]))
            start += size
        return found

    def _change(self, own: Local, what: What, fields: Sequence[Sequence[Sized]]) -> Iterator[Change]:
        X, slopes = [_below([x[i] for x in fields]) for i in range(3)], [x[3] for x in fields]
        if not own.analytic:
            found = self._untouched(own, what, X[0][0], [x for x, _ in slopes])
        elif own.element.rows:
            J = self.entry(own, "J")
            found = None if what == "work" or (what == "held" and own.of_state) else self._products(own, (J, X[0], 0))
            if what == "along" and not own.holonomic:
                D = self.entry(own, "D")
                found = self._products(own, (D, X[0], 0), (J, X[1], 1))
        elif what == "along":
            K, R, M = (self.entry(own, key) for key in "KRM")
            found = self._products(own, (K, X[0], 0), (R, X[1], 1), (M, X[2], 2))
            self._bend(own, found, slopes)
        elif what == "driven":
            found = self._products(own, (self.entry(own, "R"), X[0], 0))
        elif what == "work" and not own.element.takes_acceleration:
            F, size = self.entry(own, "F")
            found = self._products(own, ((F[..., None, :], size[..., None, :]), X[0], 0))
        else:
            found = None
        if found is not None:
            yield found

    def _products(self, own: Local, *terms: tuple[Sized, Sized, int]) -> Change:
        """Return a sum of products of matrices and fields, or their derivatives of an order."""
        total: Any = 0
        size: Any = NONE
        usual: Any = NONE
        for (A, power), (X, other), order in terms:
            total = total + self.f.multiplied(A, X)
            size = np.maximum(size, largest_terms(power, other))
            units = self.units[own.columns] + order * self.rate
            usual = np.maximum(usual, np.max(power + units, axis=-1, keepdims=True, initial=NONE))
        return Change(own, total, size, usual)

    def _bend(self, own: Local, found: Change, slopes: Sequence[Sized]) -> None:
        """Add (DX)ᵀ F, which acts on all coordinates of a body."""
        a = self.state[2][..., own.columns]
        force = self.entry(own, "F")[0] + self.f.multiplied(self.entry(own, "M")[0], a[..., None])[..., 0]
        power, start = self.f.sized(force)[1], 0
        for slope, size in slopes:
            *lead, m, _, k = slope.shape
            here = slice(start, start + m)
            bent = self.f.multiplied(force[..., None, here], slope.reshape(*lead, m, m * k))
            terms = largest_terms(power[..., None, here], size.reshape(*lead, m, m * k))
            found.value[..., here, :] += bent.reshape(*lead, m, k)
            found.size[..., here, :] = np.maximum(found.size[..., here, :], terms.reshape(*lead, m, k))
            start += m

    def _untouched(self, own: Local, what: What, X: Array, slopes: Sequence[Array]) -> Change | None:
        """Return the changes of the coordinates and speeds that an element contains, in place of its own changes."""
        places, speeds = own.contained
        if what == "along":
            rows, start = [X[..., places, :]], 0
            for slope in slopes:
                m = slope.shape[-2]
                bent = slope[..., [i - start for i in speeds if start <= i < start + m], :, :]
                rows.append(bent.reshape(*bent.shape[:-3], -1, bent.shape[-1]))
                start += m
            moved = np.concatenate(rows, axis=-2)
        else:
            if what != "driven" and bool(own.element.rows) != (what == "held" and not own.of_state):
                return None
            moved = X[..., speeds, :]
        size = self.f.sized(moved)[1]
        return Change(own, moved, size, np.max(size, axis=-1, keepdims=True, initial=NONE))

    def later(self, own: Local, step: Fraction, rows: int) -> Array:
        """Return the derivative by time of the force or the rows of an element, in balls, by a difference."""
        h, (*state, time) = as_ball(step.numerator) / step.denominator, self.state
        if not (own.analytic and own.element.laws):
            return BALLS.zeros((rows,))
        key = ("E" if own.holonomic else "V") if own.element.rows else "F"
        ahead, back = (own.run("dynamics", (*state, now), BALLS)[key] for now in (time + h, time - h))
        return np.asarray((ahead - back) / (2 * h))


def _below(parts: Sequence[Sized]) -> Sized:
    """Return matrices one below the other."""
    value, size = (np.concatenate(x, axis=-2) for x in zip(*parts, strict=True))
    return value, size


def _divided(x: Array, b: Block) -> tuple[Array, ...]:
    """Return X, X', X'' and DX of a block, given one below the other."""
    m = b.part.stop - b.part.start
    rest = x[..., 3 * m :, :]
    slope = rest.reshape(*x.shape[:-2], m, m, x.shape[-1]) if rest.shape[-2] else rest
    return (*(x[..., k * m : (k + 1) * m, :] for k in range(3)), slope)


class Whole(Cluster):
    """A whole scene: the forces of all elements count together, as far as its rows do not balance them."""

    def at(self, state: State, f: Doubles, sizes: Array, rate: float) -> At:
        """Return its elements at a state, with the accelerations and multipliers of the motion through it."""
        return Balanced(self, state, f, sizes, rate)


class Balanced(At):
    """The sum of the forces of a scene at a state, with the accelerations and multipliers of the motion through it."""

    def __init__(self, cluster: Cluster, state: State, f: Doubles, sizes: Array, rate: float) -> None:
        q, u, _, time = state
        super().__init__(cluster, (q, u, 0 * q, time), f, sizes, rate)
        self.sizes, self.smooth = sizes, [x for x in cluster.elements if x.analytic]
        self.elements = [x for x in cluster.elements if x.element.rows or not x.analytic]
        n = len(cluster.columns)
        M, F = self._sum("M"), self._sum("F")
        rows = [x for x in self.smooth if x.element.rows]
        J, B = f.zeros((sum(len(x.element.rows) for x in rows), n)), list[Any]()
        for x in rows:
            J[len(B) : len(B) + len(x.element.rows), x.columns] = self.entry(x, "J")[0]
            B += list(self.entry(x, "B")[0])
        kept = independent(middle(J) * sizes)
        self.J = J[kept]
        matrix, right = f.zeros((n + len(kept), n + len(kept))), f.zeros((n + len(kept), 1))
        matrix[:n, :n], matrix[n:, :n], matrix[:n, n:] = M, self.J, self.J.T
        right[:n, 0], right[n:, 0] = -F, [-B[k] for k in kept]
        solved = f.solved(matrix, right)[:, 0]
        numbers = [i for own in rows for i in own.element.rows]
        self.nu = dict.fromkeys(numbers, 0.0) | {numbers[k]: y for k, y in zip(kept, solved[n:], strict=True)}
        self.M, self.state = M, (q, u, solved[:n], time)

    def evaluate(self, elements: Sequence[Local]) -> None:
        """Evaluate all elements."""
        for x in self.smooth:
            if x.element.rows or not x.holonomic:
                self._run(x, "linearize", self.nu)

    def _sum(self, key: str) -> Array:
        """Return the sum of a matrix, or of forces, over the elements."""
        n, function = len(self.cluster.columns), FUNCTION_OF[key]
        total = self.f.zeros((n,) if key == "F" else (n, n))
        for x in self.smooth:
            if function == "dynamics" or x.element.rows or not x.holonomic:
                nu = self.nu if function == "linearize" else None
                total[x.columns if key == "F" else np.ix_(x.columns, x.columns)] += self._run(x, function, nu)[key]
        return total

    def changes(self, what: What, c: Array | None = None) -> Iterator[Change]:
        """Yield what combinations of fields, or all, do to the sum of the forces, and to rows."""
        yield from super().changes(what, c)
        if what not in ("along", "work"):
            return
        f, fields = self.f, self._each(range(len(self.values))) if c is None else self.fields(c)
        X, X1, X2 = (np.concatenate([x[i] for x in fields], axis=-2) for i in range(3))
        whole = Local.__new__(Local)
        whole.columns, whole.on = list(range(len(self.cluster.columns))), list(range(len(self.cluster.blocks)))
        if what == "work":
            F, terms = f.zeros((1, len(whole.columns))), np.full((1, len(whole.columns)), NONE)
            for x in (x for x in self.smooth if not (x.element.rows or x.element.takes_acceleration)):
                own, size = self.entry(x, "F")
                F[0, x.columns] += own
                terms[0, x.columns] = np.maximum(terms[0, x.columns], size)
            total = self._products(whole, ((F, terms), f.sized(X), 0))
            yield total
            if f.exact:
                yield from self._hidden(what, fields, total.value)
            return
        pairs = ((self._sum("K"), X, 0), (self._sum("R"), X1, 1), (self.M, X2, 2))
        _, value, size, usual = self._products(whole, *((f.sized(A), f.sized(Y), k) for A, Y, k in pairs))
        if len(self.J):
            weighted = self.J * self.sizes**2
            pulled = f.solved(f.multiplied(weighted, self.J.T), f.multiplied(weighted, value))
            value = value - f.multiplied(self.J.T, pulled)
            # Reactions mix what acts on coordinates.
            size, usual = (np.max(x + self.units[:, None], axis=0) - self.units[:, None] for x in (size, usual))
        yield Change(whole, value, size, usual)
        if f.exact:
            yield from self._hidden(what, fields, value)

    def _hidden(self, what: What, fields: Sequence[tuple[Array, ...]], total: Array) -> Iterator[Change]:
        """Yield changes of single forces that are lost in the rounding of their sum: nothing is known to balance them.

        A weak force must not be lost beside those of all others.
        """
        lost = BALLS.powers(radii(total))
        known = [list(map(BALLS.sized, own)) for own in fields]
        for own in (x for x in self.smooth if not x.element.rows):
            for change in self._change(own, what, [known[k] for k in own.on]):
                rows = lost if what == "work" else lost[own.columns]
                change.value[BALLS.powers(change.value) > rows] = 0
                yield change


def independent(J: Array, first: Flags | None = None) -> list[int]:
    """Return the numbers of independent rows; some of them come first."""
    left, kept = J / np.maximum(np.linalg.norm(J, axis=1), 1e-300)[:, None], list[int]()
    for those in (first, ~first) if first is not None else (np.ones(len(J), dtype=bool),):
        while len(kept) < len(J):
            lengths = np.where(those, np.linalg.norm(left, axis=1), 0.0)
            k = int(np.argmax(lengths))
            if not lengths[k] > TOLERANCES.row_dependence:
                break
            kept.append(k)
            unit = left[k] / lengths[k]
            left = left - np.outer(left @ unit, unit)
    return sorted(kept)
