"""Kernels of the expressions of a model file, derived when the model is read."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import lru_cache
from types import ModuleType
from typing import TYPE_CHECKING, Any

from mbstab.compiler.measured import Measured
from mbstab.model.expressions import Expression, ExpressionError, Node

if TYPE_CHECKING:
    from mbstab.compiler.derive import Derived, Moving
    from mbstab.compiler.tape import Term
    from mbstab.mechanics.frames import Frame


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
    return _module("user", differentiate(tape, role, definition, motion, a, ["s1"], p))


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

    return _module(name, derive(ELEMENTS[name], frame, _Moved(Contents(coordinates, parameters, measures), moved)))


class Contents:
    """What expressions contain, as inputs of a kernel: q0 … and u0 … the coordinates and rates, p0 … the numbers."""

    def __init__(
        self, coordinates: tuple[str, ...], parameters: tuple[str, ...], measures: tuple[Measured, ...]
    ) -> None:
        self._coordinates, self._parameters, self._measures = coordinates, parameters, measures
        self.coordinates = len(coordinates)
        self.numbers = len(parameters) + sum(x.size for x in measures)

    def on(self, motion: Moving, time: str, roots: Iterable[Node]) -> tuple[Any, dict[str, Term]]:
        """Return expressions on the tape of a motion, and the rates of the coordinates and measures."""
        n, tape = len(self._parameters), motion.tape
        inputs = {name: f"q{i}" for i, name in enumerate(self._coordinates)}
        inputs |= {name: f"p{i}" for i, name in enumerate(self._parameters)} | {"t": time}
        names = {name: tape.input(symbol) for name, symbol in inputs.items()}
        rates = {name: tape.input(f"u{i}") for i, name in enumerate(self._coordinates)}
        numbers = (tape.input(f"p{i}") for i in range(n, self.numbers))
        f = tape.arithmetic()

        def frame(body: Sequence[str], base: list[Term]) -> Frame:
            return motion.frame([inputs[name] for name in body], measure.dimension, base)

        for measure in self._measures:
            value = tape.term(measure.of(frame, numbers))
            names[measure.name], rates[measure.name] = value, value if measure.kind.speed else motion.rate(value)
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


def _module(name: str, derived: Derived) -> ModuleType:
    """Return a kernel made of what was derived."""
    from mbstab.compiler.emit import emit

    module: dict[str, Any] = {}
    # The text is safe: it was generated from the parsed terms, not taken from the file.
    exec(compile(emit(derived, "expressions of a model file"), "<user kernel>", "exec"), module)
    functions = [key for key in ("dynamics", "linearize", "linearize_rows") if key in module]
    kernel = ModuleType(name)
    vars(kernel).update({key: module[key] for name in functions for key in (name, name.upper())})
    return kernel
