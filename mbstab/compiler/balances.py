"""Balances of forces along motions without mass, as constraint rows.

Along a direction d without mass that the constraints allow the forces F0 balance: dᵀF0 = 0. Where dᵀF0 does not depend
on the speeds, this is a holonomic row g(q) = 0; else a nonholonomic one, of first order. As rows of the equations of
motion they keep the balance like constraints, with multipliers that vanish, as the equation of motion along d itself
is the balance. What they leave carries mass.

Constraints may tie coordinates without mass to each other, as a hinge does those of a lever. Then d depends on q: with
given components d_f along some of the coordinates, the others follow from the rows, J_p d_p = −J_f d_f.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import lru_cache
from itertools import chain
from typing import Any

from mbstab.compiler.placed import Placed
from mbstab.compiler.scatter import by_entry
from mbstab.mechanics.catalogue import Role
from mbstab.model.arithmetic import Arithmetic
from mbstab.model.duals import Dual, dual_arithmetic
from mbstab.model.scene import BalanceValues
from mbstab.records import dataclass

Given = tuple[tuple[int, float], ...]
"""Components of a direction, by places of coordinates."""


@dataclass(frozen=True)
class Part:
    """An element of the scene in a balance, by its places there.

    Attributes
    ----------
    kernel : kernel of the element
    columns : tuple of int
        Places of its coordinates among those of the balance.
    parameters : tuple of int
        Its numbers among those of the balance.
    signals : tuple of int
        Its given functions, their rates and their second derivatives among those of the balance.
    """

    kernel: Any
    columns: tuple[int, ...]
    parameters: tuple[int, ...]
    signals: tuple[int, ...]

    def entries(self, function: str, f: Arithmetic, q: Any, u: Any, p: Any, s: Any) -> Iterator[tuple[str, Any, Any]]:
        """Yield the results of a function of the kernel with their names and indices."""
        groups = (q, self.columns), (u, self.columns), (p, self.parameters), (s, self.signals)
        own = ([x[i] for i in places] for x, places in groups)
        return by_entry(self.kernel, function, getattr(self.kernel, function)(f, *own))


@dataclass(frozen=True)
class Share(Part):
    """What an element contributes to a balance: its force."""

    def force(self, direction: Mapping[int, Any], f: Arithmetic, q: Any, u: Any, p: Any, s: Any) -> Any:
        """Return its force along a direction, given by its components at coordinates of the balance."""
        found = ((direction.get(self.columns[i]), x) for _, (i,), x in self.entries("dynamics", f, q, u, p, s))
        return _sum(weight * x for weight, x in found if weight is not None)

    def slopes(
        self, direction: Mapping[int, Any], f: Arithmetic, q: Any, u: Any, p: Any, s: Any
    ) -> tuple[list[Any], list[Any]]:
        """Return the slopes of this force by all coordinates and speeds of the balance."""
        found: dict[str, list[Any]] = {key: [0.0] * len(q) for key in "KR"}
        for key, (i, j), value in self.entries("linearize", f, q, u, p, s):
            weight = direction.get(self.columns[i])
            if weight is not None:
                found[key][self.columns[j]] = found[key][self.columns[j]] + weight * value
        return found["K"], found["R"]


@dataclass(frozen=True)
class Tie(Part):
    """Constraint rows that tie coordinates without mass to each other.

    Attributes
    ----------
    rows : tuple of int or None
        The order in which its rows are eliminated; None: not needed, as others say the same.
    """

    rows: tuple[int | None, ...]

    def slopes(self, f: Arithmetic, q: Any, u: Any, p: Any, s: Any) -> Iterator[tuple[int, int, Any]]:
        """Yield row, coordinate and entry of J."""
        for key, index, value in self.entries("dynamics", f, q, u, p, s):
            if key == "J" and (row := self.rows[index[0]]) is not None:
                yield row, self.columns[index[1]], value


@dataclass(frozen=True)
class Tied:
    """How a direction follows from constraint rows.

    Attributes
    ----------
    ties : tuple of Tie
    dependent : tuple of int
        Places of the coordinates that follow, in the order in which they are eliminated.
    """

    ties: tuple[Tie, ...]
    dependent: tuple[int, ...]

    def direction(self, given: Mapping[int, float], f: Arithmetic, q: Any, u: Any, p: Any, s: Any) -> Mapping[int, Any]:
        """Return all components by places of coordinates: by Gaussian elimination in a fixed order."""
        n = len(self.dependent)
        place = {column: k for k, column in enumerate(self.dependent)}
        A, b = [[0.0] * n for _ in range(n)], [0.0] * n
        for tie in self.ties:
            for i, column, value in tie.slopes(f, q, u, p, s):
                if column in place:
                    A[i][place[column]] = A[i][place[column]] + value
                elif column in given:
                    b[i] = b[i] - given[column] * value
        for k in range(n):
            for i in range(k + 1, n):
                if A[i][k].__class__ is float and A[i][k] == 0.0:
                    continue
                factor = A[i][k] / A[k][k]
                A[i] = [x - factor * y for x, y in zip(A[i], A[k], strict=True)]
                b[i] = b[i] - factor * b[k]
        found: list[Any] = [0.0] * n
        for k in reversed(range(n)):
            found[k] = (b[k] - _sum(A[k][j] * found[j] for j in range(k + 1, n))) / A[k][k]
        return {**given, **dict(zip(self.dependent, found, strict=True))}


class Balance:
    """The kernel of a balance: functions as those of generated kernels (`mbstab.compiler.derive`).

    Parameters
    ----------
    shares : tuple of Share
    given : tuple of (int, float)
        Components of the direction, by places of coordinates of the balance.
    count : int
        Number of coordinates of the balance.
    role : str
        ``holonomic`` or ``nonholonomic``.
    tied : Tied or None
        How its other components follow from constraints; None: there are none.
    """

    __name__ = "balance"

    def __init__(self, shares: tuple[Share, ...], given: Given, count: int, role: Role, tied: Tied | None) -> None:
        self.shares, self.given, self.tied = shares, dict(given), tied
        self.count, self.first_order = count, role == "nonholonomic"
        row = tuple((0, i) for i in range(count))
        self.DYNAMICS = {"E": ((0,),), "V": ((0,),), "J": row, "B": ((0,),)}
        self.LINEARIZE = {"D": row} if self.first_order else {}
        self.LINEARIZE_ROWS = {"V_q": row, "A_q": row, "A_u": row}

    def dynamics(self, f: Arithmetic, q: Any, u: Any, p: Any, s: Any) -> tuple[Any, ...]:
        """Return E, V, J and B."""
        rest = u if self.first_order else [0.0] * self.count
        K, R = self._slopes(f, q, rest, p, s)
        E = self._force(f, q, rest, p, s)
        zero = [0.0] * self.count
        if self.first_order:
            return E, E, *R, _product(K, u)
        return E, _product(K, u), *K, self._acceleration(f, q, u, zero, p, s)

    def linearize(self, f: Arithmetic, q: Any, u: Any, p: Any, s: Any, nu: Any) -> tuple[Any, ...]:
        """Return D_q; the multiplier is zero, and so is what it contributes to K and R."""
        return tuple(self._slopes(f, q, u, p, s)[0]) if self.first_order else ()

    def linearize_rows(self, f: Arithmetic, q: Any, u: Any, p: Any, s: Any, a: Any) -> tuple[Any, ...]:
        """Return V_q, A_q and A_u."""
        V_q = [self._slope(f, (q, u, a), 0, i, p, s, False) for i in range(self.count)]
        A_q, A_u = ([self._slope(f, (q, u, a), k, i, p, s, True) for i in range(self.count)] for k in (0, 1))
        return *V_q, *A_q, *A_u

    def _velocity(self, f: Arithmetic, q: Any, u: Any, p: Any, s: Any) -> Any:
        if self.first_order:
            return self._force(f, q, u, p, s)
        return _product(self._slopes(f, q, [0.0] * self.count, p, s)[0], u)

    def _force(self, f: Arithmetic, q: Any, u: Any, p: Any, s: Any) -> Any:
        """Return the force along the direction."""
        direction = self.given if self.tied is None else self.tied.direction(self.given, f, q, u, p, s)
        return _sum(share.force(direction, f, q, u, p, s) for share in self.shares)

    def _acceleration(self, f: Arithmetic, q: Any, u: Any, a: Any, p: Any, s: Any) -> Any:
        """Return d²g/dt², or the rate of the balance of first order."""
        if self.first_order:
            K, R = self._slopes(f, q, u, p, s)
            return _product(K, u) + _product(R, a)
        along = [Dual(x, y) for x, y in zip(q, u, strict=True)]
        rest, numbers, signals = ([Dual(x, 0.0) for x in y] for y in ([0.0] * self.count, p, s))
        K, _ = self._slopes(dual_arithmetic(f), along, rest, numbers, signals)
        slopes = [Dual.of(x) for x in K]
        return _product([x.value for x in slopes], a) + _product([x.slope for x in slopes], u)

    def _slope(self, f: Arithmetic, state: Any, which: int, i: int, p: Any, s: Any, second: bool) -> Any:
        """Return the slope of the velocity or acceleration residual by one coordinate or speed."""
        q, u, a = (
            [Dual(x, float(k == which and j == i)) for j, x in enumerate(group)] for k, group in enumerate(state)
        )
        numbers, signals = ([Dual(x, 0.0) for x in y] for y in (p, s))
        duals = dual_arithmetic(f)
        if second:
            return Dual.of(self._acceleration(duals, q, u, a, numbers, signals)).slope
        return Dual.of(self._velocity(duals, q, u, numbers, signals)).slope

    def _slopes(self, f: Arithmetic, q: Any, u: Any, p: Any, s: Any) -> tuple[list[Any], list[Any]]:
        """Return the slopes of the force along the direction by all coordinates and speeds."""
        if self.tied is not None:
            numbers, signals = ([Dual(x, 0.0) for x in y] for y in (p, s))
            found: list[list[Any]] = [[], []]
            duals = dual_arithmetic(f)
            for which in range(2 if self.first_order else 1):
                for i in range(self.count):
                    places, speeds = (
                        [Dual(x, float(k == which and j == i)) for j, x in enumerate(y)] for k, y in enumerate((q, u))
                    )
                    found[which].append(Dual.of(self._force(duals, places, speeds, numbers, signals)).slope)
            return found[0], found[1]
        parts = [share.slopes(self.given, f, q, u, p, s) for share in self.shares]
        K, R = ([_sum(part[k][i] for part in parts) for i in range(self.count)] for k in (0, 1))
        return K, R


def _sum(values: Any) -> Any:
    total: Any = 0.0
    for x in values:
        total = total + x
    return total


def _product(one: Sequence[Any], other: Sequence[Any]) -> Any:
    return _sum(x * y for x, y in zip(one, other, strict=True))


def balance_of(
    values: BalanceValues, names: Sequence[str], role: Role, elements: Iterable[Placed], path: str, row: int
) -> Placed:
    """Return the balance of all elements that act along a direction, in a scene whose coordinates have these names."""
    number = {name: i for i, name in enumerate(names)}
    direction = {number[name]: x for name, x in values.direction.items()}
    tied = [(number[name], tie) for name, tie in values.tied]
    moving = {*direction, *(column for column, _ in tied)}
    order = {row: k for k, (_, row) in enumerate(tied)}
    acting, tying = list[Placed](), list[Placed]()
    for e in elements:
        if e.rows:
            tying += [e] if not order.keys().isdisjoint(e.rows) else []
        elif not e.takes_acceleration and not moving.isdisjoint(e.columns):
            acting.append(e)
    columns = tuple(dict.fromkeys(i for e in (*acting, *tying) for i in e.columns))
    laws = tuple(law for e in (*acting, *tying) for law in e.laws)
    shares, ties, numbers, known = list[Share](), list[Tie](), 0, 0
    for e in (*acting, *tying):
        own, places = tuple(range(numbers, numbers + len(e.parameters))), tuple(map(columns.index, e.columns))
        ranges = [range(k * len(laws) + known, k * len(laws) + known + len(e.laws)) for k in range(3)]
        numbers, known, signals = numbers + len(e.parameters), known + len(e.laws), tuple(chain.from_iterable(ranges))
        if e.rows:
            ties.append(Tie(e.kernel, places, own, signals, tuple(map(order.get, e.rows))))
        else:
            shares.append(Share(e.kernel, places, own, signals))
    given = tuple((columns.index(i), x) for i, x in direction.items() if i in columns)
    following = Tied(tuple(ties), tuple(columns.index(i) for i, _ in tied)) if tied else None
    kernel = _kernel(tuple(shares), given, len(columns), role, following)
    parameters = tuple(x for e in (*acting, *tying) for x in e.parameters)
    return Placed(kernel, columns, (row,), parameters, laws, False, path)


@lru_cache(maxsize=64)
def _kernel(shares: tuple[Share, ...], given: Given, count: int, role: Role, tied: Tied | None) -> Balance:
    # The same kernel for the same contents: plans are kept by kernel.
    return Balance(shares, given, count, role, tied)
