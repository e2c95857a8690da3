"""From derived terms to the source text of a kernel.

A kernel module holds two functions, ``dynamics`` and ``linearize``, that take an arithmetic
and sequences of numbers of any kind and return one flat tuple, and for each function the
table of which entry of which matrix each number is. Regenerate the shipped kernels with
``python -m mbstab.compiler.emit``.
"""

from __future__ import annotations

import heapq
import sys
from collections import Counter
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

from mbstab.compiler.derive import Derived, Entries, derive
from mbstab.compiler.tape import ONE, Call, Input, Literal, Product, Step, Sum, Term, uses
from mbstab.mechanics.elements import ELEMENTS

KERNELS = Path(__file__).parent / "kernels"
MAX_INLINE = 60
MAX_FACTORS = 8

Parts = list[tuple[int, Fraction]]
"""Terms of a sum with their coefficients, or factors of a product with their exponents (±1 as often as needed)."""

Pair = tuple[int, int, Fraction]
"""a + r b in a sum, a · b ** r in a product."""


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
    terms = [term for table in outputs.values() for term in table.values()]
    steps = _reduced(dict(enumerate(derived.tape.steps)), terms)
    used = {step.name for step in steps.values() if isinstance(step, Input)}
    lines = [f"def {name}({', '.join(['f', *arguments])}):"]
    for argument in arguments:
        names = [x if x in used else "_" for x in derived.inputs[argument]]
        while names and names[-1] == "_":
            names.pop()
        if names:
            rest = ", *_" if len(names) < len(derived.inputs[argument]) else ","
            lines.append(f"    {', '.join(names)}{rest} = {argument}")
    writer = _Writer(steps, terms)
    lines += [f"    {line}" for line in writer.lines]
    return [*lines, "    return (", *[f"        {writer.term(t.step, t.coefficient)}," for t in terms], "    )", ""]


# --- fewer operations -----------------------------------------------------------------------------------------------


def _reduced(steps: dict[int, Step], terms: list[Term]) -> dict[int, Step]:
    """Return the steps that the terms need, rewritten with fewer operations, each after those it uses."""
    steps = _flat(_needed(steps, terms), terms)
    for kind in (Product, Sum):
        steps |= _shared(_needed(steps, terms), kind, 1 + max(steps, default=0))
    return _needed(steps, terms)


def _needed(steps: dict[int, Step], terms: list[Term]) -> dict[int, Step]:
    needed: dict[int, Step] = {}
    stack = [(term.step, False) for term in reversed(terms)]
    while stack:
        number, done = stack.pop()
        if done:
            needed[number] = steps[number]
        elif number not in needed:
            stack.append((number, True))
            stack.extend((used, False) for used in reversed(list(uses(steps[number]))))
    return needed


def _counts(steps: dict[int, Step], terms: list[Term]) -> Counter[int]:
    """Return how often each step is used."""
    counts = Counter(term.step for term in terms)
    for step in steps.values():
        match step:
            case Product():
                counts.update(n for n, e in step.factors for _ in range(min(abs(e), MAX_FACTORS)))
            case _:
                counts.update(uses(step))
    return counts


def _flat(steps: dict[int, Step], terms: list[Term]) -> dict[int, Step]:
    """Merge a sum that is used once, in a sum, into that sum; the same for products."""
    counts = _counts(steps, terms)
    flat: dict[int, Step] = {}
    for number, step in steps.items():
        if isinstance(step, Sum | Product):
            total: dict[int, Fraction] = {}
            for used, size in _parts(step):
                inner = flat[used]
                merged = isinstance(inner, Sum | Product) and isinstance(inner, type(step)) and counts[used] == 1
                for part, times in _parts(inner) if merged else [(used, Fraction(1))]:
                    total[part] = total.get(part, Fraction(0)) + size * times
            step = _made(type(step), [(part, size) for part, size in total.items() if size])
        flat[number] = step
    return flat


def _parts(step: Sum | Product) -> Parts:
    if isinstance(step, Sum):
        return list(step.terms)
    parts: Parts = []
    for n, e in step.factors:
        parts += [(n, Fraction(1 if e > 0 else -1))] * abs(e) if abs(e) <= MAX_FACTORS else [(n, Fraction(e))]
    return parts


def _made(kind: type[Sum] | type[Product], parts: Parts) -> Sum | Product:
    if kind is Sum:
        return Sum(tuple(parts))
    exponents: dict[int, int] = {}
    for n, e in parts:
        exponents[n] = exponents.get(n, 0) + int(e)
    return Product(tuple(exponents.items()))


