"""From derived terms to the source text of a kernel.

A kernel module holds two functions, ``dynamics`` and ``linearize``, that take an arithmetic
and sequences of numbers of any kind and return one flat tuple, and for each function the
table of which entry of which matrix each number is. Regenerate the shipped kernels with
``python -m mbstab.compiler.emit``.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path

from mbstab.compiler.derive import Derived, Entries, derive
from mbstab.compiler.tape import ONE, Call, Input, Literal, Product, Step, Sum, Term, uses
from mbstab.mechanics.elements import ELEMENTS

KERNELS = Path(__file__).parent / "kernels"
MAX_INLINE = 60
MAX_REPEAT = 3


def emit(derived: Derived, title: str) -> str:
    """Return the source of a kernel module."""
    lines = [f'"""{title}"""', ""]
    for name, outputs in (("dynamics", derived.dynamics), ("linearize", derived.linearize)):
        lines += ["", *_function(name, derived, outputs), "", f"{name.upper()} = {{"]
        lines += [f"    {key!r}: {tuple(table)!r}," for key, table in outputs.items()]
        lines += ["}", ""]
    return "\n".join(lines)


def _function(name: str, derived: Derived, outputs: dict[str, Entries]) -> list[str]:
    arguments = [key for key in derived.inputs if name == "linearize" or key not in ("a", "nu")]
    program = _Program(derived.tape.steps, [term for table in outputs.values() for term in table.values()])
    lines = [f"def {name}({', '.join(['f', *arguments])}):"]
    for argument in arguments:
        names = [x if x in program.inputs else "_" for x in derived.inputs[argument]]
        while names and names[-1] == "_":
            names.pop()
        if names:
            rest = ", *_" if len(names) < len(derived.inputs[argument]) else ","
            lines.append(f"    {', '.join(names)}{rest} = {argument}")
    lines += [f"    {line}" for line in program.lines]
    return [*lines, "    return (", *[f"        {value}," for value in program.values], "    )", ""]


class _Program:
    """The steps that some terms need, with fewer operations, as lines of Python.

    Attributes
    ----------
    inputs : set of str
        Names of the inputs that occur.
    lines : list of str
        Assignments.
    values : list of str
        The terms.
    """

    def __init__(self, steps: list[Step], terms: list[Term]) -> None:
        self.steps = dict(enumerate(steps))
        self.terms = [(term.step, term.coefficient) for term in terms]
        self.order = self._ordered()
        self._flatten()
        self._share(Product)
        self._share(Sum)
        self.order = self._ordered()
        self.inputs = {step.name for step in map(self.steps.__getitem__, self.order) if isinstance(step, Input)}
        self.lines: list[str] = []
        self._texts: dict[int, str] = {}
        self._fractions: dict[int, tuple[list[str], list[str]]] = {}
        self._write()
        self.values = [self._sum([term]) for term in self.terms]

    # --- fewer operations -------------------------------------------------------------------------------------------

    def _ordered(self) -> list[int]:
        """Return the needed steps, each after those it uses, in the order of need."""
        order: dict[int, None] = {}
        stack = [(step, False) for step, _ in reversed(self.terms)]
        while stack:
            step, done = stack.pop()
            if done:
                order[step] = None
            elif step not in order:
                stack.append((step, True))
                stack.extend((used, False) for used in reversed(list(uses(self.steps[step]))))
        return list(order)

    def _counts(self) -> Counter[int]:
        """Return how often each step is used."""
        counts = Counter(step for step, _ in self.terms)
        for step in self.order:
            counts.update(uses(self.steps[step]))
        return counts

    def _flatten(self) -> None:
        """Merge sums that are used once in a sum, and products that are used once in a product."""
        counts = self._counts()
        for number in self.order:
            match self.steps[number]:
                case Sum(terms):
                    flat: list[tuple[int, Fraction]] = []
                    for n, c in terms:
                        inner = self.steps[n]
                        merge = isinstance(inner, Sum) and counts[n] == 1
                        flat += [(m, c * k) for m, k in inner.terms] if merge else [(n, c)]
                    self.steps[number] = Sum(tuple(flat))
                case Product(factors):
                    powers: list[tuple[int, int]] = []
                    for n, e in factors:
                        inner = self.steps[n]
                        merge = isinstance(inner, Product) and counts[n] == 1
                        powers += [(m, e * k) for m, k in inner.factors] if merge else [(n, e)]
                    self.steps[number] = Product(tuple(powers))

    def _share(self, kind: type[Sum] | type[Product]) -> None:
        """Give a step of its own to each pair of terms, or of factors, that occurs more than once."""
        self.order = self._ordered()
        parts = {n: _parts(step) for n, step in self.steps.items() if isinstance(step, kind)}
        ...
