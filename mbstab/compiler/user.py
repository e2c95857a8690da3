"""Kernels of the expressions that a model file brings along; the only place that needs SymPy in an analysis."""

from __future__ import annotations

from functools import lru_cache
from types import SimpleNamespace
from typing import Any

from mbstab.model.expressions import Expression


def user_kernel(
    role: str, expressions: tuple[Expression, ...], rows: tuple[str, ...], coordinates: tuple[str, ...],
    parameters: tuple[str, ...],
) -> Any:  # fmt: skip
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
    """
    return _kernel(role, tuple(e.text for e in expressions), rows, coordinates, parameters)


@lru_cache(maxsize=256)
def _kernel(
    role: str, texts: tuple[str, ...], rows: tuple[str, ...], coordinates: tuple[str, ...], parameters: tuple[str, ...]
) -> Any:
    import sympy

    from mbstab.compiler.derive import differentiate
    from mbstab.compiler.emit import emit
    from mbstab.mechanics.catalogue import Load
    from mbstab.model.arithmetic import symbol_arithmetic
    from mbstab.model.expressions import parse

    q, u, a = ([sympy.Symbol(f"{x}{i}", real=True) for i in range(len(coordinates))] for x in ("q", "u", "a"))
    p = [sympy.Symbol(f"p{i}", real=True) for i in range(len(parameters))]
    time = sympy.Symbol("s1", real=True)
    names = {**dict(zip(coordinates, q, strict=True)), **dict(zip(parameters, p, strict=True)), "t": time}
    rates = dict(zip(coordinates, u, strict=True))
    values = [parse(text).evaluate(names, symbol_arithmetic(), rates) for text in texts]
    definition: Any = values
    if role == "force":
        velocity = sympy.Matrix([rates[name] for name in rows])
        definition = Load(power=((sympy.Matrix(values), velocity),))
    source = emit(differentiate(role, definition, q, u, a, [time], p, []), f"{role} expressions of a model file")
    module: dict[str, Any] = {}
    # The text is ours: it was printed from the symbols, not taken from the file.
    exec(compile(source, "<user kernel>", "exec"), module)
    return SimpleNamespace(**{key: module[key] for key in ("dynamics", "linearize", "DYNAMICS", "LINEARIZE")})
