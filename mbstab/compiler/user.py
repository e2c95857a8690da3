"""Kernels of the expressions of a model file, derived when the model is read."""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache
from itertools import accumulate
from types import ModuleType
from typing import TYPE_CHECKING, Any

from mbstab.compiler.measure_kernels import MeasureKernel, carried
from mbstab.compiler.measured import Measured, all_coordinates
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
        ``holonomic``, ``nonholonomic``, ``force``, ``potential`` or ``dissipation``.
    expressions : tuple of Expression
        One per row; for a force one per coordinate in `rows`.
    rows : tuple of str
        Coordinates on which the generalized forces act (forces only).
    coordinates, parameters : tuple of str
        The names that are written; the kernel takes their values in this order. The time is its
        one given function.
    measures : tuple of Measured
        The measures that occur; base rotations and numbers of each follow the parameters, and coordinates that only
        they contain those that are written.
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
    from mbstab.compiler.derive import Moving, differentiate, with_potential
    from mbstab.compiler.tape import Tape
    from mbstab.mechanics.catalogue import Load

    contents = Contents(coordinates, parameters, measures)
    q, u, a = ([f"{x}{i}" for i in range(contents.coordinates)] for x in ("q", "u", "a"))
    tape = Tape(shares=True)
    motion = Moving(tape, q, u, ["s1"])
    definition, rates = contents.on(motion, "s1", roots)
    if role == "force":
        definition = Load(power=((definition, [rates[name] for name in rows]),))
    elif role in ("potential", "dissipation"):
        definition, role = Load(**{role: definition[0]}), "force"
    p = [f"p{i}" for i in range(contents.numbers)]
    derived = differentiate(tape, role, definition, motion, a, ["s1"], p)
    return _module("user", with_potential(derived, definition), contents)


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
    from mbstab.mechanics.catalogue import COORDINATES
    from mbstab.mechanics.elements import ELEMENTS

    element = ELEMENTS[name]
    contents = Contents(coordinates, parameters, measures, sum(len(COORDINATES[x]) for x in element.slot_kinds(frame)))
    return _module(name, derive(element, frame, _Moved(contents, moved)), contents)


class Contents:
    """What expressions contain, as inputs of a kernel: coordinates and measures q0 …, rates u0 …, numbers p0 …."""

    def __init__(
        self,
        coordinates: tuple[str, ...],
        parameters: tuple[str, ...],
        measures: tuple[Measured, ...],
        before: int = 0,
    ) -> None:
        self._names, self._parameters = (*coordinates, *(x.name for x in measures)), parameters
        self.coordinates, self.numbers = len(self._names), len(parameters)
        number = {name: i for i, name in enumerate(all_coordinates(coordinates, measures), before)}
        place = accumulate((x.size for x in measures), initial=-sum(x.size for x in measures))
        self.measures = [MeasureKernel(x, number, i) for x, i in zip(measures, place, strict=False)]
        self.first = before + len(coordinates)
        """Number of the first measure among all coordinates of a kernel, which are `before` more."""

    def on(self, motion: Moving, time: str, roots: Iterable[Node]) -> tuple[Any, dict[str, Term]]:
        """Return expressions on the tape of a motion, and the rates of the coordinates and measures."""
        tape = motion.tape
        names = {name: tape.input(f"p{i}") for i, name in enumerate(self._parameters)} | {"t": tape.input(time)}
        names |= {name: tape.input(f"q{i}") for i, name in enumerate(self._names)}
        rates = {name: tape.input(f"u{i}") for i, name in enumerate(self._names)}
        for i, measure in enumerate(self.measures, self.first):
            name = measure.name
            if measure.kind.speed:
                names[name], motion.along[i] = rates[name], {}
            elif measure.kind.root:
                motion.along[i] = {names[name]: 1 / names[name]}
                rates[name] /= names[name]
        f = tape.arithmetic()
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


def _module(name: str, derived: Derived, contents: Contents) -> ModuleType:
    """Return a kernel made of what was derived, and of the kernels of the measures in it."""
    from mbstab.compiler.emit import emit

    for i, measure in enumerate(contents.measures, contents.first):
        if measure.kind.root and (i, i) in derived.linearize["K"]:
            derived.linearize["K"][i, i] *= derived.tape.input(derived.inputs["q"][i])
    kernel = ModuleType(name)
    # The text is safe: it was generated from the parsed terms, not taken from the file.
    exec(compile(emit(derived, "expressions of a model file"), "<user kernel>", "exec"), vars(kernel))
    return carried(kernel, contents.measures, contents.first) if contents.measures else kernel
