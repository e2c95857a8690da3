"""Kernels of the expressions of a model file, derived when the model is read."""

from __future__ import annotations

from functools import lru_cache
from types import ModuleType
from typing import Any

from mbstab.compiler.measured import Measured
from mbstab.model.expressions import Expression, Node


def user_kernel(
    role: str,
    expressions: tuple[Expression, ...],
    rows: tuple[str, ...],
    coordinates: tuple[str, ...],
    parameters: tuple[str, ...],
    measures: tuple[Measured, ...] = (),
) -> Any:
    """Return a kernel for constraints or generalized forces written as expressions.

    Parameters
    ----------
    role : str
        ``holonomic``, ``nonholonomic`` or ``force``.
    expressions : tuple of Expression
        One per row; for a force one per coordinate in `rows`.
    rows : tuple of str
        Coordinates on which the generalized forces act (forces only).
    coordinates, parameters : tuple of str
        The names that occur; the kernel takes their values in this order. The time is its
        one given function.
    measures : tuple of Measured
        The measures that occur; base rotations and numbers of each follow the parameters.
    """
    return _kernel(role, tuple(e.root for e in expressions), rows, coordinates, parameters, measures)


@lru_cache(maxsize=256)
def _kernel(
    role: str,
    roots: tuple[Node, ...],
    rows: tuple[str, ...],
    coordinates: tuple[str, ...],
    parameters: tuple[str, ...],
    measures: tuple[Measured, ...],
) -> Any:
    from mbstab.compiler.derive import differentiate
    from mbstab.compiler.emit import emit
    from mbstab.compiler.tape import Tape
    from mbstab.mechanics.catalogue import Load

    q, u, a = ([f"{x}{i}" for i in range(len(coordinates))] for x in ("q", "u", "a"))
    own = sum(x.size for x in measures)
    p = [f"p{i}" for i in range(len(parameters) + own)]
    tape = Tape()
    inputs = zip((*coordinates, *parameters, "t"), (*q, *p[: len(parameters)], "s1"), strict=True)
    names = {name: tape.input(symbol) for name, symbol in inputs}
    rates = {name: tape.input(symbol) for name, symbol in zip(coordinates, u, strict=True)}
    total = tape.tangent({names[name]: rates[name] for name in coordinates})
    numbers = map(tape.input, p[len(parameters) :])
    f = tape.arithmetic()
    for measure in measures:
        value = tape.term(measure.of(f, names, numbers, lambda x: total(tape.term(x))))
        names[measure.name], rates[measure.name] = value, value if measure.kind.speed else total(value)
    definition: Any = [tape.term(Expression("", root).evaluate(names, f, rates)) for root in roots]
    if role == "force":
        definition = Load(power=((definition, [rates[name] for name in rows]),))
    derived = differentiate(tape, role, definition, q, u, a, ["s1"], p)
    source = emit(derived, f"{role} expressions of a model file")
    module: dict[str, Any] = {}
    # The text is safe: it was generated from the parsed terms, not taken from the file.
    exec(compile(source, "<user kernel>", "exec"), module)
    functions = [key for key in ("dynamics", "linearize", "linearize_rows") if key in module]
    kernel = ModuleType("user")
    vars(kernel).update({key: module[key] for name in functions for key in (name, name.upper())})
    return kernel
