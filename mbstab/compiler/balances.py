"""Balances of forces along motions without mass, as constraint rows.

Along a direction d without mass, which no constraint sees, the forces F0 balance: dᵀF0 = 0. Where dᵀF0 does not depend
on the speeds, this is a holonomic row g(q) = 0; else a nonholonomic one, of first order. As rows of the equations of
motion they keep the balance like constraints, with multipliers that vanish, as the equation of motion along d itself
is the balance. What they leave carries mass.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from itertools import chain
from typing import Any

from mbstab.compiler.placed import Placed
from mbstab.mechanics.catalogue import Role
from mbstab.model.arithmetic import Arithmetic
from mbstab.model.duals import Dual, dual_arithmetic
from mbstab.records import dataclass


@dataclass(frozen=True)
class Share:
    """What an element contributes to a balance: its weights for the entries of its own force and coordinates.

    Attributes
    ----------
    kernel : kernel of the element
    columns : tuple of int
        Places of its coordinates among those of the balance.
    weights : tuple of float
        Component of the direction along each of its coordinates.
    parameters : tuple of int
        Its numbers among those of the balance.
    signals : tuple of int
        Its given functions, their rates and their second derivatives among those of the balance.
    """

    kernel: Any
    columns: tuple[int, ...]
    weights: tuple[float, ...]
    parameters: tuple[int, ...]
    signals: tuple[int, ...]

    def of(self, x: Sequence[Any]) -> list[Any]:
        """Return its coordinates, speeds or accelerations."""
        return [x[i] for i in self.columns]

    def force(self, f: Arithmetic, q: Any, u: Any, p: Any, s: Any) -> Any:
        """Return its force along the direction."""
        own = self.of(q), self.of(u), [p[i] for i in self.parameters], [s[i] for i in self.signals]
        values = self.kernel.dynamics(f, *own)
        return _sum(
            self.weights[i] * x for (i,), x in zip(self.kernel.DYNAMICS["F"], values, strict=True) if self.weights[i]
        )

    def slopes(self, f: Arithmetic, q: Any, u: Any, p: Any, s: Any) -> tuple[list[Any], list[Any]]:
        """Return the slopes of this force by all coordinates and speeds of the balance."""
        own = self.of(q), self.of(u), [p[i] for i in self.parameters], [s[i] for i in self.signals]
        values = iter(self.kernel.linearize(f, *own))
        found: dict[str, list[Any]] = {key: [0.0] * len(q) for key in "KR"}
        for key, entries in self.kernel.LINEARIZE.items():
            for i, j in entries:
                value = next(values)
                if self.weights[i]:
                    found[key][self.columns[j]] = found[key][self.columns[j]] + self.weights[i] * value
        return found["K"], found["R"]


class Balance:
    """The kernel of a balance: functions as those of generated kernels (`mbstab.compiler.derive`).

    Parameters
    ----------
    shares : tuple of Share
    count : int
        Number of coordinates of the balance.
    role : str
        ``holonomic`` or ``nonholonomic``.
    """

    __name__ = "balance"

    def __init__(self, shares: tuple[Share, ...], count: int, role: Role) -> None:
        self.shares, self.count, self.first_order = shares, count, role == "nonholonomic"
        row = tuple((0, i) for i in range(count))
        self.DYNAMICS = {"E": ((0,),), "V": ((0,),), "J": row, "B": ((0,),)}
        self.LINEARIZE = {"D": row} if self.first_order else {}
        self.LINEARIZE_ROWS = {"V_q": row, "A_q": row, "A_u": row}

    def dynamics(self, f: Arithmetic, q: Any, u: Any, p: Any, s: Any) -> tuple[Any, ...]:
        """Return E, V, J and B."""
        rest = u if self.first_order else [0.0] * self.count
        K, R = self._slopes(f, q, rest, p, s)
        E = _sum(share.force(f, q, rest, p, s) for share in self.shares)
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
            return _sum(share.force(f, q, u, p, s) for share in self.shares)
        return _product(self._slopes(f, q, [0.0] * self.count, p, s)[0], u)

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
        parts = [share.slopes(f, q, u, p, s) for share in self.shares]
        K, R = ([_sum(part[k][i] for part in parts) for i in range(self.count)] for k in (0, 1))
        return K, R


def _sum(values: Any) -> Any:
    total: Any = 0.0
    for x in values:
        total = total + x
    return total


def _product(one: Sequence[Any], other: Sequence[Any]) -> Any:
    return _sum(x * y for x, y in zip(one, other, strict=True))


def balance_of(direction: Mapping[int, float], role: Role, elements: Iterable[Placed], path: str, row: int) -> Placed:
    """Return the balance along a direction, given by numbers of coordinates, of all elements that act along it."""
    acting = [
        e for e in elements if not (e.rows or e.takes_acceleration) and not direction.keys().isdisjoint(e.columns)
    ]
    columns = tuple(dict.fromkeys(i for e in acting for i in e.columns))
    laws = tuple(law for e in acting for law in e.laws)
    shares, numbers, known = [], 0, 0
    for e in acting:
        places = [range(k * len(laws) + known, k * len(laws) + known + len(e.laws)) for k in range(3)]
        shares.append(
            Share(
                e.kernel,
                tuple(map(columns.index, e.columns)),
                tuple(direction.get(i, 0.0) for i in e.columns),
                tuple(range(numbers, numbers + len(e.parameters))),
                tuple(chain.from_iterable(places)),
            )
        )
        numbers, known = numbers + len(e.parameters), known + len(e.laws)
    parameters = tuple(x for e in acting for x in e.parameters)
    return Placed(_kernel(tuple(shares), len(columns), role), columns, (row,), parameters, laws, False, path)


@lru_cache(maxsize=64)
def _kernel(shares: tuple[Share, ...], count: int, role: Role) -> Balance:
    # The same kernel for the same contents: plans are kept by kernel.
    return Balance(shares, count, role)
