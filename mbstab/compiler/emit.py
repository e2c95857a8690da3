"""From derived symbols to the source text of a kernel.

A kernel module holds two functions, ``dynamics`` and ``linearize``, that take an arithmetic
and sequences of numbers of any kind and return one flat tuple, and for each function the
table of which entry of which matrix each number is. Regenerate the shipped kernels with
``python -m mbstab.compiler.emit``.
"""

from __future__ import annotations

import random
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import mpmath
import sympy
from sympy.printing.str import StrPrinter

from mbstab.compiler.derive import Derived, Entries, Tape, derive
from mbstab.mechanics.elements import ELEMENTS

KERNELS = Path(__file__).parent / "kernels"
MAX_INLINE = 6


class _Printer(StrPrinter):  # type: ignore[misc]
    """Prints expressions as Python that calls the functions of an arithmetic ``f``."""

    def _print_Function(self, expr: Any) -> str:
        return f"f.{expr.func.__name__}({', '.join(self._print(a) for a in expr.args)})"

    def _print_Abs(self, expr: Any) -> str:
        return f"f.abs({self._print(expr.args[0])})"

    def _print_Pow(self, expr: Any, rational: bool = False) -> str:
        base, exponent = expr.args
        if exponent == sympy.Rational(1, 2):
            return f"f.sqrt({self._print(base)})"
        if exponent.is_integer and exponent.is_number:
            if exponent < 0:
                return f"1/{self.parenthesize(base ** (-exponent), 70)}"
            return f"{self.parenthesize(base, 70)}**{exponent}"
        if exponent.is_number and (2 * exponent).is_integer:
            if exponent < 0:
                return f"1/({self._print(sympy.Pow(base, -exponent))})"
            whole = exponent - sympy.Rational(1, 2)
            return f"f.sqrt({self._print(base)})*{self.parenthesize(base**whole, 70)}"
        return f"f.power({self._print(base)}, {self._print(exponent)})"

    def _print_Rational(self, expr: Any) -> str:
        return str(expr.p) if expr.q == 1 else f"({expr.p}/{expr.q})"

    def _print_Pi(self, expr: Any) -> str:
        return "f.constants['pi']"


_PRINT = _Printer()


def emit(derived: Derived, title: str) -> str:
    """Return the source of a kernel module."""
    derived = _without_zeros(derived)
    lines = [f'"""{title}"""', ""]
    for name, outputs in (("dynamics", derived.dynamics), ("linearize", derived.linearize)):
        lines += ["", *_function(name, derived, outputs), "", f"{name.upper()} = {{"]
        lines += [f"    {key!r}: {tuple(table)!r}," for key, table in outputs.items()]
        lines += ["}", ""]
    return "\n".join(lines)


def _function(name: str, derived: Derived, outputs: dict[str, Entries]) -> list[str]:
    arguments = [key for key in derived.inputs if name == "linearize" or key not in ("a", "nu")]
    values = [value for table in outputs.values() for value in table.values()]
    steps, values = _inlined(_needed(derived.tape, values), values)
    used = {symbol for expression in [*values, *steps.values()] for symbol in expression.free_symbols}
    lines = [f"def {name}({', '.join(['f', *arguments])}):"]
    for argument in arguments:
        names = [symbol.name if symbol in used else "_" for symbol in derived.inputs[argument]]
        while names and names[-1] == "_":
            names.pop()
        if names:
            rest = ", *_" if len(names) < len(derived.inputs[argument]) else ","
            lines.append(f"    {', '.join(names)}{rest} = {argument}")
    # Names in the order of use, so that the text does not depend on what else was derived.
    renamed = {symbol: sympy.Symbol(f"w{i}") for i, symbol in enumerate(steps)}
    lines += [f"    {renamed[symbol]} = {_PRINT.doprint(step.xreplace(renamed))}" for symbol, step in steps.items()]
    return [*lines, "    return (", *[f"        {_PRINT.doprint(v.xreplace(renamed))}," for v in values], "    )", ""]


