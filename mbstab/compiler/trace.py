"""Numbers that write down what is done with them: one straight-line program for a whole scene.

`System.dynamics` on traced coordinates runs every kernel once and leaves a `Trace`: each
operation on something that is not known before the state is, in order. Everything else is
a Python float and is done at once: parameters, coordinates of the ground, entries that are
the same at every state.

Two steps are the same if their residues are, as in `mbstab.compiler.tape`: each step is also
computed at one random state in the integers modulo a prime. So what several elements compute,
each in its own way, is computed once; what vanishes or is constant by the rules of
arithmetic and by sin² + cos² = 1 costs nothing. Rounding is that of the kernels otherwise: no operation
is moved.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from fractions import Fraction
from typing import Any

from mbstab.compiler.tape import PRIME, half_angle, random_residue, residue
from mbstab.model.arithmetic import CONSTANTS, FLOAT, Arithmetic, as_float
from mbstab.model.functions import NATIVE, TABLE
from mbstab.records import dataclass

MAX_LINE = 100
"""Maximum length of a text that is inserted at the place of its use."""
MAX_FACTORS = 4
"""Higher powers are left to the arithmetic."""

OPERATIONS = ("+", "-", "*", "/", "negative", "power", *NATIVE)
"""The operations that `Code` numbers."""


@dataclass(frozen=True)
class Code:
    """A program as numbers, for an interpreter.

    Registers hold the inputs, the constants, and then one result of each operation.

    Attributes
    ----------
    inputs : int
        How many.
    runs : list of (int, int)
        Index into `OPERATIONS` of each run of equal operations, and how many operations are done after it.
    operands : list of (int, int)
        Registers that each operation takes; the second repeats the first where it takes one.
    constants : list of float
    results : list of (int, bool)
        Register of each output, and whether its negative is meant.
    ends : list of int
        How many runs each group of outputs needs, those before it included.
    """

    inputs: int
    runs: list[tuple[int, int]]
    operands: list[tuple[int, int]]
    constants: list[float]
    results: list[tuple[int, bool]]
    ends: list[int]


@dataclass(frozen=True, slots=True)
class Step:
    """An input (``operands`` holds its name), or an operation on numbers and earlier steps."""

    operation: str
    operands: tuple[Any, ...]


class Traced:
    """A step or its negative, as a number.

    Attributes
    ----------
    trace : Trace
    step : int
    negative : bool
    """

    __slots__ = ("negative", "step", "trace")

    def __init__(self, trace: Trace, step: int, negative: bool = False) -> None:
        self.trace = trace
        self.step = step
        self.negative = negative

    def __neg__(self) -> Traced:
        return Traced(self.trace, self.step, not self.negative)

    def __add__(self, other: Any) -> Any:
        return self.trace.sum(self, other)

    __radd__ = __add__

    def __sub__(self, other: Any) -> Any:
        return self.trace.sum(self, -other)

    def __rsub__(self, other: Any) -> Any:
        return self.trace.sum(-self, other)

    def __mul__(self, other: Any) -> Any:
        return self.trace.product(self, other)

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Any:
        return self.trace.quotient(self, other)

    def __rtruediv__(self, other: Any) -> Any:
        return self.trace.quotient(other, self)

    def __pow__(self, exponent: int) -> Any:
        return self.trace.power(self, exponent)


class Trace:
    """A growing program on floats.

    Attributes
    ----------
    steps : list of Step
        Each after those it uses.
    """

    def __init__(self) -> None:
        self.steps: list[Step] = []
        self._residues: list[int] = []
        self._constants: dict[float, int] = {}
        self._known: dict[int, tuple[int, Traced | float]] = {}
        self._residue(1.0)

    def input(self, name: str) -> Traced:
        """Return the input of that name."""
        traced: Traced = self._put(random_residue(name), "input", name)
        return traced

    def sum(self, x: Any, y: Any) -> Any:
        """Return x + y."""
        if _is_number(x, 0.0) or _is_number(y, 0.0):
            return y if _is_number(x, 0.0) else x
        value = (self._residue(x) + self._residue(y)) % PRIME
        if (known := self._find(value)) is not None:
            return known
        (first, minus), (second, less) = _unsigned(x), _unsigned(y)
        if minus and less:
            return -self._put(PRIME - value, "+", first, second)
        if minus:
            return self._put(value, "-", second, first)
        return self._put(value, "-" if less else "+", first, second)

    def product(self, x: Any, y: Any) -> Any:
        """Return x · y."""
        for a, b in ((x, y), (y, x)):
            if not isinstance(a, Traced) and a in (0, 1, -1):
                return 0.0 if a == 0 else b if a == 1 else -b
        return self._signed("*", self._residue(x) * self._residue(y) % PRIME, x, y)

    def quotient(self, x: Any, y: Any) -> Any:
        """Return x / y."""
        if _is_number(x, 0.0) or _is_number(y, 1.0):
            return x
        if _is_number(y, 0.0):
            raise ZeroDivisionError("division by zero")
        return self._signed("/", self._residue(x) * pow(self._residue(y), -1, PRIME) % PRIME, x, y)

    def power(self, x: Any, exponent: Any) -> Any:
        """Return x ** exponent."""
        if isinstance(exponent, Traced) or exponent != int(exponent) or not 0 <= exponent <= MAX_FACTORS:
            return self.call("power", x, exponent)
        result = 1.0
        for _ in range(int(exponent)):
            result = result * x
        return result

    def call(self, function: str, *arguments: Any) -> Any:
        """Return a function of `NATIVE`, or ``power``, applied to numbers."""
        if not any(isinstance(x, Traced) for x in arguments):
            return getattr(FLOAT, function)(*arguments)
        parity = TABLE[function].parity if function in TABLE else ""
        if not parity:
            return self._call(function, *arguments)
        x, negative = _unsigned(arguments[0])
        value = self._call(function, x)
        return -value if negative and parity == "odd" else value

    def _call(self, function: str, *arguments: Any) -> Any:
        residues = tuple(self._residue(x) for x in arguments)
        if function in ("sin", "cos"):
            value = half_angle(function, str(residues))
        else:
            value = random_residue(f"{function}{residues}")
        known = self._find(value)
        return self._put(value, function, *arguments) if known is None else known

    def arithmetic(self) -> Arithmetic:
        """Return the arithmetic in which kernels and expressions are traced."""

        def function(name: str) -> Callable[..., Any]:
            return lambda *arguments: self.call(name, *arguments)

        functions = {name: function(name) for name in NATIVE}
        return Arithmetic("trace", as_float, dict(CONSTANTS), functions | {"power": self.power})

    def _signed(self, operation: str, value: int, x: Any, y: Any) -> Any:
        if (known := self._find(value)) is not None:
            return known
        (first, minus), (second, less) = _unsigned(x), _unsigned(y)
        if minus == less:
            return self._put(value, operation, first, second)
        return -self._put(PRIME - value, operation, first, second)

    def _residue(self, x: Any) -> int:
        if isinstance(x, Traced):
            value = self._residues[x.step]
            return PRIME - value if x.negative else value
        value = self._constants.get(x, -1)
        if value < 0:
            value = self._constants[x] = residue(Fraction(x))
            self._known.setdefault(min(value, PRIME - value), (value, x))
        return value

    def _find(self, value: int) -> Any:
        """Return the number or the step that has this residue."""
        if value == 0:
            return 0.0
        found = self._known.get(min(value, PRIME - value))
        return None if found is None else found[1] if found[0] == value else -found[1]

    def _put(self, value: int, operation: str, *operands: Any) -> Any:
        traced = Traced(self, len(self.steps))
        self.steps.append(Step(operation, operands))
        self._residues.append(value)
        self._known[min(value, PRIME - value)] = value, traced
        return traced

    # --- text -------------------------------------------------------------------------------------------------------

    def text(self, inputs: dict[str, Any], outputs: Sequence[Any]) -> str:
        """Return the source of a function ``evaluate`` for Python floats, which packs its results.

        Parameters
        ----------
        inputs : dict
            Arguments in their order; each is a list of inputs that comes as a sequence, or a single one.
        outputs : sequence of Traced or float
            Arguments of the callable ``pack``, whose value is returned.
        """
        writer = _Writer(self.steps, self._needed(outputs), outputs)
        lines = [f"def evaluate({', '.join(inputs)}):"]
        for argument, members in inputs.items():
            if isinstance(members, list) and members:
                names = [name if name in writer.inputs else "_" for name in self._names(members)]
                lines.append(f"    {', '.join(names)}, = {argument}")
        lines += [*(f"    {line}" for line in writer.lines), "    return pack("]
        return "\n".join([*lines, *(f"        {writer.term(x)}," for x in outputs), "    )", ""])

    def code(self, inputs: Sequence[Traced], groups: Sequence[Sequence[Any]]) -> Code:
        """Return the program that finds groups of outputs, one after the other, with long runs of equal operations.

        Parameters
        ----------
        inputs : sequence of Traced
            All inputs that may occur, in the order of their registers.
        groups : sequence of sequences of Traced or float
        """
        registers = {x.step: i for i, x in enumerate(inputs)}
        constants: dict[float, int] = {}
        needed: list[int] = []
        ends: list[int] = []
        for group in groups:
            known = set(needed)
            needed += [i for i in self._needed(group) if i not in known and i not in registers]
            ends.append(len(needed))
        used = [x for i in needed for x in self.steps[i].operands] + [x for group in groups for x in group]
        for x in used:
            if not isinstance(x, Traced):
                constants.setdefault(float(x), len(inputs) + len(constants))
        first = len(inputs) + len(constants)
        operations: list[int] = []
        operands: list[tuple[int, int]] = []

        def put(operation: str, x: int, y: int) -> int:
            operations.append(OPERATIONS.index(operation))
            operands.append((x, y))
            return first + len(operations) - 1

        def register(x: Any) -> int:
            if not isinstance(x, Traced):
                return constants[float(x)]
            return put("negative", registers[x.step], registers[x.step]) if x.negative else registers[x.step]

        counts = [0]
        for number in needed:
            x, *rest = map(register, self.steps[number].operands)
            registers[number] = put(self.steps[number].operation, x, rest[0] if rest else x)
            counts.append(len(operations))
        order, runs, stops = _in_runs(operations, operands, first, [counts[end] for end in ends])
        place = list(range(first)) + [0] * len(order)
        for new, old in enumerate(order):
            place[first + old] = first + new
        results = [
            (place[registers[x.step]], x.negative) if isinstance(x, Traced) else (constants[float(x)], False)
            for group in groups
            for x in group
        ]
        taken = [(place[x], place[y]) for x, y in (operands[i] for i in order)]
        return Code(len(inputs), runs, taken, list(constants), results, stops)

    def _names(self, inputs: Iterable[Traced]) -> list[str]:
        return [self.steps[x.step].operands[0] for x in inputs]

    def _needed(self, outputs: Iterable[Any]) -> list[int]:
        needed: set[int] = set()
        stack = [x.step for x in outputs if isinstance(x, Traced)]
        while stack:
            number = stack.pop()
            if number not in needed:
                needed.add(number)
                stack.extend(x.step for x in self.steps[number].operands if isinstance(x, Traced))
        return sorted(needed)


def _in_runs(
    operations: Sequence[int], operands: Sequence[tuple[int, int]], first: int, ends: Sequence[int]
) -> tuple[list[int], list[tuple[int, int]], list[int]]:
    """Return an order of operations with few runs of equal ones, each after those it uses; the runs; runs per group.

    Parameters
    ----------
    operations, operands
        As in `Code`, in an order in which each stands after those it uses.
    first : int
        Register of the first result.
    ends : sequence of int
        How many operations each group needs, those before it included.
    """
    order: list[int] = []
    runs: list[tuple[int, int]] = []
    stops: list[int] = []
    start = 0
    for end in ends:
        users: dict[int, list[int]] = {}
        ready: dict[int, list[int]] = {}
        waiting: dict[int, int] = {}
        for i in range(start, end):
            used = {x - first for x in operands[i] if x - first >= start}
            waiting[i] = len(used)
            for x in used:
                users.setdefault(x, []).append(i)
            if not used:
                ready.setdefault(operations[i], []).append(i)
        while ready:
            operation = max(ready, key=lambda x: len(ready[x]))
            run = ready.pop(operation)
            for i in run:  # which grows meanwhile
                for user in users.get(i, ()):
                    waiting[user] -= 1
                    if not waiting[user]:
                        (run if operations[user] == operation else ready.setdefault(operations[user], [])).append(user)
            order += run
            runs.append((operation, len(order)))
        stops.append(len(runs))
        start = end
    return order, runs, stops


class _Writer:
    """Steps as lines of Python; a short step that is used once is inserted at the place of its use.

    Attributes
    ----------
    lines : list of str
        Assignments.
    inputs : set of str
        Names of the inputs that occur.
    """

    def __init__(self, steps: Sequence[Step], needed: Sequence[int], outputs: Iterable[Any]) -> None:
        self.lines: list[str] = []
        self.inputs = {steps[i].operands[0] for i in needed if steps[i].operation == "input"}
        self._texts: dict[int, tuple[str, int]] = {}
        counts = Counter(x.step for x in outputs if isinstance(x, Traced))
        for number in needed:
            counts.update(x.step for x in steps[number].operands if isinstance(x, Traced))
        for number in needed:
            text, binding = self._text(steps[number])
            if binding < _ATOM and (counts[number] > 1 or len(text) > MAX_LINE):
                name = f"w{len(self.lines)}"
                self.lines.append(f"{name} = {text}")
                text, binding = name, _ATOM
            self._texts[number] = text, binding

    def _text(self, step: Step) -> tuple[str, int]:
        match step.operation:
            case "input":
                return step.operands[0], _ATOM
            case "+" | "-" | "*" | "/" as operation:
                x, y = step.operands
                own = _SUM if operation in "+-" else _PRODUCT
                between = f" {operation} " if own == _SUM else operation
                return f"{self._bound(x, own)}{between}{self._bound(y, own + 1)}", own
            case function:
                return f"{function}({', '.join(map(self.term, step.operands))})", _CALL

    def _bound(self, x: Any, least: int) -> str:
        """Return the text of an operand, in parentheses if its precedence is lower than `least`."""
        if not isinstance(x, Traced):
            return repr(float(x))
        text, binding = self._texts[x.step]
        return text if binding >= least else f"({text})"

    def term(self, x: Any) -> str:
        """Return the text of a number that stands alone."""
        if not isinstance(x, Traced):
            return repr(float(x))
        return f"-{self._bound(x, _PRODUCT)}" if x.negative else self._bound(x, _SUM)


_SUM, _PRODUCT, _CALL, _ATOM = 1, 2, 3, 4


def _is_number(x: Any, value: float) -> bool:
    return not isinstance(x, Traced) and bool(x == value)


def _unsigned(x: Any) -> tuple[Any, bool]:
    """Return the size of an operand, and whether it is negative."""
    negative = x.negative if isinstance(x, Traced) else x < 0
    return (-x if negative else x), negative
