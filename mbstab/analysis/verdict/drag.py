"""Written forces that take energy from every motion near a rest: drag of any power of the speed.

Their power along the motion, without what they are at rest, is an exact sum of products. Each product of rates
is not negative by parity (even powers, sizes, and odd functions times their argument), or a quadratic form of rates,
and its coefficient, which depends on positions alone, has a sign at the reference and so near it. A product of
higher order is outweighed near rest by a part of it that dissipates.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from contextlib import suppress
from fractions import Fraction
from functools import cached_property
from typing import Any

import numpy as np

from mbstab.analysis.verdict.exact_sums import Atom, Monomial, Structure, Sum, atoms, divided, ratio, together
from mbstab.analysis.verdict.smoothness import Corners
from mbstab.analysis.verdict.tolerances import TOLERANCES
from mbstab.compiler.system import System
from mbstab.mechanics.measures import is_speed
from mbstab.model.expressions import Expression, ExpressionError
from mbstab.model.functions import CALLED, PIECED
from mbstab.model.schema import Entry

ONE: Monomial = frozenset()


class Drag:
    """The power of written forces near rest.

    Parameters
    ----------
    system : System
        Its parameters may vary over the points of a sweep.
    q : ndarray, shape (…, n_q)
        The reference, which is at rest, at each point.
    time : float (s)
    """

    def __init__(self, system: System, q: Any, time: Any) -> None:
        self.system, self.q, self.time = system, q, time

    @cached_property
    def _at(self) -> Corners:
        return Corners(Structure(self.system.scene), self.system, self.q, 0.0 * self.q, self.time)

    def resists(self, path: str) -> Any:
        """Return at each point whether an entry never gives energy to motions near the reference."""
        # Sums under a power are seen to have its sign where they are kept together, common factors where they are not.
        return np.asarray(self._takes_as(path, expanded=False)) | self._takes_as(path, expanded=True)

    def _takes_as(self, path: str, expanded: bool) -> Any:
        """Return the same, with powers of sums kept together or expanded."""
        try:
            power = self._power(path, expanded)
        except ExpressionError:
            return False
        return power is not None and not power.time and self._takes(power)

    def _power(self, path: str, expanded: bool) -> Sum | None:
        """Return what an entry gives to a motion beyond what it does at rest; None if that is not known."""
        power, exact = Sum(), self._at.structure.exact
        if path in self._dissipations:
            return _power_of(exact(self._dissipations[path], expanded=True))
        for name, force in self._equations(path).items():
            moving = exact(force, expanded=expanded) - exact(force, still=True, expanded=expanded)
            power = power + moving * Sum.of(Atom.of("state", f"rate({name})"))
        return power

    def _equations(self, path: str) -> dict[str, Expression]:
        return self._entries[path].equations

    @cached_property
    def _entries(self) -> dict[str, Entry]:
        return {item.entry.path: item.entry for item in self.system.scene.items}

    @cached_property
    def _dissipations(self) -> dict[str, Expression]:
        items = (item for item in self.system.scene.items if item.kind.written == "dissipation")
        return {item.entry.path: item.entry.equations["dissipation"] for item in items}

    def potential(self, path: str) -> bool | None:
        """Return whether what an entry does at rest has a potential, by structure; None: its derivatives decide.

        A force along a coordinate on which it alone depends has one. Where pieces meet, derivatives at random states
        decide of the others only.
        """
        if path in self._dissipations:
            return True  # nothing acts at rest
        still = {name: self._at.structure.exact(x, still=True) for name, x in self._equations(path).items()}
        others = [x for name, own in still.items() for x in _beyond(own, name)]
        if not others:
            return True
        return False if any(atom.kind in PIECED for x in others for atom in atoms(x) if atom.state) else None

    def works(self, path: str) -> bool:
        """Return whether the power of an entry depends on the speeds otherwise than that of a force at rest."""
        for expanded in (False, True):
            with suppress(ExpressionError):
                power = self._power(path, expanded)
                if power is not None and not power:
                    return False
        return True

    # --- the sign of a power ----------------------------------------------------------------------------------------

    def _takes(self, power: Sum) -> Any:
        """Return at each point whether a power is not positive near rest."""
        parts = self._by_rates(power)
        if parts is None:
            return False
        signs = {V: self._sign_of_rates(V) for V in parts}
        at = {V: self._sign(C) for V, C in parts.items()}
        anchors = {V: signs[V] * at[V] < 0.0 for V in parts}
        good = {V: anchors[V] | (signs[V] * self._sign_of_terms(C) < 0.0) for V, C in parts.items()}
        for members, definite, semidefinite in self._forms(parts, good):
            for V in members:
                # Squares that others cancel in some direction outweigh nothing.
                good[V], anchors[V] = np.asarray(semidefinite), definite & (signs[V] != 0.0)
        fine: Any = np.array(True)
        for V in parts:
            outweighed: Any = np.array(False)
            for W, sure in anchors.items():
                if W != V and self._follows(V, W):
                    outweighed = outweighed | sure
            fine = fine & (good[V] | outweighed)
        return fine

    def _by_rates(self, power: Sum) -> dict[Monomial, Sum] | None:
        """Return a power as products of rates, each with its coefficient; None if a sum of rates has no partner."""
        found: dict[Monomial, Sum] = {}
        split: dict[Monomial, Sum] = {}
        for monomial, coefficient in power.terms:
            # What does not vanish at rest belongs to the coefficient, as what depends on positions alone.
            factors = [x for x in monomial if _moves(x[0]) and not _is_rate(x[0])]
            heads = frozenset(x for x in factors if not np.all(self._sign(Sum.of(x[0]))))
            split[heads] = split.get(heads, Sum()) + Sum(frozenset({(monomial - heads, coefficient)}))
        for heads, others in split.items():
            odd = [atom for atom, n in self._parity(heads)[1].items() if n % 2 and atom.kind == "group"]
            left = divided(others, odd[0].arguments[0]) if odd else others
            if left is None or len(odd) > 1:
                return None
            outer = _product(heads, {(odd[0], 1)}) if odd else heads
            for monomial, coefficient in left.terms:
                plain = frozenset(x for x in monomial if _is_rate(x[0]))
                V = _product(outer, plain)
                found[V] = found.get(V, Sum()) + Sum(frozenset({(monomial - plain, coefficient)}))
        return {V: C for V, C in found.items() if C}

    def _parity(self, monomial: Iterable[tuple[Atom, int]]) -> tuple[Any, Counter[Atom]]:
        """Return a sign and the powers of factors: near the reference the product has that sign times theirs.

        The sign is 0 where that is not known.
        """
        sign: Any = np.array(1.0)
        powers: Counter[Atom] = Counter()
        for atom, n in monomial:
            own = self._sign(Sum.of(atom))
            entry = CALLED.get(atom.kind)
            if np.all(own):
                sign = sign * own**n
            elif n < 0:
                sign = 0.0 * sign
            elif n % 2 == 0 or atom.kind == "power" or (entry is not None and entry.span[0] >= 0.0):
                pass
            elif atom.kind in ("state", "group"):
                powers[atom] += n
            elif entry is not None and entry.parity == "odd" and self._vanishes(atom.arguments[0]):
                times, inner = self._like(atom.arguments[0])
                sign, powers = sign * times, powers + inner
            else:
                sign = 0.0 * sign
        return sign, powers

    def _like(self, x: Sum) -> tuple[Any, Counter[Atom]]:
        """Return the same for the argument of an odd function, which has its sign."""
        if len(x.terms) > 1:
            sign, kept = together(x)
            return np.array(float(sign)), Counter({kept: 1})
        ((monomial, coefficient),) = x.terms
        sign, powers = self._parity(monomial)
        return sign * (1.0 if coefficient > 0 else -1.0), powers

    def _sign_of_rates(self, V: Monomial) -> Any:
        """Return the sign that a product has for all small rates; 0: it has both, or it is not known."""
        sign, powers = self._parity(V)
        return 0.0 * sign if any(n % 2 for n in powers.values()) else sign

    def _sign_of_terms(self, coefficient: Sum) -> Any:
        """Return the sign that all terms of a coefficient have near the reference, or are zero; 0: not known."""
        found = [self._sign_of_rates(monomial) * (1.0 if x > 0 else -1.0) for monomial, x in coefficient.terms]
        total = sum(found, np.array(0.0))
        return np.where(np.abs(total) == len(found), np.sign(total), 0.0)

    def _follows(self, V: Monomial, W: Monomial) -> bool:
        """Return whether V is W times a product that vanishes at rest."""
        left = _sizes(V)
        for atom, n in _sizes(W).items():
            left[atom] = left.get(atom, Fraction(0)) - n
        factors = [(atom, n) for atom, n in left.items() if n and not np.all(self._sign(Sum.of(atom)))]
        return all(n > 0 for _, n in factors) and any(self._vanishes(Sum.of(atom)) for atom, _ in factors)

    def _sign(self, x: Sum) -> Any:
        """Return the sign of a sum at each point and in its surroundings; 0 where it is not certain."""
        if x.state and not self._settled:
            return np.array(0.0)
        if not self._at.structure.uncertain(x):
            return self._at.sign(x)
        return np.array(float(self._at.structure.sign(x) or 0))

    @cached_property
    def _settled(self) -> bool:
        """Whether the reference is known: it may move with parameters that lie in intervals."""
        return self._at.structure.settled

    def _vanishes(self, x: Sum) -> bool:
        """Whether a sum is exactly zero at rest."""
        certain = not self._at.structure.uncertain(x)
        return certain and bool(np.all(self._at.structure.value(x, self._at.names)[0] == 0.0))

    def _forms(self, parts: dict[Monomial, Sum], good: dict[Monomial, Any]) -> list[tuple[list[Monomial], Any, Any]]:
        """Return quadratic forms of rates: their products, where they are negative definite, and semidefinite."""
        forms: dict[Monomial, dict[Monomial, Sum]] = {}
        for V, C in parts.items():
            plain = frozenset((atom, n) for atom, n in V if _is_rate(atom))
            if sum(n for _, n in plain) == 2:
                forms.setdefault(V - plain, {})[plain] = C
        found = []
        for heads, form in forms.items():
            members = [_product(heads, plain) for plain in form]
            if all(np.all(good[V]) for V in members):
                continue
            outer = self._sign_of_rates(heads)
            rates = sorted({atom for plain in form for atom, _ in plain}, key=lambda atom: atom.name)
            entries = [[form.get(_pair(a, b), Sum()) * (1 if a is b else Fraction(1, 2)) for b in rates] for a in rates]
            found.append((members, *self._negative(entries, outer)))
        return found

    def _negative(self, entries: list[list[Sum]], outer: Any) -> tuple[Any, Any]:
        """Return at each point whether a matrix times a sign is negative definite, and semidefinite, near it."""
        first = next((row[i] for i, row in enumerate(entries) if row[i]), None)
        if first is None:
            return np.array(False), np.array(False)
        one = outer * self._sign(first) < 0.0
        ratios = [[ratio(x, first) if x else Fraction(0) for x in row] for row in entries]
        if all(x is not None for row in ratios for x in row):
            definite, semidefinite = _positive(ratios)
            return one & definite, one & semidefinite
        if any(self._at.structure.uncertain(x) for row in entries for x in row):
            return np.array(False), np.array(False)
        n, values = len(entries), [self._at.structure.value(x, self._at.names) for row in entries for x in row]
        flat = np.stack(np.broadcast_arrays(*(x for pair in values for x in (-outer * pair[0], pair[1]))), axis=-1)
        h, size = (flat[..., k::2].reshape(*flat.shape[:-1], n, n) for k in (0, 1))
        diagonal = np.diagonal(h, axis1=-2, axis2=-1)
        scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
        units = scale[..., :, None] * scale[..., None, :]
        least = np.linalg.eigvalsh(h * units)[..., 0]
        definite = np.all(diagonal > 0.0, axis=-1) & (
            least > TOLERANCES.constant_rounding * np.linalg.norm(size * units, axis=(-2, -1))
        )
        return definite, definite


def _power_of(dissipation: Sum) -> Sum | None:
    """Return −Σ u ∂D/∂u of a polynomial D of rates: minus its terms times their degrees (Euler)."""
    found = Sum()
    for monomial, coefficient in dissipation.terms:
        parts = [part for atom, _ in monomial if not _is_rate(atom) for part in atoms(Sum.of(atom))]
        if any(_is_rate(part) or is_speed(part.name) for part in parts if part.kind == "state"):
            return None
        degree = sum(n for atom, n in monomial if _is_rate(atom))
        found = found + Sum(frozenset({(monomial, -degree * coefficient)} if degree else ()))
    return found


def _is_rate(atom: Atom) -> bool:
    return atom.kind == "state" and atom.name.startswith("rate(")


def _moves(atom: Atom) -> bool:
    """Whether a factor contains rates."""
    return any(_is_rate(x) for x in atoms(Sum.of(atom)))


def _beyond(force: Sum, name: str) -> list[Sum]:
    """Return the terms of a force along a coordinate or a measure that do not depend on this alone."""
    terms = [Sum(frozenset({term})) for term in force.terms]
    if is_speed(name):
        return terms
    return [x for x in terms if not {atom.name for atom in atoms(x) if atom.kind == "state"} <= {name}]


def _product(one: Iterable[tuple[Atom, int]], other: Iterable[tuple[Atom, int]]) -> Monomial:
    powers = Counter(dict(one))
    powers.update(dict(other))
    return frozenset((atom, n) for atom, n in powers.items() if n)


def _sizes(monomial: Monomial) -> dict[Atom, Fraction]:
    """Return the powers of factors in the size of a product, with rates in place of their sizes."""
    found: dict[Atom, Fraction] = {}
    for atom, n in monomial:
        times = Fraction(n)
        exponent = atom.arguments[1].rational if atom.kind == "power" else None
        if exponent is not None and (base := _alone(atom.arguments[0])):
            atom, times = base, times * exponent
        if atom.kind == "abs" and (inner := _alone(atom.arguments[0])):
            atom = inner
        found[atom] = found.get(atom, Fraction(0)) + times
    return found


def _alone(x: Sum) -> Atom | None:
    """Return the atom of which a sum is a rational multiple, or None."""
    ((monomial, _),) = x.terms if len(x.terms) == 1 else ((ONE, Fraction(0)),)
    ((atom, n),) = monomial if len(monomial) == 1 else ((None, 0),)
    return atom if n == 1 else None


def _pair(a: Atom, b: Atom) -> Monomial:
    return frozenset({(a, 2)}) if a is b else frozenset({(a, 1), (b, 1)})


def _positive(rows: list[list[Any]]) -> tuple[bool, bool]:
    """Return whether a symmetric matrix of rationals is positive definite, and semidefinite (elimination)."""
    left = [row[:] for row in rows]
    while left:
        k = max(range(len(left)), key=lambda i: left[i][i])
        pivot = left[k][k]
        if pivot <= 0:
            return False, not any(x for row in left for x in row)
        factors = [row[k] / pivot for row in left]
        left = [
            [x - factors[i] * left[k][j] for j, x in enumerate(row) if j != k] for i, row in enumerate(left) if i != k
        ]
    return True, True
