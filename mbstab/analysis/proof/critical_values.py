"""Critical values of a parameter that are proven: enclosed between two values that differ in stability.

A test function of the coefficients of the characteristic polynomial is zero where stability changes: the product of
the eigenvalues (divergence), the last but one Hurwitz determinant (flutter), or, where the polynomial is even, its
discriminant (collision). A narrow interval around its zero is found, in which the elimination succeeds everywhere and
there is provably one motion. A test function may also be zero where stability does not change (two real eigenvalues
±σ). So the proof rests on the numbers of eigenvalues right of the imaginary axis at both ends, where all are enclosed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np

from mbstab.analysis.algebra import ball_matrices, ball_polynomials
from mbstab.analysis.algebra.balls import NotProvable
from mbstab.analysis.proof.analytic import require_analytic
from mbstab.analysis.proof.characteristic import GENERIC, Proof
from mbstab.analysis.proof.identities import Identities
from mbstab.analysis.proof.proven_facts import Case, best
from mbstab.analysis.proof.tolerances import TOLERANCES
from mbstab.analysis.sweep.critical import Critical, Enclosed
from mbstab.analysis.sweep.sweep import Sweep
from mbstab.errors import MbstabError
from mbstab.model import balls
from mbstab.model.balls import Ball, ball, fraction_beyond, real, zero_inside
from mbstab.model.schema import Model
from mbstab.model.units import exact_factor
from mbstab.records import dataclass

LOCATED = ("divergence", "flutter", "collision")
"""Kinds of critical values at which a test function is zero."""


@dataclass(frozen=True)
class Change:
    """An interval of a parameter (SI) in which stability changes for certain.

    Attributes
    ----------
    low, high : Fraction
    test : str
        Which function changes its sign: ``divergence``, ``flutter`` or ``collision``.
    unstable : tuple of int
        Number of eigenvalues right of the imaginary axis at `low` and at `high`.
    conditions : tuple of str
        What is not proven and must hold, as clauses of a sentence.
    """

    low: Fraction
    high: Fraction
    test: str
    unstable: tuple[int, int]
    conditions: tuple[str, ...]


def with_enclosures(model: Model, sweep: Sweep, progress: Callable[[float], object], digits: int = 20) -> Sweep:
    """Return a sweep whose critical values are proven, or say why they are not.

    Parameters
    ----------
    model : Model
        That of the sweep.
    progress : callable
        Is called with the part of the work that is done, from 0 to 1.
    digits : int
        Digits to which critical values are enclosed.
    """
    found = []
    for number, critical in enumerate(sweep.critical, 1):
        found.append(replace(critical, enclosed=_enclosed(model, sweep, critical, digits)))
        progress(number / len(sweep.critical))
    beyond = Enclosed(reason="it is on a path beyond a fold; only critical values of the first path are proven")
    paths = (replace(path, critical=tuple(replace(x, enclosed=beyond) for x in path.critical)) for path in sweep.beyond)
    return replace(sweep, critical=tuple(found), beyond=tuple(paths))


def _enclosed(model: Model, sweep: Sweep, critical: Critical, digits: int) -> Enclosed:
    """Return what is proven about a critical value of a sweep."""
    if critical.kind not in LOCATED:
        return Enclosed(reason=f"only {', '.join(LOCATED)} can be proven, not {critical.kind!r}")
    name = sweep.parameter
    ends = [abs(x) for x in (critical.value, float(sweep.values[-1] - sweep.values[0]))]
    apart = [abs(x.value - critical.value) / 2.0 for x in sweep.critical if x.value != critical.value]
    reason = ""
    for part in TOLERANCES.critical_brackets:
        reach = Fraction(min((part * max(ends), *apart)))
        middle = Fraction(critical.value)
        try:
            change = proven_change(model, name, middle - reach, middle + reach, digits)
        except MbstabError as error:
            reason = str(error).splitlines()[0]
            continue
        if min(critical.unstable) >= 0 and change.unstable != critical.unstable:
            counts = " to ".join(map(str, change.unstable))
            return Enclosed(
                reason=f"the motion proven to exist there has {counts} unstable eigenvalues: it is a different one"
            )
        with balls.digits(digits + TOLERANCES.critical_digits_beyond):
            factor = exact_factor(model.parameters[name].unit, balls.ball_arithmetic())
            value = real(balls.between(ball(change.low), ball(change.high)) / factor)
        return Enclosed(value, digits, change.conditions)
    return Enclosed(reason=reason)


def proven_change(model: Model, parameter: str, low: Fraction, high: Fraction, digits: int = 30) -> Change:
    """Return a narrow interval in which the number of eigenvalues right of the imaginary axis changes.

    Parameters
    ----------
    model : Model
    parameter : str
    low, high : Fraction
        In SI, ascending; stability differs there.
    digits : int
        Correct digits of the enclosure.

    Raises
    ------
    NotProvable
        If no test function changes its sign, or stability is not proven to change with one.
    """
    with balls.digits(digits + TOLERANCES.critical_digits_beyond):
        return _Search(model, parameter, (low, high)).found(digits)


class _Search:
    """The search for a value between two ends at which a test function is zero."""

    def __init__(self, model: Model, parameter: str, ends: tuple[Fraction, Fraction]) -> None:
        self.model, self.parameter, self.ends = model, parameter, ends
        self.near: Proof | None = None
        self.identities = _generic(model, parameter, ends)
        self.names: list[str] = []

    def _proof(self, x: Any, near: Proof | None) -> Proof:
        found = Proof(self.model, {self.parameter: ball(x)}, near, self.identities)
        self.identities = found.identities
        return found

    def _tests(self, x: Any) -> list[tuple[str, Ball]]:
        self.near = self._proof(x, self.near)
        return _tests(self.near)

    def _test(self, x: Any, k: int) -> Ball:
        """Return one of these functions; zero where the equations have another structure: an entry vanishes there."""
        tests = self._tests(x)
        return tests[k][1] if [name for name, _ in tests] == self.names else ball(0)

    def found(self, digits: int) -> Change:
        """Return the interval."""
        first, last = (self._tests(x) for x in self.ends)
        self.names = [name for name, _ in first]
        if self.names != [name for name, _ in last]:
            raise NotProvable(f"the equations do not have the same structure at both ends of {self.parameter}")
        reason = f"no test function changes its sign between both ends of {self.parameter}"
        for k, ((name, f_a), (_, f_b)) in enumerate(zip(first, last, strict=True)):
            if not _opposite(f_a, f_b):
                continue
            a, b = self._narrowed(k, f_a, f_b, digits)
            try:
                return self._verified(k, name, a, b)
            except NotProvable as error:
                reason = str(error)
        raise NotProvable(reason)

    def _verified(self, k: int, name: str, a: Fraction, b: Fraction) -> Change:
        """Return an interval if there is one motion in all of it, of which stability differs at both ends."""
        whole = self._proof(balls.between(ball(a), ball(b)), self.near)
        _tests(whole)
        both = [self._proof(x, whole) for x in (a, b)]
        # The signs are those of the solution that is alone in the enclosure.
        tests = [_tests(proof) for proof in both]
        if any([name for name, _ in found] != self.names for found in tests):
            raise NotProvable(f"the equations do not have the same structure at both ends of {self.parameter}")
        signs = [found[k][1] for found in tests]
        place = f"{self.parameter} = {float(a):.12g} in SI"
        if not (all(whole.same_at(proof) for proof in both) and _opposite(*signs)):
            raise NotProvable(f"the motion is not proven to be the same on both sides of {place}")
        cases = [best(proof) for proof in both]
        if any(e.kind == "open" for case in cases for e in case.enclosures):
            raise NotProvable(f"not all eigenvalues are separated from the imaginary axis next to {place}")
        before, after = (sum(e.count for e in case.enclosures if e.kind == "right") for case in cases)
        if before == after:
            raise NotProvable(f"the number of unstable eigenvalues is {before} on both sides of {place}")
        conditions = (
            *(x for proof in (whole, *both) for x in proof.conditions),
            *(x for case in cases for x in case.conditions),
        )
        return Change(a, b, name, (before, after), tuple(dict.fromkeys(conditions)))

    def _narrowed(self, k: int, f_a: Ball, f_b: Ball, digits: int) -> tuple[Fraction, Fraction]:
        """Return a narrow interval between whose ends a test function changes its sign (false position, Illinois)."""
        a, b = self.ends
        small = max(abs(a), abs(b)) / Fraction(2) ** (int(3.33 * digits) + 8)
        side = 0
        for _ in range(40 * digits):
            if b - a <= small:
                break
            weight = fraction_beyond(real(f_a / (f_a - f_b)).mid(), True)
            # Close to the better end, but not closer than the requested accuracy.
            x = a + (b - a) * min(max(weight, Fraction(0)), Fraction(1))
            x = min(max(x, a + small / 3), b - small / 3)
            x = Fraction(round(x / small * 2**12), 2**12) * small
            f_x = self._test(x, k)
            if zero_inside(f_x):
                x += small / 4
                f_x = self._test(x, k)
            if zero_inside(f_x):
                raise NotProvable(
                    f"the sign of the test function next to {self.parameter} = {float(x):.12g} in SI is open"
                )
            if _opposite(f_a, f_x):
                b, f_b = x, f_x
                f_a = f_a / 2 if side == 1 else f_a
                side = 1
            else:
                a, f_a = x, f_x
                f_b = f_b / 2 if side == -1 else f_b
                side = -1
        return a, b


def _opposite(x: Ball, y: Ball) -> bool:
    return bool((x > 0 and y < 0) or (x < 0 and y > 0))


def _generic(model: Model, parameter: str, ends: Sequence[Fraction]) -> Identities | None:
    """Return what is proven about the elements at a value between both ends; None: there is no motion."""
    try:
        require_analytic(model, {parameter: balls.between(ball(min(ends)), ball(max(ends)))})
        return Proof(model, {parameter: ball(ends[0] + (ends[1] - ends[0]) * GENERIC)}).identities
    except MbstabError:
        return None


def _tests(proof: Proof) -> list[tuple[str, Ball]]:
    """Return functions of the coefficients that are zero where stability changes."""
    found = []
    for factor in Case(proof, False).left[0].factors:
        p, n = factor.p, len(factor.p) - 1
        found.append(("divergence", p[0]))
        if factor.even and n > 1:
            slope = [k * x for k, x in enumerate(p)][1:]
            found.append(("collision", ball_polynomials.resultant(p, slope)))
        elif not factor.even and n > 1:
            hurwitz = [
                [p[n - 1 - 2 * j + i] if 0 <= n - 1 - 2 * j + i <= n else ball(0) for j in range(n - 1)]
                for i in range(n - 1)
            ]
            found.append(("flutter", ball_matrices.determinant(np.array(hurwitz, dtype=object))))
    return found
