"""Measures in expressions: kernels of their own give them with their derivatives, from which expressions are derived.

A measure such as ``angle(pivot)`` contains all coordinates of its bodies, an expression a few measures. An expression
is derived by its measures alone; the derivatives of these by coordinates are inputs of its kernel.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from mbstab.compiler import kernels
from mbstab.compiler.measured import Measured
from mbstab.mechanics.measures import parts
from mbstab.model.arithmetic import Arithmetic

if TYPE_CHECKING:
    from mbstab.compiler.derive import Moving
    from mbstab.compiler.tape import Term

_FUNCTIONS = ("dynamics", "linearize", "linearize_rows")


class MeasureKernel:
    """The kernel of a measure, and its places in that of an expression.

    Parameters
    ----------
    measure : Measured
    prefix : str
        With which the names of its inputs begin.
    number : dict
        Numbers of the coordinates of the expression, which are the last of its kernel, by name.
    place : int
        Of its first number among those of the kernel of the expression, counted from their end.
    """

    def __init__(self, measure: Measured, prefix: str, number: dict[str, int], place: int) -> None:
        self.name, self._kind, self._prefix = measure.name, measure.kind, prefix
        frame, size = (("planar", 3), ("spatial", 6))[measure.dimension - 2]
        self._kernel = kernels.load(f"{frame}_measure_{parts(measure.name)[0]}")
        # None: a coordinate that the body does not have, or of the ground.
        columns = [[number[x] for x in body] + [None] * (size - len(body)) for body in measure.bodies]
        self._columns = [None if i is None else i - len(number) for body in columns for i in body]
        # None: a number of the base rotation that the body does not have.
        numbers: list[int | None] = []
        for base in measure.bases:
            own = 9 if measure.dimension == 3 else 0
            numbers += range(place, place + base) if base else [None] * own
            place += base
        self._numbers = [*numbers, *range(place, place + measure.count)]
        self._tables = {
            function: {key: table for key, table in getattr(self._kernel, function.upper()).items() if table}
            for function in _FUNCTIONS
        }

    def inputs(self) -> list[str]:
        """Return the names of all that its kernel gives, in order."""
        tables = (self._tables[function] for function in _FUNCTIONS)
        return [self._input(key, index) for own in tables for key, table in own.items() for index in table]

    def _input(self, key: str, index: tuple[int, ...]) -> str:
        return "_".join((self._prefix + key, *map(str, index)))

    def on(self, motion: Moving) -> tuple[Term, Term]:
        """Return the measure and its rate on a tape; a speed is both.

        Parameters
        ----------
        motion : Moving
            Learns how the inputs change.
        """
        tape = motion.tape
        motion.seen += self.inputs()
        columns = {c: i for c, i in enumerate(self._columns) if i is not None}
        zero = tape.term(0)

        def found(function: str, key: str) -> dict[tuple[int, ...], Term]:
            return {x: tape.input(self._input(key, x)) for x in self._tables[function].get(key, ())}

        def row(function: str, key: str) -> dict[int, Term]:
            return {c: x for (_, c), x in found(function, key).items() if c in columns}

        value, rate = (found("dynamics", key).get((0,), zero) for key in "EV")
        drift = found("dynamics", "B").get((0,), zero)
        J = row("dynamics", "J")
        V_q, A_q, A_u = (row("linearize_rows", key) for key in ("V_q", "A_q", "A_u"))
        if self._kind.speed:
            rate = value
            along, by_speed = [(value, V_q)], [(value, J)]
            motion.drift[value] = drift
        else:
            along, by_speed = [(value, J), (rate, V_q)], [(rate, J)]
            motion.drift |= {value: rate, rate: drift}
        for c, x in J.items():
            own = {j: y for (i, j), y in found("linearize", "K").items() if i == c and j in columns}
            along.append((x, own))
            # Derivatives of accelerations by speeds are those of the rates by coordinates, and the rates of J.
            motion.drift[x] = A_u.get(c, zero) - V_q.get(c, zero) if self._kind.speed else V_q.get(c, zero)
        motion.drift |= {x: A_q.get(c, zero) for c, x in V_q.items()}
        for changes, directions in ((along, motion.along), (by_speed, motion.by_speed)):
            for term, slopes in changes:
                for c, slope in slopes.items():
                    rates = directions[columns[c]]
                    rates[term] = rates.get(term, zero) + slope
        if not self._kind.root:
            return value, rate
        size = tape.norm(value + value, J.values())
        return size, rate / size

    def values(self, f: Arithmetic, function: str, q: Any, u: Any, p: Any, a: Any) -> list[Any]:
        """Return the inputs that a function of the kernel of the expression needs; zeros for the others."""
        zero, one = f.number("0"), f.number("1")
        identity = [one if k % 4 == 0 else zero for k in range(9)]
        numbers = [identity[k % 9] if i is None else p[i] for k, i in enumerate(self._numbers)]
        q, u = ([zero if i is None else x[i] for i in self._columns] for x in (q, u))
        kernel, own = self._kernel, list[Any]()
        for name in _FUNCTIONS:
            if name == "dynamics":
                own += kernel.dynamics(f, q, u, numbers, ())
            elif function == "dynamics" or (name, function) == ("linearize", "linearize_rows"):
                own += [zero] * sum(map(len, self._tables[name].values()))
            elif name == "linearize":
                own += kernel.linearize(f, q, u, numbers, (), (one,))
            else:
                rates = [zero if i is None or a is None else a[i] for i in self._columns]
                own += kernel.linearize_rows(f, q, u, numbers, (), rates)
        return own
