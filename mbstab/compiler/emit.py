"""From derived terms to the source text of a kernel.

A kernel module holds the functions ``dynamics`` and ``linearize``, for constraints also
``linearize_rows``, where there is a potential also ``potential``, that take an arithmetic and
sequences of numbers of any kind and return one flat tuple, and for each function the table of
which entry of which matrix each number is; `DAMPING` as in `mbstab.compiler.derive`.

`mbstab.compiler.build` writes the kernels of all elements when the package is built.
"""

from __future__ import annotations

from collections import Counter

from mbstab.compiler.derive import Derived, Entries, derive
from mbstab.compiler.tape import ONE, Call, Input, Literal, Product, Rational, Step, Sum, Term, uses
from mbstab.mechanics.elements import ELEMENTS
from mbstab.records import dataclass

MAX_INLINE = 60
"""Maximum length of a text that is inserted at the place of its use."""
MAX_FACTORS = 4
"""Higher powers are written with ``**``, which takes longer than two products."""


def emit(derived: Derived, title: str) -> str:
    """Return the source of a kernel module."""
    lines = [f'"""{title}"""', ""]
    functions = {"dynamics": derived.dynamics, "linearize": derived.linearize}
    if derived.linearize_rows:
        functions["linearize_rows"] = derived.linearize_rows
    if derived.potential:
        functions["potential"] = derived.potential
    for name, outputs in functions.items():
        lines += ["", *_function(name, derived, outputs), "", f"{name.upper()} = {{"]
        lines += [f"    {key!r}: {tuple(table)!r}," for key, table in outputs.items()]
        lines += ["}", ""]
    if derived.damping is not None:
        lines += ["", f"DAMPING = {derived.damping!r}", ""]
    return "\n".join(lines)


def _function(name: str, derived: Derived, outputs: dict[str, Entries]) -> list[str]:
    last = {"linearize": "nu" if "nu" in derived.inputs else "a", "linearize_rows": "a"}.get(name, "")
    arguments = [key for key in derived.inputs if key not in ("a", "nu") or key == last]
    if name == "potential":
        arguments = ["q", "p"]
    terms = [term for table in outputs.values() for term in table.values()]
    steps = _needed(derived.tape.steps, terms)
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


def _needed(steps: list[Step], terms: list[Term]) -> dict[int, Step]:
    """Return the steps of which the terms consist, each after those it uses, in the order of use."""
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


@dataclass(frozen=True)
class _Text:
    """The text of a step: as a term of a sum, and as factors of numerator and denominator."""

    term: str
    above: tuple[str, ...]
    below: tuple[str, ...] = ()


class _Writer:
    """Steps as lines of Python.

    A short step that is used once is inserted at the place of its use.

    Attributes
    ----------
    lines : list of str
        Assignments.
    """

    def __init__(self, steps: dict[int, Step], terms: list[Term]) -> None:
        self.lines: list[str] = []
        self._texts: dict[int, _Text] = {}
        counts = Counter(term.step for term in terms)
        for step in steps.values():
            counts.update({n: abs(e) for n, e in step.factors} if isinstance(step, Product) else uses(step))
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
                    part, times = self._texts[n], abs(e)
                    if times > MAX_FACTORS:
                        part, times = _Text("", (f"{part.term}**{times}",)), 1
                    above += (part.above if e > 0 else part.below) * times
                    below += (part.below if e > 0 else part.above) * times
                return _Text(_fraction(1, above, below), above, below)

    def term(self, number: int, coefficient: Rational) -> str:
        """Return the text of coefficient · step, fit for a sum."""
        sign, size = ("-", -coefficient) if coefficient < 0 else ("", coefficient)
        if number == ONE:
            # A fraction must not become a float before the arithmetic gets it.
            return sign + (f"{size}" if size.denominator == 1 else f"f.number('{size.numerator}')/{size.denominator}")
        text = self._texts[number]
        if coefficient == 1:
            return text.term
        return sign + _fraction(size, text.above, text.below)


def _fraction(size: Rational, above: tuple[str, ...], below: tuple[str, ...]) -> str:
    over = [*([str(size.numerator)] if size.numerator != 1 or not above else []), *above]
    under = [*([str(size.denominator)] if size.denominator != 1 else []), *below]
    bar = "/" if under else ""
    return "*".join(over) + bar + (f"({'*'.join(under)})" if len(under) > 1 else "".join(under))


def source(name: str) -> str:
    """Return the source of the kernel of an element."""
    element = ELEMENTS[name]
    frame = name.removesuffix(f"_{element.name}")
    return emit(derive(element, frame), f"Kernel {name}, generated from mbstab.mechanics; do not edit.")