def _needed(tape: Tape, values: list[Any]) -> dict[Any, Any]:
    """Return the steps that the values depend on, in order."""
    wanted: set[Any] = set()
    stack = [symbol for value in values for symbol in value.free_symbols]
    while stack:
        symbol = stack.pop()
        if symbol in tape.steps and symbol not in wanted:
            wanted.add(symbol)
            stack.extend(tape.steps[symbol].free_symbols)
    return {symbol: step for symbol, step in tape.steps.items() if symbol in wanted}


def _inlined(steps: dict[Any, Any], values: list[Any]) -> tuple[dict[Any, Any], list[Any]]:
    """Write steps that are used once in the place of their use."""
    uses = Counter(symbol for expression in [*steps.values(), *values] for symbol in expression.free_symbols)
    size: dict[Any, int] = {}
    inline: dict[Any, Any] = {}
    kept: dict[Any, Any] = {}
    for symbol, step in steps.items():
        inner = sum(size.get(x, 0) for x in step.free_symbols)
        small = {x: inline[x] for x in step.free_symbols if x in inline}
        if inner > MAX_INLINE:  # keep lines readable and evaluation shallow
            for x in small:
                kept[x] = inline.pop(x)
            small, inner = {}, 0
        written = step.xreplace(small)
        if uses[symbol] == 1:
            inline[symbol], size[symbol] = written, inner + 1
        else:
            kept[symbol] = written
    return kept, [value.xreplace(inline) for value in values]


def _without_zeros(derived: Derived) -> Derived:
    """Drop entries that vanish identically: those that are zero to 40 digits at three random states."""
    tape, rng = derived.tape, random.Random(1)
    tables = [table for outputs in (derived.dynamics, derived.linearize) for table in outputs.values()]
    values = [value for table in tables for value in table.values()]
    steps = _needed(tape, values)
    largest = dict.fromkeys(values, 0.0)
    with mpmath.workdps(40):
        for _ in range(3):
            known = {x: mpmath.mpf(rng.uniform(0.2, 1.2)) for group in derived.inputs.values() for x in group}
            for symbol, step in steps.items():
                known[symbol] = _number(step, known)
            for value in values:
                largest[value] = max(largest[value], float(abs(_number(value, known))))
    keep = [
        {key: {i: v for i, v in table.items() if largest[v] > 1e-25} for key, table in outputs.items()}
        for outputs in (derived.dynamics, derived.linearize)
    ]
    return replace(derived, dynamics=keep[0], linearize=keep[1])


def _number(expression: Any, known: dict[Any, Any]) -> Any:
    """Return the value of one step; its arguments are names and numbers, a few levels deep at most."""
    if expression in known:
        return known[expression]
    if expression.is_Rational:
        return mpmath.mpf(expression.p) / expression.q
    if expression.is_Atom:
        return mpmath.mpf(expression.evalf(40))
    arguments = [_number(argument, known) for argument in expression.args]
    if expression.is_Add:
        return mpmath.fsum(arguments)
    if expression.is_Mul:
        return mpmath.fprod(arguments)
    if expression.is_Pow:
        return mpmath.power(*arguments)
    return getattr(mpmath, {"Abs": "fabs"}.get(expression.func.__name__, expression.func.__name__))(*arguments)


def shipped(name: str) -> str:
    """Return the source of a built-in kernel."""
    element = ELEMENTS[name]
    frame = name.removesuffix(f"_{element.name}")
    title = f"Kernel {name}, generated by mbstab.compiler.emit from mbstab.mechanics; do not edit."
    return emit(derive(element, frame), title)


def main() -> None:
    """Write all kernels, or those named on the command line."""
    for name in sys.argv[1:] or sorted(ELEMENTS):
        (KERNELS / f"{name}.py").write_text(shipped(name), encoding="utf-8")


if __name__ == "__main__":
    main()