def _shared(steps: dict[int, Step], kind: type[Sum] | type[Product], free: int) -> dict[int, Step]:
    """Give a step of its own to each pair of terms, or of factors, that occurs more than once.

    Any multiple of a pair, or its inverse, counts as well. The most frequent pair goes first.
    """
    parts = {number: _parts(step) for number, step in steps.items() if isinstance(step, kind)}
    places: dict[Pair, Counter[int]] = {}
    queue: list[tuple[int, Pair]] = []

    def enter(number: int) -> None:
        for pair, times in _pairs(parts[number], kind).items():
            places.setdefault(pair, Counter())[number] = times
            heapq.heappush(queue, (-places[pair].total(), pair))

    for number in parts:
        enter(number)
    while queue:
        count, pair = heapq.heappop(queue)
        now = places[pair].total()
        if now < -count or now < 2:
            if now > 1:  # rarer than when it was queued
                heapq.heappush(queue, (-now, pair))
            continue
        home = next((n for n in places[pair] if len(parts[n]) == 2), None)
        if home is None:
            home, free = free, free + 1
            parts[home] = [(pair[0], Fraction(1)), (pair[1], pair[2])]
        unit = dict(reversed(parts[home]))[pair[0]]
        for number, times in list(places[pair].items()):
            if number != home:
                for other in _pairs(parts[number], kind):
                    del places[other][number]
                for _ in range(times):
                    size = _take(parts[number], pair)
                    parts[number].append((home, size / unit))
                enter(number)
    return {number: _made(kind, items) for number, items in parts.items()}


def _pairs(parts: Parts, kind: type[Sum] | type[Product]) -> Counter[Pair]:
    """Return the pairs among some parts, and how many of each could be taken out together."""
    counts = Counter(part for part in sorted(parts) if kind is Sum or abs(part[1]) == 1)
    found: Counter[Pair] = Counter()
    for (a, size), times in counts.items():
        if times > 1:
            found[(a, a, Fraction(1))] += times // 2
        for (b, other), others in counts.items():
            if b > a:
                found[(a, b, other / size)] += min(times, others)
    return found


def _take(parts: Parts, pair: Pair) -> Fraction:
    """Remove one occurrence of a pair and return its size."""
    a, b, ratio = pair
    for i, (n, size) in enumerate(parts):
        if n == a and (b, size * ratio) in parts[:i] + parts[i + 1 :]:
            del parts[i]
            parts.remove((b, size * ratio))
            return size
    raise AssertionError(f"no pair {pair} in {parts}")


# --- text -----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Text:
    """How a step is written: as a term of a sum, and as factors above and below a fraction bar."""

    term: str
    above: tuple[str, ...]
    below: tuple[str, ...] = ()


class _Writer:
    """Steps as lines of Python.

    A step that is used once and short is written in the place of its use.

    Attributes
    ----------
    lines : list of str
        Assignments.
    """

    def __init__(self, steps: dict[int, Step], terms: list[Term]) -> None:
        self.lines: list[str] = []
        self._texts: dict[int, _Text] = {}
        counts = _counts(steps, terms)
        for number, step in steps.items():
            text = self._text(step)
            if number != ONE and not isinstance(step, Input) and (counts[number] > 1 or len(text.term) > MAX_INLINE):
                name = f"w{len(self.lines)}"
                self.lines.append(f"{name} = {text.term}")
                text = _Text(name, (name,))
            self._texts[number] = text

    def _text(self, step: Step) -> _Text:
        match step:
            case Input():
                return _Text(step.name, (step.name,))
            case Literal():
                text = f"f.constants[{step.text!r}]" if step.text == "pi" else f"f.number({step.text!r})"
                return _Text(text, (text,))
            case Call():
                text = f"f.{step.function}({', '.join(self.term(n, c) for n, c in step.arguments)})"
                return _Text(text, (text,))
            case Sum():
                # A positive term in front saves a sign.
                first = next((i for i, (_, c) in enumerate(step.terms) if c > 0), 0)
                head, *rest = [step.terms[first], *step.terms[:first], *step.terms[first + 1 :]]
                texts = [self.term(n, c) for n, c in rest]
                text = self.term(*head) + "".join(f" - {x[1:]}" if x[0] == "-" else f" + {x}" for x in texts)
                return _Text(text, (f"({text})",))
            case Product():
                above: tuple[str, ...] = ()
                below: tuple[str, ...] = ()
                for n, e in step.factors:
                    text = self._texts[n]
                    if abs(e) > MAX_FACTORS:
                        text, e = _Text("", (f"{text.term}**{abs(e)}",)), 1 if e > 0 else -1
                    above += (text.above if e > 0 else text.below) * abs(e)
                    below += (text.below if e > 0 else text.above) * abs(e)
                return _Text(_fraction(Fraction(1), above, below), above, below)

    def term(self, number: int, coefficient: Fraction) -> str:
        """Return the text of coefficient · step, fit for a sum."""
        sign, size = "-" if coefficient < 0 else "", abs(coefficient)
        if number == ONE:
            exact = size.denominator & (size.denominator - 1) == 0  # as a binary fraction
            return sign + (f"{size}" if exact else f"f.number('{size.numerator}')/{size.denominator}")
        text = self._texts[number]
        if coefficient == 1:
            return text.term
        return sign + _fraction(size, text.above, text.below)


def _fraction(size: Fraction, above: tuple[str, ...], below: tuple[str, ...]) -> str:
    over = [*([str(size.numerator)] if size.numerator != 1 or not above else []), *above]
    under = [*([str(size.denominator)] if size.denominator != 1 else []), *below]
    bar = "/" if under else ""
    return "*".join(over) + bar + (f"({'*'.join(under)})" if len(under) > 1 else "".join(under))


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
