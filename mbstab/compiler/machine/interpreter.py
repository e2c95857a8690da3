"""The interpreter of the equations of a scene."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from mbstab.compiler.machine.native import compiled, copy, floats, integers
from mbstab.compiler.machine.operations import FREQUENT, REFUSED, TEXTS
from mbstab.compiler.machine.tables import ENDS, FIRST, RUN_OPERATION, RUN_START, SECOND, Floats, Machine, W
from mbstab.compiler.trace import OPERATIONS


def _interpreter() -> Callable[[Machine, int, int], bool]:
    """Return the function that runs operations, each of which it knows by its number."""

    def body(name: str, indent: str) -> list[str]:
        lines = [f"if {REFUSED[name]}:", "    return False"] if name in REFUSED else []
        return [indent + line for line in (*lines, f"z = {TEXTS[name]}")]

    loop = ["            for i in range(begin[r], begin[r + 1]):"]
    loop += ["                x, y = w[first[i]], w[second[i]]"]
    result = ["                if not math.isfinite(z):", "                    return False"]
    result += ["                w[base + i] = z"]
    lines = ["def interpret(m, start, stop):", "    w, base = floats(m, W), m.base"]
    lines += ["    operations, begin = integers(m, RUN_OPERATION), integers(m, RUN_START)"]
    lines += ["    first, second = integers(m, FIRST), integers(m, SECOND)"]
    lines += ["    for r in range(start, stop):", "        operation = operations[r]"]
    for k, name in enumerate(FREQUENT):
        lines += [f"        {'elif' if k else 'if'} operation == {OPERATIONS.index(name)}:", *loop]
        lines += [*body(name, " " * 16), *result]
    lines += ["        else:", *loop]
    for k, name in enumerate(x for x in OPERATIONS if x not in FREQUENT):
        lines += [f"                {'elif' if k else 'if'} operation == {OPERATIONS.index(name)}:"]
        lines += body(name, " " * 20)
    lines += ["                else:", "                    return False", *result, "    return True"]
    names = {"__name__": __name__, "math": math, "floats": floats, "integers": integers, "W": W, "FIRST": FIRST}
    names |= {"SECOND": SECOND, "RUN_OPERATION": RUN_OPERATION, "RUN_START": RUN_START}
    # As if it stood here: Numba keeps machine code beside the file of a function.
    exec(compile("\n".join(lines), __file__, "exec"), names)
    function: Any = names["interpret"]
    function.__doc__ = "Do runs of operations; False where a number does not exist or is not finite."
    return function  # type: ignore[no-any-return]


interpret = compiled(_interpreter())


@compiled
def evaluate(m: Machine, t: float, y: Floats, group: int) -> bool:
    """Set the registers to those of a state q, u: for the accelerations (group 0), or for everything (1)."""
    ends = integers(m, ENDS)
    w = floats(m, W)
    copy(w[: len(y)], y)
    w[len(y)] = t
    return interpret(m, 0, ends[group])
