"""Where expressions have no continuous derivatives with respect to the state."""

from __future__ import annotations

import math
from collections.abc import Container, Iterator
from fractions import Fraction
from typing import Any

import numpy as np

from mbstab.analysis.verdict.constancy import call_at
from mbstab.analysis.verdict.exact_sums import Atom, Monomial, Structure, Sum, atoms, divided
from mbstab.analysis.verdict.tolerances import TOLERANCES
from mbstab.analysis.verdict.written import cut, with_state
from mbstab.compiler.measured import values
from mbstab.compiler.system import System
from mbstab.model.expressions import Call, Expression, ExpressionError
from mbstab.model.functions import CALLED, Break
from mbstab.model.schema import is_length

SMOOTH = 99
"""Number of continuous derivatives where there is no kink."""

Place = tuple[int, Atom, str]
"""How many derivatives are continuous (−1: not even the value), of which factor, and where."""


def kinks(
    system: System,
    q: Any,
    u: Any,
    time: Any,
    order: int = 2,
    along: bool = False,
    resisting: Container[str] = (),
) -> str:
    """Return where an expression lacks the required continuous derivatives with respect to the state.

    Only expressions of the file are looked at: forces and constraints. A state within rounding
    of a kink counts as being there.

    Parameters
    ----------
    q, u : array_like, shape (…, n_q)
        Coordinates (m, rad) and speeds of the reference.
    time : float or array_like, shape (…) (s)
    order : int
        Number of derivatives that must be continuous.
    along : bool
        Whether the states are those of one motion, which also passes all states between two of them.
    resisting : container of str
        Paths of forces of which only what they are at rest is looked at.

    Returns
    -------
    str
        A sentence, or nothing.
    """
    corners: Corners | None = None
    for path, expression in with_state(system):
        corners = corners or Corners(Structure(system.scene), system, q, u, time, along)
        try:
            place = corners.worst(corners.structure.exact(expression, still=path in resisting))
        except ExpressionError as error:
            return f"the equations are not smooth at the reference: {path} ({cut(expression.text)}): {error.message}"
        if place is not None and place[0] < order:
            text = corners.text(expression, place[1])
            missing = {-1: "is not continuous", 0: "has no derivative"}.get(place[0], "has no second derivative")
            return f"the equations have a kink at the reference: {path} ({text}) {missing} where {place[2]}"
    return ""


