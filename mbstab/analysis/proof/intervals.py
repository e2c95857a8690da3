"""Verdicts for every value of a parameter in an interval, for one and the same equilibrium.

The interval is divided until each part is decided. Where the motion is solved for, it is followed: it begins at the
solution for the guess of the file at one value, and a part counts only if the solution at the end from which it is
reached is proven to be the only one of the part as well. At that end both are enclosed; each is alone in a box; the
narrow enclosure at the end lies in the boxes on both sides. Where no part is reached, the rest is left open.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import field, replace
from fractions import Fraction
from typing import NamedTuple

from mbstab.analysis.algebra.failures import FAILURES
from mbstab.analysis.proof.analytic import require_analytic
from mbstab.analysis.proof.characteristic import GENERIC, Proof
from mbstab.analysis.proof.identities import Identities
from mbstab.analysis.proof.proven_facts import Case, best
from mbstab.analysis.proof.tolerances import TOLERANCES
from mbstab.analysis.verdict.rule import ASYMPTOTIC_UP_TO, STABLE_UP_TO, STRENGTH, UNDECIDED
from mbstab.analysis.verdict.spectrum import Modulo
from mbstab.analysis.verdict.wording import phrases
from mbstab.errors import MbstabError
from mbstab.model import balls
from mbstab.model.balls import Ball, ball
from mbstab.model.schema import Model
from mbstab.records import dataclass

OPEN = "not provable"

INSIDE = (Fraction(1, 2), Fraction(38197, 100000))
"""Position in a part at which it is tested besides its ends, if it rests on something unproven."""

"""Errors of a start in double precision, or of a ball that is too wide."""


@dataclass(frozen=True)
class Part:
    """What is proven for all values of a parameter between two ends.

    Attributes
    ----------
    low, high : Fraction
        In SI.
    verdict : str
        As in `mbstab.analysis.proof.certify.Certificate`.
    reason : str
        Why there is none.
    at_low, at_high : dict
        Enclosures at both ends of the coordinates that are solved for; empty where they are given or open.
    modulo : Modulo
        Symmetries and families up to which the verdict holds.
    """

    low: Fraction
    high: Fraction
    verdict: str
    reason: str = ""
    at_low: Mapping[str, Ball] = field(default_factory=dict)
    at_high: Mapping[str, Ball] = field(default_factory=dict)
    modulo: Modulo = field(default_factory=Modulo)

    @property
    def words(self) -> str:
        """The verdict with what it holds up to."""
        return in_words(self.verdict, self.modulo)


class _Tried(NamedTuple):
    """Result for a box: verdict, why there is none, whether the motion continues to its far end, and that motion.

    `coarse`: the verdict is as in `Case.coarse`.
    """

    verdict: str
    reason: str
    continued: bool
    there: Proof | None
    modulo: Modulo = Modulo()
    coarse: bool = False


class Walk:
    """The parts of an interval, in the order in which they are reached.

    Attributes
    ----------
    parts : list of Part
        In ascending order.
    assumed, conditions : list of str
    start : Fraction or None
        Value at which the motion is found from the guess of the file; None: it is given.
    """

    def __init__(
        self,
        model: Model,
        name: str,
        ends: tuple[Fraction, Fraction],
        progress: Callable[[float], object],
    ) -> None:
        self.model, self.name, self.progress = model, name, progress
        self.low, self.high = ends
        self.width = self.high - self.low
        self.generic = self.low + self.width * GENERIC
        self.parts: list[Part] = []
        self.assumed: list[str] = []
        self.conditions: list[str] = []
        self.start: Fraction | None = None
        self.boxes, self.done, self.began = 0, Fraction(0), time.monotonic()
        self.points: dict[Fraction, Proof | str] = {}
        self.identities: Identities | None = None
        self.analytic: list[tuple[Fraction, Fraction]] = []
        self._run()

    def _run(self) -> None:
        first, proof, reasons = None, None, []
        generic = self._point(self.generic, None)
        self.identities = generic.identities if isinstance(generic, Proof) else None
        for x in (self.low, self.high, (self.low + self.high) / 2):
            found = self._point(x, None)
            if isinstance(found, Proof):
                first, proof = x, found
                break
            reasons.append(f"at {self._told(x)}: {found}")
        searched = self.model.reference.find is not None
        if proof is None and searched:
            what = "steady motion" if self.model.reference.find == "steady" else "equilibrium"
            self._leave(
                self.low, self.high, f"no {what} is proven to exist at its ends and in its middle ({reasons[0]})"
            )
            return
        if proof is None or first is None or not (proof.solutions or proof.taken):
            self._cover(self.low, self.high, None)
            return
        self.start = first
        if first < self.high:
            self._cover(first, self.high, proof)
        if first > self.low:
            self._cover(first, self.low, proof)

    def _told(self, x: Fraction, places: int = 6) -> str:
        """Return a value of the parameter in its unit."""
        parameter = self.model.parameters[self.name]
        return f"{self.name} = {float(x) / parameter.factor:.{places}g} {parameter.unit}".rstrip()

    # --- one value --------------------------------------------------------------------------------------------------

    def _point(self, x: Fraction, near: Proof | None) -> Proof | str:
        """Return the motion at one value, or why it is not proven; motions that are given are kept."""
        if near is None and x in self.points:
            return self.points[x]
        found: Proof | str
        try:
            found = Proof(self.model, {self.name: ball(x)}, near, self._identities(x, x))
        except FAILURES as error:
            found = _said(error)
        if near is None:
            self.points[x] = found
        return found

    def _identities(self, a: Fraction, b: Fraction) -> Identities | None:
        """Return what is proven at a generic value, if all expressions are analytic from there to a part."""
        if self.identities is None:
            return None
        ends = min(a, b, self.generic), max(a, b, self.generic)
        if not any(low <= ends[0] and ends[1] <= high for low, high in self.analytic):
            try:
                require_analytic(self.model, {self.name: balls.between(*map(ball, ends))})
            except FAILURES:
                return None
            self.analytic.append(ends)
        return self.identities

    def _decided(self, x: Fraction, near: Proof | None) -> bool:
        """Whether a verdict is proven at one value."""
        proof = self._point(x, near)
        if not isinstance(proof, Proof):
            return False
        try:
            return best(proof).verdict.word != UNDECIDED
        except FAILURES:
            return False

    # --- parts ------------------------------------------------------------------------------------------------------

    def _cover(self, first: Fraction, last: Fraction, here: Proof | None) -> None:
        """Divide the interval from one end to the other, following the motion if it is solved for."""
        stack = [(first, last)]
        least = self.width * Fraction(TOLERANCES.part_width)
        while stack:
            a, b = stack.pop()
            self.boxes += 1
            passed = time.monotonic() - self.began
            if self.boxes > TOLERANCES.interval_parts or passed > TOLERANCES.interval_time:
                self._leave(a, last, f"given up after {self.boxes - 1} parts and {passed:.0f} s")
                return
            tried = self._tried(a, b, here)
            width = abs(b - a)
            if tried.coarse and width > self.width * Fraction(TOLERANCES.unplaced_width):
                stack += [((a + b) / 2, b), (a, (a + b) / 2)]
                continue
            if (not tried.continued or tried.verdict == OPEN) and width > least:
                middle = (a + b) / 2
                hopeless = (
                    tried.continued
                    and width <= self.width * Fraction(TOLERANCES.hopeless_width)
                    and not any(self._decided(x, here) for x in (a, b, middle))
                )
                if not hopeless:
                    stack += [(middle, b), (a, middle)]
                    continue
            if not tried.continued:
                assert self.start is not None
                lost = f"is lost near {self._told(a, 9)}: {tried.reason}"
                self._leave(a, last, f"the motion followed from {self._told(self.start)} {lost}")
                return
            at = [x.solved() if x is not None else {} for x in (here, tried.there)]
            if a > b:
                at.reverse()
            self._add(Part(min(a, b), max(a, b), tried.verdict, tried.reason, at[0], at[1], tried.modulo))
            here = tried.there

    def _tried(self, a: Fraction, b: Fraction, here: Proof | None) -> _Tried:
        """Return what is proven between two values, starting from the motion at the first one."""
        box = balls.between(ball(min(a, b)), ball(max(a, b)))
        try:
            proof = Proof(self.model, {self.name: box}, here, self._identities(a, b))
        except FAILURES as error:
            return _Tried(OPEN, _said(error), here is None, here)
        there: Proof | None = None
        if here is not None:
            if not proof.same_at(here):
                return _Tried(OPEN, "it is not proven to be continued there", False, here)
            found = self._point(b, proof)
            if isinstance(found, str):
                return _Tried(OPEN, found, False, here)
            if not proof.same_at(found):
                return _Tried(OPEN, "it is not proven to be continued there", False, here)
            there = found
        try:
            case = best(proof)
            judged = case.verdict
        except FAILURES as error:
            return _Tried(OPEN, _said(error), True, there)
        if judged.word != UNDECIDED:
            places = ([a, b] if here is None else []) + [a + (b - a) * x for x in INSIDE] * bool(proof.conditions)
            wrong = (self._point(x, None if here is None else proof) for x in places)
            if bad := next((x for x in wrong if isinstance(x, str)), ""):
                return _Tried(OPEN, bad, True, there)
            self._note(proof, case)
            return _Tried(judged.word, "", True, there, judged.modulo, case.coarse)
        return _Tried(OPEN, "; ".join(dict.fromkeys(judged.reasons)), True, there)

    def _note(self, proof: Proof, case: Case) -> None:
        """Record what the verdict of a part rests on besides the file."""
        self.assumed += [x for x in (*proof.assumed, *case.conditions) if x not in self.assumed]
        self.conditions += [x for x in (*proof.conditions, *case.conditions) if x not in self.conditions]

    def _leave(self, a: Fraction, b: Fraction, reason: str) -> None:
        """Record the part between two values as open."""
        self._add(Part(min(a, b), max(a, b), OPEN, reason))

    def _add(self, part: Part) -> None:
        """Add a part, merged with its neighbour if the verdict is the same."""
        self.done += part.high - part.low
        self.progress(float(self.done / self.width))
        for k, other in enumerate(self.parts):
            if other.words != part.words:
                continue
            if other.high == part.low:
                self.parts[k] = replace(other, high=part.high, at_high=part.at_high)
                return
            if other.low == part.high:
                self.parts[k] = replace(other, low=part.low, at_low=part.at_low)
                return
        self.parts = sorted([*self.parts, part], key=lambda x: x.low)


def common(parts: Sequence[Part]) -> tuple[str, Modulo] | None:
    """Return the strongest verdict that the verdicts of all parts imply, and up to what; None if there is none."""
    if any(part.verdict == OPEN for part in parts):
        return None
    implied = frozenset[str].intersection(*(STRENGTH[part.verdict] for part in parts)) - {UNDECIDED}
    modulos = {part.modulo for part in parts if part.modulo != Modulo()}
    if not implied or len(modulos) > 1:
        return None
    return max(implied, key=lambda word: len(STRENGTH[word] & implied)), modulos.pop() if modulos else Modulo()


def in_words(word: str, modulo: Modulo) -> str:
    """Return a verdict with what it holds up to."""
    names = modulo.names
    return f"{word} ({phrases(names)})" if word in (ASYMPTOTIC_UP_TO, STABLE_UP_TO) and names else word


def _said(error: Exception) -> str:
    """Return what went wrong in one line."""
    if isinstance(error, MbstabError):
        return str(error).partition("\n")[0]
    return f"double precision does not suffice there ({error})"
