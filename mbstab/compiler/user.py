"""Kernels of the expressions of a model file, derived when the model is read."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import lru_cache
from types import ModuleType
from typing import TYPE_CHECKING, Any

from mbstab.compiler.measure_kernels import MeasureKernel
from mbstab.compiler.measured import Measured
from mbstab.model.expressions import Expression, ExpressionError, Node

if TYPE_CHECKING:
    from mbstab.compiler.derive import Derived, Moving
    from mbstab.compiler.tape import Term


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
    from mbstab.compiler.derive import Moving, differentiate
    from mbstab.compiler.tape import Tape
    from mbstab.mechanics.catalogue import Load

    contents = Contents(coordinates, parameters, measures)
    q, u, a = ([f"{x}{i}" for i in range(contents.coordinates)] for x in ("q", "u", "a"))
    tape = Tape(shares=True)
    motion = Moving(tape, q, u, ["s1"])
    definition, rates = contents.on(motion, "s1", roots)
    if role == "force":
        definition = Load(power=((definition, [rates[name] for name in rows]),))
    p = [f"p{i}" for i in range(contents.numbers)]
    return _module("user", differentiate(tape, role, definition, motion, a, ["s1"], p), contents.measures)


@lru_cache(maxsize=256)
def moved_kernel(
    name: str,
    frame: str,
    moved: tuple[tuple[int, Node, bool], ...],
    coordinates: tuple[str, ...],
    parameters: tuple[str, ...],
    measures: tuple[Measured, ...] = (),
) -> Any:
    """Return the kernel of an element some of whose parameters are expressions of the motion.

    Parameters
    ----------
    name, frame : str
        The element and its frame.
    moved : tuple of (int, Node, bool)
        Number of the parameter, its expression, and whether it must be positive.
    coordinates, parameters, measures : tuple
        As in `user_kernel`; they follow those of the element.
    """
    from mbstab.compiler.derive import derive
    from mbstab.mechanics.elements import ELEMENTS

    contents = Contents(coordinates, parameters, measures)
    return _module(name, derive(ELEMENTS[name], frame, _Moved(contents, moved)), contents.measures)


class Contents:
    """What expressions contain, as inputs of a kernel: q0 … and u0 … the coordinates and rates, p0 … the numbers."""

    def __init__(
        self, coordinates: tuple[str, ...], parameters: tuple[str, ...], measures: tuple[Measured, ...]
    ) -> None:
        self._coordinates, self._parameters = coordinates, parameters
        self.coordinates = len(coordinates)
        self.numbers = len(parameters) + sum(x.size for x in measures)
        number = {name: i for i, name in enumerate(coordinates)}
        place, self.measures = len(parameters), list[MeasureKernel]()
        for k, measure in enumerate(measures):
            self.measures.append(MeasureKernel(measure, f"m{k}_", number, place - self.numbers))
            place += measure.size

    def on(self, motion: Moving, time: str, roots: Iterable[Node]) -> tuple[Any, dict[str, Term]]:
        """Return expressions on the tape of a motion, and the rates of the coordinates and measures."""
        tape = motion.tape
        inputs = {name: f"q{i}" for i, name in enumerate(self._coordinates)}
        inputs |= {name: f"p{i}" for i, name in enumerate(self._parameters)} | {"t": time}
        names = {name: tape.input(symbol) for name, symbol in inputs.items()}
        rates = {name: tape.input(f"u{i}") for i, name in enumerate(self._coordinates)}
        f = tape.arithmetic()
        for measure in self.measures:
            names[measure.name], rates[measure.name] = measure.on(motion)
        found = []
        for root in roots:
            try:
                found.append(tape.term(Expression("", root).evaluate(names, f, rates)))
            except ExpressionError as error:
                raise ExpressionError(error.message, error.position, error.hint, root) from None
        return found, rates


class _Moved:
    """The parameters of an element that are expressions; see `mbstab.compiler.derive.Given`."""

    def __init__(self, contents: Contents, moved: tuple[tuple[int, Node, bool], ...]) -> None:
        self.coordinates, self.numbers = contents.coordinates, contents.numbers
        self._contents, self._moved = contents, moved

    def terms(self, motion: Moving, time: str) -> dict[int, Term]:
        """Return the expressions; one that must be positive is the square of its root."""
        found, _ = self._contents.on(motion, time, [root for _, root, _ in self._moved])
        tape = motion.tape
        f = tape.arithmetic()
        terms: dict[int, Term] = {}
        for (i, _, positive), term in zip(self._moved, found, strict=True):
            root = tape.term(f.sqrt(term)) if positive else term
            terms[i] = root * root if positive else term
        return terms


def _module(name: str, derived: Derived, measures: list[MeasureKernel]) -> ModuleType:
    """Return a kernel made of what was derived, and of the kernels of the measures in it."""
    from mbstab.compiler.emit import emit

    module: dict[str, Any] = {}
    # The text is safe: it was generated from the parsed terms, not taken from the file.
    exec(compile(emit(derived, "expressions of a model file"), "<user kernel>", "exec"), module)
    functions = [key for key in ("dynamics", "linearize", "linearize_rows") if key in module]
    kernel = ModuleType(name)
    for key in functions:
        run = _seeing(key, module[key], measures) if measures else module[key]
        vars(kernel).update({key: run, key.upper(): module[key.upper()]})
    return kernel


def _seeing(function: str, run: Callable[..., Any], measures: list[MeasureKernel]) -> Callable[..., Any]:
    """Return a function of a kernel that takes what measures give."""

    def with_measures(f: Any, q: Any, u: Any, p: Any, s: Any, *last: Any) -> Any:
        a = last[0] if function == "linearize_rows" else None
        seen = [x for measure in measures for x in measure.values(f, function, q, u, p, a)]
        return run(f, q, u, p, s, seen, *last)

    return with_measures