class Corners:
    """Values of sums at a state or at many, and search for kinks there."""

    def __init__(self, structure: Structure, system: System, q: Any, u: Any, time: Any, along: bool = False) -> None:
        self.structure, self.along = structure, along
        q, u = np.asarray(q, dtype=float), np.asarray(u, dtype=float)
        self.alone = q.ndim == 1
        lengths = np.array([is_length(name) for name in system.names], dtype=bool)
        known = max((abs(float(x)) for x in system.scene.lengths), default=0.0) or 1.0
        sizes = np.where(lengths, max(known, float(np.max(np.abs(q[..., lengths]), initial=0.0))), 1.0)
        speed = max(1.0, float(np.max(np.abs(u) / sizes, initial=0.0)))
        self.names: dict[str, Any] = {"t": np.asarray(time, dtype=float)}
        self._worst: dict[Sum, Place | None] = {}
        self.steps: dict[str, Any] = {}
        for i, name in enumerate(system.names):
            self.names[name], self.names[f"rate({name})"] = q[..., i], u[..., i]
            self.steps[name] = TOLERANCES.kink_distance * max(float(np.max(np.abs(q[..., i]))), sizes[i])
            self.steps[f"rate({name})"] = TOLERANCES.kink_distance * speed * sizes[i]
        if system.scene.measures:
            measures = values(system.scene, system.names, q, u)
            self.names |= measures
            reach = float(np.max(sizes, initial=1.0))
            for name, value in measures.items():
                size = reach * (speed if name.startswith("rate(") else 1.0)
                self.steps[name] = TOLERANCES.kink_distance * max(float(np.max(np.abs(value))), size)
        self.angles = {
            name: x.numbers[-1] for name, x in system.scene.measures.items() if x.kind == "angle" and len(x.numbers)
        }

    def near(self, x: Sum) -> bool:
        """Whether a sum is zero within rounding, or has no value, at any of the states."""
        sign = self.sign(x)
        return not np.all(sign) or (self.along and bool(np.any(sign != sign.flat[0])))

    def sign(self, x: Sum) -> Any:
        """Return the sign of a sum at each state; 0 where it is zero within rounding, or has no value."""
        value, size = self.structure.value(x, self.names)
        room = TOLERANCES.constant_rounding * size
        for name in {atom.name for atom in atoms(x) if atom.kind == "state"}:
            moved = [
                abs(self.structure.value(x, {**self.names, name: self.names[name] + step})[0] - value)
                for step in (-self.steps[name], self.steps[name])
            ]
            room = room + np.maximum(*moved)
        return np.where(np.abs(value) > room, np.sign(value), 0.0)

    def worst(self, x: Sum) -> Place | None:
        """Return the place with the fewest continuous derivatives, or None if there is no kink."""
        if x in self._worst:
            return self._worst[x]
        found: list[Place] = []
        for monomial, _ in x.terms:
            for atom, n in monomial:
                if not atom.state:
                    continue
                derivatives, where = self._derivatives(atom, n, monomial)
                if -1 < derivatives < SMOOTH and _with_its_argument(x, atom, n):
                    derivatives += 1
                places = [(derivatives, atom, where)] if derivatives < SMOOTH else []
                inner = atom.arguments
                if atom.kind == "power" and (size := _absolute(inner[0])) is not None:
                    inner = size[0].arguments
                places += [place for argument in inner if (place := self.worst(argument)) is not None]
                if any(not place[0] for place in places) and self._fades(x, atom, n):
                    places = [(place[0] or 1, *place[1:]) for place in places]
                found += places
        self._worst[x] = min(found, key=lambda place: place[0]) if found else None
        return self._worst[x]

    def _derivatives(self, atom: Atom, n: int, monomial: Monomial) -> tuple[int, str]:
        """Return how many derivatives of a product are continuous with respect to one factor, and where not."""
        x = atom.arguments[0] if atom.arguments else Sum.of(atom)
        if atom.kind == "power":
            return self._of_power(atom)
        if atom.name in self.angles:
            turned = np.abs(self.names[atom.name] - self.angles[atom.name])
            if np.any(math.pi - turned <= self.steps[atom.name]):
                return -1, "the joint is turned by half a turn from the reference"
        if atom.kind in ("group", "state"):
            return (-1, "it divides by 0") if n < 0 and self.near(x) else (SMOOTH, "")
        found = [(self._smooth(where, atom, n, monomial), where.text) for where in self._met(atom)]
        return min(found, default=(SMOOTH, ""))

    def _fades(self, x: Sum, atom: Atom, n: int) -> bool:
        """Whether all that has a factor without a derivative has one at the state, where its other factors vanish."""
        if not self.alone:
            return False
        others = self._order(_beside(x, (atom, n)))
        return others >= 1 or others + n * self._vanishing(atom) > 1

    def _vanishing(self, atom: Atom) -> Fraction:
        """Return p such that a factor is at most of the size of r**p at a small distance r from the only state."""
        if not atom.state or not self.near(Sum.of(atom)):
            return Fraction(0)
        if atom.kind == "state":
            return Fraction(1)
        orders = [self._order(x) for x in atom.arguments]
        match atom.kind:
            case "abs" | "hypot" | "group":
                return min(orders)
            case "sqrt":
                return orders[0] / 2
            case "power":
                return orders[0] * max(self._least(atom.arguments[1]), Fraction(0))
        smooth = not any(self._met(atom)) and all(self.worst(x) is None for x in atom.arguments)
        return Fraction(smooth)

    def _order(self, x: Sum) -> Fraction:
        """Return the same of a sum that vanishes: what its terms vanish with, or 1 if it has slopes and they cancel."""
        least = min((sum(n * self._vanishing(atom) for atom, n in m) for m, _ in x.terms), default=Fraction(0))
        return Fraction(least) if least > 0 else Fraction(self.worst(x) is None and self.near(x))

    def _met(self, atom: Atom) -> Iterator[Break]:
        """Yield the breaks of a function near which the state is."""
        f = self.structure.arithmetic()
        for where in CALLED[atom.kind].breaks_at(len(atom.arguments)) if atom.kind in CALLED else ():
            if all(map(self.near, where.where(f, *atom.arguments))):
                saving = None if where.unless is None else where.unless(f, *atom.arguments)
                if saving is None or self.near(saving) or not np.all(self.structure.value(saving, self.names)[0] > 0.0):
                    yield where

    @staticmethod
    def _smooth(where: Break, atom: Atom, n: int, monomial: Monomial) -> int:
        """Return how many derivatives of a power of a function are continuous at a break."""
        if where.zero and n < 0:
            return -1
        if where.square and n % 2 == 0:
            return SMOOTH
        inside = _inside(atom)
        if where.zero and (inside or atom.kind != "sqrt"):
            return n * (where.smooth + 1) - 1 + sum(max(k, 0) for factor, k in monomial if factor in inside)
        return where.smooth

    def _of_power(self, atom: Atom) -> tuple[int, str]:
        base, exponent = atom.arguments
        if not base.state or not self.near(base):
            return SMOOTH, ""
        size, n = _absolute(base), self._least(exponent)
        smooth = math.ceil(size[1] * n) - 1 if size is not None and n > 0 else -1
        return smooth, "the base of a power is 0"

    def _least(self, exponent: Sum) -> Fraction:
        """Return an exponent, or what it surely exceeds: 0 if nothing is known."""
        if exponent.rational is not None:
            return exponent.rational
        if exponent.time or exponent.state or self.structure.uncertain(exponent):
            return Fraction(0)
        value, size = self.structure.value(exponent)
        least = float(np.min(value - TOLERANCES.constant_rounding * size))
        return Fraction(least) if math.isfinite(least) else Fraction(0)

    def text(self, expression: Expression, atom: Atom) -> str:
        """Return a function in an expression as it is written, or the whole expression."""
        for node in expression.walk():
            if isinstance(node, Call) and node.function == atom.kind:
                arguments = tuple(self.structure.exact(Expression("", x)) for x in node.arguments)
                if arguments == atom.arguments:
                    return cut(call_at(expression.text, node.position))
        return cut(expression.text)


