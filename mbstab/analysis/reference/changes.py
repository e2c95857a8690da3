"""What fields do to the elements of a scene at states, in doubles and in balls."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from fractions import Fraction
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from mbstab.analysis.algebra.ball_arrays import BALLS, Doubles, as_ball, middle, plain_ball
from mbstab.analysis.reference.fields import SIZES, Block, field_values
from mbstab.analysis.reference.tolerances import TOLERANCES
from mbstab.compiler.placed import Placed
from mbstab.compiler.scatter import signals_at
from mbstab.compiler.system import Array, System

State = tuple[Array, Array, Array, Any]
"""Coordinates, speeds and accelerations, shape (…, n), and the time."""

Sized = tuple[Array, Array]
"""A matrix, and the exponents of the largest terms of its entries."""


OF_FUNCTION = {"dynamics": "MFEVJB", "linearize": "KRD"}
"""Results of the functions of kernels that are asked for."""


class Changes(NamedTuple):
    """What fields do to elements, as matrices with a column for each field.

    Attributes
    ----------
    along : Sized
        Changes of their forces and rows along the fields.
    driven : Sized
        Changes for speeds along the fields.
    work : Sized
        Work of the forces along the fields.
    held : Sized
        What the fields do against rows, but for those of states.
    """

    along: Sized
    driven: Sized
    work: Sized
    held: Sized


class Local:
    """An element among the coordinates of some bodies."""

    def __init__(self, element: Placed, exact: Callable[[], Placed], system: System, analytic: bool) -> None:
        self.element, self.analytic, self._given = element, analytic, exact
        self.of_state = bool(element.rows) and set(element.rows) <= set(system.states[1].tolist())
        self.holonomic = bool(element.rows) and max(element.rows) < system.n_h
        self.written = element.kernel.__name__ == "user"
        self._known: dict[str, list[tuple[str, tuple[Any, ...], int]]] = {}
        self.own: list[int] = []

    def among(self, columns: Sequence[int]) -> Local:
        """Return the same element among the coordinates of some bodies."""
        found = Local.__new__(Local)
        found.__dict__ |= self.__dict__ | {"_known": {}}
        found.own = [columns.index(i) if i in columns else -1 for i in self.element.columns]
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
        return id(self.element.kernel), numbers, tuple(self.own), tuple(map(id, self.element.laws)), self.analytic

    def run(self, function: str, state: State, f: Doubles, nu: Any = None) -> dict[str, Array]:
        """Return the results of a function of its kernel on the coordinates of the bodies, by name.

        With multipliers `nu` of all rows those of its own are taken.
        """
        e = self.exact if f.exact else self.element

        def given(x: Array) -> list[Any]:
            return [x[..., k][()] if k >= 0 else 0.0 for k in self.own]

        q, u, a, time = state
        arguments = [given(q), given(u), e.parameters, signals_at(e.laws, time) if e.laws else ()]
        if function == "linearize" and e.takes_acceleration:
            arguments.append(given(a))
        elif function == "linearize" and e.rows:
            arguments.append([0.0 if nu is None else nu[i] for i in e.rows])
        n, m = q.shape[-1], len(e.rows)
        shapes = (
            {key: (n, n) for key in "MKR"} | {"F": (n,)} | {key: (m,) for key in "EVB"} | {key: (m, n) for key in "JD"}
        )
        found = {key: f.zeros((*q.shape[:-1], *shapes[key])) for key in OF_FUNCTION[function]}
        values = tuple(getattr(e.kernel, function)(f.f, *arguments))
        for key, place, k in self._places(function):
            found[key][place] += values[k]
        return found

    def _places(self, function: str) -> list[tuple[str, tuple[Any, ...], int]]:
        """Return matrix, entry and number of each result of a function that is asked for."""
        if function not in self._known:
            self._known[function], k = [], -1
            for key, entries in getattr(self.element.kernel, function.upper()).items():
                for index in entries:
                    k += 1
                    first = index[0] if key in "EVBJD" else self.own[index[0]]
                    place = (first, *(self.own[i] for i in index[1:]))
                    if key in OF_FUNCTION[function] and min(place) >= 0:
                        self._known[function].append((key, (..., *place), k))
        return self._known[function]

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


class Cluster:
    """Bodies and states that some elements have in common, with all rows on them."""

    def __init__(self, blocks: Sequence[Block], exact: Callable[[], Sequence[Block]]) -> None:
        self.blocks, self._given = list(blocks), exact
        self.columns = [i for b in self.blocks for i in range(b.part.start, b.part.stop)]
        self.fields = [k for b in self.blocks for k in b.fields]
        self.elements, self.rows, self.visited = list[Local](), list[Local](), list[list[Changes]]()
        self.owners: list[tuple[Local, int]] = []

    @cached_property
    def exact_blocks(self) -> list[Block]:
        """The same blocks with bases in balls."""
        return [b._replace(base=tuple(map(plain_ball, b.base))) for b in self._given()]

    @cached_property
    def key(self) -> tuple[Any, ...]:
        """What clusters that do the same have in common."""
        bodies = tuple((b.kind, *map(float, b.base)) for b in self.blocks)
        return bodies, tuple(x.key for x in self.elements), tuple(x.key for x in self.rows)

    @property
    def least(self) -> int:
        """How many equations a state gives."""
        return sum(len(x.element.rows) or len(self.columns) for x in self.elements)

    @property
    def still(self) -> bool:
        """Whether its elements are rows on positions alone."""
        return all(x.holonomic for x in self.elements)

    @property
    def written(self) -> bool:
        """Whether the file writes some of what it contains."""
        return any(x.written for x in (*self.elements, *self.rows))

    def residuals(self, level: str, state: State, f: Doubles) -> tuple[Array, Array]:
        """Return the residuals of its rows, on positions with level ``E``, of all with ``V``, and their derivatives."""
        found = [x.run("dynamics", state, f) for x in self.rows if level == "V" or x.holonomic]
        left, J = ([at[key] for at in found] for key in (level, "J"))
        if not found:
            return f.zeros((*state[0].shape[:-1], 0)), f.zeros((*state[0].shape[:-1], 0, len(self.columns)))
        return np.concatenate(left, axis=-1), np.concatenate(J, axis=-2)

    def changes(self, state: State, f: Doubles) -> Changes:
        """Return what its fields do to its elements at states."""
        X, slopes = self._fields(state, f)
        parts = [_changes(x, state, X, slopes, f) for x in self.elements]
        self.owners = [(x, part.along[0].shape[-2]) for x, part in zip(self.elements, parts, strict=True)]
        return _joined(parts)

    def _fields(self, state: State, f: Doubles) -> tuple[list[Array], Slopes]:
        """Return its fields with their derivatives at states."""
        q, u, a, _ = state
        lead, n, k = q.shape[:-1], len(self.columns), len(self.fields)
        X = [f.zeros((*lead, n, k)) for _ in range(3)]
        slopes = []
        i = j = 0
        moving = not self.still or not all(x.analytic for x in self.elements)
        for b in self.exact_blocks if f.exact else self.blocks:
            m = b.part.stop - b.part.start
            here, fields = slice(i, i + m), slice(j, j + SIZES[b.kind])
            values = field_values(b, q[..., here], *((u[..., here], a[..., here]) if moving else ()))
            for x, value in zip(X, values, strict=False):
                x[..., here, fields] = value
            slopes.append((here, fields, values.slope))
            i, j = i + m, j + SIZES[b.kind]
        return X, slopes

    def later(self, state: State, step: Fraction) -> Array:
        """Return the derivatives by time of the rows of `changes` at the same state in balls, by a difference."""
        h, parts = as_ball(step.numerator) / step.denominator, []
        for own, rows in self.owners:
            change = BALLS.zeros((rows,))
            if own.analytic:
                key = ("E" if own.holonomic else "V") if own.element.rows else "F"
                ends = [own.run("dynamics", (*state[:3], now), BALLS)[key] for now in (state[3] + h, state[3] - h)]
                change = (ends[0] - ends[1]) / (2 * h)
            parts.append(change)
        return np.concatenate(parts)


class Whole(Cluster):
    """A whole scene: the forces of all elements count together, as far as its rows do not balance them."""

    def __init__(self, blocks: Sequence[Block], exact: Callable[[], Sequence[Block]], sizes: Array) -> None:
        super().__init__(blocks, exact)
        self.sizes = sizes

    @property
    def least(self) -> int:
        """How many equations a state gives at least."""
        return len(self.columns)

    def changes(self, state: State, f: Doubles) -> Changes:
        """Return what its fields do at states, with the accelerations and multipliers of the motions through them."""
        q, u, _, time = state
        if q.ndim == 1:
            return self._balanced(q, u, time, f)
        found = [self._balanced(one, other, time, f) for one, other in zip(q, u, strict=True)]
        kinds = ([np.stack(x) for x in zip(*kind, strict=True)] for kind in zip(*found, strict=True))
        return Changes(*((value, size) for value, size in kinds))

    def _balanced(self, q: Array, u: Array, time: Any, f: Doubles) -> Changes:
        n, smooth = len(self.columns), [x for x in self.elements if x.analytic]
        at = [x.run("dynamics", (q, u, 0 * q, time), f) for x in smooth]
        M, F = sum((x["M"] for x in at), f.zeros((n, n))), sum((x["F"] for x in at), f.zeros((n,)))
        rows = [x for x, own in zip(at, smooth, strict=True) if own.element.rows]
        J = np.concatenate([x["J"] for x in rows]) if rows else f.zeros((0, n))
        B = np.concatenate([x["B"] for x in rows]) if rows else f.zeros((0,))
        kept = _independent(middle(J) * self.sizes)
        matrix = f.zeros((n + len(kept), n + len(kept)))
        matrix[:n, :n], matrix[n:, :n], matrix[:n, n:] = M, J[kept], J[kept].T
        x = f.solved(matrix, np.concatenate([-F, -B[kept]])[:, None])[:, 0]
        numbers = [i for own in smooth for i in own.element.rows]
        nu = dict.fromkeys(numbers, 0.0) | {numbers[k]: y for k, y in zip(kept, x[n:], strict=True)}
        state = q, u, f.settled(x[:n]), time
        X, slopes = self._fields(state, f)
        rates = [own.run("linearize", state, f, nu) for own in smooth if not own.holonomic or own.element.rows]
        K, R = (sum((x[key] for x in rates), f.zeros((n, n))) for key in "KR")
        value, size = f.products((K, X[0]), (R, X[1]), (M, X[2]))
        if kept:
            weighted = J[kept] * self.sizes**2
            pulled = f.solved(f.multiplied(weighted, J[kept].T), f.multiplied(weighted, value))
            value = value - f.multiplied(J[kept].T, pulled)
            # Reactions mix what acts on coordinates.
            unit = np.log2(self.sizes)[:, None]
            size = np.max(size + unit, axis=0) - unit
        if f.exact:  # a weak force must not be lost beside those of all others
            size = size - TOLERANCES.bits_of_weak_forces
        found = [Changes(*[(value, size)] * 4)]
        found += [_changes(own, state, X, slopes, f) for own in self.elements if own.element.rows or not own.analytic]
        return _joined(found)


def _independent(J: Array) -> list[int]:
    """Return the numbers of independent rows."""
    left, kept = J / np.maximum(np.linalg.norm(J, axis=1), 1e-300)[:, None], list[int]()
    while len(kept) < len(J):
        lengths = np.linalg.norm(left, axis=1)
        k = int(np.argmax(lengths))
        if not lengths[k] > TOLERANCES.row_dependence:
            break
        kept.append(k)
        unit = left[k] / lengths[k]
        left = left - np.outer(left @ unit, unit)
    return sorted(kept)


Slopes = Sequence[tuple[slice, slice, Array]]


def _joined(parts: Sequence[Changes]) -> Changes:
    """Return changes of several elements, one below the other."""
    kinds = ([np.concatenate(x, axis=-2) for x in zip(*kind, strict=True)] for kind in zip(*parts, strict=True))
    return Changes(*((value, size) for value, size in kinds))


def _changes(own: Local, state: State, fields: Sequence[Array], slopes: Slopes, f: Doubles) -> Changes:
    """Return what fields, given with their derivatives at states, do to an element."""
    X, X1, X2 = fields
    if not own.analytic:
        return _untouched(own, X, slopes, f)
    at = own.run("dynamics", state, f)
    if own.holonomic:
        along = f.products((at["J"], X))
        return Changes(along, along, _none(along), along)
    rates = own.run("linearize", state, f)
    if own.element.rows:
        against = f.products((at["J"], X))
        held = _none(against) if own.of_state else against
        return Changes(f.products((rates["D"], X), (at["J"], X1)), against, _none(against), held)
    force = at["F"] + f.multiplied(at["M"], state[2][..., None])[..., 0]
    total, size = f.products((rates["K"], X), (rates["R"], X1), (at["M"], X2))
    for here, part, slope in slopes:
        # (DX)ᵀ F acts on all coordinates of the body.
        m, count = here.stop - here.start, part.stop - part.start
        bent, terms = f.products((force[..., None, here], slope.reshape(*X.shape[:-2], m, m * count)))
        total[..., here, part] += bent.reshape(*X.shape[:-2], m, count)
        size[..., here, part] = np.maximum(size[..., here, part], terms.reshape(*X.shape[:-2], m, count))
    driven = f.products((rates["R"], X))
    work = _none(driven) if own.element.takes_acceleration else f.products((at["F"][..., None, :], X))
    return Changes((total, size), driven, work, _none(driven))


def _untouched(own: Local, X: Array, slopes: Slopes, f: Doubles) -> Changes:
    """Return the changes of the coordinates and speeds that an element contains, in place of its own changes."""
    places, speeds = own.contained
    rows = [X[..., places, :]]
    for here, part, slope in slopes:
        bent = slope[..., [i - here.start for i in speeds if here.start <= i < here.stop], :, :]
        spread = f.zeros((*X.shape[:-2], bent.shape[-3] * bent.shape[-2], X.shape[-1]))
        spread[..., part] = bent.reshape(*spread.shape[:-1], -1)
        rows.append(spread)
    moved, held = np.concatenate(rows, axis=-2), X[..., speeds, :]
    one, other = (moved, f.powers(moved)), (held, f.powers(held))
    of_rows = bool(own.element.rows)
    return Changes(
        one, other, _none(other) if of_rows else other, other if of_rows and not own.of_state else _none(other)
    )


def _none(x: Sized) -> Sized:
    """Return a matrix without rows."""
    return x[0][..., :0, :], x[1][..., :0, :]