def _absolute(x: Sum) -> tuple[Atom, int] | None:
    """Return abs(…) and n of a multiple of abs(…)**n, else None."""
    if len(x.terms) != 1:
        return None
    ((monomial, _),) = x.terms
    pair = next(iter(monomial)) if len(monomial) == 1 else None
    return pair if pair is not None and pair[0].kind == "abs" and pair[1] > 0 else None


def _with_its_argument(x: Sum, atom: Atom, n: int) -> bool:
    """Whether a sum of several terms is a factor of all in a sum that has a power of its absolute value as a factor."""
    argument = atom.arguments[0] if atom.kind == "abs" else Sum()
    if len(argument.terms) < 2:
        return False
    return divided(_beside(x, (atom, n)), argument) is not None


def _beside(x: Sum, factor: tuple[Atom, int]) -> Sum:
    """Return by what a factor is multiplied in a sum."""
    return Sum(frozenset((m - {factor}, c) for m, c in x.terms if factor in m))


def _inside(atom: Atom) -> set[Atom]:
    """Return factors no larger than a function, up to constants: its arguments, or what is squared under a root."""
    if atom.kind == "sqrt":
        terms, power = atom.arguments[0].terms, 2
    else:
        terms, power = frozenset().union(*(x.terms for x in atom.arguments if len(x.terms) == 1)), 1
    found = {
        inner
        for monomial, c in terms
        for inner, n in monomial
        if len(monomial) == 1 and n == power and (c > 0 or n == 1)
    }
    if atom.kind == "sqrt":
        return found if len(found) == len(terms) else set()
    return found
